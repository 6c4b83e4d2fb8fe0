"""Points inside the solid that a triangle mesh bounds: closed shells, cavities, several parts, open shells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.typing import Array
from .shells import edges_of, nest, shell_numbers, winding

_INSIDE = 0.5
"""Winding number above which a point is inside a closed shell; around an open one it is only inside most of it."""


@dataclass(frozen=True, eq=False)
class Shell:
    """Connected faces of a mesh."""

    triangles: Array
    """Corners (k, 3, 3)."""
    closed: bool
    """True if every edge belongs to two faces, or to another even number."""

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (3,) of its box."""
        return self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))

    def around(self, point: Array) -> Array | None:
        """Faces (k, 3, 3) turned outward if a point (3,) is inside them; otherwise None."""
        low, high = self.box
        if not ((low < point) & (point < high)).all():
            return None
        w = float(winding(point[None], self.triangles)[0])
        if not abs(w) > _INSIDE:
            return None
        return self.triangles if w > 0 else self.triangles[:, ::-1]


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Solid bounded by a mesh."""

    vertices: Array
    """(n, 3) [m]."""
    faces: Array
    """(k, 3) indices of vertices."""

    @cached_property
    def shells(self) -> tuple[Shell, ...]:
        """Connected parts of the mesh.

        Returns
        -------
        shells : tuple of Shell
        """
        if not len(self.faces):
            return ()
        _, label = shell_numbers(self.faces)
        order = np.argsort(label, kind="stable")
        parts = np.split(self.faces[order], np.flatnonzero(np.diff(label[order])) + 1)
        return tuple(_shell(self.vertices, faces) for faces in parts)

    def holds(self, points: Array) -> bool | None:
        """True if points (n, 3), which no face separates, lie in the solid, not in a cavity; None if open shells hide it.

        Parameters
        ----------
        points : (n, 3) array [m]

        Returns
        -------
        inside : bool or None

        Examples
        --------
        >>> import numpy as np
        >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        >>> wedge = Enclosure(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
        >>> wedge.holds(np.array([[0.1, 0.1, 0.1]])), wedge.holds(np.array([[0.9, 0.9, 0.9]]))
        (True, False)
        """
        if not self.reaches(points).all():
            return False
        walls, in_open_shell = list[Array](), False
        for shell in self.shells:
            faces = shell.around(points[0])
            if faces is not None and shell.closed:
                walls.append(faces)
            elif faces is not None:
                in_open_shell = True
        if walls:
            label = np.repeat(np.arange(len(walls)), [len(part) for part in walls])
            nesting = nest(np.concatenate(walls), label, len(walls))
            if nesting.cutting or int(nesting.depth.max()) % 2 == 0:  # the innermost shell around it bounds a solid
                return True
        return None if in_open_shell else False

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Lower and upper corner (3,) of the box around the mesh."""
        return self.vertices.min(axis=0, initial=np.inf), self.vertices.max(axis=0, initial=-np.inf)

    def reaches(self, points: Array) -> Array:
        """True for those of the points (n, 3) that are in the box around the mesh.

        Parameters
        ----------
        points : (n, 3) array [m]

        Returns
        -------
        near : (n,) array of bool
        """
        low, high = self._box
        return np.asarray(((low < points) & (points < high)).all(axis=1))


def _shell(vertices: Array, faces: Array) -> Shell:
    _, counts = np.unique(np.sort(edges_of(faces), axis=1), axis=0, return_counts=True)
    return Shell(np.asarray(vertices[faces], float), bool((counts % 2 == 0).all()))
