"""What inverse kinematics found: configurations, whether they are there, and why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import printed
from ..lie import se3
from ..typing import Array

_OPEN = 1e-9
"""rad or m: gaps wider than this are told with what is left of a pose."""


@dataclass(frozen=True)
class Searched:
    """What was looked for: all that results have in common."""

    joint_names: tuple[str, ...]
    frames: tuple[tuple[int, ...], ...]
    """The rows of each frame."""
    loops: int = 0
    """How many rows of loops were to be closed, too."""


@dataclass(eq=False, repr=False, slots=True)  # and not frozen, which takes as long as a step of the search
class InverseKinematics:
    """Result of inverse kinematics: configurations that reach poses, or come as near as was found.

    Leading axes are the poses'.
    """

    q: Array
    """(..., nq): the best configuration found, inside the limits; nan where the pose is."""

    _said: Array
    _asked: Searched

    @property
    def converged(self) -> Array:
        """(...) of bool: whether it is there to the tolerances, and nothing less counts."""
        return np.asarray(self._said[..., 1] > 0.0)

    @property
    def angle(self) -> Array:
        """(...) rad that are left; of a float32 ``q`` before it was rounded to that, as ``distance`` and ``converged``."""
        return self._length(turning=True)

    @property
    def distance(self) -> Array:
        """(...) m between the origins, those of the frame and of the pose, or along the rows asked for."""
        return self._length(turning=False)

    @property
    def gap(self) -> Array:
        """(...) rad or m, by how much the loops of a closed robot are open there at most; zero for an open one."""
        first = 3 + len(self.rows)
        return np.asarray(np.abs(self._said[..., first : first + self._asked.loops]).max(axis=-1, initial=0.0))

    @property
    def starts(self) -> Array:
        """(...) of int: how many starts it took."""
        return np.asarray(self._said[..., 0].astype(int))

    @property
    def held(self) -> Array:
        """(..., nv) of bool: joints whose limits keep this from coming nearer."""
        held: Array = self._said[..., self._said.shape[-1] - len(self.joint_names) :] > 0.5
        return held & ~self.converged[..., None]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """A name for each entry of ``held``."""
        return self._asked.joint_names

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows of the twist that were asked for, 0 to 5."""
        return tuple(row for rows in self._asked.frames for row in rows)

    def _length(self, *, turning: bool) -> Array:
        """Of the angles that are left, or of the ways between the origins."""
        total, at = np.zeros(self._said.shape[:-1]), 3
        for rows in self._asked.frames:
            left = self._said[..., at : at + len(rows)]
            at += len(rows)
            if len(rows) == 6 and not turning:  # a twist, whose linear part is longer than the way if it turns, too
                left = np.concatenate([left[..., :3], se3.exp(left)[..., :3, 3]], axis=-1)
            for k, row in enumerate(rows):
                if (row < 3) == turning:
                    total = total + left[..., k] ** 2
        return np.asarray(np.sqrt(total), self.q.dtype)

    def reason(self, *index: int) -> str:
        """Why a pose was not reached, in words.

        Parameters
        ----------
        *index : int, of the pose in the batch

        Returns
        -------
        text : str, empty where the pose was reached

        Examples
        --------
        >>> import twistwrench as tw
        >>> far = tw.se3.exp([0, 0, 0, 5, 0, 0])
        >>> tw.robots.planar_2r().inverse_kinematics(far, rows="vx vz", restarts=2).reason()[:12]
        'out of reach'
        """
        if bool(self.converged[index]):
            return ""
        d, a = float(self.distance[index]), float(self.angle[index])
        if np.isnan(d) or np.isnan(a):
            return "the pose has entries that are not numbers"
        left = f"the nearest found is {printed(d, 3)} m and {printed(a, 3)} rad away, after {int(self.starts[index])} starts"
        if (gap := float(self.gap[index])) > _OPEN:
            left += f", with loops open by {printed(gap, 3)} (rad or m)"
        held = [n for n, h in zip(self.joint_names, self.held[index], strict=True) if h]
        if held:
            return f"{', '.join(held)} {'is at its limit' if len(held) == 1 else 'are at their limits'}: {left}"
        return f"out of reach, or of this search: {left}"

    def __repr__(self) -> str:
        return f"<InverseKinematics: {self}>"

    def __str__(self) -> str:
        if self.converged.ndim == 0:
            return (
                f"reached: {printed(self.distance, 2)} m, {printed(self.angle, 2)} rad left"
                if self.converged
                else self.reason()
            )
        return f"{int(self.converged.sum())} of {self.converged.size} poses reached"


def selected(found: InverseKinematics, which: Array, q: Array) -> InverseKinematics:
    """Those of some poses of a batch with one axis, in an order; ``q`` is what they have."""
    return InverseKinematics(q, found._said[which], found._asked)
