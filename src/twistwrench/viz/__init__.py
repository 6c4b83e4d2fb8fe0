"""Seeing a robot: a live page, a page in one file, films, and pictures of a motion. docs/viewer.md shows each."""

from __future__ import annotations

from .camera import Camera
from .live import LiveView
from .motion import Motion, motion_of, read_motion
from .movie import film, movie
from .page import write_page
from .plots import Energies, energies, plot_phase, plot_power, plot_split
from .scene import Scene, Shape, scene_of
from .stage import draw

__all__ = [
    "Camera",
    "Energies",
    "LiveView",
    "Motion",
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
