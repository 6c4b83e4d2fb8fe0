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
    from ..core.estimation.cross_validation import HeldOutRows
    from .exciting_trajectory import ExcitingMotion
    from .result import IdentifiedRobot

_BAND = 1.96
"""Half-width of a 95 % band, in standard deviations."""
_MIN_OUTLIER = 4.0
"""Residual from which a row is marked, in standard deviations."""
_CURVE_POINTS = 201
"""Number of points of a curve."""
_DEFAULT_SPEED = 2.0
"""Maximum speed of a curve for joints without a limit [rad/s, m/s]."""
_BAR_WIDTH = 0.2
"""Width of each of the four bars of a joint; joints are 1 apart."""
_BAR_TEXT_TOP = 99.0
"""Upper end of a text in a bar that is cut off at 100 %."""


def joints_with_friction(found: IdentifiedRobot) -> list[int]:
    """Indices of velocities with identified friction; an offset alone is not friction."""
    joints: list[int] = []
    for k, name in enumerate(found.original.velocity_names):
        friction_groups = {f"{name}.viscous", f"{name}.coulomb", f"{name}.stribeck"}
        if not friction_groups.isdisjoint(found.groups):
            joints.append(k)
    return joints


def draw_friction(grid: Any, found: IdentifiedRobot) -> None:
    """Draw identified friction over speed for each joint, with its 95 % band, and the friction of the file.

    Friction is viscous dq + (coulomb + stribeck exp(-(dq / v_s)²)) tanh(dq / v_0) + offset.
    """
    model = found.original.model
    coordinates = Coordinates.from_model(model)
    for axes, k in zip(grid, joints_with_friction(found), strict=True):
        name = found.original.velocity_names[k]
        is_angular = bool(coordinates.angular_velocity[k])
        max_speed = float(model.limits.velocity[k])
        if not np.isfinite(max_speed):
            max_speed = _DEFAULT_SPEED
        dq = np.linspace(-1, 1, _CURVE_POINTS) * max_speed
        smooth_sign = np.tanh(dq / found.settings.friction_speed[k])
        static_excess = np.exp(-((dq / found.base.unknown.stribeck_speed) ** 2))
        column_by_law = {
            "viscous": dq,
            "coulomb": smooth_sign,
            "stribeck": static_excess * smooth_sign,
            "offset": np.ones_like(dq),
        }
        groups: list[int] = []
        columns: list[Any] = []
        for law, column in column_by_law.items():
            if f"{name}.{law}" in found.groups:
                groups.append(found.groups.index(f"{name}.{law}"))
                columns.append(column)
        W = np.stack(columns, axis=1)  # torque per unit of each group, (points, groups)
        torque = W @ found.values[groups]
        covariance = found.covariance.matrix[np.ix_(groups, groups)]
        variance = np.einsum("ni,ij,nj->n", W, covariance, W)
        half_width = _BAND * np.sqrt(np.maximum(variance, 0.0))
        axes.fill_between(dq, torque - half_width, torque + half_width, color=style.PALE, linewidth=0, label="95 %")
        axes.plot(dq, torque, color=style.LINE, linewidth=1.2, label="identified")
        # of the file, only viscous and Coulomb friction are drawn
        file_torque = model.friction.viscous[k] * dq + model.friction.coulomb[k] * smooth_sign
        axes.plot(dq, file_torque, "--", color=style.VERMILION, linewidth=1, label="file")
        axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
        axes.set_title(f"{name} [{unit_of('tau', is_angular)}]", loc="left")
        axes.set_xlabel("speed [rad/s]" if is_angular else "speed [m/s]")
        axes.tick_params(labelsize=style.SMALL_FONT)
    grid[0].legend()


def draw_residuals(grid: Any, found: IdentifiedRobot) -> None:
    """Draw residual torques of held-out rows over time, with the 95 % band of training rows; outliers are marked."""
    coordinates = Coordinates.from_model(found.original.model)
    for j, (axes, name) in enumerate(zip(grid, found.held_out.names, strict=True)):
        sigma = float(found.sigma[j])
        axes.axhspan(-_BAND * sigma, _BAND * sigma, color=style.PALE, linewidth=0, label="95 % of training rows")
        for rows in found.held_out.rows:
            residuals = rows.measured[:, j] - rows.predicted[:, j]
            is_outlier = np.abs(residuals) > _MIN_OUTLIER * sigma
            axes.plot(rows.time, residuals, ".", color=style.QUIET, markersize=1.5)
            axes.plot(rows.time[is_outlier], residuals[is_outlier], ".", color=style.VERMILION, markersize=2.5)
        axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
        axes.set_title(name, loc="left")
        axes.set_ylabel(unit_of("tau", bool(coordinates.angular_velocity[j])))
    grid[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.97))  # above the points
    grid[-1].set_xlabel("time in its log [s]")


def draw_residual_bars(axes: style.Axes, found: IdentifiedRobot) -> None:
    """Draw the residual of each joint's torque for the file, the file with friction, groups and consistent bodies.

    Bars are cut off at 100 % of the torque; larger values are written on them.
    """
    residuals = found.residuals
    names = list(found.held_out.names)
    models = (  # label, share of each joint, colour
        ("file", residuals.file, style.PALE),
        ("file, friction fitted", residuals.with_friction, style.VERMILION),
        ("identified", residuals.identified, style.BLUE),
        ("physically consistent bodies", residuals.consistent, style.GREEN),
    )
    joint_places = np.arange(len(names))
    for k, (label, shares, colour) in enumerate(models):
        x = joint_places + (k - 1.5) * _BAR_WIDTH  # four bars about the joint's place
        axes.bar(x, np.minimum(100 * shares, 100.0), _BAR_WIDTH, color=colour, label=label)
        for j in np.flatnonzero(shares > 1.0):
            share_text = percent(shares[j], 3)
            axes.text(x[j], _BAR_TEXT_TOP, share_text, rotation=90, ha="center", va="top", fontsize=style.SMALL_FONT)
    axes.set_xticks(joint_places, names, fontsize=style.SMALL_FONT)
    axes.set_ylabel("% unexplained, 5-fold cross-validation")
    axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def draw_bodies(grid: Any, found: IdentifiedRobot) -> None:
    """Draw inertia ellipsoids of the moving bodies, identified and from the file: a row per body, a view per axis."""
    unknown = found.base.unknown
    inertias = found.consistent.inertias
    for axes_of_body, i in zip(grid, unknown.bodies, strict=True):
        body = unknown.model.bodies[i]
        identified = (inertias[i], style.BLUE, "-", "identified")
        ellipsoids = [identified, (body.inertia, style.VERMILION, "--", "file")]
        for axes, view in zip(axes_of_body, VIEWS, strict=True):
            draw_inertias(axes, ellipsoids, view)
        axes_of_body[0].set_title(body.link, loc="left")
    grid[0][2].legend(loc="upper right")


# ── The figure and the page of an identification

_MAX_GROUPS = 80
"""Largest number of groups that are drawn."""
_MAX_NAMED_GROUPS = 30
"""Largest number of groups whose names are written at the axis."""
_MAX_NAME_LENGTH = 22
"""Characters of a parameter's name at the axis."""
_MIN_POOR_DEVIATION = 0.3
"""Standard deviation of a group, as a share of its value, above which it is poorly determined."""
_MAX_BAR = 2.0
"""Largest half-width of a drawn interval, in units of the group's size."""
_MIN_SIZE = 1e-300
"""Smallest size of a group, so that zero is not divided by zero."""
_PANELS_IN_ROW = 4
_JOINT_HEIGHT = 2.1
"""Height of the torques and residuals of a joint [in]."""
_RESIDUAL_HEIGHT = 1.2
"""Height of the residuals of a joint in a picture of residuals alone [in]."""
_TITLE_HEIGHT = 0.6
"""Height of the title and the axis of time [in]."""
_PLOT_HEIGHTS = [3.0, 1.3]
"""Relative heights of the torques and of the residuals of a joint."""
_PURPOSE = "Drawing the identification"
"""Use of matplotlib, for the message if it is not installed."""


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
    torques_height = _JOINT_HEIGHT * len(names)
    title = f"{found.original.name}: {found.verdict.word}, {percent(found.held_out.all, 3)} left in rows held out"
    lower_height = 4.4  # groups and the weight of the prior [in]
    height = torques_height + 4.6  # with a margin
    with style.figure(11.0, height, title, _PURPOSE) as figure:
        upper, lower = cast("Any", figure.subfigures(2, 1, height_ratios=[torques_height, lower_height]))
        _draw_torques(upper, found)
        left, right = lower.subplots(1, 2, width_ratios=[3, 2])
        _draw_groups(left, found)
        _draw_prior_weights(right, found)
        return style.save(figure, path)


def identification_pictures(found: IdentifiedRobot) -> list[Picture]:
    """Pictures of the report: robot, torques, residuals, friction, groups, the weight of the prior, and bodies."""
    if find_spec("matplotlib") is None:
        return []
    worst_joint = None
    if found.worst is not None:
        name, _ = found.worst
        worst_joint = MarkedJoint(name, f"{name}, the largest share left unexplained")
    robot = robot_picture(found.original, None, worst_joint, found.original.name)
    return [robot, *_plots_of_report(found)]


def _plots_of_report(found: IdentifiedRobot) -> list[Picture]:
    """Torques, residuals, friction, groups, the weight of the prior, and bodies."""
    names = found.held_out.names
    body_count = len(found.base.unknown.bodies)
    friction_count = len(joints_with_friction(found))

    def draw_all_bodies(figure: Any) -> None:
        draw_bodies(figure.subplots(body_count, 3, squeeze=False), found)

    def draw_all_friction(figure: Any) -> None:
        draw_friction(style.panels(figure, friction_count, _PANELS_IN_ROW), found)

    # title, width and height [in], and function that draws into a figure
    torques_height = _JOINT_HEIGHT * len(names) + _TITLE_HEIGHT
    residuals_height = _RESIDUAL_HEIGHT * len(names) + _TITLE_HEIGHT
    plots: list[tuple[str, float, float, Callable[[Any], None]]] = [
        ("Torques of rows held out", 10.0, torques_height, lambda figure: _draw_torques(figure, found)),
        ("Residuals", 10.0, 3.0, lambda figure: draw_residual_bars(figure.subplots(), found)),
        ("Residuals in time", 10.0, residuals_height, lambda figure: draw_residuals(_panel_rows(figure, names), found)),
    ]
    if friction_count:
        panel_rows, _ = style.panel_grid(friction_count, _PANELS_IN_ROW)
        plots.append(("Friction", 10.0, 2.3 * panel_rows, draw_all_friction))
    prior_title = "Physically consistent bodies: weight of the prior"
    plots += [
        ("Groups of parameters", 10.0, 4.4, lambda figure: _draw_groups(figure.subplots(), found)),
        (prior_title, 7.0, 3.0, lambda figure: _draw_prior_weights(figure.subplots(), found)),
        ("Bodies in the file and identified", 9.0, 2.5 * body_count, draw_all_bodies),
    ]
    pictures = []
    for title, width, height, draw in plots:
        svg = style.page_svg(_plot(width, height, draw, title))
        pictures.append(Picture(title, svg))
    return pictures


def _plot(width: float, height: float, draw: Callable[[Any], None], title: str) -> Callable[[Path], None]:
    """Function that draws a figure into a file."""

    def plot(path: Path) -> None:
        with style.figure(width, height, title, _PURPOSE) as figure:
            draw(figure)
            style.save(figure, path)

    return plot


def _panel_rows(figure: Any, names: Sequence[str]) -> list[Any]:
    """One panel for each name, one below another."""
    return style.panels(figure, len(names), 1, sharex=True)


def _draw_torques(figure: Any, found: IdentifiedRobot) -> None:
    """Draw measured and predicted torques of each joint, and below them residuals with their 95 % band."""
    # parts of logs, by the number of the log, then by time
    parts = sorted(found.held_out.rows, key=lambda rows: (float(rows.log[0]), float(rows.time[0])))
    begins = _begins_of_logs(parts)
    units = units_of("tau", Coordinates.from_model(found.original.model).angular_velocity)
    names = found.held_out.names
    heights = _PLOT_HEIGHTS * len(names)
    grid = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights).ravel()
    for j, (name, torque_axes, residual_axes) in enumerate(zip(names, grid[::2], grid[1::2], strict=True)):
        colour = style.SERIES[j % len(style.SERIES)]
        half_width = _BAND * found.sigma[j]
        residual_axes.axhspan(-half_width, half_width, color=style.PALE, linewidth=0, label="95 % of residuals")
        for k, rows in enumerate(parts):
            begins_of_rows = np.array([begins[float(log)] for log in rows.log])
            t = rows.time + begins_of_rows
            # one entry in the legend for all parts
            predicted, measured, residual = ("predicted", "measured", "residual") if k == 0 else (None, None, None)
            dot: dict[str, Any] = {"color": style.INK, "markersize": 3.2, "markeredgewidth": 0}
            small_dot = dot | {"markersize": 2.2}
            torque_axes.plot(t, rows.predicted[:, j], color=colour, linewidth=1.6, label=predicted)
            torque_axes.plot(t, rows.measured[:, j], ".", label=measured, **dot)
            residual_axes.plot(t, rows.measured[:, j] - rows.predicted[:, j], ".", label=residual, **small_dot)
        residual_axes.axhline(0.0, color=style.AXIS, linewidth=0.7)
        share = found.held_out.joints[name]
        share_text = f"{percent(share, 3)} left" if math.isfinite(share) else "no torque"
        torque_axes.set_title(f"{name}: {share_text}", loc="left")
        torque_axes.set_ylabel(units[j])
        residual_axes.set_ylabel(units[j])
    torque_handles, torque_labels = grid[0].get_legend_handles_labels()
    residual_handles, residual_labels = grid[1].get_legend_handles_labels()
    handles = torque_handles + residual_handles
    labels = torque_labels + residual_labels
    grid[0].legend(handles, labels, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    grid[-1].set_xlabel("time [s]")


def _begins_of_logs(parts: Sequence[HeldOutRows]) -> dict[float, float]:
    """Time [s] at which each log begins in a plot with logs one after another, by number of the log."""
    ends = dict[float, float]()
    for rows in parts:
        for log in np.unique(rows.log):
            end = float(rows.time[rows.log == log].max())
            ends[float(log)] = max(ends.get(float(log), 0.0), end)
    logs = sorted(ends)
    begins = itertools.accumulate((ends[log] for log in logs[:-1]), initial=0.0)  # sums of the logs before
    return dict(zip(logs, begins, strict=True))


def _draw_groups(axes: style.Axes, found: IdentifiedRobot) -> None:
    """Draw groups with intervals, in units of the larger of file value and estimate; the file value is a tick."""
    half_widths = found.covariance.half_width()
    larger_value = np.maximum(np.abs(found.values), np.abs(found.prior.mean))
    size = np.maximum(larger_value, _MIN_SIZE)
    drawn_groups = np.arange(min(len(size), _MAX_GROUPS))
    is_poor = found.standard_deviations[drawn_groups] > _MIN_POOR_DEVIATION * np.abs(found.values[drawn_groups])
    series = (  # mask, colour, label
        (~is_poor, style.GREEN, "determined"),
        (is_poor, style.AMBER, "poorly determined"),
    )
    for mask, colour, label in series:
        if mask.any():
            groups = drawn_groups[mask]
            y = found.values[groups] / size[groups]
            bars = np.clip(half_widths[groups] / size[groups], 0.0, _MAX_BAR)
            axes.errorbar(groups, y, bars, fmt="o", markersize=3, linewidth=1, color=colour, label=label)
    file_shares = found.prior.mean[drawn_groups] / size[drawn_groups]
    axes.plot(drawn_groups, file_shares, "_", color=style.VERMILION, markersize=7, label="file")
    axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
    axes.set_ylim(-1.6, 1.6)  # values are from -1 to 1
    if len(drawn_groups) <= _MAX_NAMED_GROUPS:
        names = [_short_name(found.groups[group]) for group in drawn_groups]
        axes.set_xticks(drawn_groups, names, rotation=55, ha="right", rotation_mode="anchor")
        axes.tick_params(axis="x", labelsize=style.SMALL_FONT)
    else:
        axes.set_xlabel("group, in the order of the table")
    axes.set_ylabel("share of the larger of value and file")
    axes.legend(ncols=3, loc="lower right")


def _short_name(group: str) -> str:
    """Short name of a group: its first parameter."""
    parameter, plus, _ = group.partition(" + ")
    if len(parameter) > _MAX_NAME_LENGTH:
        parameter = f"{parameter[:_MAX_NAME_LENGTH]}…"
    return f"{parameter} + …" if plus else parameter


def _draw_prior_weights(axes: style.Axes, found: IdentifiedRobot) -> None:
    """Draw the held-out residual of consistent bodies over the weight of the prior, and the residual of the file's bodies."""
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
