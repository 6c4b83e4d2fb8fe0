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

_DYNAMICS_NAMES = {"viscous": "damping", "coulomb": "friction"}
"""Names in ``<dynamics>`` of URDF and SDF, by the library's name."""
_MJCF_DRIVE_ATTRIBUTES = {"viscous": "damping", "coulomb": "frictionloss", "motor_inertia": "armature"}
"""Attributes of joints in MJCF, by the library's name."""
_OTHER_ORIENTATION_ATTRIBUTES = ("axisangle", "xyaxes", "zaxis", "euler")
"""Forms of an orientation in MJCF other than ``quat``."""
_ROTOR_INERTIA_TAG = "drake:rotor_inertia"
_REASON_OF_COMPILER_EDITS = "so that inertias are as they are written"
_MAX_EQUAL_DIFFERENCE = 1e-12
"""Relative difference of two numbers up to which they are equal."""
_MAX_ROUND_OFF = 1e-9
"""Entry of a rotated tensor, as a share of its largest entry, that is a rounding error of the rotation."""


def inertia_about_com(mass: float, com: Array, tensor: Array) -> SpatialInertia:
    """Inertia about the origin, from the tensor (3, 3) about the centre of mass, which is symmetrised."""
    return SpatialInertia.from_com(mass, com, 0.5 * (tensor + tensor.T))


@dataclass(frozen=True, eq=False)
class WrittenInertia:
    """Inertia of a link as its file states it: about the centre of mass, along axes that may differ from the link's."""

    mass: float
    com: Array
    """Centre of mass (3,) in the link's frame [m]."""
    R: Array
    """Axes (3, 3) of the tensor in the link's frame."""
    tensor: Array
    """Tensor (3, 3) about the centre of mass, along these axes [kg m²]."""
    places: Mapping[str, Place] = field(default_factory=dict)
    """Places in the file of mass, x, y, z, ixx, ixy, …; numbers without a place cannot be edited."""
    line: int = 0
    """Line in the file; 0 if unknown."""
    file: str = ""
    """Included file; empty for the robot file itself."""

    @classmethod
    def from_inertia(cls, G: SpatialInertia, line: int = 0, file: str = "") -> WrittenInertia | None:
        """Inertia of a link for which the file states none, such as from shapes; None if it is zero."""
        if not G.parameters.any():
            return None
        tensor = 0.5 * (G.moment_about_com + G.moment_about_com.T)
        return cls(G.mass, G.com, np.eye(3), tensor, line=line, file=file)

    @cached_property
    def inertia(self) -> SpatialInertia:
        """Inertia about the link's origin, in its axes."""
        return self.with_tensor(self.tensor)

    def with_tensor(self, tensor: Array) -> SpatialInertia:
        """Inertia about the link's origin, with another tensor about the centre of mass along the file's axes."""
        return inertia_about_com(self.mass, self.com, self.R @ tensor @ self.R.T)

    def tensor_edits(self, tensor: Array) -> tuple[tuple[Edit, ...], Array]:
        """Edits of the entries that change, and the tensor of the rounded numbers in the edited file.

        If an entry that changes has no place, there are no edits, and the tensor is returned as it is.
        """
        edits: list[Edit] = []
        written_tensor = self.tensor.copy()
        scale = float(np.abs(tensor).max())
        for name, (i, j) in ENTRIES.items():
            if abs(tensor[i, j] - self.tensor[i, j]) <= _MAX_EQUAL_DIFFERENCE * scale:
                continue
            if name not in self.places:
                return (), tensor
            text = file_number(tensor[i, j])
            edits.append(Edit(self.places[name], text))
            written_tensor[i, j] = written_tensor[j, i] = float(text)
        return tuple(edits), written_tensor

    def edits(self, inertia: SpatialInertia) -> tuple[Edit, ...]:
        """Edits that give the link another inertia; none if a number that changes has no place."""
        tensor = self.R.T @ inertia.moment_about_com @ self.R
        scale = float(np.abs(tensor).max())
        tensor[np.abs(tensor) < _MAX_ROUND_OFF * scale] = 0.0
        tensor_edits, _ = self.tensor_edits(tensor)
        is_changed = np.abs(tensor - self.tensor).max() > _MAX_EQUAL_DIFFERENCE * scale
        if is_changed and not tensor_edits:
            return ()
        old_values = {"mass": self.mass, **dict(zip("xyz", self.com.tolist(), strict=True))}
        new_values = {"mass": inertia.mass, **dict(zip("xyz", inertia.com.tolist(), strict=True))}
        edits = list(tensor_edits)
        for name, old_value in old_values.items():
            if abs(new_values[name] - old_value) <= _MAX_EQUAL_DIFFERENCE * max(1.0, abs(old_value)):
                continue
            if name not in self.places:
                return ()
            edits.append(Edit(self.places[name], file_number(new_values[name])))
        return tuple(edits)


def _entry_texts(tensor: Array) -> dict[str, str]:
    """Texts of the six entries (``ixx`` and others) of a tensor (3, 3), which is symmetrised."""
    symmetric = 0.5 * (tensor + tensor.T)
    return {name: repr(value) for name, value in urdf.entries_of(symmetric).items()}


class RobotText:
    """Robot file with editable numbers; each format has a subclass."""

    share_left = 0.0
    """Share of a body's inertia that is left in each link merged into the body."""
    links: dict[str, Element]
    """Elements of links or bodies, by name."""
    joints: dict[str, Element]
    """Elements of joints, by name."""
    noun = "link"
    """The format's word for a link, for messages."""

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a link in the file; None without one."""
        raise NotImplementedError

    def assumed_parts(self, _name: str) -> tuple[str, ...]:
        """Missing parts of a link's inertia for which the format defines a value."""
        return ()

    def write_links(self, changes: TextChanges, wanted: Mapping[str, SpatialInertia]) -> None:
        """Set the ``wanted`` inertias of links, each about its frame; raises ModelError for links that the file lacks."""
        for name in wanted:
            if name not in self.links:
                raise ModelError(f"the file has no {self.noun} {name!r} whose inertia could be written.")
        for name, inertia in wanted.items():
            reason = ELSEWHERE
            if inertia.parameters.any():
                reason = FOUND
            self._write(changes, name, inertia, reason)

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        """Set the inertia of a link about its frame; ``why`` is the reason of the edits."""
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
        """Inertia of a link in the file; None without one."""
        inertial = self.links[name].child("inertial")
        if inertial is None:
            return None
        mass, T, I = urdf.inertial_of(inertial)
        tensor_element = inertial.require_child("inertia", "")
        origin = inertial.child("origin")
        places = {entry: tensor_element.locate(entry) for entry in ENTRIES}
        places["mass"] = inertial.require_child("mass", "").locate("value")
        if origin is not None and "xyz" in origin.attributes:
            places |= {axis: origin.locate("xyz", k) for k, axis in enumerate("xyz")}
        return WrittenInertia(mass, T[:3, 3], T[:3, :3], I, places, tensor_element.line)

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        link = self.links[name]
        inertial = link.child("inertial")
        com = exact(inertia.com)
        mass = exact([inertia.mass])
        if not inertia.parameters.any():
            if inertial is None:
                return
            mass = "0"
            entries = dict.fromkeys(ENTRIES, "0")
        elif inertial is None:
            texts = _entry_texts(inertia.moment_about_com)
            tensor_attributes = " ".join(f'{entry}="{text}"' for entry, text in texts.items())
            origin = f'<origin xyz="{com}" rpy="0 0 0"/>'
            changes.add(link, f'<inertial>{origin}<mass value="{mass}"/><inertia {tensor_attributes}/></inertial>')
            return
        else:
            origin_element = inertial.child("origin")
            R = urdf.origin_of(inertial)[:3, :3]
            if origin_element is None:
                changes.add(inertial, f'<origin xyz="{com}" rpy="0 0 0"/>')
            else:
                changes.set(origin_element, "xyz", com)
            entries = _entry_texts(R.T @ inertia.moment_about_com @ R)
        changes.set(inertial.require_child("mass", ""), "value", mass, why)
        tensor_element = inertial.require_child("inertia", "")
        for entry, text in entries.items():
            changes.set(tensor_element, entry, text, why)

    def _joint_above(self, link: str) -> Element:
        """Joint whose child is a link."""
        joints = self.joints.values()
        return next(joint for joint in joints if joint.require_child("child", "").text("link") == link)

    def parent(self, link: str) -> str:
        """Link in whose frame a link is placed."""
        return self._joint_above(link).require_child("parent", "").text("link")

    def write_pose(self, changes: TextChanges, link: str, T: Array, why: str) -> None:
        """Set the ``<origin>`` of the joint above a link."""
        joint = self._joint_above(link)
        origin = joint.child("origin")
        xyz = exact(T[:3, 3])
        rpy = exact(urdf.rpy_of_rotation(T[:3, :3]))
        if origin is None:
            changes.add(joint, f'<origin xyz="{xyz}" rpy="{rpy}"/>')
            return
        changes.set(origin, "xyz", xyz, why)
        if "quat_xyzw" in origin.attributes:
            xyzw = np.roll(quaternion.from_matrix(T[:3, :3]), -1)
            changes.set(origin, "quat_xyzw", exact(xyzw), why)
        else:
            changes.set(origin, "rpy", rpy, why)

    def write_joint(self, changes: TextChanges, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Set the friction of a joint, ``viscous`` and ``coulomb``; zeros are written only in place of other values."""
        joint = self.joints[name]
        dynamics = joint.child("dynamics")
        texts = {_DYNAMICS_NAMES[kind]: exact([value]) for kind, value in values.items() if kind in _DYNAMICS_NAMES}
        if dynamics is not None:
            for attribute, text in texts.items():
                changes.set(dynamics, attribute, text, why)
        elif any(map(float, texts.values())):
            attributes = " ".join(f'{attribute}="{text}"' for attribute, text in texts.items())
            changes.add(joint, f"<dynamics {attributes}/>")


class SdfText(RobotText):
    """One model of an SDF file: ``<inertial>`` of links, ``<dynamics>`` of joint axes."""

    share_left = 1e-3  # libsdformat rejects links without a positive mass

    def __init__(self, root: Element, model: str, _path: Path | None) -> None:
        try:
            element, _ = sdf.chosen_model(root, None)
        except TwistWrenchError:  # several models
            element, _ = sdf.chosen_model(root, model)
        parts = sdf.expand_model(element)
        self.links = parts.links
        self.joints = parts.joints
        self._axes: dict[str, tuple[Element, Element]] = {}
        """Axis element and joint element by the library's name of the joint."""
        for name, joint in parts.joints.items():
            if joint.text("type") in sdf.TWO_AXES:
                axis_by_name = {f"{name}.axis": joint.child("axis"), f"{name}.axis2": joint.child("axis2")}
            else:
                axis_by_name = {name: joint.child("axis")}
            for axis_name, axis in axis_by_name.items():
                if axis is not None:
                    self._axes[axis_name] = (axis, joint)

    def assumed_parts(self, name: str) -> tuple[str, ...]:
        """Missing parts of a link's inertia for which the format defines a value."""
        return sdf.missing_of(self.links[name].child("inertial"))

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a link; missing parts have the format's default values, without places."""
        link = self.links[name]
        inertial = link.child("inertial")
        mass, T, I = sdf.inertial_of(inertial)
        line = link.line
        elements: dict[str, Element | None] = {}
        if inertial is not None:
            elements["mass"] = inertial.child("mass")
            tensor = inertial.child("inertia")
            if tensor is not None:
                elements |= {entry: tensor.child(entry) for entry in ENTRIES}
                line = tensor.line
        places = {entry: element.locate() for entry, element in elements.items() if element is not None}
        return WrittenInertia(mass, T[:3, 3], T[:3, :3], I, places, line)

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        link = self.links[name]
        inertial = link.child("inertial")
        pose = None
        if inertial is not None:
            pose = inertial.child("pose")
        R = sdf.pose(pose)[:3, :3]
        com = exact(inertia.com)
        mass = exact([inertia.mass])
        entries = _entry_texts(R.T @ inertia.moment_about_com @ R)
        tensor_elements = "".join(f"<{entry}>{text}</{entry}>" for entry, text in entries.items())
        if inertial is None:
            parts = f"<pose>{com} 0 0 0</pose><mass>{mass}</mass><inertia>{tensor_elements}</inertia>"
            changes.add(link, f"<inertial>{parts}</inertial>")
            return
        if pose is None:
            changes.add(inertial, f"<pose>{com} 0 0 0</pose>")
        elif not pose.content.strip():
            identity = "0 0 0"
            if pose.attributes.get("rotation_format", "") == "quat_xyzw":
                identity = "0 0 0 1"
            changes.set(pose, "", f"{com} {identity}", why)
        else:
            orientation_words = pose.content.split()[3:]  # after the position
            changes.set(pose, "", " ".join([com, *orientation_words]), why)
        changes.set_child(inertial, "mass", mass, why)
        inertia_element = inertial.child("inertia")
        if inertia_element is None:
            changes.add(inertial, f"<inertia>{tensor_elements}</inertia>")
            return
        for entry, text in entries.items():
            changes.set_child(inertia_element, entry, text, why)

    def write_joint(self, changes: TextChanges, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Set the friction of a joint, and the inertia of its motor if the file has ``drake:rotor_inertia``."""
        axis, joint = self._axes[name]
        dynamics_values = {tag: values[kind] for kind, tag in _DYNAMICS_NAMES.items() if kind in values}
        dynamics = axis.child("dynamics")
        if dynamics is not None:
            for tag, value in dynamics_values.items():
                changes.set_child(dynamics, tag, exact([value]), why)
        elif any(dynamics_values.values()):
            text = "".join(f"<{tag}>{exact([value])}</{tag}>" for tag, value in dynamics_values.items())
            changes.add(axis, f"<dynamics>{text}</dynamics>")
        gear_ratio = sdf.number(joint, "drake:gear_ratio", 1.0)
        has_rotor = joint.child(_ROTOR_INERTIA_TAG) is not None
        if "motor_inertia" in values and has_rotor and gear_ratio:
            rotor_inertia = values["motor_inertia"] / gear_ratio**2
            changes.set_child(joint, _ROTOR_INERTIA_TAG, exact([rotor_inertia]), why)


class MjcfText(RobotText):
    """MJCF file: ``<inertial>`` of bodies; damping, frictionloss and armature of joints.

    Settings of ``<compiler>`` that would change written values (inertiafromgeom, settotalmass, boundmass, …) are removed.
    Other bodies that the removed settings changed are written with their compiled values.
    """

    noun = "body"

    def __init__(self, root: Element, _model: str, path: Path | None) -> None:
        folders = Folders(None if path is None else path.parent)
        expand(root, folders, MOST_BODIES)
        self._root = root
        self.settings = Settings.from_root(root)
        defaults = Defaults(root)
        self.meshes = Meshes(root, self.settings, defaults, folders)
        self._world_and_bodies = mjcf.survey(root, self.settings, defaults)
        bodies = self._world_and_bodies[1:]
        self.bodies = {body.name: body for body in bodies}
        self.links = {body.name: body.element for body in bodies}
        names = mjcf.names_given(self._world_and_bodies)
        self.joints = {}
        self._joint_elements: dict[str, Element] = {}
        """Elements of joints as in the file; the elements in ``joints`` also have the defaults of their classes."""
        for body in bodies:
            joints = mjcf.joints_of(body, self.settings, names)
            for joint, element_in_file in zip(joints, _joints_in(body.element), strict=True):
                self.joints[joint.name] = joint.element
                self._joint_elements[joint.name] = element_in_file

    def inertia(self, name: str) -> WrittenInertia | None:
        """Inertia of a body by its ``<inertial>``, without the effect of compiler settings; None without ``<inertial>``."""
        inertial = self.bodies[name].inertial
        if inertial is None:
            return None
        element = inertial.element
        mass, T, I = mjcf.inertial_of(element, self.settings)
        T = inertial.frame @ T
        places: dict[str, Place] = {}
        if not element.file:
            attribute = "diaginertia"
            entries: tuple[str, ...] = IN_MJCF[:3]
            if "fullinertia" in element.attributes:
                attribute = "fullinertia"
                entries = IN_MJCF
            places["mass"] = element.locate("mass")
            if attribute in element.attributes:
                places |= {entry: element.locate(attribute, k) for k, entry in enumerate(entries)}
        return WrittenInertia(mass, T[:3, 3], T[:3, :3], I, places, element.line, element.file)

    def write_links(self, changes: TextChanges, wanted: Mapping[str, SpatialInertia]) -> None:
        """Set the ``wanted`` inertias of bodies, each about its frame; raises ModelError for bodies that the file lacks."""
        super().write_links(changes, wanted)
        neutral_settings = self._neutral_settings(wanted)
        if not neutral_settings:
            return
        for compiler in self._root.all("compiler"):
            for attribute, (_, _, text) in neutral_settings.items():
                if attribute in compiler.attributes:
                    changes.set(compiler, attribute, text, _REASON_OF_COMPILER_EDITS)
        # Bodies that the removed settings would change are written, too.
        neutral_fields = {field: value for field, value, _ in neutral_settings.values()}
        without_settings = replace(self.settings, **neutral_fields)
        bodies = self._world_and_bodies
        compiled = mjcf.inertias_of(bodies, self.settings, self.meshes).each
        neutral = mjcf.inertias_of(bodies, without_settings, self.meshes).each
        for body, G, G_neutral in zip(bodies, compiled, neutral, strict=True):
            is_changed = not np.array_equal(G.parameters, G_neutral.parameters)
            if body.name not in wanted and is_changed:
                self._write(changes, body.name, G, _REASON_OF_COMPILER_EDITS)

    def _neutral_settings(self, wanted: Mapping[str, SpatialInertia]) -> dict[str, tuple[str, Any, str]]:
        """Neutral values of the ``<compiler>`` attributes that would change ``wanted``: field of Settings, value, text."""
        settings = self.settings
        neutral: dict[str, tuple[str, Any, str]] = {}
        moments_of_bodies = [np.linalg.eigvalsh(G.moment_about_com) for G in wanted.values()]
        moments = np.array(moments_of_bodies).reshape(-1, 3)  # principal ones, in ascending order
        smallest, middle, largest = moments.T
        if settings.from_geoms == "true":
            neutral["inertiafromgeom"] = ("from_geoms", "auto", "auto")
        if settings.total_mass > 0:
            neutral["settotalmass"] = ("total_mass", -1.0, "-1")
        if any(G.mass < settings.least_mass for G in wanted.values()):
            neutral["boundmass"] = ("least_mass", 0.0, "0")
        if (moments < settings.least_moment).any():
            neutral["boundinertia"] = ("least_moment", 0.0, "0")
        if settings.balanced and (smallest + middle < largest).any():
            neutral["balanceinertia"] = ("balanced", False, "false")
        return neutral

    def _write(self, changes: TextChanges, name: str, inertia: SpatialInertia, why: str) -> None:
        body = self.bodies[name]
        inertial = body.inertial
        G = inertia
        if inertial is not None:  # it may stand in a <frame>
            G = inertia.in_frame(np.asarray(se3.inverse(inertial.frame)))
        I = 0.5 * (G.moment_about_com + G.moment_about_com.T)
        texts = {"pos": exact(G.com), "mass": exact([G.mass])}
        moments_of_point = G.mass * (G.com @ G.com)  # about the origin, subtracted in I
        has_moments = np.abs(I).max() > _MAX_EQUAL_DIFFERENCE * moments_of_point
        if has_moments:
            texts["fullinertia"] = exact([I[ENTRIES[entry]] for entry in IN_MJCF])
            replaced_attribute = "diaginertia"
        else:  # MuJoCo rejects a fullinertia of zeros
            texts["diaginertia"] = "0 0 0"
            replaced_attribute = "fullinertia"
        if inertial is None:
            attributes = " ".join(f'{attribute}="{text}"' for attribute, text in texts.items())
            changes.add(body.element, f"<inertial {attributes}/>")
            return
        for attribute, text in texts.items():
            changes.set(inertial.element, attribute, text, why)
        for attribute in (replaced_attribute, "quat", *_OTHER_ORIENTATION_ATTRIBUTES):
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
        for attribute in _OTHER_ORIENTATION_ATTRIBUTES:
            if attribute in body.attributes:
                changes.remove(body, attribute, why)

    def joint_element(self, name: str) -> Element:
        """Element of a joint, as in the file."""
        return self._joint_elements[name]

    def write_joint(self, changes: TextChanges, name: str, values: Mapping[str, float], why: str = FOUND) -> None:
        """Set the friction and armature of a joint; zeros are written only to override a value of the file or class."""
        for kind, attribute in _MJCF_DRIVE_ATTRIBUTES.items():
            if kind not in values:
                continue
            if values[kind] or attribute in self.joints[name].attributes:
                changes.set(self._joint_elements[name], attribute, exact([values[kind]]), why)


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
"""Class of editable files by format."""


def text_of(root: Element, model: str, path: Path | None) -> UrdfText | MjcfText | SdfText:
    """Editable file of the format that the root element shows; ``model`` names the model of an SDF world."""
    format_name = next(name for name, tag in FORMATS.items() if root.tag == tag)
    return TEXTS[format_name](root, model, path)
