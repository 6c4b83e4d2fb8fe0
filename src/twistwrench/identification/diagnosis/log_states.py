"""States of logs below a cut-off, with the columns of the parameters in their torques.

Columns of the torques have two parts: columns of the bodies (the regressor), and factors of the drives, which are motor
inertias, friction and offsets.
"""

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
_PARAMETERS_PER_BODY = 10
_FIELDS_OF_COLUMNS = {
    "bodies": ("q", "dq", "ddq", "gravity", "weightless", "rows"),
    "drives": ("dq", "ddq", "pieces", "friction_speed", "rows", "lagging"),
    "columns": ("q", "dq", "ddq", "gravity", "weightless", "rows", "pieces", "friction_speed", "lag"),
}
"""Fields on which each cached property depends."""


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
    friction_speed : (nv,) array, speed v_0 of Coulomb friction [rad/s or m/s]
    gravity : (3,) array, in the base frame [m/s²]
    gain : (nv,) array, factors of the predicted torques
    logs : sequence of int, number of the log of each piece, from 1; 0 if there is only one log
    lag : float, time constant of the low-pass of the torques [s]
    shift : float, delay of the logged torques [s]
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
        """States of samples, with at most ``most`` rows; if ``whole``, at all samples, with positions and torques unchanged."""
        states_by_piece: list[Any] = []
        rows: list[Array] = []
        pieces: list[slice] = []
        unfiltered: list[Array] = []
        jumps: list[tuple[int, int, float]] = []
        begin = 0  # index of the piece's first state among all states
        selected = states_with_rows(samples, cutoff, most, whole=whole)
        for piece_index, (piece, filtered, selected_rows) in enumerate(selected):
            states_by_piece.append(replace(filtered, q=piece.q, tau=piece.tau) if whole else filtered)
            end = begin + len(filtered.time)
            rows.append(np.arange(begin, end)[selected_rows])
            pieces.append(slice(begin, end))
            begin = end
            sample_times = piece.start + np.arange(len(piece.q)) / piece.rate
            positions = np.empty((len(filtered.time), piece.q.shape[1]))
            for joint, q in enumerate(piece.q.T):
                positions[:, joint] = np.interp(filtered.time, sample_times, q)
                jump = jump_of(q)
                if jump is not None:
                    jump_time = piece.start + (jump - 0.5) / piece.rate  # in the middle between two samples
                    jumps.append((joint, piece_index, jump_time))
            unfiltered.append(positions)
        nv = base.unknown.model.nv
        state_counts = [len(states.time) for states in states_by_piece]

        def values(name: str) -> Array:
            """Values of a field of all pieces."""
            return np.concatenate([getattr(states, name) for states in states_by_piece])

        return cls(
            base=base,
            cutoff=cutoff,
            pieces=pieces,
            rows=np.concatenate(rows),
            time=values("time"),
            piece=np.repeat(np.arange(len(states_by_piece)), state_counts),
            rate=np.repeat([states.rate for states in states_by_piece], state_counts),
            q=values("q"),
            dq=values("dq"),
            ddq=values("ddq"),
            tau=values("tau"),
            friction_speed=friction_speed,
            gravity=np.asarray(base.unknown.model.gravity, float),
            gain=np.ones(nv),
            logs=[piece.log for piece in samples],
            unfiltered=np.concatenate(unfiltered),
            jumps=jumps,
        )

    def low_passed(self, x: Array) -> Array:
        """Low-pass values (n, ...) of the states at the cut-off, piece by piece."""
        if not self.pieces:
            return x
        filtered: list[Array] = []
        for piece in self.pieces:
            rate = float(self.rate[piece.start])
            filtered.append(low_pass(x[piece], self.cutoff, rate))
        return np.concatenate(filtered)

    def slope(self, x: Array) -> Array:
        """Time derivatives (n, ...) of values of the states, piece by piece."""
        if not self.pieces:
            return np.zeros_like(x)
        return np.concatenate([np.gradient(x[piece], self.time[piece], axis=0) for piece in self.pieces])

    @cached_property
    def measured_torques(self) -> Array:
        """(m, nv) measured torques at the rows, without the torques of springs, which are known."""
        springs = spring_torques(self.base, self.q[self.rows], self.dq[self.rows], self.ddq[self.rows])
        return np.asarray(self.shifted_torques[self.rows] - springs)

    @cached_property
    def shifted_torques(self) -> Array:
        """(n, nv) measured torques, corrected for the time shift."""
        if not self.shift:
            return self.tau
        return np.concatenate([self._shifted(piece) for piece in self.pieces])

    def _shifted(self, piece: slice) -> Array:
        """(n, nv) torques of a piece, ``shift`` seconds later; at its ends, the first and the last torque."""
        time = self.time[piece]
        shifted_time = np.clip(time + self.shift, time[0], time[-1])
        return UniformSpline.from_samples(time, self.tau[piece])(shifted_time)

    @property
    def lagging(self) -> bool:
        """True if the torques passed a low-pass, which also depends on the states between the rows."""
        return self.lag > 0.0

    @cached_property
    def columns(self) -> Array:
        """(m, nv, r) columns of the groups at the rows, without gains, with friction low-passed like the torques."""
        if not self.lagging:
            return self._group_columns(self.bodies, self.drives)

        def columns_of_states(span: slice) -> Array:
            return self._group_columns(self._body_columns(span), self.drives[span])

        return self._low_pass_at_rows(columns_of_states)

    def _group_columns(self, bodies: Array, drives: Array) -> Array:
        """Columns (n, nv, r) of the groups from columns of the body parameters and factors of the drives."""
        unknown = self.base.unknown
        parameters = self.base.kept  # index of each group's parameter
        drive_groups = self.base.drives
        body_columns = np.maximum(unknown.of_bodies[parameters], 0)  # -1 of drives: any column, which is replaced below
        W = np.take(bodies, body_columns, axis=2)
        W[:, :, drive_groups] = drives[:, None] * unknown.shares[parameters[drive_groups]].T
        return W

    def predicted_torques(self, x: Array) -> Array:
        """(m, nv) torques W x at the rows."""
        if not self.lagging:
            body_torques, drive_torques = self._parts(x)
            return np.asarray(self.gain * (body_torques + drive_torques))
        body_values = self._body_values(x)
        drive_torques = self._drive_torques(x)

        def torques_of_states(span: slice) -> Array:
            return np.asarray(self._body_columns(span) @ body_values + drive_torques[span])

        return np.asarray(self.gain * self._low_pass_at_rows(torques_of_states))

    def _parts(self, x: Array) -> tuple[Array, Array]:
        """Torques (n, nv) of the bodies and of the drives by groups x (r,)."""
        return self.bodies @ self._body_values(x), self._drive_torques(x)

    def _body_values(self, x: Array) -> Array:
        """Values of all body parameters by groups x (r,): each group is the value of one parameter, the others are 0."""
        unknown = self.base.unknown
        values = np.zeros(_PARAMETERS_PER_BODY * len(unknown.model.bodies))
        body_columns = unknown.of_bodies[self.base.kept]  # of each group; -1 for groups of drives
        is_body_group = body_columns >= 0
        values[body_columns[is_body_group]] = x[is_body_group]
        return values

    def _drive_torques(self, x: Array) -> Array:
        """Torques (n, nv) of the drives by groups x (r,)."""
        drive_groups = self.base.drives
        shares = self.base.unknown.shares[self.base.kept[drive_groups]]  # of each drive's group in the joints' torques
        return np.asarray((self.drives * x[drive_groups]) @ shares)

    def _low_pass_at_rows(self, values: Callable[[slice], Array]) -> Array:
        """Low-passed values at the rows, from a function that returns the ``values`` of a range of states.

        It is called for short ranges, to limit memory. The low-pass has the time constant ``lag``, and starts anew in each
        piece.
        """
        values_at_rows: list[Array] = []
        for piece in self.pieces:
            lag_steps = self.lag * float(self.rate[piece.start])
            last_value = None
            for begin in range(piece.start, piece.stop, PORTION):
                span = slice(begin, min(piece.stop, begin + PORTION))
                y = lagged(values(span), lag_steps, last_value)
                last_value = y[-1]
                rows_of_span = self.rows[(self.rows >= begin) & (self.rows < span.stop)]
                values_at_rows.append(y[rows_of_span - begin])
        return np.concatenate(values_at_rows)

    @cached_property
    def bodies(self) -> Array:
        """Columns of the body parameters at the rows."""
        return self._body_columns(self.rows)

    def _body_columns(self, indices: Array | slice) -> Array:
        """Columns (n, nv, p) of the body parameters at some states."""
        states = (self.q[indices], self.dq[indices], self.ddq[indices])
        regressor = self.base.unknown.regressor
        Y = regressor(*states, self.gravity)
        if self.weightless:
            joints = list(self.weightless)
            Y_without_gravity = regressor(*states, 0.0 * self.gravity)
            Y[:, joints] = Y_without_gravity[:, joints]
        return np.asarray(Y)

    @cached_property
    def drives(self) -> Array:
        """Factors of the columns of motor inertias, friction and offsets: at the rows; if torques lag, in all states."""
        unknown = self.base.unknown
        indices = slice(None) if self.lagging else self.rows
        parameters = self.base.kept[self.base.drives]
        factors = unknown.drives(parameters, self.dq[indices], self.ddq[indices], self.friction_speed)
        kinds = np.array(unknown.kinds)[parameters]
        dry_columns = np.flatnonzero(np.isin(kinds, ("coulomb", "stribeck")))
        if dry_columns.size:  # dry friction jumps: it is low-passed like the torques
            dry_factors = unknown.drives(parameters[dry_columns], self.dq, self.ddq, self.friction_speed)
            factors[:, dry_columns] = self.low_passed(dry_factors)[indices]
        return factors

    def torques(self, x: Array) -> tuple[Array, Array]:
        """(n, nv) torques W x of all states, and (n, nv) the part of the bodies in them, computed in portions."""
        n = len(self.time)
        portions: list[Array] = []  # (2, states, nv) each
        for begin in range(0, n, PORTION):
            span = slice(begin, min(n, begin + PORTION))
            fields = {name: getattr(self, name)[span] for name in ("time", "piece", "rate", "q", "dq", "ddq", "tau")}
            portion = self.with_fields(**fields, rows=np.arange(span.stop - begin), pieces=(), lag=0.0)
            body_torques, drive_torques = portion._parts(x)
            total_and_body_torques = np.stack([body_torques + drive_torques, body_torques])
            portions.append(self.gain * total_and_body_torques)
        total_torques, all_body_torques = np.concatenate(portions, axis=1)
        return total_torques, all_body_torques

    def with_fields(self, **fields: Any) -> LogStates:
        """Copy with other values of some fields; columns that do not depend on them stay cached."""
        copy = replace(self, **fields)
        for columns, names in _FIELDS_OF_COLUMNS.items():
            is_unchanged = all(getattr(copy, name) is getattr(self, name) for name in names)
            if is_unchanged and columns in self.__dict__:
                copy.__dict__[columns] = self.__dict__[columns]
        return copy


_STEPS_BESIDE_JUMP = 5
"""Number of steps on either side of a jump that are not compared with it."""
_MIN_RATIO_TO_USUAL = 20.0
"""Departure of a jump from its neighbouring steps, over the usual departure (rms)."""
_MIN_RATIO_TO_SECOND = 3.0
"""Departure of a jump from its neighbouring steps, over the next largest departure."""


def jump_of(positions: Array) -> int | None:
    """Index of the first sample after a jump, if positions (n,) jump once and far beyond their other steps; else None."""
    steps = np.diff(positions)
    if len(steps) < 2 * _STEPS_BESIDE_JUMP:
        return None
    # departures[k] is of step k + 1, which leads from sample k + 1 to sample k + 2
    departures = np.abs(steps[1:-1] - 0.5 * (steps[:-2] + steps[2:]))
    k = int(departures.argmax())
    beside_jump = slice(max(0, k - _STEPS_BESIDE_JUMP), k + _STEPS_BESIDE_JUMP + 1)
    other_departures = np.delete(departures, beside_jump)
    if not other_departures.size:
        return None
    if departures[k] < _MIN_RATIO_TO_USUAL * np.sqrt((other_departures**2).mean()):
        return None
    if departures[k] < _MIN_RATIO_TO_SECOND * other_departures.max():
        return None
    return k + 2
