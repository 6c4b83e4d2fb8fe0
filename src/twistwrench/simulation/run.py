"""The engine: steps of one length or of any, events, samples of a controller, and nothing lost whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core.probe_rule import probe_spacing
from ..errors import SimulationError
from ..typing import Array
from .accuracy import Accuracy, Extent
from .adaptive import Stepper
from .compiled_steps import CompiledSteps
from .contact_steps import Touches
from .events import Watch
from .force_probes import ForceProbes, UnseenForces
from .forces import WORKS, System
from .free_steps import take_freely
from .result import Record, SimulationResult
from .schemes import ADAPTIVE, OneByOne, Scheme
from .step_blocks import FASTEST, take_blocks
from .step_doubling import Flow, StepDoubling
from .user_functions import Law

if TYPE_CHECKING:
    from ..robot import Robot


class Run:
    """One simulation under way."""

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
        self.record = Record()
        self.watch: Watch | None = None
        self.controller: Law | None = None
        self.constant = system.held
        self.tick: Callable[[float], None] | None = None
        self.compiled: CompiledSteps | None = None
        """Its steps in machine code, where nothing asks Python for a force or looks at a step."""
        self.stopped = ""
        self.steps = self.rejected = 0
        self.rate = np.zeros(system.size)
        self.doubling = StepDoubling(n, self.h, lagging=scheme.lagging)
        self.unseen = UnseenForces(ForceProbes(system, *scheme.asked, probe_spacing(self.h, end)), self.h)
        self.touches = Touches([contact.name for contact in system.contacts])
        self.stepper: Stepper | None = None
        self.accuracy = Accuracy.unknown(robot.nv)
        self.last: tuple[float, Array] = (0.0, start.copy())
        """The last state that is good, kept or not; at first the one that the run begins in."""

    def fixed(self) -> None:
        """Steps of one length."""
        y = self._begin()
        if self.compiled is not None:
            take_blocks(self, self.compiled)
            if self.steps == self.n:
                return
            y = self.last[1].copy()
        for k in range(self.steps, self.n):
            t = k * self.h
            self._sample(t, y)
            self.system.rates(t, y, self.rate)
            if k % self.every == 0:
                self._keep(t, y)
            t1 = (k + 1) * self.h if k + 1 < self.n else self.end
            y1 = self.checked(t, t1, self.scheme.step(t, y, self.h, self.rate))
            if (k == 0 and self._leaves_at_once(y, y1, self.h)) or self._ended(t, y, [(self.h, y1)]):
                return
            changed = self._touched(t1, y, y1) or self._stuck_or_slid(y, y1)
            self.doubling.note(t, y, y1, self.system.held, changed=changed)
            self.unseen.note(t, y, y1)
            y = y1
            self.advance(t1, y)
        self.system.rates(self.end, y, self.rate)
        self._keep(self.end, y)

    def adaptive(self, stepper: Stepper) -> None:
        """Steps of any length, from sample to sample where a controller asks for it; states between by dense output."""
        self.stepper = stepper
        y = self._begin()
        t, k, spacing = 0.0, 0, self.h * self.every
        end = self.end
        self._sample(t, y)
        self.system.rates(t, y, self.rate)
        self._keep(t, y)
        if stepper.attempts is not None:
            take_freely(self, stepper)
            return
        kept = 1
        while t < end:
            until = (k + 1) * self.h if self.controller is not None and k + 1 < self.n else end
            t1, y1 = stepper.step(t, y, self.rate, until)
            self.rejected, rate1 = stepper.rejected, stepper.rate_after
            y1 = self.checked(t, t1, y1)
            if t == 0.0 and self._leaves_at_once(y, y1, t1):
                return
            begin = kept
            while kept * spacing < t1 - 1e-12 * end and kept * spacing < end:
                kept += 1
            times = np.arange(begin, kept) * spacing
            points = list(zip((times - t).tolist(), stepper.between(times), strict=True))
            if self._ended(t, y, [*points, (t1 - t, y1)], points):
                return
            for s, between in points:
                self._keep_at(t + s, between)
            t, y = t1, y1
            self.advance(t, y)
            if self.controller is not None and t == until and t < end:
                k += 1
                self._sample(t, y)
                self.system.rates(t, y, self.rate)
            else:
                self.rate[:] = rate1
                self.system.manifold.rates(*self.system.split(y), out=self.rate[: self.system.nq])
            if abs(kept * spacing - t) <= 1e-12 * end and t < end:
                self._keep_at(t, y)
                kept += 1
        self._keep_at(t, y)

    def result(self, stopped: str, *, completed: bool) -> SimulationResult:
        """All up to here, the last good state included."""
        if self.last[0] > self.record.last:
            self._keep_rough(*self.last)
        said = {"stopped": stopped, "completed": completed, "method": self.method, "dt": self.h, "steps": self.steps}
        counts = {"rejected": self.rejected, "evaluations": self.system.evaluations}
        found = self.record.result(self.robot, WORKS, **said, **counts, remarks=tuple(self.remarks))
        return self.accuracy.told(found, self.touches.remark(self.h))

    def judge(self) -> None:
        """Find what the steps so far are off by."""
        if not self.record.blocks:
            return
        extent = Extent.of(self.robot, self.record.states)
        if self.stepper is not None:
            error: Array | None = self.stepper.judged(extent.spans)
        else:
            error = self.doubling.errors(self.system, self.flow, extent.spans) if self.doubling.steps else None
        if error is not None:
            self.accuracy = Accuracy.of(extent, error)
        left_out = self.unseen.error(extent, self.last[0])
        if left_out is not None and Accuracy.of(extent, left_out).remarkable:
            self.remarks.append(self.unseen.remark())
            self.accuracy = Accuracy.of(extent, np.fmax(self.accuracy.error, left_out))

    # ── parts of a step ──

    @property
    def flow(self) -> Flow:
        """The steps of its method from any state."""
        return self.compiled or OneByOne(self.system, self.scheme)

    def _begin(self) -> Array:
        y = self.last[1].copy()
        if self.watch is not None:
            self.watch.begin(0.0, y)
        return y

    def _leaves_at_once(self, y: Array, y1: Array, h: float) -> bool:
        """Whether a joint begins at a limit and moves beyond it; the first state is kept already, and is the last one too."""
        happened = None if self.watch is None else self.watch.leaves_at_once(y, y1, h)
        if happened is None:
            return False
        self.record.events.append(happened)
        self.stopped = str(happened)
        return True

    def _sample(self, t: float, y: Array) -> None:
        if self.controller is not None:
            self.system.held = self.constant + self.controller(t, *self.system.split(y))

    def _touched(self, t: float, y: Array, y1: Array) -> bool:
        """Whether a contact begins or ends in the step to y1 at t."""
        if self.watch is None or not self.touches.names:
            return False
        return self.touches.step(t, self.watch.gaps, worked=bool(y1[-1] != y[-1]))

    def _stuck_or_slid(self, y: Array, y1: Array) -> bool:
        """Whether dry friction stops a joint, lets one go, or changes sides in the step."""
        braked, moving = self.system.braked, self.system.moving
        return braked is not None and bool((np.sign(y1[moving]) != np.sign(y[moving]))[braked.dry].any())

    def advance(self, t: float, y: Array) -> None:
        """Take note of a step that is good, to y at t."""
        self.steps += 1
        self.last = (t, y)
        if self.tick is not None:
            self.tick(t)

    def _keep(self, t: float, y: Array) -> None:
        """Keep a state whose rates were computed last."""
        self.record.keep(t, y, self.rate[self.system.moving], self.system.applied)

    def _keep_at(self, t: float, y: Array) -> None:
        rate = np.zeros(self.system.size)
        self.system.rates(t, y, rate)
        self.record.keep(t, y, rate[self.system.moving], self.system.applied)

    def _keep_rough(self, t: float, y: Array) -> None:
        """Keep a state after something failed, which may fail again: then accelerations and torques are unknown there."""
        try:
            self._keep_at(t, y)
        except (SimulationError, KeyboardInterrupt):  # an interrupt is under way already
            unknown = np.full(self.robot.nv, np.nan)
            self.record.keep(t, y, unknown, unknown)

    def checked(self, t0: float, t1: float, y: Array) -> Array:
        """The state with its quaternions of unit length; SimulationError where a step was unstable."""
        s = self.system
        s.manifold.normalise(y[: s.nq])
        speed = np.abs(y[s.moving])
        if not (speed.max() < FASTEST and np.isfinite(y).all()):
            bad = int(np.argmax(np.where(np.isfinite(speed), speed, np.inf)))
            advice = f"Take a smaller dt than {self.h:g} s, or method={ADAPTIVE!r}."
            if self.method == ADAPTIVE:
                advice = "Its error is within the tolerance: look for torques or wrenches that push the way it moves already."
                if self.controller is not None:  # held for h, a damping kd turns dq into (1 - kd h / M) dq
                    advice += (
                        f" The controller's torques are held for {self.h:g} s each, too long for a damping above twice the "
                        "inertia over that time: take a smaller dt, less damping, or tau= in place of controller=."
                    )
            raise SimulationError(
                f"the step from {t0:.9g} s to {t1:.9g} s is unstable: joint {self.robot.model.velocity_names[bad]!r} moves at "
                f"{y[s.moving][bad]:.3g} rad/s or m/s after it. {advice}"
            )
        return y

    def _ended(
        self, t: float, y: Array, points: Sequence[tuple[float, Array]], kept: Sequence[tuple[float, Array]] = ()
    ) -> bool:
        """Look for events in a step from t; one that ends all has its state kept, and those before it."""
        if self.watch is None:
            return False
        rate = self.rate.copy()

        def at(s: float) -> Array:
            found = self.scheme.step(t, y, s, rate)
            self.system.manifold.normalise(found[: self.system.nq])
            return found

        happened, end = self.watch.look(t, points, at)
        self.record.events += happened
        if end is None:
            return False
        for s, between in kept:
            if s < end:
                self._keep_at(t + s, between)
        self._keep_at(t + end, at(end))
        self.stopped = str(happened[-1])
        self.steps += 1
        return True
