"""Search for the causes of what a fit leaves: one column or one refit for each cause, judged by rows held out.

With s_j² the mean square of the residual of joint j in fifths of the time that were held out, a cause makes

    S = Σ_j log(s_j² without it / s_j² with it),

the criterion that settings are chosen by, in which each joint counts alike. Its significance is that of the mean of the
differences of log-likelihood d_b over blocks b of time (Vuong, "Likelihood ratio tests for model selection and non-nested
hypotheses", Econometrica 57, 1989), against Student's t at 0.01 divided by the number of causes that are tried (Bonferroni).
A column e is fitted beside the groups; a cause that is not linear is found by Gauss and Newton's steps with its column

    e = d(τ̂ of the corrected log)/dβ.

Its interval is β ± t √(Σ_b u_b²) / Σ e⊥' Λ e⊥,  u_b = Σ_{t in b} e⊥' Λ r, with e⊥ the column less its projection on W and r
held out (Liang and Zeger, Biometrika 73, 1986). Values of several causes are estimated together at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from ..estimation.covariance import autocorrelation_length, student_quantile
from ..estimation.cross_validation import FOLDS
from ..estimation.least_squares import MAD, NormalEquations, Prior
from ..typing import Array
from . import causes
from .causes import Cause, FittedTorques, Law, LogStates
from .hyperparameters import SPEEDS, FitSettings
from .parameters import BaseParameters, UnknownParameters
from .rows import SteadySamples

LEAST_S = 0.25
"""S from which a cause is raised: of 56 clean logs none had more than 0.19."""
_CHANCE = 0.01
_FLOOR = 0.005
"""Share of a joint's torque (rms) below which no residual counts."""
_ROUNDS = 3
_DISCRETE = 0.03, 0.06
"""Residuals of all joints and of any one, as shares of their torques, from which discrete causes are tried."""
_SUSPECTS = 8
"""Joints with the largest residuals, of which discrete causes are tried."""
_SECONDS, _LENGTHS = (1.0, 2.5), 5.0
"""Shortest and longest blocks of time [s], and lengths of the residuals' correlation in a block: other causes make it long."""
_STEPS, _WORTH = 5, 0.005
_REFINED, _STARTED = 5, 3
_UNTOLD = 1e-7
_TIE, _TIE_SHARE, _NEAR = 0.05, 0.03, 0.7
_ORDER = {"gain": 0, "zero": 1, "tilt": 2, "late": 3, "low-pass": 4}
"""Preference among causes that explain as much: the first."""
_POSITIVE = ("elasticity", "load-friction", "low-pass", "stribeck")
_STATES = 200
_PUSHED, _MOST_PUSHED, _BY_FORCE = 5.0, 0.25, 0.5
"""Times the usual residual, most of the rows, and least share of squares that one force explains, of a push."""
_SWAYS = 0.5
"""Share of the squares of all joints that a base that sways explains at least: it moves all of them."""
_ASKEW = np.array([0.31, -0.27, -0.911]) / np.linalg.norm([0.31, -0.27, -0.911])
"""Direction of gravity along no axis, so that groups are those of any mounting."""
_HIGHEST, _SLOWEST = 10.0, 0.1
"""Cut-off [Hz] and speed of friction at most."""
_FEWEST, _MOST = 300, 1200
_LEAST_ROWS, _PER_GROUP = 40, 3
"""Rows, and equations for each group, from which causes are sought."""
_NUMBERS = 5e6  # entries of rows at most


class CauseFit:
    """Fit of the rows of states, with columns of laws (m, nv) beside those of the groups, and its residuals held out.

    Residuals ``left`` (m, nv) are in units of √(1 + w' C w / σ²), with C the covariance of the parameters from the other
    fifths: rows that these do not determine say nothing.
    """

    def __init__(self, states: LogStates, prior: Prior, live: Array, laws: Sequence[Array] = ()) -> None:
        self.states, self.live, self.laws, self._groups = states, live, tuple(laws), prior
        tau = states.measured
        W = np.concatenate([states.columns, *(e[..., None] for e in laws)], axis=2) if laws else states.columns
        W, tau = np.asarray(W * live[:, None]), np.asarray(tau * live)
        self.W, self.tau = W, tau
        size = np.sqrt((tau**2).mean(axis=0))
        if laws:
            usual = [float(size.max() / max(np.abs(e).max(), 1e-9)) for e in laws]
            prior = Prior(np.append(prior.mean, 0.0 * np.array(usual)), np.append(prior.size, 1e2 * np.array(usual)))
        felt = np.concatenate([states.base.felt, *((e != 0.0).any(axis=0)[:, None] for e in laws)], axis=1)
        edges = np.linspace(0, len(tau), FOLDS + 1).astype(int)
        self.folds = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        parts = [NormalEquations.from_rows(W, tau, felt, rows=fold) for fold in self.folds]
        total = sum(parts[1:], parts[0])
        self.x, sigma = total.solve(prior)
        self.weight = live / sigma**2
        self._inverse, self._held = [], []
        for part in [*parts, None]:
            rest = total if part is None else total - part
            A = np.einsum("jkl,j->kl", rest.N, self.weight)
            c = (rest.c * self.weight[:, None]).sum(axis=0)
            scaled = A * prior.size[:, None] * prior.size + np.eye(len(c))
            inverse = prior.size[:, None] * np.linalg.inv(scaled) * prior.size
            self._inverse.append(inverse)
            self._held.append(prior.mean + inverse @ (c - A @ prior.mean))
        self.spread = np.ones(tau.shape)
        for f, inverse in zip(self.folds, self._inverse[:-1], strict=True):
            for j in np.flatnonzero(live):
                A = W[f, j][:, felt[j]]
                self.spread[f, j] += self.weight[j] * ((A @ inverse[np.ix_(felt[j], felt[j])]) * A).sum(axis=1)
        self.spread = np.sqrt(self.spread)
        left = np.concatenate([tau[f] - W[f] @ x for f, x in zip(self.folds, self._held[:-1], strict=True)])
        self.left = left / self.spread
        self.floor = (_FLOOR * size) ** 2 + 1e-300

    def refit(self, states: LogStates, *laws: Array) -> CauseFit:
        """Fit of other states, with more laws."""
        return CauseFit(states, self._groups, self.live, (*self.laws, *laws))

    @property
    def enough(self) -> bool:
        """True if there are rows enough for causes to be sought."""
        count, groups = len(self.tau), self.states.base.count
        return count >= _LEAST_ROWS and count * int(self.live.sum()) >= _PER_GROUP * groups

    @cached_property
    def squares(self) -> Array:
        """(nv,) mean squares of the residuals held out."""
        return np.asarray((self.left**2).mean(axis=0) + self.floor)

    @cached_property
    def shares(self) -> Array:
        """(nv,) residuals held out as shares of the torques."""
        return np.sqrt(self.squares / np.maximum((self.tau**2).mean(axis=0), 1e-300)) * self.live

    def gained(self, other: CauseFit) -> float:
        """S of a fit with a cause."""
        volume = np.log(self.spread / other.spread).mean(axis=0)
        return float((np.log(self.squares / other.squares) + 2.0 * volume)[self.live].sum())

    def gained_by(self, columns: Array) -> tuple[float, Array]:
        """S of more columns (m, nv, k), at the weights of this fit, and their coefficients (k,)."""
        left, beta = self.with_columns(columns)
        return float(np.log(self.squares / ((left**2).mean(axis=0) + self.floor))[self.live].sum()), beta

    def with_columns(self, e: Array) -> tuple[Array, Array]:
        """Residuals held out (m, nv) and coefficients (k,) of more columns (m, nv, k), at the weights of this fit."""
        v, a, c = [], [], []
        for f in self.folds:
            weighted = e[f] * self.weight[:, None]
            flat = weighted.reshape(-1, e.shape[2])
            v.append(self.W[f].reshape(len(flat), -1).T @ flat)
            a.append(e[f].reshape(flat.shape).T @ flat)
            c.append(self.tau[f].ravel() @ flat)
        left, beta = self.left.copy(), np.zeros(e.shape[2])
        for b, (inverse, x) in enumerate(zip(self._inverse, self._held, strict=True)):
            border, size, right = (sum(part[k] for k in range(FOLDS) if k != b) for part in (v, a, c))
            moved = inverse @ border
            own = size - border.T @ moved
            if (own.diagonal() <= _UNTOLD * size.diagonal()).any():
                return self.left, np.zeros(e.shape[2])
            beta = np.linalg.solve(own, right - border.T @ x)
            if b < FOLDS:
                f = self.folds[b]
                left[f] = self.left[f] - (e[f] - self.W[f] @ moved) @ beta / self.spread[f]
        return left, beta

    def change(self, e: Array, beta: Array) -> Array:
        """(r,) by how much the groups are moved by columns (m, nv, k) with coefficients (k,) beside them."""
        v = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        return np.asarray(-(self._inverse[-1] @ v @ beta)[: self.states.base.count])

    @cached_property
    def joint_causes(self) -> list[ScreenedCause]:
        """Laws of the joints and their elasticity, each by its column."""
        return _screened_laws(self) if self.enough else []

    def deviation(self, e: Array) -> Array:
        """Deviations (k,) of the coefficients of columns (m, nv, k) whose values this fit has, by blocks of time."""
        v = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        across = e - self.W @ (self._inverse[-1] @ v)
        size = np.linalg.pinv(np.einsum("mjk,mjl,j->kl", across, across, self.weight, optimize=True))
        return self._block_deviation(across @ size)

    @property
    def law_deviation(self) -> Array:
        """Deviation (1,) of the coefficient of the last law."""
        return self._block_deviation((self.W @ self._inverse[-1][:, -1])[..., None])

    def _block_deviation(self, influence: Array) -> Array:
        """Deviations (k,) of Σ influence' Λ r, with r held out, which the fit takes part of away from its own rows.

        The larger of two: by blocks of time, few of which may hold most of it; by rows and the length of their correlation.
        """
        u = np.einsum("mjk,mj,j->mk", influence, self.left * self.spread, self.weight, optimize=True)
        by_blocks = (np.add.reduceat(u, self.blocks, axis=0) ** 2).sum(axis=0)
        return np.sqrt(np.maximum(by_blocks, self.correlation * (u**2).sum(axis=0)))

    @cached_property
    def correlation(self) -> float:
        """Integrated autocorrelation time of the residuals, in rows."""
        return autocorrelation_length(self.left / np.sqrt(self.squares))

    @cached_property
    def blocks(self) -> Array:
        """First rows of blocks of time, five autocorrelation lengths of the residuals long, of a second to 2.5."""
        s = self.states
        step = float(np.median(np.diff(s.time[s.rows]))) if len(s.rows) > 1 else 1.0
        length = max(_SECONDS[0] / step, min(_SECONDS[1] / step, _LENGTHS * self.correlation))
        count = max(2, int(len(self.left) / length))
        return np.linspace(0, len(self.left), count + 1).astype(int)[:-1]

    def sure(self, tried: int) -> float:
        """Student's t that one of so many causes exceeds by chance once in a hundred logs."""
        return float(student_quantile(max(1.0, len(self.blocks) - 1.0), 1.0 - _CHANCE / max(1, tried)))

    def t_value(self, before: CauseFit) -> float:
        """Mean over deviation of the block differences of log-likelihood against a fit without the cause."""
        a, b = before.squares, self.squares
        volume = 2.0 * np.log(before.spread / self.spread)
        d = 0.5 * (before.left**2 / a - self.left**2 / b + np.log(a / b) + volume)[:, self.live].sum(axis=1)
        sums = np.add.reduceat(d, self.blocks)
        return float(sums.mean() / max(sums.std(ddof=1) / np.sqrt(len(sums)), 1e-300))


@dataclass(frozen=True, eq=False)
class ScreenedCause:
    """Cause by its columns e (m, nv, k) alone, with β and S at the weights of the fit without it."""

    S: float
    cause: Cause | Law
    beta: Array
    e: Array


@dataclass(frozen=True, eq=False)
class FoundCause:
    """Cause of a residual, with the evidence of rows held out.

    Attributes
    ----------
    kind : str
    joints : tuple of int
    S, t : float, statistic and its significance
    before, fit : CauseFit, without the cause and with it
    correct : callable, takes the cause off states
    value, deviation : array, of β, which ``correct`` has as its default; None for a cause without a value
    """

    kind: str
    joints: tuple[int, ...]
    S: float
    t: float
    before: CauseFit
    fit: CauseFit
    correct: Callable[..., LogStates] | None = None
    law: Law | None = None
    value: Array | None = None
    deviation: Array | None = None
    effect: float = 0.0
    rivals: tuple[FoundCause, ...] = ()
    number: float | None = None
    """Value of a discrete cause, in its unit."""
    step: float = 0.0
    """Step of β in finite differences."""
    cost: float = 0.0
    span: tuple[float, float] | None = None
    """Times [s] between which it acts."""
    size: float | None = None
    """Acceleration of a base that sways [m/s²]."""

    @property
    def most(self) -> tuple[int, float]:
        """Joint whose residual it takes most of, and that share of its squares."""
        share = np.where(self.fit.live, 1.0 - self.fit.squares / self.before.squares, 0.0)
        return int(share.argmax()), float(share.max())

    @property
    def in_units(self) -> tuple[float | None, tuple[float, float] | None]:
        """Value and 95 % interval in the unit of the table: degrees, ms, Hz, per cent; factors for gains."""
        if self.value is None or self.deviation is None:
            return self.number, None
        t = float(student_quantile(max(1.0, len(self.fit.blocks) - 1.0), 0.95))
        return causes.in_units(self.kind, self.value, t * self.deviation)


def log_fit(
    unknown: UnknownParameters, samples: Sequence[SteadySamples], settings: FitSettings, dead: Array
) -> CauseFit:
    """Fit to the rows of logs that causes are sought in."""
    base = askew_base(unknown)
    nv, cutoff = unknown.model.nv, min(settings.cutoff, _HIGHEST)
    most = max(_FEWEST, min(_MOST, _NUMBERS / (nv * base.count)))
    speed = np.minimum(settings.friction_speed, _SLOWEST)
    s = LogStates.from_samples(base, samples, cutoff, speed, most).changed(shift=settings.shift)
    size = [np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-6) for x in (s.tau, s.dq, s.ddq)]
    sizes = unknown.scales(*(np.maximum(x, 1e-2 * np.median(x)) for x in size))
    prior = Prior(base.project(unknown.file_values), base.weak_sizes(sizes))
    return CauseFit(s, prior, ~dead)


def askew_base(unknown: UnknownParameters) -> BaseParameters:
    """Groups of the robot mounted askew, which are those of any mounting."""
    return BaseParameters.from_unknowns(unknown, gravity=np.linalg.norm(unknown.model.gravity) * _ASKEW)


def estimated(fit: CauseFit, tried: Iterable[Cause]) -> FoundCause:
    """The best of some causes, at the value that explains the rows held out best, however little that is."""
    s, found = fit.states, list[FoundCause]()
    for cause in tried:
        if not cause.step:
            found.append(_judged(fit, fit.refit(cause.correct(s)), cause))
            continue
        # A step from far away promises more than it keeps.
        screened = sorted(_screened(fit, [cause]), key=lambda one: -one.S)[:_STARTED]
        found += [_refined(fit, cause, one.beta) for one in screened]
    return max(found, key=lambda one: one.S)


def diagnose(start: CauseFit) -> tuple[list[FoundCause], CauseFit]:
    """Causes of what a fit leaves, in the order in which they are found, and the fit before laws of joints were put in.

    Each cause is put in before the next is sought.
    """
    found, fit, before = list[FoundCause](), start, start
    if not start.enough:
        return found, start
    if push := _push(fit):
        found.append(replace(push, effect=effect(fit, push)))
        fit = push.fit
    for stage in (_of_the_log, _of_the_joints):
        before = fit = _at_best_speed(fit)
        for _ in range(_ROUNDS):
            tried, count = stage(fit)
            best = _first(fit, tried, count)
            if best is None:
                break
            found.append(best)
            fit = best.fit
    return _together(start, found), before


def _together(start: CauseFit, found: list[FoundCause]) -> list[FoundCause]:
    """Values of several causes, estimated at once: each was estimated before the later ones were known.

    A cause that was found again, for its rest, is one with the first.
    """
    first: dict[tuple[str, tuple[int, ...]], int] = {}
    begin: dict[int, Array] = {}
    for k, one in enumerate(found):
        mine = first.setdefault((one.kind, one.joints), k)
        if one.correct is not None and one.value is not None:
            begin[mine] = one.value + begin.get(mine, 0.0)
    moved = {k: off for k in first.values() if (off := found[k].correct) is not None}
    if len(moved) < 2 or not begin:
        return found
    ends = np.cumsum([0, *(len(beta) for beta in begin.values())]).tolist()
    place = {k: slice(a, b) for k, (a, b) in zip(begin, pairwise(ends), strict=True)}

    def correct(s: LogStates, beta: Array) -> LogStates:
        for k, off in moved.items():
            s = off(s, beta=beta[place[k]]) if k in place else off(s)
        return s

    last = found[-1].fit
    s = start.states.changed(rows=last.states.rows, friction_speed=last.states.friction_speed)
    step = min(found[k].step for k in begin)
    cause = Cause("", (), correct, step, ends[-1])
    refined = _refined(last.refit(s), cause, np.concatenate(list(begin.values())))
    for k, part in place.items():
        value, deviation = np.asarray(refined.value)[part], np.asarray(refined.deviation)[part]
        found[k] = replace(found[k], value=value, deviation=deviation, correct=partial(moved[k], beta=value))
    return [found[k] for k in first.values()]


def law_changes(fit: CauseFit) -> Array:
    """(k, p) by how much unknown parameters change with the law that explains most, and with the strongest of each joint."""
    base, told = fit.states.base, sorted((one for one in fit.joint_causes if one.S > 0), key=lambda one: -one.S)
    strongest = {one.cause.joints: one for one in reversed(told) if len(one.cause.joints) == 1} | {
        one.cause.joints: one for one in told[:1]
    }
    found = np.zeros((len(strongest), len(base.unknown.names)))
    for k, one in enumerate(strongest.values()):
        found[k, base.kept] = fit.change(one.e, one.beta)
    return found


def _at_best_speed(fit: CauseFit) -> CauseFit:
    """The fit at the speed of friction, alike in all joints, that explains most, if that is better by more than chance."""
    others = [fit.refit(fit.states.changed(friction_speed=np.full(len(fit.live), speed))) for speed in SPEEDS]
    best = max(others, key=fit.gained)
    return best if fit.gained(best) > _WORTH else fit


def _first(fit: CauseFit, tried: Sequence[FoundCause], count: int) -> FoundCause | None:
    """The cause with the largest S, if it is significant, with those that explain as much."""
    told = [one for one in tried if one.S >= LEAST_S and one.t >= one.fit.sure(count) and _possible(one)]
    if not told:
        return None
    most = max(one.S - one.cost for one in told)
    told = [_at_its_speed(fit, one) for one in told if one.S - one.cost >= _NEAR * most]
    most = max(one.S - one.cost for one in told)
    best, *rivals = (one for one in told if one.S - one.cost >= most - max(_TIE, _TIE_SHARE * most))
    return replace(best, rivals=tuple(rivals), effect=effect(fit, best))


def _at_its_speed(fit: CauseFit, found: FoundCause) -> FoundCause:
    """The cause with the speed of friction that fits best beside it: without it another one may have."""
    refit = _at_best_speed(found.fit)
    return replace(found, fit=refit, S=fit.gained(refit), t=refit.t_value(fit))


def _possible(found: FoundCause) -> bool:
    """True unless the value has a sign that nothing has: links do not run ahead of their motors."""
    return found.kind not in _POSITIVE or found.value is None or bool(found.value[0] > 0)


def _push(fit: CauseFit) -> FoundCause | None:
    """Rows of 0.3 s at least whose residuals are five times those of the others, as a force on the tip makes them."""
    s, rest, robot = fit.states, fit, fit.states.base.unknown.robot
    if robot.model.tip is None:
        return None
    left, runs, sigma = fit.left, list[tuple[int, int]](), np.ones(len(fit.live))
    for _ in range(2):  # at first the push is in the fit as well
        sigma = MAD * np.median(np.abs(left), axis=0) + np.sqrt(fit.floor)
        size = np.sqrt(((left / sigma)[:, fit.live] ** 2).mean(axis=1))
        runs = causes.runs(s.time[s.rows], s.piece[s.rows], size > _PUSHED * np.median(size))
        kept = np.ones(len(s.rows), bool)
        for a, b in runs:
            kept[a:b] = False
        if not 1.0 - _MOST_PUSHED < kept.mean() < 1.0:
            return None
        rest = fit.refit(s.changed(rows=s.rows[kept]))
        left = fit.tau - fit.W @ rest.x
    a, b = max(runs, key=lambda run: run[1] - run[0])
    J = np.asarray(robot.jacobian(s.q[s.rows[a:b]], kind="world_aligned"))[:, 3:]
    # τ = J' f, with f constant in the world's axes
    A = (J / sigma).swapaxes(1, 2)[:, fit.live].reshape(-1, 3)
    y = (left[a:b] / sigma)[:, fit.live].ravel()
    f, *_ = np.linalg.lstsq(A, y, rcond=None)
    if float(((y - A @ f) ** 2).sum()) > (1.0 - _BY_FORCE) * float(y @ y):
        return None
    span = float(s.time[s.rows[a]]), float(s.time[s.rows[b - 1]])
    return FoundCause("push", (), np.inf, np.inf, fit, rest, number=float(np.linalg.norm(f)), span=span)


def _sway(fit: CauseFit) -> tuple[list[FoundCause], int]:
    """Acceleration of the base along two horizontal axes at one frequency, that at which most of it is.

    Row by row the residual is W(e_x) x a_x + W(e_y) x a_y; columns of its cosine and sine are fitted together.
    """
    s = fit.states
    if not s.gravity.any() or len(s.pieces) != 1:
        return [], 0
    x = fit.x[: s.base.count]
    level = np.linalg.svd(s.gravity[None])[2][1:]
    still = s.changed(dq=0.0 * s.dq, ddq=0.0 * s.ddq)
    e = [(still.changed(gravity=s.gravity - g).columns - still.columns) @ x * fit.live for g in level]
    A = np.stack(e, axis=-1) * np.sqrt(fit.weight)[:, None]
    y = (fit.left * np.sqrt(fit.weight))[..., None]
    N = A.swapaxes(1, 2) @ A
    N += np.trace(N, axis1=1, axis2=2).mean() * 1e-2 * np.eye(2)
    a = np.linalg.solve(N, A.swapaxes(1, 2) @ y)[..., 0]
    time = s.time[s.rows]
    power = (np.abs(np.fft.rfft(a - a.mean(axis=0), 4 * len(a), axis=0)) ** 2).sum(axis=1)
    hertz = float(np.fft.rfftfreq(4 * len(a), float(np.median(np.diff(time))))[int(power[1:].argmax()) + 1])
    waves = (np.cos(2 * np.pi * hertz * time), np.sin(2 * np.pi * hertz * time))
    columns = [column * wave[:, None] for column in e for wave in waves]
    refit = fit.refit(s, *columns)
    if float((refit.left**2).sum()) > (1.0 - _SWAYS) * float((fit.left**2).sum()):
        return [], 1
    size = float(np.linalg.norm(refit.x[-len(columns) :]))
    S = fit.gained(refit)
    return [FoundCause("swaying", (), S, refit.t_value(fit), fit, refit, number=hertz, size=size)], 1


def _of_the_log(fit: CauseFit) -> tuple[list[FoundCause], int]:
    """Stages 2 and 3: refits of discrete causes where much is left, and of the continuous ones whose column gains most."""
    s, found, count = fit.states, list[FoundCause](), 0
    total = float(np.sqrt((fit.left**2).sum() / max(float((fit.tau**2).sum()), 1e-300)))
    much = total > _DISCRETE[0] or float(fit.shares.max()) > _DISCRETE[1]
    if much:
        worst = np.argsort(-fit.shares)[:_SUSPECTS]
        for cause in causes.discrete_causes(s, sorted(worst.tolist())):
            found.append(_judged(fit, fit.refit(cause.correct(s)), cause))
            count += 1
    screened = _screened(fit, causes.continuous_causes(s, wide=much))
    return found + _refined_causes(fit, screened), count + len(screened)


def _of_the_joints(fit: CauseFit) -> tuple[list[FoundCause], int]:
    """Stage 4: laws of the joints, by their columns, and their elasticity."""
    found, screened = list[FoundCause](), sorted(fit.joint_causes, key=lambda one: -one.S)
    laws = [(one, one.cause) for one in screened if isinstance(one.cause, Law)]
    for one, law in laws[:_REFINED]:
        if one.S > 0.5 * LEAST_S:
            refit = fit.refit(fit.states, one.e[..., 0])
            value, deviation = refit.x[-1:], refit.law_deviation
            told = FoundCause(law.kind, law.joints, fit.gained(refit), refit.t_value(fit), fit, refit)
            found.append(replace(told, law=law, value=value, deviation=deviation))
    elastic = _refined_causes(fit, [one for one in screened if isinstance(one.cause, Cause)])
    swaying, more = _sway(fit)
    return found + elastic + swaying, len(screened) + more


def _screened_laws(fit: CauseFit) -> list[ScreenedCause]:
    """Laws of the joints and their elasticity, each by its column."""
    s, found = fit.states, list[ScreenedCause]()
    fitted = FittedTorques.from_groups(s, fit.x[: s.base.count])
    for law in causes.laws(s):
        e = (s.filtered(law.column(s, fitted))[s.rows] * fit.live)[..., None]
        if e.any():
            S, beta = fit.gained_by(e)
            found.append(ScreenedCause(S, law, beta, e))
    return found + _screened(fit, causes.compliances(s, s.filtered(fitted.whole)))


def _screened(fit: CauseFit, tried: Iterable[Cause]) -> list[ScreenedCause]:
    """Causes with a value, by their columns at each of the values that they start from."""
    s, found = fit.states, list[ScreenedCause]()
    for cause in tried:
        for start in cause.starts:
            beta = np.full(cause.size, start)
            at = fit if start == 0.0 else fit.refit(cause.correct(s, beta))
            e = _columns(at, s, cause, beta)
            S, step = at.gained_by(e)
            found.append(ScreenedCause(fit.gained(at) + S if at is not fit else S, cause, beta + step, e))
    return found


def _refined_causes(fit: CauseFit, screened: Sequence[ScreenedCause]) -> list[FoundCause]:
    """Causes with a value whose columns gain most, refined by Gauss and Newton's steps."""
    found = dict[tuple[str, tuple[int, ...]], FoundCause]()
    for one in sorted(screened, key=lambda one: -one.S):
        if one.S < 0.5 * LEAST_S or len(found) == _REFINED:
            break
        cause = one.cause
        if isinstance(cause, Cause) and (cause.kind, cause.joints) not in found:
            found[cause.kind, cause.joints] = _refined(fit, cause, one.beta)
    return sorted(found.values(), key=lambda one: _ORDER.get(one.kind, 0))


def _columns(fit: CauseFit, s: LogStates, cause: Cause, beta: Array) -> Array:
    """-d(residual)/dβ (m, nv, k) by central differences, at the unknowns of the fit."""
    x, found = fit.x[: fit.W.shape[2] - len(fit.laws)], []
    for axis in np.eye(cause.size):
        ends = [cause.correct(s, beta + way * cause.step * axis) for way in (1.0, -1.0)]
        plus, minus = (one.columns @ x - one.measured for one in ends)
        found.append((plus - minus) / (2.0 * cause.step) * fit.live)
    return np.stack(found, axis=-1)


def _refined(fit: CauseFit, cause: Cause, beta: Array) -> FoundCause:
    """The cause at the value that explains the rows held out best, from a value near it."""
    s = fit.states
    best = fit.refit(cause.correct(s, beta))
    S = fit.gained(best)
    for _ in range(_STEPS):
        step = best.with_columns(_columns(best, s, cause, beta))[1]
        refit = fit.refit(cause.correct(s, beta + step))
        gained = fit.gained(refit)
        worth = gained > S + _WORTH
        if gained > S:
            best, S, beta = refit, gained, beta + step
        if not worth:
            break
    deviation = best.deviation(_columns(best, s, cause, beta))
    found = _judged(fit, best, replace(cause, correct=partial(cause.correct, beta=beta)))
    return replace(found, value=beta, deviation=deviation, step=cause.step)


def _judged(fit: CauseFit, refit: CauseFit, cause: Cause) -> FoundCause:
    S = fit.gained(refit)
    return FoundCause(
        cause.kind, cause.joints, S, refit.t_value(fit), fit, refit, cause.correct, number=cause.number, cost=cause.cost
    )


def effect(fit: CauseFit, found: FoundCause, *, seed: int = 0) -> float:
    """Largest share of a joint's torque (rms) in another motion that predictions change by with the cause.

    The motion is 200 states within 1.5 times the range of the log's positions, as fast as the log.
    """
    s, rng = fit.states, np.random.default_rng(seed)
    middle, half = 0.5 * (s.q.max(axis=0) + s.q.min(axis=0)), 0.75 * np.ptp(s.q, axis=0)
    q = middle + half * rng.uniform(-1.0, 1.0, (_STATES, len(half)))
    dq, ddq = (rng.normal(size=q.shape) * np.sqrt((x**2).mean(axis=0)) for x in (s.dq, s.ddq))
    none = np.zeros(_STATES)
    other = s.changed(
        pieces=(), rows=np.arange(_STATES), time=none, piece=none, rate=none, q=q, dq=dq, ddq=ddq, tau=0.0 * q, lag=0.0
    )
    r = s.base.count
    before = other.columns @ fit.x[:r]
    after = (found.correct(other) if found.correct else other).changed(lag=0.0).columns @ found.fit.x[:r]
    if found.law is not None:
        after = after + found.law.column(other, FittedTorques.from_groups(other, found.fit.x[:r])) * found.fit.x[-1]
    size = np.sqrt((before**2).mean(axis=0))
    return float((np.sqrt(((after - before) ** 2).mean(axis=0)) / np.maximum(size, 1e-300))[fit.live].max())
