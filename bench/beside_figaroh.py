"""Identification of a real log beside FIGAROH: error on another log, processor time and lines of user code.

    python -m bench.beside_figaroh PYTHON

PYTHON is an interpreter of an environment with FIGAROH (``pip install figaroh``). The logs are no part of the repository;
tests/support/places.py says where they lie. Writes figaroh.json and FIGAROH.md.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from .machine import describe

HERE = Path(__file__).parent
KEPT, PAGE = HERE / "figaroh.json", HERE / "FIGAROH.md"
TURNS = 3
OURS = """
import json, sys, time
import twistwrench as tw
found = tw.identify(sys.argv[1], sys.argv[2], test=[sys.argv[3]], cutoff=5.0)
print(json.dumps({"groups": len(found.base.names), "all": found.held_out.all, "joints": list(found.held_out.joints.values()),
                  "verdict": found.headline, "delay": found.settings.shift, "seconds": time.process_time()}))
"""
_HEAD = """# A real log beside FIGAROH

DFKI's double pendulum: parameters from one log, error of the torques of the other, as a share of their size (rms), and by
joint. Made by `python -m bench.beside_figaroh PYTHON`; both low-passed at 5 Hz, with viscous and Coulomb friction, motor
inertia and offset of each joint, in fresh processes in turn. FIGAROH {version} finds no delay between torques and positions;
ours does ({delay} ms here). Its part is `peer_figaroh.py`, {lines} lines of user code; ours is one call. Processor: {cpu}.

| from, to | FIGAROH | ours | first line of ours |
| --- | --- | --- | --- |
"""


def measured(command: list[str]) -> dict[str, Any]:
    """Result of a fresh process, whose last line is JSON."""
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    result: dict[str, Any] = json.loads(done.stdout.strip().split("\n")[-1])
    return result


def results(python: str) -> dict[str, Any]:
    """Both programs on both pairs of logs, with the least processor time of three turns."""
    sys.path[:0] = [str(HERE.parent / "tests" / "support"), str(HERE.parent / "tests" / "identification")]
    import test_real_logs as real

    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        ours, theirs = Path(name) / "ours.urdf", Path(name) / "theirs.urdf"
        ours.write_text(real.PENDULUM.strip(), "utf-8")
        limit = '<axis xyz="0 1 0"/><limit lower="-20" upper="20" effort="10" velocity="50"/>'
        turning = real.PENDULUM.strip().replace('"continuous"', '"revolute"').replace('<axis xyz="0 1 0"/>', limit)
        theirs.write_text(turning, "utf-8")
        for train, test in (("060143", "060245"), ("060245", "060143")):
            logs = [str(real.pendulum_log(stamp)) for stamp in (train, test)]
            commands = {
                "figaroh": [python, str(HERE / "peer_figaroh.py"), str(theirs), *logs],
                "ours": [sys.executable, "-c", OURS, str(ours), *logs],
            }
            turns = [{who: measured(command) for who, command in commands.items()} for _ in range(TURNS)]
            found[f"{train} → {test}"] = {
                who: turns[0][who] | {"seconds": min(turn[who]["seconds"] for turn in turns)} for who in commands
            }
    return found


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def page(found: dict[str, Any], cpu: str) -> str:
    """Markdown of the results."""
    source = (HERE / "peer_figaroh.py").read_text("utf-8").partition("CUTOFF")[2].partition("if __name__")[0]
    lines = sum(bool(line.strip()) and '"""' not in line for line in source.split("\n"))
    delays = " and ".join(f"{-1e3 * pair['ours']['delay']:.0f}" for pair in found.values())
    version = next(iter(found.values()))["figaroh"]["version"]
    text = _HEAD.format(version=version, delay=delays, lines=lines, cpu=cpu)
    for logs, pair in found.items():
        cells = [
            f"{_percent(pair[who]['all'])} ({', '.join(map(_percent, pair[who]['joints']))}), {pair[who]['seconds']:.1f} s"
            for who in ("figaroh", "ours")
        ]
        text += f"| {logs} | {' | '.join(cells)} | {pair['ours']['verdict']} |\n"
    return text


if __name__ == "__main__":
    processor = describe()["cpu"]
    kept = results(sys.argv[1])
    KEPT.write_text(json.dumps({"cpu": processor, **kept}, indent=1, ensure_ascii=False) + "\n", "utf-8")
    PAGE.write_text(page(kept, processor), "utf-8")
