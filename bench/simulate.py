"""The section on ``robot.simulate``: a second of panda, beside a Python loop of MuJoCo's ``mj_step``.

Ours gives energies, works, momentum, an estimate of the error and every state; the loop steps, and keeps nothing. Nothing but
mechanics is on in either. The states after a tenth of a second are compared before anything is timed.
"""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import mujoco
import numpy as np

from bench import machine, peer_mujoco
from bench.cases import CASES, Case, States
from bench.ours import Ours
from bench.timing import ROUNDS, Contender, interleave

STEPS, DT = 1000, 1e-3
METHODS = ("rk4", "semi_implicit", "dopri5")
LOOP, LOOP_RK4 = "mj_step", "mj_step, RK4"
TOLERANCE = 1e-8  # a hundred steps of two programs that round differently


def times(rounds: int = ROUNDS) -> dict[str, Any]:
    """Nanoseconds per step of one motion of a second."""
    case = next(c for c in CASES if c.name == "panda")
    where = machine.describe()  # this section may be newer than the others
    print(f"simulate: {case.name}, one motion of {STEPS} steps", flush=True)
    states = States.random(case, 1)
    ours, loops = _Ours(case, states), {name: _Loop(case, states, rk4=name == LOOP_RK4) for name in (LOOP, LOOP_RK4)}
    gaps = [_gap(ours.after(100, m), loops[n].after(100)) for m, n in (("semi_implicit", LOOP), ("rk4", LOOP_RK4))]
    contenders = [Contender(method, ours.sweep(method), STEPS) for method in METHODS]
    contenders += [Contender(name, loop.sweep(), STEPS) for name, loop in loops.items()]
    return {
        **{name: where[name] for name in ("date", "cpu")},
        "rounds": rounds,
        "steps": STEPS,
        "agreement": max(gaps),
        "times": {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()},
    }


def _gap(ours: np.ndarray, theirs: np.ndarray) -> float:
    found = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    if not found < TOLERANCE:
        raise SystemExit(f"simulate: ours and MuJoCo's end {found:.1e} apart: nothing is timed")
    return found


class _Ours:
    def __init__(self, case: Case, states: States) -> None:
        ours = Ours(case)
        self.robot = ours.robot
        self.q, self.dq = (np.ascontiguousarray(x[0, ours.q_index]) for x in (states.q, states.dq))

    def after(self, steps: int, method: str) -> np.ndarray:
        found = self.robot.simulate(self.q, self.dq, steps * DT, DT, method=method)
        return np.concatenate([found.q[-1], found.dq[-1]])

    def sweep(self, method: str) -> Callable[[int], None]:
        def sweep(times: int) -> None:
            for _ in range(times):
                self.robot.simulate(self.q, self.dq, STEPS * DT, DT, method=method)

        return sweep


class _Loop:
    def __init__(self, case: Case, states: States, *, rk4: bool) -> None:
        self.model = peer_mujoco.MuJoCo(case).model
        self.model.opt.timestep = DT
        kind = mujoco.mjtIntegrator
        self.model.opt.integrator = kind.mjINT_RK4 if rk4 else kind.mjINT_EULER
        self.data = mujoco.MjData(self.model)
        self.states = states

    def after(self, steps: int) -> np.ndarray:
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = self.states.q[0], self.states.dq[0]
        step = mujoco.mj_step
        for _ in range(steps):
            step(model, data)
        return np.concatenate([data.qpos, data.qvel])

    def sweep(self) -> Callable[[int], None]:
        def sweep(times: int) -> None:
            for _ in range(times):
                self.after(STEPS)

        return sweep
