"""Points inside the solid that a triangle mesh bounds: closed shells, cavities, several parts, open shells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.typing import Array
from .shells import edges_of, nest, shell_numbers, winding

_MIN_WINDING = 0.5
"""Winding number above which a point counts as inside.

The number of a closed shell is whole. An open shell above the minimum covers more than half of the directions from the point.
"""


@dataclass(frozen=True, eq=False)
class Shell:
    """Connected faces of a mesh."""

    triangles: Array
    """Corners of its k faces (k, 3, 3) [m]."""
    closed: bool
    """True if every edge belongs to an even number of faces, usually two."""

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Lower and upper corner, each (3,), of the box around the shell."""
        return self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))

    def around(self, point: Array) -> Array | None:
        """Triangles (k, 3, 3) with outward normals if the shell encloses the point (3,); otherwise None."""
        low, high = self.box
        is_in_box = ((low < point) & (point < high)).all()
        if not is_in_box:
            return None
        winding_numbers = winding(point[None], self.triangles)
        winding_number = float(winding_numbers[0])
        is_on_face = math.isnan(winding_number)  # see :func:`.shells.winding`
        if is_on_face or abs(winding_number) <= _MIN_WINDING:
            return None
        normals_point_outward = winding_number > 0
        return (
            self.triangles if normals_point_outward else self.triangles[:, ::-1]
        )  # reversed corners, opposite normals


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
        order = np.argsort(shell_of_face, kind="stable")  # faces of a shell adjoin, in their order in the mesh
        is_last_of_shell = np.diff(shell_of_face[order]) != 0  # followed by a face of another shell
        first_faces = np.flatnonzero(is_last_of_shell) + 1  # of all shells after the first
        faces_of_shells = np.split(self.faces[order], first_faces)
        return tuple(_shell(self.vertices, faces) for faces in faces_of_shells)

    def holds(self, points: Array) -> bool | None:
        """True if points lie in the solid, not in a cavity; None if this depends on the missing faces of open shells.

        Parameters
        ----------
        points : (n, 3) array [m], not separated by a face, so that the first point decides for all

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
        faces_of_closed_shells: list[Array] = []  # of the shells around the point
        is_in_open_shell = False
        for shell in self.shells:
            faces = shell.around(points[0])
            if faces is None:
                continue
            if shell.closed:
                faces_of_closed_shells.append(faces)
            else:
                is_in_open_shell = True
        if faces_of_closed_shells:
            shell_count = len(faces_of_closed_shells)
            face_counts = [len(faces) for faces in faces_of_closed_shells]
            shell_of_face = np.repeat(np.arange(shell_count), face_counts)
            nesting = nest(np.concatenate(faces_of_closed_shells), shell_of_face, shell_count)
            depth_of_innermost = int(nesting.depth.max())
            innermost_bounds_solid = depth_of_innermost % 2 == 0  # shells of odd depth bound cavities
            if nesting.cutting or innermost_bounds_solid:  # shells that cut each other bound no cavity
                return True
        return None if is_in_open_shell else False

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Lower and upper corner, each (3,), of the box around the mesh."""
        return self.vertices.min(axis=0, initial=np.inf), self.vertices.max(axis=0, initial=-np.inf)

    def reaches(self, points: Array) -> Array:
        """Test which points are in the box around the mesh.

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
    """Shell of the given faces (k, 3), which are connected."""
    edges = np.sort(edges_of(faces), axis=1)
    _, faces_per_edge = np.unique(edges, axis=0, return_counts=True)
    closed = bool((faces_per_edge % 2 == 0).all())
    return Shell(np.asarray(vertices[faces], float), closed)
