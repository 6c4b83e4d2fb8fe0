"""Room for a block of steps between which functions in Python are asked, and the calls that take them, all prepared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from ..kernels.row_calls import Rows, row_calls
from ..typing import Array
from .asked_steps import AskedSteps
from .compiled_steps import CompiledSteps
from .user_functions import Law

Ask = tuple[Law, Array, Array | None]
"""A function to be asked, where what it gives goes, and what is added to it, if anything."""

Stage = tuple[float, int, Array, Array, list[Ask]]
"""A call: at which share of its step, its number, its coordinates and velocities, and who is asked."""


SHORT, LONG = 128, 512
"""Steps whose states are kept and looked at together: more are prepared for longer, fewer are kept in more parts."""


class AskedRows:
    """A block of m steps: their states, the torques given, and what is to be done for each of them."""

    def __init__(self, steps: CompiledSteps, m: int) -> None:
        s = steps.system
        laws = _laws(steps)
        shares = steps.shares if isinstance(steps, AskedSteps) else [0.0]
        self.every = n = len(shares)
        """Calls that make a step."""
        own = np.arange(m * n)
        step, one = own // n, np.zeros(m * n, int)
        self.states = np.zeros((m * n + 1, s.size))
        """At the beginning of each call, and after the last one."""
        self.ddq = np.zeros((m * n, s.nv))
        self.held = np.zeros((m, s.nv))
        """(m, nv), what the controller gives and what is constant."""
        self._h = np.zeros(1)
        self._constants = {name: x[None].copy() for name, x in steps.constants.items()}
        given: dict[str, Rows] = {name: (x, one) for name, x in self._constants.items()}
        given["tau"] = self.held, step
        given |= {name: (np.zeros((m * n, *law.shape)), own) for name, law in laws}
        self.given = given["tau"][0]
        """The torques of each call; of each step where no function but a controller gives them."""
        self.tau = self.given[:: len(self.given) // m]
        """(m, nv), the torques as each step begins."""
        self.peaks = np.zeros(m * n + 1)
        """Of the same states: see :func:`.simulated_step.ended`."""
        states, after = ([*self._parts(steps, which), (self.peaks, which)] for which in (own, own + 1))
        if isinstance(steps, AskedSteps) and n > 1:
            sums = np.zeros_like(self.states)
            states += [(sums[:, cut], own) for cut in steps.cuts]
            after += [(sums[:, cut], own + 1) for cut in steps.cuts]
            states += [*self._parts(steps, step * n), (steps.table, own % n)]
        named = [given[name] for name in steps.names]
        self.gaps = np.zeros((m * n, len(s.contacts)))
        """Of the contacts as each call begins."""
        said = [(self.ddq, own), (self.gaps, own)][: 1 + bool(s.contacts)]
        operands = [*states, (self._h, one), *named, *after, *said]
        first = len(states) + 1
        self.call = row_calls(
            steps.kernel, operands, first + steps.names.index("tau"), first + len(named) + len(steps.cuts)
        )
        """Makes a call, with torques of its own if they are given, and gives the peak after it."""

        self._rows = {name: given[name][0] for name, _ in laws}
        q, dq = (self.states[:-1, cut] for cut in steps.cuts[:2])
        self._calls = [*zip(shares * m, own.tolist(), q, dq, strict=True)]
        self.sole: Law | None = None
        """Who alone gives the torques of every call, if one function does and no other is asked."""
        self.steps: list[list[Stage]] = []
        """Of each step its calls."""
        self._plain: list[list[Stage]] = []

    @classmethod
    @contextmanager
    def lent(cls, steps: CompiledSteps, controller: Law | None, constant: Array, n: int) -> Iterator[AskedRows]:
        """Rows for a run of n steps, kept by its robot for the next one: what points to them takes long to prepare."""
        m = SHORT if n <= 2 * SHORT else LONG
        key = "asked rows", type(steps).__name__, m, *steps.plan.key, *(name for name, _ in _laws(steps))
        free: list[AskedRows] = steps.system.robot.engine.kept(key, list)
        try:
            rows = free.pop()
        except (
            IndexError
        ):  # all of them are lent: a function that is asked may simulate itself, and so may another thread
            rows = cls(steps, m)
        rows._begin(steps, controller, constant)
        yield rows
        rows.steps = rows._plain  # no function is kept
        rows.sole = None
        free.append(rows)

    def _begin(self, steps: CompiledSteps, controller: Law | None, constant: Array) -> None:
        """Numbers and functions of a run."""
        self._h[0], self.held[:], laws, n = steps.h, constant, _laws(steps), self.every
        for name, x in steps.constants.items():
            self._constants[name][0] = x
        self.sole = _sole(controller, constant, laws)
        if self.sole is not None or not (controller or laws):
            self._plain = self._plain or self._steps([[] for _ in self._calls])
            self.steps = self._plain
            return
        asks: list[list[Ask]] = [[] for _ in self._calls]
        if controller is not None:
            for k, row in enumerate(self.held):
                asks[k * n].append((controller, row, constant))
        for name, law in laws:
            added = controller is not None and name == "tau"
            for k, row in enumerate(self._rows[name]):
                asks[k].append((law, row, self.held[k // n] if added else None))
        self.steps = self._steps(asks)

    def _steps(self, asks: list[list[Ask]]) -> list[list[Stage]]:
        every = [(*call, mine) for call, mine in zip(self._calls, asks, strict=True)]
        return [every[k : k + self.every] for k in range(0, len(every), self.every)]

    def _parts(self, steps: CompiledSteps, which: NDArray[np.intp]) -> list[Rows]:
        return [(self.states[:, cut], which) for cut in steps.cuts]


def _laws(steps: CompiledSteps) -> list[tuple[str, Law]]:
    return list(steps.laws()) if isinstance(steps, AskedSteps) else []


def _sole(controller: Law | None, constant: Array, laws: list[tuple[str, Law]]) -> Law | None:
    """The one function that gives all torques, to which nothing is added, where no other is asked."""
    if controller is not None:
        return None if laws or constant.any() else controller
    return laws[0][1] if len(laws) == 1 and laws[0][0] == "tau" else None
