"""Colours of terminal, pages, plots and pictures: each has one meaning on every surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from .verdict import Word

__all__ = ["COLOURS", "NEAR_LIMIT", "Colour", "Style", "page_colours", "strong", "terminal_style", "word_style"]

NEAR_LIMIT = 0.8
"""Share of a limit above which a joint is near it."""


class Style(StrEnum):
    """Meaning of a colour. A word or a bar beside it says the same."""

    OVER = "over"
    """Beyond a limit, fault, contradiction, collision."""
    NEAR = "near"
    """From 80 % of a limit to the limit; unsure; warning."""
    GOOD = "good"
    """Judged, and within the limits."""
    POINTED = "pointed"
    """Joint or link that a sentence names."""
    QUIET = "quiet"
    """Not judged, without a limit, remark."""
    STRONG = "strong"
    """Emphasis without a colour."""


@dataclass(frozen=True)
class Colour:
    """One colour on each surface."""

    name: str
    """Name in captions."""
    terminal: str
    """Name of a colour or attribute of ANSI terminals."""
    light: str
    """Text on light pages."""
    dark: str
    """Text on dark pages."""
    plot: str
    """Lines of plots."""
    scene: tuple[float, float, float]
    """Red, green, blue from 0 to 1 of links in pictures and in the viewer."""


COLOURS: Mapping[Style, Colour] = MappingProxyType(
    {
        Style.OVER: Colour("red", "red", "#b5301f", "#ff8a7a", "#c0392b", (0.84, 0.20, 0.16)),
        Style.NEAR: Colour("amber", "yellow", "#8a4b08", "#f0b46a", "#c98500", (0.93, 0.72, 0.13)),
        Style.GOOD: Colour("green", "green", "#14703f", "#6fd39b", "#009e73", (0.30, 0.72, 0.60)),
        Style.POINTED: Colour("blue", "bright_blue", "#1f5fa8", "#8fc2f5", "#0072b2", (0.16, 0.50, 0.85)),
        Style.QUIET: Colour("grey", "dim", "#5b6672", "#a3afbc", "#6b7079", (0.45, 0.52, 0.62)),
    }
)
"""Colours that carry a meaning; on white and on dark paper their text has a contrast of at least 4.5 : 1."""


def strong(style: Style) -> str:
    """Emphasised style of a piece of text.

    Examples
    --------
    >>> strong(Style.OVER)
    'strong over'
    """
    return f"{Style.STRONG} {style}"


def word_style(word: str) -> str:
    """Style of a verdict's word; DONE has no colour, as nothing was judged.

    Examples
    --------
    >>> word_style("OK"), word_style("UNSURE"), word_style("OVER LIMIT"), word_style("DONE")
    ('strong good', 'strong near', 'strong over', 'strong')
    """
    if word == Word.DONE:
        return str(Style.STRONG)
    if word == Word.OK:
        return strong(Style.GOOD)
    return strong(Style.NEAR if word in (Word.UNSURE, Word.CONTACT) else Style.OVER)


def terminal_style(names: str) -> str:
    """Style of the terminal for the style of a piece of text.

    Examples
    --------
    >>> terminal_style("strong over")
    'bold red'
    """
    return " ".join("bold" if name == Style.STRONG else COLOURS[Style(name)].terminal for name in names.split())


def page_colours() -> str:
    """Style sheet with the colours as variables of a page, on light and on dark screens.

    Examples
    --------
    >>> page_colours().split(";")[0]
    ':root { --over: #b5301f'
    """
    light = " ".join(f"--{style}: {colour.light};" for style, colour in COLOURS.items())
    dark = " ".join(f"--{style}: {colour.dark};" for style, colour in COLOURS.items())
    return f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ @media screen {{ :root {{ {dark} }} }} }}\n"
