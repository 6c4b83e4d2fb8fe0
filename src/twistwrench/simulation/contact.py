"""What a robot runs into: a plane, and the stops of its joints. Compliant, and dissipating as Hunt and Crossley say.

Where a point is a depth d > 0 inside, and sinks in at the rate d', it is pushed out with

    f = k dⁿ max(0, 1 + c d')

The force begins and ends at zero and never pulls. Of the speed v of an impact the part e comes back,

    c v - ln(1 + c v) = -c e v - ln(1 - c e v),      e ≈ 1 - ⅔ c v for slow ones,

whatever k, n and the mass, while no other force matters. Source: Hunt and Crossley, "Coefficient of restitution interpreted as
damping in vibroimpact", J. Applied Mechanics 42, 1975; the equation for e is the energy integral of the law.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import positive
from ..errors import ShapeError, UnknownNameError, ValueRangeError
from ..lie import so3
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


_PRESSED = 3.0
"""Times the robot's weight that presses a point in: more at the start is no robot that stands or lands there."""
_NOTHING = 1e-9
"""N: what is no force, for robots without weight."""


@dataclass(frozen=True)
class Plane:
    """Contact plane n·x = height that points of one frame run into; ``docs/simulation.md`` has the law.

    Along the plane a point sliding at v is held back by ``friction f v / √(|v|² + slip²)``: Coulomb's law, except that
    it creeps where it would stick, at up to the speed ``slip``.

    Raises
    ------
    ShapeError, ValueRangeError
        An argument is of another size or not finite.

    Examples
    --------
    >>> ground = Plane("box", points=[[0.1, 0, 0], [-0.1, 0, 0]], stiffness=1e5, dissipation=0.5, friction=0.8)
    >>> ground.points.shape
    (2, 3)
    """

    frame: str
    """The frame whose points run into it."""
    points: ArrayLike = (0.0, 0.0, 0.0)
    """(3,) or (n, 3), in the frame [m]."""
    normal: ArrayLike = (0.0, 0.0, 1.0)
    """(3,), in the base frame, out of the ground; any length."""
    height: float = 0.0
    """m, along the normal."""
    stiffness: float = 1e5
    """k [N/mⁿ]."""
    exponent: float = 1.5
    """n: 1.5 is Hertz's contact of round bodies."""
    dissipation: float = 0.0
    """c [s/m]: 0 gives all of the energy back."""
    friction: float = 0.0
    """Coulomb's coefficient."""
    slip: float = 1e-2
    """m/s."""

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
    """Compliant joint stops at the position limits of the joints of one degree of freedom, by the law of :class:`Plane`.

    Raises
    ------
    ValueRangeError
        A number is not finite or negative.
    """

    stiffness: float
    """k [N m/radⁿ or N/mⁿ]."""
    exponent: float = 1.5
    """n, as of a plane."""
    dissipation: float = 0.0
    """c [s/rad or s/m]."""
    joints: tuple[str, ...] | None = None
    """The joints that have them; None: all that have limits."""

    def __post_init__(self) -> None:
        _check_law("JointStops", self.stiffness, self.exponent, self.dissipation)
        given: object = self.joints
        if isinstance(given, str):
            object.__setattr__(self, "joints", (given,))


def _check_law(what: str, stiffness: float, exponent: float, dissipation: float) -> None:
    positive(stiffness, f"{what}: stiffness")
    if not 1.0 <= positive(exponent, f"{what}: exponent") <= 5.0:
        raise ValueRangeError(f"{what}: exponent is {exponent}, and must be from 1 to 5; 1.5 is Hertz's.")
    positive(dissipation, f"{what}: dissipation", zero=True)


@dataclass(frozen=True, eq=False)
class PlaneContact:
    """A plane and the robot that runs into it."""

    robot: Robot
    plane: Plane
    name: str = field(init=False)

    def __post_init__(self) -> None:
        self.robot.model.frame(self.plane.frame)
        object.__setattr__(self, "name", f"{self.plane.frame} touches the plane")

    def gap(self, q: Array) -> float:
        """How far the nearest point is from the plane, negative inside [m]."""
        return -float(self._depths(self.robot.forward_kinematics(q, self.plane.frame)).max())

    def torques(self, q: Array, dq: Array) -> Array | None:
        """J'F of what the plane does to the robot, (nv); None where they do not touch."""
        plane, frame = self.plane, self.plane.frame
        T = self.robot.forward_kinematics(q, frame)
        depth = self._depths(T)
        if not (depth > 0.0).any():
            return None
        R, p, n = T[:3, :3], np.asarray(plane.points), np.asarray(plane.normal)
        V = self.robot.frame_velocity(q, dq, frame)
        v = (V[3:] + p @ so3.hat(V[:3]).T) @ R.T  # of the points, in the base frame
        sinking = -v @ n
        pushed = _pushed(depth, sinking, plane.stiffness, plane.exponent, plane.dissipation)
        slide = v + sinking[:, None] * n
        held = plane.friction * pushed / np.sqrt(np.sum(slide * slide, axis=1) + plane.slip**2)
        f = (pushed[:, None] * n - held[:, None] * slide) @ R  # on the points, in the frame
        return self.robot.wrench_torques(q, np.concatenate([so3.cross(p, f).sum(axis=0), f.sum(axis=0)]), frame)

    def buried(self, q: Array) -> str:
        """What to say of a start with a point deeper inside than the robot's weight presses it; empty where none is."""
        plane, model = self.plane, self.robot.model
        depths = self._depths(self.robot.forward_kinematics(q, plane.frame))
        worst, weight = int(depths.argmax()), sum(b.inertia.mass for b in model.bodies) * np.linalg.norm(model.gravity)
        depth = max(float(depths[worst]), 0.0)
        if not plane.stiffness * depth**plane.exponent > max(_PRESSED * float(weight), _NOTHING):
            return ""
        stored = float(plane.stiffness * (np.maximum(depths, 0.0) ** (plane.exponent + 1)).sum() / (plane.exponent + 1))
        x, y, z = np.asarray(plane.points)[worst]
        return (
            f"point ({x:g}, {y:g}, {z:g}) of {plane.frame!r} starts {depth:.4g} m below the plane, which throws the robot out: "
            f"{stored:.3g} J are in that contact at the start. Start higher, or with the plane lower"
        )

    def _depths(self, T: Array) -> Array:
        return self.plane.height - (np.asarray(self.plane.points) @ T[:3, :3].T + T[:3, 3]) @ np.asarray(
            self.plane.normal
        )


@dataclass(frozen=True, eq=False)
class StopContact:
    """Joint stops and the robot that has them."""

    robot: Robot
    stops: JointStops
    name: str = "a joint touches its stop"
    places: tuple[Array, Array] = field(init=False)
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
        places = np.array(rows, int)
        object.__setattr__(self, "places", (places[:, 0], places[:, 1]))

    def gap(self, q: Array) -> float:
        """How far the nearest joint is from its stop, negative beyond [rad or m]."""
        over, under = self._depths(q)
        return -float(np.maximum(over, under).max())

    def torques(self, q: Array, dq: Array) -> Array | None:
        """What the stops do to the joints, (nv); None where none is touched."""
        over, under = self._depths(q)
        if not (np.maximum(over, under) > 0.0).any():
            return None
        s, rate, tau = self.stops, dq[self.places[1]], np.zeros(self.robot.nv)
        law = (s.stiffness, s.exponent, s.dissipation)
        tau[self.places[1]] = _pushed(under, -rate, *law) - _pushed(over, rate, *law)
        return tau

    def _depths(self, q: Array) -> tuple[Array, Array]:
        (i, k), limits = self.places, self.robot.limits
        return q[i] - limits.upper[k], limits.lower[k] - q[i]


Contact = PlaneContact | StopContact


def _pushed(depth: Array, sinking: Array, k: float, n: float, c: float) -> Array:
    return np.asarray(k * np.maximum(depth, 0.0) ** n * np.maximum(0.0, 1.0 + c * sinking))
