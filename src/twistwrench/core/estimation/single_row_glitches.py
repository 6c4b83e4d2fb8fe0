"""Single rows of a log in which one joint leaves its path: not a motion, at any noise level. See :mod:`.sampling`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .sampling import GAP

_MIN_RATIO_TO_LOG = 5.0
"""Minimum ratio to the largest e in the rest of the log."""
_MAX_DEVIATION_FROM_HALF = 0.25
"""Largest deviation of the neighbours' e from -d/2, as a share of d: the path continues beside the glitch."""
_MIN_SIZE, _MAX_COUNT = 1e-6, 1e-2
"""Sizes [rad, m] below which a glitch is rounding, and above which it is not a flickering encoder count."""
_MIN_COUNTS = 3.0
"""Minimum size in least steps of the log, above which it is not a flickering count."""
_MAX_CANDIDATES = 50
"""Largest number of candidates of a joint; with more, the whole log is rough."""
OVERLAP = 6
"""Rows shared by consecutive portions, so that each row is tested once, with two e on either side."""
_MAX_REMAINDER = 0.25
"""Largest remainder of d, relative to a row's largest d, for a wrong stamp."""
_MIN_MOVING_SPEED = 0.05
"""Smallest relative speed of a moving joint; a single moving joint cannot separate stamp and position errors."""


@dataclass(frozen=True)
class Glitch:
    """Wrong row of one joint."""

    size: float
    """|d| [rad, m]."""
    time: float
    late: float
    """Delay of the stamp [s], if every joint leaves its path in proportion to its speed; else 0."""


class SingleRowGlitches:
    """Running search for wrong rows, over portions that overlap by :data:`OVERLAP` rows."""

    def __init__(self, count: int, turns: Array) -> None:
        """Create for ``count`` joints; joints in the mask ``turns`` (k,) may step by a full turn."""
        self.turns = turns
        self._usual = 0.0
        self._largest, self._least_step = np.zeros(count), np.full(count, np.inf)
        self._candidates: list[list[Glitch]] = [[] for _ in range(count)]
        """Candidates of each joint."""

    def add(self, t: Array, q: Array) -> None:
        """Add consecutive rows, (n,) and (n, k), starting with the last rows of the previous portion."""
        if len(t) <= OVERLAP:
            return
        curves = q.copy()
        curves[:, self.turns] = np.unwrap(q[:, self.turns], axis=0)
        steps = np.abs(np.diff(curves, axis=0))
        self._least_step = np.minimum(self._least_step, np.where(steps > 0, steps, np.inf).min(axis=0))
        steps_of_time = np.diff(t)
        self._usual = self._usual or float(np.median(steps_of_time))
        pause = steps_of_time > GAP * self._usual
        bridged = (pause[1:] | pause[:-1])[:, None]  # the path across a pause is unknown
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        e = curves[1:-1] - curves[:-2] - share * (curves[2:] - curves[:-2])
        e = np.where(bridged, 0.0, e)
        d = e[1:-1]
        beside = np.maximum(np.abs(e[:-2] + d / 2), np.abs(e[2:] + d / 2))
        candidate = (np.abs(d) > _MIN_SIZE) & (beside < _MAX_DEVIATION_FROM_HALF * np.abs(d))
        touched = candidate[:-2] | candidate[1:-1] | candidate[2:]
        self._largest = np.maximum(self._largest, np.where(touched, 0.0, np.abs(e[2:-2])).max(axis=0))
        for k in np.flatnonzero(candidate[1:-1].any(axis=0)).tolist():
            rows = np.flatnonzero(candidate[1:-1, k])
            largest = rows[np.argsort(-np.abs(e[rows + 2, k]), kind="stable")[:_MAX_CANDIDATES]]
            for row in largest.tolist():
                slope = (curves[row + 4] - curves[row + 2]) / (t[row + 4] - t[row + 2])
                delay = _stamp_delay(e[row + 2], slope)
                self._candidates[k].append(Glitch(abs(float(e[row + 2, k])), float(t[row + 3]), delay))
            self._candidates[k] = sorted(self._candidates[k], key=lambda glitch: -glitch.size)[:_MAX_CANDIDATES]

    def result(self) -> list[tuple[int, list[Glitch]]]:
        """Joints with wrong rows and these rows, largest first."""
        glitches = []
        for k, candidates in enumerate(self._candidates):
            min_counts = min(_MIN_COUNTS * float(self._least_step[k]), _MAX_COUNT)
            bound = max(_MIN_RATIO_TO_LOG * float(self._largest[k]), min_counts)
            of_joint = [glitch for glitch in candidates if glitch.size > bound]
            if of_joint and len(of_joint) < _MAX_CANDIDATES:
                glitches.append((k, of_joint))
        return glitches

    def _all(self) -> list[Glitch]:
        return [glitch for _, of_joint in self.result() for glitch in of_joint]

    def times(self) -> Array:
        """Times of all wrong rows, whether position or stamp is wrong."""
        return np.array(sorted({glitch.time for glitch in self._all()}))

    def stamps(self) -> dict[float, float]:
        """Delay [s] by time of the rows with a wrong stamp."""
        return {glitch.time: glitch.late for glitch in self._all() if glitch.late}


def _stamp_delay(d: Array, speed: Array) -> float:
    """Delay of a row's stamp [s] if joints with speeds (k,) leave their paths by d (k,) in proportion; else 0."""
    if (np.abs(speed) > _MIN_MOVING_SPEED * np.abs(speed).max(initial=0.0)).sum() < 2:
        return 0.0
    shift = float(d @ speed) / float(speed @ speed)
    if np.abs(d - shift * speed).max() < _MAX_REMAINDER * np.abs(d).max():
        return -shift
    return 0.0
