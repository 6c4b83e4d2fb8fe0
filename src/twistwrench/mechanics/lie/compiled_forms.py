"""Compiled forms of exp and log, installed by ``robot``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.arguments import TOLERANCE
from ...core.typing import Array
from .half_angles import LARGEST_HALF_TURN

Kernel = Callable[[Array], tuple[Array, Any]]

REACH = LARGEST_HALF_TURN**2
"""Square of the largest angle [rad] for compiled forms, half the angle at which they clip."""

_SURE = (0.2 * TOLERANCE) ** 2
"""Largest sum of squared deviations at which a rotation or a pose is accepted without a closer check."""


compiler: Callable[[str], Kernel | None] | None = None
"""Returns the kernel of a function of ``mechanics/lie/se3.py`` by name, or None."""


def exponential(name: str, x: Array, formulas: Callable[[Array], Array]) -> Array:
    """exp of x (..., n), compiled if possible; the NumPy formulas handle rows whose angle is too large."""
    kernel = compiler(name) if compiler else None
    if kernel is None:
        return formulas(x)
    found, square = kernel(x)
    if x.ndim == 1:
        return formulas(x) if square > REACH else found
    far = square > REACH
    if far.any():
        found[far] = formulas(x[far])
    return found


def logarithm(name: str, x: Array, checked: Callable[[Array], Array], formulas: Callable[[Array], Array]) -> Array:
    """log of matrices x (..., n, n); ``checked`` returns x, or raises if x holds a matrix that is not a rotation or pose."""
    kernel = compiler(name) if compiler else None
    if kernel is None:
        return formulas(checked(x))
    result, deviation = kernel(x)
    certain = deviation <= _SURE
    if x.ndim > 2:
        certain = certain.all()
    if not certain:
        checked(x)
    return result
