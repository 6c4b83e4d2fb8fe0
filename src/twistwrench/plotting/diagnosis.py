"""What the doctor found, drawn: the shapes of a link, and the solid ellipsoid of its inertia before and after the repair."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..bodies.hull import hull_faces
from ..bodies.inertia import SpatialInertia
from ..errors import ValueRangeError
from ..typing import Array
from ..viz.skeleton import equal_inertia_ellipsoid
from .style import BLUE, PALE, QUIET, SMALL, VERMILION, figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..diagnosis import DoctorReport

_MOST = 6
"""Links in one picture: those with the worst findings."""
VIEWS = ((0, 1), (0, 2), (1, 2))
"""Axes of a link that lie in each of the three pictures of it."""


def plot_diagnosis(report: DoctorReport, path: str | Path) -> Path:
    """Draw the links whose inertia the doctor repairs: shapes, and ellipsoids of inertia before and after.

    Parameters
    ----------
    report : DoctorReport
    path : str or Path; the suffix says the kind, .png if there is none

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    ValueRangeError
        No finding changes an inertia, so there is nothing to draw; or nothing can be written.
    MissingExtraError
        There is no matplotlib.

    Notes
    -----
    The ellipsoid is the uniform solid with the same mass and moments, seen along an axis of the link. It is as large as the
    body would be. Of a tensor that cannot exist, what is negative is drawn as nearly nothing.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> text = tw.robots.path_of("ur5").read_text().replace('iyz="0" izz="0.0021942"', 'iyz="0" izz="0.21942"')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_diagnosis(tw.doctor(text), f"{folder}/wrists").suffix
    '.png'
    """
    pairs = links_drawn(report)
    if not pairs:
        raise ValueRangeError(f"no finding on robot {report.robot!r} changes an inertia, so there is nothing to draw.")
    height = 2.5 * len(pairs) + 0.9
    with figure(9.0, height, f"{report.robot}: inertia before and after") as drawn:
        grid = drawn.subplots(len(pairs), 3, squeeze=False)
        for row, (link, check, after) in zip(grid, pairs, strict=True):
            before = report.subject.robot.model.link_inertias[link]
            for axes, view in zip(row, VIEWS, strict=True):
                _draw(axes, report, link, before, after, view)
            row[0].set_title(f"{link}: {check}", loc="left")
        grid[0][2].legend(fontsize=SMALL, frameon=False, loc="upper right")
        return save(drawn, path)


def links_drawn(report: DoctorReport) -> list[tuple[str, str, SpatialInertia]]:
    """The links whose inertia a finding changes in effect, each with the check's name and the inertia it gets."""
    found: dict[str, tuple[str, SpatialInertia]] = {}
    for finding in report.findings:
        if finding.repair is not None and finding.effect.inertia_joint:
            for link, inertia in finding.repair.inertias.items():
                found.setdefault(link, (finding.check, inertia))
    return [(link, check, inertia) for link, (check, inertia) in found.items()][:_MOST]


def _draw(
    axes: Axes, report: DoctorReport, link: str, before: SpatialInertia, after: SpatialInertia, view: tuple[int, int]
) -> None:
    described = report.subject.robot.links.get(link)
    label: str | None = "shapes"
    for shape in described.shapes.solids if described is not None else ():
        outline = _outline(shape.points[:, list(view)])
        axes.fill(*outline.T, color=PALE, zorder=1, label=label)
        label = None
    # The file's last: dashes show on a line where both are alike, as a negative moment drawn as nothing may be.
    draw_inertias(axes, [(after, BLUE, "-", "repaired"), (before, VERMILION, "--", "in the file")], view)


def draw_inertias(axes: Axes, inertias: Sequence[tuple[SpatialInertia, str, str, str]], view: tuple[int, int]) -> None:
    """Outlines of the uniform ellipsoids that have these inertias, and their centres of mass: inertia, colour, style, name.

    ``view`` are the axes of the link that lie in the picture.
    """
    for inertia, colour, style, name in inertias:
        for solid in equal_inertia_ellipsoid(inertia) if inertia.mass > 0 else ():
            outline = _outline(solid.vertices[:, list(view)])
            x, y = np.concatenate([outline, outline[:1]]).T
            axes.plot(x, y, color=colour, linestyle=style, linewidth=1.4, label=name, zorder=3)
        axes.plot(*inertia.com[list(view)], "+", color=colour, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[view[0]]} [m]", fontsize=SMALL)
    axes.set_ylabel(f"{'xyz'[view[1]]} [m]", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL, colors=QUIET)


def _outline(points: Array) -> Array:
    """The convex outline (n, 2) of points, in order."""
    edges = hull_faces(points)
    if edges is None:
        return points
    used = np.unique(edges)
    middle = points[used].mean(axis=0)
    around = points[used] - middle
    return np.asarray(points[used][np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
