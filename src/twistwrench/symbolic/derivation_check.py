"""Check of a derivation: comparison with Newton–Euler dynamics at random states."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.numbers import residual
from ..core.typing import Array
from ..robot import Robot
from .coordinates import to_robot
from .equations import Equations


class Evaluator:
    """Evaluator of expressions, given values of their symbols; definitions are evaluated first, in order."""

    def __init__(self, values: Mapping[Any, Any]) -> None:
        self._values: dict[Any, Any] = dict(values)

    @classmethod
    def from_state(cls, equations: Equations, q: Array, dq: Array, ddq: Array) -> Evaluator:
        """Evaluator at states (..., n), with parameters at their own values."""
        values: dict[Any, Any] = dict(equations.values)
        for symbols, array in ((equations.q, q), (equations.dq, dq), (equations.ddq, ddq)):
            values |= zip(symbols, np.moveaxis(array, -1, 0), strict=True)
        evaluator = cls(values)
        for symbol, expr in equations.definitions:
            evaluator._values[symbol] = evaluator(expr)
        return evaluator

    def __call__(self, expr: Any) -> Any:
        """Value of one expression."""
        value = self._values.get(expr)
        if value is None:
            value = self._evaluate(expr)
            self._values[expr] = value
        return value

    def array(self, expressions: Any, batch: tuple[int, ...]) -> Array:
        """Values of a matrix or array of expressions, (*batch, *its shape)."""
        shape = tuple(map(int, expressions.shape))
        entries = [np.broadcast_to(self(expressions[index]), batch) for index in np.ndindex(shape)]
        return np.stack(entries, axis=-1).reshape(*batch, *shape)

    def _evaluate(self, expr: Any) -> Any:
        """Value of an expression that has not been evaluated before."""
        if expr.is_Number:
            return float(expr)
        if expr.is_Add:
            return sum(map(self, expr.args))
        if expr.is_Mul:
            product = 1.0
            for factor in expr.args:
                product = product * self(factor)
            return product
        if expr.is_Pow and expr.exp.is_Integer:
            return self(expr.base) ** int(expr.exp)
        if expr.is_Pow:
            return np.power(self(expr.base), self(expr.exp))
        function = getattr(np, expr.func.__name__)
        return function(*map(self, expr.args))


TOLERANCE = 1e-12
"""Largest deviation relative to the largest torque, mass or force; both sides round sums of a few hundred terms."""

_STATES = 16
"""Number of random states."""
_MAX_COORDINATE = 1.5
"""Largest size of a random coordinate [rad or m]."""
_CHECK_SEED = 8100
"""Seed of the random states."""


@dataclass(frozen=True)
class DerivationCheck:
    """Check of a derivation: deviation from the compiled kernels, relative to the largest entry of each quantity."""

    inverse_dynamics: float
    """Relative deviation of τ."""
    mass_matrix: float
    """Relative deviation of M."""
    coriolis_forces: float
    """Relative deviation of c."""
    gravity_forces: float
    """Relative deviation of g."""
    states: int
    """Number of random states."""

    @property
    def worst(self) -> float:
        """Largest of the deviations."""
        return max(self.inverse_dynamics, self.mass_matrix, self.coriolis_forces, self.gravity_forces)

    def __str__(self) -> str:
        return (
            f"checked against Newton–Euler at {self.states} random states: τ to {residual(self.inverse_dynamics)}, "
            f"M to {residual(self.mass_matrix)}, c to {residual(self.coriolis_forces)}, g to "
            f"{residual(self.gravity_forces)} of the largest entry"
        )


def check_derivation(equations: Equations, robot: Robot) -> DerivationCheck:
    """Deviation from the kernels at random states.

    The coordinates u of the equations may differ from the robot's q. With dq = N du, torques, M and forces of the robot become
    N'τ, N'M N and so on.
    """
    n = robot.nv
    rng = np.random.default_rng(_CHECK_SEED)
    u = rng.uniform(-_MAX_COORDINATE, _MAX_COORDINATE, (_STATES, n))
    du, ddu = rng.standard_normal((2, _STATES, n))
    evaluator = Evaluator.from_state(equations, u, du, ddu)
    expected: defaultdict[str, list[Array]] = defaultdict(list)
    zero = np.zeros(n)

    def torques_at_rest(q: Array) -> Array:
        """Torques of gravity and springs."""
        if robot.model.springs:
            return robot.bias_forces(q, zero)
        return robot.gravity_forces(q)

    for u_state, du_state, ddu_state in zip(u, du, ddu, strict=True):
        q, dq, ddq, N = to_robot(robot.model, u_state, du_state, ddu_state)
        velocity_part = ddq - N @ ddu_state  # dN/dt du: part of c due to the choice of coordinates
        M = robot.mass_matrix(q)
        expected["inverse_dynamics"].append(N.T @ robot.inverse_dynamics(q, dq, ddq))
        expected["mass_matrix"].append(N.T @ M @ N)
        expected["coriolis_forces"].append(N.T @ (robot.coriolis_forces(q, dq) + M @ velocity_part))
        expected["gravity_forces"].append(N.T @ torques_at_rest(q))
    largest_torque = np.abs(expected["inverse_dynamics"]).max()
    deviations = {}
    for name, expected_values in expected.items():
        expressions = equations.tau if name == "inverse_dynamics" else getattr(equations, name)
        values = evaluator.array(expressions, (_STATES,)).reshape(np.shape(expected_values))
        scale = np.abs(expected_values).max() if name == "mass_matrix" else largest_torque
        deviation = np.abs(values - expected_values).max()
        if scale > 0.0:  # otherwise all expected values are zero
            deviation = deviation / scale
        deviations[name] = float(deviation)
    return DerivationCheck(**deviations, states=_STATES)
