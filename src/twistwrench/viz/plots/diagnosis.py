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

_MAX_DRAWN_LINKS = 6
"""Maximum number of links in a picture; those of the worst findings are drawn."""
VIEWS = ((0, 1), (0, 2), (1, 2))
"""Pair of link axes in the picture plane of each of the three views: 0 is x, 1 is y, 2 is z."""


def plot_diagnosis(report: DoctorReport, path: str | Path) -> Path:
    """Draw the links with inertias repaired by the doctor: shapes, and inertia ellipsoids before and after."""
    changed_links = links_drawn(report)
    if not changed_links:
        raise ValueRangeError(f"no finding on robot {report.robot!r} changes an inertia, so there is nothing to draw.")
    height = 2.5 * len(changed_links) + 0.9
    with style.figure(9.0, height, f"{report.robot}: inertia before and after") as figure:
        panels = figure.subplots(len(changed_links), 3, squeeze=False)
        for link_panels, (link, check, repaired_inertia) in zip(panels, changed_links, strict=True):
            file_inertia = report.contents.robot.model.link_inertias[link]
            parsed_link = report.contents.robot.links.get(link)
            solids = [] if parsed_link is None else list(parsed_link.shapes.solids)
            # The file's inertia is drawn last: its dashes stay visible over an equal solid line.
            inertias = [
                (repaired_inertia, style.BLUE, "-", "repaired"),
                (file_inertia, style.VERMILION, "--", "in the file"),
            ]
            for axes, view in zip(link_panels, VIEWS, strict=True):
                for k, shape in enumerate(solids):
                    outline = _outline(shape.points[:, list(view)])
                    axes.fill(*outline.T, color=style.PALE, zorder=1, label=None if k else "shapes")
                draw_inertias(axes, inertias, view)
            link_panels[0].set_title(f"{link}: {check}", loc="left")
        panels[0][2].legend(loc="upper right")
        return style.save(figure, path)


def links_drawn(report: DoctorReport) -> list[tuple[str, str, SpatialInertia]]:
    """Links whose repair changes the mass matrix, each with the check's name and the repaired inertia."""
    changed_links: dict[str, tuple[str, str, SpatialInertia]] = {}
    for finding in report.findings:
        if finding.repair is not None and finding.effect.inertia_joint:
            for link, inertia in finding.repair.inertias.items():
                changed_links.setdefault(link, (link, finding.check, inertia))  # the worst finding comes first
    return list(changed_links.values())[:_MAX_DRAWN_LINKS]


def draw_inertias(
    axes: style.Axes, inertias: Sequence[tuple[SpatialInertia, str, str, str]], view: tuple[int, int]
) -> None:
    """Draw the outlines of uniform ellipsoids of equal inertia, and their centres of mass.

    ``inertias`` has tuples of inertia, colour, dashes and name; ``view`` has the link axes in the picture plane.
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
    """Corners (n, 2) of the convex hull of points (m, 2), counterclockwise; all points if they are on a line."""
    edges = hull_faces(points)
    if edges is None:
        return points
    corners = points[np.unique(edges)]
    spokes = corners - corners.mean(axis=0)
    angles = np.arctan2(spokes[:, 1], spokes[:, 0])
    return np.asarray(corners[np.argsort(angles)])
