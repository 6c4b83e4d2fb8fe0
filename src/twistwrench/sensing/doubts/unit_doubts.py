"""Doubts about the units of a log, judged by the resulting tool.

A wrong force unit scales the mass, and a wrong moment unit the first moment. The distance of the centre of mass and the
ratio of the two noises scale with the quotient of both units. A doubt is raised if mass, distance or noise ratio is
unusual and other units make all three usual, or if one of them is impossible.
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
    """Clause that names the units."""
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


MIXUPS = (  # cause, newtons per force unit, newton metres per moment unit
    Mixup("forces are in grams", KGF / 1000, 1.0),
    Mixup("forces are in kilograms", KGF, 1.0),
    Mixup("moments are in N mm", 1.0, 1e-3),
    Mixup("moments are in N cm", 1.0, 1e-2),
    Mixup("forces are in kilograms and moments in kg cm", KGF, KGF / 100),
    Mixup("forces are in grams and moments in g cm", KGF / 1000, KGF / 1e5),
    Mixup("forces are in pounds and moments in pound inches", 4.44822, 0.112985),
)
"""Wrong units found in logs, most frequent first."""

# A tool is judged by three quantities: its mass [kg], the distance of its centre of mass from the sensor [m], and the ratio of
# force noise to moment noise [1/m], which is the inverse of the distance of the strain gauges from the axis. A range has the
# smallest and the largest value.
_USUAL_TOOLS = np.array([
    [0.045, 55.0],  # mass
    [0.009, 0.33],  # distance
    [4.0, 600.0],  # noise ratio
])  # fmt: skip
"""Ranges of usual tools, with margins of 10 %."""
_IMPOSSIBLE_TOOLS = np.array([500.0, 0.5, math.inf])
"""Largest mass, distance and noise ratio of a tool on a six-axis sensor."""
_PLAUSIBLE_TOOLS = np.array([
    [0.045, 55.0],  # mass
    [0.009, 0.4],  # distance: a tool may be long
    [0.5, 600.0],  # noise ratio: noise in N and N m may be equal
])  # fmt: skip
"""Ranges that raise no doubt."""
_MAX_WAYS = 3
"""Largest number of possible units that a doubt names."""
_MAX_FREEDOM = 1e9
"""Number of degrees of freedom from which the distribution is normal."""
_MAX_DECIMALS = 6
"""Largest number of decimals of rounded values."""
_MAX_ROUNDING_ERROR = 1e-6
"""Distance from a multiple of a decimal place, in this place, up to which a value is rounded to it."""
MISS_PROBABILITY = 1e-5
"""Probability that the interval of mass or distance misses the true value."""
NOISE_MISS_PROBABILITY = 1e-3
"""Probability that the interval of the noise ratio misses the true value."""
MIN_NOISE_OF_WEIGHT = 1e-4
"""Noise relative to the weight below which residuals are rounding errors."""
_RANK_PENALTY = 0.08
"""Penalty of a mixup for each more frequent mixup; of two similar mixups, the more frequent one is named first."""


def unit_doubt(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Doubt | None:
    """Doubt about the units of the log, with remedy; None if the identified tool is plausible."""
    bounds = _tool_bounds(result, sensor, log)
    if _overlap(bounds, _PLAUSIBLE_TOOLS).all():
        return None
    log_ranges = np.log(_USUAL_TOOLS)
    scored_remedies = []  # penalty and text
    for rank, mixup in enumerate(MIXUPS):
        # Factors of mass, distance and noise ratio:
        factors = np.array([mixup.force, mixup.moment / mixup.force, mixup.force / mixup.moment])
        corrected_bounds = bounds * factors[:, None]
        if _overlap(corrected_bounds, _USUAL_TOOLS).all():
            _, estimates, _ = corrected_bounds.T
            # Distance of the estimates from the middle of the usual range, in widths of the range.
            deviations = (np.log(estimates) - log_ranges.mean(axis=1)) / np.ptp(log_ranges, axis=1)
            known_deviations = deviations[np.isfinite(deviations)]
            penalty = float((known_deviations**2).sum()) + _RANK_PENALTY * rank
            scored_remedies.append((penalty, f"{mixup.cause} ({mixup.cure})"))
    lower_bounds, _, _ = bounds.T
    is_impossible = (lower_bounds > _IMPOSSIBLE_TOOLS).any()
    if not scored_remedies and not is_impossible:
        return None
    distance = float(np.linalg.norm(sensor.load.com))
    distance_text = f"{number(distance, 3)} m"
    if distance < 1:
        distance_text = f"{number(1e3 * distance, 3)} mm"
    moment_noise, force_noise = result.fit.noise
    tool = (
        f"a mass of {number(sensor.load.mass, 3)} kg, {distance_text} out, on a sensor with noise of "
        f"{number(force_noise, 2)} N and {number(moment_noise, 2)} N m"
    )
    if not scored_remedies:
        return doubt("sensor-counts", tool=tool)
    remedies = [remedy for _, remedy in sorted(scored_remedies)]
    return doubt("sensor-unit", tool=tool, ways="; or ".join(remedies[:_MAX_WAYS]))


def _overlap(bounds: Array, ranges: Array) -> Array:
    """Mask (3,) of the quantities whose lower and upper bounds overlap a range of tools."""
    lower_bounds, _, upper_bounds = bounds.T
    range_begins, range_ends = ranges.T
    return np.asarray((lower_bounds <= range_ends) & (upper_bounds >= range_begins))


def _tool_bounds(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Array:
    """(3, 3): lower bound, estimate and upper bound of mass [kg], distance of the centre of mass [m], noise ratio [1/m]."""
    from scipy import special

    mass = float(result.fit.load[0])  # the first parameter of the load
    mass_freedom = float(result.fit.known[result.fit.unknowns.load.start])
    t = float(special.stdtrit(min(mass_freedom, _MAX_FREEDOM), 1 - MISS_PROBABILITY))
    mass_error = t * result.fit.mass_deviation
    distance = float(np.linalg.norm(sensor.load.com))
    distance_error = t * float(np.linalg.norm(result.fit.com_deviation))
    masses = (mass - mass_error, mass, mass + mass_error)
    distances = (distance - distance_error, distance, distance + distance_error)
    noise_ratios = (0.0, math.nan, math.inf)  # unknown
    moment_noise, force_noise = result.noise
    moments, forces = log.readings[:, :3], log.readings[:, 3:]
    weight = mass * float(np.linalg.norm(log.gravity, axis=1).mean())
    is_noise = moment_noise > 0 and force_noise > MIN_NOISE_OF_WEIGHT * weight
    if is_noise and moment_noise > _decimal_place(moments) and force_noise > _decimal_place(forces):
        factor = math.sqrt(float(special.fdtri(result.freedom, result.freedom, 1 - NOISE_MISS_PROBABILITY)))
        ratio = force_noise / moment_noise
        noise_ratios = (ratio / factor, ratio, ratio * factor)
    return np.array([masses, distances, noise_ratios])


def _decimal_place(values: Array) -> float:
    """Decimal place to which all values are rounded, such as 0.01; 0 if there are more than six decimals."""
    for decimals in range(_MAX_DECIMALS + 1):
        decimal_place = 10.0**-decimals
        multiples = values / decimal_place
        rounding_errors = np.abs(multiples - np.round(multiples))
        if (rounding_errors < _MAX_ROUNDING_ERROR).all():
            return decimal_place
    return 0.0
