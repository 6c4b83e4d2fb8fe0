"""Twists, wrenches and poses with the names of their frames. Modern Robotics sections 3.3.1, 3.3.2 and 3.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, final, overload

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import FrameError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import number, vector
from ...core.typing import Array
from . import se3, so3
from .adjoint import Ad, ad
from .axis import Axis, axis_of, kinds, line_of_action
from .labelled import Labelled, frame_name, hash_of, missing_pose, symbol

_MAX_ANGLE_OF_ROUNDING = 1e-12
"""Angle of a rotation up to which it is a rounding error [rad]."""


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Twist(Labelled):
    """Twist V = (omega, v) [rad/s, m/s], (..., 6), expressed in a named frame.

    ``V1 + V2`` checks the frames (:class:`~twistwrench.FrameError`), ``V @ F`` is power in W, and ``T_ab @ V_b`` is the twist
    in another frame. ``np.asarray(V)`` or ``V.values`` are the plain numbers. Accelerations (rates of twists) use the same
    class. Twists with equal frame and numbers are equal and have the same hash.

    Examples
    --------
    >>> V = Twist([0, 0, 1, 0, 0, 0], "s")
    >>> (V + 2 * V).values.tolist()
    [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]
    """

    _kind: ClassVar[str] = "twist"
    _letter: ClassVar[str] = "V"
    _names_and_units = (("omega", "rad/s"), ("v", "m/s"))

    @property
    def omega(self) -> Array:
        """Angular velocity (..., 3) [rad/s]."""
        return self.values[..., :3]

    @property
    def v(self) -> Array:
        """Velocity (..., 3) [m/s] of the body's point at the frame's origin."""
        return self.values[..., 3:]

    @property
    def axis(self) -> Axis:
        """Screw axis with direction, point, pitch and magnitude; see :func:`twistwrench.mechanics.lie.axis.axis_of`."""
        return axis_of(self.values)

    @property
    def kind(self) -> Any:
        """``"pure rotation"``, ``"pure translation"``, ``"screw motion"`` or ``"rest"``; an array of these for a batch."""
        return kinds(self.omega, self.v, ("pure rotation", "pure translation", "screw motion", "rest"))

    def bracket(self, other: Twist) -> Twist:
        """Lie bracket of twists [V1, V2] = ad(V1) V2, in the same frame (MR definition 8.5).

        Parameters
        ----------
        other : Twist, in the same frame

        Raises
        ------
        FrameError
            The frames differ.

        Examples
        --------
        >>> Twist([0, 0, 1, 0, 0, 0], "b").bracket(Twist([1, 0, 0, 0, 0, 0], "b")).values.tolist()
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
        """
        if not isinstance(other, Twist):
            raise ValueRangeError(f"the bracket is of two twists, not of a twist and a {type(other).__name__}.")
        self._require_frame_of(other, f"bracket of a twist in {self.frame!r} and a twist")
        bracket: Twist = ad(self) @ other
        return bracket


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Wrench(Labelled):
    """Wrench F = (m, f) [N m, N], (..., 6), expressed in a named frame.

    ``F1 + F2`` checks the frames (:class:`~twistwrench.FrameError`), ``F @ V`` is power in W, and ``T_ab @ F_b`` is the wrench
    in another frame. ``np.asarray(F)`` or ``F.values`` are the plain numbers. Wrenches with equal frame and numbers are equal
    and have the same hash.

    Examples
    --------
    >>> F = Wrench.of_force([0, 3, 0], "s", at=[2, 0, 0])
    >>> F.values.tolist(), F.kind
    ([0.0, 0.0, 6.0, 0.0, 3.0, 0.0], 'pure force')
    >>> bool(F.is_reciprocal_to(Twist([1, 0, 0, 0, 0, 0], "s")))
    True
    """

    _kind: ClassVar[str] = "wrench"
    _letter: ClassVar[str] = "F"
    _names_and_units = (("m", "N m"), ("f", "N"))

    @classmethod
    def of_force(cls, f: ArrayLike, frame: str, at: ArrayLike = (0.0, 0.0, 0.0)) -> Wrench:
        """Wrench (r × f, f) of a pure force at a point.

        Parameters
        ----------
        f : (..., 3) array_like, force [N]
        at : (..., 3) array_like, point of application r [m]

        Examples
        --------
        >>> Wrench.of_force([0, 0, -10], "tool0", at=[0.1, 0, 0]).m[1].item()
        1.0
        """
        checked_force = arguments.real(f, "the force f", 3)
        checked_point = arguments.real(at, "its point at", 3)
        force, point = arguments.together(f=checked_force, at=checked_point)  # of one batch shape
        return cls(np.concatenate([so3.cross(point, force), force], axis=-1), frame)

    @classmethod
    def of_couple(cls, m: ArrayLike, frame: str) -> Wrench:
        """Wrench (m, 0) of a pure couple, the same about every point.

        Parameters
        ----------
        m : (..., 3) array_like, moment [N m]

        Examples
        --------
        >>> Wrench.of_couple([0, 0, 2], "tool0").values.tolist()
        [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
        """
        couple = arguments.real(m, "the couple m", 3)
        return cls(np.concatenate([couple, np.zeros_like(couple)], axis=-1), frame)

    @property
    def m(self) -> Array:
        """Moment (..., 3) [N m] about the frame's origin."""
        return self.values[..., :3]

    @property
    def f(self) -> Array:
        """Force (..., 3) [N]."""
        return self.values[..., 3:]

    @property
    def axis(self) -> Axis:
        """Line of action, pitch and magnitude; see :func:`twistwrench.mechanics.lie.axis.line_of_action`."""
        return line_of_action(self.values)

    @property
    def kind(self) -> Any:
        """``"pure force"``, ``"pure couple"``, ``"wrench"`` or ``"nothing"``; an array of these for a batch."""
        return kinds(self.f, self.m, ("pure force", "pure couple", "wrench", "nothing"))

    def is_reciprocal_to(self, V: Twist, within: float = 1e-12) -> Any:
        """True if wrench and twist are reciprocal: the wrench has zero power on V.

        A hinge transmits exactly the wrenches that are reciprocal to its twist.

        Parameters
        ----------
        V : Twist, in the same frame
        within : float, fraction of |m| |omega| + |f| |v| up to which the power counts as zero

        Returns
        -------
        answer : bool, or array of bool for a batch

        Raises
        ------
        FrameError
            The frames differ.
        """
        power = self @ V
        max_power_of_couple = np.linalg.norm(self.m, axis=-1) * np.linalg.norm(V.omega, axis=-1)
        max_power_of_force = np.linalg.norm(self.f, axis=-1) * np.linalg.norm(V.v, axis=-1)
        return abs(power) <= arguments.number(within, "within") * (max_power_of_couple + max_power_of_force)


# ── Labelled poses: the frame names cancel in products


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Pose:
    """Pose T_ab (..., 4, 4) of the frame ``of="b"`` seen from the frame ``to="a"``; transforms from {b} to {a}.

    ``T_ab @ T_bc`` is T_ac, ``T_ab @ V_b`` a twist in {a}, ``T_ab @ F_b`` a wrench in {a}. Frames that do not cancel raise
    :class:`~twistwrench.FrameError`. A matrix that is not a pose raises :class:`~twistwrench.ValueRangeError`. Poses with equal
    frames and numbers are equal and have the same hash.

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
    """Name of {a}, the frame from which the pose is seen."""
    of: str
    """Name of {b}, the frame whose pose it is."""

    __array_ufunc__ = None  # array @ pose raises TypeError instead of dropping the labels

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.matrix.setflags(write=False)  # unpickled arrays are writable

    def __init__(self, matrix: ArrayLike, to: str, of: str) -> None:
        input_matrix: Any = matrix
        if isinstance(input_matrix, Pose):
            raise FrameError(
                f"a pose of {input_matrix.symbol}, which has names already; its numbers are {input_matrix.symbol}.matrix."
            )
        numbers = np.array(arguments.array(input_matrix, "a pose", 4, 4))
        if numbers.dtype != object:  # symbols are not checked
            arguments.pose(arguments.finite(numbers, "a pose", 4, 4), "the matrix")  # raises ValueRangeError
        numbers.setflags(write=False)
        for name, value in (("matrix", numbers), ("to", to), ("of", of)):
            object.__setattr__(self, name, value)
        frame_name(self.to, "the frame that a pose leads to")  # raises FrameError for another object than a text
        frame_name(self.of, "the frame that a pose is of")

    def __eq__(self, other: object) -> bool:
        """True if frames and numbers are equal; a single bool for a batch too."""
        if not isinstance(other, Pose):
            return NotImplemented
        have_same_frames = (self.to, self.of) == (other.to, other.of)
        return have_same_frames and np.array_equal(self.matrix, other.matrix)

    def __hash__(self) -> int:
        return hash_of(self.matrix, self.to, self.of)

    @property
    def symbol(self) -> str:
        """Letter of the book with both frames: T_ab."""
        return symbol("T", self.to, self.of)

    @property
    def rotation(self) -> Array:
        """Rotation matrix R_ab (..., 3, 3)."""
        return self.matrix[..., :3, :3]

    @property
    def position(self) -> Array:
        """Origin of {b} in {a} (..., 3) [m]."""
        return self.matrix[..., :3, 3]

    @property
    def inverse(self) -> Pose:
        """Inverse pose T_ba."""
        return _unchecked_pose(se3.inverse(self), to=self.of, of=self.to)

    def __repr__(self) -> str:
        title = f"Pose {self.symbol} of {self.of!r} seen from {self.to!r}"
        if self.matrix.ndim > 2:
            return f"{title}, batch {self.matrix.shape[:-2]}"
        text = f"{title}: at {vector(self.position)} m"
        if self.matrix.dtype == object:
            return text
        exact_rotation = so3.project(self.rotation, within=np.inf)  # without accumulated rounding errors
        rotation_vector = so3.log(exact_rotation)
        angle = float(np.linalg.norm(rotation_vector))
        if angle <= _MAX_ANGLE_OF_ROUNDING:
            return f"{text}, not turned"
        return f"{text}, turned {number(angle, 6)} rad about {vector(rotation_vector / angle)}"

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
        other_frame = other.to if isinstance(other, Pose) else other.frame
        if other_frame != self.of:
            raise FrameError(
                f"{self.symbol} @ {other.symbol}: the inner frames {self.of!r} and {other_frame!r} do not cancel; missing is "
                f"{missing_pose(self.of, other_frame)}."
            )
        if isinstance(other, Pose):
            try:
                return _unchecked_pose(self.matrix @ other.matrix, to=self.to, of=other.of)
            except ValueError:  # batches that do not fit: the following raises ShapeError
                arguments.together(**{self.symbol: self.matrix, other.symbol: other.matrix})
                raise
        result: Twist | Wrench
        if isinstance(other, Twist):
            result = Ad(self) @ other
        else:
            result = Ad(self.inverse).T @ other
        return result


def _unchecked_pose(matrix: Array, to: str, of: str) -> Pose:
    """Pose computed from checked poses; its accumulated rounding error may exceed the tolerance of new poses."""
    pose = object.__new__(Pose)
    matrix.setflags(write=False)
    for name, value in (("matrix", matrix), ("to", to), ("of", of)):
        object.__setattr__(pose, name, value)
    return pose


def move_covariance(T_ab: ArrayLike, C_b: ArrayLike) -> Array:
    """Covariance of a wrench in another frame: C_a = X C_b X' for F_a = X F_b, X = Ad(T_ba)'.

    Parameters
    ----------
    T_ab : (..., 4, 4) array_like or Pose
    C_b : (..., 6, 6) array_like, covariance of F_b, in products of the units (N m, N)

    Returns
    -------
    C_a : (..., 6, 6) array, covariance of F_a

    Examples
    --------
    >>> C_b = np.diag([0, 0, 0, 1.0, 1.0, 1.0])            # 1 N of noise in each direction
    >>> T_ab = se3.exp([0, 0, 0, 2.0, 0, 0])               # seen 2 m away
    >>> np.diag(move_covariance(T_ab, C_b)).tolist()
    [0.0, 4.0, 4.0, 1.0, 1.0, 1.0]
    """
    C = arguments.real(C_b, "the covariance of a wrench", 6, 6)
    T: Any = T_ab
    if hasattr(T, "inverse"):  # a labelled pose
        T_ba = T.inverse
    else:
        T_ba = se3.inverse(arguments.real(T, "move_covariance: T_ab", 4, 4))
    X = Ad(T_ba).T.matrix
    try:
        C_a = X @ C @ np.swapaxes(X, -1, -2)
    except ValueError:
        raise arguments.mismatch(T_ab=X, C_b=C) from None
    return np.asarray(0.5 * (C_a + np.swapaxes(C_a, -1, -2)))  # symmetric to the last bit


complete(globals())
