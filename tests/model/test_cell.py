"""Cells: robots joined by texts move and weigh like the parts, joined by another program, and are written and read again."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.robots.cell import PlacedRobot
from twistwrench.testing import random_pose, random_robot

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

EXACT = 1e-12
"""Relative: the same recursion over the same bodies, added up in another order."""

RAIL = """<robot name="rail"><link name="track"/><link name="carriage"><inertial><mass value="20"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="track"/><child link="carriage"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" effort="500" velocity="1"/></joint></robot>"""


@pytest.fixture
def rail(tmp_path):
    path = tmp_path / "rail.urdf"
    path.write_text(RAIL)
    return path


def close(one, other):
    np.testing.assert_allclose(one, other, rtol=0, atol=EXACT * max(1.0, np.abs(other).max(initial=0.0)))


@pytest.mark.parametrize("seed", range(10))
def test_a_cell_has_the_mass_matrix_and_torques_of_the_parts_joined_by_pinocchio(seed):
    """Random arms at random frames and poses; ``appendModel`` joins the same parts, and names match by prefix."""
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(seed)
    sizes, kinds = rng.integers(2, 7, 2), ("revolute", "prismatic")
    first, second = (random_robot(2 * seed + k, int(sizes[k]), kinds).with_gravity([0, 0, -9.81]) for k in range(2))
    frame, pose = first.frame_names[int(rng.integers(len(first.frame_names)))], random_pose(seed)
    cell = tw.join(first, PlacedRobot(second, frame, pose, "p_")).robot
    joined = _joined_by_pinocchio(pin, first, frame, pin.SE3(pose), second)
    q, dq, ddq = cell.random_configuration(rng), *rng.uniform(-1, 1, (2, cell.nv))
    order = np.argsort([cell.joint_names.index(name) for name in joined.names[1:]])
    at = np.argsort(order)
    data = joined.createData()
    close(cell.inverse_dynamics(q, dq, ddq), pin.rnea(joined, data, q[at], dq[at], ddq[at])[order])
    M = np.triu(pin.crba(joined, data, q[at]))
    close(cell.mass_matrix(q), (M + np.triu(M, 1).T)[np.ix_(order, order)])


def _joined_by_pinocchio(pin, first, frame, pose, second):
    """Model of both parts; ``appendModel`` leaves out what is fixed to the second's base, which is added here."""
    mine, theirs = first.to_pinocchio(), second.to_pinocchio()
    for k in range(1, len(theirs.names)):
        theirs.names[k] = f"p_{theirs.names[k]}"
    for one in theirs.frames:
        one.name = f"p_{one.name}"
    place = mine.frames[mine.getFrameId(frame)]
    joined = pin.appendModel(mine, theirs, mine.getFrameId(frame), pose)
    base = second.model.base_inertia
    if base.mass:
        body = pin.Inertia(base.mass, np.array(base.com), np.array(base.moment_about_com))
        joined.appendBodyToJoint(place.parentJoint, body, place.placement * pose)
    return joined


def test_a_rail_an_arm_and_a_hand_are_one_robot(rail):
    cell = tw.join(rail, "ur5@carriage", "planar_2r@tool0+0,0,0.1,0,0,90deg:hand_")
    assert cell.verdict.ok and cell.robot.tip == "hand_tip"
    assert cell.robot.joint_names == ("rail", *tw.robots.ur5().joint_names, "hand_joint1", "hand_joint2")
    by_hand = tw.load(rail).attach(tw.robots.ur5(), "carriage")
    pose = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    by_hand = by_hand.attach(tw.robots.planar_2r(), "tool0", pose, prefix="hand_")
    q, dq, ddq = cell.robot.random_configuration(1), *np.random.default_rng(0).normal(size=(2, 9))
    close(cell.robot.inverse_dynamics(q, dq, ddq), by_hand.inverse_dynamics(q, dq, ddq))


def test_parts_on_the_floor_stand_side_by_side_and_tilted():
    cell = tw.join("ur5@floor:left_", "ur5@floor+0,1,0,0,30deg,0:right_")
    tilted = tw.robots.ur5().with_gravity([9.81 * np.sin(np.radians(30)), 0, -9.81 * np.cos(np.radians(30))])
    q = tw.robots.ur5().random_configuration(3)
    close(cell.robot.gravity_forces(np.r_[q, q]), np.r_[tw.robots.ur5().gravity_forces(q), tilted.gravity_forces(q)])


def test_degrees_are_radians_written_otherwise():
    one, other = (tw.join("ur5@floor+0,0,0,0,30,0", degrees=True), tw.join("ur5@floor+0,0,0,0,30deg,0"))
    q = np.ones(6)
    close(one.robot.gravity_forces(q), other.robot.gravity_forces(q))


@pytest.mark.parametrize("ending", [".urdf", ".xml", ".sdf"])
def test_a_written_cell_is_the_cell(rail, tmp_path, ending):
    cell = tw.join(rail, "ur5@carriage", "planar_2r@tool0:hand_", name="cell")
    cell.write(tmp_path / f"cell{ending}")
    read = tw.load(tmp_path / f"cell{ending}")
    q, dq, ddq = cell.robot.random_configuration(1), *np.random.default_rng(0).normal(size=(2, 9))
    assert (read.name, read.joint_names) == ("cell", cell.robot.joint_names)
    np.testing.assert_allclose(read.inverse_dynamics(q, dq, ddq), cell.robot.inverse_dynamics(q, dq, ddq), atol=1e-9)


def test_a_part_at_one_of_several_tips_is_not_certain(rail):
    cell = tw.join(rail, "ur5", "planar_2r:hand_")
    assert str(cell.verdict.word) == "UNSURE" and cell.verdict.remedies == ("name the frame, planar_2r@FRAME",)
    assert "ee_link is a tip too" in cell.headline
    assert tw.join(rail, "ur5", "planar_2r@tool0:hand_").verdict.ok


def test_the_command_is_the_function(rail, tmp_path):
    path, parts = tmp_path / "cell.urdf", (str(rail), "ur5@carriage", "planar_2r@tool0:hand_")
    run = CliRunner().invoke(main, ["join", str(path), *parts])
    cell = tw.join(*parts, name="cell")
    assert run.exit_code == 0 and " ".join(run.output.split()).startswith(" ".join(cell.headline.split()))
    assert tw.load(path).joint_names == cell.robot.joint_names
    again = CliRunner().invoke(main, ["join", str(path), *parts])
    assert again.exit_code == 2 and "is there already" in again.output
    other = CliRunner().invoke(main, ["join", str(tmp_path / "cell.txt"), *parts])
    assert other.exit_code == 2 and "does not name a format" in other.output and "DONE" not in other.output


def test_degrees_apply_to_the_angles_of_the_command(tmp_path):
    one, other = tmp_path / "one.urdf", tmp_path / "other.urdf"
    for path, *arguments in ((one, "ur5@floor+0,0,0,0,90,0", "--degrees"), (other, "ur5@floor+0,0,0,0,90deg,0")):
        assert CliRunner().invoke(main, ["join", str(path), *arguments]).exit_code == 0
    close(*(tw.load(path).gravity_forces(np.ones(6)) for path in (one, other)))


@pytest.mark.parametrize(
    ("parts", "error", "said"),
    [
        ((), tw.ValueRangeError, "there is nothing to join"),
        (("ur5", "ur5"), tw.ModelError, "prefix='hand_'"),
        (("ur5", "planar_2r@nowhere:h_"), tw.UnknownNameError, "no frame named 'nowhere'"),
        (("ur5@tool0",), tw.ValueRangeError, "nothing is there yet"),
        (("ur5", "planar_2r@tool0+1,2:h_"), tw.ValueRangeError, "has 2 numbers"),
        (("ur5", "planar_2r@tool0+1,2,x:h_"), tw.ValueRangeError, "expected one number"),
        (("ur5", "planar_2r@tool0+1,2,nan:h_"), tw.ValueRangeError, "expected one number"),
        (("ur5", "planar_2r@tool0+0,0,0,0,0,90:h_"), tw.ValueRangeError, "write 90deg"),
        (("ur5", 3), tw.ValueRangeError, "a part is 3"),
        (("panda@floor:a_", "ur5@floor:b_", "planar_2r"), tw.FrameError, "several tips"),
        (("no_such_robot",), tw.NotFoundError, "no_such_robot"),
    ],
)
def test_bad_parts_are_one_error(parts, error, said):
    with pytest.raises(error, match=said):
        tw.join(*parts)


def test_what_the_file_of_a_cell_does_not_keep_is_said(tmp_path):
    """A spring of MJCF, which URDF has not, and shapes."""
    hand = tmp_path / "hand.xml"
    hand.write_text(
        '<mujoco model="hand"><worldbody><body name="palm"><geom type="box" size="0.1 0.1 0.1" mass="1"/>'
        '<body name="finger"><joint name="open" type="slide" axis="1 0 0" stiffness="30"/>'
        '<geom type="box" size="0.1 0.1 0.1" mass="1"/></body></body></worldbody></mujoco>'
    )
    done = CliRunner().invoke(main, ["join", str(tmp_path / "cell.urdf"), "ur5", f"{hand}@tool0"])
    assert done.exit_code == 0 and "lost: " in done.output and "spring" in done.output
    assert "the shapes of 2 links are not written" in done.output
