"""Initial values of servo parameters by linear regression of the tracking error.

Each joint's rows are, with the command c, its delay δ, the armature a, damping d, Coulomb friction C and gain kp of the
joint's drive, and the torque r of the file's bodies,

    e = c(t - δ) - q = (a ddq + d dq + C sgn dq + r) / kp.

r and ddq are derivatives of positions and thus noisy. The ratios a/kp, d/kp and C/kp are determined even if r is too small
to determine 1/kp; then kp follows from a guess of the armature. The delay δ minimises Σ_j log |residual_j|².
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
"""Least speed of the rows that are used, and speed v of tanh(dq/v) in place of sgn dq [rad/s, m/s]."""
_MAX_DELAY, _DELAY_COUNT = 0.12, 61
"""Largest delay [s], and number of delays that are compared."""
_MIN_DEVIATIONS = 8.0
"""Deviations from zero at which 1/kp counts as determined."""
_BLOCK = 1.0
"""Length of blocks [s], for deviations of autocorrelated residuals."""
_INERTIA_SHARE = 0.1
"""Guess of an armature that the file does not have, as a share of the largest inertia of all joints."""
_MIN_SHARE_OF_ERROR = 1e-3
"""Smallest part in the error of an initial value, as a share of the largest part of the joint."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of a log on even times, all filtered by the same low-pass."""

    log: ServoLog
    time: Array
    cutoff: float
    """Cut-off of the low-pass [Hz]."""
    columns: Array
    """(n, nv, 4): ddq, dq, sgn dq and the torques r of the bodies."""
    q: Array
    """(n, nv)"""
    block: Array
    """(n,) number of each row's block of time."""

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
        begin = self.time - delay - 0.5 * period  # the mean is over a period about each time
        c = self.log.mean_command(begin, period, hold)
        return np.asarray(low_pass(c, self.cutoff, rate) - self.q)


def scale_determining_torques(robot: Robot, logs: Sequence[ServoLog]) -> Array:
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
    if not robot.armature.any():
        return robot
    return robot.with_armature(dict.fromkeys(robot.model.velocity_names, 0.0))


def linear_start(robot: Robot, logs: Sequence[ServoLog], hold: Hold) -> tuple[Array, Array]:
    """Unknowns (4 nv + 1,), and the guessed armatures (nv,).

    The unknowns are the logarithms of armature, damping, Coulomb friction and kp of each joint, four in a row, and last the
    delay [s].
    """
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

    delays = np.linspace(0.0, _MAX_DELAY, _DELAY_COUNT)
    errors = [_log_square_residuals(joint_fits(delay)) for delay in delays]
    delay = float(delays[int(np.argmin(errors))])
    guess = _guessed_armatures(robot, np.concatenate([log.q for log in logs]))
    parameters = [_drive_parameters(fit, armature) for fit, armature in zip(joint_fits(delay), guess, strict=True)]
    return np.append(np.log(parameters).ravel(), delay), guess


@dataclass(frozen=True, eq=False)
class _JointFit:
    """Regression of the tracking error of a joint in its moving rows, with the block of time of each row."""

    x: Array
    """(4,) coefficients of acceleration, velocity, sign of the velocity and torque of the bodies."""
    X: Array
    """(n, 4) rows of these."""
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


def _log_square_residuals(fits: Sequence[_JointFit]) -> float:
    """Σ_j log |residual_j|² of the joints that move, to be minimised."""
    total = 0.0
    for fit in fits:
        if len(fit.residual):
            total += float(np.log((fit.residual**2).mean() + 1e-30))
    return total


def _drive_parameters(fit: _JointFit, armature: float) -> Array:
    """Armature, damping, Coulomb friction and kp of one joint from its ratios x (4,); the armature is a guess."""
    x, X = fit.x, fit.X
    rms, largest_part, block_sums = np.ones(4), 1.0, np.zeros((1, 4))
    if len(X):
        rms = np.sqrt((X**2).mean(axis=0))
        largest_part = float(np.abs(x * rms).max())  # in the tracking error
        block_begins = np.flatnonzero(np.diff(fit.block, prepend=-1))
        block_sums = np.add.reduceat(X * fit.residual[:, None], block_begins)
    least = _MIN_SHARE_OF_ERROR * largest_part / np.maximum(rms, 1e-12)
    ratio = np.maximum(x, least)  # logarithms need numbers above zero
    N = np.linalg.pinv(X.T @ X)
    covariance = N @ block_sums.T @ block_sums @ N  # residuals within a block may be correlated
    deviation = float(np.sqrt(covariance[3, 3]))
    if deviation > 0.0 and x[3] > _MIN_DEVIATIONS * deviation:  # the torque of the bodies determines 1/kp
        kp = 1.0 / x[3]
    else:
        kp = armature / ratio[0]
    return np.append(kp * ratio[:3], kp)


def _guessed_armatures(robot: Robot, q: Array) -> Array:
    """(nv,) armature of the file, or a share of the largest inertia of all joints."""
    M = np.asarray(robot.mass_matrix(q[:: max(1, len(q) // 100)]))
    inertia = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
    return np.asarray(np.where(robot.armature > 0.0, robot.armature, _INERTIA_SHARE * inertia.max()))
