"""What a simulation is given, at its door: numbers, and functions of (t, q, dq) that are held to their shape at every call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from math import isfinite
from types import FunctionType
from typing import Any

import numpy as np

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import SimulationError, ValueRangeError
from ..typing import Array

Function = Callable[[float, Array, Array], Any]
"""Of the time [s], q (nq) and dq (nv)."""


@dataclass(frozen=True)
class Law:
    """A function (t, q, dq) whose results are finite arrays of one shape; anything else is a SimulationError that says when."""

    function: Function
    what: str
    shape: tuple[int, ...]
    meaning: str = ""
    varies: bool = True
    """Whether it is the caller's function, and not a constant."""

    @classmethod
    def of(cls, function: Function, what: str, shape: tuple[int, ...], meaning: str = "") -> Law:
        """The function, once it takes three arguments."""
        require_three(function, what)
        return cls(function, what, shape, meaning)

    def __call__(self, t: float, q: Array, dq: Array) -> Array:
        """What the function gives."""
        try:
            found = self.function(t, q.copy(), dq.copy())  # a function may keep what it is given, or change it
        except Exception as problem:
            raise self.failure(t, problem) from problem
        return self.checked(t, found)

    def number(self, t: float, q: Array, dq: Array) -> float:
        """The same of a function of one number."""
        try:
            found = self.function(t, q.copy(), dq.copy())
        except Exception as problem:
            raise self.failure(t, problem) from problem
        return float(found) if isinstance(found, float) and isfinite(found) else float(self.checked(t, found))

    def failure(self, t: float, problem: Exception) -> SimulationError:
        """What to say where the function raised an exception."""
        return SimulationError(f"{self.what} failed at t = {printed(t, 9)} s with {type(problem).__name__}: {problem}")

    def checked(self, t: float, given: Any) -> Array:
        """What the function gave, as floats of its own; SimulationError where it is something else."""
        try:
            found = arguments.plain(given, self.what)  # a table would be read by position
        except Exception as problem:
            raise self.failure(t, problem) from problem
        if found.dtype.kind not in "biuf":
            raise SimulationError(
                f"{self.what} gave {found.tolist()!r} at t = {printed(t, 9)} s, expected real numbers of shape "
                f"{self.shape}{self.meaning}."
            )
        if found.shape != self.shape:
            raise SimulationError(
                f"{self.what} gave an array of shape {found.shape} at t = {printed(t, 9)} s, expected "
                f"{self.shape}{self.meaning}."
            )
        if not self.shape and found.dtype.kind == "b":
            raise SimulationError(
                f"{self.what} gave {bool(found)} at t = {printed(t, 9)} s, and takes a number whose sign changes where it "
                "happens: q[0] - 0.5, not q[0] > 0.5."
            )
        if not np.isfinite(found).all():
            where = "" if not self.shape else f" at place {int(np.flatnonzero(~np.isfinite(found))[0])}"
            raise SimulationError(f"{self.what} gave {found} at t = {printed(t, 9)} s, not finite{where}.")
        return found.astype(float)

    def values(self, t: Array, q: Array, dq: Array) -> Array:
        """What the function gives at times (m,) and states (m, nq), (m, nv), held to their shape together."""
        rows = list(zip(t.tolist(), q, dq, strict=True))
        try:
            found = np.array([self.function(*row) for row in rows], float)
        except Exception:  # said with its time below
            found = np.zeros(0)
        if found.shape == (len(rows), *self.shape) and np.isfinite(found).all():
            return found
        return np.array([self(*row) for row in rows])


def require_three(function: Any, what: str) -> None:
    """Refuse what is no function of (t, q, dq)."""
    require_arguments(function, what, ("the time [s]", "q (nq)", "dq (nv)"), "t, q, dq")


def require_arguments(function: Any, what: str, taken: Sequence[str], names: str = "share") -> None:
    """Refuse what is no function of so many arguments, which are ``taken`` in words. Raises ValueRangeError."""
    if not callable(function) or isinstance(function, type):
        raise ValueRangeError(f"{what} is {arguments.shown(function)}, and must be a function of ({names}).")
    code = function.__code__ if isinstance(function, FunctionType) else None
    if (
        code is not None and code.co_argcount == len(taken) and not code.co_kwonlyargcount
    ):  # a signature takes longer than many steps
        return
    try:
        signed = signature(function)
    except (TypeError, ValueError):  # some of C say nothing
        return
    try:
        signed.bind(*[None] * len(taken))
    except TypeError as problem:
        listed = " and ".join(filter(None, [", ".join(taken[:-1]), taken[-1]]))
        raise ValueRangeError(
            f"{what} is a function of {signed}, and is called with {listed}: {problem}. Write lambda {names}: …"
        ) from None
