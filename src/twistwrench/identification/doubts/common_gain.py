"""Common gain of all torques of a log: its sign, its unit, and whether the file's bodies explain the log at one gain."""

from __future__ import annotations

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.gravity import STRENGTH
from ...core.numbers import number
from ...core.typing import Array
from .fitted_log import FittedLog

_GAIN_OF_FILE = 0.25, 4.0
"""Common gain of all torques against the file's bodies, below and above which it is a fault."""
_UNITS = {
    1e3: "N mm", 1e-3: "kN m", 10.197: "kgf cm", 0.10197: "kgf m", STRENGTH: "N m if the file's masses are weights",
    4.4482: "N if they were in lbf", 0.73756: "lbf ft", 8.8507: "lbf in", 1.35582: "N m if they were in lbf ft",
    0.112985: "N m if they were in lbf in",
}  # fmt: skip
"""Torques of other units, as multiples of those in N m."""
_MAX_UNIT_DEVIATION, _MAX_RATIO_TO_FREE = 0.02, 2.0
"""Relative deviation from a unit; ratio to the residual of free groups, below which the file's bodies fit at one gain."""
_MAX_RATIO_TO_DRIVES = 0.75
"""Ratio to the residual of drives alone, below which the residual with the file's bodies makes their gain meaningful."""


def gain_of_all(fit: FittedLog) -> list[Doubt]:
    """Sign or unit of all torques together, from a fit of the file's bodies with free drives."""
    base = fit.base
    file = fit.W @ base.project(base.unknown.file_values) - fit.W[:, :, base.held] @ fit.x[base.held]
    sigma = np.maximum(np.sqrt((fit.tau**2).mean(axis=0)), 1e-300)
    drives = fit.W[:, :, base.drives]
    x, squares = _least_squares(fit, np.concatenate([file[..., None], drives], axis=2), sigma)
    _, squares_of_drives = _least_squares(fit, drives, sigma)
    gain = float(x[0])
    if squares > _MAX_RATIO_TO_DRIVES * squares_of_drives:
        return []
    if _GAIN_OF_FILE[0] <= gain <= _GAIN_OF_FILE[1]:
        squares_of_free = float((((fit.tau - fit.W @ fit.x) / sigma)[:, ~fit.dead] ** 2).sum())
        if squares > _MAX_RATIO_TO_FREE**2 * squares_of_free:
            return []
        return unit_doubts(fit, gain)
    kind = "torque-sign" if gain < 0 else "gain"
    words = {"value": number(gain, 3), "interval": "", "evidence": "the file's bodies explain it best so"}
    return [doubt(kind, fit.names, level="refuse", found={"value": gain}, named="all joints", **words)]


def _least_squares(fit: FittedLog, columns: Array, sigma: Array) -> tuple[Array, float]:
    """Coefficients (k,) of columns (m, nv, k) in the live torques, in units of ``sigma`` (nv,), and the sum of squares left."""
    y = (fit.tau / sigma)[:, ~fit.dead].ravel()
    A = (columns / sigma[:, None])[:, ~fit.dead].reshape(len(y), columns.shape[2])
    x: Array = np.zeros(0)
    if columns.size:
        x = np.linalg.lstsq(A, y, rcond=None)[0]
    return x, float(((y - A @ x) ** 2).sum())


def unit_doubts(fit: FittedLog, gain: float) -> list[Doubt]:
    """Unit of torques that explain the file's bodies at one gain as well as free groups do."""
    for factor, unit in _UNITS.items():
        if abs(gain / factor - 1.0) < _MAX_UNIT_DEVIATION:
            words = {"value": number(gain, 3), "said": f"they look like {unit}"}
            return [doubt("unit", fit.names, level="refuse", found={"value": gain}, named="all joints", **words)]
    return []
