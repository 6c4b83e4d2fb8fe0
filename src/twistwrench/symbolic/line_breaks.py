"""Long sums over several lines: broken before + and −, those outside brackets first, never inside a function or a fraction.

Parentheses need no partner in their line, in plain text as in LaTeX, so a line may end inside a bracket.
"""

from __future__ import annotations

import re
import unicodedata
from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise

TEXT_WIDTH = 460.0
"""Points that a line of LaTeX may take: 95 % of the text width of A4 with margins of 20 mm."""

_EARLIEST = 0.35  # share of a line before which no break is better than a later one inside brackets


def broken(text: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """The lines of a formula, each at most ``width`` by ``measure`` where there are places to break it."""
    places = _places(text)
    cuts = [0, *(at for at, _ in places), len(text)]
    ends = [0.0, *accumulate(measure(text[a:b]) for a, b in pairwise(cuts))]
    lines, first = [], 0
    while ends[-1] - ends[first] > width and first < len(places):
        most = ends[first] + width
        fitting = [k for k in range(first + 1, bisect_right(ends, most)) if k <= len(places)]
        late = [k for k in fitting if ends[k] - ends[first] >= _EARLIEST * width]
        if late:
            last = min(late, key=lambda k: (places[k - 1][1], -k))
        else:
            last = fitting[-1] if fitting else first + 1
        lines.append(text[cuts[first] : cuts[last]].strip())
        first = last
    return [*lines, text[cuts[first] :].strip()]


def _places(text: str) -> list[tuple[int, int]]:
    """Where a line may end, before plus and minus, and how many brackets are open there."""
    found, brackets, braces = [], [], 0
    for k, character in enumerate(text):
        if character == "{":
            braces += 1
        elif character == "}":
            braces -= 1
        elif character == "(":
            brackets.append(
                re.search(r"(\\?[a-z]{3,}[⁰¹²³⁴-⁹]*|\\[a-z]+\^\{\d+\})$", text[max(0, k - 24) : k]) is not None
            )
        elif character == ")" and brackets:
            brackets.pop()
        elif character == " " and not braces and not any(brackets) and text[k + 1 : k + 3] in ("+ ", "− ", "- "):
            found.append((k, len(brackets)))
    return found


def text_width(text: str) -> float:
    """Columns of a terminal: dots over letters take none."""
    return sum(not unicodedata.combining(character) for character in text)


_TOKEN = re.compile(
    r"(?P<fraction>\\t?frac)|(?P<accent>\\d?dot)|(?P<script>[_^])|(?P<space>\\[,;]|\\quad)|(?P<name>\\(?:sin|cos|tan))"
    r"|(?P<big>\\(?:mathit|mathrm))|(?P<command>\\[A-Za-z]+)|(?P<operator> [+-] )|(?P<group>[{}])|(?P<blank>\s)|(?P<other>.)",
    re.DOTALL,
)
_SPACES = {"\\,": 1.7, "\\;": 2.8, "\\quad": 10.0}
_GREEK = {"omega": 6.6, "Omega": 7.3, "Gamma": 6.3, "tau": 5.1, "partial": 5.9, "cdot": 7.3}


def latex_width(latex: str) -> float:
    """About how wide a formula is in points, in Computer Modern at 10 pt; rather too much than too little."""
    return _measured(latex, 0, 1.0)[0]


def _measured(latex: str, at: int, size: float) -> tuple[float, int]:
    """Width up to the end of the group, and where that is."""
    total = 0.0
    while at < len(latex):
        if latex[at] == "}":
            return total, at + 1
        width, at = _atom(latex, at, size)
        total += width
    return total, at


def _atom(latex: str, at: int, size: float) -> tuple[float, int]:
    found = _TOKEN.match(latex, at)
    assert found is not None  # the last alternative is any character
    kind, token, at = found.lastgroup, found.group(), found.end()
    if token == "{":
        return _measured(latex, at, size)
    if kind == "fraction":
        small = size * (0.7 if token == "\\tfrac" else 1.0)
        (top, at), (bottom, at) = _argument(latex, at, small), (0.0, at)
        bottom, at = _argument(latex, at, small)
        return max(top, bottom) + 2.4, at
    if kind == "script":
        width, at = _argument(latex, at, 0.7 * size)
        return width + 0.5, at
    if kind in ("accent", "big"):
        return _argument(latex, at, size)
    if kind == "space":
        return _SPACES[token] * size, at
    if kind == "name":
        return 15.5 * size, at  # and a thin space
    if kind == "command":
        return _GREEK.get(token[1:], 5.8) * size, at
    if kind == "operator":
        return (12.3 if size == 1.0 else 7.8) * size, at
    return (0.0 if kind == "blank" else _letter(token)) * size, at


def _argument(latex: str, at: int, size: float) -> tuple[float, int]:
    """Of the one group or character that a command takes."""
    while at < len(latex) and latex[at] == " ":
        at += 1
    return _atom(latex, at, size) if at < len(latex) else (0.0, at)


def _letter(character: str) -> float:
    if character in "-=+":
        return 7.8
    if character in "().,|!":
        return 3.9
    if character in "mwMW":
        return 9.7 if character in "MW" else 8.8
    return 5.1 if character.isdigit() or character in "ijlrst" else 7.9 if character.isupper() else 5.9
