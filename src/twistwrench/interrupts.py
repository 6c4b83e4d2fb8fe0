"""Ctrl-C during the import of the package: the command ends as it does later, without a traceback."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from pathlib import Path
from typing import Any

from .core.verdict import ExitCode


def end_at_once(*_: Any) -> None:
    """End the process; no work is lost."""
    os.write(2, b"interrupted\n")
    os._exit(ExitCode.INTERRUPTED)


def _is_command() -> bool:
    """True if the process is the command ``twistwrench``, not a program that imports the library."""
    name = sys.argv[0] if getattr(sys, "argv", None) else ""
    by_module = name == "-m" and " -m twistwrench " in f" {' '.join(sys.orig_argv)} "
    return by_module or Path(name).name in ("twistwrench", "twistwrench.exe")


if _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    with contextlib.suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGINT, end_at_once)
