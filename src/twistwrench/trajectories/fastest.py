"""The fastest timing of a path under limits of torque, velocity and acceleration. Modern Robotics section 9.4."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import number
from ..errors import ConstraintWarning, PathError, ValueRangeError
from ..listing import listed
from ..motion.bounds import Bounds, bounds_of
from ..robot.robot_argument import require_robot
from ..typing import Array
from .collocation import AT_REST
from .limit_checks import positions_passed
from .limit_rows import PathRows
from .paths import JointPath, require_path
from .timing import FastestScaling
from .trajectory import Trajectory
from .two_passes import Arc, backward, forward

if TYPE_CHECKING:
    from ..robot import Robot

_SHORTEST = 1e-6
"""Part of the path: limits of torque and acceleration by which the robot is at its velocity limit sooner count as lower."""
_ROOM = 4e-8
"""Part of each limit kept free, so that what the pieces are off it, both ways, stays below it."""


@dataclass(frozen=True)
class Touch:
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
    """Where on the path it begins."""


@dataclass(frozen=True, eq=False)
class LimitCurves:
    """What bounds the rate ds/dt along the path: nothing admissible is above these."""

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

    bounds: Bounds
    """The limits kept."""
    rows: PathRows
    """The limits as rows along the path."""
    arcs: tuple[Arc, ...]
    """The phase plane's arcs that make up the timing."""

    @property
    def touches(self) -> tuple[Touch, ...]:
        """What limits the motion, part by part; together they are all of it."""
        names = self.robot.model.velocity_names
        times, cells = self.scaling.times, self.scaling.cells  # type: ignore[attr-defined]
        found: list[Touch] = []
        for k, c in enumerate(cells):
            name = names[c.active.joint]
            side = c.side
            if c.active.kind == "velocity":
                side = int(np.sign(self.path(np.array([0.5 * (c.low + c.high)]))[1][0, c.active.joint]))
            new = Touch(float(times[k]), float(times[k + 1]), name, c.active.kind, side, c.low)
            same = found and (found[-1].joint, found[-1].kind, found[-1].side) == (new.joint, new.kind, new.side)
            if same:
                found[-1] = Touch(found[-1].begin, new.end, name, new.kind, side, found[-1].s)
            else:
                found.append(new)
        return tuple(found)

    def shares(self, t: ArrayLike) -> Array:
        """Share of the most used limit: 1 where one is touched, never above.

        Parameters
        ----------
        t : (...) array_like [s]

        Returns
        -------
        shares : (...) array

        Notes
        -----
        Switches have two sides.

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
        parts = np.concatenate([tau / bounds.effort, dq / bounds.velocity, ddq / bounds.acceleration], axis=-1)
        return np.asarray(np.abs(parts).max(axis=-1))

    def limit_curves(self, samples: int = 801) -> LimitCurves:
        """Limit curves of the phase plane (s, ds/dt), and the motion in it.

        Parameters
        ----------
        samples : int, places along the path

        Returns
        -------
        curves : LimitCurves

        Notes
        -----
        MR figure 9.11.

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
        cells = self.scaling.cells  # type: ignore[attr-defined]
        z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 16))  # closer at the ends, where it rises as a root does
        place = np.concatenate([c.low + (c.high - c.low) * z for c in cells])
        rate = np.sqrt(np.maximum(np.concatenate([c.at(c.low + (c.high - c.low) * z) for c in cells]), 0.0))
        at = np.array([touch.s for touch in self.touches[1:]])
        now = np.interp(at, place, rate)
        return LimitCurves(s, np.sqrt(cap.torque), np.sqrt(cap.velocity), (place, rate), (at, now))

    def __str__(self) -> str:
        joints = dict.fromkeys(f"{t.joint} ({t.kind})" for t in self.touches)
        return f"{number(self.duration, 6)} s, limited by {', '.join(joints)} in {len(self.touches)} parts"


def fastest(
    robot: Robot,
    path: JointPath,
    *,
    effort: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    friction: bool = False,
) -> Fastest:
    """Time-optimal time scaling: the shortest motion along a path from rest to rest within the limits.

    Parameters
    ----------
    robot : Robot
    path : JointPath
    effort : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]
    velocity : (nv,) array_like, optional, velocity limits that stand in for the robot's own [rad/s, m/s]
    acceleration : (nv,) array_like, optional, acceleration limits [rad/s², m/s²]
    friction : bool, count the friction of the joints

    Returns
    -------
    motion : Fastest

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
    MR section 9.4. One limit is touched at all times and none is passed, to 1e-6 of it; limits of torque and
    acceleration that bring the robot to its velocity limit within a millionth of the path count as lower, which costs
    no more of the time than that. The method: :mod:`twistwrench.trajectories.passes`.

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench import trajectories
    >>> mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    >>> quick = fastest(mass, trajectories.joint_line(mass, [0], [2.0]), effort=8.0)
    >>> round(quick.duration, 6)  # 2 sqrt(d / a), with 1 kg at 1 m
    1.0
    """
    require_path(path, "fastest")
    friction = arguments.flag(friction, "friction")
    bounds = bounds_of(require_robot(robot, "fastest"), velocity=velocity, acceleration=acceleration, effort=effort)
    if robot.nv == 0:
        raise ValueRangeError(f"robot {robot.name!r} has no joint that moves. Lock fewer joints.")
    s = np.linspace(0.0, 1.0, 2001)
    q1 = np.abs(path(s)[1]).max(axis=-1)
    if q1.min() < 1e-7 * q1.max():
        raise ValueRangeError(
            f"the path stands still at s = {number(s[int(q1.argmin())])}, so its rate there says nothing of the motion's. "
            "Take one whose dq/ds is nowhere zero: a spline without times, or each part by itself."
        )
    spare = _ROOM + (AT_REST if friction and np.any(robot.model.friction.viscous) else 0.0)
    room = {name: getattr(bounds, name) * (1.0 - spare) for name in ("velocity", "acceleration", "effort")}
    rows = PathRows(robot, path, replace(bounds, **room), friction=friction)
    if (felt := _felt(rows)) is not rows.bounds:
        rows = PathRows(robot, path, felt, friction=friction)
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
    found = Fastest(robot, path, FastestScaling(tuple(cells)), bounds, rows, tuple(arcs))
    _warn_of_positions(robot, path, bounds)
    return found


def _warn_of_positions(robot: Robot, path: JointPath, bounds: Bounds) -> None:
    s = np.linspace(0.0, 1.0, 2001)
    found = [
        f"{v.joint} reaches {number(v.value, 5)} beyond {number(v.limit, 5)} at s = {number(v.time)}"
        for v in positions_passed(robot, s, path(s)[0], bounds)
    ]
    if found:
        warnings.warn(
            f"the path leaves the positions that joints of {robot.name!r} can take: {listed(found, 4, '; ')}. No timing "
            "mends that: take another path.",
            ConstraintWarning,
            stacklevel=3,
        )


def _felt(rows: PathRows) -> Bounds:
    """The limits, those of torque and acceleration no higher than motion within the velocity limits can feel."""
    found, bounds = rows.at(rows.grid), rows.bounds
    x = found.cap[:, : len(rows.fast)].min(axis=1, initial=np.inf).max()
    if not np.isfinite(x):
        return bounds
    u = x / (2.0 * _SHORTEST)
    most = 2.0 * (np.abs(found.a) * u + np.abs(found.b) * x + np.abs(found.d) * np.sqrt(x) + np.abs(found.c)).max(
        axis=0
    )
    if (most >= rows.L).all():
        return bounds
    effort, acceleration = bounds.effort.copy(), bounds.acceleration.copy()
    lower, n = np.minimum(rows.L, most), len(rows.torque)
    effort[rows.torque], acceleration[rows.accelerated] = lower[:n], lower[n:]
    return replace(bounds, effort=effort, acceleration=acceleration)
