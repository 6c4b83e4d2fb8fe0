"""The two passes that find the fastest x(s) = ds².

Backward, the largest x from which the path can still end at rest; forward, the largest x that stays below it. Both follow one
limit after another in pieces (:mod:`.collocation`), so structure is found and never guessed. Backward, where the curve runs
into the limit curve, it is that curve until the least acceleration leads below it: there it leaves. These are the switching
points of MR section 9.4, tangent, at corners, or at zero inertia. Source: the passes are those of Pham & Pham, "A new
approach to time-optimal path parameterization based on reachability analysis", IEEE T-RO 34(3), 2018, without its grid.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import printed
from ..errors import PathError
from ..typing import Array
from .collocation import Cell, try_cell
from .limit_rows import PathRows

_SMALLEST = 1e-9
"""Pieces this short [of s] do not get ahead."""
_MOST = 20_000
"""Pieces of one pass."""
_FEW = 20
"""Pieces of such a step."""
_BESIDE = 1e-5
"""How near to breaks, on both sides, the limit curve is looked at for leaving it."""
_STEP = 1e-7
"""The step [of s] over which slopes of the limit curve are compared with accelerations."""
_SCAN = 1e-3
"""The step [of s] by which leaving the limit curve is tried: passing it by more than what is allowed shows by then."""


@dataclass(frozen=True, eq=False)
class Arc:
    """Pieces of largest deceleration that lead to an anchor: the end, or a point of the limit curve. Ascending in s."""

    cells: tuple[Cell, ...]

    @property
    def low(self) -> float:
        """Where it begins."""
        return self.cells[0].low

    @property
    def high(self) -> float:
        """Where it ends."""
        return self.cells[-1].high

    def at(self, s: Array) -> Array:
        """x at s within the arc."""
        edges = np.array([c.low for c in self.cells[1:]])
        k = np.searchsorted(edges, s, side="right")
        out = np.zeros(len(s))
        for i in np.unique(k):
            out[k == i] = self.cells[i].at(s[k == i])
        return out


class _Stuck(Exception):
    """No piece of any size leads on."""


def _advance(
    rows: PathRows, s: float, x: float, way: int, target: float, *, caps: bool, below: Arc | None, hint: float = 1.0
) -> Cell:
    """The longest piece from (s, x) towards ``target``; ends exactly where the touched limit changes."""

    def tried(h: float) -> tuple[Cell | None, bool]:
        cell, rough = try_cell(rows, s, x, h, way, along_caps=caps)
        if cell is not None and below is not None:
            places = np.linspace(cell.low, cell.high, 9)[1:]
            if (cell.at(places) > below.at(places) * (1 + 1e-10)).any():
                return None, False
        return cell, rough

    h = min(abs(target - s), hint)
    found, rough = tried(h)
    if found is not None:
        return found
    while found is None:
        over, was_rough = h, rough
        h *= 0.5
        if h < _SMALLEST and (h < 1e-5 * _SMALLEST or not rough):
            raise _Stuck
        found, rough = tried(h)
    if was_rough:
        return found
    while over - h > 1e-11 * over and over - h > 1e-15:  # to the very place where the limit changes
        middle = 0.5 * (h + over)
        cell, rough = tried(middle)
        if cell is None:
            over = middle
            if rough:
                break
        else:
            found, h = cell, middle
    return found


def backward(rows: PathRows, count: int = 2001) -> list[Arc]:
    """The arcs of the viability curve, ascending in s; between them it is the limit curve, looked at in ``count`` places."""
    arcs: list[Arc] = []
    breaks = rows.breaks
    s, x = 1.0, 0.0
    beside = np.concatenate([breaks + side * _BESIDE for side in (-1, 1)])
    places = np.unique(np.concatenate([np.linspace(0.0, 1.0, count), beside]))
    places = places[(places > 0) & (places < 1)]
    places = places[np.abs(places[:, None] - breaks).min(axis=1) > 0.5 * _BESIDE]
    falls = places[_falls_away(rows, places)]
    while s > 0:
        cells: list[Cell] = []
        hint = 1.0
        try:
            while s > 0:
                target = float(breaks[np.searchsorted(breaks, s, side="left") - 1])
                cell = _advance(rows, s, x, -1, target, caps=False, below=None, hint=hint)
                hint = max(4.0 * (cell.high - cell.low), _SMALLEST)
                cells.append(cell)
                s, x = cell.low, float(cell.x[0])
                if len(cells) > _MOST:
                    raise _lost(s)
        except _Stuck:
            pass
        if cells:
            arcs.append(Arc(tuple(reversed(cells))))
        if s > 0:
            s = _leaving(rows, s, places, falls)
            x = float(rows.cap(np.array([s])).x[0])
    return arcs[::-1]


def _falls_away(rows: PathRows, s: Array) -> Array:
    """Whether, just before s (m,), the limit curve is steeper than the least acceleration there; not at breaks."""
    early = rows.at(s - _STEP)
    x = np.stack([rows.cap_of(rows.at(s)).x, rows.cap_of(early).x])
    low = rows.accelerations(early, np.where(np.isfinite(x[1]), x[1], 0.0))[0]
    with np.errstate(invalid="ignore"):
        return np.isfinite(x).all(axis=0) & (2.0 * low * _STEP > (x[0] - x[1]))


def _leaves(rows: PathRows, s: float) -> bool:
    """Whether the least acceleration leads, backward, from the limit curve at s to below it, for a step that shows it."""
    x = float(rows.cap(np.array([s])).x[0])
    if not np.isfinite(x):
        return False
    goal = max(s - _SCAN, 0.0)
    for _ in range(_FEW):
        previous = float(rows.breaks[np.searchsorted(rows.breaks, s, side="left") - 1])
        try:
            cell = _advance(rows, s, x, -1, max(goal, previous), caps=False, below=None)
        except _Stuck:
            return False
        s, x = cell.low, float(cell.x[0])
        if s <= goal:
            return True
    return False


def _leaving(rows: PathRows, s: float, places: Array, falls: Array) -> float:
    """The first place below s at which the curve leaves the limit curve; 0 if it never does."""
    edges = np.concatenate([places, rows.breaks, [s]])
    chosen = np.unique(np.concatenate([falls, rows.breaks]))
    for place in chosen[(chosen < s - _SMALLEST) & (chosen > 0)][::-1]:
        if place in rows.breaks:
            if _leaves(rows, float(place)):
                return float(place)
            continue
        goes, stays = float(place), float(edges[edges > place].min())
        for _ in range(40):
            middle = 0.5 * (stays + goes)
            if stays - goes < 1e-13:
                break
            stays, goes = (stays, middle) if _falls_away(rows, np.array([middle]))[0] else (middle, goes)
        return goes
    return 0.0


def forward(rows: PathRows, arcs: list[Arc]) -> list[Cell]:
    """The pieces of the fastest timing, ascending in s."""
    ends = np.unique(np.concatenate([rows.breaks, *([arc.low, arc.high] for arc in arcs)]))
    cells: list[Cell] = []
    s, x, hint = 0.0, 0.0, 1.0
    for _ in itertools.count():
        if s >= 1.0:
            return cells
        if len(cells) > _MOST:
            raise _lost(s)
        arc = next((a for a in arcs if a.low <= s < a.high), None)
        if arc is not None and x >= float(arc.at(np.array([s]))[0]) * (1 - 1e-8) and s > 0:
            followed = [c if c.low >= s else c.since(s) for c in arc.cells if c.high > s + 1e-15]
            cells += followed
            s, x = arc.high, float(followed[-1].x.sum())
            continue
        target = float(ends[np.searchsorted(ends, s, side="right")])
        try:
            cell = _advance(rows, s, x, 1, target, caps=True, below=arc, hint=hint)
        except _Stuck:
            raise _lost(s) from None
        cells.append(cell)
        hint = max(4.0 * (cell.high - cell.low), _SMALLEST)
        s, x = cell.high, float(cell.x.sum())
    raise AssertionError


def _lost(s: float) -> PathError:
    return PathError(
        f"no fastest timing was found beyond s = {printed(s)}: limits change there in a way the search cannot follow. A "
        "path with fewer corners, or limits less far apart from joint to joint, may help; a trapezoidal scaling always exists.",
        reached=s,
    )
