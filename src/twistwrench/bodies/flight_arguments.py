"""What a flight is given: numbers of steps, and a wrench that is constant or a function, held to their shape."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ValueRangeError
from ..typing import Array
from .labelled_arguments import common_frame

WrenchLaw = Callable[[float, Array, Array], ArrayLike]
"""A wrench (6,) in {b} from the time [s], the pose T_sb (4, 4) and the body twist (6,), which are plain arrays."""


def steps(duration: float, dt: float, every: int) -> int:
    """How many steps fill the duration. Raises ValueRangeError."""
    for name, x in (("duration", duration), ("dt", dt)):
        if not 0.0 < arguments.number(x, name) < np.inf:
            raise ValueRangeError(f"{name} is {x}, and must be a positive number of seconds.")
    if not (arguments.number(every, "every") >= 1 and every % 1 == 0):
        raise ValueRangeError(f"every is {every}, and must be a whole number of steps, at least 1.")
    if not float(duration) < 1e8 * every * dt:
        raise ValueRangeError(
            f"a duration of {printed(duration)} s in steps of {printed(dt)} s, one in {every} kept, makes more than 1e8 "
            "states. Keep fewer with every, or take a larger dt."
        )
    return max(1, int(np.ceil(duration / dt * (1.0 - 1e-12))))


def six(name: str, x: ArrayLike) -> Array:
    """Six finite numbers. Raises ShapeError, ValueRangeError."""
    return arguments.finite(arguments.one(x, name, 6), name, 6)


def constant(wrench: ArrayLike) -> WrenchLaw:
    """A wrench (6,) as a law."""
    F = six("wrench", wrench)
    return lambda _t, _T, _V: F


def called(wrench: WrenchLaw, frame: str | None) -> WrenchLaw:
    """The function, once it takes three arguments; what it gives is held to one frame, the first that is named."""
    from inspect import signature

    try:
        taken = signature(wrench)
    except (TypeError, ValueError):  # some of C say nothing
        taken = None
    if taken is not None:
        try:
            taken.bind(0.0, None, None)
        except TypeError as problem:
            raise ValueRangeError(
                f"wrench is a function of {taken}, and is called as wrench(t, T, V), with the time [s], the pose T_sb "
                f"(4, 4) and the body twist (6,): {problem}. Write lambda t, T, V: …"
            ) from None

    def law(t: float, T: Array, V: Array) -> ArrayLike:
        nonlocal frame
        F = wrench(t, T, V)
        frame = common_frame(frame, wrench=F)
        return F

    return law
