"""Bounds on recordings of ROS, checked before they are decoded: tables of a database, and sizes of packed messages.

A database is read as SQLite advises for files from strangers: plain tables only, no functions of its schema, and bounds
on values and on steps. Ctrl-C ends a query.
"""

from __future__ import annotations

import io
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from ...core.errors import TrajectoryError
from ...core.text import listed
from ..log_table import check_ratio

TABLES = ("topics", "messages", "message_definitions")
"""Tables of a rosbag2 database."""
_ALLOWED_LENGTH = 1 << 20
"""Length of a value [bytes] that a database of any size may have; longer values may be as long as the file."""
_BASE_STEPS = 10_000_000
"""Number of steps of SQLite's machine that reading any database may take."""
_STEPS_PER_BYTE = 50
"""Further steps for each byte of the file. A message of 100 bytes takes about 30."""
_STEPS_BETWEEN_CALLS = 100_000
"""Steps of SQLite's machine between calls of the progress handler: a few milliseconds."""


@contextmanager
def recording_database(path: Path) -> Iterator[sqlite3.Connection]:
    """Database of a recording, for reading. Raises TrajectoryError unless its tables are plain, and for too many steps."""
    size = path.stat().st_size
    max_steps = _BASE_STEPS + _STEPS_PER_BYTE * size
    handler = _ProgressHandler(max_steps // _STEPS_BETWEEN_CALLS)
    address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(_ALLOWED_LENGTH, size))
        database.execute("pragma trusted_schema=off")
        database.execute("pragma cell_size_check=on")
        stop_requests = handler.stop_requests()
        database.set_progress_handler(stop_requests.__next__, _STEPS_BETWEEN_CALLS)
        try:
            _check_tables(database, path)
            yield database
        except sqlite3.OperationalError as error:
            if handler.interrupt is not None:
                raise handler.interrupt from None
            if handler.remaining_calls < 0:
                raise TrajectoryError(
                    f"{path}: its tables take more steps to read than a recording of its size has. The file is damaged, or not "
                    "a recording."
                ) from error
            raise


class _ProgressHandler:
    """Progress handler of SQLite, which stops a query after too many calls, or at Ctrl-C."""

    def __init__(self, max_calls: int) -> None:
        self.remaining_calls = max_calls
        self.interrupt: BaseException | None = None
        """KeyboardInterrupt that Python raised in the handler."""

    def stop_requests(self) -> Iterator[bool]:
        """Results of the handler's calls: True to stop the query.

        SQLite would drop an interrupt in the handler. Python raises it where a generator resumes, which is within the
        ``try`` here, so that it can be stored.
        """
        while True:
            try:
                self.remaining_calls -= 1
                yield self.remaining_calls < 0
            except GeneratorExit:
                raise
            except BaseException as error:
                self.interrupt = error
                yield True


def _check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Raise TrajectoryError unless the tables of a recording are plain tables: no views, virtual tables or computed columns."""
    placeholders = ", ".join("?" for _ in TABLES)
    query = f"select name, type, rootpage from sqlite_master where name in ({placeholders})"
    names: list[str] = []
    problems: list[str] = []
    for name, kind, rootpage in database.execute(query, TABLES):
        names.append(name)
        if kind != "table":
            problems.append(f"{name!r} is a {kind}")
        elif not rootpage:
            problems.append(f"{name!r} is a virtual table")
    if problems:
        raise TrajectoryError(
            f"{path}: cannot be read as a recording of ROS: {listed(problems)}, and a table is needed."
        )
    for name in names:
        computed_columns = []
        for row in database.execute(f"pragma table_xinfo({name})"):
            _, column, *_, hidden = row  # number, name, type, not null, default, primary key, hidden
            if hidden != 0:  # a computed column
                computed_columns.append(str(column))
        if computed_columns:
            raise TrajectoryError(
                f"{path}: cannot be read as a recording of ROS: columns of {name!r} are computed: {listed(computed_columns)}."
            )


def values_within(values: Iterable[Any], path: Path) -> list[bytes]:
    """Values of a column of bytes. Raises TrajectoryError if they take more than their file, as copies of one value do."""
    file_size = path.stat().st_size
    copies: list[bytes] = []
    size_of_copies = 0
    for value in values:
        copy = bytes(value)
        copies.append(copy)
        size_of_copies += len(copy)
        if size_of_copies > _ALLOWED_LENGTH + file_size:
            raise TrajectoryError(f"{path}: its messages take more than the file's {file_size} bytes. It is damaged.")
    return copies


def check_folder(path: Path) -> None:
    """Check the files of a rosbag2 folder. Raises TrajectoryError, and errors of SQLite and of the MCAP reader."""
    for file in sorted(path.iterdir()):
        if file.suffix == ".db3" and file.is_file():
            with recording_database(file):  # checks on opening
                continue
        if file.suffix == ".mcap" and file.is_file():
            check_chunks(file)
        if file.suffix == ".zstd" and file.is_file():
            _check_packed(file)


def _check_packed(path: Path) -> None:
    """Raise TrajectoryError if a packed file unpacks out of proportion to its size."""
    import zstandard

    size = path.stat().st_size
    unpacked_size = 0
    with path.open("rb") as file:
        for portion in zstandard.ZstdDecompressor().read_to_iter(file):
            unpacked_size += len(portion)
            check_ratio(path, unpacked_size, size)


class BoundedFile(io.BufferedReader):
    """File that reserves memory only for the bytes that it still has, even if its content claims greater lengths."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most ``size`` bytes; all remaining bytes if ``size`` is negative or None."""
        remaining = max(0, self.size - self.tell())
        if size is None or size < 0:
            size = remaining
        return super().read(min(size, remaining))


def check_chunks(path: Path) -> None:
    """Raise TrajectoryError if the chunks of an MCAP file unpack out of proportion to the file."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    size = path.stat().st_size
    unpacked_size = 0
    with BoundedFile(path) as file:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=max(1, size))
        for record in reader.records:
            if isinstance(record, Chunk):
                unpacked_size += max(record.uncompressed_size, _unpacked_size_in_data(record))
                check_ratio(path, unpacked_size, size)


def _unpacked_size_in_data(chunk: Any) -> int:
    """Unpacked size [bytes] that the packed data of a chunk state; 0 if they do not state it."""
    if chunk.compression != "zstd":
        return 0  # LZ4 unpacks to at most 255 times its size
    import zstandard

    return max(0, zstandard.frame_content_size(chunk.data))
