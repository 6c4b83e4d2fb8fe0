"""Identified numbers in the text of an SDF file: ``<inertial>`` of links, ``<dynamics>`` of the axes of joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..bodies.inertia import SpatialInertia
from ..errors import TwistWrenchError
from ..formats.element import Element
from ..formats.sdf.frames import unpacked
from ..formats.sdf.reader import chosen_model
from ..formats.sdf.values import number, pose
from .text_changes import ELSEWHERE, FOUND, TextChanges, links_of, plain
from .urdf_text import LAWS, products

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
