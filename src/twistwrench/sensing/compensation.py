"""Compensation of a log by a known sensor, and the explanations of a log that the sensor's file does not fit."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.gravity import KGF
from ..core.numbers import number
from ..core.verdict import Verdict, Word
from ..errors import ModelWarning
from ..log_checks.reading_doubts import MAY_MOVE, MIXUPS, Mixup, departure, listed_bias, seems_moving
from ..typing import Array
from .contact_detection import CollisionThreshold, checked_noise
from .fit import Uncertainty
from .log import ReadingLog
from .sensor import ForceTorqueSensor

_STRANGE = 5.0  # times what is left otherwise, or its noise
_TURNS = 0.3  # spread of gravity's directions from which a constant rest is a bias
_EXACT = 1e-3  # of the load's wrench: no model is better
_ALL_KILOGRAMS = Mixup(
    "forces are in kilograms and moments in kg m",
    f"multiply all six by {KGF}",
    1 / KGF,
    1 / KGF,
)  # changes the mass alone, so only a known one tells it


class _Way(NamedTuple):
    said: str
    cure: str
    readings: Array
    predicted: Array


def smallest_noise(log: ReadingLog, sensor: ForceTorqueSensor, noise: tuple[float, float]) -> tuple[float, float]:
    """Standard deviations of moments and forces that a log may have: the file's, and a thousandth of what the load does."""
    own = (log.predicted(sensor) - np.asarray(sensor.bias)).reshape(-1, 2, 3)
    load = np.sqrt((own**2).sum(axis=2).mean(axis=0))
    moment, force = np.maximum(np.hypot(noise, _EXACT * load), 1e-9)
    return float(moment), float(force)


def log_doubt(log: ReadingLog, sensor: ForceTorqueSensor, noise: tuple[float, float]) -> str | None:
    """Unit, sign or bias with which this sensor explains the log far better, as a sentence; None if there is none."""
    predicted = log.predicted(sensor)
    sigma = np.maximum(noise, 1e-6 * (1.0 + np.abs(predicted).max()))
    if sensor.missing_signals(log.V, log.dV):
        sigma[0] = np.inf  # what the inertia does to the moments is not known

    def left(readings: Array, predicted: Array) -> float:
        r = (readings - predicted).reshape(-1, 2, 3)
        return float(np.median(np.linalg.norm(np.linalg.norm(r, axis=2) / sigma, axis=1)))

    as_read = left(log.readings, predicted)
    if as_read < _STRANGE:
        return None
    best = min(_ways(log, sensor, predicted), key=lambda way: left(way.readings, way.predicted))
    if left(best.readings, best.predicted) > as_read / _STRANGE:
        drift = _drift(log, predicted)
        if drift is None or left(drift.readings, drift.predicted) > as_read / _STRANGE:
            return None
        best = drift
    return f"The sensor does not explain the log. Perhaps {best.said} ({best.cure}): then it does."


def _ways(log: ReadingLog, sensor: ForceTorqueSensor, predicted: Array) -> list[_Way]:
    r = log.readings
    other = "by_sensor" if sensor.sign == "on_sensor" else "on_sensor"
    ways = [
        _Way(way.said, way.cure, r / np.repeat([way.moment, way.force], 3), predicted)
        for way in (*MIXUPS, _ALL_KILOGRAMS)
    ]
    ways.append(
        _Way(
            f"readings have the sign {other}",
            "change their signs, or identify the sensor from such a log",
            -r,
            predicted,
        )
    )
    ways.append(
        _Way("forces and moments are swapped", "exchange mx, my, mz with fx, fy, fz", np.roll(r, 3, 1), predicted)
    )
    up = sensor.predict(np.eye(3), log.V, log.dV, gravity=-log.gravity)
    what = "gx, gy, gz point up, as an accelerometer logs them" if log.by_gravity else "gravity points up"
    ways.append(
        _Way(what, "negate them" if log.by_gravity else "orientations are of a world whose z points down", r, up)
    )
    return ways


def _drift(log: ReadingLog, predicted: Array) -> _Way | None:
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    if np.ptp(unit, axis=0).max() < _TURNS:  # in one orientation a push and a bias look alike
        return None
    moved = np.median(log.readings - predicted, axis=0)
    said = f"the bias has moved by {listed_bias(moved)} [N m, N], as sensors drift or are zeroed"
    return _Way(said, "identify the sensor again", log.readings - moved, predicted)


# ── Compensated logs

_ALARM = 1e-6  # chance that noise alone puts a reading off
_NEARLY_ALL = 0.75  # of the readings off, from which the file explains nothing
_SOME = 0.1  # of the moments off, from which an unknown inertia shows
_NO_COVARIANCE = (
    "The sensor file lacks the covariance of what was identified: false alarms come more often than stated, the more so the "
    "fewer orientations it is from. Identify again to have it."
)
_NOISY = 5.0  # times its noise, from which what is left counts as more than before


@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """Compensated readings with their doubts and remarks."""

    log: ReadingLog
    sensor: ForceTorqueSensor
    noise: tuple[float, float]
    rest: Array
    """(n, 6) the readings without bias and load."""
    off: Array
    """(n,) which of them noise does not explain."""
    doubts: tuple[str, ...]
    """Why the file and the log do not belong together."""
    missing_signals: str | None
    """Moments left in the readings because the load's inertia is unknown, as a sentence."""
    missing_signals_show: bool
    """True if these moments are more than noise."""
    threshold: CollisionThreshold | None
    """Threshold of contacts, if any were looked for."""
    remarks: tuple[str, ...] = ()
    """Remarks on the result."""

    @property
    def hits(self) -> Array:
        """(n,) which readings are contacts; none where nothing was looked for, or the file does not explain the log."""
        if self.threshold is None or self.doubts:
            return np.zeros(len(self.log), bool)
        return self.threshold(self.rest)

    @property
    def verdict(self) -> Verdict:
        """LOOK AGAIN with doubts, or with moments that hold an unknown inertia and were requested; CONTACT; OK."""
        if self.doubts:
            return Verdict(Word.LOOK_AGAIN, self.doubts)
        if (hits := int(self.hits.sum())) > 0:
            return Verdict(Word.CONTACT, (f"{hits} of {len(self.log)} readings are more than noise explains",))
        if self.missing_signals_show and self.threshold is None:
            return Verdict(Word.LOOK_AGAIN, (self.missing_signals or "the load's inertia is left in the moments",))
        return Verdict(Word.OK)

    @property
    def doubtful(self) -> bool:
        """True if the verdict is not OK."""
        return not self.verdict.ok


def compensation(
    log: ReadingLog,
    sensor: ForceTorqueSensor,
    noise: tuple[float, float],
    false_alarms: float | None = None,
    uncertainty: Uncertainty | None = None,
) -> Compensation:
    """Subtract the load from a log, test the residuals by the sensor's uncertainty, and look for contacts if requested.

    With the file's ``uncertainty`` what is left r has the covariance S = diag σ² + A C A' of a new reading, and contacts are
    detected by Student's quantiles; without it, by its ``noise`` alone, as if the sensor were known exactly. An unknown inertia
    leaves only the forces of a log in motion to judge by: it has no part in them.
    """
    missing = sensor.missing_signals(log.V, log.dV)
    judged = slice(3, 6) if missing else slice(0, 6)
    S = np.diag(np.repeat(noise, 3) ** 2) if uncertainty is None else uncertainty.predictive(log, sensor)
    freedom = None if uncertainty is None else uncertainty.noise_freedom
    threshold, remarks = None, []
    if false_alarms is not None:
        S = S if uncertainty is not None else np.diag(np.repeat(checked_noise(noise), 3) ** 2)
        threshold = CollisionThreshold.predictive(S, freedom, false_alarms, axes=judged)
        if uncertainty is None:
            remarks.append(_NO_COVARIANCE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # ``missing_signals`` says it
        rest = log.compensated(sensor)
    level = smallest_noise(log, sensor, noise)
    inexact = np.diag(np.maximum(np.repeat(level, 3) ** 2 - np.repeat(noise, 3) ** 2, 0.0))
    if uncertainty is None:
        inexact, freedom, S = np.zeros((6, 6)), None, np.diag(np.repeat(level, 3) ** 2)
    test = CollisionThreshold.predictive(S + inexact, freedom, _ALARM, axes=judged)
    off = test(rest)
    shows = bool(missing) and CollisionThreshold.of_noise(level, _ALARM, axes=slice(0, 3))(rest).mean() > _SOME
    doubts = _unexplained(log, sensor, noise, rest, off, level, judged)
    sigma = np.sqrt(np.broadcast_to(np.diagonal(S + inexact, axis1=-2, axis2=-1), rest.shape))
    if cause := departure(log, sensor, rest, sigma, test if threshold is None else threshold):
        doubts = doubts if _named(doubts) else [cause]
    doubts = [*doubts, *log.motion_doubts()]
    return Compensation(log, sensor, noise, rest, off, tuple(doubts), missing, shows, threshold, tuple(remarks))


def _named(doubts: list[str]) -> bool:
    """True if a doubt names a cause."""
    return any("Perhaps" in doubt or MAY_MOVE in doubt for doubt in doubts)


def _unexplained(
    log: ReadingLog,
    sensor: ForceTorqueSensor,
    noise: tuple[float, float],
    rest: Array,
    off: Array,
    level: tuple[float, float],
    judged: slice,
) -> list[str]:
    halves = [("moments", "N m", slice(0, 3), level[0]), ("forces", "N", slice(3, 6), level[1])]
    more = []
    for what, unit, part, sigma in halves[1 if judged.start else 0 :]:
        before, after = (float(np.median(np.linalg.norm(x[:, part], axis=1))) for x in (log.readings, rest))
        if after > before and after > _NOISY * sigma:
            more.append(
                f"the {what} are larger than before, {number(after, 3)} after {number(before, 3)} {unit} (medians)"
            )
    many = off.mean() >= _NEARLY_ALL
    known = log_doubt(log, sensor, noise)
    if not (more or many or known):
        return []
    if many:
        more.insert(0, f"{off.sum()} of {len(log)} readings are off by more than its noise")
    if known:
        return [known]
    said = f"The sensor does not explain the log: {'; '.join(more)}."
    if seems_moving(log):
        return [f"{said} {MAY_MOVE}"]
    same = "" if log.V is None else " and, as V and dV, of the same instants as the readings"
    return [
        f"{said} No other unit, sign or bias does. Is it the log of this tool, are the orientations those of the sensor in the "
        f"world, R_wf (not of the world in the sensor){same}, and does nothing touch the tool all along?"
    ]


def left_over(rest: Array) -> tuple[float, float]:
    """Root mean square of the moments and of the forces of compensated readings (n, 6), per axis; zero of none."""
    if not len(rest):
        return 0.0, 0.0
    moment, force = np.sqrt((rest.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))
    return float(moment), float(force)
