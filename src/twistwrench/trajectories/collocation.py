"""Collocation of limit curves x(s) in the phase plane, and the timing s(t) that follows from ds² = x.

Along an active limit, a x'/2 + b x + d √x + c = ±L is a differential equation for x. It is singular where a crosses
zero, but collocation does not divide by a and passes through. Source: Hairer & Wanner, Solving Ordinary Differential
Equations II, section IV.5, for the nodes; Pham, IEEE T-RO 30(6), 2014, for the behaviour at zero inertia.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.typing import Array
from .limit_rows import PathRows, Row, Rows

STAGES = 5
"""Number of nodes of a piece; u is a polynomial of degree 4 there, x one of degree 5."""
TOLERANCE = 2e-8
"""Largest deviation of a piece from its limit, above or below, as a share of the limit."""
TOLERANCE_AT_REST = 4e-7
"""Tolerance of the first piece from rest with viscous friction, where √x is not a polynomial; costs about 1e-5 s."""
_MAX_CHANGE_RATIO = 4.0
"""Largest ratio by which x may change within a piece; larger ratios make the time integral inaccurate."""


_LEGENDRE = np.polynomial.legendre.Legendre
_RADAU_POLYNOMIAL = _LEGENDRE.basis(STAGES) - _LEGENDRE.basis(STAGES - 1)  # on [-1, 1]
NODES = np.sort(0.5 * (1.0 + _RADAU_POLYNOMIAL.roots().real))
"""Nodes of Radau IIA on (0, 1], the last one 1: roots of P_n - P_{n-1}."""
_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))
"""Coefficients of u in powers of ζ from its values at the nodes."""
_EXPONENTS = np.arange(1, STAGES + 1)
"""Exponents of ζ in ∫ u dζ."""
INTEGRALS = (NODES[:, None] ** _EXPONENTS / _EXPONENTS) @ _COEFFICIENTS
"""∫ from 0 to each node of the polynomial with the given values at the nodes."""
_CHECK_POINTS = np.array([0.0, 0.03, 0.22, 0.45, 0.68, 0.9])
"""Points between the nodes at which limits are also checked."""
POINTS = np.concatenate([NODES, _CHECK_POINTS])
"""Nodes, followed by the check points; shares ζ of a piece."""
_U_AT_POINTS = np.vander(POINTS, STAGES, increasing=True) @ _COEFFICIENTS
"""u at the points from its values at the nodes."""
_INTEGRALS_AT_POINTS = (POINTS[:, None] ** _EXPONENTS / _EXPONENTS) @ _COEFFICIENTS
"""∫ u dζ from 0 to the points from the values of u at the nodes."""
_CAP_ROUNDING = 1e-10
"""Share by which x may exceed a cap that it does not run along."""
_MAX_EXCESS_AT_BEGIN = 1e-7
"""Share by which a piece that runs along a cap may begin above it."""
_CAP_TOLERANCE = 0.25 * TOLERANCE
"""Share by which x may exceed the cap that it runs along."""
_SIGN_ROUNDING = 1e-9
"""Size of a at the last node, as a share of its largest value, below which its sign is not known."""
_MAX_NEWTON_STEPS = 30
_NEWTON_TOLERANCE = 1e-14
"""Last step of Newton's method, as a share of the largest u."""
_MIN_SQUARE = 1e-300
"""Smallest x for a division by √x."""
_DIAGONAL_SHIFT = 1e-13
"""Addition to the diagonal of a singular matrix, as a share of its largest entry."""
_FLIP = np.zeros((STAGES + 1, STAGES + 1))
for _i, _j in np.ndindex(*_FLIP.shape):
    _FLIP[_i, _j] = comb(_j, _i) * (-1.0) ** _i
"""Coefficients in powers of 1 - ζ from those in powers of ζ."""


@dataclass(frozen=True, eq=False)
class Cell:
    """x(s) on [low, high] with one active limit."""

    low: float
    high: float
    x: Array
    """(STAGES + 1,) coefficients of x in powers of ζ = (s - low) / (high - low)."""
    active: Row
    side: int
    """+1 if the upper limit is active, -1 if the lower."""

    def at(self, s: Array) -> Array:
        """x at s."""
        return np.polynomial.polynomial.polyval((s - self.low) / (self.high - self.low), self.x)

    def since(self, low: float) -> Cell:
        """Part of the cell from ``low`` to its end."""
        Polynomial = np.polynomial.Polynomial
        z = (low - self.low) / (self.high - self.low)
        zeta_of_part = Polynomial([z, 1.0 - z])  # ζ of the cell in terms of ζ of the part
        shifted = Polynomial(self.x)(zeta_of_part).coef
        coefficients = np.zeros(len(self.x))
        coefficients[: len(shifted)] = shifted  # NumPy drops leading zeros
        return Cell(low, self.high, coefficients, self.active, self.side)


def try_cell(rows: PathRows, s: float, x: float, h: float, way: int, *, along_caps: bool) -> tuple[Cell | None, bool]:
    """Piece from (s, x) of length h in direction ``way`` (±1 of s), and True if there is none but a shorter h may help.

    Forward the piece has the largest acceleration, backward the smallest. There is none if each limit that is active
    throughout violates another one. There is also none if the collocation is not accurate enough: then a shorter h may help.
    With ``along_caps``, the piece may also run along a cap of x.
    """
    end = s + way * h
    h = abs(end - s)  # beside s = 1 the end is rounded by some 1e-16, much of a short piece; the difference is exact
    low, high = (s, end) if way > 0 else (end, s)
    limits = rows.at(s + way * h * POINTS, low, high)
    u, active_rows, sides = _candidates(rows, limits, x, way, h)
    n_along_rows = len(u)  # candidates after these run along a cap of x
    if along_caps and len(rows.caps):
        cap = limits.cap[:STAGES]
        begins_at_cap = limits.cap[STAGES] <= x * (1 + _MAX_EXCESS_AT_BEGIN)  # STAGES: the first check point, ζ = 0
        applies = np.isfinite(cap).all(axis=0) & begins_at_cap
        if applies.any():
            along_cap = np.linalg.solve(2 * way * h * INTEGRALS, cap[:, applies] - x).T
            u = np.concatenate([u, along_cap])
            active_rows += [rows.caps[k] for k in np.flatnonzero(applies)]
            sides += [1] * int(applies.sum())  # a cap is an upper limit
    if not len(u):
        return None, False
    # dx/ds = 2 u and ds = way h dζ, so x grows by 2 way h ∫ u dζ.
    U = u @ _U_AT_POINTS.T  # (candidates, points)
    X = x + 2 * way * h * (u @ _INTEGRALS_AT_POINTS.T)
    row_values = np.abs(limits.values(U, X))
    tolerance = TOLERANCE_AT_REST if x == 0 and np.any(limits.d) else TOLERANCE
    is_active = np.zeros((len(u), len(rows.rows)), bool)
    active_indices = [rows.rows.index(row) for row in active_rows[:n_along_rows]]
    is_active[np.arange(n_along_rows), active_indices] = True
    # The deviation of the active row itself is checked below.
    meets_limit = (row_values <= rows.L + tolerance * rows.L) | is_active[:, None, :]
    is_allowed = meets_limit.all(axis=(1, 2)) & (X[:, :STAGES] > 0).all(axis=1) & (X >= 0).all(axis=1)
    cap_tolerances = np.where(np.arange(len(u)) < n_along_rows, _CAP_ROUNDING, _CAP_TOLERANCE)
    cap_tolerance = cap_tolerances[:, None, None] * np.ones((len(POINTS), 1))
    cap_tolerance[:, STAGES] *= 2.0  # twice the tolerance at the first check point, where the last piece ended
    is_allowed &= (X[:, :, None] <= limits.cap * (1 + cap_tolerance)).all(axis=(1, 2))
    if not is_allowed.any():
        return None, False
    fastest = int(np.where(is_allowed, X[:, STAGES - 1], -np.inf).argmax())  # candidate with the largest x at the end
    row = active_rows[fastest]
    if row in rows.caps and (row.kind == "velocity" or rows.flat[rows.rows.index(row)]):
        deviation = np.abs(X[fastest] / limits.cap[:, rows.caps.index(row)] - 1.0)
    else:
        k = rows.rows.index(row)
        deviation = np.abs(row_values[fastest, :, k] / rows.L[k] - 1.0)
    change_ratio = X[fastest, STAGES - 1] / x if x > 0 else 1.0
    changes_little = 1 / _MAX_CHANGE_RATIO <= change_ratio <= _MAX_CHANGE_RATIO
    if deviation.max() > tolerance or not changes_little:
        return None, True
    coefficients = np.concatenate([[x], 2 * way * h * (_COEFFICIENTS @ u[fastest]) / _EXPONENTS])
    cell = Cell(low, high, coefficients, row, sides[fastest])
    if way < 0:  # backward, ζ was counted from the other end
        cell = replace(cell, x=_FLIP @ cell.x)
    return cell, False


def _candidates(rows: PathRows, limits: Rows, x: float, way: int, h: float) -> tuple[Array, list[Row], list[int]]:
    """Values of u at the nodes (n, STAGES) for each row that can be active throughout; the rows; and their sides (±1).

    A row can be active throughout if its a has one sign; then the same side of it bounds u everywhere.
    """
    a = limits.a[:STAGES]  # (nodes, rows)
    inner_signs = np.sign(a[:-1])
    first_sign = inner_signs[0]
    # At the last node a may touch zero, up to rounding: the next piece begins there.
    last_keeps_sign = first_sign * a[-1] >= -_SIGN_ROUNDING * np.abs(a).max(axis=0)
    has_one_sign = (inner_signs == first_sign).all(axis=0) & last_keeps_sign
    k = np.flatnonzero(has_one_sign & (first_sign != 0) & ~rows.flat)  # indices of the rows
    if not len(k):
        return np.zeros((0, STAGES)), [], []
    side = way * first_sign[k]  # forward the upper bound of u, backward the lower bound
    a, b, c, d = (row_terms[:STAGES, k].T for row_terms in (limits.a, limits.b, limits.c, limits.d))
    H = 2 * way * h * INTEGRALS
    matrix = b[:, :, None] * H + a[:, :, None] * np.eye(STAGES)
    right_side = side[:, None] * rows.L[k][:, None] - c - b * x
    u = _solve(matrix, right_side)
    if np.any(d):  # with √x the equation is not linear: Newton's method
        for _ in range(_MAX_NEWTON_STEPS):
            X = np.maximum(x + u @ H.T, _MIN_SQUARE)
            root = np.sqrt(X)
            residual = np.einsum("kmn,kn->km", matrix, u) + d * root - right_side
            step = _solve(matrix + (0.5 * d / root)[:, :, None] * H, residual)
            u = u - step
            if np.abs(step).max() <= _NEWTON_TOLERANCE * np.abs(u).max():
                break
    is_finite = np.isfinite(u).all(axis=1)
    candidate_rows = [rows.rows[i] for i in k[is_finite]]
    return u[is_finite], candidate_rows, side[is_finite].astype(int).tolist()


def _solve(matrix: Array, right_side: Array) -> Array:
    """Solutions of systems (n, STAGES, STAGES); if one is singular, all are solved with raised diagonals."""
    columns = right_side[..., None]
    try:
        solutions = np.linalg.solve(matrix, columns)
    except np.linalg.LinAlgError:
        largest_entry = np.abs(matrix).max(axis=(1, 2), keepdims=True)
        raised_matrix = matrix + _DIAGONAL_SHIFT * (largest_entry + 1e-300) * np.eye(STAGES)  # 1e-300: it may be zero
        solutions = np.linalg.solve(raised_matrix, columns)
    return np.asarray(solutions[..., 0])


# ── s(t) of the fastest timing, from the pieces of x(s) = ds²

_LEGENDRE_NODES, _LEGENDRE_WEIGHTS = np.polynomial.legendre.leggauss(16)  # on [-1, 1]
_GAUSS_NODES = 0.5 * (_LEGENDRE_NODES + 1.0)
"""Nodes of Gauss–Legendre quadrature on [0, 1]."""
_GAUSS_WEIGHTS = 0.5 * _LEGENDRE_WEIGHTS
_MAX_SEARCH_STEPS = 60
"""Largest number of steps of the search for the fraction of a piece covered in a time."""
_SAMPLES_PER_BLOCK = 2048
"""Block size for which the values at the Gauss nodes fit into the processor's cache."""


@dataclass(frozen=True, eq=False)
class FastestScaling:
    """Path scaling s(t) with piecewise ds² = x(s); rate and acceleration come from x, so limits hold at any time."""

    cells: tuple[Cell, ...]
    name: str = "fastest"

    @cached_property
    def _lengths(self) -> Array:
        """Lengths of the pieces in s, (n,)."""
        return np.array([cell.high - cell.low for cell in self.cells])

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients of x of all pieces, (n, STAGES + 1)."""
        return np.stack([cell.x for cell in self.cells])

    @cached_property
    def _is_slowing(self) -> Array:
        """True for pieces that slow down; their time is counted from the end, where x may be 0."""
        return np.array([cell.x.sum() < cell.x[0] for cell in self.cells])

    @cached_property
    def times(self) -> Array:
        """Start times of the pieces, and the end time; (n + 1,) s."""
        k = np.arange(len(self.cells))
        piece_times = self._since(k, np.ones(len(k)))
        return np.concatenate([[0.0], np.cumsum(piece_times)])

    @property
    def duration(self) -> float:
        """T [s]."""
        return float(self.times[-1])

    def _square(self, k: Array, z: Array) -> Array:
        """x at the fraction z of piece k; (n), (n, m) → (n, m)."""
        x = np.zeros(np.shape(z))
        for coefficient in self._coefficients[k].T[::-1]:  # Horner's scheme
            x = x * z + coefficient[:, None]
        return np.maximum(x, 0.0)

    @cached_property
    def _piece_times(self) -> Array:
        """∫ ds/√x over each piece [s], integrated from its slower end."""
        k = np.arange(len(self.cells))
        whole_piece = np.ones(len(k))  # fraction of each piece
        time_from_end = self._integral(k, whole_piece, -1.0)
        time_from_start = self._integral(k, whole_piece, 1.0)
        return np.where(self._is_slowing, time_from_end, time_from_start)

    def _since(self, k: Array, z: Array) -> Array:
        """∫ ds/√x over the first fraction z of piece k; (n), (n) → (n)."""
        is_slowing = self._is_slowing[k]
        fraction = np.where(is_slowing, 1.0 - z, z)  # from the slower end
        way = np.where(is_slowing, -1.0, 1.0)[:, None]
        time = self._integral(k, fraction, way)
        return np.where(is_slowing, self._piece_times[k] - time, time)

    def _integral(self, k: Array, z: Array, way: Array | float) -> Array:
        """∫ ds/√x over the fraction z from the start (``way`` -1: the end) of piece k.

        With ζ = z w² and the length l of the piece, ds/√x = l z (2 w/√x) dw, which stays finite at rest: x ~ ζ there.
        """
        w = _GAUSS_NODES[None, :]
        zeta = z[:, None] * w * w
        zeta_from_start = np.where(way > 0, zeta, 1.0 - zeta)
        with np.errstate(divide="ignore", invalid="ignore"):
            integrand = 2 * w / np.sqrt(self._square(k, zeta_from_start))
        finite_integrand = np.where(np.isfinite(integrand), integrand, 0.0)
        # Row by row, so that the result for one sample does not depend on the batch size.
        return self._lengths[k] * z * np.vecdot(finite_integrand, _GAUSS_WEIGHTS)

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Before 0 and after T the path is at rest at its ends."""
        times = np.asarray(arguments.real(t, "t"), float)
        inner_times = np.clip(times.ravel(), 0.0, self.duration)
        is_known = ~np.isnan(inner_times)
        inner_times = np.where(is_known, inner_times, 0.0)
        k = np.searchsorted(self.times, inner_times, side="right") - 1
        k = np.clip(k, 0, len(self.cells) - 1)  # pieces
        time_in_piece = inner_times - self.times[k]
        z = np.empty(len(k))
        for begin in range(0, len(k), _SAMPLES_PER_BLOCK):
            block = slice(begin, begin + _SAMPLES_PER_BLOCK)
            z[block] = self._fraction_after(k[block], time_in_piece[block])
        x = self._square(k, z[:, None])[:, 0]
        dx_dz = np.zeros(len(k))  # derivative of the polynomial, by Horner's scheme
        for n in range(self._coefficients.shape[1] - 1, 0, -1):
            dx_dz = dx_dz * z + n * self._coefficients[k, n]
        dds = 0.5 * dx_dz / self._lengths[k]  # d²s/dt² = x'/2
        outside = (times.ravel() < 0) | (times.ravel() > self.duration)
        nan_where_unknown = np.where(is_known, 0.0, np.nan)
        s_at_begin = np.array([cell.low for cell in self.cells])
        s = s_at_begin[k] + z * self._lengths[k]
        ds = np.where(outside, 0.0, np.sqrt(x))
        dds = np.where(outside, 0.0, dds)
        motion = (s, ds, dds)
        return tuple((y + nan_where_unknown).reshape(times.shape) for y in motion)  # type: ignore[return-value]

    def _fraction_after(self, k: Array, time_in_piece: Array) -> Array:
        """Fraction z of piece k covered in a time: Newton's method within a bracket."""
        piece_time = np.diff(self.times)[k]
        low = np.zeros(len(k))
        high = np.ones(len(k))
        time_share = np.clip(time_in_piece / np.where(piece_time > 0, piece_time, 1.0), 0.0, 1.0)
        # First guess: quadratic in time from rest and to rest, otherwise linear.
        is_from_rest = self._coefficients[k, 0] == 0
        is_to_rest = k == len(self.cells) - 1
        z = np.where(is_from_rest, time_share**2, np.where(is_to_rest, 1.0 - (1.0 - time_share) ** 2, time_share))
        open_samples = np.arange(len(k))  # indices of samples that have not converged
        for _ in range(_MAX_SEARCH_STEPS):
            piece = k[open_samples]
            z_before = z[open_samples]
            time_error = self._since(piece, z_before) - time_in_piece[open_samples]
            low[open_samples] = np.where(time_error <= 0, z_before, low[open_samples])
            high[open_samples] = np.where(time_error >= 0, z_before, high[open_samples])
            rate = np.sqrt(self._square(piece, z_before[:, None])[:, 0])
            newton = z_before - time_error * rate / self._lengths[piece]
            is_in_bracket = (newton > low[open_samples]) & (newton < high[open_samples])
            middle = 0.5 * (low[open_samples] + high[open_samples])
            z_after = np.where(is_in_bracket, newton, middle)
            z_after = np.where(time_error == 0, z_before, z_after)
            z[open_samples] = z_after
            # Above rounding: two units in the last place of z, or of 0.001 if z is smaller.
            has_moved = np.abs(z_after - z_before) > 4e-16 * np.maximum(z_after, 1e-3)
            open_samples = open_samples[has_moved]
            if not len(open_samples):
                break
        return z
