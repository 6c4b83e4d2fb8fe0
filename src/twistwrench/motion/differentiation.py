"""Velocities and accelerations of a log by a quintic smoothing spline, with outliers and error estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..core.errors import TrajectoryError
from ..core.estimation.least_squares import MAD
from ..core.estimation.noise import SampleErrors, Survey, sample_errors, survey
from ..core.typing import Array
from ..mechanics.model.model import Model
from .bounds import velocities_inside
from .coordinates import Continuity, Coordinates, joint_rates
from .log_table import excerpts, windows
from .motion_log import LogRows, MotionLog
from .smoothing import FEWEST, alike_samples, best_strength, margin_of, smooth, spline_rates, stretch_edges

SIGNIFICANT_SIGMAS = 5.0
"""Number of standard deviations above which a velocity's sign is significant: at rest, six in ten million are above."""
_SLOPE_ROUND_OFF = 16.0
"""Error of the spline's slope times the time step, in units in the last place of q."""
_MIN_NOISE_SHARE = 0.1
"""Share of a joint's noise below which a column of the joint does not matter."""
_MIN_OUTLIER_SIGMAS = 6.0
"""Number of standard deviations from the smoothed curve beyond which a sample is an outlier."""
_ROWS_OF_GLITCH = 3.0
"""Number of rows on either side that a glitch attracts the curve, in units of strength^(1/6)."""


def stationary_intervals(quality: Survey, model: Model, t: Array, q: Array, dq: Array, sigma_dq: Array) -> Array:
    """True for derived velocities (n, nv) within their uncertainty due to noise and rounding.

    ``sigma_dq`` (nv,): standard deviation of the velocities.
    """
    steps = np.diff(t)
    shorter_step = np.minimum(np.r_[steps[:1], steps], np.r_[steps, steps[-1:]])  # of the two beside each sample
    # A joint with repeated samples is at rest, although the spline may still oscillate. On a grid, where slow joints
    # also repeat samples, noise is the criterion.
    repeats = np.zeros((len(t), q.shape[1]), bool)
    repeats[1:-1] = (q[1:-1] == q[:-2]) & (q[1:-1] == q[2:])
    repeats &= quality.quantum == 0
    is_stationary = np.asarray(np.abs(dq) <= SIGNIFICANT_SIGMAS * sigma_dq)
    for body in model.leaders:
        q_slice, v_slice = body.places
        largest_q = np.abs(q[:, q_slice]).max(axis=1, initial=0.0)
        round_off = _SLOPE_ROUND_OFF * np.finfo(float).eps * largest_q / shorter_step
        is_stationary[:, v_slice] |= np.abs(dq[:, v_slice]) <= round_off[:, None]
        is_stationary[:, v_slice] |= repeats[:, q_slice].all(axis=1, keepdims=True)
    return is_stationary


def ringing(quality: Survey, model: Model, t: Array, curves: Array, dq: Array, factors: Array) -> Array:
    """True for velocities (n, nv) of a spline that rings: they contradict the displacement between neighbouring samples.

    Only steps large enough to appear in the samples count. ``factors`` convert the columns of q to SI units.
    """
    is_ringing = np.zeros(dq.shape, bool)
    if len(t) < 3:
        return is_ringing
    # Entry k of the next arrays belongs to sample k + 1.
    span = t[2:] - t[:-2]
    displacement = curves[2:] - curves[:-2]
    is_beside_pause = np.zeros(len(span), bool)  # samples do not resolve the steps there
    for edge in stretch_edges(t)[1:-1]:  # without the ends of the log
        is_beside_pause[[edge - 2, edge - 1]] = True
    resolution = np.maximum(quality.quantum, SIGNIFICANT_SIGMAS * quality.noise) * factors
    for body in model.leaders:
        if body.joint.nq == 1:
            spline_displacement = dq[1:-1, body.v_index] * span
            is_resolved = (np.abs(spline_displacement) > resolution[body.q_index]) & ~is_beside_pause
            is_opposite = spline_displacement * displacement[:, body.q_index] <= 0
            is_ringing[1:-1, body.v_index] = is_resolved & is_opposite
    return is_ringing


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Consecutive samples of a motion with all inputs of inverse dynamics; (n,), (n, nq), (n, nv), (n, nv)."""

    time: Array
    """Times (n,) [s]."""
    q: Array
    """Differentiated coordinates: smoothed if requested, without jumps of wrapped angles."""
    dq: Array
    """Velocities (n, nv) [rad/s, m/s]."""
    ddq: Array
    """Accelerations (n, nv) [rad/s², m/s²]."""
    measured: Array
    """Coordinates (n, nq) as measured, in SI units, for position limits."""
    stationary: Array
    """(n, nv) True if a velocity is derived and within its uncertainty, so that its sign is not significant."""
    outlier: Array
    """Residuals (n, k, 2) of outliers in standard deviations and SI units; 0 for other samples. (n, 0) without
    smoothing.
    """

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: Any) -> MotionSamples:
        """Select rows by a slice, a mask or indices."""
        selected_arrays = [getattr(self, field.name)[rows] for field in fields(self)]
        return MotionSamples(*selected_arrays)


@dataclass(frozen=True)
class Outlier:
    """Outliers of one column."""

    column: int
    """Index among the smoothed columns."""
    count: int
    """Number of outliers."""
    time: float
    """Time of the largest outlier [s]."""
    sigmas: float
    """Largest signed residual in standard deviations."""
    off: float
    """Largest signed residual in SI units."""
    matters: bool = True
    """True if any outlier may be a torque beyond a limit."""


def outliers_of(outlier_rows: Array) -> tuple[Outlier, ...]:
    """Outliers by column, largest first.

    ``outlier_rows`` (m, 5) has an outlier in each row: column, time, residual in standard deviations and in SI units, and
    1 if it may be a torque beyond a limit.
    """
    outliers = []
    columns, _, all_sigmas, _, may_exceed_limit = outlier_rows.T
    for k in np.unique(columns).tolist():
        is_in_column = columns == k
        rows_of_column = outlier_rows[is_in_column]
        largest_row = np.abs(all_sigmas[is_in_column]).argmax()
        _, time, sigmas, residual, _ = rows_of_column[largest_row].tolist()
        matters = bool(may_exceed_limit[is_in_column].any())
        outliers.append(Outlier(int(k), len(rows_of_column), time, sigmas, residual, matters))
    return tuple(sorted(outliers, key=lambda outlier: -abs(outlier.sigmas)))


def outlier_residuals(residual: Array, deviation: Array, strengths: Array) -> Array:
    """Residuals (n, k, 2) in standard deviations and in SI units; nonzero only for local maxima beyond 6 deviations.

    ``residual`` (n, k) are the residuals of all samples, ``deviation`` (n, k) or (k,) the standard deviation of inliers, and
    ``strengths`` (k,) the strengths of the smoothing.
    """
    from scipy.ndimage import maximum_filter1d

    outliers = np.zeros((*residual.shape, 2))
    for k in np.flatnonzero(deviation.any(axis=0) & (strengths > 0)).tolist():
        sigmas = residual[:, k] / deviation[:, k]
        sizes = np.abs(sigmas)
        if not (sizes > _MIN_OUTLIER_SIGMAS).any():
            continue
        # A glitch attracts the curve, so its neighbours also deviate from the curve, by less than half as much.
        rows_beside = math.ceil(_ROWS_OF_GLITCH * strengths[k] ** (1 / 6))
        largest_nearby = maximum_filter1d(sizes, 2 * rows_beside + 1, mode="nearest")
        is_outlier = (sizes > _MIN_OUTLIER_SIGMAS) & (sizes > 0.5 * largest_nearby)
        outliers[is_outlier, k, 0] = sigmas[is_outlier]
        outliers[is_outlier, k, 1] = residual[is_outlier, k]
    return outliers


def residual_spread(
    times: Sequence[Array], parts: Sequence[Array], strengths: Array, step: float, min_spread: Array
) -> Array:
    """Robust standard deviation (k,) of samples about the smoothed curve, at least ``min_spread``; 0 without smoothing."""
    spread = np.zeros(len(strengths))
    for k in np.flatnonzero(strengths).tolist():
        strength = float(strengths[k])
        residuals = [x[:, k] - smooth(t, x[:, k], strength, step) for t, x in zip(times, parts, strict=True)]
        median = float(np.median(np.abs(np.concatenate(residuals))))
        spread[k] = max(MAD * median, float(min_spread[k]))
    return spread


_SPLINE_MARGIN = 64
"""Number of samples beyond which a sample's influence on a quintic spline is negligible.

The influence falls by a factor of 0.43 per sample, thus to 4e-24 over the margin.
"""
_EXCERPT_COUNT = 8
"""Number of excerpts of a log from which the settings are determined."""
_EXCERPT_ROWS = 2048
"""Number of rows of an excerpt."""
_SHARE_OF_OPTIMUM = 10.0**-0.5
"""Smoothing strength relative to the optimum for positions.

The optimum balances bias and noise, but a smoothed log shows only part of the bias; with less strength the noise
exceeds the bias. Source: Hall, The Bootstrap and Edgeworth Expansion, 1992, section 4.5.
"""


@dataclass(frozen=True, eq=False)
class Differentiation:
    """Differentiation settings of a log, and the uncertainty of the results."""

    trajectory: MotionLog
    model: Model
    quality: Survey
    """Quality of the differentiated columns."""
    source: str
    """Source of accelerations: ``given``, ``velocities`` or ``positions``."""
    derives_velocities: bool
    places: Array
    """Indices (k,) of the differentiated columns."""
    strengths: Array
    """Smoothing strengths (k,) of these columns; 0 without smoothing."""
    continuity: Continuity
    """Continuity of the columns of q."""
    sigma_ddq: Array
    """Standard deviation (nv,) of the accelerations due to the log's noise; 0 for given accelerations."""
    sigma_dq: Array
    """Standard deviation (nv,) of the velocities; 0 for given velocities."""
    spread: Array
    """Standard deviation (k,) of inliers about the smoothed curve in SI units; 0 without smoothing."""
    ends: Array
    """Times at which the log, or a stretch between pauses, begins or ends [s]."""
    errors: SampleErrors
    """Errors of the differentiated columns, in SI units."""

    @classmethod
    def plan(
        cls,
        trajectory: MotionLog,
        model: Model,
        *,
        smoothing: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> Differentiation:
        """Determine the settings from excerpts of the file.

        ``smoothing`` adapts the strength to the estimated noise, slightly below the optimum for positions. ``progress``
        is called with the completed fraction of the work, from 0 to 1.
        """
        columns_by_part = trajectory.columns.places
        source = _source(columns_by_part)
        differentiated_part = "dq" if source == "velocities" else "q"
        derives_velocities = columns_by_part["dq"] is None
        derives = source != "given" or derives_velocities
        columns = columns_by_part[differentiated_part]
        factors = trajectory.columns.factors[differentiated_part]
        if columns is None or not derives:
            columns = np.zeros(0, int)
            factors = np.zeros(0)
        excerpt_tables = excerpts(trajectory.table, _EXCERPT_COUNT, _EXCERPT_ROWS)
        times = [table[:, trajectory.columns.time] for table in excerpt_tables]
        parts = [table[:, columns] for table in excerpt_tables]
        row_count = max(map(len, times))  # all excerpts of a large file have this length
        if derives and row_count < FEWEST:
            raise _too_few_rows(trajectory, row_count, "accelerations" if source != "given" else "velocities")
        coordinates = Coordinates.from_model(model)
        turn = math.tau / trajectory.columns.angle  # in the units of the file
        q_columns = columns_by_part["q"]
        continuity = Continuity.from_parts(coordinates, [table[:, q_columns] for table in excerpt_tables], turn)
        curves = parts
        if differentiated_part == "q" and derives:
            curves = [continuity.curves(x, turn) for x in parts]
        quality = survey(times, parts, curves)
        strengths = np.zeros(len(columns))
        deviation = quality.noise
        if smoothing:
            strengths, deviation = _strengths(times, curves, quality, progress)
        sigma = deviation * factors  # of the columns, in SI units
        sigma_dq = np.zeros(model.nv)
        if derives_velocities:
            sigma_dq = _to_joints(model, sigma * _noise_gains(1, strengths, quality.step))
        sigma_ddq = np.zeros(model.nv)
        if source == "velocities":
            sigma_ddq = sigma * _noise_gains(1, strengths, quality.step)
        elif source == "positions":
            sigma_ddq = _to_joints(model, sigma * _noise_gains(2, strengths, quality.step))
        return cls(
            trajectory=trajectory,
            model=model,
            quality=quality,
            source=source,
            derives_velocities=derives_velocities,
            places=columns,
            strengths=strengths,
            continuity=continuity,
            sigma_ddq=sigma_ddq,
            sigma_dq=sigma_dq,
            spread=residual_spread(times, curves, strengths, quality.step, quality.error) * factors,
            ends=_ends(trajectory.table[:, 0]),
            errors=sample_errors(times, curves, quality).scaled(factors),
        )

    def with_smoothing(self, progress: Callable[[float], None] | None = None) -> Differentiation:
        """Settings for the same file, with smoothing."""
        return Differentiation.plan(self.trajectory, self.model, smoothing=True, progress=progress)

    @property
    def smooths(self) -> bool:
        """True if any column is smoothed."""
        return bool(self.strengths.any())

    @property
    def derives(self) -> bool:
        """True if velocities or accelerations are derived."""
        return self.source != "given" or self.derives_velocities

    def sigma_at(self, samples: MotionSamples) -> Array:
        """Standard deviation (n, nv) of the accelerations in each state: errors of late stamps grow with the speed."""
        derives_from_velocities = self.source == "velocities"
        differentiated_part = "dq" if derives_from_velocities else "q"
        rates = samples.ddq if derives_from_velocities else samples.dq  # of the differentiated columns
        sigma = np.broadcast_to(self.sigma_ddq, samples.dq.shape).copy()
        usual_error = self.quality.error * self.trajectory.columns.factors[differentiated_part]
        for body in self.model.leaders:
            k = body.v_index if derives_from_velocities else body.q_index
            if body.joint.nq == 1 and usual_error[k] > 0:
                stamp_error = self.errors.stamp[k] * rates[:, body.v_index]
                error = np.sqrt(self.errors.at_rest[k] ** 2 + stamp_error**2)
                sigma[:, body.v_index] *= error / usual_error[k]
        return sigma

    def end_gain(self, time: Array) -> Array:
        """Noise (n, nv) of accelerations at times (n,), relative to :attr:`sigma_ddq`, which holds far from the log's ends.

        Beyond an end there are no samples, so the spline's derivatives at an end have up to nine times the noise.
        """
        derivative_order = 1 if self.source == "velocities" else 2
        time_to_end = np.full(len(time), np.inf)
        for end in self.ends.tolist():
            time_to_end = np.minimum(time_to_end, np.abs(time - end))
        rows_to_end = time_to_end / self.quality.step
        column_sigma = self.quality.error * _noise_gains(derivative_order, self.strengths, self.quality.step)
        min_sigma = _MIN_NOISE_SHARE * self._velocity_entries(column_sigma)
        gain = np.ones((len(time), self.model.nv))
        for strength in set(self.strengths.tolist()):
            sigma_of_strength = np.where(self.strengths == strength, column_sigma, 0.0)
            matters = self._velocity_entries(sigma_of_strength) > min_sigma
            gains_near_end = end_gains(derivative_order, strength, rows_to_end)[:, None]
            gain = np.where(matters, np.maximum(gain, gains_near_end), gain)
        return gain

    def _velocity_entries(self, column_sigma: Array) -> Array:
        """Standard deviations (nv,) of ddq from the standard deviations (k,) of derivatives of the differentiated columns."""
        if self.source == "velocities":
            return column_sigma
        return _to_joints(self.model, column_sigma)

    def states(self, core: int, progress: Callable[[int], None] | None = None) -> Iterator[MotionSamples]:
        """Samples of the motion in runs of about ``core`` rows; up to rounding, values do not depend on ``core``."""
        for states, _, inner in self.surrounded_states(core, progress):
            yield states[inner]

    def surrounded_states(
        self, core: int, progress: Callable[[int], None] | None = None
    ) -> Iterator[tuple[MotionSamples, LogRows, slice]]:
        """Samples of overlapping runs of rows, each with its rows of the log and the slice of its new rows.

        The values of the new rows depend on up to :attr:`margin` rows on either side. ``progress`` is called with the
        number of new rows.
        """
        table = self.trajectory.table
        core_rows = max(core, self.margin)
        for rows, inner in windows(len(table), core_rows, self.margin):
            motion = self.trajectory.motion(table[rows])
            yield self._states(motion, rows), motion, inner
            if progress is not None:
                progress(inner.stop - inner.start)

    def states_near(self, row: int, reach: int) -> MotionSamples:
        """Samples of up to ``reach`` rows before a row of the log, of the row itself, and of those after it."""
        row_count = len(self.trajectory.table)
        begin = max(0, row - reach)
        end = min(row + reach, row_count)
        rows = slice(max(0, begin - self.margin), min(end + self.margin, row_count))
        motion = self.trajectory.motion(self.trajectory.table[rows])
        states = self._states(motion, rows)
        return states[begin - rows.start : end - rows.start]

    def _states(self, motion: LogRows, rows: slice) -> MotionSamples:
        """Samples of some rows of the log; zeros of given velocities at its ends are replaced by neighbouring velocities."""
        states = self.complete(motion)
        if self.derives:
            return states
        is_first_run = rows.start == 0
        is_last_run = rows.stop >= len(self.trajectory.table)
        begin = motion.time[0] if is_first_run else -math.inf
        end = motion.time[-1] if is_last_run else math.inf
        return replace(states, dq=velocities_inside(states.time, states.dq, states.ddq, begin, end))

    @property
    def margin(self) -> int:
        """Number of rows on either side that affect a row's derived values."""
        if not self.derives:
            return 0
        smoothing_margins = [margin_of(strength) for strength in self.strengths if strength]
        return _SPLINE_MARGIN + max(smoothing_margins, default=0)

    def complete(self, motion: LogRows) -> MotionSamples:
        """Consecutive rows, with missing rates derived."""
        t, q, dq, ddq = motion.time, motion.q, motion.dq, motion.ddq
        is_stationary = np.zeros((len(t), self.model.nv), bool)
        outliers = np.zeros((len(t), 0))
        if dq is None:
            curves = self.continuity.curves(q)
            q = self.smooth(t, curves)
            dq_dt, d2q_dt2 = spline_rates(t, q)
            outliers = self._outliers(curves - q, dq_dt)
            dq, derived_ddq = joint_rates(self.model, q, dq_dt, d2q_dt2)
            if ddq is None:
                ddq = derived_ddq
            is_stationary = stationary_intervals(self.quality, self.model, t, motion.q, dq, self.sigma_dq)
            is_stationary |= ringing(self.quality, self.model, t, curves, dq, self.trajectory.columns.factors["q"])
        elif ddq is None:
            logged_dq = dq
            dq = self.smooth(t, logged_dq)
            ddq, _ = spline_rates(t, dq)
            outliers = self._outliers(logged_dq - dq, ddq)
        return MotionSamples(t, q, dq, ddq, motion.q, is_stationary, outliers)

    def curves(self, motion: LogRows) -> Array:
        """Differentiated columns (n, k), without the jumps of wrapped angles."""
        return self.continuity.curves(motion.q) if motion.dq is None else motion.dq

    def _outliers(self, residual: Array, rates: Array) -> Array:
        """Residuals (n, k, 2) of outliers, by the residuals and the rates of the columns; (n, 0) without smoothing."""
        if not self.strengths.any():
            return residual[:, :0]
        deviation = np.maximum(self.spread, self.errors.deviation(rates))
        return outlier_residuals(residual, deviation, self.strengths)

    def smooth(self, t: Array, x: Array) -> Array:
        """Smooth each column (n, k) by its strength, or (n, k, ...) for several logs with common times."""
        if not len(self.strengths):
            return x
        columns = []
        for k, strength in enumerate(self.strengths.tolist()):
            columns.append(smooth(t, x[:, k], strength, self.quality.step))
        return np.stack(columns, axis=1)


def _source(places: Mapping[str, Array | None]) -> str:
    """Source of accelerations, by the columns of a log."""
    if places["ddq"] is not None:
        return "given"
    return "positions" if places["dq"] is None else "velocities"


def _strengths(
    times: Sequence[Array], curves: Sequence[Array], quality: Survey, progress: Callable[[float], None] | None
) -> tuple[Array, Array]:
    """Smoothing strengths (k,) of the columns, and the standard deviations (k,) of the errors that are smoothed.

    Differentiation amplifies fast errors. Smoothing passes slow errors, so it needs the standard deviation of all errors.
    """
    strengths = np.zeros(len(quality.noise))
    deviation = quality.error
    for k, (grid, error) in enumerate(zip(quality.quantum.tolist(), quality.error.tolist(), strict=True)):
        parts = [x[:, k] for x in curves]
        strengths[k] = _SHARE_OF_OPTIMUM * best_strength(times, parts, error, quality.step, grid)
        if strengths[k] > 0:
            # Smoothing passes low frequencies. Rounding errors that are equal for m consecutive samples have m times the
            # power there.
            deviation[k] *= math.sqrt(alike_samples(parts, grid, error))
        if progress is not None:
            progress((k + 1) / len(strengths))
    return strengths, deviation


def _noise_gains(order: int, strengths: Array, step: float) -> Array:
    """Noise gains (k,) of derivatives at smoothing strengths (k,); they are computed once for equal strengths."""
    gain_by_strength: dict[float, float] = {}
    for strength in set(strengths.tolist()):
        gain_by_strength[strength] = noise_gain(order, strength, step)
    return np.array([gain_by_strength[strength] for strength in strengths.tolist()])


def _ends(time: Array) -> Array:
    """First and last times of the stretches between pauses."""
    edges = np.array(stretch_edges(time))
    return np.sort(np.r_[time[edges[:-1]], time[edges[1:] - 1]])


def _too_few_rows(trajectory: MotionLog, row_count: int, rates: str) -> TrajectoryError:
    """Error for a log of a few rows, from which ``rates`` cannot be derived: "velocities" or "accelerations"."""
    subject = "1 row is" if row_count == 1 else f"{row_count} rows are"
    return TrajectoryError(
        f"{trajectory.path}: {subject} too few to derive {rates} from. "
        f"Give at least {FEWEST} rows, or '.vel' and '.acc' columns for every joint. A motion between a few poses is made by "
        "twistwrench move, or tw.trajectories.move."
    )


def noise_gain(order: int, strength: float, step: float) -> float:
    """Standard deviation of the spline's first or second derivative for white noise of 1: norm of the pulse response."""
    middle = _SPLINE_MARGIN
    if strength:
        middle += margin_of(strength)
    t = np.arange(2 * middle + 1) * step
    pulse = np.zeros(len(t))
    pulse[middle] = 1.0
    smoothed_pulse = smooth(t, pulse, strength, step)
    responses = spline_rates(t, smoothed_pulse[:, None])  # first and second derivative
    response = responses[order - 1]
    return float(np.linalg.norm(response))


_MAX_END_STRENGTH = 1e4
"""Smoothing strength above which the noise near an end depends only on the distance in units of strength^(1/6)."""
_END_ROWS = 200
"""Number of rows of a log from which the noise near an end is computed; a tenth of them is near the end."""


def end_gains(order: int, strength: float, rows: Array) -> Array:
    """Noise gain (n,) of the spline's derivative at ``rows`` (n,) from an end, relative to the gain far from it.

    >>> end_gains(2, 0.0, np.array([0.0, 1.0, 50.0])).round(2).tolist()
    [8.75, 0.69, 1.0]
    """
    stretch = 1.0
    if strength > _MAX_END_STRENGTH:
        stretch = (strength / _MAX_END_STRENGTH) ** (1 / 6)
    gains = _gains_of_rows(order, min(strength, _MAX_END_STRENGTH))
    return np.interp(rows / stretch, np.arange(len(gains)), gains)


@lru_cache(64)
def _gains_of_rows(order: int, strength: float) -> Array:
    """Relative noise gains of the first rows of a log, to its middle: norms of their responses to pulses in all rows."""
    t = np.arange(float(_END_ROWS))
    smoothed_pulses = smooth(t, np.eye(_END_ROWS), strength, 1.0)
    responses = spline_rates(t, smoothed_pulses)  # first and second derivatives
    gains = np.linalg.norm(responses[order - 1], axis=1)
    middle = _END_ROWS // 2
    return gains[:middle] / gains[middle]


def pulse_peak(order: int, step: float) -> float:
    """Largest derivative of this ``order`` for a unit error of one sample, at the end of a log or within it."""
    t = np.arange(2 * _SPLINE_MARGIN) * step
    pulses = np.zeros((len(t), 2))
    pulses[0, 0] = 1.0  # at the end
    pulses[_SPLINE_MARGIN, 1] = 1.0  # within the log
    responses = spline_rates(t, pulses)  # first and second derivatives
    return float(np.abs(responses[order - 1]).max())


def _to_joints(model: Model, spread: Array) -> Array:
    """Convert standard deviations of second derivatives of q (nq,) to those of ddq (nv,)."""
    joint_spread = np.zeros(model.nv)
    for body in model.leaders:
        q_slice, v_slice = body.places
        joint_spread[v_slice] = body.joint.spread(spread[q_slice])
    return joint_spread
