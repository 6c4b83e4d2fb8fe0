"""Fixed joints: in descriptions only; models fuse their links."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...core.glossary import complete
from ...core.typing import Array
from .joint import Joint


class Fixed(Joint):
    """Joint without a degree of freedom."""

    kind = "fixed"
    coordinate_suffixes = ()
    velocity_suffixes = ()

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Return no axes; an axis in the file is ignored."""
        return np.zeros((0, 6))

    def pose(self, q: Array) -> Array:
        """Identity pose."""
        return np.eye(4)


complete(globals())
