"""SDF: each thing the format can say beside the same robot in MJCF, whose reader is compared with MuJoCo; and Drake, where it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner
from drake_models import differences, drake_plant
from places import SHARED
from quiet_loading import load_quietly

import twistwrench as tw
from twistwrench.cli.main import main

FOLDER = SHARED / "robots" / "sdf"
FILES = sorted(path.name for path in FOLDER.glob("*.sdf")) if FOLDER.is_dir() else []
NONE = [pytest.param("", marks=pytest.mark.skip(reason="../shared/robots/sdf is not there"))]
REFUSED = {
    "drake_joint_parsing_test.sdf": "has 2 models that can move",
    "gazebo_demo_joint_types.sdf": "has the name of <link name='screw_thread'> (line 688)",
}


def link(name, pose="0 0 0 0 0 0", relative="", inside=""):
    where = f' relative_to="{relative}"' if relative else ""
    return f"""<link name="{name}"><pose{where}>{pose}</pose><inertial><pose>0.1 0.02 0.03 0.1 0.2 0.3</pose><mass>2</mass>
      <inertia><ixx>0.05</ixx><iyy>0.04</iyy><izz>0.03</izz><ixy>0.001</ixy><ixz>0.002</ixz><iyz>0.003</iyz></inertia>
      </inertial>{inside}</link>"""


def robot_of(
    joint,
    *,
    pose="1 2 3 0.1 0.2 0.3",
    base="0.1 0.2 0.3 0.3 0.2 0.1",
    arm="0.4 0.5 0.6 0.5 0 0.2",
    version="1.8",
    more="",
):
    return f"""<sdf version="{version}"><model name="m"><pose>{pose}</pose>{link("base", base)}{link("arm", arm)}{joint}{more}
      </model></sdf>"""


def revolute(axis="<xyz>1 2 3</xyz>", kind="revolute", inside="", pose="<pose>0.1 0 0.2 0.4 0 0</pose>"):
    return f"""<joint name="j" type="{kind}">{pose}<parent>base</parent><child>arm</child>{inside}<axis>{axis}</axis></joint>"""


def expected(q, *, axis, point, slide=False, pitch=0.0):
    """T_world,arm at q, by the product of exponentials: axis and point in the model's frame."""
    T_wm, T_ma = pose(1, 2, 3, 0.1, 0.2, 0.3), pose(0.4, 0.5, 0.6, 0.5, 0, 0.2)
    w = np.asarray(axis, float) / np.linalg.norm(axis)
    S = np.r_[np.zeros(3), w] if slide else np.r_[w, np.cross(point, w) + pitch * w]
    return T_wm @ tw.se3.exp(S * q) @ T_ma


def pose(x, y, z, roll, pitch, yaw):
    R = tw.so3.exp([0, 0, yaw]) @ tw.so3.exp([0, pitch, 0]) @ tw.so3.exp([roll, 0, 0])
    return tw.se3.pose(R, [x, y, z])


T_MA = pose(0.4, 0.5, 0.6, 0.5, 0, 0.2)
T_MJ = T_MA @ pose(0.1, 0, 0.2, 0.4, 0, 0)
T_MB = pose(0.1, 0.2, 0.3, 0.3, 0.2, 0.1)
IN_JOINT = T_MJ[:3, :3] @ [1, 2, 3]

CASES = {
    "axis in the joint's frame, joint in the child's": (revolute(), {}, {"axis": IN_JOINT}),
    "axis expressed in the model": (revolute('<xyz expressed_in="__model__">1 2 3</xyz>'), {}, {"axis": [1, 2, 3]}),
    "axis expressed in a link": (revolute('<xyz expressed_in="base">1 2 3</xyz>'), {}, {"axis": T_MB[:3, :3] @ [1, 2, 3]}),
    "use_parent_model_frame": (
        revolute("<xyz>1 2 3</xyz><use_parent_model_frame>1</use_parent_model_frame>"), {"version": "1.5"}, {"axis": [1, 2, 3]},
    ),
    "version 1.4 has axes in the model": (revolute(), {"version": "1.4"}, {"axis": [1, 2, 3]}),
    "version 1.6 has axes in the joint": (revolute(), {"version": "1.6"}, {"axis": IN_JOINT}),
    "joint relative to the parent": (
        revolute(pose='<pose relative_to="base">0.1 0 0.2 0.4 0 0</pose>'), {},
        {"axis": (T_MB @ pose(0.1, 0, 0.2, 0.4, 0, 0))[:3, :3] @ [1, 2, 3], "point": (T_MB @ [0.1, 0, 0.2, 1])[:3]},
    ),
    "joint relative to a frame": (
        revolute(pose='<pose relative_to="f"/>'), {"more": '<frame name="f" attached_to="base"><pose>0 1 0 0 0 0.5</pose></frame>'},
        {"axis": (T_MB @ pose(0, 1, 0, 0, 0, 0.5))[:3, :3] @ [1, 2, 3], "point": (T_MB @ [0, 1, 0, 1])[:3]},
    ),
    "prismatic": (revolute(kind="prismatic"), {}, {"axis": IN_JOINT, "slide": True}),
    "continuous": (revolute(kind="continuous"), {}, {"axis": IN_JOINT}),
    "screw, metres a turn": (
        revolute(kind="screw", inside="<screw_thread_pitch>0.3</screw_thread_pitch>"), {},
        {"axis": IN_JOINT, "pitch": 0.3 / (2 * math.pi)},
    ),
    "screw, radians a metre the other way": (
        revolute(kind="screw", inside="<thread_pitch>20</thread_pitch>"), {"version": "1.6"}, {"axis": IN_JOINT, "pitch": -1 / 20},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_joint_moves_as_the_format_says(case):
    joint, options, wanted = CASES[case]
    robot = load_quietly(robot_of(joint, **options))
    assert robot.joint_names == ("j",)
    for q in (0.0, 0.7, -1.1):
        T = robot.forward_kinematics([q], "arm")
        np.testing.assert_allclose(T, expected(q, **{"point": T_MJ[:3, 3]} | wanted), atol=1e-13, err_msg=f"q = {q}")
    np.testing.assert_allclose(robot.forward_kinematics([0.5], "base"), pose(1, 2, 3, 0.1, 0.2, 0.3) @ T_MB, atol=1e-13)


def test_masses_and_moments_are_about_the_inertial_frame():
    robot = load_quietly(robot_of(revolute()))
    G = robot.model.link_inertias["arm"]
    T = pose(0.1, 0.02, 0.03, 0.1, 0.2, 0.3)
    I = np.array([[0.05, 0.001, 0.002], [0.001, 0.04, 0.003], [0.002, 0.003, 0.03]])
    assert (G.mass, G.com.tolist()) == (2.0, pytest.approx([0.1, 0.02, 0.03]))
    np.testing.assert_allclose(G.moment_about_com, T[:3, :3] @ I @ T[:3, :3].T, atol=1e-15)


@pytest.mark.parametrize("kind", ["universal", "revolute2"])
def test_two_axes_are_two_joints_the_first_of_which_carries_the_second(kind):
    joint = f"""<joint name="j" type="{kind}"><pose>0.1 0 0.2 0 0 0</pose><parent>base</parent><child>arm</child>
      <axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>"""
    robot = load_quietly(robot_of(joint))
    assert robot.joint_names == ("j.axis", "j.axis2")
    at = T_MA @ pose(0.1, 0, 0.2, 0, 0, 0)
    turn = tw.se3.pose(tw.so3.exp([0.3, 0, 0]) @ tw.so3.exp([0, 0.4, 0]), [0, 0, 0])
    wanted = pose(1, 2, 3, 0.1, 0.2, 0.3) @ at @ turn @ tw.se3.inverse(pose(0.1, 0, 0.2, 0, 0, 0))
    np.testing.assert_allclose(robot.forward_kinematics([0.3, 0.4], "arm"), wanted, atol=1e-13)
    assert robot.link_names == ("world", "base", "arm")


def test_a_ball_joint_turns_about_its_own_place():
    robot = load_quietly(robot_of(revolute(kind="ball")))
    q = np.array([0.9, 0.1, -0.2, 0.3])
    T0, T = (robot.forward_kinematics(x, "arm") for x in ([1, 0, 0, 0], q))
    np.testing.assert_allclose(T @ [0.1, 0, 0.2, 1], T0 @ [0.1, 0, 0.2, 1], atol=1e-14)
    assert robot.nv == 3
    turn = 2 * np.arctan2(np.linalg.norm(q[1:]), q[0]) * q[1:] / np.linalg.norm(q[1:])
    np.testing.assert_allclose(T[:3, :3], T0[:3, :3] @ tw.so3.exp(turn), atol=1e-14)


def test_limits_losses_springs_and_followers():
    axis = """<xyz>0 0 1</xyz><limit><lower>-1e16</lower><upper>2</upper><effort>-1</effort><velocity>3</velocity></limit>
      <dynamics><damping>0.4</damping><friction>0.5</friction><spring_stiffness>6</spring_stiffness>
      <spring_reference>0.7</spring_reference></dynamics>"""
    more = (
        link("hand", "1 0 0 0 0 0")
        + """<joint name="k" type="revolute"><parent>arm</parent><child>hand</child><axis><xyz>1 0 0</xyz>
      <mimic joint="j"><multiplier>2</multiplier><offset>0.1</offset><reference>0.3</reference></mimic></axis></joint>"""
    )
    text = robot_of(revolute(axis), more=more)
    robot = load_quietly(text, mimic="independent")
    limits = robot.limits
    assert (limits.lower[0], limits.upper[0], limits.velocity[0], limits.effort[0]) == (-np.inf, 2.0, 3.0, np.inf)
    assert (robot.model.friction.viscous[0], robot.model.friction.coulomb[0]) == (0.4, 0.5)
    springs = robot.holding_torques([1.0, 0.0]) - robot.gravity_forces([1.0, 0.0])
    np.testing.assert_allclose(springs, [6 * 0.3, 0.0], atol=1e-13)
    (follower,) = (b for b in load_quietly(text).model.bodies if b.follows)
    assert (follower.ratio, follower.offset) == (2.0, pytest.approx(0.1 - 2 * 0.3))


def test_what_a_link_does_not_say_weighs_a_kilogram_and_is_warned_of():
    text = """<sdf version="1.7"><model name="m"><link name="base"/><link name="arm"/><joint name="j" type="revolute">
      <parent>base</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""
    with pytest.warns(tw.ModelWarning, match="no mass, which means 1 kg and no inertia"):
        robot = tw.load(text)
    assert robot.mass_matrix([0.0]).tolist() == [[1.0]]


def test_floating_base_lets_what_nothing_holds_float():
    fixed, floating = load_quietly(robot_of(revolute())), load_quietly(robot_of(revolute()), floating_base=True)
    assert any("a floating base lets it float" in text for text in fixed.defects)
    assert floating.joint_names == ("root_joint", "j")
    static = robot_of(revolute()).replace('<model name="m">', '<model name="m"><static>true</static>')
    assert load_quietly(static, floating_base=True).joint_names == ("j",)
    to_world = robot_of(
        revolute(), more='<joint name="w" type="fixed"><parent>world</parent><child>base</child></joint>'
    )
    assert load_quietly(to_world, floating_base=True).joint_names == ("j",)


def test_nested_models_and_frames_are_reached_by_their_names():
    inner = f"""<model name="in"><pose>0 0 1 0 0 0.5</pose>{link("hand", "0.1 0 0 0 0 0")}
      <frame name="f"><pose>1 0 0 0 0 0</pose></frame></model>
      <joint name="k" type="fixed"><parent>arm</parent><child>in::hand</child></joint>
      <frame name="g" attached_to="in::hand"><pose>0 2 0 0 0 0</pose></frame>"""
    robot = load_quietly(robot_of(revolute(), more=inner))
    assert robot.link_names == ("world", "base", "arm", "in::hand")
    T = pose(1, 2, 3, 0.1, 0.2, 0.3) @ pose(0, 0, 1, 0, 0, 0.5)
    np.testing.assert_allclose(robot.forward_kinematics([0.0], "in::hand"), T @ pose(0.1, 0, 0, 0, 0, 0), atol=1e-13)
    np.testing.assert_allclose(robot.forward_kinematics([0.0], "in::f"), T @ pose(1, 0, 0, 0, 0, 0), atol=1e-13)
    np.testing.assert_allclose(robot.forward_kinematics([0.0], "g"), T @ pose(0.1, 2, 0, 0, 0, 0), atol=1e-13)


def test_a_world_of_several_models_is_asked_which():
    models = "".join(f'<model name="{n}">{link("l")}</model>' for n in "ab")
    text = f'<sdf version="1.7"><world name="w"><gravity>0 0 -1</gravity>{models}</world></sdf>'
    with pytest.raises(tw.RobotFileError, match=r"'a', 'b'\. Say which"):
        load_quietly(text)
    assert load_quietly(text, model="b").name == "b"
    assert load_quietly(text, model="b").gravity.tolist() == [0, 0, -1]
    with pytest.raises(tw.UnknownNameError, match="'c'"):
        load_quietly(text, model="c")
    assert load_quietly(text.replace('name="a">', 'name="a"><static>1</static>')).name == "b"


BAD = {
    "gearbox": (revolute(kind="gearbox"), ["<joint name='j'> (line 5)", "gearbox"]),
    "unknown type": (revolute(kind="rubber"), ["line 5", "'rubber'", "revolute"]),
    "no axis": (revolute("<xyz>0 0 0</xyz>"), ["line 5", "zero"]),
    "unknown link": (revolute().replace("<parent>base", "<parent>bass"), ["line 5", "'bass'", "'base'"]),
    "pose of too few numbers": (revolute(pose="<pose>1 2 3</pose>"), ["line 5", 'text "1 2 3": 3 numbers, expected 6']),
    "no number": (revolute(pose="<pose>1 2 3 x 0 0</pose>"), ["line 5", "has the text \"1 2 3 x 0 0\": 'x'"]),
    "an empty number": (
        revolute("<xyz>0 0 1</xyz><limit><lower></lower></limit>"),
        ["<lower> of joint 'j' (line 5) is empty", "leave the element out"],
    ),
    "nan": (revolute("<xyz>0 0 1</xyz><limit><lower>nan</lower></limit>"), ["'nan'", "leave the element out"]),
    "a loop of frames": (
        revolute() + '<frame name="f"><pose relative_to="g"/></frame><frame name="g"><pose relative_to="f"/></frame>',
        ["relative to each other"],
    ),
    "two of a name": (revolute() + link("arm"), ["line 5", "'arm'"]),
    "a loop": (revolute() + revolute().replace('"j"', '"k"'), ["two parents", "line"]),
    "include": ("<include><uri>model://x</uri></include>", ["<include>", "line", "not read"]),
    "drake's joints": ('<drake:joint name="p" type="planar"/>', ["<drake:joint name='p'>", "line"]),
    "a link called world": (revolute() + link("world"), ["line", "world"]),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused_is_named_with_its_line(case):
    text, words = BAD[case]
    with pytest.raises(tw.ModelError) as caught:
        load_quietly(robot_of(text))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "text", ["<sdf/>", '<sdf version="x"/>', '<sdf version="1.7"/>', '<sdf version="1.7"><model/></sdf>']
)
def test_empty_files_are_refused(text):
    with pytest.raises(tw.RobotFileError, match="line 1"):
        load_quietly(text)


@pytest.mark.parametrize("name", FILES or NONE)
def test_a_file_loads_or_is_refused_with_its_line(name):
    if name in REFUSED:
        with pytest.raises(tw.RobotFileError) as caught:
            load_quietly(FOLDER / name)
        assert REFUSED[name] in str(caught.value)
    else:
        assert load_quietly(FOLDER / name).link_names[0] == "world"


@pytest.mark.parametrize("name", [n for n in FILES if n not in REFUSED] or NONE)
def test_a_file_means_what_drake_means(name):
    pytest.importorskip("pydrake", reason="Drake is not installed", exc_type=ImportError)
    plant, _ = drake_plant(FOLDER / name)
    assert differences(load_quietly(FOLDER / name, snap=0, mimic="independent", inertia="accept"), plant) == []


@pytest.mark.parametrize("case", CASES)
def test_a_joint_moves_as_in_drake(case):
    pytest.importorskip("pydrake", reason="Drake is not installed", exc_type=ImportError)
    joint, options, _ = CASES[case]
    if options.get("version") == "1.4":
        pytest.skip("Drake reads no files that old as they were meant")
    text = robot_of(joint, **options)
    plant, _ = drake_plant(text)
    assert differences(load_quietly(text, snap=0), plant) == []


def test_every_command_says_how_to_choose_a_model_and_takes_it(tmp_path):
    part = '<model name="{0}"><link name="l"><inertial><mass>1</mass></inertial></link><joint name="{0}_hinge" type="revolute"><parent>world</parent><child>l</child><axis><xyz>0 1 0</xyz></axis></joint></model>'
    path = tmp_path / "two.sdf"
    path.write_text(f'<sdf version="1.8"><world name="w">{part.format("a")}{part.format("b")}</world></sdf>')
    for command in (["info"], ["payload"], ["verify"], ["convert"]):
        more = [str(tmp_path / "out.urdf")] if command == ["convert"] else []
        done = CliRunner().invoke(main, [*command, str(path), *more])
        assert done.exit_code == 2 and "Say which, --model" in done.stderr
    assert "b_hinge" in CliRunner().invoke(main, ["info", str(path), "--model", "b"]).stdout
    done = CliRunner().invoke(main, ["info", "ur5", "--keep", "base_link"])
    assert done.exit_code == 2 and "--keep base_link is of MJCF files" in done.stderr
