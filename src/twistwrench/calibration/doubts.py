"""Doubts about a calibration: what the measurements cannot see, and readings that contradict the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.lie import so3
from .held_out import configuration_labels
from .instrument import Offered, instrument_doubts, step_doubts
from .readings_otherwise import computed_doubts, effect_doubts, reading_doubts
from .result_view import millimetres

if TYPE_CHECKING:
    from .result import CalibratedRobot

_SEVEREST_FIRST = {"refuse": 0, "unsure": 1, "note": 2}
_MIN_RATIO = 2.0
"""Least equations for each group; and ratio of held-out error to the expected one."""
_MAX_REMAINING_SHARE = 1.0 / 3.0
"""Largest part of the error before that may remain."""
_FEW_OUTLIERS = 0.05
_MIN_UNEXPLAINED = 0.95
"""Residual, as a share of that without a cause, from which the cause does not explain it."""
_ON_AXIS = 1e-3
"""Distance [m] of the target from the last axis below which it counts as on the axis."""
_MAX_COPY_DIFFERENCE = 1e-9


def doubts_of(found: CalibratedRobot) -> list[Doubt]:
    """All doubts, the most severe first."""
    contradictions = computed_doubts(found) or step_doubts(found) or reading_doubts(found)
    readings = [*_contradictory_rows(found), *contradictions]
    refusing = [one for one in readings if one.refuses]
    if refusing:
        return refusing
    offered = _causes_to_name([*effect_doubts(found), *instrument_doubts(found)])
    explained = any(one.level != "note" for one in offered)
    doubts = [*readings, *offered, *_unseen_effects(found)]
    if not explained:
        doubts += _unexplained_errors(found)
    return sorted(doubts, key=lambda one: _SEVEREST_FIRST[one.level])


def _causes_to_name(every: list[Offered]) -> list[Doubt]:
    """Causes that lower the residual: the best of them; and those that leave it, as a scale does."""
    best = min(every, key=lambda one: one.left, default=None)
    return [one.doubt for one in every if one is best or one.left > _MIN_UNEXPLAINED]


def _contradictory_rows(found: CalibratedRobot) -> Iterator[Doubt]:
    """Repeated readings, outliers, positions outside the limits."""
    limits = found.original.limits
    for m in found.fit.problem.measured:
        yield from _duplicates(found, m.q, configuration_labels(m))
        columns = found.fit.problem.chain.columns
        width = 0.1 * (limits.upper - limits.lower)
        beyond = (m.q > limits.upper + width) | (m.q < limits.lower - width)
        names = [j for j, k in zip(found.fit.problem.chain.joints, columns, strict=True) if beyond[:, k].all()]
        if names:
            yield doubt("calibration-limits", names)
    outliers = found.outliers
    if not outliers:
        return
    share = len(outliers) / found.fit.problem.count
    rows = listed([f"row {row} by {millimetres(size)}" for row, size in outliers], 5)
    yield doubt(
        "calibration-outlier", level="note" if share <= _FEW_OUTLIERS else "unsure", rows=rows,
        found={"value": outliers[0][1], "unit": "m"},
    )  # fmt: skip


def _duplicates(found: CalibratedRobot, q: Array, labels: Array) -> Iterator[Doubt]:
    """Copied rows: equal configurations with equal readings."""
    m = next(m for m in found.fit.problem.measured if m.q is q)
    if m.kind not in ("pose", "position", "distance"):
        return
    readings = m.points if len(m.points) else m.sizes[:, None]
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    other = first[inverse.ravel()]
    copied = (other != np.arange(len(labels))) & (np.abs(readings - readings[other]).max(axis=1) < _MAX_COPY_DIFFERENCE)
    if copied.any():
        rows = np.flatnonzero(copied)
        pairs = listed([f"{row} of {other[row]}" for row in rows], 5)
        yield doubt("calibration-duplicate", rows=pairs, found={"value": float(rows[0])})


def _unseen_effects(found: CalibratedRobot) -> Iterator[Doubt]:
    """Missing lengths, too few or too similar poses."""
    remaining, problem = found.remaining, found.fit.problem
    rows = int(sum((W[:, -1] > 0).sum() * W.shape[1] for W in found.fit.weights))
    left = millimetres(remaining.rms)
    if problem.is_scaleless:
        what = problem.measured[0].kind
        yield doubt(
            "calibration-no-length", what=what, left=left, found={"value": remaining.rms, "unit": "m"},
        )  # fmt: skip
    elif remaining.is_unseen:
        yield doubt("calibration-unseen", left=left, found={"value": remaining.rms, "unit": "m"})
    if found.rank < found.theory:
        joint = _axis_through_target(found)
        if joint:
            yield doubt("calibration-on-axis", [joint])
        else:
            yield doubt("calibration-unexciting", rank=found.rank, theory=found.theory)
    if rows < _MIN_RATIO * found.rank:
        each = problem.measured[0].rows_each
        more = int(np.ceil((_MIN_RATIO * found.theory - rows) / each))
        yield doubt("calibration-few", rows=rows, rank=found.rank, more=max(more, 1))


def _axis_through_target(found: CalibratedRobot) -> str:
    """Last turning joint if the target is on its axis and its orientation is not measured."""
    chain = found.fit.problem.chain
    if not chain.turning[-1] or any(m.kind == "pose" for m in found.fit.problem.measured):
        return ""
    S, p = chain.screws[-1], found.tip_pose[:3, 3]
    off = S[3:] + np.asarray(so3.cross(S[:3], p))
    if np.linalg.norm(off) < _ON_AXIS:
        return chain.joints[-1]
    return ""


def _unexplained_errors(found: CalibratedRobot) -> Iterator[Doubt]:
    """Held-out error larger than expected; improvement smaller than a calibration is worth."""
    if found.held_out.rms > _MIN_RATIO * found.floor:
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
