"""Masses that a stage leaves to the shapes of a body: uniform solids of its colliders, as UsdPhysics has it.

A collider weighs what its own MassAPI says; else its volume times a density: its own, that of the body's MassAPI, that of its
material, else a tonne a cubic metre. A mass that the body has is spread over the colliders so that they have the same shape of
inertia. Meshes and planes are not weighed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import RobotFileError
from ..lie import se3
from ..typing import Array
from .usd_stage import Stage, axis_of, number_of, who

_WATER = 1000.0
"""kg/m³, the format's density."""
_ADVICE = "Give the body a PhysicsMassAPI with mass, centerOfMass, diagonalInertia and principalAxes"
_TURNS = (
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
)
"""From z to x, to y, to z itself: our solids stand along z."""


def inertia_of_shapes(stage: Stage, body: Any, mass: float) -> SpatialInertia:
    """Of the colliders of a body, about its frame's origin; scaled to ``mass`` [kg] where that is above 0.

    Raises :class:`~twistwrench.RobotFileError` with the path of the prim for what has no such volume, or no collider.
    """
    total, colliders = SpatialInertia.zero(), _colliders(stage, body)
    if not colliders:
        missing = "physics:diagonalInertia" if mass > 0 else "physics:mass"
        raise RobotFileError(f"{who(body)} has no {missing}, and no collider that could give it. {_ADVICE}.")
    T_sb = stage.placed(body)[0]
    for prim in colliders:
        T_sc, scale = stage.placed(prim)
        total = total + _solid(stage, prim, body, scale).in_frame(se3.inverse(T_sb) @ T_sc)
    return total if mass <= 0 else SpatialInertia.from_parameters(mass / total.mass * total.parameters)


def has_colliders(stage: Stage, body: Any) -> bool:
    """Whether a body has shapes that touch."""
    return bool(_colliders(stage, body))


def _colliders(stage: Stage, body: Any) -> list[Any]:
    from pxr import UsdPhysics

    return [prim for prim in stage.parts(body) if prim.HasAPI(UsdPhysics.CollisionAPI)]


def _solid(stage: Stage, prim: Any, body: Any, scale: Array) -> SpatialInertia:
    """In the frame of the collider."""
    given = _mass_or_density(stage, prim, body)
    kind, metres = str(prim.GetTypeName()), scale * stage.metre
    if kind == "Cube":
        return SpatialInertia.box(number_of(prim, "size", 2.0) * metres, **given)
    if kind == "Sphere":
        return SpatialInertia.ellipsoid(number_of(prim, "radius", 1.0) * metres, **given)
    if kind not in ("Cylinder", "Capsule"):
        raise RobotFileError(f"{who(prim)} is a {kind}, whose mass is not computed. {_ADVICE}.")
    k = axis_of(prim, "axis", default="Z")
    along, across = metres[k], np.delete(metres, k)
    if np.ptp(metres if kind == "Capsule" else across) > 1e-6 * along:
        raise RobotFileError(f"{who(prim)} is a {kind} scaled to another shape, whose mass is not computed. {_ADVICE}.")
    make = SpatialInertia.cylinder if kind == "Cylinder" else SpatialInertia.capsule
    radius = number_of(prim, "radius", 1.0 if kind == "Cylinder" else 0.5)
    height = number_of(prim, "height", 2.0 if kind == "Cylinder" else 1.0)
    return make(float(radius * across[0]), float(height * along), **given).in_frame(se3.pose(_TURNS[k], np.zeros(3)))


def _mass_or_density(stage: Stage, prim: Any, body: Any) -> dict[str, float]:
    mass = number_of(prim, "physics:mass") * stage.kilogram
    if mass > 0:
        return {"mass": mass}
    said = (number_of(one, "physics:density") for one in (prim, body, _material(prim)) if one)
    density = next((x for x in said if x > 0), 0.0)
    return {"density": density * stage.kilogram / stage.metre**3 if density > 0 else _WATER}


def _material(prim: Any) -> Any:
    from pxr import UsdShade

    return UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0].GetPrim()
