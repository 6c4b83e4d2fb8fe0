"""Pictures of a robot: a self-contained page, films, and plots of a motion. docs/viewer.md shows each."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from ..reports.drawn_motion import DrawnMotion, motion_of, read_motion
from .article import write_article
from .movie import Camera, draw, film, movie
from .page import write_page
from .scene import Scene, Shape, scene_of

__all__ = [
    "Camera",
    "DrawnMotion",
    "Energies",
    "Scene",
    "Shape",
    "draw",
    "energies",
    "film",
    "motion_of",
    "movie",
    "plot_phase",
    "plot_power",
    "plot_split",
    "read_motion",
    "scene_of",
    "write_article",
    "write_page",
]

if TYPE_CHECKING:
    from . import style as style
    from .plots.motion import Energies, energies, plot_phase, plot_power, plot_split

_PLOTS = ("Energies", "energies", "plot_phase", "plot_power", "plot_split")
"""Names of ``viz.plots.motion``, imported at first use because that module imports this package."""


def __getattr__(name: str) -> object:
    if name == "style":
        return importlib.import_module(".style", __name__)
    if name in _PLOTS:
        return getattr(importlib.import_module(".plots.motion", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
