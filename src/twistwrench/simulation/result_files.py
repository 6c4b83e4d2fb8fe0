"""Simulation results in files: CSV that other commands read, and exact NumPy npz."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import NotFoundError, TrajectoryError, ValueRangeError
from ..core.files import MOST_BYTES, as_path, is_stream, read_bytes, replacing
from ..core.tables import CsvWriter, unescape_cell
from ..core.third_party import third_party_errors
from ..core.typing import Array
from ..motion.column_names import DEGREES, ENERGIES, MOMENTUM, SUFFIX, WORK, time_column
from ..motion.coordinates import Coordinates
from ..motion.readers.file_ends import FileEnds
from ..motion.readers.numpy_files import check_archive
from .events import Happening
from .forces import WORKS
from .result import SimulationResult

_MARK = "twistwrench simulation 1"
_ARRAYS = ("times", "q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "momentum")
_TEXT_FIELDS = {
    "robot": str,
    "coordinate_names": list,
    "velocity_names": list,
    "stopped": str,
    "completed": bool,
    "method": str,
    "dt": float,
    "steps": int,
    "rejected": int,
    "evaluations": int,
    "remarks": list,
    "relative_error": float,
    "coordinate_units": list,
}
"""Text fields and their types; lists hold text. Events are stored separately."""
_LATER_FIELDS: dict[str, Any] = {"relative_error": math.nan, "coordinate_units": []}
"""Fields missing in older files, with the value for unknown."""


def write_csv(result: SimulationResult, path: str | Path, *, degrees: bool = False) -> Path:
    """Write comments with the text fields, a header, and a row for each state."""
    header = _header(result.coordinate_names, result.velocity_names)
    factors: dict[str, Array] = {}
    if degrees:
        header, factors = _header_and_factors_in_degrees(result, header)
    q_factor, dq_factor = factors.get("q", 1.0), factors.get("dq", 1.0)
    columns = [result.times, result.q * q_factor, result.dq * dq_factor, result.ddq * dq_factor, result.tau]
    columns += [result.kinetic_energy, result.potential_energy, *(result.work[w] for w in WORKS), result.momentum]
    path = as_path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        file.write(f"# {_MARK}\n# {_text_fields(result)}\n".encode())
        writer = CsvWriter(file)
        writer.row(header)
        writer.numbers(np.column_stack(columns))
    return path


def _header_and_factors_in_degrees(result: SimulationResult, header: list[str]) -> tuple[list[str], dict[str, Array]]:
    """Header in degrees, and the factors of coordinates and velocities."""
    if result.simulated is None:
        raise ValueRangeError(
            "degrees: this result was read from a file, and has no robot that defines its angles: "
            "result.with_robot(robot).to_csv(…)."
        )
    names = Coordinates.from_model(result.simulated.model)
    states = [
        *names.headers("q", degrees=True),
        *names.headers("dq", degrees=True),
        *names.headers("ddq", degrees=True),
    ]
    factors = {
        "q": np.where(names.angular, np.degrees(1.0), 1.0),
        "dq": np.where(names.angular_velocity, np.degrees(1.0), 1.0),
    }
    return [header[0], *states, *header[1 + len(states) :]], factors


def _to_radians(header: list[str], expected: list[str]) -> Array | None:
    """Conversion factor of each column to SI units, (n,); None if the columns are not the expected ones."""
    if len(header) != len(expected):
        return None
    factors = np.ones(len(header))
    for k, (name, si_name) in enumerate(zip(header, expected, strict=True)):
        if name in [f"{si_name} [{unit}]" for unit in DEGREES.values()]:
            factors[k] = np.radians(1.0)
        elif name != si_name:
            return None
    return factors


def _header(coordinates: Sequence[str], v: Sequence[str]) -> list[str]:
    header = [time_column(coordinates), *coordinates]
    for part in ("dq", "ddq", "tau"):
        header += [f"{name}{SUFFIX[part]}" for name in v]
    return [*header, *ENERGIES, *(f"{WORK}{w}" for w in WORKS), *MOMENTUM]


def write_npz(result: SimulationResult, path: str | Path) -> Path:
    """Write one array for each numeric field, and the text fields as JSON in another."""
    arrays = {name: getattr(result, name) for name in _ARRAYS}
    arrays |= {f"work_{w}": result.work[w] for w in WORKS}
    path = as_path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, format=np.array(_MARK), said=np.array(_text_fields(result)), **arrays)
    return path


def read(path: str | Path) -> SimulationResult:
    """Read a file of :func:`write_csv` or :func:`write_npz`; raises NotFoundError, or TrajectoryError for other content."""
    path = as_path(path)
    advice = "Give a .npz or .csv that SimulationResult wrote, whole."
    try:
        with third_party_errors(lambda reason: TrajectoryError(f"cannot be read as a simulation: {reason}. {advice}")):
            return _read(path)
    except TrajectoryError as problem:
        raise TrajectoryError(f"{path}: {str(problem).removeprefix(f'{path}: ')}") from None


def _read(path: Path) -> SimulationResult:
    try:
        data = read_bytes(path, MOST_BYTES if is_stream(path) else sys.maxsize)
    except FileNotFoundError:
        raise NotFoundError(
            f"no file of a simulation {str(path)!r}. Give a .npz or .csv that a simulation wrote."
        ) from None
    if data[:2] != b"PK":
        return _read_csv(data)
    if not is_stream(path):
        check_archive(FileEnds.from_path(path))
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        if "format" not in archive or str(archive["format"]) != _MARK:
            raise TrajectoryError("an archive of NumPy, but not of a simulation.")
        arrays = {name: archive[name] for name in _ARRAYS}
        work = {w: archive[f"work_{w}"] for w in WORKS}
        return _result(_validated_fields(json.loads(str(archive["said"]))), arrays, work)


def _read_csv(data: bytes) -> SimulationResult:
    lines = io.StringIO(data.decode().replace("\r\n", "\n"))
    if lines.readline().strip() != f"# {_MARK}":
        raise TrajectoryError(
            f"does not begin with '# {_MARK}', so it is not the file of a simulation. A motion of another kind is "
            "what twistwrench torques reads."
        )
    fields = _validated_fields(json.loads(lines.readline()[1:]))
    coordinates, velocities = fields["coordinate_names"], fields["velocity_names"]
    header = [unescape_cell(cell) for cell in next(csv.reader(lines), [])]
    factors = _to_radians(header, _header(coordinates, velocities))
    if factors is None:
        raise TrajectoryError("columns other than those that were written. Write it again, whole.")
    rows = lines.readlines()
    if not rows or not rows[-1].endswith("\n"):
        raise TrajectoryError("the file is cut short. Write it again, whole.")
    table = np.loadtxt(rows, delimiter=",", comments=None, ndmin=2)
    nq, nv = len(coordinates), len(velocities)
    sizes = [1, nq, nv, nv, nv, 1, 1, *([1] * len(WORKS)), 6]
    if table.shape[1] != sum(sizes):
        raise TrajectoryError(f"rows of {table.shape[1]} numbers, {sum(sizes)} wanted.")
    parts = [part.copy() for part in np.split(table * factors, np.cumsum(sizes)[:-1], axis=1)]
    times, q, dq, ddq, tau, kinetic, potential, *works, momentum = parts
    arrays = dict(zip(_ARRAYS, (times[:, 0], q, dq, ddq, tau, kinetic[:, 0], potential[:, 0], momentum), strict=True))
    return _result(fields, arrays, {name: x[:, 0] for name, x in zip(WORKS, works, strict=True)})


def _text_fields(result: SimulationResult) -> str:
    """Text fields and events as JSON."""
    events = [{"name": e.name, "time": e.time, "q": e.q.tolist(), "dq": e.dq.tolist()} for e in result.events]
    fields = {name: getattr(result, name) for name in _TEXT_FIELDS}
    return json.dumps({**fields, "error_estimate": result.error_estimate.tolist(), "events": events})


def _validated_fields(content: Any) -> dict[str, Any]:
    """Text fields of the file, each of its type."""
    if not isinstance(content, dict):
        raise _other_kind("a text field")
    content = {**_LATER_FIELDS, **content}
    fields: dict[str, Any] = {}
    for name, kind in _TEXT_FIELDS.items():
        value = content.get(name)
        if not _has_type(value, kind):
            raise _other_kind(repr(name))
        fields[name] = tuple(value) if kind is list else value
    if not isinstance(content.get("events"), list):
        raise _other_kind("'events'")
    nq, nv = len(fields["coordinate_names"]), len(fields["velocity_names"])
    if len(fields["coordinate_units"]) not in (0, nq):
        raise _other_kind("'coordinate_units'")
    error = _numbers("'error_estimate'", content.get("error_estimate", [math.nan] * nv), (nv,))
    events = []
    for event in content["events"]:
        if not isinstance(event, dict) or not isinstance(event.get("name"), str):
            raise _other_kind("an event")
        time = _numbers("an event's time", event.get("time"), ())
        q = _numbers("an event's q", event.get("q"), (nq,))
        dq = _numbers("an event's dq", event.get("dq"), (nv,))
        events.append(Happening(event["name"], float(time), q, dq))
    return {**fields, "error_estimate": error, "events": tuple(events)}


def _has_type(value: object, kind: type) -> bool:
    """True if a value of the file has a type; lists are of text, and integers are floats too."""
    if isinstance(value, bool):
        return kind is bool
    if kind is float:
        return isinstance(value, (float, int))
    if kind is list:
        return isinstance(value, list) and all(isinstance(part, str) for part in value)
    return isinstance(value, kind)


def _numbers(what: str, x: Any, shape: tuple[int, ...]) -> Array:
    """Array of real numbers of a shape."""
    array = np.asarray(x)
    if array.dtype.kind not in "iuf" or array.shape != shape:
        raise _other_kind(what)
    return array.astype(float)


def _other_kind(what: str) -> TrajectoryError:
    return TrajectoryError(f"the file of a simulation has {what} of another kind or size. Write it again, whole.")


def _result(fields: Mapping[str, Any], arrays: Mapping[str, Array], work: Mapping[str, Array]) -> SimulationResult:
    """Result from the content of a file, after a check of its shapes."""
    n, nq, nv = np.size(arrays["times"]), len(fields["coordinate_names"]), len(fields["velocity_names"])
    widths: dict[str, tuple[int, ...]] = {"q": (nq,), "dq": (nv,), "ddq": (nv,), "tau": (nv,), "momentum": (6,)}
    if not n:
        raise TrajectoryError("the file of a simulation has no state.")
    checked_arrays = {name: _numbers(repr(name), x, (n, *widths.get(name, ()))) for name, x in arrays.items()}
    works = {name: _numbers(f"the work of {name}", x, (n,)) for name, x in work.items()}
    return SimulationResult(**{**fields, **checked_arrays}, work=works, friction=bool(np.any(works["friction"])))
