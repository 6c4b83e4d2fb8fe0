"""Exciting motions: those from whose log :func:`identify` can tell base parameters best, within all limits of the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..motion.bounds import Bounds, bounds_of
from ..motion.motion import Motion
from ..robot import Robot
from ..robot.robot_argument import require_robot
from ..typing import Array
from .motion_information import MotionInformation
from .motion_room import Clear, MotionRoom, half_and_middle, shared_bounds
from .motion_search import MotionSearch
from .parameter_groups import BaseParameters
from .rest_series import RestSeries
from .unknown_parameters import UnknownParameters, check_speed

_NOISE = 0.01
"""Share of a joint's torque limit that its torque's noise is taken for where none is told."""
_JUDGED = 2001
"""Instants at which a motion is judged."""
_MOST_HARMONICS = 50


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """Exciting motion of one robot, at rest at both ends, and what its log will tell.

    Attributes
    ----------
    robot : Robot
    series : RestSeries, the functions of time
    coefficients : (nv, 1 + 2 N) array, of the series [rad, m]
    bounds : Bounds that were kept, a share of the robot's
    information : MotionInformation, by which it was chosen
    step : float, between samples of :attr:`motion` [s]
    """

    robot: Robot
    series: RestSeries
    coefficients: Array
    bounds: Bounds
    information: MotionInformation
    step: float

    def __repr__(self) -> str:
        return (
            f"<ExcitingMotion of {self.robot.name!r}: {self.duration:g} s, {self.series.harmonics} harmonics, "
            f"condition {self.condition:.3g}>"
        )

    @property
    def duration(self) -> float:
        """From the beginning to the end [s]."""
        return self.series.duration

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """q, dq and ddq (..., nv) at t (...) [s]; before and after, it rests where it begins and ends."""
        times = np.asarray(arguments.finite(t, "t"), float)
        q, dq, ddq = (
            x.reshape(*times.shape, -1) for x in self.series.states(self.coefficients, np.atleast_1d(times).ravel())
        )
        return q, dq, ddq

    @cached_property
    def motion(self) -> Motion:
        """Samples of it: what ``torques``, ``view`` and ``simulate`` take."""
        count = max(6, round(self.duration / self.step))
        t = np.linspace(0.0, self.duration, count + 1)
        return Motion(t, *self(t), robot=self.robot, in_seconds=True)

    @cached_property
    def _rows(self) -> Array:
        return self.information.rows(*self(np.linspace(0.0, self.duration, _JUDGED)))

    @property
    def groups(self) -> tuple[str, ...]:
        """The base parameters in words."""
        return self.information.base.names

    @cached_property
    def predicted_deviations(self) -> Array:
        """(r,) deviations of the base parameters to expect at the torque noise that was told, with 25 rows a second."""
        return self.information.deviations(self._rows)

    @cached_property
    def log_det(self) -> float:
        """Log determinant of the information, in SI units."""
        return self.information.log_det(self._rows)

    @cached_property
    def condition(self) -> float:
        """Condition number of the rows' columns, in SI units."""
        return self.information.condition(self._rows)

    @cached_property
    def peaks(self) -> dict[str, Array]:
        """Largest ``velocity``, ``acceleration`` and ``torque`` (nv,) each, and ``lower`` and ``upper`` positions."""
        q, dq, ddq = self(np.linspace(0.0, self.duration, _JUDGED))
        tau = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=True))
        found = {name: np.abs(x).max(axis=0) for name, x in (("velocity", dq), ("acceleration", ddq), ("torque", tau))}
        return {"lower": q.min(axis=0), "upper": q.max(axis=0), **found}

    def to_csv(self, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a CSV file that ``twistwrench torques`` reads.

        Parameters
        ----------
        path : str or Path
        degrees : bool, angles in degrees

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            Nothing can be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> found = exciting_trajectory(tw.robots.pendulum(), 4.0, 2, acceleration=5.0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(found.to_csv(f"{folder}/motion.csv").read_text().splitlines()[0])
        time,hinge,hinge.vel,hinge.acc
        """
        return self.motion.to_csv(path, degrees=degrees)


def exciting_trajectory(
    robot: Robot,
    duration: float = 20.0,
    harmonics: int = 5,
    *,
    share: float = 0.9,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    floor: float | None = None,
    clear: Clear | None = None,
    motor_inertia: bool = True,
    friction: Sequence[str] = ("viscous", "coulomb", "offset"),
    friction_speed: float = 0.05,
    noise: ArrayLike | None = None,
    seed: int = 0,
    restarts: int = 1,
    step: float = 0.01,
    progress: Callable[[float], None] | None = None,
) -> ExcitingMotion:
    """Exciting motion: a Fourier series at rest at both ends whose log tells most of the base parameters.

    Parameters
    ----------
    robot : Robot
        As for :func:`identify`: without actuators, every joint of one degree of freedom.
    duration : float, T, the period of the first harmonic [s]
    harmonics : int, N
    share : float, up to 1, of the limits of positions (about their middle), velocities and torques that is used
    velocity : (nv,) array_like or float, optional, limits in place of the robot's [rad/s, m/s]
    acceleration : (nv,) array_like or float, optional, limits, used wholly [rad/s², m/s²]
    effort : (nv,) array_like or float, optional, limits in place of the robot's [N m, sliding joints: N]
    floor : float, optional, height in the base frame that no moving link's origin goes below [m]
    clear : callable, optional
        Given configurations (n, nq), tells distances (n, ...) [m], below 0 where something touches.
    motor_inertia : bool, whether each joint has a motor's inertia besides its bodies
    friction : sequence of str, of ``viscous``, ``coulomb``, ``offset``, that will be identified
    friction_speed : float, speed at which Coulomb friction turns [rad/s, m/s]
    noise : (nv,) array_like or float, optional
        Deviation of the torques [N m, sliding joints: N]; None: a hundredth of each limit, 1 where there is none.
    seed : int, of the random motions that the search begins with
    restarts : int, how often it begins anew; the best of all is taken
    step : float, between samples of the motion [s]
    progress : callable, optional, told the share that is done

    Returns
    -------
    found : ExcitingMotion

    Raises
    ------
    ModelError
        A joint has several degrees of freedom, or the robot has actuators.
    ShapeError, ValueRangeError
        An argument is out of range, nothing limits a joint, or no motion keeps all limits.

    Notes
    -----
    Limits are kept at 320 instants per period of the highest harmonic, the file's friction counted. Whether links touch each
    other is not looked at, unless ``clear`` tells; see the page on identification.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> found = tw.identification.exciting_trajectory(arm, 8.0, 3, velocity=2.0, acceleration=8.0, effort=60.0)
    >>> found.motion.violations(tw.trajectories.bounds_of(arm, velocity=2.0, acceleration=8.0, effort=60.0))
    ()
    """
    require_robot(robot, "exciting_trajectory")
    unknown = UnknownParameters(robot, arguments.flag(motor_inertia, "motor_inertia"), tuple(friction))
    height = None if floor is None else arguments.number(floor, "floor")
    if height is not None and not np.isfinite(height):
        raise ValueRangeError(f"floor is {height}: give a height [m], or none.")
    rng = arguments.generator(seed, "seed")
    search = _search(
        robot,
        RestSeries(arguments.positive(duration, "duration", "s"), _harmonics(harmonics)),
        _bounds(robot, share, velocity, acceleration, effort),
        BaseParameters.of(unknown),
        np.full(robot.nv, check_speed(arguments.number(friction_speed, "friction_speed"))),
        _noise(robot, noise),
        height,
        clear,
    )
    times = arguments.whole(restarts, "restarts")
    step = arguments.positive(step, "step", "s")
    if step > search.series.duration / 20:
        raise ValueRangeError(
            f"step is {step:g} s: a motion of {search.series.duration:g} s needs 20 samples at least."
        )
    tell = progress or (lambda _share: None)
    best: Array | None = None
    for k in range(times):
        z = search.best(rng, lambda done, k=k: tell((k + done) / times))  # type: ignore[misc]
        if z is not None and (best is None or search.log_det(z) > search.log_det(best)):
            best = z
    if best is None:
        raise ValueRangeError(
            f"no motion of {robot.name!r} keeps all limits: it cannot hold itself within {share:g} of its torques, above the "
            "floor and clear of things, near any of many random configurations. Give a larger share or a lower floor."
        )
    return ExcitingMotion(robot, search.series, search.coefficients(best), search.room.bounds, search.information, step)


def _search(
    robot: Robot,
    series: RestSeries,
    bounds: Bounds,
    base: BaseParameters,
    friction_speed: Array,
    noise: Array,
    floor: float | None,
    clear: Clear | None,
) -> MotionSearch:
    if clear is not None and not callable(clear):
        raise ValueRangeError(
            f"clear is {arguments.shown(clear)}: give a function of configurations that tells distances."
        )
    turning = np.array([b.joint.turning[0] for b in robot.model.leaders])
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    rate = 2.0 * np.pi * series.harmonics / series.duration
    wide = np.where(both, half, np.where(turning, np.pi, 1.0))
    fast = np.minimum(bounds.velocity, wide * rate)
    typical = np.stack([wide, fast, np.minimum(bounds.acceleration, fast * rate)])
    return MotionSearch(
        series,
        MotionInformation(base, noise, friction_speed, series.duration),
        MotionRoom(robot, bounds, friction_speed, floor, clear),
        typical,
        np.where(both, middle, np.clip(0.0, bounds.lower, bounds.upper)),
    )


def _harmonics(harmonics: int) -> int:
    count = arguments.whole(harmonics, "harmonics")
    if count > _MOST_HARMONICS:
        raise ValueRangeError(f"harmonics is {count}: give {_MOST_HARMONICS} at most.")
    return count


def _bounds(
    robot: Robot,
    share: float,
    velocity: ArrayLike | None,
    acceleration: ArrayLike | None,
    effort: ArrayLike | None,
) -> Bounds:
    """The limits to keep, of which each joint has one at least that bounds how far it goes."""
    if not arguments.positive(share, "share") <= 1.0:
        raise ValueRangeError(f"share is {share:g}: give a share of the robot's limits, above 0 and at most 1.")
    bounds = shared_bounds(bounds_of(robot, velocity=velocity, acceleration=acceleration, effort=effort), share)
    names = np.array(robot.model.velocity_names)
    still = (bounds.upper - bounds.lower <= 0) | (bounds.velocity <= 0) | (bounds.effort <= 0)
    if still.any():
        raise ValueRangeError(
            f"joint {names[still][0]!r} has no room to move: its limits of position are one, or another is 0. "
            "Lock it: robot.lock({name: position})."
        )
    free = ~np.isfinite(bounds.upper - bounds.lower) & np.isinf(bounds.velocity) & np.isinf(bounds.acceleration)
    if free.any():
        raise ValueRangeError(
            f"nothing limits how far and how fast joint {names[free][0]!r} of {robot.name!r} moves. Give acceleration=…, or "
            "limits of velocity in its file."
        )
    return bounds


def _noise(robot: Robot, noise: ArrayLike | None) -> Array:
    if noise is None:
        effort = robot.limits.effort
        return np.where(np.isfinite(effort) & (effort > 0), _NOISE * effort, 1.0)
    given = np.asarray(arguments.finite(noise, "noise", names=robot.model.velocity_names), float)
    if given.shape not in ((), (robot.nv,)):
        raise ShapeError(f"noise has shape {given.shape}: give one number, or {robot.nv}, one for each joint.")
    if not (given > 0).all():
        raise ValueRangeError("noise has a deviation that is not above 0. Give those of the torques [N m, N].")
    return np.broadcast_to(given, (robot.nv,)).copy()
