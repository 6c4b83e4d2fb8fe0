"""Panels side by side, one for each joint: how many in a row, and their axes."""

from __future__ import annotations

import math
from typing import Any

_COLUMNS = {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}
_MOST = 4


def panel_grid(count: int, most: int | None = None) -> tuple[int, int]:
    """Rows and columns for that many panels; ``most`` in a row if given.

    >>> panel_grid(6), panel_grid(5, most=4)
    ((2, 3), (2, 4))
    """
    columns = _COLUMNS.get(count, _MOST) if most is None else max(1, min(count, most))
    return max(1, math.ceil(count / columns)), columns


def panels(drawn: Any, count: int, most: int | None = None, *, sharex: bool = False) -> list[Any]:
    """Axes of that many panels in a figure or a part of one; what is left over of the grid is not drawn."""
    axes = drawn.subplots(*panel_grid(count, most), sharex=sharex, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_visible(False)
    return list(axes[:count])
