"""What holds a robot, against programs that simulate contacts or know none: evidence for docs/holds.md.

    python -m bench.holds [SECTION ...]

Sections: inverse, scenes, masts, payload, mast payload, mounting, bearings, systems, times. Each writes its part of
``holds.json``. Scenes of the half "tuned" (even seeds) served to choose displacement and amplitudes of the generator; "kept"
(odd seeds) was run afterwards.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Iterator
from itertools import count, islice
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

import twistwrench as tw
from bench import holds_scenes
from bench.holds_displacement import expected
from twistwrench import statics
from twistwrench.core.typing import Array
from twistwrench.robots.finding import known_robots

KEPT = Path(__file__).with_name("holds.json")
FLOATING = (
    "a1", "anymal_b", "anymal_c", "anymal_kinova", "b1", "bolt", "borinot", "centauro", "g1", "go1", "go2", "hector", "hyq",
    "hextilt_flying_arm_5", "laikago", "quadruped", "simple_humanoid", "solo", "solo12", "talos_reduced",
)  # fmt: skip
ARMS = (
    "a1", "allegro_left_hand", "kinova", "panda", "so100", "talos_left_arm", "ur3_robot", "ur5_robot",
    "ur10_robot", "xarm7", "z1",
)  # fmt: skip
_RIGID = sum(
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
    for name in ("CONTACT", "CONSTRAINT", "DAMPER", "SPRING", "FRICTIONLOSS")
)
"""Flags of MuJoCo that leave rigid bodies alone."""
HALVES = {"tuned": 0, "kept": 1}
"""Parity of the seeds of each half."""


# ── Generalised forces, mounting, bearings


def loaded(name: str, **options: Any) -> tw.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(known_robots()[name].path, inertia="accept", mimic="independent", **options)


def _in_mujoco(robot: tw.Robot) -> Any:
    """The robot's masses and joints alone, as MuJoCo reads them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return mujoco.MjModel.from_xml_string(robot.to_mjcf())


def _states(robot: tw.Robot, rows: int = 3) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(1)
    return robot.random_configuration(rng, (rows,)), *rng.standard_normal((2, rows, robot.nv))


def inverse() -> dict[str, float]:
    """Largest difference of generalised forces from ``mj_inverse`` for each floating robot, relative to the largest force."""
    return {name: inverse_difference(loaded(name, floating_base=True)) for name in FLOATING}


def inverse_difference(robot: tw.Robot) -> float:
    """Largest difference of generalised forces from ``mj_inverse``, relative to the largest force."""
    model, worst = _in_mujoco(robot), 0.0
    model.opt.disableflags |= _RIGID
    data = mujoco.MjData(model)
    for q, dq, ddq in zip(*_states(robot), strict=True):
        P, growth = _rates(robot, q), _growth(robot, q, dq)
        data.qpos[:] = np.concatenate([b.joint.to_mujoco(q[b.places[0]]) for b in robot.model.leaders])
        data.qvel[:], data.qacc[:] = P @ dq, P @ ddq + growth
        mujoco.mj_inverse(model, data)
        tau = np.asarray(robot.inverse_dynamics(q, dq, ddq))
        worst = max(worst, float(np.abs(P.T @ data.qfrc_inverse - tau).max() / np.abs(tau).max()))
    return worst


def _rates(robot: tw.Robot, q: Array) -> Array:
    """P with MuJoCo's velocities P dq."""
    P = np.zeros((robot.nv, robot.nv))
    for b in robot.model.leaders:
        P[b.places[1], b.places[1]] = b.joint.mujoco_rates(q[b.places[0]])
    return P


def _growth(robot: tw.Robot, q: Array, dq: Array) -> Array:
    """Ṗ dq, by the motion of q along dq, of fourth order."""
    h = 1e-3
    weights = ((1, 8), (2, -1))
    return (
        sum(
            w * (_rates(robot, robot.add(q, k * h * dq)) - _rates(robot, robot.add(q, -k * h * dq))) for k, w in weights
        )
        @ dq
        / (12 * h)
    )


def mounting() -> dict[str, float]:
    """Largest difference of the wrench on the mounting from Pinocchio's rows of a free root, relative to the largest entry."""
    return {name: mounting_difference(name) for name in ARMS if name != "a1"}


def mounting_difference(name: str) -> float:
    robot = loaded(name, floating_base=False)
    model = pin.buildModelFromUrdf(str(known_robots()[name].path), pin.JointModelFreeFlyer())
    data, worst = model.createData(), 0.0
    q, dq, ddq = _states(robot, 5)
    load = statics.mounting_load(robot, q, dq, ddq)
    at = {n: k for k, n in enumerate(robot.joint_names)}
    for k in range(len(q)):
        theirs = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for j in range(2, model.njoints):
            joint, mine = model.joints[j], at[model.names[j]]
            turn = [np.cos(q[k, mine]), np.sin(q[k, mine])] if joint.nq == 2 else [q[k, mine]]
            theirs[0][joint.idx_q : joint.idx_q + joint.nq] = turn
            theirs[1][joint.idx_v], theirs[2][joint.idx_v] = dq[k, mine], ddq[k, mine]
        tau = pin.rnea(model, data, *theirs)[:6]
        gap = load.wrench[k] + np.r_[tau[3:], tau[:3]]
        worst = max(worst, float(np.abs(gap).max() / np.abs(tau).max()))
    return worst


def bearings() -> dict[str, float]:
    """Largest difference of bearing loads from MuJoCo's ``cfrc_int``, relative to the largest load."""
    return {name: bearing_difference(loaded(name, floating_base=False)) for name in ARMS}


def bearing_difference(robot: tw.Robot) -> float:
    model, worst = _in_mujoco(robot), 0.0
    model.opt.disableflags |= _RIGID
    data = mujoco.MjData(model)
    q, dq, ddq = _states(robot)
    ours = statics.bearing_loads(robot, q, dq, ddq)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        rows = []
        for name in ours.joints:
            j = model.joint(name).id
            body = model.jnt_bodyid[j]
            torque, force = data.cfrc_int[body][:3], data.cfrc_int[body][3:]
            moment = torque - np.cross(data.xanchor[j] - data.subtree_com[model.body_rootid[body]], force)
            a, turns = data.xaxis[j], model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
            across = np.linalg.norm(force - a * (a @ force))
            rows.append(
                (abs(a @ force) if turns else np.nan, across, np.linalg.norm(moment - a * (a @ moment) * turns))
            )
        theirs = np.array(rows).T
        mine = np.stack([ours.axial[k], ours.radial[k], ours.tilting[k]])
        worst = max(worst, float(np.nanmax(np.abs(mine - theirs)) / np.nanmax(theirs)))
    return worst


# ── Scenes


def cases(kind: Callable[[int], Any], judge: Callable[[Any], Any], half: str, most: int) -> list[Any]:
    """First cases of a kind of scene in a half that have an answer."""
    seeds = count(HALVES[half], 2)
    found: Iterator[Any] = (case | {"seed": seed} for seed in seeds if (case := judge(kind(seed))) is not None)
    return list(islice(found, most))


def speed_case(scene: Any) -> dict[str, Any] | None:
    """Speed of the first motion of a contact: predicted, simulated, and expected from the load beyond the margin."""
    found = holds_scenes.speed_case(scene)
    return None if found is None else found | expected(scene, found["speed"], scene.payload, grows="speed")


def payload_case(scene: Any) -> dict[str, Any] | None:
    """Load of the first motion of a contact: predicted, simulated, and expected from the load beyond the margin."""
    found = holds_scenes.payload_case(scene)
    return None if found is None else found | expected(scene, found["speed"], found["load"], grows="load")


def scenes() -> dict[str, Any]:
    """Speed of the first motion of a contact by MuJoCo, relative to the predicted one, of 15 carts and 15 frames a half."""
    return {half: _summary([
        *cases(holds_scenes.cart, speed_case, half, 15),
        *cases(holds_scenes.frame, speed_case, half, 15),
    ]) for half in HALVES}  # fmt: skip


def masts() -> dict[str, Any]:
    """The same of 15 masts a half, whose load is beyond the margin for 0.4 of the motion."""
    return {half: _summary(cases(holds_scenes.mast, speed_case, half, 15)) for half in HALVES}


def payload() -> dict[str, Any]:
    """Load of the first motion of a contact, relative to the predicted one, of 10 carts a half."""
    return {half: _summary(cases(holds_scenes.cart, payload_case, half, 10)) for half in HALVES}


def mast_payload() -> dict[str, Any]:
    """The same of 10 masts a half."""
    return {half: _summary(cases(holds_scenes.mast, payload_case, half, 10)) for half in HALVES}


def _summary(found: list[Any]) -> dict[str, Any]:
    """Least, median and largest ratios, to the margin and to what is expected beyond it."""
    columns = {
        name: np.array([x[name] for x in found]) for name in ("first", "seen", "first expected", "seen expected")
    }
    columns |= {f"{name} / expected": columns[name] / columns[f"{name} expected"] for name in ("first", "seen")}
    spread = {name: [x.min(), float(np.median(x)), x.max()] for name, x in columns.items()}
    told = [x["predicted"] == x["goes"] for x in found if "predicted" in x]
    return {**spread, **({"as predicted": sum(told)} if told else {}), "scenes": found}


# ── Random systems


def systems(number: int = 5000) -> dict[str, int]:
    """Random systems with μ = 0, equal normals, one contact and zero load: answers, and those without their proof."""
    answers = {
        "hold": 0,
        "fail": 0,
        "undecided": 0,
        "not least norm": 0,
        "outside a cone": 0,
        "left over": 0,
        "no motion": 0,
    }
    for seed in range(number):
        rng = np.random.default_rng([3, seed])
        contacts = random_contacts(rng)
        wrench = rng.standard_normal(6) * (rng.random() < 0.95)
        if rng.random() < 0.5:
            forces = [rng.uniform(0, 5) * c.normal for c in contacts]
            wrench = -sum(np.r_[np.cross(c.point, f), f] for c, f in zip(contacts, forces, strict=True))
        _count(answers, contacts, wrench, statics.hold(wrench, contacts))
    return answers


def random_contacts(rng: np.random.Generator) -> list[statics.Contact]:
    """One to eight contacts, some of them equal, without friction, or on one plane."""
    number, equal, flat = int(rng.integers(1, 9)), rng.random() < 0.5, rng.random() < 0.5
    normals = np.tile([0.0, 0, 1], (number, 1)) if equal else rng.standard_normal((number, 3))
    points = rng.uniform(-1, 1, (number, 3)) * [1, 1, 0 if flat else 1]
    friction = rng.uniform(0, 1, number) * (rng.random(number) < 0.7)
    return [statics.Contact(p, n, mu) for p, n, mu in zip(points, normals, friction, strict=True)]


def _count(answers: dict[str, int], contacts: list[statics.Contact], wrench: Array, found: statics.Support) -> None:
    if not found.decided[0]:
        answers["undecided"] += 1
    elif found.holds[0]:
        f = found.forces[0]
        total = wrench + sum(np.r_[np.cross(c.point, x), x] for c, x in zip(contacts, f, strict=True))
        answers["hold"] += 1
        answers["not least norm"] += not found.least_norm[0]
        answers["outside a cone"] += not all(c.allows(x) for c, x in zip(contacts, f, strict=True))
        answers["left over"] += bool(np.abs(total).max() > 1e-6 * max(np.abs(wrench).max(), 1e-9))
    else:
        v = [found.motion[0, 3:] + np.cross(found.motion[0, :3], c.point) for c in contacts]
        rise = np.array([c.normal @ x for c, x in zip(contacts, v, strict=True)])
        slide = np.array([np.linalg.norm(x - (c.normal @ x) * c.normal) for c, x in zip(contacts, v, strict=True)])
        resisted = rise - np.array([c.friction for c in contacts]) * slide < -1e-7
        answers["fail"] += 1
        answers["no motion"] += bool(resisted.any() or not wrench @ found.motion[0] > 0)


# ── Times


def humanoid(rows: int, corners: int = 8, friction: float = 0.7) -> tuple[Any, ...]:
    """Talos swaying on two soles: robot, states and corners of its feet."""
    robot = loaded("talos_reduced", floating_base=True)
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, rows)[:, None]
    size = 0.15 * rng.standard_normal(robot.nv)
    size[:6] = 0.0
    q = np.array([robot.add(robot.neutral, x) for x in np.sin(2 * np.pi * t) * size])
    dq, ddq = 2 * np.pi * np.cos(2 * np.pi * t) * size, -((2 * np.pi) ** 2) * np.sin(2 * np.pi * t) * size
    around = np.linspace(0, 2 * np.pi, corners // 2, endpoint=False) + np.pi / 4
    sole = np.c_[0.14 * np.cos(around), 0.085 * np.sin(around), np.zeros(corners // 2)]
    feet = [
        statics.Contact(p, friction=friction, frame=f"{side}_sole_link") for side in ("left", "right") for p in sole
    ]
    return robot, q, 0.2 * dq, 0.04 * ddq, feet


def times() -> dict[str, Any]:
    """Processor time of the margin in speed of 1,000 rows of talos with 8 corners, beside a linear programme a row."""
    maps, b, rate, cones = programme(1000)
    one = _seconds(lambda: statics.cone_programme.cone_programme(cones, maps, b, rate), 3)
    some = slice(0, 1000, 10)
    pyramid = {
        edges: 10 * _seconds(lambda edges=edges: row_by_row(maps[some], b[some], rate[some], cones, edges))
        for edges in (8, 16, 64)
    }
    ours = statics.cone_programme.cone_programme(cones, maps[some], b[some], rate[some]).s
    known = np.isfinite(ours) & (ours > 0.01)
    wrong = {e: (ours - row_by_row(maps[some], b[some], rate[some], cones, e))[known] / ours[known] for e in pyramid}
    rows = {n: _seconds(lambda n=n: _margin(n, 8), 2) for n in (100, 300, 1000, 3000, 10000)}
    contacts = {c: _seconds(lambda c=c: _margin(1000, c), 2) for c in (4, 8, 16, 32)}
    robot, q, dq, ddq, feet = humanoid(1000)
    return {
        "cones, 1,000 rows [s]": one,
        "linprog row by row, by edges [s]": pyramid,
        "ratio to 8 edges": pyramid[8] / one,
        "largest error of the pyramids' margins": {e: float(x.max()) for e, x in wrong.items()},
        "by rows, 8 contacts [s]": rows,
        "by contacts, 1,000 rows [s]": contacts,
        "statics.support with all margins, 1,000 rows [s]": _seconds(lambda: statics.support(robot, q, dq, ddq, feet)),
    }  # fmt: skip


_SYSTEMS: dict[tuple[int, int], tuple[Any, ...]] = {}


def programme(rows: int, corners: int = 8) -> tuple[Any, ...]:
    """Maps, loads, their growth with the square of the speed, and cones of the swaying humanoid."""
    if (rows, corners) not in _SYSTEMS:
        robot, q, dq, ddq, feet = humanoid(rows, corners)
        maps, _ = statics.contacts.contact_maps(robot, q, feet)
        b, rest = robot.inverse_dynamics(q, dq, ddq)[:, :6], robot.gravity_forces(q)[:, :6]
        _SYSTEMS[rows, corners] = maps[:, :6], b, b - rest, statics.contacts.cones_of(feet)[0]
    return _SYSTEMS[rows, corners]


def _margin(rows: int, corners: int) -> object:
    maps, b, rate, cones = programme(rows, corners)
    return statics.cone_programme.cone_programme(cones, maps, b, rate)


def row_by_row(maps: Array, b: Array, rate: Array, cones: Any, edges: int) -> Array:
    """Margins by a linear programme a row with pyramids inside the cones; -1 if impossible, inf if unbounded."""
    angle = 2 * np.pi * np.arange(edges) / edges
    found = np.zeros(len(b))
    for k in range(len(b)):
        columns = []
        for i, (n, mu) in enumerate(zip(cones.normals, cones.friction, strict=True)):
            first, second = statics.contacts.tangents(n)
            columns.append(
                maps[k, :, i] @ (n[:, None] + mu * (np.outer(first, np.cos(angle)) + np.outer(second, np.sin(angle))))
            )
        E = np.column_stack([*columns, -rate[k]])
        answer = linprog(np.r_[np.zeros(E.shape[1] - 1), -1.0], A_eq=E, b_eq=b[k], method="highs")
        found[k] = answer.x[-1] if answer.status == 0 else np.inf if answer.status == 3 else -1.0
    return found


def _seconds(call: Callable[[], object], turns: int = 1) -> float:
    """Least processor time of some calls; the first call outside the clock builds what is cached."""
    call() if turns > 1 else None
    found = []
    for _ in range(turns):
        start = time.process_time()
        call()
        found.append(time.process_time() - start)
    return min(found)


SECTIONS: dict[str, Callable[[], Any]] = {
    "inverse": inverse, "scenes": scenes, "masts": masts, "payload": payload, "mast payload": mast_payload,
    "mounting": mounting, "bearings": bearings, "systems": systems, "times": times,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", help=f"any of {', '.join(SECTIONS)}; none: all")
    for section in parser.parse_args().sections or SECTIONS:
        found = SECTIONS[section]()
        kept = json.loads(KEPT.read_text("utf-8")) if KEPT.is_file() else {}
        KEPT.write_text(json.dumps(kept | {section: found}, indent=1, default=float) + "\n", "utf-8")
        print(section, json.dumps(found, default=float)[:2000], flush=True)


if __name__ == "__main__":
    main()
