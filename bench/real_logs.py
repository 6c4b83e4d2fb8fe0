"""What identification leaves unexplained of public logs of real robots: the figures of docs/identification-method.md.

The logs are no part of the repository; where they lie, tests/support/places.py says. python -m bench.real_logs
"""

from __future__ import annotations

import json
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).with_name("real_logs.json")
TIAGO = ("position", "velocity", "effort")


def results() -> dict[str, dict[str, Any]]:
    """Of each log what ``--json`` says, by the files and commands of the tests."""
    sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "identification")]
    import test_real_logs as real

    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pendulum = folder / "pendulum.urdf"
        pendulum.write_text(real.PENDULUM, "utf-8")
        simple = real.LOGS / "dfki_simple_pendulum"

        def add(what: str, *arguments: Any) -> None:
            found[what] = chosen(real.identified(folder, *arguments))

        found["TX40"] = chosen(real.tx40(folder))
        first, second, compensated = map(real.pendulum_log, ("060143", "060245", "063536"))
        add("double pendulum, second from first", pendulum, first, "--test", second, "--cutoff", 5)
        add("double pendulum, first from second", pendulum, second, "--test", first, "--cutoff", 5)
        add("friction compensated, alone", pendulum, compensated, "--cutoff", 5)
        add("friction compensated, as a test", pendulum, first, "--test", compensated, "--cutoff", 5)
        add("simple pendulum", simple / "dfki_simple_pendulum.urdf", simple / "sysid_pd_measured.csv")
        tiago = "+".join(str(real.LOGS / "tiago" / f"tiago_{part}.csv") for part in TIAGO)
        add("TIAGo", "tiago", tiago, "--lock-missing", "--cutoff", 5)
    return found


def chosen(found: dict[str, Any]) -> dict[str, Any]:
    """What the page shows of it."""
    return {
        "verdict": found["verdict"],
        "groups": found["base_parameters"],
        "held out": {key: rounded(found["held_out"][key]) for key in ("kind", "all", "joints")},
        "settings": {key: rounded(found["settings"][key]) for key in ("cutoff", "shift")},
        "doubts": [{key: doubt[key] for key in ("kind", "joints")} for doubt in found["doubts"]],
    }


def rounded(x: Any) -> Any:
    """To three digits."""
    if isinstance(x, dict):
        return {key: rounded(value) for key, value in x.items()}
    return float(f"{x:.3g}") if isinstance(x, float) else x


if __name__ == "__main__":
    KEPT.write_text(json.dumps({"date": date.today().isoformat(), **results()}, indent=1) + "\n", "utf-8")
    print(KEPT.read_text("utf-8"))
