"""Run everything and write the report: `python -m bench [--rounds N] [--robots ur5,panda,talos]`.

`--only SECTION` times one section alone and leaves the rest of the results as it is; the page names the section and its
machine at its head. `--render` times nothing; `--out FOLDER` writes both files there, and leaves those kept here alone.
Both files are written after each section, so that a section which fails takes none of the others with it.
"""

import argparse
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

try:
    import pinocchio  # noqa: F401  (robots and builds of every section are its own)
except ImportError:
    raise SystemExit('the benchmark needs its peers: pip install -e ".[peers]"') from None

from bench import footprint, machine, peer_pinocchio_cpp, report
from bench.cases import CASES, Case
from bench.side_by_side import all_peers, measured
from bench.timing import ROUNDS, pin_to_one_core

HERE = Path(__file__).parent
ALONE = (
    "derivatives",
    "float32",
    "bounds",
    "compile",
    "one_body",
    "one_call",
    "fresh",
    "generated",
    "inverse_kinematics",
    "long_chain",
    "closed",
    "kernels",
    "start",
)
SECTIONS = (*sorted(ALONE), "rollout", "simulate", "threads")
ALL_CORES = ("threads",)  # the others keep to one


def main() -> None:
    options = _options()
    folder = options.out or HERE
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "results.json"
    if options.only or options.render:
        results = json.loads((kept if kept.exists() else HERE / "results.json").read_text())
        if options.only:
            results[options.only] = _part(options.only, options)
            results.setdefault("timed_alone", {})[options.only] = {**machine.describe(), "rounds": options.rounds}
        _write(results, folder)
    else:
        for results in _measured(options):
            _write(results, folder)
    print(f"wrote {folder / 'RESULTS.md'}")


def _write(results: dict[str, Any], folder: Path) -> None:
    results = json.loads(json.dumps(results))  # as it is read again
    (folder / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    (folder / "RESULTS.md").write_text(report.write(results))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Time twistwrench beside its peers, on one core."
    )
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="interleaved repeats (default %(default)s)")
    parser.add_argument("--robots", default=",".join(c.name for c in CASES), help="default %(default)s")
    parser.add_argument("--out", type=Path, help="the folder to write to (default: the benchmark's own)")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--only", choices=SECTIONS, help="time this section alone and keep the others' results")
    what.add_argument("--render", action="store_true", help="only write RESULTS.md again, from results.json")
    return parser.parse_args()


def _part(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """What one section takes, by its name in the results."""
    from bench import (
        bounds,
        closed,
        derivatives,
        float32,
        fresh,
        generated,
        inverse_kinematics,
        long_chain,
        one_body,
        one_call,
        threads,
    )

    def rollout() -> dict[str, Any]:
        from bench import rollout  # needs MuJoCo, which may be missing

        return rollout.times(options.rounds)

    def simulate() -> dict[str, Any]:
        from bench import simulate  # needs MuJoCo too

        return simulate.times(options.rounds)

    if name not in ALL_CORES:
        pin_to_one_core()
    cases, rounds = _cases(options), options.rounds
    return {
        "bounds": lambda: bounds.times(rounds, cases),
        "closed": lambda: closed.times(rounds),
        "compile": lambda: footprint.compile_times(max(rounds // 5, 1), cases),
        "derivatives": lambda: derivatives.times(rounds, cases),
        "float32": lambda: float32.times(rounds, cases),
        "fresh": lambda: fresh.times(tuple(case.name for case in cases)),
        "generated": lambda: generated.times(rounds, cases),
        "inverse_kinematics": lambda: inverse_kinematics.times(rounds),
        "kernels": lambda: {case.name: footprint.kernel_times(case) for case in cases},
        "long_chain": lambda: long_chain.times(rounds),
        "one_body": lambda: one_body.times(rounds),
        "one_call": lambda: one_call.times(rounds, cases),
        "rollout": rollout,
        "simulate": simulate,
        "start": lambda: footprint.start_times(next(c for c in CASES if c.name == "panda"), max(rounds // 2, 3)),
        "threads": lambda: threads.times(rounds),
    }[name]()


def _cases(options: argparse.Namespace) -> tuple[Case, ...]:
    return tuple(c for c in CASES if c.name in options.robots.split(","))


def _measured(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """All results so far, after each section."""
    builds, missing = peer_pinocchio_cpp.builds()
    results: dict[str, Any] = {
        "machine": machine.describe(),
        "compilers": {b.name: b.compiler for b in builds},
        "missing": missing,
        "rounds": options.rounds,
        "robots": {},
        "installed": footprint.installed_bytes(),
    }
    with suppress(ImportError):  # the robots say below what is missing
        results["threads"] = _part("threads", options)  # before all is kept on one core
    results["machine"]["core"] = pin_to_one_core()
    for case in _cases(options):
        print(f"{case.name}: loading", flush=True)
        results["robots"][case.name] = measured(case, all_peers(case, builds, missing), options.rounds)
        yield results
    if "twistwrench" in missing:
        return
    for section in ALONE:
        print(section.replace("_", " "), flush=True)
        results[section] = _part(section, options)
        yield results
    for section in ("rollout", "simulate"):
        with suppress(ImportError):  # the robots say what is missing
            results[section] = _part(section, options)
            yield results


if __name__ == "__main__":
    main()
