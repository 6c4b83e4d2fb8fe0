"""The command ``twistwrench derive``: equations of motion as text and files."""

from __future__ import annotations

from collections.abc import Callable
from shutil import get_terminal_size
from textwrap import wrap

import click

from ..core.errors import ValueRangeError
from ..core.files import replacing
from ..core.numbers import number
from ..symbolic.derivation import Derivation
from .main import Given, option
from .shared import RobotOptions, robot_command

_FILES = {
    "latex": "Write LaTeX, a document that compiles.",
    "html": "Write a web page that needs nothing else.",
    "markdown": "Write Markdown.",
    "c": "Write C99 source.",
    "numpy": "Write a Python module that needs NumPy only.",
}
_SHORT = ("mass_matrix", "centripetal", "coriolis", "gravity_forces", "equations")
_PIPED, _NARROWEST = 100, 40


@robot_command(
    "derive",
    option(
        "--symbols KIND|NAME,…",
        "Quantities kept as symbols: all, none, lengths, coms, masses, inertias, gravity, springs, gears, or names such "
        "as L_1; the others are numbers.",
        default="all",
    ),
    option(
        "--form",
        "Write terms in full, or name intermediate results.",
        choices=("auto", "expanded", "named"),
        default="auto",
    ),
    option("--steps STEP,…|all", "Steps to print and write, by name. [default: all]"),
    *(option(f"--{name} OUT|-", f"{text} - is the terminal.") for name, text in _FILES.items()),
    examples=("derive planar_2r", "derive cart_pole --latex -"),
    angles=False,
)
def derive_command(options: RobotOptions, given: Given) -> None:
    """Derive the equations of motion in symbols by Lagrange's method, and write them as text, LaTeX, a page, C or NumPy."""
    from ..symbolic.derivation import derive
    from ..symbolic.names import require_sympy

    robot = options.load()
    require_sympy("twistwrench derive")
    outputs = {name: path for name in _FILES if (path := getattr(given, name)) is not None}
    shown = [name for name, path in outputs.items() if path == "-"]
    if len(shown) > 1:
        raise ValueRangeError(
            f"only one of {', '.join(f'--{n}' for n in shown)} can go to the terminal (-). Name files for the others."
        )
    given.check_files(options.files)
    words = [word.strip() for word in given.symbols.split(",") if word.strip()]
    derivation = derive(robot, symbols=words, form=given.form)
    every = (
        None
        if given.steps is None or given.steps.strip() == "all"
        else [word.strip() for word in given.steps.split(",")]
    )
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
        names = chosen if not outputs else ()
        if given.steps is None and not outputs and derivation.form == "expanded":
            names = _SHORT
        click.echo(_view(derivation, names))
    for name, path in outputs.items():
        text = made[name]()
        if path == "-":
            click.echo(text)
            continue
        with replacing(str(path)) as scratch:
            scratch.write_text(text, encoding="utf-8")
        if not shown:
            click.echo(f"wrote {path}")


def _view(derivation: Derivation, names: tuple[str, ...]) -> str:
    """Symbols with their values, the selected steps and the check, in the width of the terminal, COLUMNS, or 100."""
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
    """Two columns, indented by two blanks, without trailing blanks."""
    from ..symbolic.documents import text_width

    widest = max((int(text_width(left)) for left, _ in rows), default=0)
    lines = []
    for left, right in rows:
        starts = [left + " " * (widest - int(text_width(left))), *[" " * widest] * (len(right) - 1)]
        lines += [f"  {start}{gap}{text}".rstrip() for start, text in zip(starts, right, strict=True)]
    return lines
