"""Types shared by all signatures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Array",
    "Celsius",
    "Frame",
    "Hertz",
    "Hours",
    "JointTorques",
    "Metres",
    "Names",
    "Poses",
    "Rotations",
    "Seconds",
    "Twists",
    "Vector",
    "WrenchesGiven",
]

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

# Numbers whose annotation names the unit: the shell reads them with it, and shows it in the form of the option.

Hertz: TypeAlias = float
Seconds: TypeAlias = float
Hours: TypeAlias = float
Celsius: TypeAlias = float
Metres: TypeAlias = float
Frame: TypeAlias = str
"""Name of a frame of the robot."""
Names: TypeAlias = str | Iterable[str]
"""One name, or several."""
Vector: TypeAlias = ArrayLike
"""(3,) coordinates."""
WrenchesGiven: TypeAlias = Mapping[str, ArrayLike]
"""(6,) by frame: moment, then force [N m, N]."""
