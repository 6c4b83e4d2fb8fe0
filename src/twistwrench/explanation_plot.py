"""The explanation of a torque as a picture: a bar per joint, stacked by cause."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .figure import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, QUIET, SKY, SMALL, VERMILION, figure, save

if TYPE_CHECKING:
    from .explanation import Explanation

__all__ = ["plot_explanation"]

_COLOURS = (BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE)
_MOST = 8
"""Causes drawn by themselves; the smallest of more are drawn as one."""


def plot_explanation(why: Explanation, path: str | Path) -> Path:
    """Draw ``why`` to ``path``; see :meth:`Explanation.plot`."""
    parts, names = why.by_cause, list(why.causes)
    order = np.argsort(-np.abs(parts).max(axis=1), kind="stable")
    shown = sorted(order[:_MOST].tolist())
    rest = [c for c in order[_MOST:].tolist() if parts[c].any()]
    rows = [(names[c], parts[c]) for c in shown if parts[c].any()]
    if rest:
        rows.append((f"{len(rest)} others", parts[rest].sum(axis=0)))
    places = np.arange(len(why.joints))
    with figure(
        max(6.0, 1.1 * len(places) + 3.2), 4.2, "What each torque is made of", "Drawing an explanation"
    ) as drawn:
        axis = drawn.subplots()
        above, below = np.zeros(len(places)), np.zeros(len(places))
        for k, (name, row) in enumerate(rows):
            colour = GREY if rest and k == len(rows) - 1 else _COLOURS[k % len(_COLOURS)]
            hatch = None if k < len(_COLOURS) else "///"
            base = np.where(row >= 0, above, below)
            axis.bar(
                places, row, 0.62, bottom=base, color=colour, label=name, hatch=hatch, edgecolor="white", linewidth=0.4
            )
            above, below = above + np.maximum(row, 0), below + np.minimum(row, 0)
        axis.plot(places, why.torque, "_", color=INK, markersize=30, markeredgewidth=1.6, label="together")
        axis.axhline(0, color=QUIET, linewidth=0.7)
        axis.set_xticks(places, [j.replace("_", "\n", 1) for j in why.joints], fontsize=SMALL)
        axis.set_ylabel("torque [N m]" if set(why.units) == {"N m"} else "torque [N m], force [N]")
        axis.grid(visible=False, axis="x")
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
        return save(drawn, path)
