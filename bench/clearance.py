"""Contacts between links by capsules alone and by exact distances: the table of docs/torques.md.

python -m bench.clearance
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import twistwrench as tw
from twistwrench.core.text import listed
from twistwrench.robots.finding import known_robots

KEPT = Path(__file__).with_name("clearance.json")
ROBOTS = (
    "ur3_robot", "ur5_robot", "ur10_robot", "panda_collision", "xarm7", "kinova", "z1", "so100", "a1", "tiago_no_hand",
)  # fmt: skip
"""Names of example-robot-data, its robots with shapes of all links that move."""
POSES = 2000
TIMED = 1000


def compared(name: str) -> dict[str, Any]:
    """Configurations in contact by each method, those that only capsules claim, and seconds of each for some rows."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(known_robots()[name].path, inertia="accept")
    q = robot.random_configuration(1, POSES)
    for exact in (True, False):
        robot.clearance(q[:1], exact=exact)
    coal, capsules = robot.clearance(q, exact=True), robot.clearance(q, exact=False)
    touch, claimed = coal.distance <= 0.0, capsules.distance <= 0.0
    return {
        "in contact": int(touch.sum()),
        "in contact by capsules": int(claimed.sum()),
        "false alarms": int((claimed & ~touch).sum()),
        "missed": int((touch & ~claimed).sum()),
        "not judged by capsules": list(capsules.undecided),
        "always in contact": list(coal.touching),
        f"seconds for {TIMED} rows": round(_seconds(lambda: robot.clearance(q[:TIMED], exact=True)), 2),
        f"seconds for {TIMED} rows by capsules": round(_seconds(lambda: robot.clearance(q[:TIMED], exact=False)), 3),
    }


def _seconds(call: Callable[[], object]) -> float:
    """Processor time."""
    start = time.process_time()
    call()
    return time.process_time() - start


def table() -> str:
    """The table of the page."""
    found = json.loads(KEPT.read_text("utf-8"))
    rows = ["| robot | in contact | by capsules | false alarms | missed | 1,000 rows | pairs that capsules leave out |"]
    rows.append("|---|---|---|---|---|---|---|")
    for name in ROBOTS:
        one = found[name]
        left_out = listed(one["not judged by capsules"], 2, "; ") or "–"
        counts = (f"{one[key]:,}" for key in ("in contact", "in contact by capsules", "false alarms", "missed"))
        rows.append(f"| {name} | {' | '.join(counts)} | {one[f'seconds for {TIMED} rows']:.2f} s | {left_out} |")
    return "\n".join(rows)


def totals() -> tuple[int, int, int]:
    """Configurations, false alarms and missed contacts of all robots."""
    found = json.loads(KEPT.read_text("utf-8"))
    return POSES * len(ROBOTS), *(sum(found[name][key] for name in ROBOTS) for key in ("false alarms", "missed"))


if __name__ == "__main__":
    found: dict[str, Any] = {"date": date.today().isoformat(), "configurations": POSES}
    for name in ROBOTS:
        found[name] = compared(name)
        print(name, found[name], flush=True)
    KEPT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", "utf-8")
    print(table(), totals())
