"""Units that were mixed up, told by the tool they make: its mass, how far out it is, and the sensor's noise, all at once.

Forces in another unit scale the mass, moments the first moment, so the centre of mass goes with their quotient, as does the
quotient of the two noises. One of the three may well be unusual. A doubt is raised when one is, and another unit would make
all three usual; or when one is beyond any tool.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..core.gravity import KGF
from ..core.printed_numbers import number
from ..typing import Array
from .identified import com_deviation
from .log import ReadingLog
from .sensor import ForceTorqueSensor
from .sign_and_mounting import Diagnosis


class Mixup(NamedTuple):
    """Units that a log may have been written in instead of N and N m."""

    said: str
    cure: str
    force: float
    """Of that unit in a newton."""
    moment: float
    """Of that unit in a newton metre."""


MIXUPS = (
    Mixup("forces are in grams", f"multiply fx, fy, fz by {KGF / 1000}", 1000 / KGF, 1.0),
    Mixup("forces are in kilograms", f"multiply fx, fy, fz by {KGF}", 1 / KGF, 1.0),
    Mixup("moments are in N mm", "divide mx, my, mz by 1000", 1.0, 1000.0),
    Mixup("moments are in N cm", "divide mx, my, mz by 100", 1.0, 100.0),
    Mixup("forces are in kilograms and moments in kg cm",
          f"multiply fx, fy, fz by {KGF} and mx, my, mz by {KGF / 100}", 1 / KGF, 100 / KGF),
    Mixup("forces are in grams and moments in g cm",
          f"multiply fx, fy, fz by {KGF / 1000} and mx, my, mz by {KGF / 1e5}", 1000 / KGF, 1e5 / KGF),
    Mixup("forces are in pounds and moments in pound inches",
          "multiply fx, fy, fz by 4.448 and mx, my, mz by 0.113", 0.22481, 8.8507),
)  # fmt: skip
"""What logs are found in, the usual ones first."""

# A tool: mass [kg], centre of mass from the sensor [m]; a sensor: noise of forces over that of moments [1/m], which is
# how far its strain gauges are from its axis, at most a few times its radius. All with a tenth to spare.
_USUAL = np.array([[0.045, 55.0], [0.009, 0.33], [4.0, 600.0]])
_BEYOND = np.array([500.0, 0.5, math.inf])  # no tool on a six-axis sensor has these
_FAR = 0.4  # m; a long tool is no doubt yet
_SURE, _NOISE_SURE = 1e-5, 1e-3  # chances that an interval below misses the truth
_NO_NOISE = 1e-4  # of the weight; below, what is left of the readings is their rounding


def unit_doubt(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> str | None:
    """Which unit the log seems to be in, and what to do about it; None if the tool found is one that there may be."""
    found = _found(result, sensor, log)
    usual = _USUAL.copy()
    usual[1, 1] = _FAR
    # Poses that are off leave moments of a lever's length times the forces they leave, whatever the sensor.
    usual[2, 0] = min(usual[2, 0], max(0.7 / max(found[1, 1], 1e-9), 2.1))
    if _overlap(found, usual).all():
        return None
    ways = []
    for place, way in enumerate(MIXUPS):
        meant = found / np.array([way.force, way.moment / way.force, way.force / way.moment])[:, None]
        if _overlap(meant, _USUAL).all():
            off = (np.log(meant[:, 1]) - np.log(_USUAL).mean(axis=1)) / np.ptp(np.log(_USUAL), axis=1)
            ways.append((float((off[np.isfinite(off)] ** 2).sum()) + 0.08 * place, way))
    beyond = bool((found[:, 0] > _BEYOND).any())
    if not (ways or beyond):
        return None
    load, noise = sensor.load, result.fit.noise
    tool = (
        f"a mass of {number(load.mass, 3)} kg, {_length(float(np.linalg.norm(load.com)))} out, on a sensor with noise of "
        f"{number(noise[1], 2)} N and {number(noise[0], 2)} N m"
    )
    if not ways:
        return f"Units look wrong: {tool}, is no tool. Are the readings counts? Multiply them by the sensor's scale."
    best = [way for _, way in sorted(ways, key=lambda pair: pair[0])[:3]]
    first, *others = (f"{way.said} ({way.cure})" for way in best)
    return f"Units look wrong: {tool}, is unusual. Perhaps {'; or '.join([first, *others])}."


def _overlap(found: Array, usual: Array) -> Array:
    return (found[:, 0] <= usual[:, 1]) & (found[:, 2] >= usual[:, 0])


def _found(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Array:
    """Mass [kg], distance of the centre of mass [m] and quotient of the noises [1/m]: (3, 3) surely from, about, to."""
    from scipy import special

    kept, unknowns = result.kept, result.fit.unknowns
    mass, start = float(result.fit.load[0]), unknowns.load.start
    t = float(special.stdtrit(min(float(result.fit.known[start]), 1e9), 1 - _SURE))
    heavy = t * math.sqrt(result.fit.covariance[start, start])
    out, far = float(np.linalg.norm(sensor.load.com)), t * float(np.linalg.norm(com_deviation(result.fit)))
    freedom = max(3.0 * kept.sum() - len(unknowns.names) / 2, 1.0)
    moment, force = np.sqrt((result.fit.residuals[kept].reshape(-1, 2, 3) ** 2).sum(axis=(0, 2)) / freedom)
    weight = mass * float(np.linalg.norm(log.gravity, axis=1).mean())
    noises = (0.0, math.nan, math.inf)
    rough = moment > _rounding(log.readings[:, :3]) and force > _rounding(log.readings[:, 3:])
    if rough and moment > 0 and force > _NO_NOISE * weight:
        times = math.sqrt(float(special.fdtri(freedom, freedom, 1 - _NOISE_SURE)))
        noises = (force / moment / times, force / moment, force / moment * times)
    return np.array([(mass - heavy, mass, mass + heavy), (out - far, out, out + far), noises])


def _rounding(values: Array) -> float:
    """The decimal place that all values are rounded to, such as 0.01; 0 from the seventh on."""
    places = (10.0**-digits for digits in range(7))
    return next((p for p in places if (np.abs(values / p - np.round(values / p)) < 1e-6).all()), 0.0)


def _length(metres: float) -> str:
    return f"{number(metres, 3)} m" if metres >= 1 else f"{number(1e3 * metres, 3)} mm"
