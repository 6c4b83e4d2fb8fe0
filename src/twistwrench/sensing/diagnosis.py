"""Why a known sensor does not explain a log: another unit, sign, gravity or column order, or a bias that has moved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.gravity import KGF
from ..typing import Array
from .log import ReadingLog
from .log_mistakes import listed_bias
from .sensor import ForceTorqueSensor
from .sensor_units import MIXUPS, Mixup

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
    """What a log seems to be in that this sensor does not explain; None if nothing explains it far better."""
    predicted = log.predicted(sensor)
    sigma = np.maximum(noise, 1e-6 * (1.0 + np.abs(predicted).max()))
    if sensor.untold(log.V, log.dV):
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
