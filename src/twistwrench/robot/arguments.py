"""Argument validation of quantities: arrays checked and converted, wrenches ``{frame: (..., 6)}`` summed by frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import is_table
from ..core.errors import FrameError, ShapeError
from ..core.typing import Array

if TYPE_CHECKING:
    from ..mechanics.lie.twist_wrench import Wrench
    from ..mechanics.model.model import Model


Kind = Literal["body", "space", "world_aligned"]
Rows = str | Iterable[int | str] | None
"""Rows of a twist: names such as ``"vx vz"``, or numbers 0 to 5; None selects all six."""
Wrenches: TypeAlias = "Mapping[str, ArrayLike | Wrench]"
"""``{frame: (..., 6)}``, each (m, f) in the axes of its frame."""
CONFIGURATIONS = ("q", "q0", "q1")
"""Inputs that are configurations; derivatives with respect to them are along :meth:`twistwrench.Robot.add`."""

_MAX_LISTED_ENTRIES = 12
"""Largest number of entries that an error lists by name."""


def is_symbolic(arrays: Sequence[Any]) -> bool:
    """True if any of the arrays holds symbols of a trace."""
    if all(isinstance(x, np.ndarray) and x.dtype != object for x in arrays):
        return False  # the usual case, without the import
    from ..compiler.ir.expr import Expr

    for x in arrays:
        if isinstance(x, Expr):
            return True
        is_object_array = isinstance(x, np.ndarray) and x.dtype == object
        if is_object_array and any(isinstance(entry, Expr) for entry in x.flat):
            return True
        if isinstance(x, list | tuple) and is_symbolic(x):
            return True
    return False


def names_of(model: Model, label: str) -> tuple[str, ...]:
    """Names of the entries along an input's last axis, used to look up table columns; empty if there are none."""
    if label in CONFIGURATIONS:
        return model.coordinate_names
    if label in ("wrench", "gravity", "parameters"):
        return ()
    return model.velocity_names


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Name of each input of a kernel, as messages write it, and its shape without batch axes."""
    from . import programs as quantity_programs
    from .kernels.options import checked_options

    inputs = quantity_programs.inputs_of(model, name, checked_options(model, name, options))
    return [(input_name(label), shape) for label, shape in inputs]


def input_name(label: str) -> str:
    """Name of an input in messages: a wrench without its frame."""
    if label.startswith("wrench at "):
        return "wrench"
    return label


def to_numbers(model: Model, name: str, arrays: Sequence[Any], options: Mapping[str, Any]) -> tuple[Any, ...]:
    """Inputs of a quantity as NumPy or Dask arrays; columns of tables are put into the robot's order."""
    from .quantities import QUANTITIES

    input_names = QUANTITIES[name].inputs
    converted = []
    for k, array in enumerate(arrays):
        label = f"input {k + 1}"
        if k < len(input_names):
            label = input_names[k]
        columns: tuple[str, ...] = ()
        if is_table(array):
            all_inputs = inputs_of(model, name, options)  # with wrenches, gravity and parameters
            if k < len(all_inputs):
                label, _ = all_inputs[k]
            columns = names_of(model, label)
        converted.append(arguments.to_numbers(array, f"{name}: {label}", columns))
    return tuple(converted)


def states(model: Model, name: str, **arrays: ArrayLike) -> list[Array]:
    """States as arrays of float64 or float32. Columns of tables are put into the robot's order; Dask arrays stay."""
    return numbers(name, {label: names_of(model, label) for label in arrays}, **arrays)


def finite_states(model: Model, name: str, **arrays: ArrayLike) -> list[Array]:
    """Finite state arrays with the right last axis and batch shapes that broadcast."""
    checked = {}
    for label, array in arrays.items():
        size = model.nv
        if label in CONFIGURATIONS:
            size = model.nq
        checked[label] = arguments.finite(array, f"{name}: {label}", size, names=names_of(model, label))
    try:
        np.broadcast_shapes(*(array.shape[:-1] for array in checked.values()))
    except ValueError:
        raise arguments.mismatch(**checked) from None
    return list(checked.values())


def numbers(name: str, names: Mapping[str, Sequence[str]], /, **arrays: ArrayLike) -> list[Array]:
    """Arrays of float64; arrays of float32 and Dask arrays stay what they are.

    ``names``: by argument, the columns to take from a table.
    """
    reals = []
    for label, value in arrays.items():
        array = arguments.to_numbers(value, f"{name}: {label}", names.get(label, ()))
        if not np.can_cast(array.dtype, float):
            raise _not_real(name, label, array)
        if array.dtype != np.float32:
            array = array.astype(float)
        reals.append(array)
    return reals


def misfit(model: Model, name: str, arrays: Sequence[Any], options: Mapping[str, Any]) -> ShapeError | None:
    """Shape error that names the argument, or None if types and shapes fit."""
    batch_shapes = []
    for (label, shape), array in zip(inputs_of(model, name, options), arrays, strict=False):
        if not np.can_cast(array.dtype, float):
            return _not_real(name, label, array)
        if array.ndim < 1 or array.shape[-1:] != shape:
            entries = _entries_text(model, label, shape[0])
            return ShapeError(f"{name}: {label} has shape {array.shape}, but robot {model.name!r} wants {entries}.")
        batch_shapes.append((label, array.shape[:-1]))
    try:
        np.broadcast_shapes(*(batch_shape for _, batch_shape in batch_shapes))
    except ValueError:
        listed = ", ".join(f"{label} {batch_shape}" for label, batch_shape in batch_shapes)
        return ShapeError(f"{name}: the batch shapes do not broadcast: {listed}.")
    except RuntimeError:  # more axes than NumPy supports
        label, batch_shape = max(batch_shapes, key=lambda pair: len(pair[1]))  # with most batch axes
        return ShapeError(
            f"{name}: {label} has {len(batch_shape)} batch axes. NumPy broadcasts at most 32 axes; compiled kernels take "
            "at most 64, those of one result included. Reshape the batch to one axis."
        )
    return None


def _entries_text(model: Model, label: str, count: int) -> str:
    """Text of the entries that an input must have in its last axis, for messages."""
    if label == "wrench":
        return "(m, f), angular part first"
    names = model.coordinate_names if label == "q" else model.joint_names
    parenthesis = f" (one per entry of {', '.join(names)})" if count <= _MAX_LISTED_ENTRIES else ""
    return f"{count} in the last axis{parenthesis}"


def _not_real(name: str, label: str, array: Any) -> ShapeError:
    """Error for values that float32 or float64 cannot represent, or not exactly."""
    dtype = array.dtype
    if dtype.kind == "f":
        return ShapeError(
            f"{name}: {label} is of {dtype.name}, and kernels compute in float32 or float64. Say that it may be rounded: "
            f"np.asarray({label}, float)."
        )
    hint = " If all of them are real numbers, np.asarray(…, float) makes one." if dtype.kind == "O" else ""
    if is_symbolic((array,)):
        hint = f" Symbols go through the methods of robot.kernel's quantities; {name} takes numbers only."
    return ShapeError(
        f"{name}: {label} is not an array of real numbers but of {dtype.name}: {str(array)[:60]!r}.{hint}"
    )


# ── Wrenches ``{frame: (..., 6)}`` by and on the robot, summed by frame


def check_mapping(wrenches: Any) -> None:
    """Raise ShapeError unless ``wrenches`` is None or a mapping by frame."""
    if wrenches is not None and not isinstance(wrenches, Mapping):
        raise ShapeError("wrenches are a dict {frame: (m, f)}, since a wrench needs its frame.")


def values_at(F: Wrench, frame: str) -> Array:
    """Numbers of a labelled wrench; raises FrameError if its label names a frame other than ``frame``."""
    if F.frame != frame:
        raise FrameError(
            f"a wrench in {F.frame!r} was given for frame {frame!r}: move it first, T @ F with "
            f"T = Pose(…, to={frame!r}, of={F.frame!r})."
        )
    return F.values


def refuse_base(model: Model, frame: str) -> None:
    """Raise FrameError for a frame of the base: a wrench on the base takes no torque of a joint."""
    from ..mechanics.model.model import BASE

    if model.frame(frame).body == BASE:
        raise FrameError(
            f"a wrench labelled with {frame!r}, a frame of the base, acts on the base, so no joint carries it. If it acts on "
            f"the tip, move it there first: T @ F with T = Pose(…, to=tip, of={frame!r})."
        )


def wrench_at(model: Model, frame: str, F: ArrayLike | Wrench) -> Array:
    """Components (..., 6) of a wrench at a frame, float64 or float32."""
    from ..mechanics.lie.twist_wrench import Wrench

    model.frame(frame)
    frame = str(frame)
    if isinstance(F, Wrench):
        F = values_at(F, frame)
    components = arguments.to_numbers(F, f"the wrench at {frame!r}")
    label = f"the one at {frame!r}"  # in a message: "wrench: the one at 'tip' is not …"
    (array,) = numbers("wrench", {}, **{label: components})
    if array.shape[-1:] != (6,):
        raise ShapeError(f"the wrench at {frame!r} has shape {array.shape}, expected six numbers (m, f), moment first.")
    if np.can_cast(components.dtype, np.float32):  # as in kernels: float16 does not promote results to double
        return array.astype(np.float32, copy=False)
    return array


def sum_by_frame(
    model: Model, arrays: Sequence[ArrayLike], by_robot: Wrenches | None, on_robot: Wrenches | None
) -> dict[str, Array]:
    """F_by - F_on of each named frame, frames in alphabetical order; ``arrays``: the other inputs of the call."""
    total: dict[str, Array] = {}
    for sign, wrenches in ((1.0, by_robot), (-1.0, on_robot)):
        check_mapping(wrenches)
        for frame, F in (wrenches or {}).items():
            signed = sign * wrench_at(model, frame, F)
            if frame not in total:
                total[frame] = signed
                continue
            try:
                total[frame] = total[frame] + signed
            except ValueError:
                raise ShapeError(
                    f"the wrenches by and on the robot at {frame!r} have batch shapes that do not broadcast: "
                    f"{total[frame].shape[:-1]} and {signed.shape[:-1]}."
                ) from None
    others_are_float32 = all(getattr(array, "dtype", None) == np.float32 for array in arrays)
    if total and others_are_float32:  # lists do not promote float32 to double
        wrench_arguments = {**(by_robot or {}), **(on_robot or {})}
        for frame, F in total.items():
            if not hasattr(wrench_arguments[frame], "dtype"):
                total[frame] = F.astype(np.float32)
    return dict(sorted(total.items()))  # one kernel for any order of arguments
