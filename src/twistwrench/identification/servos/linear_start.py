"""Initial values of servo parameters by linear regression of the tracking error.

With r the torques of the file's bodies, each joint's rows are

    e = c(t - δ) - q = (a ddq + d dq + C sgn dq + r) / kp.

r and ddq are derivatives of positions and thus noisy. The ratios a/kp, d/kp and C/kp are told even if r is too small to
tell 1/kp; then kp follows from a guess of the armature. The delay δ minimises Σ_j log |residual_j|².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.estimation.filters import low_pass
from ...core.typing import Array
from ...robot import Robot
from ..rows import interpolate
from .replay import Hold, ServoLog

_MAX_CUTOFF, _CUTOFF_SHARE = 10.0, 0.2
"""Largest cut-off of the low-pass [Hz], and as a share of the sampling rate."""
_MIN_SPEED, _FRICTION_SPEED = 0.05, 0.02
"""Least speed of rows, and speed at which friction turns [rad/s, m/s]."""
_MAX_DELAY, _DELAYS = 0.12, 61
_MIN_DEVIATIONS = 8.0
"""Deviations from zero at which 1/kp counts as determined."""
_BLOCK = 1.0
"""Length of blocks [s], for deviations of autocorrelated residuals."""
_INERTIA_SHARE = 0.1
"""Guess of an armature that the file does not have, as a share of the joint's inertia."""
_LEAST_SHARE = 1e-3
"""Smallest initial value, as a share of its typical torque."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of a log on even times, low-passed alike: columns (n, nv, 4) and positions (n, nv)."""

    log: ServoLog
    time: Array
    cutoff: float
    columns: Array
    q: Array
    block: Array

    @classmethod
    def from_log(cls, robot: Robot, log: ServoLog) -> _Rows:
        time = np.linspace(0.0, log.time[-1], len(log.time))
        rate = (len(time) - 1) / float(time[-1])
        cutoff = min(_MAX_CUTOFF, _CUTOFF_SHARE * rate)
        q = low_pass(interpolate(time, log.time, log.q), cutoff, rate)
        dq = np.gradient(q, time, axis=0)
        ddq = np.gradient(dq, time, axis=0)
        sign = low_pass(np.tanh(dq / _FRICTION_SPEED), cutoff, rate)
        columns = np.stack([ddq, dq, sign, np.asarray(robot.inverse_dynamics(q, dq, ddq))], axis=2)
        return cls(log, time, cutoff, columns, q, (time / _BLOCK).astype(int))

    def error(self, delay: float, hold: Hold) -> Array:
        """(n, nv) tracking error with a delayed command."""
        rate = (len(self.time) - 1) / float(self.time[-1])
        period = 1.0 / rate
        c = self.log.mean_command(self.time - delay - 0.5 * period, period, hold)
        return np.asarray(low_pass(c, self.cutoff, rate) - self.q)


def scale_torques(robot: Robot, logs: Sequence[ServoLog]) -> Array:
    """(nv,) rms torques of the file's bodies that armature, damping and friction cannot imitate: they determine the scale."""
    bodies = _without_armature(robot)
    columns = np.concatenate([_Rows.from_log(bodies, log).columns for log in logs])
    scale = np.zeros(robot.nv)
    for j in range(robot.nv):
        drive, torque = columns[:, j, :3], columns[:, j, 3]
        X = drive / (np.linalg.norm(drive, axis=0) + 1e-300)
        residual = torque - X @ np.linalg.lstsq(X, torque, rcond=None)[0]
        scale[j] = np.sqrt((residual**2).mean())
    return scale


def _without_armature(robot: Robot) -> Robot:
    return robot.with_armature(dict.fromkeys(robot.model.velocity_names, 0.0)) if robot.armature.any() else robot


def linear_start(robot: Robot, logs: Sequence[ServoLog], hold: Hold) -> tuple[Array, Array]:
    """Logarithms (nv, 4) of armature, damping, Coulomb friction and kp, with the delay last (4 nv + 1,); guessed armatures."""
    bodies = _without_armature(robot)
    rows = [_Rows.from_log(bodies, log) for log in logs]
    parts, blocks, count = list[Array](), list[Array](), 0
    for one in rows:
        parts.append(one.columns)
        blocks.append(one.block + count)
        count += int(one.block[-1]) + 1
    columns, block = np.concatenate(parts), np.concatenate(blocks)

    def joint_fits(delay: float) -> list[_JointFit]:
        e = np.concatenate([one.error(delay, hold) for one in rows])
        return [_JointFit.from_rows(columns[:, j], e[:, j], block) for j in range(robot.nv)]

    delays = np.linspace(0.0, _MAX_DELAY, _DELAYS)
    scores = [_score(joint_fits(delay)) for delay in delays]
    delay = float(delays[int(np.argmin(scores))])
    guess = _guessed_armatures(robot, np.concatenate([log.q for log in logs]))
    x = np.stack([_start(fit, guess[j]) for j, fit in enumerate(joint_fits(delay))])
    return np.append(np.log(x).ravel(), delay), guess


@dataclass(frozen=True, eq=False)
class _JointFit:
    """Regression of the tracking error of a joint in its moving rows, with the block of time of each row."""

    x: Array
    """(4,) coefficients of acceleration, velocity, sign of the velocity and torque of the bodies."""
    X: Array
    residual: Array
    block: Array

    @classmethod
    def from_rows(cls, columns: Array, error: Array, block: Array) -> _JointFit:
        """Fit of columns (n, 4) to the error (n,) of a joint."""
        moving = np.abs(columns[:, 1]) > _MIN_SPEED
        X, y = columns[moving], error[moving]
        size = np.linalg.norm(X, axis=0) + 1e-300
        x = np.linalg.lstsq(X / size, y, rcond=None)[0] / size
        return cls(x, X, y - X @ x, block[moving])


def _score(fits: Sequence[_JointFit]) -> float:
    """Σ_j log |residual_j|² of the joints that move, to be minimised."""
    score = 0.0
    for fit in fits:
        if len(fit.residual):
            score += float(np.log((fit.residual**2).mean() + 1e-30))
    return score


def _start(fit: _JointFit, armature: float) -> Array:
    """Armature, damping, Coulomb friction and kp of one joint from its ratios x (4,)."""
    x, X = fit.x, fit.X
    size, pull, scores = np.ones(4), 1.0, np.zeros((1, 4))
    if len(X):
        size = np.sqrt((X**2).mean(axis=0))
        pull = float(np.abs(x * size).max())
        edges = np.flatnonzero(np.diff(fit.block, prepend=-1))
        scores = np.add.reduceat(X * fit.residual[:, None], edges)
    ratio = np.maximum(x, _LEAST_SHARE * pull / np.maximum(size, 1e-12))
    N = np.linalg.pinv(X.T @ X)
    deviation = float(np.sqrt((N @ scores.T @ scores @ N)[3, 3]))
    kp = 1.0 / x[3] if x[3] > _MIN_DEVIATIONS * deviation > 0.0 else armature / ratio[0]
    return np.array([*(kp * ratio[:3]), kp])


def _guessed_armatures(robot: Robot, q: Array) -> Array:
    """(nv,) armature of the file, or a share of the largest inertia of all joints."""
    M = np.asarray(robot.mass_matrix(q[:: max(1, len(q) // 100)]))
    inertia = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
    return np.asarray(np.where(robot.armature > 0.0, robot.armature, _INERTIA_SHARE * inertia.max()))
