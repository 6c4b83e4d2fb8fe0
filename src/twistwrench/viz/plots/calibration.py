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
"""Width of a figure [inches]."""
_HEIGHT_OF_CALIBRATION = 7.0
"""Height of the figure with two rows of plots [inches]."""
_HEIGHT_OF_POSES = 3.6
"""Height of the figure with one row of plots [inches]."""
_ROOM_FOR_LEGEND = 3.0
"""Factor of the upper end of a logarithmic axis."""
_MARK_AREA = 12.0
"""Area of the mark of a tip position [points²]."""


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
    with style.figure(_WIDTH, _HEIGHT_OF_CALIBRATION, title) as drawn:
        axes: Any = drawn.subplots(2, 2)
        (error_axis, prediction_axis), (zero_axis, residual_axis) = axes
        _draw_errors(error_axis, found)
        _draw_predicted_errors(prediction_axis, found)
        _draw_zeros(zero_axis, found)
        _draw_residuals(residual_axis, found)
        style.save(drawn, path)


def _draw_errors(axis: Any, found: CalibratedRobot) -> None:
    """Draw errors as bars, the largest error before the calibration first; crosses are readings that were left out."""
    reading_order = np.argsort(-found.errors_before)
    errors_after = np.concatenate(found.fit.errors)[reading_order]
    reading_weights = np.concatenate([weights[:, -1] for weights in found.fit.weights])  # zero: left out
    is_used = reading_weights[reading_order] > 0
    ranks = np.arange(len(reading_order))
    axis.bar(ranks, _MILLI * found.errors_before[reading_order], color=style.QUIET, label="before")
    axis.bar(ranks, _MILLI * errors_after, color=style.POINTED, label="after")
    if not is_used.all():
        left_out = ~is_used
        axis.plot(
            ranks[left_out], _MILLI * errors_after[left_out], "x", color=style.INK, label="left out", linestyle="none"
        )
    axis.set_yscale("log")
    _, top = axis.get_ylim()
    axis.set_ylim(top=_ROOM_FOR_LEGEND * top)
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
    radius = np.hypot(p[:, 0], p[:, 1])
    points = axis.scatter(radius, p[:, 2], c=errors, s=_MARK_AREA, cmap=quantity_steps())
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
    title = f"{plan.robot_name} · configurations to measure {chain.frame}"
    with style.figure(_WIDTH, _HEIGHT_OF_POSES, title) as drawn:
        axes: Any = drawn.subplots(1, 3)
        error_axis, side_view, top_view = axes
        error_axis.plot(plan.counts, _MILLI * plan.remaining, "o-", color=style.POINTED)
        error_axis.set_yscale("log")
        error_axis.yaxis.set_major_formatter(lambda x, _: number(x))
        error_axis.set_xlabel("readings")
        error_axis.set_ylabel("predicted to remain [mm]")
        style.titles(error_axis, "Error of the tip")
        radius = np.hypot(p[:, 0], p[:, 1])
        side_view.plot(radius, p[:, 2], "o", color=style.POINTED)
        side_view.set_xlabel("distance from the z axis [m]")
        side_view.set_ylabel("z [m]")
        style.titles(side_view, "From the side")
        top_view.plot(p[:, 0], p[:, 1], "o-", color=style.POINTED, linewidth=0.6)
        top_view.set_aspect("equal")
        top_view.set_xlabel("x [m]")
        top_view.set_ylabel("y [m]; lines: order")
        style.titles(top_view, "From above")
        style.save(drawn, path)
