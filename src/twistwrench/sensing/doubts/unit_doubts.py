"""Doubts about the units of a log, judged by the resulting tool.

A wrong force unit scales the mass, a wrong moment unit the first moment; the centre of mass and the ratio of the two
noises scale with their quotient. One of the three may be unusual. A doubt is raised if one is unusual and another unit
makes all three usual, or if one is impossible.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.gravity import KGF
from ...core.numbers import number, printed
from ...core.typing import Array

if TYPE_CHECKING:
    from ..conventions import Diagnosis
    from ..log import ReadingLog
    from ..sensor import ForceTorqueSensor


class Mixup(NamedTuple):
    """Units of a log other than N and N m."""

    cause: str
    force: float
    """Newtons per force unit."""
    moment: float
    """Newton metres per moment unit."""

    @property
    def cure(self) -> str:
        """Conversion factors of the columns, as an instruction."""
        if self.force == self.moment:
            return f"multiply all six by {printed(self.force)}"
        factors = []
        if self.force != 1.0:
            factors.append(f"fx, fy, fz by {printed(self.force)}")
        if self.moment != 1.0:
            factors.append(f"mx, my, mz by {printed(self.moment)}")
        return "multiply " + " and ".join(factors)


MIXUPS = (
    Mixup("forces are in grams", KGF / 1000, 1.0),
    Mixup("forces are in kilograms", KGF, 1.0),
    Mixup("moments are in N mm", 1.0, 1e-3),
    Mixup("moments are in N cm", 1.0, 1e-2),
    Mixup("forces are in kilograms and moments in kg cm", KGF, KGF / 100),
    Mixup("forces are in grams and moments in g cm", KGF / 1000, KGF / 1e5),
    Mixup("forces are in pounds and moments in pound inches", 4.44822, 0.112985),
)
"""Wrong units found in logs, most frequent first."""

# Rows: mass [kg], distance of the centre of mass from the sensor [m], ratio of force noise to moment noise [1/m]. The
# ratio is the inverse of the distance of the strain gauges from the axis. Margins are 10 %.
_USUAL_TOOLS = np.array([[0.045, 55.0], [0.009, 0.33], [4.0, 600.0]])
_IMPOSSIBLE_TOOLS = np.array([500.0, 0.5, math.inf])  # impossible for tools on a six-axis sensor
# Ranges that raise no doubt: a tool may be long, and noise in N and N m may be equal.
_PLAUSIBLE_TOOLS = np.array([[0.045, 55.0], [0.009, 0.4], [0.5, 600.0]])
MISS_PROBABILITY, NOISE_MISS_PROBABILITY = 1e-5, 1e-3  # probabilities that an interval below misses the true value
MIN_NOISE_OF_WEIGHT = 1e-4  # of the weight; residuals below are rounding errors


def unit_doubt(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Doubt | None:
    """Doubt about the units of the log, with remedy; None if the identified tool is plausible."""
    bounds = _tool_bounds(result, sensor, log)
    if _overlap(bounds, _PLAUSIBLE_TOOLS).all():
        return None
    remedies = []
    for rank, mixup in enumerate(MIXUPS):
        factors = np.array([mixup.force, mixup.moment / mixup.force, mixup.force / mixup.moment])
        meant = bounds * factors[:, None]
        if _overlap(meant, _USUAL_TOOLS).all():
            deviation = (np.log(meant[:, 1]) - np.log(_USUAL_TOOLS).mean(axis=1)) / np.ptp(np.log(_USUAL_TOOLS), axis=1)
            score = float((deviation[np.isfinite(deviation)] ** 2).sum()) + 0.08 * rank
            remedies.append((score, f"{mixup.cause} ({mixup.cure})"))
    if not remedies and not (bounds[:, 0] > _IMPOSSIBLE_TOOLS).any():
        return None
    distance, (moment, force) = float(np.linalg.norm(sensor.load.com)), result.fit.noise
    distance_text = f"{number(distance, 3)} m" if distance >= 1 else f"{number(1e3 * distance, 3)} mm"
    tool = (
        f"a mass of {number(sensor.load.mass, 3)} kg, {distance_text} out, on a sensor with noise of {number(force, 2)} N and "
        f"{number(moment, 2)} N m"
    )
    if not remedies:
        return doubt("sensor-counts", tool=tool)
    return doubt("sensor-unit", tool=tool, ways="; or ".join(text for _, text in sorted(remedies)[:3]))


def _overlap(bounds: Array, ranges: Array) -> Array:
    """Mask (3,) of quantities whose bounds overlap a range of tools."""
    return (bounds[:, 0] <= ranges[:, 1]) & (bounds[:, 2] >= ranges[:, 0])


def _tool_bounds(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Array:
    """Lower bound, estimate, upper bound (3, 3): mass [kg], distance of centre of mass [m], noise ratio [1/m]."""
    from scipy import special

    mass, start = float(result.fit.load[0]), result.fit.unknowns.load.start
    t = float(special.stdtrit(min(float(result.fit.known[start]), 1e9), 1 - MISS_PROBABILITY))
    mass_error = t * result.fit.mass_deviation
    distance = float(np.linalg.norm(sensor.load.com))
    distance_error = t * float(np.linalg.norm(result.fit.com_deviation))
    freedom, (moment, force) = result.freedom, result.noise
    weight = mass * float(np.linalg.norm(log.gravity, axis=1).mean())
    noise_ratios = (0.0, math.nan, math.inf)
    above_rounding = moment > _rounding(log.readings[:, :3]) and force > _rounding(log.readings[:, 3:])
    if above_rounding and moment > 0 and force > MIN_NOISE_OF_WEIGHT * weight:
        factor = math.sqrt(float(special.fdtri(freedom, freedom, 1 - NOISE_MISS_PROBABILITY)))
        noise_ratios = (force / moment / factor, force / moment, force / moment * factor)
    masses = (mass - mass_error, mass, mass + mass_error)
    distances = (distance - distance_error, distance, distance + distance_error)
    return np.array([masses, distances, noise_ratios])


def _rounding(values: Array) -> float:
    """Decimal place to which all values are rounded, such as 0.01; 0 if there are more than six decimals."""
    for digits in range(7):
        decimal_place = 10.0**-digits
        multiples = values / decimal_place
        if (np.abs(multiples - np.round(multiples)) < 1e-6).all():
            return decimal_place
    return 0.0
