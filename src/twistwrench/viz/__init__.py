"""Pictures of a robot: a page in one file, films, and plots of a motion. docs/viewer.md shows each."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from .drawn_motion import DrawnMotion, motion_of, read_motion
from .movie import Camera, film, movie
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
    "write_page",
]

if TYPE_CHECKING:
    from ..plotting.motion import Energies, energies, plot_phase, plot_power, plot_split
    from ..plotting.robot import draw

_DRAWN = dict.fromkeys(("Energies", "energies", "plot_phase", "plot_power", "plot_split"), "motion") | {"draw": "robot"}
"""Where pictures are drawn: ``plotting`` imports what is here, so it is imported when first asked for."""


def __getattr__(name: str) -> object:
    if name in _DRAWN:
        return getattr(importlib.import_module(f"..plotting.{_DRAWN[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
