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
"""Function that stores an array of a kind and returns its header entry."""


def robot_of_motion(motion: DrawnMotion) -> tuple[Robot, Payload | None]:
    """Robot of the page under the limits of the motion, and the payload set by its slider.

    The slider sets the motion's only payload, or one at a tip if the motion has none; that payload is removed from the
    robot. If there are several payloads, or a slider cannot set it, the robot carries them and the returned payload is
    None.
    """
    load, model = motion.load, motion.load.robot.model
    payload = load.payloads[0] if load.payloads else Payload(0.0)
    where = [model.frame(name).body for name in (model.tip, payload.frame) if name is not None]
    slides = len(load.payloads) <= 1 and BASE not in where and bool(where or tips_of(model))
    carried = load.robot if slides else load.with_load
    return Robot(replace(carried.model, limits=motion.limits)), payload if slides else None


def motion_data(robot: Robot, motion: DrawnMotion, payload: Payload | None, put: Put) -> dict[str, Any]:
    """States of the motion, and the data of its verdict."""
    friction, laws = motion.load.friction, robot.model.friction
    positions = [v for v in motion.violations if v.kind == "position"]
    verdict = verdict_data(motion.load, motion.limits, motion.report, list(motion.refused), positions, motion.clearance)
    if payload is None and motion.load.payloads and verdict["fixed"] is None:
        verdict["fixed"] = "the payload is not on a body that moves"
    return {
        "time": put(motion.time, "f8"),
        "q": put(motion.q, "f8"),
        "dq": put(motion.dq, "f8"),
        "ddq": put(motion.ddq, "f8"),
        "still": put(motion.still, "u2") if motion.still.any() and friction else None,
        "viscous": laws.viscous.tolist() if friction and laws.any else None,
        "mass": 0.0 if payload is None else payload.mass,
        "judged": motion.judged,
        "verdict": verdict,
    }


def notes_of_motion(motion: DrawnMotion) -> list[str]:
    """Notes on the motion besides its verdict, and on omitted rows."""
    said = [note for note in motion.warnings if note not in motion.passed]
    if motion.rows > len(motion.time):
        mass = number(sum(p.mass for p in motion.load.payloads))
        said.append(
            f"The page has {len(motion.time)} of {motion.rows} rows, among them the largest torques of each joint with a "
            f"payload of {mass} kg. With another one, a peak may lie between two of them."
        )
    return said


def python_source(robot: Robot, motion: DrawnMotion | None) -> dict[str, Any]:
    """Python expressions that load the robot and the log by file name, and the robot's payloads."""
    model = robot.model
    log = None if motion is None or motion.report is None else motion.report.trajectory
    return {
        "robot": _expression(model.source or f"{model.name}.urdf", model.tip),
        "log": None if log is None else _log_expression(log),
        "payloads": [
            {"mass": inertia.mass, "place": inertia.com.tolist(), "frame": frame} for frame, inertia in model.payloads
        ],
    }


def _expression(source: str, tip: str | None) -> str:
    path = Path(source)
    if path.parent == BUNDLED and path.suffix == ".urdf":
        return f"tw.robots.{path.stem}()"
    return f"tw.load({path.name!r}{'' if tip is None else f', tip={tip!r}'})"


def _log_expression(source: str) -> str:
    path = Path(source)
    bundled = path.parent == BUNDLED and path.stem.endswith("_demo")
    if not bundled:
        return repr(path.name)
    return f"tw.robots.path_of({path.stem.removesuffix('_demo')!r}).with_name({path.name!r})"
