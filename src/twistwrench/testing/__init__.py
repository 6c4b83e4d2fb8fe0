"""Test tools for dynamics: random robots of every joint kind, random states, comparisons with explained differences.

The laws of mechanics hold for every robot, so a test that draws its robots finds what a test of one arm does not.
"""

from __future__ import annotations

from .comparison import assert_close, derivative, derivative_along, relative_gap
from .robots import KINDS, State, random_builder, random_inertia, random_pose, random_robot, random_state

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
