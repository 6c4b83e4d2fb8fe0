"""The convex hull of points, as a closed surface of triangles."""

from __future__ import annotations

import numpy as np

from ..typing import Array


def hull_faces(points: Array) -> Array | None:
    """The triangles (k, 3) of the convex hull of points (n, 3), seen from outside; None where they lie in a plane.

    Of points (n, 2): the edges (k, 2), in no order; None where they lie on a line.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> len(hull_faces(corners)), hull_faces(corners[:3])
    (4, None)
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points, qhull_options="Qt")
    except (QhullError, ValueError):
        return None
    faces = np.array(hull.simplices, int)
    if points.shape[1] == 2:
        return faces
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return faces


def convex_hull(points: Array) -> tuple[Array, Array] | None:
    """The corners (m, 3) of the convex hull and its triangles (k, 3) of these; None where the points lie in a plane."""
    faces = hull_faces(points)
    if faces is None:
        return None
    used, numbered = np.unique(faces, return_inverse=True)
    return points[used], numbered.reshape(-1, 3)
