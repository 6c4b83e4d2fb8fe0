"""Weighted least squares of rows: each joint by its own size of residual, and large residuals less than small ones.

Iteratively reweighted least squares with Huber's weights min(1, k / |u|), u = r / s, k = 1.345 and s = 1.4826 median |r|
(Holland and Welsch, "Robust regression using iteratively reweighted least-squares", Comm. Statistics A6, 1977).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..typing import Array
from .normal_equations import NormalEquations, Prior

HUBER, _MAD = 1.345, 1.4826
_ROUNDS = 12
Method = Literal["irls", "wls", "ols"]


def weighted_fit(
    W: Array, tau: Array, prior: Prior, method: Method, felt: Array | None = None, rows: Array | None = None
) -> tuple[Array, Array, Array]:
    """Parameters (r,), sizes of residuals by joint (nv,), and weights (n, nv) of the rows, 1 for whole ones.

    ``W`` is (n, nv, r), ``tau`` (n, nv); ``felt`` (nv, r) says which columns are not zero for each joint, ``rows`` (n,) bool
    which rows count: weights of the others say nothing.
    """
    mine = slice(None) if rows is None else rows
    plain = NormalEquations.of(W, tau, felt, rows=mine)
    weights = np.ones(tau.shape)
    if method == "ols":
        x = prior.solve(plain.N.sum(axis=0), plain.c.sum(axis=0))
        return x, np.sqrt(plain.squares(x) / max(1.0, plain.rows)), weights
    x, sigma = plain.solve(prior)
    if method == "wls":
        return x, sigma, weights
    for _ in range(_ROUNDS):
        left = tau - W @ x
        sigma = np.maximum(_MAD * np.median(np.abs(left[mine]), axis=0), 1e-9 * np.abs(tau[mine]).max(axis=0) + 1e-300)
        weights = np.minimum(1.0, HUBER / np.maximum(np.abs(left / sigma), 1e-300))
        root = np.sqrt(weights) / sigma
        equations = NormalEquations.of(W, tau, felt, root, mine)
        new = prior.solve(equations.N.sum(axis=0), equations.c.sum(axis=0))
        done = bool(np.abs((W @ (new - x))[mine]).max() <= 1e-6 * sigma.max())
        x = new
        if done:
            break
    return x, sigma, weights
