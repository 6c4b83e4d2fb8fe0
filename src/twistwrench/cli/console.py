"""The console that tables are printed on."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def console() -> Console:
    """A console of the terminal's width, or of one that holds the tables; a pipe that breaks ends the program."""
    from rich.console import Console

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise

    made = Output(highlight=False)
    # Files and pipes have no width of their own; 110 columns hold the tables without folding.
    return made if made.is_terminal else Output(highlight=False, width=110)
