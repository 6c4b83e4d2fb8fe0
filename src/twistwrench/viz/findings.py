"""The doctor's findings on the robot itself: links in the colours of what was found, ellipsoids before and after."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ModelWarning
from ..robot import Robot
from .page import write_page
from .scene import Scene, Shape, scene_of
from .skeleton import equal_inertia_ellipsoid
from .visuals import Colour

if TYPE_CHECKING:
    from ..diagnosis import DoctorReport

_COLOURS: dict[str, Colour] = {"error": (0.84, 0.20, 0.16), "warning": (0.90, 0.60, 0.0), "note": (0.95, 0.90, 0.55)}
_BEFORE: Colour = (0.84, 0.37, 0.0)
_AFTER: Colour = (0.0, 0.45, 0.70)
_NOTES = 40


def findings_scene(report: DoctorReport) -> Scene:
    """Scene of a robot with what the doctor found: bodies in the colour of their worst finding, notes in words.

    Parameters
    ----------
    report : DoctorReport

    Returns
    -------
    scene : Scene
        Ellipsoids of inertia are drawn for the links that are repaired, orange as in the file and blue as repaired.

    Examples
    --------
    >>> import twistwrench as tw
    >>> findings_scene(tw.doctor(tw.robots.path_of("ur5"))).robot.name
    'ur5'
    """
    model = report.subject.robot.model
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        scene = scene_of(Robot(model))
    colours: dict[int, Colour] = {}
    ellipsoids: list[Shape] = []
    for finding in report.findings:
        named = [link for link in model.frames if f"{link!r}" in finding.where]
        for link in named if finding.where.startswith("link") else []:
            colours.setdefault(model.frames[link].body, _COLOURS[finding.severity])
        for link, after in finding.repair.inertias.items() if finding.repair is not None else ():
            frame = model.frames[link]
            for inertia, colour in ((model.link_inertias[link], _BEFORE), (after, _AFTER)):
                solid = equal_inertia_ellipsoid(inertia) if inertia.mass > 0 else []
                ellipsoids += [Shape(frame.body, s, np.array(frame.pose), colour, "inertia") for s in solid]
    kept = [s for s in scene.shapes if s.layer != "inertia"]
    shapes = [replace(s, colour=colours.get(s.body, s.colour)) for s in kept]
    notes = [f"{finding}. Effect: {finding.effect}." for finding in report.findings[:_NOTES]]
    return replace(scene, shapes=(*shapes, *ellipsoids), remarks=(*notes, *scene.remarks))


def write_findings_page(report: DoctorReport, path: str | Path) -> Path:
    """Write a page with the robot, its links in the colours of what the doctor found; it needs nothing but a browser.

    Parameters
    ----------
    report : DoctorReport
    path : str or Path, .html

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    ValueRangeError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_findings_page(tw.doctor(tw.robots.path_of("ur5")), f"{folder}/ur5.html").suffix
    '.html'
    """
    scene = findings_scene(report)
    return write_page(scene.robot, path, scene=scene)
