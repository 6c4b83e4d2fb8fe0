"""Reader of models compiled by MuJoCo, through their conversion to MJCF elements; ``mujoco`` is not imported.

The attributes of a compiled model are converted to elements, which :mod:`twistwrench.formats.mjcf` reads like a file.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import ModelError
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.description import ModelNote
from .known_elements import LEFT_OUT
from .mjcf import read_mjcf
from .mjcf.bodies import WORLD
from .mjcf.reader import REFERENCE
from .xml import Element, exact, new

_JOINT_TYPES = ("free", "ball", "slide", "hinge")
"""Joint types by ``mjtJoint``."""
_SLIDE = 2
"""Smallest ``mjtJoint`` of joints with one degree of freedom."""
_EQUALITY_TAGS = dict(enumerate(("connect", "weld", "joint", "tendon")))
"""Tags by ``mjtEq``; other values are for flexible bodies."""
_DC_MOTOR_GAIN = 3
"""Gain type (``mjtGain``) of DC motors, since version 4."""
_ON_JOINTS = (0, 1)
"""Values of ``mjtTrn`` for actuators on a joint, and on a joint in the parent's frame."""
_SLIDER_CRANK = 2
"""Value of ``mjtTrn`` for a slider-crank."""
_ON_TENDON = 3
"""Value of ``mjtTrn`` for an actuator on a tendon."""
_OBJECT_BODY = 1
"""Value of ``mjtObj`` for a body."""
_WRAP_JOINT = 1
"""Value of ``mjtWrap`` for a joint."""
_FLAGS = ("gravity", "spring", "damper", "passive", "equality", "frictionloss", "constraint")
"""Features of MuJoCo that a model can disable, and that the reader respects."""
_POLYNOMIAL_SIZE = 5
"""Number of coefficients of a joint equality."""


def read_mujoco_model(model: Any, floating_base: bool | None = None) -> tuple[ModelBuilder, bool]:
    """Builder with the bodies, joints, sites and keyframes of an ``mjModel``, and True if its root link is to float.

    ``floating_base`` has the same effect as for MJCF files.

    Raises :class:`~twistwrench.ModelError` if the object lacks the attributes of an ``mjModel``.
    """
    try:
        elements = _ModelElements(model)
    except AttributeError as problem:
        raise ModelError(
            f"this is not a model of MuJoCo's: {type(model).__name__} lacks an attribute ({problem})."
        ) from None
    builder, floating = read_mjcf(elements.root, floating_base=floating_base)
    builder.remark(*elements.notes)
    if floating_base is False:
        builder.mount()
    return builder, floating


class _ModelElements:
    """MJCF elements of one compiled model."""

    def __init__(self, model: Any) -> None:
        self.model = model
        model_name, _, _ = bytes(model.names).partition(b"\0")  # the first of all names
        self.root = new("mujoco", model=model_name.decode("utf-8", "replace"))
        self.notes: list[ModelNote] = []
        """Notes on properties that a file cannot have."""
        _add(self.root, "compiler", angle="radian", inertiafromgeom="false")
        options = {name: getattr(model.opt, name) for name in ("gravity", "density", "viscosity")}
        option = _add(self.root, "option", **options)
        disabled = _disabled_features(model)
        _add(option, "flag", **dict.fromkeys(disabled, "disable"))
        self.bodies = [new("worldbody", self.root)]
        self.joints = [""] * model.njnt
        """Names of joints. Unnamed joints have the names that the reader of MJCF gives them."""
        for i in range(1, model.nbody):
            self._add_body(i)
        for i in range(model.nsite):
            body = self.bodies[int(model.site_bodyid[i])]
            _add(body, "site", name=model.site(i).name, pos=model.site_pos[i], quat=model.site_quat[i])
        self._add_actuators(new("actuator", self.root))
        self._add_tendons(new("tendon", self.root))
        if "equality" not in disabled and "constraint" not in disabled:
            self._add_equalities(new("equality", self.root))
        self._add_keyframes(new("keyframe", self.root))
        deformable = new("deformable", self.root)
        for f in range(getattr(model, "nflex", 0)):  # newer versions of MuJoCo
            if not model.flex_rigid[f]:
                new("flex", deformable, name=str(f))

    def _add_keyframes(self, section: Element) -> None:
        """Add the reference configuration and the keyframes."""
        model = self.model
        if not model.nq:
            return
        configurations = {REFERENCE: model.qpos0}
        for k in range(model.nkey):
            name = model.key(k).name or f"key{k}"
            configurations[name] = model.key_qpos[k]
        for name, q in configurations.items():
            _add(section, "key", name=name, qpos=q)

    def _add_body(self, i: int) -> None:
        """Add body number i with its inertia and joints; bodies before i are there."""
        model = self.model
        name = model.body(i).name or f"body{i}"
        body = _add(
            self.bodies[int(model.body_parentid[i])], "body", name=name, pos=model.body_pos[i], quat=model.body_quat[i],
            gravcomp=model.body_gravcomp[i],
        )  # fmt: skip
        self.bodies.append(body)
        _add(
            body, "inertial", pos=model.body_ipos[i], quat=model.body_iquat[i], mass=model.body_mass[i],
            diaginertia=model.body_inertia[i],
        )  # fmt: skip
        if model.body_geomnum[i]:  # one geom stands for all, as inertias do not come from geoms
            new("geom", body)
        if model.body_plugin[i] >= 0:
            new("plugin", body)
        first_joint = int(model.body_jntadr[i])
        joint_count = int(model.body_jntnum[i])
        for k in range(joint_count):
            j = first_joint + k
            kind = _JOINT_TYPES[int(model.jnt_type[j])]
            suffix = ""  # of the name of an unnamed joint
            if joint_count > 1:
                suffix = str(k)
            self.joints[j] = model.joint(j).name or f"{name}.{kind}{suffix}"
            self._add_joint(body, j, kind)

    def _add_joint(self, body: Element, j: int, kind: str) -> None:
        """Add joint number j to its body; ``kind`` is its type in MJCF."""
        model = self.model
        name = self.joints[j]
        d = int(model.jnt_dofadr[j])  # first degree of freedom
        q = int(model.jnt_qposadr[j])  # first coordinate
        joint = _add(
            body, "joint", name=name, type=kind, pos=model.jnt_pos[j], range=model.jnt_range[j],
            limited=_flag(model.jnt_limited[j]), stiffness=_polynomial(model, "jnt_stiffness", j),
            springyield=_field(model, "jnt_springyield", j),
            damping=_polynomial(model, "dof_damping", d), frictionloss=model.dof_frictionloss[d],
            armature=model.dof_armature[d],
        )  # fmt: skip
        if int(model.jnt_type[j]) >= _SLIDE:
            _set(
                joint, axis=model.jnt_axis[j], ref=model.qpos0[q], springref=model.qpos_spring[q],
                actuatorfrclimited=_flag(_field(model, "jnt_actfrclimited", j)),
                actuatorfrcrange=_field(model, "jnt_actfrcrange", j),
            )  # fmt: skip
        is_of_joint = np.asarray(model.dof_jntid) == j
        armatures = model.dof_armature[is_of_joint]
        if np.ptp(armatures) > 0:  # different in each direction: only a program can set them, not a file
            text = "has another armature in each direction, of which the first is kept"
            self.notes.append(ModelNote(f"joint {name!r}", text))

    def _add_actuators(self, section: Element) -> None:
        """Add the actuators of joints with one degree of freedom, and notes on the others."""
        model = self.model
        for k in range(len(model.actuator_trntype)):
            name = model.actuator(k).name or str(k)
            j = int(model.actuator_trnid[k, 0])  # the joint, if the actuator is on one
            is_on_joint = int(model.actuator_trntype[k]) in _ON_JOINTS
            if not is_on_joint or int(model.jnt_type[j]) < _SLIDE:
                self.notes.append(ModelNote(f"actuator {name} of MuJoCo's model", LEFT_OUT["actuator/joint"]))
                self._add_other_drive(section, k, name)
                continue
            # Actuators with several outputs or controls have several rows of gears and ranges.
            gear_row = int(_field(model, "actuator_outadr", k, k))
            control_row = int(_field(model, "actuator_ctrladr", k, k))
            types = (model.actuator_gaintype[k], model.actuator_biastype[k], model.actuator_dyntype[k])
            gain_type = "fixed"  # the force is gain * control, if all types are 0
            if any(types):
                gain_type = "affine"
            control_attributes: dict[str, Any] = {}
            if control_row < len(model.actuator_ctrllimited):  # some actuators have no control
                control_attributes["ctrlrange"] = model.actuator_ctrlrange[control_row]
                control_attributes["ctrllimited"] = _flag(model.actuator_ctrllimited[control_row])
            tag = "general"
            motor_attributes: dict[str, ArrayLike] = {}
            if int(model.actuator_gaintype[k]) == _DC_MOTOR_GAIN:
                tag = "dcmotor"
                motor_attributes = self._motor_attributes(k)
            _add(
                section, tag, name=name, joint=self.joints[j], gear=model.actuator_gear[gear_row, 0], **motor_attributes,
                gaintype=gain_type, gainprm=model.actuator_gainprm[k, 0], **control_attributes,
                forcelimited=_flag(model.actuator_forcelimited[k]), forcerange=model.actuator_forcerange[k],
                armature=_field(model, "actuator_armature", k), damping=_polynomial(model, "actuator_damping", k),
            )  # fmt: skip

    def _add_other_drive(self, section: Element, k: int, name: str) -> None:
        """Add an actuator of a tendon or slider-crank. The reader takes only the driven joints from it."""
        model = self.model
        transmission = int(model.actuator_trntype[k])
        target = int(model.actuator_trnid[k, 0])  # index of the tendon or site
        if transmission == _ON_TENDON:
            _add(section, "general", name=name, tendon=model.tendon(target).name or str(target))
        elif transmission == _SLIDER_CRANK:
            _add(section, "general", name=name, cranksite=str(target))

    def _motor_attributes(self, k: int) -> dict[str, ArrayLike]:
        """Attributes of a ``dcmotor`` from the parameters of its compiled gain, bias and dynamics.

        The nominal voltage is not among them.
        """
        gain = self.model.actuator_gainprm[k]
        bias = self.model.actuator_biasprm[k]
        dynamics = self.model.actuator_dynprm[k]
        return {
            "resistance": gain[0],
            "motorconst": (gain[1], 0.0),
            "inductance": (0.0, dynamics[0]),
            "cogging": bias[:3],
            "thermal": dynamics[2:5],
            "lugre": (*dynamics[5:7], *bias[3:6]),
            "controller": (0.0, 0.0, 0.0, 0.0, 0.0, gain[7]),  # only its last parameter is in the gain
        }

    def _add_tendons(self, section: Element) -> None:
        """Add the tendons; a tendon on joints gets its joints."""
        model = self.model
        for t in range(model.ntendon):
            first_wrap = int(model.tendon_adr[t])
            wraps = range(first_wrap, first_wrap + int(model.tendon_num[t]))
            is_on_joints = all(int(model.wrap_type[i]) == _WRAP_JOINT for i in wraps)
            spring_lengths = np.ravel(model.tendon_lengthspring[t])  # one, or the ends of a range
            tendon = _add(
                section, "fixed" if is_on_joints else "spatial", name=model.tendon(t).name or str(t),
                stiffness=_polynomial(model, "tendon_stiffness", t), springyield=_field(model, "tendon_springyield", t),
                springlength=spring_lengths[[0, -1]], damping=_polynomial(model, "tendon_damping", t),
                frictionloss=_field(model, "tendon_frictionloss", t), armature=_field(model, "tendon_armature", t),
            )  # fmt: skip
            if is_on_joints:
                for i in wraps:
                    _add(tendon, "joint", joint=self.joints[int(model.wrap_objid[i])], coef=model.wrap_prm[i])

    def _add_equalities(self, section: Element) -> None:
        """Add the active equality constraints; without one of the sites, a loop is left out."""
        model = self.model
        is_active = getattr(model, "eq_active0", None)  # newer versions of MuJoCo
        active_indices = [k for k in range(model.neq) if is_active is None or is_active[k]]
        for number, k in enumerate(active_indices):
            kind = _EQUALITY_TAGS.get(int(model.eq_type[k]), "flex")
            a, b = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])  # joints, bodies or sites
            name = model.equality(k).name or f"{kind}{number}"
            attributes: dict[str, Any] = {}
            if kind == "joint":
                leader = self.joints[b] if b >= 0 else ""
                coefficients = model.eq_data[k, :_POLYNOMIAL_SIZE]
                attributes = {"joint1": self.joints[a], "joint2": leader, "polycoef": coefficients}
            elif kind in ("connect", "weld"):
                if int(model.eq_objtype[k]) == _OBJECT_BODY:
                    sites = self._add_sites_at_bodies(name, kind, (a, b), model.eq_data[k])
                else:
                    sites = [model.site(a).name, model.site(b).name]
                site1, site2 = sites
                if not site1 or not site2:  # a site without a name
                    continue
                attributes = {"site1": site1, "site2": site2}
            _add(section, kind, name=name, **attributes)

    def _add_sites_at_bodies(self, name: str, kind: str, bodies: tuple[int, int], data: Any) -> list[str]:
        """Add a site at each of two bodies, and return the names of the sites; the constraint makes the sites coincide.

        The data of a ``connect`` are the positions of its anchor in both bodies. The data of a ``weld`` are the position of
        its anchor in the second body, and the pose in the first body of a frame at the anchor with the second body's axes.
        """
        identity = (1.0, 0.0, 0.0, 0.0)  # quaternion
        if kind == "connect":
            poses = ((data[0:3], identity), (data[3:6], identity))
        else:
            poses = ((data[3:6], data[6:10]), (data[0:3], identity))
        elements = [self.bodies[i] for i in bodies]
        sites = [f"{name}:{element.attributes.get('name', WORLD)}" for element in elements]
        for element, site, (pos, quat) in zip(elements, sites, poses, strict=True):
            _add(element, "site", name=site, pos=pos, quat=quat)
        return sites


def _add(parent: Element, tag: str, **values: Any) -> Element:
    """Add an element with the attributes that are not None; numbers are written exactly."""
    return _set(new(tag, parent), **values)


def _set(element: Element, **values: Any) -> Element:
    """Set the attributes that are not None, and return the element."""
    for name, value in values.items():
        if value is not None:
            if not isinstance(value, str):
                value = exact(value)
            element.attributes[name] = value
    return element


def _flag(flag: Any) -> str:
    """Text of a flag in MJCF."""
    return "true" if flag else "false"


def _field(model: Any, name: str, i: int, default: Any = None) -> Any:
    """Entry i of a field; ``default`` if this version of MuJoCo does not have the field."""
    values = getattr(model, name, None)
    if values is None:
        return default
    return values[i]


def _polynomial(model: Any, name: str, i: int) -> ArrayLike:
    """Linear coefficient of a damping or stiffness.

    If there are higher orders (newer versions of MuJoCo), a second coefficient of 1 stands for them: the reader notes them.
    """
    linear, *higher = np.ravel(_field(model, name, i, ()))
    higher.extend(np.ravel(_field(model, f"{name}poly", i, ())))
    if any(higher):
        return linear, 1.0
    return linear


def _disabled_features(model: Any) -> list[str]:
    """Names of disabled features. Bits differ between versions of MuJoCo, so those of the imported version are used."""
    bits = getattr(sys.modules.get("mujoco"), "mjtDisableBit", None)
    if bits is None:
        return []
    flags = int(model.opt.disableflags)
    return [name for name in _FLAGS if flags & int(getattr(bits, f"mjDSBL_{name.upper()}", 0))]
