"""The section on closed robots: ten seconds of a four-bar linkage, each step ended on its loop, beside a loop of ``mj_step``.

The linkage swings through under its weight with nothing lost. Ours keeps the gap to 1e-12 m, which is checked before anything
is timed, and gives all states, λ, energies and an estimate of the error. MuJoCo's pin is a stiff spring, ``connect``; its loop
keeps nothing.
"""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

import twistwrench as tw
from bench import machine
from bench.timing import ROUNDS, Contender, interleave
from twistwrench.mechanics.model.builder import ModelBuilder

STEPS, DT, MOTIONS = 10_000, 1e-3, 256
METHODS = ("rk4", "semi_implicit")
LENGTHS, MASSES, GROUND = (0.3, 0.8, 0.6), (1.0, 2.0, 1.5), 0.7
GAP = 1e-12
LOOP = "mj_step, connect"
STILL = 1e-3  # kg m², so that rods turn about their own axes too


def linkage() -> Any:
    """Crank, coupler and rocker of docs/constraints.md, closed with a pin."""
    builder = ModelBuilder("four_bar")
    builder.add_link("ground_link")
    bars = ("crank", "coupler", "rocker")
    for name, length, mass in zip(bars, LENGTHS, MASSES, strict=True):
        moment = np.diag([STILL, *[mass * length**2 / 12] * 2])
        builder.add_link(name, tw.SpatialInertia.from_com(mass, (length / 2, 0, 0), moment))
        builder.add_link(f"{name}_end")
        place = tw.se3.exp([0, 0, 0, length, 0, 0])
        builder.add_joint(f"to_{name}_end", "fixed", name, f"{name}_end", placement=place)
    for name, parent, child, x in (
        ("A", "ground_link", "crank", 0.0),
        ("B", "crank_end", "coupler", 0.0),
        ("D", "ground_link", "rocker", GROUND),
    ):
        builder.add_joint(name, "continuous", parent, child, axis=(0, -1, 0), placement=tw.se3.exp([0, 0, 0, x, 0, 0]))
    return tw.Robot(builder.build()).close("rocker_end", "coupler_end", rows="vx vz")


def times(rounds: int = ROUNDS) -> dict[str, Any]:
    """Nanoseconds per step of motions of ten seconds."""
    where = machine.describe()  # this section may be newer than the others
    print(f"closed: four-bar, {STEPS} steps", flush=True)
    closed = linkage()
    q = closed.consistent([0.0, 0.8, 1.6])
    dq = closed.project_velocity(q, [6.0, 0.0, 0.0])
    gaps = {method: float(closed.simulate(q, dq, STEPS * DT, DT, method=method).gap.max()) for method in METHODS}
    if not max(gaps.values()) <= GAP:
        raise SystemExit(f"closed: the loop opens by {max(gaps.values()):.1e} m: nothing is timed")

    def simulated(method: str) -> Callable[[int], None]:
        def sweep(times: int) -> None:
            for _ in range(times):
                closed.simulate(q, dq, STEPS * DT, DT, method=method)

        return sweep

    def rolled_out(times: int) -> None:
        for _ in range(times):
            closed.rollout(np.tile(q, (MOTIONS, 1)), dq, steps=STEPS // 10, dt=DT, every=10)

    contenders = [Contender(method, simulated(method), STEPS) for method in METHODS]
    contenders.append(Contender("rollout", rolled_out, MOTIONS * (STEPS // 10)))
    if (loop := _loop(q, dq)) is not None:
        contenders.append(Contender(LOOP, loop, STEPS))
    return {
        **{name: where[name] for name in ("date", "cpu")},
        "rounds": rounds,
        "steps": STEPS,
        "motions": MOTIONS,
        "gap": max(gaps.values()),
        "times": {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()},
    }


def _loop(q: np.ndarray, dq: np.ndarray) -> Callable[[int], None] | None:
    try:
        import mujoco
    except ImportError:
        return None
    bars = [
        f'<body name="{name}" pos="{x} 0 0"><joint axis="0 -1 0"/><inertial pos="{length / 2} 0 0" mass="{mass}" '
        f'diaginertia="{STILL} {mass * length**2 / 12} {mass * length**2 / 12}"/>'
        for name, length, mass, x in zip(("crank", "coupler", "rocker"), LENGTHS, MASSES, (0, 0.3, GROUND), strict=True)
    ]
    pin = f'<site name="one" pos="{LENGTHS[1]} 0 0"/>', f'<site name="other" pos="{LENGTHS[2]} 0 0"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{DT}"/><worldbody>{bars[0]}{bars[1]}{pin[0]}</body></body>{bars[2]}{pin[1]}</body>'
        "</worldbody>"
        '<equality><connect site1="one" site2="other" solref="2e-3 1"/></equality></mujoco>'
    )
    data = mujoco.MjData(model)

    def sweep(times: int) -> None:
        step = mujoco.mj_step
        for _ in range(times):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = q, dq
            for _ in range(STEPS):
                step(model, data)

    return sweep
