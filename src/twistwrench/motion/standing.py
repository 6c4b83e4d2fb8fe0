"""Where joints stand although a spline through their samples says that they move."""

from __future__ import annotations

import numpy as np

from ..model.model import Model
from ..typing import Array
from .log_noise import Survey

SURE = 5.0
"""Standard deviations from which a velocity's sign is believed: of ten million rows at rest, six would be taken to move."""
_ROUND_OFFS = 16.0
"""Units in the last place of q that rounding of the samples and of the spline moves its slope by, over a step of time."""


def standing(quality: Survey, model: Model, t: Array, q: Array, dq: Array, sigma_dq: Array) -> Array:
    """Where derived velocities (n, nv) are within their uncertainty: that of noise, and that of arithmetic."""
    steps = np.diff(t)
    step = np.minimum(np.r_[steps[:1], steps], np.r_[steps, steps[-1:]])
    # A joint whose samples repeat stands, although the spline still rings there from where it moved; on a grid, where
    # slow joints repeat samples too, the noise decides.
    repeats = np.zeros((len(t), q.shape[1]), bool)
    repeats[1:-1] = (q[1:-1] == q[:-2]) & (q[1:-1] == q[2:])
    repeats &= quality.quantum == 0
    still = np.asarray(np.abs(dq) <= SURE * sigma_dq)
    for b in model.leaders:
        q_here = b.places[0]
        here = b.places[1]
        arithmetic = _ROUND_OFFS * np.finfo(float).eps * np.abs(q[:, q_here]).max(axis=1, initial=0.0) / step
        still[:, here] |= np.abs(dq[:, here]) <= arithmetic[:, None]
        still[:, here] |= repeats[:, q_here].all(axis=1, keepdims=True)
    return still


def ringing(quality: Survey, model: Model, t: Array, curves: Array, dq: Array, factors: Array) -> Array:
    """Where the spline moves a joint and the samples on either side do not, or the other way: it rings; (n, nv) bool.

    Only where the step it claims is one that the samples would show. ``factors`` take the columns of q to SI units.
    """
    claimed = np.zeros(dq.shape, bool)
    if len(t) < 3:
        return claimed
    span, moved = t[2:] - t[:-2], curves[2:] - curves[:-2]
    shown = np.maximum(quality.quantum, SURE * quality.noise)
    for b in model.leaders:
        if b.joint.nq == 1:
            step = dq[1:-1, b.v_index] * span
            large = np.abs(step) > shown[b.q_index] * factors[b.q_index]
            claimed[1:-1, b.v_index] = large & (step * moved[:, b.q_index] <= 0)
    return claimed
