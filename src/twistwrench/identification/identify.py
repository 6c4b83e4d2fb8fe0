"""Identification of a robot from logs: rows, settings, fit, covariance, held-out residuals, doubts and verdict."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import ModelError, ShapeError, TrajectoryError, UnknownNameError, ValueRangeError
from ..core.estimation.covariance import GroupCovariance
from ..core.estimation.cross_validation import FOLDS, HeldOut, HeldOutRows
from ..core.estimation.least_squares import Method, NormalEquations, Prior, weighted_fit
from ..core.estimation.sampling import moves
from ..core.numbers import percent
from ..core.text import listed
from ..core.third_party.workers import Failure, Workers
from ..core.typing import Array, Frame, Hertz, Seconds
from ..motion.motion import Motion
from ..reports.checked_motions import expanded_paths
from ..robot import Robot, load
from ..robot.base import require_robot
from ..robots.finding import bundled_file
from .assumed import AssumedCauses, begin_settings, fit_covariance, wanted_causes
from .consistent import check_strength
from .diagnosis.cause_doubts import cause_doubts, doubt_of_cause, laws_of_the_robot
from .diagnosis.cause_fit import log_fit
from .diagnosis.diagnose import WantedCause, diagnose, law_changes
from .doubts.fit_doubts import LEFT_OUT, doubts_of, sorted_doubts
from .doubts.fitted_log import FittedLog
from .hyperparameters import FitOptions, FitSettings, SettingRows, Trial
from .log_windows import Log, LogSource, ReadLog, read_logs, steady_samples
from .parameters import (
    FRICTION,
    STRIBECK_SPEED,
    BaseParameters,
    FrictionLaws,
    UnknownParameters,
    check_speed,
    without_coupled_motors,
)
from .payload import MotorSide, unknown_of
from .result import IdentifiedRobot, without_links
from .rows import MOST_ROWS, ROW_RATE, SteadySamples, gap_notes, lowest_rate, total_seconds

METHODS = ("irls", "wls", "ols")
Causes: TypeAlias = str | Sequence[str]
"""Names of causes of residuals."""
LinkNames: TypeAlias = Sequence[str]
KnownValues: TypeAlias = Mapping[str, float]
"""Values of parameters by name."""
PriorWeight: TypeAlias = float
ObserverGain: TypeAlias = float
_MAX_CONSTANT_ROWS = 0.8
"""Largest share of rows with one constant torque if a torque is measured; above it, the channel is dead."""
_READ_SHARE = 0.2
"""Share of the progress that reading takes."""
_FIT_SHARE = 0.5
"""Share of the progress that the fit without further laws takes; settings take the same share of a fit."""
_SHARE_BEFORE_CAUSES = 0.8
"""Share of the progress of a fit when the search for causes begins."""


def identify(
    robot: Robot | str | Path,
    logs: Log | Sequence[Log],
    *,
    test: Log | Sequence[Log] = (),
    motor_inertia: bool = True,
    friction: FrictionLaws = FRICTION,
    cutoff: Hertz | None = None,
    friction_speed: float | None = None,
    shift: Seconds | None = None,
    method: Method = "irls",
    motor_side: MotorSide | None = None,
    known: KnownValues | None = None,
    payload_only: Frame | None = None,
    stribeck_speed: float = STRIBECK_SPEED,
    assume: Causes = (),
    without: LinkNames = (),
    keep_close: PriorWeight | None = None,
    thresholds: ObserverGain | None = None,
    columns: Mapping[str, str] | None = None,
    rate: float | None = None,
    degrees: bool = False,
    gain: Mapping[str, float] | None = None,
    topic: str | None = None,
    episode: int | None = None,
    client: Any = None,
    progress: Callable[[float], None] | None = None,
) -> IdentifiedRobot:
    """Identify masses, inertias, friction and motor inertias of a robot from logs of positions and torques.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
        Robot without actuators. Groups that the logs do not determine keep the values of its file.
    logs : Motion, path, folder, pattern of paths, or sequence of them; "demo": the log bundled with a robot
        Logs with torques, on a fixed base.
    test : Motion, path, or sequence of them, optional
        Log to predict, not to fit; default: each fifth of the time is predicted from the others, with settings chosen on the
        others.
    motor_inertia : bool, identify a motor inertia for each joint
    friction : sequence of str, of ``viscous``, ``coulomb``, ``stribeck`` (excess of static friction), ``offset``
    cutoff : float, optional
        Cut-off frequency of the zero-phase low-pass filter [Hz]; default: chosen.
    friction_speed : float, optional, Coulomb smoothing speed [rad/s, m/s]; None: chosen for each joint
    shift : float, optional, delay of torques relative to positions [s]; default: chosen
    method : "irls", "wls" or "ols"
        Weights of the least squares: robust (irls), of each joint (wls) or none (ols).
    motor_side : MotorSide, optional; motors that turn with several joints have their own friction and inertia
    known : {name: value}, optional
        Fix parameters at known values, link_3.m=0.73 or joint_2.viscous=1.2, in SI units.
    payload_only : str, optional
        Estimate only a load attached to this frame, and offsets of the torques; all other parameters, also friction, are
        those of the robot.
    stribeck_speed : float, Stribeck speed of the friction stribeck [rad/s, m/s]
    assume : str or sequence of str
        Estimate this cause too, and correct the logs for it: ``gain:JOINT``, ``position-scale:JOINT``, ``zero:JOINT``,
        ``drift:JOINT``, ``tilt``, ``late``, ``stribeck``; ``load-friction``, ``warming`` and ``elasticity``, with ``:JOINT``
        or of all joints; ``torque-sign``, ``position-sign``, ``both-signs``, degrees and ``zero-turn``, each with
        ``:JOINT``; ``exchanged-torques`` and ``exchanged-positions``, each with ``:JOINT:JOINT``; ``mounting``;
        ``time-scale``; ``none``: fit no law of friction unasked.
    without : sequence of str
        Link that the robot of the logs lacks, as for :func:`without_links`.
    keep_close : float, optional
        Weight γ of the prior of physically consistent bodies, 0.01 to 100000; default: chosen by cross-validation.
    thresholds : float, optional
        Gain of a momentum observer [1/s]: find thresholds of its residual for collision detection, in the longest part of the
        logs without a pause, as :meth:`IdentifiedRobot.residual_thresholds`.
    columns, rate, degrees, gain, topic, episode : options for reading files, as for
        :meth:`Motion.from_file <twistwrench.Motion.from_file>`
    client : dask.distributed.Client, optional, whose workers read the logs; results do not depend on it, to the bit
    progress : callable, optional, called with the completed share

    Returns
    -------
    found : IdentifiedRobot
        ``found.verdict``, ``found.robot``, ``found.parameters``, ``found.write(path)``.

    Raises
    ------
    ShapeError
        There is no log, or a motion has no torques.
    TrajectoryError
        A motion belongs to another robot, or no log can be read. If one of several logs cannot be read, it is left out with a
        doubt.

    Notes
    -----
    All rows are checked. If all logs together have more than 200,000 samples, the fit uses that many, in windows spread
    evenly over every log.

    Equations and sources: see the modules of this package, and the documentation page on identification.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.planar_2r(), np.arange(0, 10, 0.01)
    >>> q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    >>> motion = tw.Motion(t, q, robot=arm)
    >>> log = tw.Motion(t, q, tau=motion.torques() + 0.2 * np.sign(motion.dq), robot=arm)
    >>> found = tw.identify(arm, log, motor_inertia=False)
    >>> found.held_out.all < 0.05, found.base.count
    (True, 12)
    >>> print(tw.identify("planar_2r", "demo").headline)
    OK: predicts torques to 1.74 % (worst joint joint1, 1.77 %), in 5-fold cross-validation over time.
    """
    loaded, bundle_name = _robot_with_name(robot)
    robot = without_links(loaded, without)
    check_strength(keep_close)
    logs = log_paths(logs, bundle_name)
    test = log_paths(test, bundle_name)
    _check_method(method)
    options = fit_options(cutoff, friction_speed, shift)
    may_fit_laws = assume not in ("none", ["none"], ("none",))
    causes = wanted_causes(assume, robot.model.velocity_names) if may_fit_laws else ()
    reading: dict[str, Any] = {"columns": columns, "rate": rate, "degrees": degrees, "gain": gain, "side": motor_side}
    reading |= {"topic": topic, "episode": episode}
    training_sources = _training_sources(robot, logs, reading)
    sources = (*training_sources, *log_sources(robot, test, "test", reading))
    unknown = unknown_of(
        robot, motor_inertia=motor_inertia, friction=friction, motor_side=motor_side, known=known,
        payload_only=payload_only, stribeck_speed=stribeck_speed,
    )  # fmt: skip
    report_progress = progress or (lambda _share: None)
    results = read_logs(sources, Workers.from_client(client), lambda share: report_progress(_READ_SHARE * share))
    training_logs = _readable(results[: len(training_sources)])
    test_logs = _readable(results[len(training_sources) :])
    fit = partial(
        _identify_once, unknown, robot, training_logs, test_logs, method=method, payload_only=payload_only,
        read_doubts=_unreadable(sources, results),
    )  # fmt: skip
    found, laws = fit(options, causes, report_progress=partial(_report_fit, report_progress))
    if may_fit_laws and laws and not payload_only:
        with_laws, _ = fit(_options_at_cutoff(options, found), (*causes, *laws), report_progress=report_progress)
        found = _better_with(laws, found, with_laws)
    report_progress(1.0)
    return _with_thresholds(replace(found, strength=keep_close, logs=_files(*logs, *test)), training_logs, thresholds)


def _check_method(method: str) -> None:
    """Raise UnknownNameError for an unknown method of least squares."""
    if method not in METHODS:
        raise UnknownNameError.from_choices("method", method, METHODS)


def _training_sources(robot: Robot, logs: Sequence[Log], reading: Mapping[str, Any]) -> tuple[LogSource, ...]:
    """Sources of the logs that are fitted; raises ShapeError if there are none."""
    sources = log_sources(robot, logs, "logs", reading)
    if not sources:
        raise ShapeError("identify: there is no log. Give one with torques at least.")
    return sources


def _robot_with_name(robot: Robot | str | Path) -> tuple[Robot, str]:
    """Robot, loaded if it is a path or a name, and the name by which logs are bundled with it."""
    if isinstance(robot, str | Path):
        return require_robot(load(robot), "identify"), str(robot)
    robot = require_robot(robot, "identify")
    return robot, robot.name


def _report_fit(report_progress: Callable[[float], None], share: float) -> None:
    """Report the completed share of a fit as a part of the whole."""
    report_progress(_READ_SHARE + _FIT_SHARE * share)


def _files(*logs: Log) -> tuple[str, ...]:
    """Paths of the logs that are files."""
    return tuple(str(log) for log in logs if isinstance(log, str | Path))


def _with_thresholds(found: IdentifiedRobot, logs: Sequence[ReadLog], gain: float | None) -> IdentifiedRobot:
    """Identification with thresholds of an observer's residual; without them if its gain is None."""
    if gain is None:
        return found
    motion = _longest_motion(logs, found.original)
    return replace(found, thresholds=found.residual_thresholds(motion, gain))


def _longest_motion(logs: Sequence[ReadLog], robot: Robot) -> Motion:
    """Longest part of the logs without a pause, as a motion of positions and torques."""
    longest = max(steady_samples(logs), key=lambda piece: piece.seconds)
    time = longest.start + np.arange(len(longest.q)) / longest.rate
    return Motion(time, longest.q, tau=longest.tau, robot=robot, in_seconds=True)


def log_paths(given: Log | Sequence[Log], robot: str) -> list[Log]:
    """Logs, with folders and patterns replaced by their files, sorted by name, and ``demo`` by the robot's bundled log."""
    if not isinstance(given, Iterable | Motion | Path):
        raise ShapeError(f"logs={given!r}: give a tw.Motion with torques, the path of a log, or a list of them.")
    paths = list[Log]()
    for log in _sequence(given):
        if isinstance(log, str | Path):
            paths += expanded_paths(bundled_file(str(log), robot, "_log.csv", "log"))
        else:
            paths.append(log)
    return paths


def _sequence(given: Log | Sequence[Log]) -> Sequence[Log]:
    """Logs as a sequence, also if only one is given."""
    return [given] if isinstance(given, Motion | str | Path) else given


def log_sources(
    robot: Robot, given: Log | Sequence[Log], argument_name: str, reading: Mapping[str, Any]
) -> tuple[LogSource, ...]:
    """Sources of logs; raises ShapeError and TrajectoryError for motions without torques or of another robot."""
    sources = []
    for k, log in enumerate(_sequence(given), 1):
        sources.append(LogSource.from_log(robot, log, f"{argument_name} number {k}", reading))
    return tuple(sources)


def _readable(logs: Sequence[ReadLog | Failure]) -> tuple[ReadLog, ...]:
    """Logs that could be read; raises TrajectoryError if all of them failed."""
    readable_logs = list[ReadLog]()
    failures = list[Failure]()
    for log in logs:
        if isinstance(log, Failure):
            failures.append(log)
        else:
            readable_logs.append(log)
    if failures and not readable_logs:
        first_failure = failures[0]
        if first_failure.problem is None:
            raise TrajectoryError(first_failure.reason)
        raise TrajectoryError(*first_failure.problem.args)
    return tuple(readable_logs)


def _unreadable(sources: Sequence[LogSource], logs: Sequence[ReadLog | Failure]) -> list[Doubt]:
    """Doubts about logs that could not be read."""
    doubts: list[Doubt] = []
    for source, log in zip(sources, logs, strict=True):
        if isinstance(log, Failure):
            doubts.append(doubt("left-out", path=source.path, reason=log.reason))
    return doubts


def _identify_once(
    unknown: UnknownParameters,
    robot: Robot,
    training_logs: Sequence[ReadLog],
    test_logs: Sequence[ReadLog],
    options: FitOptions,
    assumed_causes: Sequence[WantedCause],
    *,
    method: Method,
    payload_only: str | None,
    read_doubts: Sequence[Doubt],
    report_progress: Callable[[float], None],
) -> tuple[IdentifiedRobot, tuple[WantedCause, ...]]:
    """Identify from logs that were read; also returns the laws of the robot that the residual shows.

    ``read_doubts`` are about logs that could not be read.
    """
    samples, is_dead = _rows_of(training_logs, options)
    options = _without_delay(options, assumed_causes)
    chosen = _chosen_settings(
        unknown, samples, is_dead, options, method, assumed_causes, partial(_report_fit, report_progress),
        needs_folds=not test_logs,
    )  # fmt: skip
    rows = chosen.rows
    prior = chosen.prior
    base = rows.base
    rows.release()
    trial = Trial(rows, chosen.settings)
    x, sigma, weights = weighted_fit(trial.W, trial.tau, prior, method, trial.felt)
    settings, covariance = _with_covariance(chosen, trial, x, sigma, weights)
    five_fold = _five_fold(rows, prior, method, chosen.without_fifth)
    held_out = five_fold
    if test_logs:
        held_out = _predict_tests(rows, test_logs, settings, x, chosen.assumed)
    report_progress(_SHARE_BEFORE_CAUSES)
    causes: list[Doubt] = []
    laws: tuple[WantedCause, ...] = ()
    noise_covariance = covariance.matrix  # for doubts: the covariance by noise and states alone
    if not payload_only:
        initial_settings = replace(settings, shift=options.shift or 0.0)  # a chosen delay may have another cause
        causes, laws, changes = _diagnosis(rows, initial_settings, settings.shift, assumed_causes)
        covariance = covariance.widened(changes @ base.grouping.T)
    fifths = tuple(_normal_equations(trial, sigma, weights, trial.fold == fifth) for fifth in range(FOLDS))
    fitted = FittedLog(
        base=base, logs=(*training_logs, *test_logs), W=trial.W, tau=trial.tau, settings=settings, prior=prior, x=x,
        covariance=noise_covariance, held_out=held_out, trained=five_fold, fifths=fifths, speed=trial.rows.speed,
        acceleration=trial.rows.acceleration, rate=lowest_rate(rows.samples), dead=rows.dead, causes=causes,
        payload_only=payload_only is not None,
    )  # fmt: skip
    report_progress(1.0)
    found = IdentifiedRobot(
        original=without_coupled_motors(robot), base=base, values=x, covariance=covariance, sigma=sigma,
        settings=settings, method=method, prior=prior, sizes=chosen.sizes,
        held_out=held_out, trained=five_fold, _fifths=fifths,
        doubts=sorted_doubts([*read_doubts, *doubts_of(fitted)]),
        payload_frame=payload_only,
        notes=(*_assumed_notes(settings), *_remarks(fitted.logs)),
        torque_shares=fitted.torque_shares,
    )  # fmt: skip
    return found, laws


def _assumed_notes(settings: FitSettings) -> list[str]:
    """Note on each assumed cause."""
    return [f"Assumed: {cause}." for cause in settings.assumed]


def _with_covariance(
    chosen: _ChosenSettings, trial: Trial, x: Array, sigma: Array, weights: Array
) -> tuple[FitSettings, GroupCovariance]:
    """Settings with the values of the assumed causes, and covariance of the groups."""
    if chosen.assumed is None:
        no_columns = np.zeros((*trial.tau.shape, 0))
        return chosen.settings, fit_covariance(trial, no_columns, x, sigma, weights, chosen.prior)
    covariance = fit_covariance(trial, chosen.assumed.columns(MOST_ROWS), x, sigma, weights, chosen.prior)
    settings = replace(chosen.settings, assumed=chosen.assumed.values(covariance))
    return settings, covariance.of_first(chosen.rows.base.count)


def _diagnosis(
    rows: SettingRows, initial_settings: FitSettings, shift: float, assumed_causes: Sequence[WantedCause]
) -> tuple[list[Doubt], tuple[WantedCause, ...], Array]:
    """Causes of the residual, from a search that starts at initial settings; ``shift`` is the delay that the fit has removed.

    Returns
    -------
    doubts : doubts about causes that are not assumed
    laws : laws of the robot that could be fitted
    changes : (k, p) array, changes of the parameters by laws that are not fitted
    """
    unknown = rows.base.unknown
    causes, fit_without_laws = diagnose(log_fit(unknown, rows.samples, initial_settings, rows.dead))
    for assumed_cause in assumed_causes:
        causes = [cause for cause in causes if not assumed_cause.stands_for(cause)]
    doubts = cause_doubts(unknown.model.velocity_names, causes, shift)
    return doubts, laws_of_the_robot(causes), law_changes(fit_without_laws)


_MIN_DECREASE = 0.05
"""Relative decrease of the held-out residual from which a law of the robot is fitted although the user does not assume it."""


def _options_at_cutoff(options: FitOptions, found: IdentifiedRobot) -> FitOptions:
    """Options with the cut-off of a fit, so that the residuals of both fits are comparable."""
    return replace(options, cutoff=found.settings.cutoff)


def _better_with(laws: Sequence[WantedCause], without: IdentifiedRobot, found: IdentifiedRobot) -> IdentifiedRobot:
    """Fit ``found`` with laws of the robot if rows held out confirm them; else the fit without them, with a note."""
    residual = found.held_out.all
    residual_without = without.held_out.all
    kinds = [law.kind for law in laws]
    if residual > (1.0 - _MIN_DECREASE) * residual_without:
        shares = f"{percent(residual, 3)} of the torques in rows held out, in place of {percent(residual_without, 3)}"
        note = f"Not fitted: {listed(kinds)}, which would leave {shares}."
        return replace(without, notes=(*without.notes, note))
    reason = f"as it leaves {percent(residual, 3)} in place of {percent(residual_without, 3)} in rows held out"
    notes = list(found.notes)
    law_notes: list[str] = []
    for cause in found.settings.assumed:
        if cause.kind in kinds:  # fitted, but not assumed by the user
            notes.remove(f"Assumed: {cause}.")
            law_notes.append(f"Fitted: {cause}, {reason}.")
    return replace(found, notes=(*law_notes, *notes))


@dataclass(frozen=True, eq=False)
class _ChosenSettings:
    """Rows of a fit, with its prior and its settings."""

    rows: SettingRows
    sizes: Array
    """(p,) largest plausible sizes of the unknown parameters."""
    prior: Prior
    """Weak prior of the groups."""
    assumed: AssumedCauses | None
    """Causes that were removed from the logs; None without any."""
    settings: FitSettings
    """Settings chosen on all rows."""
    without_fifth: Sequence[FitSettings]
    """Settings chosen without each fifth of the time."""


def _chosen_settings(
    unknown: UnknownParameters,
    samples: Sequence[SteadySamples],
    is_dead: Array,
    options: FitOptions,
    method: Method,
    assumed_causes: Sequence[WantedCause],
    progress: Callable[[float], None],
    *,
    needs_folds: bool,
) -> _ChosenSettings:
    """Choose settings, after assumed causes are removed.

    If ``needs_folds`` is True, settings are also chosen without each fifth of the time; otherwise these are the settings of all
    rows. ``is_dead`` (nv,) is True for joints without a torque.
    """

    def build(base: BaseParameters, samples: Sequence[SteadySamples]) -> tuple[SettingRows, Array, Prior]:
        """Rows of samples, sizes of the unknown parameters, and weak prior of the groups."""
        rows = SettingRows(base, samples, options, is_dead)
        sizes = base.unknown.scales(*rows.typical())
        file_values = base.project(base.unknown.file_values)
        return rows, sizes, Prior(file_values, base.weak_sizes(sizes))

    fifths = list(range(FOLDS))
    others_of_fifth = [fifths[:k] + fifths[k + 1 :] for k in fifths]
    if assumed_causes:
        initial_settings = begin_settings(unknown.model.nv, samples, options)
        initial_causes = AssumedCauses.from_logs(unknown, samples, assumed_causes, initial_settings, is_dead)
        assumed, settings, rows_sizes_and_prior = initial_causes.refine(build, method, MOST_ROWS)
        rows, sizes, prior = rows_sizes_and_prior
        without_fifth = [settings] * FOLDS
        if needs_folds:
            without_fifth = rows.choose(prior, others_of_fifth, progress)
        return _ChosenSettings(rows, sizes, prior, assumed, settings, without_fifth)
    rows, sizes, prior = build(BaseParameters.from_unknowns(unknown), samples)
    if needs_folds:
        settings, *without_fifth = rows.choose(prior, [fifths, *others_of_fifth], progress)
    else:
        (settings,) = rows.choose(prior, [fifths], progress)
        without_fifth = [settings] * FOLDS
    return _ChosenSettings(rows, sizes, prior, None, settings, without_fifth)


_MAX_SEARCH_CUTOFF = 5.0
"""Maximum cut-off [Hz] of the search for causes without a choice of settings."""
_MAX_SEARCH_CUTOFF_OF_RATE = 0.1
"""Maximum cut-off of this search, as a share of the sampling rate."""
_MIN_ROWS_OF_GROUP = 2.0
"""Minimum number of rows for each group of parameters in this search."""
_SEARCH_FRICTION_SPEED = 0.03
"""Initial Coulomb smoothing speed of this search [rad/s, m/s]."""


def measured_causes(robot: Robot, logs: Log | Sequence[Log]) -> tuple[Doubt, ...]:
    """Find causes of the part of measured torques that the robot's equations cannot explain with any parameters.

    The search equals that of :func:`identify`, at one cut-off and without a choice of settings.

    Parameters
    ----------
    robot : Robot
    logs : Motion, path, or sequence of them, with torques

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
        sources = log_sources(robot, logs, "logs", {})
        readable_logs = _readable(read_logs(sources, Workers(), lambda _share: None))
    except (ModelError, TrajectoryError):
        return ()
    samples = steady_samples(readable_logs)
    is_dead = _dead_torques(readable_logs)
    cutoff = min(_MAX_SEARCH_CUTOFF, _MAX_SEARCH_CUTOFF_OF_RATE * lowest_rate(samples))
    row_count = ROW_RATE * cutoff * total_seconds(samples)
    is_at_rest = not any(moves(log.q).any() for log in readable_logs)
    if is_at_rest or is_dead.all():
        return ()
    if row_count < _MIN_ROWS_OF_GROUP * BaseParameters.from_unknowns(unknown).count:
        return ()
    settings = FitSettings(cutoff, np.full(robot.nv, _SEARCH_FRICTION_SPEED), 0.0)
    causes, _ = diagnose(log_fit(unknown, samples, settings, is_dead))
    return tuple(doubt_of_cause(unknown.model.velocity_names, cause) for cause in causes)


def _rows_of(logs: Sequence[ReadLog], options: FitOptions) -> tuple[list[SteadySamples], Array]:
    """Samples of the logs, and (nv,) bool, True for joints without a torque."""
    samples = steady_samples(logs)
    cutoff = options.cutoff
    if cutoff is not None:  # pieces shorter than a period of the cut-off are left out, if there are others
        long_samples = [piece for piece in samples if piece.seconds * cutoff >= 1.0 or not piece.cut]
        samples = long_samples or samples
    is_dead = _dead_torques(logs)
    if is_dead.all():
        raise TrajectoryError(
            "identify: the torques of all joints are constant throughout, so nothing can be identified."
        )
    return samples, is_dead


def _without_delay(options: FitOptions, assumed_causes: Sequence[WantedCause]) -> FitOptions:
    """Options without a delay if ``late`` is assumed, since the delay is then one of the causes.

    Raises ValueRangeError if the user gives a delay, too.
    """
    if not any(cause.kind == "late" for cause in assumed_causes):
        return options
    if options.shift is not None:
        raise ValueRangeError("a shift is given, and late is assumed, which estimates it. Leave one of them out.")
    return replace(options, shift=0.0)


def fit_options(cutoff: float | None, friction_speed: float | None, shift: float | None) -> FitOptions:
    """Settings fixed by the caller; raises ValueRangeError for invalid frequencies, speeds and times."""
    if shift is not None:
        if not np.isfinite(shift):
            raise ValueRangeError(f"shift {shift!r} is not a time. Give seconds, such as -0.002.")
        shift = float(shift)
    if cutoff is not None:
        cutoff = check_speed(cutoff)
    if friction_speed is not None:
        friction_speed = check_speed(friction_speed)
    return FitOptions(cutoff, friction_speed, shift)


def _remarks(logs: Sequence[ReadLog]) -> tuple[str, ...]:
    """Notes on rows left out of the logs, on their gaps, and on the windows of long logs."""
    notes: list[str] = []
    for log in logs:
        notes += [log_doubt.sentence for log_doubt in log.doubts if log_doubt.kind == LEFT_OUT]
    used_count = sum(log.count for log in logs)
    total_count = sum(log.checks.count for log in logs)
    if used_count < total_count:
        window_count = sum(len(log.windows) for log in logs)
        notes.append(f"{_three_digits(used_count)} of {_three_digits(total_count)} samples, in {window_count} windows.")
    gaps = np.concatenate([log.gaps for log in logs])
    return (*notes, *gap_notes(gaps))


def _three_digits(count: int) -> str:
    """Number with three digits and separators of thousands."""
    digit_count = len(str(count))
    return f"{round(count, 3 - digit_count):,}"


def _dead_torques(logs: Sequence[ReadLog]) -> Array:
    """(nv,) bool, True if the torque of a joint is constant, as of a disconnected channel.

    For a joint that moves, it is enough if the torque is constant in nearly all rows.
    """
    tau = np.concatenate([log.tau for log in logs])
    moves_in_logs = [(np.diff(log.q, axis=0) != 0).any(axis=0) for log in logs]
    has_moved = np.any(moves_in_logs, axis=0)
    constant_share = (tau == np.median(tau, axis=0)).mean(axis=0)
    is_constant = np.ptp(tau, axis=0) == 0
    return np.asarray(is_constant | (has_moved & (constant_share > _MAX_CONSTANT_ROWS)))


def _five_fold(source: SettingRows, prior: Prior, method: Method, settings: Sequence[FitSettings]) -> HeldOut:
    """Predictions of each fifth of the time from the others; fifths with no rows or with all rows are left out."""
    held_out_fifths = list[HeldOut]()
    for fifth in range(FOLDS):
        trial = Trial(source, settings[fifth])
        is_held_out = trial.fold == fifth
        if not is_held_out.any() or is_held_out.all():
            continue
        x, _, _ = weighted_fit(trial.W, trial.tau, prior, method, trial.felt, ~is_held_out)
        predicted_tau = trial.W[is_held_out] @ x
        rows = HeldOutRows(
            trial.rows.time[is_held_out], trial.rows.log[is_held_out], trial.tau[is_held_out], predicted_tau
        )
        held_out_fifths.append(HeldOut.from_rows("five-fold", rows, source.base.unknown.model.velocity_names))
    if not held_out_fifths:
        raise TrajectoryError("identify: the logs are too short to hold a part of them out. Give more seconds.")
    return reduce(operator.add, held_out_fifths)


def _predict_tests(
    source: SettingRows, test_logs: Sequence[ReadLog], settings: FitSettings, x: Array, assumed: AssumedCauses | None
) -> HeldOut:
    """Predictions of separate test logs with the settings of the training logs and the assumed causes."""
    samples = steady_samples(test_logs)
    if assumed is not None:
        samples = assumed.correct_other_logs(samples)
    options = FitOptions(settings.cutoff, source.asked.friction_speed, settings.shift)
    trial = Trial(SettingRows(source.base, samples, options, source.dead), settings)
    rows = HeldOutRows(trial.rows.time, trial.rows.log, trial.tau, trial.W @ x)
    return HeldOut.from_rows("test", rows, source.base.unknown.model.velocity_names)


def _normal_equations(trial: Trial, sigma: Array, weights: Array, rows: Array | slice = slice(None)) -> NormalEquations:
    """Normal equations of weighted rows, in units of the residuals."""
    return NormalEquations.from_rows(trial.W, trial.tau, trial.felt, np.sqrt(weights) / sigma, rows)
