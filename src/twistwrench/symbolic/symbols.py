"""The numbers of a robot as named symbols: lengths, centres of mass, masses, inertias, gravity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ValueRangeError
from ..model.model import BASE, Body, Model
from .decimals import shortest

_AXES = "xyz"
_SAME = 1e-12  # a centre of mass is a quotient, so it meets the joint's place to round-off
_ROUND_OFF = 1e-14


@dataclass(frozen=True)
class Parameter:
    """Named number of the robot; signs stay in the equations, so the values of lengths are positive."""

    name: str
    """Its symbol."""
    value: float
    """In SI units."""
    kinds: frozenset[str]
    """What it is of: lengths, coms, masses, inertias, gravity, springs, gears."""
    meaning: str
    """In words."""


@dataclass(frozen=True)
class Entry:
    """A number of the model, in the equations ``sign * parameter``, or the number itself where there is no parameter."""

    value: float
    parameter: Parameter | None = None

    @property
    def sign(self) -> int:
        """Of the value, beside a parameter."""
        return -1 if self.parameter is not None and self.value * self.parameter.value < 0 else 1


Entries = tuple[Entry, ...]


@dataclass(frozen=True)
class BodyEntries:
    """The numbers of one body: place of its joint, a point of its axis, pitch, mass, centre of mass, inertia about it."""

    tag: str
    """What its symbols end in: its number, r1 for the rotor of joint 1."""
    place: Entries
    point: Entries
    pitch: Entry
    mass: Entry
    com: Entries
    inertia: tuple[Entries, ...]
    ratio: Entry
    """Of its joint's rate to that of the coordinate; a symbol where a gear is between."""


@dataclass(frozen=True)
class ModelEntries:
    """The numbers of the robot, and the parameters among them."""

    bodies: tuple[BodyEntries, ...]
    gravity: Entries
    springs: Entries
    """Stiffnesses."""
    armature: Entries
    """Inertias of the drives, one for each velocity."""
    parameters: tuple[Parameter, ...]


class Namer:
    """Goes through a model body by body and gives names: L_1 for the place of the next joint, r_1 for a centre of mass."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.parameters: list[Parameter] = []
        self.tags = _tags(model)

    def entries(self) -> ModelEntries:
        """The numbers of the model, each with its name where it has one."""
        bodies = self.model.bodies
        lengths = {i: self._lengths(i) for i in range(BASE, len(bodies))}
        found = tuple(self._body(i, body, lengths) for i, body in enumerate(bodies))
        gravity = self._gravity()
        springs = tuple(
            Entry(
                s.stiffness,
                self._new(f"k_{n}", s.stiffness, ["springs"], f"stiffness between {joined} [N m/rad or N/m]"),
            )
            for n, s in enumerate(self.model.springs, 1)
            for joined in [" and ".join(joint for joint, _ in s.terms)]
        )
        return ModelEntries(found, gravity, springs, self._armature(), tuple(self.parameters))

    def _armature(self) -> Entries:
        found = [Entry(0.0)] * self.model.nv
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
                found[body.v_index] = Entry(value, self._new(f"J_{n}", value, ["gears"], meaning))
        return tuple(found)

    def _new(self, name: str, value: float, kinds: Iterable[str], meaning: str) -> Parameter:
        self.parameters.append(Parameter(name, float(abs(value)), frozenset(kinds), meaning))
        return self.parameters[-1]

    def _lengths(self, i: int) -> dict[tuple[int, float], Parameter]:
        """Of body i: coordinate axis and size of what is apart on it, joints and its tip, → their symbol."""
        children = [(f"joint {b.joint.name}", b.placement[:3, 3]) for b in self.model.bodies if b.parent == i]
        tip = self.model.all_frames.get(self.model.tip or "")
        if i != BASE and tip is not None and tip.body == i:
            children.append((f"frame {self.model.tip}", tip.pose[:3, 3]))
        com = np.zeros(3) if i == BASE else self.model.bodies[i].inertia.com
        sizes: dict[tuple[int, float], tuple[str, list[str]]] = {}
        for what, place in children:
            for k, x in enumerate(place):
                if x and not any(_same(k, x, key) for key in sizes):
                    sizes[k, shortest(abs(x))] = (what, ["lengths"])
        for (k, size), (_, kinds) in sizes.items():
            if _same(k, com[k], (k, size)):
                kinds.append("coms")
        axes = [k for k, _ in sizes]
        found, link = {}, "the base" if i == BASE else self.model.bodies[i].link
        for n, ((k, size), (what, kinds)) in enumerate(sizes.items()):
            letter = _AXES[k] if len(sizes) > 1 else ""
            again = f"_{axes[:n].count(k) + 1}" if axes[:n].count(k) else ""
            meaning = f"{_AXES[k]} of {what} in {link}" + (", and of its centre of mass" if "coms" in kinds else "")
            tag = "0" if i == BASE else self.tags[i]
            found[k, size] = self._new(f"L_{tag}{letter}{again}", size, kinds, f"{meaning} [m]")
        return found

    def _body(self, i: int, body: Body, lengths: dict[int, dict[tuple[int, float], Parameter]]) -> BodyEntries:
        n, link, G = self.tags[i], body.link, body.inertia
        m = shortest(G.mass)
        mass = Entry(0.0) if not m else Entry(m, self._new(f"m_{n}", m, ["masses"], f"mass of {link} [kg]"))
        place = tuple(_with_length(k, x, lengths[body.parent]) for k, x in enumerate(body.placement[:3, 3]))
        extent = float(np.abs(G.com).max())
        com_places = [0.0 if abs(x) <= _ROUND_OFF * extent else shortest(x, extent) for x in G.com]
        com = [_with_length(k, x, lengths[i]) for k, x in enumerate(com_places)]
        unnamed = [k for k, entry in enumerate(com) if entry.value and entry.parameter is None]
        for k in unnamed:
            name = f"r_{n}{_AXES[k] if len(unnamed) > 1 else ''}"
            com[k] = Entry(
                com[k].value, self._new(name, com[k].value, ["coms"], f"{_AXES[k]} of the centre of mass of {link} [m]")
            )
        point, pitch = self._axis(n, body)
        return BodyEntries(n, place, point, pitch, mass, tuple(com), self._inertia(n, body), self._ratio(n, body))

    def _ratio(self, n: str, body: Body) -> Entry:
        if body.joint.moves_body or abs(body.ratio) == 1.0:
            return Entry(body.ratio)
        meaning = f"gear ratio of {_driven(self.model, body)}"
        return Entry(body.ratio, self._new(f"G_{n.removeprefix('r')}", body.ratio, ["gears"], meaning))

    def _axis(self, n: str, body: Body) -> tuple[Entries, Entry]:
        """Where the axis passes, in the child's frame, and its pitch; zeros of joints that do not turn about one axis."""
        none = (Entry(0.0),) * 3
        if body.joint.nv > 1 or not body.joint.axes[0, :3].any():
            return none, Entry(0.0)
        w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
        at, h = np.cross(w, v) / (w @ w), float(w @ v / (w @ w))
        at = np.where(np.abs(at) <= _ROUND_OFF * np.abs(at).max(), 0.0, [shortest(x) for x in at])
        name = body.joint.name
        many = np.count_nonzero(at) > 1
        point = tuple(
            Entry(
                float(x),
                self._new(
                    f"a_{n}{_AXES[k] if many else ''}",
                    x,
                    ["lengths"],
                    f"{_AXES[k]} of the axis of {name} in {body.link} [m]",
                ),
            )
            if x
            else Entry(0.0)
            for k, x in enumerate(at)
        )
        if abs(h) <= _ROUND_OFF * float(np.abs(v).max(initial=0.0)):
            return point, Entry(0.0)
        return point, Entry(h, self._new(f"h_{n}", h, ["lengths"], f"pitch of {name} [m/rad]"))

    def _inertia(self, n: str, body: Body) -> tuple[Entries, ...]:
        I, scale = body.inertia.moment_about_com, float(np.abs(body.inertia.moment_about_origin).max())
        found: list[list[Entry]] = [[Entry(0.0)] * 3 for _ in range(3)]
        for a in range(3):
            for b in range(a, 3):
                value = shortest(I[a, b], scale)  # Steiner's term leaves its round-off behind
                if abs(value) > _ROUND_OFF * scale:
                    axes = _AXES[a] + _AXES[b]
                    meaning = f"rotational inertia {axes} of {body.link} about its centre of mass [kg m²]"
                    found[a][b] = found[b][a] = Entry(value, self._signed(f"I_{n}{axes}", value, meaning))
        return tuple(map(tuple, found))

    def _signed(self, name: str, value: float, meaning: str) -> Parameter:
        # Products of inertia have a sign of their own, as the matrix has them.
        self.parameters.append(Parameter(name, value, frozenset(["inertias"]), meaning))
        return self.parameters[-1]

    def _gravity(self) -> Entries:
        g = self.model.gravity
        many = np.count_nonzero(g) > 1
        return tuple(
            Entry(float(x), self._new(f"g_{_AXES[k]}" if many else "g", x, ["gravity"], "gravity [m/s²]"))
            if x
            else Entry(0.0)
            for k, x in enumerate(g)
        )


def _driven(model: Model, rotor: Body) -> str:
    """The joint that a rotor drives."""
    name = rotor.joint.name
    actuator = model.actuators.get(name)
    return name.removesuffix(".rotor") if actuator is None else actuator.joint


def _tags(model: Model) -> list[str]:
    """What tells the symbols of bodies apart: their number; of a rotor, r and the number of the joint it drives."""
    numbers = {body.joint.name: n for n, body in enumerate(model.leaders, 1)}
    tags: list[str] = []
    for i, body in enumerate(model.bodies, 1):
        n = numbers.get(_driven(model, body)) if not body.joint.moves_body else None
        tag = f"r{n}"
        tags.append(str(i) if n is None or tag in tags else tag)
    return tags


def _same(k: int, x: Any, key: tuple[int, float]) -> bool:
    return key[0] == k and abs(abs(float(x)) - key[1]) <= _SAME * key[1]


def _with_length(k: int, x: Any, lengths: dict[tuple[int, float], Parameter]) -> Entry:
    return Entry(shortest(x), next((p for key, p in lengths.items() if x and _same(k, x, key)), None))
