"""Data of a page: the robot's programs as JavaScript, sliders, limits, wrenches, and the pose at the start."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import SingularMassMatrixError
from ..export.javascript import javascript_module
from ..export.request import BridgedQuantity
from ..lie import se3
from ..model.model import BASE, Frame, Model
from ..motion.coordinates import Coordinates
from ..reports.load_case import Payload
from ..robot import Robot
from ..simulation.schemes import RK4
from ..typing import Array
from .colours import COLOURS, SHARES, torque_marks
from .scene import PAYLOAD, turned_z

if TYPE_CHECKING:
    from .section_pages import SectionPanel

LARGEST = 10_000
"""Instructions of the longest mass matrix and forward dynamics that a page carries: an arm of 24 joints.

Browsers do not optimise much longer programs. The others are there for every robot: they are shorter, and grow with the number
of bodies."""
STEP = 1 / 8000
"""Time step of a fall [s]. With the fourth-order method the bundled arms keep their energy to a microjoule over
seconds."""


_NARROWER = ((";\n  const ", ",\n"), ("\n  ", "\n"), (" * ", "*"), (" + ", "+"), (" - ", "-"), (" = ", "="))
"""Spellings of programs in the page, which are shorter."""


class PagePrograms:
    """The programs of one page.

    They are those of the robot with a frame for each body, so that the first of ``link_poses`` are the poses of the bodies,
    and with one more without mass at the tip, whose mass is the payload. Wrenches on the robot, the tip's among them, and the
    payload are inputs behind the state.
    """

    def __init__(
        self,
        robot: Robot,
        wrenches: Sequence[str],
        section: SectionPanel | None = None,
        *,
        payload: Payload | None = None,
        motion: bool = False,
    ) -> None:
        self.section, self.moves = section, motion
        model = robot.model
        self.carried_by, self.place = "tip", (0.0, 0.0, 0.0)
        self.tip = model.tip if model.tip is not None and model.frame(model.tip).body != BASE else None
        named = {name: model.frame(name) for name in (*wrenches, *([] if self.tip is None else [self.tip]))}
        self.wrenches = tuple(named)
        self.payload = _unused("payload", named)
        if self.tip is not None:
            at = Payload(0.0) if payload is None else payload
            carrier = model.frame(at.frame or self.tip)
            named[self.payload] = replace(carrier, pose=carrier.pose @ se3.pose(np.eye(3), at.place))
            self.carried_by, self.place = at.frame or self.tip, at.place
        frames = {_unused(f"body {k}", named): Frame(k, np.eye(4)) for k in range(len(model.bodies))}
        self.body_frames = tuple(frames)
        self.robot = Robot(replace(model, frames={**frames, **named}, sites={}))

    def data(self) -> dict[str, Any]:
        """Entry of the page's header: names of the programs, and the data that running them needs."""
        robot, why = self.robot, self._why_it_stays
        mass = sum(float(b.inertia.mass) for b in robot.model.bodies)
        weight = mass * float(np.linalg.norm(robot.model.gravity))
        a, b, _, _, _ = RK4.numbers
        return {
            "programs": list(self._functions),
            "wrenchFrames": self.wrenches,
            "payloadName": "more at tip" if robot.model.payloads else f"payload at {self.carried_by}",
            "payloadFrame": self.carried_by,
            "payloadPlace": list(self.place),
            "payloadAt": None if self.tip is None else _place(robot.model.frame(self.payload)),
            "moving": mass,
            "payload": None if self.tip is None else round_above(mass / 2 or 1.0),
            "push": None if self.tip is None else round_above(weight or 10.0),
            "fall": {"why": why, "step": STEP, "a": [row.tolist() for row in a], "b": b.tolist()},
        }

    def script(self) -> str:
        """The programs as plain script, which a page may run where making functions of strings is forbidden."""
        parts = ",\n".join(f"{name}: {text}" for name, text in self._functions.items())
        return f'"use strict";\nconst PROGRAMS = {{\n{parts}\n}};\n'

    @cached_property
    def _functions(self) -> dict[str, str]:
        """Functions of JavaScript by the name the page calls them; what a robot has no use for is not there."""
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
            asked["acceleration"] = "forward_dynamics", {**pushed, **load}
            asked["kinetic"] = "kinetic_energy", load
            asked["potential"] = "potential_energy", load
        if any(b.inertia.mass > 0 for b in model.bodies):
            asked["centre"] = "center_of_mass", load
        if self.tip is not None and model.nv:
            asked["rates"] = "coordinate_rates", {}
            asked["jacobian"] = "jacobian", {"frame": self.tip, "kind": "world_aligned"}
        if self.moves:
            asked["inverse"] = "inverse_dynamics", {**pushed, **load}
            if model.friction.any:
                asked["law"] = "friction_under_load", {}
            if model.springs:
                asked["gravity"] = "gravity_forces", {}
        if self.section is not None:
            asked |= self.section.programs(self)
        return {name: self._function(quantity, options) for name, (quantity, options) in asked.items()}

    def _function(self, quantity: str, options: dict[str, Any]) -> str:
        """One as an expression: the module's function, without the comment above it, in which the robot's name stands."""
        text = javascript_module(BridgedQuantity(self.robot, quantity, options))
        text = text[text.index("export function") + len("export ") :].rstrip()
        for wide, narrow in _NARROWER:
            text = text.replace(wide, narrow)
        return text

    @property
    def load(self) -> dict[str, Any]:
        """The option that makes the payload an input."""
        return {} if self.tip is None else {"parameters": f"{self.payload}.mass"}

    @property
    def pushed(self) -> dict[str, Any]:
        """The options that make wrenches on the robot inputs."""
        return {"wrenches": self.wrenches, "on_robot": self.wrenches} if self.wrenches else {}

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
        """Why it cannot be let go, a sentence, or None where it can."""
        if not self.robot.nv:
            return "Nothing of it moves."
        if any(not b.joint.driven for b in self.robot.model.bodies):
            return "A base that floats has no floor to fall on here, so it cannot be let go."
        if not self._has_inverse:
            return "Some joint moves nothing that has mass, so it cannot be let go."
        if len(self.robot.program("forward_dynamics", **self.pushed, **self.load).instructions) > LARGEST:
            return f"Its forward dynamics takes more than {LARGEST} operations, too much for a page, so it cannot be let go."
        return None


def _place(frame: Frame) -> dict[str, Any]:
    """Body and pose of a frame, as the page has them."""
    return {"body": frame.body, "pose": frame.pose.ravel().tolist()}


def _unused(name: str, taken: Container[str]) -> str:
    """The name, with underscores behind it where it is taken."""
    while name in taken:
        name += "_"
    return name


def round_above(x: float) -> float:
    """The next of 1, 2, 5, 10 and so on, not below x.

    >>> round_above(0.3), round_above(18.2)
    (0.5, 20.0)
    """
    power = 10.0 ** np.floor(np.log10(x))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= x * (1 - 1e-9)))


# ── Sliders of coordinates: names, units and ranges


def sliders_of(model: Model) -> list[dict[str, Any]]:
    """A slider for each coordinate.

    Its ``name``, place ``q``, ``unit`` (° or m), range ``lower`` to ``upper``, and limits ``least``, ``most`` (None without);
    three with ``turn`` 0, 1, 2 (roll, pitch, yaw) share a quaternion's ``q``.
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
                "unit": slider.unit,
                "lower": least if np.isfinite(least) else min(-slider.reach, most - 2 * slider.reach),
                "upper": most if np.isfinite(most) else max(slider.reach, least + 2 * slider.reach),
                "least": least if np.isfinite(least) else None,
                "most": most if np.isfinite(most) else None,
            }
            found.append(entry if slider.turn is None else entry | {"turn": slider.turn})
    return found


# ── The robot in the page's header

_REVERSED = np.diag([1.0, -1.0, -1.0, 1.0]).ravel().tolist()
_LONGEST_ARROW = 0.35
"""Length of the largest force, as a share of the robot's size."""


def robot_data(robot: Robot, start: Array) -> dict[str, Any]:
    """Names, limits, sliders and marks; what the page moves it by are its programs."""
    model, coordinates = robot.model, Coordinates.from_model(robot.model)
    limits = robot.limits.effort.tolist()
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
        "tip": None if model.tip is None else list(model.all_frames).index(model.tip),
        "torques": [
            {"name": n, "unit": u, "limit": limit if 0 < limit < np.inf else None}
            for n, u, limit in zip(coordinates.velocity_names, coordinates.torque_units, limits, strict=True)
        ],
        "hands": sliders_of(model),
        "colours": {**COLOURS, "shares": SHARES, "payload": PAYLOAD},
        "marks": [{**vars(m), "pose": m.pose.ravel().tolist(), "reversed": _REVERSED} for m in torque_marks(model)],
    }


def wrench_data(robot: Robot, wrenches: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """The wrenches on the robot, and their arrows: a moment's around its axis, a force's along it."""
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


# ── The pose at the start, without a motion


def starting_pose(robot: Robot) -> Array:
    """The neutral configuration, but for joints whose limits leave it out: those are in their middle; (nq,)."""
    q = robot.neutral.copy()
    for body in robot.model.leaders:
        low, high = robot.limits.lower[body.v_index], robot.limits.upper[body.v_index]
        if body.joint.nv == 1 and not low <= q[body.q_index] <= high:
            q[body.q_index] = (low + high) / 2
    return q


def default_view_pose(robot: Robot) -> Array:
    """A configuration above the floor of the base and far from singular ones; (nq,)."""
    Q = robot.random_configuration(0, 256)
    angular = Coordinates.from_model(robot.model).angular
    turned = np.where(angular, Q - 2 * np.pi * np.round(Q / (2 * np.pi)), Q)  # to half a turn
    Q = np.where((robot.limits.lower <= turned) & (turned <= robot.limits.upper), turned, Q)
    heights = np.asarray(robot.link_poses(Q))[..., 2, 3]
    J = np.asarray(robot.jacobian(Q, kind="world_aligned"))
    least = np.linalg.svd(J, compute_uv=False)[:, -1]
    return np.asarray(Q[np.argmax(np.where(heights.min(axis=1) > -1e-9, least, least - 1e3))])
