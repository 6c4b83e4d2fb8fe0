"""Coordinates of a motion: names, units, joint velocities, and continuity of wrapped angles and quaternions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import drive_turns
from ..mechanics.model.model import Model
from .column_names import DEGREES, SUFFIX


class MimicJoint(NamedTuple):
    """Mimic joint: its coordinate is ``ratio`` times the leader's, plus ``offset``."""

    name: str
    leader: int
    """Index of the leader's coordinate in q."""
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
    """Names of the entries of q: the joint's name, with a suffix for joints with several coordinates."""
    velocity_names: tuple[str, ...]
    """Names of the entries of dq, ddq and torques; the joint's name for one-degree joints."""
    angular: Array
    """(nq,) True for angles; False for lengths and quaternion entries."""
    angular_velocity: Array
    """(nv,) True for rotation about an axis [rad/s, N m]; False for translation along it [m/s, N]."""
    position_of: Array
    """(nv,) index in q that belongs to each velocity; -1 if none does (planar and floating joints)."""
    endless: Array
    """(nq,) True for angles that a log may wrap at ±π: continuous joints and theta of planar joints."""
    quaternions: tuple[slice, ...]
    """Slices of the floating joints' quaternions in q."""
    mimic_joints: tuple[MimicJoint, ...]
    """Mimic joints, except those with a continuous leader, whose angle a log may wrap."""
    drive_names: tuple[str, ...] = ()
    """Names of drive torques, with coupled motors in place of their joints; empty if none are coupled."""
    drive_turns: tuple[bool, ...] = ()
    """True for drive torques in N m, False for forces in N."""
    coupled: tuple[tuple[Array, Array, Array], ...] = ()
    """Indices of coupled joints and matrices of their motors, see :attr:`twistwrench.mechanics.model.model.Model.coupled`."""

    def headers(self, part: str = "q", *, degrees: bool = False) -> list[str]:
        """Column names of a quantity in written files.

        Parameters
        ----------
        part : "q", "dq", "ddq" or "tau"
        degrees : bool, use degrees for angles and note them in the names

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
        """Unit, ``N m`` or ``N``, for each velocity."""
        return units_of("tau", self.angular_velocity)


def joint_rates(model: Model, q: Array, dq_dt: Array, d2q_dt2: Array) -> tuple[Array, Array]:
    """Joint velocities and accelerations (n, nv) from rates of q (n, nq); planar and floating joints: child's frame."""
    velocities, accelerations = [np.zeros((len(q), 0))], [np.zeros((len(q), 0))]
    for b in model.leaders:
        here = b.places[0]
        v, a = b.joint.velocities(q[:, here], dq_dt[:, here], d2q_dt2[:, here])
        velocities.append(v)
        accelerations.append(a)
    return np.concatenate(velocities, axis=1), np.concatenate(accelerations, axis=1)


_CACHE: WeakKeyDictionary[Model, Coordinates] = WeakKeyDictionary()
"""Cache by model, as every simulation needs the coordinates."""


# ── Continuous curves: unwrapped angles, quaternions of constant sign

_FULL = 0.75
"""Smallest step, as a fraction of a turn, that counts as an omitted turn of a bounded joint."""
_SPILL = 0.01
"""Relative excess over half a turn due to rounding to two decimals (3.15 for π)."""


@dataclass(frozen=True, eq=False)
class Continuity:
    """Columns of q with spurious jumps; determined once per log, so that all windows agree."""

    wrapped: Array
    """(nq,) True for endless angles that stay within one turn, ±π or 0 to 2π. Other angles count turns; their steps
    of more than π are real.
    """
    quaternions: tuple[slice, ...]
    """Slices of quaternions; p and -p are the same rotation, but a sign change breaks the curve."""
    left_out: Array
    """(nq,) True for angles of bounded joints within one turn. Only a step of nearly a full turn counts as an omitted
    turn.
    """

    @classmethod
    def from_parts(cls, coordinates: Coordinates, parts: Sequence[Array], turn: float | Array = math.tau) -> Continuity:
        """Find the jumps from excerpts of q (n, nq); ``turn``, () or (nq,), is a full turn in the excerpts' units."""
        least = np.min([x.min(axis=0, initial=math.inf) for x in parts], axis=0)
        most = np.max([x.max(axis=0, initial=-math.inf) for x in parts], axis=0)
        half, spill = 0.5 * np.asarray(turn), _SPILL * 0.5 * np.asarray(turn)
        about_zero = (least >= -half - spill) & (most <= half + spill)
        from_zero = (least >= -spill) & (most <= turn + spill)
        within = about_zero | from_zero
        bounded = coordinates.angular & ~coordinates.endless
        return cls(coordinates.endless & within, coordinates.quaternions, bounded & within)

    def curves(self, q: Array, turn: float | Array = math.tau) -> Array:
        """Consecutive rows of q (n, nq) without the jumps; each column keeps its first value."""
        found, turns = q.copy(), np.broadcast_to(np.asarray(turn, float), q.shape[1:])
        for k in np.flatnonzero(self.wrapped):
            found[:, k] = np.unwrap(q[:, k], period=turns[k])
        for k in np.flatnonzero(self.left_out):
            # np.unwrap does not change steps below ``discont``.
            found[:, k] = np.unwrap(q[:, k], period=turns[k], discont=_FULL * turns[k])
        for place in self.quaternions:
            p = q[:, place]
            same = np.sum(p[1:] * p[:-1], axis=1) >= 0
            found[:, place] = p * np.cumprod(np.r_[1.0, np.where(same, 1.0, -1.0)])[:, None]
        return found


complete(globals())
