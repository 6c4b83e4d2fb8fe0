"""MJCF: complete answers on record."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_answers import refusal
from recorded_models import ShortRecords, described, pose

from twistwrench.core.errors import TwistWrenchError
from twistwrench.formats import load_model, xml
from twistwrench.formats.mjcf import bodies, preprocess
from twistwrench.formats.mjcf.preprocess import Defaults, Meshes, Settings

records = ShortRecords(__file__)

PLANT = """<mujoco model=" plant ">
  <compiler angle="degree" eulerseq="zYx" inertiagrouprange="1 3"/>
  <compiler autolimits="true"/>
  <option gravity="0.5 -9.5 1.5"/>
  <default>
    <joint damping="0.125 0 0" armature="0.03"/>
    <geom group="2" density="700"/>
    <general forcerange="-9 9"/>
    <default class="strong">
      <joint type="slide" axis="0.1 0.2 -1" frictionloss="2.5" range="-0.25 0.75" stiffness="45"/>
      <geom type="box" size="0.1 0.2 0.3" euler="10 20 30"/>
      <motor gear="3.5" ctrlrange="-1.5 2"/>
      <equality polycoef="0.2 1.5"/>
      <tendon stiffness="8"/>
      <site pos="0.3 0.2 0.1"/>
      <default class="weak"><joint damping="0.75" type="hinge"/><geom density="300"/><dcmotor armature="0.002"/></default>
    </default>
  </default>
  <worldbody>
    <geom type="plane" group="2"/>
    <site name="ground" pos="1 2 3" axisangle="0 1 2 40"/><site pos="9 9 9"/>
    <frame pos="0.3 -0.2 0.1" euler="15 -25 35" childclass="strong">
      <body name="base" pos="0.2 0.1 -0.4" quat="0.8 -0.2 0.4 1.2">
        <inertial pos="0.05 -0.06 0.07" quat="1 0.2 -0.3 0.4" mass="7.5" diaginertia="0.21 0.19 0.11"/>
        <joint name="turn" class="main" axis="0.3 0.4 -1.2" pos="0.1 -0.2 0.3" range="-100 130" ref="20" springref="-15" stiffness="12"/>
        <joint name="rise"/>
        <frame pos="0.02 0.04 -0.06" zaxis="0.3 -0.4 0.5">
          <site name="flange"/><site name="rise" class="main" type="box" fromto="0.1 0.2 0.3 0.5 -0.4 0.2" size="0.01"/>
          <frame axisangle="1 -1 0.5 -50">
            <body pos="0.7 0.3 -0.1" xyaxes="1 0.5 0.2 -0.3 1 0.4" childclass="weak" gravcomp="0.5">
              <joint pos="0.05 0.02 0"/><joint axis="0 1 0" ref="8" limited="false" actuatorfrcrange="-4 4"/>
              <geom size="0.05 0.08 0.04" pos="0.1 0 0.02"/><geom type="sphere" size="0.06" mass="1.25" pos="-0.1 0.05 0.2" group="3"/>
              <geom type="box" size="9 9 9" group="4"/><geom type="capsule" size="0.03" fromto="0 0.1 0.2 0.3 -0.2 0.1" group="1"/>
              <geom type="cylinder" size="0.07" fromto="0 0.1 0.2 0.3 -0.2 0.1" quat="1 0 0 0"/>
              <geom type="ellipsoid" size="0.03" fromto="0 -0.1 0.2 0.1 0.2 0.1"/><geom type="box" size="0.02" fromto="0 -0.1 0.2 0.2 0.2 0.5"/>
              <geom type="cylinder" size="0.05 0.11 9" euler="5 10 15"/><geom type="ellipsoid" size="0.05 0.11 0.07" mass="0"/>
              <body name="hand" pos="0.2 -0.1 0.5" euler="30 -40 20">
                <joint name="wrist" type="ball" pos="0.02 -0.01 0.03" range="0 60" stiffness="3" damping="0.5"/>
                <inertial pos="0.01 0.02 0.03" mass="0.75" fullinertia="0.0045 0.0041 0.0033 0.0003 -0.0002 0.0001"/>
                <body name="thumb" pos="0.05 0.06 0.07">
                  <inertial pos="0.01 -0.02 0.03" mass="0.25" diaginertia="0.0009 0.0008 0.0005" zaxis="0.1 0.2 1"/>
                  <joint name="thumb" type="ball" class="main"/></body>
                <body name="nail" pos="0 0 0.1"><inertial pos="0 0.01 0" mass="0.05"/></body>
              </body>
            </body>
          </frame>
        </frame>
      </body>
    </frame>
    <body name="bird" pos="2 3 4" euler="20 30 40"><freejoint name="fly" align="true"/><plugin/>
      <inertial pos="0.1 0.2 0.3" mass="1.5" diaginertia="0.05 0.04 0.03"/></body>
    <body name="wall" pos="-1 0 0.5"><geom type="box" size="0.1 0.2 0.3" group="3"/></body>
  </worldbody>
  <worldbody childclass="weak">
    <body name="late" pos="0 1 0"><joint name="late" springdamper="0.1 1" springyield="2" stiffness="3 1" damping="1 2"/><geom mass="2"/></body>
  </worldbody>
  <equality>
    <joint name="law" joint1="rise" joint2="turn" class="strong"/>
    <joint joint1="late" joint2="turn" active="false"/>
    <connect name="pin" body1="base" body2="hand" anchor="0.1 0.2 0.3"/>
    <weld body1="thumb" body2="base" anchor="0.3 0.1 -0.2"/>
    <weld name="glue" body1="hand" anchor="0.05 0.04 0.03" relpose="0.1 0.2 0.3 0.5 0.5 -0.5 1"/>
    <connect name="sites" site1="flange" site2="rise"/><weld site1="ground" site2="flange"/><connect site1="gone" site2="flange"/>
    <tendon tendon1="pull"/>
  </equality>
  <tendon><fixed name="pull" class="strong" springlength="0.3" damping="0.2"><joint joint="turn" coef="0.5"/><joint joint="late" coef="-0.75"/>
    <joint joint="turn" coef="0.125"/></fixed>
    <fixed name="rest" stiffness="6"><joint joint="turn" coef="2"/><joint joint="rise" coef="-3"/></fixed></tendon>
  <actuator><motor class="strong" joint="turn"/><general joint="rise" gear="-2 7" ctrlrange="-3 4" ctrllimited="true" gainprm="5" armature="0.01" damping="0.02"/>
    <position name="p" joint="late" forcerange="-6 11"/></actuator>
  <keyframe>
    <key name="home" qpos="0.5 0.25 0.1 -0.2 0 0 0 0 0.6 0 0.8 0 1 2 3 0 0 0 0 0.375"/>
    <key time="1"/><key qpos="0 0 0 0 1 0 0 0 1 0 0 0 0 0 0 1 0 0 0 0"/>
  </keyframe>
</mujoco>
"""


@records.of
def a_plant_of_all_joints_and_frames():
    return described(load_model(PLANT, quiet=True, inertia="accept"))


@records.of
def the_plant_by_option():
    options = {
        "held": {"floating_base": False},
        "floating": {"floating_base": True},
        "hand": {"keep": "hand"},
        "wall": {"keep": "wall", "floating_base": True},
        "bird held": {"keep": "bird", "floating_base": False},
    }
    answers = {}
    for name, kept in options.items():
        answer = described(load_model(PLANT, quiet=True, inertia="accept", **kept))
        keys = (
            "joints",
            "mounted",
            "closures",
            "springs",
            "motor joints",
            "configurations",
            "gravity",
            "base",
            "tip",
            "mounts",
        )
        answers[name] = {key: answer.get(key) for key in keys}
        answers[name]["bodies"] = [[b["joint"], b.get("parent"), b.get("placement")] for b in answer.get("bodies", [])][
            ::2
        ]
        answers[name]["notes"] = len(answer["notes"])
    return answers


def element(text):
    return xml.parse(text)


def placed(attributes, **settings):
    return pose(bodies.placement(element(f"<body {attributes}/>"), Settings(**settings)))


@records.of
def placements_of_all_forms():
    forms = [
        "", 'pos="1 2 3"', 'quat="0.5 1 -0.25 2"', 'axisangle="1 2 -2 35" pos="4 5"', 'xyaxes="1 2 2 0.5 -1 3"', 'zaxis="0.2 -0.6 0.9"',
        'zaxis="0 0 -3"', 'euler="25 -50 75"', 'quat="3 0 0 0"', 'quat="1 0.5"',
    ]  # fmt: skip
    answers = {form: placed(form) for form in forms}
    radian = {
        form: placed(form.replace("35", "0.6").replace("25 -50 75", "0.4 -0.9 1.3"), degrees=False)
        for form in forms
        if "5" in form
    }
    sequences = {
        s: placed('euler="0.4 -0.9 1.3"', degrees=False, euler_sequence=s)
        for s in ("xyz", "zyx", "XYZ", "zXy", "Yxz", "XzX")
    }
    wrong = ['axisangle="1 0 0 2" euler="1 2 3"', 'quat="0 0 0 0"', 'axisangle="0 0 0 1"', 'xyaxes="0 0 0 0 1 0"', 'xyaxes="1 0 0 2 0 0"',
        'zaxis="0 0 0"', 'xyaxes="1 0 0"', 'pos="1 2 3 4"', 'zaxis="1 0 0" xyaxes="1 0 0 0 1 0" euler="0 0 0"']  # fmt: skip
    upright = bodies.rotation(element("<body/>"), Settings())
    return {
        "upright": upright,
        "degrees": answers,
        "radians": radian,
        "sequences": sequences,
        "refused": {f: refusal(lambda f=f: placed(f)) for f in wrong},
    }


def robot(
    inside,
    world='<joint name="j" axis="0.6 0 0.8"/>',
    mass='<inertial pos="0.1 0.2 0.3" mass="2" diaginertia="0.3 0.4 0.5"/>',
    above="",
):
    """Robot with the bodies "a" and "b", whose joints are "j" and "k", and other sections."""
    return f"""<mujoco>{above}<worldbody><site name="w"/>
<body name="a" pos="0.1 0.2 0.3">{world}{mass}
<body name="b" pos="0.4 0.5 0.6"><joint name="k" type="slide" axis="0 0.6 0.8" ref="0.25"/>{mass}
</body></body></worldbody>{inside}</mujoco>"""


def drives(model):
    """What actuators, springs and limits make of a model."""
    answer = described(model)
    answer.get("sites", {}).pop("w", None)
    if np.array_equal(answer.get("gravity", ()), (0.0, 0.0, -9.81)):
        answer.pop("gravity")
    keys = (
        "limits",
        "friction",
        "armature",
        "springs",
        "actuators",
        "motor joints",
        "configurations",
        "closures",
        "notes",
        "gravity",
        "sites",
    )
    return {key: answer[key] for key in keys if key in answer and len(answer[key])}


def read(text, shown=drives, **options):
    try:
        return shown(load_model(text, quiet=True, **{"inertia": "accept", **options}))
    except TwistWrenchError as error:
        return f"{type(error).__name__}: {error}"


ACTUATORS = {
    "motor": '<motor joint="j" gear="3" ctrlrange="-2 4"/>',
    "motor and force": '<motor joint="j" gear="3" ctrlrange="-2 4" forcerange="-1 9"/>',
    "no limits": '<motor joint="j" gear="3" ctrlrange="-2 4" ctrllimited="false"/>',
    "backward": '<motor joint="j" gear="-3" ctrlrange="-2 4"/>',
    "no gear": '<motor joint="j" gear="0" ctrlrange="-2 4"/><motor joint="j" gear="2" ctrlrange="-5 5"/>',
    "one side": '<motor joint="j" gear="2.5" ctrlrange="0 4"/>',
    "other side": '<motor joint="j" gear="2.5" ctrlrange="-3 0"/>',
    "almost even": '<motor joint="j" gear="1" ctrlrange="-999.5 1000"/>',
    "less even": '<motor joint="j" gear="1" ctrlrange="-998.5 1000"/>',
    "two": '<motor joint="j" gear="2" ctrlrange="-2 4"/><position jointinparent=" j " gear="0.5" forcerange="-7 6"/><motor joint="k" ctrlrange="-1 1"/>',
    "unknown": '<motor joint="j" gear="2"/>',
    "general": '<general joint="j" gainprm="-2 1 1" ctrlrange="-3 5" gear="2"/>',
    "general of bias": '<general joint="j" gainprm="2" biastype="affine" ctrlrange="-3 5"/>',
    "general of gain": '<general joint="j" gainprm="2" gaintype="user" ctrlrange="-3 5" forcerange="-8 8" forcelimited="true"/>',
    "general filtered": '<general joint="j" gainprm="2" dyntype="filter" ctrlrange="-3 5"/>',
    "general of none": '<general joint="j" gaintype="fixed" biastype="none" dyntype="none" ctrlrange="-3 5"/>',
    "velocity": '<velocity joint="j" kv="3" ctrlrange="-1 1" forcerange="-2.5 3"/>',
    "position": '<position joint="j" kp="3" ctrlrange="-1 1"/>',
    "orientation": '<orientation joint="j" forcerange="-2.5 3"/>',
    "foreign": '<rocket joint="j" forcerange="-2.5 3" armature="2"/>',
    "losses": '<motor joint="j" gear="3" armature="0.02" damping="0.5 0.1"/><motor joint="j" gear="-2" armature="0.01" damping="0 0.2"/>',
    "losses elsewhere": '<motor site="w" armature="0.02" damping="0.5"/><motor joint="k" armature="0.02"/>',
    "tendon": '<motor tendon="t"/><motor tendon=" "/>',
    "spatial tendon": '<motor joint="j"/><motor tendon="s"/>',
    "missing tendon": '<motor joint="k"/><motor tendon="q"/>',
    "crank": '<motor joint="j"/><general slidersite="w"/>',
    "crank site": '<motor joint="j"/><general cranksite="w"/>',
    "no joint": '<motor joint="z"/>',
}  # fmt: skip
TENDONS = (
    '<tendon><fixed name="t"><joint joint="j" coef="2"/><joint joint="k" coef="0"/></fixed><spatial name="s"/></tendon>'
)


@records.of
def actuators_and_efforts():
    world = '<joint name="j" axis="0.6 0 0.8" actuatorfrcrange="{}" actuatorfrclimited="{}"/>'
    answers = {name: read(robot(f"<actuator>{text}</actuator>{TENDONS}")) for name, text in ACTUATORS.items()}
    for limits in (
        ("-50 3", "auto"),
        ("-5 5", "true"),
        ("-5 5", "false"),
        ("-9 0", "auto"),
        ("0 0", "auto"),
        ("1 2", "auto"),
    ):
        for name in ("motor", "unknown", ""):
            actuator = ACTUATORS.get(name, "")
            answers[f"{limits} {name}"] = read(robot(f"<actuator>{actuator}</actuator>", world.format(*limits)))
    off = '<compiler autolimits="false"/>'
    answers["no automatic limits"] = read(robot(f"<actuator>{ACTUATORS['motor and force']}</actuator>", above=off))
    own = ACTUATORS["motor and force"].replace("/>", ' ctrllimited="true"/>')
    answers["own limits"] = read(robot(f"<actuator>{own}</actuator>", above=off))
    return answers


DC_MOTORS = {
    "torque": 'motorconst="0.08" saturation="0.5" gear="50" resistance="0.7" inductance="0.002" nominal="24"',
    "current": 'motorconst="0.08" saturation="0 12" gear="-50" resistance="0.7" inductance="0 0.003" controller="0 0 0 0 0 36"',
    "both constants": 'motorconst="0.08 0.05" saturation="0 12" gear="2" resistance="0.7" nominal="24 3 300"',
    "back EMF": 'motorconst="0 0.05" saturation="0.5 0 4" gear="2" forcerange="-0.1 0.1"',
    "nominal": 'nominal="24 3 300" saturation="0 7"',
    "nominal and constant": 'motorconst="0.02" nominal="24 3 300" saturation="0 7" gear="3"',
    "no constant": 'saturation="0 7" gear="3" resistance="0.5"',
    "no saturation": 'motorconst="0.08" forcerange="-0.25 0.375" gear="3"',
    "nothing": 'gear="3"',
    "no torque": 'saturation="0 0" motorconst="0.1" gear="3"',
    "stall of zero": 'motorconst="0.08" nominal="24 0 0" saturation="1"',
    "friction": 'motorconst="0.08" saturation="0.5" gear="-4" lugre="900 3 0.02 0.03 0.5" armature="0.001" damping="0.002"',
    "friction without speed": 'motorconst="0.08" saturation="0.5" gear="4" lugre="900 3 0.02 0.01"',
    "no bristles": 'motorconst="0.08" saturation="0.5" gear="4" lugre="0 3 0.02 0.01"',
    "friction alone": 'gear="5" lugre="900 3 0.02 0.05 0.25"',
    "cogging and heat": 'motorconst="0.08" saturation="0.5" cogging="0.01 7" thermal="0 0.5"',
    "cold": 'motorconst="0.08" saturation="0.5" cogging="0 7" thermal="0 0 0 20 25 0.004"',
    "no gear": 'motorconst="0.08" saturation="0.5" gear="0"',
    "negative": 'motorconst="0.08" saturation="0.5" resistance="-1"',
}


@records.of
def dc_motors():
    answers = {}
    for name, attributes in DC_MOTORS.items():
        answers[name] = read(robot(f'<actuator><dcmotor joint="j" {attributes}/></actuator>'))
    two = f'<dcmotor joint="j" {DC_MOTORS["torque"]}/><dcmotor joint="j" {DC_MOTORS["current"]}/><dcmotor joint="k" {DC_MOTORS["friction"]}/>'
    answers["two"] = read(robot(f"<actuator>{two}</actuator>"))
    at_ball = two.replace('dcmotor joint="k"', 'motor joint="k"')
    answers["at a ball"] = read(robot(f"<actuator>{at_ball}</actuator>", '<joint name="j" type="ball"/>'))
    off = '<option><flag frictionloss="disable"/></option>'
    answers["no friction"] = read(robot(f"<actuator>{two}</actuator>", above=off))
    follower = '<equality><joint joint1="j" joint2="k"/></equality>'
    answers["follower"] = read(robot(f"<actuator>{two}</actuator>{follower}"))
    answers["efforts"] = [
        [x if x is None else float(x), note]
        for x, note in (
            preprocess_effort((a, b))
            for a, b in (
                (-3.0, 4.0),
                (-4.0, 3.0),
                (-4.0, 3.9965),
                (-4.0, 3.9955),
                (2.0, 5.0),
                (-5.0, -2.0),
                (0.0, 0.0),
                (-np.inf, 3.0),
                (-3.0, np.inf),
            )
        )
    ]
    return answers


def preprocess_effort(force_range):
    from twistwrench.formats.mjcf.drives import _effort_and_note

    return _effort_and_note(np.array(force_range))


FLAGS = ("gravity", "spring", "damper", "passive", "equality", "frictionloss", "constraint", "actuation")


@records.of
def flags_that_turn_forces_off():
    world = '<joint name="j" axis="0.6 0 0.8" stiffness="5" damping="0.5" frictionloss="0.25" springref="10"/>'
    inside = """<equality><joint joint1="j" joint2="k" polycoef="0.5 -2"/><connect body1="b" anchor="0.1 0.2 0.3"/></equality>
    <tendon><fixed stiffness="3"><joint joint="k" coef="2"/></fixed></tendon><actuator><motor joint="k" damping="0.125" gear="2"/></actuator>"""
    answers = {}
    for flag in ("", *FLAGS):
        answers[flag] = read(robot(inside, world, above=f'<option><flag {flag or "x"}="disable"/></option>'))
    answers["twice"] = preprocess.disabled_by(
        element(
            '<m><option><flag spring="disable" passive="disable"/><flag passive="enable"/></option><option><flag gravity=" disable "/></option></m>'
        )
    )
    answers["groups"] = [
        preprocess.disabled_by(element(f'<m><option><flag {g}="disable"/></option></m>'))
        for g in ("passive", "constraint")
    ]
    answers["gravity"] = [
        preprocess.gravity_of(element(f"<m>{text}</m>"))
        for text in (
            "",
            '<option gravity="1 2"/>',
            '<option gravity="1 2 3"/><option gravity="4"/>',
            '<option gravity="1 2 3"><flag gravity="disable"/></option>',
        )
    ]
    fluids = ['density="1.2"', 'viscosity="0.3"', 'density="0" viscosity="0"', 'wind="1 0 0"', ""]
    answers["fluid"] = [
        getattr(preprocess.fluid_of(element(f"<m><option {f}/><option/></m>")), "attributes", None) for f in fluids
    ]
    answers["noted fluid"] = read(
        robot("<deformable><flex name='f'/><skin/></deformable>", above='<option density="1.2"/>')
    )["notes"]
    return answers


@records.of
def laws_between_joints():
    laws = {
        "default": '<joint joint1="j" joint2="k"/>',
        "line": '<joint name="e" joint1="j" joint2="k" polycoef="0.5 -2"/>',
        "held": '<joint name="e" joint1="k" polycoef="0.5"/>',
        "cubic": '<joint name="e" joint1="j" joint2="k" polycoef="0 1 0 0.1"/>',
        "constant": '<joint name="e" joint1="j" joint2="k" polycoef="0.5 0"/>',
        "second": '<joint joint1="j" joint2="k"/><joint name="e" joint1="j" joint2="k" polycoef="1"/>',
        "circle": '<joint joint1="j" joint2="k"/><joint name="e" joint1="k" joint2="j"/>',
        "off": '<joint joint1="j" joint2="k" active="false"/>',
        "missing": '<joint joint1="j" joint2="z"/>',
        "no follower": '<joint joint2="k"/>',
        "flex": '<flex name="f"/><tendon tendon1="t"/>',
        "missing body": '<connect body1="a" body2="z" anchor="0 0 0"/>',
        "no anchor": '<connect body1="a"/>',
        "weld": '<weld body1="a" body2="b" relpose="0.1 0.2 0.3 0 0 0 0" anchor="0.5 0.6 0.7"/>',
        "weld of default": '<weld body2="b" relpose="0.1"/>',
        "weld of pose": '<weld body1="b" body2="a" relpose="0.1 0.2 0.3 0.5 -1 2 0.25" anchor="0.5 0.6 0.7"/>',
    }  # fmt: skip
    world = '<joint name="j" axis="0.6 0 0.8" ref="30"/>'

    def shown(model):
        followers = [[b.joint.name, b.ratio, b.offset] for b in model.bodies if b.follows]
        answer = described(model)
        return {"followers": followers} | {key: answer.get(key) for key in ("sites", "closures", "notes")}

    answers = {name: read(robot(f"<equality>{law}</equality>", world), shown) for name, law in laws.items()}
    ball = '<joint name="j" type="ball"/>'
    answers["ball"] = read(robot(f"<equality>{laws['default']}</equality>", ball), shown)
    answers["kept"] = read(robot(f"<equality>{laws['line']}{laws['weld']}</equality>", world), shown, keep="b")
    return answers


@records.of
def springs_of_tendons():
    tendons = {
        "rest": '<fixed name="t" stiffness="3">{}</fixed>',
        "length": '<fixed name="t" stiffness="3" springlength="0.5">{}</fixed>',
        "both lengths": '<fixed name="t" stiffness="3" springlength="0.5 0.5">{}</fixed>',
        "slack": '<fixed name="t" stiffness="3" springlength="0.5 0.75">{}</fixed>',
        "half": '<fixed name="t" stiffness="3" springlength="-1 0.75">{}</fixed>',
        "yield": '<fixed name="t" stiffness="3" springyield="2">{}</fixed>',
        "polynomial": '<fixed name="t" stiffness="3 0 1">{}</fixed>',
        "losses": '<fixed name="t" damping="0 1" frictionloss="0.5" armature="0.1">{}</fixed>',
        "missing": '<fixed name="t" stiffness="3"><joint joint="z" coef="1"/></fixed>',
        "spatial": '<spatial name="t" stiffness="3"/>',
        "spatial losses": '<spatial name="t" armature="3"/><spatial name="u" frictionloss="1"/><spatial name="v"/><spatial damping="0 0 2"/>',
    }  # fmt: skip
    inside = '<joint joint="j" coef="2"/><joint joint="k" coef="-0.5"/><joint joint="k" coef="-1"/>'
    world = '<joint name="j" axis="0.6 0 0.8" springref="30"/>'
    answers = {name: read(robot(f"<tendon>{text.format(inside)}</tendon>", world)) for name, text in tendons.items()}
    answers["kept"] = read(robot(f"<tendon>{tendons['rest'].format(inside)}</tendon>", world), keep="b")
    answers["ball"] = read(robot(f"<tendon>{tendons['rest'].format(inside)}</tendon>", '<joint name="j" type="ball"/>'))
    return answers


@records.of
def joints_in_all_units_and_limits():
    joints = [
        '<joint range="-30 40"/>', '<joint range="-30 40" limited="false"/>', '<joint range="-30 40" limited="true" type="slide"/>',
        '<joint limited="true"/>', '<joint type="ball" range="0 40" stiffness="2"/>', '<joint type="ball" limited="true"/>',
        '<joint type="free" range="1 2" limited="true" stiffness="2" damping="0.5" armature="0.25" frictionloss="0.125"/>',
        '<freejoint align="false"/>', '<joint stiffness="2 1" springyield="3"/>', '<joint damping="0.5 0 0.1"/>', '<joint springdamper="0 0"/>',
        '<joint springdamper="0 1"/>', '<joint type="slide" axis="0 0 2" springref="0.5" ref="0.25" stiffness="3"/>',
        '<joint ref="20" springref="30" stiffness="3" pos="0.1 0 0"/><joint type="slide" ref="0.5"/>', '<joint type="ball" pos="0.1 0 0"/><joint ref="5"/>',
        '<joint/><joint name="a.hinge0" type="slide"/>', '<joint axis="0 0 0"/>', '<joint type="door"/>', '<freejoint/><joint/>',
    ]  # fmt: skip
    above = {
        "": "",
        "radian": '<compiler angle="radian" alignfree="true"/>',
        "by hand": '<compiler autolimits="false"/>',
    }
    answers = {}
    for setting, text in above.items():
        for joint in joints if not setting else joints[:1] + joints[6:8] + joints[13:14]:

            def shown(model):
                answer = drives(model) | {
                    "bodies": [[b.joint.name, b.joint.axes, pose(b.placement)] for b in model.bodies[:2]]
                }
                return {key: entry for key, entry in answer.items() if key != "sites"}

            answers[f"{setting} {joint}"] = read(robot("", joint, above=text), shown)
    answers["free below"] = read(robot("").replace('name="k" type="slide" axis="0 0.6 0.8" ref="0.25"', 'type="free"'))
    answers["in the world"] = read(robot("").replace("<site", "<joint/><site"))
    answers["two names"] = read(robot("").replace('"k"', '"j"'))
    answers["key"] = [read(robot(f'<keyframe><key qpos="{q}"/></keyframe>')) for q in ("1", "0.5 0.75")]
    answers["keep"] = read(robot(""), keep="c")
    return answers


@records.of
def bodies_that_are_refused_or_named():
    inside = '<worldbody><body{}><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{}</body></worldbody>'
    tensors = ('diaginertia="1 1 1" fullinertia="1 1 1 0 0 0"', 'fullinertia="1 1 1 0 0 0" zaxis="1 0 0"')
    classes = '<default><joint damping="0.5"/><default class="x"><joint damping="3"/></default></default>'
    nested = '<body childclass="x"><joint/><body childclass=""><joint/><body><joint/></body></body><frame childclass=" "><body><joint/></body></frame></body>'
    texts = {
        **{tensor: f"<worldbody><body><joint/><inertial mass='1' {tensor}/></body></worldbody>" for tensor in tensors},
        "classes": f"{classes}<worldbody>{nested}</worldbody>",
        "composite": inside.format("", "<composite/>"), "flexcomp": inside.format("", "<flexcomp/>"),
        "replicate": inside.format("", "<replicate/>"), "attach": inside.format("", "<attach/>"),
        "two inertials": inside.format(' name="q"', '<inertial pos="0 0 0" mass="1"/>'),
        "no world": "<body/>", "class": inside.format(' childclass="z"', ""), "geom class": inside.format("", '<geom class="z"/>'),
        "unnamed": inside.format("", '<body><inertial pos="0 0 0" mass="2"/></body><body name="body3"><inertial pos="0 0 0" mass="3"/></body>'),
        "plugin": inside.format(' gravcomp="1"', "<plugin plugin='x'/>"), "empty world": "<worldbody/>", "named world": inside.format(' name="world"', ""),
        "empty class": inside.format(' childclass=""', "<geom class=' '/>"),
        "site": inside.format("", '<site name="s" class="main"/><site name="t" type="box" fromto="0 0 0 1 2 3" size="0.1"/><site name="u" type="sphere" fromto="0 0 0 1 2 3"/>'),
    }  # fmt: skip

    def shown(model):
        answer = described(model)
        return {key: answer.get(key) for key in ("frames", "sites", "mounts", "friction", "notes")}

    return {name: read(f"<mujoco>{text}</mujoco>", shown) for name, text in texts.items()}


# ── settings, defaults and files


@records.of
def settings_of_compilers():
    compilers = {
        "none": "<compiler/>",
        "all": """<compiler angle="radian" eulerseq="ZYX" autolimits="false" inertiafromgeom="true" inertiagrouprange="2 4" settotalmass="30"
        boundmass="0.1" boundinertia="0.02" balanceinertia="true" meshdir=" m/ " assetdir="a" strippath="true" alignfree="true"/>""",
        "assets": '<compiler assetdir="a"/>',
        "two": '<compiler angle="radian" eulerseq="zyx"/><compiler angle="degree" boundmass="2"/>',
        "local": '<compiler coordinate="local" inertiagrouprange="1"/>',
        "global": '<compiler coordinate="global"/>',
        "sequence": '<compiler eulerseq="xy"/>',
        "letters": '\n<compiler/>\n<compiler eulerseq="xyw"/>',
        "angle": '<compiler angle="grad"/>',
        "flag": '<compiler strippath="yes"/>',
    }

    def settings(text):
        try:
            found = Settings.from_root(element(f"<mujoco>{text}</mujoco>"))
        except TwistWrenchError as error:
            return str(error)
        return [found, found.angle]

    return {name: settings(text) for name, text in compilers.items()}


@records.of
def classes_of_defaults():
    root = element("""<mujoco><default><joint damping="1" axis="1 0 0"/><geom quat="1 0 0 0" pos="1 2 3"/><position kp="3" gear="2"/></default>
    <default class="main"><joint armature="2"/><mesh scale="2 2 2"/>
      <default class="x"><joint damping="3"/><geom euler="1 2 3"/><motor gear="5"/><general gainprm="7"/>
        <default class="y"><joint axis="0 0 1"/><velocity kv="2"/></default></default>
      <default class="z"><geom size="1"/></default></default></mujoco>""")
    defaults = Defaults(root)
    asked = [
        "<joint/>", '<joint class="x" damping="9"/>', '<joint class="y"/>', "<geom/>", '<geom class="x"/>', '<geom class="x" zaxis="1 0 0"/>',
        '<geom class="z"/>', "<site/>", "<motor/>", '<motor class="x"/>', '<general class="x"/>', '<general class="y" gear="1"/>', "<general/>",
        "<mesh/>", '<position class="x" gear="8"/>',
    ]  # fmt: skip
    answers = {text: defaults.apply(element(text)).attributes for text in asked}
    around = [defaults.apply(element(text), "y").attributes for text in ("<joint/>", '<joint class="x"/>', "<geom/>")]
    kind = defaults.apply(element('<weld a="1"/>'), kind="joint").attributes
    wrong = {
        "no name": "<default><default/></default>", "twice": '<default><default class="x"/><default class="x"/></default>',
        "outermost": '<default class="x"/>', "gone": '<default/>',
    }  # fmt: skip
    refused = {
        n: refusal(lambda t=t: Defaults(element(f"<m>{t}</m>")).apply(element('<geom class="q"/>')))
        for n, t in wrong.items()
    }
    checked = [defaults.check(root, ""), defaults.check(root, "y"), refusal(lambda: defaults.check(root, "w"))]
    return {"applied": answers, "around": around, "kind": kind, "refused": refused, "checked": checked}


@records.of
def included_files(folder):
    home, other = folder / "home", folder / "other"
    for path in (home / "parts", other):
        path.mkdir(parents=True)
    body = '<body name="{}"><joint/><inertial pos="0 0 0" mass="{}" diaginertia="1 1 1"/>{}</body>'
    files = {
        home / "robot.xml": '<mujoco><include file="options.xml"/><worldbody>' + body.format("first", 1, "") + '<include file="parts/arm.xml"/>'
        + body.format("last", 4, "") + "</worldbody></mujoco>",
        home / "options.xml": '<mujoco model="ignored"><option gravity="1 2 3"/></mujoco>',
        home / "parts" / "arm.xml": "<mujocoinclude>" + body.format("arm", 2, '<include file="hand.xml"/>') + '<include file="tool.xml"/></mujocoinclude>',
        home / "parts" / "hand.xml": "<mujocoinclude>" + body.format("hand", 3, "") + "</mujocoinclude>",
        home / "tool.xml": "<mujocoinclude>" + body.format("tool", 5, "") + "</mujocoinclude>",
        home / "parts" / "tool.xml": "<mujocoinclude>" + body.format("other tool", 6, "") + "</mujocoinclude>",
        other / "far.xml": "<mujocoinclude>" + body.format("far", 7, "") + "</mujocoinclude>",
        home / "twice.xml": '<mujoco><worldbody><include file="tool.xml"/>\n<include file="parts/../tool.xml"/></worldbody></mujoco>',
        home / "gone.xml": '<mujoco>\n<include file="none.xml"/></mujoco>',
        home / "out.xml": '<mujoco><worldbody><include file="../other/far.xml"/></worldbody></mujoco>',
        home / "absolute.xml": '<mujoco><include file="/etc/passwd"/></mujoco>',
        home / "address.xml": '<mujoco><include file="file:a.xml"/></mujoco>',
        home / "itself.xml": '<mujoco><include file="itself.xml"/></mujoco>',
        home / "wrong root.xml": '<mujoco><include file="root.xml"/></mujoco>', home / "root.xml": "<robot/>",
        home / "broken.xml": '<mujoco><include file="half.xml"/></mujoco>', home / "half.xml": "<mujoco>\n<a>",
        home / "nameless.xml": '<mujoco><include file=" "/></mujoco>',
        home / "bodies.xml": '<mujoco><worldbody><include file="many.xml"/></worldbody></mujoco>', home / "many.xml": "<mujocoinclude>" + "<body/>" * 3 + "</mujocoinclude>",
    }  # fmt: skip
    for k in range(18):
        files[home / f"deep{k}.xml"] = f'<mujoco><include file="deep{k + 1}.xml"/></mujoco>'
    files[home / "deep18.xml"] = "<mujoco/>"
    for path, text in files.items():
        path.write_text(text)

    def shown(model):
        return [
            model.name,
            model.gravity,
            {b.link: b.inertia.mass for b in model.bodies},
            [str(n) for n in model.defects],
        ]

    (other / "options.xml").write_text('<mujoco><option gravity="7 8 9"/></mujoco>')
    (other / "tool.xml").write_text("<mujocoinclude>" + body.format("third tool", 8, "") + "</mujocoinclude>")
    (other / "hand.xml").write_text("<mujocoinclude>" + body.format("third hand", 9, "") + "</mujocoinclude>")
    names = [path.name for path in files if path.parent == home and "deep" not in path.name]
    answers = {
        name: read(home / name, shown)
        for name in names
        if name not in ("root.xml", "half.xml", "options.xml", "tool.xml", "many.xml")
    }
    answers |= {name: read(home / name, shown) for name in ("deep1.xml", "deep2.xml", "deep3.xml")}
    answers["with folder"] = read(home / "out.xml", shown, include_paths=[other])
    answers["three folders"] = read(home / "robot.xml", shown, include_paths=[other])
    answers["few bodies"] = read(home / "bodies.xml", shown, max_bodies=2)
    answers["text"] = read(files[home / "out.xml"], shown)
    answers["text with folder"] = read(
        '<mujoco><worldbody><include file="far.xml"/></worldbody></mujoco>', shown, include_paths=[other]
    )
    return answers


# ── inertia


def masses(model):
    base = model.base_inertia.parameters
    bodies = [body.inertia.parameters for body in model.bodies]
    return [bodies, *([base] if base.any() else []), *model.defects]


@records.of
def inertia_by_setting():
    """Bodies with an inertial and geoms, with geoms alone, with neither, light, and flat."""
    world = """<geom name="floor" size="3" mass="4"/>
    <body name="both" pos="1 2 3"><joint/><inertial pos="0.1 0.2 0.3" mass="2" diaginertia="0.3 0.4 0.5"/><geom size="0.2" pos="0.3 0 0.1"/><geom size="0.1" group="5" mass="0.5"/></body>
    <body name="geoms"><joint/><geom type="box" size="0.1 0.2 0.3" group="1" pos="0.1 0.2 0"/><geom size="0.3" group="4"/><geom size="0.1" group="2" mass="0"/></body>
    <body name="groupless"><joint/><inertial pos="0.1 0 0" mass="1.5" diaginertia="0.1 0.2 0.25"/><geom size="0.2" group="9"/></body>
    <body name="light"><joint/><inertial pos="0.3 0.1 0.2" mass="0.01" diaginertia="0.0001 0.03 0.0002"/></body>
    <body name="still"><geom size="0.3" type="sdf"/><geom size="0.1"/></body>"""
    settings = ["", 'inertiafromgeom="true"', 'inertiafromgeom="false"', 'inertiagrouprange="1 4"', 'inertiagrouprange="2 4" inertiafromgeom="true"',
        'settotalmass="100"', 'settotalmass="0"', 'boundmass="0.5"', 'boundinertia="0.02"', 'balanceinertia="true"',
        'boundmass="0.01" boundinertia="0.0001"', 'boundmass="0.5" boundinertia="0.02" balanceinertia="true" settotalmass="50"']  # fmt: skip
    text = f"<mujoco><compiler {{}}/><worldbody>{world}</worldbody></mujoco>"
    return {setting: read(text.format(setting), masses) for setting in settings}


@records.of
def inertia_of_geoms():
    geoms = [
        'size="0.2" mass="3"', 'size="0.2"', 'type="capsule" size="0.1 0.3"', 'type="cylinder" size="0.1 0.3" mass="2"', 'type="box" size="0.1 0.2 0.3" density="500"',
        'type="ellipsoid" size="0.1 0.2 0.3"', 'type="plane" size="1 1 1"', 'type="box" size="0.1" fromto="0.1 0.2 0.3 0.4 0.5 0.9"',
        'type="sphere" size="0.1" fromto="0.1 0.2 0.3 0.4 0.5 0.9"', 'type="capsule" size="0.1 9" fromto="0.1 0.2 0.3 0.4 0.5 0.9" pos="9 9 9"',
        'type="hfield" hfield="hills" pos="0.1 0.2 0.3" euler="0 0 30"', 'type="hfield" hfield="none"', 'type="sdf" size="1"', 'shellinertia="true" size="1"',
        'mesh="m" type="box"', 'type="mesh" mesh="none"', 'type="mesh"', 'size="0"', 'type="box" size="1 0 1"', 'mass="-1" size="1"', 'density="-1" size="1"', 'type="cone"',
        'type="box" fromto="1 1 1 1 1 1" size="1"', 'mass="0" density="3" size="1"', 'density="0" size="1"', 'size="0.1 0.2 0.3 0.4"',
    ]  # fmt: skip
    text = """<mujoco><asset><hfield name="hills" size="0.5 0.75 0.4 0.1"/><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
    <worldbody><body name="b" pos="0.1 0.2 0.3"><joint axis="1 2 3"/><inertial pos="0 0 0" mass="0"/><geom {}/></body></worldbody></mujoco>"""
    return {geom: read(text.replace('<inertial pos="0 0 0" mass="0"/>', "").format(geom), masses) for geom in geoms}


CUBE = "0 0 0 1 0 0 1 1 0 0 1 0 0 0 2 1 0 2.5 1 1 2 0 1 2"
DENT = "0.5 0.5 1"
FACES = "0 2 1 0 3 2 0 1 5 0 5 4 1 2 6 1 6 5 2 3 7 2 7 6 3 0 4 3 4 7 4 5 8 5 6 8 6 7 8 7 4 8"


def msh(vertices, faces, normals=2, textures=3):
    """File of MuJoCo's own mesh format."""
    counts = np.array([len(vertices), normals, textures, len(faces)], "<i4").tobytes()
    between = np.full(3 * normals + 2 * textures, 0.5, "<f4").tobytes()
    return counts + np.asarray(vertices, "<f4").tobytes() + between + np.asarray(faces, "<i4").tobytes()


@records.of
def inertia_of_meshes(folder):
    vertices = np.array(f"{CUBE} {DENT}".split(), float).reshape(-1, 3)
    faces = np.array(FACES.split(), int).reshape(-1, 3)
    (folder / "parts").mkdir()
    (folder / "parts" / "cup.msh").write_bytes(msh(vertices, faces))
    for name, data in {
        "short": b"123", "counts": msh(vertices, faces)[:-4], "empty": msh([], faces), "faceless": msh(vertices, []), "nan": msh(vertices * np.nan, faces),
        "corner": msh(vertices, faces + 1),
    }.items():  # fmt: skip
        (folder / f"{name}.msh").write_bytes(data)
    (folder / "cup.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in vertices)
        + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    )
    (folder / "note.txt").write_text("x")
    inline = f'vertex="{CUBE} {DENT}" face="{FACES}"'
    meshes = {
        "legacy": inline, "exact": f'{inline} inertia="exact"', "convex": f'{inline} inertia="convex"', "shell": f'{inline} inertia="shell"',
        "scale": f'{inline} scale="0.5 2 1.5"', "mirror": f'{inline} scale="0.5 -2 1.5" inertia="exact"',
        "reference": f'{inline} refpos="0.1 0.2 0.3" refquat="0.5 -0.5 0.5 0.5" scale="0.5 2 1.5"', "exact reference": f'{inline} refpos="1 2 3" refquat="1 2 3 4" inertia="exact"',
        "hull": f'vertex="{CUBE}"', "hull of dent": f'vertex="{CUBE} {DENT}" inertia="exact"', "flat": 'vertex="0 0 0 1 0 0 0 1 0 1 1 0"', "flat faces": 'vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"', "line": 'vertex="0 0 0 1 0 0 0 1 0" face="0 1 1"',
        "inside out": f'vertex="{CUBE}" face="0 1 2" inertia="exact"', "no numbers": "", "odd": 'vertex="0 0"', "odd faces": 'vertex="0 0 0" face="0 1"',
        "wrong corner": 'vertex="0 0 0 1 0 0 0 1 0" face="0 1 3"', "negative corner": 'vertex="0 0 0 1 0 0 0 1 0" face="0 1 -1"',
        "msh": 'file="parts/cup.msh" inertia="exact"', "obj": 'file="cup.obj" inertia="exact"', "text": 'file="note.txt"', "gone": 'file="gone.stl"',
        "outside": 'file="../x.stl"', "short": 'file="short.msh"', "counts": 'file="counts.msh"', "empty": 'file="empty.msh"', "faceless": 'file="faceless.msh"',
        "nan": 'file="nan.msh"', "corner": 'file="corner.msh"',
    }  # fmt: skip
    answers = {}
    text = """<mujoco><compiler {}/><default><mesh scale="{}"/></default><asset><mesh name="m" {}/>{}</asset>
    <worldbody><body name="b"><joint/><geom type="mesh" mesh="m" pos="0.1 0.2 0.3" euler="20 30 40" {}/></body></worldbody></mujoco>"""

    def of(attributes, compiler="", scale="1 1 1", more="", geom="density='3'"):
        path = folder / "robot.xml"
        path.write_text(text.format(compiler, scale, attributes, more, geom))
        return read(path, masses)

    answers = {name: of(attributes) for name, attributes in meshes.items()}
    answers["class"] = of(inline, scale="2 3 4")
    answers["mass"] = of(inline, geom="mass='7'")
    answers["folder"] = of('file="cup.msh" inertia="exact"', 'meshdir="parts/"')
    answers["plain"] = of('file="a\\b/cup.msh" inertia="exact"', 'assetdir="parts" strippath="true"')
    answers["two"] = of(inline, more='\n<mesh name="m"/>')
    nameless = text.format("", "1 1 1", "", "", "").replace('name="m" ', 'file="cup.obj"').replace('"m"', '"cup"')
    (folder / "robot.xml").write_text(nameless)
    answers["by file"] = read(folder / "robot.xml", masses)
    return answers


@records.of
def files_of_meshes():
    root = element(
        """<mujoco><asset><mesh name="a" file="d\\a.stl" scale="1 2 3"/><mesh file="e/b.obj"/><mesh name="c"/><mesh name="f" scale="2"/></asset></mujoco>"""
    )
    answers = {}
    for setting in ({}, {"mesh_folder": "m\\n/"}, {"plain_names": True}, {"plain_names": True, "mesh_folder": "m"}):
        meshes = Meshes(root, Settings(**setting), Defaults(root), preprocess.Folders(None))
        answers[str(sorted(setting.items()))] = {name: meshes.file_and_scale(name) for name in "abcfz"}
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
