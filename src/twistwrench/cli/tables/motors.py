"""The motors' part of the torque report: a table, and the answer to "which motor is too small?"."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from ...model.limits import TOLERANCE
from ...report.motors import Demand, MotorUse

_SHORT = {"peak current": "peak", "rms current": "rms"}


def motors_table(motors: Sequence[MotorUse]) -> Table:
    """A row per motor; limits stand behind the values, what passes one is red."""
    table = Table(box=SIMPLE_HEAD, title="Motors", title_justify="left", title_style="bold", pad_edge=False)
    table.add_column("joint", overflow="fold")
    heads = [f"{_SHORT.get(d.what, d.what)} \\[{d.unit}]" for d in motors[0].demands]
    for head in (*heads, "power \\[W]", "heat \\[W]", "used"):
        table.add_column(head, justify="right", no_wrap=True)
    for use in motors:
        share = use.tightest.share
        style = "red" if use.too_small else "yellow" if share > 0.8 else "green"
        used = Text(f"{100 * share:.0f} %" if share else "–", style=style)
        table.add_row(Text(use.joint), *map(_cell, use.demands), _figure(use.power), _figure(use.heat), used)
    return table


def _cell(demand: Demand) -> Text:
    limit = f" / {demand.limit:.3g}" if math.isfinite(demand.limit) else ""
    return Text.assemble((_figure(demand.value), "red" if demand.share > 1 + TOLERANCE else ""), (limit, "dim"))


def _figure(value: float) -> str:
    """Three digits; 0 for what is only rounding in these units."""
    return f"{value:.3g}" if abs(value) >= 1e-6 else "0"


def motors_verdict(motors: Sequence[MotorUse]) -> Text:
    """One line: which motors are too small, by what; or which is nearest to its limits."""
    small = sorted((use for use in motors if use.too_small), key=lambda use: -use.tightest.share)
    if small:
        shown = "; ".join(use.words for use in small[:3])
        more = f"; and {len(small) - 3} more" if len(small) > 3 else ""
        return Text.assemble(("MOTOR TOO SMALL", "bold red"), f": {shown}{more}.")
    known = [use for use in motors if any(math.isfinite(d.limit) for d in use.demands)]
    if not known:
        return Text.assemble(("MOTORS", "bold"), ": their limits are not known.")
    return Text.assemble(
        ("MOTORS OK", "bold green"),
        f": nearest to its limits is {max(known, key=lambda use: use.tightest.share).words}.",
    )
