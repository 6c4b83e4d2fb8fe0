"""Unknowns that were not asked for, and would explain what is left: each offered by the name of its option."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fit import Fit, Problem
from .unknowns import State

Array = NDArray[Any]

__all__ = ["Offer", "gain_columns", "offers"]

_SURE = 1e-4  # chance that an unknown which is none is offered
_GAIN = 0.02  # of the load's wrench, from which a gain or cross-talk is no fine print
_OPTIONS = {"drift": "drift=True", "delay": "delay=True", "turn": "orientation=True", "tilt": "tilt=True"}


@dataclass(frozen=True)
class Offer:
    """One more unknown that explains what is left surely better."""

    kind: str
    """drift, delay, turn, tilt, or gain."""
    share: float
    """Of the squares of what was left that it explains."""
    size: float
    """Largest change [N m, N] over the log by drift; delay [s]; turn and tilt [rad]; gain, of the load's wrench."""

    def __str__(self) -> str:
        explained = f"explains {100 * self.share:.0f} % of what is left (squares)"
        option = _OPTIONS.get(self.kind)
        if self.kind == "drift":
            return f"A bias that drifts, by up to {self.size:.2g} over the log, {explained}: ask for {option}."
        if self.kind == "delay":
            return f"Readings that are late by {1e3 * self.size:.2g} ms {explained}: ask for {option}."
        if self.kind == "turn":
            return f"A mounting turned by {math.degrees(self.size):.2g}° {explained}: ask for {option}."
        if self.kind == "tilt":
            return f"A base tilted by {math.degrees(self.size):.2g}° {explained}: ask for {option}."
        return (
            f"A gain or cross-talk of the sensor that is off by {100 * self.size:.2g} % {explained}: readings are linear in "
            "the load's wrench, but not equal to it. Check the sensor's calibration matrix and its scale."
        )


def offers(problem: Problem, fit: Fit, kept: Array) -> list[Offer]:
    """What would explain the residuals of the kept rows (n,), the best first, each beside those before it.

    Each adds columns E to the whitened design: with P the part of E orthogonal to it and to those before, of rank r,
    F = (|P e|² / r) / ((|e|² - |P e|²) / (N - p - r)). Of those whose F is rarer than 1e-4 the one of least
    N log(|e|² - |P e|²) + r log N (Schwarz) is taken.
    """
    from scipy import special

    scale = fit.deviation[kept]
    e = (fit.residuals[kept] / scale).ravel()
    N = e.size

    def flat(columns: Array) -> Array:
        x = (columns[kept] / scale[..., None]).reshape(N, -1)
        size = np.linalg.norm(x, axis=0)
        return np.asarray(x[:, size > 0] / size[size > 0])

    basis = _orthonormal(flat(fit.design), np.zeros((N, 0)))
    candidates = {kind: flat(columns) for kind, columns in _candidates(problem, fit).items()}
    found: list[Offer] = []
    e, total = e - basis @ (basis.T @ e), float(e @ e)
    while candidates:
        best: tuple[float, str, Array, float] | None = None
        before = float(e @ e)
        if before <= 1e-24 * max(total, 1.0):
            break
        for kind, E in candidates.items():
            P = _orthonormal(E, basis)
            r, free = P.shape[1], N - basis.shape[1] - P.shape[1]
            if not r or free < 2:
                continue
            gain = float(((P.T @ e) ** 2).sum())
            if special.fdtrc(r, free, gain / r / max((before - gain) / free, 1e-300)) > _SURE:
                continue
            score = N * math.log(max(before - gain, 1e-300)) + r * math.log(N)
            if best is None or score < best[0]:
                best = (score, kind, P, gain)
        if best is None:
            break
        _, kind, P, gain = best
        candidates.pop(kind)
        size = _size(kind, problem, fit, kept, (P @ (P.T @ e)).reshape(-1, 6) * scale)
        if kind != "gain" or size > _GAIN:
            found.append(Offer(kind, gain / total, size))
        e = e - P @ (P.T @ e)
        basis = np.concatenate([basis, P], axis=1)
    return found


def _orthonormal(E: Array, basis: Array) -> Array:
    """Orthonormal columns of what E (N, k) has beside those of the basis (N, p); what is rounding is none."""
    E = E - basis @ (basis.T @ E)
    E = E - basis @ (basis.T @ E)
    U, values, _ = np.linalg.svd(E, full_matrices=False)
    return np.asarray(U[:, values > 1e-6])


def _candidates(problem: Problem, fit: Fit) -> dict[str, Array]:
    """Columns (n, 6, k) of each unknown that may be asked for and was not."""
    log, asked = problem.log, fit.unknowns
    state = State(fit.mounting, fit.state.tilt, fit.state.delay, fit.load, fit.state.middle)
    possible = {"turn": True, "drift": True, "tilt": log.rotations is not None, "delay": log.V is not None and problem.timed}
    found = {}
    for kind, can in possible.items():
        if can and not getattr(asked, kind):
            more = problem.asked(**{kind: True}).unknowns
            found[kind] = more.design(log, problem.factor, state)[..., more.part(kind)]
    found["gain"] = gain_columns(_loads(fit))
    return found


def gain_columns(load: Array) -> Array:
    """Columns (n, 6, 36): each of the six channels with a share of each of the load's wrenches (n, 6)."""
    n = len(load)
    return np.einsum("nk,cd->ncdk", load, np.eye(6)).reshape(n, 6, 36)


def _loads(fit: Fit) -> Array:
    """(n, 6) what the load does to the readings."""
    part = fit.unknowns.load
    return np.asarray(fit.design[..., part] @ fit.estimate[part])


def _size(kind: str, problem: Problem, fit: Fit, kept: Array, explained: Array) -> float:
    """How large the unknown is, from the part (n, 6) of the residuals that it explains."""
    if kind == "drift":
        return float(np.ptp(explained, axis=0).max())
    if kind == "gain":
        load = _loads(fit)[kept]
        rms = [np.sqrt(((x - x.mean(axis=0)).reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))) for x in (explained, load)]
        return float((rms[0] / np.maximum(rms[1], 1e-12)).max())
    columns = _candidates(problem, fit)[kind][kept] / fit.deviation[kept][..., None]
    A = fit.design[kept] / fit.deviation[kept][..., None]
    both = np.concatenate([columns, A], axis=-1).reshape(-1, columns.shape[-1] + A.shape[-1])
    x = np.linalg.lstsq(both, (fit.residuals[kept] / fit.deviation[kept]).ravel(), rcond=None)[0]
    return float(np.linalg.norm(x[: columns.shape[-1]])) if kind != "delay" else float(x[0])
