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
_ZERO = 1e-9


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
    robot, t, dq = motion.load.with_load, motion.time, motion.dq
    terms = motion.load.terms(motion.states)
    power = motion.torques * dq
    friction, wrenches, springs = (
        _work(t, sign * (terms[name] * dq).sum(axis=1))
        for name, sign in (("friction", 1), ("wrench", -1), ("spring", 1))
    )
    kinetic, potential = np.asarray(robot.kinetic_energy(motion.q, dq)), np.asarray(robot.potential_energy(motion.q))
    return Energies(power, _work(t, power.sum(axis=1)), friction, wrenches, springs, kinetic, potential)


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
    terms, units = motion.load.terms(motion.states), Coordinates.from_model(motion.load.with_load.model).torque_units
    scale = float(np.abs(motion.torques).max(initial=0.0))
    names = motion.load.with_load.model.velocity_names
    large = {name: x for name, x in terms.items() if np.abs(x).max(initial=0.0) > _ZERO * scale}
    seen: dict[str, Any] = {}

    def draw(axis: style.Axes, k: int) -> None:
        areas, _, _ = style.stack(
            axis, motion.time, ((_TERMS[name], style.CAUSES[name], x[:, k]) for name, x in large.items())
        )
        seen.update(areas)
        (seen["together"],) = axis.plot(motion.time, motion.torques[:, k], color=style.INK, linewidth=1.2)
        axis.axhline(0, color=style.AXIS, linewidth=0.7)
        style.titles(axis, names[k], f"peak {quantity(motion.peaks[k], units[k])}")
        axis.set_ylabel(torque_word(units[k]), fontsize=style.SMALL_FONT)
        axis.margins(x=0)

    return _panels(motion, path, joints, "contributions to each torque", draw, seen, "time [s]")


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
    robot, t, e = motion.load.with_load, motion.time, energies(motion)
    power = e.power
    with style.figure(8.6, 5.6, f"{_title(motion)} · power and energy", "Drawing") as drawn:
        upper, lower = drawn.subplots(2, 1, sharex=True)
        style.draw_joints(upper, t, power, robot.model.velocity_names, np.abs(power).max(axis=0))
        upper.plot(t, power.sum(axis=1), color=style.INK, linewidth=1.5, label="all joints")
        upper.axhline(0, color=style.AXIS, linewidth=0.7)
        upper.set_ylabel("power [W]")
        highest = float(power.sum(axis=1).max(initial=0.0))
        style.titles(upper, "Power of the joints, τ dq", f"most together {quantity(highest, 'W')}")
        lower.fill_between(t, e.kinetic, color=style.SKY, alpha=0.5, linewidth=0, label="kinetic energy")
        lower.plot(t, e.potential - e.potential[0], color=style.AMBER, label="potential energy gained")
        gained = e.kinetic + e.potential - e.kinetic[0] - e.potential[0]
        lower.plot(t, gained, color=style.INK, linewidth=1.6, label="both gained")
        lower.plot(t, e.work, color=style.VERMILION, linestyle=(0, (4, 2)), label="work of the joints")
        for x, colour, label in (
            (e.friction, style.GREY, "lost to friction"),
            (e.springs, style.GREEN, "of it in springs"),
            (e.wrenches, style.PURPLE, "work of the wrenches"),
        ):
            if np.abs(x).max(initial=0.0) > _ZERO * max(1.0, float(np.abs(e.work).max(initial=0.0))):
                lower.plot(t, x, color=colour, label=label)
        lower.axhline(0, color=style.AXIS, linewidth=0.7)
        lower.set_ylabel("energy [J]")
        lower.set_xlabel("time [s]")
        style.titles(lower, "Work and energy since the beginning")
        for axis in (upper, lower):
            axis.margins(x=0)
            axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
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

    robot, coordinates = motion.load.with_load, Coordinates.from_model(motion.load.with_load.model)
    limits = robot.limits
    effort = joint_effort(robot.model, np.where(limits.effort > 0, limits.effort, np.inf))
    seen: dict[str, Any] = {}
    shades = Normalize(float(motion.time[0]), float(motion.time[-1]))

    def draw(axis: style.Axes, k: int) -> None:
        place = int(coordinates.position_of[k])
        # Velocities of ball, planar and floating joints are not coordinate rates, so their integrals are drawn.
        x, stops = _work(motion.time, motion.dq[:, k]), list[float]()
        if place >= 0:
            x, stops = motion.q[:, place], [limits.lower[k], limits.upper[k]]
        points = np.stack([x, motion.dq[:, k]], axis=1)
        steps = list(np.stack([points[:-1], points[1:]], axis=1))
        axis.add_collection(
            LineCollection(steps, array=motion.time[1:], cmap=style.time_colours(), norm=shades, linewidths=1.3)
        )
        end: dict[str, Any] = {"color": style.INK, "markersize": 4, "linestyle": "none"}
        (seen["beginning"],) = axis.plot(*points[0], "o", **end)
        (seen["end"],) = axis.plot(*points[-1], "s", markerfacecolor=style.PAPER, **end)
        low, high = points.min(axis=0), points.max(axis=0)
        pad = np.maximum(0.12 * (high - low), 0.02)
        for bound in stops:
            if low[0] - 6 * pad[0] <= bound <= high[0] + 6 * pad[0]:
                seen["limit"] = axis.axvline(bound, **style.LIMIT)
                low[0], high[0] = min(low[0], bound), max(high[0], bound)
        for bound in (-limits.velocity[k], limits.velocity[k]):
            if low[1] - 6 * pad[1] <= bound <= high[1] + 6 * pad[1]:
                seen["limit"] = axis.axhline(bound, **style.LIMIT)
                low[1], high[1] = min(low[1], bound), max(high[1], bound)
        axis.set_xlim(low[0] - pad[0], high[0] + pad[0])
        axis.set_ylim(low[1] - pad[1], high[1] + pad[1])
        axis.axhline(0, color=style.AXIS, linewidth=0.6)
        angular = bool(coordinates.angular_velocity[k])
        remark, colour = "no torque limit", style.QUIET
        if np.isfinite(effort[k]):
            share = motion.peaks[k] / effort[k]  # over all rows, as in the torque report
            remark = f"torque {percent_of_limit(share)}"
            if over_limit(share):
                colour = style.OVER
        style.titles(axis, robot.model.velocity_names[k], remark, colour)
        axis.set_ylabel(f"velocity [{unit_of('dq', angular)}]", fontsize=style.SMALL_FONT)
        axis.set_xlabel(f"position [{unit_of('q', angular)}]", fontsize=style.SMALL_FONT)

    return _panels(motion, path, joints, "velocity over position", draw, seen, "", shades)


def _panels(
    motion: DrawnMotion,
    path: str | Path,
    joints: Sequence[str],
    what: str,
    draw: Callable[[style.Axes, int], None],
    seen: dict[str, Any],
    below: str,
    shades: Any = None,
) -> Path:
    """Draw one panel per joint and a common legend of the labels in ``seen``; a colour bar of time if ``shades``."""
    chosen = _torque_indices(motion, joints)
    rows, columns = style.panel_grid(len(chosen))
    size = max(6.0, 3.4 * columns), 2.25 * rows + 0.9
    with style.figure(*size, f"{_title(motion)} · {what}", "Drawing") as drawn:
        axes = style.panels(drawn, len(chosen), sharex=bool(below))
        for k, axis in enumerate(axes):
            draw(axis, chosen[k])
            if below and len(chosen) <= k + columns:
                axis.tick_params(labelbottom=True)
                axis.set_xlabel(below, fontsize=style.SMALL_FONT)
        if shades is not None:
            from matplotlib.cm import ScalarMappable

            drawn.colorbar(
                ScalarMappable(shades, style.time_colours()), ax=axes, label="time [s]", shrink=0.8, aspect=35
            )
        abreast = min(int(size[0] // 2), len(seen))  # inches: the longest label takes two
        drawn.legend(list(seen.values()), list(seen), loc="outside lower left", ncols=abreast)
        return style.save(drawn, path)


def _torque_indices(motion: DrawnMotion, joints: Sequence[str]) -> list[int]:
    """Indices of the named joints' torques; all if none is named."""
    model = motion.load.with_load.model
    if not joints:
        return list(range(model.nv))
    joints = (joints,) if isinstance(joints, str) else joints
    places = {b.joint.name: range(b.v_index, b.v_index + b.joint.nv) for b in model.leaders}
    for name in joints:
        if name not in places:
            raise UnknownNameError.from_choices("joint", name, places)
    return [k for name in joints for k in places[name]]


def _title(motion: DrawnMotion) -> str:
    carried = " + ".join(f"{number(p.mass)} kg" for p in motion.load.payloads)
    return f"{motion.load.robot.name}{f' · payload {carried}' if carried else ''}"


def _work(t: Array, power: Array) -> Array:
    """Integral from the first sample by the trapezoidal rule; (n,), (n,) → (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (power[1:] + power[:-1]) / 2)])


# ── Velocities and torques as shares of their limits


def plot_motion(motion: Motion, path: str | Path, bounds: Limits | None = None, *, friction: bool = False) -> Path:
    """Plot velocities and torques of a motion as shares of their limits.

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
    bounds, names = bounds_or_own(motion.robot, bounds), motion.robot.model.velocity_names
    tau = motor_torques(motion.robot.model, motion.torques(friction=friction))
    with style.figure(7.5, 5.6, f"{motion.robot.name} · {len(motion)} states, {number(motion.duration)} s") as drawn:
        above, below = drawn.subplots(2, 1, sharex=True)
        curves(above, motion.time, motion.dq, bounds.velocity, names, "velocity")
        curves(below, motion.time, tau, bounds.effort, motion.robot.model.drive_names, "torque")
        below.set_xlabel("time [s]")
        legend(above)
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
    known = np.isfinite(limits)
    shares = bool(known.all())
    drawn = values / limits if shares else values
    style.draw_joints(axis, t, drawn, names, np.abs(drawn).max(axis=0))
    if shares:
        for side in (-1, 1):
            axis.axhline(side, **style.LIMIT)
        most = max(1.12, 1.05 * float(np.abs(drawn).max()))
        axis.set_ylim(-most, most)
    axis.axhline(0, color=style.QUIET, linewidth=0.6)
    axis.set_ylabel(f"{what} / limit" if shares else what)
    axis.margins(x=0)


complete(globals())
