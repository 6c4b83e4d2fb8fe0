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
    """Notation of LaTeX with the package amsmath; its methods return LaTeX of parts of a formula."""

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
        function = f"\\{name}^{{{power}}}" if power else f"\\{name}"
        is_single_symbol = re.fullmatch(r"\\?\w+(_\{\w+\})?", argument)  # a letter or command, with an index or not
        if is_single_symbol:  # needs no parentheses
            return f"{function}{{{argument}}}"
        return f"{function}({argument})"

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
        row_texts = [" & ".join(row) for row in rows]
        return "\\begin{bmatrix} " + " \\\\ ".join(row_texts) + " \\end{bmatrix}"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        derivative = f"\\frac{{\\partial {top}}}{{\\partial {variable}}}"
        return f"\\frac{{d}}{{dt}} {derivative}" if rate else derivative

    def partial(self, variable: str, inner: str) -> str:
        return f"\\frac{{\\partial}}{{\\partial {variable}}} {inner}"

    def other(self, expr: Any) -> str:
        return str(sympy.latex(expr))


_MARGIN = 4
"""Width in symbols of the equals sign, or of the indentation of a continuation line."""
_AXES = "xyz"
"""Suffixes of the entries of a column."""

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
    """Remark with a full stop. It begins with a capital letter, unless its first word is a symbol."""
    first_word = remark.partition(" ")[0]
    if first_word.isalpha() and len(first_word) > 1:  # a single letter is a symbol
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
        title, remark = _latex_text(heading(step)), _latex_text(sentence(step.remark))
        parts.append(f"\\section*{{{title}}}\n{remark}")
        lines = _aligned_lines(step, notation)
        parts.append("\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}")
    body = "\n".join(parts)
    if not whole:
        return body + "\n"
    symbol_rows = []
    for name, meaning in legend(equations):
        symbol_rows.append(f"${notation.symbol(name)}$ & {_latex_text(meaning)} \\\\")
    symbol_table = ""
    if symbol_rows:
        symbol_table = "\n".join(["\\begin{tabular}{ll}", *symbol_rows, "\\end{tabular}", ""])
    preamble = (
        "\\documentclass[a4paper]{article}\n\\usepackage{amsmath,amssymb}\n\\usepackage[margin=20mm]{geometry}\n"
        "\\allowdisplaybreaks\n\\setlength{\\parindent}{0pt}\n\\begin{document}\n"
    )
    title = f"\\section*{{Equations of motion of {_latex_text(equations.name)}}}\n"
    remarks = "".join(f"{_latex_text(text)}\n\n" for text in remarks_of(equations))
    return f"{preamble}{title}{remarks}{symbol_table}{body}\n\\end{{document}}\n"


def markdown_document(equations: Equations, steps: tuple[Step, ...], notation: Notation) -> str:
    """Markdown: headings, a table of symbols, and formulas between dollars."""
    title = f"# Equations of motion of {_markdown_text(equations.name)}"
    parts = [title, *map(_markdown_text, remarks_of(equations))]
    symbol_rows = []
    for name, meaning in legend(equations):
        cell = _markdown_text(meaning).replace("|", "\\|")  # a bar would end the cell
        symbol_rows.append(f"| ${notation.symbol(name)}$ | {cell} |")
    if symbol_rows:
        parts.append("\n".join(["| symbol | meaning |", "|---|---|", *symbol_rows]))
    for step in steps:
        parts.append(f"## {heading(step)}\n\n{sentence(step.remark)}")
        lines = _aligned_lines(step, notation)
        parts += [f"$$\n\\begin{{aligned}} {line} \\end{{aligned}}\n$$" for line in lines]
    return "\n\n".join(parts) + "\n"


def _markdown_text(text: str) -> str:
    """Text with links and HTML elements escaped for Markdown."""
    without_links = visible(text).replace("](", "]\\(")
    return without_links.replace("<", "&lt;")


def legend(equations: Equations) -> list[tuple[str, str]]:
    """Names of the symbols, each with its meaning and the value of a parameter."""
    parameter_rows = [(p.name, f"{p.meaning}: {printed(p.value)}") for p in equations.parameters]
    return [*equations.meanings, *parameter_rows]


def _aligned_lines(step: Step, notation: Notation) -> list[str]:
    """Aligned ``left &= right`` for each line; long sums take several lines, wide columns one line per entry."""
    width = _right_side_width(step.lines, notation)
    lines: list[Line] = []
    for line in step.lines:
        lines.extend(_split_column(line, width, notation))
    # entries of columns have longer labels, which leave less for the right side
    sum_width = min(width, _right_side_width(lines, notation))
    formulas = []
    for label, expr in lines:
        right_side = notation.write(expr)
        pieces = [right_side]
        is_matrix = hasattr(expr, "shape")
        if not is_matrix:
            pieces = break_lines(right_side, sum_width, latex_symbols)
        formulas.append(f"{label.write(notation)} &= " + " \\\\\n&\\quad ".join(pieces))
    return formulas


def _right_side_width(lines: Iterable[Line], notation: Notation) -> int:
    """Number of symbols that remain for right-hand sides beside the widest left-hand side."""
    label_widths = [latex_symbols(label.write(notation)) for label, _ in lines]
    return LINE_SYMBOLS - _MARGIN - max(label_widths, default=0)


def _split_column(line: Line, width: int, notation: Notation) -> list[Line]:
    """The line alone, or three lines such as p_2x, p_2y and p_2z if its right-hand side is a column that is too wide."""
    label, expr = line
    is_column = hasattr(expr, "shape")
    if not is_column:
        return [line]
    widest_entry = max(latex_symbols(notation.write(entry)) for entry in expr)
    if widest_entry + _MARGIN <= width:
        return [line]
    entry_lines: list[Line] = []
    for axis, entry in zip(_AXES, expr, strict=True):
        entry_lines.append((replace(label, name=f"{label.name}{axis}"), entry))
    return entry_lines


_LATEX_OF_CHARACTERS = {
    "Γ": "$\\Gamma$", "τ": "$\\tau$", "Σ": "$\\Sigma$", "ω": "$\\omega$", "½": "$\\tfrac12$", "∂": "$\\partial$", "−": "$-$",
    "·": "$\\cdot$", "≤": "$\\le$", "q̇": "$\\dot q$", "q̈": "$\\ddot q$", "²": "$^2$", "–": "--", "…": "\\dots{}",
    "_": "\\_", "%": "\\%", "&": "\\&", "#": "\\#", "$": "\\$", "{": "\\{", "}": "\\}", "^": "\\^{}", "~": "\\~{}",
    "\\": "\\textbackslash{}",
}  # fmt: skip
# The longest come first, so that a letter with a combining dot is not found as the letter alone.
_CHARACTERS_BY_LENGTH = sorted(_LATEX_OF_CHARACTERS, key=len, reverse=True)
_SPECIAL_CHARACTER = re.compile("|".join(map(re.escape, _CHARACTERS_BY_LENGTH)))


def _latex_text(text: str) -> str:
    """LaTeX of a name or sentence, with adjacent formulas joined."""
    latex = _SPECIAL_CHARACTER.sub(lambda match: _LATEX_OF_CHARACTERS[match.group()], text)
    return re.sub(r"(?<!\\)\$\$", "", latex)  # the end of a formula and the beginning of the next one
