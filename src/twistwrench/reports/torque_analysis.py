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
from ..motion.bounds import Extrema, TimeAbove, above_limits, first_largest
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
_MAX_ROWS_BESIDE_PEAK = 2048
"""Largest number of rows on either side of the worst joint's peak."""
_MAX_NUMBERS_BESIDE_PEAK = 1 << 23
"""Largest count of numbers in the rows beside a peak: 64 MiB."""
_MASS_SAMPLES = 32
"""Number of states of each slice used for the noise of torques and for the largest payload torque."""
_BAND_SAMPLES = 512
"""Number of states of each slice whose mass matrix is computed; each matrix is used up to the next of these states."""


@dataclass(frozen=True, eq=False)
class Extremes:
    """Largest torques, and largest excesses over the other limits, of some states."""

    load: LoadCase
    limits: Limits
    excess: dict[str, Extrema]
    """Largest excesses over each kind of limit: lower, upper, velocity, and those of bearings if some have limits."""
    peak: Extrema
    """Largest torques of the drives."""
    borne: Extrema
    """Largest torques of mimic joints with an effort limit."""

    @classmethod
    def from_states(
        cls, load: LoadCase, limits: Limits, s: MotionSamples, torques: tuple[Array, Array, Array]
    ) -> Extremes:
        """Extremes of the states ``s`` and of torques.

        ``torques`` are times (n,), torques of the drives (n, nv), and torques of mimic joints with limits (n, mimic joints).
        """
        position_of = Coordinates.from_model(load.robot.model).position_of
        has_position = position_of >= 0  # balls have none
        any_column = np.maximum(position_of, 0)  # column 0 stands in for a missing one, and does not count
        q = np.where(has_position, s.measured[:, any_column], 0.0)
        excess_and_value = {  # excess over the limit, and value, by kind of limit
            "lower": (np.where(has_position, limits.lower, -np.inf) - q, q),
            "upper": (q - np.where(has_position, limits.upper, np.inf), q),
            "velocity": (np.abs(s.dq) - limits.velocity, s.dq),
        }
        if bears(limits):
            for kind, bearing_load in load.bearing_loads(s).items():
                bearing_excess = bearing_load - getattr(limits, kind)
                excess_and_value[kind] = (bearing_excess, bearing_load)
        excess = {kind: Extrema.from_rows(s.time, *arrays) for kind, arrays in excess_and_value.items()}
        time, drive_torques, borne_torques = torques
        peak = Extrema.from_rows(time, np.abs(drive_torques), drive_torques)
        borne = Extrema.from_rows(time, np.abs(borne_torques), borne_torques)
        return cls(load, limits, excess, peak, borne)

    @classmethod
    def from_parts(cls, parts: Sequence[Extremes]) -> Extremes:
        """Extremes of consecutive rows from the extremes of their parts."""
        first_part = parts[0]
        excess = {}
        for kind in first_part.excess:
            excess[kind] = Extrema.merge([part.excess[kind] for part in parts])
        peak = Extrema.merge(_field_of_each(parts, "peak"))
        borne = Extrema.merge(_field_of_each(parts, "borne"))
        return cls(first_part.load, first_part.limits, excess, peak, borne)

    @property
    def _model(self) -> Model:
        return self.load.with_load.model

    @property
    def _coordinates(self) -> Coordinates:
        return Coordinates.from_model(self.load.robot.model)

    def nearest(self) -> tuple[NearLimit, ...]:
        """Velocity and positions nearest to their limits, by the largest share; coordinates without a limit are left out."""
        names = self._coordinates.velocity_names
        limits = self.limits
        velocity = self.excess["velocity"]
        if not len(names) or not np.isfinite(velocity.time).any():
            return ()
        nearest = []
        has_limit = np.isfinite(limits.velocity)
        if has_limit.any():
            shares = np.abs(velocity.signed) / np.where(has_limit, limits.velocity, 1.0)
            nearest.append(_nearest_limit(names, "velocity", np.where(has_limit, shares, 0.0), velocity.time))
        has_range = np.isfinite(limits.lower) & np.isfinite(limits.upper) & (limits.upper > limits.lower)
        if has_range.any():
            ranges = np.where(has_range, limits.upper - limits.lower, 1.0)
            for excess in (self.excess["lower"], self.excess["upper"]):
                # 1 at the limit and 0 in the middle of the range, where the excess is minus half of the range.
                shares = np.where(has_range, 1.0 + 2.0 * excess.value / ranges, 0.0)
                nearest.append(_nearest_limit(names, "position", shares, excess.time))
        return tuple(sorted(nearest, key=lambda limit: -limit.share))

    def bearings(self) -> tuple[BearingUse, ...]:
        """Largest loads of the bearings that have limits, by joint."""
        uses = []
        for k, name in enumerate(self._coordinates.velocity_names):
            for kind, loads in self.excess.items():
                if kind not in BEARINGS:
                    continue
                limit = float(getattr(self.limits, kind)[k])
                if np.isfinite(limit):
                    uses.append(BearingUse(name, kind, float(loads.signed[k]), limit, float(loads.time[k])))
        return tuple(uses)

    def excesses(self) -> tuple[Excess, ...]:
        """Exceeded limits, worst effort first."""
        excesses = [*self._torque_excesses(), *self._motion_excesses(), *self._follower_excesses()]
        return tuple(sorted(excesses, key=_severity_order))

    def _torque_excesses(self) -> Iterator[Excess]:
        """Exceeded torque limits of the drives."""
        model = self._model
        limits = self.limits.effort
        turns = drive_turns(model)
        for k in np.flatnonzero(self.peak.value - limits > margin(limits)):
            torque, time = float(self.peak.signed[k]), float(self.peak.time[k])
            unit = unit_of("tau", turns[k])
            yield Excess(model.drive_labels[k], "effort", torque, float(limits[k]), time, unit, turns[k])

    def _motion_excesses(self) -> Iterator[Excess]:
        """Exceeded limits of positions, velocities and bearings."""
        coordinates = self._coordinates
        for kind, excess in self.excess.items():
            limits = getattr(self.limits, kind)
            quantity = "dq" if kind == "velocity" else "q"
            tolerance = self.limits.tolerance if kind in ("lower", "upper") else margin(limits)
            for k in np.flatnonzero(excess.value > tolerance):
                angular = bool(coordinates.angular_velocity[k])
                unit = BEARING_UNITS[kind] if kind in BEARING_UNITS else unit_of(quantity, angular)
                value, time = float(excess.signed[k]), float(excess.time[k])
                yield Excess(coordinates.velocity_names[k], kind, value, float(limits[k]), time, unit, angular)

    def _follower_excesses(self) -> Iterator[Excess]:
        """Exceeded torque limits of mimic joints."""
        model = self._model
        for k, body_number in enumerate(model.limited_followers):
            body = model.bodies[body_number]
            torque, time = float(self.borne.signed[k]), float(self.borne.time[k])
            if abs(torque) > body.effort + margin(body.effort):
                angular = bool(body.joint.turning[0])
                unit = unit_of("tau", angular)
                yield Excess(body.joint.name, "effort", torque, body.effort, time, unit, angular)


def _nearest_limit(names: Sequence[str], kind: str, shares: Array, times: Array) -> NearLimit:
    """Coordinate with the largest share of its limit."""
    k = int(shares.argmax())
    return NearLimit(names[k], kind, float(shares[k]), float(times[k]))


def _severity_order(excess: Excess) -> tuple[bool, str, float]:
    """Sort key that puts the worst torque first; limits of zero have share 0."""
    share = abs(excess.value / excess.limit) if excess.limit else 0.0
    return excess.kind != "effort", excess.kind, -share


@dataclass(frozen=True, eq=False)
class MotionFigures:
    """Figures of consecutive rows of a motion; figures of slices are joined to figures of the whole motion."""

    rows: int
    """Number of rows."""
    squares: Array
    """Part (nv,) of the time mean of squared torques due to these rows."""
    whole: Extremes
    """Extremes of all rows."""
    sound: Extremes
    """Extremes outside doubtful spans of time."""
    unloaded_peak: Extrema
    """Largest torques without payloads and wrenches, as recorded."""
    speed: Extrema
    """Largest velocities."""
    at_peaks: MotionSamples
    """States (nv,) at the peak of each torque."""
    envelope: Bins
    """Torques of the drives for a plot."""
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
    """Figures of the motors; None without motors."""
    payload_shares: PayloadShares | None
    """Torques for the largest mass of the payload; None if the mass is not determined."""
    payload_torque: float
    """Largest torque due to the payloads, in some of the states."""
    comparisons: tuple[TorqueComparison, ...]
    """Comparisons of measured with computed torques, with payloads and wrenches and without them, since the log may have been
    recorded either way."""
    is_above_limit: Array
    """(rows, nv) True if a measured torque is above its limit."""

    @classmethod
    def from_parts(cls, parts: Sequence[MotionFigures]) -> MotionFigures:
        """Figures of consecutive rows from the figures of their parts."""
        field_of_each = partial(_field_of_each, parts)
        drives = np.arange(parts[0].whole.peak.value.size)
        part_with_peak = np.argmax([part.whole.peak.value for part in parts], axis=0)
        # states of all drives in the first part, then in the second, and so on
        states_at_peaks = _join_samples(field_of_each("at_peaks"))
        parts_of_comparisons = zip(*field_of_each("comparisons"), strict=True)  # with loads, then without them
        comparisons = [TorqueComparison.from_parts(same_comparison) for same_comparison in parts_of_comparisons]
        q_parts, dq_parts = zip(*field_of_each("edges"), strict=True)
        return cls(
            rows=sum(field_of_each("rows")),
            squares=np.sum(field_of_each("squares"), axis=0),
            whole=Extremes.from_parts(field_of_each("whole")),
            sound=Extremes.from_parts(field_of_each("sound")),
            unloaded_peak=Extrema.merge(field_of_each("unloaded_peak")),
            speed=Extrema.merge(field_of_each("speed")),
            at_peaks=states_at_peaks[part_with_peak * len(drives) + drives],
            envelope=Bins.from_parts(field_of_each("envelope")),
            band=_join_optional(Bins.from_parts, field_of_each("band")),
            runs=_join_optional(Runs.from_parts, field_of_each("runs")),
            edges=(np.concatenate(q_parts), np.concatenate(dq_parts)),
            fastest=np.max(field_of_each("fastest"), axis=0),
            largest=np.max(field_of_each("largest"), axis=0),
            noise=np.max(field_of_each("noise"), axis=0),
            stationary=np.sum(field_of_each("stationary"), axis=0),
            outliers=np.concatenate(field_of_each("outliers")),
            motors=_join_optional(MotorFigures.from_parts, field_of_each("motors")),
            payload_shares=_join_optional(PayloadShares.from_parts, field_of_each("payload_shares")),
            payload_torque=max(field_of_each("payload_torque")),
            comparisons=tuple(comparisons),
            is_above_limit=np.concatenate(field_of_each("is_above_limit")),
        )


def _field_of_each(parts: Sequence[Any], name: str) -> list[Any]:
    """Value of a field in each of the parts."""
    return [getattr(part, name) for part in parts]


def _join_samples(parts: Sequence[MotionSamples]) -> MotionSamples:
    """Samples of consecutive rows."""
    return MotionSamples(*[np.concatenate(_field_of_each(parts, field.name)) for field in fields(MotionSamples)])


def _join_optional(join: Callable[[Sequence[T]], T], parts: Sequence[T | None]) -> T | None:
    """Joined figures; None if the parts have none."""
    present = [part for part in parts if part is not None]
    if not present:
        return None
    return join(present)


def _moved_velocities(model: Model, column: int) -> tuple[slice, float]:
    """Velocities of the joint of a coordinate, and their largest acceleration if the coordinate accelerates by 1."""
    body = next(b for b in model.leaders if b.q_index <= column < b.q_index + b.joint.nq)
    _, velocities = body.places
    if body.joint.quaternion is None:
        return velocities, 1.0
    first_quaternion_column = body.q_index + body.joint.quaternion
    end_of_angular = velocities.start + 3  # angular velocities come first
    if first_quaternion_column <= column < first_quaternion_column + 4:
        return slice(velocities.start, end_of_angular), 2.0  # a small change of a quaternion is half of the angle
    return slice(end_of_angular, velocities.stop), 1.0


@dataclass(frozen=True, eq=False)
class MotionPass:
    """Pass over the rows of a log: the figures of each slice of rows, and of all of them."""

    load: LoadCase
    limits: Limits
    plan: Differentiation
    """Way in which rates are derived from the log."""
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
        """Rows at either end of long gaps in time."""
        return gap_edges(self.time, self._min_gap)

    @property
    def _min_gap(self) -> float:
        """Length [s] above which a time step is a gap."""
        return GAP * self.plan.quality.step

    @cached_property
    def _measured_noise(self) -> Array:
        """Standard deviation (nv,) of the noise of measured torques."""
        return _measured_noise(self.plan)

    @cached_property
    def bootstrap(self) -> PeakBootstrap:
        """Draws for estimated peaks."""
        return PeakBootstrap(self.plan, self.load)

    def figures(self, first_row: int, s: MotionSamples, torques: Array, measured: Array | None) -> MotionFigures:
        """Figures of n rows of the motion, which begin at its row ``first_row``.

        ``torques`` (n, nv) are computed for the drives at the states ``s``; ``measured`` (n, nv) are in the log, if any.
        """
        load = self.load
        row_count = len(self.time)
        rows = slice(first_row, first_row + len(s))
        computed = [torques]  # with payloads and wrenches, and without them
        if load.carries:
            computed.append(load.drive_torques(load.unloaded_torques(s)))
        unloaded = computed[-1]
        borne = np.zeros((len(s), 0))
        if load.with_load.model.limited_followers:
            borne = load.follower_torques(s)
        whole = Extremes.from_states(load, self.limits, s, (s.time, torques, borne))
        doubtful = self.spans.within(s.time)
        is_inside = (self._edges >= rows.start) & (self._edges < rows.stop)
        edges = self._edges[is_inside] - first_row
        stride = max(1, len(s) // _MASS_SAMPLES)
        some_states = s[::stride]
        sigma = np.zeros_like(torques)
        if self.estimating or measured is not None:
            sigma = self._sigma(s)
        band: Bins | None = None
        runs: Runs | None = None
        motors: MotorFigures | None = None
        if self.estimating:
            half_width = INTERVAL * sigma
            band = Bins.from_rows(first_row, s.time, torques - half_width, torques + half_width, row_count)
            runs = Runs.from_rows(first_row, np.abs(torques), self.bootstrap.cell)
        if load.with_load.actuators:
            motors = MotorFigures.from_rows(load.with_load.model, rows, self.time, load.motor_loads(s))
        payload_torque = 0.0
        if load.payloads:
            payload_torque = float(np.abs(load.payload_torques(some_states)).max(initial=0.0))
        return MotionFigures(
            rows=len(s),
            squares=mean_weights(self.time, rows) @ (torques * torques),
            whole=whole,
            sound=self._sound_extremes(whole, s, torques, borne, doubtful),
            unloaded_peak=Extrema.from_rows(s.time, np.abs(unloaded), unloaded),
            speed=Extrema.from_rows(s.time, np.abs(s.dq), s.dq),
            at_peaks=s[first_largest(np.abs(torques))],
            envelope=Bins.from_rows(first_row, s.time, torques, torques, row_count),
            band=band,
            runs=runs,
            edges=(s.q[edges], s.dq[edges]),
            fastest=np.abs([s.dq, s.ddq]).max(axis=1),
            largest=np.abs(s.measured).max(axis=0),
            noise=self._noise(some_states),
            stationary=s.stationary.sum(axis=0),
            outliers=self._outliers(s, torques),
            motors=motors,
            payload_shares=self._payload_shares(s, torques, borne),
            payload_torque=payload_torque,
            **self._comparisons(s.time, computed, measured, sigma, doubtful),
        )

    def _sound_extremes(
        self, whole: Extremes, s: MotionSamples, torques: Array, borne: Array, doubtful: Array
    ) -> Extremes:
        """Extremes without doubtful rows (mask (n,)). If the log has all rates, torques of all rows count."""
        if not self.spans:
            return whole
        torque_rows = ~doubtful
        if self.plan.source == "given":
            torque_rows = np.ones(len(s), bool)
        time_and_torques = s.time[torque_rows], torques[torque_rows], borne[torque_rows]
        return Extremes.from_states(self.load, self.limits, s[~doubtful], time_and_torques)

    def _payload_shares(self, s: MotionSamples, torques: Array, borne: Array) -> PayloadShares | None:
        """Torques and their parts due to the payload, which determine its largest mass; None if they do not."""
        load = self.load
        if not margin_determined(load):
            return None
        due_to_payload = load.drive_torques(load.payload_torques(s))
        if load.with_load.model.limited_followers:
            due_to_payload = np.hstack([due_to_payload, load.follower_payload_torques(s)])
        return payload_shares(load, self.limits.effort, s.time, np.hstack([torques, borne]), due_to_payload)

    def _comparisons(
        self, time: Array, computed: Sequence[Array], measured: Array | None, sigma: Array, doubtful: Array
    ) -> dict[str, Any]:
        """Comparisons of measured with computed torques (n, nv), and mask of measured torques above their limits.

        The keys are the fields of :class:`MotionFigures`.
        """
        if measured is None:
            return {"comparisons": (), "is_above_limit": np.zeros((len(time), 0), bool)}
        tau = self.load.drive_torques(measured)
        comparisons = [TorqueComparison.from_rows(time, torques, tau, sigma, doubtful) for torques in computed]
        is_above_limit = above_limits(tau, self.limits.effort, self._measured_noise)
        return {"comparisons": tuple(comparisons), "is_above_limit": is_above_limit}

    def _sigma(self, s: MotionSamples) -> Array:
        """Standard deviation (n, nv) of the torques M q̈, from the mass matrices M of some of the states."""
        if not self.plan.sigma_ddq.any():
            return np.zeros(s.dq.shape)
        stride = max(1, len(s) // _BAND_SAMPLES)
        M = self.load.mass_matrix(s.q[::stride])
        acceleration_variances = self.plan.sigma_at(s) ** 2
        torque_variances = []
        for k in range(len(M)):
            rows = slice(k * stride, (k + 1) * stride)
            torque_variances.append((M[k] * M[k]) @ acceleration_variances[rows].T)
        return np.sqrt(np.concatenate(torque_variances, axis=1).T)

    def _noise(self, states: MotionSamples) -> Array:
        """Largest standard deviation (nv,) of the torques in some of the states."""
        if not self.plan.sigma_ddq.any():
            return np.zeros(len(self.plan.sigma_ddq))
        M = self.load.mass_matrix(states.q)
        return np.sqrt((M * M) @ (self.plan.sigma_ddq**2)).max(axis=0)

    def _outliers(self, s: MotionSamples, torques: Array) -> Array:
        """Outliers (m, 5): the last column is 1 if a real sample would mean a torque beyond a limit, or without a limit."""
        if not s.outlier.any():
            return np.zeros((0, 5))
        order = 2  # accelerations are this derivative of the smoothed columns
        if self.plan.source == "velocities":
            order = 1
        acceleration_per_residual = pulse_peak(order, self.plan.quality.step)
        rows, columns = np.nonzero(s.outlier[:, :, 0])
        outliers = np.column_stack([columns, s.time[rows], s.outlier[rows, columns], np.zeros(len(rows))])
        for outlier, row in zip(outliers, rows.tolist(), strict=True):
            column, residual = int(outlier[0]), float(outlier[3])
            acceleration = acceleration_per_residual * abs(residual)
            outlier[4] = self._may_exceed_limit(s.q[row], torques[row], column, order, acceleration)
        return outliers

    def _may_exceed_limit(self, q: Array, torques: Array, column: int, order: int, acceleration: float) -> bool:
        """True if an acceleration of a smoothed column changes ``torques`` (nv,) beyond a limit, or where there is no limit."""
        velocities = slice(column, column + 1)
        factor = 1.0
        if order == 2:  # the column is a coordinate, not a velocity
            velocities, factor = _moved_velocities(self.load.robot.model, column)
        M_columns = self.load.mass_matrix(q)[:, velocities]
        change = np.abs(M_columns).sum(axis=1) * factor * acceleration
        effort = np.where(np.isfinite(self.limits.effort), self.limits.effort, 0.0)
        is_within_limit = np.abs(torques) + change <= effort
        is_negligible = change <= ZERO * np.abs(torques).max()
        return not (is_within_limit | is_negligible).all()

    # What follows from the figures of the whole motion

    def gaps(self, found: MotionFigures) -> Gaps:
        """Gaps in time, and the motion that they may hide."""
        velocities_are_rates = all(body.joint.nv == body.joint.nq == 1 for body in self.load.robot.model.leaders)
        stops = None
        if velocities_are_rates:
            stops = self.limits.lower, self.limits.upper
        return Gaps.from_edges(
            self.time, found.edges, found.fastest, self._min_gap, rates=velocities_are_rates, stops=stops
        )

    def terms(self, found: MotionFigures) -> dict[str, Array]:
        """Causes (nv,) of the peak of each torque."""
        terms = self.load.terms(found.at_peaks)
        for name, torques in terms.items():
            # Row k has the torques of all drives at the peak of drive k; only its own torque counts.
            terms[name] = np.diagonal(self.load.drive_torques(torques)).copy()
        return terms

    def around(self, found: MotionFigures, joint: int) -> MotionSamples:
        """States on either side of a joint's peak."""
        robot = self.load.robot
        numbers_per_row = 1 + 2 * robot.nq + 3 * robot.nv
        max_rows = max(1, _MAX_NUMBERS_BESIDE_PEAK // (2 * robot.nv * numbers_per_row))
        rows_on_each_side = min(_MAX_ROWS_BESIDE_PEAK, max_rows)
        peak_row = int(np.searchsorted(self.time, found.whole.peak.time[joint]))
        return self.plan.states_near(peak_row, rows_on_each_side)

    def estimates(self, found: MotionFigures, progress: Callable[[float], None] | None) -> list[PeakEstimate]:
        """Noise-corrected peaks of all joints."""
        assert found.runs is not None
        estimates = []
        terms = self.terms(found)
        run_count = found.runs.run_count
        for k in range(self.load.robot.nv):
            contenders = found.runs.contenders(k)
            steady = float(sum(terms[name][k] for name in STEADY))
            speed = float(found.speed.signed[k])
            estimates.append(self.bootstrap.estimate(k, found.whole.peak, contenders, run_count, steady, speed))
            if progress is not None:
                progress((k + 1) / self.load.robot.nv)
        return estimates

    def measured_torques(self, found: MotionFigures) -> tuple[MeasuredTorque, ...]:
        """Measured torques compared with computed torques, with or without load, whichever agree better; empty without any."""
        if not found.comparisons:
            return ()
        best = min(found.comparisons, key=lambda comparison: comparison.misfit)
        median_step = 0.0
        if found.rows > 1:
            median_step = float(np.median(np.diff(self.time)))
        above = TimeAbove.from_rows(self.time, found.is_above_limit)
        labels = self.load.with_load.model.drive_labels
        return best.torques(labels, self.load.units, self.limits.effort, above, median_step)


# If noise of a log matters, all results come from a second pass over the smoothed log: peaks, causes, limits, motors, files and
# pictures. Results of the unsmoothed log are reported beside them.

_NUMBERS_PER_SLICE = 1 << 19
"""Rows times velocities of a slice: 4 MiB per array."""
_MIN_ROWS_PER_SLICE = 1024
"""Least number of rows of a slice."""
_MAX_EXCERPT_BYTES = 1 << 21
"""Bytes of the excerpts used to plan the analysis of a longer log."""

# Durations of the steps for a log of up to _MAX_EXCERPT_BYTES bytes, relative to one pass.
_PASS_DURATION = 1.0
_PLAN_DURATION = 8.0
_DRAWS_DURATION = 1.0


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
    excerpt_share = min(1.0, _MAX_EXCERPT_BYTES / max(1, differentiation.trajectory.size))
    plan_duration = _PLAN_DURATION * excerpt_share
    draws_duration = _DRAWS_DURATION * excerpt_share
    steps = Steps(progress, (_PASS_DURATION, plan_duration, _PASS_DURATION, draws_duration))
    rows_per_slice = chunk or _rows_per_slice(load)
    passes = _Passes(load, limits, rows_per_slice, steps)
    if differentiation.smooths:
        steps.skip(2)  # the pass over the unsmoothed log, and the plan
        report = passes.report_of_smoothed(differentiation)
    elif not differentiation.sigma_ddq.any():
        report = _report(*passes.run(differentiation))
    else:
        unsmoothed = passes.run(differentiation)
        report = _report(*unsmoothed)
        noise_matters = any(j.noise > MIN_NOISE_SHARE * report.reference(j) for j in report.joints)
        if noise_matters:
            smoothed = differentiation.with_smoothing(steps.next())
            report = passes.report_of_smoothed(smoothed, unsmoothed)
    steps.done()
    return report


@dataclass(frozen=True, eq=False)
class _Passes:
    """Passes over one motion, each a step of the progress."""

    load: LoadCase
    limits: Limits
    rows_per_slice: int
    steps: Steps

    def run(self, plan: Differentiation, *, estimating: bool = False) -> tuple[MotionPass, MotionFigures]:
        """Take one pass; returns the pass and its figures."""
        progress = self.steps.next(len(plan.trajectory.table))
        motion_pass = MotionPass(self.load, self.limits, plan, estimating)
        parts: list[MotionFigures] = []
        first_row = 0
        for states, motion, inner in plan.surrounded_states(self.rows_per_slice, progress):
            s = states[inner]  # without the neighbours of the slice
            torques = self.load.drive_torques(self.load.torques(s))
            _check_finite(torques, s)
            measured = None if motion.tau is None else motion.tau[inner]
            parts.append(motion_pass.figures(first_row, s, torques, measured))
            first_row += len(s)
        return motion_pass, MotionFigures.from_parts(parts)

    def report_of_smoothed(
        self, plan: Differentiation, unsmoothed: tuple[MotionPass, MotionFigures] | None = None
    ) -> TorqueReport:
        """Report of the smoothed motion, beside the results of the ``unsmoothed`` log."""
        motion_pass, figures = self.run(plan, estimating=True)
        estimates = motion_pass.estimates(figures, self.steps.next())
        return _report(motion_pass, figures, unsmoothed, estimates)


def _report(
    run: MotionPass,
    found: MotionFigures,
    unsmoothed: tuple[MotionPass, MotionFigures] | None = None,
    estimates: Sequence[PeakEstimate] | None = None,
) -> TorqueReport:
    """Report of the figures ``found`` by a pass ``run``, with noise-corrected peaks if there are ``estimates``."""
    plan = run.plan
    load = run.load
    outliers = outliers_of(found.outliers)
    joints = _joints(run, found)
    if unsmoothed is not None:
        _, unsmoothed_figures = unsmoothed
        joints = _with_unsmoothed_figures(joints, unsmoothed_figures)
    if estimates is not None:
        for k, estimate in enumerate(estimates):
            joints[k] = replace(joints[k], estimate=estimate)
    worst = worst_joint(joints)
    has_payload_mass = any(payload.mass for payload in load.payloads)
    payload_adds_nothing = found.payload_torque <= ZERO * float(found.whole.peak.value.max(initial=0.0))
    largest_payload = None
    if found.payload_shares is not None:
        largest_payload = payload_margin(load, run.limits.effort, found.payload_shares)
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
        envelope=found.envelope[1:],  # without the numbers of the bins
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
        idle_payload=has_payload_mass and payload_adds_nothing,
        payload_margin=largest_payload,
        derived=None if unsmoothed is None else _unsmoothed_results(*unsmoothed),
    )


def _unsmoothed_results(run: MotionPass, found: MotionFigures) -> AsDerived:
    """Results of the unsmoothed log, for the report of the smoothed log."""
    return AsDerived(run.plan, found.whole.excesses(), found.envelope[1:], _motor_uses(run, found))


def _motor_uses(run: MotionPass, found: MotionFigures) -> tuple[MotorUse, ...]:
    """Use of each motor; empty without motors."""
    if found.motors is None:
        return ()
    return found.motors.uses(run.load.with_load.model)


def _spans_of(plan: Differentiation) -> DoubtfulSpans:
    """Doubtful spans of a log, extended by the rows to which smoothing spreads wrong rows."""
    smoothing_width = float(plan.strengths.max(initial=0.0)) ** (1 / 6)
    extension_rows = SURROUNDINGS + math.ceil(_SMOOTHING_REACH * smoothing_width)
    log = plan.trajectory
    return doubtful_spans(log.instants, plan.quality.step, log.origin, extension_rows)


_SMOOTHING_REACH = 16.0
"""Number of rows to which smoothing spreads more than 1e-3 of a wrong row, in units of strength^(1/6)."""


def _measured_noise(plan: Differentiation) -> Array:
    """Standard deviation (nv,) of the noise of the measured torques; 0 without a column."""
    log = plan.trajectory
    no_noise = np.zeros(plan.model.nv)
    if log.columns.places["tau"] is None:
        return no_noise
    times: list[Array] = []
    torques: list[Array] = []
    for table in excerpts(log.table, _NOISE_EXCERPT_COUNT, _ROWS_PER_NOISE_EXCERPT):
        rows = log.motion(table)
        if rows.tau is not None:
            times.append(rows.time)
            torques.append(rows.tau)
    if not torques:
        return no_noise
    return noise(times, torques)


_NOISE_EXCERPT_COUNT = 8
"""Number of excerpts of a log from which the noise of measured torques is estimated."""
_ROWS_PER_NOISE_EXCERPT = 2048
"""Number of rows of each of these excerpts."""


def _doubts(run: MotionPass, figures: MotionFigures, *, glitches: bool) -> tuple[Doubt, ...]:
    """Doubts about the log, with the doubt about impossible torques first.

    If one of the other doubts refuses the log, torques are not doubted as well.
    """
    log = run.plan.trajectory
    robot = run.load.robot
    doubts_without_dynamics = log.doubts(run.limits, own=robot.limits, glitches=glitches)
    if any(doubt.refuses for doubt in doubts_without_dynamics):
        return doubts_without_dynamics
    corners = tuple(instant for instant in log.instants if instant.cause is not InstantKind.ROWS)
    spans_of_corners = replace(run.spans, instants=corners)
    torque_doubt = impossible_torque(robot, figures.unloaded_peak, log.origin, spans_of_corners)
    if torque_doubt is None:
        return doubts_without_dynamics
    return (torque_doubt, *doubts_without_dynamics)


def _joints(run: MotionPass, found: MotionFigures) -> list[JointTorque]:
    """Figures of each joint."""
    rms = np.sqrt(found.squares)
    units = run.load.units
    terms = run.terms(found)
    peak = found.whole.peak
    joints = []
    for k, name in enumerate(run.load.with_load.model.drive_labels):
        joint = JointTorque(
            joint=name,
            unit=units[k],
            largest=float(peak.signed[k]),
            time=float(peak.time[k]),
            rms=float(rms[k]),
            limit=float(run.limits.effort[k]),
            terms={term: float(torques[k]) for term, torques in terms.items()},
            noise=float(found.noise[k]),
        )
        joints.append(joint)
    return joints


def _with_unsmoothed_figures(joints: Sequence[JointTorque], unsmoothed: MotionFigures) -> list[JointTorque]:
    """Joints with noise, peak and time of the peak of the unsmoothed log as ``noise``, ``raw`` and ``raw_time``."""
    peak = unsmoothed.whole.peak
    joints_with_figures = []
    for k, joint in enumerate(joints):
        raw = float(peak.signed[k])
        raw_time = float(peak.time[k])
        noise_of_joint = float(unsmoothed.noise[k])
        joints_with_figures.append(replace(joint, noise=noise_of_joint, raw=raw, raw_time=raw_time))
    return joints_with_figures


def _check_finite(torques: Array, s: MotionSamples) -> None:
    """Raise TrajectoryError with the time of the first state whose torques are not finite."""
    not_finite = ~np.isfinite(torques).all(axis=1)
    if not_finite.any():
        time = float(s.time[np.argmax(not_finite)])  # first True
        raise TrajectoryError(
            f"the torques at t = {printed(time)} s are not finite numbers. Positions may be absurdly large there, or a "
            "quaternion zero: look at that row."
        )


def _rows_per_slice(load: LoadCase) -> int:
    """Number of rows that are processed at once."""
    velocity_count = max(1, load.robot.nv)
    return max(_MIN_ROWS_PER_SLICE, _NUMBERS_PER_SLICE // velocity_count)


def write_torques(report: TorqueReport, path: str | Path, *, split: bool) -> Path:
    """Write time and torques of a report, their causes if ``split``, and the torques of a noisy log before smoothing."""
    load = report.load
    plan = report.differentiation
    unsmoothed = report.derived
    quantities = ["torque"]
    if split:
        quantities += load.causes
    if unsmoothed is not None:
        quantities.append("torque.derived")
    names = load.with_load.model.drive_names
    header = [f"{name}.{quantity}" for quantity, name in itertools.product(quantities, names)]
    other_columns = further_columns(report.held)
    first_row = 0
    with csv_table(path, ["time", *header, *other_columns]) as table:
        for states, motion, inner in plan.surrounded_states(_rows_per_slice(load)):
            s = states[inner]
            torques = [load.torques(s)]
            if split:
                torques += load.terms(s).values()
            if unsmoothed is not None:
                unsmoothed_states = unsmoothed.differentiation.complete(motion)[inner]
                torques.append(load.torques(unsmoothed_states))
            rows = slice(first_row, first_row + len(s))
            columns = [s.time[:, None]]
            columns += [load.drive_torques(tau) for tau in torques]
            columns += [values[rows, None] for values in other_columns.values()]
            table.numbers(np.concatenate(columns, axis=1))
            first_row += len(s)
    return Path(path)
