"""What each quantity is, in a line for a comment in C: ASCII, names of arguments as in the prototypes."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["MEANINGS"]

_TWIST = "twist (omega, v) [rad/s, m/s] of the frame"

MEANINGS: Mapping[str, str] = {
    "bias_forces": "h = c + g, what remains of the torques at ddq = 0",
    "center_of_mass": "centre of mass of the moving bodies in the base frame [m]",
    "christoffel": "Christoffel symbols of the first kind: c_i = sum over j, k of gamma[i][j][k] dq_j dq_k",
    "closure_poses": "poses that the closed loops compare, 4 x 4 each",
    "com_jacobian": "J with d(com)/dt = J dq",
    "constrained_dynamics": "accelerations and multipliers of tau = M ddq + h + A' lambda, A ddq + (dA/dt) dq = 0",
    "constraint_bias": "b = (dA/dt) dq, with A ddq + b = 0",
    "constraint_jacobian": "A of A dq = 0",
    "coriolis_forces": "c, the torques due to products of velocities",
    "coriolis_matrix": "C with c = C dq, dM/dt - 2 C skew-symmetric",
    "drive_torques": "what the gears carry, and what the rotors take before them; their sum is tau",
    "forward_dynamics": "ddq = inverse of M times (tau - h)",
    "forward_dynamics_derivatives": "derivatives of ddq by q (along the joint twists), dq and tau",
    "forward_kinematics": "pose of the frame in the base frame, 4 x 4",
    "frame_acceleration": "rate of the twist of the frame [rad/s^2, m/s^2], gravity not included",
    "frame_velocity": _TWIST,
    "friction_forces": "torques that overcome the friction of the joints",
    "friction_under_load": "torques that overcome the friction of the joints while they transmit the torques load",
    "gravity_forces": "g, the torques that hold the robot at rest against gravity",
    "holding_torques": "the torques that hold the robot at rest, springs and wrenches included",
    "inverse_dynamics": "tau = M ddq + c + g",
    "inverse_dynamics_derivatives": "derivatives of tau by q (along the joint twists) and dq",
    "jacobian": "J with V = J dq, V the twist (omega, v) of the frame",
    "jacobian_derivative": "dJ/dq of the Jacobian of the frame, last axis along the joint twists",
    "jacobian_rate": "dJ/dt of the Jacobian of the frame",
    "joint_wrenches": "wrenches (m, f) that each moving body is carried with, in the frame of its link, one a row",
    "kinetic_energy": "kinetic energy [J]",
    "link_poses": "poses of all links in the base frame, 4 x 4 each, in the order of the robot's file",
    "mass_matrix": "M, symmetric and full",
    "momentum": "momentum (angular, linear) at the origin of the base frame",
    "momentum_about_com": "momentum (angular, linear) about the centre of mass, axes of the base frame",
    "potential_energy": "potential energy [J], zero with the centre of mass at the origin of the base frame",
    "regressor": "Y with tau = Y pi, pi the ten inertial parameters of each moving body",
    "task_bias": "eta of F = Lambda dV + eta; wrong where a pivot is near zero, for there the frame cannot be moved",
    "task_inertia": "Lambda of F = Lambda dV + eta; wrong where a pivot is near zero, for there the frame cannot be moved",
    "torque_past_friction": "torques that remain of tau past the friction of the joints",
    "wrench_torques": "tau = J' F of the wrench (m, f) the robot applies at the frame, in its axes",
}
"""By name of the quantity; those without an entry are introduced by their names alone."""
