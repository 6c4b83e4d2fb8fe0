"""Second derivatives of a robot's quantities, and derivatives of functions that ask robots; on every kind of joint."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import DIFFERENCES, ROUNDING
from small_trees import tree

import twistwrench as tw
from twistwrench.testing import assert_close, derivative, derivative_along

pytest_plugins = ("small_trees",)


@pytest.fixture
def robot(small_robot):
    return small_robot


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def state(small_state):
    return small_state


pytestmark = pytest.mark.usefixtures("each_on_numpy")


SECOND_DIFFERENCES = 1e-8
"""Differences of differences of order six: 1e-12 of the function divided by the step, and the same room as elsewhere."""
STATE = ("q", "dq", "ddq")


def along_q(robot, function, q):
    """∂function/∂q along robot.add by differences, directions last."""
    return np.moveaxis(derivative_along(robot, function, q, np.eye(robot.nv)), 0, -1)


def weighted_torque(robot, state, w):
    """(u, a, b) ↦ w·τ(q ⊕ u, dq + a, ddq + b), for batches (..., 3 nv)."""

    def phi(x):
        u, a, b = np.split(x, 3, axis=-1)
        return robot.inverse_dynamics(robot.add(state.q, u), state.dq + a, state.ddq + b) @ w

    return phi


def test_hessian_products_by_second_differences(robot, state, rng):
    w, *v = rng.normal(size=(4, robot.nv))
    phi, direction, unit = weighted_torque(robot, state, w), np.concatenate(v), np.eye(3 * robot.nv)

    def slopes(t):
        """∂φ/∂x at t v; (6, 3 nv)."""
        return derivative(lambda s: phi(np.multiply.outer(t, direction)[:, None] + np.multiply.outer(s, unit)[:, None]))

    numeric = derivative(slopes, np.abs(direction).sum())
    found = np.concatenate(robot.inverse_dynamics_hessian_product(*state, w, *v))
    scale = max(np.abs(numeric).max(), np.abs(np.concatenate(robot.inverse_dynamics_gradient(*state, w))).max())
    assert_close(found, numeric, SECOND_DIFFERENCES, "Hessian times v", scale=scale)


def test_hessians_are_symmetric_and_their_products_agree(robot, state, rng):
    w, n = rng.normal(size=robot.nv), robot.nv
    product = robot.kernel("inverse_dynamics", by=STATE, form="hessian_along")
    H = np.concatenate(product(*state, w, *np.split(np.eye(3 * n), 3, axis=1)), axis=-1)
    assert_close(H, H.T, ROUNDING, "symmetry")
    assert not H[2 * n :, n:].any()  # τ is linear in ddq, whose factor is M(q)
    dM = robot.mass_matrix_derivative(state.q)
    assert_close(H[2 * n :, :n], np.einsum("i,ijk->jk", w, dM), ROUNDING, "∂²(w·τ)/∂ddq∂q", scale=np.abs(H).max())


def test_the_hessian_of_energies(robot, state):
    """Of K by dq it is M; of P that of gravity's stiffness, whose other half is the turning of the axes."""
    q, dq, _ = state
    H = robot.kernel("kinetic_energy", by="dq", form="hessian")(q, dq)
    assert_close(H, robot.mass_matrix(q), ROUNDING, "∂²K/∂dq²")
    H = robot.kernel("potential_energy", by="q", form="hessian")(q)
    stiffness = robot.kernel("holding_torques", by="q")(q)
    scale = max(np.abs(stiffness).max(), np.abs(robot.holding_torques(q)).max())
    assert_close(H, 0.5 * (stiffness + stiffness.T), ROUNDING, "∂²P/∂q²", scale=scale)


# ── functions of one's own ──


def test_functions_that_ask_robots(robot, state):
    """The distance of a frame from a point: ½ |p - x|² has the gradient J_v'(p - x)."""
    frame, x = robot.frame_names[-1], np.array([0.3, -0.2, 0.9])

    def distance(q, x):
        away = robot.forward_kinematics(q, frame)[:3, 3] - x
        return 0.5 * (away @ away)

    by_q, by_x = tw.differentiate(distance, {"q": robot, "x": 3})(state.q, x)
    away = robot.forward_kinematics(state.q, frame)[:3, 3] - x
    J = robot.jacobian(state.q, frame, "world_aligned")[3:]
    assert_close(by_q, J.T @ away, ROUNDING, "gradient", scale=max(1.0, np.abs(J).max()))
    assert_close(by_x, -away, ROUNDING, "by the point")
    H = tw.differentiate(distance, {"q": robot, "x": 3}, "q", form="hessian")(state.q, x)
    numeric = along_q(robot, lambda y: tw_gradient(robot, distance)(y, x), state.q)
    assert_close(H, 0.5 * (numeric + numeric.T), DIFFERENCES, "Hessian", scale=max(1.0, np.abs(numeric).max()))


def tw_gradient(robot, function):
    return tw.differentiate(function, {"q": robot, "x": 3}, "q", form="weighted")


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_coordinates_may_be_used_directly(mode):
    """A quaternion too, if its length means nothing; and poses may be negated, which the trace writes as another difference."""
    box = tw.robots.floating_box()
    q = np.array([0.6, -1.1, 0.4, 0.9, 0.3, -0.2, 0.5])

    def turned(q):
        quat, T = q[..., :4], box.forward_kinematics(q, "box")
        products = quat[..., :, None] * quat[..., None, :] / (quat * quat).sum(axis=-1, keepdims=True)[..., None]
        return np.concatenate(
            [products.reshape(*q.shape[:-1], 16), (-T).reshape(*q.shape[:-1], 16), q[..., 4:]], axis=-1
        )

    found = tw.differentiate(turned, {"q": box}, mode=mode)(q)
    assert_close(found, along_q(box, turned, q), DIFFERENCES, "by q")
    H = tw.differentiate(turned, {"q": box}, form="hessian", mode=mode)(q)
    numeric = along_q(box, lambda x: tw.differentiate(turned, {"q": box}, mode=mode)(x), q)
    assert_close(H, 0.5 * (numeric + np.swapaxes(numeric, -1, -2)), DIFFERENCES, "Hessians")


def test_two_robots_in_one_function():
    """Each configuration moves along its own robot's add."""
    arm, base = tree("one degree"), tree("floating base")
    rng = np.random.default_rng(9)
    p, q = arm.random_configuration(rng), base.random_configuration(rng)

    def apart(p, q):
        away = arm.center_of_mass(p) - base.center_of_mass(q)
        return away @ away

    by_p, by_q = tw.differentiate(apart, {"p": arm, "q": base})(p, q)
    away = arm.center_of_mass(p) - base.center_of_mass(q)
    assert_close(by_p, 2 * away @ arm.com_jacobian(p), ROUNDING, "by p")
    assert_close(by_q, -2 * away @ base.com_jacobian(q), ROUNDING, "by q")
    H = tw.differentiate(apart, {"p": arm, "q": base}, form="hessian")(p, q)
    numeric = along_q(base, lambda x: tw.differentiate(apart, {"p": arm, "q": base}, "p")(p, x), q)
    assert_close(H[: arm.nv, arm.nv :], numeric, DIFFERENCES, "mixed block", scale=np.abs(H).max())


def test_methods_and_reference_take_symbols_once_they_were_called_with_numbers_too():
    robot = tw.robots.planar_2r()
    dq = np.array([1.0, 2.0])
    robot.inverse_dynamics(robot.neutral, dq, dq)
    push = {"tip": np.array([0, 0, 0, 1.0, 0, 0])}

    def power(q, dq):
        return robot.inverse_dynamics(q, dq, np.zeros(2), wrench_by_robot=push) @ dq

    by_q, by_dq = tw.differentiate(power, {"q": robot, "dq": 2})([0.1, 0.2], dq)
    h = lambda q, v: robot.inverse_dynamics(q, v, np.zeros(2), wrench_by_robot=push)  # noqa: E731
    numeric = along_q(robot, lambda q: h(q, dq) @ dq, np.array([0.1, 0.2]))
    assert_close(by_q, numeric, DIFFERENCES, "by q")
    assert by_dq.shape == (2,)
    with pytest.raises(tw.ShapeError, match="one state has"):
        tw.differentiate(lambda q: robot.mass_matrix(np.append(q, q)), {"q": robot})
