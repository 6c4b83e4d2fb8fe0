"""Exciting motions beside random ones under the same constraints: the table of docs/identification-method.md.

python -m bench.excitation
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

import twistwrench as tw

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).with_name("excitation.json")
ROBOTS = {"ur5": tw.robots.ur5, "panda": tw.robots.panda}
COUNT = 500
GIVEN: dict[str, Any] = {"duration": 20.0, "harmonics": 5, "share": 0.9, "acceleration": 10.0, "floor": 0.1}


def compared(name: str) -> dict[str, Any]:
    """Condition number, worst deviation over the prior's and log det: of the motion found, and the best of random ones each."""
    sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "identification")]
    from test_exciting_motions import random_motions

    start = time.process_time()
    one = tw.identification.exciting_trajectory(ROBOTS[name](), **GIVEN)
    seconds = time.process_time() - start
    information = one.information
    every = np.array([_figures(information, states) for states in random_motions(one, COUNT, np.random.default_rng(7))])
    least, middle = every.min(axis=0), np.median(every, axis=0)
    mine = _figures(information, one(np.linspace(0.0, one.duration, 801)))
    return {
        "found": {**_named(mine), "worst group": one.worst[0], "processor seconds": round(seconds, 1)},
        f"best of {COUNT}": _named(least),
        f"median of {COUNT}": _named(middle),
    }


def _figures(information: Any, states: Sequence[np.ndarray]) -> tuple[float, float, float]:
    """What is to be small: condition, worst deviation over the prior's, -log det."""
    W = information.rows(*states)
    return information.condition(W), (information.deviations(W) / information.prior).max(), -information.log_det(W)


def _named(figures: Sequence[float]) -> dict[str, Any]:
    condition, worst, negative = (float(f"{x:.4g}") for x in figures)
    return {"condition": condition, "worst deviation": worst, "log det": -negative}


if __name__ == "__main__":
    found = {name: compared(name) for name in ROBOTS}
    KEPT.write_text(json.dumps({"date": date.today().isoformat(), "given": GIVEN, **found}, indent=1) + "\n", "utf-8")
    print(KEPT.read_text("utf-8"))
