"""Joint friction (Modern Robotics section 8.9.4, with Stribeck's exponential), and branch-free switching functions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...core.typing import Array
from ..model.couplings import joint_torques, motor_torques, motor_velocities
from ..model.model import Model


def friction_forces(model: Model, dq: Array, load: Array | None = None) -> Array:
    """Torques (nv,) that overcome friction at dq; ``load`` (nv,) are the transmitted torques, None to leave them out."""
    u = motor_velocities(model, dq)
    drive_load = None if load is None else motor_torques(model, load)
    return np.asarray(joint_torques(model, _drive_friction(model, u, drive_load)))


def _drive_friction(model: Model, u: Array, load: Array | None = None) -> Array:
    """Torques (nv,) of the friction law at velocities u of drives; ``load`` (nv,) are their torques, None to leave them out."""
    friction = model.friction
    direction = signs(u)
    tau = friction.viscous * u + direction * _dry_friction(model, u)
    if load is not None:
        tau = tau + direction * friction.load * (signs(load) * load)
    return np.asarray(tau)


def torque_past_friction(model: Model, dq: Array, tau: Array) -> Array:
    """Part (nv,) of the torques tau that remains after friction.

    The transmitted torque x solves x + sign(dq) load |x| = y, where y is the torque that remains after the friction that does
    not depend on the load. As load < 1, x has the sign of y, and x = y / (1 + load sign(dq) sign(y)).
    """
    u = motor_velocities(model, dq)
    y = motor_torques(model, tau) - _drive_friction(model, u)
    x = y / (1.0 + model.friction.load * (signs(u) * signs(y)))
    return np.asarray(joint_torques(model, x))


def torque_past_eased_friction(model: Model, dq: Array, tau: Array, share: Array) -> Array:
    """Like :func:`torque_past_friction`, but dry friction is multiplied by ``share`` (nv,) of :func:`sliding_share`; (nv,)."""
    u = motor_velocities(model, dq)
    viscous = model.friction.viscous * u
    y = motor_torques(model, tau) - viscous - share * (_drive_friction(model, u) - viscous)
    x = y / (1.0 + share * model.friction.load * (signs(u) * signs(y)))
    return np.asarray(joint_torques(model, x))


def sliding_share(dq: Array, creep: Array) -> Array:
    """Fraction (nv,) of dry friction that acts at low speeds, tanh(|dq| / creep).

    For symbols, tanh x = 1 - 2 / (e^(2x) + 1). The absolute error of this form is 1e-16; near rest, its relative error is
    larger.
    """
    if dq.dtype != object:
        return np.asarray(np.tanh(np.abs(dq) / creep))
    x = signs(dq) * dq / creep
    return np.asarray(1.0 - 2.0 / (_exp(2.0 * x) + 1.0))


def dry_friction_indices(model: Model) -> list[int]:
    """Indices of the velocities with dry friction."""
    friction = model.friction
    dry_parameters = zip(friction.coulomb, friction.static, friction.load, strict=True)
    has_dry_friction = [not all(map(is_zero, parameters)) for parameters in dry_parameters]
    return [k for k, has_friction in enumerate(has_dry_friction) if has_friction]


def friction_bounds(model: Model, dq: Array, tau: Array) -> tuple[Array, Array]:
    """Largest dry friction at the speeds dq of joints that slide backward, and of joints that slide forward; (nv,) each.

    The two differ if friction grows with the load: the transmitted torque is the part of tau that remains after friction, as
    in :func:`torque_past_friction`.
    """
    dry = _dry_friction(model, dq)
    backward, forward = dry.copy(), dry.copy()
    for k, load_factor in enumerate(model.friction.load):
        if is_zero(load_factor):
            continue
        after_viscous = tau[k] - model.friction.viscous[k] * dq[k]
        for bounds, direction in ((backward, -1.0), (forward, 1.0)):
            y = after_viscous - direction * dry[k]
            transmitted = abs(y) / (1.0 + direction * load_factor * y.sign())
            bounds[k] = dry[k] + load_factor * transmitted
    return backward, forward


def _dry_friction(model: Model, dq: Array) -> Array:
    """Coulomb friction c plus the part of static friction s that remains at the speeds dq: c + (s - c) exp(-(dq/v)²); (nv,)."""
    friction = model.friction
    dry = np.full(dq.shape, 0.0, object)  # of numbers or symbols
    laws = zip(friction.coulomb, friction.static, friction.stribeck, dq, strict=True)
    for k, (c, s, v, speed) in enumerate(laws):
        if _are_equal(c, s):
            dry[k] = c
        else:
            dry[k] = c + (s - c) * _exp(-(speed / v) * (speed / v))
    return dry


def _are_equal(a: Any, b: Any) -> bool:
    """True if two numbers are equal; a symbol equals only itself."""
    are_numbers = isinstance(a, float) and isinstance(b, float)
    return a is b or (are_numbers and a == b)


def is_zero(x: Any) -> bool:
    """True for the number 0; False for symbols."""
    return isinstance(x, float) and x == 0.0


# Symbols have the methods exp, sign and clip; numbers do not.


def _exp(x: Any) -> Any:
    """Exponential of a symbol or number."""
    return x.exp() if hasattr(x, "exp") else np.exp(x)


def signs(x: Array) -> Array:
    """Sign -1, 0 or 1 of each entry, for symbols and numbers."""
    entry_signs = [entry.sign() if hasattr(entry, "sign") else np.sign(entry) for entry in x]
    return np.array(entry_signs, object).reshape(x.shape)


# ── Branch-free switching functions, for numbers and symbols


def positive(x: Any) -> Any:
    """1 if a number is above 0, else 0."""
    (sign,) = signs(np.array([x], object))
    return 0.5 * (sign + sign * sign)  # 0 for the signs -1 and 0


def either(which: Any, a: Any, b: Any) -> Any:
    """a if ``which`` is 1, b if ``which`` is 0; bit-exact for finite numbers."""
    return which * a + (1.0 - which) * b


def largest(numbers: Iterable[Any], bound: Any) -> Any:
    """Largest absolute value, at least ``bound``; NaN if any number is NaN."""
    for number in numbers:
        bound = abs(number).clip(bound, np.inf) if hasattr(number, "clip") else max(abs(number), bound)
    return bound


def smallest(numbers: Iterable[Any], bound: Any) -> Any:
    """Smallest number, at most ``bound``; NaN if any number is NaN."""
    for number in numbers:
        bound = number.clip(-np.inf, bound) if hasattr(number, "clip") else min(number, bound)
    return bound
