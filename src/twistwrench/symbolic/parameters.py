"""Parameters of a robot as symbols: lengths, centres of mass, masses, inertias, gravity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.errors import UnknownNameError, ValueRangeError
from ..core.typing import Array
from ..mechanics.model.couplings import refuse_couplings
from ..mechanics.model.model import BASE, Body, Model
from .names import names_of, shortest

_AXES = "xyz"
"""Letters of the coordinate axes 0, 1 and 2."""
_LENGTH_TOLERANCE = 1e-12
"""Relative difference of lengths that count as equal: a centre of mass is a quotient, with a rounding error."""
_ROUNDING_SHARE = 1e-14
"""Share of the largest entry below which an entry is a rounding error."""


@dataclass(frozen=True)
class Parameter:
    """Named number of the robot; lengths are positive, with signs in the equations."""

    name: str
    """Symbol."""
    value: float
    """Value in SI units."""
    kinds: frozenset[str]
    """Kinds: lengths, coms, masses, inertias, gravity, springs, gears."""
    meaning: str
    """Meaning as text."""


@dataclass(frozen=True)
class Entry:
    """Number of the model: ``sign * parameter`` in the equations, or the plain value without a parameter."""

    value: float
    """Value with its sign, in SI units."""
    parameter: Parameter | None = None
    """Parameter of the same size; None for a plain number."""

    @property
    def sign(self) -> int:
        """Sign of the value relative to the parameter."""
        if self.parameter is not None and self.value * self.parameter.value < 0:
            return -1
        return 1


Entries = tuple[Entry, ...]


@dataclass(frozen=True)
class BodyEntries:
    """Numbers of one body and of the joint that carries it."""

    tag: str
    """Suffix of the body's symbols: its number, or r1 for the rotor of joint 1."""
    place: Entries
    """Position of the joint in the parent's frame."""
    point: Entries
    """Point of the joint's axis in the child's frame."""
    pitch: Entry
    """Pitch of the joint."""
    mass: Entry
    com: Entries
    """Centre of mass."""
    inertia: tuple[Entries, ...]
    """Rotational inertia about the centre of mass."""
    ratio: Entry
    """Ratio of the joint's rate to the rate of its coordinate; a symbol for a gear."""


@dataclass(frozen=True)
class ModelEntries:
    """Numbers of the robot, and the parameters among them."""

    bodies: tuple[BodyEntries, ...]
    gravity: Entries
    springs: Entries
    """Stiffnesses."""
    armature: Entries
    """Drive inertias, one per velocity."""
    parameters: tuple[Parameter, ...]


class Namer:
    """Names the model's numbers body by body: L_1 for the position of the next joint, r_1 for a centre of mass."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.parameters: list[Parameter] = []
        self.tags = _tags(model)

    def entries(self) -> ModelEntries:
        """Numbers of the model, with names where they have one."""
        bodies = self.model.bodies
        body_numbers = range(BASE, len(bodies))  # the base has the number -1
        lengths_of_bodies = {i: self._lengths(i) for i in body_numbers}
        body_entries = []
        for i, body in enumerate(bodies):
            body_entries.append(self._body(i, body, lengths_of_bodies))
        gravity = []
        is_inclined = np.count_nonzero(self.model.gravity) > 1
        for axis, value in zip(_AXES, self.model.gravity, strict=True):
            name = f"g_{axis}" if is_inclined else "g"
            gravity.append(self._named_entry(name, value, "gravity", "gravity [m/s²]"))
        springs = []
        for number, spring in enumerate(self.model.springs, 1):
            joints = " and ".join(joint for joint, _ in spring.terms)
            meaning = f"stiffness between {joints} [N m/rad or N/m]"
            parameter = self._new(f"k_{number}", spring.stiffness, ["springs"], meaning)
            springs.append(Entry(spring.stiffness, parameter))
        return ModelEntries(
            tuple(body_entries), tuple(gravity), tuple(springs), self._armature(), tuple(self.parameters)
        )

    def _armature(self) -> Entries:
        """Drive inertia of each velocity, with a symbol unless it is zero."""
        refuse_couplings(self.model, "derivation of equations of motion")
        armature = [Entry(0.0)] * self.model.nv
        for number, body in enumerate(self.model.leaders, 1):
            _, columns = body.places
            values = self.model.armature[columns]
            if not values.any():
                continue
            if body.joint.nv > 1:
                raise ValueRangeError(
                    f"joint {body.joint.name!r} is {body.joint.kind} and has an armature, which equations of motion are not "
                    f"derived with. Leave it out: robot.with_armature({{{body.joint.name!r}: 0}})."
                )
            meaning = f"inertia of the drive of joint {body.joint.name} [kg m² or kg]"
            value = float(values[0])
            parameter = self._new(f"J_{number}", value, ["gears"], meaning)
            armature[body.v_index] = Entry(value, parameter)
        return tuple(armature)

    def _new(self, name: str, value: float, kinds: Iterable[str], meaning: str, *, signed: bool = False) -> Parameter:
        """New parameter of the model; its value is positive unless ``signed``."""
        if not signed:
            value = abs(value)
        parameter = Parameter(name, float(value), frozenset(kinds), meaning)
        self.parameters.append(parameter)
        return parameter

    def _named_entry(self, name: str, value: float, kind: str, meaning: str) -> Entry:
        """Entry with its own name, unless the value is zero."""
        if not value:
            return Entry(0.0)
        return Entry(float(value), self._new(name, value, [kind], meaning))

    def _lengths(self, i: int) -> dict[tuple[int, float], Parameter]:
        """Symbols of lengths of body i, by coordinate axis and size of the displacement, for its joints and its tip."""
        if i == BASE:
            com = np.zeros(3)
            frame_words = "in the base"
            tag = "0"
        else:
            body = self.model.bodies[i]
            com = body.inertia.com
            _, frame_words = self._massive_link(body)
            tag = self.tags[i]
        child_by_length: dict[tuple[int, float], str] = {}  # first child with a displacement of this axis and size
        for child, position in self._child_positions(i):
            for axis, x in enumerate(position):
                is_known = any(_is_length(axis, x, length) for length in child_by_length)
                if x and not is_known:
                    child_by_length[axis, shortest(abs(x))] = child
        lengths: dict[tuple[int, float], Parameter] = {}
        for (axis, size), child in child_by_length.items():
            name = f"L_{tag}"
            if len(child_by_length) > 1:
                name += _AXES[axis]
            earlier_lengths = [other_size for other_axis, other_size in lengths if other_axis == axis]
            if earlier_lengths:
                name += f"_{len(earlier_lengths) + 1}"
            kinds = ["lengths"]
            meaning = f"{_AXES[axis]} of {child} {frame_words}"
            if _is_length(axis, com[axis], (axis, size)):
                kinds.append("coms")
                meaning += ", and of its centre of mass"
            lengths[axis, size] = self._new(name, size, kinds, f"{meaning} [m]")
        return lengths

    def _child_positions(self, i: int) -> list[tuple[str, Array]]:
        """Words for each joint on body i and for the tip on it, with its position (3,) in the body's frame."""
        bodies = [body for body in self.model.bodies if body.parent == i]
        children = [(f"joint {body.joint.name}", body.placement[:3, 3]) for body in bodies]
        tip = self.model.all_frames.get(self.model.tip or "")
        if i != BASE and tip is not None and tip.body == i:
            children.append((f"frame {self.model.tip}", tip.pose[:3, 3]))
        return children

    def _massive_link(self, body: Body) -> tuple[str, str]:
        """Link with the mass of a body, and words for the body's frame.

        If a single other link of the body has mass, as in a robot from a DH table, the words name the joint: the user never
        named the body's frame.
        """
        inertias = self.model.link_inertias
        index = self.model.bodies.index(body)
        massive_links = []
        for link, frame in self.model.frames.items():
            if frame.body == index and link in inertias and inertias[link].parameters.any():
                massive_links.append(link)
        if body.link in massive_links or len(massive_links) != 1:
            return body.link, f"in {body.link}"
        (massive_link,) = massive_links
        return massive_link, f"from joint {body.joint.name}"

    def _body(
        self, i: int, body: Body, lengths_of_bodies: dict[int, dict[tuple[int, float], Parameter]]
    ) -> BodyEntries:
        """Numbers of body i; its parameters are added in the order mass, centre of mass, axis, inertia, ratio."""
        tag = self.tags[i]
        link, frame_words = self._massive_link(body)
        G = body.inertia
        mass = self._named_entry(f"m_{tag}", shortest(G.mass), "masses", f"mass of {link} [kg]")
        parent_lengths = lengths_of_bodies[body.parent]
        place = tuple(_with_length(axis, x, parent_lengths) for axis, x in enumerate(body.placement[:3, 3]))
        largest = float(np.abs(G.com).max())
        com = []
        for axis, x in enumerate(G.com):
            is_rounding_error = abs(x) <= _ROUNDING_SHARE * largest
            rounded = 0.0 if is_rounding_error else shortest(x, largest)
            com.append(_with_length(axis, rounded, lengths_of_bodies[i]))
        link_and_frame = link if link == body.link else f"{link} {frame_words}"
        unnamed_axes = [axis for axis, entry in enumerate(com) if entry.value and entry.parameter is None]
        for axis in unnamed_axes:
            name = f"r_{tag}{_AXES[axis]}" if len(unnamed_axes) > 1 else f"r_{tag}"
            meaning = f"{_AXES[axis]} of the centre of mass of {link_and_frame} [m]"
            com[axis] = self._named_entry(name, com[axis].value, "coms", meaning)
        point, pitch = self._axis(tag, body)
        inertia = self._inertia(tag, body)
        ratio = self._ratio(tag, body)
        return BodyEntries(tag, place, point, pitch, mass, tuple(com), inertia, ratio)

    def _ratio(self, tag: str, body: Body) -> Entry:
        """Ratio of a body's rate; a symbol for the gear of a rotor."""
        if body.joint.moves_body or abs(body.ratio) == 1.0:
            return Entry(body.ratio)
        name = f"G_{tag.removeprefix('r')}"
        meaning = f"gear ratio of {_driven_joint(self.model, body)}"
        return Entry(body.ratio, self._new(name, body.ratio, ["gears"], meaning))

    def _axis(self, tag: str, body: Body) -> tuple[Entries, Entry]:
        """Point ω × v/|ω|² of the axis in the child's frame, and the pitch ω·v/|ω|²; zeros for joints without such an axis."""
        if body.joint.nv > 1 or not body.joint.axes[0, :3].any():
            zero = Entry(0.0)
            return (zero, zero, zero), zero
        w = body.joint.axes[0, :3]
        v = body.joint.axes[0, 3:]
        position = np.cross(w, v) / (w @ w)
        pitch = float(w @ v / (w @ w))
        is_rounding_error = np.abs(position) <= _ROUNDING_SHARE * np.abs(position).max()
        shortest_position = [shortest(x) for x in position]
        position = np.where(is_rounding_error, 0.0, shortest_position)
        needs_letters = np.count_nonzero(position) > 1
        entries = []
        for axis, value in zip(_AXES, position, strict=True):
            name = f"a_{tag}{axis}" if needs_letters else f"a_{tag}"
            meaning = f"{axis} of the axis of {body.joint.name} in {body.link} [m]"
            entries.append(self._named_entry(name, value, "lengths", meaning))
        point = tuple(entries)
        if abs(pitch) <= _ROUNDING_SHARE * float(np.abs(v).max(initial=0.0)):
            return point, Entry(0.0)
        parameter = self._new(f"h_{tag}", pitch, ["lengths"], f"pitch of {body.joint.name} [m/rad]")
        return point, Entry(pitch, parameter)

    def _inertia(self, tag: str, body: Body) -> tuple[Entries, ...]:
        """Rotational inertia about the centre of mass, (3, 3), with a symbol for each nonzero entry of the upper triangle."""
        I = body.inertia.moment_about_com
        scale = float(np.abs(body.inertia.moment_about_origin).max())
        entries: list[list[Entry]] = [[Entry(0.0)] * 3 for _ in range(3)]
        link, _ = self._massive_link(body)
        for row in range(3):
            for column in range(row, 3):
                value = shortest(I[row, column], scale)  # without the rounding error of the parallel-axis term
                if abs(value) > _ROUNDING_SHARE * scale:
                    axes = _AXES[row] + _AXES[column]
                    meaning = f"rotational inertia {axes} of {link} about its centre of mass [kg m²]"
                    # Products of inertia keep their sign, as in the matrix.
                    parameter = self._new(f"I_{tag}{axes}", value, ["inertias"], meaning, signed=True)
                    entry = Entry(value, parameter)
                    entries[row][column] = entry
                    entries[column][row] = entry
        return tuple(map(tuple, entries))


def _driven_joint(model: Model, rotor: Body) -> str:
    """Name of the joint that a rotor drives."""
    name = rotor.joint.name
    actuator = model.actuators.get(name)
    return name.removesuffix(".rotor") if actuator is None else actuator.joint


def _tags(model: Model) -> list[str]:
    """Suffix of the symbols of each body: its number; for a rotor, r and the number of the driven joint."""
    numbers = {body.joint.name: number for number, body in enumerate(model.leaders, 1)}
    tags: list[str] = []
    for i, body in enumerate(model.bodies, 1):
        tag = str(i)
        driven_joint = _driven_joint(model, body)
        if not body.joint.moves_body and driven_joint in numbers:
            rotor_tag = f"r{numbers[driven_joint]}"
            if rotor_tag not in tags:
                tag = rotor_tag
        tags.append(tag)
    return tags


def _is_length(axis: int, x: Any, length: tuple[int, float]) -> bool:
    """True if a displacement x along an axis has the axis and the size of ``length``."""
    length_axis, size = length
    return length_axis == axis and abs(abs(float(x)) - size) <= _LENGTH_TOLERANCE * size


def _with_length(axis: int, x: Any, lengths: dict[tuple[int, float], Parameter]) -> Entry:
    """Entry of a displacement x along an axis, with the symbol of the length of equal axis and size if there is one."""
    for length, parameter in lengths.items():
        if x and _is_length(axis, x, length):
            return Entry(shortest(x), parameter)
    return Entry(shortest(x))


KINDS = ("lengths", "coms", "masses", "inertias", "gravity", "springs", "gears")
"""Kinds accepted by ``symbols=``, besides ``"all"`` and ``"none"``."""


def model_entries(model: Model, symbols: str | Iterable[str] = "all") -> ModelEntries:
    """Numbers of the model, with the parameters that ``symbols`` selects: kinds, names, ``"all"`` or ``"none"``.

    Raises UnknownNameError for other words.
    """
    entries = Namer(model).entries()
    selected = _selected_names(symbols, entries.parameters)

    def select(entry: Any) -> Any:
        """Entry, or tuples of entries, with plain numbers for symbols that are not selected."""
        if isinstance(entry, tuple):
            return tuple(map(select, entry))
        if entry.parameter is None or entry.parameter.name in selected:
            return entry
        return Entry(entry.value)

    bodies = []
    for body in entries.bodies:
        fields = dict(vars(body))
        for name in fields.keys() - {"tag"}:
            fields[name] = select(fields[name])
        bodies.append(BodyEntries(**fields))
    parameters = tuple(parameter for parameter in entries.parameters if parameter.name in selected)
    return ModelEntries(
        tuple(bodies), select(entries.gravity), select(entries.springs), select(entries.armature), parameters
    )


def _selected_names(symbols: str | Iterable[str], parameters: tuple[Parameter, ...]) -> set[str]:
    """Names of the parameters that the words in ``symbols`` select."""
    words = [symbols] if isinstance(symbols, str) else symbols
    try:
        words = [str(word).strip() for word in words]
    except TypeError:
        raise ValueRangeError(
            f"symbols={symbols!r}: give 'all', 'none', or a list of kinds ({', '.join(KINDS)}) and names such as 'L_1'."
        ) from None
    names = set(names_of(parameters))
    selected: set[str] = set()
    for word in words:
        if word == "all":
            selected |= names
        elif word in KINDS:
            selected |= {parameter.name for parameter in parameters if word in parameter.kinds}
        elif word in names:
            selected.add(word)
        elif word != "none":
            choices = ["all", "none", *KINDS, *sorted(names)]
            raise UnknownNameError.from_choices("symbol or kind of symbols", word, choices)
    return selected
