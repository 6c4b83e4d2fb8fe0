"""Trajectory of a path with a time scaling, and limits that it violates. Modern Robotics section 9.1."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import PathError, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import TOLERANCE, printed
from ..core.typing import Array
from ..mechanics.algorithms.time_scalings import quintic
from ..mechanics.model.couplings import joint_velocities, motor_torques, motor_velocities
from ..mechanics.model.limits import Limits
from ..motion.bounds import LimitCheck, Violation, bounds_or_own, velocities_inside
from ..motion.coordinates import configuration
from ..motion.motion import Motion
from ..robot.base import require_robot
from .doors import TrajectoryDoors
from .paths import JointPath, joint_line, require_path, spline

if TYPE_CHECKING:
    from ..robot import Robot


def violations(
    robot: Robot,
    trajectory: Trajectory | Motion,
    bounds: Limits | None = None,
    *,
    friction: bool | None = None,
    samples: int = 2001,
) -> tuple[Violation, ...]:
    """Limits that a motion exceeds, worst first.

    Parameters
    ----------
    trajectory : Trajectory or Motion; a motion is checked at its own samples
    friction : bool, optional, count joint friction; None: if the motion was planned with friction
    samples : int, number of samples of a trajectory

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench import trajectories
    >>> arm = tw.robots.ur5()
    >>> hasty = trajectories.move(arm, [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0], trajectories.cubic(0.3))
    >>> print(violations(arm, hasty)[0])
    shoulder_pan_joint: velocity 5 beyond 3.1416 rad/s at 0.15 s
    """
    require_robot(robot, "violations")
    is_trajectory = hasattr(trajectory, "sample") and not isinstance(trajectory, type)
    if not is_trajectory:
        motion = getattr(trajectory, "motion", trajectory)  # a simulation's result has a motion
        if not isinstance(motion, Motion):
            raise ValueRangeError(
                f"violations: the motion is {arguments.value_text(trajectory)}: give a Trajectory, a tw.Motion, or a "
                "simulation."
            )
        return motion.with_robot(robot).violations(bounds, friction=friction)
    samples = arguments.whole(samples, "samples")
    friction = trajectory.friction if friction is None else arguments.flag(friction, "friction")
    t = np.linspace(0.0, trajectory.duration, samples)
    q, dq, ddq = trajectory(t)
    check = LimitCheck(robot.model, bounds_or_own(robot, bounds))
    torques = required_torques(robot, t, q, dq, ddq, friction=friction)
    check.add(t, q, dq, ddq, torques)
    if samples > 2 and trajectory.duration > 0:
        check.add_jerk(t, ddq)
    check.add_dynamics(robot, t, q, dq, ddq)
    return check.violations()


def required_torques(robot: Robot, t: Array, q: Array, dq: Array, ddq: Array, *, friction: bool) -> Array:
    """Torques (n, nv) of a whole motion at times (n,); friction at its ends is that of :func:`.velocities_inside`."""
    dq = velocities_inside(t, dq, ddq, t[0], t[-1])
    return np.asarray(robot.inverse_dynamics(q, dq, ddq, friction=friction))


def positions_passed(robot: Robot, s: Array, q: Array, bounds: Limits) -> tuple[Violation, ...]:
    """Position limits that configurations (n, nq) exceed; ``s`` (n,) replaces the time."""
    check = LimitCheck(robot.model, bounds)
    at_rest = np.zeros((len(s), robot.nv))
    check.add(s, q, at_rest)
    return check.violations()


# ── Trajectory: path and time scaling

_FIRST_SAMPLES = 2001
"""Initial number of samples of a motion; later samples refine the largest peaks of the shortest duration."""
_REFINEMENTS = 3
"""Number of times that the peaks are refined."""
_MAX_PEAKS = 8
"""Number of largest peaks that are refined each time."""
_PARTS_PER_INTERVAL = 20
"""Number of parts into which a refinement splits the intervals on both sides of a peak."""
_MAX_SAMPLES = 1e8
"""Largest number of samples of a trajectory."""
_SIDE_STEP = 1e-9
"""Distance of s to either side of a knot at which the path is compared."""
_SLOW_SPEED = 1e-9
"""Motor speed at which friction is static [rad/s, m/s]."""
_MIN_RESERVE = 1e-6
"""Least share of an effort limit that standing still must leave."""


class Scaling(Protocol):
    """Time scaling of a path: s(t) from 0 to 1, with its rate and acceleration."""

    @property
    def name(self) -> str:
        """Name used in reports."""

    @property
    def duration(self) -> float:
        """T [s]."""

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]."""


@dataclass(frozen=True, eq=False)
class Trajectory(TrajectoryDoors):
    """Trajectory q(t) = q(s(t)) of one robot, with exact derivatives."""

    robot: Robot
    """Robot of the trajectory."""
    path: JointPath
    """Path q(s), s from 0 to 1."""
    scaling: Scaling
    """Time scaling s(t)."""
    friction: bool = field(default=False, kw_only=True)
    """True if the trajectory was planned with joint friction, which :meth:`violations` then counts."""

    def __post_init__(self) -> None:
        require_robot(self.robot, "Trajectory")
        require_path(self.path, "Trajectory")
        is_scaling = callable(self.scaling) and hasattr(self.scaling, "duration")
        if not is_scaling or isinstance(self.scaling, type):
            raise ValueRangeError(
                f"Trajectory: the scaling is {arguments.value_text(self.scaling)}: give one that "
                "tw.trajectories.quintic, cubic, trapezoid or uniform makes."
            )
        first_q, _, _ = self.path(0.0)
        path_nq = first_q.shape[-1]
        if path_nq != self.robot.nq:
            raise ShapeError(
                f"the path has {path_nq} coordinates, and robot {self.robot.name!r} {self.robot.nq}: it is another robot's. "
                "Make the path and the motion with the same robot."
            )

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.scaling.duration)

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """q (..., nq), dq and ddq (..., nv) at t (...) [s]; before and after, the robot rests at an end. MR eq. 9.1 to 9.3."""
        s, ds, dds = self.scaling(t)
        q, dq_ds, ddq_dds = self.path(s)
        ds, dds = ds[..., None], dds[..., None]
        return q, dq_ds * ds, ddq_dds * ds * ds + dq_ds * dds

    def jerk(self, t: ArrayLike) -> Array:
        """Third derivative of q at t [s]: q‴ ds³ + 3 q″ ds dds + q′ ddds, with q′, q″ and q‴ by s and ds, dds and ddds by t.

        Returns
        -------
        jerk : (..., nv) array [rad/s³, sliding joints: m/s³]

        Raises
        ------
        ValueRangeError
            The path or the scaling has no third derivative, such as the trapezoidal scaling.

        Examples
        --------
        >>> import twistwrench as tw
        >>> from twistwrench import trajectories
        >>> moving = trajectories.move(tw.robots.planar_2r(), [0, 0], [1, 0], trajectories.quintic(2.0))
        >>> moving.jerk(0.0).tolist()  # 60/T³
        [7.5, 0.0]
        """
        if self.path.third is None or not hasattr(self.scaling, "third"):
            if self.path.third is None:
                source = f"path {self.path.name!r}"
            else:
                source = f"{self.scaling.name} timing"
            raise ValueRangeError(
                f"the {source} has no third derivative, so its jerk is not known: take the quintic or s-curve timing, a "
                "line, a spline, or a JointPath with third=."
            )
        s, ds, dds = self.scaling(t)
        ds, dds = ds[..., None], dds[..., None]
        ddds = np.asarray(self.scaling.third(t))[..., None]
        _, q1, q2 = self.path(s)  # q′ and q″
        return np.asarray(self.path.third(s) * ds**3 + 3.0 * q2 * ds * dds + q1 * ddds)

    def sample(self, dt: float) -> Motion:
        """Samples of the trajectory as a :class:`twistwrench.Motion`, every ``dt`` and at the end.

        Examples
        --------
        >>> import twistwrench as tw
        >>> from twistwrench import trajectories
        >>> moving = trajectories.move(tw.robots.planar_2r(), [0, 0], [1, 1], trajectories.cubic(1.0))
        >>> moving.sample(0.25).q[:, 0].tolist()
        [0.0, 0.15625, 0.5, 0.84375, 1.0]
        """
        step = arguments.number(dt, "dt")
        is_step = 0 < step < np.inf
        if not is_step or self.duration / step > _MAX_SAMPLES:
            raise ValueRangeError(
                f"dt is {printed(step)}: give a step [s] above zero, in which {printed(self.duration, 4)} s has at most 1e8."
            )
        steps_in_duration = self.duration / step * (1 + 1e-12)  # rounding does not lose the last of whole steps
        whole_steps = int(np.floor(steps_in_duration))
        t = step * np.arange(whole_steps + 1)
        remaining_time = self.duration - t[-1]
        if remaining_time > 1e-9 * min(step, self.duration):  # more than rounding errors
            t = np.append(t, self.duration)
        t[-1] = min(t[-1], self.duration)
        return Motion(t, *self(t), robot=self.robot, in_seconds=True, friction=self.friction, plan=True)

    def violations(self, bounds: Limits | None = None, *, friction: bool | None = None) -> tuple[Violation, ...]:
        """Limits that the trajectory exceeds, worst first; see :func:`~twistwrench.trajectories.violations`.

        Parameters
        ----------
        friction : bool, optional, count joint friction; None: if the motion was planned with friction

        Examples
        --------
        >>> import twistwrench as tw
        >>> move(tw.robots.ur5(), [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0]).violations()
        ()
        """
        return violations(self.robot, self, bounds, friction=friction)

    def to_csv(self, path: str | Path, dt: float = 0.002, *, degrees: bool = False) -> Path:
        """Write time, q, dq and ddq every ``dt``, as read by ``twistwrench torques``.

        Parameters
        ----------
        degrees : bool, angles in degrees

        Examples
        --------
        >>> import tempfile, pathlib, twistwrench as tw
        >>> from twistwrench import trajectories
        >>> moving = trajectories.move(tw.robots.planar_2r(), [0, 0], [1, 1], trajectories.cubic(1.0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(moving.to_csv(pathlib.Path(folder, "m.csv"), 0.5).read_text().splitlines()[0])
        time,joint1,joint2,joint1.vel,joint2.vel,joint1.acc,joint2.acc
        """
        return self.sample(dt).to_csv(path, degrees=degrees)


def move(
    robot: Robot, q0: ArrayLike, q1: ArrayLike, scaling: Scaling | None = None, *, waypoints: ArrayLike | None = None
) -> Trajectory:
    """Trajectory between two configurations on a straight line in joint space, or on a spline through waypoints.

    Parameters
    ----------
    scaling : optional, s(t); None: quintic with the shortest duration within the robot's limits
    waypoints : (m, nq) array_like, optional, between the ends

    Examples
    --------
    >>> import twistwrench as tw
    >>> moving = move(tw.robots.ur5(), [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0])
    >>> round(moving.duration, 3)
    0.597
    """
    require_robot(robot, "move")
    if waypoints is None:
        path = joint_line(robot, q0, q1)
    else:
        names = robot.coordinate_names
        finite_waypoints = arguments.finite(waypoints, "waypoints", robot.nq, names=names)
        inner_points = np.atleast_2d(np.asarray(finite_waypoints, float))
        start = configuration(robot, q0, "q0")
        end = configuration(robot, q1, "q1")
        path = spline(robot, np.concatenate([start[None], inner_points, end[None]]))
    if scaling is None:
        scaling = fitted(robot, path)
    return Trajectory(robot, path, scaling)


def fitted(
    robot: Robot, path: JointPath, shape: Any = None, bounds: Limits | None = None, *, friction: bool = False
) -> Any:
    """Shortest time scaling of a given shape within the limits of velocity, acceleration, jerk and torque.

    Parameters
    ----------
    path : JointPath
    shape : a scaling, optional, that defines the shape; None: quintic
    friction : bool, include joint friction, with full static friction at all speeds

    Returns
    -------
    scaling : of the given shape

    Notes
    -----
    Torques depend on the duration T as g + (τ - g) (T0/T)², and jerks as 1/T³, so each sample gives the shortest T in
    closed form. Load-dependent friction is taken at |g| + |τ - g| (T0/T)².

    Raises
    ------
    ValueRangeError
        No limit applies to the motion; or jerk is limited and the shape or path has jumps of acceleration.

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench.motion.bounds import bounds_of
    >>> arm = tw.robots.planar_2r()
    >>> bounds = tw.trajectories.bounds_of(arm, velocity=2.0)
    >>> round(fitted(arm, joint_line(arm, [0, 0], [1, 0]), bounds=bounds).duration, 6)
    0.9375
    """
    require_robot(robot, "fitted")
    bounds = bounds_or_own(robot, bounds)
    friction = arguments.flag(friction, "friction")
    is_scaling = hasattr(shape, "stretched") and not isinstance(shape, type)
    if shape is not None and not is_scaling:
        raise ValueRangeError(
            f"fitted: the shape is {arguments.value_text(shape)}: give a scaling that tw.trajectories.quintic, cubic, "
            "trapezoid or uniform makes, of any duration."
        )
    scaling = quintic(1.0) if shape is None else shape
    unit_scaling = scaling.stretched(1.0)  # of 1 s
    if np.isfinite(bounds.jerk).any():
        _require_continuous_acceleration(Trajectory(robot, path, unit_scaling))
    knots = getattr(unit_scaling, "knots", ())  # times at which the acceleration has a corner or a jump
    times = np.union1d(np.linspace(0.0, 1.0, _FIRST_SAMPLES), knots)
    durations = shortest_durations(robot, path, unit_scaling, bounds, times, friction=friction)
    for _ in range(_REFINEMENTS):  # the time of the largest duration lies between two samples
        new_times = _times_around_peaks(times, durations)
        new_durations = shortest_durations(robot, path, unit_scaling, bounds, new_times, friction=friction)
        times = np.concatenate([times, new_times])
        durations = np.concatenate([durations, new_durations])
        order = np.argsort(times)
        times, durations = times[order], durations[order]
    T = float(durations.max())
    if not 0 < T < np.inf:
        raise ValueRangeError(
            f"nothing limits {robot.name!r} on this path: give velocity, acceleration or effort limits."
        )
    return unit_scaling.stretched(T)


def _times_around_peaks(times: Array, durations: Array) -> Array:
    """New times within the intervals on both sides of the largest local maxima of the durations."""
    padded = np.concatenate([[-np.inf], durations, [-np.inf]])
    is_peak = (durations >= padded[:-2]) & (durations >= padded[2:])
    peak_indices = np.flatnonzero(is_peak)
    largest_first = np.argsort(-durations[peak_indices])
    peak_indices = peak_indices[largest_first[:_MAX_PEAKS]]
    intervals_beside_peaks = np.concatenate([peak_indices - 1, peak_indices])
    last_interval = len(times) - 2
    intervals = np.unique(np.clip(intervals_beside_peaks, 0, last_interval))
    shares = np.arange(1, _PARTS_PER_INTERVAL) / _PARTS_PER_INTERVAL
    begins = times[intervals, None]
    lengths = np.diff(times)[intervals, None]
    return np.asarray((begins + shares * lengths).ravel())


def _require_continuous_acceleration(trajectory: Trajectory) -> None:
    """Raise ValueRangeError if acceleration jumps at the ends or at a knot of the path, so that jerk is unbounded."""
    ends = [0.0, trajectory.duration]
    samples = np.linspace(0.0, trajectory.duration, 101)
    _, dq, ddq = trajectory(np.concatenate([ends, samples]))
    moves_at_ends = False
    for rates in (dq, ddq):
        max_at_ends = np.abs(rates[:2]).max()
        moves_at_ends |= bool(max_at_ends > TOLERANCE * np.abs(rates).max())
    knots = trajectory.path.knots[1:-1]  # without the ends
    _, _, slopes_before = trajectory.path(knots - _SIDE_STEP)  # d²q/ds²
    _, _, slopes_after = trajectory.path(knots + _SIDE_STEP)
    jumps = np.abs(slopes_after - slopes_before).max(axis=1, initial=0.0)
    has_jump = jumps > TOLERANCE * np.abs(slopes_before).max(initial=0.0)
    where = ""
    if moves_at_ends:
        where = "at the ends"
    elif has_jump.any():
        first_jump = knots[has_jump][0]
        where = f"at s = {printed(first_jump, 4)}, where the path's d²q/ds² does"
    if where:
        raise ValueRangeError(
            f"the acceleration of a motion with {trajectory.scaling.name} timing on this path jumps {where}, so no duration "
            "keeps a limit of jerk. Take the quintic or s-curve timing and a path without such jumps, or jerk limits of inf."
        )


def shortest_durations(
    robot: Robot, path: JointPath, unit_scaling: Any, bounds: Limits, times: Array, *, friction: bool
) -> Array:
    """Shortest duration (n,) by the limits at times (n,) of a motion of 1 s; 0 if no limit applies."""
    trajectory = Trajectory(robot, path, unit_scaling)
    q, dq, ddq = trajectory(times)
    dq = velocities_inside(times, dq, ddq, 0.0, 1.0)
    # Velocities are proportional to 1/T, accelerations to 1/T², jerks to 1/T³. A share of 0/0 counts as zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        shares_of_velocity = np.nan_to_num(np.abs(dq) / bounds.velocity, posinf=np.inf)
        shares_of_acceleration = np.nan_to_num(np.abs(ddq) / bounds.acceleration_at(dq, ddq), posinf=np.inf)
    shortest = [shares_of_velocity, np.sqrt(shares_of_acceleration)]  # durations (n, nv) by each limit [s]
    if np.isfinite(bounds.jerk).any():
        shortest.append(np.cbrt(np.abs(trajectory.jerk(times)) / bounds.jerk))
    model = robot.model
    law = model.friction
    u = motor_velocities(model, dq)
    holding_torques = motor_torques(model, robot.holding_torques(q))
    slow_dq = joint_velocities(model, _SLOW_SPEED * np.sign(u))
    static_friction = motor_torques(model, robot.friction_forces(slow_dq)) * friction  # zero without friction
    g = holding_torques + static_friction
    load_factor = law.load * friction * (u != 0)  # friction as a share of the carried torque
    standing_torques = np.abs(g) + load_factor * np.abs(holding_torques)
    reserve = bounds.effort - standing_torques
    has_no_reserve = (reserve <= _MIN_RESERVE * bounds.effort) & np.isfinite(reserve)
    if has_no_reserve.any():
        largest_share = int((standing_torques / bounds.effort).argmax())
        i, j = np.unravel_index(largest_share, g.shape)  # of the sample and of the motor
        raise PathError(
            f"the robot cannot hold itself on this path: {model.drive_labels[j]!r} needs {printed(standing_torques[i, j], 4)} "
            f"of {printed(bounds.effort[j], 4)} to stand still. Take load off, another path, or a stronger joint."
        )
    moving_torques = motor_torques(model, robot.inverse_dynamics(q, dq, ddq)) - holding_torques
    viscous_torques = law.viscous * u if friction else np.zeros_like(dq)
    fading_friction = (law.static - law.coulomb) * friction  # friction that helps a braking motor
    # |g + moving k² + viscous k| ≤ L with k = 1/T. On either side A k² + B k ≤ C, where C is the room that is left of L;
    # k is the smaller positive root of the equation, inf if there is none.
    for side in (1.0, -1.0):
        A = side * moving_torques + load_factor * np.abs(moving_torques)
        B = side * viscous_torques
        C = bounds.effort - side * g - load_factor * np.abs(holding_torques) - fading_friction * (side * u < 0)
        with np.errstate(all="ignore"):
            discriminant = B * B + 4 * A * C
            root = np.sqrt(np.maximum(discriminant, 0.0))
            k = np.where(B + root > 0, 2 * C / (B + root), np.inf)
            k = np.where(np.isfinite(C) & (discriminant >= 0), k, np.inf)
            shortest.append(1.0 / k)
    return np.asarray(np.concatenate(shortest, axis=1).max(axis=1, initial=0.0))


complete(globals())
