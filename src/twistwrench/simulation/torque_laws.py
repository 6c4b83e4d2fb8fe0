"""Torque laws of a rollout on symbols, with their inputs. Modern Robotics section 11.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.inverse_dynamics import holding_torques
from ..algorithms.operational_space import computed_torque, proportional_derivative, undriven
from ..algorithms.recursion import zeros
from ..core import arguments
from ..core.glossary import complete
from ..errors import ValueRangeError
from ..model.model import Model
from ..typing import Array


class TorqueLaw(Protocol):
    """Control law of a rollout."""

    names: ClassVar[tuple[str, ...]]
    """Names of the inputs of every step; each is an attribute, (nv,) or a number for all, but ``q_des`` is (nq,)."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Laws of one key are one program."""

    def check(self, model: Model) -> None:
        """Refuse a robot that the law does not serve."""

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, /, *given: Array) -> Array:
        """Torques of the law, on symbols; angles are q again, for sines and cosines.

        Returns
        -------
        tau : (nv,) array of symbols
        """
        raise NotImplementedError

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, h: Any, /, *given: Array
    ) -> tuple[Array, Array | None]:
        """Torques of the law at dq, and its damping, for steps of length h that take the rates at their end.

        Returns
        -------
        tau : (nv,) array of symbols
        damping : (nv,) array of symbols or None, -∂τ/∂dq joint by joint, where it is to be counted
        """
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class GivenTorque(TorqueLaw):
    """Torques that are given; nothing for none at all."""

    tau: ArrayLike | None = None
    names: ClassVar[tuple[str, ...]] = ("tau",)

    @property
    def key(self) -> tuple[Any, ...]:
        """Key of all given torques."""
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
class BatchPD(TorqueLaw):
    """PD law of the motions of a rollout: τ = kp (q_des - q) + kd (dq_des - dq) + g(q). MR section 11.4.

    Gains and references may differ from motion to motion, which those of :class:`twistwrench.control.PD` do not. At
    every joint of one degree of freedom; ball, planar and floating joints get no torque, and their entries are ignored.
    Values hold for all steps and samples; with axes (..., steps, n) they are said step by step, with (..., 1, n) sample
    by sample. g, with what springs of the robot add to it, is that of the robot without ``parameters``.
    """

    q_des: ArrayLike
    """Wanted configuration (nq,)."""
    kp: ArrayLike
    """Stiffness (nv,) or one number for all, N m/rad or N/m."""
    kd: ArrayLike
    """Damping (nv,) or one number for all, N m s/rad or N s/m."""
    dq_des: ArrayLike = 0.0
    """Wanted velocities (nv,) or one number for all, rad/s or m/s."""
    gravity: bool = True
    """True if g(q) is added."""
    names: ClassVar[tuple[str, ...]] = ("q_des", "dq_des", "kp", "kd")

    @property
    def key(self) -> tuple[Any, ...]:
        """One program with gravity, one without."""
        return ("pd", arguments.flag(self.gravity, "PD: gravity"))

    def check(self, model: Model) -> None:
        """Check that the robot will do; any does.

        Examples
        --------
        >>> import twistwrench as tw
        >>> BatchPD([0, 0], kp=1.0, kd=1.0).check(tw.robots.planar_2r().model)
        """

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, *given: Array) -> Array:
        """The law, on symbols."""
        tau = proportional_derivative(model, q, dq, *given)
        if self.gravity:
            held = holding_torques(model, angles)
            for body in model.leaders:
                if body.joint.nv == 1:
                    tau[body.v_index] = tau[body.v_index] + held[body.v_index]
        return tau

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, Array]:
        """The law at dq, and kd, for semi-implicit steps."""
        gains, kd = zeros(model.nv), given[3]
        for body in model.leaders:
            if body.joint.nv == 1:
                gains[body.v_index] = kd[body.v_index]
        return self.torques(model, angles, q, dq, *given), gains


@dataclass(frozen=True, eq=False)
class BatchComputedTorque(TorqueLaw):
    """Computed-torque law of the motions of a rollout: τ = M (ddq_des + kp (q_des - q) + kd (dq_des - dq)) + h.

    The error obeys ë + kd ė + kp e = 0 (MR eq. 11.35). Shapes are those of :class:`BatchPD`, M and h of the robot without
    ``parameters``, gravity and springs included, friction not. Robots with ball, planar or floating joints are refused:
    q_des - q is not an error of such a joint.
    """

    q_des: ArrayLike
    """Wanted configuration (nq,)."""
    kp: ArrayLike
    """Proportional gain (nv,) or one number for all, 1/s²."""
    kd: ArrayLike
    """Derivative gain (nv,) or one number for all, 1/s."""
    dq_des: ArrayLike = 0.0
    """Wanted velocities (nv,) or one number for all, rad/s or m/s."""
    ddq_des: ArrayLike = 0.0
    """Wanted accelerations (nv,) or one number for all, rad/s² or m/s²."""
    names: ClassVar[tuple[str, ...]] = ("q_des", "dq_des", "kp", "kd", "ddq_des")

    @property
    def key(self) -> tuple[Any, ...]:
        """Key of the sum."""
        return ("computed torque",)

    def check(self, model: Model) -> None:
        """Refuse joints of several degrees of freedom: ball, planar and floating ones.

        Examples
        --------
        >>> import twistwrench as tw
        >>> BatchComputedTorque([0, 0], kp=1.0, kd=1.0).check(tw.robots.planar_2r().model)
        """
        if names := undriven(model):
            raise ValueRangeError(
                f"computed torque wants a torque for every velocity, and {', '.join(names)} is not a joint of one degree of "
                "freedom. tw.simulation.BatchPD drives the others and leaves it alone."
            )

    def torques(self, model: Model, angles: Array, q: Array, dq: Array, *given: Array) -> Array:
        """The law, on symbols."""
        *pd, ddq_des = given
        return np.asarray(computed_torque(model, angles, dq, ddq_des + proportional_derivative(model, q, dq, *pd)))

    def torques_of_step(
        self, model: Model, angles: Array, q: Array, dq: Array, _h: Any, /, *given: Array
    ) -> tuple[Array, None]:
        """The law at dq, no damping: at rates that the law's own model predicts, kd would change where it rests."""
        return self.torques(model, angles, q, dq, *given), None


complete(globals())
