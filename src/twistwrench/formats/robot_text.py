"""Editable robot files: inertias of links and drives of joints in URDF, SDF and MJCF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import ModelError, TwistWrenchError
from ..core.numbers import file_number
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import quaternion, se3
from . import FORMATS, sdf, urdf
from .edit import ELSEWHERE, FOUND, Edit, TextChanges
from .mjcf import bodies as mjcf
from .mjcf.preprocess import Defaults, Folders, Meshes, Settings, expand
from .urdf import ENTRIES, IN_MJCF
from .xml import MOST_BODIES, Element, Place, exact

_LAWS = {"viscous": "damping", "coulomb": "friction"}
_MJCF_DRIVES = {"viscous": "damping", "coulomb": "frictionloss", "motor_inertia": "armature"}
_TURNED = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_ROTOR = "drake:rotor_inertia"
_COMPILER = "so that inertias are as they are written"


def inertia_about_com(mass: float, com: Array, tensor: Array) -> SpatialInertia:
    """Inertia about the origin; the tensor (3, 3) about the centre of mass is symmetrised."""
    return SpatialInertia.from_com(mass, com, 0.5 * (tensor + tensor.T))


@dataclass(frozen=True, eq=False)
class WrittenInertia:
    """Inertia of a link as in its file: about the centre of mass, with separate axes."""

    mass: float
    com: Array
    """Centre of mass (3,) in the link's frame [m]."""
    R: Array
    """Axes (3, 3) of the tensor in the link's frame."""
    tensor: Array
    """Tensor (3, 3) about the centre of mass, along these axes [kg m²]."""
    places: Mapping[str, Place] = field(default_factory=dict)
    """Places of mass, x, y, z, ixx, ixy, …; numbers without a place cannot be written."""
    line: int = 0
    file: str = ""

    @classmethod
    def from_inertia(cls, G: SpatialInertia, line: int = 0, file: str = "") -> WrittenInertia | None:
        """Inertia of a link without an inertia in the file; None if it is zero."""
        if not G.parameters.any():
            return None
        moments = 0.5 * (G.moment_about_com + G.moment_about_com.T)
        return cls(G.mass, G.com, np.eye(3), moments, line=line, file=file)

    @cached_property
    def inertia(self) -> SpatialInertia:
        """Inertia about the link's origin, in its axes."""
        return self.with_tensor(self.tensor)

    def with_tensor(self, tensor: Array) -> SpatialInertia:
        """Inertia about the link's origin, with another tensor about the centre of mass along the file's axes."""
        return inertia_about_com(self.mass, self.com, self.R @ tensor @ self.R.T)

    def tensor_edits(self, tensor: Array) -> tuple[tuple[Edit, ...], Array]:
        """Edits of the changed entries, and the resulting tensor; no edits if one of the entries has no place."""
        edits, written = [], self.tensor.copy()
        scale = float(np.abs(tensor).max())
        for name, (i, j) in ENTRIES.items():
            if abs(tensor[i, j] - self.tensor[i, j]) <= 1e-12 * scale:
                continue
            if name not in self.places:
                return (), tensor
            edits.append(Edit(self.places[name], file_number(tensor[i, j])))
            written[i, j] = written[j, i] = float(edits[-1].text)
        return tuple(edits), written

    def edits(self, inertia: SpatialInertia) -> tuple[Edit, ...]:
        """Edits for another inertia, including mass and centre of mass; none if a number has no place."""
        moments = self.R.T @ inertia.moment_about_com @ self.R
        scale = float(np.abs(moments).max())
        moments[np.abs(moments) < 1e-9 * scale] = 0.0
        tensor_edits, _ = self.tensor_edits(moments)
        if not tensor_edits and np.abs(moments - self.tensor).max() > 1e-12 * scale:
            return ()
        old_values = {"mass": self.mass, **dict(zip("xyz", self.com.tolist(), strict=True))}
        new_values = {"mass": inertia.mass, **dict(zip("xyz", inertia.com.tolist(), strict=True))}
        edits = list(tensor_edits)
        for name, old_value in old_values.items():
            if abs(new_values[name] - old_value) <= 1e-12 * max(1.0, abs(old_value)):
                continue
            if name not in self.places:
                return ()
            edits.append(Edit(self.places[name], file_number(new_values[name])))
        return tuple(edits)


def _products(moments: Array) -> dict[str, str]:
    """Entries of a tensor (3, 3), symmetrised, as text."""
    return {name: repr(value) for name, value in urdf.entries_of(0.5 * (moments + moments.T)).items()}


class RobotText:
    """Robot file with editable numbers; each format has a subclass."""

    share_left = 0.0
    """Share of a body left in each link that is merged into it."""
    links: dict[str, Element]
    joints: dict[str, Element]
    noun = "link"

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a link in the file."""
        raise NotImplementedError

    def assumed_parts(self, _name: str) -> tuple[str, ...]:
        """Missing parts of a link's inertia for which the format defines a value."""
        return ()

    def write_links(self, changes: TextChanges, wanted: Mapping[str, SpatialInertia]) -> None:
        """Set the inertias of links, each about its frame. Raises ModelError for links that are not in the file."""
        for name in wanted:
            if name not in self.links:
                raise ModelError(f"the file has no {self.noun} {name!r} whose inertia could be written.")
        for name, inertia in wanted.items():
            self._write(changes, name, inertia, FOUND if inertia.parameters.any() else ELSEWHERE)

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        raise NotImplementedError

    def parent(self, link: str) -> str:
        """Link or body in whose frame a link is placed; empty for the world."""
        raise NotImplementedError

    def write_pose(self, changes: TextChanges, link: str, T: Array, why: str) -> None:
        """Set the pose (4, 4) of a link in its parent, at zero of the joint between them."""
        raise NotImplementedError


class UrdfText(RobotText):
    """URDF file: ``<inertial>`` of links, ``<dynamics>`` of joints."""

    def __init__(self, root: Element, _model: str, _path: Path | None) -> None:
        self.links = {element.text("name"): element for element in root.all("link")}
        self.joints = {element.text("name"): element for element in root.all("joint")}
        self.materials = {element.attributes.get("name", ""): element for element in root.all("material")}

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a link in the file."""
        inertial = self.links[name].child("inertial")
        if inertial is None:
            return None
        mass, T, I = urdf.inertial_of(inertial)
        tensor, origin = inertial.require_child("inertia", ""), inertial.child("origin")
        places = {name: tensor.locate(name) for name in ENTRIES}
        places["mass"] = inertial.require_child("mass", "").locate("value")
        if origin is not None and "xyz" in origin.attributes:
            places |= {axis: origin.locate("xyz", k) for k, axis in enumerate("xyz")}
        return WrittenInertia(mass, T[:3, 3], T[:3, :3], I, places, tensor.line)

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        link = self.links[name]
        inertial, com, mass = link.child("inertial"), exact(inertia.com), exact([inertia.mass])
        if not inertia.parameters.any():
            if inertial is None:
                return
            mass, entries = "0", dict.fromkeys(ENTRIES, "0")
        elif inertial is None:
            tensor = " ".join(f'{name}="{text}"' for name, text in _products(inertia.moment_about_com).items())
            origin = f'<origin xyz="{com}" rpy="0 0 0"/>'
            changes.add(link, f'<inertial>{origin}<mass value="{mass}"/><inertia {tensor}/></inertial>')
            return
        else:
            place, R = inertial.child("origin"), urdf.origin_of(inertial)[:3, :3]
            if place is None:
                changes.add(inertial, f'<origin xyz="{com}" rpy="0 0 0"/>')
            else:
                changes.set(place, "xyz", com)
            entries = _products(R.T @ inertia.moment_about_com @ R)
        changes.set(inertial.require_child("mass", ""), "value", mass, why)
        for name, text in entries.items():
            changes.set(inertial.require_child("inertia", ""), name, text, why)

    def _joint_above(self, link: str) -> Element:
        """Joint whose child is a link."""
        return next(j for j in self.joints.values() if j.require_child("child", "").text("link") == link)

    def parent(self, link: str) -> str:
        """Link in whose frame a link is placed."""
        return self._joint_above(link).require_child("parent", "").text("link")

    def write_pose(self, changes: TextChanges, link: str, T: Array, why: str) -> None:
        """Set the ``<origin>`` of the joint above a link."""
        joint = self._joint_above(link)
        origin = joint.child("origin")
        xyz, rpy = exact(T[:3, 3]), exact(urdf.rpy_of_rotation(T[:3, :3]))
        if origin is None:
            changes.add(joint, f'<origin xyz="{xyz}" rpy="{rpy}"/>')
            return
        changes.set(origin, "xyz", xyz, why)
        if "quat_xyzw" in origin.attributes:
            changes.set(origin, "quat_xyzw", exact(np.roll(quaternion.from_matrix(T[:3, :3]), -1)), why)
        else:
            changes.set(origin, "rpy", rpy, why)

    def write_joint(self, changes: TextChanges, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Set the friction of a joint, ``viscous`` and ``coulomb``."""
        joint = self.joints[name]
        dynamics = joint.child("dynamics")
        texts = {_LAWS[kind]: exact([value]) for kind, value in values.items() if kind in _LAWS}
        if dynamics is not None:
            for attribute, text in texts.items():
                changes.set(dynamics, attribute, text, why)
        elif any(map(float, texts.values())):
            entries = " ".join(f'{attribute}="{text}"' for attribute, text in texts.items())
            changes.add(joint, f"<dynamics {entries}/>")


class SdfText(RobotText):
    """One model of an SDF file: ``<inertial>`` of links, ``<dynamics>`` of joint axes."""

    share_left = 1e-3  # libsdformat rejects links without a positive mass

    def __init__(self, root: Element, model: str, _path: Path | None) -> None:
        try:
            element, _ = sdf.chosen_model(root, None)
        except TwistWrenchError:
            element, _ = sdf.chosen_model(root, model)
        parts = sdf.expand_model(element)
        self.links, self.joints = parts.links, parts.joints
        self._axes: dict[str, tuple[Element, Element]] = {}
        for name, joint in parts.joints.items():
            if joint.text("type") in sdf.TWO_AXES:
                axes = {f"{name}.axis": joint.child("axis"), f"{name}.axis2": joint.child("axis2")}
            else:
                axes = {name: joint.child("axis")}
            self._axes |= {axis_name: (axis, joint) for axis_name, axis in axes.items() if axis is not None}

    def assumed_parts(self, name: str) -> tuple[str, ...]:
        """Missing parts of a link's inertia for which the format defines a value."""
        return sdf.missing_of(self.links[name].child("inertial"))

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a link; missing parts have the format's default values, without places."""
        link = self.links[name]
        inertial = link.child("inertial")
        mass, T, I = sdf.inertial_of(inertial)
        tensor = inertial.child("inertia") if inertial is not None else None
        elements = {"mass": inertial.child("mass") if inertial is not None else None}
        if tensor is not None:
            elements |= {entry: tensor.child(entry) for entry in ENTRIES}
        places = {entry: element.locate() for entry, element in elements.items() if element is not None}
        line = tensor.line if tensor is not None else link.line
        return WrittenInertia(mass, T[:3, 3], T[:3, :3], I, places, line)

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        link = self.links[name]
        inertial = link.child("inertial")
        place = inertial.child("pose") if inertial is not None else None
        R = sdf.pose(place)[:3, :3]
        com, mass = exact(inertia.com), exact([inertia.mass])
        entries = _products(R.T @ inertia.moment_about_com @ R)
        tensor = "".join(f"<{name}>{text}</{name}>" for name, text in entries.items())
        if inertial is None:
            changes.add(
                link, f"<inertial><pose>{com} 0 0 0</pose><mass>{mass}</mass><inertia>{tensor}</inertia></inertial>"
            )
            return
        if place is None:
            changes.add(inertial, f"<pose>{com} 0 0 0</pose>")
        elif not place.content.strip():
            identity = "0 0 0 1" if place.attributes.get("rotation_format", "") == "quat_xyzw" else "0 0 0"
            changes.set(place, "", f"{com} {identity}", why)
        else:
            changes.set(place, "", " ".join([com, *place.content.split()[3:]]), why)
        changes.set_child(inertial, "mass", mass, why)
        inner = inertial.child("inertia")
        if inner is None:
            changes.add(inertial, f"<inertia>{tensor}</inertia>")
            return
        for name, text in entries.items():
            changes.set_child(inner, name, text, why)

    def write_joint(self, changes: TextChanges, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Set the friction of a joint, and the inertia of its motor if the file has ``drake:rotor_inertia``."""
        axis, joint = self._axes[name]
        dynamics_values = {tag: values[kind] for kind, tag in _LAWS.items() if kind in values}
        dynamics = axis.child("dynamics")
        if dynamics is not None:
            for tag, value in dynamics_values.items():
                changes.set_child(dynamics, tag, exact([value]), why)
        elif any(dynamics_values.values()):
            text = "".join(f"<{tag}>{exact([value])}</{tag}>" for tag, value in dynamics_values.items())
            changes.add(axis, f"<dynamics>{text}</dynamics>")
        gear = sdf.number(joint, "drake:gear_ratio", 1.0)
        if "motor_inertia" in values and joint.child(_ROTOR) is not None and gear:
            changes.set_child(joint, _ROTOR, exact([values["motor_inertia"] / gear**2]), why)


class MjcfText(RobotText):
    """MJCF file: ``<inertial>`` of bodies; damping, frictionloss and armature of joints.

    Settings of ``<compiler>`` that would change written values (inertiafromgeom, settotalmass, boundmass, …) are
    removed. Other bodies affected by these settings are then written with their compiled values.
    """

    noun = "body"

    def __init__(self, root: Element, _model: str, path: Path | None) -> None:
        folders = Folders(None if path is None else path.parent)
        expand(root, folders, MOST_BODIES)
        self._root, self.settings, defaults = root, Settings.from_root(root), Defaults(root)
        self.meshes = Meshes(root, self.settings, defaults, folders)
        self._world_and_bodies = mjcf.survey(root, self.settings, defaults)
        bodies = self._world_and_bodies[1:]
        self.bodies = {body.name: body for body in bodies}
        self.links = {body.name: body.element for body in bodies}
        names = mjcf.names_given(self._world_and_bodies)
        self.joints = {}
        self._raw: dict[str, Element] = {}  # without class defaults
        for body in bodies:
            joints = mjcf.joints_of(body, self.settings, names)
            for joint, raw in zip(joints, _joints_in(body.element), strict=True):
                self.joints[joint.name] = joint.element
                self._raw[joint.name] = raw

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a body in ``<inertial>``, regardless of compiler settings."""
        inertial = self.bodies[name].inertial
        if inertial is None:
            return None
        element = inertial.element
        mass, T, I = mjcf.inertial_of(element, self.settings)
        T = inertial.frame @ T
        places: dict[str, Place] = {}
        if not element.file:
            full = "fullinertia" in element.attributes
            attribute, entries = ("fullinertia", IN_MJCF) if full else ("diaginertia", IN_MJCF[:3])
            places["mass"] = element.locate("mass")
            if attribute in element.attributes:
                places |= {entry: element.locate(attribute, k) for k, entry in enumerate(entries)}
        return WrittenInertia(mass, T[:3, 3], T[:3, :3], I, places, element.line, element.file)

    def write_links(self, changes: TextChanges, wanted: Mapping[str, SpatialInertia]) -> None:
        """Set the inertias of bodies, each about its frame. Raises ModelError for bodies that are not in the file."""
        super().write_links(changes, wanted)
        neutral_settings = self._neutral_settings(wanted)
        if not neutral_settings:
            return
        for compiler in self._root.all("compiler"):
            for attribute, (_, _, text) in neutral_settings.items():
                if attribute in compiler.attributes:
                    changes.set(compiler, attribute, text, _COMPILER)
        neutral = replace(self.settings, **{field: value for field, value, _ in neutral_settings.values()})
        bodies = self._world_and_bodies
        compiled = mjcf.inertias_of(bodies, self.settings, self.meshes).each
        uncorrected = mjcf.inertias_of(bodies, neutral, self.meshes).each
        for body, G, G_neutral in zip(bodies, compiled, uncorrected, strict=True):
            if body.name not in wanted and not np.array_equal(G.parameters, G_neutral.parameters):
                self._write(changes, body.name, G, _COMPILER)

    def _neutral_settings(self, wanted: Mapping[str, SpatialInertia]) -> dict[str, tuple[str, Any, str]]:
        """Attributes of ``<compiler>`` that would change written inertias: setting, neutral value, and its text."""
        settings, neutral = self.settings, dict[str, tuple[str, Any, str]]()
        moments = np.array([np.linalg.eigvalsh(G.moment_about_com) for G in wanted.values()]).reshape(-1, 3)
        if settings.from_geoms == "true":
            neutral["inertiafromgeom"] = ("from_geoms", "auto", "auto")
        if settings.total_mass > 0:
            neutral["settotalmass"] = ("total_mass", -1.0, "-1")
        if any(G.mass < settings.least_mass for G in wanted.values()):
            neutral["boundmass"] = ("least_mass", 0.0, "0")
        if (moments < settings.least_moment).any():
            neutral["boundinertia"] = ("least_moment", 0.0, "0")
        if settings.balanced and (moments[:, 0] + moments[:, 1] < moments[:, 2]).any():
            neutral["balanceinertia"] = ("balanced", False, "false")
        return neutral

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        body = self.bodies[name]
        inertial = body.inertial
        own = inertia if inertial is None else inertia.in_frame(np.asarray(se3.inverse(inertial.frame)))
        I = 0.5 * (own.moment_about_com + own.moment_about_com.T)
        texts = {"pos": "0 0 0", "mass": exact([own.mass]), "diaginertia": "0 0 0"}
        other = "fullinertia"
        if own.parameters.any():  # MuJoCo rejects a fullinertia of zeros
            entries = [I[ENTRIES[entry]] for entry in IN_MJCF]
            texts = {"pos": exact(own.com), "mass": exact([own.mass]), "fullinertia": exact(entries)}
            other = "diaginertia"
        if inertial is None:
            attributes = " ".join(f'{attribute}="{text}"' for attribute, text in texts.items())
            changes.add(body.element, f"<inertial {attributes}/>")
            return
        for attribute, text in texts.items():
            changes.set(inertial.element, attribute, text, why)
        for attribute in (other, *_TURNED):
            if attribute in inertial.element.attributes:
                changes.remove(inertial.element, attribute, why)

    def parent(self, link: str) -> str:
        """Body that contains a body; empty for the world."""
        element = self.links[link].parent
        while element is not None and element.tag not in ("body", "worldbody"):
            element = element.parent
        if element is None or element.tag != "body":
            return ""
        return element.attributes.get("name", "")

    def write_pose(self, changes: TextChanges, link: str, T: Array, why: str) -> None:
        """Set ``pos`` and ``quat`` of a body, in place of other forms of its orientation."""
        body = self.links[link]
        changes.set(body, "pos", exact(T[:3, 3]), why)
        changes.set(body, "quat", exact(quaternion.from_matrix(T[:3, :3])), why)
        for name in _TURNED[1:]:
            if name in body.attributes:
                changes.remove(body, name, why)

    def joint_element(self, name: str) -> Element:
        """Element of a joint."""
        return self._raw[name]

    def write_joint(self, changes: TextChanges, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Set the friction and armature of a joint; zeros are written only to override a value of the file or class."""
        for kind, attribute in _MJCF_DRIVES.items():
            if kind in values and (values[kind] or attribute in self.joints[name].attributes):
                changes.set(self._raw[name], attribute, exact([values[kind]]), why)


def _joints_in(element: Element) -> Iterator[Element]:
    """Joint elements of a body in document order, including those within frames."""
    for child in element.children:
        if child.tag in ("joint", "freejoint"):
            yield child
        elif child.tag == "frame":
            yield from _joints_in(child)


TEXTS: Mapping[str, type[UrdfText] | type[MjcfText] | type[SdfText]] = {
    "urdf": UrdfText,
    "mjcf": MjcfText,
    "sdf": SdfText,
}


def text_of(root: Element, model: str, path: Path | None) -> UrdfText | MjcfText | SdfText:
    """File with editable numbers; ``model`` names the model of an SDF world."""
    form = next(name for name, tag in FORMATS.items() if root.tag == tag)
    return TEXTS[form](root, model, path)
