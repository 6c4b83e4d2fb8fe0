"""Common base of labelled twists and wrenches: six components, their names, and the frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import FrameError, ShapeError, ValueRangeError
from ...core.numbers import number, vector
from ...core.typing import Array
from .adjoint import Ad, ad


def frame_name(name: object, role: str) -> str:
    """Return the name of a frame; raises FrameError unless it is a text that is not blank. ``role`` names it in the message."""
    if not isinstance(name, str) or not name.strip():
        raise FrameError(f"{role} is {name!r}; a frame's name is a text that is not blank, such as 'b' or 'tool0'.")
    return name


def symbol(letter: str, *frames: str) -> str:
    """Letter with its frames as in the book: T_ab, F_b, T_tool0_base."""
    have_short_names = all(len(frame) == 1 for frame in frames)
    separator = "" if have_short_names else "_"
    return f"{letter}_{separator.join(frames)}"


def hash_of(numbers: Array, *names: object) -> int:
    """Hash that is equal for equal names and equal numbers, regardless of their type and of the sign of zero."""
    if numbers.dtype == object:
        return hash((*names, numbers.shape, tuple(numbers.flat)))
    without_negative_zeros = numbers.astype(float) + 0.0
    return hash((*names, numbers.shape, without_negative_zeros.tobytes()))


def missing_pose(to: str, of: str) -> str:
    """Text that defines the pose of {of} in {to}, as advice in a message."""
    return f"{symbol('T', to, of)} = Pose(…, to={to!r}, of={of!r})"


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Labelled:
    """Six numbers (..., 6), angular part first, with the name of the frame in which they are expressed."""

    values: Array
    """Six numbers (..., 6), read-only."""
    frame: str
    """Name of the frame in which they are expressed."""

    __array_ufunc__ = None  # array + labelled raises TypeError instead of broadcasting
    _kind: ClassVar[str]
    """Name of the quantity: twist or wrench."""
    _letter: ClassVar[str]
    """Letter of the book, V or F."""
    _names_and_units: ClassVar[tuple[tuple[str, str], tuple[str, str]]]
    """Name and unit of the angular part, then of the linear part."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.values.setflags(write=False)  # unpickled arrays are writable

    def __init__(self, values: ArrayLike, frame: str) -> None:
        input_values: Any = values
        if isinstance(input_values, Labelled):
            raise FrameError(
                f"a {self._kind} of a {input_values._kind} in {input_values.frame!r}: its numbers are "
                f"{input_values.symbol}.values; a pose, T @ …, brings it to another frame."
            )
        name_in_messages = f"a {self._kind}, angular part first,"
        numbers = np.array(arguments.array(input_values, name_in_messages, 6))
        if numbers.dtype != object:  # symbols are not checked
            arguments.finite(numbers, name_in_messages, 6)
        numbers.setflags(write=False)
        object.__setattr__(self, "values", numbers)
        object.__setattr__(self, "frame", frame)
        frame_name(self.frame, f"the frame of a {self._kind}")  # raises FrameError

    def __eq__(self, other: object) -> bool:
        """True if kind, frame and numbers are equal; a single bool for a batch too."""
        if type(other) is not type(self):
            return NotImplemented
        return self.frame == other.frame and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return hash_of(self.values, type(self), self.frame)

    @property
    def symbol(self) -> str:
        """Letter of the book with the frame: V_b, F_b."""
        return symbol(self._letter, self.frame)

    @property
    def shape(self) -> tuple[int, ...]:
        """Batch shape: that of :attr:`values` without the last axis."""
        return self.values.shape[:-1]

    def __repr__(self) -> str:
        parts = (self.values[..., :3], self.values[..., 3:])  # angular, linear
        title = f"{type(self).__name__} in {self.frame!r}"
        texts = []
        if not self.shape:
            for (name, unit), part in zip(self._names_and_units, parts, strict=True):
                texts.append(f"{name} = {vector(part)} {unit}")
            return f"{title}: {', '.join(texts)}"
        title += f", batch {self.shape}"
        if self.values.dtype == object or not self.values.size:  # symbols, or an empty batch
            return title
        for (name, unit), part in zip(self._names_and_units, parts, strict=True):
            largest = np.linalg.norm(part, axis=-1).max()
            texts.append(f"|{name}| up to {number(largest, 6)} {unit}")
        return f"{title}: {', '.join(texts)}"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.values, dtype, copy=copy)

    def __getitem__(self, rows: Any) -> Self:
        # ``rows`` selects from an array of row numbers in the batch shape, so that it cannot index the six components.
        row_numbers = np.arange(self.values.size // 6).reshape(self.shape)
        try:
            selected_rows = row_numbers[rows]
        except IndexError as error:
            raise ShapeError(f"no row {rows!r} in a {self._kind} of batch shape {self.shape}: {error}.") from None
        return type(self)(self.values.reshape(-1, 6)[selected_rows], self.frame)

    def __iter__(self) -> Iterator[Self]:
        if not self.shape:
            raise ShapeError(f"one {self._kind} has no rows to go through; its six numbers are .values.")
        return (type(self)(row, self.frame) for row in self.values)

    def __add__(self, other: Any) -> Self:
        if not isinstance(other, Labelled) and np.ndim(other) == 0 and other == 0:  # sum() begins with 0
            return self
        own_values, other_values = self._values_of_both(other, "+")  # of one batch shape
        return type(self)(own_values + other_values, self.frame)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Self:
        own_values, other_values = self._values_of_both(other, "−")
        return type(self)(own_values - other_values, self.frame)

    def __neg__(self) -> Self:
        return type(self)(-self.values, self.frame)

    def __mul__(self, factor: ArrayLike) -> Self:
        if isinstance(factor, Labelled):
            raise ValueRangeError(f"{self._kind} * {factor._kind}: power is F @ V, and * is for numbers.")
        factor_array = arguments.array(factor, f"the factor of a {self._kind}")
        factor_column = factor_array[..., None]  # one factor for all six components
        values, factors = arguments.together(**{self._kind: self.values, "factor": factor_column})
        return type(self)(values * factors, self.frame)

    __rmul__ = __mul__

    def __truediv__(self, divisor: ArrayLike) -> Self:
        divisor_array = arguments.array(divisor, f"the divisor of a {self._kind}")
        with np.errstate(divide="ignore"):  # infinite results are rejected instead of warned about
            return self * (1.0 / divisor_array)

    def __matmul__(self, other: Labelled) -> Any:
        if not isinstance(other, Labelled) or type(other) is type(self):
            other_name = other._kind if isinstance(other, Labelled) else type(other).__name__
            raise ValueRangeError(
                f"{self._kind} @ {other_name}: power is wrench @ twist, both with their frames; the Lie bracket of two "
                "twists is V1.bracket(V2)."
            )
        self._require_frame_of(other, f"{self._kind} in {self.frame!r} @ {other._kind}")
        F, V = arguments.together(**{self._kind: self.values, other._kind: other.values})
        return np.sum(F * V, axis=-1)

    def __rmatmul__(self, operator: Any) -> Self:
        """``Ad(T_ab) @ V_b``, ``Ad(T_ab).T @ F_a``, ``ad(V_b) @ dV_b``, ``ad(V_b).T @ F_b``; both operands must be labelled."""
        if isinstance(operator, np.ndarray):
            raise FrameError(
                f"ndarray @ {self._kind} in {self.frame!r}: plain numbers name no frame; work on {self.symbol}.values."
            )
        if not isinstance(operator, Ad | ad):
            return NotImplemented
        suffix = ".T" if operator.transposed else ""
        operator_name = f"{type(operator).__name__}(…){suffix}"
        needs_transpose = self._kind == "wrench"
        if operator.transposed != needs_transpose:
            raise FrameError(
                f"{operator_name} @ {self._kind}: Ad(T) and ad(V) act on twists, their transposes .T on wrenches."
            )
        if operator.frames is None:
            raise FrameError(
                f"{operator_name} of plain numbers @ {self._kind} in {self.frame!r}: they name no frames. Make it of a Pose "
                f"or a Twist, write Pose(…) @ {self.symbol}, or work on {self.symbol}.values."
            )
        to, of = operator.frames
        if of != self.frame:
            raise FrameError(
                f"{operator_name} @ {self._kind} in {self.frame!r}: the operator takes a {self._kind} in {of!r} to {to!r}; "
                f"missing is {missing_pose(of, self.frame)}."
            )
        return type(self)(operator.apply(self.values), to)

    def _values_of_both(self, other: Any, sign: str) -> tuple[Array, ...]:
        """Values (..., 6) of this object and of another one, broadcast; raises an error unless kinds and frames are equal."""
        if not isinstance(other, Labelled):
            raise FrameError(
                f"{self._kind} in {self.frame!r} {sign} {type(other).__name__}: plain numbers name no frame; write "
                f"{type(self).__name__}(…, {self.frame!r}), or work on {self.symbol}.values."
            )
        if type(other) is not type(self):
            raise ValueRangeError(
                f"{self._kind} {sign} {other._kind}: a {self._kind} goes with another {self._kind}; the power of the "
                "two is F @ V."
            )
        self._require_frame_of(other, f"{self._kind} in {self.frame!r} {sign} {other._kind}")
        return arguments.together(first=self.values, second=other.values)

    def _require_frame_of(self, other: Labelled, operation: str) -> None:
        """Raise FrameError unless both objects have one frame; ``operation`` begins the message."""
        if other.frame != self.frame:
            raise FrameError(
                f"{operation} in {other.frame!r}: move one first, {symbol('T', other.frame, self.frame)} @ {self.symbol} with "
                f"Pose(…, to={other.frame!r}, of={self.frame!r})."
            )


# ── Names of the six components of twists and wrenches, angular part first

TWIST = ("wx", "wy", "wz", "vx", "vy", "vz")
"""Angular and linear velocity."""
WRENCH = ("mx", "my", "mz", "fx", "fy", "fz")
"""Moment and force."""
