"""Errors of the instrument: scale of its readings, offset of its distances, and a target or instrument that has moved.

Each is a further column in the linearised least-squares problem of the fit.
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

_MIN_SCALE_ERROR = 5e-3
"""Smallest scale error that is reported."""
_MIN_DEVIATIONS = 3.0
"""Smallest error of an instrument that is reported, in its standard deviations."""
_MIN_LOST_OFFSET = 5.0
"""Offset of a zero, over the deviation of the file, from which the zero is lost and the file does not constrain it."""
_MIN_UNSPANNED_SHARE = 1e-3
"""Part of a further column that columns of the fit do not span, below which their parameters have the same effect."""
_MAX_CHANCE = 1e-4
"""Largest probability of a reported step by noise alone."""
_MAX_RESIDUAL_SHARE = 0.5
"""Largest residual (rms) with a reported step, as a share of that without."""
_MIN_ROWS_BESIDE = 3
"""Least number of readings on either side of a step."""


class _InstrumentError(NamedTuple):
    """Estimate of the scale error or of the offset of an instrument, with the file as a prior of its accuracy."""

    value: float
    """Scale error [1] or offset [m]."""
    deviation: float
    """Standard deviation of the value."""
    unspanned_share: float
    """Part of its column that columns of the fit do not span."""
    residual_share: float
    """Residual (rms) with this error as a share of the residual without it."""


class Offered(NamedTuple):
    """Cause other than the geometry that explains the readings."""

    left: float
    """Residual or held-out error (rms) with the cause as a share of that without it."""
    doubt: Doubt


def instrument_doubts(found: CalibratedRobot) -> list[Offered]:
    """Scale error of all readings or offset of distances, whichever is larger in its standard deviations; otherwise notes."""
    measured = found.fit.problem.measured
    candidates = list[tuple[float, Offered]]()  # size in standard deviations, cause
    if all(measurement.kind in LENGTHS_MEASURED for measurement in measured):
        candidates += _scale_error(found)
    notes = list[Offered]()
    for index, measurement in enumerate(measured):
        if measurement.kind not in ("distance", "pair"):
            continue
        columns = [np.full((m.count, 1), float(k == index)) for k, m in enumerate(measured)]  # 1 for its own readings
        offset = _instrument_error(found, columns)
        length_deviation, _ = found.fit.deviations[index]
        candidates += _offset_error(offset, length_deviation)
        if offset.unspanned_share < _MIN_UNSPANNED_SHARE:
            notes.append(Offered(1.0, doubt("calibration-offset-unseen")))  # explains nothing of the residual
    if candidates:
        _, largest = max(candidates, key=lambda candidate: candidate[0])
        return [largest]
    return notes


def _scale_error(found: CalibratedRobot) -> Iterator[tuple[float, Offered]]:
    """Size in standard deviations and cause of a scale error of the readings against the file's lengths; nothing if small."""
    columns = [-m.points if len(m.points) else -m.sizes[:, None] for m in found.fit.problem.measured]
    error = _instrument_error(found, columns)
    if abs(error.value) > max(_MIN_DEVIATIONS * error.deviation, _MIN_SCALE_ERROR):
        scale = 1.0 / (1.0 + error.value)
        half_width = 2.0 * error.deviation
        reason = doubt(
            "calibration-scale", scale=f"{number(scale, 4)} ± {number(half_width, 1)}",
            found={"value": scale, "interval": (scale - half_width, scale + half_width)},
        )  # fmt: skip
        yield abs(error.value) / error.deviation, Offered(error.residual_share, reason)


def _offset_error(error: _InstrumentError, noise: float) -> Iterator[tuple[float, Offered]]:
    """Size in standard deviations and cause of an offset of distances; nothing if small.

    ``noise`` is the standard deviation of a reading [m].
    """
    if abs(error.value) > max(_MIN_DEVIATIONS * error.deviation, noise):
        half_width = 2.0 * error.deviation
        size = " ± ".join(estimate(1e3 * abs(error.value), 1e3 * half_width))
        reason = doubt(
            "calibration-offset", offset=f"{size} mm too {'long' if error.value > 0 else 'short'}",
            found={"value": error.value, "interval": (error.value - half_width, error.value + half_width)},
        )  # fmt: skip
        yield abs(error.value) / error.deviation, Offered(error.residual_share, reason)


def _instrument_error(found: CalibratedRobot, columns: Sequence[Array]) -> _InstrumentError:
    """Estimate of an instrument's error, the factor of a further column in the fit.

    ``columns`` has the part of this column for the lengths of each measurement, (m, 1) or (m, 3).
    """
    fit = found.fit
    A, y = fit.weighted_rows
    weighted_parts = list[Array]()
    for m, W, part in zip(fit.problem.measured, fit.weights, columns, strict=True):
        part_of_rows = np.zeros(W.shape)
        part_of_rows[:, m.angle_rows :] = part
        weighted_parts.append((part_of_rows * W).ravel())
    column = np.concatenate([*weighted_parts, np.zeros(len(fit.equations.lengths))])
    basis = A[:, found.parameter_groups.independent_columns]
    basis = basis / np.linalg.norm(basis, axis=0)
    unspanned = _residual(basis, column)
    chain_values = fit.problem.chain.values(fit.state.corrections)
    values = np.concatenate([chain_values, np.zeros(len(fit.names) - len(chain_values))])
    prior_deviations = found.remaining.wide
    # Zeros that are lost get a wide prior; lengths keep theirs, as they would hide a scale.
    is_zero = np.array([name.endswith(".zero") for name in fit.names])
    is_lost = is_zero & (np.abs(values) > _MIN_LOST_OFFSET * prior_deviations)
    prior_deviations = np.where(is_lost, np.abs(values), prior_deviations)
    rows = np.c_[A, column]
    prior_rows = np.c_[np.diag(1.0 / prior_deviations), np.zeros(len(prior_deviations))]
    B = np.concatenate([rows, prior_rows])
    right_side = -np.concatenate([y, values / prior_deviations])
    x, *_ = np.linalg.lstsq(B, right_side, rcond=None)
    covariance = np.linalg.inv(B.T @ B)
    deviation = float(np.sqrt(covariance[-1, -1]))  # of the further column, which is the last one
    unspanned_share = float(np.linalg.norm(unspanned) / np.linalg.norm(column))
    residual = _residual(basis, y)
    squares = float(residual @ residual)
    explained_squares = 0.0
    residual_share = 1.0
    if unspanned_share > _MIN_UNSPANNED_SHARE:
        explained_squares = float(unspanned @ residual) ** 2 / float(unspanned @ unspanned)
    if squares > 0.0:
        residual_share = float(np.sqrt(max(1.0 - explained_squares / squares, 0.0)))
    return _InstrumentError(float(x[-1]), deviation, unspanned_share, residual_share)


def _residual(columns: Array, y: Array) -> Array:
    """Part of y (m,) that the columns (m, n) do not span."""
    factors, *_ = np.linalg.lstsq(columns, y, rcond=None)
    return np.asarray(y - columns @ factors)


# ── Target or instrument that has moved between two readings


class _Step(NamedTuple):
    """Change of a target's place from one reading on."""

    kind: str
    """``slipped`` for the target on the tip, ``moved`` for the instrument."""
    measurement: int
    """Index of the measurement."""
    row: int
    """First reading after the step."""
    size: float
    """Change of the readings by the step [m] (rms)."""
    residual_share: float
    """Residual (rms) with the step as a share of that without it: of lengths or of angles, whichever is smaller."""
    chance: float
    """Probability that noise alone looks like such a step at some reading."""


def step_doubts(found: CalibratedRobot) -> list[Doubt]:
    """Target that has slipped on the tip, or instrument that has moved: the step that explains most of the residual."""
    significant = list[_Step]()
    for index in range(len(found.fit.problem.measured)):
        for step in _steps(found, index):
            if step.chance < _MAX_CHANCE and step.residual_share < _MAX_RESIDUAL_SHARE:
                significant.append(step)
    if not significant:
        return []
    best = min(significant, key=lambda step: step.residual_share)
    row_text = str(best.row)
    if len(found.fit.problem.measured) > 1:
        row_text = f"{best.row} of measurement {best.measurement + 1}"
    percentage = number(100.0 * best.residual_share, 2)
    size = {"value": best.size, "unit": "m"}
    return [doubt(f"calibration-{best.kind}", size=millimetres(best.size), row=row_text, left=percentage, found=size)]


def _steps(found: CalibratedRobot, index: int) -> Iterator[_Step]:
    """Best step of the target on the tip, and of the instrument, among the readings of a measurement."""
    fit = found.fit
    m = found.fit.problem.measured[index]
    if m.pairs is not None or m.count < 2 * _MIN_ROWS_BESIDE:
        return
    # Outliers get the weight of the other readings, since they may be the readings after a step.
    weights = [np.broadcast_to(W.max(axis=0), W.shape) for W in fit.weights]
    A, y = fit.equations.weighted_rows(weights)
    Q, _ = np.linalg.qr(A[:, found.parameter_groups.independent_columns])
    residual = y - Q @ (Q.T @ y)
    p = len(fit.problem.chain.parameters)  # their columns are first; those of the targets follow
    first_target_column = p + sum(len(target.names) for target in fit.state.targets[:index])
    target_columns = range(first_target_column, first_target_column + len(fit.state.targets[index].names))
    if m.kind not in LENGTHS_MEASURED:  # touches have no instrument
        target_columns = range(0)
    tip_columns = range(p - 6, p) if m.angle_rows else range(p - 3, p)  # the last parameters: pose or position
    first_row = sum(W.size for W in weights[:index])
    rows = first_row + np.arange(weights[index].size).reshape(weights[index].shape)  # of each reading
    angle_rows = rows[:, : m.angle_rows].ravel()
    length_rows = rows[:, m.angle_rows :].ravel()
    row_groups = [group for group in (length_rows, angle_rows) if len(group)]
    for kind, columns in (("slipped", tip_columns), ("moved", target_columns)):
        if not columns:
            continue
        design = fit.equations.design[index][:, :, list(columns)]
        steps = _steps_from_each_reading(design, weights[index], residual, Q, first_row)
        reading, x, residual_with_step = min(steps, key=_remaining_squares)
        shares = [np.linalg.norm(residual_with_step[group]) / np.linalg.norm(residual[group]) for group in row_groups]
        squares = float(residual_with_step @ residual_with_step)
        step_freedom = len(x)
        freedom = len(A) - len(Q.T) - step_freedom
        chance = 1.0
        if freedom > 0:
            F = (residual @ residual - squares) / step_freedom / (squares / freedom)  # F statistic of the step
            chance_at_reading = float(special.fdtrc(step_freedom, freedom, F))
            chance = chance_at_reading * m.count  # at any reading
        changes = design[reading:, m.angle_rows :] @ x
        size = np.sqrt((changes**2).sum(axis=1).mean())
        yield _Step(kind, index, reading, float(size), float(min(shares)), chance)


def _remaining_squares(step: tuple[int, Array, Array]) -> float:
    """Sum of squares of the residual that remains with a step of :func:`_steps_from_each_reading`."""
    _, _, remaining = step
    return float(remaining @ remaining)


def _steps_from_each_reading(
    design: Array, weights: Array, residual: Array, Q: Array, first_row: int
) -> Iterator[tuple[int, Array, Array]]:
    """First reading, sizes (c,) and remaining residual of a step by the columns ``design`` (m, r, c), for each first reading.

    A reading has r rows. Q is an orthonormal basis of the fit's columns, and ``first_row`` the measurement's first row in
    ``residual``.
    """
    m, r, c = design.shape
    weighted = (design * weights[..., None]).reshape(m * r, c)
    for reading in range(_MIN_ROWS_BESIDE, m - _MIN_ROWS_BESIDE + 1):
        S = np.zeros((len(residual), c))
        S[first_row + reading * r : first_row + m * r] = weighted[reading * r :]
        S -= Q @ (Q.T @ S)
        x, *_ = np.linalg.lstsq(S, residual, rcond=_MIN_UNSPANNED_SHARE)
        yield reading, x, residual - S @ x
