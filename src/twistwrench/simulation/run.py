"""Run loop of a simulation: fixed or adaptive steps, events, controller samples, and the instability error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..compiler.runtime.dispatch import can_bind_calls
from ..core.errors import SimulationError
from ..core.numbers import printed
from ..core.quadrature import probe_spacing
from ..core.text import argument
from ..core.typing import Array
from .accuracy.contact_durations import ContactDurations
from .accuracy.missed_impulses import ForceCheck, ForceQuadrature
from .accuracy.relative_error import Accuracy, Extent
from .accuracy.step_doubling import StepDoubling
from .blocks import run_callback_blocks, run_compiled_blocks
from .compiled_steps import CompiledSteps
from .events import EventDetector
from .forces import WORKS, ControlLaw, System
from .methods.adaptive import Stepper
from .methods.schemes import ADAPTIVE, MAX_SPEED, OneByOne, Scheme
from .result import Record, SimulationResult

if TYPE_CHECKING:
    from ..robot import Robot


def instability(run: Run, t0: float, t1: float, y: Array) -> str:
    """Error message for an unstable step from t0 to t1: joint, speed and remedy."""
    speeds = y[run.system.moving]
    fastest = int(np.argmax(np.where(np.isfinite(speeds), np.abs(speeds), np.inf)))
    advice = f"Take a smaller dt than {printed(run.h)} s, or {argument('method', ADAPTIVE)}."
    if run.method == ADAPTIVE:
        advice = "Its error is within the tolerance: look for torques or wrenches that push the way it moves already."
        if run.controller is not None:  # with the torque held for h, damping kd turns dq into (1 - kd h / M) dq
            advice += (
                f" The controller's torques are held for {printed(run.h)} s each, too long for a damping above twice the "
                "inertia over that time: take a smaller dt, less damping, or tau= in place of controller=."
            )
    return (
        f"the step from {printed(t0, 9)} s to {printed(t1, 9)} s is unstable: joint "
        f"{run.robot.model.velocity_names[fastest]!r} moves at {printed(speeds[fastest], 3)} rad/s or m/s after it. {advice}"
    )


class Run:
    """One simulation in progress."""

    def __init__(
        self,
        robot: Robot,
        system: System,
        scheme: Scheme,
        start: Array,
        end: float,
        n: int,
        *,
        every: int,
        remarks: list[str],
        method: str,
    ) -> None:
        self.robot, self.system, self.scheme, self.end, self.n, self.every = robot, system, scheme, end, n, every
        self.h = end / n
        self.remarks, self.method = remarks, method
        self.friction = False
        """True if joint friction is counted."""
        self.record = Record(n // every + 2, system.size, system.nv)
        self.detector: EventDetector | None = None
        self.controller: ControlLaw | None = None
        self.constant = system.held
        self.tick: Callable[[float], None] | None = None
        self.compiled: CompiledSteps | None = None
        """Compiled steps, if no Python function returns a force or observes a step."""
        self.go: Callable[[], None] = self.take_fixed_steps
        """Function that takes all steps."""
        self.stopped = ""
        self.steps = self.rejected = 0
        self.rate = np.zeros(system.size)
        self.doubling = StepDoubling(n, self.h, lagging=scheme.lagging)
        self.force_check = ForceCheck(ForceQuadrature(system, *scheme.quadrature, probe_spacing(self.h, end)), self.h)
        self.contact_durations = ContactDurations([contact.name for contact in system.contacts])
        self.stepper: Stepper | None = None
        self.accuracy = Accuracy(np.full(robot.nv, np.nan), np.nan)
        self.last: tuple[float, Array] = (0.0, start.copy())
        """Last stable state, stored or not; initially the first state."""

    def take_fixed_steps(self) -> None:
        """Take fixed steps."""
        y = self.begin()
        if self.stopped:
            return
        if self.compiled is not None:
            if self.without_callbacks:
                run_compiled_blocks(self, self.compiled)
            elif can_bind_calls(self.compiled.kernel):
                run_callback_blocks(self, self.compiled)
            if self.stopped or self.steps == self.n:
                return
            y = self.last[1].copy()
        for k in range(self.steps, self.n):
            t = k * self.h
            self.sample(t, y)
            self.system.rates(t, y, self.rate)
            if k % self.every == 0:
                self.keep(t, y)
            t1 = self.time(k + 1)
            y1 = self.stable_state(t, t1, self.scheme.step(t, y, self.h, self.rate))
            if k == 0 and self.leaves_at_once(y, y1, self.h):
                return
            if self.end_at_event(t, y, [(self.h, y1)]):
                return
            changed = self._changes(t1, y, y1)
            self.doubling.note(t, y, y1, self.system.held, self.rate[self.system.moving], changed=changed)
            self.force_check.note(t, y, y1)
            y = y1
            self.advance(t1, y)
        self.system.rates(self.end, y, self.rate)
        self.keep(self.end, y)

    def result(self, stopped: str, *, completed: bool) -> SimulationResult:
        """Result up to now, including the last stable state."""
        if self.last[0] > self.record.last:
            try:
                self.keep_at(*self.last)
            except (SimulationError, KeyboardInterrupt):  # errors recur; an interrupt is already in progress
                unknown = np.full(self.robot.nv, np.nan)
                self.record.keep(*self.last, unknown, unknown)
        end = {"stopped": stopped, "completed": completed, "method": self.method, "dt": self.h, "steps": self.steps}
        end["friction"] = self.friction
        counts = {"rejected": self.rejected, "evaluations": self.system.evaluations}
        errors = {"error_estimate": self.accuracy.error, "relative_error": self.accuracy.relative}
        remarks = (*self.remarks, *filter(None, [self.contact_durations.remark(self.h)]))
        if self.detector is not None:
            remarks = (*remarks, *self.detector.several.values())
        result = self.record.result(self.robot, WORKS, **end, **counts, **errors, remarks=remarks)
        accuracy_remarks = self.accuracy.remarks(self.method, result.relative_drift)
        if not accuracy_remarks:
            return result
        return replace(result, remarks=(*remarks, *accuracy_remarks))

    def judge(self) -> None:
        """Estimate the error of the steps so far."""
        if not self.record.count:
            return
        extent = Extent.from_states(self.robot, self.record.states)
        error: Array | None = None
        if self.stepper is not None:
            error = self.stepper.total_error(extent.spans)
        elif self.doubling.steps:
            flow = self.compiled or OneByOne(self.system, self.scheme)
            error = self.doubling.errors(flow, extent.spans)
        if error is not None:
            self.accuracy = Accuracy.from_error(extent, error)
        missed = self.force_check.error(extent, self.last[0])
        if missed is not None and Accuracy.from_error(extent, missed).remarkable:
            self.remarks.append(self.force_check.remark())
            self.accuracy = Accuracy.from_error(extent, np.fmax(self.accuracy.error, missed))

    @property
    def without_callbacks(self) -> bool:
        """True if no Python function returns torques or observes steps; contacts and position limits are allowed."""
        looks = self.detector is not None and not self.detector.without_callbacks
        return not looks and self.controller is None and not self.system.functions

    def time(self, k: int) -> float:
        """Start time of fixed step k."""
        return k * self.h if k < self.n else self.end

    def begin(self) -> Array:
        """First state, passed to the event detector."""
        y = self.last[1].copy()
        if self.detector is not None:
            self.detector.begin(0.0, y)
        return y

    def leaves_at_once(self, y: Array, y1: Array, h: float) -> bool:
        """True if a joint starts at a limit and moves beyond it; the stored first state is then the last."""
        if self.detector is None:
            return False
        event = self.detector.leaves_at_once(y, y1, h)
        if event is None:
            return False
        self.record.events.append(event)
        self.stopped = str(event)
        return True

    def sample(self, t: float, y: Array) -> None:
        """Call the controller."""
        if self.controller is not None:
            self.system.held = self.constant + self.controller(t, *self.system.split(y))

    def _changes(self, t: float, y: Array, y1: Array) -> bool:
        """True if a contact begins or ends in the step to y1 at t, or dry friction stops, releases or reverses a joint."""
        dry_friction, moving, changes = self.system.dry_friction, self.system.moving, False
        if self.detector is not None and self.contact_durations.names:
            changes = self.contact_durations.step(t, self.detector.gaps, worked=bool(y1[-1] != y[-1]))
        if dry_friction is None or changes:
            return changes
        return bool((np.sign(y1[moving]) != np.sign(y[moving]))[dry_friction.dry].any())

    def advance(self, t: float, y: Array) -> None:
        """Record a stable step to y at t."""
        self.steps += 1
        self.last = (t, y)
        if self.tick is not None:
            self.tick(t)

    def keep(self, t: float, y: Array) -> None:
        """Store a state whose rates were computed last."""
        self.record.keep(t, y, self.rate[self.system.moving], self.system.applied)

    def keep_at(self, t: float, y: Array) -> None:
        """Store a state after evaluating its rates."""
        rate = np.zeros(self.system.size)
        self.system.rates(t, y, rate)
        self.record.keep(t, y, rate[self.system.moving], self.system.applied)

    def keep_all(self, times: Array, states: Array) -> None:
        """Store states (m, size)."""
        if len(times) and self.system.takes_many:
            self.record.keep_block(times, states, *self.system.batch_accelerations(times, states))
            return
        for t, y in zip(times.tolist(), states, strict=True):
            self.keep_at(t, y)

    def stable_state(self, t0: float, t1: float, y: Array) -> Array:
        """State with unit quaternions; raises SimulationError after an unstable step."""
        self.system.manifold.normalise(y[: self.system.nq])
        self.require_stable(t0, t1, y)
        return y

    def require_stable(self, t0: float, t1: float, y: Array) -> None:
        """Raise SimulationError after an unstable step, by the state after it."""
        speed = np.abs(y[self.system.moving])
        if not (speed.max() < MAX_SPEED and np.isfinite(y).all()):
            raise SimulationError(instability(self, t0, t1, y))

    def end_at_event(
        self, t: float, y: Array, points: Sequence[tuple[float, Array]], kept: Sequence[tuple[float, Array]] = ()
    ) -> bool:
        """Locate events in a step from t; True if one ends the run, whose state and those before it are then stored."""
        at = self.along(t, y)
        end = self.locate_event(t, points, at)
        if end is None:
            return False
        before = [(t + s, between) for s, between in kept if s < end]
        if before:
            times, states = zip(*before, strict=True)
            self.keep_all(np.array(times), np.array(states))
        self.finish(t, end, at)
        return True

    def along(self, t: float, y: Array) -> Callable[[float], Array]:
        """Function from the time after t to the state, for a step from y at t whose rates were computed last."""
        rate = self.rate.copy()

        def state(s: float) -> Array:
            y1 = self.scheme.step(t, y, s, rate)
            self.system.manifold.normalise(y1[: self.system.nq])
            return y1

        return state

    def locate_event(
        self, t: float, points: Sequence[tuple[float, Array]], at: Callable[[float], Array]
    ) -> float | None:
        """Locate events in a step from t; returns the time after t of a terminal one. ``at``: state at a time after t."""
        if self.detector is None:
            return None
        events, end = self.detector.look(t, points, at)
        self.record.events += events
        return end

    def finish(self, t: float, end: float, at: Callable[[float], Array]) -> None:
        """End the run in a step from t with the last event."""
        self.keep_at(t + end, at(end))
        self.stopped = str(self.record.events[-1])
        self.steps += 1
