"""Steps whose length follows from an estimate of their error. Hairer, Nørsett and Wanner, volume I, section II.4."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

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
        self, system: System, rtol: float, atol: float, longest: float, spacing: float, duration: float
    ) -> None:
        self.system, self.scheme = system, RungeKutta(system, DORMAND_PRINCE)
        self.probes = ForceProbes(system, *self.scheme.asked, spacing)
        self.rtol, self.atol, self.longest = rtol, atol, longest
        self.stiffness = Stiffness(system, self.scheme, duration)
        self.power = -1.0 / (DORMAND_PRINCE.embedded_order + 1)
        self.h, self.rejected = 0.0, 0
        self.attempts: CompiledAttempts | None = None
        """Its steps in machine code, where no force is a function in Python."""
        self.speed = 0.0
        """The square of all velocities after the last of these."""
        self.rate_after = np.zeros(0)
        """f at the end of the last step; a part of what the dense output is made of."""
        self.errors = np.zeros(system.size)
        """What the steps were judged to be off by, one by one, added up."""
        self.last: tuple[float, float, Array, Array] = (0.0, 0.0, np.zeros(0), np.zeros(0))

    def step(self, t: float, y: Array, rate: Array, until: float) -> tuple[float, Array]:
        """Time and state after one step that is accepted, not beyond ``until``."""
        system, scheme, h = self.system, self.scheme, min(self.h or self._first(y, rate, until - t), self.longest)
        judged = slice(0, system.size - len(WORKS))
        grow = _GROW
        while True:
            t1 = until if t + 1.01 * h >= until else t + h
            step = t1 - t
            if self.attempts is None:
                y1 = scheme.step(t, y, step, rate)
                self.stiffness.look(t, step, y, y1)
                error = step * np.dot(scheme.error, scheme.K)
                allowed = self._allowed(y, y1)
                size = float(np.sqrt(np.mean(np.square((error / allowed)[judged]))))
                if size <= 1.0:
                    size = max(size, self._unseen(t, step, y, allowed))
            else:
                y1, scheme.K, error, found = self.attempts.take(y, rate, step)
                square, steep, away, self.speed = found.tolist()
                self.stiffness.note(t, step, math.sqrt(steep), math.sqrt(away))
                size = math.sqrt(square)
            if size <= 1.0:
                factor = min(grow, max(_SHRINK, _SAFETY * size**self.power)) if size > 0 else grow
                if step >= 0.99 * h or factor < 1.0:  # a step cut short by `until` says little of the next
                    self.h = step * factor
                self.errors += np.abs(error)
                K = scheme.K if self.attempts else scheme.K.copy()  # machine code has new arrays each time
                self.rate_after = K[-1]
                self.last = (t, step, y, K)
                return t1, y1
            self.rejected += 1
            grow = 1.0
            h = step * (max(_SHRINK, _SAFETY * size**self.power) if np.isfinite(size) else 0.1)
            if h < 1e-14 * max(t, 1e-3):
                bad = np.abs(error / self._allowed(y, y1))[system.moving]
                worst = int(np.argmax(np.where(np.isfinite(bad), bad, np.inf)))
                raise SimulationError(
                    f"at t = {t:.9g} s steps shrink below {h:.1e} s and still miss the tolerance, most of all in joint "
                    f"{system.robot.model.velocity_names[worst]!r}: a force there jumps, or grows without bound. Make it "
                    "continuous, or take a method of fixed steps."
                )

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
        off = self.errors
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
