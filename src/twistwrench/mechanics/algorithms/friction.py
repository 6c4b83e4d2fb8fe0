"""Joint friction (Modern Robotics section 8.9.4, with Stribeck's exponential), and branch-free switching functions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...core.typing import Array
from ..model.couplings import joint_torques, motor_torques, motor_velocities
from ..model.model import Model


def friction_forces(model: Model, dq: Array, load: Array | None = None) -> Array:
    """Torques that overcome friction at dq for joints that transmit the torque ``load``; (nv,)."""
    u = motor_velocities(model, dq)
    lost = _drive_friction(model, u, None if load is None else motor_torques(model, load))
    return np.asarray(joint_torques(model, lost))


def _drive_friction(model: Model, u: Array, load: Array | None = None) -> Array:
    """Friction law at the velocities u of drives that transmit ``load``; (nv,)."""
    f, s = model.friction, signs(u)
    tau = f.viscous * u + s * _dry_friction(model, u)
    return np.asarray(tau if load is None else tau + s * f.load * (signs(load) * load))


def torque_past_friction(model: Model, dq: Array, tau: Array) -> Array:
    """Part of the torques tau that remains after friction; (nv,).

    The transmitted torque x solves x + sign(dq) load |x| = y, where y is the torque after the load-independent friction. As
    load < 1, x has the sign of y.
    """
    u = motor_velocities(model, dq)
    y = motor_torques(model, tau) - _drive_friction(model, u)
    return np.asarray(joint_torques(model, y / (1.0 + model.friction.load * (signs(u) * signs(y)))))


def torque_past_eased_friction(model: Model, dq: Array, tau: Array, share: Array) -> Array:
    """Like :func:`torque_past_friction`, but dry friction is multiplied by ``share`` of :func:`eased`; (nv,)."""
    u = motor_velocities(model, dq)
    damping = model.friction.viscous * u
    y = motor_torques(model, tau) - damping - share * (_drive_friction(model, u) - damping)
    return np.asarray(joint_torques(model, y / (1.0 + share * model.friction.load * (signs(u) * signs(y)))))


def sliding_share(dq: Array, creep: Array) -> Array:
    """tanh(|dq| / creep), the fraction of dry friction at low speeds; (nv,).

    Symbols use the exponential. Near rest its error is 1e-16 absolute; the relative error is larger.
    """
    if dq.dtype != object:
        return np.asarray(np.tanh(np.abs(dq) / creep))
    return np.asarray(1.0 - 2.0 / (_exp(2.0 * (signs(dq) * dq / creep)) + 1.0))


def dry_friction_indices(model: Model) -> list[int]:
    """Indices of the velocities with dry friction."""
    f = model.friction
    laws = zip(f.coulomb, f.static, f.load, strict=True)
    return [k for k, law in enumerate(laws) if not all(map(is_zero, law))]


def friction_bounds(model: Model, dq: Array, tau: Array) -> tuple[Array, Array]:
    """Largest dry friction of joints that slide backward and forward, at the speeds dq; (nv,) each.

    The two differ if friction grows with the load: the transmitted torque is the part of tau that friction leaves.
    """
    dry, load = _dry_friction(model, dq), model.friction.load
    backward, forward = dry.copy(), dry.copy()
    for k, c in enumerate(load):
        if not is_zero(c):
            y = tau[k] - model.friction.viscous[k] * dq[k]
            for bounds, sign in ((backward, -1.0), (forward, 1.0)):
                carried = y - sign * dry[k]
                bounds[k] = dry[k] + c * (abs(carried) / (1.0 + sign * c * carried.sign()))
    return backward, forward


def _dry_friction(model: Model, dq: Array) -> Array:
    """Coulomb friction plus the static friction that remains at this speed; (nv,)."""
    f = model.friction
    dry = np.full(dq.shape, 0.0, object)
    for k, (c, s, v, x) in enumerate(zip(f.coulomb, f.static, f.stribeck, dq, strict=True)):
        dry[k] = c if _are_equal(c, s) else c + (s - c) * _exp(-(x / v) * (x / v))
    return dry


def _are_equal(a: Any, b: Any) -> bool:
    """True if two numbers are equal; a symbol equals only itself."""
    return a is b or (isinstance(a, float) and isinstance(b, float) and a == b)


def is_zero(x: Any) -> bool:
    """True for the number 0; False for symbols."""
    return isinstance(x, float) and x == 0.0


def _exp(x: Any) -> Any:
    return x.exp() if hasattr(x, "exp") else np.exp(x)


def signs(x: Array) -> Array:
    """-1, 0 or 1, for symbols and numbers."""
    return np.array([e.sign() if hasattr(e, "sign") else np.sign(e) for e in x], object).reshape(x.shape)


# ── Branch-free switching functions, for numbers and symbols


def positive(x: Any) -> Any:
    """1 if a number is above 0, else 0."""
    s = signs(np.array([x], object))[0]
    return 0.5 * (s + s * s)


def either(which: Any, a: Any, b: Any) -> Any:
    """a if ``which`` is 1, b if it is 0; bit-exact for finite numbers."""
    return which * a + (1.0 - which) * b


def largest(numbers: Iterable[Any], bound: Any) -> Any:
    """Largest absolute value, at least ``least``; NaN if any number is NaN."""
    for x in numbers:
        bound = abs(x).clip(bound, np.inf) if hasattr(x, "clip") else max(abs(x), bound)
    return bound


def smallest(numbers: Iterable[Any], bound: Any) -> Any:
    """Smallest number, at most ``most``; NaN if any number is NaN."""
    for x in numbers:
        bound = x.clip(-np.inf, bound) if hasattr(x, "clip") else min(x, bound)
    return bound
