"""MJCF files as this library and as MuJoCo read them, side by side: what differs, in words."""

from __future__ import annotations

import warnings

import numpy as np

import twistwrench as tw

TOLERANCE = 1e-9
"""Relative to the largest entry: MuJoCo keeps inertias as principal moments and a quaternion, found by iteration to 1e-12."""


def load_both(source, mujoco, **options):
    """(robot, MuJoCo's model) of a path or of XML text; mimic joints free, nothing snapped."""
    text = str(source).lstrip().startswith("<")
    theirs = mujoco.MjModel.from_xml_string(str(source)) if text else mujoco.MjModel.from_xml_path(str(source))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(source, snap=0, mimic="independent", inertia="accept", **options), theirs


def differences(robot, model, mujoco, seed=0, states=2, tolerance=TOLERANCE):
    """What is not the same by more than ``tolerance``: a list of sentences, empty where all is."""
    if (robot.nq, robot.nv) != (model.nq, model.nv):
        return [f"nq, nv = {robot.nq}, {robot.nv}, MuJoCo {model.nq}, {model.nv}"]
    found = [*_constants(robot, model, mujoco)]
    rng = np.random.default_rng(seed)
    for _ in range(states):
        q, dq, ddq = robot.random_configuration(rng), *rng.uniform(-1, 1, (2, robot.nv))
        found += _at(robot, model, mujoco, q, dq, ddq)
    return [said if gap is None else f"{said}: {gap:.2g}" for said, gap in found if gap is None or not gap <= tolerance]


def to_theirs(robot, q):
    """q in MuJoCo's order: joints are in one order in both."""
    return np.concatenate([np.zeros(0), *(b.joint.to_mujoco(q[b.places[0]]) for b in robot.model.leaders)])


def rates(robot, q):
    """P with dq* = P dq."""
    P = np.zeros((robot.nv, robot.nv))
    for b in robot.model.leaders:
        at, mine = b.places[1], q[b.places[0]]
        P[at, at] = b.joint.mujoco_rates(mine)
    return P


def _gap(what, ours, theirs, scale=None):
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    if ours.shape != theirs.shape:
        return [(f"{what}: shapes {ours.shape}, {theirs.shape}", None)]
    size = max(np.abs(theirs).max(initial=0.0) if scale is None else scale, 1e-9)
    gap = np.abs(ours - theirs).max(initial=0.0) / size
    return [(what, gap)]


def _constants(robot, model, mujoco):
    yield from _gap(
        "gravity",
        robot.gravity,
        np.zeros(3) if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY) else model.opt.gravity,
    )
    armature = model.dof_armature + _at_joints(model, "actuator_armature")
    yield from _gap("armature", robot.armature, armature)
    yield from _gap(
        "damping",
        robot.model.friction.viscous,
        _at_joints(model, "actuator_damping") + np.reshape(model.dof_damping, (model.nv, -1))[:, 0] if model.nv else [],
    )
    yield from _gap("frictionloss", robot.model.friction.coulomb, model.dof_frictionloss)
    yield from _gap(
        "mass",
        sum(b.inertia.mass for b in robot.model.bodies) + robot.model.base_inertia.mass,
        model.body_mass[1:].sum(),
    )
    for j, body in enumerate(robot.model.leaders):
        name = model.joint(j).name
        if name and name != body.joint.name:
            yield f"joint {j} is {body.joint.name}, MuJoCo {name}", None
        if body.joint.nv == 1:
            k = body.v_index
            limited = bool(model.jnt_limited[j])
            theirs = model.jnt_range[j] if limited else (-np.inf, np.inf)
            ours = robot.limits.lower[k], robot.limits.upper[k]
            if not np.allclose(ours, theirs, rtol=1e-12, atol=1e-12):
                yield f"limits of {body.joint.name}: {ours}, MuJoCo {theirs}", None
    named = dict(robot.configurations)
    if not np.allclose(_unit(robot, to_theirs(robot, named["qpos0"])), _unit(robot, model.qpos0), atol=1e-9):
        yield "qpos0", None
    for k in range(model.nkey):
        name = model.key(k).name
        if name in named and not np.allclose(
            _unit(robot, to_theirs(robot, named[name])), _unit(robot, model.key_qpos[k]), atol=1e-9
        ):
            yield f"keyframe {name}", None


def _at_joints(model, field):
    """A number of the actuators that drive hinges and slides, by gear squared; (nv,)."""
    found = np.zeros(model.nv)
    values = np.asarray(getattr(model, field, np.zeros(model.nu)), float)  # older versions have none
    for k in range(model.nu):
        joint = model.actuator_trnid[k, 0]
        if model.actuator_trntype[k] <= 1 and joint >= 0 and model.jnt_type[joint] >= 2:
            found[model.jnt_dofadr[joint]] += model.actuator_gear[k, 0] ** 2 * values.ravel()[k]
    return found


def _unit(robot, qpos):
    """Quaternions of unit length, that of two which is mostly positive."""
    q = np.concatenate([np.zeros(0), *(b.joint.from_mujoco(qpos[b.places[0]]) for b in robot.model.leaders)])
    for at in robot.model.quaternions:
        q[at] *= np.sign(q[at][np.argmax(np.abs(q[at]))]) / np.linalg.norm(q[at])
    return q


def _at(robot, model, mujoco, q, dq, ddq):
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    P = rates(robot, q)
    turning = np.zeros(robot.nv)
    for b in robot.model.leaders:
        turning[b.places[1]] = b.joint.mujoco_turning(dq[b.places[1]])
    data.qpos[:], data.qvel[:], data.qacc[:] = to_theirs(robot, q), P @ dq, P @ (ddq + turning)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    found = _gap("M", robot.reference("mass_matrix", q), P.T @ M @ P)
    h = P.T @ (data.qfrc_bias + M @ (P @ turning))
    springs = robot.reference("holding_torques", q) - robot.reference("gravity_forces", q)
    ours = robot.reference("bias_forces", q, dq) - springs
    scale = np.abs(h).max(initial=0.0) + np.abs(P.T @ M @ P).max(initial=0.0)
    found += _gap("h", ours, h, scale)
    found += _gap("springs", springs, -P.T @ data.qfrc_spring, scale=max(1.0, np.abs(springs).max(initial=0.0)))
    frames = {name: robot.reference("forward_kinematics", q, frame=name) for name in _spread(robot.frame_names)}
    for kind, count, xpos, xmat in (
        ("body", model.nbody, data.xpos, data.xmat),
        ("site", model.nsite, data.site_xpos, data.site_xmat),
    ):
        for i in range(count):
            name = getattr(model, kind)(i).name or (f"body{i}" if kind == "body" else "")
            name = f"site:{name}" if kind == "site" and f"site:{name}" in frames else name
            if name and name in frames:
                found += _gap(f"place of {kind} {name}", frames[name][:3, 3], xpos[i], scale=1.0)
                found += _gap(f"turn of {kind} {name}", frames[name][:3, :3], xmat[i].reshape(3, 3), scale=1.0)
            elif name and kind == "body" and name not in robot.link_names:
                found.append((f"no body {name}", None))
    total = model.body_mass[1:].sum()
    if total > 0:
        com = (
            sum(b.inertia.mass * _com(robot, q, i) for i, b in enumerate(robot.model.bodies))
            if robot.model.bodies
            else 0
        )
        fixed = robot.model.base_inertia
        com = (com + fixed.first_moment) / total
        found += _gap("com", com, (model.body_mass[1:, None] * data.xipos[1:]).sum(axis=0) / total, scale=1.0)
    return found


def _com(robot, q, i):
    from twistwrench.mechanics.algorithms.recursion import base_poses, joint_poses

    T = base_poses(robot.model, joint_poses(robot.model, q))[i]
    return T[:3, :3] @ robot.model.bodies[i].inertia.com + T[:3, 3]


def _spread(names, most=60):
    return names[:: max(1, len(names) // most)]
