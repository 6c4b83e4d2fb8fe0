"""The operating points of every motor in its speed–torque region. Modern Robotics figure 8.10."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import percent_of_limit
from ..model.limits import margin
from ..report.motors import MotorUse
from ..typing import Array
from .panels import panel_grid, panels
from .style import INK, LINE, OVER, QUIET, SMALL, figure, save
from .torques import report_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..report.torque_findings import TorqueReport

_ABREAST = 3
_SHORT, _LONG = "#f8e3b5", "#c3e3d3"
"""What a motor can do for a while, and for ever; drawn one over the other, so opaque."""


def plot_motors(report: TorqueReport, path: str | Path) -> Path:
    """Plot of the motors' loads, a panel each.

    Parameters
    ----------
    report : TorqueReport
    path : str or Path; the suffix says the kind (.png, .pdf, .svg)

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    MissingExtraError, ValueRangeError
        As :func:`twistwrench.plotting.style.save`.
    """
    motors, title = report.motors, f"{report_title(report)} · motors"
    rows, columns = panel_grid(len(motors), _ABREAST)
    with figure(3.6 * columns + 0.6, 2.7 * rows + 1.0, title, "Drawing the motors (--motor-plot)") as drawn:
        axes = panels(drawn, len(motors), _ABREAST)
        for axis, motor in zip(axes, motors, strict=True):
            _draw(axis, motor)
        handles, labels = axes[0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower left", ncols=4, frameon=False, fontsize=SMALL)
        drawn.supxlabel("speed [rad/s]", fontsize=SMALL)
        drawn.supylabel("torque at the rotor [N m]", fontsize=SMALL)
        return save(drawn, path)


def _draw(axis: Axes, use: MotorUse) -> None:
    motor, speed, torque = use.motor, use.speed, use.torque
    top = _top_speed(use)
    w = np.linspace(-top, top, 401)
    bounds = [motor.torque_constant * x for x in (motor.current_continuous, motor.current_peak) if math.isfinite(x)]
    reach = 1.1 * max([*bounds, float(np.abs(torque).max(initial=0.0))]) or 1.0
    for current, colour, name in (
        (motor.current_peak, _SHORT, "for a while"),
        (motor.current_continuous, _LONG, "for ever"),
    ):
        high = np.clip(motor.greatest_torque(w, current), -reach, reach)
        low = -np.clip(motor.greatest_torque(-w, current), -reach, reach)
        axis.fill_between(w, low, high, where=(high > low).tolist(), color=colour, linewidth=0, label=name)
    within = _within(use)
    axis.plot(speed, torque, color=LINE, linewidth=0.7, alpha=0.8, label="this motion")
    if not within.all():
        axis.plot(speed[~within], torque[~within], ".", color=OVER, markersize=3, label="beyond the motor")
    rms = math.sqrt(float(np.mean(torque**2)))
    for side in (rms, -rms):
        label = "rms torque, either way" if side is rms else None
        axis.axhline(side, color=INK, linewidth=0.8, linestyle=(0, (4, 3)), label=label)
    axis.axhline(0, color=QUIET, linewidth=0.6)
    axis.axvline(0, color=QUIET, linewidth=0.6)
    axis.set_xlim(-top, top)
    axis.set_ylim(-reach, reach)
    axis.locator_params(axis="x", nbins=5)
    axis.set_title(use.joint, loc="left", fontweight="bold")
    d = use.tightest
    used = f"{d.what} {percent_of_limit(d.share)}" if d.share else ""
    axis.set_title(used, loc="right", fontsize=SMALL, color=OVER if use.too_small else QUIET)


def _top_speed(use: MotorUse) -> float:
    edge = min(use.motor.voltage / use.motor.torque_constant, use.motor.speed)
    seen = float(np.abs(use.speed).max(initial=0.0))
    return 1.05 * max(seen, edge if math.isfinite(edge) else 1.5 * seen) or 1.0


def _within(use: MotorUse) -> Array:
    motor, w, torque = use.motor, use.speed, use.torque
    most, least = motor.greatest_torque(w), motor.greatest_torque(-w)
    return np.asarray((torque <= most + margin(most)) & (-torque <= least + margin(least)))
