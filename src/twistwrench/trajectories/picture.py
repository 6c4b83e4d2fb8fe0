"""A motion as a picture: what each joint uses of its limits, what limits the fastest motion when, and the phase plane."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..figure import BLUE, GREEN, GREY, LINE, ORANGE, OVER, PURPLE, QUIET, SKY, SMALL, VERMILION, YELLOW, figure, save
from .fastest import Fastest
from .limits import Bounds, bounds_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .trajectory import Trajectory

Array = NDArray[Any]

__all__ = ["plot_trajectory"]

_COLOURS = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, GREY, YELLOW)
_SAMPLES = 3001
_JOINTS = 24


def plot_trajectory(
    trajectory: Trajectory, path: str | Path, bounds: Bounds | None = None, *, friction: bool = False
) -> Path:
    """Draw the motion to ``path``, the phase plane beside it where it is a fastest one; the file written.

    Raises MissingExtraError without matplotlib, ValueRangeError where the file cannot be written.
    """
    robot = trajectory.robot
    fast = trajectory if isinstance(trajectory, Fastest) else None
    if bounds is None:
        bounds = fast.bounds if fast else bounds_of(robot)
    friction = fast.rows.friction if fast else friction
    t = np.linspace(0.0, trajectory.duration, _SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = robot.inverse_dynamics(q, dq, ddq, friction=friction)
    title = f"{robot.name} · {trajectory.path.name} · {trajectory.scaling.name} timing, {trajectory.duration:.4g} s"
    with figure(11.25 if fast else 7.5, 6.3 if fast else 5.6, title) as drawn:
        if fast:
            left, right = cast("Any", drawn.subfigures(1, 2, width_ratios=[1.25, 1]))
        else:
            left = cast("Any", drawn)
        ratios = [1, 1, 0.28] if fast else [1, 1]
        axes = left.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
        names = robot.model.velocity_names
        _curves(axes[0], t, dq, bounds.velocity, names, "velocity")
        _curves(axes[1], t, tau, bounds.effort, names, "torque")
        if fast:
            _bar(axes[2], fast, names)
            _phase_plane(right.subplots(), fast, names)
        axes[-1].set_xlabel("time [s]")
        axes[0].legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.08), ncols=3, frameon=False, fontsize=SMALL - 0.5, borderpad=0
        )
        return save(drawn, path)


def _curves(axis: Axes, t: Array, values: Array, limits: Array, names: tuple[str, ...], what: str) -> None:
    """Shares of the limits where all have one that moves, else the values themselves."""
    known = np.isfinite(limits)
    shares = bool(known.all())
    for k, name in enumerate(names[:_JOINTS]):
        y = values[:, k] / limits[k] if shares else values[:, k]
        axis.plot(t, y, color=_COLOURS[k % len(_COLOURS)], linewidth=1.2, label=name)
    if shares:
        for side in (-1, 1):
            axis.axhline(side, color=OVER, linewidth=0.9, linestyle=(0, (4, 3)))
        most = max(1.12, 1.05 * float(np.abs(values / limits).max()))
        axis.set_ylim(-most, most)
    axis.axhline(0, color=QUIET, linewidth=0.6)
    axis.set_ylabel(f"{what} / limit" if shares else what)
    axis.margins(x=0)


def _bar(axis: Axes, fast: Fastest, names: tuple[str, ...]) -> None:
    for touch in fast.touches:
        k = names.index(touch.joint)
        axis.barh(
            0,
            touch.end - touch.begin,
            left=touch.begin,
            color=_COLOURS[k % len(_COLOURS)],
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
        colour = _COLOURS[names.index(touch.joint) % len(_COLOURS)]
        axis.plot(s[part], rate[part], color=colour, linewidth=2.0, linestyle=":" if touch.kind == "velocity" else "-")
    axis.plot(
        *curves.switches, "o", color="white", markeredgecolor=LINE, markersize=5, label="another limit takes over"
    )
    axis.set(xlim=(0, 1), ylim=(0, top), xlabel="s, along the path", ylabel="ds/dt [1/s]")
    axis.set_title("phase plane", loc="left", fontweight="bold")
    axis.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none", fontsize=SMALL)
