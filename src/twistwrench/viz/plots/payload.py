"""Plots of statics: force polytope and ellipsoid, limit shares of the joints, and the payload map."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ...core.errors import ValueRangeError
from ...core.glossary import complete
from ...core.numbers import number, over_limit, rounded_down
from ...core.typing import Array
from ...statics.force_capability import (
    WrenchEllipsoid,
    WrenchPolytope,
    weakest_direction,
    wrench_ellipsoid,
    wrench_polytope,
)
from ...statics.payload import SLICES, LargestPayload, PayloadMap
from ...statics.payload_report import PayloadReport
from ...statics.payload_view import carried_words, place_words
from .. import style

if TYPE_CHECKING:
    from ...robot import Robot

__all__ = ["plot_payload"]


def draw_map(figure: Any, chart: PayloadMap, tip: Array, answer: float) -> None:
    """Draw the largest payloads of the best and worst posture at each place, side by side.

    The scale of colours includes ``answer``, the largest payload of the pose above the map.
    """
    from matplotlib.colors import LogNorm

    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    axis_names: tuple[str, ...]
    if chart.plane == "rz":
        tip_place, axis_names = (np.hypot(*tip[:2]), tip[2]), ("distance from the z axis", "z")
    else:
        tip_place, axis_names = tuple(tip[list(SLICES[chart.plane][:2])]), tuple(chart.plane)
    finite_payloads = chart.best[np.isfinite(chart.best)]
    high = 1.0
    if finite_payloads.size:
        high = max(float(np.percentile(finite_payloads, 98)), 1e-3)  # a few are 100 times larger
    low = min(max(float(np.nanmin(chart.worst)), 1e-2 * high), high)  # two decades at most
    if 0 < answer < np.inf:
        low, high = min(low, answer / 3), max(high, 3 * answer)
    colour_scale = LogNorm(low, max(high, 1.01 * low))
    titles = ("Payload map, best posture", "Payload map, worst posture")
    for axis, values, title in zip(axes, (chart.best, chart.worst), titles, strict=True):
        image = axis.pcolormesh(
            *chart.edges, np.maximum(values, low), norm=colour_scale, cmap="viridis", rasterized=True
        )
        axis.set_aspect("equal")
        axis.grid(visible=False)
        style.titles(axis, title)
        axis.set_xlabel(f"{axis_names[0]} [m]")
        axis.plot(*tip_place, "x", color=style.PAPER, markeredgewidth=3.5, markersize=8)  # rim of the cross
        (cross,) = axis.plot(*tip_place, "x", color=style.POINTED, markeredgewidth=1.8, markersize=7, linestyle="none")
    axes[0].set_ylabel(f"{axis_names[1]} [m]")
    figure.legend([cross], ["the pose above"], loc="outside lower center")
    bar = figure.colorbar(image, ax=axes, extend="both", label="largest payload [kg]", shrink=0.9)
    ticks = _round_ticks(low, high)
    bar.set_ticks(ticks, labels=[number(tick) for tick in ticks], minor=False)
    bar.minorticks_off()


def _round_ticks(low: float, high: float) -> list[float]:
    """A few round numbers from low to high, in steps of 1, 2, 5, or finer if these give fewer than three."""
    ticks: list[float] = []
    decades = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    tenths = tuple(0.1 * k for k in range(10, 100))
    for steps in ((1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0), tenths):
        ticks = [float(tick) for tick in np.outer(decades, steps).ravel() if low <= tick <= high]
        if len(ticks) >= 3:
            break
    return ticks


_POLYTOPE_LABEL = "polytope: each joint within its limit, gravity held first"
_ELLIPSOID_LABEL = "ellipsoid: √Σ(torque/limit)² ≤ 1, all joints together, no gravity"


def plot_payload(report: PayloadReport, path: str | Path) -> None:
    """Plot one pose with its largest payload, and the payload map if there is one.

    Forces are those of the robot on the world at zero moment, along the axes of the base. The ellipsoid holds all
    forces with a torque norm of at most 1 in units of the limits, without gravity.

    Parameters
    ----------
    report : PayloadReport
    path : str or Path, file to write

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_payload(tw.payload(tw.robots.ur5(), [0.0, -1.2, 1.5, -0.3, 1.5, 0.0]), f"{folder}/payload.svg")
    """
    largest, carried = report.largest, carried_words(report)
    title = (
        f"{report.robot.name} · {_mass_text(largest)} at {place_words(report.frame, report.com)}, by torque limits only"
    )
    if carried:
        title += f", beside {carried}"
    rows = 1 if report.map is None else 2
    with style.figure(10.5, 4.6 * rows, title) as drawn:
        parts = cast("Any", drawn.subfigures(rows, 1, squeeze=False)).ravel()
        left, right = parts[0].subfigures(1, 2, width_ratios=[1.15, 1])
        _draw_forces(left, report.robot, report.q, report.frame, report.limits.effort)
        _draw_shares(right.subplots(), largest, carried)
        if report.map is not None:
            tip = np.asarray(report.robot.forward_kinematics(report.q, report.frame))[:3, 3]
            draw_map(parts[1], report.map, tip, float(largest.mass) if largest.holds else 0.0)
        style.save(drawn, path)


def _mass_text(largest: LargestPayload) -> str:
    """Largest payload, as in the title of its figure."""
    if not largest.holds:
        return "no payload"
    if np.isinf(largest.mass):
        return "any payload"
    return f"largest payload {rounded_down(largest.mass)} kg"


def _draw_forces(part: Any, robot: Robot, q: Array, frame: str, limits: Array) -> None:
    try:
        polytope = wrench_polytope(robot, q, frame, limits=limits)
        ellipsoid = wrench_ellipsoid(robot, q, frame, limits=limits)  # in units of the torque limits
    except ValueRangeError as problem:
        axis = part.subplots()
        axis.set_axis_off()
        axis.text(0.5, 0.5, str(problem), ha="center", va="center", wrap=True, color=style.QUIET)
        return
    borne_directions = polytope.borne.shape[1]  # in which the structure bears forces without torques
    legend_place: dict[str, Any] = {}
    if borne_directions == 0:
        axis = part.add_subplot(projection="3d", computed_zorder=False)
        _draw_solid(axis, polytope, ellipsoid)
        draw_weakest = _draw_weakest_in_space
    elif borne_directions == 1:
        axis = part.subplots()
        _draw_section(axis, polytope, ellipsoid)
        draw_weakest = _draw_weakest_in_plane
        legend_place = {"bbox_to_anchor": (0.0, -0.14)}  # only a solid plot has room beside the figure
    else:
        axis = part.subplots()
        axis.set_axis_off()
        axis.text(0.5, 0.5, _flat_caption(polytope), ha="center", color=style.QUIET)
        return
    weakest = weakest_direction(robot, q, frame=frame, limits=limits)
    if weakest.magnitude > 0:
        limiting_joint = weakest.joint_names[int(weakest.joint)].removesuffix("_joint")
        label = f"weakest, {number(weakest.magnitude)} N, by {limiting_joint}"
        draw_weakest(axis, polytope, weakest.magnitude * weakest.wrench[3:], label)
    style.titles(axis, "Forces the robot can apply, at zero moment")
    axis.legend(loc="upper left", **legend_place)


def _flat_caption(polytope: WrenchPolytope) -> str:
    """Caption for at most one direction of force that requires torque."""
    if polytope.borne.shape[1] > 2:
        return "The structure bears forces\nin every direction here."
    third = np.linalg.svd(polytope.borne.T)[2][-1]  # across the two borne directions
    if third[np.argmax(np.abs(third))] <= 0:
        third = -third
    forces = polytope.vertices @ third
    return (
        "The structure bears forces in two directions here.\n"
        f"Along the third, {_direction_text(third)}: {number(forces.min())} to {number(forces.max())} N"
    )


def _draw_solid(axis: Any, polytope: WrenchPolytope, ellipsoid: WrenchEllipsoid) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    corners_by_face = [_face(polytope, n, b) for n, b in zip(polytope.normals, polytope.offsets, strict=True)]
    polygons = [corners for corners in corners_by_face if len(corners) >= 3]
    options: dict[str, Any] = {"facecolor": style.SKY, "edgecolor": style.LINE, "linewidth": 0.8, "alpha": 0.22}
    faces = Poly3DCollection(polygons, zorder=1, **options)
    faces.set_label(_POLYTOPE_LABEL)
    axis.add_collection3d(faces)
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(0, np.pi, 19))
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)
    shell = (ball * ellipsoid.semi_axes) @ ellipsoid.axes.T
    axis.plot_wireframe(
        shell[..., 0], shell[..., 1], shell[..., 2], color=style.AMBER, linewidth=0.6, rstride=2, cstride=2, zorder=2,
        label=_ELLIPSOID_LABEL,
    )  # fmt: skip
    points = np.concatenate([polytope.vertices, shell.reshape(-1, 3)])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, reach = (low + high) / 2, 0.5 * (high - low).max()
    for k, letter in enumerate("xyz"):
        label_distance = 7 if letter == "y" else 3
        getattr(axis, f"set_{letter}lim")(middle[k] - reach, middle[k] + reach)
        getattr(axis, f"set_{letter}label")(f"f{letter} [N]", fontsize=style.SMALL_FONT, labelpad=label_distance)
    axis.tick_params(labelsize=7, pad=1)
    axis.tick_params(axis="z", pad=4)
    axis.set_box_aspect((1, 1, 1))


def _face(polytope: WrenchPolytope, n: Array, b: float) -> Array:
    """Corners (k, 3) in the plane n · x = b, in order around it."""
    corners = polytope.vertices[np.abs(polytope.vertices @ n - b) <= 1e-6 * (1 + np.abs(b))]
    if len(corners) < 3:
        return corners
    spokes = corners - corners.mean(axis=0)
    first = spokes[0] / np.linalg.norm(spokes[0])
    angles = np.arctan2(spokes @ np.cross(n, first), spokes @ first)
    return corners[np.argsort(angles)]


def _draw_section(axis: Any, polytope: WrenchPolytope, ellipsoid: WrenchEllipsoid) -> None:
    """Draw the forces of a planar robot in its plane."""
    first, second = _plane(polytope)
    corners = np.column_stack([polytope.vertices @ first, polytope.vertices @ second])
    spokes = corners - corners.mean(axis=0)
    ring = corners[np.argsort(np.arctan2(spokes[:, 1], spokes[:, 0]))]
    axis.fill(*ring.T, facecolor=style.SKY, edgecolor=style.LINE, alpha=0.35, label=_POLYTOPE_LABEL)
    angles = np.linspace(0, 2 * np.pi, 181)
    directions = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    reach = ellipsoid.reach(directions)
    axis.plot(reach * np.cos(angles), reach * np.sin(angles), color=style.AMBER, label=_ELLIPSOID_LABEL)
    axis.set_aspect("equal", "datalim")
    axis.margins(0.12)
    axis.set_xlabel(f"force along {_direction_text(first)} [N]")
    axis.set_ylabel(f"force along {_direction_text(second)} [N]")


def _plane(polytope: WrenchPolytope) -> tuple[Array, Array]:
    """Two unit vectors across the borne direction: the nearest base axis first, upwards second."""
    n = polytope.borne[:, 0]
    axes_in_plane = np.eye(3) - np.outer(n, n)  # rows: base axes projected onto the plane
    first = axes_in_plane[0] if np.linalg.norm(axes_in_plane[0]) > 0.5 else axes_in_plane[1]
    first = first / np.linalg.norm(first)
    second = np.cross(n, first)
    if second[np.argmax(np.abs(second))] <= 0:
        second = -second
    return first, second


def _direction_text(direction: Array) -> str:
    """Name of a base axis, or components of a direction."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) > 1 - 1e-9:
        return "xyz"[k]
    return f"({', '.join(number(x, 2, decimals=3) for x in direction)})"


def _draw_weakest_in_space(axis: Any, polytope: WrenchPolytope, tip: Array, label: str) -> None:
    """Draw the weakest force, up to the shaded nearest facet; a white outline separates it from the ellipsoid."""
    from matplotlib.patheffects import Normal, Stroke
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    n = tip / np.linalg.norm(tip)
    nearest_face = _face(polytope, n, float(n @ tip))
    if len(nearest_face) >= 3:
        nearest_polygon = Poly3DCollection(
            [nearest_face], zorder=3, facecolor=style.POINTED, edgecolor=style.POINTED, linewidth=1.2, alpha=0.25
        )
        axis.add_collection3d(nearest_polygon)
    rim = [Stroke(linewidth=6, foreground=style.PAPER), Normal()]
    axis.plot(
        *np.stack([np.zeros(3), tip], axis=1),
        color=style.POINTED,
        linewidth=3,
        label=label,
        zorder=10,
        path_effects=rim,
    )
    for place, colour, size in (((0, 0, 0), style.INK, 6), (tip, style.POINTED, 9)):
        axis.plot(
            *np.reshape(place, (3, 1)), "o", color=colour, markersize=size, markeredgecolor=style.PAPER, zorder=11
        )


def _draw_weakest_in_plane(axis: Any, polytope: WrenchPolytope, tip: Array, label: str) -> None:
    """Draw the weakest force, up to the nearest side, which is drawn thick."""
    first, second = _plane(polytope)
    n = tip / np.linalg.norm(tip)
    distances = np.abs(polytope.vertices @ n - n @ tip)  # from the line of the nearest side
    side = polytope.vertices[distances <= 1e-6 * (1 + np.linalg.norm(tip))]
    axis.plot(side @ first, side @ second, color=style.POINTED, linewidth=2.5, alpha=0.5, zorder=9)
    axis.plot([0, tip @ first], [0, tip @ second], color=style.POINTED, linewidth=3, label=label, zorder=10)
    axis.plot(0, 0, "o", color=style.INK, markersize=5, markeredgecolor=style.PAPER, zorder=11)
    axis.plot(tip @ first, tip @ second, "o", color=style.POINTED, markersize=8, markeredgecolor=style.PAPER, zorder=11)


def _draw_shares(axis: Any, largest: LargestPayload, carried: str) -> None:
    """Bars of the holding torques with the largest payload and, thin, without it, as shares of the limits."""
    from matplotlib.patches import Patch

    rows = np.arange(len(largest.joint_names))
    limits = np.where(largest.limits > 0, largest.limits, np.inf)  # a limit of zero has no share to draw
    unloaded_shares, loaded_shares = largest.unloaded / limits, largest.torques / limits
    over = over_limit(np.abs(loaded_shares))
    colours = np.select([over, rows == int(largest.joint)], [style.OVER, style.NEAR], style.SKY).tolist()
    axis.barh(rows, loaded_shares, color=colours, height=0.62)
    axis.barh(rows, unloaded_shares, color=style.LINE, height=0.22)
    axis.axvline(0, color=style.AXIS, linewidth=0.7)
    reach = 1.15 * max(1.0, float(np.abs(loaded_shares).max(initial=0)))
    for side in (-1, 1):
        axis.axvline(side, **style.LIMIT)
        axis.axvspan(side, 2 * side * reach, color=style.OVER, alpha=0.08, linewidth=0)
    axis.set_xlim(-reach, reach)
    axis.set_yticks(rows, [name.removesuffix("_joint") for name in largest.joint_names])
    axis.set_ylim(max(len(rows), 4) - 0.5, -0.5)
    axis.set_xlabel("torque as a share of its limit")
    axis.grid(visible=False, axis="y")
    style.titles(axis, "Holding torques")
    legend = {
        "robot as it is" if carried else "robot alone": style.LINE,
        "with the payload": style.SKY,
        "at its limit": style.NEAR,
    }
    if over.any():
        legend["over its limit"] = style.OVER
    patches = [Patch(color=colour, label=label) for label, colour in legend.items()]
    axis.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.45, -0.16), ncols=3)


complete(globals())
