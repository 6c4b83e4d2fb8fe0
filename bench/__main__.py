"""Run everything and write the report: `python -m bench [--rounds N] [--robots ur5,panda,talos]`.

`--only one_body` or `--only threads` times that section alone and leaves the rest of the results as it is; `--render` times
nothing.
"""

import argparse
import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench import footprint, machine, peer_pinocchio_cpp, report
from bench.cases import CASES, QUANTITIES, Case, States, difference
from bench.peer_pinocchio import Pinocchio
from bench.timing import ROUNDS, interleave, pin_to_one_core

HERE = Path(__file__).parent
STATES = 4096  # at most; the batch of a case is its headline
EXACT = "twistwrench, snap=0"  # only checked, not timed
CHECKED = 64  # states on which all contenders must agree before anything is timed
TOLERANCE = 1e-8  # a contender further off computes something else; the table of agreement says how near each one is


def main() -> None:
    options = _options()
    kept = HERE / "results.json"
    if options.only:
        part = {options.only: _part(options.only, options.rounds)}
        kept.write_text(_json({**json.loads(kept.read_text()), **part}))
    elif not options.render:
        kept.write_text(_json(_measure(options)))
    results = json.loads(kept.read_text())
    (HERE / "RESULTS.md").write_text(report.write(results))
    print(f"wrote {HERE / 'RESULTS.md'}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Time twistwrench beside its peers, on one core."
    )
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="interleaved repeats (default %(default)s)")
    parser.add_argument("--robots", default=",".join(c.name for c in CASES), help="default %(default)s")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--only", choices=("one_body", "threads"), help="time this section alone and keep the others' results"
    )
    what.add_argument("--render", action="store_true", help="only write RESULTS.md again, from results.json")
    return parser.parse_args()


def _part(name: str, rounds: int) -> dict[str, Any]:
    """What one section takes, by its name in the results."""
    from bench import one_body, threads

    if name != "threads":
        pin_to_one_core()
    return {"one_body": one_body.times, "threads": threads.times}[name](rounds)


def _json(results: dict[str, Any]) -> str:
    return json.dumps(results, indent=1) + "\n"


def _measure(options: argparse.Namespace) -> dict[str, Any]:
    cases = [c for c in CASES if c.name in options.robots.split(",")]
    builds, missing = peer_pinocchio_cpp.builds()
    results: dict[str, Any] = {
        "machine": machine.describe(),
        "compilers": {b.name: b.compiler for b in builds},
        "missing": missing,
        "rounds": options.rounds,
        "robots": {},
    }
    with suppress(ImportError):  # the robots say below what is missing
        results["threads"] = _part("threads", options.rounds)  # before all is kept on one core
    results["machine"]["core"] = pin_to_one_core()
    for case in cases:
        results["robots"][case.name] = _robot(case, builds, missing, options.rounds)
    if "twistwrench" not in missing:
        results["kernels"] = {case.name: footprint.kernel_times(case) for case in cases}
        panda = next(c for c in CASES if c.name == "panda")
        results["start"] = footprint.start_times(panda, max(options.rounds // 2, 3))
        results["one_body"] = _part("one_body", options.rounds)
    results["installed"] = footprint.installed_bytes()
    return results


def _robot(case: Case, builds: list[Any], missing: dict[str, str], rounds: int) -> dict[str, Any]:
    print(f"{case.name}: loading", flush=True)
    peers = _peers(case, builds, missing)
    states = States.random(case, STATES)
    quantities = {}
    for quantity in QUANTITIES:
        agreement = _agreement(case, peers, quantity, states[:CHECKED])
        print(f"{case.name}: {quantity}", flush=True)
        contenders = [c for name, peer in peers.items() if name != EXACT for c in peer.contenders(quantity, states)]
        timings = {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()}
        quantities[quantity] = {"agreement": agreement, "timings": timings}
        if "twistwrench" in peers:
            quantities[quantity]["operations"] = peers["twistwrench"].operations(quantity)
    return {"title": case.title, "batch": case.batch, "quantities": quantities}


def _peers(case: Case, builds: list[Any], missing: dict[str, str]) -> dict[str, Any]:
    """All contenders for a robot, by name; what cannot be imported is written down as missing."""
    peers: dict[str, Any] = {}
    try:
        from bench.ours import Ours

        peers["twistwrench"] = Ours(case)
        peers[EXACT] = Ours(case, snap=0)
    except ImportError as error:
        missing["twistwrench"] = f"{error}: `pip install -e .[peers]`"
    peers.update({f"Pinocchio C++, {build.name}": peer_pinocchio_cpp.PinocchioCpp(case, build) for build in builds})
    peers["Pinocchio"] = Pinocchio(case)
    try:
        from bench.peer_mujoco import MuJoCo

        peers["MuJoCo"] = MuJoCo(case)
    except ImportError as error:
        missing["MuJoCo"] = f"{error}: `pip install mujoco`"
    try:
        from bench.peer_book import Book

        if not case.floating_base:
            peers["modern_robotics"] = Book(case)
    except ImportError as error:
        missing["modern_robotics"] = f"{error}: `pip install modern_robotics`"
    return peers


def _agreement(case: Case, peers: dict[str, Any], quantity: str, states: States) -> dict[str, float]:
    """How far each contender is from Pinocchio called from Python. Too far stops the benchmark."""
    reference = peers["Pinocchio"].evaluate(quantity, states)
    found = {n: difference(p.evaluate(quantity, states), reference) for n, p in peers.items() if n != "Pinocchio"}
    for name, error in found.items():
        if not error < TOLERANCE:
            raise SystemExit(
                f"{case.name}: {name} and Pinocchio disagree about {quantity} by {error:.1e}: nothing is timed"
            )
    return found


if __name__ == "__main__":
    main()
