"""Readings before and after compensation, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError, ValueRangeError
from ..report.table_file import replacing
from .log import ReadingLog
from .outliers import runs
from .sensor import ForceTorqueSensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

__all__ = ["plot_compensation"]

_COLOURS = ("#0072B2", "#D55E00", "#009E73")  # x, y, z: told apart by colour-blind readers too
_QUIET, _MARK = "#8a8f98", "#c0392b"
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555b63",
    "axes.grid": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "figure.dpi": 150,
}
_FEW = 40  # readings up to which each is a dot


def plot_compensation(
    log: ReadingLog,
    sensor: ForceTorqueSensor,
    noise: tuple[float, float],
    path: str | Path,
    *,
    marked: Array,
    mark: str,
) -> None:
    """Draw readings with what the sensor's load explains (left) and what is left (right), forces above moments.

    ``marked`` (n,) readings are shaded and called ``mark`` in the legend. The suffix of ``path`` says the format.
    Raises :class:`~twistwrench.MissingExtraError` without matplotlib, :class:`~twistwrench.ValueRangeError` if the file cannot
    be written.
    """
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError.of("matplotlib", "plot", "Drawing the readings (--plot)") from None
    predicted = log.predicted(sensor)
    left = log.readings - predicted
    x = np.arange(len(log)) if log.time is None else log.time
    with mpl.rc_context(cast("Any", _STYLE)):
        figure = Figure(figsize=(10.5, 6.2), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, 2, sharex=True)
        title = f"{Path(log.name).stem} · {sensor.load.mass:.4g} kg, {sensor.sign.replace('_', ' ')}"
        figure.suptitle(title, fontsize=12, fontweight="bold", x=0.012, ha="left")
        for row, (part, what, unit, sigma) in enumerate(
            ((slice(3, 6), "force", "N", noise[1]), (slice(0, 3), "moment", "N m", noise[0]))
        ):
            names = [f"{'f' if row == 0 else 'm'}{axis}" for axis in "xyz"]
            before, after = axes[row]
            _draw(before, x, log.readings[:, part], names, marked, mark)
            _explain(before, x, predicted[:, part])
            before.set_title(f"{what}s as read", loc="left", fontweight="bold")
            _draw(after, x, left[:, part], names, marked, mark)
            after.axhspan(-2 * sigma, 2 * sigma, color=_QUIET, alpha=0.18, linewidth=0, label="noise ± 2 σ")
            after.set_title(f"{what}s without bias and load", loc="left", fontweight="bold")
            rms = float(np.sqrt(np.mean(left[~marked][:, part] ** 2))) if not marked.all() else float("nan")
            after.set_title(f"rms {rms:.2g} {unit}", loc="right", color=_QUIET, fontsize=8)
            before.set_ylabel(f"{what} [{unit}]")
            for axis in (before, after):
                axis.legend(
                    frameon=False, fontsize=8, ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.0), columnspacing=1.0
                )
                low, high = axis.get_ylim()
                axis.set_ylim(low, high + 0.14 * (high - low))  # the legend's own room
        for axis in axes[1]:
            axis.set_xlabel("reading" if log.time is None else "time [s]", color=_QUIET)
        kind = Path(path).suffix.lstrip(".").lower() or "png"
        known = figure.canvas.get_supported_filetypes()
        if kind not in known:
            raise ValueRangeError(f"cannot draw {str(path)!r}: choose one of {', '.join(f'.{k}' for k in known)}.")
        with replacing(path) as scratch:
            figure.savefig(scratch, format=kind)


def _draw(axis: Axes, x: Array, values: Array, names: list[str], marked: Array, mark: str) -> None:
    few = len(x) <= _FEW
    axis.axhline(0, color="#555b63", linewidth=0.7)
    for k, name in enumerate(names):
        style: dict[str, Any] = {"marker": "o", "markersize": 4.5, "linewidth": 0} if few else {"linewidth": 0.9}
        axis.plot(x, values[:, k], color=_COLOURS[k], label=name, **style)
    half = 0.5 * float(np.min(np.diff(x))) if len(x) > 1 else 0.5
    for count, (first, last) in enumerate(runs(marked)):
        label = mark if count == 0 else None
        axis.axvspan(x[first] - half, x[last] + half, color=_MARK, alpha=0.13, linewidth=0, label=label)


def _explain(axis: Axes, x: Array, predicted: Array) -> None:
    """The model over the readings: rings around dots, a thin dark line over lines."""
    few = len(x) <= _FEW
    for k in range(3):
        style: dict[str, Any] = (
            {"marker": "_", "markersize": 11, "markeredgewidth": 1.1, "linewidth": 0}
            if few
            else {"linewidth": 0.8, "linestyle": (0, (3, 2))}
        )
        axis.plot(x, predicted[:, k], color="#222222", label="model" if k == 0 else None, **style)
