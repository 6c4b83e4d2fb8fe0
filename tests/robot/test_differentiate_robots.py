"""First derivatives of a robot's quantities: laws, differences along robot.add, the analytic recursions; on every kind of joint."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import DIFFERENCES, ROUNDING, frames
from small_trees import SIMPLE, tree

import twistwrench as tw
from twistwrench.robot.quantities import QUANTITIES
from twistwrench.testing import assert_close, derivative_along, random_state

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


KINDS = ("body", "space", "world_aligned")
MODES = ("forward", "reverse")
STATE = ("q", "dq", "ddq")


def along_q(robot, function, q):
    """∂function/∂q along robot.add by differences, directions last."""
    return np.moveaxis(derivative_along(robot, function, q, np.eye(robot.nv)), 0, -1)


@pytest.mark.parametrize("mode", MODES)
def test_of_inverse_dynamics_by_the_chain_rule_and_by_recursion(robot, state, mode):
    F = {robot.frame_names[-1]: np.arange(1.0, 7.0)}
    kernel = robot.kernel("inverse_dynamics", by=STATE, mode=mode, wrenches=tuple(F))
    by_q, by_dq, by_ddq = kernel(*state, *F.values())
    expected = robot.inverse_dynamics_derivatives(*state, wrench_by_robot=F)
    scale = max(float(np.abs(x).max()) for x in (*expected, robot.inverse_dynamics(*state, wrench_by_robot=F)))
    assert_close(by_q, expected[0], ROUNDING, "∂τ/∂q", scale=scale)
    assert_close(by_dq, expected[1], ROUNDING, "∂τ/∂dq", scale=scale)
    assert_close(by_ddq, robot.mass_matrix(state.q), ROUNDING, "∂τ/∂ddq = M")


SKIPPED = {"christoffel", "closure_poses", "constraint_bias", "constraint_jacobian", "constrained_dynamics"}
"""Christoffel symbols are of one-degree joints, constraints of closed robots."""
BY_Q = [
    name
    for name, quantity in QUANTITIES.items()
    if "q" in quantity.inputs and "rows" not in quantity.options and name not in SKIPPED
]


QUANTITIES_OF_TREES = [
    pytest.param(quantity, name, marks=() if name == ("floating base", "", "driven", "")[k % 4] else pytest.mark.slow)
    for name in ("floating base", "planar", "driven")
    for k, quantity in enumerate(BY_Q)
]
"""Every second quantity of one tree or the other by turns; all quantities of all trees are slow."""


@pytest.mark.parametrize(("quantity", "name"), QUANTITIES_OF_TREES)
def test_of_any_quantity_by_differences(quantity, name):
    robot = tree(name)
    options = {"frame": robot.frame_names[-1]} if "frame" in QUANTITIES[quantity].options else {}
    arrays = states_of(robot, quantity, options)
    by_q = robot.kernel(quantity, by="q", **options)(*arrays)
    kernel = robot.kernel(quantity, **options)

    def at(x):
        found = kernel(x, *arrays[1:])
        return np.concatenate(
            [np.reshape(y, (*x.shape[:-1], -1)) for y in (found if isinstance(found, tuple) else (found,))], axis=-1
        )

    numeric = along_q(robot, at, arrays[0])
    found = np.concatenate([np.reshape(x, (-1, robot.nv)) for x in (by_q if isinstance(by_q, tuple) else (by_q,))])
    scale = max(np.abs(numeric).max(), np.abs(at(arrays[0])).max(), 1.0)
    assert_close(found, numeric, 1e-7 if "forward" in quantity else DIFFERENCES, quantity, scale=scale)  # through M⁻¹


def states_of(robot, quantity, options, seed=5):
    rng = np.random.default_rng(seed)
    ports = robot.program(quantity, **options).inputs
    return [robot.random_configuration(rng) if p.name == "q" else rng.normal(size=p.shape) for p in ports]


@pytest.mark.parametrize("kind", KINDS)
def test_the_derivative_of_the_jacobian(robot, state, kind):
    """By recursion as by the chain rule, and times dq it is the rate; on every kind of joint."""
    for frame in frames(robot):
        D = robot.jacobian_derivative(state.q, frame, kind)
        scale = max(1.0, np.abs(D).max())
        rate = robot.jacobian_rate(state.q, state.dq, frame, kind)
        assert_close(D @ state.dq, rate, ROUNDING, "∂J/∂q dq = dJ/dt", scale=scale * np.abs(state.dq).sum())
        chained = robot.kernel("jacobian", frame=frame, kind=kind, by="q")(state.q)
        assert_close(D, chained, ROUNDING, "by the chain rule", scale=scale)


def test_the_derivative_of_the_mass_matrix(robot, state):
    D = robot.mass_matrix_derivative(state.q)
    numeric = along_q(robot, robot.mass_matrix, state.q)
    assert_close(
        D, numeric, DIFFERENCES, "∂M/∂q", scale=max(np.abs(numeric).max(), np.abs(robot.mass_matrix(state.q)).max())
    )
    np.testing.assert_array_equal(D, np.swapaxes(D, 0, 1))
    C = robot.coriolis_matrix(state.q, state.dq)
    scale = max(np.abs(C).max(), np.abs(D).max())
    assert_close(D @ state.dq, C + C.T, ROUNDING, "dM/dt - 2C is skew-symmetric", scale=scale)


@pytest.mark.parametrize("name", SIMPLE)
def test_christoffels_symbols_are_made_of_it(name, rng):
    """MR eq. 8.12: Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i)."""
    robot = tree(name)
    q = robot.random_configuration(rng)
    D = robot.mass_matrix_derivative(q)
    gamma = 0.5 * (D + np.swapaxes(D, 1, 2) - np.moveaxis(D, -1, 0))
    scale = max(np.abs(gamma).max(), np.abs(robot.mass_matrix(q)).max())
    assert_close(robot.christoffel(q), gamma, ROUNDING, "Γ", scale=scale)


def test_a_pose_moves_along_its_jacobian(robot, state):
    """∂T/∂q_k = T [J_k], J the body Jacobian."""
    frame = robot.frame_names[-1]
    dT = robot.kernel("forward_kinematics", frame=frame, by="q")(state.q)
    T, J = robot.forward_kinematics(state.q, frame), robot.jacobian(state.q, frame)
    expected = np.stack([T @ tw.se3.hat(column) for column in J.T], axis=-1)
    assert_close(dT, expected, ROUNDING, "∂T/∂q", scale=max(1.0, np.abs(expected).max()))


def test_energies_give_momentum_and_forces(robot, state):
    """∂K/∂dq = M dq, ∂P/∂q = g and springs, ∂com/∂q = J_com, and momentum is linear in dq."""
    q, dq, _ = state
    M = robot.mass_matrix(q)
    assert_close(robot.kernel("kinetic_energy", by="dq")(q, dq), M @ dq, ROUNDING, "M dq", scale=np.abs(M * dq).max())
    g = robot.holding_torques(q)
    scale = max(np.abs(g).max(), np.abs(M).max())
    assert_close(robot.kernel("potential_energy", by="q")(q), g, ROUNDING, "g", scale=scale)
    assert_close(robot.kernel("center_of_mass", by="q")(q), robot.com_jacobian(q), ROUNDING, "J_com", scale=1.0)
    A = robot.kernel("momentum_about_com", by="dq")(q, dq)
    assert_close(A @ dq, robot.momentum(q, dq, "com"), ROUNDING, "A dq", scale=np.abs(A * dq).max())


@pytest.mark.parametrize("name", SIMPLE)
def test_lagranges_equations(name, rng):
    """τ = d/dt (M dq) - ∂K/∂q + ∂P/∂q where velocities are rates; MR eq. 8.2. With dM/dt by ∂M/∂q."""
    robot = tree(name)
    q, dq, ddq = random_state(robot, rng)
    M, dM = robot.mass_matrix(q), robot.mass_matrix_derivative(q)
    K_by_q = robot.kernel("kinetic_energy", by="q")(q, dq)
    tau = M @ ddq + (dM @ dq) @ dq - K_by_q + robot.kernel("potential_energy", by="q")(q)
    expected = robot.inverse_dynamics(q, dq, ddq)
    assert_close(tau, expected, ROUNDING, "τ", scale=max(np.abs(expected).max(), np.abs(M).max()))


def test_by_wrenches_gravity_and_parameters():
    """τ is linear in each: J', the rest without, and the regressor's columns."""
    robot = tree("floating base")
    state = random_state(robot, np.random.default_rng(6))
    frame = robot.frame_names[-1]
    by_wrench = robot.kernel("inverse_dynamics", wrenches=frame, by=f"wrench at {frame}")(*state, np.zeros(6))
    assert_close(by_wrench, robot.jacobian(state.q, frame).T, ROUNDING, "∂τ/∂F = J'")
    by_gravity = robot.kernel("inverse_dynamics", gravity="input", by="gravity")(*state, np.zeros(3))
    still = robot.with_gravity((0, 0, 0)).inverse_dynamics(*state)
    tau = robot.inverse_dynamics(*state)
    assert_close(by_gravity @ robot.gravity + still, tau, ROUNDING, "∂τ/∂g")


@pytest.mark.parametrize("name", ["floating base", "planar", "one degree"])
def test_by_inertial_parameters_it_is_the_regressor(name):
    """Of a link whose frame is its body's: Ixx … are entries of π, and by the mass m c and m (c·c 1 - c c') go along."""
    robot = tree(name)
    state = random_state(robot, np.random.default_rng(7))
    Y = robot.regressor(*state)
    for i, body in enumerate(robot.model.bodies):
        names = list(robot.varying(f"{body.link}.*"))
        patterns = tuple(n for n in names if n.rpartition(".")[2][0] in "mIc")
        own = list(robot.varying(*patterns).values())
        found = robot.kernel("inverse_dynamics", parameters=patterns, by="parameters")(*state, own)
        mine = Y[:, 10 * i : 10 * i + 10]
        assert_close(found[:, 4:], mine[:, 4:], ROUNDING, "by moments", scale=np.abs(Y).max())
        c, m = np.array(own[1:4]), own[0]
        steiner = (c @ c) * np.eye(3) - np.outer(c, c)
        pi = np.array([1.0, *c, *steiner[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
        assert_close(found[:, 0], mine @ pi, ROUNDING, "by mass", scale=np.abs(Y).max())
        for k, e in enumerate(np.eye(3)):
            turned = m * (2 * c[k] * np.eye(3) - np.outer(e, c) - np.outer(c, e))
            pi = np.array([0.0, *(m * e), *turned[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
            assert_close(found[:, 1 + k], mine @ pi, ROUNDING, "by centre of mass", scale=np.abs(Y).max() * max(1.0, m))


@pytest.mark.parametrize("mode", MODES)
def test_the_length_of_a_quaternion_means_nothing(mode):
    robot = tree("floating")
    q, dq, ddq = random_state(robot, np.random.default_rng(8))
    stretched = q.copy()
    for body in robot.model.leaders:
        stretched[body.q_index : body.q_index + 4] *= -7.5
    kernel = robot.kernel("inverse_dynamics", by="q", mode=mode)
    assert_close(kernel(stretched, dq, ddq), kernel(q, dq, ddq), ROUNDING, "∂τ/∂q")


def test_products_are_those_of_the_jacobians(robot, state, rng):
    w, *v = rng.normal(size=(4, robot.nv))
    parts = robot.kernel("inverse_dynamics", by=STATE)(*state)
    scale = max(np.abs(x).max() for x in parts)
    along = robot.kernel("inverse_dynamics", by=STATE, form="along")(*state, *v)
    together = sum(J @ x for J, x in zip(parts, v, strict=True))
    assert_close(along, together, ROUNDING, "J v", scale=scale)
    for found, J in zip(robot.inverse_dynamics_gradient(*state, w), parts, strict=True):
        assert_close(found, w @ J, ROUNDING, "w J", scale=scale)
