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

_BODIES = (style.BLUE, style.ORANGE, style.GREEN, style.VERMILION, style.SKY, style.PURPLE, style.LINE)
_APART = {"friction": style.GREY, "springs": style.OLIVE}
"""Colours of terms that do not belong to a body; the remaining ones are wrenches."""
_MAX_CAUSES = 8
"""Maximum number of causes drawn separately; the smallest ones are combined."""


def styles(bodies: Sequence[str], apart: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Colour for each cause, with hatches if there are more causes than colours.

    Parameters
    ----------
    bodies : sequence of str, causes that are bodies; other causes get other colours
    apart : sequence of str, the other causes

    Returns
    -------
    styles : {cause: options of Matplotlib's bars}

    Examples
    --------
    >>> sorted(styles(["upper", "lower"], ["friction"]))
    ['friction', 'lower', 'upper']
    """
    looks: dict[str, dict[str, Any]] = {}
    for k, name in enumerate(bodies):
        looks[name] = {"color": _BODIES[k % len(_BODIES)], "hatch": _hatch(k // len(_BODIES))}
    wrenches = [name for name in apart if name not in _APART]
    for k, name in enumerate(wrenches):
        looks[name] = {"color": style.AXIS, "hatch": _hatch(k)}
    for name in apart:
        if name in _APART:
            looks[name] = {"color": _APART[name]}
    for look in looks.values():
        look["edgecolor"] = style.PAPER
    return looks


def _hatch(repetition: int) -> str | None:
    """Hatch of a colour that is used again."""
    return (None, "///", "...", "xxx")[repetition % 4]


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
    parts, names = why.by_cause, list(why.causes)
    bodies = len(names) - (len(why.terms) - len(MOTION_TERMS))  # terms without a body come last
    order = np.argsort(-np.abs(parts).max(axis=1), kind="stable")
    order = order[parts[order].any(axis=1)]
    shown, others = np.sort(order[:_MAX_CAUSES]).tolist(), order[_MAX_CAUSES:].tolist()
    drawn_as = styles([names[c] for c in shown if c < bodies], [names[c] for c in shown if c >= bodies])
    rows = [(names[c], parts[c], drawn_as[names[c]]) for c in shown]
    if others:
        look: dict[str, Any] = {"color": style.PAPER, "hatch": "////", "edgecolor": style.GREY}
        rows.append((f"{len(others)} others", parts[others].sum(axis=0), look))
    places = np.arange(len(why.joints))
    width = max(6.0, 1.1 * len(places) + 3.2)
    with style.figure(width, 4.2, "What each torque is made of", "Drawing an explanation") as drawn:
        axis = drawn.subplots()
        above, below = np.zeros(len(places)), np.zeros(len(places))
        for name, row, look in rows:
            base = np.where(row >= 0, above, below)
            axis.bar(places, row, 0.62, bottom=base, label=name, linewidth=0.4, **look)
            above, below = above + np.maximum(row, 0), below + np.minimum(row, 0)
        axis.plot(places, why.torque, "_", color=style.INK, markersize=30, markeredgewidth=1.6, label="together")
        axis.axhline(0, color=style.QUIET, linewidth=0.7)
        axis.set_xticks(places, [j.replace("_", "\n", 1) for j in why.joints], fontsize=style.SMALL_FONT)
        axis.set_ylabel(", ".join(map(torque_word, sorted(set(why.units), reverse=True))))
        axis.grid(visible=False, axis="x")
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="medium")
        return style.save(drawn, path)


# ── Readings before and after compensation

_COLOURS = (style.BLUE, style.VERMILION, style.GREEN)  # x, y, z
_MAX_DOTS = 40
"""Maximum number of readings drawn as dots; more are drawn as lines."""


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
    left = log.readings - predicted
    x = np.arange(len(log)) if log.time is None else log.time
    title = f"{Path(log.name).stem} · load {number(sensor.load.mass)} kg, sign {sensor.sign}"
    with style.figure(10.5, 6.2, title) as drawn:
        axes = drawn.subplots(2, 2, sharex=True)
        for row, (part, what, unit, sigma) in enumerate(
            ((slice(3, 6), "force", "N", noise[1]), (slice(0, 3), "moment", "N m", noise[0]))
        ):
            names = [f"{'f' if row == 0 else 'm'}{axis}" for axis in "xyz"]
            before, after = axes[row]
            _draw(before, x, log.readings[:, part], names, marked, mark)
            _explain(before, x, predicted[:, part])
            style.titles(before, f"{what}s as read")
            _draw(after, x, left[:, part], names, marked, mark)
            after.axhspan(-2 * sigma, 2 * sigma, color=style.QUIET, alpha=0.18, linewidth=0, label="noise ± 2 σ")
            rms = float(np.sqrt(np.mean(left[~marked][:, part] ** 2))) if not marked.all() else 0.0
            where = " in unshaded readings" if marked.any() else ""
            remark = "" if marked.all() else f"rms {number(rms, 2)} {unit}{where}"
            style.titles(after, f"{what}s without bias and load", remark)
            for axis in (before, after):
                axis.set_ylabel(f"{what} [{unit}]")
                axis.legend(ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.0), columnspacing=1.0)
                low, high = axis.get_ylim()
                axis.set_ylim(low, high + 0.14 * (high - low))  # room for the legend
        for axis in axes[1]:
            axis.set_xlabel("reading, from 0" if log.time is None else "time [s]", color=style.QUIET)
            if log.time is None:
                axis.xaxis.get_major_locator().set_params(integer=True)
        style.save(drawn, path)


def _draw(axis: style.Axes, x: Array, values: Array, names: list[str], marked: Array, mark: str) -> None:
    few = len(x) <= _MAX_DOTS
    axis.axhline(0, color=style.AXIS, linewidth=0.7)
    for k, name in enumerate(names):
        line: dict[str, Any] = {"marker": "o", "markersize": 4.5, "linewidth": 0} if few else {"linewidth": 0.9}
        axis.plot(x, values[:, k], color=_COLOURS[k], label=name, **line)
    half = 0.5 * float(np.median(np.abs(np.diff(x)))) if len(x) > 1 else 0.5
    for count, (first, last) in enumerate(runs(marked)):
        label = mark if count == 0 else None
        axis.axvspan(x[first] - half, x[last] + half, color=style.POINTED, alpha=0.13, linewidth=0, label=label)


def _explain(axis: style.Axes, x: Array, predicted: Array) -> None:
    """Draw the readings predicted from bias and load: bars over dots, a thin dark line over lines."""
    dot = {"marker": "_", "markersize": 11, "markeredgewidth": 1.1, "linewidth": 0}
    line: dict[str, Any] = dot if len(x) <= _MAX_DOTS else {"linewidth": 0.8, "linestyle": (0, (3, 2))}
    for k in range(3):
        axis.plot(x, predicted[:, k], color=style.INK, label="bias and load" if k == 0 else None, **line)


complete(globals())
