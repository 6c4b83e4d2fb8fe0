"""Bars on stderr for work that takes long enough to be watched. They are shown where a person watches, on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..core.arguments import visible

if TYPE_CHECKING:
    from rich.progress import Progress

_PATIENCE = 1.0
"""s of work before a bar is shown."""
_BETWEEN = 0.1
"""s between two signs of life."""


def _bar() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=Console(stderr=True), transient=True)


@contextmanager
def frames_drawn(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """Over the frames of a film; None where there is no bar."""
    if not sys.stderr.isatty():
        yield None
        return
    with _bar() as bar:
        task = bar.add_task(visible(what), total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


@contextmanager
def share_done(what: str) -> Iterator[Callable[[float], None] | None]:
    """Over the share of the work that is done, from 0 to 1; shown after a second. None where there is no bar."""
    if not sys.stderr.isatty():
        yield None
        return
    bar, due, begun = _bar(), time.monotonic() + _PATIENCE, False
    task = bar.add_task(visible(what), total=1.0)

    def tick(share: float) -> None:
        nonlocal due, begun
        now = time.monotonic()
        if now >= due:
            if not begun:
                bar.start()
                begun = True
            bar.update(task, completed=share)
            due = now + _BETWEEN

    try:
        yield tick
    finally:
        if begun:
            bar.stop()
