"""Dry friction eased off at low speeds, for methods that need forces without corners: how low, and what that leaves out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.model import Model

Array = NDArray[Any]

__all__ = ["creep_speeds", "easing_remark"]

CREEP = 1e-3
"""rad/s or m/s, the least speed below which dry friction is eased off."""


def creep_speeds(M: Array, dry: Array, h: float) -> Array:
    """The speeds below which dry friction is eased off, (..., nv): no less than what it takes off a joint in a step h.

    ``M`` are mass matrices (..., nv, nv), ``dry`` the most that dry friction takes (..., nv).
    """
    light = np.diagonal(np.linalg.inv(M), axis1=-2, axis2=-1)
    return np.asarray(np.maximum(CREEP, h * dry * light))


def easing_remark(model: Model, creep: Array) -> str | None:
    """What the easing does to a motion, in words; None without dry friction."""
    dry = (model.friction.static > 0) | (model.friction.load > 0)
    if not dry.any():
        return None
    most = np.where(dry, creep, 0.0).reshape(-1, len(dry)).max(axis=0)
    worst = int(np.argmax(most))
    return (
        f"dry friction is eased off at low speeds: joints that it would hold creep, at up to about {most[worst]:.2g} rad/s or "
        f"m/s (most of all {model.velocity_names[worst]!r}), and one that moves as slowly keeps three quarters of its "
        "friction; semi-implicit steps ease nothing"
    )
