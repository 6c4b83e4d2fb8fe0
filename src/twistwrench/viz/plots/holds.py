"""Plots of what holds a robot: contact forces, margins, use of the friction cones, zero moment point, load of a mounting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.glossary import complete
from ...core.numbers import number, seconds
from ...core.typing import Array
from ...mechanics.lie.labelled import WRENCH
from ...statics.contacts import contact_maps, tangents
from ...statics.reactions import MountingLoad
from ...statics.support import Support
from .. import style
from .robot_picture import draw

if TYPE_CHECKING:
    from ...robot import Robot

__all__ = ["plot_mounting", "plot_support"]

_ARROW_ORDER = 5.0
"""Drawing order (zorder) of the arrows, above the robot."""
_MAX_FORCE_LENGTH = 0.4
"""Length of the largest contact force in the picture, relative to the extent of the contacts."""
_ARROW_STYLE = {"arrowstyle": "-|>", "color": style.VERMILION, "linewidth": 1.8}
"""Style of a contact force."""
_MIN_DRAWN_FORCE = 1e-3
"""Share of the largest force below which a force has no arrow."""
_MAX_SPEED_FACTOR = 3.0
"""Factor of the speed above which margins are not drawn, unless all margins are larger."""
_MIN_RELATIVE_FRICTION = 1e-9
"""Largest friction, relative to the largest pressure, below which a contact carries nothing."""
_WIDTH = 9.6
"""Width of a figure [inches]."""
_ROW_HEIGHT = 3.0
"""Height of a row of plots [inches]."""


def plot_support(
    found: Support, path: str | Path, *, time: ArrayLike, robot: Robot | None = None, q: ArrayLike | None = None
) -> Path:
    """Plot of contact forces over a motion: margins, use of each friction cone, and the zero moment point in its polygon.

    With the robot, its picture at the row that sets the speed has an arrow for each contact force.

    Parameters
    ----------
    found : Support
    time : (n,) array_like [s]
    robot : Robot, optional; None: a single body
    q : (n, nq) array_like, optional, configurations of the robot

    Returns
    -------
    path : Path of the picture

    Raises
    ------
    ShapeError
        ``time`` or ``q`` has another number of rows.

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> wrench = np.zeros((20, 6)) - [0, 0, 0, 0, 0, 9.81]
    >>> pads = [tw.statics.Contact((0, y, 0), (0, -y, 0), friction=0.5, push=60.0) for y in (-0.02, 0.02)]
    >>> found = tw.statics.hold(wrench, pads)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_support(found, f"{folder}/grip.svg", time=np.linspace(0, 1, 20)).name
    'grip.svg'
    """
    row_count = len(found.holds)
    t = arguments.finite(arguments.one(time, "time", row_count), "time", row_count)
    points = np.broadcast_to([c.point for c in found.contacts], (row_count, len(found.contacts), 3))
    if robot is not None:
        configurations = arguments.finite([] if q is None else q, "q", robot.nq)
        q = np.broadcast_to(configurations, (row_count, robot.nq))
        _, points = contact_maps(robot, q, found.contacts)
    has_robot = robot is not None
    has_zero_moment_point = bool(np.isfinite(found.zmp).any())
    has_pictures = has_robot or has_zero_moment_point  # in the first row of plots
    has_curves = row_count > 1 or not has_pictures  # in the last row of plots
    plot_rows = int(has_pictures) + int(has_curves)
    with style.figure(_WIDTH, _ROW_HEIGHT * plot_rows, str(found), "Drawing contact forces") as drawn:
        grid = drawn.add_gridspec(plot_rows, 2)
        if has_robot:
            _draw_robot(drawn.add_subplot(grid[0, 0]), found, robot, q, points, t)
        if has_zero_moment_point:
            _draw_zero_moment_point(drawn.add_subplot(grid[0, 1]), found, t, points)
        if has_curves:
            _draw_margins(drawn.add_subplot(grid[-1, 0]), found, t)
            _draw_cones(drawn.add_subplot(grid[-1, 1]), found, t)
        return style.save(drawn, path)


def _draw_robot(axis: style.Axes, found: Support, robot: Any, q: Any, points: Array, t: Array) -> None:
    """Draw the robot with its contact forces at the row that sets the speed.

    If the contacts do not hold at that row, the nearest row at which they hold is drawn.
    """
    row = found.worst
    rows_that_hold = np.flatnonzero(found.holds)
    if not found.holds[row] and len(rows_that_hold):
        nearest = np.abs(rows_that_hold - row).argmin()
        row = int(rows_that_hold[nearest])
    axis.set_rasterization_zorder(_ARROW_ORDER)  # what is below the arrows is an image: a robot has thousands of faces
    camera = draw(axis, robot, q[row], inertia=False)
    moment = f"t = {seconds(float(t[row]))} s" if len(t) > 1 else "rest"
    title = f"Contact forces at {moment}"
    if not found.holds[row]:
        title = f"At {moment}: {found.how[row]}"
    style.titles(axis, title)
    forces = np.nan_to_num(found.forces[row])
    max_force = float(np.linalg.norm(forces, axis=1).max(initial=0.0))
    extent = float(np.ptp(points[row], axis=0).max(initial=0.0))
    if extent == 0.0:  # a single contact
        extent = 1.0  # [m]
    for point, force in zip(points[row], forces, strict=True):
        if np.linalg.norm(force) > _MIN_DRAWN_FORCE * max_force > 0:
            end_point = point + _MAX_FORCE_LENGTH * extent * force / max_force
            picture_points, _ = camera.project([point, end_point])
            start, end = picture_points
            axis.annotate("", end, start, arrowprops=_ARROW_STYLE, zorder=_ARROW_ORDER)
    axis.autoscale_view()


def _draw_zero_moment_point(axis: style.Axes, found: Support, t: Array, points: Array) -> None:
    """Draw the zero moment point over time in the polygon of the contacts at the row that sets the speed."""
    from scipy.spatial import ConvexHull, QhullError

    ground_points = points @ tangents(found.contacts[0].normal).T  # (n, c, 2): x and y of the contacts on the ground
    force_sizes = np.linalg.norm(np.nan_to_num(found.forces[found.worst]), axis=1)
    carries = force_sizes > 0
    if not carries.any():  # no forces are known, so all contacts are drawn
        carries[:] = True
    carrying_points = ground_points[found.worst, carries]
    try:
        corners = carrying_points[ConvexHull(carrying_points).vertices]
    except (QhullError, ValueError):  # contacts in one line
        corners = carrying_points
    axis.fill(*corners.T, color=style.PALE, zorder=0)
    axis.plot(*carrying_points.T, "o", color=style.AXIS, markersize=4, linestyle="none", label="contacts that carry")
    path_points = axis.scatter(found.zmp[:, 0], found.zmp[:, 1], c=t, s=6, cmap=style.time_colours(), zorder=3)
    label = f"t = {seconds(float(t[found.worst]))} s" if len(t) > 1 else "zero moment point"
    axis.plot(*found.zmp[found.worst], "x", color=style.POINTED, markersize=8, label=label)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="x [m]", ylabel="y [m]")
    if len(t) > 1:
        axis.figure.colorbar(path_points, ax=axis, label="time [s]")
    axis.legend(loc="lower right")
    style.titles(axis, "Zero moment point in the support polygon")


def _draw_margins(axis: style.Axes, found: Support, t: Array) -> None:
    """Draw the largest factor of the speed at which the contacts hold, and the least coefficient of friction."""
    min_speed = float(np.nanmin(found.speed, initial=np.inf))
    max_drawn_speed = _MAX_SPEED_FACTOR
    if np.isfinite(min_speed):
        max_drawn_speed = max(_MAX_SPEED_FACTOR, 1.5 * min_speed)  # half as much again as the smallest margin
    drawn_speeds = np.where(found.speed > max_drawn_speed, np.nan, found.speed)
    drawn_friction = np.where(np.isfinite(found.friction), found.friction, np.nan)
    axis.plot(t, drawn_speeds, color=style.BLUE, label="largest speed, × this one")
    axis.plot(t, drawn_friction, color=style.AMBER, label="least friction")
    axis.axhline(1.0, **style.LIMIT)
    fails = ~found.holds
    if fails.any():
        axis.fill_between(
            t, 0, 1, where=fails, transform=axis.get_xaxis_transform(), color=style.OVER, alpha=0.12, linewidth=0
        )
    axis.set(xlabel="time [s]", ylim=(0, None))
    axis.margins(x=0)
    axis.legend(loc="best")
    style.titles(axis, "Margins")


def _draw_cones(axis: style.Axes, found: Support, t: Array) -> None:
    """Draw the share of each friction cone that the contact's force uses; for a sole, the largest share of its corners."""
    normals = np.array([c.normal for c in found.contacts])
    normal_forces = np.einsum("nck,ck->nc", found.forces, normals)
    tangential_forces = np.linalg.norm(found.forces - normal_forces[..., None] * normals, axis=-1)
    pressures = normal_forces + np.array([c.pull for c in found.contacts])
    max_tangential = np.array([c.friction for c in found.contacts]) * pressures
    max_pressure = np.nanmax(np.abs(pressures), initial=1e-300)  # above 0, so that contacts without force do not carry
    carries = max_tangential > _MIN_RELATIVE_FRICTION * max_pressure
    divisor = np.where(max_tangential > 0, max_tangential, 1.0)
    shares = np.where(carries, tangential_forces / divisor, np.nan)
    contacts_by_frame = _contacts_by_frame(found)
    for k, (name, contact_indices) in enumerate(contacts_by_frame.items()):
        own_shares = shares[:, contact_indices]
        max_shares = np.where(np.isnan(own_shares), -np.inf, own_shares).max(axis=1)  # -inf where no contact carries
        percentages = np.where(np.isfinite(max_shares), 100 * max_shares, np.nan)
        axis.plot(t, percentages, color=style.SERIES[k % len(style.SERIES)], label=name)
    axis.axhline(100.0, **style.LIMIT)
    axis.set(xlabel="time [s]", ylabel="share [%]", ylim=(0, 110))
    axis.margins(x=0)
    axis.legend(loc="best", ncols=2)
    style.titles(axis, "Use of the friction cones")


def _contacts_by_frame(found: Support) -> dict[str, list[int]]:
    """Indices of contacts by the name of their frame or group; if all have one name, an entry for each contact."""
    contacts_by_frame: dict[str, list[int]] = {}
    for k, contact in enumerate(found.contacts):
        name = contact.frame or contact.group or f"contact {k + 1}"
        contacts_by_frame.setdefault(name, []).append(k)
    if len(contacts_by_frame) != 1 or len(found.contacts) == 1:
        return contacts_by_frame
    (name,) = contacts_by_frame  # the only name
    return {f"{name} {k + 1}": [k] for k in contacts_by_frame[name]}


def plot_mounting(load: MountingLoad, path: str | Path, *, time: ArrayLike, bolts: ArrayLike | None = None) -> Path:
    """Plot of the wrench on a mounting over a motion, with the axial and shear loads of its bolts.

    Parameters
    ----------
    load : MountingLoad
    time : (n,) array_like [s]
    bolts : (k, 2) array_like, optional, places of the bolts in the frame [m], as of :func:`twistwrench.statics.bolt_circle`

    Returns
    -------
    path : Path of the picture

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> motion = tw.check("ur5", "demo").motion
    >>> load = tw.statics.mounting_load(tw.robots.ur5(), motion.q, motion.dq, motion.ddq)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_mounting(load, f"{folder}/mounting.svg", time=motion.time).name
    'mounting.svg'
    """
    row_count = len(load.wrench)
    t = arguments.finite(arguments.one(time, "time", row_count), "time", row_count)
    bolt_loads = None if bolts is None else load.bolts(bolts)  # (n, k, 2): axial load and shear of each bolt
    plot_rows = 1 if bolt_loads is None else 2
    with style.figure(_WIDTH, _ROW_HEIGHT * plot_rows, str(load), "Drawing the load of a mounting") as drawn:
        axes = drawn.subplots(plot_rows, 2, sharex=True, squeeze=False)
        panels: list[tuple[str, Array, tuple[str, ...]]] = [  # title, values (n, curves), labels of the curves
            ("Force on the foundation [N]", load.wrench[:, 3:], WRENCH[3:]),
            ("Moment on the foundation [N m]", load.wrench[:, :3], WRENCH[:3]),
        ]
        if bolt_loads is not None:
            bolt_names = tuple(f"bolt {k + 1}" for k in range(bolt_loads.shape[1]))
            panels += [
                ("Axial load of the bolts, pull above 0 [N]", bolt_loads[..., 0], bolt_names),
                ("Shear of the bolts [N]", bolt_loads[..., 1], bolt_names),
            ]
        for axis, (title, values, labels) in zip(axes.ravel(), panels, strict=True):
            for k, label in enumerate(labels):
                axis.plot(t, values[:, k], color=style.SERIES[k % len(style.SERIES)], label=label)
            axis.margins(x=0)
            axis.legend(loc="best", ncols=3)
            max_value = float(np.abs(values).max(initial=0.0))
            style.titles(axis, title, f"largest {number(max_value, 4)}")
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        return style.save(drawn, path)


complete(globals())
