"""The laws of mechanics on random trees of every joint kind: forces, energies, the Coriolis matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from random_trees import DIFFERENCES, ROUNDING, frames, tree

from twistwrench import Robot, SpatialInertia
from twistwrench.core.errors import ValueRangeError
from twistwrench.mechanics.algorithms.closed_form import closed_form
from twistwrench.testing import assert_close, derivative_along, laws, random_robot, random_state, strategies

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


# ── the equation of motion ──


def test_inverse_dynamics_is_inertia_plus_coriolis_plus_gravity(robot, state):
    q, dq, ddq = state
    M, c, g = robot.mass_matrix(q), robot.coriolis_forces(q, dq), robot.gravity_forces(q)
    assert_close(robot.inverse_dynamics(q, dq, ddq), M @ ddq + c + g, ROUNDING, "τ = M q̈ + c + g")
    assert_close(robot.bias_forces(q, dq), c + g, ROUNDING, "h = c + g")


def test_inverse_dynamics_follows_from_the_energies(robot, state):
    assert laws.lagrange_gap(robot, state) < DIFFERENCES


def test_mass_matrix_is_symmetric_and_positive_definite(robot, state):
    M = robot.mass_matrix(state.q)
    assert (M == M.T).all()  # to the bit: the algorithm writes each entry twice
    assert np.linalg.eigvalsh(M).min() > 0


def test_kinetic_energy_is_half_the_square_of_velocity_in_the_mass_matrix(robot, state):
    q, dq, _ = state
    assert_close(robot.kinetic_energy(q, dq), 0.5 * dq @ robot.mass_matrix(q) @ dq, ROUNDING, "K")


def test_forward_dynamics_inverts_inverse_dynamics(robot, state):
    q, dq, ddq = state
    M = robot.mass_matrix(q)
    # Rounding in M grows by its condition when the system is solved.
    found = robot.forward_dynamics(q, dq, robot.inverse_dynamics(q, dq, ddq))
    assert_close(found, ddq, 1e-14 * np.linalg.cond(M) * robot.nv, "forward∘inverse")
    assert laws.round_trip_gap(robot, state) < ROUNDING


def test_power_of_the_joints_is_the_rate_of_the_energy(robot, state):
    assert laws.power_gap(robot, state) < DIFFERENCES


def test_coriolis_forces_are_quadratic_and_even_in_the_velocities(robot, state):
    q, dq, _ = state
    c = robot.coriolis_forces(q, dq)
    assert_close(robot.coriolis_forces(q, -dq), c, ROUNDING, "c(-dq) = c(dq)")
    assert_close(robot.coriolis_forces(q, 3 * dq), 9 * c, ROUNDING, "c(3 dq) = 9 c(dq)")


def test_closed_form_equals_the_recursions(robot, state, rng):
    q, dq, ddq = state
    wrenches = {frame: rng.standard_normal(6) for frame in frames(robot)}
    terms = closed_form(robot.model, q, dq, wrenches)
    assert_close(robot.mass_matrix(q), terms.M, ROUNDING, "M")
    scale = float(np.abs(terms.M).max())  # c vanishes for a single sliding joint
    assert_close(robot.coriolis_forces(q, dq), terms.c, ROUNDING, "c", scale=max(scale, np.abs(terms.c).max()))
    assert_close(robot.gravity_forces(q), terms.g, ROUNDING, "g")
    tau = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=wrenches)
    assert_close(tau, terms.inverse_dynamics(ddq), ROUNDING, "τ")


# ── the Coriolis matrix ──


def test_rate_of_the_mass_matrix_less_twice_coriolis_is_skew(robot, state):
    assert laws.skewness_gap(robot, state) < DIFFERENCES


def test_coriolis_matrix_times_velocity_is_the_coriolis_force(robot, state):
    assert laws.coriolis_gap(robot, state) < ROUNDING


def test_christoffel_symbols_are_those_of_the_mass_matrix(simple_robot, rng):
    robot = simple_robot
    q, dq, _ = random_state(robot, rng)
    gamma = robot.christoffel(q)
    dM = np.moveaxis(derivative_along(robot, robot.mass_matrix, q, np.eye(robot.nv)), 0, -1)  # ∂m_ij/∂θ_k
    scale = max(np.abs(dM).max(), np.abs(robot.mass_matrix(q)).max())
    first_kind = 0.5 * (dM + np.swapaxes(dM, 1, 2) - np.moveaxis(dM, 2, 0))  # MR eq. 8.12
    assert_close(gamma, first_kind, DIFFERENCES, "Γ", scale=scale)
    assert_close(gamma, np.swapaxes(gamma, 1, 2), ROUNDING, "Γ_ijk = Γ_ikj", scale=scale)
    assert_close(gamma @ dq, robot.coriolis_matrix(q, dq), ROUNDING, "C_ij = Σ Γ_ijk θ̇_k", scale=scale)


def test_christoffel_symbols_of_quasi_velocities_are_refused():
    with pytest.raises(ValueRangeError, match="is floating"):
        tree("floating").christoffel(tree("floating").neutral)


# ── friction ──


def test_friction_is_left_out_unless_asked_for_and_always_takes_power(robot, state):
    q, dq, ddq = state
    tau, friction = robot.inverse_dynamics(q, dq, ddq), robot.friction_forces(dq)
    expected = robot.model.friction.viscous * dq + robot.model.friction.coulomb * np.sign(dq)
    assert_close(friction, expected, ROUNDING, "damping dq + friction sign(dq)")
    assert (friction * dq >= 0).all()
    assert_close(robot.inverse_dynamics(q, dq, ddq, friction=True), tau + friction, ROUNDING, "τ with friction")
    back = robot.forward_dynamics(q, dq, tau + friction, friction=True)
    assert_close(back, ddq, 1e-14 * robot.nv * np.linalg.cond(robot.mass_matrix(q)), "forward dynamics with friction")


# ── drawn by hypothesis: it looks for the smallest robot that breaks a law ──

drawn = settings(max_examples=25, deadline=None, derandomize=True)


@drawn
@given(strategies.robots_with_states(joints=4))
def test_any_robot_moves_by_lagranges_equations(drawn_robot):
    robot, state = drawn_robot
    assert laws.lagrange_gap(robot, state) < DIFFERENCES


@drawn
@given(strategies.robots_with_states(joints=4, floating_base=True))
def test_any_floating_robot_agrees_with_the_closed_form(drawn_robot):
    assert laws.closed_form_gap(*drawn_robot) < ROUNDING


@drawn
@given(strategies.robots_with_states(joints=5))
def test_any_robot_has_a_skew_rate_of_inertia_less_twice_coriolis(drawn_robot):
    assert laws.skewness_gap(*drawn_robot) < DIFFERENCES


# ── the laws can fail ──


def test_a_wrong_inertia_is_noticed():
    """The laws compare with something: a robot that forgets a product of inertia breaks those that involve it."""
    robot = random_robot(5, joints=4, kinds=("revolute",))
    state = random_state(robot, 5)
    right = robot.inverse_dynamics(*state)
    G = robot.model.bodies[-1].inertia.parameters.copy()
    G[5] = 0.0
    wrong = robot_with_inertia(robot, SpatialInertia.from_parameters(G))
    with pytest.raises(AssertionError, match="τ: off by"):
        assert_close(wrong.inverse_dynamics(*state), right, ROUNDING, "τ")


def robot_with_inertia(robot, inertia):
    from dataclasses import replace

    *rest, last = robot.model.bodies
    return Robot(replace(robot.model, bodies=(*rest, replace(last, inertia=inertia))))
