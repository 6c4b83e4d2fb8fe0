"""Rows at which one joint leaves its path and is back in the next row: no motion does that, whatever the noise.

e_i is how far q_i is from the straight line between its neighbours. A corner of a path is one large e; a single wrong row of
size d is e = (-d/2, d, -d/2), beyond all that the rest of the log has. A stamp that is wrong by s makes d = -s dq/dt in every
joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import printed, seconds
from ..listing import listed
from ..typing import Array

_BEYOND = 5.0
"""Times the largest e of the rest of the log, from which the wrong row explains itself."""
_ALIKE = 0.25
"""How far the neighbours' e may be from -d/2, as a share of d: the path goes on beside the glitch."""
_ROUNDING, _NO_COUNT = 1e-6, 1e-2
"""rad or m: what is smaller is not told from rounded numbers, and what is larger is no count of an encoder that flickers."""
_COUNTS = 3.0
"""Times the least step of the log, from which it is no such count either."""
_MOST = 50
"""Candidates that are kept for a joint; with more the log is rough, and not one row wrong."""
_LISTED = 3
SINGLE_ROW = "for a single row"
LEFT_OUT = "Left out: "
"""What a sentence on a wrong row has in it, and what a note on one begins with that is left out."""
_GAP = 5.0
"""Usual steps of time from which a step is a pause."""
_OF_CLOCK = 0.25
"""Share of the largest d of a row that is left where the stamp is wrong."""
_MOVING = 0.05
"""Share of the fastest joint's speed from which a joint moves: one alone cannot tell its stamp from its position."""


@dataclass(frozen=True)
class Glitch:
    """A wrong row of one joint."""

    size: float
    """|d| [rad, m]."""
    time: float
    late: float
    """What its stamp is off by [s], if every joint leaves its path in proportion to its speed; else 0."""


class SingleRowGlitches:
    """A tally over the rows of a motion, which come in any portions."""

    def __init__(self, count: int, turns: Array) -> None:
        """``count`` joints, of which those that turn (k,) bool may step by a full turn."""
        self._turns = turns
        self._tail: tuple[Array, Array] = np.empty(0), np.empty((0, count))
        self._usual = 0.0
        self._largest, self._least_step = np.zeros(count), np.full(count, np.inf)
        self._found: list[list[Glitch]] = [[] for _ in range(count)]
        """Of each joint the candidates."""

    def add(self, time: Array, q: Array) -> None:
        """Take in consecutive rows, (n,) and (n, k)."""
        t, q = np.r_[self._tail[0], time], np.concatenate([self._tail[1], q])
        self._tail = t[-6:], q[-6:]  # so that each row is looked at once, with two e on either side
        if len(t) < 7:
            return
        curves = q.copy()
        curves[:, self._turns] = np.unwrap(q[:, self._turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        self._least_step = np.minimum(self._least_step, np.where(steps > 0, steps, np.inf).min(axis=0))
        steps_of_time = np.diff(t)
        self._usual = self._usual or float(np.median(steps_of_time))
        pause = steps_of_time > _GAP * self._usual
        bridged = (pause[1:] | pause[:-1])[:, None]  # over a pause, the path says nothing
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        e = np.where(bridged, 0.0, e)
        d = e[1:-1]
        beside = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        candidate = (np.abs(d) > _ROUNDING) & (beside < _ALIKE * np.abs(d))
        touched = candidate[:-2] | candidate[1:-1] | candidate[2:]
        self._largest = np.maximum(self._largest, np.where(touched, 0.0, np.abs(e[2:-2])).max(axis=0))
        for row, k in np.argwhere(candidate[1:-1]).tolist():
            slope = (curves[row + 4] - curves[row + 2]) / (t[row + 4] - t[row + 2])
            found = Glitch(abs(float(e[row + 2, k])), float(t[row + 3]), _late(e[row + 2], slope))
            self._found[k] = sorted([*self._found[k], found], key=lambda g: -g.size)[:_MOST]

    def result(self) -> list[tuple[int, list[Glitch]]]:
        """Each joint that has such rows, with these, the largest first."""
        found = []
        for k, candidates in enumerate(self._found):
            bound = max(_BEYOND * float(self._largest[k]), min(_COUNTS * float(self._least_step[k]), _NO_COUNT))
            wrong = [g for g in candidates if g.size > bound]
            if wrong and len(wrong) < _MOST:
                found.append((k, wrong))
        return found

    def times(self) -> Array:
        """Times of all such rows, whatever is wrong in them."""
        return np.array(sorted({g.time for _, wrong in self.result() for g in wrong}))

    def stamps(self) -> dict[float, float]:
        """Times of the rows whose stamp is wrong, and by how much it is late [s]."""
        return {g.time: g.late for _, wrong in self.result() for g in wrong if g.late}

    def sentences(self, names: list[str], angular: Array) -> list[str]:
        """A sentence for each joint, but for rows whose stamp is wrong."""
        said = []
        for k, found in self.result():
            wrong = [g for g in found if not g.late]
            if not wrong:
                continue
            size = (
                f"{printed(math.degrees(wrong[0].size), 3)} degrees" if angular[k] else f"{printed(wrong[0].size, 3)} m"
            )
            when = listed((f"{seconds(g.time, 4)} s" for g in wrong), _LISTED)
            said.append(f"{names[k]} leaves its path by {size} {SINGLE_ROW}, and is back in the next, at t = {when}")
        return said


def _late(d: Array, speed: Array) -> float:
    """What a row's stamp is late by [s], where joints of speeds (k,) leave their paths by d (k,); 0 where it is not that."""
    if (np.abs(speed) > _MOVING * np.abs(speed).max(initial=0.0)).sum() < 2:
        return 0.0
    found = float(d @ speed) / float(speed @ speed)
    return -found if np.abs(d - found * speed).max() < _OF_CLOCK * np.abs(d).max() else 0.0


def stamp_words(stamps: dict[float, float]) -> str:
    """Rows with a wrong stamp, by their times with what they are late by [s]."""
    when = listed((f"{seconds(time, 4)} s" for time in stamps), _LISTED)
    late = max(stamps.values(), key=abs)
    way = "late" if late > 0 else "early"
    return (
        f"the time stamp of {len(stamps)} row{'s' if len(stamps) > 1 else ''} is {seconds(abs(late))} s {way}, at t = {when}, "
        "as every joint leaves its path there in proportion to its speed"
    )
