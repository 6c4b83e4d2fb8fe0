"""Poses with the names of both frames, which cancel in products. Modern Robotics sections 3.3.1 and 3.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final, overload

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.numbers import number, vector
from ..errors import FrameError
from ..typing import Array
from . import se3, so3
from .adjoint import Ad
from .labelled import frame_name, hash_of, missing_pose, symbol
from .twist_wrench import Twist, Wrench


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Pose:
    """The pose T_ab (..., 4, 4) of the frame ``of="b"`` seen from the frame ``to="a"``: it brings things of {b} to {a}.

    ``T_ab @ T_bc`` is T_ac, ``T_ab @ V_b`` a twist in {a}, ``T_ab @ F_b`` a wrench in {a}; letters that do not cancel
    are a :class:`~twistwrench.FrameError`. A matrix that is not a pose raises :class:`~twistwrench.ValueRangeError`. Poses
    of the same frames and numbers are equal and have one hash.

    Examples
    --------
    >>> T_ab = Pose(se3.exp([0, 0, 0, 2, 0, 0]), to="a", of="b")
    >>> T_ab @ Wrench([0, 0, 0, 0, 3, 0], "b")
    Wrench in 'a': m = (0, 0, 6) N m, f = (0, 3, 0) N
    >>> T_ab
    Pose T_ab of 'b' seen from 'a': at (2, 0, 0) m, not turned
    """

    matrix: Array
    """Homogeneous transforms T_ab (..., 4, 4), read-only."""
    to: str
    """Name of {a}, the frame the pose is seen from."""
    of: str
    """Name of {b}, the frame whose pose it is."""

    __array_ufunc__ = None  # array @ pose is refused rather than done without labels

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.matrix.setflags(write=False)  # arrays come out of a pickle writable

    def __init__(self, matrix: ArrayLike, to: str, of: str) -> None:
        given: Any = matrix
        if isinstance(given, Pose):
            raise FrameError(
                f"a pose of {given.symbol}, which has names already; its numbers are {given.symbol}.matrix."
            )
        numbers = np.array(arguments.array(given, "a pose", 4, 4))
        if numbers.dtype != object:  # symbols are taken as they are
            arguments.pose(arguments.finite(numbers, "a pose", 4, 4), "the matrix")
        numbers.setflags(write=False)
        for name, value in (("matrix", numbers), ("to", to), ("of", of)):
            object.__setattr__(self, name, value)
        frame_name(self.to, "the frame that a pose leads to")
        frame_name(self.of, "the frame that a pose is of")

    def __eq__(self, other: object) -> bool:
        """True if the other has the same two frames and the same numbers; one bool for a batch too."""
        if not isinstance(other, Pose):
            return NotImplemented
        return (self.to, self.of) == (other.to, other.of) and np.array_equal(self.matrix, other.matrix)

    def __hash__(self) -> int:
        return hash_of(self.matrix, self.to, self.of)

    @property
    def symbol(self) -> str:
        """The book's letter with both frames: T_ab."""
        return symbol("T", self.to, self.of)

    @property
    def rotation(self) -> Array:
        """Rotation matrix R_ab (..., 3, 3)."""
        return self.matrix[..., :3, :3]

    @property
    def position(self) -> Array:
        """The origin of {b} in {a} (..., 3) [m]."""
        return self.matrix[..., :3, 3]

    @property
    def inverse(self) -> Pose:
        """Inverse pose T_ba."""
        return _follows(se3.inverse(self), to=self.of, of=self.to)

    def __repr__(self) -> str:
        what = f"Pose {self.symbol} of {self.of!r} seen from {self.to!r}"
        if self.matrix.ndim > 2:
            return f"{what}, batch {self.matrix.shape[:-2]}"
        place = f"{what}: at {vector(self.position)} m"
        if self.matrix.dtype == object:
            return place
        turn = so3.log(so3.project(self.rotation, within=np.inf))  # rounding that adds up in products is still printed
        angle = float(np.linalg.norm(turn))
        return f"{place}, " + (
            f"turned {number(angle, 6)} rad about {vector(turn / angle)}" if angle > 1e-12 else "not turned"
        )

    def __rmatmul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            raise FrameError(f"ndarray @ {self.symbol}: plain numbers name no frames; work on {self.symbol}.matrix.")
        return NotImplemented

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.matrix, dtype, copy=copy)

    @overload
    def __matmul__(self, other: Pose) -> Pose: ...
    @overload
    def __matmul__(self, other: Twist) -> Twist: ...
    @overload
    def __matmul__(self, other: Wrench) -> Wrench: ...

    def __matmul__(self, other: Pose | Twist | Wrench) -> Pose | Twist | Wrench:
        if not isinstance(other, (Pose, Twist, Wrench)):
            raise FrameError(
                f"{self.symbol} @ {type(other).__name__}: plain numbers name no frame; write Twist(…, {self.of!r}) or "
                f"Wrench(…, {self.of!r}), or use Ad(T) @ V and Ad(T).T @ F on arrays."
            )
        inner = other.to if isinstance(other, Pose) else other.frame
        if inner != self.of:
            raise FrameError(
                f"{self.symbol} @ {other.symbol}: the inner frames {self.of!r} and {inner!r} do not cancel; missing is "
                f"{missing_pose(self.of, inner)}."
            )
        if isinstance(other, Pose):
            try:
                return _follows(self.matrix @ other.matrix, to=self.to, of=other.of)
            except ValueError:
                arguments.together(**{self.symbol: self.matrix, other.symbol: other.matrix})
                raise
        moved: Twist | Wrench = Ad(self) @ other if isinstance(other, Twist) else Ad(self.inverse).T @ other
        return moved


def _follows(matrix: Array, to: str, of: str) -> Pose:
    """Pose computed from checked ones, whose rounding may exceed the tolerance of a new one."""
    pose = object.__new__(Pose)
    matrix.setflags(write=False)
    for name, value in (("matrix", matrix), ("to", to), ("of", of)):
        object.__setattr__(pose, name, value)
    return pose
