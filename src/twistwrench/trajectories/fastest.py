"""Fastest timing of a path under limits of torque, velocity and acceleration. Modern Robotics section 9.4.

Two passes find x(s) = ds². The backward pass finds the largest x from which the path can still end at rest. The forward
pass finds the largest x below that curve. Both follow the active limits in pieces (:mod:`.collocation`), so the
switching structure is computed. If the backward curve meets the limit curve, it follows that curve until the least
acceleration leads below it. These are the switching points of MR section 9.4: tangent, at corners, or at zero inertia.
Source: the passes are those of Pham & Pham, "A new approach to time-optimal path parameterization based on reachability
analysis", IEEE T-RO 34(3), 2018, without its grid.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ConstraintWarning, PathError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, percent, printed
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.algorithms.time_scalings import quintic
from ..mechanics.model.couplings import motor_torques
from ..mechanics.model.limits import Limits
from ..motion.bounds import bounds_of, velocities_inside
from ..robot.base import require_robot
from .collocation import TOLERANCE_AT_REST, Cell, FastestScaling, try_cell
from .jerk_limited import short_averages
from .limit_rows import PathRows
from .paths import JointPath, require_path
from .trajectory import Trajectory, fitted, positions_passed

if TYPE_CHECKING:
    from ..robot import Robot

_MIN_PIECE = 1e-9
"""Smallest length [of s] of a piece; shorter pieces do not make progress."""
_MAX_PIECES = 20_000
"""Maximum number of pieces of one pass."""
_MAX_LEAVING_PIECES = 20
"""Maximum number of pieces in one test for leaving the limit curve."""
_BREAK_OFFSET = 1e-5
"""Distance on both sides of breaks at which the test for leaving the limit curve is made."""
_SLOPE_STEP = 1e-7
"""Step [of s] over which slopes of the limit curve are compared with accelerations."""
_MIN_LEAVING_LENGTH = 1e-3
"""Step [of s] of the test for leaving the limit curve; within it a violation exceeds the tolerance."""
_TEST_POINTS = 2001
"""Number of points along the path at which limit curves and speeds are tested."""
_MANY_TEST_POINTS = 40_001
"""Number of these points in a second attempt."""
_ARC_POINTS = 9
"""Number of points of a piece that are compared with an arc."""
_MAX_RATIO_TO_ARC = 1 + 1e-10
"""Largest ratio of x to its arc at which it counts as below the arc."""
_MIN_RATIO_AT_ARC = 1 - 1e-8
"""Smallest ratio of x to an arc at which the arc is reached."""
_LENGTH_ACCURACY = 1e-11
"""Relative accuracy of the length at which the active limit changes."""
_PLACE_ACCURACY = 1e-13
"""Accuracy [of s] of a place at which the limit curve falls too fast."""
_MAX_BISECTIONS = 40
"""Maximum number of bisections for such a place."""
_MIN_LENGTH_DIFFERENCE = 1e-15
"""Smallest difference [of s] of two lengths."""
_HINT_RATIO = 4.0
"""Ratio of the first length that is tried to the length of the previous piece."""
_MIN_ROUGH_PIECE = 1e-5 * _MIN_PIECE
"""Smallest length [of s] of a piece if longer ones lack accuracy."""


@dataclass(frozen=True, eq=False)
class Arc:
    """Pieces of largest deceleration that lead to an anchor (the end, or a point of the limit curve), ascending in s."""

    cells: tuple[Cell, ...]

    @property
    def low(self) -> float:
        """Start of the arc."""
        return self.cells[0].low

    @property
    def high(self) -> float:
        """End of the arc."""
        return self.cells[-1].high

    def at(self, s: Array) -> Array:
        """x at s within the arc."""
        edges = np.array([cell.low for cell in self.cells[1:]])
        cell_indices = np.searchsorted(edges, s, side="right")
        x = np.zeros(len(s))
        for k in np.unique(cell_indices):
            in_cell = cell_indices == k
            x[in_cell] = self.cells[k].at(s[in_cell])
        return x


class _Stuck(Exception):
    """No piece of any size continues the curve."""


def _advance(
    rows: PathRows, s: float, x: float, way: int, target: float, *, caps: bool, below: Arc | None, hint: float = 1.0
) -> Cell:
    """Longest piece from (s, x) towards ``target``; ends exactly where the active limit changes.

    ``way`` is 1 or -1. ``caps`` allows pieces along a cap of x. The piece stays ``below`` an arc, if there is one. ``hint`` is
    the first length to try. Raises _Stuck if there is no piece.
    """

    def try_length(h: float) -> tuple[Cell | None, bool]:
        """Piece of length h, or None; and True if there is none for lack of accuracy only."""
        cell, lacks_accuracy = try_cell(rows, s, x, h, way, along_caps=caps)
        if cell is not None and below is not None:
            points = np.linspace(cell.low, cell.high, _ARC_POINTS)[1:]
            if (cell.at(points) > below.at(points) * _MAX_RATIO_TO_ARC).any():
                return None, False
        return cell, lacks_accuracy

    h = min(abs(target - s), hint)
    longest, lacks_accuracy = try_length(h)
    if longest is not None:
        return longest
    while longest is None:
        too_long = h
        too_long_lacks_accuracy = lacks_accuracy
        h *= 0.5
        min_length = _MIN_ROUGH_PIECE if lacks_accuracy else _MIN_PIECE
        if h < min_length:
            raise _Stuck
        longest, lacks_accuracy = try_length(h)
    if too_long_lacks_accuracy:  # then the active limit need not change between the two lengths
        return longest
    while too_long - h > _LENGTH_ACCURACY * too_long and too_long - h > _MIN_LENGTH_DIFFERENCE:  # bisection
        middle = 0.5 * (h + too_long)
        cell, lacks_accuracy = try_length(middle)
        if cell is not None:
            longest = cell
            h = middle
            continue
        too_long = middle
        if lacks_accuracy:
            break
    return longest


def backward(rows: PathRows, count: int = _TEST_POINTS) -> list[Arc]:
    """Arcs of the viability curve, ascending in s; between arcs the limit curve applies, tested at ``count`` points."""
    arcs: list[Arc] = []
    breaks = rows.breaks
    s = 1.0
    x = 0.0
    beside_breaks = np.concatenate([breaks - _BREAK_OFFSET, breaks + _BREAK_OFFSET])
    points = np.unique(np.concatenate([np.linspace(0.0, 1.0, count), beside_breaks]))
    points = points[(points > 0) & (points < 1)]
    is_beside_break = np.abs(points[:, None] - breaks).min(axis=1) <= 0.5 * _BREAK_OFFSET
    points = points[~is_beside_break]
    falls = points[_limit_curve_falls(rows, points)]
    while s > 0:
        cells: list[Cell] = []
        hint = 1.0
        try:
            while s > 0:
                target = float(breaks[np.searchsorted(breaks, s, side="left") - 1])
                cell = _advance(rows, s, x, -1, target, caps=False, below=None, hint=hint)
                hint = max(_HINT_RATIO * (cell.high - cell.low), _MIN_PIECE)
                cells.append(cell)
                s = cell.low
                x = float(cell.x[0])  # at the low end
                if len(cells) > _MAX_PIECES:
                    raise _search_error(s)
        except _Stuck:  # the arc begins here
            pass
        if cells:
            arcs.append(Arc(tuple(reversed(cells))))
        if s > 0:
            s = _next_leaving_point(rows, s, points, falls)
            x = float(rows.cap(np.array([s])).x[0])
    return arcs[::-1]


def _limit_curve_falls(rows: PathRows, s: Array) -> Array:
    """True if the limit curve just before s (m,) falls faster than x can by the least acceleration; False at breaks."""
    rows_before = rows.at(s - _SLOPE_STEP)
    x = rows.cap_of(rows.at(s)).x
    x_before = rows.cap_of(rows_before).x
    finite_x_before = np.where(np.isfinite(x_before), x_before, 0.0)
    least_acceleration, *_ = rows.accelerations(rows_before, finite_x_before)
    with np.errstate(invalid="ignore"):
        falls = 2.0 * least_acceleration * _SLOPE_STEP > (x - x_before)  # dx/ds = 2 u
    return np.isfinite(x) & np.isfinite(x_before) & falls


def _leaves(rows: PathRows, s: float) -> bool:
    """True if, backward from s, the least acceleration leads below the limit curve by a detectable step."""
    x = float(rows.cap(np.array([s])).x[0])
    if not np.isfinite(x):
        return False
    goal = max(s - _MIN_LEAVING_LENGTH, 0.0)
    for _ in range(_MAX_LEAVING_PIECES):
        previous = float(rows.breaks[np.searchsorted(rows.breaks, s, side="left") - 1])
        try:
            cell = _advance(rows, s, x, -1, max(goal, previous), caps=False, below=None)
        except _Stuck:
            return False
        s = cell.low
        x = float(cell.x[0])  # at the low end
        if s <= goal:
            return True
    return False


def _next_leaving_point(rows: PathRows, s: float, points: Array, falls: Array) -> float:
    """Next s below the given one at which the viability curve leaves the limit curve; 0 if there is none.

    ``falls`` are those ``points`` at which the limit curve falls too fast; the exact place is found by bisection.
    """
    edges = np.concatenate([points, rows.breaks, [s]])
    candidates = np.unique(np.concatenate([falls, rows.breaks]))
    candidates = candidates[(candidates < s - _MIN_PIECE) & (candidates > 0)]
    for candidate in candidates[::-1]:
        if candidate in rows.breaks:
            if _leaves(rows, float(candidate)):
                return float(candidate)
            continue
        falling = float(candidate)
        not_falling = float(edges[edges > candidate].min())
        for _ in range(_MAX_BISECTIONS):
            middle = 0.5 * (not_falling + falling)
            if not_falling - falling < _PLACE_ACCURACY:
                break
            (falls_at_middle,) = _limit_curve_falls(rows, np.array([middle]))
            if falls_at_middle:
                falling = middle
            else:
                not_falling = middle
        return falling
    return 0.0


def forward(rows: PathRows, arcs: list[Arc]) -> list[Cell]:
    """Pieces of the fastest timing, ascending in s."""
    ends_of_arcs = [[arc.low, arc.high] for arc in arcs]
    ends = np.unique(np.concatenate([rows.breaks, *ends_of_arcs]))
    cells: list[Cell] = []
    s = 0.0
    x = 0.0
    hint = 1.0
    while s < 1.0:
        if len(cells) > _MAX_PIECES:
            raise _search_error(s)
        arcs_at_s = (arc for arc in arcs if arc.low <= s < arc.high)
        arc = next(arcs_at_s, None)
        if arc is not None and s > 0 and _reaches(arc, s, x):
            remaining_cells = [cell for cell in arc.cells if cell.high > s + _MIN_LENGTH_DIFFERENCE]
            cells += [cell if cell.low >= s else cell.since(s) for cell in remaining_cells]
            s = arc.high
            x = float(cells[-1].x.sum())  # at the high end
            continue
        target = float(ends[np.searchsorted(ends, s, side="right")])
        try:
            cell = _advance(rows, s, x, 1, target, caps=True, below=arc, hint=hint)
        except _Stuck:
            raise _search_error(s) from None
        cells.append(cell)
        hint = max(_HINT_RATIO * (cell.high - cell.low), _MIN_PIECE)
        s = cell.high
        x = float(cell.x.sum())  # at the high end
    return cells


def _reaches(arc: Arc, s: float, x: float) -> bool:
    """True if x at s reaches an arc."""
    (x_of_arc,) = arc.at(np.array([s])).tolist()
    return bool(x >= x_of_arc * _MIN_RATIO_AT_ARC)


def _search_error(s: float) -> PathError:
    """Error for a search that cannot go on beyond s."""
    return PathError(
        f"no fastest timing was found beyond s = {printed(s)}: the search failed to follow the limits there. A path "
        "with fewer corners, or more similar limits of the joints, may help; a trapezoidal scaling always exists.",
        reached=s,
    )


# ── Fastest timing of a path. Modern Robotics section 9.4

_MIN_SPEED_UP_LENGTH = 1e-6
"""Shortest share of the path to speed up to the velocity limits; torque and acceleration limits that allow less are reduced."""
_MARGIN = 4e-8
"""Distance kept from each limit, as a share of the limit, which covers the deviations of the pieces in both passes."""
_KINDS = ("velocity", "acceleration", "deceleration", "effort", "jerk")
"""Kinds of limits from which the margin is kept."""
_MIN_SPEED_RATIO = 1e-7
"""Ratio of the least |dq/ds| to the largest below which a path stands still."""


@dataclass(frozen=True)
class LimitContact:
    """Part of a fastest motion with its active limit."""

    begin: float
    """Time at the start [s]."""
    end: float
    """Time at the end [s]."""
    joint: str
    """Name of the joint."""
    kind: str
    """``torque``, ``velocity`` or ``acceleration``."""
    side: int
    """+1 if at the upper limit, -1 at the lower."""
    s: float
    """Path position at the start."""


@dataclass(frozen=True, eq=False)
class LimitCurves:
    """Upper bounds of the rate ds/dt along the path for every admissible motion."""

    s: Array
    """(n,)."""
    torque: Array
    """(n,) 1/s: rate at which torques and accelerations leave a single path acceleration; inf if there is none."""
    velocity: Array
    """(n,) 1/s: rate at which a joint reaches its velocity limit."""
    path: tuple[Array, Array]
    """s and ds/dt of the fastest timing."""
    switches: tuple[Array, Array]
    """s and ds/dt where the active limit changes."""


@dataclass(frozen=True, eq=False)
class Fastest(Trajectory):
    """Time-optimal motion along a path, with its active limits."""

    bounds: Limits
    """Limits of the motion."""
    rows: PathRows
    """The limits as rows along the path."""
    arcs: tuple[Arc, ...]
    """Arcs in the phase plane that make up the timing (with jerk limits: the time-optimal one)."""
    time_optimal: Fastest | None = None
    """Motion without jerk limits from which this one was made; None if jerk is not limited."""

    @property
    def slower(self) -> float:
        """Relative increase of the duration by jerk limits; 0 if jerk is not limited."""
        if self.time_optimal is None:
            return 0.0
        return self.duration / self.time_optimal.duration - 1.0

    @property
    def price_of_jerk(self) -> str:
        """Sentence on the time that jerk limits cost."""
        return f"{percent(self.slower)} slower than without jerk limits; not proven shortest"

    @property
    def limit_contacts(self) -> tuple[LimitContact, ...]:
        """Active limits along the motion, in order, without gaps. Empty with jerk limits."""
        if self.time_optimal is not None:
            return ()
        model = self.robot.model
        times = self.scaling.times  # type: ignore[attr-defined]
        cells = self.scaling.cells  # type: ignore[attr-defined]
        contacts: list[LimitContact] = []
        for k, cell in enumerate(cells):
            side = cell.side
            kind = cell.active.kind
            j = cell.active.joint
            names = model.drive_labels if kind == "torque" else model.velocity_names
            middle = np.array([0.5 * (cell.low + cell.high)])
            _, dq_ds, _ = self.path(middle)
            direction = int(np.sign(dq_ds[0, j]))
            if kind == "velocity":
                side = direction
            elif kind == "acceleration" and self.bounds.acceleration[j] != self.bounds.deceleration[j]:
                side *= direction  # such limits hold for speeding up and slowing down, whatever the direction
            contact = LimitContact(float(times[k]), float(times[k + 1]), names[j], kind, side, cell.low)
            previous = contacts[-1] if contacts else None
            if previous is not None and (previous.joint, previous.kind, previous.side) == (contact.joint, kind, side):
                contacts[-1] = replace(previous, end=contact.end)
            else:
                contacts.append(contact)
        return tuple(contacts)

    def shares(self, t: ArrayLike) -> Array:
        """Share of the most used limit: at most 1, and 1 if a limit is active. With jerk limits it may stay below 1.

        Returns
        -------
        shares : (...) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> quick = fastest(arm, tw.trajectories.joint_line(arm, [0, 0], [1, 1]), effort=[60, 30])
        >>> t = np.linspace(0, quick.duration, 5)[1:-1]
        >>> bool(abs(quick.shares(t) - 1).max() < 1e-6)
        True
        """
        q, dq, ddq = self(t)
        bounds = self.bounds
        dq = velocities_inside(np.asarray(t), dq, ddq, 0.0, self.duration)
        tau = self.robot.inverse_dynamics(q, dq, ddq, friction=self.friction)
        tau = motor_torques(self.robot.model, tau)
        parts = [tau / bounds.effort, dq / bounds.velocity, ddq / bounds.acceleration_at(dq, ddq)]
        if self.time_optimal is not None:
            parts.append(self.jerk(t) / bounds.jerk)
        all_shares = np.abs(np.concatenate(parts, axis=-1))
        return np.asarray(all_shares.max(axis=-1))

    def limit_curves(self, samples: int = 801) -> LimitCurves:
        """Limit curves of the phase plane (s, ds/dt), with the motion. MR figure 9.11.

        Parameters
        ----------
        samples : int, places along the path

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> quick = fastest(arm, tw.trajectories.joint_line(arm, [0, 0], [1, 1]), effort=[60, 30])
        >>> quick.limit_curves(101).torque.shape
        (101,)
        """
        s = np.unique(np.concatenate([np.linspace(0, 1, samples), self.rows.breaks]))
        cap = self.rows.cap(s)
        if self.time_optimal is not None:
            times = np.linspace(0.0, self.duration, samples)
            path_s, path_rate, *_ = self.scaling(times)
            no_switches = (np.zeros(0), np.zeros(0))
            return LimitCurves(s, np.sqrt(cap.torque), np.sqrt(cap.velocity), (path_s, path_rate), no_switches)
        cells = self.scaling.cells  # type: ignore[attr-defined]
        z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 16))  # denser at the ends (square-root behaviour)
        points = [cell.low + (cell.high - cell.low) * z for cell in cells]
        squared_rates = np.concatenate([cell.at(s_of_cell) for cell, s_of_cell in zip(cells, points, strict=True)])
        path_s = np.concatenate(points)
        path_rate = np.sqrt(np.maximum(squared_rates, 0.0))
        switch_s = np.array([contact.s for contact in self.limit_contacts[1:]])
        switches = (switch_s, np.interp(switch_s, path_s, path_rate))
        return LimitCurves(s, np.sqrt(cap.torque), np.sqrt(cap.velocity), (path_s, path_rate), switches)

    def __str__(self) -> str:
        own_kinds = []
        for kind in ("acceleration", "jerk"):
            robot_limits = getattr(self.robot.limits, kind)
            if np.isfinite(robot_limits).any() and np.array_equal(robot_limits, getattr(self.bounds, kind)):
                own_kinds.append(kind)
        contacts = self.limit_contacts
        active_limits = ", ".join(dict.fromkeys(f"{contact.joint} ({contact.kind})" for contact in contacts))
        limits_text = f"limited by {active_limits} in {len(contacts)} parts"
        if self.time_optimal is not None:
            limits_text = self.price_of_jerk
        own_limits_text = f"; limits of {' and '.join(own_kinds)} are the robot's own" if own_kinds else ""
        return f"{number(self.duration, 6)} s, {limits_text}{own_limits_text}"


def fastest(
    robot: Robot,
    path: JointPath,
    *,
    effort: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    deceleration: ArrayLike | None = None,
    jerk: ArrayLike | None = None,
    friction: bool = False,
) -> Fastest:
    """Time-optimal time scaling: shortest motion along a path from rest to rest within the limits.

    With jerk limits, a short motion: the time-optimal motion averaged over time, on the same path, not proven shortest.

    Parameters
    ----------
    path : JointPath
    effort : (nv,) array_like, optional, torque limits that replace the robot's own [N m, sliding joints: N]
    velocity : (nv,) array_like, optional, velocity limits that replace the robot's own [rad/s, m/s]
    acceleration : (nv,) array_like, optional, acceleration limits that replace the robot's own; without
        ``deceleration`` they also apply to joints that slow down [rad/s², m/s²]
    deceleration : (nv,) array_like, optional, limits for joints that slow down, instead of the robot's [rad/s², m/s²]
    jerk : (nv,) array_like or float, optional, jerk limits that replace the robot's own, inf: none [rad/s³, m/s³]

    Raises
    ------
    PathError
        The robot cannot hold itself on the path; the message names s, joint and amount.
    ValueRangeError
        No limit applies to the motion, or the path is stationary somewhere.

    Warns
    -----
    ConstraintWarning
        The path violates position limits; the warning names the joints, and ``violations`` lists all.

    Notes
    -----
    MR section 9.4, by two passes. One limit is active at all times and none is exceeded, to 1e-6 of it. Torque and
    acceleration limits count as lower if they bring the robot to its velocity limit within a millionth of the path.

    Jerk limits make the problem non-convex (H. Pham & Q.-C. Pham, "Time-optimal path tracking with jerk constraints",
    ICRA 2017). Averaging s(t) over two time windows keeps the path, bounds the jerk and makes it continuous. Windows
    and rates are optimised, see ``jerk_limited.py``; the duration is then the shortest that keeps all limits.

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench import trajectories
    >>> mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    >>> quick = fastest(mass, trajectories.joint_line(mass, [0], [2.0]), effort=8.0)
    >>> round(quick.duration, 6)  # 2 sqrt(d / a), with 1 kg at 1 m
    1.0
    >>> print(fastest(mass, trajectories.joint_line(mass, [0], [2.0]), effort=8.0, jerk=100.0))
    1.08... s, 9 % slower than without jerk limits; not proven shortest
    """
    require_path(path, "fastest")
    friction = arguments.flag(friction, "friction")
    bounds = bounds_of(
        require_robot(robot, "fastest"), velocity=velocity, acceleration=acceleration, effort=effort,
        deceleration=deceleration, jerk=jerk,
    )  # fmt: skip
    if robot.nv == 0:
        raise ValueRangeError(f"robot {robot.name!r} has no joint that moves. Lock fewer joints.")
    s = np.linspace(0.0, 1.0, _TEST_POINTS)
    q, dq_ds, _ = path(s)
    path_speeds = np.abs(dq_ds).max(axis=-1)  # of the fastest joint
    slowest = int(path_speeds.argmin())
    if path_speeds[slowest] < _MIN_SPEED_RATIO * path_speeds.max():
        raise ValueRangeError(
            f"the path stands still at s = {number(s[slowest])}, so that ds/dt does not determine the joint "
            "velocities there. Use a path with non-zero dq/ds: a spline without times, or each part separately."
        )
    margin = _MARGIN
    if friction and np.any(robot.model.friction.viscous):
        margin += TOLERANCE_AT_REST
    reduced_limits = {kind: getattr(bounds, kind) * (1.0 - margin) for kind in _KINDS}
    reduced_bounds = replace(bounds, **reduced_limits)
    quick = _time_optimal(robot, path, bounds, reduced_bounds, friction=friction)
    violations = [
        f"{v.joint} reaches {number(v.value, 5)} beyond {number(v.limit, 5)} at s = {number(v.time)}"
        for v in positions_passed(robot, s, q, bounds)
    ]
    if violations:
        warnings.warn(
            f"the path exceeds position limits of {robot.name!r}: {listed(violations, 4, '; ')}. This does not depend on the "
            "timing: choose another path.",
            ConstraintWarning,
            stacklevel=2,
        )
    if np.isinf(bounds.jerk).all():
        return quick
    path_s, path_rate = quick.limit_curves().path
    averages = short_averages(robot, path, path_s, path_rate, reduced_bounds, friction=friction)
    scalings = [fitted(robot, path, shape, reduced_bounds, friction=friction) for shape in (quintic(1.0), *averages)]
    shortest = min(scalings, key=lambda scaling: scaling.duration)
    return replace(quick, scaling=shortest, bounds=bounds, time_optimal=quick)


def _time_optimal(robot: Robot, path: JointPath, bounds: Limits, reduced_bounds: Limits, *, friction: bool) -> Fastest:
    """Fastest motion within all limits except jerk; ``reduced_bounds`` keep a small margin from ``bounds``."""
    rows = PathRows(robot, path, reduced_bounds, friction=friction)
    reachable_limits = _reachable(rows)
    if reachable_limits is not rows.bounds:
        rows = PathRows(robot, path, reachable_limits, friction=friction)
    if rows.flat.all():
        raise ValueRangeError(
            f"nothing limits how fast {robot.name!r} speeds up on this path: give effort or acceleration "
            "limits of joints that move."
        )
    rows.require_standing()
    try:
        arcs = backward(rows)
        cells = forward(rows, arcs)
    except PathError:  # a narrow feature of the limit curve was missed
        arcs = backward(rows, _MANY_TEST_POINTS)
        cells = forward(rows, arcs)
    bounds_without_jerk = replace(bounds, jerk=np.full(robot.nv, np.inf))
    scaling = FastestScaling(tuple(cells))
    return Fastest(robot, path, scaling, bounds_without_jerk, rows, tuple(arcs), friction=friction)


def _reachable(rows: PathRows) -> Limits:
    """Limits, with torque and acceleration reduced to what a motion within the velocity limits can reach."""
    grid_rows = rows.at(rows.grid)
    bounds = rows.bounds
    velocity_caps = grid_rows.cap[:, : len(rows.fast)]  # of x, by the velocity limits
    max_x = velocity_caps.min(axis=1, initial=np.inf).max()
    if not np.isfinite(max_x):
        return bounds
    max_u = max_x / (2.0 * _MIN_SPEED_UP_LENGTH)  # x = 2 u s from rest
    a, b, c, d = (np.abs(terms) for terms in (grid_rows.a, grid_rows.b, grid_rows.c, grid_rows.d))
    largest_values = 2.0 * (a * max_u + b * max_x + d * np.sqrt(max_x) + c).max(axis=0)
    if (largest_values >= rows.L).all():
        return bounds
    n = len(rows.torque)  # rows of torques come first, then those of accelerations
    effort = bounds.effort.copy()
    effort[rows.torque] = np.minimum(rows.L, largest_values)[:n]
    acceleration = bounds.acceleration.copy()
    deceleration = bounds.deceleration.copy()
    for limit in (acceleration, deceleration):
        limit[rows.accelerated] = np.minimum(limit[rows.accelerated], largest_values[n:])
    return replace(bounds, effort=effort, acceleration=acceleration, deceleration=deceleration)


complete(globals())
