"""Wheels, mounting, bolts, grip and cup as questions of ``check``: against formulas, other functions, and the command."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main

WHEELS = ("wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr")


def cart_text():
    """A cart of 30 kg on four wheels of 10 cm, with an arm of two links."""
    at = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "rl": (-0.3, 0.25), "rr": (-0.3, -0.25)}
    wheels = "".join(
        f'<link name="wheel_{n}"><collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>'
        f'<joint name="to_{n}" type="fixed"><parent link="cart"/><child link="wheel_{n}"/>'
        f'<origin xyz="{x} {y} -0.1" rpy="1.5707963267948966 0 0"/></joint>'
        for n, (x, y) in at.items()
    )

    def link(name, mass, x):
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/><inertia ixx="0.1" ixy="0" ixz="0" '
            'iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        )

    def joint(name, parent, child, place, axis):
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
            f'<axis xyz="{axis}"/><limit lower="-4" upper="4" effort="300" velocity="9"/></joint>'
        )

    arm = (
        link("upper", 5, 0.3) + joint("pan", "cart", "upper", "0 0 0.5", "0 0 1")
        + link("fore", 4, 0.3) + joint("elbow", "upper", "fore", "0.6 0 0", "0 1 0")
    )  # fmt: skip
    tool = '<link name="tool"/><joint name="to_tool" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0.6 0 0"/></joint>'
    return f'<robot name="cart">{link("cart", 30, 0)}{wheels}{arm}{tool}</robot>'


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    path = tmp_path_factory.mktemp("cart") / "cart.urdf"
    path.write_text(cart_text())
    return tw.load(path)


def turning(robot, angle=0.8, rows=61):
    """The arm turns about the vertical, from rest to rest."""
    t = np.linspace(0, 1, rows)
    s, ds, dds = t - np.sin(2 * np.pi * t) / (2 * np.pi), 1 - np.cos(2 * np.pi * t), 2 * np.pi * np.sin(2 * np.pi * t)
    q, dq, ddq = (np.column_stack([angle * x, 0 * x]) for x in (s, ds, dds))
    return tw.Motion(t, q, dq, ddq, robot=robot, in_seconds=True)


# ── Wheels ──


def test_a_cart_on_four_wheels_stands_up_to_the_speed_at_which_it_no_longer_does(cart):
    answer = tw.check(cart, turning(cart), wheels=WHEELS, contact_friction=0.7)
    assert answer.headline.startswith("OK: stands. It needs friction ")
    speed = answer.support.speed.min()
    t = turning(cart)
    for factor, stands in ((0.999, True), (1.001, False)):
        scaled = tw.Motion(
            t.time / (factor * speed),
            t.q,
            t.dq * factor * speed,
            t.ddq * (factor * speed) ** 2,
            robot=cart,
            in_seconds=True,
        )
        found = tw.check(cart, scaled, wheels=WHEELS, contact_friction=0.7)
        assert found.support.holds.all() == stands, factor
    assert found.headline.startswith("OVER LIMIT: ") and "It stands up to 0.99" in found.headline


def test_the_load_of_the_wheels_is_the_weight_and_a_wheel_touches_the_ground_below_its_centre(cart):
    answer = tw.check(cart, turning(cart), wheels=WHEELS, contact_friction=0.7)
    assert_allclose(answer.support.forces[:, :, 2].sum(axis=1), 39 * 9.81, rtol=1e-9)
    assert_allclose([c.radius for c in answer.support.contacts], 0.1, atol=1e-6)
    assert "Forces of the ground" in answer.tables
    still = tw.Motion(np.linspace(0, 1, 8), np.zeros((8, 2)), np.zeros((8, 2)), np.zeros((8, 2)), robot=cart)
    rest = tw.check(cart, still, wheels=WHEELS, contact_friction=0.7)
    moments = 9.81 * (5 * 0.3 + 4 * 0.9)  # of the arm about the middle of the cart
    front = rest.support.forces[0, [0, 1], 2].sum()
    assert_allclose(front, 39 * 9.81 / 2 + moments / 0.6, rtol=1e-9)


def test_casters_carry_normal_forces_only(cart):
    answer = tw.check(cart, turning(cart, 0.4), wheels=WHEELS[:2], casters=WHEELS[2:], contact_friction=0.7)
    assert_allclose(answer.support.forces[:, 2:, :2], 0.0, atol=1e-9)
    assert np.abs(answer.support.forces[:, :2, :2]).max() > 1.0


def test_a_payload_that_is_too_much_is_named_with_what_must_go(cart):
    still = tw.Motion(np.linspace(0, 1, 8), np.zeros((8, 2)), np.zeros((8, 2)), np.zeros((8, 2)), robot=cart)
    most = (39 * 9.81 * 0.3 - 9.81 * (5 * 0.3 + 4 * 0.9)) / (9.81 * (1.2 - 0.3))  # tips over the front wheels
    answer = tw.check(cart, still, wheels=WHEELS, contact_friction=0.7, payload=most + 2.0)
    assert answer.headline.startswith(
        "OVER LIMIT: tips over wheel_fl and wheel_fr at t = 0.000 s. It stands with 2 kg less"
    )
    fits = tw.check(cart, still, wheels=WHEELS, contact_friction=0.7, payload=1.0)
    assert_allclose(fits.support.payload, most - 1.0, rtol=1e-6)


def test_the_columns_of_the_table_add_up(cart, tmp_path):
    answer = tw.check(cart, turning(cart), wheels=WHEELS, contact_friction=0.7)
    with answer.to_csv(tmp_path / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    weight = sum(float(rows[5][f"{wheel}.fz [N]"]) for wheel in WHEELS)
    assert_allclose(weight, 39 * 9.81, rtol=1e-9)
    assert_allclose(float(rows[5]["speed_margin"]), answer.support.speed[5], rtol=1e-9)
    assert all(float(rows[5][f"{wheel}.contact"]) == 1.0 for wheel in WHEELS)
    assert {"friction_needed", "zmp.x [m]", "zmp.y [m]"} <= rows[0].keys()


# ── Mounting ──


def test_the_wrench_on_the_foundation_is_that_of_statics_and_its_bolts_add_up_to_it(tmp_path):
    answer = tw.check("ur5", "demo", payload=5, mounting=True, bolts="6x0.2")
    motion, robot = answer.motion, answer.load.with_load
    assert_allclose(answer.mounting.wrench, statics.mounting_load(robot, motion.q, motion.dq, motion.ddq).wrench)
    assert_allclose(answer.bolt_loads[..., 0].sum(axis=1), answer.mounting.wrench[:, 5], rtol=1e-9)
    table = tmp_path / "bolts.csv"
    table.write_text("x,y,preload\n" + "\n".join(f"{x},{y},5000" for x in (-0.1, 0.1) for y in (-0.1, 0.1)))
    preloaded = tw.check("ur5", "demo", mounting="base_link", bolts=table)
    assert_allclose(preloaded.bolt_loads[..., 0].mean(), 5000 + preloaded.mounting.wrench[:, 5].mean() / 4)
    assert "On the foundation at base_link: force up to " in str(preloaded)


def test_a_push_on_the_tool_is_on_the_foundation_too():
    still = tw.Motion(np.linspace(0, 1, 8), np.zeros((8, 6)), np.zeros((8, 6)), np.zeros((8, 6)), robot=tw.robots.ur5())
    plain, pushed = (
        tw.check("ur5", still, mounting=True, wrench_on_robot=w).mounting.wrench
        for w in (None, {"tool0": [0, 0, 0, 0, 0, 20.0]})
    )
    R = tw.robots.ur5().forward_kinematics(np.zeros(6))[:3, :3]
    assert_allclose(pushed[:, 3:] - plain[:, 3:], np.tile(R @ [0, 0, 20.0], (8, 1)), atol=1e-9)


def test_a_legged_robot_on_a_stand_is_judged_as_it_hangs():
    robot = tw.load(tw.robots.path_of("quadruped"))
    q = np.tile([0.0, 0.8, -1.6], (8, 4))
    still = tw.Motion(np.linspace(0, 1, 8), q, 0 * q, 0 * q, robot=robot)
    assert tw.check(robot, still).verdict.word == "UNSURE"
    answer = tw.check(robot, still, mounting=True)
    assert answer.verdict.ok
    assert_allclose(answer.mounting.wrench[0, 5], -147.3, atol=0.2)


# ── Grip and cup ──


def carried():
    """The UR5 at rest."""
    robot = tw.robots.ur5()
    rows = 9
    q = np.tile([0.0, -1.2, 1.2, 0.0, 0.0, 0.0], (rows, 1))
    dq, ddq = np.zeros((2, rows, 6))
    return robot, tw.Motion(np.linspace(0, 1, rows), q, dq, ddq, robot=robot)


def test_two_fingers_need_half_the_weight_over_the_friction():
    """At rest, with the centre of mass between the pads and friction across the fingers: F = m g / (2 μ)."""
    robot, motion = carried()
    R = np.asarray(robot.forward_kinematics(motion.q[0]))[:3, :3]
    axis = "xyz"[int(np.abs(R.T @ [0, 0, 1.0]).argmin())]  # horizontal
    asked = {"force": 60.0, "friction": 0.5, "axis": axis}
    answer = tw.check(robot, motion, payload=5, grip=asked)
    assert_allclose(answer.grip_force, 5 * 9.81 / (2 * 0.5), rtol=1e-6)
    assert_allclose(5.0 + answer.grip.payload, 2 * 0.5 * 60 / 9.81, rtol=1e-6)
    assert answer.verdict.ok and "The grip needs 49.1 N (given 60 N)" in str(answer)
    weak = tw.check(robot, motion, payload=5, grip=asked | {"force": 40.0})
    assert weak.headline == (
        "OVER LIMIT: the load slips in the grip at t = 0.000 s: it needs 49.1 N, given 40 N (with pads of 20 x 20 mm)."
    )


def test_a_grip_is_held_along_a_motion_as_its_wrench_says():
    """The needed force is the least for which the contacts of the same pads hold, along the bundled motion."""
    answer = tw.check("ur5", "demo", payload=5, grip="200,0.5")
    need = answer.grip_force.max()
    for factor, ok in ((1.001, True), (0.999, False)):
        assert tw.check("ur5", "demo", payload=5, grip=f"{need * factor},0.5").grip.holds.all() == ok


def test_a_cup_that_holds_from_above_pulls_with_the_weight():
    robot = tw.robots.ur5()
    rows = 8
    q = np.tile([0.0, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0.0], (rows, 1))
    z = np.asarray(robot.forward_kinematics(q[0]))[:3, 2]
    assert abs(z[2]) > 0.99
    motion = tw.Motion(np.linspace(0, 1, rows), q, 0 * q, 0 * q, robot=robot)
    found = tw.check(robot, motion, payload=3, cup="80,0.5")
    assert_allclose(found.grip_force, 3 * 9.81 if z[2] < 0 else 0.0, rtol=1e-6)
    falls = tw.check(robot, motion, payload=3, cup="20,0.5")
    if z[2] < 0:
        assert falls.headline.startswith(
            "OVER LIMIT: the load comes off the cup at t = 0.000 s: it needs 29.5 N, given 20 N"
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"grip": "60,0.5"}, "holds the payload, and there are 0"),
        ({"grip": "60", "payload": 1}, "FORCE,FRICTION"),
        ({"grip": {"force": 60}, "payload": 1}, "lacks 'friction'"),
        ({"grip": {"force": 60, "friction": 0.5, "thumb": 1}, "payload": 1}, "thumb"),
        ({"grip": "60,0.5", "cup": "80,0.5", "payload": 1}, "the same payload"),
        ({"cup": "-80,0.5", "payload": 1}, "force of cup"),
        ({"grip": "60,0.5@nowhere", "payload": 1}, "nowhere"),
        ({"bolts": "two"}, "NUMBERxDIAMETER"),
        ({"mounting": "tool0"}, "moves with a joint"),
        ({"mounting": True, "feet": "tool0"}, "stands on no feet"),
    ],
)
def test_bad_input_is_one_error_that_says_what_to_give(options, words):
    with pytest.raises((tw.ValueRangeError, tw.UnknownNameError)) as found:
        tw.check("ur5", "demo", **options)
    assert words in str(found.value)


def test_the_command_asks_the_same_questions(tmp_path):
    out = tmp_path / "out.csv"
    words = [
        "torques",
        "ur5",
        "demo",
        "--payload",
        "5",
        "--mounting",
        "--bolts",
        "4x0.17",
        "--grip",
        "60,0.5",
        "--csv",
        str(out),
    ]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 1
    assert " ".join(done.output.split()).startswith(
        "OVER LIMIT: the load slips in the grip at t = 1.808 s: it needs 74.9 N, given 60 N"
    )
    head = out.read_text().splitlines()[0]
    assert "mounting.mx [N m]" in head and "bolt4.shear [N]" in head and "grip.needed [N]" in head
