"""Common style of all pictures and their files. Matplotlib is imported when a picture is drawn."""

from __future__ import annotations

import contextlib
import math
import re
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..core.colours import COLOURS, Style
from ..core.errors import MissingExtraError
from ..core.files import picture_path, replacing
from ..core.glossary import complete
from ..core.typing import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure

__all__ = ["figure", "page_svg", "require_matplotlib", "save"]

OVER, NEAR, POINTED, QUIET = (COLOURS[s].plot for s in (Style.OVER, Style.NEAR, Style.POINTED, Style.QUIET))
LINE, AXIS, INK, PALE = "#1f4e79", "#555b63", "#222222", "#d5d9df"
"""Colours of curves, axes and zero lines, marks over colours, and backgrounds of curves."""
PAPER, FLOOR = "#ffffff", "#d9dde2"
"""Colours of rims on the paper, and of the floor's grid."""
BLUE, SKY, GREEN, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#E69F00"
VERMILION, GREY = "#D55E00", "#8C8C8C"
"""Colours of Okabe and Ito for colour-blind readers; sky and orange are for areas only."""
AMBER, PURPLE, AZURE, OLIVE, VIOLET = "#C98500", "#C76FA0", "#3B9AD9", "#8A8B1E", "#7A63D0"
"""Colours of curves with a contrast of 3 : 1 on white and on dark backgrounds."""
SERIES = (BLUE, AMBER, GREEN, VERMILION, PURPLE, AZURE, OLIVE, VIOLET)
"""Colours of joints in order, in every plot and in the viewer; further joints repeat them with other dashes."""
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (5, 1.2, 1.2, 1.2)))
CAUSES: Mapping[str, str] = MappingProxyType(
    {
        "inertia": BLUE,
        "coriolis": SKY,
        "gravity": ORANGE,
        "spring": GREEN,
        "payload": VERMILION,
        "friction": GREY,
        "wrench": PURPLE,
        "contact": OLIVE,
    }
)
"""Colours of the causes of a torque."""
LIMIT: Mapping[str, Any] = MappingProxyType({"color": OVER, "linewidth": 0.9, "linestyle": (0, (4, 3))})
"""Line style of a limit."""
SMALL_FONT = 8
"""Font size in points of legends and remarks; titles and labels use :data:`STYLE`."""
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
        "legend.fontsize": SMALL_FONT,
        "legend.frameon": False,
        "text.parse_math": False,  # names of robots, joints and files may contain dollars
    }
)
"""Matplotlib's rcParams for every picture."""


@contextlib.contextmanager
def figure(width: float, height: float, title: str, purpose: str = "Drawing") -> Iterator[Figure]:
    """Empty figure of a given size and title, in the common style within the ``with`` block.

    Parameters
    ----------
    width, height : float [inches]
    title : str
    purpose : str, first words of the message if matplotlib is missing

    Yields
    ------
    figure : Matplotlib's Figure, without window and independent of pyplot

    Raises
    ------
    MissingExtraError
        Matplotlib is not installed.

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


class ShownFigure:
    """Figure in memory, in place of a file."""

    figure: Any = None


def save(drawn: Figure, path: str | Path | ShownFigure) -> Path:
    """Write a figure atomically: on failure an existing file is kept.

    Parameters
    ----------
    drawn : Matplotlib's Figure
    path : str or Path; the suffix selects the format, default .png; or a ShownFigure, which keeps the figure

    Raises
    ------
    ValueRangeError
        The format is not .png, .pdf or .svg, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, figure(4, 3, "a title") as drawn:
    ...     save(drawn, f"{folder}/empty").suffix
    '.png'
    """
    import matplotlib as mpl

    if isinstance(path, ShownFigure):
        path.figure = drawn
        return Path()
    target = Path(picture_path(path))
    # Ticks and their labels are created on saving, so the style must be active again.
    with replacing(target) as scratch, mpl.rc_context(cast("Any", dict(STYLE))):
        _write_minus(drawn)
        drawn.savefig(scratch, format=target.suffix[1:].lower())
    return target


SHORT, LONG = "#f8e3b5", "#c3e3d3"
"""Colours of a motor's intermittent and continuous regions; opaque, since they overlap."""
_PAGE = {
    SHORT: "short",
    LONG: "long",
    PAPER: "paper",
    "#000000": "ink",
    INK: "ink",
    AXIS: "axis",
    **dict.fromkeys(("#e6e8eb", "#f2f2f2", "#e6e6e6", "#e5e5e5", "#ececec"), "grid"),  # also panes of 3-D figures
    PALE: "pale",
    LINE: "curve",
    **{COLOURS[s].plot: str(s) for s in (Style.OVER, Style.NEAR, Style.QUIET)},
}
"""Colours that a page replaces by its own, which differ on dark screens."""


def page_svg(plot: Callable[[Path], object]) -> str:
    """Reproducible SVG of a plot for a page, with text kept as text.

    Parameters
    ----------
    plot : callable, draws into the file with the given path

    Returns
    -------
    text : str, SVG element with neutral colours as variables of the page's style

    Examples
    --------
    >>> def plot(path):
    ...     with figure(4, 3, "a title") as drawn:
    ...         save(drawn, path)
    >>> text = page_svg(plot)
    >>> text[:4], "var(--paper)" in text, text == page_svg(plot)
    ('<svg', True, True)
    """
    mpl = require_matplotlib("Drawing the report")
    fixed = {"svg.fonttype": "none", "svg.hashsalt": "twistwrench", "path.simplify_threshold": 0.5}
    with tempfile.TemporaryDirectory() as folder, mpl.rc_context(cast("Any", fixed)):
        path = Path(folder) / "plot.svg"
        plot(path)
        text = path.read_text(encoding="utf-8")
    text = re.sub(
        r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", text[text.index("<svg") :], flags=re.DOTALL
    )
    used = set(re.findall(r"#([\w-]+)[\")]", text))
    text = re.sub(r' id="([\w.-]+)"', lambda found: found[0] if found[1] in used else "", text)
    text = re.sub(r"#[0-9a-f]{6}\b", lambda found: f"var(--{_PAGE[found[0]]})" if found[0] in _PAGE else found[0], text)
    text = re.sub(r"<[^>]*>", lambda found: _LONG.sub(r"\1", found[0]), text)
    text = _POLYLINE.sub(lambda found: f' d="{_relative_path(found[1])}"', text)
    text = re.sub(r"\s*\n\s*", " ", text).replace("> <", "><").strip()
    # Matplotlib derives names from hashes of coordinates, whose last digit differs between runs.
    names = dict.fromkeys(name for _, name in _NAMES.findall(text))
    numbers = {name: str(k) for k, name in enumerate(names)}
    text = _NAMES.sub(lambda found: f"{found[1]}{numbers[found[2]]}", text)
    return _NAMES.sub(rf"\g<1>p{zlib.crc32(text.encode()):08x}-\g<2>", text)


_NAMES = re.compile(r'(\bid="|href="#|url\(#)([\w.-]+)')
_LONG = re.compile(r"(\d\.\d\d)\d+")
"""Numbers of an SVG element, to be rounded to hundredths of a point."""
_POLYLINE = re.compile(r' d="((?:M -?[\d.]+ -?[\d.]+\s*(?:L -?[\d.]+ -?[\d.]+\s*)*(?:z\s*)?)+)"')
"""Path of straight lines between absolute places, as Matplotlib writes it."""


def _relative_path(absolute: str) -> str:
    """The same path in steps from place to place, counted in whole hundredths so that rounding does not add up."""
    found, begin, place = "", (0, 0), (0, 0)
    for command, x, y in re.findall(r"([MLz])(?: (\S+) (\S+))?", " ".join(absolute.split())):
        if command == "z":
            found, place = f"{found}z", begin
            continue
        there = round(100 * float(x)), round(100 * float(y))
        if command == "M":
            begin, found = there, f"{found}M{_hundredths(there[0])} {_hundredths(there[1])}l"
        else:
            found += f"{_hundredths(there[0] - place[0])} {_hundredths(there[1] - place[1])} "
        place = there
    return re.sub(r"l(?=[Mz]|$)", "", found).replace(" -", "-").replace(" z", "z").replace(" M", "M").strip()


def _hundredths(value: int) -> str:
    """Shortest numeral of hundredths: .29, -1.5, 0."""
    whole, part = divmod(abs(value), 100)
    digits = f"{whole}.{part:02d}".strip("0").rstrip(".") or "0"
    return f"-{digits}" if value < 0 else digits


_MINUS = re.compile(r"(?<![\w.-])-(?=[\d.])")


def _write_minus(drawn: Figure) -> None:
    """Replace the minus of numbers by U+2212 in all texts, as Matplotlib does at ticks."""
    from matplotlib.text import Text

    for text in drawn.findobj(Text):
        text.set_text(_MINUS.sub("−", text.get_text()))


def require_matplotlib(purpose: str = "Drawing") -> Any:
    """Import matplotlib.

    Parameters
    ----------
    purpose : str, first words of the message if it cannot be imported

    Returns
    -------
    matplotlib : module

    Raises
    ------
    MissingExtraError
        Matplotlib cannot be imported; the message names the extra.

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
    """Write the name of a panel at its left and a small remark at its right."""
    axis.set_title(name, loc="left", fontweight="bold")
    if remark:
        axis.set_title(remark, loc="right", color=colour, fontsize=SMALL_FONT)


def stack(axis: Axes, x: Array, terms: Iterable[tuple[str, str, Array]]) -> tuple[dict[str, Any], Array, Array]:
    """Draw stacked terms (label, colour, values) above and below zero; returns the areas, lower edge and upper edge."""
    areas: dict[str, Any] = {}
    below, above = np.zeros(len(x)), np.zeros(len(x))
    for label, colour, values in terms:
        look: dict[str, Any] = {"color": colour, "alpha": 0.85, "linewidth": 0}
        up, down = np.maximum(values, 0.0), np.minimum(values, 0.0)
        areas[label] = axis.fill_between(x, above, above + up, label=label, **look)
        axis.fill_between(x, below, below + down, **look)
        below, above = below + down, above + up
    return areas, below, above


MAX_COLOURED = 8
"""Maximum number of coloured curves; further joints are grey."""


def draw_joints(
    axis: Axes, t: Array, values: Array, names: Sequence[str], sizes: Array, places: Sequence[int] | None = None
) -> list[int]:
    """Draw a curve for each joint in its colour and dashes; joints beyond the eight largest ``sizes`` are grey behind.

    ``values`` (n, k) belong to ``names``; ``places`` are colour indices, default 0 to k - 1. Returns the coloured
    columns.
    """
    order = sorted(range(len(names)), key=lambda k: -float(sizes[k]))
    coloured, others = sorted(order[:MAX_COLOURED]), order[MAX_COLOURED:]
    for k in coloured:
        n = k if places is None else places[k]
        look = {"color": SERIES[n % len(SERIES)], "linestyle": DASHES[n // len(SERIES) % len(DASHES)]}
        axis.plot(t, values[:, k], linewidth=1.2, label=names[k], **look)
    for n, k in enumerate(others):
        label = None if n else f"{len(others)} others"
        axis.plot(t, values[:, k], color=PALE, linewidth=0.8, label=label, zorder=1.5)
    return coloured


def time_colours() -> Any:
    """Colormap of time, from amber over purple to violet, legible on light and dark."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("time", (AMBER, PURPLE, VIOLET))


_COLUMNS = {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}
_MAX_COLUMNS = 4


def panel_grid(count: int, most: int | None = None) -> tuple[int, int]:
    """Rows and columns for ``count`` panels; at most ``most`` in a row if given.

    >>> panel_grid(6), panel_grid(5, most=4)
    ((2, 3), (2, 4))
    """
    columns = _COLUMNS.get(count, _MAX_COLUMNS) if most is None else max(1, min(count, most))
    return max(1, math.ceil(count / columns)), columns


def panels(drawn: Any, count: int, most: int | None = None, *, sharex: bool = False) -> list[Any]:
    """Axes of ``count`` panels in a figure or subfigure; unused cells of the grid are hidden."""
    axes = drawn.subplots(*panel_grid(count, most), sharex=sharex, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_visible(False)
    return list(axes[:count])


complete(globals())
