"""URDF: every kind of bad file is refused by element, line and remedy; every oddity that the format allows is read."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import SpatialInertia, se3
from twistwrench.core.errors import (
    InertiaError,
    ModelError,
    ModelWarning,
    RobotFileError,
    TwistWrenchError,
)
from twistwrench.formats import load_model
from twistwrench.formats.xml import without_loose_declaration
from twistwrench.mechanics.model.model import Model
from twistwrench.testing import assert_close

BASE = '<link name="base"/>'
ARM = '<link name="arm"/>'
INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'


def robot(*elements: str) -> str:
    """A robot with one element a line, the first one on line 2."""
    return "\n".join(['<robot name="r">', *elements, "</robot>"])


def joint(name: str, parent: str, child: str, extra: str = "", kind: str = "continuous") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{extra}</joint>'


def link(name: str, inside: str) -> str:
    return f'<link name="{name}"><inertial>{inside}</inertial></link>'


def arm(inside: str) -> str:
    """A base and a moving arm, whose inertial element (line 3) is given."""
    return robot(BASE, link("arm", inside), joint("j", "base", "arm"))


def moving(extra: str, kind: str = "revolute") -> str:
    """A base and a moving arm, whose joint (line 4) is given."""
    return robot(BASE, ARM, joint("j", "base", "arm", extra, kind))


def load(text: str | Path, **options: object) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_model(text, **options)  # type: ignore[arg-type]


LIMIT = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
BOMB = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>\n<robot name="&b;"><link name="base"/></robot>'
OUTSIDE = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]>\n<robot name="&a;"><link name="base"/></robot>'
DTD = '<!DOCTYPE r SYSTEM "http://example.org/r.dtd">\n<robot name="r"><link name="base"/></robot>'

# What is wrong: the text, the error, and what its message says (element, line, remedy).
BAD = {
    "not XML": ("<robot", RobotFileError, ["line 1", "well-formed", "Correct"]),
    "an element left open": ('<robot name="r">\n<link name="a">\n</robot>', RobotFileError, ["line 3", "mismatched tag"]),
    "neither XML nor a path": ("solid\nmesh", RobotFileError, ["'solid", "begins with '<'"]),
    "empty": (" ", RobotFileError, ["empty", "begins with '<'"]),
    "no elements": ("<!-- nothing -->", RobotFileError, ["no element", "line 1"]),
    "another root element": ("<html/>", RobotFileError, ["<html>", "line 1", "<robot>"]),
    "no links": ('<robot name="r"/>', ModelError, ["no links", "Give"]),
    "no root": (
        robot(BASE, ARM, joint("j", "base", "arm"), joint("k", "arm", "base")),
        ModelError,
        ["no root", "cycle", "'base' → 'arm' → 'base'", "'j' (line 4)", "'k' (line 5)", "remove"],
    ),
    "two roots": (robot(BASE, ARM), ModelError, ["2 root links", "'base' (line 2)", "'arm' (line 3)", "Join"]),
    "a cycle beside the tree": (
        robot(BASE, ARM, '<link name="hand"/>', joint("j", "arm", "hand"), joint("k", "hand", "arm")),
        ModelError,
        ["'arm' → 'hand' → 'arm'", "'j' (line 5)", "'k' (line 6)", "remove"],
    ),
    "a diamond": (
        robot(BASE, ARM, '<link name="l"/>', joint("j", "base", "arm"), joint("k", "base", "l"), joint("m", "l", "arm")),
        ModelError,
        ["'arm' (line 3)", "two parents", "'j' (line 5)", "'m' (line 7)", "remove one"],
    ),
    "its own child": (robot(BASE, joint("j", "base", "base")), ModelError, ["'j' (line 3)", "'base'", "own child"]),
    "unknown parent": (
        robot(BASE, ARM, joint("j", "bsae", "arm")),
        ModelError,
        ["parent", "'j' (line 4)", "'bsae'", "Did you mean 'base'", "Known: base, arm"],
    ),
    "unknown child": (robot(BASE, ARM, joint("j", "base", "amr")), ModelError, ["child", "'j' (line 4)", "mean 'arm'"]),
    "undeclared world": (robot(BASE, joint("j", "world", "base")), ModelError, ["'j' (line 3)", '<link name="world"/>']),
    "two links of one name": (robot(BASE, ARM, ARM), ModelError, ["links", "'arm'", "line 4 and line 3", "rename"]),
    "two joints of one name": (
        robot(BASE, ARM, '<link name="l"/>', joint("j", "base", "arm"), joint("j", "base", "l")),
        ModelError,
        ["joints", "'j'", "line 6 and line 5", "rename"],
    ),
    "a link without name": (robot("<link/>"), RobotFileError, ["<link>", "line 2", 'name="…"']),
    "a joint without child": (
        robot(BASE, '<joint name="j" type="fixed"><parent link="base"/></joint>'),
        RobotFileError,
        ["'j'", "line 3", "no <child>", '<child link="arm"/>'],
    ),
    "a joint without type": (
        robot(BASE, ARM, '<joint name="j"><parent link="base"/><child link="arm"/></joint>'),
        RobotFileError,
        ["'j'", "line 4", 'type="…"'],
    ),
    "unknown joint type": (moving("", "spherical"), RobotFileError, ["'j'", "line 4", "'spherical'", "revolute, continuous"]),
    "zero axis": (moving('<axis xyz="0 0 0"/>' + LIMIT), ModelError, ["'j' (line 4)", "zero axis", "0 0 1"]),
    "reversed limits": (
        moving('<limit lower="2" upper="-1"/>'),
        ModelError,
        ["'j' (line 4)", "lower=2", "upper=-1", "Exchange"],
    ),
    "negative effort": (moving('<limit lower="-1" upper="1" effort="-5"/>'), ModelError, ["'j' (line 4)", "effort=-5", "positive"]),
    "negative velocity": (moving('<limit velocity="-5"/>'), ModelError, ["'j' (line 4)", "velocity=-5", "positive"]),
    "negative acceleration": (moving('<limit acceleration="-5"/>'), ModelError, ["'j' (line 4)", "acceleration=-5", "positive"]),
    "words for a deceleration": (
        moving('<limit acceleration="5" deceleration="hard"/>'),
        RobotFileError,
        ["<limit> of joint 'j' (line 4)", 'deceleration="hard"', "number"],
    ),
    "negative jerk": (moving('<limit jerk="-1"/>'), ModelError, ["'j' (line 4)", "jerk=-1", "positive"]),
    "a constraint of a link that is not there": (
        robot(BASE, '<constraint name="c" type="spherical"><parent link="base"/><child link="arm"/></constraint>'),
        ModelError,
        ["'c:arm' (line 3)", "link 'arm', which is not there"],
    ),
    "a constraint without a direction": (
        robot(BASE, '<constraint name="c" type="revolute"><parent link="base"/><child link="base"/><parent_axis xyz="0 0 0"/></constraint>'),
        RobotFileError,
        ["<parent_axis> of constraint 'c' (line 3)", "not a direction"],
    ),
    "no mass": (arm(INERTIA), RobotFileError, ["link 'arm'", "line 3", "no <mass>", '<mass value="1.0"/>']),
    "no mass value": (arm("<mass/>" + INERTIA), RobotFileError, ["<mass> of link 'arm'", "line 3", 'value="…"']),
    "no inertia": (arm('<mass value="1"/>'), RobotFileError, ["link 'arm'", "line 3", "no <inertia>", "ixx="]),
    "no izz": (
        arm('<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"/>'),
        RobotFileError,
        ["<inertia> of link 'arm'", "line 3", 'izz="…"'],
    ),
    "two masses": (arm('<mass value="1"/><mass value="2"/>' + INERTIA), RobotFileError, ["2 <mass>", "lines 3, 3", "Remove"]),
    "a decimal comma": (
        arm('<mass value="0,5"/>' + INERTIA),
        RobotFileError,
        ["<mass> of link 'arm' (line 3)", '"0,5"', "decimal point"],
    ),
    "a comma in an inertia": (
        arm('<mass value="1"/>' + INERTIA.replace("0.1", "0,1", 1)),
        RobotFileError,
        ["<inertia> of link 'arm' (line 3)", '"0,1"', "decimal point"],
    ),
    "a stray point": (moving('<limit lower="-1.57." upper="0"/>'), RobotFileError, ["<limit> of joint 'j' (line 4)", "-1.57.", "one decimal point"]),
    "what only Python calls a number": (arm('<mass value="1_000"/>' + INERTIA), RobotFileError, ["1_000", "not a number"]),
    "two numbers in xyz": (moving('<origin xyz="0 1"/>', "fixed"), RobotFileError, ["<origin> of joint 'j' (line 4)", "2 numbers", "expected 3"]),
    "NaN in an origin": (moving('<origin xyz="0 nan 1"/>', "fixed"), RobotFileError, ["<origin> of joint 'j' (line 4)", "'nan'", "finite"]),
    "infinity in a limit": (moving('<limit lower="-inf" upper="0"/>'), RobotFileError, ["<limit>", "line 4", "'-inf'", "leave"]),
    "a number too large": (arm('<mass value="1e999"/>' + INERTIA), RobotFileError, ["<mass>", "line 3", "'1e999'", "too large"]),
    "NaN in damping": (moving('<dynamics damping="NaN"/>'), RobotFileError, ["<dynamics> of joint 'j' (line 4)", "'NaN'"]),
    "negative mass": (arm('<mass value="-1"/>' + INERTIA), InertiaError, ["'arm' (line 3)", "negative mass", "-1 kg", "positive"]),
    "negative mass that does not move": (
        robot(link("base", '<mass value="-1"/>' + INERTIA)),
        InertiaError,
        ["'base' (line 2)", "negative mass"],
    ),
    "a triangle that does not close": (
        arm('<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2.5"/>'),
        InertiaError,
        ["'arm' (line 3)", "'j'", "triangle inequality", "2.5", "by 0.5", "inertia='repair'", "inertia='accept'"],
    ),
    "a negative moment": (
        arm('<mass value="1"/><inertia ixx="-0.5" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'),
        InertiaError,
        ["'arm' (line 3)", "negative principal moment -0.5"],
    ),
    "a mimic cycle": (
        robot(
            BASE, ARM, '<link name="l"/>',
            joint("j", "base", "arm", '<mimic joint="k"/>'), joint("k", "arm", "l", '<mimic joint="j"/>'),
        ),
        ModelError,
        ["'j' (line 5)", "mimic cycle", "'j' → 'k' → 'j'", "Remove"],
    ),
    "a mimic of itself": (moving('<mimic joint="j"/>'), ModelError, ["'j' (line 4)", "mimic cycle", "'j' → 'j'"]),
    "a mimic leader that is not there": (
        moving('<mimic joint="k"/>'),
        ModelError,
        ["leader", "'j' (line 4)", "no joint named 'k'", "mimic='independent'"],
    ),
    "a mimic of a planar joint": (
        robot(BASE, ARM, '<link name="l"/>', joint("k", "base", "arm", kind="planar"), joint("j", "arm", "l", '<mimic joint="k"/>')),
        ModelError,
        ["'j' (line 6)", "'k' (line 5)", "planar", "independent"],
    ),
    "an entity bomb": (BOMB, RobotFileError, ["entities", "refused", "DOCTYPE"]),
    "an external entity": (OUTSIDE, RobotFileError, ["entities", "refused", "DOCTYPE"]),
    "an external DTD": (DTD, RobotFileError, ["another document", "refused", "DOCTYPE"]),
    "a xacro element": (
        robot('<xacro:arm prefix="left"/>', BASE),
        RobotFileError,
        ["<xacro:arm>", "line 2", "xacro file.xacro > robot.urdf"],
    ),
    "a xacro expression": (
        robot('<link name="${prefix}base"/>'),
        RobotFileError,
        ["<link name='${prefix}base'>", "line 2", "xacro file.xacro > robot.urdf"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_by_element_line_and_remedy(case):
    text, error, says = BAD[case]
    with pytest.raises(error) as caught:
        load(text)
    for words in says:
        assert words in str(caught.value)


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_raises_nothing_but_errors_of_the_library_in_one_line(case):
    with pytest.raises(TwistWrenchError) as caught:
        load(BAD[case][0])
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, ValueError)


# ── what the format allows ──


def test_the_word_xacro_alone_is_no_xacro():
    text = (
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><!-- <xacro:arm/> ${x} --><link name="base"/></robot>'
    )
    assert list(load(text).frames) == ["base"]


def test_an_undeclared_prefix_elsewhere_is_passed_over():
    assert list(load(robot(BASE, "<gazebo><ode:friction/></gazebo>")).frames) == ["base"]


def test_what_is_not_mechanics_is_passed_over():
    visual = '<visual><geometry><mesh filename="package://no/such.dae"/></geometry><material name="m"/></visual>'
    text = robot(
        '<material name="m"/>', '<material name="m"/>',
        f'<link name="base">{visual}{visual.replace("visual", "collision")}<sensor name="s"/></link>', ARM,
        joint("j", "base", "arm", '<safety_controller k_velocity="x"/><calibration rising="x"/>' + LIMIT, "revolute"),
        '<transmission name="t"><joint name="j"/></transmission>', '<gazebo reference="arm"/>',
    )  # fmt: skip
    model = load(text)
    assert model.nv == 1
    assert [defect for defect in model.defects if "has no mass" not in defect] == []


def test_links_may_come_in_any_order_and_share_names_with_joints():
    model = load(robot(joint("arm", "base", "arm", LIMIT, "revolute"), ARM, BASE))
    assert list(model.frames) == ["arm", "base"]
    assert model.bodies[0].joint.name == "arm"
    assert model.tip == "arm"


def test_an_absent_origin_or_part_of_it_is_zero():
    for origin in ("", "<origin/>", '<origin xyz="0 0 0"/>', '<origin rpy="0 0 0"/>'):
        assert np.array_equal(load(moving(origin)).bodies[0].placement, np.eye(4))


def test_an_absent_inertial_is_a_massless_link():
    model = load(moving(LIMIT))
    assert not model.bodies[0].inertia.parameters.any()
    (remark,) = model.defects
    assert "link 'arm' (line 3) has no mass" in remark


def test_rpy_is_roll_then_pitch_then_yaw_about_fixed_axes():
    T = load(moving('<origin rpy="0.1 0.2 0.3" xyz="1 2 3"/>'), snap=0).bodies[0].placement

    def turn(axis, angle):
        c, s = np.cos(angle), np.sin(angle)
        return np.roll(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), (axis, axis), (0, 1))

    # A few roundings of numbers below 1.
    assert np.abs(T[:3, :3] - turn(2, 0.3) @ turn(1, 0.2) @ turn(0, 0.1)).max() < 1e-15
    assert T[:3, 3].tolist() == [1, 2, 3]


def test_a_rotated_inertial_frame_turns_the_tensor():
    inertial = '<origin rpy="0 0 1.57079632679" xyz="0 0 1"/><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/>'
    inertia = load(arm(inertial)).bodies[0].inertia
    assert np.array_equal(inertia.com, [0, 0, 1])
    assert np.array_equal(inertia.moment_about_com, np.diag([2, 1, 2.5]))


@pytest.mark.parametrize("axis", ["0 0 2", "0 0 1e-30", "0 0 0.9999", "0 0 1e60"])
def test_axes_of_any_length_are_normalised_exactly(axis):
    assert load(moving(f'<axis xyz="{axis}"/>')).bodies[0].joint.axes.tolist() == [[0, 0, 1, 0, 0, 0]]


def test_the_axis_is_x_when_none_is_given():
    assert load(moving("")).bodies[0].joint.axes.tolist() == [[1, 0, 0, 0, 0, 0]]


@pytest.mark.parametrize(
    "extra", ['<axis xyz="0 0 0"/>', '<axis xyz="a"/>', '<mimic joint="none"/>', '<limit lower="1" upper="0"/>']
)
def test_what_a_fixed_joint_says_about_motion_is_ignored(extra):
    model = load(moving(extra, "fixed"))
    assert model.nv == 0
    assert not model.defects


@pytest.mark.parametrize(
    ("kind", "nq", "nv"),
    [
        ("revolute", 1, 1),
        ("continuous", 1, 1),
        ("prismatic", 1, 1),
        ("floating", 7, 6),
        ("planar", 3, 3),
        ("fixed", 0, 0),
    ],
)
def test_every_joint_type_of_the_format_is_read(kind, nq, nv):
    model = load(moving("", kind))
    assert (model.nq, model.nv) == (nq, nv)


def limits_of(model: Model) -> list[float]:
    return [float(x[0]) for x in (model.limits.lower, model.limits.upper, model.limits.velocity, model.limits.effort)]


INF = np.inf


@pytest.mark.parametrize(
    ("kind", "limit", "expected", "remarks"),
    [
        ("revolute", '<limit lower="-1" upper="2" velocity="3" effort="4"/>', [-1, 2, 3, 4], []),
        ("revolute", '<limit lower="-1" upper="2"/>', [-1, 2, INF, INF], []),
        ("revolute", '<limit upper="2" velocity="3" effort="4"/>', [0, 2, 3, 4], []),
        ("revolute", "", [-INF, INF, INF, INF], ["no <limit>"]),
        ("prismatic", '<limit velocity="3" effort="4"/>', [-INF, INF, 3, 4], ["lower = upper = 0"]),
        (
            "revolute",
            '<limit lower="-1" upper="2" velocity="0" effort="0"/>',
            [-1, 2, INF, INF],
            ["velocity=0", "effort=0"],
        ),
        ("continuous", '<limit lower="0" upper="0" velocity="3" effort="4"/>', [-INF, INF, 3, 4], []),
        ("continuous", "", [-INF, INF, INF, INF], []),
    ],
)
def test_limits_mean_what_the_format_says(kind, limit, expected, remarks):
    model = load(moving(limit, kind))
    assert limits_of(model) == expected
    *defects, massless = model.defects
    assert "has no mass" in massless  # the arm of these files is a bare link
    assert len(defects) == len(remarks)
    for remark, defect in zip(remarks, defects, strict=True):
        assert remark in defect
        assert "'j' (line 4)" in defect or "name='j'> (line 4)" in defect


@pytest.mark.parametrize("version", ["", ' version="1.0"', ' version="1.2"'])
@pytest.mark.parametrize(
    ("said", "expected", "remarks"),
    [
        ('acceleration="6"', [6, 6, INF], []),
        ('deceleration="6"', [6, 6, INF], []),
        ('acceleration="6" deceleration="8" jerk="90"', [6, 8, 90], []),
        ('acceleration="0" jerk="0"', [INF, INF, INF], ["acceleration=0", "jerk=0"]),
        ('acceleration="1e16"', [INF, INF, INF], []),
    ],
)
def test_limits_of_urdf_1_2_are_read_whatever_version_is_declared(version, said, expected, remarks):
    model = load(moving(f"<limit {said}/>", "continuous").replace('name="r"', f'name="r"{version}'))
    limits = model.limits
    assert [float(x[0]) for x in (limits.acceleration, limits.deceleration, limits.jerk)] == expected
    assert [remark in defect for remark, defect in zip(remarks, model.defects, strict=False)] == [True] * len(remarks)
    assert len(model.defects) == len(remarks) + 1  # and the massless arm


FOUR_BARS = robot(
    BASE, *(link(name, '<mass value="1"/>' + INERTIA) for name in ("crank", "coupler", "rocker")),
    joint("a", "base", "crank", '<axis xyz="0 1 0"/>'),
    joint("b", "crank", "coupler", '<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>'),
    joint("c", "base", "rocker", '<origin xyz="0.4 0 0" rpy="0 0 0.3"/><axis xyz="0.29552020666133955 0.955336489125606 0"/>'),
    """<constraint name="loop" type="TYPE"><parent link="coupler"/><parent_origin xyz="0.4 0 0"/><parent_axis xyz="0 1 0"/>
    <child link="rocker"/><child_origin xyz="0 0 0.3" rpy="0 0 -0.3"/></constraint>""",
)  # fmt: skip
"""A parallelogram in the x–z plane; the rocker's frame is turned by 0.3 rad about z, and its end of the loop turned back."""


@pytest.mark.parametrize("kind", ["revolute", "revolute_joint", "spherical", "spherical_joint"])
def test_a_constraint_of_urdf_offers_the_loop_that_it_describes(kind):
    with pytest.warns(ModelWarning, match=r"robot\.close\('loop:coupler', 'loop:rocker', '.*'\) closes it"):
        open_ = tw.load(FOUR_BARS.replace("TYPE", kind))
    offered = open_.closures["loop"]
    rows = {"revolute": "wx wy vx vy vz", "spherical": "vx vy vz"}[kind.removesuffix("_joint")]
    assert (offered.frame_a, offered.frame_b, offered.rows) == ("loop:coupler", "loop:rocker", rows)
    closed = open_.close(offered.frame_a, offered.frame_b, rows, redundant="accept")  # as of all planar loops
    q = closed.consistent([0.5, -0.4, 0.4])
    assert_close(q[1:], [-q[0], q[0]], 1e-9, "opposite links of a parallelogram stay parallel")
    a, b = (np.asarray(open_.forward_kinematics(q, frame)) for frame in (offered.frame_a, offered.frame_b))
    assert_close(a[:3, 3], b[:3, 3], 1e-9, "the ends of the loop meet")
    if kind.startswith("revolute"):
        assert_close(a[:3, 2], [0, 1, 0], 1e-9, "z lies along the axis")
        assert_close(b[:3, 2], [0, 1, 0], 1e-9, "z lies along the axis")


def test_a_constraint_without_an_axis_turns_about_x_as_joints_do():
    open_ = load(FOUR_BARS.replace("TYPE", "revolute").replace('<parent_axis xyz="0 1 0"/>', ""))
    site, coupler = (
        np.asarray(tw.Robot(open_).forward_kinematics(np.zeros(3), name)) for name in ("loop:coupler", "coupler")
    )
    assert_close(coupler[:3, :3].T @ site[:3, 2], [1, 0, 0], 1e-12, "z of the loop's frame lies along x of its parent")


@pytest.mark.parametrize(("kind", "rows"), [("prismatic", "wx wy wz vx vy"), ("link", "wx wy wz vx vy vz")])
def test_a_constraint_that_cuts_a_slide_or_a_link_holds_its_rows(kind, rows):
    assert load(FOUR_BARS.replace("TYPE", kind)).closures["loop"].rows == rows


@pytest.mark.parametrize("kind", ["universal", "magnetic", ""])
def test_a_constraint_in_another_form_is_a_remark(kind):
    model = load(FOUR_BARS.replace("TYPE", kind))
    assert not model.closures
    assert [text for text in model.defects if "name='loop'> (line 9)" in text and "its loop stays open" in text]


@pytest.mark.parametrize("ratio", [2.0, -0.5])
def test_a_leader_speeds_up_no_faster_than_its_followers_may(ratio):
    text = robot(
        BASE, ARM, '<link name="l"/>',
        joint("j", "base", "arm", '<limit acceleration="6" jerk="90"/>'),
        joint("k", "arm", "l", f'<limit acceleration="4" deceleration="2"/><mimic joint="j" multiplier="{ratio}"/>'),
    )  # fmt: skip
    limits = load(text).limits
    assert limits.acceleration.tolist() == [min(6.0, 4.0 / abs(ratio))]
    assert limits.deceleration.tolist() == [min(6.0, 2.0 / abs(ratio))]
    assert limits.jerk.tolist() == [90.0]


@pytest.mark.parametrize(
    ("said", "ratio", "offset"),
    [
        ("", 1, 0),
        ('multiplier="-2" offset="0.3"', -2, 0.3),
        ('offset="0.3"', 1, 0.3),
        ('multiplier="0" offset="0.3"', 0, 0.3),
    ],
)
def test_a_mimic_joint_stands_at_multiplier_times_its_leader_plus_offset(said, ratio, offset):
    """What is left out is 1 and 0, and a multiplier of 0 is none that is left out: it holds the joint at the offset."""
    follower = joint("k", "base", "arm", f'<axis xyz="0 0 1"/><mimic joint="j" {said}/>')
    leader = joint("j", "base", "lead", '<axis xyz="0 0 1"/>')
    found = tw.Robot(load(robot(BASE, ARM, '<link name="lead"/>', leader, follower)))
    assert_close(found.forward_kinematics([0.7], "arm"), se3.exp([0, 0, ratio * 0.7 + offset, 0, 0, 0]), 1e-15)


def test_damping_and_friction_are_read():
    model = load(moving('<dynamics damping="0.5" friction="0.25"/>'))
    assert (model.friction.viscous.tolist(), model.friction.coulomb.tolist()) == ([0.5], [0.25])


def test_a_robot_without_a_name_still_loads():
    assert load("<robot><link name='base'/></robot>").name == "robot"


def test_warnings_point_at_the_line_that_loaded_the_robot():
    with pytest.warns(ModelWarning, match=r"robot 'r': .*'j'.*no <limit>") as caught:
        load_model(moving(""))
    assert caught[0].filename == __file__


# ── links without mass ──

SWING = """<robot name="bare"><link name="world"/>{links}
  <joint name="j1" type="revolute"><parent link="world"/><child link="upper"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="2"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/><origin xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="2"/></joint>
</robot>"""
MASS = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def test_moving_links_without_mass_are_named_in_one_remark():
    bare = SWING.format(links='<link name="upper"/><link name="lower"/>')
    with pytest.warns(tw.ModelWarning, match=r"link 'upper' .*, link 'lower' .* have no mass: their weight"):
        robot = tw.load(bare)
    assert len(robot.defects) == 1
    last = SWING.format(links=f'<link name="upper">{MASS}</link><link name="lower"/>')
    with pytest.warns(tw.ModelWarning, match=r"link 'lower' \(line \d+\) has no mass: its weight"):
        assert "'upper'" not in " ".join(tw.load(last).defects)
    whole = SWING.format(links=f'<link name="upper">{MASS}</link><link name="lower">{MASS}</link>')
    assert tw.load(whole).defects == ()


def test_info_names_the_links_without_mass(tmp_path):
    from click.testing import CliRunner

    from twistwrench.cli.main import main

    path = tmp_path / "bare.urdf"
    path.write_text(SWING.format(links='<link name="upper"/><link name="lower"/>'))
    output = " ".join(CliRunner().invoke(main, ["info", str(path)]).output.split())
    assert "have no mass" in output
    assert "'upper'" in output
    assert "'lower'" in output


# ── the axes of inertial frames ──


@pytest.mark.parametrize("rpy", [(0.5 * np.pi, 0, 0), (0, 0, 0.5 * np.pi), (0.3, -0.8, 1.9)])
def test_a_tensor_in_turned_axes_is_that_of_the_turned_body(rpy):
    """Four masses placed by the inertial frame: Σ m (|r|² 1 - r r') knows no rotation of tensors, transposed or not."""
    masses, local = np.array([1.0, 2.0, 3.0, 4.0]), np.random.default_rng(1).normal(size=(4, 3))
    local -= masses @ local / masses.sum()
    com = np.array([0.1, -0.4, 0.7])
    roll, pitch, yaw = rpy
    turns = (se3.exp([0, 0, yaw, 0, 0, 0]), se3.exp([0, pitch, 0, 0, 0, 0]), se3.exp([roll, 0, 0, 0, 0, 0]))
    R = (turns[0] @ turns[1] @ turns[2])[:3, :3]
    I = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, local, strict=True))
    text = f"""<robot name="four"><link name="a"/><link name="b"><inertial><origin xyz="{com[0]} {com[1]} {com[2]}"
      rpy="{roll} {pitch} {yaw}"/><mass value="10"/><inertia ixx="{I[0, 0]}" ixy="{I[0, 1]}" ixz="{I[0, 2]}"
      iyy="{I[1, 1]}" iyz="{I[1, 2]}" izz="{I[2, 2]}"/></inertial></link>
      <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""
    found = tw.load(text).model.bodies[0].inertia
    expected = SpatialInertia.from_points(masses, com + local @ R.T)
    assert_close(found.parameters, expected.parameters, 1e-9)  # right angles are snapped, others good to rounding


@pytest.mark.parametrize("quote", ['"', "'"])
def test_a_declaration_of_version_1_is_no_reason_to_refuse_a_file(quote):
    """Newer versions of expat refuse it, and older ones do not. Lines of messages stay."""
    declared = f"<?xml version={quote}1{quote} encoding={quote}utf-8{quote}?>\n"
    assert tw.load(f"{declared}{tw.robots.path_of('planar_2r').read_text('utf-8').partition('?>')[2]}").nv == 2
    with pytest.raises(tw.RobotFileError, match="line 2"):
        tw.load(declared + "<robot name='r'><link></robot>")
    blank = without_loose_declaration(declared)
    assert blank.isspace() and len(blank) == len(declared) and blank.endswith("\n")


@pytest.mark.parametrize("name", ["lower", "upper", "velocity", "effort", "acceleration", "deceleration", "jerk"])
@pytest.mark.parametrize(("size", "none"), [(1e16, True), (1.1e15, True), (0.9e15, False), (5.0, False)])
def test_a_limit_of_1e15_and_more_stands_for_none(name, size, none):
    """Files have such numbers where the format requires one; of the lower bound, it is minus that."""
    sign = -1.0 if name == "lower" else 1.0
    given = {"lower": -1.0, "upper": 1.0, "velocity": 2.0, "effort": 3.0, name: sign * size}
    text = " ".join(f'{limit}="{value!r}"' for limit, value in given.items())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        found = load_model(moving(f"<limit {text}/>")).limits
    assert getattr(found, name)[0] == sign * (np.inf if none else size)
    for other, value in given.items():
        assert other == name or getattr(found, other)[0] == value
