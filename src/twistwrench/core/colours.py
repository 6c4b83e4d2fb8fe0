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
    """Meaning of a colour. A word or a bar beside the colour says the same."""

    OVER = "over"
    """Value beyond a limit, fault, contradiction or collision."""
    NEAR = "near"
    """Value from 80 % of a limit to the limit, unsure verdict or warning."""
    GOOD = "good"
    """Judged, and within the limits."""
    POINTED = "pointed"
    """Joint or link that a sentence names."""
    QUIET = "quiet"
    """Value that was not judged or has no limit; remark."""
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
    """Colour of text on light pages, as #rrggbb."""
    dark: str
    """Colour of text on dark pages, as #rrggbb."""
    plot: str
    """Colour of lines in plots, as #rrggbb."""
    scene: tuple[float, float, float]
    """Colour of links in pictures and in the viewer: red, green and blue from 0 to 1."""


COLOURS: Mapping[Style, Colour] = MappingProxyType(
    {  # name, terminal, light, dark, plot, scene
        Style.OVER: Colour("red", "red", "#b5301f", "#ff8a7a", "#c0392b", (0.84, 0.20, 0.16)),
        Style.NEAR: Colour("amber", "yellow", "#8a4b08", "#f0b46a", "#c98500", (0.93, 0.72, 0.13)),
        Style.GOOD: Colour("green", "green", "#14703f", "#6fd39b", "#009e73", (0.30, 0.72, 0.60)),
        Style.POINTED: Colour("blue", "bright_blue", "#1f5fa8", "#8fc2f5", "#0072b2", (0.16, 0.50, 0.85)),
        Style.QUIET: Colour("grey", "dim", "#5b6672", "#a3afbc", "#6b7079", (0.45, 0.52, 0.62)),
    }
)
"""Colour of each meaning. Coloured text has a contrast of at least 4.5 : 1 on light and on dark pages."""


def strong(style: Style) -> str:
    """Emphasised style of a piece of text, as names separated by a space.

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
    if word in (Word.UNSURE, Word.CONTACT):
        return strong(Style.NEAR)
    return strong(Style.OVER)


def terminal_style(names: str) -> str:
    """Names of the terminal's colours and attributes for the style of a piece of text.

    Examples
    --------
    >>> terminal_style("strong over")
    'bold red'
    """
    terminal_names = []
    for name in names.split():
        terminal_name = "bold"
        if name != Style.STRONG:
            terminal_name = COLOURS[Style(name)].terminal
        terminal_names.append(terminal_name)
    return " ".join(terminal_names)


def page_colours() -> str:
    """Style sheet that defines the colours as variables, for light and for dark screens.

    Prints have the light colours, since paper is white.

    Examples
    --------
    >>> page_colours().split(";")[0]
    ':root { --over: #b5301f'
    """
    light = " ".join(f"--{style}: {colour.light};" for style, colour in COLOURS.items())
    dark = " ".join(f"--{style}: {colour.dark};" for style, colour in COLOURS.items())
    light_rule = f":root {{ {light} }}"
    dark_rule = f":root {{ {dark} }}"
    return f"{light_rule}\n@media (prefers-color-scheme: dark) {{ @media screen {{ {dark_rule} }} }}\n"
