"""Essential parameters: the fewest groups that predict held-out rows as well as all groups.

Backward elimination removes, at each step, the group whose absence raises the squared residuals least,

    x_i² / (A⁻¹)_ii,     x ← x - A⁻¹ e_i x_i / (A⁻¹)_ii,     A⁻¹ ← A⁻¹ - A⁻¹ e_i e_i' A⁻¹ / (A⁻¹)_ii

and the resulting order is evaluated by 5-fold cross-validation over time.

Source: Pham and Gautier, "Essential parameters of robots", IEEE CDC 1991.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.estimation.least_squares import Information, left_out, squares_of, sum_of
from ..core.typing import Array

_MAX_RATIO_TO_BEST = 1.01  # ratio to the least held-out residual that fewer groups may reach


@dataclass(frozen=True, eq=False)
class EssentialGroups:
    """Essential groups of parameters, in addition to the known ones; the other groups are set to zero.

    Attributes
    ----------
    names : tuple of str
    places : (k,) array, indices among all groups
    values : (k,) array, fitted again without the others
    held_out : float, |τ - τ̂| / |τ| of held-out fifths, in units of the residuals of each joint
    curve : tuple of (count, share), |τ - τ̂| / |τ| for each number of groups
    """

    names: tuple[str, ...]
    places: Array
    values: Array
    held_out: float
    curve: tuple[tuple[int, float], ...]


def essential_groups(
    names: Sequence[str], folds: Sequence[Information], size: Array, held: Array, values: Array
) -> EssentialGroups:
    """Smallest set of groups that predicts as well as any other."""
    x = np.where(held, values, 0.0)  # torques of known groups are subtracted
    parts: list[Information] = []
    for N, c, y in folds:
        if y > 0:
            parts.append((N, c - N @ x, float(y - 2.0 * c @ x + x @ N @ x)))
    total = sum_of(parts)
    order = _elimination_order(total, size, held)
    sets = [np.sort(order[k:]) for k in range(len(order))]
    squares = np.zeros(len(sets))
    for (N, c, y), training in left_out(parts):
        for n, kept in enumerate(sets):
            part = N[np.ix_(kept, kept)], c[kept], y
            squares[n] += squares_of(part, _solve(training, kept, size))
    shares = np.sqrt(squares / max(sum(float(y) for _, _, y in folds), 1e-300))
    chosen = int(np.flatnonzero(shares <= _MAX_RATIO_TO_BEST * shares.min())[-1])
    kept = sets[chosen]
    curve = tuple(zip(map(len, sets), shares.tolist(), strict=True))
    kept_names = tuple(names[k] for k in kept.tolist())
    return EssentialGroups(kept_names, kept, _solve(total, kept, size), float(shares[chosen]), curve)


def _solve(information: Information, groups: Array, size: Array) -> Array:
    """Values of some groups, with a weak prior of the ``size`` of each."""
    N, c, _ = information
    S = size[groups]
    A = N[np.ix_(groups, groups)] * S[:, None] * S + np.eye(len(groups))
    return np.asarray(S * np.linalg.solve(A, S * c[groups]))


def _elimination_order(total: Information, size: Array, held: Array) -> Array:
    """Order in which the groups are removed, without known groups."""
    N, c, _ = total
    remaining = np.flatnonzero(~held)
    S = size[remaining]
    C = np.linalg.inv(N[np.ix_(remaining, remaining)] * S[:, None] * S + np.eye(len(remaining)))
    x = C @ (S * c[remaining])
    order = []
    while remaining.size:
        i = int(np.argmin(x**2 / C.diagonal()))
        order.append(int(remaining[i]))
        gain = C[:, i] / C[i, i]
        x = np.delete(x - gain * x[i], i)
        C = np.delete(np.delete(C - np.outer(gain, C[i]), i, 0), i, 1)
        remaining = np.delete(remaining, i)
    return np.array(order, int)
