"""Inertia of geoms: uniform solids of a shape, mass before density."""

from __future__ import annotations

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...core.printed_numbers import printed
from ...errors import RobotFileError
from ...lie import se3
from ...lie.identity import product
from ...typing import Array
from ..element import Element
from .bodies import PlacedElement
from .meshes import Meshes
from .placement import direction, onto, placement
from .settings import Settings

_WATER = 1000.0
"""kg/m³, the format's density."""
WITHOUT_SHAPE = ("plane", "hfield")
"""Types without a shape of their own; a plane has no mass either."""
_TYPES = (*WITHOUT_SHAPE, "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_LENGTHS = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
_ALONG = ("capsule", "cylinder", "ellipsoid", "box")
"""Shapes that may be given by the ends of their axis."""


def weighs(geom: Element, settings: Settings) -> bool:
    """Whether a geom has inertia: by its group, its mass or density, and its shape."""
    first, last = settings.groups
    if not first <= geom.floats("group", (0.0,))[0] <= last:
        return False
    if geom.word("type", _TYPES, "sphere") == "plane":
        return False
    return any(_mass_or_density(geom).values())


def inertia_of_geom(part: PlacedElement, settings: Settings, meshes: Meshes) -> SpatialInertia:
    """About the body's origin, in its axes."""
    geom = part.element
    kind, given = geom.word("type", _TYPES, "sphere"), _mass_or_density(geom)
    if kind == "sdf":
        raise RobotFileError(
            f"{geom} is a signed distance field, whose mass is not computed. Give its body an <inertial>."
        )
    if geom.flag("shellinertia", default=False):
        raise RobotFileError(
            f"{geom} is a shell (shellinertia), whose inertia is not computed. Give its body an <inertial>."
        )
    if kind == "mesh" or "mesh" in geom.attributes:
        G = meshes.inertia(geom, **given) if kind == "mesh" else _fitted(geom)
        return G.in_frame(product(part.frame, placement(geom, settings)))
    T, size = shape_of(geom, kind, settings)
    if kind == "hfield":
        kind, size = "box", meshes.half_sizes_of_hfield(geom)
    if min(size) <= 0:
        raise RobotFileError(
            f"{geom} is a {kind} of size {' '.join(f'{printed(x)}' for x in size)}; sizes are above zero."
        )
    return _solid(kind, size, given).in_frame(product(part.frame, T))


def shape_of(element: Element, kind: str, settings: Settings) -> tuple[Array, list[float]]:
    """Pose (4, 4) and half sizes of a shape, by ``pos`` and an orientation, or by ``fromto``, the ends of its axis."""
    size = element.floats("size", (0.0, 0.0, 0.0))
    if "fromto" not in element.attributes or kind not in _ALONG:
        return placement(element, settings), size[: _LENGTHS.get(kind, 3)]
    ends = element.numbers("fromto", 6)
    along = ends[:3] - ends[3:]
    half = float(np.linalg.norm(along)) / 2.0
    T = se3.pose(onto(direction(element, "fromto", along)), (ends[:3] + ends[3:]) / 2.0)
    return T, [size[0], half] if _LENGTHS[kind] == 2 else [size[0], size[0], half]


def _mass_or_density(geom: Element) -> dict[str, float]:
    if "mass" in geom.attributes:
        given = {"mass": geom.number("mass")}
    else:
        given = {"density": geom.floats("density", (_WATER,))[0]}
    for what, value in given.items():
        if value < 0:
            raise RobotFileError(f"{geom} has a negative {what}, {printed(value)}.")
    return given


def _solid(kind: str, size: list[float], given: dict[str, float]) -> SpatialInertia:
    if kind == "sphere":
        return SpatialInertia.sphere(size[0], **given)
    if kind == "ellipsoid":
        return SpatialInertia.ellipsoid(size, **given)
    if kind == "box":
        return SpatialInertia.box([2.0 * x for x in size], **given)
    make = SpatialInertia.capsule if kind == "capsule" else SpatialInertia.cylinder
    return make(size[0], 2.0 * size[1], **given)


def _fitted(geom: Element) -> SpatialInertia:
    raise RobotFileError(
        f"{geom} is a shape that MuJoCo fits to a mesh. Give its size in place of the mesh, or its body an <inertial>."
    )
