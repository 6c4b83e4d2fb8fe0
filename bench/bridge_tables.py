"""The tables about other packages as text, from what was measured."""

from typing import Any

from bench.markdown import duration, quartiles, section, times

OURS = "twistwrench"
TITLES = {
    "jax": "JAX",
    "torch": "PyTorch",
    "casadi": "CasADi",
    "optimal_control": "Optimal control",
    "javascript": "JavaScript",
}
ABOUT = {
    "jax": "Jitted; ours is a custom call of compiled code, the others are programs of JAX's operations. A batch is `vmap`"
    " of one state, and ADAM's own batch axis where nothing is differentiated. The gradient"
    " is `jax.grad` of |τ|² by q, the derivative `jax.jacrev` of τ by q.",
    "torch": "Tensors on the processor, one thread. A batch is one call; the gradient is that of |τ|² by q, forward and"
    " backward.",
    "casadi": "Functions of SX, evaluated by CasADi's virtual machine, called from Python. The derivative of τ and the"
    " gradient of |τ|² are by q, q̇ and q̈.",
    "optimal_control": "IPOPT (exact Hessian, MUMPS) on the same problems, trapezoidal rule, torques of every node bounded;"
    " all make the same iterates. Processor time of all evaluations of functions, Jacobians and Hessians, and of the whole"
    " solution. Reaching: the panda in 1 s, 30 nodes, half of its torques. Swing-up: two links in 3 s, 60 nodes, with a"
    " third of the torque that holds them stretched out.",
    "javascript": "Under Node, in a loop over 512 states after as many calls as make it steady; MuJoCo and Pinocchio are"
    " WebAssembly. The Jacobian is that of the last link, along the base's axes.",
}
SAID = {
    "gradient": "gradient of \\|τ\\|²",
    "slope": "derivative of τ",
    "tau": "τ",
    "jacobian": "Jacobian",
}
"""Names of rows; the others are quantities'."""


def report(results: dict[str, Any]) -> str:
    """BRIDGES.md."""
    head = [
        "# Other packages",
        "",
        "Written by `make bench-bridges`; do not edit. The panda of example-robot-data with its fingers fixed, float64, one",
        "core. Every contender agreed with our kernels to 1e-6 before anything was timed; compiling is not timed. Times for",
        "one state: the median of interleaved rounds, and quartiles. Bold: how many times as long as ours in that package.",
        "The first column is our compiled code called from Python with NumPy's arrays, without another package.",
    ]
    parts = [section(TITLES[name], _about(name, found), *_table(name, found)) for name, found in results.items()]
    return "\n\n".join(["\n".join(head), *parts]) + "\n"


def _about(name: str, found: dict[str, Any]) -> str:
    m = found["machine"]
    lines = [
        ABOUT[name],
        "",
        f"- {m['date']}, {m['cpu']} ({m['family']}; {m['vectors']} side by side), Python {m['python']}, {found['rounds']}"
        " rounds",
        "- " + ", ".join(f"{package} {version}" for package, version in found["packages"].items()),
        *(f"- missing: **{peer}**: {why}" for peer, why in found["missing"].items()),
    ]
    return "\n".join(lines)


def _table(name: str, found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    if name == "optimal_control":
        return _solutions(found["rows"])
    names = list(dict.fromkeys(who for row in found["rows"].values() for who in row))
    names.sort(key=lambda who: (not who.startswith(OURS), who == OURS))  # our kernel, ours, the others
    rows = [
        [_said(what), *(_cell(row.get(who), row.get(OURS)) for who in names)] for what, row in found["rows"].items()
    ]
    return ["", *names], rows


def _solutions(problems: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for problem, runs in problems.items():
        for who, run in runs.items():
            spent = [_cell(run[what], runs[OURS][what]) for what in ("evaluations", "in all")]
            rows.append([problem, who, str(run["iterations"]), f"{run['cost']:g}", *spent])
    return ["", "", "iterations", "cost", "evaluations", "in all"], rows


def _said(what: str) -> str:
    quantity, comma, how = what.partition(",")
    return SAID.get(quantity, quantity.replace("_", " ")) + comma + how


def _cell(found: Any, ours: Any) -> str:
    """Median, quartiles, and how many times ours it is."""
    if not isinstance(found, dict):
        return _plain(found)
    ratio = "" if found is ours else f" **{times(found['median'] / ours['median'])}**"
    return f"{duration(found['median'])} {quartiles(found)}{ratio}"


def _plain(found: Any) -> str:
    return "–" if found is None else f"{found:,}"
