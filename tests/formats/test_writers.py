"""Writers: what is written and read again is the same robot, and what a format cannot say is listed."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from mujoco_models import differences as mujoco_differences
from pinocchio_models import same_torques
from quick import mostly_slow
from robot_files import FILES, NONE
from written_robots import FORMS, again, arm, differences, written

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.errors import TwistWrenchError
from twistwrench.testing import random_robot

PLAIN = ("revolute", "continuous", "prismatic", "mimic", "fixed")
SAMPLE = ("planar_3r", "ur5", "panda", "quadruped", "floating_box", "cart_pole")
QUICK = [
    name for name in FILES if name.split("/")[0] in ("beside", "tiago_description", "anymal_b_simple_description")
][::4]


def read(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        try:
            return tw.load(path, inertia="accept", snap=0, **options)
        except TwistWrenchError:
            pytest.skip("not read; with which reason is another test's business")


# ── the same robot ──


@pytest.mark.parametrize("name", SAMPLE)
@pytest.mark.parametrize("form", FORMS)
def test_bundled_robots_are_the_same_again(bundled, name, form):
    robot = bundled(name)
    without = {"urdf": (), "mjcf": ("velocity",), "sdf": ("tip",)}[form]
    assert not differences(robot, again(robot, form), without=without)


@pytest.mark.parametrize("seed", mostly_slow(range(8), 3))
@pytest.mark.parametrize("form", FORMS)
def test_random_trees_are_the_same_again(seed, form):
    robot = random_robot(seed, joints=8, floating_base=seed % 3 == 0, kinds=PLAIN)
    other = again(robot, form, gravity=robot.gravity if form == "urdf" else None)
    assert not differences(robot, other, without=() if form == "urdf" else ("tip",))


@pytest.mark.parametrize("floating_base", [False, True])
@pytest.mark.parametrize("name", QUICK or NONE)
def test_files_are_the_same_again_as_urdf(name, floating_base):
    robot = read(FILES[name], floating_base=floating_base)
    assert not differences(robot, again(robot, "urdf"), states=1)


@pytest.mark.slow
@pytest.mark.parametrize("mimic", ["follow", "independent"])
@pytest.mark.parametrize("floating_base", [False, True])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", FILES or NONE)
def test_every_file_is_the_same_again(name, form, floating_base, mimic):
    robot = read(FILES[name], floating_base=floating_base, mimic=mimic)
    without = () if form == "urdf" else ("velocity", "tip", "limits" if form == "mjcf" else "velocity")
    assert not differences(robot, again(robot, form), states=1, without=without, lost=written(robot, form)[1])


def test_writing_twice_changes_nothing_more():
    """Numbers have all their digits: a second round gives the same text."""
    for name in SAMPLE:
        first = getattr(tw.robots, name)().to_urdf()
        assert tw.load(first).to_urdf() == first


# ── as MuJoCo compiles it ──


def in_mujoco(robot):
    """(robot of the MJCF text, MuJoCo's model of it); skipped if MuJoCo has no such bodies, which the writer has to say."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)
    text, lost = written(robot, "mjcf")
    said = [one for one in lost if "MuJoCo does not compile the file" in one]
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as refusal:
        assert said and all(one.startswith("link '") for one in said), refusal
        pytest.skip("MuJoCo refuses bodies that cannot exist or have no mass")
    assert not said
    return again(robot, "mjcf", mimic="independent"), model, mujoco


@pytest.mark.parametrize("name", SAMPLE)
def test_mujoco_compiles_what_is_written(bundled, name):
    robot = bundled(name)
    ours, model, mujoco = in_mujoco(robot)
    assert not mujoco_differences(ours, model, mujoco)
    assert not differences(robot, ours, without=("velocity",))


@pytest.mark.parametrize("seed", mostly_slow(range(6), 3))
def test_mujoco_compiles_random_trees(seed):
    """Ball joints and springs too; joints that follow are two there."""
    kinds = ("revolute", "continuous", "prismatic", "fixed", "ball")
    robot = random_robot(seed, joints=7, floating_base=seed % 2 == 0, kinds=kinds)
    ours, model, mujoco = in_mujoco(robot)
    assert not mujoco_differences(ours, model, mujoco)
    assert not differences(robot, ours)


@pytest.mark.slow
@pytest.mark.parametrize("floating_base", [False, True])
@pytest.mark.parametrize("name", FILES or NONE)
def test_mujoco_compiles_every_file(name, floating_base):
    robot = read(FILES[name], floating_base=floating_base, mimic="independent")
    if robot.nv > 80:
        pytest.skip("too large for MuJoCo's dense matrix to be compared in a second")
    ours, model, mujoco = in_mujoco(robot)
    assert not mujoco_differences(ours, model, mujoco, states=1)
    _, lost = written(robot, "mjcf")
    assert not differences(robot, ours, states=1, without=("velocity", "tip", "limits"), lost=lost)


# ── as Drake reads it ──


@pytest.mark.parametrize("name", ["planar_3r", "ur5", "cart_pole", *range(4)])
def test_drake_reads_the_sdf_that_is_written(name):
    """Fixed bases: a free one floats there, and is held by the comparison."""
    pytest.importorskip("pydrake.multibody.plant", reason="Drake is not installed", exc_type=ImportError)
    from drake_models import differences as drake_differences
    from drake_models import drake_plant

    kinds = ("revolute", "continuous", "prismatic", "ball", "helical", "fixed")
    robot = random_robot(name, joints=7, kinds=kinds) if isinstance(name, int) else getattr(tw.robots, name)()
    robot = robot.with_gravity((0, 0, -9.81))
    plant, _ = drake_plant(written(robot, "sdf")[0])
    assert not drake_differences(again(robot, "sdf"), plant)


# ── what the formats cannot say ──


LOST = {
    "urdf": ("ball joint", "helical", "armature", "site 'camera'", "spring of 'hinge'", "'hinge', 'screw'", "gravity", "home", "loop"),
    "mjcf": ("helical", "limit on one side", "limit of acceleration, deceleration, jerk, which"),
    "sdf": ("armature", "limit of acceleration, deceleration, jerk, which", "'hinge', 'screw'", "home", "loop"),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_what_a_format_cannot_say_is_listed(form):
    _, lost = written(arm(), form)
    for words in LOST[form]:
        assert any(words in sentence for sentence in lost), (words, lost)
    assert not [s for s in lost if not any(w in s for w in (*LOST[form], "link 'tool'", "site 'site:tool'"))]


@pytest.mark.parametrize("side", ["friction", "link_friction"])
@pytest.mark.parametrize("form", FORMS)
def test_laws_of_friction_on_either_side_of_an_elastic_gear_are_listed(form, side):
    law = {"coulomb": "2 N m", "static": "4 N m", "stribeck": "0.1 rad/s", "load": "0.1"}
    entry = {"ratio": 50, "stiffness": "1000 N m/rad", "rotor": {"inertia": "1e-4 kg m^2", "extra": True}, side: law}
    _, lost = written(tw.robots.planar_2r().with_actuators({"actuators": {"joint1": entry}}), form)
    for words in ("static and Stribeck friction", "friction that grows with the load"):
        assert any(words in sentence and "joint1" in sentence for sentence in lost), (words, lost)


def test_mjcf_has_joints_springs_armature_keyframes_closures_and_gravity():
    robot = arm()
    other = again(robot, "mjcf")
    assert not differences(robot, other, without=("limits", "armature"))
    np.testing.assert_allclose(other.armature, robot.armature)
    np.testing.assert_allclose(other.configurations["home"], robot.configurations["home"], atol=1e-15)
    assert other.closures["loop"].rows == "vx vy vz"
    assert other.frame_names[-3:-1] == ("camera", "site:tool")


def test_followers_stand_where_they_follow_to_in_keyframes():
    """MuJoCo has a coordinate for each."""
    from twistwrench.mechanics.model.builder import ModelBuilder

    builder = ModelBuilder("pair")
    builder.add_link("base")
    for name in ("a", "b"):
        builder.add_link(name, tw.SpatialInertia.box((1, 1, 1), mass=1.0))
    builder.add_joint("j", "revolute", "base", "a")
    builder.add_joint("k", "revolute", "base", "b", mimic=("j", 2.0, 0.1))
    builder.add_configuration("up", {"j": 0.5})
    robot = tw.Robot(builder.build())
    text, _ = written(robot, "mjcf")
    assert '<sdf version="1.11">' in written(robot, "sdf")[0]  # the first that has mimics
    assert '<key name="up" qpos="0.5 1.1"/>' in text
    assert '<joint joint1="k" joint2="j" polycoef="0.1 2 0 0 0"/>' in text


def test_screws_stand_turned_and_slid_in_keyframes():
    from twistwrench.mechanics.model.builder import ModelBuilder

    builder = ModelBuilder("nut")
    builder.add_link("base")
    builder.add_link("nut", tw.SpatialInertia.box((1, 1, 1), mass=1.0))
    builder.add_joint("j", "helical", "base", "nut", axis=(0, 0, 1, 0, 0, 0.1))
    builder.add_configuration("up", {"j": 0.5})
    assert '<key name="up" qpos="0.5 0.05"/>' in written(tw.Robot(builder.build()), "mjcf")[0]


@pytest.mark.parametrize("form", ["mjcf", "sdf"])
def test_the_spring_of_a_cord_about_a_drum_pulls_as_it_did(form):
    """Half k (2 q - rest)²: the joint's own spring is four times as stiff, and rests at half of it."""
    cord = '<tendon><fixed stiffness="40" springlength="0.6"><joint joint="j" coef="2"/></fixed></tendon>'
    joint = '<joint name="j" type="hinge" axis="0 0 1"/><geom type="sphere" size="0.1" mass="2"/>'
    robot = tw.load(f"<mujoco><worldbody><body>{joint}</body></worldbody>{cord}</mujoco>")
    q = np.array([[0.0], [0.3], [1.0]])
    np.testing.assert_allclose(robot.holding_torques(q), 160.0 * (q - 0.3), atol=1e-12)
    np.testing.assert_allclose(again(robot, form).holding_torques(q), robot.holding_torques(q), atol=1e-12)


def test_sdf_has_ball_joints_screws_springs_and_gravity():
    robot = arm()
    robot = tw.Robot(robot.with_armature({"ball": 0.0}).model)
    less = again(robot, "sdf")
    spring = [s for s in robot.model.springs if len(s.terms) == 1]
    assert [(s.terms, s.stiffness, s.rest) for s in less.model.springs] == [
        (s.terms, s.stiffness, s.rest) for s in spring
    ]
    q = robot.random_configuration(0)
    np.testing.assert_allclose(less.mass_matrix(q), robot.mass_matrix(q), rtol=1e-9)
    np.testing.assert_allclose(less.gravity, robot.gravity)


def test_urdf_declares_version_1_2_if_it_has_limits_of_it_and_none_otherwise(bundled):
    """Older readers refuse files of a version they do not know."""
    text, _ = written(arm(), "urdf")
    assert '<robot name="all" version="1.2">' in text
    assert 'acceleration="6" deceleration="4" jerk="90"' in text
    again_ = again(arm(), "urdf").limits
    assert [float(x.min()) for x in (again_.acceleration, again_.deceleration, again_.jerk)] == [6.0, 4.0, 90.0]
    assert "version" not in bundled("ur5").to_urdf()[50:]


def test_a_screw_in_urdf_is_a_turn_and_a_slide_that_follows():
    robot = random_robot(3, joints=5, kinds=("helical",))
    assert not differences(robot, again(robot, "urdf", gravity=robot.gravity))


def test_a_ball_joint_in_urdf_is_three_turns():
    robot = arm()
    other = again(robot, "urdf")
    assert other.joint_names == ("ball.x", "ball.y", "ball.z", "hinge", "screw")
    np.testing.assert_allclose(
        other.forward_kinematics(np.zeros(5), "tool"), robot.forward_kinematics(robot.neutral, "tool"), atol=1e-15
    )


def test_rotors_are_written_as_armature():
    drives = {"actuators": {"joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2"}}}}
    robot = tw.robots.planar_2r().with_actuators(drives)
    text, lost = written(robot, "mjcf")
    assert any("rotor" in sentence for sentence in lost)
    np.testing.assert_allclose(tw.load(text).mass_matrix([0, 0.3]), robot.mass_matrix([0, 0.3]), rtol=1e-9)


def test_pitch_of_a_right_angle_and_near_it_keep_their_digits():
    from twistwrench.formats.urdf import rotation_of_rpy, rpy_of_rotation

    rng = np.random.default_rng(0)
    for off in (0.0, 1e-16, 1e-12, 1e-8, 1e-4, 0.3):
        for sign in (1, -1):
            R = rotation_of_rpy(np.array([rng.uniform(-3, 3), sign * (np.pi / 2 - off), rng.uniform(-3, 3)]))
            np.testing.assert_allclose(rotation_of_rpy(rpy_of_rotation(R)), R, atol=1e-15)


def test_a_robot_whose_axis_has_a_length_is_refused():
    S = np.array([[0, 0, 2.0, 0, 0, 0]]).T
    robot = tw.from_screws(np.eye(4), S, [np.eye(4), np.eye(4)], [np.eye(6)], non_unit_screws=True)
    with pytest.raises(tw.ModelError, match="length 2"):
        robot.to_urdf()


def test_the_methods_warn_of_what_they_lose():
    with pytest.warns(tw.ModelWarning, match="as URDF: joint 'joint2' has an armature"):
        tw.robots.planar_2r().with_armature({"joint2": 0.1}).to_urdf()


# ── robots of every origin ──


def dh():
    return tw.from_dh(
        {"theta": [0, 0.3, 0], "d": [0.3, 0, 0.1], "a": [0.1, 0.4, 0], "alpha": [0.5, -0.2, 1.1]},
        masses=[1, 2, 1], moments_about_com=[0.01 * np.eye(3)] * 3, tool=np.diag([-1.0, -1.0, 1.0, 1.0]),
    )  # fmt: skip


def screws():
    s = tw.robots.panda().lock({"panda_joint7": 0.3}).screws
    return tw.from_screws(s.M, s.Slist, s.Mlist, s.Glist)


def stone():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load('<robot name="stone"><link name="stone"/></robot>')


def held():
    """A floating base that was locked at a pose, with a payload on a site."""
    turned = [0.8, 0.0, 0.6, 0.0, 1.0, 2.0, 3.0]
    robot = tw.robots.quadruped().lock({"root_joint": turned, "FL_thigh_joint": 0.4})
    return robot.with_payload(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=3.0), "FR_foot")


def several_in_a_body():
    """Joints of one body, turned by the references of those behind them."""
    return tw.load("""<mujoco><compiler angle="radian"/><worldbody><body name="a" pos="0 0 1"><joint name="j" axis="0 1 0" pos="0.1 0 0"/>
      <joint name="k" axis="1 0 0" pos="0 0.2 0.1" ref="0.7"/><joint name="l" type="slide" axis="0 0.6 0.8" ref="0.3"/>
      <geom type="box" size="0.1 0.2 0.3" pos="0.1 0.2 0.3"/></body></worldbody></mujoco>""")


def unordered():
    """Siblings whose links stand in another order than their joints."""
    body = '<link name="{}"><inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    hinge = '<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/><origin xyz="0 {} 1"/><axis xyz="1 0 0"/></joint>'
    names = ("d", "c", "b", "base", "a")
    links = "".join(body.format(name, k + 1) for k, name in enumerate(names))
    pairs = (("first", "base", "a"), ("second", "a", "b"), ("third", "base", "c"), ("fourth", "base", "d"))
    return tw.load(f'<robot name="r">{links}{"".join(hinge.format(*p, k) for k, p in enumerate(pairs))}</robot>')


def loaded_site():
    text = """<mujoco><worldbody><body name="a"><joint name="j" axis="0 1 0"/><joint name="k" type="slide" pos="0 0 1"/>
      <geom size="0.1"/><site name="s" pos="0.1 0.2 0.3" euler="10 20 30"/></body></worldbody></mujoco>"""
    return tw.load(text).with_payload(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=3.0), "s")


@pytest.mark.parametrize(
    "make", [dh, screws, stone, held, several_in_a_body, unordered, loaded_site], ids=lambda make: make.__name__
)
@pytest.mark.parametrize("form", FORMS)
def test_robots_from_elsewhere_and_edited_ones_are_the_same_again(make, form):
    robot = make()
    lost = written(robot, form)[1]
    assert not differences(robot, again(robot, form), without=("tip", "velocity"), lost=lost)


def test_sites_of_the_world_hang_on_a_link_beside_it_in_sdf():
    text = """<mujoco><worldbody><site name="goal" pos="1 2 3" euler="10 20 30"/><body name="table" pos="0 1 0" euler="0 0 40">
      <geom size="1"/></body><body name="a"><joint name="j"/><geom size="0.1"/></body></worldbody></mujoco>"""
    robot = tw.load(text)
    assert not differences(robot, again(robot, "sdf"), without=("tip",))
    bare = tw.load(text.replace('<body name="table" pos="0 1 0" euler="0 0 40">\n      <geom size="1"/></body>', ""))
    assert "site 'goal' stands in the world" in written(bare, "sdf")[1][0]


@pytest.mark.parametrize("form", FORMS)
def test_names_may_have_any_character_that_xml_can_hold(form):
    from twistwrench.mechanics.model.builder import ModelBuilder

    def named(*names):
        builder = ModelBuilder(names[0])
        builder.add_link("base")
        builder.add_link(names[1], tw.SpatialInertia.box((1, 1, 1), mass=1.0))
        builder.add_joint(names[2], "revolute", "base", names[1])
        return tw.Robot(builder.build())

    robot = named('a<b>&"c"', "Gelenk 'ü' > 1", "x&y;")
    other = again(robot, form)
    assert (other.name, other.joint_names, other.link_names[-1]) == (
        robot.name,
        robot.joint_names,
        robot.link_names[-1],
    )
    with pytest.raises(tw.ModelError, match="no XML file can hold"):
        written(named("a", "b\x01", "c"), form)


@pytest.mark.parametrize("name", SAMPLE)
def test_pinocchio_reads_the_urdf_that_is_written(bundled, name):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)
    robot = bundled(name)
    same_torques(robot, pinocchio.buildModelFromXML(robot.to_urdf()), pinocchio)


# ── files ──


def test_save_tells_the_format_by_the_ending_and_lists_what_is_lost(tmp_path):
    robot = tw.robots.ur5()
    assert tw.save(robot, tmp_path / "a.urdf") == []
    lost = tw.save(robot, tmp_path / "a.xml")
    assert [sentence for sentence in lost if "velocity" in sentence] == lost
    assert len(lost) == robot.nv
    assert tw.load(tmp_path / "a.xml", format="mjcf").joint_names == robot.joint_names
    (tip,) = tw.save(robot, tmp_path / "a.sdf")  # tool0 is a frame there, and the last link is what is left
    again = tw.load(tmp_path / "a.sdf")
    assert repr(robot.tip) in tip and repr(again.tip) in tip
    assert tw.load(tmp_path / "a.sdf", tip=robot.tip).tip == robot.tip
    with pytest.raises(tw.ValueRangeError, match=r"\.urdf, \.xml"):
        tw.save(robot, tmp_path / "a.txt")


def test_save_overwrites_only_when_told_and_leaves_nothing_half_written(tmp_path):
    path = tmp_path / "a.urdf"
    path.write_text("mine")
    with pytest.raises(tw.ValueRangeError, match="overwrite=True"):
        tw.save(tw.robots.ur5(), path)
    assert path.read_text() == "mine"
    bad = tw.from_screws(
        np.eye(4), np.array([[0, 0, 2.0, 0, 0, 0]]).T, [np.eye(4)] * 2, [np.eye(6)], non_unit_screws=True
    )
    with pytest.raises(tw.ModelError):
        tw.save(bad, path, overwrite=True)
    assert path.read_text() == "mine"
    tw.save(tw.robots.ur5(), path, overwrite=True)
    assert tw.load(path).nv == 6
    assert list(tmp_path.iterdir()) == [path]


# ── the command ──


def run(*arguments):
    return CliRunner().invoke(main, list(arguments))


def test_convert_writes_says_what_is_lost_and_ends_with_1_if_strict(tmp_path):
    fine = run("convert", "ur5", str(tmp_path / "ur5.urdf"))
    assert (fine.exit_code, fine.stdout) == (0, f"DONE: wrote {tmp_path / 'ur5.urdf'}.\n")
    words = ("convert", str(tmp_path / "ur5.urdf"), str(tmp_path / "ur5.xml"), "--floating-base")
    less = run(*words)
    assert less.exit_code == 0 and run(*words, "--overwrite", "--strict").exit_code == 1
    assert less.stdout.splitlines()[1].startswith("lost: joint 'shoulder_pan_joint' has a limit of velocity")
    assert tw.load(tmp_path / "ur5.xml").nv == 12


def test_convert_overwrites_only_with_force_and_never_its_input(tmp_path):
    path = tmp_path / "ur5.urdf"
    path.write_text("mine")
    refused = run("convert", "ur5", str(path))
    assert (refused.exit_code, path.read_text()) == (2, "mine")
    assert "or --overwrite" in refused.stderr
    assert run("convert", "ur5", str(path), "--overwrite").exit_code == 0
    assert "would overwrite the file of ROBOT" in run("convert", str(path), str(path), "--overwrite").stderr


def test_convert_keeps_one_body_of_a_scene(tmp_path):
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<mujoco><worldbody><body name="cup"><freejoint/><geom size="0.1"/></body><body name="arm"><joint name="a"/>'
        '<geom size="0.1"/></body></worldbody></mujoco>'
    )
    assert run("convert", str(scene), str(tmp_path / "arm.urdf"), "--keep", "arm").exit_code == 0
    assert tw.load(tmp_path / "arm.urdf").joint_names == ("a",)
    assert "of MJCF files" in run("convert", "ur5", str(tmp_path / "b.urdf"), "--keep", "arm").stderr


@pytest.mark.slow
def test_a_chain_deeper_than_pythons_stack_is_written():
    from twistwrench.mechanics.model.builder import ModelBuilder

    builder = ModelBuilder("deep")
    builder.add_link("b0")
    for k in range(1, 1500):
        builder.add_link(f"b{k}", tw.SpatialInertia.from_com(1.0, (0, 0, 0.1), np.eye(3)))
        builder.add_joint(f"j{k}", "revolute", f"b{k - 1}", f"b{k}", axis=(0, 1, 0))
    robot = tw.Robot(builder.build())
    for form in FORMS:
        assert again(robot, form).joint_names == robot.joint_names
