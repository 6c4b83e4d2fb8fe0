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
"""Share of each log that predicts its rest, if there is no test log."""
_MAX_SECONDS = 120.0
"""Largest total duration [s] of logs that are replayed; the begin of each longer one is used."""
_MAX_SCALE = 3.0
"""Largest deviation of the logarithm of a scale."""
_HELD = 10.0
"""Odds of held commands before a log is seen: a bus holds them."""
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
    arm = _suitable(robot if isinstance(robot, Robot) else load(robot))
    if hold not in ("zero", "linear", "auto"):
        raise UnknownNameError.from_choices("hold", hold, ("zero", "linear", "auto"))
    trained, tested = servo_logs(arm, logs, "logs"), servo_logs(arm, test, "test")
    if not trained:
        raise ShapeError("identify_servos: there is no log. Give one with commands at least.")
    tell = progress or (lambda _share: None)
    live = moving_joints(trained)
    with one_blas_thread():
        fit, problem, by_hold = _fit_with_hold(arm, trained, hold, _known_logarithms(arm, known or {}), tell)
        wide = with_model_changes(fit, [by_hold, *_model_changes(arm, problem, fit)])
        tell(0.8)
        held_out, kind = _held_out(problem, fit, tested)
    tell(1.0)
    found = IdentifiedServos(
        original=arm,
        fit=wide,
        held_out=_shares(arm, kind, *held_out),
        trained=_shares(arm, "used rows", *_sums_of_squares(fit.replay.logs, problem.used, fit)),
        sizes=_sizes(trained),
        live=live,
        known=dict(known or {}),
    )
    return replace(found, doubts=(*command_doubts(arm, trained), *fit_doubts(found, trained)))


def _suitable(robot: Robot) -> Robot:
    """Robot whose servos can be identified; raises ModelError."""
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


def servo_logs(robot: Robot, given: Log | Sequence[Log], what: str) -> list[ServoLog]:
    """Logs with commands; raises ShapeError and ValueRangeError for logs without them."""
    given = [given] if isinstance(given, Motion | str | Path) else given
    logs = []
    for k, one in enumerate(given, 1):
        name = f"{what} number {k}"
        motion = one if isinstance(one, Motion) else Motion.from_file(one, robot)
        if motion.robot.coordinate_names != robot.coordinate_names:
            raise ShapeError(f"identify_servos: {name} is of robot {motion.robot.name!r}, whose joints differ.")
        if motion.command is None:
            raise ShapeError(
                f"identify_servos: {name} has no commands. Give columns JOINT.command, or commanded positions, "
                "Motion(…, command=…)."
            )
        missing = [robot.model.velocity_names[j] for j in np.flatnonzero(np.isnan(motion.command[0]))]
        if missing:
            raise ShapeError(
                f"identify_servos: {name} has no commands of {listed(missing, 6)}. Lock these joints, or give their commands."
            )
        if len(motion) < _MIN_ROWS:
            raise ValueRangeError(f"identify_servos: {name} has {len(motion)} rows. Give at least {_MIN_ROWS}.")
        if (motion.command == motion.q).all():
            raise ValueRangeError(f"identify_servos: the command of {name} is its position. Give measured positions.")
        logs.append(ServoLog.from_arrays(motion.time, motion.q, motion.command))
    return _first_rows(logs)


def _first_rows(logs: Sequence[ServoLog]) -> list[ServoLog]:
    """Logs of which at most 120 s are replayed in total."""
    left = _MAX_SECONDS
    by_length = sorted(range(len(logs)), key=lambda k: float(logs[k].time[-1]))
    ends = dict[int, float]()
    for count, k in enumerate(by_length):
        ends[k] = min(float(logs[k].time[-1]), left / (len(logs) - count))
        left -= ends[k]
    shortened = list[ServoLog]()
    for k, log in enumerate(logs):
        rows = log.time <= ends[k]
        if not rows.all():
            log = replace(log, time=log.time[rows], q=log.q[rows], command=log.command[rows])
        shortened.append(log)
    return shortened


def _known_logarithms(robot: Robot, known: Mapping[str, float]) -> dict[int, float]:
    """Logarithms of known values by their place among the unknowns; raises UnknownNameError, ValueRangeError."""
    names = [f"{joint}.{name}" for joint in robot.model.velocity_names for name in QUANTITIES]
    found = dict[int, float]()
    for name, value in known.items():
        if name not in names:
            raise UnknownNameError.from_choices("known value", name, names)
        found[names.index(name)] = float(np.log(arguments.positive(value, name)))
    return found


def _fit_with_hold(
    robot: Robot, logs: Sequence[ServoLog], hold: str, fixed: Mapping[int, float], tell: Callable[[float], None]
) -> tuple[OutputErrorFit, OutputErrorProblem, Array]:
    """Fit with the more probable course of commands, and the change of the unknowns by the other one.

    The change is times the square root of the other's probability: at a high rate, held commands and straight ones with half
    a period more delay replay alike.
    """
    first: Hold = "linear" if hold == "linear" else "zero"
    start, _ = linear_start(robot, logs, first)
    free = np.ones(len(start), bool)
    count = len(QUANTITIES)
    for k, value in fixed.items():
        if k % count == count - 1:  # kp: ratios to it are told better than scales
            start[k + 1 - count : k + 1] += value - start[k]
        start[k], free[k] = value, False
    tell(0.1)
    replay = ServoReplay(robot, logs, first, ServoReplay.step_of(start))
    problem = OutputErrorProblem.from_logs(replay, start, free)
    fit = problem.solve(start)
    tell(0.4)
    if hold != "auto":
        return fit, problem, np.zeros(len(start))
    straight = replace(problem, replay=replace(replay, hold="linear"))
    begin = fit.p.copy()
    begin[-1] += 0.5 * logs[0].period
    other = straight.solve(begin, hopeless=2.0 * fit.cost)
    tell(0.7)
    odds = fit.evidence(fit.cost, other.cost) - np.log(_HELD)
    change = np.sqrt(probability(-abs(odds))) * (other.p - fit.p)
    if odds > 0.0:
        return other, straight, change
    return fit, problem, change


def _model_changes(robot: Robot, problem: OutputErrorProblem, fit: OutputErrorFit) -> list[Array]:
    """Changes of the unknowns by half the step of the integrator, by other laws of friction, and of each joint's scale.

    The scale of a joint is told by the torque r of its bodies alone, as far as armature and friction do not imitate it. If
    the fit leaves more of the joint's torque unexplained than the encoder's error, r may be wrong by that much in each block
    of time, and the scale by its mean over all blocks.
    """
    half = replace(fit.replay, step=0.5 * fit.replay.step)
    r, J = problem.linearise(fit.p)
    changes = [problem.change(fit, half), *(problem.law_change(fit, law, r, J) for law in LAWS)]
    squares, _ = _sums_of_squares(fit.replay.logs, problem.used, fit)
    rows = sum(len(e) for e in fit.residuals)
    excess = np.maximum(squares - rows * fit.sigma**2, 0.0)
    kp = np.exp(fit.p[:-1].reshape(-1, len(QUANTITIES))[:, -1])
    unexplained = kp * np.sqrt(excess / rows / (fit.freedom + 1.0))
    scale = unexplained / np.maximum(scale_determining_torques(robot, fit.replay.logs), 1e-12)
    return [*changes, *problem.scale_changes(fit, J, np.minimum(scale, _MAX_SCALE))]


def _held_out(
    problem: OutputErrorProblem, fit: OutputErrorFit, tested: Sequence[ServoLog]
) -> tuple[tuple[Array, Array], str]:
    """Sums of squares (nv,) of residuals and of the tracking error, in test logs or the last fifth of each log."""
    if tested:
        replay = replace(fit.replay, logs=tested)
        judged = replace(OutputErrorProblem.from_logs(replay, fit.p, problem.free), sigma=position_errors(tested))
        residuals = judged.residuals_at(fit.p)
        return _sums_of_squares(tested, judged.used, replace(fit, residuals=residuals)), "test"
    early, late = list[Array](), list[Array]()
    for log, rows in zip(fit.replay.logs, problem.used, strict=True):
        is_early = log.time[rows] <= _TRAINING_SHARE * log.time[-1]
        early.append(rows[is_early])
        late.append(rows[~is_early])
    p = replace(problem, used=early).solve(fit.p).p
    residuals = replace(problem, used=late).residuals_at(p)
    return _sums_of_squares(fit.replay.logs, late, replace(fit, residuals=residuals)), "last fifth"


def _sums_of_squares(logs: Sequence[ServoLog], used: Sequence[Array], fit: OutputErrorFit) -> tuple[Array, Array]:
    """Sums of squares (nv,) of the fit's residuals, and of c(t - δ) - q in the same rows."""
    squares, sizes = np.zeros(len(fit.sigma)), np.zeros(len(fit.sigma))
    for log, rows, left in zip(logs, used, fit.residuals, strict=True):
        c = log.mean_command(log.time[rows] - fit.p[-1], fit.replay.step, fit.replay.hold)
        squares += (left**2).sum(axis=0)
        sizes += ((c - log.q[rows]) ** 2).sum(axis=0)
    return squares, sizes


def _shares(robot: Robot, kind: str, squares: Array, sizes: Array) -> HeldOut:
    return HeldOut(kind, squares, sizes, robot.model.velocity_names)


def _sizes(logs: Sequence[ServoLog]) -> Array:
    """(nv, 3) rms acceleration and speed of the commands, and 1."""
    speeds, accelerations = list[Array](), list[Array]()
    for log in logs:
        dq = np.gradient(log.command, log.time, axis=0)
        speeds.append(dq)
        accelerations.append(np.gradient(dq, log.time, axis=0))
    ddq, dq = np.concatenate(accelerations), np.concatenate(speeds)
    rms = [np.sqrt((x**2).mean(axis=0)) for x in (ddq, dq)]
    return np.stack([*rms, np.ones(len(rms[0]))], axis=1)


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
    arm, rng = _suitable(robot), np.random.default_rng(seed)
    nv, time = arm.nv, np.arange(round(seconds * rate)) / rate
    hertz = np.array([0.1, 0.23, 0.47, 0.9, 1.3, 2.1, 3.1, 4.2])
    a = size * rng.uniform(-1.0, 1.0, (len(hertz), nv)) / (1.0 + hertz[:, None])
    phase = rng.uniform(0.0, 2.0 * np.pi, a.shape)
    c = (a * np.sin(2.0 * np.pi * hertz[:, None] * time[:, None, None] + phase)).sum(axis=1)
    values = [np.broadcast_to(np.asarray(x, float), (nv,)) for x in (armature, damping, coulomb, kp)]
    p = np.append(np.log(np.stack(values, axis=1)).ravel(), delay)
    log = ServoLog(time, c, c, np.zeros(nv))
    (q,) = ServoReplay(arm, [log], "zero", 0.5 * ServoReplay.step_of(p)).positions(p[None])
    quantum = 2.0 * np.pi / 2.0**bits
    return Motion(time, np.round(q[0] / quantum) * quantum, robot=arm, in_seconds=True, command=c)


complete(globals())
