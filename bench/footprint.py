"""What comes before the first torque: import, load, compile, install. Every time is of a fresh process."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from bench import machine
from bench.cases import CASES, COMPARED, QUANTITIES, Case

ROOT = Path(__file__).parents[1]
CACHE = "TWISTWRENCH_CACHE_DIR"
ROUNDS = 9
ENOUGH = 15.0  # seconds of compiling a robot's kernels over and over

TORQUE = """
import twistwrench as tw
robot = tw.load({path!r}, lock=dict.fromkeys({locked!r}, 0.0), inertia="accept", mimic="independent")
robot.inverse_dynamics([0.1] * 7, [0.2] * 7, [0.3] * 7)
"""
PINOCCHIO_TORQUE = """
import numpy as np, pinocchio as pin
model = pin.buildModelFromUrdf({path!r})
model = pin.buildReducedModel(model, [model.getJointId(name) for name in {locked!r}], pin.neutral(model))
pin.rnea(model, model.createData(), np.full(7, 0.1), np.full(7, 0.2), np.full(7, 0.3))
"""
KERNELS = """
import json, time
from bench.cases import CASES, QUANTITIES
from bench.ours import kernel, load
case = next(c for c in CASES if c.name == {name!r})
seconds, start = {{}}, time.perf_counter()
robot = load(case)
for what in ("load", *QUANTITIES):
    if what in QUANTITIES:
        kernel(robot, case, what)
    now = time.perf_counter()
    seconds[what], start = now - start, now
print(json.dumps(seconds))
"""
TOGETHER = """
import json, time
from bench.cases import CASES, COMPARED
from bench.ours import kernel, load
from twistwrench.compiler.runtime.gufunc import owner_of
from twistwrench.compiler.lowering.target_machine import SINGLE
robot = load(case := next(c for c in CASES if c.name == {name!r}))
wall, processor = time.perf_counter(), time.process_time()
for quantity in COMPARED:
    kernel(robot, case, quantity)
owner_of(kernel(robot, case, COMPARED[0])).address(SINGLE)
print(json.dumps({{"wall": time.perf_counter() - wall, "processor": time.process_time() - processor}}))
"""


def start_times(case: Case, rounds: int = ROUNDS) -> dict[str, float]:
    """Seconds from starting Python to its exit, medians of interleaved rounds."""
    names = {"path": str(case.path), "locked": list(case.locked)}
    programs = {
        "python alone": "pass",
        "import numpy": "import numpy",
        "import twistwrench": "import twistwrench",
        "import pinocchio": "import pinocchio",
        "first torque, no cache": TORQUE.format(**names),
        "first torque, cache": TORQUE.format(**names),
        "first torque, Pinocchio": PINOCCHIO_TORQUE.format(**names),
    }
    seconds: dict[str, list[float]] = {name: [] for name in programs}
    with tempfile.TemporaryDirectory() as kept:
        for code in programs.values():
            _python(code, kept)  # byte code written, files in the system's cache
        for _ in range(rounds):
            for name, code in programs.items():
                with tempfile.TemporaryDirectory() as fresh:
                    start = time.perf_counter()
                    _python(code, fresh if "no cache" in name else kept)
                    seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(each) for name, each in seconds.items()}


def kernel_times(case: Case, rounds: int = 3) -> dict[str, dict[str, float]]:
    """Seconds to load the robot's file and to make each kernel: compiled, and then from the cache."""
    runs: dict[str, list[dict[str, float]]] = {"compiled": [], "cached": []}
    code = KERNELS.format(name=case.name)
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            for kind in runs:  # the first run fills the cache that the second one finds
                runs[kind].append(json.loads(_python(code, cache)))
    return {
        kind: {what: statistics.median(run[what] for run in each) for what in ("load", *QUANTITIES)}
        for kind, each in runs.items()
    }


def compile_times(rounds: int = 3, cases: tuple[Case, ...] = CASES) -> dict[str, Any]:
    """Seconds to compile, without a cache, the kernels that are compared: all in float64, and the first in float32 too.

    Up to `rounds` processes a robot; no further one once they have taken long enough.
    """
    where = machine.describe()  # this section may be newer than the others
    results: dict[str, Any] = {"date": where["date"], "cpu": where["cpu"], "rounds": rounds}
    results["quantities"], results["robots"] = COMPARED, {}
    for case in cases:
        print(f"{case.name}: compiling all kernels", flush=True)
        runs: list[dict[str, float]] = []
        while len(runs) < rounds and sum(run["wall"] for run in runs) < ENOUGH:
            runs.append(json.loads(_python(TOGETHER.format(name=case.name), "off")))
        medians = {kind: statistics.median(run[kind] for run in runs) for kind in ("processor", "wall")}
        results["robots"][case.name] = {**medians, "processes": len(runs)}
    return results


def _python(code: str, cache: str) -> str:
    environment = {**os.environ, CACHE: cache}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # a user's second start finds byte code
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"a fresh Python failed at\n{code}\n{done.stderr}")
    return done.stdout


def installed_bytes() -> dict[str, int]:
    """Bytes on disk of a package and all that it requires, byte code left out."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    own = sum(f.stat().st_size for f in (ROOT / "src").rglob("*.*") if f.suffix != ".pyc" and f.is_file())
    return {
        "twistwrench": own + sum(map(_bytes, _closure(project["dependencies"]))),
        "Pinocchio (`pin`)": sum(map(_bytes, _closure(["pin", "numpy"]))),
    }


def _closure(requirements: list[str]) -> set[str]:
    """The names of all distributions that these requirements pull in on this machine."""
    found: set[str] = set()
    waiting = list(requirements)
    while waiting:
        requirement = Requirement(waiting.pop())
        name = requirement.name.lower().replace("_", "-")
        if name in found or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        waiting += distribution(name).requires or []
    return found


def _bytes(name: str) -> int:
    return sum(file.size or 0 for file in distribution(name).files or [])
