"""Velocities and accelerations of a log that has none: a quintic spline through its samples, smoothed if asked."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import TrajectoryError
from ..model.model import Model
from ..typing import Array
from .complete_states import States
from .continuity import Continuity
from .coordinates import Coordinates, joint_rates
from .log_noise import Survey, survey
from .log_outliers import residual_spread, strays
from .motion_log import LogRows, MotionLog
from .row_windows import windows
from .sampling import SampleErrors, sample_errors
from .smoothing import alike_samples, best_strength, margin_of, smooth
from .spline import FEWEST, spline_rates
from .standing import ringing, standing

_SPLINE_MARGIN = 64
"""Samples. The pull of a sample on a quintic spline falls by 0.43 a sample: by 4e-24 over the margin."""
_EXCERPTS, _EXCERPT_ROWS = 8, 2048
_UNDERSMOOTHED = 10.0**-0.5
"""Share of the strength that is best for positions which a log is smoothed with. The best balances the smoothing's bias
against noise, and of the bias a smoothed log shows only part; with less strength the noise outweighs it. Source: Hall,
The Bootstrap and Edgeworth Expansion, 1992, section 4.5."""


@dataclass(frozen=True, eq=False)
class Differentiation:
    """How the states of a motion file come about, and how uncertain that makes them."""

    trajectory: MotionLog
    model: Model
    quality: Survey
    """Of the columns that are differentiated."""
    source: str
    """What accelerations come from: ``given``, ``velocities`` or ``positions``."""
    derives_velocities: bool
    places: Array
    """(k,) the columns that are differentiated."""
    strengths: Array
    """(k,) smoothing strengths of those; 0 for none."""
    continuity: Continuity
    """What makes curves of the columns of q."""
    sigma_ddq: Array
    """(nv,) standard deviation of the accelerations that follows from the noise of the log; 0 where they are given."""
    sigma_dq: Array
    """(nv,) that of the velocities; 0 where they are given."""
    spread: Array
    """(k,) standard deviation of the samples about the smoothed curve, in SI units, strays aside; 0 for none."""
    errors: SampleErrors
    """Those of the columns that are differentiated, in SI units."""

    @classmethod
    def plan(
        cls,
        trajectory: MotionLog,
        model: Model,
        *,
        smoothing: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> Differentiation:
        """Look at excerpts of the file and decide.

        ``smoothing`` fits its strength to the noise found, a little less than is best for positions. ``progress`` is told the
        share of the work that is done, from 0 to 1.
        """
        has = trajectory.columns.places
        source = "given" if has["ddq"] is not None else "velocities" if has["dq"] is not None else "positions"
        differentiated = "dq" if source == "velocities" else "q"
        derives_velocities = has["dq"] is None
        derives = source != "given" or derives_velocities
        places = has[differentiated] if derives else None
        places = np.zeros(0, int) if places is None else places

        excerpts = trajectory.excerpts(_EXCERPTS, _EXCERPT_ROWS)
        times = [table[:, trajectory.columns.time] for table in excerpts]
        parts = curves = [table[:, places] for table in excerpts]
        longest = max(map(len, times))  # runs of a large file have so many rows of different times
        if derives and longest < FEWEST:
            raise _too_few(trajectory, longest, "accelerations" if source != "given" else "velocities")
        coordinates, turn = Coordinates.of(model), math.tau / trajectory.columns.angle
        where = has["q"]
        continuity = Continuity.of(coordinates, [table[:, where] for table in excerpts], turn)
        if differentiated == "q" and derives:
            curves = [continuity.curves(x, turn) for x in parts]
        quality = survey(times, parts, curves)
        strengths = np.zeros(len(places))
        # Differentiating brings out the noise; smoothing leaves what is slow, and so has to know the whole error.
        deviation = quality.error if smoothing else quality.noise
        if smoothing:
            for k, error in enumerate(deviation.tolist()):
                strengths[k] = _UNDERSMOOTHED * best_strength(
                    times, [x[:, k] for x in curves], error, quality.step, float(quality.quantum[k])
                )
                if progress is not None:
                    progress((k + 1) / len(strengths))
            # Rounding errors that are alike m times in a row have m times the power at low frequencies, where it passes.
            alike = [
                alike_samples([x[:, k] for x in curves], float(g), float(e))
                for k, (g, e) in enumerate(zip(quality.quantum, deviation, strict=True))
            ]
            deviation = deviation * np.where(strengths > 0, np.sqrt(alike), 1.0)
        factors = trajectory.columns.factors[differentiated]

        def sigma(order: int) -> Array:
            gain = {s: noise_gain(order, s, quality.step) for s in set(strengths.tolist())}
            return np.asarray(deviation * factors * np.array([gain[s] for s in strengths.tolist()]))

        none = np.zeros(model.nv)
        return cls(
            trajectory=trajectory,
            model=model,
            quality=quality,
            source=source,
            derives_velocities=derives_velocities,
            places=places,
            strengths=strengths,
            continuity=continuity,
            sigma_ddq=none
            if source == "given"
            else sigma(1)
            if source == "velocities"
            else _to_joints(model, sigma(2)),
            sigma_dq=_to_joints(model, sigma(1)) if derives_velocities else none,
            spread=residual_spread(times, curves, strengths, quality.step, quality.error)
            * (factors if derives else 1.0),
            errors=sample_errors(times, curves, quality).scaled(factors if derives else np.zeros(0)),
        )

    def smoothed(self, progress: Callable[[float], None] | None = None) -> Differentiation:
        """The same of the same file, smoothed."""
        return Differentiation.plan(self.trajectory, self.model, smoothing=True, progress=progress)

    @property
    def smooths(self) -> bool:
        """Whether some column is smoothed."""
        return bool(self.strengths.any())

    @property
    def derives(self) -> bool:
        """Whether anything is derived at all."""
        return self.source != "given" or self.derives_velocities

    def sigma_at(self, s: States) -> Array:
        """As :attr:`sigma_ddq`, (n, nv), in each of the states: late stamps matter the more the faster a joint moves."""
        of_velocities = self.source == "velocities"
        speeds = s.ddq if of_velocities else s.dq
        found = np.broadcast_to(self.sigma_ddq, s.dq.shape).copy()
        usual = self.quality.error * self.trajectory.columns.factors["dq" if of_velocities else "q"]
        for b in self.model.leaders:
            k = b.v_index if of_velocities else b.q_index
            if b.joint.nq == 1 and usual[k] > 0:
                late = self.errors.stamp[k] * speeds[:, b.v_index]
                found[:, b.v_index] *= np.sqrt(self.errors.at_rest[k] ** 2 + late**2) / usual[k]
        return found

    def states(self, core: int, progress: Callable[[int], None] | None = None) -> Iterator[States]:
        """The motion in runs of about ``core`` rows; the same values whatever ``core``, to round-off."""
        for states, _, inner in self.surrounded_states(core, progress):
            yield states.at(inner)

    def surrounded_states(
        self, core: int, progress: Callable[[int], None] | None = None
    ) -> Iterator[tuple[States, LogRows, slice]]:
        """The motion in overlapping runs, what the file says there, and the slice that is new in each.

        Around that slice are :attr:`margin` rows more, or as many as there are: all that its values depend on.
        """
        for rows, inner in windows(self.trajectory.tables(progress), max(core, self.margin), self.margin):
            motion = self.trajectory.motion(rows)
            yield self.complete(motion), motion, inner

    @property
    def margin(self) -> int:
        """Rows on either side that a row's derived values depend on."""
        return (
            max([_SPLINE_MARGIN, *(margin_of(s) + _SPLINE_MARGIN for s in self.strengths if s)]) if self.derives else 0
        )

    def complete(self, motion: LogRows) -> States:
        """Consecutive rows with what the file does not give."""
        t, q, dq, ddq = motion.time, motion.q, motion.dq, motion.ddq
        still = np.zeros((len(t), self.model.nv), bool)
        stray = np.zeros((len(t), 0))
        if dq is None:
            curves = self.continuity.curves(q)
            q = self.smooth(t, curves)
            speed, second = spline_rates(t, q)
            stray = self._strays(curves - q, speed)
            dq, derived = joint_rates(self.model, q, speed, second)
            ddq = derived if ddq is None else ddq
            still = standing(self.quality, self.model, t, motion.q, dq, self.sigma_dq) | ringing(
                self.quality, self.model, t, curves, dq, self.trajectory.columns.factors["q"]
            )
        elif ddq is None:
            logged, dq = dq, self.smooth(t, dq)
            ddq, _ = spline_rates(t, dq)
            stray = self._strays(logged - dq, ddq)
        return States(t, q, dq, ddq, motion.q, still, stray)

    def curves(self, motion: LogRows) -> Array:
        """(n, k) the columns that are differentiated, without the jumps of wrapped angles."""
        return self.continuity.curves(motion.q) if motion.dq is None else motion.dq

    def _strays(self, residual: Array, speed: Array) -> Array:
        if not self.strengths.any():
            return residual[:, :0]
        return strays(residual, np.maximum(self.spread, self.errors.deviation(speed)), self.strengths)

    def smooth(self, t: Array, x: Array) -> Array:
        """The columns (n, k), or (n, k, ...) for many logs at the same times, each smoothed by its strength."""
        columns = [smooth(t, x[:, k], float(s), self.quality.step) for k, s in enumerate(self.strengths)]
        return np.stack(columns, axis=1) if columns else x


def _too_few(trajectory: MotionLog, rows: int, wanted: str) -> TrajectoryError:
    return TrajectoryError(
        f"{trajectory.path}: {rows} row{'s are' if rows != 1 else ' is'} too few to derive {wanted} from. "
        f"Give at least {FEWEST} rows, or '.vel' and '.acc' columns for every joint. A motion between a few poses is made by "
        "twistwrench move, or tw.trajectories.move."
    )


def noise_gain(order: int, strength: float, step: float) -> float:
    """Standard deviation of the spline's derivative of that ``order`` for white noise of unit standard deviation.

    Found by differentiating a unit pulse on a uniform grid: a linear filter gains the norm of its pulse response.
    """
    half = _SPLINE_MARGIN + (margin_of(strength) if strength else 0)
    t = np.arange(2 * half + 1) * step
    pulse = np.zeros(len(t))
    pulse[half] = 1.0
    response = spline_rates(t, smooth(t, pulse, strength, step)[:, None])[order - 1]
    return float(np.linalg.norm(response))


def pulse_peak(order: int, step: float) -> float:
    """Largest derivative of that ``order`` that one sample off by 1 makes of the spline, at an end of a log or within it."""
    t = np.arange(2 * _SPLINE_MARGIN) * step
    pulses = np.zeros((len(t), 2))
    pulses[0, 0] = pulses[_SPLINE_MARGIN, 1] = 1.0
    return float(np.abs(spline_rates(t, pulses)[order - 1]).max())


def _to_joints(model: Model, spread: Array) -> Array:
    """Standard deviations of second derivatives of q (nq,) as those of ddq (nv,)."""
    found = np.zeros(model.nv)
    for b in model.leaders:
        place, here = b.places
        found[here] = b.joint.spread(spread[place])
    return found
