"""Plots of diagnosis and identification: inertia ellipsoids, friction, residuals, parameter groups."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ...core.colours import Style
from ...core.errors import ValueRangeError
from ...core.numbers import estimate, number, percent, plus_minus
from ...core.text import listed
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.bodies.mesh import hull_faces
from ...mechanics.joints.units import heading_unit, unit_of, units_of
from ...motion.coordinates import Coordinates
from ...reports.blocks import Block, Line, Table, numbers, verdict, words
from ...reports.page import Picture
from ..scene import equal_inertia_ellipsoid
from . import style

if TYPE_CHECKING:
    from ...diagnosis import DoctorReport
    from ...identification import IdentifiedRobot

_MOST = 6
"""Maximum number of links in a picture, worst findings first."""
VIEWS = ((0, 1), (0, 2), (1, 2))
"""Pairs of link axes in the plane of each of the three views."""


def plot_diagnosis(report: DoctorReport, path: str | Path) -> Path:
    """Draw the links with inertias repaired by the doctor: shapes, and inertia ellipsoids before and after."""
    pairs = links_drawn(report)
    if not pairs:
        raise ValueRangeError(f"no finding on robot {report.robot!r} changes an inertia, so there is nothing to draw.")
    height = 2.5 * len(pairs) + 0.9
    with style.figure(9.0, height, f"{report.robot}: inertia before and after") as drawn:
        grid = drawn.subplots(len(pairs), 3, squeeze=False)
        for row, (link, check, after) in zip(grid, pairs, strict=True):
            described, before = report.subject.robot.links.get(link), report.subject.robot.model.link_inertias[link]
            # The file's inertia is drawn last: its dashes stay visible over an equal solid line.
            inertias = [(after, style.BLUE, "-", "repaired"), (before, style.VERMILION, "--", "in the file")]
            for axes, view in zip(row, VIEWS, strict=True):
                for k, shape in enumerate(described.shapes.solids if described is not None else ()):
                    outline = _outline(shape.points[:, list(view)])
                    axes.fill(*outline.T, color=style.PALE, zorder=1, label=None if k else "shapes")
                draw_inertias(axes, inertias, view)
            row[0].set_title(f"{link}: {check}", loc="left")
        grid[0][2].legend(loc="upper right")
        return style.save(drawn, path)


def links_drawn(report: DoctorReport) -> list[tuple[str, str, SpatialInertia]]:
    """Links with an inertia effectively changed by a finding, each with the check's name and the new inertia."""
    found: dict[str, tuple[str, SpatialInertia]] = {}
    for finding in report.findings:
        if finding.repair is not None and finding.effect.inertia_joint:
            for link, inertia in finding.repair.inertias.items():
                found.setdefault(link, (finding.check, inertia))
    return [(link, check, inertia) for link, (check, inertia) in found.items()][:_MOST]


def draw_inertias(
    axes: style.Axes, inertias: Sequence[tuple[SpatialInertia, str, str, str]], view: tuple[int, int]
) -> None:
    """Draw outlines and centres of mass of uniform ellipsoids: tuples of inertia, colour, dashes and name.

    ``view`` holds the link axes in the picture plane.
    """
    for inertia, colour, dashes, name in inertias:
        for solid in equal_inertia_ellipsoid(inertia) if inertia.mass > 0 else ():
            outline = _outline(solid.vertices[:, list(view)])
            x, y = np.concatenate([outline, outline[:1]]).T
            axes.plot(x, y, color=colour, linestyle=dashes, linewidth=1.4, label=name, zorder=3)
        axes.plot(*inertia.com[list(view)], "+", color=colour, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[view[0]]} [m]", fontsize=style.SMALL)
    axes.set_ylabel(f"{'xyz'[view[1]]} [m]", fontsize=style.SMALL)
    axes.tick_params(labelsize=style.SMALL, colors=style.QUIET)


def _outline(points: Array) -> Array:
    """Convex hull (n, 2) of points, in order."""
    edges = hull_faces(points)
    if edges is None:
        return points
    used = np.unique(edges)
    middle = points[used].mean(axis=0)
    around = points[used] - middle
    return np.asarray(points[used][np.argsort(np.arctan2(around[:, 1], around[:, 0]))])


# ── Friction, residuals and bodies on given axes

_BAND, _FAR = 1.96, 4.0
"""Standard deviations: half-width of a 95 % band, and threshold of marked residuals."""
_SPEEDS, _USUAL = 201, 2.0
"""Number of points of a curve, and its maximum speed for joints without a limit [rad/s, m/s]."""
_BAR = 0.2
"""Width of each of the four bars of a joint, which has unit width."""
_LAWS = ("viscous", "coulomb", "stribeck", "offset")


def frictional(found: IdentifiedRobot) -> list[int]:
    """Joints with identified friction."""
    names = found.original.velocity_names
    return [k for k, name in enumerate(names) if any(f"{name}.{law}" in found.groups for law in _LAWS[:3])]


def draw_friction(grid: Any, found: IdentifiedRobot) -> None:
    """Draw friction over speed for each joint: viscous dq + coulomb tanh(dq / v) + offset, its 95 % band, and the file's."""
    kinds, model = Coordinates.from_model(found.original.model), found.original.model
    for axes, k in zip(grid, frictional(found), strict=True):
        name, turns = found.original.velocity_names[k], bool(kinds.angular_velocity[k])
        most = float(model.limits.velocity[k])
        dq = np.linspace(-1, 1, _SPEEDS) * (most if np.isfinite(most) else _USUAL)
        eased = np.tanh(dq / found.settings.friction_speed[k])
        fading = np.exp(-((dq / found.base.unknown.stribeck_speed) ** 2))
        laws = dict(zip(_LAWS, (dq, eased, fading * eased, np.ones_like(dq)), strict=True))
        kept = {law: x for law, x in laws.items() if f"{name}.{law}" in found.groups}
        at, columns = [found.groups.index(f"{name}.{law}") for law in kept], np.stack(list(kept.values()), axis=1)
        torque = columns @ found.values[at]
        variance = np.einsum("ni,ij,nj->n", columns, found.covariance.matrix[np.ix_(at, at)], columns)
        half = _BAND * np.sqrt(np.maximum(variance, 0.0))
        axes.fill_between(dq, torque - half, torque + half, color=style.PALE, linewidth=0, label="95 %")
        axes.plot(dq, torque, color=style.LINE, linewidth=1.2, label="identified")
        friction = model.friction
        before = friction.viscous[k] * dq + friction.coulomb[k] * eased
        axes.plot(dq, before, "--", color=style.VERMILION, linewidth=1, label="file")
        axes.axhline(0.0, color=style.AXIS, linewidth=0.8)
        axes.set_title(f"{name} [{unit_of('tau', turns)}]", loc="left")
        axes.set_xlabel("speed [rad/s]" if turns else "speed [m/s]")
        axes.tick_params(labelsize=style.SMALL)
    grid[0].legend()


def draw_residuals(grid: Any, found: IdentifiedRobot) -> None:
    """Draw residual torques over time for held-out and training rows; outliers are marked."""
    kinds = Coordinates.from_model(found.original.model)
    for j, (axes, name) in enumerate(zip(grid, found.held_out.names, strict=True)):
        sigma = float(found.sigma[j])
        axes.axhspan(-_BAND * sigma, _BAND * sigma, color=style.PALE, linewidth=0, label="95 % of training rows")
        for rows in found.held_out.rows:
            left = rows.measured[:, j] - rows.predicted[:, j]
            far = np.abs(left) > _FAR * sigma
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
            axes.text(x[j], 99.0, f"{percent(shares[j], 3)}", rotation=90, ha="center", va="top", fontsize=style.SMALL)
    axes.set_xticks(at, names, fontsize=style.SMALL)
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


def plot_identification(found: IdentifiedRobot, path: str | Path) -> Path:
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
    """Pictures of the report: torques, residuals, friction, groups, the weight of the prior, and bodies."""
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
        axes.tick_params(axis="x", labelsize=style.SMALL)
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
    axes.tick_params(axis="x", labelsize=style.SMALL)
    axes.set_xlabel("weight of the prior γ")
    axes.set_ylabel("% left, held out")
    axes.set_ylim(bottom=0)
    axes.legend()


# ── Blocks of the report

_KINDS = {"test": "in the logs of --test", "five-fold": "in 5-fold cross-validation over time"}
_MOST_NAMES = 5


def identification_view(found: IdentifiedRobot, *, essential: bool = False) -> Iterator[Block]:
    """Verdict and its basis; with essential groups if ``essential``."""
    joints = [f"{name} {percent(share, 3)}" for name, share in found.held_out.joints.items() if math.isfinite(share)]
    left = f"{percent(found.held_out.all, 3)} of the torques unexplained {_KINDS[found.held_out.kind]}"
    poor = f"{len(found.poorly_determined)} of {int((~found.base.held).sum())} parameter groups poorly determined."
    yield verdict(found.verdict.word, f": {left} ({listed(joints, _MOST_NAMES)}). {poor}")
    yield from (Line((f"• {doubt.sentence}", Style.OVER if doubt.refuses else "")) for doubt in found.doubts)
    yield from found.notes
    yield f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    yield Table(
        "Unexplained share of the torques, in rows held out",
        words("joint", found.held_out.joints),
        numbers("held out", found.held_out.joints.values(), lambda share: percent(share, 3)),
        numbers(
            "size", found.sigma, unit=heading_unit("tau", Coordinates.from_model(found.original.model).angular_velocity)
        ),
    )
    if (payload := found.payload) is not None:
        com = ", ".join(plus_minus(x, d) for x, d in zip(payload.com, payload.com_deviations, strict=True))
        mass = plus_minus(payload.mass, payload.mass_deviation)
        yield f"payload at {payload.frame}: {mass} kg, centre of mass ({com}) m in its frame"
        if payload.unidentifiable:
            yield f"not determined by the torques, taken from the file: {', '.join(payload.unidentifiable)}"
    yield _groups_table(found)
    if any(".mc" in name.split(" ")[0] for name in found.groups):
        yield "mcx, mcy, mcz: mass times the coordinates of the centre of mass. A sum has the unit of its first term."
    if found.base.held.any():
        yield f"{int(found.base.held.sum())} parameters were held at known values"
    if listed_groups := found.poorly_determined:
        names = listed((name.split(" ")[0] for name in listed_groups), _MOST_NAMES, "; ")
        yield f"Poorly determined, standard deviation above 30 %: {names}"
    if essential:
        yield _essential(found)
    if found.undetermined:
        yield "Not determined by this log:"
        yield from (f"• {sentence}" for sentence in found.undetermined.values())


def _groups_table(found: IdentifiedRobot) -> Table:
    free = ~found.base.held
    values, deviations = found.values[free], found.standard_deviations[free]
    pairs = list(map(estimate, values, deviations))
    low, high = found.interval()[free].T
    units = [unit.replace("^2", "²") for unit, kept in zip(found.units, free, strict=True) if kept]
    column = partial(numbers, unit=", ".join(dict.fromkeys(units)), headed=False)
    return Table(
        f"{int(free.sum())} groups of parameters",
        words("group", [name for name, kept in zip(found.groups, free, strict=True) if kept]),
        words("unit", units, fold=False),
        column("value", [Line(text, value=x) for (text, _), x in zip(pairs, values, strict=True)]),
        column("deviation", [Line(text, value=x) for (_, text), x in zip(pairs, deviations, strict=True)]),
        column("95 % from", low),
        column("to", high),
        column("file", found.prior.mean[free]),
    )


def _essential(found: IdentifiedRobot) -> str:
    one = found.essential
    names = "; ".join(
        f"{name.split(' ')[0]} {number(value)}" for name, value in zip(one.names, one.values, strict=True)
    )
    return (
        f"{len(one.names)} essential groups of {int((~found.base.held).sum())} predict rows held out to "
        f"{percent(one.held_out, 3)}, all to {percent(one.curve[0][1], 3)} (in units of each joint's residuals): {names}"
    )


def bodies_view(found: IdentifiedRobot) -> Iterator[Block]:
    """Physically consistent bodies compared with the file's, and their prediction error."""
    consistent, unknown = found.consistent, found.base.unknown
    yield (
        f"Weight of the prior γ = {number(consistent.fit.strength)}: {percent(consistent.held_out, 3)} unexplained in 5-fold "
        f"cross-validation, weighted; by the file's own bodies with friction {percent(consistent.of_file, 3)}."
    )
    pairs = [(unknown.model.bodies[i], consistent.inertias[i]) for i in unknown.bodies]
    yield Table(
        "Physically consistent bodies",
        words("link", [body.link for body, _ in pairs]),
        numbers("mass", [float(G.mass) for _, G in pairs], unit="kg"),
        numbers("in the file", [float(body.inertia.mass) for body, _ in pairs], unit="kg"),
        words("centre of mass [m]", [", ".join(number(x) for x in G.com) for _, G in pairs]),
    )
