"""Methods of motions for plots, pages and recordings, whose packages depend on this one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

from ..core.glossary import complete
from ..mechanics.model.limits import Limits

if TYPE_CHECKING:
    from ..robot import Robot
    from ..viz.page import ShownPage
    from .motion import Motion


class MotionDoors:
    """Methods of a motion that call packages above this one."""

    def plot(self, path: str | Path, bounds: Limits | None = None, *, friction: bool = False) -> Path:
        """Plot velocities and torques relative to their limits.

        Parameters
        ----------
        path : str or Path; the suffix determines the format (.png, .pdf, .svg)

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        MissingExtraError
            matplotlib is not installed.
        ValueRangeError
            The file cannot be written.
        """
        from ..viz.plots.motion import plot_motion

        return plot_motion(cast("Motion", self), path, bounds, friction=friction)

    def show(self, robot: Robot | None = None, *, embed: bool = False, control: str | None = None) -> ShownPage:
        """Show a page of the motion: in a notebook below the cell, otherwise in the browser.

        Parameters
        ----------
        robot : Robot, optional, with the same coordinates; default: the motion's robot
        embed, control : as for :func:`twistwrench.viz.write_page`

        Returns
        -------
        page : ShownPage

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> t = np.linspace(0, 1, 21)
        >>> tw.Motion(t, np.sin(t)[:, None], robot=tw.robots.pendulum()).show()  # doctest: +SKIP
        """
        from ..reports.drawn_motion import motion_of
        from ..viz.page import show

        motion = cast("Motion", self)
        if robot is not None:
            motion = motion.with_robot(robot)
        return show(motion.robot, motion=motion_of(motion.robot, motion), embed=embed, control=control)

    def to_mcap(self, path: str | Path) -> Path:
        """Write an MCAP recording of ROS 2, for Foxglove and ``twistwrench torques``.

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        MissingExtraError, ValueRangeError
            mcap-ros2-support is not installed, the file cannot be written, or times are negative.
        """
        from ..reports.recordings.mcap import write_mcap
        from ..reports.recordings.recording import Recording

        return write_mcap(path, Recording.from_motion(cast("Motion", self)))

    def to_rerun(self, path: str | Path, robot: Robot | None = None) -> Path:
        """Write an .rrd file for rerun: the moving robot, and a curve for each joint.

        Parameters
        ----------
        robot : Robot, optional, with the same coordinates; default: the motion's robot

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        MissingExtraError, ValueRangeError
            rerun-sdk is not installed, the file cannot be written, or times are negative.
        """
        from ..reports.recordings.recording import Recording
        from ..reports.recordings.rerun_file import write_rerun

        motion = cast("Motion", self)
        if robot is not None:
            motion = motion.with_robot(robot)
        return write_rerun(path, Recording.from_motion(motion))


complete(globals())
