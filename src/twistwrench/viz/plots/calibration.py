"""Plots of a calibration and of planned readings: errors before and after, what remains over the reach, zeros."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...calibration.poses import MeasuringPoses
from ...calibration.result import CalibratedRobot
from ...core.numbers import number
from .. import style
from ..colours import quantity_steps

_MILLI = 1e3
"""Millimetres in a metre, milliradians in a radian."""
_WIDTH = 10.5
"""Width of a figure [inches], as all sizes of figures."""


def plot_calibration(found: CalibratedRobot, path: str | Path) -> None:
    """Plot errors before and after by reading, the error that remains over the reach, and zeros with intervals.

    Parameters
    ----------
    found : CalibratedRobot
    path : str or Path, file to write

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     tw.calibration.calibrate("ur5", "demo").plot(f"{folder}/calibration.svg").name
    'calibration.svg'
    """
    title = f"{found.robot_name} · calibration of {found.fit.problem.chain.frame}"
    with style.figure(_WIDTH, 7.0, title) as drawn:
        axes: Any = drawn.subplots(2, 2)
        _draw_errors(axes[0, 0], found)
        _draw_predicted_errors(axes[0, 1], found)
        _draw_zeros(axes[1, 0], found)
        _draw_residuals(axes[1, 1], found)
        style.save(drawn, path)


def _draw_errors(axis: Any, found: CalibratedRobot) -> None:
    """Draw errors as bars, the largest error before the calibration first; crosses are readings that were left out."""
    order = np.argsort(-found.errors_before)
    errors_after = np.concatenate(found.fit.errors)[order]
    reading_weights = np.concatenate([weights[:, -1] for weights in found.fit.weights])  # zero: left out
    is_used = reading_weights[order] > 0
    ranks = np.arange(len(order))
    axis.bar(ranks, _MILLI * found.errors_before[order], color=style.QUIET, label="before")
    axis.bar(ranks, _MILLI * errors_after, color=style.POINTED, label="after")
    if not is_used.all():
        left_out = ~is_used
        axis.plot(
            ranks[left_out], _MILLI * errors_after[left_out], "x", color=style.INK, label="left out", linestyle="none"
        )
    axis.set_yscale("log")
    _, top = axis.get_ylim()
    axis.set_ylim(top=3.0 * top)  # room for the legend
    axis.yaxis.set_major_formatter(lambda x, _: number(x))
    axis.set_xlabel("reading, sorted")
    axis.set_ylabel("error [mm]")
    axis.legend()
    style.titles(axis, "Errors of readings")


def _draw_predicted_errors(axis: Any, found: CalibratedRobot) -> None:
    """Draw the predicted error of the calibrated robot at places of the tip, seen from the side."""
    T = found.fit.problem.chain.tips(found.reference, found.fit.state.corrections)
    p = T[:, :3, 3]
    errors = _MILLI * found.remaining_at(found.reference)
    points = axis.scatter(np.hypot(p[:, 0], p[:, 1]), p[:, 2], c=errors, s=12, cmap=quantity_steps())
    axis.figure.colorbar(points, ax=axis, label="predicted to remain [mm]")
    axis.set_xlabel("distance from the z axis [m]")
    axis.set_ylabel("z [m]")
    style.titles(axis, "What remains")


def _draw_zeros(axis: Any, found: CalibratedRobot) -> None:
    """Draw zeros in degrees or mm, with their intervals."""
    chain = found.fit.problem.chain
    for height, (joint, interval) in enumerate(found.zeros.items()):
        zero, half_width = interval
        is_turning = chain.turning[chain.joints.index(joint)]
        factor = math.degrees(1.0) if is_turning else _MILLI
        axis.errorbar(factor * zero, height, xerr=factor * half_width, fmt="o", color=style.POINTED)
    axis.set_yticks(range(len(found.zeros)), list(found.zeros))
    axis.invert_yaxis()  # from the base down
    axis.axvline(0.0, color=style.QUIET, linewidth=0.8)
    axis.set_xlabel("zero [°, mm of sliding joints], 95 %")
    style.titles(axis, "Zeros")


def _draw_residuals(axis: Any, found: CalibratedRobot) -> None:
    """Draw residuals × 1000 as arrows at the tip, seen from above; without directions, a histogram of their sizes."""
    residuals = found.residuals[0]
    measured = found.fit.problem.measured[0]
    length_rows = measured.rows_each - measured.angle_rows
    if length_rows < 3:  # not x, y and z of the tip
        axis.hist(_MILLI * residuals[:, -1], color=style.POINTED)
        axis.set_xlabel("residual [mm]")
        style.titles(axis, "Residuals")
        return
    arrows = _MILLI * (residuals[:, measured.angle_rows :] @ found.target_pose[:3, :3])  # in the base frame
    T = found.fit.problem.chain.tips(measured.q, found.fit.state.corrections)
    p = T[:, :3, 3]
    axis.quiver(p[:, 0], p[:, 1], arrows[:, 0], arrows[:, 1], angles="xy", scale_units="xy", scale=1.0, width=3e-3)
    axis.set_aspect("equal")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]; arrows: residuals × 1000")
    style.titles(axis, "Residuals from above")


def plot_measuring_poses(plan: MeasuringPoses, path: str | Path) -> None:
    """Plot the predicted error by the number of readings, and the tip's places, from the side and from above.

    Parameters
    ----------
    plan : MeasuringPoses
    path : str or Path, file to write

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     tw.calibration.measuring_poses("ur5", 12).plot(f"{folder}/poses.svg").name
    'poses.svg'
    """
    chain = plan.fit.problem.chain
    T = chain.tips(plan.q, plan.fit.state.corrections)
    p = T[:, :3, 3]
    with style.figure(_WIDTH, 3.6, f"{plan.robot_name} · configurations to measure {chain.frame}") as drawn:
        axes: Any = drawn.subplots(1, 3)
        error, side, top = axes
        error.plot(plan.counts, _MILLI * plan.remaining, "o-", color=style.POINTED)
        error.set_yscale("log")
        error.yaxis.set_major_formatter(lambda x, _: number(x))
        error.set_xlabel("readings")
        error.set_ylabel("predicted to remain [mm]")
        style.titles(error, "Error of the tip")
        side.plot(np.hypot(p[:, 0], p[:, 1]), p[:, 2], "o", color=style.POINTED)
        side.set_xlabel("distance from the z axis [m]")
        side.set_ylabel("z [m]")
        style.titles(side, "From the side")
        top.plot(p[:, 0], p[:, 1], "o-", color=style.POINTED, linewidth=0.6)
        top.set_aspect("equal")
        top.set_xlabel("x [m]")
        top.set_ylabel("y [m]; lines: order")
        style.titles(top, "From above")
        style.save(drawn, path)
