"""Table of the quantities of a robot: algorithm, inputs, outputs, options, meaning and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from ..mechanics.algorithms import (
    constraints,
    coriolis_matrix,
    dynamics_derivatives,
    energies,
    forward_dynamics,
    friction,
    inverse_dynamics,
    kinematics,
    mass_matrix,
    operational_space,
)
from ..mechanics.model.model import Model
from .arguments import CONFIGURATIONS

Shape = tuple[int, ...]
Algorithm = Callable[..., Any]
"""Function of the model, the inputs and the options."""


@dataclass(frozen=True)
class Quantity:
    """One row of the table: ``algorithm(model, *inputs, **options)`` returns the outputs."""

    algorithm: Algorithm
    inputs: tuple[str, ...]
    """Names of the inputs."""
    outputs: tuple[str, ...]
    """Names of the outputs."""
    sizes: tuple[tuple[str, ...], ...]
    """Sizes of the axes of each output: numbers, or names of counts such as nv."""
    meaning: str
    """Description in one line, ASCII, with the names of inputs and outputs."""
    options: tuple[str, ...] = ()
    """Names of the options."""
    felt: bool = False
    """True if the output depends only on joint torques, so that base-parameter regrouping applies."""
    needs_inverse: bool = False
    """True if the quantity requires the inverse of M."""
    needs_mass: bool = False
    """True if the quantity is divided by the mass of all moving bodies."""
    constrained: Literal["as is", "projected", "refused"] = "as is"
    """Quantity of a robot with constraints: of its open tree ("as is"), with constraint forces ("projected"), or none."""
    unit: str = ""
    """Units of the outputs."""
    book: str = ""
    """Section or equation of Modern Robotics."""

    def shapes(self, model: Model) -> list[tuple[str, Shape]]:
        """Names and shapes of the inputs for one robot."""
        shapes: list[tuple[str, Shape]] = []
        for name in self.inputs:
            if name in CONFIGURATIONS:
                shapes.append((name, (model.nq,)))
            elif name == "wrench":
                shapes.append((name, (6,)))
            else:
                shapes.append((name, (model.nv,)))
        return shapes


def row(
    algorithm: Algorithm, inputs: str, outputs: str, sizes: str, meaning: str, *, options: str = "", **more: Any
) -> Quantity:
    """Row of the table from texts: names and axes are separated by blanks, sizes of several outputs by commas.

    ``more`` are further fields of :class:`Quantity`.
    """
    return Quantity(
        algorithm,
        inputs=tuple(inputs.split()),
        outputs=tuple(outputs.split()),
        sizes=tuple(tuple(axes.split()) for axes in sizes.split(",")),
        meaning=meaning,
        options=tuple(options.split()),
        **more,
    )


# A quantity is one algorithm and one row of this table: algorithm, inputs, outputs, sizes of the outputs, meaning. CPU and GPU
# kernels, comments of exported C code, and the tables of the docs are derived from these rows.

_TORQUE = "N m (sliding joints: N)"

# fmt: off
QUANTITIES: Mapping[str, Quantity] = {
    "add": row(
        kinematics.add, "q dv", "q", "nq", "q moved along the constant joint twists dv for unit time",
        unit="rad, m",
    ),
    "bias_forces": row(
        inverse_dynamics.bias_forces, "q dq", "h", "nv", "h = c + g, what remains of the torques at ddq = 0",
        options="wrenches gravity", felt=True, unit=_TORQUE, book="section 8.1.2",
    ),
    "center_of_mass": row(
        energies.center_of_mass, "q", "com", "3", "centre of mass of the moving bodies in the base frame [m]",
        needs_mass=True, unit="m",
    ),
    "christoffel": row(
        coriolis_matrix.christoffel, "q", "gamma", "nv nv nv",
        "Christoffel symbols of the first kind: c_i = sum over j, k of gamma[i][j][k] dq_j dq_k",
        felt=True, book="eq. 8.12", unit="kg m^2 (sliding joints: kg)",
    ),
    "closure_poses": row(
        constraints.closure_poses, "q", "T", "loops 4 4", "poses that the closed loops compare, 4 x 4 each",
        options="constraints", unit="m",
    ),
    "com_jacobian": row(
        energies.com_jacobian, "q", "J", "3 nv", "J with d(com)/dt = J dq",
        needs_mass=True,
        unit="m/rad (sliding joints: m/m)",
    ),
    "constrained_dynamics": row(
        constraints.constrained_dynamics, "q dq tau", "ddq lambda pivots", "nv, rows, rows",
        "accelerations and multipliers of tau = M ddq + h + A' lambda, A ddq + (dA/dt) dq = 0",
        options="wrenches constraints", felt=True, needs_inverse=True, book="section 8.7",
        unit="rad/s^2 (sliding joints: m/s^2), N m or N",
    ),
    "constraint_bias": row(
        constraints.constraint_bias, "q dq", "b", "rows", "b = (dA/dt) dq, with A ddq + b = 0",
        options="constraints", book="section 8.7", unit="rad/s^2, m/s^2",
    ),
    "constraint_jacobian": row(
        constraints.constraint_jacobian, "q", "A", "rows nv", "A of A dq = 0",
        options="constraints", book="section 8.7", unit="rad, m, per rad or m",
    ),
    "coordinate_rates": row(
        kinematics.rates_of_coordinates, "q dq", "rates", "nq",
        "derivatives of the entries of q by time at the velocities dq", unit="rad/s, m/s; quaternions 1/s",
    ),
    "coriolis_forces": row(
        inverse_dynamics.coriolis_forces, "q dq", "c", "nv", "c, the torques due to products of velocities",
        felt=True, unit=_TORQUE, book="section 8.1.2",
    ),
    "coriolis_matrix": row(
        coriolis_matrix.coriolis_matrix, "q dq", "C", "nv nv", "C with c = C dq, dM/dt - 2 C skew-symmetric",
        felt=True, book="section 8.1.2", unit="N m s/rad (sliding joints: N s/m)",
    ),
    "drive_torques": row(
        inverse_dynamics.drive_torques, "q dq ddq", "gear rotor", "nv, nv",
        "what the gears carry, and what the rotors take before them; their sum is tau",
        options="wrenches", felt=True, unit=_TORQUE, book="section 8.9.3", constrained="refused",
    ),
    "forward_dynamics": row(
        forward_dynamics.forward_dynamics, "q dq tau", "ddq", "nv", "ddq = inverse of M times (tau - h)",
        options="wrenches gravity friction", felt=True, needs_inverse=True, unit="rad/s^2 (sliding joints: m/s^2)",
        book="section 8.5", constrained="projected",
    ),
    "forward_dynamics_derivatives": row(
        dynamics_derivatives.forward_dynamics_derivatives, "q dq tau", "ddq_by_q ddq_by_dq ddq_by_tau", "nv nv, nv nv, nv nv",
        "derivatives of ddq by q (along the joint twists), dq and tau",
        options="wrenches", felt=True, needs_inverse=True,
        unit="1/s^2, 1/s, 1/(kg m^2) (sliding joints: 1/kg)", constrained="refused",
    ),
    "forward_kinematics": row(
        kinematics.forward_kinematics, "q", "T", "4 4", "pose of the frame in the base frame, 4 x 4",
        options="frame", book="section 4.1", unit="m",
    ),
    "frame_acceleration": row(
        kinematics.frame_acceleration, "q dq ddq", "dV", "6",
        "rate of the twist of the frame [rad/s^2, m/s^2], gravity not included",
        options="frame kind", unit="rad/s^2, m/s^2",
    ),
    "frame_velocity": row(
        kinematics.frame_velocity, "q dq", "V", "6", "twist (omega, v) [rad/s, m/s] of the frame",
        options="frame kind", unit="rad/s, m/s",
    ),
    "friction_forces": row(
        friction.friction_forces, "dq", "tau", "nv", "torques that overcome the friction of the joints",
        unit=_TORQUE, book="section 8.9.4",
    ),
    "friction_under_load": row(
        friction.friction_forces, "dq load", "tau", "nv",
        "torques that overcome the friction of the joints while they transmit the torques load",
        unit=_TORQUE, book="section 8.9.4",
    ),
    "gravity_forces": row(
        inverse_dynamics.gravity_forces, "q", "g", "nv", "g, the torques that hold the robot at rest against gravity",
        options="wrenches gravity", felt=True, unit=_TORQUE, book="section 8.1.2",
    ),
    "holding_torques": row(
        inverse_dynamics.holding_torques, "q", "tau", "nv",
        "the torques that hold the robot at rest, springs and wrenches included",
        options="wrenches", felt=True, unit=_TORQUE, book="section 5.2", constrained="projected",
    ),
    "inverse_dynamics": row(
        inverse_dynamics.inverse_dynamics, "q dq ddq", "tau", "nv", "tau = M ddq + c + g",
        options="wrenches gravity friction", felt=True, unit=_TORQUE, book="eq. 8.54",
        constrained="projected",
    ),
    "inverse_dynamics_derivatives": row(
        dynamics_derivatives.inverse_dynamics_derivatives, "q dq ddq", "tau_by_q tau_by_dq", "nv nv, nv nv",
        "derivatives of tau by q (along the joint twists) and dq",
        options="wrenches", felt=True,
        unit="N m/rad, N m s/rad (sliding joints: N/m, N s/m)", constrained="projected",
    ),
    "jacobian": row(
        kinematics.jacobian, "q", "J", "6 nv", "J with V = J dq, V the twist (omega, v) of the frame",
        options="frame kind", book="eq. 5.11, 5.18",
        unit="rad, m, per rad or m",
    ),
    "jacobian_derivative": row(
        kinematics.jacobian_derivative, "q", "J_by_q", "6 nv nv",
        "dJ/dq of the Jacobian of the frame, last axis along the joint twists",
        options="frame kind", unit="rad, m, per product of rad and m",
    ),
    "jacobian_rate": row(
        kinematics.jacobian_rate, "q dq", "dJ", "6 nv", "dJ/dt of the Jacobian of the frame",
        options="frame kind",
        unit="rad/s, m/s, per rad or m",
    ),
    "joint_wrenches": row(
        inverse_dynamics.joint_wrenches, "q dq ddq", "F", "bodies 6",
        "wrenches (m, f) that each moving body is carried with, in the frame of its link, one a row",
        options="wrenches gravity", unit="N m, N", constrained="projected",
    ),
    "kinetic_energy": row(
        energies.kinetic_energy, "q dq", "K", "", "kinetic energy [J]",
        unit="J", book="section 8.1.2",
    ),
    "link_poses": row(
        kinematics.link_poses, "q", "T", "links 4 4",
        "poses of all links in the base frame, 4 x 4 each, in the order of the robot's file",
        unit="m",
    ),
    "mass_matrix": row(
        mass_matrix.mass_matrix, "q", "M", "nv nv", "M, symmetric and full",
        felt=True, unit="kg m^2 (sliding joints: kg)", book="eq. 8.57",
    ),
    "momentum": row(
        energies.momentum, "q dq", "P", "6", "momentum (angular, linear) at the origin of the base frame",
        unit="N m s, N s",
    ),
    "momentum_about_com": row(
        energies.momentum_about_com, "q dq", "P", "6",
        "momentum (angular, linear) about the centre of mass, axes of the base frame",
        needs_mass=True, unit="N m s, N s",
    ),
    "potential_energy": row(
        energies.potential_energy, "q", "P", "",
        "potential energy [J], zero with the centre of mass at the origin of the base frame",
        unit="J",
    ),
    "regressor": row(
        inverse_dynamics.regressor, "q dq ddq", "Y", "nv parameters",
        "Y with tau = Y pi, pi the ten inertial parameters of each moving body",
        options="gravity", book="section 8.2",
        unit="that of tau over that of the parameter", constrained="refused",
    ),
    "subtract": row(
        kinematics.subtract, "q1 q0", "dv", "nv", "dv that moves q0 to q1 in unit time, each joint along its constant twist",
        unit="rad, m",
    ),
    "task_bias": row(
        operational_space.task_bias, "q dq", "eta pivots", "rows, rows",
        "eta of F = Lambda dV + eta; wrong where a pivot is near zero, for there the frame cannot be moved",
        options="frame kind rows", felt=True, needs_inverse=True, book="section 8.6", unit="N m, N", constrained="refused",
    ),
    "task_inertia": row(
        operational_space.task_inertia, "q", "Lambda pivots", "rows rows, rows",
        "Lambda of F = Lambda dV + eta; wrong where a pivot is near zero, for there the frame cannot be moved",
        options="frame kind rows", felt=True, needs_inverse=True, book="section 8.6", unit="kg m^2, kg m, kg",
        constrained="refused",
    ),
    "torque_past_friction": row(
        friction.torque_past_friction, "dq tau", "tau", "nv",
        "torques that remain of tau past the friction of the joints",
        unit=_TORQUE, book="section 8.9.4",
    ),
    "wrench_torques": row(
        kinematics.wrench_torques, "q wrench", "tau", "nv",
        "tau = J' F of the wrench (m, f) the robot applies at the frame, in its axes",
        options="frame", unit=_TORQUE, book="eq. 5.26",
    ),
}
# fmt: on

# ── Names of quantities in other libraries


@cache
def other_names() -> Mapping[str, tuple[str, str]]:
    """Library and quantity by the library's name for it, in lower case, from the table of first calls."""
    from ..core.first_calls import GUESS, first_calls

    names: dict[str, tuple[str, str]] = {}
    for call in first_calls():
        if call.quantity in QUANTITIES:
            library = "another library" if call.of == GUESS else call.of
            for word in call.words:
                names.setdefault(word.casefold(), (library, call.quantity))  # the first row with a name counts
    return names


def other_name_hint(name: str) -> str:
    """Clause on a name that another library has for a quantity; empty for other names.

    >>> other_name_hint("rnea"), other_name_hint("elbow")
    ("Pinocchio's name for 'inverse_dynamics'", '')
    """
    library, quantity = other_names().get(name.casefold(), ("", ""))
    return f"{library}'s name for {quantity!r}" if quantity else ""
