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
    """Loads of one joint at the nodes of a cycle, (n,) each unless stated."""

    time: Array
    """Times of the nodes [s]."""
    duration: Array
    """Times between nodes (n - 1,) [s]."""
    speed: Array
    """Joint speed [rad/s]."""
    torque: Array
    """Torque at the gear's output, including friction [N m]."""
    acceleration: Array
    """Joint acceleration [rad/s²]."""
    carrier: Array
    """Acceleration α of the link that carries the motor, about the rotor axis [rad/s²]."""
    inertia: Array
    """Inertia of the joint, its diagonal entry of M [kg m²]."""
    bearing: Mapping[str, Array] = MappingProxyType({})
    """Loads of the joint's bearing by kind [N, N, N m]; empty if no gear has limits of such loads."""

    def rotor_torque(self, inertia: float, ratio: float) -> Array:
        """Torque at the joint that accelerates a rotor of inertia J, by a gear of ratio G: G J (G q̈ + α). MR section 8.9.2."""
        return ratio * inertia * (ratio * self.acceleration + self.carrier)


def between(x: Array) -> Array:
    """Means (n - 1,) of the values (n,) at consecutive nodes."""
    return np.asarray(0.5 * (x[1:] + x[:-1]))


def with_noise(demands: Sequence[Demand], draws: Sequence[Sequence[Demand]]) -> tuple[Demand, ...]:
    """Demands without the mean effect of noise, and with standard deviations.

    Both are estimated from ``draws``, the demands of equally likely motions. Noise increases a demand. The difference
    between the mean of the draws and the demand estimates this increase, so the corrected value is value - (mean - value).
    """
    corrected_demands = []
    for demand in demands:
        key = (demand.what, demand.limit)
        all_draws = itertools.chain.from_iterable(draws)
        drawn_values = np.array([drawn.value for drawn in all_draws if (drawn.what, drawn.limit) == key])
        are_finite = np.isfinite([demand.value, *drawn_values]).all()
        if are_finite and len(drawn_values) > 1:
            mean = float(drawn_values.mean())
            sigma = float(drawn_values.std(ddof=1))
            corrected_demands.append(replace(demand, value=2 * demand.value - mean, sigma=sigma))
        else:
            corrected_demands.append(demand)
    return tuple(corrected_demands)


@dataclass(frozen=True)
class DrivePart:
    """Motor or gear with its demands over the cycle."""

    name: str
    demands: tuple[Demand, ...]
    missing: tuple[str, ...]
    """Names of the ratings that the catalogue lacks."""

    @property
    def tightest(self) -> Demand:
        """Demand nearest to its limit."""
        return max(self.demands, key=lambda demand: demand.share)

    @property
    def excess(self) -> tuple[Demand, ...]:
        """Demands beyond their limits."""
        return tuple(demand for demand in self.demands if demand.over)

    @property
    def open(self) -> tuple[Demand, ...]:
        """Demands so near to their limits that noise of the log decides whether they exceed them."""
        return tuple(demand for demand in self.demands if demand.open)
