"""Numbers that look like another unit's: millimetres for metres, degrees for radians."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import printed
from ..typing import Array

if TYPE_CHECKING:
    from ..model.limits import Limits
    from ..robot import Robot

_FAR = 1.0
"""m: few hands carry anything so far out, and few slides pass their stops by as much."""


def unit_slips(
    robot: Robot, q: Array, limits: Limits, places: Mapping[str, Array], *, degrees: bool = False
) -> Iterator[str]:
    """Sentences about what is too far off to be meant: ``places`` (3,) [m] by name, and the joints of q (nq,).

    A place is more than 1 m out; a joint that turns more than a turn beyond its limits, or a turn beyond a whole one where it
    has none, unless angles are in ``degrees`` anyway; a joint that slides more than 1 m beyond.

    >>> import twistwrench as tw
    >>> ur5 = tw.robots.ur5()
    >>> for slip in unit_slips(ur5, np.array([0, 0, 90.0, 0, 0, 0]), ur5.limits, {"--com": np.array([0, 0, 80.0])}):
    ...     print(slip)
    --com is 80 m from its frame: lengths are in metres. If those are mm, write 0,0,0.08.
    elbow_joint at 90 rad is more than a turn beyond its limits: angles are in radians. If those are degrees, add --degrees.
    """
    for name, place in places.items():
        if (far := float(np.linalg.norm(place))) > _FAR:
            metres = ",".join(f"{printed(x / 1000)}" for x in place)
            yield f"{name} is {printed(far)} m from its frame: lengths are in metres. If those are mm, write {metres}."
    for b in robot.model.leaders:
        if b.joint.nq != 1:
            continue
        name, value = b.joint.name, float(q[b.q_index])
        turns = bool(b.joint.axes[0][:3].any())
        whole = 2 * math.pi if turns else math.inf
        low, high = max(float(limits.lower[b.v_index]), -whole), min(float(limits.upper[b.v_index]), whole)
        beyond = max(low - value, value - high)
        if turns and not degrees and beyond > 2 * math.pi:
            yield (
                f"{name} at {printed(value)} rad is more than a turn beyond its limits: angles are in radians. If those "
                "are degrees, add --degrees."
            )
        elif not turns and beyond > _FAR:
            yield (
                f"{name} at {printed(value)} m is more than 1 m beyond its limits: lengths are in metres. If those are mm, "
                f"write {printed(value / 1000)}."
            )
