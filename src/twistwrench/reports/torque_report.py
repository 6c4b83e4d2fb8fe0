"""Torque report of a motion: peaks, limits, causes and uncertainties."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..core.answers.answer import Answer
from ..core.doubts import Doubt
from ..core.errors import UnknownNameError
from ..core.estimation.noise import Survey
from ..core.numbers import MISSING, percent_of_limit, quantity, seconds, torque
from ..core.typing import Array
from ..core.verdict import Word
from ..motion.differentiation import Differentiation, MotionSamples, Outlier
from ..motion.limits_file import robot_origin
from ..motion.load_case import LoadCase, PayloadMargin
from ..motion.model_doubts import friction_words
from ..motion.plausibility import DoubtfulSpans
from .measured_torque import MeasuredTorque
from .motors import MotorUse
from .statistics import Gaps, PeakEstimate
from .support.answers import SupportAnswers

if TYPE_CHECKING:
    from ..core.answers.blocks import Block
    from ..core.answers.card import Shares
    from ..core.answers.page import Setting
    from ..core.verdict import Verdict
    from ..mechanics.model.limits import Limits
    from ..motion.motion import Motion
    from ..statics.clearance import PathClearance
    from ..statics.reactions import MountingLoad
    from ..statics.support import Support

ZERO = 1e-9
"""Fraction of the robot's largest torque up to which a torque is a rounding error."""
MIN_REFERENCE_SHARE = 0.02
"""Fraction of the robot's largest torque, or of the joint's limit, below which a peak is not a reference for noise."""
MIN_NOISE_SHARE = 0.001
"""Fraction of a peak above which noise is estimated and shown in a column."""
_CHUNK_ROWS = 8192
"""Number of states whose torques are computed together."""
_UNCERTAINTY_FACTOR_AT_ENDS = 5.0
"""Uncertainty of a peak at an end of the log, over that of an equal peak in its middle."""
_STEPS_NEAR_END = 3
"""Sampling steps from an end of the log within which derived accelerations are less accurate, without smoothing."""


@dataclass(frozen=True)
class JointTorque:
    """Torque over a motion of one joint, or of a motor that drives several joints; all torques are in ``unit``."""

    joint: str
    unit: str
    largest: float
    """Torque of largest magnitude, with its sign; from the smoothed motion if noise matters."""
    time: float
    """Time of :attr:`largest` and of the peak [s]."""
    rms: float
    limit: float
    """Torque limit; inf if unknown."""
    terms: dict[str, float]
    """Causes of :attr:`largest` by name; their sum is that torque."""
    noise: float
    """Standard deviation of single derived torques due to noise of the log; 0 if accelerations are given.

    It varies with the pose; this is the largest over 32 evenly spaced states of each chunk of rows.
    """
    estimate: PeakEstimate | None = None
    """Noise-corrected peak; None if the noise does not matter."""
    raw: float | None = None
    """Torque of largest magnitude derived from the unsmoothed log, with its sign; None if equal to the peak."""
    raw_time: float | None = None
    """Time of that torque [s], which noise may shift."""

    @property
    def peak(self) -> float:
        """Largest torque of the motion, with its sign; noise-corrected if an estimate exists."""
        if self.estimate is None:
            return self.largest
        return self.estimate.value

    @property
    def chance(self) -> float:
        """Correction for selecting the largest of many noisy torques: :attr:`peak` minus :attr:`largest`."""
        return self.peak - self.largest

    @property
    def uncertainty(self) -> float:
        """Standard deviation of :attr:`peak`."""
        if self.estimate is None:
            return self.noise
        return self.estimate.sigma

    @property
    def share(self) -> float:
        """|peak| over limit; 0 without a limit."""
        return abs(self.peak) / self.limit

    @property
    def main_cause(self) -> tuple[str, float]:
        """Largest term in the direction of the peak, and its share of the sum of terms in this direction."""
        torques = np.array(list(self.terms.values()))
        torques_along_peak = torques * np.sign(self.largest)
        main_index = int(torques_along_peak.argmax())
        name = list(self.terms)[main_index]
        total = sum(torques_along_peak[torques_along_peak > 0])
        if not total:
            return name, 0.0
        return name, float(torques_along_peak[main_index] / total)


@dataclass(frozen=True)
class Excess:
    """Largest excess over an exceeded limit."""

    joint: str
    kind: str
    """``effort``, ``velocity``, ``lower`` or ``upper``."""
    value: float
    """Value with its sign; limits of torque and velocity apply to the magnitude."""
    limit: float
    time: float
    unit: str
    angular: bool


@dataclass(frozen=True)
class NearLimit:
    """Velocity or position nearest to a limit of a joint."""

    joint: str
    kind: str
    """``velocity`` or ``position``."""
    share: float
    """Velocity over its limit; for a position, distance from the middle of its range over half the range."""
    time: float


@dataclass(frozen=True)
class BearingUse:
    """Largest load of one kind on the bearing of a joint, with its limit."""

    joint: str
    kind: str
    """``axial``, ``radial`` or ``tilting``."""
    value: float
    """Largest load [N, tilting: N m]."""
    limit: float
    time: float

    @property
    def share(self) -> float:
        """Load over limit."""
        return self.value / self.limit


@dataclass(frozen=True, eq=False)
class SoundFigures:
    """Figures of a motion without the rows in doubtful spans."""

    peaks: Array
    """Largest torques (nv,), as magnitudes; those of the whole motion if torques do not depend on derived rates."""
    excesses: tuple[Excess, ...]


@dataclass(frozen=True, eq=False)
class AsDerived:
    """Results of a noisy log before smoothing, listed beside the final results and drawn pale behind them."""

    differentiation: Differentiation
    excesses: tuple[Excess, ...]
    envelope: tuple[Array, Array, Array]
    """Minima and maxima over time, as :attr:`TorqueReport.envelope`."""
    motors: tuple[MotorUse, ...]


class Joints(tuple[JointTorque, ...]):
    """Torques of the joints, by number or by name."""

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:  # a number, a slice, or a name
        if not isinstance(key, str):
            return super().__getitem__(key)
        for joint in self:
            if joint.joint == key:
                return joint
        raise UnknownNameError.from_choices("joint", key, [joint.joint for joint in self])


@dataclass(frozen=True, eq=False, repr=False)
class TorqueReport(Answer):
    """Torques of a motion, compared with limits and split by cause: result of :func:`twistwrench.check`.

    If noise of the log matters, all results except ``derived`` are those of the smoothed motion.

    Examples
    --------
    >>> import twistwrench as tw
    >>> answer = tw.check("ur5", "demo", payload=5)
    >>> answer.joints["elbow_joint"].main_cause[0], answer.peaks.shape, answer.torques().shape
    ('payload', (6,), (751, 6))
    >>> answer.facts()["share of limit"], len(answer.motion), answer.label(answer.peaks[0]), answer.is_zero(1e-12)
    ('76 %', 751, '35.29', True)
    >>> worst = answer.joints[answer.worst]
    >>> answer.at_an_end(worst), answer.reach(worst), bool(answer.reference(worst) == abs(worst.peak))
    (False, 0.0, True)
    >>> list(answer.sources()), answer.shares().values.shape[1], answer.with_why
    (['MOTION', 'ROBOT'], 6, False)
    """

    call: ClassVar[str] = "torques"

    robot: str
    """Name of the robot."""
    trajectory: str
    """File of the motion."""
    rows: int
    """Number of states."""
    begin: float
    """Time of the first state [s]."""
    end: float
    """Time of the last state [s]."""
    joints: Joints
    """Torque of each joint, by number or by name."""
    excesses: tuple[Excess, ...]
    """Exceeded limits."""
    gaps: Gaps
    """Pauses of the log, and the motion that they hide."""
    quality: Survey
    """Sampling and noise of the log."""
    differentiation: Differentiation
    """Derivation of rates from the log."""
    load: LoadCase
    """Robot with its payloads and wrenches."""
    envelope: tuple[Array, Array, Array]
    """Times (b,), minimum and maximum torques (b, nv) of the bins of a plot."""
    band: tuple[Array, Array, Array] | None
    """Times and bounds of the 95 % intervals of single torques of a noisy log; None if noise does not matter."""
    largest: Array
    """Largest magnitude of each coordinate, (nq,), in SI units."""
    limits: Limits
    """Limits of the comparison."""
    outliers: tuple[Outlier, ...]
    """Samples that smoothing removed and noise does not explain."""
    stationary: tuple[float, ...]
    """Share of rows for each joint whose velocity is within the noise of derived velocities."""
    motors: tuple[MotorUse, ...]
    """Demands of the motion on the described motors."""
    around: MotionSamples
    """At most a few thousand states before and after the worst joint's peak; all states of a short motion."""
    doubts: tuple[Doubt, ...] = ()
    """Doubts and notes about the log that do not require dynamics."""
    measured: tuple[MeasuredTorque, ...] = ()
    """Measured torques of each joint in the log, compared with computed ones; empty if the log has none."""
    causes: tuple[Doubt, ...] = ()
    """Causes of measured torques that the robot's equations cannot explain with any parameters."""
    idle_payload: bool = False
    """True if payloads with mass do not load any joint."""
    payload_margin: PayloadMargin | None = None
    """Largest mass of a single payload; None if unknown, or unless there is exactly one payload."""
    clearance: PathClearance | None = None
    """Least distance between links; None if not requested."""
    held: SupportAnswers = field(default_factory=SupportAnswers)
    """Answers on ground, mounting and grip, as :attr:`support`, :attr:`mounting` and :attr:`grip` return them."""
    derived: AsDerived | None = None
    """Results of the unsmoothed log; None if they are the final results or were not requested."""
    near: tuple[NearLimit, ...] = ()
    """Velocity and position nearest to their limits, nearest first."""
    bearings: tuple[BearingUse, ...] = ()
    """Largest loads of the bearings that have limits."""
    spans: DoubtfulSpans = field(default_factory=DoubtfulSpans)
    """Spans of time with rows that are missing, repeated or wrong, so that derived figures in them are unknown."""
    sound: SoundFigures | None = None
    """Figures of the rows outside these spans; None without spans."""
    degrees: bool = False
    """True if the caller chose degrees for angles."""
    with_why: bool = False
    """True if the peak of the worst joint is also split by link."""

    @property
    def support(self) -> Support | None:
        """Contact forces and margins by feet and wheels; None if they are not given."""
        return self.held.support

    @property
    def mounting(self) -> MountingLoad | None:
        """Wrench on the foundation; None if not requested."""
        return None if self.held.mounting is None else self.held.mounting.load

    @property
    def bolt_loads(self) -> Array | None:
        """(n, bolts, 2): axial load with the preload, pulling if above 0, and shear load [N]; None without bolts."""
        return None if self.held.mounting is None else self.held.mounting.bolts

    @property
    def grip(self) -> Support | None:
        """Contact forces and margins of the payload in fingers or in a suction cup; None if they are not given."""
        return None if self.held.grip is None else self.held.grip.support

    @property
    def grip_force(self) -> Array | None:
        """(n,): force of the fingers, or vacuum force, that holds the payload [N]; inf if no force does; None without grip."""
        return None if self.held.grip is None else self.held.grip.needed

    @property
    def noisy(self) -> bool:
        """True if noise of the log matters; peaks are then estimates."""
        return any(j.estimate is not None for j in self.joints)

    @property
    def in_degrees(self) -> bool:
        """True if angles are shown in degrees: the log has them, or the caller chose degrees."""
        return self.degrees or self.differentiation.trajectory.columns.has_degrees

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict with reasons: OK, UNSURE, OVER LIMIT, COLLISION or LOOK AGAIN."""
        from .torque_verdict import verdict_of

        return verdict_of(self, degrees=self.in_degrees)

    # ── The answer on every surface

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    @property
    def subject(self) -> str:
        """Robot and motion."""
        return f"{self.robot} · {Path(self.trajectory).name}"

    @property
    def brief(self) -> str:
        """Worst joint with its share of its torque limit, or the joint beyond another limit if only that is exceeded."""
        if self.worst is None:
            return ""
        if self.verdict.word is Word.OVER_LIMIT and self.excesses:
            excess = self.excesses[0]
            if excess.kind != "effort":
                return f"{excess.joint}, {excess.kind} limit"
        joint = self.joints[self.worst]
        if math.isfinite(joint.limit):
            return f"{joint.joint} {percent_of_limit(joint.share)}"
        return f"{joint.joint} {self.label(joint.peak)} {joint.unit}"

    def blocks(self) -> Iterator[Block]:
        """Verdict, peaks, causes, measured torques, motors, exceeded limits and remarks."""
        from .torque_view import report_view

        return report_view(self)

    def facts(self) -> Mapping[str, str]:
        """Peak, limit, share and time of the worst joint.

        Returns
        -------
        facts : {name: text}
        """
        if self.worst is None:
            return {}
        joint = self.joints[self.worst]
        share = MISSING
        if math.isfinite(joint.limit):
            share = percent_of_limit(joint.share)
        return {
            f"peak of {joint.joint}": f"{self.label(joint.peak)} {joint.unit}",
            "limit": quantity(joint.limit, joint.unit),
            "share of limit": share,
            "time": f"{seconds(joint.time)} s",
        }

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the motion and of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {"MOTION": self.trajectory, "ROBOT": self.load.robot.model.source}

    def origin(self) -> Iterator[Setting]:
        """Robot, friction, and the limits used.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        yield from robot_origin(self.load.robot, self.limits, degrees=self.in_degrees)
        yield "torques", friction_words(self.load.robot.model, counted=self.load.friction)

    def shares(self) -> Shares:
        """Shares of the torque limits over time.

        Returns
        -------
        shares : Shares
        """
        from ..core.answers.card import Shares

        times, min_torques, max_torques = self.envelope
        effort = np.where(np.isfinite(self.limits.effort), self.limits.effort, np.nan)  # nan: no share without a limit
        magnitudes = np.maximum(np.abs(min_torques), np.abs(max_torques))
        limit_shares = magnitudes / effort
        return Shares(times, limit_shares, [joint.joint for joint in self.joints])

    # ── Figures

    @property
    def peaks(self) -> Array:
        """Peak of each joint with its sign, (nv,) [N m, sliding joints: N]."""
        return np.array([joint.peak for joint in self.joints])

    @property
    def largest_payload(self) -> float | None:
        """Largest mass [kg] of the single payload by joint torques alone; None if unknown or without a single payload.

        Grip, bolts and bearings may hold less; they are not counted.
        """
        return None if self.payload_margin is None else self.payload_margin.mass

    @cached_property
    def motion(self) -> Motion:
        """States that were judged: those of the log, with derived rates, smoothed if its noise matters."""
        from .load_states import states_of

        return states_of(self)

    def torques(self) -> Array:
        """Torques of all states, (n, nv) [N m, sliding joints: N].

        Returns
        -------
        tau : (n, nv) array
        """
        torque_chunks: list[Array] = []
        for states in self.differentiation.states(_CHUNK_ROWS):
            joint_torques = self.load.torques(states)
            torque_chunks.append(self.load.drive_torques(joint_torques))
        return np.concatenate(torque_chunks)

    def to_csv(self, path: str | Path, *, split: bool = False) -> Path:
        """Write time and torques as a table.

        Parameters
        ----------
        path : str or Path
        split : bool, also the causes of the torques

        Returns
        -------
        path : Path of the written file

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     tw.check("ur5", "demo").to_csv(f"{folder}/torques.csv", split=True).read_text()[:31]
        'time,shoulder_pan_joint.torque,'
        """
        from .torque_analysis import write_torques

        return write_torques(self, path, split=split)

    def to_mcap(self, path: str | Path) -> Path:
        """Write the motion, its torques, causes, limits and verdict as an MCAP recording of ROS 2.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        MissingExtraError
            mcap-ros2-support is not installed.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.check("ur5", "demo").to_mcap("torques.mcap")  # doctest: +SKIP
        """
        from .recordings.mcap import write_mcap
        from .recordings.recording import Recording

        return write_mcap(path, Recording.from_report(self))

    def to_rerun(self, path: str | Path) -> Path:
        """Write the motion, its torques, causes, limits and verdict as an .rrd file for rerun.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        MissingExtraError
            rerun-sdk is not installed.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.check("ur5", "demo").to_rerun("torques.rrd")  # doctest: +SKIP
        """
        from .recordings.recording import Recording
        from .recordings.rerun_file import write_rerun

        return write_rerun(path, Recording.from_report(self))

    @property
    def scale(self) -> float:
        """Largest torque; about 1e-9 of it is a rounding error."""
        return max((abs(joint.largest) for joint in self.joints), default=0.0)

    def is_zero(self, value: float) -> bool:
        """True if a torque is a rounding error of the others.

        Parameters
        ----------
        value : float [N m or N]

        Returns
        -------
        zero : bool
        """
        return abs(value) <= ZERO * self.scale

    def label(self, value: float) -> str:
        """Text of a torque with four digits; 0 for a rounding error of the others.

        Parameters
        ----------
        value : float [N m or N]

        Returns
        -------
        text : str
        """
        if self.is_zero(value):
            return "0"
        return torque(value)

    def reference(self, joint: JointTorque) -> float:
        """Reference for the noise of the joint's torque: its peak unless negligible.

        Parameters
        ----------
        joint : JointTorque

        Returns
        -------
        torque : float [N m or N]
        """
        largest_torque = self.scale
        if np.isfinite(joint.limit):
            largest_torque = max(joint.limit, largest_torque)
        return max(abs(joint.peak), MIN_REFERENCE_SHARE * largest_torque)

    def at_an_end(self, joint: JointTorque) -> bool:
        """True if the joint's peak is at an end of the log, where derived accelerations are less accurate.

        Parameters
        ----------
        joint : JointTorque

        Returns
        -------
        near : bool
        """
        derivation = self.differentiation
        if derivation.source == "given":
            return False
        step_count = _STEPS_NEAR_END
        if derivation.smooths:
            largest_strength = derivation.strengths.max()
            step_count = math.ceil(largest_strength ** (1 / 6))  # width of the smoothing, in steps
        time_to_end = np.abs(joint.time - derivation.ends).min()
        return bool(time_to_end < step_count * self.quality.step)

    def reach(self, joint: JointTorque) -> float:
        """Standard deviation of the peak, several times larger at an end of the log.

        Parameters
        ----------
        joint : JointTorque

        Returns
        -------
        sigma : float [N m or N]
        """
        if self.at_an_end(joint):
            return joint.uncertainty * _UNCERTAINTY_FACTOR_AT_ENDS
        return joint.uncertainty

    @property
    def worst(self) -> int | None:
        """Joint nearest to its limit, or with the largest peak if no limit is known; None without joints."""
        if not self.joints:
            return None
        return worst_joint(self.joints)


def worst_joint(joints: Sequence[JointTorque]) -> int:
    """Index of the joint with the largest ratio of peak to limit; if the ratios are equal, with the largest peak."""
    return max(range(len(joints)), key=lambda k: (joints[k].share, abs(joints[k].peak)))
