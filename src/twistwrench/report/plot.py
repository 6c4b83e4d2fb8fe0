"""The torque report as a picture: every joint's torque within its limits, and what the worst joint's is made of."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError
from .derivatives import States
from .load import TERMS
from .table_file import replacing
from .tables import cause_label
from .torques import TorqueReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

__all__ = ["plot_report"]

_LINE, _OVER, _QUIET = "#1f4e79", "#c0392b", "#8a8f98"
_COLOURS = {  # Okabe and Ito's, told apart by colour-blind readers too
    "inertia": "#0072B2",
    "coriolis": "#56B4E9",
    "gravity": "#E69F00",
    "payload": "#D55E00",
    "friction": "#999999",
    "wrench": "#CC79A7",
}
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555b63",
    "axes.grid": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "figure.dpi": 150,
}
_SHOWN_FROM = 0.3  # limits are drawn to scale from this share on; below, they would flatten the curve


def plot_report(report: TorqueReport, path: str | Path) -> None:
    """Draw the report to ``path``; its suffix says the format (.png, .pdf, .svg).

    Raises :class:`~twistwrench.MissingExtraError` without matplotlib.
    """
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError.of("matplotlib", "plot", "Drawing the report (--plot)") from None
    count = len(report.joints)
    columns = 1 if count == 1 else 2 if count <= 4 else 3
    rows = max(1, math.ceil(count / columns))
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(3.7 * max(columns, 2), 1.9 * rows + 3.6), layout="constrained")
        FigureCanvasAgg(figure)
        figure.get_layout_engine().set(h_pad=0.08, w_pad=0.08)  # type: ignore[union-attr, call-arg]
        upper, lower = figure.subfigures(2, 1, height_ratios=[1.9 * rows, 3.1])
        figure.suptitle(_title(report), fontsize=12, fontweight="bold", x=0.01, ha="left")
        axes = upper.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for k, axis in enumerate(axes):
            if k < count:
                _draw_joint(axis, report, k)
                if k + columns >= count:
                    axis.tick_params(labelbottom=True)
            else:
                axis.set_visible(False)
        if report.worst is not None:
            _draw_split(lower.subplots(), report, report.worst)
        with replacing(path) as scratch:
            _save(figure, scratch, Path(path))


def _save(figure: Any, scratch: Path, path: Path) -> None:
    from ..errors import ValueRangeError

    kind = path.suffix.lstrip(".").lower() or "png"
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise ValueRangeError(f"cannot draw {path.name!r}: pictures of kind {kind!r} are not made. Choose .png, .pdf or .svg.")
    figure.savefig(scratch, format=kind)


def _title(report: TorqueReport) -> str:
    carried = " + ".join(f"{p.mass:g} kg" for p in report.load.payloads)
    return f"{report.robot}, {Path(report.trajectory).stem}" + (f", payload {carried}" if carried else "")


def _draw_joint(axis: Axes, report: TorqueReport, k: int) -> None:
    joint = report.joints[k]
    time, least, greatest = report.envelope
    over = joint.share > 1
    axis.axhline(0, color=_QUIET, linewidth=0.6)
    axis.fill_between(time, least[:, k], greatest[:, k], color=_LINE, alpha=0.35, linewidth=0)
    axis.plot(time, 0.5 * (least[:, k] + greatest[:, k]), color=_LINE, linewidth=1.2)
    top = max(abs(joint.peak), 1e-9) * 1.25
    if joint.share >= _SHOWN_FROM:
        top = max(joint.limit * 1.15, top)
        for side in (1, -1):
            axis.axhspan(side * joint.limit, side * 2 * top, color=_OVER, alpha=0.09, linewidth=0)
            axis.axhline(side * joint.limit, color=_OVER, linewidth=0.9, linestyle=(0, (4, 3)))
    low, high = float(least[:, k].min()), float(greatest[:, k].max())
    axis.set_ylim(-top if low < -0.1 * top or over else -0.3 * top, top if high > 0.1 * top or over else 0.3 * top)
    axis.plot(joint.time, joint.peak, "o", color=_OVER if over else _LINE, markersize=4.5, markeredgecolor="white", zorder=5)
    right = joint.time > 0.6 * report.end + 0.4 * report.begin
    axis.annotate(
        f"{joint.peak:.3g}",
        (joint.time, joint.peak),
        xytext=(-5 if right else 5, 5 if joint.peak >= 0 else -5),
        textcoords="offset points",
        ha="right" if right else "left",
        va="bottom" if joint.peak >= 0 else "top",
        color=_OVER if over else _LINE,
        fontsize=8,
    )
    axis.set_title(joint.joint, loc="left", fontweight="bold")
    limit = f"{100 * joint.share:.0f} % of {joint.limit:.4g} {joint.unit}" if math.isfinite(joint.limit) else joint.unit
    axis.set_title(limit, loc="right", color=_OVER if over else _QUIET, fontsize=8)
    axis.margins(x=0)


def _draw_split(axis: Axes, report: TorqueReport, k: int) -> None:
    joint = report.joints[k]
    states = _with_peak(report.states, report, joint.time)
    terms = {name: values[:, k] for name, values in report.load.terms(states).items()}
    above, below = np.zeros(len(states)), np.zeros(len(states))
    for name in TERMS:
        if not terms[name].any():
            continue
        up, down = np.maximum(terms[name], 0.0), np.minimum(terms[name], 0.0)
        axis.fill_between(states.time, above, above + up, color=_COLOURS[name], alpha=0.8, linewidth=0, label=cause_label(name))
        axis.fill_between(states.time, below, below + down, color=_COLOURS[name], alpha=0.8, linewidth=0)
        above, below = above + up, below + down
    total = np.asarray(sum(terms.values()))
    axis.plot(states.time, total, color="black", linewidth=1.3, label="total")
    axis.axhline(0, color="#555b63", linewidth=0.7)
    axis.axvline(joint.time, color=_QUIET, linewidth=0.8, linestyle=":")
    if joint.share >= _SHOWN_FROM:
        for side in (1, -1):
            axis.axhline(side * joint.limit, color=_OVER, linewidth=0.9, linestyle=(0, (4, 3)))
    axis.set_title(f"{joint.joint}: what its torque is made of", loc="left", fontweight="bold")
    axis.set_title(f"peak {joint.peak:.4g} {joint.unit} at {joint.time:.3f} s", loc="right", color=_QUIET, fontsize=8)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("force [N]" if joint.unit == "N" else "torque [N m]")
    axis.margins(x=0)
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def _with_peak(states: States, report: TorqueReport, time: float) -> States:
    """Only what lies on the time axis; the peak is marked there by its time."""
    inside = (states.time >= report.begin) & (states.time <= report.end) & np.isfinite(time)
    return states.at(inside)
