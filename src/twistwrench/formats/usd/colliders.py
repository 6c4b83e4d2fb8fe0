"""Mass properties of the colliders of a USD body.

The mass of a collider is that of its MassAPI; otherwise its volume times a density: its own, that of the body's
MassAPI, that of its material, or 1000 kg/m³, in this order. A given mass of the body is distributed over the
colliders, which keeps the shape of the inertia. Meshes and planes have no mass.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.errors import RobotFileError
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.lie import se3
from .stage import Stage, axis_of, number_of, who

_WATER_DENSITY = 1000.0
"""Default density of the format [kg/m³]."""
_ADVICE = "Give the body a PhysicsMassAPI with mass, centerOfMass, diagonalInertia and principalAxes"
_TURNS = (
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
)
"""Rotations from z, the solids' axis, to x, y and z."""


def inertia_of_shapes(stage: Stage, body: Any, mass: float) -> SpatialInertia:
    """Inertia of the colliders of a body about its frame's origin, scaled to ``mass`` [kg] if positive.

    Raises :class:`~twistwrench.RobotFileError` with the path of the prim if it has no collider or no such volume.
    """
    total, colliders = SpatialInertia.zero(), stage.colliders(body)
    if not colliders:
        missing = "physics:mass"
        if mass > 0:
            missing = "physics:diagonalInertia"
        raise RobotFileError(f"{who(body)} has no {missing}, and no collider that could give it. {_ADVICE}.")
    T_sb = stage.pose_and_scale(body)[0]
    for prim in colliders:
        T_sc, scale = stage.pose_and_scale(prim)
        total = total + _solid(stage, prim, body, scale).in_frame(se3.inverse(T_sb) @ T_sc)
    if mass <= 0:
        return total
    return SpatialInertia.from_parameters(mass / total.mass * total.parameters)


def _solid(stage: Stage, prim: Any, body: Any, scale: Array) -> SpatialInertia:
    """Inertia of a collider in its frame."""
    mass_or_density = _mass_or_density(stage, prim, body)
    kind, metres = str(prim.GetTypeName()), scale * stage.metre
    if kind == "Cube":
        return SpatialInertia.box(number_of(prim, "size", 2.0) * metres, **mass_or_density)
    if kind == "Sphere":
        return SpatialInertia.ellipsoid(number_of(prim, "radius", 1.0) * metres, **mass_or_density)
    if kind not in ("Cylinder", "Capsule"):
        raise RobotFileError(f"{who(prim)} is a {kind}, whose mass is not computed. {_ADVICE}.")
    k = axis_of(prim, "axis", default="Z")
    along, across = metres[k], np.delete(metres, k)
    if kind == "Cylinder":
        default_radius, build, equal = 1.0, SpatialInertia.cylinder, across
    else:
        default_radius, build, equal = (
            0.5,
            SpatialInertia.capsule,
            metres,
        )  # a capsule keeps its shape only if all are equal
    if np.ptp(equal) > 1e-6 * along:
        raise RobotFileError(f"{who(prim)} is a {kind} scaled to another shape, whose mass is not computed. {_ADVICE}.")
    radius, height = number_of(prim, "radius", default_radius), number_of(prim, "height", 2.0 * default_radius)
    return build(float(radius * across[0]), float(height * along), **mass_or_density).in_frame(
        se3.pose(_TURNS[k], np.zeros(3))
    )


def _mass_or_density(stage: Stage, prim: Any, body: Any) -> dict[str, float]:
    mass = number_of(prim, "physics:mass") * stage.kilogram
    if mass > 0:
        return {"mass": mass}
    for owner in (prim, body, _material(prim)):
        if owner:
            density = number_of(owner, "physics:density")
            if density > 0:
                return {"density": density * stage.kilogram / stage.metre**3}
    return {"density": _WATER_DENSITY}


def _material(prim: Any) -> Any:
    from pxr import UsdShade

    return UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0].GetPrim()
