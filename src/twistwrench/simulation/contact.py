"""Compliant contacts with a plane and with joint stops, damped by the law of Hunt and Crossley, and their durations.

Where a point is a depth d > 0 inside, and sinks in at the rate d', it is pushed out with

    f = k dⁿ max(0, 1 + c d')

The force begins and ends at zero and never pulls. Of the speed v of an impact the part e comes back,

    c v - ln(1 + c v) = -c e v - ln(1 - c e v),      e ≈ 1 - ⅔ c v for slow ones,

whatever k, n and the mass, while no other force matters. Source: Hunt and Crossley, "Coefficient of restitution interpreted as
damping in vibroimpact", J. Applied Mechanics 42, 1975; the equation for e is the energy integral of the law.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..algorithms.contact import plane_contact, stop_contact
from ..core import arguments
from ..core.arguments import positive
from ..core.numbers import printed
from ..errors import ShapeError, UnknownNameError, ValueRangeError
from ..ir.tracer import trace
from ..model.model import Model
from ..robot.engine import compiled
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True)
class Plane:
    """Contact plane n·x = height that points of one frame run into; ``docs/simulation.md`` has the law.

    Along the plane a point sliding at v is held back by ``friction f v / √(|v|² + slip²)``: Coulomb's law, except that
    it creeps where it would stick, at up to the speed ``slip``.

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
    """Compliant joint stops at the position limits of the joints of one degree of freedom, by the law of :class:`Plane`."""

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


# ── Contact durations in steps: contacts shorter than a step are not resolved

_FEW = 2
"""Ends of steps in a row at which a contact that is too short is closed, at most."""


class ContactDurations:
    """The contacts of a run, step by step."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._closed = np.zeros(len(self.names), bool)
        self._since = np.zeros(len(self.names), int)
        """The end of a step at which each contact closed last, counted from the beginning."""
        self._worked = False
        self._steps = 0
        self.short = 0
        """Number of contacts that began and ended within three steps."""
        self.first = ""
        """The first of them, and when."""

    def step(self, t: float, gaps: Sequence[float], *, worked: bool) -> bool:
        """Take note of a step that ends at t: the gaps then, and whether contacts did work in it; whether that is new."""
        return bool(self.block(np.array([t]), np.array([gaps], float), np.array([worked]))[0])

    def block(self, times: Array, gaps: Array, worked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Record m steps that end at times (m,) with gaps (m, contacts); True if a contact changes, (m,)."""
        if not self.names:
            return np.zeros(len(times), bool)
        closed = np.concatenate([self._closed[None], gaps < 0.0])
        works = np.concatenate([[self._worked], worked])
        changed = (closed[1:] != closed[:-1]).any(axis=1) | (works[1:] != works[:-1])
        for k in np.flatnonzero(changed).tolist():
            t, before, now = float(times[k]), closed[k], closed[k + 1]
            step = self._steps + k + 1
            for j in np.flatnonzero(before & ~now).tolist():
                if step - self._since[j] <= _FEW:
                    self._short(self.names[j], t)
            self._since[now & ~before] = step
            if works[k + 1] and not works[k] and not before.any() and not now.any():
                self._short("a contact", t)
        self._closed, self._worked, self._steps = closed[-1], bool(works[-1]), self._steps + len(times)
        return np.asarray(changed)

    def remark(self, h: float) -> str:
        """Remark on contacts for which steps of h are too long; empty if there are none."""
        if not self.short:
            return ""
        times = "once" if self.short == 1 else f"{self.short} times"
        return (
            f"{times} a contact was over within three steps of {printed(h, 3)} s, which is too short to be computed; the "
            f"first was {self.first}: take a smaller dt"
        )

    def _short(self, name: str, t: float) -> None:
        self.short += 1
        self.first = self.first or f"{name!r} before {printed(t)} s"


# ── Contacts of a robot: traced law and its parameters

_PRESSED = 3.0
"""Multiple of the robot's weight on a point at the start from which the point counts as buried."""
_NOTHING = 1e-9
"""Force that counts as zero, for robots without weight [N]."""


class RobotContact(ABC):
    """A robot and what it runs into."""

    def __init__(
        self, robot: Robot, name: str, key: tuple[Any, ...], size: int, numbers: dict[str, Array], **parts: Array
    ) -> None:
        self.robot, self.name, self.size, self.numbers = robot, name, size, numbers
        """The name is that of the event with which it begins, the size counts its points or joints; inputs of its program
        besides the state, by name, (...) each."""
        self.key = (type(self).__name__, size, *key)
        """Contacts of one robot with one key are one program."""
        self.parts = {**numbers, **parts}
        """Inputs in parts (m, ...) that are evaluated as a batch, and whose torques add up."""

    @abstractmethod
    def traced(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """On symbols, what it does to the joints, (nv,), and how deep each of its points or joints is inside, (m,)."""

    def touched(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Torques on the joints (..., nv), and penetration of each point or joint (..., m)."""
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
        return np.asarray(-self.touched(q, np.zeros(self.robot.nv))[1].max(axis=-1))

    def torques(self, q: Array, dq: Array) -> Array | None:
        """Torques on the joints, (..., nv); None without contact."""
        tau, depths = self.touched(q, dq)
        return tau if (depths > 0.0).any() else None

    @cached_property
    def _kernel(self) -> Any:
        robot = self.robot

        def build() -> Any:
            rest = [(name, x.shape[-1:]) for name, x in self.parts.items()]
            inputs = [("q", (robot.nq,)), ("dq", (robot.nv,)), *rest]
            program = trace(partial(self.traced, robot.model), inputs, ["tau", "depths"])
            return compiled(program, "contact", f"What a contact does to {robot.name}, compiled.")

        return robot.engine.cached(("contact", *self.key), build)


class PlaneContact(RobotContact):
    """A plane and the robot that runs into it."""

    def __init__(self, robot: Robot, plane: Plane) -> None:
        robot.model.frame(plane.frame)
        points = np.asarray(plane.points)
        law = np.array((plane.height, plane.stiffness, plane.dissipation, plane.friction, plane.slip), float)
        numbers = {"points": points.ravel(), "normal": np.asarray(plane.normal), "law": law}
        key = plane.frame, plane.exponent
        super().__init__(robot, f"{plane.frame} touches the plane", key, len(points), numbers, points=points)
        self.plane = plane

    def traced(self, model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """By :func:`.plane_contact`."""
        points, normal, law = numbers
        return plane_contact(model, q, dq, self.plane.frame, self.plane.exponent, points.reshape(-1, 3), normal, law)

    def buried(self, q: Array) -> str:
        """Remark on a start with a point deeper inside than the robot's weight presses it; empty if there is none."""
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


class StopContact(RobotContact):
    """Joint stops and the robot that has them."""

    def __init__(self, robot: Robot, stops: JointStops) -> None:
        limits, known = robot.limits, {b.joint.name: b for b in robot.model.leaders if b.joint.nv == 1}
        names = known if stops.joints is None else stops.joints
        for name in names:
            if name not in known:
                raise UnknownNameError.from_choices("joint with one degree of freedom", name, known)
        rows = [(known[n].q_index, known[n].v_index) for n in names]
        rows = [(i, k) for i, k in rows if np.isfinite(limits.lower[k]) or np.isfinite(limits.upper[k])]
        if not rows:
            raise ValueRangeError(f"robot {robot.name!r} has no limits of position there, so JointStops has no stops.")
        self.stops, self.places, mine = stops, tuple(rows), [k for _, k in rows]
        """The places are those in q and in dq, of the joints that have stops."""
        law = np.array([stops.stiffness, stops.dissipation], float)
        numbers = {"lower": limits.lower[mine], "upper": limits.upper[mine], "law": law}
        super().__init__(robot, "a joint touches its stop", (self.places, stops.exponent), len(rows), numbers)

    def traced(self, _model: Model, q: Array, dq: Array, /, *numbers: Array) -> tuple[Array, Array]:
        """By :func:`.stop_contact`."""
        lower, upper, law = numbers
        return stop_contact(q, dq, self.places, self.stops.exponent, lower, upper, law)
