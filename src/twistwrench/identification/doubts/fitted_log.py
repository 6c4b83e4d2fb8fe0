"""Rows of logs with the fit to them, from which doubts about the fit are derived."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...core.doubts import Doubt
from ...core.estimation.cross_validation import HeldOut
from ...core.estimation.least_squares import NormalEquations, Prior
from ...core.typing import Array
from ..parameters import turning_joints

if TYPE_CHECKING:
    from ...robot import Robot
    from ..hyperparameters import FitSettings
    from ..log_windows import ReadLog
    from ..parameters import BaseParameters

_MOTION_STATES = 200
"""Number of states of the other motion whose torques are predicted."""


@dataclass(frozen=True, eq=False)
class FittedLog:
    """Rows of logs at the chosen settings, with the fit to them."""

    base: BaseParameters
    logs: Sequence[ReadLog]
    W: Array
    """(m, nv, r) columns of the groups."""
    tau: Array
    """(m, nv) torques."""
    settings: FitSettings
    prior: Prior
    x: Array
    """(r,) values of the groups."""
    covariance: Array
    """(r, r) covariance of the groups."""
    held_out: HeldOut
    """Residuals of held-out rows."""
    trained: HeldOut
    """Residuals of fifths of the training rows, each predicted from the others."""
    fifths: Sequence[NormalEquations]
    """Normal equations of the weighted rows of each fifth of the time, joint by joint, in units of the residuals."""
    speed: Array
    """(m, nv) velocities of the joints."""
    acceleration: Array
    """(m, nv) accelerations of the joints."""
    rate: float
    """Lowest sampling rate of the logs [Hz]."""
    dead: Array
    """(nv,) bool, True for joints without a torque."""
    causes: Sequence[Doubt] = ()
    """Doubts about the causes of the residual."""
    payload_only: bool = False
    """True if only a payload is identified; the file lacks it, so torques may differ from the file's."""

    @property
    def deviations(self) -> Array:
        """(r,) standard deviations of the groups."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def drive_columns(self) -> Array:
        """(m, nv, k) columns of the drives' parameters, also of motor inertias in groups of bodies."""
        is_drive = self.base.unknown.of_bodies < 0
        return self.W @ self.base.grouping[:, is_drive]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.base.unknown.model.velocity_names

    @cached_property
    def q(self) -> Array:
        """(n, nq) positions of all rows of the logs."""
        return np.concatenate([log.q for log in self.logs])

    def joints(self, indices: Iterable[int]) -> list[str]:
        """Names of the joints with the given indices."""
        return [self.names[k] for k in indices]

    def first_parameters(self, groups: Iterable[int]) -> str:
        """Names of the first parameters of the groups with the given indices, separated by semicolons."""
        first_names = []
        for k in groups:
            first_name, *_ = self.base.names[k].split(" ")
            first_names.append(first_name)
        return "; ".join(first_names)

    @cached_property
    def other_motion(self) -> Array:
        """(n, nv, r) columns of the groups for random states, as fast as the logs and as wide as the limits."""
        rng = np.random.default_rng(0)
        low, high = _position_ranges(self.base.unknown.robot, self.q)
        q = rng.uniform(low, high, (_MOTION_STATES, self.q.shape[1]))
        dq = rng.normal(size=(_MOTION_STATES, self.speed.shape[1])) * rms(self.speed)
        ddq = rng.normal(size=(_MOTION_STATES, self.acceleration.shape[1])) * rms(self.acceleration)
        return self.base.unknown.columns(self.base.kept, q, dq, ddq, self.settings.friction_speed)

    @cached_property
    def torque_shares(self) -> Array:
        """(nv, r) rms changes of another motion's torques by a deviation of each group, as shares of a joint's rms torque.

        They are 0 for joints without a torque, and for groups that are held at known values.
        """
        W = self.other_motion
        torques = W @ self.x
        rms_torques = np.sqrt((torques**2).mean(axis=0))
        rms_changes = np.sqrt((W**2).mean(axis=0)) * self.deviations
        shares = rms_changes / np.maximum(rms_torques, 1e-300)[:, None]  # 1e-300: also without any torque
        return np.asarray(np.where(self.dead[:, None] | self.base.held, 0.0, shares))


def rms(x: Array) -> Array:
    """(n,) rms values of columns (m, n)."""
    return np.sqrt((x**2).mean(axis=0))


def _position_ranges(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Lowest and highest positions (nv,) of another motion.

    They are the limits, but at most half a turn from zero, and at least the range of the log's positions q (n, nq). A joint
    without limits or motion has the log's range.
    """
    log_low = q.min(axis=0)
    log_high = q.max(axis=0)
    half_turn = np.where(turning_joints(robot.model), np.pi, np.inf)
    lower = np.maximum(robot.limits.lower, -half_turn)
    upper = np.minimum(robot.limits.upper, half_turn)
    has_limits = np.isfinite(lower) & np.isfinite(upper)
    is_extended = (log_high > log_low) & has_limits
    low = np.where(is_extended, np.minimum(lower, log_low), log_low)
    high = np.where(is_extended, np.maximum(upper, log_high), log_high)
    return low, high
