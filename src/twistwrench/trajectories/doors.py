"""Plots of trajectories, which stand above this package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

from ..core.glossary import complete
from ..mechanics.model.limits import Limits

if TYPE_CHECKING:
    from .trajectory import Trajectory


class TrajectoryDoors:
    """Methods of a trajectory that call packages above this one."""

    def plot(self, path: str | Path, bounds: Limits | None = None, *, friction: bool = False) -> Path:
        """Plot motion and torques as shares of their limits, with the phase plane of a fastest motion; .png, .pdf or .svg.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> moving = tw.trajectories.move(tw.robots.ur5(), [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     moving.plot(f"{folder}/move.svg").name
        'move.svg'
        """
        from ..viz.plots.simulation import plot_trajectory

        return plot_trajectory(cast("Trajectory", self), path, bounds, friction=friction)


complete(globals())
