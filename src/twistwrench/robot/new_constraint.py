"""A closure or a velocity constraint, from the frames and rows that it is described by."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.constraints import Closure, Rolling, place_of
from ..algorithms.jacobians import KINDS
from ..algorithms.operational_space import row_numbers
from ..core import arguments
from ..errors import ConstraintError, UnknownNameError
from ..model.model import BASE, Model
from .quantity_types import Rows


def closure(model: Model, frame_a: str, frame_b: str, rows: Rows, pose: ArrayLike | None) -> Closure:
    """What :meth:`twistwrench.Robot.close` describes."""
    frame_a, frame_b = _named(model, frame_a), _named(model, frame_b)
    if place_of(model, frame_a).body == place_of(model, frame_b).body:
        raise ConstraintError(
            f"{frame_a!r} and {frame_b!r} are fixed to one body, so nothing between them can be closed."
        )
    T_ac = np.eye(4) if pose is None else arguments.pose(arguments.one(pose, "pose", 4, 4), "pose")
    return Closure(frame_a, frame_b, row_numbers(rows), tuple(tuple(row) for row in T_ac.tolist()))


def rolling(model: Model, frame: str, rows: Rows, kind: str) -> Rolling:
    """What :meth:`twistwrench.Robot.constrain` describes."""
    if kind not in KINDS:
        raise UnknownNameError.of("kind", kind, KINDS)
    frame = _named(model, frame)
    if model.frame(frame).body == BASE:
        raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
    return Rolling(frame, row_numbers(rows), kind)


def _named(model: Model, frame: str | None) -> str:
    """The frame's name, the tip's for None; errors as those of :meth:`Model.frame`."""
    if frame is None:
        model.frame(None)
        return str(model.tip)
    return frame
