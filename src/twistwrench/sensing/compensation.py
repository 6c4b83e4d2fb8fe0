"""Compensation of a log by a known sensor: readings without load, contacts, and causes if the sensor does not explain it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt, Level, doubt, verdict_from_doubts
from ..core.errors import ModelWarning, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.gravity import KGF, STRENGTH
from ..core.numbers import number, percent
from ..core.text import Argument
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from .contact_detection import CollisionThreshold, checked_noise
from .doubts.departure import departure
from .doubts.reading_doubts import listed_bias, seems_moving
from .doubts.unit_doubts import MIXUPS, Mixup
from .files import SensorFile, read_sensor_file, readings_of, sensor_path, write_compensated
from .log import ReadingLog, ReadingsGiven
from .result import Identification
from .sensor import ForceTorqueSensor
from .uncertainty import Uncertainty

SensorGiven: TypeAlias = ForceTorqueSensor | Identification | str | Path
"""Sensor, with the noise of its readings, or the path of its file."""

FALSE_ALARM_RATE = 1e-6
"""Probability that noise alone makes a reading an outlier."""
MIN_SHARE_OF_UNKNOWN_INERTIA = 0.1
"""Fraction of readings with unexplained moments above which an unknown inertia shows."""
_NAMED_CAUSES = ("sensor-file-cause", "sensor-moving")
"""Kinds of doubts that name a cause."""
MIN_MODEL_ERROR = 1e-3
"""Smallest error of the model, relative to the load's wrench. Noise below it is not relied upon."""
_MIN_DEVIATION = 1e-9
"""Smallest standard deviation of noise and model error together [N m or N], so that quotients stay finite."""


@dataclass(frozen=True, eq=False, repr=False)
class Compensation(Answer):
    r"""Readings without bias and load, and contacts: result of :func:`compensate`.

    Examples
    --------
    >>> import tempfile
    >>> found = compensate("demo-motion", "demo", false_alarms=1e-6)
    >>> found
    <Compensation: CONTACT, 19 of 301 readings>
    >>> found.facts(), found.sources()["LOG"].name, str(next(found.blocks()).word)
    ({'contacts': '19 of 301 readings'}, 'demo_motion.csv', 'CONTACT')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.to_csv(f"{folder}/rest.csv").read_text().partition("\n")[0]
    'time,mx,my,mz,fx,fy,fz'
    """

    call: ClassVar[str] = "sensor compensate"

    log: ReadingLog
    """Readings, with orientations and gravity."""
    sensor: ForceTorqueSensor
    """Sensor with its load."""
    noise: tuple[float, float]
    """Standard deviations of moments [N m] and forces [N]."""
    rest: Array
    """(n, 6) residuals: readings without bias and load [N m, N]."""
    off: Array
    """(n,) True for readings that noise does not explain."""
    doubts: tuple[Doubt, ...]
    """Reasons why sensor and log do not match, and notes."""
    threshold: CollisionThreshold | None
    """Contact threshold; None if contacts are not tested."""
    files: Mapping[str, Path]
    """Files of the question, by argument."""

    @property
    def subject(self) -> str:
        """File of the log."""
        return Path(self.log.name).name

    @property
    def brief(self) -> str:
        """Number of contacts, if there are any."""
        if self.verdict.word is not Word.CONTACT:
            return ""
        return f"{self.hits.sum()} of {len(self.log)} readings"

    # ── What was found

    @property
    def inertia(self) -> Doubt | None:
        """Doubt about residual moments due to an unknown load inertia; None if there is none."""
        for each_doubt in self.doubts:
            if each_doubt.kind == "sensor-file-inertia":
                return each_doubt
        return None

    @property
    def explained(self) -> bool:
        """True if the sensor explains the log, except for an unknown inertia of its load."""
        mismatches = [doubt for doubt in self.doubts if doubt.refuses and doubt is not self.inertia]
        return not mismatches

    @cached_property
    def hits(self) -> Array:
        """Contacts (n,), as a mask; all False without a contact test, or if the file does not explain the log."""
        if self.threshold is None or not self.explained:
            return np.zeros(len(self.log), bool)
        return self.threshold(self.rest)

    @property
    def verdict(self) -> Verdict:
        """CONTACT if there are contacts, LOOK AGAIN if a doubt refuses the result, else OK."""
        hit_count = int(self.hits.sum())
        if hit_count:
            return Verdict(Word.CONTACT, (f"{hit_count} of {len(self.log)} readings are more than noise explains",))
        return verdict_from_doubts(self.doubts)

    @property
    def doubtful(self) -> bool:
        """True if the verdict is not OK."""
        return not self.verdict.ok

    # ── The answer on every surface

    def blocks(self) -> Iterator[Block]:
        """Verdict, contacts, readings before and after, and remarks."""
        from .views import compensation_view

        return compensation_view(self)

    def facts(self) -> Mapping[str, str]:
        """Number of contacts if they were tested; otherwise the share of readings that noise explains.

        Returns
        -------
        facts : {name: text}
        """
        if self.threshold is not None and self.explained:
            return {"contacts": f"{self.hits.sum()} of {len(self.log)} readings"}
        explained_share = float(np.mean(~self.off))
        return {"explained": percent(explained_share, 3)}

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the log and of the sensor.

        Returns
        -------
        files : {argument: path}
        """
        return self.files

    def to_csv(self, path: str | Path) -> Path:
        """Write the readings without bias and load as a table, with times if the log has them.

        Returns
        -------
        path : Path of the file
        """
        return write_compensated(self.log, self.rest, path)


def compensate(
    log: ReadingsGiven,
    sensor: SensorGiven,
    *,
    noise: tuple[float, float] | None = None,
    false_alarms: float | None = None,
    uncertainty: Uncertainty | None = None,
    gravity: float = STRENGTH,
) -> Compensation:
    """Subtract bias, weight and inertial load from a log, and detect contacts if requested.

    Parameters
    ----------
    log : ReadingLog, path of a log, "demo" or "demo-motion"
    sensor : path of a sensor file, Identification, or ForceTorqueSensor with ``noise``
        Sensor file written by `identify --save`, or 'demo'.
    noise : (moment [N m], force [N]), optional, standard deviations of a reading; default: those of the file
    false_alarms : float, optional
        Detect contacts, with this false-alarm rate per reading, for example 1e-6.
    uncertainty : Uncertainty, optional, of a sensor without a file, as :attr:`Identification.uncertainty`
    gravity : float
        Its size [m/s²], for a log that is read from a file; -z of the world.

    Returns
    -------
    found : Compensation
        ``found.verdict``, ``found.rest``, ``found.hits``.

    Raises
    ------
    NotFoundError, ShapeError, ValueRangeError
        The log or the sensor cannot be read, or the noise is missing.

    Notes
    -----
    With the sensor's uncertainty the residual r has the covariance S = diag σ² + A C A' of a new reading, and contacts are
    detected by Student's quantiles. Otherwise the noise is used, as if the sensor were known exactly. If the inertia is
    unknown and the log has motion, only forces are tested: the inertia does not affect them.

    Examples
    --------
    >>> found = compensate("demo-motion", "demo", false_alarms=1e-6)
    >>> print(found.headline)
    CONTACT: 19 of 301 readings, 4.020 to 4.380 s; up to 6.536 N.
    """
    known, files = _known_sensor(sensor, noise, uncertainty)
    readings = readings_of(log, gravity, "compensate")
    if Path(readings.name).is_file():
        files = {"LOG": Path(readings.name), **files}
    return _test_residuals(readings, known, false_alarms, files)


def _known_sensor(
    sensor: SensorGiven, noise: tuple[float, float] | None, uncertainty: Uncertainty | None
) -> tuple[SensorFile, dict[str, Path]]:
    """Sensor with the noise and the uncertainty of its readings, and its file by argument; no file without one."""
    files: dict[str, Path] = {}
    if isinstance(sensor, ForceTorqueSensor):
        if noise is None:
            raise ValueRangeError("a sensor without a file needs the noise of its readings: {0}.", Argument("noise"))
        return SensorFile(sensor, noise, uncertainty), files
    if isinstance(sensor, Identification):
        known = SensorFile(sensor.sensor, sensor.noise, sensor.uncertainty)
    elif isinstance(sensor, str | Path):
        path = sensor_path(sensor)
        known = read_sensor_file(path)
        files = {"SENSOR": path}
    else:
        raise ShapeError(
            "compensate takes a ForceTorqueSensor, an Identification or the path of a sensor file, got "
            f"{type(sensor).__name__}."
        )
    return SensorFile(known.sensor, noise or known.noise, uncertainty or known.uncertainty), files


def _test_residuals(
    log: ReadingLog, known: SensorFile, false_alarms: float | None, files: Mapping[str, Path]
) -> Compensation:
    """Residuals of a log, tested by the uncertainty of its sensor."""
    sensor, noise, uncertainty = known.sensor, known.noise, known.uncertainty
    lacks_inertia = sensor.missing_signals(log.V, log.dV)
    tested_axes = slice(3, 6) if lacks_inertia else slice(0, 6)  # forces alone, or all
    notes = []
    freedom = None  # degrees of freedom of Student's distribution; None for a normal one
    if uncertainty is None:
        if false_alarms is not None:
            notes.append(doubt("sensor-file-covariance"))
            checked_noise(noise)  # raises ValueRangeError for unusable noise
        S = np.diag(np.repeat(noise, 3) ** 2)
    else:
        S = uncertainty.predictive(log, sensor)
        freedom = uncertainty.noise_freedom
    threshold = None
    if false_alarms is not None:
        threshold = CollisionThreshold.predictive(S, freedom, false_alarms, axes=tested_axes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # reported as a doubt
        rest = log.compensated(sensor)
    load_wrenches = (log.predicted(sensor) - np.asarray(sensor.bias)).reshape(-1, 2, 3)
    rms_load = np.sqrt((load_wrenches**2).sum(axis=2).mean(axis=0))  # (2,): moment [N m] and force [N]
    deviation = np.maximum(np.hypot(noise, MIN_MODEL_ERROR * rms_load), _MIN_DEVIATION)  # of noise and model error
    variance = np.repeat(deviation, 3) ** 2
    if uncertainty is None:
        S_with_model_error = np.diag(variance)
    else:
        model_variance = np.maximum(variance - np.repeat(noise, 3) ** 2, 0.0)
        S_with_model_error = S + np.diag(model_variance)
    outlier_test = CollisionThreshold.predictive(S_with_model_error, freedom, FALSE_ALARM_RATE, axes=tested_axes)
    is_outlier = outlier_test(rest)
    if lacks_inertia:
        moment_test = CollisionThreshold.of_noise(tuple(deviation), FALSE_ALARM_RATE, axes=slice(0, 3))
        inertia_shows = moment_test(rest).mean() > MIN_SHARE_OF_UNKNOWN_INERTIA
        level: Level | None = None  # that of the kind of doubt
        if inertia_shows and threshold is None:
            level = "refuse"
        notes.append(doubt("sensor-file-inertia", level=level))
    doubts = _mismatch_doubts(
        log, sensor, noise, rest, is_outlier=is_outlier, deviation=deviation, tested_axes=tested_axes
    )
    reading_variance = np.diagonal(S_with_model_error, axis1=-2, axis2=-1)
    sigma = np.sqrt(np.broadcast_to(reading_variance, rest.shape))
    departure_test = outlier_test if threshold is None else threshold
    departure_doubt = departure(log, sensor, rest, sigma, departure_test)
    has_cause = any(mismatch.kind in _NAMED_CAUSES for mismatch in doubts)
    if departure_doubt and not has_cause:
        doubts = [departure_doubt]
    all_doubts = (*notes, *doubts, *log.motion_doubts())
    return Compensation(log, sensor, noise, rest, is_outlier, all_doubts, threshold, files)


MIN_RATIO_TO_NOISE = 5.0
"""Ratio of residual to noise from which a cause is sought. A cause must reduce the residual by this ratio, too."""
MIN_DIRECTION_SPREAD = 0.3
"""Range of a component of unit gravity vectors from which a constant residual is a bias."""
_MIN_RELATIVE_NOISE = 1e-6
"""Smallest noise in the comparison of causes, relative to the largest predicted reading."""
_ALL_KILOGRAMS = Mixup("forces are in kilograms and moments in kg m", KGF, KGF)
"""Mixup that changes only the mass, so that it shows only if the mass is known."""


class _Explanation(NamedTuple):
    """Mistake in a log that may explain its residuals."""

    cause: str
    cure: str
    rest: Array
    """Residuals (n, 6) without the mistake."""


def log_doubt(log: ReadingLog, sensor: ForceTorqueSensor, noise: tuple[float, float]) -> Doubt | None:
    """Doubt that names a unit, sign or bias error that explains the log much better; None if there is no such error."""
    predicted = log.predicted(sensor)
    sigma = np.maximum(noise, _MIN_RELATIVE_NOISE * (1.0 + np.abs(predicted).max()))  # (2,): moments and forces
    if sensor.missing_signals(log.V, log.dV):
        sigma[0] = np.inf  # the moments due to the inertia are unknown

    def median_ratio(rest: Array) -> float:
        """Median over the readings of the ratio of residual to noise."""
        ratios = np.linalg.norm(rest.reshape(-1, 2, 3), axis=2) / sigma
        return float(np.median(np.linalg.norm(ratios, axis=1)))

    ratio = median_ratio(log.readings - predicted)
    if ratio < MIN_RATIO_TO_NOISE:
        return None
    for explanations in (_input_mistakes(log, sensor, predicted), _moved_bias(log, predicted)):
        best = min(explanations, key=lambda explanation: median_ratio(explanation.rest), default=None)
        if best is not None and median_ratio(best.rest) <= ratio / MIN_RATIO_TO_NOISE:
            return doubt("sensor-file-cause", cause=best.cause, cure=best.cure)
    return None


def _input_mistakes(log: ReadingLog, sensor: ForceTorqueSensor, predicted: Array) -> list[_Explanation]:
    """Possible mistakes of units, signs, columns and the direction of gravity, each with its residuals."""
    r = log.readings
    explanations = []
    for mixup in (*MIXUPS, _ALL_KILOGRAMS):
        corrected = r * np.repeat([mixup.moment, mixup.force], 3)
        explanations.append(_Explanation(mixup.cause, mixup.cure, corrected - predicted))
    other_sign = "by_sensor" if sensor.sign == "on_sensor" else "on_sensor"
    cause = f"readings have the sign {other_sign}"
    cure = "change their signs, or identify the sensor from such a log"
    explanations.append(_Explanation(cause, cure, -r - predicted))
    cause = "forces and moments are swapped"
    cure = "exchange mx, my, mz with fx, fy, fz"
    exchanged = np.roll(r, 3, axis=1)
    explanations.append(_Explanation(cause, cure, exchanged - predicted))
    cause = "gravity points up"
    cure = "orientations are of a world whose z points down"
    if log.by_gravity:
        cause = "gx, gy, gz point up, as an accelerometer logs them"
        cure = "negate them"
    predicted_upside_down = sensor.predict(np.eye(3), log.V, log.dV, gravity=-log.gravity)
    explanations.append(_Explanation(cause, cure, r - predicted_upside_down))
    return explanations


def _moved_bias(log: ReadingLog, predicted: Array) -> list[_Explanation]:
    """A change of the bias, with the residuals without it; empty if the sensor has nearly one orientation."""
    directions = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    spread = np.ptp(directions, axis=0).max()
    if spread < MIN_DIRECTION_SPREAD:  # a contact may then look like a bias
        return []
    bias_change = np.median(log.readings - predicted, axis=0)
    cause = f"the bias has moved by {listed_bias(bias_change)} [N m, N], as sensors drift or are zeroed"
    return [_Explanation(cause, "identify the sensor again", log.readings - bias_change - predicted)]


MIN_SHARE_OF_OUTLIERS = 0.75
"""Fraction of unexplained readings from which the file does not fit the log."""
MIN_RATIO_OF_INCREASE = 5.0
"""Ratio of residual to noise above which readings may count as increased by compensation."""


def _mismatch_doubts(
    log: ReadingLog,
    sensor: ForceTorqueSensor,
    noise: tuple[float, float],
    rest: Array,
    *,
    is_outlier: Array,
    deviation: Array,
    tested_axes: slice,
) -> list[Doubt]:
    """Doubt about a log that the sensor's file does not fit, with a cause if one is found; empty if it fits.

    ``deviation`` (2,) holds the standard deviations of moments and forces by noise and model error.
    """
    moment_deviation, force_deviation = deviation
    tested_quantities = [("forces", "N", slice(3, 6), force_deviation)]  # name, unit, columns, standard deviation
    if tested_axes.start == 0:
        tested_quantities.insert(0, ("moments", "N m", slice(0, 3), moment_deviation))
    evidence = []
    for quantity, unit, axes, sigma in tested_quantities:
        before = float(np.median(np.linalg.norm(log.readings[:, axes], axis=1)))
        after = float(np.median(np.linalg.norm(rest[:, axes], axis=1)))
        if after > before and after > MIN_RATIO_OF_INCREASE * sigma:
            evidence.append(
                f"the {quantity} are larger than before, {number(after, 3)} after {number(before, 3)} {unit} (medians)"
            )
    cause = log_doubt(log, sensor, noise)
    if cause:
        return [cause]
    if is_outlier.mean() >= MIN_SHARE_OF_OUTLIERS:
        evidence.insert(0, f"{is_outlier.sum()} of {len(log)} readings are off by more than its noise")
    if not evidence:
        return []
    if seems_moving(log):
        return [doubt("sensor-moving", evidence=f"The sensor does not explain the log: {'; '.join(evidence)}")]
    same_instants = "" if log.V is None else " and, as V and dV, of the same instants as the readings"
    return [doubt("sensor-file-other", why="; ".join(evidence), same=same_instants)]


def rms_residuals(rest: Array) -> tuple[float, float]:
    """Root mean square per axis of the moments and the forces of compensated readings (n, 6); zero if empty."""
    if not len(rest):
        return 0.0, 0.0
    moment, force = np.sqrt((rest.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))
    return float(moment), float(force)


complete(globals())
