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

_MM_PER_M = 1e3
"""Millimetres in a metre."""
_ERROR_SCALE = 100
"""Ratio of an arrow's length to the error that it shows."""
_MAX_FORCE_LENGTH = 0.35
"""Length of the largest contact force, as a share of the robot's size."""
Put = Callable[[Any, str], dict[str, Any]]
"""Function that stores an array in a format, such as "f4", and returns its entry in the header of the page's data."""


@dataclass(frozen=True, eq=False)
class ArrowGroup:
    """Arrows of one meaning, at fixed places or along a motion."""

    name: str
    points: Array
    """Starting points of the arrows, (c, 3), or (n, c, 3) along a motion [m]."""
    along: Array
    """Vectors of the arrows, with the shape of ``points``; drawn at this length [m] unless the layer sets ``longest``."""
    colour: tuple[float, float, float]
    """Red, green and blue, from 0 to 1."""
    shares: Array | None = None
    """Share (n, c) of the friction cone or of the largest push; from 80 % on it sets the colour. None without limits."""

    def data(self, put: Put, scale: float) -> dict[str, Any]:
        """Header entry, with arrows whose length is multiplied by ``scale``."""
        entry = {
            "name": self.name,
            "colour": self.colour,
            "count": self.points.shape[-2],
            "points": put(self.points, "f4"),
            "along": put(scale * self.along, "f4"),
            "shares": None,
        }
        if self.shares is not None:
            entry["shares"] = put(self.shares, "f4")
        return entry


@dataclass(frozen=True, eq=False)
class ColouredPoints:
    """Points coloured by a quantity, in equal steps from its smallest to its largest value."""

    name: str
    """Name of the quantity."""
    unit: str
    points: Array
    """Positions (n, 3) [m]."""
    values: Array
    """Value of the quantity at each point, (n,) in the unit."""

    def data(self, put: Put) -> dict[str, Any]:
        """Header entry: title with the range of values, points, number of each point's colour, and colours."""
        min_value = float(self.values.min())
        max_value = float(self.values.max())
        edges = np.linspace(min_value, max_value, len(SEQUENTIAL) + 1)  # of the steps
        inner_edges = edges[1:-1]
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
        max_length = 0.0
        for group in self.groups:
            lengths = np.linalg.norm(group.along, axis=-1)
            max_length = max(max_length, float(lengths.max(initial=0.0)))
        scale = 1.0
        if self.longest and max_length:
            scale = self.longest * size / max_length
        entry: dict[str, Any] = {"label": self.label, "told": self.told, "time": None, "workspace": None}
        if self.time is not None:
            entry["time"] = put(self.time, "f8")
        if self.workspace is not None:
            entry["workspace"] = self.workspace.data(put)
        entry["groups"] = [group.data(put, scale) for group in self.groups]
        return entry


def calibration_layer(found: CalibratedRobot) -> PageLayer:
    """Errors at the measured points before and after the calibration, and the error predicted over the workspace.

    Readings other than poses and positions have no arrows.
    """
    points, errors_before, errors_after = found.error_vectors
    verdict = next(iter(found.blocks()))  # the first block
    explanation = f"{plain(verdict)}\n"
    groups: tuple[ArrowGroup, ...] = ()
    if len(points):
        explanation += f"Arrows: errors at {len(points)} measured points, {_ERROR_SCALE} times enlarged. "
        groups = (
            ArrowGroup("with the file", points, _ERROR_SCALE * errors_before, COLOURS[Style.QUIET].scene),
            ArrowGroup("calibrated", points, _ERROR_SCALE * errors_after, COLOURS[Style.POINTED].scene),
        )
    explanation += f"Dots: error predicted for the tip at {len(found.reference)} configurations."
    tip_poses = found.fit.problem.chain.tips(found.reference, found.fit.state.corrections)
    tip_positions = tip_poses[:, :3, 3]
    predicted_error = _MM_PER_M * found.remaining_at(found.reference)
    workspace = ColouredPoints("predicted error", "mm", tip_positions, predicted_error)
    return PageLayer("Errors", explanation, groups, workspace=workspace)


def contact_layer(found: GroundSupport, time: Array) -> PageLayer:
    """Contact forces of a robot on the ground at the times of a page's motion."""
    rows = _nearest_rows(found.time, time)
    _, points = contact_maps(found.robot, found.states.q[rows], found.contacts)
    forces = np.nan_to_num(found.balanced_forces[rows])  # zero where no forces balance the robot
    group = ArrowGroup("contact force", points, forces, MARKS["wrench"], _force_shares(found, rows, forces))
    return PageLayer("Contact forces", f"{ground_words(found)}.", (group,), longest=_MAX_FORCE_LENGTH, time=time)


def _nearest_rows(row_times: Array, time: Array) -> Array:
    """Rows (n,) whose times, of ``row_times`` (k,) in order, are nearest to ``time`` (n,)."""
    after = np.searchsorted(row_times, time).clip(max=len(row_times) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(time - row_times[before] < row_times[after] - time, before, after)


def _force_shares(found: GroundSupport, rows: Array, forces: Array) -> Array:
    """Share (n, c) of a force in its limits: of the friction cone or of the largest push, whichever is larger.

    It is at most 1 in rows in which the contacts hold.
    """
    shares = []
    for contact, force in zip(found.contacts, np.moveaxis(forces, 1, 0), strict=True):  # force: (n, 3)
        normal_force = force @ contact.normal
        tangential_force = np.linalg.norm(force - normal_force[:, None] * contact.normal, axis=1)
        max_tangential = contact.friction * np.maximum(normal_force + contact.pull, 0.0)
        share_of_cone = np.zeros_like(tangential_force)  # stays zero where no tangential force is possible
        np.divide(tangential_force, max_tangential, out=share_of_cone, where=max_tangential > 0.0)
        shares.append(np.maximum(share_of_cone, normal_force / contact.push))
    max_share = np.where(found.holds[rows], 1.0, np.inf)  # rounding errors of the solver are cut off
    return np.minimum(np.stack(shares, axis=1), max_share[:, None])
