"""Points inside the solid that a triangle mesh bounds: closed shells, cavities, several parts, open shells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.typing import Array
from .shells import edges_of, nest, shell_numbers, winding

_MIN_WINDING = 0.5
"""Winding number above which a point is inside a closed shell. An open shell then surrounds most of the point's directions."""


@dataclass(frozen=True, eq=False)
class Shell:
    """Connected faces of a mesh."""

    triangles: Array
    """Corners (k, 3, 3)."""
    closed: bool
    """True if every edge belongs to two faces, or to another even number of faces."""

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner (3,) of its box."""
        return self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))

    def around(self, point: Array) -> Array | None:
        """Faces (k, 3, 3) turned outward if a point (3,) is inside them; otherwise None."""
        low, high = self.box
        if not ((low < point) & (point < high)).all():
            return None
        winding_number = float(winding(point[None], self.triangles)[0])
        if not abs(winding_number) > _MIN_WINDING:  # also for NaN: the point is on a face
            return None
        return self.triangles if winding_number > 0 else self.triangles[:, ::-1]


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
        _, shell_of_face = shell_numbers(self.faces)
        order = np.argsort(shell_of_face, kind="stable")
        first_faces = np.flatnonzero(np.diff(shell_of_face[order])) + 1
        faces_of_shells = np.split(self.faces[order], first_faces)
        return tuple(_shell(self.vertices, faces) for faces in faces_of_shells)

    def holds(self, points: Array) -> bool | None:
        """True if points (n, 3) that no face separates lie in the solid, not in a cavity; None if open shells leave it open.

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
        closed_shells, is_in_open_shell = list[Array](), False
        for shell in self.shells:
            faces = shell.around(points[0])
            if faces is not None and shell.closed:
                closed_shells.append(faces)
            elif faces is not None:
                is_in_open_shell = True
        if closed_shells:
            shell_of_face = np.repeat(np.arange(len(closed_shells)), [len(faces) for faces in closed_shells])
            nesting = nest(np.concatenate(closed_shells), shell_of_face, len(closed_shells))
            innermost_bounds_solid = int(nesting.depth.max()) % 2 == 0
            if nesting.cutting or innermost_bounds_solid:
                return True
        return None if is_in_open_shell else False

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
    """Shell of some faces (k, 3) of a mesh."""
    edges = np.sort(edges_of(faces), axis=1)
    _, faces_per_edge = np.unique(edges, axis=0, return_counts=True)
    closed = bool((faces_per_edge % 2 == 0).all())
    return Shell(np.asarray(vertices[faces], float), closed)
