"""Plots of a simulation and of a trajectory: coordinates, energies, drift, active limits, phase plane."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ...core.glossary import complete
from ...core.numbers import number, residual
from ...mechanics.model.couplings import motor_torques
from ...mechanics.model.limits import Limits
from ...motion.bounds import bounds_or_own
from ...trajectories.fastest import Fastest
from ...trajectories.trajectory import required_torques
from .. import style
from .motion import curves, legend

if TYPE_CHECKING:
    from ...simulation.result import SimulationResult
    from ...trajectories.trajectory import Trajectory

_WORKS = {"torques": style.GREEN, "friction": style.GREY, "wrenches": style.PURPLE, "contacts": style.VERMILION}
_PANELS = {"rad": "Angles [rad]", "m": "Positions [m]", "": "Orientations: quaternions", None: "Coordinates [rad, m]"}
"""Axis label for each unit; None for files without units."""
_QUATERNION = 4


def plot_simulation(result: SimulationResult, path: str | Path) -> Path:
    """Plot of a simulation; see :meth:`SimulationResult.plot`.

    Parameters
    ----------
    result : SimulationResult

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> swing = tw.robots.pendulum().simulate([1.0], [0.0], duration=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_simulation(swing, f"{folder}/swing.svg").name
    'swing.svg'
    """
    end = f"{number(result.times[-1], 6)} s" if result.completed else result.stopped
    title = f"{result.robot} · {result.method} · {end if len(end) < 70 else end[:68] + '…'}"
    panels = _panels(result)
    heights = [2.6] * len(panels) + [2.6, 1.6]
    with style.figure(9.0, 1.0 + 1.02 * sum(heights), title, "Drawing a simulation") as drawn:
        *coordinates, energies, drift = drawn.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        for axis, (said, places) in zip(coordinates, panels.items(), strict=True):
            _draw_coordinates(axis, result, said, places)
        _draw_energies(energies, result)
        _draw_drift(drift, result)
        for axis in (*coordinates, energies, drift):
            for event in result.events[:50]:
                axis.axvline(event.time, color=style.QUIET, linewidth=0.8, linestyle=":")
            axis.margins(x=0)
        return style.save(drawn, path)


def _panels(result: SimulationResult) -> dict[str, list[int]]:
    """Panel titles, each with the coordinates in the panel."""
    units = result.coordinate_units or (None,) * len(result.coordinate_names)
    found = {said: [k for k, u in enumerate(units) if u == unit] for unit, said in _PANELS.items()}
    return {said: places for said, places in found.items() if places}


def _draw_coordinates(axis: style.Axes, result: SimulationResult, said: str, places: list[int]) -> None:
    """Draw the coordinates of one unit; those that move most have colours."""
    q, names = result.q[:, places], [result.coordinate_names[k] for k in places]
    turned = [result.coordinate_units[:k].count("") // _QUATERNION for k in places]  # a quaternion has three velocities
    colours = [k - n for k, n in zip(places, turned, strict=True)]
    shown = style.draw_joints(axis, result.times, q, names, np.ptp(q, axis=0), colours)
    most = f": the {len(shown)} of {len(places)} that move most" if len(shown) < len(places) else ""
    axis.set_title(f"{said}{most}", loc="left")
    _legend(axis)


def _draw_energies(axis: style.Axes, result: SimulationResult) -> None:
    for energy, label, look in (
        (result.kinetic_energy, "kinetic", {"color": style.BLUE}),
        (result.potential_energy, "potential", {"color": style.AMBER}),
        (result.energy, "both", {"color": style.LINE, "linewidth": 2}),
    ):
        axis.plot(result.times, energy - energy[0], label=label, **cast("Any", look))
    for name, work in result.work.items():
        if np.any(work):
            axis.plot(result.times, work, "--", color=_WORKS[name], label=f"work of {name}")
    axis.axhline(0.0, color=style.AXIS, linewidth=0.8)
    axis.set_title("Energies, gained since the start [J]", loc="left")
    _legend(axis)


def _draw_drift(axis: style.Axes, result: SimulationResult) -> None:
    axis.plot(result.times, result.drift, color=style.LINE)
    axis.axhline(0.0, color=style.AXIS, linewidth=0.8)
    drift = residual(result.relative_drift)
    axis.set_title(f"Drift [J]: energy gain not explained by work; at most {drift} of the energy exchanged", loc="left")
    axis.set_xlabel("time [s]")


def _legend(axis: style.Axes) -> None:
    cast("Any", axis).legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


# ── A trajectory: shares of limits, active limits, phase plane

_SAMPLES = 3001


def plot_trajectory(
    trajectory: Trajectory, path: str | Path, bounds: Limits | None = None, *, friction: bool = False
) -> Path:
    """Plot a trajectory, with the phase plane for a fastest motion.

    Parameters
    ----------
    trajectory : Trajectory
    bounds : Limits, optional, limits to draw

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> moving = tw.trajectories.move(tw.robots.ur5(), [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_trajectory(moving, f"{folder}/move.svg").name
    'move.svg'
    """
    robot = trajectory.robot
    fast = trajectory if isinstance(trajectory, Fastest) else None
    bounds = bounds_or_own(robot, fast.bounds if fast and bounds is None else bounds)
    friction = fast.rows.friction if fast else friction
    t = np.linspace(0.0, trajectory.duration, _SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = motor_torques(robot.model, required_torques(robot, t, q, dq, ddq, friction=friction))
    title = f"{robot.name} · {trajectory.path.name} · {trajectory.scaling.name} timing, {number(trajectory.duration)} s"
    with style.figure(11.25 if fast else 7.5, 6.3 if fast else 5.6, title) as drawn:
        if fast:
            left, right = cast("Any", drawn.subfigures(1, 2, width_ratios=[1.25, 1]))
        else:
            left = cast("Any", drawn)
        ratios = [1, 1] if fast is None else [1, 1, 0.28 if fast.time_optimal is None else 1]
        axes = left.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
        names = robot.model.velocity_names
        curves(axes[0], t, dq, bounds.velocity, names, "velocity")
        curves(axes[1], t, tau, bounds.effort, robot.model.drive_names, "torque")
        if fast and fast.time_optimal is not None:
            curves(axes[2], t, fast.jerk(t), fast.bounds.jerk, names, "jerk")
        elif fast:
            _bar(axes[2], fast, names)
        if fast:
            _phase_plane(right.subplots(), fast, names)
        axes[-1].set_xlabel("time [s]")
        legend(axes[0])
        return style.save(drawn, path)


_NAMED = 0.013
"""Share of the time per letter that a label on the strip needs."""


def _bar(axis: style.Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    for touch in fast.limit_contacts:
        k = names.index(touch.joint)
        look: dict[str, Any] = {"color": style.SERIES[k % len(style.SERIES)], "edgecolor": style.PAPER, "linewidth": 0}
        hatch = "///" if touch.kind == "velocity" else None
        axis.barh(0, touch.end - touch.begin, left=touch.begin, height=0.8, hatch=hatch, **look)
        name = touch.joint.removesuffix("_joint")
        longest = (touch.end - touch.begin) / fast.duration / _NAMED
        name = name if len(name) <= longest else name.replace("_", "\n", 1)
        if max(map(len, name.split("\n"))) <= longest:
            box = {"facecolor": look["color"], "edgecolor": "none", "pad": 1.5}
            place = (touch.begin + touch.end) / 2, 0
            axis.text(*place, name, color=style.PAPER, ha="center", va="center", fontsize=style.SMALL, bbox=box)
    axis.set_yticks([])
    axis.grid(visible=False)
    caption = "active limits: torques plain, velocities hatched (dotted beside)"
    axis.set_title(caption, loc="left", color=style.QUIET, fontsize=style.SMALL)
    axis.set_xlim(0, fast.duration)


def _phase_plane(axis: style.Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    curves = fast.limit_curves()
    s, rate = curves.path
    top = 1.9 * float((fast.time_optimal or fast).limit_curves().path[1].max())
    bound = np.minimum(np.minimum(curves.torque, curves.velocity), 10 * top)
    axis.fill_between(curves.s, bound, 10 * top, color=style.OVER, alpha=0.08, linewidth=0)
    axis.fill_between(curves.s, 0, bound, color=style.GREEN, alpha=0.07, linewidth=0)
    for shown, curve, colour, dashes, label in (
        (curves.torque.min() < top, curves.torque, style.OVER, "-", "limit curve: torques leave one acceleration"),
        (np.isfinite(curves.velocity).any(), curves.velocity, style.QUIET, "--", "largest joint velocity"),
    ):
        if shown:
            axis.plot(curves.s, np.minimum(curve, 10 * top), dashes, color=colour, linewidth=1.2, label=label)
    if fast.time_optimal is not None:
        axis.plot(s, rate, color=style.LINE, linewidth=2.0, label="motion within the limits of jerk")
        axis.plot(*fast.time_optimal.limit_curves().path, ":", color=style.LINE, label="fastest without them")
    else:
        _coloured(axis, fast, names)
    style.titles(axis, "phase plane")
    axis.set(xlim=(0, 1), ylim=(0, top), xlabel="s, along the path", ylabel="ds/dt [1/s]")
    axis.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")


def _coloured(axis: style.Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    """Draw the rate of a time-optimal motion, each part in the colour of the limiting joint."""
    curves = fast.limit_curves()
    s, rate = curves.path
    axis.plot(s, rate, color=style.LINE, linewidth=4.5, alpha=0.25, label="fastest motion, coloured by limiting joint")
    for touch, end in zip(fast.limit_contacts, [*(x.s for x in fast.limit_contacts[1:]), 1.0], strict=True):
        part = (s >= touch.s) & (s <= end)
        colour = style.SERIES[names.index(touch.joint) % len(style.SERIES)]
        axis.plot(s[part], rate[part], color=colour, linewidth=2.0, linestyle=":" if touch.kind == "velocity" else "-")
    look: dict[str, Any] = {"color": style.PAPER, "markeredgecolor": style.LINE, "markersize": 5}
    axis.plot(*curves.switches, "o", label="another limit takes over", **look)


complete(globals())
