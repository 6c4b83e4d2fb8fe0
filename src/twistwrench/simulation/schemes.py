"""One step of each method: from a state y at t, and its rate there, to the state a time h later."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from ..errors import UnknownNameError
from ..typing import Array
from .forces import WORKS, System
from .tableau import DORMAND_PRINCE, EULER, RK4, SEMI_IMPLICIT_EULER, Tableau
from .variational import Variational


class Scheme(Protocol):
    """A one-step method."""

    order: int
    asked: tuple[Array, Array]
    """The times of a step at which forces are asked, as shares of it, and their weights in the impulse: c and b."""

    @property
    def lagging(self) -> bool:
        """Whether the velocities of a state are those of half a step before its coordinates."""

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """The state a time ``h`` later, where ``rate`` is f(t, y)."""


class RungeKutta:
    """An explicit method from its table. Quaternions are brought to unit length by the caller."""

    lagging = False

    def __init__(self, system: System, tableau: Tableau) -> None:
        self.system, self.tableau, self.order = system, tableau, tableau.order
        self.a, self.b, self.c, self.error, self.dense = tableau.numbers
        self.asked = self.c, self.b
        self.K = np.zeros((len(self.b), system.size))
        """The rates of the stages of the last step."""

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """y + h Σ b_i k_i."""
        K, rates = self.K, self.system.rates
        K[0] = rate
        for i in range(1, len(self.b)):
            rates(t + self.c[i] * h, y + h * np.dot(self.a[i], K[:i]), K[i])
        return y + h * np.dot(self.b, K)


class SemiImplicit:
    """Semi-implicit Euler: velocities by the rates before, coordinates by the velocities after, along the manifold.

    Friction and the gains of the rates of a law that tells them are taken at the end of the step. With friction, velocities
    change halfway along the step.
    """

    order = SEMI_IMPLICIT_EULER.order
    asked = np.zeros(1), np.ones(1)

    def __init__(self, system: System) -> None:
        self.system = system

    @property
    def lagging(self) -> bool:
        """They do unless friction makes them change halfway along the step."""
        return self.system.braked is None or not self.system.braked.friction

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """dq1 = dq + h ddq, or what brakes at the end of the step leaves of it; then q1 = q ⊕ h dq1, or halves of both."""
        s = self.system
        if s.braked is None:
            y1 = y + h * rate
            y1[: s.nq] = s.manifold.move(y[: s.nq], h * y1[s.moving])
            return y1
        y1, powers = y.copy(), np.zeros(len(WORKS))
        v = s.braked_step(t, y, h, powers)
        middle = s.braked.middle(s.manifold, y[: s.nq], y[s.moving], h)
        y1[: s.nq], y1[s.moving] = s.braked.end(s.manifold, middle, v, h), v
        y1[-len(WORKS) :] += h * powers
        return y1


class OneByOne:
    """Steps of a method from any state: the rates there first, quaternions brought to unit length last."""

    takes_many = False

    def __init__(self, system: System, scheme: Scheme) -> None:
        self.system, self.scheme, self.order = system, scheme, scheme.order
        self.accelerations = system.accelerations

    def after(self, t: float, y: Array, h: float) -> Array:
        """The state a time ``h`` later."""
        return self.begun(t, y, h)[0]

    def begun(self, t: float, y: Array, h: float) -> tuple[Array, Array]:
        """The same, and the accelerations (nv,) at the state."""
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
"""The methods by name; ``dopri5`` adapts its steps, all others take steps of one length."""


ADAPTIVE = "dopri5"


def scheme_of(name: str, system: System) -> Scheme:
    """The method of that name; UnknownNameError lists them."""
    if not isinstance(name, str) or name not in METHODS:
        raise UnknownNameError.of("method", name, METHODS)
    return METHODS[name](system)
