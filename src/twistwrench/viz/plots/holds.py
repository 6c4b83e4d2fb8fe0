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

_ARROWS = 5.0
"""Order of the arrows, above the robot."""
_MAX_FORCE_LENGTH = 0.4
"""Length of the largest contact force in the picture, relative to the extent of the contacts and the robot."""
_ARROW = {"arrowstyle": "-|>", "color": style.VERMILION, "linewidth": 1.8}
"""Style of a contact force."""
_MAX_SPEED_FACTOR = 3.0
"""Factor of the speed above which margins are not drawn."""


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
    t = arguments.finite(arguments.one(time, "time", len(found.holds)), "time", len(found.holds))
    points = np.broadcast_to([c.point for c in found.contacts], (len(t), len(found.contacts), 3))
    if robot is not None:
        q = np.broadcast_to(arguments.finite([] if q is None else q, "q", robot.nq), (len(t), robot.nq))
        _, points = contact_maps(robot, q, found.contacts)
    flat = bool(np.isfinite(found.zmp).any())
    seen, moves = robot is not None, len(t) > 1
    above = seen or flat
    along = int(moves or not above)
    with style.figure(9.6, 3.0 * (above + along), str(found), "Drawing contact forces") as drawn:
        grid = drawn.add_gridspec(above + along, 2)
        if seen:
            _draw_robot(drawn.add_subplot(grid[0, 0]), found, robot, q, points, t)
        if flat:
            _draw_zero_moment_point(drawn.add_subplot(grid[0, 1]), found, t, points)
        if along:
            _draw_margins(drawn.add_subplot(grid[-1, 0]), found, t)
            _draw_cones(drawn.add_subplot(grid[-1, 1]), found, t)
        return style.save(drawn, path)


def _draw_robot(axis: style.Axes, found: Support, robot: Any, q: Any, points: Array, t: Array) -> None:
    """Draw the robot at the row that sets the speed, with its contact forces; at one that holds if that row does not."""
    row = found.worst
    if not found.holds[row] and found.holds.any():
        row = int(np.flatnonzero(found.holds)[np.abs(np.flatnonzero(found.holds) - row).argmin()])
    axis.set_rasterization_zorder(_ARROWS)  # a robot is thousands of faces
    camera = draw(axis, robot, q[row], inertia=False)
    at = f"t = {seconds(float(t[row]))} s" if len(t) > 1 else "rest"
    style.titles(axis, f"Contact forces at {at}" if found.holds[row] else f"At {at}: {found.how[row]}")
    forces = np.nan_to_num(found.forces[row])
    largest = float(np.linalg.norm(forces, axis=1).max(initial=0.0))
    size = float(np.ptp(points[row], axis=0).max(initial=0.0)) or 1.0
    for p, f in zip(points[row], forces, strict=True):
        if np.linalg.norm(f) > 1e-3 * largest > 0:
            start, end = camera.project([p, p + _MAX_FORCE_LENGTH * size * f / largest])[0]
            axis.annotate(
                "",
                end,
                start,
                arrowprops={"arrowstyle": "-|>", "color": style.VERMILION, "linewidth": 1.8},
                zorder=_ARROWS,
            )
    axis.autoscale_view()


def _draw_zero_moment_point(axis: style.Axes, found: Support, t: Array, points: Array) -> None:
    """Draw the zero moment point over time in the polygon of the contacts at the row that sets the speed."""
    from scipy.spatial import ConvexHull, QhullError

    across = points @ tangents(found.contacts[0].normal).T
    carries = np.linalg.norm(np.nan_to_num(found.forces[found.worst]), axis=1) > 0
    at = across[found.worst, carries if carries.any() else slice(None)]
    try:
        corners = at[ConvexHull(at).vertices]
    except (QhullError, ValueError):  # contacts in one line
        corners = at
    axis.fill(*corners.T, color=style.PALE, zorder=0)
    axis.plot(*at.T, "o", color=style.AXIS, markersize=4, linestyle="none", label="contacts that carry")
    path = axis.scatter(found.zmp[:, 0], found.zmp[:, 1], c=t, s=6, cmap=style.time_colours(), zorder=3)
    label = f"t = {seconds(float(t[found.worst]))} s" if len(t) > 1 else "zero moment point"
    axis.plot(*found.zmp[found.worst], "x", color=style.POINTED, markersize=8, label=label)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="x [m]", ylabel="y [m]")
    if len(t) > 1:
        axis.figure.colorbar(path, ax=axis, label="time [s]")
    axis.legend(loc="lower right")
    style.titles(axis, "Zero moment point in the support polygon")


def _draw_margins(axis: style.Axes, found: Support, t: Array) -> None:
    """Draw factors of the speed that hold, and the least coefficient of friction."""
    least = float(np.nanmin(found.speed, initial=np.inf))
    most = max(_MAX_SPEED_FACTOR, 1.5 * least) if np.isfinite(least) else _MAX_SPEED_FACTOR
    speed = np.where(found.speed > most, np.nan, found.speed)
    axis.plot(t, speed, color=style.BLUE, label="largest speed, × this one")
    axis.plot(
        t, np.where(np.isfinite(found.friction), found.friction, np.nan), color=style.AMBER, label="least friction"
    )
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
    """Draw the share of each friction cone that the contact's force uses, the largest of the corners of a sole."""
    normals = np.array([c.normal for c in found.contacts])
    along = np.einsum("nck,ck->nc", found.forces, normals)
    slide = np.linalg.norm(found.forces - along[..., None] * normals, axis=-1)
    pressed = along + np.array([c.pull for c in found.contacts])
    most = np.array([c.friction for c in found.contacts]) * pressed
    used = np.where(
        most > 1e-9 * np.nanmax(np.abs(pressed), initial=1e-300), slide / np.where(most > 0, most, 1.0), np.nan
    )
    for k, (name, members) in enumerate(_frames(found).items()):
        largest = np.nanmax(np.where(np.isnan(used[:, members]), -np.inf, used[:, members]), axis=1)
        shown = np.where(np.isfinite(largest), 100 * largest, np.nan)
        axis.plot(t, shown, color=style.SERIES[k % len(style.SERIES)], label=name)
    axis.axhline(100.0, **style.LIMIT)
    axis.set(xlabel="time [s]", ylabel="share [%]", ylim=(0, 110))
    axis.margins(x=0)
    axis.legend(loc="best", ncols=2)
    style.titles(axis, "Use of the friction cones")


def _frames(found: Support) -> dict[str, list[int]]:
    """Contacts by frame, corners of a sole together; one by one if all are at one frame or in groups."""
    frames: dict[str, list[int]] = {}
    for k, c in enumerate(found.contacts):
        frames.setdefault(c.frame or c.group or f"contact {k + 1}", []).append(k)
    if len(frames) > 1 or len(found.contacts) == 1:
        return frames
    return {f"{name} {k + 1}": [k] for name, members in frames.items() for k in members}


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
    t = arguments.finite(arguments.one(time, "time", len(load.wrench)), "time", len(load.wrench))
    axial = None if bolts is None else load.bolts(bolts)
    with style.figure(9.6, 3.0 * (1 + (axial is not None)), str(load), "Drawing the load of a mounting") as drawn:
        axes = drawn.subplots(1 + (axial is not None), 2, sharex=True, squeeze=False)
        panels: list[tuple[str, Array, tuple[str, ...]]]
        panels = [("Force on the foundation [N]", load.wrench[:, 3:], WRENCH[3:])]
        panels += [("Moment on the foundation [N m]", load.wrench[:, :3], WRENCH[:3])]
        if axial is not None:
            names = tuple(f"bolt {k + 1}" for k in range(axial.shape[1]))
            panels += [("Axial load of the bolts, pull above 0 [N]", axial[..., 0], names)]
            panels += [("Shear of the bolts [N]", axial[..., 1], names)]
        for axis, (name, values, labels) in zip(axes.ravel(), panels, strict=True):
            for k, label in enumerate(labels):
                axis.plot(t, values[:, k], color=style.SERIES[k % len(style.SERIES)], label=label)
            axis.margins(x=0)
            axis.legend(loc="best", ncols=3)
            largest = float(np.abs(values).max(initial=0.0))
            style.titles(axis, name, f"largest {number(largest, 4)}")
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        return style.save(drawn, path)


complete(globals())
