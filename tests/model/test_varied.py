"""Parameters as inputs of kernels: the same as a robot made with those numbers, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_trees import ROUNDING, tree

import twistwrench as tw
from twistwrench.mechanics.model.parameters import nominal, with_symbolic_parameters
from twistwrench.testing import assert_close, random_state

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

QUANTITIES = (
    "inverse_dynamics",
    "mass_matrix",
    "forward_dynamics",
    "gravity_forces",
    "kinetic_energy",
    "center_of_mass",
)


@pytest.mark.parametrize("name", ["tree1", "tree2", "driven1", "one_degree5"])
def test_the_robots_own_numbers_change_nothing(name):
    robot = tree(name)
    own = np.array(list(robot.varying("*").values()))
    state = random_state(robot, np.random.default_rng(1))
    for quantity in QUANTITIES:
        mine = state[: len(robot.program(quantity).inputs)]
        found = robot.kernel(quantity, parameters=("*",))(*mine, own)
        assert_close(found, robot.kernel(quantity)(*mine), 1e-9, quantity)  # massless fingers: M⁻¹ gains what rounds


@pytest.mark.parametrize(
    "patterns", [("*.mass", "*.com_?"), ("*.I??",), ("upper_arm_link.*", "elbow_joint.[xyz]"), ("*",)]
)
def test_other_numbers_make_another_robot(patterns):
    robot = tw.robots.ur5().with_actuators({"actuators": {"elbow_joint": {"friction": {"viscous": "2 N m s/rad"}}}})
    rng = np.random.default_rng(2)
    names = robot.varying(*patterns)
    values = np.array(list(names.values())) * rng.uniform(0.9, 1.1, (5, len(names))) + 1e-3
    states = [random_state(robot, rng) for _ in range(5)]
    q, dq, ddq = (np.stack(x) for x in zip(*states, strict=True))
    found = robot.kernel("inverse_dynamics", parameters=patterns)(q, dq, ddq, values)
    lost = robot.kernel("friction_forces", parameters=patterns)(dq, values)
    for k in range(5):
        other = tw.Robot(with_symbolic_parameters(robot.model, tuple(names), values[k].tolist()))
        floats = replace(other.model, bodies=tuple(_as_floats(b) for b in other.model.bodies))
        expected = tw.Robot(floats).reference("inverse_dynamics", q[k], dq[k], ddq[k])
        assert_close(found[k], expected, ROUNDING, "τ with other numbers")
        assert_close(lost[k], other.reference("friction_forces", dq[k]), 1e-14, "friction with other numbers")


def _as_floats(body):
    return replace(
        body,
        placement=np.asarray(body.placement, float),
        inertia=tw.SpatialInertia.from_parameters(np.asarray(body.inertia.parameters, float)),
    )


def test_the_mass_of_a_massless_link_is_a_payload():
    robot = tw.robots.panda()
    loads = np.linspace(0, 5, 6)
    q, dq, ddq = random_state(robot, np.random.default_rng(3))
    found = robot.kernel("inverse_dynamics", parameters="panda_hand_tcp.mass")(q, dq, ddq, loads[:, None])
    for m, tau in zip(loads, found, strict=True):
        carrying = robot.with_payload(tw.SpatialInertia.from_com(m), "panda_hand_tcp")
        assert_close(tau, carrying.inverse_dynamics(q, dq, ddq), ROUNDING, f"payload {m} kg")


def test_coulomb_friction_acts_at_all_speeds_where_no_static_friction_is_known():
    """A file's friction is static friction too; of an actuator that breaks away later, that stays as it was."""
    robot = tw.robots.panda()
    dq = np.zeros((3, robot.nv))
    dq[:, 0] = 0.01, -0.1, 2.0
    lost = robot.kernel("friction_forces", parameters="panda_joint1.coulomb")(dq, [5.0])[:, 0]
    viscous = robot.varying("panda_joint1.viscous")["panda_joint1.viscous"]
    np.testing.assert_allclose(lost, 5.0 * np.sign(dq[:, 0]) + viscous * dq[:, 0], rtol=1e-14)
    both = robot.kernel("friction_forces", parameters=("panda_joint1.coulomb", "panda_joint1.static"))(dq, [5.0, 7.0])
    np.testing.assert_allclose(both[:, 0] - lost, 2.0 * np.sign(dq[:, 0]) * np.exp(-(dq[:, 0] ** 2)), atol=1e-14)
    laws = {"friction": {"coulomb": "1 N m", "static": "4 N m", "stribeck": "0.2 rad/s"}}
    sticky = tw.robots.pendulum().with_actuators({"actuators": {"hinge": laws}})
    found = sticky.kernel("friction_forces", parameters="*.coulomb")([[1e-6], [3.0]], [2.0])
    np.testing.assert_allclose(found[:, 0], [4.0, 2.0], rtol=1e-9)


def test_lengths_move_the_joints():
    robot = tw.robots.planar_2r()
    tip = robot.kernel("forward_kinematics", parameters="joint2.x")([0.0, 0.0], [[1.0], [1.5]])[:, 0, 3]
    assert tip.tolist() == [2.0, 2.5]


def test_names_come_in_the_order_asked_for_and_once():
    robot = tw.robots.planar_2r()
    assert list(robot.varying("link2.mass", "*.mass"))[:2] == ["link2.mass", "link1.mass"]
    assert robot.varying("link2.mass") == {"link2.mass": 1.0}
    assert set(robot.varying()) == set(nominal(robot.model))


def test_unknown_parameters_are_errors(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_JIT", "1")  # the last sentence is NumPy's own about a compiled function
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.UnknownNameError, match=r"no parameter named 'link2\.mas'\. Did you mean 'link2\.mass'"):
        robot.varying("link2.mas")
    with pytest.raises(tw.UnknownNameError, match="no parameter named"):
        robot.kernel("mass_matrix", parameters=("*.weight",))
    kernel = robot.kernel("mass_matrix", parameters=("*.mass",))
    assert kernel.signature == "(2),(3)->(2,2)"
    with pytest.raises(ValueError, match="mismatch in its core dimension"):
        kernel([0.0, 0.0], [1.0])
