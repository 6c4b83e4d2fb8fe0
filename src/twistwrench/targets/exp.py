"""exp in lanes: x = k ln 2 + r, a Taylor polynomial in |r| ≤ ln 2 / 2, and k put into the exponent.

Two parts of ln 2 leave r good to the last bit: the first has trailing zeros enough that its product with k is exact. The
polynomial's remainder is below a quarter unit in the last place; the whole is within one (tests/program/test_exp.py).
Results below the smallest normal number are 0, beyond the largest infinity; NaN stays NaN.
"""

from __future__ import annotations

import math

from .llvm_text import LlvmWriter
from .processor import Precision

LN2 = {
    64: (6.93147180369123816490e-01, 1.90821492927058770002e-10),
    32: (6.93359375e-01, -2.12194440054690583e-04),
}
"""ln 2 as a sum of a short number and the rest."""

DEGREE = {64: 13, 32: 7}
"""Where the next term of the series, at ln 2 / 2, is below a quarter unit in the last place."""


def bounds(precision: Precision) -> tuple[float, float]:
    """Arguments below the first give 0, above the second infinity: where results stop being normal numbers."""
    largest = 1023 if precision.bits == 64 else 127
    return (1.0 - largest) * math.log(2.0) * (1 - 1e-6), (largest + 1.0) * math.log(2.0) * (1 - 1e-6)


def exp(w: LlvmWriter, x: str) -> str:
    """Emit e**x. What is out of bounds, NaN included, is found by its bits: a comparison of numbers would raise flags."""
    bits, mantissa = w.precision.bits, w.precision.mantissa
    low, high = (w.bits(w.precision.pattern(abs(bound))) for bound in bounds(w.precision))
    negative = w.new(f"icmp slt {w.integer} {w.new(f'bitcast {w.vector} {x} to {w.integer}')}, {w.bits(0)}")
    size = w.new(f"bitcast {w.vector} {w.intrinsic('fabs', x)} to {w.integer}")
    most = w.new(f"select {w.mask} {negative}, {w.integer} {low}, {w.integer} {high}")
    out = w.new(f"icmp sgt {w.integer} {size}, {most}")
    inside = w.select(out, w.splat(0.0), x)
    magic = 1.5 * 2.0**mantissa  # adding it leaves the nearest integer in the low bits
    shifted = w.fma(inside, w.splat(1.0 / math.log(2.0)), w.splat(magic))
    k = w.binary("fsub", shifted, w.splat(magic))
    r = inside
    for part in LN2[bits]:
        r = w.fma(k, w.splat(-part), r)
    value = w.splat(1.0 / math.factorial(DEGREE[bits]))
    for n in reversed(range(DEGREE[bits])):
        value = w.fma(value, r, w.splat(1.0 / math.factorial(n)))
    power = w.new(f"shl {w.integer} {w.new(f'bitcast {w.vector} {shifted} to {w.integer}')}, {w.bits(mantissa)}")
    scaled = w.new(f"add {w.integer} {w.new(f'bitcast {w.vector} {value} to {w.integer}')}, {power}")
    result = w.new(f"bitcast {w.integer} {scaled} to {w.vector}")
    beyond = w.select(negative, w.splat(0.0), w.splat(math.inf))
    nan = w.new(f"icmp sgt {w.integer} {size}, {w.bits(w.precision.pattern(math.inf))}")
    return w.select(nan, x, w.select(out, beyond, result))
