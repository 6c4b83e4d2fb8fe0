"""The report's sections on derivatives, float32 and compiling, each from its own part of the results."""

from typing import Any

from bench.markdown import duration, quartiles, section, times
from bench.required import best_build
from bench.required_next import DOUBLE_METHOD, SINGLE_METHOD

NAMES = {
    "inverse_dynamics_derivatives": "∂τ/∂(q, dq)",
    "forward_dynamics_derivatives": "∂ddq/∂(q, dq, τ)",
}
NONE = ("MuJoCo, Python call", "modern_robotics, Python call")  # they have no analytic derivatives


def title(quantity: str) -> str:
    return NAMES.get(quantity, quantity.replace("_", " "))


def measured_on(found: dict[str, Any]) -> str:
    return f"Measured {found['date']} on {found['cpu']}, {found['rounds']} rounds"


def derivatives(results: dict[str, Any]) -> str:
    """One table a robot: who takes how long."""
    found = results.get("derivatives")
    if not found:
        return ""
    parts = []
    for robot in found["robots"].values():
        timings = [q["timings"] for q in robot["quantities"].values()]
        names = [name for name in timings[0] if not name.startswith("Pinocchio C++")]
        first = "Pinocchio C++, best build"
        position = next((k for k, name in enumerate(names) if name.startswith("Pinocchio")), len(names))
        names[position:position] = [first] if best_build(timings[0]) else []
        rows = [(_bold(name, robot["batch"]), *(_beside_best(each, name) for each in timings)) for name in names]
        rows += [(name, *["–"] * len(timings)) for name in NONE]
        text = (
            f"{measured_on(found)}: time per state, the quartiles, and how many times faster than the best build of"
            " Pinocchio in C++. Derivatives by q are along the velocities; ∂ddq/∂τ is the inverse of the mass matrix."
        )
        head = ("", *(title(quantity) for quantity in robot["quantities"]))
        parts.append(section(f"Derivatives: {robot['title']}", text, head, rows))
    return "\n\n".join(parts)


def _bold(name: str, batch: int) -> str:
    return f"**{name}**" if name == f"twistwrench method, batch of {batch}" else name


def _beside_best(timings: dict[str, dict[str, float]], name: str) -> str:
    best = best_build(timings)
    timing = timings[best if best and name == "Pinocchio C++, best build" else name]
    text = f"{duration(timing['median'])} {quartiles(timing)}"
    return text if best is None else f"{text} **{times(timings[best]['median'] / timing['median'])}**"


def generated(results: dict[str, Any]) -> str:
    """C that CasADi writes, compiled by gcc, beside our batch and our C."""
    found = results.get("generated")
    if not found or "missing" in found:
        return ""
    rows = []
    for robot, quantities in found["robots"].items():
        for quantity, measured_one in quantities.items():
            timings = measured_one["timings"]
            ours = next(iter(timings.values()))["median"]
            cells = [f"{duration(t['median'])} **{times(t['median'] / ours)}**" for t in timings.values()]
            rows.append((f"{robot}, {title(quantity)}", duration(ours), *cells[1:]))
    heads = [name for one in found["robots"].values() for q in one.values() for name in q["timings"]]
    seconds = max(max(q["compiling"].values()) for one in found["robots"].values() for q in one.values())
    text = (
        f"{measured_on(found)}: processor time per state, and how many times as long as ours. The recursions are written on"
        " Pinocchio's model in CasADi's symbols, and CasADi writes C for each robot: Newton–Euler, and articulated bodies."
        f" gcc takes up to {seconds:.1f} s; ours needs no compiler."
    )
    return section("Generated C", text, ("", *dict.fromkeys(heads)), rows)


def one_call(results: dict[str, Any]) -> str:
    """One call with one state, in several ways."""
    found = results.get("one_call")
    if not found:
        return ""
    rows = [
        (robot, title(way), *(f"{duration(pair[who]['median'])} {quartiles(pair[who])}" for who in ("ours", "theirs")),
         f"**{times(pair['theirs']['median'] / pair['ours']['median'])}**")
        for robot, ways in found["robots"].items()
        for way, pair in ways.items()
    ]  # fmt: skip
    text = (
        f"{measured_on(found)}: a call of the method with one state, as a loop makes it from its third call on (some 200th"
        " of long programs), and Pinocchio's Python call of the same."
    )
    return section("One call", text, ("", "", "twistwrench", "Pinocchio, Python call", "times as fast"), rows)


def fresh(results: dict[str, Any]) -> str:
    """Fresh results of methods, each in its own process."""
    found = results.get("fresh")
    if not found:
        return ""
    rows = [
        (r["robot"], title(r["quantity"]), f"{r['states']:,}", duration(r["first"]),
         *(f"{duration(r[way]['median'])} {quartiles(r[way])}" for way in ("fresh", "held", "out")),
         f"{r['fresh']['median'] / r['out']['median']:.2f}")
        for r in found["rows"]
    ]  # fmt: skip
    text = (
        f"Measured {found['date']} on {found['cpu']}, each in a fresh process: processor time per state of the method. The"
        " first call compiles or loads the kernel; fresh is from the third call on, each result dropped before the next call,"
        " then when the next is there, which takes two places in turns; and the same into `out=`."
    )
    head = ("", "", "states", "first call", "fresh", "fresh, the last one held", "into `out=`", "fresh over `out=`")
    return section("Fresh results", text, head, rows)


def single(results: dict[str, Any]) -> str:
    """Float32: how fast, and how wrong."""
    found = results.get("float32")
    if not found:
        return ""
    rows, states = [], 0
    for name, robot in found["robots"].items():
        states = robot["states"]
        for quantity, each in robot["quantities"].items():
            timings = each["timings"]
            best = best_build(timings)
            anchor = duration(timings[best]["median"]) if best else "–"
            factor = times(timings[best]["median"] / timings[SINGLE_METHOD]["median"]) if best else "–"
            double = times(timings[DOUBLE_METHOD]["median"] / timings[SINGLE_METHOD]["median"])
            mine = f"{duration(timings[SINGLE_METHOD]['median'])} {quartiles(timings[SINGLE_METHOD])}"
            errors = f"{each['median']:.0e}", f"{each['worst']:.0e}"
            rows.append((name, title(quantity), str(robot["batch"]), mine, double, anchor, f"**{factor}**", *errors))
    text = (
        f"{measured_on(found)}: the method with arrays of float32, time per state; how many times faster than the same in"
        " float64, and than the best build of Pinocchio in C++, which computes in float64. The error is the arithmetic's"
        f" alone, from the same inputs: of each of {states:,} states the largest, as a share of its result's largest"
        " entry; median and worst over the states."
    )
    head = ("", "", "N", "float32", "over our float64", "Pinocchio C++", "over it", "median error", "worst error")
    return section("float32 against float64", text, head, rows)


def rollouts(results: dict[str, Any]) -> str:
    """Panda under PD control, ours and MuJoCo's."""
    found = results.get("rollout")
    if not found:
        return ""
    batch, one = found["batch"], found["one"]
    peer = "MuJoCo"
    rows = []
    for name, timing in batch.items():
        label = name if name in (peer, "twistwrench") else f"twistwrench, {name}"
        of_one = _one_motion(one[name]) if name in one else "–"
        text = f"{duration(timing['median'])} {quartiles(timing)} **{times(batch[peer]['median'] / timing['median'])}**"
        rows.append((f"**{label}**" if name == "twistwrench" else label, text, of_one))
    text = (
        f"{measured_on(found)}, one core: panda under PD control in steps of 1 ms, {found['size']} motions of"
        f" {found['steps']} steps, time per step and how many times faster than `mujoco.rollout` on one thread; and one"
        " motion of 1000 steps. Both take semi-implicit steps, MuJoCo with its position actuators and nothing but mechanics"
        " (no contacts, limits, damping, sensors), and write every state into arrays that are used again; variants of"
        f" ours change the one thing they name, and make fresh arrays. The final states of both agree to"
        f" {found['agreement']:.0e}."
    )
    head = ("", "per step of the batch", "one motion of a second, times real time")
    return section("Rollouts", text, head, rows)


def simulations(results: dict[str, Any]) -> str:
    """A second of panda by ``simulate``, and by a loop of ``mj_step``."""
    found = results.get("simulate")
    if not found:
        return ""
    loop = found["times"]["mj_step"]["median"]
    rows = [
        (
            name if name.startswith("mj_step") else f"**twistwrench, {name}**",
            _one_motion(timing),
            f"{timing['median'] / loop:.2f}",
        )
        for name, timing in found["times"].items()
    ]
    text = (
        f"{measured_on(found)}, one core: `robot.simulate` of panda, {found['steps']} steps of 1 ms (`dopri5`: as many states,"
        " in steps of its own), from a call to a result with all states, energies, works and an estimate of the error;"
        " beside a Python loop of MuJoCo's `mj_step` with nothing but mechanics, which keeps nothing. The states of both"
        f" after 100 steps agree to {found['agreement']:.0e}."
    )
    if any("controller" in name for name in found["times"]):
        text += " With a controller both ask one function in Python every step, and hold its torques for the step."
    if any("plane" in name for name in found["times"]):
        text += (
            " With stops of all joints and a plane, ours looks for the beginning of each contact as well; `mj_step` has no"
            " contact on. Of a batch (`robot.simulate_batch`) one motion is timed, in the time of all over their number."
        )
    return section("Simulations", text, ("", "one motion of a second, times real time", "of `mj_step`'s time"), rows)


def closed_loops(results: dict[str, Any]) -> str:
    """Ten seconds of a four-bar linkage on its loop."""
    found = results.get("closed")
    if not found:
        return ""
    rows = [
        (
            name if name.startswith("mj_step") else f"**twistwrench, {name}**",
            f"{duration(timing['median'])} {quartiles(timing)}",
            "–" if name == "rollout" else duration(found["steps"] * timing["median"]),
        )
        for name, timing in found["times"].items()
    ]
    text = (
        f"{measured_on(found)}, one core: a four-bar linkage of `robot.close`, {found['steps']:,} steps of 1 ms by"
        f" `closed.simulate`, each projected back onto the loop, {found['gap']:.0e} m open at most; `closed.rollout` of"
        f" {found['motions']} motions with semi-implicit steps; and a Python loop of MuJoCo's `mj_step`, whose pin is a spring."
    )
    return section("Closed loops", text, ("", "a step", "the whole motion"), rows)


def _one_motion(timing: dict[str, float]) -> str:
    """How long a second of 1000 steps takes."""
    took = 1000 * timing["median"]
    return f"{duration(took)}, {1e9 / took:,.0f} ×"


def compiling(results: dict[str, Any]) -> str:
    """All kernels together, without a cache."""
    found = results.get("compile")
    if not found:
        return ""
    rows = [
        (name, f"{each['wall']:.2f} s", f"{each['processor']:.2f} s", str(each["processes"]))
        for name, each in found["robots"].items()
    ]
    names = ", ".join(title(quantity) for quantity in found["quantities"])
    text = (
        f"Measured {found['date']} on {found['cpu']}, medians of fresh processes without a cache: {names};"
        f" and {title(found['quantities'][0])} in float32. The robot's file is read before the clock starts."
    )
    return section("Compiling all that is compared", text, ("", "wall", "processor", "processes"), rows)


def inverse_kinematics(results: dict[str, Any]) -> str:
    """Poses of the panda, beside the Robotics Toolbox."""
    found = results.get("inverse_kinematics")
    if not found:
        return ""
    rows = []
    for way, pair in found["rows"].items():
        ours, theirs, reached = pair["ours"], pair.get("theirs"), pair["reached"]
        row = [way, f"{duration(ours['median'])} {quartiles(ours)}", f"{100 * reached['ours']:.4g} %"]
        if theirs is None:
            row += ["–", "–", "–"]
        else:
            row += [f"{duration(theirs['median'])} {quartiles(theirs)}", f"{100 * reached['theirs']:.4g} %"]
            row += [f"**{times(theirs['median'] / ours['median'])}**"]
        rows.append(row)
    text = (
        f"{measured_on(found)}: a random reachable pose of the panda within its limits, to 1e-10 rad and m, means over the same"
        " poses. The Toolbox's `ik_LM` is C++ that is called from Python, a pose at a time; later versions put more Python"
        " around it."
    )
    head = (
        "",
        "twistwrench",
        "reached",
        f"Robotics Toolbox {found.get('toolbox', '')}, `ik_LM`",
        "reached",
        "times as fast",
    )
    return section("Inverse kinematics", text, head, rows)


def long_chain(results: dict[str, Any]) -> str:
    """A chain of many links."""
    found = results.get("long_chain")
    if not found:
        return ""
    rows = [
        (title(quantity), f"{row['compile']:.1f} s",
         *(f"{duration(t['median'])} {quartiles(t)}" for t in (row["timings"][k] for k in ("batch", "one", "Pinocchio"))))
        for quantity, row in found["rows"].items()
    ]  # fmt: skip
    text = (
        f"{measured_on(found)}: a chain of {found['links']} revolute joints. Compiling is processor time without a cache;"
        f" then time a state, {found['states']} at once with `out=`, and one by one."
    )
    head = ("", "compiling", "a batch", "one call", "Pinocchio, Python call")
    return section("A long chain", text, head, rows)
