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
    """Columns of a parquet or feather file; a column of lists of numbers is an array (n, k)."""
    path = file.path
    try:
        import pyarrow.types as kinds
    except ImportError:
        raise MissingExtraError.from_extra("pyarrow", "logs", f"Reading {path.suffix[1:]}") from None
    if path.suffix.lower() == ".parquet":
        schema, rows, read, counts = _parquet(path)
    else:
        schema, rows, read = _feather(path)
        counts = Counter()

    def portions(name: str, row_limit: int) -> Iterator[Array]:
        for column in read(name, row_limit):
            column.validate(full=True)
            yield column.to_numpy(zero_copy_only=False)

    names: Mapping[str, list[str]] = {}
    if {STATE, EPISODES} & {*schema.names}:
        names, _ = read_metadata(path)
    arrays, number = {}, np.dtype(float)
    without_numbers, size_limit = np.dtype(object), most_unpacked(path.stat().st_size)
    for field in schema:
        kind, rows_of = field.type, partial(portions, field.name)
        array = StoredArray((), without_numbers, rows_of)
        name = field.name
        if kinds.is_floating(kind) or kinds.is_integer(kind) or kinds.is_boolean(kind):
            array = StoredArray((rows,), number, rows_of)
        elif kinds.is_timestamp(kind) or kinds.is_date(kind) or kinds.is_duration(kind):
            name = f"{field.name} [s]"
            array = StoredArray((rows,), number, rows_of)
        elif (kinds.is_list(kind) or kinds.is_fixed_size_list(kind)) and 8 * counts[field.name] <= size_limit:
            array = _list_array(path, field.name, rows, rows_of, names.get(field.name, ()))
        arrays[name] = array
    nested = [field for field in schema if kinds.is_nested(field.type) and not arrays[field.name].shape]
    if not nested:
        return arrays, ()
    columns = ", ".join(f"{field.name!r} ({field.type})" for field in nested)
    note = f"Not read, as each cell holds several values: {columns}. Write one column for each of them."
    return arrays, (note,)


def _parquet(path: Path) -> tuple[Any, int, Callable[[str, int], Iterator[Any]], Counter[str]]:
    """Schema and rows of a parquet file, a function that yields a column in portions, and the number of values by column."""
    import pyarrow.parquet

    def read(name: str, row_limit: int) -> Iterator[Any]:
        with pyarrow.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(row_limit, columns=[name], use_threads=False):
                yield batch.column(0)

    counts = Counter[str]()
    with pyarrow.parquet.ParquetFile(path) as file:
        metadata = file.metadata
        for group in map(metadata.row_group, range(metadata.num_row_groups)):
            for chunk in map(group.column, range(group.num_columns)):
                counts[chunk.path_in_schema.partition(".")[0]] += chunk.num_values
        return file.schema_arrow, int(metadata.num_rows), read, counts


def _feather(path: Path) -> tuple[Any, int, Callable[[str, int], Iterator[Any]]]:
    """Schema and number of rows of a feather file, and a function that yields a column in portions; only it is unpacked."""
    import pyarrow.dataset
    import pyarrow.ipc

    with path.open("rb") as source:
        if source.read(len(_ARROW)) != _ARROW:
            raise TrajectoryError(
                f"{path}: is not an Arrow file, which begins with {_ARROW.decode()}. Feather version 1 is not read: write the "
                "table again with pyarrow.feather.write_feather, which writes version 2, or as parquet or CSV."
            )

    def open_columns(*fields: int) -> Any:
        options = pyarrow.ipc.IpcReadOptions(included_fields=list(fields), use_threads=False)
        return pyarrow.ipc.open_file(path, options=options)

    def read(name: str, row_limit: int) -> Iterator[Any]:
        pending: list[Any] = []
        with open_columns(schema.get_field_index(name)) as file:
            for k in range(file.num_record_batches):
                pending.append(file.get_batch(k).column(0))
                while sum(map(len, pending)) >= row_limit:
                    rows = pyarrow.concat_arrays(pending)
                    yield rows[:row_limit]
                    pending = [rows[row_limit:]]
        if sum(map(len, pending)):
            yield pyarrow.concat_arrays(pending)

    with open_columns() as file:
        schema = file.schema
    return schema, int(pyarrow.dataset.dataset(path, format="feather").count_rows()), read


_ARROW = b"ARROW1"


def _list_array(
    path: Path, name: str, rows: int, portions: Callable[[int], Iterator[Array]], names: Sequence[str]
) -> StoredArray:
    """Array (n, k) of a column of lists; without a shape unless they are numeric and the first ones equally long."""
    first = next(portions(log_table.ROWS), np.zeros(0))
    if not len(first):
        return StoredArray((), np.dtype(object), portions)
    width, kind = np.asarray(first[0]).size, np.asarray(first[0]).dtype.kind
    if not width or kind not in "iufb" or not all(cell is not None and np.size(cell) == width for cell in first):
        return StoredArray((), np.dtype(object), portions)

    def stacked_portions(row_limit: int) -> Iterator[Array]:
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
    return StoredArray((rows, width), np.dtype(float), stacked_portions, tuple(names))


def _position_names(names: Sequence[str], width: int) -> list[str]:
    """Names of the columns of a LeRobot dataset's positions; those without a quantity get that of a position."""
    if len(names) != width:
        names = [str(k + 1) for k in range(width)]
    return [name if name.rpartition(".")[2] in PART_OF else f"{name}.pos" for name in names]
