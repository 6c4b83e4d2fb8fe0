"""Effect of a log's noise on the support of a robot: failures that noise may cause, and margins with their intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.numbers import number, plus_minus, seconds
from ...core.typing import Array
from ..statistics import INTERVAL
from .slope import samples

if TYPE_CHECKING:
    from ...motion.differentiation import Differentiation, MotionSamples
    from .ground_support import GroundSupport

_MAX_SIGMAS_OF_NOISE = 5.0
"""Standard deviations not exceeded by any of some million samples."""
_FACTOR_BEYOND_MARGIN = 1.01
"""Factor of the margin in speed at which the motion that fails is found."""
_BATCH_SIZE = 4096
"""States of one batch."""
_MIN_STATED_INTERVAL = 0.002
"""Relative half of the interval of the margin from which it is stated."""


@dataclass(frozen=True, eq=False)
class SupportNoise:
    """Effect of the noise of derived accelerations on contact forces and margins."""

    certain: Array
    """(n,) of bool: True at instants that fail by more than noise explains."""
    spread: float
    """Relative standard deviation of the margin in speed at the instant that sets it; 0 without a margin."""
    speed: float
    """Margin in speed; inf without one."""
    time: float
    """Instant that sets the margin [s]."""
    how: str
    """Failure beyond the margin."""

    @property
    def hides(self) -> bool:
        """True if the robot may tip or slip within the noise, although it stands by the estimate."""
        if not math.isfinite(self.speed):
            return False
        margin_in_power = self.speed**2 - 1.0  # inertial forces grow with the square of the speed
        return margin_in_power < _MAX_SIGMAS_OF_NOISE * self.spread * self.speed**2

    @property
    def words(self) -> str:
        """Sentence on a margin that noise may use up."""
        half = INTERVAL * 0.5 * self.spread * self.speed
        margin = plus_minus(self.speed, half)
        return (
            f"noise of the log decides whether it {self.how} at t = {seconds(self.time)} s: it holds up to "
            f"{margin} × this speed"
        )

    def interval_words(self, speed: float) -> str:
        """Noise of a margin at the instant that sets it; empty if it is negligible."""
        half = INTERVAL * 0.5 * self.spread
        if half <= _MIN_STATED_INTERVAL or not math.isfinite(speed):
            return ""
        return f" (± {number(half * speed, 2)} by noise)"


def support_noise(found: GroundSupport, d: Differentiation) -> SupportNoise | None:
    """Effect of the noise of derived accelerations; None if they are given, or without noise."""
    if not d.sigma_ddq.any():
        return None
    failing = found.aground & found.decided & ~found.holds
    certain = np.zeros(len(failing), bool)
    rows = np.flatnonzero(failing)
    for start in range(0, len(rows), _BATCH_SIZE):
        batch = rows[start : start + _BATCH_SIZE]
        states = samples(found.states, batch)
        motion, power = found.failing_motions(states, batch)
        certain[batch] = power > _MAX_SIGMAS_OF_NOISE * _power_deviation(found, d, states, motion)
    return SupportNoise(certain, *_margin(found, d))


def _power_deviation(found: GroundSupport, d: Differentiation, states: MotionSamples, motion: Array) -> Array:
    """Standard deviations (n,) of the power of the load in motions (n, nv) of the free base, by noise of ddq.

    The power of inertial forces M ddq in a motion is (M motion)ᵀ ddq.
    """
    M = np.asarray(found.robot.mass_matrix(states.q))
    momentum = (M @ motion[..., None])[..., 0]
    sigma = d.sigma_at(states) * d.end_gain(states.time)
    variances = ((momentum * sigma) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(variances))


def _margin(found: GroundSupport, d: Differentiation) -> tuple[float, float, float, str]:
    """Relative deviation of the margin in speed, the margin, its instant, and what fails beyond it."""
    standing = found.holds & found.aground & np.isfinite(found.speed) & (found.speed > 0)
    if not standing.any():
        return 0.0, math.inf, 0.0, ""
    k = int(np.where(standing, found.speed, np.inf).argmin())
    speed = float(found.speed[k])
    time = float(found.time[k])
    state = samples(found.states, slice(k, k + 1))
    beyond = _FACTOR_BEYOND_MARGIN * speed
    fast = replace(state, dq=beyond * state.dq, ddq=beyond**2 * state.ddq)
    failed = found.again(fast, found.contacts, found.in_contact[k : k + 1])
    if failed.holds[0] or not failed.decided[0]:
        return 0.0, speed, time, ""
    at_rest = replace(state, dq=np.zeros_like(state.dq), ddq=np.zeros_like(state.ddq))
    inertial_torques = found.case.torques_in_the_air(state)[0] - found.case.torques_in_the_air(at_rest)[0]
    power = abs(float(failed.motion[0] @ inertial_torques))
    sigma = float(_power_deviation(found, d, state, failed.motion)[0])
    spread = sigma / power if power > 0 else 0.0
    return spread, speed, time, str(failed.how[0])
