"""Derivations as a web page that needs nothing else: no network, no scripts; formulas are MathML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from ..core.printed_numbers import printed
from .documents import heading, remarks_of, sentence
from .mathml import MathML

if TYPE_CHECKING:
    from .equations import Equations, Step

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
    """The page. Sums are cut at their terms, so that browsers break lines there."""
    notation = MathML()
    title = f"Equations of motion of {escape(equations.name)}"
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        *(f'<p class="check">{escape(text)}</p>' for text in remarks_of(equations)),
        "<nav>" + " ".join(f'<a href="#{s.name}">{escape(heading(s))}</a>' for s in steps) + "</nav>",
        _symbols(equations, notation),
    ]
    for step in steps:
        parts.append(
            f'<section id="{step.name}"><h2>{escape(heading(step))}</h2><p class="remark">{escape(sentence(step.remark))}</p>'
        )
        parts.extend(_line(label.write(notation), expr, notation) for label, expr in step.lines)
        parts.append("</section>")
    parts.append("</body></html>")
    return "\n".join(p for p in parts if p) + "\n"


def _symbols(equations: Equations, notation: MathML) -> str:
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
    first, *rest = notation.terms(expr)
    pieces = [f"<math>{left}<mo>=</mo>{notation.minus(first[1]) if first[0] == '-' else first[1]}</math>"]
    pieces += [f'<math><mo form="infix">{notation.operator(sign)}</mo>{term}</math>' for sign, term in rest]
    return f'<div class="line">{" ".join(pieces)}</div>'
