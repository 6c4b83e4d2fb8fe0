"""Identified servos as blocks: verdict, values of each joint with intervals, delay and remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...core.answers.blocks import Block, Headline, Line, Table, remarks, words
from ...core.colours import Style
from ...core.numbers import number, percent, quantity
from ...core.text import listed
from ...core.typing import Array
from ...core.verdict import Word
from .output_error import MAX_WIDTH_DETERMINED
from .replay import QUANTITIES, servo_unit

if TYPE_CHECKING:
    from .result import IdentifiedServos

_MILLI = 1e3
_FACTOR = math.log(10.0)
_SHOWN = ("kp", "damping", "coulomb", "armature")
_MAX_ROWS = 12


def servo_view(found: IdentifiedServos) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield _headline(found)
    yield ""
    yield Line((found.robot_name, Style.STRONG), f"  ·  servos, from commands and positions  ·  delay {_delay(found)}")
    yield _values(found)
    held = percent(found.held_out.all, 3)
    yield Line(
        f"Replayed positions are off by {held} of the tracking error in rows that were not used, "
        f"{percent(found.trained.all, 3)} in used rows. Damping: servo and joint together."
    )
    yield from remarks([str(doubt) for doubt in found.doubts if doubt.level == "note"])


def servo_facts(found: IdentifiedServos) -> Mapping[str, str]:
    """Delay, held-out error and number of determined joints."""
    return {
        "delay": quantity(_MILLI * found.delay, "ms", 3, decimals=1),
        "held out": percent(found.held_out.all, 3),
        "joints determined": f"{int(found.whole.sum())} of {len(found.joints)}",
    }


def _delay(found: IdentifiedServos) -> str:
    half = quantity(_MILLI * found.delay_half_width, "ms", 2, decimals=2)
    return f"{number(_MILLI * found.delay, 3, decimals=1)} ± {half}"


def _headline(found: IdentifiedServos) -> Headline:
    """Word and reasons; for OK the accuracy and the joints with ratios only."""
    if found.verdict.word is not Word.OK:
        return Headline.from_verdict(found.verdict)
    count = int(found.whole.sum())
    text = f"kp, damping, armature and friction of {count} of {len(found.joints)} joints"
    if count:
        text += f", {_accuracy(found)}"
    text += f", delay {quantity(_MILLI * found.delay, 'ms', 2, decimals=1)}"
    ratios = [found.joints[j] for j in np.flatnonzero(found.only_ratios)]
    if ratios:
        text += f"; {listed(ratios, 4)}: only ratios are known (hold one of the values with known=)"
    return Headline(Word.OK, f"{text}.")


def _accuracy(found: IdentifiedServos) -> str:
    """Widest intervals; of damping or friction wider than determined values, the share of the joint's torque."""
    width = found.relative()
    widest = {name: float(width[name][found.whole].max(initial=0.0)) for name in QUANTITIES}
    texts = [f"kp and armature {relative_width(max(widest['kp'], widest['armature']))}"]
    for name, noun in (("damping", "damping"), ("coulomb", "friction")):
        if widest[name] <= MAX_WIDTH_DETERMINED:
            texts.append(f"{noun} {relative_width(widest[name])}")
        else:
            share = float(found.torque_shares[name][found.whole].max())
            texts.append(f"{noun} ± {percent(share, 2)} of the joint's torque")
    return ", ".join(texts)


def _values(found: IdentifiedServos) -> Table:
    """Row for each joint: values with relative half widths; ratios to kp in parentheses where no scale is known."""
    columns = [words("joint", list(found.joints), fold=False)]
    width = found.relative()
    turning = [any(body.joint.turning) for body in found.original.model.leaders]
    for name in _SHOWN:
        values = found.values[:, QUANTITIES.index(name)]
        units = [servo_unit(name, turning=turns).replace("^2", "²") for turns in turning]
        columns.append(words(name, _cells(values, width[name], found.determined[name], units), fold=False))
    known = np.where(found.whole, "all", np.where(found.only_ratios, "ratios", "–")).tolist()
    return Table("Servos", *columns, words("known", known, fold=False), most=_MAX_ROWS)


def relative_width(width: float) -> str:
    """Half width of a logarithm as a share of the value; ``unknown`` from a factor of ten."""
    return f"± {percent(math.expm1(width), 2)}" if width < _FACTOR else "unknown"


def _cells(values: Array, width: Array, told: Array, units: Sequence[str]) -> list[str]:
    """``820 N m/rad ± 0.3 %``; an undetermined value in parentheses."""
    cells = []
    for x, w, sure, unit in zip(values, width.tolist(), told, units, strict=True):
        text = f"{quantity(x, unit, 3)} {relative_width(w)}"
        cells.append(text if sure else f"({text})")
    return cells
