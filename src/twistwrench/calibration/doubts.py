"""Doubts about a calibration: what the measurements cannot see, and readings that contradict the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..core.doubts import Doubt, doubt
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
_MAX_NOTED_OUTLIERS = 0.05
"""Share of outliers up to which they are a mere note."""
_MIN_UNEXPLAINED = 0.95
"""Residual, as a share of that without a cause, from which the cause does not explain it."""
_MAX_DISTANCE_ON_AXIS = 1e-3
"""Distance [m] of the target from the last axis below which it counts as on the axis."""
_MAX_COPY_DIFFERENCE = 1e-9
"""Difference [m] of readings below which one is a copy of the other."""
_LIMIT_EXCESS = 0.1
"""Share of a joint's range by which all positions exceed a limit if they are doubted."""


def doubts_of(found: CalibratedRobot) -> list[Doubt]:
    """All doubts, the most severe first; only those that reject the readings, if there are any."""
    contradictions = computed_doubts(found) or step_doubts(found) or reading_doubts(found)
    about_readings = [*_contradictory_rows(found), *contradictions]
    refusing = [each for each in about_readings if each.refuses]
    if refusing:
        return refusing
    causes = _causes_to_name([*effect_doubts(found), *instrument_doubts(found)])
    is_explained = any(cause.level != "note" for cause in causes)
    doubts = [*about_readings, *causes, *_unseen_effects(found)]
    if not is_explained:
        doubts += _unexplained_errors(found)
    return sorted(doubts, key=lambda each: _LEVELS.index(each.level))


def _causes_to_name(causes: list[Offered]) -> list[Doubt]:
    """The cause that lowers the residual most, and all causes that do not lower it, as a scale may."""
    best = min(causes, key=lambda cause: cause.left, default=None)
    return [cause.doubt for cause in causes if cause is best or cause.left > _MIN_UNEXPLAINED]


def _contradictory_rows(found: CalibratedRobot) -> Iterator[Doubt]:
    """Copied readings, positions outside the limits, and outliers."""
    limits, chain = found.original.limits, found.fit.problem.chain
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
    rows = listed([f"row {row} by {millimetres(error)}" for row, error in outliers], 5)
    _, largest_error = outliers[0]
    yield doubt(
        "calibration-outlier", level="note" if share <= _MAX_NOTED_OUTLIERS else "unsure", rows=rows,
        found={"value": largest_error, "unit": "m"},
    )  # fmt: skip


def _duplicates(m: Measurements) -> Iterator[Doubt]:
    """Copied rows: equal configurations with equal readings."""
    if m.kind not in ("pose", "position", "distance"):
        return
    readings = m.points if len(m.points) else m.sizes[:, None]
    labels = configuration_labels(m)
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    first_row = first[inverse.ravel()]  # with the same configuration, for each row
    is_later = first_row != np.arange(len(labels))
    is_equal = np.abs(readings - readings[first_row]).max(axis=1) < _MAX_COPY_DIFFERENCE
    copies = np.flatnonzero(is_later & is_equal)
    if len(copies):
        pairs = listed([f"{row} of {first_row[row]}" for row in copies], 5)
        yield doubt("calibration-duplicate", rows=pairs, found={"value": float(copies[0])})


def _unseen_effects(found: CalibratedRobot) -> Iterator[Doubt]:
    """Missing lengths, too few or too similar poses."""
    remaining, problem = found.remaining, found.fit.problem
    rows = int(sum((W[:, -1] > 0).sum() * W.shape[1] for W in found.fit.weights))  # without outliers
    left = millimetres(remaining.rms)
    value = {"value": remaining.rms, "unit": "m"}
    if problem.is_scaleless:
        yield doubt("calibration-no-length", what=problem.measured[0].kind, left=left, found=value)
    elif remaining.is_unseen:
        yield doubt("calibration-unseen", left=left, found=value)
    if found.rank < found.theory:
        joint = _axis_through_target(found)
        if joint:
            yield doubt("calibration-on-axis", [joint])
        else:
            yield doubt("calibration-unexciting", rank=found.rank, theory=found.theory)
    if rows < _MIN_EQUATIONS_OF_GROUP * found.rank:
        missing_rows = _MIN_EQUATIONS_OF_GROUP * found.theory - rows
        more = int(np.ceil(missing_rows / problem.measured[0].rows_each))  # readings
        yield doubt("calibration-few", rows=rows, rank=found.rank, more=max(more, 1))


def _axis_through_target(found: CalibratedRobot) -> str:
    """Last turning joint if the target is on its axis and its orientation is not measured."""
    chain = found.fit.problem.chain
    if not chain.turning[-1] or any(m.kind == "pose" for m in found.fit.problem.measured):
        return ""
    S, p = chain.screws[-1], found.tip_pose[:3, 3]
    velocity = S[3:] + np.asarray(so3.cross(S[:3], p))  # of the target at 1 rad/s: its distance from the axis
    if np.linalg.norm(velocity) < _MAX_DISTANCE_ON_AXIS:
        return chain.joints[-1]
    return ""


def _unexplained_errors(found: CalibratedRobot) -> Iterator[Doubt]:
    """Held-out error that is larger than expected, and an error that remains although it could be calibrated away."""
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
