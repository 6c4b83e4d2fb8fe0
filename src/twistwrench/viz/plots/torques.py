"""Plots of the torque report: joint torques with limits, contributions of the worst joint, motors in speed–torque regions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import numpy as np

from ...core.numbers import deviation, margin, number, over_limit, percent_of_limit, seconds
from ...core.typing import Array
from ...mechanics.joints.units import torque_word
from ...motion.load_case import cause_label
from ...reports.motors import MotorUse
from ...reports.statistics import INTERVAL
from ...reports.torque_report import ZERO, JointTorque, TorqueReport
from ...sizing.choice import SizedJoint, Sizing
from ...sizing.drives import hot_motor
from .. import style

_MIN_INTERVAL_SHARE = 0.02
"""Smallest half-width of an interval that is drawn, as a share of the curve's range."""
_MIN_RANGE_SHARE = 0.1
"""Minimum range of a joint's axis on either side, as a share of its limit, so that small torques look small."""
_MIN_SHARE_OF_DRAWN_LIMIT = 0.3
"""Share of its limit that a curve must reach for the limit to be drawn; otherwise it would flatten the curve."""


def plot_report(report: TorqueReport, path: str | Path) -> None:
    """Plot a torque report: torques over time, and their contributions.

    Parameters
    ----------
    report : TorqueReport
    path : str or Path; the suffix selects the format (.png, .pdf, .svg)
    """
    count = len(report.joints)
    rows, columns = style.panel_grid(count)
    height = 1.95 * rows + 0.3
    width = max(7.5, 11.25 if columns == 3 else 3.2 * columns)
    with style.figure(width, height + 3.4, report_title(report), "Drawing the report") as drawn:
        upper, lower = cast("Any", drawn.subfigures(2, 1, height_ratios=[height, 3.1]))
        if report.noisy:
            _draw_noise_legend(upper, report)
        for k, axis in enumerate(style.panels(upper, count, sharex=True)):
            _draw_joint(axis, report, k, last=k + columns >= count)
        if report.worst is not None:
            _draw_contributions(lower.subplots(), report, report.worst)
        style.save(drawn, path)


def report_title(report: TorqueReport) -> str:
    """Title of a torque report in one line: robot, motion and loads.

    Parameters
    ----------
    report : TorqueReport

    Returns
    -------
    text : str
    """
    payload_masses = " + ".join(f"{number(payload.mass)} kg" for payload in report.load.payloads)
    parts = [report.robot, Path(report.trajectory).stem]
    if payload_masses:
        parts.append(f"payload {payload_masses}")
    if report.load.wrenches:
        parts.append(f"wrench on {', '.join(report.load.wrenches)}")
    if not report.load.friction:
        parts.append("without friction")
    return " · ".join(parts)


def _break_at_gaps(time: Array, threshold: float, *curves: Array) -> list[Array]:
    """Time and curves with nan inserted in every step longer than ``threshold``, to break lines there."""
    if len(time) < 3 or not math.isfinite(threshold):
        return [time, *curves]
    steps = np.diff(time)
    usual_step = float(np.median(steps))
    max_step = max(threshold, 1.5 * usual_step)
    if usual_step > threshold / 2:  # a bin of several rows: the rows beside a gap are up to a bin apart, too
        max_step = max(max_step, usual_step + threshold)
    after_gap = np.flatnonzero(steps > max_step) + 1
    broken_curves = [np.insert(curve, after_gap, np.nan) for curve in curves]
    return [np.insert(time, after_gap, time[after_gap - 1]), *broken_curves]


def _draw_joint(axis: style.Axes, report: TorqueReport, k: int, *, last: bool) -> None:
    """Draw a joint's torque with its peak and its limits."""
    joint = report.joints[k]
    over = over_limit(joint.share)
    colour = style.OVER if over else style.LINE
    axis.axhline(0, color=style.QUIET, linewidth=0.6)
    if report.derived is not None:  # pale, and clipped if it would flatten the main curve
        _draw_band(axis, report, report.derived.envelope, k, style.PALE, 1)
    time, least, greatest = _draw_band(axis, report, report.envelope, k, style.LINE, 3)
    if report.band is not None:
        band_time, lower, upper = report.band
        time, low, high = _break_at_gaps(band_time, report.gaps.threshold, lower[:, k], upper[:, k])
        axis.fill_between(time, low, high, color=style.SKY, alpha=0.35, linewidth=0, zorder=2)
    bottom, top = float(np.nanmin(least)), float(np.nanmax(greatest))
    half_interval = 0.0
    if report.noisy:
        half_interval = INTERVAL * report.reach(joint)
    if half_interval > _MIN_INTERVAL_SHARE * (top - bottom):
        axis.errorbar(joint.time, joint.peak, yerr=half_interval, color=colour, linewidth=1.2, capsize=2.5, zorder=4)
    bottom, top = min(bottom, joint.peak - half_interval), max(top, joint.peak + half_interval)
    _frame_limits(axis, joint, bottom, top, max_min_range=report.scale)
    _draw_peak(axis, report, joint, colour)
    remark = joint.unit
    if math.isfinite(joint.limit):
        remark = f"{percent_of_limit(joint.share)} of {number(joint.limit)} {joint.unit}"
    style.titles(axis, joint.joint, remark, style.OVER if over else style.QUIET)
    axis.set_ylabel(joint.unit, color=style.QUIET, fontsize=style.SMALL_FONT)
    axis.margins(x=0)
    if last:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel("time [s]", color=style.QUIET, fontsize=style.SMALL_FONT)


def _draw_peak(axis: style.Axes, report: TorqueReport, joint: JointTorque, colour: str) -> None:
    """Draw the peak as a point, with its value beside it: towards the middle of the time, away from zero."""
    peak = 0.0 if report.is_zero(joint.peak) else joint.peak
    axis.plot(joint.time, peak, "o", color=colour, markersize=4.5, markeredgecolor=style.PAPER, zorder=5)
    dx, horizontal = 5, "left"
    if joint.time > 0.6 * report.end + 0.4 * report.begin:
        dx, horizontal = -5, "right"
    dy, vertical = 4, "bottom"
    if joint.peak < 0:
        dy, vertical = -4, "top"
    axis.annotate(
        report.label(joint.peak),
        (joint.time, joint.peak),
        xytext=(dx, dy),
        textcoords="offset points",
        ha=horizontal,
        va=vertical,
        color=colour,
        fontsize=style.SMALL_FONT,
        bbox={"facecolor": style.PAPER, "edgecolor": "none", "alpha": 0.7, "pad": 0.8},
    )


def _draw_noise_legend(figure: Any, report: TorqueReport) -> None:
    """Draw the legend of a noisy log."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Any] = [
        Line2D([], [], color=style.LINE, label="less noise"),
        Patch(color=style.SKY, alpha=0.35, linewidth=0, label="95 % of single torques"),
        Line2D([], [], color=style.LINE, marker="|", markersize=8, linestyle="none", label="95 % interval of the peak"),
    ]
    if report.derived is not None:
        entries.append(Patch(color=style.PALE, label="raw"))
    figure.legend(handles=entries, loc="outside upper right", ncols=4)


def _draw_band(
    axis: style.Axes, report: TorqueReport, envelope: tuple[Array, Array, Array], k: int, colour: str, order: float
) -> tuple[Array, Array, Array]:
    """Draw a joint's torque as a band between the minimum and maximum of each bin of rows; returns the drawn arrays."""
    max_zero = ZERO * report.scale
    bin_time, minima, maxima = envelope
    low = np.where(np.abs(minima[:, k]) <= max_zero, 0.0, minima[:, k])
    high = np.where(np.abs(maxima[:, k]) <= max_zero, 0.0, maxima[:, k])
    time, least, greatest = _break_at_gaps(bin_time, report.gaps.threshold, low, high)
    axis.fill_between(time, least, greatest, color=colour, linewidth=0, zorder=order)
    for edge in (least, greatest):  # a band of zero width shows as a line
        axis.plot(time, edge, color=colour, linewidth=1.0, zorder=order)
    return time, least, greatest


def _frame_limits(axis: style.Axes, joint: JointTorque, low: float, high: float, *, max_min_range: float) -> None:
    """Set the displayed torque range: the curve with room for its label, and each limit that the curve comes near.

    On either side the range is at least a tenth of the limit, or ``max_min_range`` if that is less.
    """
    span = max(high, 0.0) - min(low, 0.0) or 1.0
    bottom, top = min(low, 0.0) - 0.2 * span, max(high, 0.0) + 0.2 * span
    for side, extreme in ((-1, -low), (1, high)):
        if not math.isfinite(joint.limit) or extreme < _MIN_SHARE_OF_DRAWN_LIMIT * joint.limit:
            continue
        beyond_limit = 1.15 * side * joint.limit
        bottom, top = min(bottom, beyond_limit), max(top, beyond_limit)
        axis.axhline(side * joint.limit, **style.LIMIT)
        shaded_to = side * 100 * max(joint.limit, span)  # far outside the picture
        axis.axhspan(side * joint.limit, shaded_to, color=style.OVER, alpha=0.08, linewidth=0)
    if math.isfinite(joint.limit):
        min_range = min(_MIN_RANGE_SHARE * joint.limit, max_min_range)
        bottom, top = min(bottom, -min_range), max(top, min_range)
    axis.set_ylim(bottom, top)


def _draw_contributions(axis: style.Axes, report: TorqueReport, k: int) -> None:
    """Draw the contributions to a joint's torque around its peak."""
    joint, states = report.joints[k], report.around
    terms = report.load.terms(states)
    torques = [report.load.drive_torques(values)[:, k] for values in terms.values()]
    time, *parts = _break_at_gaps(states.time, report.gaps.threshold, *torques)
    areas = []
    for name, part in zip(terms, parts, strict=True):
        if np.nanmax(np.abs(part), initial=0.0) > ZERO * report.scale:
            areas.append((cause_label(name), style.CAUSES[name], part))
    _, below, above = style.stack(axis, time, areas)
    axis.plot(time, np.sum(parts, axis=0), color=style.INK, linewidth=1.3, label="total")
    axis.axhline(0, color=style.AXIS, linewidth=0.7)
    axis.axvline(joint.time, color=style.INK, linewidth=0.8, linestyle=":")
    _frame_limits(axis, joint, float(np.nanmin(below)), float(np.nanmax(above)), max_min_range=report.scale)
    title = f"{joint.joint}: contributions to its torque"
    if report.is_zero(joint.largest):
        title = f"{joint.joint}: no torque to give"
    if len(states) != report.rows:  # the picture shows a part of the motion
        title += f" around its peak, t = {seconds(time[0])} to {seconds(time[-1])} s"
    peak = report.label(joint.peak)
    if report.noisy:
        peak += f" ± {deviation(report.reach(joint))}"
    style.titles(axis, title, f"peak {peak} {joint.unit} at {seconds(joint.time)} s")
    axis.set_xlabel("time [s]")
    axis.set_ylabel(torque_word(joint.unit))
    axis.margins(x=0)
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="medium")


_MAX_PANELS_PER_ROW = 3
"""Maximum number of panels of motors in a row. Modern Robotics figure 8.10 has their operating points."""


def plot_motors(report: TorqueReport, path: str | Path) -> Path:
    """Plot the motors' loads, one panel each.

    Parameters
    ----------
    report : TorqueReport
    path : str or Path; the suffix selects the format (.png, .pdf, .svg)

    Returns
    -------
    path : Path of the written file
    """
    motors, title = report.motors, f"{report_title(report)} · motors"
    rows, columns = style.panel_grid(len(motors), _MAX_PANELS_PER_ROW)
    with style.figure(3.6 * columns + 0.6, 2.7 * rows + 1.0, title, "Drawing the motors") as drawn:
        axes = style.panels(drawn, len(motors), _MAX_PANELS_PER_ROW)
        handle_by_label: dict[str, Any] = {}
        for axis, motor in zip(axes, motors, strict=True):
            points = _draw_motor(axis, motor, (report.begin, report.end))
            handle_by_label |= _legend_entries(axis)
        _label_motor_axes(axes, columns)
        drawn.colorbar(points, ax=axes, label="time [s]", shrink=0.8, aspect=35)
        labels = list(handle_by_label)
        drawn.legend(list(handle_by_label.values()), labels, loc="outside lower left", ncols=4, markerscale=3)
        return style.save(drawn, path)


def _legend_entries(axis: Any) -> dict[str, Any]:
    """Handles of an axis by label; panels of motors share one legend."""
    handles, labels = axis.get_legend_handles_labels()
    return dict(zip(labels, handles, strict=True))


def plot_sizing(sizing: Sizing, path: str | Path) -> Path:
    """Plot a sizing: the cycle of each motor in its speed–torque region, with the winding temperature below.

    Parameters
    ----------
    sizing : Sizing
    path : str or Path; the suffix selects the format (.png, .pdf, .svg)

    Returns
    -------
    path : Path of the written file
    """
    joints = list(sizing.joints.values())
    rows, columns = style.panel_grid(len(joints), _MAX_PANELS_PER_ROW)
    width, height = 3.6 * columns + 0.6, 2.7 * rows + 0.8
    with style.figure(width, height + 2.6, "Motors over the cycle", "Drawing the drives") as drawn:
        upper, lower = cast("Any", drawn.subfigures(2, 1, height_ratios=[height, 2.5]))
        axes = style.panels(upper, len(joints), _MAX_PANELS_PER_ROW)
        handle_by_label: dict[str, Any] = {}
        for axis, joint in zip(axes, joints, strict=True):
            points = _draw_motor(axis, _motor_use(sizing, joint), (0.0, float(joint.cycle.time[-1])))
            handle_by_label |= _legend_entries(axis)
        _label_motor_axes(axes, columns)
        upper.colorbar(points, ax=axes, label="time [s]", shrink=0.8, aspect=35)
        labels = list(handle_by_label)
        upper.legend(list(handle_by_label.values()), labels, loc="outside lower left", ncols=4, markerscale=3)
        _draw_temperatures(lower.subplots(), joints)
        return style.save(drawn, path)


def _label_motor_axes(axes: list[Any], columns: int) -> None:
    """Label the speeds of the last panel of each column, and the torques of the first panel of each row."""
    for axis in axes[-columns:]:
        axis.set_xlabel("speed [rad/s]", fontsize=style.SMALL_FONT)
    for axis in axes[::columns]:
        axis.set_ylabel("torque at the rotor [N m]", fontsize=style.SMALL_FONT)


def _motor_use(sizing: Sizing, joint: SizedJoint) -> MotorUse:
    """Motor of a sized joint in the form of the motor report."""
    motor = hot_motor(sizing.catalog.motors[joint.drive[0]].motor, sizing.problem.ambient)
    limited = tuple(demand for demand in joint.motor.demands if math.isfinite(demand.limit))
    heat = motor.resistance * joint.motor.rms_current**2
    power = float(joint.motor.power.max())
    time = np.linspace(0.0, joint.cycle.time[-1], 2 * len(joint.cycle.time))  # uniform in time, for time averages
    speed = np.interp(time, joint.cycle.time, joint.motor.speed)
    torque = np.interp(time, joint.cycle.time, joint.motor.torque)
    return MotorUse(joint.joint, motor, limited, power, heat, time, speed, torque)


def _draw_temperatures(axis: style.Axes, joints: list[SizedJoint]) -> None:
    """Draw winding temperatures over one period of the repeated cycle."""
    with_thermal_data = []
    for joint in joints:
        temperatures = joint.motor.temperature
        if temperatures.size and np.isfinite(temperatures).all():
            with_thermal_data.append(joint)
    for k, joint in enumerate(with_thermal_data):
        temperature = joint.motor.temperature[:, 0]  # of the winding
        time = np.linspace(0.0, 1.0, len(temperature)) * joint.cycle.time[-1]
        if len(temperature) == len(joint.cycle.time):
            time = joint.cycle.time
        axis.plot(time, temperature, color=style.SERIES[k % len(style.SERIES)], label=joint.joint)
    axis.set_xlabel("time in the cycle [s]")
    axis.set_ylabel("winding [°C]")
    if with_thermal_data:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        style.titles(axis, "no thermal data")


def _draw_motor(axis: style.Axes, use: MotorUse, span: tuple[float, float]) -> Any:
    """Draw the capability of a motor, and the motion as points coloured by the time of ``span``; returns the points."""
    motor, speed, torque = use.motor, use.speed, use.torque
    max_speed = float(np.abs(speed).max(initial=0.0))
    speed_limit = min(motor.voltage / motor.torque_constant, motor.speed)
    if not math.isfinite(speed_limit):
        speed_limit = 1.5 * max_speed
    top = 1.05 * max(max_speed, speed_limit) or 1.0  # 1 for a motor at rest, whose axis needs a length
    w = np.linspace(-top, top, 401)
    currents = [current for current in (motor.current_continuous, motor.current_peak) if math.isfinite(current)]
    max_motor_torque = motor.torque_constant * max(currents, default=0.0)
    reach = 1.1 * max(max_motor_torque, float(np.abs(torque).max(initial=0.0))) or 1.0
    regions = ((motor.current_peak, style.SHORT, "intermittent"), (motor.current_continuous, style.LONG, "continuous"))
    for current, colour, name in regions:
        high = np.clip(motor.greatest_torque(w, current), -reach, reach)
        low = -np.clip(motor.greatest_torque(-w, current), -reach, reach)
        axis.fill_between(w, low, high, where=(high > low).tolist(), color=colour, linewidth=0)
        axis.text(
            0.97 * w[np.argmax(high > low)],
            0.96 * high.max(),
            name,
            va="top",
            fontsize=style.SMALL_FONT,
            color=style.AXIS,
        )
    max_torque, max_reverse = motor.greatest_torque(speed), motor.greatest_torque(-speed)
    within_torque = torque <= max_torque + margin(max_torque)
    within = np.asarray(within_torque & (-torque <= max_reverse + margin(max_reverse)))
    by_time: dict[str, Any] = {"c": use.time, "cmap": style.time_colours(), "vmin": span[0], "vmax": span[1]}
    points = axis.scatter(speed, torque, s=3, linewidths=0, label="this motion", zorder=3, rasterized=True, **by_time)
    if not within.all():
        axis.plot(speed[~within], torque[~within], ".", color=style.OVER, markersize=3, label="beyond the motor")
    rms = math.sqrt(float(np.mean(torque**2)))
    for level, label in ((rms, "rms torque, either way"), (-rms, None)):
        axis.axhline(level, color=style.INK, linewidth=0.8, linestyle=(0, (4, 3)), label=label)
    axis.axhline(0, color=style.QUIET, linewidth=0.6)
    axis.axvline(0, color=style.QUIET, linewidth=0.6)
    axis.set_xlim(-top, top)
    axis.set_ylim(-reach, reach)
    axis.locator_params(axis="x", nbins=5)
    remark = ""
    if use.tightest.share:
        remark = f"{use.tightest.what} {percent_of_limit(use.tightest.share)}"
    style.titles(axis, use.joint, remark, style.OVER if use.too_small else style.QUIET)
    return points
