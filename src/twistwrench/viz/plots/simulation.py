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

_WORK_COLOURS = {"torques": style.GREEN, "friction": style.GREY, "wrenches": style.PURPLE, "contacts": style.VERMILION}
_PANEL_TITLES = {
    "rad": "Angles [rad]",
    "m": "Positions [m]",
    "": "Orientations: quaternions",
    None: "Coordinates [rad, m]",
}
"""Title of the panel for each unit of coordinates; None for files without units."""
_QUATERNION_SIZE = 4
"""Number of coordinates of an orientation."""
_MAX_EVENTS = 50
"""Largest number of events that are drawn."""


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
    outcome = f"{number(result.times[-1], 6)} s" if result.completed else result.stopped
    if len(outcome) >= 70:
        outcome = f"{outcome[:68]}…"
    title = f"{result.robot} · {result.method} · {outcome}"
    panels = _coordinates_by_panel(result)
    heights = [2.6] * len(panels) + [2.6, 1.6]
    with style.figure(9.0, 1.0 + 1.02 * sum(heights), title, "Drawing a simulation") as drawn:
        *coordinates, energies, drift = drawn.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        for axis, (panel, places) in zip(coordinates, panels.items(), strict=True):
            _draw_coordinates(axis, result, panel, places)
        _draw_energies(energies, result)
        _draw_drift(drift, result)
        for axis in (*coordinates, energies, drift):
            for event in result.events[:_MAX_EVENTS]:
                axis.axvline(event.time, color=style.QUIET, linewidth=0.8, linestyle=":")
            axis.margins(x=0)
        return style.save(drawn, path)


def _coordinates_by_panel(result: SimulationResult) -> dict[str, list[int]]:
    """Indices of the coordinates in each panel, by its title."""
    units = result.coordinate_units or (None,) * len(result.coordinate_names)
    coordinates_by_panel = {}
    for panel_unit, title in _PANEL_TITLES.items():
        coordinates = [k for k, unit in enumerate(units) if unit == panel_unit]
        if coordinates:
            coordinates_by_panel[title] = coordinates
    return coordinates_by_panel


def _draw_coordinates(axis: style.Axes, result: SimulationResult, panel: str, places: list[int]) -> None:
    """Draw the coordinates at some places, which have the same unit; those that move most have colours."""
    q = result.q[:, places]
    names = [result.coordinate_names[k] for k in places]
    # A quaternion has three velocities, so colours are those of velocities.
    colours = [k - result.coordinate_units[:k].count("") // _QUATERNION_SIZE for k in places]
    coloured = style.draw_joints(axis, result.times, q, names, np.ptp(q, axis=0), colours)
    if len(coloured) < len(places):
        panel += f": the {len(coloured)} of {len(places)} that move most"
    axis.set_title(panel, loc="left")
    _legend(axis)


def _draw_energies(axis: style.Axes, result: SimulationResult) -> None:
    """Draw the gains of energy since the start, and the works."""
    for energy, label, options in (
        (result.kinetic_energy, "kinetic", {"color": style.BLUE}),
        (result.potential_energy, "potential", {"color": style.AMBER}),
        (result.energy, "both", {"color": style.LINE, "linewidth": 2}),
    ):
        axis.plot(result.times, energy - energy[0], label=label, **cast("Any", options))
    for name, work in result.work.items():
        if np.any(work):
            axis.plot(result.times, work, "--", color=_WORK_COLOURS[name], label=f"work of {name}")
    axis.axhline(0.0, color=style.AXIS, linewidth=0.8)
    axis.set_title("Energies, gained since the start [J]", loc="left")
    _legend(axis)


def _draw_drift(axis: style.Axes, result: SimulationResult) -> None:
    """Draw the gain of energy that no work explains."""
    axis.plot(result.times, result.drift, color=style.LINE)
    axis.axhline(0.0, color=style.AXIS, linewidth=0.8)
    drift = residual(result.relative_drift)
    axis.set_title(f"Drift [J]: energy gain not explained by work; at most {drift} of the energy exchanged", loc="left")
    axis.set_xlabel("time [s]")


def _legend(axis: style.Axes) -> None:
    """Write a legend at the right of the axes."""
    cast("Any", axis).legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


# ── A trajectory: shares of limits, active limits, phase plane

_SAMPLES = 3001
"""Number of times at which a trajectory is drawn."""


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
    names = robot.model.velocity_names
    fast = trajectory if isinstance(trajectory, Fastest) else None
    width, height = 7.5, 5.6
    ratios = [1.0, 1.0]
    if fast is not None:
        width, height = 11.25, 6.3
        friction = fast.rows.friction
        ratios.append(0.28 if fast.time_optimal is None else 1.0)  # a strip of active limits, or a panel of jerks
        if bounds is None:
            bounds = fast.bounds
    bounds = bounds_or_own(robot, bounds)
    t = np.linspace(0.0, trajectory.duration, _SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = motor_torques(robot.model, required_torques(robot, t, q, dq, ddq, friction=friction))
    title = f"{robot.name} · {trajectory.path.name} · {trajectory.scaling.name} timing, {number(trajectory.duration)} s"
    with style.figure(width, height, title) as drawn:
        left = cast("Any", drawn)
        if fast is not None:
            left, right = cast("Any", drawn.subfigures(1, 2, width_ratios=[1.25, 1]))
        axes = left.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
        curves(axes[0], t, dq, bounds.velocity, names, "velocity")
        curves(axes[1], t, tau, bounds.effort, robot.model.drive_names, "torque")
        if fast is not None:
            if fast.time_optimal is None:
                _draw_active_limits(axes[2], fast, names)
            else:
                curves(axes[2], t, fast.jerk(t), fast.bounds.jerk, names, "jerk")
            _draw_phase_plane(right.subplots(), fast, names)
        axes[-1].set_xlabel("time [s]")
        legend(axes[0])
        return style.save(drawn, path)


_TIME_PER_LETTER = 0.013
"""Share of the duration that each letter of a label on the strip needs."""


def _draw_active_limits(axis: style.Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    """Draw a strip of the limits that the motion is at, in the colours of their joints."""
    for contact in fast.limit_contacts:
        k = names.index(contact.joint)
        colour = style.SERIES[k % len(style.SERIES)]
        options: dict[str, Any] = {"color": colour, "edgecolor": style.PAPER, "linewidth": 0}
        if contact.kind == "velocity":
            options["hatch"] = "///"
        axis.barh(0, contact.end - contact.begin, left=contact.begin, height=0.8, **options)
        label = contact.joint.removesuffix("_joint")
        max_letters = (contact.end - contact.begin) / fast.duration / _TIME_PER_LETTER
        if len(label) > max_letters:
            label = label.replace("_", "\n", 1)
        if max(map(len, label.split("\n"))) <= max_letters:
            box = {"facecolor": colour, "edgecolor": "none", "pad": 1.5}
            middle = (contact.begin + contact.end) / 2
            axis.text(
                middle, 0, label, color=style.PAPER, ha="center", va="center", fontsize=style.SMALL_FONT, bbox=box
            )
    axis.set_yticks([])
    axis.grid(visible=False)
    caption = "active limits: torques plain, velocities hatched (dotted beside)"
    axis.set_title(caption, loc="left", color=style.QUIET, fontsize=style.SMALL_FONT)
    axis.set_xlim(0, fast.duration)


def _draw_phase_plane(axis: style.Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    """Draw the rate along the path over the path, under the limit curves of torques and velocities."""
    curves = fast.limit_curves()
    s, rate = curves.path
    fastest_rates = (fast.time_optimal or fast).limit_curves().path[1]
    top = 1.9 * float(fastest_rates.max())
    far_above = 10 * top  # in place of infinite limits
    bound = np.minimum(np.minimum(curves.torque, curves.velocity), far_above)
    axis.fill_between(curves.s, bound, far_above, color=style.OVER, alpha=0.08, linewidth=0)
    axis.fill_between(curves.s, 0, bound, color=style.GREEN, alpha=0.07, linewidth=0)
    if curves.torque.min() < top:
        curve = np.minimum(curves.torque, far_above)
        label = "limit curve: torques leave one acceleration"
        axis.plot(curves.s, curve, "-", color=style.OVER, linewidth=1.2, label=label)
    if np.isfinite(curves.velocity).any():
        curve = np.minimum(curves.velocity, far_above)
        axis.plot(curves.s, curve, "--", color=style.QUIET, linewidth=1.2, label="largest joint velocity")
    if fast.time_optimal is not None:
        axis.plot(s, rate, color=style.LINE, linewidth=2.0, label="motion within the limits of jerk")
        axis.plot(*fast.time_optimal.limit_curves().path, ":", color=style.LINE, label="fastest without them")
    else:
        _draw_rate_by_joint(axis, fast, names)
    style.titles(axis, "phase plane")
    axis.set(xlim=(0, 1), ylim=(0, top), xlabel="s, along the path", ylabel="ds/dt [1/s]")
    axis.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")


def _draw_rate_by_joint(axis: style.Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    """Draw the rate of a time-optimal motion, each part in the colour of the limiting joint."""
    curves = fast.limit_curves()
    s, rate = curves.path
    axis.plot(s, rate, color=style.LINE, linewidth=4.5, alpha=0.25, label="fastest motion, coloured by limiting joint")
    ends = [*(contact.s for contact in fast.limit_contacts[1:]), 1.0]  # each where the next one begins
    for contact, end in zip(fast.limit_contacts, ends, strict=True):
        part = (s >= contact.s) & (s <= end)
        colour = style.SERIES[names.index(contact.joint) % len(style.SERIES)]
        dashes = ":" if contact.kind == "velocity" else "-"
        axis.plot(s[part], rate[part], color=colour, linewidth=2.0, linestyle=dashes)
    options: dict[str, Any] = {"color": style.PAPER, "markeredgecolor": style.LINE, "markersize": 5}
    axis.plot(*curves.switches, "o", label="another limit takes over", **options)


complete(globals())
