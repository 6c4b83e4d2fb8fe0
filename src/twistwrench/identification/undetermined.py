"""Quantities that no log determines: common gain, zeros and signs that other parameters explain, and others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.doubts import undetermined_table
from ..core.numbers import percent
from ..core.text import listed, spell_out
from ..core.typing import Array
from .parameters import BaseParameters, turning_joints

_MAX_FED_FORWARD, _MAX_UNSPANNED_SHARE = 1e-3, 1e-6
"""Residual, as a share of the torques, below that of any sensor; share of torques not spanned by other columns."""
_TURN, _GAIN = 0.3, 1.2


def undetermined_quantities(base: BaseParameters, left: float) -> dict[str, str]:
    """Sentences by name on quantities that no log determines; ``left`` is the residual as a share of the torques."""
    unknown, names = base.unknown, base.unknown.model.velocity_names
    kinds, held = np.array(unknown.kinds), unknown.held
    is_gain_explained, zeros, signs = _explained_errors(base)
    is_undetermined = {
        "gain-of-all": is_gain_explained,
        "zero": bool(zeros),
        "clock-rate": bool(((kinds == "motor_inertia") & ~held).any()),
        "sign-of-both": bool(signs),
        "base-about-vertical": bool(np.any(unknown.model.gravity)),
        "asymmetric-friction": {"coulomb", "offset"} <= set(kinds[~held].tolist()),
        "fed-forward": left < _MAX_FED_FORWARD,
    }
    joints = {"zero": listed([names[k] for k in zeros]), "sign-of-both": listed([names[k] for k in signs])}
    sentences: dict[str, str] = {}
    for name, texts in undetermined_table().items():
        if is_undetermined[name]:
            words = {"joints": joints.get(name), "left": percent(left, 2)}
            sentences[name] = " ".join(spell_out(text).format(**words) for text in texts if text)
    return sentences


def _explained_errors(base: BaseParameters) -> tuple[bool, list[int], list[int]]:
    """Errors of logs that other parameters of the robot can fully explain: a common gain, zeros, signs of position and torque.

    Torques of random states with such an error lie in the span of the columns without it; for signs, after a half turn
    of a joint.
    """
    unknown, model, free = base.unknown, base.unknown.model, ~base.held
    rng, unit, speed = np.random.default_rng(0), np.eye(model.nv), np.ones(model.nv)
    q, dq, ddq = rng.normal(size=(3, 20 + 3 * base.count // model.nv, model.nv))
    x = np.where(free, rng.normal(size=base.count), base.project(unknown.file_values))

    def columns(turn: Array, sign: Array = speed) -> Array:
        return unknown.columns(base.kept, sign * q + turn, sign * dq, sign * ddq, speed)

    turning = np.flatnonzero(turning_joints(model)).tolist()
    W = columns(0.0 * speed)
    whole = _Span.from_columns(W, x, free)
    zeros = [k for k in turning if whole.contains(columns(_TURN * unit[k]) @ x)]
    half_turns = [_Span.from_columns(columns(np.pi * unit[k]), x, free) for k in turning]
    signs: list[int] = []
    for k in turning:
        sign = speed - 2.0 * unit[k]
        tau = sign * (columns(0.0 * sign, sign) @ x)
        if any(span.contains(tau) for span in half_turns):
            signs.append(k)
    return whole.contains(_GAIN * (W @ x)), zeros, signs


@dataclass(frozen=True, eq=False)
class _Span:
    """Torques of the same states with any values of the free parameters."""

    known: Array
    """(n, nv) torques of the parameters with known values."""
    basis: Array
    """(n nv, k) orthonormal basis of the columns of the free parameters."""

    @classmethod
    def from_columns(cls, W: Array, x: Array, free: Array) -> _Span:
        """Span of the free columns of W (n, nv, r); the others have values of x (r,)."""
        known = W[:, :, ~free] @ x[~free]
        return cls(known, np.linalg.qr(W[:, :, free].reshape(known.size, -1))[0])

    def contains(self, tau: Array) -> bool:
        """True if torques (n, nv) are in the span."""
        residual = (tau - self.known).ravel()
        residual = residual - self.basis @ (self.basis.T @ residual)
        return bool(np.linalg.norm(residual) < _MAX_UNSPANNED_SHARE * np.linalg.norm(tau))
