"""What steps of one length leave out of the impulse of a wrench that is a function of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..core.printed_numbers import printed
from ..core.probe_rule import ProbeRule, left_out
from ..typing import Array

_REMARKED = 0.05
"""Share of the momentum from which it is remarked on."""

State = tuple[Array, Array, Array, Array]
Push = Callable[..., Array]
"""From the time, and quaternion, position, angular and linear momentum: the wrench (6,) about the centre of mass."""


class Unseen:
    """The impulses left out so far, signs aside, and where most of them are."""

    def __init__(self, fractions: Sequence[float], h: float, spacing: float) -> None:
        b = np.array(fractions)
        self.h, self.rule = h, ProbeRule(np.cumsum(b) - 0.5 * b, b, spacing)
        self.needed = bool(np.isfinite(spacing)) and self.rule.needed(h)
        self.sum = np.zeros(6)
        self.worst, self.when = 0.0, 0.0

    def look(self, t: float, push: Push, before: State, after: State) -> None:
        """Take note of a step from t: the wrench is asked along the straight line between the two states."""
        if not self.needed:
            return
        shares, weights = self.rule.shares(self.h)
        found = []
        for share in shares.tolist():
            q, *rest = ((1.0 - share) * a + share * b for a, b in zip(before, after, strict=True))
            found.append(push(t + share * self.h, q / np.linalg.norm(q), *rest))
        forces = np.array(found)
        missing = self.h * np.abs(left_out(weights, forces))
        self.sum += missing
        if missing.max() > self.worst:
            far = np.abs(forces - np.median(forces, axis=0)).max(axis=1)
            self.worst, self.when = float(missing.max()), t + self.h * float(shares[int(far.argmax())])

    def remark(self, linear: float, angular: float) -> str:
        """What to know, where it is much of the largest linear [N s] and angular momentum [N m s]; else empty."""
        if not (self.sum[3:].max() > _REMARKED * linear or self.sum[:3].max() > _REMARKED * angular):
            return ""
        return (
            f"the wrench changes within steps of {printed(self.h, 3)} s in a way that the method does not see, most of all "
            f"about t = {printed(self.when)} s: take a smaller dt"
        )
