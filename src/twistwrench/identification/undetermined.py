"""Quantities that no log determines: common gain, zeros and signs that other parameters explain, and others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.doubts import undetermined_table
from ..core.numbers import percent
from ..core.text import listed, spell_out
from ..core.typing import Array
from .parameters import BaseParameters, turning_joints

_MAX_FED_FORWARD_RESIDUAL = 1e-3
"""Residual, as a share of the torques, that only computed torques reach: torque sensors have a larger one."""
_MAX_UNSPANNED_SHARE = 1e-6
"""Share of the torques up to which they lie in the span of other columns."""
_ZERO_ERROR = 0.3
"""Error of a joint's zero [rad], of any size, whose torques are tested."""
_COMMON_GAIN = 1.2
"""Gain of all torques, of any size except 1, that is tested."""


def undetermined_quantities(base: BaseParameters, residual: float) -> dict[str, str]:
    """Sentences by name on quantities that no log determines; ``residual`` is a share of the torques."""
    unknown = base.unknown
    names = unknown.model.velocity_names
    free_kinds = set(np.array(unknown.kinds)[~unknown.held].tolist())
    is_gain_explained, zeros, signs = _explained_errors(base)
    is_undetermined = {
        "gain-of-all": is_gain_explained,
        "zero": bool(zeros),
        "clock-rate": "motor_inertia" in free_kinds,
        "sign-of-both": bool(signs),
        "base-about-vertical": bool(np.any(unknown.model.gravity)),
        "asymmetric-friction": {"coulomb", "offset"} <= free_kinds,
        "fed-forward": residual < _MAX_FED_FORWARD_RESIDUAL,
    }
    joint_names = {"zero": listed([names[k] for k in zeros]), "sign-of-both": listed([names[k] for k in signs])}
    sentences: dict[str, str] = {}
    for name, texts in undetermined_table().items():
        if is_undetermined[name]:
            fields = {"joints": joint_names.get(name), "left": percent(residual, 2)}  # of the texts in the table
            sentences[name] = " ".join(spell_out(text).format(**fields) for text in texts if text)
    return sentences


def _explained_errors(base: BaseParameters) -> tuple[bool, list[int], list[int]]:
    """Errors of logs that other parameters of the robot can fully explain.

    Torques of random states with such an error lie in the span of the columns without it. A wrong sign may need a half
    turn of a joint besides.

    Returns
    -------
    is_gain_explained : True for a common gain of all torques
    zeros : joints whose error of the zero is explained
    signs : joints whose wrong sign, of position and torque together, is explained
    """
    unknown, free = base.unknown, ~base.held
    model = unknown.model
    rng = np.random.default_rng(0)
    state_count = 20 + 3 * base.count // model.nv  # three times as many equations as groups, at least
    q, dq, ddq = rng.normal(size=(3, state_count, model.nv))
    x = np.where(free, rng.normal(size=base.count), base.project(unknown.file_values))
    no_offset = np.zeros(model.nv)
    ones = np.ones(model.nv)
    unit_vectors = np.eye(model.nv)

    def columns(offset: Array, sign: Array = ones) -> Array:
        """(n, nv, r) columns of the states with other zeros and signs of the joints, (nv,) each."""
        friction_speed = ones
        return unknown.columns(base.kept, sign * q + offset, sign * dq, sign * ddq, friction_speed)

    W = columns(no_offset)
    span_without_error = _Span.from_columns(W, x, free)
    is_gain_explained = span_without_error.contains(_COMMON_GAIN * (W @ x))
    turning = np.flatnonzero(turning_joints(model)).tolist()
    zeros = [k for k in turning if span_without_error.contains(columns(_ZERO_ERROR * unit_vectors[k]) @ x)]
    half_turn_spans = [_Span.from_columns(columns(np.pi * unit_vectors[k]), x, free) for k in turning]
    signs: list[int] = []
    for k in turning:
        sign = ones - 2.0 * unit_vectors[k]  # -1 for joint k, 1 for the others
        tau = sign * (columns(no_offset, sign) @ x)
        if any(span.contains(tau) for span in half_turn_spans):
            signs.append(k)
    return is_gain_explained, zeros, signs


@dataclass(frozen=True, eq=False)
class _Span:
    """Set of the torques of some states for all values of the free parameters."""

    known: Array
    """(n, nv) torques of the parameters with known values."""
    basis: Array
    """(n nv, k) orthonormal basis of the columns of the free parameters."""

    @classmethod
    def from_columns(cls, W: Array, x: Array, free: Array) -> _Span:
        """Torques W x with W (n, nv, r); x (r,) has the values of the parameters that are not free."""
        known = W[:, :, ~free] @ x[~free]
        free_columns = W[:, :, free].reshape(known.size, -1)
        basis, _ = np.linalg.qr(free_columns)
        return cls(known, basis)

    def contains(self, tau: Array) -> bool:
        """True if torques (n, nv) are in the span."""
        tau_of_free = (tau - self.known).ravel()
        residual = tau_of_free - self.basis @ (self.basis.T @ tau_of_free)
        return bool(np.linalg.norm(residual) < _MAX_UNSPANNED_SHARE * np.linalg.norm(tau))
