"""What other libraries write to the standard error of the process, past Python: kept, and shown only where it helps."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator

_LONGEST = 300
"""Characters of it that are worth showing."""


class ForeignOutput:
    """What was written, once the block is over."""

    text = ""

    def __str__(self) -> str:
        words = " ".join(self.text.split())
        return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}…"


@contextlib.contextmanager
def captured_stderr() -> Iterator[ForeignOutput]:
    r"""Keep what the block, C and C++ included, writes to the process's standard error (file descriptor 2).

    Other threads that write there meanwhile are kept too. Nothing is kept where the process has no standard error.

    >>> with captured_stderr() as said:
    ...     _ = os.write(2, b"Error: no such mesh\n")
    >>> str(said)
    'Error: no such mesh'
    """
    found = ForeignOutput()
    with contextlib.suppress(Exception):
        sys.stderr.flush()
    try:
        before = os.dup(2)
    except OSError:
        yield found
        return
    try:
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), 2)
            try:
                yield found
            finally:
                with contextlib.suppress(Exception):
                    sys.stderr.flush()
                os.dup2(before, 2)
                file.seek(0)
                found.text = file.read(1 << 16).decode("utf-8", "replace")
    finally:
        os.close(before)
