"""Analysis of the torques of a motion by inverse dynamics: passes over its samples, slice by slice of a log."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.doubts import Doubt
from ..core.errors import TrajectoryError
from ..core.estimation.noise import noise
from ..core.estimation.sampling import GAP
from ..core.numbers import margin, printed
from ..core.tables import csv_table
from ..core.typing import Array
from ..mechanics.joints.units import unit_of
from ..mechanics.model.couplings import drive_turns
from ..mechanics.model.limits import BEARING_UNITS, BEARINGS, bears
from ..motion.bounds import Extrema
from ..motion.coordinates import Coordinates
from ..motion.differentiation import Differentiation, MotionSamples, outliers_of, pulse_peak
from ..motion.load_case import (
    STEADY,
    LoadCase,
    PayloadShares,
    margin_determined,
    payload_margin,
    payload_shares,
)
from ..motion.log_table import excerpts
from ..motion.plausibility import (
    SURROUNDINGS,
    DoubtfulSpans,
    InstantKind,
    TimeAbove,
    above_limits,
    doubtful_spans,
    impossible_torque,
)
from .log_quality import MeasuredTorque, TorqueComparison
from .motors import MotorFigures, Steps
from .statistics import INTERVAL, Bins, Gaps, PeakBootstrap, PeakEstimate, Runs, gap_edges, mean_weights
from .support.view import further_columns
from .torque_report import (
    NEGLIGIBLE,
    ZERO,
    AsDerived,
    BearingUse,
    Excess,
    Joints,
    JointTorque,
    NearLimit,
    SoundFigures,
    TorqueReport,
    worst_joint,
)

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..mechanics.model.model import Model

# ── One pass over the samples and their torques, in slices

_AROUND, _KEPT = 2048, 1 << 23
"""Rows on either side of the worst joint's peak, and maximum count of numbers in them: 64 MiB."""
_MASS_SAMPLES = 32
"""States of each chunk used for the noise of torques and for the largest payload torque."""
_BAND_SAMPLES = 512
"""States of each chunk with a mass matrix, which is used up to the next one."""


@dataclass(frozen=True, eq=False)
class Extremes:
    """Largest torques, and largest excesses over the other limits, of some states."""

    load: LoadCase
    limits: Limits
    passed: dict[str, Extrema]
    """Excess over each kind of limit: lower, upper, velocity, and those of bearings if some have limits."""
    peak: Extrema
    borne: Extrema
    """Largest torques of mimic joints with an effort limit."""

    @classmethod
    def from_states(
        cls, load: LoadCase, limits: Limits, s: MotionSamples, torques: tuple[Array, Array, Array]
    ) -> Extremes:
        """Extremes of states, and of torques: their times (n,), those of the drives (n, nv) and of limited mimic joints."""
        at = Coordinates.from_model(load.robot.model).position_of
        q = np.where(at >= 0, s.measured[:, np.maximum(at, 0)], 0.0)
        beyond = {
            "lower": (np.where(at >= 0, limits.lower, -np.inf) - q, q),
            "upper": (q - np.where(at >= 0, limits.upper, np.inf), q),
            "velocity": (np.abs(s.dq) - limits.velocity, s.dq),
        }
        if bears(limits):
            beyond |= {kind: (x - getattr(limits, kind), x) for kind, x in load.bearing_loads(s).items()}
        passed = {kind: Extrema.from_rows(s.time, *values) for kind, values in beyond.items()}
        time, *each = torques
        return cls(load, limits, passed, *(Extrema.from_rows(time, np.abs(tau), tau) for tau in each))

    @classmethod
    def joined(cls, parts: Sequence[Extremes]) -> Extremes:
        """Extremes of consecutive rows from those of their parts."""
        passed = {kind: Extrema.joined([part.passed[kind] for part in parts]) for kind in parts[0].passed}
        peak, borne = (Extrema.joined([getattr(part, name) for part in parts]) for name in ("peak", "borne"))
        return cls(parts[0].load, parts[0].limits, passed, peak, borne)

    @property
    def _model(self) -> Model:
        return self.load.with_load.model

    @property
    def _coordinates(self) -> Coordinates:
        return Coordinates.from_model(self.load.robot.model)

    def nearest(self) -> tuple[NearLimit, ...]:
        """Velocity and position nearest to a limit; those without one are left out."""
        names, limits = self._coordinates.velocity_names, self.limits
        if not len(names) or not np.isfinite(self.passed["velocity"].time).any():
            return ()
        velocity, found = self.passed["velocity"], list[NearLimit]()
        known = np.isfinite(limits.velocity)
        shares = np.where(known, np.abs(velocity.signed) / np.where(known, limits.velocity, 1.0), 0.0)
        k = int(shares.argmax())
        if known.any():
            found.append(NearLimit(names[k], "velocity", float(shares[k]), float(velocity.time[k])))
        range_ = np.where(np.isfinite(limits.lower) & np.isfinite(limits.upper), limits.upper - limits.lower, 0.0)
        for kind in ("lower", "upper"):
            passed, known = self.passed[kind], range_ > 0.0
            left = np.where(known, -passed.value, 0.0)
            shares = np.where(known, 1.0 - 2.0 * left / np.where(known, range_, 1.0), 0.0)
            k = int(shares.argmax())
            if known.any():
                found.append(NearLimit(names[k], "position", float(shares[k]), float(passed.time[k])))
        return tuple(sorted(found, key=lambda near: -near.share))

    def bearings(self) -> tuple[BearingUse, ...]:
        """Largest loads of the bearings that have limits, by joint."""
        names, limits = self._coordinates.velocity_names, self.limits
        return tuple(
            BearingUse(names[k], kind, float(loads.signed[k]), float(getattr(limits, kind)[k]), float(loads.time[k]))
            for k in range(len(names))
            for kind, loads in self.passed.items()
            if kind in BEARINGS and np.isfinite(getattr(limits, kind)[k])
        )

    def excesses(self) -> tuple[Excess, ...]:
        """Exceeded limits, worst effort first."""
        c, limits, model = self._coordinates, self.limits, self._model
        found, turns = [], drive_turns(model)
        for kind, extreme in (("effort", self.peak), *self.passed.items()):
            bound = getattr(limits, kind)
            over = extreme.value - bound if kind == "effort" else extreme.value
            allowed = limits.tolerance if kind in ("lower", "upper") else margin(bound)
            for k in np.flatnonzero(over > allowed):
                drive = kind == "effort"
                angular = turns[k] if drive else bool(c.angular_velocity[k])
                unit = unit_of({"effort": "tau", "velocity": "dq"}.get(kind, "q"), angular)
                unit = BEARING_UNITS.get(kind, unit)
                value, limit, time = float(extreme.signed[k]), float(bound[k]), float(extreme.time[k])
                name = (model.drive_labels if drive else c.velocity_names)[k]
                found.append(Excess(name, kind, value, limit, time, unit, angular))
        for i, body in enumerate(model.bodies[i] for i in model.limited_followers):
            value, time, angular = float(self.borne.signed[i]), float(self.borne.time[i]), bool(body.joint.turning[0])
            if abs(value) > body.effort + margin(body.effort):
                unit = unit_of("tau", angular)
                found.append(Excess(body.joint.name, "effort", value, body.effort, time, unit, angular))
        return tuple(
            sorted(found, key=lambda e: (e.kind != "effort", e.kind, -abs(e.value / e.limit) if e.limit else 0.0))
        )


@dataclass(frozen=True, eq=False)
class MotionFigures:
    """Figures of consecutive rows of a motion; those of the whole motion are joined from those of its slices."""

    rows: int
    squares: Array
    """Part (nv,) of the time mean of squared torques due to these rows."""
    whole: Extremes
    sound: Extremes
    """Extremes outside doubtful spans of time."""
    alone: Extrema
    """Largest torques without payloads and wrenches, as recorded."""
    speed: Extrema
    at_peaks: MotionSamples
    """States (nv,) at the peak of each torque."""
    envelope: Bins
    band: Bins | None
    """95 % intervals of the torques; None unless peaks are estimated."""
    runs: Runs | None
    """Runs of rows with correlated noise, in magnitudes of torques; None unless peaks are estimated."""
    edges: tuple[Array, Array]
    """Coordinates and velocities in the rows at either end of long gaps."""
    fastest: Array
    """(2, nv) largest speeds and accelerations."""
    largest: Array
    """Largest magnitude of each coordinate (nq,)."""
    noise: Array
    """Largest standard deviation (nv,) of torques due to noise, in some of the states."""
    stationary: Array
    """Number of rows (nv,) with unknown direction of motion."""
    outliers: Array
    """Outliers (m, 5) as in :func:`outliers_of`."""
    motors: MotorFigures | None
    margin: PayloadShares | None
    carried: float
    """Largest torque due to the payloads, in some of the states."""
    compared: tuple[TorqueComparison, ...]
    """Comparisons of measured torques with computed ones with payloads and wrenches, and without them, since the log may have
    been recorded either way."""
    above: Array
    """(rows, nv) True if a measured torque is above its limit."""

    @classmethod
    def joined(cls, parts: Sequence[MotionFigures]) -> MotionFigures:
        """Figures of consecutive rows from those of their parts."""

        def each(name: str) -> list[Any]:
            return [getattr(part, name) for part in parts]

        best = np.argmax([part.whole.peak.value for part in parts], axis=0)
        names = [f.name for f in fields(MotionSamples)]
        states = MotionSamples(*(np.concatenate([getattr(s, name) for s in each("at_peaks")]) for name in names))
        estimated, margin = parts[0].runs is not None, parts[0].margin is not None
        q, dq = (np.concatenate(x) for x in zip(*each("edges"), strict=True))
        return cls(
            rows=sum(each("rows")),
            squares=np.sum(each("squares"), axis=0),
            whole=Extremes.joined(each("whole")),
            sound=Extremes.joined(each("sound")),
            alone=Extrema.joined(each("alone")),
            speed=Extrema.joined(each("speed")),
            at_peaks=states[best * len(best) + np.arange(len(best))],
            envelope=Bins.joined(each("envelope")),
            band=Bins.joined(each("band")) if estimated else None,
            runs=Runs.joined(each("runs")) if estimated else None,
            edges=(q, dq),
            fastest=np.max(each("fastest"), axis=0),
            largest=np.max(each("largest"), axis=0),
            noise=np.max(each("noise"), axis=0),
            stationary=np.sum(each("stationary"), axis=0),
            outliers=np.concatenate(each("outliers")),
            motors=MotorFigures.joined(each("motors")) if parts[0].motors is not None else None,
            margin=PayloadShares.joined(each("margin")) if margin else None,
            carried=max(each("carried")),
            compared=tuple(TorqueComparison.joined(x) for x in zip(*each("compared"), strict=True)),
            above=np.concatenate(each("above")),
        )


def _accelerated(model: Model, column: int) -> tuple[slice, float]:
    """Velocities that a coordinate moves, and the largest acceleration of one of them for a unit of the coordinate's."""
    body = next(b for b in model.leaders if b.q_index <= column < b.q_index + b.joint.nq)
    _, velocities = body.places
    if body.joint.quaternion is None:
        return velocities, 1.0
    turns = body.q_index + body.joint.quaternion <= column < body.q_index + body.joint.quaternion + 4
    middle = velocities.start + 3  # angular velocities come first; a unit of a quaternion is a turn by 2
    return (slice(velocities.start, middle), 2.0) if turns else (slice(middle, velocities.stop), 1.0)


@dataclass(frozen=True, eq=False)
class MotionPass:
    """Pass over the rows of a log: the figures of each slice of rows, and of all of them."""

    load: LoadCase
    limits: Limits
    plan: Differentiation
    estimating: bool = False
    """True if peaks are to be estimated without noise."""

    @property
    def time(self) -> Array:
        """Times (n,) of all rows [s]."""
        return np.asarray(self.plan.trajectory.table[:, 0])

    @cached_property
    def spans(self) -> DoubtfulSpans:
        """Doubtful spans of time."""
        return _spans_of(self.plan)

    @cached_property
    def _edges(self) -> Array:
        return gap_edges(self.time, self._gap)

    @property
    def _gap(self) -> float:
        return GAP * self.plan.quality.step

    @cached_property
    def _measured_noise(self) -> Array:
        return _measured_noise(self.plan)

    @cached_property
    def bootstrap(self) -> PeakBootstrap:
        """Draws for estimated peaks."""
        return PeakBootstrap(self.plan, self.load)

    def figures(self, first: int, s: MotionSamples, torques: Array, measured: Array | None) -> MotionFigures:
        """Figures of the rows from ``first`` on: states, torques (n, nv), and measured ones (n, nv)."""
        load, limits, count, rows = self.load, self.limits, len(self.time), slice(first, first + len(s))
        sigma = self._sigma(s) if self.estimating or measured is not None else np.zeros_like(torques)
        alone = load.drive_torques(load.unloaded_torques(s)) if load.carries else torques
        followers = bool(load.with_load.model.limited_followers)
        borne = load.follower_torques(s) if followers else np.zeros((len(s), 0))
        whole = Extremes.from_states(load, limits, s, (s.time, torques, borne))
        doubted = self.spans.within(s.time)
        steady = ~doubted if self.plan.source != "given" else np.ones(len(s), bool)
        sound = (s.time[steady], torques[steady], borne[steady])
        some, edges = s[:: max(1, len(s) // _MASS_SAMPLES)], self._edges
        edges = edges[(edges >= rows.start) & (edges < rows.stop)] - first
        margin = None
        if margin_determined(load):
            added = load.drive_torques(load.payload_torques(s))
            every = np.hstack([added, load.follower_payload_torques(s)]) if followers else added
            margin = payload_shares(load, limits.effort, s.time, np.hstack([torques, borne]), every)
        return MotionFigures(
            rows=len(s),
            squares=mean_weights(self.time, rows) @ (torques * torques),
            whole=whole,
            sound=Extremes.from_states(load, limits, s[~doubted], sound) if self.spans else whole,
            alone=Extrema.from_rows(s.time, np.abs(alone), alone),
            speed=Extrema.from_rows(s.time, np.abs(s.dq), s.dq),
            at_peaks=s[np.abs(torques).argmax(axis=0)],
            envelope=Bins.from_rows(first, s.time, torques, torques, count),
            band=Bins.from_rows(first, s.time, torques - INTERVAL * sigma, torques + INTERVAL * sigma, count)
            if self.estimating
            else None,
            runs=Runs.from_rows(first, np.abs(torques), self.bootstrap.cell) if self.estimating else None,
            edges=(s.q[edges], s.dq[edges]),
            fastest=np.abs([s.dq, s.ddq]).max(axis=1),
            largest=np.abs(s.measured).max(axis=0),
            noise=self._noise(some),
            stationary=s.stationary.sum(axis=0),
            outliers=self._outliers(s, torques),
            motors=MotorFigures.from_rows(load.with_load.model, rows, self.time, load.motor_loads(s))
            if load.with_load.actuators
            else None,
            margin=margin,
            carried=float(np.abs(load.payload_torques(some)).max(initial=0.0)) if load.payloads else 0.0,
            **self._comparisons(s.time, [torques, alone] if load.carries else [torques], measured, sigma, doubted),
        )

    def _comparisons(
        self, time: Array, computed: Sequence[Array], measured: Array | None, sigma: Array, doubted: Array
    ) -> dict[str, Any]:
        """Comparisons with measured torques (n, nv), and the rows in which these are above their limits."""
        if measured is None:
            return {"compared": (), "above": np.zeros((len(time), 0), bool)}
        tau = self.load.drive_torques(measured)
        compared = tuple(TorqueComparison.from_rows(time, each, tau, sigma, doubted) for each in computed)
        return {"compared": compared, "above": above_limits(tau, self.limits.effort, self._measured_noise)}

    def _sigma(self, s: MotionSamples) -> Array:
        """Standard deviation (n, nv) of the torques, from the mass matrices of some of the states."""
        if not self.plan.sigma_ddq.any():
            return np.zeros(s.dq.shape)
        stride = max(1, len(s) // _BAND_SAMPLES)
        M = self.load.mass_matrix(s.q[::stride])
        squares = self.plan.sigma_at(s) ** 2
        blocks = [(M[k] * M[k]) @ squares[k * stride : (k + 1) * stride].T for k in range(len(M))]
        return np.sqrt(np.concatenate(blocks, axis=1).T)

    def _noise(self, some: MotionSamples) -> Array:
        """Largest standard deviation (nv,) of the torques in some of the states."""
        if not self.plan.sigma_ddq.any():
            return np.zeros(len(self.plan.sigma_ddq))
        M = self.load.mass_matrix(some.q)
        return np.sqrt((M * M) @ (self.plan.sigma_ddq**2)).max(axis=0)

    def _outliers(self, s: MotionSamples, torques: Array) -> Array:
        """Outliers (m, 5); the last column is 1 if the sample, if real, implies a torque beyond a limit or without a limit."""
        if not s.outlier.any():
            return np.zeros((0, 5))
        order = 1 if self.plan.source == "velocities" else 2
        gain = pulse_peak(order, self.plan.quality.step)
        rows, columns = np.nonzero(s.outlier[:, :, 0])
        found = np.column_stack([columns, s.time[rows], s.outlier[rows, columns], np.zeros(len(rows))])
        for each, row in zip(found, rows.tolist(), strict=True):
            each[4] = self._may_pass(s.q[row], torques[row], int(each[0]), order, gain * abs(float(each[3])))
        return found

    def _may_pass(self, q: Array, torques: Array, column: int, order: int, acceleration: float) -> bool:
        """True if an acceleration at a smoothed column adds a torque that no limit covers."""
        places, factor = (slice(column, column + 1), 1.0) if order == 1 else _accelerated(self.load.robot.model, column)
        change = np.abs(self.load.mass_matrix(q)[:, places]).sum(axis=1) * factor * acceleration
        effort = np.where(np.isfinite(self.limits.effort), self.limits.effort, 0.0)
        within = np.abs(torques) + change <= effort
        return not (within | (change <= ZERO * np.abs(torques).max())).all()

    # What follows from the figures of the whole motion

    def gaps(self, found: MotionFigures) -> Gaps:
        """Gaps in time, and the motion that they may hide."""
        simple = all(body.joint.nv == 1 and body.joint.nq == 1 for body in self.load.robot.model.leaders)
        stops = (self.limits.lower, self.limits.upper) if simple else None
        return Gaps.from_edges(self.time, found.edges, found.fastest, self._gap, rates=simple, stops=stops)

    def terms(self, found: MotionFigures) -> dict[str, Array]:
        """Causes (nv,) of the peak of each torque."""
        own = np.arange(len(found.at_peaks))
        return {name: self.load.drive_torques(x)[own, own] for name, x in self.load.terms(found.at_peaks).items()}

    def around(self, found: MotionFigures, joint: int) -> MotionSamples:
        """States on either side of a joint's peak."""
        robot = self.load.robot
        reach = min(_AROUND, max(1, _KEPT // (2 * robot.nv * (1 + 2 * robot.nq + 3 * robot.nv))))
        return self.plan.states_near(int(np.searchsorted(self.time, found.whole.peak.time[joint])), reach)

    def estimates(self, found: MotionFigures, progress: Callable[[float], None] | None) -> list[PeakEstimate]:
        """Noise-corrected peaks of all joints."""
        assert found.runs is not None
        estimates, terms = [], self.terms(found)
        for k in range(self.load.robot.nv):
            steady, speed = float(sum(terms[name][k] for name in STEADY)), float(found.speed.signed[k])
            each, runs = found.runs.contenders(k), len(found.runs.number)
            estimates.append(self.bootstrap.estimate(k, found.whole.peak, each, runs, steady, speed))
            if progress is not None:
                progress((k + 1) / self.load.robot.nv)
        return estimates

    def measured(self, found: MotionFigures) -> tuple[MeasuredTorque, ...]:
        """Measured torques compared with those of the robot, with or without load, whichever agrees better."""
        if not found.compared:
            return ()
        best = min(found.compared, key=lambda one: one.misfit)
        step = float(np.median(np.diff(self.time))) if found.rows > 1 else 0.0
        above = TimeAbove.from_rows(self.time, found.above)
        labels = self.load.with_load.model.drive_labels
        return best.torques(labels, self.load.units, self.limits.effort, above, step)


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
    progress: Callable[[float], None] | None = None,
    chunk: int | None = None,
) -> TorqueReport:
    """Compute the torques of a motion and judge it.

    ``progress`` receives the finished share, 0 to 1. ``chunk`` is the number of rows processed at a time; it affects results
    only by rounding errors.
    """
    fixed = min(1.0, _PLANNED / max(1, differentiation.trajectory.size))
    steps = Steps(progress, (_OF_A_PASS, _OF_THE_PLAN * fixed, _OF_A_PASS, _OF_THE_DRAWS * fixed))
    run = _Run(load, limits, chunk or _rows_of_a_slice(load), steps)
    if differentiation.smooths:
        steps.skip(2)
        report = run.answer(differentiation)
    elif not differentiation.sigma_ddq.any():
        report = _report(*run.once(differentiation))
    else:
        derived = run.once(differentiation)
        report = _report(*derived)
        if any(j.noise > NEGLIGIBLE * report.reference(j) for j in report.joints):
            report = run.answer(differentiation.smoothed(steps.next()), derived)
    steps.done()
    return report


@dataclass(frozen=True, eq=False)
class _Run:
    """Passes over one motion."""

    load: LoadCase
    limits: Limits
    chunk: int
    steps: Steps

    def once(self, plan: Differentiation, *, estimating: bool = False) -> tuple[MotionPass, MotionFigures]:
        """Run one pass."""
        progress = self.steps.next(len(plan.trajectory.table))
        passing = MotionPass(self.load, self.limits, plan, estimating)
        parts, first = list[MotionFigures](), 0
        for states, motion, inner in plan.surrounded_states(self.chunk, progress):
            s = states[inner]
            torques = self.load.drive_torques(self.load.torques(s))
            _check_finite(torques, s)
            parts.append(passing.figures(first, s, torques, None if motion.tau is None else motion.tau[inner]))
            first += len(s)
        return passing, MotionFigures.joined(parts)

    def answer(self, plan: Differentiation, derived: tuple[MotionPass, MotionFigures] | None = None) -> TorqueReport:
        """Report of the smoothed motion, with the results ``derived`` from the unsmoothed log."""
        run, found = self.once(plan, estimating=True)
        return _report(run, found, derived, run.estimates(found, self.steps.next()))


def _report(
    run: MotionPass,
    found: MotionFigures,
    derived: tuple[MotionPass, MotionFigures] | None = None,
    estimates: Sequence[PeakEstimate] | None = None,
) -> TorqueReport:
    plan, load, outliers = run.plan, run.load, outliers_of(found.outliers)
    joints = _joints(run, found, None if derived is None else derived[1])
    if estimates is not None:
        joints = tuple(replace(j, estimate=e) for j, e in zip(joints, estimates, strict=True))
    worst = worst_joint([abs(j.peak) for j in joints], [j.limit for j in joints])
    return TorqueReport(
        robot=load.robot.name,
        trajectory=str(plan.trajectory.path),
        rows=found.rows,
        begin=float(run.time[0]),
        end=float(run.time[-1]),
        joints=Joints(joints),
        excesses=found.whole.excesses(),
        gaps=run.gaps(found),
        quality=plan.quality,
        differentiation=plan,
        load=load,
        envelope=found.envelope[1:],
        band=None if found.band is None else found.band[1:],
        largest=found.largest,
        limits=run.limits,
        outliers=outliers,
        stationary=tuple((found.stationary / max(1, found.rows)).tolist()),
        motors=() if found.motors is None else found.motors.uses(load.with_load.model),
        around=run.around(found, worst),
        doubts=_doubts(run, found, glitches=not outliers),
        near=found.whole.nearest(),
        bearings=found.whole.bearings(),
        spans=run.spans,
        sound=SoundFigures(found.sound.peak.value, found.sound.excesses()) if run.spans else None,
        measured=run.measured(found),
        idle_payload=any(p.mass for p in load.payloads)
        and found.carried <= ZERO * float(found.whole.peak.value.max(initial=0.0)),
        payload_margin=None if found.margin is None else payload_margin(load, run.limits.effort, found.margin),
        derived=None if derived is None else _as_derived(*derived),
    )


def _as_derived(run: MotionPass, found: MotionFigures) -> AsDerived:
    motors = () if found.motors is None else found.motors.uses(run.load.with_load.model)
    return AsDerived(run.plan, found.whole.excesses(), found.envelope[1:], motors)


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


def _doubts(run: MotionPass, figures: MotionFigures, *, glitches: bool) -> tuple[Doubt, ...]:
    """Doubts about the log without dynamics, by the robot's own limits; before them that torques are impossible."""
    log, robot = run.plan.trajectory, run.load.robot
    found = log.doubts(run.limits, own=robot.limits, glitches=glitches)
    if any(doubt.refuses for doubt in found):
        return found
    corners = replace(run.spans, instants=tuple(i for i in log.instants if i.cause is not InstantKind.ROWS))
    strong = impossible_torque(robot, figures.alone, log.origin, corners)
    return found if strong is None else (strong, *found)


def _joints(run: MotionPass, found: MotionFigures, derived: MotionFigures | None) -> tuple[JointTorque, ...]:
    """Figures of each joint."""
    rms, units, terms, peak = np.sqrt(found.squares), run.load.units, run.terms(found), found.whole.peak
    noisy = found if derived is None else derived
    return tuple(
        JointTorque(
            joint=name,
            unit=units[k],
            largest=float(peak.signed[k]),
            time=float(peak.time[k]),
            rms=float(rms[k]),
            limit=float(run.limits.effort[k]),
            terms={term: float(values[k]) for term, values in terms.items()},
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


def _rows_of_a_slice(load: LoadCase) -> int:
    return max(1024, _NUMBERS_PER_CHUNK // max(1, load.robot.nv))


def write_torques(report: TorqueReport, path: str | Path, *, split: bool) -> Path:
    """Write time and torques of a report, their causes if ``split``, and the torques of a noisy log before smoothing."""
    load, plan = report.load, report.differentiation
    beside = None if report.derived is None else report.derived.differentiation
    causes = load.causes if split else ()
    header = _csv_header(load.with_load.model.drive_names, causes, derived=beside is not None)
    more, first = further_columns(report.held), 0
    with csv_table(path, [*header, *more]) as table:
        for states, motion, inner in plan.surrounded_states(_rows_of_a_slice(load)):
            s = states[inner]
            columns = [load.torques(s)]
            columns += load.terms(s).values() if split else ()
            columns += [] if beside is None else [load.torques(beside.complete(motion)[inner])]
            further = [x[first : first + len(s), None] for x in more.values()]
            table.numbers(np.concatenate([s.time[:, None], *map(load.drive_torques, columns), *further], axis=1))
            first += len(s)
    return Path(path)


def _csv_header(names: tuple[str, ...], causes: tuple[str, ...], *, derived: bool) -> list[str]:
    quantities = ["torque", *causes, *(["torque.derived"] if derived else [])]
    return ["time", *(f"{name}.{quantity}" for quantity in quantities for name in names)]
