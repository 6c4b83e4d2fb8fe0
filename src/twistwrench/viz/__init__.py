"""Pictures of a robot: a self-contained page, films, and plots of a motion. docs/viewer.md shows each."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from ..reports.drawn_motion import DrawnMotion, motion_of, read_motion
from .article import write_article
from .movie import film, movie
from .page import write_page
from .plots.robot_picture import Camera, draw
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
    "plot_mounting",
    "plot_phase",
    "plot_power",
    "plot_split",
    "plot_support",
    "read_motion",
    "scene_of",
    "write_article",
    "write_page",
]

if TYPE_CHECKING:
    from . import style as style
    from .plots.holds import plot_mounting, plot_support
    from .plots.motion import Energies, energies, plot_phase, plot_power, plot_split

_PLOTS = {
    **dict.fromkeys(("Energies", "energies", "plot_phase", "plot_power", "plot_split"), ".plots.motion"),
    **dict.fromkeys(("plot_mounting", "plot_support"), ".plots.holds"),
}
"""Names of modules that are imported at first use because they import this package."""


def __getattr__(name: str) -> object:
    if name == "style":
        return importlib.import_module(".style", __name__)
    if name in _PLOTS:
        return getattr(importlib.import_module(_PLOTS[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
