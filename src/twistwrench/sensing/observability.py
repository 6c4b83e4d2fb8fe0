"""Observability of a sensor's unknowns from a log, and the autocorrelation of what a fit leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.numbers import number, printed
from ..lie import so3
from ..lie.labelled import WRENCH
from ..typing import Array
from .fit import Fit, SensorState, Unknowns
from .log import ReadingLog

_NONE = 1e-6  # singular values below this share of the largest are rounding of the poses, not information
_NEAR = 1e-3  # gravity directions nearer than this to each other [rad] are one
_UNITS = {
    "drift m": "N m/s",
    "drift f": "N/s",
    "bias m": "N m",
    "bias f": "N",
    "mass": "kg",
    "m c": "kg m",
    "I": "kg m²",
    "turn": "rad",
    "tilt": "rad",
    "delay": "s",
}


def blind_spots(log: ReadingLog, unknowns: Unknowns, factor: float) -> list[str]:
    """Combinations of unknowns that do not change any reading of this log, as sentences; empty if all are observable.

    >>> upright = ReadingLog.from_arrays(np.zeros((3, 6)), gravity=[0, 0, -9.81])
    >>> print(blind_spots(upright, Unknowns(), 1.0)[0])
    mass +1 kg with bias fz +9.81 N changes no reading: these cannot be told apart.
    """
    # A load whose moments depend on every turn, where the rows depend on the load.
    load = np.array([1.0, 0.05, 0.08, 0.1, *np.zeros(6)]) if unknowns.curved else None
    A = unknowns.design(log, factor, SensorState(load=load)).reshape(6 * len(log), -1) * unknowns.scales
    names = unknowns.names
    # Load first, bias last: each combination is then told as a change of the load that the bias can hide.
    order = [*range(6 * unknowns.bias, len(names)), *range(6 * unknowns.bias)]
    A = A[:, order]
    if len(A) > len(names):
        A = np.asarray(np.linalg.qr(A)[1])  # the same singular values and rows, of a small matrix
    _, values, rows = np.linalg.svd(A)
    rank = int((values > _NONE * values[0]).sum()) if values.size else 0
    combinations = _reduced(rows[rank:]) * unknowns.scales[order]
    return [_sentence(row, [names[k] for k in order]) for row in combinations]


def advice(log: ReadingLog, unknowns: Unknowns) -> str:
    """Advice: rotations that the log lacks."""
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    centre = unit.mean(axis=0)
    spread, axes = np.linalg.svd(unit - centre)[1:]
    spread = np.concatenate([spread, np.zeros(3)])[:3] / np.sqrt(len(unit))
    if spread[0] < _NEAR:
        return (
            f"In all readings gravity points along ({_vector(centre / np.linalg.norm(centre))}) of the sensor's frame. "
            "Tilt the tool about two different axes between readings, by tens of degrees; `poses` proposes some."
        )
    if spread[1] < _NEAR:
        axis = so3.cross(axes[0], centre)
        about = f" about ({_vector(axis / np.linalg.norm(axis))})" if np.linalg.norm(axis) > _NEAR else ""
        return (
            f"Gravity takes only two directions in the sensor's frame: the tool was turned{about} only. "
            "Add readings tilted about another axis; `poses` proposes some."
        )
    if unknowns.inertia:
        return (
            "Readings at rest or turning about one axis say little of inertia. Log faster turns about three axes, "
            "or ask for no inertia."
        )
    return "Add readings in other orientations; `poses` proposes some."


def _reduced(rows: Array) -> Array:
    """The same row space in reduced echelon form: few nonzeros, leading ones; tiny entries are cleared."""
    rows = rows.copy()
    lead = 0
    for column in range(rows.shape[1]):
        if lead == len(rows):
            break
        pivot = lead + int(np.abs(rows[lead:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-6:
            continue
        rows[[lead, pivot]] = rows[[pivot, lead]]
        rows[lead] /= rows[lead, column]
        others = np.arange(len(rows)) != lead
        rows[others] -= np.outer(rows[others, column], rows[lead])
        lead += 1
    rows[np.abs(rows) < 1e-5 * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)] = 0.0
    return rows


def _sentence(row: Array, names: list[str]) -> str:
    terms = [f"{name} {printed(row[k], 3, signed=True)} {_unit(name)}" for k, name in enumerate(names) if row[k]]
    if len(terms) == 1:
        return f"{terms[0]} changes no reading: it cannot be told."
    return f"{terms[0]} with {', '.join(terms[1:])} changes no reading: these cannot be told apart."


def _unit(name: str) -> str:
    return next(unit for start, unit in _UNITS.items() if name.startswith(start))


def _vector(x: Array) -> str:
    return ", ".join(number(v, 2) for v in x + 0.0)


# ── Whiteness of residuals in the order of the log

_CHANCE = 1e-3  # that white residuals are called otherwise, for all six channels
_LEAST = 8  # rows from which the order says anything
_LAGS = 20  # of Ljung and Box's test
_LONG = 100  # rows from which that test is made


@dataclass(frozen=True)
class Whiteness:
    """The result of the tests, of the channel that is least white."""

    axis: str
    lag1: float
    """Autocorrelation of neighbouring rows."""
    chance: float
    """Probability that white noise has as much in any channel."""
    length: int
    """Rows over which residuals are correlated; 1 if they are white."""
    test: str

    @property
    def white(self) -> bool:
        """True if noise alone may cause it."""
        return self.chance > _CHANCE


def whiteness(fit: Fit, kept: Array, label: Array) -> Whiteness | None:
    """Test the residuals of the kept rows (n,), in the order of the log; None of rows too few.

    Of rows with one label (n,), an orientation that was visited again, the mean is taken off: they share their pose error.

    For each channel c, e_c' D e_c with D the mean of the two shifts by one row: the numerator of the lag-1 autocorrelation,
    as in Durbin and Watson's test, against its mean and variance under white noise, -tr Q_c' D Q_c and
    2 (tr D² - 2 tr Q_c' D² Q_c + tr (Q_c' D Q_c)²). From 100 rows on also Ljung and Box's test, of 20 lags.
    Sources: Durbin and Watson, Biometrika 37, 1950; Ljung and Box, Biometrika 65, 1978.
    """
    from scipy import special

    e = (fit.residuals / fit.deviation)[kept]
    e = e - _means(e, label[kept])
    n, p = len(e), fit.design.shape[-1]
    if n < _LEAST:
        return None
    A = (fit.design / fit.deviation[..., None])[kept].reshape(6 * n, p)
    size = np.abs(A).max(axis=0)
    Q = np.linalg.qr(A / np.where(size > 0, size, 1.0))[0].reshape(n, 6, p)
    result = None
    for c, axis in enumerate(WRENCH):
        q, r = Q[:, c], e[:, c]
        left = max(float(r @ r), 1e-300)
        variance = left / max(n - float((q * q).sum()), 1.0)
        Dq = _neighbours(q)
        mean = -float((q * Dq).sum())
        spread = 2.0 * (0.5 * (n - 1) - 2.0 * float((Dq * Dq).sum()) + float(((q.T @ Dq) ** 2).sum()))
        z = (float(r @ _neighbours(r)) / variance - mean) / np.sqrt(max(spread, 1e-12))
        tests = [(float(special.ndtr(-z)), "lag-1 autocorrelation")]
        if n >= _LONG:
            rho = _autocorrelation(r, _LAGS)
            box = n * (n + 2) * float((rho**2 / (n - np.arange(1, _LAGS + 1))).sum())
            tests.append((float(special.chdtrc(_LAGS, box)), "Ljung-Box of 20 lags"))
        chance, name = min(tests)
        chance = min(6 * len(tests) * chance, 1.0)
        if result is None or chance < result.chance:
            lag1 = float(r @ _neighbours(r)) / left
            result = Whiteness(axis, lag1, chance, 1, name)
    if result is None or result.white:
        return result
    return Whiteness(result.axis, result.lag1, result.chance, _length(e), result.test)


def _means(e: Array, label: Array) -> Array:
    """Means (n, 6) of the rows of each label; zero where a row is the only one."""
    place, count = np.unique(label, return_inverse=True, return_counts=True)[1:]
    total = np.zeros((len(count), e.shape[1]))
    np.add.at(total, place, e)
    return np.asarray(np.where(count[:, None] > 1, total / count[:, None], 0.0)[place])


def _neighbours(x: Array) -> Array:
    """D x: half the row before and half the row after."""
    out = np.zeros_like(x)
    out[1:] += 0.5 * x[:-1]
    out[:-1] += 0.5 * x[1:]
    return out


def _autocorrelation(r: Array, lags: int) -> Array:
    """Autocorrelation at lags 1 to ``lags``."""
    return np.array([float(r[k:] @ r[:-k]) for k in range(1, lags + 1)]) / max(float(r @ r), 1e-300)


def _length(e: Array) -> int:
    """Twice the lag at which the largest autocorrelation first falls into the noise, at most a tenth of the rows."""
    n = len(e)
    most = max(2, n // 10)
    lags = np.array([_autocorrelation(e[:, c], min(most, n - 2)) for c in range(6)]).max(axis=0)
    below = np.flatnonzero(lags < 2.0 / np.sqrt(n))
    return int(min(2 * (int(below[0]) + 1), most)) if below.size else most
