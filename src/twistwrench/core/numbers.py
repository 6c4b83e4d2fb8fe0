"""Rules of printed numbers in every table, report, picture and ``repr``.

* A number has four significant digits without trailing zeros; below a million all digits of its integer part are printed.
* A computed torque also has four significant digits, with trailing zeros, and at most three decimals.
* A standard deviation has two digits, including trailing zeros. Its estimate has as many decimals.
* An unknown value, or a missing limit, is :data:`MISSING`.
* Within a sentence, as in an error message, a number has six digits by default, and nan and inf are printed.
* A fraction is a whole percentage by default.
* A fraction of a limit is 100 % only at the limit: other values have enough decimals to differ from 100 %.
* A limit is exceeded beyond rounding to float32 and to six digits in files: :func:`over_limit`.
* A time within a motion has milliseconds. A residual has two digits and its power of ten.
* In files that programs read, a number has ten digits.
* Signs are ASCII, so that ``float`` reads a copied number.
"""

from __future__ import annotations

import math
from typing import Any, SupportsFloat

import numpy as np

from .typing import Array

MISSING = "–"
"""Text for an unknown number, or for a missing limit."""
DIGITS = 4
"""Default number of significant digits."""
TOLERANCE = 1e-6
"""Excess over a limit, as a fraction of the limit, up to which a value counts as at the limit.

It covers rounding to float32 and to six digits in files.
"""
_MIN_ABBREVIATED = 1e6
"""Magnitude from which the integer part is abbreviated to significant digits."""
_PERCENT = 100.0
"""Percentage of the fraction 1."""
_MAX_ROUNDING = 1e-12
"""Rounding error of a computed number, relative to the scale of its computation."""
_TORQUE_DECIMALS = 3
"""Largest number of decimals of a torque, which suffices in N m, N, rad and m."""
_LIMIT_DECIMALS = 4
"""Number of decimals of a percentage to which limits are checked."""
_MAX_ESTIMATE_DECIMALS = 6
"""Number of decimals above which an estimate and its deviation are printed with significant digits."""


def number(
    value: SupportsFloat | None, digits: int = DIGITS, *, decimals: int | None = None, missing: str = MISSING
) -> str:
    """Number for display, with significant ``digits`` and at most ``decimals``.

    ``missing`` is the text for None, nan and infinity. Values too small for ``decimals`` print as 0.

    >>> number(-62.2648), number(12345.6), number(0.5, decimals=3), number(2e-5, decimals=3), number(float("inf"))
    ('-62.26', '12346', '0.5', '0', '–')
    """
    if value is None:
        return missing
    x = float(value)
    if not math.isfinite(x):
        return missing
    if decimals is not None:
        x = round(x, decimals)
    x += 0.0  # no negative zero
    min_whole = 10.0**digits - 0.5  # from here the integer part has more than ``digits`` digits, after rounding
    if min_whole <= abs(x) < _MIN_ABBREVIATED:
        return f"{x:.0f}"
    return f"{x:.{digits}g}"


def rounded_down(value: SupportsFloat) -> str:
    """Nonnegative number with the digits of :func:`number`, but rounded down: a maximum that is printed must be allowed.

    >>> rounded_down(11.3295), rounded_down(0.3), rounded_down(2.0), rounded_down(0.0)
    ('11.32', '0.3', '2', '0')
    """
    value = float(value)
    if not 0.0 < value < math.inf:
        return number(value)
    unit_of_last_digit = 10.0 ** (math.floor(math.log10(value)) - DIGITS + 1)
    value_in_units = value / unit_of_last_digit * (1.0 + _MAX_ROUNDING)  # so 0.3 is not rounded down to 0.2999
    whole_units = math.floor(value_in_units)
    return number(whole_units * unit_of_last_digit)


def printed(value: SupportsFloat, digits: int = 6, *, signed: bool = False) -> str:
    """Number within a sentence, such as an error message; nan and inf are printed.

    >>> printed(0.1234567), printed(1e-9), printed(12.3456, 3), printed(2.0, signed=True), printed(float("nan"))
    ('0.123457', '1e-09', '12.3', '+2', 'nan')
    """
    x = float(value)
    text = number(x, digits, missing=f"{x:g}")
    if signed and x >= 0.0:
        return f"+{text}"
    return text


def file_number(value: float) -> str:
    """Number in a text that programs read, with ten digits."""
    return f"{value:.10g}"


def torque(value: float) -> str:
    """Computed torque, force, angle or length, with trailing zeros for easy comparison within a column.

    It has at most :data:`_TORQUE_DECIMALS`.
    """
    min_visible = 0.5 * 10.0**-_TORQUE_DECIMALS  # less rounds to zero
    has_trailing_zeros = min_visible <= abs(value) < _MIN_ABBREVIATED
    if not has_trailing_zeros:
        return number(value, decimals=_TORQUE_DECIMALS)
    exponent = math.floor(math.log10(abs(value)))
    decimals = min(max(DIGITS - 1 - exponent, 0), _TORQUE_DECIMALS)
    return f"{value:.{decimals}f}"


def quantity(value: SupportsFloat | None, unit: str, digits: int = DIGITS, *, decimals: int | None = None) -> str:
    """Number with its unit; a missing number has no unit."""
    text = number(value, digits, decimals=decimals)
    if text == MISSING:
        return text
    if unit == "°":
        return f"{text}°"
    return f"{text} {unit}"


def percent(share: SupportsFloat | None, digits: int | None = None) -> str:
    """Fraction as a whole percentage, or as a percentage with significant ``digits``.

    >>> percent(0.7649), percent(0.03217, 3), percent(float("nan"))
    ('76 %', '3.22 %', '–')
    """
    if share is None:
        return MISSING
    x = _PERCENT * float(share)
    if not math.isfinite(x):
        return MISSING
    if digits is None and abs(x) < _MIN_ABBREVIATED:
        return f"{x:.0f} %"
    if digits is None:
        digits = DIGITS
    return f"{number(x, digits)} %"


def percent_of_limit(share: SupportsFloat | None) -> str:
    """Fraction of a limit as a whole percentage; with decimals if whole percentages would show 100 % for another fraction.

    >>> percent_of_limit(0.7649), percent_of_limit(0.996), percent_of_limit(1.00004), percent_of_limit(1.0)
    ('76 %', '99.6 %', '100.004 %', '100 %')
    """
    if share is None:
        return MISSING
    is_near_limit = 0.99 < abs(float(share)) < 1.01
    if not is_near_limit:  # never prints as 100 %
        return percent(share)
    percentage = _PERCENT * float(share)
    for decimals in range(_LIMIT_DECIMALS + 1):  # the fewest that show another number than 100
        text = f"{percentage:.{decimals}f}"
        if abs(float(text)) != _PERCENT:
            return f"{text} %"
    return f"{percentage:.0f} %"


def deviation(sigma: float, decimals: int = 3) -> str:
    """Standard deviation with two digits, including trailing zeros, and at most ``decimals``."""
    if not math.isfinite(sigma):
        return MISSING
    if sigma <= 0:
        return "0"
    unit_of_last_decimal = 10.0**-decimals
    if sigma < 0.5 * unit_of_last_decimal:
        return f"<{unit_of_last_decimal:.{decimals}f}"
    if sigma >= _MIN_ABBREVIATED:
        return number(sigma, 2)
    rounded = float(f"{sigma:.1e}")
    shown_decimals = min(max(_decimals(sigma), 0), decimals)
    return f"{rounded:.{shown_decimals}f}"


def estimate(value: float, sigma: float) -> tuple[str, str]:
    """Texts of an estimate and of ``sigma``, both rounded to the second digit of ``sigma``.

    ``sigma`` is the standard deviation of the estimate, or half its interval.
    """
    texts_apart = number(value), number(sigma, 2)  # without common decimals
    if not math.isfinite(value) or not math.isfinite(sigma) or sigma <= 0:
        return texts_apart
    decimals = _decimals(sigma)
    is_large = max(abs(value), sigma) >= _MIN_ABBREVIATED
    if is_large or decimals > _MAX_ESTIMATE_DECIMALS:
        return texts_apart
    return _rounded_text(value, decimals), _rounded_text(sigma, decimals)


def _rounded_text(x: float, decimals: int) -> str:
    """Number rounded to ``decimals``; -1 rounds to tens, -2 to hundreds."""
    rounded = round(x, decimals) + 0.0  # no negative zero
    shown_decimals = max(decimals, 0)
    return f"{rounded:.{shown_decimals}f}"


def plus_minus(value: SupportsFloat, sigma: SupportsFloat, unit: str = "") -> str:
    """Text of an estimate ± ``sigma``: its standard deviation, or half its interval."""
    value_text, sigma_text = estimate(float(value), float(sigma))
    text = f"{value_text} ± {sigma_text}"
    return f"{text} {unit}" if unit else text


def seconds(time: float, decimals: int = 3) -> str:
    """Time within a motion [s], without its unit; rows of a fast log need four ``decimals``."""
    return f"{time:.{decimals}f}"


def residual(value: float) -> str:
    """Text of a quantity that should be zero."""
    if value:
        return f"{value:.1e}"
    return "0"


def vector(x: Array, digits: int = 6) -> str:
    """Vector (n,) of numbers or symbols in parentheses; rounding errors relative to its largest entry print as zero.

    >>> vector(np.array([0.1 + 0.2, 1e-17, -2.0]))
    '(0.3, 0, -2)'
    """
    if x.dtype == object:  # symbols
        texts = [str(entry) for entry in x]
    else:
        texts = [number(entry, digits) for entry in without_noise(x)]
    return f"({', '.join(texts)})"


def without_noise(x: Array, scale: float | None = None) -> Array:
    """Numbers with rounding errors set to zero: values below 1e-12 of ``scale``, by default of the largest finite entry."""
    if scale is None:
        finite_entries = x[np.isfinite(x)]
        scale = np.abs(finite_entries).max(initial=0.0)
    return np.where(np.abs(x) <= _MAX_ROUNDING * scale, 0.0, x) + 0.0  # no negative zero


def _decimals(sigma: float) -> int:
    """Number of decimals up to a deviation's second digit; negative if this digit is left of the decimal point."""
    rounded = float(f"{sigma:.1e}")  # 0.0999 is printed as 0.10
    exponent = math.floor(math.log10(rounded) + 1e-9)  # a power of ten is not below its own exponent by round-off
    return 1 - exponent


# ── Limits


def over_limit(share: Any) -> Any:
    """True if a magnitude exceeds its limit by more than rounding errors.

    Parameters
    ----------
    share : float or (...) array, magnitude divided by its limit

    Returns
    -------
    over : bool or (...) array of bool; False for NaN

    Examples
    --------
    >>> over_limit(1 + 0.5 * TOLERANCE), over_limit(1 + 2 * TOLERANCE)
    (False, True)
    """
    return share > 1 + TOLERANCE


def margin(limit: Any) -> Array:
    """Largest excess over a limit with which a magnitude still counts as at the limit.

    Parameters
    ----------
    limit : (...) array_like, inf where no limit is given

    Returns
    -------
    margin : (...) array, in the unit of the limit; finite everywhere

    Examples
    --------
    >>> margin([150.0, np.inf]).tolist()
    [0.00015, 1e-06]
    """
    limit = np.asarray(limit, float)
    scale = np.where(np.isfinite(limit), limit, 1.0)  # any finite number is allowed without a limit
    return np.asarray(TOLERANCE * scale)
