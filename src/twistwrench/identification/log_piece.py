"""A piece of work on a long log: its rows in chunks, and what they add up to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .joint_moments import JointMoments
from .log_chunks import chunks
from .log_source import PIECE, LogClock, LogSource
from .streamed_rows import RowFrame, rows_of
from .zero_phase import STATE_RATE

CORE, LEAST_CORE = 8192, 1 << 15
"""States, and rows, that a chunk has besides its margins."""
_MOST_CORE = 1 << 18
"""Rows of a chunk at most, unless margins ask for more."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of work: some rows of a log, in so many blocks of time."""

    frame: RowFrame
    source: LogSource
    clock: LogClock
    begin: int
    end: int | None
    blocks: int

    def moments(self) -> tuple[JointMoments, list[str]]:
        """Sums over its rows, read with what filters reach on both sides, and what these contradict themselves by."""
        frame, clock = self.frame, self.clock
        rate, said = clock.rate, list[str]()
        margin = frame.margin(rate)
        every = max(1, int(rate / (STATE_RATE * frame.settings.cutoff)))
        core = max(LEAST_CORE, min(CORE * every, _MOST_CORE), 2 * margin)
        span = (-np.inf, np.inf)
        if self.end is not None:
            span = (
                float(clock.marks[self.begin // PIECE]) if self.begin else -np.inf,
                float(clock.marks[self.end // PIECE]) if self.end < clock.rows else np.inf,
            )
            portions = self.source.portions(self.begin - 2 * margin, self.end + 2 * margin, said)
        else:
            portions = self.source.portions(said=said)
        first = float(clock.marks[self.begin // PIECE])
        last = span[1] if np.isfinite(span[1]) else float(clock.ends[-1])
        edges = np.linspace(first, last, self.blocks + 1)[1:-1]
        found = JointMoments.none(frame, self.blocks)
        for chunk in chunks(portions, clock, frame.base.unknown.model, core, margin, span):
            for rows in rows_of(frame, chunk):
                found = found.added(frame, rows, np.searchsorted(edges, rows.time, side="right"))
        return found, said
