"""Coordinates of a motion: names, units, joint velocities from rates, and continuity of wrapped angles and quaternions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..core.glossary import complete
from ..joints.units import units_of
from ..model.couplings import drive_turns
from ..model.model import Model
from ..typing import Array
from .column_names import DEGREES, SUFFIX


class MimicJoint(NamedTuple):
    """A mimic joint, whose coordinate is ``ratio`` times that of its leader, plus ``offset``."""

    name: str
    leader: int
    """Index of its leader's coordinate in q."""
    ratio: float
    offset: float
    angular: bool


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Names and units of the entries of q (nq) and of dq (nv) of one robot.

    Examples
    --------
    >>> import twistwrench as tw
    >>> coordinates = Coordinates.from_model(tw.robots.pendulum().model)
    >>> coordinates.names, coordinates.headers("dq", degrees=True)
    (('hinge',), ['hinge.vel [deg/s]'])
    """

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
    """Places of the quaternions of floating joints in q."""
    mimic_joints: tuple[MimicJoint, ...]
    """The joints that have no entry of their own, but for those of leaders that turn for ever: a log wraps these."""
    drive_names: tuple[str, ...] = ()
    """Entries of the torques of drives, those of coupled motors in the places of their joints; empty if none are coupled."""
    drive_turns: tuple[bool, ...] = ()
    """True for entries of the torques of drives in N m, as opposed to N."""
    coupled: tuple[tuple[Array, Array, Array], ...] = ()
    """Places of coupled joints, and the matrices of their motors, as :attr:`twistwrench.model.model.Model.coupled`."""

    def headers(self, part: str = "q", *, degrees: bool = False) -> list[str]:
        """Names of the columns of a quantity in files written here.

        Parameters
        ----------
        part : "q", "dq", "ddq" or "tau"
        degrees : bool, angles are in degrees there, and the names say so

        Returns
        -------
        headers : list of str
        """
        q = part == "q"
        names, turning = (self.names, self.angular) if q else (self.velocity_names, self.angular_velocity)
        said = f" [{DEGREES[part]}]" if degrees and part in DEGREES else ""
        return [f"{n}{SUFFIX[part]}{said if t else ''}" for n, t in zip(names, turning, strict=True)]

    @classmethod
    def from_model(cls, model: Model) -> Coordinates:
        """Names and units of a model's coordinates.

        Returns
        -------
        coordinates : Coordinates
        """
        found = _CACHE.get(model)
        if found is not None:
            return found
        joints = [b.joint for b in model.leaders]
        endless = np.array([k in j.wraps for j in joints for k in range(j.nq)], bool)
        position_of = np.full(model.nv, -1)
        for b in model.leaders:
            if b.joint.nv == 1:
                position_of[b.v_index] = b.q_index
        found = _CACHE[model] = cls(
            names=model.coordinate_names,
            velocity_names=model.velocity_names,
            angular=np.array([unit == "rad" for j in joints for unit in j.coordinate_units], bool),
            angular_velocity=np.array([turns for j in joints for turns in j.turning], bool),
            position_of=position_of,
            endless=endless,
            quaternions=model.quaternions,
            mimic_joints=tuple(
                MimicJoint(b.joint.name, b.q_index, b.ratio, b.offset, bool(b.joint.turning[0]))
                for b in model.bodies
                if b.follows and not endless[b.q_index]
            ),
            drive_names=model.drive_names if model.couplings else (),
            drive_turns=tuple(drive_turns(model)) if model.couplings else (),
            coupled=model.coupled,
        )
        return found

    @property
    def torque_units(self) -> tuple[str, ...]:
        """``N m`` or ``N`` for each velocity."""
        return units_of("tau", self.angular_velocity)


def joint_rates(model: Model, q: Array, dq_dt: Array, d2q_dt2: Array) -> tuple[Array, Array]:
    """Joint velocities and accelerations (n, nv) from rates of q (n, nq); planar and floating joints in the child's frame."""
    velocities, accelerations = [np.zeros((len(q), 0))], [np.zeros((len(q), 0))]
    for b in model.leaders:
        here = b.places[0]
        v, a = b.joint.velocities(q[:, here], dq_dt[:, here], d2q_dt2[:, here])
        velocities.append(v)
        accelerations.append(a)
    return np.concatenate(velocities, axis=1), np.concatenate(accelerations, axis=1)


_CACHE: WeakKeyDictionary[Model, Coordinates] = WeakKeyDictionary()
"""Coordinates of each model in use: simulations need them in every run."""


# ── Continuous curves: unwrapped angles, quaternions of steady sign

_FULL = 0.75
"""Share of a turn: least step of a bounded joint that counts as an omitted turn."""
_SPILL = 0.01
"""Share of half a turn by which rounding to two decimals exceeds it (3.15 for π)."""


@dataclass(frozen=True, eq=False)
class Continuity:
    """Columns of q that jump without the robot jumping; decided once for a log, so that all its windows agree."""

    wrapped: Array
    """(nq,) bool: endless angles that never leave one turn, within ±π or 0 to 2π. Others count turns, and steps of more
    than π are meant."""
    quaternions: tuple[slice, ...]
    """Places of quaternions: p and -p are one rotation, but not one curve."""
    left_out: Array
    """(nq,) bool: angles of bounded joints within one turn. There a step of nearly a full turn, and no other, is a turn that
    the log left out."""

    @classmethod
    def from_parts(cls, coordinates: Coordinates, parts: Sequence[Array], turn: float | Array = math.tau) -> Continuity:
        """Judge by excerpts of q (n, nq), with angles in units of which ``turn``, () or (nq,), make a full turn."""
        least = np.min([x.min(axis=0, initial=math.inf) for x in parts], axis=0)
        most = np.max([x.max(axis=0, initial=-math.inf) for x in parts], axis=0)
        half, spill = 0.5 * np.asarray(turn), _SPILL * 0.5 * np.asarray(turn)
        about_zero = (least >= -half - spill) & (most <= half + spill)
        from_zero = (least >= -spill) & (most <= turn + spill)
        within = about_zero | from_zero
        bounded = coordinates.angular & ~coordinates.endless
        return cls(coordinates.endless & within, coordinates.quaternions, bounded & within)

    def curves(self, q: Array, turn: float | Array = math.tau) -> Array:
        """Consecutive rows of q (n, nq) without those jumps; each column begins where it did."""
        found, turns = q.copy(), np.broadcast_to(np.asarray(turn, float), q.shape[1:])
        for k in np.flatnonzero(self.wrapped):
            found[:, k] = np.unwrap(q[:, k], period=turns[k])
        for k in np.flatnonzero(self.left_out):
            # np.unwrap leaves steps below ``discont`` as they are.
            found[:, k] = np.unwrap(q[:, k], period=turns[k], discont=_FULL * turns[k])
        for place in self.quaternions:
            p = q[:, place]
            same = np.sum(p[1:] * p[:-1], axis=1) >= 0
            found[:, place] = p * np.cumprod(np.r_[1.0, np.where(same, 1.0, -1.0)])[:, None]
        return found


complete(globals())
