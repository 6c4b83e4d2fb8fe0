"""Linear programmes over friction cones: a revised simplex method for many rows at once, priced from the true cones.

Each row seeks the largest or least s ≥ 0 with Σ G_i f_i = b + s d and every f_i in its cone. The columns of this programme are
the edges of the cones, of which each cone has infinitely many. The prices y show which edge enters the basis: contact i moves
at v = G_i' y, and its best edge is n - μ v_t / |v_t|. No cone is replaced by a pyramid. If no forces balance b, the prices of
the first phase are the motion of Farkas' lemma: n · v ≥ μ |v_t| at every contact, and y · b < 0.

Source: Dantzig and Wolfe, Decomposition principle for linear programs, 1960 (column generation); Modern Robotics, section 12.2.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from ..core.typing import Array

_ROWS_PER_BATCH = 4096
"""Number of rows that are solved at once."""
_MAX_EXCHANGES = 400
"""Number of exchanges of the basis after which a row is undecided."""
_MIN_GAIN = 1e-9
"""Gain of an edge, relative to the prices, below which it does not enter the basis."""
_MAX_ARTIFICIAL_SUM = 1e-7
"""Largest sum of artificial columns, relative to the load, with which the forces of the first phase count as balanced."""
_MIN_PIVOT = 1e-10
"""Smallest pivot of a ratio test; a pivot is the decrease of a basic column for a unit of the entering column."""
_MAX_ZERO = 1e-11
"""Largest value of a basic column that counts as zero."""
_MAX_BELOW_ZERO = 1e-11
"""Largest value below zero, relative to the load, that a basic column may reach for the sake of a larger pivot."""
_ARTIFICIAL_COST = 1e3
"""Cost of a unit of artificial columns in the second phase, so high that they stay zero."""
_CONVERGED_RESIDUAL = 1e-12
"""Unbalanced load, relative to the load, at which Newton steps end."""
_MAX_RESIDUAL = 1e-9
"""Unbalanced load, relative to the load, up to which forces of least norm count as found."""
_DAMPING = 1e-3
"""Damping of Newton steps, relative to the unbalanced load. Without it, the slope is singular if all contacts leave the
cones."""
_MIN_DAMPING = 1e-12
"""Least damping of Newton steps."""
_MIN_RISE = 1e-4
"""Rise of the dual along a step as a share of its linear prediction, from which the step is accepted (Armijo's rule)."""
_DUAL_ROUNDING = 1e-14
"""Rounding error of the dual, relative to its value."""
_MIN_SPEED = 1e-14
"""Speed by which smaller tangential speeds are divided instead; not zero."""
_MIN_FORCE = 1e-300
"""Force by which smaller tangential forces are divided instead; not zero."""
_MAX_NEWTON_STEPS = 60
"""Number of Newton steps after which forces of least norm are not found."""
_MAX_HALVINGS = 30
"""Largest number of times that a step is halved in the search along it."""
_MIN_LOAD_OF_GROWTH = 1e-6
"""Ratio of load to growth below which the growth scales the row."""

Sense = Literal["most", "least"]


@dataclass(frozen=True, eq=False)
class Cones:
    """Friction cones of c contacts."""

    normals: Array
    """(c, 3): unit normals, along which contacts push."""
    friction: Array
    """(c,): coefficients of friction; (N, c) if each of N rows has its own."""

    def of(self, rows: Any) -> Cones:
        """Cones of some of the rows."""
        if self.friction.ndim == 1:
            return self
        return Cones(self.normals, self.friction[rows])


@dataclass(frozen=True, eq=False)
class ForceBounds:
    """Inequalities Σ H_i f_i ≤ h + s r, such as largest forces of fingers, or largest torques of joints."""

    maps: Array
    """(N, k, c, 3): H_i of each row."""
    most: Array
    """(N, k): bounds h at s = 0."""
    rate: Array
    """(N, k): growth r of the bounds for a unit of s; zero for bounds that do not grow."""

    def of(self, rows: Any) -> ForceBounds:
        """Bounds of some of the rows."""
        return ForceBounds(self.maps[rows], self.most[rows], self.rate[rows])

    def concatenate(self, other: ForceBounds) -> ForceBounds:
        """These bounds, then the ``other`` bounds of the same rows."""
        return ForceBounds(
            maps=np.concatenate([self.maps, other.maps], axis=1),
            most=np.concatenate([self.most, other.most], axis=1),
            rate=np.concatenate([self.rate, other.rate], axis=1),
        )


@dataclass(frozen=True, eq=False)
class ConeOptimum:
    """Optima of a batch of N programmes."""

    s: Array
    """(N,): optimum; inf if unbounded, NaN if no forces balance."""
    forces: Array
    """(N, c, 3): forces of the basic solution [N]."""
    prices: Array
    """(N, m): a motion that proves the result; if no forces balance, the motion of Farkas' lemma."""
    bound_prices: Array
    """(N, k): prices of the bounds, at least zero."""
    settled: Array
    """(N,) of bool: False for rows that reached the largest number of steps."""


def cone_programme(
    cones: Cones,
    maps: Array,
    b: Array,
    d: Array | None = None,
    *,
    bounds: ForceBounds | None = None,
    active: Array | None = None,
    sense: Sense = "most",
) -> ConeOptimum:
    """Largest or least s ≥ 0 with Σ G_i f_i = b + s d, f_i in the cones and within the bounds.

    Parameters
    ----------
    maps : (N, m, c, 3) array, G_i of each row
    b : (N, m) array, load without growth
    d : (N, m) array, optional, growth of the load
        None: the load does not grow. If no bound grows either, only forces that balance b are sought.
    bounds : ForceBounds, optional
    active : (N, c) array of bool, optional, contacts of each row; None: all
    sense : "most" or "least" s
    """
    N, m, c, _ = maps.shape
    if active is None:
        active = np.ones((N, c), bool)
    if bounds is None:
        bounds = no_bounds(N, c)
    grows = d is not None or bool(bounds.rate.any())
    if d is None:
        d = np.zeros((N, m))
    optima = []
    for start in range(0, max(N, 1), _ROWS_PER_BATCH):  # an empty batch too, for arrays of the right shapes
        rows = slice(start, start + _ROWS_PER_BATCH)
        batch_sense = sense if grows else None  # None: the first phase alone
        simplex = _Simplex(cones.of(rows), maps[rows], b[rows], d[rows], bounds.of(rows), active[rows], batch_sense)
        optima.append(simplex.solve())

    arrays = {}
    for field in fields(ConeOptimum):
        arrays[field.name] = np.concatenate([getattr(optimum, field.name) for optimum in optima])
    return ConeOptimum(**arrays)


def no_bounds(rows: int, contacts: int) -> ForceBounds:
    """Empty set of bounds."""
    return ForceBounds(np.zeros((rows, 0, contacts, 3)), np.zeros((rows, 0)), np.zeros((rows, 0)))


def two_sided(maps: Array, load: Array, most: Array, rate: Array) -> ForceBounds:
    """Bounds abs(load + Σ G_i f_i) ≤ most + s rate, upper ones first; maps (N, m, c, 3), other arrays (N, m)."""
    upper = ForceBounds(maps, most - load, rate)
    lower = ForceBounds(-maps, most + load, rate)
    return upper.concatenate(lower)


class _Simplex:
    """Bases of a batch of N programmes with m equations and k bounds: m + k columns each.

    A column is an edge of a contact's cone, the growth, the slack of a bound, or artificial. ``kind`` has the index of the
    contact for an edge, c for the growth, c + 1 + index of the bound for a slack, and -1 for an artificial column.
    """

    def __init__(
        self, cones: Cones, maps: Array, b: Array, d: Array, bounds: ForceBounds, active: Array, sense: Sense | None
    ) -> None:
        N, m, c, _ = maps.shape
        k = bounds.most.shape[1]
        self.cones = cones
        self.active = active
        self.sense = sense
        self.contact_count = c
        self.friction = np.broadcast_to(cones.friction, (N, c))
        self.equation_count = m
        """Number of equations of balance, before those of bounds."""
        self.G = np.concatenate([maps, bounds.maps], axis=1)
        load = b if m else bounds.most  # without equations, bounds give the scale
        largest_load = np.abs(load).max(axis=1, initial=0.0)
        largest_growth = np.abs(d).max(axis=1, initial=0.0)
        size = np.maximum(largest_load, _MIN_LOAD_OF_GROWTH * largest_growth)
        self.size = np.where(size > 0, size, 1.0)[:, None]
        """(N, 1): load by which each programme is divided."""
        self.b = np.concatenate([b, bounds.most], axis=1) / self.size
        self.d = np.concatenate([d, bounds.rate], axis=1) / self.size
        scaled_growth = np.abs(self.d).max(axis=1, initial=0.0)
        self.largest_growth = np.where(scaled_growth > 0, scaled_growth, 1.0)
        """(N,): largest growth of the scaled load; 1 without growth."""
        self.slack_columns = np.eye(m + k)[m:]
        """(k, m + k): column of each bound's slack."""
        self.basis = np.zeros((N, m + k, m + k))
        diagonal = range(m + k)
        self.basis[:, diagonal, diagonal] = np.where(self.b < 0, -1.0, 1.0)  # so that their values x are at least zero
        self.x = np.abs(self.b)
        """(N, m + k): values of the columns in the basis."""
        self.artificial = -1
        self.growth = c
        self.kind = np.full((N, m + k), self.artificial)
        holds_without_forces = self.b[:, m:] >= 0  # the slacks of these bounds begin in the basis
        self.kind[:, m:] = np.where(holds_without_forces, c + 1 + np.arange(k), self.artificial)
        self.edge = np.zeros((N, m + k, 3))
        """(N, m + k, 3): force of a unit of each column; zero except for edges."""
        self.prices = np.zeros((N, m + k))
        self.settled = np.ones(N, bool)
        """False for rows without a result."""

    def solve(self) -> ConeOptimum:
        """Solve in two phases: forces that balance, by the least sum of artificial columns; then the optimum of these rows."""
        all_rows = np.arange(len(self.b))
        self._improve(all_rows, phase=1)
        artificial_values = np.where(self.kind == self.artificial, np.maximum(self.x, 0.0), 0.0)
        is_feasible = artificial_values.sum(axis=1) <= _MAX_ARTIFICIAL_SUM
        is_unbounded = np.zeros(len(self.b), bool)
        if self.sense:
            is_unbounded = self._improve(np.flatnonzero(is_feasible & self.settled), phase=2)
        growth = np.where(self.kind == self.growth, self.x, 0.0).sum(axis=1)  # at most one column is the growth
        s = np.maximum(growth, 0.0)  # rounding errors may be below zero
        s = np.where(is_unbounded, np.inf, s)
        s = np.where(is_feasible, s, np.nan)
        prices = self.prices[:, : self.equation_count]
        bound_prices = np.maximum(self.prices[:, self.equation_count :], 0.0)
        return ConeOptimum(s, self._forces(), prices, bound_prices, self.settled)

    def _forces(self) -> Array:
        """Forces (N, c, 3) of the basic solutions: sums of edges."""
        forces = np.zeros((len(self.b), self.contact_count, 3))
        for column in range(self.kind.shape[1]):
            kind = self.kind[:, column]
            is_edge = (kind >= 0) & (kind < self.contact_count)
            rows = np.flatnonzero(is_edge)
            forces[rows, kind[rows]] += self.x[rows, column, None] * self.edge[rows, column]
        return np.asarray(forces * self.size[..., None])

    def _improve(self, rows: Array, *, phase: int) -> Array:
        """Exchange columns in the bases of ``rows`` while this improves them; returns a mask (N,) of unbounded rows.

        Rows that cannot be improved any more are dropped from ``rows``.
        """
        is_unbounded = np.zeros(len(self.b), bool)
        for _ in range(_MAX_EXCHANGES):
            if not len(rows):
                return is_unbounded
            determinants = np.linalg.det(self.basis[rows])
            is_regular = np.abs(determinants) > 0.0  # False for NaN too
            self.settled[rows[~is_regular]] = False
            rows = rows[is_regular]
            inverse = np.linalg.inv(self.basis[rows])
            self.x[rows] = (inverse @ self.b[rows][..., None])[..., 0]
            costs = self._costs(rows, phase)
            y = (costs[:, None, :] @ inverse)[:, 0]
            self.prices[rows] = y
            gain, direction = self._gains(rows, y, phase)
            column = gain.argmax(axis=1)
            improves = gain.max(axis=1) > _MIN_GAIN * (1.0 + np.abs(y).max(axis=1))
            rows, column = rows[improves], column[improves]
            inverse, direction = inverse[improves], direction[improves]
            entering, edge = self._entering_columns(rows, column, direction)
            decrease = (inverse @ entering[..., None])[..., 0]
            leaving, is_bounded = self._leaving_columns(rows, decrease, phase)
            is_unbounded[rows[~is_bounded]] = True
            rows, leaving, column = rows[is_bounded], leaving[is_bounded], column[is_bounded]
            self.basis[rows, :, leaving] = entering[is_bounded]
            self.kind[rows, leaving] = column
            self.edge[rows, leaving] = edge[is_bounded]
        self.settled[rows] = False
        return is_unbounded

    def _costs(self, rows: Array, phase: int) -> Array:
        """Value (rows, m + k) of a unit of each basic column in the sum that a phase makes largest."""
        artificial_cost = -1.0 if phase == 1 else -_ARTIFICIAL_COST
        kind = self.kind[rows]
        costs = np.where(kind == self.growth, self._growth_cost(phase), 0.0)
        return np.where(kind == self.artificial, artificial_cost, costs)

    def _growth_cost(self, phase: int) -> float:
        """Value of a unit of s in the sum that a phase makes largest."""
        if phase == 1:
            return 0.0
        return 1.0 if self.sense == "most" else -1.0

    def _gains(self, rows: Array, y: Array, phase: int) -> tuple[Array, Array]:
        """Gains (rows, c + 1 + k) of the best edge of each contact, of growth and of slacks; and directions v_t / |v_t|."""
        n, friction = self.cones.normals, self.friction[rows]
        v = np.einsum("nmck,nm->nck", self.G[rows], y)
        v_n = (v * n).sum(axis=-1)
        v_t = v - v_n[..., None] * n
        sliding_speed = np.linalg.norm(v_t, axis=-1)
        edge_gains = np.where(self.active[rows], friction * sliding_speed - v_n, -np.inf)
        growth_gain = (self._growth_cost(phase) + (y * self.d[rows]).sum(axis=-1)) / self.largest_growth[rows]
        is_first_of_most = phase == 1 and self.sense == "most"
        if not self.sense or is_first_of_most:  # growth does not enter: s stays 0
            growth_gain = np.full(len(rows), -np.inf)
        slack_gains = -y @ self.slack_columns.T
        gains = np.concatenate([edge_gains, growth_gain[:, None], slack_gains], axis=1)
        directions = v_t / np.maximum(sliding_speed, _MIN_SPEED)[..., None]
        return gains, directions

    def _entering_columns(self, rows: Array, column: Array, direction: Array) -> tuple[Array, Array]:
        """Entering columns (rows, m + k), and their edge forces (rows, 3), zero for columns that are not edges."""
        c = self.contact_count
        edge = np.zeros((len(rows), 3))
        entering = np.zeros((len(rows), self.G.shape[1]))
        if c:
            i = np.minimum(column, c - 1)  # any contact if the column is not an edge; overwritten below
            edge_direction = direction[np.arange(len(rows)), i]
            edge = self.cones.normals[i] - self.friction[rows, i][:, None] * edge_direction
            entering = np.einsum("nmk,nk->nm", self.G[rows, :, i], edge)
        entering = np.where((column == c)[:, None], -self.d[rows], entering)
        if len(self.slack_columns):
            bound = np.maximum(column - c - 1, 0)
            entering = np.where((column > c)[:, None], self.slack_columns[bound], entering)
        return entering, np.where((column < c)[:, None], edge, 0.0)

    def _leaving_columns(self, rows: Array, decrease: Array, phase: int) -> tuple[Array, Array]:
        """Position (rows,) in the basis of the column that leaves, and a mask (rows,): False if no column leaves.

        ``decrease`` (rows, m + k) is the decrease of the basic columns for a unit of the entering one. Of the columns that
        reach zero nearly first, the one with the largest pivot leaves (Harris' ratio test). In the second phase, artificial
        columns at zero leave at once.
        """
        x = self.x[rows]
        leaves_at_once = np.zeros(x.shape, bool)
        if phase == 2:
            is_artificial = self.kind[rows] == self.artificial
            leaves_at_once = is_artificial & (x <= _MAX_ZERO) & (np.abs(decrease) > _MIN_GAIN)
        falls = decrease > _MIN_PIVOT
        divisor = np.where(falls, decrease, 1.0)
        ratio = np.where(falls, np.maximum(x, 0.0) / divisor, np.inf)
        ratio = np.where(leaves_at_once, 0.0, ratio)
        relaxed_ratio = np.where(falls, (np.maximum(x, 0.0) + _MAX_BELOW_ZERO) / divisor, np.inf)
        largest_ratio = np.where(leaves_at_once, 0.0, relaxed_ratio).min(axis=1)
        is_near = ratio <= largest_ratio[:, None]
        pivots = np.where(is_near, np.abs(decrease), -1.0)
        return pivots.argmax(axis=1), np.isfinite(largest_ratio)


# ── Forces of least norm


def least_norm_in_cones(
    cones: Cones, maps: Array, b: Array, active: Array, bounds: ForceBounds | None = None
) -> tuple[Array, Array]:
    """Forces (N, c, 3) of least norm in the cones with Σ G_i f_i = b and Σ H_i f_i ≤ h, and a mask (N,) of solved rows.

    The dual of min ½ |f|² is smooth: f = P(G' y - H' z), where P projects onto the cones and z ≥ 0. It is solved by projected
    Newton steps of the whole batch, with a backtracking search along each. If forces only just balance, the dual may have no
    solution; the mask is then False.

    Source: Bertsekas, Projected Newton methods for optimization problems with simple constraints, 1982.
    """
    N, m, c, _ = maps.shape
    if bounds is None:
        bounds = no_bounds(N, c)
    # One vector of prices y with A = (G, -H): its first m entries have any sign, the others are z ≥ 0.
    A = np.concatenate([maps, -bounds.maps], axis=1) * active[:, None, :, None]
    A = A.reshape(N, A.shape[1], 3 * c)
    row_norms = np.linalg.norm(A, axis=2, keepdims=True)
    row_norms[:, :m] = 1.0  # equations are not scaled
    row_norms = np.where(row_norms > 0, row_norms, 1.0)
    A = A / row_norms
    load = b if m else bounds.most  # without equations, bounds give the scale
    size = np.abs(load).max(axis=1, initial=0.0, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    scaled_bounds = bounds.most / row_norms[:, m:, 0]
    target = np.concatenate([b, -scaled_bounds], axis=1) / size
    is_bound = np.arange(A.shape[1]) >= m  # the price of a bound is at least zero
    y = np.zeros(target.shape)
    G = A[:, :m]
    inverse = np.linalg.pinv(G @ G.swapaxes(1, 2), hermitian=True)
    y[:, :m] = (inverse @ target[:, :m, None])[..., 0]  # a start without cones
    forces = np.zeros((N, c, 3))
    is_solved = np.zeros(N, bool)
    rows = np.arange(N)  # that are not converged yet
    for _ in range(_MAX_NEWTON_STEPS):
        unprojected = (A[rows].swapaxes(1, 2) @ y[rows][..., None]).reshape(len(rows), c, 3)
        f, slope = _projection(cones.of(rows), unprojected)
        forces[rows] = f
        residual = target[rows] - (A[rows] @ f.reshape(len(rows), 3 * c, 1))[..., 0]
        is_slack = is_bound & (y[rows] <= 0.0) & (residual <= 0.0)  # bounds that hold without a price
        residual = np.where(is_slack, 0.0, residual)
        error = np.abs(residual).max(axis=1, initial=0.0)
        is_solved[rows] = error <= _MAX_RESIDUAL
        goes_on = error > _CONVERGED_RESIDUAL
        rows, error = rows[goes_on], error[goes_on]
        if not len(rows):
            break
        residual, slope, is_slack = residual[goes_on], slope[goes_on], is_slack[goes_on]
        A_by_contact = A[rows].reshape(len(rows), -1, c, 3)
        H = np.einsum("nmci,ncij,nkcj->nmk", A_by_contact, slope, A_by_contact)
        is_slack_entry = is_slack[:, :, None] | is_slack[:, None, :]
        H = np.where(is_slack_entry, 0.0, H)  # prices of slack bounds stay zero
        relative_damping = np.maximum(_DAMPING * np.minimum(error, 1.0), _MIN_DAMPING)
        damping = relative_damping * (1.0 + np.trace(H, axis1=1, axis2=2))
        H += damping[:, None, None] * np.eye(H.shape[1])
        step = np.linalg.solve(H, residual[..., None])[..., 0]
        y[rows] = _line_search(cones.of(rows), A[rows], target[rows], y[rows], step, residual, is_bound)
    return forces * size[..., None] * active[..., None], is_solved


def _line_search(cones: Cones, A: Array, b: Array, y: Array, step: Array, gradient: Array, is_bound: Array) -> Array:
    """Prices after the largest share 1, ½, ¼, … of each step that raises the dual b · y - ½ |P(A' y)|² enough."""

    def dual(prices: Array) -> Array:
        unprojected = (A.swapaxes(1, 2) @ prices[..., None]).reshape(len(prices), A.shape[2] // 3, 3)
        f, _ = _projection(cones, unprojected)
        return np.asarray((b * prices).sum(axis=1) - 0.5 * (f**2).sum(axis=(1, 2)))

    share = np.ones((len(y), 1))
    dual_at_start = dual(y)
    for _ in range(_MAX_HALVINGS):
        next_y = y + share * step
        next_y = np.where(is_bound, np.maximum(next_y, 0.0), next_y)
        linear_rise = (gradient * (next_y - y)).sum(axis=1)
        rounding = _DUAL_ROUNDING * (1.0 + np.abs(dual_at_start))
        rises_too_little = dual(next_y) < dual_at_start + _MIN_RISE * linear_rise - rounding
        if not rises_too_little.any():
            break
        share[rises_too_little] *= 0.5
    return next_y


def _projection(cones: Cones, f: Array) -> tuple[Array, Array]:
    """Nearest forces in the cones (N, c, 3), and the derivative of the projection (N, c, 3, 3).

    Forces in a cone stay, forces in its polar cone become zero, and all others are projected onto the nearest edge.
    """
    n, friction = cones.normals, cones.friction
    f_n = (f * n).sum(axis=-1)
    f_t = f - f_n[..., None] * n
    tangential_size = np.linalg.norm(f_t, axis=-1)
    # Without friction both sides of the first test are zero, so f_n is tested too.
    is_inside = (tangential_size <= friction * f_n) & (f_n >= 0)
    is_inside = is_inside[..., None]
    is_polar = (f_n <= -friction * tangential_size)[..., None]
    divisor = np.maximum(tangential_size, _MIN_FORCE)
    u = f_t / divisor[..., None]
    edge = (n + friction[..., None] * u) / np.sqrt(1.0 + friction**2)[..., None]
    size_along_edge = (f * edge).sum(axis=-1)[..., None]
    on_edge_or_zero = np.where(is_polar, 0.0, size_along_edge * edge)
    nearest = np.where(is_inside, f, on_edge_or_zero)
    # Derivative on an edge: along the edge, and by its turn about the normal, along the third direction n × u.
    third_projector = np.eye(3) - n[:, :, None] * n[:, None, :] - u[..., :, None] * u[..., None, :]
    turn_factor = friction / np.sqrt(1.0 + friction**2) * size_along_edge[..., 0] / divisor
    slope_on_edge = edge[..., :, None] * edge[..., None, :] + turn_factor[..., None, None] * third_projector
    slope_or_zero = np.where(is_polar[..., None], 0.0, slope_on_edge)
    slope = np.where(is_inside[..., None], np.eye(3), slope_or_zero)
    return nearest, slope
