"""Run loop of a simulation: fixed or adaptive steps, events, controller samples, and the error of an unstable step."""

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


def instability_message(run: Run, t0: float, t1: float, y: Array) -> str:
    """Error message for an unstable step from t0 to t1: joint, speed and remedy."""
    speeds = y[run.system.moving]
    sizes = np.where(np.isfinite(speeds), np.abs(speeds), np.inf)  # a speed that is not finite is the fastest
    fastest = int(np.argmax(sizes))
    advice = f"Take a smaller dt than {printed(run.h)} s, or {argument('method', ADAPTIVE)}."
    if run.method == ADAPTIVE:
        advice = "Its error is within the tolerance: look for torques or wrenches that push the way it moves already."
        if run.controller is not None:
            # A damping torque -kd dq held for h turns dq into (1 - kd h / M) dq, which grows if kd > 2 M / h.
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
        self.robot = robot
        self.system = system
        self.scheme = scheme
        self.end = end
        """End of the duration [s]."""
        self.n = n
        """Number of fixed steps, or of samples of a controller between adaptive steps."""
        self.every = every
        """Number of steps from one stored state to the next."""
        self.h = end / n
        self.remarks = remarks
        self.method = method
        self.friction = False
        """True if joint friction is counted."""
        self.record = Record(n // every + 2, system.size, system.nv)
        self.detector: EventDetector | None = None
        self.controller: ControlLaw | None = None
        self.constant = system.held
        """Constant torques; torques of the controller are added to them."""
        self.tick: Callable[[float], None] | None = None
        """Function that is called with the time after each step or block of steps."""
        self.compiled: CompiledSteps | None = None
        """Compiled steps, if no Python function returns a force or observes a step."""
        self.go: Callable[[], None] = self.take_fixed_steps
        """Function that takes all steps."""
        self.stopped = ""
        """Reason why an event ended the run; empty if none did."""
        self.steps = 0
        """Number of steps taken."""
        self.rejected = 0
        """Number of rejected adaptive steps."""
        self.rate = np.zeros(system.size)
        """Rates of the state that were computed last."""
        self.doubling = StepDoubling(n, self.h, lagging=scheme.lagging)
        quadrature = ForceQuadrature(system, *scheme.quadrature, probe_spacing(self.h, end))
        self.force_check = ForceCheck(quadrature, self.h)
        self.contact_durations = ContactDurations([contact.name for contact in system.contacts])
        self.stepper: Stepper | None = None
        """Adaptive method; None for fixed steps."""
        self.accuracy = Accuracy(np.full(robot.nv, np.nan), np.nan)
        self.last: tuple[float, Array] = (0.0, start.copy())
        """Time and value of the last stable state, stored or not; initially the first state."""

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
            _, last_state = self.last
            y = last_state.copy()
        for k in range(self.steps, self.n):  # all steps, or those from the first unstable one of compiled steps
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
        last_time, _ = self.last
        if last_time > self.record.last:
            try:
                self.keep_at(*self.last)
            except (SimulationError, KeyboardInterrupt):  # the run ends by the same error or interrupt already
                unknown = np.full(self.robot.nv, np.nan)
                self.record.keep(*self.last, unknown, unknown)
        remarks = [*self.remarks]
        contact_remark = self.contact_durations.remark(self.h)
        if contact_remark:
            remarks.append(contact_remark)
        if self.detector is not None:
            remarks += self.detector.missed_zero_remarks.values()
        result = self.record.result(
            self.robot,
            WORKS,
            stopped=stopped,
            completed=completed,
            method=self.method,
            dt=self.h,
            steps=self.steps,
            friction=self.friction,
            rejected=self.rejected,
            evaluations=self.system.evaluations,
            error_estimate=self.accuracy.error,
            relative_error=self.accuracy.relative,
            remarks=tuple(remarks),
        )
        accuracy_remarks = self.accuracy.remarks(self.method, result.relative_drift)
        if not accuracy_remarks:
            return result
        return replace(result, remarks=(*remarks, *accuracy_remarks))

    def judge(self) -> None:
        """Estimate the error of the steps so far."""
        if not self.record.count:
            return
        extent = Extent.from_states(self.robot, self.record.states)
        step_error: Array | None = None
        if self.stepper is not None:
            step_error = self.stepper.total_error(extent.spans)
        elif self.doubling.steps:
            flow: CompiledSteps | OneByOne = OneByOne(self.system, self.scheme)
            if self.compiled is not None:
                flow = self.compiled
            step_error = self.doubling.errors(flow, extent.spans)
            if step_error is None and self.compiled is not None:  # its half steps ended off the constraints
                step_error = self.doubling.errors(OneByOne(self.system, self.scheme), extent.spans)
        if step_error is not None:
            self.accuracy = Accuracy.from_error(extent, step_error)
        last_time, _ = self.last
        missed_error = self.force_check.error(extent, last_time)
        if missed_error is None:
            return
        if Accuracy.from_error(extent, missed_error).remarkable:
            self.remarks.append(self.force_check.remark())
            self.accuracy = Accuracy.from_error(extent, np.fmax(self.accuracy.error, missed_error))

    @property
    def without_callbacks(self) -> bool:
        """True if no Python function returns torques or observes steps; contacts and position limits are allowed."""
        if self.controller is not None or self.system.functions:
            return False
        return self.detector is None or self.detector.without_callbacks

    def time(self, k: int) -> float:
        """Start time of fixed step k."""
        return k * self.h if k < self.n else self.end

    def begin(self) -> Array:
        """First state, passed to the event detector."""
        _, first_state = self.last  # no step is taken yet
        y = first_state.copy()
        if self.detector is not None:
            self.detector.begin(0.0, y)
        return y

    def leaves_at_once(self, y: Array, y1: Array, h: float) -> bool:
        """True if a joint starts at a limit and moves beyond it; the stored first state is then the last."""
        if self.detector is None:
            return False
        event = self.detector.event_at_start(y, y1, h)
        if event is None:
            return False
        self.record.events.append(event)
        self.stopped = str(event)
        return True

    def sample(self, t: float, y: Array) -> None:
        """Hold the torques of the controller for a state from t on."""
        if self.controller is not None:
            self.system.held = self.constant + self.controller(t, *self.system.split(y))

    def _changes(self, t: float, y: Array, y1: Array) -> bool:
        """True if a contact begins or ends in the step to y1 at t, or if dry friction stops, releases or reverses a joint."""
        if self.detector is not None and self.contact_durations.names:
            contacts_worked = bool(y1[-1] != y[-1])  # the last entry of a state is the work of contacts
            if self.contact_durations.step(t, self.detector.gaps, worked=contacts_worked):
                return True
        dry_friction = self.system.dry_friction
        moving = self.system.moving
        if dry_friction is None:
            return False
        sign_changes = np.sign(y1[moving]) != np.sign(y[moving])
        return bool(sign_changes[dry_friction.dry].any())

    def advance(self, t: float, y: Array) -> None:
        """Count a stable step, whose final state y at t is the last one."""
        self.steps += 1
        self.last = (t, y)
        if self.tick is not None:
            self.tick(t)

    def keep(self, t: float, y: Array) -> None:
        """Store a state, whose rates were computed last."""
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
        """Raise SimulationError if y, the state after a step, is too fast or not finite."""
        speeds = np.abs(y[self.system.moving])
        if not (speeds.max() < MAX_SPEED and np.isfinite(y).all()):
            raise SimulationError(instability_message(self, t0, t1, y))

    def end_at_event(
        self, t: float, y: Array, points: Sequence[tuple[float, Array]], kept: Sequence[tuple[float, Array]] = ()
    ) -> bool:
        """End the run at the first event that ends it, in a step from y at t; False without such an event.

        ``points`` are times after t and states in the step, including its end. The states ``kept`` are stored if they are
        before the event; then the state at the event is stored.
        """
        state_at = self.along(t, y)
        end = self.locate_event(t, points, state_at)
        if end is None:
            return False
        kept_before = [(t + s, state) for s, state in kept if s < end]
        if kept_before:
            times, states = zip(*kept_before, strict=True)
            self.keep_all(np.array(times), np.array(states))
        self.finish(t, end, state_at)
        return True

    def along(self, t: float, y: Array) -> Callable[[float], Array]:
        """Function from the time after t to the state, for a step from y at t whose rates were computed last."""
        rate = self.rate.copy()

        def state_at(s: float) -> Array:
            y1 = self.scheme.step(t, y, s, rate)
            self.system.manifold.normalise(y1[: self.system.nq])
            return y1

        return state_at

    def locate_event(
        self, t: float, points: Sequence[tuple[float, Array]], state_at: Callable[[float], Array]
    ) -> float | None:
        """Locate and record events in a step from t; returns the time after t of the event that ends the run, or None.

        ``points`` are times after t and states in the step; ``state_at`` returns the state at any time after t.
        """
        if self.detector is None:
            return None
        events, end = self.detector.events_of_step(t, points, state_at)
        self.record.events += events
        return end

    def finish(self, t: float, end: float, state_at: Callable[[float], Array]) -> None:
        """End the run at its last event, in a step from t, a time ``end`` after t."""
        self.keep_at(t + end, state_at(end))
        self.stopped = str(self.record.events[-1])
        self.steps += 1
