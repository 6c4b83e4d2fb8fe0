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

# Coefficients of 1, x, x², … with x = t / T
_CUBIC_COEFFICIENTS = (0.0, 0.0, 3.0, -2.0)
_QUINTIC_COEFFICIENTS = (0.0, 0.0, 0.0, 10.0, -15.0, 6.0)
_UNIFORM_COEFFICIENTS = (0.0, 1.0)
_ROUNDING = 1e-12
"""Relative rounding error of arguments at a bound."""


@dataclass(frozen=True)
class Polynomial:
    """Polynomial time scaling s(t) in t / T; see :func:`cubic`, :func:`quintic` and :func:`uniform`."""

    name: str
    """Name of the shape."""
    duration: float
    """Duration T [s]."""
    coefficients: tuple[float, ...]
    """Coefficients of 1, x, x², … with x = t / T."""

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Constant before 0 and after T."""
        t = arguments.real(t, "t")
        x = np.clip(t / self.duration, 0.0, 1.0)
        is_moving = self._is_moving(t)
        first_derivative = derivative_coefficients(self.coefficients)
        second_derivative = derivative_coefficients(first_derivative)
        s = horner(self.coefficients, x)
        ds = np.where(is_moving, horner(first_derivative, x) / self.duration, 0.0)
        dds = np.where(is_moving, horner(second_derivative, x) / self.duration**2, 0.0)
        return s, ds, dds

    def _is_moving(self, t: Array) -> Array:
        """True from 0 to T, and for NaN, so that derivatives there are NaN."""
        return np.asarray((t >= 0) & (t <= self.duration) | np.isnan(t))

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
        x = np.clip(t / self.duration, 0.0, 1.0)
        coefficients = self.coefficients
        for _ in range(3):
            coefficients = derivative_coefficients(coefficients)
        third_by_x = horner(coefficients, x)
        return np.where(self._is_moving(t), third_by_x / self.duration**3, 0.0)

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
    total = np.zeros_like(x)
    for coefficient in reversed(coefficients):
        total = total * x + coefficient
    return np.asarray(total)


def derivative_coefficients(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Coefficients of the polynomial's derivative."""
    multiplied = [power * coefficient for power, coefficient in enumerate(coefficients)]
    return tuple(multiplied[1:])  # without the constant term, whose derivative is 0


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
    return Polynomial("cubic", _positive(duration, "duration"), _CUBIC_COEFFICIENTS)


def quintic(duration: float) -> Polynomial:
    """Quintic time scaling s = 10 (t/T)³ - 15 (t/T)⁴ + 6 (t/T)⁵: velocities and accelerations are zero at both ends.

    MR section 9.2.2.1.

    Examples
    --------
    >>> s, ds, dds = quintic(2.0)(1.0)
    >>> float(s), float(ds), float(dds)
    (0.5, 0.9375, 0.0)
    """
    return Polynomial("quintic", _positive(duration, "duration"), _QUINTIC_COEFFICIENTS)


def uniform(duration: float) -> Polynomial:
    """Uniform time scaling s = t/T.

    For paths with time as their parameter, such as splines through waypoints at given times.

    Examples
    --------
    >>> [float(x) for x in uniform(2.0)(0.5)]
    [0.25, 0.5, 0.0]
    """
    return Polynomial("uniform", _positive(duration, "duration"), _UNIFORM_COEFFICIENTS)


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
        T, v, a = self.duration, self.v, self.a
        t_a = self.ramp
        t_up = np.clip(t, 0.0, t_a)  # time since the start, up to t_a
        t_down = np.clip(T - t, 0.0, t_a)  # time until the end, up to t_a
        t_coast = np.clip(t - t_a, 0.0, max(T - 2 * t_a, 0.0))  # time of coasting up to t
        s_before_ramp_down = 0.5 * a * t_up * t_up + v * t_coast
        s_after = 1.0 - 0.5 * a * t_down * t_down
        s = np.where(t < T - t_a, s_before_ramp_down, s_after)
        ds = np.minimum(a * np.minimum(t_up, t_down), v)
        speeds_up = (t >= 0) & (t < t_a)
        slows_down = (t > T - t_a) & (t <= T)
        dds = np.where(speeds_up, a, 0.0) - np.where(slows_down, a, 0.0)
        nan_of_t = np.where(np.isnan(t), np.nan, 0.0)  # clipping and comparing would lose it
        return s + nan_of_t, ds + nan_of_t, dds + nan_of_t

    def stretched(self, duration: float) -> Trapezoid:
        """The same shape over another duration.

        Examples
        --------
        >>> trapezoid(v=1.0, a=2.0).stretched(3.0).v
        0.5
        """
        rate_factor = self.duration / _positive(duration, "duration")
        return Trapezoid(self.v * rate_factor, self.a * rate_factor**2)


def trapezoid(*, v: float | None = None, a: float | None = None, duration: float | None = None) -> Trapezoid:
    """Trapezoidal time scaling from two of the three: rate, acceleration, duration (MR section 9.2.2.2).

    With v and a: if v² > a, the scaling has no coasting, and its peak rate √a is below v. With v and the duration T,
    1 < v T ≤ 2 is required. With a and T, a T² ≥ 4 is required.

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
    given_options = {name: _positive(x, name) for name, x in options.items() if x is not None}
    if len(given_options) != 2:
        raise ValueRangeError(
            f"give exactly two of v, a and duration, which determine the third; got {', '.join(given_options) or 'none'}."
        )
    if "duration" not in given_options:
        v, a = given_options["v"], given_options["a"]
        peak_without_coasting = float(np.sqrt(a))
        return Trapezoid(min(v, peak_without_coasting), a)
    T = given_options["duration"]
    if "v" in given_options:
        v = given_options["v"]
        if not 1.0 < v * T <= 2.0 * (1 + _ROUNDING):
            raise ValueRangeError(
                f"v = {printed(v)} over T = {printed(T)} does not allow a trapezoid: 1 < v T ≤ 2 is needed, so "
                f"v above {printed(1 / T)} and up to {printed(2 / T)}."
            )
        a = max(v * v / (v * T - 1.0), v * v)  # MR eq. 9.18; at v T = 2, rounding must not make it less than v²
        return Trapezoid(v, a)
    a = given_options["a"]
    if a * T * T < 4.0 * (1 - _ROUNDING):
        raise ValueRangeError(
            f"a = {printed(a)} over T = {printed(T)} is too slow: a T² ≥ 4 is needed, so a from {printed(4 / T**2)} or "
            f"T from {printed(2 / a**0.5)}."
        )
    discriminant = max(a * (a * T * T - 4.0), 0.0)  # not negative by rounding at a T² = 4
    v = 0.5 * (a * T - float(np.sqrt(discriminant)))  # MR eq. 9.19
    return Trapezoid(v, a)


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
        """Second integral of the scaling before averaging, extended beyond both ends, and the times of its knots.

        Each average is a difference of integrals, so two averages are differences of the second integral. The scaling is 0
        before its first knot, and 1 after its last knot.
        """
        from scipy.interpolate import PPoly

        durations = 2.0 * np.diff(self.places) / (self.rates[1:] + self.rates[:-1])  # the rate is linear in time
        knot_times = np.concatenate([[0.0], np.cumsum(durations)])
        # Coefficients of t², t and 1 of each piece, in its rows.
        pieces = np.stack([0.5 * np.diff(self.rates) / durations, self.rates[:-1], self.places[:-1]])
        constant_0 = np.zeros((3, 1))  # the pieces beyond both ends
        constant_1 = np.array([[0.0], [0.0], [1.0]])
        margin = sum(self.windows)  # the longest shift of the time; 1 s more on both sides
        breaks = np.concatenate([[-margin - 1.0], knot_times, [knot_times[-1] + margin + 1.0]])
        scaling = PPoly(np.concatenate([constant_0, pieces, constant_1], axis=1), breaks)
        return scaling.antiderivative(2), knot_times

    @cached_property
    def duration(self) -> float:
        """Duration T [s]."""
        _, knot_times = self._second_integral
        return float(knot_times[-1]) + sum(self.windows)

    @cached_property
    def knots(self) -> Array:
        """Times between which the third derivative is linear [s]."""
        _, t = self._second_integral
        a, b = self.windows
        return np.unique(np.concatenate([t, t + a, t + b, t + (a + b)]))

    def _derivative(self, t: Array, order: int) -> Array:
        """Derivative of s at t (...); order 0 is s itself."""
        integral, _ = self._second_integral
        a, b = self.windows
        t = np.clip(t, 0.0, self.duration)
        shifted_by_a = integral(t - a, order)
        shifted_by_b = integral(t - b, order)
        shifted_by_both = integral(t - (a + b), order)
        return np.asarray((integral(t, order) - shifted_by_a - shifted_by_b + shifted_by_both) / (a * b))

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """s, ds/dt and d²s/dt² at t [s]; (...) → (...) each. Constant before 0 and after T."""
        t = arguments.real(t, "t")
        is_before = t <= 0
        is_after = t >= self.duration
        at_rest = is_before | is_after
        s, ds, dds = (self._derivative(t, order) for order in range(3))
        s = np.where(is_before, 0.0, np.clip(s, 0.0, 1.0))
        s = np.where(is_after, 1.0, s)
        return s, np.where(at_rest, 0.0, ds), np.where(at_rest, 0.0, dds)

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
        factor = _positive(duration, "duration") / self.duration
        first_window, second_window = self.windows
        return replace(self, rates=self.rates / factor, windows=(first_window * factor, second_window * factor))


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
    acceleration_time = shares["alpha"] * T
    peak_rate = 1.0 / ((1.0 - shares["alpha"]) * T)
    # The first window makes a trapezoid of the constant rate, the second one rounds its corners.
    windows = (acceleration_time * (1.0 - shares["beta"]), acceleration_time * shares["beta"])
    return Averaged(np.array([0.0, 1.0]), np.array([peak_rate, peak_rate]), windows, "s-curve")


def _positive(x: Any, name: str) -> float:
    """Finite number above zero. Raises ValueRangeError for another; ``name`` is its name in the message."""
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
        p = s * self.end[:3, 3] + (1.0 - s) * self.start[:3, 3]  # exactly p0 and p1 at both ends
        return se3.pose(R, p)

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
        v = (np.swapaxes(R, -1, -2) @ self.twist[3:, None])[..., 0]  # from base axes to the frame
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
    relative_pose = se3.inverse(start) @ end
    return PosePath(start, end, False, se3.log(relative_pose))


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
    v = end[:3, 3] - start[:3, 3]
    return PosePath(start, end, True, np.concatenate([w, v]))


def _poses(start: ArrayLike, end: ArrayLike) -> tuple[Array, Array]:
    """Both ends of a path as single poses (4, 4); raises an error for other input."""
    return _single_pose(start, "start"), _single_pose(end, "end")


def _single_pose(T: ArrayLike, name: str) -> Array:
    """Pose (4, 4). Raises an error for other input; ``name`` is its name in the message."""
    pose = np.asarray(arguments.pose(arguments.finite(T, name, 4, 4), name), float)
    if pose.shape != (4, 4):
        raise ShapeError(f"{name} has shape {pose.shape}: a path leads from one pose (4, 4) to another.")
    return pose


complete(globals())
