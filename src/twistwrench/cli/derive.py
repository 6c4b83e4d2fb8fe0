"""The command ``twistwrench derive``: equations of motion as text and files."""

from __future__ import annotations

from collections.abc import Callable

from ..core.files import replacing
from ..symbolic.derivation import Derivation, derive
from ..symbolic.names import require_sympy
from .shared import RobotOptions
from .skin import Asked, OutputFile, command_of


def _document(option: str, help_: str, text_of: Callable[[Derivation], str]) -> OutputFile[Derivation]:
    """File of the equations, which are written only if they agree with the kernels."""

    def write(derivation: Derivation, path: str) -> None:
        with replacing(path) as scratch:
            scratch.write_text(text_of(derivation), encoding="utf-8")

    return OutputFile(
        f"{option} OUT|-", f"{help_} - is the terminal.", write, is_data=False, exists=lambda found: found.verdict.ok
    )


@command_of(
    "derive",
    derive,
    files=(
        _document("--latex", "Write LaTeX, a document that compiles.", lambda found: found.latex(found.selected)),
        _document("--html", "Write a web page that needs nothing else.", lambda found: found.html(found.selected)),
        _document("--markdown", "Write Markdown.", lambda found: found.markdown(found.selected)),
        _document("--c", "Write C99 source.", Derivation.c_source),
        _document("--numpy", "Write a Python module that needs NumPy only.", Derivation.numpy_source),
    ),
    examples=("derive planar_2r", "derive cart_pole --latex -"),
)
def derive_command(robot: RobotOptions, asked: Asked) -> Derivation:
    """Derive the equations of motion in symbols by Lagrange's method, and write them as text, LaTeX, a page, C or NumPy."""
    require_sympy("twistwrench derive")
    return derive(robot.load(), **asked)
