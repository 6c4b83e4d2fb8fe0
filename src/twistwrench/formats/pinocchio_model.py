"""Reader of Pinocchio models through their attributes, without importing ``pinocchio``, and writer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.errors import MissingExtraError, ModelError
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints import Joint
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.couplings import joint_effort
from ..mechanics.model.description import Mimic, unused
from ..mechanics.model.model import BASE, Model
from ..mechanics.model.parts import disassemble
from .urdf import known_limits
from .writers.written import Losses, configurations_of, drive_of, screw_of, translation

UNIVERSE = "universe"
"""Name of the link of Pinocchio's joint 0, which is fixed in the world."""
_TYPE_PREFIX = "JointModel"
"""Beginning of the names of Pinocchio's joint types."""
_FREE_JOINT = "FreeFlyer"
"""Joint type of a free body."""
_SINGLE_JOINTS = {_FREE_JOINT: "floating", "Spherical": "ball", "Planar": "planar"}
"""Joint types with several velocities that become one joint."""
_SEVERAL_JOINTS = ("SphericalZYX", "Translation", "Universal")
"""Joint types that become several joints of one degree."""
_SITE_FRAME_TYPES = ("OP_FRAME", "SENSOR")
"""Types of frames that become sites."""


@dataclass(frozen=True, eq=False)
class _Step:
    """One joint of the model: a Pinocchio joint, or one of the parts that it becomes."""

    kind: str
    axis: Array | None
    """Screw axis (6,) of one-degree joints, angular part first."""
    T: Array
    """Pose in the frame of the previous part; for the first part, in the frame of the Pinocchio joint."""
    nq: int
    """Number of coordinates in Pinocchio."""
    nv: int
    """Number of velocities in Pinocchio."""


def read_pinocchio_model(model: Any, floating_base: bool | None = None) -> tuple[ModelBuilder, bool]:
    """Builder with the joints, inertias and frames of a ``pinocchio.Model``, and True if its root link shall float.

    ``floating_base`` None follows the model. True lets the root link float unless the model has a free joint to the
    universe. False fixes the bodies of such joints at the placements of the joints.

    Raises :class:`~twistwrench.ModelError` if the object lacks the attributes of a model, and for unsupported joints.
    """
    try:
        free_roots = _free_roots(model)
        fixed_joints = set[int]()
        if floating_base is False:
            fixed_joints = free_roots
        builder = _fill_builder(model, fixed_joints)
    except AttributeError as problem:
        raise ModelError(
            f"this is not a model of Pinocchio's: {type(model).__name__} lacks an attribute ({problem})."
        ) from None
    if floating_base is False:
        builder.mount()
    return builder, bool(floating_base) and not free_roots


def _free_roots(model: Any) -> set[int]:
    """Indices of the free joints to the universe."""
    roots = [j for j in range(1, model.njoints) if int(model.parents[j]) == 0]
    return {j for j in roots if _joint_type(model.joints[j]) == _FREE_JOINT}


def _joint_type(joint: Any) -> str:
    """Type of a Pinocchio joint without its prefix, such as ``FreeFlyer``."""
    return str(joint.shortname()).removeprefix(_TYPE_PREFIX)


def _fill_builder(model: Any, fixed_joints: Set[int]) -> ModelBuilder:
    """Builder of a model in which the joints ``fixed_joints`` do not move."""
    names = list(model.names)
    builder = ModelBuilder(str(model.name) or "robot")
    builder.gravity = np.array(model.gravity.linear, float).tolist()
    links = _link_names(model)
    builder.add_link(links[0], _spatial_inertia(model.inertias[0]))
    for j in range(1, model.njoints):
        if j in fixed_joints:
            builder.add_link(links[j], _spatial_inertia(model.inertias[j]))
            placement = np.array(model.jointPlacements[j].homogeneous)
            builder.add_joint(names[j], "fixed", links[0], links[j], placement=placement)
        else:
            _add_joint(builder, model, j, names, links)
    _add_frames(builder, model, links)
    configurations = getattr(model, "referenceConfigurations", ())
    for item in configurations:
        q = np.array(item.data(), float)
        if q.shape == (model.nq,):
            _add_configuration(builder, str(item.key()), q, model, names, fixed_joints)
    return builder


def _link_names(model: Any) -> list[str]:
    """Name of the link of each joint: the name of the first body frame that coincides with the joint, or a new name."""
    names = [""] * model.njoints
    body_frames = [frame for frame in model.frames if _frame_type(frame) == "BODY"]
    for frame in body_frames:
        j = int(frame.parentJoint)
        if not names[j] and np.array_equal(frame.placement.homogeneous, np.eye(4)):
            names[j] = str(frame.name)
    used_names = {str(frame.name) for frame in body_frames}
    for j, name in enumerate(names):
        if not name:
            new_name = UNIVERSE
            if j > 0:
                new_name = f"{model.names[j]}.body"
            names[j] = unused(new_name, used_names)
    return names


def _frame_type(frame: Any) -> str:
    """Type of a frame, such as ``BODY`` for ``FrameType.BODY``."""
    _, _, name = str(frame.type).rpartition(".")
    return name


def _spatial_inertia(inertia: Any) -> SpatialInertia:
    return SpatialInertia.from_com(float(inertia.mass), np.array(inertia.lever), np.array(inertia.inertia))


def _add_joint(builder: ModelBuilder, model: Any, j: int, names: Sequence[str], links: Sequence[str]) -> None:
    """Add joint j and its link. A joint that becomes several gets hidden links without mass between its parts."""
    joint = model.joints[j]
    name = names[j]
    parent = links[int(model.parents[j])]
    T = np.array(model.jointPlacements[j].homogeneous)
    mimic = _mimic(model, j, names)
    steps = list(_steps(joint, name))
    q_index = int(joint.idx_q)
    v_index = int(joint.idx_v)
    for k, step in enumerate(steps):
        if k == len(steps) - 1:
            child = links[j]
            builder.add_link(child, _spatial_inertia(model.inertias[j]))
        else:
            child = f"{links[j]}:{name}.{k}"
            builder.add_link(child, hidden=True)
        options: dict[str, Any] = {}
        if not mimic:
            options = _limits_and_losses(model, q_index, v_index, step)
        axis: Any = (0.0, 0.0, 1.0)
        if step.axis is not None:
            axis = step.axis
        step_name = _step_name(name, k, len(steps))
        builder.add_joint(step_name, step.kind, parent, child, placement=T @ step.T, axis=axis, mimic=mimic, **options)
        if step.kind in ("floating", "planar") and options.get("armature"):
            remark = "has an armature, whose products of velocities Pinocchio leaves out, and which count here"
            builder.note(f"joint {name!r}", remark)
        parent = child
        T = np.eye(4)  # only the first part is at the pose of the Pinocchio joint
        q_index += step.nq
        v_index += step.nv


def _step_name(name: str, k: int, count: int) -> str:
    """Name of part k of a Pinocchio joint with ``count`` parts."""
    if count == 1:
        return name
    return f"{name}.{k}"


def _mimic(model: Any, j: int, names: Sequence[str]) -> Mimic | None:
    """Name of the leader, ratio and offset of a joint; None if it is not a mimic joint."""
    followers = list(getattr(model, "mimicking_joints", ()))
    if j not in followers:
        return None
    leader = int(model.mimicked_joints[followers.index(j)])
    mimic_joint = model.joints[j].extract()
    return names[leader], float(mimic_joint.scaling), float(mimic_joint.offset)


def _steps(joint: Any, name: str, T: Array | None = None) -> Iterator[_Step]:
    """Joints of the model that a Pinocchio joint becomes, from its type and motion subspace.

    ``T`` is the pose of the joint within a composite joint, by default the identity.
    """
    kind = _joint_type(joint)
    if T is None:
        T = np.eye(4)
    if kind in _SINGLE_JOINTS:
        yield _Step(_SINGLE_JOINTS[kind], None, T, int(joint.nq), int(joint.nv))
    elif kind == "Composite":
        composite = joint
        if hasattr(joint, "extract"):
            composite = joint.extract()
        for part, placement in zip(composite.joints, composite.jointPlacements, strict=True):
            yield from _steps(part, name, T @ np.array(placement.homogeneous))
            T = np.eye(4)  # only the first part is at T: each other part is placed relative to the part before
    elif kind == "Mimic":
        # Pinocchio's subspace of a mimic joint has its ratio, which the builder takes from ``mimic``.
        S = _motion_subspace(joint, np.zeros(1)) / float(joint.extract().scaling)
        step_kind, axis = _kind_and_axis(S[:, 0], endless=False)
        yield _Step(step_kind, axis, T, nq=0, nv=0)
    elif kind in _SEVERAL_JOINTS:
        for column in _motion_subspace(joint, np.zeros(int(joint.nq))).T:
            step_kind, axis = _kind_and_axis(column, endless=False)
            yield _Step(step_kind, axis, T, nq=1, nv=1)
            T = np.eye(4)
    elif int(joint.nv) == 1:
        endless = int(joint.nq) == 2
        q_zero = np.zeros(1)
        if endless:
            q_zero = np.array([1.0, 0.0])  # cosine and sine of the angle
        column = _motion_subspace(joint, q_zero)[:, 0]
        step_kind, axis = _kind_and_axis(column, endless=endless)
        yield _Step(step_kind, axis, T, nq=int(joint.nq), nv=1)
    else:
        raise ModelError(f"joint {name!r} of Pinocchio's model is a {_TYPE_PREFIX}{kind}, which is not read.")


def _motion_subspace(joint: Any, q: Array) -> Array:
    """Motion subspace S (6, nv), angular part first, at coordinates q (nq,) of the joint."""
    first_coordinate = max(int(joint.idx_q), 0)  # idx_q is -1 for a joint that is not in a model
    data = joint.createData()
    joint.calc(data, np.concatenate([np.zeros(first_coordinate), q]))  # calc expects the coordinates of the whole model
    S = np.array(data.S, float).reshape(6, -1)
    linear, angular = S[:3], S[3:]  # Pinocchio's order
    return np.concatenate([angular, linear])


def _kind_and_axis(axis: Array, *, endless: bool) -> tuple[str, Array]:
    """Type of a one-degree joint with a screw axis (6,), angular part first, and this axis."""
    w, v = axis[:3], axis[3:]
    if not w.any():
        return "prismatic", axis
    if abs(float(w @ v)) > 0:
        return "helical", axis
    if endless:
        return "continuous", axis
    return "revolute", axis


def _limits_and_losses(model: Any, q_index: int, v_index: int, step: _Step) -> dict[str, Any]:
    """Limits, friction and armature of a joint, as options of the builder; joints of several degrees get no limits."""
    own_entries = slice(v_index, v_index + step.nv)
    losses: dict[str, Any] = {}
    for name in ("damping", "friction", "armature"):
        values = getattr(model, name, None)
        losses[name] = 0.0
        if values is not None:
            losses[name] = float(np.mean(np.array(values)[own_entries]))
    if step.nv > 1:
        return losses
    limits = {}
    for name in ("velocity", "effort"):
        limit = float(getattr(model, f"{name}Limit")[v_index])
        if limit > 0:
            limits[name] = limit
    if step.nq == 1:
        limits["lower"] = float(model.lowerPositionLimit[q_index])
        limits["upper"] = float(model.upperPositionLimit[q_index])
    return losses | known_limits(**limits)


def _add_frames(builder: ModelBuilder, model: Any, links: Sequence[str]) -> None:
    """Add body frames that are not a joint's link as fixed links, and operational and sensor frames as sites."""
    for frame in model.frames:
        link = links[int(frame.parentJoint)]
        name = str(frame.name)
        T = np.array(frame.placement.homogeneous)
        is_new_site = {name, f"site:{name}"}.isdisjoint(builder.site_names)  # a site has either name
        if _frame_type(frame) == "BODY" and name not in builder.link_names:
            builder.add_link(name)
            builder.add_joint(f"{name}.fixed", "fixed", link, name, placement=T)
        elif _frame_type(frame) in _SITE_FRAME_TYPES and is_new_site:
            builder.add_site(name, link, T)


def _add_configuration(
    builder: ModelBuilder, label: str, q: Array, model: Any, names: Sequence[str], fixed_joints: Set[int]
) -> None:
    """Add a named configuration q (nq,) of Pinocchio, in the coordinates of the builder's joints."""
    from ..mechanics.joints import JOINT_TYPES

    positions: dict[str, Array] = {}
    for j in sorted(set(range(1, model.njoints)) - fixed_joints):
        first_coordinate = int(model.joints[j].idx_q)
        steps = list(_steps(model.joints[j], names[j]))
        for k, step in enumerate(steps):
            coordinates = q[first_coordinate : first_coordinate + step.nq]
            first_coordinate += step.nq
            if step.kind in ("ball", "floating"):
                joint = JOINT_TYPES[step.kind]("", np.zeros((0, 6)))  # used for its conversion only
                coordinates = joint.from_pinocchio(coordinates)
            elif step.nq > step.nv:  # the angle is stored as cosine and sine
                *others, cosine, sine = coordinates
                coordinates = np.append(others, math.atan2(sine, cosine))
            if step.nq:
                positions[_step_name(names[j], k, len(steps))] = coordinates
    builder.add_configuration(label, positions)


_NAMES_IN_PINOCCHIO = {"floating": "JointModelFreeFlyer", "ball": "JointModelSpherical", "planar": "JointModelPlanar"}
"""Pinocchio's classes of the joints with several velocities."""


def pinocchio_of(model: Model) -> tuple[Any, tuple[str, ...]]:
    """``pinocchio.Model`` of a model, and sentences about what it lacks. Mimic joints become independent joints.

    Raises :class:`~twistwrench.MissingExtraError`, and :class:`~twistwrench.ModelError` for a joint that Pinocchio
    lacks.
    """
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.from_extra("pin", "peers", "A model of Pinocchio's") from None
    parts = disassemble(model)
    losses = Losses()
    losses.note_couplings(parts)
    pin_model = pinocchio.Model()
    pin_model.name = model.name
    pin_model.gravity.linear = np.array(model.gravity)
    joint_parts = {joint.name: joint for joint in parts.joints}
    frames: dict[int, tuple[int, Array]] = {BASE: (0, np.eye(4))}
    """Pinocchio joint number of each body, and the pose of the body's frame in that joint."""
    numbers: dict[str, int] = {}
    """Pinocchio joint number by name of the joint."""
    for i, body in enumerate(model.bodies):
        if not body.joint.moves_body:
            continue
        joint_part = joint_parts.get(body.joint.name)
        screw = None
        if joint_part is not None and body.joint.nv == 1:
            screw = screw_of(joint_part)
        pin_joint, point = _pinocchio_joint(pinocchio, body.joint, screw)
        parent, T_parent = frames[body.parent]
        placement = T_parent @ body.placement @ translation(point)
        j = pin_model.addJoint(parent, pin_joint, _se3(pinocchio, placement), body.joint.name)
        pin_model.addJointFrame(j)
        numbers[body.joint.name] = j
        frames[i] = j, translation(-point)
        G = parts.whole[body.link].in_frame(translation(-point))
        pin_model.appendBodyToJoint(j, _inertia_of_pinocchio(pinocchio, G), pinocchio.SE3.Identity())
        _, velocities = body.places
        if body.joint.nv > 1 and model.armature[velocities].any():
            losses.note_joint(body.joint.name, "has an armature, whose products of velocities Pinocchio leaves out")
        if body.follows:
            losses.note_joint(body.joint.name, "follows another one here, and is a joint like any other there")
    for name, frame in model.frames.items():
        j, T = frames[frame.body]
        pin_model.addBodyFrame(name, j, _se3(pinocchio, T @ frame.pose), 0)
    for name, frame in model.sites.items():
        j, T = frames[frame.body]
        kind = pinocchio.FrameType.OP_FRAME
        placement = _se3(pinocchio, T @ frame.pose)
        pin_model.addFrame(pinocchio.Frame(name.removeprefix("site:"), j, 0, placement, kind))
    _add_limits(pin_model, model, numbers)
    for name in model.joint_names:
        if name in numbers:
            _add_drive(pin_model, numbers[name], drive_of(parts, name, losses))
    for name, positions in configurations_of(parts).items():
        pin_model.referenceConfigurations[name] = _pinocchio_q(pin_model, model, numbers, positions)
    lost_counts = {"spring": len(parts.additions.springs), "closure": len(parts.additions.closures)}
    for noun, count in lost_counts.items():
        if count == 1:
            losses.say(f"1 {noun} of the robot: Pinocchio's models have none")
        elif count > 1:
            losses.say(f"{count} {noun}s of the robot: Pinocchio's models have none")
    return pin_model, tuple(losses.found)


def _pinocchio_joint(pinocchio: Any, joint: Joint, screw: Any) -> tuple[Any, Array]:
    """Pinocchio joint, and the position of its axis in the frame of the model's joint.

    ``screw`` is the :class:`Screw` of a joint with one degree of freedom, and None for others.
    """
    joint.require_pinocchio()
    if joint.kind in _NAMES_IN_PINOCCHIO:
        joint_type = getattr(pinocchio, _NAMES_IN_PINOCCHIO[joint.kind])
        return joint_type(), np.zeros(3)
    # letter of the coordinate axis along which the joint's axis lies; empty without one
    letter = ""
    for axis_letter, unit_vector in zip("XYZ", np.eye(3), strict=True):
        if np.array_equal(unit_vector, screw.direction):
            letter = axis_letter
    if screw.pitch and letter:
        joint_type = getattr(pinocchio, f"JointModelH{letter}")
        return joint_type(screw.pitch), screw.point
    if screw.pitch:
        return pinocchio.JointModelHelicalUnaligned(screw.direction, screw.pitch), screw.point
    if letter:
        kind = "P"
        if screw.turns and joint.wraps:
            kind = "RUB"
        elif screw.turns:
            kind = "R"
        joint_type = getattr(pinocchio, f"JointModel{kind}{letter}")
        return joint_type(), screw.point
    if screw.turns:  # the unbounded joint type does not accept an axis in Python
        return pinocchio.JointModelRevoluteUnaligned(screw.direction), screw.point
    return pinocchio.JointModelPrismaticUnaligned(screw.direction), screw.point


def _se3(pinocchio: Any, T: Array) -> Any:
    return pinocchio.SE3(np.array(T[:3, :3]), np.array(T[:3, 3]))


def _inertia_of_pinocchio(pinocchio: Any, G: SpatialInertia) -> Any:
    return pinocchio.Inertia(float(G.mass), np.array(G.com), np.array(G.moment_about_com))


def _add_limits(pin_model: Any, model: Model, numbers: dict[str, int]) -> None:
    """Set limits of position, velocity and effort; free bodies keep infinite limits. ``numbers``: joint numbers by name."""
    limits = model.limits
    position_limits = {"lowerPositionLimit": limits.lower, "upperPositionLimit": limits.upper}
    velocity_and_effort = {"velocityLimit": limits.velocity, "effortLimit": joint_effort(model, limits.effort)}
    arrays = {}
    for name in (*position_limits, *velocity_and_effort):
        arrays[name] = np.array(getattr(pin_model, name), float)
    for body in model.leaders:
        if body.joint.name not in numbers:
            continue
        joint = pin_model.joints[numbers[body.joint.name]]
        own_entries = slice(joint.idx_v, joint.idx_v + joint.nv)
        order = list(body.joint.pinocchio_order)
        _, velocities = body.places
        for name, values in velocity_and_effort.items():
            own_values = values[velocities]
            arrays[name][own_entries] = own_values[order]
        if joint.nq == 1:
            for name, values in position_limits.items():
                arrays[name][joint.idx_q] = values[body.v_index]
    for name, array in arrays.items():
        setattr(pin_model, name, array)


def _add_drive(pin_model: Any, j: int, drive: Any) -> None:
    """Set damping, friction and armature of joint j from those along the joint."""
    joint = pin_model.joints[j]
    own_entries = slice(joint.idx_v, joint.idx_v + joint.nv)
    for name in ("damping", "friction", "armature"):
        array = np.array(getattr(pin_model, name), float)
        array[own_entries] = getattr(drive, name)
        setattr(pin_model, name, array)


def _pinocchio_q(pin_model: Any, model: Model, numbers: dict[str, int], positions: dict[str, Array]) -> Array:
    """Pinocchio's coordinates q (nq,) for positions by joint; mimic joints follow their leaders."""
    q = np.zeros(pin_model.nq)
    leaders = {body.v_index: body for body in model.leaders}
    for body in model.bodies:
        if body.joint.name not in numbers:
            continue
        joint = pin_model.joints[numbers[body.joint.name]]
        if body.follows:
            leader = leaders[body.v_index].joint.name
            coordinates = body.ratio * positions[leader] + body.offset
        else:
            coordinates = positions[body.joint.name]
        if body.joint.quaternion is not None:
            coordinates = body.joint.to_pinocchio(coordinates)
        elif joint.nq > joint.nv:  # Pinocchio stores the last coordinate, an angle, as cosine and sine
            angle = coordinates[-1]
            coordinates = np.append(coordinates[:-1], [np.cos(angle), np.sin(angle)])
        q[joint.idx_q : joint.idx_q + joint.nq] = coordinates
    return q
