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

POSE_SIGNIFICANCE = 1e-4
"""Significance level of a doubt about the poses."""
SEARCH_SIGNIFICANCE = 1e-2
"""Significance level from which other explanations are tried."""
MIN_RATIO_OFF_PLANE = 10.0
"""Ratio to the noise above which a wrong sign is evident without a test."""
MAX_NOISE_OF_RADIUS = 0.1
"""Largest ratio of noise to radius for which forces of equal size lie on a sphere."""
_MIN_MEDIAN_STEP = 1e-4
"""Smallest median step [rad] between the directions of consecutive readings of a log in motion."""
_MAX_STEP = 0.2
"""Largest step [rad] between the directions of consecutive readings of a log in motion."""
_SPHERE_PARAMETERS = 4
"""Number of parameters of a sphere: centre and radius."""
_MIN_READINGS_OF_SPHERE = 7
"""Smallest number of readings for the fit of a sphere."""
MIN_READINGS_OF_MOTION = 10
"""Smallest number of readings for the test of motion."""
_MIN_SINGULAR_SHARE = 1e-6
"""Share of the largest singular value up to which a singular value counts as zero."""
_TINY_SQUARE = 1e-300
"""Square of a radius in place of 0 or less."""
_TINY_DEVIATION = 1e-12
"""Deviation in place of 0, relative to the spread of the forces."""


def seems_moving(log: ReadingLog) -> bool:
    """True if the directions of a log without twists change steadily, unlike those of static poses."""
    if log.V is not None or len(log) < MIN_READINGS_OF_MOTION:
        return False
    directions = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    steps = np.linalg.norm(np.diff(directions, axis=0), axis=1)
    extent = np.ptp(directions, axis=0).max()
    return bool(np.median(steps) > _MIN_MEDIAN_STEP and steps.max() < _MAX_STEP and extent > _MAX_STEP)


def listed_bias(bias: Array) -> str:
    """Components of a bias (6,) with axis names, for messages."""
    return ", ".join(f"{axis} {number(value, 3)}" for axis, value in zip(WRENCH, bias, strict=True))


def misfit(log: ReadingLog, found: Fit, kept: Array) -> float:
    """Residual (rms) of the forces as a fraction of their change in the log; ``kept`` (n,) marks the used rows."""
    f = log.readings[kept][:, 3:]
    rms_change = float(np.sqrt(np.mean((f - f.mean(axis=0)) ** 2)))
    rms_residual = float(np.sqrt(np.mean(found.residuals[kept][:, 3:] ** 2)))
    return rms_residual / rms_change if rms_change else 0.0


def is_planar(log: ReadingLog, found: Fit, kept: Array, mass: float) -> bool:
    """True if gravity lies in a plane within noise. A half turn about the plane's normal then equals the other sign."""
    g = log.gravity[kept]
    if found.unknowns.bias:  # a constant component is absorbed by the bias
        g = g - g.mean(axis=0)
    extent_off_plane = 0.0
    if len(g) > 2:
        _, _, extent_off_plane = np.linalg.svd(g, compute_uv=False).tolist()
    _, force_noise = found.noise
    return 2.0 * mass * extent_off_plane < MIN_RATIO_OFF_PLANE * float(force_noise)


def unexplained_turns(log: ReadingLog, found: Diagnosis) -> float | None:
    """Noise [N] of forces estimated without the poses, if significantly less than the residuals; otherwise None.

    At rest, forces lie on a sphere about the bias: |f|² = 2 b·f + r² − |b|² is linear in b and r² − |b|².
    """
    from scipy import special

    f = log.readings[found.kept][:, 3:]
    n = len(f)
    if log.V is not None or n < _MIN_READINGS_OF_SPHERE:
        return None
    mean = f.mean(axis=0)
    scale = float(np.linalg.norm(f - mean, axis=1).max())
    if not scale:
        return None
    u = (f - mean) / scale  # forces in units in which their spread is 1
    A = np.column_stack([2 * u, np.ones(n)])
    x, _, rank, _ = np.linalg.lstsq(A, (u * u).sum(axis=1), rcond=_MIN_SINGULAR_SHARE)
    if rank < _SPHERE_PARAMETERS:  # forces in a plane determine no sphere
        return None
    centre = x[:3]
    radius = math.sqrt(max(float(x[3] + centre @ centre), _TINY_SQUARE))
    deviations = np.linalg.norm(u - centre, axis=1) - radius
    freedom = n - _SPHERE_PARAMETERS
    deviation = math.sqrt(float(deviations @ deviations) / freedom)
    noise = scale * max(deviation, _TINY_DEVIATION)
    if noise > MAX_NOISE_OF_RADIUS * radius * scale:
        return None
    _, force_noise = found.noise
    F = (force_noise / noise) ** 2
    if special.fdtri(2 * n, freedom, 1 - POSE_SIGNIFICANCE) > F:
        return None
    return noise


def turns_may_help(log: ReadingLog, found: Fit, kept: Array) -> bool:
    """True if another sign or mounting may explain a log significantly better.

    At rest, bias and weight are a linear map of gravity for every sign and mounting. If the best linear map is not
    significantly better by an F test, no other sign or mounting is.
    """
    from scipy import special

    if log.V is not None:
        return True
    g = log.gravity[kept]
    readings = log.readings[kept]
    A = np.column_stack([np.ones(len(g)), g - g.mean(axis=0)])
    x, _, rank, _ = np.linalg.lstsq(A, readings, rcond=_MIN_SINGULAR_SHARE)
    scale = np.repeat(found.spread(kept), 3)
    map_freedom = 6.0 * (len(g) - rank)
    fit_freedom = 6.0 * len(g) - len(found.unknowns.names)
    if map_freedom <= 0 or fit_freedom <= map_freedom:  # no test is possible
        return True
    map_sum = float((((readings - A @ x) / scale) ** 2).sum())  # of squares
    fit_sum = float(((found.residuals[kept] / scale) ** 2).sum())
    additional_unknowns = fit_freedom - map_freedom
    max_F = float(special.fdtri(additional_unknowns, map_freedom, 1 - SEARCH_SIGNIFICANCE))
    return (fit_sum - map_sum) / additional_unknowns - map_sum / map_freedom * max_F > 0
