"""Torques as a table of HTML with bars, for the live page."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import percent_of_limit, seconds
from ..motion.coordinates import Coordinates
from ..typing import Array
from .colours import share_colours

if TYPE_CHECKING:
    from ..model.model import Model

TEXT = "font-size:12px;padding:2px 12px 8px;"
"""The style of the page's words."""
_CELL = "padding:1px 4px;white-space:nowrap;font-variant-numeric:tabular-nums"


def torque_table(model: Model, title: str, torques: Array, shares: Array, coloured: Array) -> str:
    """A row for each torque: name, bar as long as its share, number, and share of its limit, which is NaN without one."""
    units, rows = Coordinates.of(model).torque_units, []
    for name, unit, tau, x, c in zip(model.velocity_names, units, torques.round(2), shares, coloured, strict=True):
        wide = 50 * min(1.0, abs(float(x)))
        colour = "rgb({} {} {})".format(*(round(255 * float(v)) for v in share_colours(c)))
        bar = (
            "<div style='position:relative;height:9px;width:88px;background:#e8ecf0;border-radius:3px'>"
            f"<div style='position:absolute;top:0;bottom:0;left:{50 - wide if x < 0 else 50:.1f}%;width:{wide:.1f}%;"
            f"background:{colour}'></div></div>"
        )
        share = "" if np.isnan(c) else percent_of_limit(abs(c))
        cells = (html.escape(name.removesuffix("_joint")), bar, f"{seconds(tau + 0.0, 2)} {unit}", share)
        rows.append(f"<tr>{''.join(f'<td style={_CELL!r}>{cell}</td>' for cell in cells)}</tr>")
    return f"<div style='{TEXT}'><b>{title}</b><table style='width:100%'>{''.join(rows)}</table></div>"
