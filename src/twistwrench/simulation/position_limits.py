"""Limits of position as events: one margin for each joint and side, each looked at by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.printed_numbers import printed
from ..errors import ValueRangeError
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False)
class PositionLimits:
    """The m finite limits of position of a robot.

    A joint is inside a limit, at it, or beyond it: at it within the tolerance of :class:`twistwrench.model.limits.Limits`.
    A joint that is inside reaches its limit where the margin is zero. A joint that is at its limit leaves through it where
    the margin is less than minus the tolerance, so one that rests there ends nothing.
    """

    names: tuple[str, ...]
    """(m,) of the joints."""
    units: tuple[str, ...]
    """(m,) "rad" or "m"."""
    sides: Array
    """(m,) -1 for a lower limit, 1 for an upper one."""
    limits: Array
    """(m,) rad or m."""
    tolerances: Array
    """(m,) rad or m."""
    coordinates: Array
    """(m,) places in q."""
    velocities: Array
    """(m,) places in dq."""

    @classmethod
    def of(cls, robot: Robot) -> PositionLimits:
        """Those of a robot; ValueRangeError where it has none."""
        given, tolerance = robot.limits, robot.limits.tolerance
        rows = [
            (
                b.joint.name,
                b.joint.coordinate_units[0],
                side,
                limits[b.v_index],
                tolerance[b.v_index],
                b.q_index,
                b.v_index,
            )
            for b in robot.model.leaders
            if b.joint.nv == 1
            for side, limits in ((-1, given.lower), (1, given.upper))
            if np.isfinite(limits[b.v_index])
        ]
        if not rows:
            raise ValueRangeError(f"limits='stop': robot {robot.name!r} has no limits of position. Leave limits out.")
        names, units, *numbers = zip(*rows, strict=True)
        return cls(names, units, *map(np.array, numbers))

    def margins(self, q: Array) -> Array:
        """How far each joint is inside each of its limits, (..., nq) → (..., m), negative beyond it [rad or m]."""
        return np.asarray(self.sides * (self.limits - q[..., self.coordinates]))

    def outside(self, q: Array) -> str:
        """In words, the joint farthest beyond a limit; empty where none is beyond."""
        share = -self.margins(q) / self.tolerances
        worst = int(share.argmax())
        if share[worst] <= 1.0:
            return ""
        place = f"{printed(q[self.coordinates[worst]])} {self.units[worst]}"
        return f"joint {self.names[worst]!r} is at {place}, beyond {self.limit(worst)}"

    def limit(self, k: int) -> str:
        """Limit k in words."""
        return f"its {'lower' if self.sides[k] < 0 else 'upper'} limit {printed(self.limits[k])} {self.units[k]}"

    def level(self, k: int, before: float) -> float:
        """The margin at which an event happens, for a joint whose margin was ``before``."""
        return 0.0 if before > self.tolerances[k] else -float(self.tolerances[k])

    def passed(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Whether joints reach their limits, or leave through them, by the margins (..., m) before and after."""
        leaves = (after < -self.tolerances) & (-self.tolerances <= before)
        return np.where(before > self.tolerances, after <= 0.0, leaves)

    def words(self, k: int, before: float) -> str:
        """What happened at limit k."""
        return f"joint {self.names[k]!r} {'reaches' if before > self.tolerances[k] else 'moves beyond'} {self.limit(k)}"

    def leaving(self, q: Array, dq: Array, later: Array, h: float) -> int | None:
        """The limit that a joint at it leaves through at once, the fastest if there are several; None if there is none.

        A joint leaves if it moves outward, or is at rest and moves outward ``h`` s later, at the velocities ``later`` (nv):
        faster, or with more acceleration, than takes it past the tolerance in a second.
        """
        speed, gained = (self.sides * v[self.velocities] for v in (dq, later - dq))
        rests = np.abs(speed) <= self.tolerances
        out = (speed > self.tolerances) | (rests & (gained > h * self.tolerances))
        out &= np.abs(self.margins(q)) <= self.tolerances
        if not out.any():
            return None
        return int(np.where(out, speed + gained, -np.inf).argmax())
