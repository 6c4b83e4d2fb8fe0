"""Search for the causes of a fit's residual: one column or one refit per cause, evaluated on held-out rows.

With s_j² the mean square of the residual of joint j in 5-fold cross-validation over time, a cause gains

    S = Σ_j log(s_j² without it / s_j² with it),

in which each joint has equal weight. Settings are chosen by the same criterion. Its significance is that of the mean of the
differences of log-likelihood d_b over blocks b of time (Vuong, "Likelihood ratio tests for model selection and non-nested
hypotheses", Econometrica 57, 1989), by Student's t at 0.01 divided by the number of tested causes (Bonferroni).

A law with a column e is fitted together with the groups. A nonlinear cause with a value β is found by Gauss-Newton steps with
the column

    e = d(τ̂ of the corrected log)/dβ.

With e⊥ the column less its projection on W, and r the held-out residual, the interval of β (Liang and Zeger, Biometrika 73,
1986) is

    β ± t √(Σ_b u_b²) / Σ e⊥' Λ e⊥,     u_b = Σ_{t in b} e⊥' Λ r

Values of several causes are estimated together at the end.
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

_MAX_ROUNDS = 3
"""Maximum number of causes of one stage."""
_MIN_RESIDUAL_OF_ALL = 0.03
"""Residual of all joints, as a share of their torques, from which discrete causes are tested."""
_MIN_RESIDUAL_OF_JOINT = 0.06
"""Residual of a single joint, as a share of its torque, from which discrete causes are tested."""
_MAX_SUSPECTS = 8
"""Largest number of joints for which discrete causes are tested: those with the largest residuals."""
_MAX_STEPS = 5
"""Maximum number of Gauss-Newton steps."""
_MIN_GAIN = 0.005
"""Least gain in S of another step or friction speed."""
_MAX_REFINED = 5
"""Maximum number of refined causes of a stage."""
_MAX_STARTS = 3
"""Maximum number of starts of a cause."""
_EQUAL_S = 0.05
"""Difference of S up to which causes have equal evidence."""
_EQUAL_S_SHARE = 0.03
"""Difference of S, as a share of the largest, up to which causes have equal evidence."""
_MIN_SHARE_OF_BEST = 0.7
"""Least S of a candidate, as a share of the largest S."""
_MAX_LOAD_OF_MASS = 3.0
"""Largest load that an arm takes up, as a multiple of its own moving mass; arms carry less than they weigh."""
_MIN_CERTAIN_S = 1.5
"""S that no number of tested causes reaches by chance in held-out rows.

A slow fault has too few blocks of time for the test of t to show such a certainty."""
_MIN_BLOCKS = 6
"""Blocks of time from which one test of t is enough for a large S: with two, any change half way explains everything."""
_ORDER = {"gain": 0, "zero": 1, "tilt": 2, "late": 3, "low-pass": 4}
"""Order of preference among causes with equal evidence."""
_POSITIVE = ("backlash", "elasticity", "load-friction", "low-pass", "spring", "stribeck")
"""Causes whose value cannot be negative."""
_LOG_CAUSES = ("late", "mounting", "tilt")
"""Causes of the whole log that may be mistaken for a cause of one joint."""
_MIN_SHARE_OF_JOINT = 0.9
"""Least S of a joint's cause that alone is the cause, as a share of S with a cause of the whole log in addition."""
_MIN_DEVIATIONS_OF_LAW = 2.0
"""Least coefficient of a law that widens intervals, in its standard deviations."""
_RINGING_PERIODS = 2.0
"""Time on both sides of a jump, in periods of the cut-off, in which its low-pass is not negligible."""
_SAME_BEGIN = 1.0
"""Time [s] between the begins of two changes of a joint, below which the second one found is part of the first."""
_FORCE_COST = 1.0
"""Amount by which S of a force must exceed S of other causes: its three columns also imitate a part of zeros and tilts."""
_STATES = 200
"""Number of states at which the effect of a cause is evaluated."""
_MIN_RATIO_OF_PUSH = 5.0
"""Least ratio of the residual during a push to the usual residual."""
_MAX_PUSHED_ROWS = 0.25
"""Largest share of the rows in which the robot is pushed."""
_MIN_SHARE_BY_FORCE = 0.5
"""Least share of the squared residuals during a push that one force explains."""
_UNDETERMINED_GAIN = 10.0
"""Factor f of undetermined gains, whose interval extends from less than gain / f to more than f gain."""
_MIN_SHARE_BY_SWAY = 0.5
"""Minimum share of the squared residuals of all joints that a swaying base explains."""


@dataclass(frozen=True, eq=False)
class FoundCause:
    """Cause of a residual, with the evidence from held-out rows.

    Attributes
    ----------
    kind : str, name of its row in the table of doubts
    joints : tuple of int, indices of its joints; empty for a cause of the whole log
    S, t : float, gain on held-out rows, and Student's t of this gain
    before, fit : CauseFit, without the cause and with it
    correct : callable, removes the cause from states
    law : Law or None, joint law whose columns the fit contains
    value, deviation : array, value β and its standard deviation; None for a cause without a value
    effect : float, change of predicted torques, as a share of a joint's torque
    rivals : tuple of FoundCause, causes with equal evidence
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
    """Amount by which S must exceed that of other causes."""
    span: tuple[float, float] | None = None
    """Begin and end [s] of the cause."""
    log: int = 0
    """Number of the log to which these times belong, from 1; 0 if there is only one log."""
    size: float | None = None
    """Acceleration amplitude of a swaying base [m/s²]."""

    @property
    def most(self) -> tuple[int, float]:
        """Index of the joint whose residual is reduced most, and the explained share of its squares."""
        explained_shares = np.where(self.fit.live, 1.0 - self.fit.squares / self.before.squares, 0.0)
        return int(explained_shares.argmax()), float(explained_shares.max())

    @property
    def unit(self) -> str:
        """Unit of the value: degrees or mm, ms, Hz or per cent; empty for factors of gains."""
        return causes.unit_of_value(self.kind, self.joints, self.fit.states.base.unknown.model)

    @property
    def value_and_interval(self) -> tuple[float | None, tuple[float, float] | None]:
        """Value and 95 % interval in the cause's unit."""
        if self.value is None or self.deviation is None:
            return self.number, None
        t = float(student_quantile(max(1.0, len(self.fit.blocks) - 1.0), 0.95))
        return causes.value_with_interval(self.kind, self.value, t * self.deviation, self.unit)


@dataclass(frozen=True)
class WantedCause:
    """Cause to assume, with the joints that it names; no joints for all joints or the whole log."""

    kind: str
    joints: tuple[int, ...]

    def stands_for(self, found: FoundCause) -> bool:
        """True if a found cause is this cause, for one of its joints at least."""
        if found.kind != self.kind:
            return False
        return not self.joints or bool({*self.joints} & {*found.joints})


def estimate_cause(fit: CauseFit, candidates: Iterable[Cause]) -> FoundCause:
    """Best of several causes, at the value that minimises the held-out residual, without a test of significance."""
    s = fit.states
    results: list[FoundCause] = []
    for cause in candidates:
        if not cause.step:
            results.append(_tested_cause(fit, fit.refit(cause.correct(s)), cause))
            continue
        # several starts, as the linear prediction of a long step is too optimistic
        starts = sorted(screen_causes(fit, [cause]), key=lambda start: -start.S)[:_MAX_STARTS]
        results += [refine_cause(fit, cause, start.beta) for start in starts]
    return max(results, key=lambda result: result.S)


def diagnose(start: CauseFit) -> tuple[list[FoundCause], CauseFit]:
    """Causes of a fit's residual in the order in which they are found, and the fit before laws of joints are added.

    Each cause is added to the fit before the next is sought.
    """
    found: list[FoundCause] = []
    fit = start
    if not start.enough:
        return found, start
    push = _push(fit)
    if push is not None:
        found.append(replace(push, effect=effect(fit, push)))
        fit = push.fit
    fit_of_log = _fit_at_best_speed(_without_jumps(fit))
    fit = _run_stage(_causes_of_log, fit_of_log, found)
    fit_without_laws = fit_of_log
    if fit is not fit_of_log:  # with causes, another speed may be best
        fit_without_laws = _fit_at_best_speed(fit)
    fit = _run_stage(_laws_of_joints, fit_without_laws, found)
    if fit is not fit_without_laws:  # a law may have hidden a cause of the log
        _run_stage(_causes_of_log, fit, found)
    determined = list(filter(_is_determined, _estimate_together(start, found)))
    return determined, fit_without_laws


Stage = Callable[[CauseFit], tuple[Iterator[FoundCause], int]]
"""Function that returns causes with their evidence, and the number of tested causes."""


def _run_stage(stage: Stage, fit: CauseFit, found: list[FoundCause]) -> CauseFit:
    """Fit with the causes that a stage finds, which are appended to ``found``."""
    for _ in range(_MAX_ROUNDS):
        tested, test_count = stage(fit)
        new_causes = (candidate for candidate in tested if not _is_part(candidate, found))
        best = _most_significant(fit, new_causes, test_count)
        if best is None:
            break
        found += _with_another_zero(best) if best.kind == "zero" else [best]
        fit = found[-1].fit
    return fit


def _is_part(candidate: FoundCause, found: Sequence[FoundCause]) -> bool:
    """True for a change of a joint that is part of another change found before: a gain that changes also scales the offset."""
    if candidate.span is None:
        return False
    begin, _ = candidate.span
    for other in found:
        if other.span is None or other.kind == candidate.kind or other.log != candidate.log:
            continue
        other_begin, _ = other.span
        has_common_joint = bool({*other.joints} & {*candidate.joints})
        if has_common_joint and abs(other_begin - begin) < _SAME_BEGIN:
            return True
    return False


def _estimate_together(start: CauseFit, found: list[FoundCause]) -> list[FoundCause]:
    """Causes with values that are estimated together: each was first estimated before the later causes were found.

    A cause that was found twice is merged into one. Keys of the dictionaries are first indices of the causes in ``found``.
    """
    first_index_by_cause: dict[tuple[str, tuple[int, ...]], int] = {}
    values: dict[int, Array] = {}
    for k, cause in enumerate(found):
        first_index = first_index_by_cause.setdefault((cause.kind, cause.joints), k)
        if cause.correct is not None and cause.value is not None:
            values[first_index] = cause.value + values.get(first_index, 0.0)
    corrections: dict[int, Callable[..., LogStates]] = {}
    for k in first_index_by_cause.values():
        correction = found[k].correct
        if correction is not None:
            corrections[k] = correction
    if len(corrections) < 2 or not values:
        return found
    slices = dict(zip(values, consecutive_slices(map(len, values.values())), strict=True))  # of values in beta
    beta = np.concatenate(list(values.values()))

    def correct(s: LogStates, beta: Array) -> LogStates:
        """States without all causes."""
        for k, correction in corrections.items():
            s = correction(s, beta=beta[slices[k]]) if k in slices else correction(s)
        return s

    last_fit = found[-1].fit
    s = start.states.with_fields(rows=last_fit.states.rows, friction_speed=last_fit.states.friction_speed)
    step = min(found[k].step for k in values)
    all_causes = Cause("", (), correct, step, len(beta))
    refined = refine_cause(last_fit.refit(s), all_causes, beta)
    for k, own_values in slices.items():
        value = np.asarray(refined.value)[own_values]
        deviation = np.asarray(refined.deviation)[own_values]
        found[k] = replace(found[k], value=value, deviation=deviation, correct=partial(corrections[k], beta=value))
    return [found[k] for k in first_index_by_cause.values()]


def _with_another_zero(first: FoundCause) -> list[FoundCause]:
    """Zero error, or two zero errors if these explain more: zero errors that nearly cancel hide each other."""
    fit = first.fit
    zero_by_joints: dict[tuple[int, ...], Cause] = {}
    for cause in causes.continuous_causes(fit.states, wide=False):
        if cause.kind == "zero":
            zero_by_joints[cause.joints] = cause
    first_zero = zero_by_joints.pop(first.joints)
    if not zero_by_joints:
        return [first]
    other_zeros = list(zero_by_joints.values())
    first_columns = cause_columns(fit, fit.states, first_zero, np.zeros(1))
    pairs: list[Array] = []
    for zero in other_zeros:
        columns = cause_columns(fit, fit.states, zero, np.zeros(1))
        pairs.append(np.concatenate([first_columns, columns], axis=2))
    S, beta = fit.gains_of_columns(np.stack(pairs, axis=2))
    k = int(S.argmax())
    if S[k] < LEAST_S:
        return [first]
    other = other_zeros[k]

    def correct(s: LogStates, beta: Array) -> LogStates:
        """States without both zero errors."""
        without_first = first_zero.correct(s, beta[:1])
        return other.correct(without_first, beta[1:])

    both_zeros = Cause("zero", (*first.joints, *other.joints), correct, first_zero.step, 2)
    both = refine_cause(fit, both_zeros, beta[k])
    if both.value is None or both.deviation is None:
        return [first]
    if both.S < LEAST_S or both.t < fit.critical_t(len(other_zeros) + 1):
        return [first]
    first_value = np.asarray(first.value) + both.value[:1]  # the fit is already without the first value
    other_value = both.value[1:]
    common_fields: dict[str, Any] = {"fit": both.fit, "effect": max(first.effect, effect(fit, both))}
    changed_zero = replace(
        first, value=first_value, deviation=both.deviation[:1], correct=partial(first_zero.correct, beta=first_value),
        **common_fields,
    )  # fmt: skip
    added_zero = replace(
        both, joints=other.joints, value=other_value, deviation=both.deviation[1:],
        correct=partial(other.correct, beta=other_value), **common_fields,
    )  # fmt: skip
    return [changed_zero, added_zero]


def law_changes(fit: CauseFit) -> Array:
    """Changes (k, p) of the unknown parameters by the law that explains most, and by the strongest law of each joint.

    Only plausible laws count. A change is multiplied by √(p (1 - p)), with the probability p = 1 / (1 + exp(-n S / 2)) of the
    law for n blocks of time: a certain law is not a doubt, as it is fitted or reported.
    """
    base = fit.states.base
    laws = [law for law in fit.joint_causes if law.S > 0 and _is_plausible(fit, law)]
    laws.sort(key=lambda law: -law.S)
    strongest_by_joints: dict[tuple[int, ...], ScreenedCause] = {}
    for law in reversed(laws):  # stronger laws replace weaker ones
        is_of_one_joint = len(law.cause.joints) == 1
        if is_of_one_joint or law is laws[0]:
            strongest_by_joints[law.cause.joints] = law
    changes = np.zeros((len(strongest_by_joints), len(base.unknown.names)))
    for k, law in enumerate(strongest_by_joints.values()):
        p = 1.0 / (1.0 + np.exp(-0.5 * len(fit.blocks) * law.S))
        changes[k, base.kept] = np.sqrt(p * (1.0 - p)) * fit.change(law.e, law.beta)
    return changes


def _is_plausible(fit: CauseFit, law: ScreenedCause) -> bool:
    """True if a screened law has a possible sign, and a coefficient of more than two of its deviations."""
    if law.cause.kind in _POSITIVE and not law.beta[0] > 0.0:
        return False
    min_coefficients = _MIN_DEVIATIONS_OF_LAW * fit.deviation(law.e)
    return bool((np.abs(law.beta) > min_coefficients).any())


def _fit_at_best_speed(fit: CauseFit) -> CauseFit:
    """Fit with the best common friction speed, if it is significantly better."""
    refits = (fit.refit(fit.states.with_fields(friction_speed=np.full(len(fit.live), speed))) for speed in SPEEDS)
    best = max(refits, key=fit.gain)
    return best if fit.gain(best) > _MIN_GAIN else fit


def _most_significant(fit: CauseFit, tested: Iterable[FoundCause], count: int) -> FoundCause | None:
    """Significant cause with the largest S, or a preferred cause with equal evidence; None if none is significant.

    ``tested`` are causes in the order of preference, and ``count`` is the number of tested causes.
    """
    candidates = [_cause_at_best_speed(fit, candidate) for candidate in _strongest(tested, count)]
    if not candidates:
        return None
    largest = max(candidate.S - candidate.cost for candidate in candidates)
    min_equal = largest - max(_EQUAL_S, _EQUAL_S_SHARE * largest)
    best, *rivals = (candidate for candidate in candidates if candidate.S - candidate.cost >= min_equal)
    joint_cause = _cause_of_one_joint(best, candidates)
    if joint_cause is not None:
        best, rivals = joint_cause, []
    return replace(best, rivals=tuple(rivals), effect=effect(fit, best))


def _cause_of_one_joint(best: FoundCause, candidates: Iterable[FoundCause]) -> FoundCause | None:
    """Cause of one joint that explains nearly all that it and ``best`` explain together; None if there is none.

    Only a cause of the whole log can be replaced so.
    """
    if best.kind not in _LOG_CAUSES:
        return None
    for candidate in sorted(candidates, key=lambda candidate: candidate.cost - candidate.S):
        if len(candidate.joints) == 1:
            additional_S = max(0.0, _gained_with(candidate.fit, best))
            if additional_S <= (1.0 - _MIN_SHARE_OF_JOINT) * (candidate.S + additional_S):
                return candidate
    return None


def _gained_with(fit: CauseFit, cause: FoundCause) -> float:
    """S that a cause of the whole log gains in a fit that has another cause; its value is estimated anew."""
    s = fit.states
    if cause.value is not None:
        same_kind = [candidate for candidate in causes.continuous_causes(s, wide=True) if candidate.kind == cause.kind]
        return estimate_cause(fit, same_kind).S
    if cause.correct is not None:
        s = cause.correct(s)
    return fit.gain(fit.refit(s))


def _strongest(tested: Iterable[FoundCause], count: int) -> list[FoundCause]:
    """Significant causes among ``count`` tested causes, whose S is near the largest.

    Other causes, with their fits, are released one by one, so that memory does not grow with the number of causes.
    """
    strongest: list[FoundCause] = []
    largest = -np.inf
    for candidate in tested:
        tests = 1 if _is_large(candidate) else count  # by which the level of t is divided
        is_significant = candidate.S >= LEAST_S and candidate.t >= candidate.fit.critical_t(tests)
        if is_significant and _is_possible(candidate):
            largest = max(largest, candidate.S - candidate.cost)
            min_S = largest - (1.0 - _MIN_SHARE_OF_BEST) * abs(largest)
            strongest = [cause for cause in (*strongest, candidate) if cause.S - cause.cost >= min_S]
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
    """False if the value has an impossible sign or size, such as links that run ahead of their motors."""
    if found.value is None:
        return True
    if found.kind == "load-change":
        moving_mass = found.fit.states.base.unknown.robot.model.moving_mass
        return bool(abs(found.value[0]) <= _MAX_LOAD_OF_MASS * moving_mass)
    return found.kind not in _POSITIVE or bool(found.value[0] > 0)


def _is_determined(found: FoundCause) -> bool:
    """False for a gain with a very wide interval: masses of any size may then explain a common factor of torques, too."""
    value, interval = found.value_and_interval
    if found.kind != "gain" or value is None or interval is None:
        return True
    low, high = interval
    return low > value / _UNDETERMINED_GAIN or high < value * _UNDETERMINED_GAIN


def _push(fit: CauseFit) -> FoundCause | None:
    """Push on the robot: a run of rows with a large residual that a force on the tip explains; None without a push."""
    s = fit.states
    robot = s.base.unknown.robot
    if robot.model.tip is None:
        return None
    refit, residual = fit, fit.left
    runs: list[tuple[int, int]] = []
    sigma = np.ones(len(fit.live))
    for _ in range(2):  # the first fit still contains the push
        sigma = MAD * np.median(np.abs(residual), axis=0) + np.sqrt(fit.floor)
        residual_size = np.sqrt(((residual / sigma)[:, fit.live] ** 2).mean(axis=1))  # of each row
        is_pushed = residual_size > _MIN_RATIO_OF_PUSH * np.median(residual_size)
        runs = causes.runs(s.time[s.rows], s.piece[s.rows], is_pushed)
        is_kept = np.ones(len(s.rows), bool)
        for first, end in runs:
            is_kept[first:end] = False
        if not 1.0 - _MAX_PUSHED_ROWS < is_kept.mean() < 1.0:
            return None
        refit = fit.refit(s.with_fields(rows=s.rows[is_kept]))
        residual = fit.tau - fit.W @ refit.x
    first, end = max(runs, key=lambda run: run[1] - run[0])  # the longest
    J = np.asarray(robot.jacobian(s.q[s.rows[first:end]], kind="world_aligned"))
    J = J[:, 3:]  # τ = J' f, with f constant in the world's axes
    A = (J / sigma).swapaxes(1, 2)[:, fit.live].reshape(-1, 3)
    y = (residual[first:end] / sigma)[:, fit.live].ravel()
    f, *_ = np.linalg.lstsq(A, y, rcond=None)
    unexplained_squares = float(((y - A @ f) ** 2).sum())
    if unexplained_squares > (1.0 - _MIN_SHARE_BY_FORCE) * float(y @ y):
        return None
    first_state, last_state = s.rows[first], s.rows[end - 1]
    span = float(s.time[first_state]), float(s.time[last_state])
    log = s.logs[s.piece[first_state]]
    return FoundCause("push", (), np.inf, np.inf, fit, refit, number=float(np.linalg.norm(f)), span=span, log=log)


def _without_jumps(fit: CauseFit) -> CauseFit:
    """Fit without the rows beside a jump of a position, where accelerations come from the low-pass."""
    s = fit.states
    is_kept = np.ones(len(s.rows), bool)
    for jump in causes.jumps(s):
        if jump.since is not None:
            piece, time = jump.since
            is_other_piece = s.piece[s.rows] != piece
            is_kept &= is_other_piece | (np.abs(s.time[s.rows] - time) > _RINGING_PERIODS / s.cutoff)
    return fit if is_kept.all() else fit.refit(s.with_fields(rows=s.rows[is_kept]))


def _sway(fit: CauseFit) -> tuple[list[FoundCause], int]:
    """Swaying base, if one is found, and the number of tested causes.

    The base accelerates along two horizontal axes. The residual of a row is W(e_x) x a_x + W(e_y) x a_y, with W(e) the columns
    of the robot at rest by an acceleration e of the base. The accelerations of all rows have a dominant frequency, at which
    cosine and sine columns are then fitted together with the groups.
    """
    s = fit.states
    if not s.gravity.any() or len(s.pieces) != 1:
        return [], 0
    x = fit.x[: s.base.count]
    _, _, axes = np.linalg.svd(s.gravity[None])  # the first along gravity
    horizontal_axes = axes[1:]
    at_rest = s.with_fields(dq=0.0 * s.dq, ddq=0.0 * s.ddq)
    axis_columns: list[Array] = []
    for axis in horizontal_axes:
        accelerated = at_rest.with_fields(gravity=s.gravity - axis)
        torques = accelerated.predicted_torques(x) - at_rest.predicted_torques(x)
        axis_columns.append(torques * fit.live)
    A = np.stack(axis_columns, axis=-1) * np.sqrt(fit.weight)[:, None]
    if not A.any():
        return [], 0
    y = (fit.left * np.sqrt(fit.weight))[..., None]
    N = A.swapaxes(1, 2) @ A
    N += np.trace(N, axis1=1, axis2=2).mean() * 1e-2 * np.eye(2)  # a pose may determine only one direction
    accelerations = np.linalg.solve(N, A.swapaxes(1, 2) @ y)[..., 0]
    time = s.time[s.rows]
    hertz = _dominant_frequency(time, accelerations)
    columns: list[Array] = []
    for axis_column in axis_columns:
        columns.append(axis_column * np.cos(2 * np.pi * hertz * time)[:, None])
        columns.append(axis_column * np.sin(2 * np.pi * hertz * time)[:, None])
    refit = fit.refit(s, *columns)
    squares = float((refit.left**2).sum())
    squares_without_sway = float((fit.left**2).sum())
    if squares > (1.0 - _MIN_SHARE_BY_SWAY) * squares_without_sway:
        return [], 1
    amplitude = float(np.linalg.norm(refit.x[-len(columns) :]))
    S = fit.gain(refit)
    return [FoundCause("swaying", (), S, refit.t_value(fit), fit, refit, number=hertz, size=amplitude)], 1


def _dominant_frequency(time: Array, signals: Array) -> float:
    """Frequency [Hz] of the largest power of signals a (n, k) at times (n,)."""
    padded_length = 4 * len(signals)  # with zeros, for a finer grid of frequencies
    spectrum = np.fft.rfft(signals - signals.mean(axis=0), padded_length, axis=0)
    power = (np.abs(spectrum) ** 2).sum(axis=1)
    frequencies = np.fft.rfftfreq(padded_length, float(np.median(np.diff(time))))
    largest = int(power[1:].argmax()) + 1  # without frequency 0
    return float(frequencies[largest])


def _causes_of_log(fit: CauseFit) -> tuple[Iterator[FoundCause], int]:
    """Causes of the log with their evidence, and the number of tested causes.

    Discrete causes are tested only if the residual is large, each by a refit; continuous causes are screened by their columns.
    """
    s = fit.states
    discrete: list[Cause] = []
    share_of_all = float(np.sqrt((fit.left**2).sum() / max(float((fit.tau**2).sum()), 1e-300)))
    largest_share = float(fit.shares.max())
    is_large = share_of_all > _MIN_RESIDUAL_OF_ALL or largest_share > _MIN_RESIDUAL_OF_JOINT
    if is_large:
        worst_joints = np.argsort(-fit.shares)[:_MAX_SUSPECTS]
        suspects = np.sort(worst_joints[fit.live[worst_joints]]).tolist()
        discrete = [*causes.discrete_causes(s, suspects), *_causes_without_sign(fit)]
    continuous = [*causes.continuous_causes(s, wide=is_large), *causes.jumps(s), *causes.plays(s)]
    laws = list(causes.laws_of_the_log(s))

    def tested_causes() -> Iterator[FoundCause]:
        """Causes with their evidence, of which few are in memory at once."""
        yield from _refine_laws(fit, screen_laws(fit, laws))
        for cause in discrete:
            yield _tested_cause(fit, fit.refit(cause.correct(s)), cause)
        screened = [*screen_causes(fit, continuous), *screen_changes(fit)]
        yield from _refine_causes(fit, screened)
        yield from _refine_laws(fit, screened)

    test_count = len(discrete) + sum(len(cause.starts) for cause in continuous)
    return tested_causes(), test_count


def _causes_without_sign(fit: CauseFit) -> Iterator[Cause]:
    """Causes of torques that lost their sign, for joints whose torques are nowhere clearly negative.

    The fit of the other joints decides.
    """
    s = fit.states
    rms = np.sqrt((s.tau**2).mean(axis=0))
    is_positive = s.tau.min(axis=0) > -causes.MIN_NEGATIVE_PART * rms
    for k in np.flatnonzero(fit.live & is_positive).tolist():
        is_other = np.arange(len(fit.live)) != k
        fit_of_others = CauseFit(s, fit.groups, fit.live & is_other)
        cause = causes.torque_without_sign(s, k, fit_of_others.x)
        if cause is not None:
            yield cause


def _laws_of_joints(fit: CauseFit) -> tuple[Iterator[FoundCause], int]:
    """Causes of the joints: laws and elasticity, screened by their columns; and a swaying base."""
    swaying, sway_tests = _sway(fit)
    elasticities = _refine_causes(fit, fit.joint_causes)
    tested = chain(_refine_laws(fit, fit.joint_causes), elasticities, swaying)
    return tested, len(fit.joint_causes) + sway_tests


def _refine_laws(fit: CauseFit, screened: Sequence[ScreenedCause]) -> Iterator[FoundCause]:
    """Refine the laws whose columns gain most."""
    laws = [candidate for candidate in screened if isinstance(candidate.cause, Law)]
    for law in sorted(laws, key=lambda law: -law.S)[:_MAX_REFINED]:
        if law.S > 0.5 * LEAST_S:  # a refit may raise S
            found = _refine_law(fit, law)
            if LEAST_S + found.cost <= found.S:
                yield found


def _refine_law(fit: CauseFit, screened: ScreenedCause) -> FoundCause:
    """Law with its coefficients from a second refit, whose columns come from the torques of the first refit."""
    s, law = fit.states, screened.cause
    assert isinstance(law, Law)
    first_refit = fit.refit(s, *np.moveaxis(screened.e, -1, 0))
    group_values = first_refit.x[: s.base.count]  # coefficients of the law follow
    (e,) = law_columns(fit, [law], FittedTorques.from_groups(s, group_values))
    refit = fit.refit(s, *np.moveaxis(e, -1, 0))
    column_count = e.shape[-1]
    reported_count, cost = 1, 0.0  # only the mass of a load is reported
    if law.kind == "force":
        reported_count, cost = column_count, _FORCE_COST
    S, t = fit.gain(refit), refit.t_value(fit)
    coefficients = refit.x[-column_count:]
    deviations = refit.law_deviation(column_count)
    value, deviation = coefficients[:reported_count], deviations[:reported_count]
    refit.release(fit)
    found = FoundCause(law.kind, law.joints, S, t, fit, refit, law=law, value=value, deviation=deviation, cost=cost)
    return replace(found, **_begin(s, law.since))


def _refine_causes(fit: CauseFit, screened: Sequence[ScreenedCause]) -> list[FoundCause]:
    """Refine the causes with a value whose columns gain most, by Gauss-Newton steps."""
    refined: dict[tuple[str, tuple[int, ...]], FoundCause] = {}
    for candidate in sorted(screened, key=lambda candidate: -candidate.S):
        if candidate.S < 0.5 * LEAST_S or len(refined) == _MAX_REFINED:
            break
        cause = candidate.cause
        if isinstance(cause, Cause) and (cause.kind, cause.joints) not in refined:
            refined[cause.kind, cause.joints] = refine_cause(fit, cause, candidate.beta)
    return sorted(refined.values(), key=lambda result: _ORDER.get(result.kind, 0))


def refine_cause(fit: CauseFit, cause: Cause, beta: Array) -> FoundCause:
    """Cause at the value that minimises the held-out residual, found from a nearby value ``beta``."""
    s = fit.states
    best = fit.refit(cause.correct(s, beta))
    S = fit.gain(best)
    for _ in range(_MAX_STEPS):
        columns = cause_columns(best, s, cause, beta)
        _, coefficients = best.gains_of_columns(columns[:, :, None])
        step = coefficients[0]
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
    """Cause with the evidence of the refit with it against the fit without it."""
    S, t = fit.gain(refit), refit.t_value(fit)
    refit.release(fit)
    found = FoundCause(cause.kind, cause.joints, S, t, fit, refit, cause.correct, number=cause.number, cost=cause.cost)
    return replace(found, **_begin(fit.states, cause.since))


def _begin(s: LogStates, since: tuple[int, float] | None) -> dict[str, Any]:
    """Fields of a cause that begins within a log: its begin and end [s], and the number of the log; empty for other causes."""
    if since is None:
        return {}
    piece, time = since
    return {"span": (time, float(s.time[s.rows[-1]])), "log": s.logs[piece]}


def effect(fit: CauseFit, found: FoundCause, *, seed: int = 0) -> float:
    """Largest change of predicted torques by the cause in another motion, as a share of a joint's torque (rms).

    The motion is :data:`_STATES` random states within 1.5 times the range of the log's positions, as fast as the log.
    """
    s = fit.states
    rng = np.random.default_rng(seed)
    middle = 0.5 * (s.q.max(axis=0) + s.q.min(axis=0))
    half_range = 0.75 * np.ptp(s.q, axis=0)
    q = middle + half_range * rng.uniform(-1.0, 1.0, (_STATES, len(half_range)))
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
    corrected_motion = found.correct(motion) if found.correct else motion
    after = corrected_motion.with_fields(lag=0.0).predicted_torques(found.fit.x[:r])
    if found.law is not None:
        e = found.law.columns(motion, FittedTorques.from_groups(motion, found.fit.x[:r]))
        after = after + e @ found.fit.x[-e.shape[-1] :]
    torques = np.sqrt((before**2).mean(axis=0))
    changes = np.sqrt(((after - before) ** 2).mean(axis=0))
    shares = changes / np.maximum(torques, 1e-300)
    return float(shares[fit.live].max())
