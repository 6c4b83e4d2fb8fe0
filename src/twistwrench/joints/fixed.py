"""Fixed joints: descriptions have them, models do not, for the links they hold together are fused."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..typing import Array
from .joint import Joint


class Fixed(Joint):
    """No degree of freedom."""

    kind = "fixed"
    coordinate_suffixes = ()
    velocity_suffixes = ()

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """None; whatever a file says of an axis is not looked at."""
        return np.zeros((0, 6))

    def pose(self, q: Array) -> Array:
        """The identity."""
        return np.eye(4)
