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
_MIN_SUPPORTED_SHARE = 0.5
"""Share of a computed torque above which the measured torque supports it."""
_ROWS_BESIDE_PEAK = 10
"""Number of rows on either side of the largest computed torque in which the largest measured torque is taken."""
_MIN_CUT_SHARE = 0.02
"""Minimum share of the rows at the extreme of a saturated column."""
_MIN_CUT_ROWS = 30
"""Minimum number of rows at the extreme of a saturated column."""
_MIN_VARIATION = 0.05
"""Minimum variation of the computed torque in these rows, relative to its usual variation.

It also exceeds the step from the extreme to the next value, since a robot at rest and coarse torques repeat numbers too."""
_MIN_SHARE_OF_EXTREME = 0.01
"""Smallest usual variation of the computed torque, as a share of the extreme."""


@dataclass(frozen=True)
class MeasuredTorque:
    """Measured and computed torque of one joint."""

    joint: str
    """Name of the joint or motor."""
    unit: str
    """Unit of all torques, N m or N."""
    computed: float
    """RMS of the computed torque over the rows."""
    measured: float
    """RMS of the measured torque over the rows."""
    residual: float
    """RMS of measured minus computed torque."""
    noise: float
    """RMS of the noise in the computed torque."""
    gain: float
    """Ratio of measured to computed torque, by least squares with an offset."""
    correlation: float
    """Correlation of measured and computed torque, -1 to 1."""
    peak: float
    """Measured torque of largest magnitude, with its sign."""
    time: float
    """Time of the peak [s]."""
    dead: bool
    """True if the column is constant."""
    matters: bool
    """True if the joint's torques are a substantial part of the robot's."""
    cut: float = 0.0
    """Share of the rows that are cut off at an extreme while the computed torque changes; 0 if not saturated."""
    cut_at: float = 0.0
    """Extreme at which the torque is saturated, with its sign."""
    limit: float = math.inf
    """Torque limit; inf if unknown."""
    above: float = 0.0
    """Longest time above the limit by more than noise [s]."""
    lasting: bool = False
    """True if the time above the limit is longer than an impact."""
    computed_peak: float = math.nan
    """Computed torque of largest magnitude, with its sign."""
    beside: float = math.nan
    """Largest magnitude of the measured torque near the instant of ``computed_peak``."""

    @property
    def share(self) -> float:
        """Largest measured torque over the limit; 0 without a limit, and for a constant column."""
        return 0.0 if self.dead else abs(self.peak) / self.limit

    @property
    def refutes(self) -> bool:
        """True if a computed torque above the limit was measured to be less than half as large, and within the limit."""
        peak = abs(self.computed_peak)
        return peak > self.limit > self.beside and self.beside < _MIN_SUPPORTED_SHARE * peak

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
        max_residual = _MAX_RELATIVE_RESIDUAL * max(self.computed, self.measured)
        return self.matters and not self.dead and self.residual > max_residual

    @property
    def disagrees(self) -> bool:
        """True if measured and computed torque differ by more than noise explains."""
        residual = _rms_without_noise(self.residual, self.noise)
        max_residual = _MAX_RELATIVE_RESIDUAL * max(self._computed_without_noise, self.measured)
        return self.differs and residual > max_residual

    @property
    def contradicts(self) -> bool:
        """True if parts missing in a robot file cannot explain the difference."""
        is_too_large = self._computed_without_noise > _MAX_RATIO * self.measured
        return self.disagrees and (self._is_opposite or self._is_scaled or is_too_large)

    @property
    def _is_opposite(self) -> bool:
        """True if the measured torque is a negative multiple of the computed one."""
        return self.correlation < -_MIN_CORRELATION

    @property
    def _is_scaled(self) -> bool:
        """True if the measured torque is a multiple of the computed one, with a factor that friction cannot explain."""
        is_usual_gain = 1 / _MAX_RATIO < self.gain < _MAX_RATIO
        return self.correlation > _MIN_CORRELATION and not is_usual_gain

    @property
    def _computed_without_noise(self) -> float:
        """RMS of the computed torque without the part of noise."""
        return _rms_without_noise(self.computed, self.noise)

    @property
    def words(self) -> str:
        """Text of the difference and its possible cause."""
        figures = f"rms {number(self.computed)} {self.unit} computed, {number(self.measured)} measured"
        if self._is_opposite:
            return f"{self.joint} has the opposite sign of what is computed ({figures})"
        if self._is_scaled:
            return (
                f"{self.joint} is {number(self.gain, 2)} times what is computed ({figures}): a current, another unit, or a "
                "torque before the gear"
            )
        return f"{self.joint} {figures}"


def _rms_without_noise(rms: float, noise: float) -> float:
    """RMS without the part of independent noise, which counts as 1.5 times as large as estimated."""
    return math.sqrt(max(0.0, rms**2 - (_NOISE_FACTOR * noise) ** 2))


class _AtExtreme(NamedTuple):
    """Rows in which a measured column is at its maximum, and the computed torque there.

    A minimum is the maximum of the column with its sign turned.
    """

    value: Array
    """Maximum (columns,)."""
    next_value: Array
    """Largest value below the maximum (columns,); -inf if there is none."""
    sums: Array
    """(3, columns) number of rows at the maximum, sum and sum of squares of the computed torque there."""

    @classmethod
    def from_rows(cls, computed: Array, measured: Array) -> _AtExtreme:
        """Rows of torques (n, columns)."""
        value = measured.max(axis=0)
        at_maximum = np.where(measured == value, 1.0, 0.0)
        counts = at_maximum.sum(axis=0)
        torque_sums = (at_maximum * computed).sum(axis=0)
        square_sums = (at_maximum * computed**2).sum(axis=0)
        next_value = np.where(measured < value, measured, -np.inf).max(axis=0)
        return cls(value, next_value, np.array([counts, torque_sums, square_sums]))

    @classmethod
    def from_parts(cls, parts: Sequence[_AtExtreme]) -> _AtExtreme:
        """Rows of several parts."""
        fields_of_parts = zip(*parts, strict=True)
        values, next_values, sums = map(np.stack, fields_of_parts)
        value = values.max(axis=0)
        # In a part with a smaller maximum, this maximum may be the next value.
        next_value = np.where(values < value, values, next_values).max(axis=0)
        has_maximum = (values == value)[:, None]
        sums_at_maximum = np.where(has_maximum, sums, 0.0).sum(axis=0)
        return cls(value, next_value, sums_at_maximum)

    def cut(self, rows: int, variance: Array) -> Array:
        """Share (columns,) of the rows at the maximum if they are many and the computed torque varies among them; else 0.

        ``rows`` is the number of all rows, ``variance`` (columns,) the variance of the computed torque in all rows.
        """
        count, torque_sum, square_sum = self.sums
        n = np.maximum(count, 1.0)
        variance_at_maximum = square_sum / n - (torque_sum / n) ** 2
        usual_variance = np.maximum(variance, (_MIN_SHARE_OF_EXTREME * self.value) ** 2)
        step = np.where(np.isfinite(self.next_value), self.value - self.next_value, 0.0)
        varies = variance_at_maximum > np.maximum(_MIN_VARIATION**2 * usual_variance, step**2)
        are_many = (count >= _MIN_CUT_ROWS) & (count >= _MIN_CUT_SHARE * rows)
        is_cut = are_many & varies & (self.value != 0.0)  # a torque may be exactly zero
        return np.where(is_cut, count / rows, 0.0)


class _Sums(NamedTuple):
    """Sums over rows of computed and measured torques c and m, and of the variance of c."""

    rows: int
    """Number of rows."""
    sums: Array
    """(5, columns) sums of c, m, c², m² and c m."""
    noise: Array
    """(columns,) sum of the variance of c."""

    @classmethod
    def from_rows(cls, c: Array, m: Array, sigma: Array) -> _Sums:
        """Sums of torques (n, columns) and of the standard deviation of c."""
        sums = np.array([values.sum(axis=0) for values in (c, m, c * c, m * m, c * m)])
        return cls(len(c), sums, (sigma**2).sum(axis=0))

    @classmethod
    def from_parts(cls, parts: Sequence[_Sums]) -> _Sums:
        """Sums over several parts."""
        rows, sums, noise = zip(*parts, strict=True)
        return cls(sum(rows), np.sum(sums, axis=0), np.sum(noise, axis=0))


class TorqueComparison(NamedTuple):
    """Measured and computed torques of some rows. They are compared in sound rows; if none is sound, in all rows."""

    all_rows: _Sums
    """Sums over all rows."""
    sound: _Sums
    """Sums over the rows that are not doubted."""
    measured: Extrema
    """Largest magnitudes of the measured torques."""
    computed: Extrema
    """Largest magnitudes of the computed torques."""
    beside: Array
    """Largest magnitude (columns,) of the measured torque near the row of the largest computed torque."""
    highest: _AtExtreme
    """Rows at the maximum of the measured torque."""
    lowest: _AtExtreme
    """Rows at the minimum of the measured torque, with the sign turned."""

    @classmethod
    def from_rows(cls, time: Array, c: Array, m: Array, sigma: Array, doubted: Array) -> TorqueComparison:
        """Comparison of computed and measured torques c and m (n, columns) with the standard deviation of c.

        ``doubted`` (n,) is True in rows whose derived rates are not those of the robot's drives, as at an impact.
        """
        beside = []
        for column, row in enumerate(np.abs(c).argmax(axis=0).tolist()):
            rows_around = slice(max(0, row - _ROWS_BESIDE_PEAK), row + _ROWS_BESIDE_PEAK + 1)
            beside.append(np.abs(m[rows_around, column]).max())
        is_sound = ~doubted
        return cls(
            all_rows=_Sums.from_rows(c, m, sigma),
            sound=_Sums.from_rows(c[is_sound], m[is_sound], sigma[is_sound]),
            measured=Extrema.from_rows(time, np.abs(m), m),
            computed=Extrema.from_rows(time, np.abs(c), c),
            beside=np.array(beside),
            highest=_AtExtreme.from_rows(c, m),
            lowest=_AtExtreme.from_rows(c, -m),
        )

    @classmethod
    def from_parts(cls, parts: Sequence[TorqueComparison]) -> TorqueComparison:
        """Comparison of consecutive rows from those of their parts."""
        all_rows, sound, measured, computed, beside, highest, lowest = zip(*parts, strict=True)
        part_of_largest = np.argmax([extrema.value for extrema in computed], axis=0)  # for each column
        columns = np.arange(len(part_of_largest))
        return cls(
            all_rows=_Sums.from_parts(all_rows),
            sound=_Sums.from_parts(sound),
            measured=Extrema.merge(measured),
            computed=Extrema.merge(computed),
            beside=np.stack(beside)[part_of_largest, columns],
            highest=_AtExtreme.from_parts(highest),
            lowest=_AtExtreme.from_parts(lowest),
        )

    def _sums_to_compare(self) -> _Sums:
        """Sums over sound rows; over all rows if none is sound."""
        return self.sound if self.sound.rows else self.all_rows

    @property
    def misfit(self) -> float:
        """Sum over joints of the squared residual (c - m)² relative to c² + m²; each joint adds 0 to 2."""
        _, _, cc, mm, cm = self._sums_to_compare().sums
        squares = cc + mm
        return float(_ratios(squares - 2 * cm, squares).sum())

    def torques(
        self, names: tuple[str, ...], units: tuple[str, ...], limits: Array, over: TimeAbove, step: float
    ) -> tuple[MeasuredTorque, ...]:
        """Torques of each joint, by the limits (columns,), the time above them, and the usual time step [s]."""
        compared_sums = self._sums_to_compare()
        n = compared_sums.rows
        c, m, cc, mm, cm = compared_sums.sums
        computed = np.sqrt(cc / n)
        measured = np.sqrt(mm / n)
        noise = np.sqrt(compared_sums.noise / n)
        residual = np.sqrt(np.maximum(cc + mm - 2 * cm, 0.0) / n)
        # Sums of squares and products about the means.
        computed_variance = np.maximum(cc - c * c / n, 0.0)
        measured_variance = np.maximum(mm - m * m / n, 0.0)
        covariance = cm - c * m / n
        gain = _ratios(covariance, computed_variance)
        correlation = _ratios(covariance, np.sqrt(computed_variance * measured_variance))
        size = np.maximum(computed, measured)
        matters = size > _MIN_SHARE_OF_LARGEST * _largest_of_unit(size, units)
        maximum = self.highest.value
        minimum = -self.lowest.value
        largest_size = np.maximum(np.abs(maximum), np.abs(minimum))
        is_constant = maximum - minimum <= _MAX_VARIATION_OF_CONSTANT * largest_size
        cut_above = self.highest.cut(self.all_rows.rows, computed_variance / n)
        cut_below = self.lowest.cut(self.all_rows.rows, computed_variance / n)
        cut_share = np.maximum(cut_above, cut_below)
        cut_torque = np.where(cut_above >= cut_below, maximum, minimum)
        is_lasting = over.is_lasting(step)
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
                dead=bool(is_constant[k]),
                matters=bool(matters[k]),
                cut=float(cut_share[k]),
                cut_at=float(cut_torque[k]),
                limit=float(limits[k]),
                above=float(time_above[k]),
                lasting=bool(is_lasting[k]),
                computed_peak=float(self.computed.signed[k]),
                beside=float(self.beside[k]),
            )
            torques.append(torque)
        return tuple(torques)


def _ratios(numerators: Array, denominators: Array) -> Array:
    """Ratios where denominators are positive, 0 elsewhere."""
    is_positive = denominators > 0
    divisors = np.where(is_positive, denominators, 1.0)
    return np.where(is_positive, numerators / divisors, 0.0)


def _largest_of_unit(sizes: Array, units: Sequence[str]) -> Array:
    """For each entry, the largest size (n,) among the entries with its unit."""
    all_units = np.array(units)
    return np.array([sizes[all_units == unit].max() for unit in units])
