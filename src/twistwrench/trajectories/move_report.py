"""Function of the command ``move``: a motion between two configurations, its timing, and the verdict on it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt
from ..core.errors import ConstraintWarning, PathError, TwistWrenchError, ValueRangeError
from ..core.numbers import number, over_limit, printed
from ..core.text import Argument, argument
from ..core.typing import Array, Metres, Seconds, Vector
from ..core.verdict import Verdict, Word
from ..mechanics.algorithms.time_scalings import cubic, quintic, s_curve, screw_path, straight_path, trapezoid
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import coupled_entries, drive_turns, motor_torques, motor_velocities
from ..mechanics.model.limits import Limits
from ..motion import limits_file
from ..motion.bounds import Violation, bounds_of
from ..motion.coordinates import ConfigurationGiven, Coordinates, configuration_of, degrees_hint
from ..motion.credible_values import credible_limits
from ..motion.limits_file import robot_origin
from ..motion.load_case import LoadCase, LoadsGiven, limit_doubts, payloads_of
from ..motion.model_doubts import assumed_words, assumptions, base_doubts, hanging_excess, model_warnings
from ..motion.motion import Motion
from ..motion.readers.csv_reader import CsvFile, table_errors
from ..robot import Robot, load
from ..robot.doors import clearance_along
from .fastest import Fastest
from .fastest import fastest as fastest_timing
from .paths import JointPath, follow_poses, joint_line, spline
from .trajectory import Trajectory, fitted, required_torques

if TYPE_CHECKING:
    from ..core.answers.page import Setting
    from ..robot.doors import PathClearance

Paths: TypeAlias = Literal["joint", "line", "screw"]
"""Straight line of the joints, straight line of the tip, or its screw."""
Scalings: TypeAlias = Literal["quintic", "cubic", "trapezoid", "s-curve"]
"""Time scalings along the path."""
SAMPLES = 2001
"""Number of times at which a motion is judged."""
STEP = 0.002
"""Time between rows of a written motion [s]."""


@dataclass(frozen=True, eq=False, repr=False)
class MoveReport(Answer):
    """Planned motion with its verdict: result of :func:`twistwrench.move`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> answer = tw.move(tw.robots.ur5(), [0.9, -0.9, 1.0, -0.4, 1.2, 1.0], fastest=True)
    >>> answer.verdict.ok, answer.trajectory.duration == float(answer.motion.time[-1])
    (True, True)
    >>> dict(answer.facts()), answer.brief, len(list(answer.blocks())), answer.sources()["ROBOT"].endswith("ur5.urdf")
    ({'duration': '0.4339 s'}, '0.4339 s', 5, True)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     answer.to_csv(f"{folder}/move.csv").read_text().partition(",")[0]
    'time'
    """

    call: ClassVar[str] = "move"

    load: LoadCase
    """Robot with its payload."""
    limits: Limits
    """Limits of the comparison."""
    trajectory: Trajectory | None
    """Path and timing; until where the robot can follow, if the path ends early. None if there is none."""
    refused: Verdict | None = None
    """Why there is no trajectory; None with one."""
    early_end: str = ""
    """Why the path ends early; empty if it does not."""
    clearance: PathClearance | None = None
    """Least distance between links; None without ``clearance``."""
    hints: tuple[str, ...] = ()
    """Sentences on coordinates and payloads that may be in another unit."""
    asked: frozenset[str] = frozenset()
    """Kinds of limits that were given as one number, ``acceleration`` or ``jerk``."""
    limits_file: str = ""
    """File of the limits; empty if they are the robot's, or given as numbers."""
    degrees: bool = False
    """True if angles of the report are in degrees."""
    step: float = STEP
    """Time between rows of the written motion [s]."""

    @property
    def robot(self) -> Robot:
        """Robot with its payload."""
        return self.load.with_load

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def friction(self) -> bool:
        """True if the motion was planned with joint friction."""
        return self.load.friction and self.robot.model.friction.any

    @property
    def motion(self) -> Motion | None:
        """Samples of the trajectory every 2 ms; None without one."""
        return None if self.trajectory is None else self.trajectory.sample(STEP)

    @property
    def subject(self) -> str:
        """Robot and path."""
        if self.trajectory is not None:
            return f"{self.robot_name} · {self.trajectory.path.name}"
        contradicts = self.refused is not None and self.refused.word is Word.LOOK_AGAIN
        return "contradictory input" if contradicts else "no path"

    @property
    def brief(self) -> str:
        """Duration."""
        return "" if self.trajectory is None else f"{number(self.trajectory.duration, 6)} s"

    # ── The verdict

    @cached_property
    def uses(self) -> list[JointUse]:
        """Peaks of each joint or coupled motor; empty without a trajectory."""
        return [] if self.trajectory is None else joint_uses(self.trajectory, self.limits, friction=self.friction)

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """Limits that the motion exceeds for certain, worst first."""
        return self._violations_and_doubts[0]

    @cached_property
    def _violations_and_doubts(self) -> tuple[tuple[Violation, ...], list[str]]:
        if self.trajectory is None:
            return (), []
        return _certain(self.trajectory.violations(self.limits, friction=self.friction), self.robot)

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to be unsure, sentences without a full stop."""
        doubts = list(self._violations_and_doubts[1])
        doubts += [str(each) for each in _input_doubts(self.load, self.limits) if not each.refuses]
        doubts += limit_doubts(self.load.robot, self.limits, [use.peak for use in self.uses])
        doubts += model_warnings(self.robot.model, self.uses)
        if self.clearance is not None and self.clearance.verdict.word is Word.UNSURE:
            doubts += self.clearance.verdict.reasons
        return tuple(doubts)

    @property
    def near(self) -> Verdict | None:
        """Verdict on the distance between links if it is certainly too small; None otherwise."""
        if self.clearance is None or self.clearance.verdict.word in (Word.OK, Word.UNSURE):
            return None
        return self.clearance.verdict

    @property
    def assumed(self) -> str:
        """Text with the assumptions of the verdict; empty if there are none."""
        return assumed_words(assumptions(self.robot.model, self.load.payloads, friction=self.load.friction))

    @cached_property
    def verdict(self) -> Verdict:
        """COLLISION, OVER LIMIT, STOPPED where the robot cannot follow the path, LOOK AGAIN, UNSURE, or OK."""
        if self.refused is not None:
            return self.refused
        if self.near is not None:
            return self.near
        if self.early_end:
            return Verdict(Word.STOPPED, (self.early_end,))
        return Verdict.from_reasons(over=[str(each) for each in self.violations], unsure=list(self.doubts))

    # ── The answer on every surface

    def blocks(self) -> Iterator[Block]:
        """Verdict, peaks of each joint, limits of the fastest motion over time, and remarks."""
        from .move_view import move_view

        return move_view(self)

    def facts(self) -> Mapping[str, str]:
        """Duration.

        Returns
        -------
        facts : {name: text}
        """
        return {} if self.trajectory is None else {"duration": self.brief}

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the robot and of the limits.

        Returns
        -------
        files : {argument: path}
        """
        limits = {"limits": self.limits_file} if self.limits_file else {}
        return {"ROBOT": self.robot.model.source, **limits}

    def origin(self) -> Iterator[Setting]:
        """Robot, and the limits used.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.robot, self.limits, degrees=self.degrees)

    def to_csv(self, path: str | Path, step: float | None = None) -> Path:
        """Write time, q, dq and ddq at a step, as read by :func:`twistwrench.check`; angles in degrees if the report's are.

        Parameters
        ----------
        path : str or Path
        step : float, optional, time between rows [s]; default: that of the report

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            There is no trajectory, or the file cannot be written.
        """
        if self.trajectory is None:
            raise ValueRangeError(f"there is no motion to write. {self.verdict}.")
        return self.trajectory.to_csv(path, self.step if step is None else step, degrees=self.degrees)


def move(
    robot: Robot | str | Path,
    to: ConfigurationGiven = None,
    *,
    start: ConfigurationGiven = None,
    by: Vector | None = None,
    waypoints: str | Path | ArrayLike | None = None,
    path: Paths = "joint",
    fastest: bool = False,
    scaling: Scalings = "quintic",
    duration: Seconds | None = None,
    payload: LoadsGiven = (),
    limits: limits_file.Given = None,
    acceleration: float | None = None,
    jerk: float | None = None,
    friction: bool = True,
    clearance: Metres | None = None,
    srdf: str | Path | None = None,
    step: Seconds = STEP,
    degrees: bool = False,
) -> MoveReport:
    """Plan a motion between two configurations and judge it: in joint space, at the tip, or through waypoints.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    to : (nq,) array, {joint: position}, name of a configuration, or texts of these [rad, m]
        End configuration: all coordinates, a configuration of the file by its name, or the position of a joint, the others
        as at the start.
    start : configuration in the same forms, optional
        Start configuration, in the form of ``to``; default: neutral.
    by : (3,) array_like, optional
        Move the tip in a straight line by this vector [m], in base axes, in place of ``to``.
    waypoints : (m, nq) array_like, or path of a file with one row each, optional
        Intermediate configurations, one per row, joints as columns.
    path : "joint", "line" or "screw"
        Path between the ends: straight line of the joints, straight line of the tip, or constant screw of the tip.
    fastest : bool
        Use the fastest timing within all limits; with jerk limits, a short one.
    scaling : "quintic", "cubic", "trapezoid" or "s-curve"
        Time scaling along the path.
    duration : float, optional
        Duration [s]; default: the shortest within all limits.
    payload : float [kg], "kg,x,y,z@frame", SpatialInertia in the axes of its frame, {frame: one of these}, or a list
        Mass attached to the robot's tip, or to a named frame, with its centre of mass there [kg, m].
    limits : path of a limits file, Limits, {joint: effort} [N m or N], or {kind: (nv,) array}, optional
        Limits of the joints, in place of the robot file's; the table of :func:`info` is a template.
    acceleration : float, optional
        Acceleration limit of every joint [rad/s², m/s²].
    jerk : float, optional
        Jerk limit of every joint [rad/s³, m/s³].
    friction : bool, count joint friction and damping
    clearance : float, optional
        Check the least distance between links [m].
    srdf : path, optional
        Ignore the pairs of links of <disable_collisions> in the check of the clearance.
    step : float
        Time between rows of the written motion [s].
    degrees : bool, angles of configurations, of files and of the answer are in degrees

    Returns
    -------
    report : MoveReport
        ``report.verdict``, ``report.motion``, ``report.trajectory``, ``report.plot()``.

    Raises
    ------
    NotFoundError, ShapeError, UnknownNameError, ValueRangeError
        An argument cannot be read, or two of them contradict each other.

    Examples
    --------
    >>> import twistwrench as tw
    >>> answer = tw.move("ur5", {"elbow_joint": 1.0}, payload=3)
    >>> answer
    <MoveReport of ur5: OK, 0.596831 s>
    >>> print(tw.move("ur5", {"elbow_joint": 1.0}, payload=40).verdict.word)
    OVER LIMIT
    """
    if not step > 0:
        raise ValueRangeError(f"{argument('step')} is {printed(step)}. Give seconds above zero.")
    if fastest and duration is not None:
        raise ValueRangeError(
            f"{argument('fastest', True)} computes the duration, and {argument('duration')} sets it. Leave one of them out."
        )
    arguments.refuse_unused_srdf(clearance, srdf)
    loads = LoadCase(robot if isinstance(robot, Robot) else load(robot), payloads_of(payload), friction=friction)
    arm = loads.with_load
    bounds = _bounds(arm, limits_file.limits_of(limits, arm.model, degrees=degrees), acceleration, jerk)
    q0 = configuration_of(arm, start, degrees=degrees, what=Argument("start", option="from"))
    q1 = configuration_of(arm, to, degrees=degrees, what=Argument("to"), start=q0)
    ends = (("start", start, q0), ("to", to, q1))
    end_hints = [(name, degrees_hint(arm, q)) for name, configuration, q in ends if configuration is not None]
    hints = [f"{name}: {hint}" for name, hint in end_hints if hint]
    kinds = (("acceleration", acceleration), ("jerk", jerk))
    report = MoveReport(
        loads, bounds, None, hints=(*hints, *loads.unit_hints), degrees=degrees,
        asked=frozenset(kind for kind, value in kinds if value is not None),
        limits_file=str(limits) if isinstance(limits, str | Path) else "", step=step,
    )  # fmt: skip
    if contradictory := [str(each) for each in _input_doubts(loads, bounds) if each.refuses]:
        return replace(report, refused=Verdict.from_reasons(look_again=contradictory), hints=())
    _check_path(to, by, waypoints, path, scaling)
    between = None if waypoints is None else _waypoints(arm, waypoints, degrees=degrees)
    way, trouble = _path_and_trouble(arm, q0, q1, by, between, path)
    if way is None:
        return replace(report, refused=Verdict(Word.STOPPED, (str(trouble).removesuffix("."),)))
    report = _with_timing(report, way, fast=fastest and trouble is None, scaling=scaling, duration=duration)
    if report.trajectory is None:
        return report
    times = np.linspace(0.0, report.trajectory.duration, SAMPLES)
    q = report.trajectory(times)[0]
    path_clearance = clearance_along(arm, [(times, q)], clearance, srdf)
    return replace(report, clearance=path_clearance, early_end="" if trouble is None else str(trouble))


def _with_timing(
    report: MoveReport, way: JointPath, *, fast: bool, scaling: Scalings, duration: float | None
) -> MoveReport:
    """Report with the timing of a path, or with the reason why there is none; other errors carry the report's hints."""
    robot, bounds = report.robot, report.limits
    try:
        moving = _time_path(robot, way, bounds, fast=fast, scaling=scaling, duration=duration, friction=report.friction)
    except PathError as problem:
        word, reason = _why_not_timed(problem, robot, can_stand=_can_stand(robot, way, bounds))
        return replace(report, refused=Verdict(word, (str(reason).removesuffix("."),)))
    except TwistWrenchError as error:
        for hint in report.hints:
            error.add_note(hint)
        raise
    return replace(report, trajectory=moving)


def _input_doubts(loads: LoadCase, bounds: Limits) -> list[Doubt]:
    """Doubts about limits and loads as they were given."""
    return [*credible_limits(bounds, loads.robot), *loads.doubts]


def _bounds(robot: Robot, bounds: Limits, acceleration: float | None, jerk: float | None) -> Limits:
    """Limits with those of acceleration and jerk that are given as one number."""
    uniform = bounds_of(robot, acceleration=acceleration, jerk=jerk)
    if acceleration is not None:
        bounds = replace(bounds, acceleration=uniform.acceleration, deceleration=uniform.deceleration)
    if jerk is not None:
        bounds = replace(bounds, jerk=uniform.jerk)
    return bounds


# ── Path and timing


def _check_path(to: ConfigurationGiven, by: ArrayLike | None, waypoints: Any, path: str, scaling: str) -> None:
    """Raise ValueRangeError if the end is missing, or two arguments contradict each other."""
    if path not in get_args(Paths):
        raise ValueRangeError(f"path is {path!r}. Give 'joint', 'line' or 'screw'.")
    if scaling not in get_args(Scalings):
        raise ValueRangeError(f"scaling is {scaling!r}. Give one of {', '.join(map(repr, get_args(Scalings)))}.")
    if to is not None and by is not None:
        raise ValueRangeError(
            f"{argument('to')} and {argument('by')} both set the end of the motion. Keep one of them."
        )
    if to is None and by is None:
        raise ValueRangeError(
            f"where does it end? Give {argument('to')} for the joints, or {argument('by')} for the tip."
        )
    if by is not None and path != "joint":
        raise ValueRangeError(f"{argument('by')} moves the tip on a straight line. Leave the path out.")
    if waypoints is not None and (by is not None or path != "joint"):
        raise ValueRangeError(
            f"{argument('waypoints')} are for the joints, and the path is one of the tip. Keep one of them."
        )


def _path_and_trouble(
    robot: Robot, q0: Array, q1: Array, by: ArrayLike | None, between: Array | None, path: str
) -> tuple[JointPath | None, PathError | None]:
    """Requested path from q0 (nq,) to q1 (nq,) or by a vector; if it ends early, its feasible part and the error."""
    if between is not None:
        return spline(robot, np.concatenate([[q0], between, [q1]])), None
    if by is None and path == "joint":
        return joint_line(robot, q0, q1), None
    T = robot.forward_kinematics(q0)
    if by is None:
        poses = (straight_path if path == "line" else screw_path)(T, robot.forward_kinematics(q1))
    else:
        end = T.copy()
        end[:3, 3] += arguments.one(arguments.finite(by, "by", 3), "by", 3)
        poses = straight_path(T, end)
    try:
        return follow_poses(robot, poses, q0), None
    except PathError as problem:
        return problem.partial, problem  # type: ignore[return-value]


def _time_path(
    robot: Robot,
    path: JointPath,
    bounds: Limits,
    *,
    fast: bool,
    scaling: Scalings,
    duration: float | None,
    friction: bool,
) -> Trajectory:
    """Motion along the path: the ``fast``est, or with the time scaling."""
    if fast:
        kinds = ("velocity", "effort", "acceleration", "deceleration", "jerk")
        limits = {kind: getattr(bounds, kind) for kind in kinds}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConstraintWarning)  # the verdict checks positions against the given limits
            return fastest_timing(robot, path, friction=friction, **limits)
    shapes: dict[str, Any] = {"quintic": quintic(1.0), "cubic": cubic(1.0), "s-curve": s_curve(1.0)}
    shape = {**shapes, "trapezoid": trapezoid(v=1.5, duration=1.0)}[scaling]
    if duration is not None:
        return Trajectory(robot, path, shape.stretched(duration), friction=friction)
    return Trajectory(robot, path, fitted(robot, path, shape, bounds, friction=friction), friction=friction)


def _waypoints(robot: Robot, source: str | Path | ArrayLike, *, degrees: bool) -> Array:
    """Configurations (n, nq) of a file or an array."""
    unit = np.where(Coordinates.from_model(robot.model).angular & degrees, math.radians(1.0), 1.0)
    if isinstance(source, str | Path):
        return _waypoints_of_file(robot, source) * unit
    rows = arguments.finite(source, "waypoints", robot.nq, names=robot.coordinate_names)
    return np.atleast_2d(np.asarray(rows, float)) * unit


def _waypoints_of_file(robot: Robot, file: str | Path) -> Array:
    """Rows (n, nq) of a file, as written."""
    names = robot.coordinate_names
    form = f"the columns {', '.join(names[:12])}, each once, and at least one row"
    with table_errors(file, "waypoint file", form):
        table = CsvFile.open(file)
        if sorted(table.header) != sorted(names):
            raise ValueRangeError(f"{file}: line {table.header_line}: give {form}.")
        rows = table.table([table.header.index(name) for name in names])
    if not len(rows):
        raise ValueRangeError(f"{file}: no row after the header: give {form}.")
    return rows


def _can_stand(robot: Robot, path: JointPath, bounds: Limits) -> bool:
    """True if the torque limits suffice to stand still everywhere on the path."""
    q, _, _ = path(np.linspace(0.0, 1.0, SAMPLES))
    shares = np.abs(motor_torques(robot.model, robot.holding_torques(q))) / bounds.effort
    return not bool(over_limit(shares).any())


def _why_not_timed(problem: PathError, robot: Robot, *, can_stand: bool) -> tuple[Word, PathError]:
    """First word and reason for a path without a timing; torques of a legged robot whose base nothing holds are uncertain."""
    if can_stand:
        return Word.STOPPED, problem
    hanging = base_doubts(robot.model)
    if not hanging:
        return Word.OVER_LIMIT, problem
    return Word.UNSURE, PathError("; ".join([*hanging, hanging_excess(str(problem))]))


def _certain(violations: tuple[Violation, ...], robot: Robot) -> tuple[tuple[Violation, ...], list[str]]:
    """Violations that hold however the base is held, and doubts about a legged robot's base and its torques."""
    hanging = base_doubts(robot.model)
    if not hanging:
        return violations, []
    torques = [hanging_excess(str(v)) for v in violations if v.kind == "torque"]
    return tuple(v for v in violations if v.kind != "torque"), [*hanging, *torques[:1]]


# ── Peaks of the joints


@dataclass(frozen=True)
class JointUse:
    """Peaks of a joint or coupled motor in a motion, as values and as shares of the limits (nan without a limit)."""

    joint: str
    """Name of the joint or motor."""
    way: float
    """Difference of its position between both ends [rad or m]."""
    velocity: float
    """Velocity of largest magnitude, with its sign [rad/s or m/s]."""
    velocity_share: float
    """Magnitude of this velocity as a share of its limit."""
    peak: float
    """Torque of largest magnitude, with its sign."""
    torque_share: float
    """Magnitude of this torque as a share of its limit."""
    unit: str
    """Unit of torque."""
    limiting: float
    """Fraction of the time at a limit, in a fastest motion."""
    uncertainty: float = 0.0
    """Standard deviation of the torque; zero for a planned motion."""


def joint_uses(trajectory: Trajectory, bounds: Limits, *, friction: bool) -> list[JointUse]:
    """Peaks for each entry of dq; coupled joints are replaced by their motors."""
    robot, model = trajectory.robot, trajectory.robot.model
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = motor_torques(model, required_torques(robot, t, q, dq, ddq, friction=friction))
    way, dq = motor_velocities(model, robot.subtract(q[-1], q[0])), motor_velocities(model, dq)
    units, speed_limits = units_of("tau", drive_turns(model)), np.where(coupled_entries(model), np.inf, bounds.velocity)
    at_limit = dict.fromkeys((*model.velocity_names, *model.drive_labels), 0.0)
    if isinstance(trajectory, Fastest):
        for contact in trajectory.limit_contacts:
            at_limit[contact.joint] += (contact.end - contact.begin) / trajectory.duration
    uses = []
    for k, name in enumerate(model.drive_labels):
        speed, peak = (float(x[int(np.abs(x).argmax())]) for x in (dq[:, k], tau[:, k]))
        speed_share, torque_share = _share(speed, speed_limits[k]), _share(peak, bounds.effort[k])
        uses.append(JointUse(name, float(way[k]), speed, speed_share, peak, torque_share, units[k], at_limit[name]))
    return uses


def _share(value: float, limit: float) -> float:
    """Magnitude of a value as a share of its limit; nan without a limit."""
    return abs(value) / limit if math.isfinite(limit) else math.nan
