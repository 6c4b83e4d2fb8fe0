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
"""Number of standard deviations that noise does not exceed in a million samples."""
_FACTOR_BEYOND_MARGIN = 1.01
"""Speed over the margin in speed, at which the robot fails and the failing motion is found."""
_BATCH_SIZE = 4096
"""Number of states of a batch."""
_MIN_STATED_INTERVAL = 0.002
"""Half-width of the margin's interval, over the margin, above which it is stated."""


@dataclass(frozen=True, eq=False)
class SupportNoise:
    """Effect of the noise of derived accelerations on contact forces and margins."""

    certain: Array
    """(n,) of bool: True at instants that fail by more than noise explains."""
    spread: float
    """Relative standard deviation of the power of inertial forces at the instant that sets the margin; 0 without a margin."""
    speed: float
    """Margin in speed; inf without one."""
    time: float
    """Instant that sets the margin [s]."""
    how: str
    """Failure beyond the margin, as a verb with its object; empty if it is not known."""

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
        half_width = INTERVAL * 0.5 * self.spread * self.speed  # 0.5: speed is the root of power
        margin = plus_minus(self.speed, half_width)
        return (
            f"noise of the log decides whether it {self.how} at t = {seconds(self.time)} s: it holds up to "
            f"{margin} × this speed"
        )

    def interval_words(self, speed: float) -> str:
        """Noise of a margin at the instant that sets it; empty if it is negligible."""
        relative_half_width = INTERVAL * 0.5 * self.spread
        if relative_half_width <= _MIN_STATED_INTERVAL or not math.isfinite(speed):
            return ""
        return f" (± {number(relative_half_width * speed, 2)} by noise)"


def support_noise(found: GroundSupport, derivation: Differentiation) -> SupportNoise | None:
    """Effect of the noise of derived accelerations; None if they are given, or without noise."""
    if not derivation.sigma_ddq.any():
        return None
    has_failed = found.aground & found.decided & ~found.holds
    is_certain = np.zeros(len(has_failed), bool)
    failing_rows = np.flatnonzero(has_failed)
    for start in range(0, len(failing_rows), _BATCH_SIZE):
        batch = failing_rows[start : start + _BATCH_SIZE]
        states = samples(found.states, batch)
        motions, powers = found.failing_motions(states, batch)
        is_certain[batch] = powers > _MAX_SIGMAS_OF_NOISE * _power_deviation(found, derivation, states, motions)
    spread, speed, time, how = _margin(found, derivation)
    return SupportNoise(is_certain, spread, speed, time, how)


def _power_deviation(found: GroundSupport, derivation: Differentiation, states: MotionSamples, motions: Array) -> Array:
    """Standard deviations (n,) of the power of the load in motions (n, nv) of the free base, by noise of ddq.

    The power of inertial forces M ddq in a motion is (M motion)ᵀ ddq.
    """
    M = np.asarray(found.robot.mass_matrix(states.q))
    momentum = (M @ motions[..., None])[..., 0]
    sigma = derivation.sigma_at(states) * derivation.end_gain(states.time)
    variances = ((momentum * sigma) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(variances))


def _margin(found: GroundSupport, derivation: Differentiation) -> tuple[float, float, float, str]:
    """Relative deviation of the power of inertial forces, margin in speed, instant that sets it [s], and failure beyond it.

    Without a margin, it is inf; the failure is empty if it is not known.
    """
    has_margin = found.holds & found.aground & np.isfinite(found.speed) & (found.speed > 0)
    if not has_margin.any():
        return 0.0, math.inf, 0.0, ""
    k = int(np.where(has_margin, found.speed, np.inf).argmin())
    margin = float(found.speed[k])
    time = float(found.time[k])
    state = samples(found.states, slice(k, k + 1))
    speed_factor = _FACTOR_BEYOND_MARGIN * margin
    faster_state = replace(state, dq=speed_factor * state.dq, ddq=speed_factor**2 * state.ddq)
    failure = found.again(faster_state, found.contacts, found.in_contact[k : k + 1])
    if failure.holds[0] or not failure.decided[0]:
        return 0.0, margin, time, ""
    state_at_rest = replace(state, dq=np.zeros_like(state.dq), ddq=np.zeros_like(state.ddq))
    # Results for the only state have one row.
    (torques,) = found.case.torques_in_the_air(state)
    (torques_at_rest,) = found.case.torques_in_the_air(state_at_rest)
    (motion,) = failure.motion
    power = abs(float(motion @ (torques - torques_at_rest)))  # of the inertial forces
    (sigma,) = _power_deviation(found, derivation, state, failure.motion).tolist()
    spread = sigma / power if power > 0 else 0.0
    return spread, margin, time, str(failure.how[0])
