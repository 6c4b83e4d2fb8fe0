"""Pictures of an identification: torques, residuals, friction, groups of parameters and bodies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..core.answers.page import MarkedJoint, Picture
from ..core.numbers import number, percent
from ..mechanics.joints.units import unit_of, units_of
from ..motion.coordinates import Coordinates
from ..viz import style
from ..viz.pictures import Plot, plot_picture, robot_picture
from ..viz.plots.diagnosis import VIEWS, draw_inertias
from ..viz.plots.motion import plot_motion

if TYPE_CHECKING:
    from .exciting_trajectory import ExcitingMotion
    from .result import IdentifiedRobot

_BAND, _MIN_OUTLIER = 1.96, 4.0
"""Standard deviations: half-width of a 95 % band, and threshold of marked residuals."""
_SPEEDS, _DEFAULT_SPEED = 201, 2.0
"""Number of points of a curve, and its maximum speed for joints without a limit [rad/s, m/s]."""
_BAR = 0.2
"""Width of each of the four bars of a joint, which has unit width."""
_LAWS = ("viscous", "coulomb", "stribeck", "offset")


def frictional(found: IdentifiedRobot) -> list[int]:
    """Joints with identified friction."""
    joints: list[int] = []
    for k, name in enumerate(found.original.velocity_names):
        laws = {f"{name}.{law}" for law in _LAWS[:3]}
        if not laws.isdisjoint(found.groups):
            joints.append(k)
    return joints


def draw_friction(grid: Any, found: IdentifiedRobot) -> None:
    """Draw friction over speed for each joint: viscous dq + coulomb tanh(dq / v) + offset, its 95 % band, and the file's."""
    kinds, model = Coordinates.from_model(found.original.model), found.original.model
    for axes, k in zip(grid, frictional(found), strict=True):
        name, turns = found.original.velocity_names[k], bool(kinds.angular_velocity[k])
        max_speed = float(model.limits.velocity[k])
        if not np.isfinite(max_speed):
            max_speed = _DEFAULT_SPEED
        dq = np.linspace(-1, 1, _SPEEDS) * max_speed
        eased = np.tanh(dq / found.settings.friction_speed[k])
        fading = np.exp(-((dq / found.base.unknown.stribeck_speed) ** 2))
        groups: list[int] = []
        parts: list[Any] = []
        for law, part in zip(_LAWS, (dq, eased, fading * eased, np.ones_like(dq)), strict=True):
            if f"{name}.{law}" in found.groups:
                groups.append(found.groups.index(f"{name}.{law}"))
                parts.append(part)
        columns = np.stack(parts, axis=1)
        torque = columns @ found.values[groups]
        variance = np.einsum("ni,ij,nj->n", columns, found.covariance.matrix[np.ix_(groups, groups)], columns)
        half = _BAND * np.sqrt(np.maximum(variance, 0.0))
        axes.fill_between(dq, torque - half, torque + half, color=style.PALE, linewidth=0, label="95 %")
        axes.plot(dq, torque, color=style.LINE, linewidth=1.2, label="identified")
        friction = model.friction
        before = friction.viscous[k] * dq + friction.coulomb[k] * eased
        axes.plot(dq, before, "--", color=style.VERMILION, linewidth=1, label="file")
        axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
        axes.set_title(f"{name} [{unit_of('tau', turns)}]", loc="left")
        axes.set_xlabel("speed [rad/s]" if turns else "speed [m/s]")
        axes.tick_params(labelsize=style.SMALL_FONT)
    grid[0].legend()


def draw_residuals(grid: Any, found: IdentifiedRobot) -> None:
    """Draw residual torques over time for held-out and training rows; outliers are marked."""
    kinds = Coordinates.from_model(found.original.model)
    for j, (axes, name) in enumerate(zip(grid, found.held_out.names, strict=True)):
        sigma = float(found.sigma[j])
        axes.axhspan(-_BAND * sigma, _BAND * sigma, color=style.PALE, linewidth=0, label="95 % of training rows")
        for rows in found.held_out.rows:
            left = rows.measured[:, j] - rows.predicted[:, j]
            far = np.abs(left) > _MIN_OUTLIER * sigma
            axes.plot(rows.time, left, ".", color=style.QUIET, markersize=1.5)
            axes.plot(rows.time[far], left[far], ".", color=style.VERMILION, markersize=2.5)
        axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
        axes.set_title(name, loc="left")
        axes.set_ylabel(unit_of("tau", bool(kinds.angular_velocity[j])))
    grid[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.97))  # above the points
    grid[-1].set_xlabel("time in its log [s]")


def draw_residual_bars(axes: style.Axes, found: IdentifiedRobot) -> None:
    """Draw the residual of each joint's torque for the file, the file with friction, groups and consistent bodies.

    Bars are cut off at the whole torque; larger values are written on them.
    """
    left, names = found.residuals, list(found.held_out.names)
    models = (
        ("file", left.file, style.PALE),
        ("file, friction fitted", left.with_friction, style.VERMILION),
        ("identified", left.identified, style.BLUE),
        ("physically consistent bodies", left.consistent, style.GREEN),
    )
    at = np.arange(len(names))
    for k, (label, shares, colour) in enumerate(models):
        x = at + (k - 1.5) * _BAR
        axes.bar(x, np.minimum(100 * shares, 100.0), _BAR, color=colour, label=label)
        for j in np.flatnonzero(shares > 1.0):
            axes.text(
                x[j], 99.0, f"{percent(shares[j], 3)}", rotation=90, ha="center", va="top", fontsize=style.SMALL_FONT
            )
    axes.set_xticks(at, names, fontsize=style.SMALL_FONT)
    axes.set_ylabel("% unexplained, 5-fold cross-validation")
    axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def draw_bodies(grid: Any, found: IdentifiedRobot) -> None:
    """Draw inertia ellipsoids of the moving bodies from the file and identified: a row per body, a view per axis."""
    unknown, inertias = found.base.unknown, found.consistent.inertias
    for row, i in zip(grid, unknown.bodies, strict=True):
        body = unknown.model.bodies[i]
        pair = [(inertias[i], style.BLUE, "-", "identified"), (body.inertia, style.VERMILION, "--", "file")]
        for axes, view in zip(row, VIEWS, strict=True):
            draw_inertias(axes, pair, view)
        row[0].set_title(body.link, loc="left")
    grid[0][2].legend(loc="upper right")


# ── The figure and the page of an identification

_MOST_GROUPS, _NAMED_GROUPS, _LONGEST_NAME = 80, 30, 22
_ABREAST = 4
_PURPOSE = "Drawing the identification"


def identification_plots(found: IdentifiedRobot) -> Mapping[str, Plot]:
    """Kinds of plots of an identification."""
    return {"identification": lambda path: plot_identification(found, path)}


def excitation_plots(found: ExcitingMotion) -> Mapping[str, Plot]:
    """Kinds of plots of an exciting motion."""
    return {"motion": lambda path: plot_motion(found.motion, path, found.bounds, friction=True)}


def pictures_of_plots(plots: Mapping[str, Plot]) -> Iterable[Picture]:
    """Each plot as a picture of a page; none if matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        return []
    return [plot_picture(kind, plot) for kind, plot in plots.items()]


def plot_identification(found: IdentifiedRobot, path: Any) -> Path:
    """Draw measured and predicted torques of held-out rows, groups with intervals, and the weight of the prior."""
    names = found.held_out.names
    height = 2.1 * len(names) + 4.6
    title = f"{found.original.name}: {found.verdict.word}, {percent(found.held_out.all, 3)} left in rows held out"
    with style.figure(11.0, height, title, _PURPOSE) as drawn:
        upper, lower = cast("Any", drawn.subfigures(2, 1, height_ratios=[2.1 * len(names), 4.4]))
        _torques(upper, found)
        left, right = lower.subplots(1, 2, width_ratios=[3, 2])
        _groups(left, found)
        _pull(right, found)
        return style.save(drawn, path)


def identification_pictures(found: IdentifiedRobot) -> list[Picture]:
    """Pictures of the report: robot, torques, residuals, friction, groups, the weight of the prior, and bodies."""
    if find_spec("matplotlib") is None:
        return []
    marked = None
    if found.worst is not None:
        name, _ = found.worst
        marked = MarkedJoint(name, f"{name}, the largest share left unexplained")
    still = robot_picture(found.original, None, marked, found.original.name)
    return [still, *_plots_of_report(found)]


def _plots_of_report(found: IdentifiedRobot) -> list[Picture]:
    """Torques, residuals, friction, groups, the weight of the prior, and bodies."""
    names, count = found.held_out.names, len(found.base.unknown.bodies)
    friction = len(frictional(found))
    height = 2.3 * style.panel_grid(max(friction, 1), _ABREAST)[0]
    plots: list[tuple[str, float, float, Callable[[Any], None]]] = [
        ("Torques of rows held out", 10.0, 2.1 * len(names) + 0.6, lambda drawn: _torques(drawn, found)),
        ("Residuals", 10.0, 3.0, lambda drawn: draw_residual_bars(drawn.subplots(), found)),
        ("Residuals in time", 10.0, 1.2 * len(names) + 0.6, lambda drawn: draw_residuals(_rows(drawn, names), found)),
        ("Groups of parameters", 10.0, 4.4, lambda drawn: _groups(drawn.subplots(), found)),
        ("Physically consistent bodies: weight of the prior", 7.0, 3.0, lambda drawn: _pull(drawn.subplots(), found)),
        (
            "Bodies in the file and identified",
            9.0,
            2.5 * count,
            lambda d: draw_bodies(d.subplots(count, 3, squeeze=False), found),
        ),
    ]
    if friction:
        panels = ("Friction", 10.0, height, lambda d: draw_friction(style.panels(d, friction, _ABREAST), found))
        plots.insert(3, panels)
    return [Picture(name, style.page_svg(_plot(wide, high, draw, name))) for name, wide, high, draw in plots]


def _plot(width: float, height: float, draw: Callable[[Any], None], title: str) -> Callable[[Path], None]:
    """Function that draws a figure into a file."""

    def plot(path: Path) -> None:
        with style.figure(width, height, title, _PURPOSE) as drawn:
            draw(drawn)
            style.save(drawn, path)

    return plot


def _rows(drawn: Any, names: Sequence[str]) -> list[Any]:
    """One panel for each name, one below another."""
    return style.panels(drawn, len(names), 1, sharex=True)


def _torques(drawn: Any, found: IdentifiedRobot) -> None:
    """Draw measured and predicted torques of each joint, and below them residuals with their 95 % band."""
    parts = sorted(found.held_out.rows, key=lambda rows: (float(rows.log[0]), float(rows.time[0])))
    units = units_of("tau", Coordinates.from_model(found.original.model).angular_velocity)
    ends = dict[float, float]()
    for rows in parts:
        for log in np.unique(rows.log):
            ends[float(log)] = max(ends.get(float(log), 0.0), float(rows.time[rows.log == log].max()))
    logs = sorted(ends)
    offsets = dict(zip(logs, itertools.accumulate((ends[log] for log in logs[:-1]), initial=0.0), strict=True))
    names = found.held_out.names
    grid = drawn.subplots(2 * len(names), 1, sharex=True, squeeze=False, height_ratios=[3, 1.3] * len(names))[:, 0]
    for j, (name, above, below) in enumerate(zip(names, grid[::2], grid[1::2], strict=True)):
        colour, band = style.SERIES[j % len(style.SERIES)], _BAND * found.sigma[j]
        below.axhspan(-band, band, color=style.PALE, linewidth=0, label="95 % of residuals")
        for k, rows in enumerate(parts):
            t = rows.time + np.array([offsets[float(log)] for log in rows.log])
            predicted, measured, left = ("predicted", "measured", "residual") if k == 0 else (None, None, None)
            dot: dict[str, Any] = {"color": style.INK, "markersize": 3.2, "markeredgewidth": 0}
            above.plot(t, rows.predicted[:, j], color=colour, linewidth=1.6, label=predicted)
            above.plot(t, rows.measured[:, j], ".", label=measured, **dot)
            below.plot(t, rows.measured[:, j] - rows.predicted[:, j], ".", label=left, **dot | {"markersize": 2.2})
        below.axhline(0.0, color=style.AXIS, linewidth=0.7)
        share = found.held_out.joints[name]
        above.set_title(
            f"{name}: {percent(share, 3)} left" if math.isfinite(share) else f"{name}: no torque", loc="left"
        )
        for axes in (above, below):
            axes.set_ylabel(units[j])
    above, below = (axes.get_legend_handles_labels() for axes in grid[:2])
    grid[0].legend(above[0] + below[0], above[1] + below[1], ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    grid[-1].set_xlabel("time [s]")


def _groups(axes: style.Axes, found: IdentifiedRobot) -> None:
    """Draw groups with intervals, in units of the larger of file value and estimate; the file value is a tick."""
    half = found.covariance.half_width()
    size = np.maximum(np.maximum(np.abs(found.values), np.abs(found.prior.mean)), 1e-300)
    k = np.arange(min(len(size), _MOST_GROUPS))
    poor = (found.standard_deviations > 0.3 * np.abs(found.values))[k]
    for which, colour, name in ((~poor, style.GREEN, "determined"), (poor, style.AMBER, "poorly determined")):
        if which.any():
            at = k[which]
            y, bars = found.values[at] / size[at], np.clip(half[at] / size[at], 0, 2)
            axes.errorbar(at, y, bars, fmt="o", markersize=3, linewidth=1, color=colour, label=name)
    axes.plot(k, found.prior.mean[k] / size[k], "_", color=style.VERMILION, markersize=7, label="file")
    axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
    axes.set_ylim(-1.6, 1.6)
    if len(k) <= _NAMED_GROUPS:
        axes.set_xticks(k, [_short(found.groups[i]) for i in k], rotation=55, ha="right", rotation_mode="anchor")
        axes.tick_params(axis="x", labelsize=style.SMALL_FONT)
    else:
        axes.set_xlabel("group, in the order of the table")
    axes.set_ylabel("share of the larger of value and file")
    axes.legend(ncols=3, loc="lower right")


def _short(group: str) -> str:
    """Short name of a group: its first parameter."""
    first, plus, _ = group.partition(" + ")
    named = first if len(first) <= _LONGEST_NAME else f"{first[:_LONGEST_NAME]}…"
    return f"{named} + …" if plus else named


def _pull(axes: style.Axes, found: IdentifiedRobot) -> None:
    strengths, shares = np.array(found.consistent.curve).T
    axes.semilogx(strengths, 100 * shares, "o-", color=style.BLUE, markersize=3, label="physically consistent bodies")
    axes.axhline(100 * found.consistent.of_file, color=style.VERMILION, linewidth=1, label="the file's, with friction")
    axes.axvline(found.consistent.fit.strength, color=style.AXIS, linewidth=0.8, linestyle=":")
    axes.set_xticks(strengths, [number(x) for x in strengths])
    axes.minorticks_off()
    axes.tick_params(axis="x", labelsize=style.SMALL_FONT)
    axes.set_xlabel("weight of the prior γ")
    axes.set_ylabel("% left, held out")
    axes.set_ylim(bottom=0)
    axes.legend()
