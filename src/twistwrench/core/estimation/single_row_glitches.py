"""Glitches: single rows of a log in which a joint leaves its path, as no motion does at any noise level.

For positions q_i at times t_i, e_i is the deviation of q_i from the line between its neighbours. A glitch of size d in row i
gives e_i = d and, for even steps of time, e_(i-1) = e_(i+1) = -d/2. See also :mod:`.sampling`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .sampling import GAP

_MIN_RATIO_TO_LOG = 5.0
"""Minimum ratio of a glitch to the largest e in the rest of the log."""
_MAX_DEVIATION_FROM_HALF = 0.25
"""Largest deviation of the neighbours' e from -d/2, as a share of d: the path continues beside the glitch."""
_MIN_SIZE = 1e-6
"""Size [rad, m] below which a glitch is rounding."""
_MAX_ENCODER_COUNT = 1e-2
"""Size [rad, m] above which a glitch is not a flickering encoder count."""
_MAX_FLICKER_STEPS = 3.0
"""Size, in smallest steps of the log, above which a glitch is not a flickering encoder count."""
_MAX_CANDIDATES = 50
"""Largest number of candidates of a joint; with more, the whole log is rough."""
OVERLAP = 6
"""Number of rows shared by consecutive portions: each row is tested once, with two e on either side."""
_MAX_REMAINDER = 0.25
"""Largest remainder of d after subtracting a delay, relative to the row's largest d, for a wrong stamp."""
_MAX_DIFFERENCE_OF_DELAYS = 0.5
"""Largest difference of the delay that the other joints show from that of all joints, relative to it, for a wrong stamp."""
_MIN_MOVING_SPEED = 0.05
"""Smallest speed of a moving joint, relative to the fastest joint."""


@dataclass(frozen=True)
class Glitch:
    """Wrong row of one joint."""

    size: float
    """|d| [rad, m]."""
    time: float
    """Stamp of the row [s]."""
    late: float
    """Delay of the stamp [s], if every joint leaves its path in proportion to its speed; else 0."""


class SingleRowGlitches:
    """Running search for wrong rows, over portions that overlap by :data:`OVERLAP` rows."""

    def __init__(self, count: int, turns: Array) -> None:
        """Create for ``count`` joints; where ``turns`` (k,) is True, a joint may step by a full turn."""
        self.turns = turns
        self._usual_time_step = 0.0
        """Median of the first portion [s]."""
        self._largest_e = np.zeros(count)
        """Largest |e| of each joint outside candidates [rad, m]."""
        self._smallest_step = np.full(count, np.inf)
        """Smallest change above zero of each joint's position between rows [rad, m]."""
        self._candidates: list[list[Glitch]] = [[] for _ in range(count)]
        """Candidates of each joint."""

    def add(self, t: Array, q: Array) -> None:
        """Add consecutive rows, (n,) and (n, k), starting with the last rows of the previous portion."""
        if len(t) <= OVERLAP:
            return
        curves = q.copy()
        curves[:, self.turns] = np.unwrap(q[:, self.turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        steps_above_zero = np.where(steps > 0, steps, np.inf)
        self._smallest_step = np.minimum(self._smallest_step, steps_above_zero.min(axis=0))
        time_steps = np.diff(t)
        if self._usual_time_step == 0.0:
            self._usual_time_step = float(np.median(time_steps))
        is_pause = time_steps > GAP * self._usual_time_step
        beside_pause = (is_pause[1:] | is_pause[:-1])[:, None]  # the path across a pause is unknown
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        e = np.where(beside_pause, 0.0, e)  # e[i] belongs to row i + 1
        d = e[1:-1]  # d[i] belongs to row i + 2
        deviation_from_half = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        is_candidate = (np.abs(d) > _MIN_SIZE) & (deviation_from_half < _MAX_DEVIATION_FROM_HALF * np.abs(d))
        # Arrays from here on begin at row 3, whose two e on either side are known.
        near_candidate = is_candidate[:-2] | is_candidate[1:-1] | is_candidate[2:]
        e_elsewhere = np.where(near_candidate, 0.0, np.abs(e[2:-2]))
        self._largest_e = np.maximum(self._largest_e, e_elsewhere.max(axis=0))
        for k in np.flatnonzero(is_candidate[1:-1].any(axis=0)).tolist():
            candidates = np.flatnonzero(is_candidate[1:-1, k])
            largest_first = np.argsort(-np.abs(e[candidates + 2, k]), kind="stable")
            for i in candidates[largest_first[:_MAX_CANDIDATES]].tolist():
                row = i + 3
                d_of_row = e[row - 1]  # of all joints
                speeds = (curves[row + 1] - curves[row - 1]) / (t[row + 1] - t[row - 1])
                glitch = Glitch(abs(float(d_of_row[k])), float(t[row]), _stamp_delay(d_of_row, speeds))
                self._candidates[k].append(glitch)
            self._candidates[k].sort(key=lambda glitch: -glitch.size)
            del self._candidates[k][_MAX_CANDIDATES:]

    def result(self) -> list[tuple[int, list[Glitch]]]:
        """Pairs of a joint's index and its wrong rows, the largest first, for each joint that has some."""
        glitches = []
        for k, candidates in enumerate(self._candidates):
            max_flicker = min(_MAX_FLICKER_STEPS * float(self._smallest_step[k]), _MAX_ENCODER_COUNT)
            min_size = max(_MIN_RATIO_TO_LOG * float(self._largest_e[k]), max_flicker)
            joint_glitches = [glitch for glitch in candidates if glitch.size > min_size]
            if joint_glitches and len(joint_glitches) < _MAX_CANDIDATES:
                glitches.append((k, joint_glitches))
        return glitches

    def _all_glitches(self) -> list[Glitch]:
        """Wrong rows of all joints; a row may occur several times."""
        return [glitch for _, joint_glitches in self.result() for glitch in joint_glitches]

    def times(self) -> Array:
        """Times of all wrong rows, whether position or stamp is wrong."""
        return np.array(sorted({glitch.time for glitch in self._all_glitches()}))

    def stamps(self) -> dict[float, float]:
        """Delay [s] by time of the rows with a wrong stamp."""
        return {glitch.time: glitch.late for glitch in self._all_glitches() if glitch.late}


def _stamp_delay(d: Array, speeds: Array) -> float:
    """Delay of a row's stamp [s] if the joints leave their paths by d (k,) in proportion to their speeds (k,); else 0.

    It is the least-squares solution of d = -delay * speeds. The joint with the largest d agrees with any delay, so the others
    must show the same one.
    """
    is_moving = np.abs(speeds) > _MIN_MOVING_SPEED * np.abs(speeds).max(initial=0.0)
    is_other = is_moving.copy()
    is_other[np.abs(d).argmax()] = False
    if not is_other.any():
        return 0.0
    delay = _least_squares_delay(d, speeds)
    delay_of_others = _least_squares_delay(d[is_other], speeds[is_other])
    if abs(delay_of_others - delay) > _MAX_DIFFERENCE_OF_DELAYS * abs(delay):
        return 0.0
    if np.abs(d + delay * speeds).max() < _MAX_REMAINDER * np.abs(d).max():
        return delay
    return 0.0


def _least_squares_delay(d: Array, speeds: Array) -> float:
    """Delay [s] that minimises the sum of squares of d + delay * speeds."""
    return -float(d @ speeds) / float(speeds @ speeds)
