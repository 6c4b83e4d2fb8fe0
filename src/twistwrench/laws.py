"""Laws that the dynamics of every robot obeys, as residuals: how far a robot is from them at one state.

Each compares what the robot's methods return with what follows from other methods by mechanics alone. Residuals are
relative by norm. Where one side is a derivative by differences it is good to some 1e-12 of the function differentiated.
"""

from __future__ import annotations

import numpy as np

from .algorithms.closed_form import closed_form
from .lie.adjoint import ad
from .robot import Robot
from .testing import State, derivative, derivative_along, relative_gap
from .typing import Array

__all__ = [
    "closed_form_gap",
    "coriolis_gap",
    "lagrange_gap",
    "lagrange_torques",
    "power_gap",
    "round_trip_gap",
    "skewness_gap",
    "torque_size",
]


def closed_form_gap(robot: Robot, at: State) -> float:
    """Gap of inverse dynamics to the block matrices of MR section 8.4.

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    gap : float, relative

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> closed_form_gap(arm, testing.random_state(arm, 0)) < 1e-12
    True
    """
    tau = closed_form(robot.model, at.q, at.dq).inverse_dynamics(at.ddq)
    return relative_gap(robot.inverse_dynamics(*at), tau, torque_size(robot, at, tau))


def torque_size(robot: Robot, at: State, tau: Array) -> float:
    """Size of the terms that add up to τ: where they cancel, what is left is their rounding and no disagreement.

    Parameters
    ----------
    robot : Robot
    at : State, one state
    tau : (nv,) array [N m, sliding joints: N]

    Returns
    -------
    size : float [N m, N]

    Notes
    -----
    A joint that turns or slides alone has c = 0, the difference of terms as large as M dq².

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> at = testing.State(np.zeros(2), np.zeros(2), np.ones(2))
    >>> round(torque_size(arm, at, arm.gravity_forces(at.q)), 2)
    29.43
    """
    M = np.abs(robot.mass_matrix(at.q))
    products = M.max(initial=0.0) * float(np.max(np.abs(at.dq), initial=0.0)) ** 2
    return float(max(np.abs(tau).max(initial=0.0), (M @ np.abs(at.ddq)).max(initial=0.0), products))


def lagrange_gap(robot: Robot, at: State) -> float:
    """Gap of inverse dynamics to :func:`lagrange_torques`, relative to torques or energies, whichever are larger.

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    gap : float, relative

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> lagrange_gap(arm, testing.random_state(arm, 0)) < 1e-9
    True
    """
    tau = lagrange_torques(robot, at)
    return relative_gap(robot.inverse_dynamics(*at), tau, max(float(np.abs(tau).max()), _energies(robot, at)))


def lagrange_torques(robot: Robot, at: State) -> Array:
    """Lagrange's equations: joint torques from the kinetic and potential energy alone.

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    tau : (nv,) array, joint torques [N m, sliding joints: N]

    Notes
    -----
    MR section 8.1. With p = ∂K/∂dq, which the quadratic K gives without error as K(dq + e) - K(dq) - K(e),

        τ = dp/dt - ∂(K - P)/∂q - [V, ·]' p,

    derivatives with respect to q along ``robot.add``. The last term is there because the velocities of planar and
    floating joints are no rates of coordinates (Hamel, 1904); [V, ·] is the bracket of the joint's own twists.

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> lagrange_torques(arm, testing.State(np.zeros(2), np.zeros(2), np.zeros(2))).round(6).tolist()
    [29.43, 9.81]
    """
    q, dq, ddq = at
    unit = np.eye(robot.nv)

    def momenta(t: Array) -> Array:
        x, v = robot.add(q, np.multiply.outer(t, dq))[:, None], (dq + np.multiply.outer(t, ddq))[:, None]
        K = robot.kinetic_energy
        return np.asarray(K(x, v + unit) - K(x, v) - K(x, unit))

    def lagrangian(x: Array) -> Array:
        return np.asarray(robot.kinetic_energy(x, dq) - robot.potential_energy(x))

    p = momenta(np.zeros(1))[0]
    tau = derivative(momenta, _rate(dq)) - derivative_along(robot, lagrangian, q, unit)
    for body in robot.model.leaders:
        mine, axes = body.places[1], body.joint.axes
        if body.joint.nv > 1:
            bracket = np.array([axes @ (ad(dq[mine] @ axes) @ S) for S in axes])  # row a: [V, S_a] in the joint's axes
            tau[mine] -= bracket @ p[mine]
    return tau


def power_gap(robot: Robot, at: State) -> float:
    """Gap of the power of the joints to the rate of the energy, relative to the powers or the energies.

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    gap : float, relative

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> power_gap(arm, testing.random_state(arm, 0)) < 1e-9
    True
    """
    q, dq, ddq = at

    def energy(t: Array) -> Array:
        x = robot.add(q, np.multiply.outer(t, dq))
        return np.asarray(robot.kinetic_energy(x, dq + np.multiply.outer(t, ddq)) + robot.potential_energy(x))

    powers = robot.inverse_dynamics(*at) * dq
    size = max(float(np.abs(powers).max()), _energies(robot, at))
    return relative_gap(powers.sum(), derivative(energy, _rate(dq)), size)


def skewness_gap(robot: Robot, at: State) -> float:
    """Gap of dM/dt - 2C from skew, dM/dt = C + C', relative to their entries and those of M.

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    gap : float, relative

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> skewness_gap(arm, testing.random_state(arm, 0)) < 1e-9
    True
    """
    M, C = robot.mass_matrix(at.q), robot.coriolis_matrix(at.q, at.dq)
    dM = derivative_along(robot, robot.mass_matrix, at.q, at.dq)
    return relative_gap(C + C.T, dM, float(max(np.abs(dM).max(), np.abs(C).max(), np.abs(M).max())))


def coriolis_gap(robot: Robot, at: State) -> float:
    """Gap of C dq to the velocity-product terms of inverse dynamics, relative to the summands of C dq and to M dq².

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    gap : float, relative

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> coriolis_gap(arm, testing.random_state(arm, 0)) < 1e-12
    True
    """
    C = robot.coriolis_matrix(at.q, at.dq)
    at_rest = at._replace(ddq=np.zeros(robot.nv))
    return relative_gap(C @ at.dq, robot.coriolis_forces(at.q, at.dq), torque_size(robot, at_rest, C * at.dq))


def round_trip_gap(robot: Robot, at: State) -> float:
    """Gap of inverse after forward dynamics: torques of the accelerations that torques give, against those torques.

    Parameters
    ----------
    robot : Robot
    at : State, one state

    Returns
    -------
    gap : float, relative

    Raises
    ------
    SingularMassMatrixError
        M has no inverse.

    Notes
    -----
    Compared as torques: a nearly massless finger makes M⁻¹ large, and the rounding of q̈ with it, but not that of M q̈.

    Examples
    --------
    >>> from twistwrench import robots, testing
    >>> arm = robots.planar_2r()
    >>> round_trip_gap(arm, testing.random_state(arm, 0)) < 1e-10
    True
    """
    tau = robot.inverse_dynamics(*at)
    ddq = robot.forward_dynamics(at.q, at.dq, tau)
    size = float(np.abs(robot.mass_matrix(at.q) * ddq).max() + np.abs(tau).max())
    return relative_gap(robot.inverse_dynamics(at.q, at.dq, ddq), tau, size)


def _rate(dq: Array) -> float:
    return max(1.0, float(np.abs(dq).sum()))


def _energies(robot: Robot, at: State) -> float:
    return abs(float(robot.kinetic_energy(at.q, at.dq))) + abs(float(robot.potential_energy(at.q)))
