"""Common gain of all torques of a log: its sign, its unit, and whether the file's bodies explain the log at one gain."""

from __future__ import annotations

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.gravity import STRENGTH
from ...core.numbers import number
from ...core.typing import Array
from .fitted_log import FittedLog

_MIN_GAIN = 0.25
"""Common gain of all torques, relative to the file's bodies, below which it is a fault."""
_MAX_GAIN = 4.0
"""Common gain of all torques, relative to the file's bodies, above which it is a fault."""
_UNITS = {
    1e3: "N mm",
    1e-3: "kN m",
    10.197: "kgf cm",
    0.10197: "kgf m",
    STRENGTH: "N m if the file's masses are weights",
    4.4482: "N if they were in lbf",
    0.73756: "lbf ft",
    8.8507: "lbf in",
    1.35582: "N m if they were in lbf ft",
    0.112985: "N m if they were in lbf in",
}
"""Explanation of a gain common to all torques, by the gain: 1 N m in another unit, or the reverse."""
_MAX_UNIT_DEVIATION = 0.02
"""Largest relative deviation of a gain from that of a unit."""
_MAX_RATIO_TO_FREE = 2.0
"""Residual with the file's bodies at one gain, over the residual with free groups, up to which these bodies fit."""
_MAX_RATIO_TO_DRIVES = 0.75
"""Squared residual with the file's bodies, over that with drives alone, up to which the gain has a meaning."""


def gain_of_all(fit: FittedLog) -> list[Doubt]:
    """Sign or unit of all torques together, from a fit of the file's bodies with free drives."""
    base = fit.base
    held_torques = fit.W[:, :, base.held] @ fit.x[base.held]
    torques_of_file = fit.W @ base.project(base.unknown.file_values) - held_torques
    rms = np.sqrt((fit.tau**2).mean(axis=0))
    sigma = np.maximum(rms, 1e-300)  # 1e-300: a column may be zero
    drives = fit.drive_columns
    file_and_drives = np.concatenate([torques_of_file[..., None], drives], axis=2)
    coefficients, square_sum = _least_squares(fit, file_and_drives, sigma)
    _, square_sum_of_drives = _least_squares(fit, drives, sigma)
    gain, *_ = coefficients.tolist()  # the gains of the drives follow
    if square_sum > _MAX_RATIO_TO_DRIVES * square_sum_of_drives:
        return []
    if _MIN_GAIN <= gain <= _MAX_GAIN:
        residual = (fit.tau - fit.W @ fit.x) / sigma
        square_sum_of_free = float((residual[:, ~fit.dead] ** 2).sum())
        if square_sum > _MAX_RATIO_TO_FREE**2 * square_sum_of_free:
            return []
        return unit_doubts(fit, gain)
    kind = "torque-sign" if gain < 0 else "gain"
    words = {"value": number(gain, 3), "interval": "", "evidence": "the file's bodies explain it best so"}
    return [doubt(kind, fit.names, level="refuse", found={"value": gain}, named="all joints", **words)]


def _least_squares(fit: FittedLog, columns: Array, sigma: Array) -> tuple[Array, float]:
    """Coefficients (k,) of columns (m, nv, k) in the torques, and the sum of squared residuals.

    Torques are in units of ``sigma`` (nv,); joints without torques are left out.
    """
    y = (fit.tau / sigma)[:, ~fit.dead].ravel()
    A = (columns / sigma[:, None])[:, ~fit.dead].reshape(len(y), columns.shape[2])
    x: Array = np.zeros(0)
    if columns.size:
        x, *_ = np.linalg.lstsq(A, y, rcond=None)
    return x, float(((y - A @ x) ** 2).sum())


def unit_doubts(fit: FittedLog, gain: float) -> list[Doubt]:
    """Doubt about the unit of the log's torques, if the gain is near the factor of another unit."""
    for factor, unit in _UNITS.items():
        if abs(gain / factor - 1.0) < _MAX_UNIT_DEVIATION:
            words = {"value": number(gain, 3), "said": f"they look like {unit}"}
            return [doubt("unit", fit.names, level="refuse", found={"value": gain}, named="all joints", **words)]
    return []
