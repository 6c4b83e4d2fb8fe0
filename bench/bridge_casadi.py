"""CasADi: our functions of SX beside ADAM's, evaluated by CasADi's virtual machine, and optimal control with both.

Torques, their slope by (q, dq, ddq), and the gradient of their square: as CasADi derives them, and by our kernels.
"""

from typing import Any

import numpy as np

import twistwrench as tw
from bench.bridge_panda import KERNEL, OURS, STATES, Panda, installed, repeated, require_agreement, timed
from bench.optimal_control import reaching, solutions, swing_up

PACKAGES = ("casadi", "adam-robotics")
MAPPED = 512
"""States of a batch: CasADi's map evaluates them one after another."""
BY = ("q", "dq", "ddq")


def times(panda: Panda, rounds: int) -> dict[str, Any]:
    """Every contender's times, and how many nodes its torques have."""
    import casadi

    missing: dict[str, str] = {}
    functions = _torques(panda.path, panda.robot, missing)
    x = [casadi.SX.sym(name, panda.robot.nv) for name in BY]
    every, batch, one = casadi.vertcat(*x), panda.states(MAPPED), panda.states(1)
    rows: dict[str, dict[str, Any]] = {"nodes of tau": {name: f.n_nodes() for name, f in functions.items()}}
    for what, kernel in _kernels(panda).items():
        made = {name: casadi.Function(what, x, [_derived(what, f(*x), every)]) for name, f in functions.items()}
        few = [s[:STATES] for s in batch]
        for name, f in made.items():
            values = f.map(STATES, "serial")(*(s.T for s in few)).toarray()
            require_agreement("CasADi", name, what, _by_state(values, what), kernel(*few))
        single = [repeated(KERNEL, kernel, [s[0] for s in one], 1)]
        many = [repeated(KERNEL, kernel, batch, MAPPED)]
        for name, f in made.items():
            single.append(repeated(name, f, [casadi.DM(s[0]) for s in one], 1))
            many.append(repeated(name, f.map(MAPPED, "serial"), [casadi.DM(s.T) for s in batch], MAPPED))
        for how, contenders in (("one call", single), (f"map over {MAPPED}", many)):
            rows[f"{what}, {how}"] = timed(contenders, rounds)
    return {"packages": installed(*PACKAGES), "missing": missing, "rows": rows}


def optimal_control(panda: Panda, rounds: int) -> dict[str, Any]:
    """Reaching and a swing-up, solved with each package's torques."""
    missing: dict[str, str] = {}
    two_links = panda.folder / "planar_2r.urdf"
    tw.save(tw.robots.planar_2r(), two_links)
    two = tw.load(two_links)
    problems = (
        (reaching(panda.robot), _torques(panda.path, panda.robot, missing)),
        (swing_up(two), _torques(two_links, two, missing)),
    )
    rows = {problem.name: solutions(problem, functions, rounds) for problem, functions in problems}
    return {"packages": installed(*PACKAGES), "missing": missing, "rows": rows}


def _derived(what: str, tau: Any, by: Any) -> Any:
    import casadi

    return {
        "tau": lambda: tau,
        "slope": lambda: casadi.jacobian(tau, by),
        "gradient": lambda: casadi.gradient(casadi.sumsqr(tau), by),
    }[what]()


def _by_state(values: np.ndarray, what: str) -> np.ndarray:
    """States first; CasADi's map has what belongs to them side by side."""
    if what == "slope":
        return values.reshape(len(values), STATES, -1).swapaxes(0, 1)
    return values.T


def _kernels(panda: Panda) -> dict[str, Any]:
    robot, inverse = panda.robot, panda.kernels["inverse_dynamics"]
    slope = robot.kernel("inverse_dynamics", by=BY)
    weighted = robot.kernel("inverse_dynamics", by=BY, form="weighted")
    return {
        "tau": inverse,
        "slope": lambda q, dq, ddq: np.concatenate(slope(q, dq, ddq), axis=-1),
        "gradient": lambda q, dq, ddq: np.concatenate(weighted(q, dq, ddq, 2 * inverse(q, dq, ddq)), axis=-1),
    }


def _torques(path: Any, robot: tw.Robot, missing: dict[str, str]) -> dict[str, Any]:
    """Functions of (q, dq, ddq)."""
    found = {OURS: robot.to_casadi("inverse_dynamics")}
    try:
        found["ADAM"] = _adam(path, robot)
    except ImportError as error:
        missing["ADAM"] = str(error)
    return found


def _adam(path: Any, robot: tw.Robot) -> Any:
    """As its users make it, with what it computes twice computed once."""
    import casadi
    from adam.casadi import KinDynComputations

    model = KinDynComputations(str(path), list(robot.joint_names), gravity=np.array([0, 0, -9.81, 0, 0, 0]))
    base, still = casadi.SX.eye(4), casadi.SX.zeros(6)
    x = [casadi.SX.sym(name, robot.nv) for name in BY]
    tau = model.mass_matrix(base, x[0])[6:, 6:] @ x[2] + model.bias_force(base, x[0], still, x[1])[6:]
    return casadi.Function("tau", x, [tau], {"cse": True})
