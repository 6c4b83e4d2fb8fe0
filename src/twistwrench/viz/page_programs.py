"""What a page computes with: the robot's own programs as JavaScript, and how far they may go."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bridges.javascript import javascript_module
from ..bridges.quantity import BridgedQuantity
from ..errors import SingularMassMatrixError
from ..model.model import BASE, Frame
from ..robot import Robot
from ..simulation.tableau import RK4

if TYPE_CHECKING:
    from .book_section import BookSection

LARGEST = 10_000
"""Instructions of the longest mass matrix and forward dynamics that a page carries: an arm of 24 joints.

Browsers do not optimise much longer programs. The others are there for every robot: they are shorter, and grow with the number
of bodies."""
STEP = 1 / 8000
"""Of a fall [s]. By the fourth-order method the bundled arms keep their energy to a millionth of a joule over seconds."""


class PagePrograms:
    """The programs of one page.

    They are those of the robot with a frame for each body, so that the first of ``link_poses`` are the poses of the bodies,
    and with one more without mass at the tip, whose mass is the payload. Wrenches on the robot, the tip's among them, and the
    payload are inputs behind the state.
    """

    def __init__(self, robot: Robot, wrenches: Sequence[str], section: BookSection | None = None) -> None:
        self.section = section
        model = robot.model
        self.tip = model.tip if model.tip is not None and model.frame(model.tip).body != BASE else None
        named = {name: model.frame(name) for name in (*wrenches, *([] if self.tip is None else [self.tip]))}
        self.wrenches = tuple(named)
        self.payload = _unused("payload", named)
        if self.tip is not None:
            named[self.payload] = model.frame(self.tip)
        frames = {_unused(f"body {k}", named): Frame(k, np.eye(4)) for k in range(len(model.bodies))}
        self.body_frames = tuple(frames)
        self.robot = Robot(replace(model, frames={**frames, **named}, sites={}))

    def data(self) -> dict[str, Any]:
        """What the page's header says of them: their names, and what else the page needs to run them."""
        robot, why = self.robot, self._why_it_stays
        mass = sum(float(b.inertia.mass) for b in robot.model.bodies)
        weight = mass * float(np.linalg.norm(robot.model.gravity))
        a, b, _, _, _ = RK4.numbers
        return {
            "programs": list(self._functions),
            "wrenchFrames": self.wrenches,
            "payloadName": "more at tip" if robot.model.payloads else "payload at tip",
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
        if self.section is not None:
            asked |= self.section.programs(self)
        return {name: self._function(quantity, options) for name, (quantity, options) in asked.items()}

    def _function(self, quantity: str, options: dict[str, Any]) -> str:
        """One as an expression: the module's function, without the comment above it, in which the robot's name stands."""
        text = javascript_module(BridgedQuantity(self.robot, quantity, options))
        text = text[text.index("export function") + len("export ") :].rstrip()
        for wide, narrow in (
            (";\n  const ", ",\n"),
            ("\n  ", "\n"),
            (" * ", "*"),
            (" + ", "+"),
            (" - ", "-"),
            (" = ", "="),
        ):
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
        """Whether the mass matrix has one."""
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
