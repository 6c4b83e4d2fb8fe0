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
"""Half width of the interval of log(value) from which the value is unknown: a factor of ten."""
_SHOWN_QUANTITIES = ("kp", "damping", "coulomb", "armature")
"""Columns of the table, out of QUANTITIES."""
_MAX_LISTED_JOINTS = 4
"""Largest number of joints that the verdict names."""
_MAX_ROWS = 12
"""Largest number of rows in the short form of the table."""


def servo_view(found: IdentifiedServos) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    yield _headline(found)
    yield ""
    subject = f"  ·  servos, from commands and positions  ·  delay {_delay_text(found)}"
    yield Line((found.robot_name, Style.STRONG), subject)
    yield _value_table(found)
    # errors of all joints, as shares of the tracking error
    held_out_error = percent(found.held_out.all, 3)
    trained_error = percent(found.trained.all, 3)
    yield Line(
        f"Replayed positions are off by {held_out_error} of the tracking error in rows that were not used, "
        f"{trained_error} in used rows. Damping: servo and joint together."
    )
    notes = [str(doubt) for doubt in found.doubts if doubt.level == "note"]
    yield from remarks(notes)


def servo_facts(found: IdentifiedServos) -> Mapping[str, str]:
    """Delay, held-out error and number of determined joints."""
    return {
        "delay": quantity(_MILLI * found.delay, "ms", 3, decimals=1),
        "held out": percent(found.held_out.all, 3),
        "joints determined": f"{_determined_count(found)} of {len(found.joints)}",
    }


def _determined_count(found: IdentifiedServos) -> int:
    """Number of joints of which all values are determined."""
    return int(found.whole.sum())


def _delay_text(found: IdentifiedServos) -> str:
    """Delay with its half width, such as ``12.3 ± 0.45 ms``."""
    half_width_with_unit = quantity(_MILLI * found.delay_half_width, "ms", 2, decimals=2)
    return f"{number(_MILLI * found.delay, 3, decimals=1)} ± {half_width_with_unit}"


def _headline(found: IdentifiedServos) -> Headline:
    """Verdict and its reasons; for OK, the accuracy, and the joints of which only ratios of values are known."""
    if found.verdict.word is not Word.OK:
        return Headline.from_verdict(found.verdict)
    determined_count = _determined_count(found)
    text = f"kp, damping, armature and friction of {determined_count} of {len(found.joints)} joints"
    if determined_count:
        text += f", {_accuracy(found)}"
    text += f", delay {quantity(_MILLI * found.delay, 'ms', 2, decimals=1)}"
    joints_with_ratios = [found.joints[j] for j in np.flatnonzero(found.only_ratios)]
    if joints_with_ratios:
        joints_text = listed(joints_with_ratios, _MAX_LISTED_JOINTS)
        text += f"; {joints_text}: only ratios are known (hold one of the values with known=)"
    return Headline(Word.OK, f"{text}.")


def _accuracy(found: IdentifiedServos) -> str:
    """Widest intervals among the joints of which all values are determined.

    Damping and friction may be hardly determined because they are small. Then the text gives the width of their interval as a
    share of the joint's torque.
    """
    half_widths = found.relative()  # of the logarithms, by quantity
    widest: dict[str, float] = {}
    for name in QUANTITIES:
        widths_of_determined = half_widths[name][found.whole]
        widest[name] = float(widths_of_determined.max(initial=0.0))
    main_width = max(widest["kp"], widest["armature"])
    texts = [f"kp and armature {relative_width(main_width)}"]
    for name, noun in (("damping", "damping"), ("coulomb", "friction")):
        if widest[name] <= MAX_WIDTH_DETERMINED:
            texts.append(f"{noun} {relative_width(widest[name])}")
        else:
            shares_of_determined = found.torque_shares[name][found.whole]
            largest_share = float(shares_of_determined.max())
            texts.append(f"{noun} ± {percent(largest_share, 2)} of the joint's torque")
    return ", ".join(texts)


def _value_table(found: IdentifiedServos) -> Table:
    """Row for each joint: values with relative half widths; undetermined values in parentheses."""
    columns = [words("joint", list(found.joints), fold=False)]
    half_widths = found.relative()
    joints_turn = [any(body.joint.turning) for body in found.original.model.leaders]  # else they slide
    for name in _SHOWN_QUANTITIES:
        values = found.values[:, QUANTITIES.index(name)]
        units = []
        for turns in joints_turn:
            unit = servo_unit(name, turning=turns)
            units.append(unit.replace("^2", "²"))
        cells = _cells(values, half_widths[name], found.determined[name], units)
        columns.append(words(name, cells, fold=False))
    ratios_or_nothing = np.where(found.only_ratios, "ratios", "–")
    known_values = np.where(found.whole, "all", ratios_or_nothing).tolist()
    return Table("Servos", *columns, words("known", known_values, fold=False), most=_MAX_ROWS)


def relative_width(half_width: float) -> str:
    """Text of the half width of log(value), as a relative deviation of the value; ``unknown`` from a factor of ten."""
    if half_width < _MAX_SHOWN_WIDTH:
        relative_deviation = math.expm1(half_width)  # from the value to the interval's upper end
        return f"± {percent(relative_deviation, 2)}"
    return "unknown"


def _cells(values: Array, half_widths: Array, determined: Array, units: Sequence[str]) -> list[str]:
    """Text for each joint, such as ``820 N m/rad ± 0.3 %``; an undetermined value in parentheses."""
    cells = []
    for value, half_width, is_determined, unit in zip(values, half_widths.tolist(), determined, units, strict=True):
        text = f"{quantity(value, unit, 3)} {relative_width(half_width)}"
        cells.append(text if is_determined else f"({text})")
    return cells
