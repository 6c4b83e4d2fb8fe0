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
_LENGTH_TOLERANCE = 1e-12  # tolerance: a centre of mass is a quotient, with rounding error
_DUST = 1e-14
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
    parameter: Parameter | None = None

    @property
    def sign(self) -> int:
        """Sign of the value relative to the parameter."""
        return -1 if self.parameter is not None and self.value * self.parameter.value < 0 else 1


Entries = tuple[Entry, ...]


@dataclass(frozen=True)
class BodyEntries:
    """Numbers of one body: joint position, point of the joint axis, pitch, mass, centre of mass, and inertia about it."""

    tag: str
    """Suffix of its symbols: its number, or r1 for the rotor of joint 1."""
    place: Entries
    point: Entries
    pitch: Entry
    mass: Entry
    com: Entries
    inertia: tuple[Entries, ...]
    ratio: Entry
    """Ratio of its joint's rate to the rate of the coordinate; a symbol for a gear."""


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
        lengths = {i: self._lengths(i) for i in range(BASE, len(bodies))}
        body_entries = []
        for i, body in enumerate(bodies):
            body_entries.append(self._body(i, body, lengths))
        gravity = []
        several = np.count_nonzero(self.model.gravity) > 1
        for axis, value in zip(_AXES, self.model.gravity, strict=True):
            name = f"g_{axis}" if several else "g"
            gravity.append(self._named_entry(name, value, "gravity", "gravity [m/s²]"))
        springs = []
        for n, spring in enumerate(self.model.springs, 1):
            joints = " and ".join(joint for joint, _ in spring.terms)
            meaning = f"stiffness between {joints} [N m/rad or N/m]"
            parameter = self._new(f"k_{n}", spring.stiffness, ["springs"], meaning)
            springs.append(Entry(spring.stiffness, parameter))
        return ModelEntries(
            tuple(body_entries), tuple(gravity), tuple(springs), self._armature(), tuple(self.parameters)
        )

    def _armature(self) -> Entries:
        refuse_couplings(self.model, "derivation of equations of motion")
        armature = [Entry(0.0)] * self.model.nv
        for n, body in enumerate(self.model.leaders, 1):
            values = self.model.armature[body.places[1]]
            if body.joint.nv > 1 and values.any():
                raise ValueRangeError(
                    f"joint {body.joint.name!r} is {body.joint.kind} and has an armature, which equations of motion are not "
                    f"derived with. Leave it out: robot.with_armature({{{body.joint.name!r}: 0}})."
                )
            if values.any():
                meaning = f"inertia of the drive of joint {body.joint.name} [kg m² or kg]"
                value = float(values[0])
                armature[body.v_index] = Entry(value, self._new(f"J_{n}", value, ["gears"], meaning))
        return tuple(armature)

    def _new(self, name: str, value: float, kinds: Iterable[str], meaning: str, *, signed: bool = False) -> Parameter:
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
        com, where, tag = np.zeros(3), "in the base", "0"
        if i != BASE:
            body = self.model.bodies[i]
            com, where, tag = body.inertia.com, self._massive_link(body)[1], self.tags[i]
        sizes: dict[tuple[int, float], str] = {}
        for child, position in self._child_positions(i):
            for k, x in enumerate(position):
                if x and not any(_same(k, x, key) for key in sizes):
                    sizes[k, shortest(abs(x))] = child
        lengths: dict[tuple[int, float], Parameter] = {}
        for (k, size), child in sizes.items():
            name = f"L_{tag}"
            if len(sizes) > 1:
                name += _AXES[k]
            earlier_lengths = [key for key in lengths if key[0] == k]
            if earlier_lengths:
                name += f"_{len(earlier_lengths) + 1}"
            kinds, meaning = ["lengths"], f"{_AXES[k]} of {child} {where}"
            if _same(k, com[k], (k, size)):
                kinds.append("coms")
                meaning += ", and of its centre of mass"
            lengths[k, size] = self._new(name, size, kinds, f"{meaning} [m]")
        return lengths

    def _child_positions(self, i: int) -> list[tuple[str, Array]]:
        """Joints on body i and its tip, in words, with their positions (3,) in the body's frame."""
        children = [(f"joint {b.joint.name}", b.placement[:3, 3]) for b in self.model.bodies if b.parent == i]
        tip = self.model.all_frames.get(self.model.tip or "")
        if i != BASE and tip is not None and tip.body == i:
            children.append((f"frame {self.model.tip}", tip.pose[:3, 3]))
        return children

    def _massive_link(self, body: Body) -> tuple[str, str]:
        """Link with the mass of a body, and words for the body's frame; of a DH table, the user never named that frame."""
        G, frames = self.model.link_inertias, self.model.frames
        index = self.model.bodies.index(body)
        fixed = []
        for name, frame in frames.items():
            if frame.body == index and name in G and G[name].parameters.any():
                fixed.append(name)
        if body.link in fixed or len(fixed) != 1:
            return body.link, f"in {body.link}"
        return fixed[0], f"from joint {body.joint.name}"

    def _body(self, i: int, body: Body, lengths: dict[int, dict[tuple[int, float], Parameter]]) -> BodyEntries:
        n, (link, where), G = self.tags[i], self._massive_link(body), body.inertia
        mass = self._named_entry(f"m_{n}", shortest(G.mass), "masses", f"mass of {link} [kg]")
        place = tuple(_with_length(k, x, lengths[body.parent]) for k, x in enumerate(body.placement[:3, 3]))
        extent = float(np.abs(G.com).max())
        com = []
        for k, x in enumerate(G.com):
            rounded = 0.0 if abs(x) <= _DUST * extent else shortest(x, extent)
            com.append(_with_length(k, rounded, lengths[i]))
        frame = link if link == body.link else f"{link} {where}"
        unnamed = [k for k, entry in enumerate(com) if entry.value and entry.parameter is None]
        for k in unnamed:
            name = f"r_{n}{_AXES[k]}" if len(unnamed) > 1 else f"r_{n}"
            com[k] = self._named_entry(name, com[k].value, "coms", f"{_AXES[k]} of the centre of mass of {frame} [m]")
        point, pitch = self._axis(n, body)
        return BodyEntries(n, place, point, pitch, mass, tuple(com), self._inertia(n, body), self._ratio(n, body))

    def _ratio(self, n: str, body: Body) -> Entry:
        if body.joint.moves_body or abs(body.ratio) == 1.0:
            return Entry(body.ratio)
        meaning = f"gear ratio of {_driven_joint(self.model, body)}"
        return Entry(body.ratio, self._new(f"G_{n.removeprefix('r')}", body.ratio, ["gears"], meaning))

    def _axis(self, n: str, body: Body) -> tuple[Entries, Entry]:
        """Point of the axis in the child's frame, and the pitch; zeros for joints that do not rotate about one axis."""
        none = (Entry(0.0),) * 3
        if body.joint.nv > 1 or not body.joint.axes[0, :3].any():
            return none, Entry(0.0)
        w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
        position, h = np.cross(w, v) / (w @ w), float(w @ v / (w @ w))
        is_dust = np.abs(position) <= _DUST * np.abs(position).max()
        position = np.where(is_dust, 0.0, [shortest(x) for x in position])
        name, several = body.joint.name, np.count_nonzero(position) > 1
        entries = []
        for axis, value in zip(_AXES, position, strict=True):
            symbol = f"a_{n}{axis}" if several else f"a_{n}"
            meaning = f"{axis} of the axis of {name} in {body.link} [m]"
            entries.append(self._named_entry(symbol, value, "lengths", meaning))
        point = tuple(entries)
        if abs(h) <= _DUST * float(np.abs(v).max(initial=0.0)):
            return point, Entry(0.0)
        return point, Entry(h, self._new(f"h_{n}", h, ["lengths"], f"pitch of {name} [m/rad]"))

    def _inertia(self, n: str, body: Body) -> tuple[Entries, ...]:
        I, scale = body.inertia.moment_about_com, float(np.abs(body.inertia.moment_about_origin).max())
        entries: list[list[Entry]] = [[Entry(0.0)] * 3 for _ in range(3)]
        link, _ = self._massive_link(body)
        for a in range(3):
            for b in range(a, 3):
                value = shortest(I[a, b], scale)  # the parallel-axis term leaves a rounding error
                if abs(value) > _DUST * scale:
                    axes = _AXES[a] + _AXES[b]
                    meaning = f"rotational inertia {axes} of {link} about its centre of mass [kg m²]"
                    # Products of inertia keep their sign, as in the matrix.
                    parameter = self._new(f"I_{n}{axes}", value, ["inertias"], meaning, signed=True)
                    entries[a][b] = entries[b][a] = Entry(value, parameter)
        return tuple(map(tuple, entries))


def _driven_joint(model: Model, rotor: Body) -> str:
    """Joint driven by a rotor."""
    name = rotor.joint.name
    actuator = model.actuators.get(name)
    return name.removesuffix(".rotor") if actuator is None else actuator.joint


def _tags(model: Model) -> list[str]:
    """Suffixes of the symbols of bodies: their number; for a rotor, r and the number of the driven joint."""
    numbers = {body.joint.name: n for n, body in enumerate(model.leaders, 1)}
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


def _same(k: int, x: Any, key: tuple[int, float]) -> bool:
    return key[0] == k and abs(abs(float(x)) - key[1]) <= _LENGTH_TOLERANCE * key[1]


def _with_length(k: int, x: Any, lengths: dict[tuple[int, float], Parameter]) -> Entry:
    """Entry of a displacement along axis k, with the symbol of the length that is as large."""
    for key, parameter in lengths.items():
        if x and _same(k, x, key):
            return Entry(shortest(x), parameter)
    return Entry(shortest(x))


KINDS = ("lengths", "coms", "masses", "inertias", "gravity", "springs", "gears")
"""Kinds accepted by ``symbols=``, besides ``"all"`` and ``"none"``."""


def model_entries(model: Model, symbols: str | Iterable[str] = "all") -> ModelEntries:
    """Name the model's numbers selected by ``symbols``: kinds, names, ``"all"`` or ``"none"``; raises UnknownNameError."""
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
    parameters = tuple(p for p in entries.parameters if p.name in selected)
    return ModelEntries(
        tuple(bodies), select(entries.gravity), select(entries.springs), select(entries.armature), parameters
    )


def _selected_names(symbols: str | Iterable[str], parameters: tuple[Parameter, ...]) -> set[str]:
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
            selected |= {p.name for p in parameters if word in p.kinds}
        elif word in names:
            selected.add(word)
        elif word != "none":
            choices = ["all", "none", *KINDS, *sorted(names)]
            raise UnknownNameError.from_choices("symbol or kind of symbols", word, choices)
    return selected
