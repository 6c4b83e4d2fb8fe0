"""Function of the command ``size``: motors and gears of a catalogue under a cyclic motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ModelError, ShapeError, ValueRangeError
from ..core.text import Argument, spell
from ..core.typing import Celsius, Hours, Seconds
from ..formats.yaml import Source
from ..mechanics.model.couplings import refuse_couplings
from ..motion.differentiation import Differentiation
from ..motion.load_case import LoadCase, LoadsGiven, payloads_of
from ..motion.motion import Motion
from ..motion.motion_log import MotionLog
from ..reports.check import log_of, robot_of
from ..reports.load_states import LoadStates
from ..reports.torque_analysis import analyse
from ..reports.torque_report import TorqueReport
from ..reports.torque_verdict import contradictions
from ..robot import Robot
from ..robot.base import require_robot
from ..robots.finding import bundled_file
from .catalog import Catalog, read_catalog
from .choice import Sizing, bare_robot, drive_joints, sizing_of, sizing_refused

_MIN_AMBIENT = -273.15  # °C, absolute zero
_MAX_AMBIENT = 1000.0  # °C, above every temperature of air


def size_drives(
    robot: Robot | str | Path,
    motion: Any,
    catalog: Source | Catalog,
    *,
    payload: LoadsGiven = (),
    pause: Seconds = 0.0,
    ambient: Celsius = 25.0,
    life: Hours | None = None,
    brake: bool = False,
    emergency: Any = None,
    friction: bool = True,
    add_masses: bool = True,
    shared_supply: bool = True,
    choose: bool = False,
    draws: Sequence[Motion] = (),
    smooth: bool = False,
    columns: Mapping[str, str] | None = None,
    gain: Mapping[str, float] | None = None,
    rate: float | None = None,
    topic: str | None = None,
    episode: int | None = None,
    degrees: bool = False,
    lock: Mapping[str, ArrayLike] | None = None,
    plan: bool = False,
) -> Sizing:
    """Drive sizing: loads of motors and gears over a repeated motion, compared with the ratings of a catalogue.

    If the catalogue has no ``actuators:``, the smallest pair is chosen for each revolute joint.

    Parameters
    ----------
    robot : Robot without actuators, path of a robot file, or name of a known robot
    motion : Motion, anything with ``.motion``, path of a log or plan, DataFrame, or "demo" for a bundled robot
        The cycle is the motion followed by the pause, repeated indefinitely. Rates of a log, and derived rates of a motion,
        are judged as by :func:`check`: smoothed if noise matters.
    catalog : str, Path, mapping or Catalog; YAML file, its text or content, "servos", or "demo"; see docs/sizing.md
        Catalogue of motors and gears; 'demo': bundled with the robot, 'servos': a table of servos.
    payload : float [kg], "kg,x,y,z@frame", SpatialInertia in the axes of its frame, {frame: one of these}, or a list
        Mass attached to the robot's tip, or to a named frame, with its centre of mass there [kg, m].
    pause : float
        Pause after the motion, in which the motors hold the robot [s].
    ambient : float
        Ambient temperature [°C].
    life : float, optional
        Required L₁₀ life of strain-wave gears [h].
    brake : bool
        Hold the robot with brakes during the pause.
    emergency : motion in any of these forms, optional
        Motion of an emergency stop or collision, for the momentary peak torque of gears.
    friction : bool, count joint friction and damping
    add_masses : bool, add the masses of the drives; False if the links include them
    shared_supply : bool
        Braking energy feeds other drives, or a resistor.
    choose : bool
        Choose the smallest drives of the catalogue, also for joints that have drives.
    draws : sequence of Motion, optional, equally likely motions at the same times, for the effect of noise on each load
    smooth : bool
        Smooth a noisy log before differentiating it, even if its noise does not matter.
    columns, gain, rate, topic, episode, degrees, lock, plan : reading of files, as for :func:`check`

    Returns
    -------
    sizing : Sizing

    Raises
    ------
    ModelError, UnknownNameError, NotFoundError
        The catalogue contradicts itself or names an unknown joint, or the robot has actuators.
    ValueRangeError
        A setting is not finite, or negative.
    ShapeError, TrajectoryError
        The motion is of another robot, or cannot be read.

    Notes
    -----
    Iron losses and losses of the electronics are neglected, and bearings whose limits the catalogue leaves out.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.linspace(0, 2, 201)
    >>> motion = tw.Motion(t, np.sin(np.pi * t / 2)[:, None] ** 2, robot=arm)
    >>> s = tw.size_drives(arm, motion, {"motors": {"servo": {
    ...     "stall_torque": "30 N m", "no_load_speed": "60 rpm", "voltage": "24 V"}}})
    >>> print(s.verdict)
    UNSURE: hinge, motor servo: stall data only
    >>> tw.size_drives("ur5", "demo", "demo", pause=0.8, add_masses=False)
    <Sizing of ur5: OK, shoulder_pan_joint 83 %>
    """
    arm, bundled_name = robot, ""
    if isinstance(robot, Robot | str | Path):
        arm, bundled_name = robot_of(robot, None, lock)
    require_robot(arm, "size_drives")
    refuse_couplings(arm.model, "size_drives")
    if isinstance(catalog, str) and catalog == "demo":
        catalog = bundled_file("demo", bundled_name, ".drives.yaml", "catalogue")
    drive_catalog = read_catalog(catalog)
    _check_settings(pause, ambient, life)
    _refuse_actuators(arm)
    reading_options = {"columns": columns, "gain": gain, "rate": rate, "topic": topic, "episode": episode}
    log_options = {"named": bundled_name, "plan": plan, "degrees": degrees, **reading_options}
    load = LoadCase(arm, payloads_of(payload), friction=friction)
    loaded_arm = load.with_load
    bare_arm = bare_robot(loaded_arm, drive_joints(loaded_arm, drive_catalog))
    cycle = _motion_or_log(motion, arm, log_options)
    report = _report(load, cycle, smooth=smooth)
    if report is not None and contradictions(report):
        return sizing_refused(loaded_arm, drive_catalog, report)
    states = _states(cycle, report, bare_arm, friction=friction)
    if not states.draws:  # a motion in memory: the caller gives its draws
        states = LoadStates(states.motion, tuple(draw.with_robot(bare_arm) for draw in draws))
    emergency_motion = None
    if emergency is not None:
        emergency_log = _motion_or_log(emergency, arm, log_options)
        emergency_motion = _states(emergency_log, _report(load, emergency_log), bare_arm).motion
    sizing = sizing_of(
        loaded_arm, states, drive_catalog, pause=pause, ambient=ambient, life=life, brake=brake, emergency=emergency_motion,
        friction=friction, add_masses=add_masses, shared_supply=shared_supply,
    )  # fmt: skip
    sizing = replace(sizing, report=report)
    if choose and not sizing.choice:
        return sizing.choose()
    return sizing


def _refuse_actuators(robot: Robot) -> None:
    """Raise ModelError if the robot has actuators."""
    if robot.actuators:
        raise ModelError(
            f"robot {robot.name!r} has actuators already, and the catalogue describes the drives. "
            f"Load it without {spell(Argument('actuators'))}."
        )


def _check_settings(pause: float, ambient: float, life: float | None) -> None:
    """Raise ValueRangeError if a setting is negative or not finite."""
    arguments.positive(pause, "size_drives: pause", "s", zero=True)
    if life is not None:
        arguments.positive(life, "size_drives: life", "h")
    ambient_temperature = arguments.number(ambient, "size_drives: ambient")
    if not _MIN_AMBIENT <= ambient_temperature < _MAX_AMBIENT:
        raise ValueRangeError(f"size_drives: ambient={ambient!r} is not a temperature of air in °C.")


def _motion_or_log(source: Any, robot: Robot, log_options: Mapping[str, Any]) -> Motion | MotionLog:
    """Log of a file, of a table, or of a motion that has one; a motion without a log is returned itself."""
    is_table = hasattr(source, "iloc")  # a DataFrame
    if is_table or isinstance(source, str | Path | MotionLog):
        return log_of(source, robot, **log_options)
    motion = getattr(source, "motion", source)  # of a result, or the motion itself
    if not isinstance(motion, Motion):
        raise ShapeError(f"size_drives: a motion is a tw.Motion or a path, got {arguments.value_text(source)}.")
    if motion.log is None:
        return motion
    return log_of(motion, robot)


def _report(load: LoadCase, motion: Motion | MotionLog, *, smooth: bool = False) -> TorqueReport | None:
    """Analysis of a log as by :func:`check`; None for a motion in memory."""
    if isinstance(motion, Motion):
        return None
    differentiation = Differentiation.plan(motion, load.robot.model, smoothing=smooth)
    return analyse(load, differentiation, load.robot.limits)


def _states(
    motion: Motion | MotionLog, report: TorqueReport | None, robot: Robot, *, friction: bool = True
) -> LoadStates:
    """States at which loads are computed for this robot: of the motion, or of the log that the report analyses."""
    if isinstance(motion, Motion):
        return LoadStates.from_motion(robot, motion.with_robot(robot), friction=friction)
    assert report is not None
    states = LoadStates.from_report(report)
    draws = tuple(draw.with_robot(robot) for draw in states.draws)
    return LoadStates(states.motion.with_robot(robot), draws)
