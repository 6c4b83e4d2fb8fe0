"""Reader of models compiled by MuJoCo, by their attributes; ``mujoco`` is not imported."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.numbers import printed
from ..errors import ModelError
from ..lie import quaternion, se3
from ..model.builder import ModelBuilder
from ..model.description import Mimic, ModelNote
from ..model.model import OfferedClosure
from ..typing import Array
from .known_elements import LEFT_OUT
from .mjcf.bodies import WORLD, MjcfJoint
from .mjcf.drives import ALL, ANY, POINT, Drives, at_joint, effort_of, leaders_of
from .mjcf.preprocess import also_disabled
from .mjcf.reader import add_joints, add_keyframe, chain
from .xml import Element

_ON_JOINTS = (0, 1)
"""Values of ``mjtTrn``: at a joint, and at one in its parent's frame."""
_CONNECT, _WELD, _JOINT = 0, 1, 2
"""Values of ``mjtEq``."""
_BODY, _WRAP_JOINT = 1, 1
"""Values of ``mjtObj`` and ``mjtWrap``."""
_SLIDE = 2
"""Value of ``mjtJoint``: slides and hinges have one degree."""


def drives_of(model: Any, names: Sequence[str]) -> Drives:
    """Effort, armature and damping of the actuators at each hinge and slide, and notes.

    The effort is what the actuators give together, each gear times ``forcerange``, or of plain motors gear times ``ctrlrange``,
    as far as ``actuatorfrcrange`` of the joint lets it through.
    """
    found = Drives({}, {}, {}, [])
    forces: dict[int, Array] = {}
    for k in range(len(model.actuator_trntype)):
        j = int(model.actuator_trnid[k, 0])
        if int(model.actuator_trntype[k]) not in _ON_JOINTS or int(model.jnt_type[j]) < _SLIDE:
            found.remarks.append(ModelNote(_actuator(model, k), LEFT_OUT["actuator/joint"]))
            continue
        gear = _gear(model, k)
        forces[j] = forces.get(j, np.zeros(2)) + at_joint(_forces(model, k), gear)
        for what, mine in (("armature", found.armature), ("damping", found.damping)):
            values = getattr(model, f"actuator_{what}", None)  # older versions have none
            value = 0.0 if values is None else gear**2 * polynomial(model, f"actuator_{what}", k)[0]
            mine[names[j]] = mine.get(names[j], 0.0) + value
        if polynomial(model, "actuator_damping", k)[1:].any():
            found.remarks.append(ModelNote(_actuator(model, k), LEFT_OUT["actuator/damping"]))
    bounded = getattr(model, "jnt_actfrclimited", np.zeros(model.njnt))
    for j in range(model.njnt):
        given = forces.get(j, ANY)
        if int(model.jnt_type[j]) >= _SLIDE and bounded[j]:
            given = np.clip(given, *model.jnt_actfrcrange[j])
        effort, remark = effort_of(given)
        if remark and (j in forces or effort is not None):
            found.remarks.append(ModelNote(f"joint {names[j]!r}", remark))
        if effort is not None:
            found.efforts[names[j]] = effort
    return found


def _actuator(model: Any, k: int) -> str:
    return f"actuator {model.actuator(k).name or k} of MuJoCo's model"


def _gear(model: Any, k: int) -> float:
    """The first gear of an actuator; those with several outputs have several rows."""
    rows = getattr(model, "actuator_outadr", None)
    return float(model.actuator_gear[k if rows is None else rows[k], 0])


def polynomial(model: Any, field: str, i: int) -> Array:
    """The coefficients of a damping or a stiffness: the linear one, then those of higher order if MuJoCo has them."""
    values = getattr(model, field)
    more = getattr(model, f"{field}poly", None)
    rows = [np.reshape(x, (len(values), -1))[i] for x in (values, more) if x is not None]
    return np.concatenate(rows).astype(float)


def _forces(model: Any, k: int) -> Array:
    """Range of an actuator's force before its gear, infinite if it is not given."""
    force = ANY
    plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k] or model.actuator_dyntype[k])
    controls = getattr(model, "actuator_ctrladr", None)
    c = k if controls is None else int(controls[k])
    if plain and model.actuator_ctrllimited[c]:
        force = np.sort(float(model.actuator_gainprm[k, 0]) * np.array(model.actuator_ctrlrange[c], float))
    return np.clip(force, *model.actuator_forcerange[k]) if model.actuator_forcelimited[k] else force


def mimics_of(model: Any, names: Sequence[str]) -> tuple[dict[str, Mimic], list[str]]:
    """Joints that an equality makes follow another by a constant ratio, and notes on the others."""
    found: dict[str, Mimic] = {}
    remarks: list[str] = []
    for k in _active(model):
        if int(model.eq_type[k]) != _JOINT:
            continue
        follower, leader = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        c0, c1, *more = (float(x) for x in model.eq_data[k, :5])
        zero = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (follower, leader)]
        if leader < 0:
            remarks.append(
                f"an equality holds joint {names[follower]!r} at {printed(zero[0] + c0)}, which is left out: lock it"
            )
        elif any(more) or c1 == 0 or names[follower] in leaders_of(names[leader], found) or names[follower] in found:
            remarks.append(f"the equality of joints {names[follower]!r} and {names[leader]!r} is left out")
        else:
            found[names[follower]] = (names[leader], c1, zero[0] + c0 - c1 * zero[1])
    return found, remarks


def _active(model: Any) -> list[int]:
    active = getattr(model, "eq_active0", None)
    return [k for k in range(model.neq) if active is None or active[k]]


def add_closures(builder: ModelBuilder, model: Any, bodies: Sequence[str]) -> None:
    """Offer each loop that ``connect`` and ``weld`` close."""
    for n, k in enumerate(_active(model)):
        kind = int(model.eq_type[k])
        if kind == _JOINT:
            continue
        if kind not in (_CONNECT, _WELD):
            builder.remark(f"equality constraint {n} of MuJoCo's model is left out: it holds no bodies together")
            continue
        name = model.equality(k).name or f"{('connect', 'weld')[kind]}{n}"
        ends = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        data = np.array(model.eq_data[k], float)
        if int(model.eq_objtype[k]) == _BODY:
            first, second = data[0:3], data[3:6]
            T1, T2 = se3.pose(np.eye(3), first), se3.pose(np.eye(3), second)
            if kind == _WELD:  # the anchor is in the second body; the pose of the second, there, in the first
                T1, T2 = se3.pose(quaternion.rotation(data[6:10]), second), se3.pose(np.eye(3), first)
            frames = [
                builder.add_site(f"{name}:{bodies[i]}", bodies[i], T) for i, T in zip(ends, (T1, T2), strict=True)
            ]
        else:
            sites = [model.site(i).name for i in ends]
            frames = [next((x for x in (f"site:{s}", s) if x in builder.site_names), "") for s in sites]
        if all(frames):
            rows = POINT if kind == _CONNECT else ALL
            builder.add_closure(name, OfferedClosure(frames[0], frames[1], rows))
            builder.remark(
                f"equality {name!r} is left open: robot.close({frames[0]!r}, {frames[1]!r}, {rows!r}) closes it"
            )


def add_tendons(builder: ModelBuilder, model: Any, names: Sequence[str]) -> None:
    """Springs of the fixed tendons that have a stiffness, and a remark on whatever acts and is left out."""
    for t in range(model.ntendon):
        who = f"tendon {model.tendon(t).name or t} of MuJoCo's model"
        start = int(model.tendon_adr[t])
        parts = range(start, start + int(model.tendon_num[t]))
        stiffness, *more = polynomial(model, "tendon_stiffness", t)
        losses = ("tendon_damping", "tendon_dampingpoly", "tendon_frictionloss", "tendon_armature")
        lossy = any(np.any(getattr(model, what)[t]) for what in losses if hasattr(model, what))
        fixed = all(int(model.wrap_type[i]) == _WRAP_JOINT for i in parts)
        first, last = (float(x) for x in np.ravel(model.tendon_lengthspring[t])[[0, -1]])
        if fixed and stiffness and first == last and not any(more):
            terms: dict[str, float] = {}
            for i in parts:
                joint = names[int(model.wrap_objid[i])]
                terms[joint] = terms.get(joint, 0.0) + float(model.wrap_prm[i])
            builder.add_spring(terms, stiffness, first)
        elif any(more):
            builder.remark(ModelNote(who, LEFT_OUT["tendon/stiffness"]))
        elif stiffness:
            builder.remark(ModelNote(who, "has a spring that is left out"))
        if stiffness and np.any(getattr(model, "tendon_springyield", np.zeros(model.ntendon))[t]):
            builder.remark(ModelNote(who, LEFT_OUT["tendon/springyield"]))
        if lossy:
            builder.remark(ModelNote(who, "has damping, friction or armature, which is left out"))


# ── Reader of compiled models

_KINDS = ("floating", "ball", "prismatic", "revolute")
_SAID = ("free", "ball", "slide", "hinge")
_VELOCITIES = (6, 3, 1, 1)
_FORCES = ("gravity", "spring", "damper", "passive", "equality", "frictionloss", "constraint")


def read_mujoco_model(model: Any) -> ModelBuilder:
    """A builder filled with the bodies, joints, sites and keyframes of an ``mjModel``.

    Raises :class:`~twistwrench.ModelError` for an object without the attributes of one.
    """
    try:
        return _filled(model)
    except AttributeError as problem:
        raise ModelError(
            f"this is not a model of MuJoCo's: {type(model).__name__} lacks an attribute ({problem})."
        ) from None


def _filled(model: Any) -> ModelBuilder:
    builder = ModelBuilder(_text(model, 0) or "robot")
    disabled = _disabled(model)
    builder.gravity = [0.0] * 3 if "gravity" in disabled else np.array(model.opt.gravity).tolist()
    names = [WORLD, *(model.body(i).name or f"body{i}" for i in range(1, model.nbody))]
    taken = {model.joint(j).name for j in range(model.njnt)}
    called = _joint_names(model, names)
    drives = drives_of(model, called)
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
        taken.update(joint.name for joint in joints)
        for joint in joints:
            if joint.stiffness and not joint.single and "spring" not in disabled:
                joint.remarks.append(LEFT_OUT["ball/stiffness"])
        steps = chain(joints, names[int(model.body_parentid[i])], names[i], T)
        add_joints(builder, steps, names[i], drives, disabled, follow, taken)
    for i in range(model.nsite):
        if model.site(i).name:
            T = se3.pose(quaternion.rotation(model.site_quat[i]), model.site_pos[i])
            builder.add_site(model.site(i).name, names[int(model.site_bodyid[i])], T)
    _add_configurations(builder, model, names)
    if "spring" not in disabled:
        add_tendons(builder, model, called)
    if "equality" not in disabled:
        add_closures(builder, model, names)
    for text in (*more, *drives.remarks, *_left_out(model, names)):
        builder.remark(text)
    return builder


def _left_out(model: Any, names: list[str]) -> Iterator[ModelNote]:
    """Notes on mechanics of the bodies and the model that a robot leaves out."""
    if model.opt.density or model.opt.viscosity:
        yield ModelNote("<option> of MuJoCo's model", LEFT_OUT["option/density"])
    for i in range(1, model.nbody):
        if model.body_gravcomp[i]:
            yield ModelNote(f"body {names[i]!r}", LEFT_OUT["body/gravcomp"])
        if model.body_plugin[i] >= 0:
            yield ModelNote(f"the plugin of body {names[i]!r}", LEFT_OUT["body/plugin"])
    for f in range(getattr(model, "nflex", 0)):
        if not model.flex_rigid[f]:
            yield ModelNote(f"flex {f} of MuJoCo's model", LEFT_OUT["deformable/flex"])


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
    """Names of the joints; joints without a name are named as by the reader of files."""
    found = [""] * int(model.njnt)
    for i in range(1, model.nbody):
        for k, j in enumerate(_joints_of(model, i)):
            found[j] = _joint(model, j, bodies[i], k).name
    return found


def _add_configurations(builder: ModelBuilder, model: Any, names: list[str]) -> None:
    found = {"qpos0": model.qpos0} | {model.key(k).name or f"key{k}": model.key_qpos[k] for k in range(model.nkey)}
    joints = [_joint(model, j, names[i], k) for i in range(1, model.nbody) for k, j in enumerate(_joints_of(model, i))]
    for name, qpos in found.items():
        add_keyframe(builder, name, np.array(qpos, float), joints, {joint.name for joint in joints})


def _disabled(model: Any) -> set[str]:
    """Disabled forces; their bits are those of the imported version of MuJoCo."""
    bits = getattr(sys.modules.get("mujoco"), "mjtDisableBit", None)
    flags = int(model.opt.disableflags)
    found = {x for x in _FORCES if bits is not None and flags & int(getattr(bits, f"mjDSBL_{x.upper()}", 0))}
    return found | also_disabled(found)


def _text(model: Any, start: int) -> str:
    names = bytes(model.names)
    return names[start : names.index(b"\0", start)].decode("utf-8", "replace")
