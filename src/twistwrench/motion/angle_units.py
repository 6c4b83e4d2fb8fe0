"""Whether the angles of a motion are in the unit that they are read in, told by how far the joints can turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import printed
from ..typing import Array

_FAR, _MANY_TURNS = 3.0, 4 * math.pi
"""Times the reach of a joint's limits, or a full turn, and an angle [rad], that no joint with limits turns to."""
_WITHIN = 1.1
"""Times its reach that a joint in the right unit may turn to."""
_FULL_TURN, _SOME_MOVE = math.tau, 0.3
"""Number that no angle in radians of a joint with limits is above, and one that a joint which moves for certain passes."""
_FEWEST = 3
"""Joints that do not all stay within six degrees of zero for the whole of a motion."""
_DEGREE = math.radians(1.0)


@dataclass(frozen=True, eq=False)
class AngleUnits:
    """The turning joints of a log, (k,) each: what is read of them [rad], and how."""

    names: Sequence[str]
    least: Array
    most: Array
    endless: Array
    """bool: the joint has no limits, so that it may turn as far as it likes."""
    lower: Array
    upper: Array
    """Limits; infinite where they are not known."""
    factor: Array
    """What took the file's numbers to radians."""
    stated: Array
    """bool: the file says that unit."""

    @property
    def contradictions(self) -> tuple[str, ...]:
        """A sentence where the unit is wrong for near certain."""
        far, bounded = self._far
        wound = far & (self._size > _MANY_TURNS)
        if far.any() and 2 * far.sum() >= bounded.sum() and 2 * wound.sum() > far.sum():
            return (self._too_far(far),)
        return (self._too_small(),) if self._tiny.sum() >= _FEWEST else ()

    @property
    def hints(self) -> tuple[str, ...]:
        """A sentence where the unit is in doubt, and no more."""
        if self.contradictions:
            return ()
        far, _ = self._far
        beyond = self._size > _MANY_TURNS
        if 2 * beyond.sum() > len(self.names) and not self.stated.any() and (self.factor == 1.0).all():
            return (self._too_far(beyond),)
        if far.any():
            return (self._too_far(far),)
        return (self._too_small(),) if self._tiny.any() else ()

    @property
    def _size(self) -> Array:
        return np.maximum(np.abs(self.least), np.abs(self.most))

    @property
    def _reach(self) -> Array:
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    @property
    def _far(self) -> tuple[Array, Array]:
        """(k,) bool: joints far beyond their limits, and all that could be, read in radians for want of a unit."""
        bounded = ~self.endless & np.isfinite(self._reach) & (self._reach > 0) & (self.factor == 1.0) & ~self.stated
        reach = np.maximum(np.where(bounded, self._reach, 1.0), _FULL_TURN / _FAR)
        return bounded & (self._size > _FAR * reach), bounded

    @property
    def _tiny(self) -> Array:
        """(k,) bool, of all or none: joints read in degrees whose numbers are all such as radians are."""
        asked = (self.factor == _DEGREE) & ~self.stated
        written = self._size / self.factor
        moves = (self.most - self.least) / self.factor > _SOME_MOVE
        alike = bool(asked.any() and (written[asked] <= _FULL_TURN).all() and moves[asked].any())
        return asked & alike

    def _too_far(self, far: Array) -> str:
        reach = np.where(np.isfinite(self._reach), self._reach, 1.0)
        k = int(np.flatnonzero(far)[(self._size / reach)[far].argmax()])
        limit = (
            f", and its limits are at {printed(self.lower[k], 3)} and {printed(self.upper[k], 3)}"
            if np.isfinite(self._reach[k])
            else ""
        )
        degrees = bool((self._size[far] * _DEGREE <= _WITHIN * self._reach[far]).all())
        others = int(far.sum()) - 1
        more = f", and {others} more joint{'s are' if others > 1 else ' is'} as far out" if others else ""
        asked = "Did you mean --degrees? Or are" if degrees else "Are"
        counts = "" if degrees else ", or counts of an encoder"
        return (
            f"{self.names[k]} goes to {printed(self._size[k], 4)} rad{limit}{more}: the angles seem to be in another unit. "
            f"{asked} they those of the motors, before their gears{counts}? Positions are those of the joints, in radians, "
            "or in the unit that a column names, as 'JOINT [deg]'"
        )

    def _too_small(self) -> str:
        largest = float((self._size / self.factor)[self._tiny].max())
        return (
            f"read in degrees, no angle is beyond {printed(largest, 3)} degrees: the file seems to be in radians. Leave "
            "--degrees out, or name the unit of its columns, as 'JOINT [deg]'"
        )
