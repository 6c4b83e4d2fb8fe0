"""Large batches shared among threads: inverse dynamics on one thread and on several, all cores free to use."""

import os
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

import twistwrench as tw
from bench import machine
from bench.cases import CASES
from bench.ours import load
from bench.timing import ROUNDS, Contender, interleave

SIZES = (65_536, 262_144)
THREADS = (1, 2)
SEED = 8


def times(rounds: int = ROUNDS, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """Nanoseconds per state by size and number of threads; the results are compared to the bit before anything is timed.

    "states" are the panda's; the humanoid's are of the first size only, which for a result of 38 numbers is large enough.
    """
    where = machine.describe()  # this section may be newer than the others
    results: dict[str, Any] = {"date": where["date"], "cpu": where["cpu"], "cores": _cores(), "rounds": rounds}
    before = tw.get_threads()
    try:
        results["states"] = {str(size): _timed(tw.robots.panda(), size, rounds) for size in sizes}
        talos = load(next(case for case in CASES if case.name == "talos"))
        results["humanoid"] = {str(size): _timed(talos, size, rounds) for size in sizes[:1]}
    finally:
        tw.set_threads(before)
    return results


def _timed(robot: tw.Robot, size: int, rounds: int) -> dict[str, Any]:
    print(f"threads: {robot.name}, {size} states", flush=True)
    rng = np.random.default_rng(SEED)
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
