"""Time scalings s(t) between states of rest, and pose paths for them. Modern Robotics section 9.2."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ShapeError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import printed
from ...core.typing import Array
from ..lie import se3, so3

_CUBIC = (0.0, 0.0, 3.0, -2.0)
_QUINTIC = (0.0, 0.0, 0.0, 10.0, -15.0, 6.0)
_UNIFORM = (0.0, 1.0)


@dataclass(frozen=True)
class Polynomial:
    """Polynomial time scaling s(t) in t / T; see :func:`cubic`, :func:`quintic` and :func:`uniform`."""

    name: str
    """Name of the shape."""
    duration: float
    """T [s]."""
    coefficients: tuple[float, ...]
    """Coefficients of 1, x, x², … with x = t / T."""

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Constant before 0 and after T."""
        t = arguments.real(t, "t")
        x = np.clip(t / self.duration, 0.0, 1.0)
        moving = (t >= 0) & (t <= self.duration) | np.isnan(t)
        rates = derivative_coefficients(self.coefficients)
        s, ds, dds = (horner(c, x) for c in (self.coefficients, rates, derivative_coefficients(rates)))
        return s, np.where(moving, ds / self.duration, 0.0), np.where(moving, dds / self.duration**2, 0.0)

    def third(self, t: ArrayLike) -> Array:
        """d³s/dt³ at t [s]; zero before 0 and after T.

        Parameters
        ----------
        t : (...) array_like [s]

        Returns
        -------
        third : (...) array [1/s³]

        Examples
        --------
        >>> round(float(quintic(1.0).third(0.1)), 9)
        27.6
        """
        t = arguments.real(t, "t")
        p = horner(
            derivative_coefficients(derivative_coefficients(derivative_coefficients(self.coefficients))),
            np.clip(t / self.duration, 0.0, 1.0),
        )
        return np.where((t >= 0) & (t <= self.duration) | np.isnan(t), p / self.duration**3, 0.0)

    def stretched(self, duration: float) -> Polynomial:
        """The same shape over another duration.

        Examples
        --------
        >>> quintic(2.0).stretched(4.0).duration
        4.0
        """
        return Polynomial(self.name, _positive(duration, "duration"), self.coefficients)


def horner(coefficients: tuple[float, ...], x: Array) -> Array:
    """Polynomial with coefficients of 1, x, x², … at x (...)."""
    p = np.zeros_like(x)
    for c in reversed(coefficients):
        p = p * x + c
    return np.asarray(p)


def derivative_coefficients(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Coefficients of the polynomial's derivative."""
    return tuple(k * c for k, c in enumerate(coefficients))[1:]


def cubic_share(x: Any) -> Any:
    """3 x² - 2 x³ with x = t/T; a number or an array. MR eq. 9.10."""
    return x * x * (3.0 - 2.0 * x)


def quintic_share(x: Any) -> Any:
    """10 x³ - 15 x⁴ + 6 x⁵ with x = t/T; a number or an array. MR section 9.2.1."""
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


def cubic(duration: float) -> Polynomial:
    """Cubic time scaling s = 3 (t/T)² - 2 (t/T)³: velocities are zero at both ends (MR eq. 9.10).

    Examples
    --------
    >>> s, ds, dds = cubic(2.0)(0.6)
    >>> round(float(s), 12), round(float(ds), 12), round(float(dds), 12)
    (0.216, 0.63, 0.6)
    """
    return Polynomial("cubic", _positive(duration, "duration"), _CUBIC)


def quintic(duration: float) -> Polynomial:
    """Quintic time scaling s = 10 (t/T)³ - 15 (t/T)⁴ + 6 (t/T)⁵: velocities and accelerations are zero at both ends.

    MR section 9.2.2.1.

    Examples
    --------
    >>> s, ds, dds = quintic(2.0)(1.0)
    >>> float(s), float(ds), float(dds)
    (0.5, 0.9375, 0.0)
    """
    return Polynomial("quintic", _positive(duration, "duration"), _QUINTIC)


def uniform(duration: float) -> Polynomial:
    """Uniform time scaling s = t/T.

    For paths with time as their parameter, such as splines through waypoints at given times.

    Examples
    --------
    >>> [float(x) for x in uniform(2.0)(0.5)]
    [0.25, 0.5, 0.0]
    """
    return Polynomial("uniform", _positive(duration, "duration"), _UNIFORM)


@dataclass(frozen=True)
class Trapezoid:
    """Trapezoidal time scaling s(t): accelerates at ``a``, coasts at ``v``, and decelerates at ``a``.

    Made by :func:`trapezoid`.
    """

    v: float
    """Coasting rate [1/s]; the peak rate if there is no coasting."""
    a: float
    """Acceleration [1/s²]."""
    name: str = "trapezoidal"
    """Name of the shape."""

    @property
    def ramp(self) -> float:
        """Duration of acceleration and of deceleration [s]."""
        return self.v / self.a

    @property
    def duration(self) -> float:
        """T = 1/v + v/a [s]. MR eq. 9.17."""
        return 1.0 / self.v + self.ramp

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Constant before 0 and after T."""
        t = arguments.real(t, "t")
        T, ta, v, a = self.duration, self.ramp, self.v, self.a
        up, down = np.clip(t, 0.0, ta), np.clip(T - t, 0.0, ta)
        coast = np.clip(t - ta, 0.0, max(T - 2 * ta, 0.0))
        s = np.where(t < T - ta, 0.5 * a * up * up + v * coast, 1.0 - 0.5 * a * down * down)
        ds = np.minimum(a * np.minimum(up, down), v)
        dds = np.where((t >= 0) & (t < ta), a, 0.0) - np.where((t > T - ta) & (t <= T), a, 0.0)
        unknown = np.where(np.isnan(t), np.nan, 0.0)
        return s + unknown, ds + unknown, dds + unknown

    def stretched(self, duration: float) -> Trapezoid:
        """The same shape over another duration.

        Examples
        --------
        >>> trapezoid(v=1.0, a=2.0).stretched(3.0).v
        0.5
        """
        slower = self.duration / _positive(duration, "duration")
        return Trapezoid(self.v * slower, self.a * slower**2)


def trapezoid(*, v: float | None = None, a: float | None = None, duration: float | None = None) -> Trapezoid:
    """Trapezoidal time scaling from two of the three: rate, acceleration, duration (MR section 9.2.2.2).

    With v and a: if v² > a, the scaling has no coasting, and its peak rate √a is below v. With v and duration T,
    1 < v T ≤ 2 is required; with a and T, a T² ≥ 4.

    Parameters
    ----------
    v : float, optional, rate of coasting [1/s]
    a : float, optional, acceleration [1/s²]
    duration : float, optional, T [s]

    Examples
    --------
    >>> round(trapezoid(v=1.0, a=2.0).duration, 12), trapezoid(v=1.5, duration=1.0).a, trapezoid(a=4.0, duration=1.0).v
    (1.5, 4.5, 2.0)
    """
    options = {"v": v, "a": a, "duration": duration}
    numbers = {name: _positive(x, name) for name, x in options.items() if x is not None}
    if len(numbers) != 2:
        raise ValueRangeError(
            f"give exactly two of v, a and duration, which determine the third; got {', '.join(numbers) or 'none'}."
        )
    if "duration" not in numbers:
        v, a = numbers["v"], numbers["a"]
        return Trapezoid(min(v, float(np.sqrt(a))), a)  # v² > a: bang-bang, whose peak is √a
    T = numbers["duration"]
    if "v" in numbers:
        v = numbers["v"]
        if not 1.0 < v * T <= 2.0 * (1 + 1e-12):
            raise ValueRangeError(
                f"v = {printed(v)} over T = {printed(T)} does not allow a trapezoid: 1 < v T ≤ 2 is needed, so "
                f"v above {printed(1 / T)} and up to {printed(2 / T)}."
            )
        return Trapezoid(v, max(v * v / (v * T - 1.0), v * v))  # MR eq. 9.18
    a = numbers["a"]
    if a * T * T < 4.0 * (1 - 1e-12):
        raise ValueRangeError(
            f"a = {printed(a)} over T = {printed(T)} is too slow: a T² ≥ 4 is needed, so a from {printed(4 / T**2)} or "
            f"T from {printed(2 / a**0.5)}."
        )
    return Trapezoid(0.5 * (a * T - float(np.sqrt(max(a * (a * T * T - 4.0), 0.0)))), a)  # MR eq. 9.19


@dataclass(frozen=True, eq=False)
class Averaged:
    """Time scaling, averaged over two time windows in turn; its derivatives up to the third are exact.

    The rate of the original scaling is piecewise linear in time. Uniform motion becomes a double S (:func:`s_curve`), and a
    motion with acceleration jumps becomes one of bounded jerk on the same path.
    """

    places: Array
    """(n,) knots s from 0 to 1, increasing."""
    rates: Array
    """(n,) ds/dt at the knots before averaging [1/s]."""
    windows: tuple[float, float]
    """Lengths of the two averaging windows [s]."""
    name: str
    """Name of the shape."""

    @cached_property
    def _second_integral(self) -> tuple[Any, Array]:
        """Second integral of the scaling before averaging, extended beyond both ends, and the times of its knots."""
        from scipy.interpolate import PPoly

        steps = 2.0 * np.diff(self.places) / (self.rates[1:] + self.rates[:-1])
        t = np.concatenate([[0.0], np.cumsum(steps)])
        pieces = np.stack([0.5 * np.diff(self.rates) / steps, self.rates[:-1], self.places[:-1]])
        constant = np.array([[0.0], [0.0], [1.0]])
        margin = sum(self.windows)
        ends = np.concatenate([[-margin - 1.0], t, [t[-1] + margin + 1.0]])
        return PPoly(np.concatenate([0.0 * constant, pieces, constant], axis=1), ends).antiderivative(2), t

    @cached_property
    def duration(self) -> float:
        """T [s]."""
        return float(self._second_integral[1][-1]) + sum(self.windows)

    @cached_property
    def knots(self) -> Array:
        """Times between which the third derivative is linear [s]."""
        t, (a, b) = self._second_integral[1], self.windows
        return np.unique(np.concatenate([t, t + a, t + b, t + (a + b)]))

    def _derivative(self, t: Array, order: int) -> Array:
        """Derivative of s at t (...)."""
        curve, (a, b) = self._second_integral[0], self.windows
        t = np.clip(t, 0.0, self.duration)
        return np.asarray(
            (curve(t, order) - curve(t - a, order) - curve(t - b, order) + curve(t - (a + b), order)) / (a * b)
        )

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Constant before 0 and after T."""
        t = arguments.real(t, "t")
        before, after = t <= 0, t >= self.duration
        s, ds, dds = (self._derivative(t, order) for order in range(3))
        s = np.where(after, 1.0, np.where(before, 0.0, np.clip(s, 0.0, 1.0)))
        return s, np.where(before | after, 0.0, ds), np.where(before | after, 0.0, dds)

    def third(self, t: ArrayLike) -> Array:
        """d³s/dt³ at t [s]; zero before 0 and after T.

        Parameters
        ----------
        t : (...) array_like [s]

        Returns
        -------
        third : (...) array [1/s³]

        Examples
        --------
        >>> round(float(s_curve(1.0).third(0.1)), 9)
        60.75
        """
        t = arguments.real(t, "t")
        return np.where((t < 0) | (t > self.duration), 0.0, self._derivative(t, 3))

    def stretched(self, duration: float) -> Averaged:
        """The same shape over another duration.

        Examples
        --------
        >>> [round(window, 12) for window in s_curve(1.0).stretched(3.0).windows]
        [0.666666666667, 0.333333333333]
        """
        k = _positive(duration, "duration") / self.duration
        return replace(self, rates=self.rates / k, windows=(self.windows[0] * k, self.windows[1] * k))


def s_curve(duration: float, *, alpha: float = 1 / 3, beta: float = 1 / 3) -> Averaged:
    """Double-S time scaling: a trapezoidal rate whose accelerations rise and fall at constant jerk.

    Source: Biagiotti & Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.4. The rate peaks
    at v = 1/((1 - α) T), the acceleration at v/(α (1 - β) T), the jerk at v/(α² β (1 - β) T²).

    Parameters
    ----------
    alpha : float, acceleration time T_a/T, equal to the deceleration time; above 0, at most 1/2
    beta : float, time T_j/T_a in which the acceleration rises, equal to that in which it falls; above 0, at most 1/2

    Examples
    --------
    >>> s, ds, dds = s_curve(1.0)(0.5)
    >>> round(float(s), 12), round(float(ds), 12), round(float(s_curve(1.0).third(0.01)), 9)
    (0.5, 1.5, 60.75)
    """
    T = _positive(duration, "duration")
    shares = {"alpha": arguments.number(alpha, "alpha"), "beta": arguments.number(beta, "beta")}
    for name, x in shares.items():
        if not 0 < x <= 0.5:
            raise ValueRangeError(f"{name} is {printed(x)}: give a share of the time above 0 and at most 0.5.")
    ramp, rate = shares["alpha"] * T, 1.0 / ((1.0 - shares["alpha"]) * T)
    windows = (ramp * (1.0 - shares["beta"]), ramp * shares["beta"])
    return Averaged(np.array([0.0, 1.0]), np.array([rate, rate]), windows, "s-curve")


def _positive(x: Any, name: str) -> float:
    value = arguments.number(x, name)
    if not 0 < value < np.inf:
        raise ValueRangeError(f"{name} is {printed(value)}: a motion takes a finite {name} above zero.")
    return value


# ── Pose paths: constant screw, and straight line of the origin. Modern Robotics section 9.2.1


@dataclass(frozen=True, eq=False)
class PosePath:
    """Path of poses T(s), s = 0 to 1: a constant screw, or the origin on a line with rotation about a constant axis."""

    start: Array
    """Pose at s = 0 (4, 4)."""
    end: Array
    """Pose at s = 1 (4, 4)."""
    straight: bool
    """True if the origin moves on a straight line."""
    twist: Array
    """(6,) body twist dT/ds = T [V] of the screw; for a straight path, omega in the frame and v in base axes."""

    def __call__(self, s: ArrayLike) -> Array:
        """T(s); (...) → (..., 4, 4).

        A straight path is R(s) = R0 exp(log(R0' R1) s), p(s) = p0 + s (p1 - p0), MR eq. 9.24 and 9.25; a screw
        T(s) = T0 exp(log(T0⁻¹ T1) s), MR eq. 9.23.
        """
        s = arguments.real(s, "s")[..., None]
        if not self.straight:
            return np.asarray(self.start @ se3.exp(s * self.twist))
        R = self.start[:3, :3] @ so3.exp(s * self.twist[:3])
        return se3.pose(R, s * self.end[:3, 3] + (1.0 - s) * self.start[:3, 3])

    def body_twist(self, s: ArrayLike) -> Array:
        """Body twist along the path, V(s) with dT/ds = T [V].

        Parameters
        ----------
        s : (...) array_like, 0 to 1

        Returns
        -------
        V : (..., 6) array, (omega, v) [rad, m]

        Examples
        --------
        >>> screw_path(np.eye(4), se3.exp([0, 0, 1, 2, 0, 0])).body_twist(0.5).round(12).tolist()
        [0.0, 0.0, 1.0, 2.0, 0.0, 0.0]
        """
        s = arguments.real(s, "s")
        if not self.straight:
            return np.broadcast_to(self.twist, (*s.shape, 6)).copy()
        R = self(s)[..., :3, :3]
        v = (np.swapaxes(R, -1, -2) @ self.twist[3:, None])[..., 0]
        return np.concatenate([np.broadcast_to(self.twist[:3], v.shape), v], axis=-1)


def screw_path(start: ArrayLike, end: ArrayLike) -> PosePath:
    """Screw path: the constant screw from one pose to another (MR eq. 9.23).

    Examples
    --------
    >>> path = screw_path(np.eye(4), se3.exp([0, 0, np.pi / 2, 1, 0, 0]))
    >>> path(0.5)[:3, 3].round(6).tolist()
    [0.450158, 0.186462, 0.0]
    """
    start, end = _poses(start, end)
    return PosePath(start, end, False, se3.log(se3.inverse(start) @ end))


def straight_path(start: ArrayLike, end: ArrayLike) -> PosePath:
    """Straight path: the origin on a line, with an independent rotation about a constant axis (MR eq. 9.24, 9.25).

    Examples
    --------
    >>> path = straight_path(np.eye(4), se3.exp([0, 0, np.pi / 2, 1, 0, 0]))
    >>> path(0.5)[:3, 3].round(6).tolist()
    [0.31831, 0.31831, 0.0]
    """
    start, end = _poses(start, end)
    w = so3.log(start[:3, :3].T @ end[:3, :3])
    return PosePath(start, end, True, np.concatenate([w, end[:3, 3] - start[:3, 3]]))


def _poses(start: ArrayLike, end: ArrayLike) -> tuple[Array, Array]:
    poses = []
    for name, T in (("start", start), ("end", end)):
        M = np.asarray(arguments.pose(arguments.finite(T, name, 4, 4), name), float)
        if M.shape != (4, 4):
            raise ShapeError(f"{name} has shape {M.shape}: a path leads from one pose (4, 4) to another.")
        poses.append(M)
    return poses[0], poses[1]


complete(globals())
