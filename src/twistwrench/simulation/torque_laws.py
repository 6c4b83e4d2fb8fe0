"""Torque laws of a rollout on symbols, with their inputs. Modern Robotics section 11.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.algorithms.inverse_dynamics import holding_torques
from ..mechanics.algorithms.operational_space import computed_torque, multi_dof_joints, proportional_derivative
from ..mechanics.algorithms.recursion import zeros
from ..mechanics.model.model import Model


class TorqueLaw(Protocol):
    """Control law of a rollout."""

    names: ClassVar[tuple[str, ...]]
    """Names of the inputs of every step, which are attributes: ``q_des`` (nq,), others (nv,) or one number for all joints."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Cache key: laws with equal keys share a program."""

    def check(self, model: Model) -> None:
        """Raise an error for a robot that the law does not support."""

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, /, *given: Array) -> Array:
        """Torques of the law, on symbols; ``angles`` are q again, for sines and cosines, and ``given`` are the inputs.

        Returns
        -------
        tau : (nv,) array of symbols
        """
        raise NotImplementedError

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, h: Any, /, *given: Array
    ) -> tuple[Array, Array | None]:
        """Torques of the law at dq, and its damping, for semi-implicit steps of length h.

        Returns
        -------
        tau : (nv,) array of symbols
        damping : (nv,) array of symbols or None, -∂τ/∂dq joint by joint, to be treated implicitly
        """
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class GivenTorque(TorqueLaw):
    """Given torques, possibly none."""

    tau: ArrayLike | None = None
    """Torques (nv,); None for zero torques."""
    names: ClassVar[tuple[str, ...]] = ("tau",)

    @property
    def key(self) -> tuple[Any, ...]:
        """Key of all given torques."""
        return ("given",)

    def check(self, model: Model) -> None:
        """Accept any robot."""

    def torques(self, _model: Model, _angles: Array, _q: Array, _dq: Array, /, *given: Array) -> Array:
        """Given torques τ."""
        (tau,) = given
        return tau

    def torques_of_step(
        self, _model: Model, _angles: Array, _q: Array, _dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, None]:
        """Given torques τ."""
        (tau,) = given
        return tau, None


@dataclass(frozen=True, eq=False)
class BatchPD(TorqueLaw):
    """PD law of the motions of a rollout: τ = kp (q_des - q) + kd (dq_des - dq) + g(q). MR section 11.4.

    Unlike in :class:`twistwrench.control.PD`, gains and references may differ between motions. The law acts on joints
    with one degree of freedom; ball, planar and floating joints get no torque, and their entries are ignored. A value of
    shape (n,) applies to all steps and samples, (..., steps, n) to each step, and (..., 1, n) to each sample. g includes
    springs, and is computed without ``parameters``.
    """

    q_des: ArrayLike
    """Desired configuration (nq,)."""
    kp: ArrayLike
    """Stiffness (nv,) or one number for all, N m/rad or N/m."""
    kd: ArrayLike
    """Damping (nv,) or one number for all, N m s/rad or N s/m."""
    dq_des: ArrayLike = 0.0
    """Desired velocities (nv,) or one number for all, rad/s or m/s."""
    gravity: bool = True
    """True if g(q) is added."""
    names: ClassVar[tuple[str, ...]] = ("q_des", "dq_des", "kp", "kd")

    @property
    def key(self) -> tuple[Any, ...]:
        """Key: one program with gravity, one without."""
        return ("pd", arguments.flag(self.gravity, "PD: gravity"))

    def check(self, model: Model) -> None:
        """Accept any robot.

        Examples
        --------
        >>> import twistwrench as tw
        >>> BatchPD([0, 0], kp=1.0, kd=1.0).check(tw.robots.planar_2r().model)
        """

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, *given: Array) -> Array:
        """Torques of the law, on symbols."""
        tau = proportional_derivative(model, q, dq, *given)
        if self.gravity:
            gravity_torques = holding_torques(model, angles)
            for body in model.leaders:
                if body.joint.nv == 1:
                    tau[body.v_index] = tau[body.v_index] + gravity_torques[body.v_index]
        return tau

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, Array]:
        """Torques of the law at dq, and its damping: kd, or zero for joints that get no torque."""
        _q_des, _dq_des, _kp, kd = given
        damping = zeros(model.nv)
        for body in model.leaders:
            if body.joint.nv == 1:
                damping[body.v_index] = kd[body.v_index]
        return self.torques(model, angles, q, dq, *given), damping


@dataclass(frozen=True, eq=False)
class BatchComputedTorque(TorqueLaw):
    """Computed-torque law of the motions of a rollout: τ = M (ddq_des + kp (q_des - q) + kd (dq_des - dq)) + h.

    The error obeys ë + kd ė + kp e = 0 (MR eq. 11.35). Shapes are as in :class:`BatchPD`. M and h are computed without
    ``parameters``; h includes gravity and springs, but not friction. Ball, planar and floating joints raise an error,
    because q_des - q is not an error of such a joint.
    """

    q_des: ArrayLike
    """Desired configuration (nq,)."""
    kp: ArrayLike
    """Proportional gain (nv,) or one number for all, 1/s²."""
    kd: ArrayLike
    """Derivative gain (nv,) or one number for all, 1/s."""
    dq_des: ArrayLike = 0.0
    """Desired velocities (nv,) or one number for all, rad/s or m/s."""
    ddq_des: ArrayLike = 0.0
    """Desired accelerations (nv,) or one number for all, rad/s² or m/s²."""
    names: ClassVar[tuple[str, ...]] = ("q_des", "dq_des", "kp", "kd", "ddq_des")

    @property
    def key(self) -> tuple[Any, ...]:
        """Key of the only program."""
        return ("computed torque",)

    def check(self, model: Model) -> None:
        """Raise an error for joints with several degrees of freedom: ball, planar and floating ones.

        Examples
        --------
        >>> import twistwrench as tw
        >>> BatchComputedTorque([0, 0], kp=1.0, kd=1.0).check(tw.robots.planar_2r().model)
        """
        names = multi_dof_joints(model)
        if names:
            raise ValueRangeError(
                f"computed torque wants a torque for every velocity, and {', '.join(names)} is not a joint of one degree of "
                "freedom. tw.simulation.BatchPD drives the others and leaves it alone."
            )

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, *given: Array) -> Array:
        """Torques of the law, on symbols."""
        *pd_inputs, ddq_des = given
        ddq = ddq_des + proportional_derivative(model, q, dq, *pd_inputs)
        return np.asarray(computed_torque(model, angles, dq, ddq))

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, None]:
        """Torques of the law at dq, without damping, since kd treated implicitly would shift the law's equilibrium."""
        return self.torques(model, angles, q, dq, *given), None


complete(globals())
