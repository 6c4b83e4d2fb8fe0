"""Identification of position servos from logs of commands and positions, without torques."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.blas_threads import one_blas_thread
from ...core.errors import ModelError, ShapeError, UnknownNameError, ValueRangeError
from ...core.estimation.cross_validation import HeldOut
from ...core.glossary import complete
from ...core.text import listed
from ...core.typing import Array
from ...motion.motion import Motion
from ...robot import Robot, load
from ...robot.base import require_robot
from .linear_start import linear_start, scale_determining_torques
from .output_error import OutputErrorFit, OutputErrorProblem, position_errors, probability, with_model_changes
from .replay import LAWS, QUANTITIES, Hold, ServoLog, ServoReplay
from .result import IdentifiedServos
from .servo_doubts import command_doubts, fit_doubts, moving_joints

Log = Motion | str | Path
_TRAINING_SHARE = 0.8
"""Share of each log, from its begin, that predicts the rest of the log if there is no test log."""
_MAX_SECONDS = 120.0
"""Largest total duration [s] of logs that are replayed; the begin of each longer one is used."""
_MAX_SCALE = 3.0
"""Largest deviation of the logarithm of a scale."""
_MIN_BODY_TORQUE = 1e-12
"""Torque of bodies that replaces zero as a divisor [N m, N]."""
_PRIOR_ODDS_OF_HELD = 10.0
"""Odds of held to straight commands before a log is evaluated: a bus holds them."""
_MAX_LISTED_JOINTS = 6
"""Largest number of joints that a message names."""
_MIN_ROWS = 12
"""Least number of rows of a log."""


def identify_servos(
    robot: Robot | str | Path,
    logs: Log | Sequence[Log],
    *,
    test: Log | Sequence[Log] = (),
    known: Mapping[str, float] | None = None,
    hold: Literal["zero", "linear", "auto"] = "auto",
    progress: Callable[[float], None] | None = None,
) -> IdentifiedServos:
    """Identify stiffness, damping, friction and armature of each joint's servo, and their delay, without torques.

    Parameters
    ----------
    robot : Robot, path or name
        Robot on a fixed base whose joints have one degree of freedom. Masses and inertias are those of its file.
    logs : Motion, path, or sequence of them
        Logs with positions and commanded positions: columns ``JOINT.command``, or ``Motion(..., command=...)``. Torques are
        ignored.
    test : Motion, path, or sequence of them, optional
        Test logs that are not used for the fit. Without test logs, the last fifth of each log is predicted from the rest.
    known : mapping, optional, known values by names such as ``joint_2.kp`` and ``joint_2.armature``, in SI units
    hold : "zero", "linear" or "auto"
        Course of the command between its samples: held, straight, or the one that replays the logs better.
    progress : callable, optional, called with the completed share

    Returns
    -------
    found : IdentifiedServos

    Raises
    ------
    ShapeError
        There is no log, or a log has no commands.
    ModelError
        The base floats, the robot has actuators or couplings, or a joint has several degrees of freedom.
    ValueRangeError
        A log is too short, or its command equals its position in all rows.

    Notes
    -----
    A position servo obeys M(q) ddq + a ddq + h(q, dq) = kp (c(t - δ) - q) - d dq - C sgn dq. A regression of the
    tracking error gives initial values; a Levenberg-Marquardt fit of replayed positions gives the result. If nothing heavy
    hangs on a joint, only its ratios to kp are determined; the verdict names it.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> log = tw.identification.simulated_servo_log(arm, armature=0.4, damping=3.0, coulomb=0.5, kp=90.0, delay=0.012)
    >>> found = tw.identification.identify_servos(arm, log)
    >>> found
    <IdentifiedServos of planar_2r: OK, 2 of 2 joints>
    """
    arm = _require_servo_arm(robot if isinstance(robot, Robot) else load(robot))
    holds = ("zero", "linear", "auto")
    if hold not in holds:
        raise UnknownNameError.from_choices("hold", hold, holds)
    training_logs = servo_logs(arm, logs, "logs")
    test_logs = servo_logs(arm, test, "test")
    if not training_logs:
        raise ShapeError("identify_servos: there is no log. Give one with commands at least.")
    report_progress = progress or (lambda _share: None)
    known_values = dict(known or {})
    with one_blas_thread():
        known_logarithms = _known_logarithms(arm, known_values)
        fit, problem, change_by_hold = _fit_with_hold(arm, training_logs, hold, known_logarithms, report_progress)
        changes = [change_by_hold, *_model_changes(arm, problem, fit)]
        widened_fit = with_model_changes(fit, changes)  # errors of the model widen the intervals
        report_progress(0.8)  # share of the usual time
        (residual_squares, error_squares), kind = _held_out(problem, fit, test_logs)
    report_progress(1.0)
    held_out = _shares(arm, kind, residual_squares, error_squares)
    residual_squares, error_squares = _sums_of_squares(fit.replay.logs, problem.used, fit)
    trained = _shares(arm, "used rows", residual_squares, error_squares)
    found = IdentifiedServos(
        original=arm,
        fit=widened_fit,
        held_out=held_out,
        trained=trained,
        sizes=_typical_sizes(training_logs),
        live=moving_joints(training_logs),
        known=known_values,
    )
    doubts = [*command_doubts(arm, training_logs), *fit_doubts(found, training_logs)]
    return replace(found, doubts=tuple(doubts))


def _require_servo_arm(robot: Robot) -> Robot:
    """Return the robot if its servos can be identified; else raise ModelError."""
    require_robot(robot, "identify_servos")
    model = robot.model
    if robot.actuators or model.couplings:
        raise ModelError(
            f"robot {robot.name!r} has actuators already, and their armature and friction are what is sought. Give the "
            "robot without them."
        )
    for body in model.leaders:
        if body.joint.nv != 1:
            raise ModelError(
                f"joint {body.joint.name!r} of robot {robot.name!r} has several degrees of freedom, and a servo moves one. "
                "Hold the base, or lock this joint."
            )
    return robot


def servo_logs(robot: Robot, sources: Log | Sequence[Log], argument_name: str) -> list[ServoLog]:
    """Logs of the argument ``logs`` or ``test``; raises ShapeError and ValueRangeError for logs that cannot be used."""
    if isinstance(sources, Motion | str | Path):
        sources = [sources]
    logs = []
    for k, log in enumerate(sources, 1):
        name = f"{argument_name} number {k}"
        motion = log if isinstance(log, Motion) else Motion.from_file(log, robot)
        if motion.robot.coordinate_names != robot.coordinate_names:
            raise ShapeError(f"identify_servos: {name} is of robot {motion.robot.name!r}, whose joints differ.")
        if motion.command is None:
            raise ShapeError(
                f"identify_servos: {name} has no commands. Give columns JOINT.command, or commanded positions, "
                "Motion(…, command=…)."
            )
        # a joint without commands has nan in all rows
        first_command = motion.command[0]
        without_commands = np.flatnonzero(np.isnan(first_command))
        joints = [robot.model.velocity_names[j] for j in without_commands]
        if joints:
            raise ShapeError(
                f"identify_servos: {name} has no commands of {listed(joints, _MAX_LISTED_JOINTS)}. Lock these joints, or "
                "give their commands."
            )
        if len(motion) < _MIN_ROWS:
            raise ValueRangeError(f"identify_servos: {name} has {len(motion)} rows. Give at least {_MIN_ROWS}.")
        if (motion.command == motion.q).all():
            raise ValueRangeError(f"identify_servos: the command of {name} is its position. Give measured positions.")
        logs.append(ServoLog.from_arrays(motion.time, motion.q, motion.command))
    return _first_rows(logs)


def _first_rows(logs: Sequence[ServoLog]) -> list[ServoLog]:
    """First rows of each log, at most ``_MAX_SECONDS`` in total.

    Logs share the time equally. They are visited from the shortest to the longest, and longer logs share what a short one
    does not need.
    """
    remaining_seconds = _MAX_SECONDS
    shortest_first = sorted(range(len(logs)), key=lambda k: float(logs[k].time[-1]))
    end_times = dict[int, float]()  # by index of the log
    for visited_count, k in enumerate(shortest_first):
        equal_share = remaining_seconds / (len(logs) - visited_count)
        end_times[k] = min(float(logs[k].time[-1]), equal_share)
        remaining_seconds -= end_times[k]
    shortened = list[ServoLog]()
    for k, log in enumerate(logs):
        is_used = log.time <= end_times[k]
        if not is_used.all():
            log = replace(log, time=log.time[is_used], q=log.q[is_used], command=log.command[is_used])
        shortened.append(log)
    return shortened


def _known_logarithms(robot: Robot, known: Mapping[str, float]) -> dict[int, float]:
    """Logarithms of known values, by index of the unknown; raises UnknownNameError, ValueRangeError."""
    names = [f"{joint}.{name}" for joint in robot.model.velocity_names for name in QUANTITIES]
    logarithms = dict[int, float]()
    for name, value in known.items():
        if name not in names:
            raise UnknownNameError.from_choices("known value", name, names)
        logarithms[names.index(name)] = float(np.log(arguments.positive(value, name)))
    return logarithms


def _fit_with_hold(
    robot: Robot,
    logs: Sequence[ServoLog],
    hold: str,
    known_logarithms: Mapping[int, float],
    report_progress: Callable[[float], None],
) -> tuple[OutputErrorFit, OutputErrorProblem, Array]:
    """Fit with the more probable course of commands, its problem, and the change of the unknowns by the other course.

    The change is multiplied by the square root of the other course's probability. At a high rate, the two can hardly be
    distinguished: held commands, and straight ones with half a period more delay, have nearly the same replay.
    """
    first_hold: Hold = "linear" if hold == "linear" else "zero"
    initial, _ = linear_start(robot, logs, first_hold)
    free = np.ones(len(initial), bool)
    per_joint = len(QUANTITIES)  # number of unknowns of a joint, in the order of joints; the last one is kp
    for k, logarithm in known_logarithms.items():
        is_kp = (k + 1) % per_joint == 0
        if is_kp:  # keep the ratios of the joint's other values to kp, which are better determined than the values
            first_of_joint = k + 1 - per_joint
            initial[first_of_joint : k + 1] += logarithm - initial[k]
        initial[k] = logarithm
        free[k] = False
    report_progress(0.1)  # shares of the usual time
    replay = ServoReplay(robot, logs, first_hold, ServoReplay.step_of(initial))
    problem = OutputErrorProblem.from_logs(replay, initial, free)
    fit = problem.solve(initial)
    report_progress(0.4)
    if hold != "auto":
        return fit, problem, np.zeros(len(initial))
    linear_problem = replace(problem, replay=replace(replay, hold="linear"))
    linear_initial = fit.p.copy()
    linear_initial[-1] += 0.5 * logs[0].period  # the delay: held commands are half a period late on average
    linear_fit = linear_problem.solve(linear_initial, hopeless=2.0 * fit.cost)
    report_progress(0.7)
    log_odds_of_linear = fit.evidence(fit.cost, linear_fit.cost) - np.log(_PRIOR_ODDS_OF_HELD)
    other_probability = probability(-abs(log_odds_of_linear))
    change = np.sqrt(other_probability) * (linear_fit.p - fit.p)
    if log_odds_of_linear > 0.0:
        return linear_fit, linear_problem, change
    return fit, problem, change


def _model_changes(robot: Robot, problem: OutputErrorProblem, fit: OutputErrorFit) -> list[Array]:
    """Changes of the unknowns by errors of the model: half the integrator's step, other laws of friction, other scales.

    Only the torque of a joint's bodies that armature and friction cannot replace determines the scale of its values. The fit
    may leave more of the joint's torque unexplained than the encoder's error. The torque of the bodies may then be wrong by
    this excess in each block of time, and the scale by the mean over all blocks.
    """
    half_step_replay = replace(fit.replay, step=0.5 * fit.replay.step)
    r, J = problem.linearise(fit.p)
    changes = [problem.change(fit, half_step_replay)]
    changes += [problem.law_change(fit, law, r, J) for law in LAWS]
    residual_squares, _ = _sums_of_squares(fit.replay.logs, problem.used, fit)
    row_count = sum(len(e) for e in fit.residuals)
    excess_squares = np.maximum(residual_squares - row_count * fit.sigma**2, 0.0)
    values = np.exp(fit.p[:-1].reshape(-1, len(QUANTITIES)))
    kp = values[:, -1]
    mean_excess_squares = excess_squares / row_count
    unexplained_torques = kp * np.sqrt(mean_excess_squares / (fit.freedom + 1.0))
    body_torques = scale_determining_torques(robot, fit.replay.logs)
    scale_errors = unexplained_torques / np.maximum(body_torques, _MIN_BODY_TORQUE)
    bounded_errors = np.minimum(scale_errors, _MAX_SCALE)
    return [*changes, *problem.scale_changes(fit, J, bounded_errors)]


def _held_out(
    problem: OutputErrorProblem, fit: OutputErrorFit, test_logs: Sequence[ServoLog]
) -> tuple[tuple[Array, Array], str]:
    """Sums of squares of held-out rows, as :func:`_sums_of_squares` returns them, and the name of these rows.

    The rows are those of the test logs or, without any, the last fifth of each log, predicted from the rest.
    """
    if test_logs:
        replay = replace(fit.replay, logs=test_logs)
        test_problem = OutputErrorProblem.from_logs(replay, fit.p, problem.free)
        test_problem = replace(test_problem, sigma=position_errors(test_logs))
        test_fit = replace(fit, residuals=test_problem.residuals_at(fit.p))
        return _sums_of_squares(test_logs, test_problem.used, test_fit), "test"
    training_rows = list[Array]()
    held_out_rows = list[Array]()
    for log, rows in zip(fit.replay.logs, problem.used, strict=True):
        is_training = log.time[rows] <= _TRAINING_SHARE * log.time[-1]
        training_rows.append(rows[is_training])
        held_out_rows.append(rows[~is_training])
    training_fit = replace(problem, used=training_rows).solve(fit.p)
    residuals = replace(problem, used=held_out_rows).residuals_at(training_fit.p)
    held_out_fit = replace(fit, residuals=residuals)
    return _sums_of_squares(fit.replay.logs, held_out_rows, held_out_fit), "last fifth"


def _sums_of_squares(logs: Sequence[ServoLog], used: Sequence[Array], fit: OutputErrorFit) -> tuple[Array, Array]:
    """Sums of squares (nv,) of the fit's residuals, and of the tracking error c(t - δ) - q in the same rows."""
    residual_squares = np.zeros(len(fit.sigma))
    error_squares = np.zeros(len(fit.sigma))
    delay = fit.p[-1]
    for log, rows, residuals in zip(logs, used, fit.residuals, strict=True):
        c = log.mean_command(log.time[rows] - delay, fit.replay.step, fit.replay.hold)
        residual_squares += (residuals**2).sum(axis=0)
        error_squares += ((c - log.q[rows]) ** 2).sum(axis=0)
    return residual_squares, error_squares


def _shares(robot: Robot, kind: str, residual_squares: Array, error_squares: Array) -> HeldOut:
    """Residuals as shares of the tracking error, by joint; ``kind`` names the rows."""
    return HeldOut(kind, residual_squares, error_squares, robot.model.velocity_names)


def _typical_sizes(logs: Sequence[ServoLog]) -> Array:
    """(nv, 3) factors of armature, damping and Coulomb friction: rms acceleration and speed of the commands, and 1."""
    speeds_of_logs = list[Array]()
    accelerations_of_logs = list[Array]()
    for log in logs:
        speeds = np.gradient(log.command, log.time, axis=0)
        speeds_of_logs.append(speeds)
        accelerations_of_logs.append(np.gradient(speeds, log.time, axis=0))
    ddq = np.concatenate(accelerations_of_logs)
    dq = np.concatenate(speeds_of_logs)
    rms_acceleration = np.sqrt((ddq**2).mean(axis=0))
    rms_speed = np.sqrt((dq**2).mean(axis=0))
    return np.stack([rms_acceleration, rms_speed, np.ones(len(rms_speed))], axis=1)


def simulated_servo_log(
    robot: Robot,
    *,
    armature: ArrayLike,
    damping: ArrayLike,
    coulomb: ArrayLike,
    kp: ArrayLike,
    delay: float = 0.0,
    seconds: float = 10.0,
    rate: float = 100.0,
    size: float = 0.3,
    bits: int = 16,
    seed: int = 0,
) -> Motion:
    """Log of a simulated robot whose servos follow sums of sines: for examples, and to test motions before recording.

    Parameters
    ----------
    armature, damping, coulomb, kp : (nv,) array_like or float, values of the servos
    delay : float, delay of the commands [s]
    seconds : float, duration [s]
    rate : float, rows per second [Hz]
    size : float, amplitude of the slowest sine [rad, m]
    bits : int, resolution of the encoders, positions per turn as a power of two
    seed : int, of the sines

    Returns
    -------
    log : Motion, with ``command``

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> log = tw.identification.simulated_servo_log(arm, armature=0.4, damping=3.0, coulomb=0.5, kp=90.0)
    >>> len(log), log.command.shape
    (1000, (1000, 2))
    """
    arm = _require_servo_arm(robot)
    nv = arm.nv
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    hertz = np.array([0.1, 0.23, 0.47, 0.9, 1.3, 2.1, 3.1, 4.2])  # frequencies of the sines
    amplitudes = size * rng.uniform(-1.0, 1.0, (len(hertz), nv)) / (1.0 + hertz[:, None])
    phases = rng.uniform(0.0, 2.0 * np.pi, amplitudes.shape)
    sines = np.sin(2.0 * np.pi * hertz[:, None] * time[:, None, None] + phases)  # (rows, len(hertz), nv)
    c = (amplitudes * sines).sum(axis=1)
    values = [np.broadcast_to(np.asarray(x, float), (nv,)) for x in (armature, damping, coulomb, kp)]
    p = np.append(np.log(np.stack(values, axis=1)).ravel(), delay)  # unknowns as ServoReplay orders them
    log = ServoLog(time, c, c, np.zeros(nv))  # the commands stand in for positions, which a replay does not need
    replay = ServoReplay(arm, [log], "zero", 0.5 * ServoReplay.step_of(p))
    (positions_of_log,) = replay.positions(p[None])
    quantum = 2.0 * np.pi / 2.0**bits  # of the encoders [rad]
    q = np.round(positions_of_log[0] / quantum) * quantum  # of the only vector of unknowns
    return Motion(time, q, robot=arm, in_seconds=True, command=c)


complete(globals())
