"""Derivatives of constrained inverse dynamics along motions that keep to the constraints. Floats, batches.

With the independent velocities u, which are those of the motors, dq = (d, u) and A = (A_d, A_u):

    (1)  dq = N u,  N = (-A_d⁻¹ A_u, 1)                             A dq = 0
    (2)  A_d q̈_d = -(A_u q̈_u + b)                                  A q̈ + b = 0, MR section 8.7
    (3)  A_d' λ = -f_d,   τ = f_u + A_u' λ                           f = M q̈ + h, no torque at the other joints

and along a direction of the independent coordinates, ∂ at constant u and q̈_u,

    (4)  A_d ∂dq_d = -∂A dq                                          ∂A = (dA/dq) N
    (5)  A_d ∂q̈_d = -(∂A q̈ + ∂b),   ∂b = (db/dq) N + (db/ddq) ∂dq
    (6)  ∂f = (df/dq) N + (df/ddq) ∂dq + M ∂q̈
    (7)  A_d' ∂λ = -(∂f_d + ∂A_d' λ),   ∂τ = ∂f_u + ∂A_u' λ + A_u' ∂λ

where d/ddq stands for the derivative by dq. By u, N takes the place of ∂dq and ∂A is zero.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..typing import Array
from .constrained import ConstrainedDerivatives


class Slopes(NamedTuple):
    """What the open robot and its constraints say at a state, and how it changes; any leading batch shape."""

    A: Array
    """(k, nv), independent rows alone."""
    A_by_q: Array
    """(k, nv, nv)."""
    b_by_q: Array
    """(k, nv)."""
    b_by_dq: Array
    """(k, nv)."""
    f: Array
    """(nv,)."""
    f_by_q: Array
    """(nv, nv)."""
    f_by_dq: Array
    """(nv, nv)."""
    M: Array
    """(nv, nv)."""


def constrained_derivatives(at: Slopes, dq: Array, ddq: Array, driven: Array) -> ConstrainedDerivatives:
    """∂τ of the joints ``driven`` (nv,), as many as there are degrees of freedom, by their q, dq and ddq."""
    u, d = driven, ~driven
    A_d, A_u = at.A[..., d], at.A[..., u]
    N = _whole(-np.linalg.solve(A_d, A_u), driven, np.eye(int(u.sum())))  # (1)
    lam = -np.linalg.solve(_t(A_d), at.f[..., d, None])[..., 0]  # (3)
    dA = np.einsum("...ijk,...kl->...ijl", at.A_by_q, N)
    none = np.zeros((int(u.sum()),) * 2)

    def torques(df: Array, dA: Array | float) -> Array:
        pressed = np.einsum("...ijl,...i->...jl", dA, lam) if isinstance(dA, np.ndarray) else np.zeros_like(df)
        dlam = -np.linalg.solve(_t(A_d), df[..., d, :] + pressed[..., d, :])  # (7)
        return np.asarray(df[..., u, :] + pressed[..., u, :] + _t(A_u) @ dlam)

    dv = _whole(-np.linalg.solve(A_d, np.einsum("...ijl,...j->...il", dA, dq)), driven, none)  # (4)
    db = at.b_by_q @ N + at.b_by_dq @ dv
    da = _whole(-np.linalg.solve(A_d, np.einsum("...ijl,...j->...il", dA, ddq) + db), driven, none)  # (5)
    by_q = torques(at.f_by_q @ N + at.f_by_dq @ dv + at.M @ da, dA)  # (6)
    da = _whole(-np.linalg.solve(A_d, at.b_by_dq @ N), driven, none)
    by_dq = torques(at.f_by_dq @ N + at.M @ da, 0.0)
    return ConstrainedDerivatives(by_q, by_dq, _t(N) @ at.M @ N)


def _whole(others: Array, driven: Array, own: Array) -> Array:
    """Columns of all velocities from those of the others and of the driven ones; (..., nv, m)."""
    found = np.zeros((*others.shape[:-2], len(driven), own.shape[-1]))
    found[..., ~driven, :], found[..., driven, :] = others, own
    return found


def _t(X: Array) -> Array:
    return np.swapaxes(X, -1, -2)
