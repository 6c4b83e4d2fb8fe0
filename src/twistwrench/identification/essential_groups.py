"""Essential parameters: the fewest groups that predict rows held out as well as all of them.

Backward elimination: of the groups that are left, the one goes whose absence raises the squared residuals least,

    x_i² / (A⁻¹)_ii,     x ← x - A⁻¹ e_i x_i / (A⁻¹)_ii,     A⁻¹ ← A⁻¹ - A⁻¹ e_i e_i' A⁻¹ / (A⁻¹)_ii

and the order of all is judged by fifths of the time, each predicted from the others.

Source: Pham and Gautier, "Essential parameters of robots", IEEE CDC 1991.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .normal_equations import Information

_NEAR_BEST = 1.01
"""Times the least residual held out, that fewer groups may leave."""


@dataclass(frozen=True, eq=False)
class EssentialGroups:
    """Essential groups of parameters, besides those that are known; the others are taken for zero.

    Attributes
    ----------
    names : tuple of str
    places : (k,) array, their numbers among all groups
    values : (k,) array, fitted anew without the others
    held_out : float, |τ - τ̂| / |τ| of fifths held out, in units of the residuals of each joint
    curve : tuple of (count, share), the same for each count of groups
    """

    names: tuple[str, ...]
    places: Array
    values: Array
    held_out: float
    curve: tuple[tuple[int, float], ...]


def essential_groups(
    names: Sequence[str], folds: Sequence[Information], size: Array, held: Array, values: Array
) -> EssentialGroups:
    """The fewest groups that predict as well as any.

    Parameters
    ----------
    names : sequence of str, of the groups
    folds : sequence of N (r, r), c (r,), |τ|², of fifths of the weighted rows
    size : (r,) array, that each group could have at most
    held : (r,) bool array, groups that are known
    values : (r,) array, of which those known are used

    Returns
    -------
    found : EssentialGroups
    """
    parts = [_less_known(fold, held, values) for fold in folds if fold[2] > 0]
    total = _sum(parts)
    order = _order(total, size, held)
    sets = [np.sort(order[k:]) for k in range(len(order))]
    left = np.zeros(len(sets))
    for k, part in enumerate(parts):
        rest = _sum([p for j, p in enumerate(parts) if j != k]) if len(parts) > 1 else total
        N, c, y = part
        for n, kept in enumerate(sets):
            x = _solved(rest, kept, size)
            left[n] += max(y - 2.0 * float(c[kept] @ x) + float(x @ N[np.ix_(kept, kept)] @ x), 0.0)
    shares = np.sqrt(left / max(sum(float(fold[2]) for fold in folds), 1e-300))
    chosen = int(np.flatnonzero(shares <= _NEAR_BEST * shares.min())[-1])
    kept = sets[chosen]
    found = _solved(total, kept, size)
    curve = tuple((len(one), float(share)) for one, share in zip(sets, shares, strict=True))
    return EssentialGroups(tuple(names[k] for k in kept), kept, found, float(shares[chosen]), curve)


def _less_known(fold: Information, held: Array, values: Array) -> Information:
    """The information with what known groups do taken off the torques."""
    N, c, y = fold
    x = np.where(held, values, 0.0)
    return N, c - N @ x, float(y - 2.0 * c @ x + x @ N @ x)


def _sum(parts: Sequence[Information]) -> Information:
    N, c, y = (sum(x) for x in zip(*parts, strict=True))
    return np.asarray(N), np.asarray(c), float(y)


def _solved(information: Information, which: Array, size: Array) -> Array:
    N, c, _ = information
    S = size[which]
    A = N[np.ix_(which, which)] * S[:, None] * S + np.eye(len(which))
    return np.asarray(S * np.linalg.solve(A, S * c[which]))


def _order(total: Information, size: Array, held: Array) -> Array:
    """The groups in the order in which they go, those that are known left out."""
    N, c, _ = total
    left = np.flatnonzero(~held)
    S = size[left]
    C = np.linalg.inv(N[np.ix_(left, left)] * S[:, None] * S + np.eye(len(left)))
    x = C @ (S * c[left])
    order = []
    while left.size:
        i = int(np.argmin(x**2 / C.diagonal()))
        order.append(int(left[i]))
        gain = C[:, i] / C[i, i]
        x, C = np.delete(x - gain * x[i], i), np.delete(np.delete(C - np.outer(gain, C[i]), i, 0), i, 1)
        left = np.delete(left, i)
    return np.array(order, int)
