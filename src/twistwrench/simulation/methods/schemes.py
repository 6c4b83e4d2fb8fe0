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
    quadrature: tuple[Array, Array]
    """Times at which forces are evaluated, as fractions of a step, and their weights in the impulse: c and b."""

    @property
    def lagging(self) -> bool:
        """True if the velocities of a state lag half a step behind its coordinates."""

    def on(self, system: System) -> Scheme:
        """Same method for a copy of its system."""

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """State a time ``h`` later; ``rate`` is f(t, y)."""


class RungeKutta:
    """Explicit method from its tableau. The caller normalises quaternions."""

    lagging = False

    def __init__(self, system: System, tableau: Tableau) -> None:
        self.system, self.tableau, self.order = system, tableau, tableau.order
        self.a, self.b, self.c, self.error, self.dense = tableau.numbers
        self.quadrature = self.c, self.b
        self.K = np.zeros((len(self.b), system.size))
        """Rates of the stages of the last step."""

    def on(self, system: System) -> RungeKutta:
        """Same method for a copy of its system."""
        return RungeKutta(system, self.tableau)

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """Step y + h Σ b_i k_i."""
        K, rates = self.K, self.system.rates
        K[0] = rate
        for i in range(1, len(self.b)):
            rates(t + self.c[i] * h, y + h * np.dot(self.a[i], K[:i]), K[i])
        return y + h * np.dot(self.b, K)


class SemiImplicit:
    """Semi-implicit Euler: velocities by the rates before, coordinates by the velocities after, along the manifold.

    Friction, and velocity gains of laws that return them, are implicit. With friction, velocities change at the
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
        """dq1 = dq + h ddq, with implicit friction and gains if any; then q1 = q ⊕ h dq1, or half steps by dq and dq1."""
        s = self.system
        if s.dry_friction is None:
            y1 = y + h * rate
            y1[: s.nq] = s.manifold.move(y[: s.nq], h * y1[s.moving])
            return y1
        y1, powers = y.copy(), np.zeros(len(WORKS))
        v = s.braked_step(t, y, h, powers)
        middle = s.dry_friction.middle(s.manifold, y[: s.nq], y[s.moving], h)
        y1[: s.nq], y1[s.moving] = s.dry_friction.end(s.manifold, middle, v, h), v
        y1[-len(WORKS) :] += h * powers
        return y1


class OneByOne:
    """Steps of a method from any state: first the rates there, last the normalisation of quaternions."""

    takes_many = False

    def __init__(self, system: System, scheme: Scheme) -> None:
        self.system, self.scheme, self.order = system, scheme, scheme.order

    def under(self, held: Array) -> OneByOne:
        """Same steps of a copy of the system, under these torques of the controller."""
        system = self.system.under(held)
        return OneByOne(system, self.scheme.on(system))

    def accelerations(self, t: float, y: Array) -> Array:
        """Accelerations (nv,) at a state."""
        return self.system.accelerations(t, y)

    def after(self, t: float, y: Array, h: float) -> Array:
        """State a time ``h`` later."""
        return self.step_and_accelerations(t, y, h)[0]

    def step_and_accelerations(self, t: float, y: Array, h: float) -> tuple[Array, Array]:
        """State a time h later, and accelerations (nv,) at the given state."""
        rate = np.zeros(self.system.size)
        self.system.rates(t, y, rate)
        y = self.scheme.step(t, y, h, rate)
        self.system.manifold.normalise(y[: self.system.nq])
        return y, rate[self.system.moving]


METHODS: dict[str, Callable[[System], Scheme]] = {
    "dopri5": lambda system: RungeKutta(system, DORMAND_PRINCE),
    "euler": lambda system: RungeKutta(system, EULER),
    "midpoint": lambda system: Variational(system, 2),
    "rk4": lambda system: RungeKutta(system, RK4),
    "semi_implicit": SemiImplicit,
    "variational": lambda system: Variational(system, 4),
    "variational6": lambda system: Variational(system, 6),
}
"""Methods by name; ``dopri5`` adapts its steps, the others take fixed steps."""


ADAPTIVE = "dopri5"


def scheme_of(name: str, system: System) -> Scheme:
    """Method by name; raises UnknownNameError with the list of methods."""
    if not isinstance(name, str) or name not in METHODS:
        raise UnknownNameError.from_choices("method", name, METHODS)
    return METHODS[name](system)
