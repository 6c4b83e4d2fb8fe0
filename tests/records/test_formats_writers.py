"""Writers of robot files, and edits of their text: complete answers on record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import refusal
from recorded_models import ShortRecords, rounded

from twistwrench import SpatialInertia
from twistwrench.formats import load_model, xml
from twistwrench.formats.actuators import add_actuators
from twistwrench.formats.edit import Edit, TextChanges, apply_edits, encode_as
from twistwrench.formats.robot_text import WrittenInertia, inertia_about_com, text_of
from twistwrench.formats.writers import SUFFIXES, WRITERS
from twistwrench.formats.writers.written import configurations_of, screw_of, translation
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.model import OfferedClosure
from twistwrench.mechanics.model.parts import disassemble

from .test_formats_mjcf import PLANT
from .test_formats_sdf import PRESS
from .test_formats_urdf import CRANE

records = ShortRecords(__file__)

TENSOR = np.array([[0.031, -0.002, 0.0013], [-0.002, 0.027, 0.0017], [0.0013, 0.0017, 0.022]])


def solid(mass, com=(0.0, 0.0, 0.0), scale=1.0):
    return SpatialInertia.from_com(mass, com, scale * TENSOR)


def placed(*screw):
    return se3.exp(np.array(screw))


def rig(root="frame", normal=(0.6, 0, 0.8)):
    """Robot of all joints, each written in another way."""
    builder = ModelBuilder("rig", "")
    builder.gravity = (0.5, -1.5, -9.25)
    builder.add_link(root, solid(20.0, (0.1, 0.2, 0.3), 30))
    builder.add_link("bracket", solid(1.5, (0.3, -0.2, 0.1)))
    builder.add_joint("bolt", "fixed", root, "bracket", placement=placed(0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    builder.add_link("mark")
    builder.add_joint("glue", "fixed", "bracket", "mark", placement=placed(0, 0, 0.2, 0.1, 0, 0))
    builder.add_link("arm", solid(3.5, (0.05, -0.06, 0.7)))
    builder.add_joint(
        "swing", "revolute", "bracket", "arm", placement=placed(0.2, -0.1, 0.3, 1, 2, 3), axis=(0, 0.6, 0.8, 0.3, 0.4, -0.3), lower=-1.5,
        upper=2.25, velocity=3.5, effort=70, acceleration=9, deceleration=11, jerk=90, damping=1.25, friction=2.5,
    )  # fmt: skip
    builder.add_link("plate", SpatialInertia.from_com(1.25, (0.1, 0, 0), np.diag([0.01, 0.02, 0.03])))
    builder.add_joint("lock", "fixed", "arm", "plate", placement=placed(0, 0.1, 0, 0, 0.2, 0))
    builder.add_link("nut", solid(0.75, (0.01, 0.02, 0.03)))
    builder.add_joint(
        "thread",
        "helical",
        "arm",
        "nut",
        axis=(0, 0, 1),
        pitch=0.02,
        upper=4.5,
        velocity=2,
        damping=0.5,
        armature=0.375,
    )
    builder.add_link("spare", hidden=True)
    builder.add_joint(
        "first", "revolute", "nut", "spare", placement=placed(0.1, 0, 0, 0, 0, 0.4), axis=(1, 0, 0), lower=-0.5
    )
    builder.add_link("wrist")
    builder.add_joint(
        "second",
        "prismatic",
        "spare",
        "wrist",
        placement=placed(0, 0.3, 0, 0.2, 0, 0),
        axis=(0, 0.8, -0.6),
        upper=0.5,
        effort=30,
    )
    builder.add_link("flange")
    builder.add_joint("between", "fixed", "wrist", "flange", placement=placed(0, 0, 0.4, 0, 0.1, 0))
    builder.add_link("tool", solid(0.5, (0.02, 0, 0.05), 0.3))
    builder.add_joint(
        "third",
        "continuous",
        "flange",
        "tool",
        placement=placed(0, 0, 0, 0.3, 0, 0.1),
        axis=(0, 0, 1, 0.1, 0.2, 0),
        velocity=5,
    )
    builder.add_link("knob", solid(0.25, (0.01, 0.02, 0)))
    builder.add_joint(
        "ball",
        "ball",
        "arm",
        "knob",
        placement=placed(0, 0.5, 0, 0, 0, 0.8),
        damping=0.125,
        friction=0.25,
        armature=0.0625,
    )
    builder.add_link("puck", solid(0.375, (0, 0.1, 0)))
    builder.add_joint(
        "glide",
        "planar",
        "frame" if root == "frame" else root,
        "puck",
        placement=placed(0.3, 0, 0, 1, 1, 1),
        axis=normal,
        damping=3,
    )
    builder.add_link("slave", solid(0.625))
    builder.add_joint(
        "follow", "revolute", "puck", "slave", axis=(0, 1, 0), lower=-1, upper=1, mimic=("thread", -0.5, 0.125)
    )
    builder.add_link("slave::two", solid(0.875))
    builder.add_joint("follow::two", "prismatic", "slave", "slave::two", axis=(0, 0, 1), mimic=("swing", 0.25, 0.0))
    builder.add_site("eye", "arm", placed(0.1, 0.2, 0, 0.3, 0, 0))
    builder.add_site("arm", "wrist", placed(0, 0, 0, 0.3, 0, 0.2))
    builder.add_site("foot", root, placed(0, 0, 0.5, 0.3, 0, 0))
    builder.add_spring({"swing": 2.0}, 40, 0.5)
    builder.add_spring({"swing": 1.0}, 30, -0.25)
    builder.add_spring({"second": -1.0}, 25)
    builder.add_spring({"thread": 1.5, "swing": -0.5}, 15, -0.75)
    builder.add_configuration(
        "home", {"swing": [0.5], "thread": [0.25], "ball": [0.6, 0.8, 0, 0], "glide": [0.1, 0.2, 0.3], "third": [1.5]}
    )
    builder.add_configuration("qpos0", {})
    builder.add_closure("pin", OfferedClosure("eye", "tool", "vx vy vz"))
    builder.add_closure("weld", OfferedClosure("site:arm", "foot"))
    builder.add_closure("slot", OfferedClosure("arm", "tool", "vx vy"))
    return builder


DRIVES = {
    "actuators": {
        "swing": {"ratio": 50, "rotor": {"inertia": "2 kg cm^2", "axis": [0.6, 0, 0.8]}, "friction": {"viscous": "0.5 N m s/rad", "coulomb": "2 N m", "static": "3 N m", "stribeck": "0.2 rad/s"},
            "link_friction": {"viscous": "0.25 N m s/rad", "coulomb": "0.5 N m", "load": 0.1}},
        "second": {"ratio": "20 rad/m", "friction": {"coulomb": "4 N"}, "reflected_inertia": "0.3 kg"},
        "first": {"ratio": 30, "rotor": {"inertia": "3 kg cm^2", "link": "nut"}, "stiffness": "500 N m/rad", "friction": {"viscous": "0.1 N m s/rad"}, "link_friction": {"coulomb": "0.3 N m"}},
    },
}  # fmt: skip
COUPLED = {
    "couplings": {
        "pair": {"motors": ["m1", "m2"], "joints": ["first", "third"], "motor_per_joint": [[10, 5], [0, 20]]}
    },
    "actuators": {
        "m1": {"effort": "3 N m", "reflected_inertia": "0.02 kg m^2"},
        "m2": {"friction": {"coulomb": "0.1 N m"}},
    },
}


def documents(model, forms=("urdf", "mjcf", "sdf")):
    answers = {}
    for form in forms:
        try:
            document = WRITERS[form](model)
        except Exception as error:
            answers[form] = f"{type(error).__name__}: {error}"
            continue
        lines = [line.strip() for line in rounded(document.text).splitlines()]
        answers[form] = {"text": "\n".join(lines), "lost": list(document.lost)}
    return answers


def joints_in(documents):
    """Documents without the lines of inertia, each line as it is."""
    skipped = (
        "<inertia",
        "</inertia",
        "<mass",
        "<ix",
        "<iy",
        "<iz",
        "<?xml",
        "<compiler",
        "</link",
        "</joint",
        "<pose>0.1 0.2 0.3 0 0 0<",
        '<origin xyz="0.1',
    )
    return {
        form: document
        if isinstance(document, str)
        else [[line for line in document["text"].splitlines() if not line.startswith(skipped)], document["lost"]]
        for form, document in documents.items()
    }


@records.of
def a_rig_of_all_joints_in_each_format():
    return joints_in(documents(rig().build(quiet=True, inertia="accept"))) | {"whole": documents(small(axis=(0, 0, 1)))}


@records.of
def a_driven_rig_in_each_format():
    model = rig().build(quiet=True, inertia="accept")
    answers = {}
    for name, drives in (("drives", DRIVES), ("coupled", COUPLED)):
        found = documents(add_actuators(model, drives))
        plain = documents(model)
        for form, document in found.items():  # what differs from the rig without drives
            before = set(plain[form]["text"].splitlines())
            changed = [line for line in document["text"].splitlines() if line not in before]
            answers[f"{name} {form}"] = [
                changed,
                [line for line in document["lost"] if line not in plain[form]["lost"]],
            ]
    return answers


def small(kind="revolute", root="base", floating=False, link=None, placement=None, site=True, **options):
    """Two links and one joint; ``link`` is the inertia of the second one."""
    builder = ModelBuilder("small")
    builder.add_link(root, solid(2.0, (0.1, 0, 0)))
    builder.add_link("b", solid(1.5, (0.1, 0.2, 0.3)) if link is None else link)
    builder.add_joint(
        "j", kind, root, "b", placement=placed(0, 0, 0.5, 0.1, 0.2, 0.3) if placement is None else placement, **options
    )
    if site:
        builder.add_site("s", root, placed(0, 0, 0, 0, 0.1, 0))
    return builder.build(floating_base=floating, quiet=True, inertia="accept")


@records.of
def roots_of_all_kinds_in_each_format():
    answers = {}
    for root in ("base", "world"):
        for floating in (False, True):
            answers[f"{root} {floating}"] = joints_in(documents(small(root=root, floating=floating, axis=(0, 1, 0))))
    for root in ("base", "world"):
        answers[f"fixed to {root}"] = joints_in(documents(small("fixed", root), ("mjcf", "sdf")))
        answers[f"floats off {root}"] = joints_in(documents(small("floating", root)))
        answers[f"floats at {root}"] = joints_in(
            documents(small("floating", root, placement=np.eye(4), damping=0.5, armature=0.25))
        )
        answers[f"ball at {root}"] = joints_in(documents(small("ball", root, site=False), ("sdf",)))
    model = small(root="world", floating=True)
    answers["driven root"] = joints_in(
        documents(replace(model, armature=np.r_[1, 2, 3, 4, 5, 6, 0.5]), ("mjcf", "sdf"))
    )
    empty = ModelBuilder("empty")
    empty.add_link("only")
    answers["empty"] = joints_in(documents(empty.build(quiet=True)))
    return answers


@records.of
def links_without_mass_between_joints():
    """Whether joints share a body in MJCF: links without mass, between joints of one and of several degrees."""
    answers = {}
    for first, second in (
        ("revolute", "prismatic"),
        ("prismatic", "ball"),
        ("ball", "revolute"),
        ("revolute", "planar"),
        ("fixed", "revolute"),
        ("revolute", "fixed"),
    ):
        for floating in (False, True):
            builder = ModelBuilder("between")
            builder.add_link("base", solid(2.0))
            builder.add_link("bare")
            builder.add_link("end", solid(1.0, (0.1, 0.2, 0.3)))
            builder.add_joint("one", first, "base", "bare", placement=placed(0.1, 0, 0, 0.1, 0.2, 0.3))
            builder.add_joint("two", second, "bare", "end", placement=placed(0, 0.2, 0, 0.3, 0, 0))
            if floating:
                builder.add_configuration("home", {"root_joint": [0.6, 0.8, 0, 0, 1, 2, 3]})
            document = WRITERS["mjcf"](builder.build(floating_base=floating, quiet=True, inertia="accept"))
            skipped = ("<inertial", "</", "<?xml", "<compiler", "<option")
            lines = [line.strip() for line in rounded(document.text).splitlines()]
            answers[f"{first} {second} {floating}"] = [
                [line for line in lines if not line.startswith(skipped)],
                document.lost,
            ]
    return answers


@records.of
def names_that_are_in_use():
    """Joints and links that have the names which writers would make for parts of their own."""
    builder = ModelBuilder("names")
    builder.add_link("base", solid(2.0))
    kinds = {
        "h": ("helical", {"axis": (0, 0, 1, 0.1, 0.2, 0.5)}), "h.slide": ("revolute", {"axis": (1, 0, 0, 0, 0.3, 0)}), "h.fixed": ("revolute", {}), "p": ("planar", {"axis": (0, 0, 1)}),
        "p.x": ("revolute", {}), "p.theta": ("prismatic", {}), "b": ("ball", {}), "b.y": ("revolute", {}), "base.fixed": ("prismatic", {}), "root_joint": ("revolute", {}),
    }  # fmt: skip
    links = ["n", "n:h", "n:h:h:slide", "world", "base.site", "n:p.x", "q:b.x", "q", "s", "last"]
    parent = "base"
    for (name, (kind, options)), link in zip(kinds.items(), links, strict=True):
        builder.add_link(link, solid(1.0))
        builder.add_joint(name, kind, parent, link, **options)
        parent = link
    builder.add_site("base", "last")
    builder.add_site("base.fixed", "s")
    builder.add_closure("loop", OfferedClosure("base", "last"))
    return joints_in(documents(builder.build(quiet=True)))


@records.of
def limits_and_axes_in_each_format():
    cases = {
        "one side": {"lower": -1.0}, "other side": {"upper": 2.0}, "neither": {}, "velocity": {"velocity": 2.0}, "effort": {"effort": 3.0}, "jerk": {"jerk": 7.0},
        "acceleration": {"acceleration": 4.0}, "friction alone": {"friction": 0.5}, "armature alone": {"armature": 0.5},
    }  # fmt: skip
    answers = {}
    for kind in ("revolute", "continuous", "prismatic", "helical"):
        for name, options in cases.items():
            if kind == "continuous" and "upper" in options:
                continue
            if kind != "revolute" and name not in ("neither", "velocity", "other side", "armature alone"):
                continue
            options = {**options, "axis": (0.0, 0.6, -0.8), **({"pitch": 0.5} if kind == "helical" else {})}
            found = documents(small(kind, site=False, **options))
            shown = (
                "<joint ",
                "<axis",
                "<limit",
                "<dynamics",
                "<lower",
                "<upper",
                "<effort",
                "<velocity",
                "<damping",
                "<friction",
                "<drake",
                "<mimic",
                "<robot",
                "<sdf",
                "<xyz",
                "<screw",
            )
            answers[f"{kind} {name}"] = {
                form: [[line for line in document["text"].splitlines() if line.startswith(shown)], document["lost"]]
                for form, document in found.items()
            }
    answers["not unit"] = documents(small(axis=(0, 0, 2.0), normalise_axes=False))
    return answers


@records.of
def inertias_that_mujoco_does_not_compile():
    cases = {
        "none": SpatialInertia.zero(), "point": SpatialInertia.from_com(1.0, (0, 0, 0), np.zeros((3, 3))), "rod": SpatialInertia.from_com(1.0, (0, 0, 0), np.diag([1, 1, 0.0])),
        "flat": SpatialInertia.from_com(1.0, (0, 0, 0), np.diag([1.0, 2.0, 3.0])), "impossible": SpatialInertia.from_com(1.0, (0, 0, 0), np.diag([1.0, 2.0, 3.1])),
        "light": SpatialInertia.from_com(0.9e-14, (0, 0, 0), np.eye(3)), "less light": SpatialInertia.from_com(1.1e-14, (0, 0, 0), np.eye(3)),
        "thin": SpatialInertia.from_com(1, (0, 0, 0), 0.9e-14 * np.eye(3)), "less thin": SpatialInertia.from_com(1, (0, 0, 0), 1.1e-14 * np.eye(3)),
    }  # fmt: skip
    answers = {}
    for name, inertia in cases.items():
        for kind in ("revolute", "fixed"):
            document = WRITERS["mjcf"](small(kind, "world", link=inertia, site=False))
            answers[f"{name} {kind}"] = [
                [line.strip() for line in document.text.splitlines() if "<inertial" in line],
                document.lost,
            ]
    return answers


@records.of
def losses_of_read_models():
    models = {"crane": CRANE, "plant": PLANT, "press": PRESS}
    answers = {}
    for name, text in models.items():
        found = documents(load_model(text, quiet=True, inertia="accept"))
        answers[name] = {
            form: d if isinstance(d, str) else [len(d["text"].split()), *d["lost"]] for form, d in found.items()
        }
    return answers


@records.of
def screws_and_configurations_of_writers():
    parts = disassemble(rig().build(quiet=True, inertia="accept"))
    return {
        "screws": {joint.name: screw_of(joint) for joint in parts.joints if joint.joint.nv == 1},
        "configurations": configurations_of(parts),
        "translation": translation((1, 2, 3)),
        "suffixes": dict(SUFFIXES),
        "writers": list(WRITERS),
    }


# ── edits of a file's text


URDF = """<?xml version="1"?>
<robot name="r">
  <link name="a"/>
  <link name="b"><inertial>
      <origin xyz=" 0.1 0.2  0.3 " rpy="0.1 0.2 0.3"/><mass value='2'/>
      <inertia ixx="0.3" ixy="0.01" ixz="0.02" iyy="0.4" iyz="0.03" izz="0.5"/></inertial></link>
\t<link name="c"><inertial><mass value="1"/><inertia ixx="0.3" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.5"/></inertial></link>
  <link name="d"></link>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="k" type="fixed"><origin quat_xyzw="0 0 0 1"/><parent link="b"/><child link="c"/></joint>
  <joint name="l" type="continuous"><origin rpy="1 0 0"/><parent link="b"/><child link="d"/><dynamics damping="0.5"/></joint>
</robot>
"""
SDF = """<sdf version="1.8"><model name="m">
  <link name="a"/>
  <link name="b"><inertial><pose>0.1 0.2 0.3 0.4 0.5 0.6</pose><mass>2</mass><inertia><ixx>0.3</ixx><iyy>0.4</iyy></inertia></inertial></link>
  <link name="c"><inertial><pose rotation_format="quat_xyzw"/></inertial></link><link name="e"><inertial><pose>  </pose><mass>3</mass></inertial></link>
  <link name="d"><inertial><mass> </mass></inertial></link>
  <joint name="j" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz><dynamics><damping>0.5</damping></dynamics></axis>
    <drake:rotor_inertia>0.1</drake:rotor_inertia><drake:gear_ratio>4</drake:gear_ratio></joint>
  <joint name="u" type="universal"><parent>b</parent><child>c</child><axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>
  <joint name="f" type="fixed"><parent>c</parent><child>d</child></joint>
</model></sdf>
"""
MJCF = """<mujoco>
  <compiler angle="radian"{}/>
  <default><joint damping="0.5"/></default>
  <worldbody>
    <body name="a"><joint name="j" armature="0.1"/><inertial pos="0.1 0.2 0.3" mass="2" diaginertia="0.3 0.4 0.5" euler="0.1 0.2 0.3"/>
      <frame pos="0.1 0 0" zaxis="0 0.6 0.8"><joint name="k"/>
        <body name="b" euler="0.1 0.2 0.3" pos="1 2 3"><joint name="n" type="slide"/></body>
        <body name="c"><frame euler="0 0 1"><inertial pos="0.3 0.1 0" mass="0.5" fullinertia="0.3 0.4 0.5 0.01 0.02 0.03"/></frame><joint name="l"/></body></frame>
      <body name="d"><geom size="0.1"/><joint name="m"/></body></body>
  </worldbody>
</mujoco>
"""


def edited(text, model="m", **calls):
    """Text after calls of the editor, its lines that changed, or the error; wanted inertias, joints and poses are given."""
    root = xml.parse(text)
    robot = text_of(root, model, None)
    changes = TextChanges("records")
    try:
        if "links" in calls:
            robot.write_links(changes, calls["links"])
        for name, values in calls.get("joints", {}).items():
            robot.write_joint(changes, name, values)
        for name, T in calls.get("poses", {}).items():
            robot.write_pose(changes, name, T, "because")
        lines = set(text.splitlines())
        return [line for line in rounded(changes.apply(text)).splitlines() if line not in lines]
    except Exception as error:
        return f"{type(error).__name__}: {error}"


WANTED = solid(3.25, (0.2, -0.1, 0.4), 5)
FRICTION = {"viscous": 0.75, "coulomb": 0.125, "motor_inertia": 0.25}
POSE = placed(0.3, -0.2, 0.5, 1, 2, 3)


@records.of
def edits_of_urdf_text():
    zero = SpatialInertia.zero()
    answers = {f"inertia of {name}": edited(URDF, links={name: WANTED}) for name in "abcdz"}
    answers |= {f"nothing in {name}": edited(URDF, links={name: zero}) for name in "abc"}
    answers |= {f"friction of {name}": edited(URDF, joints={name: FRICTION}) for name in "jl"}
    answers |= {
        f"no friction of {name}": edited(URDF, joints={name: {"viscous": 0.0, "coulomb": 0.0}}) for name in "jl"
    }
    answers |= {f"pose of {name}": edited(URDF, poses={name: POSE}) for name in "bcd"}
    answers["all"] = edited(
        URDF, links={"b": WANTED, "c": zero, "d": WANTED}, joints={"j": FRICTION}, poses={"c": POSE}
    )
    answers["same"] = edited(URDF, joints={"l": {"viscous": 0.5}})
    answers["coulomb alone"] = [edited(text, joints={"j": {"coulomb": 0.75}}) for text in (URDF, SDF, MJCF.format(""))]
    text = text_of(xml.parse(URDF), "", None)
    answers["read"] = {name: text.inertia(name) for name in "abc"}
    answers["other"] = [
        text.parent("c"),
        text.parent("b"),
        text.assumed_parts("a"),
        text.share_left,
        text.noun,
        list(text.materials),
    ]
    return answers


@records.of
def edits_of_sdf_text():
    answers = {f"inertia of {name}": edited(SDF, links={name: WANTED}) for name in "abcdez"}
    answers |= {f"friction of {name}": edited(SDF, joints={name: FRICTION}) for name in ("j", "u.axis", "u.axis2")}
    answers["no friction"] = edited(SDF, joints={"j": {"viscous": 0.0}, "u.axis": {"viscous": 0.0, "coulomb": 0.0}})
    answers["no gear"] = edited(SDF.replace(">4<", ">0<"), joints={"j": FRICTION})
    text = text_of(xml.parse(SDF), "q", None)
    answers["read"] = {name: text.inertia(name) for name in "abc"}
    answers["assumed"] = {name: text.assumed_parts(name) for name in "abcde"}
    answers["other"] = [text.share_left, text.noun]
    two = SDF.replace("</sdf>", '<model name="n"><link name="q"/></model></sdf>')
    answers["models"] = [list(text_of(xml.parse(two), name, None).links) for name in ("m", "n")] + [
        refusal(lambda: text_of(xml.parse(two), "o", None))
    ]
    return answers


@records.of
def edits_of_mjcf_text():
    zero = SpatialInertia.zero()
    plain = MJCF.format("")
    answers = {f"inertia of {name}": edited(plain, links={name: WANTED}) for name in "abcdz"}
    answers |= {f"nothing in {name}": edited(plain, links={name: zero}) for name in "ac"}
    answers |= {f"friction of {name}": edited(plain, joints={name: FRICTION}) for name in "jklm"}
    answers["no friction"] = edited(
        plain, joints={name: {"viscous": 0.0, "coulomb": 0.0, "motor_inertia": 0.0} for name in "jk"}
    )
    answers |= {f"pose of {name}": edited(plain, poses={name: POSE}) for name in "abc"}
    settings = [
        ' inertiafromgeom="true"',
        ' settotalmass="9"',
        ' boundmass="4"',
        ' boundmass="3"',
        ' boundinertia="0.3"',
        ' boundinertia="0.1"',
        ' balanceinertia="true"',
        ' settotalmass="9" boundmass="0.75"',
    ]
    thin = SpatialInertia.from_com(3.25, (0, 0, 0), np.diag([0.2, 0.3, 0.6]))
    for setting in settings:
        for name, wanted in (("solid", WANTED), ("thin", thin)):
            lines = edited(MJCF.format(setting), links={"a": wanted})
            answers[f"{setting} {name}"] = [line.strip() for line in lines if '<body name="a"' not in line]
    text = text_of(xml.parse(plain), "", None)
    answers["read"] = {name: text.inertia(name) for name in "abc"}
    answers["other"] = [
        [text.parent(name) for name in "abcd"],
        text.noun,
        str(text.joint_element("k")),
        list(text.joints),
    ]
    return answers


@records.of
def written_inertias():
    place = {
        name: xml.Place(k, name)
        for k, name in enumerate(("mass", "x", "y", "z", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    }
    R = placed(0.3, 0.2, 0.1, 0, 0, 0)[:3, :3]
    written = WrittenInertia(2.0, np.array([0.1, 0.2, 0.3]), R, TENSOR, place, 7, "file.xml")
    fewer = replace(written, places={name: place[name] for name in ("mass", "ixx")})
    massless = replace(written, places={"ixx": place["ixx"]})
    doubled = TENSOR.copy()
    doubled[0, 0] *= 2
    almost = TENSOR.copy()
    almost[1, 1] += 1e-15
    heavier = inertia_about_com(3.0, written.com, R @ TENSOR @ R.T)
    shifted = inertia_about_com(2.0, written.com + np.array([0.5, 0.0, 0.0]), R @ doubled @ R.T)
    asymmetric = np.array([[1.0, 0.2, 0.3], [0.4, 2.0, 0.5], [0.6, 0.7, 2.5]])
    return {
        "inertia": written.inertia.parameters,
        "tensor edits": [written.tensor_edits(T) for T in (TENSOR, doubled, almost)],
        "without places": [fewer.tensor_edits(T) for T in (doubled, 2 * TENSOR)],
        "edits": [written.edits(G) for G in (written.inertia, heavier, shifted)],
        "edits without places": [fewer.edits(G) for G in (written.inertia, heavier, shifted)],
        "edits without a mass": [massless.edits(G) for G in (written.inertia, heavier)],
        "of inertia": [WrittenInertia.from_inertia(WANTED, 3, "f"), WrittenInertia.from_inertia(SpatialInertia.zero())],
        "symmetrised": inertia_about_com(2.0, np.array([0.1, 0.2, 0.3]), asymmetric).parameters,
    }


@records.of
def edits_of_any_text():
    text = "<?xml version='1'?>\n<a x = '1 2  3' y=\"4\" >\n\t<b z='5'/><c>\n  6 7\n</c>\r\n  <d   w='>'   />text<e></e></a>"
    edits = {
        "one number": [(Edit(xml.Place(0, "x", 1), "9"), "why")], "whole": [(Edit(xml.Place(0, "x"), "9"), "why")], "text": [(Edit(xml.Place(2, "", 1), "9"), "why")],
        "whole text": [(Edit(xml.Place(2), "9"), "why")], "put": [(Edit(xml.Place(1, "q"), "9", "put"), "why")], "put old": [(Edit(xml.Place(1, "z"), "9", "put"), "why")],
        "put open": [(Edit(xml.Place(0, "q"), "9", "put"), "why")], "remove": [(Edit(xml.Place(0, "y"), "", "remove"), "why")], "remove first": [(Edit(xml.Place(3, "w"), "", "remove"), "a--b-")],
        "two": [(Edit(xml.Place(0, "x", 0), "8"), "why"), (Edit(xml.Place(0, "y"), "9"), "why"), (Edit(xml.Place(1, "z"), "7"), "other")], "none": [],
        "too few": [(Edit(xml.Place(0, "x", 3), "9"), "why")], "gone": [(Edit(xml.Place(0, "q"), "9"), "why")], "remove gone": [(Edit(xml.Place(0, "q"), "", "remove"), "why")],
        "same twice": [(Edit(xml.Place(0, "x", 1), "8"), "why"), (Edit(xml.Place(0, "x"), "9"), "why")], "empty text": [(Edit(xml.Place(4), "9"), "why")],
    }  # fmt: skip

    def result(call):
        try:
            return call()
        except Exception as error:
            return f"{type(error).__name__}: {error}"

    answers = {name: result(lambda e=e: apply_edits(text, e)) for name, e in edits.items()}
    answers["added"] = apply_edits(text, [], additions={0: "<n/>", 1: "<m/>", 3: "<k/>", 4: "x"})
    answers["signed"] = apply_edits(text, edits["whole"], additions={2: "Y"}, signature="me")
    answers["blanks"] = apply_edits("\ufeff\n <ü a='1'/>", [(Edit(xml.Place(0, "a"), "2"), "ü")])
    declared = b'<?xml version="1.0" encoding="latin-1"?><a/>'
    answers["encoded"] = [
        list(encode_as("\ufeffü→", data))
        for data in (b"<a/>", b"\xef\xbb\xbf<a/>", b"\xff\xfe<", b"\xfe\xff<", declared)
    ]
    included = xml.parse("<a b='1'/>", "part.xml")
    answers["included"] = [
        refusal(lambda: TextChanges("x").set(included, "b", "2")),
        refusal(lambda: TextChanges("x").add(included, "2")),
    ]
    root = xml.parse(text)
    changes = TextChanges("me")
    changes.set(root, "x", "1.0 2 3e0")
    changes.set(root, "y", "five")
    changes.set(root.children[1], "", "6 8", "text")
    changes.set_child(root, "c", "6 9", "again")
    changes.set_child(root, "new", "10", "not used")
    changes.set(root.child("e"), "", "11")
    changes.remove(root.children[0], "z")
    changes.add(root, "<last/>")
    answers["changes"] = changes.apply(text)
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
