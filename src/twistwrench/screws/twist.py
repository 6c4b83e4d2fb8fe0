"""Twists with the name of their frame. Modern Robotics section 3.3.2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, final

from ..errors import ValueRangeError
from ..lie.adjoint import ad
from ..typing import Array
from .axis import Axis, axis_of, kinds
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
        """The screw axis: direction, point, pitch, magnitude; see :func:`twistwrench.screws.axis.axis_of`."""
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
