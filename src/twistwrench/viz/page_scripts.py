"""Scripts and style sheets of pages, shortened, and the policy that allows these scripts alone."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any

from .colours import quantity_colours

_SCRIPTS_OF_ALL_PAGES = (
    "decimals.js", "numbers.js", "matrices.js", "coordinates.js", "forces.js", "factors.js", "effective_mass.js",
    "mechanics.js", "fall.js", "floor.js", "solids.js", "orbit.js", "sharpness.js", "stage.js", "sticks.js", "grasp.js",
    "grab.js", "drives.js", "address.js", "share.js", "compact.js", "panel.js", "load.js", "scales.js",
)  # fmt: skip
_SCRIPTS_BY_ENTRY = {
    "motion": ("motion.js", "verdict.js", "strip.js"),
    "book": ("readouts.js", "tip_readouts.js", "article/near_misses.js", "exercises.js", "book.js"),
    "limbs": ("fold.js",),
    "loops": ("loops.js",),
    "standing": ("standing.js",),
    "layer": ("layer.js",),
}
"""Scripts that a page includes only if the entry of its header with this key is not empty."""
POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src 'unsafe-inline'; script-src"
"""Content-Security-Policy of the page without the digests of its scripts: no requests, no other scripts."""
_STYLE_REPLACEMENTS = (("; }", "}"), (" { ", "{"), ("; ", ";"), (": ", ":"), (", ", ","))
"""Replacements that shorten a style sheet: text, shorter text."""
_STRICT_MODE = '"use strict";'
_COMMENT = re.compile(r"^(.*?)(?:^|\s)//(?:\s.*)?$")
"""Line with ``//`` at its start or after a space; group 1 is the text before the slashes."""


def script_names(data: Mapping[str, Any]) -> list[str]:
    """Files of the player that a page with this header needs."""
    names = list(_SCRIPTS_OF_ALL_PAGES)
    for key, names_of_entry in _SCRIPTS_BY_ENTRY.items():
        if data[key]:
            names += names_of_entry
    return [*names, "page.js"]


def page_style(*, section: bool) -> str:
    """Style sheet of a page; pages of a book's sections also have a drawing and colours of quantities."""
    player = resources.files(__package__) / "player"
    style = (player / "page.css").read_text("utf-8")
    if section:
        style += (player / "opening.css").read_text("utf-8")
    for text, shorter_text in _STYLE_REPLACEMENTS:
        style = style.replace(text, shorter_text)
    if section:
        style = quantity_colours() + style
    return style


def joined_script(names: Iterable[str]) -> str:
    """Script in strict mode from files of the player, without indentation, empty lines and comments."""
    player = resources.files(__package__) / "player"
    script_lines = [_STRICT_MODE]
    for name in names:
        for line in (player / name).read_text("utf-8").splitlines():
            code = _COMMENT.sub(_without_comment, line).strip()
            if code and code != _STRICT_MODE:  # which stands once, in the first line
                script_lines.append(code)
    return "\n".join(script_lines)


def _without_comment(match: re.Match[str]) -> str:
    """Code before the slashes; the whole line if the slashes are within a text, after an odd number of quotation marks."""
    code = match[1]
    is_outside_text = all(code.count(quote) % 2 == 0 for quote in "\"'`")
    return code if is_outside_text else match[0]
