"""Test tools for dynamics: random robots of every joint kind, random states, and comparisons with explained differences.

The laws of mechanics hold for every robot, so random robots reveal errors that tests of a single arm miss.
"""

from __future__ import annotations

from .comparison import assert_close, relative_gap
from .derivatives import derivative, derivative_along
from .random_robots import KINDS, State, random_builder, random_inertia, random_pose, random_robot, random_state

__all__ = [
    "KINDS",
    "State",
    "assert_close",
    "derivative",
    "derivative_along",
    "random_builder",
    "random_inertia",
    "random_pose",
    "random_robot",
    "random_state",
    "relative_gap",
]
