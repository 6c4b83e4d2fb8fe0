"""Line breaks of long sums: before + and − outside brackets first, never inside a function or a fraction.

In plain text and in LaTeX, a line may end inside a bracket, since parentheses need not match within a line.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise

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
        end = min(bisect_right(ends, ends[first] + width), len(breaks) + 1)
        last = max(first + 1, end - 1)
        preferred = [k for k in range(first + 1, end) if ends[k] - ends[first] >= _MIN_BREAK_SHARE * width]
        if preferred:
            last = min(preferred, key=lambda k: (breaks[k - 1][1], -k))
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
