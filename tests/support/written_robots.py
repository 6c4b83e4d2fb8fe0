"""Robots written to a file and read again: what differs, in words."""

from __future__ import annotations

import warnings

import numpy as np

import twistwrench as tw
from twistwrench.formats.writers import WRITERS

FORMS = ("urdf", "mjcf", "sdf")
TOLERANCE = 1e-9
"""Relative to the largest entry: numbers are written to the last digit, and inertias go to the centre of mass and back."""


def written(robot, form):
    """(text, what is lost)."""
    found = WRITERS[form](robot.model)
    return found.text, found.lost


def again(robot, form, **options):
    """The robot that its file is."""
    text, _ = written(robot, form)
    if form == "sdf" and robot.model.bodies and robot.model.mounts.get(robot.model.bodies[0].link, ("x",))[0] == "":
        options.setdefault("floating_base", True)  # the format says by no joint at all that it floats
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(text, inertia="accept", snap=0, **options)


def differences(robot, other, *, seed=0, states=2, without=(), lost=()):
    """What is not the same by more than the tolerance: a list of sentences, empty where all is.

    ``without``: what need not be the same, of "names", "velocity", "limits", "friction", "armature", "gravity", "tip". ``lost`` names
    links that the file calls by another name, or whose frame it has not.
    """
    if (robot.nq, robot.nv) != (other.nq, other.nv):
        return [f"nq, nv = {robot.nq}, {robot.nv}, then {other.nq}, {other.nv}"]
    found = []
    if robot.joint_names != other.joint_names:
        return [f"joints {robot.joint_names}, then {other.joint_names}"]
    if "tip" not in without and robot.tip != other.tip:
        found.append(f"tip {robot.tip}, then {other.tip}")
    for name in vars(robot.limits):
        if not {name, "limits"} & set(without):
            found += _gap(f"limits of {name}", getattr(robot.limits, name), getattr(other.limits, name))
    for name in ("viscous", "coulomb"):
        if "friction" not in without:
            found += _gap(name, getattr(robot.model.friction, name), getattr(other.model.friction, name))
    if "armature" not in without:
        found += _gap("armature", robot.armature, other.armature)
    if "gravity" not in without:
        found += _gap("gravity", robot.gravity, other.gravity)
    frames = [
        name
        for name in robot.frame_names
        if not any(
            f"{name!r} is written as" in said or (f"link {name!r} " in said and "frame is lost" in said)
            for said in lost
        )
    ]
    found += [f"no frame {name}" for name in frames if name not in other.frame_names]
    rng = np.random.default_rng(seed)
    for _ in range(states):
        q, dq = robot.random_configuration(rng), rng.uniform(-1, 1, robot.nv)
        M, h = robot.reference("mass_matrix", q), robot.reference("bias_forces", q, dq)
        size = np.abs(M).max(initial=0.0)
        found += _gap("M", M, other.reference("mass_matrix", q), size)
        found += _gap("h", h, other.reference("bias_forces", q, dq), max(size, np.abs(h).max(initial=0.0)))
        for name in frames[:: max(1, len(frames) // 30)]:
            if name in other.frame_names:
                T = robot.reference("forward_kinematics", q, frame=name)
                found += _gap(f"pose of {name}", T, other.reference("forward_kinematics", q, frame=name), 1.0)
    return found


def _gap(what, one, other, size=None):
    one, other = np.asarray(one, float), np.asarray(other, float)
    same = one == other  # infinities too
    with np.errstate(invalid="ignore"):
        off = np.where(same, 0.0, np.abs(one - other)).max(initial=0.0)
    size = np.abs(np.where(np.isfinite(one), one, 0.0)).max(initial=0.0) if size is None else size
    return [] if off <= TOLERANCE * max(size, 1e-9) else [f"{what}: {off:.2g} of {size:.2g}"]


def arm():
    """One of everything that a file can hold."""
    from twistwrench.mechanics.model.builder import ModelBuilder
    from twistwrench.mechanics.model.model import OfferedClosure

    builder = ModelBuilder("all")
    for name in ("world", "shoulder", "upper", "nut", "tool"):
        builder.add_link(name, None if name == "world" else tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=2.0))
    builder.add_joint("ball", "ball", "world", "shoulder", damping=0.3, armature=0.2)
    builder.add_joint(
        "hinge", "revolute", "shoulder", "upper", axis=(0, 0.6, 0.8, 0.1, 0.2, -0.15), upper=2.0, armature=0.1,
        acceleration=6.0, deceleration=4.0, jerk=90.0,
    )  # fmt: skip
    builder.add_joint("screw", "helical", "upper", "nut", axis=(0, 0, 1), pitch=0.02, lower=-3, upper=3, friction=0.4)
    builder.add_joint("mount", "fixed", "nut", "tool")
    builder.add_site("camera", "tool", np.diag([-1.0, -1.0, 1.0, 1.0]))
    builder.add_site("tool", "tool")
    builder.add_spring({"hinge": 1.0}, 20.0, 0.3)
    builder.add_spring({"hinge": 1.0, "screw": -0.5}, 5.0, -0.1)
    builder.add_configuration("home", {"hinge": 0.5, "ball": [0.8, 0, 0.6, 0]})
    builder.add_closure("loop", OfferedClosure("tool", "world", "vx vy vz"))
    builder.gravity = (0, 0, -1.6)
    return tw.Robot(builder.build())
