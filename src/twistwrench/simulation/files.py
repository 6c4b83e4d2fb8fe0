"""Simulations in files: CSV, which is a motion that other commands read, and NumPy's npz. Both give every bit back."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import NotFoundError, TrajectoryError
from ..outputs import replacing
from ..report.table_file import TableFile
from .events import Happening
from .forces import WORKS
from .result import SimulationResult

Array = NDArray[Any]

__all__ = ["read", "write_csv", "write_npz"]

_MARK = "twistwrench simulation 1"
_ARRAYS = ("times", "q", "dq", "ddq", "tau", "kinetic_energy", "potential_energy", "momentum")
_SAID: dict[str, type | tuple[type, ...]] = {
    "robot": str,
    "coordinate_names": tuple,
    "velocity_names": tuple,
    "stopped": str,
    "completed": bool,
    "method": str,
    "dt": (float, int),
    "steps": int,
    "rejected": int,
    "evaluations": int,
    "remarks": tuple,
    "relative_error": (float, int),
    "coordinate_units": tuple,
}
"""What a result says beside its arrays, and of which type it is; tuples are of texts."""
_ADDED = {"relative_error": np.nan, "coordinate_units": []}
"""What files from before lack: nothing is known of it."""
_UNREADABLE = (
    KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, OSError, EOFError, MemoryError, RuntimeError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What the standard library and NumPy raise for damaged files; RecursionError and NotImplementedError are RuntimeErrors."""
_MOMENTUM = tuple(f"momentum.{x}" for x in ("mx", "my", "mz", "fx", "fy", "fz"))


def write_csv(result: SimulationResult, path: str | Path) -> Path:
    """Comments with what is said in words, a header, and a row for each state."""
    v = result.velocity_names
    header = ["time", *result.coordinate_names, *(f"{n}.vel" for n in v), *(f"{n}.acc" for n in v)]
    header += [
        *(f"{n}.torque" for n in v),
        "kinetic_energy",
        "potential_energy",
        *(f"work.{w}" for w in WORKS),
        *_MOMENTUM,
    ]
    columns = [
        result.times,
        result.q,
        result.dq,
        result.ddq,
        result.tau,
        result.kinetic_energy,
        result.potential_energy,
    ]
    columns += [*(result.work[w] for w in WORKS), result.momentum]
    path = Path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        file.write(f"# {_MARK}\n# {_said(result)}\n{','.join(header)}\n".encode())
        TableFile(file).write(np.column_stack(columns))
    return path


def write_npz(result: SimulationResult, path: str | Path) -> Path:
    """One array each, and the words as JSON in a further one."""
    arrays = {name: getattr(result, name) for name in _ARRAYS} | {f"work_{w}": result.work[w] for w in WORKS}
    path = Path(path)
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, format=np.array(_MARK), said=np.array(_said(result)), **arrays)
    return path


def read(path: str | Path) -> SimulationResult:
    """What one of the two wrote; NotFoundError and TrajectoryError for anything else."""
    path = Path(path)
    if not path.is_file():
        raise NotFoundError(f"no file of a simulation {str(path)!r}. Give a .npz or .csv that a simulation wrote.")
    try:
        with path.open("rb") as file:
            archived = file.read(2) == b"PK"
        return _read_npz(path) if archived else _read_csv(path)
    except _UNREADABLE as problem:
        if isinstance(problem, TrajectoryError):
            raise
        raise TrajectoryError(
            f"{path}: cannot be read as a simulation: {type(problem).__name__}: {problem}. Give a .npz or .csv that "
            "SimulationResult wrote, whole."
        ) from None


def _read_npz(path: Path) -> SimulationResult:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        if "format" not in archive or str(archive["format"]) != _MARK:
            raise TrajectoryError(f"{path}: an archive of NumPy, but not of a simulation.")
        arrays = {name: archive[name] for name in _ARRAYS}
        work = {w: archive[f"work_{w}"] for w in WORKS}
        return _result(json.loads(str(archive["said"])), arrays, work)


def _read_csv(path: Path) -> SimulationResult:
    with path.open(encoding="utf-8") as file:
        if file.readline().strip() != f"# {_MARK}":
            raise TrajectoryError(
                f"{path}: does not begin with '# {_MARK}', so it is not the file of a simulation. A motion of another kind is "
                "what twistwrench torques reads."
            )
        said = json.loads(file.readline()[1:])
        file.readline()
        rows = file.readlines()
    if not rows or not rows[-1].endswith("\n"):
        raise TrajectoryError(f"{path}: the file is cut short. Write it again, whole.")
    table = np.loadtxt(rows, delimiter=",", comments=None, ndmin=2)
    nq, nv = len(said["coordinate_names"]), len(said["velocity_names"])
    sizes = [1, nq, nv, nv, nv, 1, 1, *([1] * len(WORKS)), 6]
    if table.shape[1] != sum(sizes):
        raise TrajectoryError(f"{path}: rows of {table.shape[1]} numbers, {sum(sizes)} wanted.")
    parts = [part.copy() for part in np.split(table, np.cumsum(sizes)[:-1], axis=1)]
    times, q, dq, ddq, tau, kinetic, potential, *work, momentum = parts
    arrays = dict(zip(_ARRAYS, (times[:, 0], q, dq, ddq, tau, kinetic[:, 0], potential[:, 0], momentum), strict=True))
    return _result(said, arrays, {w: x[:, 0] for w, x in zip(WORKS, work, strict=True)})


def _said(result: SimulationResult) -> str:
    events = [{"name": e.name, "time": e.time, "q": e.q.tolist(), "dq": e.dq.tolist()} for e in result.events]
    words = {name: getattr(result, name) for name in _SAID}
    return json.dumps({**words, "error_estimate": result.error_estimate.tolist(), "events": events})


def _result(said: Any, arrays: Mapping[str, Array], work: Mapping[str, Array]) -> SimulationResult:
    if not isinstance(said, dict):
        raise TrajectoryError("the file of a simulation has no words to its arrays, but something else.")
    words = {name: _word(said, name, kind) for name, kind in _SAID.items()}
    nq, nv = len(words["coordinate_names"]), len(words["velocity_names"])
    if len(words["coordinate_units"]) not in (0, nq):
        raise TrajectoryError(
            f"the file of a simulation has units of {len(words['coordinate_units'])} coordinates of {nq}."
        )
    off = _numbers(said.get("error_estimate", [np.nan] * nv), "error_estimate", nv)
    events = tuple(
        Happening(_word(e, "name", str), float(_word(e, "time", (float, int))), *_state(e, nq, nv))
        for e in said["events"]
    )
    n = len(arrays["times"]) if arrays["times"].ndim == 1 else 0
    wide = {"q": (n, nq), "momentum": (n, 6), **dict.fromkeys(("dq", "ddq", "tau"), (n, nv))}
    for name, array in {**arrays, **work}.items():
        if not n or array.shape != wide.get(name, (n,)) or array.dtype != float:
            raise TrajectoryError(
                f"the file of a simulation has {array.dtype} of shape {array.shape} for {name}, expected float64 of shape "
                f"{wide.get(name, (n,))} and at least one state."
            )
    return SimulationResult(**{**words, **arrays}, work=dict(work), events=events, error_estimate=off)


def _word(said: Mapping[str, Any], name: str, kind: type | tuple[type, ...]) -> Any:
    """One of the words, of the type that it is to have."""
    found = said.get(name, _ADDED[name]) if name in _ADDED else said[name]
    if kind is tuple and isinstance(found, list) and all(isinstance(x, str) for x in found):
        return tuple(found)
    if kind is tuple or not isinstance(found, kind) or (isinstance(found, bool) and kind is not bool):
        raise TrajectoryError(f"the file of a simulation has {found!r} for {name}, which is of another type.")
    return found


def _state(said: Mapping[str, Any], nq: int, nv: int) -> tuple[Array, Array]:
    return _numbers(said["q"], "q of an event", nq), _numbers(said["dq"], "dq of an event", nv)


def _numbers(given: Any, name: str, n: int) -> Array:
    found = np.array(given)
    if found.shape != (n,) or found.dtype.kind not in "if":
        raise TrajectoryError(f"the file of a simulation has {given!r} for {name}, expected {n} numbers.")
    return found.astype(float)
