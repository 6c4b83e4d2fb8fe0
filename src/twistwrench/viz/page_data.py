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

_TURN_ABOUT_X = np.diag([1.0, -1.0, -1.0, 1.0]).ravel().tolist()
"""Pose (4, 4), row by row, that reverses the z axis of a mark."""
_MAX_ARROW_SHARE = 0.35
_MIN_ARROW_SHARE = 0.08
"""Lengths of the largest force arrow, and of the smallest, as shares of the robot's size."""


def robot_data(robot: Robot, start: Array) -> dict[str, Any]:
    """Names, limits, sliders and marks; the programs that move the robot are separate."""
    model, coordinates = robot.model, Coordinates.from_model(robot.model)
    coordinate_rows = zip(coordinates.names, coordinates.endless, strict=True)
    marks = [
        {**vars(mark), "pose": mark.pose.ravel().tolist(), "reversed": _TURN_ABOUT_X} for mark in torque_marks(model)
    ]
    return {
        "name": robot.name,
        "start": np.asarray(start, float).tolist(),
        "coordinates": [{"name": name, "turns": bool(endless)} for name, endless in coordinate_rows],
        "bodies": list(map(_body_data, model.bodies)),
        "frames": [{"name": name, **frame_data(frame)} for name, frame in model.all_frames.items()],
        "torques": _torque_data(robot, coordinates),
        "limbs": limbs_of(model) if model.nv > MAX_TORQUES else [],
        "hands": sliders_of(model),
        "colours": {**COLOURS, "shares": SHARES, "payload": PAYLOAD},
        "marks": marks,
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
    driven = driven_velocities(robot.model).tolist()
    torques = []
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
    """Wrenches on the robot with their arrows: an arc about the axis of a moment, an arrow along a force."""
    frame_names = list(robot.frame_names)
    wrench_by_frame = {}
    for name, wrench in wrenches.items():
        wrench_by_frame[name] = arguments.finite(arguments.one(wrench, f"the wrench on {name!r}", 6), "a wrench", 6)
    max_force = max((float(np.linalg.norm(F[3:])) for F in wrench_by_frame.values()), default=0.0)
    data, marks = [], []
    for name, F in wrench_by_frame.items():
        robot.model.frame(name)  # raises for unknown names
        moment, force = F[:3], F[3:]
        frame = frame_names.index(name)
        data.append({"frame": frame, "moment": moment.tolist(), "force": force.tolist()})
        if moment.any():
            marks.append({"frame": frame, "pose": _arrow_pose(moment), "length": 0.0, "turns": True})
        if force.any():
            length = max(_MIN_ARROW_SHARE, _MAX_ARROW_SHARE * float(np.linalg.norm(force)) / max_force)
            marks.append({"frame": frame, "pose": _arrow_pose(force), "length": length, "turns": False})
    return {"wrenches": data, "wrenchMarks": marks}


def _arrow_pose(direction: Array) -> list[float]:
    """Pose (4, 4) whose z axis is along a direction, row by row."""
    return se3.pose(turned_z(direction), np.zeros(3)).ravel().tolist()
