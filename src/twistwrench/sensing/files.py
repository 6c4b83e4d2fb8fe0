"""Files of sensors and logs: identified sensors as JSON, readings as CSV."""

from __future__ import annotations

import difflib
import json
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ModelWarning, NotFoundError, ShapeError, TwistWrenchError, ValueRangeError
from ..core.files import read_text, replacing
from ..core.glossary import complete
from ..core.gravity import GRAVITY, checked_strength
from ..core.numbers import printed
from ..core.tables import csv_table
from ..core.text import Argument, Placeholder, in_the_shell, spell
from ..core.third_party import third_party_errors
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie.labelled import TWIST, WRENCH
from ..motion.column_names import split_unit, time_meaning
from ..motion.columns import Columns, Reading, check_header
from ..motion.coordinates import Coordinates
from ..motion.readers.csv_reader import CsvFile, table_errors
from ..robot import Robot, load
from .contact_detection import checked_noise
from .log import ReadingLog, ReadingsGiven, checked_log, first_late_row
from .sensor import ForceTorqueSensor, gravity_in_frame, rotations_of_quaternions
from .uncertainty import Uncertainty

_UNCERTAINTY_ARRAYS = ("covariance", "freedom", "noise", "noise_freedom")
"""Arrays of an :class:`Uncertainty` in a sensor file."""

_BUNDLED_LOGS = {"demo": "demo_poses.csv", "demo-motion": "demo_motion.csv"}
"""Files of bundled logs by name."""
_BUNDLED_SENSORS = {"demo": "demo_sensor.json"}
"""Files of bundled sensors by name."""
MAX_SENSOR_FILE_BYTES = 2**20
_MIN_SIMILARITY = 0.7
"""Smallest similarity of two names, from 0 to 1, at which one is suggested for the other."""


def _advice_on_sensor_files() -> str:
    """Sentence that names the call or command that writes a sensor file."""
    if in_the_shell():
        return f"twistwrench sensor identify LOG {spell(Argument('save', Placeholder('FILE')))} writes one."
    return "tw.sensing.identify(log).write(path) writes one."


def log_path(name: str | Path) -> Path:
    """Path of a log; ``demo`` and ``demo-motion`` are bundled.

    >>> log_path("demo").name, str(log_path("my.csv"))
    ('demo_poses.csv', 'my.csv')
    """
    return _bundled_or_own_path(name, _BUNDLED_LOGS)


def sensor_path(name: str | Path) -> Path:
    """Path of a sensor file; ``demo`` is bundled.

    >>> sensor_path("demo").name
    'demo_sensor.json'
    """
    return _bundled_or_own_path(name, _BUNDLED_SENSORS)


def _bundled_or_own_path(name: str | Path, files: Mapping[str, str]) -> Path:
    """Path of the bundled file with this name; a file of the user with the same name has priority."""
    own_path = Path(name)
    if str(name) in files and not own_path.is_file():
        return Path(__file__).with_name(files[str(name)])
    return own_path


@dataclass(frozen=True)
class SensorFile:
    """Content of a sensor file."""

    sensor: ForceTorqueSensor
    noise: tuple[float, float]
    """Standard deviations of moments [N m] and forces [N]."""
    uncertainty: Uncertainty | None
    """Uncertainty of the sensor; None in older files."""


def write_sensor(
    sensor: ForceTorqueSensor, path: str | Path, noise: tuple[float, float], uncertainty: Uncertainty | None = None
) -> None:
    """Write a sensor and the noise of its readings to a file, at full precision.

    Parameters
    ----------
    uncertainty : Uncertainty, optional, see :attr:`Identification.uncertainty`
        Covariance and degrees of freedom, needed by :func:`~twistwrench.sensing.contact_detection.compensation` to keep
        its false-alarm rate. It also records whether the load's rotational inertia is known.

    Raises
    ------
    ValueRangeError
        The noise is invalid, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_sensor(ForceTorqueSensor(), f"{folder}/hand.json", (0.01, 0.3))
    ...     Path(folder, "hand.json").exists()
    True
    """
    if not isinstance(sensor, ForceTorqueSensor) or not isinstance(path, str | Path):
        raise ShapeError(
            f"write_sensor takes a ForceTorqueSensor, then a path, got {type(sensor).__name__} and {type(path).__name__}."
        )
    content: dict[str, Any] = {
        "sign": sensor.sign,
        "bias": np.asarray(sensor.bias).tolist(),
        "mounting": np.asarray(sensor.mounting).tolist(),
        "load": sensor.load.parameters.tolist(),
        "inertia": sensor.inertia,
        "noise": checked_noise(noise, none_at_all=True).tolist(),
    }
    if sensor.frame is not None:
        content["frame"] = sensor.frame
    if uncertainty is not None:
        if not isinstance(uncertainty, Uncertainty):
            raise ShapeError(
                f"write_sensor: uncertainty is {arguments.value_text(uncertainty)}: give Identification.uncertainty, or None."
            )
        entry: dict[str, Any] = {"unknowns": list(uncertainty.unknowns)}
        for name in _UNCERTAINTY_ARRAYS:
            entry[name] = _lists_for_json(getattr(uncertainty, name))
        content["uncertainty"] = entry
    with replacing(path) as scratch:
        scratch.write_text(json.dumps(content, indent=1) + "\n", "utf-8")


def read_sensor(path: str | Path) -> tuple[ForceTorqueSensor, tuple[float, float]]:
    """Read a sensor and its noise from a file that :func:`write_sensor` wrote.

    Returns
    -------
    sensor : ForceTorqueSensor
    noise : (moment [N m], force [N]), standard deviations of a reading

    Raises
    ------
    NotFoundError, ValueRangeError
        As :func:`read_sensor_file`.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_sensor(ForceTorqueSensor(bias=[0, 0, 0, 5, 0, 0]), f"{folder}/hand.json", (0.01, 0.3))
    ...     sensor, noise = read_sensor(f"{folder}/hand.json")
    >>> sensor.bias.tolist(), noise
    ([0.0, 0.0, 0.0, 5.0, 0.0, 0.0], (0.01, 0.3))
    """
    file = read_sensor_file(path)
    return file.sensor, file.noise


def read_sensor_file(path: str | Path) -> SensorFile:
    """Read a file of :func:`write_sensor` and its uncertainty, if any; raises NotFoundError and ValueRangeError."""
    if not isinstance(path, str | Path):
        raise ShapeError(f"read_sensor takes the path of a sensor file, got {type(path).__name__}.")
    path = Path(path)
    try:
        content = _read_content(path)
        load = SpatialInertia.from_parameters(content["load"])
        if load.mass < 0:
            raise ValueRangeError(f"the load's mass, {load.mass} kg, is negative. Identify the sensor again.")
        sensor = ForceTorqueSensor(
            load=load,
            bias=content["bias"],
            sign=content["sign"],
            mounting=content["mounting"],
            frame=content.get("frame"),
            inertia=_inertia_state(content, load),
        )
        moment_noise, force_noise = checked_noise(content["noise"], none_at_all=True).tolist()
        uncertainty = None
        if content.get("uncertainty") is not None:
            uncertainty = _uncertainty_of_entry(content["uncertainty"])
    except FileNotFoundError:
        raise NotFoundError(f"no sensor file {str(path)!r}. {_advice_on_sensor_files()}") from None
    except TwistWrenchError as problem:
        raise ValueRangeError(f"{path}: {problem}") from None
    except (ValueError, TypeError, KeyError, OverflowError):
        raise ValueRangeError(f"{path}: is not a sensor file. {_advice_on_sensor_files()}") from None
    return SensorFile(sensor, (moment_noise, force_noise), uncertainty)


def _lists_for_json(array: Array) -> Any:
    """Nested lists of an array for JSON, in which infinities become null."""
    if array.ndim > 1:
        return [_lists_for_json(row) for row in array]
    return [float(value) if np.isfinite(value) else None for value in array]


def _uncertainty_of_entry(entry: dict[str, Any]) -> Uncertainty:
    """Uncertainty from its entry in a sensor file."""
    arrays = {}
    for name in _UNCERTAINTY_ARRAYS:
        # Infinity is written as null, which NumPy reads as NaN. Uncertainty rejects infinity where it is not allowed.
        array = np.array(entry[name], float)
        arrays[name] = np.where(np.isnan(array), np.inf, array)
    return Uncertainty(tuple(entry["unknowns"]), **arrays)


def _read_content(path: Path) -> dict[str, Any]:
    """Entries of a sensor file; raises ValueRangeError unless it is JSON with named entries."""
    with third_party_errors(
        lambda reason: ValueRangeError(f"is not a sensor file: {reason}. {_advice_on_sensor_files()}")
    ):
        try:
            text = read_text(path, MAX_SENSOR_FILE_BYTES)
        except FileNotFoundError:
            raise NotFoundError(str(path)) from None
        content = json.loads(text, parse_int=float)  # integers may be larger than floats can be
    if not isinstance(content, dict):
        raise ValueRangeError(
            f"is not a sensor file: it holds one value of kind {type(content).__name__}. {_advice_on_sensor_files()}"
        )
    return content


def _inertia_state(content: dict[str, Any], load: SpatialInertia) -> Any:
    """State of the rotational inertia in the file.

    Older files have no such entry. The inertia of their load is "unknown" if the load is a point mass or inconsistent.
    """
    if "inertia" in content:
        return content["inertia"]
    point_mass = SpatialInertia.zero()
    if load.mass:
        point_mass = SpatialInertia.from_com(load.mass, load.com)
    is_point_mass = np.allclose(load.parameters, point_mass.parameters, rtol=1e-9, atol=1e-12)
    if is_point_mass or load.defects():
        return "unknown"
    return "given"


# ── Logs of readings as CSV files

_QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
_MATRIX_COLUMNS = tuple(f"r{row}{column}" for row in "123" for column in "123")
_GRAVITY_COLUMNS = ("gx", "gy", "gz")
_DV_COLUMNS = tuple(f"d{name}" for name in TWIST)
_POSITION = ("px", "py", "pz")
_COLUMNS = (  # all known columns
    "time",
    *_QUATERNION_COLUMNS,
    *_MATRIX_COLUMNS,
    *_GRAVITY_COLUMNS,
    *WRENCH,
    *TWIST,
    *_DV_COLUMNS,
    *_POSITION,
)
_ALIASES = {"t": "time", "tx": "mx", "ty": "my", "tz": "mz"}
"""Names of columns by other names that are common."""
_ANGLE_NAMES = {  # of an orientation, which are not read
    "roll",
    "pitch",
    "yaw",
    "rx",
    "ry",
    "rz",
    "a",
    "b",
    "c",
    "alpha",
    "beta",
    "gamma",
    "phi",
    "theta",
    "psi",
}
_UNITS = {  # accepted units by name of the column, without x, y or z; messages name the first unit
    "m": ("N m", "Nm", "N*m", "N·m"),
    "f": ("N",),
    "w": ("rad/s", "1/s"),
    "v": ("m/s",),
    "dw": ("rad/s²", "rad/s^2", "rad/s2", "1/s²", "1/s^2"),
    "dv": ("m/s²", "m/s^2", "m/s2"),
    "time": ("s",),
    "p": ("m",),
    "g": ("", "1", "-", "m/s²", "m/s^2", "m/s2"),
}


def read_log(
    path: str | Path,
    *,
    gravity: ArrayLike = GRAVITY,
    robot: Robot | str | Path | None = None,
    frame: str | None = None,
    degrees: bool = False,
) -> ReadingLog:
    r"""Read a log of a force-torque sensor from a CSV file.

    Parameters
    ----------
    gravity : (3,) array_like, in {w} [m/s²]
    robot : Robot, path or name, optional
        Robot whose joint positions are in the log; its forward kinematics gives the orientations.
    frame : str, optional, frame {f} of the sensor on the robot; default: the tip
    degrees : bool, use degrees for joint positions without a unit

    Raises
    ------
    NotFoundError
        The file does not exist.
    ValueRangeError
        The file cannot be read; the message has line and column.
    TrajectoryError
        A joint of the robot has no column.

    Notes
    -----
    Columns, in any order, optionally followed by their unit as in ``fx [N]``:

    ``mx, my, mz, fx, fy, fz`` readings [N m, N]; the orientation as ``qw, qx, qy, qz`` or ``r11, r12, …, r33`` (R_wf,
        row by row) or ``gx, gy, gz`` (direction of gravity in {f}, of any length); optionally ``time`` [s], ``wx … vz``
        and ``dwx … dvz`` (V and dV in {f}), and ``px, py, pz`` (unused). Other columns are ignored and listed in the
        log's ``notes``. If the log has orientations beside the positions of a robot's joints, they are used, and a
        difference of gravity's direction above 2° is a doubt.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "log.csv")
    ...     count = path.write_text("mx,my,mz,fx,fy,fz,gx,gy,gz\n0,0,0,0,0,-29.43,0,0,-1\n")
    ...     read_log(path).readings.tolist()
    [[0.0, 0.0, 0.0, 0.0, 0.0, -29.43]]
    """
    if not isinstance(path, str | Path):
        raise ShapeError(f"read_log takes the path of a CSV file, got a {type(path).__name__}.")
    path = Path(path)
    with table_errors(path, "log", f"a header ({', '.join(WRENCH)} and an orientation), then rows"):
        file = CsvFile.open(path)
        where = f"{path}: line {file.header_line}"
        header = _column_names(file.header, where)
        names = [name for name in header if name in _COLUMNS]
        ignored_names = [name for name in header if name not in _COLUMNS]
        _check_complete(names, ignored_names, where, by_robot=robot is not None)
        table = file.table([k for k, name in enumerate(header) if name in _COLUMNS])
    rotations = None
    joint_columns: tuple[str, ...] = ()
    if robot is not None:
        rotations, joint_columns = orientations_by_joints(file, robot, frame, degrees=degrees)
    if not len(table):
        raise ValueRangeError(f"{path}: no readings after the header. Give at least one row.")
    columns = {name: table[:, k] for k, name in enumerate(names)}
    if "time" in columns:
        _check_times(file, columns["time"])
    log = _log_from_columns(path, columns, gravity, rotations)
    ignored_names = [name for name in ignored_names if name not in joint_columns]
    return replace(log, notes=_note_on_ignored_columns(ignored_names))


def _check_times(file: CsvFile, times: Array) -> None:
    """Raise ValueRangeError unless the times increase."""
    row = first_late_row(times)
    if row is not None:
        raise ValueRangeError(
            f"{file.path}: {file.place(row)}: time {printed(times[row])} s is not after the {printed(times[row - 1])} s of "
            "the row before. Times must increase: sort the rows, or remove the column."
        )


def readings_of(log: ReadingsGiven, gravity: float, taker: str, **robot_options: Any) -> ReadingLog:
    """Log itself, or the log in a file, read with gravity of this size [m/s²].

    Warnings about the log are suppressed, since the report of the function ``taker`` has the doubts. ``robot_options`` are
    the arguments of :func:`read_log` for a file with positions of a robot's joints.
    """
    if not isinstance(log, str | Path):
        return checked_log(log, taker)
    gravity_in_world = (0.0, 0.0, -checked_strength(gravity))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return read_log(log_path(log), gravity=gravity_in_world, **robot_options)


def _column_names(header: Sequence[str], where: str) -> list[str]:
    """Names of the columns without their units; columns that are not part of a reading keep their text."""
    check_header(header, where, f"{', '.join(WRENCH)} and an orientation")
    names = []
    for cell in header:
        text = cell.strip().strip('"')
        name = cell
        unit = None
        match = re.fullmatch(r"([^\[(]*)(?:[\[(](.*)[\])])?", text)  # name [unit] or name (unit)
        if match:
            name, unit = match.groups()
        name = name.strip().lower()
        name = _ALIASES.get(name, name)
        if name not in _COLUMNS:
            names.append(text)
            continue
        if unit is not None:
            _check_unit(name, unit, where)
        names.append(name)
    for name in names:
        if name in _COLUMNS and names.count(name) > 1:
            raise ValueRangeError(f"{where}: column {name!r} is there {names.count(name)} times. Keep one of them.")
    return names


def _note_on_ignored_columns(ignored: list[str]) -> tuple[str, ...]:
    """One note that lists ignored columns, each with a similar name of a known one; empty if none is ignored."""
    if not ignored:
        return ()
    texts = []
    for name in ignored:
        text = repr(name)
        similar_names = difflib.get_close_matches(name.lower(), _COLUMNS, n=1, cutoff=_MIN_SIMILARITY)
        if similar_names:
            text += f" (did you mean {similar_names[0]!r}?)"
        texts.append(text)
    return (f"Columns that are not part of a reading are ignored: {', '.join(texts)}.",)


def _check_unit(name: str, unit: str, where: str) -> None:
    """Raise ValueRangeError if a column has a unit that its quantity does not allow."""
    quantity = name if name in _UNITS else name.rstrip("xyz")
    allowed_units = _UNITS.get(quantity)
    if allowed_units is None:
        return
    unit = unit.strip()
    if unit.lower() not in map(str.lower, allowed_units):
        remedy = allowed_units[0] or "a plain direction"  # the direction of gravity has no unit
        raise ValueRangeError(f"{where}: column {name!r} is in {unit!r}. Convert it to {remedy} (SI units).")


def _check_complete(names: list[str], ignored: list[str], where: str, *, by_robot: bool) -> None:
    """Raise ValueRangeError unless the columns ``names`` are complete; ``ignored`` are the names of the other columns.

    Needed are the six components of readings and one orientation. With ``by_robot``, the orientation comes from a robot and
    may be missing. An orientation or a motion must have all of its columns.
    """
    missing = [name for name in WRENCH if name not in names]
    if missing:
        raise ValueRangeError(
            f"{where}: no column for {', '.join(missing)}. {_suggestion(missing, ignored)}A reading has "
            f"{', '.join(WRENCH)}, the moments perhaps as Tx, Ty, Tz."
        )
    kinds = (_QUATERNION_COLUMNS, _MATRIX_COLUMNS, _GRAVITY_COLUMNS)
    orientations = [columns for columns in kinds if not set(columns).isdisjoint(names)]
    is_missing = not orientations and not by_robot
    if len(orientations) > 1 or is_missing:
        problem = "more than one orientation"
        hint = _suggestion(list(chain.from_iterable(kinds)), ignored)
        if is_missing:
            problem = "no orientation"
            hint_on_angles = _hint_on_angles(ignored)
            if hint_on_angles:
                hint = hint_on_angles
        raise ValueRangeError(
            f"{where}: {problem}. {hint}Give one of: {', '.join(_QUATERNION_COLUMNS)}; r11, r12, …, r33; "
            f"{', '.join(_GRAVITY_COLUMNS)} (gravity's direction in the sensor's frame); or joint positions, and the robot: "
            "{0}.",
            Argument("robot", Placeholder("ROBOT")),
        )
    expected_names = list(chain.from_iterable(orientations))
    motion_columns = TWIST + _DV_COLUMNS
    if not set(motion_columns).isdisjoint(names):
        expected_names += motion_columns
    missing = [name for name in expected_names if name not in names]
    if missing:
        raise ValueRangeError(
            f"{where}: no column for {', '.join(missing)}, although others of its kind are there. "
            f"{_suggestion(missing, ignored)}Add it."
        )


def _hint_on_angles(ignored: list[str]) -> str:
    """Hint on columns that look like angles of an orientation; empty if there are fewer than two."""
    angles = [name for name in ignored if re.sub(r"[^a-z]", "", name.lower()) in _ANGLE_NAMES]
    if len(angles) < 2:
        return ""
    return f"{', '.join(angles)}: angles have many conventions, so none is guessed; convert them to a quaternion. "


def _suggestion(missing: list[str], ignored: list[str]) -> str:
    """Sentence that suggests a missing name for an ignored column with a similar name; empty without one."""
    for name in ignored:
        short_name = re.sub(r"force", "f", name.lower())
        short_name = re.sub(r"torque|moment|\bt(?=_)", "m", short_name)
        short_name = re.sub(r"[^a-z0-9]", "", short_name)
        similar_names = difflib.get_close_matches(short_name, missing, n=1, cutoff=_MIN_SIMILARITY)
        if similar_names:
            return f"Column {name!r} is not known: did you mean {similar_names[0]!r}? "
    return ""


def _log_from_columns(path: Path, columns: dict[str, Array], gravity: ArrayLike, rotations: Array | None) -> ReadingLog:
    """Log from the columns of a file.

    ``rotations`` (n, 3, 3) are by joint positions of a robot; they are used if the file has no orientations. If the file has
    both, the log gets the angle between their directions of gravity.
    """

    def stack(names: tuple[str, ...]) -> Array | None:
        """Columns (n, k) side by side; None if the file does not have them."""
        if names[0] not in columns:
            return None
        return np.stack([columns[name] for name in names], axis=1)

    pose = rotations
    log_gravity = gravity
    quaternions = stack(_QUATERNION_COLUMNS)
    matrices = stack(_MATRIX_COLUMNS)
    directions = stack(_GRAVITY_COLUMNS)
    if quaternions is not None:
        pose = rotations_of_quaternions(quaternions, f"{path}: quaternion")
    elif matrices is not None:
        pose = matrices.reshape(-1, 3, 3)
    elif directions is not None:
        pose = None
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if not lengths.all():
            rows_of_zeros = np.flatnonzero(lengths[:, 0] == 0)
            raise ValueRangeError(
                f"{path}: gx, gy, gz of reading {int(rows_of_zeros[0])} are zero. Give the direction of gravity."
            )
        strength = np.linalg.norm(np.asarray(gravity, float))
        log_gravity = directions / lengths * strength
    readings = np.stack([columns[name] for name in WRENCH], axis=1)
    log = ReadingLog.from_arrays(
        readings,
        pose=pose,
        gravity=log_gravity,
        V=stack(TWIST),
        dV=stack(_DV_COLUMNS),
        time=columns.get("time"),
        name=str(path),
    )
    if rotations is None or pose is rotations:
        return log
    robot_gravity = gravity_in_frame(rotations, gravity)
    return replace(log, turned=_median_angle(log.gravity, robot_gravity))


def _median_angle(a: Array, b: Array) -> float:
    """Median of the angles [rad] between vectors in the same row of two arrays (n, 3)."""
    # Sines and cosines have the product of both lengths as a factor, which cancels.
    sines = np.linalg.norm(np.cross(a, b), axis=1)
    cosines = (a * b).sum(axis=1)
    return float(np.median(np.arctan2(sines, cosines)))


def orientations_by_joints(
    file: CsvFile, robot: Robot | str | Path, frame: str | None, *, degrees: bool
) -> tuple[Array, tuple[str, ...]]:
    """Orientations (n, 3, 3) of a frame by the joint positions in a file, and the names of the positions' columns."""
    arm = robot if isinstance(robot, Robot) else load(robot)
    rate: float | None = 1.0  # any rate will do, since orientations do not depend on times
    for cell in file.header:
        name, _ = split_unit(cell)
        if time_meaning(name) is not None:
            rate = None  # the file has times
    reading = Reading(file.path, rate=rate, degrees=degrees)
    where = f"{file.path}: line {file.header_line}"
    columns = Columns.from_header(file.header, Coordinates.from_model(arm.model), where, reading, file.first)
    table = file.table(columns.used)
    if columns.counted:  # si_values expects a first column of times, which the file does not have
        table = np.column_stack([np.zeros(len(table)), table])
    q = columns.si_values(table, "q")
    T = np.asarray(arm.forward_kinematics(q, frame))
    return T[:, :3, :3], tuple(columns.header)


def write_log(log: ReadingLog, path: str | Path) -> None:
    """Write a log for :func:`read_log`; orientations are written as gravity directions ``gx, gy, gz``.

    Raises
    ------
    ValueRangeError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> log = ReadingLog.from_arrays([[0, 0, 0, 0, 0, -29.43]], pose=[np.eye(3)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_log(log, f"{folder}/log.csv")
    ...     len(read_log(f"{folder}/log.csv"))
    1
    """
    if isinstance(path, ReadingLog):
        raise ShapeError("write_log takes the log first, then the path: write_log(log, 'log.csv').")
    checked_log(log, "write_log")
    if not isinstance(path, str | Path):
        raise ShapeError(f"write_log takes a path after the log, got a {type(path).__name__}.")
    header: list[str] = []
    columns: list[Array] = []
    if log.time is not None:
        header.append("time")
        columns.append(log.time[:, None])
    header += _GRAVITY_COLUMNS
    columns.append(log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True))
    if log.V is not None:
        header += TWIST
        columns.append(log.V)
    if log.dV is not None:
        header += _DV_COLUMNS
        columns.append(log.dV)
    with csv_table(path, [*header, *WRENCH]) as table:
        table.numbers(np.concatenate([*columns, log.readings], axis=1))


def write_compensated(log: ReadingLog, compensated: Array, path: str | Path) -> Path:
    """Write readings (n, 6) without bias and load, with the times of the log if it has them."""
    header = [*WRENCH]
    rows = compensated
    if log.time is not None:
        header.insert(0, "time")
        rows = np.column_stack([log.time, compensated])
    with csv_table(path, header) as table:
        table.numbers(rows)
    return Path(path)


complete(globals())
