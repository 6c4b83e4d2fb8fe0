"""Articles on wrenches, arms and gears: every number of a picture is the library's, and mistakes are named."""

from __future__ import annotations

import numpy as np
import pytest
from article_under_node import pictures_under_node

import twistwrench as tw

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

ARM = tw.robots.planar_2r()


def states(section, rows, folder):
    """States of pictures after one slider is set, for rows (picture, slider, values)."""
    work = "(pictures, rows) => rows.flatMap(([name, slider, values]) => values.map((value) => { pictures[name].set(slider, value); return { name, value, ...pictures[name].state() }; }))"
    return pictures_under_node(section, work, folder, rows)


# ── 3.4: one wrench in several frames


def frame(R, p):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.reshape(R, (3, 3)), p
    return T


def test_a_wrench_in_another_frame_is_the_library_s(tmp_path):
    rows = [
        ["apple", "beyond", [0.05, 0.15, 0.3]],
        ["sliding", "along", [-0.5, 0, 0.4]],
        ["offline", "off", [-0.2, 0, 0.3]],
        ["observers", "yaw", [-120, 0, 30]],
        ["power", "yaw", [-120, 0, 30]],
        ["screw", "tilt", [0, 60, 90]],
    ]
    seen = {}
    for state in states("3.4", rows, tmp_path):
        name, value = state["name"], state["value"]
        seen[name, value] = state
        if name == "apple":
            parts = [
                tw.Ad(np.linalg.inv(frame(np.eye(3), at))).T @ [0, 0, 0, 0, f, 0]
                for at, f in (([0.1, 0, 0], -5.0), ([0.1 + value, 0, 0], -1.0))
            ]
            np.testing.assert_allclose(state["wrench"], np.sum(parts, axis=0), atol=1e-15)
        elif name in ("sliding", "offline"):
            expected = tw.Ad(np.linalg.inv(frame(np.eye(3), state["at"]))).T @ [0, 0, 0, 3, 4, 0]
            np.testing.assert_allclose(state["wrench"], expected, atol=1e-14)
        elif name in ("observers", "power"):
            T = frame(state["R"], state["p"])
            np.testing.assert_allclose(state["wrench_b"], tw.Ad(T).T @ state["wrench_s"], atol=1e-14)
            np.testing.assert_allclose(tw.Ad(T) @ state["twist_b"], state["twist_s"], atol=1e-14)
            assert state["power_b"] == pytest.approx(state["power_s"], rel=1e-14)
        else:
            np.testing.assert_allclose(state["rebuilt"], state["wrench"], atol=1e-14)
    assert seen["apple", 0.15]["wrench"][2] == pytest.approx(-0.75, rel=1e-12)
    assert seen["apple", 0.3]["wrench"][2] == pytest.approx(-0.9, rel=1e-12)
    np.testing.assert_allclose(seen["sliding", -0.5]["wrench"], seen["sliding", 0.4]["wrench"], atol=1e-15)
    assert seen["offline", 0.3]["wrench"][2] == pytest.approx(1.5, rel=1e-12)


# ── 8.1: Coriolis and centripetal torques


def test_coriolis_torques_of_all_pictures_are_those_of_the_library(tmp_path):
    rows = [
        ["centripetal", "rate", [-2, 1, 1.5]],
        ["folding", "rate", [1, 2]],
        ["both", "rate", [-1, 0, 1]],
        ["halves", "rate", [0.5, 1]],
        ["faster", "factor", [1, 2, 3]],
        ["bent", "bend", [0, 40, 90, 180]],
        ["energy", "bend", [20, 90, 130]],
    ]
    seen = {}
    for state in states("8.1", rows, tmp_path):
        q, dq = state["angles"], state["rates"]
        np.testing.assert_allclose(state["tau"], ARM.coriolis_forces(q, dq), atol=1e-13)
        if state["name"] == "energy":
            # central differences of 1e-5 s of an energy of some joules: error below 1e-10 of truncation, 1e-10 of round-off
            assert state["energy"] == pytest.approx(float(ARM.kinetic_energy(q, dq)), rel=1e-13)
            assert state["rate"] == pytest.approx(state["power"], abs=1e-8)
            c = np.subtract(state["momentum_rate"], state["half_slope"])
            np.testing.assert_allclose(c, state["tau"], atol=1e-13)
        if state["name"] == "halves":
            together = 2 * state["moment"] + state["carried"]
            assert together == pytest.approx(float(ARM.coriolis_forces(q, dq)[0]), rel=1e-13)
        seen[state["name"], state["value"]] = state["tau"]
    np.testing.assert_allclose(seen["centripetal", 1], [0, 1], atol=1e-12)
    np.testing.assert_allclose(seen["folding", 1], [-1, 0], atol=1e-12)
    np.testing.assert_allclose(seen["both", 1], [-3, 1], atol=1e-12)
    np.testing.assert_allclose(seen["faster", 2], [-12, 4], atol=1e-12)


# ── 8.3: Newton–Euler


def test_both_waves_are_those_of_the_library(tmp_path):
    rows = [["alone", "rate", [-1, 1, 2]], ["motor", "bend", [0, 50, 90]], ["lift", "lift", [0, 5, 9.81]]]
    for state in states("8.3", rows, tmp_path):
        q, dq, lift = state["angles"], state["rates"], state["value"] if state["name"] == "lift" else 0.0
        arm = ARM.with_gravity([0, 0, -lift])
        np.testing.assert_allclose(state["tau"], arm.inverse_dynamics(q, dq, [0, 0]), atol=1e-12)
        F = arm.joint_wrenches(q, dq, [0, 0])
        for k, across in enumerate(state["across"]):
            x, y, z = arm.link_poses(q)[arm.link_names.index(arm.body_names[k]), :3, :3] @ F[k, 3:]
            np.testing.assert_allclose([x, z, -y], across, atol=1e-12)  # the arm's plane is x, z
        if state["name"] == "lift":
            np.testing.assert_allclose(state["gravity"], arm.gravity_forces(q), atol=1e-12)
            np.testing.assert_allclose(state["without"], ARM.coriolis_forces(q, dq), atol=1e-12)


def test_the_recursion_visits_links_and_the_symbols_are_cubed(tmp_path):
    (state,) = states("8.3", [["count", "links", [2]]], tmp_path)
    assert state["symbols"] == np.size(ARM.christoffel([0.1, 0.2]))
    assert state["wave"] == 2 * len(ARM.model.bodies)


# ── 8.9: gears


def test_a_geared_rotor_is_the_library_s_armature(tmp_path):
    rows = [["reflected", "gear", [1, 10, 50, 100, 200]], ["square", "gear", [10]], ["best", "gear", [20, 100, 150]],
            ["gyroscope", "gear", [100]], ["matrix", "gear", [1, 50, 200]], ["shove", "shove", [0.6]]]  # fmt: skip
    joint, accelerations = ARM.joint_names[1], {}
    for state in states("8.9", rows, tmp_path):
        name, G = state["name"], state["value"]
        geared = ARM.with_armature(dict.fromkeys(ARM.joint_names, 1e-4 * G * G)) if name != "shove" else ARM
        M, own = geared.mass_matrix([0.0, np.pi / 2]), ARM.mass_matrix([0.0, np.pi / 2])
        if name == "reflected":
            assert state["reflected"] == pytest.approx(M[1, 1] - own[1, 1], abs=1e-12)
        elif name == "square":
            assert state["felt"] == pytest.approx(1e-4 * G * G, rel=1e-13)
        elif name == "best":  # joint 1 held: the link has 1 kg m² about joint 2
            assert state["acceleration"] == pytest.approx(0.5 * G / M[1, 1], rel=1e-12)
            accelerations[G] = state["acceleration"]
        elif name == "gyroscope":
            rotor = tw.RigidBody(tw.SpatialInertia.from_com(1e-9, [0, 0, 0], np.diag([0.5e-4, 0.5e-4, 1e-4])))
            # the housing turns at 1 rad/s about y: on the rotor this turning goes round, with the rate G along x
            wrench = rotor.wrench([0, 1.0, G, 0, 0, 0], [G, 0, 0, 0, 0, 0])
            np.testing.assert_allclose(state["moment"], wrench[:3], atol=1e-15)
        elif name == "matrix":
            np.testing.assert_allclose(state["M"], M, atol=1e-12)
            assert state["share"] == pytest.approx(M[0, 1] / np.sqrt(M[0, 0] * M[1, 1]), rel=1e-12)
        else:
            shoved = [
                0.6 / ARM.with_armature({joint: 1e-4 * gear**2}).mass_matrix([0.0, 0.0])[1, 1] for gear in (1, 100)
            ]
            np.testing.assert_allclose(state["speeds"], shoved, rtol=1e-12)
    assert accelerations[100] == max(accelerations.values()) == pytest.approx(25)


# ── Exercises

EXERCISES = {
    ("3.4", "apple"): [("-1.1", True, None), ("1,1", False, "sign"), ("-2.2", False, "double"), ("-0.55", False, "half"), ("-0.4", False, "frame")],
    ("8.1", "both"): [("-5", True, None), ("5", False, "sign"), ("-10", False, "double"), ("-2.5", False, "half"), ("-4.47", False, "degrees"), ("-4", False, None), ("-1", False, None), ("-3", False, None)],
    ("8.3", "inward"): [("12.04", True, None), ("24.08", False, "double"), ("6.02", False, "half"), ("9.849", False, None), ("4", False, None), ("-9", False, "frame"), ("8", False, "frame")],
    ("8.9", "reflected"): [("1.28", True, None), ("2.56", False, "double"), ("0.64", False, "half"), ("2.28", False, None), ("0.008", False, None)],
}  # fmt: skip


def test_right_answers_of_exercises_are_the_library_s(tmp_path):
    hand, apple = frame(np.eye(3), [0.1, 0, 0]), frame(np.eye(3), [0.3, 0, 0])
    weights = [tw.Ad(np.linalg.inv(T)).T @ [0, 0, 0, 0, f, 0] for T, f in ((hand, -5), (apple, -2))]
    q, dq, geared = [0, np.pi / 2], [2, 1], tw.robots.pendulum()
    reflected = geared.with_armature({geared.joint_names[0]: 160**2 * 5e-5}).mass_matrix([0.0]) - geared.mass_matrix(
        [0.0]
    )
    right = {
        ("3.4", "apple"): np.sum(weights, axis=0)[2],
        ("8.1", "both"): ARM.coriolis_forces(q, dq)[0],
        ("8.3", "inward"): np.linalg.norm(ARM.with_gravity([0, 0, 0]).joint_wrenches(q, dq, [0, 0])[0, 3:]),
        ("8.9", "reflected"): reflected[0, 0],
    }
    for (section, picture), answer in right.items():
        found = pictures_under_node(section, f"({{ {picture}: p }}) => p.question().answer", tmp_path)
        assert found == pytest.approx(answer, rel=1e-9)


@pytest.mark.parametrize(("section", "picture"), EXERCISES)
def test_mistakes_are_named(tmp_path, section, picture):
    rows = EXERCISES[section, picture]
    work = f"({{ {picture}: p }}, typed) => typed.map((text) => p.check(text))"
    found = pictures_under_node(section, work, tmp_path, [text for text, *_ in rows])
    assert [(each["right"], each["near"]) for each in found] == [(right, near) for _, right, near in rows]
    assert all(each["words"] not in ("", "Not yet.") for each in found)
