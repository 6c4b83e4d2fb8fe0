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
from .collocation import AT_REST, Cell, FastestScaling, try_cell
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
_STEP = 1e-7
"""Step [of s] over which slopes of the limit curve are compared with accelerations."""
_SCAN = 1e-3
"""Step [of s] of the test for leaving the limit curve; within it a violation exceeds the tolerance."""


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
        edges = np.array([c.low for c in self.cells[1:]])
        k = np.searchsorted(edges, s, side="right")
        out = np.zeros(len(s))
        for i in np.unique(k):
            out[k == i] = self.cells[i].at(s[k == i])
        return out


class _Stuck(Exception):
    """No piece of any size continues the curve."""


def _advance(
    rows: PathRows, s: float, x: float, way: int, target: float, *, caps: bool, below: Arc | None, hint: float = 1.0
) -> Cell:
    """Longest piece from (s, x) towards ``target``; ends exactly where the active limit changes."""

    def try_length(h: float) -> tuple[Cell | None, bool]:
        cell, rough = try_cell(rows, s, x, h, way, along_caps=caps)
        if cell is not None and below is not None:
            points = np.linspace(cell.low, cell.high, 9)[1:]
            if (cell.at(points) > below.at(points) * (1 + 1e-10)).any():
                return None, False
        return cell, rough

    h = min(abs(target - s), hint)
    longest, rough = try_length(h)
    if longest is not None:
        return longest
    while longest is None:
        too_long, was_rough = h, rough
        h *= 0.5
        if h < _MIN_PIECE and (h < 1e-5 * _MIN_PIECE or not rough):
            raise _Stuck
        longest, rough = try_length(h)
    if was_rough:
        return longest
    while too_long - h > 1e-11 * too_long and too_long - h > 1e-15:  # locate the change of the active limit
        middle = 0.5 * (h + too_long)
        cell, rough = try_length(middle)
        if cell is None:
            too_long = middle
            if rough:
                break
        else:
            longest, h = cell, middle
    return longest


def backward(rows: PathRows, count: int = 2001) -> list[Arc]:
    """Arcs of the viability curve, ascending in s; between arcs the limit curve applies, tested at ``count`` points."""
    arcs: list[Arc] = []
    breaks = rows.breaks
    s, x = 1.0, 0.0
    beside_breaks = np.concatenate([breaks - _BREAK_OFFSET, breaks + _BREAK_OFFSET])
    points = np.unique(np.concatenate([np.linspace(0.0, 1.0, count), beside_breaks]))
    points = points[(points > 0) & (points < 1)]
    points = points[np.abs(points[:, None] - breaks).min(axis=1) > 0.5 * _BREAK_OFFSET]
    falls = points[_falls_away(rows, points)]
    while s > 0:
        cells: list[Cell] = []
        hint = 1.0
        try:
            while s > 0:
                target = float(breaks[np.searchsorted(breaks, s, side="left") - 1])
                cell = _advance(rows, s, x, -1, target, caps=False, below=None, hint=hint)
                hint = max(4.0 * (cell.high - cell.low), _MIN_PIECE)
                cells.append(cell)
                s, x = cell.low, float(cell.x[0])
                if len(cells) > _MAX_PIECES:
                    raise _search_error(s)
        except _Stuck:
            pass
        if cells:
            arcs.append(Arc(tuple(reversed(cells))))
        if s > 0:
            s = _leaving(rows, s, points, falls)
            x = float(rows.cap(np.array([s])).x[0])
    return arcs[::-1]


def _falls_away(rows: PathRows, s: Array) -> Array:
    """True if the limit curve just before s (m,) is steeper than the least acceleration there; False at breaks."""
    before = rows.at(s - _STEP)
    x = np.stack([rows.cap_of(rows.at(s)).x, rows.cap_of(before).x])
    low = rows.accelerations(before, np.where(np.isfinite(x[1]), x[1], 0.0))[0]
    with np.errstate(invalid="ignore"):
        return np.isfinite(x).all(axis=0) & (2.0 * low * _STEP > (x[0] - x[1]))


def _leaves(rows: PathRows, s: float) -> bool:
    """True if, backward from s, the least acceleration leads below the limit curve by a detectable step."""
    x = float(rows.cap(np.array([s])).x[0])
    if not np.isfinite(x):
        return False
    goal = max(s - _SCAN, 0.0)
    for _ in range(_MAX_LEAVING_PIECES):
        previous = float(rows.breaks[np.searchsorted(rows.breaks, s, side="left") - 1])
        try:
            cell = _advance(rows, s, x, -1, max(goal, previous), caps=False, below=None)
        except _Stuck:
            return False
        s, x = cell.low, float(cell.x[0])
        if s <= goal:
            return True
    return False


def _leaving(rows: PathRows, s: float, points: Array, falls: Array) -> float:
    """First s below the given one at which the viability curve leaves the limit curve; 0 if there is none."""
    edges = np.concatenate([points, rows.breaks, [s]])
    candidates = np.unique(np.concatenate([falls, rows.breaks]))
    for candidate in candidates[(candidates < s - _MIN_PIECE) & (candidates > 0)][::-1]:
        if candidate in rows.breaks:
            if _leaves(rows, float(candidate)):
                return float(candidate)
            continue
        goes, stays = float(candidate), float(edges[edges > candidate].min())
        for _ in range(40):
            middle = 0.5 * (stays + goes)
            if stays - goes < 1e-13:
                break
            stays, goes = (stays, middle) if _falls_away(rows, np.array([middle]))[0] else (middle, goes)
        return goes
    return 0.0


def forward(rows: PathRows, arcs: list[Arc]) -> list[Cell]:
    """Pieces of the fastest timing, ascending in s."""
    ends = np.unique(np.concatenate([rows.breaks, *([arc.low, arc.high] for arc in arcs)]))
    cells: list[Cell] = []
    s, x, hint = 0.0, 0.0, 1.0
    while s < 1.0:
        if len(cells) > _MAX_PIECES:
            raise _search_error(s)
        arc = next((a for a in arcs if a.low <= s < a.high), None)
        if arc is not None and x >= float(arc.at(np.array([s]))[0]) * (1 - 1e-8) and s > 0:
            arc_cells = [c if c.low >= s else c.since(s) for c in arc.cells if c.high > s + 1e-15]
            cells += arc_cells
            s, x = arc.high, float(arc_cells[-1].x.sum())
            continue
        target = float(ends[np.searchsorted(ends, s, side="right")])
        try:
            cell = _advance(rows, s, x, 1, target, caps=True, below=arc, hint=hint)
        except _Stuck:
            raise _search_error(s) from None
        cells.append(cell)
        hint = max(4.0 * (cell.high - cell.low), _MIN_PIECE)
        s, x = cell.high, float(cell.x.sum())
    return cells


def _search_error(s: float) -> PathError:
    return PathError(
        f"no fastest timing was found beyond s = {printed(s)}: the search failed to follow the limits there. A path "
        "with fewer corners, or more similar limits of the joints, may help; a trapezoidal scaling always exists.",
        reached=s,
    )


# ── Fastest timing of a path. Modern Robotics section 9.4

_MIN_SPEED_UP_LENGTH = 1e-6
"""Share of the path; torque and acceleration limits count as at most those that reach the velocity limit within it."""
_ROOM = 4e-8
"""Margin kept to each limit, as a share, that covers the deviations of the pieces in both passes."""
_KINDS = ("velocity", "acceleration", "deceleration", "effort", "jerk")


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
        return 0.0 if self.time_optimal is None else self.duration / self.time_optimal.duration - 1.0

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
        times, cells = self.scaling.times, self.scaling.cells  # type: ignore[attr-defined]
        contacts: list[LimitContact] = []
        for k, c in enumerate(cells):
            side, j = c.side, c.active.joint
            name = (model.drive_labels if c.active.kind == "torque" else model.velocity_names)[j]
            way = int(np.sign(self.path(np.array([0.5 * (c.low + c.high)]))[1][0, j]))
            if c.active.kind == "velocity":
                side = way
            elif c.active.kind == "acceleration" and self.bounds.acceleration[j] != self.bounds.deceleration[j]:
                side *= way
            new = LimitContact(float(times[k]), float(times[k + 1]), name, c.active.kind, side, c.low)
            if contacts and (contacts[-1].joint, contacts[-1].kind, contacts[-1].side) == (name, new.kind, side):
                contacts[-1] = replace(contacts[-1], end=new.end)
            else:
                contacts.append(new)
        return tuple(contacts)

    def shares(self, t: ArrayLike) -> Array:
        """Share of the most used limit: at most 1, and 1 if the limit is active. With jerk limits it may stay below 1.

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
        return np.asarray(np.abs(np.concatenate(parts, axis=-1)).max(axis=-1))

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
            path = self.scaling(np.linspace(0.0, self.duration, samples))[:2]
            return LimitCurves(s, np.sqrt(cap.torque), np.sqrt(cap.velocity), path, (np.zeros(0), np.zeros(0)))
        cells = self.scaling.cells  # type: ignore[attr-defined]
        z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 16))  # denser at the ends (square-root behaviour)
        points = [c.low + (c.high - c.low) * z for c in cells]
        squares = np.concatenate([c.at(s_of_cell) for c, s_of_cell in zip(cells, points, strict=True)])
        path_s, path_rate = np.concatenate(points), np.sqrt(np.maximum(squares, 0.0))
        switch_s = np.array([contact.s for contact in self.limit_contacts[1:]])
        switches = (switch_s, np.interp(switch_s, path_s, path_rate))
        return LimitCurves(s, np.sqrt(cap.torque), np.sqrt(cap.velocity), (path_s, path_rate), switches)

    def __str__(self) -> str:
        own_kinds = []
        for kind in ("acceleration", "jerk"):
            own = getattr(self.robot.limits, kind)
            if np.isfinite(own).any() and np.array_equal(own, getattr(self.bounds, kind)):
                own_kinds.append(kind)
        joints = ", ".join(dict.fromkeys(f"{t.joint} ({t.kind})" for t in self.limit_contacts))
        how = f"limited by {joints} in {len(self.limit_contacts)} parts"
        if self.time_optimal is not None:
            how = self.price_of_jerk
        own_limits = f"; limits of {' and '.join(own_kinds)} are the robot's own" if own_kinds else ""
        return f"{number(self.duration, 6)} s, {how}{own_limits}"


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
    s = np.linspace(0.0, 1.0, 2001)
    q1 = np.abs(path(s)[1]).max(axis=-1)
    if q1.min() < 1e-7 * q1.max():
        raise ValueRangeError(
            f"the path stands still at s = {number(s[int(q1.argmin())])}, so that ds/dt does not determine the joint "
            "velocities there. Use a path with non-zero dq/ds: a spline without times, or each part separately."
        )
    spare = _ROOM
    if friction and np.any(robot.model.friction.viscous):
        spare += AT_REST
    kept = replace(bounds, **{kind: getattr(bounds, kind) * (1.0 - spare) for kind in _KINDS})
    quick = _time_optimal(robot, path, bounds, kept, friction=friction)
    exceeded = [
        f"{v.joint} reaches {number(v.value, 5)} beyond {number(v.limit, 5)} at s = {number(v.time)}"
        for v in positions_passed(robot, s, path(s)[0], bounds)
    ]
    if exceeded:
        warnings.warn(
            f"the path exceeds position limits of {robot.name!r}: {listed(exceeded, 4, '; ')}. This does not depend on the "
            "timing: choose another path.",
            ConstraintWarning,
            stacklevel=2,
        )
    if np.isinf(bounds.jerk).all():
        return quick
    shapes = (quintic(1.0), *short_averages(robot, path, *quick.limit_curves().path, kept, friction=friction))
    scaling = min((fitted(robot, path, x, kept, friction=friction) for x in shapes), key=lambda x: x.duration)
    return replace(quick, scaling=scaling, bounds=bounds, time_optimal=quick)


def _time_optimal(robot: Robot, path: JointPath, bounds: Limits, kept: Limits, *, friction: bool) -> Fastest:
    """Fastest motion within all limits except jerk; ``kept`` are the bounds minus a small margin."""
    rows = PathRows(robot, path, kept, friction=friction)
    reachable = _reachable(rows)
    if reachable is not rows.bounds:
        rows = PathRows(robot, path, reachable, friction=friction)
    if not (~rows.flat).any():
        raise ValueRangeError(
            f"nothing limits how fast {robot.name!r} speeds up on this path: give effort or acceleration "
            "limits of joints that move."
        )
    rows.require_standing()
    try:
        arcs = backward(rows)
        cells = forward(rows, arcs)
    except PathError:  # a narrow feature of the limit curve was missed
        arcs = backward(rows, 40_001)
        cells = forward(rows, arcs)
    without = replace(bounds, jerk=np.full(robot.nv, np.inf))
    return Fastest(robot, path, FastestScaling(tuple(cells)), without, rows, tuple(arcs), friction=friction)


def _reachable(rows: PathRows) -> Limits:
    """Limits, with torque and acceleration reduced to what a motion within the velocity limits can reach."""
    limits, bounds = rows.at(rows.grid), rows.bounds
    x = limits.cap[:, : len(rows.fast)].min(axis=1, initial=np.inf).max()
    if not np.isfinite(x):
        return bounds
    u = x / (2.0 * _MIN_SPEED_UP_LENGTH)
    a, b, c, d = (np.abs(y) for y in (limits.a, limits.b, limits.c, limits.d))
    largest = 2.0 * (a * u + b * x + d * np.sqrt(x) + c).max(axis=0)
    if (largest >= rows.L).all():
        return bounds
    n, k = len(rows.torque), rows.accelerated
    effort, up, down = bounds.effort.copy(), bounds.acceleration.copy(), bounds.deceleration.copy()
    effort[rows.torque] = np.minimum(rows.L, largest)[:n]
    for limit in (up, down):
        limit[k] = np.minimum(limit[k], largest[n:])
    return replace(bounds, effort=effort, acceleration=up, deceleration=down)


complete(globals())
