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
_ROWS = 4096
"""States of one batch."""
_MIN_STATED_INTERVAL = 0.002
"""Relative half of the interval of the margin from which it is stated."""


@dataclass(frozen=True, eq=False)
class SupportNoise:
    """Effect of the noise of derived accelerations on contact forces and margins."""

    certain: Array
    """(n,) of bool: instants that fail by more than noise explains; False where the robot stands."""
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
        return (self.speed**2 - 1.0) < _MAX_SIGMAS_OF_NOISE * self.spread * self.speed**2

    @property
    def words(self) -> str:
        """Sentence on a margin that noise may use up."""
        half = INTERVAL * 0.5 * self.spread * self.speed
        return (
            f"noise of the log decides whether it {self.how} at t = {seconds(self.time)} s: it holds up to "
            f"{plus_minus(self.speed, half)} × this speed"
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
    for start in range(0, len(rows), _ROWS):
        batch = rows[start : start + _ROWS]
        s = samples(found.states, batch)
        motion, power = found.failing_motions(s, batch)
        certain[batch] = power > _MAX_SIGMAS_OF_NOISE * _deviation(found, d, s, motion)
    return SupportNoise(certain, *_margin(found, d))


def _deviation(found: GroundSupport, d: Differentiation, s: MotionSamples, motion: Array) -> Array:
    """Standard deviations (n,) of the power of the load in motions (n, nv) of the free base."""
    M = np.asarray(found.robot.mass_matrix(s.q))
    return np.asarray(np.sqrt((((M @ motion[..., None])[..., 0] * d.sigma_at(s)) ** 2).sum(axis=1)))


def _margin(found: GroundSupport, d: Differentiation) -> tuple[float, float, float, str]:
    """Relative deviation of the margin in speed, the margin, its instant, and what fails beyond it."""
    standing = found.holds & found.aground & np.isfinite(found.speed) & (found.speed > 0)
    if not standing.any():
        return 0.0, math.inf, 0.0, ""
    k = int(np.where(standing, found.speed, np.inf).argmin())
    speed, time, s = float(found.speed[k]), float(found.time[k]), samples(found.states, slice(k, k + 1))
    beyond = _FACTOR_BEYOND_MARGIN * speed
    fast = replace(s, dq=beyond * s.dq, ddq=beyond**2 * s.ddq)
    after = found.again(fast, found.contacts, found.in_contact[k : k + 1])
    if after.holds[0] or not after.decided[0]:
        return 0.0, speed, time, ""
    at_rest = replace(s, dq=np.zeros_like(s.dq), ddq=np.zeros_like(s.ddq))
    inertial_torques = found.case.torques_in_the_air(s)[0] - found.case.torques_in_the_air(at_rest)[0]
    power = abs(float(after.motion[0] @ inertial_torques))
    sigma = float(_deviation(found, d, s, after.motion)[0])
    return (sigma / power if power > 0 else 0.0), speed, time, str(after.how[0])
