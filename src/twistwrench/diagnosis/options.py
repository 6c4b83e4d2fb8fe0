"""Options of the doctor's checks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """Options common to all checks."""

    metric: str = "frobenius"
    """Metric of the nearest tensor, a key of ``METRICS``."""
    mirror_from: str = ""
    """Correct side, left or right, if two sides are not mirror images; empty if unknown."""
