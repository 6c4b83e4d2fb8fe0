"""The section on rollouts: panda under PD control, ours in one kernel beside MuJoCo's own batch of rollouts.

Both take the same semi-implicit steps of 1 ms from the same states with the same law, kd at the end of the step as MuJoCo's
``implicitfast`` has it, and write every state into arrays that are used again. MuJoCo's law is its position actuators,
kp (ctrl - q) - kd dq; constraints, limits, contacts and sensors are
off. The final states are compared before anything is timed.
"""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

from bench import machine, peer_mujoco
from bench.cases import CASES, Case, States
from bench.ours import Ours
from bench.timing import ROUNDS, Contender, interleave
from twistwrench.simulation import BatchPD

SIZE, STEPS, SECOND, DT = 4096, 100, 1000, 1e-3
KP, KD = 100.0, np.array([10.0, 10, 10, 10, 1, 1, 0.5])
OURS, THEIRS = "twistwrench", "MuJoCo"
TOLERANCE = 1e-8  # a hundred steps of two programs that round differently


def times(rounds: int = ROUNDS, size: int = SIZE, steps: int = STEPS) -> dict[str, Any]:
    """Nanoseconds per step of a batch, of variants of ours, and of one motion of a second."""
    case = next(c for c in CASES if c.name == "panda")
    where = machine.describe()  # this section may be newer than the others
    print(f"rollout: {case.name}, {size} motions of {steps} steps", flush=True)
    states = States.random(case, size)
    ours, theirs = _Ours(case, states), _MuJoCo(case, states)
    gap = _gap(ours.final(steps), theirs.final(steps))
    batch = [
        Contender(OURS, ours.sweep(size, steps, again=True), size * steps),
        Contender(THEIRS, theirs.sweep(size, steps), size * steps),
        Contender("fresh arrays", ours.sweep(size, steps), size * steps),
        Contender("one state in ten", ours.sweep(size, steps, every=10), size * steps),
        Contender("float32", ours.sweep(size, steps, dtype=np.float32), size * steps),
        Contender("and gradient", ours.gradients(size, steps), size * steps),
        Contender("rk4", ours.sweep(size, steps, method="rk4"), size * steps),
    ]
    one = [Contender(OURS, ours.sweep(None, SECOND), SECOND), Contender(THEIRS, theirs.sweep(1, SECOND), SECOND)]
    return {
        **{name: where[name] for name in ("date", "cpu")},
        "rounds": rounds,
        "size": size,
        "steps": steps,
        "agreement": gap,
        "batch": {name: asdict(timing) for name, timing in interleave(batch, rounds).items()},
        "one": {name: asdict(timing) for name, timing in interleave(one, rounds).items()},
    }


def _gap(ours: np.ndarray, theirs: np.ndarray) -> float:
    found = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    if not found < TOLERANCE:
        raise SystemExit(f"rollout: ours and MuJoCo's end {found:.1e} apart: nothing is timed")
    return found


class _Ours:
    def __init__(self, case: Case, states: States) -> None:
        ours = Ours(case)
        self.robot, self.index = ours.robot, ours.q_index
        self.q, self.dq = (np.ascontiguousarray(x[:, self.index]) for x in (states.q, states.dq))

    def law(self, dtype: type) -> BatchPD:
        """The panda's joints are a chain: they have one order everywhere."""
        zero = np.zeros(self.robot.nq, dtype)
        return BatchPD(zero, np.full(self.robot.nv, KP, dtype), KD.astype(dtype), gravity=False)

    def final(self, steps: int) -> np.ndarray:
        found = self.robot.rollout(self.q, self.dq, self.law(float), dt=DT, steps=steps, every=steps)
        if found.unstable.any():
            raise SystemExit(f"rollout: {found}")
        return np.concatenate([found.q[:, -1], found.dq[:, -1]], axis=1)

    def sweep(
        self, size: int | None, steps: int, dtype: type = float, *, again: bool = False, **options: Any
    ) -> Callable[[int], None]:
        """``size`` None: one state, without a batch. ``again``: into the same arrays each time, as MuJoCo does."""
        rows = 0 if size is None else slice(size)
        q, dq, law = self.q[rows].astype(dtype), self.dq[rows].astype(dtype), self.law(dtype)
        if again:
            first = self.robot.rollout(q, dq, law, dt=DT, steps=steps, **options)
            options["out"] = first.q, first.dq

        def sweep(times: int) -> None:
            for _ in range(times):
                self.robot.rollout(q, dq, law, dt=DT, steps=steps, **options)

        return sweep

    def gradients(self, size: int, steps: int) -> Callable[[int], None]:
        """The rollout, and the gradient of a cost of all its states by states at the start, references and gains."""
        q, dq, law = self.q[:size], self.dq[:size], self.law(float)
        slope = np.ones((size, steps + 1, self.robot.nv))

        def sweep(times: int) -> None:
            for _ in range(times):
                self.robot.rollout(q, dq, law, dt=DT, steps=steps, gradients=True).gradient(slope, slope)

        return sweep


class _MuJoCo:
    def __init__(self, case: Case, states: States) -> None:
        self.model = _actuated(case)
        self.data = mujoco.MjData(self.model)
        self.states = np.concatenate([np.zeros((len(states), 1)), states.q, states.dq], axis=1)

    def final(self, steps: int) -> np.ndarray:
        return self._roll(self.states, steps, None)[:, -1, 1:]

    def sweep(self, size: int, steps: int) -> Callable[[int], None]:
        initial = self.states[:size]
        room = np.empty((size, steps, self.states.shape[1]))

        def sweep(times: int) -> None:
            for _ in range(times):
                self._roll(initial, steps, room)

        return sweep

    def _roll(self, initial: np.ndarray, steps: int, room: np.ndarray | None) -> np.ndarray:
        control = np.zeros((1, 1, self.model.nu))
        found, _ = mujoco.rollout.rollout(self.model, [self.data], initial, control, nstep=steps, state=room)
        return found


def _actuated(case: Case) -> mujoco.MjModel:
    """The model that is compared elsewhere, with position actuators, and what drives them switched on again."""
    spec = peer_mujoco.spec_of(case)
    for name, kd in zip(case.moving, KD, strict=True):
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=KP, kv=kd)
    spec.option.timestep = DT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()
    peer_mujoco.switch_off(model, {"ACTUATION"})
    model.jnt_actfrclimited[:] = 0  # the file's limits of torque: ours knows none here
    return model
