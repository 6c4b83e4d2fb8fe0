"""Servos identified without torques, in worlds that MuJoCo simulates: accuracy, coverage, delay and cost.

Forty worlds: four robots, ten seeds. Even seeds are the tuned half, odd ones the untouched half, on which nothing is set.
Armature stands in the XML, so that MuJoCo's friction acts on the whole inertia; its friction turns within 2 ms. MuJoCo's
damping is half a step late, which is an armature of d h/2; the XML has as much less. In worlds with another law of friction,
the true damping and Coulomb friction are those of least squares over the speeds of the log. Servos of the desk arm and of the
heavy arm have the values of published models (Rhoban/bam, Apache-2.0).

python -m bench.servo_worlds tuned [SEED …] | untouched | table
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import twistwrench as tw
from twistwrench.core.typing import Array
from twistwrench.mechanics.model.actuation import with_friction

from .one_fault_robots import Mechanism, Part, urdf

KEPT, PAGE = (Path(__file__).with_name(name) for name in ("servo_worlds.json", "SERVOS.md"))
SECONDS, BEFORE, STEP = 20.0, 1.0, 2.5e-4
"""Duration of a log, of the motion before it, and step of the simulation [s]."""
HERTZ = np.array([0.1, 0.23, 0.47, 0.9, 1.3, 2.1, 3.1, 4.2])
RATES, BITS = (30, 50, 100, 200, 500, 1000), (12, 14, 16, 19)

DESK = Mechanism(
    "desk_arm",
    parts=(
        Part("shoulder_pan", "0 0 1", "0 0 0.055", "0 0 0.03", 0.100, None, kind="continuous"),
        Part("shoulder_lift", "0 1 0", "0.03 0 0.054", "0 0 0.07", 0.103, None, kind="continuous", radius=0.04),
        Part("elbow_flex", "0 1 0", "0.028 0 0.113", "0.07 0 0", 0.104, None, kind="continuous", radius=0.04),
        Part("wrist_flex", "0 1 0", "0.135 0 0.005", "0.03 0 0", 0.079, None, kind="continuous", radius=0.025),
        Part("wrist_roll", "1 0 0", "0.061 0 0", "0.05 0.01 0", 0.099, None, kind="continuous", radius=0.03),
    ),
)
"""Arm with the lengths and masses of an SO-101."""
LEG = Mechanism(
    "dog_leg",
    parts=(
        Part("hip", "1 0 0", "0 0 0", "-0.005 0.01 0", 0.68, None, kind="continuous", radius=0.04),
        Part("thigh", "0 1 0", "0 0.08 0", "-0.004 -0.019 -0.035", 1.009, None, kind="continuous", radius=0.06),
        Part("calf", "0 1 0", "0 0 -0.213", "0.003 0 -0.13", 0.256, None, kind="continuous", radius=0.09),
    ),
)
"""Leg with the lengths and masses of a Go1, its base held."""

MX_64, MX_106, XL_320 = (
    (0.01227, 0.0253, 0.1227, 2.58),
    (0.02602, 0.0507, 0.1220, 1.75),
    (0.00148, 0.0078, 0.0215, 1.97),
)
EROB = (1.135, 9.71, 5.23, 2.03)
"""Published servos: armature, viscous friction, Stribeck friction and its speed."""


@dataclass(frozen=True)
class Kind:
    """A robot with its servos: bounds of stiffness times the joint's inertia over which frequencies [Hz] are drawn."""

    robot: str
    servos: Sequence[tuple[float, float, float, float]]
    frequency: tuple[float, float]
    size: float


KINDS = {
    "desk_arm": Kind("desk_arm", (MX_64, MX_106, MX_64, XL_320, XL_320), (3.0, 8.0), 0.5),
    "panda": Kind("panda", tuple((a, 1.0, 0.4, 0.3) for a in (0.6, 0.6, 0.5, 0.5, 0.3, 0.2, 0.15)), (3.0, 9.0), 0.35),
    "dog_leg": Kind("dog_leg", ((0.011, 0.05, 0.15, 0.5), (0.011, 0.05, 0.15, 0.5), (0.017, 0.1, 0.2, 0.5)), (4.0, 10.0), 0.4),
    "ur5": Kind("ur5", (EROB, EROB, EROB, *[(0.3, 1.5, 0.8, 1.0)] * 3), (2.0, 6.0), 0.35),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class World:
    """Robot, values of its servos, law of friction, and how it is logged."""

    robot: str
    seed: int
    rate: int
    bits: int
    delay: float
    law: str
    values: Array
    """(nv, 4) armature, damping, Coulomb friction and kp."""
    peak: Array
    """(nv, 2) Stribeck friction and its speed, or share of the carried torque and 0."""

    @property
    def delay_of_steps(self) -> float:
        """Mean delay of the simulated commands [s]: a row comes with the next step; semi-implicit steps take off a half."""
        rows = np.arange(self.rate) / self.rate
        steps = np.ceil((rows + self.delay) / STEP - 1e-6)
        return float(np.mean(STEP * (steps - 0.5) - rows))

    @property
    def name(self) -> str:
        """Robot and seed."""
        return f"{self.robot} {self.seed}"


@cache
def robot_named(name: str) -> tw.Robot:
    """Robot of a kind, without armature and friction."""
    written = {one.name: one for one in (DESK, LEG)}
    robot = tw.load(urdf(name, written[name].parts)) if name in written else getattr(tw.robots, name)()
    return robot.with_armature(dict.fromkeys(robot.model.velocity_names, 0.0))


def world(robot: str, seed: int) -> World:
    """World of a robot and a seed."""
    place = list(KINDS).index(robot)
    rng, kind, arm = np.random.default_rng([place, seed]), KINDS[robot], robot_named(robot)
    law = ("", "stribeck", "", "load", ("stribeck", "load", "", "")[place])[seed // 2]
    servos = np.array(kind.servos) * np.exp(rng.uniform(-0.3, 0.3, (arm.nv, 4)))
    M = np.asarray(arm.mass_matrix(np.zeros(arm.nq)))
    inertia = servos[:, 0] + np.diagonal(M)
    kp = inertia * (2.0 * np.pi * rng.uniform(*kind.frequency, arm.nv)) ** 2
    damping = servos[:, 1] + 2.0 * rng.uniform(0.3, 0.9, arm.nv) * np.sqrt(kp * inertia)
    coulomb = servos[:, 2] * rng.uniform(0.6, 1.6, arm.nv)
    peak = np.stack([servos[:, 2] * (law == "stribeck"), servos[:, 3]], axis=1)
    if law == "load":
        peak = np.stack([np.full(arm.nv, rng.uniform(0.03, 0.1)), np.zeros(arm.nv)], axis=1)
    values = np.stack([servos[:, 0], damping, coulomb, kp], axis=1)
    rate, bits = int(rng.choice(RATES)), int(rng.choice(BITS))
    return World(robot, seed, rate, bits, float(rng.uniform(0.0, 0.04)), law, values, peak)


def commanded(world: World, duration: float, seed: int) -> tuple[Array, Array]:
    """Times and commands of rows: sums of sines about a pose."""
    rng, nv = np.random.default_rng([7, seed]), len(world.values)
    rows = np.arange(-round(BEFORE * world.rate), round(duration * world.rate)) / world.rate
    a = KINDS[world.robot].size * rng.uniform(-1.0, 1.0, (len(HERTZ), nv)) / (1.0 + HERTZ[:, None])
    phase = rng.uniform(0.0, 2.0 * np.pi, a.shape)
    middle = rng.uniform(-0.8, 0.8, nv)
    return rows, middle + (a * np.sin(2.0 * np.pi * HERTZ[:, None] * rows[:, None, None] + phase)).sum(axis=1)


def simulated(world: World, *, duration: float = SECONDS, seed: int | None = None) -> tw.Motion:
    """Log of a world: MuJoCo's positions in steps of the encoder, and commands that hold between rows."""
    return of_rows(world, *commanded(world, duration, world.seed if seed is None else seed))[0]


def of_rows(world: World, rows: Array, command: Array) -> tuple[tw.Motion, Array]:
    """Log of commands, and the true values (nv, 4) of a servo with Coulomb friction."""
    import mujoco

    model = physics(world)
    data = mujoco.MjData(model)
    data.qpos[:] = command[0]
    _, _, coulomb, kp = world.values.T
    steps = round((rows[-1] - rows[0]) / STEP) + 1
    latest = np.searchsorted(rows, rows[0] + STEP * np.arange(steps) - world.delay + 1e-9, side="right") - 1
    reference, (q, dq, friction) = command[np.maximum(latest, 0)], np.empty((3, steps, len(kp)))
    for k in range(steps):
        q[k] = data.qpos
        data.qfrc_applied[:] = kp * (reference[k] - q[k])
        if world.law == "stribeck":
            model.dof_frictionloss[:] = coulomb + world.peak[:, 0] * np.exp(-((data.qvel / world.peak[:, 1]) ** 2))
        elif world.law == "load":
            carried = data.qfrc_applied + data.qfrc_passive + data.qfrc_constraint
            model.dof_frictionloss[:] = coulomb + world.peak[:, 0] * np.abs(carried)
        dq[k], friction[k] = data.qvel, model.dof_frictionloss
        mujoco.mj_step(model, data)
    mine, truth = rows >= 0.0, world.values.copy()
    for j in range(len(kp) if world.law else 0):
        X = np.stack([dq[:, j], np.sign(dq[:, j])], axis=1)
        more, truth[j, 2] = np.linalg.lstsq(X, friction[:, j] * X[:, 1], rcond=None)[0]
        truth[j, 1] += more
    quantum = 2.0 * np.pi / 2.0**world.bits
    at = np.round((rows[mine] - rows[0]) / STEP).astype(int)
    log = tw.Motion(
        rows[mine],
        np.round(q[at] / quantum) * quantum,
        robot=robot_named(world.robot),
        in_seconds=True,
        command=command[mine],
    )
    return log, truth


def physics(world: World) -> Any:
    """MuJoCo's model with armature, damping and friction in its XML."""
    import mujoco

    arm, model = robot_named(world.robot), robot_named(world.robot).model
    armature, damping, coulomb, _ = world.values.T
    armature = armature - 0.5 * STEP * damping
    arm = arm.with_armature(dict(zip(model.velocity_names, armature.tolist(), strict=True)))
    laws = {
        name: {"viscous": float(d), "coulomb": float(c)}
        for name, d, c in zip(model.velocity_names, damping, coulomb, strict=True)
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.xml"
        tw.save(tw.Robot(with_friction(arm.model, laws)), path)
        spec = mujoco.MjSpec.from_file(str(path))
    spec.option.timestep = STEP
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    for joint in spec.joints:
        joint.solref_friction[0] = 2e-3
    return spec.compile()


# ── Judgement


def judged(world: World) -> dict[str, Any]:
    """What identify_servos finds in a world, beside the truth."""
    log, truth = of_rows(world, *commanded(world, SECONDS, world.seed))
    begin = time.process_time()
    found = tw.identification.identify_servos(robot_named(world.robot), log)
    seconds = time.process_time() - begin
    width = found.relative()
    quantities = ("armature", "damping", "coulomb", "kp")
    off = {name: np.log(found.values[:, k] / truth[:, k]) for k, name in enumerate(quantities)}
    off |= {f"{name}/kp": off[name] - off["kp"] for name in quantities[:3]}
    return {
        **{key: value for key, value in asdict(world).items() if key not in ("values", "peak")},
        "verdict": str(found.verdict.word),
        "doubts": [doubt.kind for doubt in found.doubts],
        "off": {name: x.round(5).tolist() for name, x in off.items()},
        "width": {name: x.round(5).tolist() for name, x in width.items()},
        "determined": {name: x.tolist() for name, x in found.determined.items()},
        "torque_off": {name: x.round(5).tolist() for name, x in torque_errors(found, truth).items()},
        "only_ratios": found.only_ratios.tolist(),
        "delay_off": round(found.delay - world.delay_of_steps, 6),
        "delay_width": round(found.delay_half_width, 6),
        "held_out": round(found.held_out.all, 5),
        "cost": round(found.fit.cost / sum(e.size for e in found.fit.residuals), 3),
        "rollouts": found.fit.replay.count[0],
        "seconds": round(seconds, 1),
    }


def torque_errors(found: tw.identification.IdentifiedServos, truth: Array) -> dict[str, Array]:
    """Errors of damping and Coulomb friction as shares of each joint's rms torque."""
    errors = (found.values - truth)[:, :3] * found.sizes / found.rms_torques[:, None]
    return {"damping": errors[:, 1], "coulomb": errors[:, 2]}


def half(name: str) -> Iterator[World]:
    """Worlds of the tuned or the untouched half."""
    for seed in range(name == "untouched", 10, 2):
        yield from (world(robot, seed) for robot in KINDS)


def kept() -> dict[str, Any]:
    """Results by world."""
    found: dict[str, Any] = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {}
    return found


def run(worlds: Sequence[World]) -> None:
    """Judge worlds, and keep each result as soon as it is there."""
    for one in worlds:
        result = judged(one)
        found = kept() | {one.name: result}
        KEPT.write_text(
            "{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in found.items()) + "\n}\n", "utf-8"
        )
        worst = {name: round(float(np.abs(x).max()), 3) for name, x in result["off"].items()}
        print(one.name, one.rate, one.bits, one.law or "-", result["verdict"], result["doubts"], worst, result["delay_off"],
              result["cost"], result["rollouts"], result["seconds"], flush=True)  # fmt: skip


# ── The page

SHARP = {"kp": 0.03, "armature": 0.03, "damping": 0.03, "coulomb": 0.05}
"""Wanted accuracy of determined values."""
_HEAD = """# Servos without torques

`identify_servos` in worlds that MuJoCo simulates, whose servos are known: {done} of 40. Made by `python -m bench.servo_worlds
tuned` (or `untouched`), which writes `servo_worlds.json`, and `python -m bench.servo_worlds table`, which writes this page.
Even seeds are the tuned half; nothing was set on the untouched half. Errors are those of determined values.

"""


def summary(results: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Accuracy of determined values where the verdict is OK, coverage of all intervals, delay and cost."""
    found = {"worlds": str(len(results)), "OK": str(sum(one["verdict"] == "OK" for one in results))}
    sharp = [one for one in results if one["verdict"] == "OK"]
    for name, most in SHARP.items():
        off = np.abs(
            np.concatenate([np.array(one["off"][name])[one["determined"][name]] for one in sharp] or [np.zeros(0)])
        )
        found[f"{name} within {most:.0%}"] = f"{(off <= most).sum()} of {len(off)}, at most {off.max(initial=0.0):.1%}"
    errors = np.concatenate([np.abs(one["torque_off"]["coulomb"])[one["determined"]["coulomb"]] for one in sharp])
    found["coulomb within 2% of the joint's torque"] = (
        f"{(errors <= 0.02).sum()} of {len(errors)}, at most {errors.max(initial=0.0):.1%}"
    )
    for kind, names in (("values", tuple(SHARP)), ("ratios", ("armature/kp", "damping/kp", "coulomb/kp"))):
        held = np.concatenate([np.abs(one["off"][n]) <= np.array(one["width"][n]) for one in results for n in names])
        found[f"coverage of {kind}"] = f"{held.mean():.1%} of {held.size}"
    late = np.array([[one["delay_off"], one["delay_width"], 0.5 / one["rate"]] for one in results])
    good = np.abs(late[:, 0]) <= np.maximum(1e-3, late[:, 2])
    found["delay within 1 ms or half a row"] = (
        f"{good.sum()} of {len(late)}, at most {1e3 * np.abs(late[:, 0]).max():.2f} ms"
    )
    found["coverage of delays"] = f"{(np.abs(late[:, 0]) <= late[:, 1]).sum()} of {len(late)}"
    found["rollouts"] = f"at most {max(one['rollouts'] for one in results)}"
    found["processor time"] = f"at most {max(one['seconds'] for one in results):.0f} s"
    return found


def page(results: dict[str, dict[str, Any]]) -> str:
    """Both halves side by side, and a row for each world."""
    halves = [[one for one in results.values() if one["seed"] % 2 == k] for k in (0, 1)]
    parts = [summary(half) for half in halves if half]
    lines = ["| figure | tuned | untouched |", "| --- | --- | --- |"]
    lines += [f"| {name} | {' | '.join(part[name] for part in parts)} |" for name in parts[0]]
    lines += ["", "| world | rate, encoder | law | verdict | kp, armature, damping, Coulomb off | delay off |"]
    lines += ["| --- | --- | --- | --- | --- | --- |"]
    for name, one in sorted(results.items()):
        worst = [np.abs(np.array(one["off"][n])[one["determined"][n]]).max(initial=0.0) for n in SHARP]
        lines.append(
            f"| {name} | {one['rate']} Hz, {one['bits']} bit | {one['law'] or '–'} | {one['verdict']} | "
            f"{', '.join(f'{x:.1%}' for x in worst)} | {1e3 * one['delay_off']:.2f} ms |"
        )
    return _HEAD.format(done=len(results)) + "\n".join(lines) + "\n"


if __name__ == "__main__":
    if sys.argv[1] == "table":
        PAGE.write_text(page(kept()), "utf-8")
    else:
        seeds = [int(text) for text in sys.argv[2:]]
        run([one for one in half(sys.argv[1]) if not seeds or one.seed in seeds])
