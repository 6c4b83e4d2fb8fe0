"""The section on limits: what the core could do at most, measured beside each kernel in the same rounds, and what bounds it.

Three bounds, each as if there were nothing else to do: the products alone, at the rate of a loop of independent products;
all vector instructions, at the rate of a loop in the same mixture, as long as a kernel's stretches; the results' bytes, at
the rate of plain or cache-avoiding stores to as large a buffer, whichever is faster.
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from bench import machine
from bench.cases import CASES, COMPARED, MATRICES, Case, States
from bench.ceilings import STREAMS, as_long, lanes, mixture, stream
from bench.instructions import PARTS, of_kernel, total
from bench.ours import Ours, kernel, repeat
from bench.side_by_side import STATES
from bench.timing import ROUNDS, Contender, Timing, interleave

BEYOND = 128 * 2**20  # bytes: more than a core's share of any cache
SECONDS, TURNS = 0.003, 3  # of a turn, and turns a round
CORE = {
    "products": {"products": 1},
    "products, a sum beside each": {"products": 1, "sums": 1},
    "products, sums, loads and stores, 3 : 2 : 3 : 1": {"products": 3, "sums": 2, "loads": 3, "stores": 1},
    "loads": {"loads": 1},
    "stores": {"stores": 1},
}


def times(
    rounds: int = ROUNDS, cases: tuple[Case, ...] = CASES, size: int = STATES, beyond: int = BEYOND
) -> dict[str, Any]:
    """What the core can do, and for each kernel its work, its time and the ceilings' times."""
    where = machine.describe()  # this section may be newer than the others
    results: dict[str, Any] = {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "lanes": lanes()}
    results["core"] = _timed([mixture(name, parts) for name, parts in CORE.items()], rounds)
    results["memory"] = {"bytes": beyond, **_timed([stream(kind, kind, beyond) for kind in STREAMS], rounds)}
    results["robots"] = {case.name: _robot(case, rounds, size) for case in cases}
    return results


def _robot(case: Case, rounds: int, size: int) -> dict[str, Any]:
    ours, states = Ours(case), States.random(case, size)
    return {"title": case.title, "quantities": {q: _quantity(ours, q, states, rounds) for q in COMPARED}}


def _quantity(ours: Ours, quantity: str, states: States, rounds: int) -> dict[str, Any]:
    """Work per state, and times: nanoseconds per state of the kernel, per instruction and per byte of the ceilings."""
    from twistwrench.compiler.lowering.target_machine import DOUBLE

    case = ours.case
    print(f"{case.name}: {quantity}, its bounds", flush=True)
    bare, program = kernel(ours.robot, case, quantity), ours.robot.program(quantity)
    parts, written = of_kernel(bare, DOUBLE), 8 * sum(port.size for port in program.outputs)
    batches = {case.batch, len(states)} if quantity in MATRICES else {case.batch}  # vectors stay in the cache anyway
    contenders = [mixture("products", CORE["products"]), mixture("mixture", parts), as_long("as long", parts)]
    for size in sorted(batches):
        arrays = ours.inputs(quantity, states[:size])
        outputs = [np.empty((size, *port.shape)) for port in program.outputs]
        contenders.append(Contender(f"kernel {size}", repeat(bare, (*arrays, *outputs)), size))
        contenders += [stream(f"{kind} {size}", kind, written * size) for kind in STREAMS[:2]]
    return {
        "multiplications": multiplications(program),
        "instructions": {part: parts[part] for part in (*PARTS, "folded", "moves", "loops", "frame", "length")},
        "executed": total(parts),
        "bytes": written,
        "batches": sorted(batches),
        "timings": _timed(contenders, rounds),
    }


def multiplications(program: Any) -> int:
    """Operations of the multiplier for a state, those of sines and cosines included."""
    angles = {instruction.args[0] for instruction in program.instructions if instruction.op in ("sin", "cos")}
    return int(program.multiplications + len(angles) * per_angle())


def per_angle() -> int:
    """Operations of the multiplier for the sine and cosine of one angle: counted in what is emitted for them."""
    from twistwrench.compiler.lowering.ir_builder import LlvmWriter
    from twistwrench.compiler.lowering.target_machine import DOUBLE, chosen
    from twistwrench.compiler.lowering.vector_math import sincos

    w = LlvmWriter(DOUBLE, lanes(), fused=chosen().fused)
    sincos(w, ["%x"])
    return sum(".fma." in line or " fmul " in line for line in w.lines)


def _timed(contenders: list[Contender], rounds: int) -> dict[str, Any]:
    """Short turns and many: a limit is what is reached when nothing disturbs, so the best of them counts."""
    timings: dict[str, Timing] = interleave(contenders, TURNS * rounds, SECONDS)
    return {name: asdict(timing) for name, timing in timings.items()}
