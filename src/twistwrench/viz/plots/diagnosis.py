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
"""Link axes to the right and up in each of the three views: 0 is x, 1 is y, 2 is z."""
_WIDTH = 9.0  # of a figure [inch]
_ROW_HEIGHT = 2.5  # of a link [inch]
_TITLE_HEIGHT = 0.9  # with the labels of the axes [inch]


def plot_diagnosis(report: DoctorReport, path: str | Path) -> Path:
    """Draw the links with inertias repaired by the doctor: shapes, and inertia ellipsoids before and after."""
    changed_links = links_drawn(report)
    if not changed_links:
        raise ValueRangeError(f"no finding on robot {report.robot!r} changes an inertia, so there is nothing to draw.")
    height = _ROW_HEIGHT * len(changed_links) + _TITLE_HEIGHT
    with style.figure(_WIDTH, height, f"{report.robot}: inertia before and after") as figure:
        panels = figure.subplots(len(changed_links), len(VIEWS), squeeze=False)
        for link_panels, (link, check, repaired_inertia) in zip(panels, changed_links, strict=True):
            file_inertia = report.contents.robot.model.link_inertias[link]
            parsed_link = report.contents.robot.links.get(link)
            solids = [] if parsed_link is None else parsed_link.shapes.solids
            # The file's inertia is drawn last: its dashes stay visible over an equal solid line.
            inertias = [  # inertia, colour, dashes, name
                (repaired_inertia, style.BLUE, "-", "repaired"),
                (file_inertia, style.VERMILION, "--", "in the file"),
            ]
            for axes, view in zip(link_panels, VIEWS, strict=True):
                for k, solid in enumerate(solids):
                    x, y = _outline(solid.points[:, list(view)]).T
                    label = "shapes" if k == 0 else None  # one entry in the legend
                    axes.fill(x, y, color=style.PALE, zorder=1, label=label)
                draw_inertias(axes, inertias, view)
            left_panel = link_panels[0]
            left_panel.set_title(f"{link}: {check}", loc="left")
        upper_right_panel = panels[0][-1]
        upper_right_panel.legend(loc="upper right")
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

    ``inertias`` has tuples of inertia, colour, dashes and name; ``view`` has the link axes to the right and up.
    """
    right, up = view
    for inertia, colour, dashes, name in inertias:
        for ellipsoid in equal_inertia_ellipsoid(inertia):  # none without mass
            outline = _outline(ellipsoid.vertices[:, [right, up]])
            x, y = np.concatenate([outline, outline[:1]]).T  # closed
            axes.plot(x, y, color=colour, linestyle=dashes, linewidth=1.4, label=name, zorder=3)
        axes.plot(inertia.com[right], inertia.com[up], "+", color=colour, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[right]} [m]", fontsize=style.SMALL_FONT)
    axes.set_ylabel(f"{'xyz'[up]} [m]", fontsize=style.SMALL_FONT)
    axes.tick_params(labelsize=style.SMALL_FONT, colors=style.QUIET)


def _outline(points: Array) -> Array:
    """Corners (n, 2) of the convex hull of points (m, 2), counterclockwise; all points if they are on a line."""
    edges = hull_faces(points)
    if edges is None:
        return points
    corners = points[np.unique(edges)]
    from_centre = corners - corners.mean(axis=0)
    angles = np.arctan2(from_centre[:, 1], from_centre[:, 0])
    return np.asarray(corners[np.argsort(angles)])
