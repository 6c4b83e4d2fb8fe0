"""Linear programmes over friction cones: a revised simplex method for many rows at once, priced from the true cones.

The programme of each row is: largest or least s ≥ 0 with Σ G_i f_i = b + s d and every f_i in its cone. Its columns are the
edges of the cones, of which there are infinitely many. The prices y show which edge enters the basis: contact i moves at
v = G_i' y, and its best edge is n - μ v_t / |v_t|. The cone is therefore not replaced by a pyramid. If no forces balance b,
the prices of the first phase are the motion of Farkas' lemma: n · v ≥ μ |v_t| at every contact, and y · b < 0.

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
"""Sum of artificial columns, relative to the load, up to which the first phase has found forces that balance."""
_MIN_PIVOT = 1e-10
"""Smallest pivot of a ratio test."""
_MAX_ZERO = 1e-11
"""Largest value of a basic column that counts as zero."""
_MAX_BELOW_ZERO = 1e-11
"""Largest value below zero, relative to the load, that a basic column may reach for the sake of a larger pivot."""
_ARTIFICIAL_PRICE = 1e3
"""Price of artificial columns in the second phase, so high that they stay zero."""
_CONVERGED_RESIDUAL = 1e-12
"""Unbalanced load, relative to the load, at which Newton steps end."""
_MAX_RESIDUAL = 1e-9
"""Largest unbalanced load of forces of least norm, relative to the load, if further steps do not reduce it."""
_DAMPING = 1e-3
"""Damping of Newton steps, relative to the unbalanced load. Without it, the slope is singular if all contacts leave the
cones."""
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
    """(c,): coefficients of friction; (N, c) if each row has its own."""

    def of(self, rows: Any) -> Cones:
        """Cones of some of the rows."""
        if self.friction.ndim == 1:
            return self
        return Cones(self.normals, self.friction[rows])


@dataclass(frozen=True, eq=False)
class ForceBounds:
    """Inequalities Σ H_i f_i ≤ h + s r, such as those of fingers with a largest force, or of joints with a largest torque."""

    maps: Array
    """(N, k, c, 3): H_i of each row."""
    most: Array
    """(N, k): bounds h without growth."""
    rate: Array
    """(N, k): growth r of the bounds with s; zero for bounds that do not grow."""

    def of(self, rows: Any) -> ForceBounds:
        """Bounds of some of the rows."""
        return ForceBounds(self.maps[rows], self.most[rows], self.rate[rows])

    def concatenate(self, other: ForceBounds) -> ForceBounds:
        """These bounds and ``other`` ones of the same rows."""
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
    """(N, c, 3): basic solution [N]."""
    prices: Array
    """(N, m): a motion of Farkas' lemma if no forces balance, otherwise one that proves the optimum."""
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
        simplex = _Simplex(
            cones.of(rows), maps[rows], b[rows], d[rows], bounds.of(rows), active[rows], sense if grows else None
        )
        optima.append(simplex.solve())

    def join_batches(name: str) -> Array:
        return np.concatenate([getattr(optimum, name) for optimum in optima])

    return ConeOptimum(*(join_batches(field.name) for field in fields(ConeOptimum)))


def no_bounds(rows: int, contacts: int) -> ForceBounds:
    """Empty set of bounds."""
    return ForceBounds(np.zeros((rows, 0, contacts, 3)), np.zeros((rows, 0)), np.zeros((rows, 0)))


def two_sided(maps: Array, load: Array, most: Array, rate: Array) -> ForceBounds:
    """Bounds abs(load + Σ G_i f_i) ≤ most + s rate, by maps (N, m, c, 3) and arrays (N, m); the upper bounds come first."""
    upper = ForceBounds(maps, most - load, rate)
    lower = ForceBounds(-maps, most + load, rate)
    return upper.concatenate(lower)


class _Simplex:
    """Bases of a batch of N programmes with m equations and k bounds: m + k columns each.

    A column is an edge of a contact's cone, the growth, the slack of a bound, or artificial. Its number in ``kind`` is that of
    the contact, c for growth, c + 1 + bound for a slack, and -1 for an artificial column.
    """

    def __init__(
        self, cones: Cones, maps: Array, b: Array, d: Array, bounds: ForceBounds, active: Array, sense: Sense | None
    ) -> None:
        N, m, c, _ = maps.shape
        k = bounds.most.shape[1]
        self.cones = cones
        self.active = active
        self.sense = sense
        self.contacts = c
        """Number of contacts."""
        self.friction = np.broadcast_to(cones.friction, (N, c))
        self.equations = m
        """Number of equations; the rows of bounds follow."""
        self.G = np.concatenate([maps, bounds.maps], axis=1)
        load = np.abs(b if m else bounds.most).max(axis=1, initial=0.0)
        rate = np.abs(d).max(axis=1, initial=0.0)
        size = np.maximum(load, _MIN_LOAD_OF_GROWTH * rate)
        self.size = np.where(size > 0, size, 1.0)[:, None]
        """(N, 1): load by which each programme is divided."""
        self.b = np.concatenate([b, bounds.most], axis=1) / self.size
        self.d = np.concatenate([d, bounds.rate], axis=1) / self.size
        growth = np.abs(self.d).max(axis=1, initial=0.0)
        self.rate = np.where(growth > 0, growth, 1.0)
        """(N,): largest growth of the scaled load."""
        self.slack_columns = np.eye(m + k)[m:]
        self.basis = np.zeros((N, m + k, m + k))
        self.basis[:, range(m + k), range(m + k)] = np.where(self.b < 0, -1.0, 1.0)
        self.x = np.abs(self.b)
        """(N, m + k): values of the columns in the basis."""
        self.artificial, self.growth = -1, c
        self.kind = np.full((N, m + k), self.artificial)
        holds_without_forces = self.b[:, m:] >= 0  # the slacks of these bounds begin in the basis
        self.kind[:, m:] = np.where(holds_without_forces, c + 1 + np.arange(k), self.artificial)
        self.edge = np.zeros((N, m + k, 3))
        """(N, m + k, 3): edge forces of the columns that are contacts."""
        self.prices = np.zeros((N, m + k))
        self.settled = np.ones(N, bool)

    def solve(self) -> ConeOptimum:
        """First forces that balance, by the least sum of artificial columns; then the optimum of rows that have some."""
        self._improve(np.arange(len(self.b)), phase=1)
        artificial_sum = np.where(self.kind == self.artificial, np.maximum(self.x, 0.0), 0.0).sum(axis=1)
        feasible = artificial_sum <= _MAX_ARTIFICIAL_SUM
        unbounded = np.zeros(len(self.b), bool)
        if self.sense:
            unbounded = self._improve(np.flatnonzero(feasible & self.settled), phase=2)
        s = np.where(self.kind == self.growth, self.x, 0.0).sum(axis=1)
        s = np.where(unbounded, np.inf, s)
        s = np.where(feasible, s, np.nan)
        prices = self.prices[:, : self.equations]
        bound_prices = np.maximum(self.prices[:, self.equations :], 0.0)
        return ConeOptimum(s, self._forces(), prices, bound_prices, self.settled)

    def _forces(self) -> Array:
        """Forces (N, c, 3) of the basic solutions: sums of edges."""
        forces = np.zeros((len(self.b), self.contacts, 3))
        for column in range(self.kind.shape[1]):
            kind = self.kind[:, column]
            rows = np.flatnonzero((kind >= 0) & (kind < self.contacts))
            forces[rows, kind[rows]] += self.x[rows, column, None] * self.edge[rows, column]
        return np.asarray(forces * self.size[..., None])

    def _improve(self, live: Array, *, phase: int) -> Array:
        """Exchange columns of the rows ``live`` while this improves them; returns a mask (N,) of rows that are unbounded."""
        unbounded = np.zeros(len(self.b), bool)
        for _ in range(_MAX_EXCHANGES):
            if not len(live):
                return unbounded
            is_regular = np.abs(np.linalg.det(self.basis[live])) > 0.0
            self.settled[live[~is_regular]] = False
            live = live[is_regular]
            inverse = np.linalg.inv(self.basis[live])
            self.x[live] = (inverse @ self.b[live][..., None])[..., 0]
            y = (self._costs(live, phase)[:, None, :] @ inverse)[:, 0]
            self.prices[live] = y
            gain, direction = self._gains(live, y, phase)
            column = gain.argmax(axis=1)
            pays = gain.max(axis=1) > _MIN_GAIN * (1.0 + np.abs(y).max(axis=1))
            live, column, inverse, direction = live[pays], column[pays], inverse[pays], direction[pays]
            entering, edge = self._entering_columns(live, column, direction)
            decrease = (inverse @ entering[..., None])[..., 0]
            leaving, bounded = self._leaving(live, decrease, phase)
            unbounded[live[~bounded]] = True
            live, leaving, column = live[bounded], leaving[bounded], column[bounded]
            self.basis[live, :, leaving] = entering[bounded]
            self.kind[live, leaving] = column
            self.edge[live, leaving] = edge[bounded]
        self.settled[live] = False
        return unbounded

    def _costs(self, live: Array, phase: int) -> Array:
        """Value (rows, m + k) of a unit of each basic column in what a phase makes largest."""
        artificial_cost = -1.0 if phase == 1 else -_ARTIFICIAL_PRICE
        kind = self.kind[live]
        costs = np.where(kind == self.growth, self._growth_cost(phase), 0.0)
        return np.where(kind == self.artificial, artificial_cost, costs)

    def _growth_cost(self, phase: int) -> float:
        """Value of a unit of s in what a phase makes largest."""
        if phase == 1:
            return 0.0
        return 1.0 if self.sense == "most" else -1.0

    def _gains(self, live: Array, y: Array, phase: int) -> tuple[Array, Array]:
        """Gain (rows, columns) of the best edge of each contact, of growth and of slacks; tangential directions v_t / |v_t|."""
        n, friction = self.cones.normals, self.friction[live]
        v = np.einsum("nmck,nm->nck", self.G[live], y)
        v_n = (v * n).sum(axis=-1)
        v_t = v - v_n[..., None] * n
        sliding_speed = np.linalg.norm(v_t, axis=-1)
        edge_gains = np.where(self.active[live], friction * sliding_speed - v_n, -np.inf)
        growth_gain = (self._growth_cost(phase) + (y * self.d[live]).sum(axis=-1)) / self.rate[live]
        if not self.sense or (phase == 1 and self.sense == "most"):  # growth does not enter: s stays 0
            growth_gain = np.full(len(live), -np.inf)
        slack_gains = -y @ self.slack_columns.T
        gains = np.concatenate([edge_gains, growth_gain[:, None], slack_gains], axis=1)
        return gains, v_t / np.maximum(sliding_speed, 1e-14)[..., None]

    def _entering_columns(self, live: Array, column: Array, direction: Array) -> tuple[Array, Array]:
        """Entering columns (rows, m + k), and the edge forces (rows, 3) of those that are contacts."""
        c = self.contacts
        edge = np.zeros((len(live), 3))
        entering = np.zeros((len(live), self.G.shape[1]))
        if c:
            i = np.minimum(column, c - 1)
            edge = self.cones.normals[i] - self.friction[live, i][:, None] * direction[np.arange(len(live)), i]
            entering = np.einsum("nmk,nk->nm", self.G[live, :, i], edge)
        entering = np.where((column == c)[:, None], -self.d[live], entering)
        if len(self.slack_columns):
            slack = np.maximum(column - c - 1, 0)
            entering = np.where((column > c)[:, None], self.slack_columns[slack], entering)
        return entering, np.where((column < c)[:, None], edge, 0.0)

    def _leaving(self, live: Array, decrease: Array, phase: int) -> tuple[Array, Array]:
        """Position in the basis of the column that leaves, and False for rows in which none leaves.

        ``decrease`` (rows, m + k) is that of the basic columns for a unit of the entering one. Of those that reach zero
        nearly first, the one with the largest pivot leaves (Harris' ratio test). In the second phase, artificial columns
        at zero leave at once.
        """
        x = self.x[live]
        leaves_at_once = (self.kind[live] == self.artificial) & (x <= _MAX_ZERO) & (np.abs(decrease) > _MIN_GAIN)
        leaves_at_once &= phase == 2
        falls = decrease > _MIN_PIVOT
        divisor = np.where(falls, decrease, 1.0)
        ratio = np.where(falls, np.maximum(x, 0.0) / divisor, np.inf)
        ratio = np.where(leaves_at_once, 0.0, ratio)
        relaxed_ratio = np.where(falls, (np.maximum(x, 0.0) + _MAX_BELOW_ZERO) / divisor, np.inf)
        largest_ratio = np.where(leaves_at_once, 0.0, relaxed_ratio).min(axis=1)
        is_near = ratio <= largest_ratio[:, None]
        return np.where(is_near, np.abs(decrease), -1.0).argmax(axis=1), np.isfinite(largest_ratio)


# ── Forces of least norm


def least_norm_in_cones(
    cones: Cones, maps: Array, b: Array, active: Array, bounds: ForceBounds | None = None
) -> tuple[Array, Array]:
    """Forces (N, c, 3) of least norm in the cones with Σ G_i f_i = b and Σ H_i f_i ≤ h, and a mask of rows with such forces.

    The dual of min ½ |f|² is smooth: f = P(G' y - H' z), where P projects onto the cones and z ≥ 0. It is solved by projected
    Newton steps of the whole batch, with a backtracking search along each. If forces only just balance, the dual may have no
    solution; such rows are not found.

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
    size = np.abs(b if m else bounds.most).max(axis=1, initial=0.0, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    target = np.concatenate([b, -bounds.most / row_norms[:, m:, 0]], axis=1) / size
    one_sided = np.arange(A.shape[1]) >= m
    y = np.zeros(target.shape)
    G = A[:, :m]
    y[:, :m] = (np.linalg.pinv(G @ G.swapaxes(1, 2), hermitian=True) @ target[:, :m, None])[..., 0]
    forces = np.zeros((N, c, 3))
    solved = np.zeros(N, bool)
    live = np.arange(N)  # rows that are not solved yet
    for _ in range(_MAX_NEWTON_STEPS):
        f, slope = _projection(cones.of(live), (A[live].swapaxes(1, 2) @ y[live][..., None]).reshape(len(live), c, 3))
        forces[live] = f
        residual = target[live] - (A[live] @ f.reshape(len(live), 3 * c, 1))[..., 0]
        slack = one_sided & (y[live] <= 0.0) & (residual <= 0.0)  # bounds that hold without a price
        residual = np.where(slack, 0.0, residual)
        error = np.abs(residual).max(axis=1, initial=0.0)
        solved[live] = error <= _MAX_RESIDUAL
        goes_on = error > _CONVERGED_RESIDUAL
        live, residual, slope, slack = live[goes_on], residual[goes_on], slope[goes_on], slack[goes_on]
        error = error[goes_on]
        if not len(live):
            break
        A_by_contact = A[live].reshape(len(live), -1, c, 3)
        H = np.einsum("nmci,ncij,nkcj->nmk", A_by_contact, slope, A_by_contact)
        H = np.where(slack[:, :, None] | slack[:, None, :], 0.0, H)
        damping = np.maximum(_DAMPING * np.minimum(error, 1.0), 1e-12) * (1.0 + np.trace(H, axis1=1, axis2=2))
        H += damping[:, None, None] * np.eye(H.shape[1])
        step = np.linalg.solve(H, residual[..., None])[..., 0]
        y[live] = _line_search(cones.of(live), A[live], target[live], y[live], step, residual, one_sided)
    return forces * size[..., None] * active[..., None], solved


def _line_search(cones: Cones, A: Array, b: Array, y: Array, step: Array, gradient: Array, one_sided: Array) -> Array:
    """Prices after the largest share of each step that raises the dual b · y - ½ |P(A' y)|² enough (Armijo's rule)."""

    def dual(prices: Array) -> Array:
        f, _ = _projection(cones, (A.swapaxes(1, 2) @ prices[..., None]).reshape(len(prices), A.shape[2] // 3, 3))
        return np.asarray((b * prices).sum(axis=1) - 0.5 * (f**2).sum(axis=(1, 2)))

    share = np.ones((len(y), 1))
    start = dual(y)
    for _ in range(_MAX_HALVINGS):
        after = y + share * step
        after = np.where(one_sided, np.maximum(after, 0.0), after)
        linear_rise = (gradient * (after - y)).sum(axis=1)
        rises_too_little = dual(after) < start + 1e-4 * linear_rise - 1e-14 * (1.0 + np.abs(start))
        if not rises_too_little.any():
            break
        share[rises_too_little] *= 0.5
    return after


def _projection(cones: Cones, f: Array) -> tuple[Array, Array]:
    """Nearest forces in the cones (N, c, 3), and the derivative of the projection (N, c, 3, 3).

    Forces in a cone stay, those in its polar cone become zero, and all others are projected onto the nearest edge.
    """
    n, friction = cones.normals, cones.friction
    f_n = (f * n).sum(axis=-1)
    f_t = f - f_n[..., None] * n
    tangential = np.linalg.norm(f_t, axis=-1)
    inside = ((tangential <= friction * f_n) & (f_n >= 0))[..., None]  # without friction both sides are zero
    polar = (f_n <= -friction * tangential)[..., None]
    u = f_t / np.maximum(tangential, 1e-300)[..., None]
    edge = (n + friction[..., None] * u) / np.sqrt(1.0 + friction**2)[..., None]
    along_edge = (f * edge).sum(axis=-1)[..., None]
    nearest = np.where(inside, f, np.where(polar, 0.0, along_edge * edge))
    # Derivative on an edge: along the edge, and by its turn about the normal, along the third direction n × u.
    third_direction = np.eye(3) - n[:, :, None] * n[:, None, :] - u[..., :, None] * u[..., None, :]
    turn_factor = friction / np.sqrt(1.0 + friction**2) * along_edge[..., 0] / np.maximum(tangential, 1e-300)
    on_edge = edge[..., :, None] * edge[..., None, :] + turn_factor[..., None, None] * third_direction
    slope = np.where(inside[..., None], np.eye(3), np.where(polar[..., None], 0.0, on_edge))
    return nearest, slope
