"""Linear programmes over friction cones: a revised simplex method for many rows at once, priced from the true cones.

The programme of each row is: largest or least s ≥ 0 with Σ G_i f_i = b + s d and every f_i in its cone. Its columns are the
edges of the cones, of which there are infinitely many. With the prices y the edge that enters is known: contact i
moves at v = G_i' y, and its best edge is n - μ v_t / |v_t|. So no pyramid stands for the cone. If no forces balance b, the
prices of the first phase are the motion of Farkas' lemma: n · v ≥ μ |v_t| at every contact, and y · b < 0.

Source: Dantzig and Wolfe, Decomposition principle for linear programs, 1960 (column generation); Modern Robotics, section 12.2.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from ..core.typing import Array

_ROWS = 4096
"""Rows of one batch."""
_STEPS = 400
"""Exchanges of the basis, after which a row is undecided."""
_GAIN = 1e-9
"""Gain of an edge, relative to the prices, below which it does not enter."""
_MAX_ARTIFICIAL_SUM = 1e-7
"""Sum of artificial columns, relative to the load, below which the first phase has succeeded."""
_PIVOT, _ZERO = 1e-10, 1e-11
"""Least pivot of a ratio test, and largest value of a basic column that counts as zero."""
_MAX_BELOW_ZERO = 1e-11
"""Value below zero, relative to the load, that a basic column may reach for the sake of a larger pivot."""
_ARTIFICIAL = 1e3
"""Price of artificial columns in the second phase."""
_MAX_RESIDUAL = 1e-9
"""Load that forces of least norm may leave over, relative to the load, where the last steps do not bring it down further."""
_DAMPING = 1e-3
"""Damping of Newton steps, relative to the load left over: where all contacts leave the cones, the slope is singular."""
_NEWTON = 60
"""Newton steps, after which forces of least norm are not found."""
_MIN_LOAD_OF_GROWTH = 1e-6
"""Load relative to its growth below which the growth scales the row."""

Sense = Literal["most", "least"]


@dataclass(frozen=True, eq=False)
class Cones:
    """Friction cones of c contacts."""

    normals: Array
    """(c, 3)"""
    friction: Array
    """(c,), or (N, c) if each row has its own."""

    def of(self, rows: Any) -> Cones:
        """Cones of some of the rows."""
        if self.friction.ndim == 1:
            return self
        return Cones(self.normals, self.friction[rows])


@dataclass(frozen=True, eq=False)
class ForceBounds:
    """Inequalities Σ H_i f_i ≤ h + s r, as of fingers with a largest force, or of joints with a largest torque."""

    maps: Array
    """(N, k, c, 3): H_i of each row."""
    most: Array
    """(N, k): h."""
    rate: Array
    """(N, k): r, which is zero for bounds that do not grow."""

    def of(self, rows: Any) -> ForceBounds:
        """ForceBounds of some of the rows."""
        return ForceBounds(self.maps[rows], self.most[rows], self.rate[rows])

    def concatenate(self, other: ForceBounds) -> ForceBounds:
        """These bounds and those of another of the same rows."""
        pairs = ((self.maps, other.maps), (self.most, other.most), (self.rate, other.rate))
        return ForceBounds(*(np.concatenate(pair, axis=1) for pair in pairs))


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
    b : (N, m) array
    d : (N, m) array, optional; None: only whether forces balance b
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
    for start in range(0, max(N, 1), _ROWS):
        part = slice(start, start + _ROWS)
        simplex = _Simplex(
            cones.of(part), maps[part], b[part], d[part], bounds.of(part), active[part], sense if grows else None
        )
        optima.append(simplex.solve())

    def all_rows(name: str) -> Array:
        return np.concatenate([getattr(optimum, name) for optimum in optima])

    return ConeOptimum(*(all_rows(field.name) for field in fields(ConeOptimum)))


def no_bounds(rows: int, contacts: int) -> ForceBounds:
    """ForceBounds of nothing."""
    return ForceBounds(np.zeros((rows, 0, contacts, 3)), np.zeros((rows, 0)), np.zeros((rows, 0)))


def two_sided(maps: Array, load: Array, most: Array, rate: Array) -> ForceBounds:
    """ForceBounds abs(load + Σ G_i f_i) ≤ most + s rate; (N, m, c, 3) and (N, m): the upper ones first."""
    return ForceBounds(maps, most - load, rate).concatenate(ForceBounds(-maps, most + load, rate))


class _Simplex:
    """Bases of a batch of programmes; m columns each, of one kind: contact, growth, slack or artificial."""

    def __init__(
        self, cones: Cones, maps: Array, b: Array, d: Array, bounds: ForceBounds, active: Array, sense: Sense | None
    ) -> None:
        N, m, c, _ = maps.shape
        k = bounds.most.shape[1]
        self.cones, self.active, self.sense, self.contacts = cones, active, sense, c
        self.friction = np.broadcast_to(cones.friction, (N, c))
        self.balanced = m
        self.G = np.concatenate([maps, bounds.maps], axis=1)
        load = np.abs(b if m else bounds.most).max(axis=1, initial=0.0)
        rate = np.abs(d).max(axis=1, initial=0.0)
        size = np.maximum(load, _MIN_LOAD_OF_GROWTH * rate)
        self.size = np.where(size > 0, size, 1.0)[:, None]
        self.b = np.concatenate([b, bounds.most], axis=1) / self.size
        self.d = np.concatenate([d, bounds.rate], axis=1) / self.size
        growth = np.abs(self.d).max(axis=1, initial=0.0)
        self.rate = np.where(growth > 0, growth, 1.0)
        self.unit = np.eye(m + k)[m:]
        self.basis = np.zeros((N, m + k, m + k))
        self.basis[:, range(m + k), range(m + k)] = np.where(self.b < 0, -1.0, 1.0)
        self.x = np.abs(self.b)
        self.artificial, self.growth = -1, c
        self.kind = np.full((N, m + k), self.artificial)
        slacks = self.b[:, m:] >= 0  # bounds that hold without forces: their slacks begin in the basis
        self.kind[:, m:] = np.where(slacks, c + 1 + np.arange(k), self.artificial)
        self.edge = np.zeros((N, m + k, 3))
        self.prices = np.zeros((N, m + k))
        self.settled = np.ones(N, bool)

    def solve(self) -> ConeOptimum:
        """Feasible forces first, then the optimum of rows that have some."""
        self._improve(np.arange(len(self.b)), phase=1)
        artificial_sum = np.where(self.kind == self.artificial, np.maximum(self.x, 0.0), 0.0).sum(axis=1)
        feasible = artificial_sum <= _MAX_ARTIFICIAL_SUM
        unbounded = np.zeros(len(self.b), bool)
        if self.sense:
            unbounded = self._improve(np.flatnonzero(feasible & self.settled), phase=2)
        s = np.where(self.kind == self.growth, self.x, 0.0).sum(axis=1)
        s = np.where(feasible, np.where(unbounded, np.inf, s), np.nan)
        y, z = self.prices[:, : self.balanced], np.maximum(self.prices[:, self.balanced :], 0.0)
        return ConeOptimum(s, self._forces(), y, z, self.settled)

    def _forces(self) -> Array:
        forces = np.zeros((len(self.b), self.contacts, 3))
        for column in range(self.kind.shape[1]):
            kind = self.kind[:, column]
            rows = np.flatnonzero((kind >= 0) & (kind < self.contacts))
            forces[rows, kind[rows]] += self.x[rows, column, None] * self.edge[rows, column]
        return np.asarray(forces * self.size[..., None])

    def _improve(self, live: Array, *, phase: int) -> Array:
        """Exchange columns while one pays; mask of rows that are unbounded."""
        unbounded = np.zeros(len(self.b), bool)
        for _ in range(_STEPS):
            if not len(live):
                return unbounded
            regular = np.abs(np.linalg.det(self.basis[live])) > 0.0
            self.settled[live[~regular]] = False
            live = live[regular]
            inverse = np.linalg.inv(self.basis[live])
            self.x[live] = (inverse @ self.b[live][..., None])[..., 0]
            y = (self._costs(live, phase)[:, None, :] @ inverse)[:, 0]
            self.prices[live] = y
            gain, direction = self._gains(live, y, phase)
            column = gain.argmax(axis=1)
            pays = gain.max(axis=1) > _GAIN * (1.0 + np.abs(y).max(axis=1))
            live, column, inverse, direction = live[pays], column[pays], inverse[pays], direction[pays]
            entering, edge = self._column(live, column, direction)
            leaving, bounded = self._leaving(live, (inverse @ entering[..., None])[..., 0], phase)
            unbounded[live[~bounded]] = True
            live, leaving, column = live[bounded], leaving[bounded], column[bounded]
            self.basis[live, :, leaving] = entering[bounded]
            self.kind[live, leaving] = column
            self.edge[live, leaving] = edge[bounded]
        self.settled[live] = False
        return unbounded

    def _costs(self, live: Array, phase: int) -> Array:
        artificial_cost = -1.0 if phase == 1 else -_ARTIFICIAL
        kind = self.kind[live]
        return np.where(
            kind == self.artificial, artificial_cost, np.where(kind == self.growth, self._growth_cost(phase), 0.0)
        )

    def _growth_cost(self, phase: int) -> float:
        if phase == 1:
            return 0.0
        return 1.0 if self.sense == "most" else -1.0

    def _gains(self, live: Array, y: Array, phase: int) -> tuple[Array, Array]:
        """Gain (rows, columns) of the best edge of each contact, of growth and of slacks; tangential directions."""
        n, friction = self.cones.normals, self.friction[live]
        v = np.einsum("nmck,nm->nck", self.G[live], y)
        along = (v * n).sum(axis=-1)
        across = v - along[..., None] * n
        slide = np.linalg.norm(across, axis=-1)
        edges = np.where(self.active[live], friction * slide - along, -np.inf)
        growth = (self._growth_cost(phase) + (y * self.d[live]).sum(axis=-1)) / self.rate[live]
        if not self.sense or (phase == 1 and self.sense == "most"):
            growth = np.full(len(live), -np.inf)
        slacks = -y @ self.unit.T
        return np.concatenate([edges, growth[:, None], slacks], axis=1), across / np.maximum(slide, 1e-14)[..., None]

    def _column(self, live: Array, column: Array, direction: Array) -> tuple[Array, Array]:
        """Entering columns (rows, m), and the edge forces (rows, 3) of those that are contacts."""
        c = self.contacts
        edge, entering = np.zeros((len(live), 3)), np.zeros((len(live), self.G.shape[1]))
        if c:
            i = np.minimum(column, c - 1)
            edge = self.cones.normals[i] - self.friction[live, i][:, None] * direction[np.arange(len(live)), i]
            entering = np.einsum("nmk,nk->nm", self.G[live, :, i], edge)
        entering = np.where((column == c)[:, None], -self.d[live], entering)
        if len(self.unit):
            entering = np.where((column > c)[:, None], self.unit[np.maximum(column - c - 1, 0)], entering)
        return entering, np.where((column < c)[:, None], edge, 0.0)

    def _leaving(self, live: Array, step: Array, phase: int) -> tuple[Array, Array]:
        """Column that leaves, with the largest pivot of those with nearly the least ratio (Harris); False where none does."""
        x = self.x[live]
        stays = (self.kind[live] == self.artificial) & (x <= _ZERO) & (np.abs(step) > _GAIN) & (phase == 2)
        falls = step > _PIVOT
        ratio = np.where(falls, np.maximum(x, 0.0) / np.where(falls, step, 1.0), np.inf)
        ratio = np.where(stays, 0.0, ratio)
        relaxed = np.where(falls, (np.maximum(x, 0.0) + _MAX_BELOW_ZERO) / np.where(falls, step, 1.0), np.inf)
        largest_ratio = np.where(stays, 0.0, relaxed).min(axis=1)
        near = ratio <= largest_ratio[:, None]
        return np.where(near, np.abs(step), -1.0).argmax(axis=1), np.isfinite(largest_ratio)


# ── Forces of least norm


def least_norm_in_cones(
    cones: Cones, maps: Array, b: Array, active: Array, bounds: ForceBounds | None = None
) -> tuple[Array, Array]:
    """Forces (N, c, 3) of least norm in the cones with Σ G_i f_i = b and Σ H_i f_i ≤ h, and a mask of rows with such forces.

    The dual of min ½ |f|² is smooth: f = P(G' y - H' z), where P projects onto the cones and z ≥ 0. It is solved by projected
    Newton steps of the whole batch, with a backtracking search along each. Where forces balance at the edge of what is
    possible, the dual may have no solution; such rows are not found.

    Source: Bertsekas, Projected Newton methods for optimization problems with simple constraints, 1982.
    """
    N, m, c, _ = maps.shape
    if bounds is None:
        bounds = no_bounds(N, c)
    A = np.concatenate([maps, -bounds.maps], axis=1) * active[:, None, :, None]
    A = A.reshape(N, A.shape[1], 3 * c)
    unit = np.linalg.norm(A, axis=2, keepdims=True)
    unit[:, :m] = 1.0
    A = A / np.where(unit > 0, unit, 1.0)
    size = np.abs(b if m else bounds.most).max(axis=1, initial=0.0, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    target = np.concatenate([b, -bounds.most / np.where(unit[:, m:, 0] > 0, unit[:, m:, 0], 1.0)], axis=1) / size
    one_sided = np.arange(A.shape[1]) >= m
    y = np.zeros(target.shape)
    y[:, :m] = (np.linalg.pinv(A[:, :m] @ A[:, :m].swapaxes(1, 2), hermitian=True) @ target[:, :m, None])[..., 0]
    forces, solved, live = np.zeros((N, c, 3)), np.zeros(N, bool), np.arange(N)
    for _ in range(_NEWTON):
        f, slope = _projection(cones.of(live), (A[live].swapaxes(1, 2) @ y[live][..., None]).reshape(len(live), c, 3))
        forces[live] = f
        residual = target[live] - (A[live] @ f.reshape(len(live), 3 * c, 1))[..., 0]
        slack = one_sided & (y[live] <= 0.0) & (residual <= 0.0)
        residual = np.where(slack, 0.0, residual)
        error = np.abs(residual).max(axis=1, initial=0.0)
        done = error <= 1e-12
        solved[live] = error <= _MAX_RESIDUAL
        live, residual, slope, slack, error = live[~done], residual[~done], slope[~done], slack[~done], error[~done]
        if not len(live):
            break
        K = A[live].reshape(len(live), -1, c, 3)
        H = np.einsum("nmci,ncij,nkcj->nmk", K, slope, K)
        H = np.where(slack[:, :, None] | slack[:, None, :], 0.0, H)
        damping = np.maximum(_DAMPING * np.minimum(error, 1.0), 1e-12) * (1.0 + np.trace(H, axis1=1, axis2=2))
        H += damping[:, None, None] * np.eye(H.shape[1])
        step = np.linalg.solve(H, residual[..., None])[..., 0]
        y[live] = _line_search(cones.of(live), A[live], target[live], y[live], step, residual, one_sided)
    return forces * size[..., None] * active[..., None], solved


def _line_search(cones: Cones, A: Array, b: Array, y: Array, step: Array, gradient: Array, one_sided: Array) -> Array:
    """Prices after the largest share of each step that raises the dual b · y - ½ |P(A' y)|² enough (Armijo's rule)."""

    def dual(at: Array) -> Array:
        f, _ = _projection(cones, (A.swapaxes(1, 2) @ at[..., None]).reshape(len(at), A.shape[2] // 3, 3))
        return np.asarray((b * at).sum(axis=1) - 0.5 * (f**2).sum(axis=(1, 2)))

    share, start = np.ones((len(y), 1)), dual(y)
    for _ in range(30):
        after = y + share * step
        after = np.where(one_sided, np.maximum(after, 0.0), after)
        rise = (gradient * (after - y)).sum(axis=1)
        short = dual(after) < start + 1e-4 * rise - 1e-14 * (1.0 + np.abs(start))
        if not short.any():
            break
        share[short] *= 0.5
    return after


def _projection(cones: Cones, f: Array) -> tuple[Array, Array]:
    """Nearest forces in the cones (N, c, 3), and the derivative of the projection (N, c, 3, 3)."""
    n, friction = cones.normals, cones.friction
    along = (f * n).sum(axis=-1)
    across = f - along[..., None] * n
    slide = np.linalg.norm(across, axis=-1)
    inside = ((slide <= friction * along) & (along >= 0))[..., None]  # without friction both sides are zero
    polar = (along <= -friction * slide)[..., None]
    u = across / np.maximum(slide, 1e-300)[..., None]
    edge = (n + friction[..., None] * u) / np.sqrt(1.0 + friction**2)[..., None]
    along_edge = (f * edge).sum(axis=-1)[..., None]
    nearest = np.where(inside, f, np.where(polar, 0.0, along_edge * edge))
    turns = np.eye(3) - n[:, :, None] * n[:, None, :] - u[..., :, None] * u[..., None, :]
    lean = friction / np.sqrt(1.0 + friction**2) * along_edge[..., 0] / np.maximum(slide, 1e-300)
    on_edge = edge[..., :, None] * edge[..., None, :] + lean[..., None, None] * turns
    slope = np.where(inside[..., None], np.eye(3), np.where(polar[..., None], 0.0, on_edge))
    return nearest, slope
