"""Rows of equations τ = W x from logs: regressor columns by one kernel, states and torques filtered alike, then decimated.

Row j of τ = W x has entries for the groups that joint j feels, and zeros else; of seven joints with 69 groups each 214 of 483
are left. The kernel gives those of the bodies, traced with all else folded away; drives' columns are put beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ..algorithms.inverse_dynamics import regressor
from ..ir.tracer import trace
from ..robot.engine import compiled
from ..typing import Array
from .parameters import BaseParameters, speed_owner
from .zero_phase import Filtered, SteadySamples, kept_rows, low_pass, states_below


@dataclass(frozen=True, eq=False)
class BaseColumns:
    """Nonzero entries of rows of equations, and their places.

    Attributes
    ----------
    base : BaseParameters
    groups : tuple of (r_j,) arrays, the groups that each joint feels
    slices : tuple of slice, where the entries of each joint are in a row
    """

    base: BaseParameters
    groups: tuple[Array, ...]
    slices: tuple[slice, ...]

    @classmethod
    def from_parameters(cls, base: BaseParameters) -> BaseColumns:
        """Entries of all groups."""
        groups = tuple(np.flatnonzero(felt) for felt in base.felt)
        ends = np.cumsum([0, *(len(g) for g in groups)]).tolist()
        return cls(base, groups, tuple(slice(a, b) for a, b in pairwise(ends)))

    @property
    def count(self) -> int:
        """Number of entries of a row."""
        return self.slices[-1].stop if self.slices else 0

    def rows(self, q: Array, dq: Array, ddq: Array, friction_speed: Array) -> Array:
        """Entries of the columns in states."""
        unknown, kept = self.base.unknown, self.base.kept
        found = np.empty((len(q), self.count))
        bodies = np.concatenate(
            [
                s.start + np.flatnonzero(unknown.of_bodies[kept[g]] >= 0)
                for g, s in zip(self.groups, self.slices, strict=True)
            ]
        ).astype(int)
        if bodies.size:
            found[:, bodies] = self._kernel(q, dq, ddq)
        for k in np.flatnonzero(unknown.of_bodies[kept] < 0).tolist():
            value, share = unknown.drive(int(kept[k]), dq, ddq, friction_speed)
            for j in np.flatnonzero(self.base.felt[:, k]).tolist():
                found[:, self.slices[j].start + int(np.searchsorted(self.groups[j], k))] = value * share[j]
        return found

    @property
    def _kernel(self) -> Any:
        """Entries of the bodies, by states."""
        unknown, kept = self.base.unknown, self.base.kept
        pairs = [
            (j, int(unknown.of_bodies[kept[k]]))
            for j, g in enumerate(self.groups)
            for k in g
            if unknown.of_bodies[kept[k]] >= 0
        ]
        rows, columns = np.array(pairs, int).reshape(-1, 2).T

        def made() -> Any:
            model = unknown.model

            def entries(q: Any, dq: Any, ddq: Any) -> Any:
                return regressor(model, q, dq, ddq)[rows, columns]

            inputs = [("q", (model.nq,)), ("dq", (model.nv,)), ("ddq", (model.nv,))]
            return compiled(
                trace(entries, inputs, ["entries"]), "base_columns", f"Columns of the groups of {model.name}."
            )

        return unknown.robot.engine.cached(("base columns", tuple(pairs)), made)


# ── Filtered rows of logs

# Filtering both sides of an equation alike leaves it true, whatever the columns are (Gautier's parallel decimation, "Dynamic
# identification of robots with power model", ICRA 1997).

_CHUNK = 8192
"""States that columns are made for at a time."""
_PERIODS = 12
"""Periods of the cut-off that a filter reaches to either side."""
MOST_ROWS = 10_000
"""Most rows of all logs together: 46 MB for seven joints."""
_JUDGED_ROWS = 2500
"""States of all logs that predictions of different cut-offs are compared in."""


@dataclass(eq=False)
class _LogRows:
    """States of one log: more than rows if friction of another speed, or of another time, is needed."""

    time: Array
    rate: float
    rows: slice
    dq: Array
    acceleration: Array
    """Accelerations of the rows."""
    _tau: Array
    """Low-passed twice; none once they are in the spline."""

    @cached_property
    def spline(self) -> Any:
        """Spline of the torques."""
        from scipy.interpolate import make_interp_spline

        found, self._tau = make_interp_spline(self.time, self._tau), self._tau[:0]
        return found

    def torques(self, shift: float) -> Array:
        """(m, nv) at the rows, from ``shift`` seconds later."""
        return np.asarray(self.spline(np.clip(self.time[self.rows] + shift, self.time[0], self.time[-1])))


@dataclass(eq=False)
class FilteredRows:
    """Rows of several logs at one cut-off.

    Attributes
    ----------
    base : BaseParameters
    cutoff : float [Hz]
    W : (m, nv, r) array
    time : (m,) array [s], of its own log
    log : (m,) array, which log each row is of
    """

    base: BaseParameters
    cutoff: float
    W: Array
    time: Array
    log: Array
    known: Array
    logs: list[_LogRows]
    dead: Array | None = None
    _coulomb: dict[tuple[int, float], Array] = field(default_factory=dict)

    @classmethod
    def from_samples(
        cls,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        cutoff: float,
        friction_speed: Array,
        most: float = MOST_ROWS,
    ) -> FilteredRows:
        """Rows of logs below a cut-off."""
        W, known, times, logs = list[Array](), list[Array](), list[Array](), list[Array]()
        parts = list[_LogRows]()
        total = sum(log.seconds for log in samples)
        for k, log in enumerate(samples):
            s = states_below(log, cutoff)
            rows = kept_rows(s, cutoff, max(1.0, most * log.seconds / total), cut=log.cut)
            w, fixed = _columns(base, s, rows, cutoff, friction_speed)
            W.append(w)
            known.append(fixed)
            times.append(s.time[rows])
            logs.append(np.full(len(w), k))
            parts.append(
                _LogRows(s.time, s.rate, rows, s.dq.copy(), s.ddq[rows].copy(), low_pass(s.tau, cutoff, s.rate))
            )
        return cls(
            base,
            cutoff,
            _joined(W),
            np.concatenate(times),
            np.concatenate(logs),
            np.concatenate(known),
            parts,
        )

    @property
    def nbytes(self) -> int:
        """Memory of columns, velocities, torques as a spline, and friction of other speeds [bytes]."""
        friction = sum(column.nbytes for column in self._coulomb.values())
        return int(self.W.nbytes + friction + sum(x.time.nbytes + 2 * x.dq.nbytes for x in self.logs))

    def torques(self, shift: float) -> Array:
        """(m, nv) torques that are ``shift`` seconds later in the log than the positions of the rows, springs taken off."""
        found = [log.torques(shift) for log in self.logs]
        tau = np.asarray(np.concatenate(found) - self.known)
        if self.dead is not None:
            tau[:, self.dead] = 0.0
        return tau

    def coulomb(self, column: int, joints: Array, friction_speed: Array) -> Array:
        """(m, nv) the column of Coulomb friction for other speeds of friction."""
        key = (column, float(friction_speed[speed_owner(joints)]))
        if key not in self._coulomb:
            self._coulomb[key] = self._coulomb_column(column, joints, friction_speed)
        return self._coulomb[key]

    def _coulomb_column(self, column: int, joints: Array, friction_speed: Array) -> Array:
        k, found = int(self.base.kept[column]), list[Array]()
        for log in self.logs:
            value, share = self.base.unknown.drive(k, log.dq, log.dq, friction_speed)  # which no acceleration changes
            w = np.zeros((len(log.acceleration), len(share)))
            w[:, joints] = low_pass(value, self.cutoff, log.rate)[log.rows, None] * share[joints]
            found.append(w)
        whole = np.concatenate(found)
        if self.dead is not None:
            whole[:, self.dead] = 0.0
        return whole

    @property
    def speed(self) -> Array:
        """(m, nv) velocities of the joints in the rows."""
        return np.concatenate([log.dq[log.rows] for log in self.logs])

    @property
    def acceleration(self) -> Array:
        """(m, nv) accelerations of the joints in the rows."""
        return np.concatenate([log.acceleration for log in self.logs])


def _joined(parts: list[Array]) -> Array:
    """One array of parts, which are let go one after another: never twice in memory. The list is empty then."""
    if len(parts) == 1:
        return parts.pop()
    whole, at = np.empty((sum(map(len, parts)), *parts[0].shape[1:])), 0
    while parts:
        part = parts.pop(0)
        whole[at : at + len(part)] = part
        at += len(part)
    return whole


def _columns(
    base: BaseParameters, s: Filtered, rows: slice, cutoff: float, friction_speed: Array
) -> tuple[Array, Array]:
    """The kept columns (m, nv, r) and what springs do (m, nv), low-passed, at the rows; in chunks with what filters reach."""
    wanted = np.arange(len(s.time))[rows]
    margin = int(_PERIODS * s.rate / cutoff) + 1
    nv = s.dq.shape[1]
    W = np.zeros((len(wanted), nv, base.count))
    known = np.zeros((len(wanted), nv))
    columns = BaseColumns.from_parameters(base)
    for begin in range(0, len(s.time), _CHUNK):
        inner = np.flatnonzero((wanted >= begin) & (wanted < begin + _CHUNK))
        if not inner.size:
            continue
        a, b = max(0, begin - margin), min(len(s.time), begin + _CHUNK + margin)
        states, at = (s.q[a:b], s.dq[a:b], s.ddq[a:b]), wanted[inner] - a
        entries = low_pass(columns.rows(*states, friction_speed), cutoff, s.rate)[at]
        for j, (groups, place) in enumerate(zip(columns.groups, columns.slices, strict=True)):
            W[np.ix_(inner, np.array([j]), groups)] = entries[:, None, place]
        if base.unknown.model.springs:
            known[inner] = low_pass(of_springs(base, *states), cutoff, s.rate)[at]
    return W, known


def of_springs(base: BaseParameters, q: Array, dq: Array, ddq: Array) -> Array:
    """(n, nv) what springs do in states."""
    robot = base.unknown.robot
    if not base.unknown.model.springs:
        return np.zeros(dq.shape)
    return np.asarray(robot.inverse_dynamics(q, dq, ddq)) - robot.regressor(q, dq, ddq) @ robot.parameters


@dataclass(eq=False)
class JudgedStates:
    """States in which predictions of different cut-offs are compared: with torques that hardly any filter has touched."""

    W: Array
    """(m, nv, r) from positions below the cut-off that is judged."""
    known: Array
    log: Array
    time: Array
    states: list[Filtered]

    @classmethod
    def from_samples(
        cls, base: BaseParameters, samples: Sequence[SteadySamples], cutoff: float, friction_speed: Array
    ) -> JudgedStates:
        """At the same times for every cut-off."""
        total = sum(s.seconds for s in samples)
        parts = [states_below(s, cutoff, _JUDGED_ROWS / total) for s in samples]
        columns = [base.unknown.columns(base.kept, s.q, s.dq, s.ddq, friction_speed) for s in parts]
        return cls(
            np.concatenate(columns),
            np.concatenate([of_springs(base, s.q, s.dq, s.ddq) for s in parts]),
            np.repeat(np.arange(len(parts)), [len(s.time) for s in parts]),
            np.concatenate([s.time for s in parts]),
            parts,
        )
