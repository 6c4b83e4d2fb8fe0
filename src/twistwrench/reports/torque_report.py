"""Torque report of a motion: peaks, limits, causes and uncertainties from inverse dynamics, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.doubts import Doubt
from ..core.errors import TrajectoryError
from ..core.estimation.noise import Survey, noise
from ..core.estimation.sampling import GAP
from ..core.numbers import printed, torque
from ..core.tables import csv_table
from ..core.typing import Array
from ..mechanics.joints.units import unit_of
from ..mechanics.model.couplings import drive_turns
from ..mechanics.model.limits import margin
from ..motion.bounds import RunningExtrema
from ..motion.coordinates import Coordinates
from ..motion.differentiation import Differentiation, MotionSamples, Outlier, RunningOutliers, pulse_peak
from ..motion.load_case import STEADY, TERMS, LoadCase, PayloadMargin, PayloadMarginTally
from ..motion.log_table import excerpts
from ..motion.motion_log import LogRows
from ..motion.plausibility import SURROUNDINGS, DoubtfulSpans, InstantKind, doubtful_spans, impossible_torque
from .log_quality import MeasuredTally, MeasuredTorque
from .motors import MotorTally, MotorUse, Steps
from .statistics import INTERVAL, Gaps, MinMaxDecimation, PeakEstimate, PeakSearch, Rms

if TYPE_CHECKING:
    from ..core.verdict import Verdict
    from ..mechanics.model.limits import Limits
    from ..statics.clearance import PathClearance

ZERO = 1e-9
SMALL = 0.02
"""Fraction of the robot's largest torque, or of the joint's limit, below which a peak is not a reference for noise."""
NEGLIGIBLE = 0.001
"""Fraction of a peak above which noise is estimated and shown in a column."""
_AT_AN_END = 5.0
"""Factor of the uncertainty of derived accelerations at the ends of a log."""


@dataclass(frozen=True)
class JointTorque:
    """Torque over a motion of one joint, or of a motor that drives several joints."""

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
        return self.largest if self.estimate is None else self.estimate.value

    @property
    def chance(self) -> float:
        """Correction for the selection of the largest of many noisy torques; the peak is the sum of the causes and this."""
        return self.peak - self.largest

    @property
    def uncertainty(self) -> float:
        """Standard deviation of :attr:`peak`."""
        return self.noise if self.estimate is None else self.estimate.sigma

    @property
    def share(self) -> float:
        """|peak| over limit; 0 without a limit."""
        return abs(self.peak) / self.limit

    @property
    def main_cause(self) -> tuple[str, float]:
        """Largest term in the direction of the peak, and its share of the sum of terms in this direction."""
        along = {name: value * np.sign(self.largest) for name, value in self.terms.items()}
        name = max(along, key=lambda n: float(along[n]))
        total = sum(v for v in along.values() if v > 0)
        return name, float(along[name] / total) if total else 0.0


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
    """Share of the limit; of half the range from its middle for a position."""
    time: float


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


@dataclass(frozen=True, eq=False)
class TorqueReport:
    """Results of the torque analysis: source of tables, pictures and the exit code.

    If noise of the log matters, all results except ``derived`` are those of the smoothed motion.
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
    load: LoadCase
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
    """States around the worst joint's peak, at most a few thousand; all states of a short motion."""
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
    derived: AsDerived | None = None
    """Results of the unsmoothed log; None if they are the final results or were not requested."""
    near: tuple[NearLimit, ...] = ()
    """Velocity and position nearest to their limits, nearest first."""
    spans: DoubtfulSpans = field(default_factory=DoubtfulSpans)
    """Spans of time with rows that are missing, repeated or wrong, so that derived figures in them are unknown."""
    sound: SoundFigures | None = None
    """Figures of the rows outside these spans; None without spans."""

    @property
    def noisy(self) -> bool:
        """True if noise of the log matters; peaks are then estimates."""
        return any(j.estimate is not None for j in self.joints)

    @property
    def in_degrees(self) -> bool:
        """True if the log has angles in degrees."""
        return self.differentiation.trajectory.columns.in_degrees

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict with reasons: OK, UNSURE, OVER LIMIT, COLLISION or LOOK AGAIN."""
        from .torque_verdict import verdict_of

        return verdict_of(self)

    def to_mcap(self, path: str | Path) -> Path:
        """Write the motion, its torques, causes, limits and verdict as an MCAP recording; raises MissingExtraError."""
        from .recording import Recording, write_mcap

        return write_mcap(path, Recording.from_report(self))

    def to_rerun(self, path: str | Path) -> Path:
        """Write the motion, its torques, causes, limits and verdict as an .rrd file for rerun; raises MissingExtraError."""
        from .recording import Recording, write_rerun

        return write_rerun(path, Recording.from_report(self))

    @property
    def scale(self) -> float:
        """Largest torque; about 1e-9 of it is a rounding error."""
        return max((abs(j.largest) for j in self.joints), default=0.0)

    def is_zero(self, value: float) -> bool:
        """True if a torque is a rounding error of the others."""
        return abs(value) <= ZERO * self.scale

    def label(self, value: float) -> str:
        """Text of a torque with four digits; 0 for a rounding error of the others."""
        return "0" if self.is_zero(value) else torque(value)

    def reference(self, joint: JointTorque) -> float:
        """Reference for the noise of the joint's torque: its peak unless negligible."""
        known = joint.limit if np.isfinite(joint.limit) else 0.0
        return max(abs(joint.peak), SMALL * max(known, self.scale))

    def at_an_end(self, joint: JointTorque) -> bool:
        """True if the joint's peak is at an end of the log, where derived accelerations are less accurate."""
        d = self.differentiation
        if d.source == "given":
            return False
        steps = 3 if not d.smooths else math.ceil(d.strengths.max() ** (1 / 6))
        return bool(np.abs(joint.time - d.ends).min() < steps * self.quality.step)

    def reach(self, joint: JointTorque) -> float:
        """Standard deviation of the peak, several times larger at an end of the log."""
        return joint.uncertainty * (_AT_AN_END if self.at_an_end(joint) else 1.0)

    @property
    def worst(self) -> int | None:
        """Joint nearest to its limit, or with the largest peak if no limit is known; None without joints."""
        if not self.joints:
            return None
        return worst_joint([abs(j.peak) for j in self.joints], [j.limit for j in self.joints])


def worst_joint(peaks: Sequence[float] | Array, limits: Sequence[float] | Array) -> int:
    """Index of the joint with the largest ratio of peak to limit; without limits, with the largest peak."""
    return max(range(len(peaks)), key=lambda k: (peaks[k] / limits[k], peaks[k]))


# ── One pass over the samples and their torques

_AROUND, _KEPT = 2048, 1 << 23
"""Rows kept on either side of each joint's peak, and maximum count of numbers in them: 64 MiB."""
_MASS_SAMPLES = 32
"""States of each chunk used for the noise of torques and for the largest payload torque."""
_BAND_SAMPLES = 512
"""States of each chunk with a mass matrix, which is used up to the next one."""


class Extremes:
    """Largest torques, and largest excesses over the other limits, of the states that are added."""

    def __init__(self, load: LoadCase, limits: Limits) -> None:
        self._model, self._limits = load.with_load.model, limits
        self._coordinates = Coordinates.from_model(load.robot.model)
        self._followers = [self._model.bodies[i] for i in self._model.limited_followers]
        nv = load.robot.nv
        self.peak = RunningExtrema(nv)
        self.passed = {kind: RunningExtrema(nv) for kind in ("lower", "upper", "velocity")}
        """Excess over each kind of limit."""
        self.borne = RunningExtrema(len(self._followers))
        """Largest torques of mimic joints with an effort limit."""

    def add_motion(self, s: MotionSamples) -> None:
        """Add positions and velocities."""
        if not len(s):
            return
        at, limits = self._coordinates.position_of, self._limits
        q = np.where(at >= 0, s.measured[:, np.maximum(at, 0)], 0.0)
        for kind, values, beyond in (
            ("lower", q, np.where(at >= 0, limits.lower, -np.inf) - q),
            ("upper", q, q - np.where(at >= 0, limits.upper, np.inf)),
            ("velocity", s.dq, np.abs(s.dq) - limits.velocity),
        ):
            self.passed[kind].add(s.time, beyond, values)

    def add_torques(self, time: Array, torques: Array, borne: Array) -> list[tuple[int, int]]:
        """Add torques (n, nv) and those of limited mimic joints (n, k); returns (joint, row) of new maxima."""
        if not len(time):
            return []
        if self._followers:
            self.borne.add(time, np.abs(borne), borne)
        return self.peak.add(time, np.abs(torques), torques)

    def nearest(self) -> tuple[NearLimit, ...]:
        """Velocity and position nearest to a limit; those without one are left out."""
        names, limits = self._coordinates.velocity_names, self._limits
        if not len(names) or not np.isfinite(self.passed["velocity"].time).any():
            return ()
        velocity, found = self.passed["velocity"], list[NearLimit]()
        known = np.isfinite(limits.velocity)
        shares = np.where(known, np.abs(velocity.signed) / np.where(known, limits.velocity, 1.0), 0.0)
        k = int(shares.argmax())
        found.append(NearLimit(names[k], "velocity", float(shares[k]), float(velocity.time[k])))
        range_ = np.where(np.isfinite(limits.lower) & np.isfinite(limits.upper), limits.upper - limits.lower, 0.0)
        for kind in ("lower", "upper"):
            passed, known = self.passed[kind], range_ > 0.0
            left = np.where(known, -passed.value, 0.0)
            shares = np.where(known, 1.0 - 2.0 * left / np.where(known, range_, 1.0), 0.0)
            k = int(shares.argmax())
            found.append(NearLimit(names[k], "position", float(shares[k]), float(passed.time[k])))
        return tuple(sorted(found, key=lambda near: -near.share))

    def excesses(self) -> tuple[Excess, ...]:
        """Exceeded limits, worst effort first."""
        c, limits, model = self._coordinates, self._limits, self._model
        found, turns = [], drive_turns(model)
        for kind, extreme in (("effort", self.peak), *self.passed.items()):
            bound = getattr(limits, kind)
            over = extreme.value - bound if kind == "effort" else extreme.value
            allowed = limits.tolerance if kind in ("lower", "upper") else margin(bound)
            for k in np.flatnonzero(over > allowed):
                drive = kind == "effort"
                angular = turns[k] if drive else bool(c.angular_velocity[k])
                unit = unit_of({"effort": "tau", "velocity": "dq"}.get(kind, "q"), angular)
                value, limit, time = float(extreme.signed[k]), float(bound[k]), float(extreme.time[k])
                name = (model.drive_labels if drive else c.velocity_names)[k]
                found.append(Excess(name, kind, value, limit, time, unit, angular))
        for i, body in enumerate(self._followers):
            value, time, angular = float(self.borne.signed[i]), float(self.borne.time[i]), bool(body.joint.turning[0])
            if abs(value) > body.effort + margin(body.effort):
                unit = unit_of("tau", angular)
                found.append(Excess(body.joint.name, "effort", value, body.effort, time, unit, angular))
        return tuple(
            sorted(found, key=lambda e: (e.kind != "effort", e.kind, -abs(e.value / e.limit) if e.limit else 0.0))
        )


class MotionTally:
    """Running figures, accumulated over chunks of states."""

    def __init__(self, load: LoadCase, limits: Limits, plan: Differentiation, *, estimating: bool = False) -> None:
        nv = load.robot.nv
        self.load, self.limits, self.plan = load, limits, plan
        self.coordinates = Coordinates.from_model(load.robot.model)
        self.rows = 0
        self.begin = self.end = np.nan
        self.rms = Rms(nv)
        self.whole = Extremes(load, limits)
        self.terms = {name: np.zeros(nv) for name in TERMS}
        self.envelope, self.band = MinMaxDecimation(nv), MinMaxDecimation(nv)
        """Decimated torques, and their 95 % intervals if known."""
        self.around: dict[int, MotionSamples] = {}
        """States on either side of each joint's peak."""
        self._reach = min(_AROUND, max(1, _KEPT // (2 * nv * (1 + 2 * load.robot.nq + 3 * nv))))
        simple = all(body.joint.nv == 1 and body.joint.nq == 1 for body in load.robot.model.leaders)
        self.gaps = Gaps(GAP * plan.quality.step, simple, (limits.lower, limits.upper) if simple else None)
        self.noise = np.zeros(nv)
        self.carried = 0.0
        """Largest torque due to the payloads, in some of the states."""
        self.payload_margin = PayloadMarginTally(load, limits.effort)
        self.followers = bool(load.with_load.model.limited_followers)
        self.largest = np.zeros(load.robot.nq)
        self.outliers = RunningOutliers()
        self.search = PeakSearch(plan, load) if estimating else None
        """Data for noise-corrected peaks."""
        self._measured = [MeasuredTally(limits.effort, _measured_noise(plan)) for _ in range(1 + load.carries)]
        """Comparisons with computed torques with and without payloads and wrenches, since the log may have been recorded either
        way."""
        self.motors = MotorTally(load.with_load.model)
        self.stationary = np.zeros(nv, int)
        """Number of rows with unknown direction of motion."""
        self.alone = RunningExtrema(nv)
        """Torques without payloads and wrenches, as recorded."""
        self.spans, self.sound = _spans_of(plan), Extremes(load, limits)
        """Doubtful spans of time, and the largest figures outside of them."""

    def add(self, states: MotionSamples, torques: Array, motion: LogRows, inner: slice) -> None:
        """Add an overlapping run: its states, the torques (n, nv) of its new rows, and the rows of the log."""
        s = states[inner]
        noisy = bool(self.plan.sigma_ddq.any())
        sigma = self._sigma(s) if noisy and (self.search or motion.tau is not None) else np.zeros_like(torques)
        if self.search is not None:
            self.search.add(s, torques, motion, inner)
            self.band.add(s.time, torques - INTERVAL * sigma, torques + INTERVAL * sigma)
        alone = self.load.at_drives(self.load.unloaded_torques(s)) if self.load.carries else torques
        self.alone.add(s.time, np.abs(alone), alone)
        if motion.tau is not None:
            computed = [torques, alone] if self.load.carries else [torques]
            doubted = self.spans.within(s.time)
            for tally, tau in zip(self._measured, computed, strict=True):
                tally.add(s.time, tau, self.load.at_drives(motion.tau[inner]), sigma, doubted)
        self.begin = float(s.time[0]) if self.rows == 0 else self.begin
        self.end = float(s.time[-1])
        self.rows += len(s)
        self.rms.add(s.time, torques)
        self.envelope.add(s.time, torques)
        self.gaps.add(s.time, s.q, s.dq, s.ddq)
        borne = self.load.follower_torques(s) if self.followers else np.zeros((len(s), 0))
        self._look_at_peaks(s, torques, borne)
        self.whole.add_motion(s)
        if self.spans:
            fine = ~self.spans.within(s.time)
            self.sound.add_motion(s[fine])
            steady = fine if self.plan.source != "given" else np.ones(len(s), bool)
            self.sound.add_torques(s.time[steady], torques[steady], borne[steady])
        self.largest = np.maximum(self.largest, np.abs(s.measured).max(axis=0))
        self.stationary += s.stationary.sum(axis=0)
        if s.outlier.any():
            self.outliers.add(s.time, s.outlier, self._may_pass(s, torques))
        if self.load.with_load.actuators:
            self.motors.add(s.time, self.load.motor_loads(s))
        some = s[:: max(1, len(s) // _MASS_SAMPLES)]
        if self.plan.sigma_ddq.any():
            M = self.load.mass_matrix(some.q)
            spread = np.sqrt((M * M) @ (self.plan.sigma_ddq**2))
            self.noise = np.maximum(self.noise, spread.max(axis=0))
        if self.payload_margin.determined:
            added = self.load.at_drives(self.load.payload_torques(s))
            if self.followers:
                torques, added = np.hstack([torques, borne]), np.hstack([added, self.load.follower_payload_torques(s)])
            self.payload_margin.add(s.time, torques, added)
        if self.load.payloads:
            self.carried = max(self.carried, float(np.abs(self.load.payload_torques(some)).max(initial=0.0)))

    def _sigma(self, s: MotionSamples) -> Array:
        """Standard deviation (n, nv) of the torques, from the mass matrices of some of the states."""
        stride = max(1, len(s) // _BAND_SAMPLES)
        M = self.load.mass_matrix(s.q[::stride])
        squares = self.plan.sigma_at(s) ** 2
        blocks = [(M[k] * M[k]) @ squares[k * stride : (k + 1) * stride].T for k in range(len(M))]
        return np.sqrt(np.concatenate(blocks, axis=1).T)

    def _may_pass(self, s: MotionSamples, torques: Array) -> Array:
        """(n, k) of bool: the flattened sample, if real, implies a torque beyond a limit or of a joint without a limit."""
        plan, found = self.plan, np.zeros(s.outlier.shape[:2], bool)
        order = 1 if plan.source == "velocities" else 2
        gain = pulse_peak(order, plan.quality.step)
        joint_of = {int(p): v for v, p in enumerate(self.coordinates.position_of) if p >= 0}
        rows, columns = np.nonzero(s.outlier[:, :, 0])
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            joint = column if order == 1 else joint_of.get(column)
            if joint is None:  # entry of a quaternion
                found[row, column] = True
                continue
            M = self.load.mass_matrix(s.q[row])
            change = np.abs(M[:, joint]) * gain * abs(float(s.outlier[row, column, 1]))
            within = np.abs(torques[row]) + change <= np.where(np.isfinite(self.limits.effort), self.limits.effort, 0.0)
            found[row, column] = not (within | (change <= ZERO * np.abs(torques[row]).max())).all()
        return found

    def _look_at_peaks(self, s: MotionSamples, torques: Array, borne: Array) -> None:
        fresh = self.whole.add_torques(s.time, torques, borne)
        if not fresh:
            return
        joints, rows = (np.array(x) for x in zip(*fresh, strict=True))
        for name, values in self.load.terms(s[rows]).items():
            self.terms[name][joints] = self.load.at_drives(values)[np.arange(len(joints)), joints]
        for joint, row in fresh:
            self.around[joint] = deepcopy(
                s[max(0, row - self._reach) : row + self._reach]
            )  # a copy, so that no larger arrays stay in memory

    def estimate(self, joint: int) -> PeakEstimate:
        """Noise-corrected peak of the joint, if the tally is ``estimating``."""
        assert self.search is not None
        steady = sum(self.terms[name][joint] for name in STEADY)
        return self.search.estimate(joint, float(steady))

    def measured(self) -> tuple[MeasuredTorque, ...]:
        """Measured torques compared with those of the robot, with or without load, whichever agrees better."""
        best = min(self._measured, key=lambda tally: tally.misfit)
        return best.result(self.load.with_load.model.drive_labels, self.load.units)


# ── The analysis

# If noise of a log matters, a second pass over the smoothed log gives all results: peaks, causes, limits, motors, files and
# pictures. The results of the unsmoothed log are reported beside them.

_NUMBERS_PER_CHUNK = 1 << 19
"""Rows times velocities of a chunk: 4 MiB per array."""
_OF_A_PASS, _OF_THE_PLAN, _OF_THE_DRAWS = 1.0, 8.0, 1.0
"""Durations of the steps for a log of up to :data:`_PLANNED` bytes, relative to one pass."""
_PLANNED = 1 << 21
"""Bytes of the excerpts used to plan the analysis of a longer log."""


def analyse(
    load: LoadCase,
    differentiation: Differentiation,
    limits: Limits,
    *,
    csv: str | Path | None = None,
    split: bool = False,
    progress: Callable[[float], None] | None = None,
    chunk: int | None = None,
) -> TorqueReport:
    """Compute the torques of a motion and judge it.

    ``csv`` is a file for the torques, with the causes as separate columns if ``split``. ``progress`` receives the finished
    share, 0 to 1. ``chunk`` is the number of rows processed at a time; it affects results only by rounding errors.
    """
    fixed = min(1.0, _PLANNED / max(1, differentiation.trajectory.size))
    steps = Steps(progress, (_OF_A_PASS, _OF_THE_PLAN * fixed, _OF_A_PASS, _OF_THE_DRAWS * fixed))
    run = _Run(load, limits, chunk or max(1024, _NUMBERS_PER_CHUNK // max(1, load.robot.nv)), csv, split, steps)
    if differentiation.smooths:
        steps.skip(2)
        report = run.answer(differentiation)
    elif not differentiation.sigma_ddq.any():
        report = _report(run.once(differentiation, write=True))
    else:
        derived = run.once(differentiation)
        report = _report(derived)
        if any(j.noise > NEGLIGIBLE * report.reference(j) for j in report.joints):
            report = run.answer(differentiation.smoothed(steps.next()), derived)
        elif csv is not None:
            steps.skip(1)
            run.once(differentiation, write=True)
    steps.done()
    return report


@dataclass(frozen=True, eq=False)
class _Run:
    """Passes over one motion; one of them writes the file."""

    load: LoadCase
    limits: Limits
    chunk: int
    csv: str | Path | None
    split: bool
    steps: Steps

    def once(
        self,
        plan: Differentiation,
        *,
        write: bool = False,
        beside: Differentiation | None = None,
        estimating: bool = False,
    ) -> MotionTally:
        """Run one pass; if ``write``, write the file, including the torques of the plan ``beside``."""
        progress = self.steps.next(len(plan.trajectory.table))
        tally = MotionTally(self.load, self.limits, plan, estimating=estimating)
        header = _csv_header(self.load.with_load.model.drive_names, self.split, derived=beside is not None)
        with nullcontext() if self.csv is None or not write else csv_table(self.csv, header) as table:
            for states, motion, inner in plan.surrounded_states(self.chunk, progress):
                s = states[inner]
                torques = self.load.at_drives(self.load.torques(s))
                _check_finite(torques, s)
                tally.add(states, torques, motion, inner)
                if table is not None:
                    parts = list(self.load.terms(s).values()) if self.split else []
                    parts += [] if beside is None else [self.load.torques(beside.complete(motion)[inner])]
                    parts = [torques, *map(self.load.at_drives, parts)]
                    table.numbers(np.concatenate([s.time[:, None], *parts], axis=1))
        return tally

    def answer(self, plan: Differentiation, derived: MotionTally | None = None) -> TorqueReport:
        """Report of the smoothed motion, with the results ``derived`` from the unsmoothed log."""
        beside = None if derived is None else derived.plan
        tally, progress = self.once(plan, write=True, beside=beside, estimating=True), self.steps.next()
        estimates = []
        for k in range(self.load.robot.nv):
            estimates.append(tally.estimate(k))
            if progress is not None:
                progress((k + 1) / self.load.robot.nv)
        return _report(tally, derived, estimates)


def _report(
    run: MotionTally, derived: MotionTally | None = None, estimates: Sequence[PeakEstimate] | None = None
) -> TorqueReport:
    plan, load, outliers = run.plan, run.load, run.outliers.result()
    joints = _joints(run, derived)
    if estimates is not None:
        joints = tuple(replace(j, estimate=e) for j, e in zip(joints, estimates, strict=True))
    worst = worst_joint([abs(j.peak) for j in joints], [j.limit for j in joints])
    return TorqueReport(
        robot=load.robot.name,
        trajectory=str(plan.trajectory.path),
        rows=run.rows,
        begin=run.begin,
        end=run.end,
        joints=joints,
        excesses=run.whole.excesses(),
        gaps=run.gaps,
        quality=plan.quality,
        differentiation=plan,
        load=load,
        envelope=run.envelope.result(),
        band=None if estimates is None else run.band.result(),
        largest=run.largest,
        limits=run.limits,
        outliers=outliers,
        stationary=tuple((run.stationary / max(1, run.rows)).tolist()),
        motors=run.motors.result(),
        around=run.around[worst],
        doubts=_doubts(run, glitches=not outliers),
        near=run.whole.nearest(),
        spans=run.spans,
        sound=SoundFigures(run.sound.peak.value, run.sound.excesses()) if run.spans else None,
        measured=run.measured(),
        idle_payload=any(p.mass for p in load.payloads)
        and run.carried <= ZERO * float(run.whole.peak.value.max(initial=0.0)),
        payload_margin=run.payload_margin.result(),
        derived=None
        if derived is None
        else AsDerived(derived.plan, derived.whole.excesses(), derived.envelope.result(), derived.motors.result()),
    )


def _spans_of(plan: Differentiation) -> DoubtfulSpans:
    """Doubtful spans of a log; smoothing spreads what happens in them."""
    rows = SURROUNDINGS + math.ceil(_SPREAD * float(plan.strengths.max(initial=0.0)) ** (1 / 6))
    log = plan.trajectory
    return doubtful_spans(log.instants, plan.quality.step, log.origin, rows)


def _measured_noise(plan: Differentiation) -> Array:
    """Standard deviation (nv,) of the noise of the measured torques; 0 without a column."""
    log, nv = plan.trajectory, plan.model.nv
    if log.columns.places["tau"] is None:
        return np.zeros(nv)
    runs = [log.motion(table) for table in excerpts(log.table, *_NOISE_RUNS)]
    torques = [rows.tau for rows in runs if rows.tau is not None]
    return noise([rows.time for rows in runs], torques) if torques else np.zeros(nv)


_NOISE_RUNS = 8, 2048
_SPREAD = 16.0
"""Rows, in units of strength^(1/6), to which smoothing spreads a wrong row by more than 1e-3 of it."""


def _doubts(run: MotionTally, *, glitches: bool) -> tuple[Doubt, ...]:
    """Doubts about the log without dynamics, by the robot's own limits; before them that torques are impossible."""
    log, robot = run.plan.trajectory, run.load.robot
    found = log.doubts(run.limits, own=robot.limits, glitches=glitches)
    if any(doubt.refuses for doubt in found):
        return found
    corners = replace(run.spans, instants=tuple(i for i in log.instants if i.cause is not InstantKind.ROWS))
    strong = impossible_torque(robot, run.alone, log.origin, corners)
    return found if strong is None else (strong, *found)


def _joints(run: MotionTally, derived: MotionTally | None) -> tuple[JointTorque, ...]:
    """Figures of each joint."""
    rms, units = run.rms.result(), run.load.units
    noisy = run if derived is None else derived
    return tuple(
        JointTorque(
            joint=name,
            unit=units[k],
            largest=float(run.whole.peak.signed[k]),
            time=float(run.whole.peak.time[k]),
            rms=float(rms[k]),
            limit=float(run.limits.effort[k]),
            terms={term: float(values[k]) for term, values in run.terms.items()},
            noise=float(noisy.noise[k]),
            raw=None if derived is None else float(derived.whole.peak.signed[k]),
            raw_time=None if derived is None else float(derived.whole.peak.time[k]),
        )
        for k, name in enumerate(run.load.with_load.model.drive_labels)
    )


def _check_finite(torques: Array, s: MotionSamples) -> None:
    bad = ~np.isfinite(torques).all(axis=1)
    if bad.any():
        time = float(s.time[np.argmax(bad)])
        raise TrajectoryError(
            f"the torques at t = {printed(time)} s are not finite numbers. Positions may be absurdly large there, or a "
            "quaternion zero: look at that row."
        )


def _csv_header(names: tuple[str, ...], split: bool, *, derived: bool) -> list[str]:
    quantities = ["torque", *(TERMS if split else ()), *(["torque.derived"] if derived else [])]
    return ["time", *(f"{name}.{quantity}" for quantity in quantities for name in names)]
