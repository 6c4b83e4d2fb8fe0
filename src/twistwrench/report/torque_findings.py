"""What a torque run finds: the figures of each joint, the limits passed, and how far the numbers can be trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import torque
from ..motion.complete_states import States
from ..motion.differentiation import Differentiation
from ..motion.log_noise import Survey
from ..motion.log_outliers import Stray
from ..typing import Array
from .estimates import PeakEstimate
from .loaded_robot import LoadedRobot
from .measured import MeasuredTorque
from .motors import MotorUse
from .payload_room import PayloadRoom
from .running_statistics import Gaps

if TYPE_CHECKING:
    from ..model.limits import Limits
    from ..verdict import Verdict


ZERO = 1e-9
_SMALL = 0.02
"""Share of the robot's largest torque, or of its own limit, below which a joint's peak is no measure of its noise."""
NEGLIGIBLE = 0.001
"""Share of a peak from which noise is estimated, and worth a column."""
_AT_AN_END = 5.0
"""How many times as uncertain derived accelerations are at the ends of a log."""


@dataclass(frozen=True)
class JointTorque:
    """What one joint's motor has to give."""

    joint: str
    unit: str
    largest: float
    """The torque of largest magnitude, with its sign: of the smoothed motion, where noise matters."""
    time: float
    """When that, and the peak, occurs [s]."""
    rms: float
    limit: float
    """inf where none is known."""
    terms: dict[str, float]
    """The causes of :attr:`largest`, by name; they add up to it."""
    noise: float
    """Standard deviation of single torques from noise of the log, as they were derived; 0 where accelerations are given.

    It varies with the pose. This is the largest over some 32 states, evenly spaced, of each chunk of rows worked on.
    """
    estimate: PeakEstimate | None = None
    """The peak without that noise; None where the noise does not matter."""
    raw: float | None = None
    """The torque of largest magnitude as derived from the log as it is, with its sign; None where that is the peak itself."""
    raw_time: float | None = None
    """When that occurs [s]: noise may make it the largest at another instant."""

    @property
    def peak(self) -> float:
        """The largest torque that the motion takes, with its sign: without the noise of the log, as far as that is known."""
        return self.largest if self.estimate is None else self.estimate.value

    @property
    def chance(self) -> float:
        """What choosing the largest of many noisy torques adds, which is taken off: with the causes it makes the peak."""
        return self.peak - self.largest

    @property
    def uncertainty(self) -> float:
        """Standard deviation of :attr:`peak`."""
        return self.noise if self.estimate is None else self.estimate.sigma

    @property
    def share(self) -> float:
        """|peak| over limit; 0 where there is no limit."""
        return abs(self.peak) / self.limit

    @property
    def main_cause(self) -> tuple[str, float]:
        """The term that pulls most in the peak's direction, and its share of the sum of those that do."""
        along = {name: value * np.sign(self.largest) for name, value in self.terms.items()}
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
class AsDerived:
    """What a noisy log gives as it is, before it is smoothed: named beside the answer, and drawn pale behind it."""

    differentiation: Differentiation
    excesses: tuple[Excess, ...]
    envelope: tuple[Array, Array, Array]
    """As that of the report."""
    motors: tuple[MotorUse, ...]


@dataclass(frozen=True, eq=False)
class TorqueReport:
    """Everything the report, the plot and the exit code are made from.

    Where the noise of the log matters, all of it is of the smoothed motion but ``derived``.
    """

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
    band: tuple[Array, Array, Array] | None
    """The same of the 95 % intervals of single torques of a noisy log; None where noise does not matter."""
    largest: Array
    """(nq,) the largest magnitude of each coordinate, in SI units."""
    limits: Limits
    """What was held against the motion."""
    strays: tuple[Stray, ...]
    """Samples that smoothing removed and noise does not explain."""
    still: tuple[float, ...]
    """Of each joint: the share of rows in which it rests, or moves, within the noise of its derived velocity."""
    motors: tuple[MotorUse, ...]
    """What the motion asks of the motors that are described."""
    around: States
    """The states on either side of the worst joint's peak, a few thousand at most: all of a short motion."""
    contradictions: tuple[str, ...] = ()
    """A sentence for each thing by which the input contradicts itself, so that no figure can be trusted."""

    hints: tuple[str, ...] = ()
    """A sentence for each thing in the input that is odd, and may yet be meant."""
    measured: tuple[MeasuredTorque, ...] = ()
    """The torques that the log has itself, of each joint, beside those computed; empty where it has none."""
    idle_payload: bool = False
    """Whether payloads with a mass make no torque in any joint."""
    room: PayloadRoom | None = None
    """How heavy the one payload may be; None where that is not known, or there is none or several."""
    derived: AsDerived | None = None
    """What the log gives as it is; None where that is the answer, or was not asked for."""

    @property
    def noisy(self) -> bool:
        """Whether the noise of the log matters, so that peaks are estimates."""
        return any(j.estimate is not None for j in self.joints)

    @cached_property
    def verdict(self) -> Verdict:
        """OK, UNSURE, OVER LIMIT or LOOK AGAIN, with the reasons."""
        from .torque_verdict import verdict_of

        return verdict_of(self)

    @property
    def scale(self) -> float:
        """The largest torque; what is some 1e-9 of it is zero up to rounding."""
        return max((abs(j.largest) for j in self.joints), default=0.0)

    def is_zero(self, value: float) -> bool:
        """Whether a torque is but rounding of the others."""
        return abs(value) <= ZERO * self.scale

    def label(self, value: float) -> str:
        """A torque with four digits; 0 for what is but rounding of the others."""
        return "0" if self.is_zero(value) else torque(value)

    def reference(self, joint: JointTorque) -> float:
        """What noise of that joint's torque is held against: its peak, unless that is next to nothing."""
        known = joint.limit if np.isfinite(joint.limit) else 0.0
        return max(abs(joint.peak), _SMALL * max(known, self.scale))

    def at_an_end(self, joint: JointTorque) -> bool:
        """Whether the joint's peak is where derived accelerations want for neighbours."""
        d = self.differentiation
        if d.source == "given":
            return False
        steps = 3 if not d.smooths else math.ceil(d.strengths.max() ** (1 / 6))
        return min(joint.time - self.begin, self.end - joint.time) < steps * self.quality.step

    def reach(self, joint: JointTorque) -> float:
        """How far the peak may be off, as a standard deviation: several times its own at an end of the log."""
        return joint.uncertainty * (_AT_AN_END if self.at_an_end(joint) else 1.0)

    @property
    def worst(self) -> int | None:
        """The joint nearest to its limit, or of the largest peak where no limit is known; None without joints."""
        if not self.joints:
            return None
        return worst_joint([abs(j.peak) for j in self.joints], [j.limit for j in self.joints])


def worst_joint(peaks: Sequence[float] | Array, limits: Sequence[float] | Array) -> int:
    """The joint whose peak magnitude is the largest share of its limit; the largest peak among those without limits."""
    return max(range(len(peaks)), key=lambda k: (peaks[k] / limits[k], peaks[k]))
