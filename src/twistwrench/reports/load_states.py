"""States of a motion from which every command evaluates loads: smoothed if noise of the log matters.

A log of positions has no accelerations, and its noise becomes torque. The analysis of ``torques`` decides whether the noise
matters. If it does, motors and gears are judged by the smoothed motion, and equally likely motions give the uncertainty of
each load.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.typing import Array
from ..motion.differentiation import Differentiation, MotionSamples
from ..motion.load_case import LoadCase
from ..motion.motion import Motion
from ..motion.motion_log import LogRows, MotionLog
from ..motion.smoothing import spline_rates
from .torque_analysis import analyse
from .torque_report import TorqueReport

if TYPE_CHECKING:
    from ..robot import Robot

DRAWS = 12
"""Number of equally likely motions."""
_ROWS_PER_SLICE = 8192
"""Number of rows that are processed at once."""


class LoadStates(NamedTuple):
    """States for the loads of a motion."""

    motion: Motion
    """Motion in which joints at rest within the noise have the velocity 0."""
    draws: tuple[Motion, ...] = ()
    """Equally likely motions with the noise of the log; empty if noise does not matter."""

    @classmethod
    def from_report(cls, report: TorqueReport) -> LoadStates:
        """States of the analysis of a log."""
        motion = states_of(report)
        if not report.noisy:
            return cls(motion)
        differentiation = report.differentiation
        rng = np.random.default_rng(0)
        parts_of_draws: list[list[MotionSamples]] = [[] for _ in range(DRAWS)]
        # rows beyond the inner ones only smooth these
        for _, log_rows, inner_rows in differentiation.surrounded_states(_ROWS_PER_SLICE):
            for parts, states in zip(parts_of_draws, _draw_states(differentiation, log_rows, rng), strict=True):
                parts.append(states[inner_rows])
        return cls(motion, tuple(_join_states(parts, report.load.robot) for parts in parts_of_draws))

    @classmethod
    def from_motion(cls, robot: Robot, motion: Motion, *, friction: bool = True) -> LoadStates:
        """States of a motion in memory; a motion with derived rates is analysed like a log."""
        if not motion.derived:
            return cls(motion)
        log = MotionLog.from_motion(motion)
        differentiation = Differentiation.plan(log, robot.model)
        report = analyse(LoadCase(robot, friction=friction), differentiation, robot.limits)
        return cls.from_report(report)


def states_of(report: TorqueReport) -> Motion:
    """States of the analysis of a log; velocities of joints at rest within the noise are 0."""
    return _join_states(report.differentiation.states(_ROWS_PER_SLICE), report.load.robot)


def _join_states(parts: Iterable[MotionSamples], robot: Robot) -> Motion:
    """Motion of consecutive states; joints at rest within the noise have no velocity."""
    parts = list(parts)
    time = np.concatenate([states.time for states in parts])
    q = np.concatenate([states.q for states in parts])
    dq = np.concatenate([np.where(states.stationary, 0.0, states.dq) for states in parts])
    ddq = np.concatenate([states.ddq for states in parts])
    return Motion(time, q, dq, ddq, robot=robot, in_seconds=True)


def _draw_states(differentiation: Differentiation, log_rows: LogRows, rng: np.random.Generator) -> list[MotionSamples]:
    """States of random logs of the smoothed motion, each smoothed as the log is."""
    smoothed_curves = differentiation.smooth(log_rows.time, differentiation.curves(log_rows))
    rates, _ = spline_rates(log_rows.time, smoothed_curves)
    drawn_curves: Array = differentiation.errors.drawn(rng, smoothed_curves, rates, DRAWS)  # (n, k, draws)
    quantity = "q" if log_rows.dq is None else "dq"  # of the curves
    drawn_logs = [replace(log_rows, **{quantity: drawn_curves[:, :, draw]}) for draw in range(DRAWS)]
    return [differentiation.complete(log) for log in drawn_logs]
