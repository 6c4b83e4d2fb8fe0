"""What a robot carries and what pushes on it, and the split of its torques into their causes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..algorithms.motor_side import MotorLoads, motor_loads
from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import number, printed
from ..errors import ValueRangeError
from ..model.mimic import follower_torques
from ..model.model import BASE
from ..motion.complete_states import States
from ..typing import Array

if TYPE_CHECKING:
    from ..model.model import Model
    from ..robot import Robot
    from ..robot.explanation import Explanation

TERMS = ("inertia", "coriolis", "gravity", "spring", "payload", "wrench", "friction")
"""The causes of a torque: M ddq, c, g, springs, all of the payload's, wrenches' -J' F_on, joint friction and damping."""
_LABELS = {"coriolis": "Coriolis", "wrench": "ext. wrench"}

STEADY = ("gravity", "spring", "wrench", "friction")
"""Those that follow from positions and velocities, and so hardly from noise."""


def cause_label(term: str) -> str:
    """How a term of the torque is called in print.

    >>> cause_label("coriolis")
    'Coriolis'
    """
    return _LABELS.get(term, term)


_NO_LEVER = 1e-6
"""Share of reach times gravity below which a torque per kilogram is that of a rounded angle."""


def least_torque_per_kilogram(model: Model) -> float:
    """Torque of a kilogram [N m/kg] below which a joint does not carry it: 1e-6 of the robot's reach times gravity."""
    most = reach(model)
    return _NO_LEVER * float(np.linalg.norm(model.gravity)) * (most if 0 < most < np.inf else 1.0)


@dataclass(frozen=True, eq=False)
class Payload:
    """A point mass [kg] at a place (3,) [m] of a frame; the robot's tip if the frame is None."""

    mass: float
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: str | None = None


@dataclass(frozen=True, eq=False)
class LoadedRobot:
    """A robot, the same robot carrying its payloads, and the wrenches (6,) on frames, each expressed in its frame."""

    bare: Robot
    payloads: tuple[Payload, ...] = ()
    wrenches: dict[str, Array] = field(default_factory=dict)
    friction: bool = True
    """Whether the torques of joint friction and damping count."""
    loaded: Robot = field(init=False)
    """The robot with its payloads."""

    def __post_init__(self) -> None:
        robot = self.bare
        for load in self.payloads:
            frame = robot.model.tip if load.frame is None else load.frame
            robot.model.frame(frame)  # refuses unknown frames, and a missing tip, by name
            robot = robot.with_payload(SpatialInertia.from_com(load.mass, load.place), frame=frame)
        for frame in self.wrenches:
            robot.model.frame(frame)
        object.__setattr__(self, "loaded", robot)

    @property
    def contradictions(self) -> tuple[str, ...]:
        """A sentence for each payload that is farther from its frame than the robot reaches."""
        model, found = self.bare.model, []
        most = reach(model)
        for p in self.payloads:
            distance = float(np.linalg.norm(p.place))
            if distance > most > 0:
                found.append(
                    f"the payload of {printed(p.mass)} kg lies {number(distance)} m from {p.frame or model.tip}, and the robot "
                    f"reaches {number(most, 3)} m: offsets are in metres"
                )
        return tuple(found)

    def torques(self, s: States) -> Array:
        """Inverse dynamics with everything included; (n,) states → (n, nv)."""
        tau = self.loaded.inverse_dynamics(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        return np.asarray(tau + self._friction(s, tau) if self.friction else tau)

    def follower_torques(self, s: States) -> Array:
        """What mimic joints with a limit of effort bear, (n, k), friction left out."""
        F = self.loaded.joint_wrenches(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        return follower_torques(self.loaded.model, np.asarray(F))

    def _wrenches(self, s: States) -> dict[str, Array] | None:
        return {frame: np.broadcast_to(F, (len(s), 6)) for frame, F in self.wrenches.items()} or None

    @property
    def carries(self) -> bool:
        """Whether it carries or is pushed by anything."""
        return bool(self.payloads or self.wrenches)

    def unloaded_torques(self, s: States) -> Array:
        """As :meth:`torques`, of the robot that carries nothing and is not pushed."""
        tau = self.bare.inverse_dynamics(s.q, s.dq, s.ddq)
        return np.asarray(tau + self._friction(s, tau) if self.friction else tau)

    def terms(self, s: States) -> dict[str, Array]:
        """The causes, (n, nv) each, in the order of :data:`TERMS`; they add up to :meth:`torques`."""
        bare, zero = self.bare, np.zeros_like(s.dq)
        gravity = np.asarray(bare.gravity_forces(s.q))
        wrench = zero.copy()
        for frame, F in self.wrenches.items():  # what the robot must apply to the world is -F
            wrench += bare.wrench_torques(s.q, np.broadcast_to(-F, (len(s), 6)), frame)
        terms = {
            "inertia": bare.inverse_dynamics(s.q, zero, s.ddq) - bare.bias_forces(s.q, zero),
            "coriolis": np.asarray(bare.coriolis_forces(s.q, s.dq)),
            "gravity": gravity,
            "spring": bare.bias_forces(s.q, zero) - gravity if bare.model.springs else zero,
            "payload": self.payload_torques(s) if self.payloads else zero,
            "wrench": wrench,
        }
        tau = np.sum(list(terms.values()), axis=0)
        return {**terms, "friction": self._friction(s, tau) if self.friction else zero}

    def explain(self, s: States) -> Explanation:
        """The torques of one state by link and by term, friction as in :meth:`terms`."""
        why = self.loaded.explain(s.q, s.dq, s.ddq, wrench_on_robot=self.wrenches or None, friction=False)
        return why.and_also("friction", self._friction(s, why.torque)) if self.friction else why

    def motor_loads(self, s: States) -> MotorLoads:
        """What the motors of the robot and its payloads must give; (n, actuators) each."""
        carried, rotor = self.loaded.drive_torques(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        friction = self._friction(s, carried + rotor) if self.friction else 0.0
        moving = np.where(s.still, 0.0, s.dq)  # at rest, noise must not say which way power goes through a gear
        return motor_loads(self.loaded.model, moving, carried + friction, rotor)

    def _friction(self, s: States, carried: Array) -> Array:
        """Of joints that carry these torques; viscous alone where the sign of the velocity is unknown."""
        moving = np.where(s.still, 0.0, s.dq)
        tau = np.broadcast_to(self.bare.friction_forces(moving, load=carried), s.dq.shape)
        return np.asarray(tau + self.bare.model.friction.viscous * (s.dq - moving))

    def payload_torques(self, s: States) -> Array:
        """What the payloads add to the torques; (n, nv)."""
        return np.asarray(self.loaded.inverse_dynamics(s.q, s.dq, s.ddq) - self.bare.inverse_dynamics(s.q, s.dq, s.ddq))

    def follower_payload_torques(self, s: States) -> Array:
        """What the payloads add to :meth:`follower_torques`; (n, k)."""
        F, alone = (np.asarray(robot.joint_wrenches(s.q, s.dq, s.ddq)) for robot in (self.loaded, self.bare))
        return follower_torques(self.bare.model, F - alone)


def reach(model: Model) -> float:
    """Farthest that any frame can be from the base [m], all links stretched; inf with a joint that slides without end.

    Of a base that moves freely it is what the robot reaches from there.
    """
    lengths: list[float] = []
    for body in model.bodies:
        slides = any(not axis[:3].any() for axis in body.joint.axes)
        travel = 0.0
        if slides and body.joint.nv == 1:
            k = body.v_index
            travel = abs(body.ratio) * float(np.maximum(np.abs(model.limits.lower[k]), np.abs(model.limits.upper[k])))
        before = 0.0 if body.parent == BASE else lengths[body.parent]
        lengths.append(before + float(np.linalg.norm(body.placement[:3, 3])) + travel)
    ends = [
        (0.0 if frame.body == BASE else lengths[frame.body]) + float(np.linalg.norm(frame.pose[:3, 3]))
        for frame in model.frames.values()
    ]
    return max(ends, default=0.0)


def parse_payload(text: str, tip: str | None = None) -> Payload:
    """Read ``MASS[,x,y,z][@FRAME]``, at the ``tip`` asked for if it names no frame.

    Raises :class:`~twistwrench.ValueRangeError`, which shows the form.
    """
    numbers, _, frame = text.partition("@")
    form = "MASS[,x,y,z][@FRAME], for example 5 or 2.5,0,0,0.08@tool0"
    values = _numbers(numbers, f"payload {text!r}", form)
    if len(values) not in (1, 4):
        raise ValueRangeError(f"payload {text!r} has {len(values)} numbers. Write {form}.")
    if values[0] < 0:
        raise ValueRangeError(f"payload {text!r} has a negative mass. Give kilograms, at least 0: {form}.")
    if "@" in text and not frame.strip():
        raise ValueRangeError(f"payload {text!r} names no frame after '@'. Write {form}.")
    x, y, z = values[1:] or (0.0, 0.0, 0.0)
    return Payload(values[0], (x, y, z), frame.strip() or tip)


def parse_wrenches(texts: Iterable[str]) -> dict[str, Array]:
    """Read ``FRAME:m,m,m,f,f,f`` each, adding up those on one frame.

    Raises :class:`~twistwrench.ValueRangeError`, which shows the form.
    """
    found: dict[str, Array] = {}
    for text in texts:
        frame, values = _parse_wrench(text)
        found[frame] = found.get(frame, 0.0) + values
    return found


def _parse_wrench(text: str) -> tuple[str, Array]:
    frame, colon, numbers = text.rpartition(":")
    form = "FRAME:m,m,m,f,f,f (moment, then force, in that frame), for example tool0:0,0,0,0,0,-20"
    if not colon and text.strip() and "," not in text:
        raise ValueRangeError(f"wrench {text!r} lacks the numbers after the frame. Write {form}.")
    if not colon or not frame.strip():
        raise ValueRangeError(f"wrench {text!r} names no frame. Write {form}.")
    values = _numbers(numbers, f"wrench {text!r}", form)
    if len(values) != 6:
        raise ValueRangeError(f"wrench {text!r} has {len(values)} numbers, not 6. Write {form}.")
    return frame.strip(), np.array(values)


def _numbers(text: str, what: str, form: str) -> Sequence[float]:
    found = []
    for field_ in text.split(","):
        try:
            value = float(field_)
        except ValueError:
            raise ValueRangeError(f"{what}: {field_.strip()!r} is no number. Write {form}.") from None
        if not np.isfinite(value):
            raise ValueRangeError(f"{what}: {field_.strip()!r} is not finite. Write {form}.")
        found.append(value)
    return found
