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
    coordinates = Coordinates.from_model(model)
    first_array = next(iter(arrays.values()))  # all arrays have the same axes of samples
    sample_axis_count = first_array.ndim - 2
    if sample_axis_count == 1:
        sample_axes = ["sample"]
    else:
        sample_axes = [f"sample_{k}" for k in range(sample_axis_count)]
    axis_labels = {
        "time": ("time", times, {"units": "s"}),  # axis, values, attributes
        "coordinate": list(coordinates.names),
        "joint": list(coordinates.velocity_names),
    }
    variables = {}
    for name, array in arrays.items():
        axis = "coordinate" if name == "q" else "joint"
        missing_rows = len(times) - array.shape[-2]
        if missing_rows:
            padding = np.full((*array.shape[:-2], missing_rows, array.shape[-1]), np.nan)
            array = np.concatenate([array, padding], axis=-2)
        variables[name] = ((*sample_axes, "time", axis), array, {"units": _units(name, coordinates)})
    return xarray.Dataset(variables, axis_labels, {"robot": model.name})


def _units(name: str, coordinates: Coordinates) -> str:
    """Common unit of all entries of a quantity; if they differ, the units of the entries in order, with commas."""
    if name == "q":
        units = [unit_of("q", bool(is_angle)) for is_angle in coordinates.angular]
        for entries in coordinates.quaternions:  # slices
            units[entries] = ["1"] * len(units[entries])  # UDUNITS for a number without unit
    else:
        units = [unit.replace("²", "^2") for unit in units_of(name, coordinates.angular_velocity)]
    if len(set(units)) == 1:
        return units[0]
    return ", ".join(units)


_FILE_NAME = "the DataFrame"
"""Name of the file in messages."""


def data_frame_file(frame: Any) -> tuple[ArrayFile, tuple[str, ...]]:
    """File with the numeric columns of a DataFrame and its index if it is a time; and a note on ignored columns, if any.

    Raises ShapeError for another object.
    """
    has_columns = all(hasattr(frame, name) for name in ("columns", "index", "items"))
    is_class = isinstance(frame, type)  # such as pandas.DataFrame itself
    if not has_columns or is_class:
        raise ShapeError(
            f"Motion.from_dataframe: the frame is {arguments.value_text(frame)}: give a pandas DataFrame with a column "
            "for each joint."
        )
    names = list(map(str, frame.columns))
    has_time_column = any(time_meaning(name) is not None for name in names)
    header: list[str] = []
    columns = [np.zeros((len(frame), 0))]  # no columns, but the number of rows if the frame has no numeric ones
    time_of_index = _time_of_index(frame.index, has_time_column=has_time_column)
    if time_of_index is not None:
        time_name, times = time_of_index
        if time_name.removesuffix(" [s]") not in names:  # a column of this name has precedence
            header.append(time_name)
            columns.append(times)
    ignored_names = []
    for name, values in frame.items():
        try:
            column_name, numbers = _column(str(name), values)
        except (TypeError, ValueError):
            ignored_names.append(str(name))
            continue
        header.append(column_name)
        columns.append(numbers)
    table = np.column_stack(columns)
    notes: tuple[str, ...] = ()
    if ignored_names:
        notes = (f"Columns that are not numbers are ignored: {', '.join(ignored_names)}.",)
    byte_count = 8 * table.size  # 8 bytes a number
    file = ArrayFile.from_table(Path(_FILE_NAME), header, table, byte_count)
    file = replace(file, advice="frame.dropna() leaves such rows out, frame.interpolate() fills them")
    return file, notes


def _column(name: str, values: Any) -> tuple[str, Array]:
    """Name and numbers of a column; dates and durations in seconds since the column's first row.

    Raises TypeError or ValueError if the values are not numbers.
    """
    kind = getattr(values.dtype, "kind", "")  # M: dates, m: durations
    nanosecond_type = {"M": "datetime64[ns]", "m": "timedelta64[ns]"}.get(kind)
    if nanosecond_type is None:
        return name, np.asarray(values, float)
    stamps = np.asarray(values, nanosecond_type)
    since_first = stamps - stamps[:1]  # a slice, since a column may be empty
    return f"{name} [s]", since_first / np.timedelta64(1, "s")


def _time_of_index(index: Any, *, has_time_column: bool) -> tuple[str, Array] | None:
    """Name and numbers of a time column from the index; None if it holds row numbers or no numbers.

    Dates and durations are in seconds since the first. An index without a name is the time. An index with a name keeps
    it. If neither the name nor a column denotes a time, increasing floats are called ``time``.
    """
    if getattr(index.dtype, "kind", "") in "mM":  # durations or dates
        return _column("time", index)
    values = np.asarray(index)
    if values.ndim != 1 or values.dtype.kind not in "iuf":  # integers and floats
        return None
    is_row_number = values.dtype.kind in "iu" and np.array_equal(values, np.arange(len(values)))
    if index.name is None and is_row_number:
        return None
    numbers = values.astype(float)
    if index.name is None:
        return "time", numbers
    name = str(index.name)
    is_increasing_float = values.dtype.kind == "f" and bool((np.diff(values) > 0).all())
    if is_increasing_float and not has_time_column and time_meaning(name) is None:
        name = "time"
    return name, numbers


complete(globals())
