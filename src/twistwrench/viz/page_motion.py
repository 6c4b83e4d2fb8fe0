"""A motion in a page: its states, and what the page judges it by while payload, push and speed change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.numbers import number
from ..model.model import BASE
from ..reports.load_case import Payload
from ..reports.spoken_verdict import verdict_data
from ..robot import Robot

if TYPE_CHECKING:
    from .drawn_motion import DrawnMotion

Put = Callable[[Any, str], dict[str, Any]]
"""Takes in an array and its kind; returns its entry of the page's header."""


def robot_of_motion(motion: DrawnMotion) -> tuple[Robot, Payload | None]:
    """Robot of the page under the limits of the motion, and the payload that its slider sets.

    The slider sets the only payload of the motion, or one at the tip if the motion has none; then the robot is without it. The
    payload is None if there are several or if no slider can set it: then the robot carries them.
    """
    load, model = motion.load, motion.load.robot.model
    payload = load.payloads[0] if load.payloads else Payload(0.0)
    where = payload.frame or model.tip
    slides = (
        len(load.payloads) <= 1
        and model.tip is not None
        and BASE not in (model.frame(model.tip).body, model.frame(where).body)
    )
    carried = load.robot if slides else load.with_load
    return Robot(replace(carried.model, limits=motion.limits)), payload if slides else None


def motion_data(robot: Robot, motion: DrawnMotion, payload: Payload | None, put: Put) -> dict[str, Any]:
    """States of the motion, and the data that its verdict is made of."""
    path = None if robot.tip is None else put(np.asarray(robot.forward_kinematics(motion.q))[:, :3, 3], "f4")
    friction, laws = motion.load.friction, robot.model.friction
    positions = [v for v in motion.violations if v.kind == "position"]
    verdict = verdict_data(motion.load, motion.limits, motion.report, list(motion.refused), positions)
    if payload is None and motion.load.payloads and verdict["fixed"] is None:
        verdict["fixed"] = "the payload is not at a tip of the robot"
    return {
        "time": put(motion.time, "f8"),
        "q": put(motion.q, "f8"),
        "dq": put(motion.dq, "f8"),
        "ddq": put(motion.ddq, "f8"),
        "still": put(motion.still, "u2") if motion.still.any() and friction else None,
        "path": path,
        "viscous": laws.viscous.tolist() if friction and laws.any else None,
        "mass": 0.0 if payload is None else payload.mass,
        "verdict": verdict,
    }


def notes_of_motion(motion: DrawnMotion) -> list[str]:
    """Notes on the motion besides its verdict, and on the rows that were left out."""
    said = [note for note in motion.warnings if note not in motion.passed]
    if motion.rows > len(motion.time):
        mass = number(sum(p.mass for p in motion.load.payloads))
        said.append(
            f"The page has {len(motion.time)} of {motion.rows} rows, among them the largest torques of each joint with a "
            f"payload of {mass} kg. With another one, a peak may lie between two of them."
        )
    return said
