"""Terminal of the commands: reports on standard output, and progress bars on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click
from rich.console import Console

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.answers.shown_blocks import shown_blocks
from ..core.answers.terminal import console, renderable, short_form
from ..core.text import visible


def show(*blocks: Block) -> None:
    """Print blocks on standard output.

    Without --all, long tables are shortened and notes on how a file was read are counted.
    """
    output = console()
    context = click.get_current_context(silent=True)
    whole_report = context is None or bool(context.params.get("whole_report", True))
    if whole_report:
        blocks_to_print = shown_blocks(blocks, every=True, hint="--all")
    else:
        blocks_to_print = short_form(blocks, "--all")
    for block in blocks_to_print:
        output.print(renderable(block, output))


def show_answer(answer: Answer) -> None:
    """Print an answer."""
    show(*answer.blocks())


# ── Progress bars on stderr, on a terminal only

_SECONDS_BEFORE_BAR = 1.0
"""Delay [s] before a bar is shown."""
_SECONDS_BETWEEN_DRAWINGS = 0.1
"""Time [s] between updates of a bar."""


def _progress_display() -> Any:
    """Rich's progress bar with description, share and remaining time."""
    from rich import progress

    columns = (
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.TextColumn("{task.percentage:3.0f} %"),
        progress.TimeRemainingColumn(),
    )
    return progress.Progress(*columns, console=Console(stderr=True), transient=True)


@contextmanager
def frame_progress(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """Progress bar over the frames of a film; None if standard error is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    with _progress_display() as bar:
        task = bar.add_task(visible(what), total=None)
        yield lambda finished_frames, all_frames: bar.update(task, completed=finished_frames, total=all_frames)


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None] | None]:
    """Progress bar over the finished share, 0 to 1, shown after a second; None if standard error is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    bar = _progress_display()
    task = bar.add_task(visible(what), total=1.0)
    is_shown = False
    next_drawing = time.monotonic() + _SECONDS_BEFORE_BAR

    def update(share: float) -> None:
        nonlocal next_drawing, is_shown
        now = time.monotonic()
        if now < next_drawing:
            return
        if not is_shown:
            bar.start()
            is_shown = True
        bar.update(task, completed=share)
        next_drawing = now + _SECONDS_BETWEEN_DRAWINGS

    try:
        yield update
    finally:
        if is_shown:
            bar.stop()
