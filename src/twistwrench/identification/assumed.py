"""Causes that a fit assumes: their values are estimated with the groups of parameters, and removed from the log.

A cause with value β maps the samples (q, τ) of a log to a corrected log. With the groups x and the residual r = τ - W x
of the corrected log, Gauss-Newton steps solve for both together, with the rows and weights of the fit,

    r(x + dx, β + dβ) = r(x, β) - W dx - E dβ,      E = d(τ̂ - τ)/dβ,    τ̂ = W x

and the covariance of the groups is taken from [W E], so that their intervals include the uncertainty of β.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.doubts import doubt_table
from ..core.errors import UnknownNameError, ValueRangeError
from ..core.estimation.covariance import GroupCovariance, group_covariance
from ..core.estimation.cross_validation import FOLDS
from ..core.estimation.least_squares import Method, NormalEquations, Prior, weighted_fit
from ..core.typing import Array
from .base_columns import consecutive_slices
from .diagnosis import causes
from .diagnosis.cause_fit import CauseFit, law_columns, log_fit
from .diagnosis.causes import Cause, FittedTorques
from .diagnosis.diagnose import FoundCause, WantedCause, estimate_cause
from .diagnosis.log_states import LogStates
from .hyperparameters import AssumedCause, FitOptions, FitSettings, SettingRows, Trial
from .parameters import BaseParameters, UnknownParameters
from .rows import SteadySamples, lowest_rate, spring_torques

Built = tuple[SettingRows, Array, Prior]
"""Rows of samples, largest plausible sizes of the unknown parameters, and weak prior of their groups."""
Build = Callable[[BaseParameters, Sequence[SteadySamples]], Built]

_LAWS = ("load-friction", "warming", "drift")
_DISCRETE = ("torque-sign", "position-sign", "both-signs", "degrees", "zero-turn")
_PAIRS = ("exchanged-torques", "exchanged-positions")
JOINTS_OF_CAUSE: dict[str, tuple[int, ...]] = {
    **dict.fromkeys(("mounting", "time-scale"), (0,)),
    **dict.fromkeys(_PAIRS, (2,)),
    **dict.fromkeys(_DISCRETE, (1,)),
    **dict.fromkeys(("stribeck", "late", "tilt"), (0,)),
    **dict.fromkeys(("gain", "position-scale", "zero"), (1,)),
    **dict.fromkeys(("load-friction", "warming"), (0, 1)),
    "drift": (1,),
    "elasticity": (0, 1),
}
"""Causes that can be assumed, in the order of their removal, with the number of joints that each may name."""
_NOT_TAKEN_OFF = {
    "low-pass": "what a filter has taken away is not in the log. Log the torques before the filter, or filter positions alike.",
    "late-joint": "friction and elasticity of the joint show alike. Assume one of them, or late for all joints.",
    "no-gravity": "log the torque before the controller takes gravity off it.",
    **dict.fromkeys(("gain-change", "late-change", "load-change"), "use the rows before and after as two logs."),
}
_OF_TIME, _TURNING = ("warming", "drift"), ("tilt", "mounting")
_MAX_STEPS, _MAX_TORQUE_CHANGE = 4, 1e-3
"""Maximum number of Gauss-Newton steps; change of torques, in residual sizes, below which the iteration ends."""
_MIN_UNSPANNED_SHARE = 1e-7
"""Share of a column's squares not spanned by the others, below which no log determines its parameter."""
_CUTOFF_SHARE, _USUAL_SPEED = 0.1, 0.05
"""Cut-off as a share of the sampling rate, and Coulomb smoothing speed, at the beginning of the search."""
_PRIOR_WIDTH = 1e3
"""Prior standard deviation of β, as a multiple of the largest joint torque."""


def wanted_causes(assume: str | Sequence[str], names: Sequence[str]) -> tuple[WantedCause, ...]:
    """Parse causes such as ``KIND`` or ``KIND:JOINT`` and sort them in the order of their removal; raises for unknown ones.

    >>> wanted_causes(["zero:elbow", "tilt"], ["shoulder", "elbow"])
    (WantedCause(kind='tilt', joints=()), WantedCause(kind='zero', joints=(1,)))
    """
    found = list[WantedCause]()
    texts = [assume] if isinstance(assume, str) else assume
    for text in texts:
        one = _wanted_cause(str(text), names)
        for other in found:
            if other.kind == one.kind and (other == one or () in (other.joints, one.joints)):
                raise ValueRangeError(f"assume {text!r}: the cause is given twice.")
        found.append(one)
    order = list(JOINTS_OF_CAUSE)
    return tuple(sorted(found, key=lambda one: order.index(one.kind)))


def _wanted_cause(text: str, names: Sequence[str]) -> WantedCause:
    """Parse one cause; raises for an unknown cause or joint, and for another number of joints than it may name."""
    kind, *joints = map(str.strip, text.split(":"))
    if kind in _NOT_TAKEN_OFF:
        raise ValueRangeError(f"{kind} cannot be assumed: {_NOT_TAKEN_OFF[kind]}")
    if kind not in JOINTS_OF_CAUSE:
        raise UnknownNameError.from_choices("cause to assume", kind, JOINTS_OF_CAUSE)
    for joint in joints:
        if joint not in names:
            raise UnknownNameError.from_choices("joint", joint, names)
    if len(joints) not in JOINTS_OF_CAUSE[kind] or len({*joints}) < len(joints):
        forms = [kind + count * ":JOINT" for count in JOINTS_OF_CAUSE[kind]]
        raise ValueRangeError(f"assume {text!r}: write {' or '.join(forms)}.")
    return WantedCause(kind, tuple(sorted(names.index(joint) for joint in joints)))


Correction = Callable[[LogStates, Array, Array], LogStates]
"""Function that removes a cause from states, given the groups x (r,) and β (k,)."""


@dataclass(frozen=True, eq=False)
class _RemovedCause:
    """Cause, its correction, and β (empty for a cause without a value); ``number`` is the value of a discrete cause."""

    wanted: WantedCause
    correct: Correction
    beta: Array
    step: float = 0.0
    number: float | None = None


@dataclass(frozen=True, eq=False)
class AssumedCauses:
    """Assumed causes of a fit, and the log from which they are removed.

    Attributes
    ----------
    base : BaseParameters, under the gravity of the robot's file
    samples : sequence of SteadySamples, on the robot's clock
    causes : tuple of the causes, in the order of their removal
    dead : (nv,) bool array, True for joints without a torque
    settings : FitSettings, cut-off and friction speeds for rates and laws
    x : (r,) array, values of the groups
    """

    base: BaseParameters
    samples: Sequence[SteadySamples]
    causes: tuple[_RemovedCause, ...]
    dead: Array
    settings: FitSettings
    x: Array

    @classmethod
    def from_logs(
        cls,
        unknown: UnknownParameters,
        samples: Sequence[SteadySamples],
        wanted: Sequence[WantedCause],
        settings: FitSettings,
        dead: Array,
    ) -> AssumedCauses:
        """Estimate initial values of the causes one after another, by the search for causes."""
        removed, fit = list[_RemovedCause](), log_fit(unknown, samples, settings, dead)
        for one in wanted:
            x = fit.x[: fit.states.base.count]
            if one.kind in _LAWS:
                removal, fit = _with_law(one, fit, x)
            elif one.kind == "stribeck":
                unknown = _with_stribeck(unknown, fit)
                fit = log_fit(unknown, samples, settings, dead)
                fit = fit.refit(_correct_states(fit.states, removed, x))
                removal = _RemovedCause(one, _keep_states, np.zeros(0), number=unknown.stribeck_speed)
            else:
                best = estimate_cause(fit, _candidates(one, fit.states, x))
                removal, fit = _removal(one, fit.states, x, best), best.fit
                if one.kind == "time-scale":
                    samples = _with_clock(samples, float(best.number or 1.0))
                    fit = log_fit(unknown, samples, settings, dead).refit(fit.states)
            removed.append(removal)
        base = fit.states.base
        return cls(base, samples, tuple(removed), dead, settings, fit.x[: base.count])

    def _states(self, samples: Sequence[SteadySamples]) -> LogStates:
        """States of all samples, causes removed: unfiltered positions and torques, rates below the cut-off."""
        cutoff, speed = self.settings.cutoff, self.settings.friction_speed
        s = LogStates.from_samples(self.base, samples, cutoff, speed, np.inf, whole=True)
        return _correct_states(s, self.causes, self.x)

    def corrected_samples(self) -> tuple[list[SteadySamples], Array]:
        """Samples with the causes removed, and their gravity (3,)."""
        return self._correct(self.samples)

    def _correct(self, samples: Sequence[SteadySamples]) -> tuple[list[SteadySamples], Array]:
        s = self._states(samples)
        tau = s.shifted_torques / s.gain
        return [replace(one, q=s.q[p], tau=tau[p]) for one, p in zip(samples, s.pieces, strict=True)], s.gravity

    def correct_other_logs(self, samples: Sequence[SteadySamples]) -> list[SteadySamples]:
        """Remove the causes from test logs; causes that depend on the time in a log are not removed."""
        scale = 1.0
        for one in self.causes:
            if one.wanted.kind == "time-scale":
                scale = one.number or 1.0
        same = tuple(one for one in self.causes if one.wanted.kind not in _OF_TIME)
        return replace(self, causes=same)._correct(_with_clock(samples, scale))[0]

    def columns(self, most: float) -> Array:
        """(m, nv, k) columns E of β in at most ``most`` rows of the corrected log."""
        s = LogStates.from_samples(self.base, self.samples, self.settings.cutoff, self.settings.friction_speed, most)
        columns = list[Array]()
        for k, one in enumerate(self.causes):
            for step in one.step * np.eye(len(one.beta)):
                above, _ = self._negative_residual(s, k, one.beta + step)
                below, gain = self._negative_residual(s, k, one.beta - step)
                e = s.low_passed((above - below) / (2.0 * one.step))[s.rows]
                columns.append(e / gain * ~self.dead)
        if not columns:
            return np.zeros((len(s.rows), len(s.gain), 0))
        return np.stack(columns, axis=-1)

    def _negative_residual(self, s: LogStates, k: int, beta: Array) -> tuple[Array, Array]:
        """τ̂ - τ (n, nv) of states, and their gains (nv,), if cause k has another value β."""
        moved = replace(self.causes[k], beta=beta)
        c = _correct_states(s, (*self.causes[:k], moved, *self.causes[k + 1 :]), self.x)
        springs = spring_torques(c.base, c.q, c.dq, c.ddq)
        return c.torques(self.x)[0] + springs - c.shifted_torques, c.gain

    def refine(self, build: Build, method: Method, most: float) -> tuple[AssumedCauses, FitSettings, Built]:
        """Refine the values for the rows of the fit, together with its settings.

        Raises ValueRangeError if the logs do not determine a value.
        """
        base = self.base
        if not any(one.wanted.kind in _TURNING for one in self.causes):
            base = BaseParameters.from_unknowns(self.base.unknown)
        assumed, (samples, gravity) = self, self.corrected_samples()
        built = build(_under(base, gravity), samples)
        (settings,) = built[0].choose(built[2], [range(FOLDS)])
        for _ in range(_MAX_STEPS):
            source, _, prior = built
            trial = Trial(source, settings)
            x, *_ = weighted_fit(trial.W, trial.tau, prior, method, trial.felt)
            assumed = replace(assumed, base=base, settings=settings, x=x)
            E = assumed.columns(most)
            if not E.shape[2]:
                break
            felt = np.concatenate([trial.felt, (E != 0.0).any(axis=0)], axis=1)
            W = np.concatenate([trial.W, E], axis=2)
            y, sigma, weights = weighted_fit(W, trial.tau, prior_with(prior, E, trial.tau), method, felt)
            assumed.check(W, np.sqrt(weights) / sigma)
            step = y[len(x) :]
            assumed = assumed.with_step(step)
            samples, gravity = assumed.corrected_samples()
            built = build(_under(base, gravity), samples)
            if (np.sqrt(((E @ step) ** 2).mean(axis=0)) <= _MAX_TORQUE_CHANGE * sigma).all():
                break
        return assumed, settings, built

    def _slices(self) -> list[slice]:
        """Places of the values of each cause among those of all."""
        return consecutive_slices(len(one.beta) for one in self.causes)

    def with_step(self, step: Array) -> AssumedCauses:
        """Causes with values changed by ``step`` (k,)."""
        pairs = zip(self.causes, self._slices(), strict=True)
        return replace(self, causes=tuple(replace(one, beta=one.beta + step[part]) for one, part in pairs))

    def check(self, W: Array, root: Array) -> None:
        """Raise ValueRangeError if weighted rows [W E] (m, nv, r + k) cannot distinguish a value from the groups."""
        N = NormalEquations.from_rows(W, 0.0 * root, root=root).N.sum(axis=0)
        size = np.sqrt(np.maximum(N.diagonal(), 1e-300))
        inverse = np.linalg.inv(N / size[:, None] / size + 1e-10 * np.eye(len(N)))
        unspanned = 1.0 / inverse.diagonal()[len(self.x) :]
        unspanned *= (W != 0.0).any(axis=(0, 1))[len(self.x) :]
        for one, part in zip(self.causes, self._slices(), strict=True):
            if (unspanned[part] < _MIN_UNSPANNED_SHARE).any():
                raise ValueRangeError(
                    f"{self.text_of(one.wanted)} cannot be assumed: these logs do not separate it from the parameters."
                )

    def text_of(self, wanted: WantedCause) -> str:
        """Text of a cause, as in ``assume``."""
        names = self.base.unknown.model.velocity_names
        return ":".join([wanted.kind, *(names[k] for k in wanted.joints)])

    def values(self, covariance: GroupCovariance) -> tuple[AssumedCause, ...]:
        """Causes with their values and intervals, from the covariance of [x, β]."""
        names, half = self.base.unknown.model.velocity_names, covariance.half_width()[len(self.x) :]
        gravity = tuple(self.corrected_samples()[1].tolist())
        found = list[AssumedCause]()
        for one, part in zip(self.causes, self._slices(), strict=True):
            kind = one.wanted.kind
            value, interval = one.number, None
            if len(one.beta):
                value, interval = causes.value_with_interval(kind, one.beta, half[part])
            joints = tuple(names[k] for k in one.wanted.joints)
            unit = "" if value is None else doubt_table()[kind].unit
            found.append(AssumedCause(kind, joints, value, interval, unit, gravity if kind in _TURNING else None))
        return tuple(found)


def begin_settings(nv: int, samples: Sequence[SteadySamples], asked: FitOptions) -> FitSettings:
    """Initial settings of the search, before settings are chosen."""
    cutoff = asked.cutoff or _CUTOFF_SHARE * lowest_rate(samples)
    return FitSettings(cutoff, np.full(nv, asked.friction_speed or _USUAL_SPEED), asked.shift or 0.0)


def prior_with(prior: Prior, E: Array, tau: Array) -> Prior:
    """Weak prior of the groups and of β, whose columns are E (m, nv, k)."""
    size = _PRIOR_WIDTH * np.sqrt((tau**2).mean(axis=0).max()) / np.maximum(np.sqrt((E**2).mean(axis=(0, 1))), 1e-300)
    return Prior(np.append(prior.mean, np.zeros(len(size))), np.append(prior.size, size))


def fit_covariance(trial: Trial, E: Array, x: Array, sigma: Array, weights: Array, prior: Prior) -> GroupCovariance:
    """Covariance of [x, β] at the chosen settings."""
    rows = trial.rows
    return group_covariance(
        np.concatenate([trial.W, E], axis=2), trial.tau, np.append(x, np.zeros(E.shape[2])), sigma, weights,
        prior_with(prior, E, trial.tau), rows.time, rows.log, (rows.position, rows.speed), trial.changes(x),
    )  # fmt: skip


def _keep_states(s: LogStates, _x: Array, _beta: Array) -> LogStates:
    return s


def _correct_states(s: LogStates, causes: Iterable[_RemovedCause], x: Array) -> LogStates:
    """Remove causes from states one after another."""
    for one in causes:
        s = one.correct(s, x, one.beta)
    return s


def _joints(wanted: WantedCause, s: LogStates) -> tuple[int, ...]:
    """Indices of the joints of a cause that names joints; all joints if it names none."""
    return wanted.joints or tuple(range(len(s.gain)))


def _with_law(one: WantedCause, fit: CauseFit, x: Array) -> tuple[_RemovedCause, CauseFit]:
    """Joint law with its coefficient, and the fit that contains it."""
    s = fit.states
    law = next(law for law in causes.laws(s) if (law.kind, law.joints) == (one.kind, _joints(one, s)))
    refit = fit.refit(s, law_columns(fit, [law], FittedTorques.from_groups(s, x))[0][..., 0])

    def correct(s: LogStates, x: Array, beta: Array) -> LogStates:
        return s.with_fields(
            tau=s.shifted_torques - beta[0] * law.columns(s, FittedTorques.from_groups(s, x))[..., 0], shift=0.0
        )

    return _RemovedCause(one, correct, refit.x[-1:], 1.0), refit


def _candidates(one: WantedCause, s: LogStates, x: Array) -> list[Cause]:
    """Candidate causes of that name, of which the best is assumed."""
    joints = one.joints
    if one.kind == "elasticity":
        joints = _joints(one, s)
        of_all_kinds = [*causes.compliances(s, s.low_passed(s.torques(x)[0]))]
    else:
        of_all_kinds = [*causes.discrete_causes(s, joints), *causes.continuous_causes(s, wide=True)]
    return [cause for cause in of_all_kinds if (cause.kind, cause.joints) == (one.kind, joints)]


def _removal(one: WantedCause, s: LogStates, x: Array, best: FoundCause) -> _RemovedCause:
    """Correction by a cause that was estimated from states with groups x."""
    if one.kind == "time-scale":
        return _RemovedCause(one, _keep_states, np.zeros(0), number=best.number)
    cause = next(c for c in _candidates(one, s, x) if best.value is not None or c.number == best.number)
    largest, joints = np.abs(s.low_passed(s.torques(x)[0])).max(axis=0), _joints(one, s)

    def correct_as_found(s: LogStates, _x: Array, _beta: Array) -> LogStates:
        return best.correct(s) if best.correct else s

    def correct_by_value(s: LogStates, _x: Array, beta: Array) -> LogStates:
        return cause.correct(s, beta)

    def correct_elasticity(s: LogStates, x: Array, beta: Array) -> LogStates:
        compliances = causes.compliances(s, s.low_passed(s.torques(x)[0]), largest)
        return next(c for c in compliances if c.joints == joints).correct(s, beta)

    if best.value is None:
        return _RemovedCause(one, correct_as_found, np.zeros(0), number=best.number)
    if one.kind == "elasticity":
        return _RemovedCause(one, correct_elasticity, best.value, cause.step)
    return _RemovedCause(one, correct_by_value, best.value, cause.step)


def _with_stribeck(unknown: UnknownParameters, fit: CauseFit) -> UnknownParameters:
    """Unknown parameters with static friction of each joint, at the Stribeck speed that explains most."""
    s, gains = fit.states, list[tuple[float, float]]()
    fitted = FittedTorques.from_groups(s, fit.x[: s.base.count])
    for speed in causes.STRIBECK_SPEEDS:
        laws = (law for law in causes.laws(s) if (law.kind, law.speed, len(law.joints)) == ("stribeck", speed, 1))
        columns = [e[..., 0] for e in law_columns(fit, laws, fitted) if e.any()]
        gains.append((fit.gain(fit.refit(s, *columns)), speed))
    friction = tuple(dict.fromkeys((*unknown.friction, "stribeck")))
    return replace(unknown, friction=friction, stribeck_speed=max(gains)[1])


def _under(base: BaseParameters, gravity: Array) -> BaseParameters:
    """The same groups under another gravity."""
    unknown = base.unknown
    if np.array_equal(gravity, unknown.model.gravity):
        return base
    return replace(base, unknown=replace(unknown, robot=unknown.robot.with_gravity(gravity)))


def _with_clock(samples: Sequence[SteadySamples], factor: float) -> list[SteadySamples]:
    """Samples with corrected times, for a log whose times are ``factor`` times the true ones."""
    return [replace(one, start=one.start / factor, rate=one.rate * factor) for one in samples]
