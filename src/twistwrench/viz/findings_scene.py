"""Scene of the doctor's findings on a robot: bodies in the colour of their worst finding, and inertias before and after."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.colours import COLOURS, Style
from ..core.errors import ModelWarning
from ..robot import Robot
from ..shapes.surface import Colour
from .scene import Scene, Shape, equal_inertia_ellipsoid, scene_of

if TYPE_CHECKING:
    from ..diagnosis import DoctorReport
    from ..mechanics.bodies.inertia import SpatialInertia
    from ..mechanics.model.model import Frame

_STYLES = {"error": Style.OVER, "warning": Style.NEAR, "note": Style.QUIET}
"""Style of a finding, by severity."""
_WRITTEN_INERTIA: Colour = (0.84, 0.37, 0.0)
"""Colour of the ellipsoid of an inertia before its repair, as red, green, blue from 0 to 1."""
_REPAIRED_INERTIA: Colour = (0.0, 0.45, 0.70)
"""Colour of the ellipsoid of a repaired inertia."""
_MAX_NOTES = 40
"""Largest number of findings that the notes name."""


def findings_scene(report: DoctorReport) -> Scene:
    """Scene of a robot with findings of the doctor: bodies in the colour of their worst finding, with notes."""
    model = report.contents.robot.model
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        scene = scene_of(Robot(model))
    colours = _body_colours(report)
    visuals = [shape for shape in scene.shapes if shape.layer != "inertia"]
    shapes = [replace(shape, colour=colours.get(shape.body, shape.colour)) for shape in visuals]
    for finding in report.findings:
        if finding.repair is None:
            continue
        for link, repaired_inertia in finding.repair.inertias.items():
            frame = model.frames[link]
            shapes += _inertia_shapes(frame, model.link_inertias[link], _WRITTEN_INERTIA)
            shapes += _inertia_shapes(frame, repaired_inertia, _REPAIRED_INERTIA)
    notes = [f"{finding}. Effect: {finding.effect}." for finding in report.findings[:_MAX_NOTES]]
    return replace(scene, shapes=tuple(shapes), remarks=(*notes, *scene.remarks))


def _body_colours(report: DoctorReport) -> dict[int, Colour]:
    """Colour of the worst finding on the links of a body, by number of the body."""
    colours: dict[int, Colour] = {}
    for finding in report.findings:
        if not finding.where.startswith("link"):
            continue
        for link, frame in report.contents.robot.model.frames.items():
            if f"{link!r}" in finding.where:
                style = _STYLES[finding.severity]
                colours.setdefault(frame.body, COLOURS[style].scene)  # findings are sorted, worst first
    return colours


def _inertia_shapes(frame: Frame, inertia: SpatialInertia, colour: Colour) -> list[Shape]:
    """Ellipsoid of an inertia in a frame, as a list; empty without mass."""
    pose = np.array(frame.pose)
    return [Shape(frame.body, solid, pose, colour, "inertia") for solid in equal_inertia_ellipsoid(inertia)]
