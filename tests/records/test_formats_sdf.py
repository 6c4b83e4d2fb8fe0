"""SDF: complete answers on record."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_answers import refusal
from recorded_models import ShortRecords, described, pose

from twistwrench.formats import load_model, sdf, xml

records = ShortRecords(__file__)


def inertial(mass, place="", tensor="0.031 -0.002 0.0013 0.027 0.0017 0.022"):
    """Text of an <inertial>; the tensor's entries are ixx, ixy, ixz, iyy, iyz, izz."""
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entries = "".join(f"<{name}>{value}</{name}>" for name, value in zip(names, tensor.split(), strict=True))
    return f"<inertial>{place}<mass>{mass}</mass><inertia>{entries}</inertia></inertial>"


PRESS = f"""<sdf version="1.11"><world name="hall"><gravity>0.5 -9 1.5</gravity><joint/>
<model name="press" canonical_link="ram">
  <pose>0.1 0.2 0.3 0.4 0.5 0.6</pose>
  <link name="bed">{inertial(40, "<pose>0.1 -0.2 0.3 0.3 0.2 0.1</pose>", "4 0.2 -0.1 5 0.3 6")}<visual name="v"/></link>
  <link name="ram"><pose relative_to="bed">0.2 0 0.7 0 0 30</pose>{inertial(12, '<pose rotation_format="quat_xyzw">0 0.1 0 0.1 0.2 0.3 0.4</pose>')}</link>
  <link name="die"><pose degrees="true" relative_to="mark">0.1 0.2 0 10 20 -30</pose>{inertial(3.5, "<pose/>")}<collision name="c"/></link>
  <link name="knob"><pose relative_to="die">0 0.3 0.1 0.1 0 0</pose>{inertial(0.75)}</link>
  <link name="stick"><pose rotation_format="quat_xyzw" relative_to="__model__">1 0 2 0 0.6 0 0.8</pose>{inertial(1.25, "<pose>0.1 0.2 0.3 0 0 0</pose>")}</link>
  <link name="screw"><pose relative_to="stick">0 0 -0.3 0 0 0</pose>{inertial(0.5)}</link>
  <link name="bolt"><pose relative_to="thread">0.3 0 0 0 0 0</pose>{inertial(0.25)}</link>
  <link name="fork"><pose>0.5 0.5 0.5 0 0 0</pose>{inertial(2.25)}</link>
  <link name="bare"><pose relative_to="fork">0 0 0.25 0 0 0</pose></link>
  <link name="half"><pose relative_to="fork">0 0.25 0 0 0 0</pose><inertial><mass>3</mass><inertia><ixx>2</ixx></inertia></inertial></link>
  <frame name="mark" attached_to="ram"><pose relative_to="nest::base">0.1 0.2 0.3 0.4 0 0</pose></frame>
  <frame name="corner"><pose>0.6 0 0 0 0 0.7</pose></frame>
  <frame name="on joint" attached_to="stroke"><pose>0 0 0.2 0 0 0</pose></frame>
  <frame name="on frame" attached_to="corner"/>
  <model name="nest" canonical_link="hub"><pose relative_to="bed">0 0 1 0 0 0.2</pose>
    <link name="base"><pose>0.1 0 0 0 0.3 0</pose>{inertial(1.5)}</link><link name="hub"><pose>0 0.2 0 0.1 0 0</pose>{inertial(5)}</link>
    <link name="arm"><pose relative_to="base">0 0.4 0 0 0 0</pose>{inertial(1.75)}</link>
    <joint name="elbow" type="revolute"><parent>base</parent><child>arm</child><pose relative_to="inner">0 0 0.1 0 0 0</pose>
      <axis><xyz expressed_in="inner">0.6 0 0.8</xyz><limit><lower>-1.5</lower><upper>0.75</upper><effort>8</effort><velocity>-1</velocity></limit>
      <mimic joint="turn"><multiplier>0.5</multiplier><offset>0.25</offset><reference>0.125</reference></mimic></axis></joint>
    <joint name="turn" type="continuous"><parent>__model__</parent><child>base</child><axis><xyz expressed_in="__model__">0 1 0</xyz></axis></joint>
    <frame name="inner"><pose>0.2 0 0 0 0 0.5</pose></frame>
  </model>
  <joint name="hold" type="fixed"><parent>world</parent><child>bed</child><pose>9 9 9 0 0 0</pose></joint>
  <joint name="stroke" type="prismatic"><parent>bed</parent><child>ram</child><pose>0 0 0 0.2 0 0</pose>
    <axis><xyz>0.3 0 -1.2</xyz><limit><lower>-0.5</lower><upper>0.25</upper><effort>2500</effort><velocity>0.75</velocity></limit>
    <dynamics><damping>30</damping><friction>45</friction><spring_stiffness>800</spring_stiffness><spring_reference>0.05</spring_reference></dynamics></axis>
    <drake:rotor_inertia>0.002</drake:rotor_inertia><drake:gear_ratio>50</drake:gear_ratio></joint>
  <joint name="nest base" type="revolute"><parent>mark</parent><child>die</child><pose>0.1 0 0 0 0.4 0</pose>
    <axis><xyz>0 0 1</xyz><use_parent_model_frame>1</use_parent_model_frame><limit><upper>2</upper></limit></axis></joint>
  <joint name="ball" type="ball"><parent>die</parent><child>knob</child><pose>0.1 -0.2 0.3 0.5 0 0</pose>
    <axis><dynamics><damping>0.5</damping><friction>0.25</friction></dynamics></axis></joint>
  <joint name="centre" type="ball"><parent>ram</parent><child>stick</child></joint>
  <joint name="thread" type="screw"><parent>stick</parent><child>screw</child><axis><xyz>0 2 0</xyz></axis><screw_thread_pitch>0.01</screw_thread_pitch></joint>
  <joint name="pitch joint" type="screw"><parent>screw</parent><child>bolt</child><pose>0 0.1 0 0 0 0</pose><axis><xyz>0 0 1</xyz></axis><thread_pitch>-500</thread_pitch></joint>
  <joint name="gimbal" type="universal"><parent>bed</parent><child>fork</child><pose>0 0 0.1 0 0.3 0</pose>
    <axis><xyz>1 0 0</xyz><dynamics><damping>1</damping></dynamics></axis>
    <axis2><xyz>0 1 0</xyz><limit><lower>-2</lower></limit><dynamics><friction>2</friction></dynamics></axis2><drake:rotor_inertia>0.5</drake:rotor_inertia></joint>
  <joint name="wheel" type="revolute2"><parent>fork</parent><child>bare</child><axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 -1 0</xyz></axis2></joint>
  <joint name="weld" type="fixed"><parent>fork</parent><child>half</child></joint>
</model></world></sdf>
"""  # fmt: skip


@records.of
def a_press_of_all_joints_and_frames():
    return described(load_model(PRESS, quiet=True, inertia="accept"))


def arm(joint, version="1.8", links="", model='<pose relative_to="bay">0.1 0 0 0 0 0.5</pose>', outside=""):
    """One model with the links "a" and "b" and the inside of the joint "j"."""
    if not joint.startswith(("<joint", "<frame", "<include")):
        joint = f'<joint name="j" type="revolute"><parent>a</parent><child>b</child>{joint}</joint>'
    links = (
        links
        or f'<link name="a"><pose>1 2 3 0 0 0.2</pose>{inertial(2)}</link><link name="b"><pose>2 2 3 0.3 0 0</pose>{inertial(1.5)}</link>'
    )
    return f'<sdf version="{version}"><model name="m">{model}{links}{joint}</model>{outside}</sdf>'


AXIS = "<axis><xyz>0.6 0 0.8</xyz></axis>"


def axes(model):
    return [[b.joint.name, b.joint.kind, b.joint.axes, pose(b.placement)] for b in model.bodies] + list(model.defects)


@records.of
def axes_by_version_and_frame():
    answers = {}
    for version in ("1.4", "1.5", "1.11"):
        for use in (
            "",
            "<use_parent_model_frame>true</use_parent_model_frame>",
            "<use_parent_model_frame>0</use_parent_model_frame>",
        ):
            for frame in ("", ' expressed_in=" a "', ' expressed_in="__model__"'):
                joint = f"<pose>0.1 0.2 0.3 0 0.4 0</pose><axis><xyz{frame}>0.6 0 0.8</xyz>{use}</axis>"
                answers[f"{version} {use[24:25]} {frame}"] = (
                    load_model(arm(joint, version), quiet=True).bodies[0].joint.axes
                )
    return answers


@records.of
def roots_and_floating_bases():
    links = f'<link name="a"><pose>1 2 3 0 0 0.2</pose>{inertial(2)}</link><link name="b"><pose>2 2 3 0.3 0 0</pose>{inertial(1.5)}</link>'
    models = {
        "joined": arm(AXIS),
        "apart": arm("<frame name='f'/>", links=links),
        "static": arm(AXIS, model="<static> true </static>"),
        "static number": arm(AXIS, model="<static>1</static>"),
        "not static": arm(AXIS, model="<static>yes</static>"),
        "held": arm(f'<joint name="j" type="revolute"><parent>world</parent><child>b</child>{AXIS}</joint>'),
    }
    answers = {}
    for name, text in models.items():
        for floating in (None, False, True):
            answer = described(load_model(text, quiet=True, floating_base=floating))
            keys = ("joints", "mounted", "mounts", "notes", "gravity", "base", "frames")
            answers[f"{name} {floating}"] = {
                key: answer.get(key) for key in keys if floating is not False or key in keys[:3]
            }
            answers[f"{name} {floating}"]["placements"] = [
                pose(b.get("placement", np.eye(4))) if "placement" not in b else b["placement"]
                for b in answer.get("bodies", [])
            ]
    return answers


@records.of
def limits_pitches_and_mimics():
    limits = [
        "", "<limit/>", "<limit><lower>-1e15</lower><upper>1e15</upper></limit>", "<limit><lower>-999999999999999</lower><upper>2</upper></limit>",
        "<limit><effort>0</effort><velocity>0</velocity></limit>", "<limit><effort>-1</effort><velocity>0.5</velocity></limit>",
        "<limit><effort>1e15</effort><velocity>1e15</velocity></limit>", "<limit><lower> 1.5 </lower></limit>", "<limit><lower></lower></limit>",
    ]  # fmt: skip
    answers = {}
    for kind in ("revolute", "continuous", "prismatic", "screw"):
        for limit in limits:
            joint = f'<joint name="j" type="{kind}"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz>{limit}</axis></joint>'
            answers[f"{kind} {limit}"] = _or_error(
                lambda joint=joint: described(load_model(arm(joint), quiet=True)).get("limits")
            )
    pitches = ["", "<thread_pitch>4</thread_pitch>", "<thread_pitch>-0.5</thread_pitch>", "<thread_pitch>0</thread_pitch>",
        "<screw_thread_pitch>0.25</screw_thread_pitch><thread_pitch>4</thread_pitch>", "<screw_thread_pitch>0</screw_thread_pitch>"]  # fmt: skip
    for pitch in pitches:
        joint = f'<joint name="j" type="screw"><parent>a</parent><child>b</child><axis><xyz>0 3 4</xyz></axis>{pitch}</joint>'
        answers[pitch] = _or_error(lambda joint=joint: axes(load_model(arm(joint), quiet=True)))
    links = "".join(f'<link name="{name}">{inertial(1)}</link>' for name in "abc")
    laws = [
        "",
        "<multiplier>-2</multiplier>",
        "<offset>0.5</offset>",
        "<multiplier>3</multiplier><reference>0.25</reference><offset>0.5</offset>",
        "<reference>0.25</reference>",
    ]
    for law in laws:
        joints = (
            f'<joint name="k" type="revolute"><parent>a</parent><child>b</child>{AXIS}</joint><joint name="j" type="prismatic"><parent>b</parent>'
            f'<child>c</child><axis><xyz>1 0 0</xyz><mimic joint="k" axis="axis">{law}</mimic></axis></joint>'
        )
        bodies = load_model(arm(joints, links=links), quiet=True).bodies
        answers[f"mimic {law}"] = [[body.ratio, body.offset, body.follows] for body in bodies]
    rotors = [
        "<drake:rotor_inertia>0.5</drake:rotor_inertia>",
        "<drake:gear_ratio>3</drake:gear_ratio>",
        "<drake:rotor_inertia>0.5</drake:rotor_inertia><drake:gear_ratio>-3</drake:gear_ratio>",
    ]
    answers["rotors"] = [load_model(arm(AXIS + rotor), quiet=True).armature for rotor in rotors]
    spring = "<axis><xyz>0 0 1</xyz><dynamics><spring_stiffness>{}</spring_stiffness><spring_reference>0.5</spring_reference></dynamics></axis>"
    answers["springs"] = [list(load_model(arm(spring.format(k)), quiet=True).springs) for k in (0, 7)]
    return answers


def _or_error(call):
    try:
        return call()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


@records.of
def inertia_of_the_format():
    inertials = ["", "<inertial/>", "<inertial><mass>3</mass></inertial>", "<inertial><inertia/></inertial>", "<inertial><inertia><iyy>0.75</iyy><ixz>0.1</ixz></inertia></inertial>",
        '<inertial auto=" true "/>', '<inertial auto="1"/>', '<inertial auto="false"><mass>2</mass><inertia/></inertial>', "<inertial><mass>x</mass></inertial>",
        "<inertial><pose>1 2 3</pose></inertial>", '<inertial><pose rotation_format="quat_xyzw">1 2 3 0 0 0 0</pose></inertial>', '<inertial><pose rotation_format="euler">1</pose></inertial>',
        '<inertial><pose degrees="1">0.1 0.2 0.3 30 0 0</pose><mass>2</mass><inertia><ixx>2</ixx><iyy>3</iyy><izz>4</izz></inertia></inertial>']  # fmt: skip
    answers = {}
    for text in inertials:
        links = f'<link name="a"/><link name="b">{text}</link>'
        answers[text] = _or_error(
            lambda links=links: [
                *(m := load_model(arm(AXIS, links=links), quiet=True)).defects,
                m.link_inertias["b"].parameters,
            ]
        )
    answers["assumed"] = [sdf.assumed_text(missing) for missing in ((), ("mass",), ("inertia",), ("mass", "inertia"))]
    return answers


@records.of
def models_of_a_file():
    model = '<model name="{}">{}<link name="l"/></model>'
    one, two, still = model.format("one", ""), model.format("two", ""), model.format("still", "<static>true</static>")
    texts = {
        "one": one, "two": one + two, "still and two": still + two, "still": still + model.format("other", "<static>1</static>"),
        "in worlds": f'<world name="w"><gravity>1 2 3</gravity>{one}</world><world name="v">{still}</world>', "outside and in": f"{still}<world><gravity>1 2 3</gravity>{two}</world>", "none": "<world/>",
    }  # fmt: skip
    answers = {}
    for name, text in texts.items():
        for model_name in (None, "two", "one", "still"):
            answers[f"{name} {model_name}"] = _or_error(
                lambda text=text, m=model_name: [
                    (r := load_model(f'<sdf version="1.9">{text}</sdf>', quiet=True, model=m)).name,
                    r.gravity,
                    r.mounted,
                ]
            )
    return answers


@records.of
def refused_sdf():
    link = '<link name="a"/><link name="b"/>'
    texts = {
        "no version": arm(AXIS).replace(' version="1.8"', ""), "version": arm(AXIS, "one"), "include": arm("<include/>"),
        "gearbox": arm('<joint name="j" type="gearbox"><parent>a</parent><child>b</child></joint>'), "type": arm('<joint name="j" type="hinge"><parent>a</parent><child>b</child></joint>'),
        "no parent": arm('<joint name="j" type="fixed"><child>b</child></joint>'), "no child": arm('<joint name="j" type="fixed"><parent>a</parent></joint>'),
        "blank child": arm('<joint name="j" type="fixed"><parent>a</parent><child> </child></joint>'), "child is world": arm('<joint name="j" type="fixed"><parent>a</parent><child>world</child></joint>'),
        "child is gone": arm('<joint name="j" type="fixed"><parent>a</parent><child>c</child></joint>'), "parent is gone": arm('<joint name="j" type="fixed"><parent>c</parent><child>b</child></joint>'),
        "no axis": arm("<limit/>"), "no second axis": arm(f'<joint name="j" type="universal"><parent>a</parent><child>b</child>{AXIS}</joint>'), "no xyz": arm("<axis/>"), "zero": arm("<axis><xyz>0 0 0</xyz></axis>"),
        "two numbers": arm("<axis><xyz>0 1</xyz></axis>"), "frame of axis": arm('<axis><xyz expressed_in="q">0 0 1</xyz></axis>'), "same name": arm('<frame name="a"/>'),
        "frame of pose": arm('<frame name="f"><pose relative_to="q">0 0 0 0 0 0</pose></frame>'), "frame of frame": arm('<frame name="f" attached_to="q"/>'),
        "circle": arm('<frame name="f"><pose relative_to="g"/></frame><frame name="g"><pose relative_to="f"/></frame>'), "circle of attachments": arm('<frame name="f" attached_to="g"/><frame name="g" attached_to="f"/>'),
        "link called world": arm("", links='<link name="world"/>' + link), "drake": arm(AXIS, links=link + "<drake:joint/>"), "mimic": arm("<axis><xyz>0 0 1</xyz><mimic/></axis>"),
        "mimic of none": arm('<axis><xyz>0 0 1</xyz><mimic joint="z"/></axis>'), "pose": arm("<pose>1 2 3</pose>" + AXIS), "no links": '<sdf version="1.8"><model name="m"/></sdf>',
        "no name": '<sdf version="1.8"><model/></sdf>', "loop": arm(AXIS + '</joint><joint name="k" type="fixed"><parent>b</parent><child>a</child>'), "canonical": arm(AXIS, model="").replace('name="m"', 'name="m" canonical_link="z"') ,
        "canonical frame": arm(AXIS + "</joint><frame name='f'/><joint name='k' type='fixed'><parent>__model__</parent><child>z</child>", model="").replace('name="m"', 'name="m" canonical_link="z"'),
    }  # fmt: skip
    return {name: _or_error(lambda text=text: load_model(text, quiet=True).name) for name, text in texts.items()}


@records.of
def values_of_elements():
    root = xml.parse("<a><n> 2.5 </n><w> x y </w><t>true</t><one>1</one><T>True</T><v>1 2 3</v><e/><p/></a>")
    poses = ["", " ", "1 2 3 0.1 0.2 0.3", "1 2 3 0 0 0"]
    return {
        "numbers": [
            sdf.number(root, "n", 9),
            sdf.number(root, "q", 9),
            sdf.number(None, "n", 8),
            refusal(lambda: sdf.number(root, "e", 1)),
        ],
        "words": [sdf.word(root, "w"), sdf.word(root, "q", "default"), sdf.word(root, "e", "default")],
        "true": [sdf.is_true(root, tag) for tag in ("t", "one", "T", "n", "q")],
        "vector": sdf.vector(root.child("v")),
        "poses": [sdf.pose(xml.parse(f"<pose>{text}</pose>")) for text in poses] + [sdf.pose(None)],
        "degrees": [
            sdf.pose(xml.parse(f'<pose degrees="{flag}">0 0 0 30 20 0.1</pose>'))[:3, :3]
            for flag in (" true ", "1", "false", "yes")
        ],
    }


@records.of
def frames_of_a_nested_model():
    model = sdf.expand_model(xml.parse(PRESS).child("world").child("model"))
    user = model.links["bed"]
    return {
        "frames": {name: [f.scope, f.relative_to, f.attached_to] for name, f in model.frames.items()},
        "poses": {name: pose(model.pose(name, user)) for name in model.frames},
        "links": {name: _or_error(lambda name=name: model.link_of(name, user)) for name in model.frames},
        "between": pose(model.between("knob", "nest::inner", user)),
        "order": [list(model.links), list(model.joints), list(model.named)],
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
