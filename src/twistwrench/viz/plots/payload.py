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

_HIGHEST_PERCENTILE = 98
"""Percentile of the map's payloads at the upper end of its colours; a few payloads are 100 times larger."""
_MIN_HIGHEST_PAYLOAD = 1e-3
"""Least payload [kg] at the upper end of the colours."""
_MIN_COLOUR_RATIO = 1e-2
"""Ratio of the ends of the colours if payloads of the map are smaller: two decades."""
_MARGIN_OF_POSE = 3.0
"""Least factor between the payload of the pose and the ends of the colours."""


def draw_map(figure: Any, chart: PayloadMap, tip: Array, answer: float) -> None:
    """Draw the largest payloads of the best and worst posture at each place, side by side.

    The scale of colours includes ``answer``, the largest payload of the pose above the map.
    """
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    if chart.plane == "rz":
        tip_place = [float(np.hypot(*tip[:2])), float(tip[2])]
        x_name, y_name = "distance from the z axis", "z"
    else:
        x_index, y_index, _ = SLICES[chart.plane]
        tip_place = [float(tip[x_index]), float(tip[y_index])]
        x_name, y_name = chart.plane[0], chart.plane[1]
    low, high = _colour_range(chart, answer)
    images = []
    titles = ("Payload map, best posture", "Payload map, worst posture")
    for axis, payloads, title in zip(axes, (chart.best, chart.worst), titles, strict=True):
        images.append(_draw_half(axis, chart, np.maximum(payloads, low), (low, high)))
        style.titles(axis, title)
        axis.set_xlabel(f"{x_name} [m]")
    axes[0].set_ylabel(f"{y_name} [m]")
    crosses = [_draw_cross(axis, tip_place) for axis in axes]
    figure.legend(crosses[:1], ["the pose above"], loc="outside lower center")  # one entry for both halves
    bar = figure.colorbar(images[0], ax=axes, extend="both", label="largest payload [kg]", shrink=0.9)
    ticks = _round_ticks(low, high)
    bar.set_ticks(ticks, labels=[number(tick) for tick in ticks], minor=False)
    bar.minorticks_off()


def _colour_range(chart: PayloadMap, answer: float) -> tuple[float, float]:
    """Payloads [kg] at the lower and upper end of the colours."""
    finite_payloads = chart.best[np.isfinite(chart.best)]
    high = 1.0
    if finite_payloads.size:
        high = max(float(np.percentile(finite_payloads, _HIGHEST_PERCENTILE)), _MIN_HIGHEST_PAYLOAD)
    smallest_payload = float(np.nanmin(chart.worst))
    low = min(max(smallest_payload, _MIN_COLOUR_RATIO * high), high)
    if 0 < answer < np.inf:
        low = min(low, answer / _MARGIN_OF_POSE)
        high = max(high, _MARGIN_OF_POSE * answer)
    return low, high


def _draw_half(axis: Any, chart: PayloadMap, payloads: Array, colour_range: tuple[float, float]) -> Any:
    """Draw one half of the map; returns its image."""
    from matplotlib.colors import LogNorm

    low, high = colour_range
    colour_scale = LogNorm(low, max(high, 1.01 * low))  # 1.01: the ends must differ
    axis.set_aspect("equal")
    axis.grid(visible=False)
    return axis.pcolormesh(*chart.edges, payloads, norm=colour_scale, cmap="viridis", rasterized=True)


def _draw_cross(axis: Any, place: list[float]) -> Any:
    """Draw a cross with a rim; returns the cross."""
    axis.plot(*place, "x", color=style.PAPER, markeredgewidth=3.5, markersize=8)  # rim
    (cross,) = axis.plot(*place, "x", color=style.POINTED, markeredgewidth=1.8, markersize=7, linestyle="none")
    return cross


def _round_ticks(low: float, high: float) -> list[float]:
    """A few round numbers from low to high: 1, 2, 5 times powers of ten, or finer ones if these are fewer than three."""
    ticks: list[float] = []
    lowest_power = math.floor(math.log10(low))
    highest_power = math.ceil(math.log10(high))
    decades = 10.0 ** np.arange(lowest_power, highest_power + 1)
    tenths = tuple(0.1 * k for k in range(10, 100))  # 1.0 to 9.9
    for digits in ((1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0), tenths):
        round_numbers = np.outer(decades, digits).ravel().tolist()
        ticks = [tick for tick in round_numbers if low <= tick <= high]
        if len(ticks) >= 3:
            break
    return ticks


_MAX_DISTANCE_SHARE = 1e-6
"""Distance of a corner from a face, as a share of the face's force plus 1 N, up to which the corner is in the face."""
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
    largest = report.largest
    carried = carried_words(report)
    place = place_words(report.frame, report.com)
    title = f"{report.robot.name} · {_mass_text(largest)} at {place}, by torque limits only"
    if carried:
        title += f", beside {carried}"
    row_count = 1 if report.map is None else 2
    with style.figure(10.5, 4.6 * row_count, title) as drawn:  # inches
        pose_part, *map_parts = cast("Any", drawn.subfigures(row_count, 1, squeeze=False)).ravel()
        left, right = pose_part.subfigures(1, 2, width_ratios=[1.15, 1])
        _draw_forces(left, report.robot, report.q, report.frame, report.limits.effort)
        _draw_shares(right.subplots(), largest, carried)
        if report.map is not None:
            tip_pose = np.asarray(report.robot.forward_kinematics(report.q, report.frame))
            pose_payload = float(largest.mass) if largest.holds else 0.0
            draw_map(map_parts[0], report.map, tip_pose[:3, 3], pose_payload)
        style.save(drawn, path)


def _mass_text(largest: LargestPayload) -> str:
    """Largest payload, as in the title of its figure."""
    if not largest.holds:
        return "no payload"
    if np.isinf(largest.mass):
        return "any payload"
    return f"largest payload {rounded_down(largest.mass)} kg"


def _draw_forces(part: Any, robot: Robot, q: Array, frame: str, limits: Array) -> None:
    """Draw polytope, ellipsoid and weakest direction of the forces, or the reason why they are unknown, in a subfigure."""
    try:
        polytope = wrench_polytope(robot, q, frame, limits=limits)
        ellipsoid = wrench_ellipsoid(robot, q, frame, limits=limits)  # in units of the torque limits
    except ValueRangeError as problem:
        axis = part.subplots()
        axis.set_axis_off()
        axis.text(0.5, 0.5, str(problem), ha="center", va="center", wrap=True, color=style.QUIET)
        return
    borne_count = polytope.borne.shape[1]  # directions in which the structure bears forces without torques
    legend_place: dict[str, Any] = {}
    if borne_count == 0:
        axis = part.add_subplot(projection="3d", computed_zorder=False)
        _draw_solid(axis, polytope, ellipsoid)
        draw_weakest = _draw_weakest_in_space
    elif borne_count == 1:
        axis = part.subplots()
        _draw_section(axis, polytope, ellipsoid)
        draw_weakest = _draw_weakest_in_plane
        legend_place = {"bbox_to_anchor": (0.0, -0.14)}  # below the axes: a plane plot has no room for it
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
    _, _, right_vectors = np.linalg.svd(polytope.borne.T)
    free_direction = right_vectors[-1]  # across the two borne directions
    largest_component = np.argmax(np.abs(free_direction))
    if free_direction[largest_component] <= 0:
        free_direction = -free_direction
    forces = polytope.vertices @ free_direction
    return (
        "The structure bears forces in two directions here.\n"
        f"Along the third, {_direction_text(free_direction)}: {number(forces.min())} to {number(forces.max())} N"
    )


def _draw_solid(axis: Any, polytope: WrenchPolytope, ellipsoid: WrenchEllipsoid) -> None:
    """Draw polytope and ellipsoid of the forces in space."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    corners_by_face = [_face(polytope, n, b) for n, b in zip(polytope.normals, polytope.offsets, strict=True)]
    polygons = [corners for corners in corners_by_face if len(corners) >= 3]
    options: dict[str, Any] = {"facecolor": style.SKY, "edgecolor": style.LINE, "linewidth": 0.8, "alpha": 0.22}
    faces = Poly3DCollection(polygons, zorder=1, **options)
    faces.set_label(_POLYTOPE_LABEL)
    axis.add_collection3d(faces)
    azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(0, np.pi, 19))  # in steps of 10°
    ball = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=-1
    )  # unit vectors
    shell = (ball * ellipsoid.semi_axes) @ ellipsoid.axes.T
    axis.plot_wireframe(
        shell[..., 0], shell[..., 1], shell[..., 2], color=style.AMBER, linewidth=0.6, rstride=2, cstride=2, zorder=2,
        label=_ELLIPSOID_LABEL,
    )  # fmt: skip
    points = np.concatenate([polytope.vertices, shell.reshape(-1, 3)])
    low = points.min(axis=0)
    high = points.max(axis=0)
    centre = (low + high) / 2
    half_range = 0.5 * (high - low).max()  # of all axes alike
    for k, letter in enumerate("xyz"):
        label_distance = 7 if letter == "y" else 3  # points; tick labels of y are wider
        set_limits = getattr(axis, f"set_{letter}lim")
        set_label = getattr(axis, f"set_{letter}label")
        set_limits(centre[k] - half_range, centre[k] + half_range)
        set_label(f"f{letter} [N]", fontsize=style.SMALL_FONT, labelpad=label_distance)
    axis.tick_params(labelsize=7, pad=1)
    axis.tick_params(axis="z", pad=4)
    axis.set_box_aspect((1, 1, 1))


def _face(polytope: WrenchPolytope, n: Array, b: float) -> Array:
    """Corners (k, 3) of the polytope in the plane n · x = b, in order around its face."""
    distances = np.abs(polytope.vertices @ n - b)
    corners = polytope.vertices[distances <= _MAX_DISTANCE_SHARE * (1 + np.abs(b))]
    if len(corners) < 3:
        return corners
    spokes = corners - corners.mean(axis=0)
    x_axis = spokes[0] / np.linalg.norm(spokes[0])
    y_axis = np.cross(n, x_axis)
    angles = np.arctan2(spokes @ y_axis, spokes @ x_axis)
    return corners[np.argsort(angles)]


def _draw_section(axis: Any, polytope: WrenchPolytope, ellipsoid: WrenchEllipsoid) -> None:
    """Draw the forces of a planar robot in its plane."""
    x_axis, y_axis = _plane(polytope)
    corners = np.column_stack([polytope.vertices @ x_axis, polytope.vertices @ y_axis])
    spokes = corners - corners.mean(axis=0)
    corner_angles = np.arctan2(spokes[:, 1], spokes[:, 0])
    ring = corners[np.argsort(corner_angles)]
    axis.fill(*ring.T, facecolor=style.SKY, edgecolor=style.LINE, alpha=0.35, label=_POLYTOPE_LABEL)
    angles = np.linspace(0, 2 * np.pi, 181)  # in steps of 2°
    directions = np.cos(angles)[:, None] * x_axis + np.sin(angles)[:, None] * y_axis
    forces = ellipsoid.reach(directions)  # largest force in each direction
    axis.plot(forces * np.cos(angles), forces * np.sin(angles), color=style.AMBER, label=_ELLIPSOID_LABEL)
    axis.set_aspect("equal", "datalim")
    axis.margins(0.12)
    axis.set_xlabel(f"force along {_direction_text(x_axis)} [N]")
    axis.set_ylabel(f"force along {_direction_text(y_axis)} [N]")


def _plane(polytope: WrenchPolytope) -> tuple[Array, Array]:
    """Unit vectors across the borne direction: near the base's x or y axis, and across it, upwards."""
    n = polytope.borne[:, 0]
    axes_in_plane = np.eye(3) - np.outer(n, n)  # rows: base axes projected onto the plane
    x_in_plane, y_in_plane, _ = axes_in_plane
    horizontal = x_in_plane
    if not np.linalg.norm(x_in_plane) > 0.5:  # the plane is nearly across x
        horizontal = y_in_plane
    horizontal = horizontal / np.linalg.norm(horizontal)
    upward = np.cross(n, horizontal)
    largest_component = np.argmax(np.abs(upward))
    if upward[largest_component] <= 0:
        upward = -upward
    return horizontal, upward


def _direction_text(direction: Array) -> str:
    """Name of a base axis, or components of a direction."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) > 1 - 1e-9:  # rounding errors
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
    start_and_tip = np.stack([np.zeros(3), tip], axis=1)  # rows x, y, z
    axis.plot(
        *start_and_tip,
        color=style.POINTED,
        linewidth=3,
        label=label,
        zorder=10,
        path_effects=rim,
    )
    for place, colour, size in (((0, 0, 0), style.INK, 6), (tip, style.POINTED, 9)):
        x, y, z = place
        axis.plot([x], [y], [z], "o", color=colour, markersize=size, markeredgecolor=style.PAPER, zorder=11)


def _draw_weakest_in_plane(axis: Any, polytope: WrenchPolytope, tip: Array, label: str) -> None:
    """Draw the weakest force, up to the nearest side, which is drawn thick."""
    x_axis, y_axis = _plane(polytope)
    n = tip / np.linalg.norm(tip)
    distances = np.abs(polytope.vertices @ n - n @ tip)  # from the line of the nearest side
    side = polytope.vertices[distances <= _MAX_DISTANCE_SHARE * (1 + np.linalg.norm(tip))]
    axis.plot(side @ x_axis, side @ y_axis, color=style.POINTED, linewidth=2.5, alpha=0.5, zorder=9)
    x, y = tip @ x_axis, tip @ y_axis
    axis.plot([0, x], [0, y], color=style.POINTED, linewidth=3, label=label, zorder=10)
    axis.plot(0, 0, "o", color=style.INK, markersize=5, markeredgecolor=style.PAPER, zorder=11)
    axis.plot(x, y, "o", color=style.POINTED, markersize=8, markeredgecolor=style.PAPER, zorder=11)


def _draw_shares(axis: Any, largest: LargestPayload, carried: str) -> None:
    """Draw bars of the holding torques, as shares of the limits: thick with the largest payload, thin without it.

    ``carried`` is the text of other payloads; empty without any.
    """
    from matplotlib.patches import Patch

    bar_places = np.arange(len(largest.joint_names))
    limits = np.where(largest.limits > 0, largest.limits, np.inf)  # a limit of zero has no share to draw
    unloaded_shares = largest.unloaded / limits
    loaded_shares = largest.torques / limits
    is_over = over_limit(np.abs(loaded_shares))
    is_limiting = bar_places == int(largest.joint)
    colours = np.select([is_over, is_limiting], [style.OVER, style.NEAR], style.SKY).tolist()
    axis.barh(bar_places, loaded_shares, color=colours, height=0.62)
    axis.barh(bar_places, unloaded_shares, color=style.LINE, height=0.22)
    axis.axvline(0, color=style.AXIS, linewidth=0.7)
    max_share = 1.15 * max(1.0, float(np.abs(loaded_shares).max(initial=0)))  # end of the axis
    for limit in (-1, 1):
        axis.axvline(limit, **style.LIMIT)
        axis.axvspan(limit, 2 * limit * max_share, color=style.OVER, alpha=0.08, linewidth=0)  # beyond the axis' end
    axis.set_xlim(-max_share, max_share)
    axis.set_yticks(bar_places, [name.removesuffix("_joint") for name in largest.joint_names])
    axis.set_ylim(max(len(bar_places), 4) - 0.5, -0.5)  # downwards, with room for four bars at least
    axis.set_xlabel("torque as a share of its limit")
    axis.grid(visible=False, axis="y")
    style.titles(axis, "Holding torques")
    legend = {
        "robot as it is" if carried else "robot alone": style.LINE,
        "with the payload": style.SKY,
        "at its limit": style.NEAR,
    }
    if is_over.any():
        legend["over its limit"] = style.OVER
    patches = [Patch(color=colour, label=label) for label, colour in legend.items()]
    axis.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.45, -0.16), ncols=3)


complete(globals())
