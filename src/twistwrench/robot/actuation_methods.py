"""What the motors do, and where the power goes. Modern Robotics section 8.9."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import lazy
from ..errors import ModelError
from ..typing import Array
from .state_arguments import states

if TYPE_CHECKING:
    from ..algorithms.motor_side import MotorLoads
    from ..algorithms.power import PowerBalance
    from .wrench_arguments import Wrenches


def _loads(*found: Array) -> MotorLoads:
    from ..algorithms.motor_side import MotorLoads

    return MotorLoads(*found)


def _powers(*found: Array) -> PowerBalance:
    from ..algorithms.power import PowerBalance

    return PowerBalance(*found)


class ActuationMethods:
    """The methods of a robot about its motors and its power."""

    @lazy.by_blocks(lambda robot, _: [(len(robot.actuators),)] * 6, _loads)
    def motor_loads(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> MotorLoads:
        """Motor loads: torque, speed, current, voltage, power and heat of the motor of each actuator.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, count joint friction, which goes through the gear at its efficiency

        Returns
        -------
        loads : MotorLoads, (nactuators,) each, in the order of :attr:`actuators`

        Raises
        ------
        ModelError
            The robot has no actuators; see :meth:`with_actuators`.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        UnknownNameError
            A wrench is at no frame of the robot.

        Notes
        -----
        MR section 8.9. Rotors are accelerated before the gear; the rest goes through it at its efficiency.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> motor = {"torque_constant": "0.1 N m/A", "resistance": "0.5 ohm"}
        >>> driven = arm.with_actuators({"actuators": {"joint1": {"ratio": 100, "motor": motor}}})
        >>> driven.motor_loads([0, 0], [0, 0], [0, 0]).current.round(3).tolist()
        [2.943]
        """
        if not self.actuators:
            raise ModelError(f"robot {self.name!r} has no actuators. Describe them: robot.with_actuators(file).")
        given = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        carried, rotor = self.drive_torques(q, dq, ddq, **given)
        if friction:
            carried = carried + self.friction_forces(dq, load=carried + rotor)
        from ..algorithms.motor_side import motor_loads

        (dq,) = states(self.model, "motor_loads", dq=dq)
        return motor_loads(self.model, dq.astype(float), carried, rotor)

    @lazy.by_blocks(lambda *_: [()] * 4, _powers)
    def power_balance(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> PowerBalance:
        """Power balance: where the power goes at one state under torques τ; positive comes in, and the sum is zero.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        tau : (nv,) array_like, joint torques [N m, sliding joints: N]
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, count the friction of the joints

        Returns
        -------
        powers : PowerBalance, () each [W]: into the joints, into motion, at the wrenches, lost to friction

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        UnknownNameError
            A wrench is at no frame of the robot.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> balance = arm.power_balance([0.1, 0.2], [1.0, -1.0], [30.0, 5.0])
        >>> round(float(balance.joints), 9), abs(float(sum(balance))) < 1e-12
        (25.0, True)
        """
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        ddq = self.forward_dynamics(q, dq, tau, friction=friction, **given)
        return balanced(self, q, dq, ddq, tau, None, given, friction=friction)


def balanced(
    robot: Any, q: ArrayLike, dq: ArrayLike, ddq: Array, tau: ArrayLike, left: Array | None, wrenches: dict[str, Any],
    *, friction: bool = False,
) -> PowerBalance:  # fmt: skip
    """Where the power goes of a motion under torques τ; ``left`` is what friction leaves of them, where that is known."""
    from ..algorithms.power import power_balance

    dq, tau = states(robot.model, "power_balance", dq=dq, tau=tau)
    moving = robot.inverse_dynamics(q, dq, ddq)  # M ddq + h: dq times it is d/dt of the energy
    pushing = robot.holding_torques(q, **wrenches) - robot.holding_torques(q)
    lost = np.zeros_like(dq) if left is None else tau - left
    if friction:
        lost = robot.friction_forces(dq, load=moving + pushing)
    return power_balance(dq, tau, moving, pushing, lost)
