"""The inertia of bodies: as given, or of their geoms, then corrected as ``<compiler>`` says, in MuJoCo's order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...core.printed_numbers import printed
from ...errors import RobotFileError
from ...lie.identity import is_identity
from ...typing import Array
from ..element import Element
from ..inertia_entries import IN_MJCF, tensor_of
from .bodies import MjcfBody, PlacedElement
from .geoms import inertia_of_geom, weighs
from .meshes import Meshes
from .placement import placement
from .settings import Settings


@dataclass(frozen=True)
class Inertias:
    """Of each body, about its frame's origin, in the order of the bodies; and what was done to them."""

    each: list[SpatialInertia]
    remarks: list[str]


def inertias_of(bodies: Sequence[MjcfBody], settings: Settings, meshes: Meshes) -> Inertias:
    """The world has none."""
    remarks: list[str] = []
    given = ((body, _inertia(body, settings, meshes, remarks)) for body in bodies[1:])
    found = [SpatialInertia.zero(), *(_corrected(G, body, settings, remarks) for body, G in given)]
    if settings.total_mass > 0:
        total = sum(G.mass for G in found)
        if total > 0:
            factor = settings.total_mass / total
            found = [SpatialInertia.from_parameters(factor * G.parameters) for G in found]
            remarks.append(
                f"settotalmass={printed(settings.total_mass)}: all masses and inertias are multiplied by {printed(factor)}"
            )
    return Inertias(found, remarks)


def _inertia(body: MjcfBody, settings: Settings, meshes: Meshes, remarks: list[str]) -> SpatialInertia:
    from_geoms = settings.from_geoms == "true" or (settings.from_geoms == "auto" and body.inertial is None)
    counted = [part for part in body.geoms if from_geoms and weighs(part.element, settings)]
    if body.inertial is not None and not (from_geoms and _selected(body, settings)):
        return _given(body.inertial, settings)
    total = SpatialInertia.zero()
    for part in counted:
        try:
            total = total + inertia_of_geom(part, settings, meshes)
        except RobotFileError as error:
            if body.moves:
                raise
            remarks.append(f"body {body.name!r} does not move, and its inertia is not complete: {error}")
    return total


def _selected(body: MjcfBody, settings: Settings) -> bool:
    """Whether any geom is of the groups that count: where none is, what is given stays."""
    first, last = settings.groups
    return any(first <= part.element.floats("group", (0.0,))[0] <= last for part in body.geoms)


def _given(given: PlacedElement, settings: Settings) -> SpatialInertia:
    """About the body's origin, in its axes."""
    inertial = given.element
    T = placement(inertial, settings)
    mass = inertial.number("mass")
    said = [name for name in ("diaginertia", "fullinertia") if name in inertial.attributes]
    if len(said) > 1:
        raise RobotFileError(f"{inertial} has both diaginertia and fullinertia. Keep one.")
    if not said:
        moments = np.zeros((3, 3))
    elif said[0] == "diaginertia":
        moments = np.diag(inertial.numbers("diaginertia", 3))
    else:
        moments = full_inertia(inertial)
        if set(inertial.attributes) & {"quat", "axisangle", "xyaxes", "zaxis", "euler"}:
            raise RobotFileError(
                f"{inertial} has fullinertia, which is along the body's axes, and an orientation. Keep one."
            )
    R = T[:3, :3]
    G = SpatialInertia.from_com(mass, T[:3, 3], R @ moments @ R.T)
    return G if is_identity(given.frame) else G.in_frame(given.frame)


def full_inertia(inertial: Element) -> Array:
    """The tensor (3, 3) of a ``fullinertia``."""
    return tensor_of(dict(zip(IN_MJCF, inertial.numbers("fullinertia", 6).tolist(), strict=True)).__getitem__)


def _corrected(G: SpatialInertia, body: MjcfBody, settings: Settings, remarks: list[str]) -> SpatialInertia:
    """With the least mass and moments of ``<compiler>``, and balanced if it says so."""
    if not (settings.least_mass > 0 or settings.least_moment > 0 or settings.balanced):
        return G
    mass = max(G.mass, settings.least_mass)
    moments, axes = np.linalg.eigh(G.moment_about_com)
    wanted = np.maximum(moments, settings.least_moment)
    said = [f"boundmass={printed(settings.least_mass)}"] if mass > G.mass else []
    said += [f"boundinertia={printed(settings.least_moment)}"] if (wanted > moments).any() else []
    if settings.balanced and wanted[0] + wanted[1] < wanted[2]:
        wanted = np.full(3, wanted.mean())
        said.append("balanceinertia")
    if not said:
        return G
    remarks.append(
        f"{' and '.join(said)} of <compiler> change body {body.name!r} ({body.element.place}): mass {printed(G.mass)} to "
        f"{printed(mass)} kg, principal moments {moments.round(12).tolist()} to {wanted.round(12).tolist()} kg m²"
    )
    com = G.com if G.mass else np.zeros(3)
    return SpatialInertia.from_com(mass, com, (axes * wanted) @ axes.T)
