"""The same programs in other packages, beside who writes for those packages: `python -m bench.bridges [--only SECTION]`.

Writes bridges.json and BRIDGES.md after each section. Every contender is compared with our
kernels before anything is timed; what is missing is said. `--render` times nothing. What it needs: `make bench-bridges`.
"""

import argparse
import importlib
import json
import tempfile
import warnings
from pathlib import Path
from typing import Any

from bench import bridge_tables, machine
from bench.timing import pin_to_one_core

HERE = Path(__file__).parent
RESULTS, REPORT = HERE / "bridges.json", HERE / "BRIDGES.md"
ROUNDS = 9
SECTIONS = {
    "jax": "bridge_jax.times",
    "torch": "bridge_torch.times",
    "casadi": "bridge_casadi.times",
    "optimal_control": "bridge_casadi.optimal_control",
    "javascript": "bridge_javascript.times",
}
"""The function that measures each: of the robot, and of how many rounds."""


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.bridges", description="Time functions of other packages, on one core."
    )
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="interleaved repeats (default %(default)s)")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--only", choices=SECTIONS, help="time this section alone and keep the others' results")
    what.add_argument("--render", action="store_true", help="only write the tables again, from bridges.json")
    options = parser.parse_args()
    results = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    write(results)
    if not options.render:
        pin_to_one_core()
        for section in [options.only] if options.only else SECTIONS:
            print(section.replace("_", " "), flush=True)
            results[section] = measured(section, options.rounds)
            write(results)
    print(f"wrote {REPORT}")


def measured(section: str, rounds: int) -> dict[str, Any]:
    """One section, and where and with what it was measured."""
    from bench.bridge_panda import Panda, installed

    module, function = SECTIONS[section].split(".")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the peers
        found = getattr(importlib.import_module(f"bench.{module}"), function)(Panda(Path(folder)), rounds)
    found["packages"] = installed("twistwrench", "numpy") | found["packages"]
    return {"machine": machine.describe(), "rounds": rounds, **found}


def write(results: dict[str, Any]) -> None:
    results = {section: results[section] for section in SECTIONS if section in results}
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", "utf-8")
    REPORT.write_text(bridge_tables.report(results), "utf-8")


if __name__ == "__main__":
    main()
