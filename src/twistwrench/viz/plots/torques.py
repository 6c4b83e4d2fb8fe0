"""Plots of the torque report: joint torques with limits, contributions of the worst joint, motors in speed–torque regions."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
"""Share of its limit that a curve must reach for the limit to be drawn; otherwise the limit would flatten the curve."""
_LABEL_ROOM = 0.2
"""Room for a label above and below a curve, as a share of the curve's range."""
_FACTOR_PAST_LIMIT = 1.15
"""End of a torque axis, as a multiple of a drawn limit."""

# Sizes of figures [in].
_PANEL_WIDTH = 3.2
_MIN_WIDTH = 7.5
_WIDTH_OF_THREE_PANELS = 11.25
_PANEL_HEIGHT = 1.95
_TITLE_HEIGHT = 0.3
_CONTRIBUTIONS_HEIGHT = 3.1


def plot_report(report: TorqueReport, path: str | Path) -> None:
    """Plot a torque report: torques over time, and their contributions.

    Parameters
    ----------
    report : TorqueReport
    path : str or Path; the suffix selects the format (.png, .pdf, .svg)
    """
    joint_count = len(report.joints)
    rows, columns = style.panel_grid(joint_count)
    panels_height = _PANEL_HEIGHT * rows + _TITLE_HEIGHT
    width = max(_MIN_WIDTH, _PANEL_WIDTH * columns)
    if columns == 3:
        width = _WIDTH_OF_THREE_PANELS
    height = panels_height + (_CONTRIBUTIONS_HEIGHT + _TITLE_HEIGHT)
    with style.figure(width, height, report_title(report), "Drawing the report") as drawn:
        upper, lower = cast("Any", drawn.subfigures(2, 1, height_ratios=[panels_height, _CONTRIBUTIONS_HEIGHT]))
        if report.noisy:
            _draw_noise_legend(upper, report)
        for k, axis in enumerate(style.panels(upper, joint_count, sharex=True)):
            is_bottom_panel = k + columns >= joint_count  # no panel stands below it
            _draw_joint(axis, report, k, is_bottom_panel=is_bottom_panel)
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
    """Time and curves with nan inserted in the curves in every step longer than ``threshold``, to break lines there."""
    if len(time) < 3 or not math.isfinite(threshold):  # two rows have one step, which is the usual one
        return [time, *curves]
    steps = np.diff(time)
    usual_step = float(np.median(steps))
    max_step = max(threshold, 1.5 * usual_step)  # usual steps are never gaps
    is_binned = usual_step > threshold / 2  # a point is then a bin of several rows
    if is_binned:  # the step across a gap is longer than the gap by up to a bin
        max_step = max(max_step, usual_step + threshold)
    indices_after_gaps = np.flatnonzero(steps > max_step) + 1
    last_times = time[indices_after_gaps - 1]  # a time for each inserted nan
    broken_curves = [np.insert(curve, indices_after_gaps, np.nan) for curve in curves]
    return [np.insert(time, indices_after_gaps, last_times), *broken_curves]


def _draw_joint(axis: style.Axes, report: TorqueReport, k: int, *, is_bottom_panel: bool) -> None:
    """Draw a joint's torque with its peak and its limits."""
    joint = report.joints[k]
    is_over_limit = over_limit(joint.share)
    colour = style.OVER if is_over_limit else style.LINE
    axis.axhline(0, color=style.QUIET, linewidth=0.6)
    raw = report.derived  # torques of the unsmoothed log
    if raw is not None:  # pale, and clipped if they would flatten the main curve
        _draw_envelope(axis, report, raw.envelope, k, style.PALE, order=1)
    low, high = _draw_envelope(axis, report, report.envelope, k, style.LINE, order=3)
    if report.band is not None:  # 95 % interval of the torque at each time
        band_time, lower, upper = report.band
        time, interval_low, interval_high = _break_at_gaps(band_time, report.gaps.threshold, lower[:, k], upper[:, k])
        axis.fill_between(time, interval_low, interval_high, color=style.SKY, alpha=0.35, linewidth=0, zorder=2)
    bottom, top = float(np.nanmin(low)), float(np.nanmax(high))
    half_interval = 0.0
    if report.noisy:
        half_interval = INTERVAL * report.reach(joint)
    if half_interval > _MIN_INTERVAL_SHARE * (top - bottom):
        axis.errorbar(joint.time, joint.peak, yerr=half_interval, color=colour, linewidth=1.2, capsize=2.5, zorder=4)
    bottom = min(bottom, joint.peak - half_interval)
    top = max(top, joint.peak + half_interval)
    _set_torque_range(axis, joint, bottom, top, max_half_range=report.scale)
    _draw_peak(axis, report, joint, colour)
    remark = joint.unit
    if math.isfinite(joint.limit):
        remark = f"{percent_of_limit(joint.share)} of {number(joint.limit)} {joint.unit}"
    style.titles(axis, joint.joint, remark, style.OVER if is_over_limit else style.QUIET)
    axis.set_ylabel(joint.unit, color=style.QUIET, fontsize=style.SMALL_FONT)
    axis.margins(x=0)
    if is_bottom_panel:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel("time [s]", color=style.QUIET, fontsize=style.SMALL_FONT)


def _draw_peak(axis: style.Axes, report: TorqueReport, joint: JointTorque, colour: str) -> None:
    """Draw the peak as a point, with its value beside it: towards the middle of the time, away from zero."""
    peak = 0.0 if report.is_zero(joint.peak) else joint.peak
    axis.plot(joint.time, peak, "o", color=colour, markersize=4.5, markeredgecolor=style.PAPER, zorder=5)
    dx, text_edge_x = 5, "left"  # distance from the point [pt], and the edge of the text that faces the point
    if joint.time > 0.6 * report.end + 0.4 * report.begin:  # in the last 40 % of the time
        dx, text_edge_x = -5, "right"
    dy, text_edge_y = 4, "bottom"
    if joint.peak < 0:
        dy, text_edge_y = -4, "top"
    axis.annotate(
        report.label(joint.peak),
        (joint.time, joint.peak),
        xytext=(dx, dy),
        textcoords="offset points",
        ha=text_edge_x,
        va=text_edge_y,
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


def _draw_envelope(
    axis: style.Axes, report: TorqueReport, envelope: tuple[Array, Array, Array], k: int, colour: str, order: float
) -> tuple[Array, Array]:
    """Draw the torque of joint k between the minimum and maximum of each bin of rows; returns the curves of both.

    A curve with a higher ``order`` is drawn above one with a lower.
    """
    max_round_off = ZERO * report.scale  # torques up to this are zero
    bin_time, minima, maxima = envelope
    minimum, maximum = minima[:, k], maxima[:, k]
    minimum = np.where(np.abs(minimum) <= max_round_off, 0.0, minimum)
    maximum = np.where(np.abs(maximum) <= max_round_off, 0.0, maximum)
    time, low, high = _break_at_gaps(bin_time, report.gaps.threshold, minimum, maximum)
    axis.fill_between(time, low, high, color=colour, linewidth=0, zorder=order)
    for edge in (low, high):  # an area of zero width shows as a line
        axis.plot(time, edge, color=colour, linewidth=1.0, zorder=order)
    return low, high


def _set_torque_range(axis: style.Axes, joint: JointTorque, low: float, high: float, *, max_half_range: float) -> None:
    """Set the range of the torque axis, which contains the curve, its label, and each limit that the curve comes near.

    On either side of zero the range is at least a tenth of the limit, but no more than ``max_half_range`` for this reason.
    """
    span = max(high, 0.0) - min(low, 0.0)
    if span == 0.0:  # an axis needs a length
        span = 1.0
    bottom = min(low, 0.0) - _LABEL_ROOM * span
    top = max(high, 0.0) + _LABEL_ROOM * span
    is_limited = math.isfinite(joint.limit)
    largest_by_side = {-1: -low, 1: high}  # magnitude of the largest negative and positive torque
    for side, magnitude in largest_by_side.items():
        if not is_limited or magnitude < _MIN_SHARE_OF_DRAWN_LIMIT * joint.limit:
            continue
        beyond_limit = _FACTOR_PAST_LIMIT * side * joint.limit
        bottom, top = min(bottom, beyond_limit), max(top, beyond_limit)
        axis.axhline(side * joint.limit, **style.LIMIT)
        shaded_to = side * 100 * max(joint.limit, span)  # end of the shaded area, far outside the picture
        axis.axhspan(side * joint.limit, shaded_to, color=style.OVER, alpha=0.08, linewidth=0)
    if is_limited:
        half_range = min(_MIN_RANGE_SHARE * joint.limit, max_half_range)
        bottom, top = min(bottom, -half_range), max(top, half_range)
    axis.set_ylim(bottom, top)


def _draw_contributions(axis: style.Axes, report: TorqueReport, k: int) -> None:
    """Draw the contributions to a joint's torque around its peak."""
    joint = report.joints[k]
    states = report.around  # motion around the peak
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
    low, high = float(np.nanmin(below)), float(np.nanmax(above))
    _set_torque_range(axis, joint, low, high, max_half_range=report.scale)
    title = f"{joint.joint}: contributions to its torque"
    if report.is_zero(joint.largest):
        title = f"{joint.joint}: no torque to give"
    if len(states) != report.rows:  # the picture shows a part of the motion
        title += f" around its peak, t = {seconds(time[0])} to {seconds(time[-1])} s"
    peak_text = report.label(joint.peak)
    if report.noisy:
        peak_text += f" ± {deviation(report.reach(joint))}"
    style.titles(axis, title, f"peak {peak_text} {joint.unit} at {seconds(joint.time)} s")
    axis.set_xlabel("time [s]")
    axis.set_ylabel(torque_word(joint.unit))
    axis.margins(x=0)
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="medium")


_MAX_PANELS_PER_ROW = 3
"""Maximum number of motor panels in a row. Modern Robotics figure 8.10 shows such operating points."""
_MOTOR_WIDTH, _MOTOR_HEIGHT = 3.6, 2.7  # of a panel [in]
_TEMPERATURES_HEIGHT = 2.5  # [in]


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
    title = f"{report_title(report)} · motors"
    rows, columns = style.panel_grid(len(report.motors), _MAX_PANELS_PER_ROW)
    width = _MOTOR_WIDTH * columns + 0.6  # with the colour bar
    height = _MOTOR_HEIGHT * rows + 1.0  # with title and legend
    with style.figure(width, height, title, "Drawing the motors") as drawn:
        spans = [(report.begin, report.end)] * len(report.motors)  # [s]
        _draw_motors(drawn, report.motors, spans, columns)
        return style.save(drawn, path)


def _draw_motors(figure: Any, motors: Sequence[MotorUse], spans: Sequence[tuple[float, float]], columns: int) -> None:
    """Draw a panel for each motor, with the times of its span as colours, and one legend and colour bar for all."""
    axes = style.panels(figure, len(motors), _MAX_PANELS_PER_ROW)
    points_of_motors = []
    handle_by_label: dict[str, Any] = {}
    for axis, motor, span in zip(axes, motors, spans, strict=True):
        points_of_motors.append(_draw_motor(axis, motor, span))
        handles, labels = axis.get_legend_handles_labels()
        handle_by_label |= dict(zip(labels, handles, strict=True))
    _label_motor_axes(axes, columns)
    figure.colorbar(points_of_motors[-1], ax=axes, label="time [s]", shrink=0.8, aspect=35)
    handles = list(handle_by_label.values())
    figure.legend(handles, list(handle_by_label), loc="outside lower left", ncols=4, markerscale=3)


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
    width = _MOTOR_WIDTH * columns + 0.6  # with the colour bar
    motors_height = _MOTOR_HEIGHT * rows + 0.8  # with the legend
    height = motors_height + (_TEMPERATURES_HEIGHT + 0.1)
    with style.figure(width, height, "Motors over the cycle", "Drawing the drives") as drawn:
        upper, lower = cast("Any", drawn.subfigures(2, 1, height_ratios=[motors_height, _TEMPERATURES_HEIGHT]))
        motors = [_motor_use(sizing, joint) for joint in joints]
        spans = [(0.0, float(joint.cycle.time[-1])) for joint in joints]
        _draw_motors(upper, motors, spans, columns)
        _draw_temperatures(lower.subplots(), joints)
        return style.save(drawn, path)


def _label_motor_axes(axes: list[Any], columns: int) -> None:
    """Label the speeds of the last panel of each column, and the torques of the first panel of each row."""
    for axis in axes[-columns:]:
        axis.set_xlabel("speed [rad/s]", fontsize=style.SMALL_FONT)
    for axis in axes[::columns]:
        axis.set_ylabel("torque at the rotor [N m]", fontsize=style.SMALL_FONT)


def _motor_use(sizing: Sizing, joint: SizedJoint) -> MotorUse:
    """Demands on the motor of a sized joint, in the form of the motor report."""
    motor_name, _ = joint.drive
    motor = hot_motor(sizing.catalog.motors[motor_name].motor, sizing.problem.ambient)
    limited_demands = tuple(demand for demand in joint.motor.demands if math.isfinite(demand.limit))
    cycle_time = joint.cycle.time
    time = np.linspace(0.0, cycle_time[-1], 2 * len(cycle_time))  # uniform in time, for time averages
    return MotorUse(
        joint=joint.joint,
        motor=motor,
        demands=limited_demands,
        power=float(joint.motor.power.max()),
        heat=motor.resistance * joint.motor.rms_current**2,
        time=time,
        speed=np.interp(time, cycle_time, joint.motor.speed),
        torque=np.interp(time, cycle_time, joint.motor.torque),
    )


def _draw_temperatures(axis: style.Axes, joints: list[SizedJoint]) -> None:
    """Draw winding temperatures over one period of the repeated cycle."""
    joints_with_temperatures = []
    for joint in joints:
        temperatures = joint.motor.temperature
        if temperatures.size and np.isfinite(temperatures).all():
            joints_with_temperatures.append(joint)
    for k, joint in enumerate(joints_with_temperatures):
        winding_temperature = joint.motor.temperature[:, 0]
        time = joint.cycle.time
        if len(winding_temperature) != len(time):  # the thermal model has its own, evenly spaced times
            time = np.linspace(0.0, 1.0, len(winding_temperature)) * time[-1]
        axis.plot(time, winding_temperature, color=style.SERIES[k % len(style.SERIES)], label=joint.joint)
    axis.set_xlabel("time in the cycle [s]")
    axis.set_ylabel("winding [°C]")
    if joints_with_temperatures:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        style.titles(axis, "no thermal data")


def _draw_motor(axis: style.Axes, use: MotorUse, span: tuple[float, float]) -> Any:
    """Draw the capability of a motor, and the motion as points coloured by the time of ``span``; returns the points."""
    motor, speed, torque = use.motor, use.speed, use.torque
    max_speed = float(np.abs(speed).max(initial=0.0))
    no_load_speed = motor.voltage / motor.torque_constant
    speed_limit = min(no_load_speed, motor.speed)  # rad/s; motor.speed is the rated maximum
    if not math.isfinite(speed_limit):
        speed_limit = 1.5 * max_speed
    speed_range = 1.05 * max(max_speed, speed_limit)  # with a margin
    if speed_range == 0.0:  # a motor at rest, whose axis needs a length
        speed_range = 1.0
    w = np.linspace(-speed_range, speed_range, 401)  # rotor speeds of the region's edges [rad/s]
    currents = [current for current in (motor.current_continuous, motor.current_peak) if math.isfinite(current)]
    max_motor_torque = motor.torque_constant * max(currents, default=0.0)
    max_torque_of_motion = float(np.abs(torque).max(initial=0.0))
    torque_range = 1.1 * max(max_motor_torque, max_torque_of_motion)  # with a margin
    if torque_range == 0.0:
        torque_range = 1.0
    regions = (  # current, colour, name
        (motor.current_peak, style.SHORT, "intermittent"),
        (motor.current_continuous, style.LONG, "continuous"),
    )
    for current, colour, name in regions:
        high = np.clip(motor.greatest_torque(w, current), -torque_range, torque_range)
        low = -np.clip(motor.greatest_torque(-w, current), -torque_range, torque_range)  # same limits in reverse
        is_inside = high > low
        axis.fill_between(w, low, high, where=is_inside.tolist(), color=colour, linewidth=0)
        lowest_speed = w[np.argmax(is_inside)]  # argmax: the first True
        axis.text(  # in the upper left corner of the region
            0.97 * lowest_speed,
            0.96 * high.max(),
            name,
            va="top",
            fontsize=style.SMALL_FONT,
            color=style.AXIS,
        )
    max_torque = motor.greatest_torque(speed)
    max_reverse_torque = motor.greatest_torque(-speed)  # at negative torque a motor is mirrored
    is_within_max = torque <= max_torque + margin(max_torque)
    is_within_reverse = -torque <= max_reverse_torque + margin(max_reverse_torque)
    is_beyond = np.asarray(~(is_within_max & is_within_reverse))
    begin, end = span
    colours: dict[str, Any] = {"c": use.time, "cmap": style.time_colours(), "vmin": begin, "vmax": end}
    points = axis.scatter(speed, torque, s=3, linewidths=0, label="this motion", zorder=3, rasterized=True, **colours)
    if is_beyond.any():
        axis.plot(speed[is_beyond], torque[is_beyond], ".", color=style.OVER, markersize=3, label="beyond the motor")
    rms = math.sqrt(float(np.mean(torque**2)))
    for level, label in ((rms, "rms torque, either way"), (-rms, None)):  # one entry in the legend
        axis.axhline(level, color=style.INK, linewidth=0.8, linestyle=(0, (4, 3)), label=label)
    axis.axhline(0, color=style.QUIET, linewidth=0.6)
    axis.axvline(0, color=style.QUIET, linewidth=0.6)
    axis.set_xlim(-speed_range, speed_range)
    axis.set_ylim(-torque_range, torque_range)
    axis.locator_params(axis="x", nbins=5)
    remark = ""
    tightest_demand = use.tightest
    if tightest_demand.share != 0.0:  # a motor without load has no remark
        remark = f"{tightest_demand.what} {percent_of_limit(tightest_demand.share)}"
    style.titles(axis, use.joint, remark, style.OVER if use.too_small else style.QUIET)
    return points
