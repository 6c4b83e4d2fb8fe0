"""Data of a page: names, limits, sliders, marks and wrenches of the robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.typing import Array
from ..mechanics.lie import se3
from ..mechanics.model.model import Body
from ..motion.coordinates import Coordinates
from ..robot import Robot
from .colours import COLOURS, SHARES, torque_marks
from .page_programs import driven_velocities, frame_data
from .scene import PAYLOAD, turned_z
from .sliders import MAX_TORQUES, limbs_of, sliders_of

_REVERSED = np.diag([1.0, -1.0, -1.0, 1.0]).ravel().tolist()
_MAX_ARROW = 0.35
"""Length of the largest force arrow, as a share of the robot's size."""


def robot_data(robot: Robot, start: Array) -> dict[str, Any]:
    """Names, limits, sliders and marks; the programs that move the robot are separate."""
    model, coordinates = robot.model, Coordinates.from_model(robot.model)
    return {
        "name": robot.name,
        "start": np.asarray(start, float).tolist(),
        "coordinates": [
            {"name": n, "turns": bool(t)} for n, t in zip(coordinates.names, coordinates.endless, strict=True)
        ],
        "bodies": list(map(_body_data, model.bodies)),
        "frames": [{"name": name, **frame_data(frame)} for name, frame in model.all_frames.items()],
        "torques": _torque_data(robot, coordinates),
        "limbs": limbs_of(model) if model.nv > MAX_TORQUES else [],
        "hands": sliders_of(model),
        "colours": {**COLOURS, "shares": SHARES, "payload": PAYLOAD},
        "marks": [{**vars(m), "pose": m.pose.ravel().tolist(), "reversed": _REVERSED} for m in torque_marks(model)],
    }


def _body_data(body: Body) -> dict[str, Any]:
    """Name, joint and parent of a body."""
    return {
        "name": body.link,
        "kind": body.joint.kind,
        "q": body.q_index,
        "follows": body.follows,
        "parent": body.parent,
    }


def _torque_data(robot: Robot, coordinates: Coordinates) -> list[dict[str, Any]]:
    """Name, unit and limit of each torque, and True for joints with a drive."""
    driven, torques = driven_velocities(robot.model).tolist(), []
    for k, limit in enumerate(robot.limits.effort.tolist()):
        entry = {
            "name": coordinates.velocity_names[k],
            "unit": coordinates.torque_units[k],
            "limit": limit if 0 < limit < np.inf else None,
            "driven": driven[k],
        }
        torques.append(entry)
    return torques


def wrench_data(robot: Robot, wrenches: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Wrenches on the robot with their arrows: moments around their axis, forces along it."""
    frames = list(robot.frame_names)
    vectors = {}
    for name, wrench in wrenches.items():
        vectors[name] = arguments.finite(arguments.one(wrench, f"the wrench on {name!r}", 6), "a wrench", 6)
    max_force = max((float(np.linalg.norm(F[3:])) for F in vectors.values()), default=0.0)
    data, marks = [], []
    for name, F in vectors.items():
        robot.model.frame(name)
        m, f = F[:3], F[3:]
        frame = frames.index(name)
        data.append({"frame": frame, "moment": m.tolist(), "force": f.tolist()})
        if m.any():
            marks.append({"frame": frame, "pose": _arrow_pose(m), "length": 0.0, "turns": True})
        if f.any():
            length = max(0.08, _MAX_ARROW * float(np.linalg.norm(f)) / max_force)
            marks.append({"frame": frame, "pose": _arrow_pose(f), "length": length, "turns": False})
    return {"wrenches": data, "wrenchMarks": marks}


def _arrow_pose(direction: Array) -> list[float]:
    """Pose whose z is along a direction, row by row."""
    return se3.pose(turned_z(direction), np.zeros(3)).ravel().tolist()
