"""Parts of the faulty logs: faults, clean logs, ordinary work, small errors of laws, and pauses."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

import twistwrench as tw

from .cases import FAULTS, MORE, Case, Recording, elastic, laws, paused
from .second import SECOND_ROBOTS, TUNED, TURNS, UNTOUCHED
from .truth import (
    ARMS,
    MEMORY,
    NOISE,
    RATE,
    SECONDS,
    Array,
    Series,
    States,
    Truth,
    bounds,
    coloured,
    generator,
    load,
)

CASES = {**FAULTS, **MORE, **TUNED, **UNTOUCHED}
TEN = ("planar_2r", "planar_3r", "geared", "sliding", "branched", "quadruped", *ARMS)
MEMORIES = (0.0, 0.004, 0.03, 0.1, 0.2)
CLEAN_SEEDS = range(4)
ORDINARY = 200
_ORDINARY_RATE = 100.0
_MANY = 12
"""Joints from which logs of ordinary work last 20 s at most."""
LAW_SEEDS = range(1, 4)
LAWS: Mapping[str, Case] = {
    case.name: case
    for case in (
        Case("small Stribeck", world=(partial(laws, static=0.2),), notes=("stribeck",)),
        Case("small load friction", world=(partial(laws, load=0.02),), notes=("load-friction",)),
        Case("small elasticity", log=(partial(elastic, degrees=0.1),), notes=("elasticity",)),
        Case("small warming", world=(partial(laws, warming=-0.1),), notes=("warming",)),
        Case("small asymmetry", world=(partial(laws, asymmetry=0.1),), notes=("asymmetry",)),
    )
}
"""A fifth to two fifths of the errors among the faults: a note at most."""
PAUSES: Mapping[str, Case] = {
    case.name: case
    for case in (
        Case("no pause"),
        *(Case(f"pause of {s} s", log=(partial(paused, seconds=s),), notes=("pause",)) for s in (0.1, 0.5, 2.0, 10.0)),
    )
}


@dataclass(frozen=True)
class Task:
    """One log to be made and judged."""

    part: str
    robot: str
    name: str
    seed: int = 0

    @property
    def case(self) -> Case:
        """What is done to it."""
        return {"laws": LAWS, "pauses": PAUSES}.get(self.part, CASES).get(self.name) or Case(self.name)

    def recording(self) -> Recording:
        """The log in the making."""
        if self.part == "clean":
            return recording(self.robot, self.case, self.seed, memory=float(self.name.split()[0]) / 1e3)
        if self.part == "ordinary":
            return _ordinary(self.robot, self.seed)
        return recording(self.robot, self.case, self.seed)


def tasks(part: str) -> list[Task]:
    """All logs of a part."""
    if part == "clean":
        return [Task(part, r, f"{1e3 * m:g} ms", s) for s in CLEAN_SEEDS for r in TEN for m in MEMORIES]
    if part == "ordinary":
        return [Task(part, _ordinary_robot(k), f"ordinary {k}", k) for k in range(ORDINARY)]
    if part == "laws":
        return [Task(part, r, name, s) for s in LAW_SEEDS for r in ARMS for name in LAWS]
    if part in SECOND:
        robots, turns = SECOND_ROBOTS, range(TURNS)
    else:
        robots, turns = ARMS, range(len(ARMS))
    # Any beginning of the list has all cases, on different robots.
    names = {"faults": FAULTS, "more": MORE, "pauses": PAUSES, **SECOND}[part]
    return [
        Task(part, robots[(i + turn) % len(robots)], name, turn * (part in SECOND))
        for turn in turns
        for i, name in enumerate(names)
    ]


def _ordinary_robot(k: int) -> str:
    """One of ten robots in turn; now and then one of 20 joints, and twice one of 30, which take long."""
    if k % 100 == 99:
        return "tree_30"
    return "tree_20" if k % 25 == 12 else TEN[(k + k // len(TEN)) % len(TEN)]


SECOND: Mapping[str, Mapping[str, Case]] = {"tuned": TUNED, "untouched": UNTOUCHED}
"""Halves of the second generator."""
PARTS: tuple[str, ...] = ("faults", "clean", "ordinary", "laws", "pauses", "more", *SECOND)


def recording(robot: str, case: Case, seed: int = 0, *, memory: float = MEMORY, noise: float = NOISE) -> Recording:
    """A log in the making: the truth, motion and noise are those of the robot and the seed, whatever the case."""
    file, rng = load(robot, case.variant), generator(robot, seed)
    truth, motion = Truth.random(file, rng), Series.random(file, rng)
    t = np.arange(round(SECONDS * RATE)) / RATE
    states = motion(t)
    truth = truth.with_drives(states)
    errors = coloured(len(t), file.nv, rng, memory) * noise * truth.torques(*states).std(axis=0)
    mine = generator(robot, seed, case.name)
    for change in case.world:
        truth = change(truth, states, mine)
    log = Recording(truth, motion, mine, t, states[0].copy(), truth.torques(*states, t) + errors, errors)
    for fault in case.log:
        fault(log)
    return log


def motion_of(log: Recording) -> tw.Motion:
    """The log as a user has it: times, positions and torques of the file's robot."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.Motion(log.t, log.q, tau=log.tau, robot=log.truth.file)


# ── Ordinary work: point to point, one to three joints at a time, rests


@dataclass(frozen=True)
class PointToPoint:
    """Configurations (k, nv) at the ends of moves, their beginnings and lengths (k − 1,) [s]; quintic, at rest between them.

    q = q_a + (q_b − q_a) s(x), s = 10 x³ − 15 x⁴ + 6 x⁵, x from 0 to 1.
    """

    points: Array
    starts: Array
    lengths: Array

    @classmethod
    def random(cls, robot: tw.Robot, rng: np.random.Generator, seconds: float) -> PointToPoint:
        """Moves of 0.8 to 3 s with rests of 0.1 to 2 s between them."""
        lower, upper = bounds(robot)
        q = (lower + upper) / 2 + 0.3 * rng.uniform(-1, 1, robot.nv) * (upper - lower)
        points, starts, lengths, now = [q], [], [], float(rng.uniform(0.1, 1.0))
        while now < seconds - 0.8 or not starts:
            length = float(rng.uniform(0.8, 3.0))
            joints = rng.choice(robot.nv, size=min(robot.nv, int(rng.integers(1, 4))), replace=False)
            goal = points[-1].copy()
            goal[joints] = (lower + upper)[joints] / 2 + 0.4 * rng.uniform(-1, 1, len(joints)) * (upper - lower)[joints]
            step = np.clip(goal - points[-1], -0.7 * length, 0.7 * length)
            points.append(points[-1] + step)
            starts.append(now)
            lengths.append(length)
            now += length + float(rng.uniform(0.1, 2.0))
        return cls(np.array(points), np.array(starts), np.array(lengths))

    def __call__(self, t: Array) -> States:
        k = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, len(self.starts) - 1)
        length = self.lengths[k]
        x = np.clip((t - self.starts[k]) / length, 0.0, 1.0)
        way = (self.points[1:] - self.points[:-1])[k]
        s = 10 * x**3 - 15 * x**4 + 6 * x**5
        ds = (30 * x**2 - 60 * x**3 + 30 * x**4) / length
        dds = (60 * x - 180 * x**2 + 120 * x**3) / length**2
        return self.points[k] + s[:, None] * way, ds[:, None] * way, dds[:, None] * way


def _ordinary(robot: str, seed: int) -> Recording:
    """A clean log of ordinary work, 4 to 60 s long."""
    file, rng = load(robot), generator(robot, seed, "ordinary")
    seconds = float(np.exp(rng.uniform(np.log(4.0), np.log(20.0 if file.nv >= _MANY else 60.0))))
    usual = Series.random(file, rng)(np.arange(0, 10, 0.02))
    truth = Truth.random(file, rng).with_drives(usual)
    motion: Callable[[Array], States] = PointToPoint.random(file, rng, seconds)
    t = np.arange(round(seconds * _ORDINARY_RATE)) / _ORDINARY_RATE
    states = motion(t)
    size = NOISE * truth.torques(*usual).std(axis=0)
    errors = size * coloured(len(t), file.nv, rng, float(rng.choice(MEMORIES)), _ORDINARY_RATE)
    return Recording(truth, motion, rng, t, states[0].copy(), truth.torques(*states) + errors, errors)
