"""Tables of the faulty logs' scores: each case by robot, the targets, and FAULTY_LOGS.md. python -m tests.faulty_logs.table"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from bench.markdown import section

from .cases import FAULTS, Case
from .parts import CASES, LAWS, PAUSES, SECOND
from .score import NO_CAUSE
from .truth import ARMS, ROOT

KEPT = ROOT / "bench" / "faulty_logs.json"
PAGE = ROOT / "bench" / "FAULTY_LOGS.md"
LABELS = ("before", "now")
_LETTERS = {"OK": "O", "UNSURE": "U", "LOOK AGAIN": "L", "ERROR": "E"}
_RIGHT, _WRONG = 0.02, 0.05
"""Shares of torques of another motion: right to, and wrong by more than."""
_STILL = "dead-position"
"""Name of what is true of ordinary work: joints that did not move."""

Row = dict[str, Any]


def case_of(row: Row) -> Case:
    """The case of a row."""
    return {"laws": LAWS, "pauses": PAUSES}.get(row["part"], CASES).get(row["case"]) or Case(row["case"])


def causes(row: Row) -> list[str]:
    """Names of causes: of those that were fitted unasked, then in the order of the doubts."""
    fitted = row.get("fitted", []) if row.get("wrong", 1.0) <= _RIGHT else []
    return [*fitted, *_doubted(row)]


def _doubted(row: Row) -> list[str]:
    return [doubt["name"] for doubt in row["doubts"] if doubt["name"] not in NO_CAUSE]


def named(row: Row) -> str:
    """Name of the first doubt that says a cause, without those that may stand there besides; empty without any."""
    return next((name for name in causes(row) if name not in case_of(row).notes), "")


def right(row: Row) -> bool:
    """True if the first cause named is a right one, or rightly none."""
    case = case_of(row)
    return named(row) in case.causes if case.causes else not named(row)


def value_held(row: Row) -> bool | None:
    """True if the interval of the first cause, rightly named, holds its value; None where there is none to compare."""
    first = next((d for d in row["doubts"] if d["name"] == named(row)), None)
    if first is None or not right(row) or "interval" not in first:
        return None
    expected = case_of(row).value.get(first["name"])
    if not isinstance(expected, (int, float)):
        return None
    low, high = sorted(map(float, first["interval"]))
    return low <= expected <= high


# ── Targets


def targets(parts: dict[str, Any]) -> dict[str, str]:
    """Figure of each target, of the parts that were run."""
    rows = parts["faults"]["logs"] if "faults" in parts else []
    found: dict[str, str] = {}
    if rows:
        found |= _of_faults([row for row in rows if "wrong" in row])
    for part in ("clean", "ordinary", "laws"):
        if part in parts:
            found |= _of_clean(part, parts[part]["logs"])
    for part in SECOND:
        if part in parts:
            found |= _of_second(part, parts[part]["logs"])
    if "pauses" in parts:
        found |= _of_pauses(parts["pauses"]["logs"])
    every = [row for part in parts.values() for row in part["logs"] if "groups" in row]
    held = [row for row in every if row["verdict"] == "OK" and case_of(row).told]
    inside, groups = (sum(row[key] for row in held) for key in ("covered", "groups"))
    if groups:
        found["coverage of the 95 % intervals at OK, logs that can be told: ≥ 93 %"] = _share(inside, groups)
    seconds = [row["seconds"] for row in every if row["part"] == "faults" and "quick" not in row]
    if seconds:
        found["processor time of `identify`, median of the faults [s]"] = f"{np.median(seconds):.1f}"
    return found


def _of_faults(rows: Sequence[Row]) -> dict[str, str]:
    told = [row for row in rows if case_of(row).told]
    faults = [row for row in told if case_of(row).causes]
    single = [row for row in rows if case_of(row).single]
    wrong = [row for row in told if row["verdict"] == "OK" and row["wrong"] > _WRONG]
    said = [row for row in rows if named(row)]
    refused = [row for row in rows if row["verdict"] == "LOOK AGAIN" and row["wrong"] <= _RIGHT]
    values = [held for row in rows if (held := value_held(row)) is not None]
    return {
        "OK with torques wrong by > 5 %, of faults that can be told: ≤ 4 of 260": f"{len(wrong)} of {len(told)}",
        "right cause first, of logs where one is named: ≥ 90 %": _share(sum(map(right, said)), len(said)),
        "right cause first, of faulty logs that can be told": f"{sum(map(right, faults))} of {len(faults)}",
        "right cause first, of those like the prototype's: ≥ 112 of 124": f"{sum(map(right, single))} of {len(single)}",
        "value within its 95 % interval, of those rightly named: ≥ 90 %": _share(sum(values), len(values)),
        "refused though right to 2 %: 0 of 280": f"{len(refused)} of {len(rows)}",
    }


_LEAST_RIGHT = {"tuned": "85 %", "untouched": "70 %"}


def _of_second(part: str, rows: Sequence[Row]) -> dict[str, str]:
    """Wrong OKs and right causes in a half of the second generator."""
    wrong = [row for row in rows if row["verdict"] == "OK" and row["wrong"] > _WRONG]
    half = f"second generator, {part} kinds"
    return {
        f"OK with torques wrong by > 5 %, {half}: ≤ 3 %": _share(len(wrong), len(rows)),
        f"right cause first, {half}: ≥ {_LEAST_RIGHT[part]}": _share(sum(map(right, rows)), len(rows)),
    }


def _of_clean(part: str, rows: Sequence[Row]) -> dict[str, str]:
    """False alarms: causes named though none is there, and any doubt; joints that did not move are none."""
    said = [[d["name"] for d in row["doubts"] if d["name"] not in (_STILL, *case_of(row).notes)] for row in rows]
    blamed = sum(any(name not in NO_CAUSE for name in names) for names in said)
    found = {f"cause named falsely, {part} logs: ≤ 2 %": _share(blamed, len(rows))}
    if part == "clean":
        found["any doubt, clean logs: ≤ 2 %"] = _share(sum(map(bool, said)), len(rows))
    torques = [row["torques"] for row in rows if "torques" in row]
    if torques:
        again = sum("LOOK AGAIN" in " ".join([t["first"], *t["also"]]) for t in torques)
        found[f"`torques` says LOOK AGAIN, {part} logs"] = _share(again, len(torques))
    return found


def _of_pauses(rows: Sequence[Row]) -> dict[str, str]:
    """Same verdict, and residual of rows held out within 1.2 times, as without the pause."""
    whole = {row["robot"]: row for row in rows if row["case"] == "no pause"}
    cut = [row for row in rows if row["case"] != "no pause" and "wrong" in row]
    same = [
        row["verdict"] == whole[row["robot"]]["verdict"] and row["held out"] <= 1.2 * whole[row["robot"]]["held out"]
        for row in cut
    ]
    return {"pauses that change neither verdict nor residual: all": _share(sum(same), len(cut))}


def _share(part: float, whole: int) -> str:
    return f"{100 * part / whole:.1f} % of {whole}" if whole else "–"


# ── Tables


def case_rows(parts: dict[str, list[Row]]) -> Iterable[list[str]]:
    """A row for each fault: verdicts robot by robot, error of the torques, and causes named first, before and now."""
    for name, case in FAULTS.items():
        cells = [name + ("" if case.told else " †"), ", ".join(case.causes) or "–"]
        for label in parts:
            rows = {row["robot"]: row for row in parts[label] if row["case"] == name}
            mine = [rows[robot] for robot in ARMS if robot in rows]
            verdicts = "".join(_LETTERS.get(row["verdict"], "?") for row in mine)
            wrong = [100 * row["wrong"] for row in mine if "wrong" in row]
            spread = f"{_percent(min(wrong))}–{_percent(max(wrong))} %" if wrong else "–"
            cells += [verdicts, spread, _names(mine)]
        yield cells


def second_rows(rows: Sequence[Row]) -> Iterable[list[str]]:
    """A row for each kind of a half of the second generator: verdicts, error of the torques, and causes named first."""
    for name in dict.fromkeys(row["case"] for row in rows):
        mine = [row for row in rows if row["case"] == name]
        wrong = [100 * row["wrong"] for row in mine if "wrong" in row]
        spread = f"{_percent(min(wrong))}–{_percent(max(wrong))} %" if wrong else "–"
        verdicts = "".join(_LETTERS.get(row["verdict"], "?") for row in mine)
        yield [name, ", ".join(case_of(mine[0]).causes), verdicts, spread, _names(mine)]


def precision_rows(parts: dict[str, Any]) -> Iterable[list[str]]:
    """A row for each cause: of all logs of some parts, those that named it first, and those of them in which it was right.

    Joints that did not move are true of ordinary work, and left out.
    """
    counts: dict[str, list[int]] = {}
    for row in (row for part in parts.values() for row in part["logs"]):
        if (name := named(row)) and name != _STILL:
            count = counts.setdefault(name, [0, 0])
            count[0] += 1
            count[1] += right(row)
    for name, (said, true) in sorted(counts.items()):
        yield [name, str(said), str(true), f"{100 * true / said:.0f} %"]


def _percent(x: float) -> str:
    return f"{x:.1f}" if x < 10 else f"{x:.0f}"


def _names(rows: Sequence[Row]) -> str:
    """Names of causes named first, how often each."""
    counts: dict[str, int] = {}
    for row in rows:
        counts[named(row) or "–"] = counts.get(named(row) or "–", 0) + 1
    if len(counts) == 1:
        return next(iter(counts))
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def page(kept: dict[str, Any]) -> str:
    """The page."""
    labels = [label for label in LABELS if label in kept]
    figures = {label: targets(kept[label]) for label in labels}
    names = list(dict.fromkeys(name for label in labels for name in figures[label]))
    rows = [[name, *(figures[label].get(name, "–") for label in labels)] for name in names]
    runs = [
        [
            label,
            part,
            str(len(run["logs"])),
            run["commit"],
            run["date"],
            run["cpu"],
            run["which"],
        ]
        for label in labels
        for part, run in kept[label].items()
    ]
    faults = {label: kept[label]["faults"]["logs"] for label in labels if "faults" in kept[label]}
    head = ["case", "cause"] + [
        f"{what}, {label}" for label in faults for what in ("verdict", "torques wrong by", "named first")
    ]
    causes_now = precision_rows(kept[labels[-1]])
    return (
        "\n\n".join(
            filter(
                None,
                (
                    _HEAD,
                    section("Targets", "", ["target", *labels], rows),
                    section("Faults", _FAULTS, head, list(case_rows(faults))),
                    *(
                        section(
                            f"Second generator, {part} kinds",
                            "",
                            ["case", "cause", "verdict", "torques wrong by", "named first"],
                            list(second_rows(kept[labels[-1]][part]["logs"])),
                        )
                        for part in SECOND
                        if part in kept[labels[-1]]
                    ),
                    section("Causes", _CAUSES, ["cause", "named first", "rightly", "share"], list(causes_now)),
                    section("Runs", "", ["label", "part", "logs", "commit", "date", "processor", "which"], runs),
                ),
            )
        )
        + "\n"
    )


_HEAD = """# Faulty logs

Logs of robots whose parameters are known, with one fault each, or two: what `identify` says of them, and how wrong the torques
of the robot that it finds are. Made by `python -m tests.faulty_logs faults clean ordinary laws pauses`, which writes
`faulty_logs.json`, and `python -m tests.faulty_logs.table`, which writes this page."""
_CAUSES = """Of all logs of the parts below, faulty and clean: those in which a cause was named first, and was right."""
_FAULTS = """Verdicts of UR5, Panda, xArm 6 and TX40 in this order: O is OK, U UNSURE, L LOOK AGAIN. Torques wrong by: error of
the torques of another motion, as a share of each joint's torque (rms), root mean square over the joints; least and largest of
the four. Named first: the first doubt that says a cause; – where there is none. † No single log can tell it."""


if __name__ == "__main__":
    PAGE.write_text(page(json.loads(KEPT.read_text("utf-8"))), "utf-8")
    print(PAGE.read_text("utf-8"))
