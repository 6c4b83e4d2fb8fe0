"""The drift of energy of each method of simulation, in two falls: the table of docs/simulation.md.

python -m bench.drift
"""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path

import twistwrench as tw

KEPT = Path(__file__).with_name("drift.json")
METHODS = ("dopri5", "rk4", "variational", "variational6", "midpoint", "semi_implicit", "euler")
CASES = {
    "ur5, 3 s in steps of 5 ms, from neutral at rest": (tw.robots.ur5, None, 3.0, 5e-3),
    "ur5, 5 s in steps of 1 ms, from neutral at rest": (tw.robots.ur5, None, 5.0, 1e-3),
    "planar_2r, 60 s in steps of 10 ms, from (1, 1) rad at rest": (tw.robots.planar_2r, [1.0, 1.0], 60.0, 1e-2),
}


def drift(case: str, method: str) -> float:
    """The energy that no work accounts for, over the energy that moved."""
    robot, q0, duration, dt = CASES[case]
    return float(f"{robot().simulate(q0, duration=duration, dt=dt, method=method).relative_drift:.2g}")


if __name__ == "__main__":
    found = {case: {method: drift(case, method) for method in METHODS} for case in CASES}
    KEPT.write_text(json.dumps({"date": date.today().isoformat(), "relative drift": found}, indent=1) + "\n", "utf-8")
    print(KEPT.read_text("utf-8"))
