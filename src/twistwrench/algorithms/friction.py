"""Friction of the joints. Modern Robotics section 8.9.4; the exponential is Stribeck's, see Armstrong-Hélouvry et al., 1994."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.model import Model

Array = NDArray[Any]

__all__ = ["friction_forces", "torque_past_eased_friction", "torque_past_friction"]


def friction_forces(model: Model, dq: Array, load: Array | None = None) -> Array:
    """The torques that overcome friction at dq, where each joint carries the torque ``load``; (nv,)."""
    f, s = model.friction, _signs(dq)
    tau = f.viscous * dq + s * _dry(model, dq)
    return np.asarray(tau if load is None else tau + s * f.load * (_signs(load) * load))


def torque_past_friction(model: Model, dq: Array, tau: Array) -> Array:
    """What friction leaves of the torques tau; (nv,).

    The joint carries x, of which friction takes its part too: x + sign(dq) load |x| = y, with y what the other laws
    leave. As load < 1, x has the sign of y.
    """
    y = tau - friction_forces(model, dq)
    return np.asarray(y / (1.0 + model.friction.load * (_signs(dq) * _signs(y))))


def torque_past_eased_friction(model: Model, dq: Array, tau: Array, creep: Array) -> Array:
    """The same where dry friction is made continuous at rest: its part is multiplied by tanh(|dq| / creep); (nv,)."""
    damping = model.friction.viscous * dq
    share = 1.0 - 2.0 / (_exp(2.0 * (_signs(dq) * dq / creep)) + 1.0)
    y = tau - damping - share * (friction_forces(model, dq) - damping)
    return np.asarray(y / (1.0 + share * model.friction.load * (_signs(dq) * _signs(y))))


def _dry(model: Model, dq: Array) -> Array:
    """Coulomb friction, and static friction as far as the speed leaves it; (nv,)."""
    f = model.friction
    dry = [
        c if _same(c, s) else c + (s - c) * _exp(-(x / v) * (x / v))
        for c, s, v, x in zip(f.coulomb, f.static, f.stribeck, dq, strict=True)
    ]
    return np.array(dry, object).reshape(dq.shape)


def _same(a: Any, b: Any) -> bool:
    """Whether two numbers are equal; symbols differ from all but themselves."""
    return a is b or (isinstance(a, float) and isinstance(b, float) and a == b)


def _exp(x: Any) -> Any:
    return x.exp() if hasattr(x, "exp") else np.exp(x)


def _signs(x: Array) -> Array:
    return np.array([e.sign() if hasattr(e, "sign") else np.sign(e) for e in x], object).reshape(x.shape)
