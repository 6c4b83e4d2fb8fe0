"""Rows of equations τ = W x from logs: states below a cut-off, columns and torques low-passed alike, then fewer rows.

Filtering both sides of an equation alike leaves it true, whatever the columns are (Gautier's parallel decimation, "Dynamic
identification of robots with power model", ICRA 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..typing import Array
from .base_columns import BaseColumns
from .parameter_groups import BaseParameters
from .zero_phase import Filtered, SteadySamples, kept_rows, low_pass, states_below

_CHUNK = 8192
"""States that columns are made for at a time."""
_PERIODS = 12
"""Of the cut-off, that a filter reaches to either side."""
MOST_ROWS = 10_000
"""Of all logs together: 46 MB for seven joints."""
_JUDGED_ROWS = 2500
"""States of all logs that predictions of different cut-offs are compared in."""


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
    states: list[Filtered]
    slices: list[slice]
    dead: Array | None = None
    _torques: list[Any] = field(default_factory=list)
    _coulomb: dict[tuple[int, float], Array] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        cutoff: float,
        friction_speed: Array,
        most: float = MOST_ROWS,
    ) -> FilteredRows:
        """Rows of logs below a cut-off.

        Parameters
        ----------
        base : BaseParameters
        samples : sequence of SteadySamples
        cutoff : float [Hz]
        friction_speed : (nv,) array [rad/s or m/s]
        most : float, rows of all logs together

        Returns
        -------
        rows : FilteredRows
        """
        W, known, times, logs = list[Array](), list[Array](), list[Array](), list[Array]()
        states, slices = list[Filtered](), list[slice]()
        total = sum(log.seconds for log in samples)
        for k, log in enumerate(samples):
            s = states_below(log, cutoff)
            rows = kept_rows(s, cutoff, max(1.0, most * log.seconds / total))
            w, fixed = _columns(base, s, rows, cutoff, friction_speed)
            W.append(w)
            known.append(fixed)
            times.append(s.time[rows])
            logs.append(np.full(len(w), k))
            states.append(s)
            slices.append(rows)
        return cls(
            base,
            cutoff,
            np.concatenate(W),
            np.concatenate(times),
            np.concatenate(logs),
            np.concatenate(known),
            states,
            slices,
        )

    @property
    def nbytes(self) -> int:
        """What it takes in memory: columns, states, and splines of the torques, which are four times their size."""
        return int(self.W.nbytes + sum(8 * s.tau.nbytes for s in self.states))

    def torques(self, shift: float) -> Array:
        """(m, nv) torques that are ``shift`` seconds later in the log than the positions of the rows, springs taken off."""
        from scipy.interpolate import CubicSpline

        if not self._torques:
            self._torques = [CubicSpline(s.time, low_pass(s.tau, self.cutoff, s.rate)) for s in self.states]
        found = [
            spline(np.clip(s.time[rows] + shift, s.time[0], s.time[-1]))
            for spline, s, rows in zip(self._torques, self.states, self.slices, strict=True)
        ]
        tau = np.asarray(np.concatenate(found) - self.known)
        if self.dead is not None:
            tau[:, self.dead] = 0.0
        return tau

    def coulomb(self, column: int, joints: Array, friction_speed: Array) -> Array:
        """(m, nv) the column of Coulomb friction for other speeds of friction."""
        key = (column, float(friction_speed[int(np.flatnonzero(joints)[-1])]))
        if key not in self._coulomb:
            self._coulomb[key] = self._coulomb_column(column, joints, friction_speed)
        return self._coulomb[key]

    def _coulomb_column(self, column: int, joints: Array, friction_speed: Array) -> Array:
        kept = self.base.kept[column : column + 1]
        found = list[Array]()
        for s, rows in zip(self.states, self.slices, strict=True):
            w = self.base.unknown.columns(kept, s.q, s.dq, s.ddq, friction_speed)[..., 0]
            w[:, joints] = low_pass(w[:, joints], self.cutoff, s.rate)
            found.append(w[rows])
        whole = np.concatenate(found)
        if self.dead is not None:
            whole[:, self.dead] = 0.0
        return whole

    @property
    def speed(self) -> Array:
        """(m, nv) velocities of the joints in the rows."""
        return np.concatenate([s.dq[rows] for s, rows in zip(self.states, self.slices, strict=True)])

    @property
    def acceleration(self) -> Array:
        """(m, nv) accelerations of the joints in the rows."""
        return np.concatenate([s.ddq[rows] for s, rows in zip(self.states, self.slices, strict=True)])


def _columns(
    base: BaseParameters, s: Filtered, rows: slice, cutoff: float, friction_speed: Array
) -> tuple[Array, Array]:
    """The kept columns (m, nv, r) and what springs do (m, nv), low-passed, at the rows; in chunks with what filters reach."""
    wanted = np.arange(len(s.time))[rows]
    margin = int(_PERIODS * s.rate / cutoff) + 1
    nv = s.dq.shape[1]
    W = np.zeros((len(wanted), nv, base.count))
    known = np.zeros((len(wanted), nv))
    columns = BaseColumns.of(base)
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
    def of(
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
