"""Standard output and error that take every sign, whatever the system's code page."""

from __future__ import annotations

import os
import sys
from typing import Any


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
