"""Rows of equations of one chunk of a log: the rows that :class:`FilteredRows` makes of a log in memory, a stretch at a time.

Beside the groups' columns stand those of the settings that were chosen on an excerpt, the derivatives of the equation by the
clock's offset and by the speeds of friction: in a fit of all rows the errors of that choice are unknowns like others,

    τ(t + shift) = W x - δ_shift dτ/dt + Σ_j δ_j ∂(W x_0)/∂v_0j.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..typing import Array
from .base_columns import BaseColumns
from .filtered_rows import of_springs
from .log_chunks import Chunk
from .parameter_groups import BaseParameters
from .setting_trial import FitSettings
from .zero_phase import ROW_RATE, STATE_RATE, Filtered, border_of, low_pass, states_below_of

PERIODS = 16
"""Of the cut-off, that a filter reaches to either side: what comes from beyond is below 1e-16."""
_STATES = 8192
FASTER = 0.1
"""Share of a friction speed that its derivative is taken over."""


@dataclass(frozen=True, eq=False)
class RowFrame:
    """What rows of all logs are made with, so that they add up.

    Attributes
    ----------
    base : BaseParameters
    settings : FitSettings
    x : (r,) array, groups that an excerpt gave: where derivatives are taken
    sigma : (nv,) array, sizes of the residuals
    dead : (nv,) bool array, joints without a torque
    free_shift, free_speed : bool, whether the clock's offset and the speeds of friction were chosen
    robust : bool, whether large residuals count less
    """

    base: BaseParameters
    settings: FitSettings
    x: Array
    sigma: Array
    dead: Array
    free_shift: bool
    free_speed: bool
    robust: bool

    @cached_property
    def columns(self) -> BaseColumns:
        """Places of the entries."""
        return BaseColumns.of(self.base)

    @cached_property
    def speeds(self) -> list[tuple[int, Array]]:
        """Of each friction speed that was chosen a column of it, and the joints that it is in."""
        found = self.base.unknown.coulomb_columns(self.base.kept) if self.free_speed else []
        return list({int(np.flatnonzero(joints)[-1]): (c, joints) for c, joints in reversed(found)}.values())[::-1]

    @property
    def extra(self) -> int:
        """How many columns of settings there are."""
        return int(self.free_shift) + len(self.speeds)

    @cached_property
    def felt(self) -> tuple[Array, ...]:
        """Of each joint the columns, of groups and then of settings, that its rows have entries in."""
        r, found = self.base.count, list[Array]()
        for j, groups in enumerate(self.columns.groups):
            mine = [r] if self.free_shift else []
            mine += [r + int(self.free_shift) + k for k, (_, joints) in enumerate(self.speeds) if joints[j]]
            found.append(np.concatenate([groups, np.array(mine, int)]))
        return tuple(found)

    def margin(self, rate: float) -> int:
        """Samples on each side that a chunk needs besides its own."""
        return math.ceil((2 * PERIODS / self.settings.cutoff + abs(self.settings.shift)) * rate) + 16


@dataclass(frozen=True, eq=False)
class JointRows:
    """Rows of one portion: times (n,) [s], and of each joint the entries (n, r_j + 1), torques in the last column."""

    time: Array
    entries: tuple[Array, ...]


def rows_of(frame: RowFrame, chunk: Chunk) -> Iterator[JointRows]:
    """The rows that are the chunk's own, in portions of states that stay in the processor's cache."""
    cutoff, rate = frame.settings.cutoff, 1.0 / chunk.step
    every = max(1, math.floor(rate / (STATE_RATE * cutoff)))
    states, number = _states(chunk, cutoff, every)
    total = -(-chunk.count // every)
    apart = max(1, math.floor(states.rate / (ROW_RATE * cutoff)))
    border = border_of(states.rate, cutoff, total, cut=chunk.cut)
    first, last = -(-chunk.own[0] // every), min(-(-chunk.own[1] // every), total - border)
    first = border + max(0, -(-(first - border) // apart)) * apart
    wanted = np.arange(first, max(first, last), apart) - number
    wanted = wanted[(wanted >= 0) & (wanted < len(states.time))]
    if not wanted.size:
        return
    torques = _Torques(frame, states)
    margin = int(PERIODS * states.rate / cutoff) + 1
    for begin in range(int(wanted[0]), int(wanted[-1]) + 1, _STATES):
        mine = wanted[(wanted >= begin) & (wanted < begin + _STATES)]
        if mine.size:
            span = slice(max(0, begin - margin), min(len(states.time), begin + _STATES + margin))
            yield _portion(frame, states, torques, span, mine)


def _states(chunk: Chunk, cutoff: float, every: int) -> tuple[Filtered, int]:
    """States on the stretch's own grid of every so many samples, and the number of the first."""
    number = -(-chunk.first // every)
    time = chunk.begin + chunk.step * (chunk.first + np.arange(len(chunk.q)))
    return states_below_of(
        time, chunk.q, chunk.tau, chunk.step, cutoff, slice(number * every - chunk.first, None, every)
    ), number


class _Torques:
    """Torques of a chunk's states, low-passed once more as the columns are, and their slope."""

    def __init__(self, frame: RowFrame, s: Filtered) -> None:
        from scipy.interpolate import CubicSpline

        self._spline = CubicSpline(s.time, low_pass(s.tau, frame.settings.cutoff, s.rate))
        self._span, self._shift = (float(s.time[0]), float(s.time[-1])), frame.settings.shift

    def at(self, time: Array) -> tuple[Array, Array]:
        """(n, nv) both, at times of positions."""
        there = np.clip(time + self._shift, *self._span)
        return self._spline(there), self._spline(there, 1)


def _portion(frame: RowFrame, s: Filtered, torques: _Torques, span: slice, wanted: Array) -> JointRows:
    base, settings, columns = frame.base, frame.settings, frame.columns
    q, dq, ddq = s.q[span], s.dq[span], s.ddq[span]
    at = wanted - span.start
    entries = low_pass(columns.rows(q, dq, ddq, settings.friction_speed), settings.cutoff, s.rate)[at]
    tau, slope = torques.at(s.time[wanted])
    if base.unknown.model.springs:
        tau = tau - low_pass(of_springs(base, q, dq, ddq), settings.cutoff, s.rate)[at]
    changes = [_slower(frame, s, span, joints)[at] for _, joints in frame.speeds]
    found = []
    for j, place in enumerate(columns.slices):
        beside = [slope[:, j]] if frame.free_shift else []
        beside += [change[:, j] for change, (_, joints) in zip(changes, frame.speeds, strict=True) if joints[j]]
        whole = np.column_stack([entries[:, place], *beside, tau[:, j]])
        found.append(np.zeros_like(whole) if frame.dead[j] else whole)
    return JointRows(s.time[wanted], tuple(found))


def _slower(frame: RowFrame, s: Filtered, span: slice, joints: Array) -> Array:
    """(n, nv) what W x_0 changes by when the friction speed of the last of these joints grows by a tenth of itself."""
    unknown, owner = frame.base.unknown, int(np.flatnonzero(joints)[-1])
    speed = frame.settings.friction_speed
    faster = np.where(np.arange(len(speed)) == owner, 1.0 + FASTER, 1.0) * speed
    states = s.q[span], s.dq[span], s.ddq[span]
    found = np.zeros(states[1].shape)
    for column, mine in unknown.coulomb_columns(frame.base.kept):
        if int(np.flatnonzero(mine)[-1]) != owner:
            continue
        kept = frame.base.kept[column : column + 1]
        change = unknown.columns(kept, *states, faster)[..., 0] - unknown.columns(kept, *states, speed)[..., 0]
        found[:, mine] += low_pass(change[:, mine], frame.settings.cutoff, s.rate) * frame.x[column]
    return found
