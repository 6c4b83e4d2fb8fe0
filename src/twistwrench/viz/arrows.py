"""Arrows as surfaces: straight ones for forces, arcs for torques. Those of one kind have the same triangles at any length."""

from __future__ import annotations

import numpy as np

from ..typing import Array
from .surface import Surface

_AROUND = 14
_STEPS = 40
_HEAD, _WIDE = 4.5, 2.1
"""Length and radius of a head, in radii of the shaft."""


def arrow(length: float, thickness: float) -> Surface:
    """Along z from the origin; of short ones the head shrinks too."""
    head = min(length, _HEAD * thickness)
    neck, wide = length - head, _WIDE * head / _HEAD
    shaft = min(thickness, wide / 2)
    rings = [(0.0, 0.0), (0.0, shaft), (neck, shaft), (neck, wide), (length, 0.0)]
    middle = np.array([[0.0, 0.0, z] for z, _ in rings])
    across = np.broadcast_to([1.0, 0.0, 0.0], middle.shape), np.broadcast_to([0.0, 1.0, 0.0], middle.shape)
    return _tube(middle, *across, np.array([r for _, r in rings]))


def arc(sweep: float, radius: float, thickness: float) -> Surface:
    """Around z from the x axis, through ``sweep`` [rad], counterclockwise."""
    head = min(sweep, 1.1 * _HEAD * thickness / radius)
    angles = np.concatenate([[0.0], np.linspace(0.0, sweep - head, _STEPS), np.linspace(sweep - head, sweep, 5)])
    radii = np.concatenate([[0.0], np.full(_STEPS, thickness), _WIDE * thickness * np.linspace(1.0, 0.0, 5)])
    out = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    up = np.broadcast_to([0.0, 0.0, 1.0], out.shape)
    return _tube(radius * out, up, out, radii)


def _tube(middle: Array, first: Array, second: Array, radii: Array) -> Surface:
    """Around a curve: of its points (n, 3), two unit vectors across it, and the radius."""
    turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
    across = np.cos(turn)[:, None] * first[:, None, :] + np.sin(turn)[:, None] * second[:, None, :]
    vertices = (middle[:, None, :] + radii[:, None, None] * across).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(len(middle) - 1), np.arange(_AROUND), indexing="ij")
    here, beside = i * _AROUND + k, i * _AROUND + (k + 1) % _AROUND
    faces = [(here, beside, beside + _AROUND), (here, beside + _AROUND, here + _AROUND)]
    return Surface(vertices, np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in faces]))
