"""Scripts and style sheets of pages, shortened, and the policy that allows these scripts alone."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any

from .colours import quantity_colours

_SCRIPTS = (
    "decimals.js", "numbers.js", "matrices.js", "coordinates.js", "forces.js", "factors.js", "effective_mass.js",
    "mechanics.js", "fall.js", "floor.js", "solids.js", "orbit.js", "sharpness.js", "stage.js", "sticks.js", "grasp.js",
    "grab.js", "drives.js", "address.js", "share.js", "compact.js", "panel.js", "load.js", "scales.js",
)  # fmt: skip
_SCRIPTS_OF = {
    "motion": ("motion.js", "verdict.js", "strip.js"),
    "book": ("readouts.js", "tip_readouts.js", "article/near_misses.js", "exercises.js", "book.js"),
    "limbs": ("fold.js",),
    "loops": ("loops.js",),
    "standing": ("standing.js",),
    "layer": ("layer.js",),
}
"""Scripts that a page includes only if its header has the entry."""
POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src 'unsafe-inline'; script-src"
"""Content-Security-Policy of the page without the digests of its scripts: no requests, no other scripts."""
_NARROWER_STYLE = (("; }", "}"), (" { ", "{"), ("; ", ";"), (": ", ":"), (", ", ","))
"""Replacements that shorten a style sheet."""
_STRICT = '"use strict";'
_COMMENT = re.compile(r"^(.*?)(?:^|\s)//(?:\s.*)?$")
"""Line with a comment after a space or at its start."""


def script_names(data: Mapping[str, Any]) -> list[str]:
    """Files of the player that a page with this header needs."""
    names = list(_SCRIPTS)
    for key, more_names in _SCRIPTS_OF.items():
        if data[key]:
            names += more_names
    return [*names, "page.js"]


def page_style(*, section: bool) -> str:
    """Style sheet of a page; that of a section has its drawing as well."""
    parts = resources.files(__package__) / "player"
    style = (parts / "page.css").read_text("utf-8")
    if section:
        style += (parts / "opening.css").read_text("utf-8")
    for wide, narrow in _NARROWER_STYLE:
        style = style.replace(wide, narrow)
    return quantity_colours() + style if section else style


def joined_script(names: Iterable[str]) -> str:
    """One strict script of files of the player, without comments that end a line, and without indentation."""
    parts = resources.files(__package__) / "player"
    script = [_STRICT]
    for name in names:
        for line in (parts / name).read_text("utf-8").splitlines():
            code = _COMMENT.sub(_code_before, line).strip()
            if code and code != _STRICT:
                script.append(code)
    return "\n".join(script)


def _code_before(line: re.Match[str]) -> str:
    """Code before the comment, or the line where the slashes are within a text."""
    code = line[1]
    if all(code.count(quote) % 2 == 0 for quote in "\"'`"):
        return code
    return line[0]
