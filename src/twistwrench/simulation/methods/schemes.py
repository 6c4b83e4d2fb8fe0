"""One-step methods by name: Runge–Kutta, semi-implicit Euler and variational integrators."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from ...core.errors import UnknownNameError
from ...core.typing import Array
from ..forces import WORKS, System
from .tableaus import DORMAND_PRINCE, EULER, RK4, SEMI_IMPLICIT_EULER, Tableau
from .variational import Variational

MAX_SPEED = 1e6
"""rad/s or m/s: larger speeds indicate an unstable step."""


class Scheme(Protocol):
    """One-step method."""

    order: int
    """Order of convergence."""
    quadrature: tuple[Array, Array]
    """Times at which forces are evaluated, as fractions of a step, and their weights in the impulse: c and b."""

    @property
    def lagging(self) -> bool:
        """True if the velocities of a state belong to a time half a step before that of its coordinates."""

    def on(self, system: System) -> Scheme:
        """Same method for a copy of its system."""

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """State at t + ``h``; ``rate`` is f(t, y), the rate of the state at the begin of the step."""


class RungeKutta:
    """Explicit Runge–Kutta method from its tableau. The caller normalises quaternions."""

    lagging = False

    def __init__(self, system: System, tableau: Tableau) -> None:
        self.system = system
        self.tableau = tableau
        self.order = tableau.order
        self.a, self.b, self.c, self.error, self.dense = tableau.numbers
        self.quadrature = self.c, self.b
        self.K = np.zeros((len(self.b), system.size))
        """Rates k_i of the stages of the last step, one per row."""

    def on(self, system: System) -> RungeKutta:
        """Same method for a copy of its system."""
        return RungeKutta(system, self.tableau)

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """State y + h Σ b_i k_i, with the stages k_i = f(t + c_i h, y + h Σ_j a_ij k_j)."""
        K = self.K
        rates = self.system.rates
        K[0] = rate
        for i in range(1, len(self.b)):
            rates(t + self.c[i] * h, y + h * np.dot(self.a[i], K[:i]), K[i])
        return y + h * np.dot(self.b, K)


class SemiImplicit:
    """Semi-implicit Euler: old accelerations change velocities, and new velocities move coordinates on the manifold.

    Friction is implicit, and so are velocity gains of laws that return them. With friction, velocities change at the
    midpoint.
    """

    order = SEMI_IMPLICIT_EULER.order
    quadrature = np.zeros(1), np.ones(1)

    def __init__(self, system: System) -> None:
        self.system = system

    @property
    def lagging(self) -> bool:
        """True unless friction makes the velocities change at the midpoint of the step."""
        return self.system.dry_friction is None or not self.system.dry_friction.friction

    def on(self, system: System) -> SemiImplicit:
        """Same method for a copy of its system."""
        return SemiImplicit(system)

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """State at t + h.

        Without friction and gains: dq1 = dq + h ddq, then q1 = q ⊕ h dq1. With them, dq1 is implicit, and the
        coordinates move half a step by dq, then half a step by dq1.
        """
        s = self.system
        if s.dry_friction is None:
            y1 = y + h * rate
            y1[: s.nq] = s.manifold.move(y[: s.nq], h * y1[s.moving])
            return y1
        y1 = y.copy()
        powers = np.zeros(len(WORKS))
        dq1 = s.braked_step(t, y, h, powers)
        q_middle = s.dry_friction.middle(s.manifold, y[: s.nq], y[s.moving], h)
        y1[: s.nq] = s.dry_friction.end(s.manifold, q_middle, dq1, h)
        y1[s.moving] = dq1
        y1[-len(WORKS) :] += h * powers
        return y1


class OneByOne:
    """Steps of a method, one state at a time.

    A step begins with the rates at its state and ends with the normalisation of quaternions.
    """

    takes_many = False
    """True if a call takes many states."""

    def __init__(self, system: System, scheme: Scheme) -> None:
        self.system = system
        self.scheme = scheme
        self.order = scheme.order

    def under(self, held: Array) -> OneByOne:
        """Same steps of a copy of the system, in which the controller holds these torques."""
        system = self.system.under(held)
        return OneByOne(system, self.scheme.on(system))

    def accelerations(self, t: float, y: Array) -> Array:
        """Accelerations (nv,) at a state."""
        return self.system.accelerations(t, y)

    def after(self, t: float, y: Array, h: float) -> Array:
        """State at t + ``h``."""
        y1, _ = self.step_and_accelerations(t, y, h)
        return y1

    def step_and_accelerations(self, t: float, y: Array, h: float) -> tuple[Array, Array]:
        """State at t + h, and accelerations (nv,) at t."""
        rate = np.zeros(self.system.size)
        self.system.rates(t, y, rate)
        y1 = self.scheme.step(t, y, h, rate)
        self.system.manifold.normalise(y1[: self.system.nq])
        return y1, rate[self.system.moving]


METHODS: dict[str, Callable[[System], Scheme]] = {
    "dopri5": lambda system: RungeKutta(system, DORMAND_PRINCE),
    "euler": lambda system: RungeKutta(system, EULER),
    "midpoint": lambda system: Variational(system, order=2),
    "rk4": lambda system: RungeKutta(system, RK4),
    "semi_implicit": SemiImplicit,
    "variational": lambda system: Variational(system, order=4),
    "variational6": lambda system: Variational(system, order=6),
}
"""Methods by name; ``dopri5`` adapts its steps, the others take fixed steps."""


ADAPTIVE = "dopri5"


def scheme_of(name: str, system: System) -> Scheme:
    """Method by name; raises UnknownNameError with the list of methods."""
    if not isinstance(name, str) or name not in METHODS:
        raise UnknownNameError.from_choices("method", name, METHODS)
    return METHODS[name](system)
