"""Columns of mimic joints, compared with those of their leaders."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.numbers import number, seconds
from ...core.typing import Array
from ...mechanics.joints.units import unit_of
from ..columns import MimicJointColumn

if TYPE_CHECKING:
    from ..motion_log import LogRows

_MIN_SHARE_OF_TRAVEL = 0.1
"""Fraction of a joint's travel; smaller deviations are play or coupling errors."""
_MIN_DEVIATION = {True: 0.02, False: 0.002}
"""Smallest reported deviation of rotating [rad] and sliding [m] joints."""


def mimic_doubts(columns: Sequence[MimicJointColumn], portions: Iterable[tuple[LogRows, Array]]) -> list[Doubt]:
    """Doubts about mimic joints whose columns deviate from the coupling to their leaders.

    ``portions`` are rows of the log, each with the table that they come from.
    """
    if not columns:
        return []
    lowest, highest = np.full(len(columns), math.inf), np.full(len(columns), -math.inf)
    largest = [(0.0, 0.0)] * len(columns)  # deviation of each joint, and its time
    for motion, table in portions:
        for k, (follower, column, factor) in enumerate(columns):
            logged = factor * table[:, column]
            coupled = follower.ratio * motion.q[:, follower.leader] + follower.offset
            lowest[k] = min(lowest[k], logged.min(), coupled.min())
            highest[k] = max(highest[k], logged.max(), coupled.max())
            deviations = np.abs(logged - coupled)
            row = int(deviations.argmax())
            largest[k] = max(largest[k], (float(deviations[row]), float(motion.time[row])))
    doubts = []
    for (follower, _, _), (deviation, time), travel in zip(columns, largest, highest - lowest, strict=True):
        if deviation > max(_MIN_DEVIATION[follower.angular], _MIN_SHARE_OF_TRAVEL * float(travel)):
            distance = f"{number(deviation)} {unit_of('q', follower.angular)}"
            words: dict[str, Any] = {"joint": follower.name, "distance": distance, "time": seconds(time)}
            doubts.append(doubt("mimic", [follower.name], **words))
    return doubts
