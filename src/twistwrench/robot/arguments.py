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


def is_symbolic(arrays: Sequence[Any]) -> bool:
    """True if any of the arrays holds symbols of a trace."""
    if all(isinstance(x, np.ndarray) and x.dtype != object for x in arrays):
        return False
    from ..compiler.ir.expr import Expr

    return any(
        isinstance(x, Expr)
        or (isinstance(x, np.ndarray) and x.dtype == object and any(isinstance(e, Expr) for e in x.flat))
        or (isinstance(x, list | tuple) and is_symbolic(x))
        for x in arrays
    )


def names_of(model: Model, label: str) -> tuple[str, ...]:
    """Names of the entries along an input's last axis, used to look up table columns; empty if there are none."""
    if label in CONFIGURATIONS:
        return model.coordinate_names
    return () if label in ("wrench", "gravity", "parameters") else model.velocity_names


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of a kernel's inputs."""
    from . import programs as quantity_programs
    from .programs import checked_options

    wanted = quantity_programs.inputs_of(model, name, checked_options(model, name, options))
    return [("wrench" if label.startswith("wrench at ") else label, core) for label, core in wanted]


def to_numbers(model: Model, name: str, arrays: Sequence[Any], options: Mapping[str, Any]) -> tuple[Any, ...]:
    """Arrays of a quantity as NumPy or Dask arrays; table columns in the robot's order."""
    from .quantities import QUANTITIES

    labels, found = QUANTITIES[name].inputs, []
    for k, array in enumerate(arrays):
        label, names = labels[k] if k < len(labels) else f"input {k + 1}", None
        if is_table(array):
            wanted = inputs_of(model, name, options)
            label = wanted[k][0] if k < len(wanted) else label
            names = names_of(model, label)
        found.append(arguments.to_numbers(array, f"{name}: {label}", names or ()))
    return tuple(found)


def states(model: Model, name: str, **arrays: ArrayLike) -> list[Array]:
    """State arrays by label, float64 or float32; table columns in the robot's order, Dask arrays unchanged."""
    return numbers(name, {label: names_of(model, label) for label in arrays}, **arrays)


def finite_states(model: Model, name: str, **arrays: ArrayLike) -> list[Array]:
    """Finite state arrays with the right last axis and batch shapes that broadcast."""
    found = [
        arguments.finite(array, f"{name}: {x}", model.nq if x in CONFIGURATIONS else model.nv, names=names_of(model, x))
        for x, array in arrays.items()
    ]
    try:
        np.broadcast_shapes(*(array.shape[:-1] for array in found))
    except ValueError:
        raise arguments.mismatch(**dict(zip(arrays, found, strict=True))) from None
    return found


def numbers(name: str, names: Mapping[str, Sequence[str]], /, **arrays: ArrayLike) -> list[Array]:
    """Arrays of float64, or float32 if given so; table columns ordered by ``names``, Dask arrays unchanged."""
    found = []
    for label, given in arrays.items():
        array = arguments.to_numbers(given, f"{name}: {label}", names.get(label, ()))
        if not np.can_cast(array.dtype, float):
            raise _not_real(name, label, array)
        found.append(array if array.dtype == np.float32 else array.astype(float))
    return found


def misfit(model: Model, name: str, arrays: Sequence[Any], options: Mapping[str, Any]) -> ShapeError | None:
    """Shape error that names the argument, or None if types and shapes fit."""
    batches = []
    for (label, core), a in zip(inputs_of(model, name, options), arrays, strict=False):
        if not np.can_cast(a.dtype, float):
            return _not_real(name, label, a)
        if a.ndim < 1 or a.shape[-1:] != core:
            names = model.coordinate_names if label == "q" else model.joint_names
            which = f" (one per entry of {', '.join(names)})" if label != "wrench" and core[0] <= 12 else ""
            what = "(m, f), angular part first" if label == "wrench" else f"{core[0]} in the last axis{which}"
            return ShapeError(f"{name}: {label} has shape {a.shape}, but robot {model.name!r} wants {what}.")
        batches.append((label, a.shape[:-1]))
    try:
        np.broadcast_shapes(*(b for _, b in batches))
    except ValueError:
        listed = ", ".join(f"{label} {shape}" for label, shape in batches)
        return ShapeError(f"{name}: the batch shapes do not broadcast: {listed}.")
    except RuntimeError:  # more axes than NumPy supports
        label, shape = max(batches, key=lambda batch: len(batch[1]))
        return ShapeError(
            f"{name}: {label} has {len(shape)} batch axes. NumPy's arrays have at most 64 axes, those of one result included. "
            "Reshape the batch to one axis."
        )
    return None


def _not_real(name: str, label: str, given: Any) -> ShapeError:
    """Error for values that float32 or float64 cannot represent, or not exactly."""
    dtype = given.dtype
    if dtype.kind == "f":
        what = f"is of {dtype.name}, and kernels compute in float32 or float64. Say that it may be rounded: "
        return ShapeError(f"{name}: {label} {what}np.asarray({label}, float).")
    hint = " If all of them are real numbers, np.asarray(…, float) makes one." if dtype.kind == "O" else ""
    if is_symbolic((given,)):
        hint = f" Symbols go through the methods of robot.kernel's quantities; {name} takes numbers only."
    return ShapeError(
        f"{name}: {label} is not an array of real numbers but of {dtype.name}: {str(given)[:60]!r}.{hint}"
    )


# ── Wrenches ``{frame: (..., 6)}`` by and on the robot, summed by frame


def check_mapping(wrenches: Any) -> None:
    """Raise ShapeError unless ``wrenches`` is None or a mapping by frame."""
    if wrenches is not None and not isinstance(wrenches, Mapping):
        raise ShapeError("wrenches are a dict {frame: (m, f)}, since a wrench needs its frame.")


def unlabelled(F: Wrench, frame: str) -> Array:
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
    F = unlabelled(F, frame) if isinstance(F, Wrench) else F
    given = arguments.to_numbers(F, f"the wrench at {frame!r}")
    array = numbers("wrench", {}, **{f"the one at {frame!r}": given})[0]
    if array.shape[-1:] != (6,):
        raise ShapeError(f"the wrench at {frame!r} has shape {array.shape}, expected six numbers (m, f), moment first.")
    small = np.can_cast(given.dtype, np.float32)  # as in kernels: float16 does not promote results to double
    return array.astype(np.float32, copy=False) if small else array


def by_frame(
    model: Model, arrays: Sequence[ArrayLike], by_robot: Wrenches | None, on_robot: Wrenches | None
) -> dict[str, Array]:
    """F_by - F_on of each named frame, frames in alphabetical order; ``arrays``: the other inputs of the call."""
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
    if total and all(getattr(a, "dtype", None) == np.float32 for a in arrays):  # lists do not promote float32 to double
        given = {**(by_robot or {}), **(on_robot or {})}
        total = {f: F if hasattr(given[f], "dtype") else F.astype(np.float32) for f, F in total.items()}
    return {frame: total[frame] for frame in sorted(total)}  # sorted: one kernel for any order of arguments
