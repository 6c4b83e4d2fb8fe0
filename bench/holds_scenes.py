"""Random carts with an arm and four-legged frames, and their forward simulation by MuJoCo until a contact moves.

Joints follow their motion exactly: a large armature makes their acceleration independent of the load, and does not react on the
base. Contacts are stiff, their cones elliptic. The base is free, so that it lifts or slides where MuJoCo's contacts give way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import mujoco
import numpy as np
from scipy.interpolate import PPoly

import twistwrench as tw
from twistwrench import statics
from twistwrench.core.typing import Array

ROWS = 401
"""Rows of a motion."""
RADIUS = 0.02
"""Radius of wheels and feet [m]."""
FIRST, MOVED = 2e-4, 2e-3
"""Displacements of a contact that count as its first motion, and as motion that an eye sees [m]."""
ARMATURE = 1e6
STEP, SETTLING = 5e-4, 0.15
"""Step of the simulation, and time at rest before a motion [s]."""

_XML = """<mujoco><compiler angle="radian"/><option timestep="{step}" cone="elliptic" impratio="100" noslip_iterations="0"/>
<default><geom friction="{friction} 0 0" condim="3" solref="0.002 1" solimp="0.99 0.999 0.0001"/></default>
<worldbody>{floor}<body name="base" pos="0 0 {height}"><freejoint name="root"/>{base}</body></worldbody></mujoco>"""
_FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'


Profile: TypeAlias = Callable[[Array], tuple[Array, Array, Array]]
"""Position, velocity and acceleration of a motion from 0 to 1, by the share of its duration."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Robot on contacts, with a motion of duration 1 from rest to rest; joints and base as functions of its share."""

    kind: str
    xml: str
    robot: tw.Robot
    contacts: tuple[statics.Contact, ...]
    q: Array
    """(n, nq)"""
    dq: Array
    """(n, nv)"""
    ddq: Array
    """(n, nv)"""
    joints: Array
    """(nv - 6,): change of the joints over the motion."""
    payload: float
    """Mass of the load [kg]; NaN without one."""
    profile: Profile

    def support(self, speed: float = 1.0) -> statics.Support:
        """Contact forces and margins of the motion at a speed."""
        frame = None if np.isnan(self.payload) else "load"
        return statics.support(
            self.robot, self.q, speed * self.dq, speed**2 * self.ddq, self.contacts, payload_frame=frame
        )


def quintic(share: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration of a motion from 0 to 1 at rest at both ends."""
    x = np.clip(share, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)


_RAMP = 0.05
"""Share of the motion in which a held acceleration rises."""
_TIMES = np.array([0.0, _RAMP, 0.5 - _RAMP, 0.5 + _RAMP, 1.0 - _RAMP, 1.0])
_LEVELS = np.array([0.0, 1.0, 1.0, -1.0, -1.0, 0.0])
_ACCELERATION = PPoly(np.stack([np.diff(_LEVELS) / np.diff(_TIMES), _LEVELS[:-1]]), _TIMES)
_PARTS = [_ACCELERATION.antiderivative(2), _ACCELERATION.antiderivative(), _ACCELERATION]


def held(share: Array) -> tuple[Array, Array, Array]:
    """Motion from 0 to 1 at rest at both ends, whose acceleration and deceleration are held for 0.4 of its duration each."""
    x = np.clip(share, 0.0, 1.0)
    whole = float(_PARTS[0](1.0))
    position, velocity, acceleration = (part(x) / whole for part in _PARTS)
    return position, velocity, acceleration


def _vector(x: Array) -> str:
    return " ".join(f"{v:.12g}" for v in np.asarray(x))


def _inertial(mass: float, size: float, at: Array = (0.0, 0.0, 0.0)) -> str:
    i = 0.1 * mass * size**2
    return f'<inertial pos="{_vector(at)}" mass="{mass:.12g}" diaginertia="{i:.12g} {1.2 * i:.12g} {1.1 * i:.12g}"/>'


def _wheels(rng: np.random.Generator) -> tuple[str, Array, float, float]:
    """Base on 3 to 5 braked wheels: its text, their points (count, 3), its height and the coefficient of friction."""
    count, friction = int(rng.integers(3, 6)), float(rng.uniform(0.3, 1.0))
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count + rng.uniform(0, 7)
    places = rng.uniform(0.25, 0.45, (count, 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    height = float(rng.uniform(0.2, 0.35))
    points = np.c_[places, np.full(count, RADIUS - height)]
    base = _inertial(rng.uniform(20, 60), 0.6, [*rng.uniform(-0.05, 0.05, 2), rng.uniform(-0.1, 0.05)])
    base += "".join(f'<geom name="foot{k}" size="{RADIUS}" pos="{_vector(p)}"/>' for k, p in enumerate(points))
    return base, points, height, friction


def cart(seed: int) -> Scene:
    """Cart on 3 to 5 braked wheels with an arm of 2 to 4 joints and a load."""
    rng = np.random.default_rng([1, seed])
    base, points, height, friction = _wheels(rng)
    load, joints = float(rng.uniform(1, 8)), int(rng.integers(2, 5))
    arm = f'<body name="load" pos="0 0 {rng.uniform(0.1, 0.3):.12g}">{_inertial(load, 0.05)}</body>'
    for k in reversed(range(joints)):
        axis, length = rng.standard_normal(3), rng.uniform(0.2, 0.4)
        inner = _inertial(rng.uniform(1, 4), length, (0, 0, length / 2))
        joint = f'<joint name="j{k}" axis="{_vector(axis / np.linalg.norm(axis))}"/>'
        arm = f'<body name="link{k}" pos="0 0 {0.1 if k == 0 else length:.12g}">{joint}{inner}{arm}</body>'
    start, change = rng.uniform(-0.8, 0.8, joints), rng.uniform(1.2, 3.0, joints) * rng.choice([-1, 1], joints)
    return _scene(
        "cart", base + arm, height, friction, points, ["base"] * len(points), start, change, np.zeros(3), load, quintic
    )


def frame(seed: int) -> Scene:
    """Trunk on four legs of three sliding joints each; the trunk moves while the feet stay."""
    rng = np.random.default_rng([2, seed])
    height, friction = float(rng.uniform(0.3, 0.5)), float(rng.uniform(0.3, 1.0))
    base = _inertial(rng.uniform(15, 40), 0.5, rng.uniform(-0.05, 0.05, 3))
    corners = np.array([(x, y) for x in (1, -1) for y in (1, -1)]) * rng.uniform([0.15, 0.1], [0.35, 0.25], (4, 2))
    for k, (x, y) in enumerate(corners):
        leg = f'<geom name="foot{k}" size="{RADIUS}"/>' + _inertial(rng.uniform(0.2, 0.6), 0.05)
        for axis in ("0 0 1", "0 1 0", "1 0 0"):
            at = f"{x:.12g} {y:.12g} {RADIUS - height:.12g}" if axis == "1 0 0" else "0 0 0"
            inner = "" if axis == "0 0 1" else _inertial(rng.uniform(0.2, 0.6), 0.1, (0, 0, 0.05))
            name = f"{axis[0:5:2]}of{k}"
            joint = f'<joint name="{name}" type="slide" axis="{axis}"/>'
            leg = f'<body name="{name}" pos="{at}">{joint}{inner}{leg}</body>'
        base += leg
    angle = rng.uniform(0, 2 * np.pi)
    moved = rng.uniform(0.1, 0.3) * np.array([np.cos(angle), np.sin(angle), rng.uniform(-0.3, 0.3)])
    start, change = np.zeros(12), -np.tile(moved, 4)
    return _scene(
        "frame",
        base,
        height,
        friction,
        np.zeros((4, 3)),
        [f"001of{k}" for k in range(4)],
        start,
        change,
        moved,
        np.nan,
        quintic,
    )


def mast(seed: int) -> Scene:
    """Cart on 3 to 5 braked wheels with a load that a boom carries beyond them and a mast lifts.

    The load on the wheels depends on the acceleration alone, which is held: a violation lasts for 0.4 of the motion.
    """
    rng = np.random.default_rng([3, seed])
    base, points, height, friction = _wheels(rng)
    azimuth, length, load = rng.uniform(0, 2 * np.pi), rng.uniform(0.6, 1.0), float(rng.uniform(4, 12))
    boom = length * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    arm = f'<body name="load" pos="{_vector(boom)}">{_inertial(load, 0.05)}</body>'
    arm = (
        f'<body name="lift" pos="0 0 0.2"><joint name="j0" type="slide" axis="0 0 1"/>{_inertial(2.0, 0.3)}{arm}</body>'
    )
    change = np.array([rng.uniform(0.5, 1.0) * rng.choice([-1, 1])])
    still = np.zeros(3)
    return _scene(
        "mast", base + arm, height, friction, points, ["base"] * len(points), np.zeros(1), change, still, load, held
    )


def _scene(
    kind: str, base: str, height: float, friction: float, points: Array, frames: list[str], start: Array, change: Array,
    moved: Array, payload: float, profile: Profile,
) -> Scene:  # fmt: skip
    text = {"step": STEP, "friction": f"{friction:.12g}", "height": f"{height:.12g}", "base": base}
    robot = tw.load(_XML.format(floor="", **text), inertia="accept")
    share, rate, growth = profile(np.linspace(0.0, 1.0, ROWS))
    root = np.c_[np.tile([1.0, 0, 0, 0], (ROWS, 1)), np.array([0, 0, height]) + share[:, None] * moved]
    q = np.c_[root, start + share[:, None] * change]
    whole = np.concatenate([np.zeros(3), moved, change])
    contacts = tuple(
        statics.Contact(p - [0, 0, RADIUS], friction=friction, frame=f) for p, f in zip(points, frames, strict=True)
    )
    velocities = (x[:, None] * whole for x in (rate, growth))
    return Scene(kind, _XML.format(floor=_FLOOR, **text), robot, contacts, q, *velocities, change, payload, profile)


# ── Forward simulation


@dataclass(frozen=True)
class FirstMotion:
    """Least factor at which a contact moves, and how it goes there."""

    factor: float
    how: str


def simulated(scene: Scene, speed: float, most: float = FIRST, load: float | None = None) -> str:
    """How contacts pass a displacement when the motion runs at a speed with a load [kg]: "holds", "slips" or "tips"."""
    model = mujoco.MjModel.from_xml_string(scene.xml)
    model.dof_armature[6:] = ARMATURE
    if load is not None:
        model.body_mass[model.body("load").id] = load
        mujoco.mj_setConst(model, mujoco.MjData(model))
    data = mujoco.MjData(model)
    data.qpos[7:] = scene.q[0, 7:]
    feet = [k for k in range(model.ngeom) if model.geom(k).name.startswith("foot")]
    settled = round(SETTLING / STEP)
    steps = settled + round((1.0 / speed + 0.05) / STEP)
    _, rates, _ = scene.profile(speed * (np.arange(1, steps + 1) - settled) * STEP)
    wanted = speed * rates[:, None] * scene.joints
    for k in range(steps):
        if k == settled:
            before = data.geom_xpos[feet].copy()
        data.qfrc_applied[6:] = ARMATURE * (wanted[k] - data.qvel[6:]) / STEP
        mujoco.mj_step(model, data)
        if k > settled and k % 4 == 0:
            change = data.geom_xpos[feet] - before
            rise, slide = change[:, 2], np.hypot(change[:, 0], change[:, 1])
            if max(rise.max(), slide.max()) > most:
                return "slips" if slide.max() > rise.max() else "tips"
    return "holds"


def first_motion(run: Callable[[float], str], low: float = 0.96, high: float = 1.12, halvings: int = 6) -> FirstMotion:
    """Bisection of the least factor at which a run does not hold; the interval is widened where both ends agree."""
    while run(low) != "holds":
        low, high = 0.8 * low, low
    while (how := run(high)) == "holds":
        low, high = high, 1.25 * high
        if high > 4.0:
            return FirstMotion(np.inf, "holds")
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        found = run(middle)
        if found == "holds":
            low = middle
        else:
            high, how = middle, found
    return FirstMotion(0.5 * (low + high), how)


def speed_case(scene: Scene) -> dict[str, Any] | None:
    """Predicted and simulated speed of a scene; None if the pose at rest fails or no speed is too fast."""
    found = scene.support()
    speed = float(found.speed[found.worst])
    if not (np.isfinite(speed) and 0.2 < speed < 20.0) or np.isnan(found.speed).any():
        return None
    predicted = scene.support(1.01 * speed)
    how = str(predicted.how[np.argmin(predicted.speed)])
    first = first_motion(lambda k: simulated(scene, k * speed))
    seen = first_motion(lambda k: simulated(scene, k * speed, MOVED), first.factor, first.factor + 0.16)
    return {
        "kind": scene.kind, "speed": speed, "first": first.factor, "seen": seen.factor, "predicted": how, "goes": first.how,
    }  # fmt: skip


def payload_case(scene: Scene) -> dict[str, Any] | None:
    """Predicted and simulated load of a scene whose motion runs at 0.8 of its largest speed."""
    found = scene.support()
    speed = 0.8 * float(found.speed[found.worst])
    if not 0.2 < speed < 20.0 or np.isnan(found.speed).any():
        return None
    more = float(scene.support(speed).payload.min())
    if not 0.2 < more < 100.0:
        return None
    load = scene.payload + more
    first = first_motion(lambda k: simulated(scene, speed, load=k * load))
    seen = first_motion(lambda k: simulated(scene, speed, MOVED, k * load), first.factor, first.factor + 0.16)
    return {
        "kind": scene.kind, "speed": speed, "load": load, "first": first.factor, "seen": seen.factor, "goes": first.how,
    }  # fmt: skip
