"""Doubts about servos: commands that are not those of the positions, motions that determine too little, unexplained errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.numbers import number, percent
from ...core.text import listed
from ...core.typing import Array
from ...robot import Robot
from .output_error import position_errors
from .replay import QUANTITIES, ServoLog
from .result_view import relative_width

if TYPE_CHECKING:
    from .result import IdentifiedServos

_STILL = 20.0
"""Range of a joint's positions, in deviations of its error, below which it does not move."""
_ALIKE, _HALF = 0.6, 0.5
"""Correlation from which positions follow a command; ratio of the own one to that of another joint if exchanged."""
_LEAST, _MOST = 0.4, 2.5
"""Bounds of the slope of positions by commands; weak servos sag and overshoot."""
_DELAYS = np.linspace(0.0, 0.12, 7)
_SECONDS, _ROWS = 5.0, 20
"""Least duration [s], and rows per unknown."""
_UNEXPLAINED, _NOTHING, _GROWS = 0.2, 0.6, 1.5
"""Held-out error as a share of the tracking error: UNSURE, LOOK AGAIN; and its ratio to that of used rows."""
_SMALL = 2.0
"""Held-out error, in sizes of the position error, below which it does not matter."""


def moving_joints(logs: Sequence[ServoLog]) -> Array:
    """(nv,) bool, False for joints that do not move beyond their error."""
    extent = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0)
    return np.asarray(extent > _STILL * position_errors(logs))


def command_doubts(robot: Robot, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Commands of another joint, with the other sign, or in another unit."""
    names, (alike, slopes) = robot.model.velocity_names, _likeness(logs)
    for j in np.flatnonzero(moving_joints(logs)):
        own, other = alike[j, j], int(np.argmax(np.where(np.arange(len(names)) == j, -1.0, alike[j])))
        if alike[j, other] > _ALIKE and own < _HALF * alike[j, other]:
            yield doubt("servo-exchanged", [names[j]], other=names[other], share=number(float(alike[j, other]), 3))
        elif own < -_ALIKE:
            yield doubt("servo-sign", [names[j]])
        elif own > _ALIKE and not _LEAST < slopes[j] < _MOST:
            yield doubt("servo-unit", [names[j]], ratio=number(float(slopes[j]), 3), found={"value": float(slopes[j])})


def _likeness(logs: Sequence[ServoLog]) -> tuple[Array, Array]:
    """Correlations (nv, nv) of positions with commands at the delay of their largest size, and slopes (nv,) by the own one."""
    q = np.concatenate([_centred(log.q) for log in logs])
    found = list[Array]()
    for delay in _DELAYS:
        c = np.concatenate([_centred(log.commanded(log.time - delay, log.period, "zero")) for log in logs])
        sizes = np.linalg.norm(q, axis=0)[:, None], np.linalg.norm(c, axis=0)
        found.append(q.T @ c / np.maximum(sizes[0] * sizes[1], 1e-300))
    every = np.stack(found)
    alike = np.take_along_axis(every, np.abs(every).argmax(axis=0)[None], axis=0)[0]
    ratio = np.linalg.norm(q, axis=0) / np.maximum(np.linalg.norm(c, axis=0), 1e-300)
    return alike, np.diagonal(alike) * ratio


def _centred(x: Array) -> Array:
    return np.asarray(x - x.mean(axis=0))


def fit_doubts(found: IdentifiedServos, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Motions that determine too little, and errors that the servos do not explain."""
    names, live = np.array(found.joints), found.live
    if not live.all():
        yield doubt("servo-still", names[~live].tolist())
    seconds, rows = sum(float(log.time[-1]) for log in logs), sum(len(log.time) for log in logs)
    if seconds < _SECONDS or rows < _ROWS * len(QUANTITIES):
        yield doubt("servo-short", seconds=number(seconds, 3), rows=rows)
    yield from _unexplained(found)
    if not found.whole.any() and not found.known:
        yield doubt("servo-no-scale")
    wide = live & ~found.whole & ~found.only_ratios
    if wide.any():
        yield doubt(
            "servo-wide", names[wide].tolist(), widths=listed([_widest(found, int(j)) for j in np.flatnonzero(wide)], 4)
        )


def _unexplained(found: IdentifiedServos) -> Iterator[Doubt]:
    """Held-out error above a share of the tracking error, or above that of the used rows."""
    held, live = np.array(list(found.held_out.joints.values())), found.live
    size = np.array(list(found.position_error.values()))
    large = live & (held > _UNEXPLAINED) & (size > _SMALL * found.fit.sigma)
    if large.any():
        worst = int(np.argmax(np.where(large, held, 0.0)))
        yield doubt(
            "servo-unexplained", [found.joints[worst]], share=percent(float(held[worst]), 2),
            level="refuse" if held[worst] > _NOTHING else "unsure", found={"value": float(held[worst])},
        )  # fmt: skip
    elif found.held_out.all > _GROWS * found.trained.all and found.held_out.all > 0.5 * _UNEXPLAINED:
        yield doubt(
            "servo-drifts", share=percent(found.held_out.all, 2), used=percent(found.trained.all, 2),
            found={"value": found.held_out.all},
        )  # fmt: skip


def _widest(found: IdentifiedServos, j: int) -> str:
    """Value of a joint with the widest interval, and its half width."""
    width = found.relative()
    open_ones = [name for name in QUANTITIES if not found.determined[name][j]] or list(QUANTITIES)
    name = max(open_ones, key=lambda one: float(width[one][j]))
    return f"{name} of {found.joints[j]} {relative_width(float(width[name][j]))}"
