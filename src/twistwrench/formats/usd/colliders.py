"""Mass properties of the colliders of a USD body.

The MassAPI of a collider gives its mass; otherwise the mass is volume times density. The density comes from the collider's
MassAPI, the body's MassAPI, or the collider's material, in this order; otherwise it is 1000 kg/m³. If the body has a mass, the
inertia of all colliders together is scaled to this mass. Meshes and planes are not read.
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
_ROTATIONS_FROM_Z = (
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
)
"""Rotations that turn z, the axis of cylinders and capsules of :class:`.SpatialInertia`, to x, y and z."""
_MAX_ROUNDING = 1e-6
"""Largest difference of equal scales, as a share of a scale."""


def inertia_of_shapes(stage: Stage, body: Any, mass: float) -> SpatialInertia:
    """Inertia of the colliders of a body in its frame, scaled to ``mass`` [kg] if this is positive.

    Raises :class:`~twistwrench.RobotFileError` with the path of the prim if the body has no collider, or a collider whose mass
    is not computed.
    """
    colliders = stage.colliders(body)
    if not colliders:
        missing_attribute = "physics:diagonalInertia" if mass > 0 else "physics:mass"
        raise RobotFileError(f"{who(body)} has no {missing_attribute}, and no collider that could give it. {_ADVICE}.")
    T_sb, _ = stage.pose_and_scale(body)
    total = SpatialInertia.zero()
    for prim in colliders:
        T_sc, scale = stage.pose_and_scale(prim)
        inertia = _inertia_of_collider(stage, prim, body, scale)
        total = total + inertia.in_frame(se3.inverse(T_sb) @ T_sc)
    if mass <= 0:
        return total
    return SpatialInertia.from_parameters(mass / total.mass * total.parameters)


def _inertia_of_collider(stage: Stage, prim: Any, body: Any, scale: Array) -> SpatialInertia:
    """Inertia of a collider in its frame; ``scale`` (3,) has a factor for each of its axes."""
    mass_or_density = _mass_or_density(stage, prim, body)
    kind = str(prim.GetTypeName())
    units = scale * stage.metre  # metres for a unit of length along each axis
    if kind == "Cube":
        return SpatialInertia.box(number_of(prim, "size", 2.0) * units, **mass_or_density)
    if kind == "Sphere":
        return SpatialInertia.ellipsoid(number_of(prim, "radius", 1.0) * units, **mass_or_density)
    if kind not in ("Cylinder", "Capsule"):
        raise RobotFileError(f"{who(prim)} is a {kind}, whose mass is not computed. {_ADVICE}.")
    axis = axis_of(prim, "axis", default="Z")
    unit_along = units[axis]
    units_across = np.delete(units, axis)
    if kind == "Cylinder":
        default_radius, build = 1.0, SpatialInertia.cylinder
        equal_units = units_across  # otherwise it is not round
    else:
        default_radius, build = 0.5, SpatialInertia.capsule
        equal_units = units  # otherwise its ends are not half spheres
    if np.ptp(equal_units) > _MAX_ROUNDING * unit_along:
        raise RobotFileError(f"{who(prim)} is a {kind} scaled to another shape, whose mass is not computed. {_ADVICE}.")
    radius = float(number_of(prim, "radius", default_radius) * units_across[0])
    height = float(number_of(prim, "height", 2.0 * default_radius) * unit_along)
    along_z = build(radius, height, **mass_or_density)
    return along_z.in_frame(se3.pose(_ROTATIONS_FROM_Z[axis], np.zeros(3)))


def _mass_or_density(stage: Stage, prim: Any, body: Any) -> dict[str, float]:
    """Mass [kg] or density [kg/m³] of a collider, under the name ``mass`` or ``density``."""
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
    """Prim of a collider's physical material; without a material, a prim that is false."""
    from pxr import UsdShade

    material, _binding = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    return material.GetPrim()
