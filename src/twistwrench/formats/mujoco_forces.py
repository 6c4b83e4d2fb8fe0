"""What acts between the bodies of a compiled MuJoCo model: actuators, fixed tendons, equality constraints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core.printed_numbers import printed
from ..lie import quaternion, se3
from ..model.builder import ModelBuilder
from ..model.closure import OfferedClosure
from ..model.description import Mimic
from ..model.remark import Remark
from ..typing import Array
from .known_elements import LEFT_OUT
from .mjcf.actuators import ANY, at_joint, effort_of
from .mjcf.equality import ALL, POINT, leaders_of

_ON_JOINTS = (0, 1)
"""Of ``mjtTrn``: at a joint, and at one in its parent's frame."""
_CONNECT, _WELD, _JOINT = 0, 1, 2
"""Of ``mjtEq``."""
_BODY, _WRAP_JOINT = 1, 1
"""Of ``mjtObj`` and ``mjtWrap``."""
_SLIDE = 2
"""Of ``mjtJoint``: slides and hinges have one degree."""


def drives_of(model: Any, names: Sequence[str]) -> tuple[dict[str, dict[str, float]], list[str]]:
    """What the actuators do at each hinge and slide: ``effort``, ``armature``, ``damping``; and remarks.

    The effort is what the actuators give together, each gear times ``forcerange``, or of plain motors gear times ``ctrlrange``,
    as far as ``actuatorfrcrange`` of the joint lets it through.
    """
    found: dict[str, dict[str, float]] = {}
    forces: dict[int, Array] = {}
    remarks: list[str] = []
    for k in range(len(model.actuator_trntype)):
        j = int(model.actuator_trnid[k, 0])
        if int(model.actuator_trntype[k]) not in _ON_JOINTS or int(model.jnt_type[j]) < _SLIDE:
            remarks.append(Remark(_actuator(model, k), LEFT_OUT["actuator/joint"]))
            continue
        gear = _gear(model, k)
        forces[j] = forces.get(j, np.zeros(2)) + at_joint(_forces(model, k), gear)
        mine = found.setdefault(names[j], {"armature": 0.0, "damping": 0.0})
        for what in ("armature", "damping"):
            values = getattr(model, f"actuator_{what}", None)  # older versions have none
            mine[what] += 0.0 if values is None else gear**2 * polynomial(model, f"actuator_{what}", k)[0]
        if polynomial(model, "actuator_damping", k)[1:].any():
            remarks.append(Remark(_actuator(model, k), LEFT_OUT["actuator/damping"]))
    bounded = getattr(model, "jnt_actfrclimited", np.zeros(model.njnt))
    for j in range(model.njnt):
        given = forces.get(j, ANY)
        if int(model.jnt_type[j]) >= _SLIDE and bounded[j]:
            given = np.clip(given, *model.jnt_actfrcrange[j])
        effort, remark = effort_of(given)
        if remark and (j in forces or effort is not None):
            remarks.append(Remark(f"joint {names[j]!r}", remark))
        if effort is not None:
            found.setdefault(names[j], {})["effort"] = effort
    return found, remarks


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
    """The least and the most that an actuator gives before its gear, infinite where that is not said."""
    force = ANY
    plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k] or model.actuator_dyntype[k])
    controls = getattr(model, "actuator_ctrladr", None)
    c = k if controls is None else int(controls[k])
    if plain and model.actuator_ctrllimited[c]:
        force = np.sort(float(model.actuator_gainprm[k, 0]) * np.array(model.actuator_ctrlrange[c], float))
    return np.clip(force, *model.actuator_forcerange[k]) if model.actuator_forcelimited[k] else force


def mimics_of(model: Any, names: Sequence[str]) -> tuple[dict[str, Mimic], list[str]]:
    """Joints that an equality makes follow another by a straight line; and remarks on the others."""
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
            builder.remark(Remark(who, LEFT_OUT["tendon/stiffness"]))
        elif stiffness:
            builder.remark(Remark(who, "has a spring that is left out"))
        if stiffness and np.any(getattr(model, "tendon_springyield", np.zeros(model.ntendon))[t]):
            builder.remark(Remark(who, LEFT_OUT["tendon/springyield"]))
        if lossy:
            builder.remark(Remark(who, "has damping, friction or armature, which is left out"))
