"""Fresh results of methods, each in a process of its own: what an earlier call did to memory would change what this one takes.

``python -m bench.fresh ROBOT QUANTITY STATES`` measures one and prints it; the section starts such processes.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench import machine
from bench.cases import CASES, States
from bench.timing import Timing

ASKED = (
    ("panda", "inverse_dynamics_derivatives", 4096),
    ("panda", "forward_dynamics_derivatives", 4096),
    ("panda", "mass_matrix", 65_536),
    ("panda", "inverse_dynamics", 10_000_000),
    ("talos", "mass_matrix", 4096),
    ("talos", "inverse_dynamics_derivatives", 4096),
)
LEAST, SECONDS = 7, 2.0
"""Calls of one kind at least, and seconds of them."""


def times(robots: tuple[str, ...]) -> dict[str, Any]:
    """Nanoseconds a state: the first call, those from the third on, those while the last result lives, and into `out=`."""
    where = machine.describe()
    found = []
    for robot, quantity, size in ASKED:
        if robot not in robots:
            continue
        print(f"{robot}: {quantity}, {size} states, fresh", flush=True)
        command = [sys.executable, "-m", "bench.fresh", robot, quantity, str(size)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        found.append({"robot": robot, "quantity": quantity, "states": size, **json.loads(done.stdout)})
    return {"date": where["date"], "cpu": where["cpu"], "rows": found}


def _measured(name: str, quantity: str, size: int) -> dict[str, Any]:
    from bench.ours import Ours

    case = next(c for c in CASES if c.name == name)
    ours = Ours(case)
    few = States.random(case, min(size, 4096))
    arrays = tuple(np.resize(x, (size, x.shape[1])) for x in ours.inputs(quantity, few))
    method = ours.method(quantity)
    kept: list[Any] = []

    def alone() -> None:
        kept.clear()
        method(*arrays)

    def held() -> None:
        kept[:] = [method(*arrays)]

    def into() -> None:
        method(*arrays, out=kept[0])

    first, *fresh = _calls(alone)
    found = {"fresh": fresh[1:], "held": _calls(held)[2:], "out": _calls(into)[2:]}
    return {"first": 1e9 * first / size} | {k: vars(Timing.of([1e9 * t / size for t in v])) for k, v in found.items()}


def _calls(call: Callable[[], None]) -> list[float]:
    """Seconds of the processor that each call takes."""
    taken: list[float] = []
    while len(taken) < LEAST or sum(taken) < SECONDS:
        start = time.thread_time()
        call()
        taken.append(time.thread_time() - start)
    return taken


if __name__ == "__main__":
    print(json.dumps(_measured(sys.argv[1], sys.argv[2], int(sys.argv[3]))))
