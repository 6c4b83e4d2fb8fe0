"""What ``twistwrench torques`` prints of many motions: a line for each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ...verdict import Word

if TYPE_CHECKING:
    from ..many_torques import FileTorques

_STYLES: dict[str, str] = {Word.OK: "bold green", Word.UNSURE: "bold yellow"}


def many_view(found: Sequence[FileTorques]) -> RenderableType:
    """Verdict, worst joint and why, of each file."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in ("motion", "verdict", "joint"):
        table.add_column(name, overflow="fold")
    for name in ("peak", "limit", "at"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", overflow="fold")
    for one in found:
        table.add_row(
            Path(one.file).name,
            Text(one.verdict, _STYLES.get(one.verdict, "bold red")),
            one.joint,
            *(_number(x, unit) for x, unit in ((one.peak, one.unit), (one.limit, one.unit), (one.time, "s"))),
            one.reason,
        )
    return table


def _number(x: float, unit: str) -> str:
    return f"{x:.4g} {unit}" if math.isfinite(x) else "-"
