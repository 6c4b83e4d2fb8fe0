"""Plots of a diagnosis: inertia ellipsoids of links before and after their repair."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import ValueRangeError
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.bodies.mesh import hull_faces
from .. import style
from ..scene import equal_inertia_ellipsoid

if TYPE_CHECKING:
    from ...diagnosis import DoctorReport

_MAX_LINKS = 6
"""Maximum number of links in a picture, worst findings first."""
VIEWS = ((0, 1), (0, 2), (1, 2))
"""Pairs of link axes in the plane of each of the three views."""


def plot_diagnosis(report: DoctorReport, path: str | Path) -> Path:
    """Draw the links with inertias repaired by the doctor: shapes, and inertia ellipsoids before and after."""
    pairs = links_drawn(report)
    if not pairs:
        raise ValueRangeError(f"no finding on robot {report.robot!r} changes an inertia, so there is nothing to draw.")
    height = 2.5 * len(pairs) + 0.9
    with style.figure(9.0, height, f"{report.robot}: inertia before and after") as drawn:
        grid = drawn.subplots(len(pairs), 3, squeeze=False)
        for row, (link, check, after) in zip(grid, pairs, strict=True):
            before = report.contents.robot.model.link_inertias[link]
            parsed_link = report.contents.robot.links.get(link)
            solids = [] if parsed_link is None else list(parsed_link.shapes.solids)
            # The file's inertia is drawn last: its dashes stay visible over an equal solid line.
            inertias = [(after, style.BLUE, "-", "repaired"), (before, style.VERMILION, "--", "in the file")]
            for axes, view in zip(row, VIEWS, strict=True):
                for k, shape in enumerate(solids):
                    outline = _outline(shape.points[:, list(view)])
                    axes.fill(*outline.T, color=style.PALE, zorder=1, label=None if k else "shapes")
                draw_inertias(axes, inertias, view)
            row[0].set_title(f"{link}: {check}", loc="left")
        grid[0][2].legend(loc="upper right")
        return style.save(drawn, path)


def links_drawn(report: DoctorReport) -> list[tuple[str, str, SpatialInertia]]:
    """Links with an inertia effectively changed by a finding, each with the check's name and the new inertia."""
    found: dict[str, tuple[str, SpatialInertia]] = {}
    for finding in report.findings:
        if finding.repair is not None and finding.effect.inertia_joint:
            for link, inertia in finding.repair.inertias.items():
                found.setdefault(link, (finding.check, inertia))
    return [(link, check, inertia) for link, (check, inertia) in found.items()][:_MAX_LINKS]


def draw_inertias(
    axes: style.Axes, inertias: Sequence[tuple[SpatialInertia, str, str, str]], view: tuple[int, int]
) -> None:
    """Draw outlines and centres of mass of uniform ellipsoids: tuples of inertia, colour, dashes and name.

    ``view`` holds the link axes in the picture plane.
    """
    for inertia, colour, dashes, name in inertias:
        for solid in equal_inertia_ellipsoid(inertia):
            outline = _outline(solid.vertices[:, list(view)])
            x, y = np.concatenate([outline, outline[:1]]).T
            axes.plot(x, y, color=colour, linestyle=dashes, linewidth=1.4, label=name, zorder=3)
        axes.plot(*inertia.com[list(view)], "+", color=colour, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[view[0]]} [m]", fontsize=style.SMALL_FONT)
    axes.set_ylabel(f"{'xyz'[view[1]]} [m]", fontsize=style.SMALL_FONT)
    axes.tick_params(labelsize=style.SMALL_FONT, colors=style.QUIET)


def _outline(points: Array) -> Array:
    """Convex hull (n, 2) of points, in order."""
    edges = hull_faces(points)
    if edges is None:
        return points
    used = np.unique(edges)
    middle = points[used].mean(axis=0)
    spokes = points[used] - middle
    return np.asarray(points[used][np.argsort(np.arctan2(spokes[:, 1], spokes[:, 0]))])
