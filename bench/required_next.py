"""The table the project works towards: factors over Pinocchio's best C++ build, threads, compile time, one call."""

from collections.abc import Iterator
from typing import Any

from bench.markdown import duration
from bench.required import CALL, Row, best_build

METHOD = "twistwrench method"
SINGLE_METHOD, DOUBLE_METHOD = f"{METHOD}, float32", f"{METHOD}, float64"
FACTORS = (  # what, results' key, method's marks, panda's at its batch, talos' at its batch, talos' at 4096
    ("inverse dynamics", "inverse_dynamics", "", 27, 21, None),
    ("forward dynamics", "forward_dynamics", "", 33, 15, None),
    ("mass matrix, into `out=`", "mass_matrix", ", out=", 18, 7, 5),
    ("gravity forces", "gravity_forces", "", 44, 25, None),
    ("∂τ/∂(q, dq)", "inverse_dynamics_derivatives", "", 20, 9, 5.5),
    ("∂ddq/∂(q, dq, τ)", "forward_dynamics_derivatives", "", 20, 4.5, None),
)
SINGLE = {"panda": 55, "talos": 40}
THREADS = {"panda": 1.8, "talos": 1.7}
STATES = "65536"
COMPILE = {"panda": 1.5, "talos": 12.0}
CALL_MICROSECONDS = 0.30
ROLLOUT, REAL_TIME = 25, 500


def rows(results: dict[str, Any]) -> Iterator[Row]:
    for robot in ("panda", "talos"):
        for what, quantity, marks, panda, talos, large in FACTORS:
            found = section_of(results, quantity).get(robot, {})
            yield _factor(found, robot, what, quantity, marks, panda if robot == "panda" else talos, found.get("batch"))
            if quantity == "inverse_dynamics":
                yield _single(results, robot)
            if robot == "talos" and large:
                yield _factor(found, robot, what, quantity, marks, large, 4096)
        yield _threads(results, robot)
        yield _compile(results, robot)
    yield _call(results)
    yield from _rollouts(results)


def section_of(results: dict[str, Any], quantity: str) -> dict[str, Any]:
    """The robots of the section that a quantity is timed in."""
    found = results.get("derivatives", {}) if quantity.endswith("_derivatives") else results
    return found.get("robots", {})


def _factor(
    found: dict[str, Any], robot: str, what: str, quantity: str, marks: str, need: float, batch: int | None
) -> Row:
    what = f"{robot} {what}" + (f", batch of {batch}" if batch else "")
    timings = found.get("quantities", {}).get(quantity, {}).get("timings", {})
    mine, build = timings.get(f"{METHOD}, batch of {batch}{marks}"), best_build(timings)
    if mine is None or build is None:
        return Row(what, f"{need} ×", "–", None)
    into = timings.get(f"{METHOD}, batch of {batch}, out=") if not marks else None
    more = f"; {timings[build]['median'] / into['median']:.1f} × into `out=`" if into else ""
    return _times(what, need, mine["median"], timings[build]["median"], more)


def _single(results: dict[str, Any], robot: str) -> Row:
    found = results.get("float32", {}).get("robots", {}).get(robot)
    what = f"{robot} inverse dynamics in float32 against float64" + (f", batch of {found['batch']}" if found else "")
    timings = found["quantities"]["inverse_dynamics"]["timings"] if found else {}
    build = best_build(timings)
    if build is None:
        return Row(what, f"{SINGLE[robot]} ×", "–", None)
    mine, double = timings[SINGLE_METHOD]["median"], timings[DOUBLE_METHOD]["median"]
    return _times(what, SINGLE[robot], mine, timings[build]["median"], f"; ours in float64 {duration(double)}")


def _times(what: str, need: float, mine: float, theirs: float, more: str = "") -> Row:
    ratio = theirs / mine
    return Row(what, f"{need} ×", f"{ratio:.1f} × ({duration(mine)} against {duration(theirs)}){more}", ratio / need)


def _threads(results: dict[str, Any], robot: str) -> Row:
    what, need = f"{robot} inverse dynamics, two threads over one, {int(STATES):,} states", THREADS[robot]
    timings = results.get("threads", {}).get("states" if robot == "panda" else "humanoid", {}).get(STATES)
    if timings is None:
        return Row(what, f"{need} ×", "–", None)
    one, two = timings["1"]["median"], timings["2"]["median"]
    return Row(what, f"{need} ×", f"{one / two:.2f} × ({duration(two)} against {duration(one)})", one / two / need)


def _compile(results: dict[str, Any], robot: str) -> Row:
    what, need = f"{robot}, all of the above compiled, no cache", COMPILE[robot]
    found = results.get("compile", {}).get("robots", {}).get(robot)
    if found is None:
        return Row(what, f"{need} s", "–", None)
    got = f"{found['wall']:.2f} s ({found['processor']:.2f} s of the processor)"
    return Row(what, f"{need} s", got, need / found["wall"])


def _call(results: dict[str, Any]) -> Row:
    what, need = "one call from Python: panda inverse dynamics", f"{CALL_MICROSECONDS:.2f} µs"
    timings = section_of(results, "inverse_dynamics").get("panda", {}).get("quantities", {})
    timings = timings.get("inverse_dynamics", {}).get("timings", {})
    build = best_build(timings)
    if CALL not in timings or build is None:
        return Row(what, need, "–", None)
    mine, python, loop = (timings[name]["median"] / 1e3 for name in (CALL, "Pinocchio, Python call", build))
    got = f"{mine:.2f} µs (Pinocchio: {python:.2f} µs from Python, {loop:.2f} µs in C++)"
    return Row(what, need, got, CALL_MICROSECONDS / mine)


def _rollouts(results: dict[str, Any]) -> Iterator[Row]:
    found = results.get("rollout")
    size = f"{found['size']} " if found else ""
    what = f"panda rollouts, 1 kHz, PD control, {size}motions, steps over `mujoco.rollout`'s"
    one = "panda, one simulated second of the same, over real time"
    if not found:
        yield Row(what, f"{ROLLOUT} ×", "–", None)
        yield Row(one, f"{REAL_TIME} ×", "–", None)
        return
    mine, theirs = (found["batch"][name]["median"] for name in ("twistwrench", "MuJoCo"))
    fresh = theirs / found["batch"]["fresh arrays"]["median"]
    yield _times(what, ROLLOUT, mine, theirs, f"; {fresh:.1f} × into fresh arrays")
    second = 1000 * found["one"]["twistwrench"]["median"]
    yield Row(one, f"{REAL_TIME} ×", f"{1e9 / second:,.0f} × ({duration(second)})", 1e9 / second / REAL_TIME)
