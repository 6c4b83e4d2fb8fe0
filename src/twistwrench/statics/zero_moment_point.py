"""Zero moment points, and their distances from the edge of the support polygon."""

from __future__ import annotations

import numpy as np

from ..core.typing import Array
from .balance import Balance
from .contacts import tangents

_MAX_PLANE_DISTANCE = 0.01
"""Largest distance of contacts from one plane [m] for which a zero moment point exists."""


def zero_moment_point(balance: Balance, points: Array, wrench: Array | None) -> tuple[Array, Array]:
    """Zero moment points (n, 2) and their distances (n,) from the edge of the support polygon, negative outside."""
    n = len(points)
    zmp, margin = np.full((n, 2), np.nan), np.full(n, np.nan)
    normals = balance.cones.normals
    if wrench is None or np.abs(normals - normals[0]).max() > 1e-9:
        return zmp, margin
    normal = normals[0]
    axes = tangents(normal)
    heights = np.where(balance.active, points @ normal, np.nan)
    carried = balance.active.any(axis=1)
    height, spread = np.zeros(n), np.zeros(n)
    height[carried] = np.nanmean(heights[carried], axis=1)
    spread[carried] = np.nanmax(heights[carried], axis=1) - np.nanmin(heights[carried], axis=1)
    moment = wrench[:, :3] - np.cross(height[:, None] * normal, wrench[:, 3:])
    pressing = wrench[:, 3:] @ normal
    flat = carried & (spread <= _MAX_PLANE_DISTANCE) & (pressing > 1e-9 * np.linalg.norm(wrench[:, 3:], axis=1))
    across = np.stack([-(moment @ axes[1]), moment @ axes[0]], axis=1)
    zmp[flat] = across[flat] / pressing[flat, None]
    for k in np.flatnonzero(flat):
        margin[k] = _inside(points[k, balance.active[k]] @ axes.T, zmp[k])
    return zmp, margin


def _inside(points: Array, position: Array) -> float:
    """Distance of a position from the edge of the convex hull of points (k, 2), negative outside."""
    start, end = points[:, None], points[None, :]
    along = end - start
    length = np.linalg.norm(along, axis=-1)
    unit = along / np.maximum(length, 1e-300)[..., None]
    inward = np.stack([-unit[..., 1], unit[..., 0]], axis=-1)  # of edges counterclockwise
    sides = np.einsum("ijk,ijmk->ijm", inward, points[None, None] - start[:, :, None])
    edge = (length > 0) & (sides.min(axis=-1) >= -1e-12 * (1.0 + length))
    to_line = ((position - start) * inward).sum(axis=-1)
    if edge.any() and float(to_line[edge].min()) >= 0:
        return float(to_line[edge].min())
    foot = np.clip(((position - start) * unit).sum(axis=-1), 0.0, length)
    return -float(np.linalg.norm(start + foot[..., None] * unit - position, axis=-1).min())
