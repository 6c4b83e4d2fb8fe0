"""Legged files whose base is fixed open standing in the air, on soles at one height, and say so; or they say why not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from page_files import read_page
from robot_files import FILES
from test_page_loops import biped

import twistwrench as tw
from twistwrench.mechanics.model.legs import hanging_base
from twistwrench.viz import scene_of, write_page
from twistwrench.viz.starting_pose import is_arm, starting_pose

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

NAMES = ("go2_description/go2", "go1_description/go1", "g1_description/g1_29dof_rev_1_0", "solo_description/solo12")


def least_heights(robot, q, count):
    """Lowest points of the lowest bodies, by their shapes."""
    scene = scene_of(robot)
    poses, low = scene.body_poses(q), {}
    for shape in scene.shapes:
        if shape.layer == "looks" and shape.body >= 0:
            T = poses[shape.body] @ shape.pose
            height = float((shape.surface.vertices @ T[2, :3] + T[2, 3]).min())
            low[shape.body] = min(height, low.get(shape.body, np.inf))
    return np.sort(list(low.values()))[:count]


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    folder = tmp_path_factory.mktemp("held")
    (folder / "biped.urdf").write_text(biped())
    return tw.load(folder / "biped.urdf")


def test_a_legged_file_with_a_fixed_base_opens_standing_and_says_so(held, tmp_path):
    header = read_page(write_page(held, tmp_path / "page.html"))[0]
    assert header["held"] == "base fixed in the air by the file; with floating_base=True the feet carry"
    assert header["standing"] is None
    soles = [0.03, 0.0, -0.08]  # middle of the box feet's lower side
    q = np.array(header["start"])
    heights = [held.forward_kinematics(q, f"{side}_foot_link") @ [*soles, 1] for side in ("left", "right")]
    assert heights[0][2] == pytest.approx(heights[1][2], abs=1e-3)
    for side in ("left", "right"):  # soles are level
        assert held.forward_kinematics(q, f"{side}_foot_link")[2, 2] == pytest.approx(1, abs=1e-4)
    assert not held.limits.exceeded(q).any()


def test_without_a_standing_pose_the_page_says_why(tmp_path):
    """One thigh is 3 cm shorter, and neither hips nor knees move enough to make up for it."""
    text = re.sub(r'lower="-?[\d.]+" upper="[\d.]+"', 'lower="-0.05" upper="0.05"', biped())
    at = text.index('<joint name="right_knee"')
    (tmp_path / "short.urdf").write_text(text[:at] + text[at:].replace('xyz="0 0 -0.4"', 'xyz="0 0 -0.37"', 1))
    header = read_page(write_page(tw.load(tmp_path / "short.urdf"), tmp_path / "page.html"))[0]
    assert re.search(
        r"; no standing pose found: within the limits a foot stays [\d.]+ mm off the floor$", header["held"]
    )


def test_an_arm_has_most_of_the_joints_or_of_the_mass_in_one_chain(held):
    assert is_arm(tw.robots.ur5().model)
    assert is_arm(tw.robots.panda().model)
    assert not is_arm(held.model)
    low, high = held.limits.lower, held.limits.upper
    q = starting_pose(held)
    assert np.all((q - low >= 0.0999 * (high - low)) & (high - q >= 0.0999 * (high - low)))  # clear of stops


def test_followers_of_a_gripper_do_not_make_an_arm_less_of_one():
    """Three joints and a finger are the four that move by themselves; seven heavy fingers follow."""
    inertia = '<inertial><mass value="{}"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts, parent = ['<link name="base"/>'], "base"
    for name in ("a", "b", "c", *(f"finger{k}" for k in range(8))):
        mimic = '<mimic joint="to_finger0"/>' if name.startswith("finger") and name != "finger0" else ""
        parts.append(
            f'<link name="{name}">{inertia.format(1.0 if "finger" in name else 0.1)}</link><joint name="to_{name}" '
            f'type="continuous"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 1 0"/>{mimic}</joint>'
        )
        parent = parent if "finger" in name else name
    robot = tw.load(f'<robot name="gripper">{"".join(parts)}</robot>')
    assert robot.nv == 4 and is_arm(robot.model)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_legged_files_of_the_field_stand_within_a_millimetre(name, tmp_path):
    if name not in FILES:
        pytest.skip("needs example-robot-data")
    robot = tw.load(FILES[name], inertia="accept")
    legs = hanging_base(robot.model).legs
    header = read_page(write_page(robot, tmp_path / "page.html"))[0]
    assert header["held"].endswith("with floating_base=True the feet carry")
    heights = least_heights(robot, np.array(header["start"]), len(legs))
    assert np.ptp(heights) < 0.01
    assert heights[0] == pytest.approx(header["floor"], abs=1e-3)
