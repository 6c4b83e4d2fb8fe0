"""Variational integrators: discrete forms of Hamilton's principle.

The action of one step of length h from q to q exp(η), with ξ = η/h, is evaluated at the midpoint,

    L_d = h L(q exp(η/2), ξ),        L = ½ ξᵀ M ξ - U

and made stationary. With the momenta p = M dq, a = ad(η) and E = exp(a/2) = Ad(exp(η/2)), joint by joint, this gives

    (a / (e^a - 1))ᵀ M ξ = p0 + h (1 + E)⁻ᵀ G        to be solved for ξ,
    p1 = Eᵀ (Eᵀ p0 + h G),        q1 = q0 exp(h ξ),

where G = ∂L/∂q + f at the midpoint. For joints with one degree of freedom E = 1 and a = 0, and the method is the
midpoint rule of Hamilton's equations. The map is symplectic and symmetric. Momenta that no force changes, such as the
spatial momentum of a free-floating robot, are preserved to rounding errors. Symmetric compositions raise the order
and preserve these properties. Forces act at the midpoint, by d'Alembert's principle.

Sources: Marsden and West, "Discrete mechanics and variational integrators", Acta Numerica 10, 2001; Bou-Rabee and
Marsden, "Hamilton–Pontryagin integrators on Lie groups", Found. Comput. Math. 9, 2009; the compositions are those of
:mod:`twistwrench.mechanics.bodies.inertia`.
"""

from __future__ import annotations

from copy import copy
from fractions import Fraction
from math import comb, factorial

import numpy as np

from ...core.errors import SimulationError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.bodies.inertia import COMPOSITIONS
from ..forces import WORKS, System

MAX_ITERATIONS = 100
"""Largest number of iterations. Convergence is linear and faster for shorter steps; three or four are usual."""
MAX_CONTRACTION = 0.3
"""Largest ratio of a change to the one before it if iterations converge well. Above it, a tiny change is rounding error; after
a change that is not tiny, secant updates begin."""
_CONVERGED_CHANGE = 1e-16
"""Expected size of the next change, relative to the velocities, at which the iteration ends."""
_MIN_SPEED = 1e-300
"""Speed in place of 0 to which changes are relative [rad/s or m/s]."""
_MAX_ROUNDING = 1e-11
"""Largest change relative to the velocities that may be rounding error."""

# Series of ad(η), whose eigenvalues are 0 and ±i times the rotation angle. Those of a / (e^a - 1) and of tanh converge for
# less than a full turn; at 1 rad the first omitted term is below 1e-19.

LARGEST_TURN = 2.0
"""Largest rotation per step [rad]; the first omitted term is then below 1e-12."""
_SERIES_TERMS = 13
"""Number of terms of the series of a / (e^a - 1) and of tanh."""
_EXPONENTIAL_TERMS = 20
"""Number of terms of the exponential after the first."""


_BERNOULLI = [Fraction(1)]
"""Bernoulli numbers B_m from Σ_j binomial(m + 1, j) B_j = 0 over j = 0 … m."""
for _m in range(1, 2 * _SERIES_TERMS + 1):
    _sum_of_earlier = sum((comb(_m + 1, j) * _BERNOULLI[j] for j in range(_m)), Fraction(0))
    _BERNOULLI.append(-_sum_of_earlier / (_m + 1))
_BERNOULLI_SERIES = [float(_BERNOULLI[2 * n] / factorial(2 * n)) for n in range(1, _SERIES_TERMS + 1)]
"""Coefficients B_2n / (2n)! for n = 1, 2, … of a / (e^a - 1) = 1 - a/2 + Σ B_2n / (2n)! a^2n."""
_TANH_SERIES = [
    0.5 * 4.0**n * (4.0**n - 1.0) * b * 0.25 ** (2 * n - 1) for n, b in enumerate(_BERNOULLI_SERIES, start=1)
]
"""Coefficients of ½ tanh(a/4) = Σ c_n a^(2n-1), from tanh x = Σ 4^n (4^n - 1) B_2n / (2n)! x^(2n-1)."""


def _adjoint(V: Array, constants: Array) -> Array:
    """ad(V) (n, n) of velocities (n,) of a joint's group, from the group's structure constants (n, n²)."""
    return np.asarray(V @ constants).reshape(len(V), len(V))


def _exponential(a: Array, x: Array) -> Array:
    """e^a x = x + a (x + a/2 (x + a/3 (x + …)))."""
    y = x
    for k in range(_EXPONENTIAL_TERMS, 0, -1):
        y = x + a.dot(y) / k
    return y


def _even_series(a: Array, x: Array, coefficients: list[float]) -> Array:
    """Σ c_n a^(2n) x over n = 0, 1, … of an even function, by Horner's rule."""
    square = a.dot(a)
    y = coefficients[-1] * x
    for c in coefficients[-2::-1]:
        y = c * x + square.dot(y)
    return y


class _Secant:
    """Broyden's method: secant updates for iterations that do not converge by themselves.

    Source: Broyden, "A class of methods for solving nonlinear simultaneous equations", Math. Comp. 19, 1965.
    """

    def __init__(self, change: Array) -> None:
        self.inverse = np.eye(len(change))
        """Estimate of the inverse slope of the plain change by the unknowns, with the opposite sign."""
        self.plain_change = change
        """Last change of the plain iteration."""
        self.last_change = change
        """Last change of the unknowns."""

    def correct(self, plain_change: Array) -> Array:
        """Broyden's change for the change of the plain iteration."""
        predicted = self.inverse @ (self.plain_change - plain_change)  # last_change, if the inverse were right
        projection = float(self.last_change @ predicted)
        if projection:
            update = np.outer(self.last_change - predicted, self.last_change @ self.inverse)
            self.inverse = self.inverse + update / projection
        self.plain_change = plain_change
        self.last_change = self.inverse @ plain_change
        return self.last_change


class Variational:
    """Midpoint rule from Hamilton's principle, composed to an order of :data:`COMPOSITIONS`."""

    lagging = False

    def __init__(self, system: System, order: int) -> None:
        self.system = system
        self.order = order
        self.fractions = COMPOSITIONS[order]
        """Lengths of the midpoint steps, as fractions of a step."""
        lengths = np.array(self.fractions)
        midpoints = np.cumsum(lengths) - 0.5 * lengths
        self.quadrature = midpoints, lengths
        """Midpoints and lengths of the midpoint steps, as fractions of a step."""
        self.terms = system.robot.kernel("mass_matrix", "coriolis_matrix", "bias_forces")
        self.groups = system.manifold.groups
        """For each joint with several degrees of freedom: its velocities, the angular ones of them, structure constants."""

    def on(self, system: System) -> Variational:
        """Same method for a copy of its system."""
        copied = copy(self)
        copied.system = system
        return copied

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """State at t + ``h``; ``rate`` is f(t, y)."""
        system = self.system
        q, dq = system.split(y)
        p = system.robot.mass_matrix(q) @ dq
        works = y[-len(WORKS) :].copy()
        ddq = rate[system.moving]
        xi = dq
        xi_time = 0.0  # time of the velocity xi, after the start of the next midpoint step
        for c in self.fractions:
            xi = xi + (0.5 * c * h - xi_time) * ddq  # initial guess: velocity at the midpoint
            q, p, xi, powers = self._midpoint_step(t, q, p, xi, c * h)
            t = t + c * h
            xi_time = -0.5 * c * h
            works += c * h * powers
        dq = np.linalg.solve(system.robot.mass_matrix(q), p)
        return np.concatenate([q, dq, works])

    def _midpoint_step(self, t: float, q0: Array, p0: Array, xi: Array, h: float) -> tuple[Array, Array, Array, Array]:
        """q and p after one midpoint step, ξ, and the powers of the forces at the midpoint (4,); xi is a guess of ξ."""
        system = self.system
        powers = np.zeros(len(WORKS))
        secant: _Secant | None = None
        previous_size = np.inf
        initial_speed = max(float(np.abs(xi).max()), _MIN_SPEED)  # the robot may come to rest in a step
        for _ in range(MAX_ITERATIONS):
            middle = system.manifold.move(q0, 0.5 * h * xi)
            M, C, bias = self.terms(middle, xi)
            powers[:] = 0.0
            # ∂L/∂q = Cᵀ ξ - g, since dM/dt = C + Cᵀ and p' = M ddq + (dM/dt) ξ; minus ad(ξ)ᵀ p for group joints.
            G = (C + C.T) @ xi - bias + system.forces(t + 0.5 * h, middle, xi, powers)
            system.evaluations += 1
            p = M @ xi
            p_term, G_term = self._midpoint_terms(xi, h, p, G)
            residual = p0 + h * G_term - p_term
            change = system.robot.forward_dynamics(middle, xi, residual + bias)  # M⁻¹ times the residual
            if secant is not None:
                change = secant.correct(change)
            xi = xi + change
            size = float(np.abs(change).max())
            scale = max(float(np.abs(xi).max()), initial_speed)
            if not size < np.inf:
                raise self._failure(t, "the step is unstable", change)
            if any(np.linalg.norm(h * xi[k][turning]) > LARGEST_TURN for k, turning, _ in self.groups):
                raise self._failure(t, f"the step turns a body by more than {printed(LARGEST_TURN)} rad", change)
            next_size = size
            if previous_size < np.inf:  # the next change would be smaller by the same ratio
                next_size = size * min(size / previous_size, 1.0)
            shrinks_slowly = size > MAX_CONTRACTION * previous_size
            is_rounding = shrinks_slowly and size <= _MAX_ROUNDING * scale
            if next_size <= _CONVERGED_CHANGE * scale or is_rounding:
                p1 = self._momentum_after(h * xi, p0, h * G)
                return system.manifold.move(q0, h * xi), p1, xi, powers
            if secant is None and shrinks_slowly:  # a force is too stiff for the step, as in a contact
                secant = _Secant(change)
            previous_size = size
        raise self._failure(t, f"{MAX_ITERATIONS} iterations found no balance", change)

    def _midpoint_terms(self, xi: Array, h: float, p: Array, G: Array) -> tuple[Array, Array]:
        """(a / (e^a - 1))ᵀ p and (1 + E)⁻ᵀ G, after ad(ξ)ᵀ p is subtracted from G in place.

        In the loops, k are the velocities of a joint, a stands for its transpose, and (1 + E)⁻ᵀ = ½ - ½ tanh(a/4).
        """
        transposed_ads = [(k, _adjoint(xi[k], constants).T) for k, _, constants in self.groups]
        for k, transposed_ad in transposed_ads:
            G[k] -= transposed_ad @ p[k]
        p_term = p.copy()
        G_term = 0.5 * G
        for k, transposed_ad in transposed_ads:
            a = h * transposed_ad
            ap = a.dot(p[k])
            p_term[k] = p[k] - 0.5 * ap + a.dot(a.dot(_even_series(a, p[k], _BERNOULLI_SERIES)))  # Σ B_n / n! a^n p
            G_term[k] = 0.5 * G[k] - a.dot(_even_series(a, G[k], _TANH_SERIES))
        return p_term, G_term

    def _momentum_after(self, eta: Array, p0: Array, impulse: Array) -> Array:
        """Momentum p1 = Eᵀ (Eᵀ p0 + h G), with the ``impulse`` h G."""
        p1 = p0 + impulse  # where E = 1
        for k, _, constants in self.groups:
            half_a = 0.5 * _adjoint(eta[k], constants).T
            p1[k] = _exponential(half_a, _exponential(half_a, p0[k]) + impulse[k])
        return p1

    def _failure(self, t: float, problem: str, change: Array) -> SimulationError:
        """Error message for a step that failed, with the joint of the largest change."""
        sizes = np.where(np.isfinite(change), np.abs(change), np.inf)
        worst = int(np.argmax(sizes))
        name = self.system.robot.model.velocity_names[worst]
        return SimulationError(
            f"at t = {printed(t, 9)} s {problem}, first of all in joint {name!r}. Take a smaller dt."
        )
