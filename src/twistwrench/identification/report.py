"""Report of an identification, in blocks: its figures, groups of parameters and bodies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from ..answers.blocks import Block, Headline, Line, Table, numbers, words
from ..core.colours import Style
from ..core.numbers import estimate, number, percent, plus_minus
from ..core.text import listed
from ..mechanics.joints.units import heading_unit
from ..motion.coordinates import Coordinates

if TYPE_CHECKING:
    from .result import IdentifiedRobot

_KINDS = {"test": "in the logs of --test", "five-fold": "in 5-fold cross-validation over time"}
_MOST_NAMES = 5


def identification_view(found: IdentifiedRobot, *, essential: bool = False) -> Iterator[Block]:
    """Verdict and its basis; with essential groups if ``essential``."""
    joints = [f"{name} {percent(share, 3)}" for name, share in found.held_out.joints.items() if math.isfinite(share)]
    left = f"{percent(found.held_out.all, 3)} of the torques unexplained {_KINDS[found.held_out.kind]}"
    poor = f"{len(found.poorly_determined)} of {int((~found.base.held).sum())} parameter groups poorly determined."
    yield Headline(found.verdict.word, f"{left} ({listed(joints, _MOST_NAMES)}). {poor}")
    yield from (Line((f"• {doubt.sentence}", Style.OVER if doubt.refuses else "")) for doubt in found.doubts)
    yield from found.notes
    yield f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    yield Table(
        "Unexplained share of the torques, in rows held out",
        words("joint", found.held_out.joints),
        numbers("held out", found.held_out.joints.values(), lambda share: percent(share, 3)),
        numbers(
            "size", found.sigma, unit=heading_unit("tau", Coordinates.from_model(found.original.model).angular_velocity)
        ),
    )
    if (payload := found.payload) is not None:
        com = ", ".join(plus_minus(x, d) for x, d in zip(payload.com, payload.com_deviations, strict=True))
        mass = plus_minus(payload.mass, payload.mass_deviation)
        yield f"payload at {payload.frame}: {mass} kg, centre of mass ({com}) m in its frame"
        if payload.unidentifiable:
            yield f"not determined by the torques, taken from the file: {', '.join(payload.unidentifiable)}"
    yield _groups_table(found)
    if any(".mc" in name.split(" ")[0] for name in found.groups):
        yield "mcx, mcy, mcz: mass times the coordinates of the centre of mass. A sum has the unit of its first term."
    if found.base.held.any():
        yield f"{int(found.base.held.sum())} parameters were held at known values"
    if listed_groups := found.poorly_determined:
        names = listed((name.split(" ")[0] for name in listed_groups), _MOST_NAMES, "; ")
        yield f"Poorly determined, standard deviation above 30 %: {names}"
    if essential:
        yield _essential(found)
    if found.undetermined:
        yield "Not determined by this log:"
        yield from (f"• {sentence}" for sentence in found.undetermined.values())


def _groups_table(found: IdentifiedRobot) -> Table:
    free = ~found.base.held
    values, deviations = found.values[free], found.standard_deviations[free]
    pairs = list(map(estimate, values, deviations))
    low, high = found.interval()[free].T
    units = [unit.replace("^2", "²") for unit, kept in zip(found.units, free, strict=True) if kept]
    column = partial(numbers, unit=", ".join(dict.fromkeys(units)), headed=False)
    return Table(
        f"{int(free.sum())} groups of parameters",
        words("group", [name for name, kept in zip(found.groups, free, strict=True) if kept]),
        words("unit", units, fold=False),
        column("value", [Line(text, value=x) for (text, _), x in zip(pairs, values, strict=True)]),
        column("deviation", [Line(text, value=x) for (_, text), x in zip(pairs, deviations, strict=True)]),
        column("95 % from", low),
        column("to", high),
        column("file", found.prior.mean[free]),
    )


def _essential(found: IdentifiedRobot) -> str:
    one = found.essential
    names = "; ".join(
        f"{name.split(' ')[0]} {number(value)}" for name, value in zip(one.names, one.values, strict=True)
    )
    return (
        f"{len(one.names)} essential groups of {int((~found.base.held).sum())} predict rows held out to "
        f"{percent(one.held_out, 3)}, all to {percent(one.curve[0][1], 3)} (in units of each joint's residuals): {names}"
    )


def bodies_view(found: IdentifiedRobot) -> Iterator[Block]:
    """Physically consistent bodies compared with the file's, and their prediction error."""
    consistent, unknown = found.consistent, found.base.unknown
    yield (
        f"Weight of the prior γ = {number(consistent.fit.strength)}: {percent(consistent.held_out, 3)} unexplained in 5-fold "
        f"cross-validation, weighted; by the file's own bodies with friction {percent(consistent.of_file, 3)}."
    )
    pairs = [(unknown.model.bodies[i], consistent.inertias[i]) for i in unknown.bodies]
    yield Table(
        "Physically consistent bodies",
        words("link", [body.link for body, _ in pairs]),
        numbers("mass", [float(G.mass) for _, G in pairs], unit="kg"),
        numbers("in the file", [float(body.inertia.mass) for body, _ in pairs], unit="kg"),
        words("centre of mass [m]", [", ".join(number(x) for x in G.com) for _, G in pairs]),
    )
