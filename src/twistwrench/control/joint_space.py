"""Control of joints: PD with gravity compensation, and computed torque. Modern Robotics section 11.4.2."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..robot import Robot
from .gains import gain, one_state, require_driven
from .references import Motion, Reference, joint_motion

Array = NDArray[Any]

__all__ = ["PD", "ComputedTorque", "JointLaw"]


@dataclass(frozen=True, eq=False)
class JointLaw:
    """What joint-space laws have in common: a robot as the law knows it, a reference, and gains."""

    robot: Robot
    reference: Reference
    """q_d (nq,), or a function of the time [s] that gives (q_d, dq_d, ddq_d), such as a trajectory."""
    kp: ArrayLike
    """A number, (nv,), or (nv, nv)."""
    kd: ArrayLike
    _kp: Array = field(init=False, repr=False)
    _kd: Array = field(init=False, repr=False)
    _motion: Motion = field(init=False, repr=False)

    def __post_init__(self) -> None:
        what = type(self).__name__
        robot = require_driven(self.robot, what)
        for name in ("kp", "kd"):
            object.__setattr__(
                self, f"_{name}", gain(getattr(self, name), f"{what}: {name}", robot.model.velocity_names)
            )
        object.__setattr__(self, "_motion", joint_motion(robot, self.reference, f"{what}: reference"))

    def error(self, t: float, q: ArrayLike, dq: ArrayLike) -> tuple[Array, Array]:
        """e = q_d - q and dq_d - dq; (nv,) each."""
        q, dq = one_state(self.robot, type(self).__name__, q, dq)
        q_d, dq_d, _ = self._motion(t)
        return self.robot.subtract(q_d, q), dq_d - dq


@dataclass(frozen=True, eq=False)
class PD(JointLaw):
    """τ = Kp e + Kd ė + g(q): rests at q_d without a load, and Kp⁻¹ J'F beside it under one. MR section 11.4.2.

    g has the springs of elastic joints in it; ``gravity=False`` leaves it out, and the joint rests where Kp e carries it.
    Kp is a stiffness [N m/rad or N/m]. Raises ShapeError, ValueRangeError.

    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> hold = PD(arm, [0.5, 0.5], kp=100.0, kd=20.0)
    >>> np.allclose(hold(0.0, [0.5, 0.5], [0, 0]), arm.gravity_forces([0.5, 0.5]))
    True
    """

    gravity: bool = True

    @property
    def rate_gains(self) -> Array | None:
        """-∂τ/∂dq joint by joint, (nv,), which semi-implicit steps take at their end; None where Kd couples joints."""
        own = np.diagonal(self._kd).copy()
        return own if np.array_equal(self._kd, np.diag(own)) else None

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        e, de = self.error(t, q, dq)
        held = self.robot.holding_torques(q) if self.gravity else 0.0
        return self._kp @ e + self._kd @ de + held


@dataclass(frozen=True, eq=False)
class ComputedTorque(JointLaw):
    """τ = M (ddq_d + Kp e + Kd ė) + h: where the model is right, ë + Kd ė + Kp e = 0. MR section 11.4.2.2, eq. 11.35.

    Kp [1/s²] and Kd [1/s] are rates and no stiffness: Kd = 2 ω, Kp = ω² is critically damped. ``friction=True`` adds what
    overcomes the joints' friction. Raises ShapeError, ValueRangeError.

    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> reach = ComputedTorque(arm, [1.0, 0.5], kp=100.0, kd=20.0)
    >>> ddq = arm.forward_dynamics([0, 0], [0, 0], reach(0.0, [0, 0], [0, 0]))
    >>> ddq.round(9).tolist()
    [100.0, 50.0]
    """

    friction: bool = False

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        e, de = self.error(t, q, dq)
        ddq = self._motion(t)[2] + self._kp @ e + self._kd @ de
        return self.robot.inverse_dynamics(q, dq, ddq, friction=self.friction)
