"""Accuracy of a simulation: errors of sampled steps, quadrature of forces, and messages."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SimulationError
from ..core.numbers import percent, printed
from ..core.quadrature import ProbeRule, left_out
from ..core.typing import Array
from .forces import System
from .schemes import ADAPTIVE

if TYPE_CHECKING:
    from ..robot import Robot

_DRIFT = 0.01
"""Energy drift that triggers a remark, as a fraction of the energy exchanged."""
_ERROR = 0.05
"""Smallest error reported, as a fraction of the motion. Errors are added without sign; smaller values mean little."""
_REST = 1e-9
"""rad or m: smaller displacements count as rest."""
_MANY = 1e4
_MORE = "more than 10 000 times"
"""Text for an error above this multiple of the motion."""
_ROWS = 2000


@dataclass(frozen=True, eq=False)
class Extent:
    """Travel of the joints in a run and its duration, over all revolute and over all prismatic velocities."""

    travels: Array
    """Largest displacement of each joint (nv,) [rad or m]."""
    spans: Array
    """Travel divided by peak speed (nv,) [s]."""

    @property
    def rests(self) -> Array:
        """Mask (nv,) of joints that do not move."""
        return np.asarray(self.travels < _REST)

    @classmethod
    def from_states(cls, robot: Robot, states: Array) -> Extent:
        """Extent of the states (n, nq + nv or more)."""
        rows: Any = slice(None)
        if len(states) > _ROWS:
            rows = np.linspace(0, len(states) - 1, _ROWS).round().astype(int)
        ways = np.ascontiguousarray(robot.subtract(states[rows, : robot.nq], states[0, : robot.nq]).T)
        rates = np.ascontiguousarray(states[:, robot.nq : robot.nq + robot.nv].T)  # contiguous rows are faster
        each, speeds = ways.max(axis=1) - ways.min(axis=1), np.maximum(rates.max(axis=1), -rates.min(axis=1))
        travels, spans = np.zeros(robot.nv), np.zeros(robot.nv)
        angular = np.array([turns for body in robot.model.leaders for turns in body.joint.turning], bool)
        for group in (angular, ~angular):
            if group.any():
                travels[group], peak = each[group].max(), speeds[group].max()
                spans[group] = travels[group] / peak if peak > 0.0 else 0.0
        return cls(travels, spans)


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Error of each coordinate, and of the motion as a whole."""

    error: Array
    """(nv,) rad or m, NaN if unknown."""
    relative: float

    @classmethod
    def from_error(cls, extent: Extent, error: Array) -> Accuracy:
        """Accuracy from an error (nv,), relative to the motion."""
        return cls(error, float(np.max(error / np.maximum(extent.travels, _REST))))

    @property
    def remarkable(self) -> bool:
        """True if the relative error is large enough to be reported."""
        return self.relative > _ERROR

    def remarks(self, method: str, relative_drift: float) -> list[str]:
        """Remarks on large errors and drift."""
        less, said = "rtol" if method == ADAPTIVE else "dt", []
        if self.remarkable:
            share = f"about {_percent(self.relative)} of" if self.relative < _MANY else _MORE
            said.append(f"the errors of its steps add up to {share} the motion: take a smaller {less}")
        if relative_drift > _DRIFT:
            said.append(
                f"the energy drift is {_percent(relative_drift)} of the energy exchanged: the motion, or the recorded "
                f"work, is wrong: take a smaller {less}"
            )
        return said


def _percent(share: float) -> str:
    return percent(share, 2 if share < 1.0 else None) if share < _MANY else _MORE


# ── Selection and storage of sampled steps

_LEAST = 32
"""Smallest number of sampled steps of a run, if it has as many."""
_SPACING = 50
"""Spacing of sampled steps in a long run. A sample costs 2.5 steps, or 6 for a method with one evaluation."""
MOST_SAMPLED = 2000
"""Largest number of sampled steps of a run, and of additional steps in which a contact begins or ends."""


class SampledSteps(NamedTuple):
    """Steps of a run, either m along an axis or a single one."""

    numbers: Any
    t: Any
    y: Array
    after: Array
    held: Array
    """Torques of the controller."""
    begun: Array
    """Accelerations at the start of the steps."""

    def pick(self, which: Any) -> SampledSteps:
        """Selected steps, or a single one."""
        return SampledSteps(*(x[which] for x in self))

    @classmethod
    def join(cls, parts: list[SampledSteps]) -> SampledSteps:
        """Concatenate several samples."""
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


@lru_cache(maxsize=16)
def sampled_steps(n: int) -> tuple[int, ...]:
    """Indices of the sampled steps among n: dense at first, then one in each block, without a period.

    >>> sampled_steps(3000)[:9]
    (0, 1, 2, 4, 8, 16, 32, 80, 111)
    """
    spacing = max(min(n // _LEAST, _SPACING), n // MOST_SAMPLED, 1)
    found, k = [], 0
    while k < min(spacing, n):
        found.append(k)
        k = max(2 * k, 1)
    for block in range(1, -(-n // spacing)):
        k = block * spacing + int(spacing * (block * 0.6180339887498949 % 1.0))  # golden-section sequence
        if k < n:
            found.append(k)
    return tuple(sorted(found))


# ── Step errors by halving sampled steps

# For a method of order p, the states after a step of length h and after two steps of h/2 differ by (1 - 2^-p) of the
# step's error. Friction, contacts and callbacks act in the half steps as in the step. Source: Hairer, Nørsett and
# Wanner, Solving Ordinary Differential Equations I, section II.4, "Richardson extrapolation".
#
# Half steps are taken after the run and do not affect it, even with stateful callbacks. A controller is not called
# again: its torque is that of the step.


_ROUNDING = 1e-14


class Flow(Protocol):
    """Steps of one method, one at a time or batched."""

    @property
    def order(self) -> int:
        """Order of the method."""

    @property
    def takes_many(self) -> bool:
        """True if states and times may have a batch axis."""

    def after(self, t: float, y: Array, h: float, /) -> Array:
        """State a time h later, with unit quaternions."""

    def begun(self, t: float, y: Array, h: float, /) -> tuple[Array, Array]:
        """State a time h later, and accelerations (nv,) at the given state."""

    def accelerations(self, t: float, y: Array, /) -> Array:
        """Accelerations (nv,) of a state (size,)."""


class StepDoubling:
    """Sampled steps of a run, and their errors by step doubling."""

    def __init__(self, n: int, h: float, *, lagging: bool) -> None:
        self.h, self.lagging = h, lagging
        """True if velocities lag half a step behind coordinates: see :meth:`_lagging`."""
        self._ordered = sampled_steps(n)
        self._due = frozenset(self._ordered)
        self._spread: list[SampledSteps] = []
        self._changed: list[SampledSteps] = []
        self.steps = self._changes = 0
        self._last: SampledSteps | None = None
        """Last step, unless it is among the changed ones."""

    def note(self, t: float, y: Array, after: Array, held: Array, begun: Array, *, changed: bool) -> None:
        """Record the next step; ``changed``: a contact begins or ends in it, or dry friction changes direction."""
        if changed or self.steps in self._due:
            self.note_block(np.array([t]), np.array([y, after]), held, begun[None], np.array([changed]))
        else:
            self._last = SampledSteps(self.steps, t, y, after, held, begun.copy())
            self.steps += 1

    def note_block(
        self, times: Array, states: Array, held: Array, begun: Array, changed: NDArray[np.bool_]
    ) -> None:  # fmt: skip
        """Record the next m steps, by states (m + 1, size); the step before a changed one also counts as changed."""
        first, m = self.steps, len(times)
        numbers, held = np.arange(first, first + m), np.broadcast_to(held, begun.shape)
        steps = SampledSteps(numbers, times, states[:-1], states[1:], held, begun)
        k = bisect_left(self._ordered, first)
        due = self._ordered[k : bisect_left(self._ordered, first + m, k)]
        if due:
            self._spread.append(steps.pick(np.array(due) - first))
        marked = changed.copy()
        if changed.any():
            if changed[0] and self._last is not None:
                self._mark(SampledSteps(*(np.asarray(x)[None] for x in self._last)))
            marked[:-1] |= changed[1:]
            self._mark(steps.pick(np.flatnonzero(marked)))
        self._last = None if marked[-1] else SampledSteps(*(x[-1].copy() for x in steps))
        self.steps = first + m

    def _mark(self, steps: SampledSteps) -> None:
        """Count changed steps, and store them as samples up to the largest number."""
        if self._changes < MOST_SAMPLED:
            self._changed.append(steps.pick(slice(MOST_SAMPLED - self._changes)))
        self._changes += len(steps.t)

    def errors(self, system: System, flow: Flow, spans: Array) -> Array | None:
        """Sum of absolute errors of all steps (nv,) [rad or m]; velocity errors times ``spans`` [s] or their decay time."""
        before = system.held, system.applied, system.evaluations
        try:
            every = self._spread
            if self._changed:
                special = SampledSteps.join(self._changed).numbers
                every = [some.pick(~np.isin(some.numbers, special)) for some in every]
            spread = self._probe(system, flow, every, spans)
            changed = self._probe(system, flow, self._changed, spans)
            if spread is None and changed is None:
                return None
            total = self._late(system, flow, spans)
        finally:
            system.held, system.applied, system.evaluations = before
        if spread is not None:
            total += (1.0 - self._changes / self.steps) * _integral(*spread, self.steps)
        if changed is not None:
            total += self._changes * changed[1].mean(axis=0)
        return total

    def _probe(self, system: System, flow: Flow, parts: list[SampledSteps], spans: Array) -> tuple[Array, Array] | None:
        """Indices (m,) of the steps that could be halved, and their errors (m, nv)."""
        found, parts = [], [some for some in parts if len(some.t)]
        if not parts:
            return None
        steps = SampledSteps.join(parts)
        left = [steps] if flow.takes_many else [steps.pick(k) for k in range(len(steps.t))]
        for step in left:
            system.held = step.held
            try:
                halves, begun = self._lagging(system, flow, step) if self.lagging else (self._halves(flow, step), None)
                change = (halves - step.after)[..., system.moving]
                lasts = lasting(flow, system.moving, step.t + self.h, step.after, change, begun)
            except SimulationError:  # a callback fails at times between those of the run
                if np.ndim(step.t):
                    left += [steps.pick(k) for k in range(len(steps.t))]
                continue
            rows = np.atleast_2d(step.after), np.atleast_2d(halves)
            found.append((np.atleast_1d(step.numbers), *rows, np.atleast_1d(lasts)))
        if not found:
            return None
        numbers, whole, halved, times = map(np.concatenate, zip(*found, strict=True))
        good = np.isfinite(halved).all(axis=1)
        if not good.any():
            return None
        numbers, whole, halved, times = numbers[good], whole[good], halved[good], times[good]
        q, v = slice(0, system.nq), system.moving
        places = _above_rounding(system.robot.subtract(whole[:, q], halved[:, q]), whole[:, q])
        speeds = _above_rounding(whole[:, v] - halved[:, v], whole[:, v])
        off = places + np.minimum(spans, times[:, None]) * speeds
        return numbers, off / (1.0 - 0.5**flow.order)

    def _late(self, system: System, flow: Flow, spans: Array) -> Array:
        """Effect of a lagging method's initial velocities, given at the start rather than half a step before it."""
        if not self.lagging:
            return np.zeros(system.nv)
        first, v = self._spread[0].pick(0), system.moving
        system.held = first.held
        late = 0.5 * self.h * first.begun
        return np.asarray(np.minimum(spans, lasting(flow, v, first.t, first.y, late, first.begun)) * np.abs(late))

    def _halves(self, flow: Flow, step: SampledSteps) -> Array:
        """State after two steps of half the length."""
        half = 0.5 * self.h
        return flow.after(step.t + half, flow.after(step.t, step.y, half), half)

    def _lagging(self, system: System, flow: Flow, step: SampledSteps) -> tuple[Array, Array]:
        """Error of a step for a method whose velocities lag by h/2, and by h/4 in half steps.

        Taken as errors, these lags would add up over a run, although they cancel. Velocities are therefore shifted in
        time before and after the half steps, using accelerations over half a step. A shifted velocity violates
        constraints because their directions change; this violation is not an error and is removed.
        """
        v, start, end, half = (..., system.moving), step.y.copy(), step.after, 0.5 * self.h
        start[v] += 0.5 * half * step.begun
        halves = self._halves(flow, step._replace(y=start))
        later, begun = flow.begun(step.t + self.h, end, half)
        halves[v] -= 0.5 * (later[v] - end[v])
        halves[v] = system.allowed_velocities(halves)
        return halves, begun


def lasting(flow: Flow | System, moving: slice, t: Any, y: Array, off: Array, begun: Array | None = None) -> Array:
    """Approximate decay time (...) [s] of velocity differences (..., nv), by their effect on ``begun``; inf if undamped."""
    moved = y.copy()
    moved[..., moving] += off
    damped = -np.vecdot(off, flow.accelerations(t, moved) - (flow.accelerations(t, y) if begun is None else begun))
    with np.errstate(all="ignore"):
        return np.where(damped > 0.0, np.vecdot(off, off) / damped, np.inf)


def _above_rounding(off: Array, of: Array) -> Array:
    """Magnitudes of differences (m, nv) of numbers (m, k), with rounding errors set to zero."""
    return np.where(np.abs(off) > _ROUNDING * np.abs(of).max(axis=1, keepdims=True), np.abs(off), 0.0)


def _integral(numbers: Array, off: Array, n: int) -> Array:
    """Sum over steps 0 … n - 1 of values known at some of them, linearly interpolated; (m,), (m, k) → (k,)."""
    edges = np.concatenate([[-0.5], 0.5 * (numbers[1:] + numbers[:-1]), [n - 0.5]])
    return np.asarray(np.diff(edges) @ off)


# ── Quadrature check of torques and wrenches between the stages of a step

Path = Callable[[Array], Array]
"""Function from fractions (m,) of steps to states (..., m, size)."""

_MOST_KEPT = 100_000
"""Number of steps stored for a check at the end of the run; of longer runs, the first steps are checked earlier."""


_AT_ONCE = 256
"""Number of steps that are evaluated together."""


class ForceQuadrature:
    """Callbacks of a run, evaluated at the times of :class:`~twistwrench.core.quadrature.ProbeRule`."""

    def __init__(self, system: System, times: Array, weights: Array, spacing: float) -> None:
        self.system, self.rule = system, ProbeRule(times, weights, spacing)

    def impulses(self, t: Any, h: float, path: Path) -> Array:
        """Impulses of the callbacks missed by steps from times t (...), (..., nv) [N m s or N s]."""
        t, missing = np.asarray(t), np.zeros((*np.shape(t), self.system.nv))
        if not self.system.functions or not self.rule.needed(h):
            return missing
        shares, weights = self.rule.shares(h)
        times, states = t[..., None] + h * shares, path(shares)
        for _, forces in self.system.functions:
            values = forces(times.ravel(), states.reshape(-1, states.shape[-1])).reshape(*times.shape, -1)
            missing += left_out(weights, values)
        return h * missing

    def change(self, q: Array, dq: Array, impulse: Array) -> Array:
        """Changes of velocity (..., nv) due to impulses (..., nv)."""
        forward = self.system.robot.forward_dynamics
        return np.asarray(forward(q, dq, impulse) - forward(q, dq, np.zeros_like(impulse)))

    def furthest(self, t: float, h: float, path: Path) -> tuple[str, float]:
        """Name of the callback with the largest deviation from its median in a step from t, and the time [s]."""
        shares, _ = self.rule.shares(h)
        states, found = path(shares), (-1.0, "", t)
        for name, forces in self.system.functions:
            values = forces(t + h * shares, states)
            far = np.abs(values - np.median(values, axis=0)).max(axis=1)
            found = max(found, (float(far.max()), name, t + h * float(shares[int(far.argmax())])))
        return found[1:]


class ForceCheck:
    """Sum of missed impulses over all steps of length ``h``; evaluated at the end of the run, like step doubling."""

    def __init__(self, probes: ForceQuadrature, h: float) -> None:
        self.probes, self.h = probes, h
        self._sum = np.zeros(probes.system.nv)
        self._blocks: list[tuple[Array, ...]] = []
        """Times (m,), states before and after, and controller torques, (m, ...)."""
        self._count = 0
        self._worst: tuple[Array, tuple[float, Array, Array, Array]] | None = None

    def note(self, t: float, y: Array, after: Array) -> None:
        """Record a step from y at t to the state after it."""
        if self.probes.system.functions:
            self._keep(np.array([t]), y[None], after[None], self.probes.system.held[None])

    def note_block(self, times: Array, states: Array, held: Array) -> None:
        """Record n steps from times (n,), with states (n + 1, size) and controller torques (nv,) or (n, nv)."""
        if self.probes.system.functions:
            kept, torques = states.copy(), np.broadcast_to(held, (len(times), held.shape[-1])).copy()
            self._keep(times, kept[:-1], kept[1:], torques)

    def _keep(self, *steps: Array) -> None:
        self._blocks.append(steps)
        self._count += len(steps[0])
        if self._count >= _MOST_KEPT:
            self._add_up()

    def error(self, extent: Extent, end: float) -> Array | None:
        """Error of a run to ``end`` [s], (nv,) rad or m; None if no impulse is missed.

        Velocity changes decay as in step doubling; for a joint that does not move they last to the end.
        """
        self._add_up()
        if self._worst is None:
            return None
        change, (t, _, after, held) = self._worst
        system = self.probes.system
        before, system.held = (system.held, system.applied, system.evaluations), held
        try:
            lasts = lasting(system, system.moving, t + self.h, after, change)
        except SimulationError:
            lasts = np.array(np.inf)
        finally:
            system.held, system.applied, system.evaluations = before
        return np.asarray(np.minimum(np.where(extent.rests, end, extent.spans), lasts) * self._sum)

    def remark(self) -> str:
        """Remark on callbacks for which the steps are too long."""
        if self._worst is None:
            return ""
        t, y, after, _ = self._worst[1]
        what, time = self.probes.furthest(t, self.h, _straight(y, after))
        return (
            f"{what} changes within steps of {printed(self.h, 3)} s in a way that the method does not see, most of all about "
            f"t = {printed(time)} s: take a smaller dt"
        )

    def _add_up(self) -> None:
        if not self._count:
            return
        system = self.probes.system
        t, y, after, held = map(np.concatenate, zip(*self._blocks, strict=True))
        self._blocks, self._count = [], 0
        cuts = [slice(k, k + _AT_ONCE) for k in range(0, len(t), _AT_ONCE)]
        missing = np.concatenate([self._impulses(t[some], y[some], after[some]) for some in cuts])
        mine = np.flatnonzero(missing.any(axis=1))
        if not len(mine):
            return
        change = self.probes.change(y[mine, : system.nq], y[mine, system.moving], missing[mine])
        self._sum += np.abs(change).sum(axis=0)
        largest = int(np.abs(change).max(axis=1).argmax())
        if self._worst is None or np.abs(change[largest]).max() > np.abs(self._worst[0]).max():
            k = mine[largest]
            self._worst = change[largest], (float(t[k]), y[k], after[k], held[k])

    def _impulses(self, t: Array, y: Array, after: Array) -> Array:
        """Missed impulses of steps, (n, nv); zero if a callback fails at times between those of the run."""
        try:
            return self.probes.impulses(t, self.h, _straight(y, after))
        except SimulationError:
            if len(t) == 1:
                return np.zeros((1, self.probes.system.nv))
            return np.concatenate([self._impulses(t[k : k + 1], y[k : k + 1], after[k : k + 1]) for k in range(len(t))])


def _straight(y: Array, after: Array) -> Path:
    return lambda shares: y[..., None, :] + shares[:, None] * (after - y)[..., None, :]
