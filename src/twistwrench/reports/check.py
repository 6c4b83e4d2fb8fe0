"""Function of the command ``torques``: whether a robot carries a load along a path, which joint fails, and why."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import refuse_unused_srdf
from ..core.errors import ShapeError, ValueRangeError
from ..core.text import listed
from ..core.typing import Array, Metres, Vector, WrenchesGiven
from ..motion import limits_file
from ..motion.coordinates import ConfigurationGiven
from ..motion.differentiation import Differentiation
from ..motion.load_case import LoadsGiven, payloads_of
from ..motion.motion import Motion
from ..motion.motion_io import data_frame_file
from ..motion.motion_log import MotionLog
from ..robot import Robot, load
from ..robot.doors import clearance_along
from ..robots.finding import bundled_file
from .doors import measured_causes
from .motors import Steps
from .support.grip import HolderGiven
from .support.ground import FeetGiven, FramesGiven, FrictionGiven, InContactGiven
from .support.mounting import BoltsGiven, FrameOrTrue
from .support.questions import SupportQuestion, with_limits
from .torque_analysis import analyse
from .torque_report import TorqueReport

if TYPE_CHECKING:
    from ..formats.actuators import ActuatorFile

__all__ = ["check"]

_PLAN_DURATION = 0.25
"""Duration of the noise estimation relative to that of the analysis, for the progress."""
_SMOOTHING_PLAN_DURATION = 3.0
"""Duration of noise estimation and smoothing relative to that of the analysis, for the progress."""
_SLICE_ROWS = 8192
"""Number of rows whose clearance is searched at once."""


class CheckOptions(TypedDict, total=False):
    """Options of :func:`check`, as a dictionary with the same names and meanings."""

    at: ConfigurationGiven
    payload: LoadsGiven
    wrench_on_robot: Mapping[str, ArrayLike] | None
    limits: limits_file.Given
    friction: bool
    smooth: bool
    clearance: float | None
    srdf: str | Path | None
    feet: FeetGiven | None
    wheels: FramesGiven | None
    casters: FramesGiven | None
    contact_friction: FrictionGiven | None
    contact_normal: ArrayLike | None
    in_contact: InContactGiven
    mounting: FrameOrTrue | None
    bolts: BoltsGiven | None
    grip: HolderGiven | None
    cup: HolderGiven | None
    actuators: str | Path | ActuatorFile | None
    columns: Mapping[str, str] | None
    gain: Mapping[str, float] | None
    rate: float | None
    topic: str | None
    episode: int | None
    degrees: bool
    lock: Mapping[str, ArrayLike] | None
    plan: bool
    why: bool


def check(
    robot: Robot | str | Path,
    motion: Any = None,
    *,
    at: ConfigurationGiven = None,
    payload: LoadsGiven = (),
    wrench_on_robot: WrenchesGiven | None = None,
    limits: limits_file.Given = None,
    friction: bool = True,
    smooth: bool = False,
    clearance: Metres | None = None,
    srdf: str | Path | None = None,
    feet: FeetGiven | None = None,
    wheels: FramesGiven | None = None,
    casters: FramesGiven | None = None,
    contact_friction: FrictionGiven | None = None,
    contact_normal: Vector | None = None,
    in_contact: InContactGiven = "auto",
    mounting: FrameOrTrue | None = None,
    bolts: BoltsGiven | None = None,
    grip: HolderGiven | None = None,
    cup: HolderGiven | None = None,
    actuators: str | Path | ActuatorFile | None = None,
    columns: Mapping[str, str] | None = None,
    gain: Mapping[str, float] | None = None,
    rate: float | None = None,
    topic: str | None = None,
    episode: int | None = None,
    degrees: bool = False,
    lock: Mapping[str, ArrayLike] | None = None,
    plan: bool = False,
    why: bool = False,
    progress: Callable[[float], None] | None = None,
) -> TorqueReport:
    """Judge the torques of a motion against the robot's limits, with its loads; joint friction is counted.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    motion : path of a log or plan, Motion, anything with ``.motion``, DataFrame, or "demo" for a bundled robot
        None: the robot is at rest ``at`` a configuration, by default neutral if feet or wheels carry it.
    at : (nq,) array, {joint: position}, name of a configuration, or texts of these, optional [rad, m]
        Configuration of a robot at rest, in place of a motion: all coordinates, a configuration of the file by its name,
        or the position of a joint, the others at zero.
    payload : float [kg], "kg,x,y,z@frame", SpatialInertia in the axes of its frame, {frame: one of these}, or a list
        Mass attached to the robot's tip, or to a named frame, with its centre of mass there [kg, m].
    wrench_on_robot : {frame: (6,) array}, optional
        Constant wrench exerted on the robot at the frame, in its axes: moments [N m], forces [N].
    limits : path of a limits file, Limits, {joint: effort} [N m or N], or {kind: (nv,) array}, optional
        Limits of the joints, in place of the robot file's; the table of :func:`info` is a template.
    friction : bool, count joint friction and damping
    smooth : bool
        Smooth a noisy log before differentiating it, even if its noise does not matter.
    clearance : float, optional
        Check the least distance between links [m].
    srdf : path, optional
        Ignore the pairs of links of <disable_collisions> in the check of the clearance.
    feet : "auto", frame, "LENGTHxWIDTH[,x,y,z]@FRAME", Contact, or a list of these, optional
        Feet on the ground, whose forces take part in the torques; the base is then free. "auto": feet of a legged robot.
    wheels : frame, or a list of frames, optional
        Braked wheels on the ground, which carry at every instant; the base is then free.
    casters : frame, or a list of frames, optional
        Casters on the ground, which carry normal forces only; the base is then free.
    contact_friction : float or {frame: float}, optional
        Coulomb coefficient of the ground; without it, what the motion needs is stated.
    contact_normal : (3,) array_like, optional
        Direction away from the ground, in the frame of the base's pose; default: the world's vertical axis.
    in_contact : "auto", "log", or {frame: column of the log, or (n,) array}, optional
        Feet that carry: "auto": those that are low and slow; "log": by columns FRAME.contact of the log, 0 or 1, or a force
        above 20 N; or by the column of each foot.
    mounting : frame, or True for the root, optional
        Wrench of what stands on the frame, and not of what lies below or beside it, in the frame's axes; the base is held.
    bolts : "NUMBERxDIAMETER", path of a file x,y[,preload], or (k, 2) array, optional
        Bolts of the mounting, in its frame [m, N].
    grip : "FORCE,FRICTION[@FRAME]", or {"force", "friction", "frame", "axis", "width", "pad"}, optional
        Two fingers that hold the payload across ``axis`` of the frame, "y" by default [N, m].
    cup : "FORCE,FRICTION[@FRAME]", or {"force", "friction", "frame", "radius"}, optional
        Suction cup that holds the payload, along z of the frame [N, m].
    actuators : path, optional, file of motors, gears, rotors and friction; "demo": that of a bundled robot
    columns : {joint: column}, optional, as for :meth:`Motion.from_file`
    gain : {joint: float}, optional, torque per ampere of columns of currents [N m/A]
    rate : float, optional, sampling rate of a file without a time column [Hz]
    topic : str, optional, topic of a ROS recording
    episode : int, optional, episode of a LeRobot dataset
    degrees : bool, angles of files and of the answer are in degrees
    lock : {joint: position}, optional, joints to lock, as for :func:`load`
    plan : bool, judge a file as a plan: a step that no robot makes is then an excess, and not an error of a log
    why : bool
        Split the peak of the worst joint by link, payload and rotor.
    progress : callable, optional, receives the finished share, 0 to 1

    Returns
    -------
    report : TorqueReport
        ``report.verdict``, ``report.joints``, ``report.largest_payload``, ``report.plot()``.

    Raises
    ------
    NotFoundError, RobotFileError, TrajectoryError, UnknownNameError, ValueRangeError
        The robot, the motion, the loads or the limits cannot be read.
    ShapeError
        The motion is of another robot.

    Examples
    --------
    >>> import twistwrench as tw
    >>> answer = tw.check("ur5", "demo", payload=10)
    >>> print(answer.headline)
    OVER LIMIT: shoulder_lift_joint needs -167.0 N m at t = 1.808 s, 111 % of its limit (150 N m). Largest part: payload, 63 %.
    >>> answer.verdict.ok, round(answer.largest_payload, 2)
    (False, 8.38)
    """
    robot, bundle_name = robot_of(robot, actuators, lock)
    question = SupportQuestion(
        feet=feet, wheels=wheels, casters=casters, contact_friction=contact_friction,
        contact_normal=contact_normal, in_contact=in_contact, mounting=mounting, bolts=bolts, grip=grip, cup=cup,
    )  # fmt: skip
    reading: dict[str, Any] = {"columns": columns, "gain": gain, "rate": rate, "topic": topic, "episode": episode}
    robot = question.robot_of(robot, motion, bundle_name, reading)
    motion = question.motion_of(robot, motion, at, degrees=degrees)
    log = log_of(motion, robot, named=bundle_name, degrees=degrees, plan=plan, **reading)
    degrees_in_report = degrees or log.columns.has_degrees  # of the file, before a support replaces the log
    loads = {"payloads": payloads_of(payload), "wrenches": _wrench_arrays(wrench_on_robot), "friction": friction}
    case, log = question.case(robot, log, loads)
    used_limits = limits_file.limits_of(limits, case.robot.model, degrees=degrees)
    steps = Steps(progress, (_SMOOTHING_PLAN_DURATION if smooth else _PLAN_DURATION, 1.0))
    differentiation = Differentiation.plan(log, case.robot.model, smoothing=smooth, progress=steps.next())
    refuse_unused_srdf(clearance, srdf)
    report = analyse(with_limits(case, used_limits), differentiation, used_limits, progress=steps.next())
    configurations = ((s.time, s.q) for s in differentiation.states(_SLICE_ROWS))
    return replace(
        report,
        causes=measured_causes(report, log),
        clearance=clearance_along(case.robot, configurations, clearance, srdf),
        held=question.answers(report),
        degrees=degrees_in_report,
        with_why=why,
    )


def _wrench_arrays(wrenches: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """Wrenches by frame as arrays; empty if none are given."""
    if wrenches is None:
        return {}
    return {frame: np.asarray(F) for frame, F in wrenches.items()}


def robot_of(
    given: Robot | str | Path, actuators: str | Path | ActuatorFile | None, lock: Mapping[str, ArrayLike] | None
) -> tuple[Robot, str]:
    """Robot with its drives and locked joints, and the name by which files are bundled with it."""
    if isinstance(given, Robot):
        robot = given
        name = given.name
    elif actuators is None:
        return load(given, lock=lock), str(given)
    else:  # locked below, since actuators may name joints that are locked
        robot = load(given)
        name = str(given)
    if actuators is not None:
        robot = _driven_robot(robot, name, actuators)
    if lock is not None:
        robot = robot.lock(cast("Any", lock))
    return robot, name


def _driven_robot(robot: Robot, name: str, actuators: str | Path | ActuatorFile) -> Robot:
    """Robot with the drives of a file, which may name joints that are locked later."""
    from ..formats.actuators import ActuatorFile, add_actuators

    if not isinstance(actuators, ActuatorFile):
        actuators = ActuatorFile.from_source(bundled_file(str(actuators), name, ".yaml", "actuator file"))
    return Robot(add_actuators(robot.model, actuators, stiff=True))


def log_of(motion: Any, robot: Robot, *, named: str = "", plan: bool = False, **reading: Any) -> MotionLog:
    """Log of a motion: a file is opened, a motion has its log, and arrays become a table in memory.

    ``named`` is the name by which files are bundled with the robot, by default its own; ``reading`` are options of
    :meth:`MotionLog.open`.

    Raises
    ------
    ShapeError
        The motion is of another robot.
    TypeError
        It is not a motion.
    """
    if isinstance(motion, MotionLog):
        return motion
    if isinstance(motion, str | Path):
        path = bundled_file(str(motion), named or robot.name, ".csv", "motion")
        if reading.get("degrees") and path != Path(motion):
            raise ValueRangeError("the bundled motion 'demo' is in radians. Leave degrees out.")
        return MotionLog.open(path, robot.model, plan=plan, **reading)
    is_data_frame = hasattr(motion, "columns") and hasattr(motion, "iloc")  # pandas need not be imported
    if is_data_frame:
        file, _ = data_frame_file(motion)
        return MotionLog.open(file, robot.model, plan=plan, **reading)
    motion = getattr(motion, "motion", motion)  # of a result, such as a simulation
    if not isinstance(motion, Motion):
        raise TypeError(
            f"motion is of type {type(motion).__name__}. Give a path, tw.Motion(time, q, robot=robot), or 'demo'."
        )
    robot_joints = robot.model.velocity_names
    motion_joints = motion.robot.model.velocity_names
    if robot_joints != motion_joints:
        raise ShapeError(
            f"the motion is of {motion.robot.name!r} with the joints {listed(motion_joints)}, and the robot {robot.name!r} "
            f"has {listed(robot_joints)}."
        )
    if motion.log is not None:
        return motion.log
    return MotionLog.from_motion(motion)
