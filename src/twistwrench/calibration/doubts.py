"""Doubts about a calibration: what the measurements cannot see, and readings that contradict the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..core.doubts import Doubt, Level, doubt
from ..core.numbers import number
from ..core.text import listed
from ..mechanics.lie import so3
from .held_out import configuration_labels
from .instrument import Offered, instrument_doubts, step_doubts
from .measurements import Measurements
from .readings_otherwise import computed_doubts, effect_doubts, reading_doubts
from .result_view import millimetres

if TYPE_CHECKING:
    from .result import CalibratedRobot

_LEVELS = ("refuse", "unsure", "note")
"""Levels of doubts, the most severe first."""
_MIN_EQUATIONS_OF_GROUP = 2.0
"""Least number of equations for each group."""
_MAX_RATIO_TO_EXPECTED = 2.0
"""Largest ratio of the held-out error to the expected one."""
_MAX_REMAINING_SHARE = 1.0 / 3.0
"""Largest part of the error before that may remain."""
_MAX_NOTED_OUTLIER_SHARE = 0.05
"""Share of outliers up to which they are a mere note."""
_MAX_LISTED_ROWS = 5
"""Number of rows that a message names."""
_MIN_UNEXPLAINED = 0.95
"""Residual, as a share of that without a cause, from which the cause does not explain it."""
_MAX_DISTANCE_ON_AXIS = 1e-3
"""Distance [m] of the target from the last axis below which the target counts as on the axis."""
_MAX_COPY_DIFFERENCE = 1e-9
"""Difference [m] of readings below which one is a copy of the other."""
_LIMIT_EXCESS = 0.1
"""Excess over a limit, as a share of the joint's range, above which positions are doubted."""


def doubts_of(found: CalibratedRobot) -> list[Doubt]:
    """All doubts, the most severe first; only those that reject the readings, if there are any."""
    contradictions = computed_doubts(found) or step_doubts(found) or reading_doubts(found)  # the first that has some
    reading_problems = [*_contradictory_rows(found), *contradictions]
    refusals = [problem for problem in reading_problems if problem.refuses]
    if refusals:
        return refusals
    causes = _causes_to_name([*effect_doubts(found), *instrument_doubts(found)])
    is_explained = any(cause.level != "note" for cause in causes)
    doubts = [*reading_problems, *causes, *_unseen_effects(found)]
    if not is_explained:
        doubts += _unexplained_errors(found)
    return sorted(doubts, key=lambda each_doubt: _LEVELS.index(each_doubt.level))


def _causes_to_name(causes: list[Offered]) -> list[Doubt]:
    """Doubts about the cause that lowers the residual most, and about causes that do not lower it, as a scale may."""
    best_cause = min(causes, key=lambda cause: cause.left, default=None)  # leaves the least of the residual
    return [cause.doubt for cause in causes if cause is best_cause or cause.left > _MIN_UNEXPLAINED]


def _contradictory_rows(found: CalibratedRobot) -> Iterator[Doubt]:
    """Doubts about copied readings, positions outside the limits, and outliers."""
    limits = found.original.limits
    chain = found.fit.problem.chain
    for m in found.fit.problem.measured:
        yield from _duplicates(m)
        excess = _LIMIT_EXCESS * (limits.upper - limits.lower)
        is_outside = (m.q > limits.upper + excess) | (m.q < limits.lower - excess)
        names = [joint for joint, k in zip(chain.joints, chain.columns, strict=True) if is_outside[:, k].all()]
        if names:
            yield doubt("calibration-limits", names)
    outliers = found.outliers
    if not outliers:
        return
    share = len(outliers) / found.fit.problem.count
    level: Level = "unsure"
    if share <= _MAX_NOTED_OUTLIER_SHARE:
        level = "note"
    row_texts = [f"row {row} by {millimetres(error)}" for row, error in outliers]
    _, largest_error = outliers[0]  # sorted by error
    yield doubt(
        "calibration-outlier", level=level, rows=listed(row_texts, _MAX_LISTED_ROWS),
        found={"value": largest_error, "unit": "m"},
    )  # fmt: skip


def _duplicates(m: Measurements) -> Iterator[Doubt]:
    """Doubt about copied rows: equal configurations with equal readings."""
    if m.kind not in ("pose", "position", "distance"):
        return
    readings = m.points if len(m.points) else m.sizes[:, None]
    labels = configuration_labels(m)
    _, first_rows, label_indices = np.unique(labels, return_index=True, return_inverse=True)
    first_row = first_rows[label_indices.ravel()]  # with the configuration of each row
    is_later = first_row != np.arange(len(labels))
    is_equal = np.abs(readings - readings[first_row]).max(axis=1) < _MAX_COPY_DIFFERENCE
    copies = np.flatnonzero(is_later & is_equal)
    if len(copies):
        pair_texts = [f"{row} of {first_row[row]}" for row in copies]
        rows = listed(pair_texts, _MAX_LISTED_ROWS)
        yield doubt("calibration-duplicate", rows=rows, found={"value": float(copies[0])})


def _unseen_effects(found: CalibratedRobot) -> Iterator[Doubt]:
    """Doubts about missing lengths, and about too few or too similar poses."""
    remaining = found.remaining
    problem = found.fit.problem
    row_count = 0
    for weights in found.fit.weights:  # (readings, rows of each); zero for outliers
        used_readings = int((weights[:, -1] > 0).sum())
        row_count += used_readings * weights.shape[1]
    remaining_text = millimetres(remaining.rms)
    value = {"value": remaining.rms, "unit": "m"}
    if problem.is_scaleless:
        yield doubt("calibration-no-length", what=problem.measured[0].kind, left=remaining_text, found=value)
    elif remaining.is_unseen:
        yield doubt("calibration-unseen", left=remaining_text, found=value)
    if found.rank < found.theory:
        joint = _axis_through_target(found)
        if joint:
            yield doubt("calibration-on-axis", [joint])
        else:
            yield doubt("calibration-unexciting", rank=found.rank, theory=found.theory)
    if row_count < _MIN_EQUATIONS_OF_GROUP * found.rank:
        missing_rows = _MIN_EQUATIONS_OF_GROUP * found.theory - row_count
        missing_readings = int(np.ceil(missing_rows / problem.measured[0].rows_each))
        yield doubt("calibration-few", rows=row_count, rank=found.rank, more=max(missing_readings, 1))


def _axis_through_target(found: CalibratedRobot) -> str:
    """Last joint, if it turns, the target is on its axis and orientations are not measured; empty otherwise."""
    chain = found.fit.problem.chain
    if not chain.turning[-1] or any(m.kind == "pose" for m in found.fit.problem.measured):
        return ""
    S = chain.screws[-1]
    p = found.tip_pose[:3, 3]
    velocity = S[3:] + np.asarray(so3.cross(S[:3], p))  # of the target at 1 rad/s: its distance from the axis
    if np.linalg.norm(velocity) < _MAX_DISTANCE_ON_AXIS:
        return chain.joints[-1]
    return ""


def _unexplained_errors(found: CalibratedRobot) -> Iterator[Doubt]:
    """Doubts about a held-out error above the expected one, and about a remaining error that could be calibrated away."""
    if found.held_out.rms > _MAX_RATIO_TO_EXPECTED * found.floor:
        yield doubt(
            "calibration-unexplained", held_out=millimetres(found.held_out.rms), floor=millimetres(found.floor),
            found={"value": found.held_out.rms, "unit": "m"},
        )  # fmt: skip
    if found.remaining.is_unseen or found.needs_nothing:
        return
    before = found.before if found.measures_tip else found.remaining_before
    if found.remaining.rms > _MAX_REMAINING_SHARE * before:
        share = number(100.0 * found.remaining.rms / before, 2)
        yield doubt(
            "calibration-little", left=millimetres(found.remaining.rms), before=millimetres(before), share=share
        )
