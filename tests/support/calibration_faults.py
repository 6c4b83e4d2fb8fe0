"""Faults of measurements: those after which the tests of readings were made, and others that were never used for that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from calibration_worlds import World

import twistwrench as tw
from twistwrench.calibration import Measurements

Fault = Callable[[World, Measurements], Measurements]
SLIP = tw.se3.exp([0, 0, 0, 2e-3, -1e-3, 2e-3])
"""Displacement of a target on the tip by 3 mm."""


def _joints(m: Measurements, q: np.ndarray) -> Measurements:
    return replace(m, q=q)


def _times(m: Measurements, joint: int, factor: float) -> Measurements:
    return _joints(m, m.q * np.where(np.arange(m.q.shape[1]) == joint, factor, 1.0))


def _plus(m: Measurements, joint: int, offset: float) -> Measurements:
    return _joints(m, m.q + offset * np.eye(m.q.shape[1])[joint])


def _places(m: Measurements, points: np.ndarray) -> Measurements:
    if m.poses is None:
        return replace(m, positions=points)
    return replace(m, poses=np.asarray(tw.se3.pose(m.rotations, points)))


def _mirrored(m: Measurements) -> Measurements:
    M = np.diag([1.0, -1.0, 1.0])
    if m.poses is None:
        return _places(m, m.points @ M)
    return replace(m, poses=np.asarray(tw.se3.pose(M @ m.rotations @ M, m.points @ M)))


def _from(m: Measurements, later: Measurements, share: float) -> Measurements:
    """Readings of ``m``, those of ``later`` from a share of the rows on."""
    late = np.arange(len(m)) >= int(share * len(m))
    return _places(m, np.where(late[:, None], later.points, m.points))


def _late(m: Measurements, rows: int) -> Measurements:
    return replace(m.taken(np.arange(rows, len(m))), q=m.q[:-rows])


def _slipped(world: World, m: Measurements) -> Measurements:
    after = replace(world, truth=replace(world.truth, tip=world.truth.tip @ SLIP))
    return _from(m, after.readings(str(m.kind), m.q), 0.6)


def _another_arm(world: World, m: Measurements) -> Measurements:
    other = World.drawn(world.robot, 99, tip=world.chain.frame)
    return _from(m, other.readings(str(m.kind), m.q), 0.5)


TUNED: Mapping[str, tuple[str, Fault]] = {
    "mm": ("unit", lambda _, m: _places(m, 1e3 * m.points)),
    "inches": ("unit", lambda _, m: _places(m, m.points / 0.0254)),
    "degrees": ("degrees", lambda _, m: _joints(m, np.degrees(m.q))),
    "exchanged": ("exchanged", lambda _, m: _joints(m, m.q[:, [0, 2, 1, *range(3, m.q.shape[1])]])),
    "sign": ("sign", lambda _, m: _times(m, 3, -1.0)),
    "zero": ("zero", lambda _, m: _plus(m, 2, np.pi / 2)),
    "left-handed": ("left-handed", lambda _, m: _mirrored(m)),
    "row-shift": ("row-shift", lambda _, m: _late(m, 1)),
    "scale": ("scale", lambda _, m: _places(m, 1.02 * m.points)),
}
"""Doubt that has to be named, and readings with the fault."""
UNTUNED: Mapping[str, Fault] = {
    "one joint in degrees": lambda _, m: _times(m, 2, 180.0 / np.pi),
    "two rows late": lambda _, m: _late(m, 2),
    "feet": lambda _, m: _places(m, m.points / 0.3048),
    "x and y exchanged": lambda _, m: _places(m, m.points[:, [1, 0, 2]]),
    "a joint that reads one value": lambda _, m: _times(m, 4, 0.0),
    "elbow relative to the ground": lambda _, m: _joints(m, m.q + np.outer(m.q[:, 1], np.eye(m.q.shape[1])[2])),
    "gear off by 1 %": lambda _, m: _times(m, 3, 0.99),
    "target slips": _slipped,
    "half of the rows in mm": lambda _, m: _from(m, _places(m, 1e3 * m.points), 0.5),
    "two arms": _another_arm,
    "three columns in a ring": lambda _, m: _joints(m, m.q[:, [1, 2, 0, *range(3, m.q.shape[1])]]),
    "instrument drifts by 3 mm": lambda _, m: _places(
        m, m.points + np.outer(np.linspace(0, 3e-3, len(m)), [0, 0.6, 0.8])
    ),
    "two signs": lambda _, m: _times(_times(m, 1, -1.0), 3, -1.0),
}
"""Readings with faults of other kinds."""


def lost_zero(world: World, m: Measurements, joint: int, degrees: float) -> tuple[World, Measurements]:
    """Arm whose joint reads another zero, and its readings at the same configurations."""
    chain = world.chain
    x = np.zeros(len(chain.parameters))
    x[chain.parameters.index(f"{chain.joints[joint]}.zero")] = np.radians(degrees)
    other = replace(world, truth=chain.step(world.truth, x))
    other = replace(other, truth=replace(other.truth, tip=world.truth.tip))
    return other, other.readings(str(m.kind), m.q)


HARMLESS: Mapping[str, Callable[[World, Measurements], tuple[World, Measurements]]] = {
    "zero off by 5°": lambda world, m: lost_zero(world, m, 2, 5.0),
    "zero off by 15°": lambda world, m: lost_zero(world, m, 2, 15.0),
    "zero off by 45°": lambda world, m: lost_zero(world, m, 1, 45.0),
    "places rounded to 0.5 mm": lambda world, m: (world, _places(m, np.round(m.points / 5e-4) * 5e-4)),
    "a turn more": lambda world, m: (world, _plus(m, 3, 2 * np.pi)),
}
"""Arms and readings that a calibration takes as they are."""
