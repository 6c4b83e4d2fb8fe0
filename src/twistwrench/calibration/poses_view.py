"""Planned readings as blocks: verdict, predicted error by the number of readings, remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..core.answers.blocks import Block, Headline, Line, Table, numbers, remarks
from ..core.colours import Style
from ..core.numbers import number, percent, quantity
from ..core.verdict import Word
from .poses import OFF_AXIS, SHARE, MeasuringPoses
from .result_view import millimetres

_COLUMNS = {
    "pose": "columns x, y, z, qw, qx, qy, qz",
    "position": "columns x, y, z",
    "distance": "column distance",
    "pair": "column distance, the same in both rows of a pair",
}


def doubts_of_plan(plan: MeasuringPoses) -> list[str]:
    """Reasons against OK: groups that stay unknown, an error that stays large, and clearances that are not known."""
    found, left = list[str](), float(plan.remaining[-1])
    if plan.rank < plan.theory:
        found.append(f"{plan.count} readings determine {plan.rank} of {plan.theory} groups of parameters; plan more")
    if left > SHARE * plan.by_file:
        found.append(
            f"{millimetres(left)} of {millimetres(plan.by_file)} are predicted to remain, {percent(left / plan.by_file)}; plan "
            "more readings, or better ones (noise)"
        )
    if plan.capsules is None:
        found.append("distances of links from each other were not looked at")
        return found
    if assumption := plan.capsules.capsules.assumption:
        found.append(assumption)
    return [*found, *(f"not looked at: {sentence}" for sentence in plan.capsules.unwatched)]


def plan_view(plan: MeasuringPoses) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    noise = millimetres(plan.noise[0])
    if plan.kind == "pose":
        noise += f" and {quantity(math.degrees(plan.noise[1]), '°', 2)}"
    figures = (
        f"with {plan.count} readings, each right to {noise}, {millimetres(float(plan.remaining[-1]))} are predicted to remain; "
        f"by the file {millimetres(plan.by_file)}"
    )
    if plan.verdict.word is Word.OK:
        yield Headline(Word.OK, f"{figures}.")
    else:
        first, *others = plan.verdict.reasons
        yield Headline(plan.verdict.word, first, reasons=others, further=[Line(f"{figures[0].upper()}{figures[1:]}.")])
    yield ""
    yield Line(
        (plan.robot_name, Style.STRONG), f"  ·  {plan.subject.partition(' · ')[2]}, at {plan.fit.problem.chain.frame}"
    )
    yield Table(
        "Predicted error of the tip",
        numbers("readings", plan.counts),
        numbers("remains", [1e3 * x for x in plan.remaining], lambda x: number(x, 3, decimals=3), "mm"),
    )
    yield Line(f"{plan.rank} groups of parameters are determined, in theory {plan.theory}.")
    notes = [f"Measure the configurations, add the {_COLUMNS[plan.kind]}, and give the file to `calibrate`."]
    if plan.moved_off_axis:
        joint = plan.fit.problem.chain.joints[-1]
        notes.append(f"Mount the target {number(1e3 * OFF_AXIS)} mm off the axis of {joint}, as is assumed here.")
    notes.append("Clearances hold at the configurations; the moves between them are not checked.")
    yield from remarks(notes)
