"""Statics of arms: complete answers on record. Contacts, feet and clearance are in files of their own."""

from __future__ import annotations

import tempfile
import warnings
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench import statics
from twistwrench.core.typing import Array
from twistwrench.mechanics.model.limits import Limits
from twistwrench.statics import arguments, equilibrium, force_capability, torque_limits, torque_wrench
from twistwrench.statics.payload_report import payload

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

# ── Robots


def link(name, mass, com, moments, frame="0 0 0", shape=""):
    ixx, iyy, izz, ixy, ixz, iyz = moments
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}" rpy="{frame}"/><mass value="{mass}"/><inertia ixx="{ixx}" '
        f'iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial>{shape}</link>'
    )


def joint(name, kind, parent, child, at, axis="0 0 1", limit="", more=""):
    lower, upper, effort = (limit or "-1 1 0").split()
    bounds = f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="3"/>' if limit else ""
    xyz, _, rpy = at.partition("|")
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy or "0 0 0"}"/><axis xyz="{axis}"/>{bounds}{more}</joint>'
    )


ARM = (
    '<robot name="stacker">'
    + link("rail", 4.1, "0.11 -0.03 0.05", (0.05, 0.06, 0.07, 0.004, -0.003, 0.002))
    + link("plate", 2.3, "-0.02 0.07 0.04", (0.03, 0.02, 0.04, 0.002, 0.001, -0.003), "0.2 -0.1 0.3")
    + link("mast", 1.7, "0.03 0.02 0.4", (0.088, 0.081, 0.013, 0.001, -0.004, 0.002))
    + link("flag", 0.6, "0.21 0.03 -0.02", (0.004, 0.02, 0.021, 0.0005, -0.0007, 0.0003))
    + link("turret", 3.7, "0.03 -0.02 0.11", (0.04, 0.05, 0.03, 0.003, -0.002, 0.001))
    + link("lift", 2.9, "0.12 0.05 -0.03", (0.02, 0.03, 0.035, -0.001, 0.002, 0.0015))
    + link("upper", 1.9, "0.17 -0.04 0.02", (0.006, 0.03, 0.032, 0.001, -0.0012, 0.0007))
    + link("fore", 1.3, "0.14 0.03 0.05", (0.004, 0.016, 0.017, -0.0006, 0.0008, 0.0004))
    + link("wrist", 0.8, "0.02 -0.03 0.06", (0.002, 0.0025, 0.0016, 0.0002, -0.0001, 0.0003))
    + link("finger", 0.4, "0.05 0.02 0.07", (0.0007, 0.0009, 0.0005, 0.0001, 0.00005, -0.0001))
    + '<link name="tool"/>'
    + joint("to_plate", "fixed", "rail", "plate", "0.13 0.21 0.08|0.1 -0.2 0.4")
    + joint("to_mast", "fixed", "rail", "mast", "-0.34 0.15 0.09|0 0.3 -0.2")
    + joint("wave", "revolute", "mast", "flag", "0.02 -0.05 0.7|0.3 0 0.1", "0.6 0 0.8", "-0.9 1.4 2.5")
    + joint("turn", "revolute", "plate", "turret", "0.04 -0.06 0.12|0.15 0.1 0", "0.1 0.2 0.97", "-2.6 2.1 60")
    + joint("raise", "prismatic", "turret", "lift", "0.05 0.09 0.3|0 0.2 0.1", "0.2 -0.1 0.97", "-0.2 0.45 130")
    + joint("shoulder", "revolute", "lift", "upper", "0.24 -0.05 0.07|0.1 0 -0.3", "0.1 0.99 0.05", "-1.9 2.3 45")
    + joint("elbow", "revolute", "upper", "fore", "0.37 0.04 -0.03|0 0.2 0.1", "0 0.95 -0.3", "-2.2 1.6 24")
    + joint("bend", "continuous", "fore", "wrist", "0.29 -0.02 0.06|0.5 0 0.2", "0.3 0.9 0.2", "-1 1 11")
    + joint(
        "pinch", "revolute", "wrist", "finger", "0.03 0.08 0.1|0 0.4 0", "0.9 0.1 0.4", "-3 3 1.9",
        '<mimic joint="elbow" multiplier="-0.7" offset="0.13"/>',
    )
    + joint("to_tool", "fixed", "wrist", "tool", "0.05 -0.02 0.17|0.4 -0.3 0.6")
    + "</robot>"
)  # fmt: skip
TILTED = (1.9, -2.7, -9.2)
"""Gravity that is along no axis [m/s²]."""
Q = np.array([-0.4, 0.17, 0.35, -0.62, 0.81, 0.3])
POSES = np.array([Q, [0.7, -0.11, 0.9, 0.44, -1.3, -0.5], [-1.6, 0.31, -0.75, 1.2, 2.4, 0.9]])
DQ = np.array([[0.4, -0.7, 0.3, 0.9, -1.1, 0.6], [-0.2, 0.5, -0.6, 0.8, 1.3, -0.9], [1.1, 0.3, 0.2, -0.7, 0.4, 1.7]])
DDQ = np.array([[1.3, 2.1, -0.8, -1.7, 2.9, 0.7], [0.6, -1.9, 1.1, 2.3, -0.4, 3.1], [-2.2, 0.9, 1.6, 0.5, -1.4, -2.7]])


def quiet(text, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tw.load(text, **options)


@cache
def _files():
    return tempfile.TemporaryDirectory()


def from_file(text, **options):
    """Robot of a file, since only files have shapes."""
    path = Path(_files().name) / f"{zlib.crc32(text.encode())}.urdf"
    path.write_text(text)
    return quiet(path, **options)


@cache
def arm():
    return quiet(ARM, tip="tool", gravity=TILTED)


@cache
def coupled():
    """The arm whose shoulder and elbow two motors drive together; their shares of motion differ."""
    coupling = {
        "motors": ["left", "right"],
        "joints": ["shoulder", "elbow"],
        "motor_per_joint": [[1.2, 0.7], [-0.5, 0.9]],
    }
    return arm().with_actuators(
        {
            "couplings": {"differential": coupling},
            "actuators": {"left": {"effort": "31 N m"}, "right": {"effort": "19 N m"}},
        }
    )


@cache
def elastic():
    """The arm with an elastic shoulder and an elastic elbow."""
    rotor = {"inertia": "900 g cm^2", "extra": True}
    entries = {
        "shoulder": {"ratio": 80, "stiffness": "9 kN m/rad", "rotor": rotor},
        "elbow": {"ratio": -50, "stiffness": "4 kN m/rad", "rotor": rotor},
    }
    return arm().with_actuators({"actuators": entries})


@cache
def geared():
    """The arm with rotors of their own: one on the joint's carrier, one on a link named."""
    rotors = {
        "turn": {"ratio": 60, "rotor": {"mass": "0.9 kg", "inertia": "1500 g cm^2", "extra": True}},
        "shoulder": {
            "ratio": -90,
            "rotor": {
                "mass": "0.7 kg",
                "inertia": "800 g cm^2",
                "extra": True,
                "link": "turret",
                "axis": [0.3, -0.2, 0.9],
            },
        },
    }
    return arm().with_actuators({"actuators": rotors})


@cache
def clawed():
    """The arm with a second follower, which slides."""
    claw = link("claw", 0.3, "0.02 0.03 0.05", (0.0004, 0.0005, 0.0003, 0.00004, 0.00005, -0.00003)) + joint(
        "grip", "prismatic", "wrist", "claw", "0.04 -0.03 0.1|0.2 0.1 0", "0.3 0.2 0.9", "-3 3 29",
        '<mimic joint="bend" multiplier="0.02" offset="0.01"/>',
    )  # fmt: skip
    return quiet(ARM.replace("</robot>", claw + "</robot>"), tip="tool", gravity=TILTED)


FLYER = (
    '<robot name="flyer">'
    + link("hull", 5.2, "0.03 -0.02 0.04", (0.08, 0.09, 0.1, 0.004, -0.003, 0.002))
    + link("boom", 0.9, "0.15 0.03 -0.02", (0.003, 0.01, 0.011, 0.0004, -0.0003, 0.0002))
    + joint("swing", "revolute", "hull", "boom", "0.2 0.05 -0.07|0.1 0.2 0", "0.2 0.95 0.1", "-1.2 1.7 8")
    + "</robot>"
)


@cache
def flyer():
    return quiet(FLYER, floating_base=True, tip="boom", gravity=TILTED)


def fields(result):
    """All fields, properties and the text of a result."""
    kind = type(result)
    properties = [name for name in dir(kind) if isinstance(getattr(kind, name), property)]
    found = {
        name: getattr(result, name) for name in result.__dataclass_fields__ if name not in ("joint_names", "units")
    }
    return found | {name: getattr(result, name) for name in properties} | {"text": str(result).splitlines()}


# ── Limits and ranges


@records.of
def torque_limits_of_rigid_elastic_coupled_and_floating_robots():
    own = np.array([50.0, 90.0, 33.0, 21.0, 9.0, 2.1])
    many = quiet(ARM.replace("effort=", "old="), tip="tool")
    return {
        "own": torque_limits.effort_limits(arm()),
        "given": torque_limits.effort_limits(arm(), own),
        "zero": torque_limits.effort_limits(arm(), 0.0 * own),
        "coupled": torque_limits.effort_limits(coupled()),
        "elastic": torque_limits.effort_limits(elastic()),
        "elastic, motors given": torque_limits.effort_limits(elastic(), [50, 90, 33, 21, 9, 2, 12.0, 28.0]),
        "elastic names": elastic().model.drive_names,
        "floating": torque_limits.effort_limits(flyer(), [1.0, 2, 3, 4, 5, 6, 7]),
        "floating entries": torque_limits.floating_entries(flyer()),
        "driven entries": torque_limits.floating_entries(arm()),
        "too few": refusal(lambda: torque_limits.effort_limits(arm(), [1.0, 2.0])),
        "too few of many": refusal(lambda: torque_limits.effort_limits(tw.robots.quadruped(), [1.0, 2.0])),
        "negative": refusal(lambda: torque_limits.effort_limits(arm(), [1, 2, -3, 4, -5, 6.0])),
        "not a number": refusal(lambda: torque_limits.effort_limits(arm(), [1, 2, 3, 4, np.nan, 6])),
        "none in the file": refusal(lambda: torque_limits.effort_limits(many)),
        "infinite ones given": torque_limits.effort_limits(many, [np.inf] * 6),
        "no robot": refusal(lambda: torque_limits.effort_limits("arm")),
    }


@records.of
def torques_at_rest_against_gravity_springs_and_wrenches():
    q = np.concatenate([Q, [0.41, -0.57]])
    push = {"tool": [0.4, -0.7, 0.9, 5.0, -8.0, 3.0], "finger": [0.1, 0.2, -0.3, 2.0, 1.0, -4.0]}
    return {
        "arm": torque_limits.resting_torques(arm(), POSES),
        "pushed": torque_limits.resting_torques(arm(), Q, push),
        "elastic": torque_limits.resting_torques(elastic(), q),
        "elastic, other motors": torque_limits.resting_torques(elastic(), np.stack([q, q + 0.1 * np.arange(8)])),
        "elastic, pushed": torque_limits.resting_torques(elastic(), q, push),
        "coupled": torque_limits.resting_torques(coupled(), Q),
    }


@records.of
def ranges_of_growth_within_limits():
    limits = np.array([4.0, 2.0, 8.0, np.inf])
    steps = {
        "up": [1.0, 0.25, -0.5, 3.0],
        "down": [-1.0, -0.25, 0.5, -3.0],
        "one alone": [0.0, 0.0, -0.5, 0.0],
        "the unlimited alone": [0.0, 0.0, 0.0, 2.0],
        "rounding beside": [1e-12, 2e-12, 2.0, 1e-13],
        "above rounding": [3e-12, 2.5e-12, 2.0, 0.0],
        "small alone": [2e-12, 1e-12, 0.5e-12, 0.0],
        "none": [0.0, 0.0, 0.0, 0.0],
    }
    starts = {
        "inside": [1.0, -0.5, 3.0, 7.0],
        "at a limit": [4.0, -2.0, -8.0, 0.0],
        "beyond": [1.0, 2.5, 3.0, 0.0],
        "within rounding": [4.0 + 1e-10, -0.5, 1.0, 0.0],
        "beyond rounding": [4.0 + 1e-7, -0.5, 1.0, 0.0],
    }
    return {
        start: {step: torque_limits.growth(np.array(a), np.array(b), limits) for step, b in steps.items()}
        for start, a in starts.items()
    } | {
        "many": torque_limits.growth(np.array([[1.0, -0.5, 3, 7], [-2.0, 1.5, 0.5, 1]]), np.array(steps["up"]), limits)
    }


@records.of
def texts_of_ranges():
    nan = np.nan
    return [
        torque_limits.span(np.array(x))
        for x in ([3.0, 1.25, 7.5], [nan, 2.0, nan], [nan, nan, nan], [[4.0, nan], [2, 9]])
    ]


@records.of
def bases_that_torques_cannot_hold():
    locked = arm().lock(dict.fromkeys(arm().joint_names, 0.1))
    return [
        refusal(lambda: torque_limits.require_fixed_base(locked, "the sum")),
        refusal(lambda: torque_limits.require_fixed_base(flyer(), "the sum")),
        torque_limits.require_fixed_base(arm(), "the sum"),
    ]


@records.of
def arguments_of_statics():
    vectors = {"three": [0.0, 3, 4], "six": [1.0, 2, 2, 4, 0, 0], "many": [[0, 3.0, 4], [5, 0, 12], [-8, 15, 0]]}
    bad = {
        "two": [1.0, 2.0], "zero": [0, 0, 0.0], "infinite": [0, np.inf, 1], "nan": [1, np.nan, 1], "ragged": [[1, 2], [3]],
        "number": 3.0, "one zero of two": [[1, 2, 3], [0, 0, 0.0]],
    }  # fmt: skip
    return {
        "unit": {name: arguments.unit_vectors(x, 3, 6) for name, x in vectors.items()},
        "not unit": {name: refusal(lambda x=x: arguments.unit_vectors(x, 3, 6)) for name, x in bad.items()},
        "four only": refusal(lambda: arguments.unit_vectors([1.0, 2, 3], 4)),
        "one q": arguments.one_configuration(arm(), list(Q), "act", "why"),
        "many q": refusal(lambda: arguments.one_configuration(arm(), POSES, "act", "why")),
        "short q": refusal(lambda: arguments.one_configuration(arm(), Q[:4], "act", "why")),
        "nan q": refusal(lambda: arguments.one_configuration(arm(), [1, 2, np.nan, 4, np.inf, 6], "act", "why")),
        "infinite q": refusal(lambda: arguments.one_configuration(arm(), [1, 2, 3, 4, np.inf, np.nan], "act", "why")),
        "batches fit": arguments.same_batch(q=np.zeros((4, 1, 6)), com=np.zeros((3, 3))),
        "batches do not": refusal(lambda: arguments.same_batch(q=np.zeros((4, 6)), com=np.zeros((3, 3)))),
    }


@records.of
def values_of_a_suspect_unit():
    """Revolute joints one turn beyond ±1 turn or their limits, sliding ones 1 m beyond, places beyond 1 m: both sides."""
    tau = 2 * np.pi
    limits, wide = arm().limits, arm().limits
    wide = Limits(
        **{
            **{f: getattr(limits, f) for f in limits.__dataclass_fields__},
            "lower": limits.lower - 9.0,
            "upper": limits.upper + 9.0,
        }
    )
    rows = {
        "fine": Q,
        "just within above": [2.1 + tau - 0.01, 1.44, 2.3 + tau - 0.01, 1.6 + tau - 0.01, 2 * tau - 0.01, 1.4 + tau - 0.01],
        "just beyond above": [2.1 + tau + 0.01, 1.46, 2.3 + tau + 0.01, 1.6 + tau + 0.01, 2 * tau + 0.01, 1.4 + tau + 0.01],
        "just within below": [-2.6 - tau + 0.01, -1.19, -1.9 - tau + 0.01, -2.2 - tau + 0.01, -2 * tau + 0.01, -0.9 - tau + 0.01],
        "just beyond below": [-2.6 - tau - 0.01, -1.21, -1.9 - tau - 0.01, -2.2 - tau - 0.01, -2 * tau - 0.01, -0.9 - tau - 0.01],
        "degrees": [-45, 170, 90, -60, 120, 30.0],
    }  # fmt: skip
    places = {
        "near": {"com": np.array([0.6, 0.6, 0.5])},
        "far": {"com": np.array([0.6, -0.6, 0.55]), "tool": np.array([12.0, 0, -350])},
    }
    slips = {
        name: [list(arguments.unit_slips(arm(), np.array(q), limits, {}, degrees=d)) for d in (False, True)]
        for name, q in rows.items()
    }
    return slips | {
        "wide limits": {name: list(arguments.unit_slips(arm(), np.array(q), wide, {})) for name, q in rows.items()},
        "places": {name: list(arguments.unit_slips(arm(), Q, limits, at)) for name, at in places.items()},
        "ball": list(arguments.unit_slips(flyer(), flyer().neutral, flyer().limits, {})),
    }


@records.of
def joints_beyond_their_stops():
    rows = {
        "inside": Q,
        "at the stops": [-2.6, 0.45, -1.9, 1.6, 9.0, 1.4],
        "beyond, above": [2.3, 0.52, 2.4, 1.61, -9.0, 1.45],
        "beyond, below": [-2.8, -0.21, -1.93, -2.9, 9.0, -0.95],
    }
    narrow = Limits(
        **{**{f: getattr(arm().limits, f) for f in arm().limits.__dataclass_fields__}, "upper": np.full(6, 0.1)}
    )
    found = {name: equilibrium.joints_beyond_stops(arm(), np.array(q)) for name, q in rows.items()}
    found["given limits"] = equilibrium.joints_beyond_stops(arm(), Q, narrow)
    found["floating"] = equilibrium.joints_beyond_stops(flyer(), np.r_[flyer().neutral[:-1], 1.9])
    return {name: [(stop, stop.by) for stop in stops] for name, stops in found.items()}


# ── Payload


COM = np.array([0.04, -0.07, 0.11])


@records.of
def largest_payloads():
    weak = [60, 130, 6.0, 24, 11, 2.5]
    return {
        "one": statics.largest_payload(arm(), Q, COM),
        "poses": fields(statics.largest_payload(arm(), POSES, COM)),
        "poses and places": fields(statics.largest_payload(arm(), POSES[:, None], np.stack([COM, -2.0 * COM]))),
        "on another frame": statics.largest_payload(arm(), Q, COM, frame="finger"),
        "beside": fields(statics.largest_payload(arm(), Q, COM, frame="flag")),
        "on the rail": fields(statics.largest_payload(arm(), Q, COM, frame="rail")),
        "limits": fields(statics.largest_payload(arm(), POSES[1], COM, limits=[60, 130, 22.0, 24, 11, 2.5])),
        "too weak": fields(statics.largest_payload(arm(), POSES[1], COM, limits=weak)),
        "one joint without torque": fields(statics.largest_payload(arm(), Q, COM, limits=[60, 130, 45, 24, 0.0, 2.5])),
        "coupled": fields(statics.largest_payload(coupled(), Q, COM)),
        "coupled, poses": fields(statics.largest_payload(coupled(), POSES, COM)),
        "elastic": fields(statics.largest_payload(elastic(), np.r_[Q, 0.2, -0.3], COM)),
        "nan": fields(statics.largest_payload(arm(), [np.nan, 0.1, 0.3, 0.2, 0.1, 0.3], COM)),
        "nan among": fields(statics.largest_payload(arm(), [Q, [np.nan] * 6])),
        "without followers": fields(
            statics.largest_payload(quiet(ARM, mimic="independent", tip="tool"), np.r_[Q, 0.4], COM)
        ),
        "weak follower": fields(
            statics.largest_payload(
                quiet(ARM.replace('effort="1.9"', 'effort="0.05"'), tip="tool", gravity=TILTED), Q, COM
            )
        ),
        "on the second follower, which slides": statics.largest_payload(clawed(), Q, COM, frame="claw"),
        "floating": refusal(lambda: statics.largest_payload(flyer(), flyer().neutral)),
        "batches differ": refusal(lambda: statics.largest_payload(arm(), POSES, np.zeros((2, 3)))),
        "place": refusal(lambda: statics.largest_payload(arm(), Q, [1.0, 2.0])),
    }


@records.of
def torques_of_a_kilogram():
    return {
        "tip": statics.torques_per_kilogram(arm(), Q, COM),
        "origin": statics.torques_per_kilogram(arm(), Q),
        "frame": statics.torques_per_kilogram(arm(), POSES, COM, "finger"),
        "places": statics.torques_per_kilogram(arm(), POSES[:, None], np.stack([COM, 3 * COM])),
    }


@records.of
def payloads_in_regions():
    corners = np.array([[0.02, 0.05, -0.03], [0.3, -0.2, 0.1], [-0.25, 0.1, 0.22], [0.1, 0.3, 0.05]])
    still = quiet(ARM, tip="tool", gravity=(0, 0, 0))
    return {
        "four corners": statics.payload_in_region(arm(), Q, corners),
        "another pose and frame": statics.payload_in_region(arm(), POSES[1], corners, frame="upper"),
        "limits": statics.payload_in_region(arm(), Q, corners, limits=[60, 130, 35.0, 15, 7, 2.5]),
        "without some limits": statics.payload_in_region(arm(), Q, corners, limits=[np.inf, np.inf, 35.0, 15, np.inf, 2.5]),
        "one corner": statics.payload_in_region(arm(), Q, corners[1]),
        "too weak": statics.payload_in_region(arm(), POSES[1], corners, limits=[60, 130, 6.0, 24, 11, 2.5]),
        "without weight": statics.payload_in_region(still, Q, corners),
        "beside": statics.payload_in_region(arm(), Q, corners, frame="rail"),
        "no corners": refusal(lambda: statics.payload_in_region(arm(), Q, np.zeros((0, 3)))),
        "three axes": refusal(lambda: statics.payload_in_region(arm(), Q, np.zeros((2, 2, 3)))),
        "many poses": refusal(lambda: statics.payload_in_region(arm(), POSES, corners)),
    }  # fmt: skip


@records.of
def maps_of_the_payload():
    maps = {
        plane: statics.payload_map(arm(), plane, at=0.13, thickness=0.4, samples=700, com=COM, rng=3)
        for plane in ("xz", "yz", "xy", "rz")
    }
    maps["few cells"] = statics.payload_map(
        arm(), "xz", at=0.25, thickness=0.3, cells=3, samples=500, frame="upper", rng=5
    )
    maps["limits"] = statics.payload_map(arm(), samples=300, cells=4, limits=[60, 130, 22.0, 14, 7, 1.9])
    maps["many samples"] = statics.payload_map(tw.robots.planar_2r(), cells=3, samples=33_000, limits=[50.0, 20.0])
    maps["one place"] = statics.payload_map(arm(), cells=3, samples=40, frame="rail")
    return {name: fields(found) for name, found in maps.items()} | {
        "far": refusal(lambda: statics.payload_map(arm(), "xy", at=9.5, samples=30)),
        "nowhere": refusal(lambda: statics.payload_map(arm(), "xy", at=np.nan)),
        "plane": refusal(lambda: statics.payload_map(arm(), "zx")),
        "samples": refusal(lambda: statics.payload_map(arm(), samples=0)),
        "cells": refusal(lambda: statics.payload_map(arm(), cells=0)),
        "thickness": refusal(lambda: statics.payload_map(arm(), thickness=0.0)),
    }


def reports():
    """Calls of the function ``payload`` by name."""
    tool = {"tool": "1.3,0.02,-0.03,0.05"}
    return {
        "pose": lambda **k: payload(arm(), Q, com=COM, **k),
        "default pose": lambda **k: payload(arm(), **k),
        "places of joints": lambda **k: payload(arm(), {"shoulder": 0.7, "raise": 0.21, "elbow": -0.8}, **k),
        "frame": lambda **k: payload(arm(), Q, frame="finger", com=[0.01, 0.02, 0.03], **k),
        "tools": lambda **k: payload(arm(), Q, tool=[tool, {"fore": "0.6,0.1,0.02,0.03"}], **k),
        "beyond stops": lambda **k: payload(arm(), [2.5, 0.6, 0.35, -2.6, 0.8, 1.55], **k),
        "too weak": lambda **k: payload(arm(), POSES[1], limits={"shoulder": 6.0}, **k),
        "too weak with tools": lambda **k: payload(arm(), POSES[1], tool=tool, limits={"shoulder": 9.0}, **k),
        "beside": lambda **k: payload(arm(), Q, frame="rail", **k),
        "far place": lambda **k: payload(arm(), Q, com=[0.1, 120.0, 0.3], **k),
        "no limits": lambda **k: payload(quiet(ARM.replace("effort=", "old="), tip="tool"), Q, **k),
        "coupled": lambda **k: payload(coupled(), POSES[2], **k),
    }  # fmt: skip


@records.of
def reports_of_the_payload():
    whole = ("frame", "too weak with tools", "no limits")
    found = {name: call() for name, call in reports().items()}
    return {name: report if name in whole else str(report).splitlines() for name, report in found.items()}


@records.of
def reports_of_the_payload_in_degrees():
    q = np.array([-45, 0.17, 20, 130, 46, 30.0])
    found = payload(arm(), q, com=COM, degrees=True)
    return {"degrees": found, "stops": payload(arm(), {"elbow": 131, "raise": 0.6}, degrees=True).verdict.reasons}


@records.of
def report_of_the_payload_with_a_map():
    found = payload(arm(), Q, map="xz", samples=400)
    return {"text": str(found).splitlines(), "map": fields(found.map), "facts": found.facts(), "brief": found.brief}


@records.of
def tables_and_words_of_payload_reports(folder):
    found = {
        name: call()
        for name, call in reports().items()
        if name in ("tools", "no limits", "too weak", "coupled", "beside")
    }
    found["degrees"] = payload(arm(), np.array([-45, 0.17, 20, -80, 46, 30.0]), degrees=True)
    return {
        name: {
            "table": report.to_csv(folder / f"{name}.csv").read_text("utf-8").splitlines(),
            "facts": report.facts(),
            "subject": report.subject,
            "brief": report.brief,
            "limiting": report.limiting,
            "assumed": report.assumed,
            "doubts": report.doubts,
            "loads": report.loads,
        }
        for name, report in found.items()
    }


@records.of
def refusals_of_the_payload():
    return [
        refusal(lambda: payload(arm(), Q, samples=300)),
        refusal(lambda: payload(arm(), Q, map="zz")),
        refusal(lambda: payload(arm(), Q, com=[1.0, 2.0])),
        refusal(lambda: payload(arm(), Q, frame="hand")),
        refusal(lambda: payload(flyer())),
        refusal(lambda: payload(arm(), {"shoulders": 0.3})),
        refusal(lambda: payload(quiet(ARM), Q)),
    ]


# ── Forces


LIMITS = [58.0, 120.0, 41.0, 23.0, 10.0, 2.6]


@records.of
def ellipsoids_of_wrenches():
    kinds = ("world_aligned", "body", "space")
    found = {
        f"{part}, {kind}": statics.wrench_ellipsoid(arm(), Q, part=part, kind=kind)
        for part in ("force", "moment", "wrench")
        for kind in kinds
    }
    found["limits"] = statics.wrench_ellipsoid(arm(), Q, limits=LIMITS)
    found["coupled"] = statics.wrench_ellipsoid(coupled(), Q, limits=[58, 120, 31, 19, 10.0, 2.6])
    found["frame"] = statics.wrench_ellipsoid(arm(), Q, "upper", part="force", limits=LIMITS)
    found["few joints"] = statics.wrench_ellipsoid(arm(), Q, "lift", part="wrench")
    poses = statics.wrench_ellipsoid(arm(), POSES, limits=LIMITS)
    some = statics.wrench_ellipsoid(arm(), [Q, [np.nan] * 6])
    ways = np.array([[0.3, -0.5, 0.8], [1.0, 0, 0], [0, 0.6, -0.8]])
    return {
        "one": {
            name: {
                "matrix": e.matrix, "semi-axes": e.semi_axes, "axes": np.abs(e.axes) if e.axes.shape[-1] == 3 else None,
                "condition": e.condition, "text": repr(e), "part": e.part, "kind": e.kind,
            }
            for name, e in found.items()
        },
        "reach": found["limits"].reach(ways),
        "reach of poses": poses.reach(ways),
        "reach of few joints": found["few joints"].reach([0, 0, 0, 0.5, 0.4, -0.3]),
        "reach without torque": statics.wrench_ellipsoid(arm(), Q, "turret", part="moment").reach(ways),
        "poses": {"semi-axes": poses.semi_axes, "text": repr(poses), "condition": poses.condition},
        "nan": {"semi-axes": some.semi_axes, "not a number": np.isnan(some.axes), "matrix": some.matrix},
        "part": refusal(lambda: statics.wrench_ellipsoid(arm(), Q, part="torque")),
        "list": refusal(lambda: statics.wrench_ellipsoid(arm(), Q, part=["force"])),
        "zero": refusal(lambda: statics.wrench_ellipsoid(arm(), Q, limits=[*LIMITS[:5], 0.0])),
        "weights": force_capability.effort_weights(arm(), [4.0, np.inf, 8.0, 16.0, 5.0, 2.0]),
    }  # fmt: skip


@records.of
def largest_wrenches():
    ways = np.array([[0.3, -0.5, 0.8], [-1.0, 0.2, 0], [0, 0.6, -0.8]])
    six = [0.2, -0.4, 0.1, 0.5, 0.7, -0.3]
    found = {
        "force": statics.largest_wrench(arm(), Q, ways[0]),
        "wrench": statics.largest_wrench(arm(), Q, six),
        "body": statics.largest_wrench(arm(), Q, six, kind="body"),
        "space": statics.largest_wrench(arm(), Q, six, kind="space"),
        "frame": statics.largest_wrench(arm(), Q, six, frame="upper"),
        "limits": statics.largest_wrench(arm(), Q, six, limits=LIMITS),
        "coupled": statics.largest_wrench(coupled(), Q, six),
        "elastic": statics.largest_wrench(elastic(), np.r_[Q, 0.2, -0.3], six),
        "poses and ways": statics.largest_wrench(arm(), POSES[:, None], ways),
        "rail": statics.largest_wrench(arm(), Q, six, frame="rail"),
        "too weak": statics.largest_wrench(arm(), POSES[1], six, limits=[60, 130, 6.0, 24, 11, 2.5]),
        "nan": statics.largest_wrench(arm(), [np.nan, 0.1, 0.3, 0.2, 0.1, 0.3], six),
        "some nan": statics.largest_wrench(arm(), [Q, [np.nan] * 6], six),
    }
    return {name: fields(wrench) for name, wrench in found.items()} | {
        "batches differ": refusal(lambda: statics.largest_wrench(arm(), POSES, ways[:2])),
        "floating": refusal(lambda: statics.largest_wrench(flyer(), flyer().neutral, ways[0])),
        "way": refusal(lambda: statics.largest_wrench(arm(), Q, [1.0, 2.0])),
    }


@records.of
def weakest_directions():
    found = {
        f"{part}, {kind}": statics.weakest_direction(arm(), Q, part=part, kind=kind)
        for part in ("force", "moment", "wrench")
        for kind in ("world_aligned", "body", "space")
    }
    found["frame"] = statics.weakest_direction(arm(), Q, frame="upper")
    found["limits"] = statics.weakest_direction(arm(), POSES, limits=LIMITS)
    found["strong at the wrist"] = statics.weakest_direction(arm(), POSES, limits=[30.0, 70.0, 35.0, 99.0, 99.0, 99.0])
    found["coupled"] = statics.weakest_direction(coupled(), POSES)
    found["too weak"] = statics.weakest_direction(arm(), POSES[1], limits=[60, 130, 6.0, 24, 11, 2.5])
    found["some nan"] = statics.weakest_direction(arm(), [[np.nan] * 6, Q])
    return {name: fields(wrench) for name, wrench in found.items()} | {
        "rail": refusal(lambda: statics.weakest_direction(arm(), Q, frame="rail")),
        "floating": refusal(lambda: statics.weakest_direction(flyer(), flyer().neutral)),
    }


def in_order(rows):
    """Rows in an order that rounding does not change."""
    rounded = np.round(rows, 6) + 0.0
    return rows[np.lexsort(rounded.T[::-1])]


def polytope(*arguments_, **options):
    found = statics.wrench_polytope(*arguments_, **options)
    n = found.normals.shape[1]
    ways = np.array(
        [[0.3, -0.5, 0.8, 0.2, 0.7, -0.4][:n], [-1.0, 0.2, 0, 0.6, 0, 0.1][:n], [0, 0, 1, 0, 0, -1][:n]], float
    )
    small = np.array([1.0, -2.0, 0.5, 3.0, -1.5, 2.0][:n])
    return {
        "normals": in_order(np.column_stack([found.normals, found.offsets])),
        "corners": in_order(found.vertices),
        "borne": np.abs(found.borne),
        "sides": found.sides,
        "facets": found.facets,
        "labels": [found.part, found.rest, found.frame, found.kind],
        "support": found.support(ways),
        "contains": found.contains(np.stack([small, 10 * small, 40 * small, 160 * small, -30 * small])),
        "text": str(found),
    }


@records.of(relative=1e-5)
def polytopes_of_wrenches():
    found = {
        f"{part}, {rest}": polytope(
            arm(), Q, part=part, rest=rest, kind="body" if part == "moment" else "world_aligned"
        )
        for part in ("force", "moment")
        for rest in ("zero", "any")
    }
    found["upper"] = polytope(arm(), POSES[1], "upper", limits=LIMITS)
    found["upper, any"] = polytope(arm(), POSES[1], "upper", rest="any", limits=LIMITS)
    found["lift, any"] = polytope(arm(), POSES[1], "lift", rest="any", limits=LIMITS)
    found["turret, any"] = polytope(arm(), POSES[1], "turret", rest="any", limits=LIMITS)
    found["turret moment"] = polytope(arm(), POSES[1], "turret", part="moment", limits=LIMITS)
    found["some without limit"] = polytope(arm(), Q, limits=[58.0, np.inf, 41.0, 23.0, np.inf, 2.6])
    found["coupled"] = polytope(coupled(), Q, part="force")
    found["rail"] = polytope(arm(), Q, "rail")
    edge = statics.wrench_polytope(tw.robots.planar_2r(), [0.0, np.pi / 2], limits=[50.0, 20.0])
    return found | {
        "slack": [edge.contains([0, 0, x], slack=s) for s in (1e-9, 2.0) for x in (50.0, 50.38, 50.39, 52.0, 52.5)],
        "too weak": refusal(lambda: statics.wrench_polytope(arm(), Q, limits=[1.0, 2.0, 3.0, 1.5, 0.2, 2.6])),
        "flag too weak": refusal(lambda: statics.wrench_polytope(arm(), Q, limits=[60, 130, 45, 24, 11, 0.1])),
        "flag too weak below": refusal(lambda: statics.wrench_polytope(arm(), [*Q[:5], -0.9], limits=[60, 130, 45, 24, 11, 0.1])),
        "rest": refusal(lambda: statics.wrench_polytope(arm(), Q, rest="some")),
        "part": refusal(lambda: statics.wrench_polytope(arm(), Q, part="some")),
        "zero": refusal(lambda: statics.wrench_polytope(arm(), Q, limits=[58.0, 0.0, *LIMITS[2:]])),
        "floating": refusal(lambda: statics.wrench_polytope(flyer(), flyer().neutral)),
    }  # fmt: skip


def unsigned_bases(found: statics.TorqueWrench) -> dict[str, object]:
    """Fields; of the orthonormal basis, whose signs are free, the projector."""
    entries = fields(found)
    entries["producible"] = found.producible @ found.producible.T
    return entries


@records.of
def wrenches_of_torques():
    tau = np.array([-7.0, 44.0, 13.0, -5.0, 2.3, 0.9])
    plane = tw.robots.planar_3r().with_gravity((0.5, -1.5, 0))
    g = arm().holding_torques(Q)
    cases = {
        "tip": statics.wrench_from_torques(arm(), Q, tau),
        "world": statics.wrench_from_torques(arm(), Q, tau, kind="world_aligned"),
        "space": statics.wrench_from_torques(arm(), Q, tau, kind="space"),
        "length": statics.wrench_from_torques(arm(), Q, tau, length=0.2),
        "upper": statics.wrench_from_torques(arm(), Q, tau, "upper"),
        "upper, length": statics.wrench_from_torques(arm(), Q, tau, "upper", length=0.2),
        "only the weight": statics.wrench_from_torques(arm(), Q, g),
        "rail": statics.wrench_from_torques(arm(), Q, tau, "rail"),
        "plane": statics.wrench_from_torques(plane, [0.3, 0.5, -0.4], [2.0, 1.0, 0.4]),
        "plane, stretched": statics.wrench_from_torques(plane, [0.3, 0.0, 0.0], [2.0, 1.0, 0.4]),
        "balanced": statics.wrench_from_torques(
            plane, [0.3, 0.5, -0.4], np.asarray(plane.wrench_torques([0.3, 0.5, -0.4], [0.1, 0.2, 0.3, 4, -5, 6.0]))
        ),
        "elastic": statics.wrench_from_torques(elastic(), np.r_[Q, 0.2, -0.3], np.r_[tau, 3.0, -4.0]),
    }
    return {name: unsigned_bases(found) for name, found in cases.items()} | {
        "many": refusal(lambda: statics.wrench_from_torques(arm(), POSES, tau)),
        "short": refusal(lambda: statics.wrench_from_torques(arm(), Q, tau[:3])),
        "nan": refusal(lambda: statics.wrench_from_torques(arm(), Q, np.nan * tau)),
        "no length": refusal(lambda: statics.wrench_from_torques(arm(), Q, tau, length=0.0)),
    }


@records.of
def combinations_in_words():
    names = ("a", "b", "c", "d")
    rows: list[tuple[list[float], dict[str, Array | float | str]]] = [
        ([1.0, -1.0, 0.5, 0.0], {}),
        ([-1.0, 1 + 2e-9, 1 + 0.5e-9, 2.25], {}),
        ([4.0, 3.9e-9, 4.1e-9, -4.0], {}),
        ([0.3, -0.2, 0.2, 0.1], {"least": 0.2}),
        ([0.0, 0.0, 0.0, 0.0], {"nothing": "none"}),
        ([0.0, 0.0, 0.0, 0.0], {}),
    ]
    return [torque_wrench._combination(np.array(x), names, **options) for x, options in rows]


# ── Reactions


@records.of
def loads_of_the_mounting_along_a_motion():
    push = {
        "tool": [0.4, -0.7, 0.9, 5.0, -8.0, 3.0],
        "mast": [0.2, 0.1, -0.6, 4.0, 2.0, -1.0],
        "plate": [1.2, 0.3, 0.5, 2, 6, 3.0],
    }
    cases = {
        f"{frame} of the {name}{' pushed' if wrench else ''}": statics.mounting_load(
            robot, POSES, DQ, DDQ, frame, wrench_on_robot=wrench
        )
        for name, robot in (("arm", arm()), ("geared arm", geared()))
        for frame in (None, "rail", "plate", "mast")
        for wrench in (None, push)
    }
    cases["one row"] = statics.mounting_load(arm(), Q, DQ[0], DDQ[0])
    cases["wrenches of rows"] = statics.mounting_load(
        arm(), POSES, DQ, DDQ, "mast", wrench_on_robot={"mast": np.arange(18.0).reshape(3, 6)}
    )
    places = [[0.1, 0.03], [-0.12, 0.09], [0.02, -0.11], [0.2, 0.17], [-0.05, -0.2]]
    load = cases["plate of the arm pushed"]
    return {name: fields(found) for name, found in cases.items()} | {
        "bolts": load.bolts(places),
        "bolts, preloaded": load.bolts(places, 900.0),
        "circle": load.bolts(statics.bolt_circle(3, 0.31)),
        "in a line": refusal(lambda: load.bolts([[0.1, 0.2], [0.2, 0.4], [0.3, 0.6]])),
        "two": refusal(lambda: load.bolts(places[:2])),
        "shape": refusal(lambda: load.bolts(places[0])),
        "moving": refusal(lambda: statics.mounting_load(arm(), Q, DQ[0], DDQ[0], "upper")),
        "floating": refusal(lambda: statics.mounting_load(flyer(), flyer().neutral, np.zeros(7), np.zeros(7))),
        "unknown": refusal(lambda: statics.mounting_load(arm(), Q, DQ[0], DDQ[0], "floor")),
    }


SITES = """<mujoco model="sites"><compiler angle="radian"/><option gravity="1.9 -2.7 -9.2"/><worldbody>
<body name="block" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3"><inertial mass="2.3" pos="0.03 -0.02 0.05" diaginertia="0.02 0.03 0.04"/>
  <site name="flange" pos="0.02 0.03 -0.1" euler="0.2 0 0.1"/>
  {more}<body name="rod" pos="0.1 0 0.05"><joint name="tilt" axis="0.1 1 0.2" range="-1 1"/>
    <inertial mass="0.9" pos="0.2 0.03 0.02" diaginertia="0.003 0.02 0.02"/></body></body>
</worldbody></mujoco>"""

ROOT_SITE = """<mujoco model="site"><compiler angle="radian"/><option gravity="1.9 -2.7 -9.2"/><worldbody>
<site name="flange" pos="0.12 0.03 -0.1" euler="0.2 0 0.1"/>
<body name="rod" pos="0.1 0 0.05"><joint name="tilt" axis="0.1 1 0.2" range="-1 1"/>
  <inertial mass="0.9" pos="0.2 0.03 0.02" diaginertia="0.003 0.02 0.02"/></body>
</worldbody></mujoco>"""


@records.of
def loads_at_sites_of_a_mounting():
    single = quiet(ROOT_SITE)
    several = quiet(
        SITES.format(
            more='<body name="box" pos="0 0.1 0"><inertial mass="1.1" pos="0.1 0 0" diaginertia="0.01 0.01 0.01"/></body>'
        )
    )
    state = [[0.3], [0.9], [-1.4]]
    return {
        "frames": {
            r.name + str(k): [sorted(r.model.frames), sorted(r.model.sites)] for k, r in enumerate((single, several))
        },
        "single": {f: fields(statics.mounting_load(single, *state, f)) for f in (None, "flange")},
        "several": {f: fields(statics.mounting_load(several, *state, f)) for f in (None, "block", "box")},
        "site": refusal(lambda: statics.mounting_load(several, *state, "flange")),
    }


@records.of
def loads_of_the_bearings():
    return {
        "arm": statics.bearing_loads(arm(), POSES, DQ, DDQ),
        "one row": statics.bearing_loads(arm(), Q, DQ[0], DDQ[0]),
        "geared": statics.bearing_loads(geared(), Q, DQ[0], DDQ[0]),
        "flyer": statics.bearing_loads(flyer(), flyer().neutral, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7], np.arange(7.0)),
    }


@records.of
def circles_of_bolts():
    return {
        "three": statics.bolt_circle(3, 0.34),
        "five": statics.bolt_circle(5, 0.2),
        "two": refusal(lambda: statics.bolt_circle(2, 0.2)),
        "half": refusal(lambda: statics.bolt_circle(3.5, 0.2)),
        "none": refusal(lambda: statics.bolt_circle(4, 0.0)),
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
