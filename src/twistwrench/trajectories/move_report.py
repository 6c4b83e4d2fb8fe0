"""Function of the command ``move``: a motion between two configurations, its timing, and the verdict on it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt
from ..core.errors import PathError, TwistWrenchError, ValueRangeError
from ..core.numbers import number, printed
from ..core.text import Argument, argument
from ..core.typing import Array, Metres, Seconds, Vector
from ..core.verdict import Verdict, Word
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import coupled_entries, drive_turns, motor_torques, motor_velocities
from ..mechanics.model.limits import Limits
from ..motion import limits_file
from ..motion.bounds import Violation, bounds_of
from ..motion.coordinates import ConfigurationGiven, configuration_of, degrees_hint
from ..motion.credible_values import credible_limits
from ..motion.limits_file import robot_origin
from ..motion.load_case import LoadCase, LoadsGiven, limit_doubts, payloads_of
from ..motion.model_doubts import assumed_words, assumptions, model_warnings
from ..motion.motion import Motion
from ..robot import Robot, load
from ..robot.doors import clearance_along
from .fastest import Fastest
from .move_timing import (
    SAMPLES,
    Paths,
    Scalings,
    can_stand,
    certain_violations,
    check_path,
    path_and_trouble,
    read_waypoints,
    time_path,
    untimed_verdict,
)
from .paths import JointPath
from .trajectory import Trajectory, required_torques

if TYPE_CHECKING:
    from ..core.answers.page import Setting
    from ..robot.doors import PathClearance

STEP = 0.002
"""Time between rows of a motion [s]."""


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
    """Path and timing; if the path ends early, of the part that the robot can follow. None if there is no such part."""
    refused: Verdict | None = None
    """Verdict on a move without a trajectory; None with a trajectory."""
    early_end: str = ""
    """Reason why the path ends early; empty for a whole path."""
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
        """Samples of the trajectory every 2 ms; None without a trajectory."""
        return None if self.trajectory is None else self.trajectory.sample(STEP)

    @property
    def subject(self) -> str:
        """Text with robot and path; without a trajectory, what is wrong."""
        if self.trajectory is not None:
            return f"{self.robot_name} · {self.trajectory.path.name}"
        is_contradictory = self.refused is not None and self.refused.word is Word.LOOK_AGAIN
        return "contradictory input" if is_contradictory else "no path"

    @property
    def brief(self) -> str:
        """Text with the duration; empty without a trajectory."""
        return "" if self.trajectory is None else f"{number(self.trajectory.duration, 6)} s"

    # ── The verdict

    @cached_property
    def uses(self) -> list[JointUse]:
        """Peaks of each joint or coupled motor; empty without a trajectory."""
        return [] if self.trajectory is None else joint_uses(self.trajectory, self.limits, friction=self.friction)

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """Limits that the motion exceeds for certain, worst first."""
        violations, _ = self._violations_and_doubts
        return violations

    @cached_property
    def _violations_and_doubts(self) -> tuple[tuple[Violation, ...], list[str]]:
        """Certain violations, and doubts about a base that nothing holds."""
        if self.trajectory is None:
            return (), []
        violations = self.trajectory.violations(self.limits, friction=self.friction)
        return certain_violations(violations, self.robot)

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to be unsure, sentences without a full stop."""
        _, base_doubts = self._violations_and_doubts
        doubts = list(base_doubts)
        doubts += [str(doubt) for doubt in _input_doubts(self.load, self.limits) if not doubt.refuses]
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
        clauses = assumptions(self.robot.model, self.load.payloads, friction=self.load.friction)
        return assumed_words(clauses)

    @cached_property
    def verdict(self) -> Verdict:
        """COLLISION, OVER LIMIT, STOPPED where the robot cannot follow the path, LOOK AGAIN, UNSURE, or OK."""
        if self.refused is not None:
            return self.refused
        if self.near is not None:
            return self.near
        if self.early_end:
            return Verdict(Word.STOPPED, (self.early_end,))
        return Verdict.from_reasons(over=[str(violation) for violation in self.violations], unsure=list(self.doubts))

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
        sources: dict[str, str | Path] = {"ROBOT": self.robot.model.source}
        if self.limits_file:
            sources["limits"] = self.limits_file
        return sources

    def origin(self) -> Iterator[Setting]:
        """Robot, and the limits used.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.robot, self.limits, degrees=self.degrees)

    def to_csv(self, path: str | Path, step: float | None = None) -> Path:
        """Write time, q, dq and ddq for :func:`twistwrench.check`; angles are in degrees if the report's angles are.

        Parameters
        ----------
        path : str or Path
        step : float, optional, time between rows [s]; default: the report's step

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
    _check_times(step, duration, fastest=fastest)
    arguments.refuse_unused_srdf(clearance, srdf)
    if not isinstance(robot, Robot):
        robot = load(robot)
    loads = LoadCase(robot, payloads_of(payload), friction=friction)
    arm = loads.with_load
    stated_limits = limits_file.limits_of(limits, arm.model, degrees=degrees)
    bounds = _with_uniform_limits(arm, stated_limits, acceleration, jerk)
    q0 = configuration_of(arm, start, degrees=degrees, what=Argument("start", option="from"))
    q1 = configuration_of(arm, to, degrees=degrees, what=Argument("to"), start=q0)
    hints = _degrees_hints(arm, "start", start, q0)
    hints += _degrees_hints(arm, "to", to, q1)
    hints += loads.unit_hints
    uniform_limits = (("acceleration", acceleration), ("jerk", jerk))
    report = MoveReport(
        loads, bounds, None, hints=tuple(hints), degrees=degrees,
        asked=frozenset(kind for kind, limit in uniform_limits if limit is not None),
        limits_file=str(limits) if isinstance(limits, str | Path) else "", step=step,
    )  # fmt: skip
    contradictions = [str(doubt) for doubt in _input_doubts(loads, bounds) if doubt.refuses]
    if contradictions:
        return replace(report, refused=Verdict.from_reasons(look_again=contradictions), hints=())
    check_path(to, by, waypoints, path, scaling)
    waypoint_rows = None if waypoints is None else read_waypoints(arm, waypoints, degrees=degrees)
    joint_path, early_end = path_and_trouble(arm, q0, q1, by, waypoint_rows, path)
    if joint_path is None:
        reason = str(early_end).removesuffix(".")
        return replace(report, refused=Verdict(Word.STOPPED, (reason,)))
    fast = fastest and early_end is None  # the feasible part of a path that ends early has the time scaling
    report = _with_timing(report, joint_path, fast=fast, scaling=scaling, duration=duration)
    if report.trajectory is None:
        return report
    times = np.linspace(0.0, report.trajectory.duration, SAMPLES)
    positions, _, _ = report.trajectory(times)
    path_clearance = clearance_along(arm, [(times, positions)], clearance, srdf)
    end_text = "" if early_end is None else str(early_end)
    return replace(report, clearance=path_clearance, early_end=end_text)


def _check_times(step: float, duration: float | None, *, fastest: bool) -> None:
    """Raise ValueRangeError for a step that is not above zero, and for a duration of a fastest motion."""
    if not step > 0:
        raise ValueRangeError(f"{argument('step')} is {printed(step)}. Give seconds above zero.")
    if fastest and duration is not None:
        raise ValueRangeError(
            f"{argument('fastest', True)} computes the duration, and {argument('duration')} sets it. Leave one of them out."
        )


def _with_timing(
    report: MoveReport, path: JointPath, *, fast: bool, scaling: Scalings, duration: float | None
) -> MoveReport:
    """Report with the timing of a path, or with the reason why it has none; other errors get the report's hints as notes."""
    robot = report.robot
    bounds = report.limits
    try:
        trajectory = time_path(
            robot, path, bounds, fast=fast, scaling=scaling, duration=duration, friction=report.friction
        )
    except PathError as problem:
        word, reason = untimed_verdict(problem, robot, can_stand=can_stand(robot, path, bounds))
        return replace(report, refused=Verdict(word, (str(reason).removesuffix("."),)))
    except TwistWrenchError as error:
        for hint in report.hints:
            error.add_note(hint)
        raise
    return replace(report, trajectory=trajectory)


def _degrees_hints(robot: Robot, name: str, given: ConfigurationGiven, q: Array) -> list[str]:
    """Hint on a configuration q (nq,) that is obviously in degrees, with the argument's name; empty if there is none."""
    if given is None:
        return []
    hint = degrees_hint(robot, q)
    return [f"{name}: {hint}"] if hint else []


def _input_doubts(loads: LoadCase, bounds: Limits) -> list[Doubt]:
    """Doubts about the limits and the loads of a move."""
    return [*credible_limits(bounds, loads.robot), *loads.doubts]


def _with_uniform_limits(robot: Robot, bounds: Limits, acceleration: float | None, jerk: float | None) -> Limits:
    """Limits, with acceleration and jerk of all joints replaced by one number if it is given."""
    uniform = bounds_of(robot, acceleration=acceleration, jerk=jerk)
    if acceleration is not None:
        bounds = replace(bounds, acceleration=uniform.acceleration, deceleration=uniform.deceleration)
    if jerk is not None:
        bounds = replace(bounds, jerk=uniform.jerk)
    return bounds


# ── Peaks of the joints


@dataclass(frozen=True)
class JointUse:
    """Peaks of a joint or coupled motor in a motion, as values and as shares of the limits (nan without a limit)."""

    joint: str
    """Name of the joint or motor."""
    way: float
    """Change of position from start to end [rad or m]."""
    velocity: float
    """Velocity of largest magnitude, with its sign [rad/s or m/s]."""
    velocity_share: float
    """Magnitude of this velocity as a share of its limit."""
    peak: float
    """Torque of largest magnitude, with its sign [N m or N]."""
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
    robot = trajectory.robot
    model = robot.model
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    q, dq, ddq = trajectory(t)
    joint_torques = required_torques(robot, t, q, dq, ddq, friction=friction)
    tau = motor_torques(model, joint_torques)
    drive_velocities = motor_velocities(model, dq)
    way = motor_velocities(model, robot.subtract(q[-1], q[0]))  # couplings map changes of position as velocities
    units = units_of("tau", drive_turns(model))
    is_motor = coupled_entries(model)  # motors of coupled joints have no velocity limits, which are those of joints
    velocity_limits = np.where(is_motor, np.inf, bounds.velocity)
    share_at_limit = dict.fromkeys((*model.velocity_names, *model.drive_labels), 0.0)  # of the duration
    if isinstance(trajectory, Fastest):
        for contact in trajectory.limit_contacts:
            share_at_limit[contact.joint] += (contact.end - contact.begin) / trajectory.duration
    uses = []
    for k, name in enumerate(model.drive_labels):
        velocity = _peak(drive_velocities[:, k])
        torque = _peak(tau[:, k])
        use = JointUse(
            name,
            way=float(way[k]),
            velocity=velocity,
            velocity_share=_share(velocity, velocity_limits[k]),
            peak=torque,
            torque_share=_share(torque, bounds.effort[k]),
            unit=units[k],
            limiting=share_at_limit[name],
        )
        uses.append(use)
    return uses


def _peak(samples: Array) -> float:
    """Sample (of (n,)) of largest magnitude, with its sign."""
    return float(samples[int(np.abs(samples).argmax())])


def _share(value: float, limit: float) -> float:
    """Magnitude of a value as a share of its limit; nan without a limit."""
    return abs(value) / limit if math.isfinite(limit) else math.nan
