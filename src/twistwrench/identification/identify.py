"""Identification of a robot from logs: rows, settings, fit, covariance, held-out residuals, doubts and verdict."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np

from ..core.doubts import Doubt
from ..core.errors import ModelError, ShapeError, TrajectoryError, UnknownNameError, ValueRangeError
from ..core.estimation.covariance import autocorrelation_length
from ..core.estimation.cross_validation import FOLDS, HeldOut, HeldOutRows
from ..core.estimation.least_squares import Method, NormalEquations, Prior, weighted_fit
from ..core.estimation.sampling import SingleRowGlitches, dropouts, gaps, held_rows, moves, new_rows, pauses, spikes
from ..core.typing import Array
from ..motion.contradictions import row_doubts
from ..motion.motion import Motion
from ..motion.smoothing import continuous
from ..robot import Robot
from ..robot.task_space_methods import require_robot
from .assumed import AssumedCauses, WantedCause, begin_settings, fit_covariance, wanted_causes
from .cause_fit import log_fit
from .chunks import gap_notes
from .diagnosis import cause_doubts, diagnose, doubt_of_cause, law_changes
from .fit_doubts import LEFT_OUT, FittedLog, doubts_of
from .hyperparameters import FitOptions, FitSettings, SettingRows, Trial
from .parameters import FRICTION, STRIBECK_SPEED, BaseParameters, UnknownParameters, check_speed, uncoupled
from .payload import MotorSide, unknown_of
from .result import IdentifiedRobot
from .rows import MOST_ROWS, PAUSE, ROW_RATE, SteadySamples

MOST_SAMPLES = 90_000
"""Maximum number of samples of all logs; beyond, rows are accumulated by chunk."""
METHODS = ("irls", "wls", "ols")
_WRONG = 0.01  # maximum share of single-row glitches that are removed from a log
_CLOSED = 0.06, 6.0  # pause with closed-up time stamps: minimum [s], and minimum in usual steps
_DEAD = 0.8  # share of rows with one constant torque, from which a measured torque is dead


def identify(
    robot: Robot,
    logs: Motion | Sequence[Motion],
    *,
    test: Motion | Sequence[Motion] = (),
    motor_inertia: bool = True,
    friction: Sequence[str] = FRICTION,
    cutoff: float | None = None,
    friction_speed: float | None = None,
    shift: float | None = None,
    method: Method = "irls",
    motor_side: MotorSide | None = None,
    known: Mapping[str, float] | None = None,
    payload_only: str | None = None,
    stribeck_speed: float = STRIBECK_SPEED,
    assume: str | Sequence[str] = (),
    progress: Callable[[float], None] | None = None,
) -> IdentifiedRobot:
    """Identify masses, inertias, friction and motor inertias of a robot from logs of positions and torques.

    Parameters
    ----------
    robot : Robot
        Robot without actuators. Groups that the logs do not determine keep the values of its file.
    logs : Motion or sequence of Motion
        Logs with torques, on a fixed base.
    test : Motion or sequence of Motion, optional
        Test logs that are not used for the fit. Without test logs, each fifth of the time is predicted from the others,
        with settings chosen on the others.
    motor_inertia : bool, identify a motor inertia for each joint
    friction : sequence of str, of ``viscous``, ``coulomb``, ``stribeck`` (excess of static friction), ``offset``
    cutoff : float, optional, cut-off of the low-pass [Hz]; None: chosen
    friction_speed : float, optional, Coulomb smoothing speed [rad/s, m/s]; None: chosen for each joint
    shift : float, optional, delay of torques relative to positions [s]; None: chosen
    method : "irls", "wls" or "ols", weights of the rows
    motor_side : MotorSide, optional; motors that turn with several joints have their own friction and inertia
    known : mapping, optional, known values by names such as ``link_3.m`` and ``joint_2.viscous``, in SI units
    payload_only : str, optional
        Frame of a payload. Only the body fixed to it and offsets of the torques are identified; all other parameters,
        including friction, keep the robot's values.
    stribeck_speed : float, Stribeck speed for ``stribeck`` in ``friction`` [rad/s or m/s]
    assume : str or sequence of str, causes to remove from the logs, with values estimated in the fit
        ``gain:JOINT``, ``position-scale:JOINT``, ``zero:JOINT``, ``drift:JOINT``, ``tilt``, ``late``, ``stribeck``;
        ``load-friction``, ``warming`` and ``elasticity``, with ``:JOINT`` or of all joints; ``torque-sign``, ``position-sign``,
        ``both-signs``, ``degrees`` and ``zero-turn``, each with ``:JOINT``; ``exchanged-torques`` and
        ``exchanged-positions``, each with ``:JOINT:JOINT``; ``mounting``; ``time-scale``. The logs are then kept in memory.
    progress : callable, optional, called with the completed share

    Returns
    -------
    found : IdentifiedRobot

    Raises
    ------
    ShapeError
        A log has no torques.
    TrajectoryError
        A log is too short, or belongs to another robot.

    Notes
    -----
    Equations and sources: see the modules of this package, and the documentation page on identification.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.planar_2r(), np.arange(0, 10, 0.01)
    >>> q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    >>> motion = tw.Motion(t, q, robot=arm)
    >>> log = tw.Motion(t, q, tau=motion.torques() + 0.2 * np.sign(motion.dq), robot=arm)
    >>> found = tw.identification.identify(arm, log, motor_inertia=False)
    >>> found.held_out.all < 0.05, found.base.count
    (True, 12)
    """
    require_robot(robot, "identify")
    trained, tested = (
        tuple(_believed(motion) for motion in checked_motions(robot, given, what))
        for given, what in ((logs, "logs"), (test, "test"))
    )
    if not trained:
        raise ShapeError("identify: there is no log. Give one with torques at least.")
    if method not in METHODS:
        raise UnknownNameError.from_choices("method", method, METHODS)
    asked, wanted = fit_options(cutoff, friction_speed, shift), wanted_causes(assume, robot.model.velocity_names)
    same: dict[str, Any] = {
        "motor_inertia": motor_inertia,
        "friction": friction,
        "motor_side": motor_side,
        "known": known,
        "stribeck_speed": stribeck_speed,
    }
    if sum(len(motion) for motion in (*trained, *tested)) > MOST_SAMPLES and not wanted:
        from .streaming import accumulate

        fixed: dict[str, Any] = {"method": method, "cutoff": cutoff, "friction_speed": friction_speed, "shift": shift}
        whole = accumulate(robot, trained, **same, payload_only=payload_only, **fixed, progress=progress)
        return whole.identified(accumulate(robot, tested, like=whole) if tested else None)
    unknown = unknown_of(robot, payload_only=payload_only, **same)
    tell = progress or (lambda _share: None)
    return identified(unknown, robot, trained, tested, asked, method, tell, payload_only=payload_only, wanted=wanted)[0]


def identified(
    unknown: UnknownParameters,
    robot: Robot,
    trained: Sequence[Motion],
    tested: Sequence[Motion],
    asked: FitOptions,
    method: Method,
    tell: Callable[[float], None],
    *,
    payload_only: str | None = None,
    anew: bool = True,
    most_rows: float = MOST_ROWS,
    wanted: Sequence[WantedCause] = (),
) -> tuple[IdentifiedRobot, Array, float]:
    """Identify from checked logs, joints without a torque (nv,), and the autocorrelation length of the residuals.

    If ``anew``, settings are chosen again for each held-out fifth.
    """
    samples, dead, asked = *_rows_of(trained, asked), _without_delay(asked, wanted)

    def build(base: BaseParameters, samples: Sequence[SteadySamples]) -> tuple[SettingRows, Array, Prior]:
        source = SettingRows(base, samples, asked, dead, most_rows)
        sizes = base.unknown.scales(*source.typical())
        return source, sizes, Prior(base.project(base.unknown.file_values), base.weak_sizes(sizes))

    assumed = None
    if wanted:
        begin = begin_settings(unknown.model.nv, samples, asked)
        start = AssumedCauses.estimated(unknown, samples, wanted, begin, dead)
        assumed, settings, (source, sizes, prior) = start.refined(build, method, most_rows)
    else:
        source, sizes, prior = build(BaseParameters.from_unknowns(unknown), samples)
        tell(0.2)
        settings = source.choose(prior, range(FOLDS))
    base, unknown = source.base, source.base.unknown
    tell(0.4)
    trial = Trial(source, settings)
    rows, fold = trial.rows, trial.fold
    x, sigma, weights = weighted_fit(trial.W, trial.tau, prior, method, trial.felt)
    E = np.zeros((*trial.tau.shape, 0)) if assumed is None else assumed.columns(most_rows)
    covariance = fit_covariance(trial, E, x, sigma, weights, prior)
    if assumed is not None:
        settings = replace(settings, assumed=assumed.found(covariance))
        covariance = covariance.of_first(base.count)
    tell(0.5)

    def settings_without(block: int) -> FitSettings:
        if tested or not anew:
            return settings
        chosen = source.choose(prior, [b for b in range(FOLDS) if b != block])
        tell(0.6 + 0.1 * block)
        return chosen

    among = _five_fold(source, prior, method, settings_without)
    held_out = _predicted(source, tested, settings, x, assumed) if tested else among
    begin = replace(settings, shift=asked.shift or 0.0)  # a chosen delay may have another cause
    causes, of_noise = list[Doubt](), covariance.matrix  # doubts are judged by the covariance of noise and states alone
    if not payload_only:
        told, before = diagnose(log_fit(unknown, source.samples, begin, source.dead))
        told = [cause for cause in told if not any(one.stands_for(cause) for one in wanted)]
        causes = cause_doubts(unknown.model.velocity_names, told, settings.shift)
        covariance = covariance.widened(law_changes(before) @ base.grouping.T)
    seen = FittedLog(
        base, (*trained, *tested), trial.W, trial.tau, settings, prior, x, of_noise, held_out, among,
        rows.speed, rows.acceleration, min(s.rate for s in source.samples), source.dead, causes, payload_only is not None,
    )  # fmt: skip
    tell(1.0)
    found = IdentifiedRobot(
        original=uncoupled(robot),
        base=base,
        values=x,
        covariance=covariance,
        sigma=sigma,
        settings=settings,
        held_out=held_out,
        trained=among,
        doubts=doubts_of(seen),
        prior=prior,
        method=method,
        sizes=sizes,
        information=_weighted(trial, sigma, weights).together(),
        folds=tuple(_weighted(trial, sigma, weights, fold == b) for b in range(FOLDS)),
        payload_frame=payload_only,
        notes=(*(f"Assumed: {one}." for one in settings.assumed), *_remarks((*trained, *tested))),
    )
    return found, source.dead, autocorrelation_length((trial.tau - trial.W @ x) / sigma)


_HIGHEST, _FEWEST_ROWS = 5.0, 2.0
"""Maximum cut-off [Hz] of the search for causes without a choice of settings; minimum equations of a joint per group."""
_USUAL_SPEED = 0.03
"""Initial Coulomb smoothing speed of that search [rad/s, m/s]."""


def measured_causes(robot: Robot, logs: Motion | Sequence[Motion]) -> tuple[Doubt, ...]:
    """Find causes of the part of measured torques that the robot's equations cannot explain with any parameters.

    The search equals that of :func:`identify`, at one cut-off and without a choice of settings.

    Parameters
    ----------
    robot : Robot
    logs : Motion or sequence of Motion, with torques

    Returns
    -------
    doubts : tuple of Doubt
        Empty if no cause is found or the logs are too short. Also empty for robots that cannot be identified: on a
        floating base, with joints of several degrees of freedom, or with actuators.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.planar_2r(), np.arange(0, 20, 0.01)
    >>> q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.05 * np.sin(np.outer(t, [41, 43]))
    >>> log = tw.Motion(t, q * [1, -1], tau=tau, robot=arm)
    >>> [doubt.kind for doubt in tw.identification.measured_causes(arm, log)]
    ['position-sign']
    """
    try:
        unknown = UnknownParameters(robot)
        motions = [_believed(motion) for motion in checked_motions(robot, logs, "logs")]
        samples = _samples(motions, "logs")
    except (ModelError, TrajectoryError):
        return ()
    dead, nv = _dead(motions), robot.nv
    cutoff = min(_HIGHEST, 0.1 * min(s.rate for s in samples))
    rows = ROW_RATE * cutoff * sum(s.seconds for s in samples)
    still = not any(moves(motion.q).any() for motion in motions)
    if still or dead.all() or rows < _FEWEST_ROWS * BaseParameters.from_unknowns(unknown).count:
        return ()
    settings = FitSettings(cutoff, np.full(nv, _USUAL_SPEED), 0.0)
    causes, _ = diagnose(log_fit(unknown, samples, settings, dead))
    return tuple(doubt_of_cause(unknown.model.velocity_names, cause) for cause in causes)


def _rows_of(trained: Sequence[Motion], asked: FitOptions) -> tuple[list[SteadySamples], Array]:
    """Samples of the logs, and (nv,) bool, True for joints without a torque."""
    samples = _samples(trained, "logs")
    if asked.cutoff is not None:  # checks for pieces that are too short for the cut-off
        samples = [s for s in samples if s.seconds * asked.cutoff >= 1.0 or not s.cut] or samples
    dead = _dead(trained)
    if dead.all():
        raise TrajectoryError(
            "identify: the torques of all joints are constant throughout, so nothing can be identified."
        )
    return samples, dead


def _without_delay(asked: FitOptions, wanted: Sequence[WantedCause]) -> FitOptions:
    """Options of a fit that assumes ``late``: the delay is then one of the causes. Raises ValueRangeError."""
    if not any(one.kind == "late" for one in wanted):
        return asked
    if asked.shift is not None:
        raise ValueRangeError("a shift is given, and late is assumed, which estimates it. Leave one of them out.")
    return replace(asked, shift=0.0)


def fit_options(cutoff: float | None, friction_speed: float | None, shift: float | None) -> FitOptions:
    """Settings fixed by the caller; raises ValueRangeError for invalid frequencies, speeds and times."""
    if shift is not None and not np.isfinite(shift):
        raise ValueRangeError(f"shift {shift!r} is not a time. Give seconds, such as -0.002.")
    return FitOptions(
        None if cutoff is None else check_speed(cutoff),
        None if friction_speed is None else check_speed(friction_speed),
        None if shift is None else float(shift),
    )


def checked_motions(robot: Robot, given: Motion | Sequence[Motion], what: str) -> tuple[Motion, ...]:
    """Return the logs if they are motions of the robot with torques; raises ShapeError and TrajectoryError."""
    motions = (given,) if isinstance(given, Motion) else tuple(given)
    for k, motion in enumerate(motions):
        if not isinstance(motion, Motion):
            raise ShapeError(
                f"identify: {what} number {k + 1} is not a tw.Motion. tw.Motion.from_file(path, robot) reads one."
            )
        if motion.tau is None:
            raise ShapeError(
                f"identify: {what} number {k + 1} has no torques for every joint. Name their columns JOINT.torque, or "
                "assign them: columns={'JOINT.tau': 'COLUMN'}."
            )
        if motion.robot.coordinate_names != robot.coordinate_names:
            raise TrajectoryError(
                f"identify: {what} number {k + 1} is of {motion.robot.name!r}, whose joints are not those of {robot.name!r}."
            )
    return motions


def _samples(motions: Sequence[Motion], what: str) -> list[SteadySamples]:
    found, spans = list[SteadySamples](), sorted((float(m.time[0]), float(m.time[-1])) for m in motions)
    common = any(after[0] <= before[1] for before, after in pairwise(spans))
    for k, motion in enumerate(motions, 1):
        q = continuous(motion.robot.model, motion.q)
        pieces = SteadySamples.pieces(motion.time, q, np.asarray(motion.tau), f"{what} number {k}")
        found += [replace(piece, log=k if common else 0) for piece in pieces]
    return found


def _believed(motion: Motion) -> Motion:
    """Remove repeated rows and rows with a wrong number, time stamp or spike; reinsert pauses that were closed up."""
    c = motion.coordinates
    at = c.position_of[c.position_of >= 0]
    glitches = SingleRowGlitches(len(at), c.angular[at])
    glitches.add(motion.time, motion.q[:, at])
    wrong, kept, doubts = glitches.times(), ~spikes(np.asarray(motion.tau)).any(axis=1), motion.doubts
    found, time, q = {doubt.kind for doubt in doubts}, motion.time, continuous(motion.robot.model, motion.q)
    if "repeated" in found and (new := new_rows(q)) is not None:
        kept &= new
    if "pause" in found:
        length = max(_CLOSED[0], _CLOSED[1] * float(np.median(np.diff(time))))
        closed_up = [gap.time for gap in gaps(time, q) if not gap.held]
        time = time + length * np.searchsorted(closed_up, time)
    if "held" in found:
        kept &= ~held_rows(motion.time, gaps(motion.time, q))
    if "dropout" in found:
        kept &= ~dropouts(time, np.asarray(motion.tau), q).any(axis=1)
    if 0 < len(wrong) <= max(1.0, _WRONG * len(motion)):
        kept &= ~np.isin(motion.time, wrong)
        names = [motion.robot.model.velocity_names[k] for k in np.flatnonzero(c.position_of >= 0)]
        others = (doubt for doubt in doubts if doubt.kind not in ("single-row", "stamp"))
        doubts = (*others, *row_doubts(glitches, names, left_out=True))
    if kept.all() and time is motion.time:
        return motion
    columns = {name: getattr(motion, name)[kept] for name in ("q", "dq", "ddq", "tau")}
    return replace(motion, time=time[kept], **columns, read=doubts)


def _remarks(motions: Sequence[Motion]) -> tuple[str, ...]:
    """Notes on rows left out of the logs, and on their gaps."""
    said = [doubt.sentence for motion in motions for doubt in motion.doubts if doubt.kind == LEFT_OUT]
    whole = [motion for motion in motions if all(doubt.kind != "pause" for doubt in motion.doubts)]  # not split yet
    lengths = [float(np.diff(motion.time)[k]) for motion in whole for k in pauses(motion.time, PAUSE).tolist()]
    return (*said, *gap_notes(np.array(lengths)))


def _dead(motions: Sequence[Motion]) -> Array:
    """(nv,) bool, True if the torque is constant in nearly all rows, as for a disconnected channel."""
    tau = np.concatenate([np.asarray(m.tau) for m in motions])
    moved = np.any([np.any(np.diff(m.q, axis=0) != 0, axis=0) for m in motions], axis=0)
    share = (tau == np.median(tau, axis=0)).mean(axis=0)
    return np.asarray((np.ptp(tau, axis=0) == 0) | (moved & (share > _DEAD)))


def _five_fold(
    source: SettingRows, prior: Prior, method: Method, settings_without: Callable[[int], FitSettings]
) -> HeldOut:
    """Predict each fifth of the time from the others; fifths with no rows or with all rows are left out."""
    found = list[HeldOut]()
    for block in range(FOLDS):
        trial = Trial(source, settings_without(block))
        here = trial.fold == block
        if not here.any() or here.all():
            continue
        x, _, _ = weighted_fit(trial.W, trial.tau, prior, method, trial.felt, ~here)
        left = HeldOutRows(trial.rows.time[here], trial.rows.log[here], trial.tau[here], trial.W[here] @ x)
        found.append(HeldOut.from_rows("five-fold", left, source.base.unknown.model.velocity_names))
    if not found:
        raise TrajectoryError("identify: the logs are too short to hold a part of them out. Give more seconds.")
    return reduce(operator.add, found)


def _predicted(
    source: SettingRows, tested: Sequence[Motion], settings: FitSettings, x: Array, assumed: AssumedCauses | None
) -> HeldOut:
    """Predict separate test logs with the settings of the training logs and the assumed causes."""
    samples = _samples(tested, "test")
    samples = samples if assumed is None else assumed.of_other_logs(samples)
    options = FitOptions(settings.cutoff, source.asked.friction_speed, settings.shift)
    trial = Trial(SettingRows(source.base, samples, options, source.dead), settings)
    rows = HeldOutRows(trial.rows.time, trial.rows.log, trial.tau, trial.W @ x)
    return HeldOut.from_rows("test", rows, source.base.unknown.model.velocity_names)


def _weighted(trial: Trial, sigma: Array, weights: Array, rows: Array | slice = slice(None)) -> NormalEquations:
    """Normal equations of weighted rows, in units of the residuals."""
    return NormalEquations.from_rows(trial.W, trial.tau, trial.felt, np.sqrt(weights) / sigma, rows)
