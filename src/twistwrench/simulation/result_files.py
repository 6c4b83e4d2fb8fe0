"""Simulation results in files: CSV that other commands read, and exact NumPy npz."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from ..core.errors import NotFoundError, TrajectoryError, ValueRangeError
from ..core.files import MOST_BYTES, as_path, is_stream, read_bytes, replacing
from ..core.tables import CsvWriter, unescape_cell
from ..core.third_party import third_party_errors
from ..core.typing import Array
from ..motion.column_names import DEGREES, ENERGIES, MOMENTUM, SUFFIX, WORK, time_column
from ..motion.coordinates import Coordinates
from ..motion.log_table import FileEnds
from ..motion.readers.array_files import check_archive
from .events import Happening
from .forces import WORKS
from .result import SimulationResult

_MARK = "twistwrench simulation 1"
_ARRAYS = ("times", "q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "momentum")
_SAID = {
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
_ADDED: dict[str, Any] = {"relative_error": math.nan, "coordinate_units": []}
"""Fields missing in older files, with the value for unknown."""


def write_csv(result: SimulationResult, path: str | Path, *, degrees: bool = False) -> Path:
    """Write comments with the text fields, a header, and a row for each state."""
    header = _header(result.coordinate_names, result.velocity_names)
    factors: dict[str, Array] = {}
    if degrees:
        header, factors = _in_degrees(result, header)
    turned, turning = factors.get("q", 1.0), factors.get("dq", 1.0)
    columns = [result.times, result.q * turned, result.dq * turning, result.ddq * turning, result.tau]
    columns += [result.kinetic_energy, result.potential_energy, *(result.work[w] for w in WORKS), result.momentum]
    path = as_path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        file.write(f"# {_MARK}\n# {_said(result)}\n".encode())
        writer = CsvWriter(file)
        writer.row(header)
        writer.numbers(np.column_stack(columns))
    return path


def _in_degrees(result: SimulationResult, header: list[str]) -> tuple[list[str], dict[str, Array]]:
    """Header in degrees, and the factors of coordinates and velocities."""
    if result.simulated is None:
        raise ValueRangeError(
            "degrees: this result was read from a file, and has no robot that defines its angles: "
            "result.with_robot(robot).to_csv(…)."
        )
    names = Coordinates.from_model(result.simulated.model)
    said = [header for part in ("q", "dq", "ddq") for header in names.headers(part, degrees=True)]
    turning = {"q": names.angular, "dq": names.angular_velocity}
    factors = {part: np.where(angular, np.degrees(1.0), 1.0) for part, angular in turning.items()}
    return [header[0], *said, *header[1 + len(said) :]], factors


def _to_radians(header: list[str], expected: list[str]) -> Array | None:
    """Conversion factor of each column to SI units, (n,); None if the columns are not the expected ones."""
    degree, units = np.radians(1.0), tuple(f" [{unit}]" for unit in DEGREES.values())
    if len(header) != len(expected):
        return None
    in_degrees = [name in [wanted + unit for unit in units] for name, wanted in zip(header, expected, strict=True)]
    if any(name != wanted and not turned for name, wanted, turned in zip(header, expected, in_degrees, strict=True)):
        return None
    return np.where(in_degrees, degree, 1.0)


def _header(coordinates: Sequence[str], v: Sequence[str]) -> list[str]:
    header = [time_column(coordinates), *coordinates]
    header += [f"{n}{SUFFIX[part]}" for part in ("dq", "ddq", "tau") for n in v]
    return [*header, *ENERGIES, *(f"{WORK}{w}" for w in WORKS), *MOMENTUM]


def write_npz(result: SimulationResult, path: str | Path) -> Path:
    """Write one array for each numeric field, and the text fields as JSON in another."""
    arrays = {name: getattr(result, name) for name in _ARRAYS} | {f"work_{w}": result.work[w] for w in WORKS}
    path = as_path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, format=np.array(_MARK), said=np.array(_said(result)), **arrays)
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
        return _result(_words(json.loads(str(archive["said"]))), arrays, work)


def _read_csv(data: bytes) -> SimulationResult:
    lines = io.StringIO(data.decode().replace("\r\n", "\n"))
    if lines.readline().strip() != f"# {_MARK}":
        raise TrajectoryError(
            f"does not begin with '# {_MARK}', so it is not the file of a simulation. A motion of another kind is "
            "what twistwrench torques reads."
        )
    words = _words(json.loads(lines.readline()[1:]))
    coordinates, velocities = words["coordinate_names"], words["velocity_names"]
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
    times, q, dq, ddq, tau, kinetic, potential, *work, momentum = parts
    arrays = dict(zip(_ARRAYS, (times[:, 0], q, dq, ddq, tau, kinetic[:, 0], potential[:, 0], momentum), strict=True))
    return _result(words, arrays, {w: x[:, 0] for w, x in zip(WORKS, work, strict=True)})


def _said(result: SimulationResult) -> str:
    events = [{"name": e.name, "time": e.time, "q": e.q.tolist(), "dq": e.dq.tolist()} for e in result.events]
    words = {name: getattr(result, name) for name in _SAID}
    return json.dumps({**words, "error_estimate": result.error_estimate.tolist(), "events": events})


def _words(said: Any) -> dict[str, Any]:
    """Text fields of the file, each of its type."""
    if not isinstance(said, dict):
        raise _other_kind("a text field")
    said = {**_ADDED, **said}
    for name, kind in _SAID.items():
        if not _has_type(said.get(name), kind):
            raise _other_kind(repr(name))
    if not isinstance(said.get("events"), list):
        raise _other_kind("'events'")
    words: dict[str, Any] = {n: tuple(said[n]) if kind is list else said[n] for n, kind in _SAID.items()}
    nq, nv = len(words["coordinate_names"]), len(words["velocity_names"])
    if len(words["coordinate_units"]) not in (0, nq):
        raise _other_kind("'coordinate_units'")
    off = _numbers("'error_estimate'", said.get("error_estimate", [math.nan] * nv), (nv,))
    events = []
    for event in said["events"]:
        if not isinstance(event, dict) or not isinstance(event.get("name"), str):
            raise _other_kind("an event")
        parts = (("time", ()), ("q", (nq,)), ("dq", (nv,)))
        time, q, dq = (_numbers(f"an event's {part}", event.get(part), n) for part, n in parts)
        events.append(Happening(event["name"], float(time), q, dq))
    return {**words, "error_estimate": off, "events": tuple(events)}


def _has_type(value: object, kind: type) -> bool:
    if kind in (int, float):
        return isinstance(value, (float, int) if kind is float else int) and not isinstance(value, bool)
    return isinstance(value, kind) and (kind is not list or all(isinstance(part, str) for part in cast("Any", value)))


def _numbers(what: str, x: Any, shape: tuple[int, ...]) -> Array:
    found = np.asarray(x)
    if found.dtype.kind not in "iuf" or found.shape != shape:
        raise _other_kind(what)
    return found.astype(float)


def _other_kind(what: str) -> TrajectoryError:
    return TrajectoryError(f"the file of a simulation has {what} of another kind or size. Write it again, whole.")


def _result(words: Mapping[str, Any], arrays: Mapping[str, Array], work: Mapping[str, Array]) -> SimulationResult:
    n, nq, nv = np.size(arrays["times"]), len(words["coordinate_names"]), len(words["velocity_names"])
    widths: dict[str, tuple[int, ...]] = {"q": (nq,), "dq": (nv,), "ddq": (nv,), "tau": (nv,), "momentum": (6,)}
    if not n:
        raise TrajectoryError("the file of a simulation has no state.")
    found = {name: _numbers(repr(name), x, (n, *widths.get(name, ()))) for name, x in arrays.items()}
    done = {name: _numbers(f"the work of {name}", x, (n,)) for name, x in work.items()}
    return SimulationResult(**{**words, **found}, work=done, friction=bool(np.any(done["friction"])))
