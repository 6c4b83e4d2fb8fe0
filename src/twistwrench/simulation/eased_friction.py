"""Dry friction eased off at low speeds, for methods that need forces without corners: how low, and what that leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from glob import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.friction import eased, torque_past_eased_friction
from ..core.printed_numbers import printed
from ..errors import ValueRangeError
from ..model.model import Model
from ..program.trace import trace
from ..robot.model_kernels import compiled
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot

CREEP = 1e-3
"""rad/s or m/s, the least speed below which dry friction is eased off."""


def creep_speeds(M: Array, dry: Array, h: float) -> Array:
    """The speeds below which dry friction is eased off, (..., nv): no less than what it takes off a joint in a step h.

    ``M`` are mass matrices (..., nv, nv), ``dry`` the most that dry friction takes (..., nv).
    """
    light = np.diagonal(np.linalg.inv(M), axis1=-2, axis2=-1)
    return np.asarray(np.maximum(CREEP, h * dry * light))


def creep_of_samples(robot: Robot, q0: Array, h: float, parameters: Mapping[str, Array]) -> Array:
    """The speeds below which dry friction is eased off, (..., nv), of samples with parameters of their own."""
    inertia, inputs = robot.mass_matrix, [q0]
    if parameters:
        inertia = robot.kernel("mass_matrix", parameters=tuple(map(escape, parameters)))
        inputs.append(np.stack(np.broadcast_arrays(*parameters.values()), axis=-1))
    try:
        with np.errstate(all="ignore"):  # states that are not finite end in a motion that is named
            M = inertia(*(np.asarray(x, float) for x in inputs))
            return creep_speeds(M, _dry_friction(robot, parameters), h)
    except np.linalg.LinAlgError:
        robot.engine.require_invertible()
        raise ValueRangeError("q0: the mass matrix has no inverse at one of these states.") from None


def _dry_friction(robot: Robot, parameters: Mapping[str, Array]) -> Array:
    """The most that dry friction takes from each joint before its load counts, (..., nv)."""
    friction = robot.model.friction
    most = np.maximum(friction.static, friction.coulomb)
    most = np.broadcast_to(most, (*np.broadcast_shapes(*(x.shape for x in parameters.values())), robot.nv)).copy()
    for body in robot.model.leaders:
        if body.joint.nv == 1:
            k, laws = body.v_index, {"static": friction.static, "coulomb": friction.coulomb}
            given = [parameters.get(f"{body.joint.name}.{law}", x[k]) for law, x in laws.items()]
            most[..., k] = np.maximum(*given)
    return most


class EasedFriction:
    """The laws of friction of a robot's joints, made continuous at rest.

    The dry part is multiplied by tanh(|dq| / creep): a joint that would stick creeps, at up to a few times that speed, and
    steps need not be as short as the time in which friction stops a joint.
    """

    def __init__(self, robot: Robot, creep: Array) -> None:
        self.robot, self.creep, self.dry = robot, creep, rubs_dry(robot.model)

    @cached_property
    def _kernel(self) -> Any:
        return self.robot.engine.kept("eased friction", lambda: _eased(self.robot))

    def left(self, dq: Array, tau: Array) -> Array:
        """What friction leaves of the torques tau, (nv)."""
        return np.asarray(self._kernel(dq, tau, eased(dq, self.creep)))


def _eased(robot: Robot) -> Any:
    def left(dq: Array, tau: Array, share: Array) -> tuple[Array]:
        return (torque_past_eased_friction(robot.model, dq, tau, share),)

    program = trace(left, [(name, (robot.nv,)) for name in ("dq", "tau", "share")], ["left"])
    return compiled(program, "eased friction", f"What eased friction of {robot.name} leaves of torques, compiled.")


def rubs_dry(model: Model) -> Array:
    """Whether each joint has dry friction, (nv,)."""
    return np.asarray((model.friction.static > 0) | (model.friction.coulomb > 0) | (model.friction.load > 0))


def easing_remark(model: Model, creep: Array) -> str | None:
    """What the easing does to a motion, in words; None without dry friction."""
    dry = rubs_dry(model)
    if not dry.any():
        return None
    most = np.where(dry, creep, 0.0).reshape(-1, len(dry)).max(axis=0)
    worst = int(np.argmax(most))
    return (
        "dry friction is eased off at low speeds: joints that it would hold creep, at up to about "
        f"{printed(most[worst], 2)} rad/s or m/s (most of all {model.velocity_names[worst]!r}), and one that moves as "
        "slowly keeps three quarters of its friction; semi-implicit steps ease nothing"
    )
