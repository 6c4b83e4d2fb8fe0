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
from itertools import chain, pairwise
from typing import Any

import numpy as np

from ..core.doubts import Doubt, Level, doubt, doubt_table
from ..core.estimation.covariance import student_quantile
from ..core.estimation.least_squares import MAD
from ..core.numbers import number, percent, seconds
from ..core.text import Argument, Placeholder, listed, spell
from ..core.typing import Array
from . import causes
from .cause_fit import (
    LEAST_S,
    CauseFit,
    ScreenedCause,
    cause_columns,
    law_columns,
    screened,
    screened_changes,
    screened_laws,
)
from .causes import Cause, FittedTorques, Law, LogStates
from .hyperparameters import SPEEDS

_ROUNDS = 3
_DISCRETE = 0.03, 0.06
"""Residuals of all joints and of a single joint, as shares of their torques, from which discrete causes are tested."""
_SUSPECTS = 8
"""Number of joints, those with the largest residuals, for which discrete causes are tested."""
_STEPS, _WORTH = 5, 0.005
_REFINED, _STARTED = 5, 3
_TIE, _TIE_SHARE, _NEAR = 0.05, 0.03, 0.7
_HEAVIEST = 3.0
"""Largest load that an arm takes up, as a multiple of its own moving mass; arms carry less than they weigh."""
_LARGE_S = 1.5
"""S that no number of tested causes gives by chance in rows held out; a slow fault has few blocks of time for the test of t."""
_LEAST_BLOCKS = 6
"""Blocks of time from which one test of t is enough for a large S: with two, any change half way explains everything."""
_ORDER = {"gain": 0, "zero": 1, "tilt": 2, "late": 3, "low-pass": 4}
"""Order of preference among causes with equal evidence."""
_POSITIVE = ("backlash", "elasticity", "load-friction", "low-pass", "spring", "stribeck")
_OF_THE_WHOLE_LOG, _ALONE = ("late", "mounting", "tilt"), 0.9
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
_PUSHED, _MOST_PUSHED, _BY_FORCE = 5.0, 0.25, 0.5
"""Criteria of a push: minimum ratio to the usual residual, maximum share of rows, squares explained by one force."""
_ANY_GAIN = 10.0
"""Factor on both sides of a gain; if its interval holds both ends, the gain is undetermined."""
_SWAYS = 0.5
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
    def in_units(self) -> tuple[float | None, tuple[float, float] | None]:
        """Value and 95 % interval in the unit of the table: degrees, ms, Hz or per cent; factors for gains."""
        if self.value is None or self.deviation is None:
            return self.number, None
        t = float(student_quantile(max(1.0, len(self.fit.blocks) - 1.0), 0.95))
        return causes.in_units(self.kind, self.value, t * self.deviation)


@dataclass(frozen=True)
class WantedCause:
    """Cause to assume, with the joints that it names; no joints for all joints or the whole log."""

    kind: str
    joints: tuple[int, ...]

    def stands_for(self, found: FoundCause) -> bool:
        """True if a found cause is this cause."""
        return found.kind == self.kind and (not self.joints or bool({*self.joints} & {*found.joints}))


def estimated(fit: CauseFit, tried: Iterable[Cause]) -> FoundCause:
    """Best of several causes, at the value that minimises the held-out residual, without a test of significance."""
    s, found = fit.states, list[FoundCause]()
    for cause in tried:
        if not cause.step:
            found.append(_judged(fit, fit.refit(cause.correct(s)), cause))
            continue
        # The linear prediction of a long step is too optimistic.
        begins = sorted(screened(fit, [cause]), key=lambda one: -one.S)[:_STARTED]
        found += [_refined(fit, cause, one.beta) for one in begins]
    return max(found, key=lambda one: one.S)


def diagnose(start: CauseFit) -> tuple[list[FoundCause], CauseFit]:
    """Causes of a fit's residual in the order in which they are found, and the fit before laws of joints are added.

    Each cause is added to the fit before the search for the next.
    """
    found, fit = list[FoundCause](), start
    if not start.enough:
        return found, start
    if push := _push(fit):
        found.append(replace(push, effect=effect(fit, push)))
        fit = push.fit
    begin = _at_best_speed(_without_jumps(fit))
    fit = _found_by(_of_the_log, begin, found)
    before = begin if fit is begin else _at_best_speed(fit)
    fit = _found_by(_of_the_joints, before, found)
    if fit is not before:  # a law may have hidden a cause of the log
        _found_by(_of_the_log, fit, found)
    return [one for one in _together(start, found) if _determined(one)], before


Stage = Callable[[CauseFit], tuple[Iterator[FoundCause], int]]
"""Causes of a stage with their evidence, and the number of those tested."""


def _found_by(stage: Stage, fit: CauseFit, found: list[FoundCause]) -> CauseFit:
    """Fit with the causes that a stage finds, which are appended to ``found``."""
    for _ in range(_ROUNDS):
        tried, count = stage(fit)
        best = _first(fit, (one for one in tried if not _is_part(one, found)), count)
        if best is None:
            break
        found += _with_another_zero(best) if best.kind == "zero" else [best]
        fit = found[-1].fit
    return fit


def _is_part(one: FoundCause, found: Sequence[FoundCause]) -> bool:
    """True for a change of a joint that is part of another one found before: a gain that changes scales the offset too."""
    if one.span is None:
        return False
    return any(
        each.span is not None
        and each.kind != one.kind
        and {*each.joints} & {*one.joints}
        and each.log == one.log
        and abs(each.span[0] - one.span[0]) < _SAME_BEGIN
        for each in found
    )


def _together(start: CauseFit, found: list[FoundCause]) -> list[FoundCause]:
    """Estimate the values of several causes together: each was estimated before the later ones were found.

    A cause that was found twice is merged into one.
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


def _with_another_zero(first: FoundCause) -> list[FoundCause]:
    """Zero error, or two zero errors if these explain more: zero errors that nearly cancel hide each other."""
    fit, own = first.fit, first.joints
    zeros = [one for one in causes.continuous_causes(fit.states, wide=False) if one.kind == "zero"]
    columns = {one.joints: cause_columns(fit, fit.states, one, np.zeros(1)) for one in zeros}
    mine = next(one for one in zeros if one.joints == own)
    others = [one for one in zeros if one is not mine]
    if not others:
        return [first]
    pairs = [np.concatenate([columns[own], columns[one.joints]], axis=2) for one in others]
    S, beta = fit.gained_by(np.stack(pairs, axis=2))
    k = int(S.argmax())
    other = others[k]

    def correct(s: LogStates, beta: Array) -> LogStates:
        return other.correct(mine.correct(s, beta[:1]), beta[1:])

    if S[k] < LEAST_S:
        return [first]
    both = _refined(fit, Cause("zero", (*own, *other.joints), correct, mine.step, 2), beta[k])
    if both.value is None or both.deviation is None or both.S < LEAST_S or both.t < fit.sure(len(zeros)):
        return [first]
    value = np.asarray(first.value) + both.value[:1]
    same: dict[str, Any] = {"fit": both.fit, "effect": max(first.effect, effect(fit, both))}
    begun = replace(first, value=value, deviation=both.deviation[:1], correct=partial(mine.correct, beta=value), **same)
    more = replace(both, joints=other.joints, value=both.value[1:], deviation=both.deviation[1:], **same)
    return [begun, replace(more, correct=partial(other.correct, beta=both.value[1:]))]


def law_changes(fit: CauseFit) -> Array:
    """(k, p) changes of the unknown parameters by the law that explains most, and by the strongest law of each joint.

    Only laws with a possible sign and more than two deviations count, each times √(p (1 - p)) with the probability p of the
    law, 1 / (1 + exp(-n S / 2)) for n blocks of time: a law that is certain is fitted or reported.
    """
    base, told = fit.states.base, sorted((one for one in fit.joint_causes if one.S > 0), key=lambda one: -one.S)
    told = [one for one in told if _plausible(fit, one)]
    strongest = {one.cause.joints: one for one in reversed(told) if len(one.cause.joints) == 1} | {
        one.cause.joints: one for one in told[:1]
    }
    found = np.zeros((len(strongest), len(base.unknown.names)))
    for k, one in enumerate(strongest.values()):
        p = 1.0 / (1.0 + np.exp(-0.5 * len(fit.blocks) * one.S))
        found[k, base.kept] = np.sqrt(p * (1.0 - p)) * fit.change(one.e, one.beta)
    return found


def _plausible(fit: CauseFit, one: ScreenedCause) -> bool:
    """True if a screened law has a possible sign, and a coefficient of more than two of its deviations."""
    if one.cause.kind in _POSITIVE and not one.beta[0] > 0.0:
        return False
    return bool((np.abs(one.beta) > _OWN_DEVIATIONS * fit.deviation(one.e)).any())


def _at_best_speed(fit: CauseFit) -> CauseFit:
    """Fit with the best common friction speed, if it is significantly better."""
    others = (fit.refit(fit.states.changed(friction_speed=np.full(len(fit.live), speed))) for speed in SPEEDS)
    best = max(others, key=fit.gained)
    return best if fit.gained(best) > _WORTH else fit


def _first(fit: CauseFit, tried: Iterable[FoundCause], count: int) -> FoundCause | None:
    """Significant cause with the largest S, or a preferred cause with equal evidence; None if none is significant."""
    told = _strongest(tried, count)
    if not told:
        return None
    told = [_at_its_speed(fit, one) for one in told]
    most = max(one.S - one.cost for one in told)
    best, *rivals = (one for one in told if one.S - one.cost >= most - max(_TIE, _TIE_SHARE * most))
    if (alone := _of_one_joint(best, told)) is not None:
        best, rivals = alone, []
    return replace(best, rivals=tuple(rivals), effect=effect(fit, best))


def _of_one_joint(best: FoundCause, told: Iterable[FoundCause]) -> FoundCause | None:
    """Cause of one joint that explains nearly all that it and a cause of the whole log explain together; None without."""
    if best.kind not in _OF_THE_WHOLE_LOG:
        return None
    for one in sorted(told, key=lambda one: one.cost - one.S):
        if len(one.joints) == 1:
            more = max(0.0, _gained_with(one.fit, best))
            if more <= (1.0 - _ALONE) * (one.S + more):
                return one
    return None


def _gained_with(fit: CauseFit, cause: FoundCause) -> float:
    """S that a cause of the whole log gains in a fit that has another cause; a value is estimated anew."""
    s = fit.states
    if cause.value is None:
        return fit.gained(fit.refit(s if cause.correct is None else cause.correct(s)))
    same = [one for one in causes.continuous_causes(s, wide=True) if one.kind == cause.kind]
    return estimated(fit, same).S


def _strongest(tried: Iterable[FoundCause], count: int) -> list[FoundCause]:
    """Significant causes among ``count`` tested ones, whose S is near the largest.

    The others, with their fits, are released one by one, so that memory does not grow with the number of causes.
    """
    told, most = list[FoundCause](), -np.inf
    for one in tried:
        tests = 1 if _is_large(one) else count
        if one.S >= LEAST_S and one.t >= one.fit.sure(tests) and _possible(one):
            most = max(most, one.S - one.cost)
            least = most - (1.0 - _NEAR) * abs(most)
            told = [each for each in (*told, one) if each.S - each.cost >= least]
    return told


def _at_its_speed(fit: CauseFit, found: FoundCause) -> FoundCause:
    """Cause with the friction speed that fits best together with it."""
    refit = _at_best_speed(found.fit)
    return replace(found, fit=refit, S=fit.gained(refit), t=refit.t_value(fit))


def _is_large(found: FoundCause) -> bool:
    """True if S is too large for chance, over enough blocks of time, and the value is two standard deviations from zero."""
    if found.S < _LARGE_S or len(found.fit.blocks) < _LEAST_BLOCKS:
        return False
    if found.value is None or found.deviation is None:
        return True
    return bool((np.abs(found.value) > 2.0 * found.deviation).any())


def _possible(found: FoundCause) -> bool:
    """False if the value has an impossible sign or size: links do not run ahead of their motors, and no arm lifts a wall."""
    if found.value is None:
        return True
    if found.kind == "load-change":
        robot = found.fit.states.base.unknown.robot
        return bool(abs(found.value[0]) <= _HEAVIEST * robot.model.moving_mass)
    return found.kind not in _POSITIVE or bool(found.value[0] > 0)


def _determined(found: FoundCause) -> bool:
    """False for a gain that may be any: where all torques have one factor, masses of any size explain it as well."""
    value, interval = found.in_units
    if found.kind != "gain" or value is None or interval is None:
        return True
    return interval[0] > value / _ANY_GAIN or interval[1] < value * _ANY_GAIN


def _push(fit: CauseFit) -> FoundCause | None:
    """Push: at least 0.3 s of rows with five times the usual residual, explained by a force on the tip."""
    s, rest, robot = fit.states, fit, fit.states.base.unknown.robot
    if robot.model.tip is None:
        return None
    left, runs, sigma = fit.left, list[tuple[int, int]](), np.ones(len(fit.live))
    for _ in range(2):  # the first fit still contains the push
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
    first, last = s.rows[a], s.rows[b - 1]
    span, log = (float(s.time[first]), float(s.time[last])), s.logs[s.piece[first]]
    return FoundCause("push", (), np.inf, np.inf, fit, rest, number=float(np.linalg.norm(f)), span=span, log=log)


def _without_jumps(fit: CauseFit) -> CauseFit:
    """Fit without the rows beside a jump of a position, whose accelerations are those of the low-pass."""
    s = fit.states
    kept = np.ones(len(s.rows), bool)
    for piece, time in (one.since for one in causes.jumps(s) if one.since is not None):
        kept &= (s.piece[s.rows] != piece) | (np.abs(s.time[s.rows] - time) > _RINGING / s.cutoff)
    return fit if kept.all() else fit.refit(s.changed(rows=s.rows[kept]))


def _sway(fit: CauseFit) -> tuple[list[FoundCause], int]:
    """Acceleration of the base along two horizontal axes, at its dominant frequency.

    The residual of each row is W(e_x) x a_x + W(e_y) x a_y; cosine and sine columns are fitted together.
    """
    s = fit.states
    if not s.gravity.any() or len(s.pieces) != 1:
        return [], 0
    x = fit.x[: s.base.count]
    level = np.linalg.svd(s.gravity[None])[2][1:]
    still = s.changed(dq=0.0 * s.dq, ddq=0.0 * s.ddq)
    e = [(still.changed(gravity=s.gravity - g).predicted(x) - still.predicted(x)) * fit.live for g in level]
    A = np.stack(e, axis=-1) * np.sqrt(fit.weight)[:, None]
    if not A.any():
        return [], 0
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


def _of_the_log(fit: CauseFit) -> tuple[Iterator[FoundCause], int]:
    """Stages 2 and 3: refits of discrete causes if the residual is large, and of continuous causes with the best columns."""
    s, discrete = fit.states, list[Cause]()
    total = float(np.sqrt((fit.left**2).sum() / max(float((fit.tau**2).sum()), 1e-300)))
    much = total > _DISCRETE[0] or float(fit.shares.max()) > _DISCRETE[1]
    if much:
        worst = [k for k in np.argsort(-fit.shares)[:_SUSPECTS].tolist() if fit.live[k]]
        discrete = [*causes.discrete_causes(s, sorted(worst)), *_unsigned(fit)]
    continuous = [*causes.continuous_causes(s, wide=much), *causes.jumps(s), *causes.plays(s)]

    laws = list(causes.laws_of_the_log(s))

    def found() -> Iterator[FoundCause]:
        yield from _refined_laws(fit, screened_laws(fit, laws))
        yield from (_judged(fit, fit.refit(cause.correct(s)), cause) for cause in discrete)
        tried = [*screened(fit, continuous), *screened_changes(fit)]
        yield from _refined_causes(fit, tried)
        yield from _refined_laws(fit, tried)

    return found(), len(discrete) + sum(len(cause.starts) for cause in continuous)


def _unsigned(fit: CauseFit) -> Iterator[Cause]:
    """Torques without their sign, among those that are nowhere clearly negative, by the fit of the other joints."""
    s = fit.states
    for k in np.flatnonzero(
        fit.live & (s.tau.min(axis=0) > -causes.SIGNED * np.sqrt((s.tau**2).mean(axis=0)))
    ).tolist():
        others = CauseFit(s, fit.groups, fit.live & (np.arange(len(fit.live)) != k))
        if (cause := causes.unsigned(s, k, others.x)) is not None:
            yield cause


def _of_the_joints(fit: CauseFit) -> tuple[Iterator[FoundCause], int]:
    """Stage 4: laws of the joints and their elasticity, screened by their columns."""
    swaying, more = _sway(fit)
    elastic = _refined_causes(fit, fit.joint_causes)
    return chain(_refined_laws(fit, fit.joint_causes), elastic, swaying), len(fit.joint_causes) + more


def _refined_laws(fit: CauseFit, tried: Sequence[ScreenedCause]) -> Iterator[FoundCause]:
    """Refine the laws whose columns gain most; a second refit uses columns from the first fitted torques."""
    s, r = fit.states, fit.states.base.count
    laws = [(one, one.cause) for one in sorted(tried, key=lambda one: -one.S) if isinstance(one.cause, Law)]
    for one, law in laws[:_REFINED]:
        if one.S > 0.5 * LEAST_S:
            refit = fit.refit(s, *np.moveaxis(one.e, -1, 0))
            (e,) = law_columns(fit, [law], FittedTorques.from_groups(s, refit.x[:r]))
            refit = fit.refit(s, *np.moveaxis(e, -1, 0))
            k = e.shape[-1]
            told = FoundCause(law.kind, law.joints, fit.gained(refit), refit.t_value(fit), fit, refit)
            shown = slice(k) if law.kind == "force" else slice(1)
            value, deviation = refit.x[-k:][shown], refit.law_deviation(k)[shown]
            refit.release(fit)
            cost = _FORCE_COST if law.kind == "force" else 0.0
            least = LEAST_S + cost
            if least > told.S:
                continue
            yield replace(told, law=law, value=value, deviation=deviation, cost=cost, **_begin(s, law.since))


def _refined_causes(fit: CauseFit, tried: Sequence[ScreenedCause]) -> list[FoundCause]:
    """Refine the causes with a value whose columns gain most, by Gauss-Newton steps."""
    found = dict[tuple[str, tuple[int, ...]], FoundCause]()
    for one in sorted(tried, key=lambda one: -one.S):
        if one.S < 0.5 * LEAST_S or len(found) == _REFINED:
            break
        cause = one.cause
        if isinstance(cause, Cause) and (cause.kind, cause.joints) not in found:
            found[cause.kind, cause.joints] = _refined(fit, cause, one.beta)
    return sorted(found.values(), key=lambda one: _ORDER.get(one.kind, 0))


def _refined(fit: CauseFit, cause: Cause, beta: Array) -> FoundCause:
    """Cause at the value that minimises the held-out residual, refined from a nearby value."""
    s = fit.states
    best = fit.refit(cause.correct(s, beta))
    S = fit.gained(best)
    for _ in range(_STEPS):
        step = best.gained_by(cause_columns(best, s, cause, beta)[:, :, None])[1][0]
        refit = fit.refit(cause.correct(s, beta + step))
        gained = fit.gained(refit)
        worth = gained > S + _WORTH
        if gained > S:
            best, S, beta = refit, gained, beta + step
        if not worth:
            break
    deviation = best.deviation(cause_columns(best, s, cause, beta))
    found = _judged(fit, best, replace(cause, correct=partial(cause.correct, beta=beta)))
    return replace(found, value=beta, deviation=deviation, step=cause.step)


def _judged(fit: CauseFit, refit: CauseFit, cause: Cause) -> FoundCause:
    S, t = fit.gained(refit), refit.t_value(fit)
    refit.release(fit)
    found = FoundCause(cause.kind, cause.joints, S, t, fit, refit, cause.correct, number=cause.number, cost=cause.cost)
    return replace(found, **_begin(fit.states, cause.since))


def _begin(s: LogStates, since: tuple[int, float] | None) -> dict[str, Any]:
    """Fields of a cause that begins within a log: its begin and end [s], and the number of the log."""
    return {} if since is None else {"span": (since[1], float(s.time[s.rows[-1]])), "log": s.logs[since[0]]}


def effect(fit: CauseFit, found: FoundCause, *, seed: int = 0) -> float:
    """Largest change of predicted torques by the cause in another motion, as a share of a joint's torque (rms).

    The motion is 200 states within 1.5 times the range of the log's positions, as fast as the log.
    """
    s, rng = fit.states, np.random.default_rng(seed)
    middle, half = 0.5 * (s.q.max(axis=0) + s.q.min(axis=0)), 0.75 * np.ptp(s.q, axis=0)
    q = middle + half * rng.uniform(-1.0, 1.0, (_STATES, len(half)))
    dq, ddq = (rng.normal(size=q.shape) * np.sqrt((x**2).mean(axis=0)) for x in (s.dq, s.ddq))
    none = np.zeros(_STATES)
    first = none + s.time[0]  # before changes that begin within the log
    other = s.changed(
        pieces=(), rows=np.arange(_STATES), time=first, piece=none, rate=none, q=q, dq=dq, ddq=ddq, tau=0.0 * q, lag=0.0
    )
    r = s.base.count
    before = other.predicted(fit.x[:r])
    after = (found.correct(other) if found.correct else other).changed(lag=0.0).predicted(found.fit.x[:r])
    if found.law is not None:
        e = found.law.columns(other, FittedTorques.from_groups(other, found.fit.x[:r]))
        after = after + e @ found.fit.x[-e.shape[-1] :]
    size = np.sqrt((before**2).mean(axis=0))
    return float((np.sqrt(((after - before) ** 2).mean(axis=0)) / np.maximum(size, 1e-300))[fit.live].max())


# ── Sentences

_REFUSES, _UNSURE = 0.05, 0.01
"""Changes of predicted torques, as shares of a joint's torque, from which a cause makes the verdict LOOK AGAIN or UNSURE."""
_LEAST_DELAY, _SAME_DELAY = 8e-3, (2e-3, 0.1)
"""Minimum reported delay [s]; absolute [s] and relative difference below which two delays are equal."""
_OF_A_BUS = 30e-3
"""Longest delay [s] of a bus or a filter; a longer one suggests that positions are commands."""


def cause_doubts(names: Sequence[str], causes: Iterable[FoundCause], taken_off: float) -> list[Doubt]:
    """Doubts about the causes of the residual, in the order in which the causes were found."""
    return [
        doubt_of_cause(names, cause, taken_off)
        for cause in causes
        if cause.kind != "late" or cause.value is None or abs(float(cause.value[0])) >= _LEAST_DELAY
    ]


_OF_THE_ROBOT = ("load-friction", "stribeck")
"""Laws that belong to the robot, not to a fault of its log, in the order in which they are fitted."""
_FALLS, _MOST_LAWS = 0.05, 2


def laws_of_the_robot(causes: Iterable[FoundCause]) -> tuple[WantedCause, ...]:
    """At most two laws of the robot that lower the residual of held-out rows by 5 % of itself."""
    found = list[WantedCause]()
    for one in sorted((one for one in causes if one.kind in _OF_THE_ROBOT), key=lambda x: _OF_THE_ROBOT.index(x.kind)):
        left, before = (float(((fit.left * fit.spread) ** 2).sum()) for fit in (one.fit, one.before))
        all_joints = one.kind == "stribeck" or len(one.joints) == len(one.fit.live)
        wanted = WantedCause(one.kind, () if all_joints else one.joints)
        if left <= (1.0 - _FALLS) ** 2 * before and wanted not in found:
            found.append(wanted)
    return tuple(found[:_MOST_LAWS])


def doubt_of_cause(names: Sequence[str], cause: FoundCause, taken_off: float | None = None) -> Doubt:
    """Doubt for a cause; ``names`` are the joints' names, ``taken_off`` is the delay [s] that a fit has removed."""
    joints = [names[k] for k in cause.joints]
    said = "all joints" if len(joints) == len(names) > 1 else listed(joints)
    worst, share = cause.most
    evidence = f"it takes away {percent(share, 2)} of the residual of {names[worst]}"
    if cause.rivals:
        others = listed(
            dict.fromkeys(
                f"{one.kind} of {listed([names[k] for k in one.joints])}"
                if one.joints
                else f"another {one.kind}"
                if one.kind == cause.kind
                else one.kind
                for one in cause.rivals
            ),
            3,
        )
        evidence += f"; this log does not distinguish it from {others}"
    value, interval = cause.in_units
    level: Level = "refuse" if cause.effect > _REFUSES else "unsure" if cause.effect > _UNSURE else "note"
    row = doubt_table()[cause.kind]
    own = level if row.level == "effect" or (row.stage == 1 and level == "note") else row.level
    if taken_off is not None and cause.kind in _OF_THE_ROBOT:
        own = "note"  # a law that rows held out confirm is fitted
    words = {
        "evidence": evidence,
        "value": "" if value is None else number(abs(value) if cause.kind == "late" else value, 3),
        "interval": "" if interval is None else f" (95 %: {number(interval[0], 3)} to {number(interval[1], 3)})",
        "gravity": ", ".join(number(x, 4) for x in cause.fit.states.gravity),
        "from_": "" if cause.span is None else seconds(cause.span[0], 4),
        "to": "" if cause.span is None else seconds(cause.span[1], 4),
        "size": "" if cause.size is None else number(cause.size, 2),
        "taken": "The command identify takes it off.",
        "way": "" if value is None else "after" if value > 0 else "before",
    }
    if cause.kind == "late" and taken_off is not None:
        delay = cause.fit.states.shift
        if abs(delay - taken_off) <= max(_SAME_DELAY[0], _SAME_DELAY[1] * abs(delay)):
            words["taken"] = "The offset is taken off."
            own = "note"
            if abs(delay) > _OF_A_BUS:
                words["taken"] += " Are positions commands? Log those of the encoders."
                own = "unsure"
        else:
            shift = spell(Argument("shift", Placeholder(seconds(delay, 3))))
            words["taken"] = f"The fit has {seconds(taken_off, 3)} s in its place: give {shift}."
            own = level
    found = {
        "value": value,
        "interval": interval,
        "unit": row.unit,
        "statistic": cause.S,
        "share": share,
        "effect": cause.effect,
    }
    log = f"log {cause.log}" if cause.log else ""
    return doubt(cause.kind, joints, level=own, log=log, found=found, named=said, **words)
