"""URDF, its XML and its sources: complete answers on record."""

from __future__ import annotations

import math
import os
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from recorded_answers import refusal
from recorded_models import ShortRecords, described

from twistwrench.core.errors import TwistWrenchError
from twistwrench.formats import format_of_file, load_model, source, urdf, usd_path, xml
from twistwrench.formats.known_elements import KNOWN, NO_MECHANICS, READ, LeftOut, unread
from twistwrench.formats.robot_file import RobotFile, file_of

records = ShortRecords(__file__)


def inertial(mass, xyz="", rotation="", tensor=(0.031, -0.002, 0.0013, 0.027, 0.0017, 0.022)):
    """Text of an <inertial>; without ``xyz`` and ``rotation`` it has no <origin>."""
    entries = " ".join(
        f'{name}="{value}"' for name, value in zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), tensor, strict=True)
    )
    attributes = (f'xyz="{xyz}" ' if xyz else "") + rotation
    origin = f"<origin {attributes}/>" if attributes else ""
    return f'<inertial>{origin}<mass value="{mass}"/><inertia {entries}/></inertial>'


CRANE = f"""<?xml version="1" ?>
<robot name=" yard crane " version="1.2">
  <material name="grey"/>
  <joint name="slew" type="revolute">
    <origin xyz="0.11 -0.23 0.37" rpy="0.21 -0.34 0.55"/>
    <parent link="foot"/><child link="tower"/><axis xyz="0.3 -0.4 1.2"/>
    <limit lower="-1.25" upper="2.5" velocity="1.75" effort="310" acceleration="4.5" deceleration="6.25" jerk="95"/>
    <dynamics damping="7.5" friction="3.25"/>
  </joint>
  <link name="foot">{inertial(41.0, "0.02 -0.03 0.05", 'rpy="0.1 0.2 -0.3"', (2.1, 0.11, -0.07, 1.9, 0.05, 2.6))}<visual/></link>
  <link name="tower">{inertial(23.5, "-0.04 0.06 0.81", 'quat_xyzw="0.2 -0.4 0.4 0.8000001"', (1.3, 0.04, 0.09, 1.1, -0.06, 0.7))}
    <collision/><collision/></link>
  <link name="boom">{inertial(11.25, "0.9 0.015 -0.02", "", (0.21, 0.011, -0.013, 1.7, 0.007, 1.8))}</link>
  <joint name="luff" type="continuous">
    <parent link="tower"/><child link="boom"/><origin rpy="0 -0.7 0"/>
    <limit lower="-9" upper="9" velocity="0.875" effort="190"/><dynamics friction="1.5"/>
  </joint>
  <link name="trolley">{inertial(3.5, "", 'rpy="0.4 0.3 0.2"')}<visual/><collision/></link>
  <joint name="travel" type="prismatic">
    <parent link="boom"/><child link="trolley"/><origin xyz="0.4 0 -0.05"/><axis xyz="2 0.5 0"/>
    <limit upper="1.75" velocity="0.5" effort="1e16"/><dynamics damping="12.5"/>
  </joint>
  <link name="hoist">{inertial(1.75)}</link>
  <joint name="lower" type="prismatic">
    <parent link="trolley"/><child link="hoist"/><axis xyz="0 0.1 -1"/>
    <limit lower="-0.125"/><mimic joint="travel" multiplier="-0.75" offset="0.3"/>
  </joint>
  <link name="hook"/>
  <joint name="swivel" type="continuous"><parent link="hoist"/><child link="hook"/>
    <limit velocity="9e14" effort="55"/><mimic joint="luff"/></joint>
  <link name="crate">{inertial(5.25, "0.05 -0.07 0.09")}</link>
  <joint name="grip" type="fixed"><parent link="hook"/><child link="crate"/><origin xyz="0 0.06 -0.4" rpy="0 0 0.6"/>
    <axis xyz="junk"/><limit lower="junk"/></joint>
  <link name="lamp">{inertial(0.75, "0.01 0.02 -0.03")}</link>
  <joint name="sway" type="planar"><parent link="boom"/><child link="lamp"/><axis xyz="0.2 1 0.3"/>
    <dynamics damping="0.25" friction="0.125"/></joint>
  <link name="bird">{inertial(0.25, "0.01 0 0.02", "", (0.0031, 0.0002, -0.0001, 0.0027, 0.0003, 0.0022))}</link>
  <joint name="perch" type="floating"><origin xyz="0.5 0.6 0.7" rpy="0.3 0 0"/><parent link="lamp"/><child link="bird"/>
    <axis xyz="junk"/></joint>
  <link name="cab">{inertial(2.5, "0.1 0.2 0.3")}</link>
  <joint name="turn" type="revolute"><parent link="tower"/><child link="cab"/><axis xyz="0 0 -3"/></joint>
  <constraint name="stay" type="revolute_joint"><parent link="tower"/><child link="hoist"/>
    <parent_origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><parent_axis xyz="0.6 0 0.8"/>
    <child_origin xyz="-0.3 0.2 -0.1" quat_xyzw="0.5 0.5 -0.5 0.5"/></constraint>
  <constraint name="rail" type="prismatic"><parent link="boom"/><child link="crate"/><child_origin xyz="0.7 0 0"/></constraint>
  <constraint name="knob" type="spherical_joint"><parent link="cab"/><child link="hook"/><parent_axis xyz="0 1 0"/></constraint>
  <constraint name="seam" type="link"><parent link="cab"/><child link="boom"/><parent_origin rpy="0 0 1"/></constraint>
  <constraint name="loose" type="cylindrical_joint"><parent link="cab"/><child link="boom"/></constraint>
  <constraint name="half" type="link"><parent link="cab"/></constraint>
  <constraint type="link"><parent link="cab"/><child link="boom"/></constraint>
  <constraint name="no parent" type="link"><parent/><child link="boom"/></constraint>
  <loop_joint name="x"/><transmission><actuator><drake:rotor_inertia value="0.3"/></actuator></transmission>
  <gazebo reference="boom"><turnGravityOff>true</turnGravityOff><gravity>1</gravity></gazebo>
</robot>
"""


def simple(joint, links=None, name="r"):
    """Robot of two links with the inside of one joint, which is revolute unless it says so itself."""
    links = links or f'<link name="a"/><link name="b">{inertial(1.5, "0.1 0.2 0.3")}</link>'
    if not joint.startswith("<joint"):
        joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/>{joint}</joint>'
    return f'<robot name="{name}">\n{links}\n{joint}\n</robot>'


LIMIT = '<limit lower="-1" upper="2" velocity="3" effort="4"/>'


@records.of
def a_crane_of_all_joints_and_constraints():
    return described(load_model(CRANE, quiet=True))


@records.of
def the_crane_by_option():
    options = {
        "floating": {"floating_base": True},
        "held": {"floating_base": False},
        "locked": {"lock": {"travel": 0.375, "slew": -0.5}},
        "tip": {"tip": "cab"},
        "independent": {"mimic": "independent"},
        "gravity": {"gravity": (0.5, -9.0, 1.25)},
        "no snap": {"snap": 0.0},
        "much snap": {"snap": 0.06},
    }
    shown = ("tip", "joints", "leaves", "limits", "gravity", "snap", "mounted", "locked", "mounts", "base")
    answers = {}
    for name, kept in options.items():
        answer = described(load_model(CRANE, quiet=True, **kept))
        own = {key: answer.get(key) for key in shown}
        if name != "no snap":
            own.pop("mounts")
        answers[name] = own | {"placements": [body.get("placement") for body in answer["bodies"]][::3]}
        answers[name]["inertia"] = answer["bodies"][-1].get("inertia")
    return answers


@records.of
def snapped_frames_of_inertia_and_joints():
    almost = 'rpy="0 0 1.5608"'  # 0.01 from a quarter of a turn
    text = simple(
        f'<origin {almost}/><axis xyz="0 0 1"/>{LIMIT}',
        f'<link name="a"/><link name="b">{inertial(1.5, "1 2 3", almost)}</link>',
    )
    answers = {}
    for snap in (0.0, 1e-9, 0.0099, 0.0101, 0.05):
        body = load_model(text, snap=snap, quiet=True).bodies[0]
        answers[str(snap)] = [np.asarray(body.placement)[:2, :2], np.asarray(body.inertia.parameters)]
    return answers


@records.of
def limits_on_both_sides_of_none():
    answers = {}
    for kind in ("revolute", "prismatic", "continuous"):
        for limit in (
            "", "<limit/>", '<limit lower="-2"/>', '<limit upper="3"/>',
            '<limit lower="-999999999999999" upper="999999999999999" velocity="50" effort="999999999999999"/>',
            '<limit lower="-1e15" upper="1e15" velocity="1e15" effort="1e15" acceleration="1e15" jerk="1e15"/>',
            '<limit lower="-1e15" upper="1" velocity="2" effort="3" acceleration="4"/>',
            '<limit lower="-1" upper="1e16" velocity="2" deceleration="4" jerk="5"/>',
        ):  # fmt: skip
            joint = f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{limit}</joint>'
            answer = described(load_model(simple(joint), quiet=True))
            answers[f"{kind} {limit}"] = [answer.get("limits"), answer.get("notes")]
    return answers


@records.of
def roots_with_and_without_a_world():
    answers = {}
    for parent, kind in (("world", "fixed"), ("world", "revolute"), ("base", "fixed")):
        links = f'<link name="{parent}"/><link name="b">{inertial(1.5, "0.1 0.2 0.3")}</link>'
        joint = f'<joint name="j" type="{kind}"><parent link="{parent}"/><child link="b"/>{LIMIT}</joint>'
        for floating in (None, False, True):
            answer = described(load_model(simple(joint, links, name=" "), floating_base=floating, quiet=True))
            answers[f"{parent} {kind} {floating}"] = {
                key: answer.get(key) for key in ("name", "mounted", "joints", "mounts", "notes", "base", "tip")
            }
    return answers


@records.of
def refused_urdf():
    ab = '<link name="a"/><link name="b"/>'
    quat = '<origin xyz="1 2 3" quat_xyzw="{}"/>'
    texts = {
        "unknown type": simple('<joint name="j" type="ball"><parent link="a"/><child link="b"/></joint>'),
        "no type": simple('<joint name="j"><parent link="a"/><child link="b"/></joint>'),
        "no name": simple('<joint type="fixed"><parent link="a"/><child link="b"/></joint>'),
        "no parent": simple('<joint name="j" type="fixed"><child link="b"/></joint>'),
        "no child": simple('<joint name="j" type="fixed"><parent link="a"/></joint>'),
        "no link of parent": simple('<joint name="j" type="fixed"><parent/><child link="b"/></joint>'),
        "two axes": simple('<axis xyz="1 0 0"/><axis xyz="0 1 0"/>'),
        "axis of zeros": simple(f'<axis xyz="0 0 0"/>{LIMIT}'),
        "axis of two": simple('<axis xyz="0 1"/>'),
        "axis without xyz": simple("<axis/>"),
        "word": simple('<limit lower="abc"/>'),
        "comma": simple('<limit lower="1,5"/>'),
        "nan": simple('<limit lower="nan"/>'),
        "inf": simple('<limit upper="-Inf"/>'),
        "large": simple('<limit upper="1e61"/>'),
        "empty": simple('<limit upper=" "/>'),
        "reversed": simple('<limit lower="2" upper="1"/>'),
        "damping": simple('<dynamics damping="x"/>'),
        "mimic without joint": simple("<mimic/>"),
        "mimic of itself": simple('<mimic joint="j"/>'),
        "no mass": simple("", '<link name="a"/><link name="b"><inertial><inertia/></inertial></link>'),
        "no inertia": simple("", '<link name="a"/><link name="b"><inertial><mass value="1"/></inertial></link>'),
        "mass without value": simple("", '<link name="a"/><link name="b"><inertial><mass/><inertia/></inertial></link>'),
        "two inertials": simple("", f'<link name="a"/><link name="b">{inertial(1)}\n{inertial(1)}</link>'),
        "link without name": simple("", "<link/>"),
        "two links": simple("", '<link name="a"/>\n<link name="a"/>'),
        "both rotations": simple('<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>', ab),
        "long quaternion": simple(quat.format("0 0 0 1.0011"), ab),
        "short quaternion": simple(quat.format("0 0 0.9989 0"), ab),
        "axis of constraint": simple(LIMIT)[:-8]
        + '<constraint name="c" type="prismatic"><parent link="a"/><child link="b"/><parent_axis xyz="0 0 0"/></constraint></robot>',
        "link of constraint": simple(LIMIT)[:-8]
        + '<constraint name="c" type="link"><parent link="a"/><child link="q"/></constraint></robot>',
    }  # fmt: skip
    return {name: refusal(lambda text=text: load_model(text, quiet=True)) for name, text in texts.items()}


@records.of
def quaternions_about_as_long_as_one():
    lengths = {"short": 0.99902, "exact": 1.0, "long": 1.00098}
    answers = {}
    for name, length in lengths.items():
        xyzw = " ".join(str(length * x) for x in (0.1, -0.5, 0.7, 0.5))
        text = simple(f'<origin quat_xyzw="{xyzw}"/>{LIMIT}')
        answers[name] = load_model(text, quiet=True, snap=0).bodies[0].placement
    return answers


@records.of
def rotations_of_urdf():
    angles = [(0.3, -0.7, 2.1), (-2.9, 1.2, -0.4), (0.5, math.pi / 2, 0.0), (0.25, -1.5, 3.1)]
    rotations = [urdf.rotation_of_rpy(rpy) for rpy in angles]
    up = np.array([[0.0, 0.6, 0.8], [0.0, 0.8, -0.6], [-1.0, 0.0, 0.0]])
    vectors = [
        (0.36, -0.48, 0.8),
        (0.48, 0.6, -0.64),
        (0, 0, 1.0),
        (0, 0, -1.0),
        (0.6, 0, 0.8),
        (3e-11, 0, 1.0),
        (0, -4e-11, -1.0),
        (2e-10, 0, -1.0),
    ]
    return {
        "matrices": rotations,
        "angles": [urdf.rpy_of_rotation(R) for R in (*rotations, up, up.T @ up, -up @ np.diag([1.0, 1.0, -1.0]))],
        "to": [urdf.rotation_of_z_axis_to(np.array(vector)) for vector in vectors],
        "entries": urdf.entries_of(np.arange(9.0).reshape(3, 3) + 0.5),
        "tensor": urdf.tensor_of({"ixx": 1.5, "ixy": 2.5, "ixz": 3.5, "iyy": 4.5, "iyz": 5.5, "izz": 6.5}.__getitem__),
    }


@records.of
def short_directions():
    element = xml.parse('<robot name="n"><axis xyz="0 0 1e-14"/></robot>').children[0]
    just_long = urdf.direction(element, "xyz", (0.0, 1.5e-14, 2e-14))
    return [
        just_long,
        refusal(lambda: urdf.direction(element, "xyz", (0, 0, 1e-14))),
        refusal(lambda: urdf.direction(element, "axis", (math.nan, 0, 1))),
    ]


# ── options, formats and messages of the loader


@records.of
def refused_calls_of_the_loader(folder):
    text = simple(LIMIT)
    file = folder / "robot.urdf"
    file.write_text(text)
    (folder / "part.xml").write_text("<mujocoinclude/>")
    (folder / "page.html").write_text("\n<html><robot/></html>")
    mjcf = "<mujoco><worldbody/></mujoco>"
    sdf = '<sdf version="1.8"><model name="m"><link name="l"/></model></sdf>'
    calls = {
        "format": (text, {"format": "xml"}),
        "format of urdf": (text, {"format": "mjcf"}),
        "format of file": (file, {"format": "sdf"}),
        "keep in urdf": (text, {"keep": "a"}),
        "keep in sdf": (sdf, {"keep": "l"}),
        "model in urdf": (text, {"model": "r"}),
        "model in mjcf": (mjcf, {"model": "r"}),
        "bodies": (text, {"max_bodies": 1}),
        "bodies of half": (text, {"max_bodies": 1.5}),
        "include": (folder / "part.xml", {}),
        "page": (folder / "page.html", {}),
        "arguments": (text, {"xacro": {"a": 1}}),
        "true without xacro": (file, {"xacro": True, "mimic": "x"}),
        "xacro": (text.replace('lower="-1"', 'lower="${2}"'), {}),
        "xacro element": (text.replace("<link", "<xacro:if/><link", 1), {}),
        "xacro name": (text.replace('name="r"', 'name="$(arg n)"'), {}),
        "wrong xacro": (text, {"xacro": [1]}),
        "wrong value": (text, {"xacro": {"a": [1]}}),
        "wrong name": (text, {"xacro": {1: "a"}}),
        "mimic": (text, {"mimic": "copy"}),
        "inertia": (text, {"inertia": "no"}),
        "snap": (text, {"snap": 0.125}),
        "gravity": (text, {"gravity": (1, 2)}),
        "tip": (text, {"tip": "c"}),
        "lock": (text, {"lock": {"k": 1}}),
        "root_joint": (text.replace('"j"', '"root_joint"'), {"floating_base": True}),
        "no usd": (folder / "robot.USD", {}),
    }  # fmt: skip
    return {name: refusal(lambda s=s, o=o: load_model(s, quiet=True, **o)) for name, (s, o) in calls.items()}


@records.of
def formats_and_paths(folder):
    texts = {"a.xml": simple(LIMIT), "b.urdf": "<mujoco/>", "c": "\ufeff <sdf/>"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    names = [
        "a.usd",
        "a.USDA",
        "b.usdc",
        "c.usdz",
        "d.usd.urdf",
        "<usd>.usd",
        " <a/>",
        "\ufeff<a/>",
        "\t\r\n<",
        "a<",
        "",
    ]
    robot = RobotFile.from_path(folder / "a.xml")
    other = RobotFile.from_path(folder / "a.xml", data=b"<robot name='given'/>")
    model = load_model(robot, quiet=True)
    return {
        "formats": {name: format_of_file(folder / name) for name in texts} | {"usd": format_of_file(Path("x.usda"))},
        "usd": {name: None if usd_path(name) is None else str(usd_path(name)) for name in names},
        "path of usd": [usd_path(3), str(usd_path(Path("x.usd")))],
        "text": {name: source.is_text(name) for name in names} | {"path": source.is_text(Path("<a"))},
        "robot file": [
            robot.root.tag,
            RobotFile.from_path(robot) is robot,
            len(robot.data),
            len(robot.text),
            robot.xacro,
        ],
        "given data": [other.root.attributes, other.parse_root(7) is other.root],
        "pickled": [str(part) for part in robot.__reduce__()[1]],
        "file of model": file_of(model) is robot,
        "file of text": file_of(load_model(simple(LIMIT), quiet=True)),
        "data": load_model(folder / "a.xml", data=simple(LIMIT, name="of data").encode(), quiet=True).name,
        "source": str(load_model(folder / "a.xml", quiet=True).source),
    }


# ── XML


@records.of
def elements_and_their_names():
    text = """

<?xml version='1'?>
<a name="top"><b reference="ref"><c x="1"/><c/></b><d name="d2" y="&lt;1&gt;">  text <e/> more </d>
<long name="{0}"><f/></long><{0}/></a>""".format("n" * 130)
    root = xml.parse(text)
    parts = list(root.walk())
    included = xml.parse("<a>\n<b/></a>", "common/parts.xml")
    copy = root.deep_copy()
    copy.children[0].attributes["reference"] = "other"
    made = xml.new("made", None, "some text", z="3")
    return {
        "names": [str(part) for part in parts],
        "places": [part.place for part in (*parts, included.children[0], made)],
        "index": [part.index for part in parts],
        "lines": [part.line for part in parts],
        "content": [part.content for part in parts],
        "children in": [str(part) for part in root.children_in("b")],
        "all": [len(root.children[0].all("c")), root.child("d").tag, root.child("q")],
        "copy": [*[str(part) for part in copy.walk()][:4], str(root.children[0].attributes)],
        "made": [str(made), made.attributes, made.content],
        "with": [
            parts[1].with_attributes({"name": "q"}).children == parts[1].children,
            str(parts[1].with_attributes({"name": "q"})),
        ],
        "place": [parts[2].locate("x", 3), parts[0].locate()],
        "text": xml.xml_text(root).splitlines(),
        "error": refusal(lambda: root.children[0].child("c")),
        "required": refusal(lambda: root.require_child("z", "<z/>")),
    }


@records.of
def values_of_attributes():
    element = xml.parse(
        '<e name="n" one=" 1.5 " many="1 -2 +3.5e0 .5 4." none="" word=" true " big="1e60" over="-1.1e60 1" '
        f'bad="1 2..5" hex="0x10" long="{"7" * 61}" comma="1,5 2" nan="-nan" infinite="1 +infinity"/>'
    )
    names = list(element.attributes)
    return {
        "number": {name: _value(lambda name=name: element.number(name)) for name in [*names, "gone"]},
        "optional": [element.optional_number("gone"), element.optional_number("one")],
        "values": {name: _value(lambda name=name: element.values(name, 5)) for name in names},
        "one value": _value(lambda: element.numbers("many", 4)),
        "floats": {name: _value(lambda name=name: element.floats(name, (9.0, 8.0, 7.0))) for name in [*names, "gone"]},
        "few floats": [element.floats("one", (9.0, 8.0, 7.0)), element.floats("many", (9.0,) * 7)],
        "text": {name: _value(lambda name=name: element.text(name)) for name in ("one", "none", "gone")},
        "word": [_value(lambda d=d: element.word("word", ("true", "auto"), d)) for d in ("auto", "x")],
        "default word": [_value(lambda d=d: element.word("gone", ("true", "auto"), d)) for d in ("auto", "x")],
        "flag": [
            element.flag("word", default=False),
            element.flag("gone", default=True),
            element.flag("gone", default=False),
        ],
        "wrong flag": _value(lambda: element.flag("one", default=True)),
    }


def _value(call):
    """Result of a call, or the text of its error."""
    try:
        return call()
    except TwistWrenchError as error:
        return str(error)


@records.of
def numbers_as_text():
    values = [
        0.0,
        -0.0,
        3.0,
        -2.0,
        0.1,
        1e15,
        999999999999999.0,
        1e16,
        1.5e-7,
        1 / 3,
        2e300,
        -1e15,
        -4e17,
        -999999999999999.0,
    ]
    return [xml.figures(values), xml.exact(values), xml.figures([[1, 2], [3, 4.5]])]


@records.of
def refused_xml():
    deep = "<frame>" * 1003 + "</frame>" * 1003
    texts = {
        "empty": " \n",
        "no xml": "\n  robot: arm of steel and more",
        "comment": "<!-- nothing -->",
        "not closed": "<robot>\n\n<link></robot>",
        "entity": '<!DOCTYPE r [\n<!ENTITY a "b">]><robot/>',
        "other document": '\n<!DOCTYPE r SYSTEM "http://x"><robot/>',
        "deep": f"<robot>{deep}</robot>",
    }
    return {name: refusal(lambda text=text: xml.parse(text, max_bodies=1)) for name, text in texts.items()} | {
        "bodies": refusal(lambda: xml.parse("<r><link/><body/>\n<link/></r>", "f.xml", max_bodies=1)),
        "character": refusal(lambda: xml.xml_text(xml.new("a", None, "x\n y\x01z\nw"))),
        "many parts": [
            refusal(lambda tag=tag: xml.parse("<r>" + f"<{tag}/>" * 20_001 + "</r>", max_bodies=7))
            for tag in ("frame", "geom", "site", "link", "body")
        ],
        "elements": refusal(lambda: xml.parse("<a>" + "<b/>" * 1_000_001)),
    }


@records.of
def accepted_xml():
    one_less = "<frame>" * 1000 + "</frame>" * 1000
    answers = {
        "deep": len(list(xml.parse(f"<robot>{one_less}</robot>", max_bodies=1).walk())),
        "frames": len(xml.parse("<r>" + "<geom/>" * 30 + "</r>", max_bodies=3).children),
        "bodies": len(xml.parse("<r><link/><link/><body/><body/></r>", max_bodies=2).children),
        "doctype": xml.parse("<!DOCTYPE robot><robot/>").tag,
        "declaration": [
            xml.without_loose_declaration(text)
            for text in (
                "<?xml version='1' encoding='x'?><a/>",
                '<?xml version="1"?><?xml version="1"?>',
                '<?xml version="1.0"?>',
                "<a>",
            )
        ],
    }
    for root in ("robot", "mujoco", "mujocoinclude", "sdf"):
        tree = xml.parse(f"<{root}>one<a>two</a><gravity>three</gravity><b>four</b></{root}>")
        answers[root] = [part.content for part in tree.walk()]
    for tag in ("gazebo", "kinematic"):
        answers[tag] = [part.content for part in xml.parse(f"<robot>one<{tag}><a>two</a></{tag}>x</robot>").walk()]
    deep = xml.new("a")
    inner = deep
    for _ in range(63):
        inner = xml.new("b", inner)
    xml.new("c", inner, 'x & "y" <z>', q='"<&')
    answers["indent"] = list(xml.xml_text(deep).splitlines()[59:68])
    return answers


# ── sources


@records.of
def texts_of_files():
    declared = '<?xml version="1.0" encoding="{}"?>\n<robot name="Grün"/>'
    data = {
        "plain": "<robot name='ü'/>".encode(),
        "mark": b"\xef\xbb\xbf<a/>",
        "utf-16 little": "\ufeff<a b='ü'/>".encode("utf-16-le"),
        "utf-16 big": "\ufeff<a b='ü'/>".encode("utf-16-be"),
        "latin-1": declared.format("latin-1").encode("latin-1"),
        "cp1252": declared.format("windows-1252").encode("cp1252"),
        "bad byte": b"<a>\n\n<b c='\xfc'/></a>",
        "unknown": declared.format("klingon").encode(),
        "not text": declared.format("punycode").encode(),
        "escape": declared.format("unicode-escape").encode(),
        "odd utf-16": b"\xff\xfe<\x00a",
    }
    return {name: _value(lambda d=d: source.decode_text(d, "robot.urdf")) for name, d in data.items()}


@records.of
def missing_files(folder):
    nested = folder / "nested"
    nested.mkdir()
    for name in (
        "arm.urdf",
        "arm2.urdf",
        "arm3.urdf",
        "arms.urdf",
        "base.sdf",
        "notes.txt",
        "x.usda",
        "y.xml",
        "z.XACRO",
    ):
        (folder / name).write_text("x")
    for number in range(14):
        (nested / f"robot{number:02}.urdf").write_text("x")
    (folder / "empty").mkdir()
    paths = {
        "similar": folder / "arm1.urdf",
        "unlike": folder / "qqqqqqqqqqqqqqqqqqq",
        "folder": folder,
        "full folder": nested,
        "empty folder": folder / "empty",
        "in empty": folder / "empty" / "a.urdf",
        "no folder": folder / "gone" / "a.urdf",
        "bundled": folder / "empty" / "UR5.urdf",
        "long": "n" * 300,
        "nul": "a\0b",
        "lines": "a\nb",
        "blank": "  ",
        "number": 3,
    }
    return {name: refusal(lambda p=p: source.read_robot_text(p)) for name, p in paths.items()} | {
        "not text": refusal(lambda: source.read_robot_text(folder / "arm.urdf") and load_model(folder / "arm.urdf")),
        "name": source._bundled_robot_hint(Path("nobody7")),
        "bundled name": source._bundled_robot_hint(Path("Panda")),
        "no word": source._bundled_robot_hint(folder / "nobody7"),
        "standard input": [
            _standard_input(data) for data in (b"\n<robot/>", b"robot", b" ", b"\xff\xfe<\x00r\x00/\x00>\x00")
        ],
        "size": [refusal(lambda: source._check_size(2**26 + 1, "x")), source._check_size(2**26, "x")],
    }


def _standard_input(data):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source, "read_standard_input", lambda largest: data if largest == 2**26 else b"")
        return _value(source.standard_input_text)


@records.of
def meshes_of_a_robot(folder):
    package = folder / "ws" / "my_arm"
    files = [
        "ws/my_arm/package.xml", "ws/my_arm/urdf/arm.urdf", "ws/my_arm/meshes/a.stl", "ws/my_arm/meshes/a b.obj",
        "ws/my_arm/meshes/a.txt", "ws/other/b.stl", "ws/other/meshes/b.stl", "far/share/third/c.dae", "ros/fourth/d.ply",
        "lone/robots/arm.urdf", "lone/meshes/e.stl", "f.stl", "ws/old/manifest.xml", "ws/old/g.stl", "ws/old/deep/er/r.urdf",
    ]  # fmt: skip
    for name in files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("solid")
    (package / "meshes" / "out.stl").symlink_to(folder / "f.stl")
    arm, lone, old = package / "urdf" / "arm.urdf", folder / "lone/robots/arm.urdf", folder / "ws/old/deep/er/r.urdf"
    asked = {
        arm: [
            "package://my_arm/meshes/a.stl", " model://my_arm/meshes/a%20b.obj ", "package://my_arm/meshes/a.txt", "package://other/b.stl",
            "package://my_arm/meshes/out.stl", "package://my_arm", "package://../other/b.stl", "package:///my_arm/meshes/a.stl",
            "package://third/c.dae", "package://fourth/d.ply", "package://other/../my_arm/meshes/a.stl", "../meshes/a.stl",
            "../../other/b.stl", f"file://{package}/meshes/a.stl", f"file://{folder}/f.stl", f"file://{folder}/far/share/third/c.dae",
            "http://x/a.stl", "", "../meshes/out.stl", "../meshes/gone.stl", "a\0.stl", "package://my_arm//meshes/a.stl",
        ],
        lone: ["../meshes/e.stl", "../../f.stl", f"file://{folder}/f.stl"],
        old: ["../../g.stl", "../../../other/b.stl", "package://old/g.stl", "package://other/meshes/b.stl"],
    }  # fmt: skip
    answers = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(folder / "home"))
        for ros in (False, True):
            patch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(["", str(folder / "ros")]) if ros else "")
            patch.setenv("AMENT_PREFIX_PATH", str(folder / "far") if ros else "")
            for file, names in asked.items():
                for name in names:
                    found = source.find_resource(name, file)
                    answers[f"{ros} {file.parent.name} {name}"] = None if found is None else str(found)
        patch.setenv("HOME", str(folder / "lone" / "robots"))
        answers["in home itself"] = [source.find_resource("../meshes/e.stl", lone), source._package_folder([lone])]
        patch.setenv("HOME", str(folder / "ws"))
        answers["at home"] = str(source.find_resource("package://my_arm/meshes/a.stl", arm))
        answers["beside home"] = source.find_resource("package://other/b.stl", arm)
    return answers


# ── elements that are not read


@records.of
def the_table_of_elements():
    """The effects whole, and of the rest numbers of names, so that a line that moves is seen."""
    answers = {}
    for format_name, rows in KNOWN.items():
        for tag, row in rows.items():
            effects = {name: [entry.change, *entry.unless] for name, entry in row.items() if isinstance(entry, LeftOut)}
            read = [name for name, entry in row.items() if entry == READ]
            skipped = [name for name, entry in row.items() if entry == NO_MECHANICS]
            sums = [sum((k + 1) * sum(map(ord, name)) for k, name in enumerate(names)) for names in (read, skipped)]
            answers[f"{format_name} {tag}"] = [len(read), len(skipped), *sums, effects]
    return answers


@records.of
def notes_on_what_is_not_read():
    """One element of each row with all its names, in two values of which one may change nothing."""
    answers = {}
    for format_name, rows in KNOWN.items():
        if format_name == "USD":
            continue
        for tag in ("joint", "link", "gazebo", "compiler", "axis", "dynamics", "model", "physics"):
            for value in ("0", "0 5", "true", "-1 5", "-1.0", "auto false", "word") if tag in rows else ():
                row = rows[tag]
                names = [name for name in row if name != "*" and not name.startswith("<")]
                children = [name for name in row if name.startswith("<")]
                attributes = " ".join(f"{name}={quoteattr(value)}" for name in names if ":" not in name)
                inside = "".join(f"{name}{value}</{name[1:]}" for name in children)
                root = xml.parse(f"<sdf><{tag} {attributes}>{inside}</{tag}></sdf>")
                notes = unread(format_name, *root.children)
                if notes:
                    answers[f"{format_name} {tag} {value}"] = [" | ".join(notes)[:50], len(notes)]
    return answers


@records.of
def notes_on_what_is_unknown():
    text = """<robot name="r" colour="red" x:y="1"><linc/><mass/><link name="a" typo="1" physics:q="2"><inertia/><x:y/></link>
    <joint name="j" nam="1"><axis xyz="1 0 0" rpy="0 0"/><limit uper="1"/><limit uper="2" drake:acceleration="0"/>
    <limit drake:acceleration="2"/></joint><joint name="k"><dynamics armature="0.5" spring_stiffness="false"/></joint>
    <loop_joint/><loop_joint/><drake:joint/><compiler/><mujoco><compiler settotalmass="-1" inertiafromgeom="AUTO" balanceinertia="true" boundmass="0.0"/></mujoco>
    <link><gravity>1</gravity></link><link name="q"><gravity> </gravity><kinematic>0 0</kinematic></link><gazebo reference="q"><static value="1"/><anything/></gazebo></robot>"""
    many = "<robot>" + "".join(f"<tag{number}/>" for number in range(103)) + "</robot>"
    return {
        "urdf": unread("URDF", xml.parse(text)),
        "mjcf": unread("MJCF", xml.parse(text.replace("robot", "mujoco"))),
        "many": unread("URDF", xml.parse(many))[-3:],
        "two": unread("URDF", xml.parse('<robot nam="1"/>'), xml.parse('<robot nam="1"/>')),
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
