"""Plots of causes: torque contributions as stacked bars, and sensor readings before and after compensation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.glossary import complete
from ...core.numbers import number
from ...core.typing import Array
from ...mechanics.joints.units import torque_word
from ...robot.explanation import MOTION_TERMS, Explanation, require_one_state
from ...sensing.log import ReadingLog
from ...sensing.sensor import ForceTorqueSensor
from ...sensing.static_poses import runs
from .. import style

_BODY_COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.VERMILION, style.SKY, style.PURPLE, style.LINE)
_OTHER_COLOURS = {"friction": style.GREY, "springs": style.OLIVE}
"""Colours of causes that are neither bodies nor wrenches."""
_HATCHES = (None, "///", "...", "xxx")
"""Hatches of a colour by the number of its repetitions."""
_MAX_DRAWN_CAUSES = 8
"""Maximum number of causes drawn separately; the smallest ones are combined."""
_MIN_WIDTH = 6.0  # of a figure [inch]
_WIDTH_PER_JOINT = 1.1  # [inch]
_LEGEND_WIDTH = 3.2  # with the labels of the axis [inch]
_BAR_HEIGHT = 4.2  # of the figure with bars [inch]
_BAR_WIDTH = 0.62  # as a share of the distance of two bars


def styles(bodies: Sequence[str], apart: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Colour for each cause, with hatches if there are more causes than colours.

    Parameters
    ----------
    bodies : sequence of str, causes that are bodies
    apart : sequence of str, causes that are not bodies, such as friction and wrenches

    Returns
    -------
    styles : {cause: options of Matplotlib's bars}

    Examples
    --------
    >>> sorted(styles(["upper", "lower"], ["friction"]))
    ['friction', 'lower', 'upper']
    """
    bar_options: dict[str, dict[str, Any]] = {}
    for k, name in enumerate(bodies):
        repetition, colour_index = divmod(k, len(_BODY_COLOURS))
        bar_options[name] = {"color": _BODY_COLOURS[colour_index], "hatch": _hatch(repetition)}
    wrenches = [name for name in apart if name not in _OTHER_COLOURS]
    for k, name in enumerate(wrenches):
        bar_options[name] = {"color": style.AXIS, "hatch": _hatch(k)}
    for name in apart:
        if name in _OTHER_COLOURS:
            bar_options[name] = {"color": _OTHER_COLOURS[name]}
    for options in bar_options.values():
        options["edgecolor"] = style.PAPER
    return bar_options


def _hatch(repetition: int) -> str | None:
    """Hatch of a colour that is used again; None at its first use."""
    return _HATCHES[repetition % len(_HATCHES)]


def plot_explanation(why: Explanation, path: str | Path) -> Path:
    """Bar chart of torque contributions; see :meth:`Explanation.plot`.

    Parameters
    ----------
    why : Explanation, for one state

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> why = tw.robots.planar_2r().explain([0, 0], [0, 1], [0, 0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_explanation(why, f"{folder}/why.svg").name
    'why.svg'
    """
    require_one_state(why)
    torques_by_cause = why.by_cause
    names = list(why.causes)
    other_term_count = len(why.terms) - len(MOTION_TERMS)  # terms without a body, the last causes
    body_count = len(names) - other_term_count
    max_torques = np.abs(torques_by_cause).max(axis=1)
    largest_first = np.argsort(-max_torques, kind="stable")
    is_nonzero = torques_by_cause[largest_first].any(axis=1)
    largest_first = largest_first[is_nonzero]
    shown_causes = np.sort(largest_first[:_MAX_DRAWN_CAUSES]).tolist()  # indices, in the order of the explanation
    combined_causes = largest_first[_MAX_DRAWN_CAUSES:].tolist()
    bodies = [names[c] for c in shown_causes if c < body_count]
    apart = [names[c] for c in shown_causes if c >= body_count]
    bar_options = styles(bodies, apart)
    bars = [(names[c], torques_by_cause[c], bar_options[names[c]]) for c in shown_causes]
    if combined_causes:
        options: dict[str, Any] = {"color": style.PAPER, "hatch": "////", "edgecolor": style.GREY}
        combined_torques = torques_by_cause[combined_causes].sum(axis=0)
        bars.append((f"{len(combined_causes)} others", combined_torques, options))
    x = np.arange(len(why.joints))  # places of the bars
    width = max(_MIN_WIDTH, _WIDTH_PER_JOINT * len(x) + _LEGEND_WIDTH)
    with style.figure(width, _BAR_HEIGHT, "What each torque is made of", "Drawing an explanation") as drawn:
        axis = drawn.subplots()
        # Positive torques are stacked upward, negative ones downward.
        top = np.zeros(len(x))
        bottom = np.zeros(len(x))
        for name, torques, options in bars:
            base = np.where(torques >= 0, top, bottom)
            axis.bar(x, torques, _BAR_WIDTH, bottom=base, label=name, linewidth=0.4, **options)
            top = top + np.maximum(torques, 0)
            bottom = bottom + np.minimum(torques, 0)
        axis.plot(x, why.torque, "_", color=style.INK, markersize=30, markeredgewidth=1.6, label="together")
        axis.axhline(0, color=style.QUIET, linewidth=0.7)
        joint_labels = [name.replace("_", "\n", 1) for name in why.joints]
        axis.set_xticks(x, joint_labels, fontsize=style.SMALL_FONT)
        units = sorted(set(why.units), reverse=True)  # N m before N
        axis.set_ylabel(", ".join(map(torque_word, units)))
        axis.grid(visible=False, axis="x")
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="medium")
        return style.save(drawn, path)


# ── Readings before and after compensation

_AXIS_COLOURS = (style.BLUE, style.VERMILION, style.GREEN)  # x, y, z
_MAX_DOTS = 40
"""Maximum number of readings drawn as dots; more are drawn as lines."""
_WIDTH = 10.5  # of the figure with readings [inch]
_HEIGHT = 6.2  # [inch]
_LEGEND_SHARE = 0.14
"""Height above the curves for the legend, as a share of the height of the curves."""


def plot_compensation(
    log: ReadingLog,
    sensor: ForceTorqueSensor,
    noise: tuple[float, float],
    path: str | Path,
    *,
    marked: Array,
    mark: str,
) -> None:
    """Plot of readings with the prediction of the sensor's load (left) and residuals (right), forces above moments.

    Parameters
    ----------
    log : ReadingLog
    sensor : ForceTorqueSensor
    noise : (moment [N m], force [N]), standard deviations of a reading
    marked : (n,) array of bool, shaded readings
    mark : str, legend label of the shaded readings

    Examples
    --------
    >>> import tempfile
    >>> from twistwrench.sensing import ForceTorqueSensor, simulate
    >>> sensor = ForceTorqueSensor()
    >>> log = simulate(sensor, 12)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_compensation(log, sensor, (0.01, 0.3), f"{folder}/log.svg", marked=np.zeros(12, bool), mark="contact")
    """
    predicted = log.predicted(sensor)
    residuals = log.readings - predicted
    x = np.arange(len(log)) if log.time is None else log.time  # number of a reading, or time [s]
    is_unshaded = ~marked
    title = f"{Path(log.name).stem} · load {number(sensor.load.mass)} kg, sign {sensor.sign}"
    with style.figure(_WIDTH, _HEIGHT, title) as drawn:
        axes = drawn.subplots(2, 2, sharex=True)
        moment_noise, force_noise = noise
        panels = (  # quantity, prefix of its components, columns of a wrench, unit, standard deviation
            ("force", "f", slice(3, 6), "N", force_noise),
            ("moment", "m", slice(0, 3), "N m", moment_noise),
        )
        for (reading_axis, residual_axis), panel in zip(axes, panels, strict=True):
            what, prefix, columns, unit, sigma = panel
            names = [f"{prefix}{axis}" for axis in "xyz"]
            _draw_readings(reading_axis, x, log.readings[:, columns], names, marked, mark)
            _draw_prediction(reading_axis, x, predicted[:, columns])
            style.titles(reading_axis, f"{what}s as read")
            _draw_readings(residual_axis, x, residuals[:, columns], names, marked, mark)
            residual_axis.axhspan(
                -2 * sigma, 2 * sigma, color=style.QUIET, alpha=0.18, linewidth=0, label="noise ± 2 σ"
            )
            remark = ""
            if is_unshaded.any():
                unshaded_residuals = residuals[is_unshaded][:, columns]
                rms = float(np.sqrt(np.mean(unshaded_residuals**2)))
                remark = f"rms {number(rms, 2)} {unit}"
                if marked.any():
                    remark += " in unshaded readings"
            style.titles(residual_axis, f"{what}s without bias and load", remark)
            for axis in (reading_axis, residual_axis):
                axis.set_ylabel(f"{what} [{unit}]")
                axis.legend(ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.0), columnspacing=1.0)
                low, high = axis.get_ylim()
                axis.set_ylim(low, high + _LEGEND_SHARE * (high - low))
        for axis in axes[1]:  # the lower row
            axis.set_xlabel("reading, from 0" if log.time is None else "time [s]", color=style.QUIET)
            if log.time is None:
                axis.xaxis.get_major_locator().set_params(integer=True)
        style.save(drawn, path)


def _draw_readings(axis: style.Axes, x: Array, values: Array, names: list[str], is_marked: Array, mark: str) -> None:
    """Draw the three components of readings (n, 3), and shade the marked ones; ``mark`` is their label in the legend."""
    line_options: dict[str, Any] = {"linewidth": 0.9}
    if len(x) <= _MAX_DOTS:
        line_options = {"marker": "o", "markersize": 4.5, "linewidth": 0}
    axis.axhline(0, color=style.AXIS, linewidth=0.7)
    for k, name in enumerate(names):
        axis.plot(x, values[:, k], color=_AXIS_COLOURS[k], label=name, **line_options)
    half_step = 0.5  # between two readings, in units of x
    if len(x) > 1:
        steps = np.abs(np.diff(x))
        half_step = 0.5 * float(np.median(steps))
    for k, (first, last) in enumerate(runs(is_marked)):
        label = mark if k == 0 else None  # one entry in the legend
        axis.axvspan(
            x[first] - half_step, x[last] + half_step, color=style.POINTED, alpha=0.13, linewidth=0, label=label
        )


def _draw_prediction(axis: style.Axes, x: Array, predicted: Array) -> None:
    """Draw the readings predicted from bias and load: bars over dots, a thin dark line over lines."""
    line_options: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (3, 2))}
    if len(x) <= _MAX_DOTS:
        line_options = {"marker": "_", "markersize": 11, "markeredgewidth": 1.1, "linewidth": 0}
    for k in range(3):
        label = "bias and load" if k == 0 else None  # one entry in the legend
        axis.plot(x, predicted[:, k], color=style.INK, label=label, **line_options)


complete(globals())
