"""Doubts about servos: commands that are not those of the positions, motions that determine too little, unexplained errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...core.doubts import Doubt, Level, doubt
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
_MIN_CORRELATION = 0.6
"""Correlation with a command from which positions follow it."""
_MAX_RATIO_TO_OTHER = 0.5
"""If commands are exchanged: largest correlation with the own command, over that with another joint's command."""
_MIN_SLOPE, _MAX_SLOPE = 0.4, 2.5
"""Bounds of the slope of positions by commands in the same unit; weak servos sag and overshoot."""
_DELAYS = np.linspace(0.0, 0.12, 7)
"""Delays of the commands [s] that are tried."""
_MIN_SECONDS = 5.0
"""Least total duration of the logs [s]."""
_MIN_ROWS_OF_UNKNOWN = 20
"""Least number of rows for each unknown of a joint."""
_UNSURE_ERROR, _LOOK_AGAIN_ERROR = 0.2, 0.6
"""Held-out errors, as shares of the tracking error, above which a fit is UNSURE, and one to LOOK AGAIN at."""
_MAX_GROWTH = 1.5
"""Largest ratio of the held-out error to that of used rows."""
_MAX_SMALL_ERROR = 2.0
"""Held-out error, in standard deviations of a position, up to which it is negligible."""


def moving_joints(logs: Sequence[ServoLog]) -> Array:
    """(nv,) bool, False for joints that do not move beyond their error."""
    extent = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0)
    return np.asarray(extent > _MIN_RANGE * position_errors(logs))


def command_doubts(robot: Robot, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Commands of another joint, with the other sign, or in another unit."""
    names = robot.model.velocity_names
    correlations, slopes = _correlations_and_slopes(logs)
    for j in np.flatnonzero(moving_joints(logs)):
        own = correlations[j, j]
        is_own = np.arange(len(names)) == j
        other_joint = int(np.argmax(np.where(is_own, -1.0, correlations[j])))
        other = correlations[j, other_joint]
        slope = float(slopes[j])
        if other > _MIN_CORRELATION and own < _MAX_RATIO_TO_OTHER * other:
            yield doubt("servo-exchanged", [names[j]], other=names[other_joint], share=number(float(other), 3))
        elif own < -_MIN_CORRELATION:
            yield doubt("servo-sign", [names[j]])
        elif own > _MIN_CORRELATION and not _MIN_SLOPE < slope < _MAX_SLOPE:
            yield doubt("servo-unit", [names[j]], ratio=number(slope, 3), found={"value": slope})


def _correlations_and_slopes(logs: Sequence[ServoLog]) -> tuple[Array, Array]:
    """Correlations of positions with commands, and slopes of positions by their own commands.

    Returns
    -------
    correlations : (nv, nv) array, of each joint's positions with each joint's commands, at the delay at which it is largest
    slopes : (nv,) array, with the commands at the last delay
    """
    q = np.concatenate([_without_mean(log.q) for log in logs])
    correlations_by_delay = list[Array]()
    for delay in _DELAYS:
        c = np.concatenate([_without_mean(log.mean_command(log.time - delay, log.period, "zero")) for log in logs])
        q_norms, c_norms = np.linalg.norm(q, axis=0)[:, None], np.linalg.norm(c, axis=0)
        correlations_by_delay.append(q.T @ c / np.maximum(q_norms * c_norms, 1e-300))
    stacked = np.stack(correlations_by_delay)
    best_delay = np.abs(stacked).argmax(axis=0)
    correlations = np.take_along_axis(stacked, best_delay[None], axis=0)[0]
    ratio = np.linalg.norm(q, axis=0) / np.maximum(np.linalg.norm(c, axis=0), 1e-300)
    return correlations, np.diagonal(correlations) * ratio


def _without_mean(x: Array) -> Array:
    return np.asarray(x - x.mean(axis=0))


def fit_doubts(found: IdentifiedServos, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Motions that determine too little, and errors that the servos do not explain."""
    names, moves = np.array(found.joints), found.live
    if not moves.all():
        yield doubt("servo-still", names[~moves].tolist())
    seconds, rows = 0.0, 0
    for log in logs:
        seconds += float(log.time[-1])
        rows += len(log.time)
    if seconds < _MIN_SECONDS or rows < _MIN_ROWS_OF_UNKNOWN * len(QUANTITIES):
        yield doubt("servo-short", seconds=number(seconds, 3), rows=rows)
    yield from _error_doubts(found)
    if not found.whole.any() and not found.known:
        yield doubt("servo-no-scale")
    has_wide_interval = moves & ~found.whole & ~found.only_ratios
    if has_wide_interval.any():
        widths = [_widest_value_text(found, j) for j in np.flatnonzero(has_wide_interval).tolist()]
        yield doubt("servo-wide", names[has_wide_interval].tolist(), widths=listed(widths, 4))


def _error_doubts(found: IdentifiedServos) -> Iterator[Doubt]:
    """Held-out error above a share of the tracking error, or above that of the used rows."""
    error_shares = np.array(list(found.held_out.joints.values()))
    errors = np.array(list(found.position_error.values()))  # [rad, m]
    is_large = found.live & (error_shares > _UNSURE_ERROR) & (errors > _MAX_SMALL_ERROR * found.fit.sigma)
    held_out, used = found.held_out.all, found.trained.all
    if is_large.any():
        worst = int(np.argmax(np.where(is_large, error_shares, 0.0)))
        share = float(error_shares[worst])
        level: Level = "refuse" if share > _LOOK_AGAIN_ERROR else "unsure"
        yield doubt(
            "servo-unexplained", [found.joints[worst]], share=percent(share, 2), level=level, found={"value": share}
        )
    elif held_out > _MAX_GROWTH * used and held_out > 0.5 * _UNSURE_ERROR:
        yield doubt("servo-drifts", share=percent(held_out, 2), used=percent(used, 2), found={"value": held_out})


def _widest_value_text(found: IdentifiedServos, j: int) -> str:
    """Name of the undetermined value of a joint with the widest interval, and its half width."""
    widths = found.relative()
    undetermined = [name for name in QUANTITIES if not found.determined[name][j]] or list(QUANTITIES)
    widest = max(undetermined, key=lambda name: float(widths[name][j]))
    return f"{widest} of {found.joints[j]} {relative_width(float(widths[widest][j]))}"
