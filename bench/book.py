"""Every function of the book's package beside ours: `python -m bench.book [--rounds N] [--render]`.

Writes book.json, BOOK.md, and the tables of docs/modern-robotics.md, which a test compares with book.json.
"""

import argparse
import contextlib
import io
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bench import machine
from bench.book_cases import BATCH, CASES
from bench.book_traps import TRAPS
from bench.markdown import duration, quartiles, times
from bench.timing import ROUNDS, Contender, interleave, pin_to_one_core

HERE = Path(__file__).parent
RESULTS, REPORT, PAGE = HERE / "book.json", HERE / "BOOK.md", HERE.parent / "docs" / "modern-robotics.md"
THEIRS, OURS, MANY = "modern_robotics", "twistwrench", f"twistwrench, batch of {BATCH}"
TOLERANCE = 1e-9  # both must agree on what is timed


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.book", description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="interleaved repeats (default %(default)s)")
    parser.add_argument("--render", action="store_true", help="only write the tables again, from book.json")
    options = parser.parse_args()
    if not options.render:
        RESULTS.write_text(json.dumps(measure(options.rounds), indent=1) + "\n")
    results = json.loads(RESULTS.read_text())
    REPORT.write_text(report(results))
    PAGE.write_text(with_tables(PAGE.read_text("utf-8"), results), "utf-8")
    print(f"wrote {REPORT} and the tables of {PAGE}")


# ── measuring ──


def measure(rounds: int) -> dict[str, Any]:
    import modern_robotics as theirs

    import twistwrench.modern_robotics as ours

    sys.modules["matplotlib.pyplot"] = None  # type: ignore[assignment]  # theirs would open a window in each call
    found = {"machine": machine.describe(), "rounds": rounds, "traps": traps(ours, theirs), "functions": {}}
    found["machine"]["core"] = pin_to_one_core()
    for case in CASES:
        print(case.function, flush=True)
        mine, book = getattr(ours, case.function), getattr(theirs, case.function)
        with contextlib.redirect_stdout(io.StringIO()):
            check(case.function, mine(*case.arguments), book(*case.arguments))
            contenders = [
                Contender(THEIRS, sweep(book, case.arguments), 1),
                Contender(OURS, sweep(mine, case.arguments), 1),
            ]
            if case.batched:
                contenders.append(Contender(MANY, sweep(mine, case.batched), BATCH))
            timings = interleave(contenders, rounds)
        found["functions"][case.function] = {name: asdict(timing) for name, timing in timings.items()}
    return found


def sweep(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[[int], None]:
    def run(count: int) -> None:
        for _ in range(count):
            function(*arguments)

    return run


def check(name: str, a: Any, b: Any) -> None:
    """Stop where the two do not compute the same."""
    for x, y in zip(leaves(a), leaves(b), strict=True):
        if not np.abs(x - y).max() <= TOLERANCE * max(1.0, np.abs(y).max()):
            raise SystemExit(f"{name}: the two disagree, nothing is timed")


def leaves(x: Any) -> Iterator[np.ndarray]:
    if isinstance(x, (tuple, list)):
        for each in x:
            yield from leaves(each)
    else:
        yield np.asarray(x, float)


def traps(ours: Any, theirs: Any) -> list[dict[str, Any]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [
            {
                "function": t.function,
                "what": t.what,
                "unit": t.unit,
                "theirs": text(t.error(theirs)),
                "ours": text(t.error(ours)),
            }
            for t in TRAPS
        ]


def text(error: float) -> str:
    """Two figures; an error that is no number is no answer."""
    if not math.isfinite(error):
        return "no answer"
    return "0" if error == 0 else f"{error:.1e}"


# ── writing ──


def report(results: dict[str, Any]) -> str:
    m = results["machine"]
    lines = [
        "# The book's package and ours, function by function",
        "",
        "Written by `python -m bench.book`; do not edit. The method is that of [RESULTS.md](RESULTS.md): both in one"
        f" process, in turns, {results['rounds']} rounds of 20 ms or more, medians and quartiles per call. Arms have the six"
        " joints of a UR5, trajectories 10 to 100 rows. Ours has its kernels already: the first call with new lists makes"
        " them.",
        "",
        f"- {m['date']}, {m['cpu']} ({m['family']}; {m['vectors']} side by side), {m['system']}, Python {m['python']}",
        "- " + ", ".join(f"{name} {number}" for name, number in m["versions"].items()),
        "",
        *table(("", THEIRS, OURS, "faster", f"in a batch of {BATCH}, each"), list(spread(results))),
        "",
        "Errors on inputs with a known answer:",
        "",
        *residuals(results),
    ]
    return "\n".join(lines) + "\n"


def spread(results: dict[str, Any]) -> Iterator[list[str]]:
    for name, found in results["functions"].items():
        cells = [
            f"{duration(found[k]['median'])} {quartiles(found[k])}" if k in found else "" for k in (THEIRS, OURS, MANY)
        ]
        yield [f"`{name}`", *cells[:2], times(found[THEIRS]["median"] / found[OURS]["median"]), cells[2]]


def with_tables(page: str, results: dict[str, Any]) -> str:
    """The page with what stands between its markers replaced by the tables of these results."""
    for name, lines in (("times", functions(results)), ("errors", residuals(results))):
        mark, end = f"<!-- {name}: written by python -m bench.book -->\n", "<!-- end -->"
        before, found, rest = page.partition(mark)
        _, closed, after = rest.partition(end)
        if not (found and closed):
            raise SystemExit(f"{PAGE} has no place for the table {name!r}: a line {mark.strip()}, and a line {end}")
        page = before + mark + "\n".join([*lines, end]) + after
    return page


def functions(results: dict[str, Any]) -> list[str]:
    behind = {case.function: case.behind for case in CASES}
    rows = []
    for name, found in results["functions"].items():
        each = [duration(found[k]["median"]) if k in found else "" for k in (THEIRS, OURS, MANY)]
        faster = times(found[THEIRS]["median"] / found[OURS]["median"])
        rows.append([f"`{name}`", behind[name], each[0], each[1], faster, each[2]])
    return table(("function", "behind it", "theirs", "ours", "faster", f"ours, each of {BATCH}"), rows)


def residuals(results: dict[str, Any]) -> list[str]:
    rows = [[f"`{t['function']}`", t["what"], t["theirs"], t["ours"], t["unit"]] for t in results["traps"]]
    return table(("function", "input", "theirs is off by", "ours is off by", ""), rows)


def table(head: tuple[str, ...], rows: list[list[str]]) -> list[str]:
    return ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows)]


if __name__ == "__main__":
    main()
