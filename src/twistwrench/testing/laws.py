"""Laws of mechanics that the dynamics of every robot obeys, as residuals at one state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.typing import Array
from ..mechanics.algorithms.closed_form import closed_form
from ..mechanics.lie.adjoint import ad
from ..robot import Robot
from .comparison import relative_gap
from .derivatives import derivative, derivative_along
from .random_robots import State

Residual = Callable[[Robot, State], float]
"""Function that returns the residual of a law for a robot at one state."""

ROUNDING = 1e-10
"""Tolerance between two float64 computations: some thousand operations with errors of 1e-16, and a margin for cancellation."""
DIFFERENCES = 1e-9
"""Tolerance if one side is a numerical derivative."""


def torque_size(robot: Robot, at: State, tau: Array) -> float:
    """Size of the largest terms whose sum is τ; it determines the rounding error if they cancel.

    A single revolute or prismatic joint has c = 0, the difference of terms as large as M dq².
    """
    M = np.abs(robot.mass_matrix(at.q))
    largest_dq = float(np.max(np.abs(at.dq), initial=0.0))
    velocity_products = M.max(initial=0.0) * largest_dq**2
    inertial_torques = M @ np.abs(at.ddq)
    return float(max(np.abs(tau).max(initial=0.0), inertial_torques.max(initial=0.0), velocity_products))


def closed_form_gap(robot: Robot, at: State) -> float:
    """Gap between inverse dynamics and the block matrices of MR section 8.4."""
    tau = closed_form(robot.model, at.q, at.dq).inverse_dynamics(at.ddq)
    return relative_gap(robot.inverse_dynamics(*at), tau, torque_size(robot, at, tau))


def lagrange_gap(robot: Robot, at: State) -> float:
    """Gap between inverse dynamics and :func:`lagrange_torques`, relative to the larger of torques and energies."""
    tau = lagrange_torques(robot, at)
    size = max(float(np.abs(tau).max()), _energies(robot, at))
    return relative_gap(robot.inverse_dynamics(*at), tau, size)


def lagrange_torques(robot: Robot, at: State) -> Array:
    """Joint torques (nv,) from kinetic and potential energy only: Lagrange's equations, MR section 8.1.

    With p = ∂K/∂dq, which for the quadratic K is exactly K(dq + e) - K(dq) - K(e),

        τ = dp/dt - ∂(K - P)/∂q - [V, ·]' p,

    with derivatives by q along ``robot.add``. The last term accounts for velocities of planar and floating joints,
    which are not coordinate rates (Hamel, 1904); [V, ·] is the bracket of the joint's own twists.
    """
    q, dq, ddq = at
    unit_velocities = np.eye(robot.nv)  # e in the rows

    def momenta(t: Array) -> Array:
        """p at times t, (m, nv): the second argument of K varies over the unit velocities e."""
        q_t = robot.add(q, np.multiply.outer(t, dq))[:, None]
        dq_t = (dq + np.multiply.outer(t, ddq))[:, None]
        K = robot.kinetic_energy
        return np.asarray(K(q_t, dq_t + unit_velocities) - K(q_t, dq_t) - K(q_t, unit_velocities))

    def lagrangian(q: Array) -> Array:
        """K - P (...) at configurations (..., nq) and the velocity of the state."""
        return np.asarray(robot.kinetic_energy(q, dq) - robot.potential_energy(q))

    p = momenta(np.zeros(1))[0]
    dp = derivative(momenta, _state_rate(dq))
    tau = dp - derivative_along(robot, lagrangian, q, unit_velocities)
    for body in robot.model.leaders:
        _, entries = body.places
        axes = body.joint.axes
        if body.joint.nv > 1:
            V = dq[entries] @ axes
            bracket = np.array([axes @ (ad(V) @ S) for S in axes])  # row a: [V, S_a] in the joint's axes
            tau[entries] -= bracket @ p[entries]
    return tau


def power_gap(robot: Robot, at: State) -> float:
    """Gap between the power of the joints and the rate of the energy, relative to the larger of powers and energies."""
    q, dq, ddq = at

    def energy(t: Array) -> Array:
        """K + P at times t, (m,)."""
        q_t = robot.add(q, np.multiply.outer(t, dq))
        dq_t = dq + np.multiply.outer(t, ddq)
        return np.asarray(robot.kinetic_energy(q_t, dq_t) + robot.potential_energy(q_t))

    powers = robot.inverse_dynamics(*at) * dq
    energy_rate = derivative(energy, _state_rate(dq))
    size = max(float(np.abs(powers).max()), _energies(robot, at))
    return relative_gap(powers.sum(), energy_rate, size)


def skewness_gap(robot: Robot, at: State) -> float:
    """Deviation of dM/dt - 2C from skew symmetry, which means dM/dt = C + C', relative to entries of dM/dt, C and M."""
    M = robot.mass_matrix(at.q)
    C = robot.coriolis_matrix(at.q, at.dq)
    dM = derivative_along(robot, robot.mass_matrix, at.q, at.dq)
    size = float(max(np.abs(dM).max(), np.abs(C).max(), np.abs(M).max()))
    return relative_gap(C + C.T, dM, size)


def coriolis_gap(robot: Robot, at: State) -> float:
    """Gap between C dq and the velocity products of inverse dynamics, relative to the summands of C dq and to M dq²."""
    C = robot.coriolis_matrix(at.q, at.dq)
    without_acceleration = at._replace(ddq=np.zeros(robot.nv))
    size = torque_size(robot, without_acceleration, C * at.dq)
    return relative_gap(C @ at.dq, robot.coriolis_forces(at.q, at.dq), size)


def round_trip_gap(robot: Robot, at: State) -> float:
    """Gap of torques after forward and inverse dynamics; unlike M⁻¹, M q̈ is not large for nearly massless links."""
    tau = robot.inverse_dynamics(*at)
    ddq = robot.forward_dynamics(at.q, at.dq, tau)
    size = float(np.abs(robot.mass_matrix(at.q) * ddq).max() + np.abs(tau).max())
    return relative_gap(robot.inverse_dynamics(at.q, at.dq, ddq), tau, size)


def _compiled_gap(robot: Robot, at: State) -> float:
    """Gap between kernels and the algorithms on plain floats."""
    tau = robot.reference("inverse_dynamics", *at)
    M = robot.reference("mass_matrix", at.q)
    return against(robot, at, tau, M)


def against(robot: Robot, at: State, tau: Array, M: Array) -> float:
    """Larger of the gaps of compiled torques and mass matrix from tau (nv,) and M (nv, nv) of the state."""
    torque_gap = relative_gap(robot.inverse_dynamics(*at), tau, torque_size(robot, at, tau))
    matrix_gap = relative_gap(robot.mass_matrix(at.q), M)
    return max(torque_gap, matrix_gap)


def _state_rate(dq: Array) -> float:
    """Rate [1/s] that scales the steps of numerical derivatives by time."""
    return max(1.0, float(np.abs(dq).sum()))


def _energies(robot: Robot, at: State) -> float:
    """Size |K| + |P| of the energies [J]."""
    return abs(float(robot.kinetic_energy(at.q, at.dq))) + abs(float(robot.potential_energy(at.q)))


LAWS: tuple[tuple[str, str, float, Residual], ...] = (  # name, compared quantities, tolerance, residual
    ("closed form", "inverse dynamics, block matrices of MR section 8.4", ROUNDING, closed_form_gap),
    ("energies", "inverse dynamics, Lagrange's equations from K and P", DIFFERENCES, lagrange_gap),
    ("power", "torques times velocities, rate of K + P", DIFFERENCES, power_gap),
    ("Ṁ − 2C skew", "Coriolis matrix, rate of the mass matrix", DIFFERENCES, skewness_gap),
    ("C dq = c", "Coriolis matrix, inverse dynamics", ROUNDING, coriolis_gap),
    ("forward∘inverse", "forward dynamics, inverse dynamics", ROUNDING, round_trip_gap),
    ("compiled", "kernels, the algorithms on plain floats", ROUNDING, _compiled_gap),
)
