"""Cycle of a drive, and the demands on motor and gear over the cycle.

A cycle is a sequence of nodes. Between two nodes torque and speed are linear in time, and the winding's heat is
constant.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ..core.typing import Array
from ..reports.motors import Demand

RPM = 2 * math.pi / 60
"""Speed of one turn per minute [rad/s]."""


class Cycle(NamedTuple):
    """Loads of one joint at the nodes of a cycle, (n,) each."""

    time: Array
    duration: Array
    """Times between nodes (n - 1,) [s]."""
    speed: Array
    """Joint speed [rad/s]."""
    torque: Array
    """Torque at the gear's output, including friction [N m]."""
    acceleration: Array
    """Joint acceleration [rad/s²]."""
    carrier: Array
    """Acceleration of the motor's link about the rotor axis [rad/s²]."""
    inertia: Array
    """Inertia of the joint in M [kg m²]."""
    bearing: Mapping[str, Array] = MappingProxyType({})
    """Loads of the joint's bearing by kind [N, N, N m]; empty if no gear has limits of them."""

    def rotor_torque(self, inertia: float, ratio: float) -> Array:
        """Torque at the joint that accelerates the rotor: G J (G q̈ + α). MR section 8.9.2."""
        return ratio * inertia * (ratio * self.acceleration + self.carrier)


def between(x: Array) -> Array:
    """Means of consecutive nodes."""
    return np.asarray(0.5 * (x[1:] + x[:-1]))


def with_noise(demands: Sequence[Demand], draws: Sequence[Sequence[Demand]]) -> tuple[Demand, ...]:
    """Demands without the mean effect of noise, and with standard deviations.

    Both are estimated from ``draws``, the demands of equally likely motions. By its own noise, a motion has a demand larger by
    the mean excess of the draws over it: the corrected value is value - (mean - value).
    """
    corrected = []
    for demand in demands:
        all_draws = itertools.chain.from_iterable(draws)
        values = np.array([d.value for d in all_draws if (d.what, d.limit) == (demand.what, demand.limit)])
        if len(values) > 1 and np.isfinite([demand.value, *values]).all():
            mean = float(values.mean())
            sigma = float(values.std(ddof=1))
            corrected.append(replace(demand, value=2 * demand.value - mean, sigma=sigma))
        else:
            corrected.append(demand)
    return tuple(corrected)


@dataclass(frozen=True)
class DrivePart:
    """Motor or gear with its demands over the cycle."""

    name: str
    demands: tuple[Demand, ...]
    missing: tuple[str, ...]
    """Names of missing ratings."""

    @property
    def tightest(self) -> Demand:
        """Demand nearest to its limit."""
        return max(self.demands, key=lambda d: d.share)

    @property
    def excess(self) -> tuple[Demand, ...]:
        """Demands beyond their limits."""
        return tuple(d for d in self.demands if d.over)

    @property
    def open(self) -> tuple[Demand, ...]:
        """Demands so near to their limits that noise of the log decides whether they exceed them."""
        return tuple(d for d in self.demands if d.open)
