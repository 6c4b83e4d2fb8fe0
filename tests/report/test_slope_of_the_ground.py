"""Slopes, directions of gravity and heights of contacts: what a robot on them needs, and what its first line claims."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from robot_files import FILES, NONE
from standing_robots import WHEELS, cart_text, dog, turning

import twistwrench as tw
from twistwrench import statics

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

G = 9.81
NOSE = 0.3 - (5 * 0.3 + 4 * 0.9) / 39  # m, of the front wheels before the centre of mass
HEIGHT = 0.2 + 9 * 0.5 / 39  # m, of the centre of mass above the ground


@pytest.fixture(scope="module")
def cart_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("cart") / "cart.urdf"
    path.write_text(cart_text())
    return path


def downhill(angle):
    """Gravity on a floor that falls along x, in axes of the floor."""
    return [G * np.sin(angle), 0.0, -G * np.cos(angle)]


def at_rest(robot, base=()):
    q = np.tile(np.r_[base, np.zeros(2)], (8, 1))
    still = np.zeros((8, robot.nv))
    return tw.Motion(np.linspace(0, 1, 8), q, still, still, robot=robot)


def pitched(angle, height=0.3):
    """Pose of the base, nose down by an angle about y."""
    return [np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0, 0.0, 0.0, height]


@pytest.mark.parametrize("angle", [0.34, 0.36, 0.48, 0.5])
def test_a_cart_on_a_ramp_needs_the_tangent_of_its_angle_and_tips_where_its_centre_passes_the_wheels(cart_file, angle):
    robot = tw.load(cart_file).with_gravity(downhill(angle))
    answer = tw.check(robot, at_rest(robot), wheels=WHEELS, contact_friction=0.36)
    tips, slips = np.tan(angle) > NOSE / HEIGHT, np.tan(angle) > 0.36
    word = (
        "OVER LIMIT: tips over wheel_fl and wheel_fr"
        if tips
        else "OVER LIMIT: slips"
        if slips
        else "OK: stands on a slope"
    )
    assert answer.headline.startswith(word)
    if not tips:
        assert_allclose(answer.support.friction, np.tan(angle), atol=2e-4)
    if word.startswith("OK"):
        assert f"on a slope of {np.degrees(angle):.3g}°" in answer.headline


@pytest.mark.parametrize(("degrees", "stated"), [(0.4, ""), (0.6, " on a slope of 0.6°")])
def test_half_a_degree_of_slope_is_stated_and_less_is_level(cart_file, degrees, stated):
    """A floor is no leveller than that; the friction of a small slope is its angle."""
    robot = tw.load(cart_file).with_gravity(downhill(np.radians(degrees)))
    answer = tw.check(robot, at_rest(robot), wheels=WHEELS, contact_friction=0.36)
    assert answer.headline.startswith(f"OK: stands{stated}. It needs friction 0.0")


def test_a_ramp_is_the_same_by_tilted_gravity_and_by_the_normal_of_the_ground(cart_file):
    """Turning the world changes no margin; contact forces turn with it."""
    angle = 0.3
    tilted = tw.load(cart_file).with_gravity(downhill(angle))
    first = tw.check(tilted, at_rest(tilted), wheels=WHEELS, contact_friction=0.7)
    free = tw.load(cart_file, floating_base=True)
    normal = [np.sin(angle), 0.0, np.cos(angle)]
    asked = {"wheels": WHEELS, "contact_friction": 0.7, "contact_normal": normal}
    second = tw.check(free, at_rest(free, pitched(angle)), **asked)
    held = tw.load(cart_file)
    third = tw.check(held, at_rest(held), **asked)  # the base is found: it stands on that ground
    assert first.headline.startswith("OK: stands on a slope of 17.2°. It needs friction 0.31 (given 0.7)")
    for other in (second, third):
        assert other.headline == first.headline
        assert_allclose(other.support.friction, first.support.friction, atol=2e-4)
        assert_allclose(other.support.forces @ normal, first.support.forces[..., 2], atol=1e-6)


def test_wheels_at_different_heights_are_unsure_until_the_ground_is_stated(cart_file):
    free = tw.load(cart_file, floating_base=True)
    motion = at_rest(free, pitched(0.3))
    asked = {"wheels": WHEELS, "contact_friction": 0.7}
    doubted = tw.check(free, motion, **asked)
    assert doubted.headline.startswith("UNSURE: contacts stand at different heights at t = 0.000 s: wheel_fl 0 m")
    assert "Does the floor slope by 17°?" in doubted.headline
    (stated,) = (text for text in doubted.verdict.remedies if text.startswith("contact_normal="))
    normal = eval(stated.partition("=")[2])  # the remedy is an argument
    assert_allclose(normal, [np.sin(0.3), 0, np.cos(0.3)], atol=1e-4)
    assert tw.check(free, motion, **asked, contact_normal=normal).headline.startswith("OK: stands on a slope of 17.2°")
    assert tw.check(free, motion, **asked, contact_normal=(0, 0, 1)).headline.startswith("OK: stands. ")
    raised = motion.q.copy()
    raised[:, 0], raised[:, 2] = 1.0, 0.0
    assert tw.check(free, tw.Motion(motion.time, raised, robot=free), **asked).headline.startswith("OK: stands. ")


def test_a_dog_on_a_slope_is_unsure_and_one_that_lifts_a_foot_is_not_asked():
    """Of feet at different heights only the lowest would carry, so that it would seem to tip."""
    robot, level = dog(rows=11)
    q = level.q.copy()
    turn = np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])
    R = np.array([[np.cos(0.2), 0, np.sin(0.2)], [0, 1, 0], [-np.sin(0.2), 0, np.cos(0.2)]])
    q[:, :4], q[:, 4:7] = turn, q[:, 4:7] @ R.T
    sloped = tw.Motion(level.time, q, level.dq * 0, level.ddq * 0, robot=robot, in_seconds=True)
    asked = {"feet": "auto", "contact_friction": 0.6}
    answer = tw.check(robot, sloped, **asked)
    assert answer.headline.startswith("UNSURE: contacts stand at different heights")
    normal = R @ [0, 0, 1]
    proposed = re.search(r"Does the floor slope by 11°\? Give its normal, contact_normal=\[([^]]*)\]", answer.headline)
    assert_allclose([float(x) for x in proposed[1].split(",")], normal, atol=1e-3)
    found = tw.check(robot, sloped, **asked, contact_normal=normal)
    assert found.headline.startswith("OK: stands on a slope of 11.5°. It needs friction 0.21 (given 0.6)")
    # Torques of instants without balance are of forces that do not exist: over no limit for certain, and the question stays.
    enough = {j.joint: 1.05 * abs(j.largest) for j in found.joints if not j.joint.startswith("root")}
    assert any(abs(j.largest) > enough.get(j.joint, np.inf) for j in answer.joints)
    weak = tw.check(robot, sloped, **asked, limits=enough)
    assert weak.headline.startswith("UNSURE: contacts stand at different heights")
    assert any("as if the contacts stuck to the ground OVER LIMIT" in reason for reason in weak.verdict.reasons)
    assert tw.check(robot, sloped, **asked, limits=enough, contact_normal=normal).verdict.ok
    q = level.q.copy()
    q[:, 8] += 0.3  # one knee bends: that foot is in the air
    lifted = tw.Motion(level.time, q, level.dq * 0, level.ddq * 0, robot=robot, in_seconds=True)
    assert "different heights" not in tw.check(robot, lifted, **asked).headline


def test_nothing_stands_where_gravity_points_away_from_the_ground(cart_file):
    robot = tw.load(cart_file).with_gravity([0, 0, G])
    answer = tw.check(robot, at_rest(robot), wheels=WHEELS, contact_friction=0.7)
    assert answer.headline.startswith("UNSURE: gravity, (0, 0, 9.81) m/s², points away from the ground")
    assert answer.verdict.remedies == ("contact_normal=[0.0, 0.0, -1.0]",)


def test_a_file_whose_y_axis_is_vertical_stands_on_a_floor_across_it():
    """The box of the y-up world has the forces of the box of the z-up world, turned."""
    box = tw.robots.floating_box()
    size = 0.1
    for gravity, axis in (([0, 0, -G], 2), ([0, -G, 0], 1), ([1.0, -G, 0.5], 1)):
        robot = box.with_gravity(gravity)
        assert_allclose(statics.wheel(robot, box.tip, 0.5).normal, np.eye(3)[axis])
        assert_allclose(statics.sole(robot, box.tip, 0.5, (size, size))[0].normal, np.eye(3)[axis])


def test_wheels_of_different_size_stand_on_level_ground(tmp_path):
    """A log of the joints alone: the wheels' lowest points are level, not their centres."""
    path = tmp_path / "cart.urdf"
    text = cart_text()
    for name in ("rl", "rr"):  # half the radius, 5 cm lower
        y = 0.25 if name == "rl" else -0.25
        old = f'<link name="wheel_{name}"><collision><geometry><cylinder radius="0.1"'
        assert old in text
        text = text.replace(old, old.replace("0.1", "0.05")).replace(f"-0.3 {y} -0.1", f"-0.3 {y} -0.15")
    path.write_text(text)
    robot = tw.load(path)
    answer = tw.check(robot, turning(robot), wheels=WHEELS, contact_friction=0.7)
    assert answer.verdict.ok
    assert_allclose(answer.motion.q[:, :4], np.tile([1.0, 0, 0, 0], (len(answer.motion.q), 1)), atol=1e-12)


@pytest.mark.parametrize("name", ["beside/nao_v40"] if "beside/nao_v40" in FILES else NONE)
def test_a_robot_stands_on_its_soles_and_not_on_its_bumpers(name):
    assert statics.find_feet(tw.load(FILES[name], inertia="accept", mimic="independent")) == ("l_sole", "r_sole")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"contact_normal": (0, 0, 0), "wheels": WHEELS}, "has no length"),
        ({"contact_normal": (0, 0, 1)}, "nothing stands on it"),
        ({"contact_normal": (0, 1), "wheels": WHEELS}, "contact_normal"),
    ],
)
def test_a_normal_that_is_none_is_one_error(cart_file, options, words):
    robot = tw.load(cart_file)
    with pytest.raises((tw.ValueRangeError, tw.ShapeError)) as found:
        tw.check(robot, at_rest(robot), **options)
    assert words in str(found.value)
