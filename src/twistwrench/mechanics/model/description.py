"""Described links and joints of a robot, each validated by itself, and notes on them."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import gaps
from ...core.errors import InertiaError, ModelError, ModelWarning
from ...core.numbers import printed
from ...core.text import listed, shorten
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import JOINT_TYPES, Fixed, Joint
from ..joints.screw_joint import number, numbers
from ..lie.identity import IDENTITY, UPRIGHT
from .limits import Limits

_MAX_LISTED_SUBJECTS = 4
"""Number of later subjects that a grouped sentence names; others are counted, and ``robot.defects`` lists all."""


class ModelNote(str):
    """Sentence with a known subject: ``ModelNote("link 'a'", "has no mass") == "link 'a' has no mass"``."""

    subject: str
    """Link, joint or other part that the note is about, as messages name it."""
    predicate: str
    """Rest of the sentence, after the subject."""

    def __new__(cls, subject: str, predicate: str) -> ModelNote:
        """Sentence of ``subject`` and ``predicate``."""
        note = super().__new__(cls, f"{subject} {predicate}")
        note.subject = subject
        note.predicate = predicate
        return note

    def __reduce__(self) -> tuple[type[ModelNote], tuple[str, str]]:
        return ModelNote, (self.subject, self.predicate)


def grouped(remarks: Iterable[str]) -> list[str]:
    """Sentences of notes, in the order of the notes; several notes with one predicate become one sentence.

    >>> grouped([ModelNote("joint 'a'", "has no limit"), "x", ModelNote("joint 'b'", "has no limit")])
    ["joint 'a' has no limit; the same of joint 'b'", 'x']
    """
    later_subjects: dict[str, list[str]] = {}  # by predicate; without the first subject
    first_remarks: list[str] = []
    for remark in remarks:
        if not isinstance(remark, ModelNote):
            later_subjects.setdefault(remark, [])
            first_remarks.append(remark)
        elif remark.predicate in later_subjects:
            later_subjects[remark.predicate].append(remark.subject)
        else:
            later_subjects[remark.predicate] = []
            first_remarks.append(remark)
    joined_remarks: list[str] = []
    for remark in first_remarks:
        sentence = str(remark)
        if isinstance(remark, ModelNote) and later_subjects[remark.predicate]:
            other_subjects = listed(later_subjects[remark.predicate], _MAX_LISTED_SUBJECTS)
            sentence += f"; the same of {other_subjects}"
        joined_remarks.append(sentence)
    return joined_remarks


def sentences(name: str, remarks: Iterable[str]) -> list[str]:
    """Texts of warnings about a robot, from its notes."""
    return [f"robot {name!r}: {text}." for text in grouped(remarks)]


def issue(texts: Iterable[str]) -> None:
    """Issue warnings that point to the user's line."""
    for text in texts:
        warnings.warn(text, ModelWarning, stacklevel=frames_to_user())


def frames_to_user() -> int:
    """Stack level of the first caller outside this package, for warnings that point to the user's line."""
    own_package, _, _ = __name__.partition(".")
    frame = sys._getframe(1)  # of the caller, which has level 1
    level = 1
    while frame.f_back is not None:
        package, _, _ = frame.f_globals.get("__name__", "").partition(".")
        if package != own_package:
            break
        frame = frame.f_back
        level += 1
    return level


# ── Described links and joints of a robot, each validated by itself

Mimic = tuple[str, float, float]
"""Leader, multiplier and offset: the joint's coordinate is multiplier * leader + offset."""

_MAX_ROW_GAP = 1e-15
"""Gap of the rows up to which R'R is certainly closer to the identity than ``_MAX_EXACT_DEVIATION``."""
_MAX_EXACT_DEVIATION = 1e-14
"""Largest entry of R'R - 1 with which R is left unchanged."""
_MAX_DEVIATION = 1e-6
"""Largest entry of R'R - 1 of a rotation that is written with six digits."""
_LAST_ROW = [0.0, 0.0, 0.0, 1.0]
"""Last row of a pose."""

TYPES: Mapping[str, type[Joint]] = {**JOINT_TYPES, Fixed.kind: Fixed}
"""Types of joints that may be described; fixed ones are removed when the model is built."""


def label(kind: str, name: str, where: str) -> str:
    """Name of a link or joint in messages, with its place in the file: ``joint 'elbow' (line 12)``."""
    if isinstance(name, str):  # validated later
        name = shorten(name)
    text = f"{kind} {name!r}"
    if where:
        text += f" ({where})"
    return text


def unused(name: str, taken: set[str]) -> str:
    """Name that is not in ``taken``, the used names, after ``_`` is appended as often as needed; it is added to ``taken``."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


@dataclass(frozen=True, eq=False)
class LinkEntry:
    """One described link."""

    name: str
    inertia: SpatialInertia
    """Inertia about the link frame's origin; zero if not given."""
    where: str
    """Place in the file, for messages; may be empty."""
    shaped: bool = False
    """True if the link has a visual or collision shape."""
    hidden: bool = False
    """True if the link only connects two joints of one body and is not offered as a frame."""

    def __str__(self) -> str:
        return label("link", self.name, self.where)


@dataclass(frozen=True, eq=False)
class JointEntry:
    """One described joint, possibly fixed."""

    joint: Joint
    parent: str  # name of a link
    child: str  # name of a link
    placement: Array
    """Pose T_parent,child (4, 4) with the joint at zero."""
    limits: Limits
    damping: float
    """Coefficient of viscous friction [N m s/rad, N s/m]."""
    friction: float
    """Dry friction [N m, N]."""
    mimic: Mimic | None  # None unless the joint follows another
    where: str
    """Place in the file, for messages; may be empty."""
    armature: float = 0.0
    """Inertia of the joint's drive, seen from the joint [kg m², kg]."""

    @property
    def name(self) -> str:
        """The joint's name."""
        return self.joint.name

    @property
    def fixed(self) -> bool:
        """True if the joint is fixed."""
        return self.joint.nv == 0

    def __str__(self) -> str:
        return label("joint", self.name, self.where)


@dataclass(frozen=True, eq=False)
class SiteEntry:
    """Described frame that is not a link."""

    name: str
    link: str  # that carries the frame
    pose: Array
    """Pose in the link's frame (4, 4)."""


def link_entry(
    name: str, inertia: SpatialInertia | None, where: str, shaped: bool = False, hidden: bool = False
) -> LinkEntry:
    """Link whose inertia is finite and whose mass is not negative, since inertia policies cannot repair such errors."""
    if inertia is None:
        inertia = SpatialInertia.zero()
    link = LinkEntry(name, inertia, where, shaped, hidden)
    if not all(map(math.isfinite, link.inertia.parameters.tolist())):
        raise InertiaError(f"{link} has an inertia that is not finite, {link.inertia.parameters.tolist()}.")
    if link.inertia.mass < 0:
        raise InertiaError(
            f"{link} has a negative mass, {printed(link.inertia.mass)} kg. A mass must be zero or positive."
        )
    return link


def mimic_of(mimic: Mimic | None, who: str) -> Mimic | None:
    """Mimic entry with validated numbers; ``who`` is the joint in messages, as in the functions below."""
    if mimic is None:
        return None
    leader, multiplier, offset = mimic
    multiplier, offset = numbers([multiplier, offset], (2,), f"the mimic multiplier and offset of {who}")
    return leader, float(multiplier), float(offset)


def armature_of(armature: ArrayLike, who: str) -> float:
    """Armature of a joint, finite and nonnegative."""
    value = number(armature, f"the armature of {who}")
    if value < 0:
        raise ModelError(
            f"{who} has a negative armature, {printed(value)}. It is the inertia of the joint's drive: zero or positive."
        )
    return value


def placement_of(T: ArrayLike | None, who: str) -> Array:
    """Pose (4, 4), the identity for None; raises an error if it is not a rigid motion."""
    if T is None or T is IDENTITY:
        return IDENTITY
    T = numbers(T, (4, 4), f"the placement of {who}")
    R_rows = [row[:3] for row in T[:3].tolist()]
    has_last_row = T[3].tolist() == _LAST_ROW
    is_rotation = R_rows == UPRIGHT or max(map(abs, gaps(R_rows))) <= _MAX_ROW_GAP  # without linear algebra
    if is_rotation and has_last_row:  # the usual case
        return T
    R = T[:3, :3]
    deviation = np.abs(R.T @ R - np.eye(3)).max()
    if deviation > _MAX_DEVIATION or np.linalg.det(R) < 0 or not has_last_row:
        raise ModelError(
            f"the placement of {who} is not a pose: a rotation, a position and the last row 0 0 0 1 are required."
        )
    if deviation > _MAX_EXACT_DEVIATION:  # nearest rotation, so that the transpose is the inverse
        U, _, Vt = np.linalg.svd(R)
        T = T.copy()
        T[:3, :3] = U @ Vt
    return T


def limits_of(
    joint: Joint, lower: float | None, upper: float | None, largest: Mapping[str, float | None], who: str
) -> tuple[Limits, list[str]]:
    """Limits of a joint, (nv,) each, infinite if not given; and notes on implausible limits.

    ``largest`` are the largest magnitudes by name: of the velocity, the effort and others.
    """
    remarks: list[str] = []
    if joint.nv != 1:
        has_limits = any(limit is not None for limit in (lower, upper, *largest.values()))
        if joint.nv and has_limits:
            remarks.append(ModelNote(who, f"is {joint.kind}; limits of joints with several coordinates are not kept"))
        infinite = np.full(joint.nv, np.inf)
        return Limits(-infinite, infinite, infinite, infinite), remarks
    low, high = _position_limits(bool(joint.wraps), lower, upper, who, remarks)
    magnitudes = {}
    for name, value in largest.items():
        magnitudes[name] = np.array([_magnitude(name, value, who, remarks)])
    return Limits(np.array([low]), np.array([high]), **magnitudes), remarks


def _position_limits(
    is_continuous: bool, lower: float | None, upper: float | None, who: str, remarks: list[str]
) -> tuple[float, float]:
    """Lower and upper limit of a position, infinite where there is none; limits that are both 0 add to ``remarks``."""
    low = -np.inf if lower is None else _limit_number("lower", lower, who)
    high = np.inf if upper is None else _limit_number("upper", upper, who)
    if is_continuous:  # limits of such a joint are ignored, but must be numbers
        return -np.inf, np.inf
    if low == high == 0:
        remarks.append(ModelNote(who, "has lower = upper = 0, taken to mean that no limits are given"))
        return -np.inf, np.inf
    if low > high or low == np.inf or high == -np.inf:
        raise ModelError(
            f"{who} has reversed limits: lower={printed(low)} is above upper={printed(high)}. "
            "Exchange them, or leave both out where there are none, which some simulators mean by this."
        )
    return low, high


def _limit_number(what: str, value: float, who: str) -> float:
    """Limit as a float; raises ModelError if it is not a number."""
    try:
        value = float(value)
    except (TypeError, ValueError):
        value = math.nan
    if math.isnan(value):
        raise ModelError(
            f"{who} has {what}={value!r} as its limit; a limit is a number. Leave it out where there is none."
        )
    return value


def _magnitude(what: str, value: float | None, who: str, remarks: list[str]) -> float:
    """Limit of a magnitude, infinite if there is none; a limit of 0 adds to ``remarks``."""
    if value is None:
        return float(np.inf)
    value = _limit_number(what, value, who)
    if value < 0:
        raise ModelError(
            f"{who} has {what}={printed(value)} as its limit; a limit is a positive number. Leave it out where there is none."
        )
    if value == 0:
        remarks.append(ModelNote(who, f"has a limit {what}=0, taken to mean that none is given"))
        return float(np.inf)
    return value
