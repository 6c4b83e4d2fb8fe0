"""What ``twistwrench torques`` prints of many motions: a line for each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType

from ...core.printed_numbers import quantity
from .plain_table import PlainTable, verdict_word

if TYPE_CHECKING:
    from ..many_torques import FileTorques


def many_view(found: Sequence[FileTorques]) -> RenderableType:
    """Verdict, worst joint and why, of each file."""
    table = PlainTable()
    table.words("motion", "verdict", "joint")
    table.numbers("peak", "limit", "at")
    table.words("")
    for one in found:
        table.row(
            Path(one.file).name,
            verdict_word(one.verdict),
            one.joint,
            *(quantity(x, unit) for x, unit in ((one.peak, one.unit), (one.limit, one.unit), (one.time, "s"))),
            one.reason,
        )
    return table
