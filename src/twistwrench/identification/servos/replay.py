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
"""Other laws of friction, with their Stribeck speeds [rad/s, m/s].

The first three have friction peaks of different widths around rest; friction of ``load`` depends on the carried torque.
"""
_MAX_STATE_STEP = 2.5e-3
"""Longest time between stored states [s]; positions between them are cubic."""
_MAX_STEP, _MIN_STEP = 5e-4, 5e-5
"""Bounds of the integrator's step [s]."""
_STEPS_OF_PERIOD = 20.0
"""Least number of integrator steps in √(armature/kp)."""
_MAX_SHARE_OF_DECAY = 0.5
"""Longest step as a share of armature/damping."""
_MIN_ARMATURE_SHARE = 0.1
"""Least armature of the steps as a share of the servo's."""
_BATCH_BYTES = 96 * 2**20
"""Largest size of the commands of one batch."""
_FIRST_ROWS = 8
"""Least number of first rows from which the initial velocity is computed."""
_FIRST_SECONDS = 0.1
"""Least duration of these rows [s]."""
_HOLD_SECONDS = 1e3
"""Time for which the first and the last command are held outside of the log [s]: longer than any delay."""


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
        first_rows = slice(0, max(_FIRST_ROWS, int(np.searchsorted(t, _FIRST_SECONDS))))
        coefficients = np.polynomial.polynomial.polyfit(t[first_rows], q[first_rows], 3)
        begin_velocity = coefficients[1]
        return cls(t, q, command, begin_velocity)

    @property
    def period(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.time)))

    def mean_command(self, begin: Array, width: float, hold: Hold) -> Array:
        """(k, nv) means of the command over [begin, begin + width] (k,). They are smooth in a delay, also of held commands.

        The mean of straight commands is nearly their value in the middle.
        """
        if hold == "linear":
            return interpolate(begin + 0.5 * width, self.time, self.command)
        # the integral of a held command is piecewise linear between the times at which the command changes
        knots = np.concatenate([[-_HOLD_SECONDS], self.time[1:], [self.time[-1] + _HOLD_SECONDS]])
        increments = np.diff(knots)[:, None] * self.command
        integral = np.concatenate([np.zeros((1, self.q.shape[1])), increments]).cumsum(axis=0)
        at_end = interpolate(begin + width, knots, integral)
        at_begin = interpolate(begin + 0.0, knots, integral)
        return np.asarray((at_end - at_begin) / width)


@dataclass(frozen=True, eq=False)
class ServoReplay:
    """Replay of logs on one robot with steps of one length."""

    robot: Robot
    logs: Sequence[ServoLog]
    hold: Hold
    step: float
    law: str = ""
    """Additional law of friction, one of :data:`LAWS`, with a coefficient for each joint."""
    share: Array | None = None
    """(S, nv) coefficients of this law: shares of Coulomb friction; for ``load``, shares of the carried torque."""
    count: list[int] = field(default_factory=lambda: [0])
    """Number of rollouts so far."""

    @staticmethod
    def step_of(p: Array) -> float:
        """Step [s] that is short enough for unknowns p (4 nv + 1,)."""
        armature, damping, _, kp = np.exp(p[:-1].reshape(-1, len(QUANTITIES))).T
        shortest_period = np.sqrt(armature / kp).min()
        shortest_decay = (armature / damping).min()
        step = min(shortest_period / _STEPS_OF_PERIOD, _MAX_SHARE_OF_DECAY * shortest_decay)
        return float(np.clip(step, _MIN_STEP, _MAX_STEP))

    def positions(self, p: Array) -> list[Array]:
        """Positions (S, n, nv) of the rows of each log, for unknowns p (S, 4 nv + 1)."""
        return [self._positions_of(log, p) for log in self.logs]

    def _positions_of(self, log: ServoLog, p: Array) -> Array:
        """Positions (S, n, nv) of the rows of one log, computed in batches to limit memory."""
        stored_every = max(1, int(_MAX_STATE_STEP / self.step))  # steps from one stored state to the next
        steps = stored_every * int(np.ceil(log.time[-1] / (stored_every * self.step)) + 1)
        batch_size = max(1, _BATCH_BYTES // (8 * steps * self.robot.nv))
        share = np.zeros((len(p), self.robot.nv)) if self.share is None else self.share
        positions = list[Array]()
        for k in range(0, len(p), batch_size):
            batch = slice(k, k + batch_size)
            positions.append(self._batch(log, p[batch], share[batch], steps, stored_every))
        return np.concatenate(positions)

    def _batch(self, log: ServoLog, p: Array, share: Array, steps: int, stored_every: int) -> Array:
        """Positions (S, n, nv) of the rows of one log, for all unknowns p (S, 4 nv + 1) together."""
        self.count[0] += len(p)
        x = np.exp(p[:, :-1].reshape(len(p), -1, len(QUANTITIES)))
        h = self.step
        begins = h * np.arange(steps)
        delays, delay_of_batch = np.unique(p[:, -1], return_inverse=True)  # most unknowns share one delay
        commands = np.stack([log.mean_command(begins - delay, h, self.hold) for delay in delays])
        reference = commands[delay_of_batch]
        armature, damping = self._stepped_values(x)
        law = BatchPD(reference, x[:, None, :, 3], damping[:, None], gravity=False)
        rollout = self.robot.rollout(
            np.broadcast_to(log.q[0], (len(p), len(log.q[0]))), log.begin_velocity, law, dt=h, steps=steps,
            every=stored_every, parameters=self._parameters(armature, x[:, :, 2], share), friction=True,
        )  # fmt: skip
        return _hermite(rollout.q, rollout.dq, log.time, stored_every * h)

    def _stepped_values(self, x: Array) -> tuple[Array, Array]:
        """Armature and damping (S, nv) with which steps of length h move as a servo with values x (S, nv, 4) does.

        Steps take the stiffness half a step early, kp (q - ½ h dq), and the damping half a step late, d (dq + ½ h ddq). So the
        damping is increased by ½ h kp, and the armature decreased by ½ h times this damping.
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
    u = (time / h - k)[:, None]  # place between step k and the next, 0 to 1
    first, last = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u**2 * (3.0 - 2.0 * u)
    slopes = h * u * (1.0 - u)
    return np.asarray(first * q[:, k] + last * q[:, k + 1] + slopes * ((1.0 - u) * dq[:, k] - u * dq[:, k + 1]))
