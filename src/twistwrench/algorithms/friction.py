"""Joint friction (Modern Robotics section 8.9.4, with Stribeck's exponential), and the smooth switches it is made of."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..model.couplings import joint_torques, motor_torques, motor_velocities
from ..model.model import Model
from ..typing import Array


def friction_forces(model: Model, dq: Array, load: Array | None = None) -> Array:
    """The torques that overcome friction at dq, where each joint carries the torque ``load``; (nv,)."""
    u = motor_velocities(model, dq)
    lost = _drive_friction(model, u, None if load is None else motor_torques(model, load))
    return np.asarray(joint_torques(model, lost))


def _drive_friction(model: Model, u: Array, load: Array | None = None) -> Array:
    """The law at the velocities u of the drives, which carry ``load``; (nv,)."""
    f, s = model.friction, signs(u)
    tau = f.viscous * u + s * _dry(model, u)
    return np.asarray(tau if load is None else tau + s * f.load * (signs(load) * load))


def torque_past_friction(model: Model, dq: Array, tau: Array) -> Array:
    """Part of the torques tau that friction leaves; (nv,).

    The joint carries x, of which friction takes its part too: x + sign(dq) load |x| = y, with y what the other laws
    leave. As load < 1, x has the sign of y.
    """
    u = motor_velocities(model, dq)
    y = motor_torques(model, tau) - _drive_friction(model, u)
    return np.asarray(joint_torques(model, y / (1.0 + model.friction.load * (signs(u) * signs(y)))))


def torque_past_eased_friction(model: Model, dq: Array, tau: Array, share: Array) -> Array:
    """The same where dry friction is made continuous at rest: its part is multiplied by ``share``, :func:`eased`; (nv,)."""
    u = motor_velocities(model, dq)
    damping = model.friction.viscous * u
    y = motor_torques(model, tau) - damping - share * (_drive_friction(model, u) - damping)
    return np.asarray(joint_torques(model, y / (1.0 + share * model.friction.load * (signs(u) * signs(y)))))


def eased(dq: Array, creep: Array) -> Array:
    """tanh(|dq| / creep), the share of dry friction that is left at low speeds; (nv,).

    Of symbols by the exponential, which near rest is good to 1e-16 and not to as many digits.
    """
    if dq.dtype != object:
        return np.asarray(np.tanh(np.abs(dq) / creep))
    return np.asarray(1.0 - 2.0 / (_exp(2.0 * (signs(dq) * dq / creep)) + 1.0))


def rubbing(model: Model) -> list[int]:
    """The velocities that dry friction acts on."""
    f = model.friction
    laws = zip(f.coulomb, f.static, f.load, strict=True)
    return [k for k, law in enumerate(laws) if not all(map(is_zero, law))]


def friction_bounds(model: Model, dq: Array, tau: Array) -> tuple[Array, Array]:
    """Largest dry friction of joints that slide back and that slide forth, at the speeds dq; (nv,) each.

    The two differ where friction grows with the load: what the joint carries of the torque tau is what friction leaves.
    """
    dry, load = _dry(model, dq), model.friction.load
    back, forth = dry.copy(), dry.copy()
    for k, c in enumerate(load):
        if not is_zero(c):
            y = tau[k] - model.friction.viscous[k] * dq[k]
            for found, way in ((back, -1.0), (forth, 1.0)):
                carried = abs(y - way * dry[k])
                found[k] = dry[k] + c * (carried / (1.0 + way * c * (y - way * dry[k]).sign()))
    return back, forth


def _dry(model: Model, dq: Array) -> Array:
    """Coulomb friction, and the static friction that remains at this speed; (nv,)."""
    f = model.friction
    dry = [
        c if _same(c, s) else c + (s - c) * _exp(-(x / v) * (x / v))
        for c, s, v, x in zip(f.coulomb, f.static, f.stribeck, dq, strict=True)
    ]
    return np.array(dry, object).reshape(dq.shape)


def _same(a: Any, b: Any) -> bool:
    """True if two numbers are equal; symbols differ from all but themselves."""
    return a is b or (isinstance(a, float) and isinstance(b, float) and a == b)


def is_zero(x: Any) -> bool:
    """True if this is the number 0 and not a symbol."""
    return isinstance(x, float) and x == 0.0


def _exp(x: Any) -> Any:
    return x.exp() if hasattr(x, "exp") else np.exp(x)


def signs(x: Array) -> Array:
    """-1, 0 or 1, of symbols and of numbers."""
    return np.array([e.sign() if hasattr(e, "sign") else np.sign(e) for e in x], object).reshape(x.shape)


# ── Branch-free switching functions, on numbers and on symbols


def positive(x: Any) -> Any:
    """1 where a number is above 0, else 0."""
    s = signs(np.array([x], object))[0]
    return 0.5 * (s + s * s)


def either(which: Any, a: Any, b: Any) -> Any:
    """a where ``which`` is 1, b where it is 0: to the bit, for numbers that are finite."""
    return which * a + (1.0 - which) * b


def largest(numbers: Iterable[Any], least: Any) -> Any:
    """The largest size among numbers, ``least`` at least; NaN where one is."""
    for x in numbers:
        least = abs(x).clip(least, np.inf) if hasattr(x, "clip") else max(abs(x), least)
    return least


def smallest(numbers: Iterable[Any], most: Any) -> Any:
    """The smallest of numbers, ``most`` at most; NaN where one is."""
    for x in numbers:
        most = x.clip(-np.inf, most) if hasattr(x, "clip") else min(x, most)
    return most
