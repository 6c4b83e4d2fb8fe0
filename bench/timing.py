"""Interleaved repeats on one core: every round times each contender once, so that whatever disturbs hits all alike."""

import gc
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

ROUND_SECONDS = 0.02
ROUNDS = 15


@dataclass(frozen=True)
class Contender:
    """One way of computing one quantity: `sweep(n)` computes `samples` states, n times over."""

    name: str
    sweep: Callable[[int], object]
    samples: int


def calls(name: str, function: Callable[..., object], arguments: Sequence[tuple[object, ...]]) -> Contender:
    """A contender that calls a Python function once per state, each time with another state."""

    def sweep(times: int) -> None:
        for _ in range(times):
            for each in arguments:
                function(*each)

    return Contender(name, sweep, len(arguments))


@dataclass(frozen=True)
class Timing:
    """Nanoseconds per state over the rounds."""

    median: float
    low: float  # lower quartile
    high: float  # upper quartile
    minimum: float

    @classmethod
    def of(cls, nanoseconds: Sequence[float]) -> "Timing":
        low, median, high = np.percentile(nanoseconds, [25, 50, 75])
        return cls(float(median), float(low), float(high), min(nanoseconds))


def pin_to_one_core() -> int | None:
    """Keep this process, and what it starts, on the core it may use last; None where the system has no such call."""
    if not hasattr(os, "sched_setaffinity"):
        return None
    core = max(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return core


def interleave(
    contenders: Sequence[Contender],
    rounds: int = ROUNDS,
    seconds: float = ROUND_SECONDS,
    clock: Callable[[], int] = time.perf_counter_ns,
) -> dict[str, Timing]:
    """Time all contenders, round-robin, each for at least `seconds` a round, with the garbage collector paused.

    With `time.thread_time_ns` as clock, time that other processes take on the core does not count.
    """
    times = {c.name: _times_to_fill(c, seconds) for c in contenders}
    if len(times) < len(contenders):
        raise ValueError("two contenders have the same name")
    nanoseconds: dict[str, list[float]] = {c.name: [] for c in contenders}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for c in contenders:
                c.sweep(1)  # its data and code are in the cache again after the others' turn
                start = clock()
                c.sweep(times[c.name])
                elapsed = clock() - start
                nanoseconds[c.name].append(elapsed / (times[c.name] * c.samples))
    finally:
        gc.enable()
    return {name: Timing.of(each) for name, each in nanoseconds.items()}


def _times_to_fill(contender: Contender, seconds: float) -> int:
    times = 1
    while True:
        start = time.perf_counter()
        contender.sweep(times)
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            return times
        times = max(2 * times, int(1.1 * times * seconds / max(elapsed, 1e-6))) if elapsed > seconds / 20 else 4 * times
