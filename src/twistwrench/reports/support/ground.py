"""Ground under a robot: its contacts as a user names them, and which of them carry at each instant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.arguments import parse_numbers
from ...core.errors import UnknownNameError, ValueRangeError
from ...core.text import Argument
from ...core.typing import Array
from ...mechanics.model.joining import with_free_base
from ...mechanics.model.model import BASE
from ...robot import Robot
from ...statics.contacts import Contact, contact_maps
from ...statics.feet import find_feet, sole, upward, wheel
from ...statics.torque_limits import floating_entries

if TYPE_CHECKING:
    from ...motion.differentiation import MotionSamples

FeetGiven: TypeAlias = "str | Sequence[str | Contact]"
"""Frames, rectangles ``"LxW[,x,y,z]@FRAME"``, contacts, or "auto"."""
FramesGiven: TypeAlias = "str | Sequence[str]"
"""A frame, or several."""
FrictionGiven: TypeAlias = "float | Mapping[str, float]"
"""One coefficient of friction for all frames, or one for each frame."""
ContactSource = Literal["auto", "log"]
"""Source of the contacts that carry: heights and speeds, or columns ``FRAME.contact`` of the log."""
InContactGiven: TypeAlias = "ContactSource | Mapping[str, str | ArrayLike]"
"""A source for all feet; or for each foot a column of the log, or a value for each row of the log."""

ASSUMED_FRICTION = 0.3
"""Coefficient of friction that dry ground has.

If a robot needs at most this friction, the report states it as a condition; if it needs more, the verdict is UNSURE.
"""
UNLIMITED_FRICTION = 10.0
"""Coefficient of friction that counts as unlimited."""
_MAX_HEIGHT = 0.01
"""Height above the lowest contact up to which a contact carries [m]."""
MAX_CARRYING_SPEED = 0.05
"""Speed up to which a contact carries [m/s]."""
_MIN_ALIGNMENT = math.cos(math.radians(1.0))
"""Least cosine of the angle between a contact's normal and the ground's normal or the vertical, for a contact on the ground."""
AUTO = "auto"
"""Word for feet that are found by the geometry of the robot."""
_ROUND_OFF = 1e-12
"""Difference up to which times are equal [s]."""


@dataclass(frozen=True, eq=False)
class ContactSchedule:
    """Contacts that carry at each instant, from a log."""

    time: Array
    """Times (n,) of the rows [s]."""
    carries: Array
    """Mask (n, c) of the contacts that carry."""

    def at(self, time: Array) -> Array:
        """Mask (m, c) of the contacts that carry at times (m,), by the last row at or before each time."""
        last_rows = np.searchsorted(self.time, time + _ROUND_OFF, side="right") - 1
        known_rows = np.clip(last_rows, 0, len(self.time) - 1)  # the first row also holds before it
        return np.asarray(self.carries[known_rows])


@dataclass(frozen=True, eq=False)
class Ground:
    """Contacts of a robot with a free base, and the rule that decides which of them carry."""

    contacts: tuple[Contact, ...]
    """Contacts with their coefficients of friction, :data:`ASSUMED_FRICTION` where none is given."""
    given: bool
    """True if the user gives the coefficients of friction."""
    automatic: tuple[bool, ...]
    """For each contact: True if it carries when it is low and slow, as a foot; False if it always carries, as a wheel."""
    on_ground: Array
    """(c,) of bool: False for contacts with another normal, such as a hand on a wall or a magnet at a ceiling."""
    normal: Array
    """(3,): unit normal of the ground in the base frame, along which heights are measured."""
    normal_given: bool = False
    """True if the user states the normal; heights of the contacts are then not a reason to doubt it."""
    schedule: ContactSchedule | None = None
    """Contacts that carry according to the log, instead of the rule of ``automatic``; None if it has none."""

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Distinct frames in contact, in the order of the contacts."""
        return tuple(dict.fromkeys(str(contact.frame) for contact in self.contacts))

    @cached_property
    def normals(self) -> Array:
        """(c, 3): unit normals of the contacts in the base frame."""
        return np.array([contact.normal for contact in self.contacts])

    @cached_property
    def frictions(self) -> Array:
        """(c,): coefficients of friction of the contacts."""
        return np.array([contact.friction for contact in self.contacts])

    @cached_property
    def unlimited_contacts(self) -> tuple[Contact, ...]:
        """The contacts on ground of unlimited friction; contacts without friction stay without it."""
        contacts = list(self.contacts)
        for k in np.flatnonzero(self.frictions > 0):
            contacts[k] = replace(contacts[k], friction=UNLIMITED_FRICTION)
        return tuple(contacts)

    @property
    def feet(self) -> dict[str, Array]:
        """Points (k, 3) of each foot, by its frame, without wheels."""
        points_by_frame: dict[str, list[Array]] = {}
        for contact, is_foot in zip(self.contacts, self.automatic, strict=True):
            if is_foot:
                frame_points = points_by_frame.setdefault(str(contact.frame), [])
                frame_points.append(contact.point)
        return {frame: np.array(points) for frame, points in points_by_frame.items()}

    def contacts_at(self, frame: str) -> Array:
        """Indices of the contacts at a frame."""
        return np.array([k for k, contact in enumerate(self.contacts) if contact.frame == frame])

    def carrying(self, robot: Robot, states: MotionSamples) -> Array:
        """Mask (n, c) of the contacts that carry in each state.

        Without a schedule, a foot carries if it is near the height of the lowest contact and slow; other contacts always carry.
        """
        if self.schedule is not None:
            return self.schedule.at(states.time)
        if not any(self.automatic):
            return np.ones((len(states), len(self.contacts)), bool)
        points, velocities = self.points_and_velocities(robot, states)
        is_slow = np.linalg.norm(velocities, axis=-1) < MAX_CARRYING_SPEED
        heights = points @ self.normal
        lowest = heights[:, self.on_ground].min(axis=1, keepdims=True)
        is_low = heights <= lowest + _MAX_HEIGHT
        always_carries = ~np.array(self.automatic)
        return np.asarray((is_low & is_slow) | always_carries)

    def points_and_velocities(self, robot: Robot, states: MotionSamples) -> tuple[Array, Array]:
        """Points of the contacts in the base frame, and their velocities, (n, c, 3) each."""
        maps, points = contact_maps(robot, states.q, self.contacts)
        return points, np.einsum("nvck,nv->nck", maps, states.dq)


class GroundGiven(NamedTuple):
    """Feet and wheels on the ground, as a user gives them."""

    feet: FeetGiven = ()
    """Frames, rectangles or contacts of the feet, or "auto"."""
    wheels: FramesGiven = ()
    """Frames at the centres of wheels."""
    casters: FramesGiven = ()
    """Frames at the centres of casters, which have no friction."""
    friction: FrictionGiven | None = None
    """Coefficient of friction; None if it is not known."""
    in_contact: InContactGiven = "auto"
    """Source of the contacts that carry at each instant."""
    normal: ArrayLike | None = None
    """Normal (3,) of the ground in the base frame; None for the vertical axis."""

    @classmethod
    def of(
        cls,
        feet: FeetGiven | None,
        wheels: FramesGiven | None,
        casters: FramesGiven | None,
        friction: FrictionGiven | None,
        in_contact: InContactGiven = "auto",
        normal: ArrayLike | None = None,
    ) -> GroundGiven | None:
        """Feet and wheels; None if there are none. Raises ValueRangeError if only properties of the ground are given."""
        if feet is not None or wheels is not None or casters is not None:
            return cls(feet or (), wheels or (), casters or (), friction, in_contact, normal)
        if friction is not None or normal is not None:
            property_name = "contact_normal" if friction is None else "contact_friction"
            raise ValueRangeError(
                "{0} is of the ground, and nothing stands on it. Add {1}, or wheels; friction of the joints is in the "
                "robot's file.",
                Argument(property_name),
                Argument("feet", AUTO),
            )
        return None


def with_base_free(robot: Robot) -> Robot:
    """Robot whose base floats; raises ValueRangeError if its file or the user fixes the base."""
    degrees_of_freedom = int(floating_entries(robot).sum())  # of the base
    if degrees_of_freedom >= 6:  # floats freely
        return robot
    if degrees_of_freedom > 0:
        joint = next(body.joint for body in robot.model.leaders if not body.joint.driven)
        raise _partly_free_base(robot, joint.name, joint.kind)
    for body in robot.model.leaders:
        if body.parent == BASE and body.joint.nv > 1:
            raise _partly_free_base(robot, body.joint.name, body.joint.kind)
    if robot.model.mounted:
        raise ValueRangeError(
            f"feet and wheels carry a free base, and that of robot {robot.name!r} is fixed, by a joint of its file to the "
            "world or by the option that fixes it. Leave that out, or give another file."
        )
    return Robot(with_free_base(robot.model))


def _partly_free_base(robot: Robot, joint: str, kind: str) -> ValueRangeError:
    """Error for a base that moves by a joint with fewer than six degrees of freedom."""
    return ValueRangeError(
        f"feet and wheels carry a free base, and the file of robot {robot.name!r} lets it move by the {kind} joint {joint!r} "
        "alone. Lock that joint, {0}, or give another file.",
        Argument("lock", {joint: 0}),
    )


def ground_of(robot: Robot, given: GroundGiven, q: Array | None) -> Ground:
    """Ground of a robot with a free base from the options of a user; ``q`` (nq,) is a configuration in which it stands."""
    entries = _feet(robot, given.feet)
    normal = _normal(robot, given.normal)
    feet = list[Contact]()
    for entry in entries:
        feet += _contacts(robot, entry, q, normal)
    wheels = _wheels(robot, given.wheels, ASSUMED_FRICTION, "wheels", normal)
    casters = _wheels(robot, given.casters, 0.0, "casters", normal)
    with_friction = [*feet, *wheels]
    if not with_friction and not casters:
        raise ValueRangeError("{0} is empty. Name the frames that stand on the ground.", Argument("feet"))
    friction_given = given.friction is not None
    if given.friction is not None:
        with_friction = _set_friction(with_friction, given.friction)
    elif not wheels:  # a given Contact has its own friction, frames and rectangles have the assumed one
        friction_given = all(isinstance(entry, Contact) for entry in entries)
    contacts = (*with_friction, *casters)
    ground_normals = np.stack([normal, upward(robot)])  # (2, 3)
    contact_normals = [contact.normal for contact in contacts]
    alignments = [float((ground_normals @ contact_normal).max()) for contact_normal in contact_normals]
    on_ground = np.array(alignments) > _MIN_ALIGNMENT
    automatic = on_ground.copy()
    automatic[len(feet) :] = False  # wheels and casters
    return Ground(
        contacts,
        given=friction_given,
        automatic=tuple(automatic.tolist()),
        on_ground=on_ground,
        normal=normal,
        normal_given=given.normal is not None,
    )


def _set_friction(contacts: list[Contact], given: FrictionGiven) -> list[Contact]:
    """Contacts with the coefficients of friction of their frames, or with one coefficient for all."""
    frames = sorted({str(contact.frame) for contact in contacts})
    coefficients = given if isinstance(given, Mapping) else dict.fromkeys(frames, given)
    for frame in coefficients:
        if frame not in frames:
            raise UnknownNameError.from_choices("frame in contact", frame, frames)
    for frame in frames:
        if frame not in coefficients:
            raise ValueRangeError(
                f"{{0}} has no coefficient for {frame!r}. Give one for each frame, or one number.",
                Argument("contact_friction"),
            )
    friction_by_frame = {frame: _coefficient(value) for frame, value in coefficients.items()}
    return [replace(contact, friction=friction_by_frame[str(contact.frame)]) for contact in contacts]


def _normal(robot: Robot, given: ArrayLike | None) -> Array:
    """Unit normal (3,) of the ground: along the given vector, or the world's vertical axis without one."""
    if given is None:
        return upward(robot)
    vector = arguments.one(given, "contact_normal", 3)
    normal = arguments.finite(vector, "contact_normal", 3)
    length = float(np.linalg.norm(normal))
    if length == 0:
        raise ValueRangeError(
            "{0} has no length. Give the direction away from the ground, such as 0,0,1.", Argument("contact_normal")
        )
    return np.asarray(normal / length)


def _wheels(robot: Robot, given: FramesGiven, friction: float, option: str, normal: Array) -> list[Contact]:
    """Contacts of wheels or casters at one frame or several; ``option`` names the argument in errors."""
    frames = [given] if isinstance(given, str) else given
    return [_wheel(robot, frame, friction, option, normal) for frame in frames]


def _wheel(robot: Robot, frame: str, friction: float, option: str, normal: Array) -> Contact:
    """Contact of a wheel or caster at a frame; raises ValueRangeError or UnknownNameError for other frames."""
    if "@" in frame and frame not in robot.model.all_frames:
        raise ValueRangeError(
            f"{{0}}: {frame!r} is not a frame. Wheels and casters touch the ground at a point of each frame; a rectangle, "
            "LENGTHxWIDTH@FRAME, is of {1}.",
            Argument(option),
            Argument("feet"),
        )
    _check_frame(robot, frame, option)
    return wheel(robot, frame, friction, normal=normal)


def _coefficient(value: Any) -> float:
    """Coefficient of friction; raises ValueRangeError for other input."""
    try:
        mu = float(value)
    except (TypeError, ValueError):
        mu = np.nan  # fails the test below
    if not 0 <= mu < np.inf:
        raise ValueRangeError(
            f"{{0}} is {value!r}. Give a coefficient of at least zero, such as 0.7 for rubber on concrete.",
            Argument("contact_friction"),
        )
    return mu


def _feet(robot: Robot, given: FeetGiven) -> list[str | Contact]:
    """Frames, rectangles or contacts of the feet; for "auto", the frames that are found."""
    entries: list[str | Contact] = [given] if isinstance(given, str | Contact) else list(given)
    if entries != [AUTO]:
        return entries
    feet = find_feet(robot)
    if not feet:
        raise ValueRangeError(
            f"no legs are found on robot {robot.name!r}: at least two branches that reach the lowest frames well below the "
            "base. Name the frames that stand on the ground, {0}.",
            Argument("feet", ["FRAME", "FRAME"]),
        )
    return list(feet)


def _contacts(robot: Robot, foot: str | Contact, q: Array | None, normal: Array) -> tuple[Contact, ...]:
    """Contacts of a foot: a given contact, the corners of a rectangle, or the sole that is found at a frame."""
    if isinstance(foot, Contact):
        if foot.frame is None:
            raise ValueRangeError(f"{{0}}: {foot!r} has no frame. Give the link that it is on.", Argument("feet"))
        _check_frame(robot, foot.frame, "feet")
        return (foot,)
    rectangle, at_sign, frame = foot.rpartition("@")
    if at_sign and frame in robot.model.all_frames:
        comma_separated = rectangle.replace("x", ",")
        numbers = parse_numbers(comma_separated, "feet", _FORM, 2, 5)  # two sides, or also three coordinates
        size = numbers[:2]
        middle = numbers[2:] or (0.0, 0.0, 0.0)  # in the frame [m]
        _check_frame(robot, frame, "feet")
        return sole(robot, frame, ASSUMED_FRICTION, size, middle, normal=normal)
    _check_frame(robot, foot, "feet")
    return sole(robot, foot, ASSUMED_FRICTION, q=q, normal=normal)


_FORM = "a frame, LENGTHxWIDTH[,x,y,z]@FRAME in metres such as 0.2x0.1@left_ankle, or auto"
"""Allowed forms of a foot, for messages."""


def _check_frame(robot: Robot, frame: str, option: str) -> None:
    """Raise UnknownNameError for an unknown frame, and ValueRangeError for a frame that is fixed to the world."""
    frames = robot.model.all_frames
    if frame not in frames:
        raise UnknownNameError.from_choices(f"frame of {option}", frame, frames)
    if frames[frame].body == BASE:
        raise ValueRangeError(f"{{0}}: {frame!r} is fixed to the world. Name frames of the robot.", Argument(option))
