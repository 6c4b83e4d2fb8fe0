"""The console that tables are printed on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..core.arguments import visible

if TYPE_CHECKING:
    from rich.console import Console


_WIDTH = 110
"""Columns of files and pipes, which have no width of their own: most tables need no more."""


def console() -> Console:
    """A console of the terminal's width. What needs more runs over it and is never cut; a broken pipe ends the program."""
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
