"""Search for the causes of a fit's residual: one column or one refit per cause, evaluated on held-out rows.

With s_j² the mean square of the residual of joint j in 5-fold cross-validation over time, a cause gains

    S = Σ_j log(s_j² without it / s_j² with it),

the criterion by which settings are chosen too. Each joint has equal weight. Its significance is that of the mean of the
differences of log-likelihood d_b over blocks b of time (Vuong, "Likelihood ratio tests for model selection and
non-nested hypotheses", Econometrica 57, 1989), by Student's t at 0.01 divided by the number of tested causes (Bonferroni).
A column e is fitted together with the groups; a nonlinear cause is found by Gauss-Newton steps with its column

    e = d(τ̂ of the corrected log)/dβ.

Its interval is β ± t √(Σ_b u_b²) / Σ e⊥' Λ e⊥,  u_b = Σ_{t in b} e⊥' Λ r, with e⊥ the column less its projection on W,
and r the held-out residual (Liang and Zeger, Biometrika 73, 1986). Values of several causes are estimated together at
the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from ...core.estimation.covariance import student_quantile
from ...core.estimation.least_squares import MAD
from ...core.typing import Array
from ..base_columns import consecutive_slices
from ..hyperparameters import SPEEDS
from . import causes
from .cause_fit import (
    LEAST_S,
    CauseFit,
    ScreenedCause,
    cause_columns,
    law_columns,
    screen_causes,
    screen_changes,
    screen_laws,
)
from .causes import Cause, FittedTorques, Law
from .log_states import LogStates

_ROUNDS = 3
_DISCRETE = 0.03, 0.06
"""Residuals of all joints and of a single joint, as shares of their torques, from which discrete causes are tested."""
_MAX_SUSPECTS = 8
"""Number of joints, those with the largest residuals, for which discrete causes are tested."""
_STEPS, _MIN_GAIN = 5, 0.005
"""Maximum number of Gauss-Newton steps, and least gain in S of another step or friction speed."""
_MAX_REFINED, _MAX_STARTS = 5, 3
"""Maximum number of refined causes of a stage, and of starts of a cause."""
_TIE, _TIE_SHARE, _MIN_SHARE_OF_BEST = 0.05, 0.03, 0.7
"""Differences of S, absolute and as a share of the largest, of equal evidence; share of the largest S of a rival."""
_MAX_LOAD_OF_MASS = 3.0
"""Largest load that an arm takes up, as a multiple of its own moving mass; arms carry less than they weigh."""
_MIN_CERTAIN_S = 1.5
"""S that no number of tested causes gives by chance in rows held out; a slow fault has few blocks of time for the test of t."""
_MIN_BLOCKS = 6
"""Blocks of time from which one test of t is enough for a large S: with two, any change half way explains everything."""
_ORDER = {"gain": 0, "zero": 1, "tilt": 2, "late": 3, "low-pass": 4}
"""Order of preference among causes with equal evidence."""
_POSITIVE = ("backlash", "elasticity", "load-friction", "low-pass", "spring", "stribeck")
_OF_THE_WHOLE_LOG, _MIN_SHARE_OF_JOINT = ("late", "mounting", "tilt"), 0.9
"""Causes of the whole log, and share of S of such a cause and one of a joint together from which the joint's is the cause."""
_OWN_DEVIATIONS = 2.0
"""Deviations of its own that the coefficient of a law exceeds, if it widens intervals."""
_RINGING = 2.0
"""Time on both sides of a jump, in periods of the cut-off, in which its low-pass is not negligible."""
_SAME_BEGIN = 1.0
"""Time [s] between the begins of two changes of a joint, below which the second one found is part of the first."""
_FORCE_COST = 1.0
"""Amount by which S of a force exceeds that of other causes: its three columns also imitate a part of zeros and tilts."""
_STATES = 200
_MIN_RATIO_OF_PUSH, _MAX_PUSHED_ROWS, _MIN_SHARE_BY_FORCE = 5.0, 0.25, 0.5
"""Criteria of a push: minimum ratio to the usual residual, maximum share of rows, squares explained by one force."""
_ANY_GAIN = 10.0
"""Factor on both sides of a gain; if its interval holds both ends, the gain is undetermined."""
_MIN_SHARE_BY_SWAY = 0.5
"""Minimum share of the squared residuals of all joints that a swaying base explains."""


@dataclass(frozen=True, eq=False)
class FoundCause:
    """Cause of a residual, with the evidence from held-out rows.

    Attributes
    ----------
    kind : str
    joints : tuple of int
    S, t : float, statistic and its significance
    before, fit : CauseFit, without the cause and with it
    correct : callable, removes the cause from states
    value, deviation : array, β, the default of ``correct``, and its standard deviation; None for a cause without a
    value
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
    """Begin and end [s] of the cause."""
    log: int = 0
    """Number of the log to which these times belong, from 1; 0 if there is only one log."""
    size: float | None = None
    """Acceleration amplitude of a swaying base [m/s²]."""

    @property
    def most(self) -> tuple[int, float]:
        """Joint whose residual is reduced most, and the explained share of its squares."""
        share = np.where(self.fit.live, 1.0 - self.fit.squares / self.before.squares, 0.0)
        return int(share.argmax()), float(share.max())

    @property
    def value_and_interval(self) -> tuple[float | None, tuple[float, float] | None]:
        """Value and 95 % interval in the unit of the table: degrees, ms, Hz or per cent; factors for gains."""
        if self.value is None or self.deviation is None:
            return self.number, None
        t = float(student_quantile(max(1.0, len(self.fit.blocks) - 1.0), 0.95))
        return causes.value_with_interval(self.kind, self.value, t * self.deviation)


@dataclass(frozen=True)
class WantedCause:
    """Cause to assume, with the joints that it names; no joints for all joints or the whole log."""

    kind: str
    joints: tuple[int, ...]

    def stands_for(self, found: FoundCause) -> bool:
        """True if a found cause is this cause."""
        return found.kind == self.kind and (not self.joints or bool({*self.joints} & {*found.joints}))


def estimate_cause(fit: CauseFit, candidates: Iterable[Cause]) -> FoundCause:
    """Best of several causes, at the value that minimises the held-out residual, without a test of significance."""
    s = fit.states
    found: list[FoundCause] = []
    for cause in candidates:
        if not cause.step:
            found.append(_tested_cause(fit, fit.refit(cause.correct(s)), cause))
            continue
        # The linear prediction of a long step is too optimistic.
        starts = sorted(screen_causes(fit, [cause]), key=lambda one: -one.S)[:_MAX_STARTS]
        found += [refine_cause(fit, cause, one.beta) for one in starts]
    return max(found, key=lambda one: one.S)


def diagnose(start: CauseFit) -> tuple[list[FoundCause], CauseFit]:
    """Causes of a fit's residual in the order in which they are found, and the fit before laws of joints are added.

    Each cause is added to the fit before the search for the next.
    """
    found: list[FoundCause] = []
    fit = start
    if not start.enough:
        return found, start
    push = _push(fit)
    if push is not None:
        found.append(replace(push, effect=effect(fit, push)))
        fit = push.fit
    begin = _fit_at_best_speed(_without_jumps(fit))
    fit = _run_stage(_causes_of_log, begin, found)
    before = begin if fit is begin else _fit_at_best_speed(fit)
    fit = _run_stage(_laws_of_joints, before, found)
    if fit is not before:  # a law may have hidden a cause of the log
        _run_stage(_causes_of_log, fit, found)
    return list(filter(_is_determined, _estimate_together(start, found))), before


Stage = Callable[[CauseFit], tuple[Iterator[FoundCause], int]]
"""Causes of a stage with their evidence, and the number of those tested."""


def _run_stage(stage: Stage, fit: CauseFit, found: list[FoundCause]) -> CauseFit:
    """Fit with the causes that a stage finds, which are appended to ``found``."""
    for _ in range(_ROUNDS):
        tested, count = stage(fit)
        new = (one for one in tested if not _is_part(one, found))
        best = _most_significant(fit, new, count)
        if best is None:
            break
        found += _with_another_zero(best) if best.kind == "zero" else [best]
        fit = found[-1].fit
    return fit


def _is_part(one: FoundCause, found: Sequence[FoundCause]) -> bool:
    """True for a change of a joint that is part of another one found before: a gain that changes scales the offset too."""
    if one.span is None:
        return False
    for each in found:
        if each.span is None or each.kind == one.kind or each.log != one.log:
            continue
        if {*each.joints} & {*one.joints} and abs(each.span[0] - one.span[0]) < _SAME_BEGIN:
            return True
    return False


def _estimate_together(start: CauseFit, found: list[FoundCause]) -> list[FoundCause]:
    """Estimate the values of several causes together: each was estimated before the later ones were found.

    A cause that was found twice is merged into one.
    """
    first: dict[tuple[str, tuple[int, ...]], int] = {}
    values: dict[int, Array] = {}
    for k, one in enumerate(found):
        own = first.setdefault((one.kind, one.joints), k)
        if one.correct is not None and one.value is not None:
            values[own] = one.value + values.get(own, 0.0)
    corrections: dict[int, Callable[..., LogStates]] = {}
    for k in first.values():
        correct_one = found[k].correct
        if correct_one is not None:
            corrections[k] = correct_one
    if len(corrections) < 2 or not values:
        return found
    parts = dict(zip(values, consecutive_slices(map(len, values.values())), strict=True))
    beta = np.concatenate(list(values.values()))

    def correct(s: LogStates, beta: Array) -> LogStates:
        for k, correct_one in corrections.items():
            s = correct_one(s, beta=beta[parts[k]]) if k in parts else correct_one(s)
        return s

    last = found[-1].fit
    s = start.states.with_fields(rows=last.states.rows, friction_speed=last.states.friction_speed)
    step = min(found[k].step for k in values)
    cause = Cause("", (), correct, step, len(beta))
    refined = refine_cause(last.refit(s), cause, beta)
    for k, part in parts.items():
        value, deviation = np.asarray(refined.value)[part], np.asarray(refined.deviation)[part]
        found[k] = replace(found[k], value=value, deviation=deviation, correct=partial(corrections[k], beta=value))
    return [found[k] for k in first.values()]


def _with_another_zero(first: FoundCause) -> list[FoundCause]:
    """Zero error, or two zero errors if these explain more: zero errors that nearly cancel hide each other."""
    fit, own = first.fit, first.joints
    zeros = {one.joints: one for one in causes.continuous_causes(fit.states, wide=False) if one.kind == "zero"}
    own_zero = zeros.pop(own)
    if not zeros:
        return [first]
    others = list(zeros.values())
    own_columns = cause_columns(fit, fit.states, own_zero, np.zeros(1))
    pairs: list[Array] = []
    for one in others:
        columns = cause_columns(fit, fit.states, one, np.zeros(1))
        pairs.append(np.concatenate([own_columns, columns], axis=2))
    S, beta = fit.gains_of_columns(np.stack(pairs, axis=2))
    k = int(S.argmax())
    other = others[k]

    def correct(s: LogStates, beta: Array) -> LogStates:
        return other.correct(own_zero.correct(s, beta[:1]), beta[1:])

    if S[k] < LEAST_S:
        return [first]
    both = refine_cause(fit, Cause("zero", (*own, *other.joints), correct, own_zero.step, 2), beta[k])
    if both.value is None or both.deviation is None:
        return [first]
    if both.S < LEAST_S or both.t < fit.critical_t(len(others) + 1):
        return [first]
    value = np.asarray(first.value) + both.value[:1]
    same: dict[str, Any] = {"fit": both.fit, "effect": max(first.effect, effect(fit, both))}
    changed = replace(
        first, value=value, deviation=both.deviation[:1], correct=partial(own_zero.correct, beta=value), **same
    )
    added = replace(both, joints=other.joints, value=both.value[1:], deviation=both.deviation[1:], **same)
    return [changed, replace(added, correct=partial(other.correct, beta=both.value[1:]))]


def law_changes(fit: CauseFit) -> Array:
    """(k, p) changes of the unknown parameters by the law that explains most, and by the strongest law of each joint.

    Only laws with a possible sign and more than two deviations count, each times √(p (1 - p)) with the probability p of the
    law, 1 / (1 + exp(-n S / 2)) for n blocks of time: a law that is certain is fitted or reported.
    """
    base = fit.states.base
    laws = [one for one in fit.joint_causes if one.S > 0 and _is_plausible(fit, one)]
    laws.sort(key=lambda one: -one.S)
    strongest: dict[tuple[int, ...], ScreenedCause] = {}
    for one in reversed(laws):
        if len(one.cause.joints) == 1 or one is laws[0]:
            strongest[one.cause.joints] = one
    changes = np.zeros((len(strongest), len(base.unknown.names)))
    for k, one in enumerate(strongest.values()):
        p = 1.0 / (1.0 + np.exp(-0.5 * len(fit.blocks) * one.S))
        changes[k, base.kept] = np.sqrt(p * (1.0 - p)) * fit.change(one.e, one.beta)
    return changes


def _is_plausible(fit: CauseFit, one: ScreenedCause) -> bool:
    """True if a screened law has a possible sign, and a coefficient of more than two of its deviations."""
    if one.cause.kind in _POSITIVE and not one.beta[0] > 0.0:
        return False
    return bool((np.abs(one.beta) > _OWN_DEVIATIONS * fit.deviation(one.e)).any())


def _fit_at_best_speed(fit: CauseFit) -> CauseFit:
    """Fit with the best common friction speed, if it is significantly better."""
    others = (fit.refit(fit.states.with_fields(friction_speed=np.full(len(fit.live), speed))) for speed in SPEEDS)
    best = max(others, key=fit.gain)
    return best if fit.gain(best) > _MIN_GAIN else fit


def _most_significant(fit: CauseFit, tested: Iterable[FoundCause], count: int) -> FoundCause | None:
    """Significant cause with the largest S, or a preferred cause with equal evidence; None if none is significant."""
    candidates = [_cause_at_best_speed(fit, one) for one in _strongest(tested, count)]
    if not candidates:
        return None
    largest = max(one.S - one.cost for one in candidates)
    least = largest - max(_TIE, _TIE_SHARE * largest)
    best, *rivals = (one for one in candidates if one.S - one.cost >= least)
    of_joint = _cause_of_one_joint(best, candidates)
    if of_joint is not None:
        best, rivals = of_joint, []
    return replace(best, rivals=tuple(rivals), effect=effect(fit, best))


def _cause_of_one_joint(best: FoundCause, candidates: Iterable[FoundCause]) -> FoundCause | None:
    """Cause of one joint that explains nearly all that it and a cause of the whole log explain together; None without."""
    if best.kind not in _OF_THE_WHOLE_LOG:
        return None
    for one in sorted(candidates, key=lambda one: one.cost - one.S):
        if len(one.joints) == 1:
            more = max(0.0, _gained_with(one.fit, best))
            if more <= (1.0 - _MIN_SHARE_OF_JOINT) * (one.S + more):
                return one
    return None


def _gained_with(fit: CauseFit, cause: FoundCause) -> float:
    """S that a cause of the whole log gains in a fit that has another cause; a value is estimated anew."""
    s = fit.states
    if cause.value is not None:
        same = [one for one in causes.continuous_causes(s, wide=True) if one.kind == cause.kind]
        return estimate_cause(fit, same).S
    if cause.correct is not None:
        s = cause.correct(s)
    return fit.gain(fit.refit(s))


def _strongest(tested: Iterable[FoundCause], count: int) -> list[FoundCause]:
    """Significant causes among ``count`` tested ones, whose S is near the largest.

    The others, with their fits, are released one by one, so that memory does not grow with the number of causes.
    """
    strongest: list[FoundCause] = []
    largest = -np.inf
    for one in tested:
        tests = 1 if _is_large(one) else count
        if one.S >= LEAST_S and one.t >= one.fit.critical_t(tests) and _is_possible(one):
            largest = max(largest, one.S - one.cost)
            least = largest - (1.0 - _MIN_SHARE_OF_BEST) * abs(largest)
            strongest = [each for each in (*strongest, one) if each.S - each.cost >= least]
    return strongest


def _cause_at_best_speed(fit: CauseFit, found: FoundCause) -> FoundCause:
    """Cause with the friction speed that fits best together with it."""
    refit = _fit_at_best_speed(found.fit)
    return replace(found, fit=refit, S=fit.gain(refit), t=refit.t_value(fit))


def _is_large(found: FoundCause) -> bool:
    """True if S is too large for chance, over enough blocks of time, and the value is two standard deviations from zero."""
    if found.S < _MIN_CERTAIN_S or len(found.fit.blocks) < _MIN_BLOCKS:
        return False
    if found.value is None or found.deviation is None:
        return True
    return bool((np.abs(found.value) > 2.0 * found.deviation).any())


def _is_possible(found: FoundCause) -> bool:
    """False if the value has an impossible sign or size: links do not run ahead of their motors, and no arm lifts a wall."""
    if found.value is None:
        return True
    if found.kind == "load-change":
        robot = found.fit.states.base.unknown.robot
        return bool(abs(found.value[0]) <= _MAX_LOAD_OF_MASS * robot.model.moving_mass)
    return found.kind not in _POSITIVE or bool(found.value[0] > 0)


def _is_determined(found: FoundCause) -> bool:
    """False for a gain that may be any: where all torques have one factor, masses of any size explain it as well."""
    value, interval = found.value_and_interval
    if found.kind != "gain" or value is None or interval is None:
        return True
    return interval[0] > value / _ANY_GAIN or interval[1] < value * _ANY_GAIN


def _push(fit: CauseFit) -> FoundCause | None:
    """Push: at least 0.3 s of rows with five times the usual residual, explained by a force on the tip."""
    s, robot = fit.states, fit.states.base.unknown.robot
    if robot.model.tip is None:
        return None
    refit, residual = fit, fit.left
    runs: list[tuple[int, int]] = []
    sigma = np.ones(len(fit.live))
    for _ in range(2):  # the first fit still contains the push
        sigma = MAD * np.median(np.abs(residual), axis=0) + np.sqrt(fit.floor)
        size = np.sqrt(((residual / sigma)[:, fit.live] ** 2).mean(axis=1))
        runs = causes.runs(s.time[s.rows], s.piece[s.rows], size > _MIN_RATIO_OF_PUSH * np.median(size))
        kept = np.ones(len(s.rows), bool)
        for a, b in runs:
            kept[a:b] = False
        if not 1.0 - _MAX_PUSHED_ROWS < kept.mean() < 1.0:
            return None
        refit = fit.refit(s.with_fields(rows=s.rows[kept]))
        residual = fit.tau - fit.W @ refit.x
    a, b = max(runs, key=lambda run: run[1] - run[0])
    J = np.asarray(robot.jacobian(s.q[s.rows[a:b]], kind="world_aligned"))[:, 3:]
    # τ = J' f, with f constant in the world's axes
    A = (J / sigma).swapaxes(1, 2)[:, fit.live].reshape(-1, 3)
    y = (residual[a:b] / sigma)[:, fit.live].ravel()
    f, *_ = np.linalg.lstsq(A, y, rcond=None)
    if float(((y - A @ f) ** 2).sum()) > (1.0 - _MIN_SHARE_BY_FORCE) * float(y @ y):
        return None
    first, last = s.rows[a], s.rows[b - 1]
    span, log = (float(s.time[first]), float(s.time[last])), s.logs[s.piece[first]]
    return FoundCause("push", (), np.inf, np.inf, fit, refit, number=float(np.linalg.norm(f)), span=span, log=log)


def _without_jumps(fit: CauseFit) -> CauseFit:
    """Fit without the rows beside a jump of a position, whose accelerations are those of the low-pass."""
    s = fit.states
    kept = np.ones(len(s.rows), bool)
    for jump in causes.jumps(s):
        if jump.since is not None:
            piece, time = jump.since
            kept &= (s.piece[s.rows] != piece) | (np.abs(s.time[s.rows] - time) > _RINGING / s.cutoff)
    return fit if kept.all() else fit.refit(s.with_fields(rows=s.rows[kept]))


def _sway(fit: CauseFit) -> tuple[list[FoundCause], int]:
    """Acceleration of the base along two horizontal axes, at its dominant frequency.

    The residual of each row is W(e_x) x a_x + W(e_y) x a_y; cosine and sine columns are fitted together.
    """
    s = fit.states
    if not s.gravity.any() or len(s.pieces) != 1:
        return [], 0
    x = fit.x[: s.base.count]
    level = np.linalg.svd(s.gravity[None])[2][1:]
    still = s.with_fields(dq=0.0 * s.dq, ddq=0.0 * s.ddq)
    e = [
        (still.with_fields(gravity=s.gravity - g).predicted_torques(x) - still.predicted_torques(x)) * fit.live
        for g in level
    ]
    A = np.stack(e, axis=-1) * np.sqrt(fit.weight)[:, None]
    if not A.any():
        return [], 0
    y = (fit.left * np.sqrt(fit.weight))[..., None]
    N = A.swapaxes(1, 2) @ A
    N += np.trace(N, axis1=1, axis2=2).mean() * 1e-2 * np.eye(2)
    a = np.linalg.solve(N, A.swapaxes(1, 2) @ y)[..., 0]
    time = s.time[s.rows]
    hertz = _dominant_frequency(time, a)
    columns: list[Array] = []
    for column in e:
        columns.append(column * np.cos(2 * np.pi * hertz * time)[:, None])
        columns.append(column * np.sin(2 * np.pi * hertz * time)[:, None])
    refit = fit.refit(s, *columns)
    if float((refit.left**2).sum()) > (1.0 - _MIN_SHARE_BY_SWAY) * float((fit.left**2).sum()):
        return [], 1
    size = float(np.linalg.norm(refit.x[-len(columns) :]))
    S = fit.gain(refit)
    return [FoundCause("swaying", (), S, refit.t_value(fit), fit, refit, number=hertz, size=size)], 1


def _dominant_frequency(time: Array, a: Array) -> float:
    """Frequency [Hz] of the largest power of signals a (n, k) at times (n,)."""
    power = (np.abs(np.fft.rfft(a - a.mean(axis=0), 4 * len(a), axis=0)) ** 2).sum(axis=1)
    frequencies = np.fft.rfftfreq(4 * len(a), float(np.median(np.diff(time))))
    return float(frequencies[int(power[1:].argmax()) + 1])


def _causes_of_log(fit: CauseFit) -> tuple[Iterator[FoundCause], int]:
    """Stages 2 and 3: refits of discrete causes if the residual is large, and of continuous causes with the best columns."""
    s = fit.states
    discrete: list[Cause] = []
    total = float(np.sqrt((fit.left**2).sum() / max(float((fit.tau**2).sum()), 1e-300)))
    is_large = total > _DISCRETE[0] or float(fit.shares.max()) > _DISCRETE[1]
    if is_large:
        worst = np.argsort(-fit.shares)[:_MAX_SUSPECTS]
        suspects = np.sort(worst[fit.live[worst]]).tolist()
        discrete = [*causes.discrete_causes(s, suspects), *_causes_without_sign(fit)]
    continuous = [*causes.continuous_causes(s, wide=is_large), *causes.jumps(s), *causes.plays(s)]
    laws = list(causes.laws_of_the_log(s))

    def found() -> Iterator[FoundCause]:
        yield from _refine_laws(fit, screen_laws(fit, laws))
        for cause in discrete:
            yield _tested_cause(fit, fit.refit(cause.correct(s)), cause)
        screened = [*screen_causes(fit, continuous), *screen_changes(fit)]
        yield from _refine_causes(fit, screened)
        yield from _refine_laws(fit, screened)

    return found(), len(discrete) + sum(len(cause.starts) for cause in continuous)


def _causes_without_sign(fit: CauseFit) -> Iterator[Cause]:
    """Torques without their sign, among those that are nowhere clearly negative, by the fit of the other joints."""
    s = fit.states
    is_positive = s.tau.min(axis=0) > -causes.MIN_NEGATIVE_PART * np.sqrt((s.tau**2).mean(axis=0))
    for k in np.flatnonzero(fit.live & is_positive).tolist():
        others = CauseFit(s, fit.groups, fit.live & (np.arange(len(fit.live)) != k))
        cause = causes.torque_without_sign(s, k, others.x)
        if cause is not None:
            yield cause


def _laws_of_joints(fit: CauseFit) -> tuple[Iterator[FoundCause], int]:
    """Stage 4: laws of the joints and their elasticity, screened by their columns."""
    swaying, more = _sway(fit)
    elastic = _refine_causes(fit, fit.joint_causes)
    return chain(_refine_laws(fit, fit.joint_causes), elastic, swaying), len(fit.joint_causes) + more


def _refine_laws(fit: CauseFit, screened: Sequence[ScreenedCause]) -> Iterator[FoundCause]:
    """Refine the laws whose columns gain most; a second refit uses columns from the first fitted torques."""
    laws = [one for one in screened if isinstance(one.cause, Law)]
    for one in sorted(laws, key=lambda one: -one.S)[:_MAX_REFINED]:
        if one.S > 0.5 * LEAST_S:
            found = _refine_law(fit, one)
            if LEAST_S + found.cost <= found.S:
                yield found


def _refine_law(fit: CauseFit, screened: ScreenedCause) -> FoundCause:
    """Law with its coefficients from a second refit, whose columns are those of the first fitted torques."""
    s, r, law = fit.states, fit.states.base.count, screened.cause
    assert isinstance(law, Law)
    refit = fit.refit(s, *np.moveaxis(screened.e, -1, 0))
    (e,) = law_columns(fit, [law], FittedTorques.from_groups(s, refit.x[:r]))
    refit = fit.refit(s, *np.moveaxis(e, -1, 0))
    count = e.shape[-1]
    reported, cost = 1, 0.0
    if law.kind == "force":
        reported, cost = count, _FORCE_COST
    S, t = fit.gain(refit), refit.t_value(fit)
    value, deviation = refit.x[-count:][:reported], refit.law_deviation(count)[:reported]
    refit.release(fit)
    found = FoundCause(law.kind, law.joints, S, t, fit, refit, law=law, value=value, deviation=deviation, cost=cost)
    return replace(found, **_begin(s, law.since))


def _refine_causes(fit: CauseFit, screened: Sequence[ScreenedCause]) -> list[FoundCause]:
    """Refine the causes with a value whose columns gain most, by Gauss-Newton steps."""
    found: dict[tuple[str, tuple[int, ...]], FoundCause] = {}
    for one in sorted(screened, key=lambda one: -one.S):
        if one.S < 0.5 * LEAST_S or len(found) == _MAX_REFINED:
            break
        cause = one.cause
        if isinstance(cause, Cause) and (cause.kind, cause.joints) not in found:
            found[cause.kind, cause.joints] = refine_cause(fit, cause, one.beta)
    return sorted(found.values(), key=lambda one: _ORDER.get(one.kind, 0))


def refine_cause(fit: CauseFit, cause: Cause, beta: Array) -> FoundCause:
    """Cause at the value that minimises the held-out residual, refined from a nearby value."""
    s = fit.states
    best = fit.refit(cause.correct(s, beta))
    S = fit.gain(best)
    for _ in range(_STEPS):
        step = best.gains_of_columns(cause_columns(best, s, cause, beta)[:, :, None])[1][0]
        refit = fit.refit(cause.correct(s, beta + step))
        S_refit = fit.gain(refit)
        is_worth_another = S_refit > S + _MIN_GAIN
        if S_refit > S:
            best, S, beta = refit, S_refit, beta + step
        if not is_worth_another:
            break
    deviation = best.deviation(cause_columns(best, s, cause, beta))
    found = _tested_cause(fit, best, replace(cause, correct=partial(cause.correct, beta=beta)))
    return replace(found, value=beta, deviation=deviation, step=cause.step)


def _tested_cause(fit: CauseFit, refit: CauseFit, cause: Cause) -> FoundCause:
    S, t = fit.gain(refit), refit.t_value(fit)
    refit.release(fit)
    found = FoundCause(cause.kind, cause.joints, S, t, fit, refit, cause.correct, number=cause.number, cost=cause.cost)
    return replace(found, **_begin(fit.states, cause.since))


def _begin(s: LogStates, since: tuple[int, float] | None) -> dict[str, Any]:
    """Fields of a cause that begins within a log: its begin and end [s], and the number of the log."""
    if since is None:
        return {}
    piece, time = since
    return {"span": (time, float(s.time[s.rows[-1]])), "log": s.logs[piece]}


def effect(fit: CauseFit, found: FoundCause, *, seed: int = 0) -> float:
    """Largest change of predicted torques by the cause in another motion, as a share of a joint's torque (rms).

    The motion is 200 states within 1.5 times the range of the log's positions, as fast as the log.
    """
    s, rng = fit.states, np.random.default_rng(seed)
    middle, half = 0.5 * (s.q.max(axis=0) + s.q.min(axis=0)), 0.75 * np.ptp(s.q, axis=0)
    q = middle + half * rng.uniform(-1.0, 1.0, (_STATES, len(half)))
    dq = rng.normal(size=q.shape) * np.sqrt((s.dq**2).mean(axis=0))
    ddq = rng.normal(size=q.shape) * np.sqrt((s.ddq**2).mean(axis=0))
    zeros = np.zeros(_STATES)
    time = zeros + s.time[0]  # before changes that begin within the log
    motion = s.with_fields(
        pieces=(),
        rows=np.arange(_STATES),
        time=time,
        piece=zeros,
        rate=zeros,
        q=q,
        dq=dq,
        ddq=ddq,
        tau=0.0 * q,
        lag=0.0,
    )
    r = s.base.count
    before = motion.predicted_torques(fit.x[:r])
    corrected = found.correct(motion) if found.correct else motion
    after = corrected.with_fields(lag=0.0).predicted_torques(found.fit.x[:r])
    if found.law is not None:
        e = found.law.columns(motion, FittedTorques.from_groups(motion, found.fit.x[:r]))
        after = after + e @ found.fit.x[-e.shape[-1] :]
    size = np.sqrt((before**2).mean(axis=0))
    return float((np.sqrt(((after - before) ** 2).mean(axis=0)) / np.maximum(size, 1e-300))[fit.live].max())
