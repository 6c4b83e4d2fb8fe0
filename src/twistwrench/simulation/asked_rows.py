"""Room for a block of steps between which functions in Python are asked, and the calls that take them, all prepared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels.row_calls import RowCalls, Rows
from ..typing import Array
from .asked_steps import AskedSteps
from .compiled_steps import CompiledSteps
from .user_functions import Law

Ask = tuple[Callable[..., Any], Array, Law, Array | None, bool]
"""A function to be asked, where what it gives goes, its law, what is added to it, if anything, and whether it shows.

What is no number shows in the peak after the step if it is a torque, as the work of torques is none then.
"""

Stage = tuple[float, int, Array, Array, tuple[Ask, ...]]
"""A call: at which share of its step, where its addresses are, its coordinates and velocities, and who is asked."""


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
        rows = given["tau"][0]
        self.tau = rows[:: len(rows) // m]
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
        self.calls = RowCalls(steps.kernel, [*states, (np.array([steps.h]), one), *named, *after, (self.ddq, own)])

        asks: list[list[Ask]] = [[] for _ in own]
        if controller is not None:
            base = constant if constant.any() else None
            for k, row in enumerate(self.held):
                asks[k * n].append((controller.function, row, controller, base, n == 1))
        for name, law in laws:
            added = controller is not None and name == "tau"
            for k, row in enumerate(given[name][0]):
                asks[k].append((law.function, row, law, self.held[k // n] if added else None, n == 1 and name == "tau"))
        q, dq = (self.states[:-1, cut] for cut in steps.cuts[:2])
        every = [*zip(shares * m, self.calls.places, q, dq, map(tuple, asks), strict=True)]
        self.steps = [(every[k : k + n], k + n) for k in range(0, m * n, n)]
        """Of each step its calls, and the number of the state after it."""

    def _parts(self, steps: CompiledSteps, which: NDArray[np.intp]) -> list[Rows]:
        return [(self.states[:, cut], which) for cut in steps.cuts]
