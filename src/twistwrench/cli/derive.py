"""The command ``twistwrench derive``: equations of motion as text and files."""

from __future__ import annotations

from collections.abc import Callable

import click

from ..core.errors import ValueRangeError
from ..core.files import replacing
from ..core.verdict import ExitCode
from . import shared
from .main import Given, option
from .shared import RobotOptions, robot_command
from .terminal import show_answer

_FILES = {
    "latex": "Write LaTeX, a document that compiles.",
    "html": "Write a web page that needs nothing else.",
    "markdown": "Write Markdown.",
    "c": "Write C99 source.",
    "numpy": "Write a Python module that needs NumPy only.",
}


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
    shared.JSON,
    examples=("derive planar_2r", "derive cart_pole --latex -"),
    angles=False,
)
def derive_command(options: RobotOptions, given: Given) -> ExitCode:
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
    derivation = derive(robot, symbols=_listed(given.symbols), form=given.form, steps=_listed(given.steps) or None)
    chosen = derivation.selected
    made: dict[str, Callable[[], str]] = {
        "latex": lambda: derivation.latex(chosen),
        "html": lambda: derivation.html(chosen),
        "markdown": lambda: derivation.markdown(chosen),
        "c": derivation.c_source,
        "numpy": derivation.numpy_source,
    }
    if not shown or not derivation.verdict.ok:
        show_answer(derivation)
    for name, path in outputs.items() if derivation.verdict.ok else ():
        text = made[name]()
        if path == "-":
            click.echo(text)
            continue
        with replacing(str(path)) as scratch:
            scratch.write_text(text, encoding="utf-8")
        if not shown:
            shared.show_written(path)
    return derivation.verdict.exit_code


def _listed(text: str | None) -> list[str]:
    """Words between commas."""
    return [word.strip() for word in (text or "").split(",") if word.strip()]
