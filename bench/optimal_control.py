"""One optimal control problem, solved by IPOPT with our CasADi functions and with ADAM's: a part of `python -m bench.bridges`.

Variables are q, dq, ddq at the nodes of a grid; the trapezoidal rule links them, and the torques tau(q, dq, ddq) of every node
are bounded, so that nobody inverts M. The cost is the integral of their squares, with a little of ddq's. Everything but the
function of torques is the same text for both: start, tolerances, exact Hessian, linear solver.
"""

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import twistwrench as tw
from bench.timing import Timing

OPTIONS = {
    "print_time": False,
    "record_time": True,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8, "max_iter": 500},
}
EVALUATIONS = ("nlp_f", "nlp_g", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l")
"""What the solver asks of the functions: CasADi times each of them."""


@dataclass(frozen=True)
class Problem:
    """From one state of rest to another in a given time, with bounds on the torques."""

    name: str
    start: np.ndarray
    goal: np.ndarray
    effort: np.ndarray
    seconds: float
    nodes: int

    def solver(self, torques: Any) -> tuple[Any, dict[str, Any]]:
        """IPOPT on this problem with this CasADi function of (q, dq, ddq), and the arguments of a call of it."""
        import casadi

        n, N, h = len(self.start), self.nodes, self.seconds / (self.nodes - 1)
        q, dq, ddq = (casadi.MX.sym(name, n, N) for name in ("q", "dq", "ddq"))
        tau = torques.map(N, "serial")(q, dq, ddq)
        weight = np.full(N, h)  # of the trapezoidal rule
        weight[[0, -1]] = h / 2
        cost = casadi.sum2((casadi.sum1((tau / self.effort) ** 2) + 1e-4 * casadi.sum1(ddq**2)) * weight[None])
        gaps = [x[:, 1:] - x[:, :-1] - h / 2 * (dx[:, 1:] + dx[:, :-1]) for x, dx in ((q, dq), (dq, ddq))]
        rest = [q[:, 0] - self.start, dq[:, 0], q[:, -1] - self.goal, dq[:, -1]]
        g = casadi.veccat(*gaps, *rest, tau)
        bound = np.concatenate([np.zeros(g.numel() - n * N), np.tile(self.effort, N)])
        solver = casadi.nlpsol("solver", "ipopt", {"x": casadi.veccat(q, dq, ddq), "f": cost, "g": g}, OPTIONS)
        straight = np.linspace(self.start, self.goal, N)
        guess = np.concatenate([straight.ravel(), np.zeros(2 * n * N)])
        return solver, {"x0": guess, "lbg": -bound, "ubg": bound}


def reaching(robot: tw.Robot) -> Problem:
    """An arm from one pose to another in a second, with half of its torques."""
    start = np.array([0.0, -0.8, 0.0, -2.2, 0.0, 1.6, 0.8])
    goal = np.array([1.2, 0.4, -0.5, -1.2, 0.6, 2.2, -0.4])
    return Problem("reaching", start, goal, 0.5 * np.asarray(robot.limits.effort), 1.0, 30)


def swing_up(robot: tw.Robot) -> Problem:
    """An arm of two links from hanging to standing with a third of the torque that would hold it stretched out."""
    held = np.abs(robot.gravity_forces(np.zeros(2))).max()
    return Problem(
        "swing-up", np.array([-np.pi / 2, 0.0]), np.array([np.pi / 2, 0.0]), held * np.array([1 / 3, 1 / 3]), 3.0, 60
    )


@dataclass(frozen=True)
class Solved:
    """One solution, and the processor time of its evaluations and of all."""

    iterations: int
    cost: float
    evaluations: float
    seconds: float
    x: np.ndarray


def solved(solver: Any, arguments: dict[str, Any]) -> Solved:
    """One solution, timed."""
    begun = time.process_time()
    found = solver(**arguments)
    seconds = time.process_time() - begun
    stats = solver.stats()
    if not stats["success"]:
        raise SystemExit(f"not solved: {stats['return_status']}")
    spent = sum(stats[f"t_proc_{name}"] for name in EVALUATIONS)
    return Solved(stats["iter_count"], float(found["f"]), spent, seconds, np.asarray(found["x"]).ravel())


def solutions(problem: Problem, functions: dict[str, Any], rounds: int) -> dict[str, dict[str, Any]]:
    """By whose functions: both solve in turn, and must make the same iterates. Processor times in nanoseconds."""
    solvers = {name: problem.solver(f) for name, f in functions.items()}
    runs: dict[str, list[Solved]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, (solver, arguments) in solvers.items():
            runs[name].append(solved(solver, arguments))
    ours, *others = (each[0] for each in runs.values())
    for other in others:
        if other.iterations != ours.iterations or np.abs(other.x - ours.x).max() > 1e-6 * np.abs(ours.x).max():
            raise SystemExit(
                f"{problem.name}: {other.iterations} iterations to {other.cost}, ours {ours.iterations} to {ours.cost}"
            )
    return {
        name: {
            "iterations": each[0].iterations,
            "cost": float(f"{each[0].cost:.6g}"),
            "evaluations": asdict(Timing.of([1e9 * run.evaluations for run in each])),
            "in all": asdict(Timing.of([1e9 * run.seconds for run in each])),
        }
        for name, each in runs.items()
    }
