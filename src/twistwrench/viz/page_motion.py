"""Motion in a page: its states, and the data to update its verdict as payload, push and speed change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import robots
from ..core.numbers import number
from ..mechanics.model.model import BASE
from ..motion.load_case import Payload
from ..reports.spoken_verdict import verdict_data
from ..robot import Robot
from .page_programs import tips_of

if TYPE_CHECKING:
    from ..reports.drawn_motion import DrawnMotion

BUNDLED = Path(robots.__file__).parent
"""Folder of the bundled robots."""
Put = Callable[[Any, str], dict[str, Any]]
"""Function that stores an array with a type such as "f8", and returns its header entry."""


def robot_of_motion(motion: DrawnMotion) -> tuple[Robot, Payload | None]:
    """Robot of the page under the limits of the motion, and the payload that the page's slider sets.

    The slider sets the motion's only payload, or one at a tip if the motion has none; the robot is then without this payload.
    If there are several payloads, or the payload is not on a moving body, the robot carries them and the returned payload is
    None.
    """
    load = motion.load
    model = load.robot.model
    payload = load.payloads[0] if load.payloads else Payload(0.0)
    bodies = [model.frame(name).body for name in (model.tip, payload.frame) if name is not None]
    has_moving_place = BASE not in bodies and (bodies or tips_of(model))
    if len(load.payloads) <= 1 and has_moving_place:
        return Robot(replace(model, limits=motion.limits)), payload
    return Robot(replace(load.with_load.model, limits=motion.limits)), None


def motion_data(robot: Robot, motion: DrawnMotion, payload: Payload | None, put: Put) -> dict[str, Any]:
    """States of the motion, and the data of its verdict."""
    position_violations = [violation for violation in motion.violations if violation.kind == "position"]
    verdict = verdict_data(
        motion.load, motion.limits, motion.report, list(motion.refused), position_violations, motion.clearance
    )
    if payload is None and motion.load.payloads and verdict["fixed"] is None:
        verdict["fixed"] = "the payload is not on a body that moves"
    states = {
        "time": put(motion.time, "f8"),
        "q": put(motion.q, "f8"),
        "dq": put(motion.dq, "f8"),
        "ddq": put(motion.ddq, "f8"),
    }
    still_entry: dict[str, Any] | None = None
    viscous_coefficients: list[float] | None = None
    if motion.load.friction and motion.still.any():
        still_entry = put(motion.still, "u2")
    if motion.load.friction and robot.model.friction.any:
        viscous_coefficients = robot.model.friction.viscous.tolist()
    return {
        **states,
        "still": still_entry,
        "viscous": viscous_coefficients,
        "mass": 0.0 if payload is None else payload.mass,
        "judged": motion.judged,
        "verdict": verdict,
    }


def notes_of_motion(motion: DrawnMotion) -> list[str]:
    """Notes on the motion that its verdict does not contain, and a note on omitted rows."""
    notes = [note for note in motion.warnings if note not in motion.passed]
    if motion.rows > len(motion.time):
        mass = number(sum(payload.mass for payload in motion.load.payloads))
        notes.append(
            f"The page has {len(motion.time)} of {motion.rows} rows, among them the largest torques of each joint with a "
            f"payload of {mass} kg. With another one, a peak may lie between two of them."
        )
    return notes


def python_source(robot: Robot, motion: DrawnMotion | None) -> dict[str, Any]:
    """Python expressions of the robot and of the log (None without a log), and the robot's payloads."""
    model = robot.model
    log_expression = None
    if motion is not None and motion.report is not None:
        log_expression = _log_expression(motion.report.trajectory)
    return {
        "robot": _robot_expression(model.source or f"{model.name}.urdf", model.tip),
        "log": log_expression,
        "payloads": [
            {"mass": inertia.mass, "place": inertia.com.tolist(), "frame": frame} for frame, inertia in model.payloads
        ],
    }


def _robot_expression(source: str, tip: str | None) -> str:
    """Python expression of a bundled robot, or of a file by its name."""
    path = Path(source)
    if path.parent == BUNDLED and path.suffix == ".urdf":
        return f"tw.robots.{path.stem}()"
    if tip is None:
        return f"tw.load({path.name!r})"
    return f"tw.load({path.name!r}, tip={tip!r})"


def _log_expression(source: str) -> str:
    """Python expression of a bundled motion, or of a log by its file name."""
    path = Path(source)
    if path.parent != BUNDLED or not path.stem.endswith("_demo"):
        return repr(path.name)
    robot_name = path.stem.removesuffix("_demo")
    return f"tw.robots.path_of({robot_name!r}).with_name({path.name!r})"
