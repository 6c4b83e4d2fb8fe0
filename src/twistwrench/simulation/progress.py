"""A bar on stderr for runs that take long enough to be watched."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import ValueRangeError

__all__ = ["progress_of"]

_PATIENCE = 1.0
"""s of running before a bar is shown unasked."""
_BETWEEN = 0.1
"""s between two signs of life."""

Progress = bool | None | Callable[[float], None]


@contextmanager
def progress_of(asked: Progress, label: str, duration: float) -> Iterator[Callable[[float], None]]:
    """A function to be told the simulated time after every step, cheap unless something is shown.

    ``asked``: a function of the share done, from 0 to 1; True or False; None is a bar after a second where stderr is a
    terminal. Raises ValueRangeError for anything else.
    """
    if callable(asked):
        tell = asked
        yield lambda t: tell(min(t / duration, 1.0))
        return
    if asked is not None and not isinstance(asked, bool):
        raise ValueRangeError(f"progress is {asked!r}; give True, False, None, or a function of the share done.")
    if asked is False or (asked is None and not sys.stderr.isatty()):
        yield lambda _t: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(label, total=duration)
    due = time.monotonic() + (0.0 if asked else _PATIENCE)
    begun = False

    def tick(t: float) -> None:
        nonlocal due, begun
        now = time.monotonic()
        if now >= due:
            if not begun:
                bar.start()
                begun = True
            bar.update(task, completed=t)
            due = now + _BETWEEN

    try:
        yield tick
    finally:
        if begun:
            bar.stop()
