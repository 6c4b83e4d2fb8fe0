"""Robot limits along a path, as bounds of the path parameter's acceleration and squared rate.

With x = ds² and u = dds every limit has the form

    |a(s) u + b(s) x + d(s) √x + c(s)| ≤ L    or    x ≤ cap(s).

For torques, by MR eq. 9.34, a = M q', b = M q'' + h(q, q') with the Coriolis terms h, and c = g. Viscous friction is d,
and Coulomb friction is added to c. For accelerations a = q' and b = q''. If the limit of deceleration D differs from that
of acceleration A, then -D ≤ sign(q') ddq ≤ A becomes

    |sign(q') ddq + (D - A)/2| ≤ (D + A)/2.
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
"""Ratio of a to the largest a below which a is a rounding error, so that the row bounds x only."""
_NUDGE = 1e-13
"""Distance in s by which the ends of a piece are moved inside: limits from the left and from the right may differ there."""
_SIDE_DISTANCE = 1e-12
"""Distance in s of the points on both sides at which one-sided limits are evaluated."""
_GRID_INTERVALS = 400
"""Number of intervals of the grid on which sign changes are searched."""
_MIN_BREAK_DISTANCE = 1e-11
"""Distance in s of two breaks below which they are one."""
_MAX_SEARCH_STEPS = 200
"""Largest number of steps in the search for the largest x."""
_MAX_SEARCH_CHANGE = 1e-15
"""Relative change of x at which the search ends."""
_MAX_ZEROS_ON_GRID = 20
"""Number of zeros at grid points from which f is zero on an interval: f does not change its sign there."""
_ZERO_RATIO = 1e-13
"""Ratio of f to its largest value below which f is zero at a grid point."""
_BISECTION_STEPS = 52
"""Number of bisections that reach the last bit of a number."""
_MAX_STANDING_SHARE = 1 - 1e-6
"""Share of a limit from which standing still is impossible."""
_UNBOUNDED_X = 1e12
"""Value of x [1/s²] that counts as unbounded."""
_MIN_UNBOUNDED_X = 0.999 * _UNBOUNDED_X  # with a margin for the search


@dataclass(frozen=True)
class Row:
    """Quantity with a limit: a torque, acceleration or velocity."""

    kind: str
    """``torque``, ``acceleration`` or ``velocity``."""
    joint: int
    """Index of the entry of dq."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Coefficients of k limit rows at points (m,) of the path."""

    a: Array
    """Coefficients (m, k) of u."""
    b: Array
    """Coefficients (m, k) of x."""
    c: Array
    """Constant terms (m, k)."""
    d: Array
    """Coefficients (m, k) of √x."""
    cap: Array
    """Upper bounds of x (m, l): first by the velocities, then by rows whose a is zero; inf for no bound."""

    def values(self, u: Array, x: Array) -> Array:
        """a u + b x + d √x + c; (..., m), (..., m) → (..., m, k)."""
        u = u[..., None]  # (..., m, 1)
        x = x[..., None]
        root = np.sqrt(np.maximum(x, 0.0))
        return self.a * u + self.b * x + self.c + self.d * root


@dataclass(frozen=True, eq=False)
class Cap:
    """Largest x at points of the path: the limits leave a single acceleration there, or a velocity is at its limit."""

    x: Array
    """(m,), inf if unbounded."""
    velocity: Array
    """Largest x (m,) by limits of velocities alone."""
    torque: Array
    """Largest x (m,) by limits of torques and accelerations alone."""


class PathRows:
    """Limit rows of one robot, path and set of limits, at any path position."""

    def __init__(self, robot: Robot, path: JointPath, bounds: Limits, *, friction: bool = False) -> None:
        self.robot = robot
        self.path = path
        self.friction = friction
        self.bounds = bounds
        law = robot.model.friction
        is_supported = not np.any(law.load) and not np.any(law.static != law.coulomb)
        if friction and not is_supported:
            raise ValueRangeError(
                f"friction of {robot.name!r} depends on the load or has static or Stribeck parts, but fastest timing supports "
                f"only viscous and Coulomb friction. Leave friction out ({spell(Argument('friction', False))}) and lower the "
                "effort limits by the friction torques."
            )
        self.torque = np.flatnonzero(np.isfinite(bounds.effort))
        """Entries of dq with a limit of torque."""
        self.accelerated = np.flatnonzero(np.isfinite(bounds.acceleration))
        """Entries of dq with a limit of acceleration."""
        self.fast = np.flatnonzero(np.isfinite(bounds.velocity))
        """Entries of dq with a limit of velocity."""
        A = bounds.acceleration[self.accelerated]
        D = bounds.deceleration[self.accelerated]
        self._offset = 0.5 * (D - A)  # of each row of accelerations
        self.L = np.concatenate([bounds.effort[self.torque], 0.5 * (D + A)])
        """Limits (k,) of the rows."""
        self.rows = [Row("torque", int(j)) for j in self.torque]
        self.rows += [Row("acceleration", int(j)) for j in self.accelerated]
        self.flat = np.zeros(len(self.rows), bool)  # first none, for the evaluation of a in the next line
        """Mask (k,) of flat rows: a is zero everywhere."""
        sizes_of_a = np.abs(self.at(self.grid).a)
        self.flat = sizes_of_a.max(axis=0, initial=0.0) <= _FLAT_RATIO * sizes_of_a.max(initial=0.0)
        self.caps = [Row("velocity", int(j)) for j in self.fast]
        """Quantities (l,) whose limits are upper bounds of x."""
        self.caps += compress(self.rows, self.flat)

    @cached_property
    def grid(self) -> Array:
        """Points from 0 to 1, dense enough to resolve every sign change; includes knots of the path."""
        even_points = np.linspace(0.0, 1.0, _GRID_INTERVALS + 1)
        return np.unique(np.concatenate([even_points, self.path.knots]))

    def at(self, s: Array, low: float = 0.0, high: float = 1.0) -> Rows:
        """Rows at s (m,); at the ends of a piece [low, high] the values from inside it."""
        nudge = _NUDGE * max(1.0, high)
        nudge = min(nudge, 0.1 * (high - low))  # a tenth of a very short piece
        s = np.clip(s, low + nudge, high - nudge)
        q, q1, q2 = self.path(s)  # with the derivatives q' and q'' by s
        zero = np.zeros_like(q1)
        # Torques at rest, g; at the acceleration q', g + M q'; and at the velocity q' and acceleration q'', g + M q'' + h.
        velocities = np.concatenate([zero, zero, q1])
        accelerations = np.concatenate([zero, q1, q2])
        torques = self.robot.inverse_dynamics(np.concatenate([q, q, q]), velocities, accelerations)
        torques = motor_torques(self.robot.model, torques)
        at_rest, at_acceleration, in_motion = np.split(torques, 3)
        a = at_acceleration - at_rest
        b = in_motion - at_rest
        c = at_rest
        d = zero
        if self.friction:
            law = self.robot.model.friction
            motor_q1 = motor_velocities(self.robot.model, q1)
            c = c + law.coulomb * np.sign(motor_q1)
            d = law.viscous * motor_q1
        j = self.torque  # indices of entries of dq, as k
        k = self.accelerated
        sign = np.where(self._offset != 0, np.sign(q1[:, k]), 1.0)
        a = np.concatenate([a[:, j], sign * q1[:, k]], axis=1)
        b = np.concatenate([b[:, j], sign * q2[:, k]], axis=1)
        c = np.concatenate([c[:, j], np.broadcast_to(self._offset, sign.shape)], axis=1)
        d = np.concatenate([d[:, j], np.zeros_like(sign)], axis=1)
        flat = self.flat
        with np.errstate(divide="ignore", invalid="ignore"):
            max_rates = self.bounds.velocity[self.fast] / np.abs(q1[:, self.fast])
            caps = [max_rates**2]
            if flat.any():  # |b x + c| ≤ L
                a = np.where(flat, 0.0, a)
                flat_b, flat_c, flat_L = b[:, flat], c[:, flat], self.L[flat]
                max_bx = np.where(flat_b > 0, flat_L - flat_c, flat_L + flat_c)
                max_x = max_bx / np.abs(flat_b)
                caps.append(np.where(flat_b == 0, np.inf, max_x))
        return Rows(a, b, c, d, np.concatenate(caps, axis=1))

    @cached_property
    def breaks(self) -> Array:
        """Ends of pieces from 0 to 1: knots, zeros of each a, and zeros of q' if a limit depends on its sign."""
        points = [np.array([0.0, 1.0]), self.path.knots]
        points += self._column_zeros(lambda s: self.at(s).a, np.flatnonzero(~self.flat))
        points += self._column_zeros(self._path_slopes, self.accelerated[self._offset != 0])
        if self.friction:
            points += self._column_zeros(self._drive_velocities, range(self.robot.nv))
        breaks = np.unique(np.concatenate(points))
        is_separate = np.concatenate([[True], np.diff(breaks) > _MIN_BREAK_DISTANCE])
        is_separate[-1] = True  # the end of the path
        return breaks[is_separate]

    def _path_slopes(self, s: Array) -> Array:
        """q' at s (m,); (m, nv)."""
        _, q1, _ = self.path(s)
        return np.asarray(q1)

    def _drive_velocities(self, s: Array) -> Array:
        """Velocities of the drives at s (m,) for ds/dt = 1; (m, nv)."""
        return np.asarray(motor_velocities(self.robot.model, self._path_slopes(s)))

    def _column_zeros(self, f: Callable[[Array], Array], columns: Iterable[int]) -> Iterator[Array]:
        """For each of these columns of f: its zeros (z,). f is a function of s (m,) with values (m, n)."""
        values = f(self.grid)
        for k in columns:
            yield self._zeros(values[:, k], lambda s, k=k: f(s)[:, k])

    def _zeros(self, values: Array, f: Any) -> Array:
        """Zeros (z,) of f, given its values at the points of the grid; all sign changes are bisected at once."""
        scale = np.abs(values).max(initial=0.0)
        is_rounding_error = np.abs(values) <= _ZERO_RATIO * scale
        sign = np.sign(np.where(is_rounding_error, 0.0, values))
        zeros_on_grid = np.zeros(0)
        if scale > 0 and np.count_nonzero(sign == 0) < _MAX_ZEROS_ON_GRID:
            zeros_on_grid = self.grid[sign == 0]
        k = np.flatnonzero(sign[:-1] * sign[1:] < 0)  # intervals of the grid
        if not len(k):
            return zeros_on_grid
        low = self.grid[k]
        high = self.grid[k + 1]
        for _ in range(_BISECTION_STEPS):
            middle = 0.5 * (low + high)
            in_upper_half = np.sign(f(middle)) == sign[k]
            low = np.where(in_upper_half, middle, low)
            high = np.where(in_upper_half, high, middle)
        return np.concatenate([zeros_on_grid, 0.5 * (low + high)])

    def cap(self, s: Array) -> Cap:
        """Largest x at s (m,), the smaller one of both sides. MR figure 9.11: the velocity limit curve."""
        left_s = np.clip(s - _SIDE_DISTANCE, 0.0, 1.0)
        right_s = np.clip(s + _SIDE_DISTANCE, 0.0, 1.0)
        left = self.cap_of(self.at(left_s))
        right = self.cap_of(self.at(right_s))
        return Cap(
            np.minimum(left.x, right.x),
            np.minimum(left.velocity, right.velocity),
            np.minimum(left.torque, right.torque),
        )

    def cap_of(self, rows: Rows) -> Cap:
        """Cap at points with known rows."""
        velocity_caps, flat_caps = np.split(rows.cap, [len(self.fast)], axis=1)
        by_velocity = velocity_caps.min(axis=1, initial=np.inf)
        by_flat_rows = flat_caps.min(axis=1, initial=np.inf)
        by_all_caps = rows.cap.min(axis=1, initial=np.inf)
        by_torque = self._largest_feasible_x(rows, np.minimum(by_flat_rows, _UNBOUNDED_X))
        return Cap(np.minimum(by_all_caps, by_torque), by_velocity, by_torque)

    def _largest_feasible_x(self, rows: Rows, max_x: Array) -> Array:
        """Largest x (m,) up to ``max_x`` at which the least u is not above the largest: α ≤ β.

        Newton's method from the right on β - α, which is concave, takes few steps. With viscous friction the curves bend,
        so a step out of the bracket is replaced by a bisection.
        """
        x = max_x
        feasible = np.zeros_like(x)
        infeasible = x.copy()
        for _ in range(_MAX_SEARCH_STEPS):
            alpha, beta, alpha_slope, beta_slope = self.accelerations(rows, x)
            gap = beta - alpha
            slope = beta_slope - alpha_slope
            is_done = (x >= max_x) & (gap >= 0)
            feasible = np.where(gap >= 0, x, feasible)
            infeasible = np.where(gap < 0, x, infeasible)
            with np.errstate(all="ignore"):
                newton_x = x - np.where(slope < 0, gap / slope, np.nan)
            in_bracket = (newton_x >= feasible) & (newton_x <= infeasible)  # False for NaN
            next_x = np.where(in_bracket, newton_x, 0.5 * (feasible + infeasible))
            next_x = np.where(is_done, x, next_x)
            change = np.abs(next_x - x)
            x = next_x
            if (change <= _MAX_SEARCH_CHANGE * x).all():
                break
        return np.where(x >= _MIN_UNBOUNDED_X, np.inf, x)

    def accelerations(self, rows: Rows, x: Array) -> tuple[Array, Array, Array, Array]:
        """Least u α and largest u β at x (m,), and their slopes with respect to x; (m,) each.

        From |a u + v| ≤ L with v = b x + d √x + c: u lies between (-L - sign(a) v) / |a| and (L - sign(a) v) / |a|.
        """
        steep = ~self.flat
        if not steep.any():
            unbounded = np.full(len(x), np.inf)
            no_slope = np.zeros(len(x))
            return -unbounded, unbounded, no_slope, no_slope
        a, b, c, d = rows.a[:, steep], rows.b[:, steep], rows.c[:, steep], rows.d[:, steep]
        L = self.L[steep]
        root = np.sqrt(np.maximum(x, 1e-300))[:, None]  # not 0, since it divides below
        v = b * x[:, None] + d * root + c
        minus_v_slope = -(b + 0.5 * d / root)
        size_of_a = np.where(a == 0, np.nan, np.abs(a))
        is_free = np.isnan(size_of_a)  # such a row does not bound u
        sign = np.sign(a)
        with np.errstate(all="ignore"):
            largest_u = np.where(is_free, np.inf, (L - sign * v) / size_of_a)
            least_u = np.where(is_free, -np.inf, (-L - sign * v) / size_of_a)
            slope = np.where(is_free, 0.0, sign * minus_v_slope / size_of_a)
        points = np.arange(len(x))
        i = least_u.argmax(axis=1)  # row that bounds u from below, at each point
        j = largest_u.argmin(axis=1)  # row that bounds u from above
        return least_u[points, i], largest_u[points, j], slope[points, i], slope[points, j]

    def require_standing(self) -> None:
        """Raise PathError if the robot cannot stand still at some point of the path; it may then be unable to follow it."""
        after_breaks = np.clip(self.breaks + _SIDE_DISTANCE, 0, 1)
        before_breaks = np.clip(self.breaks - _SIDE_DISTANCE, 0, 1)
        s = np.unique(np.concatenate([self.grid, after_breaks, before_breaks]))
        standing = np.abs(self.at(s).c)  # torques or accelerations (m, k) at u = x = 0
        share = np.divide(standing, self.L, out=np.zeros_like(standing), where=self.L > 0)
        share[(self.L == 0) & (standing > 0)] = np.inf
        if not share.size or share.max() < _MAX_STANDING_SHARE:
            return
        i, k = np.unravel_index(int(share.argmax()), share.shape)
        is_impossible = (share >= _MAX_STANDING_SHARE).any(axis=1)
        first_s = s[is_impossible.argmax()]  # at the first True
        row = self.rows[k]
        model = self.robot.model
        names = model.drive_labels if row.kind == "torque" else model.velocity_names
        friction = " against friction" if self.friction else ""
        start = f" (too much from s = {printed(first_s, 4)})" if first_s < s[i] else ""
        raise PathError(
            f"the robot cannot hold itself on this path: at s = {printed(s[i], 4)} {names[row.joint]!r} needs "
            f"{printed(standing[i, k], 4)} of {printed(self.L[k], 4)} to stand still{friction}{start}. Take load off, another "
            "path, or a stronger joint.",
            reached=float(first_s),  # s up to which the robot can stand
        )
