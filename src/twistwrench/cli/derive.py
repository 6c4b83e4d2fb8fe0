"""The command ``twistwrench derive``: its options, its files, and what it prints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from shutil import get_terminal_size
from textwrap import wrap
from typing import TYPE_CHECKING

import click

from ..core.numbers import number
from ..errors import ValueRangeError
from .motion_options import option_group

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..robot import Robot
    from ..symbolic.derivation import Derivation

_FILES = {
    "latex": "Write LaTeX, a document that compiles.",
    "html": "Write a web page that needs nothing else.",
    "markdown": "Write Markdown.",
    "c": "Write C99 source.",
    "numpy": "Write a Python module that needs NumPy only.",
}
_SHORT = ("mass_matrix", "centripetal", "coriolis", "gravity_forces", "equations")
_PIPED, _NARROWEST = 100, 40


derive_options = option_group(
    *(
        click.option(f"--{name}", f"{name}_path", metavar="OUT|-", help=f"{text} - is the terminal.")
        for name, text in reversed(_FILES.items())
    ),
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
        help="What is a symbol: all, none, lengths, coms, masses, inertias, gravity, springs, gears, or names such as L_1; "
        "the rest are numbers.",
    ),
)
"""The options of the command, all but the robot's own."""


def run_derive(
    robot: Robot, source: Mapping[str, str | None], *, symbols: str, form: str, steps: str | None, **paths: str | None
) -> Iterator[RenderableType | str]:
    """What the command prints; files are written on the way. ``source`` maps what the user calls the input files to them."""
    from ..core.files import check_outputs, replacing
    from ..symbolic.derivation import derive, require_sympy

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
    for remark in derivation.remarks:
        click.echo(f"note: {remark}", err=True)
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


def _view(derivation: Derivation, names: tuple[str, ...]) -> str:
    """Symbols with their values, the steps named, and the check; as wide as the terminal, COLUMNS, or 100."""
    from ..symbolic.documents import broken, heading, text_width
    from ..symbolic.names import Text

    notation, width = Text(), max(get_terminal_size((_PIPED, 24)).columns, _NARROWEST)
    legend = [*derivation.meanings, *((p.name, f"{p.meaning}: {number(p.value, 6)}") for p in derivation.parameters)]
    parts = [click.style(f"Equations of motion of {derivation.name}", bold=True)]
    parts += _columns([(notation.symbol(name), wrap(meaning, width - 12) or [""]) for name, meaning in legend], "  ")
    for step in derivation.steps:
        if step.name not in names:
            continue
        lefts = [f"{label.write(notation)} =" for label, _ in step.lines]
        room = width - 3 - max(map(text_width, lefts))
        rights = [broken(notation.write(expr), room, text_width) for _, expr in step.lines]
        title = wrap(f"{heading(step)}: {step.remark}", width)
        parts += ["", *(click.style(line, bold=True) for line in title)]
        parts += _columns(list(zip(lefts, rights, strict=True)), " ")
    if derivation.check is not None:
        parts += ["", *wrap(str(derivation.check), width)]
    return "\n".join(parts)


def _columns(rows: list[tuple[str, list[str]]], gap: str) -> list[str]:
    """Two columns, moved in by two, without blanks at the ends of lines."""
    from ..symbolic.documents import text_width

    widest = max((int(text_width(left)) for left, _ in rows), default=0)
    lines = []
    for left, right in rows:
        starts = [left + " " * (widest - int(text_width(left))), *[" " * widest] * (len(right) - 1)]
        lines += [f"  {start}{gap}{text}".rstrip() for start, text in zip(starts, right, strict=True)]
    return lines
