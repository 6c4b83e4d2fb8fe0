"""Quantities of robots of all kinds of joint, their options, derivatives, explanations and refusals: complete answers on record."""

from __future__ import annotations

import pickle
import warnings
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.mechanics.lie.twist_wrench import Wrench
from twistwrench.robot.quantities import QUANTITIES, other_name_hint, other_names

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


records = Records(__file__, listed=18)

CRANE = """<mujoco model="crane">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0.9 -1.7 -9.2"/>
  <worldbody>
    <site name="anchor" pos="0.3 -0.2 0.1" euler="0.2 0.1 -0.4"/>
    <body name="tower" pos="0.1 0.2 0.3" euler="0.2 -0.3 0.4">
      <inertial pos="0.03 -0.02 0.11" mass="3.1" fullinertia="0.31 0.27 0.22 0.021 -0.013 0.017"/>
      <joint name="yaw" axis="1 2 3" range="-1.3 2.1" armature="0.21" damping="0.7" frictionloss="0.33" stiffness="2.2"
             springref="0.15"/>
      <body name="boom" pos="0.2 0.05 0.6" euler="-0.3 0.5 0.1">
        <inertial pos="0.21 0.04 -0.05" mass="1.7" fullinertia="0.05 0.13 0.14 0.004 0.011 -0.006"/>
        <joint name="reach" type="slide" axis="2 -1 0.5" range="-0.15 0.4" armature="0.9" damping="3.3" frictionloss="1.2"/>
        <body name="hook" pos="0.45 -0.1 0.07" euler="0.6 0.2 -0.5">
          <inertial pos="-0.02 0.06 -0.14" mass="0.8" fullinertia="0.011 0.017 0.009 0.002 -0.001 0.0015"/>
          <joint name="gimbal" type="ball" damping="0.12"/>
          <site name="tooth" pos="0.04 -0.03 -0.2" euler="-0.4 0.3 0.7"/>
        </body>
      </body>
      <body name="arm" pos="-0.12 0.3 0.25" euler="0.1 0.9 -0.2">
        <inertial pos="0.05 0.02 0.13" mass="0.6" fullinertia="0.012 0.014 0.006 0.001 0.002 -0.0013"/>
        <joint name="elbow" axis="0.3 1 -0.2" range="-2 1.4"/>
        <body name="finger" pos="0.03 -0.02 0.31" euler="0.2 0.1 0.8">
          <inertial pos="0.01 0.06 0.02" mass="0.25" fullinertia="0.0021 0.0013 0.0017 0.0002 -0.0001 0.0003"/>
          <joint name="curl" axis="1 -0.4 0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="curl" joint2="elbow" polycoef="0.15 -0.7 0 0 0"/></equality>
  <keyframe><key name="ready" qpos="0.3 0.1 0.8 0.1 -0.5 0.316 -0.6 0.57"/></keyframe>
</mujoco>"""
"""A spring and a slide on a tilted tower, a ball joint, and a second branch with a follower; gravity along no axis."""


def link_text(name, mass, com, moments):
    ixx, iyy, izz, ixy, ixz, iyz = moments
    return f"""<link name="{name}"><inertial><origin xyz="{com}" rpy="0.1 -0.2 0.3"/><mass value="{mass}"/><inertia ixx="{ixx}"
    iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial></link>"""


def joint_text(name, kind, parent, child, origin, more=""):
    xyz, rpy = origin
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint>"""


ARM = f"""<robot name="picker"><link name="stand"/>
{link_text("turret", 4.2, "0.02 -0.03 0.09", (0.04, 0.05, 0.03, 0.002, -0.003, 0.004))}
{link_text("ram", 2.6, "0.01 0.2 -0.04", (0.06, 0.02, 0.05, -0.001, 0.003, 0.002))}
{link_text("claw", 0.9, "0.05 0.02 0.11", (0.004, 0.005, 0.003, 0.0002, -0.0004, 0.0003))}
<link name="pad"/>
{
    joint_text(
        "swing",
        "revolute",
        "stand",
        "turret",
        ("0.1 -0.05 0.3", "0.4 -0.2 0.5"),
        '<axis xyz="0.2 -0.4 1"/><limit lower="-2.5" upper="1.9" velocity="1.7" effort="61"/><dynamics damping="0.8" friction="1.3"/>',
    )
}
{
    joint_text(
        "press",
        "prismatic",
        "turret",
        "ram",
        ("0.05 0.1 0.2", "-0.3 0.6 0.1"),
        '<axis xyz="1 0.5 -0.3"/><limit lower="-0.2" upper="0.7" velocity="0.9" effort="140"/><dynamics damping="5" friction="2.4"/>',
    )
}
{
    joint_text(
        "grip",
        "continuous",
        "ram",
        "claw",
        ("0.1 0.3 -0.05", "0.7 0.2 -0.4"),
        '<axis xyz="-0.1 1 0.6"/><limit velocity="3.1" effort="17"/>',
    )
}
{joint_text("glue", "fixed", "claw", "pad", ("0.02 0.06 0.21", "0.3 -0.5 0.2"))}
</robot>"""
"""Three joints in a row with limits of their own."""

ROVER = f"""<robot name="rover"><link name="ground"/>
{link_text("hull", 5.5, "0.04 -0.02 0.07", (0.2, 0.3, 0.4, 0.01, -0.02, 0.03))}
{link_text("mast", 1.2, "-0.03 0.05 0.3", (0.03, 0.04, 0.02, 0.001, 0.002, -0.003))}
{link_text("lamp", 0.4, "0.02 0.01 -0.05", (0.002, 0.003, 0.004, 0.0001, 0.0002, -0.0003))}
{joint_text("plane", "planar", "ground", "hull", ("0.2 0.1 0.05", "0.2 0.3 -0.1"), '<axis xyz="0.3 -0.2 1"/>')}
{
    joint_text(
        "lean",
        "revolute",
        "hull",
        "mast",
        ("-0.1 0.04 0.2", "0.5 -0.1 0.2"),
        '<axis xyz="1 0.3 0.2"/><limit lower="-0.6" upper="0.8" velocity="2" effort="20"/>',
    )
}
{
    joint_text(
        "nod",
        "revolute",
        "mast",
        "lamp",
        ("0.03 -0.06 0.55", "0.1 0.4 -0.3"),
        '<axis xyz="0.2 1 -0.5"/><limit lower="-1" upper="1.1" velocity="4" effort="3"/>',
    )
}
</robot>"""
"""A planar base: positions along and about an axis that is not z."""

DRIVES = {
    "couplings": {
        "pair": {"motors": ["m_a", "m_b"], "joints": ["swing", "grip"], "motor_per_joint": [[1.0, 0.5], [-0.25, 1.5]]}
    },
    "actuators": {
        "m_a": {
            "ratio": 40,
            "efficiency": 0.8,
            "no_load_torque": "0.03 N m",
            "rotor": {"inertia": "120 g cm^2"},
            "motor": {"torque_constant": "0.11 N m/A", "resistance": "0.6 ohm", "voltage": "48 V", "speed": "3000 rpm"},
            "friction": {"viscous": "0.5 N m s/rad", "coulomb": "1.1 N m", "load": 0.04},
            "effort": "33 N m",
        },
        "m_b": {
            "ratio": -25,
            "efficiency": 0.7,
            "rotor": {"inertia": "70 g cm^2"},
            "motor": {"torque_constant": "0.07 N m/A", "resistance": "0.9 ohm"},
            "friction": {"coulomb": "0.4 N m"},
            "effort": "21 N m",
        },
        "press": {
            "ratio": "10 mm/turn",
            "efficiency": 0.9,
            "rotor": {"inertia": "40 g cm^2", "extra": True},
            "motor": {"torque_constant": "0.09 N m/A", "resistance": "0.4 ohm", "inductance": "0.3 mH"},
            "friction": {"viscous": "12 N s/m", "coulomb": "3 N", "static": "4.5 N", "stribeck": "0.02 m/s"},
        },
    },
}
"""Two coupled motors, one of them turning the other way, and a spindle."""


@cache
def crane():
    return tw.load(CRANE)


@cache
def picker():
    return tw.load(ARM, gravity=(0.4, 1.1, -9.5))


@cache
def rover():
    return tw.load(ROVER, gravity=(-0.7, 0.6, -9.6))


@cache
def drone():
    return tw.load(ARM.replace("picker", "drone"), floating_base=True, gravity=(0.4, 1.1, -9.5)).with_payload(
        tw.SpatialInertia.from_com(1.3, (0.1, -0.2, 0.05), np.diag([0.02, 0.03, 0.025])), "stand"
    )


@cache
def driven():
    loaded = picker().with_payload(tw.SpatialInertia.from_com(0.7, (0.02, 0.03, -0.04)), "pad")
    loaded = loaded.with_payload(tw.SpatialInertia.from_com(0.45, (-0.05, 0.01, 0.02), 0.001 * np.eye(3)), "pad")
    return loaded.with_actuators(DRIVES)


@cache
def elastic():
    return picker().with_actuators(
        {
            "actuators": {
                "swing": {
                    "ratio": 50,
                    "efficiency": 0.85,
                    "rotor": {"inertia": "90 g cm^2", "mass": "0.4 kg", "extra": True, "axis": [0, 1, 2]},
                    "stiffness": "800 N m/rad",
                    "motor": {"torque_constant": "0.1 N m/A", "resistance": "0.5 ohm"},
                    "friction": {"viscous": "0.3 N m s/rad", "coulomb": "0.9 N m"},
                    "link_friction": {"viscous": "0.2 N m s/rad"},
                },
                "grip": {
                    "ratio": 30,
                    "rotor": {
                        "inertia": "20 g cm^2",
                        "mass": "0.2 kg",
                        "extra": True,
                        "link": "ram",
                        "axis": [1, 0.5, 0.2],
                    },
                },
            }
        }
    )


ROBOTS = {"crane": crane, "picker": picker, "rover": rover, "drone": drone, "driven": driven, "elastic": elastic}


def motion(robot, count=None, seed=3):
    """A state, or several, with no entry equal to another; inside the joint limits."""
    rng = np.random.default_rng(seed)
    shape = () if count is None else (count,)
    q = robot.random_configuration(rng, shape)
    dq, ddq = rng.uniform(-1.7, 1.9, (2, *shape, robot.nv))
    return q, dq, ddq


def warned(call):
    """Result of a call, and its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    return {"result": result, "warnings": [f"{w.category.__name__}: {w.message}" for w in caught]}


def frames_of(robot):
    return robot.frame_names[-1], robot.frame_names[1], robot.frame_names[len(robot.frame_names) // 2]


def inputs_at(robot, name, q, dq, ddq):
    rng = np.random.default_rng(8)
    batch = q.shape[:-1]
    by_name = {"q": q, "dq": dq, "ddq": ddq, "tau": 9.0 * ddq, "q1": q, "load": 30.0 * ddq[..., ::-1], "dv": 0.6 * dq}
    by_name["q0"] = robot.random_configuration(rng, batch)
    by_name["wrench"] = rng.uniform(-9, 8, (*batch, 6))
    return [by_name[label] for label in QUANTITIES[name].inputs]


def results(kernel, *arrays):
    with np.errstate(all="ignore"):
        return kernel(*arrays)


def quantities_of(robot):
    q, dq, ddq = motion(robot)
    found = {}
    for name in sorted(QUANTITIES):
        if "constraints" in QUANTITIES[name].options:
            continue
        options = {"frame": frames_of(robot)[0]} if "frame" in QUANTITIES[name].options else {}
        if "rows" in QUANTITIES[name].options:
            options |= {"rows": "wy vx vz", "kind": "world_aligned"}
        if name == "christoffel" and robot not in (picker(), driven(), elastic()):
            found[name] = refusal(lambda: robot.christoffel(q))
            continue
        kernel = robot.kernel(name, **options)
        found[name] = results(kernel, *inputs_at(robot, name, q, dq, ddq))
        if name in ("inverse_dynamics", "forward_dynamics"):
            found[f"{name} with friction"] = results(
                robot.kernel(name, friction=True), *inputs_at(robot, name, q, dq, ddq)
            )
    return found


@records.of
def quantities_of_a_crane():
    return quantities_of(crane())


@records.of
def quantities_of_a_planar_base():
    return quantities_of(rover())


@records.of
def quantities_of_coupled_drives():
    return quantities_of(driven())


@records.of
def quantities_of_an_elastic_joint():
    return quantities_of(elastic())


@records.of
def quantities_by_reference():
    found = {}
    robot = driven()
    q, dq, ddq = motion(robot)
    for name in ("inverse_dynamics", "jacobian", "drive_torques", "kinetic_energy", "subtract", "friction_under_load"):
        found[name] = robot.reference(name, *inputs_at(robot, name, q, dq, ddq))
    found["frame"] = robot.reference("jacobian_rate", q, dq, frame="ram", kind="space")
    found["wrenches"] = robot.reference(
        "inverse_dynamics",
        q,
        dq,
        ddq,
        [1, 2, 3, -4, 5, 6],
        [0.5, 1, 0, 2, -3, 4],
        wrenches=("ram", "claw"),
        on_robot=("claw",),
    )
    found["gravity"] = robot.reference("inverse_dynamics", q, dq, ddq, [1.0, 2.0, -5.0], gravity="input")
    found["parameters"] = robot.reference("gravity_forces", q, [3.3, 0.15], parameters=("ram.mass", "claw.com_y"))
    found["refused"] = {
        "by": refusal(lambda: robot.reference("gravity_forces", q, by="q")),
        "few": refusal(lambda: robot.reference("inverse_dynamics", q, dq)),
        "many": refusal(lambda: robot.reference("gravity_forces", q, dq)),
        "wrench": refusal(lambda: robot.reference("gravity_forces", q, wrenches=("ram",))),
        "shape": refusal(lambda: robot.reference("bias_forces", q, dq[:2])),
        "batch": refusal(lambda: robot.reference("gravity_forces", [q, q])),
        "text": refusal(lambda: robot.reference("gravity_forces", ["a", "b", "c"])),
        "singular": refusal(lambda: tw.robots.planar_2r().reference("task_inertia", [0.3, 0.0], rows="vx vy")),
    }
    return found


@records.of
def methods_at_states_that_broadcast():
    found = {}
    for label in ("crane", "driven"):
        robot = ROBOTS[label]()
        q, dq, ddq = motion(robot, 2)
        frame, other, _ = frames_of(robot)
        one = {
            "coordinates": robot.add(q, 0.4 * dq[:, None]),
            "difference": robot.subtract(q[0], q[1]),
            "pose": robot.forward_kinematics(q[1], other),
            "poses": robot.link_poses(q),
            "acceleration": robot.frame_acceleration(q[:, None], dq, ddq, frame, "space"),
            "torques": robot.inverse_dynamics(q[0], dq, ddq[:, None]),
            "with friction": robot.inverse_dynamics(q[0], dq[0], ddq[0], friction=True),
            "accelerations": robot.forward_dynamics(q, dq[1], 5.0 * ddq),
            "accelerations with friction": robot.forward_dynamics(q[1], dq[1], 20.0 * ddq[1], friction=True),
            "bias": robot.bias_forces(q, dq),
            "Coriolis": robot.coriolis_forces(q[1], dq),
            "Coriolis matrix": robot.coriolis_matrix(q[1], dq[0]),
            "gravity": robot.gravity_forces(q),
            "holding": robot.holding_torques(q),
            "friction": robot.friction_forces(dq),
            "friction under load": robot.friction_forces(dq[0], load=40.0 * ddq),
            "regressor": robot.regressor(q[1], dq[1], ddq[0]),
            "drives": robot.drive_torques(q[0], dq[0], ddq[0]),
            "carried": robot.joint_wrenches(q[0], dq[1], ddq[0]),
            "kinetic": robot.kinetic_energy(q, dq),
            "potential": robot.potential_energy(q),
            "momentum": robot.momentum(q[0], dq[0]),
            "momentum about the centre": robot.momentum(q[0], dq[0], "com"),
            "centre": robot.center_of_mass(q[1]),
            "centre's Jacobian": robot.com_jacobian(q[1]),
        }
        found[label] = one
    return found


@records.of
def kinds_of_frame_quantities():
    found = {}
    for label in ("crane", "rover"):
        robot = ROBOTS[label]()
        q, dq, ddq = motion(robot, seed=5)
        for frame in {*frames_of(robot), robot.frame_names[0]}:
            for kind in ("body", "space", "world_aligned"):
                J, dJ = robot.jacobian(q, frame, kind), robot.jacobian_rate(q, dq, frame, kind)
                V, dV = robot.frame_velocity(q, dq, frame, kind), robot.frame_acceleration(q, dq, ddq, frame, kind)
                found[f"{label} {frame} {kind}"] = np.column_stack([J, dJ, V, dV])
        found[f"{label} J by q"] = [robot.jacobian_derivative(q, frame, "space") for frame in frames_of(robot)]
    robot = picker()
    q, dq, ddq = motion(robot)
    found["tip"] = [
        robot.jacobian(q),
        robot.jacobian_rate(q, dq),
        robot.frame_velocity(q, dq),
        robot.jacobian_derivative(q),
    ]
    return found


@records.of
def wrenches_by_and_on_a_robot():
    robot = crane()
    q, dq, ddq = motion(robot, 2)
    F, G = (
        np.array([1.0, -2.0, 3.0, 40.0, 5.0, -16.0]),
        np.array([[0.5, 1.5, -0.7, 8.0, 9.0, 10.0], [2.0, 1.0, 4.0, 3.0, 7.0, -5.0]]),
    )
    by, on = {"tooth": F, "arm": G}, {"arm": 0.3 * G[0], "boom": Wrench(F, frame="boom")}
    arrays = q, dq, ddq
    return {
        "torques": robot.inverse_dynamics(*arrays, wrench_by_robot=by, wrench_on_robot=on),
        "by": robot.inverse_dynamics(*arrays, wrench_by_robot=by),
        "on": robot.inverse_dynamics(*arrays, wrench_on_robot=by),
        "holding": robot.holding_torques(q, wrench_by_robot=by, wrench_on_robot=on),
        "accelerations": robot.forward_dynamics(*arrays, wrench_by_robot=by, wrench_on_robot=on),
        "accelerations with friction": robot.forward_dynamics(
            *arrays, wrench_by_robot=by, wrench_on_robot=on, friction=True
        ),
        "torques with friction": robot.inverse_dynamics(*arrays, wrench_by_robot=by, wrench_on_robot=on, friction=True),
        "carried": robot.joint_wrenches(q[0], dq[0], ddq[0], wrench_by_robot=by, wrench_on_robot=on),
        "drives": robot.drive_torques(*arrays, wrench_by_robot=by, wrench_on_robot=on),
        "slopes": robot.inverse_dynamics_derivatives(
            q[1], dq[1], ddq[1], wrench_by_robot={"tooth": F}, wrench_on_robot=on
        ),
        "slopes of accelerations": robot.forward_dynamics_derivatives(
            q[1], dq[1], ddq[1], wrench_by_robot={"tooth": F}, wrench_on_robot=on
        ),
        "gradient": robot.inverse_dynamics_gradient(
            q[1], dq[1], ddq[1], dq[0], wrench_by_robot={"tooth": F}, wrench_on_robot=on
        ),
        "one wrench": [
            robot.wrench_torques(q, F, "tooth"),
            robot.wrench_torques(q[0], Wrench(F, frame="boom")),
            robot.wrench_torques(q[0], Wrench(F, frame="boom"), "boom"),
        ],
        "none": robot.holding_torques(q[0], wrench_by_robot={}, wrench_on_robot={}),
        "kinds of numbers": [
            str(robot.holding_torques(q[0].astype(t), wrench_by_robot={"tooth": f}, wrench_on_robot={"tooth": g}).dtype)
            for t, f, g in (
                (np.float32, F.tolist(), {}.get(0, [0.0] * 6)),
                (np.float32, F, [0.0] * 6),
                (np.float32, F.astype(np.float32), G[0].astype(np.float32)),
                (np.float64, F.astype(np.float32), G[0].astype(np.float16)),
                (np.float32, F.astype(np.float16), G[0].astype(np.float32)),
            )
        ],
    }


@records.of
def wrenches_refused():
    robot = crane()
    q = motion(robot)[0]
    six = [1, 2, 3, 4, 5, 6]
    labelled = Wrench([1, 2, 3, 4, 5, 6], frame="tooth")
    return {
        "no dict": refusal(lambda: robot.holding_torques(q, wrench_by_robot=six)),
        "no dict on": refusal(lambda: robot.holding_torques(q, wrench_on_robot=[six])),
        "five": refusal(lambda: robot.holding_torques(q, wrench_by_robot={"tooth": six[:5]})),
        "other label": refusal(lambda: robot.holding_torques(q, wrench_by_robot={"boom": labelled})),
        "frame": refusal(lambda: robot.holding_torques(q, wrench_by_robot={"tooht": six})),
        "batch": refusal(
            lambda: robot.holding_torques(q, wrench_by_robot={"boom": [six] * 2}, wrench_on_robot={"boom": [six] * 3})
        ),
        "batch of inputs": refusal(lambda: robot.bias_forces([q] * 2, np.ones((3, 6)))),
        "complex": refusal(lambda: robot.holding_torques(q, wrench_by_robot={"tooth": np.ones(6) * 1j})),
        "no frame": refusal(lambda: robot.wrench_torques(q, six)),
        "label and frame": refusal(lambda: robot.wrench_torques(q, labelled, "boom")),
        "base": refusal(lambda: robot.wrench_torques(q, Wrench([1, 2, 3, 4, 5, 6], frame="anchor"))),
        "world": refusal(lambda: robot.wrench_torques(q, Wrench([1, 2, 3, 4, 5, 6], frame="world"), "world")),
        "shape": refusal(lambda: robot.wrench_torques(q, six[:4], "tooth")),
        "closed form of many": refusal(lambda: robot.closed_form(q, np.ones(6), wrench_by_robot={"tooth": [six, six]})),
    }


@records.of
def arguments_refused():
    robot = crane()
    q, dq, ddq = motion(robot)
    huge = tw.load(chain_text(13))
    calls = {
        "short q": lambda: robot.gravity_forces(q[:6]),
        "long dq": lambda: robot.bias_forces(q, np.ones(7)),
        "scalar": lambda: robot.gravity_forces(0.5),
        "complex": lambda: robot.gravity_forces(q * 1j),
        "texts": lambda: robot.gravity_forces(["a"] * 7),
        "objects": lambda: robot.gravity_forces(np.array([None] * 7)),
        "batches": lambda: robot.inverse_dynamics([q, q], [dq] * 3, ddq),
        "many joints": lambda: huge.gravity_forces(np.ones(12)),
        "few listed": lambda: tw.load(chain_text(12)).gravity_forces(np.ones(11)),
        "velocities of many": lambda: robot.friction_forces(np.ones(3)),
        "parameters": lambda: (
            robot.kernel("gravity_forces", parameters=("boom.mass",))
            and robot.engine.call("gravity_forces", q, [1.0, 2.0], parameters=("boom.mass",))
        ),
        "momentum's frame": lambda: robot.momentum(q, dq, "tip"),
        "kind": lambda: robot.jacobian(q, "tooth", "local"),
        "kind of Pinocchio": lambda: robot.jacobian(q, "tooth", "LOCAL_WORLD_ALIGNED"),
        "frame": lambda: robot.jacobian(q, "tooht"),
        "no tip": lambda: robot.jacobian(q),
        "actuated of a tree": lambda: robot.inverse_dynamics(q, dq, ddq, ["yaw"]),
        "actuated slopes": lambda: robot.inverse_dynamics_derivatives(q, dq, ddq, ["yaw"]),
        "actuated holding": lambda: robot.holding_torques(q, ["yaw"]),
        "actuated wrenches": lambda: robot.joint_wrenches(q, dq, ddq, ["yaw"]),
        "actuated explained": lambda: robot.explain(q, dq, ddq, ["yaw"]),
        "out of another shape": lambda: robot.gravity_forces(q, out=np.zeros(5)),
        "read-only out": lambda: robot.gravity_forces(q, out=np.broadcast_to(np.zeros(6), (6,))),
        "out of float32": lambda: robot.gravity_forces(q, out=np.zeros(6, np.float32)),
        "float32 into float64": lambda: robot.gravity_forces(q.astype(np.float32), out=np.zeros(4)),
        "out of texts": lambda: robot.gravity_forces(q, out=np.array(["a"] * 6)),
        "out a list": lambda: robot.gravity_forces(q, out=[0.0] * 6),
        "one out of two": lambda: robot.drive_torques(q, dq, ddq, out=np.zeros(6)),
        "two outs for many": lambda: robot.drive_torques([q, q], dq, ddq, out=(np.zeros((2, 6)), np.zeros(6))),
        "text in a pair": lambda: robot.drive_torques(q, dq, ddq, out=(np.zeros(6), np.array(["a"] * 6))),
        "overlap": lambda: robot.drive_torques(q, dq, ddq, out=(a := np.zeros(9))[:6] is None or (a[:6], a[3:])),
        "linearize": lambda: robot.linearize(q, dq[:4], ddq),
        "closed form": lambda: robot.closed_form([q, q], dq),
        "closed form, not finite": lambda: robot.closed_form(q, dq * np.nan),
        "closed form, wrench": lambda: robot.closed_form(q, dq, wrench_by_robot=[1.0]),
        "lost directions": lambda: robot.lost_directions(q * np.inf, "tooth"),
        "explain": lambda: robot.explain(q, dq, ddq[:3]),
        "motors": lambda: robot.motor_loads(q, dq, ddq),
        "random": lambda: robot.random_configuration(0, -1),
        "random part": lambda: robot.random_configuration(0, (2, 1.5)),
        "random seed": lambda: robot.random_configuration("a"),
        "coordinates": lambda: robot.coordinates(elbw=0.3),
        "missing": lambda: robot.no_such_thing,
        "private": lambda: robot._no_such_thing,
        "momentum_about_com": lambda: robot.momentum_about_com,
        "task kernel": lambda: robot.constrained_dynamics,
        "set gravity": lambda: setattr(robot, "gravity", [0, 0, 1]),
        "a path": lambda: tw.Robot("arm.urdf"),
        "no robot": lambda: tw.robot.base.require_robot(3.5, "here") if hasattr(tw, "robot") else None,
    }
    return {label: refused_or_done(call) for label, call in calls.items()}


def refused_or_done(call):
    """Error of a call, or its result."""
    try:
        return call()
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def chain_text(count):
    """Robot file of ``count`` joints in a row, no two alike."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for k in range(1, count + 1):
        moments = (0.01 + 0.002 * k, 0.012 + 0.001 * k, 0.011 + 0.0015 * k, 0.0003 * k, -0.0002 * k, 0.0001 * k)
        parts.append(link_text(f"l{k}", 0.5 + 0.13 * k, f"{0.02 * k} {-0.01 * k} 0.05", moments))
        kind = "prismatic" if k % 3 == 2 else "revolute"
        limit = f'<limit lower="{-1 - 0.1 * k}" upper="{1 + 0.07 * k}" velocity="{2 + 0.1 * k}" effort="{50 + k}"/>'
        axis = f'<axis xyz="{0.3 * (k % 2)} 1 {0.2 * (k % 3)}"/>'
        place = (f"0.05 {0.01 * k} {0.1 + 0.02 * k}", f"{0.1 * k} -0.2 0.3")
        parts.append(joint_text(f"j{k}", kind, f"l{k - 1}", f"l{k}", place, axis + limit))
    return "\n".join(parts) + "</robot>"


@records.of
def numbers_of_other_kinds():
    robot = picker()
    q, dq, ddq = motion(robot, 2)
    import pandas

    names = list(robot.coordinate_names)
    table = pandas.DataFrame({name: q[:, names.index(name)] for name in ("grip", "swing", "press")})
    out = np.zeros((2, 3))
    pair = np.zeros((2, 3)), np.zeros((2, 3))
    returned = robot.drive_torques(q, dq, ddq, out=pair)
    return {
        "table": robot.gravity_forces(table) - robot.gravity_forces(q),
        "table with a wrench": robot.holding_torques(table, wrench_by_robot={"pad": [1, 2, 3, 4, 5, 6]}),
        "table of rates": robot.friction_forces(
            pandas.DataFrame({"press": dq[:, 1], "grip": dq[:, 2], "swing": dq[:, 0]})
        )
        - robot.friction_forces(dq),
        "wrong columns": refusal(lambda: robot.gravity_forces(table.rename(columns={"grip": "gripp"}))),
        "list": robot.gravity_forces(q.tolist()),
        "integers": robot.gravity_forces([1, 0, 2]),
        "float32": [
            str(robot.gravity_forces(q.astype(np.float32)).dtype),
            robot.gravity_forces(q.astype(np.float32)).round(3),
        ],
        "float16": str(robot.gravity_forces(q.astype(np.float16)).dtype),
        "none": robot.gravity_forces(np.zeros((0, 3))),
        "out": [robot.gravity_forces(q, out=out) is out, out],
        "out of two": [returned is pair or returned[0] is pair[0], pair],
        "nan": robot.gravity_forces([0.1, np.nan, 0.3]),
        "dtype asked": _dask(robot, q, dq),
    }


def _dask(robot, q, dq):
    import dask.array

    lazy_q, lazy_dq = dask.array.from_array(q, chunks=(1, 3)), dask.array.from_array(dq, chunks=(1, 3))
    later = robot.bias_forces(lazy_q, lazy_dq)
    pair = robot.drive_torques(lazy_q, lazy_dq, lazy_dq)
    loaded = robot.holding_torques(lazy_q, wrench_by_robot={"pad": [1, 2, 3, 4, 5, 6]})
    return {
        "later": [type(later).__name__, list(later.shape), later.compute(scheduler="synchronous")],
        "pair": [x.compute(scheduler="synchronous") for x in pair],
        "wrench": loaded.compute(scheduler="synchronous"),
        "task": robot.task_inertia(lazy_q, rows="vx vz").compute(scheduler="synchronous"),
        "out": refusal(lambda: robot.gravity_forces(lazy_q, out=np.zeros((2, 3)))),
        "shape": refusal(lambda: robot.bias_forces(lazy_q, lazy_dq[:, :2])),
    }


# ── kernels ──


@records.of
def kernels_and_their_options():
    robot = driven()
    q, dq, ddq = motion(robot)
    F, G = [1.0, -2.0, 3.0, 4.0, 5.0, -6.0], [0.5, 1.5, 2.5, -3.0, 2.0, 1.0]
    g = [0.3, -0.2, -3.7]
    found = {}
    cases = {
        "wrenches": (("inverse_dynamics",), {"wrenches": ("ram", "claw")}, (q, dq, ddq, F, G)),
        "one on it": (("inverse_dynamics",), {"wrenches": ("ram", "claw"), "on_robot": "claw"}, (q, dq, ddq, F, G)),
        "one name": (("holding_torques",), {"wrenches": "ram"}, (q, F)),
        "gravity": (("gravity_forces",), {"gravity": "input"}, (q, g)),
        "gravity, friction, wrench": (
            ("inverse_dynamics",),
            {"gravity": "input", "friction": True, "wrenches": ("pad",)},
            (q, dq, ddq, F, g),
        ),
        "parameters": (("mass_matrix",), {"parameters": ("ram.mass", "swing.x")}, (q, [3.3, 0.15])),
        "patterns": (("friction_forces",), {"parameters": "*.viscous"}, (dq, np.arange(1.0, 4.0))),
        "all": (
            ("inverse_dynamics",),
            {"parameters": ("claw.Ixy", "press.viscous"), "gravity": "input", "wrenches": "ram"},
            (q, dq, ddq, F, g, [0.01, 3.0]),
        ),
        "two": (("mass_matrix", "bias_forces"), {}, (q, dq)),
        "three": (
            ("jacobian", "inverse_dynamics", "forward_kinematics"),
            {"frame": "ram", "kind": "space", "friction": True},
            (q, dq, ddq),
        ),
        "task": (("task_inertia", "task_bias"), {"frame": "ram", "rows": ("wy", "vx"), "kind": "space"}, (q, dq)),
        "by q": (("gravity_forces",), {"by": "q"}, (q,)),
        "by two": (("bias_forces",), {"by": ("dq", "q"), "values": True}, (q, dq)),
        "by and wrenches": (("holding_torques",), {"wrenches": ("ram",), "by": ("q", "wrench at ram")}, (q, F)),
        "several by": (("kinetic_energy", "mass_matrix"), {"by": "q"}, (q, dq)),
    }
    for label, (names, options, arrays) in cases.items():
        kernel = robot.kernel(*names, **options)
        program = robot.program(*names, **options)
        found[label] = {
            "signature": kernel.signature,
            "doc": kernel.__doc__.splitlines()[0],
            "inputs": [(port.name, port.shape) for port in program.inputs],
            "outputs": [(port.name, port.shape) for port in program.outputs],
            "result": results(kernel, *arrays),
        }
    found["same kernel"] = [
        robot.kernel("mass_matrix") is robot.kernel("mass_matrix"),
        robot.kernel("jacobian", frame="pad") is robot.kernel("jacobian"),
        robot.kernel("jacobian", frame="ram") is robot.kernel("jacobian"),
        robot.kernel("inverse_dynamics", friction=False) is robot.kernel("inverse_dynamics"),
    ]
    return found


@records.of
def derivatives_of_each_form():
    found = {}
    for label in ("rover", "ball"):
        robot = rover() if label == "rover" else crane().chain("tower", "tooth")
        q, dq, ddq = motion(robot)
        rng = np.random.default_rng(1)
        w, v, u = rng.uniform(-1, 1, (3, robot.nv))
        table = {}
        for mode in ("auto", "forward", "reverse"):
            table[f"jacobian {mode}"] = robot.kernel("coordinate_rates", by=("q", "dq"), mode=mode)(q, dq)
            table[f"hessian {mode}"] = robot.kernel("potential_energy", by="q", form="hessian", mode=mode)(q)
        table["hessian by both"] = robot.kernel("kinetic_energy", by=("dq", "q"), form="hessian", values=True)(q, dq)
        table["along"] = robot.kernel("bias_forces", by="q", form="along")(q, dq, v)
        table["along both"] = robot.kernel("bias_forces", by=("q", "dq"), form="along", values=True)(q, dq, v, u)
        table["weighted"] = robot.kernel("bias_forces", by=("dq", "q"), form="weighted")(q, dq, w)
        table["weighted number"] = robot.kernel("kinetic_energy", by="q", form="weighted", values=True)(q, dq)
        table["hessian along"] = robot.kernel("gravity_forces", by="q", form="hessian_along")(q, w, v)
        table["number along"] = robot.kernel("kinetic_energy", by=("q", "dq"), form="hessian_along")(q, dq, v, u)
        table["poses"] = robot.kernel("forward_kinematics", frame=frames_of(robot)[0], by="q")(q)
        table["pair"] = robot.kernel("drive_torques", by="ddq", form="weighted")(q, dq, ddq, w, u)
        table["subtract"] = robot.kernel("subtract", by=("q1", "q0"))(q, robot.add(q, 0.3 * v))
        table["ports"] = {
            form: [port.name for ports in (p.inputs, p.outputs) for port in ports]
            for form in ("jacobian", "along", "weighted", "hessian", "hessian_along")
            for p in [robot.program("drive_torques", by=("dq", "ddq"), form=form, values=form != "along")]
        }
        found[label] = table
    return found


@records.of
def derivatives_as_methods():
    found = {}
    for label in ("crane", "rover", "driven"):
        robot = ROBOTS[label]()
        q, dq, ddq = motion(robot, seed=11)
        w, a, b, c = np.random.default_rng(2).uniform(-1, 1, (4, robot.nv))
        found[label] = {
            "torques": robot.inverse_dynamics_derivatives(q, dq, ddq),
            "accelerations": robot.forward_dynamics_derivatives(q, dq, 3.0 * ddq),
            "gradient": robot.inverse_dynamics_gradient(q, dq, ddq, w),
            "second": robot.inverse_dynamics_hessian_product(q, dq, ddq, w, a, b, c) if label == "rover" else "",
            "mass": robot.mass_matrix_derivative(q),
            "linear": robot.linearize(q, dq, 3.0 * ddq),
        }
    q, dq, ddq = motion(rover(), 2)
    found["many states"] = rover().linearize(q, dq, ddq[0])
    return found


@records.of
def kernels_refused():
    robot = crane()
    name = "gravity_forces"
    massless = tw.load(
        '<robot name="ghost"><link name="a"/><link name="b"/>'
        + joint_text("t", "continuous", "a", "b", ("1 2 3", "0 0 0"))
        + "</robot>"
    )
    bare = tw.load('<robot name="stone"><link name="a"/></robot>')
    calls = {
        "name": lambda: robot.kernel("gravity_force"),
        "other library": lambda: robot.kernel("rnea"),
        "no name": lambda: robot.kernel(),
        "twice": lambda: robot.kernel(name, name),
        "option": lambda: robot.kernel(name, colour="red"),
        "option of two": lambda: robot.kernel(name, "jacobian", colour="red"),
        "not of it": lambda: robot.kernel("mass_matrix", friction=True),
        "gravity": lambda: robot.kernel(name, gravity=(0, 0, 1)),
        "kind": lambda: robot.kernel("jacobian", kind="tool", frame="tooth"),
        "kind of Pinocchio": lambda: robot.kernel("jacobian", kind="world", frame="tooth"),
        "frame": lambda: robot.kernel("jacobian", frame="teeth"),
        "rows": lambda: robot.kernel("task_inertia", frame="tooth", rows="vx vq"),
        "wrenches": lambda: robot.kernel(name, wrenches=3),
        "wrench frame": lambda: robot.kernel(name, wrenches=("teeth",)),
        "wrench twice": lambda: robot.kernel(name, wrenches=("tooth", "tooth")),
        "on robot": lambda: robot.kernel(name, wrenches=("tooth",), on_robot=("boom",)),
        "parameters": lambda: robot.kernel(name, parameters=("boom.weight",)),
        "constraints": lambda: robot.kernel("constraint_jacobian"),
        "constraints' kind": lambda: robot.kernel("constraint_jacobian", constraints=(3,)),
        "constraints' list": lambda: robot.kernel("constraint_jacobian", constraints=[3]),
        "by": lambda: robot.kernel(name, by="dq"),
        "by none": lambda: robot.kernel(name, by=()),
        "by number": lambda: robot.kernel(name, by=3),
        "by twice": lambda: robot.kernel("bias_forces", by=("q", "q")),
        "form": lambda: robot.kernel(name, by="q", form="curl"),
        "mode": lambda: robot.kernel(name, by="q", mode="back"),
        "mode of a form": lambda: robot.kernel(name, by="q", form="along", mode="forward"),
        "form without by": lambda: robot.kernel(name, form="hessian"),
        "values without by": lambda: robot.kernel(name, values=True),
        "christoffel": lambda: robot.kernel("christoffel"),
        "no inverse": lambda: massless.kernel("forward_dynamics"),
        "no mass": lambda: massless.center_of_mass([0.1]),
        "nothing moves": lambda: bare.kernel("task_inertia", frame="a"),
        "much mass missing": lambda: tw.load(massless_chain(13)).kernel("center_of_mass"),
        "some mass missing": lambda: tw.load(massless_chain(12)).kernel("momentum_about_com"),
    }
    found = {label: refusal(call) for label, call in calls.items()}
    found["mass as an input"] = massless.kernel("center_of_mass", parameters=("b.mass",)).signature
    found["nothing"] = [bare.center_of_mass([]), bare.mass_matrix([]), bare.gravity_forces([])]
    return found


def massless_chain(count):
    links = "".join(f'<link name="l{k}"/>' for k in range(count + 1))
    joints = (joint_text(f"j{k}", "continuous", f"l{k}", f"l{k + 1}", ("1 2 3", "0 0 0")) for k in range(count))
    return f'<robot name="ghosts">{links}{"".join(joints)}</robot>'


@records.of
def joints_without_inertia_of_their_own():
    def text(moment, mass):
        return (
            f'<robot name="thin"><link name="a"/>{link_text("b", 2.0, "0 0 0.1", (0.1, 0.1, 0.1, 0, 0, 0))}'
            f'<link name="c"><inertial><mass value="{mass}"/><inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0"'
            ' iyz="0"/></inertial></link>'
            + joint_text("first", "continuous", "a", "b", ("0.1 0.2 0.3", "0 0 0"), '<axis xyz="0 1 0"/>')
            + joint_text("second", "continuous", "b", "c", ("0.1 0.2 0.3", "0 0 0"), '<axis xyz="0 0 1"/>')
            + "</robot>"
        )

    found = {}
    for moment in (0.0, 1e-9, 1e-4):
        robot = tw.load(text(moment, 1.0 if moment else 0.5), inertia="accept")
        found[moment] = refused_or_done(lambda robot=robot: robot.forward_dynamics([0.1, 0.2], [0.3, 0.4], [0.5, 0.6]))
    return found


@records.of
def tables_of_quantities():
    table = {
        name: [
            quantity.inputs,
            quantity.outputs,
            quantity.sizes,
            quantity.options,
            quantity.felt,
            quantity.needs_inverse,
            quantity.needs_mass,
            quantity.unit,
            quantity.constrained,
        ]
        for name, quantity in QUANTITIES.items()
    }
    shapes = {
        name: QUANTITIES[name].shapes(crane().model)
        for name in QUANTITIES
        if "constraints" not in QUANTITIES[name].options
    }
    names = sorted(other_names())
    hints = [other_name_hint(name) for name in ("rnea", "CRBA", "elbow")]
    return {"table": table, "shapes": shapes, "others": {name: other_names()[name] for name in names}, "hints": hints}


# ── large robots ──


@records.of
def ways_to_derivatives_of_large_robots():
    from twistwrench.compiler.ir.loops import program_of
    from twistwrench.robot.kernels import large_robots

    name = "forward_dynamics_derivatives"

    def form_of(form):
        return "" if form is None else type(form).__name__

    requests = {
        "alone": {name: {}},
        "wrenches": {name: {"wrenches": ("l1",)}},
        "by": {name: {"derivative": 1}},
        "two": {name: {}, "mass_matrix": {}},
        "other": {"forward_dynamics": {}},
    }
    found = {
        f"{label} {n}": large_robots.needs_lapack(SimpleNamespace(nv=n), request)
        for label, request in requests.items()
        for n in (63, 64)
    }
    for n in (6, 7):
        model = tw.load(chain_text(n)).model
        found[f"columns of {n}"] = form_of(large_robots.columns_of(model, requests["alone"]))
    model = tw.load(chain_text(7)).model
    found["columns of two"] = form_of(large_robots.columns_of(model, requests["two"]))
    branched = crane().model
    found["columns of a crane"] = form_of(large_robots.columns_of(branched, requests["alone"]))
    form = large_robots.columns_of(model, {name: {"wrenches": ("l4",)}})
    rng = np.random.default_rng(4)
    arrays = [*rng.uniform(-0.6, 0.7, (3, 7)), rng.uniform(-3, 4, 6)]
    robot = tw.load(chain_text(7))
    found["groups"] = [group.places for group in form.groups]
    found["hundreds of instructions"] = len(program_of(form).instructions) // 100  # rounding makes some factors equal
    found["by columns"] = robot.forward_dynamics_derivatives(*arrays[:3], wrench_by_robot={"l4": arrays[3]})
    return found


@records.of
def products_over_pairs_of_joints():
    from twistwrench.robot.kernels import large_robots

    robot = tw.load(chain_text(8))
    rng = np.random.default_rng(4)
    q, dq, ddq = rng.uniform(-0.6, 0.7, (3, 8))
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twistwrench.compiler.lowering.product_loop.MIN_MATRIX_SIZE", 4)
        for limit in (100, 1500, 4000, 100_000):
            patch.setattr(large_robots, "PAIR_LOOP_FROM", limit)
            for name in ("mass_matrix", "inverse_dynamics_derivatives", "gravity_forces"):
                form = large_robots.products_of(robot.model, {name: {}})
                found[f"{name} from {limit}"] = "" if form is None else type(form).__name__
        patch.setattr(large_robots, "PAIR_LOOP_FROM", 100)
        patch.setattr("twistwrench.robot.engine.execution_form", _form_at_once)
        fresh = tw.load(chain_text(8))
        found["mass"] = fresh.mass_matrix(q)
        found["slopes"] = fresh.inverse_dynamics_derivatives(q, dq, ddq)
        found["with a wrench"] = fresh.inverse_dynamics_derivatives(
            q, dq, ddq, wrench_by_robot={"l5": [1, 2, 3, 4, 5, 6]}
        )
        found["of a crane"] = [large_robots.products_of(crane().model, {"mass_matrix": {}}) is None]
        found["two"] = large_robots.products_of(robot.model, {"mass_matrix": {}, "gravity_forces": {}}) is None
        base = drone().engine.model
        form = large_robots.products_of(base, {"mass_matrix": {}})
        found["of a floating base"] = "" if form is None else [form.relations, [m.added for m in form.matrices]]
        spring = tw.load(CRANE).lock({"gimbal": [1.0, 0, 0, 0]}).model
        patch.setattr("twistwrench.compiler.lowering.product_loop.MIN_MATRIX_SIZE", 1)
        found["constants"] = {
            name: [[m.name, m.before, m.after, m.added] for m in form.matrices]
            for name in ("mass_matrix", "inverse_dynamics_derivatives")
            for form in [large_robots.products_of(elastic().model, {name: {}})]
            if form is not None
        }
        found["spring"] = large_robots.products_of(spring, {"mass_matrix": {}}) is None
    return found


def _form_at_once(model, names, options):
    from twistwrench.robot.kernels.large_robots import columns_of, products_of
    from twistwrench.robot.kernels.options import options_by_quantity
    from twistwrench.robot.programs import program_of_several

    of_names = options_by_quantity(model, names, options)
    return products_of(model, of_names) or columns_of(model, of_names) or program_of_several(model, of_names)


@records.of
def derivatives_with_the_mass_matrix_inverted():
    from twistwrench.robot.kernels import large_robots

    robot = picker()
    q, dq, tau = motion(robot, 2)
    kernel = large_robots.LapackDerivatives(robot.engine, {"wrenches": ("ram",)})
    out = tuple(np.zeros((2, 3, 3)) for _ in range(3))
    F = [1.0, 2, 3, -4, 5, 6]
    plain = large_robots.LapackDerivatives(robot.engine, {})
    M = np.array([np.eye(3), np.diag([1.0, 2.0, 0.0]), 2.0 * np.eye(3)])
    return {
        "results": kernel(q, dq, 4.0 * tau, F),
        "out": [kernel(q[0], dq, tau, F, out=out) is out, out],
        "one": plain(q[0], dq[0], tau[0]),
        "single precision": [str(x.dtype) for x in plain(*(x[0].astype(np.float32) for x in (q, dq, tau)))],
        "names": [
            repr(kernel),
            kernel.__name__,
            kernel.__doc__,
            kernel.signature,
            kernel.nin,
            kernel.nout,
            plain.signature,
        ],
        "inverses": [large_robots._inverse(M), large_robots._inverse(M[2]), large_robots._inverse(M[1])],
    }


@records.of
def exponentials_and_logarithms():
    from twistwrench.robot.kernels import exponentials

    found = {}
    rng = np.random.default_rng(0)
    S = rng.uniform(-1.2, 1.3, (3, 6))
    T = tw.se3.exp(S)
    inputs = {"rotation_exp": S[:, :3], "pose_exp": S, "rotation_log": T[:, :3, :3], "pose_log": T}
    for name, x in inputs.items():
        kernel = exponentials.ExponentialKernel(name)
        found[name] = [kernel(x[0]), kernel(x), kernel(x[None]), kernel.call_kernel(x[1])]
    found["shapes"] = exponentials.SHAPES
    return found


# ── explanations ──


@records.of
def torques_explained():
    found = {}
    for label in ("crane", "driven", "elastic"):
        robot = ROBOTS[label]()
        q, dq, ddq = motion(robot)
        frame = frames_of(robot)[0]
        other = frames_of(robot)[1]
        why = robot.explain(
            q,
            dq,
            ddq,
            wrench_by_robot={frame: [1, -2, 3, 4, 5, 6], other: [0.3, 0.2, 0.1, 1, 2, -3]},
            wrench_on_robot={other: [0.5, 1, 2, 3, -4, 6]},
            friction=True,
        )
        found[label] = {
            "parts": why.parts,
            "terms": why.terms,
            "causes": why.causes,
            "joints": why.joints,
            "units": why.units,
            "text": str(why).splitlines(),
            "repr": repr(why),
            "of one joint": why.table(why.joints[1]).splitlines(),
            "rows": why.rows(why.joints[0]),
            "torque": why.torque,
            "difference": why.torque
            - robot.inverse_dynamics(
                q,
                dq,
                ddq,
                wrench_by_robot={frame: [1, -2, 3, 4, 5, 6], other: [0.3, 0.2, 0.1, 1, 2, -3]},
                wrench_on_robot={other: [0.5, 1, 2, 3, -4, 6]},
                friction=True,
            ),
            "without": [robot.explain(q, dq, ddq).terms, robot.explain(q, dq, ddq).causes],
        }
    return found


@records.of
def explanations_looked_at():
    robot = driven()
    q, dq, ddq = motion(robot, 2)
    many = robot.explain(q, dq[0], ddq, friction=True)
    why = robot.explain(q[0], dq[0], ddq[0])
    rest = picker().explain([0.1, 0.2, 0.3], np.zeros(3), np.zeros(3))
    calm = picker().with_gravity([0, 0, 0]).explain([0.1, 0.2, 0.3], np.zeros(3), np.zeros(3))
    return {
        "many": [str(many), repr(many), many.torque, many.by_term, many.by_cause],
        "contribution": [
            why.contribution("ram"),
            why.contribution("payload at pad", "gravity"),
            many.contribution("claw", "Coriolis"),
            many.contribution("friction"),
        ],
        "added": [
            many.with_term("cable", np.array([1.0, 2.0, 3.0])).parts[..., -1, -1, :],
            why.with_term("ram", np.array([0.25, 0.5, 2.0])).causes,
            why.with_term("ram", np.array([0.25, 0.5, 2.0])).terms,
            why.with_term("cable", np.array([1e-13, 1e-11, 0.0])).rows(),
        ],
        "at rest": str(rest).splitlines(),
        "no torque": [str(calm).splitlines(), calm.rows("grip")],
        "small": _small_torques().splitlines(),
        "refused": [
            refusal(lambda: why.contribution("arm")),
            refusal(lambda: why.contribution("ram", "weight")),
            refusal(lambda: many.table()),
            refusal(lambda: many.rows("swing")),
            refusal(lambda: why.table("swnig")),
        ],
        "lost mass": picker().lock({"press": 0.3}).explain(q[0, ::2], dq[0, ::2], ddq[0, ::2]).causes,
    }


def _small_torques():
    """Torques of which some are below the share of the largest that is shown."""
    why = picker().with_gravity([0, 0, 0]).explain([0.1, 0.2, 0.3], np.zeros(3), np.zeros(3))
    return f"{why}\n{why.with_term('cable', np.array([3.0, 2e-12, 4e-12]))}"


# ── closed form, task space, motors ──


@records.of
def closed_forms():
    found = {}
    for label in ("crane", "rover"):
        robot = ROBOTS[label]()
        q, dq, _ = motion(robot)
        form = robot.closed_form(q, dq, wrench_by_robot={frames_of(robot)[0]: [1, 2, 3, 4, 5, 6]})
        found[label] = {name: np.asarray(getattr(form, name)) for name in form.__dataclass_fields__}
    return found


@records.of
def task_space():
    found = {}
    for label, frame, kinds in (
        ("crane", "tooth", ("body", "space", "world_aligned")),
        ("picker", "ram", ("world_aligned",)),
    ):
        robot = ROBOTS[label]()
        q, dq, _ = motion(robot, 2)
        for kind in kinds:
            for rows in ("vx vz", ["wz", "vy"], (3,)):
                found[f"{label} {frame} {kind} {rows}"] = [
                    robot.task_inertia(q, frame, kind, rows),
                    robot.task_bias(q, dq[1], frame, kind, rows),
                ]
    robot = crane()
    q, dq, _ = motion(robot)
    found["all rows"] = [robot.task_inertia(q, "tooth"), robot.task_bias(q, dq, "tooth")]
    return found


@records.of
def task_space_of_singular_configurations():
    found = {}
    planar = tw.robots.planar_3r()
    q = np.array([[0.3, 0.0, 0.0], [0.4, 0.7, -0.9], [-0.2, np.pi, 0.0], [0.1, np.nan, 0.2]])
    dq = np.array([0.5, -0.7, 0.9])
    for rows in ("vx vz", "vx vy vz", "wy vx vz", None, "wx vy", "wx wy wz", "vz"):
        robot = tw.load(planar.to_urdf())
        found[str(rows)] = warned(
            lambda robot=robot, rows=rows: [
                robot.task_inertia(q, rows=rows),
                robot.task_bias(q, dq, rows=rows),
                abs(robot.lost_directions(q[:3], rows=rows)).round(9),
            ]
        )
    arm = picker()
    found["of three joints"] = warned(lambda: arm.task_inertia(motion(arm)[0], "pad", "space", "wx vx vy vz"))
    found["in the middle"] = warned(lambda: planar.task_inertia(q[0], "link2", "world_aligned"))
    bare = tw.load('<robot name="stone"><link name="a"/></robot>')
    found["nothing moves"] = [
        bare.task_inertia(np.zeros((2, 0)), "a", rows="vx vy"),
        bare.task_bias(np.zeros(0), np.zeros((3, 0)), "a", rows="vx vy wz"),
        refusal(lambda: bare.task_inertia(np.zeros(0), "b")),
    ]
    return found


@records.of
def motors():
    found = {}
    for label in ("driven", "elastic"):
        robot = ROBOTS[label]()
        q, dq, ddq = motion(robot, 2)
        dq[1, 0] = 0.0
        F = {"pad": [1.0, 2.0, 3.0, 4.0, -5.0, 6.0]}
        G = {"ram": [[0.3, 0.2, -0.5, 2.0, 3.0, 1.0], [1.0, 0.5, 0.25, -2.0, 1.5, 4.0]]}
        found[label] = {
            "loads": robot.motor_loads(q, dq, ddq),
            "with friction": robot.motor_loads(q, dq, ddq, friction=True),
            "with wrenches": robot.motor_loads(q, dq[0], ddq, wrench_by_robot=F, wrench_on_robot=G, friction=True),
            "power": robot.power_balance(q, dq, 20.0 * ddq),
            "power and friction": robot.power_balance(q, dq, 20.0 * ddq, friction=True),
            "power and wrenches": robot.power_balance(
                q[0], dq, 20.0 * ddq, wrench_by_robot=F, wrench_on_robot=G, friction=True
            ),
        }
    robot = crane()
    q, dq, ddq = motion(robot)
    found["crane"] = robot.power_balance(q, dq, 5.0 * ddq, friction=True, wrench_on_robot={"tooth": [1, 2, 3, 4, 5, 6]})
    return found


# ── properties, edits ──


@records.of
def properties():
    found = {}
    for label, build in ROBOTS.items():
        robot = build()
        if label in ("crane", "driven"):
            found[f"{label} in full"] = {
                "bodies": robot.body_names,
                "links": robot.link_names,
                "limits": robot.limits,
                "actuators": robot.actuators,
                "configurations": robot.configurations,
                "closures": list(robot.closures),
                "parameter names": robot.parameter_names,
                "varying": robot.varying(),
            }
        found[label] = {
            "repr": repr(robot),
            "name": robot.name,
            "sizes": [robot.nq, robot.nv],
            "joints": robot.joint_names,
            "coordinates": robot.coordinate_names,
            "velocities": robot.velocity_names,
            "frames": robot.frame_names,
            "tip": robot.tip,
            "defects": robot.defects,
            "gravity": robot.gravity,
            "armature": robot.armature,
            "parameters": robot.parameters,
            "neutral": robot.neutral,
            "random": robot.random_configuration(7, (2, 1)),
            "random list": robot.random_configuration(7, [2]),
            "one": robot.random_configuration(np.random.default_rng(7)),
            "open": robot.open() is robot,
            "again": repr(pickle.loads(pickle.dumps(robot))),
            "constraints": [robot.constraints, robot.sizes, robot.independent, robot.spans, robot.row_names],
            "without constraints": [
                robot.constraint_jacobian(robot.neutral[None]),
                robot.constraint_bias(robot.neutral, np.zeros((2, robot.nv))),
                robot.gaps(robot.neutral),
                robot.rank(robot.neutral),
                robot.degrees_of_freedom(robot.neutral),
            ],
        }
    found["screws"] = [picker().screws, picker().screws_at_com()]
    found["named"] = [crane().coordinates(elbow=0.4, gimbal=[0.8, 0.1, -0.5, 0.316]), picker().coordinates(press=0.2)]
    found["some parameters"] = [driven().varying("*.viscous", "ram.com_?"), driven().varying("pad.mass", "m_a.*")]
    found["patterns"] = refusal(lambda: driven().varying("lid.*"))
    return found


@records.of
def edits():
    robot = picker()
    dq, ddq = [0.5, -0.4, 0.9], [1.1, 0.7, -0.3]
    box = tw.SpatialInertia.from_com(1.4, (0.05, 0.02, 0.1), np.diag([0.01, 0.02, 0.015]))

    def torques(robot):
        n = robot.nv
        return [repr(robot), robot.gravity, robot.inverse_dynamics(robot.neutral, dq_of(n), ddq_of(n)), robot.tip]

    def dq_of(n):
        return np.resize(dq, n) + 0.1 * np.arange(n)

    def ddq_of(n):
        return np.resize(ddq, n) - 0.1 * np.arange(n)

    pose = tw.se3.exp([0.3, -0.2, 0.5, 0.1, 0.4, -0.2])
    attached = robot.attach(rover(), "ram", pose, prefix="r_")
    return {
        "payload": torques(robot.with_payload(box)),
        "payload at a link": torques(robot.with_payload(box, "ram")),
        "gravity": torques(robot.with_gravity([1, -2, 3.5])),
        "actuators": torques(robot.with_actuators(DRIVES)),
        "elastic": [
            torques(elastic()),
            torques(
                robot.with_actuators(
                    {
                        "actuators": {
                            "swing": {"ratio": 5, "stiffness": "9 N m/rad", "rotor": {"inertia": "0.1 kg m^2"}}
                        }
                    },
                    stiff=True,
                )
            ),
        ],
        "armature": torques(robot.with_armature({"press": 3.0, "grip": 0.4})),
        "lock": torques(robot.lock({"press": 0.3, "grip": 0.9})),
        "lock a ball": torques(crane().lock({"gimbal": [0.8, 0.1, -0.5, 0.316], "yaw": 0.4})),
        "attached": [torques(attached), attached.name, attached.forward_kinematics(attached.neutral, "r_lamp")],
        "attached by default": torques(robot.attach(rover(), name="both", prefix="x_")),
        "chain": [torques(crane().chain(tip="finger")), torques(crane().chain("tower", "tooth"))],
        "refused": [
            refusal(lambda: robot.with_payload(3.0)),
            refusal(lambda: robot.with_payload(box, "lid")),
            refusal(lambda: robot.with_armature([1.0])),
            refusal(lambda: robot.lock(["press"])),
            refusal(lambda: robot.lock({"lid": 1.0})),
            refusal(lambda: robot.attach(3)),
            refusal(lambda: robot.attach(rover(), pose=np.eye(3))),
            refusal(lambda: robot.with_gravity([1, 2])),
            refusal(lambda: robot.inverse_kinematics_branches(np.eye(4), rows="vx")),
        ],
    }


@records.of
def methods_of_one_state_in_repeated_calls():
    """From the second call on, a builtin may replace the method; results stay the same."""
    robot = tw.load(ARM)
    q, _, _ = motion(robot)
    found = [
        [robot.mass_matrix(q + 0.1 * k), robot.jacobian(q, "ram"), robot.jacobian(q[None], kind="space")]
        for k in range(4)
    ]
    return [found[0], found[3], sorted(set(vars(robot)) & {"mass_matrix", "jacobian"}), len(robot.engine._call_counts)]


@records.of
def arguments_handed_on_by_doors():
    """What simulations, pages and summaries receive from the robot's methods, by default and chosen."""
    robot = picker()
    received = {}

    def recorder(name):
        def record(*arguments, **options):
            received[name] = [
                [
                    x if isinstance(x, str | float | int | list | dict | tuple | None) else type(x).__name__
                    for x in arguments
                ],
                {
                    k: x if isinstance(x, str | float | int | list | dict | tuple | None) else repr(x)
                    for k, x in options.items()
                },
            ]
            return received[name]

        return record

    doors = {
        "twistwrench.simulation.preparation.simulate_robot": "simulate",
        "twistwrench.simulation.rollout.roll_out": "rollout",
        "twistwrench.simulation.batch.simulate_batch": "batch",
        "twistwrench.viz.page.show": "show",
        "twistwrench.statics.clearance.clearance_of": "clearance",
        "twistwrench.modern_robotics.newton_euler.newton_euler": "newton_euler",
        "twistwrench.reports.robot_summary.summary": "info",
        "twistwrench.reports.robot_summary.html_summary": "html",
        "twistwrench.viz.plots.explanation.plot_explanation": "plot",
    }
    q = [0.1, 0.2, 0.3]
    chosen = {"method": "rk4", "tau": [1.0], "controller": "c", "wrench_on_robot": {"a": 1}, "friction": True, "creep": 0.1,
              "contacts": ("p",), "limits": "stop", "events": ("e",), "rtol": 1e-3, "atol": 1e-4, "max_step": 0.2, "every": 3,
              "progress": "p"}  # fmt: skip
    rolled = {"dt": 0.2, "steps": 7, "duration": 3.0, "every": 2, "method": "rk4", "wrench_on_robot": {"b": 2}, "parameters": {"c": 3},
              "friction": True, "torque_limits": True, "torques": True, "gradients": True, "out": (1,)}  # fmt: skip
    calls = {
        "simulate": lambda: robot.simulate(),
        "simulate chosen": lambda: robot.simulate(q, [0.4], 2.5, 0.03, **chosen),
        "rollout": lambda: robot.rollout(q, [0.4]),
        "rollout chosen": lambda: robot.rollout(q, [0.4], [0.5], **rolled),
        "batch": lambda: robot.simulate_batch([q], duration=2.0),
        "show": lambda: robot.show(),
        "show chosen": lambda: robot.show(
            q, actuated=["a"], wrench_on_robot={"w": 1}, section="s", embed=True, control="c"
        ),
        "clearance": lambda: robot.clearance(q),
        "clearance chosen": lambda: robot.clearance(q, True, srdf="f.srdf"),
        "newton_euler": lambda: robot.newton_euler(q, [1.0], [2.0], wrench_by_robot={"a": 1}, wrench_on_robot={"b": 2}),
        "info": lambda: robot.info(),
        "html": lambda: robot._repr_html_(),
        "plot": lambda: robot.explain(q, [0.1, 0.2, 0.3], [0.4, 0.5, 0.6]).plot("p.svg"),
    }
    with pytest.MonkeyPatch.context() as patch:
        for target, name in doors.items():
            patch.setattr(target, recorder(name))
        return {label: call() for label, call in calls.items()}


@records.of
def calls_replaced_by_builtins():
    """From the second call with one state on, the robot is offered a builtin; here stand-ins take its place."""
    from twistwrench.compiler.runtime import dispatch

    robot = tw.load(ARM)
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatch, "calls_before", lambda kernel: 3)
        patch.setattr(dispatch, "is_made_here", lambda call: call == "builtin")
        patch.setattr(dispatch, "attach_fallback", lambda call, more: found.append(["attached", call, more]))
        patch.setattr(dispatch, "make_call", lambda kernel, method, name, signature: kernel)
        for label, name, kernel, count in (
            ("early", "mass_matrix", "builtin", 2),
            ("no builtin", "mass_matrix", None, 3),
            ("first", "mass_matrix", "builtin", 3),
            ("second", "mass_matrix", "other", 4),
            ("unknown", "task_kernel", "builtin", 9),
        ):
            found.append(
                [label, robot._install_direct_call(name, kernel, "signature", count), vars(robot).get("mass_matrix")]
            )
        vars(robot)["jacobian"] = "the user's"
        found.append(
            ["user's", robot._install_direct_call("jacobian", "builtin", "signature", 9), vars(robot)["jacobian"]]
        )
        patch.setattr(tw.Robot, "friction_forces", lambda self: 0)
    return found


@records.of
def calls_counted_and_results_without_numbers():
    from twistwrench.compiler.ir.tracer import Trace
    from twistwrench.robot import engine
    from twistwrench.robot.arguments import is_symbolic, names_of

    robot = tw.load(ARM)
    offers = []
    model_engine = robot.engine
    model_engine._offer_reference = lambda: (
        lambda name, kernel, signature, count: (
            bool(offers.append([name, signature.char if hasattr(signature, "char") else str(signature)[:0], count]))
            or count > 2
        )
    )
    q = np.array([0.1, 0.2, 0.3])
    for _ in range(4):
        model_engine.call("mass_matrix", q)
        model_engine.call("jacobian", q, frame="ram", kind="body")
    model_engine.call("mass_matrix", q[None])
    model_engine.call("mass_matrix", np.array([q, q]))
    model_engine.call("mass_matrix", q.astype(np.float16).astype(np.float32))
    model_engine.call("bias_forces", q, np.array([q, q]))
    counts = {str(key): value for key, value in model_engine._call_counts.items()}
    trace = Trace()
    x = trace.inputs(0, (2,))
    shapes = [
        [a.shape for a in np.atleast_1d(np.empty(0)) if False]
        or [np.shape(part) for part in (result if isinstance(result, tuple) else (result,))]
        for signature, arrays in (
            ("(3),(3)->(3,3),()", (np.zeros((2, 3)), np.zeros((1, 2, 3)))),
            ("(3)->(3)", (np.zeros(3, np.float32),)),
        )
        for result in [engine._empty_results(SimpleNamespace(signature=signature), arrays)]
    ]
    kinds = [
        str(engine._empty_results(SimpleNamespace(signature="(3),(3)->(3)"), arrays).dtype)
        for arrays in ((np.zeros(3, np.float32), np.zeros(3, np.float16)), (np.zeros(3, np.float32), np.zeros(3)))
    ]
    return {
        "offers": offers,
        "counts": counts,
        "empty": shapes,
        "kinds": kinds,
        "symbols": [
            is_symbolic(arrays)
            for arrays in ((x,), (x[0],), ([1.0, x[0]],), ([1.0, [x[1]]],), ([1.0],), (np.array([None]),))
        ],
        "names": [
            names_of(crane().model, label)
            for label in ("q", "q0", "q1", "dq", "load", "wrench", "gravity", "parameters")
        ],
        "form": [
            engine.LARGEST_COMPILED,
            engine._MIN_NULL_COMPONENT,
            engine._MAX_NULL_EIGENVALUE,
            engine.ports_text(robot.program("drive_torques")),
        ],
    }


@records.of
def causes_of_torques_in_repaired_and_driven_robots():
    box = tw.SpatialInertia.from_com(0.3, (0.1, 0.2, 0.3))
    text = ARM.replace('ixx="0.004"', 'ixx="0.04"')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        repaired = tw.load(text, inertia="repair").with_payload(box, "claw")
    inside = picker().with_actuators(
        {
            "actuators": {
                "grip": {"ratio": 20, "stiffness": "70 N m/rad", "rotor": {"inertia": "30 g cm^2"}},
                "swing": {"ratio": 9, "rotor": {"inertia": "50 g cm^2"}},
            }
        }
    )
    found = {}
    for label, robot in (("repaired", repaired), ("inside", inside)):
        q, dq, ddq = motion(robot)
        why = robot.explain(q, dq, ddq)
        found[label] = [why.causes, why.by_cause, why.torque - robot.inverse_dynamics(q, dq, ddq)]
    return found


@records.of
def slopes_of_a_robot_that_counts_as_large():
    from twistwrench.robot.kernels import large_robots

    robot = tw.load(ARM)
    q, dq, tau = motion(robot, 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(large_robots, "LAPACK_FROM", 3)
        large = robot.forward_dynamics_derivatives(q, dq, tau, wrench_by_robot={"ram": [1.0, 2, 3, -4, 5, 6]})
    usual = tw.load(ARM).forward_dynamics_derivatives(q, dq, tau, wrench_by_robot={"ram": [1.0, 2, 3, -4, 5, 6]})
    return [*large, [np.abs(a - b).max() < 1e-9 for a, b in zip(large, usual, strict=True)]]


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
