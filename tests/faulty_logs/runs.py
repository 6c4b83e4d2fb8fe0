"""Faulty logs of known robots: what the program says of them, whether it names the cause, and how wrong its torques are.

    python -m tests.faulty_logs [PART ...] [--robots ur5 ...] [--cases "tilt 3 deg" ...] [--processes N]

runs the parts (faults, clean, ordinary, laws, pauses, more, tuned, untouched). A whole part is kept in
bench/faulty_logs.json, and table.py makes bench/FAULTY_LOGS.md of it; a selection is only printed.

    python -m tests.faulty_logs --case "tilt 3 deg" --robot ur5 --write FILE.npz

writes one log with its truth (FILE.csv: without it); ``log("ur5", "tilt 3 deg", seed=0)`` gives it in Python.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bench.machine import describe

import twistwrench as tw

from .cases import Case, Recording
from .parts import CASES, PARTS, Task, motion_of, recording, tasks
from .score import score
from .truth import ARMS, ROOT

KEPT = ROOT / "bench" / "faulty_logs.json"


def log(robot: str, case: str, seed: int = 0) -> tuple[tw.Robot, tw.Motion, Recording]:
    """The robot as in its file, a log of it, and what is true of it (``.truth``, ``.value``)."""
    made = recording(robot, CASES[case], seed)
    return made.truth.file, motion_of(made), made


def write(path: Path, robot: str, case: Case, seed: int) -> None:
    """Times, positions and torques of a log (.npz, or .csv without the truth), its robot, and what is expected."""
    made = recording(robot, case, seed)
    if path.suffix == ".csv":
        motion_of(made).to_csv(path)
        return
    expected = {"case": case.name, "causes": case.causes, "told": case.told, "value": {**case.value, **made.value}}
    truth = made.truth
    np.savez(
        path,
        time=made.t,
        q=made.q,
        tau=made.tau,
        robot=robot,
        expected=json.dumps(expected),
        parameters=truth.robot.parameters,
        parameter_names=truth.robot.parameter_names,
        gravity=truth.gravity,
        **truth.drives,
    )


def scores(wanted: Sequence[Task], processes: int, lines: Path | None, *, quick: bool) -> Iterator[dict[str, Any]]:
    """Scores of logs; those that ``lines`` has already are not made again."""
    old = [json.loads(text) for text in lines.read_text("utf-8").splitlines()] if lines and lines.is_file() else []
    done = {(row["part"], row["robot"], row["case"], row["seed"]) for row in old}
    rest = [task for task in wanted if (task.part, task.robot, task.name, task.seed) not in done]
    names = {(task.part, task.robot, task.name, task.seed) for task in wanted}
    yield from (row for row in old if (row["part"], row["robot"], row["case"], row["seed"]) in names)
    one = partial(score, quick=quick)
    if processes > 1:
        with ProcessPoolExecutor(processes) as pool:
            yield from _noted(pool.map(one, rest), lines)
    else:
        yield from _noted(map(one, rest), lines)


def _noted(rows: Iterator[dict[str, Any]], lines: Path | None) -> Iterator[dict[str, Any]]:
    """The same rows, each written to a file and shown."""
    for row in rows:
        said = ", ".join(doubt["name"] + ("!" if doubt["refuses"] else "") for doubt in row["doubts"]) or "-"
        off = f"{100 * row['wrong']:.1f} %" if "wrong" in row else row.get("error", "")
        print(f"{row['robot']:10s} {row['case']:42s} {row['verdict']:10s} {off:8s} {said}", flush=True)
        if lines is not None:
            with lines.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        yield row


def keep(label: str, part: str, rows: list[dict[str, Any]], which: str) -> None:
    """Put the rows of a part beside what is kept, with the commit of the program and the processor."""
    kept = json.loads(KEPT.read_text("utf-8")) if KEPT.is_file() else {}
    where = Path(tw.__file__).parent
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=where, capture_output=True, text=True, check=True
    )
    told = {key: describe()[key] for key in ("date", "cpu", "python")}
    kept.setdefault(label, {})[part] = {"commit": commit.stdout.strip(), **told, "which": which, "logs": rows}
    KEPT.write_text(as_text(kept), "utf-8")


def as_text(kept: dict[str, dict[str, Any]]) -> str:
    """JSON of the results, a line for each log."""
    lean = {
        label: {part: run | {"logs": f"{label} {part}"} for part, run in runs.items()} for label, runs in kept.items()
    }
    text = json.dumps(lean, indent=1, ensure_ascii=False)
    for label, runs in kept.items():
        for part, run in runs.items():
            rows = ",\n".join(json.dumps(row, ensure_ascii=False) for row in run["logs"])
            text = text.replace(f'"logs": "{label} {part}"', f'"logs": [\n{rows}\n]')
    return text + "\n"


def _selection(given: argparse.Namespace) -> str:
    """Which logs of a part were run, and how."""
    parts = ["all" if given.every == 1 else f"one in {given.every}"]
    if given.first is not None:
        parts.append(f"the first {given.first}")
    if given.quick:
        parts.append("settings chosen once")
    return ", ".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--robots", nargs="+", help="only these")
    parser.add_argument("--cases", nargs="+", help="only these")
    parser.add_argument("--every", type=int, default=1, help="every so many logs of the part")
    parser.add_argument("--first", type=int, help="so many of these at most")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="settings chosen once, not for each fifth of the time")
    parser.add_argument("--lines", type=Path, help="file of a row a log, from which a run that was stopped goes on")
    parser.add_argument("--label", default="now", help="under which results are kept: before, or now")
    parser.add_argument("--list", action="store_true", help="names of the cases")
    parser.add_argument("--case", choices=CASES, help="one case, to be written")
    parser.add_argument("--robot", default="ur5", choices=ARMS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", type=Path, metavar="FILE", help=".npz or .csv")
    given = parser.parse_args()
    if given.list:
        print("\n".join(CASES))
    elif given.write:
        write(given.write, given.robot, CASES[given.case], given.seed)
    for part in given.parts:
        wanted = [
            task
            for task in tasks(part)[:: given.every][: given.first]
            if (not given.robots or task.robot in given.robots) and (not given.cases or task.name in given.cases)
        ]
        rows = list(scores(wanted, given.processes, given.lines, quick=given.quick))
        if not (given.robots or given.cases):
            keep(given.label, part, rows, _selection(given))


if __name__ == "__main__":
    main()
