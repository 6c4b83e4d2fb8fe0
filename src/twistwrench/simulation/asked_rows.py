"""Room for a block of steps between which functions in Python are asked, and the calls that take them, all prepared."""

from __future__ import annotations

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


class AskedRows:
    """A block of m steps: their states, the torques given, and what is to be done for each of them."""

    def __init__(self, steps: CompiledSteps, controller: Law | None, constant: Array, m: int) -> None:
        s = steps.system
        laws = list(steps.laws()) if isinstance(steps, AskedSteps) else []
        shares = steps.shares if isinstance(steps, AskedSteps) else [0.0]
        self.every = n = len(shares)
        """Calls that make a step."""
        own = np.arange(m * n)
        step, one = own // n, np.zeros(m * n, int)
        self.states = np.zeros((m * n + 1, s.size))
        """At the beginning of each call, and after the last one."""
        self.ddq = np.zeros((m * n, s.nv))
        self.held = np.tile(constant, (m, 1))
        """(m, nv), what the controller gives and what is constant."""
        given = {name: (x[None], one) for name, x in steps.constants.items()}
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
        operands = [*states, (np.array([steps.h]), one), *named, *after, (self.ddq, own)]
        first = len(states) + 1
        self.call = row_calls(
            steps.kernel, operands, first + steps.names.index("tau"), first + len(named) + len(steps.cuts)
        )
        """Makes a call, with torques of its own if they are given, and gives the peak after it."""

        self.sole = _sole(controller, constant, laws)
        """Who alone gives the torques of every call, if one function does and no other is asked."""
        asks: list[list[Ask]] = [[] for _ in own]
        if controller is not None and self.sole is None:
            for k, row in enumerate(self.held):
                asks[k * n].append((controller, row, constant))
        for name, law in laws if self.sole is None else []:
            added = controller is not None and name == "tau"
            for k, row in enumerate(given[name][0]):
                asks[k].append((law, row, self.held[k // n] if added else None))
        q, dq = (self.states[:-1, cut] for cut in steps.cuts[:2])
        every = [*zip(shares * m, own.tolist(), q, dq, asks, strict=True)]
        self.steps = [every[k : k + n] for k in range(0, m * n, n)]
        """Of each step its calls."""

    def _parts(self, steps: CompiledSteps, which: NDArray[np.intp]) -> list[Rows]:
        return [(self.states[:, cut], which) for cut in steps.cuts]


def _sole(controller: Law | None, constant: Array, laws: list[tuple[str, Law]]) -> Law | None:
    """The one function that gives all torques, to which nothing is added, where no other is asked."""
    if controller is not None:
        return None if laws or constant.any() else controller
    return laws[0][1] if len(laws) == 1 and laws[0][0] == "tau" else None
