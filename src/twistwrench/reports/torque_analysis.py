"""Analysis of the torques of a motion by inverse dynamics: passes over its samples, slice by slice of a log."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

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
from ..motion.bounds import Extrema, TimeAbove, above_limits
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
from ..motion.plausibility import SURROUNDINGS, DoubtfulSpans, InstantKind, doubtful_spans, impossible_torque
from .measured_torque import MeasuredTorque, TorqueComparison
from .motors import MotorFigures, MotorUse, Steps
from .statistics import INTERVAL, Bins, Gaps, PeakBootstrap, PeakEstimate, Runs, gap_edges, mean_weights
from .support.view import further_columns
from .torque_report import (
    MIN_NOISE_SHARE,
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

T = TypeVar("T")
_ROWS_AROUND, _MAX_NUMBERS_AROUND = 2048, 1 << 23
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
        position_of = Coordinates.from_model(load.robot.model).position_of
        has_position = position_of >= 0
        q = np.where(has_position, s.measured[:, np.maximum(position_of, 0)], 0.0)
        beyond = {
            "lower": (np.where(has_position, limits.lower, -np.inf) - q, q),
            "upper": (q - np.where(has_position, limits.upper, np.inf), q),
            "velocity": (np.abs(s.dq) - limits.velocity, s.dq),
        }
        if bears(limits):
            for kind, bearing_load in load.bearing_loads(s).items():
                beyond[kind] = bearing_load - getattr(limits, kind), bearing_load
        passed = {kind: Extrema.from_rows(s.time, *values) for kind, values in beyond.items()}
        time, tau, borne = torques
        peak = Extrema.from_rows(time, np.abs(tau), tau)
        return cls(load, limits, passed, peak, Extrema.from_rows(time, np.abs(borne), borne))

    @classmethod
    def from_parts(cls, parts: Sequence[Extremes]) -> Extremes:
        """Extremes of consecutive rows from those of their parts."""
        first = parts[0]
        passed = dict(first.passed)
        for kind in passed:
            passed[kind] = Extrema.merge([part.passed[kind] for part in parts])
        peak, borne = Extrema.merge(_each(parts, "peak")), Extrema.merge(_each(parts, "borne"))
        return cls(first.load, first.limits, passed, peak, borne)

    @property
    def _model(self) -> Model:
        return self.load.with_load.model

    @property
    def _coordinates(self) -> Coordinates:
        return Coordinates.from_model(self.load.robot.model)

    def nearest(self) -> tuple[NearLimit, ...]:
        """Velocity and position nearest to a limit; those without one are left out."""
        names, limits, velocity = self._coordinates.velocity_names, self.limits, self.passed["velocity"]
        if not len(names) or not np.isfinite(velocity.time).any():
            return ()
        limited = np.isfinite(limits.velocity)
        shares = np.abs(velocity.signed) / np.where(limited, limits.velocity, 1.0)
        near = []
        if limited.any():
            near = _nearest_limit(names, "velocity", np.where(limited, shares, 0.0), velocity.time)
        bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper) & (limits.upper > limits.lower)
        if bounded.any():
            ranges = np.where(bounded, limits.upper - limits.lower, 1.0)
            for passed in (self.passed["lower"], self.passed["upper"]):
                shares = np.where(bounded, 1.0 + 2.0 * passed.value / ranges, 0.0)
                near += _nearest_limit(names, "position", shares, passed.time)
        return tuple(sorted(near, key=lambda limit: -limit.share))

    def bearings(self) -> tuple[BearingUse, ...]:
        """Largest loads of the bearings that have limits, by joint."""
        uses = []
        for k, name in enumerate(self._coordinates.velocity_names):
            for kind, loads in self.passed.items():
                if kind in BEARINGS and np.isfinite(getattr(self.limits, kind)[k]):
                    limit = float(getattr(self.limits, kind)[k])
                    uses.append(BearingUse(name, kind, float(loads.signed[k]), limit, float(loads.time[k])))
        return tuple(uses)

    def excesses(self) -> tuple[Excess, ...]:
        """Exceeded limits, worst effort first."""
        excesses = [*self._torque_excesses(), *self._motion_excesses(), *self._follower_excesses()]
        return tuple(sorted(excesses, key=_severity_order))

    def _torque_excesses(self) -> Iterator[Excess]:
        """Exceeded torque limits of the drives."""
        model, limits = self._model, self.limits.effort
        turns = drive_turns(model)
        for k in np.flatnonzero(self.peak.value - limits > margin(limits)):
            value, time = float(self.peak.signed[k]), float(self.peak.time[k])
            unit = unit_of("tau", turns[k])
            yield Excess(model.drive_labels[k], "effort", value, float(limits[k]), time, unit, turns[k])

    def _motion_excesses(self) -> Iterator[Excess]:
        """Exceeded limits of positions, velocities and bearings."""
        c = self._coordinates
        for kind, extreme in self.passed.items():
            limits = getattr(self.limits, kind)
            coordinate = "dq" if kind == "velocity" else "q"
            allowed = self.limits.tolerance if kind in ("lower", "upper") else margin(limits)
            for k in np.flatnonzero(extreme.value > allowed):
                angular = bool(c.angular_velocity[k])
                unit = BEARING_UNITS.get(kind) or unit_of(coordinate, angular)
                value, limit, time = float(extreme.signed[k]), float(limits[k]), float(extreme.time[k])
                yield Excess(c.velocity_names[k], kind, value, limit, time, unit, angular)

    def _follower_excesses(self) -> Iterator[Excess]:
        """Exceeded torque limits of mimic joints."""
        model = self._model
        for i, k in enumerate(model.limited_followers):
            body, value = model.bodies[k], float(self.borne.signed[i])
            if abs(value) > body.effort + margin(body.effort):
                angular = bool(body.joint.turning[0])
                unit, time = unit_of("tau", angular), float(self.borne.time[i])
                yield Excess(body.joint.name, "effort", value, body.effort, time, unit, angular)


def _nearest_limit(names: Sequence[str], kind: str, shares: Array, times: Array) -> list[NearLimit]:
    """The coordinate with the largest share of its limit."""
    k = int(shares.argmax())
    return [NearLimit(names[k], kind, float(shares[k]), float(times[k]))]


def _severity_order(excess: Excess) -> tuple[bool, str, float]:
    """Key of an order that begins with the worst torque."""
    share = abs(excess.value / excess.limit) if excess.limit else 0.0
    return excess.kind != "effort", excess.kind, -share


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
    def from_parts(cls, parts: Sequence[MotionFigures]) -> MotionFigures:
        """Figures of consecutive rows from those of their parts."""
        each = partial(_each, parts)
        drives = np.arange(parts[0].whole.peak.value.size)
        part_with_peak = np.argmax([part.whole.peak.value for part in parts], axis=0)
        states_at_peaks = _join_samples(each("at_peaks"))
        q, dq = map(np.concatenate, zip(*each("edges"), strict=True))
        return cls(
            rows=sum(each("rows")),
            squares=np.sum(each("squares"), axis=0),
            whole=Extremes.from_parts(each("whole")),
            sound=Extremes.from_parts(each("sound")),
            alone=Extrema.merge(each("alone")),
            speed=Extrema.merge(each("speed")),
            at_peaks=states_at_peaks[part_with_peak * len(drives) + drives],
            envelope=Bins.from_parts(each("envelope")),
            band=_join_optional(Bins.from_parts, each("band")),
            runs=_join_optional(Runs.from_parts, each("runs")),
            edges=(q, dq),
            fastest=np.max(each("fastest"), axis=0),
            largest=np.max(each("largest"), axis=0),
            noise=np.max(each("noise"), axis=0),
            stationary=np.sum(each("stationary"), axis=0),
            outliers=np.concatenate(each("outliers")),
            motors=_join_optional(MotorFigures.from_parts, each("motors")),
            margin=_join_optional(PayloadShares.from_parts, each("margin")),
            carried=max(each("carried")),
            compared=tuple(map(TorqueComparison.from_parts, zip(*each("compared"), strict=True))),
            above=np.concatenate(each("above")),
        )


def _each(parts: Sequence[Any], name: str) -> list[Any]:
    """One figure of each part."""
    return [getattr(part, name) for part in parts]


def _join_samples(parts: Sequence[MotionSamples]) -> MotionSamples:
    """Samples of consecutive rows."""
    return MotionSamples(*[np.concatenate(_each(parts, field.name)) for field in fields(MotionSamples)])


def _join_optional(join: Callable[[Sequence[T]], T], parts: Sequence[T | None]) -> T | None:
    """Joined figures; None if the parts have none."""
    present = [part for part in parts if part is not None]
    if not present:
        return None
    return join(present)


def _moved_velocities(model: Model, column: int) -> tuple[slice, float]:
    """Velocities that a coordinate moves, and the largest acceleration of one of them for a unit of the coordinate's."""
    body = next(b for b in model.leaders if b.q_index <= column < b.q_index + b.joint.nq)
    _, velocities = body.places
    if body.joint.quaternion is None:
        return velocities, 1.0
    first = body.q_index + body.joint.quaternion
    middle = velocities.start + 3  # angular velocities come first; a unit of a quaternion is a turn by 2
    if first <= column < first + 4:
        return slice(velocities.start, middle), 2.0
    return slice(middle, velocities.stop), 1.0


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
        load, count, rows = self.load, len(self.time), slice(first, first + len(s))
        computed = [torques]
        if load.carries:
            computed.append(load.drive_torques(load.unloaded_torques(s)))
        alone = computed[-1]
        borne = np.zeros((len(s), 0))
        if load.with_load.model.limited_followers:
            borne = load.follower_torques(s)
        whole = Extremes.from_states(load, self.limits, s, (s.time, torques, borne))
        doubted = self.spans.within(s.time)
        edges = self._edges[(self._edges >= rows.start) & (self._edges < rows.stop)] - first
        some_states = s[:: max(1, len(s) // _MASS_SAMPLES)]
        sigma, band, runs, motors, carried = np.zeros_like(torques), None, None, None, 0.0
        if self.estimating or measured is not None:
            sigma = self._sigma(s)
        if self.estimating:
            band = Bins.from_rows(first, s.time, torques - INTERVAL * sigma, torques + INTERVAL * sigma, count)
            runs = Runs.from_rows(first, np.abs(torques), self.bootstrap.cell)
        if load.with_load.actuators:
            motors = MotorFigures.from_rows(load.with_load.model, rows, self.time, load.motor_loads(s))
        if load.payloads:
            carried = float(np.abs(load.payload_torques(some_states)).max(initial=0.0))
        return MotionFigures(
            rows=len(s),
            squares=mean_weights(self.time, rows) @ (torques * torques),
            whole=whole,
            sound=self._sound_extremes(whole, s, torques, borne, doubted),
            alone=Extrema.from_rows(s.time, np.abs(alone), alone),
            speed=Extrema.from_rows(s.time, np.abs(s.dq), s.dq),
            at_peaks=s[np.abs(torques).argmax(axis=0)],
            envelope=Bins.from_rows(first, s.time, torques, torques, count),
            band=band,
            runs=runs,
            edges=(s.q[edges], s.dq[edges]),
            fastest=np.abs([s.dq, s.ddq]).max(axis=1),
            largest=np.abs(s.measured).max(axis=0),
            noise=self._noise(some_states),
            stationary=s.stationary.sum(axis=0),
            outliers=self._outliers(s, torques),
            motors=motors,
            margin=self._payload_shares(s, torques, borne),
            carried=carried,
            **self._comparisons(s.time, computed, measured, sigma, doubted),
        )

    def _sound_extremes(
        self, whole: Extremes, s: MotionSamples, torques: Array, borne: Array, doubted: Array
    ) -> Extremes:
        """Extremes without doubtful rows; torques of all rows if they do not depend on derived rates."""
        if not self.spans:
            return whole
        rows = ~doubted
        if self.plan.source == "given":
            rows = np.ones(len(s), bool)
        return Extremes.from_states(self.load, self.limits, s[~doubted], (s.time[rows], torques[rows], borne[rows]))

    def _payload_shares(self, s: MotionSamples, torques: Array, borne: Array) -> PayloadShares | None:
        """Torques with the payload's parts for its largest mass; None if that is not determined."""
        load = self.load
        if not margin_determined(load):
            return None
        due_to_payload = load.drive_torques(load.payload_torques(s))
        if load.with_load.model.limited_followers:
            due_to_payload = np.hstack([due_to_payload, load.follower_payload_torques(s)])
        return payload_shares(load, self.limits.effort, s.time, np.hstack([torques, borne]), due_to_payload)

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

    def _noise(self, states: MotionSamples) -> Array:
        """Largest standard deviation (nv,) of the torques in some of the states."""
        if not self.plan.sigma_ddq.any():
            return np.zeros(len(self.plan.sigma_ddq))
        M = self.load.mass_matrix(states.q)
        return np.sqrt((M * M) @ (self.plan.sigma_ddq**2)).max(axis=0)

    def _outliers(self, s: MotionSamples, torques: Array) -> Array:
        """Outliers (m, 5); the last column is 1 if the sample, if real, implies a torque beyond a limit or without a limit."""
        if not s.outlier.any():
            return np.zeros((0, 5))
        order = 2  # accelerations are this derivative of the smoothed columns
        if self.plan.source == "velocities":
            order = 1
        gain = pulse_peak(order, self.plan.quality.step)
        rows, columns = np.nonzero(s.outlier[:, :, 0])
        outliers = np.column_stack([columns, s.time[rows], s.outlier[rows, columns], np.zeros(len(rows))])
        for outlier, row in zip(outliers, rows.tolist(), strict=True):
            acceleration = gain * abs(float(outlier[3]))
            outlier[4] = self._may_pass(s.q[row], torques[row], int(outlier[0]), order, acceleration)
        return outliers

    def _may_pass(self, q: Array, torques: Array, column: int, order: int, acceleration: float) -> bool:
        """True if an acceleration at a smoothed column adds a torque that no limit covers."""
        velocities, factor = slice(column, column + 1), 1.0
        if order == 2:
            velocities, factor = _moved_velocities(self.load.robot.model, column)
        change = np.abs(self.load.mass_matrix(q)[:, velocities]).sum(axis=1) * factor * acceleration
        effort = np.where(np.isfinite(self.limits.effort), self.limits.effort, 0.0)
        within = np.abs(torques) + change <= effort
        return not (within | (change <= ZERO * np.abs(torques).max())).all()

    # What follows from the figures of the whole motion

    def gaps(self, found: MotionFigures) -> Gaps:
        """Gaps in time, and the motion that they may hide."""
        simple = all(body.joint.nv == 1 and body.joint.nq == 1 for body in self.load.robot.model.leaders)
        stops = None
        if simple:
            stops = self.limits.lower, self.limits.upper
        return Gaps.from_edges(self.time, found.edges, found.fastest, self._gap, rates=simple, stops=stops)

    def terms(self, found: MotionFigures) -> dict[str, Array]:
        """Causes (nv,) of the peak of each torque."""
        terms = self.load.terms(found.at_peaks)
        for name, torques in terms.items():
            terms[name] = np.diagonal(self.load.drive_torques(torques)).copy()
        return terms

    def around(self, found: MotionFigures, joint: int) -> MotionSamples:
        """States on either side of a joint's peak."""
        robot = self.load.robot
        numbers_per_row = 1 + 2 * robot.nq + 3 * robot.nv
        reach = min(_ROWS_AROUND, max(1, _MAX_NUMBERS_AROUND // (2 * robot.nv * numbers_per_row)))
        return self.plan.states_near(int(np.searchsorted(self.time, found.whole.peak.time[joint])), reach)

    def estimates(self, found: MotionFigures, progress: Callable[[float], None] | None) -> list[PeakEstimate]:
        """Noise-corrected peaks of all joints."""
        assert found.runs is not None
        estimates, terms = [], self.terms(found)
        for k in range(self.load.robot.nv):
            steady, speed = float(sum(terms[name][k] for name in STEADY)), float(found.speed.signed[k])
            each, runs = found.runs.contenders(k), found.runs.count
            estimates.append(self.bootstrap.estimate(k, found.whole.peak, each, runs, steady, speed))
            if progress is not None:
                progress((k + 1) / self.load.robot.nv)
        return estimates

    def measured_torques(self, found: MotionFigures) -> tuple[MeasuredTorque, ...]:
        """Measured torques compared with those of the robot, with or without load, whichever agrees better."""
        if not found.compared:
            return ()
        best = min(found.compared, key=lambda comparison: comparison.misfit)
        step = 0.0
        if found.rows > 1:
            step = float(np.median(np.diff(self.time)))
        above = TimeAbove.from_rows(self.time, found.above)
        labels = self.load.with_load.model.drive_labels
        return best.torques(labels, self.load.units, self.limits.effort, above, step)


# If noise of a log matters, a second pass over the smoothed log gives all results: peaks, causes, limits, motors, files and
# pictures. The results of the unsmoothed log are reported beside them.

_NUMBERS_PER_CHUNK = 1 << 19
"""Rows times velocities of a chunk: 4 MiB per array."""
_PASS_DURATION, _PLAN_DURATION, _DRAWS_DURATION = 1.0, 8.0, 1.0
"""Durations of the steps for a log of up to :data:`_MAX_EXCERPT_BYTES` bytes, relative to one pass."""
_MAX_EXCERPT_BYTES = 1 << 21
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
    planned_share = min(1.0, _MAX_EXCERPT_BYTES / max(1, differentiation.trajectory.size))
    plan_and_draws = _PLAN_DURATION * planned_share, _DRAWS_DURATION * planned_share
    steps = Steps(progress, (_PASS_DURATION, plan_and_draws[0], _PASS_DURATION, plan_and_draws[1]))
    run = _Run(load, limits, chunk or _rows_of_a_slice(load), steps)
    if differentiation.smooths:
        steps.skip(2)
        report = run.answer(differentiation)
    elif not differentiation.sigma_ddq.any():
        report = _report(*run.once(differentiation))
    else:
        derived = run.once(differentiation)
        report = _report(*derived)
        if any(j.noise > MIN_NOISE_SHARE * report.reference(j) for j in report.joints):
            report = run.answer(differentiation.with_smoothing(steps.next()), derived)
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
            measured = motion.tau
            if measured is not None:
                measured = measured[inner]
            parts.append(passing.figures(first, s, torques, measured))
            first += len(s)
        return passing, MotionFigures.from_parts(parts)

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
    joints = _joints(run, found)
    if derived is not None:
        joints = _with_unsmoothed_figures(joints, derived[1])
    if estimates is not None:
        for k, estimate in enumerate(estimates):
            joints[k] = replace(joints[k], estimate=estimate)
    worst = worst_joint(joints)
    has_mass = any(payload.mass for payload in load.payloads)
    unloaded = found.carried <= ZERO * float(found.whole.peak.value.max(initial=0.0))
    largest_payload = None
    if found.margin is not None:
        largest_payload = payload_margin(load, run.limits.effort, found.margin)
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
        motors=_motor_uses(run, found),
        around=run.around(found, worst),
        doubts=_doubts(run, found, glitches=not outliers),
        near=found.whole.nearest(),
        bearings=found.whole.bearings(),
        spans=run.spans,
        sound=SoundFigures(found.sound.peak.value, found.sound.excesses()) if run.spans else None,
        measured=run.measured_torques(found),
        idle_payload=has_mass and unloaded,
        payload_margin=largest_payload,
        derived=None if derived is None else _unsmoothed_results(*derived),
    )


def _unsmoothed_results(run: MotionPass, found: MotionFigures) -> AsDerived:
    return AsDerived(run.plan, found.whole.excesses(), found.envelope[1:], _motor_uses(run, found))


def _motor_uses(run: MotionPass, found: MotionFigures) -> tuple[MotorUse, ...]:
    if found.motors is None:
        return ()
    return found.motors.uses(run.load.with_load.model)


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
    times, torques = list[Array](), list[Array]()
    for table in excerpts(log.table, *_NOISE_RUNS):
        rows = log.motion(table)
        if rows.tau is not None:
            times.append(rows.time)
            torques.append(rows.tau)
    if not torques:
        return np.zeros(nv)
    return noise(times, torques)


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
    too_strong = impossible_torque(robot, figures.alone, log.origin, corners)
    if too_strong is None:
        return found
    return (too_strong, *found)


def _joints(run: MotionPass, found: MotionFigures) -> list[JointTorque]:
    """Figures of each joint."""
    rms, units, terms, peak = np.sqrt(found.squares), run.load.units, run.terms(found), found.whole.peak
    joints = []
    for k, name in enumerate(run.load.with_load.model.drive_labels):
        causes = {term: float(values[k]) for term, values in terms.items()}
        joint = JointTorque(
            joint=name,
            unit=units[k],
            largest=float(peak.signed[k]),
            time=float(peak.time[k]),
            rms=float(rms[k]),
            limit=float(run.limits.effort[k]),
            terms=causes,
            noise=float(found.noise[k]),
        )
        joints.append(joint)
    return joints


def _with_unsmoothed_figures(joints: Sequence[JointTorque], derived: MotionFigures) -> list[JointTorque]:
    """Joints with noise, peak and its time of the unsmoothed log."""
    peak, unsmoothed = derived.whole.peak, []
    for k, j in enumerate(joints):
        raw, time = float(peak.signed[k]), float(peak.time[k])
        unsmoothed.append(replace(j, noise=float(derived.noise[k]), raw=raw, raw_time=time))
    return unsmoothed


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
    load, plan, unsmoothed = report.load, report.differentiation, report.derived
    quantities = ["torque"]
    if split:
        quantities += load.causes
    if unsmoothed is not None:
        quantities.append("torque.derived")
    names = load.with_load.model.drive_names
    header = [f"{name}.{quantity}" for quantity, name in itertools.product(quantities, names)]
    further, first = further_columns(report.held), 0
    with csv_table(path, ["time", *header, *further]) as table:
        for states, motion, inner in plan.surrounded_states(_rows_of_a_slice(load)):
            s = states[inner]
            torques = [load.torques(s)]
            if split:
                torques += load.terms(s).values()
            if unsmoothed is not None:
                torques.append(load.torques(unsmoothed.differentiation.complete(motion)[inner]))
            own_rows = slice(first, first + len(s))
            columns = [s.time[:, None], *map(load.drive_torques, torques)]
            columns += [values[own_rows, None] for values in further.values()]
            table.numbers(np.concatenate(columns, axis=1))
            first += len(s)
    return Path(path)
