"""Results drawn over the robot of a page: contact forces along a motion, and errors before and after a calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..calibration.result import CalibratedRobot
from ..core.answers.data import plain
from ..core.colours import COLOURS, Style
from ..core.numbers import number
from ..core.typing import Array
from ..reports.support.ground_support import GroundSupport
from ..reports.support.judgement import ground_words
from ..statics.contacts import contact_maps
from .colours import COLOURS as MARKS
from .colours import SEQUENTIAL

_MILLI = 1e3
"""Millimetres in a metre."""
_ERROR_SCALE = 100
"""Ratio of an arrow's length to the error that it shows."""
_MAX_FORCE_LENGTH = 0.35
"""Length of the largest contact force, as a share of the robot's size."""
Put = Callable[[Any, str], dict[str, Any]]
"""Function that stores an array of a kind and returns its header entry."""


@dataclass(frozen=True, eq=False)
class ArrowGroup:
    """Arrows of one meaning, at fixed places or along a motion."""

    name: str
    points: Array
    """Starting points of the arrows, (c, 3), or (n, c, 3) along a motion [m]."""
    along: Array
    """Vectors of the arrows, of the same shape; drawn at this length unless the layer sets ``longest``."""
    colour: tuple[float, float, float]
    shares: Array | None = None
    """Share (n, c) of the friction cone or of the largest push; from 80 % on it sets the colour. None without limits."""

    def data(self, put: Put, scale: float) -> dict[str, Any]:
        """Header entry, with arrows whose length is multiplied by ``scale``."""
        data = {
            "name": self.name,
            "colour": self.colour,
            "count": self.points.shape[-2],
            "points": put(self.points, "f4"),
            "along": put(scale * self.along, "f4"),
            "shares": None,
        }
        if self.shares is not None:
            data["shares"] = put(self.shares, "f4")
        return data


@dataclass(frozen=True, eq=False)
class ColouredPoints:
    """Points coloured by a quantity, in equal steps from its smallest to its largest value."""

    name: str
    unit: str
    points: Array
    """(n, 3) [m]."""
    values: Array
    """(n,) in the unit."""

    def data(self, put: Put) -> dict[str, Any]:
        """Header entry."""
        min_value = float(self.values.min())
        max_value = float(self.values.max())
        inner_edges = np.linspace(min_value, max_value, len(SEQUENTIAL) + 1)[1:-1]
        return {
            "name": f"{self.name}, {number(min_value, 2)} to {number(max_value, 2)} {self.unit}",
            "points": put(self.points, "f4"),
            "steps": put(np.digitize(self.values, inner_edges), "u2"),
            "colours": SEQUENTIAL,
        }


@dataclass(frozen=True, eq=False)
class PageLayer:
    """Result drawn over the robot."""

    label: str
    """Name of its switch."""
    told: str
    """Explanation beside the switch."""
    groups: tuple[ArrowGroup, ...]
    longest: float = 0.0
    """Length of the largest arrow as a share of the robot's size; 0: arrows have their own length."""
    time: Array | None = None
    """(n,) times of a motion [s]; None without a motion."""
    workspace: ColouredPoints | None = None
    """Quantity over the positions of the tip; None if the result has none."""

    def data(self, put: Put, size: float) -> dict[str, Any]:
        """Header entry for a robot of a size [m]."""
        lengths = [float(np.linalg.norm(group.along, axis=-1).max(initial=0.0)) for group in self.groups]
        max_length = max(lengths, default=0.0)
        scale = 1.0
        if self.longest and max_length:
            scale = self.longest * size / max_length
        data: dict[str, Any] = {"label": self.label, "told": self.told, "time": None, "workspace": None}
        if self.time is not None:
            data["time"] = put(self.time, "f8")
        if self.workspace is not None:
            data["workspace"] = self.workspace.data(put)
        return {**data, "groups": [group.data(put, scale) for group in self.groups]}


def calibration_layer(found: CalibratedRobot) -> PageLayer:
    """Errors at the measured points before and after the calibration, and the error predicted over the workspace.

    Readings other than poses and positions have no arrows.
    """
    points, before, after = found.error_vectors
    verdict = next(iter(found.blocks()))
    told = f"{plain(verdict)}\n"
    groups: tuple[ArrowGroup, ...] = ()
    if len(points):
        told += f"Arrows: errors at {len(points)} measured points, {_ERROR_SCALE} times enlarged. "
        groups = (
            ArrowGroup("with the file", points, _ERROR_SCALE * before, COLOURS[Style.QUIET].scene),
            ArrowGroup("calibrated", points, _ERROR_SCALE * after, COLOURS[Style.POINTED].scene),
        )
    told += f"Dots: error predicted for the tip at {len(found.reference)} configurations."
    tips = found.fit.problem.chain.tips(found.reference, found.fit.state.corrections)[:, :3, 3]
    workspace = ColouredPoints("predicted error", "mm", tips, _MILLI * found.remaining_at(found.reference))
    return PageLayer("Errors", told, groups, workspace=workspace)


def contact_layer(found: GroundSupport, time: Array) -> PageLayer:
    """Contact forces of a robot on the ground at the times of a page's motion."""
    rows = _nearest(found.time, time)
    _, points = contact_maps(found.robot, found.states.q[rows], found.contacts)
    forces = np.nan_to_num(found.balanced_forces[rows])
    group = ArrowGroup("contact force", points, forces, MARKS["wrench"], _shares(found, rows, forces))
    return PageLayer("Contact forces", f"{ground_words(found)}.", (group,), longest=_MAX_FORCE_LENGTH, time=time)


def _nearest(known: Array, time: Array) -> Array:
    """Rows of the known times (k,) that are nearest to times (n,)."""
    after = np.searchsorted(known, time).clip(max=len(known) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(time - known[before] < known[after] - time, before, after)


def _shares(found: GroundSupport, rows: Array, forces: Array) -> Array:
    """Larger one of two shares (n, c): of the friction cone, and of the largest push; at most 1 where the contacts hold."""
    shares = []
    for contact, force in zip(found.contacts, np.moveaxis(forces, 1, 0), strict=True):
        normal = force @ contact.normal
        tangential = np.linalg.norm(force - normal[:, None] * contact.normal, axis=1)
        max_tangential = contact.friction * np.maximum(normal + contact.pull, 0.0)
        share_of_cone = np.divide(tangential, max_tangential, out=np.zeros_like(tangential), where=max_tangential > 0.0)
        shares.append(np.maximum(share_of_cone, normal / contact.push))
    max_share = np.where(found.holds[rows], 1.0, np.inf)  # rounding of the solver is cut off
    return np.minimum(np.stack(shares, axis=1), max_share[:, None])
