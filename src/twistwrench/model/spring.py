"""Springs between joint coordinates: elastic gears, and springs that hold a joint. Modern Robotics section 8.9.5."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Spring:
    """Stores ``½ stiffness (Σ weight · coordinate - rest)²`` over the one-degree joints named."""

    terms: tuple[tuple[str, float], ...]
    """(joint, weight) pairs."""
    stiffness: float
    """N m/rad or N/m."""
    rest: float = 0.0
    """rad or m."""

    def held(self, positions: dict[str, float]) -> Spring:
        """The same spring once some joints are locked: their part of its stretch is constant."""
        fixed = sum(weight * positions[joint] for joint, weight in self.terms if joint in positions)
        return Spring(tuple(t for t in self.terms if t[0] not in positions), self.stiffness, self.rest - fixed)
