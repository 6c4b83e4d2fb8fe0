"""The section on derivatives: inverse dynamics by q and dq, forward dynamics by q, dq and tau. Pinocchio has them, too."""

from typing import Any

from bench import machine, peer_pinocchio_cpp
from bench.cases import CASES, DERIVATIVES, Case
from bench.side_by_side import STATES, measured, ours_and_pinocchio
from bench.timing import ROUNDS


def times(rounds: int = ROUNDS, cases: tuple[Case, ...] = CASES, size: int = STATES) -> dict[str, Any]:
    """Robots by name, as in the rest of the results."""
    builds, missing = peer_pinocchio_cpp.builds()
    where = machine.describe()  # this section may be newer than the others
    robots = {
        case.name: measured(case, ours_and_pinocchio(case, builds, missing), rounds, DERIVATIVES, size)
        for case in cases
    }
    return {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "missing": missing, "robots": robots}
