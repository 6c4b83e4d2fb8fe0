"""The states that a run keeps on its way: room for all of them is made at the beginning, and filled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..typing import Array
from .events import Happening
from .result import SimulationResult

if TYPE_CHECKING:
    from ..robot import Robot


_AT_FIRST = 1_000_000
"""States that room is made for at the beginning, at most."""


class Record:
    """Times, states, accelerations and torques of each state kept, added all at once or not at all; and what happened."""

    def __init__(self, rows: int, size: int, nv: int) -> None:
        self.count = 0
        """How many states are kept."""
        self.events: list[Happening] = []
        rows = min(rows, _AT_FIRST)
        self._parts = np.empty(rows), np.empty((rows, size)), np.empty((rows, nv)), np.empty((rows, nv))

    @property
    def last(self) -> float:
        """The time of the last state [s]; -inf where none is kept."""
        return float(self._parts[0][self.count - 1]) if self.count else -np.inf

    @property
    def states(self) -> Array:
        """(count, size)."""
        return self._parts[1][: self.count]

    def keep(self, t: float, y: Array, ddq: Array, tau: Array) -> None:
        """Add a state."""
        k = self.count
        if k == len(self._parts[0]):
            self._grow(k + 1)
        times, states, accelerations, torques = self._parts
        times[k], states[k], accelerations[k], torques[k] = t, y, ddq, tau
        self.count = k + 1

    def keep_block(self, times: Array, states: Array, accelerations: Array, tau: Array) -> None:
        """Add m states (m, size) under torques (nv,) or (m, nv)."""
        first, end = self.count, self.count + len(times)
        if end > len(self._parts[0]):
            self._grow(end)
        for room, given in zip(self._parts, (times, states, accelerations, tau), strict=True):
            room[first:end] = given
        self.count = end

    def result(self, robot: Robot, works: tuple[str, ...], **said: Any) -> SimulationResult:
        """All that was kept, with energies and momentum."""
        times, Y, accelerations, torques = (x[: self.count] for x in self._parts)
        if self.count < len(self._parts[0]) - 2:  # room that an early end left unused is given back
            times, accelerations, torques = times.copy(), accelerations.copy(), torques.copy()
        q, dq, W = (np.ascontiguousarray(x) for x in np.split(Y, [robot.nq, robot.nq + robot.nv], axis=1))
        with np.errstate(all="ignore"):  # the last states before a failure may be enormous
            kinetic, potential = robot.kinetic_energy(q, dq), robot.potential_energy(q)
            momentum = robot.momentum(q, dq)
        return SimulationResult(
            robot=robot.name,
            simulated=robot,
            coordinate_names=robot.coordinate_names,
            coordinate_units=tuple(u for b in robot.model.leaders for u in b.joint.coordinate_units),
            velocity_names=robot.model.velocity_names,
            times=times,
            q=q,
            dq=dq,
            ddq=accelerations,
            tau=torques,
            kinetic_energy=np.asarray(kinetic),
            potential_energy=np.asarray(potential),
            work={name: x.copy() for name, x in zip(works, W.T, strict=True)},
            momentum=np.asarray(momentum),
            events=tuple(self.events),
            **said,
        )

    def _grow(self, rows: int) -> None:
        parts = []
        for old in self._parts:
            new = np.empty((max(rows, 2 * len(old)), *old.shape[1:]))
            new[: self.count] = old[: self.count]
            parts.append(new)
        self._parts = tuple(parts)  # type: ignore[assignment]
