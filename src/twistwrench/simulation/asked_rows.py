"""Room for a block of steps between which functions in Python are asked, and the calls that take them, all prepared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..kernels.row_calls import RowCalls
from ..typing import Array
from .asked_steps import AskedSteps
from .compiled_steps import CompiledSteps
from .user_functions import Law


class Ask(NamedTuple):
    """A function to be asked, and where what it gives goes."""

    function: Callable[..., Any]
    row: Array
    law: Law
    base: Array | None
    """What is added to it, if anything."""


class Stage(NamedTuple):
    """A call: at which share of its step, where its addresses are, its coordinates and velocities, and who is asked."""

    share: float
    place: int
    q: Array
    dq: Array
    asks: tuple[Ask, ...]


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
        states = [(self.states[:, cut], own) for cut in steps.cuts]
        after = [(self.states[:, cut], own + 1) for cut in steps.cuts]
        if isinstance(steps, AskedSteps) and n > 1:
            sums = np.zeros_like(self.states)
            states += [(sums[:, cut], own) for cut in steps.cuts]
            after += [(sums[:, cut], own + 1) for cut in steps.cuts]
            states += [(self.states[:, cut], step * n) for cut in steps.cuts] + [(steps.table, own % n)]
        named = [given[name] for name in steps.names]
        self.calls = RowCalls(steps.kernel, [*states, (np.array([steps.h]), one), *named, *after, (self.ddq, own)])

        def asks(k: int) -> tuple[Ask, ...]:
            found, held = [], self.held[k // n]
            if controller is not None and k % n == 0:
                found.append(Ask(controller.function, held, controller, constant if constant.any() else None))
            for name, law in laws:
                base = held if controller is not None and name == "tau" else None
                found.append(Ask(law.function, given[name][0][k], law, base))
            return tuple(found)

        q, dq = (self.states[:, cut] for cut in steps.cuts[:2])
        all_of_them = [Stage(shares[k % n], place, q[k], dq[k], asks(k)) for k, place in enumerate(self.calls.places)]
        self.steps = [(all_of_them[k * n : (k + 1) * n], self.states[(k + 1) * n]) for k in range(m)]
        """Of each step its calls, and the state after it."""
