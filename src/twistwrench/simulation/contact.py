"""Compliant contacts with a plane and with joint stops, damped by the Hunt–Crossley law.

If a point penetrates to a depth d > 0 at the rate d', the repulsive force is

    f = k dⁿ max(0, 1 + c d')

The force is zero at the start and end of the contact and never pulls. For an impact at speed v, the coefficient of
restitution e satisfies

    c v - ln(1 + c v) = -c e v - ln(1 - c e v),      e ≈ 1 - ⅔ c v for slow ones,

for any k, n and mass, if no other force acts. Source: Hunt and Crossley, "Coefficient of restitution interpreted as
damping in vibroimpact", J. Applied Mechanics 42, 1975; the equation for e is the energy integral of the law.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.ir.tracer import trace
from ..core import arguments
from ..core.arguments import positive
from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.algorithms.contact import plane_contact, stop_contact
from ..mechanics.model.model import Model
from ..robot.engine import compile_form

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True)
class Plane:
    """Contact plane n·x = height for points of one frame; ``docs/simulation.md`` describes the law.

    A point sliding at the velocity v is opposed by ``friction f v / √(|v|² + slip²)``: regularised Coulomb friction.
    Instead of sticking, the point creeps at speeds up to ``slip``.

    Examples
    --------
    >>> ground = Plane("box", points=[[0.1, 0, 0], [-0.1, 0, 0]], stiffness=1e5, dissipation=0.5, friction=0.8)
    >>> ground.points.shape
    (2, 3)
    """

    frame: str
    """Frame of the contact points."""
    points: ArrayLike = (0.0, 0.0, 0.0)
    """Contact points in the frame, (3,) or (n, 3) [m]."""
    normal: ArrayLike = (0.0, 0.0, 1.0)
    """Normal of the plane in the base frame, (3,), pointing out of the ground; any length."""
    height: float = 0.0
    """Height of the plane along the normal [m]."""
    stiffness: float = 1e5
    """Stiffness k [N/mⁿ]."""
    exponent: float = 1.5
    """Exponent n; 1.5 is Hertzian contact of round bodies."""
    dissipation: float = 0.0
    """Dissipation c [s/m]; 0 is an elastic impact."""
    friction: float = 0.0
    """Coulomb friction coefficient."""
    slip: float = 1e-2
    """Speed of regularisation [m/s]."""

    def __post_init__(self) -> None:
        points = np.atleast_2d(np.asarray(arguments.finite(self.points, "Plane: points", 3), float))
        if points.ndim != 2 or not len(points):
            raise ShapeError(f"Plane: points have shape {points.shape}, expected (3,) or (n, 3).")
        normal = np.asarray(arguments.finite(arguments.one(self.normal, "Plane: normal", 3), "Plane: normal", 3), float)
        size = float(np.linalg.norm(normal))
        if size == 0.0:
            raise ValueRangeError("Plane: the normal is zero. Give the direction out of the ground, as (0, 0, 1).")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normal", normal / size)
        arguments.finite(arguments.one(self.height, "Plane: height"), "Plane: height")
        _check_law("Plane", self.stiffness, self.exponent, self.dissipation)
        positive(self.friction, "Plane: friction", zero=True)
        positive(self.slip, "Plane: slip", "m/s")


@dataclass(frozen=True)
class JointStops:
    """Compliant stops at the position limits of joints with one degree of freedom, with the law of :class:`Plane`."""

    stiffness: float
    """Stiffness k [N m/radⁿ or N/mⁿ]."""
    exponent: float = 1.5
    """Exponent n, as for a plane."""
    dissipation: float = 0.0
    """Dissipation c [s/rad or s/m]."""
    joints: tuple[str, ...] | None = None
    """Joints with stops; None: all with position limits."""

    def __post_init__(self) -> None:
        _check_law("JointStops", self.stiffness, self.exponent, self.dissipation)
        joints: object = self.joints
        if isinstance(joints, str):
            object.__setattr__(self, "joints", (joints,))


def _check_law(what: str, stiffness: float, exponent: float, dissipation: float) -> None:
    positive(stiffness, f"{what}: stiffness")
    if not 1.0 <= positive(exponent, f"{what}: exponent") <= 5.0:
        raise ValueRangeError(f"{what}: exponent is {exponent}, and must be from 1 to 5; 1.5 is Hertz's.")
    positive(dissipation, f"{what}: dissipation", zero=True)


MAX_WEIGHTS_ON_POINT = 3.0
"""Multiple of the robot's weight on a point at the start above which the point counts as buried."""
MIN_FORCE = 1e-9
"""Force that counts as zero, for robots without weight [N]."""


class RobotContact(ABC):
    """Robot with one of its contacts."""

    def __init__(
        self, robot: Robot, name: str, key: tuple[Any, ...], size: int, numbers: dict[str, Array], **parts: Array
    ) -> None:
        self.robot, self.name, self.size, self.numbers = robot, name, size, numbers
        """Name of the contact's event; number of points or joints; inputs of the program other than the state, by name, (...)
        each."""
        self.key = (type(self).__name__, size, *key)
        """Cache key: contacts of one robot with equal keys share a program."""
        self.parts = {**numbers, **parts}
        """Inputs in parts (m, ...), evaluated as a batch; the torques of the parts are added."""

    @abstractmethod
    def symbolic_torques(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """Joint torques (nv,) and penetration of each point or joint (m,), on symbols."""

    def torques_and_depths(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Joint torques (..., nv) and penetration of each point or joint (..., m)."""
        if all(x.ndim == 1 for x in self.parts.values()):
            tau, depths = self._kernel(q, dq, *self.parts.values())
            return tau, depths
        tau, depths = self._kernel(q[..., None, :], dq[..., None, :], *self.parts.values())
        return tau.sum(axis=-2), depths[..., 0]

    def gap(self, q: Array) -> float:
        """Gap of the nearest point or joint, negative inside [m or rad]."""
        return float(self.gaps(q))

    def gaps(self, q: Array) -> Array:
        """Gaps (...) of configurations (..., nq)."""
        return np.asarray(-self.torques_and_depths(q, np.zeros(self.robot.nv))[1].max(axis=-1))

    def torques(self, q: Array, dq: Array) -> Array | None:
        """Joint torques, (..., nv); None without contact."""
        tau, depths = self.torques_and_depths(q, dq)
        return tau if (depths > 0.0).any() else None

    @cached_property
    def _kernel(self) -> Any:
        robot = self.robot

        def build() -> Any:
            inputs = [("q", (robot.nq,)), ("dq", (robot.nv,))]
            inputs += [(name, x.shape[-1:]) for name, x in self.parts.items()]
            program = trace(partial(self.symbolic_torques, robot.model), inputs, ["tau", "depths"])
            return compile_form(program, "contact", f"Contact torques of {robot.name}, compiled.")

        return robot.engine.cache(("contact", *self.key), build)


class PlaneContact(RobotContact):
    """Robot and a contact plane."""

    def __init__(self, robot: Robot, plane: Plane) -> None:
        robot.model.frame(plane.frame)
        points = np.asarray(plane.points)
        law = np.array((plane.height, plane.stiffness, plane.dissipation, plane.friction, plane.slip), float)
        numbers = {"points": points.ravel(), "normal": np.asarray(plane.normal), "law": law}
        key = plane.frame, plane.exponent
        super().__init__(robot, f"{plane.frame} touches the plane", key, len(points), numbers, points=points)
        self.plane = plane

    def symbolic_torques(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """Joint torques and penetrations by :func:`.plane_contact`."""
        points, normal, law = numbers
        return plane_contact(model, q, dq, self.plane.frame, self.plane.exponent, points.reshape(-1, 3), normal, law)

    def remark_at_start(self, q: Array) -> str:
        """Remark on an initial state in which a point penetrates deeper than under the robot's weight; empty if none does."""
        plane, model = self.plane, self.robot.model
        depths = self.torques_and_depths(q, np.zeros(self.robot.nv))[1]
        worst = int(depths.argmax())
        weight = sum(b.inertia.mass for b in model.bodies) * np.linalg.norm(model.gravity)
        depth = max(float(depths[worst]), 0.0)
        if not plane.stiffness * depth**plane.exponent > max(MAX_WEIGHTS_ON_POINT * float(weight), MIN_FORCE):
            return ""
        stored = float(plane.stiffness * (np.maximum(depths, 0.0) ** (plane.exponent + 1)).sum() / (plane.exponent + 1))
        x, y, z = np.asarray(plane.points)[worst]
        return (
            f"point ({printed(x)}, {printed(y)}, {printed(z)}) of {plane.frame!r} starts {printed(depth, 4)} m below the "
            f"plane, which throws the robot out: {printed(stored, 3)} J are in that contact at the start. Start higher, or "
            "with the plane lower"
        )


class StopContact(RobotContact):
    """Robot and its joint stops."""

    def __init__(self, robot: Robot, stops: JointStops) -> None:
        limits, bodies = robot.limits, {b.joint.name: b for b in robot.model.leaders if b.joint.nv == 1}
        has_limit = np.isfinite(limits.lower) | np.isfinite(limits.upper)
        names = tuple(bodies) if stops.joints is None else stops.joints
        rows = []
        for name in names:
            if name not in bodies:
                raise UnknownNameError.from_choices("joint with one degree of freedom", name, bodies)
            if has_limit[bodies[name].v_index]:
                rows.append((bodies[name].q_index, bodies[name].v_index))
        if not rows:
            raise ValueRangeError(f"robot {robot.name!r} has no limits of position there, so JointStops has no stops.")
        self.stops, self.places = stops, tuple(rows)
        """Indices in q and in dq of the joints that have stops."""
        law = np.array([stops.stiffness, stops.dissipation], float)
        velocities = [k for _, k in rows]
        numbers = {"lower": limits.lower[velocities], "upper": limits.upper[velocities], "law": law}
        super().__init__(robot, "a joint touches its stop", (self.places, stops.exponent), len(rows), numbers)

    def symbolic_torques(self, _model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """Joint torques and penetrations by :func:`.stop_contact`."""
        lower, upper, law = numbers
        return stop_contact(q, dq, self.places, self.stops.exponent, lower, upper, law)
