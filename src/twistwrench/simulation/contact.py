"""Compliant contacts with a plane and with joint stops, damped by the Hunt–Crossley law.

If a point penetrates to a depth d > 0 at the rate d', the repulsive force is

    f = k dⁿ max(0, 1 + c d')

The force is zero at the start and end of the contact and never pulls. For an impact at speed v, the coefficient of
restitution e satisfies

    c v - ln(1 + c v) = -c e v - ln(1 - c e v),      e ≈ 1 - ⅔ c v for small v,

for any k, n and mass, if no other force acts. Source: Hunt and Crossley, "Coefficient of restitution interpreted as
damping in vibroimpact", J. Applied Mechanics 42, 1975. The equation for e is the energy integral of the law.
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


@dataclass(frozen=True, eq=False)
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
        normal = arguments.one(self.normal, "Plane: normal", 3)
        normal = np.asarray(arguments.finite(normal, "Plane: normal", 3), float)
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            raise ValueRangeError("Plane: the normal is zero. Give the direction out of the ground, as (0, 0, 1).")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normal", normal / length)
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
        if isinstance(joints, str):  # a single name
            object.__setattr__(self, "joints", (joints,))


def _check_law(owner: str, stiffness: float, exponent: float, dissipation: float) -> None:
    """Raise ValueRangeError unless the parameters of a contact law are valid; ``owner`` is the class with the law."""
    positive(stiffness, f"{owner}: stiffness")
    positive(exponent, f"{owner}: exponent")
    if not 1.0 <= exponent <= 5.0:
        raise ValueRangeError(f"{owner}: exponent is {exponent}, and must be from 1 to 5; 1.5 is Hertz's.")
    positive(dissipation, f"{owner}: dissipation", zero=True)


MAX_WEIGHTS_ON_POINT = 3.0
"""Largest force on a point at the start, in weights of the robot. With a larger force the point starts too deep."""
MIN_FORCE = 1e-9
"""Force at the start [N] that is allowed in any case, as for robots without weight."""


class RobotContact(ABC):
    """Robot with one of its contacts; its program evaluates torques and penetrations."""

    def __init__(
        self, robot: Robot, name: str, key: tuple[Any, ...], size: int, numbers: dict[str, Array], **parts: Array
    ) -> None:
        self.robot = robot
        self.name = name
        """Name of the contact's event."""
        self.size = size
        """Number of points or joints."""
        self.numbers = numbers
        """Inputs of the program other than the state, by name."""
        self.key = (type(self).__name__, size, *key)
        """Cache key: contacts of one robot with equal keys share a program."""
        self.parts = {**numbers, **parts}
        """Inputs as in ``numbers``; some are divided into parts (m, ...), which are evaluated as a batch. The torques of the
        parts are added."""

    @abstractmethod
    def symbolic_torques(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """Joint torques (nv,) and penetration of each point or joint (m,), on symbols."""

    def torques_and_depths(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Joint torques (..., nv) and penetration of each point or joint (..., m)."""
        if all(x.ndim == 1 for x in self.parts.values()):  # no input is divided
            tau, depths = self._kernel(q, dq, *self.parts.values())
            return tau, depths
        tau_of_parts, depths = self._kernel(q[..., None, :], dq[..., None, :], *self.parts.values())
        return tau_of_parts.sum(axis=-2), depths[..., 0]  # each part has one depth

    def gap(self, q: Array) -> float:
        """Gap of the nearest point or joint [m or rad], negative if it penetrates."""
        return float(self.gaps(q))

    def gaps(self, q: Array) -> Array:
        """Gap (...) of the nearest point or joint in configurations (..., nq) [m or rad], negative if it penetrates."""
        _, depths = self.torques_and_depths(q, np.zeros(self.robot.nv))
        return np.asarray(-depths.max(axis=-1))

    def torques(self, q: Array, dq: Array) -> Array | None:
        """Joint torques, (..., nv); None without contact."""
        tau, depths = self.torques_and_depths(q, dq)
        return tau if (depths > 0.0).any() else None

    @cached_property
    def _kernel(self) -> Any:
        """Compiled :meth:`symbolic_torques`, of q, dq and one part of each input."""
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
        robot.model.frame(plane.frame)  # raises UnknownNameError for another frame
        points = np.asarray(plane.points)
        law = np.array((plane.height, plane.stiffness, plane.dissipation, plane.friction, plane.slip), float)
        numbers = {"points": points.ravel(), "normal": np.asarray(plane.normal), "law": law}
        key = (plane.frame, plane.exponent)
        super().__init__(robot, f"{plane.frame} touches the plane", key, len(points), numbers, points=points)
        self.plane = plane

    def symbolic_torques(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """Joint torques and penetrations by :func:`.plane_contact`."""
        points, normal, law = numbers
        return plane_contact(model, q, dq, self.plane.frame, self.plane.exponent, points.reshape(-1, 3), normal, law)

    def remark_at_start(self, q: Array) -> str:
        """Remark on an initial state in which a point penetrates deeper than under the robot's weight; empty if none does."""
        plane = self.plane
        model = self.robot.model
        _, depths = self.torques_and_depths(q, np.zeros(self.robot.nv))
        deepest = int(depths.argmax())
        depth = max(float(depths[deepest]), 0.0)
        mass = sum(b.inertia.mass for b in model.bodies)
        weight = float(mass * np.linalg.norm(model.gravity))
        allowed_force = max(MAX_WEIGHTS_ON_POINT * weight, MIN_FORCE)
        force_at_start = plane.stiffness * depth**plane.exponent
        if not force_at_start > allowed_force:
            return ""
        # Energy of all points: for each, the integral of k dⁿ from 0 to its depth.
        penetrations = np.maximum(depths, 0.0)
        energy = float(plane.stiffness * (penetrations ** (plane.exponent + 1)).sum() / (plane.exponent + 1))
        x, y, z = np.asarray(plane.points)[deepest]
        return (
            f"point ({printed(x)}, {printed(y)}, {printed(z)}) of {plane.frame!r} starts {printed(depth, 4)} m below the "
            f"plane, which throws the robot out: {printed(energy, 3)} J are in that contact at the start. Start higher, or "
            "with the plane lower"
        )


class StopContact(RobotContact):
    """Robot and its joint stops."""

    def __init__(self, robot: Robot, stops: JointStops) -> None:
        limits = robot.limits
        body_by_joint = {b.joint.name: b for b in robot.model.leaders if b.joint.nv == 1}
        has_limit = np.isfinite(limits.lower) | np.isfinite(limits.upper)  # (nv,)
        names = tuple(body_by_joint) if stops.joints is None else stops.joints
        indices = []  # in q and in dq
        for name in names:
            if name not in body_by_joint:
                raise UnknownNameError.from_choices("joint with one degree of freedom", name, body_by_joint)
            body = body_by_joint[name]
            if has_limit[body.v_index]:
                indices.append((body.q_index, body.v_index))
        if not indices:
            raise ValueRangeError(f"robot {robot.name!r} has no limits of position there, so JointStops has no stops.")
        self.stops = stops
        self.indices = tuple(indices)
        """Indices in q and in dq of each joint that has stops."""
        law = np.array([stops.stiffness, stops.dissipation], float)
        v_indices = [v_index for _, v_index in indices]
        numbers = {"lower": limits.lower[v_indices], "upper": limits.upper[v_indices], "law": law}
        super().__init__(robot, "a joint touches its stop", (self.indices, stops.exponent), len(indices), numbers)

    def symbolic_torques(self, _model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """Joint torques and penetrations by :func:`.stop_contact`."""
        lower, upper, law = numbers
        return stop_contact(q, dq, self.indices, self.stops.exponent, lower, upper, law)
