"""Springs between joint coordinates: their energy and the torques against them. Modern Robotics section 8.9.5."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..model.model import Body, Model
from ..model.spring import Spring
from ..typing import Array
from .recursion import zeros


def spring_energy(model: Model, q: Array) -> Any:
    """½ Σ k x², with x the stretch of each spring; J."""
    return sum((0.5 * spring.stiffness * _square(_stretch(model, spring, q)) for spring in model.springs), start=0.0)


def spring_forces(model: Model, q: Array) -> Array:
    """The torques that hold the springs, the gradient of their energy; (nv,)."""
    tau = zeros(model.nv)
    for spring in model.springs:
        force = spring.stiffness * _stretch(model, spring, q)
        for body, weight in _ends(model, spring):
            tau[body.v_index] = tau[body.v_index] + weight * force
    return tau


def spring_stiffness(model: Model) -> Array:
    """The second derivative of their energy; (nv, nv)."""
    K = zeros(model.nv, model.nv)
    for spring in model.springs:
        for one, a in _ends(model, spring):
            for other, b in _ends(model, spring):
                K[one.v_index, other.v_index] = K[one.v_index, other.v_index] + spring.stiffness * a * b
    return K


def _stretch(model: Model, spring: Spring, q: Array) -> Any:
    return sum((weight * q[body.q_index] for body, weight in _ends(model, spring)), start=-spring.rest)


def _ends(model: Model, spring: Spring) -> Iterator[tuple[Body, float]]:
    by_name = {body.joint.name: body for body in model.leaders}
    return ((by_name[joint], weight) for joint, weight in spring.terms)


def _square(x: Any) -> Any:
    return x * x
