"""Error of a simulation relative to its motion, with remarks on large errors and drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.numbers import percent
from ...core.typing import Array
from ..methods.schemes import ADAPTIVE

if TYPE_CHECKING:
    from ...robot import Robot

MIN_REPORTED_DRIFT = 0.01
"""Energy drift from which there is a remark, as a fraction of the energy exchanged."""
MIN_REPORTED_ERROR = 0.05
"""Error from which there is a remark, as a fraction of the motion. Errors are added without sign; smaller sums mean little."""
MIN_TRAVEL = 1e-9
"""Travel [rad or m] below which a joint is at rest."""
MAX_PRINTED_RATIO = 1e4
"""Largest multiple of the motion that is printed as a number."""
_ABOVE_MAX_RATIO = "more than 10 000 times"
"""Text for larger multiples."""
MAX_ROWS = 2000
"""Largest number of states from which the travel is computed; of longer runs, this number of states is taken."""


@dataclass(frozen=True, eq=False)
class Extent:
    """Extent of the motion of the joints in a run; all revolute joints have equal values, and all prismatic joints."""

    travels: Array
    """(nv,) [rad or m]: largest travel among the joints of the same kind."""
    spans: Array
    """(nv,) [s]: this travel divided by the largest speed among the joints of the kind; 0 if none moves."""

    @property
    def rests(self) -> Array:
        """Mask (nv,) of joints that do not move."""
        return np.asarray(self.travels < MIN_TRAVEL)

    @classmethod
    def from_states(cls, robot: Robot, states: Array) -> Extent:
        """Extent of the states (n, nq + nv or more)."""
        rows: Any = slice(None)
        if len(states) > MAX_ROWS:
            rows = np.linspace(0, len(states) - 1, MAX_ROWS).round().astype(int)
        displacements_of_rows = robot.subtract(states[rows, : robot.nq], states[0, : robot.nq])
        displacements = np.ascontiguousarray(displacements_of_rows.T)  # contiguous rows are faster
        rates = np.ascontiguousarray(states[:, robot.nq : robot.nq + robot.nv].T)
        joint_travels = displacements.max(axis=1) - displacements.min(axis=1)
        joint_speeds = np.maximum(rates.max(axis=1), -rates.min(axis=1))
        travels = np.zeros(robot.nv)
        spans = np.zeros(robot.nv)
        turning: list[bool] = []  # of each velocity
        for body in robot.model.leaders:
            turning += body.joint.turning
        is_angular = np.array(turning, bool)
        for is_of_kind in (is_angular, ~is_angular):  # masks of revolute and of prismatic joints
            if not is_of_kind.any():
                continue
            largest_travel = joint_travels[is_of_kind].max()
            largest_speed = joint_speeds[is_of_kind].max()
            travels[is_of_kind] = largest_travel
            if largest_speed > 0.0:
                spans[is_of_kind] = largest_travel / largest_speed
        return cls(travels, spans)


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Error of each coordinate, and of the motion as a whole."""

    error: Array
    """(nv,) rad or m, NaN if unknown."""
    relative: float
    """Largest ratio of an error to the travel."""

    @classmethod
    def from_error(cls, extent: Extent, error: Array) -> Accuracy:
        """Accuracy from an error (nv,) and the extent of the motion."""
        ratios = error / np.maximum(extent.travels, MIN_TRAVEL)
        return cls(error, float(np.max(ratios)))

    @property
    def remarkable(self) -> bool:
        """True if the relative error is large enough to be reported."""
        return self.relative > MIN_REPORTED_ERROR

    def remarks(self, method: str, relative_drift: float) -> list[str]:
        """Remarks on large errors and drift."""
        option = "rtol" if method == ADAPTIVE else "dt"
        remarks = []
        if self.remarkable:
            ratio = f"about {_percent(self.relative)} of"
            if self.relative >= MAX_PRINTED_RATIO:
                ratio = _ABOVE_MAX_RATIO
            remarks.append(f"the errors of its steps add up to {ratio} the motion: take a smaller {option}")
        if relative_drift > MIN_REPORTED_DRIFT:
            remarks.append(
                f"the energy drift is {_percent(relative_drift)} of the energy exchanged: the motion, or the recorded "
                f"work, is wrong: take a smaller {option}"
            )
        return remarks


def _percent(ratio: float) -> str:
    """Ratio in percent, with two digits below 100 %; words for a ratio that is too large or NaN."""
    if not ratio < MAX_PRINTED_RATIO:
        return _ABOVE_MAX_RATIO
    digits = 2 if ratio < 1.0 else None
    return percent(ratio, digits)
