"""What identification found of friction, of single rows, and of bodies, drawn on axes that are given."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.printed_numbers import percent
from ..joints.units import unit_of
from ..motion.coordinates import Coordinates
from ..typing import Array
from .diagnosis import VIEWS, draw_inertias
from .style import AXIS, BLUE, GREEN, LINE, PALE, QUIET, SMALL, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..identification import IdentifiedRobot

_BAND, _FAR = 1.96, 4.0
"""Deviations of a band that holds 95 %, and from which a residual is marked."""
_SPEEDS, _USUAL = 201, 2.0
"""Points of a curve, and the speed it goes to of a joint without a limit [rad/s, m/s]."""
_BAR = 0.2
"""Width, of four beside each other in a joint's unit."""
_LAWS = ("viscous", "coulomb", "stribeck", "offset")


def frictional(found: IdentifiedRobot) -> list[int]:
    """The joints whose friction was identified."""
    names = found.original.velocity_names
    return [k for k, name in enumerate(names) if any(f"{name}.{law}" in found.groups for law in _LAWS[:3])]


def draw_friction(grid: Any, found: IdentifiedRobot) -> None:
    """Friction over speed of each joint: viscous dq + coulomb tanh(dq / v) + offset, with a band of 95 %, and the file's."""
    kinds, model = Coordinates.of(found.original.model), found.original.model
    for axes, k in zip(grid, frictional(found), strict=True):
        name, turns = found.original.velocity_names[k], bool(kinds.angular_velocity[k])
        most = float(model.limits.velocity[k])
        dq = np.linspace(-1, 1, _SPEEDS) * (most if np.isfinite(most) else _USUAL)
        eased = np.tanh(dq / found.settings.friction_speed[k])
        fading = np.exp(-((dq / found.base.unknown.stribeck_speed) ** 2))
        of_law: dict[str, Array] = {
            "viscous": dq,
            "coulomb": eased,
            "stribeck": fading * eased,
            "offset": np.ones_like(dq),
        }
        places = [found.groups.index(f"{name}.{law}") if f"{name}.{law}" in found.groups else -1 for law in _LAWS]
        kept = [(place, of_law[law]) for place, law in zip(places, _LAWS, strict=True) if place >= 0]
        at, columns = [place for place, _ in kept], np.stack([column for _, column in kept], axis=1)
        torque = columns @ found.values[at]
        variance = np.einsum("ni,ij,nj->n", columns, found.covariance.matrix[np.ix_(at, at)], columns)
        half = _BAND * np.sqrt(np.maximum(variance, 0.0))
        axes.fill_between(dq, torque - half, torque + half, color=PALE, linewidth=0, label="95 %")
        axes.plot(dq, torque, color=LINE, linewidth=1.2, label="identified")
        friction = model.friction
        axes.plot(
            dq, friction.viscous[k] * dq + friction.coulomb[k] * eased, "--", color=VERMILION, linewidth=1, label="file"
        )
        axes.axhline(0.0, color=AXIS, linewidth=0.8)
        axes.set_title(f"{name} [{unit_of('tau', turns)}]", loc="left")
        axes.set_xlabel("speed [rad/s]" if turns else "speed [m/s]")
        axes.tick_params(labelsize=SMALL)
    grid[0].legend(fontsize=SMALL, frameon=False)


def draw_residuals(grid: Any, found: IdentifiedRobot) -> None:
    """What is left of the torques of rows held out, over time, beside what the training rows left; far rows are marked."""
    kinds = Coordinates.of(found.original.model)
    for j, (axes, name) in enumerate(zip(grid, found.held_out.names, strict=True)):
        sigma = float(found.sigma[j])
        axes.axhspan(-_BAND * sigma, _BAND * sigma, color=PALE, linewidth=0, label="95 % of training rows")
        for rows in found.held_out.rows:
            left = rows.measured[:, j] - rows.predicted[:, j]
            far = np.abs(left) > _FAR * sigma
            axes.plot(rows.time, left, ".", color=QUIET, markersize=1.5)
            axes.plot(rows.time[far], left[far], ".", color=VERMILION, markersize=2.5)
        axes.axhline(0.0, color=AXIS, linewidth=0.8)
        axes.set_title(name, loc="left")
        axes.set_ylabel(unit_of("tau", bool(kinds.angular_velocity[j])))
    grid[0].legend(fontsize=SMALL, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.97))  # above the points
    grid[-1].set_xlabel("time in its log [s]")


def draw_residual_bars(axes: Axes, found: IdentifiedRobot) -> None:
    """What is left of each joint's torque by the file, by the file with friction, by the groups and by bodies that can exist.

    Bars end at the whole torque; what is beyond is written on them.
    """
    left, names = found.residuals, list(found.held_out.names)
    models = (
        ("file", left.file, PALE),
        ("file, friction fitted", left.with_friction, VERMILION),
        ("identified", left.identified, BLUE),
        ("bodies that can exist", left.consistent, GREEN),
    )
    at = np.arange(len(names))
    for k, (label, shares, colour) in enumerate(models):
        x = at + (k - 1.5) * _BAR
        axes.bar(x, np.minimum(100 * shares, 100.0), _BAR, color=colour, label=label)
        for j in np.flatnonzero(shares > 1.0):
            axes.text(x[j], 99.0, f"{percent(shares[j], 3)}", rotation=90, ha="center", va="top", fontsize=SMALL)
    axes.set_xticks(at, names, fontsize=SMALL)
    axes.set_ylabel("% left in fifths held out")
    axes.legend(fontsize=SMALL, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def draw_bodies(grid: Any, found: IdentifiedRobot) -> None:
    """Ellipsoids of inertia of the moving bodies, in the file and identified: a row for each body, seen along each axis."""
    unknown, inertias = found.base.unknown, found.consistent.inertias
    for row, i in zip(grid, unknown.bodies, strict=True):
        body, inertia = unknown.model.bodies[i], inertias[i]
        for axes, view in zip(row, VIEWS, strict=True):
            draw_inertias(axes, [(inertia, BLUE, "-", "identified"), (body.inertia, VERMILION, "--", "file")], view)
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_xlabel(f"{'xyz'[view[0]]} [m]", fontsize=SMALL)
            axes.set_ylabel(f"{'xyz'[view[1]]} [m]", fontsize=SMALL)
            axes.tick_params(labelsize=SMALL, colors=QUIET)
        row[0].set_title(body.link, loc="left")
    grid[0][2].legend(fontsize=SMALL, frameon=False, loc="upper right")
