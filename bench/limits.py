"""The report's sections on limits: what the core can do, each kernel's shares of it, and what bounds the kernel."""

from collections.abc import Iterator
from typing import Any

from bench.markdown import section
from bench.sections import measured_on, title

FETCHED = 1.2  # this much slower than in a short loop, and it is the fetching that takes the time
COUNTED = 0.02  # products of the code beside those of the program
WAYS = ("plain", "past the cache")  # of writing


def limits(results: dict[str, Any]) -> str:
    """What the core can do, and what bounds each kernel."""
    found = results.get("bounds")
    if not found:
        return ""
    return "\n\n".join([_core(found), _kernels(found)])


def _core(found: dict[str, Any]) -> str:
    lanes, memory = found["lanes"], found["memory"]
    rows = [
        (name, f"{1 / t['minimum']:.2f} instructions/ns", f"{lanes / t['minimum']:.1f} doubles/ns")
        for name, t in found["core"].items()
    ]
    size = f"{memory['bytes'] / 2**20:.0f} MiB"
    names = {
        "plain": "plain stores",
        "past the cache": "stores past the cache",
        "copy": "copying, bytes written",
    }
    rows += [(f"{text}, {size}", f"{1 / memory[kind]['minimum']:.1f} GB/s", "") for kind, text in names.items()]
    text = (
        f"{measured_on(found)}: small loops, compiled as the kernels are, on the same core, {lanes} doubles a vector; the"
        " best of many short turns. Products are fused multiply–adds, none waits for another. What is loaded and stored"
        " beside them stays in the first cache."
    )
    return section("What the core can do", text, ("vector instructions", "", ""), rows)


def _kernels(found: dict[str, Any]) -> str:
    rows = [
        (name, title(quantity), str(size), *_limits_of(each, found["lanes"], size))
        for name, robot in found["robots"].items()
        for quantity, each in robot["quantities"].items()
        for size in each["batches"]
    ]
    text = (
        "Nanoseconds per state and, in brackets, their share of what the kernel took, called with `out=`; both are the"
        " best of short turns in the same rounds. **products**: all multiplications, those of sines and cosines included,"
        " at the rate of products alone. **instructions**: all vector instructions of the compiled code, moves between"
        " registers left out, at the rate of a loop in the same mixture, as long as the stretches that the kernel runs."
        " **writing**: the results' bytes, at the rate of stores to a buffer of just that size, plain or past the cache,"
        " whichever is faster. What bounds a kernel is the largest share; `fetching` where a short loop of the same"
        " mixture is a fifth faster than the long one, so that the code's size is what limits. ~ where the code has loops"
        " or other ways to go, or its products are not those of the program within 2 %: there the count is of what is"
        " written, not of what is run."
    )
    head = ("", "", "N", "took", "multiplications", "products", "vector instructions", "instructions")
    return section("What bounds each kernel", text, (*head, "bytes out", "writing", "bound by"), rows)


def _limits_of(each: dict[str, Any], lanes: int, size: int) -> Iterator[str]:
    found = shares(each, lanes, size)
    cells = {name: f"{_ns(needed)} ({share:.0%})" for name, (needed, share) in found.items()}
    parts = each["instructions"]
    sure = not parts["loops"] and abs(parts["products"] / each["multiplications"] - 1) < COUNTED
    about = "" if sure else "~ "
    yield _ns(each["timings"][f"kernel {size}"]["minimum"])
    yield from (str(each["multiplications"]), cells["multiplier"])
    yield from (f"{about}{each['executed']}", about + cells["instructions"])
    yield from (str(each["bytes"]), cells["memory"], verdict(each, lanes, size))


def _ns(value: float) -> str:
    return f"{value:.1f}" if value < 99.95 else f"{value:.0f}"


def shares(found: dict[str, Any], lanes: int, size: int) -> dict[str, tuple[float, float]]:
    """By what may bound a kernel: the nanoseconds a state that it needs, and their share of those measured."""
    best = {name: timing["minimum"] for name, timing in found["timings"].items()}
    writing = min(best[f"{kind} {size}"] for kind in WAYS)
    needed = {
        "multiplier": found["multiplications"] / lanes * best["products"],
        "instructions": found["executed"] / lanes * max(best["mixture"], best["as long"]),
        "memory": found["bytes"] * writing,
    }
    return {name: (each, each / best[f"kernel {size}"]) for name, each in needed.items()}


def verdict(found: dict[str, Any], lanes: int, size: int) -> str:
    """What leaves a kernel the least room; "fetching" where the same instructions would run faster if there were few."""
    needed = {name: share for name, (_, share) in shares(found, lanes, size).items()}
    first = max(needed, key=lambda name: needed[name])
    best = {name: timing["minimum"] for name, timing in found["timings"].items()}
    return "fetching" if first == "instructions" and best["as long"] > FETCHED * best["mixture"] else first
