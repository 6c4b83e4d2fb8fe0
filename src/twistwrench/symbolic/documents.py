"""Derivations as documents in LaTeX and Markdown, with line breaks of long sums."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..core.numbers import printed
from ..core.text import visible
from .line_breaks import LINE_SYMBOLS, break_lines, latex_symbols
from .names import GREEK, Notation, name_parts, sympy

if TYPE_CHECKING:
    from .equations import Equations, Line, Step


class Latex(Notation):
    """LaTeX for amsmath."""

    def symbol(self, name: str) -> str:
        stem, mark, index = name_parts(name)
        if stem in GREEK:
            letter = f"\\{stem}"
        else:
            letter = stem if len(stem) == 1 else f"\\mathit{{{stem}}}"
        if mark:
            letter = f"\\{mark}{{{letter}}}"
        if not index:
            return letter
        return f"{letter}_{{{index.replace('_', ',')}}}"

    def figure(self, digits: str) -> str:
        mantissa, _, power = digits.partition("e")
        if not power:
            return digits
        return f"{mantissa} \\cdot 10^{{{int(power)}}}"

    def function(self, name: str, argument: str, power: str = "") -> str:
        head = f"\\{name}^{{{power}}}" if power else f"\\{name}"
        if re.fullmatch(r"\\?\w+(_\{\w+\})?", argument):
            return f"{head}{{{argument}}}"
        return f"{head}({argument})"

    def superscript(self, base: str, power: str) -> str:
        return f"{base}^{{{power}}}"

    def above(self, inner: str) -> str:
        return inner

    def fraction(self, top: str, bottom: str) -> str:
        if (top, bottom) == ("1", "2"):
            return "\\tfrac{1}{2}"
        return f"\\frac{{{top}}}{{{bottom}}}"

    def times(self, factors: list[str]) -> str:
        return " \\, ".join(factors)

    def minus(self, inner: str) -> str:
        return f"-{inner}"

    def operator(self, sign: str) -> str:
        return sign

    def matrix(self, rows: list[list[str]]) -> str:
        return "\\begin{bmatrix} " + " \\\\ ".join(map(" & ".join, rows)) + " \\end{bmatrix}"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        slope = f"\\frac{{\\partial {top}}}{{\\partial {variable}}}"
        return f"\\frac{{d}}{{dt}} {slope}" if rate else slope

    def partial(self, variable: str, inner: str) -> str:
        return f"\\frac{{\\partial}}{{\\partial {variable}}} {inner}"

    def other(self, expr: Any) -> str:
        return str(sympy.latex(expr))


_MARGIN = 4  # symbols: the equals sign, or the indentation of a continuation line
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
    """Name of a step as a heading."""
    return _HEADINGS.get(step.name, step.name.replace("_", " ").capitalize())


def sentence(remark: str) -> str:
    """Remark with a full stop, and a capital letter if it begins with a word."""
    first_word = remark.partition(" ")[0]
    if first_word.isalpha() and len(first_word) > 1:
        remark = remark[:1].upper() + remark[1:]
    return f"{remark}."


def remarks_of(equations: Equations) -> list[str]:
    """Sentences below the title: the check, if there is one, and the remarks."""
    check = getattr(equations, "check", None)
    if check is None:
        return list(equations.remarks)
    return [sentence(str(check)), *equations.remarks]


def latex_document(equations: Equations, steps: tuple[Step, ...], notation: Latex, *, whole: bool) -> str:
    """Sections of aligned equations; a complete document if ``whole``."""
    parts = []
    for step in steps:
        parts.append(f"\\section*{{{_latex_text(heading(step))}}}\n{_latex_text(sentence(step.remark))}")
        lines = _aligned_lines(step, notation)
        parts.append("\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}")
    body = "\n".join(parts)
    if not whole:
        return body + "\n"
    rows = [f"${notation.symbol(name)}$ & {_latex_text(meaning)} \\\\" for name, meaning in legend(equations)]
    table = ""
    if rows:
        table = "\n".join(["\\begin{tabular}{ll}", *rows, "\\end{tabular}", ""])
    head = (
        "\\documentclass[a4paper]{article}\n\\usepackage{amsmath,amssymb}\n\\usepackage[margin=20mm]{geometry}\n"
        "\\allowdisplaybreaks\n\\setlength{\\parindent}{0pt}\n\\begin{document}\n"
    )
    title = f"\\section*{{Equations of motion of {_latex_text(equations.name)}}}\n"
    remarks = "".join(f"{_latex_text(text)}\n\n" for text in remarks_of(equations))
    return f"{head}{title}{remarks}{table}{body}\n\\end{{document}}\n"


def markdown_document(equations: Equations, steps: tuple[Step, ...], notation: Notation) -> str:
    """Markdown: headings, a table of symbols, and formulas between dollars."""
    parts = [f"# Equations of motion of {_markdown_text(equations.name)}", *map(_markdown_text, remarks_of(equations))]
    rows = []
    for name, meaning in legend(equations):
        cell = _markdown_text(meaning).replace("|", "\\|")
        rows.append(f"| ${notation.symbol(name)}$ | {cell} |")
    if rows:
        parts.append("\n".join(["| symbol | meaning |", "|---|---|", *rows]))
    for step in steps:
        parts.append(f"## {heading(step)}\n\n{sentence(step.remark)}")
        lines = _aligned_lines(step, notation)
        parts += [f"$$\n\\begin{{aligned}} {line} \\end{{aligned}}\n$$" for line in lines]
    return "\n\n".join(parts) + "\n"


def _markdown_text(text: str) -> str:
    """Text without links and HTML elements."""
    return visible(text).replace("](", "]\\(").replace("<", "&lt;")


def legend(equations: Equations) -> list[tuple[str, str]]:
    """Names of the symbols with their meanings and values."""
    values = [(p.name, f"{p.meaning}: {printed(p.value)}") for p in equations.parameters]
    return [*equations.meanings, *values]


def _aligned_lines(step: Step, notation: Notation) -> list[str]:
    """Aligned ``left &= right`` for each line; long sums take several lines, long columns one line per entry."""
    room = _room(step.lines, notation)
    lines: list[Line] = []
    for line in step.lines:
        lines.extend(_entries(line, room, notation))
    room = min(room, _room(lines, notation))
    formulas = []
    for label, expr in lines:
        rows = [notation.write(expr)]
        if not hasattr(expr, "shape"):
            rows = break_lines(rows[0], room, latex_symbols)
        formulas.append(f"{label.write(notation)} &= " + " \\\\\n&\\quad ".join(rows))
    return formulas


def _room(lines: Iterable[Line], notation: Notation) -> int:
    """Number of symbols left of the widest left-hand side."""
    widths = [latex_symbols(label.write(notation)) for label, _ in lines]
    return LINE_SYMBOLS - _MARGIN - max(widths, default=0)


def _entries(line: Line, room: int, notation: Notation) -> list[Line]:
    """Column that is too wide, as three lines such as p_2x, p_2y and p_2z."""
    label, expr = line
    if not hasattr(expr, "shape"):
        return [line]
    width = max(latex_symbols(notation.write(entry)) for entry in expr)
    if width + _MARGIN <= room:
        return [line]
    return [(replace(label, name=f"{label.name}{axis}"), x) for axis, x in zip(_AXES, expr, strict=True)]


_PLAIN = {
    "Γ": "$\\Gamma$", "τ": "$\\tau$", "Σ": "$\\Sigma$", "ω": "$\\omega$", "½": "$\\tfrac12$", "∂": "$\\partial$", "−": "$-$",
    "·": "$\\cdot$", "≤": "$\\le$", "q̇": "$\\dot q$", "q̈": "$\\ddot q$", "²": "$^2$", "–": "--", "…": "\\dots{}",
    "_": "\\_", "%": "\\%", "&": "\\&", "#": "\\#", "$": "\\$", "{": "\\{", "}": "\\}", "^": "\\^{}", "~": "\\~{}",
    "\\": "\\textbackslash{}",
}  # fmt: skip
_SPECIAL = re.compile("|".join(map(re.escape, sorted(_PLAIN, key=len, reverse=True))))


def _latex_text(text: str) -> str:
    """Names and sentences in LaTeX, with adjacent formulas joined."""
    return re.sub(r"(?<!\\)\$\$", "", _SPECIAL.sub(lambda match: _PLAIN[match.group()], text))
