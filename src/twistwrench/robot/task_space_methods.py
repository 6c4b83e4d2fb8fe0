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


def _row_count(options: Mapping[str, Any]) -> int:
    """Number of rows that the option ``rows`` selects."""
    from ..mechanics.algorithms.kinematics import row_numbers

    return len(row_numbers(options.get("rows")))


class TaskSpaceMethods(RobotBase):
    """Methods that express a robot's dynamics in task space."""

    @third_party.lazy_by_blocks(lambda _, options: [(_row_count(options),) * 2])
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

    @third_party.lazy_by_blocks(lambda _, options: [(_row_count(options),)])
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
        """Lost directions of a singular configuration: directions on the selected rows along which the frame cannot move.

        Wrenches along them require no torques, and Λ is zero on them. In a batch, ``lost`` is the largest number of lost
        directions; other configurations are padded with zero rows.

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
        row_indices = list(row_numbers(rows))
        robot = require_robot(self, "lost_directions")
        J = robot.jacobian(q, frame, kind)[..., row_indices, :]
        _, _, sizes = _samples(robot, frame, kind)
        return ConstraintProjector.from_rows(J, robot.mass_matrix(q), sizes[row_indices]).lost


def _task_quantity(
    robot: Robot, name: str, arrays: tuple[ArrayLike, ...], frame: str | None, kind: Kind, rows: Rows
) -> Array:
    """Λ of ``arrays`` (q,), or η of (q, dq), by the kernel ``name``; by singular values if pivots are near zero."""
    from ..mechanics.algorithms.constraint_projector import ConstraintProjector, needs_singular_values
    from ..mechanics.algorithms.kinematics import row_numbers

    row_indices = row_numbers(rows)
    arrays = to_numbers(robot.model, name, arrays, {})
    row_count = len(row_indices)
    if robot.nv == 0:
        robot.jacobian(arrays[0], frame, kind)  # raises the errors of invalid arguments
        batch_shape = np.broadcast_shapes(*(np.shape(array)[:-1] for array in arrays))
        result_shape: tuple[int, ...] = (row_count,)
        if name == "task_inertia":
            result_shape = (row_count, row_count)
        return np.zeros((*batch_shape, *result_shape))
    with np.errstate(all="ignore"):  # singular configurations are recomputed below
        results, pivots = robot.engine.call(name, *arrays, frame=frame, kind=kind, rows=row_indices)
    _, _, all_sizes = _samples(robot, frame, kind)
    sizes = all_sizes[list(row_indices)]
    is_finite = np.ones(pivots.shape[:-1], bool)
    for array in arrays:
        is_finite = is_finite & np.isfinite(array).all(axis=-1)
    results[~is_finite] = np.nan  # elimination with NaN may result in numbers
    is_singular = needs_singular_values(pivots, sizes) & is_finite
    if not is_singular.any():
        return np.asarray(results)
    _warn_of_lost_rows(robot, frame, kind, row_indices)
    arrays_at_singular = []  # q, or q and dq, of the singular configurations alone
    for array in arrays:
        full_shape = (*is_singular.shape, np.shape(array)[-1])
        arrays_at_singular.append(np.broadcast_to(np.asarray(array, float), full_shape)[is_singular])
    q, *further_arrays = arrays_at_singular
    J = robot.jacobian(q, frame, kind)[:, row_indices]
    M = robot.mass_matrix(q)
    Lambda = ConstraintProjector.from_rows(J, M, sizes).pseudoinverse
    if name == "task_inertia":
        results[is_singular] = Lambda
    else:
        (dq,) = further_arrays
        M_inverse_h = np.linalg.solve(M, robot.bias_forces(q, dq)[..., None])
        dJ_dq = robot.jacobian_rate(q, dq, frame, kind)[:, row_indices] @ dq[..., None]
        eta = Lambda @ (J @ M_inverse_h - dJ_dq)  # (singular configurations, rows, 1)
        results[is_singular] = eta[..., 0]
    return np.asarray(results)


_SAMPLE_COUNT = 8
"""Number of random configurations at which typical sizes are computed."""


def _samples(robot: Robot, frame: str | None, kind: Kind) -> tuple[Array, Array, Array]:
    """J (8, 6, nv) and M (8, nv, nv) at random configurations, and typical sizes (6,) of the rows of J scaled by M."""
    from ..mechanics.algorithms.constraint_projector import usual_sizes

    def build() -> tuple[Array, Array, Array]:
        robot.engine.require_invertible()
        configurations = robot.random_configuration(0, _SAMPLE_COUNT)
        J = np.stack([robot.reference("jacobian", q, frame=frame, kind=kind) for q in configurations])
        M = np.stack([robot.reference("mass_matrix", q) for q in configurations])
        return J, M, usual_sizes(J, M)

    samples: tuple[Array, Array, Array] = robot.engine.cache(("samples of J and M", frame, kind), build)
    return samples


def _warn_of_lost_rows(robot: Robot, frame: str | None, kind: Kind, row_indices: tuple[int, ...]) -> None:
    """Warn, once for a robot and rows, of rows that are lost at every configuration."""
    from ..mechanics.algorithms.constraint_projector import independent_rows
    from ..mechanics.lie.labelled import TWIST

    # The engine's cache keeps this list, which has an entry after the first call.
    earlier_calls = robot.engine.cache(("lost rows remarked", frame, kind, row_indices), list)
    if earlier_calls:
        return
    earlier_calls.append(True)
    rows_in_order = sorted(row_indices, key=lambda row: (row < 3, row))  # linear rows first: they count as independent
    J, M, sizes = _samples(robot, frame, kind)
    kept_rows = [rows_in_order[k] for k in independent_rows(J[:, rows_in_order], M, sizes[rows_in_order])]
    if len(kept_rows) == len(row_indices):
        return
    immovable_rows = [row for row in row_indices if not independent_rows(J[:, [row]], M, sizes[[row]])]
    dependent_rows = [row for row in row_indices if row not in kept_rows and row not in immovable_rows]
    reasons = []
    if immovable_rows:
        reasons.append(f"{' '.join(TWIST[row] for row in immovable_rows)} never move")
    if dependent_rows:
        reasons.append(f"the others determine {' '.join(TWIST[row] for row in dependent_rows)}")
    advice = "this frame does not move along any of them"
    if kept_rows:
        kept_names = " ".join(TWIST[row] for row in row_indices if row in kept_rows)
        advice = f"choose independent ones, rows={kept_names!r}"
    warnings.warn(
        f"robot {robot.name!r}: of the {len(row_indices)} rows of {frame or robot.tip!r} ({kind!r}) only {len(kept_rows)} "
        f"can move independently at any configuration: {' and '.join(reasons)}. Λ is 0 where no motion is possible, and no "
        f"inertia is defined there; {advice}.",
        ModelWarning,
        stacklevel=5,
    )


# ── Motor torques and powers. Modern Robotics section 8.9


def _make_motor_loads(*arrays: Any) -> MotorLoads:
    """Motor loads of the arrays of a lazy result."""
    from ..mechanics.algorithms.motor_loads import MotorLoads

    return MotorLoads(*arrays)


def _make_power_balance(*arrays: Any) -> PowerBalance:
    """Power balance of the arrays of a lazy result."""
    from ..mechanics.algorithms.motor_loads import PowerBalance

    return PowerBalance(*arrays)


class ActuationMethods(RobotBase):
    """Methods of a robot, with or without constraints, for its motors and power."""

    def _drive_torques(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, friction: bool, wrenches: dict[str, Any]
    ) -> Any:
        """Torques through the gears, and torques that accelerate the rotors, (nv,) each."""
        robot = self.open()
        if self.constraints:
            from .constraints.projections import inverse_dynamics

            motors = list(robot.actuators)
            closed = cast("ConstrainedRobot", self)
            tau = inverse_dynamics(closed, q, dq, ddq, motors, friction=friction, **wrenches).tau
            _, rotor_torques = robot.drive_torques(q, dq, ddq)
            return tau - rotor_torques, rotor_torques
        gear_torques, rotor_torques = robot.drive_torques(q, dq, ddq, **wrenches)
        if friction:
            from ..mechanics.model.actuators import moving

            (dq_array,) = states(robot.model, "friction_forces", dq=dq)
            load = gear_torques + rotor_torques
            gear_torques = gear_torques + robot.friction_forces(moving(dq_array), load=load)
        return gear_torques, rotor_torques

    def _accelerate(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        """Accelerations q̈ under torques τ, and τ minus friction, which is None for an open robot or without friction."""
        if not self.constraints:
            return self.open().forward_dynamics(q, dq, tau, friction=friction, **wrenches), None
        from .constraints.projections import forward_dynamics

        ddq = forward_dynamics(cast("ConstrainedRobot", self), q, dq, tau, friction=friction, **wrenches).ddq
        if not friction:
            return ddq, None
        return ddq, self.engine.call("torque_past_friction", dq, tau)

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

        gear_torques, rotor_torques = self._drive_torques(q, dq, ddq, friction, wrenches)
        (dq,) = states(robot.model, "motor_loads", dq=dq)
        return motor_loads(robot.model, dq.astype(float), gear_torques, rotor_torques)

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

        robot = self.open()
        wrenches = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        ddq, tau_past_friction = self._accelerate(q, dq, tau, friction, wrenches)
        dq, tau = states(robot.model, "power_balance", dq=dq, tau=tau)
        motion_torques = robot.inverse_dynamics(q, dq, ddq)  # M ddq + h: times dq it is the rate of the energy
        wrench_torques = robot.holding_torques(q, **wrenches) - robot.holding_torques(q)
        if tau_past_friction is not None:
            friction_torques = tau - tau_past_friction
        elif friction:
            friction_torques = robot.friction_forces(dq, load=motion_torques + wrench_torques)
        else:
            friction_torques = np.zeros_like(dq)
        return power_balance(dq, tau, motion_torques, wrench_torques, friction_torques)


complete(globals())
