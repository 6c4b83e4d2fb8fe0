"""What a robot runs into: a plane, and the stops of its joints. Compliant, and dissipating as Hunt and Crossley say.

Where a point is a depth d > 0 inside, and sinks in at the rate d', it is pushed out with

    f = k dⁿ max(0, 1 + c d')

The force begins and ends at zero and never pulls. Of the speed v of an impact the part e comes back,

    c v - ln(1 + c v) = -c e v - ln(1 - c e v),      e ≈ 1 - ⅔ c v for slow ones,

whatever k, n and the mass, while no other force matters. Source: Hunt and Crossley, "Coefficient of restitution interpreted as
damping in vibroimpact", J. Applied Mechanics 42, 1975; the equation for e is the energy integral of the law.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import positive
from ..errors import ShapeError, ValueRangeError


@dataclass(frozen=True)
class Plane:
    """Contact plane n·x = height that points of one frame run into; ``docs/simulation.md`` has the law.

    Along the plane a point sliding at v is held back by ``friction f v / √(|v|² + slip²)``: Coulomb's law, except that
    it creeps where it would stick, at up to the speed ``slip``.

    Raises
    ------
    ShapeError, ValueRangeError
        An argument is of another size or not finite.

    Examples
    --------
    >>> ground = Plane("box", points=[[0.1, 0, 0], [-0.1, 0, 0]], stiffness=1e5, dissipation=0.5, friction=0.8)
    >>> ground.points.shape
    (2, 3)
    """

    frame: str
    """The frame whose points run into it."""
    points: ArrayLike = (0.0, 0.0, 0.0)
    """(3,) or (n, 3), in the frame [m]."""
    normal: ArrayLike = (0.0, 0.0, 1.0)
    """(3,), in the base frame, out of the ground; any length."""
    height: float = 0.0
    """m, along the normal."""
    stiffness: float = 1e5
    """k [N/mⁿ]."""
    exponent: float = 1.5
    """n: 1.5 is Hertz's contact of round bodies."""
    dissipation: float = 0.0
    """c [s/m]: 0 gives all of the energy back."""
    friction: float = 0.0
    """Coulomb's coefficient."""
    slip: float = 1e-2
    """m/s."""

    def __post_init__(self) -> None:
        points = np.atleast_2d(np.asarray(arguments.finite(self.points, "Plane: points", 3), float))
        if points.ndim != 2 or not len(points):
            raise ShapeError(f"Plane: points have shape {points.shape}, expected (3,) or (n, 3).")
        normal = np.asarray(arguments.finite(arguments.one(self.normal, "Plane: normal", 3), "Plane: normal", 3), float)
        size = float(np.linalg.norm(normal))
        if size == 0.0:
            raise ValueRangeError("Plane: the normal is zero. Give the direction out of the ground, as (0, 0, 1).")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normal", normal / size)
        arguments.finite(arguments.one(self.height, "Plane: height"), "Plane: height")
        _check_law("Plane", self.stiffness, self.exponent, self.dissipation)
        positive(self.friction, "Plane: friction", zero=True)
        positive(self.slip, "Plane: slip", "m/s")


@dataclass(frozen=True)
class JointStops:
    """Compliant joint stops at the position limits of the joints of one degree of freedom, by the law of :class:`Plane`.

    Raises
    ------
    ValueRangeError
        A number is not finite or negative.
    """

    stiffness: float
    """k [N m/radⁿ or N/mⁿ]."""
    exponent: float = 1.5
    """n, as of a plane."""
    dissipation: float = 0.0
    """c [s/rad or s/m]."""
    joints: tuple[str, ...] | None = None
    """The joints that have them; None: all that have limits."""

    def __post_init__(self) -> None:
        _check_law("JointStops", self.stiffness, self.exponent, self.dissipation)
        given: object = self.joints
        if isinstance(given, str):
            object.__setattr__(self, "joints", (given,))


def _check_law(what: str, stiffness: float, exponent: float, dissipation: float) -> None:
    positive(stiffness, f"{what}: stiffness")
    if not 1.0 <= positive(exponent, f"{what}: exponent") <= 5.0:
        raise ValueRangeError(f"{what}: exponent is {exponent}, and must be from 1 to 5; 1.5 is Hertz's.")
    positive(dissipation, f"{what}: dissipation", zero=True)
