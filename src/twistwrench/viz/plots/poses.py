"""Plot of proposed poses of a force-torque sensor: directions of gravity, and what is known after each pose."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...core.glossary import complete
from ...core.numbers import number
from ...core.typing import Array
from ...sensing.poses import PoseProposal
from .. import style

_MM_PER_M = 1e3
"""Millimetres in a metre."""
_CIRCLE_ANGLES = np.linspace(0.0, 2.0 * math.pi, 181)
"""Polar angles [rad] of the points of a drawn circle."""
_DECIMALS_OF_EQUAL_POINTS = 6
"""Decimals to which points are rounded, so that equal poses have equal points."""
_TICKS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
"""First digits of the ticks of a logarithmic axis."""
_DRAWN_TILTS = (math.pi / 6, math.pi / 3, math.pi / 2, math.pi)
"""Tilts [rad] that are drawn as circles."""


def plot_proposal(found: PoseProposal, path: str | Path) -> None:
    """Plot the tilts in which to hold the sensor, and the intervals of mass and centre of mass after each pose.

    Parameters
    ----------
    found : PoseProposal
    path : str or Path, file to write

    Notes
    -----
    Directions d of gravity in {f} are shown by Lambert's azimuthal equal-area projection about upright, d = -z.

    Examples
    --------
    >>> import tempfile
    >>> from twistwrench.sensing import propose_poses
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     propose_poses(6, log="demo").plot(f"{folder}/poses.svg").name
    'poses.svg'
    """
    width, height = 10.5, 4.8  # inches
    with style.figure(width, height, f"{len(found.poses)} poses for a load of {number(found.mass)} kg") as drawn:
        left_axis, right_axis = drawn.subplots(1, 2)
        _draw_directions(left_axis, found)
        _draw_intervals(right_axis, found)
        style.save(drawn, path)


def _projection(directions: Array) -> Array:
    """Points (n, 2) of directions of gravity (n, 3): at the distance 2 sin(tilt / 2) from the centre.

    Lambert's projection of a unit vector (x, y, z) is (x, y) sqrt(2 / (1 - z)). The sensor is upright at z = -1.
    """
    unit_vectors = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    x, y, z = unit_vectors.T
    scale = np.sqrt(2.0 / np.maximum(1.0 - z, 1e-12))  # also finite upside down, at z = 1
    return np.stack([scale * x, scale * y], axis=1)


def _draw_directions(axis: Any, found: PoseProposal) -> None:
    """Draw directions of gravity with the numbers of the poses, and the directions that the log already has."""
    for tilt in _DRAWN_TILTS:
        radius = 2.0 * math.sin(tilt / 2)
        axis.plot(radius * np.cos(_CIRCLE_ANGLES), radius * np.sin(_CIRCLE_ANGLES), color=style.PALE, linewidth=0.8)
        axis.annotate(f"{number(math.degrees(tilt))}°", (0.0, radius), color=style.QUIET, fontsize=style.SMALL_FONT)
    if found.log is not None:
        x, y = _projection(found.log.gravity).T
        axis.plot(x, y, "o", markersize=3, color=style.QUIET, linestyle="none", label="read already")
        axis.legend()
    points = _projection(found.gravity).round(_DECIMALS_OF_EQUAL_POINTS) + 0.0  # -0.0 becomes 0.0
    for x, y in np.unique(points, axis=0):  # a pose that is proposed again has one mark
        is_here = (points == (x, y)).all(axis=1)
        pose_numbers = 1 + np.flatnonzero(is_here)
        axis.plot(x, y, "o", markersize=15, color=style.POINTED, alpha=0.25)
        axis.annotate(", ".join(map(str, pose_numbers)), (x, y), ha="center", va="center")
    axis.set_aspect("equal")
    axis.set_axis_off()
    style.titles(axis, "Gravity in the sensor's frame, by tilt from upright")


def _draw_intervals(axis: Any, found: PoseProposal) -> None:
    """Draw half-widths of the 95 % intervals after each pose; a pose after which they are infinite is left out."""
    from matplotlib.ticker import LogLocator, NullLocator

    pose_counts = np.arange(1, len(found.poses) + 1)
    mass_half_widths, centre_half_widths = found.intervals.T
    for half_widths, label, colour in (
        (100.0 * mass_half_widths / found.mass, "mass ± [%]", style.BLUE),
        (_MM_PER_M * centre_half_widths, "centre of mass ± [mm]", style.VERMILION),
    ):
        is_finite = np.isfinite(half_widths)
        axis.plot(pose_counts[is_finite], half_widths[is_finite], "o-", markersize=4, color=colour, label=label)
    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=_TICKS))
    axis.yaxis.set_minor_locator(NullLocator())
    axis.yaxis.set_major_formatter(lambda x, _: number(x))
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set_xlabel("poses")
    axis.legend()
    style.titles(axis, "Known after each pose (95 %)")


complete(globals())
