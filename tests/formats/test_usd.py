"""USD: stages written by hand beside the same robot in URDF, and what is refused with the path of the prim."""

from __future__ import annotations

import math
import re
import warnings

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.mechanics.lie import quaternion
from twistwrench.testing import random_state
from twistwrench.testing.verify import verify

pytest.importorskip("pxr", reason="usd-core is not installed")

SINGLE = 3e-6
"""Numbers of the schema have single precision, 6e-8 of each, and errors of poses add up along the chain."""


@pytest.fixture
def stage(tmp_path):
    """Loads the text of a stage."""

    def load(body, head='metersPerUnit = 1 upAxis = "Z"', name="robot.usda", **options):
        path = tmp_path / name
        path.write_text(
            f'#usda 1.0\n(\n defaultPrim = "arm"\n {head.replace(" upAxis", chr(10) + " upAxis")}\n)\n{body}'
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", tw.ModelWarning)
            return tw.load(path, **options)

    return load


def figures(values):
    return "(" + ", ".join(f"{float(x):.9g}" for x in np.ravel(values)) + ")"


def of_rpy(rpy):
    from twistwrench.formats.urdf import rotation_of_rpy

    return rotation_of_rpy(rpy)


LINKS = {  # mass, com, principal moments, their rpy; and where the stage has the body, which joints do not go by
    "upper": (2.0, (0.1, -0.02, 0.2), (0.05, 0.04, 0.03), (0.3, -0.2, 0.5), (0.3, 0.1, 1.0)),
    "lower": (1.5, (0.0, 0.03, 0.25), (0.03, 0.02, 0.04), (0.0, 0.4, 0.0), (0.5, 0.2, 1.5)),
    "hand": (0.5, (0.02, 0.0, 0.05), (0.002, 0.001, 0.0015), (0.0, 0.0, 0.0), (0.6, 0.2, 1.9)),
}
JOINTS = {  # type, parent, child, frame in the parent (xyz, rpy), frame in the child (xyz, rpy), axis, limits in degrees or metres
    "base": ("fixed", "world", "upper", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (0, 0, 0), (0, 0, 0), "X", None),
    "elbow": ("revolute", "upper", "lower", (0.0, 0.1, 0.5), (0.3, 0.1, -0.2), (0.02, 0.03, -0.1), (0.1, 0.0, 0.4), "Z", (-90, 120)),
    "slide": ("prismatic", "lower", "hand", (0.0, 0.0, 0.4), (0.0, 0.5, 0.0), (0.01, 0.0, 0.0), (0.2, 0.0, 0.0), "Y", (-0.1, 0.3)),
}  # fmt: skip


def usd_text(
    metre=1.0,
    kilogram=1.0,
    scale=1.0,
    swap=(),
    root="arm",
    drop="",
    links=LINKS,
    joints=JOINTS,
    more="",
    armature="physxJoint:armature",
):
    """The robot in units of so many metres and kilograms, bodies scaled, the sides of some joints exchanged."""
    lines = [
        f'def Xform "arm" {"(prepend apiSchemas = [" + chr(34) + "PhysicsArticulationRootAPI" + chr(34) + "])" if root == "arm" else ""}',
        "{",
    ]
    for name, (mass, com, moments, rpy, at) in links.items():
        Q = quaternion.from_matrix(of_rpy(rpy))
        said = {
            "mass": f"float physics:mass = {mass / kilogram:.9g}",
            "com": f"point3f physics:centerOfMass = {figures(np.divide(com, metre * scale))}",
            "moments": f"float3 physics:diagonalInertia = {figures(np.divide(moments, kilogram * metre**2))}",
            "axes": f"quatf physics:principalAxes = {figures(Q)}",
        }
        said.pop(drop, None)
        lines += [
            f'def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])', "{",
            f"double3 xformOp:translate = {figures(np.divide(at, metre))}", f"double3 xformOp:scale = {figures([scale] * 3)}",
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]', *said.values(), "}",
        ]  # fmt: skip
    for name, (kind, parent, child, p0, rpy0, p1, rpy1, axis, limits) in joints.items():
        ends = [(parent, p0, rpy0), (child, p1, rpy1)]
        if name in swap:
            ends.reverse()
        word = {"ball": "Spherical", "D6": ""}.get(kind, kind.capitalize())
        apis = '(prepend apiSchemas = ["PhysicsDriveAPI:angular"])' if kind == "revolute" else ""
        lines += [f'def Physics{word}Joint "{name}" {apis}', "{"]
        for k, (body, p, rpy) in enumerate(ends):
            unit = metre * (1.0 if body == "world" else scale)
            lines += [f"rel physics:body{k} = </arm/{body}>"] if body != "world" else []
            lines += [f"point3f physics:localPos{k} = {figures(np.divide(p, unit))}"]
            lines += [f"quatf physics:localRot{k} = {figures(quaternion.from_matrix(of_rpy(rpy)))}"]
        if kind in ("revolute", "prismatic"):
            lower, upper = (x / (1.0 if kind == "revolute" else metre) for x in limits)
            lines += [
                f'uniform token physics:axis = "{axis}"',
                f"float physics:lowerLimit = {lower}",
                f"float physics:upperLimit = {upper}",
            ]
        if kind == "revolute":
            lines += [f"float drive:angular:physics:maxForce = {40.0 / (kilogram * metre**2):.9g}"]
            lines += [
                "float physxJoint:maxJointVelocity = 180",
                f"float {armature} = {0.1 / (kilogram * metre**2):.9g}",
                f"float newton:damping = {0.6 * math.pi / 180.0 / (kilogram * metre**2):.9g}",
            ]
        if kind == "prismatic":
            lines += [f"float newton:damping = {0.7 / kilogram:.9g}"]
            lines += [f"float newton:friction = {0.8 / (kilogram * metre):.9g}"]
        lines += ["}"]
    return "\n".join([*lines, more, "}"])


def urdf_text():
    """The same robot; a joint's frame in the child is moved to the child's origin by a link without mass."""
    parts = ['<link name="world"/>']
    for name, (mass, com, moments, rpy, _) in LINKS.items():
        xx, yy, zz = moments
        parts.append(
            f'<link name="{name}"><inertial><origin xyz="{" ".join(map(str, com))}" rpy="{" ".join(map(str, rpy))}"/><mass value="{mass}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    for name, (kind, parent, child, p0, rpy0, p1, rpy1, axis, limits) in JOINTS.items():
        T = tw.se3.inverse(tw.se3.pose(of_rpy(rpy1), p1))
        from twistwrench.formats.urdf import rpy_of_rotation

        limit = ""
        if limits is not None:
            a, b = np.radians(limits) if kind == "revolute" else limits
            limit = f'<limit lower="{a!r}" upper="{b!r}" effort="40" velocity="{math.pi!r}"/>'.replace(
                "np.float64(", ""
            ).replace(")", "")
        direction = " ".join(str(int(axis == x)) for x in "XYZ")
        parts.append(
            f'<link name="{name}_at"/><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_at"/>'
            f'<origin xyz="{" ".join(map(str, p0))}" rpy="{" ".join(map(str, rpy0))}"/><axis xyz="{direction}"/>{limit}</joint>'
            f'<joint name="{name}_back" type="fixed"><parent link="{name}_at"/><child link="{child}"/><origin '
            f'xyz="{" ".join(map(repr, T[:3, 3].tolist()))}" rpy="{" ".join(map(repr, rpy_of_rotation(T[:3, :3]).tolist()))}"/></joint>'
        )
    return f'<robot name="arm">{"".join(parts)}</robot>'


def same_robot(robot, other, tolerance=SINGLE, sign=1.0):
    """``sign``: -1 where the coordinates count the other way."""
    assert robot.joint_names == other.joint_names
    rng = np.random.default_rng(3)
    for _ in range(3):
        q, dq, ddq = random_state(other, rng)
        for link in ("upper", "lower", "hand"):
            np.testing.assert_allclose(
                robot.forward_kinematics(sign * q, link),
                other.forward_kinematics(q, link),
                atol=tolerance,
                err_msg=link,
            )
        M, tau = other.mass_matrix(q), other.inverse_dynamics(q, dq, ddq)
        np.testing.assert_allclose(robot.mass_matrix(sign * q), M, atol=tolerance * np.abs(M).max())
        turned = robot.inverse_dynamics(sign * q, sign * dq, sign * ddq)
        np.testing.assert_allclose(sign * turned, tau, atol=tolerance * np.abs(tau).max())


@pytest.fixture(scope="module")
def same():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(urdf_text())
    return robot.with_armature({"elbow": 0.1})


WAYS = {
    "metres": {},
    "centimetres": {"metre": 0.01},
    "grams and millimetres": {"metre": 0.001, "kilogram": 0.001},
    "bodies scaled": {"scale": 2.5},
    "Newton's schema": {"armature": "newton:armature"},
    "sides exchanged": {"swap": ("elbow", "slide")},
    "base joint exchanged": {"swap": ("base",)},
    "no articulation": {"root": ""},
}


@pytest.mark.parametrize("way", WAYS)
def test_a_stage_is_the_same_robot_as_its_urdf(stage, same, way):
    options = WAYS[way]
    head = f'metersPerUnit = {options.get("metre", 1)}\n kilogramsPerUnit = {options.get("kilogram", 1)}\n upAxis = "Z"'
    robot = stage(usd_text(**options), head)
    same_robot(
        robot, same, sign=-1.0 if way == "sides exchanged" else 1.0
    )  # body1 moves on body0, whichever carries which
    np.testing.assert_allclose(robot.limits.lower, np.array([-math.pi / 2, -0.1]), rtol=1e-6)
    np.testing.assert_allclose(robot.limits.upper, np.array([math.pi * 2 / 3, 0.3]), rtol=1e-6)
    np.testing.assert_allclose(robot.limits.effort, [40.0, np.inf], rtol=1e-6)
    np.testing.assert_allclose(robot.limits.velocity, [math.pi, np.inf], rtol=1e-6)
    np.testing.assert_allclose(robot.armature, [0.1, 0.0], rtol=1e-6)
    np.testing.assert_allclose(robot.model.friction.viscous, [0.6, 0.7], rtol=1e-6)
    np.testing.assert_allclose(robot.model.friction.coulomb, [0.0, 0.8], rtol=1e-6)
    assert robot.name == "arm"
    assert robot.link_names == ("world", "upper", "lower", "hand")


@pytest.mark.parametrize("ending", ["usdc", "usd", "usdz"])
def test_binary_stages_are_the_same(stage, tmp_path, ending):
    from pxr import Usd, UsdUtils

    robot = stage(usd_text())
    text = tmp_path / "robot.usda"
    path = tmp_path / f"other.{ending}"
    if ending == "usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(text), str(path))
    else:
        Usd.Stage.Open(str(text)).Export(str(path))
    same_robot(tw.load(path), robot, 1e-12)


def test_what_nothing_holds_floats(stage):
    joints = {name: joint for name, joint in JOINTS.items() if name != "base"}
    text = usd_text(joints=joints)
    floating = stage(text)
    assert floating.joint_names[0] == "root_joint"
    assert floating.nv == 8
    held = stage(text, floating_base=False)
    assert held.joint_names == ("elbow", "slide")
    stated = {asked: stage(text, floating_base=asked).model.mounted for asked in (None, True, False)}
    assert stated == {None: False, True: False, False: True}  # False states that something holds the base
    np.testing.assert_allclose(held.forward_kinematics([0, 0], "upper")[:3, 3], LINKS["upper"][4])
    assert stage(usd_text(), floating_base=True).joint_names == ("root_joint", "elbow", "slide")
    same_momenta = [
        stage(text, floating_base=option).kinetic_energy(floating.neutral, np.ones(8)) for option in (None, True)
    ]
    assert same_momenta[0] == same_momenta[1]


def test_gravity_is_that_of_the_scene_or_the_earths_downward(stage):
    np.testing.assert_allclose(stage(usd_text()).gravity, (0, 0, -9.81))
    np.testing.assert_allclose(stage(usd_text(), 'metersPerUnit = 1\n upAxis = "Y"').gravity, (0, -9.81, 0))
    scene = 'def PhysicsScene "scene" {\nvector3f physics:gravityDirection = (0, 3, 4)\nfloat physics:gravityMagnitude = 162\n}'
    text = f"{usd_text(metre=0.01)}\n{scene}"
    np.testing.assert_allclose(stage(text, 'metersPerUnit = 0.01\n upAxis = "Z"').gravity, (0, 0.972, 1.296), rtol=1e-6)


def test_a_ball_joint_turns_about_its_point(stage):
    joints = {**JOINTS, "elbow": ("ball", *JOINTS["elbow"][1:])}
    robot = stage(usd_text(joints=joints))
    assert [body.joint.kind for body in robot.model.leaders] == ["ball", "prismatic"]
    q = robot.random_configuration(np.random.default_rng(0))
    T_up, T_low = robot.forward_kinematics(q, "upper"), robot.forward_kinematics(q, "lower")
    _, _, _, p0, rpy0, p1, rpy1, _, _ = joints["elbow"]
    np.testing.assert_allclose(T_up[:3, :3] @ p0 + T_up[:3, 3], T_low[:3, :3] @ p1 + T_low[:3, 3], atol=SINGLE)
    at_zero = robot.neutral
    R = robot.forward_kinematics(at_zero, "upper")[:3, :3].T @ robot.forward_kinematics(at_zero, "lower")[:3, :3]
    np.testing.assert_allclose(R, of_rpy(rpy0) @ of_rpy(rpy1).T, atol=SINGLE)


def test_joints_hang_on_parts_of_bodies_and_on_the_stage(stage, same):
    """A joint's target may be an Xform below a body, whose pose is then between, or one that stands still."""
    part = 'def Xform "stand" {\ndouble3 xformOp:translate = (0.1, 0.2, 0.2)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n}'
    joints = {**JOINTS, "base": ("fixed", "stand", "upper", (0, 0, 0.1), *JOINTS["base"][4:])}
    same_robot(stage(usd_text(joints=joints, more=part)), same)


def test_a_joint_outside_the_articulation_is_an_offered_closure(stage):
    loop = (
        'def PhysicsRevoluteJoint "loop" {\nrel physics:body0 = </arm/upper>\nrel physics:body1 = </arm/hand>\n'
        'uniform token physics:axis = "Y"\npoint3f physics:localPos0 = (0.1, 0, 0)\nuniform bool physics:excludeFromArticulation = true\n}'
    )
    robot = stage(usd_text(more=loop))
    closure = robot.closures["loop"]
    assert closure.rows == "wx wz vx vy vz"
    T = tw.se3.inverse(robot.forward_kinematics([0, 0], "upper")) @ robot.forward_kinematics([0, 0], closure.frame_a)
    np.testing.assert_allclose(T[:3, 3], (0.1, 0, 0), atol=1e-7)
    assert any("robot.close('loop:0', 'loop:1'" in said for said in robot.defects)
    with pytest.raises(tw.RobotFileError, match=r"prim </arm/(loop|slide)> closes a loop.*excludeFromArticulation"):
        stage(usd_text(more=loop.replace("uniform bool physics:excludeFromArticulation = true", "")))


def test_what_is_switched_off_or_moved_by_a_script_is_none(stage):
    """A joint that is switched off holds nothing, and a kinematic body is not a body of a robot."""
    loop = (
        'def PhysicsRevoluteJoint "loop" {{\nrel physics:body0 = </arm/upper>\nrel physics:body1 = </arm/hand>\n'
        "bool physics:excludeFromArticulation = 1\nbool physics:jointEnabled = {}\n}}"
    )
    assert [len(stage(usd_text(more=loop.format(on))).closures) for on in (1, 0)] == [1, 0]
    for off in ("bool physics:kinematicEnabled = 1", "bool physics:rigidBodyEnabled = 0"):
        with pytest.raises(tw.RobotFileError, match="no rigid body"):
            stage(body_of([], off))


def test_one_articulation_of_several(stage):
    other = usd_text().replace("/arm", "/other").replace('"arm"', '"other"')
    with pytest.raises(tw.RobotFileError, match=r"2 articulations: /arm, /other. Say which, model="):
        stage(usd_text() + "\n" + other)
    for name in ("other", "/arm"):
        robot = stage(usd_text() + "\n" + other, model=name)
        assert robot.nv == 2
        assert any("are not joined to the robot, and are left out" in said for said in robot.defects)
        assert f"/{name.strip('/')}/hand" in robot.link_names  # the short name is not one's only
    with pytest.raises(tw.UnknownNameError, match="third"):
        stage(usd_text() + "\n" + other, model="third")


def body_of(shapes, physics=""):
    """A stage of one body with colliders: (type, lines, scale) each, 0.3 m above the body's origin."""
    parts = [
        f'def {kind} "part{k}" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMassAPI", "MaterialBindingAPI"])\n{{\n'
        f"{lines}\ndouble3 xformOp:translate = (0, 0, 0.3)\ndouble3 xformOp:scale = {figures(scale)}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n}'
        for k, (kind, lines, scale) in enumerate(shapes)
    ]
    body = 'def Xform "body" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])'
    material = 'def Material "oak" (prepend apiSchemas = ["PhysicsMaterialAPI"])\n{\nfloat physics:density = 700\n}'
    return f'def Xform "arm"\n{{\n{material}\n{body}\n{{\n{physics}\n' + "\n".join(parts) + "\n}\n}"


UP = np.eye(4) + 0.3 * np.outer(np.eye(4)[2], np.eye(4)[3])
BOX, BALL = tw.SpatialInertia.box, tw.SpatialInertia.sphere
LYING = tw.se3.pose([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [0, 0, 0])
ONES = (1, 1, 1)
SHAPES = {
    "box": ([("Cube", "double size = 0.2", (1, 2, 3))], "", BOX((0.2, 0.4, 0.6), density=1000).in_frame(UP)),
    "ball of its own density": (
        [("Sphere", "double radius = 0.1\nfloat physics:density = 500", ONES)], "", BALL(0.1, density=500).in_frame(UP),
    ),
    "ellipsoid": ([("Sphere", "", (0.1, 0.2, 0.3))], "", tw.SpatialInertia.ellipsoid((0.1, 0.2, 0.3), density=1000).in_frame(UP)),
    "cylinder of the body's density": (
        [("Cylinder", 'double radius = 0.1\ndouble height = 0.5\nuniform token axis = "X"', ONES)], "float physics:density = 200",
        tw.SpatialInertia.cylinder(0.1, 0.5, density=200).in_frame(UP @ LYING),
    ),
    "capsule of wood": (
        [("Capsule", "double radius = 0.1\ndouble height = 0.5\nrel material:binding:physics = </arm/oak>", ONES)], "",
        tw.SpatialInertia.capsule(0.1, 0.5, density=700).in_frame(UP),
    ),
    "the body's density, though its material has one": (
        [("Cube", "double size = 0.2\nrel material:binding:physics = </arm/oak>", ONES)], "float physics:density = 200",
        BOX((0.2, 0.2, 0.2), density=200).in_frame(UP),
    ),
    "its own mass": ([("Cube", "float physics:mass = 3", ONES)], "", BOX((2, 2, 2), mass=3).in_frame(UP)),
    "two shapes": (
        [("Cube", "float physics:mass = 3", ONES), ("Sphere", "float physics:mass = 2", ONES)], "",
        (BOX((2, 2, 2), mass=3) + BALL(1, mass=2)).in_frame(UP),
    ),
    "the body's mass": ([("Cube", "float physics:mass = 3", ONES)], "float physics:mass = 5", BOX((2, 2, 2), mass=5).in_frame(UP)),
    "the body's centre": (
        [("Cube", "", ONES)], "float physics:mass = 5\npoint3f physics:centerOfMass = (1, 0, 0)",
        tw.SpatialInertia.from_com(5, (1, 0, 0), BOX((2, 2, 2), mass=5).moment_about_com),
    ),
    "its centre alone": (
        [("Cube", "", ONES)], "float physics:mass = 5\nfloat3 physics:diagonalInertia = (1, 1, 1)",
        tw.SpatialInertia.from_com(5, (0, 0, 0.3), np.eye(3)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SHAPES)
@pytest.mark.parametrize("metre", [1.0, 0.01])
def test_what_the_mass_leaves_out_comes_from_colliders(stage, case, metre):
    shapes, physics, expected = SHAPES[case]
    robot = stage(body_of(shapes, physics), f'metersPerUnit = {metre}\n upAxis = "Z"', floating_base=True)
    found = robot.model.link_inertias["body"]
    if metre == 1.0:
        np.testing.assert_allclose(found.parameters, expected.parameters, rtol=1e-12, atol=1e-12 * expected.mass)
    elif "density" not in physics + str(shapes) and case not in ("box", "ellipsoid", "capsule of wood"):
        assert found.mass == pytest.approx(expected.mass)  # masses are in kilograms whatever the lengths are in
        np.testing.assert_allclose(found.com, expected.com * metre, atol=1e-9)


D6 = {**JOINTS, "elbow": ("D6", *JOINTS["elbow"][1:])}
WRONG = {
    "D6 joint": (usd_text(joints=D6), r"prim </arm/elbow> is a PhysicsJoint, which is not read. Write it as revolute"),
    "no mass": (usd_text(drop="mass"), r"prim </arm/upper> has no physics:mass, and no collider.* Give the body a PhysicsMassAPI with mass"),
    "no inertia": (usd_text(drop="moments"), r"prim </arm/upper> has no physics:diagonalInertia"),
    "nothing there": (usd_text().replace("</arm/hand>", "</arm/foot>"), r"prim </arm/slide> has body1 at /arm/foot, where nothing"),
    "one body": (usd_text().replace("</arm/hand>", "</arm/lower>"), r"prim </arm/slide> has one body at both ends"),
    "two joints": (
        usd_text(joints={**JOINTS, "twin": JOINTS["slide"]}), r"prim </arm/twin> and prim </arm/slide> join the same two bodies. Write it as",
    ),
    "no number": (
        usd_text().replace("physics:upperLimit = 0.3", "physics:upperLimit = nan"), r"prim </arm/slide> has physics:upperLimit = nan",
    ),
    "mesh": (body_of([("Mesh", "", ONES)]), r"prim </arm/body/part0> is a Mesh, whose mass is not computed. Give the body"),
    "oval": (body_of([("Cylinder", "", (1, 2, 1))]), r"prim </arm/body/part0> is a Cylinder scaled to another shape"),
    "no body": ('def Xform "arm" { }', "no rigid body"),
    "sheared": (
        usd_text().replace('def Xform "arm" (', 'def Xform "arm" (').replace(
            "double3 xformOp:scale = (1, 1, 1)", "double3 xformOp:scale = (1, -1, 1)", 1),
        r"prim </arm/upper> is sheared or mirrored",
    ),
    "no USD": ("this is not a stage", r"robot\.usda: it cannot be read as USD: .*"),
    "cannot exist": (
        usd_text(links={**LINKS, "hand": (0.5, (0, 0, 0), (1.0, 0.1, 0.1), (0, 0, 0), (0, 0, 0))}), r"link 'hand' \(/arm/hand\).* cannot exist",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_refused_is_named_by_its_path(stage, case):
    text, says = WRONG[case]
    with pytest.raises(tw.ModelError, match=says) as caught:
        stage(text)
    assert "robot.usda: " in str(caught.value)


def test_numbers_are_the_decimals_that_were_typed(stage):
    robot = stage(usd_text())
    assert robot.limits.upper[1] == 0.3
    assert robot.limits.effort[0] == 40.0
    assert robot.gravity.tolist() == [0.0, 0.0, -9.81]
    assert robot.model.link_inertias["hand"].com.tolist() == pytest.approx([0.02, 0.0, 0.05], rel=1e-15)


def test_the_doctor_examines_the_robot_and_not_the_file(stage, tmp_path):
    robot = stage(usd_text())
    assert tw.doctor(robot).findings is not None
    with pytest.raises(tw.RobotFileError, match=r"is USD, whose files are not examined.*twistwrench\.doctor"):
        tw.doctor(tmp_path / "robot.usda")


def test_options_and_limits(stage, tmp_path):
    with pytest.raises(tw.RobotFileError, match=r"more than 2 bodies \(prim </arm/hand>\)"):
        stage(usd_text(), max_bodies=2)
    with pytest.raises(tw.RobotFileError, match="it is usd, and format='urdf' was given"):
        stage(usd_text(), format="urdf")
    with pytest.raises(tw.ValueRangeError, match="keep='hand' is of MJCF files"):
        stage(usd_text(), keep="hand")
    with pytest.raises(tw.NotFoundError, match=r"other\.usda"):
        tw.load(tmp_path / "other.usda")
    assert stage(usd_text(), format="usd").nv == 2


def test_the_largest_single_is_no_limit_in_any_units(stage):
    """In millimetres and grams, 3.4e38 g mm²/s² is 3.4e29 N m; it still means that no limit is stated."""
    text = re.sub(r"(maxForce|maxJointVelocity|lowerLimit|upperLimit) = .*", r"\1 = 3.4028235e38", usd_text(1e-3, 1e-3))
    limits = stage(text, "metersPerUnit = 0.001\nkilogramsPerUnit = 0.001").limits
    for kind in ("effort", "velocity", "lower", "upper"):
        assert np.isinf(getattr(limits, kind)).all(), kind


def test_layers_come_from_the_folder_or_not_at_all(stage, tmp_path):
    (tmp_path / "outside").mkdir()
    (tmp_path / "inside").mkdir()
    whole = f'#usda 1.0\n(\n defaultPrim = "arm"\n metersPerUnit = 1\n upAxis = "Z"\n)\n{usd_text()}'
    (tmp_path / "outside" / "parts.usda").write_text(whole)
    (tmp_path / "inside" / "parts.usda").write_text(whole)
    entry = tmp_path / "inside" / "robot.usda"
    head = '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Z"\n subLayers = [@%s@]\n)\n'
    entry.write_text(head % "./parts.usda")
    assert tw.load(entry).nv == 2
    entry.write_text(head % "../outside/parts.usda")
    with pytest.raises(tw.RobotFileError, match=r"takes in .*outside.*include_paths"):
        tw.load(entry)
    assert tw.load(entry, include_paths=[tmp_path / "outside"]).nv == 2
    entry.write_text(head % "./absent.usda")
    with pytest.raises(tw.RobotFileError, match=r"cannot be read whole: .*absent\.usda"):
        tw.load(entry)


def test_verify_and_writers_take_it(stage):
    robot = stage(usd_text())
    report = verify(robot, states=1)
    assert report.passed
    assert "is USD" in report.checks[-1].skipped
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        again = tw.load(robot.to_urdf())
    same_robot(again.with_armature({"elbow": 0.1}), robot, 1e-9)


JOINT, BODY = 'def PhysicsRevoluteJoint "elbow"', 'def Xform "hand"'


FREE = "\n".join(line for line in usd_text().split("\n") if "newton:damping" not in line)


def with_line(prim, line):
    """The stage with a line more in a prim."""
    before, head, after = FREE.partition(prim)
    first, brace, rest = after.partition("\n{\n")
    return before + head + first + brace + line + "\n" + rest


def unread(kind):
    from twistwrench.formats.known_elements import KNOWN, LeftOut

    return [(name, entry) for name, entry in KNOWN["USD"][kind].items() if isinstance(entry, LeftOut)]


@pytest.mark.parametrize(
    ("prim", "name", "entry"), [(JOINT, *one) for one in unread("joint")] + [(BODY, *one) for one in unread("body")]
)
def test_what_is_left_out_is_remarked_and_changes_nothing(stage, prim, name, entry):
    whole = stage(FREE)
    if name.startswith("<"):
        api = name[1:-1]
        text = FREE.replace(f"{prim} (prepend apiSchemas = [", f'{prim} (prepend apiSchemas = ["{api}", ')
    else:
        text = with_line(prim, f"float {name} = 3")
        assert stage(with_line(prim, f"float {name} = {(entry.unless or ('0',))[0]}")).defects == whole.defects
    robot = stage(text)
    (new,) = [said for said in robot.defects if said not in whole.defects]
    assert entry.change in new
    assert name.strip("<>") in new
    assert "elbow" in new or "hand" in new
    assert robot.to_sdf() == whole.to_sdf()


def test_names_of_the_schema_that_are_not_known_are_remarked(stage):
    (new,) = stage(with_line(BODY, "float physics:masss = 3")).defects
    assert new == "prim </arm/hand>: physics:masss is not an attribute of <body> in USD; did you mean physics:mass?"
    assert stage(with_line(BODY, "float physxRigidBody:sleepThreshold = 3\nfloat other:thing = 1")).defects == ()
    both = "float mjc:armature = 0.1\nfloat newton:armature = 0.2"  # converters write both, and one is read
    assert stage(with_line(JOINT, both)).defects == ()
