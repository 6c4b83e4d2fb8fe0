"""The style of all pictures and their files. Matplotlib is imported only when one is drawn."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..core.files import picture_path, replacing
from ..core.glossary import complete
from ..errors import MissingExtraError
from ..typing import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure

__all__ = ["figure", "require_matplotlib", "save"]

LINE, OVER, QUIET, AXIS, INK, PALE = "#1f4e79", "#c0392b", "#8a8f98", "#555b63", "#222222", "#d5d9df"
"""A curve, what is over a limit or in doubt, remarks, axes and zero lines, what is drawn over colours, and behind curves."""
BLUE, SKY, GREEN, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#E69F00"
"""Okabe and Ito's colours, which colour-blind readers can distinguish; the rest of them follow."""
VERMILION, PURPLE, GREY, YELLOW = "#D55E00", "#CC79A7", "#999999", "#F0E442"
SERIES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, GREY, YELLOW)
"""Colours of joints, in their order, in every picture; they repeat after the last."""
LIMIT: Mapping[str, Any] = MappingProxyType({"color": OVER, "linewidth": 0.9, "linestyle": (0, (4, 3))})
"""A line at a limit."""
SMALL = 8
"""Points, of legends and remarks; titles and labels have their sizes from :data:`STYLE`."""
STYLE = MappingProxyType(
    {
        "font.size": 9,
        "axes.titlesize": 9.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.edgecolor": AXIS,
        "axes.grid": True,
        "grid.color": "#e6e8eb",
        "grid.linewidth": 0.7,
        "axes.axisbelow": True,
        "figure.dpi": 150,
        "legend.fontsize": SMALL,
        "legend.frameon": False,
        "text.parse_math": False,  # names of robots, joints and files may have dollars
    }
)
"""Matplotlib's rcParams of every picture."""


@contextlib.contextmanager
def figure(width: float, height: float, title: str, purpose: str = "Drawing (--plot)") -> Iterator[Figure]:
    """Empty figure of a size and title; what is drawn within the ``with`` block has the one style.

    Parameters
    ----------
    width, height : float [inches]
    title : str
    purpose : str, begins the message where there is no matplotlib

    Yields
    ------
    figure : Matplotlib's Figure, which belongs to no window and no pyplot

    Raises
    ------
    MissingExtraError
        There is no matplotlib.

    Examples
    --------
    >>> with figure(4, 3, "a title") as drawn:
    ...     axes = drawn.subplots()
    >>> axes.figure is drawn
    True
    """
    mpl = require_matplotlib(purpose)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(cast("Any", dict(STYLE))):
        drawn = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(drawn)
        drawn.suptitle(title, fontsize=12, fontweight="bold", x=0.012, ha="left")
        yield drawn


def save(drawn: Figure, path: str | Path) -> Path:
    """Write a figure whole, or leave what is there alone.

    Parameters
    ----------
    drawn : Matplotlib's Figure
    path : str or Path; the suffix says the kind, .png if there is none

    Raises
    ------
    ValueRangeError
        The kind is other than .png, .pdf and .svg, or nothing can be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, figure(4, 3, "a title") as drawn:
    ...     save(drawn, f"{folder}/empty").suffix
    '.png'
    """
    import matplotlib as mpl

    target = Path(picture_path(path))
    # Ticks and their labels are made only now, so the style has to be on once more.
    with replacing(target) as scratch, mpl.rc_context(cast("Any", dict(STYLE))):
        drawn.savefig(scratch, format=target.suffix[1:].lower())
    return target


def require_matplotlib(purpose: str = "Drawing (--plot)") -> Any:
    """The matplotlib package.

    Parameters
    ----------
    purpose : str, begins the message where it cannot be imported

    Returns
    -------
    matplotlib : module

    Raises
    ------
    MissingExtraError
        It cannot be imported; the extra is named.

    Examples
    --------
    >>> require_matplotlib().__name__
    'matplotlib'
    """
    try:
        import matplotlib as mpl
        import matplotlib.backends.backend_agg
        import matplotlib.figure
    except ImportError:
        raise MissingExtraError.from_extra("matplotlib", "plot", purpose) from None
    return mpl


def titles(axis: Axes, name: str, remark: str = "", colour: str = QUIET) -> None:
    """Write the name of a panel at its left, and a small remark at its right."""
    axis.set_title(name, loc="left", fontweight="bold")
    if remark:
        axis.set_title(remark, loc="right", color=colour, fontsize=SMALL)


def stack(axis: Axes, x: Array, terms: Iterable[tuple[str, str, Array]]) -> tuple[dict[str, Any], Array, Array]:
    """Draw terms (label, colour, values) on each other, above and below zero; the areas, the lower and the upper edge."""
    areas: dict[str, Any] = {}
    below, above = np.zeros(len(x)), np.zeros(len(x))
    for label, colour, values in terms:
        look: dict[str, Any] = {"color": colour, "alpha": 0.85, "linewidth": 0}
        up, down = np.maximum(values, 0.0), np.minimum(values, 0.0)
        areas[label] = axis.fill_between(x, above, above + up, label=label, **look)
        axis.fill_between(x, below, below + down, **look)
        below, above = below + down, above + up
    return areas, below, above


# ── Grids of panels

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


complete(globals())
