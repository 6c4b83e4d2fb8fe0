"""The file of a motion, opened by what its name and its first bytes say it is, for any robot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..core.files import as_path
from ..errors import TwistWrenchError
from ..model.model import Model
from .array_file import array_file
from .array_stream import ArrayStream
from .column_choice import absent_joints
from .coordinates import Coordinates
from .csv_file import CsvFile
from .joined_files import JOINS, JoinedFile
from .npz_file import NpzFile, is_archive
from .ros_file import is_recording, ros_file

MotionFile = CsvFile | NpzFile | JoinedFile | ArrayStream


def open_motion_file(path: str | Path) -> MotionFile:
    """The motion file at that path, of any robot: CSV, an archive of ``simulate --npz``, or several, ``a.csv+b.csv``."""
    if JOINS in str(path) and not _is_there(as_path(path)):
        return JoinedFile.open(path, open_motion_file)
    if is_recording(as_path(path)):
        return ros_file(as_path(path))
    if (stream := ArrayStream.open(as_path(path))) is not None:
        return stream
    if (arrays := array_file(as_path(path))) is not None:
        return arrays
    return NpzFile.open(path) if is_archive(as_path(path)) else CsvFile.open(path)


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # no path at all
        return False


def moves_motors(path: str | Path | MotionFile) -> bool:
    """Whether the file has columns for the motors of elastic joints; what is wrong with it is said when it is opened."""
    try:
        file = open_motion_file(path) if isinstance(path, str | Path) else path
    except TwistWrenchError:
        return False
    return any(name.strip().endswith(".motor") for name in file.header)


def joints_without_column(
    path: str | Path | MotionFile, model: Model, columns: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """The joints of a model that a motion file has no column for, by its header; ``columns`` as in :meth:`MotionLog.open`."""
    file = open_motion_file(path) if isinstance(path, str | Path) else path
    joints = [b.joint.name for b in model.leaders if b.joint.nv]
    return absent_joints(file.header, Coordinates.of(model), joints, columns or {})
