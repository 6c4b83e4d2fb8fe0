"""Types of arguments of the methods of quantities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

Kind = Literal["body", "space", "world_aligned"]
Rows = str | Iterable[int | str] | None
"""Rows of a twist, by name, ``"vx vz"``, or number, 0 to 5; None is all six."""
Wrenches = Mapping[str, Any]
"""``{frame: (..., 6)}``, each (m, f) in the axes of its frame."""

CONFIGURATIONS = ("q", "q0", "q1")
"""Inputs that are configurations, by which derivatives are along :meth:`twistwrench.Robot.add`."""
