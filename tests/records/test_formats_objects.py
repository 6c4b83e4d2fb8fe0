"""Models of MuJoCo's and Pinocchio's: complete answers on record."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from recorded_models import ShortRecords, described, pose, rounded

from twistwrench.core.errors import TwistWrenchError
from twistwrench.formats.actuators import add_actuators
from twistwrench.formats.mujoco_model import _ModelElements, read_mujoco_model
from twistwrench.formats.pinocchio_model import pinocchio_of, read_pinocchio_model
from twistwrench.formats.xml import xml_text
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder

from .test_formats_writers import DRIVES, rig, solid

mujoco = pytest.importorskip("mujoco", minversion="4.0", reason="MuJoCo 4 is not installed")
pinocchio = pytest.importorskip(
    "pinocchio", minversion="4.0", reason="Pinocchio 4 is not installed", exc_type=ImportError
)
records = ShortRecords(__file__)

CRAB = """<mujoco model="crab">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="0.5 -1 -9" density="{density}" viscosity="{viscosity}"><flag {flag}="disable"/></option>
  <worldbody>
    <site name="ground" pos="1 2 3" quat="1 2 3 4"/><geom type="plane" size="1 1 1"/>
    <body name="shell" pos="0.1 0.2 0.3" euler="10 20 30">{root}
      <inertial pos="0.05 -0.06 0.07" mass="7.5" fullinertia="0.21 0.19 0.15 0.01 -0.02 0.03"/><site name="eye" pos="0.1 0 0.2" euler="30 0 0"/>
      <body pos="0.3 0 0.1" euler="0 15 0" gravcomp="0.5">
        <inertial pos="0.1 0.02 0" mass="1.5" diaginertia="0.02 0.03 0.04"/>
        <joint axis="0.6 0 0.8" range="-40 70" ref="10" springref="20" stiffness="5" damping="0.5" frictionloss="0.25" armature="0.125" pos="0.01 0.02 0.03"
          actuatorfrcrange="-7 9"/>
        <joint name="slide" type="slide" axis="0 1 0" range="-0.1 0.2" damping="0.75"/>
        <geom type="box" size="0.1 0.1 0.1"/>
        <body name="claw" pos="0 0.2 0.1"><inertial pos="0 0.05 0.1" mass="0.75" diaginertia="0.002 0.003 0.004"/>
          <joint name="wrist" type="ball" stiffness="2" damping="0.0625" pos="0.02 0 0.01"/>
          <body name="tip" pos="0 0 0.3"><inertial pos="0 0.01 0.1" mass="0.25" diaginertia="0.001 0.0012 0.0014"/><joint name="tip" axis="1 0 0" limited="false" range="-1 1"/></body></body>
      </body>
      <body name="leg" pos="0 -0.3 0"><inertial pos="0 0.1 0" mass="0.5" diaginertia="0.005 0.004 0.003"/><joint name="hip" axis="0 1 1" ref="15"/><joint name="knee" axis="1 0 0" type="slide"/>
        <body name="foot" pos="0 0 -0.4"><inertial pos="0.03 0 0" mass="0.125" diaginertia="0.001 0.001 0.0015"/></body></body>
    </body>
  </worldbody>
  <tendon><fixed name="cord" stiffness="8" springlength="0.25" damping="0.1" frictionloss="0.2"><joint joint="hip" coef="2"/><joint joint="knee" coef="-3"/></fixed>
    <spatial name="rope" stiffness="3"><site site="ground"/><site site="eye"/></spatial><fixed><joint joint="tip" coef="0.5"/></fixed></tendon>
  <equality>
    <joint name="law" joint1="knee" joint2="hip" polycoef="0.1 0.5 0 0 0"/><joint joint1="tip" polycoef="0.25 1 0 0 0" active="{active}"/>
    <connect name="pin" body1="shell" body2="foot" anchor="0.1 0.2 0.3"/><weld body1="tip" body2="leg" anchor="0.3 0.1 -0.2" relpose="0.1 0.2 0.3 0.5 0.5 -0.5 1"/>
    <weld name="sites" site1="ground" site2="eye"/>
  </equality>
  <actuator>
    <motor name="m" joint="slide" gear="3" ctrlrange="-2 4"/><position joint="hip" kp="20" forcerange="-6 11"/><motor tendon="cord"/><motor joint="wrist" gear="1 2 3"/>
    <general joint="knee" gear="2" gainprm="5" ctrlrange="-3 4" forcerange="-8 8"/><velocity joint="tip" kv="2"/>
  </actuator>
  <keyframe><key name="home" qpos="{home}"/><key qpos="{rest}"/></keyframe>
</mujoco>"""
ROOTS = {"free": "<freejoint name='float'/>", "fixed": "", "hinge": "<joint name='yaw' axis='0 0 1'/>"}


def crab(root="free", flag="sensor", active="false", density="0", viscosity="0"):
    more = {"free": "0.1 0.2 0.3 0.8 0.6 0 0 ", "fixed": "", "hinge": "0.25 "}[root]
    home = f"{more}0.2 0.1 0.6 0.8 0 0 0.3 0.4 0.5"
    text = CRAB.format(
        root=ROOTS[root],
        home=home,
        rest=home.replace("0.", "0.0"),
        flag=flag,
        active=active,
        density=density,
        viscosity=viscosity,
    )
    return mujoco.MjModel.from_xml_string(text)


def built(read, model, **options):
    try:
        builder, floats = read(model, **options)
        return builder.build(floating_base=floats, quiet=True, inertia="accept")
    except TwistWrenchError as error:
        return f"{type(error).__name__}: {error}"


@records.of
def a_crab_compiled_by_mujoco():
    return described(built(read_mujoco_model, crab()))


@records.of
def the_crab_by_option():
    answers = {}
    keys = (
        "joints",
        "mounted",
        "mounts",
        "friction",
        "springs",
        "configurations",
        "closures",
        "gravity",
        "base",
        "notes",
        "armature",
        "motor joints",
        "limits",
    )
    whole = {}
    for root in ROOTS:
        for floating in (None, False, True):
            answer = described(built(read_mujoco_model, crab(root), floating_base=floating))
            whole[f"{root} {floating}"] = {
                key: answer.get(key) for key in ("joints", "mounted", "base", "configurations")
            }
    for flag in ("gravity", "spring", "damper", "equality", "frictionloss", "constraint"):
        answer = described(built(read_mujoco_model, crab(flag=flag)))
        plain = described(built(read_mujoco_model, crab()))
        answers[flag] = {key: answer.get(key) for key in keys if str(answer.get(key)) != str(plain.get(key))}
    for options in ({"density": "1.2"}, {"viscosity": "0.5"}, {"active": "true"}):
        answer = described(built(read_mujoco_model, crab(**options)))
        answers[str(options)] = [
            note for note in answer["notes"] if note not in described(built(read_mujoco_model, crab()))["notes"]
        ]
    answers["no model"] = built(read_mujoco_model, object())
    return {"roots": whole, "flags": answers}


@records.of
def elements_of_the_crab():
    root = _ModelElements(crab("hinge", active="true"))
    sections = ("actuator", "tendon", "equality", "keyframe", "option", "compiler")
    lines = {tag: [rounded(" ".join(xml_text(child).split()[3:])) for child in root.root.all(tag)] for tag in sections}
    joints = [
        rounded(str(sorted(element.attributes.items())))
        for element in root.root.walk()
        if element.tag == "joint" and "type" in element.attributes
    ]
    return {"sections": lines, "joints": joints, "names": root.joints, "notes": list(map(str, root.notes))}


MOTORS = """<mujoco><worldbody><body name="a"><joint name="j" stiffness="2 1" damping="0.5 0.1"/><inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/>
<site name="s"/><site/><body name="c" pos="0 0 1"><joint name="k" type="slide"/><geom size="0.1"/><site name="crank"/></body></body>
<body name="d" pos="1 0 0"><joint name="n" type="ball" armature="0.25"/><geom size="0.1"/><site name="slider"/></body></worldbody>
<actuator><dcmotor joint="j" motorconst="0.08" resistance="0.7" inductance="0.002" saturation="0.5" gear="-50" lugre="900 3 0.02 0.03 0.5" cogging="0.01 7"
armature="0.01" damping="0.02 0.1"/><motor joint="k" ctrlrange="-1 3" gear="2"/>{}</actuator>
<equality><weld site1="s" site2="crank"/></equality></mujoco>"""


@records.of
def motors_compiled_by_mujoco():
    answers = {}
    for more in ("", '<general cranksite="crank" slidersite="slider" cranklength="0.5"/>'):
        model = mujoco.MjModel.from_xml_string(MOTORS.format(more))
        model.dof_armature[-3:] = (0.25, 0.5, 0.75)
        answer = described(built(read_mujoco_model, model))
        answers[more] = {
            key: answer.get(key)
            for key in (
                "limits",
                "friction",
                "armature",
                "springs",
                "actuators",
                "motor joints",
                "closures",
                "sites",
                "notes",
            )
        }
    still = "<mujoco><worldbody><body name='b' pos='1 2 3'><geom size='0.1'/></body></worldbody></mujoco>"
    answers["still"] = described(built(read_mujoco_model, mujoco.MjModel.from_xml_string(still)))
    disabled = crab(flag="gravity")
    with pytest.MonkeyPatch.context() as patch:
        patch.delitem(sys.modules, "mujoco")
        answers["without the library"] = built(read_mujoco_model, disabled).gravity
    return answers


# ── Pinocchio


def placement(*screw):
    T = se3.exp(np.array(screw))
    return pinocchio.SE3(T[:3, :3], T[:3, 3])


def inertia(mass, *com):
    return pinocchio.Inertia(
        mass, np.array(com), np.array([[0.31, -0.02, 0.013], [-0.02, 0.27, 0.017], [0.013, 0.017, 0.22]]) / 10
    )


def chimera(free=True):
    """Model of joints of all types."""
    model = pinocchio.Model()
    model.name = "chimera"
    model.gravity.linear = np.array([0.5, -1.0, -9.0])
    axis = np.array([0.6, 0.0, 0.8])
    joints = [
        ("rx", pinocchio.JointModelRX()), ("ruby", pinocchio.JointModelRUBY()), ("pz", pinocchio.JointModelPZ()), ("ru", pinocchio.JointModelRevoluteUnaligned(axis)), ("pu", pinocchio.JointModelPrismaticUnaligned(axis)),
        ("hz", pinocchio.JointModelHZ(0.25)), ("hu", pinocchio.JointModelHelicalUnaligned(axis, -0.5)), ("ball", pinocchio.JointModelSpherical()), ("zyx", pinocchio.JointModelSphericalZYX()), ("planar", pinocchio.JointModelPlanar()), ("shift", pinocchio.JointModelTranslation()),
    ]  # fmt: skip
    if hasattr(pinocchio, "JointModelUniversal"):
        joints.append(("cross", pinocchio.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0.0, 0.6, 0.8]))))
    composite = pinocchio.JointModelComposite(2)
    composite.addJoint(pinocchio.JointModelRZ(), placement(0.1, 0.2, 0, 0.3, 0, 0))
    composite.addJoint(pinocchio.JointModelPX(), placement(0, 0.2, 0, 0, 0.4, 0))
    joints.append(("both", composite))
    parent = 0
    if free:
        parent = model.addJoint(0, pinocchio.JointModelFreeFlyer(), placement(0.3, 0.2, 0.1, 1, 2, 3), "root")
        model.appendBodyToJoint(parent, inertia(5.0, 0.1, 0.2, 0.3), placement(0.2, 0, 0, 0, 0.1, 0))
    for k, (name, joint) in enumerate(joints):
        parent = model.addJoint(
            parent if k % 4 else min(parent, 1), joint, placement(0.1 * k, 0.2, -0.1, 0.3, 0.05 * k, 0.2), name
        )
        model.appendBodyToJoint(parent, inertia(1.0 + k, 0.1 * k, 0.02, 0.03), pinocchio.SE3.Identity())
        if k % 3 == 0:
            model.addBodyFrame(f"{name} link", parent, pinocchio.SE3.Identity(), 0)
        if k % 3 == 1:
            model.addBodyFrame(f"{name} plate", parent, placement(0, 0.1, 0, 0.5, 0, 0), 0)
        if k == 5:
            model.addFrame(
                pinocchio.Frame("eye", parent, 0, placement(0.3, 0, 0, 0, 0, 0.2), pinocchio.FrameType.OP_FRAME)
            )
            model.addFrame(
                pinocchio.Frame("nose", parent, 0, placement(0, 0.3, 0, 0, 0, 0.1), pinocchio.FrameType.SENSOR)
            )
            model.addFrame(
                pinocchio.Frame("fin", parent, 0, placement(0, 0, 0.1, 0, 0, 0), pinocchio.FrameType.FIXED_JOINT)
            )
    v = np.arange(1.0, model.nv + 1)
    model.lowerPositionLimit = -np.arange(1.0, model.nq + 1) / 7
    model.upperPositionLimit = np.arange(1.0, model.nq + 1) / 5
    model.velocityLimit = np.where(v % 3 == 0, -1.0, 3 * v)
    model.effortLimit = np.where(v % 5 == 0, 0.0, 11 * v)
    model.damping = v / 10
    model.friction = v / 20
    model.armature = v / 30
    q = pinocchio.neutral(model)
    q = pinocchio.integrate(model, q, 0.1 * np.sin(v))
    model.referenceConfigurations["bent"] = q
    return model


@records.of
def a_chimera_of_pinocchios_joints():
    return described(built(read_pinocchio_model, chimera()))


@records.of
def the_chimera_by_option():
    keys = ("joints", "mounted", "base", "configurations")
    answers = {}
    for free in (True, False):
        for floating in (None, False, True):
            answer = described(built(read_pinocchio_model, chimera(free), floating_base=floating))
            answers[f"{free} {floating}"] = {key: answer.get(key) for key in keys} | {
                "first": [[body["joint"], body.get("parent")] for body in answer["bodies"][:2]]
            }
    answers["no model"] = built(read_pinocchio_model, object())
    return answers


def _finite(array):
    """Array with infinities in place of the largest numbers."""
    return np.where(array > 1e300, np.inf, np.where(array < -1e300, -np.inf, array))


def pinocchio_values(model):
    """Fields of a Pinocchio model."""
    joints = []
    for j in range(1, model.njoints):
        joint = model.joints[j]
        data = joint.createData()
        joint.calc(data, pinocchio.neutral(model))
        joints.append(
            [
                model.names[j],
                joint.shortname(),
                model.parents[j],
                pose(model.jointPlacements[j].homogeneous),
                np.array(data.S).T,
            ]
        )
    inertias = [[I.mass, np.array(I.lever), np.array(I.inertia)] for I in model.inertias]
    frames = [
        [frame.name, frame.parentJoint, str(frame.type), pose(frame.placement.homogeneous)] for frame in model.frames
    ]
    arrays = {
        name: _finite(np.array(getattr(model, name)))
        for name in (
            "lowerPositionLimit",
            "upperPositionLimit",
            "velocityLimit",
            "effortLimit",
            "damping",
            "friction",
            "armature",
        )
    }
    configurations = {item.key(): np.array(item.data()) for item in model.referenceConfigurations}
    return {
        "name": model.name,
        "gravity": np.array(model.gravity.linear),
        "joints": joints,
        "inertias": inertias,
        "frames": frames,
        "arrays": arrays,
        "configurations": configurations,
    }


FOLLOWER = """<robot name="r"><link name="base"/>{}
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-1" upper="2" velocity="3" effort="4"/></joint>
<joint name="k" type="{}"><parent link="a"/><child link="b"/><origin xyz="0.1 0.2 0.3"/><axis xyz="{}"/><limit lower="-1" upper="2" velocity="3"
effort="4"/><mimic joint="j" multiplier="-0.5" offset="0.25"/></joint></robot>"""


@records.of
def followers_of_pinocchios():
    links = "".join(
        f'<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        for name, mass in (("a", 1), ("b", 2))
    )
    answers = {}
    for kind, axis in (("prismatic", "0.6 0 0.8"), ("revolute", "0 1 0"), ("revolute", "0 0.6 0.8")):
        model = pinocchio.buildModelFromXML(FOLLOWER.format(links, kind, axis), mimic=True)
        model.referenceConfigurations["home"] = np.array([0.75])
        answers[f"{kind} {axis}"] = described(built(read_pinocchio_model, model))
    return answers


@records.of
def a_rig_as_pinocchios_model():
    model = rig(normal=(0, 0, 1)).build(quiet=True, inertia="accept")
    found, lost = pinocchio_of(add_actuators(model, DRIVES))
    return pinocchio_values(found) | {"lost": list(lost)}


@records.of
def a_floating_robot_as_pinocchios_model():
    builder = ModelBuilder("boat")
    for name, mass in (("hull", 4.0), ("mast", 2.0), ("sail", 1.0), ("keel", 3.0)):
        builder.add_link(name, solid(mass, (0.1, 0.2, 0.3)))
    builder.add_joint(
        "turn",
        "revolute",
        "hull",
        "mast",
        placement=se3.exp(np.array([0.1, 0.2, 0.3, 1, 2, 3])),
        axis=(0, 0, 1, 0.5, 0.25, 0),
        lower=-1,
        upper=2,
        velocity=3,
        effort=4,
        armature=0.25,
    )
    builder.add_joint("hoist", "prismatic", "mast", "sail", axis=(0, 1, 0), effort=7)
    builder.add_joint("hang", "helical", "hull", "keel", axis=(0, 0, 1), pitch=0.5, upper=3)
    builder.add_configuration("moored", {"turn": [0.5], "root_joint": [0.6, 0.8, 0, 0, 1, 2, 3], "hang": [0.25]})
    builder.add_spring({"turn": 1.0}, 5.0)
    builder.add_link("drill", solid(0.5))
    builder.add_joint("bore", "helical", "sail", "drill", axis=(0.6, 0, 0.8, 0.4, 0.5, 0.2))
    builder.add_link("spin", solid(0.25))
    builder.add_joint("spin", "continuous", "sail", "spin", axis=(0.6, 0, 0.8))
    model = builder.build(floating_base=True, quiet=True)
    found, lost = pinocchio_of(model)
    values = pinocchio_values(found)
    values.pop("inertias")
    return values | {"lost": list(lost)}


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
