"""One robot in all libraries: who takes part, whether they agree, what each takes. Nothing is timed before they agree."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from bench import peer_pinocchio_cpp
from bench.cases import QUANTITIES, Case, States, difference
from bench.peer_pinocchio import Pinocchio
from bench.timing import interleave

STATES = 4096  # at most; the batch of a case is its headline
EXACT = "twistwrench, snap=0"  # only checked, not timed
CHECKED = 64  # states on which all contenders must agree before anything is timed
TOLERANCE = 1e-8  # a contender further off computes something else; the table of agreement says how near each one is


def measured(
    case: Case, peers: dict[str, Any], rounds: int, quantities: Sequence[str] = QUANTITIES, size: int = STATES
) -> dict[str, Any]:
    """Agreement, times and operations of each quantity of one robot."""
    states = States.random(case, size)
    found = {}
    for quantity in quantities:
        agreed = agreement(case, peers, quantity, states[:CHECKED])
        print(f"{case.name}: {quantity}", flush=True)
        contenders = [c for name, peer in peers.items() if name != EXACT for c in peer.contenders(quantity, states)]
        timings = {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()}
        found[quantity] = {"agreement": agreed, "timings": timings}
        if "twistwrench" in peers:
            found[quantity]["operations"] = peers["twistwrench"].operations(quantity)
    return {"title": case.title, "batch": case.batch, "quantities": found}


def ours_and_pinocchio(case: Case, builds: list[Any], missing: dict[str, str]) -> dict[str, Any]:
    """The contenders that know every quantity, by name; what cannot be imported is written down as missing."""
    peers: dict[str, Any] = {}
    try:
        from bench.ours import Ours

        peers["twistwrench"] = Ours(case)
        peers[EXACT] = Ours(case, snap=0)
    except ImportError as error:
        missing["twistwrench"] = f"{error}: `pip install -e .[peers]`"
    peers.update({f"Pinocchio C++, {build.name}": peer_pinocchio_cpp.PinocchioCpp(case, build) for build in builds})
    peers["Pinocchio"] = Pinocchio(case)
    return peers


def all_peers(case: Case, builds: list[Any], missing: dict[str, str]) -> dict[str, Any]:
    """The same and those that know no derivatives."""
    peers = ours_and_pinocchio(case, builds, missing)
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


def agreement(case: Case, peers: dict[str, Any], quantity: str, states: States) -> dict[str, float]:
    """How far each contender is from Pinocchio called from Python. Too far stops the benchmark."""
    reference = peers["Pinocchio"].evaluate(quantity, states)
    found = {n: difference(p.evaluate(quantity, states), reference) for n, p in peers.items() if n != "Pinocchio"}
    for name, error in found.items():
        if not error < TOLERANCE:
            raise SystemExit(
                f"{case.name}: {name} and Pinocchio disagree about {quantity} by {error:.1e}: nothing is timed"
            )
    return found
