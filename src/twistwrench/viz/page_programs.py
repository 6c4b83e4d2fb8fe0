"""Programs of a page in JavaScript: what moves the robot, and its tips, payloads and resistance."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import SingularMassMatrixError
from ..core.numbers import percent
from ..core.typing import Array
from ..mechanics.lie import se3
from ..mechanics.model.model import BASE, Frame, Model
from ..motion.load_case import Payload
from ..robot import Robot
from ..robot.export.javascript import javascript_module
from ..robot.export.request import BridgedQuantity
from ..simulation.methods.tableaus import RK4
from .starting_pose import chain_to_base

if TYPE_CHECKING:
    from .page_loops import PageLoops
    from .section_pages import SectionPanel

MAX_INSTRUCTIONS = 10_000
"""Maximum number of instructions of the mass matrix and forward dynamics in a page: an arm of 24 joints.

Browsers hardly optimise longer programs. The other programs are included for every robot: they are shorter, and their
length is proportional to the number of bodies."""
STEP = 1 / 8000
"""Time step of a fall [s]. With the fourth-order method the bundled arms conserve energy to a microjoule over
seconds. Closed loops use a step four times as long."""
COARSE_STEP = 1 / 1000
"""Time step with friction and stops, where energy is not conserved."""
DAMPING = 0.1
"""Default viscous friction for files without friction [N m s/rad, N s/m]."""
COULOMB_SHARE = 0.02
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
        self.tips, self.chosen = _selectable_tips(model, payload)
        named = {name: model.frame(name) for name in (*wrenches, *self.tips)}
        self.wrenches = tuple(named)
        if payload is None:
            payload = Payload(0.0)
        self.carriers = tuple(payload.frame or tip for tip in self.tips)
        self.place = payload.place
        self.payloads: list[str] = []
        for carrier in map(model.frame, self.carriers):
            self.payloads.append(_unused_name("payload", named))
            named[self.payloads[-1]] = replace(carrier, pose=carrier.pose @ se3.pose(np.eye(3), payload.place))
        if loops is not None:
            for closure in loops.closures:
                ends = (closure.frame_a, closure.frame_b)
                named |= {name: model.frame(name) for name in ends if name in model.all_frames}
            named |= loops.frames
        frames = {_unused_name(f"body {k}", named): Frame(k, np.eye(4)) for k in range(len(model.bodies))}
        self.body_frames = tuple(frames)
        self.robot = Robot(replace(model, frames={**frames, **named}, sites={}))
        self._quantities: dict[Any, BridgedQuantity] = {}

    def data(self) -> dict[str, Any]:
        """Header entry: names of the programs, and the data needed to run them."""
        robot = self.robot
        mass = moving_mass(robot.model)
        weight = mass * float(np.linalg.norm(robot.model.gravity))
        payload, push = None, None
        if self.tips:
            payload, push = round_above(mass / 2 or 1.0), round_above(weight or 10.0)
        a, b, _, _, _ = RK4.numbers
        fall = {
            "why": self._why_it_stays,
            "step": STEP if self.loops is None else 4 * STEP,
            "a": [row.tolist() for row in a],
            "b": b.tolist(),
            **resistance(robot),
        }
        return {
            "programs": list(self._functions),
            "wrenchFrames": self.wrenches,
            "payloadPlace": list(self.place),
            "moving": mass,
            "payload": payload,
            "push": push,
            "fall": fall,
        }

    def tips_data(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Data of each tip: its frame index and the joints that carry a payload there."""
        tips = []
        for tip, carrier, payload in zip(self.tips, self.carriers, self.payloads, strict=True):
            payload_name = "more at tip" if self.robot.model.payloads else f"payload at {carrier}"
            entry = {
                "tip": names.index(tip),
                "payloadName": payload_name,
                "payloadFrame": carrier,
                "payloadAt": frame_data(self.robot.model.frame(payload)),
            }
            tips.append(entry)
        return tips

    @property
    def tip(self) -> str | None:
        """Initial tip."""
        return self.tips[self.chosen] if self.tips else None

    def script(self) -> str:
        """Programs as plain script, since the page must not create functions from strings."""
        entries = [f"{name}: {text}" for name, text in self._functions.items()]
        parts = ",\n".join(entries)
        return f'"use strict";\nconst PROGRAMS = {{\n{parts}\n}};\n'

    @cached_property
    def _functions(self) -> dict[str, str]:
        """JavaScript functions by the names used in the page; functions without use for the robot are left out."""
        model = self.robot.model
        if not model.bodies:
            return {}
        programs = {"poses": ("link_poses", dict[str, Any]())}
        if model.nv:
            programs["holding"] = "holding_torques", {**self.wrench_options, **self.load}
            if self._has_inverse and self._length("mass_matrix", self.load) <= MAX_INSTRUCTIONS:
                programs["mass"] = "mass_matrix", self.load
        if self._why_it_stays is None:
            programs["rates"] = "coordinate_rates", {}
            programs |= self._accelerations
            programs["potential"] = "potential_energy", self.load
        if any(body.inertia.mass > 0 for body in model.bodies):
            programs["centre"] = "center_of_mass", self.load
        if model.nv and self.tips:
            programs["rates"] = "coordinate_rates", {}
            for k, tip in enumerate(self.tips):
                programs[f"jacobian{k}"] = "jacobian", {"frame": tip, "kind": "world_aligned"}
        if self.loops is not None:
            programs |= self._loop_programs(self.loops)
        if self.moves:
            programs |= self._motion_programs
        if self.section is not None:
            programs |= self.section.programs(self)
        return {name: self._function(quantity, options) for name, (quantity, options) in programs.items()}

    def _loop_programs(self, loops: PageLoops) -> dict[str, tuple[str, dict[str, Any]]]:
        """Programs that keep loops closed, and the Jacobians of the feet."""
        closing = {"constraints": loops.closures}
        programs: dict[str, tuple[str, dict[str, Any]]] = {
            "rates": ("coordinate_rates", {}),
            "closing": ("closure_poses", closing),
            "closing_rows": ("constraint_jacobian", closing),
        }
        for k, body in enumerate(loops.feet):
            programs[f"foot{k}"] = "jacobian", {"frame": self.body_frames[body], "kind": "world_aligned"}
        return programs

    @property
    def _motion_programs(self) -> dict[str, tuple[str, dict[str, Any]]]:
        """Programs of the torques along a motion, and of their parts."""
        model, options = self.robot.model, {**self.wrench_options, **self.load}
        programs: dict[str, tuple[str, dict[str, Any]]] = {"inverse": ("inverse_dynamics", options)}
        if model.limited_followers:
            programs["across"] = "joint_wrenches", options
        if model.friction.any:
            programs["law"] = "friction_under_load", {}
        if model.springs:
            programs["gravity"] = "gravity_forces", {}
        return programs

    def _quantity(self, name: str, options: dict[str, Any]) -> BridgedQuantity:
        """Quantity with its program, which is traced once for its length and its text."""
        key = name, *options.items()
        if key not in self._quantities:
            self._quantities[key] = BridgedQuantity(self.robot, name, options)
        return self._quantities[key]

    def _length(self, quantity: str, options: dict[str, Any]) -> int:
        """Number of instructions of a program."""
        return len(self._quantity(quantity, options).program.instructions)

    def _function(self, quantity: str, options: dict[str, Any]) -> str:
        """Expression of one function of the module, without the comment above it that contains the robot's name."""
        text = javascript_module(self._quantity(quantity, options))
        text = text[text.index("export function") + len("export ") :].rstrip()
        for wide, narrow in _NARROWER:
            text = text.replace(wide, narrow)
        return text

    @property
    def load(self) -> dict[str, Any]:
        """Option that makes payloads an input."""
        return {"parameters": tuple(f"{name}.mass" for name in self.payloads)} if self.tips else {}

    @property
    def wrench_options(self) -> dict[str, Any]:
        """Options that make wrenches on the robot inputs."""
        return {"wrenches": self.wrenches, "on_robot": self.wrenches} if self.wrenches else {}

    @property
    def _accelerations(self) -> dict[str, tuple[str, dict[str, Any]]]:
        """Programs of the released robot's motion; with loops, the terms of the equation that the page solves."""
        options, mass = {**self.wrench_options, **self.load}, ("mass_matrix", self.load)
        if self.loops is None:
            return {"mass": mass, "acceleration": ("forward_dynamics", options)}
        closing = {"constraints": self.loops.closures}
        return {"mass": mass, "inverse": ("inverse_dynamics", options), "closing_bias": ("constraint_bias", closing)}

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
        if any(self._length(*program) > MAX_INSTRUCTIONS for program in self._accelerations.values()):
            return f"Its dynamics takes more than {MAX_INSTRUCTIONS} operations, too much for a page, so it cannot be let go."
        return None


def resistance(robot: Robot) -> dict[str, Any]:
    """Viscous and Coulomb friction and stops of each velocity; with assumed friction if the file has none."""
    model, friction = robot.model, robot.model.friction
    stops: list[dict[str, Any] | None] = [None] * model.nv
    for body in model.leaders:
        low, high = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
        if body.joint.nv == 1 and np.isfinite([low, high]).all():
            stops[body.v_index] = {"q": body.q_index, "least": low, "most": high}
    viscous, coulomb, assumption = friction.viscous, friction.coulomb, ""
    if not viscous.any() and not coulomb.any():
        driven, effort = driven_velocities(model), model.limits.effort
        viscous = DAMPING * driven
        coulomb = np.where(driven & np.isfinite(effort), COULOMB_SHARE * effort, 0.0)
        assumption = f"Friction is assumed: {DAMPING} N m s/rad"
        if coulomb.any():
            assumption += f", dry friction {percent(COULOMB_SHARE)} of the limits"
        assumption += "."
    return {
        "coarse": COARSE_STEP,
        "viscous": viscous.tolist(),
        "coulomb": coulomb.tolist(),
        "assumed": assumption,
        "stops": stops,
    }


def driven_velocities(model: Model) -> Array:
    """Mask (nv,) of the velocities of joints with a drive."""
    masks = [np.full(body.joint.nv, body.joint.driven, bool) for body in model.leaders]
    return np.concatenate([np.zeros(0, bool), *masks])


def frame_data(frame: Frame) -> dict[str, Any]:
    """Body and pose of a frame in the page's format."""
    return {"body": frame.body, "pose": frame.pose.ravel().tolist()}


_TOOLS = re.compile(r"tool|tcp|(?<![a-z])eef?(?![a-z])|end_?effector|grasp|hand_?tip", re.IGNORECASE)
"""Names that suggest a tool frame."""
MAX_TIPS = 12


def tips_of(model: Model) -> list[str]:
    """Selectable tips: a leaf frame of each last body, then frames on moving bodies with a name like a tool.

    >>> import twistwrench as tw
    >>> tips_of(tw.robots.quadruped().model)
    ['FL_foot', 'FR_foot', 'RL_foot', 'RR_foot']
    """
    last = last_bodies(model)
    ends = {model.frames[name].body: name for name in model.leaves if model.frames[name].body in last}
    tools = [name for name, frame in model.all_frames.items() if frame.body != BASE and _TOOLS.search(name)]
    return list(dict.fromkeys([*ends.values(), *tools]))[:MAX_TIPS]


def moving_mass(model: Model) -> float:
    """Mass of all moving bodies [kg]."""
    return sum(float(body.inertia.mass) for body in model.bodies)


def last_bodies(model: Model) -> set[int]:
    """Bodies that carry no other."""
    return set(range(len(model.bodies))) - {body.parent for body in model.bodies}


def one_arm(model: Model) -> bool:
    """True if all last bodies are moved by one joint with a motor, as in an arm with a gripper."""
    shared = set(range(len(model.bodies)))
    for k in last_bodies(model):
        shared = shared.intersection(chain_to_base(model, k))
    return any(model.bodies[k].joint.driven for k in shared)


def _selectable_tips(model: Model, payload: Payload | None) -> tuple[tuple[str, ...], int]:
    """Tips of a page and the index of the initial one: the robot's own tip, that of the payload, or all."""
    if model.tip is not None and model.frame(model.tip).body != BASE:
        return (model.tip,), 0
    tips = tuple(tips_of(model))
    if payload is not None and payload.frame is not None:
        tips = (payload.frame,)
    if one_arm(model):
        return tips, len(tips) - 1
    return tips, 0


def _unused_name(name: str, used: Container[str]) -> str:
    """The name, with underscores appended if it is used."""
    while name in used:
        name += "_"
    return name


def round_above(x: float) -> float:
    """Smallest number of the series 1, 2, 5, 10, … that is at least x.

    >>> round_above(0.3), round_above(18.2)
    (0.5, 20.0)
    """
    power = 10.0 ** np.floor(np.log10(x))
    series = power * np.array([1, 2, 5, 10])
    return float(series[np.argmax(series >= x * (1 - 1e-9))])
