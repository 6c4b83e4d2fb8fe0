"""What ``twistwrench identify`` prints: the verdict, residuals of rows held out, and the groups of parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ...identification import IdentifiedRobot
from ...verdict import Word
from .style import title_line

_COLOURS = {Word.OK: "bold green", Word.LOOK_AGAIN: "bold red"}
_KINDS = {"test": "in the logs of --test", "five-fold": "in fifths of the time, each predicted from the others"}
_VAGUE = 5


def identification_view(found: IdentifiedRobot, *, essential: bool = False) -> RenderableType:
    """The verdict first, then what it rests on; the essential groups where they are asked for."""
    return Group(*_parts(found), *(_essential(found) if essential else ()))


def _parts(found: IdentifiedRobot) -> Iterator[RenderableType]:
    verdict = found.verdict
    yield Text.assemble(
        (str(verdict.word), _COLOURS.get(verdict.word, "bold yellow")),
        f"  {found.original.name}: {_percent(found.held_out.all)} of the torques left {_KINDS[found.held_out.kind]}",
    )
    for doubt in found.doubts:
        yield Text(f"• {doubt.sentence}", "" if not doubt.refuses else "red")
    settings = found.settings
    speeds = ", ".join(f"{v:g}" for v in settings.friction_speed)
    yield Text(
        f"cut-off {settings.cutoff:g} Hz; torques {settings.shift * 1e3:+.3g} ms after positions; friction turns at {speeds} "
        f"rad/s or m/s; weights {found.method}; deviations from blocks of {found.covariance.block:.3g} s"
    )
    yield _residuals(found)
    yield from _payload(found)
    yield _groups(found)
    if found.base.held.any():
        yield Text(f"{int(found.base.held.sum())} parameters were held at known values")
    if vague := found.vague:
        names = "; ".join(name.split(" ")[0] for name in vague[:_VAGUE])
        more = f", and {len(vague) - _VAGUE} more" if len(vague) > _VAGUE else ""
        yield Text(f"vague, deviation beyond 30 %: {names}{more}")


def _payload(found: IdentifiedRobot) -> Iterator[Text]:
    payload = found.payload
    if payload is None:
        return
    com = ", ".join(f"{x:.4g} ± {d:.2g}" for x, d in zip(payload.com, payload.com_deviations, strict=True))
    yield Text(
        f"payload at {payload.frame}: {payload.mass:.4g} ± {payload.mass_deviation:.2g} kg, centre of mass "
        f"({com}) m in its frame"
    )
    if payload.untold:
        yield Text(f"no torque of this robot tells {', '.join(payload.untold)}: taken as the file has it")


def _essential(found: IdentifiedRobot) -> Iterator[Text]:
    one = found.essential
    names = "; ".join(f"{name.split(' ')[0]} {value:.4g}" for name, value in zip(one.names, one.values, strict=True))
    yield Text(
        f"{len(one.names)} essential groups of {int((~found.base.held).sum())} predict rows held out to "
        f"{_percent(one.held_out)}, all to {_percent(one.curve[0][1])} (in units of each joint's residuals): {names}"
    )


def _residuals(found: IdentifiedRobot) -> Table:
    table = Table(box=SIMPLE_HEAD, title=title_line("Residuals of rows held out"), title_justify="left", pad_edge=False)
    table.add_column("joint")
    for name in ("held out", "size [N m, N]"):
        table.add_column(name, justify="right", no_wrap=True)
    for (name, share), sigma in zip(found.held_out.joints.items(), found.sigma, strict=True):
        table.add_row(Text(name), _percent(share), f"{sigma:.3g}")
    return table


def _groups(found: IdentifiedRobot) -> Table:
    table = Table(
        box=SIMPLE_HEAD,
        title=title_line(f"{int((~found.base.held).sum())} groups of parameters"),
        title_justify="left",
        pad_edge=False,
    )
    table.add_column("group", overflow="fold")
    for name in ("value", "deviation", "95 % from", "to", "file"):
        table.add_column(name, justify="right", no_wrap=True)
    rows = zip(found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True)
    for held, (name, value, deviation, (low, high), before) in zip(found.base.held, rows, strict=True):
        if held:
            continue
        table.add_row(Text(name), *(f"{x:.4g}" for x in (value, deviation, low, high, before)))
    return table


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %" if math.isfinite(share) else "–"
