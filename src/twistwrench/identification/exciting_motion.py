"""Exciting motions: at rest at both ends, and how sure the numbers will be that :func:`identify` finds in their logs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import number
from ..listing import listed
from ..motion.bounds import Bounds
from ..motion.motion import Motion
from ..robot import Robot
from ..typing import Array
from ..verdict import Verdict
from .motion_information import MotionInformation
from .motion_room import DENSE, MotionRoom
from .rest_series import RestSeries

_JUDGED = 2001
"""Instants at which a motion is judged, at least."""
NAMES = {"itself": "itself", "floor": "the floor"}
"""What clearances are from."""


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """Exciting motion of one robot, at rest at both ends, and what its log will tell.

    Attributes
    ----------
    robot : Robot
    series : RestSeries, the functions of time
    coefficients : (nv, 1 + 2 N) array, of the series [rad, m]
    room : MotionRoom that was kept to, a share of the robot's limits among it
    information : MotionInformation, by which it was chosen
    step : float, between samples of :attr:`motion` [s]
    """

    robot: Robot
    series: RestSeries
    coefficients: Array
    room: MotionRoom
    information: MotionInformation
    step: float

    def __repr__(self) -> str:
        return (
            f"<ExcitingMotion of {self.robot.name!r}: {number(self.duration)} s, {self.series.harmonics} harmonics, "
            f"condition {number(self.condition)}>"
        )

    @property
    def bounds(self) -> Bounds:
        """Limits that were kept, a share of the robot's."""
        return self.room.bounds

    @property
    def duration(self) -> float:
        """From the beginning to the end [s]."""
        return self.series.duration

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """q, dq and ddq (..., nv) at t (...) [s]; before and after, it rests where it begins and ends."""
        times = np.asarray(arguments.finite(t, "t"), float)
        q, dq, ddq = (
            x.reshape(*times.shape, -1) for x in self.series.states(self.coefficients, np.atleast_1d(times).ravel())
        )
        return q, dq, ddq

    @cached_property
    def motion(self) -> Motion:
        """Samples of it: what ``torques``, ``view`` and ``simulate`` take."""
        count = max(6, round(self.duration / self.step))
        t = np.linspace(0.0, self.duration, count + 1)
        return Motion(t, *self(t), robot=self.robot, in_seconds=True)

    @cached_property
    def _rows(self) -> Array:
        return self.information.rows(*self(np.linspace(0.0, self.duration, _JUDGED)))

    @property
    def groups(self) -> tuple[str, ...]:
        """The base parameters in words."""
        return self.information.base.names

    @cached_property
    def predicted_deviations(self) -> Array:
        """(r,) deviations of the base parameters to expect at the torque noise that was told, with 25 rows a second."""
        return self.information.deviations(self._rows)

    @cached_property
    def log_det(self) -> float:
        """Log determinant of the information, in SI units."""
        return self.information.log_det(self._rows)

    @cached_property
    def condition(self) -> float:
        """Condition number of the rows' columns, in SI units."""
        return self.information.condition(self._rows)

    @cached_property
    def peaks(self) -> dict[str, Array]:
        """Largest ``velocity``, ``acceleration`` and ``torque`` (nv,) each, and ``lower`` and ``upper`` positions."""
        q, dq, ddq = self(np.linspace(0.0, self.duration, _JUDGED))
        tau = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=True))
        found = {name: np.abs(x).max(axis=0) for name, x in (("velocity", dq), ("acceleration", ddq), ("torque", tau))}
        return {"lower": q.min(axis=0), "upper": q.max(axis=0), **found}

    @cached_property
    def clearances(self) -> dict[str, float]:
        """Least distances [m] of the capsules from the ``floor`` and from each other, ``itself``, of what was looked at."""
        count = max(_JUDGED, int(np.ceil(self.duration / DENSE)) + 1)
        found = self.room.capsules.distances(self(np.linspace(0.0, self.duration, count))[0])
        count = len(self.room.capsules.pairs)
        parts = {"itself": found[:, :count], "floor": found[:, count:]}
        return {name: float(part.min()) for name, part in parts.items() if part.size}

    @property
    def unwatched(self) -> tuple[str, ...]:
        """What was not looked at, in sentences."""
        itself = (
            () if self.room.capsules.itself or self.room.clear is not None else ("distances of links from each other",)
        )
        return (*itself, *self.room.capsules.unwatched)

    @cached_property
    def verdict(self) -> Verdict:
        """OK only where clearances were looked at, by the file's own shapes; else UNSURE.

        Examples
        --------
        >>> import twistwrench as tw
        >>> found = tw.identification.exciting_trajectory(tw.robots.pendulum(), 4.0, 2, acceleration=5.0)
        >>> print(found.verdict)  # one link has nothing to touch
        OK
        """
        capsules, unsure = self.room.capsules.capsules, list[str]()
        if capsules.assumed and (self.clearances or self.unwatched):
            count, most = len(capsules.assumed), number(1000.0 * capsules.thickness)
            lacking = "a link has no shape" if count == 1 else f"{count} links have no shapes"
            unsure.append(
                f"{lacking} in the robot's file, so clearances are those of assumed capsules of {most} mm around "
                f"{listed(capsules.assumed, 4)}; a file with <collision> or <visual> shapes gives true ones"
            )
        unsure += [f"not looked at: {sentence}" for sentence in self.unwatched]
        near = {name: value for name, value in self.clearances.items() if value <= 0.0}
        unsure += [f"it comes to {number(1000.0 * value)} mm from {NAMES[name]}" for name, value in near.items()]
        return Verdict.of(unsure=unsure)

    def to_csv(self, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a CSV file that ``twistwrench torques`` reads.

        Parameters
        ----------
        path : str or Path
        degrees : bool, angles in degrees

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            Nothing can be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> found = tw.identification.exciting_trajectory(tw.robots.pendulum(), 4.0, 2, acceleration=5.0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(found.to_csv(f"{folder}/motion.csv").read_text().splitlines()[0])
        time,hinge,hinge.vel,hinge.acc
        """
        return self.motion.to_csv(path, degrees=degrees)
