"""Read changed files of one kind or of all: ``python -m tests.fuzz --kind MCAP --count 1000 --keep /tmp/failed``."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "support")]

from fuzz.harness import SECONDS, run, unread  # noqa: E402
from fuzz.kinds import KINDS  # noqa: E402


def main() -> int:
    """Exit status 1 if a file fails."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--kind", action="append", choices=KINDS, help="kind of files; all if none is named")
    parser.add_argument("--count", type=int, default=100, help="files of each kind, times its share")
    parser.add_argument("--first", type=int, default=0, help="number of the first file, to read one again")
    parser.add_argument("--seed", default="0", help="of the changes")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="processor time of one file")
    parser.add_argument("--keep", type=Path, help="folder for the files that fail")
    parser.add_argument("--whole", action="store_true", help="only show whole files that are not read")
    asked = parser.parse_args()
    kinds = [KINDS[name] for name in asked.kind or KINDS]
    if asked.whole:
        for line in unread(kinds):
            print(line)
        return 0
    failed = 0
    for kind in kinds:
        began = time.perf_counter()
        tally = run([kind], asked.count, asked.seed, first=asked.first, keep=asked.keep, seconds=asked.seconds)
        print(
            str(tally).splitlines()[1] if tally.ended else f"{kind.name}: left out",
            f"{time.perf_counter() - began:6.1f} s",
            flush=True,
        )
        for failure in tally.failures:
            print(f"  {failure}", flush=True)
        failed += len(tally.failures)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
