"""What the project set out to reach, each figure beside the one got in this run."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

CALL = "twistwrench method, one state"


@dataclass(frozen=True)
class Row:
    """One requirement. `share` is what was got as a share of what is needed: 1 or more is met; None: not measured."""

    what: str
    need: str
    got: str
    share: float | None

    @property
    def verdict(self) -> str:
        if self.share is None:
            return "not measured"
        return "met" if self.share >= 1 else f"**not met**, {self.share:.0%} of it"


def rows(results: dict[str, Any]) -> Iterator[Row]:
    yield _agreement(results)
    yield _faster(results, "panda", "inverse_dynamics", 22)
    yield _faster(results, "panda", "forward_dynamics", 28)
    yield _faster(results, "panda", "mass_matrix", 15)
    yield _faster(results, "talos", "inverse_dynamics", 16)
    yield _single_call(results)
    yield _operations(results, 850)
    start = results.get("start", {})
    yield _seconds("from `python -c` to the first panda torque, no cache", 0.35, start.get("first torque, no cache"))
    yield _seconds("the same, from the cache", 0.22, start.get("first torque, cache"))
    imported = start["import twistwrench"] - start["import numpy"] if start else None
    yield _seconds("`import twistwrench`, beyond NumPy's", 0.06, imported)


def best_build(timings: dict[str, dict[str, float]]) -> str | None:
    """The fastest of the builds of Pinocchio in C++, by its median."""
    builds = [name for name in timings if name.startswith("Pinocchio C++")]
    return min(builds, key=lambda name: timings[name]["median"]) if builds else None


def _agreement(results: dict[str, Any]) -> Row:
    def worst(name: str) -> float:
        robots = [*results["robots"].values(), *results.get("derivatives", {}).get("robots", {}).values()]
        quantities = [q for robot in robots for q in robot["quantities"].values()]
        return max((q["agreement"].get(name, 0.0) for q in quantities), default=0.0)

    what = "agreement with Pinocchio, relative, the worst of all robots and quantities here"
    if "twistwrench" in results["missing"]:
        return Row(what, "1e-10", "–", None)
    exact, snapped = worst("twistwrench, snap=0"), worst("twistwrench")
    return Row(
        what, "1e-10", f"{exact:.0e} with `snap=0` ({snapped:.0e} as loaded by default)", 1e-10 / max(exact, 1e-17)
    )


def _faster(results: dict[str, Any], robot: str, quantity: str, need: float) -> Row:
    what = f"{robot} {quantity.replace('_', ' ')}"
    if robot not in results["robots"]:
        return Row(what, f"{need} ×", "–", None)
    found = results["robots"][robot]
    batch = f"twistwrench method, batch of {found['batch']}"
    timings = found["quantities"][quantity]["timings"]
    what += f", batch of {found['batch']}"
    build = best_build(timings)
    if build is None or batch not in timings:
        return Row(what, f"{need} ×", "–", None)
    ratio = timings[build]["median"] / timings[batch]["median"]
    got = f"{ratio:.1f} × ({timings[batch]['median']:.1f} ns against {timings[build]['median']:.0f} ns)"
    return Row(what, f"{need} ×", got, ratio / need)


def _single_call(results: dict[str, Any]) -> Row:
    what, need = "one call from Python: panda inverse dynamics", "no slower than Pinocchio's"
    quantities = results["robots"].get("panda", {"quantities": {}})["quantities"]
    timings = quantities.get("inverse_dynamics", {"timings": {}})["timings"]
    if CALL not in timings:
        return Row(what, need, "–", None)
    ours, theirs = timings[CALL]["median"], timings["Pinocchio, Python call"]["median"]
    return Row(what, need, f"{ours / 1e3:.2f} µs against {theirs / 1e3:.2f} µs", theirs / ours)


def _operations(results: dict[str, Any], need: int) -> Row:
    what = "operations in panda inverse dynamics, before any regrouping"
    quantities = results["robots"].get("panda", {"quantities": {}})["quantities"]
    counted = quantities.get("inverse_dynamics", {}).get("operations")
    if counted is None:
        return Row(what, f"at most {need} flops", "–", None)
    before, after = counted["flops before regrouping"], counted["flops"]
    return Row(what, f"at most {need} flops", f"{before} flops ({after} as compiled)", need / before)


def _seconds(what: str, need: float, got: float | None) -> Row:
    if got is None:
        return Row(what, f"{need} s", "–", None)
    return Row(what, f"{need} s", f"{got:.3f} s", need / max(got, 1e-9))
