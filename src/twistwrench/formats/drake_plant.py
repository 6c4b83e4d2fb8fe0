"""A plant of Drake's, by its methods: ``pydrake`` is not imported."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import ModelError
from ..lie import se3, so3
from ..lie.adjoint import Ad
from ..model.builder import ModelBuilder
from ..typing import Array

WORLD = "world"
_WHOLE = {"ball_rpy": "ball", "quaternion_floating": "floating", "rpy_floating": "floating", "planar": "planar"}
_SINGLE = {
    "revolute": ("revolute", "revolute_axis"),
    "prismatic": ("prismatic", "translation_axis"),
    "screw": ("helical", "screw_axis"),
}


@dataclass(frozen=True, eq=False)
class _Names:
    """What bodies and joints are called: by their own names, with the model instance's before where several share one."""

    plant: Any
    shared: Counter[str]

    @classmethod
    def of(cls, plant: Any, parts: list[Any]) -> _Names:
        return cls(plant, Counter(str(part.name()) for part in parts))

    def __call__(self, part: Any) -> str:
        name = str(part.name())
        instance = self.plant.GetModelInstanceName(part.model_instance())
        return name if self.shared[name] < 2 else f"{instance}::{name}"


def read_drake_plant(plant: Any) -> ModelBuilder:
    """A builder filled with the bodies, joints, frames and actuators of a ``MultibodyPlant``, finalised.

    Raises :class:`~twistwrench.ModelError` for what is no such plant, and for joints that are none here.
    """
    try:
        return _DrakeReader(plant).read()
    except AttributeError as problem:
        raise ModelError(
            f"this is no plant of Drake's: {type(plant).__name__} has not what one has ({problem})."
        ) from None


class _DrakeReader:
    """One plant on its way into a builder."""

    def __init__(self, plant: Any) -> None:
        self.plant = plant
        if not plant.is_finalized():
            raise ModelError(
                "the plant is not finalised, so free bodies have no joints yet. Call plant.Finalize() first."
            )
        world = plant.world_body()
        index = type(world.index())
        self.bodies = [plant.get_body(index(i)) for i in range(plant.num_bodies())]
        self.joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        self.body_name = _Names.of(plant, self.bodies)
        self.joint_name = _Names.of(plant, self.joints)
        # The last body's model names the robot: the first two models are the world's and the default one.
        self.builder = ModelBuilder(str(plant.GetModelInstanceName(self.bodies[-1].model_instance())))
        self.builder.gravity = np.array(plant.gravity_field().gravity_vector(), float).tolist()

    def read(self) -> ModelBuilder:
        """Bodies in the plant's order, then joints, then frames."""
        for k, body in enumerate(self.bodies):
            self.builder.add_link(WORLD if k == 0 else self.body_name(body), None if k == 0 else _inertia(body))
        drives = dict(self._drives())
        for joint in self.joints:
            self._add(joint, drives.get(self.joint_name(joint), (None, 0.0)))
        self._add_frames()
        if n := int(self.plant.num_constraints()):
            self.builder.remark(f"Drake's plant has {n} constraints, which are left out")
        forces = int(self.plant.num_force_elements()) - 1  # gravity is one of them
        if forces > 0:
            self.builder.remark(f"Drake's plant has {forces} force elements, such as springs, which are left out")
        return self.builder

    def _drives(self) -> Iterator[tuple[str, tuple[float | None, float]]]:
        """Of each joint with an actuator: the most it gives, and its reflected inertia."""
        for i in self.plant.GetJointActuatorIndices():
            actuator = self.plant.get_joint_actuator(i)
            most = float(actuator.effort_limit())
            inertia = float(actuator.default_rotor_inertia()) * float(actuator.default_gear_ratio()) ** 2
            yield self.joint_name(actuator.joint()), (most if 0 < most < math.inf else None, inertia)

    def _link(self, body: Any) -> str:
        return WORLD if int(body.index()) == 0 else self.body_name(body)

    def _add(self, joint: Any, drive: tuple[float | None, float]) -> None:
        name, kind = self.joint_name(joint), str(joint.type_name())
        parent, child = self._link(joint.parent_body()), self._link(joint.child_body())
        T_pf = _pose(joint.frame_on_parent())
        T_bm = _pose(joint.frame_on_child())
        T_mb = np.asarray(se3.inverse(T_bm))
        if kind == "weld":
            T = T_pf @ np.array(joint.X_FM().GetAsMatrix4()) @ T_mb
            self.builder.add_joint(name, "fixed", parent, child, placement=T)
        elif kind in _SINGLE:
            ours, axis = _SINGLE[kind]
            direction = np.array(getattr(joint, axis)(), float) if hasattr(joint, axis) else self._turned(joint)
            self._add_axis(joint, name, ours, 0, parent, child, T_pf @ T_mb, T_bm, direction, drive)
        elif kind == "universal":
            middle = self._hidden(child, name)
            for k, (above, below, T) in enumerate(((parent, middle, T_pf @ T_mb), (middle, child, np.eye(4)))):
                self._add_axis(joint, f"{name}.{k}", "revolute", k, above, below, T, T_bm, np.eye(3)[k], (None, 0.0))
        elif kind in _WHOLE:
            options: dict[str, Any] = {"damping": float(np.mean(joint.default_damping_vector()))}
            if np.array_equal(T_bm, np.eye(4)):
                self.builder.add_joint(name, _WHOLE[kind], parent, child, placement=T_pf, axis=(0, 0, 1), **options)
            else:
                middle = self._hidden(child, name)
                self.builder.add_joint(name, _WHOLE[kind], parent, middle, placement=T_pf, axis=(0, 0, 1), **options)
                self.builder.add_joint(f"{name}.fixed", "fixed", middle, child, placement=T_mb)
        else:
            raise ModelError(f"joint {name!r} of Drake's plant is of type {kind!r}, which is not read.")

    def _turned(self, joint: Any) -> Array:
        """The axis of a screw, which Drake does not say: that of its motion by a radian."""
        context = self.plant.CreateDefaultContext()
        q = np.array(self.plant.GetPositions(context))
        q[joint.position_start()] = 1.0
        self.plant.SetPositions(context, q)
        X = joint.frame_on_child().CalcPose(context, joint.frame_on_parent())
        return so3.log(np.array(X.rotation().matrix(), float))

    def _hidden(self, child: str, joint: str) -> str:
        name = f"{child}:{joint}"
        self.builder.add_link(name, hidden=True)
        return name

    def _add_axis(
        self, joint: Any, name: str, kind: str, k: int, parent: str, child: str, T: Array, T_bm: Array,
        direction: Array, drive: tuple[float | None, float],
    ) -> None:  # fmt: skip
        """A joint of one degree, whose axis is given in its frame on the child."""
        zero = np.zeros(3)
        S = np.concatenate([zero, direction] if kind == "prismatic" else [direction, zero])
        if kind == "helical":
            S[3:] = float(joint.screw_pitch()) / (2.0 * math.pi) * direction
        S = np.array(Ad(T_bm) @ S)
        effort, armature = drive
        lower, upper = float(joint.position_lower_limits()[k]), float(joint.position_upper_limits()[k])
        speed = float(joint.velocity_upper_limits()[k])
        self.builder.add_joint(
            name,
            kind,
            parent,
            child,
            placement=T,
            axis=S,
            lower=lower if lower > -math.inf else None,
            upper=upper if upper < math.inf else None,
            velocity=speed if 0 < speed < math.inf else None,
            effort=effort,
            damping=float(joint.default_damping_vector()[k]),
            armature=armature,
        )

    def _add_frames(self) -> None:
        """Named frames that are no body's own and no joint's."""
        used = {
            str(frame.name()) for joint in self.joints for frame in (joint.frame_on_parent(), joint.frame_on_child())
        }
        instance = type(self.plant.world_body().model_instance())
        models = [instance(i) for i in range(self.plant.num_model_instances())]
        for i in (i for model in models for i in self.plant.GetFrameIndices(model)):
            frame = self.plant.get_frame(i)
            name, link = str(frame.name()), self._link(frame.body())
            if name in used or not name or name == str(frame.body().name()):
                continue
            if name not in self.builder.site_names and f"site:{name}" not in self.builder.site_names:
                self.builder.add_site(name, link, _pose(frame))


def _pose(frame: Any) -> Array:
    return np.array(frame.GetFixedPoseInBodyFrame().GetAsMatrix4(), float)


def _inertia(body: Any) -> SpatialInertia:
    G = body.default_spatial_inertia()
    I = np.array(G.CalcRotationalInertia().CopyToFullMatrix3(), float)
    m = float(G.get_mass())
    products = [I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]]
    return SpatialInertia.from_parameters([m, *(m * np.array(G.get_com(), float)), *products])
