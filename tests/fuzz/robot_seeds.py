"""Whole files of robots, meshes, actuators and tables, from which changed ones are made."""

from __future__ import annotations

import base64
import io
import struct
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import twistwrench as tw
from twistwrench.robots import path_of
from twistwrench.sensing.files import write_sensor


@dataclass(frozen=True)
class Case:
    """Files of one reading by their names below a folder."""

    main: str
    """Name of the file, or folder, that is given to the reader."""
    files: dict[str, bytes]


def single(name: str, data: bytes) -> list[Case]:
    return [Case(name, {name: data})]


def bundled(name: str) -> bytes:
    return path_of(name).read_bytes()


# ── Meshes

CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


def stl_text() -> bytes:
    facets = "".join(
        f"facet normal 0 0 0\nouter loop\n{''.join('vertex {} {} {}'.format(*CORNERS[k]) + chr(10) for k in face)}endloop\nendfacet\n"
        for face in FACES
    )
    return f"solid x\n{facets}endsolid x\n".encode()


def stl_binary() -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *(float(x) for k in face for x in CORNERS[k]), 0) for face in FACES)
    return bytes(80) + struct.pack("<I", len(FACES)) + rows


def obj() -> bytes:
    vertices = "".join("v {} {} {}\n".format(*corner) for corner in CORNERS)
    faces = "".join("f {} {} {}\n".format(*(k + 1 for k in face)) for face in FACES)
    return f"mtllib x.mtl\no x\nusemtl red\n{vertices}vn 0 0 1\nvt 0 0\n{faces}".encode()


def ply() -> bytes:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "".join("{} {} {}\n".format(*c) for c in CORNERS) + "".join("3 {} {} {}\n".format(*f) for f in FACES)
    return (head + rows).encode()


def off() -> bytes:
    return (
        "OFF\n4 4 6\n" + "".join("{} {} {}\n".format(*c) for c in CORNERS) + "".join("3 {} {} {}\n".format(*f) for f in FACES)
    ).encode()  # fmt: skip


def dae() -> bytes:
    numbers = " ".join(str(x) for corner in CORNERS for x in corner)
    indices = " ".join(str(k) for face in FACES for k in face)
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>x.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong><diffuse><color>1 0 0 1</color></diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="12">{numbers}</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4" material="m"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="m" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def gltf() -> bytes:
    import json

    numbers = np.array(CORNERS, "<f4").tobytes() + np.array(FACES, "<u2").tobytes()
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
                {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
            ],
            "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
            "buffers": [{"uri": "data:application/octet-stream;base64," + base64.b64encode(numbers).decode(), "byteLength": 72}],
        }
    ).encode()  # fmt: skip


def glb() -> bytes:
    import json

    content = json.loads(gltf())
    numbers = base64.b64decode(content["buffers"][0].pop("uri").partition(",")[2])
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(numbers), b"BIN\0") + numbers
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def msh() -> bytes:
    """MuJoCo's own format: counts, then vertices, normals, coordinates of textures and faces."""
    head = struct.pack("<4i", len(CORNERS), 0, 0, len(FACES))
    return head + np.array(CORNERS, "<f4").tobytes() + np.array(FACES, "<i4").tobytes()


def meshes() -> list[Case]:
    made = {"stl": stl_text(), "obj": obj(), "dae": dae(), "ply": ply(), "off": off(), "gltf": gltf(), "glb": glb()}
    files = [Case(f"mesh.{ending}", {f"mesh.{ending}": data}) for ending, data in made.items()]
    red = b"newmtl red\nKd 1 0 0\nmap_Kd x.png\n"
    return [*files, Case("mesh.stl", {"mesh.stl": stl_binary()}), Case("mesh.obj", {"mesh.obj": obj(), "x.mtl": red})]


# ── Robots


def urdf() -> list[Case]:
    rich = b"""<?xml version="1.0"?><robot name="rich" version="1.0"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"/><link name="a"><inertial><origin xyz="0 0 0.1" rpy="0.1 0 0"/><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0 0 0"/><geometry><mesh filename="meshes/x.stl" scale="0.1 0.1 0.1"/></geometry><material name="red"/></visual>
<collision><geometry><cylinder radius="0.05" length="0.2"/></geometry></collision></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial><visual><geometry><box size="0.1 0.1 0.2"/></geometry></visual></link>
<link name="c"><inertial><mass value="0.5"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><origin xyz="0 0 0.2" rpy="0 0 1"/><parent link="base"/><child link="a"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/><dynamics damping="0.1" friction="0.2"/></joint>
<joint name="j2" type="prismatic"><origin xyz="0 0 0.2"/><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="0" upper="0.3" effort="80" velocity="1"/></joint>
<joint name="j3" type="continuous"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/><mimic joint="j1" multiplier="-2" offset="0.1"/><limit effort="1" velocity="1"/></joint>
<transmission name="t"><type>x</type><joint name="j1"/><actuator name="m"><mechanicalReduction>50</mechanicalReduction></actuator></transmission>
<gazebo reference="a"><mu1>0.2</mu1><plugin filename="libx.so"/></gazebo></robot>"""
    return [
        Case("robot.urdf", {"robot.urdf": rich, "meshes/x.stl": stl_binary()}),
        Case("robot.urdf", {"robot.urdf": bundled("planar_3r")}),
        Case("robot.urdf", {"robot.urdf": bundled("quadruped")}),
    ]


ROD = b"""<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="hand" default="false"/>
<xacro:macro name="rod" params="name mass:=1 **inner"><link name="${name}"><inertial><origin xyz="0.3 0 0"/><mass value="${mass}"/>
<inertia ixx="0.1" iyy="0.2" izz="${max(0.1, 0.25)}" ixy="0" ixz="0" iyz="0"/></inertial><xacro:insert_block name="inner"/></link></xacro:macro></robot>"""
XACRO = b"""<?xml version="1.0"?><robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="rod.xacro"/>
<xacro:property name="data" value="${xacro.load_yaml('data.yaml')}"/><xacro:property name="length" value="${data['length'] * 2}"/>
<xacro:arg name="mass" default="2"/><link name="base"/><xacro:rod name="rod" mass="$(arg mass)"><inner/></xacro:rod>
<joint name="hinge" type="revolute"><origin xyz="${length} 0 0"/><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/><limit lower="${-pi/2}" upper="${radians(80)}" effort="50" velocity="2"/></joint>
<xacro:if value="$(arg hand)"><link name="hand"/><joint name="mount" type="fixed"><parent link="rod"/><child link="hand"/></joint></xacro:if></robot>"""


def xacro() -> list[Case]:
    return [
        Case(
            "arm.urdf.xacro", {"arm.urdf.xacro": XACRO, "rod.xacro": ROD, "data.yaml": b"length: 0.2\nother: [1, 2]\n"}
        )
    ]


def xacro_in_urdf() -> list[Case]:
    named = XACRO.replace(b"arm.urdf.xacro", b"arm.urdf")
    declared = bundled("planar_2r").replace(b"<robot ", b'<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    return [
        *single("arm.urdf", declared),
        Case("arm.urdf", {"arm.urdf": named, "rod.xacro": ROD, "data.yaml": b"length: 0.2\n"}),
    ]


MJCF = b"""<mujoco model="all of it">
  <compiler angle="radian" eulerseq="zyx" boundmass="0.01" settotalmass="5" meshdir="."/>
  <option gravity="0 0 -9"><flag equality="enable"/></option>
  <default><joint armature="0.1"/><default class="k"><geom type="box" size="0.1 0.2 0.3" euler="1 2 3"/></default></default>
  <asset><mesh name="m" inertia="exact" vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 2 1 0 1 3 0 3 2 1 2 3"/>
    <mesh name="f" file="x.stl" scale="1 1 1"/><mesh name="o" file="x.obj"/><mesh name="h" file="x.msh"/></asset>
  <worldbody>
    <body name="a" pos="1 2 3" childclass="k"><freejoint name="f"/><geom/><site name="s" fromto="0 0 0 1 1 1" type="capsule"/>
      <frame xyaxes="1 0 0 0 1 1"><body name="b"><joint name="j" ref="0.1" range="-1 1" stiffness="2" springref="0.3"/>
        <joint name="k" type="slide" axis="1 1 0"/><geom class="main" type="capsule" size="0.1" fromto="0 0 0 1 0 0" mass="2"/>
        <geom type="mesh" mesh="m" density="10"/><geom type="mesh" mesh="f"/><geom type="mesh" mesh="o"/><geom type="mesh" mesh="h"/></body></frame></body>
    <body name="c"><inertial pos="0 0 1" mass="2" fullinertia="1 1 1 0 0.1 0"/><joint name="l" type="ball" damping="0.2"/></body>
  </worldbody>
  <tendon><fixed name="t" stiffness="3" springlength="0.4"><joint joint="j" coef="2"/><joint joint="k" coef="-1"/></fixed></tendon>
  <equality><joint joint1="k" joint2="j" polycoef="0.1 2 0 0 0"/><weld body1="b" body2="c" relpose="1 2 3 1 0 0 0"/></equality>
  <actuator><position joint="j" kp="3"/><motor joint="k" ctrlrange="-1 1" gear="4" armature="0.1"/></actuator>
  <keyframe><key name="home" qpos="1 2 3 1 0 0 0 0.1 0.2 1 0 0 0"/></keyframe>
</mujoco>"""
INCLUDING = b"""<mujoco model="m"><compiler autolimits="true"/><include file="parts/defaults.xml"/><worldbody><body name="a"><include file="parts/arm.xml"/>
<geom type="sphere" size="0.1" class="k"/></body></worldbody></mujoco>"""


def mjcf() -> list[Case]:
    parts = {
        "robot.xml": INCLUDING,
        "parts/defaults.xml": b'<mujocoinclude><default><default class="k"><geom mass="1"/><joint damping="1"/></default></default></mujocoinclude>',
        "parts/arm.xml": b'<mujocoinclude><joint name="j" range="-10 10"/><body name="b" pos="0 0 1"><joint name="k" axis="1 0 0"/><geom size="0.1"/></body></mujocoinclude>',
    }
    files = {"x.stl": stl_binary(), "x.obj": obj(), "x.msh": msh()}
    return [Case("robot.xml", {"robot.xml": MJCF, **files}), Case("robot.xml", parts)]


SDF = b"""<?xml version="1.0"?><sdf version="1.9"><world name="w"><gravity>0 0 -9</gravity><model name="arm" canonical_link="base"><pose>0 0 1 0 0 0</pose>
<link name="base"><inertial><mass>3</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz><ixy>0</ixy></inertia></inertial></link>
<link name="a"><pose relative_to="base">0 0 0.5 0 0 0.3</pose><inertial auto="false"><pose>0 0 0.1 0 0 0</pose><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>
<visual name="v"><geometry><mesh><uri>x.stl</uri><scale>1 1 1</scale></mesh></geometry></visual><collision name="c"><geometry><box><size>1 1 1</size></box></geometry></collision></link>
<link name="b"><inertial><mass>1</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial></link>
<joint name="j" type="revolute"><parent>base</parent><child>a</child><axis><xyz expressed_in="base">0 1 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>9</effort><velocity>2</velocity></limit>
<dynamics><damping>1</damping><friction>0.1</friction><spring_stiffness>2</spring_stiffness></dynamics></axis></joint>
<frame name="f" attached_to="a"><pose relative_to="base" degrees="1">1 0 0 0 0 90</pose></frame>
<joint name="k" type="universal"><parent>f</parent><child>b</child><axis><xyz>1 0 0</xyz></axis><axis2><xyz expressed_in="base">0 1 0</xyz><mimic joint="j"><multiplier>2</multiplier><offset>0</offset></mimic></axis2></joint>
<joint name="w" type="fixed"><parent>world</parent><child>base</child></joint></model></world></sdf>"""


def sdf() -> list[Case]:
    return [Case("robot.sdf", {"robot.sdf": SDF, "x.stl": stl_binary()})]


def srdf() -> list[Case]:
    text = b"""<?xml version="1.0"?><robot name="ur5"><group name="arm"><chain base_link="base_link" tip_link="tool0"/></group>
<disable_collisions link1="base_link" link2="shoulder_link" reason="Adjacent"/><disable_collisions link1="forearm_link" link2="upper_arm_link" reason="x"/></robot>"""
    return single("robot.srdf", text)


USDA = b"""#usda 1.0
(
 defaultPrim = "arm"
 metersPerUnit = 1
 upAxis = "Z"
 subLayers = [@part.usda@]
)
def PhysicsScene "scene" {
vector3f physics:gravityDirection = (0, 0, -1)
float physics:gravityMagnitude = 9.81
}
def Xform "arm" (prepend apiSchemas = ["PhysicsArticulationRootAPI"])
{
def Xform "base" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{
double3 xformOp:translate = (0, 0, 0.5)
uniform token[] xformOpOrder = ["xformOp:translate"]
float physics:mass = 2
point3f physics:centerOfMass = (0, 0, 0.1)
float3 physics:diagonalInertia = (0.1, 0.1, 0.1)
quatf physics:principalAxes = (1, 0, 0, 0)
def Cube "shape" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
double size = 0.2
}
def Mesh "mesh"
{
int[] faceVertexCounts = [3, 3, 3, 3]
int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
}
}
def Xform "upper" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{
double3 xformOp:translate = (0, 0, 1)
quatf xformOp:orient = (1, 0, 0, 0)
uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
float physics:density = 100
def Sphere "shape" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
double radius = 0.1
}
}
def Xform "hand" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
prepend references = @part.usda@</hand>)
{
float physics:mass = 1
float3 physics:diagonalInertia = (0.01, 0.01, 0.01)
}
def PhysicsFixedJoint "fixed" {
rel physics:body1 = </arm/base>
point3f physics:localPos1 = (0, 0, 0)
quatf physics:localRot1 = (1, 0, 0, 0)
}
def PhysicsRevoluteJoint "elbow" (prepend apiSchemas = ["PhysicsDriveAPI:angular"])
{
rel physics:body0 = </arm/base>
rel physics:body1 = </arm/upper>
uniform token physics:axis = "Z"
point3f physics:localPos0 = (0, 0, 0.5)
float physics:lowerLimit = -90
float physics:upperLimit = 120
float drive:angular:physics:maxForce = 40
}
def PhysicsPrismaticJoint "slide"
{
rel physics:body0 = </arm/upper>
rel physics:body1 = </arm/hand>
uniform token physics:axis = "X"
float physics:lowerLimit = -0.1
float physics:upperLimit = 0.3
}
}
"""
PART = b"""#usda 1.0
(
 defaultPrim = "hand"
)
def Xform "hand" {
double3 xformOp:translate = (0, 0, 1.5)
uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def usda() -> list[Case]:
    return [Case("robot.usda", {"robot.usda": USDA, "part.usda": PART})]


def usdc() -> list[Case]:
    """The flattened stage in the binary format."""
    from pxr import Usd

    with tempfile.TemporaryDirectory() as folder:
        for name, data in usda()[0].files.items():
            Path(folder, name).write_bytes(data)
        made = Path(folder, "robot.usdc")
        Usd.Stage.Open(str(Path(folder, "robot.usda"))).Export(str(made))
        data = made.read_bytes()
    return [Case("robot.usdc", {"robot.usdc": data}), Case("robot.usd", {"robot.usd": data})]


def usdz() -> list[Case]:
    """A package: members stored without compression, with their data at multiples of 64 bytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, data in usda()[0].files.items():
            member = zipfile.ZipInfo(name)
            gap = -(out.tell() + 30 + len(name) + 4) % 64
            member.extra = struct.pack("<HH", 0x1986, gap) + bytes(gap)
            archive.writestr(member, data)
    return single("robot.usdz", out.getvalue())


# ── Actuators, catalogues, tables, sensors


def actuators() -> list[Case]:
    rich = b"""motors:
  m: {torque_constant: 0.07 N m/A, resistance: 1 ohm, inductance: 1 mH, voltage: 48 V, current_peak: 10 A, speed: 4000 rpm, thermal: {winding_housing: 2 K/W, housing_ambient: 5 K/W, winding_time: 12 s, housing_time: 600 s, maximum: 125 degC}}
actuators:
  elbow_joint: {ratio: 101:1, motor: m, efficiency: 0.8, rotor: {inertia: 20 g cm^2}, stiffness: 4000 N m/rad, friction: {viscous: 1 N m s/rad, coulomb: 2 N m, load: 0.05}}
  shoulder_lift_joint: {ratio: 100, motor: {torque_constant: 0.1 N m/A}, reflected_inertia: 0.5 kg m^2, link_friction: {coulomb: 1 N m}}
  w1: {motor: m, ratio: 10}
couplings:
  wrist: {motors: [w1, w2], joints: [wrist_1_joint, wrist_2_joint], motor_per_joint: [[101:1, 1], [1, -1]]}
log:
  side: motor
  joints:
    elbow_joint: {zero: 0.1 rad, sign: -1, gain: 0.1 N m/A}
"""
    return [
        Case("motors.yaml", {"motors.yaml": path_of("ur5").with_name("ur5_demo.yaml").read_bytes()}),
        *single("motors.yaml", rich),
    ]


def catalogue() -> list[Case]:
    return single("drives.yaml", path_of("ur5").with_name("ur5_demo.drives.yaml").read_bytes())


def limits() -> list[Case]:
    return [
        *single("limits.csv", b"joint,lower,upper,velocity,effort\njoint1,-1,1,2,3\njoint2,,,1.5,\n"),
        *single(
            "limits.csv",
            b"joint;lower [deg];upper [deg];velocity [deg/s];effort [N m]\njoint1;-10,5;100;20;3\njoint2;;;15;\n",
        ),
    ]


def factory_calibration() -> list[Case]:
    rows = "".join(f"delta_{name} = [ 0, 1.0e-4, -2e-4, 0, 0.0003, 0]\n" for name in ("theta", "a", "d", "alpha"))
    links = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    pose = "".join(f"    {name}: 0.1\n" for name in ("x", "y", "z", "roll", "pitch", "yaw"))
    kinematics = "kinematics:\n" + "".join(f"  {link}:\n{pose}" for link in links) + "  hash: calib_1\n"
    return [
        *single("calibration.conf", f"[mounting]\n# of a robot\n{rows}calibration_status = 0\n".encode()),
        *single("kinematics.yaml", kinematics.encode()),
    ]


def measurements() -> list[Case]:
    """Positions, poses, pairs and touches of a planar arm."""
    angles = [(0.1 * k, 0.5 + 0.13 * k) for k in range(8)]
    joints = [f"{a:.3f},{b:.3f}" for a, b in angles]
    places = [f"{np.cos(a) + np.cos(a + b):.4f},{np.sin(a) + np.sin(a + b):.4f},0.0" for a, b in angles]
    tables = {
        "positions.csv": ("joint1,joint2,x,y,z", [f"{q},{p}" for q, p in zip(joints, places, strict=True)]),
        "poses.csv": (
            "joint1 [deg],joint2 [deg],x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]",
            [f"{q},{p},0,0,{a + b:.3f}" for q, p, (a, b) in zip(joints, places, angles, strict=True)],
        ),
        "pairs.csv": ("joint1,joint2,distance,pair", [f"{q},0.25,{k ^ 1}" for k, q in enumerate(joints)]),
        "touches.csv": ("joint1,joint2,distance", [f"{q},1.5" for q in joints]),
    }
    return [Case(name, {name: "\n".join([header, *rows, ""]).encode()}) for name, (header, rows) in tables.items()]


def waypoints() -> list[Case]:
    return single("points.csv", b"joint1,joint2\n0.1,0.2\n0.3,0.4\n0.5,-0.1\n")


def column_map() -> list[Case]:
    log = b"stamp,p1,p2\n" + b"".join(b"%.2f,%.3f,%.3f\n" % (0.01 * k, 0.001 * k, -0.002 * k) for k in range(30))
    return [Case("map.csv", {"map.csv": b"name,column\njoint1,p1\njoint2,p2\ntime,stamp\n", "log.csv": log})]


def sensor() -> list[Case]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "sensor.json")
        made = tw.sensing.ForceTorqueSensor(tw.SpatialInertia.box((0.1, 0.1, 0.1), mass=1.0))
        write_sensor(made, path, (0.01, 0.1))
        plain = path.read_bytes()
    demo = Path(tw.__file__).parent / "sensing" / "demo_sensor.json"
    return [*single("sensor.json", plain), *single("sensor.json", demo.read_bytes())]


def readings() -> list[Case]:
    folder = Path(tw.__file__).parent / "sensing"
    poses, motion = ((folder / f"demo_{name}.csv").read_bytes().splitlines(True) for name in ("poses", "motion"))
    return [*single("log.csv", b"".join(poses[:12])), *single("log.csv", b"".join(motion[:25]))]
