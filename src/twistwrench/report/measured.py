"""The torques that a log has itself, held against those that are computed from its motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import number
from ..motion.column_extremes import Extreme
from ..typing import Array

_MATTERS = 0.02
"""Share of the largest torque of its unit, computed or measured, below which a joint's torques say nothing."""
_STANDS = 1e-9
"""Share of its own size by which a column that is dead may vary."""
_GROSS = 0.6
"""Residual over the larger of both: friction that the robot's file lacks, and its usual errors, are less."""
_FAR = 3.0
"""Times what was measured that no friction explains: it adds to what a motor gives where the joint moves."""
_NOISE = 1.5
"""Times the noise found that may be there: of velocities, whose noise is of several sizes, it is found to that."""
_ALIKE = 0.9
"""Correlation from which one is a multiple of the other."""


@dataclass(frozen=True)
class MeasuredTorque:
    """One joint's torque as the log has it, beside what its motion takes."""

    joint: str
    unit: str
    computed: float
    """Root mean square over the rows."""
    measured: float
    residual: float
    """Root mean square of what was measured, less what is computed."""
    noise: float
    """Root mean square of what the log's noise adds to the computed."""
    gain: float
    """What is measured over what is computed, by least squares, an offset aside."""
    correlation: float
    peak: float
    """The largest that was measured, with its sign."""
    time: float
    """When [s]."""
    dead: bool
    """The column never changes."""
    matters: bool
    """The joint's torques are no small part of the robot's."""

    @property
    def differs(self) -> bool:
        """Whether the two are grossly different, be it by noise."""
        return self.matters and not self.dead and self.residual > _GROSS * max(self.computed, self.measured)

    @property
    def disagrees(self) -> bool:
        """Whether the two are grossly different, by more than noise explains."""
        beyond = _without(self.residual, self.noise)
        return self.differs and beyond > _GROSS * max(self._true, self.measured)

    @property
    def contradicts(self) -> bool:
        """Whether nothing that a robot's file may lack explains the difference."""
        opposite = self.correlation < -_ALIKE
        scaled = self.correlation > _ALIKE and not 1 / _FAR < self.gain < _FAR
        return self.disagrees and (opposite or scaled or self._true > _FAR * self.measured)

    @property
    def _true(self) -> float:
        return _without(self.computed, self.noise)

    @property
    def words(self) -> str:
        """How they differ, and what may be the reason."""
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
    """A root mean square less that of independent noise, which is known to a half."""
    return math.sqrt(max(0.0, size**2 - (_NOISE * noise) ** 2))


class MeasuredTally:
    """Running sums over rows that come in any portions."""

    def __init__(self, columns: int) -> None:
        self._rows = 0
        self._sums, self._noise = np.zeros((5, columns)), np.zeros(columns)
        self._peak, self._sign = Extreme(columns), np.ones(columns)
        self._least, self._most = np.full(columns, np.inf), np.full(columns, -np.inf)

    def add(self, time: Array, computed: Array, measured: Array, sigma: Array) -> None:
        """Take in times (n,) and torques (n, columns), computed and as the log has them, and the deviation of the computed."""
        c, m = computed, measured
        self._noise += (sigma**2).sum(axis=0)
        self._rows += len(time)
        self._sums += [x.sum(axis=0) for x in (c, m, c * c, m * m, c * m)]
        for joint, row in self._peak.add(time, np.abs(m)):
            self._sign[joint] = np.sign(m[row, joint]) or 1.0
        self._least, self._most = np.minimum(self._least, m.min(axis=0)), np.maximum(self._most, m.max(axis=0))

    @property
    def misfit(self) -> float:
        """The sum over joints of the residual's share of the squares; 0 to 2 each."""
        _, _, cc, mm, cm = self._sums
        total = cc + mm
        return float(np.where(total > 0, (total - 2 * cm) / np.where(total > 0, total, 1.0), 0.0).sum())

    def result(self, names: tuple[str, ...], units: tuple[str, ...]) -> tuple[MeasuredTorque, ...]:
        """The comparison of each joint; none where no row came."""
        if not self._rows:
            return ()
        n = self._rows
        c, m, cc, mm, cm = self._sums
        computed, measured = np.sqrt(cc / n), np.sqrt(mm / n)
        noise = np.sqrt(self._noise / n)
        residual = np.sqrt(np.maximum(cc + mm - 2 * cm, 0.0) / n)
        vc, vm, v = (np.maximum(cc - c * c / n, 0.0), np.maximum(mm - m * m / n, 0.0), cm - c * m / n)
        gain = np.where(vc > 0, v / np.where(vc > 0, vc, 1.0), 0.0)
        both = np.sqrt(vc * vm)
        correlation = np.where(both > 0, v / np.where(both > 0, both, 1.0), 0.0)
        size = np.maximum(computed, measured)
        kinds = np.array(units)
        largest = np.array([size[kinds == unit].max() for unit in units])
        dead = self._most - self._least <= _STANDS * np.maximum(np.abs(self._most), np.abs(self._least))
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
                peak=float(self._sign[k] * self._peak.value[k]),
                time=float(self._peak.time[k]),
                dead=bool(dead[k]),
                matters=bool(size[k] > _MATTERS * largest[k]),
            )
            for k, name in enumerate(names)
        )
