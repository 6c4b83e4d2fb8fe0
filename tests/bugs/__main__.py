"""Put each bug of the tables here (``*.toml``) in, one at a time, and see whether the tests notice: ``python -m tests.bugs``.

A bug is a text that stands once in a file of ``src``, what stands there in its place, and the test files of its room. Those
run first, stopped at the first failure; the whole suite runs for survivors only (``--whole``). Each bug goes into a copy of
``src``; nothing of the checkout is touched. Results are kept, a line of JSON each, so that a run goes on where it stopped;
a bug whose file or tests changed since is tried again.

A test that fails has noticed the bug, and so have tests that crash where they do not without it. Tests that have no end in the time allowed have noticed nothing: the bug counts as
``timed out``, beside the survivors, where the same tests end in that time without the bug; where they do not, the time
was too short to say anything, and no result is kept.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SOURCE = Path("src/twistwrench")


@dataclass(frozen=True)
class Bug:
    """One mistake that a person could make."""

    name: str
    file: str
    """Below ``src/twistwrench``."""
    right: str
    wrong: str
    tests: tuple[str, ...]
    """Below ``tests``, those of the bug's room."""

    @property
    def key(self) -> str:
        """Of the bug, its file and its tests as they are: what a kept result belongs to."""
        found = hashlib.sha256(repr(asdict(self)).encode())
        for path in (SOURCE / self.file, *(Path("tests") / t.partition("::")[0] for t in self.tests)):
            found.update((ROOT / path).read_bytes())
        return found.hexdigest()[:16]

    def put_into(self, source: Path) -> None:
        """Write the bug into a copy of ``src``."""
        path = source / "twistwrench" / self.file
        text = path.read_text("utf-8")
        if text.count(self.right) != 1:
            raise SystemExit(
                f"{self.name}: {self.right!r} stands {text.count(self.right)} times in {self.file}, not once"
            )
        path.write_text(text.replace(self.right, self.wrong), "utf-8")


def bugs() -> list[Bug]:
    """All bugs of all tables."""
    tables = [tomllib.loads(path.read_text("utf-8")) for path in sorted(Path(__file__).parent.glob("*.toml"))]
    rows: list[dict[str, Any]] = [row for table in tables for row in table["bug"]]
    return [Bug(**{**row, "tests": tuple(row["tests"])}) for row in rows]


NOTICED, SURVIVED, TIMED_OUT, TOO_SLOW = "noticed", "survived", "timed out", "too slow to say"
CRASH = "a crash"


def outcome(bug: Bug, tests: list[str], seconds: float) -> tuple[str, str]:
    """Noticed, and by which test; survived; timed out; or too slow to say: what the tests make of a bug."""
    test = failing(bug, tests, seconds)
    if test is None:
        return (TOO_SLOW if failing(None, tests, seconds) is None else TIMED_OUT), ""
    if test and failing(None, tests if test == CRASH else [test], seconds):
        raise SystemExit(f"{test} fails without a bug too, so it says nothing about {bug.name!r}. Mend it first.")
    return (NOTICED if test else SURVIVED), test


def failing(bug: Bug | None, tests: list[str], seconds: float) -> str | None:
    """The first test that fails with the bug in, or without any, or a crash; "" if none does; None if there is no end in time."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "src"
        shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("*.pyc.*"))  # bytecode saves seconds
        if bug:
            bug.put_into(source)
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "--no-header",
            "-p",
            "no:cacheprovider",
            "-m",
            "slow or not slow",
            *tests,
        ]
        environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            out, err = run.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            return None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)  # and what the tests have started
            run.communicate()
    if run.returncode == 0:
        return ""
    if run.returncode < 0:  # by a signal that was none of ours
        return CRASH
    failed = [line for line in out.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if run.returncode not in (1, 2) or not failed:
        raise SystemExit(
            f"{bug.name if bug else 'no bug'}: pytest ended with {run.returncode}\n{out[-2000:]}{err[-2000:]}"
        )
    return failed[0].partition(" - ")[0].partition(" ")[2]


def main() -> int:
    """Exit status 1 unless every bug is noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bugs", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="bugs to try; all if none is named")
    parser.add_argument("--whole", action="store_true", help="run the whole suite for those that survive their room")
    parser.add_argument("--seed", type=int, default=0, help="of the order in which they are tried")
    parser.add_argument("--count", type=int, help="how many to try")
    parser.add_argument("--seconds", type=float, default=1800.0, help="allowed for the tests of one bug")
    parser.add_argument("--results", type=Path, default=ROOT / ".bugs.jsonl", help="where results are kept")
    asked = parser.parse_args()

    chosen = [b for b in bugs() if not asked.names or b.name in asked.names]
    random.Random(asked.seed).shuffle(chosen)
    lines = asked.results.read_text("utf-8").splitlines() if asked.results.is_file() else []
    known = {entry["key"]: entry for entry in map(json.loads, lines) if "outcome" in entry}
    chosen = chosen[: asked.count]
    found: dict[str, list[str]] = {NOTICED: [], SURVIVED: [], TIMED_OUT: [], TOO_SLOW: []}
    for number, bug in enumerate(chosen, start=1):
        entry = known.get(bug.key)
        if entry is None or (asked.whole and entry["outcome"] != NOTICED and not entry["whole"]):
            how, by = (
                (entry["outcome"], "") if entry else outcome(bug, [f"tests/{t}" for t in bug.tests], asked.seconds)
            )
            whole = asked.whole and how in (SURVIVED, TIMED_OUT)
            if whole:
                how, by = outcome(bug, ["-n", "2", "tests"], 4 * asked.seconds)
            entry = {"name": bug.name, "key": bug.key, "outcome": how, "by": by, "whole": whole}
            if how != TOO_SLOW:
                with asked.results.open("a", encoding="utf-8") as kept:
                    kept.write(json.dumps(entry) + "\n")
        print(f"{number:3} {bug.name}: {entry['by'] or entry['outcome'].upper()}", flush=True)
        found[entry["outcome"]].append(bug.name)
    print(f"{len(chosen)} tried: {', '.join(f'{len(names)} {how}' for how, names in found.items())}")
    for how in (SURVIVED, TIMED_OUT, TOO_SLOW):
        for name in found[how]:
            print(f"  {how}: {name}")
    return 0 if len(found[NOTICED]) == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
