"""Exchange of motions with other libraries in memory: xarray datasets of motions, and pandas DataFrames as motion files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core import arguments
from ..core.errors import MissingExtraError, ShapeError
from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.joints.units import unit_of, units_of
from ..mechanics.model.model import Model
from .column_names import time_meaning
from .coordinates import Coordinates
from .readers.columnar_file import ArrayFile


def labelled_dataset(model: Model, times: Array, arrays: Mapping[str, Array]) -> Any:
    """Dataset (``xarray.Dataset``) of q and other quantities, each (..., n, nq) or (..., n, nv).

    Axes are ``sample`` (``sample_0``, ``sample_1``, … if there are several), ``time`` [s], ``coordinate`` for q and
    ``joint`` otherwise. Torques per step, one fewer than the times, are padded with NaN. Raises MissingExtraError.
    """
    try:
        import xarray
    except ImportError:
        raise MissingExtraError.from_extra("xarray", "tables", "Making a Dataset") from None
    kinds = Coordinates.from_model(model)
    sample_axes = next(iter(arrays.values())).ndim - 2
    samples = [f"sample_{k}" for k in range(sample_axes)]
    if sample_axes == 1:
        samples = ["sample"]
    coords = {
        "time": ("time", times, {"units": "s"}),
        "coordinate": list(kinds.names),
        "joint": list(kinds.velocity_names),
    }
    variables = {}
    for name, array in arrays.items():
        axis = "coordinate" if name == "q" else "joint"
        missing = len(times) - array.shape[-2]
        if missing:
            array = np.concatenate([array, np.full((*array.shape[:-2], missing, array.shape[-1]), np.nan)], axis=-2)
        variables[name] = ((*samples, "time", axis), array, {"units": _units(name, kinds)})
    return xarray.Dataset(variables, coords, {"robot": model.name})


def _units(name: str, kinds: Coordinates) -> str:
    """Common unit of all entries, or the units of the entries in order."""
    if name == "q":
        units = [unit_of("q", bool(turns)) for turns in kinds.angular]
        for part in kinds.quaternions:
            units[part] = ["1"] * len(units[part])
    else:
        units = [unit.replace("²", "^2") for unit in units_of(name, kinds.angular_velocity)]
    if len(set(units)) == 1:
        return units[0]
    return ", ".join(units)


_NAME = "the DataFrame"


def data_frame_file(frame: Any) -> tuple[ArrayFile, tuple[str, ...]]:
    """File of a DataFrame: index if it is a time, numeric columns, and a note on others; raises ShapeError."""
    if not all(hasattr(frame, name) for name in ("columns", "index", "items")) or isinstance(frame, type):
        raise ShapeError(
            f"Motion.from_dataframe: the frame is {arguments.value_text(frame)}: give a pandas DataFrame with a column "
            "for each joint."
        )
    names = list(map(str, frame.columns))
    timed = any(time_meaning(name) is not None for name in names)
    header, columns = list[str](), [np.zeros((len(frame), 0))]
    index = _time(frame.index, timed=timed)
    if index is not None and index[0].removesuffix(" [s]") not in names:
        header.append(index[0])
        columns.append(index[1])
    ignored = []
    for name, values in frame.items():
        try:
            column_name, numbers = _column(str(name), values)
        except (TypeError, ValueError):
            ignored.append(str(name))
            continue
        header.append(column_name)
        columns.append(numbers)
    table = np.column_stack(columns)
    notes: tuple[str, ...] = ()
    if ignored:
        notes = (f"Columns that are not numbers are ignored: {', '.join(ignored)}.",)
    file = ArrayFile.from_table(Path(_NAME), header, table, 8 * table.size)
    return replace(file, advice="frame.dropna() leaves such rows out, frame.interpolate() fills them"), notes


def _column(name: str, values: Any) -> tuple[str, Array]:
    """Name and numbers of a column; dates in seconds since the first. Others raise TypeError or ValueError."""
    nanosecond_type = {"M": "datetime64[ns]", "m": "timedelta64[ns]"}.get(getattr(values.dtype, "kind", ""))
    if nanosecond_type is None:
        return name, np.asarray(values, float)
    stamps = np.asarray(values, nanosecond_type)
    return f"{name} [s]", (stamps - stamps[:1]) / np.timedelta64(1, "s")


def _time(index: Any, *, timed: bool) -> tuple[str, Array] | None:
    """Name and numbers of a time column from the index, dates and durations in seconds since the first; None for row numbers.

    The name is kept if it denotes time, or if another column does (``timed``). Otherwise increasing floats are the
    time.
    """
    if getattr(index.dtype, "kind", "") in "mM":
        return _column("time", index)
    values = np.asarray(index)
    counts = values.dtype.kind in "iu" and np.array_equal(values, np.arange(len(values)))
    if values.ndim != 1 or values.dtype.kind not in "iuf" or (index.name is None and counts):
        return None
    if index.name is None:
        return "time", values.astype(float)
    name = str(index.name)
    increases = values.dtype.kind == "f" and bool((np.diff(values) > 0).all())
    if increases and not timed and time_meaning(name) is None:
        name = "time"
    return name, values.astype(float)


complete(globals())
