"""What a torque run finds: the figures of each joint, the limits passed, and how far the numbers can be trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .derivatives import Differentiation, States
from .estimates import PeakEstimate
from .load import LoadedRobot
from .motors import MotorUse
from .strays import Stray
from .survey import Survey
from .tally import Gaps

if TYPE_CHECKING:
    from ..model.model import Limits
    from ..verdict import Verdict

Array = NDArray[Any]

ZERO = 1e-9
_SMALL = 0.02
"""Share of the robot's largest torque, or of its own limit, below which a joint's peak is no measure of its noise."""
NEGLIGIBLE = 0.001
"""Share of a peak from which noise is estimated, and worth a column."""
_AT_AN_END = 5.0
"""How many times as uncertain derived accelerations are at the ends of a log."""

__all__ = ["NEGLIGIBLE", "ZERO", "Excess", "JointTorque", "TorqueReport", "worst_joint"]


@dataclass(frozen=True)
class JointTorque:
    """What one joint's motor has to give."""

    joint: str
    unit: str
    peak: float
    """The torque of largest magnitude, with its sign."""
    time: float
    """When the peak occurs [s]."""
    rms: float
    limit: float
    """inf where none is known."""
    terms: dict[str, float]
    """The causes of the peak, by name; they add up to it."""
    noise: float
    """Standard deviation of single torques from noise of the log, as they were derived; 0 where accelerations are given.

    It varies with the pose. This is the largest over some 32 states, evenly spaced, of each chunk of rows worked on.
    """
    estimate: PeakEstimate | None = None
    """The peak without that noise; None where the noise does not matter."""

    @property
    def likely(self) -> float:
        """The peak without the noise of the log, with its sign."""
        return self.peak if self.estimate is None else self.estimate.value

    @property
    def uncertainty(self) -> float:
        """Standard deviation of :attr:`likely`."""
        return self.noise if self.estimate is None else self.estimate.sigma

    @property
    def when(self) -> float:
        """When :attr:`likely` occurs [s]."""
        return self.time if self.estimate is None else self.estimate.time

    @property
    def share(self) -> float:
        """|peak| over limit, without noise; 0 where there is no limit."""
        return abs(self.likely) / self.limit

    @property
    def main_cause(self) -> tuple[str, float]:
        """The term that pulls most in the peak's direction, and its share of the sum of those that do."""
        along = {name: value * np.sign(self.peak) for name, value in self.terms.items()}
        name = max(along, key=lambda n: float(along[n]))
        total = sum(v for v in along.values() if v > 0)
        return name, float(along[name] / total) if total else 0.0


@dataclass(frozen=True)
class Excess:
    """A limit that is passed, at its worst."""

    joint: str
    kind: str
    """``effort``, ``velocity``, ``lower`` or ``upper``."""
    value: float
    """With its sign; the limit of a torque or velocity holds for its magnitude."""
    limit: float
    time: float
    unit: str
    angular: bool


@dataclass(frozen=True, eq=False)
class TorqueReport:
    """Everything the report, the plot and the exit code are made from."""

    robot: str
    trajectory: str
    rows: int
    begin: float
    end: float
    joints: tuple[JointTorque, ...]
    excesses: tuple[Excess, ...]
    gaps: Gaps
    quality: Survey
    differentiation: Differentiation
    load: LoadedRobot
    envelope: tuple[Array, Array, Array]
    """Times (b,), least and greatest torques (b, nv) of the bins that a plot draws."""
    largest: Array
    """(nq,) the largest magnitude of each coordinate, in SI units."""
    limits: Limits
    """What was held against the motion."""
    strays: tuple[Stray, ...]
    """Samples that smoothing removed and noise does not explain, be it the one for the peaks only."""
    still: tuple[float, ...]
    """Of each joint: the share of rows in which it rests, or moves, within the noise of its derived velocity."""
    motors: tuple[MotorUse, ...]
    """What the motion asks of the motors that are described."""
    around: States
    """The states on either side of the worst joint's peak, a few thousand at most: all of a short motion."""
    contradictions: tuple[str, ...] = ()
    """A sentence for each thing by which the input contradicts itself, so that no figure can be trusted."""

    smoothed: Differentiation | None = None
    """What the peaks without noise come from; None where noise does not matter."""

    @cached_property
    def verdict(self) -> Verdict:
        """OK, UNSURE, OVER LIMIT or LOOK AGAIN, with the reasons."""
        from .reasons import verdict_of

        return verdict_of(self)

    @property
    def scale(self) -> float:
        """The largest torque; what is some 1e-9 of it is zero up to rounding."""
        return max((abs(j.peak) for j in self.joints), default=0.0)

    def is_zero(self, value: float) -> bool:
        """Whether a torque is but rounding of the others."""
        return abs(value) <= ZERO * self.scale

    def reference(self, joint: JointTorque) -> float:
        """What noise of that joint's torque is held against: its peak, unless that is next to nothing."""
        known = joint.limit if np.isfinite(joint.limit) else 0.0
        return max(abs(joint.peak), _SMALL * max(known, self.scale))

    def at_an_end(self, joint: JointTorque) -> bool:
        """Whether the joint's peak is where derived accelerations want for neighbours."""
        d = self.differentiation if self.smoothed is None else self.smoothed
        if d.source == "given":
            return False
        steps = 3 if not d.strengths.any() else math.ceil(d.strengths.max() ** (1 / 6))
        return min(joint.when - self.begin, self.end - joint.when) < steps * self.quality.step

    def reach(self, joint: JointTorque) -> float:
        """How far the peak may be off, as a standard deviation: several times its own at an end of the log."""
        return joint.uncertainty * (_AT_AN_END if self.at_an_end(joint) else 1.0)

    @property
    def worst(self) -> int | None:
        """The joint nearest to its limit, or of the largest peak where no limit is known; None without joints."""
        if not self.joints:
            return None
        return worst_joint([abs(j.likely) for j in self.joints], [j.limit for j in self.joints])


def worst_joint(peaks: Sequence[float] | Array, limits: Sequence[float] | Array) -> int:
    """The joint whose peak magnitude is the largest share of its limit; the largest peak among those without limits."""
    return max(range(len(peaks)), key=lambda k: (peaks[k] / limits[k], peaks[k]))
