"""Closed loops: projection of states onto the constraints, reachable rows, and closing configurations.

Projection: with M = L'DL, Y = L⁻ᵀA' and S = Y'D⁻¹Y = A M⁻¹ A', the smallest changes in the kinetic metric are

    (1)  q ← q ⊕ -M⁻¹A'S⁻¹ g(q),  g the gaps (closure errors) of the loops
    (2)  dq ← dq - M⁻¹A'S⁻¹ A dq

(1) is applied twice with the matrices of the first q (simplified Newton method): the gaps after an integration step are
small, and each iteration reduces them quadratically. (2) is exact at the resulting q. Source: Hairer, Lubich and Wanner,
Geometric Numerical Integration, section IV.4, projection methods. The metric M makes the projection independent of coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.typing import Array
from ..lie import so3
from ..model.model import Model
from .constraint_projector import TOLERANCE, ConstraintProjector
from .constraints import Closure, Constraint, closure_poses, constraint_jacobian, with_gaps
from .kinematics import add, normalise_quaternions
from .mass_matrix import ldl_factors, mass_matrix, solve_ldl, solve_transposed, solve_triangular
from .recursion import zeros

ROUNDS = 2
"""Iterations of (1): they reduce a gap of 1e-5 of the robot's size to 1e-10, then to rounding error."""


_MIN_COSINE_SUM = 1e-30
"""Avoids a division by zero for a rotation by π, whose sine is zero; negligible for any other angle."""


@dataclass(frozen=True)
class LoopRows:
    """Independent rows of closures that have a gap; the projection brings these gaps to zero."""

    constraints: tuple[Constraint, ...]
    independent: tuple[int, ...]
    """Numbers of the rows of A that are independent of earlier rows."""

    @property
    def indices(self) -> tuple[list[int], list[int]]:
        """Indices of these rows in :func:`small_gaps`, and in A."""
        rows = np.flatnonzero(with_gaps(self.constraints))
        gaps = np.flatnonzero(np.isin(rows, self.independent))
        return gaps.tolist(), rows[gaps].tolist()

    def gaps(self, model: Model, q: Array) -> Array:
        """Gaps of the loops, rad and m."""
        return small_gaps(model, q, self.constraints)[self.indices[0]]

    def jacobian(self, model: Model, q: Array) -> Array:
        """Rows of A that belong to these gaps."""
        return constraint_jacobian(model, q, self.constraints)[self.indices[1]]


def project_state(
    model: Model, q: Array, dq: Array, constraints: Sequence[Constraint], independent: Sequence[int]
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """q and dq on the constraints, the gaps and the rates A dq before, the gaps after, and the pivots of A M⁻¹ A'.

    (nq,), (nv,), (rows of closures,), (independent rows,), (rows of closures,), (independent rows,). ``independent`` holds the
    numbers of the rows of A that are independent of earlier rows.
    """
    gaps, rows = LoopRows(tuple(constraints), tuple(independent)).indices
    before = after = small_gaps(model, q, constraints)
    if gaps:
        (L, D), A = ldl_factors(mass_matrix(model, q)), constraint_jacobian(model, q, tuple(constraints))
        Y = solve_transposed(L, A[rows].T)
        R, E = ldl_factors(Y.T @ (D[:, None] * Y))
        for _ in range(ROUNDS):
            q = add(model, q, -solve_triangular(L, D * (Y @ solve_ldl(R, E, after[gaps]))))  # (1)
            after = small_gaps(model, q, constraints)
    q = normalise_quaternions(model, q)
    (L, D), A = ldl_factors(mass_matrix(model, q)), constraint_jacobian(model, q, tuple(constraints))[list(independent)]
    Y = solve_transposed(L, A.T)
    R, E = ldl_factors(Y.T @ (D[:, None] * Y))
    rates = A @ dq
    return q, dq - solve_triangular(L, D * (Y @ solve_ldl(R, E, rates))), before, rates, after, 1.0 / E  # (2)


def small_gaps(model: Model, q: Array, constraints: Sequence[Constraint]) -> Array:
    """Gaps of the closures' rows [rad, m], accurate to third order; zero exactly where :func:`closure_gaps` is zero.

    An angle is replaced by twice the sine of its half.
    """
    closures = [c for c in constraints if isinstance(c, Closure)]
    if not closures:
        return zeros(0)
    T = closure_poses(model, q, tuple(closures))
    return np.concatenate([_small_gap(c.rows, T[n, :3, :3], T[n, :3, 3]) for n, c in enumerate(closures)])


def _small_gap(rows: tuple[int, ...], R: Array, p: Array) -> Array:
    turning = sorted({0, 1, 2}.intersection(rows))
    if not turning:
        return p[[row - 3 for row in rows]]
    turn, cosine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]), 0.5 * (np.trace(R) - 1.0)
    k = 3 - sum(turning) if len(turning) == 2 else turning[0]
    i, j = (k + 1) % 3, (k + 2) % 3
    if len(turning) == 2:
        turn[i], turn[j], cosine = -R[j, k], R[i, k], R[k, k]  # e_k × R e_k
    elif len(turning) == 1:
        cosine = 0.5 * (R[i, i] + R[j, j])
    # sin x = 2 sin(x/2) cos(x/2), and 1 + cos x = 2 cos²(x/2)
    turn = turn * np.sqrt(2.0 / (1.0 + cosine + _MIN_COSINE_SUM))
    return np.concatenate([turn, p])[list(rows)]


# A gap is zero if {b} coincides with {c} in the closure's rows; near there its rate is that of the same rows of V_cb. Linear
# rows are those of p. Three angular rows are those of log R. Two are the smallest rotation that takes the third axis of {b} to
# that of {c}, for any free rotation about it. One is the angle of a planar motion.

ITERATIONS = 100
"""Maximum number of Levenberg–Marquardt iterations. Convergence is quadratic near a solution; distant starts need more."""
HALVINGS = 12
"""Number of lengths that are tried for a step, each half of the last."""


def closure_gaps(constraints: Sequence[Constraint], T: Array) -> Array:
    """Gaps of the closures' rows [rad, m], from T_cb of each; (..., n, 4, 4) → (..., rows)."""
    closures = [c for c in constraints if isinstance(c, Closure)]
    gaps = [_gap(closure.rows, T[..., n, :3, :3], T[..., n, :3, 3]) for n, closure in enumerate(closures)]
    return np.concatenate([np.zeros((*T.shape[:-3], 0)), *gaps], axis=-1)


def _gap(rows: tuple[int, ...], R: Array, p: Array) -> Array:
    turning = sorted({0, 1, 2}.intersection(rows))
    if len(turning) == 3:
        turn = so3.log(R)
    elif len(turning) == 2:
        turn = _rotation_of_axis(R, 3 - sum(turning))
    elif len(turning) == 1:
        i, j, k = np.roll(range(3), -turning[0])
        turn = np.zeros_like(p)
        turn[..., i] = np.arctan2(R[..., k, j] - R[..., j, k], R[..., j, j] + R[..., k, k])
    else:
        turn = np.zeros_like(p)
    return np.concatenate([turn, p], axis=-1)[..., list(rows)]


def _rotation_of_axis(R: Array, k: int) -> Array:
    """Smallest rotation vector that takes axis k of {c} to axis k of {b}; if they are opposite, one of those by π."""
    axis = R[..., :, k]
    across = np.cross(np.eye(3)[k], axis)
    sine, cosine = np.linalg.norm(across, axis=-1), axis[..., k]
    angle = np.arctan2(sine, cosine)
    opposite = (sine < TOLERANCE) & (cosine < 0)
    scale = np.divide(angle, sine, out=np.ones_like(sine), where=sine > TOLERANCE)
    return np.where(opposite[..., None], np.pi * np.eye(3)[(k + 1) % 3], scale[..., None] * across)


@dataclass(frozen=True, eq=False)
class LoopProblem:
    """Gaps of closed loops and their derivatives at a batch of configurations, with the scales of rows."""

    gaps: Callable[[Array], Array]
    """Gaps (n, rows) of configurations (n, nq) [rad, m]."""
    slopes: Callable[[Array], tuple[Array, Array]]
    """A (n, rows, nv) of the gaps, and M (n, nv, nv)."""
    add: Callable[[Array, Array], Array]
    """q ⊕ dv."""
    sizes: Array
    """Usual size of each row of A; (rows,)."""
    units: Array
    """Unit of each gap; (rows,)."""

    def largest_gaps(self, gaps: Array) -> Array:
        """Largest gap of each configuration, divided by the unit of its row; (n,)."""
        return np.asarray(np.abs(gaps / self.units).max(axis=-1, initial=0.0))

    def gap_norms(self, gaps: Array) -> Array:
        """Norm of the gaps of each configuration, divided by the sizes of their rows; (n,)."""
        return np.asarray(np.linalg.norm(gaps / self.sizes, axis=-1))


def close_loops(q: Array, problem: LoopProblem, tolerance: float) -> tuple[Array, Array]:
    """Configurations near q (n, nq) without gaps, and the largest remaining gap of each (n,), divided by the unit of its row.

    Levenberg–Marquardt steps, smallest in the kinetic metric, with the squared gap as damping parameter. Fan and Yuan,
    Computing 74, 2005: quadratic convergence also at singular solutions.
    """
    q, gaps = q.copy(), problem.gaps(q)
    largest_gap = problem.largest_gaps(gaps)
    is_open = largest_gap > tolerance
    for _ in range(ITERATIONS):
        n = np.flatnonzero(is_open)
        if not n.size:
            break
        A, M = problem.slopes(q[n])
        step = _step(gaps[n], A, M, problem.sizes, damping=np.minimum(1.0, largest_gap[n] ** 2))
        q[n], gaps[n], improved = _shorten_step(q[n], gaps[n], step, problem)
        largest_gap[n] = problem.largest_gaps(gaps[n])
        is_open[n] = improved & (largest_gap[n] > tolerance)
    return q, largest_gap


def _shorten_step(q: Array, gaps: Array, step: Array, problem: LoopProblem) -> tuple[Array, Array, Array]:
    """q and gaps after the step, halved while it does not reduce the gaps, and where one does; elsewhere q is unchanged."""
    length = np.ones(len(q))
    norm = problem.gap_norms(gaps)
    for _ in range(HALVINGS):
        q_new = problem.add(q, length[:, None] * step)
        gaps_new = problem.gaps(q_new)
        improved = problem.gap_norms(gaps_new) < norm
        if improved.all():
            break
        length = np.where(improved, length, 0.5 * length)
    return np.where(improved[:, None], q_new, q), np.where(improved[:, None], gaps_new, gaps), improved


def _step(gap: Array, A: Array, M: Array, sizes: Array, damping: Array) -> Array:
    """Smallest step dv in the kinetic metric that closes the gaps, up to damping; (n, nv)."""
    projector = ConstraintProjector.from_rows(A, M, sizes)
    damped = 1.0 / (1.0 + damping[:, None] * projector.inverse_sigma**2)  # σ²/(σ² + damping)
    return projector.nearest(np.zeros(A.shape[:1] + A.shape[2:]), gap, damped)
