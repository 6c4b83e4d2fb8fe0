"""Line breaks of long sums: before + and −, outside brackets if possible, never inside a function or a fraction.

In plain text and in LaTeX, a line may end inside a bracket, since parentheses need not match within a line.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise

LINE_SYMBOLS = 88
"""Number of symbols in a line of LaTeX, about 5 points each: the text width of A4 with margins of 20 mm."""

_MIN_BREAK_SHARE = 0.35
"""Least length of a line that ends at a preferred break, as a share of the width; shorter lines are made only if needed."""
_MAX_FUNCTION_LENGTH = 24
"""Largest number of characters of a function's name before its bracket."""


def break_lines(text: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break a formula into lines, each at most ``width`` by ``measure`` if there are enough places to break."""
    breaks = _possible_breaks(text)
    depths = [depth for _, depth in breaks]
    # The text is cut at its begin, at all breaks, and at its end; cut k is break k - 1.
    cuts = [0, *(position for position, _ in breaks), len(text)]  # positions in the text
    piece_widths = [measure(text[begin:end]) for begin, end in pairwise(cuts)]
    widths_to_cuts = [0.0, *accumulate(piece_widths)]
    lines = []
    first_cut = 0  # of the line
    while widths_to_cuts[-1] - widths_to_cuts[first_cut] > width and first_cut < len(breaks):
        max_width = widths_to_cuts[first_cut] + width
        stop = min(bisect_right(widths_to_cuts, max_width), len(breaks) + 1)  # first cut beyond the line
        last_cut = max(first_cut + 1, stop - 1)
        min_width = _MIN_BREAK_SHARE * width
        preferred_cuts = [
            k for k in range(first_cut + 1, stop) if widths_to_cuts[k] - widths_to_cuts[first_cut] >= min_width
        ]
        if preferred_cuts:  # fewest open brackets, then the longest line
            last_cut = min(preferred_cuts, key=lambda k: (depths[k - 1], -k))
        lines.append(text[cuts[first_cut] : cuts[last_cut]].strip())
        first_cut = last_cut
    return [*lines, text[cuts[first_cut] :].strip()]


def _possible_breaks(text: str) -> list[tuple[int, int]]:
    """Positions of possible line breaks, before plus and minus, each with the number of open brackets."""
    breaks = []
    open_brackets: list[bool] = []  # True for the bracket of a function's argument
    open_braces = 0
    for k, character in enumerate(text):
        if character == "{":
            open_braces += 1
        elif character == "}":
            open_braces -= 1
        elif character == "(":
            text_before = text[max(0, k - _MAX_FUNCTION_LENGTH) : k]
            function = re.search(
                r"(\\?[a-z]{3,}[⁰¹²³⁴-⁹]*|\\[a-z]+\^\{\d+\})$", text_before
            )  # such as sin² or \sin^{2}
            open_brackets.append(function is not None)
        elif character == ")" and open_brackets:
            open_brackets.pop()
        elif text[k : k + 3] in (" + ", " − ", " - ") and not open_braces and not any(open_brackets):
            breaks.append((k, len(open_brackets)))
    return breaks


# Layout commands have no width; other commands are one symbol; braces and indices are not symbols.
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
