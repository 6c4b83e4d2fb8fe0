"""Weighted least squares for bias, load, mounting and other unknowns of a sensor, with noise per channel."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.errors import ValueRangeError
from ..core.estimation.covariance import (
    channel_covariance,
    cluster_robust_covariance,
    f_test_freedom,
    student_quantile,
    sum_freedom,
    variance_estimate_covariance,
    weight_freedom,
)
from ..core.estimation.least_squares import MAD, huber_weights, orthogonal_fit
from ..core.typing import Array
from ..mechanics.lie import so3
from ..mechanics.lie.labelled import WRENCH
from .log import ReadingLog
from .sensor import ForceTorqueSensor, load_regressor, sign_factor

_NAMES = {
    "bias": tuple(f"bias {axis}" for axis in WRENCH),
    "load": ("mass", "m cx", "m cy", "m cz"),
    "inertia": ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
    "turn": ("turn x", "turn y", "turn z"),
    "drift": tuple(f"drift {axis}" for axis in WRENCH),
    "tilt": ("tilt 1", "tilt 2"),
    "delay": ("delay",),
}
_SIZES = {"bias": 1.0, "load": 1.0, "inertia": 0.1, "turn": 0.1, "drift": 1.0, "tilt": 0.1, "delay": 0.1}


@dataclass(frozen=True, eq=False)
class SensorState:
    """Values of the unknowns on which readings depend nonlinearly."""

    mounting: Array = field(default_factory=lambda: np.eye(3))  # R_fs (3, 3)
    tilt: Array = field(default_factory=lambda: np.eye(3))
    """Rotation (3, 3) from the given to the actual gravity, in {w}."""
    delay: float = 0.0  # delay of readings after the poses of the same row [s]
    load: Array | None = None  # (10,) parameters, once estimated
    middle: float | None = None
    """Time [s] to which a drifting bias refers; the middle of the log if None."""


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a fit: bias unless known, mass and first moment always, others if requested.

    ``drift`` is a linear change of the bias, which then refers to the middle of the log. ``tilt`` rotates gravity about
    two level axes of {w}. ``delay`` is the delay of readings after poses.
    """

    bias: bool = True
    inertia: bool = False
    turn: bool = False
    drift: bool = False
    tilt: bool = False
    delay: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """Groups of unknowns, in the order of their columns."""
        return tuple(kind for kind in _NAMES if kind == "load" or getattr(self, kind))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of the design, in order."""
        return tuple(name for kind in self.kinds for name in _NAMES[kind])

    @property
    def scales(self) -> Array:
        """Typical size (p,) of each unknown, to make them comparable."""
        return np.concatenate([np.full(len(_NAMES[kind]), _SIZES[kind]) for kind in self.kinds])

    @property
    def load(self) -> slice:
        """Columns of mass, first moment (and inertia)."""
        start = 6 * self.bias
        return slice(start, start + 4 + 6 * self.inertia)

    @property
    def curved(self) -> Array:
        """Columns (k,) of unknowns on which readings depend nonlinearly."""
        columns = np.arange(len(self.names))
        kinds = [kind for kind in ("turn", "tilt", "delay") if getattr(self, kind)]
        return np.concatenate([columns[:0], *(columns[self.part(kind)] for kind in kinds)])

    def part(self, kind: str) -> slice:
        """Columns of the unknowns of one group."""
        before = self.kinds[: self.kinds.index(kind)]
        start = sum(len(_NAMES[k]) for k in before)
        return slice(start, start + len(_NAMES[kind]))

    def design(self, log: ReadingLog, factor: float, state: SensorState) -> Array:
        """Design matrix A (n, 6, p) of the readings; columns of turn, tilt and delay are zero without a load."""
        load = np.zeros(10) if state.load is None else state.load
        R, world = _world_gravity(log)
        world = world @ state.tilt.T
        Y = factor * load_regressor((R @ world[..., None])[..., 0] if self.tilt else log.gravity, log.V, log.dV)
        columns: dict[str, Array] = {}
        if self.delay:  # F(t - d) changes by -Ḟ
            from scipy.interpolate import CubicSpline

            late, there = CubicSpline(log.clock, Y), log.clock - state.delay
            Y = np.asarray(late(there))
            columns["delay"] = -_in_sensor(np.asarray(late(there, 1)), state.mounting) @ load[:, None]
        Y = _in_sensor(Y, state.mounting)  # F_s = Y π
        columns |= {"bias": np.broadcast_to(np.eye(6), (len(log), 6, 6)), "load": Y[..., :4], "inertia": Y[..., 4:]}
        if self.turn:  # R exp([δ]): the wrench in the turned axes changes by F × δ
            F = Y @ load
            columns["turn"] = np.concatenate([so3.hat(F[:, :3]), so3.hat(F[:, 3:])], axis=1)
        if self.drift:  # b + ḃ (t - t_middle)
            t = log.clock
            middle = 0.5 * (t[0] + t[-1]) if state.middle is None else state.middle
            columns["drift"] = (t - middle)[:, None, None] * np.eye(6)
        if self.tilt:  # g = R' exp([δ]) g_w: it changes by R' (δ × g_w)
            changes = [(R @ so3.cross(axis, world)[..., None])[..., 0] for axis in level_axes(log)]
            turned = [factor * load_regressor(dg) @ load for dg in changes]
            columns["tilt"] = _in_sensor(np.stack(turned, axis=-1), state.mounting)
        return np.concatenate([columns[kind] for kind in self.kinds], axis=-1)

    def moved(self, state: SensorState, log: ReadingLog, x: Array) -> SensorState:
        """State after a Gauss-Newton step x (p,)."""
        load = np.concatenate([x[self.load], np.zeros(10 - len(x[self.load]))])
        mounting, tilt, delay = state.mounting, state.tilt, state.delay
        if self.turn:
            mounting = mounting @ so3.exp(x[self.part("turn")])
        if self.tilt:
            tilt = so3.exp(x[self.part("tilt")] @ level_axes(log)) @ tilt
        if self.delay:
            delay = float(np.clip(delay + float(x[self.part("delay")][0]), -_LATE, _LATE))
        return SensorState(mounting, tilt, delay, load, state.middle)


def level_axes(log: ReadingLog) -> Array:
    """The two most level axes of {w} (2, 3), about which a base may be tilted."""
    g = np.abs(_world_gravity(log)[1][0])
    return np.eye(3)[np.sort(np.argsort(g)[:2])]


def _world_gravity(log: ReadingLog) -> tuple[Array, Array]:
    """R_fw (n, 3, 3), and gravity (n, 3) in {w}."""
    R = np.broadcast_to(np.eye(3), (len(log), 3, 3)) if log.rotations is None else log.rotations
    return np.swapaxes(R, 1, 2), np.asarray((R @ log.gravity[..., None])[..., 0])


def _in_sensor(Y: Array, mounting: Array) -> Array:
    """Transform columns of wrenches (n, 6, k) from {f} to the sensor's axes: F_s = R_fs' F_f."""
    return np.concatenate([mounting.T @ Y[:, :3], mounting.T @ Y[:, 3:]], axis=1)


# ── The fit

_HUBER = 2.0  # scaled distance above which a row loses weight; 1 is the median of inliers
_ROUNDS, _SETTLED = 100, 1e-7
_FEW = 6  # clusters below which the three channels of a kind share a variance
_QUIET = 1e-3  # lower bound of a channel's noise, relative to the mean of its kind
_LATE = 0.5  # longest delay [s] that is tried


@dataclass(frozen=True, eq=False)
class Problem:
    """Problem of a fit: rows, unknowns, and known values."""

    log: ReadingLog  # n rows: means of dwells, and readings in motion
    unknowns: Unknowns
    factor: float  # +1 for readings on the sensor, -1 for readings by it
    bias: Array  # (6,) if known
    noise: Array | None  # (6,) standard deviations of one reading, if known
    count: Array  # (n,) readings in each row
    within: Array  # (6,) variance of a reading within its static pose; zero if unknown
    within_freedom: float
    label: Array  # (n,) cluster of each row
    timed: bool = False  # True if the log has times; False if only an order
    state: SensorState = field(default_factory=SensorState)

    def with_unknowns(self, **changes: bool) -> Problem:
        """Problem with changed unknowns."""
        return replace(self, unknowns=replace(self.unknowns, **changes))

    @property
    def target(self) -> Array:
        """Right-hand side (n, 6) of the fit."""
        return self.log.readings - (0.0 if self.unknowns.bias else self.bias)


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Best-fit unknowns of a log, with their covariance."""

    unknowns: Unknowns
    estimate: Array
    """Estimates (p,) in the order of ``unknowns.names``; turn, tilt and delay are zero, as ``state`` contains them."""
    covariance: Array
    """Sandwich covariance (p, p), for intervals; for the turn, of a small rotation in the sensor's axes [rad]."""
    known: Array  # (p,) degrees of freedom of each unknown's variance
    com_known: Array
    """Degrees of freedom (3,) of first moment minus mass times centre of mass, as used by Fieller's intervals."""
    joint: Array  # (p, p) covariance for joint regions, as if rows were independent; it has full rank
    joint_freedom: float  # degrees of freedom of mass and first moment together
    sigma: Array  # (6,) standard deviation of one reading in a new orientation [N m, N]
    freedom: Array  # (6,) degrees of freedom of sigma; inf if the noise was given
    deviation: Array  # (n, 6) standard deviation of each row
    residuals: Array  # (n, 6) rows minus model
    state: SensorState  # mounting, tilt of gravity and delay
    design: Array  # (n, 6, p)
    leverage: Array
    """Leverage (n, 6) of each row; zero for rows left out."""

    def __repr__(self) -> str:
        return f"<Fit: {', '.join(self.unknowns.names)} from {len(self.residuals)} clusters>"

    @property
    def load(self) -> Array:
        """Ten inertial parameters; the inertia is zero unless it is an unknown."""
        part = self.estimate[self.unknowns.load]
        return np.concatenate([part, np.zeros(10 - len(part))])

    @property
    def mounting(self) -> Array:
        """R_fs (3, 3)."""
        return self.state.mounting

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of one reading's moments [N m] and forces [N], root mean square over three channels."""
        moment, force = np.sqrt((self.sigma.reshape(2, 3) ** 2).mean(axis=1))
        return float(moment), float(force)

    @property
    def mass_deviation(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(np.sqrt(self.covariance.diagonal()[self.unknowns.load.start]))

    def interval(self, name: str, confidence: float) -> tuple[float, float]:
        """Confidence interval of an unknown, in its SI unit; centred on zero for ``turn`` and ``tilt``."""
        k = self.unknowns.names.index(name)
        half = float(student_quantile(self.known[k], confidence)) * math.sqrt(self.covariance[k, k])
        middle = self.state.delay if name == "delay" else float(self.estimate[k])
        return middle - half, middle + half

    @property
    def com_deviation(self) -> Array:
        """Standard deviations (3,) of the centre of mass [m], to first order."""
        part = slice(self.unknowns.load.start, self.unknowns.load.start + 4)
        x, C = self.estimate[part], self.covariance[part, part]
        D = np.hstack([-(x[1:] / x[0])[:, None], np.eye(3)]) / x[0]
        return np.asarray(np.sqrt(np.diag(D @ C @ D.T)))

    def spread(self, rows: Array) -> Array:
        """Standard deviations (2,) of the residuals of moments and forces; always positive."""
        left = np.sqrt((self.residuals[rows].reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))
        return np.maximum(left, 1e-12 * (1e-3 + np.abs(self.residuals).max()))


def few(label: Array) -> bool:
    """True if there are too few clusters to estimate a variance for each channel."""
    return len(np.unique(label)) < _FEW


def fit(problem: Problem, *, keep: Array, huber: bool = False) -> Fit:
    """Fit the rows in the mask ``keep`` (n,), with Huber weights if ``huber``.

    Turn, tilt and delay are found by Gauss-Newton from ``problem.state``; the other unknowns are linear. The variance
    of a row of count readings is v = τ + w / count, with w the variance within dwells. For each channel, τ makes the
    mean square of the residuals equal to v, corrected for the degrees of freedom.
    """
    unknowns, log, target = problem.unknowns, problem.log, problem.target
    t, curved = log.clock, unknowns.curved
    state = replace(problem.state, middle=0.5 * float(t[0] + t[-1]))
    groups = np.repeat([0, 1], 3) if few(problem.label[keep]) else np.arange(6)
    share = 1.0 / problem.count[:, None]
    own = problem.within * share
    least = np.maximum(0.1 * own, (1e-13 * (np.abs(target).max() + 1e-3)) ** 2)
    if problem.noise is None:
        v = np.tile(np.repeat([0.03**2, 1.0], 3), (len(log), 1))
    else:
        v = problem.noise**2 * share
    freedom, weight = np.full(6, math.inf), keep.astype(float)
    A = unknowns.design(log, problem.factor, state)
    round_ = 0
    while True:
        if curved.size and round_:
            A = unknowns.design(log, problem.factor, state)
        used = weight * _inside(log, state.delay) if unknowns.delay else weight
        root = np.sqrt(used)[:, None] / np.sqrt(v)
        x, half, Q = orthogonal_fit(A, target, root, unknowns.scales)
        residuals = target - A @ x
        before, weighed = v, weight
        if problem.noise is None:
            tau, freedom = _between(residuals, Q, v, used, keep, own, groups, huber=huber)
            v = np.maximum(tau + own, least)
        if huber:
            weight = keep * huber_weights(np.sqrt(np.mean(residuals**2 / v, axis=1)), _HUBER)
        moved = max(float(np.abs(v / before - 1.0).max()), float(np.abs(weight - weighed).mean()))
        if curved.size:
            state = unknowns.moved(state, log, x)
            moved = max(moved, float(np.abs(x[curved]).max()), float(round_ == 0))
            x[curved] = 0.0
        round_ += 1
        if round_ == _ROUNDS or (moved < (1e-3 if huber else _SETTLED) and (round_ > 1 or not huber)):
            break
    covariances = _covariances(problem, x, half, Q, (residuals * root)[keep], freedom, groups, keep)
    sigma = problem.noise
    if sigma is None:
        sigma, freedom = _of_one(problem, v, keep, freedom)
    deviation, leverage = np.sqrt(v), (Q * Q).sum(axis=2)
    return Fit(unknowns, x, *covariances, sigma, freedom, deviation, residuals, state, A, leverage)


def _covariances(
    problem: Problem, x: Array, half: Array, Q: Array, left: Array, freedom: Array, groups: Array, keep: Array
) -> tuple[Array, Array, Array, Array, float]:
    """Sandwich covariance, degrees of freedom of unknowns and centre of mass, joint covariance and its freedom.

    ``left`` (m, 6) are the whitened residuals of the kept rows.
    """
    p, load = len(x), problem.unknowns.load
    m, h = load.start, slice(load.start + 1, load.start + 4)
    rows = np.concatenate([half, half[h] * x[m] - np.outer(x[h], half[m])])
    C, known = channel_covariance(Q, rows, freedom, groups)
    joint = C[:p, :p]
    joint_freedom = f_test_freedom(channel_covariance(Q, half[m : m + 4], weight_freedom(freedom), groups)[1])
    if problem.noise is None:
        label = problem.label[keep]
        added = half @ variance_estimate_covariance(Q, freedom, groups) @ half.T
        if not few(label) and (sandwich := cluster_robust_covariance(Q[keep], left, rows, label)) is not None:
            C, known = sandwich
        C, joint = C[:p, :p] + added, joint + added
        size = np.unique(label, return_counts=True)[1]
        # Only the sandwich accounts for autocorrelated rows. Fully correlated rows of a cluster give the largest ratio
        # (Kish, Survey Sampling, 1965, section 5.4); larger values are noise of the sandwich.
        ratio = float((np.diag(C) / np.diag(joint))[load].mean())
        joint = joint * min(max(1.0, ratio), float((size**2).sum() / size.sum()))
    return C[:p, :p], known[:p], known[p:], joint, joint_freedom


def _of_one(problem: Problem, v: Array, keep: Array, freedom: Array) -> tuple[Array, Array]:
    """Standard deviation (6,) of one reading in a new orientation, and its degrees of freedom (6,).

    σ² = v + w (1 - 1 / count): the variance of rows, plus the part that averaging removed.
    """
    lost = problem.within * (1.0 - float((1.0 / problem.count[keep]).mean()))
    mean = v[keep].mean(axis=0)
    return np.sqrt(mean + lost), sum_freedom(
        np.stack([mean, lost]), np.stack([freedom, np.full(6, problem.within_freedom)])
    )


def _inside(log: ReadingLog, delay: float) -> Array:
    """1.0 for rows (n,) whose poses a delay earlier lie within the log."""
    t = log.clock
    near = 2 * float(np.median(np.diff(t)))
    return ((t - delay > t[0] - near) & (t - delay < t[-1] + near)).astype(float)


def _between(
    residuals: Array, Q: Array, v: Array, weight: Array, keep: Array, own: Array, groups: Array, *, huber: bool
) -> tuple[Array, Array]:
    """Variance τ (6,) of rows in excess of their ``own`` (n, 6), and its degrees of freedom (6,)."""
    used = (weight > 0)[:, None] if not huber else keep[:, None]
    loose = used * (1.0 - (Q * Q).sum(axis=2))  # 1 - leverage
    freedom = np.maximum(_pooled(loose.sum(axis=0), groups), 1e-9)
    if huber:  # median: robust if up to half of the rows are outliers
        shared = int(groups[-1]) == 1  # three channels of a kind share a variance
        size = np.abs(residuals[keep])
        size = np.repeat(np.median(size.reshape(-1, 2, 3), axis=(0, 2)), 3) if shared else np.median(size, axis=0)
        tau = (MAD * size) ** 2 * keep.sum() * np.bincount(groups)[groups] / np.maximum(freedom, 1.0)
        tau = np.maximum(tau - np.median(own[keep], axis=0), 0.0)
    else:
        weights = used / v**2
        tau = _pooled((weights * (residuals**2 - own * loose)).sum(axis=0), groups)
        tau = tau / np.maximum(_pooled((weights * loose).sum(axis=0), groups), 1e-300)
    most = np.repeat(np.maximum(tau, 0.0).reshape(2, 3).max(axis=1), 3)
    return np.maximum(tau, np.where(own.any(), -np.inf, _QUIET**2 * most)), freedom


def _pooled(x: Array, groups: Array) -> Array:
    """Sum over the channels of each group (6,)."""
    return np.bincount(groups, x)[groups]


# ── Uncertainty of a sensor, and of new readings

_KINDS = ("bias", "load", "inertia", "turn")  # unknowns of the sensor; drift, tilt and delay belong to one log


_ASYMMETRY = 1e-6
"""Largest difference of mirrored entries of a covariance, as a share of the product of their standard deviations."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a sensor: covariance of its unknowns, and noise of a reading, with degrees of freedom."""

    unknowns: tuple[str, ...]
    """Names of the p identified unknowns of bias, load, inertia and mounting."""
    covariance: Array
    """Covariance (p, p) of the unknowns."""
    freedom: Array
    """Degrees of freedom (p,) of their variances."""
    noise: Array
    """Standard deviation (6,) of one reading in a new orientation, including pose errors [N m, N]."""
    noise_freedom: Array
    """Degrees of freedom (6,) of the noise variances; inf if the noise was given."""

    def __post_init__(self) -> None:
        p = len(self.unknowns)
        if self._kinds.names != self.unknowns:
            raise ValueRangeError(f"the unknowns {', '.join(self.unknowns)} are not those of a sensor.")
        for name, shape in (("covariance", (p, p)), ("freedom", (p,)), ("noise", (6,)), ("noise_freedom", (6,))):
            x = np.asarray(getattr(self, name), float)
            whole = np.isfinite(x) | (x == np.inf) if "freedom" in name else np.isfinite(x)
            if x.shape != shape or not whole.all() or (name != "covariance" and (x < 0).any()):
                raise ValueRangeError(
                    f"{name} is not {shape} numbers" + ("." if name == "covariance" else " from 0 on.")
                )
            object.__setattr__(self, name, x)
        if not (np.diagonal(self.covariance) > 0).all():
            raise ValueRangeError("covariance is not valid: a variance on its diagonal is not above 0.")
        scale = _outer(self.covariance)
        if (np.abs(self.covariance - self.covariance.T) > _ASYMMETRY * scale).any():
            raise ValueRangeError("covariance is not valid: it is not symmetric.")
        if p and np.linalg.eigvalsh(self.covariance / scale).min() < -1e-9:
            raise ValueRangeError("covariance is not valid: it has a negative eigenvalue.")

    @property
    def _kinds(self) -> Unknowns:
        has = set(self.unknowns)
        return Unknowns(bias="bias mx" in has, inertia="Ixx" in has, turn="turn x" in has)

    def predictive(self, log: ReadingLog, sensor: ForceTorqueSensor) -> Array:
        """Predictive covariance of compensated readings without contact: S = diag σ² + A C A'.

        Parameters
        ----------
        log : ReadingLog
        sensor : ForceTorqueSensor

        Returns
        -------
        S : (n, 6, 6) array, in products of the units (N m, N)

        Examples
        --------
        >>> from twistwrench import SpatialInertia, sensing
        >>> tool = sensing.ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)))
        >>> log = sensing.simulate(tool, 12)
        >>> found = sensing.identify(log)
        >>> found.uncertainty.predictive(log, found.sensor).shape
        (12, 6, 6)
        """
        state = SensorState(np.asarray(sensor.mounting), load=sensor.load.parameters.astype(float))
        A = self._kinds.design(log, sign_factor(sensor.sign), state)
        return np.asarray(np.diag(self.noise**2) + A @ self.covariance @ np.swapaxes(A, 1, 2))


def uncertainty_of(fit: Fit) -> Uncertainty:
    """Uncertainty of a fit's sensor: unknowns of the log are marginalised."""
    kinds = [kind for kind in fit.unknowns.kinds if kind in _KINDS]
    places = np.concatenate([np.arange(*fit.unknowns.part(kind).indices(len(fit.estimate))) for kind in kinds])
    names = tuple(fit.unknowns.names[k] for k in places)
    C = fit.joint[np.ix_(places, places)]
    return Uncertainty(names, C, fit.known[places], fit.sigma, fit.freedom)


def _outer(C: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(C), 1e-300))
    return np.outer(size, size)
