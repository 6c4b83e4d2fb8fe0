"""Formulas as HTML, which every browser draws without a network: letters, indices, powers, dots."""

from __future__ import annotations

import re

_TOKEN = re.compile(
    r"([_^])(?:\{((?:[^{}]|\{[^{}]*\})*)\}|(\w+))|(Ad|ad|diag|rank|sign)|([A-Za-zτθω])([\u0307\u0308]?)"
)
_DOTS = {"\u0307": "dot", "\u0308": "ddot"}


def formula_html(text: str) -> str:
    """HTML of a formula: ``_i``, ``_{i+1}`` and ``^T`` are indices and powers, θ̇ and θ̈ have their dots.

    >>> formula_html("F_b = [ad_{V_b}]^T P")
    '<i>F</i><sub>b</sub> = [ad<sub><i>V</i><sub>b</sub></sub>]<sup>T</sup> <i>P</i>'
    """
    return _TOKEN.sub(_html, text)


def _html(token: re.Match[str]) -> str:
    script, braced, plain, word, letter, dots = token.groups()
    if script:
        inside = plain if braced is None else formula_html(braced) if "_" in braced else braced
        tag = "sub" if script == "_" else "sup"
        return f"<{tag}>{inside}</{tag}>"
    if word:
        return word
    return f'<i class="{_DOTS[dots]}">{letter}</i>' if dots else f"<i>{letter}</i>"
