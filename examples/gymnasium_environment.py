"""A Gymnasium environment on batched rollouts: a thousand Pandas reach for places, each with a load and a stiffness of its own.

Every environment of the batch is a sample of one ``robot.rollout``: an action moves the references of PD control, and the
steps of 2 ms until the next one are taken in one compiled kernel, for all environments. What is randomised, a load in the hand
(``parameters=``) and the gains, is an array that goes in beside the states, so an environment that begins anew costs nothing.

``Reach`` is a ``gymnasium.vector.VectorEnv``, ``ReachOne`` an ``Env`` of one of them. Run it: ``python
examples/gymnasium_environment.py [--environments 1024]`` prints steps a second with random actions, and those of MuJoCo's own
batch of rollouts with the same robot, law and steps, where it is installed. Needs ``pip install -e ".[gymnasium]"``.
"""

from __future__ import annotations

import warnings
from argparse import ArgumentParser
from collections.abc import Callable
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import twistwrench as tw
from twistwrench.simulation import BatchPD

ROBOT = tw.robots.panda()
HOME = np.array([0, -0.6, 0, -2.2, 0, 1.7, 0.8])
DT, STEPS, LENGTH = 2e-3, 20, 100  # s, steps for an action, actions of an episode
REACH = 0.3  # rad, how far an action moves a joint's reference from HOME
KD = np.array([20.0, 20, 20, 20, 4, 4, 2])
STIFFNESS, LOADS = (200.0, 400.0, 600.0), np.linspace(0.0, 2.0, 9)  # N m/rad and kg, drawn for each episode
BOUND = np.concatenate([np.full(7, 6.3), np.full(7, 20.0), np.full(3, 2.0)]).astype(np.float32)


def references(actions: np.ndarray) -> np.ndarray:
    """Where an action wants the joints to be."""
    return HOME + REACH * np.asarray(actions, float)


class Reach(VectorEnv):
    """Bring the hand to a place: observed are q, dq and the way that is left [m], the reward is minus its length."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  as Gymnasium has it

    def __init__(self, num_envs: int = 1024) -> None:
        self.num_envs, self.render_mode, self.spec = num_envs, None, None
        self.single_observation_space = gymnasium.spaces.Box(-BOUND, BOUND)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (ROBOT.nv,))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.q, self.dq = np.tile(HOME, (num_envs, 1)), np.zeros((num_envs, ROBOT.nv))
        self.goal, self.load, self.kp = np.zeros((num_envs, 3)), np.zeros(num_envs), np.zeros((num_envs, 1, ROBOT.nv))
        self.age, self.over = np.zeros(num_envs, int), np.zeros(num_envs, bool)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:  # noqa: ARG002
        """All environments anew."""
        super().reset(seed=seed)
        self._begin(np.ones(self.num_envs, bool))
        return self._observed(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """The time until the next action; environments that were over begin anew instead, as NEXT_STEP says."""
        anew = self.over
        reached = ROBOT.rollout(
            self.q,
            self.dq,
            BatchPD(references(actions)[:, None], self.kp, KD, gravity=False),
            dt=DT,
            steps=STEPS,
            every=STEPS,
            parameters={f"{ROBOT.tip}.mass": self.load},
        )
        self.q, self.dq = reached.q[:, -1].copy(), reached.dq[:, -1].copy()
        self.age += 1
        self._begin(anew)
        left = np.linalg.norm(self._left(), axis=1)
        terminated, truncated = reached.unstable & ~anew, self.age == LENGTH
        self.over = terminated | truncated
        return self._observed(), np.where(anew, 0.0, -left), terminated, truncated, {}

    def _begin(self, which: np.ndarray) -> None:
        """Draw the start, the goal, the load and the gains of some."""
        rng, n = self.np_random, int(which.sum())
        self.q[which] = HOME + rng.normal(0, 0.02, (n, ROBOT.nq))
        self.dq[which], self.age[which] = 0.0, 0
        self.goal[which] = ROBOT.forward_kinematics(HOME + REACH * rng.uniform(-0.7, 0.7, (n, ROBOT.nq)))[:, :3, 3]
        self.load[which] = rng.choice(LOADS, n)
        self.kp[which] = rng.choice(STIFFNESS, (n, 1, 1))

    def _left(self) -> np.ndarray:
        return self.goal - ROBOT.forward_kinematics(self.q)[:, :3, 3]

    def _observed(self) -> np.ndarray:
        seen = np.concatenate([self.q, self.dq, self._left()], axis=1, dtype=np.float32, casting="same_kind")
        return np.clip(np.nan_to_num(seen), -BOUND, BOUND)


class ReachOne(gymnasium.Env):
    """One of them, for what wants a single environment."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self) -> None:
        self.batch, self.render_mode = Reach(1), None
        self.observation_space, self.action_space = self.batch.single_observation_space, self.batch.single_action_space

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:  # noqa: ARG002
        """Begin anew."""
        super().reset(seed=seed)
        seen, info = self.batch.reset(seed=seed)
        return seen[0], info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """The time until the next action."""
        seen, reward, terminated, truncated, info = self.batch.step(np.asarray(action)[None])
        return seen[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info


def mujoco_batch(env: Reach) -> Callable[[np.ndarray], np.ndarray]:
    """The same steps by MuJoCo from the states that ``env`` has: q after an action, on one thread, as ours."""
    import mujoco
    import mujoco.rollout

    def loaded(mass: float, kp: float) -> Any:
        robot = ROBOT.with_payload(tw.SpatialInertia.from_com(mass)) if mass else ROBOT
        with warnings.catch_warnings(action="ignore", category=tw.ModelWarning):  # limits of velocity are not for MJCF
            text = robot.to_mjcf()
        spec = mujoco.MjSpec.from_string(text)
        for joint, kd in zip(ROBOT.model.velocity_names, KD, strict=True):
            actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            actuator.set_to_position(kp=kp, kv=kd)
        spec.option.timestep, spec.option.integrator = DT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model = spec.compile()
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        model.jnt_actfrclimited[:] = 0
        model.dof_damping[:] = 0  # no friction of the joints in either
        return model

    kinds = {(mass, kp): loaded(mass, kp) for mass in LOADS for kp in STIFFNESS}
    models = [kinds[mass, kp] for mass, kp in zip(env.load, env.kp[:, 0, 0], strict=True)]
    data = [mujoco.MjData(models[0])]
    start = np.concatenate([np.zeros((env.num_envs, 1)), env.q, env.dq], axis=1)

    def step(actions: np.ndarray) -> np.ndarray:
        found, _ = mujoco.rollout.rollout(models, data, start, references(actions)[:, None], nstep=STEPS)
        return found[:, -1, 1 : 1 + ROBOT.nq]

    return step


def main() -> None:
    """Print steps a second."""
    parser = ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--environments", type=int, default=1024)
    parser.add_argument("--actions", type=int, default=100, help="how many are taken")
    asked = parser.parse_args()
    env = Reach(asked.environments)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = env.action_space.sample()
    start = env.q.copy(), env.dq.copy()
    try:
        theirs = mujoco_batch(env)
    except ImportError:
        theirs = None
    env.step(actions)  # compiles
    if theirs is not None:
        print(f"MuJoCo's q after an action differs by {np.abs(theirs(actions) - env.q).max():.1e} rad at most")
        env.q, env.dq = start
    count = asked.environments * STEPS * asked.actions
    ways = {"the environment": env.step, "MuJoCo's rollout alone": theirs}
    for name, way in ways.items():
        if way is not None:
            begin = perf_counter()
            for _ in range(asked.actions):
                way(actions)
            print(f"{name}: {count / (perf_counter() - begin):.3g} steps of {DT:g} s a second")


if __name__ == "__main__":
    main()
