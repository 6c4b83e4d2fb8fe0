"""Compensated wrenches: point of contact, residual moment, and collision thresholds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, TwistWrenchError, ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.lie import so3
from ..mechanics.lie.labelled import WRENCH


def checked_noise(noise: ArrayLike, *, none_at_all: bool = False) -> Array:
    """Standard deviations (2,) of moments [N m] and forces [N], after a check; zeros are valid only if ``none_at_all``."""
    try:
        sigma = np.asarray(arguments.real(noise, "noise"), float)
    except TwistWrenchError:  # reported below, by its shape
        sigma = np.empty(0)
    is_allowed = sigma > 0
    expected = "positive numbers"
    if none_at_all:
        is_allowed = sigma >= 0
        expected = "numbers from 0 on"
    if sigma.shape != (2,) or not np.isfinite(sigma).all() or not is_allowed.all():
        raise ValueRangeError(f"noise {noise!r} is not two {expected}: of moments [N m] and of forces [N].")
    return sigma


def six_noises(noise: ArrayLike) -> Array:
    """Standard deviations (6,) of mx, my, mz [N m], fx, fy, fz [N], from two or six of them."""
    if np.shape(noise) == (6,):
        sigma = arguments.real(noise, "noise", 6)
    else:
        sigma = np.repeat(checked_noise(noise), 3)
    if not np.isfinite(sigma).all() or (sigma <= 0).any():
        raise ValueRangeError(f"noise {noise!r} is not six positive numbers: mx, my, mz [N m], fx, fy, fz [N].")
    return sigma


# ── Point of contact, residual moment, and thresholds

_MIN_EIGENVALUE = 1e-12
"""Smallest eigenvalue of a covariance after scaling to unit variances; smaller ones are rounding errors."""
_MIN_SINE = 1e-12
"""Sine of the angle between a line and a plane below which they are parallel."""
_MAX_FREEDOM = 1e9
"""Degrees of freedom that stand for infinitely many."""
_MIN_RESIDUALS = 8
"""Smallest number of residuals that determine a covariance of six axes and its test."""


def residual_moment(F: ArrayLike) -> Array:
    """Moment about the line of action of a force; zero for a point contact without grip.

    Returns
    -------
    moment : (...,) array [N m]; NaN without a force

    Examples
    --------
    >>> float(residual_moment([0.0, 0.0, 0.3, 0.0, 0.0, 10.0]))
    0.3
    """
    m, f, force = _moment_and_force(F)
    return np.asarray((m * f).sum(-1) / force)


def contact_on_plane(F: ArrayLike, point: ArrayLike, normal: ArrayLike) -> Array:
    """Contact point on a plane: intersection with the line of action of the force.

    Parameters
    ----------
    normal : (..., 3) array_like, normal of the plane through ``point``

    Returns
    -------
    contact : (..., 3) array [m]; NaN if the force is zero or parallel to the plane

    Notes
    -----
    All arguments are in one frame.

    Examples
    --------
    >>> contact_on_plane([0.2, 0, 0, 0, 0, 2], point=[0, 0, 0.3], normal=[0, 0, 1]).tolist()  # 2 N upwards at y = 0.1
    [0.0, 0.1, 0.3]
    """
    start, direction = _line_of_action(F)
    n = arguments.real(normal, "normal", 3)
    offset = arguments.real(point, "point", 3) - start
    normal_part = (direction * n).sum(-1)
    is_parallel = np.abs(normal_part) < _MIN_SINE * np.linalg.norm(n, axis=-1)
    distance = (offset * n).sum(-1) / np.where(is_parallel, np.nan, normal_part)  # along the line
    return np.asarray(start + distance[..., None] * direction)


def contact_on_sphere(F: ArrayLike, centre: ArrayLike, radius: float) -> Array:
    """Contact point on a sphere: the point at which the line of action enters the sphere.

    Parameters
    ----------
    centre : (..., 3) array_like, in the frame of F [m]

    Returns
    -------
    contact : (..., 3) array [m]; NaN if the line of action misses the sphere

    Examples
    --------
    >>> contact_on_sphere([0, 0, 0, 0, 0, -2], centre=[0, 0, 0], radius=0.1)[2].item()
    0.1
    """
    start, direction = _line_of_action(F)
    radius = arguments.positive(radius, "radius", "m")
    # Distances s from the start solve |offset + s direction|² = radius²; the force enters at the smaller one.
    offset = start - arguments.real(centre, "centre", 3)
    s_nearest = -(offset * direction).sum(-1)  # of the point nearest to the centre
    squared_half_chord = s_nearest**2 - (offset * offset).sum(-1) + radius**2
    half_chord = np.sqrt(np.where(squared_half_chord < 0, np.nan, squared_half_chord))
    s_entry = s_nearest - half_chord
    return np.asarray(start + s_entry[..., None] * direction)


def contact_nearest(F: ArrayLike, point: ArrayLike) -> Array:
    """Contact point estimate: the point of the line of action of F nearest to a given point.

    Returns
    -------
    contact : (..., 3) array [m]

    Examples
    --------
    >>> contact_nearest([0, 0, 6, 0, 3, 0], [0, 1, 0]).tolist()
    [2.0, 1.0, 0.0]
    """
    start, direction = _line_of_action(F)
    offset = arguments.real(point, "point", 3) - start
    distance = (offset * direction).sum(-1, keepdims=True)  # along the line
    return np.asarray(start + distance * direction)


def _line_of_action(F: ArrayLike) -> tuple[Array, Array]:
    """Lines of action: their points nearest to the origin and their unit directions, (..., 3); NaN without a force."""
    m, f, magnitude = _moment_and_force(F)
    nearest_point = so3.cross(f, m) / magnitude[..., None] ** 2
    direction = f / magnitude[..., None]
    return nearest_point, direction


def _moment_and_force(F: ArrayLike) -> tuple[Array, Array, Array]:
    """Moments and forces (..., 3) of wrenches, and the magnitudes (...) of the forces; NaN for zero."""
    F = arguments.real(F, "F", 6)
    m = F[..., :3]
    f = F[..., 3:]
    magnitude = np.linalg.norm(f, axis=-1)
    return m, f, np.where(magnitude == 0, np.nan, magnitude)


@dataclass(frozen=True, eq=False)
class CollisionThreshold:
    """Contact detection threshold: a reading is a contact if its distance from the mean exceeds a limit."""

    middle: Array
    """(6,) mean of compensated readings without contact."""
    covariance: Array
    """Covariance (6, 6) of one reading, or (n, 6, 6) of each of n readings in order."""
    limit: float
    """Squared Mahalanobis distance from the mean above which a reading is a contact."""
    false_alarms: float
    """False-alarm rate: the fraction of contact-free readings above the limit."""
    axes: slice = field(default_factory=lambda: slice(0, 6))
    """Tested axes of a wrench: ``slice(3, 6)`` for forces only."""
    freedom: Array | None = None
    """(6,) degrees of freedom of estimated variances; None if the variances are known."""

    @classmethod
    def of_axes(cls, sigma: ArrayLike, false_alarms: float = 1e-6, *, axes: slice = slice(0, 6)) -> CollisionThreshold:
        """Threshold from six known standard deviations: a χ² test.

        Parameters
        ----------
        sigma : (6,) array_like, mx, my, mz [N m], fx, fy, fz [N]

        Examples
        --------
        >>> round(CollisionThreshold.of_axes([0.01, 0.01, 0.01, 0.3, 0.3, 0.3]).limit, 3)
        38.258
        """
        return cls.predictive(np.diag(six_noises(sigma) ** 2), None, false_alarms, axes=axes)

    @classmethod
    def predictive(
        cls, covariance: ArrayLike, freedom: ArrayLike | None, false_alarms: float, *, axes: slice = slice(0, 6)
    ) -> CollisionThreshold:
        """Threshold from the predictive covariance S of residuals, estimated with few degrees of freedom.

        Parameters
        ----------
        covariance : (6, 6) or (n, 6, 6) array_like, S
        freedom : (6,) array_like or None, degrees of freedom of the variances; None if the variances are known

        Raises
        ------
        ValueRangeError
            ``false_alarms`` is not between 0 and 1.

        Notes
        -----
        If S = L L' and u = L⁻¹ r, each u_c has a Student distribution with ν_c degrees of freedom. Its normal score
        z_c = Φ⁻¹(T_ν(u_c)) is normal. The sum of squares is then χ², with one degree of freedom per axis.

        Examples
        --------
        >>> round(CollisionThreshold.predictive(np.eye(6), None, 1e-3).limit, 3)
        22.458
        """
        from scipy import special

        _check_rate(false_alarms)
        if not isinstance(axes, slice):
            raise ValueRangeError(
                f"axes is {arguments.value_text(axes)}: give a slice of the six, such as slice(3, 6) for forces."
            )
        axis_count = len(range(6)[axes])
        limit = float(special.chdtri(axis_count, false_alarms))
        S = arguments.real(covariance, "covariance", 6, 6)
        if freedom is not None:
            freedom = arguments.real(freedom, "freedom", 6)
        return cls(np.zeros(6), S, limit, false_alarms, axes, freedom)

    @classmethod
    def of_noise(
        cls, noise: tuple[float, float], false_alarms: float = 1e-6, *, axes: slice = slice(0, 6)
    ) -> CollisionThreshold:
        """Threshold from known standard deviations of moments and forces: a χ² test, for independent normal noise.

        Examples
        --------
        >>> threshold = CollisionThreshold.of_noise((0.01, 0.3))
        >>> threshold.per_axis.round(3).tolist()
        [0.062, 0.062, 0.062, 1.856, 1.856, 1.856]
        """
        return cls.of_axes(np.repeat(checked_noise(noise), 3), false_alarms, axes=axes)

    @classmethod
    def of_residuals(cls, residuals: ArrayLike, false_alarms: float = 1e-6) -> CollisionThreshold:
        """Threshold from compensated readings without contact: Hotelling's test, exact for finite n.

        Parameters
        ----------
        residuals : (n, 6) array_like, n > 6 [N m, N]

        Raises
        ------
        ShapeError, ValueRangeError
            There are too few readings, or the axes are linearly dependent.

        Notes
        -----
        Source: Hotelling, "The generalization of Student's ratio", Ann. Math. Stat. 2, 1931.

        Examples
        --------
        >>> readings = np.random.default_rng(0).normal(size=(100, 6))
        >>> CollisionThreshold.of_residuals(readings).covariance.shape
        (6, 6)
        """
        from scipy import special

        _check_rate(false_alarms)
        r = arguments.real(residuals, "residuals")
        if r.ndim != 2 or r.shape[1] != 6:
            raise ShapeError(f"residuals have shape {r.shape}, expected (n, 6).")
        n = len(r)
        if n < _MIN_RESIDUALS or not np.isfinite(r).all():
            raise ValueRangeError(
                f"{n} residuals are too few to estimate the noise. Give at least 8 finite readings at rest."
            )
        S = np.cov(r.T)
        sigma = np.sqrt(np.diag(S))
        all_change = bool((sigma > 0).all())
        if not all_change or np.linalg.matrix_rank(S / np.outer(sigma, sigma), tol=1e-9) < 6:  # of correlations
            constant_axes = [axis for axis, deviation in zip(WRENCH, sigma, strict=True) if deviation == 0]
            reason = "some axes always change together"
            if constant_axes:
                reason = f"{', '.join(constant_axes)} never changes"
            raise ValueRangeError(
                f"these residuals are not noise of a six-axis sensor: {reason}. Check the sensor's wiring, or use of_noise."
            )
        # T² of a new reading: factor times F with 6 and n - 6 degrees of freedom
        factor = 6 * (n + 1) * (n - 1) / (n * (n - 6))
        limit = factor * float(special.fdtri(6, n - 6, 1 - false_alarms))
        return cls(r.mean(axis=0), S, limit, false_alarms)

    def __call__(self, compensated: ArrayLike) -> Array:
        """True for each compensated reading (..., 6) that is a contact; NaN counts as a contact."""
        return ~np.asarray(self.distance(compensated) <= self.limit)

    def distance(self, compensated: ArrayLike) -> Array:
        """Squared Mahalanobis distance of compensated readings from the mean of readings without contact.

        Parameters
        ----------
        compensated : (..., 6) array_like [N m, N]

        Returns
        -------
        distance : (...) array

        Examples
        --------
        >>> float(CollisionThreshold.of_noise((0.1, 1.0)).distance([0, 0, 0, 3, 0, 0]).round(9))
        9.0
        """
        from scipy import special

        deviation = arguments.real(compensated, "compensated readings", 6) - self.middle
        r = deviation[..., self.axes]
        S = self.covariance[..., self.axes, self.axes]
        L = np.linalg.cholesky(_positive_definite(S))
        u_columns = np.linalg.solve(L, r[..., None])
        u = u_columns[..., 0]
        if self.freedom is not None:  # normal scores with the same tail probability as the Student variables
            tail_probability = special.stdtr(np.minimum(self.freedom[self.axes], _MAX_FREEDOM), -np.abs(u))
            u = -special.ndtri(tail_probability)
        return np.asarray((u * u).sum(-1))

    @property
    def per_axis(self) -> Array:
        """Smallest moments [N m] and forces [N] (6,) above the limit, each along its axis alone; inf for untested axes.

        If every reading has its own covariance, the values are those of the middle reading.
        """
        from scipy import special

        S = self.covariance[..., self.axes, self.axes]
        if S.ndim == 3:
            S = S[len(S) // 2]  # of the middle reading
        limits: Any = math.sqrt(self.limit)  # in standard deviations of u
        if self.freedom is not None:
            nu = self.freedom[self.axes]
            student_limits = -special.stdtrit(np.minimum(nu, _MAX_FREEDOM), special.ndtr(-limits))
            limits = np.where(np.isinf(nu), limits, student_limits)
        inverse = np.linalg.inv(_positive_definite(S))
        smallest = np.full(6, math.inf)
        smallest[self.axes] = limits / np.sqrt(np.diag(inverse))
        return smallest


def _positive_definite(S: Array) -> Array:
    """Covariance (..., k, k) with a Cholesky factor: S itself, or S with variances that are larger by rounding errors.

    S is semidefinite if a combination of axes is estimated exactly, or almost exactly compared with the others.
    """
    try:
        np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        variances = np.abs(np.diagonal(S, axis1=-2, axis2=-1))  # rounding errors may make small ones negative
        min_variance = 1e-30 * variances.max() + np.finfo(float).tiny  # above zero, as a divisor
        sigma = np.sqrt(np.maximum(variances, min_variance))
        scale = sigma[..., None] * sigma[..., None, :]
        eigenvalues = np.linalg.eigvalsh(S / scale)  # from the smallest up
        least_eigenvalue = eigenvalues[..., :1]
        missing = np.maximum(_MIN_EIGENVALUE - least_eigenvalue, 0.0)
        return np.asarray(S + missing[..., None] * scale * np.eye(S.shape[-1]))
    return S


def _check_rate(false_alarms: float) -> None:
    """Raise ValueRangeError unless a false-alarm rate is between 0 and 1."""
    rate = arguments.number(false_alarms, "false_alarms")
    if not 0 < rate < 1:
        raise ValueRangeError(
            f"a false-alarm rate of {false_alarms!r} is not between 0 and 1. Give 1e-6 for one in a million."
        )


complete(globals())
