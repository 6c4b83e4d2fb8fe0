"""How far closures are from closed, and the configurations at which they are. Floats, batches.

A gap is zero where {b} lies on {c} in the closure's rows, and near there its rate is that of the same rows of V_cb:
moving rows are those of p; three turning rows those of log R; two are the smallest turn that takes the third axis of {b}
to that of {c}, so that the free turning may be any; one is the angle of a plane motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..lie import so3
from ..typing import Array
from .constraints import Closure, Constraint
from .weighted_svd import TOLERANCE, Reach

ITERATIONS = 100
"""Of Levenberg and Marquardt's method. Near a solution it doubles its digits each time; a hundred is for far starts."""


def closure_gaps(constraints: Sequence[Constraint], T: Array) -> Array:
    """The gaps of the closures' rows, rad and m, from T_cb of each; (..., n, 4, 4) → (..., rows)."""
    closures = [c for c in constraints if isinstance(c, Closure)]
    gaps = [_gap(closure.rows, T[..., n, :3, :3], T[..., n, :3, 3]) for n, closure in enumerate(closures)]
    return np.concatenate([np.zeros((*T.shape[:-3], 0)), *gaps], axis=-1)


def _gap(rows: tuple[int, ...], R: Array, p: Array) -> Array:
    turning = [k for k in range(3) if k in rows]
    if len(turning) == 3:
        turn = so3.log(R)
    elif len(turning) == 2:
        turn = _between_axes(R, 3 - sum(turning))
    elif len(turning) == 1:
        i, j, k = ((turning[0] + n) % 3 for n in range(3))
        turn = np.zeros_like(p)
        turn[..., i] = np.arctan2(R[..., k, j] - R[..., j, k], R[..., j, j] + R[..., k, k])
    else:
        turn = np.zeros_like(p)
    return np.concatenate([turn, p], axis=-1)[..., list(rows)]


def _between_axes(R: Array, k: int) -> Array:
    """The rotation vector, across axis k of {c}, that takes it to axis k of {b}; any of those by π where they are opposite."""
    there = R[..., :, k]
    across = np.cross(np.eye(3)[k], there)
    sine, cosine = np.linalg.norm(across, axis=-1), there[..., k]
    angle = np.arctan2(sine, cosine)
    opposite = (sine < TOLERANCE) & (cosine < 0)
    scale = np.divide(angle, sine, out=np.ones_like(sine), where=sine > TOLERANCE)
    return np.where(opposite[..., None], np.pi * np.eye(3)[(k + 1) % 3], scale[..., None] * across)


def settled(
    q: Array,
    gaps: Callable[[Array], Array],
    slopes: Callable[[Array], tuple[Array, Array]],
    add: Callable[[Array, Array], Array],
    sizes: Array,
    units: Array,
    tolerance: float,
) -> tuple[Array, Array]:
    """Configurations near q (n, nq) without gaps, and the largest gap left at each (n,), over its row's unit.

    Steps are the least in the kinetic metric, Levenberg and Marquardt's with the square of the gap for a parameter, halved
    while they do not help: Fan and Yuan, Computing 74, 2005, quadratic also where the solution is singular.
    ``slopes`` gives A of the gaps and M.
    """
    q, gap = q.copy(), gaps(q)
    left = np.abs(gap / units).max(axis=-1, initial=0.0)
    going = left > tolerance
    for _ in range(ITERATIONS):
        n = np.flatnonzero(going)
        if not n.size:
            break
        step = _step(gap[n], *slopes(q[n]), sizes, np.minimum(1.0, left[n] ** 2))
        length = np.ones(n.size)
        before = np.linalg.norm(gap[n] / sizes, axis=-1)
        for _ in range(12):
            tried = add(q[n], length[:, None] * step)
            new = gaps(tried)
            better = np.linalg.norm(new / sizes, axis=-1) < before
            if better.all():
                break
            length = np.where(better, length, 0.5 * length)
        q[n[better]], gap[n[better]] = tried[better], new[better]
        left[n] = np.abs(gap[n] / units).max(axis=-1)
        going[n] = better & (left[n] > tolerance)
    return q, left


def _step(gap: Array, A: Array, M: Array, sizes: Array, damping: Array) -> Array:
    """The dv, least in the kinetic metric, that closes the gaps as far as damping lets it; (n, nv)."""
    reach = Reach.of(A, M, sizes)
    damped = 1.0 / (1.0 + damping[:, None] * reach.inverse_sigma**2)  # σ²/(σ² + damping)
    return reach.nearest(np.zeros(A.shape[:1] + A.shape[2:]), gap, damped)
