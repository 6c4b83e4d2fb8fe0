"""xacro files: expanded with the extra, without ROS, by their ending or on request; what is wrong with them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.formats.xacro import xacro_arguments
from twistwrench.shapes.visuals import read_visuals

pytest_plugins = ("torque_fixtures",)

ARM = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="parts/rod.xacro"/>
<xacro:arg name="mass" default="2"/>
<link name="base"/>
<xacro:rod name="rod" mass="$(arg mass)"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="${-pi/2}" upper="1" effort="50" velocity="2"/></joint>
<xacro:if value="$(arg hand)"><link name="hand"/><joint name="mount" type="fixed"><parent link="rod"/><child link="hand"/></joint></xacro:if>
</robot>
"""
ROD = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="hand" default="false"/>
<xacro:macro name="rod" params="name mass"><link name="${name}"><inertial><origin xyz="0.3 0 0"/><mass value="${mass}"/>
<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link></xacro:macro></robot>
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A file in a package, which includes another one by a relative path."""
    folder = tmp_path / "arm_description"
    (folder / "urdf" / "parts").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>arm_description</name></package>")
    (folder / "urdf" / "parts" / "rod.xacro").write_text(ROD)
    (folder / "urdf" / "arm.urdf.xacro").write_text(ARM)
    return folder / "urdf" / "arm.urdf.xacro"


@pytest.fixture
def with_extra() -> None:
    pytest.importorskip("xacrodoc", reason="the extra xacro is not installed")


@pytest.mark.usefixtures("with_extra")
class TestWithExtra:
    def test_a_file_is_expanded_with_its_arguments(self, arm):
        plain = tw.load(arm)
        assert plain.frame_names == ("base", "rod") and plain.model.moving_mass == 2.0
        np.testing.assert_allclose(plain.limits.lower, [-np.pi / 2])
        given = tw.load(arm, xacro={"hand": True, "mass": 3})
        assert given.frame_names == ("base", "rod", "hand") and given.model.moving_mass == 3.0
        assert tw.load(str(arm), xacro={"hand": "false"}).frame_names == plain.frame_names

    def test_files_of_its_package_are_included_however_its_path_is_written(self, arm, monkeypatch):
        package = arm.parents[1]
        (arm.parent / "parts" / "rod.xacro").rename(package / "rod.xacro")
        arm.write_text(ARM.replace("parts/rod.xacro", "../rod.xacro"))
        for folder in (package.parent, package, arm.parent):
            monkeypatch.chdir(folder)
            assert tw.load(arm.relative_to(folder)).frame_names == ("base", "rod")

    def test_a_file_of_another_ending_is_expanded_on_request_only(self, arm, run):
        other = arm.with_name("arm.urdf")
        arm.rename(other)
        with pytest.raises(tw.RobotFileError, match=r"<xacro:include>.*line 3.*xacro=True") as caught:
            tw.load(other)
        assert "\n" not in str(caught.value)
        assert run("info", other)[0] == 2
        before = tw.load(other, xacro=True).gravity_forces([0.3])
        include = other.parent / "parts" / "rod.xacro"
        include.write_text(ROD.replace("${mass}", "${7 * mass}"))  # nothing of a file that includes others is kept
        for option in (True, {}):
            np.testing.assert_allclose(tw.load(other, xacro=option).gravity_forces([0.3]), 7 * before, rtol=1e-12)
        code, said = run("info", other, "--xacro")
        assert code == 0 and "mass 14 kg moving" in said, said
        assert run("doctor", other, "--xacro")[0] in (0, 1)

    def test_an_impossible_inertia_of_an_expanded_file_is_a_finding_of_the_doctor(self, arm, run):
        rod = arm.parent / "parts" / "rod.xacro"
        rod.write_text(ROD.replace('izz="0.25"', 'izz="0.5"'))  # of no distribution of mass: 0.1 + 0.2 < 0.5
        code, said = run("doctor", arm, "--only", "impossible")
        assert code == 1 and "rod" in said, said

    def test_text_is_expanded_on_request_with_files_of_include_paths(self, arm):
        text = ARM.replace("parts/", f"{arm.parent}/parts/")
        with pytest.raises(tw.RobotFileError, match=r"the text given: .*xacro=True"):
            tw.load(text)
        with pytest.raises(tw.RobotFileError, match=r"reads '.*rod\.xacro', which lies outside"):
            tw.load(text, xacro=True)
        assert tw.load(text, xacro=True, include_paths=[arm.parent]).model.moving_mass == 2.0

    def test_a_file_without_macros_may_end_in_xacro(self, tmp_path):
        (tmp_path / "ur5.xacro").write_text(tw.robots.path_of("ur5").read_text())
        assert tw.load(tmp_path / "ur5.xacro").joint_names == tw.robots.ur5().joint_names

    def test_packages_are_found_above_the_file_and_in_include_paths(self, arm, tmp_path):
        arm.write_text(ARM.replace("parts/", "$(find arm_description)/urdf/parts/"))
        assert tw.load(arm).model.moving_mass == 2.0
        alone = tmp_path / "alone.xacro"
        alone.write_text(arm.read_text())
        with pytest.raises(tw.RobotFileError, match=r"arm_description.*include_paths=… or ROS_PACKAGE_PATH"):
            tw.load(alone)
        assert tw.load(alone, include_paths=[tmp_path / "arm_description"]).model.moving_mass == 2.0
        with pytest.raises(tw.RobotFileError):  # what one file found is not kept for the next
            tw.load(alone)

    def test_an_unknown_argument_is_refused_with_those_that_are_declared(self, arm):
        with pytest.raises(tw.UnknownNameError, match=r"named 'hnd'. Did you mean 'hand'\? Known: hand, mass"):
            tw.load(arm, xacro={"hnd": "true"})

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("${-pi/2}", "${-pie/2}", ["xacro cannot expand it", "pie", "It declares the arguments hand, mass"]),
            ('name="mass" default="2"', 'name="weight" default="2"', ["xacro cannot expand it", "mass"]),
            ("parts/rod", "parts/rods", ["xacro cannot expand it", "rods.xacro"]),
            ("</robot>", "", ["arm.urdf.xacro", "line"]),
        ],
    )
    def test_a_file_that_cannot_be_expanded_is_refused(self, arm, old, new, words):
        arm.write_text(ARM.replace(old, new))
        with pytest.raises(tw.RobotFileError) as caught:
            tw.load(arm)
        assert all(word in str(caught.value) for word in words), caught.value
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("${1+}", "invalid syntax when evaluating expression '1+'"),
            ("${1/0}", "division by zero when evaluating expression '1/0'"),
            ("${dict(a=1)['b']}", "there is no 'b' when evaluating expression 'dict(a=1)['b']'"),
            ("$(find nowhere)", "Package not found: nowhere"),
            ("$(arg q)", "Undefined substitution argument q"),
            (
                "$(env HOME)",
                "it reads the environment variable 'HOME'; declare an argument, <xacro:arg>, and give its value",
            ),
            ("${[x for x in (1,)]}", r"'[x for x in (1,)]' is not allowed in an expression of a robot file"),
        ],
    )
    def test_a_reason_stands_once_and_without_names_of_classes(self, text, reason):
        robot = f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="{text}"/></robot>'
        with pytest.raises(tw.RobotFileError) as caught:
            tw.load(robot, xacro=True)
        said = str(caught.value)
        assert said.startswith(f"the text given: xacro cannot expand it: {reason}") and said.count(reason) == 1
        assert "Exception" not in said and "<class" not in said

    def test_lines_of_errors_are_said_to_be_those_of_the_expanded_text(self, arm):
        with pytest.raises(
            tw.RobotFileError, match=r"arm\.urdf\.xacro \(lines are those that xacro expands it to\).*heavy"
        ):
            tw.load(arm, xacro={"mass": "heavy"})

    def test_commands_take_arguments(self, arm, run, tmp_path):
        code, said = run("info", arm, "--xacro", "hand:=true", "--xacro", "mass:=5")
        assert code == 0 and "mass 5 kg moving" in said and "tip hand" in said, said
        code, said = run("convert", arm, tmp_path / "arm.urdf", "--xacro", "hand:=true")
        assert code == 0 and tw.load(tmp_path / "arm.urdf").tip == "hand", said
        assert run("verify", arm)[0] == 0

    @pytest.mark.parametrize("text", ["hand", ":=true", "hand=true"])
    def test_an_argument_of_another_form_is_refused(self, arm, run, text):
        code, said = run("info", arm, "--xacro", text)
        assert code == 2 and f"--xacro {text!r} is not ARG:=VALUE" in said, said

    def test_the_doctor_examines_the_robot_and_says_so(self, arm, run):
        assert tw.doctor(tw.load(arm)).findings is not None
        with pytest.raises(
            tw.RobotFileError, match=r"xacro files are not examined.*doctor\(twistwrench\.load\(path\)\)"
        ):
            tw.doctor(arm)
        code, said = run("doctor", arm, "--only", "mirror")
        assert said.startswith(("OK: ", "UNSURE: ", "LOOK AGAIN: ")), said
        assert (code, said) == run("doctor", arm, "--only", "mirror", "--xacro")
        assert "drawn from its inertia" in read_visuals(tw.load(arm).model)[1][0]


def test_without_the_extra_its_name_and_another_way_are_said(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(tw.MissingExtraError) as caught:
        tw.load(arm)
    for words in ("<xacro:include>", "line 3", "'.[xacro]'", "xacro file.xacro > robot.urdf"):
        assert words in str(caught.value)
    with pytest.raises(tw.MissingExtraError, match="it is xacro"):
        arm.write_text("<robot name='r'><link name='l'/></robot>")
        tw.load(arm)


@pytest.mark.parametrize("arguments", [3, ["hand"], {3: "x"}, {"hand": None}])
def test_arguments_are_given_by_name(arm, arguments):
    with pytest.raises(tw.ValueRangeError, match=r"give the arguments by name, as xacro=\{'hand': 'true'\}"):
        tw.load(arm, xacro=arguments)


def test_arguments_of_a_file_that_is_not_xacro_are_refused():
    with pytest.raises(tw.ValueRangeError, match="xacro=… is of xacro files, and this one is not"):
        tw.load(tw.robots.path_of("ur5"), xacro={"hand": "true"})


def test_flags_are_given_as_xacro_writes_them():
    assert xacro_arguments({"hand": True, "arms": 2, "name": "Left"}) == {"hand": "true", "arms": "2", "name": "Left"}
    assert xacro_arguments(True) == {} and xacro_arguments(False) is None
