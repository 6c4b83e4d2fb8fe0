"""Compiled forms of exp and log, put in place by ``robot``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..core.arguments import TOLERANCE
from ..typing import Array
from .quaternion import LARGEST_HALF_TURN

Kernel = Callable[[Array], tuple[Array, Any]]

REACH = LARGEST_HALF_TURN**2
"""The square of the largest angle [rad] that compiled forms take: half angles are clipped at twice as much."""

_SURE = (0.2 * TOLERANCE) ** 2
"""Largest sum of squared gaps of a rotation or a pose that passes without a closer check."""


def _nothing(_name: str) -> Kernel | None:
    return None


compiler: Callable[[str], Kernel | None] = _nothing
"""Returns the kernel of a function of ``lie/se3.py`` by its name; None without a compiler."""


def exponential(name: str, x: Array, formulas: Callable[[Array], Array]) -> Array:
    """exp of x (..., n); by the formulas for NumPy where it is not compiled, and for rows that turn too far."""
    kernel = compiler(name)
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
    """log of matrices x (..., n, n), which ``checked`` returns, or refuses if they are not rotations or poses."""
    kernel = compiler(name)
    if kernel is None:
        return formulas(checked(x))
    found, off = kernel(x)
    if not (off <= _SURE if x.ndim == 2 else (off <= _SURE).all()):
        checked(x)
    return found
