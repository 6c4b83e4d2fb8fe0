"""The wrenches of a call: ``{frame: (..., 6)}`` by and on the robot, checked, and summed for each frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import FrameError, ShapeError
from ..typing import Array
from .state_arguments import numbers

if TYPE_CHECKING:
    from ..model.model import Model
    from ..screws.wrench import Wrench

Wrenches: TypeAlias = "Mapping[str, ArrayLike | Wrench]"


def check_mapping(wrenches: Any) -> None:
    """Raise ShapeError unless ``wrenches`` is None or a mapping by frame."""
    if wrenches is not None and not isinstance(wrenches, Mapping):
        raise ShapeError("wrenches are a dict {frame: (m, f)}, for the frame is part of what a wrench says.")


def unlabelled(F: Wrench, frame: str) -> Array:
    """The numbers of a labelled wrench; raises FrameError where its label says another frame than ``frame``."""
    if F.frame != frame:
        raise FrameError(
            f"a wrench in {F.frame!r} was given for frame {frame!r}: move it first, T @ F with "
            f"T = Pose(…, to={frame!r}, of={F.frame!r})."
        )
    return F.values


def wrench_at(model: Model, frame: str, F: ArrayLike | Wrench) -> Array:
    """The six numbers (..., 6) of a wrench at a frame, float64 or float32."""
    from ..screws.wrench import Wrench

    model.frame(frame)
    frame = str(frame)
    F = unlabelled(F, frame) if isinstance(F, Wrench) else F
    given = arguments.brought(F, f"the wrench at {frame!r}")
    array = numbers("wrench", {}, **{f"the one at {frame!r}": given})[0]
    if array.shape[-1:] != (6,):
        raise ShapeError(f"the wrench at {frame!r} has shape {array.shape}, expected six numbers (m, f), moment first.")
    small = np.can_cast(given.dtype, np.float32)  # as a kernel takes it: float16 does not make results double
    return array.astype(np.float32, copy=False) if small else array


def by_frame(
    model: Model, arrays: Sequence[ArrayLike], by_robot: Wrenches | None, on_robot: Wrenches | None
) -> dict[str, Array]:
    """F_by - F_on of each frame that is named, frames in alphabetical order; ``arrays``: what they are given beside."""
    total: dict[str, Array] = {}
    for sign, wrenches in ((1.0, by_robot), (-1.0, on_robot)):
        check_mapping(wrenches)
        for frame, F in (wrenches or {}).items():
            mine = sign * wrench_at(model, frame, F)
            try:
                total[frame] = total[frame] + mine if frame in total else mine
            except ValueError:
                raise ShapeError(
                    f"the wrenches by and on the robot at {frame!r} have batch shapes that do not broadcast: "
                    f"{total[frame].shape[:-1]} and {mine.shape[:-1]}."
                ) from None
    if total and all(getattr(a, "dtype", None) == np.float32 for a in arrays):  # lists do not make them double
        given = {**(by_robot or {}), **(on_robot or {})}
        total = {f: F if hasattr(given[f], "dtype") else F.astype(np.float32) for f, F in total.items()}
    return {frame: total[frame] for frame in sorted(total)}  # whatever the order they were given in, one kernel
