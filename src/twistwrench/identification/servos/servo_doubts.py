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
"""Correlation of positions with a command from which they follow it."""
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
_UNSURE_ERROR = 0.2
"""Held-out error, as a share of the tracking error, above which a fit is UNSURE."""
_LOOK_AGAIN_ERROR = 0.6
"""Held-out error, as a share of the tracking error, above which the verdict is LOOK AGAIN."""
_MIN_DRIFT_ERROR = 0.5 * _UNSURE_ERROR
"""Held-out error, as a share of the tracking error, from which its growth is a doubt."""
_MAX_GROWTH = 1.5
"""Largest ratio of the held-out error to the error of used rows."""
_MIN_NORM = 1e-300
"""Least divisor, for commands and positions that do not change."""
_MAX_LISTED = 4
"""Largest number of intervals in a sentence."""
_MAX_SMALL_ERROR = 2.0
"""Held-out error, in standard deviations of a position, up to which it is negligible."""


def moving_joints(logs: Sequence[ServoLog]) -> Array:
    """(nv,) bool, False for joints that do not move beyond their error."""
    ranges = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0)
    return np.asarray(ranges > _MIN_RANGE * position_errors(logs))


def command_doubts(robot: Robot, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Doubts about commands: those of another joint, with the other sign, or in another unit."""
    names = robot.model.velocity_names
    correlations, slopes = _correlations_and_slopes(logs)
    for j in np.flatnonzero(moving_joints(logs)):
        own_correlation = correlations[j, j]
        is_own = np.arange(len(names)) == j
        correlations_with_others = np.where(is_own, -1.0, correlations[j])
        other_joint = int(np.argmax(correlations_with_others))
        other_correlation = correlations[j, other_joint]
        slope = float(slopes[j])
        if other_correlation > _MIN_CORRELATION and own_correlation < _MAX_RATIO_TO_OTHER * other_correlation:
            correlation_text = number(float(other_correlation), 3)
            yield doubt("servo-exchanged", [names[j]], other=names[other_joint], share=correlation_text)
        elif own_correlation < -_MIN_CORRELATION:
            yield doubt("servo-sign", [names[j]])
        elif own_correlation > _MIN_CORRELATION and not _MIN_SLOPE < slope < _MAX_SLOPE:
            yield doubt("servo-unit", [names[j]], ratio=number(slope, 3), found={"value": slope})


def _correlations_and_slopes(logs: Sequence[ServoLog]) -> tuple[Array, Array]:
    """Correlations of positions with commands, and slopes of positions by their own commands.

    Returns
    -------
    correlations : (nv, nv) array, of each joint's positions with each joint's commands, at the delay at which it is largest
    slopes : (nv,) array, with the commands at the last delay
    """
    q = np.concatenate([_without_mean(log.q) for log in logs])
    q_norms = np.linalg.norm(q, axis=0)
    c_norms = np.zeros(q.shape[1])  # of the commands at the delay that was tried last
    correlations_by_delay = list[Array]()
    for delay in _DELAYS:
        delayed_commands = [log.mean_command(log.time - delay, log.period, "zero") for log in logs]
        c = np.concatenate([_without_mean(commands) for commands in delayed_commands])
        c_norms = np.linalg.norm(c, axis=0)
        correlations_by_delay.append(q.T @ c / np.maximum(q_norms[:, None] * c_norms, _MIN_NORM))
    stacked = np.stack(correlations_by_delay)
    best_delay = np.abs(stacked).argmax(axis=0)  # index, of each pair of joints
    (correlations,) = np.take_along_axis(stacked, best_delay[None], axis=0)
    ratio = q_norms / np.maximum(c_norms, _MIN_NORM)
    return correlations, np.diagonal(correlations) * ratio


def _without_mean(x: Array) -> Array:
    """Deviations (n, k) of the columns from their means."""
    return np.asarray(x - x.mean(axis=0))


def fit_doubts(servos: IdentifiedServos, logs: Sequence[ServoLog]) -> Iterator[Doubt]:
    """Doubts about a fit: motions that determine too little, and errors that the servos do not explain."""
    names = np.array(servos.joints)
    moves = servos.live
    if not moves.all():
        yield doubt("servo-still", names[~moves].tolist())
    total_seconds = 0.0
    row_count = 0
    for log in logs:
        total_seconds += float(log.time[-1])
        row_count += len(log.time)
    if total_seconds < _MIN_SECONDS or row_count < _MIN_ROWS_OF_UNKNOWN * len(QUANTITIES):
        yield doubt("servo-short", seconds=number(total_seconds, 3), rows=row_count)
    yield from _error_doubts(servos)
    if not servos.whole.any() and not servos.known:
        yield doubt("servo-no-scale")
    has_wide_interval = moves & ~servos.whole & ~servos.only_ratios
    if has_wide_interval.any():
        widths = [_widest_value_text(servos, j) for j in np.flatnonzero(has_wide_interval).tolist()]
        yield doubt("servo-wide", names[has_wide_interval].tolist(), widths=listed(widths, _MAX_LISTED))


def _error_doubts(servos: IdentifiedServos) -> Iterator[Doubt]:
    """Doubt about a held-out error that is a large share of the tracking error, or larger than the error of used rows."""
    error_shares = np.array(list(servos.held_out.joints.values()))
    errors = np.array(list(servos.position_error.values()))  # [rad, m]
    is_large = servos.live & (error_shares > _UNSURE_ERROR) & (errors > _MAX_SMALL_ERROR * servos.fit.sigma)
    held_out_share = servos.held_out.all
    used_share = servos.trained.all
    if is_large.any():
        worst_joint = int(np.argmax(np.where(is_large, error_shares, 0.0)))
        share = float(error_shares[worst_joint])
        level: Level = "refuse" if share > _LOOK_AGAIN_ERROR else "unsure"
        joints = [servos.joints[worst_joint]]
        yield doubt("servo-unexplained", joints, share=percent(share, 2), level=level, found={"value": share})
    elif held_out_share > _MAX_GROWTH * used_share and held_out_share > _MIN_DRIFT_ERROR:
        share_text = percent(held_out_share, 2)
        yield doubt("servo-drifts", share=share_text, used=percent(used_share, 2), found={"value": held_out_share})


def _widest_value_text(servos: IdentifiedServos, j: int) -> str:
    """Text of the undetermined value of a joint with the widest interval, and its half width; of all values if none is."""
    half_widths = {name: float(widths[j]) for name, widths in servos.relative().items()}
    undetermined = [name for name in QUANTITIES if not servos.determined[name][j]] or list(QUANTITIES)
    widest = max(undetermined, key=lambda name: half_widths[name])
    return f"{widest} of {servos.joints[j]} {relative_width(half_widths[widest])}"
