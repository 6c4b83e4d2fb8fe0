"""What a kind of fault is: its change of a log, the logs that it needs, and the first words that it allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.one_fault_logs import Recording

DOUBTS = ("LOOK AGAIN", "UNSURE", "refused")
"""Words that are right for any fault: of a doubt, and of a file that is refused."""


@dataclass(frozen=True)
class Needs:
    """Logs that a fault can be in."""

    measured: bool | None = None
    turns: bool = False
    """Its robot turns at all joints that are changed."""
    slides: bool = False
    efforts: bool = False
    """All limits of torque are known, and no placeholders."""
    velocities: bool = False
    rate: float = 0.0
    forms: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fault:
    """A kind of fault."""

    name: str
    change: Callable[[Recording], None]
    needs: Needs = Needs()
    trace: str = "always"
    """``measured``: without measured torques, a log that keeps the robot's stops has no trace of it."""
    allowed: tuple[str, ...] = DOUBTS
    """Right first words. That of the true motion is right as well, OK only with its share."""
