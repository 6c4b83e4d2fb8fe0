"""Standard output and error that take every sign, whatever the system's code page."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..core.arguments import visible


class VisibleStream:
    """Standard output or error on which others' text cannot steer the terminal: control characters come as escapes."""

    def __init__(self, stream: Any) -> None:
        self.rich_proxied_file = (
            stream  # Rich writes past this one: its colours are ours, and its text is escaped before
        )

    def write(self, text: str) -> int:
        """Write with escapes."""
        self.rich_proxied_file.write(visible(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


@contextmanager
def visible_streams() -> Iterator[None]:
    """Standard output and error as :class:`VisibleStream` meanwhile."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (VisibleStream(stream) if stream is not None else None for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def take_every_sign() -> None:
    """Let what goes to a file or a pipe be UTF-8, as Python itself does from 3.15 on; a terminal keeps its encoding.

    A sign that a terminal, or the encoding named by ``PYTHONIOENCODING``, does not have becomes a question mark.
    """
    streams: tuple[Any, ...] = (sys.stdout, sys.stderr)
    for stream in streams:
        if stream not in (sys.__stdout__, sys.__stderr__):  # a caller's own
            continue
        change = getattr(stream, "reconfigure", None)
        if change is None or str(stream.encoding).lower() in ("utf-8", "utf8"):
            continue
        if os.environ.get("PYTHONIOENCODING") or stream.isatty():
            change(errors="replace")
        else:
            change(encoding="utf-8")
