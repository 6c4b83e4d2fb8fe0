"""Bounds on recordings of ROS, checked before they are decoded: tables of a database, and sizes of packed messages.

A database is read as SQLite advises for files from strangers:
plain tables only, no functions of its schema, and bounds on values and on steps. Ctrl-C ends a query.
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
_LENGTH = 1 << 20
"""Length of a value [bytes] that a database of any size may have; a longer value is no longer than its file."""
_STEPS, _STEPS_A_BYTE = 10_000_000, 50
"""Steps of SQLite's machine: constant, and per byte of the file. A message of 100 bytes takes about 30 steps."""
_STEPS_BETWEEN_LOOKS = 100_000
"""Steps of the machine between looks at the clock and at Ctrl-C: a few milliseconds."""


@contextmanager
def recording_database(path: Path) -> Iterator[sqlite3.Connection]:
    """Database of a recording, for reading. Raises TrajectoryError unless its tables are plain, and for too many steps."""
    size = path.stat().st_size
    steps = _Steps((_STEPS + _STEPS_A_BYTE * size) // _STEPS_BETWEEN_LOOKS)
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(_LENGTH, size))
        database.execute("pragma trusted_schema=off")
        database.execute("pragma cell_size_check=on")
        database.set_progress_handler(steps.stops().__next__, _STEPS_BETWEEN_LOOKS)
        try:
            _check_tables(database, path)
            yield database
        except sqlite3.OperationalError as problem:
            if steps.interrupt is not None:
                raise steps.interrupt from None
            if steps.left < 0:
                raise TrajectoryError(
                    f"{path}: its tables take more steps to read than a recording of its size has. The file is damaged, or not "
                    "a recording."
                ) from problem
            raise


class _Steps:
    """Progress handler of SQLite, which stops a query: after too many steps, or at Ctrl-C, which Python raises in it."""

    def __init__(self, most: int) -> None:
        self.left = most
        self.interrupt: BaseException | None = None

    def stops(self) -> Iterator[bool]:
        """Values of the handler. An interrupt reaches a generator where it goes on, within its try; SQLite would drop it."""
        while True:
            try:
                self.left -= 1
                yield self.left < 0
            except GeneratorExit:
                raise
            except BaseException as problem:
                self.interrupt = problem
                yield True


def _check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Raise TrajectoryError unless the tables of a recording are plain tables: no views, virtual tables or computed columns."""
    wanted = ", ".join("?" for _ in TABLES)
    about = database.execute(f"select name, type, rootpage from sqlite_master where name in ({wanted})", TABLES)
    names, others = list[str](), list[str]()
    for name, kind, rootpage in about:
        names.append(name)
        if kind != "table":
            others.append(f"{name!r} is a {kind}")
        elif not rootpage:
            others.append(f"{name!r} is a virtual table")
    if others:
        raise TrajectoryError(f"{path}: cannot be read as a recording of ROS: {listed(others)}, and a table is needed.")
    for name in names:
        hidden = [str(column[1]) for column in database.execute(f"pragma table_xinfo({name})") if column[6]]
        if hidden:
            raise TrajectoryError(
                f"{path}: cannot be read as a recording of ROS: columns of {name!r} are computed: {listed(hidden)}."
            )


def values_within(values: Iterable[Any], path: Path) -> list[bytes]:
    """Values of a column of bytes. Raises TrajectoryError if they take more than their file, as copies of one value do."""
    found, size, most = list[bytes](), 0, _LENGTH + path.stat().st_size
    for value in values:
        found.append(bytes(value))
        size += len(found[-1])
        if size > most:
            raise TrajectoryError(
                f"{path}: its messages take more than the file's {most - _LENGTH} bytes. It is damaged."
            )
    return found


def check_folder(path: Path) -> None:
    """Check the files of a rosbag2 folder. Raises TrajectoryError, and errors of SQLite and of the MCAP reader."""
    for file in sorted(path.iterdir()):
        if file.suffix == ".db3" and file.is_file():
            with recording_database(file):
                continue
        if file.suffix == ".mcap" and file.is_file():
            check_chunks(file)
        if file.suffix == ".zstd" and file.is_file():
            _check_packed(file)


def _check_packed(path: Path) -> None:
    """Raise TrajectoryError if a packed file is out of proportion to its size."""
    import zstandard

    unpacked, size = 0, path.stat().st_size
    with path.open("rb") as file:
        for portion in zstandard.ZstdDecompressor().read_to_iter(file):
            unpacked += len(portion)
            check_ratio(path, unpacked, size)


class BoundedFile(io.BufferedReader):
    """File of bytes that reserves no more memory for a read than is left of it, whatever lengths it names."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """At most ``size`` bytes."""
        remaining = max(0, self.size - self.tell())
        if size is None or size < 0:
            size = remaining
        return super().read(min(size, remaining))


def check_chunks(path: Path) -> None:
    """Raise TrajectoryError if the chunks of an MCAP file unpack out of proportion to the file."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    size, unpacked = path.stat().st_size, 0
    with BoundedFile(path) as file:
        for record in StreamReader(file, emit_chunks=True, record_size_limit=max(1, size)).records:
            if isinstance(record, Chunk):
                unpacked += max(record.uncompressed_size, _packed_size(record))
                check_ratio(path, unpacked, size)


def _packed_size(chunk: Any) -> int:
    """Size [bytes] that the packed data of a chunk name; 0 if they name none, so that the size in the chunk's head holds."""
    if chunk.compression != "zstd":
        return 0  # LZ4 unpacks to at most 255 times its size
    import zstandard

    return max(0, zstandard.frame_content_size(chunk.data))
