"""Conventions of the programs and makers that write some logs: LeRobot's units, and Fanuc's third joint."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.errors import TrajectoryError
from ...core.numbers import number
from ...core.text import Argument, listed
from ...mechanics.model.model import Model
from ..columns import Columns
from ..coordinates import Coordinates
from ..motion_file import MotionFile
from ..readers.columnar_file import ArrayFile

_FANUC_NAMES = re.compile(r"fanuc|crx|lr_?mate|^m_?\d+i|^r_?2000")
"""Names of Fanuc robots."""
_SO_ARM_MOTORS = {"shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"}
"""Motors of the arms SO-100 and SO-101 in LeRobot datasets."""


_MAX_LISTED_JOINTS = 6
"""Largest number of joints that a doubt names."""


def fanuc_doubts(file: MotionFile, model: Model, coordinates: Coordinates) -> list[Doubt]:
    """Doubt about the third joint of a Fanuc robot, as its column J3 is the angle to the horizontal; empty for other logs."""
    has_fanuc_columns = {"J1", "J2", "J3", "J4", "J5", "J6"} <= set(file.header)
    if not has_fanuc_columns or not _FANUC_NAMES.search(model.name.lower()):
        return []
    third_joint = coordinates.names[2]
    remedy = Argument("columns", {third_joint: "J3+J2"})
    return [doubt("fanuc-j3", [third_joint], joint=third_joint, column=remedy)]


def dataset_doubts(file: MotionFile, columns: Columns, coordinates: Coordinates, *, degrees: bool) -> list[Doubt]:
    """Doubts about a LeRobot dataset; raises TrajectoryError if units are unknown or need its calibration file."""
    q_columns = columns.places["q"]
    if not isinstance(file, ArrayFile) or not file.dataset or q_columns is None:
        return []
    has_unstated_unit = coordinates.angular & ~columns.angle_stated
    indices = np.flatnonzero(has_unstated_unit).tolist()  # of coordinates
    if not indices:
        return []
    cells = [columns.header[int(q_columns[k])] for k in indices]
    joints = [coordinates.names[k] for k in indices]
    if file.dataset == "range":
        raise TrajectoryError(
            f"{file.path}: by its metadata, positions are from -100 to 100 of each motor's range, and only its calibration "
            "file maps them to angles. Record again with degrees, or convert them."
        )
    if degrees:
        _check_grippers(file, joints, cells)
        return [doubt("dataset-zero", joints)]
    _check_radians(file, cells)
    if file.dataset != "unknown":
        return []
    fields: dict[str, Any] = {"named": listed(joints, _MAX_LISTED_JOINTS), "usual": ""}  # of the doubt's sentence
    words_of_cells: set[str] = set()
    for cell in cells:
        words_of_cells.update(cell.split("."))
    if _SO_ARM_MOTORS.isdisjoint(words_of_cells):
        return [doubt("dataset-unit", joints, level="note", **fields)]
    fields["usual"] = ", although LeRobot records these motors in degrees or in shares of their range"
    return [doubt("dataset-unit", joints, level="unsure", **fields)]


def _check_radians(file: ArrayFile, cells: list[str]) -> None:
    """Raise TrajectoryError if a column reaches more than a turn."""
    indices = [file.header.index(cell) for cell in cells]
    columns = [file.first(index) for index in indices]
    largest_values = [float(np.abs(column).max(initial=0.0)) for column in columns]
    worst = int(np.argmax(largest_values))
    largest = largest_values[worst]
    if largest > math.tau:
        raise TrajectoryError(
            f"{file.path}: {cells[worst]} reaches {number(largest)}, which is not an angle in radians. LeRobot's SO arms "
            "record degrees since February 2026, and before that -100 to 100 of each motor's range, which needs the "
            "calibration file. If these are degrees, add: {0}",
            Argument("degrees", True),
        )


def _check_grippers(file: ArrayFile, joints: list[str], cells: list[str]) -> None:
    """Raise TrajectoryError if a column belongs to a gripper, whose values are not angles."""
    grippers = [joint for joint, cell in zip(joints, cells, strict=True) if "gripper" in cell.lower()]
    if grippers:
        raise TrajectoryError(
            f"{file.path}: the gripper's column is from 0 to 100 of its range, and not an angle. Hold it still: {{0}}",
            Argument("lock", dict.fromkeys(grippers, 0)),
        )
