"""What the tests of calls on several threads compare, and how long they wait."""

from __future__ import annotations

import numpy as np

import twistwrench as tw

WAIT = 60.0
"""Seconds until a test that would hang fails instead."""


def states(robot: tw.Robot, *batch: int) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    return [robot.random_configuration(rng, batch), *rng.normal(size=(2, *batch, robot.nv))]


def same(found, expected) -> bool:
    found, expected = (x if isinstance(x, tuple) else (x,) for x in (found, expected))
    pairs = list(zip(found, expected, strict=True))
    return all(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)
