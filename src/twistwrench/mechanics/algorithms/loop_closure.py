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

from ...core.errors import SingularMassMatrixError
from ...core.typing import Array
from ..lie import so3
from ..model.model import Model
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
        rows = np.flatnonzero(with_gaps(self.constraints)).tolist()
        gaps = [n for n, k in enumerate(rows) if k in self.independent]
        return gaps, [rows[n] for n in gaps]

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
    turning = [k for k in range(3) if k in rows]
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


# ── Projection onto constraints with singular A M⁻¹ A'. Floats, batches

# With M = L L' and W the usual size of each row, the singular values of B = W⁻¹ A L⁻ᵀ are dimensionless: 1 for a row of usual
# mobility. They do not depend on the joint coordinates, so one threshold separates significant from zero values.

TOLERANCE = 1.5e-8
"""Singular values below it count as zero. Coordinates accurate to the rounding of doubles, ε, may be √ε away from a singular
configuration, and singular values grow with that distance."""
MIN_PIVOT = 1e-6
"""Smallest pivot of B B' for elimination, whose error is then about ε/MIN_PIVOT = 1e-10. Below it, the singular values of B are
used instead; those of B B' are their squares."""
MIN_PIVOT_SINGLE = 1e-2
"""The same threshold for float32."""
MIN_SIZE_RATIO = 1e-9
"""Negligible rad relative to m, and m relative to rad: lever arms below a nanometre, or radii above a gigametre."""

MIN_INDEPENDENT_PART = 1e-6
"""Distance of a row from the span of others, as a fraction of its usual size. A row that is nearer at every sampled
configuration is dependent: samples are consistent to 1e-12 only, and redundancy of special geometry holds everywhere."""


@dataclass(frozen=True, eq=False)
class ConstraintProjector:
    """B = W⁻¹ A L⁻ᵀ = U σ V', reduced to its significant singular values; any leading batch shape.

    In the coordinates y = L'q̈ the rows act as B y, and the norm of y is that of the kinetic metric. V spans the constrained
    directions, its complement the free ones, and q̈ is computed without a division by σ².
    """

    sizes: Array
    """Diagonal of W; (k,)."""
    L: Array
    """Cholesky factor of M; (..., nv, nv)."""
    U: Array
    """Left singular vectors; (..., k, m). Columns beyond the rank are zero, likewise in V and 1/σ."""
    V: Array
    """Right singular vectors; (..., nv, m)."""
    inverse_sigma: Array
    """1/σ; (..., m)."""

    @classmethod
    def from_rows(cls, A: Array, M: Array, sizes: Array, max_rank: int | None = None) -> ConstraintProjector:
        """A (..., k, nv), M (..., nv, nv), sizes (k,); ``max_rank`` if further directions are known to be rounding errors."""
        L = _factor(M)
        B = _mass_weighted(A, L) / sizes[:, None]
        batch, (k, nv) = B.shape[:-2], B.shape[-2:]
        if k == 0 or nv == 0:
            return cls(sizes, L, np.zeros((*batch, k, 0)), np.zeros((*batch, nv, 0)), np.zeros((*batch, 0)))
        U, sigma, Vt = np.linalg.svd(B, full_matrices=False)
        significant = sigma > TOLERANCE
        if max_rank is not None:
            significant[..., max_rank:] = False
        inverse = np.where(significant, 1.0 / np.where(significant, sigma, 1.0), 0.0)
        V = np.swapaxes(Vt, -1, -2)
        return cls(sizes, L, U * significant[..., None, :], V * significant[..., None, :], inverse)

    @property
    def rank(self) -> Array:
        """Number of independent directions; (...)."""
        return np.count_nonzero(self.inverse_sigma, axis=-1)

    @property
    def directions(self) -> Array:
        """Orthonormal columns: first a basis of the range of A, then one of its complement; (..., k, k)."""
        basis = self.sizes[:, None] * self.U
        if basis.shape[-1] == 0:
            return np.broadcast_to(np.eye(len(self.sizes)), (*basis.shape[:-1], len(self.sizes)))
        return np.linalg.svd(basis / self.sizes.max(), full_matrices=True)[0]

    @property
    def lost(self) -> Array:
        """Orthonormal rows that span the complement of the range of A, zero-padded to the largest number; (..., n, k)."""
        k, rank = len(self.sizes), np.asarray(self.rank)[..., None]
        index = rank + np.arange(k - rank.min(initial=k))
        columns = np.take_along_axis(self.directions, np.minimum(index, k - 1)[..., None, :], axis=-1)
        return np.asarray(np.swapaxes(columns * (index < k)[..., None, :], -1, -2))

    @property
    def range(self) -> Array:
        """Orthogonal projector on the range of A, in the units of its rows; (..., k, k)."""
        Q = self.directions * (np.arange(len(self.sizes)) < self.rank[..., None])[..., None, :]
        return np.asarray(Q @ np.swapaxes(Q, -1, -2))

    @property
    def pseudoinverse(self) -> Array:
        """Moore–Penrose inverse of A M⁻¹ A', in the units of its rows; (..., k, k)."""
        half = self.range @ (self.U * self.inverse_sigma[..., None, :] / self.sizes[:, None])
        return np.asarray(half @ np.swapaxes(half, -1, -2))

    @property
    def projector(self) -> Array:
        """1 - A'(A M⁻¹ A')⁺ A M⁻¹ = L (1 - V V') L⁻¹; (..., nv, nv)."""
        free = np.eye(self.V.shape[-2]) - self.V @ np.swapaxes(self.V, -1, -2)
        return np.asarray(self.L @ np.swapaxes(np.linalg.solve(np.swapaxes(self.L, -1, -2), free), -1, -2))

    def nearest(self, v: Array, missing: Array, damped: Array | float = 1.0) -> Array:
        """v minus the smallest change in the kinetic metric that A maps to ``missing``, its directions ``damped`` (..., m)."""
        y = self.V @ (damped * self.inverse_sigma * self._significant_part(missing))[..., None]
        return np.asarray(v - self._to_velocities(y))

    def constrained_acceleration(self, force: Array, b: Array) -> tuple[Array, Array]:
        """q̈ and λ of M q̈ + A'λ = force, A q̈ + b = 0, with λ of minimum norm; (..., nv), (..., k)."""
        w = np.linalg.solve(self.L, force[..., None])
        removed = (np.swapaxes(self.V, -1, -2) @ w)[..., 0] + self.inverse_sigma * self._significant_part(b)
        lam = (self.U @ (self.inverse_sigma * removed)[..., None])[..., 0] / self.sizes
        return self._to_velocities(w - self.V @ removed[..., None]), (self.range @ lam[..., None])[..., 0]

    def _significant_part(self, b: Array) -> Array:
        return np.asarray((np.swapaxes(self.U, -1, -2) @ (b / self.sizes)[..., None])[..., 0])

    def _to_velocities(self, y: Array) -> Array:
        """L⁻ᵀ y; (..., nv, 1) → (..., nv)."""
        return np.asarray(np.linalg.solve(np.swapaxes(self.L, -1, -2), y)[..., 0])


def mass_weighted_rows(A: Array, M: Array) -> Array:
    """A L⁻ᵀ with M = L L'; (..., k, nv)."""
    return _mass_weighted(A, _factor(M))


def _factor(M: Array) -> Array:
    try:
        return np.linalg.cholesky(M) if M.size else M
    except np.linalg.LinAlgError:
        raise SingularMassMatrixError(
            "the mass matrix has no inverse at this configuration: some joint moves nothing with inertia there. Choose other "
            "joints where their axes coincide, or give their links mass."
        ) from None


def _mass_weighted(A: Array, L: Array) -> Array:
    if 0 in A.shape[-2:]:
        return A
    return np.swapaxes(np.linalg.solve(L, np.swapaxes(A, -1, -2)), -1, -2)


def usual_sizes(J: Array, M: Array) -> Array:
    """RMS size of the angular and of the linear rows of A L⁻ᵀ over samples; J (n, 6, nv), M (n, nv, nv) → (6,).

    The three rows of a kind share one size, so that a row that hardly moves compared with the others is recognised.
    """
    rows = np.sqrt((mass_weighted_rows(J, M) ** 2).sum(axis=-1).mean(axis=0))
    turning, moving = float(rows[:3].max(initial=0.0)), float(rows[3:].max(initial=0.0))
    turning, moving = max(turning, MIN_SIZE_RATIO * moving), max(moving, MIN_SIZE_RATIO * turning)
    return np.repeat([turning or 1.0, moving or 1.0], 3)


def needs_singular_values(pivots: Array, sizes: Array) -> Array:
    """True if elimination with these pivots (..., k) of A M⁻¹ A' is too inaccurate and singular values are needed; (...)."""
    min_pivot = MIN_PIVOT_SINGLE if pivots.dtype == np.float32 else MIN_PIVOT
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(~(pivots >= min_pivot * sizes**2).all(axis=-1))


def independent_rows(A: Array, M: Array, sizes: Array) -> tuple[int, ...]:
    """Numbers of the rows of A independent of earlier ones, at the sample of largest rank; A (n, k, nv), M (n, nv, nv)."""
    largest: tuple[int, ...] = ()
    for B in mass_weighted_rows(A, M) / sizes[:, None]:
        independent: list[int] = []
        Q = np.zeros((0, A.shape[-1]))
        for i, row in enumerate(B):
            residual = row - Q.T @ (Q @ row)
            residual = residual - Q.T @ (Q @ residual)  # repeated against rounding errors
            if np.linalg.norm(residual) > MIN_INDEPENDENT_PART:
                independent.append(i)
                Q = np.vstack([Q, residual / np.linalg.norm(residual)])
        largest = max(largest, tuple(independent), key=len)
    return largest


# ── Closure errors and closing configurations. Floats, batches

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
    turning = [k for k in range(3) if k in rows]
    if len(turning) == 3:
        turn = so3.log(R)
    elif len(turning) == 2:
        turn = _rotation_of_axis(R, 3 - sum(turning))
    elif len(turning) == 1:
        i, j, k = ((turning[0] + n) % 3 for n in range(3))
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
