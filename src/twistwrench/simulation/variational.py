"""Variational integrators: steps that follow from Hamilton's principle themselves, and so keep what it keeps.

The action of one step of length h from q to q exp(η), with ξ = η/h, is taken at its middle,

    L_d = h L(q exp(η/2), ξ),        L = ½ ξᵀ M ξ - U

and made stationary. With the momenta p = M dq, a = ad(η) and E = exp(a/2) = Ad(exp(η/2)), joint by joint, this is

    (a / (e^a - 1))ᵀ M ξ = p0 + h (1 + E)⁻ᵀ G        to be solved for ξ,
    p1 = Eᵀ (Eᵀ p0 + h G),        q1 = q0 exp(h ξ),

where G = ∂L/∂q + f, at the middle; for joints of one degree of freedom E = 1 and a = 0, and it is the midpoint rule of
Hamilton's equations. The map is symplectic and symmetric, and what no force changes, such as the spatial momentum of a robot
that floats freely, stays to rounding. Symmetric compositions raise its order and keep all that. Forces act as d'Alembert's
principle has it, at the middle.

Sources: Marsden and West, "Discrete mechanics and variational integrators", Acta Numerica 10, 2001; Bou-Rabee and Marsden,
"Hamilton–Pontryagin integrators on Lie groups", Found. Comput. Math. 9, 2009; the compositions are those of
:mod:`twistwrench.bodies.splitting`.
"""

from __future__ import annotations

import numpy as np

from ..bodies.splitting import COMPOSITIONS
from ..core.printed_numbers import printed
from ..errors import SimulationError
from ..typing import Array
from .event_location import LARGEST_TURN, adjoint, bernoulli, exponential, half_step
from .forces import WORKS, System

_MOST = 100
"""Iterations. Each gains as many digits as a step is short against the motion: three or four are usual."""
_SLOW = 0.3
"""Part of a change that the next one may be: more is rounding if it is tiny, and else is sought by secants."""


class _Secant:
    """Broyden's method: changes learn from how the last ones turned out. For what a plain iteration does not settle.

    Source: Broyden, "A class of methods for solving nonlinear simultaneous equations", Math. Comp. 19, 1965.
    """

    def __init__(self, change: Array) -> None:
        self.inverse, self.asked, self.made = np.eye(len(change)), change, change

    def changed(self, asked: Array) -> Array:
        """The change to make where the plain iteration would make the one that is asked for."""
        less = self.inverse @ (self.asked - asked)  # what the change would have been by the inverse so far
        along = float(self.made @ less)
        if along:
            self.inverse = self.inverse + np.outer(self.made - less, self.made @ self.inverse) / along
        self.asked, self.made = asked, self.inverse @ asked
        return self.made


class Variational:
    """The midpoint rule from Hamilton's principle, composed to an order of :data:`COMPOSITIONS`."""

    lagging = False

    def __init__(self, system: System, order: int) -> None:
        self.system, self.order, self.fractions = system, order, COMPOSITIONS[order]
        parts = np.array(self.fractions)
        self.asked = np.cumsum(parts) - 0.5 * parts, parts
        robot = system.robot
        self.terms = robot.kernel("mass_matrix", "coriolis_matrix", "bias_forces")
        self.groups = system.manifold.groups

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """The state a time ``h`` later, where ``rate`` is f(t, y)."""
        system = self.system
        q, dq = system.split(y)
        p = system.robot.mass_matrix(q) @ dq
        works, ddq, xi, gone = y[-len(WORKS) :].copy(), rate[system.moving], dq, 0.0
        for c in self.fractions:
            xi = xi + (0.5 * c * h - gone) * ddq  # a guess: the velocity in the middle
            q, p, xi, powers = self._step(t, q, p, xi, c * h)
            t, gone = t + c * h, -0.5 * c * h
            works += c * h * powers
        return np.concatenate([q, np.linalg.solve(system.robot.mass_matrix(q), p), works])

    def _step(self, t: float, q0: Array, p0: Array, xi: Array, h: float) -> tuple[Array, Array, Array, Array]:
        """One midpoint step; the state after it, ξ, and the powers of the forces in the middle (4,)."""
        system, before, powers = self.system, np.inf, np.zeros(len(WORKS))
        secant: _Secant | None = None
        usual = float(np.abs(xi).max()) or 1e-300  # a step may come to rest
        for _ in range(_MOST):
            middle = system.manifold.move(q0, 0.5 * h * xi)
            M, C, bias = self.terms(middle, xi)
            powers[:] = 0.0
            # ∂L/∂q = Cᵀ ξ - g, for dM/dt = C + Cᵀ and p' = M ddq + (dM/dt) ξ; less ad(ξ)ᵀ p where joints are groups.
            G = (C + C.T) @ xi - bias + system.forces(t + 0.5 * h, middle, xi, powers)
            system.evaluations += 1
            p = M @ xi
            left, half = self._brought(xi, h, p, G) if self.groups else (p, 0.5 * G)
            missing = p0 + h * half - left
            change = system.robot.forward_dynamics(middle, xi, missing + bias)  # M⁻¹ of it
            if secant is not None:
                change = secant.changed(change)
            xi = xi + change
            size, scale = float(np.abs(change).max()), max(float(np.abs(xi).max()), usual)
            if not size < np.inf:
                raise self._lost(t, "the step is unstable", change)
            if any(np.linalg.norm(h * xi[k][turning]) > LARGEST_TURN for k, turning, _ in self.groups):
                raise self._lost(t, f"the step turns a body by more than {printed(LARGEST_TURN)} rad", change)
            # The next change would be as much smaller again, this one may be rounding already.
            settled = size * min(size / before, 1.0) if before < np.inf else size
            if settled <= 1e-16 * scale or _SLOW * before < size <= 1e-11 * scale:
                p1 = self._carried(h * xi, p0, h * G)
                return system.manifold.move(q0, h * xi), p1, xi, powers
            if secant is None and size > _SLOW * before:  # a force that is stiff against the step, as in a contact
                secant = _Secant(change)
            before = size
        raise self._lost(t, f"{_MOST} iterations found no balance", change)

    def _brought(self, xi: Array, h: float, p: Array, G: Array) -> tuple[Array, Array]:
        """(a / (e^a - 1))ᵀ p and (1 + E)⁻ᵀ G; G loses ad(ξ)ᵀ p first."""
        brackets = [(k, adjoint(xi[k], c).T) for k, _, c in self.groups]
        for k, ad in brackets:
            G[k] -= ad @ p[k]
        left, half = p.copy(), 0.5 * G
        for k, ad in brackets:
            left[k], half[k] = bernoulli(h * ad, p[k]), half_step(h * ad, G[k])
        return left, half

    def _carried(self, eta: Array, p0: Array, impulse: Array) -> Array:
        """Eᵀ (Eᵀ p0 + h G)."""
        p1 = p0 + impulse
        for k, _, c in self.groups:
            half = 0.5 * adjoint(eta[k], c).T
            p1[k] = exponential(half, exponential(half, p0[k]) + impulse[k])
        return p1

    def _lost(self, t: float, what: str, change: Array) -> SimulationError:
        bad = int(np.argmax(np.where(np.isfinite(change), np.abs(change), np.inf)))
        name = self.system.robot.model.velocity_names[bad]
        return SimulationError(f"at t = {printed(t, 9)} s {what}, first of all in joint {name!r}. Take a smaller dt.")
