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
    batch = next(iter(arrays.values())).ndim - 2
    samples = ("sample",) if batch == 1 else tuple(f"sample_{k}" for k in range(batch))
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
    return units[0] if len(set(units)) == 1 else ", ".join(units)


_NAME = "the DataFrame"


def data_frame_file(frame: Any) -> tuple[ArrayFile, tuple[str, ...]]:
    """File of a DataFrame: index if it is a time, numeric columns, and a note on others; raises ShapeError."""
    if not all(hasattr(frame, name) for name in ("columns", "index", "items")) or isinstance(frame, type):
        raise ShapeError(
            f"Motion.from_dataframe: the frame is {arguments.value_text(frame)}: give a pandas DataFrame with a column "
            "for each joint."
        )
    timed = any(time_meaning(str(name)) is not None for name in frame.columns)
    names = {str(name) for name in frame.columns}
    columns = [index for index in _time(frame.index, timed=timed) if index[0].removesuffix(" [s]") not in names]
    ignored = []
    for name, column in frame.items():
        try:
            columns.append(_column(str(name), column))
        except (TypeError, ValueError):
            ignored.append(str(name))
    table = np.column_stack([x for _, x in columns]) if columns else np.zeros((len(frame), 0))
    notes = (f"Columns that are not numbers are ignored: {', '.join(ignored)}.",) if ignored else ()
    file = ArrayFile.from_table(Path(_NAME), [name for name, _ in columns], table, 8 * table.size)
    return replace(file, advice="frame.dropna() leaves such rows out, frame.interpolate() fills them"), notes


def _column(name: str, values: Any) -> tuple[str, Array]:
    """Name and numbers of a column; dates in seconds since the first. Others raise TypeError or ValueError."""
    kind = getattr(values.dtype, "kind", "")
    if kind not in "mM":
        return name, np.asarray(values, float)
    spans = np.asarray(values, "datetime64[ns]" if kind == "M" else "timedelta64[ns]")
    return f"{name} [s]", (spans - spans[:1]) / np.timedelta64(1, "s")


def _time(index: Any, *, timed: bool) -> list[tuple[str, Array]]:
    """Time column from the index, dates and durations in seconds since the first; empty if it is a row number.

    The name is kept if it denotes time, or if another column does (``timed``). Otherwise increasing floats are the
    time.
    """
    if getattr(index.dtype, "kind", "") in "mM":
        return [_column("time", index)]
    values = np.asarray(index)
    counts = values.dtype.kind in "iu" and np.array_equal(values, np.arange(len(values)))
    if values.ndim != 1 or values.dtype.kind not in "iuf" or (index.name is None and counts):
        return []
    means_time = timed or (index.name is not None and time_meaning(str(index.name)) is not None)
    increases = values.dtype.kind == "f" and bool((np.diff(values) > 0).all())
    name = "time" if index.name is None or (increases and not means_time) else str(index.name)
    return [(name, values.astype(float))]


complete(globals())
