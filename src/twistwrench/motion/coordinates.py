"""What the numbers of a motion are called and measured in, and how rates of coordinates become joint velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lie import quaternion
from ..model.joint import Joint
from ..model.model import Model

Array = NDArray[Any]

__all__ = ["Coordinates", "joint_rates"]


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Names and units of the entries of q (nq) and of dq (nv) of one robot."""

    names: tuple[str, ...]
    """Entries of q: the joint's name, with a suffix where a joint has several."""
    velocity_names: tuple[str, ...]
    """Entries of dq, ddq and of the torques; the joint's name for one-degree joints."""
    angular: Array
    """(nq,) bool: an angle, as opposed to a length or a quaternion's entry."""
    angular_velocity: Array
    """(nv,) bool: about an axis [rad/s, N m], as opposed to along it [m/s, N]."""
    position_of: Array
    """(nv,) which entry of q the velocity belongs to; -1 where none does (planar and floating joints)."""
    endless: Array
    """(nq,) bool: an angle that a log may wrap at ±π, a continuous joint's or a planar joint's theta."""
    quaternions: tuple[slice, ...]
    """Where in q the quaternions of floating joints stand."""

    @classmethod
    def of(cls, model: Model) -> Coordinates:
        """Read them off the model."""
        joints = [b.joint for b in model.leaders]
        position_of = np.full(model.nv, -1)
        for b in model.leaders:
            if b.joint.nv == 1:
                position_of[b.v_index] = b.q_index
        entries = [(j, s) for j in joints for s in j.coordinate_suffixes]
        return cls(
            names=tuple(j.name + s for j, s in entries),
            velocity_names=model.velocity_names,
            angular=np.array([s == ".theta" or (not s and _turns(j)[0]) for j, s in entries], bool),
            angular_velocity=np.array([a for j in joints for a in _turns(j)], bool),
            position_of=position_of,
            endless=np.array([s == ".theta" or j.kind == "continuous" for j, s in entries], bool),
            quaternions=tuple(slice(b.q_index, b.q_index + 4) for b in model.leaders if b.joint.kind == "floating"),
        )

    @property
    def torque_units(self) -> tuple[str, ...]:
        """``N m`` or ``N`` for each velocity."""
        return tuple("N m" if a else "N" for a in self.angular_velocity)


def _turns(joint: Joint) -> list[bool]:
    """Of each of the joint's velocities: whether it turns, as opposed to slides."""
    return [bool(axis[:3].any()) for axis in joint.axes]


def joint_rates(model: Model, q: Array, dq_dt: Array, d2q_dt2: Array) -> tuple[Array, Array]:
    """Velocities and accelerations (n, nv) of the joints from q and its time derivatives (n, nq), entry by entry.

    They are the same for one-degree joints. Planar and floating joints count dq in the child's frame.
    """
    velocities, accelerations = [np.zeros((len(q), 0))], [np.zeros((len(q), 0))]
    for b in model.leaders:
        here = slice(b.q_index, b.q_index + b.joint.nq)
        v, a = _body_rates(b.joint, q[:, here], dq_dt[:, here], d2q_dt2[:, here])
        velocities.append(v)
        accelerations.append(a)
    return np.concatenate(velocities, axis=1), np.concatenate(accelerations, axis=1)


def _body_rates(joint: Joint, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
    if joint.kind == "planar":
        c, s, w = np.cos(q[:, 2]), np.sin(q[:, 2]), q1[:, 2]
        vx, vy = c * q1[:, 0] + s * q1[:, 1], c * q1[:, 1] - s * q1[:, 0]
        ax, ay = c * q2[:, 0] + s * q2[:, 1] + w * vy, c * q2[:, 1] - s * q2[:, 0] - w * vx
        return np.stack([w, vx, vy], axis=1), np.stack([q2[:, 2], ax, ay], axis=1)
    if joint.kind == "floating":
        # omega_b = 2 vec(conj(p) p') / |p|²; its derivative needs no conj(p') p' because that is a pure scalar.
        p, p1, p2 = q[:, :4], q1[:, :4], q2[:, :4]
        conj, norm2 = p * np.array([1.0, -1, -1, -1]), np.sum(p * p, axis=1, keepdims=True)
        w = 2.0 * quaternion.multiply(conj, p1)[:, 1:] / norm2
        dw = 2.0 * (quaternion.multiply(conj, p2)[:, 1:] - np.sum(p * p1, axis=1, keepdims=True) * w) / norm2
        R_bs = np.swapaxes(quaternion.rotation(p), -1, -2)
        v = (R_bs @ q1[:, 4:, None])[..., 0]
        a = (R_bs @ q2[:, 4:, None])[..., 0] - np.cross(w, v)
        return np.concatenate([w, v], axis=1), np.concatenate([dw, a], axis=1)
    return q1, q2
