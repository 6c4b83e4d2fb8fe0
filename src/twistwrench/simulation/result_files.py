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

_FORMAT_NAME = "twistwrench simulation 1"
"""First line of a CSV file, and an entry of an archive."""
_TEXT_ENTRY = "said"
"""Name of the text fields in an archive."""
_ZIP_BEGIN = b"PK"
"""First bytes of an archive."""
_ARRAY_FIELDS = ("times", "q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "momentum")
"""Fields that are stored as arrays."""
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
"""Fields that are stored as text, and their types; lists hold text. Events are stored separately."""
_LATER_FIELDS: dict[str, Any] = {"relative_error": math.nan, "coordinate_units": []}
"""Fields missing in older files, with the value that means unknown."""


def write_csv(result: SimulationResult, path: str | Path, *, degrees: bool = False) -> Path:
    """Write comments with the text fields, a header, and a row for each state."""
    header = _column_headings(result.coordinate_names, result.velocity_names)
    factors: dict[str, Array] = {}
    if degrees:
        header, factors = _header_and_factors_in_degrees(result, header)
    q_factor = factors.get("q", 1.0)
    dq_factor = factors.get("dq", 1.0)
    works = [result.work[name] for name in WORKS]
    columns = [result.times, result.q * q_factor, result.dq * dq_factor, result.ddq * dq_factor, result.tau]
    columns += [result.kinetic_energy, result.potential_energy, *works, result.momentum]
    path = as_path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        file.write(f"# {_FORMAT_NAME}\n# {_text_fields(result)}\n".encode())
        writer = CsvWriter(file)
        writer.row(header)
        writer.numbers(np.column_stack(columns))
    return path


def _header_and_factors_in_degrees(result: SimulationResult, header: list[str]) -> tuple[list[str], dict[str, Array]]:
    """Header in degrees, and the factors from SI units for coordinates (nq,) and velocities (nv,), by quantity."""
    if result.simulated is None:
        raise ValueRangeError(
            "degrees: this result was read from a file, and has no robot that defines its angles: "
            "result.with_robot(robot).to_csv(…)."
        )
    coordinates = Coordinates.from_model(result.simulated.model)
    state_headings = [
        *coordinates.headers("q", degrees=True),
        *coordinates.headers("dq", degrees=True),
        *coordinates.headers("ddq", degrees=True),
    ]
    factors = {
        "q": np.where(coordinates.angular, np.degrees(1.0), 1.0),
        "dq": np.where(coordinates.angular_velocity, np.degrees(1.0), 1.0),
    }
    time_heading = header[0]
    other_headings = header[1 + len(state_headings) :]  # after time and states
    return [time_heading, *state_headings, *other_headings], factors


def _si_factors(header: list[str], expected: list[str]) -> Array | None:
    """Conversion factor of each column to SI units, (n,); None if the columns are not the expected ones."""
    if len(header) != len(expected):
        return None
    factors = np.ones(len(header))
    for k, (heading, si_heading) in enumerate(zip(header, expected, strict=True)):
        headings_in_degrees = [f"{si_heading} [{unit}]" for unit in DEGREES.values()]
        if heading in headings_in_degrees:
            factors[k] = np.radians(1.0)
        elif heading != si_heading:
            return None
    return factors


def _column_headings(coordinate_names: Sequence[str], velocity_names: Sequence[str]) -> list[str]:
    """Headings of the columns in SI units."""
    header = [time_column(coordinate_names), *coordinate_names]
    for quantity in ("dq", "ddq", "tau"):
        header += [f"{name}{SUFFIX[quantity]}" for name in velocity_names]
    works = [f"{WORK}{name}" for name in WORKS]
    return [*header, *ENERGIES, *works, *MOMENTUM]


def write_npz(result: SimulationResult, path: str | Path) -> Path:
    """Write one array for each numeric field, and the text fields as JSON in another."""
    arrays = {name: getattr(result, name) for name in _ARRAY_FIELDS}
    arrays |= {f"work_{name}": result.work[name] for name in WORKS}
    content: dict[str, Any] = {"format": np.array(_FORMAT_NAME), _TEXT_ENTRY: np.array(_text_fields(result)), **arrays}
    path = as_path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, **content)
    return path


def read(path: str | Path) -> SimulationResult:
    """Result from a file of :func:`write_csv` or :func:`write_npz`; raises NotFoundError and TrajectoryError."""
    path = as_path(path)
    advice = "Give a .npz or .csv that SimulationResult wrote, whole."
    try:
        with third_party_errors(lambda reason: TrajectoryError(f"cannot be read as a simulation: {reason}. {advice}")):
            return _read(path)
    except TrajectoryError as problem:
        reason = str(problem).removeprefix(f"{path}: ")  # some readers name the file already
        raise TrajectoryError(f"{path}: {reason}") from None


def _read(path: Path) -> SimulationResult:
    """Result from a file; a file that does not begin like an archive is read as CSV."""
    max_bytes = MOST_BYTES if is_stream(path) else sys.maxsize  # only a stream can be endless
    try:
        data = read_bytes(path, max_bytes)
    except FileNotFoundError:
        raise NotFoundError(
            f"no file of a simulation {str(path)!r}. Give a .npz or .csv that a simulation wrote."
        ) from None
    if not data.startswith(_ZIP_BEGIN):
        return _read_csv(data)
    if not is_stream(path):
        check_archive(FileEnds.from_path(path))
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        if "format" not in archive or str(archive["format"]) != _FORMAT_NAME:
            raise TrajectoryError("an archive of NumPy, but not of a simulation.")
        arrays = {name: archive[name] for name in _ARRAY_FIELDS}
        works = {name: archive[f"work_{name}"] for name in WORKS}
        text_content = json.loads(str(archive[_TEXT_ENTRY]))
        text_fields = _validated_fields(text_content)
        return _checked_result(text_fields, arrays, works)


def _read_csv(data: bytes) -> SimulationResult:
    """Result from the bytes of a CSV file."""
    lines = io.StringIO(data.decode().replace("\r\n", "\n"))
    if lines.readline().strip() != f"# {_FORMAT_NAME}":
        raise TrajectoryError(
            f"does not begin with '# {_FORMAT_NAME}', so it is not the file of a simulation. A motion of another kind is "
            "what twistwrench torques reads."
        )
    comment = lines.readline()
    text_content = json.loads(comment[1:])  # without the sign of a comment
    text_fields = _validated_fields(text_content)
    coordinate_names = text_fields["coordinate_names"]
    velocity_names = text_fields["velocity_names"]
    first_row = next(csv.reader(lines), [])
    header = [unescape_cell(cell) for cell in first_row]
    factors = _si_factors(header, _column_headings(coordinate_names, velocity_names))
    if factors is None:
        raise TrajectoryError("columns other than those that were written. Write it again, whole.")
    rows = lines.readlines()
    if not rows or not rows[-1].endswith("\n"):
        raise TrajectoryError("the file is cut short. Write it again, whole.")
    table = np.loadtxt(rows, delimiter=",", comments=None, ndmin=2)
    nq, nv = len(coordinate_names), len(velocity_names)
    # Of time, q, dq, ddq, tau, both energies, works and momentum.
    widths = [1, nq, nv, nv, nv, 1, 1, *([1] * len(WORKS)), len(MOMENTUM)]
    if table.shape[1] != sum(widths):
        raise TrajectoryError(f"rows of {table.shape[1]} numbers, {sum(widths)} wanted.")
    first_columns = np.cumsum(widths)[:-1]  # of all parts but the first
    parts = [part.copy() for part in np.split(table * factors, first_columns, axis=1)]
    times, q, dq, ddq, tau, kinetic, potential, *work_columns, momentum = parts
    arrays = {
        "times": times[:, 0],
        "q": q,
        "dq": dq,
        "ddq": ddq,
        "tau": tau,
        "kinetic_energy": kinetic[:, 0],
        "potential_energy": potential[:, 0],
        "momentum": momentum,
    }
    works = {name: column[:, 0] for name, column in zip(WORKS, work_columns, strict=True)}
    return _checked_result(text_fields, arrays, works)


def _text_fields(result: SimulationResult) -> str:
    """Text fields, the error estimate and events as JSON."""
    events = [{"name": e.name, "time": e.time, "q": e.q.tolist(), "dq": e.dq.tolist()} for e in result.events]
    fields = {name: getattr(result, name) for name in _TEXT_FIELDS}
    return json.dumps({**fields, "error_estimate": result.error_estimate.tolist(), "events": events})


def _validated_fields(content: Any) -> dict[str, Any]:
    """Text fields, error estimate and events from the JSON of a file; raises TrajectoryError unless they have their types."""
    if not isinstance(content, dict):
        raise _content_error("a text field")
    content = {**_LATER_FIELDS, **content}  # older files lack the later fields
    fields: dict[str, Any] = {}
    for name, field_type in _TEXT_FIELDS.items():
        value = content.get(name)
        if not _has_type(value, field_type):
            raise _content_error(repr(name))
        fields[name] = tuple(value) if field_type is list else value
    if not isinstance(content.get("events"), list):
        raise _content_error("'events'")
    nq, nv = len(fields["coordinate_names"]), len(fields["velocity_names"])
    if len(fields["coordinate_units"]) not in (0, nq):
        raise _content_error("'coordinate_units'")
    unknown_error = [math.nan] * nv  # of older files
    error = _checked_array("'error_estimate'", content.get("error_estimate", unknown_error), (nv,))
    events = []
    for event in content["events"]:
        if not isinstance(event, dict) or not isinstance(event.get("name"), str):
            raise _content_error("an event")
        time = _checked_array("an event's time", event.get("time"), ())
        q = _checked_array("an event's q", event.get("q"), (nq,))
        dq = _checked_array("an event's dq", event.get("dq"), (nv,))
        events.append(Happening(event["name"], float(time), q, dq))
    return {**fields, "error_estimate": error, "events": tuple(events)}


def _has_type(value: object, expected_type: type) -> bool:
    """True if a value of the file has a type. Lists must hold text. An integer is also a float; a bool is neither."""
    if isinstance(value, bool):
        return expected_type is bool
    if expected_type is float:
        return isinstance(value, (float, int))
    if expected_type is list:
        return isinstance(value, list) and all(isinstance(item, str) for item in value)
    return isinstance(value, expected_type)


def _checked_array(label: str, x: Any, shape: tuple[int, ...]) -> Array:
    """Array of real numbers; raises TrajectoryError unless it has this shape."""
    array = np.asarray(x)
    if array.dtype.kind not in "iuf" or array.shape != shape:
        raise _content_error(label)
    return array.astype(float)


def _content_error(label: str) -> TrajectoryError:
    """Error for an entry of the file with another kind or size; ``label`` names the entry."""
    return TrajectoryError(f"the file of a simulation has {label} of another kind or size. Write it again, whole.")


def _checked_result(
    text_fields: Mapping[str, Any], arrays: Mapping[str, Array], works: Mapping[str, Array]
) -> SimulationResult:
    """Result from the content of a file, after a check of its shapes."""
    n = np.size(arrays["times"])
    nq, nv = len(text_fields["coordinate_names"]), len(text_fields["velocity_names"])
    if not n:
        raise TrajectoryError("the file of a simulation has no state.")
    widths = {"q": nq, "dq": nv, "ddq": nv, "tau": nv, "momentum": len(MOMENTUM)}
    checked_arrays: dict[str, Any] = {}
    for name, x in arrays.items():
        shape = (n, widths[name]) if name in widths else (n,)
        checked_arrays[name] = _checked_array(repr(name), x, shape)
    work = {name: _checked_array(f"the work of {name}", x, (n,)) for name, x in works.items()}
    has_friction = bool(np.any(work["friction"]))
    return SimulationResult(**text_fields, **checked_arrays, work=work, friction=has_friction)
