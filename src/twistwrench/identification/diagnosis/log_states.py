"""States of logs below a cut-off, with the columns of the parameters in their torques."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.estimation.filters import UniformSpline, lagged, low_pass
from ...core.typing import Array
from ..parameters import BaseParameters
from ..rows import SteadySamples, spring_torques, states_with_rows

PORTION = 2048
"""Number of states whose columns are computed together, to limit memory."""
_FIELDS_OF_COLUMNS = {
    "bodies": ("q", "dq", "ddq", "gravity", "weightless", "rows"),
    "drives": ("dq", "ddq", "pieces", "friction_speed", "rows", "lagging"),
    "columns": ("q", "dq", "ddq", "gravity", "weightless", "rows", "pieces", "friction_speed", "lag"),
}
"""Fields on which the columns depend."""


@dataclass(frozen=True, eq=False)
class LogStates:
    """States of logs below a cut-off, at 20 samples per period of the cut-off, and the rows of equations among them.

    Attributes
    ----------
    base : BaseParameters, independent of the direction of gravity
    cutoff : float [Hz]
    pieces : list of slice, states of each piece of a log without pauses
    rows : (m,) array, indices of the states that become rows
    time, piece : (n,) arrays, time [s] and index of the piece
    rate : float, states per second [Hz]
    q, dq, ddq, tau : (n, nv) arrays
    friction_speed : (nv,) array, v_0
    gravity : (3,) array
    gain : (nv,) array
    logs : sequence of int, number of the log of each piece, from 1; 0 if there is only one log
    lag : float, time constant of the low-pass of the torques [s]
    weightless : tuple of int, joints whose logged torques exclude gravity
    unfiltered : (n, nv) array, positions before the low-pass
    jumps : sequence of (joint, piece, time), jumps of positions
    """

    base: BaseParameters
    cutoff: float
    pieces: Sequence[slice]
    rows: Array
    time: Array
    piece: Array
    rate: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array
    friction_speed: Array
    gravity: Array
    gain: Array
    logs: Sequence[int]
    lag: float = 0.0
    shift: float = 0.0
    weightless: tuple[int, ...] = ()
    unfiltered: Array | None = None
    jumps: Sequence[tuple[int, int, float]] = ()

    @classmethod
    def from_samples(
        cls,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        cutoff: float,
        friction_speed: Array,
        most: float,
        *,
        whole: bool = False,
    ) -> LogStates:
        """Resample samples on steady clocks to at most ``most`` rows; if ``whole``, keep all samples with q and τ unchanged."""
        states, rows, pieces, unfiltered = list[Any](), list[Array](), list[slice](), list[Array]()
        jumps = list[tuple[int, int, float]]()
        begin = 0
        for piece, (one, s, kept) in enumerate(states_with_rows(samples, cutoff, most, whole=whole)):
            states.append(replace(s, q=one.q, tau=one.tau) if whole else s)
            end = begin + len(s.time)
            rows.append(np.arange(begin, end)[kept])
            pieces.append(slice(begin, end))
            begin = end
            sample_times = one.start + np.arange(len(one.q)) / one.rate
            positions = np.empty((len(s.time), one.q.shape[1]))
            for k, q in enumerate(one.q.T):
                positions[:, k] = np.interp(s.time, sample_times, q)
                jump = jump_of(q)
                if jump is not None:
                    jumps.append((k, piece, one.start + (jump - 0.5) / one.rate))
            unfiltered.append(positions)
        nv, counts = base.unknown.model.nv, [len(s.time) for s in states]

        def values(name: str) -> Array:
            return np.concatenate([getattr(s, name) for s in states])

        return cls(
            base,
            cutoff,
            pieces,
            np.concatenate(rows),
            values("time"),
            np.repeat(np.arange(len(states)), counts),
            np.repeat([s.rate for s in states], counts),
            values("q"),
            values("dq"),
            values("ddq"),
            values("tau"),
            friction_speed,
            np.asarray(base.unknown.model.gravity, float),
            np.ones(nv),
            [one.log for one in samples],
            unfiltered=np.concatenate(unfiltered),
            jumps=jumps,
        )

    def low_passed(self, x: Array) -> Array:
        """Low-pass values (n, ...) of the states at the cut-off, piece by piece."""
        if not self.pieces:
            return x
        return np.concatenate([low_pass(x[s], self.cutoff, float(self.rate[s.start])) for s in self.pieces])

    def slope(self, x: Array) -> Array:
        """Time derivatives of values (n, ...) of the states."""
        if not self.pieces:
            return np.zeros_like(x)
        return np.concatenate([np.gradient(x[s], self.time[s], axis=0) for s in self.pieces])

    @cached_property
    def measured_torques(self) -> Array:
        """(m, nv) measured torques at the rows, without the torques of springs."""
        known = spring_torques(self.base, self.q[self.rows], self.dq[self.rows], self.ddq[self.rows])
        return np.asarray(self.shifted_torques[self.rows] - known)

    @cached_property
    def shifted_torques(self) -> Array:
        """(n, nv) measured torques, corrected for the time shift."""
        if not self.shift:
            return self.tau
        return np.concatenate([self._shifted(s) for s in self.pieces])

    def _shifted(self, s: slice) -> Array:
        time = self.time[s]
        return UniformSpline.from_samples(time, self.tau[s])(np.clip(time + self.shift, time[0], time[-1]))

    @property
    def lagging(self) -> bool:
        """True if the torques passed a low-pass, which also depends on the states between the rows."""
        return self.lag > 0.0

    @cached_property
    def columns(self) -> Array:
        """(m, nv, r) columns of the groups at the rows, without gains, with friction low-passed like the torques."""
        if not self.lagging:
            return self._group_columns(self.bodies, self.drives)
        return self._low_pass_at_rows(lambda span: self._group_columns(self._body_columns(span), self.drives[span]))

    def _group_columns(self, bodies: Array, drives: Array) -> Array:
        """Columns (n, nv, r) of the groups from columns of the body parameters and factors of the drives."""
        kept, unknown = self.base.kept, self.base.unknown
        W = np.take(bodies, np.maximum(unknown.of_bodies[kept], 0), axis=2)
        W[:, :, self.base.drives] = drives[:, None] * unknown.shares[kept[self.base.drives]].T
        return W

    def predicted_torques(self, x: Array) -> Array:
        """(m, nv) torques W x at the rows."""
        if not self.lagging:
            bodies, drives = self._parts(x)
            return np.asarray(self.gain * (bodies + drives))
        body_values, drives = self._body_values(x), self._drive_torques(x)
        torques = self._low_pass_at_rows(lambda span: self._body_columns(span) @ body_values + drives[span])
        return np.asarray(self.gain * torques)

    def _parts(self, x: Array) -> tuple[Array, Array]:
        """Torques of the bodies and of the drives by groups x (r,)."""
        return self.bodies @ self._body_values(x), self._drive_torques(x)

    def _body_values(self, x: Array) -> Array:
        """Values of the body parameters, of those that represent groups x (r,)."""
        unknown = self.base.unknown
        values, columns = np.zeros(10 * len(unknown.model.bodies)), unknown.of_bodies[self.base.kept]
        values[columns[columns >= 0]] = x[columns >= 0]
        return values

    def _drive_torques(self, x: Array) -> Array:
        drives = self.base.drives
        return np.asarray((self.drives * x[drives]) @ self.base.unknown.shares[self.base.kept[drives]])

    def _low_pass_at_rows(self, values: Callable[[slice], Array]) -> Array:
        """Low-pass of the torques, at the rows, of ``values`` of ranges of the states, in portions to limit memory."""
        parts = list[Array]()
        for piece in self.pieces:
            steps, last = self.lag * float(self.rate[piece.start]), None
            for k in range(piece.start, piece.stop, PORTION):
                span = slice(k, min(piece.stop, k + PORTION))
                y = lagged(values(span), steps, last)
                last = y[-1]
                rows_of_span = self.rows[(self.rows >= k) & (self.rows < span.stop)]
                parts.append(y[rows_of_span - k])
        return np.concatenate(parts)

    @cached_property
    def bodies(self) -> Array:
        """Columns of the body parameters at the rows."""
        return self._body_columns(self.rows)

    def _body_columns(self, at: Array | slice) -> Array:
        """Columns (n, nv, p) of the body parameters at some states."""
        states = self.q[at], self.dq[at], self.ddq[at]
        Y = self.base.unknown.regressor(*states, self.gravity)
        if self.weightless:
            joints = list(self.weightless)
            Y[:, joints] = self.base.unknown.regressor(*states, 0.0 * self.gravity)[:, joints]
        return np.asarray(Y)

    @cached_property
    def drives(self) -> Array:
        """Factors of the columns of motor inertias, friction and offsets at the rows, or in all states for a low-pass."""
        unknown, at = self.base.unknown, slice(None) if self.lagging else self.rows
        parameters = self.base.kept[self.base.drives]
        factors = unknown.drives(parameters, self.dq[at], self.ddq[at], self.friction_speed)
        dry = np.flatnonzero(np.isin(np.array(unknown.kinds)[parameters], ("coulomb", "stribeck")))
        if dry.size:
            dry_factors = unknown.drives(parameters[dry], self.dq, self.ddq, self.friction_speed)
            factors[:, dry] = self.low_passed(dry_factors)[at]
        return factors

    def torques(self, x: Array) -> tuple[Array, Array]:
        """(n, nv) torques W x of all states, and the part of the bodies, computed in portions."""
        n, parts = len(self.time), list[Array]()
        for k in range(0, n, PORTION):
            span = slice(k, min(n, k + PORTION))
            fields = {name: getattr(self, name)[span] for name in ("time", "piece", "rate", "q", "dq", "ddq", "tau")}
            portion = self.with_fields(**fields, rows=np.arange(span.stop - k), pieces=(), lag=0.0)
            bodies, drives = portion._parts(x)
            parts.append(self.gain * np.stack([bodies + drives, bodies]))
        whole, bodies = np.concatenate(parts, axis=1)
        return whole, bodies

    def with_fields(self, **fields: Any) -> LogStates:
        """Copy with other values of some fields; columns that do not depend on them stay cached."""
        copy = replace(self, **fields)
        for columns, names in _FIELDS_OF_COLUMNS.items():
            if columns in self.__dict__ and all(getattr(copy, name) is getattr(self, name) for name in names):
                copy.__dict__[columns] = self.__dict__[columns]
        return copy


_STEPS_BESIDE = 5
"""Steps on both sides of a jump that are not compared with it."""
_MIN_JUMP, _MIN_RATIO_TO_SECOND = 20.0, 3.0
"""Ratios of the largest departure of a step of positions from its neighbours to the usual one, and to the next largest one."""


def jump_of(positions: Array) -> int | None:
    """Index of the sample (n,) at which a position jumps, once and far beyond its other steps; None if it does not."""
    steps = np.diff(positions)
    if len(steps) < 2 * _STEPS_BESIDE:
        return None
    departures = np.abs(steps[1:-1] - 0.5 * (steps[:-2] + steps[2:]))
    k = int(departures.argmax())
    others = np.delete(departures, slice(max(0, k - _STEPS_BESIDE), k + _STEPS_BESIDE + 1))
    if departures[k] < _MIN_JUMP * np.sqrt((others**2).mean()):
        return None
    if departures[k] < _MIN_RATIO_TO_SECOND * others.max():
        return None
    return k + 2
