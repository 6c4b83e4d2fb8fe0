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

_MAX_CUTOFF = 10.0
"""Largest cut-off of the low-pass [Hz]."""
_MAX_CUTOFF_SHARE = 0.2
"""Largest cut-off of the low-pass, as a share of the sampling rate."""
_MIN_SPEED = 0.05
"""Least speed of the rows that are used [rad/s, m/s]."""
_FRICTION_SPEED = 0.02
"""Speed v of tanh(dq/v) in place of sgn dq [rad/s, m/s]."""
_MAX_DELAY = 0.12
"""Largest delay that is tried [s]."""
_DELAY_COUNT = 61
"""Number of delays that are tried."""
_MIN_DEVIATIONS = 8.0
"""Least value of 1/kp, in its standard deviations, that counts as determined."""
_BLOCK_SECONDS = 1.0
"""Duration of blocks [s], for standard deviations of autocorrelated residuals."""
_INERTIA_SHARE = 0.1
"""Guess of an armature that the file does not have, as a share of the largest inertia of all joints."""
_INERTIA_CONFIGURATIONS = 100
"""About the number of configurations in which inertias are evaluated."""
_MIN_SHARE_OF_ERROR = 1e-3
"""Smallest part in the error of an initial value, as a share of the largest part of the joint."""


# Columns of the regression: ddq, dq, sgn dq and the torques of the bodies.
_SPEED_COLUMN = 1
_TORQUE_COLUMN = 3


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of a log on even times, all filtered by the same low-pass."""

    log: ServoLog
    time: Array
    """(n,) even times [s]."""
    cutoff: float
    """Cut-off of the low-pass [Hz]."""
    columns: Array
    """(n, nv, 4): ddq, dq, sgn dq and the torques r of the bodies."""
    q: Array
    """(n, nv) positions."""
    block: Array
    """(n,) number of each row's block of time."""

    @classmethod
    def from_log(cls, robot: Robot, log: ServoLog) -> _Rows:
        """Rows of a log; ``robot`` is without armature, so that bodies alone need its torques."""
        time = np.linspace(0.0, log.time[-1], len(log.time))
        rate = (len(time) - 1) / float(time[-1])
        cutoff = min(_MAX_CUTOFF, _MAX_CUTOFF_SHARE * rate)
        q = low_pass(interpolate(time, log.time, log.q), cutoff, rate)
        dq = np.gradient(q, time, axis=0)
        ddq = np.gradient(dq, time, axis=0)
        sign = low_pass(np.tanh(dq / _FRICTION_SPEED), cutoff, rate)
        body_torques = np.asarray(robot.inverse_dynamics(q, dq, ddq))
        columns = np.stack([ddq, dq, sign, body_torques], axis=2)
        block = (time / _BLOCK_SECONDS).astype(int)
        return cls(log, time, cutoff, columns, q, block)

    def error(self, delay: float, hold: Hold) -> Array:
        """(n, nv) tracking error with a command that is delayed by ``delay`` [s]."""
        rate = (len(self.time) - 1) / float(self.time[-1])
        period = 1.0 / rate
        begin = self.time - delay - 0.5 * period  # of the means, each over a period about its time
        c = self.log.mean_command(begin, period, hold)
        return np.asarray(low_pass(c, self.cutoff, rate) - self.q)


def scale_determining_torques(robot: Robot, logs: Sequence[ServoLog]) -> Array:
    """(nv,) rms of the part of the bodies' torques that determines the scale of a joint's parameters.

    This part is the residual after a fit by torques of armature, damping and friction, which determine only ratios.
    """
    bare_robot = _without_armature(robot)
    columns = np.concatenate([_Rows.from_log(bare_robot, log).columns for log in logs])
    torques = np.zeros(robot.nv)
    for j in range(robot.nv):
        drive_columns = columns[:, j, :_TORQUE_COLUMN]
        torque = columns[:, j, _TORQUE_COLUMN]
        X = drive_columns / (np.linalg.norm(drive_columns, axis=0) + 1e-300)  # not divided by zero
        x, *_ = np.linalg.lstsq(X, torque, rcond=None)
        residual = torque - X @ x
        torques[j] = np.sqrt((residual**2).mean())
    return torques


def _without_armature(robot: Robot) -> Robot:
    """Robot whose drives have no armature."""
    if not robot.armature.any():
        return robot
    return robot.with_armature(dict.fromkeys(robot.model.velocity_names, 0.0))


def linear_start(robot: Robot, logs: Sequence[ServoLog], hold: Hold) -> tuple[Array, Array]:
    """Initial unknowns (4 nv + 1,), and guessed armatures (nv,).

    The unknowns are four logarithms for each joint, of armature, damping, Coulomb friction and kp; and, at the end, the delay
    [s].
    """
    bare_robot = _without_armature(robot)
    rows_of_logs = [_Rows.from_log(bare_robot, log) for log in logs]
    columns = np.concatenate([rows.columns for rows in rows_of_logs])
    block = _block_numbers(rows_of_logs)

    def joint_fits(delay: float) -> list[_JointFit]:
        """Regression of each joint with a delay of the commands."""
        e = np.concatenate([rows.error(delay, hold) for rows in rows_of_logs])
        return [_JointFit.from_rows(columns[:, j], e[:, j], block) for j in range(robot.nv)]

    delays = np.linspace(0.0, _MAX_DELAY, _DELAY_COUNT)
    costs = [_log_square_residuals(joint_fits(delay)) for delay in delays]
    best_delay = float(delays[int(np.argmin(costs))])
    fits = joint_fits(best_delay)
    all_q = np.concatenate([log.q for log in logs])
    armatures = _guessed_armatures(robot, all_q)
    parameters = [_drive_parameters(fit, armature) for fit, armature in zip(fits, armatures, strict=True)]
    logarithms = np.log(parameters).ravel()
    return np.append(logarithms, best_delay), armatures


def _block_numbers(rows_of_logs: Sequence[_Rows]) -> Array:
    """(n,) number of the block of time of each row of all logs; no block is in two logs."""
    block_count = 0
    blocks: list[Array] = []
    for rows in rows_of_logs:
        blocks.append(rows.block + block_count)
        block_count += int(rows.block[-1]) + 1
    return np.concatenate(blocks)


@dataclass(frozen=True, eq=False)
class _JointFit:
    """Regression of the tracking error of a joint in its moving rows, with the block of time of each row."""

    x: Array
    """(4,) coefficients a/kp, d/kp, C/kp and 1/kp of acceleration, velocity, its sign, and the bodies' torque."""
    X: Array
    """(n, 4) acceleration, velocity, its sign, and the bodies' torque in each row."""
    residual: Array
    """(n,) residuals of the tracking error [rad, m]."""
    block: Array
    """(n,) number of each row's block of time."""

    @classmethod
    def from_rows(cls, columns: Array, error: Array, block: Array) -> _JointFit:
        """Fit of columns (n, 4) to the error (n,) of a joint."""
        speed = np.abs(columns[:, _SPEED_COLUMN])
        is_moving = speed > _MIN_SPEED
        X = columns[is_moving]
        y = error[is_moving]
        norms = np.linalg.norm(X, axis=0) + 1e-300  # not divided by zero
        scaled_x, *_ = np.linalg.lstsq(X / norms, y, rcond=None)
        x = scaled_x / norms
        return cls(x, X, y - X @ x, block[is_moving])


def _log_square_residuals(fits: Sequence[_JointFit]) -> float:
    """Σ_j log |residual_j|² of the joints that move, to be minimised."""
    total = 0.0
    for fit in fits:
        if len(fit.residual):
            total += float(np.log((fit.residual**2).mean() + 1e-30))  # no logarithm of zero
    return total


def _drive_parameters(fit: _JointFit, armature: float) -> Array:
    """(4,) armature, damping, Coulomb friction and kp of one joint; the guessed ``armature`` may determine their scale."""
    x = fit.x
    X = fit.X
    if len(X):
        rms = np.sqrt((X**2).mean(axis=0))
        largest_part = float(np.abs(x * rms).max())  # in the tracking error
        block_begins = np.flatnonzero(np.diff(fit.block, prepend=-1))
        block_scores = np.add.reduceat(X * fit.residual[:, None], block_begins)
    else:  # the joint does not move
        rms = np.ones(4)
        largest_part = 1.0
        block_scores = np.zeros((1, 4))
    min_ratios = _MIN_SHARE_OF_ERROR * largest_part / np.maximum(rms, 1e-12)  # not divided by zero
    ratios = np.maximum(x, min_ratios)  # logarithms need numbers above zero
    N = np.linalg.pinv(X.T @ X)
    covariance = N @ block_scores.T @ block_scores @ N  # residuals within a block may be correlated
    inverse_kp = x[_TORQUE_COLUMN]
    deviation = float(np.sqrt(covariance[_TORQUE_COLUMN, _TORQUE_COLUMN]))
    if deviation > 0.0 and inverse_kp > _MIN_DEVIATIONS * deviation:  # the torque of the bodies determines 1/kp
        kp = 1.0 / inverse_kp
    else:
        armature_per_kp = ratios[0]
        kp = armature / armature_per_kp
    return np.append(kp * ratios[:_TORQUE_COLUMN], kp)


def _guessed_armatures(robot: Robot, q: Array) -> Array:
    """(nv,) armature of each drive: from the file, or a share of the largest inertia of all joints."""
    row_step = max(1, len(q) // _INERTIA_CONFIGURATIONS)
    M = np.asarray(robot.mass_matrix(q[::row_step]))
    inertias = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
    guess = _INERTIA_SHARE * inertias.max()
    return np.asarray(np.where(robot.armature > 0.0, robot.armature, guess))
