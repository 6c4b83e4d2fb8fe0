"""The factors of a symmetric positive definite matrix, unrolled, that keep the zeros of a tree; Featherstone, RBDA, 6.5."""

from __future__ import annotations

import numpy as np

from ..typing import Array


def factored(M: Array) -> tuple[Array, Array]:
    """L, unit lower triangular, and 1/D with M = L' D L, from the last row up; Featherstone, RBDA (2008), 6.5.

    Leaves come after their ancestors in M, so eliminating from the end keeps the zeros between branches zero, and a
    trace drops them. Only the lower triangle is read. Unrolled: no pivots, M positive definite.
    """
    n = len(M)
    H, L, inverse = M.copy(), M.copy(), M.diagonal().copy()
    for k in reversed(range(n)):
        inverse[k] = 1.0 / H[k, k]
        for i in range(k):
            L[k, i] = H[k, i] * inverse[k]
        for i in range(k):
            for j in range(i + 1):
                H[i, j] = H[i, j] - L[k, i] * H[k, j]
    return L, inverse


def solved(L: Array, inverse: Array, b: Array) -> Array:
    """x with L' D L x = b."""
    return raised(L, inverse * lowered(L, b))


def lowered(L: Array, b: Array) -> Array:
    """z with L' z = b."""
    z = b.astype(np.result_type(L, b))
    for k in reversed(range(len(z))):
        for i in range(k):
            z[i] = z[i] - L[k, i] * z[k]
    return z


def raised(L: Array, b: Array) -> Array:
    """x with L x = b."""
    x = b.astype(np.result_type(L, b))
    for k in range(len(x)):
        for i in range(k):
            x[k] = x[k] - L[k, i] * x[i]
    return x


def inverse_factor(L: Array) -> Array:
    """W with W L = 1: unit lower triangular, with the zeros of L, and M⁻¹ = W D⁻¹ W'."""
    return np.array([raised(L, e) for e in np.eye(len(L)).astype(object)]).reshape(L.shape).T


def symmetric_product(W: Array, inverse: Array) -> Array:
    """W D⁻¹ W', each pair of mirror images computed once."""
    n = len(W)
    scaled, product = W * inverse, W.copy()
    for i in range(n):
        for j in range(i + 1):
            product[i, j] = product[j, i] = scaled[i] @ W[j]
    return product


def widened(M: Array, diagonal: Array) -> Array:
    """M with more on its diagonal."""
    found = M.astype(object)
    for i, x in enumerate(diagonal):
        found[i, i] = found[i, i] + x
    return found
