"""Types shared by all signatures."""

from __future__ import annotations

from typing import Any, TypeAlias

from numpy.typing import NDArray

__all__ = ["Array", "JointTorques", "Poses", "Rotations", "Twists"]

Array: TypeAlias = NDArray[Any]
"""NumPy array of float64 or float32 unless stated otherwise; of symbols while a function is traced."""

Rotations: TypeAlias = Array
"""(..., 3, 3)."""
Poses: TypeAlias = Array
"""(..., 4, 4)."""
Twists: TypeAlias = Array
"""(..., 6), angular part first."""
JointTorques: TypeAlias = Array
"""(..., n) [N m, sliding joints: N]."""
