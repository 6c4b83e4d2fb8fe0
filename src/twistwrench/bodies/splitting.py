"""Steps of free rotation about the centre of mass that keep the spatial momentum and bound the energy.

In principal axes the rotational energy of body momentum m is split, with the middle moment I2 set apart,

    K = |m|²/(2 I2) + ½ (1/I1 - 1/I2) m1² + ½ (1/I3 - 1/I2) m3²,

and each part alone is solved exactly: the first turns the body about the fixed momentum, the others about a body axis. The
first commutes with the rest; the others are composed symmetrically. So every step is a product of exact motions, each of which
keeps the spatial momentum; the composition is symplectic and symmetric, so the energy error is bounded for exponentially
long times; and a body with two equal moments, for which two parts remain that commute, moves exactly. Sources: McLachlan,
"Explicit Lie-Poisson integration and the Euler equations", PRL 71, 1993; Fassò, "Comparison of splitting algorithms for the
rigid body", J. Comput. Phys. 189, 2003; Hairer, Lubich and Wanner, Geometric Numerical Integration, VII.5.3 and V.3.

Plain floats, since one step is too short for arrays: a step of order 4 takes a few microseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, sqrt

Quat = tuple[float, float, float, float]
Vec = tuple[float, float, float]

_S = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
_K = (0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.08221359629355080023)

COMPOSITIONS: dict[int, tuple[float, ...]] = {
    2: (1.0,),
    4: (_S, _S, 1.0 - 4.0 * _S, _S, _S),  # Suzuki, 1990
    6: (*_K, 1.0 - 2.0 * sum(_K), *reversed(_K)),  # Kahan and Li, 1997
}
"""Fractions of a step, per order: symmetric, of sum 1, and the odd powers up to the order sum to 0."""


def body_momentum(q: Quat, l: Vec) -> Vec:
    """R(q)ᵀ l, for a unit quaternion."""
    w, x, y, z = q
    a, b, c = l
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return a + w * tx + ty * z - tz * y, b + w * ty + tz * x - tx * z, c + w * tz + tx * y - ty * x


@dataclass(frozen=True)
class SplitRotor:
    """A body turning about its centre of mass: reciprocal moments, relative to the middle one. All in 1/(kg m²)."""

    middle: float
    first: float
    third: float

    @classmethod
    def of(cls, moments: Vec) -> SplitRotor:
        """From principal moments, ascending."""
        a, b, c = (1.0 / x for x in moments)
        return cls(b, a - b, c - b)

    def schedule(self, h: float, fractions: tuple[float, ...]) -> tuple[list[tuple[float, float]], float]:
        """Half-angle factors of the alternating turns about axes 1 and 3, with neighbours merged, and of the last turn."""
        a, b = 0.25 * h * self.first, 0.5 * h * self.third
        ends = (0.0, *fractions)
        return [(a * (ends[i] + f), b * f) for i, f in enumerate(fractions)], a * fractions[-1]

    def step(self, q: Quat, l: Vec, h: float, turns: list[tuple[float, float]], last: float) -> Quat:
        """The quaternion a step ``h`` later; ``l`` is the spatial angular momentum, which stays."""
        w, x, y, z = q
        k, m, n = body_momentum(q, l)
        for a, b in turns:
            s, c = sin(a * k), cos(a * k)
            w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s
            s, c = 2.0 * s * c, 1.0 - 2.0 * s * s
            m, n = m * c + n * s, n * c - m * s
            s, c = sin(b * n), cos(b * n)
            w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
            s, c = 2.0 * s * c, 1.0 - 2.0 * s * s
            k, m = k * c + m * s, m * c - k * s
        s, c = sin(last * k), cos(last * k)
        w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s

        lx, ly, lz = l
        size = sqrt(lx * lx + ly * ly + lz * lz)
        if size == 0.0:
            return q
        half = 0.5 * h * self.middle * size
        s, c = sin(half) / size, cos(half)
        i, j, k = lx * s, ly * s, lz * s
        w, x, y, z = (
            c * w - i * x - j * y - k * z,
            c * x + i * w + j * z - k * y,
            c * y - i * z + j * w + k * x,
            c * z + i * y - j * x + k * w,
        )
        s = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)  # back to unit length
        return s * w, s * x, s * y, s * z
