"""Quality of a log: clock, range, grid and saturation of each column, and measured torques against computed ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import TrajectoryError
from ..core.estimation.noise import noise, quantum
from ..core.numbers import number, percent, seconds, torque
from ..core.text import listed
from ..core.typing import Array
from ..motion.bounds import Extrema
from ..motion.column_names import split_unit, time_factor, time_meaning, unit_since_1970
from ..motion.columns import check_header
from ..motion.log_table import LARGE, excerpts
from ..motion.motion_file import open_motion_file, text_columns
from ..motion.plausibility import TimeAbove
from ..motion.readers.csv_reader import CsvFile

GAP = 3.0
"""Ratio to the median step above which a step is a gap."""


# ── The log's quality, without a robot

_RUNS = 16, 4096
_FEWEST = 16
_CUT, _CUT_ROWS = 0.01, 20
"""Minimum share and number of rows at the extreme of a saturated column."""


@dataclass(frozen=True)
class LogColumn:
    """One column, in the file's unit."""

    name: str
    least: float
    most: float
    grid: float
    """Step of the quantisation grid; 0 if none is found."""
    noise: float
    """Standard deviation of the noise; 0 if none is found."""
    cut: float
    """Share of the rows at the saturated extreme; 0 if the column is not saturated."""
    dead: bool
    """True if the column is constant."""
    zeros: float = 0.0
    """Share of the rows that are exactly 0."""


@dataclass(frozen=True)
class LogQuality:
    """Quality of a log; times are in seconds, nan without a time column."""

    path: Path
    rows: int
    time: str
    """Name of the time column; empty if there is none."""
    seconds: float
    """Time from the first stamp to the last."""
    rate: float
    """Rows per second by the median step [Hz]."""
    gaps: int
    """Number of steps of at least three median steps."""
    longest: float
    """Longest step."""
    repeated: int
    """Number of rows with the stamp of the previous row."""
    backward: int
    """Number of rows with a stamp before that of the previous row."""
    jitter: float
    """Standard deviation of the steps that are not gaps."""
    columns: tuple[LogColumn, ...]
    notes: tuple[str, ...] = ()
    """Sentences on ignored parts of the file."""

    @classmethod
    def from_file(cls, path: str | Path, *, topic: str | None = None, episode: int | None = None) -> LogQuality:
        """Read a motion file; for a large file, grid and noise come from 16 blocks of rows spread over it.

        ``topic`` selects a topic of a ROS recording, ``episode`` an episode of a LeRobot dataset.
        """
        file = open_motion_file(path, topic, episode)
        every, text = range(len(file.header)), text_columns(file)
        used = [k for k in every if k not in text] or every  # if all columns are words, the first row raises
        header = [file.header[k] for k in used]
        ignored = (
            [f"Ignored, as they hold words: {listed([repr(file.header[k]) for k in text])}."]
            if len(used) < len(every)
            else []
        )
        check_header(header, f"{path}: line {file.header_line}" if isinstance(file, CsvFile) else str(path))
        table = file.table(used)
        if not len(table):
            raise TrajectoryError(f"{path}: no rows after the header.")
        place = _time_of(header, table)
        clock = (np.nan, np.nan, 0, np.nan, 0, 0, np.nan)
        if place is not None:
            clock = _clock(table[:, place[0]] * place[1])
        runs = excerpts(table, *_RUNS) if 8 * table.size > LARGE else [table]
        return cls(
            file.path,
            len(table),
            "" if place is None else header[place[0]],
            *clock,
            tuple(
                _column(header[k], table[:, k], [run[:, k] for run in runs])
                for k in range(table.shape[1])
                if place is None or k != place[0]
            ),
            (*file.notes, *ignored),
        )


def _grid_and_noise(runs: list[Array]) -> tuple[float, float]:
    """Quantisation step and noise of the numbers in several blocks of rows."""
    if min(map(np.min, runs)) == max(map(np.max, runs)):
        return 0.0, 0.0
    grid = quantum(runs)
    if min(map(len, runs)) < _FEWEST:
        return grid, 0.0
    rows = [np.arange(len(x), dtype=float) for x in runs]
    return grid, float(noise(rows, [x[:, None] for x in runs], grid)[0])


def _time_of(header: Sequence[str], table: Array) -> tuple[int, float] | None:
    """Time column and its factor to seconds, by its unit, or by its numbers if they count from 1970."""
    ranked = []
    for k, cell in enumerate(header):
        name, unit = split_unit(cell)
        meant = time_meaning(name)
        if meant is not None:
            unit = unit or meant[1] or unit_since_1970(table[:, k]) or "s"
            ranked.append((meant[0], k, time_factor(unit) or 1.0))
    if not ranked:
        return None
    _, k, factor = min(ranked)
    return k, factor


def _clock(t: Array) -> tuple[float, float, int, float, int, int, float]:
    steps = np.diff(t)
    ahead = steps[steps > 0]
    usual = float(np.median(ahead)) if ahead.size else np.nan
    regular = ahead[ahead < GAP * usual] if ahead.size else ahead
    return (
        float(t[-1] - t[0]),
        1.0 / usual,
        int((ahead >= GAP * usual).sum()),
        float(ahead.max(initial=0.0)),
        int((steps == 0).sum()),
        int((steps < 0).sum()),
        float(regular.std()) if regular.size else np.nan,
    )


def _column(name: str, x: Array, runs: list[Array]) -> LogColumn:
    least, most = float(x.min()), float(x.max())
    dead = least == most
    counts = [int((x == extreme).sum()) for extreme in (least, most) if extreme != 0]
    cut = max(counts, default=0)
    grid, size = _grid_and_noise(runs)
    share = cut / len(x) if not dead and cut >= _CUT_ROWS and cut >= _CUT * len(x) else 0.0
    return LogColumn(name, least, most, grid, size, share, dead, float((x == 0).mean()))


# ── Measured torques against those computed from the motion

_MATTERS = 0.02
"""Fraction of the largest torque of the same unit below which a joint's torques are not compared."""
_STANDS = 1e-9
"""Relative variation below which a column counts as constant."""
_GROSS = 0.6
"""Residual over the larger of both torques; missing friction and usual model errors stay below."""
_FAR = 3.0
"""Ratio of computed to measured torque that friction cannot explain, since it adds to the motor torque of a moving joint."""
_NOISE = 1.5
"""Factor by which noise may exceed its estimate, as for velocities with noise of several sizes."""
_ALIKE = 0.9
"""Correlation above which one torque is a multiple of the other."""
_HALF, _AROUND = 0.5, 10
"""Share of a computed torque above which the measured one supports it, and rows on either side in which it is looked for."""
_CUT_MEASURED, _CUT_MEASURED_ROWS, _VARIES = 0.02, 30, 0.05
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
        return abs(self.computed_peak) > self.limit > self.beside and self.beside < _HALF * abs(self.computed_peak)

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
        return self.matters and not self.dead and self.residual > _GROSS * max(self.computed, self.measured)

    @property
    def disagrees(self) -> bool:
        """True if they differ by more than noise explains."""
        beyond = _without(self.residual, self.noise)
        return self.differs and beyond > _GROSS * max(self._true, self.measured)

    @property
    def contradicts(self) -> bool:
        """True if parts missing in a robot file cannot explain the difference."""
        opposite = self.correlation < -_ALIKE
        scaled = self.correlation > _ALIKE and not 1 / _FAR < self.gain < _FAR
        return self.disagrees and (opposite or scaled or self._true > _FAR * self.measured)

    @property
    def _true(self) -> float:
        return _without(self.computed, self.noise)

    @property
    def words(self) -> str:
        """Text of the difference and its possible cause."""
        figures = f"rms {number(self.computed)} {self.unit} computed, {number(self.measured)} measured"
        if self.correlation < -_ALIKE:
            return f"{self.joint} has the opposite sign of what is computed ({figures})"
        if self.correlation > _ALIKE and not 1 / _FAR < self.gain < _FAR:
            return (
                f"{self.joint} is {number(self.gain, 2)} times what is computed ({figures}): a current, another unit, or a "
                "torque before the gear"
            )
        return f"{self.joint} {figures}"


def _without(size: float, noise: float) -> float:
    """RMS without the part of independent noise, taken 1.5 times as large as estimated."""
    return math.sqrt(max(0.0, size**2 - (_NOISE * noise) ** 2))


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
    def joined(cls, parts: Sequence[_AtExtreme]) -> _AtExtreme:
        """Rows of several parts."""
        values, below, sums = (np.stack(x) for x in zip(*parts, strict=True))
        value = values.max(axis=0)
        lower = np.where(values < value, values, below).max(axis=0)
        return cls(value, lower, np.where((values == value)[:, None], sums, 0.0).sum(axis=0))

    def cut(self, rows: int, variance: Array) -> Array:
        """(columns,) share of these rows if they are many and the computed torque varies among them; else 0."""
        count, total, squares = self.sums
        n = np.maximum(count, 1.0)
        step = np.where(np.isfinite(self.next), self.value - self.next, 0.0)
        varies = squares / n - (total / n) ** 2 > np.maximum(
            _VARIES**2 * np.maximum(variance, (0.01 * self.value) ** 2), step**2
        )
        many = (count >= _CUT_MEASURED_ROWS) & (count >= _CUT_MEASURED * rows) & (self.value != 0.0)
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
    def joined(cls, parts: Sequence[_Sums]) -> _Sums:
        """Sums over several parts."""
        rows, sums, noise = zip(*parts, strict=True)
        return cls(sum(rows), np.sum(sums, axis=0), np.sum(noise, axis=0))


class TorqueComparison(NamedTuple):
    """Measured torques of some rows beside computed ones, compared in sound rows, and in all rows only if none is sound."""

    every: _Sums
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
        rows = np.abs(c).argmax(axis=0).tolist()
        near = [np.abs(m[max(0, row - _AROUND) : row + _AROUND + 1, k]).max() for k, row in enumerate(rows)]
        return cls(
            _Sums.from_rows(c, m, sigma),
            _Sums.from_rows(c[~doubted], m[~doubted], sigma[~doubted]),
            Extrema.from_rows(time, np.abs(m), m),
            Extrema.from_rows(time, np.abs(c), c),
            np.array(near),
            _AtExtreme.from_rows(c, m),
            _AtExtreme.from_rows(c, -m),
        )

    @classmethod
    def joined(cls, parts: Sequence[TorqueComparison]) -> TorqueComparison:
        """Comparison of consecutive rows from those of their parts."""
        every, sound, measured, computed, beside, highest, lowest = zip(*parts, strict=True)
        largest = np.argmax([one.value for one in computed], axis=0)
        return cls(
            _Sums.joined(every),
            _Sums.joined(sound),
            Extrema.joined(measured),
            Extrema.joined(computed),
            np.stack(beside)[largest, np.arange(len(largest))],
            _AtExtreme.joined(highest),
            _AtExtreme.joined(lowest),
        )

    @property
    def _compared(self) -> _Sums:
        return self.sound if self.sound.rows else self.every

    @property
    def misfit(self) -> float:
        """Sum over joints of the squared residual relative to the squared torques; 0 to 2 each."""
        _, _, cc, mm, cm = self._compared.sums
        total = cc + mm
        return float(np.where(total > 0, (total - 2 * cm) / np.where(total > 0, total, 1.0), 0.0).sum())

    def torques(
        self, names: tuple[str, ...], units: tuple[str, ...], limits: Array, over: TimeAbove, step: float
    ) -> tuple[MeasuredTorque, ...]:
        """Torques of each joint, with the limits (columns,), the time above them, and the usual step of time [s]."""
        n = self._compared.rows
        c, m, cc, mm, cm = self._compared.sums
        computed, measured = np.sqrt(cc / n), np.sqrt(mm / n)
        noise = np.sqrt(self._compared.noise / n)
        residual = np.sqrt(np.maximum(cc + mm - 2 * cm, 0.0) / n)
        vc, vm, v = (np.maximum(cc - c * c / n, 0.0), np.maximum(mm - m * m / n, 0.0), cm - c * m / n)
        gain = np.where(vc > 0, v / np.where(vc > 0, vc, 1.0), 0.0)
        both = np.sqrt(vc * vm)
        correlation = np.where(both > 0, v / np.where(both > 0, both, 1.0), 0.0)
        size = np.maximum(computed, measured)
        kinds = np.array(units)
        largest = np.array([size[kinds == unit].max() for unit in units])
        most, least = self.highest.value, -self.lowest.value
        dead = most - least <= _STANDS * np.maximum(np.abs(most), np.abs(least))
        above, below = (extreme.cut(self.every.rows, vc / n) for extreme in (self.highest, self.lowest))
        cut, cut_at = np.maximum(above, below), np.where(above >= below, most, least)
        lasting = over.lasting(step)
        return tuple(
            MeasuredTorque(
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
                dead=bool(dead[k]),
                matters=bool(size[k] > _MATTERS * largest[k]),
                cut=float(cut[k]),
                cut_at=float(cut_at[k]),
                limit=float(limits[k]),
                above=float(over.length[k] + step) if over.rows[k] else 0.0,
                lasting=bool(lasting[k]),
                computed_peak=float(self.computed.signed[k]),
                beside=float(self.beside[k]),
            )
            for k, name in enumerate(names)
        )
