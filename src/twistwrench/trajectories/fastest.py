"""Fastest timing of a path under limits of torque, velocity and acceleration. Modern Robotics section 9.4.

Two passes find x(s) = ds². Backward, the largest x from which the path can still end at rest; forward, the largest x
that stays below it. Both follow one limit after another in pieces (:mod:`.collocation`), so structure is found and
never guessed. Backward, where the curve runs into the limit curve, it is that curve until the least acceleration
leads below it: there it leaves. These are the switching points of MR section 9.4, tangent, at corners, or at zero
inertia. Source: the passes are those of Pham & Pham, "A new approach to time-optimal path parameterization based on
reachability analysis", IEEE T-RO 34(3), 2018, without its grid.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.time_scalings import quintic
from ..core import arguments
from ..core.glossary import complete
from ..core.numbers import number, percent, printed
from ..core.text import listed
from ..errors import ConstraintWarning, PathError, ValueRangeError
from ..model.couplings import motor_torques
from ..model.limits import Limits
from ..motion.bounds import bounds_of
from ..robot.task_space_methods import require_robot
from ..typing import Array
from .collocation import AT_REST, Cell, FastestScaling, try_cell
from .jerk_limited import short_averages
from .limit_rows import PathRows
from .paths import JointPath, require_path
from .trajectory import Trajectory, fitted, positions_passed

if TYPE_CHECKING:
    from ..robot import Robot

_SMALLEST = 1e-9
"""Pieces this short [of s] do not get ahead."""
_MOST = 20_000
"""Pieces of one pass."""
_FEW = 20
"""Pieces of such a step."""
_BESIDE = 1e-5
"""Distance from breaks, on both sides, at which the limit curve is checked for leaving it."""
_STEP = 1e-7
"""The step [of s] over which slopes of the limit curve are compared with accelerations."""
_SCAN = 1e-3
"""The step [of s] by which leaving the limit curve is tried: passing it by more than what is allowed shows by then."""


@dataclass(frozen=True, eq=False)
class Arc:
    """Pieces of largest deceleration that lead to an anchor: the end, or a point of the limit curve. Ascending in s."""

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
    """No piece of any size leads on."""


def _advance(
    rows: PathRows, s: float, x: float, way: int, target: float, *, caps: bool, below: Arc | None, hint: float = 1.0
) -> Cell:
    """The longest piece from (s, x) towards ``target``; ends exactly where the touched limit changes."""

    def tried(h: float) -> tuple[Cell | None, bool]:
        cell, rough = try_cell(rows, s, x, h, way, along_caps=caps)
        if cell is not None and below is not None:
            places = np.linspace(cell.low, cell.high, 9)[1:]
            if (cell.at(places) > below.at(places) * (1 + 1e-10)).any():
                return None, False
        return cell, rough

    h = min(abs(target - s), hint)
    found, rough = tried(h)
    if found is not None:
        return found
    while found is None:
        over, was_rough = h, rough
        h *= 0.5
        if h < _SMALLEST and (h < 1e-5 * _SMALLEST or not rough):
            raise _Stuck
        found, rough = tried(h)
    if was_rough:
        return found
    while over - h > 1e-11 * over and over - h > 1e-15:  # to the very place where the limit changes
        middle = 0.5 * (h + over)
        cell, rough = tried(middle)
        if cell is None:
            over = middle
            if rough:
                break
        else:
            found, h = cell, middle
    return found


def backward(rows: PathRows, count: int = 2001) -> list[Arc]:
    """The arcs of the viability curve, ascending in s; between them it is the limit curve, looked at in ``count`` places."""
    arcs: list[Arc] = []
    breaks = rows.breaks
    s, x = 1.0, 0.0
    beside = np.concatenate([breaks + side * _BESIDE for side in (-1, 1)])
    places = np.unique(np.concatenate([np.linspace(0.0, 1.0, count), beside]))
    places = places[(places > 0) & (places < 1)]
    places = places[np.abs(places[:, None] - breaks).min(axis=1) > 0.5 * _BESIDE]
    falls = places[_falls_away(rows, places)]
    while s > 0:
        cells: list[Cell] = []
        hint = 1.0
        try:
            while s > 0:
                target = float(breaks[np.searchsorted(breaks, s, side="left") - 1])
                cell = _advance(rows, s, x, -1, target, caps=False, below=None, hint=hint)
                hint = max(4.0 * (cell.high - cell.low), _SMALLEST)
                cells.append(cell)
                s, x = cell.low, float(cell.x[0])
                if len(cells) > _MOST:
                    raise _lost(s)
        except _Stuck:
            pass
        if cells:
            arcs.append(Arc(tuple(reversed(cells))))
        if s > 0:
            s = _leaving(rows, s, places, falls)
            x = float(rows.cap(np.array([s])).x[0])
    return arcs[::-1]


def _falls_away(rows: PathRows, s: Array) -> Array:
    """True if, just before s (m,), the limit curve is steeper than the least acceleration there; not at breaks."""
    early = rows.at(s - _STEP)
    x = np.stack([rows.cap_of(rows.at(s)).x, rows.cap_of(early).x])
    low = rows.accelerations(early, np.where(np.isfinite(x[1]), x[1], 0.0))[0]
    with np.errstate(invalid="ignore"):
        return np.isfinite(x).all(axis=0) & (2.0 * low * _STEP > (x[0] - x[1]))


def _leaves(rows: PathRows, s: float) -> bool:
    """True if the least acceleration leads, backward, from the limit curve at s to below it, by a detectable step."""
    x = float(rows.cap(np.array([s])).x[0])
    if not np.isfinite(x):
        return False
    goal = max(s - _SCAN, 0.0)
    for _ in range(_FEW):
        previous = float(rows.breaks[np.searchsorted(rows.breaks, s, side="left") - 1])
        try:
            cell = _advance(rows, s, x, -1, max(goal, previous), caps=False, below=None)
        except _Stuck:
            return False
        s, x = cell.low, float(cell.x[0])
        if s <= goal:
            return True
    return False


def _leaving(rows: PathRows, s: float, places: Array, falls: Array) -> float:
    """The first place below s at which the curve leaves the limit curve; 0 if it never does."""
    edges = np.concatenate([places, rows.breaks, [s]])
    chosen = np.unique(np.concatenate([falls, rows.breaks]))
    for place in chosen[(chosen < s - _SMALLEST) & (chosen > 0)][::-1]:
        if place in rows.breaks:
            if _leaves(rows, float(place)):
                return float(place)
            continue
        goes, stays = float(place), float(edges[edges > place].min())
        for _ in range(40):
            middle = 0.5 * (stays + goes)
            if stays - goes < 1e-13:
                break
            stays, goes = (stays, middle) if _falls_away(rows, np.array([middle]))[0] else (middle, goes)
        return goes
    return 0.0


def forward(rows: PathRows, arcs: list[Arc]) -> list[Cell]:
    """The pieces of the fastest timing, ascending in s."""
    ends = np.unique(np.concatenate([rows.breaks, *([arc.low, arc.high] for arc in arcs)]))
    cells: list[Cell] = []
    s, x, hint = 0.0, 0.0, 1.0
    while s < 1.0:
        if len(cells) > _MOST:
            raise _lost(s)
        arc = next((a for a in arcs if a.low <= s < a.high), None)
        if arc is not None and x >= float(arc.at(np.array([s]))[0]) * (1 - 1e-8) and s > 0:
            followed = [c if c.low >= s else c.since(s) for c in arc.cells if c.high > s + 1e-15]
            cells += followed
            s, x = arc.high, float(followed[-1].x.sum())
            continue
        target = float(ends[np.searchsorted(ends, s, side="right")])
        try:
            cell = _advance(rows, s, x, 1, target, caps=True, below=arc, hint=hint)
        except _Stuck:
            raise _lost(s) from None
        cells.append(cell)
        hint = max(4.0 * (cell.high - cell.low), _SMALLEST)
        s, x = cell.high, float(cell.x.sum())
    return cells


def _lost(s: float) -> PathError:
    return PathError(
        f"no fastest timing was found beyond s = {printed(s)}: limits change there in a way the search cannot follow. A "
        "path with fewer corners, or limits less far apart from joint to joint, may help; a trapezoidal scaling always exists.",
        reached=s,
    )


# ── Fastest timing of a path. Modern Robotics section 9.4

_SHORTEST = 1e-6
"""Part of the path: limits of torque and acceleration by which the robot is at its velocity limit sooner count as lower."""
_ROOM = 4e-8
"""Part of each limit kept free, so that what the pieces are off it, both ways, stays below it."""
_KINDS = ("velocity", "acceleration", "deceleration", "effort", "jerk")


@dataclass(frozen=True)
class LimitContact:
    """Part of a fastest motion, and the limit it touches."""

    begin: float
    """s."""
    end: float
    """s."""
    joint: str
    """Name of the joint."""
    kind: str
    """``torque``, ``velocity`` or ``acceleration``."""
    side: int
    """+1 if at the upper limit, -1 at the lower."""
    s: float
    """Path position of its start."""


@dataclass(frozen=True, eq=False)
class LimitCurves:
    """Bounds of the rate ds/dt along the path: no admissible motion lies above them."""

    s: Array
    """(n,)."""
    torque: Array
    """(n,) 1/s: where torques and accelerations leave one acceleration of s only; inf where they never do."""
    velocity: Array
    """(n,) 1/s: where a joint is at its largest velocity."""
    path: tuple[Array, Array]
    """s and ds/dt of the fastest timing."""
    switches: tuple[Array, Array]
    """s and ds/dt where another limit begins to be touched."""


@dataclass(frozen=True, eq=False)
class Fastest(Trajectory):
    """Time-optimal motion along a path, with what limits it when."""

    bounds: Limits
    """The limits kept."""
    rows: PathRows
    """The limits as rows along the path."""
    arcs: tuple[Arc, ...]
    """The phase plane's arcs that make up the timing, or the time-optimal one."""
    time_optimal: Fastest | None = None
    """The motion without limits of jerk from which this one is made; None if jerk is not limited."""

    @property
    def slower(self) -> float:
        """Share by which it takes longer than without limits of jerk; 0 if jerk is not limited."""
        return 0.0 if self.time_optimal is None else self.duration / self.time_optimal.duration - 1.0

    @property
    def price_of_jerk(self) -> str:
        """Sentence on what limits of jerk cost."""
        return f"{percent(self.slower)} slower than without jerk limits; not proven shortest"

    @property
    def limit_contacts(self) -> tuple[LimitContact, ...]:
        """Limits that are active along the motion, in order; together they cover all of it. With limits of jerk, none."""
        if self.time_optimal is not None:
            return ()
        model = self.robot.model
        times, cells = self.scaling.times, self.scaling.cells  # type: ignore[attr-defined]
        found: list[LimitContact] = []
        for k, c in enumerate(cells):
            name = (model.drive_labels if c.active.kind == "torque" else model.velocity_names)[c.active.joint]
            side = c.side
            j = c.active.joint
            way = int(np.sign(self.path(np.array([0.5 * (c.low + c.high)]))[1][0, j]))
            if c.active.kind == "velocity":
                side = way
            elif c.active.kind == "acceleration" and self.bounds.acceleration[j] != self.bounds.deceleration[j]:
                side *= way
            new = LimitContact(float(times[k]), float(times[k + 1]), name, c.active.kind, side, c.low)
            if found and (found[-1].joint, found[-1].kind, found[-1].side) == (name, new.kind, side):
                found[-1] = replace(found[-1], end=new.end)
            else:
                found.append(new)
        return tuple(found)

    def shares(self, t: ArrayLike) -> Array:
        """Share of the most used limit: 1 where one is touched, never above. With limits of jerk it may be below throughout.

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
        tau = self.robot.inverse_dynamics(q, dq, ddq, friction=self.rows.friction)
        tau = motor_torques(self.robot.model, tau)
        parts = [tau / bounds.effort, dq / bounds.velocity, ddq / bounds.acceleration_at(dq, ddq)]
        if self.time_optimal is not None:
            parts.append(self.jerk(t) / bounds.jerk)
        return np.asarray(np.abs(np.concatenate(parts, axis=-1)).max(axis=-1))

    def limit_curves(self, samples: int = 801) -> LimitCurves:
        """Limit curves of the phase plane (s, ds/dt), and the motion in it. MR figure 9.11.

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
        z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 16))  # closer at the ends, where it rises as a root does
        place = np.concatenate([c.low + (c.high - c.low) * z for c in cells])
        rate = np.sqrt(np.maximum(np.concatenate([c.at(c.low + (c.high - c.low) * z) for c in cells]), 0.0))
        at = np.array([touch.s for touch in self.limit_contacts[1:]])
        now = np.interp(at, place, rate)
        return LimitCurves(s, np.sqrt(cap.torque), np.sqrt(cap.velocity), (place, rate), (at, now))

    def __str__(self) -> str:
        own, limits = self.robot.limits, self.bounds
        kinds = [
            kind
            for kind in ("acceleration", "jerk")
            if np.isfinite(getattr(own, kind)).any() and np.array_equal(getattr(own, kind), getattr(limits, kind))
        ]
        joints = ", ".join(dict.fromkeys(f"{t.joint} ({t.kind})" for t in self.limit_contacts))
        how = f"limited by {joints} in {len(self.limit_contacts)} parts"
        if self.time_optimal is not None:
            how = self.price_of_jerk
        said = f"; limits of {' and '.join(kinds)} are the robot's own" if kinds else ""
        return f"{number(self.duration, 6)} s, {how}{said}"


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
    """Time-optimal time scaling: the shortest motion along a path from rest to rest within the limits.

    With limits of jerk, a short one: the time-optimal motion averaged over time, on the same path; not proven shortest.

    Parameters
    ----------
    path : JointPath
    effort : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]
    velocity : (nv,) array_like, optional, velocity limits that stand in for the robot's own [rad/s, m/s]
    acceleration : (nv,) array_like, optional, acceleration limits that stand in for the robot's own; without
        ``deceleration`` also of joints that slow down [rad/s², m/s²]
    deceleration : (nv,) array_like, optional, likewise, of joints that slow down [rad/s², m/s²]
    jerk : (nv,) array_like or float, optional, jerk limits that stand in for the robot's own, inf: none [rad/s³, m/s³]

    Raises
    ------
    PathError
        The robot cannot hold itself on the path; s, joint and amount are named.
    ValueRangeError
        Nothing limits the motion, or the path stands still somewhere.

    Warns
    -----
    ConstraintWarning
        The path is beyond the joints' positions; it names them, and ``violations`` lists all.

    Notes
    -----
    MR section 9.4, by two passes. One limit is touched at all times and none is passed, to 1e-6 of it; limits of torque and
    acceleration that bring the robot to its velocity limit within a millionth of the path count as lower.

    Jerk makes the problem non-convex (H. Pham & Q.-C. Pham, "Time-optimal path tracking with jerk constraints", ICRA 2017).
    Averaging s(t) over two windows of time keeps the path, bounds the jerk and makes it continuous. Windows and rates are
    searched for, see ``jerk_limited.py``; the duration then is the shortest at which that motion keeps all limits.

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
            f"the path stands still at s = {number(s[int(q1.argmin())])}, so its rate there does not determine that of the "
            "motion. Take one whose dq/ds is nowhere zero: a spline without times, or each part by itself."
        )
    spare = _ROOM + (AT_REST if friction and np.any(robot.model.friction.viscous) else 0.0)
    kept = replace(bounds, **{kind: getattr(bounds, kind) * (1.0 - spare) for kind in _KINDS})
    quick = _time_optimal(robot, path, bounds, kept, friction=friction)
    passed = [
        f"{v.joint} reaches {number(v.value, 5)} beyond {number(v.limit, 5)} at s = {number(v.time)}"
        for v in positions_passed(robot, s, path(s)[0], bounds)
    ]
    if passed:
        warnings.warn(
            f"the path leaves the positions that joints of {robot.name!r} can take: {listed(passed, 4, '; ')}. No timing "
            "mends that: take another path.",
            ConstraintWarning,
            stacklevel=2,
        )
    if np.isinf(bounds.jerk).all():
        return quick
    shapes = (quintic(1.0), *short_averages(robot, path, *quick.limit_curves().path, kept, friction=friction))
    scaling = min((fitted(robot, path, x, kept, friction=friction) for x in shapes), key=lambda x: x.duration)
    return replace(quick, scaling=scaling, bounds=bounds, time_optimal=quick)


def _time_optimal(robot: Robot, path: JointPath, bounds: Limits, kept: Limits, *, friction: bool) -> Fastest:
    """The fastest motion within the limits but for those of jerk; ``kept`` are the bounds less a little room."""
    rows = PathRows(robot, path, kept, friction=friction)
    if (reachable := _reachable(rows)) is not rows.bounds:
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
    except PathError:  # a narrow place of the limit curve was missed
        arcs = backward(rows, 40_001)
        cells = forward(rows, arcs)
    without = replace(bounds, jerk=np.full(robot.nv, np.inf))
    return Fastest(robot, path, FastestScaling(tuple(cells)), without, rows, tuple(arcs))


def _reachable(rows: PathRows) -> Limits:
    """The limits; those of torque and acceleration are at most what a motion within the velocity limits reaches."""
    found, bounds = rows.at(rows.grid), rows.bounds
    x = found.cap[:, : len(rows.fast)].min(axis=1, initial=np.inf).max()
    if not np.isfinite(x):
        return bounds
    u = x / (2.0 * _SHORTEST)
    a, b, c, d = (np.abs(y) for y in (found.a, found.b, found.c, found.d))
    most = 2.0 * (a * u + b * x + d * np.sqrt(x) + c).max(axis=0)
    if (most >= rows.L).all():
        return bounds
    n, k = len(rows.torque), rows.accelerated
    effort, up, down = bounds.effort.copy(), bounds.acceleration.copy(), bounds.deceleration.copy()
    effort[rows.torque] = np.minimum(rows.L, most)[:n]
    for limit in (up, down):
        limit[k] = np.minimum(limit[k], most[n:])
    return replace(bounds, effort=effort, acceleration=up, deceleration=down)


complete(globals())
