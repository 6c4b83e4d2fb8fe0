"""Velocities and torques of joints over time, as shares of their limits where all have one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import number
from ..motion.bounds import Bounds, bounds_or_own
from ..typing import Array
from .style import BLUE, GREEN, GREY, LIMIT, ORANGE, PURPLE, QUIET, SKY, SMALL, VERMILION, YELLOW, figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..motion.motion import Motion

COLOURS = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, GREY, YELLOW)
_JOINTS = 24


def plot_motion(motion: Motion, path: str | Path, bounds: Bounds | None = None, *, friction: bool = False) -> Path:
    """Plot of velocities and torques of a motion as shares of their limits.

    Parameters
    ----------
    motion : Motion
    path : str or Path; the suffix says the kind (.png, .pdf, .svg)
    bounds : Bounds, optional; None: the robot's own
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
    >>> t = np.linspace(0, 1, 101)
    >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_motion(motion, f"{folder}/motion.svg").name
    'motion.svg'
    """
    bounds, names = bounds_or_own(motion.robot, bounds), motion.robot.model.velocity_names
    tau = motion.torques(friction=friction)
    with figure(7.5, 5.6, f"{motion.robot.name} · {len(motion)} states, {number(motion.duration)} s") as drawn:
        above, below = drawn.subplots(2, 1, sharex=True)
        curves(above, motion.time, motion.dq, bounds.velocity, names, "velocity")
        curves(below, motion.time, tau, bounds.effort, names, "torque")
        below.set_xlabel("time [s]")
        legend(above)
        return save(drawn, path)


def legend(axis: Axes) -> None:
    """Legend of the joints above a panel.

    Parameters
    ----------
    axis : Matplotlib's Axes

    Examples
    --------
    >>> from twistwrench.plotting.style import figure
    >>> with figure(4, 3, "velocities") as drawn:
    ...     axis = drawn.subplots()
    ...     _ = axis.plot([0, 1], label="joint1")
    ...     legend(axis)
    >>> len(axis.get_legend().get_texts())
    1
    """
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.08), ncols=3, frameon=False, fontsize=SMALL - 0.5, borderpad=0)


def curves(axis: Axes, t: Array, values: Array, limits: Array, names: tuple[str, ...], what: str) -> None:
    """Curves of a quantity of each joint, as shares of its limits where all have one that moves, else the values themselves.

    Parameters
    ----------
    axis : Matplotlib's Axes
    t : (n,) array [s]
    values : (n, nv) array
    limits : (nv,) array, inf where nothing is limited
    names : tuple of nv str
    what : str, of the quantity

    Examples
    --------
    >>> from twistwrench.plotting.style import figure
    >>> with figure(4, 3, "velocities") as drawn:
    ...     axis = drawn.subplots()
    ...     curves(axis, np.arange(3.0), np.ones((3, 1)), np.full(1, 2.0), ("joint1",), "velocity")
    >>> axis.get_ylabel()
    'velocity / limit'
    """
    known = np.isfinite(limits)
    shares = bool(known.all())
    for k, name in enumerate(names[:_JOINTS]):
        y = values[:, k] / limits[k] if shares else values[:, k]
        axis.plot(t, y, color=COLOURS[k % len(COLOURS)], linewidth=1.2, label=name)
    if shares:
        for side in (-1, 1):
            axis.axhline(side, **LIMIT)
        most = max(1.12, 1.05 * float(np.abs(values / limits).max()))
        axis.set_ylim(-most, most)
    axis.axhline(0, color=QUIET, linewidth=0.6)
    axis.set_ylabel(f"{what} / limit" if shares else what)
    axis.margins(x=0)
