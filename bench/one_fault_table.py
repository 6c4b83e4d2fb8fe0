"""Tables of the logs with one fault: counts, kinds, wrong first words, and ONE_FAULT.md. python -m bench.one_fault_table"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.markdown import section
from bench.one_fault import HALVES, KEPT, PARTS, POINTS, classified

PAGE = Path(__file__).with_name("ONE_FAULT.md")
LABELS = ("before", "now")
WRONG = ("wrong OK", "false OVER LIMIT", "false doubt", "crash")
_LETTERS = {"OK": "O", "UNSURE": "U", "LOOK AGAIN": "L", "OVER LIMIT": "!", "refused": "R"}
_LENGTH = 150

_INTRODUCTION = """# Logs with one fault

Logs of known motions with one fault each, and clean ones: first words of `torques`, beside those of Pinocchio on the same
file with its own differentiation, and on the exact motion. Made by `python -m bench.one_fault {parts}`, which writes
`one_fault.json`, and `python -m bench.one_fault_table`, which writes this page.

* A fault can be told if Pinocchio's share of a limit on the faulty log differs from that on the clean log by more than {points}
  points, or if its word does; the others are excluded.
* A wrong OK is an OK where the true motion passes a limit, or whose share differs from the true one by more than {points}
  points.
* A false OVER LIMIT is one where the true motion passes no limit.
* A doubt on a clean log is false unless its cause is in the log or in the robot's file: limits that are missing, or
  placeholders, a base that nothing holds, knocks, noise, a load within {near} points of a limit.

Words: O is OK, U UNSURE, L LOOK AGAIN, ! OVER LIMIT, R a file that is refused.
† The log has no trace of the fault: no measured torques, and positions within the stops."""

Row = dict[str, Any]
Runs = dict[str, dict[str, list[Row]]]
"""Rows by label and part."""


def kept() -> tuple[Runs, dict[str, Any]]:
    """Rows that are kept, and what they ran on."""
    found = json.loads(KEPT.read_text("utf-8"))
    rows: Runs = {}
    for label, parts in found.items():
        rows[label] = {part: [classified(row) for row in run["logs"]] for part, run in parts.items()}
    return rows, found


def told(rows: Sequence[Row]) -> list[Row]:
    """Rows whose fault the judge can tell."""
    return [row for row in rows if row["class"] != "excluded"]


def _count(rows: Sequence[Row], kind: str) -> str:
    return f"{sum(row['class'] == kind for row in rows)} of {len(rows)}" if rows else "–"


def targets(runs: Runs) -> str:
    """Table of the counts that the benchmark is for."""
    rows = []
    for half in HALVES:
        some = [told(runs.get(label, {}).get(half, [])) for label in LABELS]
        rows += [
            [f"{kind}, {half} kinds: 0", *(_count(x, kind) for x in some)] for kind in WRONG if kind != "false doubt"
        ]
        bare = [[row for row in x if row["class"] in WRONG and not row["trace"]] for x in some]
        rows.append([f"of these without a trace in the log, {half} kinds", *(str(len(x)) for x in bare)])
        every = [runs.get(label, {}).get(half, []) for label in LABELS]
        rows.append([f"excluded, {half} kinds", *(_count(x, "excluded") for x in every)])
    clean = [runs.get(label, {}).get("clean", []) for label in LABELS]
    for kind in WRONG:
        most = "at most 1" if kind == "false doubt" else "0"
        rows.append([f"{kind}, clean logs: {most}", *(_count(x, kind) for x in clean)])
    return section("Counts", "", ["first word: target", *LABELS], rows)


def by_kind(runs: Runs, half: str) -> str:
    """Table of the words of each kind."""
    names = list(dict.fromkeys(row["kind"] for label in LABELS for row in runs.get(label, {}).get(half, [])))
    rows = []
    for name in names:
        cells = [name]
        for label in LABELS:
            here = [row for row in runs.get(label, {}).get(half, []) if row["kind"] == name]
            some = told(here)
            wrong = Counter(row["class"] for row in some if row["class"] in WRONG)
            words = "".join(_LETTERS.get(row["word"], "?") for row in some)
            cells += [
                words or "–",
                ", ".join(f"{n} {kind}" for kind, n in wrong.items()) or "–",
                str(len(here) - len(some)),
            ]
        rows.append(cells)
    head = ["kind", *(f"{what}, {label}" for label in LABELS for what in ("words", "wrong", "excluded"))]
    return section(f"Kinds, {half} half", "", head, rows)


def wrong_words(runs: Runs, part: str) -> str:
    """Table of the wrong first words of the newest run of a part."""
    label = next((label for label in reversed(LABELS) if part in runs.get(label, {})), None)
    rows = [] if label is None else [row for row in runs[label][part] if row["class"] in WRONG]
    lines = [
        [
            str(row["number"]),
            row["robot"],
            row["kind"] or row["style"],
            _judged(row["truth"]),
            _judged(row["faulty"]),
            row["class"] + ("" if row.get("trace", True) else " †"),
            row["first"][:_LENGTH].replace("|", "/"),
        ]
        for row in rows
    ]
    head = ["log", "robot", "kind", "truth", "as written", "class", "first line"]
    return section(f"Wrong first words, {part}, {label}", "", head, lines)


def _commits(rows: Sequence[Row]) -> str:
    """Commits of the program, with the numbers of logs where there are several."""
    found = Counter(row["commit"] for row in rows)
    if len(found) == 1:
        return f"commit {next(iter(found))}"
    return ", ".join(f"{n} logs on commit {commit}" for commit, n in found.items())


def _judged(judgement: dict[str, Any]) -> str:
    return f"{judgement['word']} {100 * judgement['share']:.3g} %"


def clean_words(runs: Runs) -> str:
    """Table of the classes of clean logs by robot."""
    names = list(dict.fromkeys(row["robot"] for label in LABELS for row in runs.get(label, {}).get("clean", [])))
    rows = []
    for name in names:
        cells = [name]
        for label in LABELS:
            here = Counter(row["class"] for row in runs.get(label, {}).get("clean", []) if row["robot"] == name)
            cells.append(", ".join(f"{n} {kind}" for kind, n in sorted(here.items())) or "–")
        rows.append(cells)
    return section("Clean logs, by robot", "", ["robot", *LABELS], rows)


def page() -> str:
    """Text of ONE_FAULT.md."""
    runs, about = kept()
    ran = [
        f"{label}, {part}: {_commits(run['logs'])}, {run['date']}, {run['cpu']}, Python {run['python']}"
        for label, parts in about.items()
        for part, run in parts.items()
    ]
    text = [
        _INTRODUCTION.format(parts=" ".join(PARTS), points=f"{100 * POINTS:.0f}", near=f"{200 * POINTS:.0f}"),
        "\n".join(f"* {line}" for line in ran),
        targets(runs),
        *(by_kind(runs, half) for half in HALVES),
        clean_words(runs),
        *(wrong_words(runs, part) for part in PARTS),
    ]
    return "\n\n".join(filter(None, text)) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
