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

_MAX_RATIO_TO_BEST = 1.01
"""Ratio to the least held-out residual that fewer groups may reach."""
_MIN_SQUARED_TORQUE = 1e-300
"""Divisor in place of zero."""


@dataclass(frozen=True, eq=False)
class EssentialGroups:
    """Essential groups of parameters, in addition to the known ones; the other groups are set to zero.

    Attributes
    ----------
    names : tuple of str
    places : (k,) array, indices among all groups
    values : (k,) array, fitted again without the others
    held_out : float, |τ - τ̂| / |τ| of held-out fifths, in units of the residuals of each joint
    curve : tuple of (count, share), |τ - τ̂| / |τ| for each number of groups, from all groups to one
    """

    names: tuple[str, ...]
    places: Array
    values: Array
    held_out: float
    curve: tuple[tuple[int, float], ...]


def essential_groups(
    names: Sequence[str], folds: Sequence[Information], size: Array, held: Array, values: Array
) -> EssentialGroups:
    """Smallest set of groups whose held-out residual is at most 1 % above the least of all sets.

    Parameters
    ----------
    names : names of all groups
    folds : normal equations (N, c, y) of each fifth of the time
    size : (r,) array, typical values of the groups
    held : (r,) array of bool, True for groups with known values
    values : (r,) array, values of the groups; only values of known groups are used
    """
    known_values = np.where(held, values, 0.0)
    unknown_folds = _without_known_groups(folds, known_values)
    total = sum_of(unknown_folds)
    order = _elimination_order(total, size, held)
    sets = [np.sort(order[k:]) for k in range(len(order))]  # from all groups to the last one
    squares = np.zeros(len(sets))  # squared residual of all held-out fifths, for each set
    for (N, c, y), training in left_out(unknown_folds):
        for n, groups in enumerate(sets):
            held_out = (N[np.ix_(groups, groups)], c[groups], y)
            trained_values = _solve(training, groups, size)
            squares[n] += squares_of(held_out, trained_values)
    squared_torques = sum(float(y) for _, _, y in folds)  # y = τ' τ
    shares = np.sqrt(squares / max(squared_torques, _MIN_SQUARED_TORQUE))
    good_enough = np.flatnonzero(shares <= _MAX_RATIO_TO_BEST * shares.min())
    smallest = int(good_enough[-1])  # the sets become smaller
    essential = sets[smallest]
    set_sizes = [len(groups) for groups in sets]
    curve = tuple(zip(set_sizes, shares.tolist(), strict=True))
    essential_names = tuple(names[k] for k in essential.tolist())
    fitted_values = _solve(total, essential, size)
    return EssentialGroups(essential_names, essential, fitted_values, float(shares[smallest]), curve)


def _without_known_groups(folds: Sequence[Information], x: Array) -> list[Information]:
    """Normal equations of each fifth with the torques W x of known groups subtracted; empty fifths are left out.

    With N = W' W, c = W' τ and y = τ' τ: W' (τ - W x) = c - N x, and |τ - W x|² = y - 2 c' x + x' N x.
    """
    remaining: list[Information] = []
    for N, c, y in folds:
        if y > 0:
            remaining_c = c - N @ x
            remaining_y = float(y - 2.0 * c @ x + x @ N @ x)
            remaining.append((N, remaining_c, remaining_y))
    return remaining


def _solve(information: Information, groups: Array, size: Array) -> Array:
    """Values of some groups (indices), with a weak prior of mean 0 and standard deviations ``size``."""
    N, c, _ = information
    S = size[groups]
    own_N = N[np.ix_(groups, groups)]
    A = own_N * S[:, None] * S + np.eye(len(groups))  # for the values x / S
    return np.asarray(S * np.linalg.solve(A, S * c[groups]))


def _elimination_order(total: Information, size: Array, held: Array) -> Array:
    """Indices of the unknown groups in the order in which they are removed.

    C is A⁻¹ of the module's equations, for values divided by ``size``.
    """
    N, c, _ = total
    remaining = np.flatnonzero(~held)
    S = size[remaining]
    A = N[np.ix_(remaining, remaining)] * S[:, None] * S + np.eye(len(remaining))
    C = np.linalg.inv(A)
    x = C @ (S * c[remaining])
    order = []
    while remaining.size:
        i = int(np.argmin(x**2 / C.diagonal()))
        order.append(int(remaining[i]))
        gain = C[:, i] / C[i, i]  # A⁻¹ e_i / (A⁻¹)_ii
        x = np.delete(x - gain * x[i], i)
        C = C - np.outer(gain, C[i])
        C = np.delete(C, i, axis=0)
        C = np.delete(C, i, axis=1)
        remaining = np.delete(remaining, i)
    return np.array(order, int)
