"""Answers on ground, mounting and grip, as a part of the torque report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .grip import GripSupport
    from .ground_support import GroundSupport
    from .mounting import MotionMounting


@dataclass(frozen=True, eq=False)
class SupportAnswers:
    """Answers on ground, mounting and grip; None without the question."""

    support: GroundSupport | None = None
    mounting: MotionMounting | None = None
    grip: GripSupport | None = None
