"""The six entries of a tensor of inertia by the names that files have for them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..typing import Array

ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Name in URDF and SDF → row and column."""
IN_MJCF = sorted(ENTRIES, key=lambda name: ENTRIES[name][0] != ENTRIES[name][1])
"""In the order of MJCF's ``fullinertia``: moments, then products."""


def tensor_of(entry: Callable[[str], float]) -> Array:
    """The symmetric tensor (3, 3) of its entries by name.

    >>> tensor_of({"ixx": 1.0, "ixy": 0.1, "ixz": 0.2, "iyy": 2.0, "iyz": 0.3, "izz": 3.0}.get).tolist()
    [[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]]
    """
    I = np.zeros((3, 3))
    for name, (i, j) in ENTRIES.items():
        I[i, j] = I[j, i] = entry(name)
    return I


def entries_of(I: Array) -> dict[str, float]:
    """The six entries of a tensor (3, 3) by name.

    >>> entries_of(np.diag([1.0, 2.0, 3.0]))["iyy"]
    2.0
    """
    return {name: float(I[at]) for name, at in ENTRIES.items()}
