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
"""Columns of a measurement by its kind."""
_MILLI = 1e3
"""Factor of metres for millimetres."""


def doubts_of_plan(plan: MeasuringPoses) -> list[str]:
    """Reasons against OK: groups that stay unknown, an error that stays large, and clearances that are not known."""
    reasons = list[str]()
    remaining_error = float(plan.remaining[-1])  # after all readings [m]
    if plan.rank < plan.theory:
        reasons.append(f"{plan.count} readings determine {plan.rank} of {plan.theory} groups of parameters; plan more")
    if remaining_error > SHARE * plan.by_file:
        reasons.append(
            f"{millimetres(remaining_error)} of {millimetres(plan.by_file)} are predicted to remain, "
            f"{percent(remaining_error / plan.by_file)}; plan more readings, or better ones (noise)"
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
    position_noise, angle_noise = plan.noise  # [m], [rad]
    noise_text = millimetres(position_noise)
    if plan.kind == "pose":
        noise_text += f" and {quantity(math.degrees(angle_noise), '°', 2)}"
    remaining_error = millimetres(float(plan.remaining[-1]))
    summary = (
        f"with {plan.count} readings, each right to {noise_text}, {remaining_error} are predicted to remain; "
        f"by the file {millimetres(plan.by_file)}"
    )
    if plan.verdict.word is Word.OK:
        yield Headline(Word.OK, f"{summary}.")
    else:
        main_reason, *other_reasons = plan.verdict.reasons
        summary_line = Line(f"{summary[0].upper()}{summary[1:]}.")
        yield Headline(plan.verdict.word, main_reason, reasons=other_reasons, further=[summary_line])
    yield ""
    _, _, readings = plan.subject.partition(" · ")
    yield Line((plan.robot_name, Style.STRONG), f"  ·  {readings}, at {plan.fit.problem.chain.frame}")
    remaining_errors = [_MILLI * error for error in plan.remaining]  # [mm]
    yield Table(
        "Predicted error of the tip",
        numbers("readings", plan.counts),
        numbers("remains", remaining_errors, lambda error: number(error, 3, decimals=3), "mm"),
    )
    yield Line(f"{plan.rank} groups of parameters are determined, in theory {plan.theory}.")
    notes = [f"Measure the configurations, add the {_COLUMNS[plan.kind]}, and give the file to `calibrate`."]
    if plan.moved_off_axis:
        last_joint = plan.fit.problem.chain.joints[-1]
        notes.append(
            f"Mount the target {number(_MILLI * OFF_AXIS)} mm off the axis of {last_joint}, as is assumed here."
        )
    notes.append("Clearances hold at the configurations; the moves between them are not checked.")
    yield from remarks(notes)
