"""Robot files and their inertias.

Pages: [Check and repair a robot file](doctor.md), [one rigid body](one-body.md).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw

LINK = """<robot name="part"><link name="base"/><link name="part"><visual><geometry><box size="0.2 0.1 0.1"/></geometry></visual>
<inertial><mass value="2"/><inertia {}/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="part"/><axis xyz="0 0 1"/></joint></robot>"""
"""A box of 2 kg on a hinge, with its tensor to fill in; a solid box has 3.333e-3, 8.333e-3, 8.333e-3 kg m²."""

NOT_YET = {
    "Do the rows of this tensor stand in the slots of others?": (
        "robot_descriptions.py#29",
        "a slip of the doctor: equal iyy and ixy, digit for digit",
    ),
}
"""Questions without an answer: source, and the capability that they need."""


def test_what_is_wrong_with_a_tensor():
    """What is wrong with this inertia tensor?

    `twistwrench doctor ROBOT` lists impossible tensors with the condition that they violate, and the slip that explains them, if there is
    one.

    Source: robot_descriptions.py#29, its first half.
    Number: the triangle inequality, 0.009 > 0.001 + 0.001 by 0.007 kg m².
    """
    report = tw.doctor(LINK.format('ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.009"'))
    print(report.findings[0])
    assert "by 0.007" in str(report.findings[0])


def test_which_number_is_invalid():
    """My simulator reports an invalid inertia. Which number is wrong?

    `twistwrench doctor ROBOT` names it and proposes the repair; `--out` writes the file.

    Source: ros_gz#155.
    Number: 3.333e-3 kg m² of a solid box, of which the file has ten times as much.
    """
    report = tw.doctor(LINK.format('ixx="0.03333333" ixy="0" ixz="0" iyy="0.00833333" iyz="0" izz="0.00833333"'))
    print(report.findings[0].repair.sentence)
    assert "10 times too large" in report.findings[0].repair.sentence


def test_is_my_tensor_possible():
    """Is my new inertia tensor physically possible?

    `SpatialInertia.defects()` lists what is impossible, and `repair()` returns the nearest possible one.

    Source: UR_ROS2_Description#256.
    Number: 3 > 1 + 1 violates the triangle inequality by 1 kg m².
    """
    tensor = tw.SpatialInertia.from_com(2.0, moment_about_com=np.diag([1.0, 1.0, 3.0]))
    print(*tensor.defects(), tw.SpatialInertia.box((0.2, 0.1, 0.1), mass=2.0).defects())
    assert len(tensor.defects()) == 1
    assert "by 1" in str(tensor.defects()[0])


def test_mass_and_centre_by_hand():
    """How do I put a corrected mass, centre of mass and tensor into my robot file?

    Write the `<inertial>` element, whose tensor is about the centre of mass along the axes of its origin, and let the doctor judge it.

    Source: solidworks_urdf_exporter#164, solidworks_urdf_exporter#172.
    Number: m (a² + b²)/12 of a solid box.
    """
    box = tw.SpatialInertia.box((0.2, 0.1, 0.1), mass=2.0)
    (ixx, ixy, ixz), (_, iyy, iyz), (*_, izz) = box.moment_about_com
    inertia = f'ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"'
    print(inertia, tw.doctor(LINK.format(inertia)).headline, sep="\\n")
    assert np.diag(box.moment_about_com) == approx([2 * 0.02 / 12, 2 * 0.05 / 12, 2 * 0.05 / 12])


def test_joint_without_inertia():
    """Why does my simulation explode at one joint?

    Its inertia is tiny there. The diagonal of M⁻¹ shows it: the acceleration of each joint for 1 N m, with all other joints free.

    Source: icub-models#121.
    Number: the moment of 1e-9 kg m² about the joint in the file.
    """
    inertia = 'ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"'
    part = tw.load(LINK.format(inertia).replace('value="2"', 'value="0.001"'))
    arm = tw.robots.planar_2r().attach(part, "tip", prefix="part_")
    felt = 1 / np.diag(np.linalg.inv(arm.mass_matrix(np.zeros(3))))
    print(*arm.joint_names, felt.round(10))
    assert felt[2] == approx(1e-9, rel=1e-3)


def test_screws_of_a_file():
    """How do I get M, Slist, Blist, Mlist and Glist of a URDF file?

    `robot.screws` has them all.

    Source: ModernRobotics#42, ModernRobotics#49.
    Number: the pose of the tip by the product of exponentials of the book's package.
    """
    from twistwrench import modern_robotics as mr

    ur5 = tw.robots.ur5()
    q = np.array([0.1, -1.0, 1.2, 0.3, 0.7, 0.2])
    lists = ur5.screws
    print(lists.Slist.round(3))
    assert mr.FKinSpace(lists.M, lists.Slist, q) == approx(ur5.forward_kinematics(q), abs=1e-12)
