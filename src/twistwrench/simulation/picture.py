"""A simulation as a picture: where the joints went, where the energy went, and what of it was lost on the way."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..figure import (
    AXIS,
    BLUE,
    GREEN,
    GREY,
    LINE,
    ORANGE,
    OVER,
    PURPLE,
    QUIET,
    SKY,
    SMALL,
    VERMILION,
    YELLOW,
    figure,
    save,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .result import SimulationResult

__all__ = ["plot_simulation"]

_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, GREY, YELLOW)
_WORKS = {"torques": BLUE, "friction": GREY, "wrenches": PURPLE, "contacts": VERMILION}
_MOST = 14
"""Curves, beyond which names no longer fit."""


def plot_simulation(result: SimulationResult, path: str | Path) -> Path:
    """Draw it; see :meth:`SimulationResult.plot`."""
    end = f"{result.times[-1]:.6g} s" if result.completed else result.stopped
    title = f"{result.robot} · {result.method} · {end if len(end) < 70 else end[:68] + '…'}"
    with figure(9.0, 8.2, title, "Drawing a simulation") as drawn:
        joints, energies, drift = drawn.subplots(3, 1, sharex=True, height_ratios=[3, 2.6, 1.6])
        _draw_joints(joints, result)
        _draw_energies(energies, result)
        _draw_drift(drift, result)
        for axis in (joints, energies, drift):
            for event in result.events[:50]:
                axis.axvline(event.time, color=QUIET, linewidth=0.8, linestyle=":")
            axis.margins(x=0)
        return save(drawn, path)


def _draw_joints(axis: Axes, result: SimulationResult) -> None:
    shown = min(len(result.coordinate_names), _MOST)
    for k in range(shown):
        style = "-" if k < len(_COLOURS) else "--"
        axis.plot(
            result.times, result.q[:, k], style, color=_COLOURS[k % len(_COLOURS)], label=result.coordinate_names[k]
        )
    more = f", the first {shown} of {len(result.coordinate_names)}" if shown < len(result.coordinate_names) else ""
    axis.set_title(f"Coordinates [rad, m]{more}", loc="left")
    _legend(axis)


def _draw_energies(axis: Axes, result: SimulationResult) -> None:
    axis.plot(result.times, result.kinetic_energy, color=BLUE, label="kinetic")
    axis.plot(result.times, result.potential_energy, color=ORANGE, label="potential")
    axis.plot(result.times, result.energy, color=LINE, linewidth=2, label="both")
    for name, work in result.work.items():
        if np.any(work):
            axis.plot(result.times, work, "--", color=_WORKS[name], label=f"work of {name}")
    axis.axhline(0.0, color=AXIS, linewidth=0.8)
    axis.set_title("Energies [J]", loc="left")
    _legend(axis)


def _draw_drift(axis: Axes, result: SimulationResult) -> None:
    axis.plot(result.times, result.drift, color=OVER)
    axis.axhline(0.0, color=AXIS, linewidth=0.8)
    axis.set_title(
        f"Drift [J]: gain of energy that no work accounts for; at most {result.relative_drift:.1e} of the kinetic energy",
        loc="left",
    )
    axis.set_xlabel("time [s]")


def _legend(axis: Axes) -> None:
    cast("Any", axis).legend(
        fontsize=SMALL, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2
    )
