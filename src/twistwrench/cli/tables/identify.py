"""What ``twistwrench identify`` prints: the verdict, residuals of rows held out, and the groups of parameters."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from ...core.printed_numbers import estimate, number, percent, plus_minus
from ...identification import IdentifiedRobot
from ...joints.units import heading_unit
from ...listing import listed
from ...motion.coordinates import Coordinates
from .plain_table import PlainTable, verdict_word

_KINDS = {"test": "in the logs of --test", "five-fold": "in fifths of the time, each predicted from the others"}
_VAGUE = 5


def identification_view(found: IdentifiedRobot, *, essential: bool = False) -> RenderableType:
    """The verdict first, then what it rests on; the essential groups where they are asked for."""
    return Group(*_parts(found), *(_essential(found) if essential else ()))


def _parts(found: IdentifiedRobot) -> Iterator[RenderableType]:
    verdict = found.verdict
    yield Text.assemble(
        verdict_word(verdict.word),
        f"  {found.original.name}: {percent(found.held_out.all, 3)} of the torques left {_KINDS[found.held_out.kind]}",
    )
    for doubt in found.doubts:
        yield Text(f"• {doubt.sentence}", "" if not doubt.refuses else "red")
    for note in found.notes:
        yield Text(note)
    yield Text(
        f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    )
    yield _residuals(found)
    yield from _payload(found)
    yield _groups(found)
    if found.base.held.any():
        yield Text(f"{int(found.base.held.sum())} parameters were held at known values")
    if vague := found.vague:
        names = listed((name.split(" ")[0] for name in vague), _VAGUE, "; ")
        yield Text(f"vague, deviation beyond 30 %: {names}")


def _payload(found: IdentifiedRobot) -> Iterator[Text]:
    payload = found.payload
    if payload is None:
        return
    com = ", ".join(plus_minus(x, d) for x, d in zip(payload.com, payload.com_deviations, strict=True))
    yield Text(
        f"payload at {payload.frame}: {plus_minus(payload.mass, payload.mass_deviation)} kg, centre of mass "
        f"({com}) m in its frame"
    )
    if payload.untold:
        yield Text(f"no torque of this robot tells {', '.join(payload.untold)}: taken as the file has it")


def _essential(found: IdentifiedRobot) -> Iterator[Text]:
    one = found.essential
    names = "; ".join(
        f"{name.split(' ')[0]} {number(value)}" for name, value in zip(one.names, one.values, strict=True)
    )
    yield Text(
        f"{len(one.names)} essential groups of {int((~found.base.held).sum())} predict rows held out to "
        f"{percent(one.held_out, 3)}, all to {percent(one.curve[0][1], 3)} (in units of each joint's residuals): {names}"
    )


def _residuals(found: IdentifiedRobot) -> PlainTable:
    table = PlainTable("Residuals of rows held out")
    table.words("joint")
    table.numbers("held out", f"size [{heading_unit('tau', Coordinates.of(found.original.model).angular_velocity)}]")
    for (name, share), sigma in zip(found.held_out.joints.items(), found.sigma, strict=True):
        table.row(name, percent(share, 3), sigma)
    return table


def _groups(found: IdentifiedRobot) -> PlainTable:
    table = PlainTable(f"{int((~found.base.held).sum())} groups of parameters")
    table.words("group")
    table.numbers("value", "deviation", "95 % from", "to", "file")
    rows = zip(found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True)
    for held, (name, value, deviation, (low, high), before) in zip(found.base.held, rows, strict=True):
        if held:
            continue
        table.row(name, *estimate(value, deviation), low, high, before)
    return table
