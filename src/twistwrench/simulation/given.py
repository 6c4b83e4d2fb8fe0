"""What a simulation is given, at its door: numbers, and functions of (t, q, dq) that are held to their shape at every call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import arguments
from ..core.arguments import positive, whole
from ..errors import SimulationError, ValueRangeError

Array = NDArray[Any]
Function = Callable[[float, Array, Array], Any]
"""Of the time [s], q (nq) and dq (nv)."""

__all__ = ["Function", "Law", "positive", "require_three", "whole"]


@dataclass(frozen=True)
class Law:
    """A function (t, q, dq) whose results are finite arrays of one shape; anything else is a SimulationError that says when."""

    function: Function
    what: str
    shape: tuple[int, ...]
    meaning: str = ""

    @classmethod
    def of(cls, function: Function, what: str, shape: tuple[int, ...], meaning: str = "") -> Law:
        """The function, once it takes three arguments."""
        require_three(function, what)
        return cls(function, what, shape, meaning)

    def __call__(self, t: float, q: Array, dq: Array) -> Array:
        """What the function gives."""
        try:
            # A function may keep what it is given, or change it; a table that it gives would be read by position.
            found = arguments.plain(self.function(t, q.copy(), dq.copy()), self.what)
        except Exception as problem:
            kind = type(problem).__name__
            raise SimulationError(f"{self.what} failed at t = {t:.9g} s with {kind}: {problem}") from problem
        if found.dtype.kind not in "biuf":
            raise SimulationError(
                f"{self.what} gave {found.tolist()!r} at t = {t:.9g} s, expected real numbers of shape "
                f"{self.shape}{self.meaning}."
            )
        if found.shape != self.shape:
            raise SimulationError(
                f"{self.what} gave an array of shape {found.shape} at t = {t:.9g} s, expected {self.shape}{self.meaning}."
            )
        if not self.shape and found.dtype.kind == "b":
            raise SimulationError(
                f"{self.what} gave {bool(found)} at t = {t:.9g} s, and takes a number whose sign changes where it happens: "
                "q[0] - 0.5, not q[0] > 0.5."
            )
        if not np.isfinite(found).all():
            where = "" if not self.shape else f" at place {int(np.flatnonzero(~np.isfinite(found))[0])}"
            raise SimulationError(f"{self.what} gave {found} at t = {t:.9g} s, not finite{where}.")
        return found.astype(float)


def require_three(function: Any, what: str) -> None:
    """Refuse what is no function of three arguments."""
    if not callable(function):
        raise ValueRangeError(f"{what} is {function!r}, and must be a function of (t, q, dq).")
    try:
        taken = signature(function)
    except (TypeError, ValueError):  # some of C say nothing
        return
    try:
        taken.bind(0.0, None, None)
    except TypeError as problem:
        raise ValueRangeError(
            f"{what} is a function of {taken}, and is called with the time [s], q (nq) and dq (nv): {problem}. "
            "Write lambda t, q, dq: …"
        ) from None
