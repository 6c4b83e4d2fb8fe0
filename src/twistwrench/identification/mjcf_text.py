"""Identified numbers in the text of an MJCF file: ``<inertial>`` of bodies; damping, frictionloss and armature of joints.

What ``<compiler>`` does to inertias (inertiafromgeom, settotalmass, boundmass, …) is taken out where it would change what is
written; bodies that it has changed otherwise are then written as they were.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import ModelError
from ..formats.element import Element
from ..formats.inertia_entries import ENTRIES, IN_MJCF
from ..formats.mjcf.bodies import MjcfBody, survey
from ..formats.mjcf.defaults import Defaults
from ..formats.mjcf.includes import Folders, expand
from ..formats.mjcf.inertial import inertias_of
from ..formats.mjcf.joints import joints_of, names_given
from ..formats.mjcf.meshes import Meshes
from ..formats.mjcf.settings import Settings
from ..lie import se3
from .text_changes import ELSEWHERE, FOUND, TextChanges, plain

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
        self._settings, self._defaults = Settings.of(root), Defaults(root)
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
