"""True robots of the faulty logs: bodies and drives apart from the file's, torques by Pinocchio, motions and coloured noise.

Torques never come from the kernels under test: by Pinocchio on a model made of the description's bodies, or, where Pinocchio is
not installed, by the algorithm on floats, one state at a time.

    τ_j = R_j + Ia_j ddq_j + fv_j dq_j + w(t) F_j tanh(dq_j / v_0) + off_j
    F_j = fc_j (1 + a sign(dq_j)) + fs_j exp(-(dq_j / v_s)²) + l Abs(R_j)
    w(t) = 1 + warming · t / T

with R the rigid torques, a the asymmetry of Coulomb friction, fs static friction above Coulomb's, l the share of load friction.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.signal import lfilter

import twistwrench as tw
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.model.model import BASE
from twistwrench.testing import random_robot

try:
    import pinocchio as pin
except ImportError:
    pin = None

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "robots"
"""Public robot files, which are no part of the repository."""
RATE, SECONDS, HARMONICS, BASIC = 250.0, 20.0, 5, 0.1
"""Rows a second, seconds, number of harmonics, and the first of them [Hz]."""
AMPLITUDE, SHARE_OF_RANGE = 1.2, 0.4
"""rad or m, and share of the range between the limits, that the motion is not wider than, to each side."""
NOISE, MEMORY = 0.02, 0.03
"""Deviation of the noise, of that of a joint's torque, and the seconds in which it is forgotten."""
FRICTION_SPEED = 0.01
"""Speed at which true dry friction turns [rad/s or m/s]."""
DRIVES = {"motor_inertia": 0.05, "viscous": 0.10, "coulomb": 0.15, "offset": 0.03}
"""Shares of a drive in the deviation of a joint's torque."""
_GEARED = """<robot name="geared"><link name="base"/>{parts}</robot>"""
_LINK = """<link name="link{k}"><inertial><origin xyz="0.2 0 0.05"/><mass value="{mass}"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial></link>
<joint name="joint{k}" type="{type}"><parent link="{parent}"/><child link="link{k}"/><origin xyz="0.4 0 0"/><axis xyz="{axis}"/>
  <limit lower="-3" upper="3" velocity="9" effort="99"/>{more}</joint>"""

Array = np.ndarray
States = tuple[Array, Array, Array]
"""Positions, velocities and accelerations (n, nv), each."""


# ── Robots, as their files have them


def _geared() -> tw.Robot:
    """An arm whose second joint takes a third along, and a slide."""
    mimic = '<mimic joint="joint1" multiplier="-0.5" offset="0.2"/>'
    kinds = [
        ("0 0 1", "revolute", ""),
        ("0 1 0", "revolute", ""),
        ("0 1 0", "revolute", mimic),
        ("1 0 0", "prismatic", ""),
    ]
    parts = [
        _LINK.format(k=k, mass=4 - k, parent=f"link{k - 1}" if k else "base", axis=axis, type=kind, more=more)
        for k, (axis, kind, more) in enumerate(kinds)
    ]
    return tw.load(_GEARED.format(parts="".join(parts)))


ARMS = ("ur5", "panda", "xarm6", "tx40")
FILES: Mapping[str, Path] = {
    "ur5": tw.robots.path_of("ur5"),
    "panda": tw.robots.path_of("panda"),
    "xarm6": SHARED / "ufactory_xarm6.urdf",
    "tx40": SHARED / "staubli_tx40.urdf",
}
OTHERS: Mapping[str, Callable[[], tw.Robot]] = {
    "planar_2r": tw.robots.planar_2r,
    "planar_3r": tw.robots.planar_3r,
    "geared": _geared,
    "sliding": lambda: random_robot(5, 4, kinds=("revolute", "prismatic")),
    "branched": lambda: random_robot(8, 5, kinds=("revolute",)),
    "quadruped": lambda: tw.robots.quadruped(floating_base=False),
    "tree_20": lambda: random_robot(11, 20, kinds=("revolute",)),
    "tree_30": lambda: random_robot(12, 30, kinds=("revolute",)),
}
VARIANTS = ("", "mimic", "prismatic")
_GEN3_FINGERS = {"gen3_robotiq_85_left_knuckle_joint": 0.0}
_LITE_FINGERS = {"right_finger_bottom_joint": 0.0}
_ALLEGRO = {f"joint_{k}.0": 0.0 for k in range(16)}
SECOND: Mapping[str, Callable[[], tw.Robot]] = {
    "gen3": lambda: _locked("kinova_gen3_2f85", _GEN3_FINGERS),
    "iiwa7": lambda: _locked("kuka_iiwa7_allegro", _ALLEGRO),
    "qarm": lambda: _locked("quanser_qarm", {}),
    "lift": lambda: _locked("kinova_gen3_lite", _LITE_FINGERS, "prismatic"),
}
"""Robots of the second generator, fingers locked; the last one stands on a vertical slide."""


@lru_cache(maxsize=32)
def load(name: str, variant: str = "") -> tw.Robot:
    """A robot as its file has it, impossible inertias repaired; in a variant one joint follows another, or slides."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        if name in OTHERS or name in SECOND:
            return {**OTHERS, **SECOND}[name]()
        if not variant:
            return tw.load(FILES[name], inertia="repair")
        return tw.load(_variant(FILES[name].read_text("utf-8"), variant), inertia="repair")


def _locked(file: str, lock: Mapping[str, float], variant: str = "") -> tw.Robot:
    """Public arm with some joints locked; its tip is the frame of the last moving link."""
    text = (SHARED / f"{file}.urdf").read_text("utf-8")
    robot = tw.load(_variant(text, variant), inertia="repair", lock=lock)
    return tw.Robot(replace(robot.model, tip=robot.model.bodies[-1].link))


def _variant(text: str, variant: str) -> str:
    """URDF whose fifth joint follows the fourth, or whose first joint slides."""
    root = ElementTree.fromstring(text)
    moving = [joint for joint in root.iter("joint") if joint.get("type") in ("revolute", "continuous")]
    for mesh in [*root.iter("visual"), *root.iter("collision")]:
        mesh.clear()
    for link in root.iter("link"):
        for empty in [e for e in link if e.tag in ("visual", "collision")]:
            link.remove(empty)
    if variant == "mimic":
        ElementTree.SubElement(moving[4], "mimic", joint=str(moving[3].get("name")), multiplier="-0.7", offset="0.1")
    elif variant == "prismatic":
        moving[0].set("type", "prismatic")
        limit = moving[0].find("limit")
        assert limit is not None
        limit.set("lower", "-0.8")
        limit.set("upper", "0.8")
    return ElementTree.tostring(root, encoding="unicode")


# ── Motions: Fourier series, and ordinary work


@dataclass(frozen=True)
class Series:
    """Fourier series of each joint about a configuration, with amplitudes (nv, harmonics) of sines and cosines."""

    centre: Array
    sines: Array
    cosines: Array

    @classmethod
    def random(cls, robot: tw.Robot, rng: np.random.Generator) -> Series:
        """A series whose largest deflection is the amplitude, within the limits of the robot."""
        lower, upper = bounds(robot)
        amplitude = np.minimum(AMPLITUDE, SHARE_OF_RANGE * (upper - lower))
        room = np.minimum((upper - lower) / 2 - amplitude, 1.0)
        sines, cosines = rng.normal(size=(2, robot.nv, HARMONICS))
        plain = cls(np.zeros(robot.nv), sines, cosines)
        size = amplitude / np.abs(plain(np.arange(0, 1 / BASIC, 0.01))[0]).max(axis=0)
        centre = (lower + upper) / 2 + rng.uniform(-1, 1, robot.nv) * room
        return cls(centre, sines * size[:, None], cosines * size[:, None])

    def __call__(self, t: Array) -> States:
        w = 2 * np.pi * BASIC * np.arange(1, HARMONICS + 1)
        sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        q = self.centre + sin @ self.sines.T + cos @ self.cosines.T
        dq = (cos * w) @ self.sines.T - (sin * w) @ self.cosines.T
        return q, dq, -(sin * w**2) @ self.sines.T - (cos * w**2) @ self.cosines.T


def bounds(robot: tw.Robot) -> tuple[Array, Array]:
    """Limits of position, ± π where there are none or wider ones."""
    return np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)


def coloured(rows: int, columns: int, rng: np.random.Generator, memory: float, rate: float = RATE) -> Array:
    """AR(1) noise of size 1 (rows, columns) that is forgotten in ``memory`` seconds."""
    keep = np.exp(-1 / rate / memory) if memory > 0 else 0.0
    white = rng.normal(size=(rows + 1000, columns))
    return lfilter([np.sqrt(1 - keep**2)], [1, -keep], white, axis=0)[1000:]


# ── True robots


def turned_gravity(gravity: Array, angle: float, direction: float) -> Array:
    """Gravity in the axes of a base that is turned by an angle about a horizontal axis, at an angle ``direction`` [rad]."""
    up = -gravity / np.linalg.norm(gravity)
    x = np.array([1.0, 0.0, 0.0])
    level = (x - up * (up @ x)) / np.sqrt(1 - (up @ x) ** 2)
    u = np.cos(direction) * level + np.sin(direction) * np.cross(up, level)
    # Rodrigues, by the angle turned back: what the base sees of a world that stands still.
    return gravity * np.cos(angle) - np.cross(u, gravity) * np.sin(angle)


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of a log: bodies, gravity, drives, and laws of the joints that the identification does not know."""

    file: tw.Robot
    """The robot as its file has it: what is identified."""
    robot: tw.Robot
    """The same joints with the true bodies."""
    drives: Mapping[str, Array] = field(default_factory=dict)
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    asymmetry: float = 0.0
    static: Array | float = 0.0
    stribeck_speed: float = 0.1
    load: float = 0.0
    warming: float = 0.0

    @classmethod
    def random(cls, file: tw.Robot, rng: np.random.Generator, apart: float = 1.0) -> Truth:
        """Bodies that differ from the file's: masses by 15 %, centres by 1 cm, moments by 7.5 % beyond the mass."""
        links = {link: _redrawn(G, rng, apart) for link, G in moved_links(file).items()}
        return cls(file, with_links(file, links), gravity=np.asarray(file.model.gravity, float))

    def with_drives(self, states: States, shares: Mapping[str, float] = DRIVES) -> Truth:
        """Drives of a given share in the deviations of the torques of a motion."""
        size = np.maximum(self.rigid(*states).std(axis=0), 1e-6)
        speed, acceleration = (np.maximum(x.std(axis=0), 1e-9) for x in states[1:])
        by = {"motor_inertia": acceleration, "viscous": speed, "coulomb": 1.0, "offset": 1.0}
        return replace(self, drives={name: share * size / by[name] for name, share in shares.items()})

    def carrying(self, mass: float, com: Array) -> Truth:
        """With a point mass at the tip, in its frame."""
        return replace(self, robot=self.robot.with_payload(SpatialInertia.from_com(mass, com)))

    def torques(self, q: Array, dq: Array, ddq: Array, t: Array | float = 0.0, seconds: float = SECONDS) -> Array:
        """Torques (n, nv) of the motors, at times of the log where friction changes with time."""
        rigid = self.rigid(q, dq, ddq)
        return rigid + self.of_drives(rigid, dq, ddq, t, seconds)

    def of_drives(self, rigid: Array, dq: Array, ddq: Array, t: Array | float = 0.0, seconds: float = SECONDS) -> Array:
        """Torques (n, nv) of motors' inertias, friction and offsets."""
        return self.drives["motor_inertia"] * ddq + self.drives["offset"] + self.friction(rigid, dq, t, seconds)

    def friction(self, rigid: Array, dq: Array, t: Array | float = 0.0, seconds: float = SECONDS) -> Array:
        """Torques (n, nv) of friction."""
        dry = self.drives["coulomb"] * (1 + self.asymmetry * np.sign(dq))
        dry = dry + self.static * np.exp(-((dq / self.stribeck_speed) ** 2)) + self.load * np.abs(rigid)
        warm = 1 + self.warming * np.broadcast_to(np.asarray(t, float) / seconds, len(dq))[:, None]
        return self.drives["viscous"] * dq + warm * dry * np.tanh(dq / FRICTION_SPEED)

    def rigid(
        self, q: Array, dq: Array, ddq: Array, *, accelerations: Array | None = None, force: Array | None = None
    ) -> Array:
        """Torques (n, nv) of the true bodies.

        ``accelerations`` (n, 3) of the base, in its axes; ``force`` (n, 3) of the world on the tip, likewise.
        """
        if pin is None:
            return _by_reference(self.robot, self.gravity, (q, dq, ddq), accelerations, force)
        model, data = self._pinocchio
        P = tw.convert.pinocchio_rates(self.robot, model)
        rows = zip(*tw.convert.to_pinocchio(self.robot, model, q, dq, ddq), strict=True)
        model.gravity.linear = self.gravity
        found = np.empty((len(q), model.nv))
        for k, row in enumerate(rows):
            if accelerations is not None:
                model.gravity.linear = self.gravity - accelerations[k]
            outer = () if force is None else (_on_tip(self.robot, model, data, row[0], force[k]),)
            found[k] = pin.rnea(model, data, *row, *outer)
        return found @ P

    @cached_property
    def _pinocchio(self):
        model, numbers = pin.Model(), dict[int, int]()
        for i, body in enumerate(self.robot.model.bodies):
            axis = np.asarray(body.joint.axes[0], float)
            kind = pin.JointModelRevoluteUnaligned if body.joint.turns else pin.JointModelPrismaticUnaligned
            parent = 0 if body.parent == BASE else numbers[body.parent]
            numbers[i] = model.addJoint(
                parent, kind(axis[:3] if body.joint.turns else axis[3:]), pin.SE3(body.placement), body.joint.name
            )
            G = pin.Inertia.FromDynamicParameters(np.array(body.inertia.parameters))
            model.appendBodyToJoint(numbers[i], G, pin.SE3.Identity())
        return model, model.createData()

    def groups(self, base) -> Array:
        """True groups (r,) of an identification's ``base``."""
        unknown = base.unknown
        own = dict(zip(self.robot.parameter_names, self.robot.parameters, strict=True))
        values = np.zeros(len(unknown.names))
        for k, name in enumerate(unknown.names):
            owner, _, kind = name.rpartition(".")
            if kind == "stribeck":
                values[k] = np.broadcast_to(self.static, self.file.nv)[self.file.model.velocity_names.index(owner)]
            elif kind in self.drives:
                values[k] = self.drives[kind][self.file.model.velocity_names.index(owner)]
            else:
                values[k] = own[name]
        return base.project(values)


def moved_links(robot: tw.Robot) -> dict[str, SpatialInertia]:
    """Inertias of the links that move."""
    frames = robot.model.frames
    return {n: G for n, G in robot.model.link_inertias.items() if frames[n].body != BASE}


def with_links(robot: tw.Robot, links: Mapping[str, SpatialInertia]) -> tw.Robot:
    """The robot with other inertias of its links; bodies are made of the links that are fixed to them."""
    model = robot.model
    bodies = []
    for i, body in enumerate(model.bodies):
        mine = [n for n in links if model.frames[n].body == i]
        rest = body.inertia.parameters.copy()
        for n in mine:
            pose = model.frames[n].pose
            rest += links[n].in_frame(pose).parameters - model.link_inertias[n].in_frame(pose).parameters
        bodies.append(replace(body, inertia=SpatialInertia.from_parameters(rest)))
    return tw.Robot(replace(model, bodies=tuple(bodies), link_inertias={**model.link_inertias, **links}))


def _redrawn(G: SpatialInertia, rng: np.random.Generator, apart: float) -> SpatialInertia:
    """Another inertia that a body can have."""
    if not G.mass > 0:
        return G
    moments, axes = np.linalg.eigh(G.moment_about_com)
    for _ in range(10_000):
        share = np.exp(0.15 * apart * rng.normal())
        com = G.com + 0.01 * apart * rng.normal(size=3)
        own = moments * share * np.exp(0.075 * apart * rng.normal(size=3))
        if 2 * own.max() <= own.sum() * (1 + 1e-9):
            return SpatialInertia.from_com(G.mass * share, com, axes @ np.diag(own) @ axes.T)
    raise AssertionError("no body was found that can exist")


def _on_tip(robot: tw.Robot, model, data, q: Array, force: Array):
    """Pinocchio's external forces of a force [N] on the tip, in the axes of the base."""
    frame = robot.model.frames[robot.model.tip]
    pin.forwardKinematics(model, data, q)
    joint = model.getJointId(robot.model.bodies[frame.body].joint.name)
    at = data.oMi[joint].act(frame.pose[:3, 3])
    outer = [pin.Force.Zero() for _ in range(model.njoints)]
    outer[joint] = data.oMi[joint].actInv(pin.Force(force, np.cross(at, force)))
    return outer


def _by_reference(
    robot: tw.Robot, gravity: Array, states: States, accelerations: Array | None, force: Array | None
) -> Array:
    """Torques by the algorithm on floats, one state at a time."""
    found = np.empty_like(states[1])
    placed = tw.Robot(replace(robot.model, gravity=np.asarray(gravity)))
    for k, (q, dq, ddq) in enumerate(zip(*states, strict=True)):
        if accelerations is not None:
            placed = tw.Robot(replace(robot.model, gravity=gravity - accelerations[k]))
        found[k] = placed.reference("inverse_dynamics", q, dq, ddq)
        if force is not None:
            T, J = (placed.reference(name, q) for name in ("forward_kinematics", "jacobian"))
            found[k] -= J[3:].T @ (T[:3, :3].T @ force[k])
    return found


def generator(robot: str, seed: int, what: str = "") -> np.random.Generator:
    """Random numbers of a robot and a seed, the same on every machine."""
    return np.random.default_rng([seed, zlib.crc32(robot.encode()), zlib.crc32(what.encode())])
