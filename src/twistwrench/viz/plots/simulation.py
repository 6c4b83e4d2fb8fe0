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
_MAX_OUTCOME_LETTERS = 70
"""Number of letters from which an outcome is cut in the title."""
_WIDTH = 9.0  # of a figure [inch]
_PANEL_HEIGHT = 2.6  # [inch]
_DRIFT_HEIGHT = 1.6  # [inch]
_TITLE_HEIGHT = 1.0  # with the time axis [inch]
_SPACING = 1.02  # factor of the heights, for gaps between panels


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
    if len(outcome) >= _MAX_OUTCOME_LETTERS:
        outcome = f"{outcome[: _MAX_OUTCOME_LETTERS - 2]}…"  # below the limit with the ellipsis
    title = f"{result.robot} · {result.method} · {outcome}"
    panels = _coordinates_by_panel(result)
    heights = [_PANEL_HEIGHT] * len(panels) + [_PANEL_HEIGHT, _DRIFT_HEIGHT]
    height = _TITLE_HEIGHT + _SPACING * sum(heights)
    with style.figure(_WIDTH, height, title, "Drawing a simulation") as drawn:
        axes = drawn.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        *coordinate_axes, energy_axis, drift_axis = axes
        for axis, (panel, indices) in zip(coordinate_axes, panels.items(), strict=True):
            _draw_coordinates(axis, result, panel, indices)
        _draw_energies(energy_axis, result)
        _draw_drift(drift_axis, result)
        for axis in axes:
            for event in result.events[:_MAX_EVENTS]:
                axis.axvline(event.time, color=style.QUIET, linewidth=0.8, linestyle=":")
            axis.margins(x=0)
        return style.save(drawn, path)


def _coordinates_by_panel(result: SimulationResult) -> dict[str, list[int]]:
    """Indices of the coordinates in each panel, by its title."""
    units = result.coordinate_units or (None,) * len(result.coordinate_names)
    coordinates_by_panel = {}
    for panel_unit, title in _PANEL_TITLES.items():
        indices = [k for k, unit in enumerate(units) if unit == panel_unit]
        if indices:
            coordinates_by_panel[title] = indices
    return coordinates_by_panel


def _draw_coordinates(axis: style.Axes, result: SimulationResult, panel: str, indices: list[int]) -> None:
    """Draw the coordinates with these indices, all in one unit; the coordinates that move most have colours."""
    q = result.q[:, indices]
    names = [result.coordinate_names[k] for k in indices]
    velocity_indices = []  # numbers of the colours; a quaternion has one velocity less
    for k in indices:
        earlier_quaternions = result.coordinate_units[:k].count("") // _QUATERNION_SIZE
        velocity_indices.append(k - earlier_quaternions)
    coloured = style.draw_joints(axis, result.times, q, names, np.ptp(q, axis=0), velocity_indices)
    title = panel
    if len(coloured) < len(indices):
        title += f": the {len(coloured)} of {len(indices)} that move most"
    axis.set_title(title, loc="left")
    _legend(axis)


def _draw_energies(axis: style.Axes, result: SimulationResult) -> None:
    """Draw the energies gained since the start, and the works."""
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
    """Draw the drift: the gain of energy that no work explains."""
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
    fastest = trajectory if isinstance(trajectory, Fastest) else None
    figure_size = (7.5, 5.6)  # [inch]
    ratios = [1.0, 1.0]  # heights of velocities and torques
    if fastest is not None:
        figure_size = (11.25, 6.3)  # [inch], with the phase plane at the right
        friction = fastest.rows.friction
        if fastest.time_optimal is None:
            ratios.append(0.28)  # strip of active limits
        else:
            ratios.append(1.0)  # panel of jerks
        if bounds is None:
            bounds = fastest.bounds
    bounds = bounds_or_own(robot, bounds)
    t = np.linspace(0.0, trajectory.duration, _SAMPLES)
    q, dq, ddq = trajectory(t)
    joint_torques = required_torques(robot, t, q, dq, ddq, friction=friction)
    tau = motor_torques(robot.model, joint_torques)
    title = f"{robot.name} · {trajectory.path.name} · {trajectory.scaling.name} timing, {number(trajectory.duration)} s"
    with style.figure(*figure_size, title) as drawn:
        left_figure = cast("Any", drawn)
        if fastest is not None:
            subfigures = drawn.subfigures(1, 2, width_ratios=[1.25, 1])  # the time axes are wider
            left_figure, right_figure = cast("Any", subfigures)  # time, phase plane
        axes = left_figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios)
        velocity_axis, torque_axis, *_ = axes
        lowest_axis = axes[-1]
        curves(velocity_axis, t, dq, bounds.velocity, names, "velocity")
        curves(torque_axis, t, tau, bounds.effort, robot.model.drive_names, "torque")
        if fastest is not None:
            if fastest.time_optimal is None:
                _draw_active_limits(lowest_axis, fastest, names)
            else:
                curves(lowest_axis, t, fastest.jerk(t), fastest.bounds.jerk, names, "jerk")
            _draw_phase_plane(right_figure.subplots(), fastest, names)
        lowest_axis.set_xlabel("time [s]")
        legend(velocity_axis)
        return style.save(drawn, path)


_TIME_PER_LETTER = 0.013
"""Share of the duration that each letter of a label on the strip needs."""


def _draw_active_limits(axis: style.Axes, fastest: Fastest, names: tuple[str, ...]) -> None:
    """Draw a strip of the limits that the motion is at, in the colours of their joints."""
    for contact in fastest.limit_contacts:
        k = names.index(contact.joint)
        colour = style.SERIES[k % len(style.SERIES)]
        options: dict[str, Any] = {"color": colour, "edgecolor": style.PAPER, "linewidth": 0}
        if contact.kind == "velocity":
            options["hatch"] = "///"
        axis.barh(0, contact.end - contact.begin, left=contact.begin, height=0.8, **options)
        label = contact.joint.removesuffix("_joint")
        max_letters = (contact.end - contact.begin) / fastest.duration / _TIME_PER_LETTER
        if len(label) > max_letters:
            label = label.replace("_", "\n", 1)
        longest_line = max(label.split("\n"), key=len)
        if len(longest_line) <= max_letters:
            box = {"facecolor": colour, "edgecolor": "none", "pad": 1.5}
            middle = (contact.begin + contact.end) / 2
            axis.text(
                middle, 0, label, color=style.PAPER, ha="center", va="center", fontsize=style.SMALL_FONT, bbox=box
            )
    axis.set_yticks([])
    axis.grid(visible=False)
    caption = "active limits: torques plain, velocities hatched (dotted beside)"
    axis.set_title(caption, loc="left", color=style.QUIET, fontsize=style.SMALL_FONT)
    axis.set_xlim(0, fastest.duration)


def _draw_phase_plane(axis: style.Axes, fastest: Fastest, names: tuple[str, ...]) -> None:
    """Draw the rate along the path over the path, under the limit curves of torques and velocities."""
    limits = fastest.limit_curves()
    s, rate = limits.path
    time_optimal = fastest if fastest.time_optimal is None else fastest.time_optimal
    fastest_s, fastest_rate = time_optimal.limit_curves().path
    top_rate = 1.9 * float(fastest_rate.max())  # of the axis: limit curves above the motion are seen
    far_above = 10 * top_rate  # in place of infinite limits
    torque_limit = np.minimum(limits.torque, far_above)
    velocity_limit = np.minimum(limits.velocity, far_above)
    lower_limit = np.minimum(torque_limit, velocity_limit)
    axis.fill_between(limits.s, lower_limit, far_above, color=style.OVER, alpha=0.08, linewidth=0)
    axis.fill_between(limits.s, 0, lower_limit, color=style.GREEN, alpha=0.07, linewidth=0)
    if limits.torque.min() < top_rate:
        label = "limit curve: torques leave one acceleration"
        axis.plot(limits.s, torque_limit, "-", color=style.OVER, linewidth=1.2, label=label)
    if np.isfinite(limits.velocity).any():
        axis.plot(limits.s, velocity_limit, "--", color=style.QUIET, linewidth=1.2, label="largest joint velocity")
    if fastest.time_optimal is not None:
        axis.plot(s, rate, color=style.LINE, linewidth=2.0, label="motion within the limits of jerk")
        axis.plot(fastest_s, fastest_rate, ":", color=style.LINE, label="fastest without them")
    else:
        _draw_rate_by_joint(axis, fastest, names)
    style.titles(axis, "phase plane")
    axis.set(xlim=(0, 1), ylim=(0, top_rate), xlabel="s, along the path", ylabel="ds/dt [1/s]")
    axis.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")


def _draw_rate_by_joint(axis: style.Axes, fastest: Fastest, names: tuple[str, ...]) -> None:
    """Draw the rate of a time-optimal motion, each part in the colour of the limiting joint."""
    limits = fastest.limit_curves()
    s, rate = limits.path
    axis.plot(s, rate, color=style.LINE, linewidth=4.5, alpha=0.25, label="fastest motion, coloured by limiting joint")
    next_begins = [contact.s for contact in fastest.limit_contacts[1:]]
    ends = [*next_begins, 1.0]  # the last one ends with the path
    for contact, end in zip(fastest.limit_contacts, ends, strict=True):
        part = (s >= contact.s) & (s <= end)  # mask of samples
        k = names.index(contact.joint)
        colour = style.SERIES[k % len(style.SERIES)]
        dashes = ":" if contact.kind == "velocity" else "-"
        axis.plot(s[part], rate[part], color=colour, linewidth=2.0, linestyle=dashes)
    options: dict[str, Any] = {"color": style.PAPER, "markeredgecolor": style.LINE, "markersize": 5}
    switch_s, switch_rate = limits.switches
    axis.plot(switch_s, switch_rate, "o", label="another limit takes over", **options)


complete(globals())
