"""Derivatives of the dynamics against differences of the dynamics itself, on trees with every joint kind, rotors and springs."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import DIFFERENCES, ROUNDING, driven

import twistwrench as tw
from twistwrench.testing import assert_close, derivative, derivative_along, random_state

pytest_plugins = ("random_tree_fixtures", "small_trees")
pytestmark = pytest.mark.usefixtures("on_numpy")


def along_velocities(function, v):
    """∂function/∂v (n, nv) by differences."""
    return np.stack([derivative(lambda t, e=e: function(v + np.multiply.outer(t, e)), 1.0) for e in np.eye(len(v))], -1)


def test_inverse_dynamics(robot, state):
    q, dq, ddq = state
    F = {robot.frame_names[-1]: np.arange(1.0, 7.0)}
    by_q, by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq, wrench_by_robot=F)
    numeric = derivative_along(
        robot, lambda x: robot.inverse_dynamics(x, dq, ddq, wrench_by_robot=F), q, np.eye(robot.nv)
    ).T
    tau = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=F)
    scale = max(float(np.abs(x).max()) for x in (numeric, by_dq, tau))
    assert_close(by_q, numeric, DIFFERENCES, "∂τ/∂q", scale=scale)
    assert_close(
        by_dq, along_velocities(lambda v: robot.inverse_dynamics(q, v, ddq), dq), DIFFERENCES, "∂τ/∂dq", scale=scale
    )


def test_the_velocity_derivative_is_twice_the_coriolis_matrix_where_that_is_christoffels(simple_robot, rng):
    """c is quadratic: ∂c/∂dq dq = 2 c; and τ is its own derivative by ddq, through M."""
    q, dq, ddq = random_state(simple_robot, rng)
    _, by_dq = simple_robot.inverse_dynamics_derivatives(q, dq, ddq)
    assert_close(
        by_dq @ dq, 2 * simple_robot.coriolis_forces(q, dq), ROUNDING, "Euler's theorem", scale=np.abs(by_dq * dq).max()
    )
    gamma = simple_robot.christoffel(q)
    assert_close(by_dq, 2 * np.einsum("ijk,k->ij", gamma, dq), ROUNDING, "∂τ_i/∂dq_j = 2 Γ_ijk dq_k")


def test_at_rest_the_derivative_by_q_is_the_stiffness_of_gravity(simple_robot, rng):
    """The Hessian of the potential energy, so symmetric."""
    q, still = random_state(simple_robot, rng).q, np.zeros(simple_robot.nv)
    by_q, by_dq = simple_robot.inverse_dynamics_derivatives(q, still, still)
    assert_close(by_q, by_q.T, ROUNDING, "symmetry", scale=np.abs(by_q).max() + 1e-12)
    assert not np.abs(by_dq).max() > 1e-12 * np.abs(by_q).max()


def test_forward_dynamics(small_robot, small_state):
    robot, (q, dq, ddq) = small_robot, small_state
    F = {robot.frame_names[-1]: np.arange(1.0, 7.0)}
    M = robot.mass_matrix(q)
    # Rows of M ∂ddq/∂x are compared: fingers of grams make M⁻¹, and differences through it, large.
    tau = robot.inverse_dynamics(q, dq, ddq, wrench_on_robot=F)
    by_q, by_dq, inverse = robot.forward_dynamics_derivatives(q, dq, tau, wrench_on_robot=F)
    tau_by_q, tau_by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq, wrench_on_robot=F)
    allowed = 1e-13 * np.linalg.cond(M) * robot.nv
    assert_close(inverse @ M, np.eye(robot.nv), allowed, "M⁻¹ M")
    scale = max(float(np.abs(x).max()) for x in (tau_by_q, tau_by_dq, tau))
    assert_close(M @ by_q, -tau_by_q, allowed, "M ∂ddq/∂q", scale=scale)
    assert_close(M @ by_dq, -tau_by_dq, allowed, "M ∂ddq/∂dq", scale=scale)


@pytest.mark.parametrize("name", ["ur5", "panda", "cart_pole", "quadruped"])
def test_forward_dynamics_by_differences(name):
    robot = getattr(tw.robots, name)()
    q, dq, _ = random_state(robot, np.random.default_rng(8))
    tau = robot.bias_forces(q, dq)
    by_q, by_dq, inverse = robot.forward_dynamics_derivatives(q, dq, tau)
    numeric = derivative_along(robot, lambda x: robot.forward_dynamics(x, dq, tau), q, np.eye(robot.nv)).T
    assert_close(by_q, numeric, 1e-7, "∂ddq/∂q")  # differences lose what M⁻¹ gains
    assert_close(by_dq, along_velocities(lambda v: robot.forward_dynamics(q, v, tau), dq), 1e-7, "∂ddq/∂dq")
    assert_close(inverse, np.linalg.inv(robot.mass_matrix(q)), 1e-9, "∂ddq/∂τ")


def test_springs_and_rotors():
    robot = driven(tw.robots.planar_3r(), 3, stiffness="300 N m/rad")
    q, dq, ddq = random_state(robot, np.random.default_rng(9))
    by_q, by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq)
    numeric = derivative_along(robot, lambda x: robot.inverse_dynamics(x, dq, ddq), q, np.eye(robot.nv)).T
    assert_close(by_q, numeric, DIFFERENCES, "∂τ/∂q with springs")
    assert_close(by_dq, along_velocities(lambda v: robot.inverse_dynamics(q, v, ddq), dq), DIFFERENCES, "∂τ/∂dq")


def test_batches_and_out():
    robot = tw.robots.planar_2r()
    rng = np.random.default_rng(10)
    q, dq, ddq = rng.normal(size=(3, 5, 4, 2))
    by_q, by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq[0])
    assert by_q.shape == by_dq.shape == (5, 4, 2, 2)
    one = robot.inverse_dynamics_derivatives(q[3, 2], dq[3, 2], ddq[0, 2])
    np.testing.assert_array_equal(by_q[3, 2], one[0])
    out = np.empty((5, 4, 2, 2)), np.empty((5, 4, 2, 2))
    robot.inverse_dynamics_derivatives(q, dq, ddq[0], out=out)
    np.testing.assert_array_equal(out[1], by_dq)
    with pytest.raises(tw.ShapeError, match="ddq has shape"):
        robot.inverse_dynamics_derivatives(q, dq, ddq[..., :1])


def test_a_massless_finger_has_no_accelerations_in_a_kernel_of_its_mass_matrix_either():
    builder = tw.ModelBuilder("finger")
    builder.add_link("base")
    builder.add_link("tip")
    builder.add_joint("hinge", "revolute", "base", "tip", axis=(0, 0, 1))
    finger = tw.Robot(builder.build())
    finger.kernel("mass_matrix")
    with pytest.raises(tw.SingularMassMatrixError, match="hinge"):
        finger.kernel("mass_matrix", "forward_dynamics")


def test_a_massless_finger_has_no_derivative_of_forward_dynamics():
    from twistwrench.mechanics.model.builder import ModelBuilder

    builder = ModelBuilder("finger")
    builder.add_link("base")
    builder.add_link("tip")
    builder.add_joint("hinge", "revolute", "base", "tip", axis=(0, 0, 1))
    with pytest.raises(tw.SingularMassMatrixError, match="hinge"):
        tw.Robot(builder.build()).forward_dynamics_derivatives([0.0], [0.0], [0.0])
