"""Search for exciting trajectories: windowed Fourier series, Fisher information, constraints by an augmented Lagrangian.

With the distance s from each edge at each instant, as a share of the edge's size, and its target s_0, a search
minimises

    cost + Σ (max(0, λ - ρ (s - s_0))² - λ²) / 2 ρ,      λ ← max(0, λ - ρ (s - s_0)) after each search

Source: Nocedal and Wright, "Numerical Optimization", 2nd ed. 2006, 17.4 (Hestenes, Powell, Rockafellar).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.typing import Array
from ...mechanics.model.limits import Limits
from ...robot import Robot
from ..parameters import turning_joints
from .fourier_series import WindowedFourierSeries
from .motion_information import MotionInformation
from .trajectory_constraints import MAX_CHECK_STEP, TrajectoryConstraints, half_and_middle


def typical_sizes(robot: Robot, bounds: Limits, series: WindowedFourierSeries) -> tuple[Array, Array]:
    """Typical positions, velocities and accelerations (3, nv), and middle positions (nv,)."""
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    rate = 2.0 * np.pi * series.harmonics / series.duration
    wide = np.where(both, half, np.where(turning_joints(robot.model), np.pi, 1.0))
    fast = np.minimum(bounds.velocity, wide * rate)
    typical = np.stack([wide, fast, np.minimum(bounds.acceleration, fast * rate)])
    return typical, np.where(both, middle, np.clip(0.0, bounds.lower, bounds.upper))


@dataclass(frozen=True, eq=False)
class LimitBarrier:
    """Penalty and multipliers of the augmented Lagrangian at the instants of a search."""

    multipliers: Array  # (n, e), λ of each edge; or (1, 1) if all are equal
    rho: float = 1.0  # ρ
    aim: float = 2e-3  # s_0
    finer: int = 1  # factor of the number of instants

    def cost_and_forces(self, shares: Array) -> tuple[float, Array]:
        """Cost, and forces (n, e): its negative derivative by the shares (n, e)."""
        forces = np.maximum(0.0, self.multipliers - self.rho * (shares - self.aim))
        return float((forces**2 - self.multipliers**2).sum()) / (2.0 * self.rho), forces

    def refine(self, finer: int) -> LimitBarrier:
        """Interpolate the multipliers to ``finer`` times as many instants, with the same sum."""
        if finer == self.finer:
            return self
        times, count = finer // self.finer, len(self.multipliers)
        at = np.arange(times * (count - 1) + 1) / times
        spread = [np.interp(at, np.arange(count), one) / times for one in self.multipliers.T]
        return replace(self, multipliers=np.stack(spread, axis=1), finer=finer)


# The search minimises  -merit  with multipliers of all limits at a few hundred instants (:class:`LimitBarrier`) by
# SciPy's L-BFGS-B; then the multipliers are updated and the penalty ρ grows. The best of several searches is refined at
# more instants. Coefficients z are scaled so that each moves a joint by 1, in shares of its limits (root mean square).
# Derivatives of torques and regressor by the states use reverse mode, those of distances the forces at the nearest
# points. Derivatives by z follow, because states are linear in z.

_PER_PERIOD = 16  # instants per period of the highest harmonic at which the search evaluates limits
_FINER = 20  # minimum refinement of the instants for the final check
_MARGIN = 1e-4  # share of each limit kept as a margin for times between instants
_OF_MERIT = 2  # refinement of the instants at which the merit is evaluated
_ROUNDS = ((5.0, 60, 1), (20.0, 50, 1), (80.0, 50, 2), (320.0, 50, 2))
"""Rounds of each search with fixed multipliers: penalty ρ, maximum number of steps, and refinement of the instants."""
_BY_LOG_DET = 2  # number of rounds that use log det, for any criterion
_LAST = (1000.0, 40, 8)
"""Last round, for the best search only."""
_REPAIRS = 7  # maximum number of repetitions of the last round
_STARTS = 20  # number of random motions, the best of which starts a search
_TRIES = 400
_MIN_WIDTH = 0.02  # share of a motion's initial width below which it counts as infeasible
_HALVINGS = 12

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class MotionSearch:
    """Search for the best motion of one robot."""

    series: WindowedFourierSeries
    information: MotionInformation
    constraints: TrajectoryConstraints
    typical: Array  # (3, nv), typical positions, velocities and accelerations
    middle: Array  # (nv,), middle positions of the joints

    @cached_property
    def _bases(self) -> dict[int, Array]:
        """Bases by their refinement of the instants."""
        return {}

    @property
    def _fine(self) -> int:
        return max(_FINER, math.ceil(self.series.duration / (MAX_CHECK_STEP * _PER_PERIOD * self.series.harmonics)))

    def _basis(self, finer: int) -> Array:
        """(3, n, K) basis at the instants of the search, or at ``finer`` times as many."""
        if finer not in self._bases:
            count = finer * _PER_PERIOD * self.series.harmonics + 1
            self._bases[finer] = self.series.basis(np.linspace(0.0, self.series.duration, count))
        return self._bases[finer]

    @cached_property
    def _units(self) -> Array:
        """(nv, K, K) coefficients per unit of z: V / S of [Φ / q, Φ' / dq, Φ'' / ddq] / sqrt(n) = U S V'; q_0 apart."""
        found = np.zeros((self.typical.shape[1], self.series.count, self.series.count))
        basis = self._basis(1)
        for j, sizes in enumerate(self.typical.T):
            stacked = (basis[:, :, 1:] / sizes[:, None, None]).reshape(-1, self.series.count - 1)
            _, s, Vt = np.linalg.svd(stacked / np.sqrt(basis.shape[1]), full_matrices=False)
            found[j, 0, 0] = sizes[0]
            found[j, 1:, 1:] = Vt.T / s
        return found

    def coefficients(self, z: Array) -> Array:
        """(nv, K) coefficients of the series, from scaled ones (nv, K)."""
        found = np.einsum("jkl,jl->jk", self._units, z)
        found[:, 0] += self.middle
        return np.asarray(found)

    def _states(self, z: Array, finer: int = 1) -> Array:
        """(3, n, nv) positions, velocities and accelerations."""
        return np.asarray(self._basis(finer) @ self.coefficients(z).T)

    def merit(self, z: Array) -> float:
        """Objective at the instants of the search, to be maximised."""
        return self.information.merit_and_slope(self.information.rows(*self._states(z, _OF_MERIT)))[0]

    # ── motions that fit ──

    def random(self, rng: np.random.Generator) -> Array | None:
        """Random motion (nv, K) as wide as the limits allow at the instants of the search; None after many failures.

        Each joint is scaled to its own limits; then all are narrowed together.
        """
        b = self.constraints.bounds
        for _ in range(_TRIES):
            z = rng.normal(size=(len(self.middle), self.series.count))
            z[:, 0] = rng.uniform(-0.6, 0.6, len(z))
            (q, dq, ddq), q_rest = self._states(z), self.coefficients(z)[:, 0]
            limits = np.stack([b.upper - q_rest, q_rest - b.lower, b.velocity, b.acceleration])
            peaks = np.stack([q - q_rest, q_rest - q, np.abs(dq), np.abs(ddq)]).max(axis=1)
            width = (limits / np.maximum(peaks, 1e-12)).min(axis=0)
            z[:, 1:] *= (1.0 - 2.0 * _MARGIN) * width[:, None]
            motion = self.narrow_to_limits(z, 1)
            if motion is not None:
                return motion
        return None

    def narrow_to_limits(self, z: Array, finer: int) -> Array | None:
        """Narrow the motion about its rest position until all limits hold; None if the rest position violates limits."""

        def with_width(share: float) -> Array:
            motion = z.copy()
            motion[:, 1:] *= share
            return motion

        def fits(share: float) -> bool:
            return self.constraints.least(self._states(with_width(share), finer)) >= _MARGIN

        if fits(1.0):
            return z
        if self.constraints.least(self._states(with_width(0.0))[:, :1]) < _MARGIN or not fits(_MIN_WIDTH):
            return None
        low, high = _MIN_WIDTH, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            if fits(share):
                low = share
            else:
                high = share
        return with_width(low)

    # ── the search ──

    def best(self, times: int, rng: np.random.Generator, progress: Progress) -> Array | None:
        """Best motion of ``times`` searches, each from its own random motions; None if no motion is feasible."""
        found = list[tuple[float, Array, Array, LimitBarrier]]()
        first = replace(self, information=replace(self.information, criterion="log_det"))  # fewer local optima
        for k in range(times):
            start = first._start(rng)
            if start is None:
                return None
            z, barrier = start, LimitBarrier(np.zeros((1, 1)))
            for n, (rho, steps, finer) in enumerate(_ROUNDS, 1):
                search = first if n <= _BY_LOG_DET else self
                z, barrier = search._descend(z, replace(barrier, rho=rho).refine(finer), steps)
                progress((k + n / len(_ROUNDS)) / (times + 1))
            narrowed = self.narrow_to_limits(z, 1)
            found.append((-np.inf if narrowed is None else self.merit(narrowed), start, z, barrier))
        _, start, z, barrier = max(found, key=lambda one: one[0])
        finished = self.narrow_to_limits(self._finish(z, barrier), self._fine)
        narrowed_start = self.narrow_to_limits(start, self._fine)
        progress(1.0)
        return self._better(finished, narrowed_start)

    def _better(self, first: Array | None, second: Array | None) -> Array | None:
        """Motion with the larger merit, the first of equal ones; None if neither is feasible."""
        if first is None or second is None:
            return second if first is None else first
        return second if self.merit(second) > self.merit(first) else first

    def _start(self, rng: np.random.Generator) -> Array | None:
        """Best of several random motions; None if none is feasible."""
        best = self.random(rng)
        if best is None:
            return None
        for _ in range(_STARTS):
            best = self._better(best, self.random(rng))
        return best

    def _finish(self, z: Array, barrier: LimitBarrier) -> Array:
        """Refine the motion at many instants, with a larger margin as long as it violates a limit between the instants."""
        rho, steps, finer = _LAST
        barrier = replace(barrier, rho=rho).refine(finer)
        for _ in range(_REPAIRS):
            z, barrier = self._descend(z, barrier, steps)
            beyond = _MARGIN - self.constraints.least(self._states(z, self._fine))
            if beyond <= 0.0:
                break
            barrier = replace(barrier, aim=barrier.aim + 1.5 * beyond)
        return z

    def _descend(self, z: Array, barrier: LimitBarrier, steps: int) -> tuple[Array, LimitBarrier]:
        """Motion after at most ``steps`` steps, and the barrier with updated multipliers."""
        from scipy.optimize import minimize

        options: Any = {"maxiter": steps, "maxcor": 30, "ftol": 1e-9, "gtol": 1e-4}
        found = minimize(self.cost_and_slope, z.ravel(), (barrier,), "L-BFGS-B", jac=True, options=options)
        z = np.reshape(found.x, z.shape)
        shares, _ = self.constraints.evaluate(self._states(z, barrier.finer), smooth=True)
        return z, replace(barrier, multipliers=barrier.cost_and_forces(shares)[1])

    def cost_and_slope(self, z: Array, barrier: LimitBarrier) -> tuple[float, Array]:
        """-merit plus the cost of the edges, and its derivative by z (nv K,)."""
        z = z.reshape(len(self.middle), -1)
        states = self._states(z, _OF_MERIT)
        merit, G = self.information.merit_and_slope(self.information.rows(*states))
        shares, pullback = self.constraints.evaluate(self._states(z, barrier.finer), smooth=True)
        cost, forces = barrier.cost_and_forces(shares)
        by_states = self.information.slopes(states, -G)
        slope = np.zeros_like(z)
        slope += np.einsum("mnj,mnk->jk", by_states, self._basis(_OF_MERIT), optimize=True)
        slope += np.einsum("mnj,mnk->jk", pullback(-forces), self._basis(barrier.finer), optimize=True)
        return cost - merit, np.einsum("jk,jkl->jl", slope, self._units).ravel()
