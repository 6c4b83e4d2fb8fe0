"""Information: what all rows of logs say of a robot's groups, as sums that add up, in a small file in place of the logs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import number
from ..errors import ValueRangeError
from ..robot import Robot
from ..typing import Array
from .evidence import LogDoubt
from .held_out import HeldOutRows
from .information_file import information_arguments, write_information
from .information_fit import fit_of
from .joint_moments import JointMoments
from .normal_equations import Prior
from .streamed_rows import RowFrame
from .weights import Method

if TYPE_CHECKING:
    from .identified_robot import IdentifiedRobot


@dataclass(frozen=True, eq=False, repr=False)
class Information:
    """Information of logs: sums over all their rows, which add up, are saved, and go on next week.

    Attributes
    ----------
    robot : Robot, as its file has it
    frame : RowFrame, groups and settings that all rows were made with
    moments : JointMoments
    weak : Prior, that groups without information keep to
    sizes : (p,) array, that each unknown parameter could have at most
    method : str, ``irls``, ``wls`` or ``ols``
    seconds : float, of logs [s]
    samples : int, of logs
    hanging : float, rows that residuals hang together over
    logs : tuple of str, their names
    doubts : tuple of LogDoubt, of the excerpts that settings were chosen on
    shown : HeldOutRows, optional, rows of an excerpt, measured and predicted, for pictures
    payload_frame : str or None, what carries the payload that alone was sought
    """

    robot: Robot
    frame: RowFrame
    moments: JointMoments
    weak: Prior
    sizes: Array
    method: Method
    seconds: float
    samples: int
    hanging: float
    logs: tuple[str, ...]
    doubts: tuple[LogDoubt, ...] = ()
    shown: HeldOutRows | None = None
    payload_frame: str | None = None

    def __repr__(self) -> str:
        return (
            f"<Information of {self.robot.name!r}: {self.frame.base.count} groups, {self.samples} samples, "
            f"{len(self.logs)} logs, {number(self.seconds / 3600)} h>"
        )

    def __add__(self, other: Information) -> Information:
        """Of both; raises ValueRangeError where they were made with other groups or settings."""
        if not isinstance(other, Information):
            return NotImplemented
        mine, their = self.frame, other.frame
        for what, a, b in (
            ("groups", mine.base.names, their.base.names),
            ("known values", dict(mine.base.unknown.known), dict(their.base.unknown.known)),
            ("payloads", self.payload_frame, other.payload_frame),
            ("cut-offs [Hz]", mine.settings.cutoff, their.settings.cutoff),
            ("offsets of the clock [s]", mine.settings.shift, their.settings.shift),
            ("friction speeds", mine.settings.friction_speed.tolist(), their.settings.friction_speed.tolist()),
            ("weights", (self.method, *mine.sigma, *mine.x), (other.method, *their.sigma, *their.x)),
            ("chosen settings", (mine.free_shift, mine.free_speed), (their.free_shift, their.free_speed)),
        ):
            if a != b:
                raise ValueRangeError(
                    f"these do not add up: their {what} differ. Gather the new logs like the old ones, like=…, or --add FILE."
                )
        new = tuple(d for d in other.doubts if (d.kind, d.joints) not in {(x.kind, x.joints) for x in self.doubts})
        return replace(
            self,
            moments=self.moments + other.moments,
            seconds=self.seconds + other.seconds,
            samples=self.samples + other.samples,
            logs=(*self.logs, *other.logs),
            doubts=(*self.doubts, *new),
        )

    @property
    def values(self) -> Array:
        """(r,) values of the groups."""
        return fit_of(self).solved(np.arange(len(self.moments.counts)))[0][: self.frame.base.count]

    def identified(self, test: Information | None = None) -> IdentifiedRobot:
        """The robot that all rows together tell.

        Parameters
        ----------
        test : Information, optional, of logs that are only predicted, gathered like this one

        Returns
        -------
        found : IdentifiedRobot

        Raises
        ------
        TrajectoryError
            The logs are too short to hold a part of them out.
        ValueRangeError
            ``test`` was made with other groups or settings.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> tw.identification.gather(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=()).identified().base.count
        3
        """
        from .gathered_robot import gathered_robot

        return gathered_robot(self, test)

    def check(self) -> float:
        """The largest difference of a group by orthogonal factors (TSQR), in units of its standard deviation.

        Returns
        -------
        difference : float

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> information = tw.identification.gather(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> information.check() < 1e-6
        True
        """
        fit = fit_of(self)
        x, sigma = fit.solved(np.arange(len(self.moments.counts)))
        deviations = fit.covariance(x, sigma, 0.0).deviations
        r = self.frame.base.count
        return float((np.abs(fit.by_factors() - x)[:r] / np.maximum(deviations, 1e-300)).max(initial=0.0))

    def save(self, path: str | Path) -> Path:
        """Save as a small file, whole or not at all.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            The file cannot be written.

        Examples
        --------
        >>> import tempfile, numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> information = tw.identification.gather(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = tw.identification.Information.load(information.save(f"{folder}/week.npz"), arm)
        >>> bool((again.values == information.values).all())
        True
        """
        return write_information(self, path)

    @classmethod
    def load(cls, path: str | Path, robot: Robot) -> Information:
        """Load what :meth:`save` wrote.

        Parameters
        ----------
        path : str or Path
        robot : Robot, the same

        Returns
        -------
        information : Information

        Raises
        ------
        NotFoundError, ShapeError
            There is no such file, or it is none that can be read.
        ValueRangeError
            It is of another robot.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.identification.Information.load("none.npz", tw.robots.pendulum())
        Traceback (most recent call last):
        twistwrench.errors.NotFoundError: no information 'none.npz'. Give a file that --information wrote.
        """
        return cls(**information_arguments(path, robot))
