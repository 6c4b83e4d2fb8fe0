"""The explanation of a torque as a picture: a bar per joint, stacked by cause."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..joints.units import torque_word
from ..robot.explanation import MOTION_TERMS
from .style import (
    AXIS,
    BLUE,
    GREEN,
    GREY,
    INK,
    LINE,
    ORANGE,
    PURPLE,
    QUIET,
    SKY,
    SMALL,
    VERMILION,
    YELLOW,
    figure,
    save,
)

if TYPE_CHECKING:
    from ..robot.explanation import Explanation

_BODIES = (BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, LINE)
_APART = {"friction": GREY, "springs": YELLOW}
"""What is no body's; wrenches are the rest of that."""
_MOST = 8
"""Causes drawn by themselves; the smallest of more are drawn as one."""


def styles(bodies: Sequence[str], apart: Sequence[str]) -> dict[str, dict[str, Any]]:
    """A colour for each cause, and hatches where there are more causes than colours.

    Parameters
    ----------
    bodies : sequence of str, causes that are bodies; their colours are never those of another kind
    apart : sequence of str, the other causes

    Returns
    -------
    styles : {cause: options of Matplotlib's bars}

    Examples
    --------
    >>> sorted(styles(["upper", "lower"], ["friction"]))
    ['friction', 'lower', 'upper']
    """
    found: dict[str, dict[str, Any]] = {}
    for names, colours in ((bodies, _BODIES), ([name for name in apart if name not in _APART], (AXIS,))):
        for k, name in enumerate(names):
            hatch = (None, "///", "...", "xxx")[k // len(colours) % 4]
            found[name] = {"color": colours[k % len(colours)], "hatch": hatch, "edgecolor": "white"}
    return found | {name: {"color": _APART[name], "edgecolor": "white"} for name in apart if name in _APART}


def plot_explanation(why: Explanation, path: str | Path) -> Path:
    """Bar chart of an explanation of torques; see :meth:`Explanation.plot`.

    Parameters
    ----------
    why : Explanation, of one state
    path : str or Path; the suffix says the kind (.png, .pdf, .svg)

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    MissingExtraError
        There is no matplotlib.
    ValueRangeError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> why = tw.robots.planar_2r().explain([0, 0], [0, 1], [0, 0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_explanation(why, f"{folder}/why.svg").name
    'why.svg'
    """
    parts, names = why.by_cause, list(why.causes)
    bodies = len(names) - (len(why.terms) - len(MOTION_TERMS))  # what is no body's is a term of its own, and last
    order = np.argsort(-np.abs(parts).max(axis=1), kind="stable")
    shown = sorted(order[:_MOST].tolist())
    rest = [c for c in order[_MOST:].tolist() if parts[c].any()]
    shown = [c for c in shown if parts[c].any()]
    style = styles([names[c] for c in shown if c < bodies], [names[c] for c in shown if c >= bodies])
    rows = [(names[c], parts[c], style[names[c]]) for c in shown]
    if rest:
        others = {"color": "white", "hatch": "////", "edgecolor": GREY}
        rows.append((f"{len(rest)} others", parts[rest].sum(axis=0), others))
    places = np.arange(len(why.joints))
    with figure(
        max(6.0, 1.1 * len(places) + 3.2), 4.2, "What each torque is made of", "Drawing an explanation"
    ) as drawn:
        axis = drawn.subplots()
        above, below = np.zeros(len(places)), np.zeros(len(places))
        for name, row, look in rows:
            base = np.where(row >= 0, above, below)
            axis.bar(places, row, 0.62, bottom=base, label=name, linewidth=0.4, **look)
            above, below = above + np.maximum(row, 0), below + np.minimum(row, 0)
        axis.plot(places, why.torque, "_", color=INK, markersize=30, markeredgewidth=1.6, label="together")
        axis.axhline(0, color=QUIET, linewidth=0.7)
        axis.set_xticks(places, [j.replace("_", "\n", 1) for j in why.joints], fontsize=SMALL)
        axis.set_ylabel(", ".join(map(torque_word, sorted(set(why.units), reverse=True))))
        axis.grid(visible=False, axis="x")
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
        return save(drawn, path)
