"""What identification found, drawn: torques of rows held out, groups with their intervals, the pull to the file's bodies."""

from __future__ import annotations

import html
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..core.html_table import html_table
from ..core.printed_numbers import number, percent
from ..joints.units import units_of
from ..motion.coordinates import Coordinates
from .identified_drawings import draw_bodies, draw_friction, draw_residual_bars, draw_residuals, frictional
from .panels import panel_grid, panels
from .style import (
    AXIS,
    BLUE,
    GREEN,
    LINE,
    ORANGE,
    PALE,
    QUIET,
    SMALL,
    STYLE,
    VERMILION,
    figure,
    require_matplotlib,
    save,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..identification import IdentifiedRobot

_BAND = 1.96
_MOST_GROUPS, _NAMED_GROUPS, _LONGEST_NAME = 80, 30, 22
_ABREAST = 4
_PURPOSE = "Drawing the identification"


def plot_identification(found: IdentifiedRobot, path: str | Path) -> Path:
    """Draw measured and predicted torques of rows held out, the groups with their intervals, and the pull to the file.

    Parameters
    ----------
    found : IdentifiedRobot
    path : str or Path; the suffix says the kind, .png if there is none

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    MissingExtraError
        There is no matplotlib.
    ValueRangeError
        Nothing can be written.

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
    >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
    >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
    >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_identification(found, f"{folder}/fit").suffix
    '.png'
    """
    names = found.held_out.names
    height = 1.5 * len(names) + 4.6
    title = f"{found.original.name}: {found.verdict.word}, {percent(found.held_out.all, 3)} left in rows held out"
    with figure(11.0, height, title, _PURPOSE) as drawn:
        upper, lower = cast("Any", drawn.subfigures(2, 1, height_ratios=[1.5 * len(names), 4.4]))
        _torques(panels(upper, len(names), 1, sharex=True), found)
        left, right = lower.subplots(1, 2, width_ratios=[3, 2])
        _groups(left, found)
        _pull(right, found)
        return save(drawn, path)


def identification_page(found: IdentifiedRobot) -> str:
    """Page of HTML that says and shows what was found, whole in itself.

    Parameters
    ----------
    found : IdentifiedRobot

    Returns
    -------
    page : str

    Raises
    ------
    MissingExtraError
        There is no matplotlib.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
    >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
    >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
    >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
    >>> identification_page(found).count("<svg")
    6
    """
    return "\n".join(_page(found)) + "\n"


def _page(found: IdentifiedRobot) -> Iterator[str]:
    name, verdict = html.escape(found.original.name), found.verdict.word
    yield "<!doctype html>"
    yield f"<html lang='en'><meta charset='utf-8'><title>{name}: {verdict}</title>"
    yield (
        "<style>body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}"
        "table{border-collapse:collapse}td,th{padding:.15rem .7rem;text-align:right;border-bottom:1px solid #e6e8eb}"
        "td:first-child,th:first-child{text-align:left}svg{max-width:100%;height:auto}.no{color:#c0392b}</style>"
    )
    yield f"<h1>{verdict}: identification of {name}</h1>"
    yield f"<p>{percent(found.held_out.all, 3)} of the torques are left unexplained in rows held out.</p><ul>"
    for doubt in found.doubts:
        yield f"<li{' class=no' if doubt.refuses else ''}>{html.escape(doubt.sentence)}</li>"
    for note in found.notes:
        yield f"<li>{html.escape(note)}</li>"
    yield (
        f"</ul><p>{found.settings}; weights {found.method}; deviations from blocks of "
        f"{number(found.covariance.block)} s.</p>"
    )
    yield "<h2>Torques of rows held out</h2>"
    names = found.held_out.names
    yield _svg(10.0, 1.5 * len(names) + 0.6, lambda drawn: _torques(panels(drawn, len(names), 1, sharex=True), found))
    yield "<h2>Residuals</h2>"
    yield _svg(10.0, 3.0, lambda drawn: draw_residual_bars(drawn.subplots(), found))
    yield "<h3>In time</h3>"
    yield _svg(
        10.0, 1.2 * len(names) + 0.6, lambda drawn: draw_residuals(panels(drawn, len(names), 1, sharex=True), found)
    )
    if count := len(frictional(found)):
        yield "<h2>Friction</h2>"
        yield _svg(
            10.0,
            2.3 * panel_grid(count, _ABREAST)[0],
            lambda drawn: draw_friction(panels(drawn, count, _ABREAST), found),
        )
    yield "<h2>Groups of parameters</h2>"
    yield _svg(10.0, 4.4, lambda drawn: _groups(drawn.subplots(), found))
    rows = zip(found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True)
    cells = ((group, *map(float, (value, sigma, *ends, before))) for group, value, sigma, ends, before in rows)
    yield html_table("", ("group [SI units]", "value", "deviation", "95 % from", "to", "file"), cells)
    yield "<h2>Bodies that can exist</h2>"
    yield _svg(7.0, 3.0, lambda drawn: _pull(drawn.subplots(), found))
    consistent = found.consistent
    yield (
        f"<p>Pull γ = {number(consistent.fit.strength)}: {percent(consistent.held_out, 3)} left in fifths held out, weighted; "
        f"by the file's own bodies with friction {percent(consistent.of_file, 3)}.</p>"
    )
    unknown, inertias = found.base.unknown, consistent.inertias
    count = len(unknown.bodies)
    yield _svg(9.0, 2.5 * count, lambda drawn: draw_bodies(drawn.subplots(count, 3, squeeze=False), found))
    bodies = ((unknown.model.bodies[i], inertias[i]) for i in unknown.bodies)
    links = ((b.link, float(G.mass), float(b.inertia.mass), ", ".join(number(x) for x in G.com)) for b, G in bodies)
    yield html_table("", ("link", "mass [kg]", "in the file", "centre of mass [m]"), links)
    yield "</html>"


def _svg(width: float, height: float, draw: Any) -> str:
    """A picture as an element of a page."""
    mpl = require_matplotlib(_PURPOSE)
    with (
        figure(width, height, "", _PURPOSE) as drawn,
        mpl.rc_context(cast("Any", dict(STYLE) | {"svg.fonttype": "none"})),
    ):
        draw(drawn)
        buffer = io.StringIO()
        drawn.savefig(buffer, format="svg")
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _torques(grid: Any, found: IdentifiedRobot) -> None:
    """Measured, and predicted with a band of 95 % of the residuals; logs behind each other."""
    parts = sorted(found.held_out.rows, key=lambda rows: (float(rows.log[0]), float(rows.time[0])))
    turning = Coordinates.of(found.original.model).angular_velocity
    units = units_of("tau", turning)
    begin, ends = 0.0, dict[float, float]()
    for rows in parts:
        for log in np.unique(rows.log):
            ends[float(log)] = max(ends.get(float(log), 0.0), float(rows.time[rows.log == log].max()))
    offsets = {}
    for log, end in sorted(ends.items()):
        offsets[log], begin = begin, begin + end
    for j, (axes, name) in enumerate(zip(grid, found.held_out.names, strict=True)):
        for k, rows in enumerate(parts):
            t = rows.time + np.array([offsets[float(log)] for log in rows.log])
            first = k == 0
            axes.fill_between(
                t,
                rows.predicted[:, j] - _BAND * found.sigma[j],
                rows.predicted[:, j] + _BAND * found.sigma[j],
                color=PALE,
                linewidth=0,
                label="95 %" if first else None,
            )
            axes.plot(t, rows.measured[:, j], color=QUIET, linewidth=0.9, label="measured" if first else None)
            axes.plot(t, rows.predicted[:, j], color=LINE, linewidth=0.9, label="predicted" if first else None)
        share = found.held_out.joints[name]
        axes.set_title(
            f"{name}: {percent(share, 3)} left" if math.isfinite(share) else f"{name}: no torque", loc="left"
        )
        axes.set_ylabel(units[j])
    above = (1.0, 0.97)  # of the curves
    grid[0].legend(fontsize=SMALL, frameon=False, ncols=3, loc="lower right", bbox_to_anchor=above)
    grid[-1].set_xlabel("time [s]")


def _groups(axes: Axes, found: IdentifiedRobot) -> None:
    """Each group in units of its file's value or its own, whichever is larger, with its interval; the file as a tick."""
    half = found.covariance.half_width()
    size = np.maximum(np.maximum(np.abs(found.values), np.abs(found.prior.mean)), 1e-300)
    k = np.arange(min(len(size), _MOST_GROUPS))
    vague = (found.standard_deviations > 0.3 * np.abs(found.values))[k]
    for which, colour, name in ((~vague, GREEN, "sure"), (vague, ORANGE, "vague")):
        if which.any():
            at = k[which]
            bars = np.clip(half[at] / size[at], 0, 2)
            axes.errorbar(
                at, found.values[at] / size[at], bars, fmt="o", markersize=3, linewidth=1, color=colour, label=name
            )
    axes.plot(k, found.prior.mean[k] / size[k], "_", color=VERMILION, markersize=7, label="file")
    axes.axhline(0.0, color=AXIS, linewidth=0.8)
    axes.set_ylim(-1.6, 1.6)
    if len(k) <= _NAMED_GROUPS:
        axes.set_xticks(k, [_short(found.groups[i]) for i in k], rotation=55, ha="right", rotation_mode="anchor")
        axes.tick_params(axis="x", labelsize=SMALL)
    else:
        axes.set_xlabel("group, in the order of the table")
    axes.set_ylabel("share of the larger of value and file")
    axes.legend(fontsize=SMALL, frameon=False, ncols=3, loc="lower right")


def _short(group: str) -> str:
    """A group by its first parameter."""
    first, plus, _ = group.partition(" + ")
    named = first if len(first) <= _LONGEST_NAME else f"{first[:_LONGEST_NAME]}…"
    return f"{named} + …" if plus else named


def _pull(axes: Axes, found: IdentifiedRobot) -> None:
    strengths, shares = np.array(found.consistent.curve).T
    axes.semilogx(strengths, 100 * shares, "o-", color=BLUE, markersize=3, label="bodies that can exist")
    axes.axhline(100 * found.consistent.of_file, color=VERMILION, linewidth=1, label="the file's, with friction")
    axes.axvline(found.consistent.fit.strength, color=AXIS, linewidth=0.8, linestyle=":")
    axes.set_xticks(strengths, [number(x) for x in strengths])
    axes.minorticks_off()
    axes.tick_params(axis="x", labelsize=SMALL)
    axes.set_xlabel("pull to the file γ")
    axes.set_ylabel("% left, held out")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=SMALL, frameon=False)
