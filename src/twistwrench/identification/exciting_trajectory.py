"""Exciting motions, at rest at both ends, and the accuracy that :func:`identify` is expected to reach with their logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.blas_threads import one_blas_thread
from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, percent, printed
from ..core.text import argument
from ..core.typing import Array, Metres, Seconds
from ..core.verdict import Verdict
from ..mechanics.model.couplings import refuse_couplings
from ..mechanics.model.limits import Limits
from ..motion.bounds import bounds_of
from ..motion.limits_file import robot_origin
from ..motion.motion import Motion
from ..robot import Robot, load
from ..robot.base import require_robot
from ..robot.doors import clearance_along
from ..shapes.capsules import CapsuleDistances, LinkCapsules
from .excitation.fourier_series import WindowedFourierSeries
from .excitation.motion_information import CRITERIA, Criterion, MotionInformation
from .excitation.trajectory_constraints import MAX_CHECK_STEP, Clear, TrajectoryConstraints, shared_bounds
from .excitation.trajectory_search import MotionSearch, typical_sizes
from .parameters import FRICTION, BaseParameters, FrictionLaws, UnknownParameters, check_speed

if TYPE_CHECKING:
    from ..core.answers.page import Picture, Setting, Viewer
    from ..statics.clearance import PathClearance

_MIN_CHECKED_INSTANTS = 2001
"""Smallest number of instants at which the finished motion is evaluated."""
_MIN_INTERVALS = 6
"""Smallest number of intervals between samples of a motion."""


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion(Answer):
    """Exciting motion of one robot, at rest at both ends: result of :func:`twistwrench.excite`.

    It has the accuracy that an identification by a log of the motion is expected to reach.

    Attributes
    ----------
    robot : Robot
    series : WindowedFourierSeries, basis functions of time
    coefficients : (nv, 1 + 2 N) array, of the series [rad, m]
    constraints : TrajectoryConstraints, kept by the motion, including the used share of the robot's limits
    information : MotionInformation, objective of the search
    step : float, between samples of :attr:`motion` [s]
    clearance : PathClearance or None, least distance between links, if it was asked for
    degrees : bool, True if angles of the report are in degrees

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = tw.excite("planar_2r", 4.0, 1, acceleration=3.0, restarts=1)
    >>> found.verdict.ok, found.facts()["duration"], list(found.sources()), str(next(found.blocks()).word)
    (False, '4 s', ['ROBOT'], 'UNSURE')
    >>> [picture.title for picture in found.pictures()]  # doctest: +SKIP
    ['Motion and limits']
    """

    call: ClassVar[str] = "excite"

    robot: Robot
    series: WindowedFourierSeries
    coefficients: Array
    constraints: TrajectoryConstraints
    information: MotionInformation
    step: float
    clearance: PathClearance | None = None
    degrees: bool = False

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def brief(self) -> str:
        """Duration, harmonics and condition."""
        return f"{number(self.duration)} s, {self.series.harmonics} harmonics, condition {number(self.condition)}"

    @property
    def bounds(self) -> Limits:
        """Limits of the motion, after the share was applied to the robot's."""
        return self.constraints.bounds

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return self.series.duration

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """q, dq and ddq (..., nv) at t (...) [s]; the robot rests before the beginning and after the end."""
        times = np.asarray(arguments.finite(t, "t"), float)
        q, dq, ddq = self.series.basis(times.ravel()) @ self.coefficients.T
        return q.reshape(*times.shape, -1), dq.reshape(*times.shape, -1), ddq.reshape(*times.shape, -1)

    @cached_property
    def motion(self) -> Motion:
        """Samples of the motion for ``torques``, ``view`` and ``simulate``."""
        interval_count = max(_MIN_INTERVALS, round(self.duration / self.step))
        t = np.linspace(0.0, self.duration, interval_count + 1)
        return Motion(t, *self(t), robot=self.robot, in_seconds=True, friction=True, plan=True)

    @cached_property
    def _rows(self) -> Array:
        """(n, nv, r) columns of the base parameters along the motion."""
        t = np.linspace(0.0, self.duration, _MIN_CHECKED_INSTANTS)
        return self.information.rows(*self(t))

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return self.information.base.names

    @cached_property
    def predicted_deviations(self) -> Array:
        """(r,) expected standard deviations of the base parameters at the given torque noise, with 25 rows per second."""
        return self.information.deviations(self._rows)

    @cached_property
    def shares_of_prior(self) -> Array:
        """(r,) predicted deviations divided by the prior's, the largest plausible sizes of the base parameters."""
        return self.predicted_deviations / self.information.prior

    @property
    def worst(self) -> tuple[str, float]:
        """Base parameter with the largest share of the prior's deviation, and that share."""
        k = int(self.shares_of_prior.argmax())
        return self.groups[k], float(self.shares_of_prior[k])

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
        q, dq, ddq = self(np.linspace(0.0, self.duration, _MIN_CHECKED_INSTANTS))
        tau = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=True))
        return {
            "lower": q.min(axis=0),
            "upper": q.max(axis=0),
            "velocity": np.abs(dq).max(axis=0),
            "acceleration": np.abs(ddq).max(axis=0),
            "torque": np.abs(tau).max(axis=0),
        }

    @cached_property
    def clearances(self) -> dict[str, float]:
        """Least distances [m] of the capsules from the ``floor`` and from each other (``itself``), if they were checked."""
        capsules = self.constraints.capsules
        required_steps = int(np.ceil(self.duration / MAX_CHECK_STEP))
        instant_count = max(_MIN_CHECKED_INSTANTS, required_steps + 1)
        q, _, _ = self(np.linspace(0.0, self.duration, instant_count))
        distances, _ = capsules.evaluate(q)  # between links, then to the floor
        link_distances, floor_distances = np.split(distances, [len(capsules.pairs)], axis=1)
        least_distances: dict[str, float] = {}
        if link_distances.size:
            least_distances["itself"] = float(link_distances.min())
        if floor_distances.size:
            least_distances["floor"] = float(floor_distances.min())
        return least_distances

    @property
    def unwatched(self) -> tuple[str, ...]:
        """Sentences on clearances that were not checked."""
        capsules = self.constraints.capsules
        checks_links = capsules.itself or self.constraints.clear is not None
        if checks_links:
            return capsules.unwatched
        return ("distances of links from each other", *capsules.unwatched)

    @cached_property
    def verdict(self) -> Verdict:
        """OK only if clearances were checked with the shapes of the robot file; otherwise UNSURE.

        If the least distance between links was asked for, it may make the verdict COLLISION or OVER LIMIT.
        """
        capsules = self.constraints.capsules.capsules
        reasons = list[str]()
        if capsules.assumed and (self.clearances or self.unwatched):
            reasons.append(capsules.assumption)
        reasons += [f"not looked at: {sentence}" for sentence in self.unwatched]
        for name, distance in self.clearances.items():
            if distance <= 0.0:
                obstacle = name.replace("floor", "the floor")
                reasons.append(f"it comes to {number(1000.0 * distance)} mm from {obstacle}")
        verdict = Verdict.from_reasons(unsure=reasons)
        if self.clearance is None:
            return verdict
        return verdict.joined(self.clearance.verdict)

    # ── The answer on every surface

    def blocks(self) -> Iterator[Block]:
        """Verdict, least distances, a row for each joint, and what a log of the motion determines."""
        from .views.exciting_motion import excitation_view

        return excitation_view(self)

    def facts(self) -> Mapping[str, str]:
        """Duration, harmonics and the worst group.

        Returns
        -------
        facts : {name: text}
        """
        group, share = self.worst
        return {
            "duration": f"{number(self.duration)} s",
            "harmonics": str(self.series.harmonics),
            "worst group": f"{group}, {percent(share, 2)} of the prior's deviation",
        }

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.robot.model.source}

    def origin(self) -> Iterator[Setting]:
        """Robot with its joints.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.robot)

    def pictures(self) -> Iterable[Picture]:
        """Picture of the motion; none if matplotlib is not installed.

        Returns
        -------
        pictures : iterable of Picture
        """
        from .pictures import excitation_plots, pictures_of_plots

        return pictures_of_plots(excitation_plots(self))

    def viewer(self) -> Viewer | None:
        """Robot that follows the motion.

        Returns
        -------
        viewer : Viewer
        """
        from ..reports.drawn_motion import motion_of
        from ..viz.page import viewer_page

        drawn_motion = replace(motion_of(self.robot, self.motion), judged=False)
        return viewer_page(self.robot, motion=drawn_motion, embed=True)

    def plot(self, kind: str | Path | None = None, path: str | Path | None = None) -> Any:
        """Draw velocities and torques of the motion relative to their limits.

        Parameters
        ----------
        kind : "motion", or a file name
        path : str or Path, optional, file to write (.png, .pdf, .svg)

        Returns
        -------
        figure : matplotlib figure, or Path of the written file

        Raises
        ------
        MissingExtraError
            matplotlib is not installed.
        """
        from ..viz.answers import plot_one_of
        from .pictures import excitation_plots

        return plot_one_of(excitation_plots(self), self, kind, path)

    def to_csv(self, path: str | Path, *, degrees: bool | None = None) -> Path:
        """Write a CSV file that ``twistwrench torques`` reads.

        Parameters
        ----------
        degrees : bool, optional, angles in degrees; default: as in the report

        Raises
        ------
        ValueRangeError
            The file cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> found = tw.identification.exciting_trajectory(tw.robots.pendulum(), 4.0, 2, acceleration=5.0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(found.to_csv(f"{folder}/motion.csv").read_text().splitlines()[0])
        time,hinge,hinge.vel,hinge.acc
        """
        return self.motion.to_csv(path, degrees=self.degrees if degrees is None else degrees)


# ── Exciting trajectories: motions that determine the base parameters best within all limits

_NOISE_SHARE = 0.01
"""Default noise of a joint's torque, as a share of its limit."""
_MAX_HARMONICS = 50
"""Largest number of harmonics."""
_MIN_SAMPLES = 20
"""Smallest number of samples that a motion must have for its step to be accepted."""


def exciting_trajectory(
    robot: Robot | str | Path,
    duration: Seconds = 20.0,
    harmonics: int = 5,
    *,
    share: float = 0.9,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    floor: float | None = None,
    clear_of_itself: bool = True,
    clear: Clear | None = None,
    motor_inertia: bool = True,
    friction: FrictionLaws = FRICTION,
    friction_speed: float = 0.05,
    noise: ArrayLike | None = None,
    criterion: Criterion = "log_det",
    seed: int = 0,
    restarts: int = 3,
    step: Seconds = 0.01,
    clearance: Metres | None = None,
    srdf: str | Path | None = None,
    degrees: bool = False,
    progress: Callable[[float], None] | None = None,
) -> ExcitingMotion:
    """Exciting motion: a Fourier series at rest at both ends whose log determines the base parameters best.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
        As for :func:`identify`: without actuators, every joint of one degree of freedom.
    duration : float, duration, one period of the first harmonic [s]
    harmonics : int, number of harmonics of the Fourier series
    share : float
        Fraction of each limit that may be used: of positions about their middle, velocities and torques.
    velocity : (nv,) array_like or float, optional, limits in place of the robot's [rad/s, m/s]
    acceleration : (nv,) array_like or float, optional
        Acceleration limit of every joint [rad/s², m/s²], used fully.
    effort : (nv,) array_like or float, optional, limits in place of the robot's [N m, sliding joints: N]
    floor : float, optional, lowest height of the moving links in the base frame [m]
    clear_of_itself : bool, keep links that are not connected by a joint apart
    clear : callable, optional
        Given configurations (n, nq), returns distances (n, ...) [m], below 0 in contact.
    motor_inertia : bool, include a motor inertia for each joint
    friction : sequence of str, of ``viscous``, ``coulomb``, ``offset``, that will be identified
    friction_speed : float, Coulomb smoothing speed [rad/s, m/s]
    noise : (nv,) array_like or float, optional
        Standard deviation of the torques [N m, sliding joints: N]; None: 1 % of each limit, 1 without a limit.
    criterion : "log_det" or "deviations"
        Objective: "log_det" maximises log det of the information, minus r / 2 times the log of the largest of the r
        ratios of predicted deviation to prior deviation. "deviations" minimises the median of the predicted deviations.
    seed : int, seed of the random initial motions
    restarts : int, number of searches; only the best is refined
    step : float, time between samples of the motion [s]
    clearance : float, optional
        Check the least distance between links [m].
    srdf : path, optional
        Ignore the pairs of links of <disable_collisions> in the check of the clearance.
    degrees : bool, angles of the report and of its CSV file are in degrees
    progress : callable, optional, called with the completed share

    Raises
    ------
    ModelError
        A joint has several degrees of freedom, or the robot has actuators.

    Notes
    -----
    Limits are checked at 320 instants per period of the highest harmonic, and at least every 10 ms, with the file's
    friction. Links are capsules around the collision shapes of the robot file, or around the visual shapes if there are
    none. The capsules keep a distance of 20 mm from each other and from the floor. Links without shapes get assumed
    capsules between the origins of neighbouring joints and around centres of mass. Their radius is a quarter of the
    longest distance between joints, at most 0.08 m. :attr:`ExcitingMotion.verdict` is then UNSURE, and also if
    :attr:`ExcitingMotion.unwatched` lists clearances that were not checked.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> found = tw.identification.exciting_trajectory(arm, 8.0, 3, velocity=2.0, acceleration=8.0, effort=60.0)
    >>> found.motion.violations(tw.trajectories.bounds_of(arm, velocity=2.0, acceleration=8.0, effort=60.0))
    ()
    """
    robot = require_robot(load(robot) if isinstance(robot, str | Path) else robot, "exciting_trajectory")
    _check_clearances(clear, clearance, srdf)
    refuse_couplings(robot.model, "exciting_trajectory")
    unknown = UnknownParameters(robot, arguments.flag(motor_inertia, "motor_inertia"), tuple(friction))
    rng = arguments.generator(seed, "seed")
    duration = arguments.positive(duration, "duration", "s")
    series = WindowedFourierSeries(duration, arguments.whole(harmonics, "harmonics"))
    if series.harmonics > _MAX_HARMONICS:
        raise ValueRangeError(f"harmonics is {series.harmonics}: give {_MAX_HARMONICS} at most.")
    bounds = _bounds(robot, share, velocity, acceleration, effort)
    friction_speed = check_speed(arguments.number(friction_speed, "friction_speed"))
    friction_speeds = np.full(robot.nv, friction_speed)
    if criterion not in CRITERIA:
        raise UnknownNameError.from_choices("criterion", criterion, CRITERIA)
    base = BaseParameters.from_unknowns(unknown)
    typical_motion, middle = typical_sizes(robot, bounds, series)
    _, typical_velocity, typical_acceleration = typical_motion
    torque_noise = _torque_noise(robot, noise)
    typical_torque = np.where(np.isfinite(bounds.effort), bounds.effort, torque_noise / _NOISE_SHARE)
    prior = base.weak_sizes(unknown.scales(typical_torque, typical_velocity, typical_acceleration))
    information = MotionInformation(base, torque_noise, friction_speeds, series.duration, prior, criterion)
    capsules = _capsules(robot, floor, clear_of_itself)
    constraints = TrajectoryConstraints(robot, bounds, friction_speeds, capsules, clear)
    search = MotionSearch(series, information, constraints, typical_motion, middle)
    search_count = arguments.whole(restarts, "restarts")
    step = arguments.positive(step, "step", "s")
    if step > series.duration / _MIN_SAMPLES:
        raise ValueRangeError(
            f"step is {printed(step)} s: a motion of {printed(series.duration)} s needs {_MIN_SAMPLES} samples at least."
        )
    coefficients = _best_coefficients(search, search_count, rng, progress, share)
    found = ExcitingMotion(robot, series, coefficients, constraints, information, step, degrees=degrees)
    states = [(found.motion.time, found.motion.q)]
    return replace(found, clearance=clearance_along(robot, states, clearance, srdf))


excite = exciting_trajectory
"""Function of the command ``excite``, with the command's name."""


def _check_clearances(clear: Clear | None, clearance: float | None, srdf: str | Path | None) -> None:
    """Raise ValueRangeError for options of clearances that are not valid or have no effect."""
    if clear is not None and not callable(clear):
        raise ValueRangeError(
            f"clear is {arguments.value_text(clear)}: give a function that maps configurations to distances."
        )
    arguments.refuse_unused_srdf(clearance, srdf)


def _best_coefficients(
    search: MotionSearch,
    restarts: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] | None,
    share: float,
) -> Array:
    """Coefficients of the best motion; raises ValueRangeError if none keeps all limits."""
    with one_blas_thread():  # matrices of tens of rows: further threads only wait
        best = search.best(restarts, rng, progress or (lambda _share: None))
    if best is None:
        raise ValueRangeError(
            f"no motion of {search.constraints.robot.name!r} keeps all limits: it cannot hold itself within {printed(share)} "
            "of its torques, above the floor and clear of things, near any of many random configurations. Give a larger share "
            "or a lower floor."
        )
    return search.coefficients(best)


def _capsules(robot: Robot, floor: float | None, clear_of_itself: bool) -> CapsuleDistances:
    """Distances of the links' capsules that the motion keeps; raises ValueRangeError for a floor without a height."""
    height = None
    if floor is not None:
        height = arguments.number(floor, "floor")
        if not np.isfinite(height):
            raise ValueRangeError(f"floor is {height}: give a height [m], or none.")
    checks_links = arguments.flag(clear_of_itself, "clear_of_itself")
    capsules = LinkCapsules.from_robot(robot)
    return CapsuleDistances.from_capsules(robot, capsules, floor=height, itself=checks_links)


def _bounds(
    robot: Robot,
    share: float,
    velocity: ArrayLike | None,
    acceleration: ArrayLike | None,
    effort: ArrayLike | None,
) -> Limits:
    """Limits of the search; each joint must have at least one limit that bounds its range."""
    if not arguments.positive(share, "share") <= 1.0:
        raise ValueRangeError(f"share is {printed(share)}: give a share of the robot's limits, above 0 and at most 1.")
    full_bounds = bounds_of(robot, velocity=velocity, acceleration=acceleration, effort=effort)
    bounds = shared_bounds(full_bounds, share)
    names = robot.model.velocity_names
    is_fixed = (bounds.upper - bounds.lower <= 0) | (bounds.velocity <= 0) | (bounds.effort <= 0)
    if is_fixed.any():
        first_fixed = names[int(is_fixed.argmax())]
        raise ValueRangeError(
            f"joint {first_fixed!r} has no room to move: its limits of position are one, or another is 0. "
            "Lock it: robot.lock({name: position})."
        )
    has_no_range = ~np.isfinite(bounds.upper - bounds.lower)
    is_unlimited = has_no_range & np.isinf(bounds.velocity) & np.isinf(bounds.acceleration)
    if is_unlimited.any():
        first_unlimited = names[int(is_unlimited.argmax())]
        raise ValueRangeError(
            f"nothing limits how far and how fast joint {first_unlimited!r} of {robot.name!r} moves. Give "
            f"{argument('acceleration')}, or limits of velocity in its file."
        )
    return bounds


def _torque_noise(robot: Robot, noise: ArrayLike | None) -> Array:
    """(nv,) standard deviations of the torques, given or by default; raises ShapeError or ValueRangeError."""
    if noise is None:
        effort = robot.limits.effort
        has_limit = np.isfinite(effort) & (effort > 0)
        return np.where(has_limit, _NOISE_SHARE * effort, 1.0)
    deviations = np.asarray(arguments.finite(noise, "noise", names=robot.model.velocity_names), float)
    if deviations.shape not in ((), (robot.nv,)):
        raise ShapeError(f"noise has shape {deviations.shape}: give one number, or {robot.nv}, one for each joint.")
    if not (deviations > 0).all():
        raise ValueRangeError("noise has a deviation that is not above 0. Give those of the torques [N m, N].")
    return np.broadcast_to(deviations, (robot.nv,)).copy()


complete(globals())
