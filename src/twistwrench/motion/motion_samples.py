"""Complete samples of a motion, with the source of their rates."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from ..core.typing import Array


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Consecutive samples of a motion with all inputs of inverse dynamics; (n,), (n, nq), (n, nv), (n, nv)."""

    time: Array
    """Times (n,) [s]."""
    q: Array
    """Differentiated coordinates: smoothed if requested, without jumps of wrapped angles."""
    dq: Array
    """Velocities (n, nv) [rad/s, m/s]."""
    ddq: Array
    """Accelerations (n, nv) [rad/s², m/s²]."""
    measured: Array
    """Coordinates (n, nq) of the file in SI units, for position limits."""
    stationary: Array
    """(n, nv) True if a velocity is derived and within its uncertainty, so that its sign is not significant."""
    outlier: Array
    """Residuals (n, k, 2) of outliers in standard deviations and SI units; 0 for other samples. (n, 0) without
    smoothing.
    """

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: Any) -> MotionSamples:
        """Select rows by a slice, a mask or indices."""
        return MotionSamples(*(getattr(self, f.name)[rows] for f in fields(self)))
