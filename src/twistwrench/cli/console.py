"""Input and output of commands: the console, progress bars, paths of pictures, and files of a batch."""

from __future__ import annotations

import glob
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.arguments import visible
from ..core.files import picture_path
from ..errors import ValueRangeError
from .usage import option_group

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

_WIDTH = 110
"""Width of output to files and pipes, in characters."""


def console() -> Console:
    """Console of the terminal's width. Longer lines are never cut; a broken pipe ends the program."""
    from rich.console import Console
    from rich.segment import Segment

    class Output(Console):
        def render(self, renderable: Any, options: Any = None) -> Any:
            for segment in super().render(renderable, options):
                yield segment if segment.control else Segment(visible(segment.text), segment.style)

        def on_broken_pipe(self) -> None:
            raise

        def print(self, *objects: Any, **options: Any) -> None:
            super().print(*objects, **{"crop": False, **options})

    made = Output(highlight=False)
    return made if made.is_terminal else Output(highlight=False, width=_WIDTH)


def show(*parts: Any) -> None:
    """Print on standard output."""
    for part in parts:
        console().print(part)


def show_written(*paths: object) -> None:
    """Print a line for each file that was written, except None."""
    for path in filter(None, paths):
        click.echo(f"wrote {path}")


# ── Progress bars on stderr, on a terminal only

_PATIENCE = 1.0
"""s of work before a bar is shown."""
_BETWEEN = 0.1
"""s between two updates of a bar."""


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
def frame_progress(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """Progress bar over the frames of a film; None if standard error is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    with _bar() as bar:
        task = bar.add_task(visible(what), total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None] | None]:
    """Progress bar over the finished share, 0 to 1, shown after a second; None if standard error is not a terminal."""
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


# ── Paths of pictures


def check_matplotlib(plot_path: str | None) -> None:
    """Raise before a long run if a picture cannot be drawn."""
    if plot_path is not None:
        from ..plotting.style import require_matplotlib

        require_matplotlib("Drawing the report (--plot)")


def picture(plot_path: str | None) -> str | None:
    """Path of a picture with its suffix; None without one. Raises if it cannot be drawn."""
    check_matplotlib(plot_path)
    return None if plot_path is None else picture_path(plot_path)


# ── Batches: the files of folders and patterns

worker_options = option_group(
    click.option(
        "--scheduler", metavar="ADDRESS", help="Work on the Dask cluster of this scheduler: tcp://10.0.0.1:8786."
    ),
    click.option("--workers", type=int, metavar="N", help="Work on N processes of this machine (Dask)."),
)
"""``--workers`` and ``--scheduler``."""


def expand_paths(path: Path, text: str) -> list[str]:
    """Expand a folder or a pattern to its files, sorted by name; other paths are returned unchanged."""
    from ..motion.motion_file import is_recording

    if any(c in text for c in "*?[") and not path.exists():
        matches = sorted(glob.glob(text))  # noqa: PTH207  the pattern may begin at the root
        if not matches:
            raise ValueRangeError(f"no file matches {text!r}.")
        return matches
    if path.is_dir() and not is_recording(path):
        inside = sorted(str(p) for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
        if not inside:
            raise ValueRangeError(f"{text!r} is a folder without files.")
        return inside
    return [str(path)]


def total_bytes(paths: Sequence[str]) -> int:
    """Sum of the sizes of files, ``a.csv+b.csv`` among them; unreadable files count as zero."""
    total = 0
    for path in paths:
        for part in [path] if Path(path).exists() else path.split("+"):
            try:
                total += Path(part.strip()).stat().st_size * (10 if part.endswith(".gz") else 1)
            except OSError:
                continue
    return total
