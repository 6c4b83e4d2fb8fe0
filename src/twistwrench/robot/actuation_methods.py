"""What the motors do, and where the power goes. Modern Robotics section 8.9."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import lazy
from ..errors import ModelError
from .state_arguments import states

if TYPE_CHECKING:
    from ..algorithms.motor_side import MotorLoads
    from ..algorithms.power import PowerBalance
    from .wrench_arguments import Wrenches


def _of_motors(*found: Any) -> MotorLoads:
    from ..algorithms.motor_side import MotorLoads

    return MotorLoads(*found)


def _of_powers(*found: Any) -> PowerBalance:
    from ..algorithms.power import PowerBalance

    return PowerBalance(*found)


class ActuationMethods:
    """The methods of a robot, open or closed, about its motors and its power."""

    def _loads(self: Any, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        """What goes through the gears, and what the rotors take before them, (nv,) each."""
        carried, rotor = self.drive_torques(q, dq, ddq, **wrenches)
        if friction:
            carried = carried + self.friction_forces(dq, load=carried + rotor)
        return carried, rotor

    def _moved(self: Any, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        """q̈ under torques τ, and what friction leaves of them, None where that is still to be found."""
        return self.forward_dynamics(q, dq, tau, friction=friction, **wrenches), None

    @lazy.by_blocks(lambda robot, _: [(len(robot._open().actuators),)] * 6, _of_motors)
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
        friction : bool, count the friction of all joints, driven or not, which goes through the gear at its efficiency

        Returns
        -------
        loads : MotorLoads, (nactuators,) each, in the order of :attr:`twistwrench.Robot.actuators`

        Raises
        ------
        ModelError
            The robot has no actuators; see :meth:`twistwrench.Robot.with_actuators`.
        ConstraintError
            q, dq or ddq breaks the constraints of a closed robot, or its actuators cannot make the motion.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        UnknownNameError
            A wrench is at no frame of the robot.

        Notes
        -----
        MR section 8.9. Rotors are accelerated before the gear; the rest goes through it at its efficiency. Actuators alone
        drive a closed robot; with more of them than degrees of freedom their torques are those of least norm.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> motor = {"torque_constant": "0.1 N m/A", "resistance": "0.5 ohm"}
        >>> driven = arm.with_actuators({"actuators": {"joint1": {"ratio": 100, "motor": motor}}})
        >>> driven.motor_loads([0, 0], [0, 0], [0, 0]).current.round(3).tolist()
        [2.943]
        >>> arm = tw.robots.planar_3r().with_actuators({"actuators": {"joint1": {"ratio": 100, "motor": motor}}})
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> loads, tau = held.motor_loads(q, [0, 0, 0], [0, 0, 0]), held.holding_torques(q, ["joint1"]).tau
        >>> bool(abs(loads.torque[0] - tau[0] / 100) < 1e-12)
        True
        """
        robot = self._open()
        if not robot.actuators:
            raise ModelError(f"robot {robot.name!r} has no actuators. Describe them: robot.with_actuators(file).")
        given = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        from ..algorithms.motor_side import motor_loads

        carried, rotor = self._loads(q, dq, ddq, friction, given)
        (dq,) = states(robot.model, "motor_loads", dq=dq)
        return motor_loads(robot.model, dq.astype(float), carried, rotor)

    @lazy.by_blocks(lambda *_: [()] * 4, _of_powers)
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
        ConstraintError
            q or dq breaks the constraints of a closed robot.

        Notes
        -----
        Constraints take no power. Friction of a closed robot is that of the joints under τ, as in its forward dynamics.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> balance = arm.power_balance([0.1, 0.2], [1.0, -1.0], [30.0, 5.0])
        >>> round(float(balance.joints), 9), abs(float(sum(balance))) < 1e-12
        (25.0, True)
        """
        from ..algorithms.power import power_balance

        robot, wrenches = self._open(), {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        ddq, left = self._moved(q, dq, tau, friction, wrenches)
        dq, tau = states(robot.model, "power_balance", dq=dq, tau=tau)
        moving = robot.inverse_dynamics(q, dq, ddq)  # M ddq + h: dq times it is d/dt of the energy
        pushing = robot.holding_torques(q, **wrenches) - robot.holding_torques(q)
        if left is not None:
            lost = tau - left
        else:
            lost = robot.friction_forces(dq, load=moving + pushing) if friction else np.zeros_like(dq)
        return power_balance(dq, tau, moving, pushing, lost)
