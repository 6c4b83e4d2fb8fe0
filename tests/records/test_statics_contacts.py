"""Contacts, equilibrium, support, feet and stance: complete answers on record."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench import statics
from twistwrench.statics import balance, cone_programme, contact_forces, contacts, equilibrium, feet, stance
from twistwrench.statics import zero_moment_point as zmp
from twistwrench.statics.contacts import Contact
from twistwrench.statics.support import force_shares

from .test_statics import POSES, Q, arm, coupled, from_file, joint, link, quiet

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

# ── Robots on legs


BOX = '<collision><origin xyz="{at}" rpy="{turn}"/><geometry><box size="{size}"/></geometry></collision>'
BALL = '<collision><origin xyz="{at}"/><geometry><sphere radius="{size}"/></geometry></collision>'
ROLL = '<collision><origin xyz="{at}" rpy="{turn}"/><geometry><cylinder radius="{size}" length="0.06"/></geometry></collision>'


def leg(name, hip, lengths, foot, mass=1.0):
    """Hip about a skew axis, knee, and a foot fixed to the shank."""
    a, b = lengths
    return (
        link(f"{name}_thigh", 1.3 * mass, f"0.02 -0.01 {-0.4 * a}", (0.02, 0.021, 0.004, 0.0003, -0.0005, 0.0004))
        + link(f"{name}_shank", 0.8 * mass, f"-0.01 0.02 {-0.45 * b}", (0.011, 0.012, 0.002, 0.0001, 0.0003, -0.0002))
        + f'<link name="{name}_foot">{foot}</link>'
        + joint(f"{name}_hip", "revolute", "trunk", f"{name}_thigh", hip, "0.1 0.99 0", "-1.3 1.4 70")
        + joint(
            f"{name}_knee",
            "revolute",
            f"{name}_thigh",
            f"{name}_shank",
            f"0.01 0 {-a}|0 0 0.1",
            "0 1 0.1",
            "-0.2 2.4 90",
        )
        + joint(f"{name}_sole", "fixed", f"{name}_shank", f"{name}_foot", f"0 0.01 {-b}")
    )


TRUNK = link("trunk", 9.3, "0.04 -0.02 0.06", (0.2, 0.3, 0.25, 0.01, -0.02, 0.015))
POINTS = (
    '<robot name="spider">' + TRUNK
    + leg("right", "0.3 -0.22 -0.05", (0.35, 0.31), BALL.format(at="0.01 0 -0.01", size="0.02"))
    + leg("left", "0.28 0.2 -0.05", (0.34, 0.32), BALL.format(at="0.01 0 -0.01", size="0.02"), 1.1)
    + leg("hind", "-0.31 0.15 -0.05", (0.36, 0.3), BALL.format(at="0.01 0 -0.01", size="0.02"), 0.9)
    + leg("back", "-0.29 -0.17 -0.05", (0.35, 0.31), BALL.format(at="0.01 0 -0.01", size="0.02"), 1.2)
    + "</robot>"
)  # fmt: skip
SOLES = (
    '<robot name="stork">' + TRUNK
    + leg("right", "0.03 -0.12 -0.05", (0.35, 0.31), BOX.format(at="0.04 0.01 -0.02", turn="0 0 0.2", size="0.2 0.09 0.03"))
    + leg("left", "0.02 0.14 -0.05", (0.34, 0.32), BOX.format(at="0.03 -0.01 -0.02", turn="0 0 -0.1", size="0.22 0.08 0.03"), 1.1)
    + "</robot>"
)  # fmt: skip


@cache
def spider(**options):
    return from_file(POINTS, tip="trunk", **options)


@cache
def stork(**options):
    return from_file(SOLES, **options)


def bent(robot, hips, knees):
    """Configuration of a robot on legs, the base at the neutral pose and turned a little."""
    q = np.array(robot.neutral, float)
    joints = robot.model.position_names if hasattr(robot.model, "position_names") else robot.coordinate_names
    for name, value in {**hips, **knees}.items():
        q[list(joints).index(name)] = value
    return q


HIPS = {"right_hip": -0.42, "left_hip": -0.38, "hind_hip": -0.45, "back_hip": -0.35}
KNEES = {"right_knee": 0.83, "left_knee": 0.79, "hind_knee": 0.88, "back_knee": 0.72}


@cache
def standing_spider():
    """Free spider, a pose of its base and joints, and its four contacts of unequal friction."""
    robot = spider(floating_base=True)
    q = bent(robot, HIPS, KNEES)
    q[:4] = [0.995, 0.03, -0.04, 0.02]
    q[:4] /= np.linalg.norm(q[:4])
    q[4:7] = [0.3, -0.2, 0.6]
    names = ("right", "left", "hind", "back")
    points = [(0.01, 0.005, -0.03), (0.0, -0.01, -0.03), (0.02, 0.0, -0.02), (-0.01, 0.01, -0.03)]
    own = tuple(
        Contact(p, (0.05, -0.03, 1.0), mu, frame=f"{n}_foot")
        for n, p, mu in zip(names, points, (0.7, 0.6, 0.8, 0.5), strict=True)
    )
    return robot, q, own


def lively(robot, q, rows=12):
    """Rows of states about a configuration: base and joints move in several directions at once."""
    s = np.linspace(0.0, 1.1, rows) ** 1.3
    k = np.arange(1.0, robot.nv + 1)
    dq = np.sin(2.9 * s[:, None] + 0.7 * k) * np.linspace(0.0, 1.0, rows)[:, None]
    ddq = np.cos(3.7 * s[:, None] - 0.9 * k) * np.linspace(0.0, 5.0, rows)[:, None]
    steps = 0.05 * np.sin(1.7 * s[:, None] + k) * s[:, None]
    return np.asarray(robot.add(np.repeat(q[None], rows, axis=0), steps)), dq, ddq


# ── One contact


@records.of
def contacts_of_all_kinds():
    made = {
        "plain": Contact(),
        "tilted": Contact((0.1, -0.2, 0.3), (1.0, 2.0, -2.0), 0.4),
        "bolt": Contact((0.1, 0.2, 0.0), (0, 0.6, 0.8), 0.3, pull=120.0),
        "finger": Contact((0.1, 0.2, 0.0), (0, 0, 3), 0.3, push=45.5),
        "both": Contact((0.1, 0.2, 0.0), (0.95, 0.1, 0.2), 0.25, "hand", 45.5, 7.25, "pad", 0.05),
        "smooth": Contact((0.1, 0.2, 0.0), (0, -1, 0), 0.0),
    }
    forces = np.array([
        [0.1, 0.2, 1.0], [0.6, 0, 1.0], [0, 0, -1], [0, 0, 46.0], [0.3, 0.5, -6.9], [0, 0, 0], [45, 3, 8], [-4, 0.5, 0], [0, -2, 0],
    ])  # fmt: skip
    return {
        name: {
            "contact": c, "text": repr(c), "edges": c.edges(3), "around": c.edges(5, around=True),
            "allows": c.allows(forces), "with slack": c.allows(forces, slack=0.2), "tangents": contacts.tangents(c.normal),
        }
        for name, c in made.items()
    }  # fmt: skip


@records.of
def edges_of_limits_of_one_contact():
    c = Contact((0, 0, 0), (0, 0, 1), 0.5, push=8.0, pull=2.0)
    rows = {
        "at the cone": [1.5, 0, 1.0], "within slack": [1.5 + 1e-10, 0, 1], "beyond": [1.5 + 1e-8, 0, 1],
        "at the push": [0, 0, 8.0], "beyond the push": [0, 0, 8.0 + 1e-7], "within push": [0, 0, 8.0 + 1e-9],
        "at the pull": [0, 0, -2.0], "beyond the pull": [0, 0, -2.0 - 1e-7], "within the pull": [0, 0, -2.0 - 1e-9],
    }  # fmt: skip
    ways = {n: contacts.tangents(np.array([n, 0.0, np.sqrt(1 - n * n)])) for n in (-0.95, -0.89, 0.89, 0.91)}
    return {name: c.allows(f) for name, f in rows.items()} | {"tangents": ways}


@records.of
def refusals_of_contacts():
    one = Contact()
    return [
        refusal(make)
        for make in (
            lambda: Contact((0, 0)), lambda: Contact(normal=(0, 0, 0)), lambda: Contact(friction=-0.1),
            lambda: Contact(friction=np.inf), lambda: Contact(friction=np.nan), lambda: Contact(push=-1.0),
            lambda: Contact(pull=-2.0), lambda: Contact(pull=np.inf), lambda: Contact(push=np.nan), lambda: Contact(group=3),
            lambda: Contact(frame=4), lambda: Contact(radius=-0.1), lambda: Contact((0, 0, np.nan)), lambda: one.edges(2),
            lambda: one.allows([1, 2]), lambda: contacts.contacts_of([]), lambda: contacts.contacts_of([one, 3]),
            lambda: contacts.contacts_of(one),
            lambda: contacts.cones_of([Contact(push=3.0, group="a"), Contact(push=4.5, group="a")]),
        )
    ]  # fmt: skip


@records.of
def cones_and_bounds_of_groups():
    pads = [
        Contact(normal=(0, 0, 2), friction=0.1, push=30.0, group="a", pull=2.0),
        Contact(normal=(1, 0, 0), friction=0.2, push=25.0),
        Contact(normal=(0, 1, 1), friction=0.3, push=30.0, group="a", pull=3.5),
        Contact(normal=(0, -1, 0), friction=0.4),
        Contact(normal=(0, 0, 1), friction=0.5, push=30.0, group="a", frame="hand", pull=1.0),
        Contact(normal=(0, 0, -1), friction=0.6, push=7.0, group="b"),
    ]
    cones, bounds = contacts.cones_of(pads, 2)
    return {"cones": cones, "maps": bounds.maps[0], "most": bounds.most, "rate": bounds.rate}


@records.of
def maps_of_contacts_on_links():
    robot, q, own = standing_spider()
    more = (
        *own,
        Contact((0.1, 0.2, -0.3), (0.2, 0.1, 1), frame="left_foot", radius=0.07),
        Contact((0.1, -0.2, 0.3), frame="trunk"),
        Contact((0.02, 0.03, 0.05)),
    )
    maps, points = contacts.contact_maps(robot, lively(robot, q, 3)[0], more)
    arm_maps, arm_points = contacts.contact_maps(
        arm(), POSES, [Contact((0.1, 0.2, 0.3), frame="finger"), Contact(radius=0.2)]
    )
    return {
        "points": points,
        "left": maps[:, :, 4],
        "shape": maps.shape,
        "arm": arm_maps,
        "arm points": arm_points,
        "all": maps,
    }


@records.of
def robots_whose_loops_contacts_refuse():
    loop = """<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="ja" axis="0 1 0"/><geom size="0.1" mass="1"/>
    <body name="b" pos="0.3 0 0"><joint name="jb" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body>
    <body name="c" pos="0 0 0.3"><joint name="jc" axis="0 1 0"/><geom size="0.1" mass="1"/></body></worldbody>
    <equality>{}</equality></mujoco>"""
    texts = {
        "links": '<connect name="l" body1="b" body2="c" anchor="0.1 0 0.1"/>',
        "base": '<connect name="w" body1="b" anchor="0.1 0 0.1"/>',
        "links and base": '<connect name="l" body1="b" body2="c" anchor="0.1 0 0"/><connect name="w" body1="b" anchor="0.1 0 0.1"/>',
    }

    def closed(text):
        robot = quiet(loop.format(text))
        for closure in robot.closures.values():
            robot = robot.close(closure.frame_a, closure.frame_b, "vx vz", redundant="accept")
        return robot

    found = {name: refusal(lambda t=t: contacts.refuse_loops(closed(t), "act")) for name, t in texts.items()}
    return found | {"none": contacts.refuse_loops(arm(), "act")}


# ── Bodies


TABLE = [
    Contact((0.31, 0.22, 0.004), (0.1, -0.05, 1.0), 0.5),
    Contact((-0.27, 0.19, -0.003), (0.1, -0.05, 1.0), 0.35),
    Contact((-0.24, -0.28, 0.002), (0.1, -0.05, 1.0), 0.6),
    Contact((0.29, -0.21, 0.0), (0.1, -0.05, 1.0), 0.0),
]
FINGERS = [
    Contact((0.01, 0.021, 0.002), (0.1, -1, 0.05), 0.5, push=60.0, group="left"),
    Contact((-0.012, 0.022, -0.004), (0.1, -1, 0.05), 0.45, push=60.0, group="left"),
    Contact((0.003, -0.02, 0.001), (-0.05, 1, -0.1), 0.6, push=75.0),
]
BOLTS = [
    Contact((0.08, 0.01, 0.0), (0, 0, 1), 0.2, pull=90.0),
    Contact((-0.05, 0.07, 0.0), (0, 0.1, 1), 0.25, pull=120.0),
    Contact((-0.04, -0.06, 0.01), (0.1, 0, 1), 0.15, pull=70.0),
]
CORNER = [
    Contact((0.1, 0.0, 0.2), (-1, 0, 0), 0.3), Contact((0.0, 0.15, 0.1), (0, -1, 0.1), 0.2), Contact((0.0, 0.02, 0.0), (0, 0, 1), 0.4)
]  # fmt: skip
WRENCHES = np.array([
    [0.3, -0.2, 0.1, 0.5, -1.0, -30.0],  # rests
    [0.3, -0.2, 0.4, 9.0, 4.0, -30.0],  # sideways a little
    [0.2, 0.5, 0.4, -25.0, 6.0, -30.0],  # slips
    [9.5, 2.0, 0.1, 0.4, 0.2, -30.0],  # tips
    [0.3, -0.2, 0.1, 1.0, 2.0, 14.0],  # lifts
    [1.1, -0.7, 0.3, 20.0, 11.0, 260.0],  # pulls off
    [1.3, 0.4, 9.0, 0.4, 0.2, -45.0],  # turns
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
])  # fmt: skip
AT_REST = np.array([0.2, -0.3, 0.05, 0.4, -0.3, -27.0])
HEAVIER = np.array([0.04, 0.06, 0.01, 0.1, 0.2, -9.7])


def support_fields(found):
    kept = {f.name: getattr(found, f.name) for f in dataclasses.fields(found) if f.name != "contacts"}
    return kept | {"worst": found.worst, "text": str(found)}


@records.of(relative=1e-5)
def bodies_held_by_contacts():
    grips = {
        "table": TABLE,
        "fingers": FINGERS,
        "bolts": BOLTS,
        "corner": CORNER,
        "one": TABLE[:1],
        "smooth": [TABLE[3]] * 1,
    }
    found = {name: statics.hold(WRENCHES, grip, per_kilogram=HEAVIER, at_rest=AT_REST) for name, grip in grips.items()}
    found["no margins"] = statics.hold(WRENCHES, TABLE)
    found["rows of margins"] = statics.hold(
        WRENCHES[:3], BOLTS, per_kilogram=np.stack([HEAVIER, 2 * HEAVIER, -HEAVIER])
    )
    for k, name in enumerate(("rests", "sideways", "slips", "tips", "lifts")):
        found[f"one, {name}"] = statics.hold(WRENCHES[k], TABLE, at_rest=AT_REST)
    return {name: support_fields(hold) for name, hold in found.items() if not name.startswith("one,")} | {
        "texts": {name: [str(hold), repr(hold), hold.worst] for name, hold in found.items()},
        "frame": refusal(lambda: statics.hold(WRENCHES, [Contact(frame="hand")])),
        "shape": refusal(lambda: statics.hold(WRENCHES[None], TABLE)),
        "rest shape": refusal(lambda: statics.hold(WRENCHES, TABLE, at_rest=WRENCHES[:3])),
        "weight shape": refusal(lambda: statics.hold(WRENCHES, TABLE, per_kilogram=WRENCHES[None])),
        "none": refusal(lambda: statics.hold(WRENCHES, [])),
    }


@records.of
def texts_of_supports():
    base = statics.hold(WRENCHES[:4], TABLE, at_rest=AT_REST, per_kilogram=HEAVIER)
    four = {
        "holds": np.array([True] * 4), "decided": np.array([True] * 4), "how": np.array(["holds"] * 4),
        "friction": np.array([0.1, 0.4, 0.2, 0.3]), "speed": np.array([3.0, 1.7, 2.0, 5.0]), "payload": np.array([4.0, 6.0, 2.5, 3.0]),
    }  # fmt: skip
    inf, nan = np.inf, np.nan
    changes = {
        "all": {},
        "without friction": {"friction": np.zeros(4)},
        "without speeds": {"speed": np.full(4, inf)},
        "without payloads": {"payload": np.full(4, inf)},
        "unknown payloads": {"payload": np.full(4, nan)},
        "nothing known": {"payload": np.full(4, nan), "speed": np.full(4, nan)},
        "undecided": {"decided": np.array([True, False, False, True])},
        "fails": {"holds": np.array([True, True, False, False]), "how": np.array(["holds", "holds", "tips", "slips"]), "speed": np.array([3, 2, 0.7, 0.8])},
        "fails at rest": {"holds": np.array([True, True, False, False]), "how": np.array(["holds", "holds", "tips", "slips"]), "speed": np.array([3, 2, 0.7, nan])},
        "unknown speed of a row that holds": {"speed": np.array([3.0, nan, 2.0, 1.5])},
    }  # fmt: skip
    made = {name: dataclasses.replace(base, **{**four, **change}) for name, change in changes.items()}
    return {name: [str(found), found.worst] for name, found in made.items()}


@records.of(relative=1e-5)
def shares_of_the_force_of_a_grip():
    grips = {
        "table": TABLE,
        "fingers": FINGERS,
        "bolts": BOLTS,
        "corner": CORNER,
        "at the origin": [Contact(pull=12.0, friction=0.3)],
    }
    return {name: force_shares(WRENCHES, grip) for name, grip in grips.items()} | {
        "one row": force_shares(WRENCHES[1], FINGERS)
    }


def equilibrium_fields(found):
    return {f.name: getattr(found, f.name) for f in dataclasses.fields(found) if f.name not in ("names", "frame")} | {
        "text": str(found), "repr": repr(found)[:30]
    }  # fmt: skip


@records.of(relative=1e-4)
def equilibrium_of_bodies():
    grips = {"table": TABLE, "fingers": FINGERS, "bolts": BOLTS, "corner": CORNER, "nothing": []}
    found = {
        f"{name} {k}": equilibrium_fields(statics.body_equilibrium(grip, F))
        for name, grip in grips.items()
        for k, F in enumerate(WRENCHES[: 7 if grip else 2])
    }
    return found | {
        "nothing, no load": equilibrium_fields(statics.body_equilibrium([], np.zeros(6))),
        "no load": equilibrium_fields(statics.body_equilibrium(TABLE, np.zeros(6)))["holds"],
        "marginal": equilibrium_fields(
            statics.body_equilibrium([Contact((0.1, 0, 0), friction=0.5)], [0, 1.0 + 1e-9, 0, 0, 0, -10.0])
        ),
        "moment alone": equilibrium_fields(statics.body_equilibrium([Contact()], [0.2, 0, 0, 0, 0, 0])),
        "frame": refusal(lambda: statics.body_equilibrium([Contact(), Contact(frame="hand")], WRENCHES[0])),
        "not a list": refusal(lambda: statics.body_equilibrium(3, WRENCHES[0])),
        "not a contact": refusal(lambda: statics.body_equilibrium([Contact(), 3], WRENCHES[0])),
        "many": refusal(lambda: statics.body_equilibrium(TABLE, WRENCHES)),
        "labels": [
            statics.body_equilibrium(TABLE, WRENCHES[2]).names,
            statics.body_equilibrium(TABLE, WRENCHES[2]).frame,
        ],
    }


@records.of
def equilibrium_with_hardly_any_power_of_the_proof():
    """Both sides of 1e-9 of the load, 32 N, and of no load."""
    found = {}
    for F, name in (([0, 0, 0, 0, 0, 32.0], "loaded"), ([0, 0, 0, 0, 0, 0.0], "not loaded")):
        for power in (-1.0, 0.0, 3.1e-8, 3.3e-8):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(equilibrium._System, "_unresisted_motion", lambda _, p=power: (np.arange(1.0, 7.0), p))
                patch.setattr(equilibrium._System, "_torques", lambda *_: None)
                each = statics.body_equilibrium(TABLE, F)
            found[f"{name}, {power} W"] = [each.holds, each.power, str(each)]
    return found


# ── Robots


STRONG = [80.0, 95, 75, 90, 85, 88, 70, 93]


@records.of(relative=1e-4)
def equilibrium_of_robots():
    robot, q, own = standing_spider()
    push = {"trunk": [3.0, -2.0, 1.0, 20.0, -12.0, 5.0]}
    hard = {"trunk": [3.0, -2.0, 1.0, 120.0, -12.0, 5.0]}
    wall = [Contact((0.0, 0.0, 0.02), (-0.2, 0.1, 1.0), 0.4, frame="tool", push=80.0)]
    limits = np.r_[np.zeros(6), STRONG]
    weak = np.r_[np.zeros(6), 0.2 * np.array(STRONG)]
    some = np.r_[np.zeros(6), STRONG[:4], np.inf, STRONG[5:7], np.inf]
    undriven = np.array([60.0, 130, 0.0, 24, 11, 2.5])
    cases = {
        "stands": (robot, q, own, {}),
        "stands with limits": (robot, q, own, {"limits": limits}),
        "without some limits": (robot, q, own, {"limits": some}),
        "pushed": (robot, q, own, {"limits": limits, "wrench_on_robot": push}),
        "pushed hard": (robot, q, own, {"limits": limits, "wrench_on_robot": hard}),
        "weak": (robot, q, own, {"limits": weak}),
        "on two feet": (robot, q, own[:2], {"limits": limits}),
        "in the air": (robot, q, [], {"limits": limits}),
        "arm": (arm(), Q, [], {}),
        "arm that pushes": (arm(), Q, wall, {}),
        "weak arm": (arm(), Q, [], {"limits": [60, 130, 6.0, 24, 11, 2.5]}),
        "weak arm on a wall": (arm(), POSES[1], wall, {"limits": [60, 130, 6.0, 24, 11, 2.5]}),
        "undriven joint": (arm(), Q, wall, {"limits": undriven}),
        "pushed arm": (arm(), Q, wall, {"wrench_on_robot": {"tool": [0.5, 0.3, 0.2, 5.0, -3.0, -40.0]}}),
    }
    found = {}
    for name, (machine, pose, own_contacts, options) in cases.items():
        found[name] = equilibrium_fields(statics.robot_equilibrium(machine, pose, own_contacts, **options))
        least = statics.least_norm_contact_forces(machine, pose, own_contacts, **options)
        found[f"{name}, least norm"] = {
            "holds": least.holds,
            "forces": least.forces,
            "torques": least.torques,
            "share": least.share,
        }
    labels = statics.robot_equilibrium(robot, q, own[:2])
    return found | {
        "labels": [labels.names, labels.frame],
        "coupled": refusal(lambda: statics.robot_equilibrium(coupled(), Q, wall)),
        "many": refusal(lambda: statics.robot_equilibrium(arm(), POSES, wall)),
        "wrenches": refusal(lambda: statics.robot_equilibrium(arm(), Q, wall, wrench_on_robot={"tool": np.ones((3, 6)), "fore": np.ones(6)})),
        "infinite": refusal(lambda: statics.robot_equilibrium(arm(), Q, wall, wrench_on_robot={"tool": [np.nan] * 6})),
        "contact": refusal(lambda: statics.robot_equilibrium(arm(), Q, [3])),
    }  # fmt: skip


@records.of(relative=1e-5)
def support_of_a_robot_in_motion():
    robot, q, own = standing_spider()
    states = lively(robot, q)
    mask = np.ones((12, 4), bool)
    mask[3:6, 1] = False
    mask[6:, 3] = False
    mask[11] = [True, True, False, False]
    limits = np.r_[np.zeros(6), STRONG]
    push = {"trunk": [3.0, -2.0, 1.0, 9.0, -6.0, 5.0]}
    payload = {"payload_frame": "trunk", "payload_com": (0.1, -0.05, 0.2)}
    mixed = (*own[:3], Contact((0.0, 0.0, -0.03), (0.05, -0.03, 1.0), 0.5, "back_foot", push=70.0, pull=35.0))
    found = {
        "moves": statics.support(robot, *states, own, **payload),
        "feet lifted": statics.support(robot, *states, own, in_contact=mask),
        "one mask": statics.support(robot, *states, own, in_contact=[True, True, False, True]),
        "limits": statics.support(robot, *states, own, limits=0.08 * limits),
        "some limits": statics.support(
            robot, *states, mixed, limits=np.r_[0.1 * limits[:10], np.inf, 0.1 * limits[11:]]
        ),
        "pushed": statics.support(robot, *states, own, wrench_on_robot=push, **payload),
        "preloaded": statics.support(robot, *states, mixed, payload_frame="left_foot"),
        "one row": statics.support(robot, q, states[1][4], states[2][4], own),
        "one pose": statics.support(robot, q, states[1][:5], states[2][:5], own, payload_frame="trunk"),
    }
    return {name: support_fields(each) for name, each in found.items()} | {
        "fixed": refusal(lambda: statics.support(arm(), Q, Q, Q, own)),
        "rows": refusal(lambda: statics.support(robot, states[0][:3], states[1][:2], states[2][0], own)),
        "axes": refusal(lambda: statics.support(robot, states[0][None], states[1], states[2], own)),
        "mask": refusal(lambda: statics.support(robot, *states, own, in_contact=mask[:5])),
        "mask of numbers": refusal(lambda: statics.support(robot, *states, own, in_contact=mask.astype(float))),
        "contacts": refusal(lambda: statics.support(robot, *states, [])),
        "planar root": statics.support(*planar()).zmp,
    }


def planar():
    """A cart on a planar root, at one state, with two contacts."""
    text = """<mujoco model="cart"><compiler angle="radian"/><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
    <inertial mass="3" pos="0.1 0.05 0.2" diaginertia="0.1 0.2 0.3"/></body></worldbody></mujoco>"""
    robot = quiet(text.replace('<joint name="x" type="slide" axis="1 0 0"/>', '<freejoint name="x"/>'))
    q = np.array(robot.neutral)
    return (
        robot,
        q,
        np.zeros(6),
        np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        [Contact((0.2, 0.1, 0.0)), Contact((-0.2, 0.15, 0)), Contact((0, -0.3, 0.0))],
    )


@records.of(relative=1e-5)
def forces_of_contacts_and_friction_for_torques():
    robot, q, own = standing_spider()
    states = lively(robot, q)
    tau = np.asarray(robot.inverse_dynamics(*states))
    mask = np.ones((12, 4), bool)
    mask[5:8, 2] = False
    mask[9:, :2] = False
    limits = np.r_[np.full(6, 3.0), 0.08 * np.array(STRONG)]
    free = contact_forces.contact_forces(robot, states[0], tau, own, mask)
    within = contact_forces.contact_forces(robot, states[0], tau, own, mask, limits)
    least = statics.support(robot, *states, own).friction
    bounds = [
        contact_forces.friction_within(robot, states[0], tau, own, mask | True, least, k * limits, m)
        for k, m in ((1.0, 0.5), (1.0, 1.5), (1.25, 1.5), (2.0, 1.5))
    ]
    return {
        "free": {"forces": free.forces, "holds": free.holds, "maps": free.maps},
        "within": {"forces": within.forces, "holds": within.holds},
        "rows": within.forces.sum(axis=(1, 2)) - free.forces.sum(axis=(1, 2)),
        "friction": bounds,
        "least": least,
    }  # fmt: skip


@records.of
def torques_that_exceed_limits():
    limits = np.array([4.0, 0.0, 8.0])
    rows = np.array([
        [4.0, 9.0, 8.0], [4.0 + 1e-9, 0, 0], [4.001, 0, 0], [0, 0, -8.001], [np.nan, 1, 2], [-4.0, -1, -8.0], [4.0, 0, 8.0 + 1e-6],
    ])  # fmt: skip
    return balance.exceeding(rows, limits)


# ── Programmes over cones


def cones():
    rng = np.random.default_rng(7)
    normals = rng.normal(size=(5, 3)) + np.array([0, 0, 2.5])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    friction = np.array([0.4, 0.7, 0.0, 0.9, 0.3])
    points = rng.uniform(-1, 1, (5, 3))
    maps = np.stack([np.vstack([tw.so3.hat(p), np.eye(3)]) for p in points], axis=1)
    loads = np.einsum("mck,nck->nm", maps, normals * rng.uniform(1, 9, (6, 5, 1)))
    loads[4] = [1.0, 2, -3, 4, -5, -6]
    loads[5] = 0.0
    growth = rng.normal(size=(6, 6))
    return cone_programme.Cones(normals, friction), np.broadcast_to(maps, (6, 6, 5, 3)), loads, growth


@records.of(relative=1e-5)
def programmes_over_cones():
    own, maps, loads, growth = cones()
    rng = np.random.default_rng(11)
    H = rng.normal(size=(6, 2, 5, 3))
    bounds = cone_programme.ForceBounds(H, np.tile([14.0, 9.0], (6, 1)), np.zeros((6, 2)))
    growing = cone_programme.two_sided(H, 0.3 * np.ones((6, 2)), np.zeros((6, 2)), np.tile([1.0, 2.5], (6, 1)))
    active = np.ones((6, 5), bool)
    active[1, 0] = active[2, 4] = False
    by_row = cone_programme.Cones(own.normals, np.outer(np.linspace(0.5, 1.3, 6), own.friction))
    found = {
        "balance": cone_programme.cone_programme(own, maps, loads),
        "most": cone_programme.cone_programme(own, maps, loads, growth),
        "least": cone_programme.cone_programme(own, maps, loads - 2 * growth, growth, sense="least"),
        "bounds": cone_programme.cone_programme(own, maps, loads, growth, bounds=bounds),
        "growing": cone_programme.cone_programme(own, maps, loads, bounds=growing, sense="least"),
        "active": cone_programme.cone_programme(own, maps, loads, growth, active=active),
        "friction of rows": cone_programme.cone_programme(by_row, maps, loads, growth),
        "no rows": cone_programme.cone_programme(own, maps[:0], loads[:0], growth[:0]),
        "bounds alone": cone_programme.cone_programme(own, maps[:, :0], loads[:, :0], bounds=growing, sense="least"),
    }
    found["growing"].prices[5] = np.nan  # without loads, many prices are as good
    return found | {"both": growing.concatenate(bounds).of(slice(0, 2)), "no bounds": cone_programme.no_bounds(2, 3)}


@records.of(relative=1e-5)
def forces_of_least_norm():
    own, maps, loads, _ = cones()
    rng = np.random.default_rng(11)
    H = rng.normal(size=(6, 2, 5, 3))
    active = np.ones((6, 5), bool)
    active[1, 0] = active[2, 4] = False
    by_row = cone_programme.Cones(own.normals, np.outer(np.linspace(0.5, 1.3, 6), own.friction))
    free, _ = cone_programme.least_norm_in_cones(own, maps, loads, active | True)
    sums = np.einsum("nkci,nci->nk", H, free)
    bounds = cone_programme.ForceBounds(H, sums + np.array([-0.4, 0.3]), np.zeros((6, 2)))
    return {
        "free": cone_programme.least_norm_in_cones(own, maps, loads, active | True),
        "active": cone_programme.least_norm_in_cones(own, maps, loads, active),
        "bounds": cone_programme.least_norm_in_cones(own, maps, loads, active | True, bounds),
        "friction of rows": cone_programme.least_norm_in_cones(by_row, maps, loads, active | True),
        "bounds alone": cone_programme.least_norm_in_cones(own, maps[:, :0], loads[:, :0], active | True, bounds),
    }


@records.of
def projections_onto_cones():
    own, *_ = cones()
    rng = np.random.default_rng(3)
    forces = rng.normal(size=(4, 5, 3)) * [[[3.0]], [[0.5]], [[1.0]], [[2.0]]]
    forces[0, :] = 2.0 * own.normals
    forces[1, :] = -own.normals
    nearest, slope = cone_programme._projection(own, forces)
    return {"nearest": nearest, "slope": slope, "inside and outside": [nearest[:2], slope[:2].sum(axis=(2, 3))]}


# ── Zero moment points


@records.of
def distances_from_the_edge_of_a_polygon():
    square = np.array([[0.0, 0.0], [2.0, 0.1], [2.2, 1.3], [0.3, 1.5]])
    inner = np.vstack([square, [[1.0, 0.7]]])
    places = {
        "inside": [0.9, 0.4],
        "near a corner": [0.05, 0.02],
        "below": [1.0, -0.6],
        "beyond a corner": [2.9, 2.0],
        "left": [-0.5, 0.6],
    }
    shapes = {
        "square": square,
        "with a point inside": inner,
        "in another order": square[[2, 0, 3, 1]],
        "line": square[:2],
        "point": square[:1],
    }
    return {name: {at: zmp._inside(shape, np.array(p)) for at, p in places.items()} for name, shape in shapes.items()}


@records.of
def zero_moment_points_of_contacts():
    heights = {"flat": 0.0, "just within 1 cm": 0.0098, "just beyond 1 cm": 0.0102}
    found = {}
    for name, height in heights.items():
        own = [dataclasses.replace(c, point=c.point + (height * c.normal if k == 1 else 0)) for k, c in enumerate(FLAT)]
        each = statics.hold(WRENCHES[[0, 1, 3, 4]], own)
        found[name] = [each.zmp, each.zmp_margin]
    turned = [*FLAT[:3], Contact((0.29, -0.21, 0.0), (0.1, -0.05 + 2e-8, 1.0), 0.3)]
    nearly = [*FLAT[:3], Contact((0.29, -0.21, 0.0), (0.1, -0.05 + 2e-10, 1.0), 0.3)]
    each = [statics.hold(WRENCHES[:2], own).zmp_margin for own in (turned, nearly)]
    return found | {"one normal differs": each}


NORMAL = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
FLAT = [
    Contact(p - (p @ NORMAL) * NORMAL + 0.03 * NORMAL, NORMAL, 0.5)
    for p in np.array([[0.31, 0.22, 0.1], [-0.27, 0.19, 0.0], [-0.24, -0.28, 0.1], [0.29, -0.21, 0.0]])
]


# ── Feet


def footed(left="left_foot", right="right_foot", extra="", base="SOLES"):
    text = SOLES.replace("left_foot", left).replace("right_foot", right)
    return from_file(text.replace("</robot>", extra + "</robot>"))


@records.of
def feet_that_are_found():
    def fixed(name, parent, at, shape=""):
        return f'<link name="{name}">{shape}</link>' + joint(f"to_{name}", "fixed", parent, name, at)

    shape = BALL.format(at="0 0 0", size="0.01")
    robots = {
        "points": spider(),
        "free": spider(floating_base=True),
        "soles": stork(),
        "sensor below": footed(extra=fixed("left_foot_bumper", "left_foot", "0 0 -0.02")),
        "only a sensor": footed(left="left_imu"),
        "toe as low": footed(left="left_pad", extra=fixed("left_toe", "left_pad", "0.1 0 0.009") + fixed("left_tip", "left_pad", "0.05 0 0")),
        "toe too high": footed(left="left_pad", extra=fixed("left_toe", "left_pad", "0.1 0 0.011")),
        "two feet, one with a shape": footed(extra=fixed("left_sole", "left_foot", "0.02 0 0.001") + fixed("left_ankle", "left_foot", "0.02 0 0.002", shape)),
        "capitals": footed(left="Left_FOOT", extra=fixed("left_end", "Left_FOOT", "0 0 -0.005")),
        "arm": arm(),
    }  # fmt: skip
    found = {name: statics.find_feet(robot) for name, robot in robots.items()}
    knees_up = [-1.2, 2.3, -1.1, 2.2]
    more = footed(extra=fixed("left_heel", "left_shank", "0.3 0 -0.1"))
    return found | {
        "in a pose": statics.find_feet(more, knees_up),
        "neutral": statics.find_feet(more),
        "short q": refusal(lambda: statics.find_feet(stork(), [1.0])),
        "nan": refusal(lambda: statics.find_feet(stork(), [np.nan, 0, 0, 0])),
        "upward": [feet.upward(arm()), feet.upward(stork())],
    }


def from_the_first_corner(contacts):
    """Contacts in their order around a face, which may begin at any corner, from the one of the smallest coordinates."""
    first = min(range(len(contacts)), key=lambda k: contacts[k].point.round(9).tolist())
    return contacts[first:] + contacts[:first]


@records.of
def soles_of_feet():
    q = [0.3, 0.7, -0.4, 0.9]
    two = footed(
        extra='<link name="pad"><visual><geometry><box size="0.1 0.05 0.02"/></geometry></visual></link>'
        + joint("to_pad", "fixed", "right_shank", "pad", "0.1 0 -0.3")
    )
    tall = from_file(SOLES.replace('size="0.22 0.08 0.03"', 'size="0.04 0.05 0.3"'))
    many = {
        "ball": (spider(), "left_foot", {}),
        "box": (stork(), "left_foot", {}),
        "box in a pose": (stork(), "left_foot", {"q": q}),
        "box on its side": (stork(), "left_foot", {"q": [0, 0, 0.9, 0.75]}),
        "rectangle": (stork(), "left_foot", {"size": (0.2, 0.1)}),
        "rectangle elsewhere": (stork(), "left_foot", {"size": (0.2, 0.1), "at": (0.03, -0.02, -0.04)}),
        "normal": (stork(), "right_foot", {"normal": (0.1, 0.2, 0.97)}),
        "by the link": (stork(), "left_shank", {"at": (0.01, 0.02, -0.1)}),
        "thigh without shape": (stork(), "left_thigh", {"at": (0.01, 0.02, -0.1)}),
        "visual": (two, "pad", {}),
        "tall box": (tall, "left_foot", {}),
        "tall box that lies": (tall, "left_foot", {"q": [0.1, 0.2, -0.4, 1.98]}),
        "tall box that stands": (tall, "left_foot", {"q": [0.8, 0.7, 0.03, -0.02]}),
    }
    found = {name: statics.sole(robot, frame, 0.55, **options) for name, (robot, frame, options) in many.items()}
    found = {name: one if "rectangle" in name else from_the_first_corner(one) for name, one in found.items()}
    return found | {
        "base": refusal(lambda: statics.sole(stork(), "trunk", 0.5)),
        "size": refusal(lambda: statics.sole(stork(), "left_foot", 0.5, size=(0.1, -0.2))),
        "length": refusal(lambda: statics.sole(stork(), "left_foot", 0.5, size=(0.0, 0.2))),
        "frame": refusal(lambda: statics.sole(stork(), "foot", 0.5)),
        "place": refusal(lambda: statics.sole(stork(), "left_foot", 0.5, at=(1, 2))),
    }


SHAPES = {
    "disc": ROLL.format(at="0.01 0.02 -0.03", turn="0 0 0", size="0.05"),
    "two balls": BALL.format(at="0.1 0 -0.02", size="0.02") + BALL.format(at="-0.08 0.01 -0.02", size="0.02"),
    "two balls of unequal radius": BALL.format(at="0.1 0 -0.02", size="0.02")
    + BALL.format(at="-0.08 0.01 -0.01", size="0.03"),
    "ball above": BALL.format(at="0.1 0 -0.02", size="0.02") + BALL.format(at="-0.08 0.01 0.03", size="0.02"),
    "ball 4.9 mm above": BALL.format(at="0.1 0 -0.02", size="0.02") + BALL.format(at="-0.08 0.01 -0.0151", size="0.02"),
    "ball 5.1 mm above": BALL.format(at="0.1 0 -0.02", size="0.02") + BALL.format(at="-0.08 0.01 -0.0149", size="0.02"),
    "box and ball": BOX.format(at="0 0 -0.02", turn="0 0 0.1", size="0.1 0.05 0.02")
    + BALL.format(at="0.12 0 -0.0105", size="0.02"),
    "tilted box": BOX.format(at="0 0 0", turn="0 0.3 0.1", size="0.2 0.1 0.02"),
    "edge": BOX.format(at="0 0 0", turn="0.785398 0 0", size="0.2 0.1 0.1"),
    "tread": BOX.format(at="0 0 -0.02", turn="0 0 0", size="0.1 0.0009 0.02"),
    "wide tread": BOX.format(at="0 0 -0.02", turn="0 0 0", size="0.1 0.0011 0.02"),
    "wheel": ROLL.format(at="0 0.01 0", turn="1.5707963 0 0", size="0.11"),
    "wheel above": ROLL.format(at="0 0.01 0.3", turn="1.5707963 0 0", size="0.11"),
}


@records.of
def faces_of_shapes():
    found = {}
    for name, shape in SHAPES.items():
        text = SOLES.replace(BOX.format(at="0.03 -0.01 -0.02", turn="0 0 -0.1", size="0.22 0.08 0.03"), shape)
        robot = from_file(text)
        points, radius = feet._lowest_face(robot, "left_foot", None)
        found[name] = {"points": points, "radius": radius, "wheel": statics.wheel(robot, "left_foot", 0.3).radius}
    caster = statics.wheel(stork(), "right_foot", 0.0, normal=(0.1, 0.0, 1.0))
    return found | {
        "caster": caster, "no shape": statics.wheel(stork(), "left_thigh", 0.4),
        "base": refusal(lambda: statics.wheel(stork(), "trunk", 0.4)),
    }  # fmt: skip


@records.of
def corners_of_points():
    angles = 2 * np.pi * (np.arange(11) + 0.1 * np.sin(np.arange(11) * 3.0)) / 11
    ring = np.column_stack([0.2 * np.cos(angles), 0.1 * np.sin(angles)])
    return {
        "ring": feet._corners(ring),
        "line": feet._corners(np.array([[0.0, 0.0], [0.1, 0.05], [0.04, 0.02], [-0.02, -0.01]])),
        "point": feet._corners(np.array([[0.1, 0.2], [0.1004, 0.2], [0.1, 0.2003]])),
        "one": feet._corners(np.array([[0.1, 0.2]])),
        "triangle": feet._corners(np.array([[0.1, 0.2], [0.4, 0.1], [0.3, 0.5], [0.27, 0.3]])),
    }


@records.of
def patches():
    corners = [(0.02, 0.001, 0.003), (-0.01, 0.017, 0), (-0.012, -0.017, 0.001)]
    return {
        "all": statics.patch("hand", corners, (0, 0.6, 0.8), 0.45, 80.0, 60.0),
        "plain": statics.patch(None, corners[:2], (0, 0, 2), 0.5),
        "one corner": refusal(lambda: statics.patch(None, corners[0], (0, 0, 1), 0.5)),
    }


# ── Stance


def steps(robot, rows=40, lift=0.3):
    """Joint motion of a stork that stands on one leg, shifts, and lifts the other, at uneven times."""
    t = np.cumsum(np.r_[0.0, 0.02 + 0.01 * np.sin(np.arange(rows - 1.0))])
    s = np.linspace(0, 1, rows)
    up = np.clip(np.sin(2 * np.pi * s), 0, None) * lift
    down = np.clip(-np.sin(2 * np.pi * s), 0, None) * lift
    names = list(robot.coordinate_names)
    q = np.zeros((rows, len(names)))
    q[:, names.index("right_hip")] = -0.3 - up + 0.02 * s
    q[:, names.index("right_knee")] = 0.6 + 2 * up
    q[:, names.index("left_hip")] = -0.31 - down
    q[:, names.index("left_knee")] = 0.62 + 2 * down
    return tw.Motion(t, q, robot=robot, in_seconds=True)


@records.of(relative=1e-5)
def motions_of_the_base_of_a_stork():
    held, free = stork(floating_base=False), stork(floating_base=True)
    motion = steps(held)
    chosen = ["left_foot"] * 15 + ["right_foot"] * 20 + ["left_foot"] * 5
    loaded = dataclasses.replace(motion, tau=np.sin(np.arange(160.0)).reshape(40, 4))
    found = {
        "auto": stance.base_from_stance(free, motion, ["left_foot", "right_foot"]),
        "one": stance.base_from_stance(free, motion, ["right_foot", "left_foot"], "left_foot"),
        "chosen": stance.base_from_stance(free, loaded, ["left_foot", "right_foot"], chosen),
    }
    return {
        name: {"q": m.q, "dq": m.dq, "ddq": m.ddq, "tau": m.tau, "robot": m.robot.name, "in seconds": m.in_seconds, "rows": m.q[[5, 17, 33], :7]}
        for name, m in found.items()
    } | {
        "rows": refusal(lambda: stance.base_from_stance(free, motion, ["left_foot", "right_foot"], ["left_foot"] * 3)),
        "foot": refusal(lambda: stance.base_from_stance(free, motion, ["left_foot"], "right_foot")),
        "fixed": refusal(lambda: stance.base_from_stance(held, motion, ["left_foot"])),
    }  # fmt: skip


SPIDER_FEET = ["right_foot", "left_foot", "hind_foot", "back_foot"]


def on_the_ground(held):
    """Configuration of the held spider whose feet are 0.6 m below its base, but for millimetres."""
    names = list(held.coordinate_names)
    q = np.array([{**HIPS, **KNEES}[name] for name in names])
    for foot, millimetres in zip(SPIDER_FEET, (0.0, 1.5, -1.0, 2.5), strict=True):
        knee = names.index(foot.replace("foot", "knee"))
        for _ in range(6):
            error = held.forward_kinematics(q, foot)[2, 3] + 0.6 - 0.001 * millimetres
            q[knee] -= error / held.jacobian(q, foot, "world_aligned")[5, knee]
    return q


@records.of(relative=1e-5)
def motions_of_the_base_of_a_spider():
    held, free = spider(floating_base=False), spider(floating_base=True)
    names = list(held.coordinate_names)
    rows = 36
    s = np.linspace(0, 1, rows)
    q = np.tile(on_the_ground(held), (rows, 1))
    q[:, names.index("right_hip")] += 0.01 * s
    for foot, start in (("left", 0.1), ("hind", 0.55)):
        lift = 0.25 * np.clip(np.sin(np.pi * (s - start) / 0.35), 0, None) * (s > start) * (s < start + 0.35)
        q[:, names.index(f"{foot}_hip")] -= 2.2 * lift
        q[:, names.index(f"{foot}_knee")] += 2.4 * lift
    time = 0.03 * np.arange(rows) + 0.002 * np.sin(np.arange(rows))
    motion = tw.Motion(time, q, robot=held, in_seconds=True)
    found = stance.base_from_stance(free, motion, SPIDER_FEET)
    soles = stance.resting_points({f: np.array([c.point for c in statics.sole(held, f, 0.0)]) for f in SPIDER_FEET})
    poses, standing = stance.base_poses(held, time, q, soles)
    normal = np.array([0.1, -0.2, 0.9]) / np.linalg.norm([0.1, -0.2, 0.9])
    sloped, _ = stance.base_poses(held, time, q, soles, normal=normal)
    return {
        "q": found.q, "dq": found.dq, "ddq": found.ddq, "poses": poses[[0, 12, 30]], "standing": ["".join("01"[int(x)] for x in row) for row in standing],
        "sloped": sloped[[0, 20]],
        "two feet alone": refusal(lambda: stance.base_poses(held, time, q, {f: np.zeros((1, 3)) for f in SPIDER_FEET[:2]})),
    }  # fmt: skip


@records.of
def points_that_rest():
    one, four = np.array([[0.1, 0.2, 0.3]]), np.array([[0.1, 0.2, 0.3], [0.3, 0.1, 0], [0, 0.1, 0.2], [0.5, 0.4, 0.1]])
    return {
        "two points": stance.resting_points({"a": one, "b": 2 * one}),
        "one point": stance.resting_points({"a": one}),
        "three points": stance.resting_points({"a": one, "b": 2 * one, "c": 3 * one}),
        "a sole and a point": stance.resting_points({"a": four, "b": one}),
        "none": stance.resting_points({}),
    }


@records.of
def next_feet_to_stand():
    time = np.array([0.0, 0.004, 0.011, 0.017, 0.026, 0.031, 0.04, 0.052, 0.06])

    def heights(*lower):
        """Foot 0 at height 0; foot 1 lower by as many millimetres in each row."""
        return np.column_stack([np.zeros(9), -0.001 * np.array(lower, float), np.full(9, 0.02)])

    cases = {
        "never lower": heights(0, 1, 2, 3, 4, 4, 4, 4, 4.9),
        "lower for long": heights(-3, -0.4, -0.6, 2, 5.1, 6, 7, 8, 9),
        "exactly 5 mm": heights(-3, -2, -0.4, 2, 5.0, 5.0, 5.0, 5.0, 5.0),
        "too short": heights(-3, -2, 6, 6, 2, 1, 0, 0, 0),
        "long enough": heights(-3, -2, 6, 6, 6, 6, 2, 0, 0),
        "short, then long": heights(-3, 6, 6, 1, 1, 6, 6, 6, 6),
        "at the end, two rows": heights(-3, -2, -2, 0, 0, 0, 0, 6, 6),
        "at the end, one row": heights(-3, -2, -2, 0, 0, 0, 0, 0, 6),
        "lower at once": heights(9, 9, 9, 9, 9, 9, 9, 9, 9),
        "never as low": heights(-9, -9, -9, -9, 9, 9, 9, 9, 9),
        "half a millimetre": heights(-0.51, -0.49, -0.6, -3, 9, 9, 9, 9, 9),
    }
    return {name: [stance._next_lowest(time, h, 0), stance._next_lowest(time, h, 1)] for name, h in cases.items()} | {
        "chosen": [stance._next_chosen(np.array(x), 2) for x in ([2, 2, 2], [2, 2, 0, 1], [1, 2, 2])],
    }


@records.of
def planes_of_feet():
    up = np.array([0.0, 0.0, 1.0])
    tilted = np.array([0.1, -0.2, 0.9]) / np.linalg.norm([0.1, -0.2, 0.9])
    flat = np.array([[0.3, 0.2, -0.5], [-0.25, 0.21, -0.48], [-0.28, -0.2, -0.53], [0.31, -0.22, -0.51]])
    steep = flat @ np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
    clouds = {
        "flat": flat,
        "one above": np.vstack([flat, [[0.0, 0.1, -0.2]]]),
        "just off the plane": np.vstack([flat[:3], [[0.31, -0.22, -0.49]]]),
        "steep": steep,
        "line": np.array([[0.3, 0.2, -0.5], [0.1, 0.1, -0.5], [-0.1, 0.0, -0.5]]),
        "two": flat[:2],
        "narrow": np.array([[0.3, 0.0, -0.5], [-0.3, 0.0009, -0.5], [0.0, 0.0, -0.5]]),
        "less narrow": np.array([[0.3, 0.0, -0.5], [-0.3, 0.009, -0.5], [0.0, 0.0, -0.5]]),
    }
    turn = tw.so3.exp([0.1, -0.25, 0.3]).T
    uneven = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * [0.3, 0.2, 0] + [0.02, 0.01, -0.5]
    for mm in (9.8, 10.2):
        clouds[f"{mm} mm from the plane"] = (uneven + 0.001 * mm * np.outer([1, -1, 1, -1], up)) @ turn
    for degrees in (44.0, 46.0):
        clouds[f"leans by {degrees} degrees"] = uneven @ tw.so3.exp(np.radians(degrees) * np.array([0.6, 0.8, 0])).T
    return {
        name: {
            "plane": stance._nearest_plane(points, up),
            "pose": stance._pose_on_plane([points], up, up),
            "slope": stance._pose_on_plane([points[:1], points[1:]], up, tilted),
        }
        for name, points in clouds.items()
    } | {
        "level": stance.level_pose(stork(), flat, tilted),
        "rotation": [stance._rotation_between(up, tilted), stance._rotation_between(tilted, tilted)],
    }


@records.of
def poses_that_fit_points():
    rng = np.random.default_rng(4)
    points, targets = rng.normal(size=(3, 4, 3)), rng.normal(size=(4, 3))
    flat = points * [1, 1, 0]
    T = np.tile(np.eye(4), (5, 1, 1))
    for k, angle in enumerate((0.5, 2.5, 3.3, 4.0, 7.0)):
        T[k, :3, :3] = tw.so3.exp(angle * np.array([0.6, 0, 0.8]))
        T[k, :3, 3] = [k, 2, 3]
    return {
        "poses": stance._fit_poses(points, targets),
        "flat": stance._fit_poses(flat, targets * [1, -1, 0]),
        "coordinates": stance.pose_coordinates(T),
        "heights": stance._sole_heights([points, 2 * points[:, :2]], T[:3], np.array([0.1, 0.2, 0.97])),
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
