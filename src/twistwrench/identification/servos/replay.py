"""Replay of logs from their commands, for many values of the servos' parameters at once.

A position servo with stiffness kp, damping d, armature a and Coulomb friction C follows a command c with a delay δ:

    M(q) ddq + a ddq + h(q, dq) = kp (c(t - δ) - q) - d dq - C sgn dq,

with M and h of the bodies in the robot's file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ...core.typing import Array
from ...mechanics.joints.units import units_of
from ...robot import Robot
from ...simulation.torque_laws import BatchPD
from ..rows import interpolate

Hold = Literal["zero", "linear"]
"""Course of a command between its samples: held, or straight."""
QUANTITIES = ("armature", "damping", "coulomb", "kp")
"""Values of each joint, in the order of the unknowns; their logarithms are estimated, and the delay is the last unknown."""
SERVO_UNITS = {
    "armature": ("kg m^2", "kg"),
    "damping": ("N m s/rad", "N s/m"),
    "coulomb": units_of("tau", (True, False)),
    "kp": ("N m/rad", "N/m"),
}
"""SI units of each value of a joint: turning joints first, then sliding ones."""


def servo_unit(quantity: str, *, turning: bool) -> str:
    """SI unit of a value of a turning or a sliding joint."""
    of_turning, of_sliding = SERVO_UNITS[quantity]
    return of_turning if turning else of_sliding


LAWS = {"stribeck": 0.1, "presliding": 0.01, "falling": 1.0, "load": 0.0}
"""Other laws of friction, with their Stribeck speeds [rad/s, m/s]: peaks, presliding, and friction of the carried torque."""
_MAX_STATE_STEP = 2.5e-3
"""Longest time between stored states [s]; positions between them are cubic."""
_MAX_STEP, _MIN_STEP, _STEPS_OF_PERIOD = 5e-4, 5e-5, 20.0
"""Bounds of the integrator's step [s], and steps per √(armature/kp)."""
_MAX_SHARE_OF_DECAY, _MIN_ARMATURE_SHARE = 0.5, 0.1
"""Longest step as a share of armature/damping, and least armature of steps as a share of the servo's."""
_BYTES = 96 * 2**20
"""Largest size of the references of one batch."""
_FIRST_ROWS, _FIRST_SECONDS = 8, 0.1
"""Rows at the begin, and their least duration [s], for the initial velocity."""
_LONG_BEFORE = 1e3


@dataclass(frozen=True, eq=False)
class ServoLog:
    """Times (n,) from 0 [s], positions and commands (n, nv), and the velocity (nv,) at the begin."""

    time: Array
    q: Array
    command: Array
    begin_velocity: Array

    @classmethod
    def from_arrays(cls, time: Array, q: Array, command: Array) -> ServoLog:
        """Log of arrays; the initial velocity is that of a cubic through the first rows."""
        t = time - time[0]
        first = slice(0, max(_FIRST_ROWS, int(np.searchsorted(t, _FIRST_SECONDS))))
        slope = np.polynomial.polynomial.polyfit(t[first], q[first], 3)[1]
        return cls(t, q, command, slope)

    @property
    def period(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.time)))

    def mean_command(self, begin: Array, width: float, hold: Hold) -> Array:
        """(k, nv) mean of the command over [begin, begin + width], which is smooth in a delay also if it is held."""
        if hold == "linear":
            return interpolate(begin + 0.5 * width, self.time, self.command)
        knots = np.concatenate([[-_LONG_BEFORE], self.time[1:], [self.time[-1] + _LONG_BEFORE]])
        increments = np.diff(knots)[:, None] * self.command
        integral = np.concatenate([np.zeros((1, self.q.shape[1])), increments]).cumsum(axis=0)
        at_end, at_begin = interpolate(begin + width, knots, integral), interpolate(begin + 0.0, knots, integral)
        return np.asarray((at_end - at_begin) / width)


@dataclass(frozen=True, eq=False)
class ServoReplay:
    """Replay of logs on one robot with steps of one length."""

    robot: Robot
    logs: Sequence[ServoLog]
    hold: Hold
    step: float
    law: str = ""
    """Law of friction with a coefficient for each joint beside the unknowns: one of :data:`LAWS`."""
    share: Array | None = None
    """(S, nv) coefficients of this law, in Coulomb frictions, or of the carried torque for ``load``."""
    count: list[int] = field(default_factory=lambda: [0])
    """Number of rollouts so far."""

    @staticmethod
    def step_of(p: Array) -> float:
        """Step [s] that is short enough for unknowns p (4 nv + 1,)."""
        x = np.exp(p[:-1].reshape(-1, len(QUANTITIES)))
        longest = min(
            np.sqrt(x[:, 0] / x[:, 3]).min() / _STEPS_OF_PERIOD, _MAX_SHARE_OF_DECAY * (x[:, 0] / x[:, 1]).min()
        )
        return float(np.clip(longest, _MIN_STEP, _MAX_STEP))

    def positions(self, p: Array) -> list[Array]:
        """Positions (S, n, nv) of the rows of each log, for unknowns p (S, 4 nv + 1)."""
        return [self._positions_of(log, p) for log in self.logs]

    def _positions_of(self, log: ServoLog, p: Array) -> Array:
        every = max(1, int(_MAX_STATE_STEP / self.step))
        steps = every * int(np.ceil(log.time[-1] / (every * self.step)) + 1)
        most = max(1, _BYTES // (8 * steps * self.robot.nv))
        share = np.zeros((len(p), self.robot.nv)) if self.share is None else self.share
        parts = list[Array]()
        for k in range(0, len(p), most):
            batch = slice(k, k + most)
            parts.append(self._batch(log, p[batch], share[batch], steps, every))
        return np.concatenate(parts)

    def _batch(self, log: ServoLog, p: Array, share: Array, steps: int, every: int) -> Array:
        self.count[0] += len(p)
        x, h = np.exp(p[:, :-1].reshape(len(p), -1, len(QUANTITIES))), self.step
        begin = h * np.arange(steps)
        delays, which = np.unique(p[:, -1], return_inverse=True)
        commands = np.stack([log.mean_command(begin - delay, h, self.hold) for delay in delays])
        reference = commands[which]
        armature, damping = self._stepped_values(x)
        law = BatchPD(reference, x[:, None, :, 3], damping[:, None], gravity=False)
        found = self.robot.rollout(
            np.broadcast_to(log.q[0], (len(p), len(log.q[0]))), log.begin_velocity, law, dt=h, steps=steps, every=every,
            parameters=self._parameters(armature, x[:, :, 2], share), friction=True,
        )  # fmt: skip
        return _hermite(found.q, found.dq, log.time, every * h)

    def _stepped_values(self, x: Array) -> tuple[Array, Array]:
        """Armature and damping (S, nv) with which steps of length h move as a servo with values x does.

        Steps take the stiffness half a step early and the damping half a step late, kp (q - ½ h dq) and d (dq + ½ h ddq).
        """
        damping = x[:, :, 1] + 0.5 * self.step * x[:, :, 3]
        armature = x[:, :, 0] - 0.5 * self.step * damping
        return np.maximum(armature, _MIN_ARMATURE_SHARE * x[:, :, 0]), damping

    def _parameters(self, armature: Array, coulomb: Array, share: Array) -> dict[str, Array | float]:
        """Armature and friction by name; damping is in the law."""
        parameters: dict[str, Array | float] = {}
        for j, name in enumerate(self.robot.model.drive_names):
            parameters[f"{name}.armature"] = armature[:, j]
            parameters[f"{name}.coulomb"] = coulomb[:, j]
            parameters[f"{name}.viscous"] = 0.0
            parameters[f"{name}.load"] = share[:, j] if self.law == "load" else 0.0
            if self.law and self.law != "load":
                parameters[f"{name}.static"] = coulomb[:, j] * (1.0 + share[:, j])
                parameters[f"{name}.stribeck"] = LAWS[self.law]
        return parameters


def _hermite(q: Array, dq: Array, time: Array, h: float) -> Array:
    """(S, m, nv) values at times (m,) of cubics through values and slopes (S, n, nv) at steps of h."""
    k = np.minimum((time / h).astype(int), q.shape[1] - 2)
    u = (time / h - k)[:, None]
    first, last = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u**2 * (3.0 - 2.0 * u)
    slopes = h * u * (1.0 - u)
    return np.asarray(first * q[:, k] + last * q[:, k + 1] + slopes * ((1.0 - u) * dq[:, k] - u * dq[:, k + 1]))
