"""The report, from the results alone: tables, and a line of words above each. How it was measured is in method.md."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bench import limits, required, required_next, sections
from bench.cases import DERIVATIVES, QUANTITIES
from bench.markdown import duration, quartiles, section, times
from bench.required import best_build

METHOD = Path(__file__).with_name("method.md")
TITLES = tuple(quantity.replace("_", " ") for quantity in QUANTITIES)
FUSED = ("fma", "fms", "fnma", "fnms")


def write(results: dict[str, Any]) -> str:
    """The whole of RESULTS.md."""
    parts = [_head(results), _required(results), _required_next(results)]
    parts += [_robot(robot, results["missing"]) for robot in results["robots"].values()]
    parts += [
        part(results)
        for part in (sections.derivatives, sections.single, sections.one_call, sections.fresh, limits.limits)
    ]
    parts += [part(results) for part in (sections.generated, sections.inverse_kinematics, sections.long_chain)]
    parts += [part(results) for part in (_agreement, _builds, _operations, _one_body, _threads, sections.rollouts)]
    parts += [sections.simulations(results), sections.closed_loops(results)]
    parts += [part(results) for part in (sections.compiling, _kernels, _start)]
    return "\n\n".join([*filter(None, parts), METHOD.read_text()])


def _head(results: dict[str, Any]) -> str:
    m, alone = results["machine"], results.get("timed_alone", {})
    core = "on one core" if m["core"] is not None else "each on one thread, wherever the system put it"
    lines = [
        "# Benchmark",
        "",
        f"Written by `make bench`; do not edit. All contenders ran in the same run, in turns, {core}, in float64,"
        f" {results['rounds']} rounds, unless a section says otherwise.",
        "",
        f"- {_where(m)}",
        "- " + ", ".join(f"{name} {number}" for name, number in m["versions"].items()),
        "- compilers: " + ("; ".join(sorted(set(results["compilers"].values()))) or "none"),
    ]
    lines += [f"- missing: **{name}**: {reason}" for name, reason in results["missing"].items()]
    lines += [
        f"- **{name.replace('_', ' ')}** alone: {_where(own)}, {own['rounds']} rounds" for name, own in alone.items()
    ]
    return "\n".join(lines)


def _where(m: dict[str, Any]) -> str:
    """Date, processor, system and interpreter."""
    return f"{m['date']}, {m['cpu']} ({m['family']}; {m['vectors']} side by side), {m['system']}, Python {m['python']}"


def _required(results: dict[str, Any]) -> str:
    rows = [(row.what, row.need, row.got, row.verdict) for row in required.rows(results)]
    text = (
        "Batches are plain (N, n) arrays through the method of `Robot`, without `out=`. The factors are the time of"
        " the best build of Pinocchio in C++ over ours, per state, medians of this run."
    )
    return section("What it must reach", text, ("what", "at least", "got", ""), rows)


def _required_next(results: dict[str, Any]) -> str:
    rows = [(row.what, row.need, row.got, row.verdict) for row in required_next.rows(results)]
    text = (
        "The same comparison, with more quantities. Batches are fresh results of the method unless `out=` is said;"
        " times are per state. What stands in the way is below, under what bounds each kernel."
    )
    return section("What it must reach next", text, ("what", "at least", "got", ""), rows)


def _everything(results: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """By robot, what was measured of each quantity, derivatives last."""
    found = {name: dict(robot["quantities"]) for name, robot in results["robots"].items()}
    for name, robot in results.get("derivatives", {}).get("robots", {}).items():
        found.setdefault(name, {}).update(robot["quantities"])
    return found


def _robot(robot: dict[str, Any], missing: dict[str, str]) -> str:
    timings = [robot["quantities"][quantity]["timings"] for quantity in QUANTITIES]
    names = dict.fromkeys(name for each in timings for name in each)
    rows = [[_label(name, robot["batch"]), *(_cell(each, name) for each in timings)] for name in _shown([*names])]
    rows += [[name, *["missing"] * len(timings)] for name in missing if "," not in name]  # not for single builds
    text = (
        "Time per state: the median of the rounds, the quartiles, and how many times faster than the best build of"
        " Pinocchio in C++ (1/n: n times slower)."
    )
    return section(robot["title"], text, ("", *TITLES), rows)


def _shown(names: Sequence[str]) -> Iterator[str]:
    """Contenders in the order timed; of the C++ builds one row, for each quantity the best."""
    builds = [name for name in names if name.startswith("Pinocchio C++")]
    return (name for name in names if name not in builds[1:])


def _label(name: str, batch: int) -> str:
    if name.startswith("Pinocchio C++"):
        return "Pinocchio C++, best build"
    return f"**{name}**" if name == f"twistwrench method, batch of {batch}" else name


def _cell(timings: dict[str, dict[str, float]], name: str) -> str:
    best = best_build(timings)
    name = best if best and name.startswith("Pinocchio C++") else name
    if name not in timings:
        return "–"
    timing = timings[name]
    text = f"{duration(timing['median'])} {quartiles(timing)}"
    return text if best is None else f"{text} **{times(timings[best]['median'] / timing['median'])}**"


def _agreement(results: dict[str, Any]) -> str:
    robots = _everything(results)
    worst: dict[str, list[str]] = {
        name: [] for quantities in robots.values() for q in quantities.values() for name in q["agreement"]
    }
    for quantities in robots.values():
        for name, cells in worst.items():
            found = [q["agreement"][name] for q in quantities.values() if name in q["agreement"]]
            cells.append(f"{max(found):.0e}" if found else "–")
    text = (
        "The largest relative difference from Pinocchio called from Python, over all quantities and 64 random"
        " states: per state and matrix, the largest entry of the difference over the largest entry. Checked before anything is"
        " timed. twistwrench takes entries of fixed rotations within 1e-9 of 0 or ±1 to mean just that; `snap=0` turns"
        " it off."
    )
    return section("Agreement", text, ("", *robots), [(name, *cells) for name, cells in worst.items()])


def _builds(results: dict[str, Any]) -> str:
    rows = []
    every = _everything(results)
    shown = [quantity for quantity in (*QUANTITIES, *DERIVATIVES) if any(quantity in each for each in every.values())]
    for name, quantities in every.items():
        for build in results["compilers"]:
            cells = [_of_build(quantities, quantity, f"Pinocchio C++, {build}") for quantity in shown]
            rows.append((name, f"`{build}`", *cells))
    text = (
        "Nanoseconds per state, median (minimum). The best median, in bold, is what the ratios above are taken against."
    )
    return section("Pinocchio C++, build by build", text, ("", "build", *map(sections.title, shown)), rows)


def _of_build(quantities: dict[str, Any], quantity: str, build: str) -> str:
    timings = quantities.get(quantity, {"timings": {}})["timings"]
    if build not in timings:
        return "–"
    text = f"{timings[build]['median']:.0f} ({timings[build]['minimum']:.0f})"
    return f"**{text}**" if best_build(timings) == build else text


def _operations(results: dict[str, Any]) -> str:
    rows = []
    for name, quantities in _everything(results).items():
        for quantity, each in quantities.items():
            if counts := each.get("operations"):
                single = [counts.get(op, 0) for op in ("multiplications", "flops", "mul")]
                fused = sum(counts.get(op, 0) for op in FUSED)
                sums = counts.get("add", 0) + counts.get("sub", 0)
                rest = [counts.get(op, 0) for op in ("div", "sqrt", "sin", "cos")]
                rows.append((name, sections.title(quantity), *map(str, [*single, fused, sums, *rest])))
    text = (
        "Per state, in the program that is compiled. A fused multiply–add is one multiplication and two flops; sines"
        " and cosines are in neither sum."
    )
    head = ("", "", "multiplications", "flops", "mul", "fma", "add, sub", "div", "sqrt", "sin", "cos")
    return section("Operations", text, head, rows)


def _one_body(results: dict[str, Any]) -> str:
    found = results.get("one_body")
    if not found:
        return ""
    sizes = list(found["rows"])
    rows = []
    for function, first in found["rows"][sizes[0]].items() if sizes else ():
        for name in first["timings"]:
            all_timings = [found["rows"][size][function]["timings"] for size in sizes]
            cells = [_beside_ours(timings, name) for timings in all_timings]
            rows.append((f"`{function}`" if name == next(iter(first["timings"])) else "", name, *cells))
    counted = " and ".join(f"{found['rounds'][size]} rounds of {int(size):,} rows" for size in sizes)
    worst = max(
        (e for each in found["rows"].values() for m in each.values() for e in m["agreement"].values()), default=0
    )
    text = (
        f"Measured {found['date']} on {found['cpu']}, {counted}: the median, the quartiles, and how many times faster"
        " ours is than this peer (1/n: n times slower). Rows are random twists, wrenches and poses in plain float64"
        f" arrays; every result is a fresh array; ours check their input. Peers agree with ours to {worst:.0e} of the"
        " largest entry, checked before anything is timed."
    )
    if found["left_out"]:
        text += f" Not timed for want of memory: {', '.join(f'{size:,}' for size in found['left_out'])} rows."
    return section("One body and the groups, ns per row", text, ("", "", *(f"{int(n):,} rows" for n in sizes)), rows)


def _beside_ours(timings: dict[str, dict[str, float]], name: str) -> str:
    timing, ours = timings[name], next(iter(timings.values()))  # ours comes first
    text = f"{timing['median']:.0f} [{timing['low']:.0f}–{timing['high']:.0f}]"
    return text if timing is ours else f"{text} **{times(timing['median'] / ours['median'])}**"


def _threads(results: dict[str, Any]) -> str:
    found = results.get("threads")
    if not found:
        return ""
    robots = {"panda": found["states"], "talos": found.get("humanoid", {})}
    rows = [
        (f"{int(size):,} states", robot, *(_beside_one(timings, count) for count in timings))
        for robot, sizes in robots.items()
        for size, timings in sizes.items()
    ]
    text = (
        f"Measured {found['date']} on {found['cpu']}, {found['cores']} cores to use, {found['rounds']} rounds:"
        " inverse dynamics through the method, nanoseconds per state, the median, the quartiles, and how many times as"
        " fast as on one thread. Results are the same to the bit, checked before anything is timed."
    )
    counts = next(iter(found["states"].values()), {})
    head = ("", "", *(f"{count} thread{'' if count == '1' else 's'}" for count in counts))
    return section("Large batches on several threads", text, head, rows)


def _beside_one(timings: dict[str, dict[str, float]], count: str) -> str:
    text = f"{duration(timings[count]['median'])} {quartiles(timings[count])}"
    return text if count == "1" else f"{text} **{times(timings['1']['median'] / timings[count]['median'])}**"


def _kernels(results: dict[str, Any]) -> str:
    rows = [
        (name, kind, *(f"{1e3 * each:.1f}" for each in seconds.values()))
        for name, kinds in results.get("kernels", {}).items()
        for kind, seconds in kinds.items()
    ]
    text = (
        "Milliseconds, in a fresh process: reading the robot's file, then making each kernel, compiled or found in the"
        " cache on disk. Inverse dynamics is the first to be made, so what is imported on demand counts there."
    )
    return section("Compiling and loading", text, ("", "", "read the file", *TITLES), rows)


def _start(results: dict[str, Any]) -> str:
    rows = [(name, f"{seconds:.3f} s") for name, seconds in results.get("start", {}).items()]
    rows += [
        (f"installed: {name}, all it requires", f"{size / 1e6:.0f} MB") for name, size in results["installed"].items()
    ]
    text = (
        "Starting Python, doing the thing, and leaving: a new process each time, medians. First torques are the"
        " panda's, from its URDF."
    )
    return section("Starting, and size", text, ("", ""), rows)
