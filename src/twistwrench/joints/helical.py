"""Helical joints: they turn about an axis, and slide along it by the pitch."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ..typing import Array
from .axes import numbers, screw_of
from .screw_joint import ScrewJoint


class Helical(ScrewJoint):
    """A screw; its axis has the pitch in it."""

    kind = "helical"
    has_pitch = True

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """One screw axis, of a direction and its pitch."""
        pitch = float(numbers(pitch, (), f"the pitch of {who}"))
        return screw_of(cls.kind, True, axis, pitch, normalise, who)[None, :]
