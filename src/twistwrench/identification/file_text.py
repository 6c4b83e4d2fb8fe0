"""Identified numbers in the text of a URDF, SDF or MJCF file, edited element by element."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..diagnosis.findings import Edit, Place, edited
from ..errors import ModelError, TwistWrenchError
from ..formats.element import Element
from ..formats.mjcf.bodies import MjcfBody, inertias_of, joints_of, names_given, survey
from ..formats.mjcf.preprocess import Defaults, Folders, Meshes, Settings, expand
from ..formats.sdf import chosen_model, number, pose, unpacked
from ..formats.urdf import ENTRIES, IN_MJCF, entries_of, origin_of
from ..lie import se3
from ..typing import Array

FOUND, ELSEWHERE = "identified from logs", "in none of the logs, or part of the link that carries it"
"""Why a number changes."""


def plain(values: Sequence[float] | Array) -> str:
    """Numbers as they come back to the last digit."""
    return " ".join(repr(float(x)) for x in values)


def links_of(
    links: Mapping[str, Element], wanted: Mapping[str, SpatialInertia]
) -> Iterator[tuple[Element, SpatialInertia]]:
    """Each link with the inertia that it is to have. Raises ModelError for links that the file does not have."""
    for name, inertia in wanted.items():
        if name not in links:
            raise ModelError(f"the file has no link {name!r} whose inertia could be written.")
        yield links[name], inertia


class TextChanges:
    """Changes to the file whose elements are those of ``root``, before others are included in it.

    Parameters
    ----------
    root : Element
    signature : str, what comments begin with
    """

    def __init__(self, root: Element, signature: str) -> None:
        self._elements = list(root.walk())  # kept alive, so that no included one gets the place of another
        self._numbers = {id(element): k for k, element in enumerate(self._elements)}
        self._signature = signature
        self._edits: dict[Place, tuple[Edit, str]] = {}
        self._additions: dict[int, str] = {}

    def set(self, element: Element, attribute: str, value: str, why: str = FOUND) -> None:
        """An attribute of an element, which may lack it; or its text, where the attribute is empty. What it says stays."""
        if _meaning(element.attributes.get(attribute, "") if attribute else element.content) == _meaning(value):
            return
        if not attribute and not element.content.strip():
            self.add(element, value)
            return
        self._edit(element, attribute, value, why, "put" if attribute else "change")

    def remove(self, element: Element, attribute: str, why: str = FOUND) -> None:
        """An attribute that an element has."""
        self._edit(element, attribute, "", why, "remove")

    def add(self, element: Element, text: str) -> None:
        """Put text first into an element; later ones come behind."""
        number = self._number(element)
        self._additions[number] = self._additions.get(number, "") + text

    def apply(self, text: str) -> str:
        """The file's text with all of them."""
        return edited(text, list(self._edits.values()), additions=self._additions, signature=self._signature)

    def _edit(
        self, element: Element, attribute: str, value: str, why: str, how: Literal["change", "put", "remove"]
    ) -> None:
        place = Place(self._number(element), attribute)
        self._edits[place] = (Edit(place, value, how), why)

    def _number(self, element: Element) -> int:
        if id(element) not in self._numbers:
            raise ModelError(
                f"{element} stands in the included file {element.file!r}, and only the robot's own file is written. Put the "
                "included elements into it first."
            )
        return self._numbers[id(element)]


def _meaning(text: str) -> list[float] | str:
    """The numbers of a text, or the text where it is something else."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return text.strip()


# ── MJCF: ``<inertial>`` of bodies; damping, frictionloss and armature of joints

# What ``<compiler>`` does to inertias (inertiafromgeom, settotalmass, boundmass, …) is taken out where it would change what is
# written; bodies that it has changed otherwise are then written as they were.

_PLACES = {"viscous": "damping", "coulomb": "frictionloss", "motor_inertia": "armature"}
_TURNED = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_MOST_BODIES = 20_000
_COMPILER = "so that inertias are as they are written"


class MjcfText:
    """An MJCF file whose numbers change.

    Parameters
    ----------
    root : Element
    changes : TextChanges
    path : Path, optional, of the file, from whose folder others are included
    """

    kinds = tuple(_PLACES)
    """What it has a place for, of a joint."""
    share_left = 0.0
    """Of a body, to each link that is folded into it."""

    def __init__(self, root: Element, changes: TextChanges, _model: str, path: Path | None) -> None:
        folders = Folders(None if path is None else path.parent)
        expand(root, folders, _MOST_BODIES)
        self._root, self._changes, self._folders = root, changes, folders
        self._settings, self._defaults = Settings.from_root(root), Defaults(root)
        self._bodies = survey(root, self._settings, self._defaults)
        taken = names_given(self._bodies)
        self._joints: dict[str, tuple[Element, Element]] = {}  # as it stands there, and with its class's attributes
        for body in self._bodies[1:]:
            joints = joints_of(body, self._settings, taken)
            self._joints |= {j.name: (e, j.element) for j, e in zip(joints, _joints_in(body.element), strict=True)}

    def write_links(self, wanted: Mapping[str, SpatialInertia]) -> None:
        """The inertias that bodies are to have, each about its own frame. Raises ModelError for bodies that are not there."""
        bodies = {body.name: body for body in self._bodies[1:]}
        for name in wanted:
            if name not in bodies:
                raise ModelError(f"the file has no body {name!r} whose inertia could be written.")
        for name, inertia in wanted.items():
            self._write_body(bodies[name], inertia, FOUND if inertia.parameters.any() else ELSEWHERE)
        plainer = self._undone(wanted)
        if not plainer:
            return
        for compiler in self._root.all("compiler"):
            for attribute, (_, _, text) in plainer.items():
                if attribute in compiler.attributes:
                    self._changes.set(compiler, attribute, text, _COMPILER)
        meshes = Meshes(self._root, self._settings, self._defaults, self._folders)
        without = replace(self._settings, **{field: value for field, value, _ in plainer.values()})
        before, after = (inertias_of(self._bodies, settings, meshes).each for settings in (self._settings, without))
        for body, was, would in zip(self._bodies, before, after, strict=True):
            if body.name not in wanted and not np.array_equal(was.parameters, would.parameters):
                self._write_body(body, was, _COMPILER)

    def _undone(self, wanted: Mapping[str, SpatialInertia]) -> dict[str, tuple[str, Any, str]]:
        """Attributes of ``<compiler>`` that would change what is written: the setting, its value without, and that in text."""
        settings, found = self._settings, dict[str, tuple[str, Any, str]]()
        moments = np.array([np.linalg.eigvalsh(G.moment_about_com) for G in wanted.values()]).reshape(-1, 3)
        if settings.from_geoms == "true":
            found["inertiafromgeom"] = ("from_geoms", "auto", "auto")
        if settings.total_mass > 0:
            found["settotalmass"] = ("total_mass", -1.0, "-1")
        if any(G.mass < settings.least_mass for G in wanted.values()):
            found["boundmass"] = ("least_mass", 0.0, "0")
        if (moments < settings.least_moment).any():
            found["boundinertia"] = ("least_moment", 0.0, "0")
        if settings.balanced and (moments[:, 0] + moments[:, 1] < moments[:, 2]).any():
            found["balanceinertia"] = ("balanced", False, "false")
        return found

    def _write_body(self, body: MjcfBody, inertia: SpatialInertia, why: str) -> None:
        changes, given = self._changes, body.inertial
        own = inertia if given is None else inertia.in_frame(np.asarray(se3.inverse(given.frame)))
        I = 0.5 * (own.moment_about_com + own.moment_about_com.T)
        some = bool(own.parameters.any())  # MuJoCo refuses a fullinertia of zeros
        kept, other = ("fullinertia", "diaginertia") if some else ("diaginertia", "fullinertia")
        said = {
            "pos": plain(own.com) if some else "0 0 0",
            "mass": plain([own.mass]),
            kept: plain([I[ENTRIES[name]] for name in IN_MJCF]) if some else "0 0 0",
        }
        if given is None:
            attributes = " ".join(f'{name}="{text}"' for name, text in said.items())
            changes.add(body.element, f"<inertial {attributes}/>")
            return
        for name, text in said.items():
            changes.set(given.element, name, text, why)
        for name in (other, *_TURNED):
            if name in given.element.attributes:
                changes.remove(given.element, name, why)

    def write_joint(self, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Friction and armature of one joint; zeros only where the file or a class says otherwise."""
        joint, with_class = self._joints[name]
        for kind, attribute in _PLACES.items():
            if kind in values and (values[kind] or attribute in with_class.attributes):
                self._changes.set(joint, attribute, plain([values[kind]]), why)


def _joints_in(element: Element) -> Iterator[Element]:
    """As they stand in the file, in its order, those within frames too."""
    for child in element.children:
        if child.tag in ("joint", "freejoint"):
            yield child
        elif child.tag == "frame":
            yield from _joints_in(child)


# ── URDF: ``<inertial>`` of links, ``<dynamics>`` of joints

LAWS = {"viscous": "damping", "coulomb": "friction"}


def products(moments: Array) -> dict[str, str]:
    """ixx, ixy, … of a tensor (3, 3) whose rounding need not be symmetric, as text."""
    return {name: repr(value) for name, value in entries_of(0.5 * (moments + moments.T)).items()}


class UrdfText:
    """A URDF whose numbers change.

    Parameters
    ----------
    root : Element
    changes : TextChanges
    """

    kinds = tuple(LAWS)
    """What it has a place for, of a joint."""
    share_left = 0.0
    """Of a body, to each link that is folded into it."""

    def __init__(self, root: Element, changes: TextChanges, _model: str, _path: Path | None) -> None:
        self._changes = changes
        self._links = {element.text("name"): element for element in root.all("link")}
        self._joints = {element.text("name"): element for element in root.all("joint")}

    def write_links(self, wanted: Mapping[str, SpatialInertia]) -> None:
        """The inertias that links are to have, each about its own frame. Raises ModelError for links that are not there."""
        for link, inertia in links_of(self._links, wanted):
            self._write_link(link, inertia)

    def _write_link(self, link: Element, inertia: SpatialInertia) -> None:
        changes, inertial = self._changes, link.child("inertial")
        if not inertia.parameters.any():
            if inertial is not None:
                changes.set(inertial.required("mass", "a mass"), "value", "0", ELSEWHERE)
                for name in ENTRIES:
                    changes.set(inertial.required("inertia", "an inertia"), name, "0", ELSEWHERE)
            return
        com = plain(inertia.com)
        if inertial is None:
            tensor = " ".join(f'{name}="{text}"' for name, text in products(inertia.moment_about_com).items())
            changes.add(
                link,
                f'<inertial><origin xyz="{com}" rpy="0 0 0"/><mass value="{plain([inertia.mass])}"/>'
                f"<inertia {tensor}/></inertial>",
            )
            return
        origin, R = inertial.child("origin"), origin_of(inertial)[:3, :3]
        if origin is None:
            changes.add(inertial, f'<origin xyz="{com}" rpy="0 0 0"/>')
        else:
            changes.set(origin, "xyz", com)
        changes.set(inertial.required("mass", "a mass"), "value", plain([inertia.mass]))
        for name, text in products(R.T @ inertia.moment_about_com @ R).items():
            changes.set(inertial.required("inertia", "an inertia"), name, text)

    def write_joint(self, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Friction of one joint, ``viscous`` and ``coulomb``; of one without ``<dynamics>``, what is not zero."""
        joint = self._joints[name]
        dynamics = joint.child("dynamics")
        said = {LAWS[kind]: plain([value]) for kind, value in values.items() if kind in LAWS}
        if dynamics is not None:
            for attribute, text in said.items():
                self._changes.set(dynamics, attribute, text, why)
        elif any(map(float, said.values())):
            entries = " ".join(f'{attribute}="{text}"' for attribute, text in said.items())
            self._changes.add(joint, f"<dynamics {entries}/>")


# ── SDF: ``<inertial>`` of links, ``<dynamics>`` of the axes of joints

_TWO_AXES = ("universal", "revolute2")
_ROTOR = "drake:rotor_inertia"


class SdfText:
    """One model of an SDF file whose numbers change.

    Parameters
    ----------
    root : Element
    changes : TextChanges
    model : str, name of the model, where the file has several
    """

    kinds = (*LAWS, "motor_inertia")
    """What it may have a place for, of a joint."""
    share_left = 1e-3
    """Of a body, to each link that is folded into it: libsdformat refuses a link whose mass is not positive."""

    def __init__(self, root: Element, changes: TextChanges, model: str, _path: Path | None) -> None:
        self._changes = changes
        try:
            chosen, _ = chosen_model(root, None)
        except TwistWrenchError:
            chosen, _ = chosen_model(root, model)
        parts = unpacked(chosen)
        self._links = parts.links
        self._axes: dict[str, tuple[Element, Element]] = {}
        for name, joint in parts.joints.items():
            double = joint.text("type") in _TWO_AXES
            for which in ("axis", "axis2") if double else ("axis",):
                axis = joint.child(which)
                if axis is not None:
                    self._axes[f"{name}.{which}" if double else name] = (axis, joint)

    def write_links(self, wanted: Mapping[str, SpatialInertia]) -> None:
        """The inertias that links are to have, each about its own frame. Raises ModelError for links that are not there."""
        for link, inertia in links_of(self._links, wanted):
            self._write_link(link, inertia)

    def _write_link(self, link: Element, inertia: SpatialInertia) -> None:
        changes, inertial = self._changes, link.child("inertial")
        why = FOUND if inertia.parameters.any() else ELSEWHERE
        place = inertial.child("pose") if inertial is not None else None
        R = pose(place)[:3, :3]
        com, mass = plain(inertia.com), plain([inertia.mass])
        entries = products(R.T @ inertia.moment_about_com @ R)
        tensor = "".join(f"<{name}>{text}</{name}>" for name, text in entries.items())
        if inertial is None:
            changes.add(
                link, f"<inertial><pose>{com} 0 0 0</pose><mass>{mass}</mass><inertia>{tensor}</inertia></inertial>"
            )
            return
        if place is None:
            changes.add(inertial, f"<pose>{com} 0 0 0</pose>")
        elif not place.content.strip():
            turned = "0 0 0 1" if place.attributes.get("rotation_format", "") == "quat_xyzw" else "0 0 0"
            changes.set(place, "", f"{com} {turned}", why)
        else:
            changes.set(place, "", " ".join([com, *place.content.split()[3:]]), why)
        self._set(inertial, "mass", mass, why)
        inner = inertial.child("inertia")
        if inner is None:
            changes.add(inertial, f"<inertia>{tensor}</inertia>")
            return
        for name, text in entries.items():
            self._set(inner, name, text, why)

    def write_joint(self, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Friction of one joint, and its motor's inertia where the file has ``drake:rotor_inertia``."""
        axis, joint = self._axes[name]
        given = {tag: values[kind] for kind, tag in LAWS.items() if kind in values}
        dynamics = axis.child("dynamics")
        if dynamics is not None:
            for tag, value in given.items():
                self._set(dynamics, tag, plain([value]), why)
        elif any(given.values()):
            text = "".join(f"<{tag}>{plain([value])}</{tag}>" for tag, value in given.items())
            self._changes.add(axis, f"<dynamics>{text}</dynamics>")
        gear = number(joint, "drake:gear_ratio", 1.0)
        if "motor_inertia" in values and joint.child(_ROTOR) is not None and gear:
            self._set(joint, _ROTOR, plain([values["motor_inertia"] / gear**2]), why)

    def _set(self, parent: Element, tag: str, text: str, why: str) -> None:
        """The text of a child, which the parent may lack."""
        child = parent.child(tag)
        if child is None:
            self._changes.add(parent, f"<{tag}>{text}</{tag}>")
        else:
            self._changes.set(child, "", text, why)
