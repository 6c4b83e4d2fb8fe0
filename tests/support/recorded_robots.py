"""Robots of the records of mechanics: no two links, joints or limits are alike, bases are tilted, and gravity follows no axis."""

from __future__ import annotations

from functools import cache

import numpy as np

import twistwrench as tw
from twistwrench.mechanics.lie import se3, so3
from twistwrench.mechanics.model import actuation, couplings, edit
from twistwrench.mechanics.model.actuators import Actuator, Motor, Rotor
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.couplings import Coupling
from twistwrench.mechanics.model.model import OfferedClosure

GRAVITY = (1.3, -2.1, -9.2)


def placed(turn=(0.0, 0.0, 0.0), p=(0.0, 0.0, 0.0)):
    """Pose of a rotation vector and a position."""
    return se3.pose(so3._exp(np.asarray(turn, float)), p)


def flat(*parts):
    """All numbers of nested lists, dictionaries and arrays in one array, which is recorded by its sums if it is long.

    Infinite numbers become finite ones, so that it counts which entry is infinite.
    """
    arrays = []
    for part in parts:
        if isinstance(part, dict):
            arrays.append(flat(*part.values()))
        elif isinstance(part, list | tuple):
            arrays.append(flat(*part))
        else:
            arrays.append(np.asarray(part, float).ravel())
    return np.nan_to_num(np.concatenate([np.zeros(0), *arrays]), nan=3.33, posinf=7.77, neginf=-5.55)


def inertia(k):
    """Inertia of the k-th link."""
    R = so3._exp(np.array([0.3 * k, 0.7 - 0.2 * k, 0.1 * k * k - 0.5]))
    moments = R @ np.diag([0.021 + 0.003 * k, 0.034, 0.045 - 0.001 * k]) @ R.T
    com = (0.03 + 0.01 * k, -0.05 + 0.02 * k, 0.11 - 0.013 * k)
    return tw.SpatialInertia.from_com(0.9 + 0.35 * k, com, 0.5 * (moments + moments.T))


def state(model, seed=1):
    """Coordinates, velocities, accelerations and torques of a model; quaternions are of unit length."""
    k = np.arange(1.0, 1.0 + max(model.nq, model.nv))
    q = 0.8 * np.sin(1.3 * k + seed)[: model.nq]
    for columns in model.quaternions:
        q[columns] /= np.linalg.norm(q[columns])
    rates = [a * np.cos(b * k + seed)[: model.nv] for a, b in ((1.4, 0.9), (2.3, 1.7), (6.0, 2.1))]
    return q, *rates


def builder_of_tree():
    """A tree of every kind of joint, with sites, springs, a follower and a follower of that."""
    builder = ModelBuilder("tree", "tree.made")
    builder.gravity = GRAVITY
    builder.add_link("world")
    for k, name in enumerate(
        ("torso", "arm", "slide", "mirror", "ball", "hand", "screw", "cart", "wheel", "finger", "thumb")
    ):
        builder.add_link(name, inertia(k), shaped=name in ("arm", "hand"))
    builder.add_joint("to_torso", "fixed", "world", "torso", placement=placed((0.2, -0.1, 0.4), (0.1, 0.2, 0.3)))
    builder.add_joint(
        "shoulder",
        "revolute",
        "torso",
        "arm",
        placement=placed((0.5, 0.3, -0.7), (0.2, -0.1, 0.4)),
        axis=(0.2, -0.5, 0.8),
        lower=-1.2,
        upper=2.1,
        velocity=3.5,
        effort=40.0,
        acceleration=9.0,
        deceleration=7.0,
        jerk=60.0,
        damping=0.7,
        friction=1.1,
        armature=0.013,
    )
    builder.add_joint(
        "lift",
        "prismatic",
        "arm",
        "slide",
        placement=placed((-0.3, 0.6, 0.2), (0.3, 0.1, -0.2)),
        axis=(0.6, 0.0, -0.8),
        lower=-0.3,
        upper=0.9,
        velocity=1.5,
        effort=90.0,
        damping=1.7,
        friction=2.3,
        armature=0.21,
    )
    builder.add_joint(
        "mirrored",
        "revolute",
        "arm",
        "mirror",
        placement=placed((0.1, 0.9, 0.2), (-0.2, 0.3, 0.1)),
        axis=(0.0, 0.0, 1.0),
        lower=-2.0,
        upper=1.0,
        velocity=2.0,
        effort=15.0,
        damping=0.4,
        friction=0.3,
        armature=0.007,
        mimic=("shoulder", -0.7, 0.25),
    )
    builder.add_joint(
        "wrist",
        "ball",
        "slide",
        "ball",
        placement=placed((0.7, -0.2, 0.3), (0.1, 0.25, 0.15)),
        damping=0.2,
        armature=0.02,
    )
    builder.add_joint("to_hand", "fixed", "ball", "hand", placement=placed((0.4, 0.5, -0.6), (0.05, -0.15, 0.2)))
    builder.add_joint(
        "thread",
        "helical",
        "hand",
        "screw",
        placement=placed((0.3, 0.2, 0.9), (0.12, 0.07, -0.05)),
        axis=(1.0, -2.0, 2.0),
        pitch=0.08,
        lower=-4.0,
        upper=6.0,
        damping=0.15,
        friction=0.05,
        armature=0.003,
    )
    builder.add_joint(
        "drive",
        "planar",
        "torso",
        "cart",
        placement=placed((-0.6, 0.4, 0.1), (0.4, 0.5, -0.3)),
        axis=(0.3, -0.2, 0.9),
        damping=0.3,
    )
    builder.add_joint(
        "spin",
        "continuous",
        "cart",
        "wheel",
        placement=placed((0.2, 0.8, -0.4), (-0.1, 0.2, 0.3)),
        axis=(0.0, 1.0, 0.0),
        velocity=9.0,
        effort=4.0,
        armature=0.005,
    )
    builder.add_joint(
        "grip",
        "prismatic",
        "screw",
        "finger",
        placement=placed((0.9, 0.1, 0.2), (0.02, 0.06, 0.09)),
        axis=(0.0, 1.0, 0.0),
        mimic=("mirrored", 0.3, -0.04),
        effort=21.0,
    )
    builder.add_joint(
        "pinch",
        "revolute",
        "finger",
        "thumb",
        placement=placed((0.1, -0.7, 0.6), (0.05, 0.01, -0.03)),
        axis=(1.0, 0.0, 0.0),
        lower=-0.4,
        upper=0.6,
        friction=0.02,
    )
    builder.add_site("tool", "screw", placed((0.3, -0.4, 0.5), (0.06, -0.04, 0.13)))
    builder.add_site("eye", "torso", placed((0.1, 0.1, 0.3), (0.3, 0.2, 0.1)))
    builder.add_site("grasp", "finger", placed((0.2, 0.4, 0.1), (0.03, 0.02, 0.05)))
    builder.add_spring({"shoulder": 0.8, "lift": -1.3}, 37.0, 0.21)
    builder.add_spring({"mirrored": 0.5, "pinch": 1.1}, 12.0, -0.1)
    builder.add_spring({"spin": 1.0}, 5.0, 0.3)
    builder.add_configuration("home", {"shoulder": 0.4, "lift": 0.2, "wrist": [0.9, 0.1, -0.3, 0.2]})
    builder.add_configuration("ready", {"spin": 1.5, "drive": [0.1, 0.2, 0.3]})
    builder.add_closure("loop", OfferedClosure("tool", "wheel", "vx vz"))
    return builder


@cache
def tree():
    model = builder_of_tree().build(quiet=True, tip="tool")
    return edit.with_armature(model, {"wrist": [0.02, 0.05, 0.09]})


@cache
def floating():
    """A body that floats, with two arms."""
    builder = ModelBuilder("flyer")
    builder.gravity = GRAVITY
    for k, name in enumerate(("base", "left", "lower", "right")):
        builder.add_link(name, inertia(k + 2))
    builder.add_joint(
        "hip",
        "revolute",
        "base",
        "left",
        placement=placed((0.5, 0.3, -0.7), (0.2, -0.1, 0.4)),
        axis=(0.2, -0.5, 0.8),
        lower=-1.0,
        upper=1.5,
    )
    builder.add_joint(
        "knee",
        "prismatic",
        "left",
        "lower",
        placement=placed((-0.3, 0.6, 0.2), (0.3, 0.1, -0.2)),
        axis=(0.6, 0.0, -0.8),
        effort=12.0,
    )
    builder.add_joint(
        "other",
        "revolute",
        "base",
        "right",
        placement=placed((0.1, 0.9, 0.2), (-0.2, 0.3, 0.1)),
        axis=(0.0, 1.0, 0.0),
        damping=0.3,
    )
    model = builder.build(quiet=True, floating_base=True, tip="lower")
    return edit.with_armature(model, {"root_joint": [0.01, 0.03, 0.06, 0.1, 0.15, 0.23], "hip": 0.02})


def chain_builder(n, name="chain"):
    """A chain of n joints, every third of them prismatic."""
    builder = ModelBuilder(name)
    builder.gravity = GRAVITY
    builder.add_link("base", inertia(9))
    parent = "base"
    for k in range(n):
        link = f"link{n - k}"
        builder.add_link(link, inertia(k))
        builder.add_joint(
            f"joint{n - k}",
            "prismatic" if k % 3 == 2 else "revolute",
            parent,
            link,
            placement=placed((0.3 + 0.1 * k, -0.4, 0.2 * k), (0.2, 0.1 - 0.03 * k, 0.15)),
            axis=(0.2 * k - 0.3, 0.6, 0.5 - 0.1 * k),
            lower=-1.0 - 0.1 * k,
            upper=0.7 + 0.2 * k,
            velocity=1.0 + 0.3 * k,
            effort=20.0 + 7.0 * k,
            damping=0.1 + 0.05 * k,
            friction=0.3 + 0.1 * k,
            armature=0.01 * (k + 1),
        )
        parent = link
    return builder


@cache
def chain(n):
    return chain_builder(n).build(quiet=True)


def laws(names):
    """Friction laws of drives: each kind alone, and all together."""
    kinds = (
        {"viscous": 0.4, "coulomb": 0.9, "static": 1.4, "stribeck": 0.3, "load": 0.15},
        {"viscous": 0.7},
        {"coulomb": 1.1},
        {"load": 0.2},
        {"coulomb": 0.5, "static": 1.3, "stribeck": 0.2},
        {},
    )
    return {name: kinds[k % len(kinds)] for k, name in enumerate(names)}


@cache
def driven():
    """A chain with drives: rigid and elastic gears, rotors here and there, friction of every kind."""
    model = edit.with_armature(chain(6), {"joint6": 0, "joint5": 0, "joint4": 0})
    motor = Motor(0.05, 0.8, 0.001, 48.0, 6.0, 20.0, 400.0)
    model = actuation.with_actuators(
        model,
        [
            Actuator("joint6", 101.0, 0.8, 0.011, motor, Rotor(2e-5)),
            Actuator(
                "joint5",
                -50.0,
                0.9,
                0.02,
                Motor(0.08),
                Rotor(3e-5, True, 0.4, "link6", (0.2, 0.3, -0.9), (0.1, 0.05, 0.02)),
            ),
            Actuator("joint4", 80.0, 0.7, 0.0, None, Rotor(1.5e-5, mass=0.3, place=(0.02, 0.01, 0.03)), 350.0),
            Actuator("joint3", 7.0, 0.85, 0.3, motor),
        ],
    )
    return actuation.with_friction(model, laws(name for name in model.joint_names))


@cache
def coupled():
    """A chain whose middle joints are moved by motors together."""
    model = couplings.with_couplings(
        chain(5),
        [
            Coupling("elbow", ("inner", "outer"), ("joint4", "joint2"), [[1.2, -0.4], [0.7, 2.1]]),
            Coupling("ends", ("last", "first"), ("joint1", "joint5"), [[-3.0, 0.5], [0.8, 1.7]]),
        ],
    )
    model = edit.with_armature(model, {"inner": 0.03, "outer": 0.05, "last": 0.02, "first": 0.07})
    model = actuation.with_actuators(
        model,
        [
            Actuator("outer", 12.0, 0.75, 0.05, Motor(0.06, 0.5)),
            Actuator("joint3", 31.0, 0.9, 0.01, Motor(0.04)),
            Actuator("first", 21.0, 0.8, 0.02, Motor(0.07, 0.3)),
        ],
    )
    return actuation.with_friction(model, laws(("first", "inner", "joint3", "outer", "last")))


MODELS = {"tree": tree, "floating": floating, "chain": lambda: chain(7), "driven": driven, "coupled": coupled}
