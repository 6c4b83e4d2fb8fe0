"""Unknowns that were not asked for, and would explain what is left: each offered by the name of its option."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..core.printed_numbers import number, percent
from ..typing import Array
from .fit import Fit, Problem, fit
from .log_mistakes import listed_bias
from .observability import blind_spots
from .outliers import least_rows, trimmed
from .unknowns import SensorState

_SURE = 1e-4  # chance that an unknown which is none is offered
_LEAST = 4.0  # degrees of freedom that are to be left
_NEARLY = 0.8  # of the most that any explains, from which the one of fewest columns is preferred
_GAIN = 0.05  # of the load's wrench, from which a gain or cross-talk is told from poses that are off by a degree or two
_OPTIONS = {"drift": "drift=True", "delay": "delay=True", "turn": "orientation=True", "tilt": "tilt=True"}


@dataclass(frozen=True)
class Offer:
    """One more unknown that explains what is left surely better."""

    kind: str
    """drift, delay, turn, tilt, or gain."""
    share: float
    """Of the squares of what was left, in units of the noise, that it explains."""
    said: str
    """What it is, and how large."""

    def __str__(self) -> str:
        what = f"{self.said} would explain {percent(self.share)} of what is left (squares over noise)"
        if self.kind != "gain":
            return f"{what}: ask for {_OPTIONS[self.kind]}."
        return (
            f"{what}: readings are linear in the load's wrench, but not equal to it. Check the sensor's calibration matrix and "
            "its scale."
        )


def unless_drift(problem: Problem, found: Fit, kept: Array) -> tuple[Fit, Array]:
    """The fit and its kept rows (n,), or those with rows that only contradict the others because the bias drifts."""
    drifts = problem.asked(drift=True)
    if kept.all() or problem.unknowns.drift or len(kept) <= least_rows(drifts):
        return found, kept
    if blind_spots(drifts.log, drifts.unknowns, drifts.factor):
        return found, kept
    _, more = trimmed(drifts)
    if more.sum() <= kept.sum():
        return found, kept
    again = fit(replace(problem, state=found.state), keep=more)
    drift = any(offer.kind == "drift" for offer in offers(problem, again, more))
    return (again, more) if drift else (found, kept)


def offers(problem: Problem, fit: Fit, kept: Array) -> list[Offer]:
    """What would explain the residuals of the kept rows (n,), the best first, each beside those before it.

    Each adds columns E to the whitened design. With P the part of E orthogonal to it and to those before, of rank r,
    F = ((|e|² - |e'|²) / r) / (|e'|² / (ν - r)), e' = e - P P'e, with ν the degrees of freedom of the residuals e.
    Drift and gain have columns of their own for each channel, and F is that of the channel where it is rarest, times six:
    a channel's variance is estimated, so what spoils one channel alone hides in it. Of those rarer than 1e-4 the one of
    fewest columns is taken that explains nearly as much as any.
    """
    scale = fit.deviation[kept]
    e = (fit.residuals[kept] / scale).ravel()

    def flat(columns: Array) -> Array:
        x = (columns[kept] / scale[..., None]).reshape(e.size, -1)
        size = np.linalg.norm(x, axis=0)
        return np.asarray(x[:, size > 0] / size[size > 0])

    basis = _orthonormal(flat(fit.design), np.zeros((e.size, 0)))
    candidates = {kind: flat(columns) for kind, columns in _candidates(problem, fit).items()}
    found: list[Offer] = []
    e = e - basis @ (basis.T @ e)
    total = float(e @ e)
    while candidates and float(e @ e) > 1e-20 * max(total, 1e-300):
        sure = {}
        for kind, E in candidates.items():
            if _chance(kind, E, e, basis) < _SURE:
                P = _orthonormal(E, basis)
                sure[kind] = (P, float(((P.T @ e) ** 2).sum()))
        if not sure:
            break
        most = max(gain for _, gain in sure.values())
        kind = min((k for k in sure if sure[k][1] >= _NEARLY * most), key=lambda k: sure[k][0].shape[1])
        P, gain = sure[kind]
        candidates.pop(kind)
        said = _said(kind, problem, fit, kept, (P @ (P.T @ e)).reshape(-1, 6) * scale)
        if said is not None:
            found.append(Offer(kind, gain / total, said))
        e = e - P @ (P.T @ e)
        basis = np.concatenate([basis, P], axis=1)
    return found


def _chance(kind: str, E: Array, e: Array, basis: Array) -> float:
    """How often noise alone is explained as well by the columns E (N, k)."""
    from scipy import special

    channel = np.arange(e.size) % 6
    own = [channel == c for c in range(6)] if kind in ("drift", "gain") else [np.ones(e.size, bool)]
    least = 1.0
    for rows in own:
        P = _orthonormal(E[:, E[rows].any(axis=0)], basis)
        r, free = P.shape[1], float(rows.sum() - (basis[rows] ** 2).sum()) - P.shape[1]
        before, after = (float((x[rows] ** 2).sum()) for x in (e, e - P @ (P.T @ e)))
        if r and free >= _LEAST:
            F = (before - after) / r / max(after / free, 1e-12 * before, 1e-300)
            least = min(least, len(own) * float(special.fdtrc(r, free, F)))
    return least


def _orthonormal(E: Array, basis: Array) -> Array:
    """Orthonormal columns of what E (N, k) has beside those of the basis (N, p); what is rounding is none."""
    E = E - basis @ (basis.T @ E)
    E = E - basis @ (basis.T @ E)
    U, values, _ = np.linalg.svd(E, full_matrices=False)
    return np.asarray(U[:, values > 1e-6])


def _candidates(problem: Problem, fit: Fit) -> dict[str, Array]:
    """Columns (n, 6, k) of each unknown that may be asked for and was not."""
    log, asked = problem.log, fit.unknowns
    state = SensorState(fit.mounting, fit.state.tilt, fit.state.delay, fit.load, fit.state.middle)
    possible = {
        "turn": True,
        "drift": True,
        "tilt": log.rotations is not None,
        "delay": log.V is not None and problem.timed,
    }
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


def _said(kind: str, problem: Problem, fit: Fit, kept: Array, explained: Array) -> str | None:
    """What the unknown is and how large, from the part (n, 6) of the residuals that it explains; None if it is fine print."""
    if kind == "drift":
        return f"A bias that drifts, by {listed_bias(explained[-1] - explained[0])} [N m, N] over the log,"
    if kind == "gain":
        load = _loads(fit)[kept]
        rms = [np.sqrt(((x - x.mean(axis=0)).reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))) for x in (explained, load)]
        share = float((rms[0] / np.maximum(rms[1], 1e-12)).max())
        return (
            f"A gain or cross-talk that is off by {percent(share, 2)} of the load's wrench" if share > _GAIN else None
        )
    columns = _candidates(problem, fit)[kind][kept] / fit.deviation[kept][..., None]
    A = fit.design[kept] / fit.deviation[kept][..., None]
    both = np.concatenate([columns, A], axis=-1).reshape(-1, columns.shape[-1] + A.shape[-1])
    x = np.linalg.lstsq(both, (fit.residuals[kept] / fit.deviation[kept]).ravel(), rcond=None)[0][: columns.shape[-1]]
    if kind == "delay":
        return f"Readings about {number(1e3 * float(x[0]), 2)} ms late"
    what = "A mounting turned" if kind == "turn" else "A base tilted"
    return f"{what} by about {number(math.degrees(float(np.linalg.norm(x))), 2)}°"
