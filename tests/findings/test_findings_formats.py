"""URDF, SDF and USD as other programs write them: what is read is right, what is left out is remarked, nothing is lost."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import twistwrench as tw

TURN = 'rpy="1.5707963267948966 0 0"'
SAME_TURN = 'quat_xyzw="0.7071067811865476 0 0 0.7071067811865476"'


def one_joint(inertial: str = "", placement: str = "", joint: str = "", link: str = "", rest: str = "") -> str:
    """A URDF of one revolute joint, with what is given put into its elements."""
    return f"""<robot name="a" version="1.1">
<link name="base"/>
<link name="l"><inertial><origin xyz="0.3 0 0" {inertial}/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial>{link}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/><origin xyz="0 0 1" {placement}/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="5" velocity="1"/>{joint}</joint>{rest}</robot>"""


def quiet(text: str, **options: object) -> tw.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(text, **options)  # type: ignore[arg-type]


def numbers(robot: tw.Robot) -> np.ndarray:
    """Torque in a state where mass, gravity and Coriolis terms all act."""
    n = robot.nv
    return robot.inverse_dynamics(np.full(n, 0.4), np.full(n, 1.5), np.full(n, -0.7))


@pytest.mark.parametrize("where", ["inertial", "placement"])
def test_finding_01_a_quaternion_of_urdf_1_1_is_the_equal_rpy(where):
    pinocchio = pytest.importorskip("pinocchio", exc_type=ImportError)
    asked, expected = (one_joint(**{where: turn}) for turn in (SAME_TURN, TURN))
    robot = quiet(asked)
    np.testing.assert_allclose(numbers(robot), numbers(quiet(expected)), rtol=1e-14)
    model = pinocchio.buildModelFromXML(asked)
    tau = pinocchio.rnea(model, model.createData(), np.array([0.4]), np.array([1.5]), np.array([-0.7]))
    np.testing.assert_allclose(numbers(robot), tau, rtol=1e-12)
    assert robot.defects == ()


def test_finding_01_both_rotations_and_a_length_that_is_not_one_are_errors():
    with pytest.raises(tw.RobotFileError, match=r"<origin> of link 'l' \(line 3\) has both rpy and quat_xyzw"):
        tw.load(one_joint(inertial=f"{TURN} {SAME_TURN}"))
    with pytest.raises(tw.RobotFileError, match=r"length 1\.01"):
        tw.load(one_joint(placement='quat_xyzw="0 0 0 1.01"'))
    rounded = one_joint(inertial='quat_xyzw="0.7071 0 0 0.7071"')  # four decimals: the length is divided out
    np.testing.assert_allclose(numbers(quiet(rounded)), numbers(quiet(one_joint(inertial=TURN))), rtol=1e-14)


def remark(robot: tw.Robot, name: str) -> str:
    """The one remark that names something."""
    (found,) = [text for text in robot.defects if name in text]
    return found


def test_finding_02_elements_and_attributes_of_urdf_that_are_not_read_are_named():
    rest = '<jiont name="x"/>\n<jiont/><transmision/><constraint type="ball"/><inertial/><controller:thing/>'
    robot = quiet(one_joint(rest=rest, placement='foo="1"', joint="<dynamics dampign='3'/>"))
    assert remark(robot, "jiont") == "line 6 and 1 more: <jiont> is not an element of URDF; did you mean <joint>?"
    assert "line 7: <transmision> is not an element of URDF; did you mean <transmission>?" in robot.defects
    assert remark(robot, "foo") == "line 5: foo is not an attribute of <origin> in URDF"
    assert remark(robot, "dampign").endswith("did you mean damping?")
    assert "a loop stays open" in remark(robot, "<constraint>")
    assert "it belongs into <link>" in remark(robot, "<inertial>")
    assert len(robot.defects) == 6
    np.testing.assert_array_equal(numbers(robot), numbers(quiet(one_joint())))


@pytest.mark.parametrize(
    ("said", "remarked"),
    [
        ("<turnGravityOff>true</turnGravityOff>", "gravity does not act"),
        ("<turnGravityOff>false</turnGravityOff>", ""),
        ("<gravity>0</gravity>", "gravity does not act"),
        ("<gravity>true</gravity>", ""),
        ('<springStiffness value="20"/><springReference value="0.1"/>', "torque of the spring"),
        ("<springStiffness>0.0</springStiffness><implicitSpringDamper>1</implicitSpringDamper>", ""),
        ("<velocity_decay><linear>0</linear><angular>0.1</angular></velocity_decay>", "drag"),
        ("<mu1>0.2</mu1><anything>3</anything><sensor name='s'><pose>0</pose></sensor>", ""),
    ],
)
def test_finding_02_mechanics_in_extensions_of_gazebo_is_remarked_and_the_rest_is_not(said, remarked):
    defects = quiet(one_joint(rest=f'<gazebo reference="l">{said}</gazebo>')).defects
    assert len(defects) == bool(remarked)
    assert remarked in "".join(defects)


def sdf(link: str = "", inertial: str = "", rest: str = "") -> str:
    """An SDF of one joint, with what is given put into its elements."""
    return f"""<sdf version="1.9"><model name="a"><link name="base"/>
<link name="l"><inertial><pose>0.3 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.25</izz></inertia>
{inertial}</inertial>{link}</link>
<joint name="j" type="revolute"><parent>base</parent><child>l</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="fix" type="fixed"><parent>world</parent><child>base</child></joint>{rest}</model></sdf>"""


@pytest.mark.parametrize(
    ("parts", "remarked"),
    [
        ({"inertial": "<fluid_added_mass><xx>3</xx></fluid_added_mass>"}, "<fluid_added_mass> of link 'l'"),
        ({"inertial": "<fluid_added_mass><xx>0</xx></fluid_added_mass>"}, ""),
        ({"link": "<velocity_decay><linear>0.1</linear></velocity_decay>"}, "<velocity_decay> of link 'l'"),
        ({"link": "<velocity_decay><linear>0</linear></velocity_decay>"}, ""),
        ({"link": "<kinematic>true</kinematic>"}, "<kinematic> of link 'l'"),
        ({"link": "<gravity>false</gravity>"}, "<gravity> of link 'l'"),
        ({"link": "<enable_wind>true</enable_wind>"}, "<enable_wind> of link 'l'"),
        ({"link": "<kinematik>true</kinematik>"}, "<kinematik> is not an element of SDF; did you mean <kinematic>?"),
        ({"rest": "<self_collide>true</self_collide><plugin name='p' filename='f'><a>1</a></plugin>"}, ""),
    ],
)
def test_finding_10_elements_of_sdf_with_mechanics_are_remarked(parts, remarked):
    whole, robot = quiet(sdf()), quiet(sdf(**parts))
    new = [text for text in robot.defects if text not in whole.defects]
    assert len(new) == bool(remarked)
    assert remarked in "".join(new)
    np.testing.assert_array_equal(numbers(robot), numbers(whole))
