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
    reasons = list[str]()
    remaining = float(plan.remaining[-1])  # after all readings
    if plan.rank < plan.theory:
        reasons.append(f"{plan.count} readings determine {plan.rank} of {plan.theory} groups of parameters; plan more")
    if remaining > SHARE * plan.by_file:
        reasons.append(
            f"{millimetres(remaining)} of {millimetres(plan.by_file)} are predicted to remain, "
            f"{percent(remaining / plan.by_file)}; plan more readings, or better ones (noise)"
        )
    if plan.capsules is None:
        reasons.append("distances of links from each other were not looked at")
        return reasons
    assumption = plan.capsules.capsules.assumption
    if assumption:
        reasons.append(assumption)
    reasons += [f"not looked at: {sentence}" for sentence in plan.capsules.unwatched]
    return reasons


def plan_view(plan: MeasuringPoses) -> Iterator[Block]:
    """Blocks of the report, verdict first."""
    noise = millimetres(plan.noise[0])
    if plan.kind == "pose":
        noise += f" and {quantity(math.degrees(plan.noise[1]), '°', 2)}"
    summary = (
        f"with {plan.count} readings, each right to {noise}, {millimetres(float(plan.remaining[-1]))} are predicted to remain; "
        f"by the file {millimetres(plan.by_file)}"
    )
    if plan.verdict.word is Word.OK:
        yield Headline(Word.OK, f"{summary}.")
    else:
        first, *others = plan.verdict.reasons
        sentence = f"{summary[0].upper()}{summary[1:]}."
        yield Headline(plan.verdict.word, first, reasons=others, further=[Line(sentence)])
    yield ""
    _, _, readings = plan.subject.partition(" · ")
    yield Line((plan.robot_name, Style.STRONG), f"  ·  {readings}, at {plan.fit.problem.chain.frame}")
    remaining_mm = [1e3 * error for error in plan.remaining]
    yield Table(
        "Predicted error of the tip",
        numbers("readings", plan.counts),
        numbers("remains", remaining_mm, lambda error: number(error, 3, decimals=3), "mm"),
    )
    yield Line(f"{plan.rank} groups of parameters are determined, in theory {plan.theory}.")
    notes = [f"Measure the configurations, add the {_COLUMNS[plan.kind]}, and give the file to `calibrate`."]
    if plan.moved_off_axis:
        joint = plan.fit.problem.chain.joints[-1]
        notes.append(f"Mount the target {number(1e3 * OFF_AXIS)} mm off the axis of {joint}, as is assumed here.")
    notes.append("Clearances hold at the configurations; the moves between them are not checked.")
    yield from remarks(notes)
