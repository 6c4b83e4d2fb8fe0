"""Portions of a log as chunks on a steady clock that overlap by what filters reach: each row is owned by one chunk."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ..model.model import Model
from ..motion.motion_log import LogRows
from ..motion.spline import continuous
from ..typing import Array
from .log_source import LogClock
from .zero_phase import FEWEST

_STEADY = 1e-3
"""Share of the step that stamps may be off without being moved to the steady clock."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """Samples first, first + 1, … of one stretch of a log, and which of them are this chunk's own.

    Attributes
    ----------
    stretch : int
    count : int, samples of the whole stretch
    begin : float, time of the stretch's first sample [s]
    step : float [s]
    first : int, number of the first sample here
    q, tau : (n, nv) arrays
    own : (a, b), numbers of the stretch's samples, from the first to the one after the last
    cut : bool, whether there are other stretches
    """

    stretch: int
    count: int
    begin: float
    step: float
    first: int
    q: Array
    tau: Array
    own: tuple[int, int]
    cut: bool = False


def overlapping(
    portions: Iterable[LogRows], core: int, margin: int
) -> Iterator[tuple[Array, Array, Array, float, float]]:
    """Times, q and τ of about ``core`` rows with up to ``margin`` more on each side, and the times from and until that count.

    Times at the ends of the log are infinite: its first and last chunk own all that is before and after.
    """
    kept: list[tuple[Array, Array, Array]] = []
    rows, begun = 0, 0
    since = -math.inf
    for portion in portions:
        kept.append((portion.time, portion.q, np.asarray(portion.tau)))  # sources refuse logs without torques
        rows += len(portion.time)
        while rows >= begun + core + margin + 1:
            time, q, tau = _joined(kept)
            end = begun + core
            until = float(time[end])
            cut = end + margin
            yield time[:cut], q[:cut], tau[:cut], since, until
            drop = max(0, end - margin)
            kept = [(time[drop:], q[drop:], tau[drop:])]
            rows, begun, since = len(time) - drop, end - drop, until
    if kept:
        yield *_joined(kept), since, math.inf


def _joined(kept: list[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    if len(kept) == 1:
        return kept[0]
    time, q, tau = zip(*kept, strict=True)
    return np.concatenate(time), np.concatenate(q), np.concatenate(tau)


def chunks(
    portions: Iterable[LogRows], clock: LogClock, model: Model, core: int, margin: int, span: tuple[float, float]
) -> Iterator[Chunk]:
    """Chunks of the rows whose times are in a span [s]; the steady clock of each stretch begins at its first stamp."""
    for time, q, tau, since, until in overlapping(portions, core, margin):
        since, until = max(since, span[0]), min(until, span[1])
        if not since < until:
            continue
        for s, (begin, end) in enumerate(zip(clock.begins.tolist(), clock.ends.tolist(), strict=True)):
            if end < time[0] or begin > time[-1] or end < since or begin >= until:
                continue
            rows = slice(int(np.searchsorted(time, begin)), int(np.searchsorted(time, end, side="right")))
            count = round((end - begin) / clock.step) + 1
            if count < FEWEST or rows.stop - rows.start < 2:
                continue
            steady = _steady(time[rows], continuous(model, q[rows]), tau[rows], begin, clock.step, count)
            if steady is None:
                continue
            first, positions, torques = steady
            own = _number(since, begin, clock.step, count), _number(until, begin, clock.step, count)
            yield Chunk(s, count, begin, clock.step, first, positions, torques, own, len(clock.begins) > 1)


def _number(time: float, begin: float, step: float, count: int) -> int:
    """Number of the first sample at that time or later."""
    if math.isinf(time):
        return 0 if time < 0 else count
    return min(max(math.ceil((time - begin) / step - 0.5), 0), count)


def _steady(
    time: Array, q: Array, tau: Array, begin: float, step: float, count: int
) -> tuple[int, Array, Array] | None:
    """Number of the first sample, and positions and torques at the samples that lie between the rows."""
    first = max(0, math.ceil((time[0] - begin) / step - _STEADY))
    last = min(count - 1, math.floor((time[-1] - begin) / step + _STEADY))
    if last - first + 1 < 2:
        return None
    at = begin + step * np.arange(first, last + 1)
    if len(time) == len(at) and np.abs(time - at).max() <= _STEADY * step:
        return first, q, tau
    from scipy.interpolate import CubicSpline

    local = time - time[0]
    inside = np.clip(at - time[0], 0.0, local[-1])
    return first, CubicSpline(local, q)(inside), np.stack([np.interp(inside, local, x) for x in tau.T], axis=1)
