"""Columns of Arrow tables: parquet and feather."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import MissingExtraError, TrajectoryError
from ...core.typing import Array
from .. import log_table
from ..column_names import PART_OF
from ..log_table import most_unpacked
from .file_ends import FileEnds
from .lerobot import EPISODES, STATE, read_metadata
from .stored_array import StoredArray


def read_arrow(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Columns of a parquet or feather file by name, and notes on ignored ones; lists of numbers become an array (n, k)."""
    path = file.path
    try:
        import pyarrow.types as arrow_types
    except ImportError:
        raise MissingExtraError.from_extra("pyarrow", "logs", f"Reading {path.suffix[1:]}") from None
    if path.suffix.lower() == ".parquet":
        schema, row_count, read_column, value_counts = _parquet(path)
    else:
        schema, row_count, read_column = _feather(path)
        value_counts = Counter()

    def read_portions(name: str, row_limit: int) -> Iterator[Array]:
        """Portions of up to ``row_limit`` rows of a column."""
        for column in read_column(name, row_limit):
            column.validate(full=True)
            yield column.to_numpy(zero_copy_only=False)

    names_of_entries: Mapping[str, list[str]] = {}  # by column of lists
    if {STATE, EPISODES} & {*schema.names}:  # a LeRobot dataset
        names_of_entries, _ = read_metadata(path)
    arrays = {}
    size_limit = most_unpacked(path.stat().st_size)
    number_tests = (arrow_types.is_floating, arrow_types.is_integer, arrow_types.is_boolean)
    time_tests = (arrow_types.is_timestamp, arrow_types.is_date, arrow_types.is_duration)
    list_tests = (arrow_types.is_list, arrow_types.is_fixed_size_list)
    for field in schema:
        name = field.name
        portions = partial(read_portions, name)
        is_number = any(has_type(field.type) for has_type in number_tests)
        is_time = any(has_type(field.type) for has_type in time_tests)
        is_list = any(has_type(field.type) for has_type in list_tests)
        if is_number:
            arrays[name] = StoredArray((row_count,), np.dtype(float), portions)
        elif is_time:
            arrays[f"{name} [s]"] = StoredArray((row_count,), np.dtype(float), portions)
        elif is_list and _BYTES_PER_NUMBER * value_counts[name] <= size_limit:
            arrays[name] = _list_array(path, name, row_count, portions, names_of_entries.get(name, ()))
        else:
            arrays[name] = StoredArray((), np.dtype(object), portions)  # not numbers
    unread_nested = [field for field in schema if arrow_types.is_nested(field.type) and not arrays[field.name].shape]
    if not unread_nested:
        return arrays, ()
    columns = ", ".join(f"{field.name!r} ({field.type})" for field in unread_nested)
    note = f"Not read, as each cell holds several values: {columns}. Write one column for each of them."
    return arrays, (note,)


def _parquet(path: Path) -> tuple[Any, int, Callable[[str, int], Iterator[Any]], Counter[str]]:
    """Schema, number of rows, function that yields a column in portions, and numbers of values by column of a parquet file."""
    import pyarrow.parquet

    def read_column(name: str, row_limit: int) -> Iterator[Any]:
        with pyarrow.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(row_limit, columns=[name], use_threads=False):
                yield batch.column(0)

    value_counts: Counter[str] = Counter()
    with pyarrow.parquet.ParquetFile(path) as file:
        metadata = file.metadata
        for group_index in range(metadata.num_row_groups):
            group = metadata.row_group(group_index)
            for chunk_index in range(group.num_columns):
                chunk = group.column(chunk_index)
                column, _, _ = chunk.path_in_schema.partition(".")  # without the path of a nested value
                value_counts[column] += chunk.num_values
        return file.schema_arrow, int(metadata.num_rows), read_column, value_counts


def _feather(path: Path) -> tuple[Any, int, Callable[[str, int], Iterator[Any]]]:
    """Schema, number of rows, and function that yields a column in portions, of a feather file.

    The function unpacks only the column that it yields.
    """
    import pyarrow.dataset
    import pyarrow.ipc

    with path.open("rb") as source:
        if source.read(len(_ARROW_MARK)) != _ARROW_MARK:
            raise TrajectoryError(
                f"{path}: is not an Arrow file, which begins with {_ARROW_MARK.decode()}. Feather version 1 is not read: write "
                "the table again with pyarrow.feather.write_feather, which writes version 2, or as parquet or CSV."
            )

    def open_columns(*fields: int) -> Any:
        """File with some of its columns."""
        options = pyarrow.ipc.IpcReadOptions(included_fields=list(fields), use_threads=False)
        return pyarrow.ipc.open_file(path, options=options)

    def read_column(name: str, row_limit: int) -> Iterator[Any]:
        waiting_batches: list[Any] = []  # not yet yielded
        with open_columns(schema.get_field_index(name)) as file:
            for k in range(file.num_record_batches):
                waiting_batches.append(file.get_batch(k).column(0))
                while sum(map(len, waiting_batches)) >= row_limit:
                    rows = pyarrow.concat_arrays(waiting_batches)
                    yield rows[:row_limit]
                    waiting_batches = [rows[row_limit:]]
        if sum(map(len, waiting_batches)):
            yield pyarrow.concat_arrays(waiting_batches)

    with open_columns() as file:
        schema = file.schema
    row_count = int(pyarrow.dataset.dataset(path, format="feather").count_rows())
    return schema, row_count, read_column


_ARROW_MARK = b"ARROW1"
"""First bytes of a file of Arrow."""
_BYTES_PER_NUMBER = 8


def _list_array(
    path: Path, name: str, row_count: int, portions: Callable[[int], Iterator[Array]], names: Sequence[str]
) -> StoredArray:
    """Array (n, k) of a column of lists, with the ``names`` of their entries.

    Unless the lists of the first portion have equally many numbers, the array has no shape: it is ignored.
    """
    not_numbers = StoredArray((), np.dtype(object), portions)
    first_lists = next(portions(log_table.ROWS), np.zeros(0))
    if not len(first_lists):
        return not_numbers
    first_list = np.asarray(first_lists[0])
    width = first_list.size
    if not width or first_list.dtype.kind not in "iufb":
        return not_numbers
    have_equal_width = all(cell is not None and np.size(cell) == width for cell in first_lists)
    if not have_equal_width:
        return not_numbers

    def stacked_portions(row_limit: int) -> Iterator[Array]:
        """Portions (rows, k) of the array; raises TrajectoryError for a list of another length."""
        row = 0
        for portion in portions(row_limit):
            cells = []
            for cell in portion:
                row += 1
                if cell is None or len(cell) != width:
                    raise TrajectoryError(
                        f"{path}: row {row} of {name!r} is not a list of {width} numbers, as the first row is."
                    )
                cells.append(np.asarray(cell, float))
            yield np.array(cells).reshape(-1, width)

    if name == STATE:
        names = _position_names(names, width)
    if len(names) != width:
        names = ()
    return StoredArray((row_count, width), np.dtype(float), stacked_portions, tuple(names))


def _position_names(names: Sequence[str], width: int) -> list[str]:
    """Names of the columns of a LeRobot dataset's positions; names without a quantity get the ending ``.pos``."""
    if len(names) != width:
        names = [str(k + 1) for k in range(width)]
    position_names = []
    for name in names:
        _, _, last_word = name.rpartition(".")
        position_names.append(name if last_word in PART_OF else f"{name}.pos")
    return position_names
