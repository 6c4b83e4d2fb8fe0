"""The command ``twistwrench derive``: its options, its files, and what it prints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import click

from ..errors import ValueRangeError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..robot import Robot
    from .derivation import Derivation

__all__ = ["derive_answer", "derive_options"]

_FILES = {
    "latex": "Write LaTeX, a document that compiles.",
    "html": "Write a web page that needs nothing else.",
    "markdown": "Write Markdown.",
    "c": "Write C99 source.",
    "numpy": "Write a Python module that needs NumPy only.",
}
_SHORT = ("mass_matrix", "centripetal", "coriolis", "gravity_forces", "equations")


def derive_options(function: Callable[..., None]) -> Callable[..., None]:
    """The options of the command, all but the robot's own."""
    for name, text in reversed(_FILES.items()):
        function = click.option(f"--{name}", f"{name}_path", metavar="OUT|-", help=f"{text} - is the terminal.")(
            function
        )
    for option in (
        click.option("--steps", metavar="STEP,…|all", help="Which steps to print and write, by name."),
        click.option(
            "--form",
            type=click.Choice(["auto", "expanded", "named"]),
            default="auto",
            show_default=True,
            help="Terms written out, or names for intermediate results.",
        ),
        click.option(
            "--symbols",
            default="all",
            show_default=True,
            metavar="KIND|NAME,…",
            help="What is a symbol: all, none, lengths, coms, masses, inertias, gravity, springs, or names such as L_1; "
            "the rest are numbers.",
        ),
    ):
        function = option(function)
    return function


def derive_answer(
    robot: Robot, source: Mapping[str, str | None], *, symbols: str, form: str, steps: str | None, **paths: str | None
) -> Iterator[RenderableType | str]:
    """What the command prints; files are written on the way. ``source`` maps what the user calls the input files to them.

    Text for the terminal alone, as LaTeX, comes as ``str``; the rest is for rich.
    """
    from ..outputs import check_outputs, replacing
    from .derivation import derive, require_sympy

    require_sympy("twistwrench derive")
    outputs = {name: paths[f"{name}_path"] for name in _FILES if paths[f"{name}_path"] is not None}
    shown = [name for name, path in outputs.items() if path == "-"]
    if len(shown) > 1:
        raise ValueRangeError(
            f"only one of {', '.join(f'--{n}' for n in shown)} can go to the terminal (-). Name files for the others."
        )
    check_outputs({f"--{name}": path for name, path in outputs.items() if path != "-"}, source)
    words = [word.strip() for word in symbols.split(",") if word.strip()]
    derivation = derive(robot, symbols=words, form=form)
    every = None if steps is None or steps.strip() == "all" else [word.strip() for word in steps.split(",")]
    chosen = tuple(step.name for step in derivation.chosen(every))
    made: dict[str, Callable[[], str]] = {
        "latex": lambda: derivation.latex(chosen),
        "html": lambda: derivation.html(chosen),
        "markdown": lambda: derivation.markdown(chosen),
        "c": derivation.c_source,
        "numpy": derivation.numpy_source,
    }
    if not shown:
        yield _view(
            derivation,
            _SHORT
            if steps is None and not outputs and derivation.form == "expanded"
            else chosen
            if not outputs
            else (),
        )
    for name, path in outputs.items():
        text = made[name]()
        if path == "-":
            yield text
            continue
        with replacing(str(path)) as scratch:
            scratch.write_text(text, encoding="utf-8")
        if not shown:
            yield f"wrote {path}"


def _view(derivation: Derivation, names: tuple[str, ...]) -> RenderableType:
    """Symbols with their values, the steps named, and the check."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text as Words

    from .documents import heading
    from .notation import Text

    notation = Text()
    legend = Table.grid(padding=(0, 2))
    for name, meaning in derivation.meanings:
        legend.add_row(Words(notation.symbol(name)), Words(meaning))
    for p in derivation.parameters:
        legend.add_row(Words(notation.symbol(p.name)), Words(f"{p.meaning}: {p.value:.6g}"))
    parts: list[RenderableType] = [
        Words(f"Equations of motion of {derivation.name}", "bold"),
        Padding(legend, (0, 0, 0, 2)),
    ]
    for step in derivation.steps:
        if step.name not in names:
            continue
        grid = Table.grid(padding=(0, 1))
        for label, expr in step.lines:
            grid.add_row(Words(label.write(notation), no_wrap=True), Words("="), Words(notation.write(expr)))
        parts += [Words(f"\n{heading(step)}: {step.remark}", "bold"), Padding(grid, (0, 0, 0, 2))]
    check = "" if derivation.check is None else f"\n{derivation.check}"
    return Group(*parts, Words(check))
