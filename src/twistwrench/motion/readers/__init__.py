"""Readers of foreign log files, each bounded, the ones with foreign C code in a child process.

A format is a row of :data:`FORMATS`; its module is imported when the first file of the format is opened.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple


class LogFormat(NamedTuple):
    """Distinction of the files of a format, and their reader."""

    suffixes: tuple[str, ...]
    opener: str
    """``module:function`` of this folder; the function takes the ends of a file, and the option if one is given."""
    start: bytes | None = None
    """First bytes of its files, whatever their names are."""
    member: str | None = None
    """File in each folder that is one recording."""
    options: tuple[str, ...] = ()
    """Options that only this format has: ``topic`` and ``command_topic``, or ``episode``."""


FORMATS = (
    LogFormat(
        (".mcap", ".bag", ".db3"),
        "child_readers:recording_file",
        start=b"SQLite format 3\0",
        member="metadata.yaml",
        options=("topic", "command_topic"),
    ),
    LogFormat(
        (".npy", ".npz", ".mat", ".h5", ".hdf5", ".parquet", ".feather", ".arrow"),
        "child_readers:arrays_file",
        start=b"PK",
        options=("episode",),
    ),
)
"""Formats of logs other than text with a column for each quantity, in the order in which a file is compared with them."""


def format_of(path: Path, start: bytes = b"") -> LogFormat | None:
    """Format of a file by its suffix or its first bytes, or of a folder by its content; None for text."""
    suffix = path.suffix.lower()
    for row in FORMATS:
        if suffix in row.suffixes or (row.start and start.startswith(row.start)):
            return row
        if row.member and os.path.isfile(path / row.member):  # noqa: PTH113  False if the text cannot be a path
            return row
    return None
