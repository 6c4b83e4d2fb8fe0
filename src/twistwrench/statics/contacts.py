"""A point contact with friction, and its cone as edges, from inside and from outside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed, vector
from ..errors import ValueRangeError
from ..typing import Array


@dataclass(frozen=True, eq=False, repr=False)
class Contact:
    r"""Point contact with Coulomb friction: a force within the friction cone about ``normal``.

    That is \|tangential\| ≤ μ · normal part. For one body, ``point`` and ``normal`` are in the frame of its wrench. For
    a robot, ``point`` is in ``frame``, a link of it, and ``normal`` in the base frame, so that the floor's is (0, 0, 1)
    at every foot. The normal points into what is held, and is made of unit length.

    Raises
    ------
    ShapeError, ValueRangeError
        A vector is of another size, the normal zero, or the friction negative.

    Examples
    --------
    >>> Contact((0, 0, 0), normal=(0, 0, 2), friction=0.5).edges(4)[1].round(3).tolist()
    [0.0, 0.5, 1.0]
    """

    point: Any = (0.0, 0.0, 0.0)
    """(3,) m."""
    normal: Any = (0.0, 0.0, 1.0)
    """(3,), into the body held."""
    friction: float = 0.5
    """μ, the Coulomb coefficient; 0 for none."""
    frame: str | None = None
    """The robot's link that touches; the tip if None. On a single body it has to be None."""

    def __post_init__(self) -> None:
        for name in ("point", "normal"):
            what = f"a contact's {name}"
            value = arguments.finite(arguments.one(getattr(self, name), what, 3), what, 3).copy()
            object.__setattr__(self, name, value)
        object.__setattr__(self, "friction", arguments.number(self.friction, "a contact's friction"))
        size = float(np.linalg.norm(self.normal))
        if size == 0:
            raise ValueRangeError("a contact's normal has no length. Give the direction in which the world can push.")
        if not 0 <= self.friction < np.inf:
            raise ValueRangeError(
                f"a contact's friction is {printed(self.friction)}. Give a finite coefficient of at least zero."
            )
        if not isinstance(self.frame, str | None):
            raise ValueRangeError(f"a contact's frame is {self.frame!r}. Give the name of a link, or None for the tip.")
        object.__setattr__(self, "normal", self.normal / size)

    def __repr__(self) -> str:
        at = f" of {self.frame}" if self.frame else ""
        return f"Contact at {vector(self.point)} m{at}, normal {vector(self.normal)}, friction {printed(self.friction)}"

    def edges(self, count: int, *, around: bool = False) -> Array:
        """Edges of a pyramid that lies inside the friction cone, or ``around`` it: forces with unit normal part.

        Parameters
        ----------
        count : int, 3 or more
        around : bool, around the cone rather than inside

        Returns
        -------
        forces : (count, 3) array; (1, 3) for μ = 0

        Raises
        ------
        ValueRangeError
            ``count`` is no such number.

        Notes
        -----
        Edge k leans by μ at the angle 2πk/count; those around lean by μ / cos(π/count).

        Examples
        --------
        >>> Contact(friction=0.5).edges(4).shape
        (4, 3)
        """
        count = arguments.whole(count, "the number of a cone's edges", 3)  # fewer have no inside
        if self.friction == 0:
            return np.array(self.normal[None])
        lean = self.friction / np.cos(np.pi / count) if around else self.friction
        first = _across(self.normal)
        second = np.cross(self.normal, first)
        angle = 2 * np.pi * np.arange(count)[:, None] / count
        return self.normal + lean * (np.cos(angle) * first + np.sin(angle) * second)

    def allows(self, force: ArrayLike, slack: float = 1e-9) -> Any:
        """Whether a force lies in the friction cone itself.

        Parameters
        ----------
        force : (..., 3) array_like [N]
        slack : float, part of its size by which it may lie outside

        Returns
        -------
        answer : (...) array of bool

        Raises
        ------
        ShapeError, ValueRangeError
            ``force`` is of another size, or not finite.

        Examples
        --------
        >>> bool(Contact(friction=0.5).allows([0.4, 0, 1]))
        True
        """
        f = arguments.finite(force, "force", 3)
        along = f @ self.normal
        sideways = np.linalg.norm(f - along[..., None] * self.normal, axis=-1)
        return sideways <= self.friction * along + slack * np.maximum(1.0, np.linalg.norm(f, axis=-1))


def _across(n: Array) -> Array:
    """A unit vector perpendicular to ``n``: the first axis, made so, or where that is near the normal, the second."""
    axis = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t = axis - (axis @ n) * n
    return t / np.linalg.norm(t)
