"""Robots with closed loops and velocity constraints: complete answers on record."""

from __future__ import annotations

import pickle
import warnings
from functools import cache, partial

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


records = Records(__file__, listed=18)


def link_text(name, mass, com, moments):
    ixx, iyy, izz, ixy, ixz, iyz = moments
    return f"""<link name="{name}"><inertial><origin xyz="{com}" rpy="0.1 -0.2 0.3"/><mass value="{mass}"/><inertia ixx="{ixx}"
    iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial></link>"""


def joint_text(name, kind, parent, child, xyz, rpy="0 0 0", more=""):
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint>"""


PIN = '<axis xyz="0 -1 0"/><dynamics damping="{}" friction="{}"/>'
BARS = f"""<robot name="bars"><link name="frame"/>
{link_text("crank", 1.1, "0.14 0.02 0.03", (0.002, 0.012, 0.011, 0.0002, -0.0003, 0.0004))}
{link_text("coupler", 2.3, "0.37 -0.03 0.05", (0.019, 0.11, 0.12, 0.001, 0.002, -0.003))}
{link_text("rocker", 1.6, "0.27 0.04 -0.02", (0.016, 0.05, 0.06, -0.001, 0.0015, 0.002))}
{link_text("flag", 0.5, "0.06 0.05 0.11", (0.004, 0.005, 0.003, 0.0003, -0.0002, 0.0001))}
{link_text("tail", 0.3, "-0.05 0.02 0.04", (0.001, 0.002, 0.0015, 0.0001, 0.0002, -0.0001))}
<link name="coupler_pin"/><link name="rocker_pin"/>
{joint_text("a", "continuous", "frame", "crank", "0.02 0 0.05", more=PIN.format(0.4, 0.7))}
{joint_text("b", "continuous", "crank", "coupler", "0.3 0 0", more=PIN.format(0.2, 0.1))}
{joint_text("d", "continuous", "frame", "rocker", "0.72 0 -0.03", more=PIN.format(0.3, 0.5))}
{
    joint_text(
        "wave",
        "revolute",
        "coupler",
        "flag",
        "0.4 0.03 0.1",
        "0.3 -0.5 0.2",
        '<axis xyz="0.2 0.3 1"/><limit lower="-1.1" upper="1.4" velocity="3" effort="9"/><dynamics damping="0.05" friction="0.15"/>',
    )
}
{
    joint_text(
        "wag",
        "revolute",
        "rocker",
        "tail",
        "-0.1 0.02 0.03",
        "0.1 0.2 0.3",
        '<axis xyz="1 0.4 -0.3"/><mimic joint="d" multiplier="-0.6" offset="0.2"/><limit lower="-9" upper="9" velocity="3" effort="9"/>',
    )
}
{joint_text("to_coupler_pin", "fixed", "coupler", "coupler_pin", "0.8 0 0")}
{joint_text("to_rocker_pin", "fixed", "rocker", "rocker_pin", "0.6 0 0")}
</robot>"""
"""Crank and coupler on one pin of the frame, the rocker with a follower on the other, and a joint beside the loop."""

WALKER = f"""<robot name="walker">
{link_text("trunk", 5.5, "0.04 -0.02 0.07", (0.2, 0.3, 0.4, 0.01, -0.02, 0.03))}
{link_text("thigh", 1.2, "-0.03 0.05 -0.2", (0.03, 0.04, 0.02, 0.001, 0.002, -0.003))}
{link_text("shin", 0.8, "0.02 0.01 -0.15", (0.012, 0.013, 0.004, 0.0001, 0.0002, -0.0003))}
{link_text("pole", 0.6, "0.05 -0.01 0.2", (0.01, 0.011, 0.003, 0.0002, -0.0001, 0.0003))}
<link name="foot"/>
{
    joint_text(
        "hip",
        "revolute",
        "trunk",
        "thigh",
        "0.1 0.08 -0.1",
        "0.2 0.1 -0.3",
        '<axis xyz="0.3 1 0.1"/><limit lower="-1.4" upper="1.2" velocity="5" effort="60"/><dynamics damping="0.3" friction="0.6"/>',
    )
}
{
    joint_text(
        "knee",
        "revolute",
        "thigh",
        "shin",
        "0.02 0 -0.4",
        "0 0.1 0.2",
        '<axis xyz="-0.1 1 0.2"/><limit lower="-2.1" upper="0.3" velocity="6" effort="50"/>',
    )
}
{
    joint_text(
        "lift",
        "prismatic",
        "trunk",
        "pole",
        "-0.2 0.05 0.1",
        "0.1 -0.2 0.4",
        '<axis xyz="0.2 0.1 1"/><limit lower="-0.1" upper="0.5" velocity="1" effort="80"/><dynamics damping="4" friction="2"/>',
    )
}
{joint_text("ankle", "fixed", "shin", "foot", "0.03 -0.01 -0.35", "0.1 0.3 0.2")}
</robot>"""
"""A leg and a sliding pole on a floating trunk."""


def pose(*twist):
    return tw.se3.exp(np.array(twist, float))


@cache
def bars():
    return tw.load(BARS, gravity=(1.2, -0.8, -9.3))


@cache
def loop():
    return bars().close("coupler_pin", "rocker_pin", rows="vx vz")


@cache
def welded():
    """The same loop with all six rows, of which three say nothing new, and a second loop beside it."""
    return loop().close("rocker_pin", "coupler_pin", rows="wx wz vy vx vz", redundant="accept")


@cache
def walker():
    return tw.load(WALKER, floating_base=True, gravity=(0.5, -1.1, -9.4))


@cache
def standing():
    tilted = pose(0.2, -0.1, 0.3, 0.4, 0.1, -0.2)
    return walker().close("ground", "foot", rows="vx vy vz wz wx", pose=tilted)


@cache
def skating():
    return (
        walker()
        .constrain("foot", "vy")
        .constrain("pole", "vz wx", "world_aligned")
        .constrain("thigh", "vx", kind="space")
    )


@cache
def mixed():
    """A ball joint of the foot on the ground and a blade on the pole."""
    return walker().close("ground", "foot", "vx vy vz", pose=pose(0, 0, 0, 0.3, -0.2, 0.1)).constrain("pole", "vy")


@cache
def planted():
    return walker().close("ground", "foot", pose=pose(0.2, -0.1, 0.3, 0.4, 0.1, -0.2))


ROBOTS = {"loop": loop, "planted": planted, "welded": welded, "standing": standing, "skating": skating, "mixed": mixed}


@cache
def states(label):
    """Two states that satisfy the constraints, with no velocity equal to another."""
    robot = ROBOTS[label]()
    rng = np.random.default_rng(4)
    if label in ("loop", "welded"):
        starts = np.array([[0.9, -0.4, 0.3, 1.5], [1.6, -1.1, -0.7, 1.9]])
    else:
        starts = walker().random_configuration(rng, (2,))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        q = robot.consistent(starts, within=9.0)
    dq = robot.project_velocity(q, rng.uniform(-1.3, 1.5, (2, robot.nv)))
    ddq = robot.project_acceleration(q, dq, rng.uniform(-2.3, 2.5, (2, robot.nv)))
    return q, dq, ddq


def warned(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    return {"result": result, "warnings": [f"{w.category.__name__}: {w.message}" for w in caught]}


def refused_or_done(call):
    try:
        return call()
    except tw.TwistWrenchError as error:
        return f"{type(error).__name__}: {error}"


def base_joint():
    return walker().joint_names[0]


@records.of
def constrained_robots():
    found = {}
    for label, build in ROBOTS.items():
        robot = build()
        q, dq, _ = states(label)
        found[label] = {
            "repr": repr(robot),
            "rows": robot.row_names,
            "dependent": robot.redundant_rows,
            "independent": robot.independent,
            "sizes": robot.sizes,
            "spans": robot.spans,
            "constraints": robot.constraints,
            "q": q,
            "dq": dq,
            "A": robot.constraint_jacobian(q),
            "b": robot.constraint_bias(q, dq[0]),
            "rank": robot.rank(q),
            "freedoms": robot.degrees_of_freedom(q[0]),
            "P": robot.projector(q[1]),
            "error": robot.constraint_error(q + 0.01),
            "again": repr(pickle.loads(pickle.dumps(robot))),
            "pickled sizes": pickle.loads(pickle.dumps(robot)).sizes,
            "open": repr(robot.open()),
        }
    return found


@records.of
def projections_of_motions_and_torques():
    found = {}
    for label, build in ROBOTS.items():
        robot = build()
        q, dq, ddq = states(label)
        n = np.arange(robot.nv)
        parts = robot.split(q, 3.0 * np.cos(n))
        single = robot.split(q[0].astype(np.float32), np.cos(n).astype(np.float32))
        found[label] = {
            "split": parts,
            "velocity": robot.project_velocity(q, np.sin(1.0 + n)),
            "acceleration": robot.project_acceleration(q, dq, np.cos(2.0 * n)),
            "ddq": ddq,
            "wrenches": robot.wrenches(np.arange(1.0, 1.0 + len(robot.sizes))),
            "wrenches of many": robot.wrenches(np.linspace(-1, 2, 2 * len(robot.sizes)).reshape(2, -1)),
            "kinds": [str(single.motion.dtype), str(robot.projector(q[0].astype(np.float32)).dtype)],
        }
    return found


@records.of
def dynamics_with_constraint_forces():
    found = {}
    for label, build in ROBOTS.items():
        robot = build()
        q, dq, _ = states(label)
        tau = 4.0 * np.sin(2.0 + np.arange(robot.nv))
        frames = ("coupler", "tail") if label in ("loop", "welded") else ("shin", "pole")
        by, on = {frames[0]: [1, -2, 3, 4, 5, 6]}, {frames[1]: [[0.5, 1, 2, -3, 2, 1], [0.3, -1, 0.7, 2, 5, -3]]}
        found[label] = {
            "plain": robot.forward_dynamics(q, dq, tau),
            "friction": robot.forward_dynamics(q, dq, 3.0 * tau, friction=True),
            "friction of one": robot.forward_dynamics(q[0], dq[0], 3.0 * tau, friction=True),
            "wrenches": robot.forward_dynamics(q, dq, tau, wrench_by_robot=by, wrench_on_robot=on),
            "wrenches and friction": robot.forward_dynamics(
                q, dq, tau, wrench_by_robot=by, wrench_on_robot=on, friction=True
            ),
            "single": [
                str(x.dtype)
                for x in robot.forward_dynamics(*(x[0].astype(np.float32) for x in (q, dq)), tau.astype(np.float32))
            ],
        }
    return found


@records.of(relative=1e-6)
def torques_of_motors_in_loops():
    found = {}
    for label, build in ROBOTS.items():
        robot = build()
        q, dq, ddq = states(label)
        still = np.zeros(robot.nv)
        base = base_joint()
        frames = ("coupler", "tail") if label in ("loop", "welded") else ("shin", "pole")
        by, on = {frames[0]: [1, -2, 3, 4, 5, 6]}, {frames[1]: [[0.5, 1, 2, -3, 2, 1], [0.3, -1, 0.7, 2, 5, -3]]}
        if label in ("loop", "welded"):
            motor_sets = {
                "two": ["a", "wave"],
                "other two": ["wave", "b"],
                "three": ["a", "d", "wave"],
                "all": None,
                "follower": None,
            }
        else:
            motor_sets = {"all": [base, "hip", "knee", "lift"]}
        table = {}
        for name, actuated in motor_sets.items():
            table[name] = robot.inverse_dynamics(q, dq, ddq, actuated)
            table[f"{name}, holding"] = robot.holding_torques(q, actuated, wrench_by_robot=by, wrench_on_robot=on)
            table[f"{name}, friction"] = robot.inverse_dynamics(
                q, dq, ddq, actuated, wrench_by_robot=by, wrench_on_robot=on, friction=True
            )
        first = next(iter(motor_sets.values()))
        table["carried"] = robot.joint_wrenches(q, dq, ddq, first, wrench_by_robot=by, wrench_on_robot=on)
        table["carried at rest"] = robot.joint_wrenches(q[0], still, still, first)
        why = robot.explain(q[0], dq[0], ddq[0], first, wrench_by_robot=by, friction=True)
        table["explained"] = [str(why).splitlines(), why.parts]
        found[label] = table
    return found


@records.of(relative=1e-6)
def slopes_of_motor_torques():
    found = {}
    base = base_joint()
    choices = {
        "loop": (["a", "wave"], ["wave", "d"]),
        "welded": (["b", "wave"],),
        "mixed": (["hip", "knee", base],),
        "standing": (["hip", "knee", "lift"],),
        "planted": (["hip", "knee", "lift"],),
    }
    for label, sets in choices.items():
        robot = ROBOTS[label]()
        q, dq, ddq = states(label)
        for actuated in sets:
            frame = "coupler" if label in ("loop", "welded") else "shin"
            wrenches = {"wrench_by_robot": {frame: [1, -2, 3, 4, 5, 6]}}
            slopes = partial(robot.inverse_dynamics_derivatives, q, dq, ddq, actuated, **wrenches)
            found[f"{label} {actuated}"] = refused_or_done(slopes)
    return found


@records.of
def closed_robots_of_no_independent_rows():
    """A constraint that nothing can break: its rows are never independent."""
    held = bars().constrain("coupler", "vy", "space", redundant="accept")
    q, dq, ddq = [0.4, -0.2, 0.3, 1.1], [0.5, 0.7, 0.2, -0.9], [1.0, -0.5, 0.75, 0.25]
    return {
        "repr": repr(held),
        "dependent": held.redundant_rows,
        "forward": held.forward_dynamics(q, dq, ddq, friction=True),
        "inverse": held.inverse_dynamics(q, dq, ddq),
        "slopes": held.inverse_dynamics_derivatives([q, q], dq, ddq),
        "error": held.constraint_error(q),
        "settled": held.settled(np.array([q]), 1e-12),
        "refused": refusal(lambda: bars().constrain("coupler", "vy", "space")),
    }


@records.of
def kernels_of_closed_robots():
    robot = loop()
    q, dq, _ = states("loop")
    tau = [1.0, -2.0, 0.5, 0.25]
    with np.errstate(all="ignore"):
        dynamics = robot.kernel("constrained_dynamics")(q, dq, tau)
        pair = robot.kernel("constraint_jacobian", "mass_matrix")(q)
    rows = welded().kernel("constraint_jacobian")(states("welded")[0])
    return {
        "dynamics": dynamics,
        "pair": pair,
        "rows": rows,
        "mixed": mixed().kernel("closure_poses", "constraint_bias")(*states("mixed")[:2]),
        "reference": robot.reference("constraint_bias", q[0], dq[0]),
        "program": [port.name for port in robot.program("constrained_dynamics").inputs],
        "other": robot.kernel("kinetic_energy")(q, dq),
        "by": robot.kernel("constraint_jacobian", by="q")(q[1]),
        "open constraints": bars().kernel("constraint_jacobian", constraints=mixed_constraints())(q[0]),
        "refused": {
            "changed": refusal(lambda: robot.kernel("inverse_dynamics")),
            "changed of two": refusal(lambda: robot.kernel("mass_matrix", "task_inertia", "forward_dynamics")),
            "reference": refusal(lambda: robot.reference("holding_torques", q[0])),
            "out": refusal(lambda: robot.inverse_dynamics(q[0], dq[0], dq[0], out=np.zeros(4))),
            "task": refusal(lambda: robot.task_inertia(q[0], "flag", rows="vx")),
            "lost": refusal(lambda: robot.lost_directions(q[0], "flag", rows="vx")),
            "closed form": refusal(lambda: robot.closed_form(q[0], dq[0])),
            "slopes": refusal(lambda: robot.forward_dynamics_derivatives(q[0], dq[0], tau)),
            "regressor": refusal(lambda: robot.regressor(q[0], dq[0], tau)),
            "lock": refusal(lambda: robot.lock({"a": 1.0})),
            "payload": refusal(lambda: robot.with_payload(tw.SpatialInertia.from_com(1.0))),
            "urdf": refusal(lambda: robot.to_urdf()),
            "drives": refusal(lambda: robot.drive_torques(q[0], dq[0], tau)),
        },
        "with": [robot.kernel("constrained_dynamics", "mass_matrix").signature, robot.mass_matrix(q[0])],
    }


def mixed_constraints():
    from twistwrench.mechanics.algorithms.constraints import Rolling

    return (*loop().constraints, Rolling("flag", (1, 5), "world_aligned"))


@records.of
def motors_and_power_of_closed_robots():
    drives = {
        "actuators": {
            "a": {
                "ratio": 60,
                "efficiency": 0.8,
                "no_load_torque": "0.02 N m",
                "rotor": {"inertia": "110 g cm^2"},
                "motor": {"torque_constant": "0.1 N m/A", "resistance": "0.5 ohm"},
                "friction": {"viscous": "0.3 N m s/rad", "coulomb": "0.8 N m"},
            },
            "wave": {
                "ratio": -35,
                "efficiency": 0.7,
                "rotor": {"inertia": "30 g cm^2"},
                "motor": {"torque_constant": "0.06 N m/A", "resistance": "0.8 ohm"},
            },
        }
    }
    robot = bars().with_actuators(drives).close("coupler_pin", "rocker_pin", rows="vx vz")
    q, dq, _ = states("loop")
    ddq = robot.project_acceleration(q, dq, [[0.5, -1.0, 2.0, 0.7], [1.5, 0.3, -0.4, 0.9]])
    F = {"flag": [0.1, 0.2, -0.3, 4.0, 5.0, -6.0]}
    tau = [9.0, 2.0, -3.0, 1.5]
    return {
        "default motors": robot.inverse_dynamics(q, dq, ddq),
        "loads": robot.motor_loads(q, dq, ddq),
        "loads with friction": robot.motor_loads(q, dq, ddq, friction=True, wrench_by_robot=F),
        "power": robot.power_balance(q, dq, tau),
        "power with friction": robot.power_balance(q, dq, tau, friction=True, wrench_by_robot=F),
        "power of wrenches": robot.power_balance(q[0], dq[0], tau, wrench_on_robot=F),
    }


MOTOR_FILE = """<mujoco model="geared"><worldbody><body name="u"><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.2 0.15"/>
  <joint name="j1" axis="0 1 0"/><body name="v" pos="0.3 0 0"><inertial pos="0.1 0.05 0" mass="1.2" diaginertia="0.1 0.12 0.15"/>
  <joint name="j2" axis="0 1 0"/><body name="w" pos="0.4 0 0"><inertial pos="0 0.1 0.05" mass="0.7" diaginertia="0.1 0.12 0.15"/>
  <joint name="j3" axis="0 1 0"/><body name="x" pos="0.2 0 0"><inertial pos="0 0.1 0.05" mass="0.4" diaginertia="0.05 0.03 0.04"/>
  <joint name="j4" axis="1 0 0"/></body></body></body></body></worldbody>
  <equality><joint joint1="j4" joint2="j3" polycoef="0 0.5 0 0 0"/></equality>
  <actuator><motor joint="j1"/><motor joint="j4"/></actuator></mujoco>"""

PLANAR_BASE = f"""<robot name="cart"><link name="ground"/>
{link_text("hull", 5.5, "0.04 -0.02 0.07", (0.2, 0.3, 0.4, 0.01, -0.02, 0.03))}
{link_text("mast", 1.2, "-0.03 0.05 0.3", (0.03, 0.04, 0.02, 0.001, 0.002, -0.003))}
{joint_text("plane", "planar", "ground", "hull", "0.2 0.1 0.05", "0 0 0", '<axis xyz="0 0 1"/>')}
{joint_text("lean", "revolute", "hull", "mast", "-0.1 0.04 0.2", "0.5 -0.1 0.2", '<axis xyz="1 0.3 0.2"/><limit lower="-0.6" upper="0.8" velocity="2" effort="20"/>')}
</robot>"""


@records.of
def motors_that_are_named_or_assumed():
    from twistwrench.robot.constraints import drives

    geared, cart = tw.load(MOTOR_FILE), tw.load(PLANAR_BASE)
    robots = {"bars": bars(), "walker": walker(), "geared": geared, "cart": cart}
    actuated = bars().with_actuators({"actuators": {"d": {"ratio": 3}}})
    found = {
        name: [drives.motor_joints(robot), drives.named_motors(robot), drives.motor_mask(robot, None)]
        for name, robot in robots.items()
    }
    found["file of actuators"] = [drives.motor_joints(actuated), drives.named_motors(actuated)]
    found["both"] = drives.motor_joints(geared.with_actuators({"actuators": {"j2": {"ratio": 3}}}))
    found["masks"] = [
        drives.motor_mask(bars(), "b"),
        drives.motor_mask(walker(), [base_joint(), "lift"]),
        drives.motor_mask(bars(), ()),
        refusal(lambda: drives.motor_mask(bars(), ["wag"])),
    ]
    return found


@records.of
def motions_that_motors_cannot_make():
    found = {}
    q, dq, ddq = states("loop")
    robot = loop()
    found["loop"] = {
        "one motor": refusal(lambda: robot.inverse_dynamics(q, dq, ddq, ["a"])),
        "no motor": refusal(lambda: robot.holding_torques(q[0], ())),
        "text": refusal(lambda: robot.holding_torques(q[0], "wave")),
        "slopes of one": refusal(lambda: robot.inverse_dynamics_derivatives(q, dq, ddq, "a")),
        "slopes of three": refusal(lambda: robot.inverse_dynamics_derivatives(q, dq, ddq, ["a", "b", "wave"])),
        "slopes of none": refusal(lambda: robot.inverse_dynamics_derivatives(q, dq, ddq, ())),
        "wrong choice": refusal(lambda: robot.inverse_dynamics_derivatives(q, dq, ddq, ["a", "d"])),
        "not finite": refusal(
            lambda: robot.inverse_dynamics(q[0], dq[0], ddq[0], ["a", "wave"], wrench_by_robot={"flag": [np.nan] * 6})
        ),
        "joint": refusal(lambda: robot.inverse_dynamics(q, dq, ddq, ["a", "waev"])),
    }
    for label in ("standing", "skating", "mixed"):
        robot = ROBOTS[label]()
        q, dq, ddq = states(label)
        found[label] = [
            refused_or_done(lambda: robot.inverse_dynamics(q, dq, ddq)),  # noqa: B023
            refused_or_done(lambda: robot.holding_torques(q[1], ["knee"])),  # noqa: B023
        ]
    return found


@records.of
def states_that_break_constraints():
    robot = loop()
    q, dq, ddq = states("loop")
    off = q[0] + np.array([0.0, 0.0, 0.0, 0.05])
    tau = np.zeros(4)
    gaps = [0.0001, 0.004, 0.006, 0.015, 0.03]
    rates = [0.01, 0.05, 0.09, 0.11, 0.2, 0.5]
    return {
        "gap": {
            d: refused_or_done(lambda d=d: robot.forward_dynamics(q[0] + [0, 0, 0, d], 0 * tau, tau).ddq) for d in gaps
        },
        "gap of many": refusal(lambda: robot.forward_dynamics([q[0], off], 0 * tau, tau)),
        "velocity": {
            d: refused_or_done(lambda d=d: robot.forward_dynamics(q[0], dq[0] + [0, 0, 0, d], tau).ddq) for d in rates
        },
        "acceleration": {
            d: refused_or_done(
                lambda d=d: robot.inverse_dynamics(q[0], dq[0], ddq[0] + [0, 0, 0, 10 * d], ["a", "wave"]).tau
            )
            for d in rates
        },
        "of many": refusal(
            lambda: robot.inverse_dynamics([q, q], dq, [ddq, ddq + np.array([0, 0, 0, 9])], ["a", "wave"])
        ),
        "slow": {
            v: refused_or_done(lambda v=v: robot.forward_dynamics(q[0], [0, 0, 0, v], tau).ddq)
            for v in (1e-6, 3e-5, 2e-4, 1e-3, 1e-2)
        },
        "walker": {
            d: refused_or_done(
                lambda d=d: mixed().forward_dynamics(states("mixed")[0][0], d + states("mixed")[1][0], np.zeros(9)).lam
            )
            for d in (0.001, 0.02, 0.08, 0.4)
        },
        "turned": {
            d: refused_or_done(lambda d=d: standing().forward_dynamics(turned(d), np.zeros(9), np.zeros(9)).lam)
            for d in (0.002, 0.008, 0.012, 0.05)
        },
    }


def turned(angle):
    q = states("standing")[0][0]
    return walker().add(q, angle * np.array([0.1, 0.2, -1.0, 0, 0, 0, 0.1, 0.0, 0.0]))


@records.of(relative=1e-5)
def closed_configurations():
    robot = loop()
    far = np.array([[0.9, 0.4, 0.3, 0.5], [1.6, -0.1, -0.7, 1.2]])
    near = states("loop")[0] + 0.02
    never = tw.robots.planar_2r().close
    return {
        "near": warned(lambda: robot.consistent(near)),
        "far": warned(lambda: robot.consistent(far)),
        "one far": warned(lambda: robot.consistent(far[1])),
        "within": warned(lambda: robot.consistent(far, within=5.0)),
        "loose": abs(robot.constraint_error(robot.consistent(near, 1e-3))) < 1e-3,
        "single": str(robot.consistent(near[0].astype(np.float32)).dtype),
        "settled": robot.settled(near, 1e-12)[0],
        "standing": standing().consistent(states("standing")[0][0] + 0.001),
        "mixed gap": mixed().constraint_error(states("mixed")[0] + 0.01),
        "gaps": welded().gaps(states("welded")[0] + [0.01, 0.02, 0.0, 0.03]),
        "none": bars().consistent([0.1, 0.2, 0.3, 0.4]),
        "refused": {
            "out of reach": refusal(lambda: never("ground", "tip", "vx vz", pose=pose(0, 0, 0, 3.0, 0, 0.4))),
            "no closed one": refusal(lambda: unreachable().consistent([0.1, 0.2])),
            "no closed one of many": refusal(lambda: unreachable().consistent([[0.1, 0.2], [0.3, 0.5]])),
            "tolerance": refusal(lambda: robot.consistent(near, 0.0)),
            "tolerance nan": refusal(lambda: robot.consistent(near, np.nan)),
            "within": refusal(lambda: robot.consistent(near, within=-0.1)),
            "q": refusal(lambda: robot.consistent([1.0, 2.0])),
            "not finite": refusal(lambda: robot.constraint_jacobian([1.0, 2.0, np.inf, 0.0])),
            "broadcast": refusal(lambda: robot.split(near, np.zeros((3, 4)))),
            "lam": refusal(lambda: robot.wrenches([1.0, 2.0, 3.0])),
            "lam not finite": refusal(lambda: robot.wrenches([1.0, np.nan])),
        },
    }


@cache
def unreachable():
    """A hand that must be where no start of 0.1 and 0.2 rad gets it within the search's steps: out of reach but for one pose."""
    arm = tw.load(BARS, gravity=(0, 0, -9.0)).lock({"d": 1.1, "wave": 0.2})
    closed = arm.close("ground", "coupler_pin", "vx vz", pose=pose(0, 0, 0, 1.12 - 1e-9, 0, 0.05), near=[0.0, 0.0])
    from dataclasses import replace

    moved = tuple(replace(c, pose=tuple(map(tuple, pose(0, 0, 0, 1.3, 0, 0.05).tolist()))) for c in closed.constraints)
    far = type(closed).__new__(type(closed))
    far._constrain(closed.open(), moved, closed.sizes.copy(), closed.spans.copy(), closed.independent)
    return far


@records.of
def constraints_refused():
    robot = bars()
    return {
        "frame": refusal(lambda: robot.close("frame", "pin")),
        "first frame": refusal(lambda: robot.close("pin", "coupler_pin")),
        "one body": refusal(lambda: robot.close("coupler", "coupler_pin")),
        "base twice": refusal(lambda: robot.close("ground", "frame")),
        "rows": refusal(lambda: robot.close("coupler_pin", "rocker_pin", rows="vx vq")),
        "pose": refusal(lambda: robot.close("coupler_pin", "rocker_pin", pose=np.eye(3))),
        "poses": refusal(lambda: robot.close("coupler_pin", "rocker_pin", pose=[np.eye(4)] * 2)),
        "scaled pose": refusal(lambda: robot.close("coupler_pin", "rocker_pin", pose=2.0 * np.eye(4))),
        "redundant": refusal(lambda: robot.close("coupler_pin", "rocker_pin", redundant="yes")),
        "follows": refusal(lambda: robot.close("coupler_pin", "rocker_pin", "vx vy vz")),
        "only old": refusal(lambda: loop().close("coupler_pin", "rocker_pin", "vx")),
        "still": refusal(lambda: robot.close("coupler_pin", "rocker_pin", "vy wx")),
        "near": refusal(lambda: robot.close("coupler_pin", "rocker_pin", "vx vz", near=[1.0])),
        "angle": refusal(lambda: tw.load(WALKER).close("ground", "foot", "wy")),
        "one angle": refusal(lambda: tw.load(WALKER).close("trunk", "foot", "vx wz")),
        "hinge": repr(walker().close("ground", "foot", "wx wy")),
        "plane angle": repr(robot.close("ground", "coupler_pin", "wy vz", near=[0.3, 0.2, 0.1, 0.0])),
        "rolling kind": refusal(lambda: robot.constrain("coupler", "vx", "tool")),
        "rolling base": refusal(lambda: robot.constrain("frame", "vx")),
        "rolling frame": refusal(lambda: robot.constrain("couple", "vx")),
        "rolling twice": refusal(lambda: robot.constrain("coupler", "vx").constrain("coupler", "vx vz")),
        "no tip": refusal(lambda: robot.constrain(None, "vx")),
        "tip": repr(tw.load(WALKER).chain(tip="foot").constrain(None, "vx")),
        "tip closed": repr(tw.load(WALKER).chain(tip="foot").close("ground", None, "vx")),
        "coupled": refusal(lambda: coupled().close("coupler_pin", "rocker_pin", "vx vz")),
        "coupled rolling": refusal(lambda: coupled().constrain("coupler", "vx")),
        "massless": refusal(lambda: massless().close("ground", "c", "vx")),
    }


def coupled():
    pair = {"motors": ["m1", "m2"], "joints": ["a", "b"], "motor_per_joint": [[1, 0.5], [-0.5, 1]]}
    return bars().with_actuators({"couplings": {"p": pair}, "actuators": {"m1": {"ratio": 3}, "m2": {"ratio": 4}}})


def massless():
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    joints = joint_text("j1", "continuous", "a", "b", "1 2 3") + joint_text("j2", "continuous", "b", "c", "0.1 0.2 0.3")
    return tw.load(f'<robot name="ghost">{links}{joints}</robot>')


@records.of(relative=1e-5)
def singular_configurations_of_loops():
    """A parallelogram laid flat, where one row is lost."""
    flat = tw.load(
        BARS.replace("0.72 0 -0.03", "0.82 0 0.05").replace('<origin xyz="0.6 0 0"', '<origin xyz="0.3 0 0"'),
        gravity=(1.2, -0.8, -9.3),
    )
    robot = flat.close("coupler_pin", "rocker_pin", "vx vz", near=[1.0, -1.0, 0.0, 1.0])
    q = np.array([[0.0, 0.0, 0.3, 0.0], [1.0, -1.0, 0.2, 1.0]])
    dq = robot.project_velocity(q, [[0.5, 0.1, 0.4, 0.3], [0.7, 0.2, 0.1, -0.5]])
    tau = [1.0, 2.0, -0.5, 0.25]
    F = {"flag": [1.0, 2.0, 3.0, 4.0, -5.0, 6.0]}
    both = flat.close("coupler_pin", "rocker_pin", "vx vy vz", near=[1.0, -1.0, 0.0, 1.0], redundant="accept")
    return {
        "ranks": [robot.rank(q), robot.degrees_of_freedom(q)],
        "forward": warned(lambda: robot.forward_dynamics(q, dq, tau)),
        "one": warned(lambda: robot.forward_dynamics(q[0], 0 * dq[0], tau, wrench_by_robot=F)),
        "with dependent rows": warned(lambda: both.forward_dynamics(q, dq, tau, friction=True)),
        "inverse": warned(lambda: robot.inverse_dynamics(q, 0 * dq, 0 * dq, ["a", "b", "d", "wave"])),
        "near the limit": [robot.rank([[e, -e, 0.1, e] for e in (1e-9, 1e-4, 1e-2)])],
        "slopes": refusal(lambda: robot.inverse_dynamics_derivatives(q[0], 0 * dq[0], 0 * dq[0], ["a", "wave"])),
    }


@records.of
def sizes_and_tolerances_of_constraints():
    from twistwrench.mechanics.algorithms.constraints import Closure, Rolling
    from twistwrench.robot.constraints import states as state_checks
    from twistwrench.robot.constraints import tolerances

    long_arm = tw.load(WALKER.replace("0.02 0 -0.4", "0.02 0 -4"))
    huge = tw.load(WALKER.replace("0.02 0 -0.4", "0.02 0 -400"))
    stone = tw.load('<robot name="stone"><link name="a"/></robot>')
    endless = tw.load(
        WALKER.replace('lower="-0.1" upper="0.5"', 'lower="-1e30" upper="0.5"').replace('velocity="1"', 'velocity="2"')
    )
    followed = tw.load(PLANAR_BASE)
    robots = {
        "bars": bars(),
        "walker": walker(),
        "long": long_arm,
        "huge": huge,
        "cart": followed,
        "fixed walker": tw.load(WALKER),
        "endless": endless,
    }
    lengths = {
        name: [tolerances.robot_length(r.model), tolerances._whole_length(r.model), tolerances.gap_length(r.model)]
        for name, r in {**robots, "stone": stone}.items()
    }
    closure = Closure("ground", "foot", (5, 0, 3), tuple(map(tuple, np.eye(4).tolist())))
    return {
        "lengths": lengths,
        "sizes": {
            name: tolerances.six_sizes(r, Rolling("shin", (1,), "body"))
            for name, r in robots.items()
            if name not in ("bars", "cart")
        },
        "rows": tolerances.row_sizes(standing(), closure),
        "rows of a hand": tolerances.row_sizes(walker(), Rolling("pole", (4, 2), "space")),
        "units": [tolerances.gap_units(ROBOTS[name]()) for name in ROBOTS],
        "rates": [tolerances.rate_units(ROBOTS[name]()) for name in ROBOTS] + [tolerances.rate_units(huge)],
        "texts": [state_checks.gap_unit_text(r) for r in (bars(), long_arm, huge)],
        "places": [
            state_checks.place_in_batch(5, (2, 3)),
            state_checks.place_in_batch(1, (4,)),
            state_checks.place_in_batch(0, ()),
        ],
        "joints": [
            state_checks.joints(walker(), [True] + [False] * 6 + [True, False]),
            state_checks.joints(bars(), [False, True, False, True]),
        ],
        "all rows": tolerances.all_rows(closure).rows,
    }


@records.of(relative=1e-5)
def searches_over_closed_loops():
    """Solver of loops inside inverse kinematics: rows, starts inside limits, and poses reached or not."""
    robot = loop()
    solver = robot._searched_loops()
    q = states("loop")[0]

    def inside(q):
        return np.clip(q, [-0.2, -2.0, -1.1, -9.0], [1.7, 2.0, 1.4, 9.0])

    starts = np.array([[1.2, -0.5, 0.4, 1.6], [3.5, -0.3, 0.1, 0.8], [0.9, -0.2, 1.4, 1.1]])
    T = robot.forward_kinematics(q[0] + [0, 0, 0.3, 0], "flag")
    reached = robot.inverse_kinematics(T, "flag", q[1], rows="vx vz wy")
    away = T.copy()
    away[:3, 3] += [0.3, 0.0, 2.0]
    failed = robot.inverse_kinematics(away, "flag", q[1], rows="vx vz", restarts=3)
    both = robot.inverse_kinematics([T, away], "flag", q[1], rows="vx vz", restarts=2)
    return {
        "rows": [solver.kinds, solver.allowed, solver.units, solver.rows.indices, solver.key],
        "welded": [welded()._searched_loops().kinds, welded()._searched_loops().allowed],
        "closed": solver.close(np.array([q[0] + 0.02, q[0] + 0.01])),
        "starts": solver.closed_starts(starts, inside),
        "gaps": solver.search_gaps(q + np.array([0.01, 0.0, 0.0, 0.02])),
        "start": solver.start,
        "same": robot._searched_loops() is solver,
        "reached": [str(reached), reached.converged, reached.gap < 1e-9, reached.rows, reached.joint_names, reached.q],
        "failed": [failed.converged, failed.starts, failed.distance, failed.gap < 1e-6],
        "both": [str(both), both.converged, both.gap < 1e-6],
        "no q0": robot.inverse_kinematics(T, "flag", rows="vx vz").converged,
        "refused": refusal(lambda: robot.inverse_kinematics_branches(T, "flag")),
        "nothing near": refusal(
            lambda: unreachable().inverse_kinematics(np.eye(4), "coupler_pin", rows="vx", restarts=0)
        ),
    }


@records.of
def wrenches_of_constraints_on_links():
    from twistwrench.robot.constraints.projections import link_wrenches

    found = {}
    for label, build in ROBOTS.items():
        robot = build()
        q = states(label)[0]
        lam = np.linspace(-2.0, 3.0, 2 * len(robot.sizes)).reshape(2, -1)
        found[label] = [[frame, F] for frame, F in link_wrenches(robot, q, lam)]
    turned_pose = pose(0.3, -0.2, 0.5, 0.01, 0.02, -0.03)
    offset = bars().close("coupler", "rocker_pin", "vx vz", pose=pose(0, 0, 0, 0.8, 0, 0) @ pose(0, 0.4, 0, 0, 0, 0))
    q = offset.consistent([0.9, -0.4, 0.3, 1.5])
    found["offset"] = [[frame, F] for frame, F in link_wrenches(offset, q, np.array([3.0, -2.0]))]
    found["offset torques"] = offset.joint_wrenches(q, np.zeros(4), np.zeros(4), ["a", "wave"])
    held = walker().close("foot", "ground", "vx vy vz", pose=turned_pose)
    q = held.consistent(states("standing")[0][0], within=9.0)
    found["base second"] = [[frame, F] for frame, F in link_wrenches(held, q, np.array([3.0, -2.0, 1.0]))]
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
