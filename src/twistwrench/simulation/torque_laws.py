"""Torques of a rollout as a law of the state: what it needs from outside, and the law itself, on symbols. MR section 11.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algorithms.control import computed_torque, proportional_derivative, undriven
from ..algorithms.inverse_dynamics import gravity_forces
from ..algorithms.recursion import zeros
from ..errors import ValueRangeError
from ..model.model import Model

Array = NDArray[Any]

__all__ = ["PD", "ComputedTorque", "GivenTorque", "TorqueLaw"]


class TorqueLaw(Protocol):
    """What a rollout asks of a law."""

    names: ClassVar[tuple[str, ...]]
    """Of what is given for every step; each is an attribute, (nv,) or a number for all, but ``q_des`` is (nq,)."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Laws of one key are one program."""

    def check(self, model: Model) -> None:
        """Refuse a robot that the law does not serve."""

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, /, *given: Array) -> Array:
        """τ (nv,) on symbols; ``angles`` are q again, for what is computed of poses."""

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, h: Any, /, *given: Array
    ) -> tuple[Array, Array | None]:
        """τ of a step of length h that takes rates at its end: τ at dq, and -∂τ/∂dq joint by joint if it is to be counted."""


@dataclass(frozen=True, eq=False)
class GivenTorque:
    """Torques that are given; nothing for none at all."""

    tau: ArrayLike | None = None
    names: ClassVar[tuple[str, ...]] = ("tau",)

    @property
    def key(self) -> tuple[Any, ...]:
        """That of all given torques."""
        return ("given",)

    def check(self, model: Model) -> None:
        """Any robot will do."""

    def torques(self, _model: Model, _angles: Array, _q: Array, _dq: Array, /, *given: Array) -> Array:
        """τ as it is given."""
        return given[0]

    def torques_of_step(
        self, _model: Model, _angles: Array, _q: Array, _dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, None]:
        """τ as it is given."""
        return given[0], None


@dataclass(frozen=True, eq=False)
class PD:
    """τ = kp (q_des - q) + kd (dq_des - dq), and g(q) on top with ``gravity=True``, at every joint of one degree of freedom.

    ``q_des`` (nq), ``dq_des`` (nv) and the gains, (nv) or one number for all, hold for all steps and samples; with axes
    (..., steps, n) they are said step by step, with (..., 1, n) sample by sample. Planar and floating joints get no torque,
    and their entries are of no account. g is that of the robot without ``parameters``. MR section 11.4.
    """

    q_des: ArrayLike
    kp: ArrayLike
    kd: ArrayLike
    dq_des: ArrayLike = 0.0
    gravity: bool = False
    names: ClassVar[tuple[str, ...]] = ("q_des", "dq_des", "kp", "kd")

    @property
    def key(self) -> tuple[Any, ...]:
        """One program with gravity, one without."""
        return ("pd", bool(self.gravity))

    def check(self, model: Model) -> None:
        """Any robot will do."""

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, *given: Array) -> Array:
        """The law, on symbols."""
        tau = proportional_derivative(model, q, dq, *given)
        if self.gravity:
            held = gravity_forces(model, angles)
            for body in model.leaders:
                if body.joint.nv == 1:
                    tau[body.v_index] = tau[body.v_index] + held[body.v_index]
        return tau

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, Array]:
        """The law at dq, and kd."""
        gains, kd = zeros(model.nv), given[3]
        for body in model.leaders:
            if body.joint.nv == 1:
                gains[body.v_index] = kd[body.v_index]
        return self.torques(model, angles, q, dq, *given), gains


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """τ = M (ddq_des + kp (q_des - q) + kd (dq_des - dq)) + h: the error obeys ë + kd ė + kp e = 0. MR eq. 11.35.

    Shapes are those of :class:`PD`. M and h are those of the robot without ``parameters``, gravity and springs included,
    friction not. Robots with planar or floating joints are refused: their law has no torque for every velocity.
    """

    q_des: ArrayLike
    kp: ArrayLike
    kd: ArrayLike
    dq_des: ArrayLike = 0.0
    ddq_des: ArrayLike = 0.0
    names: ClassVar[tuple[str, ...]] = ("q_des", "dq_des", "kp", "kd", "ddq_des")

    @property
    def key(self) -> tuple[Any, ...]:
        """That of all of them."""
        return ("computed torque",)

    def check(self, model: Model) -> None:
        """Refuse planar and floating joints."""
        if names := undriven(model):
            raise ValueRangeError(
                f"computed torque wants a torque for every velocity, and {', '.join(names)} is no joint of one degree of "
                "freedom. tw.simulation.PD drives the others and leaves it alone."
            )

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, *given: Array) -> Array:
        """The law, on symbols."""
        return np.asarray(computed_torque(model, angles, dq, self._wanted(model, q, dq, *given)))

    def torques_of_step(
        self,
        model: Model,
        angles: Array,
        q: Array,
        dq: Array,
        h: Any,  # noqa: ARG002  of all laws
        /,
        *given: Array,
    ) -> tuple[Array, None]:
        """The law at dq, kd too: at rates that the law's own model predicts, kd would change where it rests."""
        return self.torques(model, angles, q, dq, *given), None

    def _wanted(
        self, model: Model, q: Array, dq: Array, q_des: Array, dq_des: Array, kp: Array, kd: Array, ddq_des: Array
    ) -> Array:
        return np.asarray(ddq_des + proportional_derivative(model, q, dq, q_des, dq_des, kp, kd))
