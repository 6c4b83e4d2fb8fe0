"""MJCF files as files: options of load, what is refused and where, what is remarked, includes, and hostile ones."""

from __future__ import annotations

import numpy as np
import pytest
from mjcf_texts import TEXTS, arm
from quiet_loading import load_quietly

import twistwrench as tw

SCENE = """<mujoco><worldbody>
  <body name="table" pos="1 0 0"><geom size="0.5"/></body>
  <body name="mount" pos="0 0 1"><geom size="0.1"/>
    <body name="arm" pos="0 0 0.5"><joint name="a" armature="0.1"/><geom size="0.1" pos="0.2 0 0"/>
      <body name="hand" pos="0.4 0 0"><joint name="b" axis="0 1 0" stiffness="2"/><geom size="0.05" pos="0.1 0 0"/>
        <site name="grip" pos="0.2 0 0"/></body></body></body>
  <body name="cup" pos="1 0 0.6" euler="0 0 90"><freejoint name="c"/><geom size="0.04" pos="0.1 0 0"/></body>
</worldbody>
<keyframe><key name="home" qpos="0.1 0.2 1 0 0.6 1 0 0 0"/></keyframe></mujoco>"""


# ── what the robot is called, holds and floats on ──


def test_floating_base_none_is_what_the_file_says():
    robot = load_quietly(SCENE)
    assert robot.joint_names == ("a", "b", "c")
    assert robot.link_names == ("world", "table", "mount", "arm", "hand", "cup")
    assert robot.frame_names == (*robot.link_names, "grip")
    assert list(robot.configurations) == ["qpos0", "home"]
    np.testing.assert_allclose(robot.configurations["qpos0"], [0, 0, *np.sqrt([0.5, 0, 0, 0.5]), 1, 0, 0.6], atol=1e-15)
    np.testing.assert_allclose(robot.configurations["home"], [0.1, 0.2, 1, 0, 0, 0, 1, 0, 0.6])


def test_floating_base_false_holds_free_bodies_where_the_file_puts_them():
    robot, free = load_quietly(SCENE, floating_base=False), load_quietly(SCENE)
    assert robot.joint_names == ("a", "b")
    q = free.configurations["qpos0"]
    np.testing.assert_allclose(robot.forward_kinematics([0, 0], "cup"), free.forward_kinematics(q, "cup"), atol=1e-15)


def test_floating_base_true_keeps_a_free_joint_or_adds_one():
    assert load_quietly(SCENE, floating_base=True).joint_names == ("a", "b", "c")
    assert load_quietly(arm(), floating_base=True).joint_names == ("root_joint", "a", "b")


def test_keep_takes_a_body_and_what_it_carries():
    robot, whole = load_quietly(SCENE, keep="arm"), load_quietly(SCENE)
    assert (robot.joint_names, robot.link_names) == (("a", "b"), ("world", "arm", "hand"))
    q = np.array([0.3, -0.4])
    np.testing.assert_allclose(robot.mass_matrix(q), whole.mass_matrix([*q, 1, 0, 0, 0, 0, 0, 0])[:2, :2], rtol=1e-14)
    np.testing.assert_allclose(
        robot.forward_kinematics(q, "grip"), whole.forward_kinematics([*q, 1, 0, 0, 0, 0, 0, 0], "grip"), atol=1e-15
    )
    np.testing.assert_allclose(robot.configurations["home"], [0.1, 0.2])
    with pytest.raises(tw.UnknownNameError, match="'arms'"):
        load_quietly(SCENE, keep="arms")


def test_format_insists():
    assert load_quietly(arm(), format="mjcf").nv == 2
    with pytest.raises(tw.RobotFileError, match=r"MJCF \(<mujoco>, line 2\)"):
        load_quietly(arm(), format="urdf")
    with pytest.raises(tw.ValueRangeError, match="'urdf', 'mjcf'"):
        load_quietly(arm(), format="sdf1")


def test_gravity_is_the_files_unless_given():
    text = arm(head='<option gravity="0 0 -1.6"/>')
    assert load_quietly(text).gravity.tolist() == [0, 0, -1.6]
    assert load_quietly(text, gravity=(0, 0, 1)).gravity.tolist() == [0, 0, 1]


def test_without_autolimits_a_range_alone_is_no_limit():
    """MuJoCo calls it an error, so this is not compared with it."""
    text = arm(head='<compiler autolimits="false"/>', joint2='<joint name="b" range="-10 10"/>')
    assert load_quietly(text).limits.upper.tolist() == [np.inf, np.inf]


def test_edits_keep_sites_and_configurations():
    robot = load_quietly(SCENE).lock({"a": 0.3})
    whole = load_quietly(SCENE)
    q = np.array([0.2, 1, 0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(
        robot.forward_kinematics(q, "grip"), whole.forward_kinematics([0.3, *q], "grip"), atol=1e-15
    )
    np.testing.assert_allclose(robot.configurations["home"], [0.2, 1, 0, 0, 0, 1, 0, 0.6])
    loaded = whole.with_payload(tw.SpatialInertia.sphere(0.1, mass=2.0), frame="grip")
    assert loaded.mass_matrix([0, 0, *q[1:]])[0, 0] > whole.mass_matrix([0, 0, *q[1:]])[0, 0]
    q = loaded.neutral
    still = np.zeros(loaded.nv)
    np.testing.assert_allclose(loaded.explain(q, still, still).torque, loaded.gravity_forces(q), atol=1e-12)


def test_a_site_with_the_name_of_a_link_has_a_name_of_its_own():
    robot = load_quietly(TEXTS["sites"])
    assert {"lower", "site:lower", "here", "rod"} <= set(robot.frame_names)
    assert "site:lower" not in robot.link_names


def test_bodies_between_the_joints_of_one_body_are_hidden():
    robot = load_quietly(TEXTS["several joints in a body"])
    assert robot.link_names == ("world", "upper", "lower")
    assert robot.body_names == ("upper", "lower:b", "lower:c", "lower")
    assert not any("no mass" in text for text in robot.defects)


# ── what is refused, with element and line ──

BODY = "<body name='x'><joint name='j'/><geom size='0.1'/>{}</body>"
REFUSED = {
    "flexcomp": ("<flexcomp name='cloth'/>", ["<flexcomp name='cloth'> (line 4)", "from_mujoco"]),
    "composite": ("<composite/>", ["<composite>", "line 4", "from_mujoco"]),
    "replicate": ("<replicate count='3'/>", ["<replicate>", "line 4", "from_mujoco"]),
    "attach": ("<attach model='hand'/>", ["<attach>", "line 4", "from_mujoco"]),
    "unknown class": ("<geom class='soft' size='1'/>", ["'soft'", "line 4", "'main'"]),
    "unknown childclass": ("<body childclass='soft'/>", ["'soft'", "line 4", "'main'"]),
    "size": ("<geom type='box' size='1 2'/>", ["<geom>", "line 4", "1 2 0", "above zero"]),
    "too many numbers": ("<geom size='1 2 3 4'/>", ["line 4", "4 numbers", "at most 3"]),
    "not a number": ("<geom size='nan'/>", ["line 4", "finite"]),
    "no rotation": ("<body quat='0 0 0 0'/>", ["line 4", "1 0 0 0"]),
    "no axis": ("<body><joint axis='0 0 0'/></body>", ["line 4", "not a direction"]),
    "two orientations": ("<body euler='0 0 0' zaxis='1 0 0'/>", ["line 4", "zaxis, euler", "Keep one"]),
    "free inside": ("<body name='y'><freejoint/></body>", ["<freejoint>", "'y'", "does not stand in the worldbody"]),
    "two inertials": ("<inertial mass='1' pos='0 0 0'/><inertial mass='1' pos='0 0 0'/>", ["line 4", "second"]),
    "mesh without its file": ("<geom type='mesh' mesh='m'/>", ["<geom>", "line 4", "'m'", "no <asset>"]),
    "negative mass": ("<geom size='1' mass='-1'/>", ["line 4", "negative mass"]),
    "word": ("<geom type='blob' size='1'/>", ["line 4", "blob", "capsule"]),
    "two joints of a name": ("<body><joint name='j'/></body>", ["line 4", "'j'"]),
    "two bodies of a name": ("<body name='x'/>", ["line 4", "'x'"]),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_is_named_with_its_line(case):
    inner, words = REFUSED[case]
    text = "<mujoco>\n<worldbody>\n" + BODY.format("\n" + inner) + "</worldbody></mujoco>"
    with pytest.raises(tw.ModelError) as caught:
        load_quietly(text)
    assert "\n" not in str(caught.value)
    for word in ("the text given", *words):
        assert word in str(caught.value)


SECTIONS = {
    "joint of an actuator": ("<actuator><motor joint='k'/></actuator>", ["line 2", "'k'"]),
    "polynomial armature": (
        "<actuator><motor joint='j' armature='1 2'/></actuator>", ["line 2", 'armature="1 2": 2 numbers, expected at most 1'],
    ),
    "joint of a tendon": ("<tendon><fixed><joint joint='k' coef='1'/></fixed></tendon>", ["line 2", "'k'"]),
    "joint of an equality": ("<equality><joint joint1='k'/></equality>", ["line 2", "'k'"]),
    "body of an equality": ("<equality><weld body1='z'/></equality>", ["line 2", "'z'"]),
    "keyframe": ("<keyframe><key qpos='1 2'/></keyframe>", ["line 2", "2 numbers", "1 coordinates"]),
    "global": ("<compiler coordinate='global'/>", ["<compiler>", "line 2", "global"]),
    "eulerseq": ("<compiler eulerseq='xyw'/>", ["<compiler>", "line 2", "xyw"]),
    "class twice": ("<default><default class='a'/><default class='a'/></default>", ["line 2", "second"]),
    "outermost class renamed": ("<default class='a'/>", ["line 2", "'a'", "'main'"]),
    "class without name": ("<default><default/></default>", ["line 2", "class="]),
}  # fmt: skip


@pytest.mark.parametrize("case", SECTIONS)
def test_what_is_refused_of_other_sections(case):
    section, words = SECTIONS[case]
    text = "<mujoco>\n" + section + "\n<worldbody>" + BODY.format("") + "</worldbody></mujoco>"
    with pytest.raises(tw.ModelError) as caught:
        load_quietly(text)
    for word in words:
        assert word in str(caught.value)


def test_the_mass_that_boundmass_gives_is_at_the_inertial():
    """4 kg at (0.3, 0.2, 0.1) m in the body, also within a frame, beside 0.05 kg m²: 0.05 + 4 (0.3² + 0.1²) = 0.45 about y."""
    for before, pos, after in (("", "0.3 0.2 0.1", ""), ('<frame pos="0.2 0 0.1">', "0.1 0.2 0", "</frame>")):
        inertial = f'{before}<inertial pos="{pos}" mass="0" diaginertia="0.05 0.05 0.05"/>{after}'
        body = f'<body><joint axis="0 1 0"/>{inertial}</body>'
        robot = tw.load(f'<mujoco><compiler boundmass="4"/><worldbody>{body}</worldbody></mujoco>')
        assert robot.mass_matrix([0.7])[0, 0] == pytest.approx(0.45, rel=1e-12)


REMARKED = {
    "fluid": ("<option density='1.2'/>", "", "fluid"),
    "gravcomp": ("", "<body gravcomp='1'><geom size='0.1'/></body>", "gravcomp"),
    "spatial tendon": ("<tendon><spatial stiffness='2'/></tendon>", "", "spatial tendon"),
    "tendon armature": ("<tendon><fixed armature='2'><joint joint='j' coef='1'/></fixed></tendon>", "", "has an armature"),
    "slack tendon": (
        "<tendon><fixed stiffness='2' springlength='1 2'><joint joint='j' coef='1'/></fixed></tendon>", "", "slack",
    ),
    "loop": ("<equality><connect body1='x' anchor='0 0 0'/></equality>", "", "robot.close("),
    "settotalmass": ("<compiler settotalmass='3'/>", "", "settotalmass=3"),
    "boundmass": ("<compiler boundmass='300'/>", "", "boundmass=300"),
    "ball spring": ("", "<body><joint type='ball' stiffness='2'/><geom size='1'/></body>", "stiffness, which is left out"),
    "ball limit": ("", "<body><joint type='ball' range='0 20'/><geom size='1'/></body>", "limit, which is not kept"),
    "polynomial": ("", "<body><joint damping='1 2'/><geom size='1'/></body>", "polynomial"),
    "polynomial damping": ("<actuator><motor joint='j' damping='1 2'/></actuator>", "", "<motor> (line 1) has a damping that is a polynomial"),
    "unknown actuator": ("<actuator><engine joint='j'/></actuator>", "", "<engine> (line 1) is not an actuator known here"),
    "springdamper": ("", "<body><joint springdamper='1 1'/><geom size='1'/></body>", "springdamper"),
    "plugin": ("", "<body><plugin plugin='mujoco.elasticity.cable'/><geom size='1'/></body>", "plugin, whose forces"),
    "actuator on a tendon": (
        "<tendon><fixed name='t'><joint joint='j' coef='1'/></fixed></tendon><actuator><motor tendon='t' armature='1'/></actuator>",
        "", "has an armature that is left out",
    ),
    "aligned": ("<compiler alignfree='true'/>", "", "centre of mass in MuJoCo"),
    "polynomial equality": (
        "<equality><joint joint1='j' joint2='k' polycoef='0 1 2'/></equality>", "<body><joint name='k'/><geom size='1'/></body>",
        "polynomial",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REMARKED)
def test_what_is_left_out_is_said(case):
    section, inner, word = REMARKED[case]
    free = "<body><joint type='free'/><geom size='1'/></body><body><freejoint/><geom size='1'/></body>"
    text = f"<mujoco>{section}<worldbody>{BODY.format(inner)}{free}</worldbody></mujoco>"
    with pytest.warns(tw.ModelWarning):
        robot = tw.load(text)
    assert any(word in remark for remark in robot.defects)
    assert not any(
        word in remark for remark in load_quietly(f"<mujoco><worldbody>{BODY.format('')}</worldbody></mujoco>").defects
    )


# ── includes ──


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "outside.xml").write_text("<mujoco><body><geom size='1'/></body></mujoco>")
    home = tmp_path / "robot"
    (home / "parts").mkdir(parents=True)
    (home / "parts" / "arm.xml").write_text(
        "<mujocoinclude>\n<body name='in'><joint/><geom size='0.1'/><include file='parts/more.xml'/></body></mujocoinclude>"
    )
    (home / "parts" / "more.xml").write_text(
        "<mujoco><body name='deep'><joint axis='0 1 0'/><geom size='0.2'/></body></mujoco>"
    )
    (home / "parts" / "bad.xml").write_text("<mujoco>\n<body><joint axis='x'/></body></mujoco>")
    (home / "cycle.xml").write_text("<mujoco><worldbody><include file='cycle2.xml'/></worldbody></mujoco>")
    (home / "cycle2.xml").write_text("<mujoco><include file='cycle.xml'/></mujoco>")
    (home / "secret.xml").symlink_to(tmp_path / "outside.xml")
    return home


def including(folder, file):
    path = folder / "main.xml"
    path.write_text(f"<mujoco><worldbody>\n<include file='{file}'/></worldbody></mujoco>")
    return path


def test_included_files_stand_in_the_place_of_the_element(folder):
    assert load_quietly(including(folder, "parts/arm.xml")).link_names == ("world", "in", "deep")


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("../outside.xml", ["line 2", "outside", "include_paths"]),
        ("../../../../../../etc/passwd", ["line 2", "outside"]),
        ("/etc/passwd", ["line 2", "own folder"]),
        ("C:/windows/x.xml", ["line 2", "own folder"]),
        ("http://a.b/c.xml", ["line 2", "own folder"]),
        ("secret.xml", ["line 2", "outside"]),
        ("none.xml", ["line 2", "not there"]),
        ("parts", ["line 2", "not there"]),
        ("", ["line 2", "file="]),
        ("cycle.xml", ["again", "once"]),
        ("main.xml", ["again", "once"]),
        ("parts/bad.xml", ["parts/bad.xml, line 2", "'x'"]),
    ],
)
def test_includes_that_are_refused(folder, file, words):
    with pytest.raises(tw.RobotFileError) as caught:
        load_quietly(including(folder, file))
    for word in ("main.xml", *words):
        assert word in str(caught.value)


def test_other_folders_are_read_when_named(folder):
    assert load_quietly(including(folder, "../outside.xml"), include_paths=[folder.parent]).nv == 0
    with pytest.raises(tw.RobotFileError, match="has no folder"):
        load_quietly("<mujoco><include file='arm.xml'/></mujoco>")
    text = "<mujoco><worldbody><include file='outside.xml'/></worldbody></mujoco>"
    assert load_quietly(text, include_paths=[folder.parent]).link_names == ("world", "body1")


def test_meshes_are_read_below_the_folder_only_and_only_for_a_mass(folder):
    asset = "<asset><mesh name='m' file='{}'/></asset>"
    body = "<worldbody><body name='b'><joint/>{}<geom type='mesh' mesh='m'/></body></worldbody>"
    path = folder / "main.xml"
    path.write_text(
        "<mujoco>" + asset.format("gone.stl") + body.format("<inertial mass='1' pos='0 0 0'/>") + "</mujoco>"
    )
    assert load_quietly(path).nv == 1
    for file, word in (("gone.stl", "not there"), ("../../x.stl", "outside"), ("/x.stl", "own folder")):
        path.write_text("<mujoco>\n" + asset.format(file) + body.format("") + "</mujoco>")
        with pytest.raises(tw.RobotFileError, match=word) as caught:
            load_quietly(path)
        assert "<inertial>" in str(caught.value)
        assert "line 2" in str(caught.value)


# ── hostile files ──

_ONE = '<body><joint/><geom size=".1"/></body>'
HOSTILE = {
    "truncated": arm()[:300],
    "entities": '<!DOCTYPE a [<!ENTITY x "x"><!ENTITY y "&x;&x;">]><mujoco>&y;</mujoco>',
    "many bodies": f"<mujoco><worldbody>{_ONE * 100_000}</worldbody></mujoco>",
    "bodies in bodies": "<mujoco><worldbody>" + "<body>" * 100_000 + "</body>" * 100_000 + "</worldbody></mujoco>",
    "frames in frames": "<mujoco><worldbody>"
    + "<frame>" * 1_000_000
    + "</frame>" * 1_000_000
    + "</worldbody></mujoco>",
    "NaN": arm(joint2='<joint name="b" damping="nan"/>'),
    "infinity": arm(lower='pos="1e999 0 0"').replace('pos="0 0.1 0.4"', ""),
    "huge": arm(joint2='<joint name="b" range="-1e70 1"/>'),
    "include from text": "<mujoco><include file='../../etc/passwd'/></mujoco>",
    "part of a file": "<mujocoinclude/>",
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files_end_in_our_errors_at_once(case):
    with pytest.raises(tw.TwistWrenchError) as caught:
        load_quietly(HOSTILE[case])
    assert len(str(caught.value)) < 1000


def test_the_limit_of_bodies_can_be_raised():
    text = f"<mujoco><worldbody>{_ONE * 30}</worldbody></mujoco>"
    with pytest.raises(tw.RobotFileError, match="more than 20 bodies"):
        load_quietly(text, max_bodies=20)
    assert load_quietly(text, max_bodies=30).nv == 30
    said = "<!-- <body> <body> -->" * 20  # what is commented out is none
    assert load_quietly(f"<mujoco>{said}<worldbody>{_ONE * 30}</worldbody></mujoco>", max_bodies=30).nv == 30
    for wrong in (0, 2.5, True):
        with pytest.raises(tw.ValueRangeError, match="max_bodies"):
            load_quietly(text, max_bodies=wrong)


def test_a_long_chain_needs_no_deep_stack():
    text = '<body pos="0 0 .1"><joint axis="0 1 0"/><geom size=".1"/>' * 500 + "</body>" * 500
    assert load_quietly(f"<mujoco><worldbody>{text}</worldbody></mujoco>").nv == 500


def test_the_viewer_places_bodies_between_the_joints_of_one_body():
    from twistwrench.viz.page import viewer_page
    from twistwrench.viz.scene import scene_of

    robot = load_quietly(TEXTS["several joints in a body"])
    q = np.array([[0.1, 0.2, 0.3, 0.4], [0.0, 0.0, 0.0, 0.0]])
    poses = scene_of(robot).body_poses(q)
    assert np.isfinite(poses).all()
    np.testing.assert_allclose(poses[:, -1], robot.forward_kinematics(q, "lower"), atol=1e-14)
    assert "two links" in viewer_page(robot.with_payload(tw.SpatialInertia.sphere(0.1, mass=1.0), frame="lower")).page


@pytest.mark.parametrize(
    ("text", "line", "name"),
    [("<worldbdy/>", 1, "worldbody"), ("<worldbody/>\n<actuators/>", 2, "actuator")],
)
def test_sections_that_are_misspelt_are_remarked_with_their_line(text, line, name):
    (said,) = load_quietly(f"<mujoco>{text}</mujoco>").defects
    assert said.startswith(f"line {line}: ") and said.endswith(f"is not an element of MJCF; did you mean <{name}>?")


def test_bodies_of_a_misspelt_worldbody_refuse_the_file():
    with pytest.raises(tw.RobotFileError, match=r"<body.*line 1.* outside a <worldbody>"):
        tw.load("<mujoco><worldbdy><body name='a'/></worldbdy></mujoco>")


def test_flexes_and_unknown_elements_of_bodies_are_remarked():
    text = (
        "<mujoco><deformable><flex name='f'/></deformable><worldbody><body><goem size='1'/></body></worldbody></mujoco>"
    )
    flex, unknown = load_quietly(text).defects
    assert flex == "<flex name='f'> (line 1) is a deformable body, whose elastic forces are left out"
    assert unknown == "line 1: <goem> is not an element of MJCF; did you mean <geom>?"
