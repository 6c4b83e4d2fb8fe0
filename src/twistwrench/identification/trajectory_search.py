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
from typing import Any, Literal, get_args

import numpy as np
from numpy.polynomial import polynomial

from ..core.errors import ShapeError, ValueRangeError
from ..core.typing import Array
from ..mechanics.model.limits import Limits
from ..robot import Robot
from ..shapes.capsules import MARGIN, CapsuleDistances, Pullback
from .parameters import BaseParameters

# ── Constraints: limits, the floor, and clearances of the capsules around the links

# Each constraint is low ≤ x ≤ high. Each edge has a size, and distances from it are shares of that size.

Clear = Callable[[Array], Array]
"""Distances (n, ...) [m] of configurations (n, nq), below 0 in contact."""
_NEAR = 0.1  # scale of a clearance [m]
DENSE = 0.01
"""Maximum step at which clearances are finally checked [s]."""
_DISPLACED = 1e-5  # step of finite differences of the user's distances


@dataclass(frozen=True, eq=False)
class TrajectoryConstraints:
    """Constraints on the motions of one robot."""

    robot: Robot  # its own friction is part of the torques
    bounds: Limits  # limits of the motion
    friction_speed: Array  # (nv,), Coulomb smoothing speed for the smooth torques
    capsules: CapsuleDistances  # distances from the floor and between links
    clear: Clear | None = None

    @cached_property
    def _edges(self) -> tuple[int, Array, Array, Array]:
        """Number of upper edges; column (e,), share at 0 (e,) and slope (e,) of all edges, upper ones first.

        Columns are positions, velocities, accelerations, torques and distances.
        """
        b = self.bounds
        half = (b.upper - b.lower) / 2.0
        margins = np.full(self._clearances(self.robot.neutral[None])[0].shape[1], MARGIN)
        margins[self.capsules.count :] = 0.0  # the user's distances may reach 0
        margins[: len(self.capsules.margins)] = self.capsules.margins
        both = np.concatenate([b.velocity, b.acceleration, b.effort])
        high = np.concatenate([b.upper, both, np.full(len(margins), np.inf)])
        low = np.concatenate([b.lower, -both, margins])
        size = np.concatenate([np.where(np.isfinite(half), half, 1.0), both, np.full(len(margins), _NEAR)])
        above, below = np.flatnonzero(np.isfinite(high)), np.flatnonzero(np.isfinite(low))
        columns, signs = np.concatenate([above, below]), np.repeat([-1.0, 1.0], [len(above), len(below)])
        slopes = signs / size[columns]
        return len(above), columns, -slopes * np.concatenate([high[above], low[below]]), slopes

    def evaluate(self, states: Array, *, smooth: bool = False) -> tuple[Array, Pullback]:
        """Distances from all edges as shares of their sizes, negative if violated, and their pullback.

        Parameters
        ----------
        states : (3, n, nv) array, positions, velocities and accelerations
        smooth : bool, use smooth dry friction at its largest value instead of the file's; the pullback always does

        Returns
        -------
        shares : (n, e) array
        pullback : function that maps weights (n, e) to the derivative (3, n, nv) of the weighted sum by the states
        """
        (q, dq, ddq), f, nv = states, self.robot.model.friction, states.shape[2]
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=not smooth))
        eased, dry = np.tanh(dq / self.friction_speed), f.static + f.load * np.abs(rigid)
        tau = rigid + f.viscous * dq + dry * eased if smooth else rigid
        distances, of_distances = self._clearances(q)
        upper, columns, at_0, slopes = self._edges
        x = np.concatenate([q, dq, ddq, tau, distances], axis=1)

        def pullback(weights: Array) -> Array:
            by_x, scaled = np.zeros_like(x), weights * slopes
            by_x[:, columns[:upper]] = scaled[:, :upper]
            by_x[:, columns[upper:]] += scaled[:, upper:]
            by_q, by_dq, by_ddq, by_tau, by_distances = np.split(by_x, [nv, 2 * nv, 3 * nv, 4 * nv], axis=1)
            felt = by_tau * (1.0 + f.load * np.sign(rigid) * eased)
            found = np.stack([by_q, by_dq, by_ddq]) + self.robot.inverse_dynamics_gradient(q, dq, ddq, felt)
            found[0] += of_distances(by_distances)
            found[1] += by_tau * (f.viscous + dry * (1.0 - eased**2) / self.friction_speed)
            return np.asarray(found)

        return at_0 + slopes * x[:, columns], pullback

    def least(self, states: Array) -> float:
        """Least distance from any edge, as a share of its size, negative if violated; uses the friction of the robot's file."""
        return float(self.evaluate(states)[0].min(initial=np.inf))

    def _clearances(self, q: Array) -> tuple[Array, Pullback]:
        """Distances of the capsules and those of ``clear`` [m], and their pullback by central differences."""
        own, of_own = self.capsules.evaluate(q, MARGIN + _NEAR)
        if self.clear is None:
            return own, of_own

        def pullback(weights: Array) -> Array:
            found, mine = of_own(weights[:, : own.shape[1]]), weights[:, own.shape[1] :]
            for k, step in enumerate(_DISPLACED * np.eye(q.shape[1]) if mine.any() else ()):
                moved = (self._user_distances(q + step) - self._user_distances(q - step)) / (2.0 * _DISPLACED)
                found[:, k] += (moved * mine).sum(axis=1)
            return found

        return np.concatenate([own, self._user_distances(q)], axis=1), pullback

    def _user_distances(self, q: Array) -> Array:
        try:
            found = np.asarray(self.clear(q) if self.clear else (), float)
        except (TypeError, ValueError) as problem:
            raise ValueRangeError(f"clear could not be evaluated for {len(q)} configurations: {problem}") from None
        if found.ndim < 1 or len(found) != len(q) or not np.isfinite(found).all():
            raise ShapeError(
                f"clear gave an array of shape {found.shape} for {len(q)} configurations: give a distance [m] for each, "
                "finite, below 0 where something touches."
            )
        return found.reshape(len(q), -1)


def half_and_middle(bounds: Limits) -> tuple[Array, Array]:
    """Half the range of positions, inf if a limit is missing, and its middle, for joints with both limits."""
    with np.errstate(invalid="ignore"):
        return (bounds.upper - bounds.lower) / 2.0, (bounds.upper + bounds.lower) / 2.0


def shared_bounds(bounds: Limits, share: float) -> Limits:
    """Apply a share to the limits of positions, about their middle, of velocities and of torques.

    The limit of accelerations is the smaller of the limits of acceleration and deceleration.
    """
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    with np.errstate(invalid="ignore"):
        lower = np.where(both, middle - share * half, bounds.lower)
        upper = np.where(both, middle + share * half, bounds.upper)
    either = np.minimum(bounds.acceleration, bounds.deceleration)
    return replace(
        bounds, lower=lower, upper=upper, velocity=share * bounds.velocity, effort=share * bounds.effort,
        acceleration=either, deceleration=either,
    )  # fmt: skip


# ── Barrier and multipliers


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

    def refined(self, finer: int) -> LimitBarrier:
        """Interpolate the multipliers to ``finer`` times as many instants, with the same sum."""
        if finer == self.finer:
            return self
        times, count = finer // self.finer, len(self.multipliers)
        at = np.arange(times * (count - 1) + 1) / times
        spread = [np.interp(at, np.arange(count), one) / times for one in self.multipliers.T]
        return replace(self, multipliers=np.stack(spread, axis=1), finer=finer)


# ── Windowed Fourier series with rest at both ends

# With ω = 2π / T and k = 1 … N, each joint moves as
#
#     q(t) = q_0 + Σ_k a_k (sin kωt - p_k(t)) + b_k (cos kωt - r_k(t))
#
# where p_k and r_k are fifth-order polynomials with the value, rate and acceleration of the sine or cosine at 0 and T.
# So q = q_0 and dq = ddq = 0 at both ends.
#
# Source: Swevers et al., "Optimal robot excitation and identification", IEEE T-RA 13(5), 1997, for the series; Park,
# "Fourier-based optimal excitation trajectories for the dynamic identification of robots", Robotica 24(5), 2006, for the ends.

_ORDER = 5  # order of the polynomials: six conditions, three at each end


@dataclass(frozen=True)
class WindowedFourierSeries:
    """Basis functions of the motion of every joint: 1, then N sines and N cosines without their ends."""

    duration: float  # T [s]
    harmonics: int  # N

    @property
    def count(self) -> int:
        """Number of functions, 1 + 2 N."""
        return 1 + 2 * self.harmonics

    @cached_property
    def _rates(self) -> Array:
        """(N,) angular frequencies k ω T with respect to x = t / T."""
        return 2.0 * np.pi * np.arange(1, self.harmonics + 1)

    @cached_property
    def _ends(self) -> Array:
        """(6, 2 N) coefficients of p_k and r_k in x = t / T."""
        w, n = self._rates, self.harmonics
        powers = np.eye(_ORDER + 1)
        derivatives = [polynomial.polyder(powers, m) if m else powers for m in range(3)]
        conditions = np.array([polynomial.polyval(x, d) for x in (0.0, 1.0) for d in derivatives])
        wanted = np.zeros((6, 2 * n))
        wanted[[1, 4], :n] = w
        wanted[[0, 3], n:] = 1.0
        wanted[[2, 5], n:] = -(w**2)
        return np.linalg.solve(conditions, wanted)

    def basis(self, t: Array) -> Array:
        """Functions and their first and second derivatives at given times."""
        t = np.asarray(t, float)
        x, w = np.clip(t / self.duration, 0.0, 1.0), self._rates
        sin, cos = np.sin(np.outer(x, w)), np.cos(np.outer(x, w))
        found = np.zeros((3, len(x), self.count))
        found[0, :, 0] = 1.0
        waves = ((sin, cos), (cos * w, -sin * w), (-sin * w**2, -cos * w**2))
        for m, (of_sine, of_cosine) in enumerate(waves):
            ends = polynomial.polyder(self._ends, m) if m else self._ends
            found[m, :, 1:] = np.concatenate([of_sine, of_cosine], axis=1) - polynomial.polyval(x, ends).T
            found[m] /= self.duration**m
        found[:, (t <= 0.0) | (t >= self.duration), 1:] = 0.0
        return found


def typical_sizes(robot: Robot, bounds: Limits, series: WindowedFourierSeries) -> tuple[Array, Array]:
    """Typical positions, velocities and accelerations (3, nv), and middle positions (nv,)."""
    turning = np.array([b.joint.turning[0] for b in robot.model.leaders])
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    rate = 2.0 * np.pi * series.harmonics / series.duration
    wide = np.where(both, half, np.where(turning, np.pi, 1.0))
    fast = np.minimum(bounds.velocity, wide * rate)
    typical = np.stack([wide, fast, np.minimum(bounds.acceleration, fast * rate)])
    return typical, np.where(both, middle, np.clip(0.0, bounds.lower, bounds.upper))


# ── Fisher information of a motion about base parameters

# With rows W_j of joint j (the columns that :func:`identify` fits), standard deviations σ_j of the torques, and n of m
# rows that are independent,
#
#     A = (n / m) Σ_j W_j' W_j / σ_j² + D⁻²,      deviations = sqrt(diag A⁻¹),      d log det A = Σ_j tr(G_j' dW_j),
#     G_j = 2 (n / m) W_j A⁻¹ / σ_j²
#
# D has the standard deviations of the weak prior, the largest plausible sizes of the groups; they bound the deviations
# of undetermined groups. With v_i = log((A⁻¹)_ii / D_i²), a search maximises the merit,
#
#     log det A - Λ / 2 κ log Σ_i exp(v_i / κ),        for κ → 0:  log det A - Λ log max_i (deviation_i / D_i),   Λ = r / 2,
#     or -r m,  Σ_i S((v_i - m) / κ) = r / 2,  S the logistic function,   m the smoothed median of v_i for D_i = 1
#
# Both m, of maximum and of median, have dm = Σ_i w_i dv_i with w_i ~ exp(v_i / κ) or w_i ~ S', Σ_i w_i = 1, and
# dv_i = -(A⁻¹ dA A⁻¹)_ii / (A⁻¹)_ii. Units change log det A only by a constant, but they change the condition number.
#
# Source: Swevers et al., 1997, for log det A and the condition number; the second term is this library's own.

ROWS_PER_SECOND = 25.0
"""Independent rows per second: 2.5 per period of a cut-off of 10 Hz, as in :func:`identify`."""
_WORST = 0.25  # Λ / 2 r
_SMOOTH = 0.7  # κ of the smoothed median: a factor of 2 between variances
_SMOOTH_WORST = 0.3  # κ of the smoothed maximum
Criterion = Literal["log_det", "deviations"]
CRITERIA = get_args(Criterion)


@dataclass(frozen=True, eq=False)
class MotionInformation:
    """Information of motions of one robot with a fixed duration."""

    base: BaseParameters
    noise: Array  # (nv,), standard deviation of each torque [N m, sliding joints: N]
    friction_speed: Array  # (nv,) [rad/s, m/s]
    duration: float  # [s]
    prior: Array  # (r,), D: the largest plausible sizes of the groups
    criterion: Criterion = "log_det"  # objective

    def rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Columns of the base parameters in the torques."""
        return self.base.unknown.columns(self.base.kept, q, dq, ddq, self.friction_speed)

    def _inverse(self, W: Array) -> tuple[float, Array]:
        """log det A and A⁻¹, by a Cholesky factorisation with columns scaled to length 1."""
        import scipy.linalg

        weighted = (W / self.noise[:, None]).reshape(-1, W.shape[-1])
        A = weighted.T @ weighted * (ROWS_PER_SECOND * self.duration / len(W)) + np.diag(self.prior**-2.0)
        length = np.sqrt(A.diagonal())
        factor = scipy.linalg.cho_factor(A / length[:, None] / length, lower=True, check_finite=False)
        log_det = 2.0 * float(np.log(factor[0].diagonal()).sum() + np.log(length).sum())
        inverse = scipy.linalg.cho_solve(factor, np.eye(len(A)), check_finite=False)
        return log_det, inverse / length[:, None] / length

    def log_det(self, W: Array) -> float:
        """log det A for rows (n, nv, r) at evenly spaced times of the motion."""
        return self._inverse(W)[0]

    def merit_and_slope(self, W: Array) -> tuple[float, Array]:
        """Objective of a search, to be maximised, for rows (n, nv, r), and G (n, nv, r), its derivative by each entry of W."""
        log_det, inverse = self._inverse(W)
        variances = inverse.diagonal()
        if self.criterion == "deviations":
            m, weights = _smooth_median(np.log(variances))
            merit, slope, scale = 0.0, np.zeros_like(inverse), float(len(weights))
        else:
            m, weights = _smooth_maximum(np.log(variances / self.prior**2))
            merit, slope, scale = log_det, inverse, _WORST * len(inverse)
        slope = slope + scale * (inverse * (weights / variances)) @ inverse
        share = ROWS_PER_SECOND * self.duration / len(W)
        return merit - scale * m, 2.0 * share * (W @ slope) / self.noise[:, None] ** 2

    @cached_property
    def _pullback(self) -> Callable[..., tuple[Array, Array, Array]]:
        """Derivatives of the weighted sum of regressor entries by the states, by reverse mode."""
        return self.base.unknown.robot.kernel("regressor", by=("q", "dq", "ddq"), form="weighted")

    def slopes(self, states: Array, of_rows: Array) -> Array:
        """(3, n, nv) derivatives of the sum of rows, with weights (n, nv, r), by the states, separately for each instant."""
        unknown = self.base.unknown
        places = unknown.of_bodies[self.base.kept]
        weights = np.zeros((*of_rows.shape[:2], len(unknown.robot.parameters)))
        weights[:, :, places[places >= 0]] = of_rows[:, :, places >= 0]
        found = np.stack(self._pullback(*states, weights))
        dq, turn = states[1], np.tanh(states[1] / self.friction_speed)
        dry, bell = (1.0 - turn**2) / self.friction_speed, np.exp(-((dq / unknown.stribeck_speed) ** 2))
        stribeck, one = bell * (dry - 2.0 * dq / unknown.stribeck_speed**2 * turn), np.ones_like(dq)
        kinds, joints = np.array(unknown.kinds)[self.base.kept], self.base.felt.argmax(axis=0)
        laws = {"motor_inertia": (2, one), "viscous": (1, one), "coulomb": (1, dry), "stribeck": (1, stribeck)}
        for kind, (m, slope) in laws.items():
            columns = np.flatnonzero(kinds == kind)
            mine = joints[columns]
            found[m][:, mine] += of_rows[:, mine, columns] * slope[:, mine]
        return found

    def deviations(self, W: Array) -> Array:
        """(r,) expected standard deviations of the base parameters, from rows (n, nv, r)."""
        return np.sqrt(self._inverse(W)[1].diagonal())

    def condition(self, W: Array) -> float:
        """Condition number of W, in SI units."""
        s = np.linalg.svd(W.reshape(-1, W.shape[-1]), compute_uv=False)
        return float(s[0] / max(s[-1], 1e-300))


def _smooth_maximum(values: Array) -> tuple[float, Array]:
    """Smoothed maximum m, and its derivative by each value."""
    powers = np.exp((values - values.max()) / _SMOOTH_WORST)
    return float(values.max() + _SMOOTH_WORST * np.log(powers.sum())), powers / powers.sum()


def _smooth_median(values: Array) -> tuple[float, Array]:
    """Smoothed median m, and its derivative by each value."""
    from scipy.optimize import brentq
    from scipy.special import expit

    def above(m: float) -> Array:
        return np.asarray(expit((values - m) / _SMOOTH))

    m = float(brentq(lambda m: above(m).sum() - 0.5 * len(values), values.min() - 1.0, values.max() + 1.0))
    by_values = above(m) * (1.0 - above(m))
    return m, by_values / by_values.sum()


# ── Search

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
_NARROW = 0.02  # share of a motion's initial width below which it counts as infeasible
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
        return {}

    @property
    def _fine(self) -> int:
        return max(_FINER, math.ceil(self.series.duration / (DENSE * _PER_PERIOD * self.series.harmonics)))

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
            (q, dq, ddq), rest = self._states(z), self.coefficients(z)[:, 0]
            room = b.upper - rest, rest - b.lower, b.velocity, b.acceleration
            reached = (q - rest).max(axis=0), (rest - q).max(axis=0), np.abs(dq).max(axis=0), np.abs(ddq).max(axis=0)
            wide = [has / np.maximum(takes, 1e-12) for has, takes in zip(room, reached, strict=True)]
            z[:, 1:] *= (1.0 - 2.0 * _MARGIN) * np.min(wide, axis=0)[:, None]
            if (found := self.fitted(z, 1)) is not None:
                return found
        return None

    def fitted(self, z: Array, finer: int) -> Array | None:
        """Narrow the motion about its rest position until all limits hold; None if the rest position violates limits."""

        def narrowed(share: float) -> Array:
            found = z.copy()
            found[:, 1:] *= share
            return found

        def fits(share: float) -> bool:
            return self.constraints.least(self._states(narrowed(share), finer)) >= _MARGIN

        if fits(1.0):
            return z
        if self.constraints.least(self._states(narrowed(0.0))[:, :1]) < _MARGIN or not fits(_NARROW):
            return None
        low, high = _NARROW, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            low, high = (share, high) if fits(share) else (low, share)
        return narrowed(low)

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
                z, barrier = search._descended(z, replace(barrier, rho=rho).refined(finer), steps)
                progress((k + n / len(_ROUNDS)) / (times + 1))
            narrowed = self.fitted(z, 1)
            found.append((-np.inf if narrowed is None else self.merit(narrowed), start, z, barrier))
        _, start, z, barrier = max(found, key=lambda one: one[0])
        fits = [self.fitted(z, self._fine) for z in (self._finished(z, barrier), start)]
        progress(1.0)
        return max((z for z in fits if z is not None), key=self.merit, default=None)

    def _start(self, rng: np.random.Generator) -> Array | None:
        """Best of several random motions; None if none is feasible."""
        best = self.random(rng)
        for _ in range(_STARTS if best is not None else 0):
            best = max((z for z in (best, self.random(rng)) if z is not None), key=self.merit)
        return best

    def _finished(self, z: Array, barrier: LimitBarrier) -> Array:
        """Refine the motion at many instants, with a larger margin as long as it violates a limit between the instants."""
        rho, steps, finer = _LAST
        barrier = replace(barrier, rho=rho).refined(finer)
        for _ in range(_REPAIRS):
            z, barrier = self._descended(z, barrier, steps)
            beyond = _MARGIN - self.constraints.least(self._states(z, self._fine))
            if beyond <= 0.0:
                break
            barrier = replace(barrier, aim=barrier.aim + 1.5 * beyond)
        return z

    def _descended(self, z: Array, barrier: LimitBarrier, steps: int) -> tuple[Array, LimitBarrier]:
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
        slope = np.zeros_like(z)
        for finer, by_states in ((_OF_MERIT, self.information.slopes(states, -G)), (barrier.finer, pullback(-forces))):
            slope += np.einsum("mnj,mnk->jk", by_states, self._basis(finer), optimize=True)
        return cost - merit, np.einsum("jk,jkl->jl", slope, self._units).ravel()
