"""Impulses of torque and wrench callbacks that steps miss between their stages, by quadrature."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.errors import SimulationError
from ...core.numbers import printed
from ...core.quadrature import ProbeRule, left_out
from ...core.typing import Array
from ..forces import System
from .relative_error import Extent
from .step_doubling import decay_times

Path = Callable[[Array], Array]
"""Function from fractions (m,) of steps to states (..., m, size)."""

MAX_STORED_STEPS = 100_000
"""Number of stored steps from which they are checked and forgotten."""
BATCH_SIZE = 256
"""Number of steps that are evaluated together."""


class ForceQuadrature:
    """Callbacks of a run, evaluated at the times of :class:`~twistwrench.core.quadrature.ProbeRule`."""

    def __init__(self, system: System, times: Array, weights: Array, spacing: float) -> None:
        self.system = system
        self.rule = ProbeRule(times, weights, spacing)

    def impulses(self, t: Any, h: float, path: Path) -> Array:
        """Impulses (..., nv) of the callbacks [N m s or N s] that steps from times t (...) miss."""
        t = np.asarray(t)
        mean_forces = np.zeros((*np.shape(t), self.system.nv))  # missed ones, over a step
        if not self.system.functions or not self.rule.needed(h):
            return mean_forces
        shares, weights = self.rule.shares(h)
        times = t[..., None] + h * shares
        states = path(shares)
        for _, forces_of in self.system.functions:
            forces = forces_of(times.ravel(), states.reshape(-1, states.shape[-1]))
            mean_forces += left_out(weights, forces.reshape(*times.shape, -1))
        return h * mean_forces

    def change(self, q: Array, dq: Array, impulse: Array) -> Array:
        """Changes of velocity (..., nv) due to impulses (..., nv)."""
        forward_dynamics = self.system.robot.forward_dynamics
        return np.asarray(forward_dynamics(q, dq, impulse) - forward_dynamics(q, dq, np.zeros_like(impulse)))

    def furthest(self, t: float, h: float, path: Path) -> tuple[str, float]:
        """Name of the callback with the largest deviation from its median in a step from t, and the time [s]."""
        shares, _ = self.rule.shares(h)
        states = path(shares)
        candidates = [(-1.0, "", t)]  # largest deviation, name and time, of each callback
        for name, forces_of in self.system.functions:
            forces = forces_of(t + h * shares, states)
            deviations = np.abs(forces - np.median(forces, axis=0)).max(axis=1)
            k = int(deviations.argmax())
            candidates.append((float(deviations[k]), name, t + h * float(shares[k])))
        _, name, time = max(candidates)
        return name, time


class ForceCheck:
    """Sum of missed impulses over all steps of length ``h``; evaluated at the end of the run, like step doubling."""

    def __init__(self, probes: ForceQuadrature, h: float) -> None:
        self.probes = probes
        self.h = h
        self._sum = np.zeros(probes.system.nv)
        """Sum of the magnitudes of the missed changes of velocity (nv,)."""
        self._blocks: list[tuple[Array, ...]] = []
        """Stored steps: times (m,), states before and after, and controller torques, (m, ...)."""
        self._count = 0
        """Number of stored steps."""
        self._worst: tuple[Array, tuple[float, Array, Array, Array]] | None = None
        """Largest missed change of velocity (nv,); and its step: time, states before and after, controller torques."""

    def note(self, t: float, y: Array, y_after: Array) -> None:
        """Record a step from y at t to the state after it."""
        if self.probes.system.functions:
            self._keep(np.array([t]), y[None], y_after[None], self.probes.system.held[None])

    def note_block(self, times: Array, states: Array, held: Array) -> None:
        """Record n steps from times (n,), with states (n + 1, size) and controller torques (nv,) or (n, nv)."""
        if self.probes.system.functions:
            states = states.copy()
            torques = np.broadcast_to(held, (len(times), held.shape[-1])).copy()
            self._keep(times, states[:-1], states[1:], torques)

    def _keep(self, times: Array, y: Array, y_after: Array, controller_torques: Array) -> None:
        """Store m steps; evaluate all that are stored if there are many."""
        self._blocks.append((times, y, y_after, controller_torques))
        self._count += len(times)
        if self._count >= MAX_STORED_STEPS:
            self._add_up()

    def error(self, extent: Extent, end: float) -> Array | None:
        """Error of a run to ``end`` [s], (nv,) rad or m; None if no impulse is missed.

        A change of velocity decays as in step doubling; if the joint does not move, it lasts at most to the end of the run.
        """
        self._add_up()
        if self._worst is None:
            return None
        change, step = self._worst
        t, _, y_after, controller_torques = step
        system = self.probes.system.under(controller_torques)
        try:
            times = decay_times(system, system.moving, t + self.h, y_after, change)
        except SimulationError:
            times = np.array(np.inf)
        max_times = np.where(extent.rests, end, extent.spans)
        return np.asarray(np.minimum(max_times, times) * self._sum)

    def remark(self) -> str:
        """Remark on callbacks for which the steps are too long; empty if no impulse is missed."""
        if self._worst is None:
            return ""
        _, step = self._worst
        t, y, y_after, _ = step
        callback, time = self.probes.furthest(t, self.h, _straight_path(y, y_after))
        return (
            f"{callback} changes within steps of {printed(self.h, 3)} s in a way that the method does not see, most of all "
            f"about t = {printed(time)} s: take a smaller dt"
        )

    def _add_up(self) -> None:
        """Add the missed changes of velocity of the stored steps to the sum, and forget these steps."""
        if not self._count:
            return
        system = self.probes.system
        columns = zip(*self._blocks, strict=True)
        t, y, y_after, controller_torques = (np.concatenate(parts) for parts in columns)
        self._blocks = []
        self._count = 0
        batches = [slice(k, k + BATCH_SIZE) for k in range(0, len(t), BATCH_SIZE)]
        impulses = np.concatenate([self._impulses(t[batch], y[batch], y_after[batch]) for batch in batches])
        rows = np.flatnonzero(impulses.any(axis=1))
        if not len(rows):
            return
        changes = self.probes.change(y[rows, : system.nq], y[rows, system.moving], impulses[rows])
        self._sum += np.abs(changes).sum(axis=0)
        sizes = np.abs(changes).max(axis=1)
        largest_row = int(sizes.argmax())
        if self._worst is not None:
            worst_change, _ = self._worst
            if not sizes[largest_row] > np.abs(worst_change).max():
                return
        k = rows[largest_row]
        self._worst = changes[largest_row], (float(t[k]), y[k], y_after[k], controller_torques[k])

    def _impulses(self, t: Array, y: Array, y_after: Array) -> Array:
        """Missed impulses of steps, (n, nv); zero for a step in which a callback fails."""
        try:
            return self.probes.impulses(t, self.h, _straight_path(y, y_after))
        except SimulationError:
            if len(t) == 1:
                return np.zeros((1, self.probes.system.nv))
            single_rows = [slice(k, k + 1) for k in range(len(t))]  # only some of the steps may fail
            return np.concatenate([self._impulses(t[row], y[row], y_after[row]) for row in single_rows])


def _straight_path(y: Array, y_after: Array) -> Path:
    """Linear interpolation between the states before and after steps, (..., size) each."""
    difference = y_after - y
    return lambda shares: y[..., None, :] + shares[:, None] * difference[..., None, :]
