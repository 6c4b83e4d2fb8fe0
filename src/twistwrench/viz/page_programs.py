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
"""Time step of a fall [s]. With the fourth-order method the bundled arms conserve energy to a microjoule over seconds."""
LOOP_STEP = 4 * STEP
"""Time step of a fall with closed loops [s]."""
COARSE_STEP = 1 / 1000
"""Time step with friction and stops [s], where energy is not conserved."""
DAMPING = 0.1
"""Default viscous friction for files without friction [N m s/rad, N s/m]."""
COULOMB_SHARE = 0.02
"""Default Coulomb friction, as a share of the torque limit."""

_Quantities = dict[str, tuple[str, dict[str, Any]]]
"""Name and options of a quantity, by the name of its program in the page."""

_SHORTENINGS = (  # long text, short text
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

    The programs belong to a copy of the robot with other frames. Its first frames are those of the bodies, so
    ``link_poses`` begins with the body poses. Each tip has a massless frame for the payload. The inputs of a program are
    the state, the wrenches on the robot (also at the tips), and the payload masses.
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
        self.section = section
        self.has_motion = motion
        self.loops = loops
        model = robot.model
        self.tips, self.chosen = _selectable_tips(model, payload)
        """Names of the tips, and index of the initial one."""
        frames = {name: model.frame(name) for name in (*wrenches, *self.tips)}
        self.wrenches = tuple(frames)
        """Frames at which wrenches act on the robot."""
        if payload is None:
            payload = Payload(0.0)
        self.carriers = tuple(payload.frame or tip for tip in self.tips)
        """Frame that carries the payload, for each tip."""
        self.place = payload.place
        """Centre of mass of the payload in that frame [m]."""
        self.payloads: list[str] = []
        """Name of the payload's frame, for each tip."""
        for carrier in map(model.frame, self.carriers):
            payload_name = _unused_name("payload", frames)
            self.payloads.append(payload_name)
            frames[payload_name] = replace(carrier, pose=carrier.pose @ se3.pose(np.eye(3), payload.place))
        if loops is not None:
            for closure in loops.closures:
                for name in (closure.frame_a, closure.frame_b):
                    if name in model.all_frames:
                        frames[name] = model.frame(name)
            frames |= loops.frames
        body_frames = {_unused_name(f"body {k}", frames): Frame(k, np.eye(4)) for k in range(len(model.bodies))}
        self.body_frames = tuple(body_frames)
        """Name of the frame of each body."""
        self.robot = Robot(replace(model, frames={**body_frames, **frames}, sites={}))
        self._quantities: dict[Any, BridgedQuantity] = {}
        """Traced quantities by name and options."""

    def data(self) -> dict[str, Any]:
        """Header entry: names of the programs, and the data needed to run them."""
        robot = self.robot
        mass = moving_mass(robot.model)
        weight = mass * float(np.linalg.norm(robot.model.gravity))
        max_payload: float | None = None  # kg
        max_push: float | None = None  # N
        if self.tips:
            max_payload = round_above(mass / 2) if mass else 1.0
            max_push = round_above(weight) if weight else 10.0
        stage_coefficients, weights = RK4.numbers[:2]  # a and b of the tableau
        fall = {
            "why": self._why_not_released,
            "step": STEP if self.loops is None else LOOP_STEP,
            "a": [row.tolist() for row in stage_coefficients],
            "b": weights.tolist(),
            **resistance(robot),
        }
        return {
            "programs": list(self._functions),
            "wrenchFrames": self.wrenches,
            "payloadPlace": list(self.place),
            "moving": mass,
            "payload": max_payload,
            "push": max_push,
            "fall": fall,
        }

    def tips_data(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Data of each tip: its index in ``names``, and the payload's name, carrier and pose there."""
        entries = []
        for tip, carrier, payload_frame in zip(self.tips, self.carriers, self.payloads, strict=True):
            label = "more at tip" if self.robot.model.payloads else f"payload at {carrier}"
            entry = {
                "tip": names.index(tip),
                "payloadName": label,
                "payloadFrame": carrier,
                "payloadAt": frame_data(self.robot.model.frame(payload_frame)),
            }
            entries.append(entry)
        return entries

    @property
    def tip(self) -> str | None:
        """Name of the initial tip; None without tips."""
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
        no_options = dict[str, Any]()
        programs: _Quantities = {"poses": ("link_poses", no_options)}
        if model.nv:
            programs["holding"] = "holding_torques", {**self.wrench_options, **self.load}
            if self._has_inverse and self._length("mass_matrix", self.load) <= MAX_INSTRUCTIONS:
                programs["mass"] = "mass_matrix", self.load
        if self._why_not_released is None:
            programs["rates"] = "coordinate_rates", no_options
            programs |= self._accelerations
            programs["potential"] = "potential_energy", self.load
        if any(body.inertia.mass > 0 for body in model.bodies):
            programs["centre"] = "center_of_mass", self.load
        if model.nv and self.tips:
            programs["rates"] = "coordinate_rates", no_options
            for k, tip in enumerate(self.tips):
                programs[f"jacobian{k}"] = "jacobian", {"frame": tip, "kind": "world_aligned"}
        if self.loops is not None:
            programs |= self._loop_programs(self.loops)
        if self.has_motion:
            programs |= self._motion_programs
        if self.section is not None:
            programs |= self.section.programs(self)
        return {name: self._function(quantity, options) for name, (quantity, options) in programs.items()}

    def _loop_programs(self, loops: PageLoops) -> _Quantities:
        """Quantities that keep loops closed, and Jacobians of the feet."""
        constraint_options = {"constraints": loops.closures}
        programs: _Quantities = {
            "rates": ("coordinate_rates", {}),
            "closing": ("closure_poses", constraint_options),
            "closing_rows": ("constraint_jacobian", constraint_options),
        }
        for k, body in enumerate(loops.feet):
            programs[f"foot{k}"] = "jacobian", {"frame": self.body_frames[body], "kind": "world_aligned"}
        return programs

    @property
    def _motion_programs(self) -> _Quantities:
        """Torques along a motion, and parts of these torques."""
        model = self.robot.model
        options = {**self.wrench_options, **self.load}
        programs: _Quantities = {"inverse": ("inverse_dynamics", options)}
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
        """JavaScript function of a quantity, without the module's comment above it, which contains the robot's name."""
        module = javascript_module(self._quantity(quantity, options))
        start = module.index("export function") + len("export ")
        function = module[start:].rstrip()
        for long_text, short_text in _SHORTENINGS:
            function = function.replace(long_text, short_text)
        return function

    @property
    def load(self) -> dict[str, Any]:
        """Option that makes the payload masses inputs; empty without tips."""
        if not self.tips:
            return {}
        return {"parameters": tuple(f"{name}.mass" for name in self.payloads)}

    @property
    def wrench_options(self) -> dict[str, Any]:
        """Options that make wrenches on the robot inputs; empty without such wrenches."""
        return {"wrenches": self.wrenches, "on_robot": self.wrenches} if self.wrenches else {}

    @property
    def _accelerations(self) -> _Quantities:
        """Quantities of the released robot's motion: with closed loops, the terms of the equation that the page solves."""
        options = {**self.wrench_options, **self.load}
        programs: _Quantities = {"mass": ("mass_matrix", self.load)}
        if self.loops is None:
            programs["acceleration"] = "forward_dynamics", options
        else:
            programs["inverse"] = "inverse_dynamics", options
            programs["closing_bias"] = "constraint_bias", {"constraints": self.loops.closures}
        return programs

    @cached_property
    def _has_inverse(self) -> bool:
        """True if the mass matrix has an inverse."""
        try:
            self.robot.engine.require_invertible()
        except SingularMassMatrixError:
            return False
        return True

    @cached_property
    def _why_not_released(self) -> str | None:
        """Sentence on why the robot cannot be released, or None if it can."""
        if not self.robot.nv:
            return "Nothing of it moves."
        if not self._has_inverse:
            return "Some joint moves nothing that has mass, so it cannot be let go."
        if any(self._length(*program) > MAX_INSTRUCTIONS for program in self._accelerations.values()):
            return f"Its dynamics takes more than {MAX_INSTRUCTIONS} operations, too much for a page, so it cannot be let go."
        return None


def resistance(robot: Robot) -> dict[str, Any]:
    """Viscous friction, Coulomb friction and stops of each velocity for the page; assumed friction if the file has none."""
    model = robot.model
    stops: list[dict[str, Any] | None] = [None] * model.nv
    for body in model.leaders:
        low = float(model.limits.lower[body.v_index])
        high = float(model.limits.upper[body.v_index])
        if body.joint.nv == 1 and np.isfinite([low, high]).all():
            stops[body.v_index] = {"q": body.q_index, "least": low, "most": high}
    viscous_coefficients = model.friction.viscous
    coulomb_torques = model.friction.coulomb
    assumption = ""
    if not viscous_coefficients.any() and not coulomb_torques.any():
        is_driven = driven_velocities(model)
        max_torques = model.limits.effort
        viscous_coefficients = DAMPING * is_driven
        coulomb_torques = np.where(is_driven & np.isfinite(max_torques), COULOMB_SHARE * max_torques, 0.0)
        assumption = f"Friction is assumed: {DAMPING} N m s/rad"
        if coulomb_torques.any():
            assumption += f", dry friction {percent(COULOMB_SHARE)} of the limits"
        assumption += "."
    return {
        "coarse": COARSE_STEP,
        "viscous": viscous_coefficients.tolist(),
        "coulomb": coulomb_torques.tolist(),
        "assumed": assumption,
        "stops": stops,
    }


def driven_velocities(model: Model) -> Array:
    """Mask (nv,) of the velocities of joints with a drive."""
    masks = [np.full(body.joint.nv, body.joint.driven, bool) for body in model.leaders]
    no_velocities = np.zeros(0, bool)  # concatenate needs an array, also without joints
    return np.concatenate([no_velocities, *masks])


def frame_data(frame: Frame) -> dict[str, Any]:
    """Body and pose of a frame in the page's format."""
    return {"body": frame.body, "pose": frame.pose.ravel().tolist()}


_TOOLS = re.compile(r"tool|tcp|(?<![a-z])eef?(?![a-z])|end_?effector|grasp|hand_?tip", re.IGNORECASE)
"""Names that suggest a tool frame."""
MAX_TIPS = 12
"""Maximum number of selectable tips."""


def tips_of(model: Model) -> list[str]:
    """Names of selectable tips: a leaf frame of each last body, then moving frames whose names suggest a tool.

    >>> import twistwrench as tw
    >>> tips_of(tw.robots.quadruped().model)
    ['FL_foot', 'FR_foot', 'RL_foot', 'RR_foot']
    """
    last_body_indices = last_bodies(model)
    leaf_by_body: dict[int, str] = {}  # the last leaf frame of each body
    for name in model.leaves:
        body = model.frames[name].body
        if body in last_body_indices:
            leaf_by_body[body] = name
    tools = [name for name, frame in model.all_frames.items() if frame.body != BASE and _TOOLS.search(name)]
    distinct = list(dict.fromkeys([*leaf_by_body.values(), *tools]))
    return distinct[:MAX_TIPS]


def moving_mass(model: Model) -> float:
    """Mass of all moving bodies [kg]."""
    return sum(float(body.inertia.mass) for body in model.bodies)


def last_bodies(model: Model) -> set[int]:
    """Indices of the bodies that carry no other body."""
    parents = {body.parent for body in model.bodies}
    return set(range(len(model.bodies))) - parents


def one_arm(model: Model) -> bool:
    """True if one joint with a motor moves all last bodies, as in an arm with a gripper."""
    in_all_chains = set(range(len(model.bodies)))
    for k in last_bodies(model):
        in_all_chains = in_all_chains.intersection(chain_to_base(model, k))
    return any(model.bodies[k].joint.driven for k in in_all_chains)


def _selectable_tips(model: Model, payload: Payload | None) -> tuple[tuple[str, ...], int]:
    """Tips of a page and the index of the initial tip: the robot's own tip, the payload's frame, or all tips."""
    if model.tip is not None and model.frame(model.tip).body != BASE:
        return (model.tip,), 0
    tips = tuple(tips_of(model))
    if payload is not None and payload.frame is not None:
        tips = (payload.frame,)
    if one_arm(model):
        return tips, len(tips) - 1  # frames whose names suggest a tool come last
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
    power_of_ten = 10.0 ** np.floor(np.log10(x))
    series = power_of_ten * np.array([1, 2, 5, 10])
    is_enough = series >= x * (1 - 1e-9)  # despite round-off of the series
    return float(series[np.argmax(is_enough)])  # the first that is enough
