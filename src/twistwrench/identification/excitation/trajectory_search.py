"""Search for exciting trajectories: windowed Fourier series, Fisher information, constraints by an augmented Lagrangian.

With the distance s from each edge at each instant, as a share of the edge's size, and its least value s_0, a search
minimises

    -merit + Σ (max(0, λ - ρ (s - s_0))² - λ²) / 2 ρ,      λ ← max(0, λ - ρ (s - s_0)) after each search

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
    """Typical sizes of positions, velocities and accelerations (3, nv), and middle positions (nv,).

    The typical velocities and accelerations are those of the highest harmonic, within the limits.
    """
    half_range, middle = half_and_middle(bounds)
    has_both_limits = np.isfinite(half_range)
    rate = 2.0 * np.pi * series.harmonics / series.duration  # of the highest harmonic [rad/s]
    unlimited_size = np.where(turning_joints(robot.model), np.pi, 1.0)  # half a turn, or 1 m
    position = np.where(has_both_limits, half_range, unlimited_size)
    velocity = np.minimum(bounds.velocity, position * rate)
    acceleration = np.minimum(bounds.acceleration, velocity * rate)
    nearest_to_0 = np.clip(0.0, bounds.lower, bounds.upper)
    middle_position = np.where(has_both_limits, middle, nearest_to_0)
    return np.stack([position, velocity, acceleration]), middle_position


@dataclass(frozen=True, eq=False)
class LimitBarrier:
    """Penalty and multipliers of the augmented Lagrangian at the instants of a search."""

    multipliers: Array  # (n, e), λ of each edge at each instant; or (1, 1) if all are equal
    rho: float = 1.0  # penalty ρ
    aim: float = 2e-3  # least distance s_0 from the edges
    finer: int = 1  # refinement: ratio of the number of steps between instants to that of the first rounds

    def cost_and_forces(self, shares: Array) -> tuple[float, Array]:
        """Cost of the edges, and forces (n, e): its negative derivative by the shares (n, e)."""
        forces = np.maximum(0.0, self.multipliers - self.rho * (shares - self.aim))
        return float((forces**2 - self.multipliers**2).sum()) / (2.0 * self.rho), forces

    def refine(self, finer: int) -> LimitBarrier:
        """Interpolate the multipliers to ``finer`` times as many instants, with the same sum."""
        if finer == self.finer:
            return self
        factor = finer // self.finer
        instant_count = len(self.multipliers)
        old_positions = np.arange(instant_count)
        new_positions = np.arange(factor * (instant_count - 1) + 1) / factor  # of the new instants among the old ones
        refined_columns = [np.interp(new_positions, old_positions, column) / factor for column in self.multipliers.T]
        return replace(self, multipliers=np.stack(refined_columns, axis=1), finer=finer)


# A search has rounds. In each round, SciPy's L-BFGS-B minimises -merit and the cost of all limits at a few hundred instants
# (:class:`LimitBarrier`), with fixed multipliers. After it, the multipliers are updated and the penalty ρ grows. The best of
# several searches is refined at more instants.
#
# Coefficients z are scaled so that each moves a joint by 1, in shares of its limits (root mean square). States are linear in
# z. Their derivatives come from reverse mode for torques and regressor, and from the forces at the nearest points for
# distances.

_STEPS_PER_PERIOD = 16
"""Number of instants per period of the highest harmonic at which the search evaluates limits."""
_MIN_CHECK_REFINEMENT = 20
"""Smallest refinement of the instants for the final check."""
_MARGIN = 1e-4
"""Share of each limit that is not used, as a margin for times between instants."""
_MERIT_REFINEMENT = 2
"""Refinement of the instants at which the merit is evaluated."""
_ROUNDS = (
    (5.0, 60, 1),
    (20.0, 50, 1),
    (80.0, 50, 2),
    (320.0, 50, 2),
)
"""Rounds of each search with fixed multipliers: penalty ρ, maximum number of steps, and refinement of the instants."""
_LOG_DET_ROUNDS = 2
"""Number of first rounds that use log det, for any criterion."""
_LAST_ROUND = (1000.0, 40, 8)
"""Last round, for the best search only."""
_MAX_LAST_ROUNDS = 7
"""Largest number of repetitions of the last round."""
_AIM_PER_VIOLATION = 1.5
"""Increase of the least distance from the edges, relative to a violation after the last round."""
_SEARCH_OPTIONS = {"maxcor": 30, "ftol": 1e-9, "gtol": 1e-4}
"""Options of SciPy's L-BFGS-B: number of stored steps, relative tolerance of the cost, and tolerance of its slope."""
_RANDOM_MOTIONS = 20
"""Number of random motions besides the first; the best one starts a search."""
_MAX_RANDOM_TRIALS = 400
"""Largest number of trials for one random motion."""
_MAX_REST_POSITION = 0.6
"""Largest distance of a random rest position from the middle, relative to the typical size of the position."""
_TINY_PEAK = 1e-12
"""Peak of a motion in place of 0, as a divisor."""
_MIN_WIDTH = 0.02
"""Share of a motion's initial width below which it counts as infeasible."""
_HALVINGS = 12
"""Number of bisection steps for the width."""

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
        """Cache of the bases, by their refinement of the instants."""
        return {}

    @property
    def _check_refinement(self) -> int:
        """Refinement of the instants for the final check, with steps of at most :data:`MAX_CHECK_STEP`."""
        search_steps = _STEPS_PER_PERIOD * self.series.harmonics
        required_refinement = math.ceil(self.series.duration / (MAX_CHECK_STEP * search_steps))
        return max(_MIN_CHECK_REFINEMENT, required_refinement)

    def _basis(self, finer: int) -> Array:
        """(3, n, K) basis at the instants of the search, or at ``finer`` times as many."""
        if finer not in self._bases:
            instant_count = finer * _STEPS_PER_PERIOD * self.series.harmonics + 1
            instants = np.linspace(0.0, self.series.duration, instant_count)
            self._bases[finer] = self.series.basis(instants)
        return self._bases[finer]

    @cached_property
    def _units(self) -> Array:
        """(nv, K, K) coefficients of each joint per unit of z.

        The first z is the rest position, in units of the typical position. The other coefficients per unit of z are V / S,
        by the singular value decomposition [Φ / q, Φ' / dq, Φ'' / ddq] / √n = U S V' of the basis over typical sizes.
        """
        units = np.zeros((self.typical.shape[1], self.series.count, self.series.count))
        basis = self._basis(1)
        for j, sizes in enumerate(self.typical.T):
            stacked = (basis[:, :, 1:] / sizes[:, None, None]).reshape(-1, self.series.count - 1)
            instant_count = basis.shape[1]
            _, S, Vt = np.linalg.svd(stacked / np.sqrt(instant_count), full_matrices=False)
            typical_position, _, _ = sizes
            units[j, 0, 0] = typical_position
            units[j, 1:, 1:] = Vt.T / S
        return units

    def coefficients(self, z: Array) -> Array:
        """(nv, K) coefficients of the series, from scaled ones (nv, K)."""
        coefficients = np.einsum("jkl,jl->jk", self._units, z)
        coefficients[:, 0] += self.middle
        return np.asarray(coefficients)

    def _states(self, z: Array, finer: int = 1) -> Array:
        """(3, n, nv) positions, velocities and accelerations."""
        return np.asarray(self._basis(finer) @ self.coefficients(z).T)

    def merit(self, z: Array) -> float:
        """Objective at the instants of the search, to be maximised."""
        rows = self.information.rows(*self._states(z, _MERIT_REFINEMENT))
        merit, _ = self.information.merit_and_slope(rows)
        return merit

    # ── Motions within the limits

    def random(self, rng: np.random.Generator) -> Array | None:
        """Random motion (nv, K) as wide as the limits allow at the instants of the search; None after many failures.

        Each joint is scaled to its own limits. Then all joints are narrowed together until the common limits hold, too.
        """
        bounds = self.constraints.bounds
        for _ in range(_MAX_RANDOM_TRIALS):
            z = rng.normal(size=(len(self.middle), self.series.count))
            z[:, 0] = rng.uniform(-_MAX_REST_POSITION, _MAX_REST_POSITION, len(z))  # rest positions
            q, dq, ddq = self._states(z)
            q_rest = self.coefficients(z)[:, 0]
            limits = np.stack([bounds.upper - q_rest, q_rest - bounds.lower, bounds.velocity, bounds.acceleration])
            peaks = np.stack([q - q_rest, q_rest - q, np.abs(dq), np.abs(ddq)]).max(axis=1)
            max_width = (limits / np.maximum(peaks, _TINY_PEAK)).min(axis=0)  # of each joint, as a factor
            z[:, 1:] *= (1.0 - 2.0 * _MARGIN) * max_width[:, None]  # twice the margin that is checked
            motion = self.narrow_to_limits(z, 1)
            if motion is not None:
                return motion
        return None

    def narrow_to_limits(self, z: Array, finer: int) -> Array | None:
        """Narrow the motion about its rest position until all limits hold; None if it is not feasible.

        The motion is not feasible if its rest position violates limits, or if it violates limits with 2 % of its width.
        """

        def with_width(share: float) -> Array:
            motion = z.copy()
            motion[:, 1:] *= share
            return motion

        def is_feasible(share: float) -> bool:
            return self.constraints.least(self._states(with_width(share), finer)) >= _MARGIN

        if is_feasible(1.0):
            return z
        rest_state = self._states(with_width(0.0))[:, :1]  # the same at all instants
        if self.constraints.least(rest_state) < _MARGIN or not is_feasible(_MIN_WIDTH):
            return None
        feasible_share = _MIN_WIDTH
        infeasible_share = 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (feasible_share + infeasible_share)
            if is_feasible(share):
                feasible_share = share
            else:
                infeasible_share = share
        return with_width(feasible_share)

    # ── Search

    def best(self, search_count: int, rng: np.random.Generator, progress: Progress) -> Array | None:
        """Best motion of several searches, each from its own random motions; None if no motion is feasible."""
        searches = list[tuple[float, Array, Array, LimitBarrier]]()  # merit, first and last motion, barrier
        log_det_search = replace(self, information=replace(self.information, criterion="log_det"))  # fewer local optima
        for k in range(search_count):
            start = log_det_search._start(rng)
            if start is None:
                return None
            z = start
            barrier = LimitBarrier(np.zeros((1, 1)))
            for round_number, (rho, steps, finer) in enumerate(_ROUNDS, 1):
                search = log_det_search if round_number <= _LOG_DET_ROUNDS else self
                z, barrier = search._descend(z, replace(barrier, rho=rho).refine(finer), steps)
                finished_searches = k + round_number / len(_ROUNDS)
                progress(finished_searches / (search_count + 1))  # and one share for the refinement
            feasible_motion = self.narrow_to_limits(z, 1)
            merit = -np.inf if feasible_motion is None else self.merit(feasible_motion)
            searches.append((merit, start, z, barrier))
        _, start, z, barrier = max(searches, key=lambda search: search[0])
        refined_motion = self._finish(z, barrier)
        finished_motion = self.narrow_to_limits(refined_motion, self._check_refinement)
        narrowed_start = self.narrow_to_limits(start, self._check_refinement)
        progress(1.0)
        return self._better(finished_motion, narrowed_start)

    def _better(self, first: Array | None, second: Array | None) -> Array | None:
        """Motion with the larger merit, the first motion if they are equal; None if both are None."""
        if first is None:
            return second
        if second is None:
            return first
        return second if self.merit(second) > self.merit(first) else first

    def _start(self, rng: np.random.Generator) -> Array | None:
        """Best of several random motions; None if none is feasible."""
        best = self.random(rng)
        if best is None:
            return None
        for _ in range(_RANDOM_MOTIONS):
            best = self._better(best, self.random(rng))
        return best

    def _finish(self, z: Array, barrier: LimitBarrier) -> Array:
        """Refine the motion at many instants, with a larger margin as long as it violates a limit between the instants."""
        rho, steps, finer = _LAST_ROUND
        barrier = replace(barrier, rho=rho).refine(finer)
        for _ in range(_MAX_LAST_ROUNDS):
            z, barrier = self._descend(z, barrier, steps)
            violation = _MARGIN - self.constraints.least(self._states(z, self._check_refinement))
            if violation <= 0.0:
                break
            barrier = replace(barrier, aim=barrier.aim + _AIM_PER_VIOLATION * violation)
        return z

    def _descend(self, z: Array, barrier: LimitBarrier, steps: int) -> tuple[Array, LimitBarrier]:
        """Motion after at most ``steps`` steps, and the barrier with updated multipliers."""
        from scipy.optimize import minimize

        options: Any = _SEARCH_OPTIONS | {"maxiter": steps}
        solution = minimize(self.cost_and_slope, z.ravel(), (barrier,), "L-BFGS-B", jac=True, options=options)
        z = np.reshape(solution.x, z.shape)
        shares, _ = self.constraints.evaluate(self._states(z, barrier.finer), smooth=True)
        _, forces = barrier.cost_and_forces(shares)  # the new multipliers are max(0, λ - ρ (s - s_0)), as the forces
        return z, replace(barrier, multipliers=forces)

    def cost_and_slope(self, z: Array, barrier: LimitBarrier) -> tuple[float, Array]:
        """Cost, which is -merit plus the cost of the edges, and its derivative by z (nv K,)."""
        z = z.reshape(len(self.middle), -1)
        states = self._states(z, _MERIT_REFINEMENT)
        merit, merit_by_rows = self.information.merit_and_slope(self.information.rows(*states))
        shares, pullback = self.constraints.evaluate(self._states(z, barrier.finer), smooth=True)
        cost, forces = barrier.cost_and_forces(shares)
        merit_by_states = self.information.slopes(states, -merit_by_rows)  # of -merit
        cost_by_states = pullback(-forces)
        slope_by_coefficients = np.zeros_like(z)
        slope_by_coefficients += np.einsum(
            "mnj,mnk->jk", merit_by_states, self._basis(_MERIT_REFINEMENT), optimize=True
        )
        slope_by_coefficients += np.einsum("mnj,mnk->jk", cost_by_states, self._basis(barrier.finer), optimize=True)
        return cost - merit, np.einsum("jk,jkl->jl", slope_by_coefficients, self._units).ravel()
