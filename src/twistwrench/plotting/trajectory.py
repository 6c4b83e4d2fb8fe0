"""A motion as a picture: what each joint uses of its limits, what limits the fastest motion when, and the phase plane."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..core.printed_numbers import number
from ..motion.bounds import Bounds, bounds_or_own
from ..trajectories.fastest import Fastest
from .joint_curves import COLOURS, curves, legend
from .style import GREEN, LINE, OVER, QUIET, SMALL, figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..trajectories.trajectory import Trajectory

_SAMPLES = 3001


def plot_trajectory(
    trajectory: Trajectory, path: str | Path, bounds: Bounds | None = None, *, friction: bool = False
) -> Path:
    """Plot of a trajectory, the phase plane beside it where it is a fastest one.

    Parameters
    ----------
    trajectory : Trajectory
    path : str or Path; the suffix says the kind (.png, .pdf, .svg)
    bounds : Bounds, optional, limits that are drawn
    friction : bool, torques count the friction of the joints

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    MissingExtraError
        There is no matplotlib.
    ValueRangeError
        The file cannot be written.

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
    tau = robot.inverse_dynamics(q, dq, ddq, friction=friction)
    title = f"{robot.name} · {trajectory.path.name} · {trajectory.scaling.name} timing, {number(trajectory.duration)} s"
    with figure(11.25 if fast else 7.5, 6.3 if fast else 5.6, title) as drawn:
        if fast:
            left, right = cast("Any", drawn.subfigures(1, 2, width_ratios=[1.25, 1]))
        else:
            left = cast("Any", drawn)
        ratios = [1, 1, 0.28] if fast else [1, 1]
        axes = left.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
        names = robot.model.velocity_names
        curves(axes[0], t, dq, bounds.velocity, names, "velocity")
        curves(axes[1], t, tau, bounds.effort, names, "torque")
        if fast:
            _bar(axes[2], fast, names)
            _phase_plane(right.subplots(), fast, names)
        axes[-1].set_xlabel("time [s]")
        legend(axes[0])
        return save(drawn, path)


def _bar(axis: Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    for touch in fast.touches:
        k = names.index(touch.joint)
        axis.barh(
            0,
            touch.end - touch.begin,
            left=touch.begin,
            color=COLOURS[k % len(COLOURS)],
            height=0.8,
            hatch="///" if touch.kind == "velocity" else None,
            edgecolor="white",
            linewidth=0,
        )
    axis.set_yticks([])
    axis.grid(visible=False)
    axis.set_title(
        "what is at its limit: torques plain, velocities hatched (dotted beside)",
        loc="left",
        color=QUIET,
        fontsize=SMALL,
    )
    axis.set_xlim(0, fast.duration)


def _phase_plane(axis: Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    curves = fast.limit_curves()
    s, rate = curves.path
    top = 1.9 * float(rate.max())
    bound = np.minimum(np.minimum(curves.torque, curves.velocity), 10 * top)
    axis.fill_between(curves.s, bound, 10 * top, color=OVER, alpha=0.08, linewidth=0)
    axis.fill_between(curves.s, 0, bound, color=GREEN, alpha=0.07, linewidth=0)
    if curves.torque.min() < top:
        axis.plot(
            curves.s,
            np.minimum(curves.torque, 10 * top),
            color=OVER,
            linewidth=1.2,
            label="limit curve: torques leave one acceleration",
        )
    if np.isfinite(curves.velocity).any():
        axis.plot(
            curves.s,
            np.minimum(curves.velocity, 10 * top),
            color=QUIET,
            linewidth=1.2,
            linestyle="--",
            label="largest joint velocity",
        )
    axis.plot(s, rate, color=LINE, linewidth=4.5, alpha=0.25, label="fastest motion, coloured by what limits it")
    for touch, end in zip(fast.touches, [*(x.s for x in fast.touches[1:]), 1.0], strict=True):
        part = (s >= touch.s) & (s <= end)
        colour = COLOURS[names.index(touch.joint) % len(COLOURS)]
        axis.plot(s[part], rate[part], color=colour, linewidth=2.0, linestyle=":" if touch.kind == "velocity" else "-")
    axis.plot(
        *curves.switches, "o", color="white", markeredgecolor=LINE, markersize=5, label="another limit takes over"
    )
    axis.set(xlim=(0, 1), ylim=(0, top), xlabel="s, along the path", ylabel="ds/dt [1/s]")
    axis.set_title("phase plane", loc="left", fontweight="bold")
    axis.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none", fontsize=SMALL)
