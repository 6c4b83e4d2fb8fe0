"""Choices between numbers that a traced function may make: NumPy's ``maximum`` and ``where`` compare, and symbols cannot.

They take numbers, arrays and symbols in any mixture, element by element, so that a function given to
:func:`twistwrench.differentiate` runs on numbers as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..ir.expr import Expr
from ..ir.tracer import Trace
from .arguments import is_symbolic

__all__ = ["clip", "maximum", "minimum", "where_positive"]

_LARGEST = float(np.finfo(float).max)


def maximum(a: Any, b: Any) -> Any:
    """Larger of two, element by element; its derivative is that of the one taken, and the mean of both where they are equal.

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
    """Smaller of two, element by element; its derivative is that of the one taken, and the mean of both where they are equal.

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
    """Value, or the limit it is beyond, element by element; the upper one where limits are the wrong way round.

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
    return _each(np.clip, lambda t, x, low, high: _smaller(t, high, _larger(t, low, x)), x, lower, upper)


def where_positive(x: Any, a: Any, b: Any) -> Any:
    """Value a where x > 0, else b, element by element; both are computed, and numbers beyond 1.8e308, or NaN, become that.

    Parameters
    ----------
    x : (...) array_like, what is compared with 0
    a, b : (...) array_like, numbers or symbols

    Returns
    -------
    chosen : (...) array
        Its derivative is that of the value taken; by x it is 0. The other value may be infinite or NaN, but then the
        derivative is NaN.

    Examples
    --------
    >>> import twistwrench as tw
    >>> slope = tw.differentiate(lambda x: tw.pointwise.where_positive(x - 1.0, x * x, 3.0 * x), {"x": ()})
    >>> slope([0.0, 2.0]).tolist()
    [3.0, 4.0]
    """
    return _each(lambda x, a, b: np.where(np.asarray(x) > 0, a, b), _where_positive, x, a, b)


def _larger(t: Trace, a: Expr, b: Expr) -> Expr:
    a, b = (b, a) if b.op == "const" else (a, b)
    return t.max(a, _none_where(t, a, b))


def _smaller(t: Trace, a: Expr, b: Expr) -> Expr:
    a, b = (b, a) if b.op == "const" else (a, b)
    return t.min(a, _none_where(t, a, b))


def _none_where(t: Trace, a: Expr, b: Expr) -> Expr:
    """b, and NaN where a is: programs' min and max take their second where one is NaN, and so lose the first."""
    if a.op == "const":
        return a if a.value != a.value else b
    return t.add(b, t.max(t.constant(2.0), t.sign(a)) - 2.0)


def _where_positive(t: Trace, x: Expr, a: Expr, b: Expr) -> Expr:
    """max(min(a, L), min(b, -L)) with L huge where x > 0 and -L else: min and max take their second where one is NaN."""
    huge = _LARGEST * (2.0 * t.max(t.zero, t.sign(x)) - 1.0)
    return t.max(t.min(a, huge), t.min(b, -huge))


def _each(plain: Callable[..., Any], traced: Callable[..., Expr], *given: Any) -> Any:
    """Result by NumPy on numbers, element by element on broadcast arrays of symbols."""
    if not is_symbolic(given):
        return plain(*given)
    arrays = [np.asarray(x, object) for x in given]
    trace = next(e.trace for array in arrays for e in array.flat if isinstance(e, Expr))
    return np.frompyfunc(lambda *x: traced(trace, *(trace.lift(e) for e in x)), len(arrays), 1)(*arrays)
