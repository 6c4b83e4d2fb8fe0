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
"""Parameters of the servo of each joint, in the order of the unknowns.

The vector p of unknowns has the logarithms of these four for each joint in turn, and ends with the delay [s].
"""
_ARMATURE, _DAMPING, _COULOMB, _STIFFNESS = range(len(QUANTITIES))
"""Indices in :data:`QUANTITIES`."""
SERVO_UNITS = {
    "armature": ("kg m^2", "kg"),
    "damping": ("N m s/rad", "N s/m"),
    "coulomb": units_of("tau", (True, False)),  # of a turning and a sliding joint
    "kp": ("N m/rad", "N/m"),
}
"""SI units of each value: of a turning joint, of a sliding joint."""


def servo_unit(quantity: str, *, turning: bool) -> str:
    """SI unit of a value of a turning or a sliding joint."""
    turning_unit, sliding_unit = SERVO_UNITS[quantity]
    return turning_unit if turning else sliding_unit


LAWS = {"stribeck": 0.1, "presliding": 0.01, "falling": 1.0, "load": 0.0}
"""Other laws of friction, with their Stribeck speeds [rad/s, m/s].

``load`` is friction that depends on the carried torque, without a Stribeck speed. The others are friction peaks around rest,
of different widths.
"""
_MAX_STATE_STEP = 2.5e-3
"""Longest time between stored states [s]; positions between them are cubic."""
_MIN_STEP = 5e-5
_MAX_STEP = 5e-4
"""Bounds of the integrator's step [s]."""
_MIN_STEPS_PER_PERIOD = 20.0
"""Least number of integrator steps in √(armature/kp), the period of the servo divided by 2π."""
_MAX_SHARE_OF_DECAY = 0.5
"""Longest step as a share of armature/damping, the decay time of velocities."""
_MIN_ARMATURE_SHARE = 0.1
"""Least armature used by the steps, as a share of the servo's armature."""
_BATCH_BYTES = 96 * 2**20
"""Largest size of the commands of one batch [bytes]."""
_BYTES_PER_FLOAT = 8  # double precision
_MIN_INITIAL_ROWS = 8
"""Least number of rows at the begin of a log from which its initial velocity is computed."""
_MIN_INITIAL_SECONDS = 0.1
"""Least duration of these rows [s]."""
_HOLD_SECONDS = 1e3
"""Time for which the first command is held before the log, and the last after it [s]: longer than any delay."""


@dataclass(frozen=True, eq=False)
class ServoLog:
    """Times (n,) from 0 [s], positions and commands (n, nv), and the velocity (nv,) at the begin."""

    time: Array
    q: Array
    command: Array
    begin_velocity: Array

    @classmethod
    def from_arrays(cls, time: Array, q: Array, command: Array) -> ServoLog:
        """Log of arrays; the initial velocity is the slope at time 0 of a cubic fitted to the first rows."""
        t = time - time[0]
        row_count = max(_MIN_INITIAL_ROWS, int(np.searchsorted(t, _MIN_INITIAL_SECONDS)))
        first_rows = slice(0, row_count)
        coefficients = np.polynomial.polynomial.polyfit(t[first_rows], q[first_rows], 3)  # of powers 0 to 3
        begin_velocity = coefficients[1]  # slope at t = 0
        return cls(t, q, command, begin_velocity)

    @property
    def period(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.time)))

    def mean_command(self, begin: Array, width: float, hold: Hold) -> Array:
        """Means (k, nv) of the command from ``begin`` (k,) to ``begin + width`` [s].

        A mean changes smoothly with a delay, even if the command is held between samples.
        """
        if hold == "linear":  # the mean of a straight command is nearly its value in the middle
            return interpolate(begin + 0.5 * width, self.time, self.command)
        # the integral of a held command is piecewise linear between the times at which the command changes
        knots = np.concatenate([[-_HOLD_SECONDS], self.time[1:], [self.time[-1] + _HOLD_SECONDS]])
        increments = np.diff(knots)[:, None] * self.command  # of the integral between knots
        start_value = np.zeros((1, self.q.shape[1]))
        integral = np.concatenate([start_value, increments]).cumsum(axis=0)  # at the knots
        integral_to_end = interpolate(begin + width, knots, integral)
        integral_to_begin = interpolate(begin, knots, integral)
        return np.asarray((integral_to_end - integral_to_begin) / width)


@dataclass(frozen=True, eq=False)
class ServoReplay:
    """Replay of logs on one robot with steps of one length.

    Arrays with a first axis of length S have an entry for each of S vectors of unknowns.
    """

    robot: Robot
    logs: Sequence[ServoLog]
    hold: Hold
    step: float
    """Step of the integrator [s]."""
    law: str = ""
    """Name of an additional law of friction in :data:`LAWS`; empty for Coulomb friction alone."""
    share: Array | None = None
    """Coefficients (S, nv) of this law, as shares of Coulomb friction; of ``load``, as shares of the carried torque."""
    count: list[int] = field(default_factory=lambda: [0])
    """Number of rollouts so far, as the only entry of a list, since the replay itself is frozen."""

    @staticmethod
    def step_of(p: Array) -> float:
        """Step [s] that is short enough for unknowns p (4 nv + 1,)."""
        logarithms = p[:-1].reshape(-1, len(QUANTITIES))  # without the delay
        armature, damping, _, kp = np.exp(logarithms).T
        shortest_period = np.sqrt(armature / kp).min()
        shortest_decay = (armature / damping).min()
        step = min(shortest_period / _MIN_STEPS_PER_PERIOD, _MAX_SHARE_OF_DECAY * shortest_decay)
        return float(np.clip(step, _MIN_STEP, _MAX_STEP))

    def positions(self, p: Array) -> list[Array]:
        """Positions (S, n, nv) of the rows of each log, for unknowns p (S, 4 nv + 1)."""
        return [self._positions_of(log, p) for log in self.logs]

    def _positions_of(self, log: ServoLog, p: Array) -> Array:
        """Positions (S, n, nv) of the rows of one log, computed in batches to limit memory."""
        steps_per_state = max(1, int(_MAX_STATE_STEP / self.step))  # from one stored state to the next
        time_per_state = steps_per_state * self.step
        state_count = int(np.ceil(log.time[-1] / time_per_state) + 1)
        steps = steps_per_state * state_count
        bytes_per_command = _BYTES_PER_FLOAT * steps * self.robot.nv
        batch_size = max(1, _BATCH_BYTES // bytes_per_command)
        share = np.zeros((len(p), self.robot.nv)) if self.share is None else self.share
        positions = list[Array]()
        for first in range(0, len(p), batch_size):
            batch = slice(first, first + batch_size)
            positions.append(self._positions_of_batch(log, p[batch], share[batch], steps, steps_per_state))
        return np.concatenate(positions)

    def _positions_of_batch(self, log: ServoLog, p: Array, share: Array, steps: int, steps_per_state: int) -> Array:
        """Positions (S, n, nv) of the rows of one log, for all unknowns p (S, 4 nv + 1) together."""
        self.count[0] += len(p)
        logarithms = p[:, :-1].reshape(len(p), -1, len(QUANTITIES))  # without the delay
        x = np.exp(logarithms)  # (S, nv, 4)
        h = self.step
        begins = h * np.arange(steps)  # begin of each step [s]
        delays, delay_indices = np.unique(p[:, -1], return_inverse=True)  # most unknowns share one delay
        commands = np.stack([log.mean_command(begins - delay, h, self.hold) for delay in delays])
        reference = commands[delay_indices]
        armature, damping = self._stepped_values(x)
        stiffness = x[:, None, :, _STIFFNESS]  # equal in all steps, which are axis 1
        law = BatchPD(reference, stiffness, damping[:, None], gravity=False)
        parameters = self._parameters(armature, x[:, :, _COULOMB], share)
        begin_positions = np.broadcast_to(log.q[0], (len(p), len(log.q[0])))
        rollout = self.robot.rollout(
            begin_positions, log.begin_velocity, law, dt=h, steps=steps, every=steps_per_state, parameters=parameters,
            friction=True,
        )  # fmt: skip
        return _hermite(rollout.q, rollout.dq, log.time, steps_per_state * h)

    def _stepped_values(self, x: Array) -> tuple[Array, Array]:
        """Armature and damping (S, nv) with which steps of length h move like a servo with values x (S, nv, 4).

        Steps take the stiffness half a step early, kp (q - ½ h dq), and the damping half a step late, d (dq + ½ h ddq). So the
        damping is increased by ½ h kp, and the armature decreased by ½ h times this damping.
        """
        damping = x[:, :, _DAMPING] + 0.5 * self.step * x[:, :, _STIFFNESS]
        armature = x[:, :, _ARMATURE] - 0.5 * self.step * damping
        min_armature = _MIN_ARMATURE_SHARE * x[:, :, _ARMATURE]
        return np.maximum(armature, min_armature), damping

    def _parameters(self, armature: Array, coulomb: Array, share: Array) -> dict[str, Array | float]:
        """Armature and friction by name; viscous friction is zero, since damping is part of the torque law."""
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
    """Values (S, m, nv) at times (m,) of cubics through values q and slopes dq (S, n, nv) at steps of h."""
    last_interval = q.shape[1] - 2
    k = np.minimum((time / h).astype(int), last_interval)  # interval of each time
    u = (time / h - k)[:, None]  # from 0 at step k to 1 at step k + 1
    first_weight = (1.0 + 2.0 * u) * (1.0 - u) ** 2
    last_weight = u**2 * (3.0 - 2.0 * u)
    slope_terms = h * u * (1.0 - u) * ((1.0 - u) * dq[:, k] - u * dq[:, k + 1])
    return np.asarray(first_weight * q[:, k] + last_weight * q[:, k + 1] + slope_terms)
