"""Identified numbers in the text of a URDF: ``<inertial>`` of links, ``<dynamics>`` of joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..bodies.inertia import SpatialInertia
from ..formats.element import Element
from ..formats.inertia_entries import ENTRIES, entries_of
from ..formats.urdf import origin_of
from ..typing import Array
from .text_changes import ELSEWHERE, FOUND, TextChanges, links_of, plain

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
