"""Steps whose length follows from an estimate of their error. Hairer, Nørsett and Wanner, volume I, section II.4."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..core.printed_numbers import printed, residual
from ..errors import SimulationError
from ..typing import Array
from .compiled_attempts import CompiledAttempts
from .force_probes import ForceProbes
from .forces import WORKS, System
from .schemes import RungeKutta
from .stiffness import Stiffness
from .tableau import DORMAND_PRINCE

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0


class Stepper:
    """Dormand and Prince's method, the tolerances its steps keep to, and the last step it took."""

    def __init__(
        self, system: System, rtol: float, atol: float, longest: float, spacing: float, duration: float,
        *, attempts: CompiledAttempts | None = None,
    ) -> None:  # fmt: skip
        self.system, self.scheme = system, RungeKutta(system, DORMAND_PRINCE)
        self.probes = ForceProbes(system, *self.scheme.asked, spacing)
        self.rtol, self.atol, self.longest = rtol, atol, longest
        self.stiffness = Stiffness(system, self.scheme, duration)
        self.power = -1.0 / (DORMAND_PRINCE.embedded_order + 1)
        self.h, self.rejected = 0.0, 0
        self.attempts = attempts
        """Its steps in machine code, where no force is a function in Python."""
        if attempts is not None:
            self.stiffness.stages = lambda: attempts.rates[attempts.count]
        self.speed = 0.0
        """The square of all velocities after the last of these."""
        self.rate_after = np.zeros(0)
        """f at the end of the last step; a part of what the dense output is made of."""
        self.errors = np.zeros(system.size)
        """What the steps were judged to be off by, one by one, added up."""
        self.last: tuple[float, float, Array, Array] = (0.0, 0.0, np.zeros(0), np.zeros(0))

    def step(self, t: float, y: Array, rate: Array, until: float) -> tuple[float, Array]:
        """Time and state after one step that is accepted, not beyond ``until``."""
        scheme, attempts = self.scheme, self.attempts
        h = min(self.h or self._first(y, rate, until - t), self.longest)
        grow = _GROW
        while True:
            t1 = until if t + 1.01 * h >= until else t + h
            step = t1 - t
            if attempts is None:
                y1, error, size = self._tried(t, y, rate, step)
            else:
                square, steep, away, self.speed = attempts.take(y, rate, step)
                self.stiffness.note(t, step, math.sqrt(steep), math.sqrt(away))
                size = math.sqrt(square)
            if size <= 1.0:
                factor = min(grow, max(_SHRINK, _SAFETY * size**self.power)) if size > 0 else grow
                if step >= 0.99 * h or factor < 1.0:  # a step cut short by `until` says little of the next
                    self.h = step * factor
                if attempts is None:
                    self.errors += np.abs(error)
                    K = scheme.K.copy()
                else:
                    y1, K = attempts.states[attempts.count], attempts.rates[attempts.count]
                    attempts.accept()
                self.rate_after = K[-1]
                self.last = (t, step, y, K)
                return t1, y1
            self.rejected += 1
            grow = 1.0
            h = step * (max(_SHRINK, _SAFETY * size**self.power) if np.isfinite(size) else 0.1)
            if h < 1e-14 * max(t, 1e-3):
                if attempts is not None:
                    y1, error = attempts.states[attempts.count], attempts.errors[attempts.count]
                bad = np.abs(error / self._allowed(y, y1))[self.system.moving]
                worst = int(np.argmax(np.where(np.isfinite(bad), bad, np.inf)))
                raise SimulationError(
                    f"at t = {printed(t, 9)} s steps shrink below {residual(h)} s and still miss the tolerance, most of "
                    f"all in joint {self.system.robot.model.velocity_names[worst]!r}: a force there jumps, or grows "
                    "without bound. Make it continuous, or take a method of fixed steps."
                )

    def _tried(self, t: float, y: Array, rate: Array, step: float) -> tuple[Array, Array, float]:
        """The state after a step, its error, and how large that is of what is allowed."""
        judged = slice(0, self.system.size - len(WORKS))
        y1 = self.scheme.step(t, y, step, rate)
        self.stiffness.look(t, step, y, y1)
        error = step * np.dot(self.scheme.error, self.scheme.K)
        allowed = self._allowed(y, y1)
        size = float(np.sqrt(np.mean(np.square((error / allowed)[judged]))))
        if size <= 1.0:
            size = max(size, self._unseen(t, step, y, allowed))
        return y1, error, size

    def between(self, times: Array) -> Array:
        """The states (m, size) at times (m,) within the last step, by the dense output."""
        t0, h, y0, K = self.last
        y = y0 + h * _dense(((times - t0) / h)[:, None], self.scheme.dense.T @ K)
        for one in y:
            self.system.manifold.normalise(one[: self.system.nq])
        return y

    def _allowed(self, y: Array, y1: Array) -> Array:
        return self.atol + self.rtol * np.maximum(np.abs(y), np.abs(y1))

    def judged(self, spans: Array) -> Array:
        """What all steps so far were judged to be off by, (nv,) [rad or m], errors of velocity for ``spans`` (nv) [s].

        They are judged by a method of order 4, so it is more than they are off by.
        """
        off = self.errors if self.attempts is None else self.attempts.total
        return np.asarray(self.system.manifold.errors(off[: self.system.nq]) + spans * off[self.system.moving])

    def _unseen(self, t: float, h: float, y: Array, allowed: Array) -> float:
        """What functions do between the stages of a step, as a change of velocity, over what is allowed."""
        Q = self.scheme.dense.T @ self.scheme.K
        missing = self.probes.impulse(t, h, lambda shares: y + h * _dense(shares[:, None], Q))
        if missing is None:
            return 0.0
        change = self.probes.change(*self.system.split(y), missing)
        return float(np.sqrt(np.mean(np.square(change / allowed[self.system.moving]))))

    def _first(self, y: Array, rate: Array, span: float) -> float:
        """A first step in which a straight line goes a hundredth of what there is, or what acts at once."""
        scale = self.atol + self.rtol * np.abs(y)
        judged = slice(0, self.system.size - len(WORKS))
        d0, d1 = (float(np.sqrt(np.mean(np.square((x / scale)[judged])))) for x in (y, rate))
        h = 1e-6 if min(d0, d1) < 1e-5 or not np.isfinite(d1) else 0.01 * d0 / d1
        return min(h, span, self.longest)


def _dense(share: Any, Q: Array) -> Array:
    """The mean rate (..., size) from the beginning of a step to a share (..., 1) of it, times the share."""
    return np.asarray(share ** np.arange(1, len(Q) + 1) @ Q)
