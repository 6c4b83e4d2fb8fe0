"""Derivations as documents: LaTeX and MathML of expressions, line breaks of long sums, LaTeX, Markdown and HTML files."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from ..core.numbers import printed
from ..core.text import visible
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
        return f"{letter}_{{{index.replace('_', ',')}}}" if index else letter

    def figure(self, digits: str) -> str:
        mantissa, _, power = digits.partition("e")
        return f"{mantissa} \\cdot 10^{{{int(power)}}}" if power else digits

    def function(self, name: str, argument: str, power: str = "") -> str:
        head = f"\\{name}" + (f"^{{{power}}}" if power else "")
        return f"{head}{{{argument}}}" if re.fullmatch(r"\\?\w+(_\{\w+\})?", argument) else f"{head}({argument})"

    def superscript(self, base: str, power: str) -> str:
        return f"{base}^{{{power}}}"

    def above(self, inner: str) -> str:
        return inner

    def fraction(self, top: str, bottom: str) -> str:
        return f"\\frac{{{top}}}{{{bottom}}}" if (top, bottom) != ("1", "2") else "\\tfrac{1}{2}"

    def times(self, factors: list[str]) -> str:
        return " \\, ".join(factors)

    def minus(self, inner: str) -> str:
        return f"-{inner}"

    def operator(self, sign: str) -> str:
        return sign

    def matrix(self, rows: list[list[str]]) -> str:
        return "\\begin{bmatrix} " + " \\\\ ".join(" & ".join(row) for row in rows) + " \\end{bmatrix}"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        return ("\\frac{d}{dt} " if rate else "") + f"\\frac{{\\partial {top}}}{{\\partial {variable}}}"

    def partial(self, variable: str, inner: str) -> str:
        return f"\\frac{{\\partial}}{{\\partial {variable}}} {inner}"

    def other(self, expr: Any) -> str:
        return str(sympy.latex(expr))


# ── MathML


class MathML(Notation):
    """Presentation MathML, which browsers display without scripts."""

    def symbol(self, name: str) -> str:
        stem, mark, index = name_parts(name)
        letter = f"<mi>{escape(GREEK.get(stem, stem))}</mi>"
        if mark:
            letter = f'<mover accent="true">{letter}<mo>{"˙" if mark == "dot" else "¨"}</mo></mover>'
        return f"<msub>{letter}<mi>{escape(index.replace('_', ','))}</mi></msub>" if index else letter

    def figure(self, digits: str) -> str:
        mantissa, _, power = digits.partition("e")
        if not power:
            return f"<mn>{digits}</mn>"
        return f"<mn>{mantissa}</mn><mo>·</mo><msup><mn>10</mn><mn>{str(int(power)).replace('-', '−')}</mn></msup>"

    def function(self, name: str, argument: str, power: str = "") -> str:
        head = f"<msup><mi>{name}</mi><mn>{power}</mn></msup>" if power else f"<mi>{name}</mi>"
        return f"<mrow>{head}{self.bracket(argument)}</mrow>"

    def superscript(self, base: str, power: str) -> str:
        return f"<msup><mrow>{base}</mrow><mn>{power.replace('-', '−')}</mn></msup>"

    def bracket(self, inner: str) -> str:
        return f'<mo stretchy="false">(</mo>{inner}<mo stretchy="false">)</mo>'

    def above(self, inner: str) -> str:
        return inner

    def fraction(self, top: str, bottom: str) -> str:
        top, bottom = (x if x.startswith("<") else f"<mn>{x}</mn>" for x in (top, bottom))
        return f"<mfrac><mrow>{top}</mrow><mrow>{bottom}</mrow></mfrac>"

    def times(self, factors: list[str]) -> str:
        return '<mspace width="0.15em"/>'.join(factors)

    def minus(self, inner: str) -> str:
        return f'<mo form="prefix">−</mo>{inner}'

    def between(self, sign: str) -> str:
        return f"<mo>{self.operator(sign)}</mo>"

    def matrix(self, rows: list[list[str]]) -> str:
        lines = []
        for row in rows:
            cells = "".join(f"<mtd>{x}</mtd>" for x in row)
            lines.append(f"<mtr>{cells}</mtr>")
        # Brackets are drawn by the style sheet: stretched ones need a mathematical font, which many systems lack.
        return f'<mtable class="matrix">{"".join(lines)}</mtable>'

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        head = "<mfrac><mi>d</mi><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>" if rate else ""
        return f"{head}<mfrac><mrow><mo>∂</mo>{top}</mrow><mrow><mo>∂</mo>{variable}</mrow></mfrac>"

    def partial(self, variable: str, inner: str) -> str:
        return f"<mfrac><mo>∂</mo><mrow><mo>∂</mo>{variable}</mrow></mfrac>{inner}"

    def other(self, expr: Any) -> str:
        from sympy.printing.mathml import MathMLPresentationPrinter

        return str(MathMLPresentationPrinter().doprint(expr))


# ── Line breaks: before + and − outside brackets first, never inside a function or a fraction

# In plain text and in LaTeX, a line may end inside a bracket, since parentheses need not match within a line.

LINE_SYMBOLS = 88
"""Symbols per line of LaTeX, about 5 points each: the text width of A4 with margins of 20 mm."""

_MIN_BREAK_SHARE = 0.35  # share of a line; a later break inside brackets is preferred to an earlier one


def break_lines(text: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break a formula into lines, each at most ``width`` by ``measure`` if there are enough places to break."""
    breaks = _possible_breaks(text)
    cuts = [0, *(position for position, _ in breaks), len(text)]
    ends = [0.0, *accumulate(measure(text[a:b]) for a, b in pairwise(cuts))]
    lines, first = [], 0
    while ends[-1] - ends[first] > width and first < len(breaks):
        fitting = [k for k in range(first + 1, bisect_right(ends, ends[first] + width)) if k <= len(breaks)]
        preferred = [k for k in fitting if ends[k] - ends[first] >= _MIN_BREAK_SHARE * width]
        if preferred:
            last = min(preferred, key=lambda k: (breaks[k - 1][1], -k))
        else:
            last = fitting[-1] if fitting else first + 1
        lines.append(text[cuts[first] : cuts[last]].strip())
        first = last
    return [*lines, text[cuts[first] :].strip()]


def _possible_breaks(text: str) -> list[tuple[int, int]]:
    """Positions of possible line breaks, before plus and minus, with the number of open brackets."""
    breaks, brackets, braces = [], [], 0
    for k, character in enumerate(text):
        if character == "{":
            braces += 1
        elif character == "}":
            braces -= 1
        elif character == "(":
            before = text[max(0, k - 24) : k]
            brackets.append(re.search(r"(\\?[a-z]{3,}[⁰¹²³⁴-⁹]*|\\[a-z]+\^\{\d+\})$", before) is not None)
        elif character == ")" and brackets:
            brackets.pop()
        elif character == " " and not braces and not any(brackets) and text[k + 1 : k + 3] in ("+ ", "− ", "- "):
            breaks.append((k, len(brackets)))
    return breaks


_SYMBOL = re.compile(
    r"\\(?P<layout>t?frac|d?dot|mathit|mathrm|quad)|(?P<name>\\(?:sin|cos|tan))|\\[A-Za-z]+|[^\s{}^_\\]"
)


def latex_symbols(latex: str) -> int:
    """Number of symbols of a formula, including indices; a function name counts as three, a fraction bar as none."""
    count = 0
    for match in _SYMBOL.finditer(latex):
        if match["name"]:
            count += 3
        elif not match["layout"]:
            count += 1
    return count


# ── LaTeX and Markdown files

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
    first = remark.partition(" ")[0]
    return f"{remark[:1].upper()}{remark[1:]}." if first.isalpha() and len(first) > 1 else f"{remark}."


def remarks_of(equations: Equations) -> list[str]:
    """Sentences below the title: the check, if there is one, and the remarks."""
    check = getattr(equations, "check", None)
    sentence = [] if check is None else [f"{str(check)[0].upper()}{str(check)[1:]}."]
    return [*sentence, *equations.remarks]


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
    legend = "\n".join(
        f"${notation.symbol(name)}$ & {_latex_text(meaning)} \\\\" for name, meaning in _legend(equations)
    )
    table = f"\\begin{{tabular}}{{ll}}\n{legend}\n\\end{{tabular}}\n" if legend else ""
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
    if legend := _legend(equations):
        cells = ((notation.symbol(name), _markdown_text(meaning).replace("|", "\\|")) for name, meaning in legend)
        rows = [f"| ${symbol}$ | {meaning} |" for symbol, meaning in cells]
        parts.append("\n".join(["| symbol | meaning |", "|---|---|", *rows]))
    for step in steps:
        parts.append(f"## {heading(step)}\n\n{sentence(step.remark)}")
        parts.extend(f"$$\n\\begin{{aligned}} {line} \\end{{aligned}}\n$$" for line in _aligned_lines(step, notation))
    return "\n\n".join(parts) + "\n"


def _markdown_text(text: str) -> str:
    """Text without links and HTML elements."""
    return visible(text).replace("](", "]\\(").replace("<", "&lt;")


def _legend(equations: Equations) -> list[tuple[str, str]]:
    return [*equations.meanings, *((p.name, f"{p.meaning}: {printed(p.value)}") for p in equations.parameters)]


def _aligned_lines(step: Step, notation: Notation) -> list[str]:
    """Aligned ``left &= right`` for each line; long sums take several lines, long columns one line per entry."""
    room = _room(step.lines, notation)
    lines = [part for line in step.lines for part in _entries(line, room, notation)]
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
    return LINE_SYMBOLS - _MARGIN - max((latex_symbols(label.write(notation)) for label, _ in lines), default=0)


def _entries(line: Line, room: int, notation: Notation) -> list[Line]:
    """Column that is too wide, as three lines such as p_2x, p_2y and p_2z."""
    label, expr = line
    if not hasattr(expr, "shape") or max(latex_symbols(notation.write(x)) for x in expr) + _MARGIN <= room:
        return [line]
    return [(replace(label, name=f"{label.name}{axis}"), x) for axis, x in zip(_AXES, expr, strict=True)]


_PLAIN = {
    "Γ": "$\\Gamma$", "τ": "$\\tau$", "Σ": "$\\Sigma$", "ω": "$\\omega$", "½": "$\\tfrac12$", "∂": "$\\partial$", "−": "$-$",
    "·": "$\\cdot$", "≤": "$\\le$", "q̇": "$\\dot q$", "q̈": "$\\ddot q$", "²": "$^2$", "–": "--", "…": "\\dots{}",
    "_": "\\_", "%": "\\%", "&": "\\&", "#": "\\#", "$": "\\$", "{": "\\{", "}": "\\}", "^": "\\^{}", "~": "\\~{}",
    "\\": "\\textbackslash{}",
}  # fmt: skip
_SPECIAL = re.compile("|".join(re.escape(plain) for plain in sorted(_PLAIN, key=len, reverse=True)))


def _latex_text(text: str) -> str:
    """Names and sentences in LaTeX, with adjacent formulas joined."""
    return re.sub(r"(?<!\\)\$\$", "", _SPECIAL.sub(lambda match: _PLAIN[match.group()], text))


# ── Web page

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin-bottom: .4rem; } h2 { font-size: 1.15rem; margin: 1.8rem 0 .2rem; }
p.remark, p.check { margin: 0 0 .6rem; opacity: .75; }
nav a { margin-right: .9rem; white-space: nowrap; }
table.symbols { border-collapse: collapse; font-size: .92rem; margin: 1rem 0; }
table.symbols td { padding: .15rem 1rem .15rem 0; border-bottom: 1px solid #8883; vertical-align: baseline; }
table.symbols td:last-child { text-align: right; font-variant-numeric: tabular-nums; }
.line { margin: .45rem 0 .45rem 2.5rem; text-indent: -2.5rem; line-height: 1.9; }
math { text-indent: 0; font-size: 1.06rem; }
mtable.matrix { border: solid currentColor; border-width: 0 1.5px; padding: .1em .25em; margin: 0 .15em;
  background: linear-gradient(currentColor 0 0) 0 0, linear-gradient(currentColor 0 0) 100% 0,
    linear-gradient(currentColor 0 0) 0 100%, linear-gradient(currentColor 0 0) 100% 100%;
  background-size: .35em 1.5px; background-repeat: no-repeat; }
"""


def html_page(equations: Equations, steps: tuple[Step, ...]) -> str:
    """HTML page; sums are split at their terms, so that browsers break lines there."""
    notation = MathML()
    title = f"Equations of motion of {escape(equations.name)}"
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        *(f'<p class="check">{escape(text)}</p>' for text in remarks_of(equations)),
        "<nav>" + " ".join(f'<a href="#{s.name}">{escape(heading(s))}</a>' for s in steps) + "</nav>",
        _symbol_table(equations, notation),
    ]
    for step in steps:
        parts.append(
            f'<section id="{step.name}"><h2>{escape(heading(step))}</h2><p class="remark">{escape(sentence(step.remark))}</p>'
        )
        parts.extend(_line(label.write(notation), expr, notation) for label, expr in step.lines)
        parts.append("</section>")
    parts.append("</body></html>")
    return "\n".join(p for p in parts if p) + "\n"


def _symbol_table(equations: Equations, notation: MathML) -> str:
    rows = [(name, meaning, "") for name, meaning in equations.meanings]
    rows += [(p.name, p.meaning, f"{printed(p.value)}") for p in equations.parameters]
    cells = "".join(
        f"<tr><td><math>{notation.symbol(name)}</math></td><td>{escape(meaning)}</td><td>{value}</td></tr>"
        for name, meaning, value in rows
    )
    return f'<table class="symbols">{cells}</table>' if rows else ""


def _line(left: str, expr: Any, notation: MathML) -> str:
    if not getattr(expr, "is_Add", False):
        return f'<div class="line"><math>{left}<mo>=</mo>{notation.write(expr)}</math></div>'
    (first_sign, first), *others = notation.terms(expr)
    if first_sign == "-":
        first = notation.minus(first)
    pieces = [f"<math>{left}<mo>=</mo>{first}</math>"]
    pieces += [f'<math><mo form="infix">{notation.operator(sign)}</mo>{term}</math>' for sign, term in others]
    return f'<div class="line">{" ".join(pieces)}</div>'
