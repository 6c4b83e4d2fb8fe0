"""The adjoint operators Ad(T) and ad(V): the book's 6×6 matrices, applied by their 3×3 blocks.

``Ad(T) @ V`` takes two rotations and a cross product, not a 6×6 product. ``.T`` is the transpose, which acts on wrenches.
``.matrix`` (or ``np.asarray``) is the matrix of the book. Operators act along the last axis, and batches broadcast:
``Ad(T) @ V`` takes T (..., 4, 4) and V (..., 6). With a matrix G, write ``ad(V).T @ (G @ V)``: Python evaluates
``ad(V).T @ G @ V`` from the left, and an operator takes the rows of G as vectors. Elements may be numbers or symbols. An
operator made from a labelled pose or twist keeps the frame names, and labelled twists and wrenches check them.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import FrameError, ShapeError, ShapeWarning
from ...core.typing import Array
from .so3 import cross


def _rotate(R: Array, x: Array) -> Array:
    """R x for each vector; (..., 3, 3), (..., 3) → (..., 3)."""
    return (R @ x[..., None])[..., 0]


class _Operator(ABC):
    """Common part of both adjoint operators: application along the last axis, and the full matrix."""

    __array_ufunc__ = None  # ndarray @ operator raises TypeError instead of broadcasting

    transposed: bool
    """True for the transpose, which acts on wrenches."""
    frames: tuple[str, str] | None
    """Frames of the result and of the argument; None if the pose or the twist has no labels."""

    @abstractmethod
    def _apply(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Halves (..., 3) of the images of vectors (..., 6), from the vectors' halves a and b."""

    @property
    @abstractmethod
    def _batch(self) -> tuple[int, ...]:
        """Batch shape of the pose or the twist."""

    def __matmul__(self, x: Any) -> Any:
        if hasattr(x, "frame"):
            return NotImplemented  # __rmatmul__ of the labelled vector checks frames
        if hasattr(x, "moment_about_origin"):  # a spatial inertia
            raise ShapeError(f"{self._name} @ G: it acts on twists and wrenches. Write {self._name} @ (G @ V).")
        if hasattr(x, "shape") and len(x.shape) == 2 and x.shape[0] == 6:
            self._check_rows(x.shape[1])
        return self.apply(x)

    def __rmatmul__(self, x: Any) -> NoReturn:
        raise ShapeError(f"x @ {self._name}: it acts on what stands to its right. Write x @ {self._name}.matrix.")

    @property
    def _name(self) -> str:
        """Name of the operator in messages: ``Ad(…)`` or ``Ad(…).T``."""
        name = f"{type(self).__name__}(…)"
        if self.transposed:
            name += ".T"
        return name

    def _check_rows(self, columns: int) -> None:
        """Refuse a matrix (6, n), such as a Jacobian; warn of a matrix (6, 6), since its rows are taken as vectors."""
        remedy = f"For the product of two matrices, write {self._name}.matrix @ x"
        if columns != 6:
            raise ShapeError(f"{self._name} @ x: x has shape (6, {columns}), expected vectors (..., 6). {remedy}.")
        if self._batch == ():
            warnings.warn(
                f"{self._name} @ x takes the rows of x, of shape (6, 6), as six vectors. {remedy}; for A @ G @ V, write "
                f"A @ (G @ V). If six vectors are meant, write {self._name}.apply(x).",
                ShapeWarning,
                stacklevel=3,
            )

    def apply(self, x: ArrayLike) -> Array:
        """Image of each vector along the last axis. ``@`` returns the same images, with a warning for arrays (6, 6).

        Parameters
        ----------
        x : (..., 6) array_like, twists, or wrenches for a transpose

        Returns
        -------
        images : (..., 6) array

        Examples
        --------
        >>> ad([0, 0, 1, 0, 0, 0]).apply(np.eye(6))[0].tolist()
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
        """
        x = arguments.array(x, f"{type(self).__name__}(…) @ x: x", 6)
        try:
            return np.concatenate(self._apply(x[..., :3], x[..., 3:]), axis=-1)
        except ValueError:  # batches that do not fit
            batches = {type(self).__name__: np.empty((*self._batch, 1)), "x": x[..., :1]}
            arguments.together(**batches)  # raises ShapeError
            raise

    @property
    def T(self) -> Self:
        """Transpose, which acts on wrenches."""
        transpose = object.__new__(type(self))
        transpose.__dict__.update(self.__dict__)
        transpose.transposed = not self.transposed
        if self.frames is not None:
            transpose.frames = self.frames[::-1]
        return transpose

    def __repr__(self) -> str:
        frames = ""
        if self.frames is not None:
            to, of = self.frames
            frames = f" from {of!r} to {to!r}"
        batch = f", batch {self._batch}" if self._batch else ""
        operands = "wrenches" if self.transposed else "twists"
        return f"<{self._name} on {operands}{frames}{batch}>"

    @property
    def matrix(self) -> Array:
        """Matrix of the operator (..., 6, 6); its columns are the images of the unit vectors."""
        images = [self @ np.broadcast_to(unit_vector, (*self._batch, 6)) for unit_vector in np.eye(6)]
        return np.stack(images, axis=-1)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.asarray(self.matrix, dtype)


class Ad(_Operator):
    """Adjoint of a pose, an operator on twists and wrenches: ``Ad(T_ab) @ V_b = V_a``, ``Ad(T_ab).T @ F_a = F_b``.

    MR eq. 3.83, 3.98.

    Parameters
    ----------
    T : (..., 4, 4) array_like or Pose, T_ab

    Raises
    ------
    ValueRangeError
        ``T`` is not a pose; the message gives the gap.

    Examples
    --------
    >>> import numpy as np
    >>> T = np.eye(4); T[:3, 3] = [1, 0, 0]
    >>> (Ad(T) @ [0, 0, 1, 0, 0, 0]).tolist()
    [0.0, 0.0, 1.0, 0.0, -1.0, 0.0]
    """

    def __init__(self, T: ArrayLike) -> None:
        self._pose = arguments.pose(T, "Ad: T")
        self.transposed = False
        self.inverted = False
        self.frames = None
        if hasattr(T, "to") and hasattr(T, "of"):  # a labelled pose
            self.frames = (T.to, T.of)

    @property
    def inverse(self) -> Self:
        """Ad(T⁻¹) without inverting T: ``Ad(T_ab).inverse @ V_a`` is V_b, ``Ad(T_ab).inverse.T @ F_b`` is F_a."""
        inverse = self.T  # like the inverse, the transpose exchanges the frames
        inverse.transposed = self.transposed
        inverse.inverted = not self.inverted
        return inverse

    @property
    def _batch(self) -> tuple[int, ...]:
        return self._pose.shape[:-2]

    def _apply(self, a: Array, b: Array) -> tuple[Array, Array]:
        R, p = self._pose[..., :3, :3], self._pose[..., :3, 3]
        Rt = np.swapaxes(R, -1, -2)
        # Blocks of the 6×6 matrix; [p]' = -[p].
        if self.inverted and self.transposed:  # [R, [p] R; 0, R]
            f = _rotate(R, b)
            return _rotate(R, a) + cross(p, f), f
        if self.inverted:  # [R', 0; R' [p]', R']
            return _rotate(Rt, a), _rotate(Rt, b - cross(p, a))
        if self.transposed:  # [R', R' [p]'; 0, R']
            return _rotate(Rt, a - cross(p, b)), _rotate(Rt, b)
        w = _rotate(R, a)  # [R, 0; [p] R, R]
        return w, _rotate(R, b) + cross(p, w)


class ad(_Operator):
    """Lie bracket with a twist (small adjoint): ``ad(V1) @ V2 = [V1, V2]``; its transpose acts on wrenches.

    MR section 8.2.2.

    Parameters
    ----------
    V : (..., 6) array_like or Twist, (omega, v)

    Examples
    --------
    >>> (ad([0, 0, 1, 0, 0, 0]) @ [1, 0, 0, 0, 0, 0]).tolist()
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    """

    def __init__(self, V: ArrayLike) -> None:
        if getattr(V, "_kind", "twist") != "twist":
            raise FrameError("ad: V is a wrench, and ad(V) is of a twist.")
        self._twist = arguments.array(V, "ad: V", 6)
        self.transposed = False
        self.frames = (V.frame, V.frame) if hasattr(V, "frame") else None

    @property
    def _batch(self) -> tuple[int, ...]:
        return self._twist.shape[:-1]

    def _apply(self, a: Array, b: Array) -> tuple[Array, Array]:
        w, v = self._twist[..., :3], self._twist[..., 3:]
        if self.transposed:  # [-[w], -[v]; 0, -[w]]
            return -(cross(w, a) + cross(v, b)), -cross(w, b)
        return cross(w, a), cross(v, a) + cross(w, b)  # [[w], 0; [v], [w]]
