"""Actuator files, their YAML, Denavit–Hartenberg tables and screw lists: complete answers on record."""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import fields, replace

import numpy as np
import pytest
from recorded_answers import plain_values, refusal
from recorded_models import ShortRecords, described, rounded

import twistwrench as tw
from twistwrench import SpatialInertia
from twistwrench.core.errors import ModelWarning, TwistWrenchError
from twistwrench.formats import dh, yaml
from twistwrench.formats.actuators import ActuatorFile, add_actuators, gear_ratio, plain_share, read_log_side
from twistwrench.formats.yaml import UNITS, Section, in_si, read_yaml, short_text, si_unit
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder

records = ShortRecords(__file__)

TENSOR = np.array([[0.31, -0.02, 0.013], [-0.02, 0.27, 0.017], [0.013, 0.017, 0.22]])


def arm():
    """Arm with turning joints, a slide, a follower and a ball."""
    builder = ModelBuilder("arm")
    builder.add_link("base")
    parent = "base"
    joints = (
        ("waist", "revolute", (0.3, 0.4, 1.2)), ("boom", "prismatic", (1, 0, 0.5)), ("elbow", "continuous", (0, 1, 0)),
        ("wrist", "revolute", (1, 0, 0)), ("slide", "prismatic", (0, 0, 1)), ("grip", "revolute", (0, 0.6, 0.8)), ("ball", "ball", (1, 0, 0)),
    )  # fmt: skip
    for k, (name, kind, axis) in enumerate(joints):
        builder.add_link(f"l{k}", SpatialInertia.from_com(3.0 + k, (0.1, 0.2, 0.05 * k), TENSOR))
        placement = se3.exp(np.array([0.1 * k, 0.2, 0.05, 0.3, 0.1 * k, 0.2]))
        options = {} if name == "ball" else {"effort": 100.0 + k, "damping": 1.0 + k, "friction": 0.5 + k}
        builder.add_joint(name, kind, parent, f"l{k}", placement=placement, axis=axis, **options)
        parent = f"l{k}"
    builder.add_link("finger", SpatialInertia.from_com(0.5, (0, 0, 0.1), TENSOR / 9))
    builder.add_joint("finger", "prismatic", "l5", "finger", axis=(0, 1, 0), mimic=("grip", 0.02, 0.01))
    return builder.build(quiet=True)


DRIVES = """
robot: arm
motors:
  big: {torque_constant: 80 mN m/A, resistance: 650 mohm, inductance: 0.4 mH, voltage: 48 V, current_continuous: 6.5 A,
        current_peak: 17 A, speed: 6000 rpm,
        thermal: {winding_housing: 1.5 K/W, housing_ambient: 4 K/W, winding_time: 21 s, housing_time: 12 min, maximum: 130 degC,
                  coefficient: 0.0039, reference: 22 °C}}
  small: {torque_constant: 0.03 V s/rad, thermal: {housing_ambient: 5 K/W, housing_time: 0.5 h}}
couplings:
  pair: {motors: [m1, m2], joints: [elbow, slide], motor_per_joint: [[50, 4 mm/turn], [-30, 200]]}
  single: {motors: [m3], joints: [grip], joint_per_motor: [[0.02]]}
actuators:
  waist:
    ratio: 101:1
    efficiency: 85 %
    no_load_torque: 30 mN m
    motor: big
    rotor: {inertia: 33.3 g cm^2, axis: [0.6, 0, 0.8], place: [10 mm, 2 cm, 0.03 m], link: base}
    friction: {viscous: 12 mN m s/rad, coulomb: 1.5 N m, static: 20 kgf cm, stribeck: 5 rpm, load: 0.02}
    link_friction: {viscous: 0.25 N m s/rad, coulomb: 0.125 N m}
    axial: 1.5 kN
    radial: 900 N
    tilting: 35 N m
  boom: {ratio: 5 mm/turn, motor: {torque_constant: 0.05 N m/A}, stiffness: 300 N/mm, link_friction: {coulomb: 3 N},
         rotor: {inertia: 2 kg mm^2, extra: true, mass: 0.4 kg}, axial: 70 N, tilting: 8 N m}
  wrist: {ratio: -30, reflected_inertia: 3 kg cm^2, friction: {viscous: 0.5 N m s/rad}}
  m1: {ratio: 2, motor: small, reflected_inertia: 1 kg cm^2, friction: {coulomb: 0.02 N m}, effort: 2.5 N m}
  m2: {efficiency: 0.75, effort: 400 mN m, no_load_torque: 0.01 N m}
log:
  side: motor
  joints:
    waist: {coupled: {boom: 2 rad/m, wrist: 0.5}, zero: 10 deg, sign: -1, gain: 3 mN m/A}
    boom: {zero: 30 mm}
    elbow: {zero: 0.25 rad}
    m1: {sign: -1, gain: 2 N m/A}
"""


SLIDING = (
    "ratio: 2000 rad/m, reflected_inertia: 250 g, friction: {viscous: 2 kN s/m, coulomb: 3 N, static: 4 N, stribeck: 5 mm/s}",
    "radial: 8 kN, link_friction: {viscous: 7 N s/m}",
)


@records.of
def an_arm_with_all_drives():
    model = arm()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        driven = add_actuators(model, DRIVES)
        stiff = add_actuators(model, DRIVES, stiff=True)
    answer = described(driven)
    drives = {
        actuator.joint: {field.name: plain_values(getattr(actuator, field.name)) for field in fields(actuator)}
        for actuator in driven.actuators.values()
    }
    shown = ("limits", "friction", "armature", "joints", "springs", "couplings")
    return {key: answer[key] for key in shown} | {
        "drives": drives,
        "moving": [body.get("inertia") for body in answer["bodies"]][:4],
        "stiff": {key: described(stiff).get(key) for key in ("joints", "springs", "armature", "notes")},
        "log": read_log_side(model, DRIVES),
        "sliding": [
            described(add_actuators(model, f"actuators: {{boom: {{{text}}}}}\n")).get(key)
            for text in SLIDING
            for key in ("friction", "armature", "limits")
        ],
    }


@records.of
def logs_of_both_sides():
    model = arm()
    texts = {
        "none": "actuators: {}",
        "empty": "log: {}",
        "joint": "motors: {m: {torque_constant: 0.05 N m/A}}\nactuators: {waist: {ratio: 20, motor: m}, boom: {ratio: 10 mm/turn, motor: m}, elbow: {motor: m}, wrist: {ratio: 3}}\n"
        "log: {side: joint, joints: {waist: {gain: 2 N m/A, zero: 0.5 rad}, elbow: {sign: 1}}}",
        "motor": "motors: {m: {torque_constant: 0.05 N m/A}}\nactuators: {waist: {ratio: 20, motor: m}, boom: {ratio: 10 mm/turn}}\nlog: {side: motor, joints: {boom: {coupled: {waist: '3:2'}}}}",
        "side": "log: {side: both}",
        "joints": "log: {joints: {hip: {zero: 1 rad}}}",
        "entry": "log: {joints: {waist: {offset: 1 rad}}}",
        "sign": "log: {joints: {waist: {sign: 0.5}}}",
        "unit of zero": "log: {joints: {boom: {zero: 1 rad}}}",
        "itself": "log: {joints: {waist: {coupled: {waist: 2}}}}",
        "unit of ratio": "log: {joints: {waist: {coupled: {elbow: 2 mm/turn}}}}",
        "coupled motor": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]]}}\nlog: {joints: {a: {sign: 1}}}",
        "coupled joint": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]]}}\nlog: {side: motor, joints: {waist: {sign: 1}}}",
        "zero of motor": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]]}}\nlog: {side: motor, joints: {a: {zero: 1 rad}}}",
        "missing joint": "couplings: {c: {motors: [a], joints: [hip], motor_per_joint: [[2]]}}\nlog: {}",
        "extra": "log: {rate: 3}",
    }  # fmt: skip
    return {name: result(lambda text=text: read_log_side(model, f"{text}\n")) for name, text in texts.items()}


def result(call):
    """Result of a call, or type and text of its error."""
    try:
        return call()
    except (TwistWrenchError, ValueError, TypeError) as error:
        return rounded(f"{type(error).__name__}: {error}")


@records.of
def refused_actuator_files(folder):
    model = arm()
    (folder / "empty.yaml").write_text("")
    (folder / "twice.yaml").write_text("actuators:\n  waist: {ratio: 1}\n  waist: {ratio: 2}\n")
    (folder / "large.yaml").write_text("#" * 2**18 + "\n")
    waist = "actuators: {{waist: {}}}\n"
    texts = {
        "no actuators": "motors: {}\n", "unknown entry": "actuator: {}\n", "other robot": "robot: hand\nactuators: {}\n", "list": "[1, 2]\n",
        "unknown joint": "actuators: {hip: {}}\n", "follower": "actuators: {finger: {}}\n", "ball": "actuators: {ball: {}}\n", "not a section": "actuators: {waist: 3}\n", "actuators": "actuators: 3\n",
        "unknown key": waist.format("{gear: 3}"), "effort of joint": waist.format("{effort: 3 N m}"), "ratio": waist.format("{ratio: many}"), "ratio of zero": waist.format("{ratio: 3:0}"), "ratio unit": waist.format("{ratio: 3 mm/turn}"),
        "ratio of slide": "actuators: {boom: {ratio: x mm/turn}}\n", "no lead": "actuators: {boom: {ratio: 0 mm/turn}}\n", "slide by colon": "actuators: {boom: {ratio: '3:2'}}\n", "efficiency": waist.format("{efficiency: high}"), "percent": waist.format("{efficiency: x %}"),
        "too efficient": waist.format("{efficiency: 101 %}"), "no unit": waist.format("{no_load_torque: 3}"), "other unit": waist.format("{no_load_torque: 3 kg}"), "axial": waist.format("{axial: 0 N}"), "tilting": waist.format("{tilting: 3 N}"), "effort": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]]}}\nactuators: {a: {effort: -1 N m}}\n",
        "stiffness of motor": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]]}}\nactuators: {a: {stiffness: 1 N m/rad}}\n", "coupled joint": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]]}}\nactuators: {waist: {ratio: 1}}\n",
        "motor": waist.format("{motor: big}"), "motor list": waist.format("{motor: [1]}"), "motor without constant": waist.format("{motor: {resistance: 1 ohm}}"), "motor entry": waist.format("{motor: {torque_constant: 1 N m/A, colour: red}}"), "peak below": waist.format("{motor: {torque_constant: 1 N m/A, current_continuous: 3 A, current_peak: 2 A}}"),
        "thermal": waist.format("{motor: {torque_constant: 1 N m/A, thermal: {housing_time: 1 s}}}"), "thermal time": waist.format("{motor: {torque_constant: 1 N m/A, thermal: {housing_ambient: 1 K/W}}}"), "thermal entry": waist.format("{motor: {torque_constant: 1 N m/A, thermal: {a: 1}}}"),
        "rotor": waist.format("{rotor: {}}"), "rotor mass": waist.format("{rotor: {inertia: 1 kg m^2, mass: 1 kg}}"), "rotor extra": waist.format("{rotor: {inertia: 1 kg m^2, extra: maybe}}"), "rotor link": waist.format("{rotor: {inertia: 1 kg m^2, link: [a]}}"), "rotor axis": waist.format("{rotor: {inertia: 1 kg m^2, axis: [1, 2]}}"),
        "rotor axis text": waist.format("{rotor: {inertia: 1 kg m^2, axis: up}}"), "rotor place": waist.format("{rotor: {inertia: 1 kg m^2, place: [1 m, 2 m, 3]}}"), "rotor quoted": waist.format("{rotor: {inertia: 1 kg m^2, extra: 'True', mass: 2 kg}}"), "friction": waist.format("{friction: {dry: 1 N m}}"), "friction unit": "actuators: {boom: {friction: {coulomb: 1 N m}}}\n", "armature and rotor": waist.format("{reflected_inertia: 1 kg m^2, rotor: {inertia: 1 kg cm^2}}"),
        "matrices": "couplings: {c: {motors: [a], joints: [waist]}}\nactuators: {}\n", "both matrices": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [[2]], joint_per_motor: [[2]]}}\nactuators: {}\n", "rows": "couplings: {c: {motors: [a], joints: [waist], motor_per_joint: [2]}}\nactuators: {}\n",
        "uneven": "couplings: {c: {motors: [a, b], joints: [waist, elbow], motor_per_joint: [[2, 1], [1]]}}\nactuators: {}\n", "singular": "couplings: {c: {motors: [a, b], joints: [waist, elbow], motor_per_joint: [[2, 1], [4, 2]]}}\nactuators: {}\n", "not square": "couplings: {c: {motors: [a], joints: [waist, elbow], motor_per_joint: [[2, 1]]}}\nactuators: {}\n",
        "names": "couplings: {c: {motors: a, joints: [waist], motor_per_joint: [[2]]}}\nactuators: {}\n", "no names": "couplings: {c: {motors: [], joints: [waist], motor_per_joint: [[2]]}}\nactuators: {}\n", "no joints": "couplings: {c: {motors: [a], motor_per_joint: [[2]]}}\nactuators: {}\n", "unit per motor": "couplings: {c: {motors: [a], joints: [waist], joint_per_motor: [[2 mm/turn]]}}\nactuators: {}\n", "coupling entry": "couplings: {c: {gear: 3}}\nactuators: {}\n", "coupling": "couplings: {c: 3}\nactuators: {}\n",
        **{f"{n} brackets": "a: " + "[" * n + "]" * n + "\n" for n in (51, 52)},
        **{f"{n} blocks": "".join("  " * k + "a:\n" for k in range(n)) for n in (50, 51, 52, 53)},
    }  # fmt: skip
    answers = {
        name: result(lambda text=text: described(add_actuators(model, text)).get("actuators", "accepted"))
        for name, text in texts.items()
    }
    files = {
        "missing": folder / "none.yaml",
        "empty": folder / "empty.yaml",
        "twice": folder / "twice.yaml",
        "large": folder / "large.yaml",
        "long name": "n" * 250,
        "nul": "a\0b",
        "folder": folder,
        "number": 3,
        "mapping": {"actuators": {"hip": {}}},
    }
    answers |= {
        f"file {name}": result(lambda source=source: add_actuators(model, source).name)
        for name, source in files.items()
    }
    answers["entries"] = [
        ActuatorFile({"a": 1}, "x").entries,
        refusal(lambda: ActuatorFile([1], "x").entries),
        str(ActuatorFile(1, "x")),
    ]
    return answers


@records.of
def numbers_with_units():
    answers = {}
    for kind, factors in UNITS.items():
        answers[kind] = [si_unit(kind), {unit: in_si(f"2.5 {unit}", kind, "x") for unit in factors}]
    values = [
        "3",
        3,
        2.5,
        True,
        None,
        [1],
        "3 kg m^2",
        "3kg·m²",
        "3 kg*m^2",
        "3 kgm2",
        "-.5e-3 g cm2",
        "+2. kg m^2",
        "1e400 kg m^2",
        "x kg m^2",
        "3 N m",
        "3 3 kg m^2",
        "1_0 kg m^2",
        " 7 kg m^2 ",
        "33.3 g cm^2",
        "12 ",
    ]
    answers["inertia of"] = {
        repr(value): result(lambda value=value: in_si(value, "inertia", "a → b")) for value in values
    }
    answers["micro"] = [in_si("2 μH", "inductance", "x"), in_si("2 µH", "inductance", "x")]
    plain = [3, "3", " 2.5 ", True, "1_0", "nan", "inf", "", None, [1], "1e3", "x", math.inf, np.float64(2.5)]
    answers["plain"] = {
        repr(value) if not isinstance(value, np.floating) else "numpy": result(
            lambda value=value: yaml.plain_number(value, "no")
        )
        for value in plain
    }
    shares = ["85 %", "85%", 0.75, "0.75", " 7 % ", "x %", "%", None]
    answers["shares"] = {repr(value): result(lambda value=value: plain_share(value, "e")) for value in shares}
    ratios = [
        101,
        "101",
        "101:1",
        "-3:2",
        "1:3:2",
        "3:0",
        "0:3",
        "x:1",
        "2 rad/m",
        "5 mm/turn",
        "-0.005 m/turn",
        "0 mm/turn",
        "0 rad/m",
        "7 mm / turn",
        None,
        True,
    ]
    answers["ratios"] = {
        f"{value!r} {sliding}": result(lambda value=value, sliding=sliding: gear_ratio(value, "r", sliding=sliding))
        for value in ratios
        for sliding in (False, True)
    }
    return answers


@records.of
def sections_and_sources(folder):
    (folder / "a.yaml").write_text("x: 1:30\ny: [a, 2]\nz: {q: yes, 1: ~}\n")
    section = Section(
        {"a": {"b": "3 kg", "v": ["1 mm", "2 m", "3 cm"], "p": 2.5, "w": [1, 2, 3], "m": {"x": 1}, "n": [[1, 2, 3]]}},
        "",
    )
    inner = section.section("a")
    reading_end, writing_end = os.pipe()
    os.write(writing_end, b"x: 1\n")
    os.close(writing_end)
    piped, _ = read_yaml(f"/dev/fd/{reading_end}")
    os.close(reading_end)
    texts = [
        "x: 1\n",
        "x: 1",
        "a:b",
        "a\nb",
        str(folder / "a.yaml"),
        "",
        "a.yaml",
        "x: 1\nx: 2\n",
        "[",
        "x: &a [1]\ny: *a\n",
        "- x: 1\n  x: 2\n",
        "'q' : \"z\"\n",
    ]
    return {
        "sources": {f"{k}": result(lambda text=text: read_yaml(text)) for k, text in enumerate(texts)},
        "path": result(lambda: read_yaml(folder / "a.yaml", "catalogue", "motors")),
        "missing": [result(lambda e=e: read_yaml(folder / "b.yaml", "file", e)) for e in ("actuators", "motors", "kinematics")],
        "piped": piped,
        "mapping": result(lambda: read_yaml({"a": 1}, entry="motors")),
        "other": result(lambda: read_yaml(3, entry="motors")),
        "where": [section.where("a"), inner.where("b"), inner.section("m").where("c")],
        "numbers": [inner.number("b", "mass"), inner.number("p", ""), inner.vector("v", "length"), inner.vector("w", "")],
        "wrong": [
            result(lambda: inner.number("b", "")), result(lambda: inner.number("p", "mass")), result(lambda: inner.vector("b", "mass")), result(lambda: inner.vector("m", "")),
            result(lambda: inner.vector("n", "")), result(lambda: inner.vector("w", "length")), result(lambda: inner.only("b", "v")), result(lambda: section.only("b")), result(lambda: Section(3, "")), result(lambda: inner.section("b")),
        ],
        "optional": [inner.optional("b", inner.number, "mass"), inner.optional("c", inner.number, "mass")],
        "short": [short_text(value) for value in ("x" * 200, [[[1]]], list(range(20)), {k: k for k in range(9)}, 3)],
    }  # fmt: skip


# ── tables and screw lists

TABLE = {"theta": [0.3, -0.4, 0.5], "d": [0.4, 0.05, -0.1], "a": [0.1, 0.35, 0.25], "alpha": [0.7, -1.2, 0.2]}


def masses():
    return {
        "masses": [4.0, 3.0, 2.0],
        "coms": [[0.1, 0.02, 0.03], [-0.1, 0.04, 0.05], [0.06, 0.07, -0.08]],
        "moments_about_com": [TENSOR, 0.5 * TENSOR, 0.2 * TENSOR],
    }


@records.of
def arms_of_tables():
    tool = se3.exp(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    rows = [dict(zip(TABLE, row, strict=True)) for row in zip(*TABLE.values(), strict=True)]
    answers = {}
    for convention in dh.CONVENTIONS:
        robot = tw.from_dh(
            TABLE,
            convention=convention,
            joint_types=["revolute", "prismatic", "revolute"],
            tool=tool,
            gravity=(1, -2, 9),
            name="x",
            joint_names=["p", "q", "r"],
            **masses(),
        )
        answers[convention] = described(robot.model)
    columns = ("a", "alpha", "d", "theta")
    tables = {
        "rows": (rows, {}), "few columns": ({"a": [1.5, 2.5]}, {}), "few entries": ([{"a": 1.5}, {"d": 2.5}], {}), "array": (np.array([TABLE[c] for c in columns]).T, {"columns": columns}),
        "degrees": ({"theta": [0, 90, 45], "alpha": [2 * np.pi, 6.2831863, -6.29]}, {}), "sliding": (TABLE, {"joint_types": "prismatic"}), "one": ({"theta": 0.25, "a": 2}, {}),
    }  # fmt: skip
    for name, (table, options) in tables.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            model = tw.from_dh(table, **options).model
        found = described(model)
        answers[name] = [
            model.name,
            found["joints"],
            found.get("notes"),
            [body.get("placement") for body in found["bodies"]],
            found["frames"]["link1"],
            list(found["frames"])[-1],
            body_kinds(model),
        ]
    return answers


def body_kinds(model):
    return " ".join(body.joint.kind for body in model.bodies)


@records.of
def refused_tables():
    calls = {
        "convention": (TABLE, {"convention": "craig"}), "column": ({"phi": [1]}, {}), "column of row": ([{"a": 1}, {"phi": 1}], {}), "lengths": ({"a": [1, 2], "d": [1]}, {}), "empty": ({}, {}), "matrix": ({"a": [[1]]}, {}),
        "array": (np.zeros((2, 4)), {}), "shape": (np.zeros((2, 3)), {"columns": "abc"}), "columns": (np.zeros((2, 4)), {"columns": ("theta", "d", "a", "a")}), "unknown columns": (np.zeros((2, 4)), {"columns": ("theta", "d", "a", "b")}), "nan": ({"a": [np.nan]}, {}),
        "type": (TABLE, {"joint_types": "ball"}), "types": (TABLE, {"joint_types": ["revolute"]}), "names": (TABLE, {"joint_names": "abc"}), "many names": (TABLE, {"joint_names": ["a", "b", "c", "d"]}), "masses": (TABLE, {"masses": [1, 2]}), "coms": (TABLE, {"coms": [1, 2, 3]}),
        "moments": (TABLE, {"moments_about_com": np.zeros((3, 3))}), "negative": (TABLE, {"masses": [1, -2, 3]}), "tool": (TABLE, {"tool": np.zeros((3, 3))}), "impossible": (TABLE, {"masses": [1, 1, 1], "moments_about_com": [np.diag([1, 1, 3.0])] * 3}),
    }  # fmt: skip
    return {name: result(lambda t=t, o=o: tw.from_dh(t, **o).nv) for name, (t, o) in calls.items()}


STRAIGHT = np.array([[0, 1, 0, 0.5, 0, -1.0], [0, 0, 0, 1.0, 0, 0], [0.6, 0, 0.8, 0, 0.25, 0]]).T
"""Screws with exact zeros."""


@records.of
def lists_of_screws():
    model = tw.from_dh(
        TABLE, convention="modified", joint_types=["revolute", "prismatic", "revolute"], **masses()
    ).model
    lists = dh.screw_lists(model)
    at_com = dh.screw_lists(model, at_com=True)
    again = tw.from_screws(
        lists.M, lists.Slist, lists.Mlist, lists.Glist, gravity=(1, -2, 9), name="again", joint_names=["u", "v", "w"]
    )
    other = tw.from_screws(None, 2.0 * lists.Slist, lists.Mlist, lists.Glist, non_unit_screws=True)
    pitched = lists.Slist + np.outer([0, 0, 0, 0.1, 0.2, 0.3], [1, 0, 0])
    bad = lists.M.copy()
    bad[0, 3] += 2e-6
    close = lists.M.copy()
    close[0, 3] += 5e-7

    def build(M=None, S=lists.Slist, Mlist=lists.Mlist, G=lists.Glist, **options):
        return tw.from_screws(M, S, Mlist, G, **options).model

    tree = ModelBuilder("tree")
    for name in "abc":
        tree.add_link(name, SpatialInertia.from_com(1.0, (0, 0, 0), TENSOR))
    tree.add_joint("p", "revolute", "a", "b")
    tree.add_joint("q", "revolute", "a", "c")
    chain = ModelBuilder("chain")
    for name in "abc":
        chain.add_link(name, SpatialInertia.from_com(1.0, (0, 0, 0), TENSOR))
    chain.add_joint("p", "revolute", "a", "b")
    chain.add_joint("q", "ball", "b", "c")
    return {
        "lists": [lists.M, lists.Slist, lists.Blist, lists.Mlist, lists.Glist],
        "at centres": [np.abs(at_com.Mlist[:, :3, 3]).sum(), np.linalg.norm(at_com.Mlist[:, :3, 3], axis=1)[:1], [np.diag(G) for G in at_com.Glist], at_com.M],
        "again": described(again.model),
        "exact": [[body.joint.kind, body.joint.axes] for body in tw.from_screws(None, STRAIGHT, [np.eye(4)] * 4, lists.Glist).model.bodies],
        "longer": [body.joint.axes for body in other.model.bodies],
        "pitched": [[body.joint.kind, body.joint.axes] for body in build(S=pitched).bodies],
        "names": build().joint_names,
        "close": build(close).name,
        "refused": [
            result(lambda: build(bad)), result(lambda: build(np.eye(3))), result(lambda: build(S=1.000002 * lists.Slist)), result(lambda: build(S=lists.Slist[:5])), result(lambda: build(S=lists.Slist * [1, 2, 1])),
            result(lambda: build(Mlist=lists.Mlist[:3])), result(lambda: build(G=lists.Glist[:2])), result(lambda: build(S=lists.Slist[:, 0])), result(lambda: build(joint_names=["a"])), result(lambda: build(G=-lists.Glist)),
            result(lambda: build(bad * np.nan)), result(lambda: dh.screw_lists(tree.build(quiet=True))), result(lambda: dh.screw_lists(chain.build(quiet=True))), result(lambda: dh.screw_lists(replace(model, tip="link1"))), result(lambda: dh.screw_lists(replace(model, tip="link0"))), result(lambda: dh.screw_lists(add_actuators(arm(), DRIVES))), result(lambda: build(S=1.0000008 * lists.Slist).nv),
            result(lambda: dh.screw_lists(arm())),
        ],
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
