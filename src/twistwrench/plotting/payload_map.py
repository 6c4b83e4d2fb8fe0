"""The payload map as a picture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..core.printed_numbers import number
from ..statics.payload_map import SLICES, PayloadMap
from ..typing import Array
from .style import OVER, SMALL


def draw_map(figure: Any, chart: PayloadMap, tip: Array) -> None:
    """The largest payload of the best and of the worst posture at each place, side by side."""
    from matplotlib.colors import LogNorm

    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    place = (np.hypot(*tip[:2]), tip[2]) if chart.plane == "rz" else tuple(tip[list(SLICES[chart.plane][:2])])
    finite = chart.best[np.isfinite(chart.best)]
    high = max(
        float(np.percentile(finite, 98)) if finite.size else 1.0, 1e-3
    )  # a few postures hold a hundred times more
    low = min(max(float(np.nanmin(chart.worst)), 1e-2 * high), high)
    shades = LogNorm(low, max(high, 1.01 * low))
    titles = ("Payload map, best posture", "Payload map, worst posture")
    for axis, values, title in zip(axes, (chart.best, chart.worst), titles, strict=True):
        image = axis.pcolormesh(*chart.edges, np.maximum(values, low), norm=shades, cmap="viridis", rasterized=True)
        axis.set_aspect("equal")
        axis.grid(visible=False)
        axis.set_title(title, loc="left", fontweight="bold")
        names = ("distance from the z axis", "z") if chart.plane == "rz" else tuple(chart.plane)
        axis.set_xlabel(f"{names[0]} [m]")
        axis.plot(*place, "x", color="white", markeredgewidth=3.5, markersize=8)
        (cross,) = axis.plot(*place, "x", color=OVER, markeredgewidth=1.8, markersize=7, linestyle="none")
    axes[0].set_ylabel(f"{names[1]} [m]")
    figure.legend([cross], ["the pose above"], loc="outside lower center", frameon=False, fontsize=SMALL)
    bar = figure.colorbar(image, ax=axes, extend="both", label="largest payload [kg]", shrink=0.9)
    ticks = _round_ticks(low, high)
    bar.set_ticks(ticks, labels=[number(x) for x in ticks], minor=False)
    bar.minorticks_off()


def _round_ticks(low: float, high: float) -> list[float]:
    """Round numbers from low to high, a few of them: steps of 1, 2, 5, or finer where these are fewer than three."""
    ticks: list[float] = []
    for steps in ((1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0), tuple(0.1 * k for k in range(10, 100))):
        decades = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        ticks = [float(x) for x in np.outer(decades, steps).ravel() if low <= x <= high]
        if len(ticks) >= 3:
            break
    return ticks
