"""Doubts about readings of a force-torque sensor: motion, poses, misfit, sign and mounting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...core.numbers import number
from ...core.typing import Array
from ...mechanics.lie.labelled import WRENCH

if TYPE_CHECKING:
    from ..conventions import Diagnosis
    from ..fit import Fit
    from ..log import ReadingLog

POSE_SIGNIFICANCE = 1e-4  # significance level for blaming the poses
SEARCH_SIGNIFICANCE = 1e-2  # significance level for trying other explanations
MIN_RATIO_OFF_PLANE = 10.0  # ratio to the noise above which a wrong sign is evident without a test
MAX_NOISE_OF_RADIUS = 0.1  # noise over radius below which forces of equal size lie on a sphere
_STEPS_IN_MOTION = (1e-4, 0.2)  # rad between consecutive readings of a log in motion
MIN_READINGS_OF_MOTION = 10  # minimum number of readings for the test of motion


def seems_moving(log: ReadingLog) -> bool:
    """True if the directions of a log without twists change steadily, unlike those of static poses."""
    if log.V is not None or len(log) < MIN_READINGS_OF_MOTION:
        return False
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    step = np.linalg.norm(np.diff(unit, axis=0), axis=1)
    smallest, largest = _STEPS_IN_MOTION
    return bool(smallest < np.median(step) and step.max() < largest and np.ptp(unit, axis=0).max() > largest)


def listed_bias(bias: Array) -> str:
    """Components of a bias (6,) with axis names, for messages."""
    return ", ".join(f"{axis} {number(value, 3)}" for axis, value in zip(WRENCH, bias, strict=True))


def misfit(log: ReadingLog, found: Fit, kept: Array) -> float:
    """Residual of the forces as a fraction of their change in the log."""
    f = log.readings[kept][:, 3:]
    change = float(np.sqrt(np.mean((f - f.mean(axis=0)) ** 2)))
    residual = float(np.sqrt(np.mean(found.residuals[kept][:, 3:] ** 2)))
    return residual / change if change else 0.0


def is_planar(log: ReadingLog, found: Fit, kept: Array, mass: float) -> bool:
    """True if gravity lies in a plane within noise; a half turn about its normal then equals the opposite sign."""
    g = log.gravity[kept]
    if found.unknowns.bias:  # a constant component is absorbed by the bias
        g = g - g.mean(axis=0)
    extent_off_plane = 0.0
    if len(g) > 2:
        extent_off_plane = float(np.linalg.svd(g, compute_uv=False)[-1])
    return 2.0 * mass * extent_off_plane < MIN_RATIO_OFF_PLANE * float(found.noise[1])


def unexplained_turns(log: ReadingLog, found: Diagnosis) -> float | None:
    """Noise [N] of forces estimated without the poses, if significantly less than the residuals; otherwise None.

    At rest, forces lie on a sphere about the bias: |f|² = 2 b·f + r² − |b|² is linear in b and r² − |b|².
    """
    from scipy import special

    f = log.readings[found.kept][:, 3:]
    n = len(f)
    if log.V is not None or n < 7:
        return None
    middle, size = f.mean(axis=0), float(np.linalg.norm(f - f.mean(axis=0), axis=1).max())
    if not size:
        return None
    u = (f - middle) / size
    A = np.column_stack([2 * u, np.ones(n)])
    x, _, rank, _ = np.linalg.lstsq(A, (u * u).sum(axis=1), rcond=1e-6)
    if rank < 4:
        return None
    radius = math.sqrt(max(float(x[3] + x[:3] @ x[:3]), 1e-300))
    deviations = np.linalg.norm(u - x[:3], axis=1) - radius
    noise = size * max(math.sqrt(float(deviations @ deviations) / (n - 4)), 1e-12)
    if noise > MAX_NOISE_OF_RADIUS * radius * size:
        return None
    if (found.noise[1] / noise) ** 2 < special.fdtri(2 * n, n - 4, 1 - POSE_SIGNIFICANCE):
        return None
    return noise


def turns_may_help(log: ReadingLog, found: Fit, kept: Array) -> bool:
    """True if another sign or mounting may explain a log significantly better; at rest, if any linear map of gravity does.

    Bias and weight are a linear map of gravity for every sign and mounting. If the best linear map is not better, no
    other sign or mounting is.
    """
    from scipy import special

    if log.V is not None:
        return True
    g, readings = log.gravity[kept], log.readings[kept]
    A = np.column_stack([np.ones(len(g)), g - g.mean(axis=0)])
    x, _, rank, _ = np.linalg.lstsq(A, readings, rcond=1e-6)
    scale = np.repeat(found.spread(kept), 3)
    map_freedom, freedom = 6.0 * (len(g) - rank), 6.0 * len(g) - len(found.unknowns.names)
    if map_freedom <= 0 or freedom <= map_freedom:
        return True
    map_sum = float((((readings - A @ x) / scale) ** 2).sum())
    reduction = float(((found.residuals[kept] / scale) ** 2).sum()) - map_sum
    further = freedom - map_freedom
    limit = float(special.fdtri(further, map_freedom, 1 - SEARCH_SIGNIFICANCE))
    return reduction / further - map_sum / map_freedom * limit > 0
