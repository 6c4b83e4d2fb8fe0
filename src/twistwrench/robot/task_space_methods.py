"""Task-space inertia and bias (MR section 8.6), and motor torques and powers (MR section 8.9)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments, third_party
from ..core.errors import ModelError, ModelWarning
from ..core.glossary import complete
from ..core.typing import Array
from .arguments import Kind, Rows, Wrenches, states, to_numbers
from .base import RobotBase, require_robot

if TYPE_CHECKING:
    from ..mechanics.algorithms.motor_loads import MotorLoads, PowerBalance
    from .doors import ConstrainedRobot
    from .robot import Robot


def _count(options: Mapping[str, Any]) -> int:
    from ..mechanics.algorithms.kinematics import row_numbers

    return len(row_numbers(options.get("rows")))


class TaskSpaceMethods(RobotBase):
    """Methods that express a robot's dynamics in task space."""

    @third_party.lazy_by_blocks(lambda _, options: [(_count(options),) * 2])
    def task_inertia(self, q: ArrayLike, frame: str | None = None, kind: Kind = "body", rows: Rows = None) -> Array:
        """Task-space (operational-space) inertia Λ of F = Λ dV + η on the selected rows of J: (J M⁻¹ J')⁻¹.

        MR section 8.6. If J loses rank, Λ is the pseudo-inverse, which acts on the remaining directions;
        :meth:`lost_directions` returns the others. A zero on the diagonal does not mean low inertia: no motion along
        that row is possible, so inertia is undefined.

        Returns
        -------
        Lambda : (r, r) array [kg m², kg m, kg]

        Warns
        -----
        ModelWarning
            Rows are lost at every configuration, as for a planar arm without ``rows``; once per robot and rows.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.task_inertia([0, np.pi / 2], kind="world_aligned", rows="vx vz").round(12).tolist()
        [[1.0, 0.0], [0.0, 2.0]]
        """
        return _task_quantity(cast("Robot", self), "task_inertia", (q,), frame, kind, rows)

    @third_party.lazy_by_blocks(lambda _, options: [(_count(options),)])
    def task_bias(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: Kind = "body", rows: Rows = None
    ) -> Array:
        """Task-space bias η of F = Λ dV + η on the selected rows of J: Λ (J M⁻¹ h - (dJ/dt) dq).

        MR section 8.6. A loss of rank of J is handled as in :meth:`task_inertia`.

        Returns
        -------
        eta : (r,) array [N m, N]

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.task_bias([0, 1], [0, 0], kind="world_aligned", rows="vx vz").round(2).tolist()
        [6.3, 19.62]
        """
        return _task_quantity(cast("Robot", self), "task_bias", (q, dq), frame, kind, rows)

    def lost_directions(self, q: ArrayLike, frame: str | None = None, kind: Kind = "body", rows: Rows = None) -> Array:
        """Lost directions of a singular configuration: those of the selected rows along which the frame cannot move.

        Wrenches along them require no torques, and Λ is zero on them. In a batch, the number of rows is that of the
        configuration that has lost most; the others are padded with zero rows.

        Returns
        -------
        F : (lost, r) array, orthonormal rows with F'J = 0

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> abs(arm.lost_directions([0, 0], kind="world_aligned", rows="vx vz").round(12)).tolist()
        [[1.0, 0.0]]
        """
        from ..mechanics.algorithms.constraint_projector import ConstraintProjector
        from ..mechanics.algorithms.kinematics import row_numbers

        q = np.asarray(arguments.finite(q, "lost_directions: q", self.nq, names=self.coordinate_names), float)
        chosen = list(row_numbers(rows))
        robot = require_robot(self, "lost_directions")
        J = robot.jacobian(q, frame, kind)[..., chosen, :]
        sizes = _samples(robot, frame, kind)[2][chosen]
        return ConstraintProjector.from_rows(J, robot.mass_matrix(q), sizes).lost


def _task_quantity(
    robot: Robot, name: str, arrays: tuple[ArrayLike, ...], frame: str | None, kind: Kind, rows: Rows
) -> Array:
    """Λ or η by the kernel; recomputed with singular values if pivots are near zero."""
    from ..mechanics.algorithms.constraint_projector import ConstraintProjector, needs_singular_values
    from ..mechanics.algorithms.kinematics import row_numbers

    chosen = row_numbers(rows)
    arrays = to_numbers(robot.model, name, arrays, {})
    if robot.nv == 0:
        robot.jacobian(arrays[0], frame, kind)  # argument validation
        batch = np.broadcast_shapes(*(np.shape(a)[:-1] for a in arrays))
        return np.zeros((*batch, len(chosen), len(chosen))[: len(batch) + 3 - len(arrays)])
    with np.errstate(all="ignore"):
        results, pivots = robot.engine.call(name, *arrays, frame=frame, kind=kind, rows=chosen)
    sizes = _samples(robot, frame, kind)[2][list(chosen)]
    finite = np.ones(pivots.shape[:-1], bool)
    for array in arrays:
        finite = finite & np.isfinite(array).all(axis=-1)
    results[~finite] = np.nan  # elimination of NaN may leave numbers
    singular = needs_singular_values(pivots, sizes) & finite
    if not singular.any():
        return np.asarray(results)
    _warn_of_lost_rows(robot, frame, kind, chosen)
    q, *dq = (np.broadcast_to(np.asarray(a, float), (*singular.shape, np.shape(a)[-1]))[singular] for a in arrays)
    J, M = robot.jacobian(q, frame, kind)[:, chosen], robot.mass_matrix(q)
    Lambda = ConstraintProjector.from_rows(J, M, sizes).pseudoinverse
    if dq:
        free = np.linalg.solve(M, robot.bias_forces(q, dq[0])[..., None])  # M⁻¹ h
        dJ_dq = robot.jacobian_rate(q, dq[0], frame, kind)[:, chosen] @ dq[0][..., None]
        results[singular] = (Lambda @ (J @ free - dJ_dq))[..., 0]
    else:
        results[singular] = Lambda
    return np.asarray(results)


def _samples(robot: Robot, frame: str | None, kind: Kind) -> tuple[Array, Array, Array]:
    """J (8, 6, nv) and M (8, nv, nv) at sample configurations, and typical sizes of the rows of J scaled by M; (6,)."""
    from ..mechanics.algorithms.constraint_projector import usual_sizes

    def build() -> tuple[Array, Array, Array]:
        robot.engine.require_invertible()
        configurations = robot.random_configuration(0, 8)
        J = np.stack([robot.reference("jacobian", q, frame=frame, kind=kind) for q in configurations])
        M = np.stack([robot.reference("mass_matrix", q) for q in configurations])
        return J, M, usual_sizes(J, M)

    samples: tuple[Array, Array, Array] = robot.engine.cache(("samples of J and M", frame, kind), build)
    return samples


def _warn_of_lost_rows(robot: Robot, frame: str | None, kind: Kind, chosen: tuple[int, ...]) -> None:
    """Warn once of rows that are lost at every configuration."""
    from ..mechanics.algorithms.constraint_projector import independent_rows
    from ..mechanics.lie.labelled import TWIST

    remarked = robot.engine.cache(("lost rows remarked", frame, kind, chosen), list)
    if remarked:
        return
    remarked.append(True)
    order = sorted(chosen, key=lambda row: (row < 3, row))  # linear rows first
    J, M, sizes = _samples(robot, frame, kind)
    independent = [order[k] for k in independent_rows(J[:, order], M, sizes[order])]
    if len(independent) == len(chosen):
        return
    immovable = [k for k in chosen if not independent_rows(J[:, [k]], M, sizes[[k]])]
    dependent = [k for k in chosen if k not in independent and k not in immovable]
    reasons = []
    if immovable:
        reasons.append(f"{' '.join(TWIST[k] for k in immovable)} never move")
    if dependent:
        reasons.append(f"the others determine {' '.join(TWIST[k] for k in dependent)}")
    advice = "this frame does not move along any of them"
    if independent:
        names = " ".join(TWIST[k] for k in chosen if k in independent)
        advice = f"choose independent ones, rows={names!r}"
    warnings.warn(
        f"robot {robot.name!r}: of the {len(chosen)} rows of {frame or robot.tip!r} ({kind!r}) only {len(independent)} can "
        f"move independently at any configuration: {' and '.join(reasons)}. Λ is 0 where no motion is possible, and no inertia "
        f"is defined there; {advice}.",
        ModelWarning,
        stacklevel=5,
    )


# ── Motor torques and powers. Modern Robotics section 8.9


def _make_motor_loads(*arrays: Any) -> MotorLoads:
    from ..mechanics.algorithms.motor_loads import MotorLoads

    return MotorLoads(*arrays)


def _make_power_balance(*arrays: Any) -> PowerBalance:
    from ..mechanics.algorithms.motor_loads import PowerBalance

    return PowerBalance(*arrays)


class ActuationMethods(RobotBase):
    """Methods of a robot, with or without constraints, for its motors and power."""

    def _loads(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        """Torques through the gears, and torques that accelerate the rotors, (nv,) each."""
        robot = self.open()
        if self.constraints:
            from .constraints.projections import inverse_dynamics

            motors = list(robot.actuators)
            tau = inverse_dynamics(
                cast("ConstrainedRobot", self), q, dq, ddq, motors, friction=friction, **wrenches
            ).tau
            _, rotor = robot.drive_torques(q, dq, ddq)
            return tau - rotor, rotor
        carried, rotor = robot.drive_torques(q, dq, ddq, **wrenches)
        if friction:
            from ..mechanics.model.actuators import moving

            (speeds,) = states(robot.model, "friction_forces", dq=dq)
            carried = carried + robot.friction_forces(moving(speeds), load=carried + rotor)
        return carried, rotor

    def _accelerate(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        """q̈ under torques τ, and τ minus friction, or None if not yet computed."""
        if self.constraints:
            from .constraints.projections import forward_dynamics

            ddq = forward_dynamics(cast("ConstrainedRobot", self), q, dq, tau, friction=friction, **wrenches).ddq
            return ddq, self.engine.call("torque_past_friction", dq, tau) if friction else None
        return self.open().forward_dynamics(q, dq, tau, friction=friction, **wrenches), None

    @third_party.lazy_by_blocks(lambda robot, _: [(len(robot.open().actuators),)] * 6, _make_motor_loads)
    def motor_loads(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> MotorLoads:
        """Motor loads: torque, speed, current, voltage, power and heat of the motor of each actuator.

        MR section 8.9. Motors accelerate the rotors; the remaining torque passes the gear at its efficiency. A closed
        robot is driven by actuators only; with more of them than degrees of freedom, torques have minimal norm.

        Parameters
        ----------
        friction : bool, include the friction of all joints, driven or not, transmitted at the gear's efficiency

        Returns
        -------
        loads : MotorLoads, (nactuators,) each, in the order of :attr:`twistwrench.Robot.actuators`

        Raises
        ------
        ModelError
            The robot has no actuators; see :meth:`twistwrench.Robot.with_actuators`.
        ConstraintError
            q, dq or ddq violates the constraints of a closed robot, or its actuators cannot produce the motion.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> motor = {"torque_constant": "0.1 N m/A", "resistance": "0.5 ohm"}
        >>> driven = arm.with_actuators({"actuators": {"joint1": {"ratio": 100, "motor": motor}}})
        >>> driven.motor_loads([0, 0], [0, 0], [0, 0]).current.round(3).tolist()
        [2.943]
        """
        robot = self.open()
        if not robot.actuators:
            raise ModelError(f"robot {robot.name!r} has no actuators. Describe them: robot.with_actuators(file).")
        wrenches = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        from ..mechanics.algorithms.motor_loads import motor_loads

        carried, rotor = self._loads(q, dq, ddq, friction, wrenches)
        (dq,) = states(robot.model, "motor_loads", dq=dq)
        return motor_loads(robot.model, dq.astype(float), carried, rotor)

    @third_party.lazy_by_blocks(lambda *_: [()] * 4, _make_power_balance)
    def power_balance(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> PowerBalance:
        """Power balance of one state under torques τ by source; positive values are supplied power; the sum is zero.

        Constraints do no work. For a closed robot, friction is that of the joints under τ, as in its forward dynamics.

        Returns
        -------
        powers : PowerBalance, () each [W]: into the joints, into motion, at the wrenches, lost to friction

        Raises
        ------
        ConstraintError
            q or dq violates the constraints of a closed robot.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> balance = arm.power_balance([0.1, 0.2], [1.0, -1.0], [30.0, 5.0])
        >>> round(float(balance.joints), 9), abs(float(sum(balance))) < 1e-12
        (25.0, True)
        """
        from ..mechanics.algorithms.motor_loads import power_balance

        robot, wrenches = self.open(), {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        ddq, past_friction = self._accelerate(q, dq, tau, friction, wrenches)
        dq, tau = states(robot.model, "power_balance", dq=dq, tau=tau)
        moving = robot.inverse_dynamics(q, dq, ddq)  # M ddq + h: times dq it is the rate of the energy
        pushing = robot.holding_torques(q, **wrenches) - robot.holding_torques(q)
        if past_friction is not None:
            friction_torque = tau - past_friction
        elif friction:
            friction_torque = robot.friction_forces(dq, load=moving + pushing)
        else:
            friction_torque = np.zeros_like(dq)
        return power_balance(dq, tau, moving, pushing, friction_torque)


complete(globals())
