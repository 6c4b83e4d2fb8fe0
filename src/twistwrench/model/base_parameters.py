"""Base parameters: inertia that a joint cannot feel moves to the body before it. Fewer numbers, the same torques.

A part G_s of a body's inertia that the joint's motion leaves as it is, and that has no momentum in it (G_s A = 0), moves as
if it were fixed to the parent. For a turning joint about w through the origin these are the mass, the first moment along
w, and a rotational inertia J (1 - w w'); for a sliding joint, the whole rotational inertia. What is left has zeros in
their places, and zeros cost nothing once traced.

Source: Gautier and Khalil, "Direct calculation of minimum set of inertial parameters of serial robots", IEEE T-RA 6(3), 1990.
The regrouped model has the same torques and mass matrix, but not the same energies, momenta or wrenches in the joints.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..joints import Joint
from .model import BASE, Model


def regrouped(model: Model) -> Model:
    """A model with the same joint-space dynamics and as many inertial parameters zero as moving them inward can make."""
    inertias = [body.inertia for body in model.bodies]
    for i in reversed(range(len(model.bodies))):
        body = model.bodies[i]
        unfelt = _unfelt(body.joint, inertias[i])
        if unfelt is None:
            continue
        inertias[i] = _cleaned(inertias[i] - unfelt, inertias[i])
        if body.parent != BASE:
            inertias[body.parent] = inertias[body.parent] + unfelt.in_frame(body.placement)
    bodies = tuple(replace(body, inertia=G) for body, G in zip(model.bodies, inertias, strict=True))
    return replace(model, bodies=bodies)


def _unfelt(joint: Joint, G: SpatialInertia) -> SpatialInertia | None:
    """The part of a body's inertia its joint cannot feel; None where nothing is known to be."""
    if joint.nv != 1:
        return None
    w, v = joint.axes[0, :3], joint.axes[0, 3:]
    I = G.moment_about_origin
    if not w.any():
        return SpatialInertia.from_parameters([0, 0, 0, 0, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])
    if v.any():  # the axis passes beside the origin, or the joint is a helix
        return None
    w = w / np.linalg.norm(w)
    across = np.eye(3)[(int(np.argmax(np.abs(w))) + 1) % 3]
    across = across - (across @ w) * w
    J = (across @ I @ across) / (across @ across) * (np.eye(3) - np.outer(w, w))
    h = (G.first_moment @ w) * w
    return SpatialInertia.from_parameters([G.mass, *h, J[0, 0], J[0, 1], J[1, 1], J[0, 2], J[1, 2], J[2, 2]])


def _cleaned(G: SpatialInertia, before: SpatialInertia) -> SpatialInertia:
    """Differences that are round-off of what they came from are zero."""
    p = G.parameters.copy()
    scale = np.repeat(
        [abs(before.mass), np.abs(before.first_moment).max(), np.abs(before.parameters[4:]).max()], [1, 3, 6]
    )
    p[np.abs(p) <= 4e-16 * scale] = 0.0
    return SpatialInertia.from_parameters(p)
