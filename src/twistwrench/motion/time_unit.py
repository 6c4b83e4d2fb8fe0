"""Whether the times of a motion are in milliseconds or less, where the caller gives numbers without a unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import printed
from ..typing import Array
from .contradictions import slow_steps
from .coordinates import Coordinates
from .gain_text import near

if TYPE_CHECKING:
    from ..model.limits import Limits

_SOME_MOVE = 0.05
_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}


def time_doubt(coordinates: Coordinates, time: Array, q: Array, dq: Array | None, limits: Limits) -> str:
    """What speaks against times (n,) in seconds, of positions (n, nq) and velocities (n, nv) where they are given; or "".

    With velocities: the way that they make in these times is 1000 (or 1000², 1000³) times the way of the positions. Without:
    joints hardly move within steps that are long.
    """
    if dq is None:
        found = slow_steps(coordinates, time, q, limits)
        return "" if found is None else f"{found[0]}: time seems to be in {found[1]}"
    single = np.flatnonzero(coordinates.position_of >= 0)
    steps = np.abs(np.diff(q[:, coordinates.position_of[single]], axis=0))
    steps = np.where(coordinates.angular_velocity[single] & (steps > np.pi), 0.0, steps)  # a turn that was left out
    speeds = np.abs(dq[:, single])
    made, said = steps.sum(axis=0), (0.5 * (speeds[1:] + speeds[:-1]) * np.diff(time)[:, None]).sum(axis=0)
    moving = made > _SOME_MOVE
    gains = (said[moving] / made[moving]).tolist()
    for factor, unit in _UNITS.items():
        if gains and all(near(gain, factor) for gain in gains):
            times = f"{printed(factor)} times the way of the positions"
            return f"velocities make {times} in these times: time seems to be in {unit}"
    return ""
