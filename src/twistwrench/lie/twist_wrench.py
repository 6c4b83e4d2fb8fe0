"""Twists and wrenches with the name of their frame. Modern Robotics sections 3.3.2 and 3.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ValueRangeError
from ..typing import Array
from . import se3, so3
from .adjoint import Ad, ad
from .axis import Axis, axis_of, kinds, line_of_action
from .labelled import Labelled, symbol


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Twist(Labelled):
    """A twist V = (omega, v) [rad/s, m/s], (..., 6), expressed in a named frame.

    ``V1 + V2`` checks the frames (:class:`~twistwrench.FrameError`), ``V @ F`` is power in W, ``T_ab @ V_b`` moves it,
    and ``np.asarray(V)`` or ``V.values`` are the plain numbers. A second derivative is one too. Twists of one frame and
    the same numbers are equal and have one hash.

    Examples
    --------
    >>> V = Twist([0, 0, 1, 0, 0, 0], "s")
    >>> (V + 2 * V).values.tolist()
    [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]
    """

    _kind: ClassVar[str] = "twist"
    _halves = (("omega", "rad/s"), ("v", "m/s"))

    @property
    def symbol(self) -> str:
        """The book's letter with the frame: V_b."""
        return symbol("V", self.frame)

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
        """The screw axis: direction, point, pitch, magnitude; see :func:`twistwrench.lie.axis.axis_of`."""
        return axis_of(self.values)

    @property
    def kind(self) -> Any:
        """``"pure rotation"``, ``"pure translation"``, ``"screw motion"`` or ``"rest"``; an array of these for a batch."""
        return kinds(self.omega, self.v, ("pure rotation", "pure translation", "screw motion", "rest"))

    def bracket(self, other: Twist) -> Twist:
        """Lie bracket of twists [V1, V2] = ad(V1) V2, in the same frame.

        Parameters
        ----------
        other : Twist, in the same frame

        Returns
        -------
        bracket : Twist

        Raises
        ------
        FrameError
            The frames are not the same.

        Notes
        -----
        MR definition 8.5.

        Examples
        --------
        >>> Twist([0, 0, 1, 0, 0, 0], "b").bracket(Twist([1, 0, 0, 0, 0, 0], "b")).values.tolist()
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
        """
        if not isinstance(other, Twist):
            raise ValueRangeError(f"the bracket is of two twists, not of a twist and a {type(other).__name__}.")
        self._in_frame_of(other, f"bracket of a twist in {self.frame!r} and a twist")
        bracket: Twist = ad(self) @ other
        return bracket


# ── Wrenches with the name of their frame. Modern Robotics section 3.4

if TYPE_CHECKING:
    pass


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Wrench(Labelled):
    """A wrench F = (m, f) [N m, N], (..., 6), expressed in a named frame.

    ``F1 + F2`` checks the frames (:class:`~twistwrench.FrameError`), ``F @ V`` is power in W, ``T_ab @ F_b`` moves it,
    and ``np.asarray(F)`` or ``F.values`` are the plain numbers. Wrenches of one frame and the same numbers are equal
    and have one hash.

    Examples
    --------
    >>> F = Wrench.of_force([0, 3, 0], "s", at=[2, 0, 0])
    >>> F.values.tolist(), F.kind
    ([0.0, 0.0, 6.0, 0.0, 3.0, 0.0], 'pure force')
    """

    _kind: ClassVar[str] = "wrench"
    _halves = (("m", "N m"), ("f", "N"))

    @classmethod
    def of_force(cls, f: ArrayLike, frame: str, at: ArrayLike = (0.0, 0.0, 0.0)) -> Wrench:
        """Wrench (r × f, f) of a pure force at a point.

        Parameters
        ----------
        f : (..., 3) array_like, force [N]
        frame : str, the frame it is expressed in
        at : (..., 3) array_like, the point r where it acts [m]

        Returns
        -------
        F : Wrench

        Examples
        --------
        >>> Wrench.of_force([0, 0, -10], "tool0", at=[0.1, 0, 0]).m[1].item()
        1.0
        """
        force, point = arguments.real(f, "the force f", 3), arguments.real(at, "its point at", 3)
        force, point = arguments.together(f=force, at=point)
        return cls(np.concatenate([so3.cross(point, force), force], axis=-1), frame)

    @classmethod
    def of_couple(cls, m: ArrayLike, frame: str) -> Wrench:
        """Wrench (m, 0) of a pure couple, the same about every point.

        Parameters
        ----------
        m : (..., 3) array_like, moment [N m]
        frame : str, the frame it is expressed in

        Returns
        -------
        F : Wrench

        Examples
        --------
        >>> Wrench.of_couple([0, 0, 2], "tool0").values.tolist()
        [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
        """
        couple = arguments.real(m, "the couple m", 3)
        return cls(np.concatenate([couple, np.zeros_like(couple)], axis=-1), frame)

    @property
    def symbol(self) -> str:
        """The book's letter with the frame: F_b."""
        return symbol("F", self.frame)

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
        """Line of action, pitch and size; see :func:`twistwrench.lie.axis.line_of_action`."""
        return line_of_action(self.values)

    @property
    def kind(self) -> Any:
        """``"pure force"``, ``"pure couple"``, ``"wrench"`` or ``"nothing"``; an array of these for a batch."""
        return kinds(self.f, self.m, ("pure force", "pure couple", "wrench", "nothing"))

    def is_reciprocal_to(self, V: Twist, within: float = 1e-12) -> Any:
        """True if wrench and twist are reciprocal: the wrench has zero power on V.

        Parameters
        ----------
        V : Twist, in the same frame
        within : float, part of |m| |omega| + |f| |v| that still counts as zero

        Returns
        -------
        answer : bool, or array of bool for a batch

        Raises
        ------
        FrameError
            The frames are not the same.

        Notes
        -----
        A hinge carries exactly the wrenches that are reciprocal to its twist.

        Examples
        --------
        >>> from twistwrench import Twist
        >>> bool(Wrench([0, 0, 0, 0, 0, 1], "b").is_reciprocal_to(Twist([0, 0, 1, 0, 0, 0], "b")))
        True
        """
        power = self @ V
        norm = np.linalg.norm
        size = norm(self.m, axis=-1) * norm(V.omega, axis=-1) + norm(self.f, axis=-1) * norm(V.v, axis=-1)
        return abs(power) <= arguments.number(within, "within") * size


def move_covariance(T_ab: ArrayLike, C_b: ArrayLike) -> Array:
    """Covariance of a wrench in another frame: C_a = X C_b X' with F_a = X F_b, X = Ad(T_ba)'.

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
    T_ba = (
        T_ab.inverse if hasattr(T_ab, "inverse") else se3.inverse(arguments.real(T_ab, "move_covariance: T_ab", 4, 4))
    )
    X = Ad(T_ba).T.matrix
    try:
        moved = X @ C @ np.swapaxes(X, -1, -2)
    except ValueError:
        raise arguments.mismatch(T_ab=X, C_b=C) from None
    return np.asarray(0.5 * (moved + np.swapaxes(moved, -1, -2)))
