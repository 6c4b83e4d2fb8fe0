"""Closed loops: projection of states onto the constraints, reachable rows, and closing configurations.

A q̇ = 0 are the constraints, M is the mass matrix, S = A M⁻¹ A', and g the gaps (closure errors) of the loops. Projection makes
the smallest changes in the kinetic metric:

    (1)  q ← q ⊕ -M⁻¹A'S⁻¹ g(q)
    (2)  dq ← dq - M⁻¹A'S⁻¹ A dq

With M = L'DL and Y = L⁻ᵀA', S = Y'D⁻¹Y and M⁻¹A' = L⁻¹D⁻¹Y. (1) is applied twice with the matrices of the first q (simplified
Newton method): the gaps after an integration step are small, and each iteration reduces them quadratically. (2) is exact at
the resulting q. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration, section IV.4, projection methods. The
metric M makes the projection independent of coordinates.
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


_ADDED_COSINE = 1e-30
"""Added to 1 + cos x, so that there is no division by zero for x = π; negligible for any other angle."""


@dataclass(frozen=True)
class LoopRows:
    """Independent rows of A that belong to closures and so have a gap; the projection brings these gaps to zero."""

    constraints: tuple[Constraint, ...]
    """All constraints, in the order of the rows of A."""
    independent: tuple[int, ...]
    """Numbers of the rows of A that are independent of earlier rows."""

    @property
    def indices(self) -> tuple[list[int], list[int]]:
        """Indices of these rows in :func:`small_gaps`, and in A."""
        rows_of_gaps = np.flatnonzero(with_gaps(self.constraints))
        gap_indices = np.flatnonzero(np.isin(rows_of_gaps, self.independent))
        return gap_indices.tolist(), rows_of_gaps[gap_indices].tolist()

    def gaps(self, model: Model, q: Array) -> Array:
        """Gaps of the loops in the independent rows [rad, m]."""
        gap_indices, _ = self.indices
        return small_gaps(model, q, self.constraints)[gap_indices]

    def jacobian(self, model: Model, q: Array) -> Array:
        """Rows of A that belong to the gaps; (gaps, nv)."""
        _, rows = self.indices
        return constraint_jacobian(model, q, self.constraints)[rows]


def project_state(
    model: Model, q: Array, dq: Array, constraints: Sequence[Constraint], independent: Sequence[int]
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """State on the constraints, from a state near them, with the corrected gaps and rates.

    The result is q (nq,) and dq (nv,) on the constraints; the gaps before (rows of closures,); the rates A dq before
    (independent rows,); the gaps after (rows of closures,); and the pivots of A M⁻¹ A' (independent rows,). ``independent``
    holds the numbers of the rows of A that are independent of earlier rows. The factors are M = L'DL and S = R'ER.
    """
    gap_indices, rows = LoopRows(tuple(constraints), tuple(independent)).indices
    gaps_before = small_gaps(model, q, constraints)
    gaps = gaps_before
    if gap_indices:
        L, D_inverse = ldl_factors(mass_matrix(model, q))
        A = constraint_jacobian(model, q, tuple(constraints))
        Y = solve_transposed(L, A[rows].T)
        R, E_inverse = ldl_factors(Y.T @ (D_inverse[:, None] * Y))
        for _ in range(ROUNDS):
            multipliers = solve_ldl(R, E_inverse, gaps[gap_indices])
            q = add(model, q, -solve_triangular(L, D_inverse * (Y @ multipliers)))  # (1)
            gaps = small_gaps(model, q, constraints)
    q = normalise_quaternions(model, q)
    L, D_inverse = ldl_factors(mass_matrix(model, q))
    A = constraint_jacobian(model, q, tuple(constraints))[list(independent)]
    Y = solve_transposed(L, A.T)
    R, E_inverse = ldl_factors(Y.T @ (D_inverse[:, None] * Y))
    rates_before = A @ dq
    multipliers = solve_ldl(R, E_inverse, rates_before)
    dq = dq - solve_triangular(L, D_inverse * (Y @ multipliers))  # (2)
    return q, dq, gaps_before, rates_before, gaps, 1.0 / E_inverse


def small_gaps(model: Model, q: Array, constraints: Sequence[Constraint]) -> Array:
    """Gaps of the closures' rows [rad, m], accurate to third order; zero exactly where :func:`closure_gaps` is zero.

    An angle is replaced by twice the sine of its half.
    """
    closures = [constraint for constraint in constraints if isinstance(constraint, Closure)]
    if not closures:
        return zeros(0)
    gaps = []
    for closure, T in zip(closures, closure_poses(model, q, tuple(closures)), strict=True):
        gaps.append(_small_gap(closure.rows, T[:3, :3], T[:3, 3]))
    return np.concatenate(gaps)


def _small_gap(rows: tuple[int, ...], R: Array, p: Array) -> Array:
    """Gap of one closure with T_cb = (R, p), in its rows.

    The angular part is the rotation axis times sin x, from which 2 sin(x/2) follows. x is the angle of R for three angular
    rows, the angle between the free axes of {b} and {c} for two, and the angle about the row's axis for one.
    """
    angular_rows = sorted({0, 1, 2}.intersection(rows))
    if not angular_rows:
        return p[[row - 3 for row in rows]]
    sine_vector = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    cosine = 0.5 * (np.trace(R) - 1.0)
    if len(angular_rows) == 2:
        k = 3 - sum(angular_rows)  # axis of the free rotation: the rows 0, 1, 2 add up to 3
        i, j = (k + 1) % 3, (k + 2) % 3
        sine_vector[i] = -R[j, k]  # e_k × R e_k
        sine_vector[j] = R[i, k]
        cosine = R[k, k]
    elif len(angular_rows) == 1:
        (k,) = angular_rows  # axis of the fixed rotation
        i, j = (k + 1) % 3, (k + 2) % 3
        cosine = 0.5 * (R[i, i] + R[j, j])
    # 2 sin(x/2) = sin x / cos(x/2) = sin x √(2 / (1 + cos x))
    half_sine_vector = sine_vector * np.sqrt(2.0 / (1.0 + cosine + _ADDED_COSINE))
    return np.concatenate([half_sine_vector, p])[list(rows)]


ITERATIONS = 100
"""Maximum number of Levenberg–Marquardt iterations. Convergence is quadratic near a solution; distant starts need more."""
HALVINGS = 12
"""Number of lengths that are tried for a step, each half of the previous one."""


def closure_gaps(constraints: Sequence[Constraint], T: Array) -> Array:
    """Gaps of the closures' rows [rad, m], from T_cb of each; (..., n, 4, 4) → (..., rows)."""
    closures = [constraint for constraint in constraints if isinstance(constraint, Closure)]
    gaps = []
    for n, closure in enumerate(closures):
        R, p = T[..., n, :3, :3], T[..., n, :3, 3]
        gaps.append(_gap(closure.rows, R, p))
    no_gaps = np.zeros((*T.shape[:-3], 0))  # shape of the result if there is no closure
    return np.concatenate([no_gaps, *gaps], axis=-1)


def _gap(rows: tuple[int, ...], R: Array, p: Array) -> Array:
    """Gap of one closure with T_cb = (R, p), (..., 3, 3) and (..., 3), in its rows; accurate for any size."""
    # A gap is zero if {b} coincides with {c} in the closure's rows. Near this state its rate equals the same rows of V_cb.
    # Linear rows of the gap are the rows of p. Three angular rows are the rows of log R. Two angular rows are the smallest
    # rotation that takes the third axis of {c} to the third axis of {b}, since the rotation about this axis is free. One
    # angular row is the angle of a planar motion.
    angular_rows = sorted({0, 1, 2}.intersection(rows))
    if len(angular_rows) == 3:
        rotation_vector = so3.log(R)
    elif len(angular_rows) == 2:
        free_axis = 3 - sum(angular_rows)  # the rows 0, 1, 2 add up to 3
        rotation_vector = _rotation_of_axis(R, free_axis)
    elif len(angular_rows) == 1:
        (i,) = angular_rows  # axis of the fixed rotation
        j, k = (i + 1) % 3, (i + 2) % 3
        rotation_vector = np.zeros_like(p)
        double_sine = R[..., k, j] - R[..., j, k]
        double_cosine = R[..., j, j] + R[..., k, k]
        rotation_vector[..., i] = np.arctan2(double_sine, double_cosine)
    else:
        rotation_vector = np.zeros_like(p)
    return np.concatenate([rotation_vector, p], axis=-1)[..., list(rows)]


def _rotation_of_axis(R: Array, k: int) -> Array:
    """Smallest rotation vector that takes axis k of {c} to axis k of {b}; if they are opposite, one of the rotations by π."""
    axis_c = np.eye(3)[k]
    axis_b = R[..., :, k]
    sine_vector = np.cross(axis_c, axis_b)
    sine = np.linalg.norm(sine_vector, axis=-1)
    cosine = axis_b[..., k]
    angle = np.arctan2(sine, cosine)
    is_opposite = (sine < TOLERANCE) & (cosine < 0)
    angle_per_sine = np.divide(angle, sine, out=np.ones_like(sine), where=sine > TOLERANCE)
    half_turn = np.pi * np.eye(3)[(k + 1) % 3]  # any axis at right angles to axis k
    return np.where(is_opposite[..., None], half_turn, angle_per_sine[..., None] * sine_vector)


@dataclass(frozen=True, eq=False)
class LoopProblem:
    """Gaps of closed loops and their derivatives at a batch of configurations, with the scales of rows."""

    gaps: Callable[[Array], Array]
    """Gaps (n, rows) of configurations (n, nq) [rad, m]."""
    rows_and_mass: Callable[[Array], tuple[Array, Array]]
    """Rows A (n, rows, nv) of the gaps, and M (n, nv, nv), at configurations (n, nq)."""
    add: Callable[[Array, Array], Array]
    """q ⊕ dv of configurations (n, nq) and displacements (n, nv)."""
    sizes: Array
    """Usual size of each row of A; (rows,)."""
    units: Array
    """Size [rad or m] of each gap that counts as 1 in comparisons with the tolerance; (rows,)."""

    def largest_gaps(self, gaps: Array) -> Array:
        """Largest gap of each configuration, divided by the unit of its row; (n,)."""
        return np.asarray(np.abs(gaps / self.units).max(axis=-1, initial=0.0))

    def gap_norms(self, gaps: Array) -> Array:
        """Norm of the gaps of each configuration, divided by the sizes of their rows; (n,)."""
        return np.asarray(np.linalg.norm(gaps / self.sizes, axis=-1))


def close_loops(q: Array, problem: LoopProblem, tolerance: float) -> tuple[Array, Array]:
    """Configurations near q (n, nq) without gaps, and the largest remaining gap of each (n,), in units of its row.

    Levenberg–Marquardt steps, smallest in the kinetic metric, with the squared gap as damping parameter. Fan and Yuan,
    Computing 74, 2005: quadratic convergence also at singular solutions.
    """
    q = q.copy()  # its rows are replaced below
    gaps = problem.gaps(q)
    largest_gap = problem.largest_gaps(gaps)
    is_open = largest_gap > tolerance
    for _ in range(ITERATIONS):
        open_rows = np.flatnonzero(is_open)
        if not open_rows.size:
            break
        A, M = problem.rows_and_mass(q[open_rows])
        damping = np.minimum(1.0, largest_gap[open_rows] ** 2)
        step = _damped_step(gaps[open_rows], A, M, problem.sizes, damping)
        q_new, gaps_new, has_improved = _take_step(q[open_rows], gaps[open_rows], step, problem)
        q[open_rows] = q_new
        gaps[open_rows] = gaps_new
        largest_gap[open_rows] = problem.largest_gaps(gaps_new)
        is_open[open_rows] = has_improved & (largest_gap[open_rows] > tolerance)  # no shorter step helps: give up
    return q, largest_gap


def _take_step(q: Array, gaps: Array, step: Array, problem: LoopProblem) -> tuple[Array, Array, Array]:
    """q and gaps after the step, and the mask of configurations with smaller gaps; the others are unchanged.

    The step of a configuration is halved until it reduces the gaps.
    """
    step_factor = np.ones(len(q))
    old_norms = problem.gap_norms(gaps)
    for _ in range(HALVINGS):
        q_new = problem.add(q, step_factor[:, None] * step)
        gaps_new = problem.gaps(q_new)
        has_improved = problem.gap_norms(gaps_new) < old_norms
        if has_improved.all():
            break
        step_factor = np.where(has_improved, step_factor, 0.5 * step_factor)
    takes_step = has_improved[:, None]
    return np.where(takes_step, q_new, q), np.where(takes_step, gaps_new, gaps), has_improved


def _damped_step(gaps: Array, A: Array, M: Array, sizes: Array, damping: Array) -> Array:
    """Smallest step dv in the kinetic metric that closes the gaps, up to damping; (n, nv)."""
    projector = ConstraintProjector.from_rows(A, M, sizes)
    factors = 1.0 / (1.0 + damping[:, None] * projector.inverse_sigma**2)  # σ²/(σ² + damping)
    n, _, nv = A.shape
    return projector.nearest(np.zeros((n, nv)), gaps, factors)
