"""The noise of a sensor at the door: two standard deviations, of moments [N m] and of forces [N]."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import TwistWrenchError, ValueRangeError
from ..typing import Array


def checked_noise(noise: ArrayLike, *, none_at_all: bool = False) -> Array:
    """Standard deviations (2,) of moments [N m] and forces [N]; zero only where ``none_at_all`` is meant by it.

    Raises :class:`~twistwrench.ValueRangeError`.

    >>> checked_noise((0.01, 0.3)).tolist()
    [0.01, 0.3]
    """
    try:
        sigma = np.asarray(arguments.real(noise, "noise"), float)
    except TwistWrenchError:  # said below
        sigma = np.empty(0)
    if sigma.shape != (2,) or not np.isfinite(sigma).all() or (sigma < 0 if none_at_all else sigma <= 0).any():
        what = "numbers from 0 on" if none_at_all else "positive numbers"
        raise ValueRangeError(f"noise {noise!r} is not two {what}: of moments [N m] and of forces [N].")
    return sigma


def six_noises(noise: ArrayLike) -> Array:
    """Standard deviations (6,) of mx, my, mz [N m], fx, fy, fz [N], from these six, or from two for three each.

    >>> six_noises((0.01, 0.3)).tolist()
    [0.01, 0.01, 0.01, 0.3, 0.3, 0.3]
    """
    six = np.shape(noise) == (6,)
    sigma = arguments.real(noise, "noise", 6) if six else np.repeat(checked_noise(noise), 3)
    if not np.isfinite(sigma).all() or (sigma <= 0).any():
        raise ValueRangeError(f"noise {noise!r} is not six positive numbers: mx, my, mz [N m], fx, fy, fz [N].")
    return sigma
