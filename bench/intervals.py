"""How often intervals of 95 % hold the truth: of torque peaks (docs/torques.md) and of a sensor's load (docs/sensor.md).

By the functions of the tests, which bound the same shares with fewer logs. python -m bench.intervals
"""

from __future__ import annotations

import json
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

import twistwrench as tw

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).with_name("intervals.json")
PEAKS = {("planar_2r", 100): 36, ("planar_2r", 500): 24, ("planar_2r", 1000): 16, ("ur5", 100): 6, ("panda", 100): 5}
"""Robot and rate [Hz], and how many logs of each kind of error."""
LOGS = 600
"""Of a sensor, for each row."""
ROWS = ((12, 1, False, 0.0), (12, 1, True, 0.0), (12, 100, False, 0.0), (12, 100, False, 1.0), (12, 100, False, 3.0),
        (8, 1, False, 0.0), (6, 1, False, 0.0))  # fmt: skip
"""Orientations, readings of each, whether the channels' noise differs, and the error of a pose beside the noise."""


def peaks() -> dict[str, Any]:
    """Shares of peaks within 1.96 deviations of the true one, how many there were, and the root mean square of the misses."""
    import test_peak_estimates as test

    found, every = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for (name, rate), logs in PEAKS.items():
            robot, mine = getattr(tw.robots, name)(), {}
            for kind, errors in test.ERRORS.items():
                z = test.misses(robot, rate, errors, 3.0, range(logs), Path(folder), smoothing=False)
                every.append(z)
                mine[kind] = {"held": round(float((np.abs(z) < 1.96).mean()), 3), "peaks": len(z)}
                mine[kind]["rms"] = round(float(np.sqrt(np.mean(z**2))), 2)
            found[f"{name}, {rate} Hz"] = mine
    z = np.concatenate(every)
    return {"rows": found, "all": {"held": round(float((np.abs(z) < 1.96).mean()), 3), "peaks": len(z)}}


def sensor() -> list[dict[str, Any]]:
    """Least and most of the shares of bias, mass and first moment."""
    import test_sensor_coverage as test

    found = []
    for k, (poses, samples, unequal, error) in enumerate(ROWS):
        shares = test.covered(
            np.random.default_rng(k), LOGS, poses, samples, test.UNEQUAL if unequal else test.NOISE, error
        )
        parts = {"bias": shares[:6], "mass": shares[6:7], "first moment": shares[7:]}
        row: dict[str, Any] = {
            "orientations": poses,
            "readings": samples,
            "unequal noise": unequal,
            "pose error": error,
        }
        found.append(row | {key: [round(float(x.min()), 3), round(float(x.max()), 3)] for key, x in parts.items()})
    return found


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT / "tests" / room) for room in ("support", "report", "sensing")]
    results = {"date": date.today().isoformat(), "sensor": sensor(), "peaks": peaks()}
    KEPT.write_text(json.dumps(results, indent=1) + "\n", "utf-8")
    print(KEPT.read_text("utf-8"))
