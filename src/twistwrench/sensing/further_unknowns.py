"""Unknowns that would explain the residuals of a fit: turn, drift, tilt, delay and gain."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.numbers import number, percent
from ..core.typing import Array
from .doubts.departure import largest_share, orthonormal
from .doubts.reading_doubts import listed_bias
from .fit import Fit, Problem, fit
from .observability import blind_spots
from .outliers import least_rows, reject_outliers
from .unknowns import SensorState

SIGNIFICANCE = 1e-4
"""Significance level: probability of proposing a spurious unknown."""
ROW_TEST_FACTOR = 0.1
"""Factor on the p-value of the test by rows, whose level is thus 1e-3, since the test has few degrees of freedom."""
MIN_FREEDOM = 4.0
"""Smallest number of residual degrees of freedom of a test."""
MIN_SHARE_OF_BEST = 0.8
"""Smallest reduction of the residuals, as a share of the largest reduction, with which a candidate may be chosen."""
MIN_GAIN = 0.05
"""Smallest error of gain or cross-talk, relative to the load's wrench. Smaller errors resemble pose errors of a degree."""
_ROUNDING = 1e-20
"""Share of the squares of the residuals below which they are rounding errors."""
_CHANNELS = 6
"""Number of channels of a reading, moments and forces."""


def fit_unless_drift(problem: Problem, first_fit: Fit, kept: Array) -> tuple[Fit, Array]:
    """Fit and its mask (n,) of kept rows, in which rejected rows are restored if a drift of the bias explains them."""
    with_drift = problem.with_unknowns(drift=True)
    if kept.all() or problem.unknowns.drift or len(kept) <= least_rows(with_drift):
        return first_fit, kept
    if blind_spots(with_drift.log, with_drift.unknowns, with_drift.factor):
        return first_fit, kept
    _, kept_with_drift = reject_outliers(with_drift)
    if kept_with_drift.sum() <= kept.sum():
        return first_fit, kept
    second_fit = fit(replace(problem, state=first_fit.state), keep=kept_with_drift)
    if offers_drift(problem, second_fit, kept_with_drift):
        return second_fit, kept_with_drift
    return first_fit, kept


def offers_drift(problem: Problem, fit: Fit, kept: Array) -> bool:
    """True if a drift of the bias would explain the residuals of the kept rows (n,)."""
    return any(offer.kind == "sensor-drift" for offer in offers(problem, fit, kept))


def offers(problem: Problem, fit: Fit, kept: Array) -> list[Doubt]:
    """Unknowns that would explain the residuals of the kept rows (n,), selected one by one, best first.

    An unknown adds columns E to the whitened design. P is an orthonormal basis of rank r of the part of E that is
    orthogonal to all columns before. With the residuals e and their degrees of freedom ν, the F test is

    ``F = ((|e|² - |e'|²) / r) / (|e'|² / (ν - r))``, ``e' = e - P P'e``.

    Drift and gain have separate columns for each channel. Their p-value is six times the smallest of the channels, as
    each channel has its own variance. Candidates with p < 1e-4 are significant. Among those that explain nearly as much
    as the best, the one with fewest columns is selected.
    """
    scale = fit.deviation[kept]
    e = (fit.residuals[kept] / scale).ravel()

    def unit_columns(columns: Array) -> Array:
        """Whitened columns (N, k) of length 1; zero columns are left out."""
        whitened = (columns[kept] / scale[..., None]).reshape(e.size, -1)
        lengths = np.linalg.norm(whitened, axis=0)
        is_nonzero = lengths > 0
        return np.asarray(whitened[:, is_nonzero] / lengths[is_nonzero])

    basis = orthonormal(unit_columns(fit.design))
    columns_by_kind = _candidates(problem, fit)
    candidates = {kind: unit_columns(columns) for kind, columns in columns_by_kind.items()}
    doubts: list[Doubt] = []
    e = e - basis @ (basis.T @ e)
    first_squares = float(e @ e)
    while candidates and float(e @ e) > _ROUNDING * max(first_squares, 1e-300):
        significant = {}
        for kind, E in candidates.items():
            if _p_value(kind, E, e, basis) < SIGNIFICANCE:
                P = orthonormal(E, basis)
                significant[kind] = (P, float(((P.T @ e) ** 2).sum()))
        if not significant:
            break
        kind = _simplest_kind(significant)
        P, reduction = significant[kind]
        candidates.pop(kind)
        explained_e = P @ (P.T @ e)
        explained = explained_e.reshape(-1, _CHANNELS) * scale  # residuals of readings
        if kind != "gain" or largest_share(explained, _load_wrenches(fit)[kept]) > MIN_GAIN:
            doubts.append(_offer(kind, reduction / first_squares, columns_by_kind[kind], fit, kept, explained))
        e = e - explained_e
        basis = np.concatenate([basis, P], axis=1)
    return doubts


def _simplest_kind(significant: dict[str, tuple[Array, float]]) -> str:
    """Candidate with the fewest columns among those that explain nearly as much as the best one.

    ``significant`` has, for each candidate, the basis P and the reduction of the residuals' squares.
    """
    min_reduction = MIN_SHARE_OF_BEST * max(reduction for _, reduction in significant.values())
    column_counts = {kind: P.shape[1] for kind, (P, reduction) in significant.items() if reduction >= min_reduction}
    return min(column_counts, key=lambda kind: column_counts[kind])


def _p_value(kind: str, E: Array, e: Array, basis: Array) -> float:
    """p-value of the columns E (N, k): the probability that noise alone gives as good a fit."""
    from scipy import special

    by_channel = kind in ("drift", "gain")
    groups = [np.ones(e.size, bool)]  # masks of entries of e that are tested together
    if by_channel:
        channel = np.arange(e.size) % _CHANNELS
        groups = [channel == c for c in range(_CHANNELS)]
    smallest_p = 1.0
    for rows in groups:
        acts_on_rows = E[rows].any(axis=0)
        P = orthonormal(E[:, acts_on_rows], basis)
        r = P.shape[1]
        freedom = float(rows.sum() - (basis[rows] ** 2).sum()) - r
        if not r or freedom < MIN_FREEDOM:
            continue
        e_after = e - P @ (P.T @ e)
        squares_before = float((e[rows] ** 2).sum())
        squares_after = float((e_after[rows] ** 2).sum())
        variance = max(squares_after / freedom, 1e-12 * squares_before, 1e-300)  # not zero if all is explained
        F = (squares_before - squares_after) / r / variance
        p = len(groups) * float(special.fdtrc(r, freedom, F))
        if not by_channel:
            p = max(p, ROW_TEST_FACTOR * _p_value_of_rows(P, e, freedom / _CHANNELS))
        smallest_p = min(smallest_p, p)
    return smallest_p


def _p_value_of_rows(P: Array, e: Array, freedom: float) -> float:
    """p-value by Hotelling's test, for rows whose six channels share the error of their pose.

    b = P'e is the sum of P_g'e_g over the n rows g. Its covariance is C = Σ s_g s_g' n / ν, with s_g = P_g'e'_g of the
    residuals e' = e - P b. T² = b'C⁻¹b has an F distribution after scaling.
    """
    from scipy import special

    r = P.shape[1]
    if freedom < r:
        return 1.0
    b = P.T @ e
    products = P * (e - P @ b)[:, None]
    s = products.reshape(-1, _CHANNELS, r).sum(axis=1)
    C = s.T @ s * len(s) / freedom
    C_inverse_b, *_ = np.linalg.lstsq(C, b, rcond=None)
    T2 = float(b @ C_inverse_b)
    F_freedom = freedom - r + 1
    F = T2 * F_freedom / (freedom * r)
    return float(special.fdtrc(r, F_freedom, F))


def _candidates(problem: Problem, fit: Fit) -> dict[str, Array]:
    """Design columns (n, 6, k) of each possible unknown; for a gain, one for each pair of channel and load component."""
    log = problem.log
    state = SensorState(fit.mounting, fit.state.tilt, fit.state.delay, fit.load, fit.state.middle)
    possible = {
        "turn": True,
        "drift": True,
        "tilt": log.rotations is not None,
        "delay": log.V is not None and problem.timed,
    }
    columns = {}
    for kind, is_possible in possible.items():
        if is_possible and not getattr(fit.unknowns, kind):
            unknowns = problem.with_unknowns(**{kind: True}).unknowns
            design = unknowns.design(log, problem.factor, state)
            columns[kind] = design[..., unknowns.part(kind)]
    gain_columns = np.einsum("nk,cd->ncdk", _load_wrenches(fit), np.eye(_CHANNELS))
    columns["gain"] = gain_columns.reshape(len(log), _CHANNELS, _CHANNELS**2)
    return columns


def _load_wrenches(fit: Fit) -> Array:
    """Wrench (n, 6) of the load in the readings."""
    part = fit.unknowns.load
    return np.asarray(fit.design[..., part] @ fit.estimate[part])


def _offer(kind: str, share: float, columns: Array, fit: Fit, kept: Array, explained: Array) -> Doubt:
    """Doubt with the size of an unknown.

    ``explained`` (n, 6) is the part of the kept rows' residuals that the unknown explains, and ``share`` is its share of all
    squares. ``columns`` are the columns of the unknown in the design.
    """
    found: dict[str, Any] = {"share": share}
    if kind in ("drift", "gain"):
        change = listed_bias(explained[-1] - explained[0])  # from the first to the last reading
        load_wrenches = _load_wrenches(fit)
        size = percent(largest_share(explained, load_wrenches[kept]), 2)
        return doubt(f"sensor-{kind}", bias=change, size=size, share=percent(share), found=found)
    scale = fit.deviation[kept]
    A = np.concatenate([columns[kept], fit.design[kept]], axis=-1) / scale[..., None]
    residuals = (fit.residuals[kept] / scale).ravel()
    changes, *_ = np.linalg.lstsq(A.reshape(_CHANNELS * len(scale), -1), residuals, rcond=None)
    x = changes[: columns.shape[-1]]  # of the unknown
    if kind == "delay":
        (delay,) = x.tolist()  # [s]
        value = 1e3 * delay
        unit = "ms"
    else:  # an angle
        value = math.degrees(float(np.linalg.norm(x)))
        unit = "°"
    found |= {"value": value, "unit": unit}
    return doubt(f"sensor-{kind}", size=number(value, 2), share=percent(share), found=found)
