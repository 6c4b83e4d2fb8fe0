"""The section on ``robot.simulate``: a second of panda, beside a Python loop of MuJoCo's ``mj_step``.

Ours gives energies, works, momentum, an estimate of the error and every state; the loop steps, and keeps nothing. Nothing but
mechanics is on in either. Then the same with a controller in Python, which both ask every step. The states after a tenth of a
second are compared before anything is timed. Ours alone: with stops of the joints and a plane that the hand runs into, and
batches of motions.
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
from twistwrench.simulation import JointStops, Plane

STEPS, DT = 1000, 1e-3
METHODS = ("rk4", "semi_implicit", "dopri5")
LOOP, LOOP_RK4 = "mj_step", "mj_step, RK4"
STEERED = (("semi_implicit", LOOP), ("rk4", LOOP_RK4))
AND, ITSELF = ", controller", "mj_step's controller itself"
TOUCHING = ("rk4", "semi_implicit", "dopri5")
STOPS, BATCH = ", stops and a plane", 64
KP, KD = 100.0, 5.0
TOLERANCE = 1e-8  # a hundred steps of two programs that round differently


def times(rounds: int = ROUNDS) -> dict[str, Any]:
    """Nanoseconds per step of one motion of a second."""
    case = next(c for c in CASES if c.name == "panda")
    where = machine.describe()  # this section may be newer than the others
    print(f"simulate: {case.name}, one motion of {STEPS} steps", flush=True)
    states = States.random(case, 1)
    ours, loops = _Ours(case, states), {name: _Loop(case, states, rk4=name == LOOP_RK4) for name in (LOOP, LOOP_RK4)}
    ways = [(m, n, steered) for m, n in STEERED for steered in (False, True)]
    gaps = [_gap(ours.after(100, m, steered=x), loops[n].after(100, steered=x)) for m, n, x in ways]
    contenders = [Contender(method, ours.sweep(method), STEPS) for method in METHODS]
    contenders += [Contender(name, loop.sweep(), STEPS) for name, loop in loops.items()]
    contenders += [Contender(method + AND, ours.sweep(method, steered=True), STEPS) for method, _ in STEERED]
    contenders += [Contender(name + AND, loop.sweep(steered=True), STEPS) for name, loop in loops.items()]
    contenders.append(Contender(ITSELF, ours.asked, STEPS))
    contenders += [Contender(method + STOPS, ours.sweep(method, touching=True), STEPS) for method in TOUCHING]
    for touching in (False, True):
        name = f"rk4{STOPS * touching}, one of a batch of {BATCH}"
        contenders.append(Contender(name, ours.batch(touching=touching), STEPS * BATCH))
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


def _controller(rest: np.ndarray) -> Callable[[float, np.ndarray, np.ndarray], np.ndarray]:
    def hold(_t: float, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        return np.asarray(KP * (rest - q) - KD * dq)

    return hold


class _Ours:
    def __init__(self, case: Case, states: States) -> None:
        ours = Ours(case)
        self.robot = ours.robot
        self.q, self.dq = (np.ascontiguousarray(x[0, ours.q_index]) for x in (states.q, states.dq))
        self.hold = _controller(np.zeros_like(self.q))
        hand = self.robot.frame_names[-1]
        height = float(self.robot.forward_kinematics(self.q, hand)[2, 3]) - 0.05
        self.contacts = [
            JointStops(stiffness=1e4, dissipation=0.2),
            Plane(hand, height=height, stiffness=1e4, dissipation=0.2, friction=0.3),
        ]

    def after(self, steps: int, method: str, *, steered: bool = False, touching: bool = False) -> np.ndarray:
        given = {"controller": self.hold if steered else None, "contacts": self.contacts if touching else ()}
        found = self.robot.simulate(self.q, self.dq, steps * DT, DT, method=method, **given)
        return np.concatenate([found.q[-1], found.dq[-1]])

    def sweep(self, method: str, *, steered: bool = False, touching: bool = False) -> Callable[[int], None]:
        def sweep(times: int) -> None:
            for _ in range(times):
                self.after(STEPS, method, steered=steered, touching=touching)

        return sweep

    def batch(self, *, touching: bool) -> Callable[[int], None]:
        q, contacts = np.tile(self.q, (BATCH, 1)), self.contacts if touching else ()

        def sweep(times: int) -> None:
            for _ in range(times):
                self.robot.simulate_batch(q, self.dq, STEPS * DT, DT, method="rk4", contacts=contacts)

        return sweep

    def asked(self, times: int) -> None:
        """The controller as often as a run asks it, and nothing else."""
        for _ in range(times * STEPS):
            self.hold(0.0, self.q, self.dq)


class _Loop:
    def __init__(self, case: Case, states: States, *, rk4: bool) -> None:
        self.model = peer_mujoco.MuJoCo(case).model
        self.model.opt.timestep = DT
        kind = mujoco.mjtIntegrator
        self.model.opt.integrator = kind.mjINT_RK4 if rk4 else kind.mjINT_EULER
        self.data = mujoco.MjData(self.model)
        self.states = states
        self.hold = _controller(np.zeros_like(states.q[0]))

    def after(self, steps: int, *, steered: bool) -> np.ndarray:
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        q, dq, tau, hold = data.qpos, data.qvel, data.qfrc_applied, self.hold
        q[:], dq[:], tau[:] = self.states.q[0], self.states.dq[0], 0.0
        step = mujoco.mj_step
        for _ in range(steps):
            if steered:
                tau[:] = hold(data.time, q, dq)
            step(model, data)
        return np.concatenate([q, dq])

    def sweep(self, *, steered: bool = False) -> Callable[[int], None]:
        def sweep(times: int) -> None:
            for _ in range(times):
                self.after(STEPS, steered=steered)

        return sweep
