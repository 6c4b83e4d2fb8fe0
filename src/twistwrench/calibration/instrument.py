"""Errors of the instrument: scale of its readings, offset of its distances, and a target or instrument that has moved.

Each is a further column beside those of the fit, in one linear least-squares problem.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import special

from ..core.doubts import Doubt, doubt
from ..core.numbers import estimate, number
from ..core.typing import Array
from .measurements import LENGTHS_MEASURED
from .result_view import millimetres

if TYPE_CHECKING:
    from .result import CalibratedRobot

_SCALE_SIZE, _DEVIATIONS = 5e-3, 3.0
"""Smallest scale error, and smallest error of an instrument in its standard deviations, that are doubted."""
_MIN_LOST_OFFSET = 5.0
"""Offset of a zero, over the deviation of the file, from which the zero is lost and the file does not constrain it."""
_SAME_EFFECT = 1e-3
"""Part of a further column, beside those of the fit, below which parameters have the same effect."""
_CHANCE, _MAX_RESIDUAL_SHARE = 1e-4, 0.5
"""Largest probability of a step by chance, and largest share of the residual (rms) that it may leave."""
_MIN_ROWS_BESIDE = 3
"""Least number of readings on either side of a step."""


class _InstrumentError(NamedTuple):
    """Estimate of one number of an instrument, with the file's lengths held at their accuracy."""

    value: float
    deviation: float
    new: float
    """Part of its column that no parameter of the fit has."""
    left: float
    """Residual (rms) with this error as a share of that without."""


class Offered(NamedTuple):
    """Cause beside the geometry that the readings show."""

    left: float
    """Residual or held-out error (rms) with the cause as a share of that without."""
    doubt: Doubt


def instrument_doubts(found: CalibratedRobot) -> list[Offered]:
    """Scale of all readings, or offset of distances: the one that is larger in its standard deviations."""
    measured, every = found.fit.problem.measured, list[tuple[float, Offered]]()
    if all(m.kind in LENGTHS_MEASURED for m in measured):
        every += _scale(found)
    notes = list[Offered]()
    for b, m in enumerate(measured):
        if m.kind not in ("distance", "pair"):
            continue
        shapes = [W.shape for W in found.fit.weights]
        offset = _instrument_error(found, [np.full(shape, float(k == b)) for k, shape in enumerate(shapes)])
        every += _offset(offset, found.fit.deviations[b][0])
        if offset.new < _SAME_EFFECT:
            notes.append(Offered(1.0, doubt("calibration-offset-unseen")))
    if every:
        return [max(every, key=lambda entry: entry[0])[1]]
    return notes


def _scale(found: CalibratedRobot) -> Iterator[tuple[float, Offered]]:
    """Scale of the readings against the file's lengths, and its size in standard deviations."""
    lengths = [-m.points if len(m.points) else -m.sizes[:, None] for m in found.fit.problem.measured]
    x = _instrument_error(found, lengths)
    scale, half = 1.0 / (1.0 + x.value), 2.0 * x.deviation
    if abs(x.value) > max(_DEVIATIONS * x.deviation, _SCALE_SIZE):
        named = doubt(
            "calibration-scale", scale=f"{number(scale, 4)} ± {number(half, 1)}",
            found={"value": scale, "interval": (scale - half, scale + half)},
        )  # fmt: skip
        yield abs(x.value) / x.deviation, Offered(x.left, named)


def _offset(x: _InstrumentError, noise: float) -> Iterator[tuple[float, Offered]]:
    """Offset of distances, and its size in standard deviations."""
    half = 2.0 * x.deviation
    if abs(x.value) > max(_DEVIATIONS * x.deviation, noise):
        size = " ± ".join(estimate(1e3 * abs(x.value), 1e3 * half))
        named = doubt(
            "calibration-offset", offset=f"{size} mm too {'long' if x.value > 0 else 'short'}",
            found={"value": x.value, "interval": (x.value - half, x.value + half)},
        )  # fmt: skip
        yield abs(x.value) / x.deviation, Offered(x.left, named)


def _instrument_error(found: CalibratedRobot, columns: Sequence[Array]) -> _InstrumentError:
    """Factor of a further column (m, 1 or 3) of each measurement's lengths."""
    fit, parts = found.fit, list[Array]()
    A, y = fit.weighted_rows
    for m, W, values in zip(fit.problem.measured, fit.weights, columns, strict=True):
        column = np.zeros(W.shape)
        column[:, m.angle_rows :] = values
        parts.append((column * W).ravel())
    column = np.concatenate([*parts, np.zeros(len(fit.equations.lengths))])
    kept = A[:, found.parameter_groups.independent_columns]
    kept = kept / np.linalg.norm(kept, axis=0)
    away = column - kept @ np.linalg.lstsq(kept, column, rcond=None)[0]
    values = fit.problem.chain.values(fit.state.corrections)
    at = np.concatenate([values, np.zeros(len(fit.names) - len(values))])
    wide = found.remaining.wide
    is_zero = np.array([name.endswith(".zero") for name in fit.names])  # lengths would hide a scale
    wide = np.where(is_zero & (np.abs(at) > _MIN_LOST_OFFSET * wide), np.abs(at), wide)
    B = np.concatenate([np.c_[A, column], np.c_[np.diag(1.0 / wide), np.zeros(len(wide))]])
    x = np.linalg.lstsq(B, -np.concatenate([y, at / wide]), rcond=None)[0]
    deviation = float(np.sqrt(np.linalg.inv(B.T @ B)[-1, -1]))
    new = float(np.linalg.norm(away) / np.linalg.norm(column))
    residual = y - kept @ np.linalg.lstsq(kept, y, rcond=None)[0]
    squares = float(residual @ residual)
    explained, left = 0.0, 1.0
    if new > _SAME_EFFECT:
        explained = float(away @ residual) ** 2 / float(away @ away)
    if squares > 0.0:
        left = float(np.sqrt(max(1.0 - explained / squares, 0.0)))
    return _InstrumentError(float(x[-1]), deviation, new, left)


# ── Target or instrument that has moved between two readings


class _Step(NamedTuple):
    """Change of a target's place from one reading on."""

    kind: str
    measurement: int
    row: int
    size: float
    left: float
    """Residual (rms) of lengths, or of angles if these fall more, as a share of that without the step."""
    chance: float
    """Probability of such a step by noise alone, over all rows."""


def step_doubts(found: CalibratedRobot) -> list[Doubt]:
    """Target that has slipped on the tip, or instrument that has moved: the change that explains most of the residual."""
    sure = list[_Step]()
    for b in range(len(found.fit.problem.measured)):
        for step in _steps(found, b):
            if step.chance < _CHANCE and step.left < _MAX_RESIDUAL_SHARE:
                sure.append(step)
    if not sure:
        return []
    best = min(sure, key=lambda step: step.left)
    file = ""
    if len(found.fit.problem.measured) > 1:
        file = f" of measurement {best.measurement + 1}"
    return [
        doubt(
            f"calibration-{best.kind}", size=millimetres(best.size), row=f"{best.row}{file}", left=number(100.0 * best.left, 2),
            found={"value": best.size, "unit": "m"},
        )
    ]  # fmt: skip


def _steps(found: CalibratedRobot, b: int) -> Iterator[_Step]:
    """Best step of the target on the tip, and of the instrument, among the readings of a measurement."""
    fit, m = found.fit, found.fit.problem.measured[b]
    if m.pairs is not None or m.count < 2 * _MIN_ROWS_BESIDE:
        return
    even = [np.broadcast_to(W.max(axis=0), W.shape) for W in fit.weights]  # outliers may be the readings after a step
    A, y = fit.equations.weighted_rows(even)
    Q = np.linalg.qr(A[:, found.parameter_groups.independent_columns])[0]
    left = y - Q @ (Q.T @ y)
    p = len(fit.problem.chain.parameters)
    first = p + sum(len(target.names) for target in fit.state.targets[:b])
    own = range(first, first + len(fit.state.targets[b].names)) if m.kind in LENGTHS_MEASURED else ()
    ahead = sum(W.size for W in even[:b])
    places = ahead + np.arange(even[b].size).reshape(even[b].shape)
    angles, lengths = places[:, : m.angle_rows].ravel(), places[:, m.angle_rows :].ravel()
    for kind, columns in (("slipped", range(p - (6 if m.angle_rows else 3), p)), ("moved", own)):
        if not columns:
            continue
        moving = fit.equations.design[b][:, :, list(columns)]
        row, x, rest = min(
            _steps_from_each_row(moving, even[b], left, Q, ahead), key=lambda step: float(step[2] @ step[2])
        )
        squares = float(rest @ rest)
        shares = [np.linalg.norm(rest[rows]) / np.linalg.norm(left[rows]) for rows in (lengths, angles) if len(rows)]
        freedom, count = len(A) - len(Q.T) - len(x), len(x)
        chance = 1.0
        if freedom > 0:
            F = (left @ left - squares) / count / (squares / freedom)
            chance = float(special.fdtrc(count, freedom, F)) * m.count
        size = np.sqrt(((moving[row:, m.angle_rows :] @ x) ** 2).sum(axis=1).mean())
        yield _Step(kind, b, row, float(size), float(min(shares)), chance)


def _steps_from_each_row(
    moving: Array, weights: Array, left: Array, Q: Array, ahead: int
) -> Iterator[tuple[int, Array, Array]]:
    """First row, size (c,) and residual of a step of the columns (m, r, c) from each row on."""
    m, r, c = moving.shape
    weighted = (moving * weights[..., None]).reshape(m * r, c)
    for row in range(_MIN_ROWS_BESIDE, m - _MIN_ROWS_BESIDE + 1):
        S = np.zeros((len(left), c))
        S[ahead + row * r : ahead + m * r] = weighted[row * r :]
        S -= Q @ (Q.T @ S)
        x = np.linalg.lstsq(S, left, rcond=_SAME_EFFECT)[0]
        yield row, x, left - S @ x
