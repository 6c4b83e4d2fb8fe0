"""Contacts of a robot: their law as programs trace it, and the numbers that it is given."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.contact_forces import plane_contact, stop_contact
from ..core.printed_numbers import printed
from ..errors import UnknownNameError, ValueRangeError
from ..model.model import Model
from ..program.trace import trace
from ..robot.model_kernels import compiled
from ..typing import Array
from .contact import JointStops, Plane

if TYPE_CHECKING:
    from ..robot import Robot

_PRESSED = 3.0
"""Times the robot's weight that presses a point in: more at the start is no robot that stands or lands there."""
_NOTHING = 1e-9
"""N: what is no force, for robots without weight."""


class RobotContact(ABC):
    """A robot and what it runs into."""

    robot: Robot
    name: str
    """Of the event with which it begins."""

    @property
    @abstractmethod
    def key(self) -> tuple[Any, ...]:
        """Contacts of one robot with one key are one program."""

    @cached_property
    @abstractmethod
    def numbers(self) -> dict[str, Array]:
        """What its program is given besides the state, by name, (...) each."""

    @property
    @abstractmethod
    def size(self) -> int:
        """m, its points or joints."""

    @abstractmethod
    def traced(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """On symbols, what it does to the joints, (nv,), and how deep each of its points or joints is inside, (m,)."""

    @cached_property
    def parts(self) -> dict[str, Array]:
        """The same in parts (m, ...) that are looked at side by side, and whose torques add up."""
        return self.numbers

    def touched(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """What it does to the joints, (..., nv), and how deep each of its points or joints is inside, (..., m)."""
        if all(x.ndim == 1 for x in self.parts.values()):
            tau, depths = self._kernel(q, dq, *self.parts.values())
            return tau, depths
        tau, depths = self._kernel(q[..., None, :], dq[..., None, :], *self.parts.values())
        return tau.sum(axis=-2), depths[..., 0]

    def gap(self, q: Array) -> float:
        """How far the nearest point or joint is from touching, negative inside [m or rad]."""
        return float(self.gaps(q))

    def gaps(self, q: Array) -> Array:
        """The same of configurations (..., nq), (...)."""
        return np.asarray(-self.touched(q, np.zeros(self.robot.nv))[1].max(axis=-1))

    def torques(self, q: Array, dq: Array) -> Array | None:
        """What it does to the joints, (..., nv); None where nothing touches."""
        tau, depths = self.touched(q, dq)
        return tau if (depths > 0.0).any() else None

    @cached_property
    def _kernel(self) -> Any:
        robot = self.robot

        def made() -> Any:
            rest = [(name, x.shape[-1:]) for name, x in self.parts.items()]
            program = trace(
                lambda *given: self.traced(robot.model, *given),
                [("q", (robot.nq,)), ("dq", (robot.nv,)), *rest],
                ["tau", "depths"],
            )
            return compiled(program, "contact", f"What a contact does to {robot.name}, compiled.")

        return robot.engine.kept(("contact", *self.key), made)


@dataclass(frozen=True, eq=False)
class PlaneContact(RobotContact):
    """A plane and the robot that runs into it."""

    robot: Robot
    plane: Plane
    name: str = field(init=False)

    def __post_init__(self) -> None:
        self.robot.model.frame(self.plane.frame)
        object.__setattr__(self, "name", f"{self.plane.frame} touches the plane")

    @property
    def key(self) -> tuple[Any, ...]:
        """Frame, number of points and exponent."""
        return "plane", self.plane.frame, self.size, self.plane.exponent

    @property
    def size(self) -> int:
        """The number of points."""
        return len(np.asarray(self.plane.points))

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Points, normal, and the numbers of the law."""
        plane = self.plane
        law = (plane.height, plane.stiffness, plane.dissipation, plane.friction, plane.slip)
        return {"points": np.ravel(plane.points), "normal": np.asarray(plane.normal), "law": np.array(law, float)}

    @cached_property
    def parts(self) -> dict[str, Array]:
        """A part for each point."""
        return {**self.numbers, "points": np.asarray(self.plane.points)}

    def traced(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """By :func:`.plane_contact`."""
        points, normal, law = numbers
        return plane_contact(model, q, dq, self.plane.frame, self.plane.exponent, points.reshape(-1, 3), normal, law)

    def buried(self, q: Array) -> str:
        """What to say of a start with a point deeper inside than the robot's weight presses it; empty where none is."""
        plane, model = self.plane, self.robot.model
        depths = self.touched(q, np.zeros(self.robot.nv))[1]
        worst, weight = int(depths.argmax()), sum(b.inertia.mass for b in model.bodies) * np.linalg.norm(model.gravity)
        depth = max(float(depths[worst]), 0.0)
        if not plane.stiffness * depth**plane.exponent > max(_PRESSED * float(weight), _NOTHING):
            return ""
        stored = float(plane.stiffness * (np.maximum(depths, 0.0) ** (plane.exponent + 1)).sum() / (plane.exponent + 1))
        x, y, z = np.asarray(plane.points)[worst]
        return (
            f"point ({printed(x)}, {printed(y)}, {printed(z)}) of {plane.frame!r} starts {printed(depth, 4)} m below the "
            f"plane, which throws the robot out: {printed(stored, 3)} J are in that contact at the start. Start higher, or "
            "with the plane lower"
        )


@dataclass(frozen=True, eq=False)
class StopContact(RobotContact):
    """Joint stops and the robot that has them."""

    robot: Robot
    stops: JointStops
    name: str = "a joint touches its stop"
    places: tuple[tuple[int, int], ...] = field(init=False)
    """In q and in dq, of the joints that have stops."""

    def __post_init__(self) -> None:
        limits, known = self.robot.limits, {b.joint.name: b for b in self.robot.model.leaders if b.joint.nv == 1}
        asked = known if self.stops.joints is None else self.stops.joints
        for name in asked:
            if name not in known:
                raise UnknownNameError.of("joint with one degree of freedom", name, known)
        rows = [(known[n].q_index, known[n].v_index) for n in asked]
        rows = [(i, k) for i, k in rows if np.isfinite(limits.lower[k]) or np.isfinite(limits.upper[k])]
        if not rows:
            raise ValueRangeError(
                f"robot {self.robot.name!r} has no limits of position there, so JointStops has no stops."
            )
        object.__setattr__(self, "places", tuple(rows))

    @property
    def key(self) -> tuple[Any, ...]:
        """Joints and exponent."""
        return "stops", self.places, self.stops.exponent

    @property
    def size(self) -> int:
        """The number of joints."""
        return len(self.places)

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Limits, and the numbers of the law."""
        limits, mine = self.robot.limits, [k for _, k in self.places]
        law = np.array([self.stops.stiffness, self.stops.dissipation], float)
        return {"lower": limits.lower[mine], "upper": limits.upper[mine], "law": law}

    def traced(self, _model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """By :func:`.stop_contact`."""
        lower, upper, law = numbers
        return stop_contact(q, dq, self.places, self.stops.exponent, lower, upper, law)
