"""The section on single precision: ours in float32 beside ours and Pinocchio's C++ in float64, and how much is lost.

The anchor stays in float64: nobody asks Pinocchio's users to compute in float32. The loss is that of the arithmetic alone:
float64 is given the same numbers, which are those that float32 can hold.
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from bench import machine, peer_pinocchio_cpp
from bench.cases import CASES, COMPARED, Case, States, differences
from bench.ours import METHOD, Ours, repeat
from bench.side_by_side import STATES
from bench.timing import ROUNDS, Contender, interleave

SINGLE, DOUBLE = f"{METHOD}, float32", f"{METHOD}, float64"
TOLERANCE = 1e-2  # a float32 further off computes something else
Arrays = tuple[np.ndarray, ...]


def times(rounds: int = ROUNDS, cases: tuple[Case, ...] = CASES, size: int = STATES) -> dict[str, Any]:
    """Times of the batch that is a robot's headline, and errors over ``size`` states."""
    builds, missing = peer_pinocchio_cpp.builds()
    where = machine.describe()  # this section may be newer than the others
    results: dict[str, Any] = {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "missing": missing}
    results["robots"] = {case.name: _robot(case, builds, rounds, States.random(case, size)) for case in cases}
    return results


def _robot(case: Case, builds: list[Any], rounds: int, states: States) -> dict[str, Any]:
    ours, quantities = Ours(case), {}
    anchors = [peer_pinocchio_cpp.PinocchioCpp(case, build) for build in builds]
    for quantity in COMPARED:
        print(f"{case.name}: {quantity}, float32", flush=True)
        errors = loss(ours, quantity, states)
        batch = ours.inputs(quantity, states[: case.batch])
        method = ours.method(quantity)
        contenders = [
            Contender(SINGLE, repeat(method, _cast(batch, np.float32)), len(batch[0])),
            Contender(DOUBLE, repeat(method, batch), len(batch[0])),
            *(contender for anchor in anchors for contender in anchor.contenders(quantity, states)),
        ]
        timings = {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()}
        quantities[quantity] = {"timings": timings, **errors}
    return {"title": case.title, "batch": case.batch, "states": len(states), "quantities": quantities}


def loss(ours: Ours, quantity: str, states: States) -> dict[str, float]:
    """Median and worst error over the states, as a share of the largest entry of a state's result."""
    given = _cast(ours.inputs(quantity, states), np.float32)
    single, double = ours.method(quantity)(*given), ours.method(quantity)(*_cast(given, np.float64))
    pairs = zip(single, double, strict=True) if isinstance(single, tuple) else [(single, double)]
    errors = np.array([differences(_plain(mine, np.float32), _plain(exact, np.float64)) for mine, exact in pairs])
    if not errors.max() < TOLERANCE:
        raise SystemExit(f"{ours.case.name}: {quantity} in float32 is off by {errors.max():.1e}: nothing is timed")
    return {"median": float(np.median(errors)), "worst": float(errors.max())}


def _plain(values: np.ndarray, dtype: type) -> np.ndarray:
    if values.dtype != dtype:
        raise SystemExit(f"a result is {values.dtype}, not {np.dtype(dtype)}: nothing is timed")
    return values


def _cast(arrays: Arrays, dtype: type) -> Arrays:
    return tuple([np.ascontiguousarray(each, dtype) for each in arrays])
