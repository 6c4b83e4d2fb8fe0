"""Physically consistent bodies: regularised least squares with the divergence from the file's pseudo-inertias.

The fit minimises, over positive definite pseudo-inertias J_i of the bodies and positive parameters d_k of the drives,

    f = ½ |W x - τ|² + γ Σ_i D(J_i, J_i0) + γ Σ_k (d_k / d_k0 - log d_k / d_k0 - 1)
    D(J, J0) = tr(J0^-1 J) - log det(J0^-1 J) - 4

D is the Bregman divergence of -log det (Lee, Wensing and Park, "Geometric robot dynamic identification: a convex programming
approach", IEEE T-RO 36(2), 2020). f is convex, and f / γ is self-concordant. Newton's method starts at a large γ, where
the minimum is the file itself, and follows the minimum to the requested γ.

Newton steps X change J = L L' to L (1 + X) L'. In the coordinates X, the Hessian of γ D is γ times the unit matrix at X = 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import ValueRangeError
from ..core.estimation.least_squares import (
    Information,
    NormalEquations,
    Prior,
    left_out,
    solve_positive,
    squares_of,
    sum_of,
)
from ..core.numbers import number, printed
from ..core.text import Argument, listed, spell
from ..core.typing import Array
from ..mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.actuation import with_friction
from ..robot import Robot
from .parameters import DRIVE, BaseParameters

STRENGTHS = tuple(10.0**k for k in range(5, -3, -1))
"""Available weights γ of the divergence, in units of the squared residuals, from large to small."""
MOST_STEPS = 50
"""Maximum number of Newton steps at one γ."""
_STRENGTHS_PER_DECADE = 3  # minima that are computed on the way to a γ ten times smaller
_MAX_DECREMENT = 1e-10
"""Squared Newton decrement, as a share of the cost, at which the minimum is reached."""
_MIN_DECREASE = 1e-4
"""Decrease of the cost, as a share of the linear prediction, from which a step is accepted (Armijo)."""
_MIN_STEP = 1e-10
"""Factor of a Newton step below which the step is not shortened any more."""
_MIN_MOMENT_SHARE = 1e-3
"""Least second moment of a prior body, as a share of its largest second moment."""
_MIN_MASS_SHARE = 1e-3
"""Mass of a prior body that has no mass in the file, as a share of the robot's mass."""
_NO_MASS = 1e-9
"""Largest mass that counts as none, as a share of the robot's mass."""
_RADIUS_SHARE = 0.05
"""Radius of gyration of a prior body without extent, as a share of the robot's reach."""
_MIN_DRIVE_SHARE = 1e-3
"""Least prior value of a drive's parameter, as a share of its largest plausible size."""
_MIN_EIGENVALUE_RATIO = 1e-13  # ratio of the eigenvalues of a pseudo-inertia below which it has no Cholesky factor
_MAX_FILE_WEIGHT = 25.0  # largest weight of the prior in covariances: deviations of 20 % from the file
_WEIGHT_OF_KNOWN = 1e6  # weight of known values, in units of the residuals, per plausible size


def _orthonormal_basis() -> Array:
    """Orthonormal basis (10, 4, 4) of the symmetric 4 × 4 matrices."""
    basis = np.zeros((10, 4, 4))
    entries = [(i, j) for i in range(4) for j in range(i, 4)]
    for matrix, (i, j) in zip(basis, entries, strict=True):
        matrix[i, j] = matrix[j, i] = 1.0 if i == j else math.sqrt(0.5)
    return basis


_E = _orthonormal_basis()
_TO_PSEUDO = np.stack([SpatialInertia.from_parameters(e).pseudo_inertia for e in np.eye(10)])
"""Matrices M_k (10, 4, 4), with J = Σ_k π_k M_k for the ten parameters π of a body."""
_FROM_PSEUDO = np.linalg.inv(np.einsum("kij,aij->ak", _TO_PSEUDO, _E))
"""Matrix (10, 10) that maps the coordinates of J in the basis _E to the parameters π."""


def pseudo_inertia(parameters: Array) -> Array:
    """(4, 4) pseudo-inertia of ten parameters."""
    return np.einsum("k,kij->ij", parameters, _TO_PSEUDO)


@dataclass(frozen=True, eq=False)
class PositiveFit:
    """Parameters of physically consistent bodies at one strength of the prior."""

    strength: float  # γ
    values: Array  # (p,), of all unknown parameters
    cost: float  # f at the minimum, including the constant of the residuals
    steps: int  # Newton steps at this strength
    above: float = 0.0  # bound of the excess of f over its minimum, from the last Newton decrement


@dataclass(frozen=True, eq=False)
class PositivePrior:
    """Prior bodies and drives of a fit."""

    bodies: Array  # (n, 4, 4), positive definite pseudo-inertias of the moving links
    drives: Array  # (p,), positive values of parameters; 1 for parameters without a prior value
    positive: Array  # (p,) bool, parameters of drives that must be positive
    repaired: tuple[str, ...]  # links whose inertia in the file is on the boundary of physical consistency

    @classmethod
    def from_values(cls, base: BaseParameters, values: Array, sizes: Array) -> PositivePrior:
        """Prior with the file's bodies, thickened if they have no extent, and the drives of the groups."""
        model = base.unknown.model
        mass, length = base.unknown.lengths
        bodies, repaired = [], []
        for i in base.unknown.bodies:
            body = model.bodies[i]
            J, is_thickened = _thicken(body.inertia, mass, length)
            bodies.append(J)
            if is_thickened:
                repaired.append(body.link)
        kinds = np.array(base.unknown.kinds)
        is_positive = np.isin(kinds, ("motor_inertia", "viscous", "coulomb", "stribeck"))
        drives = np.where(is_positive, _MIN_DRIVE_SHARE * sizes, 1.0)
        group_differences = values - base.project(base.unknown.file_values)  # which the drives must provide
        for k in np.flatnonzero(is_positive):
            groups = np.flatnonzero(base.grouping[:, k])
            if groups.size:
                group = groups[0]
                needed_value = float(group_differences[group] / base.grouping[group, k])
                drives[k] = max(drives[k], needed_value)
        is_known = is_positive & base.unknown.held
        min_known = (
            _MIN_DRIVE_SHARE * _MIN_DRIVE_SHARE * sizes[is_known]
        )  # f has the logarithm, and a known value may be 0
        drives[is_known] = np.maximum(base.unknown.file_values[is_known], min_known)
        return cls(np.array(bodies), drives, is_positive, tuple(repaired))


def _thicken(G: SpatialInertia, mass: float, length: float) -> tuple[Array, bool]:
    """Positive definite pseudo-inertia near that of a body, and True if it was changed.

    ``mass`` and ``length`` are those of the whole robot. S are the second moments about the centre of mass.
    """
    m = float(G.mass)
    is_changed = not m > _NO_MASS * mass
    if is_changed:
        m, c, S = _MIN_MASS_SHARE * mass, np.zeros(3), np.zeros((3, 3))
    else:
        c = G.com
        S = G.second_moment - m * np.outer(c, c)
    radius_2 = (_RADIUS_SHARE * length) ** 2
    extent_2 = max(float(np.trace(S)) / m, radius_2 / _MIN_MOMENT_SHARE)
    moment_of_point = m * min(radius_2, _MIN_MOMENT_SHARE * extent_2)
    moments, axes = np.linalg.eigh(0.5 * (S + S.T))
    min_moment = max(_MIN_MOMENT_SHARE * float(moments.max(initial=0.0)), 1e-3 * moment_of_point)
    if moments.min() < min_moment:
        is_changed = True
        is_point = moments.max() <= moment_of_point
        moments = np.maximum(moments, moment_of_point if is_point else min_moment)
    S = (axes * moments) @ axes.T + m * np.outer(c, c)  # about the origin
    J = np.block([[S, m * c[:, None]], [m * c[None, :], np.array([[m]])]])
    return J, is_changed


class PositiveProblem:
    """Minimisation of f for one set of rows, given by N = W' W (r, r), c = W' τ (r,) and y = |τ|² of the groups.

    A point is a pair J, x: pseudo-inertias (n, 4, 4) of the bodies, and parameters (p,), of which those of drives count.
    """

    def __init__(self, base: BaseParameters, prior: PositivePrior, N: Array, c: Array, y: float, sizes: Array) -> None:
        self.base, self.prior = base, prior
        K = base.grouping
        self.H = K.T @ N @ K
        self.g = K.T @ c
        held = np.flatnonzero(base.unknown.held)  # indices of parameters with known values
        weight = (_WEIGHT_OF_KNOWN / sizes[held]) ** 2
        known = base.unknown.file_values[held]
        self.H[held, held] += weight
        self.g[held] += weight * known
        self.y = y + float(weight @ known**2)
        of_bodies = base.unknown.of_bodies
        columns = 10 * np.array(base.unknown.bodies, int)[:, None] + np.arange(10)  # (n, 10), of the regressor
        is_column = of_bodies == columns[..., None]
        self._bodies = np.argmax(is_column, axis=-1)  # (n, 10) indices of the bodies' parameters
        self._drives = np.flatnonzero(prior.positive)  # indices of positive parameters of drives
        self._offsets = np.flatnonzero((of_bodies < 0) & ~prior.positive)  # indices of the other parameters of drives
        self._size = sizes
        self._prior_inverse = np.linalg.inv(prior.bodies)

    def path(self, strengths: Sequence[float]) -> list[PositiveFit]:
        """Minima for decreasing strengths, each started at the previous minimum."""
        J = self.prior.bodies.copy()
        x = np.zeros(len(self.base.unknown.names))
        x[self._drives] = self.prior.drives[self._drives]
        fits = []
        previous = max(strengths)
        for strength in strengths:
            strength_count = max(1, math.ceil(_STRENGTHS_PER_DECADE * math.log10(previous / strength)))
            for k in range(1, strength_count):
                intermediate = previous * (strength / previous) ** (k / strength_count)
                J, x, *_ = self._minimum(J, x, intermediate)
            J, x, cost, steps, above = self._minimum(J, x, strength)
            fits.append(PositiveFit(strength, self._values(J, x), cost, steps, above))
            previous = strength
        return fits

    def covariance(self, fit: PositiveFit, C: Array) -> Array:
        """Covariance (p, p) of the parameters at a minimum, for groups with the covariance C (r, r).

        P is the inverse of the prior's Hessian, if the file's errors are 20 % at least, and A the derivatives of the groups
        by the coordinates of a step. In these coordinates, the covariance is P - P A' (A P A' + C)^-1 A P.
        """
        J = np.einsum("nk,kij->nij", fit.values[self._bodies], _TO_PSEUDO)
        T = self._tangents(np.linalg.cholesky(J), fit.values)
        P = np.ones(T.shape[1])  # diagonal
        first_offset = T.shape[1] - len(self._offsets)
        P[:first_offset] = 1.0 / min(fit.strength, _MAX_FILE_WEIGHT)
        A = self.base.grouping @ T
        S = (A * P) @ A.T + C
        size = np.sqrt(S.diagonal())  # scales S to a unit diagonal
        scaled_solution = np.linalg.solve(S / np.outer(size, size), (A * P) / size[:, None])
        S_inverse_A_P = scaled_solution / size[:, None]
        covariance_of_step = np.diag(P) - (A * P).T @ S_inverse_A_P
        return np.asarray(T @ covariance_of_step @ T.T)

    def _values(self, J: Array, x: Array) -> Array:
        """Parameters (p,) of a point: those of bodies from J, all others from x."""
        values = x.copy()
        values[self._bodies] = np.einsum("aij,nij->na", _E, J) @ _FROM_PSEUDO.T
        return values

    def cost(self, J: Array, x: Array, strength: float) -> float:
        """f, with a weak prior of the offsets; infinity if J or a parameter of a drive is not positive."""
        values = self._values(J, x)
        relative_inertias = self._prior_inverse @ J  # J0^-1 J
        drive_ratios = x[self._drives] / self.prior.drives[self._drives]
        sign, log_det = np.linalg.slogdet(relative_inertias)
        eigenvalues = np.linalg.eigvalsh(J)
        is_singular = eigenvalues[:, 0] <= _MIN_EIGENVALUE_RATIO * eigenvalues[:, -1]
        if (sign <= 0).any() or is_singular.any() or (drive_ratios <= 0).any():
            return math.inf
        divergence = float((np.trace(relative_inertias, axis1=1, axis2=2) - log_det - 4.0).sum())
        divergence += float((drive_ratios - np.log(drive_ratios) - 1.0).sum())
        offset_term = 0.5 * float(((x[self._offsets] / self._size[self._offsets]) ** 2).sum())
        residual_term = 0.5 * (self.y - 2.0 * float(self.g @ values) + float(values @ self.H @ values))
        return residual_term + strength * divergence + offset_term

    def _minimum(self, J: Array, x: Array, strength: float) -> tuple[Array, Array, float, int, float]:
        """Minimum of f by damped Newton steps from J, x: J, x, cost, number of steps, and bound of the excess of the cost."""
        cost = self.cost(J, x, strength)
        squared_decrement = math.inf
        for step in range(MOST_STEPS):
            L = np.linalg.cholesky(J)
            gradient, hessian = self._derivatives(J, L, x, strength)
            direction = -solve_positive(hessian, gradient)
            squared_decrement = -float(gradient @ direction)
            if squared_decrement <= _MAX_DECREMENT * max(abs(cost), strength, 1e-300):
                return J, x, cost, step, squared_decrement / 2
            scale = 1.0  # halved until the step decreases the cost enough
            while True:
                J_new, x_new = self._take_step(L, x, scale * direction)
                new_cost = self.cost(J_new, x_new, strength)
                max_cost = cost - _MIN_DECREASE * scale * squared_decrement
                if new_cost <= max_cost or scale < _MIN_STEP:
                    break
                scale *= 0.5
            if not new_cost < cost:  # no step decreases it any more
                return J, x, cost, step, squared_decrement / 2
            J, x, cost = J_new, x_new, new_cost
        return J, x, cost, MOST_STEPS, squared_decrement / 2

    def _derivatives(self, J: Array, L: Array, x: Array, strength: float) -> tuple[Array, Array]:
        """Gradient and Hessian of f by the coordinates of a step from J = L L', x."""
        T = self._tangents(L, x)
        gradient = T.T @ (self.H @ self._values(J, x) - self.g)
        hessian = T.T @ self.H @ T
        first_drive, first_offset = self._first_coordinates(len(J))
        relative_inertias = np.swapaxes(L, 1, 2) @ self._prior_inverse @ L  # L' J0^-1 L, similar to J0^-1 J
        gradient[:first_drive] += strength * np.einsum("aij,nij->na", _E, relative_inertias - np.eye(4)).ravel()
        gradient[first_drive:first_offset] += strength * (x[self._drives] / self.prior.drives[self._drives] - 1.0)
        gradient[first_offset:] += x[self._offsets] / self._size[self._offsets]
        prior_hessian = np.where(np.arange(len(gradient)) < first_offset, strength, 1.0)  # diagonal
        hessian[np.diag_indices_from(hessian)] += prior_hessian
        return gradient, hessian

    def _first_coordinates(self, body_count: int) -> tuple[int, int]:
        """Indices of the first coordinate of drives and of the first of offsets; ten coordinates of each body come before."""
        first_drive = 10 * body_count
        return first_drive, first_drive + len(self._drives)

    def _tangents(self, L: Array, x: Array) -> Array:
        """Derivatives (p, k) of the parameters by the coordinates of a step."""
        first_drive, first_offset = self._first_coordinates(len(L))
        T = np.zeros((len(x), first_offset + len(self._offsets)))
        J_columns = L[:, None] @ _E @ np.swapaxes(L, 1, 2)[:, None]  # (n, 10, 4, 4), L E_a L'
        body_coordinates = np.arange(first_drive).reshape(-1, 1, 10)
        T[self._bodies[..., None], body_coordinates] = _FROM_PSEUDO @ np.einsum("bij,naij->nba", _E, J_columns)
        T[self._drives, np.arange(first_drive, first_offset)] = x[self._drives]
        T[self._offsets, np.arange(first_offset, T.shape[1])] = self._size[self._offsets]
        return T

    def _take_step(self, L: Array, x: Array, step: Array) -> tuple[Array, Array]:
        """Point after a step (k,) from J = L L', x."""
        first_drive, first_offset = self._first_coordinates(len(L))
        X = np.einsum("na,aij->nij", step[:first_drive].reshape(-1, 10), _E)
        J = L @ (np.eye(4) + X) @ L.transpose(0, 2, 1)
        x = x.copy()
        x[self._drives] *= 1.0 + step[first_drive:first_offset]
        x[self._offsets] += self._size[self._offsets] * step[first_offset:]
        return 0.5 * (J + J.transpose(0, 2, 1)), x  # symmetric despite rounding


# ── Robot with physically consistent bodies, near the file's

_MAX_RATIO_TO_BEST = 1.01
"""Ratio to the least held-out residual up to which a stronger prior is preferred."""


@dataclass(frozen=True, eq=False)
class ConsistentRobot:
    """Consistent robot: physically consistent bodies, positive friction and positive motor inertias.

    Attributes
    ----------
    base : BaseParameters
    fit : PositiveFit, the selected fit
    curve : tuple of (γ, share), |τ - τ̂| / |τ| of held-out fifths for each tested strength
    of_file : float, |τ - τ̂| / |τ| of held-out fifths for the file's bodies with fitted friction
    repaired : tuple of str, links whose inertia in the file was thickened first

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench.identification.parameters import UnknownParameters
    >>> base = BaseParameters.from_unknowns(UnknownParameters(tw.robots.planar_2r()))
    >>> fit = PositiveFit(1.0, np.arange(28.0), 0.0, 0)
    >>> found = ConsistentRobot(base, fit, ((1.0, 0.1),), 0.2, ())
    >>> found.value("joint1.viscous"), found.of_joints("offset")
    (11.0, {'joint1': 13.0, 'joint2': 27.0})
    >>> found.outside(base.project(fit.values)[:, None] + [-1.0, 1.0], np.ones(base.count))
    []
    """

    base: BaseParameters
    fit: PositiveFit
    curve: tuple[tuple[float, float], ...]
    of_file: float
    repaired: tuple[str, ...]

    @property
    def held_out(self) -> float:
        """|τ - τ̂| / |τ| of held-out fifths, at the selected strength."""
        return dict(self.curve)[self.fit.strength]

    def value(self, name: str) -> float:
        """Value of a parameter by its name.

        Parameters
        ----------
        name : str, such as ``link_2.m``

        Returns
        -------
        value : float

        Raises
        ------
        ValueError
            There is no parameter of that name.
        """
        return float(self.fit.values[self.base.unknown.names.index(name)])

    @property
    def inertias(self) -> tuple[SpatialInertia, ...]:
        """Inertia of each moving body, fixed links fused, in its own frame; zero for a body without mass between two joints."""
        unknown = self.base.unknown
        values = np.zeros((len(unknown.model.bodies), len(PARAMETER_NAMES)))
        is_body = unknown.of_bodies >= 0
        values.reshape(-1)[unknown.of_bodies[is_body]] = self.fit.values[is_body]
        return tuple(map(SpatialInertia.from_parameters, values))

    def of_joints(self, kind: str) -> dict[str, float]:
        """Values of one kind of parameter by joint; joints without such a parameter are left out.

        Parameters
        ----------
        kind : str, ``motor_inertia``, ``viscous``, ``coulomb``, ``stribeck`` or ``offset``

        Returns
        -------
        numbers : {joint: number}
        """
        names = self.base.unknown.names
        values: dict[str, float] = {}
        for joint in self.base.unknown.model.velocity_names:
            name = f"{joint}.{kind}"
            if name in names:
                values[joint] = self.value(name)
        return values

    def outside(self, interval: Array, deviations: Array) -> list[str]:
        """Report groups that the weight of the prior moves out of their intervals.

        Parameters
        ----------
        interval : (r, 2) array, of each group
        deviations : (r,) array

        Returns
        -------
        sentences : list of str, one or none
        """
        low, high = interval.T
        values = self.base.project(self.fit.values)
        violations = np.maximum(values - high, low - values) / np.maximum(deviations, 1e-300)
        worst_first = np.argsort(-violations)
        outside = worst_first[violations[worst_first] > 0].tolist()
        if not outside:
            return []
        groups = [f"{self.base.names[k]} {number(values[k])} ({number(low[k])} to {number(high[k])})" for k in outside]
        return [
            f"physically consistent bodies, drawn to the file's by the prior, put {len(outside)} of {len(values)} groups "
            f"outside their 95 % intervals: {listed(groups, 3, '; ')}. Torques held out are predicted as well; a smaller "
            f"weight of the prior, {spell(Argument('keep_close'))}, stays nearer to the log"
        ]

    @property
    def of_several_joints(self) -> dict[str, float]:
        """Friction and motor inertia of motors that turn several joints, by name; robot files cannot store these."""
        unknown = self.base.unknown
        joints = unknown.model.velocity_names
        values: dict[str, float] = {}
        for k, (name, kind) in enumerate(zip(unknown.names, unknown.kinds, strict=True)):
            owner = name.removesuffix(f".{kind}")
            if kind in DRIVE and owner not in joints:
                values[name] = float(self.fit.values[k])
        return values

    @property
    def robot(self) -> Robot:
        """Robot with these bodies, and with friction and motor inertias at its joints."""
        model = self.base.unknown.model
        bodies = tuple(replace(body, inertia=G) for body, G in zip(model.bodies, self.inertias, strict=True))
        viscous, coulomb, stribeck = self.of_joints("viscous"), self.of_joints("coulomb"), self.of_joints("stribeck")
        motor_inertias = self.of_joints("motor_inertia")
        friction_by_joint: dict[str, dict[str, float]] = {}
        for joint in model.velocity_names:
            friction: dict[str, float] = {}
            if joint in viscous:
                friction["viscous"] = viscous[joint]
            if joint in coulomb:
                friction["coulomb"] = coulomb[joint]
            if joint in stribeck:
                static = coulomb.get(joint, 0.0) + stribeck[joint]  # stribeck is the excess above Coulomb friction
                friction |= {"static": static, "stribeck": self.base.unknown.stribeck_speed}
            friction_by_joint[joint] = friction
        armature = np.array([motor_inertias.get(joint, 0.0) for joint in model.velocity_names])
        return Robot(with_friction(replace(model, bodies=bodies, armature=armature), friction_by_joint))


def check_strength(strength: float | None) -> None:
    """Raise ValueRangeError if a weight of the prior is not one of the available weights."""
    if strength is not None and not STRENGTHS[-1] <= strength <= STRENGTHS[0]:
        raise ValueRangeError(
            f"a strength of {strength!r} is not offered. Give one from {printed(STRENGTHS[-1])} to {printed(STRENGTHS[0])}."
        )


def consistent_robot(
    base: BaseParameters,
    values: Array,
    sizes: Array,
    folds: Sequence[Information],
    weak: Prior,
    strength: float | None = None,
) -> ConsistentRobot:
    """Consistent robot with the largest weight of the prior whose predictions are as good as the best.

    Parameters
    ----------
    base : BaseParameters
    values : (r,) array, fitted groups
    sizes : (p,) array, largest plausible sizes of the parameters
    folds : N, c and |τ|² of each fifth of the rows
    weak : Prior, weak prior of the groups
    strength : float or None, weight of the prior; None: chosen by cross-validation
    """
    prior = PositivePrior.from_values(base, values, sizes)
    filled_folds = [(N, c, y) for N, c, y in folds if y > 0]
    all_rows = sum_of(filled_folds)
    strengths = STRENGTHS if strength is None else _path_to(strength)
    squares = np.zeros(len(strengths))
    file_squares = 0.0
    for held_out, training in left_out(filled_folds):
        fits = PositiveProblem(base, prior, *training, sizes).path(strengths)
        squares += [squares_of(held_out, base.project(fit.values)) for fit in fits]
        file_squares += squares_of(held_out, file_with_drives(base, training, weak))
    _, _, squared_torques = all_rows
    shares = np.sqrt(squares / squared_torques)
    chosen = len(strengths) - 1  # index of the strength
    if strength is None:
        is_good = shares <= _MAX_RATIO_TO_BEST * shares.min()
        chosen = int(np.argmax(is_good))  # the first, which is the largest strength
    *_, fit = PositiveProblem(base, prior, *all_rows, sizes).path(strengths[: chosen + 1])
    curve = tuple(zip(strengths, shares.tolist(), strict=True))
    file_share = float(np.sqrt(file_squares / squared_torques))
    return ConsistentRobot(base, fit, curve, file_share, prior.repaired)


def _path_to(strength: float) -> tuple[float, ...]:
    """Available weights of the prior above ``strength``, from large to small, then ``strength``."""
    larger_strengths = [available for available in STRENGTHS if available > strength]
    return (*larger_strengths, strength)


def file_with_drives(base: BaseParameters, training: Information, weak: Prior) -> Array:
    """Groups of the file's bodies with drives fitted to training rows."""
    x = base.project(base.unknown.file_values)
    drives = base.drives
    if drives.size:
        N, c, _ = training
        drive_prior = Prior(np.zeros(len(drives)), weak.size[drives])
        x[drives] += drive_prior.solve(N[np.ix_(drives, drives)], (c - N @ x)[drives])
    return x


@dataclass(frozen=True, eq=False)
class ModelResiduals:
    """Shares |τ - τ̂| / |τ| of weighted, held-out rows in five folds, by joint.

    Attributes
    ----------
    file : (nv,) array, the file's bodies alone
    with_friction : (nv,) array, the file's bodies with fitted friction and motor inertias
    identified : (nv,) array, the groups
    consistent : (nv,) array, physically consistent bodies, at the selected weight of the prior
    """

    file: Array
    with_friction: Array
    identified: Array
    consistent: Array


def model_residuals(
    base: BaseParameters,
    folds: Sequence[NormalEquations],
    weak: Prior,
    values: Array,
    sizes: Array,
    strength: float,
) -> ModelResiduals:
    """Residuals of all four models, with each fifth predicted from the others; parameters as of :func:`consistent_robot`."""
    prior = PositivePrior.from_values(base, values, sizes)
    strengths = _path_to(strength)
    filled_folds = [fold for fold in folds if fold.y.sum() > 0]
    file = base.project(base.unknown.file_values)
    squares = np.zeros((4, base.unknown.model.nv))  # a row for each model
    squared_torques = np.zeros(base.unknown.model.nv)
    sums_over_joints = [fold.together() for fold in filled_folds]
    for held_out, (_, training) in zip(filled_folds, left_out(sums_over_joints), strict=True):
        N, c, _ = training
        *_, consistent = PositiveProblem(base, prior, *training, sizes).path(strengths)
        squares[0] += held_out.squares(file)
        squares[1] += held_out.squares(file_with_drives(base, training, weak))
        squares[2] += held_out.squares(weak.solve(N, c))
        squares[3] += held_out.squares(base.project(consistent.values))
        squared_torques += held_out.y
    shares = np.sqrt(squares / np.where(squared_torques > 0, squared_torques, np.inf))  # 0 without torques
    return ModelResiduals(*shares)
