"""Logs with one fault: the first word of ``torques`` on each, beside that of an independent judge on the log and on the truth.

    python -m bench.one_fault [PART ...] [--label now] [--lines FILE] [--first N] [--only TEXT]

runs the parts (open, held-out, clean). A whole part is kept in one_fault.json, and one_fault_table.py makes ONE_FAULT.md of it.

    python -m bench.one_fault --write FOLDER --part open --number 17

writes one log, with the command that judges it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from tests.faulty_logs.runs import as_text
from tests.faulty_logs.truth import generator

import twistwrench as tw
from bench.machine import describe
from bench.one_fault_judge import Judge, judge_of
from bench.one_fault_kinds import Fault
from bench.one_fault_logs import FORMS, LEVELS, RATES, STYLES, Recording, recording, write
from bench.one_fault_robots import ROBOTS, Mechanism
from twistwrench.cli.main import main as command

KEPT = Path(__file__).with_name("one_fault.json")
HALVES = {"open": "bench.one_fault_open", "held-out": "bench.one_fault_held_out"}
PARTS = (*HALVES, "clean")
LOGS_OF_HALF, CLEAN = 100, 200
POINTS = 0.05
"""Difference of shares from which a fault can be told, and beyond which a share is another."""
_MEASURED, _MEASURED_OF_MANY, _MANY = 0.5, 0.1, 7
"""Shares of logs with measured torques: of robots of so many joints at most, and of larger ones, which take minutes."""
_SAMPLES = 500
_LENGTH = 240
"""Letters of a first line that are kept."""


@dataclass(frozen=True)
class Task:
    """One log to be made and judged."""

    part: str
    number: int
    robot: str
    style: str
    rate: float
    level: float
    measured: bool
    form: str
    kind: str = ""

    def recording(self) -> Recording:
        """The log before its fault."""
        return recording(
            self.robot, self.number, self.style, self.rate, self.level, measured=self.measured, form=self.form
        )


def kinds(part: str) -> dict[str, Fault]:
    """Kinds of faults of a half."""
    return {kind.name: kind for kind in importlib.import_module(HALVES[part]).KINDS}


def tasks(part: str) -> Iterator[Task]:
    """Logs of a part; robots whose file is absent are left out."""
    there = [robot for robot in ROBOTS.values() if robot.path is not None]
    if part == "clean":
        for number in range(CLEAN):
            robot = there[number % len(there)]
            yield drawn(part, number, robot, None, list(STYLES)[(number // len(there) + number) % len(STYLES)])
        return
    every = list(kinds(part).values())
    styles = [style for style in STYLES if style != "impacts"]
    for number in range(LOGS_OF_HALF):
        kind = every[number % len(every)]
        able = [robot for robot in there if robot.faulty and fits(kind, judge_of(robot.name))]
        robot = able[(number + 3 * (number // len(every))) % len(able)]
        yield drawn(part, number, robot, kind, styles[(number + number // len(every)) % len(styles)])


def fits(kind: Fault, judge: Judge) -> bool:
    """True if a robot can have logs with this fault."""
    needs, limits = kind.needs, judge.limits
    known = bool(np.isfinite(limits.effort).all()) and not judge.mechanism.placeholder
    return (
        (not needs.turns or bool(judge.turns.any()))
        and (not needs.slides or not judge.turns.all())
        and (not needs.efforts or known)
        and (not needs.velocities or bool(np.isfinite(limits.velocity).all()))
    )


def drawn(part: str, number: int, robot: Mechanism, kind: Fault | None, style: str) -> Task:
    """A log of a robot with a fault, or clean: its rate, format and load are drawn."""
    rng = generator(robot.name, number, part)
    needs = None if kind is None else kind.needs
    rates = [rate for rate in RATES if rate >= 20 * min(robot.fastest, 1.0)]
    if needs is not None and needs.rate:
        rates = [needs.rate]
    forms = list(FORMS) if needs is None or not needs.forms else list(needs.forms)
    if robot.floats:
        forms = [form for form in forms if form != "bag"]
    measured = bool(rng.random() < (_MEASURED if len(judge_of(robot.name).names) <= _MANY else _MEASURED_OF_MANY))
    if needs is not None and needs.measured is not None:
        measured = needs.measured
    level = LEVELS[number % len(LEVELS)] if kind is None else LEVELS[(number // 3) % len(LEVELS)]
    rate, form = float(rng.choice(rates)), str(rng.choice(forms))
    return Task(part, number, robot.name, style, rate, level, measured, form, "" if kind is None else kind.name)


# ── Scores


def score(task: Task) -> dict[str, Any]:
    """Words of the program and of the judge on one log."""
    made = task.recording()
    judge, seconds = made.judge, len(made.t) / made.rate
    truth = judge.of_motion(made.motion, np.linspace(0.0, seconds, _SAMPLES))
    clean = made.judged()
    row: dict[str, Any] = {"part": task.part, "number": task.number, "robot": task.robot, "kind": task.kind}
    row |= {"commit": commit(), "style": task.style, "rate": task.rate, "form": task.form, "measured": task.measured}
    if task.kind:
        kinds(task.part)[task.kind].change(made)
    faulty = made.judged()
    row |= {"value": made.value, "rows": len(made.t)}
    for name, judgement in (("truth", truth), ("clean", clean), ("faulty", faulty)):
        row[name] = {"share": _rounded(judgement.share), "torque": _rounded(judgement.torque), "word": judgement.word}
    row |= said(task, made)
    return classified(row)


def said(task: Task, made: Recording) -> dict[str, Any]:
    """First word and line of ``torques``, and the largest share of a torque limit that it reports."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        arguments, found = arguments_of(task, made, Path(folder)), Path(folder) / "said.json"
        before = time.process_time()
        result = CliRunner().invoke(command, [*arguments, "--json", str(found)])
        row = {"seconds": round(time.process_time() - before, 2), "exit": result.exit_code}
        first = _first_line(result.stdout or result.output, task, folder)
        shares = _shares(json.loads(found.read_text("utf-8"))) if found.is_file() else []
    word = "refused" if result.exit_code == 2 else "CRASH"
    if result.exit_code in (0, 1):
        words = ("OK", "UNSURE", "OVER LIMIT", "LOOK AGAIN")
        word = next((w for w in words if first.startswith(w)), "OTHER")
    if word == "CRASH":
        first = repr(result.exception)
    return row | {"word": word, "share": _rounded(max(shares, default=0.0)), "first": first[:_LENGTH]}


def _first_line(text: str, task: Task, folder: str) -> str:
    """First paragraph of an answer on one line, files without their folders."""
    line = " ".join(text.split("\n\n", maxsplit=1)[0].split())
    for place in (folder, str(Path(str(ROBOTS[task.robot].path)).parent)):
        line = line.replace(f"{place}/", "")
    return line


def arguments_of(task: Task, made: Recording, folder: Path) -> list[str]:
    """Arguments of the command for a log written into a folder."""
    robot = ROBOTS[task.robot]
    return ["torques", str(robot.path), *robot.options, *write(made, folder)]


def _shares(report: dict[str, Any]) -> list[float]:
    """Shares of torque limits in the report's first table."""
    for table in report["tables"]:
        names = [column["name"] for column in table["columns"]]
        if table["title"].startswith("Torques") and {"peak", "limit"} <= set(names):
            peak, limit = names.index("peak"), names.index("limit")
            rows = [(row[peak], row[limit]) for row in table["rows"]]
            return [abs(p) / m for p, m in rows if p is not None and m is not None and math.isfinite(m) and m > 0]
    return []


def classified(row: dict[str, Any]) -> dict[str, Any]:
    """The row with the class of its first word, and for faults whether the log has a trace of it."""
    if row["part"] == "clean":
        return row | {"class": clean_class(row)}
    faulty = row["faulty"]
    beyond = faulty["word"] == "OVER LIMIT" and faulty["share"] <= 1
    trace = kinds(row["part"])[row["kind"]].trace == "always" or row["measured"] or beyond
    return row | {"class": fault_class(row), "trace": trace}


def fault_class(row: dict[str, Any]) -> str:
    """Class of a first word on a faulty log; excluded where the judge cannot tell the fault."""
    clean, faulty, truth = row["clean"], row["faulty"], row["truth"]
    apart = max(abs(clean[name] - faulty[name]) for name in ("share", "torque"))
    if clean["word"] == faulty["word"] and apart <= POINTS:
        return "excluded"
    if row["word"] == "OK":
        right = truth["word"] == "OK" and abs(row["share"] - truth["torque"]) <= POINTS
        return "right" if right else "wrong OK"
    if row["word"] == "OVER LIMIT":
        return "right" if truth["word"] == "OVER LIMIT" else "false OVER LIMIT"
    return "doubt" if row["word"] in kinds(row["part"])[row["kind"]].allowed else "crash"


def clean_class(row: dict[str, Any]) -> str:
    """Class of a first word on a clean log."""
    truth, robot = row["truth"], ROBOTS[row["robot"]]
    if row["word"] == truth["word"]:
        return "right"
    if row["word"] == "OK":
        return "wrong OK" if truth["share"] > 1 + POINTS else "right"
    if row["word"] == "OVER LIMIT":
        return "right" if truth["share"] > 1 - POINTS else "false OVER LIMIT"
    if row["word"] != "UNSURE":
        return "false doubt"
    limits = judge_of(robot.name).limits
    unknown = not np.isfinite(limits.effort).all() or robot.placeholder
    why = {
        "limits": unknown and "limit" in row["first"],
        "base": robot.floats,
        "knocks": row["style"] == "impacts",
        "near": abs(truth["share"] - 1) < 2 * POINTS,
        "noise": "noise" in row["first"] or "σ" in row["first"],
    }
    cause = next((name for name, holds in why.items() if holds), "")
    return f"doubt: {cause}" if cause else "false doubt"


def _rounded(x: float) -> float:
    return float(f"{x:.4g}") if math.isfinite(x) else 1e9


# ── Runs


def scores(wanted: Sequence[Task], lines: Path | None) -> Iterator[dict[str, Any]]:
    """Scores of logs; those that ``lines`` has already are not made again."""
    old = [json.loads(text) for text in lines.read_text("utf-8").splitlines()] if lines and lines.is_file() else []
    done = {(row["part"], row["number"]): row for row in old}
    for task in wanted:
        row = done.get((task.part, task.number))
        if row is not None:
            row = classified(row)
        else:
            row = score(task)
            if lines is not None:
                with lines.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
        what, shares = row["kind"] or row["style"], [row[name]["share"] for name in ("truth", "faulty")]
        told = f"{row['robot']:12s} {what:34s} {shares[0]:7.2f} {shares[1]:9.3g} {row['class']:18s}"
        print(f"{row['number']:3d} {told} {row['first'][:110]}", flush=True)
        yield row


@cache
def commit() -> str:
    """Commit of the program that is run."""
    where = ["git", "-C", str(Path(tw.__file__).parent), "rev-parse", "--short", "HEAD"]
    return subprocess.run(where, capture_output=True, text=True, check=True).stdout.strip()


def keep(label: str, part: str, rows: list[dict[str, Any]]) -> None:
    """Put the rows of a part beside what is kept, with the processor; each row has the commit of the program."""
    kept = json.loads(KEPT.read_text("utf-8")) if KEPT.is_file() else {}
    about = {key: describe()[key] for key in ("date", "cpu", "python")}
    kept.setdefault(label, {})[part] = {**about, "logs": rows}
    KEPT.write_text(as_text(kept), "utf-8")


def same_in_the_shell(wanted: Sequence[Task]) -> None:
    """Stop if the command in a process of its own says something else on any of these logs."""
    for task in wanted:
        made = task.recording()
        if task.kind:
            kinds(task.part)[task.kind].change(made)
        inside = said(task, made)
        with tempfile.TemporaryDirectory() as folder:
            arguments = arguments_of(task, made, Path(folder))
            shell = subprocess.run(
                [sys.executable, "-W", "ignore", "-m", "twistwrench", *arguments], capture_output=True, text=True
            )
        text = shell.stdout if shell.returncode in (0, 1) else shell.stderr
        first = _first_line(text, task, folder)[:_LENGTH]
        if (shell.returncode, first) != (inside["exit"], inside["first"]):
            raise SystemExit(f"{task}: the shell says {first!r}, in the process it is {inside['first']!r}.")
    print(f"{len(wanted)} logs: the same in a shell")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--label", default="now", help="under which results are kept: before, or now")
    parser.add_argument("--lines", type=Path, help="file of a row a log, from which a run that was stopped goes on")
    parser.add_argument("--first", type=int, help="so many logs of a part at most; nothing is kept then")
    parser.add_argument(
        "--only", default="", help="logs whose robot, kind or style has this text; nothing is kept then"
    )
    parser.add_argument("--shell", type=int, help="compare every so many logs with the command in a shell")
    parser.add_argument("--part", choices=PARTS, default="open")
    parser.add_argument("--number", type=int, default=0)
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write one log of --part")
    given = parser.parse_args()
    if given.write:
        task = list(tasks(given.part))[given.number]
        made = task.recording()
        if task.kind:
            kinds(task.part)[task.kind].change(made)
        given.write.mkdir(parents=True, exist_ok=True)
        print("twistwrench", *arguments_of(task, made, given.write))
    for part in given.parts:
        wanted = [t for t in tasks(part) if given.only in f"{t.robot} {t.kind} {t.style}"][: given.first]
        if given.shell:
            same_in_the_shell(wanted[:: given.shell])
            continue
        rows = list(scores(wanted, given.lines))
        if not (given.only or given.first):
            keep(given.label, part, rows)


if __name__ == "__main__":
    main()
