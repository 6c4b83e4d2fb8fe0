"""Step errors by halving sampled steps.

For a method of order p, the states after a step of length h and after two steps of h/2 differ by (1 - 2^-p) of the
step's error. Friction, contacts and callbacks act in the half steps as in the step. Source: Hairer, Nørsett and Wanner,
Solving Ordinary Differential Equations I, section II.4, "Richardson extrapolation".

Half steps are taken after the run and do not affect it, even with stateful callbacks. A controller is not called again:
its torque is that of the step.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ...core.errors import SimulationError
from ...core.typing import Array
from ..forces import System

MIN_SAMPLES = 32
"""Smallest number of sampled steps of a run, if it has as many."""
MAX_SPACING = 50
"""Spacing of sampled steps in a long run. A sample costs as much as 2.5 steps, or 6 for a method with one evaluation."""
MAX_SAMPLES = 2000
"""Largest number of sampled steps of a run, and of further samples of steps in which a contact begins or ends."""
_MAX_ROUNDING_ERROR = 1e-14
"""Largest rounding error of a state, relative to its largest entry."""
_GOLDEN_SECTION = 0.6180339887498949
"""Step of the sequence of places in blocks, which has no period."""


class SampledSteps(NamedTuple):
    """Steps of a run: m steps along the first axis of each field, or a single step without that axis."""

    numbers: Any
    """Indices of the steps in the run."""
    t: Any
    """Times at the start of the steps [s]."""
    y: Array
    """States at the start of the steps."""
    after: Array
    """States at the end of the steps."""
    held: Array
    """Torques of the controller, which are constant during a step."""
    accelerations: Array
    """Accelerations at the start of the steps."""

    def pick(self, index: Any) -> SampledSteps:
        """Steps selected by an array or slice, or a single one by an integer."""
        return SampledSteps(*[x[index] for x in self])

    @classmethod
    def join(cls, parts: list[SampledSteps]) -> SampledSteps:
        """Concatenate several samples."""
        arrays_by_field = zip(*parts, strict=True)
        return cls(*map(np.concatenate, arrays_by_field))


@lru_cache(maxsize=16)
def sample_steps(n: int) -> tuple[int, ...]:
    """Indices of the sampled steps among n: dense at first, then one in each block of steps, without a period.

    >>> sample_steps(3000)[:9]
    (0, 1, 2, 4, 8, 16, 32, 80, 111)
    """
    spacing = max(min(n // MIN_SAMPLES, MAX_SPACING), n // MAX_SAMPLES, 1)
    indices = []
    k = 0
    while k < min(spacing, n):
        indices.append(k)
        k = max(2 * k, 1)
    for block in range(1, math.ceil(n / spacing)):
        share_of_block = block * _GOLDEN_SECTION % 1.0
        k = block * spacing + int(spacing * share_of_block)
        if k < n:
            indices.append(k)
    return tuple(sorted(indices))


class Flow(Protocol):
    """Steps of one method, one at a time or batched."""

    system: System

    @property
    def order(self) -> int:
        """Order of the method."""

    @property
    def takes_many(self) -> bool:
        """True if states and times may have a batch axis."""

    def under(self, held: Array) -> Self:
        """Same steps of a copy of the system, in which the controller holds these torques."""

    def after(self, t: float, y: Array, h: float, /) -> Array:
        """State at t + h, with unit quaternions."""

    def step_and_accelerations(self, t: float, y: Array, h: float, /) -> tuple[Array, Array]:
        """State at t + h, and accelerations (nv,) at t."""

    def accelerations(self, t: float, y: Array, /) -> Array:
        """Accelerations (nv,) of a state (size,)."""


class StepDoubling:
    """Sampled steps of a run, and their errors by step doubling."""

    def __init__(self, n: int, h: float, *, lagging: bool) -> None:
        self.h = h
        self.lagging = lagging
        """True if velocities lag half a step behind coordinates: see :meth:`_halve_with_lag`."""
        self._sampled_indices = sample_steps(n)
        """Indices of the steps to be sampled, in order."""
        self._index_set = frozenset(self._sampled_indices)
        """Set of these indices, for look-ups."""
        self._regular_samples: list[SampledSteps] = []
        """Samples at these indices."""
        self._changed_samples: list[SampledSteps] = []
        """Samples of steps in which a contact begins or ends, or dry friction changes direction."""
        self.steps = 0
        """Number of recorded steps."""
        self._change_count = 0
        """Number of changed steps, of which not all are stored."""
        self._last_step: SampledSteps | None = None
        """Last step; None if it is among the changed ones."""

    def note(self, t: float, y: Array, after: Array, held: Array, accelerations: Array, *, changed: bool) -> None:
        """Record the next step; ``changed``: a contact begins or ends in it, or dry friction changes direction."""
        if changed or self.steps in self._index_set:
            self.note_block(np.array([t]), np.array([y, after]), held, accelerations[None], np.array([changed]))
        else:
            self._last_step = SampledSteps(self.steps, t, y, after, held, accelerations.copy())
            self.steps += 1

    def note_block(
        self, times: Array, states: Array, held: Array, accelerations: Array, changed: NDArray[np.bool_]
    ) -> None:
        """Record the next m steps, by states (m + 1, size); the step before a changed one also counts as changed."""
        first = self.steps
        m = len(times)
        numbers = np.arange(first, first + m)
        held = np.broadcast_to(held, accelerations.shape)
        steps = SampledSteps(numbers, times, states[:-1], states[1:], held, accelerations)
        begin = bisect_left(self._sampled_indices, first)
        end = bisect_left(self._sampled_indices, first + m, begin)
        sampled_indices = self._sampled_indices[begin:end]  # among the m steps
        if sampled_indices:
            self._regular_samples.append(steps.pick(np.array(sampled_indices) - first))
        counts_as_changed = changed.copy()
        if changed.any():
            if changed[0] and self._last_step is not None:
                last_step_in_batch = SampledSteps(*[np.asarray(x)[None] for x in self._last_step])
                self._add_changed(last_step_in_batch)
            counts_as_changed[:-1] |= changed[1:]
            self._add_changed(steps.pick(np.flatnonzero(counts_as_changed)))
        self._last_step = None
        if not counts_as_changed[-1]:
            self._last_step = SampledSteps(*[x[-1].copy() for x in steps])
        self.steps = first + m

    def _add_changed(self, steps: SampledSteps) -> None:
        """Count changed steps, and store at most MAX_SAMPLES of all of them."""
        if self._change_count < MAX_SAMPLES:
            self._changed_samples.append(steps.pick(slice(MAX_SAMPLES - self._change_count)))
        self._change_count += len(steps.t)

    def errors(self, flow: Flow, spans: Array) -> Array | None:
        """Sum (nv,) of the absolute errors of all steps [rad or m]; None if no step could be halved.

        Velocity errors act for the times ``spans`` [s], or for their decay times if these are shorter.
        """
        regular_parts = self._regular_samples
        if self._changed_samples:
            changed_numbers = SampledSteps.join(self._changed_samples).numbers
            regular_parts = [part.pick(~np.isin(part.numbers, changed_numbers)) for part in self._regular_samples]
        regular_errors = self._sampled_errors(flow, regular_parts, spans)
        changed_errors = self._sampled_errors(flow, self._changed_samples, spans)
        if regular_errors is None and changed_errors is None:
            return None
        total = self._initial_lag(flow, spans)
        if regular_errors is not None:
            numbers, errors = regular_errors
            share_of_regular = 1.0 - self._change_count / self.steps
            total += share_of_regular * _interpolated_sum(numbers, errors, self.steps)
        if changed_errors is not None:
            _, errors = changed_errors
            total += self._change_count * errors.mean(axis=0)
        return total

    def _sampled_errors(self, flow: Flow, parts: list[SampledSteps], spans: Array) -> tuple[Array, Array] | None:
        """Indices (m,) of the steps that could be halved, and their errors (m, nv); None if there are no such steps."""
        parts_with_steps = [part for part in parts if len(part.t)]
        if not parts_with_steps:
            return None
        halved_parts = self._halve_all(flow, SampledSteps.join(parts_with_steps))
        if not halved_parts:
            return None
        results = [np.concatenate(arrays) for arrays in zip(*halved_parts, strict=True)]
        _, _, all_after_halves, _ = results
        is_finite = np.isfinite(all_after_halves).all(axis=1)
        if not is_finite.any():
            return None
        numbers, after_whole, after_halves, decay = [x[is_finite] for x in results]
        q = slice(0, flow.system.nq)
        v = flow.system.moving
        q_differences = flow.system.robot.subtract(after_whole[:, q], after_halves[:, q])
        position_differences = _without_rounding(q_differences, after_whole[:, q])
        velocity_differences = _without_rounding(after_whole[:, v] - after_halves[:, v], after_whole[:, v])
        error_times = np.minimum(spans, decay[:, None])
        position_errors = position_differences + error_times * velocity_differences
        return numbers, position_errors / (1.0 - 0.5**flow.order)

    def _halve_all(self, flow: Flow, steps: SampledSteps) -> list[tuple[Array, Array, Array, Array]]:
        """Results of :meth:`_halve` for all steps together if possible, otherwise for each step that can be halved."""
        if flow.takes_many:
            try:
                return [self._halve(flow, steps)]
            except SimulationError:  # a callback fails at some time between those of the run: each step by itself
                pass
        halved_parts = []
        for k in range(len(steps.t)):
            try:
                halved_parts.append(self._halve(flow, steps.pick(k)))
            except SimulationError:
                continue
        return halved_parts

    def _halve(self, flow: Flow, step: SampledSteps) -> tuple[Array, Array, Array, Array]:
        """Indices (m,), states (m, size) after whole steps and after two halves, decay times (m,) of their difference [s]."""
        flow = flow.under(step.held)
        v = flow.system.moving
        accelerations = None
        if self.lagging:
            halved, accelerations = self._halve_with_lag(flow, step)
        else:
            halved = self._half_steps(flow, step)
        change = (halved - step.after)[..., v]
        decay = decay_times(flow, v, step.t + self.h, step.after, change, accelerations)
        return np.atleast_1d(step.numbers), np.atleast_2d(step.after), np.atleast_2d(halved), np.atleast_1d(decay)

    def _initial_lag(self, flow: Flow, spans: Array) -> Array:
        """Error (nv,) [rad or m] by the initial velocities of a lagging method, which are not those of half a step before."""
        if not self.lagging:
            return np.zeros(flow.system.nv)
        first = self._regular_samples[0].pick(0)
        flow = flow.under(first.held)
        velocity_error = 0.5 * self.h * first.accelerations
        decay = decay_times(flow, flow.system.moving, first.t, first.y, velocity_error, first.accelerations)
        return np.asarray(np.minimum(spans, decay) * np.abs(velocity_error))

    def _half_steps(self, flow: Flow, step: SampledSteps) -> Array:
        """State after two steps of half the length."""
        half = 0.5 * self.h
        middle = flow.after(step.t, step.y, half)
        return flow.after(step.t + half, middle, half)

    def _halve_with_lag(self, flow: Flow, step: SampledSteps) -> tuple[Array, Array]:
        """State after two half steps whose velocities lag by h/2, as after the step, and accelerations after the step.

        Velocities lag by h/2 after a step, and by h/4 after half steps. The difference is not an error, but would add up
        over a run as if it were one. Velocities are therefore shifted in time by h/4: before the half steps by their
        accelerations, and after them by half of the change in a half step. The directions of constraints change in this time,
        so a shifted velocity violates them. This violation is not an error and is removed.
        """
        v = (..., flow.system.moving)
        half = 0.5 * self.h
        start = step.y.copy()  # shifted below
        end = step.after
        start[v] += 0.5 * half * step.accelerations
        halved = self._half_steps(flow, step._replace(y=start))
        half_step_later, accelerations = flow.step_and_accelerations(step.t + self.h, end, half)
        halved[v] -= 0.5 * (half_step_later[v] - end[v])
        halved[v] = flow.system.allowed_velocities(halved)
        return halved, accelerations


def decay_times(
    flow: Flow | System, moving: slice, t: Any, y: Array, change: Array, accelerations: Array | None = None
) -> Array:
    """Approximate decay time (...) [s] of velocity changes Δv (..., nv): |Δv|² / -(Δv · Δa), or inf if they do not decay.

    Δa is their effect on the accelerations, which may be given for the state y itself.
    """
    changed = y.copy()
    changed[..., moving] += change
    changed_accelerations = flow.accelerations(t, changed)
    if accelerations is None:
        accelerations = flow.accelerations(t, y)
    damping = -np.vecdot(change, changed_accelerations - accelerations)
    with np.errstate(all="ignore"):
        return np.where(damping > 0.0, np.vecdot(change, change) / damping, np.inf)


def _without_rounding(differences: Array, values: Array) -> Array:
    """Magnitudes of differences (m, nv), with 0 for rounding errors of the ``values`` (m, k)."""
    rounding_errors = _MAX_ROUNDING_ERROR * np.abs(values).max(axis=1, keepdims=True)
    magnitudes = np.abs(differences)
    return np.where(magnitudes > rounding_errors, magnitudes, 0.0)


def _interpolated_sum(numbers: Array, errors: Array, n: int) -> Array:
    """Sum (k,) over the steps 0 … n - 1 of errors (m, k) known at the steps ``numbers`` (m,); each stands for those near it."""
    edges = np.concatenate([[-0.5], 0.5 * (numbers[1:] + numbers[:-1]), [n - 0.5]])  # halfway between known steps
    return np.asarray(np.diff(edges) @ errors)
