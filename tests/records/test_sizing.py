"""Sizing of drives: motors and gears of a catalogue, on both sides of every rating."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.doubts import Doubt
from twistwrench.mechanics.model.actuators import Motor, Thermal
from twistwrench.reports.motors import Demand
from twistwrench.reports.torque_report import Excess
from twistwrench.sizing import choice, winding
from twistwrench.sizing.catalog import read_catalog
from twistwrench.sizing.choice import drive_name, smallest_drives
from twistwrench.sizing.cycle import RPM, Cycle, with_noise
from twistwrench.sizing.drives import hot_motor, sized_motor, supply_of, warm_resistance
from twistwrench.sizing.gear import Gear, average_speed, average_torque, emergency_events, life_hours, sized_gear
from twistwrench.sizing.sizing_view import drives_table, worst_moment

from .report_cases import CRANE, TRIPOD, fields_of, quietly, said, shown, write_log

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


def _link(name, mass, com, moments):
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}" rpy="0.2 -0.1 0.3"/><mass value="{mass}"/>'
        '<inertia ixx="{}" iyy="{}" izz="{}" ixy="{}" ixz="{}" iyz="{}"/></inertial></link>'.format(*moments)
    )


def _joint(name, kind, parent, child, place, axis, friction):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}" rpy="0.2 0.3 0.1"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="90" velocity="5"/><dynamics damping="{friction[0]}" friction="{friction[1]}"/></joint>'
    )


ARM = (
    '<robot name="arm"><link name="stand"/>' + _link("upper", 3.1, "0.2 0.03 -0.05", (0.03, 0.05, 0.06, 0.002, -0.003, 0.001))
    + _link("lower", 1.9, "0.15 -0.04 0.06", (0.011, 0.023, 0.021, 0.001, -0.002, 0.0015)) + _link("slide", 0.6, "0.03 0.02 0.01", (0.002, 0.003, 0.0025, 0, 0, 0))
    + _joint("waist", "revolute", "stand", "upper", "0.1 0 0.4", "0.1 -0.2 0.95", (0.4, 0.7)) + _joint("elbow", "revolute", "upper", "lower", "0.4 0.03 0.05", "0.1 0.97 0.2", (0.3, 0.5))
    + _joint("push", "prismatic", "lower", "slide", "0.3 0 0", "1 0.1 0", (2, 1)) + "</robot>"
)  # fmt: skip
CATALOG = """
motors:
  tiny: {torque_constant: 0.03 N m/A, resistance: 0.9 ohm, voltage: 36 V, current_continuous: 2.1 A, current_peak: 9 A, speed: 7000 rpm, mass: 0.11 kg, price: 90, rotor: {inertia: 24 g cm^2}}
  small: {torque_constant: 0.06 N m/A, resistance: 0.5 ohm, voltage: 36 V, current_peak: 22 A, speed: 6000 rpm, mass: 0.31 kg, price: 140, rotor: {inertia: 110 g cm^2}, thermal: {winding_housing: 1.9 K/W, housing_ambient: 4.1 K/W, winding_time: 17 s, housing_time: 700 s, maximum: 125 degC}}
  large: {torque_constant: 0.11 N m/A, resistance: 0.2 ohm, inductance: 0.3 mH, voltage: 48 V, current_continuous: 8 A, current_peak: 40 A, speed: 5200 rpm, mass: 0.9 kg, price: 260, rotor: {inertia: 680 g cm^2}}
  bare: {torque_constant: 0.05 N m/A, current_continuous: 5 A}
gears:
  g50: {ratio: 50, efficiency: 0.75, no_load_torque: 0.011 N m, mass: 0.42 kg, price: 300, rated_torque: 12 N m, rated_speed: 2000 rpm, average_torque: 15 N m, repeated_peak: 30 N m, momentary_peak: 60 N m, average_speed: 3500 rpm, maximum_speed: 6500 rpm, life: 35000 h, mean_exponent: 3.3, axial: 900 N, radial: 700 N, tilting: 80 N m}
  g100: {ratio: -100, efficiency: 0.7, no_load_torque: 0.02 N m, mass: 0.8 kg, price: 420, rated_torque: 40 N m, rated_speed: 2000 rpm, average_torque: 45 N m, repeated_peak: 90 N m, momentary_peak: 160 N m, average_speed: 3500 rpm, maximum_speed: 5600 rpm, life: 30000 h, mean_exponent: 3}
  p20: {kind: planetary, ratio: 20, efficiency: 0.94, mass: 0.5 kg, rated_torque: 20 N m, rated_speed: 3000 rpm, average_torque: 20 N m, repeated_peak: 40 N m, momentary_peak: 70 N m, average_speed: 4000 rpm, maximum_speed: 6000 rpm, life: 20000 h}
"""


@functools.cache
def arm():
    return quietly(tw.load)(ARM, gravity=(0.7, -1.1, -9.5)).with_armature({"elbow": 0.04})


def swing(scale=1.0, rows=15, robot=None):
    t = 0.05 * np.arange(rows) + 0.004 * np.sin(np.arange(rows))
    phase = np.outer(t, [2.1, 3.3, 4.7]) + np.array([0.3, 1.2, 2.2])
    a = scale * np.array([0.8, 0.6, 0.05])
    rates = np.array([2.1, 3.3, 4.7])
    return tw.Motion(
        t,
        np.array([0.2, -0.4, 0.1]) + a * np.sin(phase),
        a * rates * np.cos(phase),
        -a * rates**2 * np.sin(phase),
        robot=robot or arm(),
        in_seconds=True,
    )


def sized(**options):
    given = {"payload": "0.8,0.02,0.01,0.03@slide", "pause": 0.37, "ambient": 31.0} | options
    return quietly(tw.size_drives)(arm(), given.pop("motion", None) or swing(), given.pop("catalog", CATALOG), **given)


def drives_of(sizing):
    return {
        name: [
            one.drive,
            one.mass,
            one.excess,
            one.missing,
            one.open,
            one.fits,
            one.sure,
            one.tightest,
            fields_of(one.cycle, *Cycle._fields),
        ]
        for name, one in sizing.joints.items()
    }


def loads_of(part):
    names = [name for name in vars(part) if not name.startswith("_")]
    return fields_of(part, *names) | {"tightest": part.tightest.what}


WITH_DRIVES = CATALOG + "actuators:\n  waist: {motor: small, gear: g100}\n  elbow: {motor: tiny, gear: g50}\n"


@records.of(relative=1e-6)
def chosen_drives_of_an_arm():
    sizing = sized()
    return {
        "report": said(sizing),
        "view": shown(sizing.blocks()),
        "joints": drives_of(sizing),
        "choice": sizing.choice,
        "supply": sizing.supply,
        "brief": sizing.brief,
        "mass": sizing.mass,
        "left out": sizing.left_out,
    }


@records.of(relative=1e-6)
def given_drives_of_an_arm(folder):
    sizing = sized(catalog=WITH_DRIVES, life=9000.0, emergency=swing(1.7), brake=True)
    text = sizing.write_actuators(folder / "a.yaml").read_text()
    return {
        "report": said(sizing), "loads": {name: [loads_of(one.motor), loads_of(one.gear)] for name, one in sizing.joints.items()}, "supply": sizing.supply, "actuators": text.splitlines(), "choice": sizing.choice,
        "csv": sizing.to_csv(folder / "a.csv").read_text().splitlines(), "worst": worst_moment(sizing), "origin": [entry[0] for entry in sizing.origin() if isinstance(entry, tuple)],
        "subject": [sizing.subject, sizing.robot_name, list(sizing.sources()), sizing.of_drives.word], "chosen": {name: one.drive for name, one in sizing.choose().joints.items()}, "smallest": smallest_drives(sizing, sizing.choose()),
    }  # fmt: skip


@records.of(relative=1e-6)
def options_of_a_sizing():
    fast = swing(2.3)
    answers = {
        "plain": sized(catalog=WITH_DRIVES), "no pause": sized(catalog=WITH_DRIVES, pause=0.0), "brake": sized(catalog=WITH_DRIVES, brake=True, pause=2.0), "no brake": sized(catalog=WITH_DRIVES, pause=2.0), "no friction": sized(catalog=WITH_DRIVES, friction=False),
        "no masses": sized(catalog=WITH_DRIVES, add_masses=False), "own supplies": sized(catalog=WITH_DRIVES, shared_supply=False), "hot": sized(catalog=WITH_DRIVES, ambient=80.0), "choose": sized(catalog=WITH_DRIVES, choose=True), "life": sized(life=60000.0), "fast": sized(motion=fast, catalog=WITH_DRIVES), "too fast": sized(motion=swing(4.0)),
        "no payload": sized(payload=()), "draws": sized(catalog=WITH_DRIVES, draws=[swing(f) for f in (0.97, 1.02, 1.05)]),
        "nothing": sized(catalog="motors: {weak: {torque_constant: 0.001 N m/A, resistance: 1 ohm, voltage: 1 V, current_continuous: 0.1 A, current_peak: 0.2 A, speed: 100 rpm, mass: 0.1 kg, rotor: {inertia: 1 g cm^2}}}\ngears: {g: {ratio: 2}}"),
        "servos": sized(catalog="servos"),
    }  # fmt: skip
    return {
        name: [sizing.verdict, sizing.brief, sizing.supply, {joint: [one.drive, one.tightest, one.motor.rms_current, one.motor.inertia_ratio] for joint, one in sizing.joints.items()}, [[c.drive, c.smaller, c.rivals] for c in sizing.choice.values()]]
        for name, sizing in answers.items()
    } | {"table": shown([drives_table(answers["fast"], 31.0)]), "draws": {j: one.motor.demands for j, one in answers["draws"].joints.items()}, "nothing": shown(answers["nothing"].blocks())}  # fmt: skip


@records.of(relative=1e-4)
def sizings_of_logs(folder):
    names = [*(f"{name}{part}" for part in ("", ".vel", ".acc") for name in ("waist", "elbow", "push"))]
    motion = swing(rows=24)
    exact = write_log(folder / "exact.csv", motion.time, (motion.q, motion.dq, motion.ddq), names)
    wrong = write_log(folder / "wrong.csv", motion.time, (motion.q, 4 * motion.dq, motion.ddq), names)
    good = sized(motion=exact, catalog=WITH_DRIVES)
    refused = sized(motion=wrong, catalog=WITH_DRIVES)
    over = sized(
        motion=write_log(folder / "fast.csv", motion.time, (motion.q, 1.0 * motion.dq, motion.ddq), names),
        catalog=WITH_DRIVES.replace("rated_torque: 40", "rated_torque: 41").replace(
            "repeated_peak: 90", "repeated_peak: 9"
        ),
    )
    table = {
        "good": [said(good), good.subject, list(good.sources())],
        "refused": [said(refused), refused.verdict, refused.brief, worst_moment(good)[2]],
        "over": over.verdict,
    }
    doubted = Doubt("repeated", "rows are repeated", ("elbow",), "unsure")
    excess = Excess("elbow", "effort", 99.0, 90.0, 0.3, "N m", True)
    for name, sizing in {"good": good, "over": over}.items():
        for kind in ("repeated", "gap"):
            for excesses in ((), (excess,)):
                doubts = (replace(doubted, kind=kind, sentence=f"a doubt of {kind}"),)
                report = replace(sizing.report, doubts=doubts, excesses=excesses)
                table[f"{name} {kind} {len(excesses)}"] = replace(sizing, report=report).verdict
    return table  # fmt: skip


# ── Parts


def cycle(scale=1.0, bearing=None):
    n = 9
    t = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.55, 0.7, 0.9, 1.1])
    k = np.arange(n)
    return Cycle(
        t, np.diff(t), scale * np.sin(0.9 * k + 0.2), scale * (9 * np.cos(0.7 * k) + 2), 3.0 * np.cos(1.1 * k), 0.7 * np.sin(0.5 * k + 1), 0.5 + 0.1 * np.cos(k),
        bearing or {},
    )  # fmt: skip


@records.of
def loads_of_motors():
    catalog = read_catalog(CATALOG)
    gear = catalog.gears["g50"]
    back = catalog.gears["g100"]
    table = {}
    for name, entry in catalog.motors.items():
        table[name] = [
            loads_of(sized_motor(entry, gear, cycle(), ambient=31.0)),
            loads_of(sized_motor(entry, back, cycle(), ambient=25.0, holding=slice(6, 9), weighs=True)),
        ]
    small, tiny = catalog.motors["small"], catalog.motors["tiny"]
    base = sized_motor(tiny, gear, cycle(), ambient=25.0)
    for field, value in (
        ("current_peak", base.peak_current),
        ("speed", base.peak_speed),
        ("current_continuous", base.rms_current),
    ):
        for factor in (0.99, 1.01):
            motor = replace(tiny, motor=replace(tiny.motor, **{field: factor * value}))
            found = sized_motor(motor, gear, cycle(), ambient=25.0)
            table[f"{field} {factor}"] = [found.demands, found.missing, [d.what for d in found.excess]]
    for maximum in (40.0, 60.0, math.inf):
        thermal = replace(small.motor.thermal, maximum=maximum)
        hot = replace(small, motor=replace(small.motor, thermal=thermal))
        found = sized_motor(hot, gear, cycle(1.6), ambient=35.0)
        table[f"maximum {maximum}"] = [
            found.demands,
            found.missing,
            found.power,
            hot_motor(hot.motor, 35.0).resistance,
            hot_motor(hot.motor, 35.0).current_continuous,
        ]
    runaway = sized_motor(small, gear, cycle(9.0), ambient=35.0)
    table["runaway"] = [runaway.demands, runaway.power, runaway.temperature]
    servo = read_catalog("servos").motors["STS3215"]
    table["servo"] = loads_of(
        sized_motor(servo, read_catalog("servos").gears["none"], cycle(0.1), ambient=40.0, weighs=True)
    )
    table["missing"] = [
        sized_motor(
            replace(tiny, motor=Motor(0.05, **given), inertia=j, unstated=frozenset({"mass"})),
            gear,
            cycle(),
            ambient=a,
            weighs=w,
        ).missing
        for given, j, a, w in (
            ({}, 0.0, 25.0, True),
            ({"resistance": 1.0, "current_continuous": 3.0}, 1e-5, 25.1, False),
            ({"thermal": Thermal(housing_ambient=2.0, housing_time=500.0)}, 0.0, 25.0, True),
        )
    ]
    table["resistance"] = [
        warm_resistance(small.motor, np.array([[20.0, 1], [80.0, 2], [np.inf, 3]])),
        warm_resistance(tiny.motor, np.zeros((0, 2))),
        warm_resistance(
            replace(small.motor, thermal=replace(small.motor.thermal, maximum=math.inf)), np.array([[np.inf, 1.0]])
        ),
    ]
    table["rotor"] = cycle().rotor_torque(2e-5, -50.0)
    return table  # fmt: skip


@records.of
def loads_of_gears():
    catalog = read_catalog(CATALOG)
    bearing = {
        "axial": np.array([1, 2, 950.0, 4, 5, 6, 7, 8, 9]),
        "radial": np.arange(9.0) * 20,
        "tilting": np.arange(9.0)[::-1] * 12,
    }
    table = {}
    for name, gear in catalog.gears.items():
        table[name] = [
            loads_of(sized_gear(gear, cycle())),
            loads_of(sized_gear(gear, cycle(bearing=bearing), 9000.0, cycle(2.0), weighs=True)),
        ]
    gear = catalog.gears["g50"]
    base = sized_gear(gear, cycle(), 1000.0, cycle(2.0))
    for field, value in (
        ("average_torque", base.average_torque),
        ("repeated_peak", base.peak_torque),
        ("average_speed", base.average_speed),
        ("maximum_speed", base.maximum_speed),
        ("momentary_peak", 22.0),
    ):
        for factor in (0.99, 1.01):
            found = sized_gear(replace(gear, **{field: factor * value}), cycle(), 1000.0, cycle(2.0))
            table[f"{field} {factor}"] = [[d.what for d in found.excess], found.life, found.tightest]
    for factor in (0.99, 1.01):
        table[f"life {factor}"] = [d.what for d in sized_gear(gear, cycle(), factor * base.life).excess]
        planetary = replace(
            catalog.gears["p20"], rated_torque=factor * 8.0, average_torque=11.0 * factor, rated_speed=1e3
        )
        found = sized_gear(planetary, cycle(), 1000.0)
        table[f"planetary {factor}"] = [found.life, found.missing, found.average_torque, found.peak_torque]
    slow = replace(catalog.gears["p20"], rated_torque=1e3, rated_speed=1.0)
    still = cycle()._replace(speed=np.zeros(9))
    table["planetary fast"] = [sized_gear(slow, cycle(), 1000.0).life, sized_gear(slow, cycle(), 1000.0).missing]
    table["still"] = loads_of(sized_gear(gear, still, 1000.0))
    table["unstated"] = [
        sized_gear(
            Gear("x", kind, 30.0, unstated=frozenset({"efficiency", "no_load_torque", "mass", "mean_exponent"})),
            cycle(),
            life,
            e,
            weighs=w,
        ).missing
        for kind in ("strain_wave", "planetary", "direct")
        for life, e, w in ((None, None, False), (9.0, cycle(), True))
    ]
    T, t, v = np.array([150.0, -82, 130, 0]), np.array([0.2, 3, 0.3, 0.2]), np.array([10.0, 20, -10, 0])
    table["means"] = [
        average_torque(T, v, t),
        average_torque(T, v, t, 3.3),
        average_torque(T, 0 * v, t),
        average_speed(v, t),
        life_hours(gear, 9.0, 150.0),
        emergency_events(20.0, 0.15, 100.0),
        emergency_events(0.0, 0.15, 100.0),
    ]
    return table  # fmt: skip


@records.of
def windings_of_motors():
    two = Thermal(
        winding_housing=1.9,
        housing_ambient=4.1,
        winding_time=17.0,
        housing_time=700.0,
        maximum=125.0,
        coefficient=0.0039,
        reference=22.0,
    )
    one = Thermal(
        winding_housing=0.0,
        housing_ambient=4.1,
        winding_time=0.0,
        housing_time=300.0,
        maximum=125.0,
        coefficient=0.0039,
        reference=22.0,
    )
    table = {}
    squares, duration = np.array([4.0, 0.0, 9.0, 1.0, 25.0]), np.array([3.0, 1.5, 2.0, 6.0, 0.4])
    for name, thermal in {"two": two, "one": one, "constant": replace(two, coefficient=0.0)}.items():
        table[name] = [
            winding.transitions(thermal, 0.5, squares, duration, 31.0), winding.periodic_temperatures(thermal, 0.5, squares, duration, 31.0), winding.periodic_temperatures(thermal, 0.5, squares * 9, duration, 31.0), winding.periodic_temperatures(thermal, 0.5, squares[:1], duration[:1], 31.0),
            winding.runaway_current(thermal, 0.5), [winding.allowed_current(thermal, 0.5, a) for a in (-10.0, 25.0, 124.9, 125.0, 126.0)], winding.allowed_current(thermal, 0.0, 25.0), winding.allowed_current(replace(thermal, maximum=math.inf), 0.5, 25.0), winding.allowed_current(replace(thermal, maximum=math.nan), 0.5, 25.0),
        ]  # fmt: skip
    table["cumulative"] = [winding._cumulative(np.cos(np.arange(9.0 * k)).reshape(k, 3, 3)) for k in (1, 2, 3, 6, 7)]
    return table


@records.of
def supplies_and_noise():
    powers = [np.array([10.0, -30, 5, 7]), np.array([-4.0, 20, -9, 2]), np.array([1.0, 2, -3, -50])]
    duration = np.array([0.5, 0.2, 1.3])
    demands = [
        Demand("a", 10.0, 12.0, "A", 0.1),
        Demand("b", 3.0, math.inf, "V"),
        Demand("a", 10.0, 13.0, "A"),
        Demand("c", math.inf, 3.0, "A"),
        Demand("d", 1.0, 2.0, "A"),
    ]
    draws = [
        [
            Demand("a", 10.5 + k, 12.0, "A"),
            Demand("b", 3.0 + 0.1 * k, math.inf, "V"),
            Demand("a", 9.0 - k, 13.0, "A"),
            Demand("c", 1.0, 3.0, "A"),
        ]
        for k in range(4)
    ]
    return {
        "shared": supply_of(powers, duration, shared=True), "own": supply_of(iter(powers), duration, shared=False), "noise": with_noise(demands, draws), "one draw": with_noise(demands, draws[:1]), "rpm": RPM,
        "names": [drive_name(pair) for pair in (("m", "g"), ("m", "none"))],
    }  # fmt: skip


@records.of
def catalogues_of_all_forms(folder):
    def read(text):
        catalog = read_catalog(text)
        return [
            catalog.motors,
            {name: gear for name, gear in catalog.gears.items() if name != "none"},
            catalog.pairs,
            dict(catalog.drives),
            catalog.bears,
            [catalog.size(pair) for pair in catalog.pairs],
        ]

    motor = "torque_constant: 0.1 N m/A, resistance: 1 ohm"
    path = folder / "catalog.yaml"
    path.write_text(CATALOG)
    table = {
        "whole": read(CATALOG), "drives": read_catalog(WITH_DRIVES).drives, "file": len(read_catalog(path).pairs), "pairs": read(f"motors: {{a: {{{motor}}}, b: {{{motor}}}}}\ngears: {{g: {{ratio: 101:1}}}}\npairs: [[a, g], [b, none]]"), "servos": read("servos"),
        "servo with gears": read("motors: {s: {stall_torque: 3 N m, no_load_speed: 60 rpm, voltage: 12 V, mass: 0.2 kg, price: 9}, a: {" + motor + "}}\ngears: {g: {ratio: 30, kind: planetary, mass: 0.3 kg, price: 5}}"),
    }  # fmt: skip
    wrong = {
        "no motors": "gears: {}", "unknown entry": "motors: {a: {" + motor + "}}\nmotor: 3", "no gears": "motors: {a: {" + motor + "}}", "no ratio": "motors: {a: {" + motor + "}}\ngears: {g: {kind: planetary}}", "kind": "motors: {a: {" + motor + "}}\ngears: {g: {ratio: 3, kind: belt}}",
        "negative mass": "motors: {a: {" + motor + ", mass: -1 kg}}\ngears: {g: {ratio: 3}}", "zero rating": "motors: {a: {" + motor + "}}\ngears: {g: {ratio: 3, rated_torque: 0 N m}}", "negative price": "motors: {a: {" + motor + "}}\ngears: {g: {ratio: 3, price: -2}}",
        "rotor": "motors: {a: {" + motor + ", rotor: {inertia: 0 kg m^2}}}\ngears: {g: {ratio: 3}}", "no inertia": "motors: {a: {" + motor + ", rotor: {}}}\ngears: {g: {ratio: 3}}", "half a servo": "motors: {a: {stall_torque: 3 N m, voltage: 12 V}}", "zero servo": "motors: {a: {stall_torque: 3 N m, voltage: 12 V, no_load_speed: 0 rpm}}",
        "pairs": "motors: {a: {" + motor + "}}\npairs: a", "pair": "motors: {a: {" + motor + "}}\npairs: [[a]]", "unknown pair": "motors: {a: {" + motor + "}}\npairs: [[b, none]]", "unknown gear": "motors: {a: {" + motor + "}}\npairs: [[a, g]]", "no motor": "motors: {a: {" + motor + "}}\nactuators: {waist: {gear: none}}",
        "efficiency": "motors: {a: {" + motor + "}}\ngears: {g: {ratio: 3, efficiency: 1.2}}", "zero ratio": "motors: {a: {" + motor + "}}\ngears: {g: {ratio: 0}}",
    }  # fmt: skip
    table["refused"] = {name: refusal(lambda text=text: read_catalog(text)) for name, text in wrong.items()}
    table["settings"] = {
        name: refusal(lambda options=options: sized(**options))
        for name, options in {
            "pause": {"pause": -1.0},
            "ambient": {"ambient": -300.0},
            "too warm": {"ambient": 1000.0},
            "nan": {"ambient": math.nan},
            "life": {"life": 0.0},
            "motion": {"motion": 3.0},
            "joint": {"catalog": CATALOG + "actuators: {push: {motor: tiny, gear: g50}}"},
        }.items()
    }
    table["actuators"] = refusal(
        lambda: tw.size_drives(arm().with_actuators("actuators: {waist: {ratio: 5}}"), swing(), CATALOG)
    )
    return table


def _paused(motions, pause):
    states, time, holding = choice._with_pause(motions, pause)
    return [states, time, holding.start, holding.stop]


@records.of(relative=1e-6)
def robots_to_size():
    crane = quietly(tw.load)(CRANE)
    legged = quietly(tw.load)(TRIPOD, tip="mast")
    catalog = read_catalog(CATALOG)
    n = 8
    t = 0.1 * np.arange(n)
    q = 0.3 * np.sin(np.outer(t, np.arange(1, 7)))
    still = tw.Motion(
        t,
        q,
        0.3 * np.cos(np.outer(t, np.arange(1, 7))) * np.arange(1, 7),
        -0.3 * np.sin(np.outer(t, np.arange(1, 7))) * np.arange(1, 7) ** 2,
        robot=legged,
        in_seconds=True,
    )
    weak = CATALOG + "actuators: {hip0: {motor: tiny, gear: p20}}"
    hanging = quietly(tw.size_drives)(legged, still, weak)
    return {
        "joints": [choice.drive_joints(crane, catalog), choice.drive_joints(arm(), read_catalog(WITH_DRIVES)), refusal(lambda: choice.drive_joints(crane, read_catalog(CATALOG + "actuators: {boom: {motor: tiny, gear: g50}}")))],
        "armature": [choice._joints_with_armature(arm(), ("waist", "elbow")), choice.bare_robot(arm(), ("elbow",)).armature, choice.bare_robot(arm(), ("waist",)).armature, sized(catalog=WITH_DRIVES).problem.armed],
        "pause": _paused([swing(rows=4)], 0.3), "no pause": _paused([swing(rows=3)], 0.0), "hanging": [hanging.verdict, hanging.problem.doubts],
    }  # fmt: skip


@records.of(relative=1e-6)
def noise_that_decides_between_drives():
    """Draws of a motion that differ so much that ratings are open, and a base that nothing holds."""
    base = sized()
    elbow = base.joints["elbow"]
    limit = {demand.what: demand for demand in elbow.gear.demands}["peak torque"].value
    table = {}
    for factor in (0.9, 1.02, 1.3):
        catalog = CATALOG.replace("repeated_peak: 30 N m", f"repeated_peak: {factor * limit:.9g} N m")
        given = catalog + "actuators:\n  waist: {motor: large, gear: g100}\n  elbow: {motor: small, gear: g50}\n"
        draws = [swing(f) for f in (0.9, 1.06, 1.12)]
        found = sized(catalog=given, draws=draws, ambient=25.0)
        chosen = sized(catalog=catalog, draws=draws, ambient=25.0)
        table[str(factor)] = [
            found.verdict, {name: [one.open, one.fits, one.sure] for name, one in found.joints.items()}, chosen.verdict, chosen.choice, chosen.brief, shown(chosen.blocks())[:4],
        ]  # fmt: skip
    weak = WITH_DRIVES.replace("repeated_peak: 90 N m", "repeated_peak: 9 N m").replace("gear: g50", "gear: g100")
    over = sized(catalog=weak)
    table["worst moment"] = [worst_moment(over), over.verdict]
    none = sized(catalog=weak.replace("voltage: 36 V", "voltage: 1 V").replace("voltage: 48 V", "voltage: 1 V"))
    table["no pair does it"] = smallest_drives(none, none.choose())
    legged = quietly(tw.load)(TRIPOD, tip="mast")
    t = 0.1 * np.arange(8)
    k = np.arange(1, 7)
    wave = np.outer(t, k)
    moved = tw.Motion(
        t, 0.3 * np.sin(wave), 0.3 * k * np.cos(wave), -0.3 * k**2 * np.sin(wave), robot=legged, in_seconds=True
    )
    hanging = quietly(tw.size_drives)(
        legged,
        moved,
        CATALOG.replace("voltage: 36 V", "voltage: 1 V") + "actuators: {hip0: {motor: tiny, gear: p20}}",
    )
    table["hanging"] = hanging.verdict
    table["read twice"] = read_catalog(read_catalog(CATALOG)).pairs
    round_limits = quietly(tw.load)(ARM.replace('effort="90"', 'effort="1000"'))
    names = [*(f"{name}{part}" for part in ("", ".vel", ".acc") for name in ("waist", "elbow", "push"))]
    return table | {"names": names, "placeholders": round_limits.limits.effort}


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
