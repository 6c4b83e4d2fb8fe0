"""The largest torque without the noise of the log, and how sure that is: the log is drawn again and again.

The smoothed motion is taken for the true one. Logs of it are drawn with the errors that the log was found to have, and
treated as the log was. What comes out differs from what went in as the log's own peak differs from the truth: by the
smoothing's bias, by the noise that is left, and by what choosing the largest value adds.
Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapters 6 and 10.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..motion.column_extremes import Extreme
from ..motion.complete_states import States
from ..motion.coordinates import joint_rates
from ..motion.differentiation import Differentiation
from ..motion.motion_log import LogRows
from ..motion.spline import spline_rates
from ..motion.standing import SURE
from ..typing import Array
from .largest_value import Contenders, excess_of_largest
from .loaded_robot import LoadedRobot

_DRAWS, _FEWEST_DRAWS, _MOST_COLUMNS = 128, 32, 4096
_BIAS = 0.8
"""Share of the drawn bias that counts as a deviation of its own. Smoothing flattens the true peak, and noise that the
smoothed motion kept; where noise rules, the second is more and has the other sign (errors are then -1.3 times the drawn bias,
found on logs of known motions), so the bias is an error of unknown sign and not taken off. Of 844 such peaks 95 % intervals
hold 94 % without it (91 % where stamps alone are off), 98 % (96 %) with this share, 99 % with the square root of two."""
INTERVAL = 1.96
"""Standard deviations of half an interval that holds the truth in 95 %."""
_SEED = 8
_REACH, _SPLINE_REACH = 16.0, 24
"""Samples, in units of strength^(1/6) and beyond: what is farther off changes a smoothed value by less than 1e-3."""
_CELL = 2.0
"""Samples, in units of strength^(1/6), after which the noise of smoothed accelerations is about independent."""


@dataclass(frozen=True)
class PeakEstimate:
    """The largest magnitude of one joint's torque as the noise of the log lets it be known."""

    value: float
    """With its sign."""
    sigma: float
    """Its standard deviation."""
    speed: float
    """The largest velocity of the smoothed motion, with its sign."""
    speed_sigma: float
    """The standard deviation of velocities there."""


class PeakSearch:
    """One pass over the smoothed motion: the peaks, what contends with them, and the log around them."""

    def __init__(self, differentiation: Differentiation, load: LoadedRobot) -> None:
        nv = load.bare.nv
        strengths = differentiation.strengths[differentiation.strengths > 0]
        wide = float(strengths.max()) ** (1 / 6) if strengths.size else 0.0
        narrow = float(strengths.min()) ** (1 / 6) if strengths.size else 0.0
        self.differentiation, self.load = differentiation, load
        self.cell = max(1, round(_CELL * narrow))
        self.reach = math.ceil(_REACH * wide) + _SPLINE_REACH + self.cell
        self.peak, self.speed = Extreme(nv), Extreme(nv)
        self.sign, self.way = np.ones(nv), np.ones(nv)
        self.contenders = Contenders(nv, self.cell)
        self.around: list[tuple[LogRows, int] | None] = [None] * nv

    def add(self, core: States, torques: Array, motion: LogRows, inner: slice) -> None:
        """Take in an overlapping run: what is new in it, with its torques, and the log around that."""
        self.contenders.add(np.abs(torques))
        for joint, row in self.peak.add(core.time, np.abs(torques)):
            self.sign[joint] = np.sign(torques[row, joint]) or 1.0
            place = inner.start + row
            first = max(0, place - self.reach)
            rows = slice(first, place + self.reach + 1)
            self.around[joint] = _part(motion, rows), place - first
        for joint, row in self.speed.add(core.time, np.abs(core.dq)):
            self.way[joint] = np.sign(core.dq[row, joint]) or 1.0

    def estimate(self, joint: int, steady: float) -> PeakEstimate:
        """The joint's peak; ``steady`` is what it has there of causes that are no accelerations.

        Draws come from a fixed seed, so that the same log always gives the same numbers.
        """
        found = self.around[joint]
        assert found is not None
        motion, row = found
        near = slice(max(0, row - self.cell), row + self.cell + 1)
        bias, sigma, speed_sigma = self._drawn(motion, near, joint)
        values = self.contenders.result()[:, joint]
        excess, spread = excess_of_largest(values, sigma, self.contenders.runs)
        largest, sigma = float(self.peak.value[joint]), math.hypot(spread, _BIAS * bias)
        # Noise cannot take away more than accelerations make. Where it could, nothing is known between that and the peak.
        least = min(max(0.0, float(self.sign[joint]) * steady), largest)
        if largest - excess < least:
            excess, sigma = largest - least, max(sigma, (largest - least) / INTERVAL)
        return PeakEstimate(
            value=float(self.sign[joint] * (largest - excess)),
            sigma=sigma,
            speed=float(self.way[joint] * self.speed.value[joint]),
            speed_sigma=speed_sigma,
        )

    def _drawn(self, motion: LogRows, near: slice, joint: int) -> tuple[float, float, float]:
        """Bias and deviation of the peak near some rows, and deviation of the velocity there."""
        d, t = self.differentiation, motion.time
        curve = d.smooth(t, d.curves(motion))
        columns = curve.shape[1]
        count = min(_DRAWS, max(_FEWEST_DRAWS, _MOST_COLUMNS // max(1, columns)))
        speed = spline_rates(t, curve)[0]
        logs = d.smooth(t, d.errors.drawn(np.random.default_rng(_SEED), curve, speed, count))
        first, second = spline_rates(t, logs.reshape(len(t), -1))
        each = [x.reshape(len(t), columns, count)[near] for x in (logs, first, second)]
        clean = [x[near] for x in (curve, *spline_rates(t, curve))]
        true, _ = self._torques(motion, near, [x[:, :, None] for x in clean])
        drawn, dq = self._torques(motion, near, each)
        peaks = (self.sign[joint] * drawn[:, :, joint]).max(axis=0)
        bias = float(peaks.mean() - (self.sign[joint] * true[:, :, joint]).max())
        middle = len(dq) // 2
        return bias, float(peaks.std(ddof=1)), float(dq[middle, :, joint].std(ddof=1))

    def _torques(self, motion: LogRows, near: slice, logs: list[Array]) -> tuple[Array, Array]:
        """Torques and velocities (n, count, nv) of smoothed logs (n, k, count) with their derivatives."""
        d, model = self.differentiation, self.differentiation.model
        n, _, count = logs[0].shape
        x, first, second = (np.moveaxis(a, 1, 2).reshape(n * count, -1) for a in logs)

        def given(values: Array | None) -> Array:
            assert values is not None
            return np.repeat(values[near], count, axis=0)

        if motion.dq is None:
            q = x
            dq, ddq = joint_rates(model, q, first, second)
            ddq = ddq if motion.ddq is None else given(motion.ddq)
        else:
            q, dq, ddq = given(motion.q), x, first
        still = np.abs(dq) <= SURE * d.sigma_dq if d.derives_velocities else np.zeros(dq.shape, bool)
        time, none = np.repeat(motion.time[near], count), np.zeros((n * count, 0))
        torques = self.load.torques(States(time, q, dq, ddq, q, still, none))
        return torques.reshape(n, count, -1), dq.reshape(n, count, -1)


def _part(motion: LogRows, rows: slice) -> LogRows:
    def part(values: Array | None) -> Array | None:
        return None if values is None else values[rows].copy()

    return LogRows(motion.time[rows].copy(), motion.q[rows].copy(), part(motion.dq), part(motion.ddq))
