"""Positions beyond the stops name a unit, a zero or a turn; measured torques are compared with their limits."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from twistwrench import Motion, robots

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

T = np.arange(0, 6, 0.01)
Q = 0.8 * np.sin(T[:, None] * np.arange(1, 7) / 3)
LINK = '<link name="l{k}"><inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = """<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>
<limit lower="{lower}" upper="{upper}" velocity="6" effort="80"/></joint>"""
SCARA = (("revolute", 0.0, -2.5, 2.5), ("revolute", 0.3, -2.6, 2.6), ("prismatic", 0.3, -0.2, 0.0))
"""Kind, place and stops of the joints of a SCARA robot."""
WORDS = ("OK", "UNSURE", "OVER LIMIT", "LOOK AGAIN")


def urdf(joints):
    """Chain of joints about, or along, the vertical."""
    parts = ['<link name="l-1"/>']
    for k, (kind, x, lower, upper) in enumerate(joints):
        parts += [
            LINK.format(k=k),
            JOINT.format(k=k, parent=f"l{k - 1}", kind=kind, x=x, lower=lower, upper=upper),
        ]
    return f'<robot name="made">{"".join(parts)}</robot>'


@pytest.fixture
def said(run, tmp_path):
    """First paragraph of ``torques`` on rows of positions, and of torques if there are any."""

    def said(robot, names, t, q, *options, tau=None):
        header = ["time", *names] + ([] if tau is None else [f"{name}.tau" for name in names])
        table = np.column_stack([t, q] if tau is None else [t, q, tau])
        np.savetxt(tmp_path / "m.csv", table, "%.9g", ",", header=",".join(header), comments="")
        _, text = run("torques", robot, "--trajectory", tmp_path / "m.csv", *options)
        return " ".join(text.split("\n\n")[0].split()), " ".join(text.split())

    return said


@pytest.fixture
def of_ur5(said, ur5):
    return lambda q, *options, tau=None: said("ur5", ur5.joint_names, T[: len(q)], q, *options, tau=tau)[0]


@pytest.fixture
def of_scara(said, tmp_path):
    path = tmp_path / "scara.urdf"
    path.write_text(urdf(SCARA))
    return lambda q, *options: said(path, ("j0", "j1", "j2"), T, q, *options)[0]


# ── Positions beyond the stops


@pytest.mark.parametrize("size", [8, 58, *(pytest.param(size, marks=pytest.mark.slow) for size in (12, 20))])
def test_angles_in_degrees_under_plain_names_are_looked_at_again(of_ur5, size):
    """Motions of 8 to 58 degrees: within the stops as degrees, beyond those of two joints or more as radians."""
    q = Q / np.abs(Q).max() * size
    verdict = of_ur5(q)
    assert verdict.startswith("LOOK AGAIN") and "--degrees" in verdict
    assert of_ur5(q, "--degrees").startswith("OK")


def test_a_plan_in_radians_beyond_its_stops_is_over_its_limits(of_ur5):
    assert of_ur5(Q / np.abs(Q).max() * 8, "--plan").startswith("OVER LIMIT")


@pytest.mark.parametrize("fault", ["degrees", "zero", "direction"])
def test_one_joint_beyond_its_stops_has_another_zero_direction_or_unit(of_ur5, said, fault):
    if fault == "direction":
        names = robots.panda().joint_names
        q = np.tile([0.0, -0.5, 0.0, 1.6, 0.0, 1.6, 0.5], (len(T), 1)) + 0.2 * np.sin(T)[:, None]
        verdict, _ = said("panda", names, T, q)
        joint = "panda_joint4"
    else:
        q = Q.copy()
        q[:, 2] = 10 * np.sin(T / 2) if fault == "degrees" else 4 * q[:, 2] + 1.6
        verdict, joint = of_ur5(q), "elbow_joint"
    assert verdict.startswith(f"UNSURE: {joint} goes to")
    assert (
        "rad" in verdict
        and "its zero, its direction or its unit differs" in verdict
        and "as a plan OVER LIMIT" in verdict
    )


def test_a_wound_joint_is_compared_with_its_stops_modulo_a_turn(of_ur5, ur5):
    """In a log the turn is a note; a file that may be a plan is unsure, and a plan is beyond its stops."""
    wound = Q + 2 * math.pi * np.eye(6)[1]
    assert of_ur5(wound).startswith(
        "UNSURE: shoulder_lift_joint: angles lie between the stops with one turn more or less"
    )
    assert of_ur5(wound, "--plan").startswith("OVER LIMIT: shoulder_lift_joint")
    assert of_ur5(wound, tau=Motion(T, Q, robot=ur5).torques()).startswith("OK")


def test_positions_of_a_sliding_joint_in_millimetres_are_looked_at_again(of_scara):
    q = np.column_stack([np.sin(T), 0.8 * np.cos(T), -0.1 + 0.05 * np.sin(T)])
    assert of_scara(q).startswith("OK")
    verdict = of_scara(q * [1, 1, 1000])
    assert verdict.startswith("LOOK AGAIN: j2 goes to -150 m") and "millimetres" in verdict


def test_another_zero_of_a_sliding_joint_is_not_a_unit(of_scara):
    q = np.column_stack([np.sin(T), 0.8 * np.cos(T), 0.4 + 0.05 * np.sin(T)])
    verdict = of_scara(q)
    assert verdict.startswith("UNSURE: j2 goes to 0.45 m") and "its zero" in verdict


# ── Measured torques


def test_a_measured_torque_that_stays_above_its_limit_is_not_fine(said, ur5):
    """165 of 150 N m for 100 ms, while the computed torque is 40 % of the limit."""
    tau = Motion(T, Q, robot=ur5).torques()
    most = np.abs(tau[:, 1]).max()
    tau[300:310, 1] = -165.0
    first, _ = said("ur5", ur5.joint_names, T, Q, tau=tau)
    assert first.startswith("UNSURE: measured torque of shoulder_lift_joint: -165.0 N m at t = 3.000 s")
    assert f"computed at most {most:.4g}, limit 150: friction or a load is missing" in first


def test_a_measured_peak_of_some_milliseconds_is_a_remark(said, ur5):
    t = np.arange(0, 3, 0.002)
    q = 0.8 * np.sin(t[:, None] * np.arange(1, 7) / 3)
    tau = Motion(t, q, robot=ur5).torques()
    tau[700:702, 1] = -165.0
    first, text = said("ur5", ur5.joint_names, t, q, tau=tau)
    assert first.startswith("OK") and "a peak of 4 ms above its limit" in text


def test_a_measured_torque_above_four_fifths_of_its_limit_is_named(said, ur5):
    tau = Motion(T, Q, robot=ur5).torques()
    tau[:, 1] *= 0.85 * 150 / np.abs(tau[:, 1]).max()
    _, text = said("ur5", ur5.joint_names, T, Q, tau=tau)
    assert "measured" in text and re.search(r"85(\.0)? %", text), text


# ── A default pose, and limits of a file


def test_a_load_on_the_axes_at_a_default_pose_is_not_unlimited(run, tmp_path):
    """An upright arm at zeros, and a SCARA without its slide: no torque depends on the load, at this pose only."""
    upright = (
        urdf([("revolute", 0.0, -2, 2)] * 2).replace('xyz="0 0 1"/>', 'xyz="0 1 0"/>').replace("0.0 0 0", "0 0 0.3")
    )
    (tmp_path / "upright.urdf").write_text(upright)
    _, text = run("payload", tmp_path / "upright.urdf")
    assert text.startswith("UNSURE: at the default pose the load stands on the axes of the joints"), text
    _, text = run("payload", tmp_path / "upright.urdf", "--at", "j0=0.5")
    assert text.startswith("OK: largest payload"), text


def test_a_default_pose_beyond_the_stops_is_not_fine(run, tmp_path):
    (tmp_path / "bent.urdf").write_text(urdf([("revolute", 0.0, 0.5, 2)] * 2))
    assert run("payload", tmp_path / "bent.urdf")[1].startswith("OVER LIMIT: the robot cannot be in this pose")


@pytest.mark.parametrize("digits", [0, 2])
def test_limits_of_a_file_in_degrees_have_one_word_by_every_command(run, tmp_path, digits):
    text = robots.path_of("ur5").read_text("utf-8")
    turned = re.sub(
        r'\b(lower|upper|velocity)="([^"]*)"',
        lambda found: f'{found[1]}="{round(math.degrees(float(found[2])) + (0.25 if digits else 0), digits)}"',
        text,
    )
    (tmp_path / "r.urdf").write_text(turned)
    demo = robots.path_of("ur5").with_name("ur5_demo.csv")
    drives = robots.path_of("ur5").with_name("ur5_demo.drives.yaml")
    for command in (["doctor"], ["payload"], ["size", demo, "--catalog", drives], ["torques", "--trajectory", demo]):
        _, said = run(command[0], tmp_path / "r.urdf", *command[1:])
        assert said.startswith("LOOK AGAIN"), said
        assert "look like degrees" in " ".join(said.split())


def test_torque_limits_that_the_own_weight_exceeds_by_far_are_doubted_and_not_the_log(run, tmp_path):
    """Limits of a hundredth: doctor and payload are unsure, and the motion is not called one that no robot makes."""
    text = re.sub(
        r'effort="([^"]*)"', lambda found: f'effort="{float(found[1]) / 100}"', robots.path_of("ur5").read_text("utf-8")
    )
    (tmp_path / "r.urdf").write_text(text)
    _, said = run("torques", tmp_path / "r.urdf", "--trajectory", robots.path_of("ur5").with_name("ur5_demo.csv"))
    assert said.startswith("UNSURE: the robot's own weight needs") and "no robot moves so" not in said
    for command in ("doctor", "payload"):
        assert run(command, tmp_path / "r.urdf")[1].startswith("UNSURE")
