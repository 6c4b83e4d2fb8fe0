"""A model that MuJoCo has compiled, by its attributes: ``mujoco`` is not imported. For whatever no file of ours can say."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import ModelError
from ..lie import quaternion, se3
from ..model.builder import ModelBuilder
from ..model.description import Mimic
from ..model.remark import Remark
from ..typing import Array
from .element import Element
from .known_elements import LEFT_OUT
from .mjcf.bodies import WORLD, unused
from .mjcf.chain import chain
from .mjcf.joints import COORDINATES, MjcfJoint, screw
from .mjcf.settings import also_disabled
from .mujoco_forces import add_closures, add_tendons, drives_of, mimics_of, polynomial

_KINDS = ("floating", "ball", "prismatic", "revolute")
_SAID = ("free", "ball", "slide", "hinge")
_VELOCITIES = (6, 3, 1, 1)
_FORCES = ("gravity", "spring", "damper", "passive", "equality", "frictionloss", "constraint")


def read_mujoco_model(model: Any) -> ModelBuilder:
    """A builder filled with the bodies, joints, sites and keyframes of an ``mjModel``.

    Raises :class:`~twistwrench.ModelError` for what has not the attributes of one.
    """
    try:
        return _filled(model)
    except AttributeError as problem:
        raise ModelError(
            f"this is no model of MuJoCo's: {type(model).__name__} has not what one has ({problem})."
        ) from None


def _filled(model: Any) -> ModelBuilder:
    builder = ModelBuilder(_text(model, 0) or "robot")
    disabled = _disabled(model)
    builder.gravity = [0.0] * 3 if "gravity" in disabled else np.array(model.opt.gravity).tolist()
    names = [WORLD, *(model.body(i).name or f"body{i}" for i in range(1, model.nbody))]
    taken = {model.joint(j).name for j in range(model.njnt)}
    called = _joint_names(model, names)
    drives, remarks = drives_of(model, called)
    follow, more = ({}, []) if "equality" in disabled else mimics_of(model, called)
    builder.add_link(WORLD)
    for i in range(1, model.nbody):
        R = quaternion.rotation(model.body_iquat[i])
        G = SpatialInertia.from_com(
            float(model.body_mass[i]), model.body_ipos[i], R @ np.diag(model.body_inertia[i]) @ R.T
        )
        builder.add_link(names[i], G, shaped=bool(model.body_geomnum[i]))
        T = se3.pose(quaternion.rotation(model.body_quat[i]), model.body_pos[i])
        joints = [_joint(model, j, names[i], k) for k, j in enumerate(_joints_of(model, i))]
        for joint in joints:
            taken.add(joint.name)
            if "spring" in disabled:
                joint.stiffness = 0.0
            if "frictionloss" in disabled:
                joint.options["friction"] = 0.0
            if "damper" in disabled:
                joint.options["damping"] = 0.0
        parent = names[int(model.body_parentid[i])]
        for step in chain(joints, parent, names[i], T):
            if step.child != names[i]:
                builder.add_link(step.child, hidden=True)
            if step.joint is None:
                name = unused(f"{names[i]}.fixed", taken)
                builder.add_joint(name, "fixed", step.parent, step.child, placement=step.placement)
            else:
                drive = dict(drives.get(step.joint.name, {}))
                if "damper" in disabled:
                    drive["damping"] = 0.0
                _add(builder, step.joint, step.parent, step.child, step.placement, drive, follow.get(step.joint.name))
    for i in range(model.nsite):
        if model.site(i).name:
            T = se3.pose(quaternion.rotation(model.site_quat[i]), model.site_pos[i])
            builder.add_site(model.site(i).name, names[int(model.site_bodyid[i])], T)
    _add_configurations(builder, model, names)
    if "spring" not in disabled:
        add_tendons(builder, model, called)
    if "equality" not in disabled:
        add_closures(builder, model, names)
    for text in (*more, *remarks, *_left_out(model, names)):
        builder.remark(text)
    return builder


def _left_out(model: Any, names: list[str]) -> Iterator[Remark]:
    """Mechanics of bodies and of the whole that a robot leaves out."""
    if model.opt.density or model.opt.viscosity:
        yield Remark("<option> of MuJoCo's model", LEFT_OUT["option/density"])
    for i in range(1, model.nbody):
        if model.body_gravcomp[i]:
            yield Remark(f"body {names[i]!r}", LEFT_OUT["body/gravcomp"])
        if model.body_plugin[i] >= 0:
            yield Remark(f"the plugin of body {names[i]!r}", LEFT_OUT["body/plugin"])
    for f in range(getattr(model, "nflex", 0)):
        if not model.flex_rigid[f]:
            yield Remark(f"flex {f} of MuJoCo's model", LEFT_OUT["deformable/flex"])


def _joints_of(model: Any, i: int) -> range:
    start = int(model.body_jntadr[i])
    return range(start, start + int(model.body_jntnum[i]))


def _joint(model: Any, j: int, body: str, k: int) -> MjcfJoint:
    said = int(model.jnt_type[j])
    several = int(model.body_jntnum[int(model.jnt_bodyid[j])]) > 1
    name = model.joint(j).name or f"{body}.{_SAID[said]}{k if several else ''}"
    d, q = int(model.jnt_dofadr[j]), int(model.jnt_qposadr[j])
    single = said >= 2
    stiffness, damping = polynomial(model, "jnt_stiffness", j), polynomial(model, "dof_damping", d)
    joint = MjcfJoint(
        element=Element("joint", {"name": name}, 0, None),
        name=name,
        kind=_KINDS[said],
        point=np.array(model.jnt_pos[j], float),
        axis=np.array(model.jnt_axis[j], float),
        reference=float(model.qpos0[q]) if single else 0.0,
        rest=float(model.qpos_spring[q]) if single else 0.0,
        stiffness=stiffness[0],
        options={
            "damping": damping[0],
            "friction": float(model.dof_frictionloss[d]),
            "armature": float(model.dof_armature[d]),
        },
    )
    armature = model.dof_armature[d : d + _VELOCITIES[said]]
    if np.ptp(armature) > 0:  # which no file can say, but a program can
        joint.remarks.append("has another armature in each direction, of which the first is kept")
    if stiffness[1:].any():
        joint.remarks.append(LEFT_OUT["joint/stiffness"])
    if damping[1:].any():
        joint.remarks.append(LEFT_OUT["joint/damping"])
    if np.any(getattr(model, "jnt_springyield", np.zeros(model.njnt))[j]):
        joint.remarks.append(LEFT_OUT["joint/springyield"])
    if model.jnt_limited[j] and not single:
        joint.remarks.append(LEFT_OUT["ball/range"])
    if single and model.jnt_limited[j]:
        joint.options |= {"lower": float(model.jnt_range[j, 0]), "upper": float(model.jnt_range[j, 1])}
    return joint


def _joint_names(model: Any, bodies: list[str]) -> list[str]:
    """What each joint is called; those without a name as the reader of files calls them."""
    found = [""] * int(model.njnt)
    for i in range(1, model.nbody):
        for k, j in enumerate(_joints_of(model, i)):
            found[j] = _joint(model, j, bodies[i], k).name
    return found


def _add(
    builder: ModelBuilder,
    joint: MjcfJoint,
    parent: str,
    child: str,
    T: Array,
    drive: Mapping[str, float],
    mimic: Mimic | None,
) -> None:
    axis = screw(joint) if joint.single else (0.0, 0.0, 1.0)
    options = dict(joint.options)
    if "effort" in drive:
        options["effort"] = drive["effort"]
    for what in ("armature", "damping"):
        options[what] += drive.get(what, 0.0)
    builder.add_joint(joint.name, joint.kind, parent, child, placement=T, axis=axis, mimic=mimic, **options)
    for said in joint.remarks:
        builder.remark(Remark(f"joint {joint.name!r}", said))
    if joint.stiffness and joint.single:
        builder.add_spring({joint.name: 1.0}, joint.stiffness, joint.rest)
    elif joint.stiffness:
        builder.remark(Remark(f"joint {joint.name!r}", LEFT_OUT["ball/stiffness"]))


def _add_configurations(builder: ModelBuilder, model: Any, names: list[str]) -> None:
    found = {"qpos0": model.qpos0} | {model.key(k).name or f"key{k}": model.key_qpos[k] for k in range(model.nkey)}
    joints = [_joint(model, j, names[i], k) for i in range(1, model.nbody) for k, j in enumerate(_joints_of(model, i))]
    for name, qpos in found.items():
        positions: dict[str, Array] = {}
        at = 0
        for joint in joints:
            mine = np.array(qpos[at : at + COORDINATES[joint.kind]], float)
            at += len(mine)
            positions[joint.name] = np.concatenate([mine[3:], mine[:3]]) if joint.kind == "floating" else mine
        builder.add_configuration(name, positions)


def _disabled(model: Any) -> set[str]:
    """The forces that are turned off, whose bits moved between versions: as the library whose model this is has them."""
    bits = getattr(sys.modules.get("mujoco"), "mjtDisableBit", None)
    flags = int(model.opt.disableflags)
    found = {x for x in _FORCES if bits is not None and flags & int(getattr(bits, f"mjDSBL_{x.upper()}", 0))}
    return found | also_disabled(found)


def _text(model: Any, start: int) -> str:
    names = bytes(model.names)
    return names[start : names.index(b"\0", start)].decode("utf-8", "replace")
