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
