"""Data of a page: the robot's programs in JavaScript, sliders, limits, wrenches, and the initial pose."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import SingularMassMatrixError
from ..core.numbers import percent
from ..core.typing import Array
from ..mechanics.lie import se3
from ..mechanics.model.model import BASE, Frame, Model
from ..motion.coordinates import Coordinates
from ..motion.load_case import Payload
from ..robot import Robot
from ..robot.export.javascript import javascript_module
from ..robot.export.request import BridgedQuantity
from ..simulation.methods.tableaus import RK4
from .colours import COLOURS, SHARES, torque_marks
from .scene import PAYLOAD, turned_z

if TYPE_CHECKING:
    from .page_loops import PageLoops
    from .section_pages import SectionPanel

LARGEST = 10_000
"""Maximum number of instructions of the mass matrix and forward dynamics in a page: an arm of 24 joints.

Browsers hardly optimise longer programs. The other programs are included for every robot: they are shorter, and their
length is proportional to the number of bodies."""
STEP = 1 / 8000
"""Time step of a fall [s]. With the fourth-order method the bundled arms conserve energy to a microjoule over
seconds. Closed loops use a step four times as long."""
COARSE = 1 / 1000
"""Time step with friction and stops, where energy is not conserved."""
DAMPING = 0.1
"""Default viscous friction for files without friction [N m s/rad, N s/m]."""
DRY = 0.02
"""Default Coulomb friction, as a share of the torque limit."""

_NARROWER = (
    (";\n  const ", ",\n"),
    ("\n  ", "\n"),
    (" * ", "*"),
    (" / ", "/"),
    (" + ", "+"),
    (" - ", "-"),
    (" = ", "="),
)
"""Replacements that shorten the programs in the page."""


class PagePrograms:
    """Programs of one page.

    They belong to the robot with one frame for each body, so that the first of ``link_poses`` are the body poses, and
    one more massless frame at each tip for the payload. Wrenches on the robot (including those at the tips) and
    payloads are inputs after the state.
    """

    def __init__(
        self,
        robot: Robot,
        wrenches: Sequence[str],
        section: SectionPanel | None = None,
        *,
        payload: Payload | None = None,
        motion: bool = False,
        loops: PageLoops | None = None,
    ) -> None:
        self.section, self.moves, self.loops = section, motion, loops
        model = robot.model
        own = [] if model.tip is None or model.frame(model.tip).body == BASE else [model.tip]
        given = [] if payload is None or payload.frame is None else [payload.frame]
        self.tips = tuple(own or given or tips_of(model))
        self.chosen = 0 if own or not one_arm(model) else len(self.tips) - 1
        named = {name: model.frame(name) for name in (*wrenches, *self.tips)}
        self.wrenches = tuple(named)
        at = Payload(0.0) if payload is None else payload
        self.carriers = tuple(at.frame or tip for tip in self.tips)
        self.place = at.place
        self.payloads: list[str] = []
        for carrier in map(model.frame, self.carriers):
            self.payloads.append(_unused("payload", named))
            named[self.payloads[-1]] = replace(carrier, pose=carrier.pose @ se3.pose(np.eye(3), at.place))
        if loops is not None:
            ends = {name for closure in loops.closures for name in (closure.frame_a, closure.frame_b)} - set(named)
            named |= {name: model.frame(name) for name in ends & set(model.all_frames)} | dict(loops.frames)
        frames = {_unused(f"body {k}", named): Frame(k, np.eye(4)) for k in range(len(model.bodies))}
        self.body_frames = tuple(frames)
        self.robot = Robot(replace(model, frames={**frames, **named}, sites={}))

    def data(self) -> dict[str, Any]:
        """Header entry: names of the programs, and the data needed to run them."""
        robot, why = self.robot, self._why_it_stays
        mass = sum(float(b.inertia.mass) for b in robot.model.bodies)
        weight = mass * float(np.linalg.norm(robot.model.gravity))
        a, b, _, _, _ = RK4.numbers
        step = STEP if self.loops is None else 4 * STEP
        return {
            "programs": list(self._functions),
            "wrenchFrames": self.wrenches,
            "payloadPlace": list(self.place),
            "moving": mass,
            "payload": round_above(mass / 2 or 1.0) if self.tips else None,
            "push": round_above(weight or 10.0) if self.tips else None,
            "fall": {"why": why, "step": step, "a": [row.tolist() for row in a], "b": b.tolist(), **resistance(robot)},
        }

    def tips_data(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Data of each tip: its frame index and the joints that carry a payload there."""
        more = bool(self.robot.model.payloads)
        return [
            {
                "tip": names.index(tip),
                "payloadName": "more at tip" if more else f"payload at {carrier}",
                "payloadFrame": carrier,
                "payloadAt": _place(self.robot.model.frame(payload)),
            }
            for tip, carrier, payload in zip(self.tips, self.carriers, self.payloads, strict=True)
        ]

    @property
    def tip(self) -> str | None:
        """Initial tip."""
        return self.tips[self.chosen] if self.tips else None

    def script(self) -> str:
        """Programs as plain script, since the page must not create functions from strings."""
        parts = ",\n".join(f"{name}: {text}" for name, text in self._functions.items())
        return f'"use strict";\nconst PROGRAMS = {{\n{parts}\n}};\n'

    @cached_property
    def _functions(self) -> dict[str, str]:
        """JavaScript functions by the names used in the page; functions without use for the robot are left out."""
        model = self.robot.model
        if not model.bodies:
            return {}
        load, pushed = self.load, self.pushed
        asked: dict[str, tuple[str, dict[str, Any]]] = {"poses": ("link_poses", {})}
        if model.nv:
            asked["holding"] = "holding_torques", {**pushed, **load}
            if self._has_inverse and len(self.robot.program("mass_matrix", **load).instructions) <= LARGEST:
                asked["mass"] = "mass_matrix", load
        if self._why_it_stays is None:
            asked["rates"] = "coordinate_rates", {}
            asked |= self._accelerations
            asked["potential"] = "potential_energy", load
        if any(b.inertia.mass > 0 for b in model.bodies):
            asked["centre"] = "center_of_mass", load
        for k, tip in enumerate(self.tips if model.nv else ()):
            asked["rates"] = "coordinate_rates", {}
            asked[f"jacobian{k}"] = "jacobian", {"frame": tip, "kind": "world_aligned"}
        if self.loops is not None:
            closing = {"constraints": self.loops.closures}
            asked["rates"] = "coordinate_rates", {}
            asked["closing"], asked["closing_rows"] = ("closure_poses", closing), ("constraint_jacobian", closing)
            for k, body in enumerate(self.loops.feet):
                frame = {"frame": self.body_frames[body], "kind": "world_aligned"}
                asked[f"foot{k}"] = "jacobian", frame
        if self.moves:
            asked["inverse"] = "inverse_dynamics", {**pushed, **load}
            if model.limited_followers:
                asked["across"] = "joint_wrenches", {**pushed, **load}
            if model.friction.any:
                asked["law"] = "friction_under_load", {}
            if model.springs:
                asked["gravity"] = "gravity_forces", {}
        if self.section is not None:
            asked |= self.section.programs(self)
        return {name: self._function(quantity, options) for name, (quantity, options) in asked.items()}

    def _function(self, quantity: str, options: dict[str, Any]) -> str:
        """Expression of one function of the module, without the comment above it that contains the robot's name."""
        text = javascript_module(BridgedQuantity(self.robot, quantity, options))
        text = text[text.index("export function") + len("export ") :].rstrip()
        for wide, narrow in _NARROWER:
            text = text.replace(wide, narrow)
        return text

    @property
    def load(self) -> dict[str, Any]:
        """Option that makes payloads an input."""
        return {"parameters": tuple(f"{name}.mass" for name in self.payloads)} if self.tips else {}

    @property
    def pushed(self) -> dict[str, Any]:
        """Options that make wrenches on the robot inputs."""
        return {"wrenches": self.wrenches, "on_robot": self.wrenches} if self.wrenches else {}

    @property
    def _accelerations(self) -> dict[str, tuple[str, dict[str, Any]]]:
        """Programs of the released robot's motion; with loops, the terms of the equation that the page solves."""
        given, mass = {**self.pushed, **self.load}, ("mass_matrix", self.load)
        if self.loops is None:
            return {"mass": mass, "acceleration": ("forward_dynamics", given)}
        closing = {"constraints": self.loops.closures}
        return {"mass": mass, "inverse": ("inverse_dynamics", given), "closing_bias": ("constraint_bias", closing)}

    @cached_property
    def _has_inverse(self) -> bool:
        """True if the mass matrix has an inverse."""
        try:
            self.robot.engine.require_invertible()
        except SingularMassMatrixError:
            return False
        return True

    @cached_property
    def _why_it_stays(self) -> str | None:
        """Sentence on why the robot cannot be released, or None if it can."""
        if not self.robot.nv:
            return "Nothing of it moves."
        if not self._has_inverse:
            return "Some joint moves nothing that has mass, so it cannot be let go."
        if any(len(self.robot.program(q, **given).instructions) > LARGEST for q, given in self._accelerations.values()):
            return f"Its dynamics takes more than {LARGEST} operations, too much for a page, so it cannot be let go."
        return None


def resistance(robot: Robot) -> dict[str, Any]:
    """Viscous and Coulomb friction and stops of each velocity; :data:`DAMPING` and :data:`DRY` if the file has none."""
    model, friction = robot.model, robot.model.friction
    stops: list[dict[str, Any] | None] = [None] * model.nv
    for body in model.leaders:
        low, high = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
        if body.joint.nv == 1 and np.isfinite([low, high]).all():
            stops[body.v_index] = {"q": body.q_index, "least": low, "most": high}
    assumed = not (friction.viscous.any() or friction.coulomb.any())
    effort = model.limits.effort
    driven = np.array([body.joint.driven for body in model.leaders for _ in range(body.joint.nv)], bool)
    viscous = DAMPING * driven if assumed else friction.viscous
    coulomb = np.where(driven & np.isfinite(effort), DRY * effort, 0.0) if assumed else friction.coulomb
    dry = f", dry friction {percent(DRY)} of the limits" if coulomb.any() else ""
    return {
        "coarse": COARSE,
        "viscous": viscous.tolist(),
        "coulomb": coulomb.tolist(),
        "assumed": f"Friction is assumed: {DAMPING} N m s/rad{dry}." if assumed else "",
        "stops": stops,
    }


def _place(frame: Frame) -> dict[str, Any]:
    """Body and pose of a frame in the page's format."""
    return {"body": frame.body, "pose": frame.pose.ravel().tolist()}


_TOOLS = re.compile(r"tool|tcp|(?<![a-z])eef?(?![a-z])|end_?effector|grasp|hand_?tip", re.IGNORECASE)
"""Names that suggest a tool frame."""
MOST_TIPS = 12
MANY = 12
"""Maximum number of torques in a full list; longer lists show the largest and fold the rest by limb."""


def tips_of(model: Model) -> list[str]:
    """Selectable tips: a leaf frame of each last body, then frames on moving bodies with a name like a tool.

    >>> import twistwrench as tw
    >>> tips_of(tw.robots.quadruped().model)
    ['FL_foot', 'FR_foot', 'RL_foot', 'RR_foot']
    """
    last = set(range(len(model.bodies))) - {body.parent for body in model.bodies}
    ends = {model.frames[name].body: name for name in model.leaves if model.frames[name].body in last}
    tools = [name for name, frame in model.all_frames.items() if frame.body != BASE and _TOOLS.search(name)]
    return list(dict.fromkeys([*ends.values(), *tools]))[:MOST_TIPS]


def one_arm(model: Model) -> bool:
    """True if all last bodies are moved by one joint with a motor, as in an arm with a gripper."""
    parents = {k: body.parent for k, body in enumerate(model.bodies)}
    shared = set(parents)
    for k in set(parents) - set(parents.values()):
        chain = [k]
        while chain[-1] != BASE:
            chain.append(parents[chain[-1]])
        shared &= set(chain)
    return any(model.bodies[k].joint.driven for k in shared)


def _unused(name: str, taken: Container[str]) -> str:
    """Unused name: the given one, with underscores appended if it is taken."""
    while name in taken:
        name += "_"
    return name


def round_above(x: float) -> float:
    """Smallest number of the series 1, 2, 5, 10, … that is at least x.

    >>> round_above(0.3), round_above(18.2)
    (0.5, 20.0)
    """
    power = 10.0 ** np.floor(np.log10(x))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= x * (1 - 1e-9)))


# ── Sliders of coordinates: names, units and ranges


def sliders_of(model: Model) -> list[dict[str, Any]]:
    """Sliders of the coordinates, one each.

    A slider has ``name``, index ``q``, velocity indices ``v`` of the joint, ``unit`` (° or m), range ``lower`` to
    ``upper``, and limits ``least``, ``most`` (or None). The three with ``turn`` 0, 1, 2 (roll, pitch, yaw) share a
    quaternion's ``q``.
    """
    found: list[dict[str, Any]] = []
    for body in model.leaders:
        least, most = -np.inf, np.inf
        if body.joint.nv == 1:
            least, most = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
        for slider in body.joint.sliders:
            entry = {
                "name": f"{body.joint.name}{slider.label}",
                "q": body.q_index + slider.coordinate,
                "v": list(range(body.v_index, body.v_index + body.joint.nv)),
                "unit": slider.unit,
                "lower": least if np.isfinite(least) else min(-slider.reach, most - 2 * slider.reach),
                "upper": most if np.isfinite(most) else max(slider.reach, least + 2 * slider.reach),
                "least": least if np.isfinite(least) else None,
                "most": most if np.isfinite(most) else None,
            }
            found.append(entry if slider.turn is None else entry | {"turn": slider.turn})
    return found


def limbs_of(model: Model) -> list[dict[str, Any]]:
    """Chains of joints between branchings of the tree: ``name``, ``torques`` and ``hands`` (sliders).

    >>> import twistwrench as tw
    >>> [(limb["name"], limb["torques"]) for limb in limbs_of(tw.robots.quadruped().model)][1]
    ('FL_hip_joint … FL_calf_joint', [6, 7, 8])
    """
    parents = [body.parent for body in model.bodies if body.joint.moves_body]
    chain: dict[int, int] = {}
    for k, body in enumerate(model.bodies):
        begins = body.parent == BASE or parents.count(body.parent) > 1 or not model.bodies[body.parent].joint.driven
        chain[k] = k if begins or not body.joint.moves_body else chain[body.parent]
    sliders = sliders_of(model)
    found = []
    for first in dict.fromkeys(chain.values()):
        mine = [body for k, body in enumerate(model.bodies) if chain[k] == first and not body.follows]
        torques = [k for body in mine for k in range(body.v_index, body.v_index + body.joint.nv)]
        places = {k for body in mine for k in range(body.q_index, body.q_index + body.joint.nq)}
        names = list(dict.fromkeys((mine[0].joint.name, mine[-1].joint.name))) if mine else []
        hands = [k for k, slider in enumerate(sliders) if slider["q"] in places]
        if torques:
            found.append({"name": " … ".join(names), "torques": torques, "hands": hands})
    return found


# ── Robot in the page header

_REVERSED = np.diag([1.0, -1.0, -1.0, 1.0]).ravel().tolist()
_LONGEST_ARROW = 0.35
"""Length of the largest force arrow, as a share of the robot's size."""


def robot_data(robot: Robot, start: Array) -> dict[str, Any]:
    """Names, limits, sliders and marks; the programs that move the robot are separate."""
    model, coordinates = robot.model, Coordinates.from_model(robot.model)
    limits = robot.limits.effort.tolist()
    motors = [body.joint.driven for body in model.leaders for _ in range(body.joint.nv)]
    return {
        "name": robot.name,
        "start": np.asarray(start, float).tolist(),
        "coordinates": [
            {"name": n, "turns": bool(t)} for n, t in zip(coordinates.names, coordinates.endless, strict=True)
        ],
        "bodies": [
            {"name": b.link, "kind": b.joint.kind, "q": b.q_index, "follows": b.follows, "parent": b.parent}
            for b in model.bodies
        ],
        "frames": [{"name": n, **_place(f)} for n, f in model.all_frames.items()],
        "torques": [
            {"name": n, "unit": u, "limit": limit if 0 < limit < np.inf else None, "driven": driven}
            for n, u, limit, driven in zip(
                coordinates.velocity_names, coordinates.torque_units, limits, motors, strict=True
            )
        ],
        "limbs": limbs_of(model) if model.nv > MANY else [],
        "hands": sliders_of(model),
        "colours": {**COLOURS, "shares": SHARES, "payload": PAYLOAD},
        "marks": [{**vars(m), "pose": m.pose.ravel().tolist(), "reversed": _REVERSED} for m in torque_marks(model)],
    }


def wrench_data(robot: Robot, wrenches: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Wrenches on the robot with their arrows: moments around their axis, forces along it."""
    frames = list(robot.frame_names)
    one, finite = arguments.one, arguments.finite
    given = {name: finite(one(F, f"the wrench on {name!r}", 6), "a wrench", 6) for name, F in wrenches.items()}
    largest = max((float(np.linalg.norm(F[3:])) for F in given.values()), default=0.0)
    data, marks = [], []
    for name, F in given.items():
        robot.model.frame(name)
        m, f = F[:3], F[3:]
        frame = frames.index(name)
        data.append({"frame": frame, "moment": m.tolist(), "force": f.tolist()})
        for part, turns in ((m, True), (f, False)):
            if (size := float(np.linalg.norm(part))) > 0:
                length = 0.0 if turns else max(0.08, _LONGEST_ARROW * size / largest)
                T = se3.pose(turned_z(part), np.zeros(3))
                marks.append({"frame": frame, "pose": T.ravel().tolist(), "length": length, "turns": turns})
    return {"wrenches": data, "wrenchMarks": marks}
