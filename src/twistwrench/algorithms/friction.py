"""Friction of the joints as the robot file gives it: viscous and Coulomb. Modern Robotics section 8.9.4."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.model import Model

Array = NDArray[Any]

__all__ = ["friction_forces"]


def friction_forces(model: Model, dq: Array) -> Array:
    """The torques that overcome friction, ``damping dq + friction sign(dq)``; (nv,)."""
    signs = [x.sign() if hasattr(x, "sign") else np.sign(x) for x in dq]
    return np.asarray(model.damping * dq + model.friction * np.array(signs, object))
