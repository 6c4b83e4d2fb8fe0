"""Simulations of open robots: complete answers on record."""

from __future__ import annotations

import re
from fractions import Fraction

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.simulation import Event, JointStops, Partitioned, Plane, Tableau

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

GRAVITY = (1.3, -2.1, -9.2)
ARM = """<robot name="arm">
<link name="ground"/>
<link name="upper"><inertial><origin xyz="0.11 -0.03 0.05"/><mass value="2.3"/>
 <inertia ixx="0.031" iyy="0.044" izz="0.027" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="slide"><inertial><origin xyz="-0.02 0.07 0.13"/><mass value="1.1"/>
 <inertia ixx="0.012" iyy="0.015" izz="0.009" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="hand"><inertial><origin xyz="0.05 0.02 -0.04"/><mass value="0.7"/>
 <inertia ixx="0.004" iyy="0.006" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="waist" type="revolute"><parent link="ground"/><child link="upper"/><origin xyz="0.1 0.2 0.3"/>
 <axis xyz="0 0 1"/><limit lower="-1.125" upper="0.875" effort="9" velocity="2.5"/>
 <dynamics damping="0.4" friction="0.3"/></joint>
<joint name="reach" type="prismatic"><parent link="upper"/><child link="slide"/><origin xyz="0.3 0.05 -0.07"/>
 <axis xyz="1 0 0"/><limit lower="-0.25" upper="0.375" effort="30" velocity="1.25"/>
 <dynamics damping="2.1" friction="1.7"/></joint>
<joint name="elbow" type="continuous"><parent link="slide"/><child link="hand"/><origin xyz="0.02 0.1 0.15"/>
 <axis xyz="0 1 0"/><limit effort="4" velocity="6"/><dynamics damping="0.03"/></joint>
<joint name="tooling" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0.06 -0.09 0.12" rpy="0.7 0.1 0.4"/></joint>
</robot>"""
FLOATER = """<mujoco model="floater"><worldbody><body name="trunk" pos="0.1 0.2 0.7">
<freejoint name="float"/><inertial pos="0.02 -0.01 0.03" mass="2.1" fullinertia="0.03 0.04 0.05 0.002 -0.003 0.001"/>
<site name="foot" pos="0.1 -0.05 -0.2" euler="10 20 30"/>
<body name="arm" pos="0.2 0.1 0.05"><joint name="ball" type="ball"/>
<inertial pos="0.12 0.03 -0.02" mass="0.8" fullinertia="0.01 0.02 0.015 0 0 0"/>
<body name="tip" pos="0.3 0.02 0.04"><joint name="wrist" axis="0 1 0" range="-40 70"/>
<inertial pos="0.05 -0.04 0.06" mass="0.4" fullinertia="0.002 0.004 0.003 0 0 0"/>
</body></body></body></worldbody></mujoco>"""
BALL = """<mujoco model="ball"><worldbody><body name="arm"><joint name="ball" type="ball"/>
<inertial pos="0.12 0.03 0" mass="0.8" diaginertia="0.01 0.02 0.015"/></body></worldbody></mujoco>"""
Q0 = (0.3, -0.07, 1.9)
DQ0 = (-0.8, 0.35, 1.4)
METHODS = ("dopri5", "rk4", "semi_implicit", "euler", "midpoint", "variational", "variational6")
LOADED = {}


def arm():
    """The arm: a revolute, a prismatic and a continuous joint, each with its own limits and friction."""
    if "arm" not in LOADED:
        LOADED["arm"] = tw.load(ARM, gravity=GRAVITY)
    return LOADED["arm"]


def stiction_arm():
    """The arm with static friction and friction by load in its drives."""
    if "stiction" not in LOADED:
        laws = {
            "waist": {
                "friction": {
                    "viscous": "0.2 N m s/rad",
                    "coulomb": "0.5 N m",
                    "static": "0.9 N m",
                    "stribeck": "0.2 rad/s",
                    "load": 0.07,
                }
            },
            "elbow": {"friction": {"coulomb": "0.11 N m", "load": 0.04}},
        }
        LOADED["stiction"] = arm().with_actuators({"actuators": laws})
    return LOADED["stiction"]


def coupled_arm():
    """The arm whose waist and elbow are driven by two motors together."""
    if "coupled" not in LOADED:
        coupling = {"motors": ["m1", "m2"], "joints": ["waist", "elbow"], "motor_per_joint": [[1.5, 0.4], [-0.3, 2.0]]}
        drives = {
            "m1": {"reflected_inertia": "0.11 kg m^2", "friction": {"viscous": "0.3 N m s/rad", "coulomb": "0.4 N m"}},
            "m2": {"reflected_inertia": "0.07 kg m^2", "friction": {"coulomb": "0.2 N m", "load": 0.05}},
        }
        LOADED["coupled"] = arm().with_actuators({"couplings": {"both": coupling}, "actuators": drives})
    return LOADED["coupled"]


def floater():
    """A floating trunk with an arm on a ball joint, and a hinge at its end."""
    if "floater" not in LOADED:
        LOADED["floater"] = tw.load(FLOATER, gravity=GRAVITY)
    return LOADED["floater"]


def floating_start():
    robot = floater()
    q0 = robot.add(robot.neutral, [0.2, -0.4, 0.5, 0.1, 0.15, -0.2, 0.3, -0.1, 0.6, 0.35])
    return q0, np.array([0.9, -1.3, 0.7, 0.2, -0.5, 0.4, 1.1, -0.6, 0.8, 1.7])


def whole(result):
    """All fields of a result that are arrays or texts, its remarks and its length."""
    fields = (
        "times", "q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "work", "momentum", "stopped", "completed",
        "method", "dt", "steps", "rejected", "evaluations", "error_estimate", "relative_error", "remarks", "friction",
        "energy", "relative_drift",
    )  # fmt: skip
    content = {name: getattr(result, name) for name in fields}
    content["events"] = [str(event) for event in result.events]
    content["states at events"] = [np.concatenate([event.q, event.dq]) for event in result.events]
    return content


def changed(content, other):
    """Names of fields whose numbers or texts differ."""
    names = []
    for name, value in content.items():
        if name in ("work", "states at events"):
            continue
        if isinstance(value, np.ndarray | float):
            is_equal = np.allclose(value, other[name], rtol=1e-12, atol=1e-14, equal_nan=True)
        else:
            is_equal = value == other[name]
        if not is_equal:
            names.append(name)
    return names


def brief(result):
    """Rows, end, sums, works, counts, errors and events of a result, and what it says of itself."""
    is_iterated = result.method == "midpoint" or "variational" in result.method  # up to rounding errors
    is_iterated |= result.method == "dopri5" and bool(result.events)  # as are the instants of events
    return [
        len(result),
        [result.times[-1], *result.q[-1], *result.dq[-1], *result.ddq[-1], *result.tau[-1]],
        [result.times.sum(), *result.q.sum(axis=0)],
        [result.work[name][-1] for name in result.work],
        [result.steps, result.rejected, None if is_iterated else result.evaluations],
        result.error_estimate,
        [f"{event} {event.q.sum():.5f} {event.dq.sum():.5f}" for event in result.events],
        said(result),
    ]


def said(result):
    """Text of a result without a drift that is rounding."""
    return re.sub(r"drift of energy \d.\de-1\d", "drift of energy: rounding", repr(result)).partition(", ")[2]


def failed(call):
    """Message of a simulation that fails, and its result up to there."""
    with pytest.raises(tw.SimulationError) as caught:
        call()
    result = caught.value.result
    end = [result.times[-1], *result.q[-1], *result.dq[-1], *result.ddq[-1], *result.tau[-1]]
    return [str(caught.value), end, result.error_estimate, result.stopped == str(caught.value), result.interrupted]


def pushes(t, q, dq):
    return np.array([0.4 - 0.3 * q[0] + 0.1 * dq[2], 1.1 * np.cos(3 * t), -0.2 * dq[2] + 0.05 * q[1]])


def wrench_of_time(t, q, dq):
    return np.array([0.1, -0.2 * t, 0.3, 1.0 + dq[1], -0.7, 2.0 * q[0]])


WRENCH = (0.3, -0.2, 0.5, 1.1, -2.3, 0.9)
OPTIONS = {
    "nothing": {},
    "constant torques": {"tau": [1.3, -4.1, 0.6]},
    "torques of a function": {"tau": pushes},
    "wrenches": {"wrench_on_robot": {"tool": WRENCH, "upper": wrench_of_time}},
    "a controller and torques": {"controller": lambda t, q, dq: [-2.0 * dq[0], 3.0 * t, 0.3 - q[2]], "tau": [0.2, 5.0, -0.1]},
    "a controller and a function": {"controller": lambda t, q, dq: [-2.0 * dq[0], 3.0 * t, 0.3 - q[2]], "tau": pushes},
    "friction": {"friction": True, "tau": [1.3, -4.1, 0.6]},
    "stops": {"contacts": JointStops(3e3, exponent=1.5, dissipation=0.4)},
    "a plane": {"contacts": Plane("tool", [[0.01, 0.02, 0.05], [0.03, -0.04, -0.02]], (0.2, 0.3, 1.0), 0.55, 2e3, 1.25, 0.6, 0.7, 0.03)},
}  # fmt: skip


@records.of
def motions_of_an_arm_by_method_and_option():
    answers = {}
    methods = ("rk4", "semi_implicit", "dopri5", "euler", "midpoint")
    for k, (name, options) in enumerate(OPTIONS.items()):
        for method in (methods[k % 5], methods[(k + 1) % 5], methods[(k + 2) % 5]):
            answers[f"{name}, {method}"] = brief(arm().simulate(Q0, DQ0, 0.03, 0.01, method=method, **options))
    return answers


@records.of
def whole_results_of_an_arm():
    every = {"tau": pushes, "wrench_on_robot": {"tool": WRENCH}, "friction": True}
    return {
        "all forces, rk4": whole(arm().simulate(Q0, DQ0, 0.05, 0.01, method="rk4", **every)),
        "all forces, semi_implicit": whole(arm().simulate(Q0, DQ0, 0.05, 0.01, method="semi_implicit", **every)),
        "all forces, dopri5": whole(arm().simulate(Q0, DQ0, 0.05, 0.01, **every)),
        "every third": whole(arm().simulate(Q0, DQ0, 0.1, 0.012, method="rk4", every=3, tau=[1, 2, 3])),
        "every second, adaptive": whole(arm().simulate(Q0, DQ0, 0.1, 0.012, every=2, tau=pushes)),
        "defaults": whole(arm().simulate(duration=0.03, dt=0.01)),
    }


@records.of
def motions_of_a_floating_robot_by_method():
    q0, dq0 = floating_start()
    robot = floater()
    foot = Plane("foot", stiffness=800.0, height=0.42, friction=0.5, dissipation=0.3)
    answers = {
        method: brief(robot.simulate(q0, dq0, 0.02, 0.02, method=method))
        for method in ("rk4", "semi_implicit", "midpoint")
    }
    ball = tw.load(BALL, gravity=GRAVITY)
    spin = ball.add(ball.neutral, [0.3, -0.4, 0.2]), [4.9, -7.3, 3.7]
    for method in METHODS:
        answers[f"a ball, {method}"] = brief(ball.simulate(*spin, 0.04, 0.02, method=method))
    answers["wrench"] = brief(robot.simulate(q0, dq0, 0.02, 0.02, method="midpoint", wrench_on_robot={"arm": WRENCH}))
    answers["ground"] = brief(robot.simulate(q0, dq0, 0.02, 0.01, method="euler", contacts=foot))
    answers["function"] = brief(robot.simulate(q0, dq0, 0.01, 0.006, tau=lambda t, q, dq: 0.1 * t - 0.05 * dq))
    answers["not of unit length"] = brief(robot.simulate(3.0 * np.asarray(q0), dq0, 0.02, 0.02, method="rk4"))
    return answers


@records.of
def friction_by_law_and_method():
    answers = {}
    for label, robot in {"arm": arm(), "stiction": stiction_arm(), "coupled": coupled_arm()}.items():
        for method in ("dopri5", "rk4", "semi_implicit"):
            if label == "coupled" and method == "semi_implicit":
                continue

            start = {
                "q0": Q0,
                "dq0": [0.02, -0.01, 0.5],
                "duration": 0.02,
                "dt": 0.01,
                "method": method,
                "friction": True,
            }
            answers[f"{label}, {method}"] = brief(robot.simulate(**start, tau=[0.4, 11.0, 0.2]))
            if method != "semi_implicit":
                answers[f"{label}, {method}, creep"] = brief(robot.simulate(**start, creep=0.04))
    held = arm().simulate([0.0, 0.05, 0.3], None, 0.05, 0.01, method="semi_implicit", friction=True)
    stops = arm().simulate(
        Q0, [0.03, 0.02, 0.0], 0.2, 0.01, method="semi_implicit", friction=True, tau=[-2.4, 9.4, 0.3]
    )
    return answers | {"from rest": brief(held), "stopping": whole(stops)}


@records.of
def steps_with_implicit_gains():
    holds = tw.control.PD(arm(), [0.4, 0.1, 1.0], [30.0, 400.0, 2.0], [9.0, 70.0, 0.8])
    answers = {}
    for method in ("semi_implicit", "rk4"):
        for friction in (False, True):
            found = arm().simulate(Q0, DQ0, 0.02, 0.01, method=method, tau=holds, friction=friction)
            answers[f"{method}, friction {friction}"] = brief(found)
    return answers


@records.of
def ends_at_position_limits():
    answers = {}
    starts = {
        "upper of the waist": ([0.8, 0.1, 0.2], [1.9, 0.2, 0.1]),
        "lower of the waist": ([-1.05, 0.1, 0.2], [-1.7, 0.2, 0.1]),
        "upper of the reach": ([0.1, 0.35, 0.2], [0.1, 0.9, 0.1]),
        "lower of the reach": ([0.1, -0.23, 0.2], [0.1, -0.8, 0.1]),
        "at a limit, outward": ([0.875, 0.1, 0.2], [0.5, 0.2, 0.1]),
        "at a limit, inward": ([0.875, 0.1, 0.2], [-1.5, 0.2, 0.1]),
        "at two limits, outward": ([0.875, -0.25, 0.2], [0.5, -0.7, 0.1]),
        "at rest at a limit, falling out": ([-1.125, 0.1, 0.2], [0.0, 0.0, 0.0]),
        "at rest at another limit": ([0.875, 0.1, 0.2], [0.0, 0.0, 0.0]),
        "at rest, falling out above": ([-0.5, 0.375, 0.2], [0.0, 0.0, 0.0]),
        "at rest, falling out below": ([0.6, -0.25, 0.2], [0.0, 0.0, 0.0]),
    }
    for name, (q0, dq0) in starts.items():
        for method in ("rk4", "semi_implicit", "dopri5"):
            found = arm().simulate(q0, dq0, 0.08, 0.01, method=method, limits="stop")
            answers[f"{name}, {method}"] = [*brief(found), str(found.verdict.reasons)]
    beyond = ([0.88, 0.1, 0.2], [0.1, 0.376, 0.2], [-1.13, 0.1, 0.2], [0.9, -0.3, 0.2])
    for q0 in beyond:
        answers[str(q0)] = refusal(lambda q0=q0: arm().simulate(q0, DQ0, 0.1, limits="stop"))
    return answers


@records.of
def events_of_functions():
    def low(t, q, dq):
        return q[0] - 0.27

    events = [
        low,
        Event(lambda t, q, dq: q[0] - 0.28, "down", direction="down"),
        Event(lambda t, q, dq: q[0] - 0.28, "never up", direction="up"),
        Event(lambda t, q, dq: t - 0.0123, "clock", direction="up"),
        Event(lambda t, q, dq: 0.045 - t, "bell", direction="both"),
        Event(lambda t, q, dq: dq[1] - 0.1, "slow"),
        Event(lambda t, q, dq: q[2] - 1.9, "zero at the start"),
        Event(lambda t, q, dq: np.sin(700 * t), "often"),
        Event(lambda t, q, dq: t - 0.02, "at a state"),
        Event(lambda t, q, dq: np.sign(t - 0.033), "a jump"),
    ]
    answers = {}
    for method in ("rk4", "semi_implicit", "dopri5"):
        answers[method] = brief(arm().simulate(Q0, DQ0, 0.06, 0.01, method=method, events=events))
        last = Event(lambda t, q, dq: q[2] - 1.94, "last", direction="up", terminal=True)
        answers[f"{method}, terminal"] = brief(
            arm().simulate(Q0, DQ0, 0.06, 0.01, method=method, events=[*events, last], limits="stop", every=2)
        )
    answers["one function"] = brief(arm().simulate(Q0, DQ0, 0.03, 0.01, method="rk4", events=low))
    answers["one event"] = brief(arm().simulate(Q0, DQ0, 0.03, 0.01, method="rk4", events=events[3]))
    return answers


@records.of
def contacts_that_begin_and_end():
    stops = JointStops(2e3, exponent=2.0, dissipation=0.8, joints="reach")
    both = JointStops(900.0, exponent=1.0)
    ground = Plane("tool", [0.02, 0.01, 0.03], (0.1, -0.2, 2.0), 0.5, 1.5e3, 1.5, 0.4, 0.6, 0.02)
    answers = {}
    for method in ("rk4", "dopri5", "semi_implicit"):
        for name, contacts, q0, dq0 in (
            ("reach at its lower stop", stops, (0.2, -0.24, 0.4), (0.1, -0.9, 0.2)),
            ("waist at its upper stop", both, (0.86, 0.1, 0.4), (1.3, 0.2, 0.2)),
            ("tool on the ground", ground, (-0.6, 0.1, 0.4), (-1.3, 0.2, 0.2)),
            ("all of them", [ground, stops, both], (0.86, -0.24, 0.4), (1.3, -0.5, 0.2)),
        ):
            found = arm().simulate(q0, dq0, 0.04, 0.005, method=method, contacts=contacts, every=4)
            answers[f"{name}, {method}"] = brief(found)
    answers["too deep"] = arm().simulate(Q0, DQ0, 0.01, 0.005, method="rk4", contacts=[ground, both]).remarks
    short = JointStops(1e4, exponent=1.0)
    answers["too short"] = (
        arm().simulate((0.86, 0.36, 0.4), (1.3, 0.8, 0.2), 0.1, 0.01, method="rk4", contacts=short).remarks
    )
    answers["stops of a range in degrees"] = brief(
        floater().simulate(
            floater().add(floating_start()[0], [0] * 9 + [0.8]), floating_start()[1], 0.02, 0.01, contacts=both
        )
    )
    return answers


@records.of
def gaps_and_torques_of_contacts():
    from twistwrench.simulation.contact import PlaneContact, StopContact

    q = np.array([Q0, (0.9, -0.3, 0.2), (-1.2, 0.4, -0.5)])
    dq = np.array([DQ0, (0.3, -0.2, 0.7), (-0.4, 0.6, 0.1)])
    plane = Plane("tool", [[0.01, 0.02, 0.05], [0.3, -0.4, -0.2]], (0.2, 0.3, 1.0), 0.9, 2e3, 1.25, 0.6, 0.7, 0.03)
    contacts = {
        "plane": PlaneContact(arm(), plane),
        "one point": PlaneContact(arm(), Plane("hand", height=0.8)),
        "stops": StopContact(arm(), JointStops(700.0, 1.5, 0.3)),
        "one stop": StopContact(arm(), JointStops(700.0, 2.0, 0.3, joints=("reach",))),
    }
    answers = {"plane": plane, "stops": JointStops(700.0, joints="reach")}
    for name, contact in contacts.items():
        answers[f"at {name}"] = [
            contact.gaps(q), [contact.gap(x) for x in q], contact.torques(q, dq), contact.torques(np.zeros(3), np.zeros(3)),
            contact.torques_and_depths(q, dq), contact.name, contact.size,
        ]  # fmt: skip
    deep = [contacts["plane"].remark_at_start(x) for x in [*q, np.array([-0.9, 0.2, 0.4])]]
    return answers | {"remarks": deep}


@records.of
def failures_of_steps_and_functions():
    def bad(at, value):
        return lambda t, q, dq: value if t >= at else [0.1, 0.2, 0.3]

    run = lambda **options: lambda: arm().simulate(Q0, DQ0, 0.06, 0.01, **options)  # noqa: E731
    answers = {}
    for method in ("rk4", "dopri5", "semi_implicit"):
        for name, value in {
            "not finite": [0.1, np.nan, 0.2], "of another shape": [0.1, 0.2], "texts": ["a", "b", "c"], "complex": [1j, 0, 0],
            "None": None,
        }.items():  # fmt: skip
            if name == "not finite" or method == "rk4":
                answers[f"tau {name}, {method}"] = failed(run(method=method, tau=bad(0.021, value)))
        answers[f"controller, {method}"] = failed(run(method=method, controller=bad(0.021, [np.inf, 0, 0])))
        answers[f"an error, {method}"] = failed(
            run(method=method, tau=lambda t, q, dq: [1, 2, 3][5 if t > 0.02 else slice(0, 3)])
        )
        answers[f"unstable, {method}"] = failed(
            run(method=method, controller=lambda t, q, dq: [0, 1e9 * dq[1], 3e10 * dq[2]])
        )
    wrench = {"tool": lambda t, q, dq: [0, 0, 0, 1, 2] if t > 0.03 else WRENCH}
    answers["wrench"] = failed(run(method="rk4", wrench_on_robot=wrench))
    for name, value in {"flag": True, "inf": np.inf, "two": [1.0, 2.0], "text": "x"}.items():
        event = Event(lambda t, q, dq, value=value: value if t > 0.02 else 1.0, "watch")
        answers[f"event {name}"] = failed(run(method="euler", events=event))
    answers["a force without bound"] = failed(run(tau=lambda t, q, dq: [0.0, 1e30 * np.tan(1e5 * t), 0.0]))
    return answers


@records.of
def what_simulate_refuses():
    ground = Plane("tool")
    calls = {
        "q0 short": {"q0": [1, 2]}, "q0 batch": {"q0": [[1, 2, 3]]}, "dq0 long": {"dq0": [1, 2, 3, 4]},
        "q0 nan": {"q0": [1, np.nan, 2]}, "ragged": {"q0": [[1], [2, 3], 4]}, "duration": {"duration": 0.0},
        "dt": {"dt": -0.1}, "too many": {"duration": 1e7, "dt": 1e-3}, "too many kept": {"duration": 3e5, "dt": 1e-3, "every": 2},
        "every": {"every": 0}, "every part": {"every": 1.5}, "method": {"method": "rk5"}, "method number": {"method": 4},
        "tau": {"tau": [1, 2]}, "tau of one": {"tau": lambda t: 0}, "tau class": {"tau": dict}, "tau inf": {"tau": [1, np.inf, 2]},
        "controller": {"controller": [1, 2, 3]}, "wrench": {"wrench_on_robot": [1, 2, 3]},
        "wrench frame": {"wrench_on_robot": {"nose": WRENCH}}, "wrench short": {"wrench_on_robot": {"tool": [1, 2, 3]}},
        "wrench function": {"wrench_on_robot": {"tool": lambda q: 0}}, "contacts": {"contacts": "ground"},
        "contacts number": {"contacts": 3}, "contacts list": {"contacts": [ground, "stops"]}, "limits": {"limits": "halt"},
        "limits flag": {"limits": True}, "events": {"events": 3}, "events text": {"events": "now"},
        "event": {"events": lambda t: t}, "rtol": {"rtol": 0}, "atol": {"atol": -1.0}, "max_step": {"max_step": 0.0},
        "max_step of rk4": {"max_step": 0.0005, "method": "rk4"}, "progress": {"progress": lambda: 0}, "friction": {"friction": 2},
        "creep": {"friction": True, "creep": 0.0}, "creep of an impulse": {"friction": True, "creep": 0.01, "method": "semi_implicit"},
        "frame of a plane": {"contacts": Plane("nose")}, "joint of stops": {"contacts": JointStops(9.0, joints=["nose"])},
        "joint without stops": {"contacts": JointStops(9.0, joints=["elbow"])},
    }  # fmt: skip
    answers = {name: refusal(lambda options=options: arm().simulate(**options)) for name, options in calls.items()}
    answers["coupled"] = refusal(lambda: coupled_arm().simulate(method="semi_implicit", friction=True))
    answers["nothing moves"] = refusal(lambda: tw.load(ARM, lock={"*": 0.1}).simulate())
    answers["zero quaternion"] = refusal(lambda: floater().simulate(np.zeros(12)))
    answers["limits of a robot without"] = refusal(
        lambda: tw.load(ARM, lock={"waist": 0.1, "reach": 0.1}).simulate([0.2], limits="stop")
    )
    answers["plane"] = {
        name: refusal(lambda options=options: Plane("tool", **options))
        for name, options in {
            "points": {"points": [1, 2]}, "no points": {"points": np.zeros((0, 3))}, "cube": {"points": np.zeros((2, 2, 3))},
            "normal": {"normal": (0, 0, 0)}, "height": {"height": np.nan}, "stiffness": {"stiffness": 0.0},
            "exponent": {"exponent": 0.99}, "exponent above": {"exponent": 5.01}, "dissipation": {"dissipation": -0.1},
            "friction": {"friction": -0.1}, "slip": {"slip": 0.0},
        }.items()
    }  # fmt: skip
    answers["allowed exponents"] = [Plane("tool", exponent=x).exponent for x in (1.0, 5.0)]
    answers["event arguments"] = [
        refusal(lambda: Event(pushes, 3)), refusal(lambda: Event(pushes, direction="left")), refusal(lambda: Event(4)),
        refusal(lambda: Event(lambda t, q: 0)), [getattr(Event(pushes), x) for x in ("name", "direction", "terminal")],
    ]  # fmt: skip
    return answers


@records.of
def answers_in_text_and_data():
    run = lambda **options: arm().simulate(Q0, DQ0, 0.03, 0.01, method="euler", **options)  # noqa: E731
    over = {
        "a passive fall": run(),
        "within limits": run(tau=[2.0, 3.0, 0.5]),
        "over one effort": run(tau=[9.5, 3.0, 0.5]),
        "over two efforts": run(tau=[-9.5, 31.0, 0.5]),
        "over all efforts": run(tau=[-9.5, 31.0, 9.5], friction=True),
        "over velocities": arm().simulate(Q0, [2.9, -1.6, 7.0], 0.03, 0.01, method="euler", tau=[0.1, 0.2, 0.3]),
        "over positions": arm().simulate([1.0, -0.4, 3.0], DQ0, 0.03, 0.01, method="euler", tau=[0.1, 0.2, 0.3]),
        "over all": arm().simulate([1.0, -0.4, 3.0], [2.9, -1.6, 7.0], 0.03, 0.01, method="euler", tau=[10.0, 40.0, -5.0]),
        "all, without torques": arm().simulate([1.0, -0.4, 3.0], [2.9, -1.6, 7.0], 0.03, 0.01, method="euler"),
        "stopped at a limit": arm().simulate([0.8, 0.1, 0.2], [1.9, 0.2, 0.1], 0.08, 0.01, limits="stop"),
        "stopped sliding": arm().simulate([0.1, -0.23, 0.2], [0.1, -0.8, 0.1], 0.08, 0.01, limits="stop"),
        "stopped by an event": run(events=Event(lambda t, q, dq: t - 0.025, "bell", terminal=True)),
        "many events": run(events=[Event(lambda t, q, dq, k=k: t - 0.002 * k, f"e{k}") for k in range(1, 26)]),
        "some events": run(events=[Event(lambda t, q, dq, k=k: t - 0.01 * k, f"e{k}") for k in range(1, 4)]),
        "drifting": arm().simulate(Q0, [0.5, 0.2, 40.0], 0.3, 0.1, method="euler"),
    }  # fmt: skip
    from dataclasses import replace

    from twistwrench.simulation.judgement import limits_passed, worst_moment

    answers = {}
    for name, found in over.items():
        degrees = replace(found, degrees=True)
        q, mark, title = worst_moment(found)
        if name in ("stopped at a limit", "many events", "over all"):
            answers[f"{name}, in text"] = [str(found).splitlines(), str(degrees).splitlines()]
        answers[name] = {
            "verdict": [found.verdict.word, found.verdict.reasons, degrees.verdict.reasons], "passed": [limits_passed(found), limits_passed(degrees)],
            "moment": [q, mark and [mark.joint, mark.label if hasattr(mark, "label") else str(mark)], title],
            "facts": found.facts(), "subject": found.subject, "driven": found.driven,
        }  # fmt: skip
    return answers


@records.of
def motions_and_files_of_results(folder):
    from twistwrench.simulation import SimulationResult

    found = arm().simulate(
        Q0, DQ0, 0.03, 0.01, method="rk4", tau=pushes, friction=True, wrench_on_robot={"tool": WRENCH},
        events=Event(lambda t, q, dq: t - 0.013, "bell"),
    )  # fmt: skip
    answers = {"motion": repr(found.motion)}
    for name, path in {
        "csv": found.to_csv(folder / "a.csv"),
        "degrees": found.to_csv(folder / "b.csv", degrees=True),
        "npz": found.to_npz(folder / "c.npz"),
    }.items():
        again = SimulationResult.load(path)
        answers[name] = [again.robot, again.coordinate_names, again.velocity_names, again.coordinate_units]
        content = whole(again)
        answers[name].append(content if name == "csv" else changed(content, answers["csv"][-1]))
        if name == "csv":
            answers["text"] = [str(again).splitlines(), repr(again), again.verdict.word]
        answers[f"{name}, again"] = [
            refusal(lambda again=again: again.motion), repr(again.with_robot(arm()).motion),
            refusal(lambda again=again: again.with_robot(floater())),
            refusal(lambda again=again: again.to_csv(folder / "d.csv", degrees=True)),
        ]  # fmt: skip
    text = (folder / "a.csv").read_text()
    answers["header"] = text.splitlines()[:3]
    answers["header in degrees"] = (folder / "b.csv").read_text().splitlines()[2:4]
    lines = text.splitlines(keepends=True)
    said = lines[1]
    broken = {
        "empty": "", "other": "a,b\n1,2\n", "no rows": "".join(lines[:3]), "cut": text[:-1], "cut row": text[:-30] + "\n",
        "columns": text.replace("waist.vel", "waist.speed"), "no json": text.replace("# {", "# ", 1),
        "a list": lines[0] + "# []\n" + "".join(lines[2:]),
    }  # fmt: skip
    for field, right, wrong in (
        ("robot", '"arm"', "3"), ("names", '"coordinate_names": [', '"coordinate_names": [4, '), ("steps", '"steps": 3', '"steps": 3.5'),
        ("steps flag", '"steps": 3', '"steps": true'), ("completed", '"completed": true', '"completed": 1'),
        ("dt", '"dt": ', '"dt": "x", "old": '), ("events", '"events": [', '"events": 3, "old": ['),
        ("event", '"name": "bell"', '"name": 7'), ("time", '"time": ', '"time": [1], "old": '),
        ("event q", '"q": [', '"q": [1.0, '), ("event dq", '"dq": [', '"dq": [1.0, '),
        ("error", '"error_estimate": [', '"error_estimate": [1.0, '), ("units", '"coordinate_units": [', '"coordinate_units": ["m", '),
        ("remarks", '"remarks": [', '"remarks": [3, '),
    ):  # fmt: skip
        assert right in said, field
        broken[field] = text.replace(right, wrong, 1)
    for name, content in broken.items():
        (folder / "x.csv").write_text(content)
        answers[f"broken: {name}"] = refusal(lambda: SimulationResult.load(folder / "x.csv"))
    older = (
        said.replace('"relative_error"', '"old_error"')
        .replace('"coordinate_units"', '"old_units"')
        .replace('"error_estimate"', '"old"')
    )
    (folder / "old.csv").write_text(lines[0] + older + "".join(lines[2:]))
    old = SimulationResult.load(folder / "old.csv")
    answers["older"] = [old.relative_error, old.coordinate_units, old.error_estimate]
    (folder / "crlf.csv").write_bytes(text.replace("\n", "\r\n").encode())
    answers["lines of DOS"] = SimulationResult.load(folder / "crlf.csv").q[-1]
    np.savez(folder / "y.npz", format=np.array("other"), q=np.zeros(3))
    answers["another archive"] = refusal(lambda: SimulationResult.load(folder / "y.npz"))
    answers["no file"] = refusal(lambda: SimulationResult.load(folder / "nothing.csv"))
    with np.load(folder / "c.npz") as archive:
        entries = dict(archive)
    for name in ("q", "dq", "tau", "momentum", "times", "work_friction", "kinetic_energy"):
        np.savez(folder / "z.npz", **entries | {name: entries[name][..., :-1]})
        answers[f"npz, {name}"] = refusal(lambda: SimulationResult.load(folder / "z.npz"))
    floating = floater().simulate(*floating_start(), 0.02, 0.01, method="rk4")
    again = SimulationResult.load(floating.to_csv(folder / "f.csv", degrees=True))
    answers["floating"] = [(folder / "f.csv").read_text().splitlines()[2:4], np.abs(again.q - floating.q).max() < 1e-12]
    return answers


@records.of
def batches_of_simulations():
    q0 = np.array([[Q0, (0.1, 0.2, 0.3), (-0.4, 0.05, 1.0)], [(0.5, -0.1, 0.7), (0.8, 0.1, 0.2), (0.0, 0.0, 0.1)]])
    shares = []
    batch = arm().simulate_batch(q0, DQ0, 0.05, 0.01, method="rk4", tau=[0.1, 9.0, 0.2], progress=shares.append)
    limited = arm().simulate_batch(q0, [1.9, 0.2, 0.1], 0.05, 0.01, limits="stop")
    failing = arm().simulate_batch(
        q0, DQ0, 0.05, 0.01, method="euler", tau=lambda t, q, dq: [0, np.nan if q[0] > 0.45 and t > 0.02 else 0, 1.0]
    )
    answers = {}
    for name, found in {"rk4": batch, "limits": limited, "failing": failing}.items():
        answers[name] = [
            found.completed,
            found.ends,
            found.shape,
            len(found),
            repr(found),
            brief(found[1, 0]),
            [x.q[-1] for x in found],
        ]
    answers["shares"] = shares
    single = arm().simulate_batch(Q0, DQ0, 0.02, 0.01, method="rk4")
    answers["one"] = [
        single.shape,
        repr(single),
        refusal(lambda: single[0]),
        refusal(lambda: batch[1]),
        brief(single[()]),
    ]
    answers["none"] = repr(arm().simulate_batch(np.zeros((0, 3)), duration=0.1))
    answers["refused"] = [
        refusal(lambda: arm().simulate_batch(q0, np.zeros((2, 2, 3)), 0.1)), refusal(lambda: arm().simulate_batch([[1, 2]])),
        refusal(lambda: arm().simulate_batch([(0.1, 0.1, 0.1), (0.9, 0.1, 0.1)], limits="stop")),
        refusal(lambda: arm().simulate_batch([(0.9, 0.1, 0.1), (0.1, 0.1, 0.1)], limits="stop")),
        refusal(lambda: arm().simulate_batch(q0, method="rk5")), refusal(lambda: arm().simulate_batch(q0, progress=3)),
        refusal(lambda: arm().simulate_batch(q0, dq0=[1, 2])),
    ]  # fmt: skip
    floating = floater().simulate_batch(
        duration=0.02, dt=0.01, dq0=np.outer([1.0, -0.5], floating_start()[1]), method="semi_implicit"
    )
    answers["floating"] = [repr(floating), [x.q[-1] for x in floating]]
    return answers


@records.of
def shares_of_progress():
    answers = {}
    for method in ("rk4", "dopri5"):
        shares = []
        arm().simulate(Q0, DQ0, 0.05, 0.012, method=method, progress=shares.append, tau=pushes)
        answers[method] = shares
    return answers


@records.of
def tableaus_and_their_orders():
    from twistwrench.simulation.compiled_steps import stages
    from twistwrench.simulation.methods import tableaus as kinds

    answers = {}
    known = (kinds.EULER, kinds.IMPLICIT_EULER, kinds.MIDPOINT, kinds.RK4, kinds.DORMAND_PRINCE)
    half = Fraction(1, 2)
    gauss = Tableau("trapezoid", 2, a=((0, 0), (half, half)), b=(half, half))
    for method in (*known, gauss):
        rows, b, c, error, dense = method.numbers
        flags = [method.explicit, method.first_same_as_last, method.symplectic]
        answers[method.name] = [[row.tolist() for row in rows], b, c, error, dense, flags]
    answers["stages"] = [stages(kinds.EULER), stages(kinds.RK4)]
    answers["trees"] = [
        [kinds.order(t), kinds.density(t), [str(x) for x in kinds.elementary_weights(t, kinds.RK4.a)]]
        for n in range(1, 5)
        for t in kinds.trees(n)
    ]
    answers["partitioned"] = kinds.SEMI_IMPLICIT_EULER.symplectic
    dense = {"dense": ((1, -half), (0, half)), "dense_order": 2}
    heun = {"a": ((0, 0), (1, 0)), "b": (half, half)}
    answers["refused"] = [
        refusal(lambda: Tableau("low", 1, **heun)), refusal(lambda: Tableau("high", 3, **heun)),
        refusal(lambda: Tableau("not square", 1, a=((0, 0),), b=(1,))), refusal(lambda: Tableau("b", 1, a=((0,),), b=(1, 0))),
        refusal(lambda: Tableau("embedded", 2, **heun, embedded=(1, 0), embedded_order=2)),
        refusal(lambda: Tableau("dense end", 2, **heun, dense=((1, -half), (0, 1)), dense_order=2)),
        refusal(lambda: Tableau("dense order", 2, **heun, dense=((half, 0), (0, half)), dense_order=2)),
        refusal(lambda: Partitioned("order", 2, kinds.EULER, kinds.IMPLICIT_EULER)),
        refusal(lambda: Partitioned("order", 1, kinds.MIDPOINT, kinds.MIDPOINT)),
    ]  # fmt: skip
    answers["accepted"] = [
        repr(Tableau("Heun", 2, **heun, embedded=(1, 0), embedded_order=1, **dense).c),
        Partitioned("o", 2, kinds.MIDPOINT, kinds.MIDPOINT).symplectic,
    ]
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
