"""Wheels, mounting, bolts, grip and cup as questions of ``check``: against formulas, other functions, and the command."""

from __future__ import annotations

import csv
import functools
import re

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from standing_robots import WHEELS, cart_text, turning

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main
from twistwrench.reports.support.fingers import finger_drives
from twistwrench.statics.support import force_shares

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    path = tmp_path_factory.mktemp("cart") / "cart.urdf"
    path.write_text(cart_text())
    return tw.load(path)


@functools.cache
def around_the_peak():
    """Rows of the bundled motion of the UR5 around 1.808 s, where most torque and most grip are needed."""
    demo = tw.check("ur5", "demo").motion
    rows = slice(210, 241)
    return tw.Motion(demo.time[rows], demo.q[rows], demo.dq[rows], demo.ddq[rows], robot=tw.robots.ur5())


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
    for beyond, less in ((2.0, "2"), (1.2341, "1.24")):  # rounded up: with 1.23 kg less it would still tip
        answer = tw.check(cart, still, wheels=WHEELS, contact_friction=0.7, payload=most + beyond)
        assert answer.headline.startswith(
            f"OVER LIMIT: tips over wheel_fl and wheel_fr at t = 0.000 s. It stands with {less} kg less"
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


def test_the_friction_that_is_stated_suffices_and_is_less_than_a_tenth_too_much(cart):
    """Two significant digits, rounded up; without friction is said only where none is needed."""
    for angle in (0.003, 0.03, 0.3, 1.2):
        answer = tw.check(cart, turning(cart, angle), wheels=WHEELS, contact_friction=0.9)
        stated = float(answer.headline.partition("needs friction ")[2].split()[0])
        least = answer.support.friction.max()
        assert least <= stated <= max(1.1 * least, least + 0.001), angle
        again = tw.check(cart, turning(cart, angle), wheels=WHEELS, contact_friction=stated)
        assert again.headline.startswith("OK: stands. It needs friction ") or "joint" in again.headline
    still = tw.check(cart, turning(cart, 0.0), wheels=WHEELS, contact_friction=0.9)
    assert still.headline.startswith("OK: stands. It needs no friction (given 0.9)")
    assert tw.check(cart, turning(cart, 0.0), wheels=WHEELS).headline.startswith("OK: stands, without any friction")


def test_a_margin_without_a_coefficient_names_the_friction_that_it_assumes(cart):
    tipping = tw.check(cart, turning(cart, 6.0), wheels=WHEELS)
    assert tipping.headline.startswith("OVER LIMIT: tips over ")
    assert "× this speed on ground of friction 0.3" in tipping.headline
    speed = float(tipping.headline.partition("It stands up to ")[2].split()[0])
    given = tw.check(cart, turning(cart, 6.0), wheels=WHEELS, contact_friction=0.3)
    assert_allclose(given.support.speed.min(), speed, rtol=0.01)
    assert "With 0.3 it holds up to" in tw.check(cart, turning(cart, 0.5), wheels=WHEELS).headline


def test_casters_roll_away_in_a_motion_and_stand_at_rest(cart):
    answer = tw.check(cart, turning(cart), casters=WHEELS)
    assert answer.headline.startswith("OVER LIMIT: slips at ")
    assert "At rest it stands in this pose" in answer.headline and "at rest either" not in answer.headline
    assert tw.check(cart, at={"pan": 0.0}, casters=WHEELS).headline.startswith("OK: stands, without any friction")


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


def bolt_file(path, unit, preload, factor=1.0, force="N"):
    rows = "\n".join(f"{factor * x},{factor * y},{preload}" for x in (-0.06, 0.06) for y in (-0.06, 0.06))
    path.write_text(f"x [{unit}],y [{unit}],preload [{force}]\n{rows}")
    return path


def test_units_of_a_table_of_bolts_are_those_of_its_header(tmp_path):
    metres, millimetres = (
        tw.check("ur5", "demo", mounting=True, bolts=bolt_file(tmp_path / f"{k}.csv", *asked))
        for k, asked in enumerate((("m", 5000), ("mm", 5, 1000, "kN")))
    )
    assert_allclose(millimetres.bolt_loads, metres.bolt_loads, rtol=1e-12)
    with pytest.raises(tw.TwistWrenchError, match="furlong"):
        tw.check("ur5", "demo", mounting=True, bolts=bolt_file(tmp_path / "odd.csv", "furlong", 5))
    bare = tmp_path / "bare.csv"
    bare.write_text("x,y\n60,60\n-60,60\n60,-60\n-60,-60")
    for given in (bare, "6x200"):
        with pytest.raises(tw.ValueRangeError, match="in metres: if these are millimetres"):
            tw.check("ur5", "demo", mounting=True, bolts=given)
    with pytest.raises(tw.ValueRangeError, match="preload of bolt 1 is -5 N"):
        tw.check("ur5", "demo", mounting=True, bolts=bolt_file(tmp_path / "minus.csv", "m", -5))


def test_each_bolt_of_a_table_has_its_own_preload(tmp_path):
    table = tmp_path / "bolts.csv"
    table.write_text("x,y,preload\n0.1,0,9000\n0,0.1,8000\n-0.1,-0.1,7000\n")
    pattern = tw.check("ur5", "demo", mounting=True, bolts=table).held.mounting.pattern
    assert_allclose(np.c_[pattern.places, pattern.preload], [[0.1, 0, 9000], [0, 0.1, 8000], [-0.1, -0.1, 7000]])


def test_a_bolt_opens_where_the_robot_pulls_it_with_more_than_its_preload(tmp_path):
    free = tw.check("ur5", "demo", payload=5, mounting=True, bolts=bolt_file(tmp_path / "none.csv", "m", 1e6))
    pull = (free.bolt_loads[..., 0] - 1e6).max()
    for share, opens in ((1.01, False), (0.99, True)):
        file = bolt_file(tmp_path / f"{share}.csv", "m", share * pull)
        answer = tw.check("ur5", "demo", payload=5, mounting=True, bolts=file)
        assert answer.headline.startswith("OVER LIMIT: the joint opens at bolt ") == opens
        assert_allclose(max(answer.tables["Bolts, by the robot alone"].to_dict()["largest pull"]), pull, rtol=1e-6)


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
    """The needed force is the least for which the contacts of the same pads hold, where the bundled motion needs most."""
    asked = {"motion": around_the_peak(), "payload": 5}
    need = tw.check("ur5", **asked, grip="200,0.5").grip_force.max()
    for factor, ok in ((1.001, True), (0.999, False)):
        assert tw.check("ur5", **asked, grip=f"{need * factor},0.5").grip.holds.all() == ok


def test_a_grip_holds_up_to_the_speed_that_its_sentence_states():
    """Played at s times the speed, accelerations are s² times as large: the fingers hold just below the stated s, and not above."""
    robot = tw.robots.ur5()
    demo = around_the_peak()
    asked = {"payload": 2, "grip": "60,0.5"}
    answer = tw.check(robot, demo, **asked)
    stated = float(re.search(r"holds up to ([\d.]+) × this speed", str(answer)).group(1))
    for s, holds in ((stated, True), (1.01 * stated, False)):
        faster = tw.Motion(demo.time / s, demo.q, s * demo.dq, s**2 * demo.ddq, robot=robot)
        assert tw.check(robot, faster, **asked).grip.holds.all() == holds


TURNTABLE = """<robot name="turntable"><link name="base"/><link name="plate"><inertial><mass value="5"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="hand"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/></joint>
<joint name="fixed" type="fixed"><parent link="plate"/><child link="hand"/><origin xyz="0.5 0 0"/></joint></robot>"""


def test_a_grip_beside_and_above_its_hand_holds_the_weight_and_the_pull_inward():
    """A point of 2 kg at c on a turntable at 3 rad/s takes the force 2 (g - a), a = -9 times its way from the axis, at c."""
    robot, rate, c = tw.load(TURNTABLE), 3.0, np.array([0.02, 0.03, 0.1])
    time = np.linspace(0.0, 1.0, 8)
    motion = tw.Motion(time, rate * time[:, None], np.full((8, 1), rate), np.zeros((8, 1)), robot=robot)
    found = tw.check(robot, motion, payload="2,0.02,0.03,0.1@hand", grip="200,0.5@hand").held.grip
    force = 2.0 * (np.array([0.0, 0.0, -9.81]) + rate**2 * np.array([0.52, 0.03, 0.0]))
    wrench = np.r_[np.cross(c, force), force][None]
    assert_allclose(found.needed, 200.0 * force_shares(wrench, found.holder.contacts)[0], rtol=1e-6)


def test_the_time_of_a_needed_force_that_no_cup_has_is_that_of_its_instant():
    """A cup without friction pulls at the weight until the turntable starts at 0.45 s; then no force holds the load inward."""
    robot = tw.load(TURNTABLE).with_gravity((0, 0, 9.81))
    time = np.linspace(0.0, 1.0, 11)
    started = np.maximum(time - 0.45, 0.0)
    columns = (2.0 * started**2, 4.0 * started, 4.0 * (started > 0))
    answer = tw.check(
        robot, tw.Motion(time, *(x[:, None] for x in columns), robot=robot), payload="2@hand", cup="200,0@hand"
    )
    assert_allclose(answer.grip_force, np.where(started > 0, np.inf, 2.0 * 9.81), rtol=1e-6)
    assert "slips on the cup at t = 0.500 s: no force holds it" in answer.headline
    (grip,) = (table for table in answer.to_dict()["tables"] if table["title"] == "Grip")
    (row,) = grip["rows"]
    assert row[[column["name"] for column in grip["columns"]].index("when")] == 0.5


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
    assert falls.held.grip.holder.contacts[0].point[0] == 0.02  # m, the radius
    assert "(with a cup of 40 mm)" in falls.held.grip.line


def test_a_cup_is_pulled_off_where_no_friction_would_help_and_slips_where_it_would():
    """Turned by an angle from hanging below the cup, the load of weight W pulls with W cos and slides with W sin."""
    robot, weight = tw.robots.ur5(), 3 * 9.81
    for angle in np.radians([0, 20, 40, 70, 88]):
        q = np.array([0.0, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0.0])
        R = np.asarray(robot.forward_kinematics(q))[:3, :3]
        lean = R @ [np.sin(angle), 0, np.cos(angle)]  # direction of gravity: out of the cup, and to its side
        turned = robot.with_gravity(9.81 * lean)
        motion = tw.Motion(np.linspace(0, 1, 8), np.tile(q, (8, 1)), np.zeros((8, 6)), np.zeros((8, 6)), robot=turned)
        answer = tw.check(turned, motion, payload=3, cup="20,0.5")
        off = weight * np.cos(angle) > 20
        assert ("the load comes off the cup" if off else "the load slips on the cup") in answer.headline, angle


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"grip": "60,0.5"}, "holds the payload, and there are 0"),
        ({"cup": "60,0.5", "payload": 0}, "holds the payload, and its mass is 0. Give one with a mass"),
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
    out, motion = tmp_path / "out.csv", around_the_peak().to_csv(tmp_path / "motion.csv")
    words = [
        "torques",
        "ur5",
        str(motion),
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


# ── What other limits mean for the first lines


@pytest.mark.parametrize(
    "options", [{"grip": "30,0.5"}, {"mounting": True, "bolts": "4x0.17"}, {"limits": {"tilting": np.full(6, 1.0)}}]
)
def test_the_largest_payload_is_by_torques_alone_where_grip_bolts_or_bearings_may_hold_less(options):
    plain, other = (tw.check("ur5", around_the_peak(), payload=5, **asked) for asked in ({}, options))
    assert "Maximum payload on this path: 8.38 kg" in str(plain)
    assert "Maximum payload on this path by joint torques alone: 8.38 kg" in " ".join(str(other).split())
    assert_allclose(other.largest_payload, plain.largest_payload)


def test_bolts_without_preload_are_not_judged_in_words(tmp_path):
    answer = tw.check("ur5", "demo", payload=5, mounting=True, bolts="4x0.17")
    pull = answer.bolt_loads[..., 0].max()
    said = f"The bolts are not judged, as their preload is not known: the robot pulls one with up to {pull:.4g} N."
    assert said in " ".join(str(answer).split())
    judged = tw.check("ur5", "demo", payload=5, mounting=True, bolts=bolt_file(tmp_path / "b.csv", "m", 1e5))
    assert "not judged" not in str(judged)


GRIPPER = """<robot name="gripper"><link name="palm"/>{fingers}</robot>"""
FINGER = """<link name="{name}"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="{name}_drive" type="{kind}"><parent link="palm"/><child link="{name}"/><origin xyz="0 0 0.1"/>
<axis xyz="0 {side} 0"/><limit lower="-1" upper="1" effort="100" velocity="1"/></joint>"""


def with_gripper(folder, kind):
    fingers = "".join(FINGER.format(name=n, kind=kind, side=s) for n, s in (("left", 1), ("right", -1)))
    (folder / "gripper.urdf").write_text(GRIPPER.format(fingers=fingers))
    robot = tw.join("ur5", folder / "gripper.urdf").robot
    q = np.tile([0.0, -1.2, 1.2, 0.0, 0.0, 0.0, 0.0, 0.0], (8, 1))
    return robot, tw.Motion(np.linspace(0, 1, 8), q, 0 * q, 0 * q, robot=robot)


@pytest.mark.parametrize("frame", ["palm", "left"])
def test_fingers_weaker_than_the_grip_force_make_the_answer_unsure(tmp_path, frame):
    """Nothing describes how the grip force loads the drives: below their limit a remark, above it UNSURE, never a bare OK."""
    robot, motion = with_gripper(tmp_path, "prismatic")
    for force, word in ((160, "UNSURE"), (100.1, "UNSURE"), (100, "OK"), (90, "OK")):
        answer = tw.check(robot, motion, payload={frame: 1.0}, grip=f"{force},0.5@{frame}")
        assert answer.verdict.word == word
        remark = f"drives of left_drive, right_drive (100 N) are not judged for the grip force of {force} N"
        assert remark in " ".join(str(answer).split())
        assert ("above the limit of a sliding finger" in answer.headline) == (word == "UNSURE")
        assert answer.verdict.remedies == (("limits='limits.csv'",) if word == "UNSURE" else ())
    stronger = {"left_drive": 500.0, "right_drive": 500.0}
    assert tw.check(robot, motion, payload={frame: 1.0}, grip=f"160,0.5@{frame}", limits=stronger).verdict.ok


def test_turning_fingers_are_remarked_and_fingers_that_a_wrench_loads_are_judged(tmp_path):
    robot, motion = with_gripper(tmp_path, "revolute")
    asked = {"payload": {"palm": 1.0}, "grip": "160,0.5@palm"}
    answer = tw.check(robot, motion, **asked)
    assert "(100 N m) are not judged for the grip force of 160 N" in " ".join(str(answer).split())
    assert answer.verdict.ok  # a moment is not compared with a force
    push = {name: [0, 0, 0, 0, 5.0, 0] for name in ("left", "right")}
    assert "not judged" not in str(tw.check(robot, motion, wrench_on_robot=push, **asked))
    assert "not judged" not in str(tw.check("ur5", around_the_peak(), payload=5, grip="200,0.5"))


def test_limits_of_fingers_stand_in_the_order_of_their_names(tmp_path):
    robot, motion = with_gripper(tmp_path, "prismatic")
    limits = {"left_drive": 290.0, "right_drive": 170.0}
    answer = tw.check(robot, motion, payload={"palm": 1.0}, grip="60,0.5@palm", limits=limits)
    assert "drives of left_drive, right_drive (290 N, 170 N) are not judged" in " ".join(str(answer).split())


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
@pytest.mark.parametrize("frame", ["palm", "left", "right"])
def test_a_finger_that_follows_has_the_limit_of_its_own_drive(tmp_path, kind, frame):
    """The limit of its leader may be lower, higher or none; limits given for the leader leave it, and a push takes it out."""
    left = FINGER.format(name="left", kind=kind, side=1)
    right = FINGER.format(name="right", kind=kind, side=-1).replace('effort="100"', 'effort="40"')
    right = right.replace("</joint>", '<mimic joint="left_drive" multiplier="-1"/></joint>')
    wrist = '<link name="arm"/><joint name="wrist" type="continuous"><parent link="arm"/><child link="palm"/></joint>'
    (tmp_path / "gripper.urdf").write_text(GRIPPER.format(fingers=left + right + wrist))
    model = tw.load(tmp_path / "gripper.urdf").model
    for given, expected in ((100.0, (100.0, 40.0)), (25.0, (25.0, 40.0)), (np.inf, (40.0,))):
        drives = finger_drives(model, frame, np.array([7.0, given]), ())
        assert drives.joints == ("left_drive", "right_drive")[-len(expected) :]
        assert drives.efforts == expected
        assert drives.turning == (kind == "revolute",) * len(expected)
        for force in (24.9, 25.1, 39.9, 40.1, 99.9, 100.1):
            assert drives.are_weaker(force) == (kind == "prismatic" and force > min(expected))
    assert finger_drives(model, frame, np.array([7.0, 100.0]), ["left"]).efforts == (40.0,)
    assert finger_drives(model, frame, np.array([7.0, 100.0]), ["right"]).efforts == (100.0,)


def bearing_table(tmp_path, text):
    (tmp_path / "bearings.csv").write_text(text)
    return tmp_path / "bearings.csv"


def test_the_closest_limit_may_be_that_of_a_bearing(tmp_path):
    """The largest share of all limits is named first, and the table has the loads of all bearings with limits."""
    free = tw.check(
        "ur5", "demo", payload=5, limits=bearing_table(tmp_path, "joint,tilting,radial\nelbow_joint,1e6,1e6")
    )
    assert free.headline.startswith("OK: all limits kept. Closest: shoulder_lift_joint, 76 % of its torque limit")
    (largest,) = (use.value for use in free.bearings if use.kind == "tilting")
    for share, begins in (
        (0.998, "the bearing of elbow_joint, 99.8 % of its limit of tilting moment"),
        (0.5, "shoulder_lift_joint, 76"),
    ):
        table = bearing_table(tmp_path, f"joint,tilting,radial\nelbow_joint,{largest / share},1e6")
        answer = tw.check("ur5", "demo", payload=5, limits=table)
        assert answer.headline.startswith(f"OK: all limits kept. Closest: {begins}"), answer.headline
        shown = answer.tables["Bearings"].to_dict()
        assert_allclose(max(shown["of limit"]), share, rtol=1e-6)
    assert "Torque of shoulder_lift_joint: 76 % of its limit" not in answer.headline


def test_the_force_along_a_sliding_joint_is_no_load_of_its_bearing(tmp_path):
    robot, motion = with_gripper(tmp_path, "prismatic")
    with pytest.raises(tw.ValueRangeError, match=r"slides along its axis.*effort"):
        tw.check(robot, motion, limits=bearing_table(tmp_path, "joint,axial\nleft_drive,10"))
    assert tw.check(robot, motion, limits=bearing_table(tmp_path, "joint,axial,radial\nleft_drive,,100")).verdict.ok


@pytest.mark.parametrize("mounting", [None, False, np.False_, 0])
def test_whatever_says_no_is_no_mounting(mounting):
    assert tw.check("ur5", "demo", mounting=mounting).held.mounting is None
