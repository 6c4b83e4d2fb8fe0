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

_MIN_RANGE = 20.0
"""Range of a joint's positions, in deviations of its error, below which it does not move."""
_MIN_CORRELATION, _MAX_RATIO_TO_OTHER = 0.6, 0.5
"""Correlation from which positions follow a command; ratio of the own one to that of another joint if exchanged."""
_MIN_SLOPE, _MAX_SLOPE = 0.4, 2.5
"""Bounds of the slope of positions by commands; weak servos sag and overshoot."""
_DELAYS = np.linspace(0.0, 0.12, 7)
_MIN_SECONDS, _MIN_ROWS_OF_UNKNOWN = 5.0, 20
"""Least duration [s], and rows per unknown."""
_UNSURE_ERROR, _LOOK_AGAIN_ERROR, _MAX_GROWTH = 0.2, 0.6, 1.5
"""Held-out error as a share of the tracking error: UNSURE, LOOK AGAIN; and its ratio to that of used rows."""
_MAX_SMALL_ERROR = 2.0
"""Held-out error, in sizes of the position error, below which it does not matter."""


def moving_joints(logs: Sequence[ServoLog]) -> Array:
    """(nv,) bool, False for joints that do not move beyond their error."""
    extent = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0)
    return np.asarray(extent > _MIN_RANGE * position_errors(logs))


def command_doubts(robot: Robot, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Commands of another joint, with the other sign, or in another unit."""
    names, (alike, slopes) = robot.model.velocity_names, _likeness(logs)
    for j in np.flatnonzero(moving_joints(logs)):
        own = alike[j, j]
        other = int(np.argmax(np.where(np.arange(len(names)) == j, -1.0, alike[j])))
        if alike[j, other] > _MIN_CORRELATION and own < _MAX_RATIO_TO_OTHER * alike[j, other]:
            yield doubt("servo-exchanged", [names[j]], other=names[other], share=number(float(alike[j, other]), 3))
        elif own < -_MIN_CORRELATION:
            yield doubt("servo-sign", [names[j]])
        elif own > _MIN_CORRELATION and not _MIN_SLOPE < slopes[j] < _MAX_SLOPE:
            yield doubt("servo-unit", [names[j]], ratio=number(float(slopes[j]), 3), found={"value": float(slopes[j])})


def _likeness(logs: Sequence[ServoLog]) -> tuple[Array, Array]:
    """Correlations (nv, nv) of positions with commands at the delay of their largest size, and slopes (nv,) by the own one."""
    q = np.concatenate([_without_mean(log.q) for log in logs])
    found = list[Array]()
    for delay in _DELAYS:
        c = np.concatenate([_without_mean(log.mean_command(log.time - delay, log.period, "zero")) for log in logs])
        sizes = np.linalg.norm(q, axis=0)[:, None], np.linalg.norm(c, axis=0)
        found.append(q.T @ c / np.maximum(sizes[0] * sizes[1], 1e-300))
    every = np.stack(found)
    alike = np.take_along_axis(every, np.abs(every).argmax(axis=0)[None], axis=0)[0]
    ratio = np.linalg.norm(q, axis=0) / np.maximum(np.linalg.norm(c, axis=0), 1e-300)
    return alike, np.diagonal(alike) * ratio


def _without_mean(x: Array) -> Array:
    return np.asarray(x - x.mean(axis=0))


def fit_doubts(found: IdentifiedServos, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Motions that determine too little, and errors that the servos do not explain."""
    names, live = np.array(found.joints), found.live
    if not live.all():
        yield doubt("servo-still", names[~live].tolist())
    seconds, rows = 0.0, 0
    for log in logs:
        seconds += float(log.time[-1])
        rows += len(log.time)
    if seconds < _MIN_SECONDS or rows < _MIN_ROWS_OF_UNKNOWN * len(QUANTITIES):
        yield doubt("servo-short", seconds=number(seconds, 3), rows=rows)
    yield from _error_doubts(found)
    if not found.whole.any() and not found.known:
        yield doubt("servo-no-scale")
    wide = live & ~found.whole & ~found.only_ratios
    if wide.any():
        widths = [_widest(found, j) for j in np.flatnonzero(wide).tolist()]
        yield doubt("servo-wide", names[wide].tolist(), widths=listed(widths, 4))


def _error_doubts(found: IdentifiedServos) -> Iterator[Doubt]:
    """Held-out error above a share of the tracking error, or above that of the used rows."""
    held, live = np.array(list(found.held_out.joints.values())), found.live
    size = np.array(list(found.position_error.values()))
    large = live & (held > _UNSURE_ERROR) & (size > _MAX_SMALL_ERROR * found.fit.sigma)
    if large.any():
        worst = int(np.argmax(np.where(large, held, 0.0)))
        yield doubt(
            "servo-unexplained", [found.joints[worst]], share=percent(float(held[worst]), 2),
            level="refuse" if held[worst] > _LOOK_AGAIN_ERROR else "unsure", found={"value": float(held[worst])},
        )  # fmt: skip
    elif found.held_out.all > _MAX_GROWTH * found.trained.all and found.held_out.all > 0.5 * _UNSURE_ERROR:
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
