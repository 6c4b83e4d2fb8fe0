"""The split of torques: every part against a robot that has only that cause, and the sum against τ itself."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import ROUNDING, driven, tree

import twistwrench as tw
from twistwrench.testing import assert_close, random_state

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

LAW = {"viscous": "2 N m s/rad", "coulomb": "1 N m", "static": "2 N m", "stribeck": "0.2 rad/s", "load": "0.1"}


def dressed(robot):
    """With payload, rotors and friction wherever the robot can have them."""
    joints = [b.joint.name for b in robot.model.leaders if b.joint.nv == 1 and b.joint.kind != "prismatic"]
    entry = {"ratio": "100", "rotor": {"inertia": "1 kg cm^2", "extra": "true"}, "friction": LAW}
    payload = tw.SpatialInertia.from_com(2.0, (0.01, 0.02, 0.1), 0.01 * np.eye(3))
    return robot.with_payload(payload, robot.link_names[-1]).with_actuators({"actuators": dict.fromkeys(joints, entry)})


@pytest.mark.parametrize("name", tw.robots.names())
def test_parts_add_up_to_the_torque_on_every_bundled_robot(name):
    robot = dressed(getattr(tw.robots, name)())
    rng = np.random.default_rng(3)
    q, dq, ddq = (np.stack(x) for x in zip(*(random_state(robot, rng) for _ in range(20)), strict=True))
    F = {robot.link_names[-1]: rng.normal(size=(20, 6))}
    why = robot.explain(q, dq, ddq, wrench_by_robot=F, friction=True)
    tau = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=F, friction=True)
    assert_close(why.torque, tau, ROUNDING, "Σ parts = τ")
    assert why.parts.shape == (20, len(why.terms), len(why.causes), robot.nv)


@pytest.mark.parametrize("name", ["one_degree1", "one_degree4", "tree3"])
def test_terms_are_those_of_the_equation_of_motion(name):
    robot = driven(tree(name), 1)
    q, dq, ddq = random_state(robot, np.random.default_rng(1))
    why = robot.explain(q, dq, ddq)
    inertia, squares, products, gravity = why.by_term[:4]
    assert_close(inertia, robot.mass_matrix(q) @ ddq, ROUNDING, "M q̈")
    assert_close(squares + products, robot.coriolis_forces(q, dq), ROUNDING, "c")
    assert_close(gravity, robot.gravity_forces(q), ROUNDING, "g")


@pytest.mark.parametrize("name", ["ur5", "planar_3r"])
def test_centripetal_and_coriolis_terms_are_the_books(name):
    """Σ Γ_ijj dq_j² and Σ_{j≠k} Γ_ijk dq_j dq_k."""
    robot = getattr(tw.robots, name)()
    q, dq, ddq = random_state(robot, np.random.default_rng(2))
    why, gamma = robot.explain(q, dq, ddq), robot.christoffel(q)
    squares = np.einsum("ijj,j->i", gamma, dq**2)
    assert_close(why.by_term[why.terms.index("centripetal")], squares, ROUNDING, "centripetal")
    products = np.einsum("ijk,j,k->i", gamma, dq, dq) - squares
    assert_close(why.by_term[why.terms.index("Coriolis")], products, ROUNDING, "Coriolis")


def test_each_link_causes_what_a_robot_of_that_link_alone_would_need():
    from dataclasses import replace

    robot = tw.robots.ur5()
    state = random_state(robot, np.random.default_rng(4))
    why = robot.explain(*state)
    for cause in why.causes:
        frame = robot.model.frames[cause]
        only = robot.model.link_inertias[cause].in_frame(frame.pose)
        bodies = tuple(
            replace(b, inertia=only if i == frame.body else tw.SpatialInertia.zero()) for i, b in enumerate(robot.model.bodies)
        )  # fmt: skip
        alone = tw.Robot(replace(robot.model, bodies=bodies)).inverse_dynamics(*state)
        assert_close(why.contribution(cause), alone, ROUNDING, cause)


def test_a_robot_without_mass_has_no_cause_and_friction_alone_acts():
    hinge = """<robot name="bare"><link name="a"/><link name="b"/><joint name="hinge" type="continuous"><parent link="a"/>
    <child link="b"/><dynamics damping="0.5" friction="2"/></joint></robot>"""
    with pytest.warns(tw.ModelWarning):
        robot = tw.load(hinge)
    why = robot.explain([0.3], [4.0], [5.0], friction=True)
    assert_close(why.torque, [0.5 * 4 + 2], 1e-12, "friction")
    assert not [cause for cause in why.causes if why.contribution(cause).any() and "friction" not in cause]
    assert not robot.explain([0.3], [4.0], [5.0]).torque.any()


def test_a_payload_causes_what_the_robot_needs_with_it_and_not_without():
    robot = tw.robots.panda()
    load = tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=3.0)
    carrying = robot.with_payload(load, "panda_hand")
    state = random_state(robot, np.random.default_rng(5))
    why, bare = carrying.explain(*state), robot.explain(*state)
    found = why.contribution("payload at panda_hand")
    assert_close(found, carrying.inverse_dynamics(*state) - robot.inverse_dynamics(*state), 1e-10, "payload")
    assert set(why.causes) == {*bare.causes, "payload at panda_hand"}
    for cause in bare.causes:  # and nothing else changes
        np.testing.assert_allclose(
            why.contribution(cause), bare.contribution(cause), rtol=0, atol=1e-10 * np.abs(bare.torque).max()
        )


def test_payloads_at_one_frame_are_one_cause_and_those_at_others_are_causes_of_their_own():
    """Each frame's payloads cause what the robot needs with them and not without, and the links what they need without any."""
    robot = tw.robots.ur5()
    box, ball = tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=3.0), tw.SpatialInertia.from_com(0.5, (0.1, 0.0, -0.2))
    state = random_state(robot, np.random.default_rng(7))
    bare = robot.explain(*state)
    wanted = {cause: bare.contribution(cause) for cause in bare.causes}
    carrying = robot
    for frame, payload in (("tool0", box), ("forearm_link", ball), ("tool0", ball), ("tool0", ball)):
        before = carrying.inverse_dynamics(*state)
        carrying = carrying.with_payload(payload, frame)
        cause = f"payload at {frame}"
        wanted[cause] = wanted.get(cause, np.zeros(6)) + carrying.inverse_dynamics(*state) - before
    why = carrying.explain(*state)
    assert set(why.causes) == set(wanted)
    for cause, torque in wanted.items():
        np.testing.assert_allclose(why.contribution(cause), torque, rtol=0, atol=1e-10 * np.abs(why.torque).max())


def test_rotors_cause_what_they_add_whether_or_not_the_links_were_weighed_with_them():
    robot = tw.robots.ur5()
    state = random_state(robot, np.random.default_rng(6))
    for extra in ("true", "false"):
        entry = {"ratio": "100", "rotor": {"inertia": "0.2 kg cm^2", "extra": extra}}
        geared = robot.with_actuators({"actuators": dict.fromkeys(robot.joint_names, entry)})
        why = geared.explain(*state)
        rotors = sum(why.contribution(c) for c in why.causes if c.endswith(".rotor"))
        assert_close(rotors, geared.inverse_dynamics(*state) - robot.inverse_dynamics(*state), 1e-10, "rotors")
        assert not [c for c in why.causes if "other" in c]


def test_springs_are_a_cause():
    rotor = {"inertia": "1 kg cm^2", "extra": "true"}
    entry = {"ratio": "50", "stiffness": "500 N m/rad", "rotor": rotor}
    arm = tw.robots.planar_2r()
    robot = arm.with_actuators({"actuators": {"joint1": entry}})
    q, dq, ddq = random_state(robot, np.random.default_rng(7))
    why = robot.explain(q, dq, ddq)
    assert_close(
        why.contribution("springs", "springs"), 500 * (q[0] - q[2]) * np.array([1.0, 0.0, -1.0]), 1e-12, "spring"
    )
    assert_close(why.torque, robot.inverse_dynamics(q, dq, ddq), ROUNDING, "τ")


def test_wrenches_on_the_robot_count_with_a_minus():
    robot = tw.robots.ur5()
    state, F = random_state(robot, np.random.default_rng(8)), np.array([1.0, -2, 3, 10, 20, -30])
    for keyword, sign in (("wrench_by_robot", 1), ("wrench_on_robot", -1)):
        why = robot.explain(*state, **{keyword: {"tool0": F}})
        assert_close(why.contribution("wrench at tool0"), sign * robot.wrench_torques(state.q, F), ROUNDING, keyword)
        assert_close(why.torque, robot.inverse_dynamics(*state, **{keyword: {"tool0": F}}), ROUNDING, "τ")


def test_the_table_of_a_joint_has_its_parts_and_their_sum():
    robot = tw.robots.planar_2r()
    why = robot.explain([0, 0], [0, 0], [0, 0])
    columns = {head: cells for head, *cells in zip(*why.rows("joint2"), strict=True)}
    assert columns["gravity"][-1] == columns["together [N m]"][-1] == "9.81"
    whole = {head: cells for head, *cells in zip(*why.rows(), strict=True)}
    assert whole["joint1 [N m]"][-1] == "29.43"


def test_table_and_text_and_picture(tmp_path):
    robot = dressed(tw.robots.ur5())
    why = robot.explain(np.full(6, 0.3), np.ones(6), np.ones(6))
    text = str(why)
    assert "payload at tool0" in text
    assert "together" in text
    assert all(len(line) < 400 for line in text.splitlines())
    heads = why.table("elbow_joint").splitlines()[0]
    assert heads.split()[2] == "inertia"
    assert heads.endswith("together [N m]")
    assert why.plot(tmp_path / "why.png").stat().st_size > 10_000
    slides = tw.robots.cart_pole().explain([0.1, 0.2], [1, 1], [0, 0])
    assert slides.units == ("N", "N m")


def test_no_two_causes_of_a_picture_look_alike_and_what_is_no_body_s_has_its_own_colours():
    from twistwrench.viz.plots.explanation import styles

    bodies, apart = [f"link{k}" for k in range(8)], ["wrench at tip", "wrench at hand", "springs", "friction"]
    for n in range(9):
        look = styles(bodies[:n], apart)
        assert set(look) == {*bodies[:n], *apart}
        seen = [(s["color"], s.get("hatch")) for s in look.values()]
        assert len(set(seen)) == len(seen)
        assert not {look[b]["color"] for b in bodies[:n]} & {look[a]["color"] for a in apart}
    assert len({s["color"] for s in styles(bodies[:7], ["friction"]).values()}) == 8  # no hatch is needed


def test_bad_questions(tmp_path):
    robot = tw.robots.planar_2r()
    why = robot.explain(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(2))
    for ask in (why.table, lambda: why.plot(tmp_path / "why.png")):
        with pytest.raises(tw.ShapeError, match="a batch of states of shape \\(3,\\)"):
            ask()
    assert "states (3,)" in str(why)
    one = robot.explain([0, 0], [0, 0], [0, 0])
    with pytest.raises(tw.UnknownNameError, match="no cause named 'hand'"):
        one.contribution("hand")
    with pytest.raises(tw.UnknownNameError, match=r"no term named 'coriolis'\. Did you mean 'Coriolis'"):
        one.contribution(one.causes[0], "coriolis")
    with pytest.raises(tw.UnknownNameError, match="no joint named 'elbow'"):
        one.table("elbow")
    with pytest.raises(tw.ShapeError, match="q has shape"):
        robot.explain([0], [0, 0], [0, 0])
