"""Elementwise comparisons for traced functions, since symbols do not support NumPy's ``maximum`` and ``where``.

They take any mixture of numbers, arrays and symbols. A function for :func:`twistwrench.differentiate` thus also runs on
numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..compiler.ir.expr import Expr
from ..compiler.ir.tracer import Trace
from .arguments import is_symbolic

__all__ = ["clip", "maximum", "minimum", "where_positive"]

_LARGEST_FLOAT = float(np.finfo(float).max)


def maximum(a: Any, b: Any) -> Any:
    """Elementwise maximum; its derivative is that of the larger argument, or the mean of both if they are equal.

    Parameters
    ----------
    a, b : (...) array_like, numbers or symbols

    Returns
    -------
    larger : (...) array

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> over = tw.differentiate(lambda x: tw.pointwise.maximum(x - 1.0, 0.0) @ np.ones(3), {"x": 3})
    >>> over([0.0, 2.0, 3.0]).tolist()
    [0.0, 1.0, 1.0]
    """
    return _each(np.maximum, _larger, a, b)


def minimum(a: Any, b: Any) -> Any:
    """Elementwise minimum; its derivative is that of the smaller argument, or the mean of both if they are equal.

    Parameters
    ----------
    a, b : (...) array_like, numbers or symbols

    Returns
    -------
    smaller : (...) array

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.differentiate(lambda x: tw.pointwise.minimum(x, 2.0), {"x": ()})([1.0, 3.0]).tolist()
    [1.0, 0.0]
    """
    return _each(np.minimum, _smaller, a, b)


def clip(x: Any, lower: Any, upper: Any) -> Any:
    """Values clipped to limits, element by element; the upper limit if the limits are reversed.

    Parameters
    ----------
    x : (...) array_like, numbers or symbols
    lower, upper : (...) array_like, limits, numbers or symbols

    Returns
    -------
    clipped : (...) array

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.differentiate(lambda x: tw.pointwise.clip(x, -1.0, 1.0), {"x": ()})([0.5, 2.0]).tolist()
    [1.0, 0.0]
    """
    return _each(np.clip, _clipped, x, lower, upper)


def where_positive(x: Any, a: Any, b: Any) -> Any:
    """Elementwise selection: a where x > 0, else b. Both are evaluated; numbers beyond 1.8e308, or NaN, become infinite or NaN.

    Parameters
    ----------
    x : (...) array_like, compared with 0
    a, b : (...) array_like, numbers or symbols

    Returns
    -------
    chosen : (...) array
        The derivative is that of the selected value; by x it is 0. If the other value is infinite or NaN, the
        derivative is NaN.

    Examples
    --------
    >>> import twistwrench as tw
    >>> slope = tw.differentiate(lambda x: tw.pointwise.where_positive(x - 1.0, x * x, 3.0 * x), {"x": ()})
    >>> slope([0.0, 2.0]).tolist()
    [3.0, 4.0]
    """
    return _each(lambda x, a, b: np.where(np.asarray(x) > 0, a, b), _where_positive, x, a, b)


# Symbolic versions for one element. In programs, min and max return their second argument if either one is NaN.


def _larger(t: Trace, a: Expr, b: Expr) -> Expr:
    """Larger of two symbols; NaN if either is NaN."""
    a, b = _constant_first(a, b)
    return t.max(a, _with_nan_of(t, a, b))


def _smaller(t: Trace, a: Expr, b: Expr) -> Expr:
    """Smaller of two symbols; NaN if either is NaN."""
    a, b = _constant_first(a, b)
    return t.min(a, _with_nan_of(t, a, b))


def _clipped(t: Trace, x: Expr, lower: Expr, upper: Expr) -> Expr:
    """x within its limits; the upper limit if they are reversed."""
    return _smaller(t, upper, _larger(t, lower, x))


def _constant_first(a: Expr, b: Expr) -> tuple[Expr, Expr]:
    """Both operands, a constant first if there is one: its check for NaN needs no instruction."""
    return (b, a) if b.op == "const" else (a, b)


def _with_nan_of(t: Trace, a: Expr, b: Expr) -> Expr:
    """b, or NaN where a is NaN."""
    if a.op == "const":
        is_nan = a.value != a.value  # only NaN differs from itself
        return a if is_nan else b
    two_or_nan = t.max(t.constant(2.0), t.sign(a))  # the sign is below 2, or NaN
    zero_or_nan = two_or_nan - 2.0
    return t.add(b, zero_or_nan)


def _where_positive(t: Trace, x: Expr, a: Expr, b: Expr) -> Expr:
    """a where x > 0, else b, as max(min(a, L), min(b, -L)): L is the largest number if x > 0, otherwise minus that."""
    one_if_positive = t.max(t.zero, t.sign(x))  # otherwise 0
    signed_largest = _LARGEST_FLOAT * (2.0 * one_if_positive - 1.0)
    return t.max(t.min(a, signed_largest), t.min(b, -signed_largest))


def _each(numpy_function: Callable[..., Any], traced_function: Callable[..., Expr], *operands: Any) -> Any:
    """NumPy's result for numbers; for symbols, the traced function of each element of the broadcast arrays."""
    if not is_symbolic(operands):
        return numpy_function(*operands)
    arrays = [np.asarray(operand, object) for operand in operands]
    trace = next(entry.trace for array in arrays for entry in array.flat if isinstance(entry, Expr))

    def element(*entries: Any) -> Expr:
        return traced_function(trace, *map(trace.lift, entries))

    with np.errstate(invalid="ignore"):  # comparisons with a constant NaN, which the result contains
        return np.frompyfunc(element, len(arrays), 1)(*arrays)
