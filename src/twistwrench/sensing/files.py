"""Files of sensors and logs: identified sensors as JSON, readings as CSV."""

from __future__ import annotations

import difflib
import json
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from .fit import Uncertainty
from .log import ReadingLog, ReadingsGiven, checked_log, late
from .sensor import ForceTorqueSensor, gravity_in_frame, rotations_of_quaternions

_ARRAYS = ("covariance", "freedom", "noise", "noise_freedom")

_LOGS = {"demo": "demo_poses.csv", "demo-motion": "demo_motion.csv"}
_SENSORS = {"demo": "demo_sensor.json"}
_MOST_BYTES = 2**20


def _advice() -> str:
    """Sentence that names the call or command for a sensor file."""
    if in_the_shell():
        return f"twistwrench sensor identify LOG {spell(Argument('save', Placeholder('FILE')))} writes one."
    return "tw.sensing.identify(log).write(path) writes one."


def log_path(name: str | Path) -> Path:
    """Path of a log; ``demo`` and ``demo-motion`` are bundled.

    >>> log_path("demo").name, str(log_path("my.csv"))
    ('demo_poses.csv', 'my.csv')
    """
    return _bundled(name, _LOGS)


def sensor_path(name: str | Path) -> Path:
    """Path of a sensor file; ``demo`` is bundled.

    >>> sensor_path("demo").name
    'demo_sensor.json'
    """
    return _bundled(name, _SENSORS)


def _bundled(name: str | Path, files: Mapping[str, str]) -> Path:
    return Path(__file__).with_name(files[str(name)]) if str(name) in files and not Path(name).is_file() else Path(name)


@dataclass(frozen=True)
class SensorFile:
    """Content of a sensor file."""

    sensor: ForceTorqueSensor
    noise: tuple[float, float]  # standard deviations of moments [N m] and forces [N]
    uncertainty: Uncertainty | None  # uncertainty of the sensor; None in older files


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
    if uncertainty is not None and not isinstance(uncertainty, Uncertainty):
        raise ShapeError(
            f"write_sensor: uncertainty is {arguments.value_text(uncertainty)}: give Identification.uncertainty, or None."
        )
    if uncertainty is not None:
        content["uncertainty"] = {
            "unknowns": list(uncertainty.unknowns),
            **{name: _plain(getattr(uncertainty, name)) for name in _ARRAYS},
        }
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
    found = read_sensor_file(path)
    return found.sensor, found.noise


def read_sensor_file(path: str | Path) -> SensorFile:
    """Read a file of :func:`write_sensor` and its uncertainty, if any; raises NotFoundError and ValueRangeError."""
    if not isinstance(path, str | Path):
        raise ShapeError(f"read_sensor takes the path of a sensor file, got {type(path).__name__}.")
    path = Path(path)
    try:
        content = _content(path)
        load = SpatialInertia.from_parameters(content["load"])
        if load.mass < 0:
            raise ValueRangeError(f"the load's mass, {load.mass} kg, is negative. Identify the sensor again.")
        sensor = ForceTorqueSensor(
            load, content["bias"], content["sign"], content["mounting"], content.get("frame"), _inertia(content, load)
        )
        moment, force = checked_noise(content["noise"], none_at_all=True).tolist()
        known = content.get("uncertainty")
        uncertainty = None if known is None else _uncertainty(known)
    except FileNotFoundError:
        raise NotFoundError(f"no sensor file {str(path)!r}. {_advice()}") from None
    except TwistWrenchError as problem:
        raise ValueRangeError(f"{path}: {problem}") from None
    except (ValueError, TypeError, KeyError, OverflowError):
        raise ValueRangeError(f"{path}: is not a sensor file. {_advice()}") from None
    return SensorFile(sensor, (moment, force), uncertainty)


def _plain(x: Array) -> Any:
    """Convert to nested lists for JSON; infinities become null."""
    return [_plain(row) for row in x] if x.ndim > 1 else [float(v) if np.isfinite(v) else None for v in x]


def _uncertainty(known: dict[str, Any]) -> Uncertainty:
    # NaN in a float array stands for infinity in the file; it is rejected where infinity is not allowed.
    arrays = {name: np.array(known[name], float) for name in _ARRAYS}
    return Uncertainty(tuple(known["unknowns"]), **{k: np.where(np.isnan(x), np.inf, x) for k, x in arrays.items()})


def _content(path: Path) -> dict[str, Any]:
    with third_party_errors(lambda reason: ValueRangeError(f"is not a sensor file: {reason}. {_advice()}")):
        try:
            content = json.loads(read_text(path, _MOST_BYTES), parse_int=float)  # no integers beyond the float range
        except FileNotFoundError:
            raise NotFoundError(str(path)) from None
    if not isinstance(content, dict):
        raise ValueRangeError(f"is not a sensor file: it holds one value of kind {type(content).__name__}. {_advice()}")
    return content


def _inertia(content: dict[str, Any], load: SpatialInertia) -> Any:
    """State of the rotational inertia in the file; "unknown" if the entry is missing and the load is a point mass."""
    if "inertia" in content:
        return content["inertia"]
    point = SpatialInertia.from_com(load.mass, load.com) if load.mass else SpatialInertia.zero()
    same = np.allclose(load.parameters, point.parameters, rtol=1e-9, atol=1e-12)
    return "unknown" if same or load.defects() else "given"


# ── Logs of readings as CSV files

_QUATERNION = ("qw", "qx", "qy", "qz")
_MATRIX = tuple(f"r{row}{column}" for row in "123" for column in "123")
_GRAVITY = ("gx", "gy", "gz")
_DV = tuple(f"d{name}" for name in TWIST)
_POSITION = ("px", "py", "pz")
_KNOWN = ("time", *_QUATERNION, *_MATRIX, *_GRAVITY, *WRENCH, *TWIST, *_DV, *_POSITION)
_ALIASES = {"t": "time", "tx": "mx", "ty": "my", "tz": "mz"}
_ANGLES = {"roll", "pitch", "yaw", "rx", "ry", "rz", "a", "b", "c", "alpha", "beta", "gamma", "phi", "theta", "psi"}
_UNITS = {
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
        header = _names(file.header, f"{path}: line {file.header_line}")
        names = [name for name in header if name in _KNOWN]
        ignored = [name for name in header if name not in _KNOWN]
        _check_complete(names, ignored, f"{path}: line {file.header_line}", posed=robot is not None)
        table = file.table([k for k, name in enumerate(header) if name in _KNOWN])
    rotations, of_joints = None, tuple[str, ...]()
    if robot is not None:
        rotations, of_joints = orientations_by_joints(file, robot, frame, degrees=degrees)
    if not len(table):
        raise ValueRangeError(f"{path}: no readings after the header. Give at least one row.")
    columns = {name: table[:, k] for k, name in enumerate(names)}
    if "time" in columns and (k := late(columns["time"])) is not None:
        raise ValueRangeError(
            f"{path}: {file.place(k)}: time {printed(columns['time'][k])} s is not after the "
            f"{printed(columns['time'][k - 1])} s of the row before. Times must increase: sort the rows, or remove the column."
        )
    log = _log(path, columns, gravity, rotations)
    return replace(log, notes=_notes([name for name in ignored if name not in of_joints]))


def readings_of(log: ReadingsGiven, gravity: float, taker: str, **of_robot: Any) -> ReadingLog:
    """Log, or that of a file with gravity of this size [m/s²]; doubts about the log are left to the ``taker``'s report.

    ``of_robot`` are the arguments of :func:`read_log` for a file with positions of a robot's joints.
    """
    if not isinstance(log, str | Path):
        return checked_log(log, taker)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return read_log(log_path(log), gravity=(0.0, 0.0, -checked_strength(gravity)), **of_robot)


def _names(cells: Sequence[str], where: str) -> list[str]:
    check_header(cells, where, f"{_listed(WRENCH)} and an orientation")
    names = []
    for column in cells:
        match = re.fullmatch(r"([^\[(]*)(?:[\[(](.*)[\])])?", column.strip().strip('"'))
        name = (match[1] if match else column).strip().lower()
        name = _ALIASES.get(name, name)
        if name in _KNOWN and match and match[2] is not None:
            _check_unit(name, match[2], where)
        names.append(name if name in _KNOWN else column.strip().strip('"'))
    for name in names:
        if name in _KNOWN and names.count(name) > 1:
            raise ValueRangeError(f"{where}: column {name!r} is there {names.count(name)} times. Keep one of them.")
    return names


def _notes(ignored: list[str]) -> tuple[str, ...]:
    if not ignored:
        return ()
    meant = {name: difflib.get_close_matches(name.lower(), _KNOWN, n=1, cutoff=0.7) for name in ignored}
    said = [f"{name!r} (did you mean {near[0]!r}?)" if near else repr(name) for name, near in meant.items()]
    return (f"Columns that are not part of a reading are ignored: {_listed(said)}.",)


def _check_unit(name: str, unit: str, where: str) -> None:
    kind = name if name in _UNITS else name.rstrip("xyz")
    allowed = _UNITS.get(kind)
    if allowed is not None and unit.strip().lower() not in map(str.lower, allowed):
        raise ValueRangeError(
            f"{where}: column {name!r} is in {unit.strip()!r}. Convert it to {allowed[0] or 'a plain direction'} (SI units)."
        )


def _check_complete(names: list[str], ignored: list[str], where: str, *, posed: bool) -> None:
    if missing := [name for name in WRENCH if name not in names]:
        raise ValueRangeError(
            f"{where}: no column for {_listed(missing)}. {_near(missing, ignored)}A reading has {_listed(WRENCH)}, the moments "
            "perhaps as Tx, Ty, Tz."
        )
    kinds = [kind for kind in (_QUATERNION, _MATRIX, _GRAVITY) if any(name in names for name in kind)]
    if len(kinds) != 1 and not (posed and not kinds):
        said = "no orientation" if not kinds else "more than one orientation"
        angles = [name for name in ignored if re.sub(r"[^a-z]", "", name.lower()) in _ANGLES] if not kinds else []
        hint = (
            f"{_listed(angles)}: angles have many conventions, so none is guessed; convert them to a quaternion. "
            if len(angles) > 1
            else _near([*_QUATERNION, *_MATRIX, *_GRAVITY], ignored)
        )
        raise ValueRangeError(
            f"{where}: {said}. {hint}Give one of: {_listed(_QUATERNION)}; r11, r12, …, r33; {_listed(_GRAVITY)} (gravity's "
            "direction in the sensor's frame); or joint positions, and the robot: {0}.",
            Argument("robot", Placeholder("ROBOT")),
        )
    moving = TWIST + _DV if any(name in names for name in TWIST + _DV) else ()
    if missing := [name for name in (*(kinds[0] if kinds else ()), *moving) if name not in names]:
        raise ValueRangeError(
            f"{where}: no column for {_listed(missing)}, although others of its kind are there. {_near(missing, ignored)}"
            "Add it."
        )


def _near(missing: list[str], ignored: list[str]) -> str:
    """Suggest an ignored column whose name resembles a missing one."""
    for name in ignored:
        plain = re.sub(r"torque|moment|\bt(?=_)", "m", re.sub(r"force", "f", name.lower()))
        if near := difflib.get_close_matches(re.sub(r"[^a-z0-9]", "", plain), missing, n=1, cutoff=0.7):
            return f"Column {name!r} is not known: did you mean {near[0]!r}? "
    return ""


def _log(path: Path, columns: dict[str, Array], gravity: ArrayLike, rotations: Array | None) -> ReadingLog:
    """Log of columns; ``rotations`` (n, 3, 3) are those of a robot's joints, used if the file has no orientations."""

    def stacked(names: tuple[str, ...]) -> Array | None:
        return np.stack([columns[n] for n in names], axis=1) if names[0] in columns else None

    pose, direction, quaternion, matrix = None, gravity, stacked(_QUATERNION), stacked(_MATRIX)
    if quaternion is not None:
        pose = rotations_of_quaternions(quaternion, f"{path}: quaternion")
    elif matrix is not None:
        pose = matrix.reshape(-1, 3, 3)
    elif (along := stacked(_GRAVITY)) is not None:
        length = np.linalg.norm(along, axis=1, keepdims=True)
        if not length.all():
            row = int(np.flatnonzero(length[:, 0] == 0)[0])
            raise ValueRangeError(f"{path}: gx, gy, gz of reading {row} are zero. Give the direction of gravity.")
        direction = along / length * np.linalg.norm(np.asarray(gravity, float))
    elif rotations is not None:
        pose = rotations
    readings = np.stack([columns[n] for n in WRENCH], axis=1)
    log = ReadingLog.from_arrays(
        readings,
        pose=pose,
        gravity=direction,
        V=stacked(TWIST),
        dV=stacked(_DV),
        time=columns.get("time"),
        name=str(path),
    )
    if rotations is None or pose is rotations:
        return log
    return replace(log, turned=_angle_between(log.gravity, gravity_in_frame(rotations, gravity)))


def _angle_between(a: Array, b: Array) -> float:
    """Median angle [rad] between rows of two arrays (n, 3)."""
    across, along = np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)
    return float(np.median(np.arctan2(across, along)))


def orientations_by_joints(
    file: CsvFile, robot: Robot | str | Path, frame: str | None, *, degrees: bool
) -> tuple[Array, tuple[str, ...]]:
    """Orientations (n, 3, 3) of a frame by the joint positions in a file, and the columns that have them."""
    arm = robot if isinstance(robot, Robot) else load(robot)
    timed = any(time_meaning(split_unit(cell)[0]) is not None for cell in file.header)
    reading = Reading(file.path, rate=None if timed else 1.0, degrees=degrees)
    where = f"{file.path}: line {file.header_line}"
    columns = Columns.from_header(file.header, Coordinates.from_model(arm.model), where, reading, file.first)
    table = file.table(columns.used)
    q = columns.si_values(np.column_stack([np.zeros(len(table)), table]) if columns.counted else table, "q")
    return np.asarray(arm.forward_kinematics(q, frame))[:, :3, :3], tuple(columns.header)


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
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    parts: list[tuple[tuple[str, ...], Array | None]] = [
        (("time",), None if log.time is None else log.time[:, None]),
        (_GRAVITY, unit),
        (TWIST, log.V),
        (_DV, log.dV),
        (WRENCH, log.readings),
    ]
    present = [(names, values) for names, values in parts if values is not None]
    with csv_table(path, [n for names, _ in present for n in names]) as table:
        table.numbers(np.concatenate([values for _, values in present], axis=1))


def write_compensated(log: ReadingLog, compensated: Array, path: str | Path) -> Path:
    """Write readings (n, 6) without bias and load, with the times of the log if it has them."""
    head = [] if log.time is None else ["time"]
    rows = compensated if log.time is None else np.column_stack([log.time, compensated])
    with csv_table(path, [*head, *WRENCH]) as table:
        table.numbers(rows)
    return Path(path)


def _listed(names: Any) -> str:
    return ", ".join(names)


complete(globals())
