"""Measured torques of a log against those computed from its motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.numbers import number, percent, seconds, torque
from ..core.typing import Array
from ..motion.bounds import Extrema, TimeAbove

_MIN_SHARE_OF_LARGEST = 0.02
"""Fraction of the largest torque of the same unit below which a joint's torques are not compared."""
_MAX_VARIATION_OF_CONSTANT = 1e-9
"""Relative variation below which a column counts as constant."""
_MAX_RELATIVE_RESIDUAL = 0.6
"""Residual over the larger of both torques; missing friction and usual model errors stay below."""
_MAX_RATIO = 3.0
"""Ratio of computed to measured torque that friction cannot explain, since it adds to the motor torque of a moving joint."""
_NOISE_FACTOR = 1.5
"""Factor by which noise may exceed its estimate, as for velocities with noise of several sizes."""
_MIN_CORRELATION = 0.9
"""Correlation above which one torque is a multiple of the other."""
_MIN_SUPPORTED_SHARE, _ROWS_AROUND = 0.5, 10
"""Share of a computed torque above which the measured one supports it, and rows on either side in which it is looked for."""
_MIN_CUT_SHARE, _MIN_CUT_ROWS, _MIN_VARIATION = 0.02, 30, 0.05
"""Minimum share and number of rows at the extreme of a saturated column, and relative variation of the computed torque in them.
The variation also exceeds the column's last step, since a robot at rest and coarse torques repeat numbers too."""


@dataclass(frozen=True)
class MeasuredTorque:
    """Measured and computed torque of one joint."""

    joint: str
    unit: str
    computed: float
    """RMS over the rows."""
    measured: float
    residual: float
    """RMS of measured minus computed torque."""
    noise: float
    """RMS of the noise in the computed torque."""
    gain: float
    """Ratio of measured to computed torque, by least squares with an offset."""
    correlation: float
    peak: float
    """Measured torque of largest magnitude, with its sign."""
    time: float
    """Time of the peak [s]."""
    dead: bool
    """True if the column is constant."""
    matters: bool
    """True if the joint's torques are a substantial part of the robot's."""
    cut: float = 0.0
    """Share of the rows at the saturated extreme while the computed torque changes; 0 if not saturated."""
    cut_at: float = 0.0
    """Extreme at which the torque is saturated, with its sign."""
    limit: float = math.inf
    """Torque limit; inf if unknown."""
    above: float = 0.0
    """Longest time above the limit by more than noise [s]."""
    lasting: bool = False
    """True if that time is longer than an impact."""
    computed_peak: float = math.nan
    """Largest computed torque, with its sign."""

    beside: float = math.nan
    """Largest measured torque [magnitude] near the instant of the largest computed one."""

    @property
    def share(self) -> float:
        """Largest measured torque over the limit; 0 without a limit, and for a constant column."""
        return 0.0 if self.dead else abs(self.peak) / self.limit

    @property
    def refutes(self) -> bool:
        """True if a computed torque above the limit was measured to be less than half as large, and within the limit."""
        return abs(self.computed_peak) > self.limit > self.beside and self.beside < _MIN_SUPPORTED_SHARE * abs(
            self.computed_peak
        )

    @property
    def refuting_words(self) -> str:
        """Sentence on a computed torque that the measured one refutes."""
        return (
            f"the computed torque of {self.joint} exceeds its limit, {torque(self.computed_peak)} {self.unit} of "
            f"{number(self.limit)}, and the measured one is {torque(self.beside)} at most there"
        )

    @property
    def above_words(self) -> str:
        """Sentence on a measured torque that stays above the limit."""
        return (
            f"measured torque of {self.joint}: {torque(self.peak)} {self.unit} at t = {seconds(self.time)} s, computed at "
            f"most {torque(abs(self.computed_peak))}, limit {number(self.limit)}: friction or a load is missing from the "
            "file, or the column's scale differs"
        )

    @property
    def cut_words(self) -> str:
        """Sentence on the saturation."""
        return (
            f"the measured torque of {self.joint} is exactly {number(self.cut_at)} {self.unit} in {percent(self.cut, 3)} of "
            "the rows, while the torque computed changes: it is cut off there, or its channel is dead. Log what the motor "
            "really gives, or leave the column out"
        )

    @property
    def differs(self) -> bool:
        """True if measured and computed torque differ grossly, possibly by noise."""
        return (
            self.matters
            and not self.dead
            and self.residual > _MAX_RELATIVE_RESIDUAL * max(self.computed, self.measured)
        )

    @property
    def disagrees(self) -> bool:
        """True if they differ by more than noise explains."""
        beyond = _without(self.residual, self.noise)
        return self.differs and beyond > _MAX_RELATIVE_RESIDUAL * max(self._true, self.measured)

    @property
    def contradicts(self) -> bool:
        """True if parts missing in a robot file cannot explain the difference."""
        opposite = self.correlation < -_MIN_CORRELATION
        scaled = self.correlation > _MIN_CORRELATION and not 1 / _MAX_RATIO < self.gain < _MAX_RATIO
        return self.disagrees and (opposite or scaled or self._true > _MAX_RATIO * self.measured)

    @property
    def _true(self) -> float:
        return _without(self.computed, self.noise)

    @property
    def words(self) -> str:
        """Text of the difference and its possible cause."""
        figures = f"rms {number(self.computed)} {self.unit} computed, {number(self.measured)} measured"
        if self.correlation < -_MIN_CORRELATION:
            return f"{self.joint} has the opposite sign of what is computed ({figures})"
        if self.correlation > _MIN_CORRELATION and not 1 / _MAX_RATIO < self.gain < _MAX_RATIO:
            return (
                f"{self.joint} is {number(self.gain, 2)} times what is computed ({figures}): a current, another unit, or a "
                "torque before the gear"
            )
        return f"{self.joint} {figures}"


def _without(size: float, noise: float) -> float:
    """RMS without the part of independent noise, taken 1.5 times as large as estimated."""
    return math.sqrt(max(0.0, size**2 - (_NOISE_FACTOR * noise) ** 2))


class _AtExtreme(NamedTuple):
    """Rows in which a column is at its maximum (with the sign turned, its minimum), and the computed torque there."""

    value: Array
    """Maximum (columns,)."""
    next: Array
    """Largest value below the maximum (columns,)."""
    sums: Array
    """(3, columns) number of rows, sum and sum of squares of the computed torque."""

    @classmethod
    def from_rows(cls, computed: Array, measured: Array) -> _AtExtreme:
        """Rows of torques (n, columns)."""
        value = measured.max(axis=0)
        here = np.where(measured == value, 1.0, 0.0)
        sums = np.array([here.sum(axis=0), (here * computed).sum(axis=0), (here * computed**2).sum(axis=0)])
        return cls(value, np.where(measured < value, measured, -np.inf).max(axis=0), sums)

    @classmethod
    def from_parts(cls, parts: Sequence[_AtExtreme]) -> _AtExtreme:
        """Rows of several parts."""
        values, below, sums = map(np.stack, zip(*parts, strict=True))
        value = values.max(axis=0)
        lower = np.where(values < value, values, below).max(axis=0)
        return cls(value, lower, np.where((values == value)[:, None], sums, 0.0).sum(axis=0))

    def cut(self, rows: int, variance: Array) -> Array:
        """(columns,) share of these rows if they are many and the computed torque varies among them; else 0."""
        count, total, squares = self.sums
        n = np.maximum(count, 1.0)
        step = np.where(np.isfinite(self.next), self.value - self.next, 0.0)
        varies = squares / n - (total / n) ** 2 > np.maximum(
            _MIN_VARIATION**2 * np.maximum(variance, (0.01 * self.value) ** 2), step**2
        )
        many = (count >= _MIN_CUT_ROWS) & (count >= _MIN_CUT_SHARE * rows) & (self.value != 0.0)
        return np.where(many & varies, count / rows, 0.0)


class _Sums(NamedTuple):
    """Sums over rows of computed and measured torques c and m, and of the variance of c."""

    rows: int
    sums: Array
    """(5, columns) sums of c, m, c², m² and c m."""
    noise: Array

    @classmethod
    def from_rows(cls, c: Array, m: Array, sigma: Array) -> _Sums:
        """Sums of torques (n, columns) and of the standard deviation of c."""
        return cls(len(c), np.array([x.sum(axis=0) for x in (c, m, c * c, m * m, c * m)]), (sigma**2).sum(axis=0))

    @classmethod
    def from_parts(cls, parts: Sequence[_Sums]) -> _Sums:
        """Sums over several parts."""
        rows, sums, noise = zip(*parts, strict=True)
        return cls(sum(rows), np.sum(sums, axis=0), np.sum(noise, axis=0))


class TorqueComparison(NamedTuple):
    """Measured torques of some rows beside computed ones, compared in sound rows, and in all rows only if none is sound."""

    all_rows: _Sums
    sound: _Sums
    measured: Extrema
    computed: Extrema
    beside: Array
    """Largest measured torque (columns,) near the largest computed one."""
    highest: _AtExtreme
    lowest: _AtExtreme

    @classmethod
    def from_rows(cls, time: Array, c: Array, m: Array, sigma: Array, doubted: Array) -> TorqueComparison:
        """Comparison of computed and measured torques c and m (n, columns) with the standard deviation of c.

        ``doubted`` (n,) is True in rows whose derived rates are not those of the robot's drives, as at an impact.
        """
        beside = []
        for k, row in enumerate(np.abs(c).argmax(axis=0).tolist()):
            rows = slice(max(0, row - _ROWS_AROUND), row + _ROWS_AROUND + 1)
            beside.append(np.abs(m[rows, k]).max())
        return cls(
            _Sums.from_rows(c, m, sigma),
            _Sums.from_rows(c[~doubted], m[~doubted], sigma[~doubted]),
            Extrema.from_rows(time, np.abs(m), m),
            Extrema.from_rows(time, np.abs(c), c),
            np.array(beside),
            _AtExtreme.from_rows(c, m),
            _AtExtreme.from_rows(c, -m),
        )

    @classmethod
    def from_parts(cls, parts: Sequence[TorqueComparison]) -> TorqueComparison:
        """Comparison of consecutive rows from those of their parts."""
        all_rows, sound, measured, computed, beside, highest, lowest = zip(*parts, strict=True)
        part_of_largest = np.argmax([extrema.value for extrema in computed], axis=0)
        return cls(
            _Sums.from_parts(all_rows),
            _Sums.from_parts(sound),
            Extrema.merge(measured),
            Extrema.merge(computed),
            np.stack(beside)[part_of_largest, np.arange(len(part_of_largest))],
            _AtExtreme.from_parts(highest),
            _AtExtreme.from_parts(lowest),
        )

    def _rows_to_compare(self) -> _Sums:
        return self.sound if self.sound.rows else self.all_rows

    @property
    def misfit(self) -> float:
        """Sum over joints of the squared residual relative to the squared torques; 0 to 2 each."""
        _, _, cc, mm, cm = self._rows_to_compare().sums
        total = cc + mm
        return float(np.where(total > 0, (total - 2 * cm) / np.where(total > 0, total, 1.0), 0.0).sum())

    def torques(
        self, names: tuple[str, ...], units: tuple[str, ...], limits: Array, over: TimeAbove, step: float
    ) -> tuple[MeasuredTorque, ...]:
        """Torques of each joint, with the limits (columns,), the time above them, and the usual step of time [s]."""
        rows = self._rows_to_compare()
        n = rows.rows
        c, m, cc, mm, cm = rows.sums
        computed, measured = np.sqrt(cc / n), np.sqrt(mm / n)
        noise = np.sqrt(rows.noise / n)
        residual = np.sqrt(np.maximum(cc + mm - 2 * cm, 0.0) / n)
        # sums of squares and products about the means
        computed_variance = np.maximum(cc - c * c / n, 0.0)
        measured_variance = np.maximum(mm - m * m / n, 0.0)
        covariance = cm - c * m / n
        gain = _ratios(covariance, computed_variance)
        correlation = _ratios(covariance, np.sqrt(computed_variance * measured_variance))
        size = np.maximum(computed, measured)
        matters = size > _MIN_SHARE_OF_LARGEST * _largest_of_unit(size, units)
        most, least = self.highest.value, -self.lowest.value
        constant = most - least <= _MAX_VARIATION_OF_CONSTANT * np.maximum(np.abs(most), np.abs(least))
        above = self.highest.cut(self.all_rows.rows, computed_variance / n)
        below = self.lowest.cut(self.all_rows.rows, computed_variance / n)
        cut, cut_at = np.maximum(above, below), np.where(above >= below, most, least)
        lasting = over.is_lasting(step)
        time_above = np.where(over.rows, over.length + step, 0.0)
        torques = []
        for k, name in enumerate(names):
            torque = MeasuredTorque(
                joint=name,
                unit=units[k],
                computed=float(computed[k]),
                measured=float(measured[k]),
                residual=float(residual[k]),
                noise=float(noise[k]),
                gain=float(gain[k]),
                correlation=float(correlation[k]),
                peak=float(self.measured.signed[k]),
                time=float(self.measured.time[k]),
                dead=bool(constant[k]),
                matters=bool(matters[k]),
                cut=float(cut[k]),
                cut_at=float(cut_at[k]),
                limit=float(limits[k]),
                above=float(time_above[k]),
                lasting=bool(lasting[k]),
                computed_peak=float(self.computed.signed[k]),
                beside=float(self.beside[k]),
            )
            torques.append(torque)
        return tuple(torques)


def _ratios(numerators: Array, denominators: Array) -> Array:
    """Ratios with positive denominators; 0 for others."""
    positive = denominators > 0
    return np.where(positive, numerators / np.where(positive, denominators, 1.0), 0.0)


def _largest_of_unit(sizes: Array, units: Sequence[str]) -> Array:
    """Largest size (n,) among those of the same unit."""
    kinds = np.array(units)
    return np.array([sizes[kinds == unit].max() for unit in units])
