"""Plots of a motion: torque contributions, power and energy, phase plane, velocities and torques against limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.errors import UnknownNameError
from ...core.glossary import complete
from ...core.numbers import number, over_limit, percent_of_limit, quantity
from ...core.typing import Array
from ...mechanics.joints.units import torque_word, unit_of
from ...mechanics.model.couplings import joint_effort, motor_torques
from ...mechanics.model.limits import Limits
from ...motion.bounds import bounds_or_own
from ...motion.coordinates import Coordinates
from ...reports.drawn_motion import DrawnMotion
from .. import style

if TYPE_CHECKING:
    from ...motion.motion import Motion

_TERMS = {
    "inertia": "inertia, M ddq",
    "coriolis": "Coriolis and centrifugal",
    "gravity": "gravity",
    "spring": "springs",
    "payload": "payload",
    "wrench": "wrenches on it",
    "contact": "forces of the ground",
    "friction": "friction",
}
"""Label of each term of the torques."""
_NEGLIGIBLE_SHARE = 1e-9
"""Share of the largest torque or work below which a term is not drawn: rounding errors."""
_MIN_WORK_SCALE = 1.0
"""Least work [J] of which a negligible work is a share."""
_PADDING = 0.12
"""Space around a phase plot, as a share of its extent."""
_MIN_PADDING = 0.02
"""Least space around a phase plot, in units of its axis."""
_MAX_PADDINGS_TO_LIMIT = 6
"""Largest distance of a limit that is drawn from the curve, in spaces around the plot."""


class Energies(NamedTuple):
    """Energy balance of a motion over time; all fields except ``power`` are (n,) J, relative to the first sample."""

    power: Array
    """(n, nv) τ dq of each joint [W]."""
    work: Array
    """Work of the joints."""
    friction: Array
    """Energy lost to friction."""
    wrenches: Array
    """Work of the wrenches on the robot."""
    springs: Array
    """Energy stored in springs; part of the potential energy."""
    kinetic: Array
    """Kinetic energy, absolute."""
    potential: Array
    """Potential energy, absolute."""


def energies(motion: DrawnMotion) -> Energies:
    """Work and energies of a motion: work - friction + wrenches equals the gain of kinetic and potential energy.

    Works are trapezoidal integrals over the kept samples.

    Returns
    -------
    energies : Energies

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench.viz import motion_of
    >>> t = np.linspace(0, 1, 201)
    >>> found = energies(motion_of(tw.robots.pendulum(), t, np.sin(t)[:, None]))
    >>> gain = (found.kinetic + found.potential)[-1] - (found.kinetic + found.potential)[0]
    >>> bool(abs(found.work[-1] - gain) < 1e-3)
    True
    """
    robot = motion.load.with_load
    t = motion.time
    dq = motion.dq
    terms = motion.load.terms(motion.states)
    power = motion.torques * dq

    def power_against(term: str) -> Array:
        """Power (n,) of the joints' torques against a term [W]."""
        return np.asarray((terms[term] * dq).sum(axis=1))

    return Energies(
        power=power,
        work=_work(t, power.sum(axis=1)),
        friction=_work(t, power_against("friction")),
        wrenches=_work(t, -power_against("wrench")),  # work on the robot
        springs=_work(t, power_against("spring")),
        kinetic=np.asarray(robot.kinetic_energy(motion.q, dq)),
        potential=np.asarray(robot.potential_energy(motion.q)),
    )


def plot_split(motion: DrawnMotion, path: str | Path, joints: Sequence[str] = ()) -> Path:
    """Plot the contributions to each joint's torque over time; they add up to τ.

    Terms of MR eq. 8.1, with payload, wrenches, springs and friction separate.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> from twistwrench.viz import motion_of
    >>> t = np.linspace(0, 1, 21)
    >>> motion = motion_of(tw.robots.planar_2r(), t, np.outer(np.sin(t), [1, 2]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_split(motion, f"{folder}/split.png").name
    'split.png'
    """
    model = motion.load.with_load.model
    units = Coordinates.from_model(model).torque_units
    largest_torque = float(np.abs(motion.torques).max(initial=0.0))
    min_drawn = _NEGLIGIBLE_SHARE * largest_torque
    terms = motion.load.terms(motion.states)
    drawn_terms = {name: x for name, x in terms.items() if np.abs(x).max(initial=0.0) > min_drawn}
    legend_handles: dict[str, Any] = {}

    def draw(axis: style.Axes, k: int) -> None:
        layers = [(_TERMS[name], style.CAUSES[name], x[:, k]) for name, x in drawn_terms.items()]
        areas, _, _ = style.stack(axis, motion.time, layers)
        legend_handles.update(areas)
        (total_line,) = axis.plot(motion.time, motion.torques[:, k], color=style.INK, linewidth=1.2)
        legend_handles["together"] = total_line
        axis.axhline(0, color=style.AXIS, linewidth=0.7)
        style.titles(axis, model.velocity_names[k], f"peak {quantity(motion.peaks[k], units[k])}")
        axis.set_ylabel(torque_word(units[k]), fontsize=style.SMALL_FONT)
        axis.margins(x=0)

    return _panels(motion, path, joints, "contributions to each torque", draw, legend_handles, "time [s]")


def plot_power(motion: DrawnMotion, path: str | Path) -> Path:
    """Plot the power of each joint, and work and energies over time.

    Work of the joints, minus friction losses, plus work of wrenches equals the gain of kinetic and potential energy.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> from twistwrench.viz import motion_of
    >>> t = np.linspace(0, 1, 21)
    >>> motion = motion_of(tw.robots.planar_2r(), t, np.outer(np.sin(t), [1, 2]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_power(motion, f"{folder}/power.svg").name
    'power.svg'
    """
    t = motion.time
    balance = energies(motion)
    power = balance.power
    total_power = power.sum(axis=1)
    with style.figure(8.6, 5.6, f"{_title(motion)} · power and energy", "Drawing") as drawn:  # inches
        power_axis, energy_axis = drawn.subplots(2, 1, sharex=True)
        names = motion.load.with_load.model.velocity_names
        style.draw_joints(power_axis, t, power, names, np.abs(power).max(axis=0))
        power_axis.plot(t, total_power, color=style.INK, linewidth=1.5, label="all joints")
        power_axis.axhline(0, color=style.AXIS, linewidth=0.7)
        power_axis.set_ylabel("power [W]")
        max_power = float(total_power.max(initial=0.0))
        style.titles(power_axis, "Power of the joints, τ dq", f"most together {quantity(max_power, 'W')}")
        energy_axis.fill_between(t, balance.kinetic, color=style.SKY, alpha=0.5, linewidth=0, label="kinetic energy")
        potential_gain = balance.potential - balance.potential[0]
        energy_axis.plot(t, potential_gain, color=style.AMBER, label="potential energy gained")
        total_gain = balance.kinetic + balance.potential - balance.kinetic[0] - balance.potential[0]
        energy_axis.plot(t, total_gain, color=style.INK, linewidth=1.6, label="both gained")
        dashes = (0, (4, 2))
        energy_axis.plot(t, balance.work, color=style.VERMILION, linestyle=dashes, label="work of the joints")
        work_scale = max(_MIN_WORK_SCALE, float(np.abs(balance.work).max(initial=0.0)))
        for x, colour, label in (
            (balance.friction, style.GREY, "lost to friction"),
            (balance.springs, style.GREEN, "of it in springs"),
            (balance.wrenches, style.PURPLE, "work of the wrenches"),
        ):
            if np.abs(x).max(initial=0.0) > _NEGLIGIBLE_SHARE * work_scale:
                energy_axis.plot(t, x, color=colour, label=label)
        energy_axis.axhline(0, color=style.AXIS, linewidth=0.7)
        energy_axis.set_ylabel("energy [J]")
        energy_axis.set_xlabel("time [s]")
        style.titles(energy_axis, "Work and energy since the beginning")
        for axis in (power_axis, energy_axis):
            axis.margins(x=0)
            axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))  # right of the panel
        return style.save(drawn, path)


def plot_phase(motion: DrawnMotion, path: str | Path, joints: Sequence[str] = ()) -> Path:
    """Phase plot: velocity over position of each joint.

    Coloured by time; position and velocity limits are dashed if the motion comes near them.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> from twistwrench.viz import motion_of
    >>> t = np.linspace(0, 1, 21)
    >>> motion = motion_of(tw.robots.planar_2r(), t, np.outer(np.sin(t), [1, 2]))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_phase(motion, f"{folder}/phase.svg").name
    'phase.svg'
    """
    style.require_matplotlib("Drawing")
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize

    robot = motion.load.with_load
    coordinates = Coordinates.from_model(robot.model)
    limits = robot.limits
    # a limit of 0 stands for an unknown one
    effort = joint_effort(robot.model, np.where(limits.effort > 0, limits.effort, np.inf))
    legend_handles: dict[str, Any] = {}
    time_scale = Normalize(float(motion.time[0]), float(motion.time[-1]))

    def draw(axis: style.Axes, k: int) -> None:
        velocity = motion.dq[:, k]
        coordinate_index = int(coordinates.position_of[k])
        if coordinate_index >= 0:
            position = motion.q[:, coordinate_index]
            position_limits = [limits.lower[k], limits.upper[k]]
        else:  # velocities of ball, planar and floating joints are not coordinate rates, so their integrals are drawn
            position = _work(motion.time, velocity)
            position_limits = []
        points = np.stack([position, velocity], axis=1)
        segments = list(np.stack([points[:-1], points[1:]], axis=1))
        axis.add_collection(
            LineCollection(segments, array=motion.time[1:], cmap=style.time_colours(), norm=time_scale, linewidths=1.3)
        )
        marker_style: dict[str, Any] = {"color": style.INK, "markersize": 4, "linestyle": "none"}
        (legend_handles["beginning"],) = axis.plot(*points[0], "o", **marker_style)
        (legend_handles["end"],) = axis.plot(*points[-1], "s", markerfacecolor=style.PAPER, **marker_style)
        low = points.min(axis=0)  # least position and least velocity
        high = points.max(axis=0)
        padding = np.maximum(_PADDING * (high - low), _MIN_PADDING)
        max_distance = _MAX_PADDINGS_TO_LIMIT * padding
        for bound in position_limits:
            if low[0] - max_distance[0] <= bound <= high[0] + max_distance[0]:
                legend_handles["limit"] = axis.axvline(bound, **style.LIMIT)
                low[0] = min(low[0], bound)
                high[0] = max(high[0], bound)
        for bound in (-limits.velocity[k], limits.velocity[k]):
            if low[1] - max_distance[1] <= bound <= high[1] + max_distance[1]:
                legend_handles["limit"] = axis.axhline(bound, **style.LIMIT)
                low[1] = min(low[1], bound)
                high[1] = max(high[1], bound)
        axis.set_xlim(low[0] - padding[0], high[0] + padding[0])
        axis.set_ylim(low[1] - padding[1], high[1] + padding[1])
        axis.axhline(0, color=style.AXIS, linewidth=0.6)
        angular = bool(coordinates.angular_velocity[k])
        remark, colour = _torque_remark(motion.peaks[k], effort[k])  # the peak over all rows, as in the torque report
        style.titles(axis, robot.model.velocity_names[k], remark, colour)
        axis.set_ylabel(f"velocity [{unit_of('dq', angular)}]", fontsize=style.SMALL_FONT)
        axis.set_xlabel(f"position [{unit_of('q', angular)}]", fontsize=style.SMALL_FONT)

    title = "velocity over position"
    return _panels(motion, path, joints, title, draw, legend_handles, x_label="", time_scale=time_scale)


def _torque_remark(peak: float, limit: float) -> tuple[str, str]:
    """Text on a peak torque and its limit, inf if there is none, and the colour of the text."""
    if not np.isfinite(limit):
        return "no torque limit", style.QUIET
    share = peak / limit
    colour = style.OVER if over_limit(share) else style.QUIET
    return f"torque {percent_of_limit(share)}", colour


def _panels(
    motion: DrawnMotion,
    path: str | Path,
    joints: Sequence[str],
    title: str,
    draw: Callable[[style.Axes, int], None],
    legend_handles: dict[str, Any],
    x_label: str,
    time_scale: Any = None,
) -> Path:
    """Draw one panel per torque with ``draw``, and a common legend of the handles that it adds by label.

    Panels share the x axis if it has a label. If there is a time scale, its colour bar is drawn.
    """
    torque_indices = _torque_indices(motion, joints)
    panel_count = len(torque_indices)
    rows, columns = style.panel_grid(panel_count)
    width = max(6.0, 3.4 * columns)  # inches
    height = 2.25 * rows + 0.9
    with style.figure(width, height, f"{_title(motion)} · {title}", "Drawing") as drawn:
        axes = style.panels(drawn, panel_count, sharex=bool(x_label))
        for k, axis in enumerate(axes):
            draw(axis, torque_indices[k])
            is_lowest = k + columns >= panel_count
            if x_label and is_lowest:
                axis.tick_params(labelbottom=True)  # a shared axis hides them above an empty cell
                axis.set_xlabel(x_label, fontsize=style.SMALL_FONT)
        if time_scale is not None:
            from matplotlib.cm import ScalarMappable

            drawn.colorbar(
                ScalarMappable(time_scale, style.time_colours()), ax=axes, label="time [s]", shrink=0.8, aspect=35
            )
        legend_columns = min(int(width // 2), len(legend_handles))  # the longest label takes two inches
        drawn.legend(
            list(legend_handles.values()), list(legend_handles), loc="outside lower left", ncols=legend_columns
        )
        return style.save(drawn, path)


def _torque_indices(motion: DrawnMotion, joints: Sequence[str]) -> list[int]:
    """Indices of the named joints' torques; all if none is named."""
    model = motion.load.with_load.model
    if not joints:
        return list(range(model.nv))
    joints = (joints,) if isinstance(joints, str) else joints
    indices_by_joint: dict[str, range] = {}
    for body in model.leaders:
        indices_by_joint[body.joint.name] = range(body.v_index, body.v_index + body.joint.nv)
    for name in joints:
        if name not in indices_by_joint:
            raise UnknownNameError.from_choices("joint", name, indices_by_joint)
    return [k for name in joints for k in indices_by_joint[name]]


def _title(motion: DrawnMotion) -> str:
    """Name of the robot, and the masses of its payloads."""
    title = motion.load.robot.name
    masses = " + ".join(f"{number(p.mass)} kg" for p in motion.load.payloads)
    if masses:
        title += f" · payload {masses}"
    return title


def _work(t: Array, power: Array) -> Array:
    """Integral from the first sample by the trapezoidal rule; (n,), (n,) → (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (power[1:] + power[:-1]) / 2)])


# ── Velocities and torques as shares of their limits


def plot_motion(motion: Motion, path: str | Path, bounds: Limits | None = None, *, friction: bool = False) -> Path:
    """Plot velocities and torques of a motion as shares of their limits, by default the robot's own.

    Parameters
    ----------
    motion : Motion

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> t = np.linspace(0, 1, 101)
    >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_motion(motion, f"{folder}/motion.svg").name
    'motion.svg'
    """
    bounds = bounds_or_own(motion.robot, bounds)
    model = motion.robot.model
    tau = motor_torques(model, motion.torques(friction=friction))
    title = f"{motion.robot.name} · {len(motion)} states, {number(motion.duration)} s"
    with style.figure(7.5, 5.6, title) as drawn:  # inches
        velocity_axis, torque_axis = drawn.subplots(2, 1, sharex=True)
        curves(velocity_axis, motion.time, motion.dq, bounds.velocity, model.velocity_names, "velocity")
        curves(torque_axis, motion.time, tau, bounds.effort, model.drive_names, "torque")
        torque_axis.set_xlabel("time [s]")
        legend(velocity_axis)
        return style.save(drawn, path)


def legend(axis: style.Axes) -> None:
    """Legend of the joints above a panel.

    Parameters
    ----------
    axis : Matplotlib's Axes

    Examples
    --------
    >>> from twistwrench.viz.style import figure
    >>> with figure(4, 3, "velocities") as drawn:
    ...     axis = drawn.subplots()
    ...     _ = axis.plot([0, 1], label="joint1")
    ...     legend(axis)
    >>> len(axis.get_legend().get_texts())
    1
    """
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.08), ncols=3, borderpad=0)


def curves(axis: style.Axes, t: Array, values: Array, limits: Array, names: tuple[str, ...], what: str) -> None:
    """Draw a quantity of each joint, as shares of the limits if every moving joint has one, otherwise in its own unit.

    Parameters
    ----------
    axis : Matplotlib's Axes
    t : (n,) array [s]
    values : (n, nv) array
    limits : (nv,) array, inf without a limit
    names : tuple of nv str
    what : str, name of the quantity

    Examples
    --------
    >>> from twistwrench.viz.style import figure
    >>> with figure(4, 3, "velocities") as drawn:
    ...     axis = drawn.subplots()
    ...     curves(axis, np.arange(3.0), np.ones((3, 1)), np.full(1, 2.0), ("joint1",), "velocity")
    >>> axis.get_ylabel()
    'velocity / limit'
    """
    all_limited = bool(np.isfinite(limits).all())
    drawn_values = values / limits if all_limited else values
    largest_values = np.abs(drawn_values).max(axis=0)
    style.draw_joints(axis, t, drawn_values, names, largest_values)
    if all_limited:
        for share in (-1, 1):
            axis.axhline(share, **style.LIMIT)
        max_share = max(1.12, 1.05 * float(np.abs(drawn_values).max()))  # the limits, or the curves, with some space
        axis.set_ylim(-max_share, max_share)
    axis.axhline(0, color=style.QUIET, linewidth=0.6)
    axis.set_ylabel(f"{what} / limit" if all_limited else what)
    axis.margins(x=0)


complete(globals())
