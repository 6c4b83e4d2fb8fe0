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
"""Length of the arrow of the largest force, as a share of the robot's size."""
_MIN_ARROW_SHARE = 0.08
"""Smallest length of an arrow, as a share of the robot's size."""


def robot_data(robot: Robot, start: Array) -> dict[str, Any]:
    """Names, limits, sliders and marks, without the programs that move the robot; ``start`` (nq,) is the first pose."""
    model = robot.model
    coordinates = Coordinates.from_model(model)
    coordinate_rows = zip(coordinates.names, coordinates.endless, strict=True)
    marks = []
    for mark in torque_marks(model):
        pose = mark.pose.ravel().tolist()  # row by row
        marks.append({**vars(mark), "pose": pose, "reversed": _TURN_ABOUT_X})
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
    """Wrenches on the robot with their marks: an arc about the axis of a moment, an arrow along a force."""
    frame_names = list(robot.frame_names)
    wrench_by_frame = {}
    for name, wrench in wrenches.items():
        one_wrench = arguments.one(wrench, f"the wrench on {name!r}", 6)
        wrench_by_frame[name] = arguments.finite(one_wrench, "a wrench", 6)
    max_force = max((float(np.linalg.norm(F[3:])) for F in wrench_by_frame.values()), default=0.0)
    wrench_entries = []
    marks = []
    for name, F in wrench_by_frame.items():
        robot.model.frame(name)  # raises for unknown names
        moment, force = F[:3], F[3:]
        frame_index = frame_names.index(name)
        wrench_entries.append({"frame": frame_index, "moment": moment.tolist(), "force": force.tolist()})
        if moment.any():
            marks.append({"frame": frame_index, "pose": _arrow_pose(moment), "length": 0.0, "turns": True})
        if force.any():
            length = max(_MIN_ARROW_SHARE, _MAX_ARROW_SHARE * float(np.linalg.norm(force)) / max_force)
            marks.append({"frame": frame_index, "pose": _arrow_pose(force), "length": length, "turns": False})
    return {"wrenches": wrench_entries, "wrenchMarks": marks}


def _arrow_pose(direction: Array) -> list[float]:
    """Pose (4, 4) whose z axis is along a direction, row by row."""
    return se3.pose(turned_z(direction), np.zeros(3)).ravel().tolist()
