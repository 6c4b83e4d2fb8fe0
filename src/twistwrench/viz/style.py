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

OVER = COLOURS[Style.OVER].plot
"""Colour of values over a limit."""
NEAR = COLOURS[Style.NEAR].plot
"""Colour of values near a limit."""
POINTED = COLOURS[Style.POINTED].plot
"""Colour of values pointed at."""
QUIET = COLOURS[Style.QUIET].plot
"""Colour of remarks."""
LINE = "#1f4e79"
"""Colour of a single curve."""
AXIS = "#555b63"
"""Colour of axes and zero lines."""
INK = "#222222"
"""Colour of texts, and of marks over colours."""
PALE = "#d5d9df"
"""Colour of areas and curves in the background."""
PAPER = "#ffffff"
"""Colour of the paper, and of rims that separate marks."""
FLOOR = "#d9dde2"
"""Colour of the floor's grid."""

# Colours of Okabe and Ito for colour-blind readers; sky and orange are for areas only.
BLUE = "#0072B2"
SKY = "#56B4E9"
GREEN = "#009E73"
ORANGE = "#E69F00"
VERMILION = "#D55E00"
GREY = "#8C8C8C"

# Colours of curves with a contrast of 3 : 1 on white and on dark backgrounds.
AMBER = "#C98500"
PURPLE = "#C76FA0"
AZURE = "#3B9AD9"
OLIVE = "#8A8B1E"
VIOLET = "#7A63D0"

SERIES = (BLUE, AMBER, GREEN, VERMILION, PURPLE, AZURE, OLIVE, VIOLET)
"""Colours of joints in order, in every plot and in the viewer; further joints repeat them with other dashes."""
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (5, 1.2, 1.2, 1.2)))
"""Matplotlib's line styles: solid, dashed, dotted, dash-dotted."""
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
"""Matplotlib's rcParams for every picture; sizes of fonts in points."""


@contextlib.contextmanager
def figure(width: float, height: float, title: str, purpose: str = "Drawing") -> Iterator[Figure]:
    """Empty figure of a given size and title; within the ``with`` block the common style is active.

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
        FigureCanvasAgg(drawn)  # attaches itself to the figure
        drawn.suptitle(title, fontsize=12, fontweight="bold", x=0.012, ha="left")
        yield drawn


class ShownFigure:
    """Stands for a file; keeps the figure in memory."""

    figure: Any = None
    """Matplotlib's Figure; None until it is drawn."""


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
        file_format = target.suffix.removeprefix(".").lower()
        drawn.savefig(scratch, format=file_format)
    return target


SHORT = "#f8e3b5"
"""Colour of a motor's intermittent region; opaque, since it overlaps the continuous region."""
LONG = "#c3e3d3"
"""Colour of a motor's continuous region."""
_PAGE_VARIABLES = {
    SHORT: "short",
    LONG: "long",
    PAPER: "paper",
    "#000000": "ink",  # Matplotlib's own black
    INK: "ink",
    AXIS: "axis",
    **dict.fromkeys(("#e6e8eb", "#f2f2f2", "#e6e6e6", "#e5e5e5", "#ececec"), "grid"),  # also panes of 3-D figures
    PALE: "pale",
    LINE: "curve",
    **{COLOURS[s].plot: str(s) for s in (Style.OVER, Style.NEAR, Style.QUIET)},
}
"""Variable of the page's style that replaces each colour, since the page has other colours on dark screens."""


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
    svg_options = {"svg.fonttype": "none", "svg.hashsalt": "twistwrench", "path.simplify_threshold": 0.5}
    with tempfile.TemporaryDirectory() as folder, mpl.rc_context(cast("Any", svg_options)):
        path = Path(folder) / "plot.svg"
        plot(path)
        text = path.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]  # without the XML header
    text = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = _without_unused_ids(text)
    text = re.sub(r"#[0-9a-f]{6}\b", lambda match: _page_colour(match[0]), text)
    # numbers are shortened inside elements only, not in written texts
    text = re.sub(r"<[^>]*>", lambda match: _NUMBER_TO_ROUND.sub(r"\1", match[0]), text)
    text = _POLYLINE.sub(lambda match: f' d="{_relative_path(match[1])}"', text)
    text = re.sub(r"\s*\n\s*", " ", text).replace("> <", "><").strip()
    return _with_reproducible_ids(text)


def _without_unused_ids(svg: str) -> str:
    """SVG without the ids that no reference names."""
    referenced_ids = set(re.findall(r"#([\w-]+)[\")]", svg))
    return re.sub(r' id="([\w.-]+)"', lambda match: match[0] if match[1] in referenced_ids else "", svg)


def _page_colour(colour: str) -> str:
    """Variable of the page's style for a neutral colour; other colours as they are."""
    if colour in _PAGE_VARIABLES:
        return f"var(--{_PAGE_VARIABLES[colour]})"
    return colour


def _with_reproducible_ids(svg: str) -> str:
    """SVG with ids that consist of a checksum of the text and a number.

    The checksum differs between the plots of a page. Matplotlib's own ids may differ between runs, since they are hashes of
    coordinates.
    """
    ids = dict.fromkeys(name for _, name in _ID_OR_REFERENCE.findall(svg))  # each once, in order
    numbers = {name: str(k) for k, name in enumerate(ids)}
    svg = _ID_OR_REFERENCE.sub(lambda match: f"{match[1]}{numbers[match[2]]}", svg)
    checksum = zlib.crc32(svg.encode())
    return _ID_OR_REFERENCE.sub(rf"\g<1>p{checksum:08x}-\g<2>", svg)


_ID_OR_REFERENCE = re.compile(r'(\bid="|href="#|url\(#)([\w.-]+)')
"""Id of an SVG element, or reference to one: the text before the name, and the name."""
_NUMBER_TO_ROUND = re.compile(r"(\d\.\d\d)\d+")
"""Number with more than two decimals, of which the first two are kept: hundredths of a point."""
_POLYLINE = re.compile(r' d="((?:M -?[\d.]+ -?[\d.]+\s*(?:L -?[\d.]+ -?[\d.]+\s*)*(?:z\s*)?)+)"')
"""SVG path of straight lines between absolute points, as Matplotlib writes it."""


def _relative_path(absolute: str) -> str:
    """Path with absolute points, rewritten as steps from point to point, which are shorter texts.

    Points are counted in whole hundredths, so that rounding errors of the steps do not add up.
    """
    path = ""
    first_x, first_y = 0, 0  # first point of the current line, to which z returns
    last_x, last_y = 0, 0  # last point of the path so far
    on_one_line = " ".join(absolute.split())
    for command, x_text, y_text in re.findall(r"([MLz])(?: (\S+) (\S+))?", on_one_line):
        if command == "z":
            path += "z"
            last_x, last_y = first_x, first_y
            continue
        x = round(100 * float(x_text))
        y = round(100 * float(y_text))
        if command == "M":
            path += f"M{_hundredths(x)} {_hundredths(y)}l"
            first_x, first_y = x, y
        else:
            path += f"{_hundredths(x - last_x)} {_hundredths(y - last_y)} "
        last_x, last_y = x, y
    path = re.sub(r"l(?=[Mz]|$)", "", path)  # a line of a single point has no steps
    # no blank is needed before a minus or a command
    return path.replace(" -", "-").replace(" z", "z").replace(" M", "M").strip()


def _hundredths(value: int) -> str:
    """Shortest numeral of a number of hundredths: .29, -1.5, 0."""
    units, hundredths = divmod(abs(value), 100)
    digits = f"{units}.{hundredths:02d}".strip("0").rstrip(".") or "0"
    return f"-{digits}" if value < 0 else digits


_MINUS_OF_NUMBER = re.compile(r"(?<![\w.-])-(?=[\d.])")
"""Hyphen before a number, unless a word, a number or another hyphen precedes it."""


def _write_minus(drawn: Figure) -> None:
    """Replace the minus of numbers by U+2212 in all texts, as Matplotlib does at ticks."""
    from matplotlib.text import Text

    for text in drawn.findobj(Text):
        text.set_text(_MINUS_OF_NUMBER.sub("−", text.get_text()))


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
    """Draw stacked terms (label, colour, values), positive values above zero and negative ones below.

    Returns the areas above zero by label, the lower edge and the upper edge of the stack.
    """
    areas: dict[str, Any] = {}
    lower = np.zeros(len(x))
    upper = np.zeros(len(x))
    for label, colour, values in terms:
        options: dict[str, Any] = {"color": colour, "alpha": 0.85, "linewidth": 0}
        next_upper = upper + np.maximum(values, 0.0)
        next_lower = lower + np.minimum(values, 0.0)
        areas[label] = axis.fill_between(x, upper, next_upper, label=label, **options)
        axis.fill_between(x, lower, next_lower, **options)
        lower, upper = next_lower, next_upper
    return areas, lower, upper


MAX_COLOURED = 8
"""Maximum number of coloured curves; further joints are grey."""


def draw_joints(
    axis: Axes, t: Array, values: Array, names: Sequence[str], sizes: Array, places: Sequence[int] | None = None
) -> list[int]:
    """Draw a curve for each joint: the eight of largest ``sizes`` in their colours and dashes, the others grey behind them.

    The columns of ``values`` (n, k) belong to ``names``, and ``places`` are their colour indices, by default 0 to k - 1.
    Returns the indices of the coloured columns.
    """
    largest_first = sorted(range(len(names)), key=lambda k: -float(sizes[k]))  # columns
    coloured_columns = sorted(largest_first[:MAX_COLOURED])
    other_columns = largest_first[MAX_COLOURED:]
    for k in coloured_columns:
        colour_index = k if places is None else places[k]
        colour = SERIES[colour_index % len(SERIES)]
        dashes = DASHES[colour_index // len(SERIES) % len(DASHES)]
        axis.plot(t, values[:, k], linewidth=1.2, label=names[k], color=colour, linestyle=dashes)
    label: str | None = f"{len(other_columns)} others"
    for k in other_columns:
        axis.plot(t, values[:, k], color=PALE, linewidth=0.8, label=label, zorder=1.5)
        label = None  # one entry of the legend for all
    return coloured_columns


def time_colours() -> Any:
    """Colormap of time, from amber over purple to violet, legible on light and dark."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("time", (AMBER, PURPLE, VIOLET))


_COLUMNS_BY_COUNT = {1: 1, 2: 2, 3: 3, 4: 2, 5: 3, 6: 3}
"""Number of columns of a grid, by its number of panels."""
_MAX_COLUMNS = 4
"""Number of columns of grids with more panels."""


def panel_grid(count: int, most: int | None = None) -> tuple[int, int]:
    """Rows and columns of a grid of ``count`` panels; ``most``: largest number of columns.

    >>> panel_grid(6), panel_grid(5, most=4)
    ((2, 3), (2, 4))
    """
    if most is None:
        columns = _COLUMNS_BY_COUNT.get(count, _MAX_COLUMNS)
    else:
        columns = max(1, min(count, most))
    rows = max(1, math.ceil(count / columns))
    return rows, columns


def panels(drawn: Any, count: int, most: int | None = None, *, sharex: bool = False) -> list[Any]:
    """Axes of ``count`` panels in a figure or subfigure; unused cells of the grid are hidden."""
    rows, columns = panel_grid(count, most)
    axes = drawn.subplots(rows, columns, sharex=sharex, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_visible(False)
    return list(axes[:count])


complete(globals())
