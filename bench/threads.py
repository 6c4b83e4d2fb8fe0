"""Large batches shared among threads: the panda's inverse dynamics on one thread and on several, all cores free to use."""

import os
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

import twistwrench as tw
from bench import machine
from bench.timing import ROUNDS, Contender, interleave

SIZES = (65_536, 262_144)
THREADS = (1, 2)
SEED = 8


def times(rounds: int = ROUNDS, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """Nanoseconds per state by size and number of threads; the results are compared to the bit before anything is timed."""
    where = machine.describe()  # this section may be newer than the others
    results: dict[str, Any] = {"date": where["date"], "cpu": where["cpu"], "cores": _cores(), "rounds": rounds}
    before = tw.get_threads()
    try:
        results["states"] = {str(size): _timed(size, rounds) for size in sizes}
    finally:
        tw.set_threads(before)
    return results


def _timed(size: int, rounds: int) -> dict[str, Any]:
    print(f"threads: {size} states", flush=True)
    robot, rng = tw.robots.panda(), np.random.default_rng(SEED)
    states = [robot.random_configuration(rng, size), *rng.normal(size=(2, size, robot.nv))]
    alone = robot.kernel("inverse_dynamics")(*states)
    for count in THREADS:
        tw.set_threads(count)
        if robot.inverse_dynamics(*states).tobytes() != alone.tobytes():
            raise SystemExit(f"threads: {count} threads and one disagree on {size} states: nothing is timed")
    contenders = [Contender(str(count), _repeat(robot, states, count), size) for count in THREADS]
    return {count: asdict(timing) for count, timing in interleave(contenders, rounds).items()}


def _repeat(robot: tw.Robot, states: list[np.ndarray], count: int) -> Callable[[int], None]:
    def sweep(times: int) -> None:
        if tw.get_threads() != count:  # in the sweep that is not timed
            tw.set_threads(count)
        for _ in range(times):
            robot.inverse_dynamics(*states)

    return sweep


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
