"""Joint-space control: PD with gravity compensation, and computed torque. Modern Robotics section 11.4.2."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array
from ..robot import Robot
from ..simulation.torque_laws import BatchComputedTorque, BatchPD
from .references import Motion, Reference, joint_motion, one_state, require_driven, set_gains


@dataclass(frozen=True, eq=False)
class JointLaw:
    """Base of joint-space laws: the robot of the controller's model, a reference, and gains."""

    robot: Robot
    """Robot of the controller's model."""
    reference: Reference
    """q_d (nq,), or a function of the time [s] that returns (q_d, dq_d, ddq_d), such as a trajectory."""
    kp: ArrayLike
    """Position gains: scalar, (nv,), or (nv, nv)."""
    kd: ArrayLike
    """Velocity gains: scalar, (nv,), or (nv, nv)."""
    _kp: Array = field(init=False, repr=False)
    """Kp (nv, nv)."""
    _kd: Array = field(init=False, repr=False)
    """Kd (nv, nv)."""
    _motion: Motion = field(init=False, repr=False)
    """Function of the time that returns q_d, dq_d and ddq_d."""

    def __post_init__(self) -> None:
        law_name = type(self).__name__
        robot = require_driven(self.robot, law_name)
        set_gains(self, robot.model.velocity_names, "kp", "kd")
        object.__setattr__(self, "_motion", joint_motion(robot, self.reference, f"{law_name}: reference"))

    def error(self, t: float, q: ArrayLike, dq: ArrayLike) -> tuple[Array, Array]:
        """Tracking error: e = q_d - q and dq_d - dq.

        Returns
        -------
        e : (nv,) array [rad, m]
        de : (nv,) array [rad/s, m/s]

        Examples
        --------
        >>> import twistwrench as tw
        >>> PD(tw.robots.planar_2r(), [0.5, 0.5], kp=100.0, kd=20.0).error(0.0, [0, 0], [0, 0])[0].tolist()
        [0.5, 0.5]
        """
        q, dq = one_state(self.robot, type(self).__name__, q, dq)
        q_d, dq_d, _ = self._motion(t)
        return self.robot.subtract(q_d, q), dq_d - dq

    def batch_law(self, robot: Robot, times: Array) -> BatchPD | BatchComputedTorque:
        """Form of this law for the motions of a rollout.

        Parameters
        ----------
        robot : Robot, robot of the rollout
        times : (steps,) array, start times of the steps, at which a moving reference is evaluated [s]

        Returns
        -------
        law : BatchPD or BatchComputedTorque

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> PD(arm, [0.5, 0.5], kp=100.0, kd=20.0).batch_law(arm, np.arange(3.0)).kp.tolist()
        [100.0, 100.0]
        """
        law_name = type(self).__name__
        if robot.model is not self.robot.model:
            raise ValueRangeError(
                f"{law_name} was made with the robot {self.robot.name!r}, and the rollout is of "
                f"another, {robot.name!r}. Make the control law with the robot that it moves; "
                "rollout(parameters=…) changes the simulated robot, not the model inside the law."
            )
        kp = np.diagonal(self._kp)
        kd = np.diagonal(self._kd)
        is_kp_diagonal = np.array_equal(self._kp, np.diag(kp))
        is_kd_diagonal = np.array_equal(self._kd, np.diag(kd))
        if not (is_kp_diagonal and is_kd_diagonal):
            raise ValueRangeError(
                f"{law_name}: gains of a rollout are a number for each joint, and these couple joints. "
                "robot.simulate takes them."
            )
        is_moving = callable(self.reference) or hasattr(self.reference, "motion")
        if not is_moving:
            times = np.zeros(1)  # one row stands for all steps
        states = [self._motion(t) for t in times]
        q_d = np.array([q for q, _, _ in states], float)
        dq_d = np.array([dq for _, dq, _ in states], float)
        ddq_d = np.array([ddq for _, _, ddq in states], float)
        return self._law({"q_des": q_d, "dq_des": dq_d, "ddq_des": ddq_d, "kp": kp, "kd": kd})

    def _law(self, values: dict[str, Array]) -> BatchPD | BatchComputedTorque:
        """Law of a rollout from ``values``, its reference and gains by name."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class PD(JointLaw):
    """PD control with gravity compensation: τ = Kp e + Kd ė + g(q). MR section 11.4.2.

    The equilibrium is q_d without a load, and Kp⁻¹ J'F away from q_d under a load. Kp is a stiffness [N m/rad or N/m].

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> hold = PD(arm, [0.5, 0.5], kp=100.0, kd=20.0)
    >>> np.allclose(hold(0.0, [0.5, 0.5], [0, 0]), arm.gravity_forces([0.5, 0.5]))
    True
    """

    gravity: bool = True
    """True to add g and the torques of springs; otherwise a joint rests where Kp e balances these torques."""

    @property
    def rate_gains(self) -> Array | None:
        """Damping -∂τ/∂dq joint by joint (nv,) [N m s/rad or N s/m], for semi-implicit steps; None if Kd couples joints."""
        damping = np.diagonal(self._kd).copy()
        couples_joints = not np.array_equal(self._kd, np.diag(damping))
        return None if couples_joints else damping

    def _law(self, values: dict[str, Array]) -> BatchPD:
        del values["ddq_des"]  # PD control does not use it
        return BatchPD(**values, gravity=self.gravity)

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        e, de = self.error(t, q, dq)
        holding = self.robot.holding_torques(q) if self.gravity else 0.0
        return self._kp @ e + self._kd @ de + holding


@dataclass(frozen=True, eq=False)
class ComputedTorque(JointLaw):
    """Computed-torque control: τ = M (ddq_d + Kp e + Kd ė) + h; with an exact model, ë + Kd ė + Kp e = 0.

    Kp [1/s²] and Kd [1/s] are rates, not stiffnesses: Kd = 2 ω, Kp = ω² is critically damped. MR eq. 11.35.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> reach = ComputedTorque(arm, [1.0, 0.5], kp=100.0, kd=20.0)
    >>> ddq = arm.forward_dynamics([0, 0], [0, 0], reach(0.0, [0, 0], [0, 0]))
    >>> ddq.round(9).tolist()
    [100.0, 50.0]
    """

    friction: bool = False
    """True to add torques that compensate joint friction."""

    def _law(self, values: dict[str, Array]) -> BatchComputedTorque:
        if self.friction:
            raise ValueRangeError(
                "ComputedTorque: the law of a rollout leaves friction out. Give friction=False, or take robot.simulate."
            )
        return BatchComputedTorque(**values)

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        e, de = self.error(t, q, dq)
        _, _, ddq_d = self._motion(t)
        ddq = ddq_d + self._kp @ e + self._kd @ de
        return self.robot.inverse_dynamics(q, dq, ddq, friction=self.friction)


complete(globals())
