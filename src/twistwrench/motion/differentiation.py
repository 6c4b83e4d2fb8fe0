"""Velocities and accelerations of a log by a quintic smoothing spline, with outliers and error estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
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
"""Standard deviations above which a velocity's sign is significant: false positives at rest are six in ten million."""
_ROUND_OFFS = 16.0
"""Error of the spline's slope times the time step, in units in the last place of q."""
_MIN_OUTLIER_SIGMAS = 6.0
"""Standard deviations about the smoothed curve from which a sample is an outlier."""


def stationary_intervals(quality: Survey, model: Model, t: Array, q: Array, dq: Array, sigma_dq: Array) -> Array:
    """Mask (n, nv) of derived velocities within their uncertainty due to noise and rounding."""
    steps = np.diff(t)
    step = np.minimum(np.r_[steps[:1], steps], np.r_[steps, steps[-1:]])
    # A joint with repeated samples is at rest, although the spline may still oscillate. On a grid, where slow joints
    # also repeat samples, noise is the criterion.
    repeats = np.zeros((len(t), q.shape[1]), bool)
    repeats[1:-1] = (q[1:-1] == q[:-2]) & (q[1:-1] == q[2:])
    repeats &= quality.quantum == 0
    stationary = np.asarray(np.abs(dq) <= SIGNIFICANT_SIGMAS * sigma_dq)
    for body in model.leaders:
        q_slice, v_slice = body.places
        round_off = _ROUND_OFFS * np.finfo(float).eps * np.abs(q[:, q_slice]).max(axis=1, initial=0.0) / step
        stationary[:, v_slice] |= np.abs(dq[:, v_slice]) <= round_off[:, None]
        stationary[:, v_slice] |= repeats[:, q_slice].all(axis=1, keepdims=True)
    return stationary


def ringing(quality: Survey, model: Model, t: Array, curves: Array, dq: Array, factors: Array) -> Array:
    """Mask (n, nv) of ringing: the spline's velocity contradicts the displacement between the neighbouring samples.

    Only steps large enough to appear in the samples count. ``factors`` convert the columns of q to SI units.
    """
    is_ringing = np.zeros(dq.shape, bool)
    if len(t) < 3:
        return is_ringing
    span, moved = t[2:] - t[:-2], curves[2:] - curves[:-2]
    beside_pause = np.zeros(len(span), bool)  # samples do not resolve the steps there
    for edge in stretch_edges(t)[1:-1]:
        beside_pause[[edge - 2, edge - 1]] = True
    resolution = np.maximum(quality.quantum, SIGNIFICANT_SIGMAS * quality.noise) * factors
    for b in model.leaders:
        if b.joint.nq == 1:
            step = dq[1:-1, b.v_index] * span
            is_resolved = (np.abs(step) > resolution[b.q_index]) & ~beside_pause
            is_ringing[1:-1, b.v_index] = is_resolved & (step * moved[:, b.q_index] <= 0)
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
    """Coordinates (n, nq) of the file in SI units, for position limits."""
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
        return MotionSamples(*(getattr(self, f.name)[rows] for f in fields(self)))


@dataclass(frozen=True)
class Outlier:
    """Outliers of one column."""

    column: int
    """Index among the smoothed columns."""
    count: int
    time: float
    """Time of the largest outlier [s]."""
    sigmas: float
    """Largest signed residual in standard deviations."""
    off: float
    """Largest signed residual in SI units."""
    matters: bool = True
    """True if any outlier may be a torque beyond a limit."""


def outliers_of(found: Array) -> tuple[Outlier, ...]:
    """Outliers by column, largest first.

    ``found`` (m, 5) has an outlier in each row: column, time, residual in standard deviations and in SI units, and 1 if it
    may be a torque beyond a limit.
    """
    outliers = []
    for k in np.unique(found[:, 0]).tolist():
        rows = found[found[:, 0] == k]
        _, time, sigmas, residual, _ = rows[np.abs(rows[:, 2]).argmax()].tolist()
        outliers.append(Outlier(int(k), len(rows), time, sigmas, residual, bool(rows[:, 4].any())))
    return tuple(sorted(outliers, key=lambda outlier: -abs(outlier.sigmas)))


def outlier_residuals(residual: Array, spread: Array, strengths: Array) -> Array:
    """Residuals (n, k, 2) over their spread, and in SI units; nonzero only for local maxima beyond 6 deviations."""
    from scipy.ndimage import maximum_filter1d

    outliers = np.zeros((*residual.shape, 2))
    for k in np.flatnonzero(spread.any(axis=0) & (strengths > 0)).tolist():
        sigmas = residual[:, k] / spread[:, k]
        size = np.abs(sigmas)
        if not (size > _MIN_OUTLIER_SIGMAS).any():
            continue
        # A glitch attracts the curve, so its neighbours also deviate from the curve, by less than half as much.
        reach = 2 * math.ceil(3.0 * strengths[k] ** (1 / 6)) + 1
        is_outlier = (size > _MIN_OUTLIER_SIGMAS) & (size > 0.5 * maximum_filter1d(size, reach, mode="nearest"))
        outliers[is_outlier, k, 0] = sigmas[is_outlier]
        outliers[is_outlier, k, 1] = residual[is_outlier, k]
    return outliers


def residual_spread(
    times: Sequence[Array], parts: Sequence[Array], strengths: Array, step: float, least: Array
) -> Array:
    """Robust standard deviation (k,) of samples about the smoothed curve, at least ``least``; 0 without smoothing."""
    spread = np.zeros(len(strengths))
    for k in np.flatnonzero(strengths).tolist():
        strength = float(strengths[k])
        residuals = [x[:, k] - smooth(t, x[:, k], strength, step) for t, x in zip(times, parts, strict=True)]
        spread[k] = max(MAD * float(np.median(np.abs(np.concatenate(residuals)))), float(least[k]))
    return spread


_SPLINE_MARGIN = 64
"""Number of samples. A sample's influence on a quintic spline falls by 0.43 per sample: by 4e-24 over the margin."""
_EXCERPTS, _EXCERPT_ROWS = 8, 2048
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
        places_of = trajectory.columns.places
        source = _source(places_of)
        differentiated = "dq" if source == "velocities" else "q"
        derives_velocities = places_of["dq"] is None
        derives = source != "given" or derives_velocities
        places, factors = places_of[differentiated], trajectory.columns.factors[differentiated]
        if places is None or not derives:
            places, factors = np.zeros(0, int), np.zeros(0)

        runs = excerpts(trajectory.table, _EXCERPTS, _EXCERPT_ROWS)
        times = [table[:, trajectory.columns.time] for table in runs]
        parts = curves = [table[:, places] for table in runs]
        longest = max(map(len, times))  # runs of a large file have this length
        if derives and longest < FEWEST:
            raise _too_few_rows(trajectory, longest, "accelerations" if source != "given" else "velocities")
        coordinates, turn = Coordinates.from_model(model), math.tau / trajectory.columns.angle
        q_places = places_of["q"]
        continuity = Continuity.from_parts(coordinates, [table[:, q_places] for table in runs], turn)
        if differentiated == "q" and derives:
            curves = [continuity.curves(x, turn) for x in parts]
        quality = survey(times, parts, curves)
        strengths, deviation = np.zeros(len(places)), quality.noise
        if smoothing:
            strengths, deviation = _strengths(times, curves, quality, progress)

        def sigma(order: int) -> Array:
            gains = {strength: noise_gain(order, strength, quality.step) for strength in set(strengths.tolist())}
            return np.asarray(deviation * factors * np.array([gains[strength] for strength in strengths.tolist()]))

        sigma_dq, sigma_ddq = np.zeros(model.nv), np.zeros(model.nv)
        if derives_velocities:
            sigma_dq = _to_joints(model, sigma(1))
        if source == "velocities":
            sigma_ddq = sigma(1)
        elif source == "positions":
            sigma_ddq = _to_joints(model, sigma(2))
        return cls(
            trajectory=trajectory,
            model=model,
            quality=quality,
            source=source,
            derives_velocities=derives_velocities,
            places=places,
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

    def sigma_at(self, s: MotionSamples) -> Array:
        """Standard deviation (n, nv) as :attr:`sigma_ddq`, by state: errors of late stamps grow with the speed."""
        of_velocities = self.source == "velocities"
        speeds = s.ddq if of_velocities else s.dq
        sigma = np.broadcast_to(self.sigma_ddq, s.dq.shape).copy()
        usual_error = self.quality.error * self.trajectory.columns.factors["dq" if of_velocities else "q"]
        for b in self.model.leaders:
            k = b.v_index if of_velocities else b.q_index
            if b.joint.nq == 1 and usual_error[k] > 0:
                stamp_error = self.errors.stamp[k] * speeds[:, b.v_index]
                sigma[:, b.v_index] *= np.sqrt(self.errors.at_rest[k] ** 2 + stamp_error**2) / usual_error[k]
        return sigma

    def states(self, core: int, progress: Callable[[int], None] | None = None) -> Iterator[MotionSamples]:
        """Samples of the motion in runs of about ``core`` rows; up to rounding, values do not depend on ``core``."""
        for states, _, inner in self.surrounded_states(core, progress):
            yield states[inner]

    def surrounded_states(
        self, core: int, progress: Callable[[int], None] | None = None
    ) -> Iterator[tuple[MotionSamples, LogRows, slice]]:
        """Samples in overlapping runs, the rows of the log there, and the slice of new rows in each run.

        The values of the new rows depend on up to :attr:`margin` rows on either side. ``progress`` is called with the
        number of new rows.
        """
        table = self.trajectory.table
        for rows, inner in windows(len(table), max(core, self.margin), self.margin):
            motion = self.trajectory.motion(table[rows])
            yield self._states(motion, rows), motion, inner
            if progress is not None:
                progress(inner.stop - inner.start)

    def states_near(self, row: int, reach: int) -> MotionSamples:
        """Samples of up to ``reach`` rows before a row of the log, of the row itself, and of those after it."""
        count = len(self.trajectory.table)
        first, last = max(0, row - reach), min(row + reach, count)
        rows = slice(max(0, first - self.margin), min(last + self.margin, count))
        states = self._states(self.trajectory.motion(self.trajectory.table[rows]), rows)
        return states[first - rows.start : last - rows.start]

    def _states(self, motion: LogRows, rows: slice) -> MotionSamples:
        """Samples of some rows of the log; given velocities are never zero at its ends."""
        states, count = self.complete(motion), len(self.trajectory.table)
        if self.source != "given" or self.derives_velocities:
            return states
        begin, end = -math.inf, math.inf
        if rows.start == 0:
            begin = motion.time[0]
        if rows.stop >= count:
            end = motion.time[-1]
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
        stationary = np.zeros((len(t), self.model.nv), bool)
        outlier = np.zeros((len(t), 0))
        if dq is None:
            curves = self.continuity.curves(q)
            q = self.smooth(t, curves)
            speed, second = spline_rates(t, q)
            outlier = self._outliers(curves - q, speed)
            dq, derived_ddq = joint_rates(self.model, q, speed, second)
            if ddq is None:
                ddq = derived_ddq
            stationary = stationary_intervals(self.quality, self.model, t, motion.q, dq, self.sigma_dq)
            stationary |= ringing(self.quality, self.model, t, curves, dq, self.trajectory.columns.factors["q"])
        elif ddq is None:
            logged, dq = dq, self.smooth(t, dq)
            ddq, _ = spline_rates(t, dq)
            outlier = self._outliers(logged - dq, ddq)
        return MotionSamples(t, q, dq, ddq, motion.q, stationary, outlier)

    def curves(self, motion: LogRows) -> Array:
        """Differentiated columns (n, k), without the jumps of wrapped angles."""
        return self.continuity.curves(motion.q) if motion.dq is None else motion.dq

    def _outliers(self, residual: Array, speed: Array) -> Array:
        if not self.strengths.any():
            return residual[:, :0]
        return outlier_residuals(residual, np.maximum(self.spread, self.errors.deviation(speed)), self.strengths)

    def smooth(self, t: Array, x: Array) -> Array:
        """Smooth each column (n, k) by its strength, or (n, k, ...) for several logs with common times."""
        if not len(self.strengths):
            return x
        columns = [smooth(t, x[:, k], float(s), self.quality.step) for k, s in enumerate(self.strengths)]
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

    Differentiation amplifies fast errors. Smoothing passes slow ones, so it needs the standard deviation of all errors.
    """
    strengths, deviation = np.zeros(len(quality.noise)), quality.error
    for k, (grid, error) in enumerate(zip(quality.quantum.tolist(), quality.error.tolist(), strict=True)):
        parts = [x[:, k] for x in curves]
        strengths[k] = _SHARE_OF_OPTIMUM * best_strength(times, parts, error, quality.step, grid)
        if strengths[k] > 0:
            # Rounding errors equal for m consecutive samples have m times the power at low frequencies, which smoothing
            # passes.
            deviation[k] *= math.sqrt(alike_samples(parts, grid, error))
        if progress is not None:
            progress((k + 1) / len(strengths))
    return strengths, deviation


def _ends(time: Array) -> Array:
    edges = np.array(stretch_edges(time))
    return np.sort(np.r_[time[edges[:-1]], time[edges[1:] - 1]])


def _too_few_rows(trajectory: MotionLog, rows: int, wanted: str) -> TrajectoryError:
    count = "1 row is" if rows == 1 else f"{rows} rows are"
    return TrajectoryError(
        f"{trajectory.path}: {count} too few to derive {wanted} from. "
        f"Give at least {FEWEST} rows, or '.vel' and '.acc' columns for every joint. A motion between a few poses is made by "
        "twistwrench move, or tw.trajectories.move."
    )


def noise_gain(order: int, strength: float, step: float) -> float:
    """Standard deviation of the spline's derivative of this order for white unit noise: norm of the pulse response."""
    half = _SPLINE_MARGIN
    if strength:
        half += margin_of(strength)
    t = np.arange(2 * half + 1) * step
    pulse = np.zeros(len(t))
    pulse[half] = 1.0
    response = spline_rates(t, smooth(t, pulse, strength, step)[:, None])[order - 1]
    return float(np.linalg.norm(response))


def pulse_peak(order: int, step: float) -> float:
    """Largest derivative of this ``order`` for a unit error of one sample, at the end of a log or within it."""
    t = np.arange(2 * _SPLINE_MARGIN) * step
    pulses = np.zeros((len(t), 2))
    pulses[0, 0] = pulses[_SPLINE_MARGIN, 1] = 1.0
    return float(np.abs(spline_rates(t, pulses)[order - 1]).max())


def _to_joints(model: Model, spread: Array) -> Array:
    """Convert standard deviations of second derivatives of q (nq,) to those of ddq (nv,)."""
    joint_spread = np.zeros(model.nv)
    for body in model.leaders:
        q_slice, v_slice = body.places
        joint_spread[v_slice] = body.joint.spread(spread[q_slice])
    return joint_spread
