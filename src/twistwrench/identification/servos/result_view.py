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
"""Factor of seconds for milliseconds."""
_MAX_SHOWN_WIDTH = math.log(10.0)
"""Half width of a logarithm from which a value is unknown: a factor of ten."""
_SHOWN_QUANTITIES = ("kp", "damping", "coulomb", "armature")
_MAX_ROWS = 12
"""Largest number of rows in the short form of the table."""


def servo_view(found: IdentifiedServos) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield _headline(found)
    yield ""
    subject = f"  ·  servos, from commands and positions  ·  delay {_delay_text(found)}"
    yield Line((found.robot_name, Style.STRONG), subject)
    yield _value_table(found)
    held_out_error = percent(found.held_out.all, 3)
    yield Line(
        f"Replayed positions are off by {held_out_error} of the tracking error in rows that were not used, "
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


def _delay_text(found: IdentifiedServos) -> str:
    half_width = quantity(_MILLI * found.delay_half_width, "ms", 2, decimals=2)
    return f"{number(_MILLI * found.delay, 3, decimals=1)} ± {half_width}"


def _headline(found: IdentifiedServos) -> Headline:
    """Word of the verdict and its reasons; for OK, the accuracy and the joints of which only ratios are known."""
    if found.verdict.word is not Word.OK:
        return Headline.from_verdict(found.verdict)
    count = int(found.whole.sum())
    text = f"kp, damping, armature and friction of {count} of {len(found.joints)} joints"
    if count:
        text += f", {_accuracy(found)}"
    text += f", delay {quantity(_MILLI * found.delay, 'ms', 2, decimals=1)}"
    joints_with_ratios = [found.joints[j] for j in np.flatnonzero(found.only_ratios)]
    if joints_with_ratios:
        text += f"; {listed(joints_with_ratios, 4)}: only ratios are known (hold one of the values with known=)"
    return Headline(Word.OK, f"{text}.")


def _accuracy(found: IdentifiedServos) -> str:
    """Widest intervals of the determined joints.

    Damping and friction may be hardly determined because they are small. Then their share of the joint's torque is given.
    """
    widths = found.relative()
    widest = {name: float(widths[name][found.whole].max(initial=0.0)) for name in QUANTITIES}
    texts = [f"kp and armature {relative_width(max(widest['kp'], widest['armature']))}"]
    for name, noun in (("damping", "damping"), ("coulomb", "friction")):
        if widest[name] <= MAX_WIDTH_DETERMINED:
            texts.append(f"{noun} {relative_width(widest[name])}")
        else:
            share = float(found.torque_shares[name][found.whole].max())
            texts.append(f"{noun} ± {percent(share, 2)} of the joint's torque")
    return ", ".join(texts)


def _value_table(found: IdentifiedServos) -> Table:
    """Row for each joint: values with relative half widths; undetermined values in parentheses."""
    columns = [words("joint", list(found.joints), fold=False)]
    widths = found.relative()
    turning = [any(body.joint.turning) for body in found.original.model.leaders]
    for name in _SHOWN_QUANTITIES:
        values = found.values[:, QUANTITIES.index(name)]
        units = [servo_unit(name, turning=turns).replace("^2", "²") for turns in turning]
        columns.append(words(name, _cells(values, widths[name], found.determined[name], units), fold=False))
    ratios_or_nothing = np.where(found.only_ratios, "ratios", "–")
    known = np.where(found.whole, "all", ratios_or_nothing).tolist()
    return Table("Servos", *columns, words("known", known, fold=False), most=_MAX_ROWS)


def relative_width(width: float) -> str:
    """Half width of a logarithm as a share of the value; ``unknown`` from a factor of ten."""
    if width < _MAX_SHOWN_WIDTH:
        return f"± {percent(math.expm1(width), 2)}"
    return "unknown"


def _cells(values: Array, widths: Array, determined: Array, units: Sequence[str]) -> list[str]:
    """``820 N m/rad ± 0.3 %``; an undetermined value in parentheses."""
    cells = []
    for value, width, is_determined, unit in zip(values, widths.tolist(), determined, units, strict=True):
        text = f"{quantity(value, unit, 3)} {relative_width(width)}"
        cells.append(text if is_determined else f"({text})")
    return cells
