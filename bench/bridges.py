"""The same programs in other packages, beside who writes for those packages: `python -m bench.bridges`, to bench/BRIDGES.md.

JAX: ADAM, frax and MJX; CasADi: ADAM. Every contender computes the panda of `example-robot-data` with its fingers fixed, in
float64, on one core, and is compared with ours on 64 states before anything is timed. ADAM gives M and h of a floating base,
frax M and h: torques are made of them as their users do. Compiling is not timed; what is missing is said.
"""

import os

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # one core, as all else here

import argparse
import tempfile
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import twistwrench as tw
from bench import machine
from bench.cases import CASES
from bench.optimal_control import reaching, swing_up, table
from bench.timing import ROUNDS, Contender, Timing, interleave, pin_to_one_core

HERE = Path(__file__).parent
QUANTITIES = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
BATCH = 4096
PACKAGES = ("twistwrench", "jax", "casadi", "adam-robotics", "frax", "mujoco-mjx")
Functions = dict[str, Callable[..., Any]]
"""By quantity, a function of one state's (q, dq, x), x the accelerations or torques."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Time JAX and CasADi functions of one robot, on one core.")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    rounds = parser.parse_args().rounds
    pin_to_one_core()
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore")
    case = next(c for c in CASES if c.name == "panda")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "panda.urdf")
        path.write_text(case.text)
        robot = tw.load(path)
        missing: dict[str, str] = {}
        in_jax = {"twistwrench": _ours(robot), **_peers(path, robot, missing)}
        lines = [
            *_head(missing),
            *_jax_table(robot, in_jax, rounds),
            *_casadi_table(path, robot, rounds),
            *_optimal_control_table(path, robot, rounds),
        ]
    (HERE / "BRIDGES.md").write_text("\n".join(lines) + "\n")
    print(f"wrote {HERE / 'BRIDGES.md'}")


def _ours(robot: tw.Robot) -> Functions:
    inverse, mass, forward = (robot.to_jax(name) for name in QUANTITIES)
    return {"inverse_dynamics": inverse, "mass_matrix": lambda q, *_: mass(q), "forward_dynamics": forward}


def _peers(path: Path, robot: tw.Robot, missing: dict[str, str]) -> dict[str, Functions]:
    found = {}
    for name, make in (("ADAM", _adam), ("frax", _frax), ("MJX", _mjx)):
        try:
            found[name] = make(path, robot)
        except ImportError as error:
            missing[name] = str(error)
    return found


def _adam(path: Path, robot: tw.Robot) -> Functions:
    """Of any batch shape, which is how ADAM is used on batches."""
    from adam.jax import KinDynComputations

    model = KinDynComputations(str(path), list(robot.joint_names), gravity=jnp.array([0, 0, -9.81, 0, 0, 0]))

    def parts(q: Any, dq: Any) -> tuple[Any, Any]:
        base = jnp.broadcast_to(jnp.eye(4), (*q.shape[:-1], 4, 4))
        h = model.bias_force(base, q, jnp.zeros((*q.shape[:-1], 6)), dq)
        return model.mass_matrix(base, q)[..., 6:, 6:], h[..., 6:]

    def torques(q: Any, dq: Any, ddq: Any) -> Any:
        M, h = parts(q, dq)
        return jnp.einsum("...ij,...j->...i", M, ddq) + h

    def accelerations(q: Any, dq: Any, tau: Any) -> Any:
        M, h = parts(q, dq)
        return jnp.linalg.solve(M, (tau - h)[..., None])[..., 0]

    return {
        "inverse_dynamics": torques,
        "mass_matrix": lambda q, dq, _: parts(q, dq)[0],
        "forward_dynamics": accelerations,
    }


def _frax(path: Path, robot: tw.Robot) -> Functions:
    from frax import Robot

    model = Robot(str(path), joint_ordering=list(robot.joint_names))

    def torques(q: Any, dq: Any, ddq: Any) -> Any:
        return model.mass_matrix(q) @ ddq + model.nonlinear_bias(q, dq)

    return {
        "inverse_dynamics": torques,
        "mass_matrix": lambda q, *_: model.mass_matrix(q),
        "forward_dynamics": lambda q, dq, tau: model.forward_dynamics(q, dq, tau, None),
    }


def _mjx(_: Path, robot: tw.Robot) -> Functions:
    from mujoco import mjx

    theirs = robot.to_mujoco()
    theirs.dof_damping[:] = theirs.dof_frictionloss[:] = 0  # friction neither
    theirs.opt.disableflags |= 1 << 4 | 1 << 0  # contacts and constraints: not part of what is compared
    model = mjx.put_model(theirs)

    def state(q: Any, dq: Any) -> Any:
        return mjx.make_data(model).replace(qpos=q, qvel=dq)

    def torques(q: Any, dq: Any, ddq: Any) -> Any:
        return mjx.inverse(model, state(q, dq).replace(qacc=ddq)).qfrc_inverse

    def accelerations(q: Any, dq: Any, tau: Any) -> Any:
        return mjx.forward(model, state(q, dq).replace(qfrc_applied=tau)).qacc

    return {"inverse_dynamics": torques, "forward_dynamics": accelerations}


def _states(robot: tw.Robot, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return robot.random_configuration(0, count), rng.normal(size=(count, robot.nv)), rng.normal(size=(count, robot.nv))


def _jax_table(robot: tw.Robot, functions: dict[str, Functions], rounds: int) -> list[str]:
    lines = [
        "## JAX",
        "",
        "Time per state: the median of the rounds, the quartiles; how many times ours is faster.",
        "",
    ]
    few, many = _states(robot, 64), tuple(map(jnp.asarray, _states(robot, BATCH)))
    one = tuple(x[0] for x in many)
    rows: dict[str, list[str]] = {}
    header = []
    for quantity in QUANTITIES:
        single, batch = {}, {}
        for name, mine in functions.items():
            if quantity not in mine:
                continue
            function = mine[quantity]
            alone, together = jax.jit(function), jax.jit(function if name == "ADAM" else jax.vmap(function))
            off = _difference(together(*few), functions["twistwrench"][quantity](*map(jnp.asarray, few)))
            print(f"{quantity}: {name} differs by {off:.1e}", flush=True)
            if off > 1e-6:
                raise SystemExit(f"{name} computes another {quantity}")
            single[name] = _contender(name, alone, one, 1)
            batch[name] = _contender(name, together, many, BATCH)
        title = quantity.replace("_", " ")
        header += [f"{title}, one call", f"{title}, vmap of {BATCH}"]
        for contenders in (single, batch):
            timings = interleave(list(contenders.values()), rounds)
            for name in functions:
                rows.setdefault(name, []).append(_cell(name, timings))
    return [*lines, *_table(header, rows), ""]


def _contender(name: str, function: Callable[..., Any], arguments: tuple[Any, ...], samples: int) -> Contender:
    def sweep(times: int) -> None:
        for _ in range(times):
            found = function(*arguments)
        found.block_until_ready()

    return Contender(name, sweep, samples)


def _casadi_table(path: Path, robot: tw.Robot, rounds: int) -> list[str]:
    import casadi

    x = [casadi.SX.sym(name, robot.nv) for name in ("q", "dq", "ddq")]
    functions = _casadi_torques(path, robot)
    states = [casadi.DM(s[:512].T) for s in _states(robot, 512)]
    rows: dict[str, list[str]] = {name: [str(f.n_nodes())] for name, f in functions.items()}
    header = ["nodes of tau"]
    everything = casadi.vertcat(*x)
    for what, make in (
        ("tau", lambda f: f),
        ("its Jacobian by q, dq, ddq", lambda f: casadi.Function("J", x, [casadi.jacobian(f(*x), everything)])),
        (
            "the gradient of its square",
            lambda f: casadi.Function("g", x, [casadi.gradient(casadi.sumsqr(f(*x)), everything)]),
        ),
    ):
        made = {name: make(f) for name, f in functions.items()}
        values = {name: f.map(512, "serial")(*states).toarray() for name, f in made.items()}
        off = _difference(values["ADAM"], values["twistwrench"])
        print(f"CasADi, {what}: ADAM differs by {off:.1e}", flush=True)
        if off > 1e-6:
            raise SystemExit("ADAM computes another torque")
        timings = interleave(
            [_casadi_contender(name, f.map(512, "serial"), states) for name, f in made.items()], rounds
        )
        header.append(what)
        for name in functions:
            rows[name].append(_cell(name, timings))
    return [
        "## CasADi",
        "",
        "Functions of SX, evaluated by CasADi's virtual machine, `map` over 512 states: time per state.",
        "",
        *_table(header, rows),
    ]


def _casadi_torques(path: Path, robot: tw.Robot) -> dict[str, Any]:
    """Functions of (q, dq, ddq); ADAM's as its users make it, with what it computes twice computed once."""
    import casadi
    from adam.casadi import KinDynComputations

    model = KinDynComputations(str(path), list(robot.joint_names), gravity=np.array([0, 0, -9.81, 0, 0, 0]))
    base, still = casadi.SX.eye(4), casadi.SX.zeros(6)
    x = [casadi.SX.sym(name, robot.nv) for name in ("q", "dq", "ddq")]
    tau = model.mass_matrix(base, x[0])[6:, 6:] @ x[2] + model.bias_force(base, x[0], still, x[1])[6:]
    return {"twistwrench": robot.to_casadi("inverse_dynamics"), "ADAM": casadi.Function("tau", x, [tau], {"cse": True})}


def _optimal_control_table(path: Path, arm: tw.Robot, rounds: int) -> list[str]:
    two_links = path.with_name("planar_2r.urdf")
    tw.save(tw.robots.planar_2r(), two_links)
    two = tw.load(two_links)
    lines = [
        "",
        "## Optimal control",
        "",
        "IPOPT (exact Hessian, MUMPS) on the same problems, trapezoidal rule, torques of every node bounded; both make the",
        "same iterates. Processor time of all evaluations of functions, Jacobians and Hessians, and of the whole solution.",
        "Reaching: the panda in 1 s, 30 nodes, half of its torques. Swing-up: two links in 3 s, 60 nodes, with a third of the",
        "torque that holds them stretched out.",
        "",
        "|  |  | iterations | cost | evaluations | in all |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for problem, file, robot in ((reaching(arm), path, arm), (swing_up(two), two_links, two)):
        lines += table(problem, _casadi_torques(file, robot), rounds)
    return lines


def _casadi_contender(name: str, function: Any, states: list[Any]) -> Contender:
    def sweep(times: int) -> None:
        for _ in range(times):
            function(*states)

    return Contender(name, sweep, 512)


def _difference(one: Any, other: Any) -> float:
    one, other = np.asarray(one), np.asarray(other)
    return float(np.abs(one - other).max() / np.abs(other).max())


def _cell(name: str, timings: dict[str, Timing]) -> str:
    if name not in timings:
        return "–"
    t = timings[name]
    text = f"{_time(t.median)} [{_time(t.low)}–{_time(t.high)}]"
    return text if name == "twistwrench" else f"{text} **{t.median / timings['twistwrench'].median:.3g} ×**"


def _time(nanoseconds: float) -> str:
    return f"{nanoseconds:.3g} ns" if nanoseconds < 1e3 else f"{nanoseconds / 1e3:.3g} µs"


def _table(header: list[str], rows: dict[str, list[str]]) -> list[str]:
    return [
        f"|  | {' | '.join(header)} |",
        f"|{' --- |' * (len(header) + 1)}",
        *(f"| {name} | {' | '.join(cells)} |" for name, cells in rows.items()),
    ]


def _head(missing: dict[str, str]) -> list[str]:
    about = machine.describe()
    versions = [f"{name} {version(name)}" for name in PACKAGES if name not in missing]
    return [
        "# Other packages",
        "",
        "Written by `python -m bench.bridges`; do not edit. The panda of example-robot-data with its fingers fixed,",
        "float64, one core; every contender agreed with ours to 1e-6 before anything was timed. Bold: times as long as ours.",
        "",
        f"- {about['date']}, {about['cpu']} ({about['family']}; {about['vectors']} side by side), Python {about['python']}",
        f"- {', '.join(versions)}",
        *(f"- {name} is missing: {why}" for name, why in missing.items()),
        "",
    ]


if __name__ == "__main__":
    main()
