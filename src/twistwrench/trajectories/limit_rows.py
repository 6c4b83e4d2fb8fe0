"""Robot limits along a path, as bounds of the path parameter's acceleration and squared rate.

With x = ds² and u = dds every limit has the form |a(s) u + b(s) x + d(s) √x + c(s)| ≤ L or x ≤ cap(s). For torques, by
MR eq. 9.34, a = M q', b = M q'' + c(q, q'), c = g; friction adds d and a constant. For accelerations a = q', b = q''.
If the deceleration limit d differs from the acceleration limit a, -d ≤ sign(q') ddq ≤ a becomes |sign(q') ddq + (d -
a)/2| ≤ (d + a)/2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import PathError, ValueRangeError
from ..core.numbers import printed
from ..core.text import Argument, spell
from ..core.typing import Array
from ..mechanics.model.couplings import motor_torques, motor_velocities

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot
    from .paths import JointPath

_FLAT_RATIO = 1e-11
"""Ratio of a to the largest a below which a row bounds x only, since the rest is rounding error."""
_NUDGE = 1e-13
"""Distance by which the ends of a piece are moved inside if one-sided limits differ there."""


@dataclass(frozen=True)
class Row:
    """Row of limits: a limited torque, acceleration or velocity."""

    kind: str
    """``torque``, ``acceleration`` or ``velocity``."""
    joint: int
    """Index of the entry of dq."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Limit rows at points (m,) of the path."""

    a: Array
    """(m, k)."""
    b: Array
    c: Array
    d: Array
    cap: Array
    """Upper bounds of x (m, l) by each cap; inf for a cap that does not apply."""

    def values(self, u: Array, x: Array) -> Array:
        """a u + b x + d √x + c; (..., m), (..., m) → (..., m, k)."""
        u, x = u[..., None], x[..., None]
        return self.a * u + self.b * x + self.c + self.d * np.sqrt(np.maximum(x, 0.0))


@dataclass(frozen=True, eq=False)
class Cap:
    """Largest x at some points: limits leave a single acceleration, or a velocity is at its limit."""

    x: Array
    """(m,), inf if unbounded."""
    velocity: Array
    """(m,): by velocities alone."""
    torque: Array
    """(m,): by torques and accelerations alone."""


class PathRows:
    """Limit rows of one robot, path and set of limits, at any path position."""

    def __init__(self, robot: Robot, path: JointPath, bounds: Limits, *, friction: bool = False) -> None:
        self.robot, self.path, self.friction = robot, path, friction
        self.bounds = bounds
        law = robot.model.friction
        if friction and (np.any(law.load) or np.any(law.static != law.coulomb)):
            raise ValueRangeError(
                f"friction of {robot.name!r} depends on the load or has static or Stribeck parts, but fastest timing supports "
                f"only viscous and Coulomb friction. Leave friction out ({spell(Argument('friction', False))}) and lower the "
                "effort limits by the friction torques."
            )
        self.torque = np.flatnonzero(np.isfinite(bounds.effort))
        self.accelerated = np.flatnonzero(np.isfinite(bounds.acceleration))
        up, down = bounds.acceleration[self.accelerated], bounds.deceleration[self.accelerated]
        self._offset = 0.5 * (down - up)
        self.fast = np.flatnonzero(np.isfinite(bounds.velocity))
        self.rows = [Row("torque", int(j)) for j in self.torque]
        self.rows += [Row("acceleration", int(j)) for j in self.accelerated]
        self.L = np.concatenate([bounds.effort[self.torque], 0.5 * (down + up)])
        self.flat = np.zeros(len(self.rows), bool)
        size = np.abs(self.at(self.grid).a)
        self.flat = size.max(axis=0, initial=0.0) <= _FLAT_RATIO * size.max(initial=0.0)
        self.caps = [Row("velocity", int(j)) for j in self.fast]
        self.caps += compress(self.rows, self.flat)

    @cached_property
    def grid(self) -> Array:
        """Points from 0 to 1, dense enough to resolve every sign change; includes knots of the path."""
        return np.unique(np.concatenate([np.linspace(0.0, 1.0, 401), self.path.knots]))

    def at(self, s: Array, low: float = 0.0, high: float = 1.0) -> Rows:
        """Rows at s (m,); at the ends of a piece [low, high] the values from inside it."""
        nudge = _NUDGE * max(1.0, high)
        s = np.clip(s, low + min(nudge, 0.1 * (high - low)), high - min(nudge, 0.1 * (high - low)))
        q, q1, q2 = self.path(s)
        zero = np.zeros_like(q1)
        parts = (np.concatenate([q, q, q]), np.concatenate([zero, zero, q1]), np.concatenate([zero, q1, q2]))
        g, Mq, h = np.split(motor_torques(self.robot.model, self.robot.inverse_dynamics(*parts)), 3)
        a, b, c, d = Mq - g, h - g, g, zero
        if self.friction:
            law, u1 = self.robot.model.friction, motor_velocities(self.robot.model, q1)
            c, d = c + law.coulomb * np.sign(u1), law.viscous * u1
        j, k = self.torque, self.accelerated
        side = np.where(self._offset != 0, np.sign(q1[:, k]), 1.0)
        a, b = np.concatenate([a[:, j], side * q1[:, k]], axis=1), np.concatenate([b[:, j], side * q2[:, k]], axis=1)
        c = np.concatenate([c[:, j], np.broadcast_to(self._offset, side.shape)], axis=1)
        d = np.concatenate([d[:, j], np.zeros_like(side)], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            caps = [(self.bounds.velocity[self.fast] / np.abs(q1[:, self.fast])) ** 2]
            if (f := self.flat).any():
                a = np.where(f, 0.0, a)
                lift = np.where(b[:, f] > 0, self.L[f] - c[:, f], self.L[f] + c[:, f]) / np.abs(b[:, f])
                caps.append(np.where(b[:, f] == 0, np.inf, lift))
        return Rows(a, b, c, d, np.concatenate(caps, axis=1))

    @cached_property
    def breaks(self) -> Array:
        """Ends of pieces from 0 to 1: knots, zeros of each a, and zeros of q' if a limit depends on its sign."""
        points = [np.array([0.0, 1.0]), self.path.knots]
        points += self._column_zeros(lambda s: self.at(s).a, np.flatnonzero(~self.flat))
        points += self._column_zeros(lambda s: self.path(s)[1], self.accelerated[self._offset != 0])
        if self.friction:
            points += self._column_zeros(self._drive_velocities, range(self.robot.nv))
        breaks = np.unique(np.concatenate(points))
        keep = np.concatenate([[True], np.diff(breaks) > 1e-11])
        keep[-1] = True
        return breaks[keep]

    def _drive_velocities(self, s: Array) -> Array:
        """Velocities of the drives at s (m,) for ds/dt = 1; (m, nv)."""
        return np.asarray(motor_velocities(self.robot.model, self.path(s)[1]))

    def _column_zeros(self, f: Callable[[Array], Array], columns: Iterable[int]) -> Iterator[Array]:
        """Sign changes of some columns of f (m, n), a function of s (m,)."""
        values = f(self.grid)
        for k in columns:
            yield self._zeros(values[:, k], lambda s, k=k: f(s)[:, k])

    def _zeros(self, values: Array, f: Any) -> Array:
        """Sign changes of f between the points of the grid, by simultaneous bisection."""
        scale = np.abs(values).max(initial=0.0)
        sign = np.sign(np.where(np.abs(values) <= 1e-13 * scale, 0.0, values))
        exact = self.grid[(sign == 0) & (scale > 0)] if np.count_nonzero(sign == 0) < 20 else np.zeros(0)
        k = np.flatnonzero(sign[:-1] * sign[1:] < 0)
        low, high, sign_at_low = self.grid[k], self.grid[k + 1], sign[k]
        if not len(k):
            return exact
        for _ in range(52):
            middle = 0.5 * (low + high)
            same = np.sign(f(middle)) == sign_at_low
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return np.concatenate([exact, 0.5 * (low + high)])

    def cap(self, s: Array) -> Cap:
        """Largest x at s (m,), from both sides if they differ. MR figure 9.11: the velocity limit curve."""
        sides = [np.clip(s + side, 0.0, 1.0) for side in (-1e-12, 1e-12)]
        below, above = (self.cap_of(self.at(x)) for x in sides)
        return Cap(*(np.minimum(getattr(below, f), getattr(above, f)) for f in ("x", "velocity", "torque")))

    def cap_of(self, rows: Rows) -> Cap:
        """Cap at points with known rows."""
        v = rows.cap[:, : len(self.fast)].min(axis=1, initial=np.inf)
        start = rows.cap.min(axis=1, initial=np.inf)
        tau = self._meeting(rows, np.minimum(rows.cap[:, len(self.fast) :].min(axis=1, initial=np.inf), _UNBOUNDED_X))
        return Cap(np.minimum(start, tau), v, tau)

    def _meeting(self, rows: Rows, x: Array) -> Array:
        """Largest x up to the given one with α ≤ β: Newton's method on the concave β - α from the right, few steps."""
        largest, below, above = x, np.zeros_like(x), x.copy()
        for _ in range(200):
            low, high, slope_low, slope_high = self.accelerations(rows, x)
            gap, slope = high - low, slope_high - slope_low
            done = (x >= largest) & (gap >= 0)
            below, above = np.where(gap >= 0, x, below), np.where(gap < 0, x, above)
            with np.errstate(all="ignore"):
                new = x - np.where(slope < 0, gap / slope, np.nan)  # with viscous friction the lines are curved: bisect
            new = np.where((new >= below) & (new <= above), new, 0.5 * (below + above))
            before, x = x, np.where(done, x, new)
            if (np.abs(x - before) <= 1e-15 * x).all():
                break
        return np.where(x >= 0.999 * _UNBOUNDED_X, np.inf, x)

    def accelerations(self, rows: Rows, x: Array) -> tuple[Array, Array, Array, Array]:
        """Least and largest u at x (m,), α and β, and their slopes with respect to x; (m,) each."""
        f = ~self.flat
        a, b, d = rows.a[:, f], rows.b[:, f], rows.d[:, f]
        root = np.sqrt(np.maximum(x, 1e-300))[:, None]
        v = b * x[:, None] + d * root + rows.c[:, f]
        slope = -(b + 0.5 * d / root)
        size = np.where(a == 0, np.nan, np.abs(a))
        sign = np.sign(a)
        with np.errstate(all="ignore"):
            high = np.where(np.isnan(size), np.inf, (self.L[f] - sign * v) / size)
            low = np.where(np.isnan(size), -np.inf, (-self.L[f] - sign * v) / size)
            rate = np.where(np.isnan(size), 0.0, sign * slope / size)
        if not f.any():
            return np.full(len(x), -np.inf), np.full(len(x), np.inf), np.zeros(len(x)), np.zeros(len(x))
        k, i, j = np.arange(len(x)), low.argmax(axis=1), high.argmin(axis=1)
        return low[k, i], high[k, j], rate[k, i], rate[k, j]

    def require_standing(self) -> None:
        """Raise PathError if the robot cannot stand still somewhere on the path, so that it may be unable to follow it."""
        beside_breaks = [np.clip(self.breaks + side, 0, 1) for side in (1e-12, -1e-12)]
        s = np.unique(np.concatenate([self.grid, *beside_breaks]))
        c = np.abs(self.at(s).c)
        share = np.divide(c, self.L, out=np.zeros_like(c), where=self.L > 0)
        share[(self.L == 0) & (c > 0)] = np.inf
        if share.size and share.max() >= 1 - 1e-6:
            i, k = np.unravel_index(int(share.argmax()), share.shape)
            first = s[(share >= 1 - 1e-6).any(axis=1)][0]
            row, model = self.rows[k], self.robot.model
            name = (model.drive_labels if row.kind == "torque" else model.velocity_names)[row.joint]
            friction = " against friction" if self.friction else ""
            since = f" (too much from s = {printed(first, 4)})" if first < s[i] else ""
            raise PathError(
                f"the robot cannot hold itself on this path: at s = {printed(s[i], 4)} {name!r} needs {printed(c[i, k], 4)} of "
                f"{printed(self.L[k], 4)} to stand still{friction}{since}. Take load off, another path, or a stronger joint.",
                reached=float(first),
            )


_UNBOUNDED_X = 1e12
