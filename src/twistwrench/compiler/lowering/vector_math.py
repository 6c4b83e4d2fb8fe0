"""sin and cos in lanes: Cody–Waite reduction, minimax polynomials, and an accurate path for huge angles.

π/2 is subtracted k times, as a sum of three parts. With a fused multiply–add, ``x - k π/2`` with the leading part is exact if
the result is below 1: both terms are multiples of the same small power of two. The two other parts leave an error below 1.5
units in the last place of the result, also near the zeros, for angles up to :func:`limit`. A larger angle is first reduced to
±π by the C library's accurate sin, cos and atan2; the error is then 2.5 units in the last place of a result near 1.
tests/program/test_sincos.py measures these errors.
Polynomials: S. Moshier, Cephes Mathematical Library, 1984–1992.
"""

from __future__ import annotations

import math

from .ir_builder import LlvmWriter
from .target_machine import Precision

TWO_OVER_PI = 0.6366197723675814
"""2/π, quarter turns in a radian."""

HALF_PI = {
    64: (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33),
    32: (1.5707963705062866, -4.371138828673793e-08, -1.7151244749032155e-15),
}
"""π/2 as a sum of numbers of the precision, by its number of bits."""
HALF_PI_SHORT = {
    64: (1.570796251296997, 7.549789415861596e-08, 5.39030083589187e-15, 2.0222659584103533e-21, 2.903855540388854e-28,
         4.3359050650618903e-35),
    32: (1.5703125, 0.00048065185546875, 3.1739473342895508e-06, 9.89530235528946e-10, 2.5579538487363607e-12,
         5.390302953474238e-15),
}  # fmt: skip
"""π/2 as a sum for machines without fused products. All parts but the last are so short that k times a part is exact."""


# Coefficients of S and C in sin x = x + x³ S(x²) and cos x = C(x²), by the number of bits; the highest power is first.
SINE = {
    64: (1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6, -1.98412698295895385996e-4,
         8.33333333332211858878e-3, -1.66666666666666307295e-1),
    32: (-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1),
}  # fmt: skip
COSINE = {
    64: (-1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7, 2.48015872888517045348e-5,
         -1.38888888888730564116e-3, 4.16666666666665929218e-2, -0.5, 1.0),
    32: (2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2, -0.5, 1.0),
}  # fmt: skip


def limit(precision: Precision) -> float:
    """Largest angle for which the fast reduction is used."""
    return {64: 2.0**30, 32: 2.0**15}[precision.bits]


def limit_pattern(precision: Precision) -> int:
    """Bits of the limit as an integer."""
    return precision.pattern(limit(precision))


def sincos(w: LlvmWriter, angles: list[str]) -> list[tuple[str, str]]:
    """Emit (sin x, cos x) of several angles within the limit, in lockstep; NaN and infinity give NaN.

    Each step is written for all angles before the next one. So the processor finds independent operations, and constants
    are loaded once.
    """
    bits = w.precision.bits
    magic = 1.5 * 2.0**w.precision.mantissa  # adding it leaves the nearest integer in the low bits
    shifted_turns = [w.fma(x, w.splat(TWO_OVER_PI), w.splat(magic)) for x in angles]  # quarter turns + magic
    quarter_turns = [w.binary("fsub", shifted, w.splat(magic)) for shifted in shifted_turns]  # k, whole numbers
    remainders = angles
    parts_of_half_pi = HALF_PI if w.fused else HALF_PI_SHORT
    for part in parts_of_half_pi[bits]:
        remainders = [w.fma(k, w.splat(-part), r) for k, r in zip(quarter_turns, remainders, strict=True)]
    # sin r = r + r³ S(r²) and cos r = C(r²), with the remainder r of each angle.
    squares = [w.binary("fmul", r, r) for r in remainders]
    S_values = _horner(w, SINE[bits], squares)
    cubes = [w.binary("fmul", r, r2) for r, r2 in zip(remainders, squares, strict=True)]
    sines = [w.fma(S, r3, r) for S, r3, r in zip(S_values, cubes, remainders, strict=True)]
    cosines = _horner(w, COSINE[bits], squares)
    triples = zip(shifted_turns, sines, cosines, strict=True)
    return [_choose_by_quadrant(w, shifted, sine, cosine) for shifted, sine, cosine in triples]


def _horner(w: LlvmWriter, coefficients: tuple[float, ...], points: list[str]) -> list[str]:
    """Emit the values of a polynomial at several points; the coefficient of the highest power is first."""
    values = [w.splat(coefficients[0])] * len(points)
    for c in coefficients[1:]:
        values = [w.fma(value, x, w.splat(c)) for value, x in zip(values, points, strict=True)]
    return values


def _choose_by_quadrant(w: LlvmWriter, shifted: str, sine: str, cosine: str) -> tuple[str, str]:
    """Emit sin and cos of an angle from sin and cos of its remainder, by the quadrant in the low bits of ``shifted``."""
    bits = w.precision.bits
    quadrant = w.new(f"bitcast {w.vector} {shifted} to {w.integer}")
    # Bit 0 (low) and bit 1 (high) of the quadrant, each moved to the sign bit. The low bit swaps sin and cos. The high bit is
    # the sign of sin, and the xor of both bits is the sign of cos.
    low = w.new(f"shl {w.integer} {quadrant}, {w.bits(bits - 1)}")
    high = w.new(f"shl {w.integer} {quadrant}, {w.bits(bits - 2)}")
    is_odd = w.new(f"icmp slt {w.integer} {low}, {w.bits(0)}")
    low_xor_high = w.new(f"xor {w.integer} {low}, {high}")
    swapped_sine = w.select(is_odd, cosine, sine)
    flipped_sine = _flip(w, swapped_sine, high)
    swapped_cosine = w.select(is_odd, sine, cosine)
    return flipped_sine, _flip(w, swapped_cosine, low_xor_high)


def _flip(w: LlvmWriter, value: str, sign: str) -> str:
    """Emit ``value`` with its sign flipped where the top bit of ``sign`` is set."""
    top_bit = w.bits(-(1 << (w.precision.bits - 1)))  # the integer with this bit alone
    sign_bit = w.new(f"and {w.integer} {sign}, {top_bit}")
    pattern = w.new(f"bitcast {w.vector} {value} to {w.integer}")
    flipped = w.new(f"xor {w.integer} {pattern}, {sign_bit}")
    return w.new(f"bitcast {w.integer} {flipped} to {w.vector}")


def wrap(w: LlvmWriter, angles: list[str], block: str) -> tuple[list[str], str]:
    """Emit the reduction of huge angles: one branch, taken only if some lane of some angle is beyond the limit.

    ``block`` is the current label. Returns the reduced angles and the new current label.
    """
    bound = w.bits(limit_pattern(w.precision))
    is_huge = ""  # mask of the lanes in which an angle up to here is beyond the limit
    for x in angles:  # compared as integers, which have the same order: comparing NaNs would raise a flag
        absolute = w.new(f"bitcast {w.vector} {w.intrinsic('fabs', x)} to {w.integer}")
        is_beyond = w.new(f"icmp sgt {w.integer} {absolute}, {bound}")
        if is_huge:
            is_beyond = w.new(f"or {w.mask} {is_huge}, {is_beyond}")
        is_huge = is_beyond
    mask_bits = w.new(f"bitcast {w.mask} {is_huge} to i{w.lanes}")
    any_huge = w.new(f"icmp ne i{w.lanes} {mask_bits}, 0")
    far, near = w.labels("far", "near")
    # The weights tell LLVM that the branch is hardly ever taken.
    w.do(f'br i1 {any_huge}, label %{far}, label %{near}, !prof !{{!"branch_weights", i32 1, i32 100000}}')
    w.begin(far)
    wrapped = [w.new(f"call {w.vector} @{_wrapper_name(w)}({w.vector} {x})") for x in angles]
    w.do(f"br label %{near}")
    w.begin(near)
    merged = [w.new(f"phi {w.vector} [{x}, %{block}], [{y}, %{far}]") for x, y in zip(angles, wrapped, strict=True)]
    return merged, near


def _wrapper_name(w: LlvmWriter) -> str:
    """Name of the function that :func:`wrapper` writes for the writer's vectors."""
    return f"wrap.{w.suffix}"


def wrapper(precision: Precision, lanes: int) -> str:
    """Function called by :func:`wrap`: each lane beyond the limit is replaced by the equivalent angle within ±π."""
    w = LlvmWriter(precision, lanes)
    double = "double"
    result = "%x"
    for lane in range(lanes):
        x = w.new(f"extractelement {w.vector} %x, i32 {lane}")
        wide = x
        if precision.bits == 32:
            wide = w.new(f"fpext {w.element} {x} to {double}")
        sine = w.new(f"call {double} @sin({double} {wide})")
        cosine = w.new(f"call {double} @cos({double} {wide})")
        angle = w.new(f"call {double} @atan2({double} {sine}, {double} {cosine})")
        if precision.bits == 32:
            angle = w.new(f"fptrunc {double} {angle} to {w.element}")
        absolute = w.new(f"call {w.element} @llvm.fabs.f{precision.bits}({w.element} {x})")
        pattern = w.new(f"bitcast {w.element} {absolute} to i{precision.bits}")
        is_beyond = w.new(f"icmp sgt i{precision.bits} {pattern}, {limit_pattern(precision)}")
        value = w.new(f"select i1 {is_beyond}, {w.element} {angle}, {w.element} {x}")
        result = w.new(f"insertelement {w.vector} {result}, {w.element} {value}, i32 {lane}")
    body = "\n".join(w.lines)
    head = f"define internal {w.vector} @{_wrapper_name(w)}({w.vector} %x) noinline cold"
    return f"{head} {{\n{body}\n  ret {w.vector} {result}\n}}\n"


# ── exp in lanes: x = k ln 2 + r, a Taylor polynomial in |r| ≤ ln 2 / 2, and k added to the exponent

# ln 2 is the sum of two parts. The first has enough trailing zeros for an exact product with k, so that r is accurate to the
# last bit. The remainder of the polynomial is below a quarter unit in the last place; the total error is below one unit
# (tests/program/test_exp.py). Results below the smallest normal number become 0, results above the largest become infinity, and
# NaN stays NaN.

LN2 = {
    64: (6.93147180369123816490e-01, 1.90821492927058770002e-10),
    32: (6.93359375e-01, -2.12194440054690583e-04),
}
"""ln 2 as the sum of a short number and a remainder, by the number of bits of the precision."""

DEGREE = {64: 13, 32: 7}
"""Degree of the Taylor polynomial: the next term, at ln 2 / 2, is below a quarter unit in the last place."""


def bounds(precision: Precision) -> tuple[float, float]:
    """Bounds of arguments: below the lower one results are 0, above the upper one infinity, as they would not be normal."""
    max_exponent = {64: 1023, 32: 127}[precision.bits]
    shrinkage = 1 - 1e-6  # keeps results at the bounds normal in spite of rounding
    lower = (1.0 - max_exponent) * math.log(2.0) * shrinkage
    upper = (max_exponent + 1.0) * math.log(2.0) * shrinkage
    return lower, upper


def exp(w: LlvmWriter, x: str) -> str:
    """Emit e**x. Arguments out of bounds and NaN are found by comparing bits, because comparing NaNs would raise flags."""
    bits = w.precision.bits
    mantissa = w.precision.mantissa
    lower, upper = bounds(w.precision)
    max_if_negative = w.bits(w.precision.pattern(abs(lower)))
    max_if_positive = w.bits(w.precision.pattern(upper))
    pattern_of_x = w.new(f"bitcast {w.vector} {x} to {w.integer}")
    is_negative = w.new(f"icmp slt {w.integer} {pattern_of_x}, {w.bits(0)}")
    absolute = w.new(f"bitcast {w.vector} {w.intrinsic('fabs', x)} to {w.integer}")
    max_absolute = w.new(f"select {w.mask} {is_negative}, {w.integer} {max_if_negative}, {w.integer} {max_if_positive}")
    is_out = w.new(f"icmp sgt {w.integer} {absolute}, {max_absolute}")
    inside = w.select(is_out, w.splat(0.0), x)  # 0 in place of arguments out of bounds
    magic = 1.5 * 2.0**mantissa  # adding it leaves the nearest integer in the low bits
    shifted = w.fma(inside, w.splat(1.0 / math.log(2.0)), w.splat(magic))
    k = w.binary("fsub", shifted, w.splat(magic))
    r = inside
    for part in LN2[bits]:
        r = w.fma(k, w.splat(-part), r)
    polynomial = w.splat(1.0 / math.factorial(DEGREE[bits]))
    for n in reversed(range(DEGREE[bits])):
        polynomial = w.fma(polynomial, r, w.splat(1.0 / math.factorial(n)))
    pattern_of_k = w.new(f"bitcast {w.vector} {shifted} to {w.integer}")
    exponent = w.new(f"shl {w.integer} {pattern_of_k}, {w.bits(mantissa)}")
    pattern_of_polynomial = w.new(f"bitcast {w.vector} {polynomial} to {w.integer}")
    scaled = w.new(f"add {w.integer} {pattern_of_polynomial}, {exponent}")
    result = w.new(f"bitcast {w.integer} {scaled} to {w.vector}")
    result_if_out = w.select(is_negative, w.splat(0.0), w.splat(math.inf))
    infinity = w.bits(w.precision.pattern(math.inf))
    is_nan = w.new(f"icmp sgt {w.integer} {absolute}, {infinity}")
    return w.select(is_nan, x, w.select(is_out, result_if_out, result))
