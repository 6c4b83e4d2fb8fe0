"""What checks are told beside the robot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """Options of all checks."""

    metric: str = "frobenius"
    """Of the nearest tensor, one of ``METRICS``."""
    mirror_from: str = ""
    """The side, left or right, that is right where two sides are no mirror images; empty: not known."""
