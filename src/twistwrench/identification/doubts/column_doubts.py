"""Doubts about columns of logs: dead, saturated and coarse ones, and copies of one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.estimation.noise import quantum
from ...core.estimation.sampling import cut_off, moves
from ...core.numbers import number, percent, printed
from ...core.typing import Array
from .fitted_log import FittedLog

_MAX_GRID_NOISE = 0.15
"""Noise of accelerations by the grid of positions, as a share of the accelerations, above which a column is coarse."""


def column_doubts(fit: FittedLog) -> Iterator[Doubt]:
    """Doubts about dead, saturated, coarse and copied columns."""
    has_moved = np.any([moves(log.q[:, : len(fit.names)]) for log in fit.logs], axis=0)  # (nv,) in any log
    has_changing_torques = any(moves(log.tau).any() for log in fit.logs)
    is_at_rest = not has_moved.any() and not has_changing_torques
    if is_at_rest:
        yield doubt("unexciting", said="the robot stood still: no position or torque changes by more than its noise.")
    dead_torques = fit.joints(np.flatnonzero(fit.dead))
    if dead_torques:
        yield doubt("dead-torque", dead_torques)
    dead_positions = fit.joints(np.flatnonzero(~fit.dead & ~has_moved))
    if dead_positions and not is_at_rest:
        yield _dead_position_doubt(dead_positions, all_still=not has_moved.any())
    torques = np.concatenate([log.tau for log in fit.logs])
    yield from _copies(fit, torques)
    for k in np.flatnonzero(~fit.dead).tolist():
        saturation = cut_off(torques[:, k])
        if saturation is not None:
            extreme, share_of_rows = saturation
            yield doubt("saturated", [fit.names[k]], extreme=number(extreme), rows=percent(share_of_rows, 3))
    yield from _coarse_positions(fit)


def _dead_position_doubt(joints: Sequence[str], *, all_still: bool) -> Doubt:
    """Doubt about joints that do not move but have torques; it rejects the log if no joint moves."""
    if all_still:
        return doubt("dead-position", joints, named="all joints", level="refuse")
    return doubt("dead-position", joints)


def _coarse_positions(fit: FittedLog) -> Iterator[Doubt]:
    """Doubts about positions whose grid disturbs the accelerations."""
    cutoff = fit.settings.cutoff
    for k, name in enumerate(fit.names):
        grid = quantum([window.q[:, k] for log in fit.logs for window in log.windows])
        rms_acceleration = float(np.sqrt((fit.acceleration[:, k] ** 2).mean()))
        # Rounding errors are white, of size σ = grid / √12, with density 2 σ² / rate. After the low-pass and two derivatives,
        # their mean square is 2 σ² / rate ∫ (2 π f)^4 df = 2 σ² / rate (2 π f)^4 f / 5 with the cut-off f.
        noise = grid / np.sqrt(12.0) * (2 * np.pi * cutoff) ** 2 * np.sqrt(2 * cutoff / fit.rate / 5.0)
        if grid > 0 and rms_acceleration > 0 and noise > _MAX_GRID_NOISE * rms_acceleration:
            noise_share = percent(noise / rms_acceleration, 3)
            yield doubt("quantised", [name], grid=number(grid, 3), noise=noise_share, cutoff=printed(cutoff))


_MAX_COPY_DIFFERENCE = 1e-9
"""Difference, as a share of a column's standard deviation, below which two values are equal."""
_MIN_COPIED_ROWS = 0.99
"""Minimum share of equal rows of a copy."""


def _copies(fit: FittedLog, torques: Array) -> Iterator[Doubt]:
    """Doubts about pairs of columns that are equal up to a factor in nearly all rows."""
    for j, k, factor in _proportional_columns(torques, ~fit.dead):
        yield _copy_doubt(fit.names[j], fit.names[k], "torque", factor)
    positions = fit.q[:, : len(fit.names)]
    for j, k, factor in _proportional_columns(positions, np.ones(len(fit.names), bool)):
        if abs(factor - 1.0) <= _MAX_COPY_DIFFERENCE:  # proportional positions of a planned motion are no copies
            yield _copy_doubt(fit.names[j], fit.names[k], "position", factor)


def _copy_doubt(first_joint: str, second_joint: str, quantity: str, factor: float) -> Doubt:
    """Doubt about the column of the second joint, which is a multiple of the column of the first joint."""
    times = "" if abs(factor - 1.0) < _MAX_COPY_DIFFERENCE else f"{number(factor, 4)} times "
    return doubt("copied", [first_joint, second_joint], what=quantity, times=times)


def _proportional_columns(x: Array, is_live: Array) -> Iterator[tuple[int, int, float]]:
    """Indices of pairs of live columns of x (m, n) of which the second is a multiple of the first, and the factor."""
    deviations = x.std(axis=0)
    columns = np.flatnonzero(is_live & (deviations > 0)).tolist()
    for j, k in combinations(columns, 2):
        factor = float(x[:, j] @ x[:, k] / (x[:, j] @ x[:, j]))
        is_equal = np.abs(x[:, k] - factor * x[:, j]) <= _MAX_COPY_DIFFERENCE * deviations[k]
        if is_equal.mean() > _MIN_COPIED_ROWS:
            yield j, k, factor
