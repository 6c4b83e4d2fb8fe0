"""Derivations as LaTeX and as Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from ..core.arguments import visible
from ..core.printed_numbers import printed
from .latex import Latex
from .line_breaks import TEXT_WIDTH, broken, latex_width
from .notation import Notation

if TYPE_CHECKING:
    from .equations import Equations, Line, Step

_MARGIN = 24.0  # points: the equals sign, and how far a line that goes on is moved in
_AXES = "xyz"

_HEADINGS = {
    "momenta": "Momenta ∂L/∂q̇",
    "explicit_time": "Explicit time ∂/∂t ∂L/∂q̇",
    "momentum_rates": "Their rates d/dt ∂L/∂q̇",
    "slopes": "Slopes ∂L/∂q",
    "christoffel": "Christoffel symbols",
    "coriolis": "Coriolis terms",
    "centripetal": "Centripetal terms",
    "coriolis_matrix": "Coriolis matrix",
    "kinetic_energies": "Kinetic energies",
    "potential_energies": "Potential energies",
    "equations": "Equations of motion",
}


def heading(step: Step) -> str:
    """The name of a step as a heading."""
    return _HEADINGS.get(step.name, step.name.replace("_", " ").capitalize())


def sentence(remark: str) -> str:
    """A remark with a full stop, and a capital where it begins with a word."""
    first = remark.partition(" ")[0]
    return f"{remark[:1].upper()}{remark[1:]}." if first.isalpha() and len(first) > 1 else f"{remark}."


def remarks_of(equations: Equations) -> list[str]:
    """Sentences that belong under the title: the check, where there is one."""
    check = getattr(equations, "check", None)
    sentence = [] if check is None else [f"{str(check)[0].upper()}{str(check)[1:]}."]
    return [*sentence, *equations.remarks]


def latex_document(equations: Equations, steps: tuple[Step, ...], notation: Latex, *, whole: bool) -> str:
    """Sections of aligned equations; a document where ``whole``."""
    parts = []
    for step in steps:
        parts.append(f"\\section*{{{_in_latex(heading(step))}}}\n{_in_latex(sentence(step.remark))}")
        lines = _aligned(step, notation)
        parts.append("\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}")
    body = "\n".join(parts)
    if not whole:
        return body + "\n"
    legend = "\n".join(f"${notation.symbol(name)}$ & {_in_latex(meaning)} \\\\" for name, meaning in _legend(equations))
    table = f"\\begin{{tabular}}{{ll}}\n{legend}\n\\end{{tabular}}\n" if legend else ""
    head = (
        "\\documentclass[a4paper]{article}\n\\usepackage{amsmath,amssymb}\n\\usepackage[margin=20mm]{geometry}\n"
        "\\allowdisplaybreaks\n\\setlength{\\parindent}{0pt}\n\\begin{document}\n"
    )
    title = f"\\section*{{Equations of motion of {_in_latex(equations.name)}}}\n"
    said = "".join(f"{_in_latex(text)}\n\n" for text in remarks_of(equations))
    return f"{head}{title}{said}{table}{body}\n\\end{{document}}\n"


def markdown_document(equations: Equations, steps: tuple[Step, ...], notation: Notation) -> str:
    """Headings, a table of symbols, formulas between dollars."""
    parts = [f"# Equations of motion of {_in_markdown(equations.name)}", *map(_in_markdown, remarks_of(equations))]
    if legend := _legend(equations):
        rows = [
            f"| ${notation.symbol(name)}$ | {_in_markdown(meaning).replace('|', chr(92) + '|')} |"
            for name, meaning in legend
        ]
        parts.append("\n".join(["| symbol | meaning |", "|---|---|", *rows]))
    for step in steps:
        parts.append(f"## {heading(step)}\n\n{sentence(step.remark)}")
        parts.extend(f"$$\n\\begin{{aligned}} {line} \\end{{aligned}}\n$$" for line in _aligned(step, notation))
    return "\n\n".join(parts) + "\n"


def _in_markdown(text: str) -> str:
    """Names and sentences, which make no links and no elements of HTML."""
    return visible(text).replace("](", "]\\(").replace("<", "&lt;")


def _legend(equations: Equations) -> list[tuple[str, str]]:
    return [*equations.meanings, *((p.name, f"{p.meaning}: {printed(p.value)}") for p in equations.parameters)]


def _aligned(step: Step, notation: Notation) -> list[str]:
    """left &= right of each line, long sums over several lines of the page, long columns entry by entry."""
    room = _room(step.lines, notation)
    lines = [part for line in step.lines for part in _entries(line, room, notation)]
    room = min(room, _room(lines, notation))
    found = []
    for label, expr in lines:
        rows = [notation.write(expr)]
        if not hasattr(expr, "shape"):
            rows = broken(rows[0], room, latex_width)
        found.append(f"{label.write(notation)} &= " + " \\\\\n&\\quad ".join(rows))
    return found


def _room(lines: Iterable[Line], notation: Notation) -> float:
    """Points beside the widest left-hand side."""
    return TEXT_WIDTH - _MARGIN - max((latex_width(label.write(notation)) for label, _ in lines), default=0.0)


def _entries(line: Line, room: float, notation: Notation) -> list[Line]:
    """A column that is too wide as three lines, p_2x, p_2y and p_2z."""
    label, expr = line
    if not hasattr(expr, "shape") or max(latex_width(notation.write(x)) for x in expr) + _MARGIN <= room:
        return [line]
    return [(replace(label, name=f"{label.name}{axis}"), x) for axis, x in zip(_AXES, expr, strict=True)]


_PLAIN = {
    "Γ": "$\\Gamma$", "τ": "$\\tau$", "Σ": "$\\Sigma$", "ω": "$\\omega$", "½": "$\\tfrac12$", "∂": "$\\partial$", "−": "$-$",
    "·": "$\\cdot$", "≤": "$\\le$", "q̇": "$\\dot q$", "q̈": "$\\ddot q$", "²": "$^2$", "–": "--", "…": "\\dots{}",
    "_": "\\_", "%": "\\%", "&": "\\&", "#": "\\#", "$": "\\$", "{": "\\{", "}": "\\}", "^": "\\^{}", "~": "\\~{}",
    "\\": "\\textbackslash{}",
}  # fmt: skip
_SPECIAL = re.compile("|".join(re.escape(plain) for plain in sorted(_PLAIN, key=len, reverse=True)))


def _in_latex(text: str) -> str:
    """Names and sentences as LaTeX, formulas side by side as one."""
    return re.sub(r"(?<!\\)\$\$", "", _SPECIAL.sub(lambda found: _PLAIN[found.group()], text))
