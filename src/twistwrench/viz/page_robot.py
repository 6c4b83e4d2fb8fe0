"""The robot as a page's header tells it: names, limits, sliders, where marks stand, and the wrenches on it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..lie import se3
from ..motion.coordinates import Coordinates
from ..typing import Array
from .colours import COLOURS, SHARES, torque_marks
from .skeleton import PAYLOAD, turned_z
from .sliders import sliders_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..robot import Robot

_LONGEST_ARROW = 0.35
"""Of the largest force, as a share of the robot's size."""


def robot_data(robot: Robot, start: Array) -> dict[str, Any]:
    """Names, limits, sliders and marks; what the page moves it by are its programs."""
    model, coordinates = robot.model, Coordinates.of(robot.model)
    limits = robot.limits.effort.tolist()
    return {
        "name": robot.name,
        "start": np.asarray(start, float).tolist(),
        "coordinates": [
            {"name": n, "turns": bool(t)} for n, t in zip(coordinates.names, coordinates.endless, strict=True)
        ],
        "bodies": [
            {
                "name": b.link,
                "kind": b.joint.kind,
                "q": b.q_index,
                "follows": b.follows,
                "parent": b.parent,
            }
            for b in model.bodies
        ],
        "frames": [{"name": n, "body": f.body, "pose": f.pose.ravel().tolist()} for n, f in model.all_frames.items()],
        "tip": None if model.tip is None else list(model.all_frames).index(model.tip),
        "torques": [
            {"name": n, "unit": u, "limit": limit if 0 < limit < np.inf else None}
            for n, u, limit in zip(coordinates.velocity_names, coordinates.torque_units, limits, strict=True)
        ],
        "hands": sliders_of(model),
        "colours": {**COLOURS, "shares": SHARES, "payload": PAYLOAD},
        "marks": [
            {
                "torque": m.torque,
                "body": m.body,
                "pose": m.pose.ravel().tolist(),
                "turns": m.turns,
                "reversed": np.diag([1.0, -1.0, -1.0, 1.0]).ravel().tolist(),
            }
            for m in torque_marks(model)
        ],
    }


def wrench_data(robot: Robot, wrenches: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """The wrenches on the robot, and their arrows: a moment's around its axis, a force's along it."""
    frames = list(robot.frame_names)
    given = {
        name: arguments.finite(arguments.one(F, f"the wrench on {name!r}", 6), "a wrench", 6)
        for name, F in wrenches.items()
    }
    largest = max((float(np.linalg.norm(F[3:])) for F in given.values()), default=0.0)
    data: list[dict[str, Any]] = []
    marks: list[dict[str, Any]] = []
    for name, F in given.items():
        robot.model.frame(name)
        m, f = F[:3], F[3:]
        frame = frames.index(name)
        data.append({"frame": frame, "moment": m.tolist(), "force": f.tolist()})
        for part, turns in ((m, True), (f, False)):
            if (size := float(np.linalg.norm(part))) > 0:
                length = 0.0 if turns else max(0.08, _LONGEST_ARROW * size / largest)
                T = se3.pose(turned_z(part), np.zeros(3))
                marks.append({"frame": frame, "pose": T.ravel().tolist(), "length": length, "turns": turns})
    return {"wrenches": data, "wrenchMarks": marks}
