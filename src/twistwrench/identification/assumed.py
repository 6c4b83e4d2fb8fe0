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
from . import causes
from .cause_fit import CauseFit, law_columns, log_fit
from .causes import Cause, FittedTorques, LogStates
from .diagnosis import FoundCause, WantedCause, estimated
from .hyperparameters import AssumedCause, FitOptions, FitSettings, SettingRows, Trial
from .parameters import BaseParameters, UnknownParameters
from .rows import SteadySamples, of_springs

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
_STEPS, _SETTLED = 4, 1e-3
"""Maximum number of Gauss-Newton steps; change of torques, in residual sizes, below which the iteration ends."""
_UNTOLD = 1e-7
"""Share of a column's squares not spanned by the others, below which no log determines its parameter."""
_OF_RATE, _USUAL_SPEED = 0.1, 0.05
"""Cut-off as a share of the sampling rate, and Coulomb smoothing speed, at the beginning of the search."""
_WIDE = 1e3
"""Prior standard deviation of β, as a multiple of the largest joint torque."""


def wanted_causes(assume: str | Sequence[str], names: Sequence[str]) -> tuple[WantedCause, ...]:
    """Parse causes such as ``KIND`` or ``KIND:JOINT`` and sort them in the order of their removal; raises for unknown ones.

    >>> wanted_causes(["zero:elbow", "tilt"], ["shoulder", "elbow"])
    (WantedCause(kind='tilt', joints=()), WantedCause(kind='zero', joints=(1,)))
    """
    found = list[WantedCause]()
    for text in (assume,) if isinstance(assume, str) else assume:
        kind, *joints = (part.strip() for part in str(text).split(":"))
        if kind in _NOT_TAKEN_OFF:
            raise ValueRangeError(f"{kind} cannot be assumed: {_NOT_TAKEN_OFF[kind]}")
        if kind not in JOINTS_OF_CAUSE:
            raise UnknownNameError.from_choices("cause to assume", kind, JOINTS_OF_CAUSE)
        for joint in joints:
            if joint not in names:
                raise UnknownNameError.from_choices("joint", joint, names)
        if len(joints) not in JOINTS_OF_CAUSE[kind] or len({*joints}) < len(joints):
            ways = [":".join([kind, *["JOINT", "JOINT"][:count]]) for count in JOINTS_OF_CAUSE[kind]]
            raise ValueRangeError(f"assume {text!r}: write {' or '.join(ways)}.")
        one = WantedCause(kind, tuple(sorted(names.index(joint) for joint in joints)))
        if any(other.kind == kind and (other == one or () in (other.joints, one.joints)) for other in found):
            raise ValueRangeError(f"assume {text!r}: the cause is given twice.")
        found.append(one)
    order = list(JOINTS_OF_CAUSE)
    return tuple(sorted(found, key=lambda one: order.index(one.kind)))


Correction = Callable[[LogStates, Array, Array], LogStates]
"""Function that removes a cause from states, given the groups x (r,) and β (k,)."""


@dataclass(frozen=True, eq=False)
class _TakenOff:
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
    causes: tuple[_TakenOff, ...]
    dead: Array
    settings: FitSettings
    x: Array

    @classmethod
    def estimated(
        cls,
        unknown: UnknownParameters,
        samples: Sequence[SteadySamples],
        wanted: Sequence[WantedCause],
        settings: FitSettings,
        dead: Array,
    ) -> AssumedCauses:
        """Estimate initial values of the causes one after another, by the search for causes."""
        found, fit = list[_TakenOff](), log_fit(unknown, samples, settings, dead)
        for one in wanted:
            x = fit.x[: fit.states.base.count]
            if one.kind in _LAWS:
                taken, fit = _with_law(one, fit, x)
            elif one.kind == "stribeck":
                unknown = _with_stribeck(unknown, fit)
                fit = log_fit(unknown, samples, settings, dead)
                fit = fit.refit(_corrected(fit.states, found, x))
                taken = _TakenOff(one, _unchanged, np.zeros(0), number=unknown.stribeck_speed)
            else:
                best = estimated(fit, _candidates(one, fit.states, x))
                taken, fit = _taken_off(one, fit.states, x, best), best.fit
                if one.kind == "time-scale":
                    samples = _clocked(samples, float(best.number or 1.0))
                    fit = log_fit(unknown, samples, settings, dead).refit(fit.states)
            found.append(taken)
        base = fit.states.base
        return cls(base, samples, tuple(found), dead, settings, fit.x[: base.count])

    def _states(self, samples: Sequence[SteadySamples]) -> LogStates:
        """States of all samples, causes removed: unfiltered positions and torques, rates below the cut-off."""
        cutoff, speed = self.settings.cutoff, self.settings.friction_speed
        s = LogStates.from_samples(self.base, samples, cutoff, speed, np.inf, whole=True)
        return _corrected(s, self.causes, self.x)

    def corrected(self) -> tuple[list[SteadySamples], Array]:
        """Samples with the causes removed, and their gravity (3,)."""
        return self._corrected(self.samples)

    def _corrected(self, samples: Sequence[SteadySamples]) -> tuple[list[SteadySamples], Array]:
        s = self._states(samples)
        tau = s.in_time / s.gain
        return [replace(one, q=s.q[p], tau=tau[p]) for one, p in zip(samples, s.pieces, strict=True)], s.gravity

    def of_other_logs(self, samples: Sequence[SteadySamples]) -> list[SteadySamples]:
        """Remove the causes from test logs; causes that depend on the time in a log are not removed."""
        scale = next((one.number for one in self.causes if one.wanted.kind == "time-scale"), None)
        same = tuple(one for one in self.causes if one.wanted.kind not in _OF_TIME)
        return replace(self, causes=same)._corrected(_clocked(samples, scale or 1.0))[0]

    def columns(self, most: float) -> Array:
        """(m, nv, k) columns E of β in at most ``most`` rows of the corrected log."""
        s = LogStates.from_samples(self.base, self.samples, self.settings.cutoff, self.settings.friction_speed, most)
        found = list[Array]()
        for k, one in enumerate(self.causes):
            for axis in np.eye(len(one.beta)):
                ends = []
                for way in (1.0, -1.0):
                    moved = replace(one, beta=one.beta + way * one.step * axis)
                    c = _corrected(s, (*self.causes[:k], moved, *self.causes[k + 1 :]), self.x)
                    ends.append(c.torques(self.x)[0] + of_springs(c.base, c.q, c.dq, c.ddq) - c.in_time)
                e = s.filtered((ends[0] - ends[1]) / (2.0 * one.step))[s.rows]
                found.append(e / c.gain * ~self.dead)
        return np.stack(found, axis=-1) if found else np.zeros((len(s.rows), len(s.gain), 0))

    def refined(self, build: Build, method: Method, most: float) -> tuple[AssumedCauses, FitSettings, Built]:
        """Refine the values for the rows of the fit, together with its settings.

        Raises ValueRangeError if the logs do not determine a value.
        """
        turned = any(one.wanted.kind in _TURNING for one in self.causes)
        base = self.base if turned else BaseParameters.from_unknowns(self.base.unknown)
        known, (samples, gravity) = self, self.corrected()
        made = build(_under(base, gravity), samples)
        (settings,) = made[0].choose(made[2], [range(FOLDS)])
        for _ in range(_STEPS):
            trial = Trial(made[0], settings)
            x, *_ = weighted_fit(trial.W, trial.tau, made[2], method, trial.felt)
            known = replace(known, base=base, settings=settings, x=x)
            E = known.columns(most)
            if not E.shape[2]:
                break
            felt = np.concatenate([trial.felt, (E != 0.0).any(axis=0)], axis=1)
            W = np.concatenate([trial.W, E], axis=2)
            y, sigma, weights = weighted_fit(W, trial.tau, prior_with(made[2], E, trial.tau), method, felt)
            known.check(W, np.sqrt(weights) / sigma)
            step = y[len(x) :]
            known = known.moved(step)
            samples, gravity = known.corrected()
            made = build(_under(base, gravity), samples)
            if (np.sqrt(((E @ step) ** 2).mean(axis=0)) <= _SETTLED * sigma).all():
                break
        return known, settings, made

    def moved(self, step: Array) -> AssumedCauses:
        """Causes with values changed by ``step`` (k,)."""
        causes, at = list[_TakenOff](), 0
        for one in self.causes:
            causes.append(replace(one, beta=one.beta + step[at : at + len(one.beta)]))
            at += len(one.beta)
        return replace(self, causes=tuple(causes))

    def check(self, W: Array, root: Array) -> None:
        """Raise ValueRangeError if weighted rows [W E] (m, nv, r + k) cannot distinguish a value from the groups."""
        N = NormalEquations.from_rows(W, 0.0 * root, root=root).N.sum(axis=0)
        size = np.sqrt(np.maximum(N.diagonal(), 1e-300))
        left = 1.0 / np.linalg.inv(N / size[:, None] / size + 1e-10 * np.eye(len(N))).diagonal()[len(self.x) :]
        left *= (W != 0.0).any(axis=(0, 1))[len(self.x) :]
        at = 0
        for one in self.causes:
            if (left[at : at + len(one.beta)] < _UNTOLD).any():
                raise ValueRangeError(
                    f"{self.text_of(one.wanted)} cannot be assumed: these logs do not separate it from the parameters."
                )
            at += len(one.beta)

    def text_of(self, wanted: WantedCause) -> str:
        """Text of a cause, as in ``assume``."""
        names = self.base.unknown.model.velocity_names
        return ":".join([wanted.kind, *(names[k] for k in wanted.joints)])

    def found(self, covariance: GroupCovariance) -> tuple[AssumedCause, ...]:
        """Causes with their values and intervals, from the covariance of [x, β]."""
        names, half = self.base.unknown.model.velocity_names, covariance.half_width()[len(self.x) :]
        gravity, at, found = tuple(self.corrected()[1].tolist()), 0, list[AssumedCause]()
        for one in self.causes:
            kind, count = one.wanted.kind, len(one.beta)
            value, interval = causes.in_units(kind, one.beta, half[at : at + count]) if count else (one.number, None)
            at += count
            joints = tuple(names[k] for k in one.wanted.joints)
            unit = "" if value is None else doubt_table()[kind].unit
            found.append(AssumedCause(kind, joints, value, interval, unit, gravity if kind in _TURNING else None))
        return tuple(found)


def begin_settings(nv: int, samples: Sequence[SteadySamples], asked: FitOptions) -> FitSettings:
    """Initial settings of the search, before settings are chosen."""
    cutoff = asked.cutoff or _OF_RATE * min(one.rate for one in samples)
    return FitSettings(cutoff, np.full(nv, asked.friction_speed or _USUAL_SPEED), asked.shift or 0.0)


def prior_with(prior: Prior, E: Array, tau: Array) -> Prior:
    """Weak prior of the groups and of β, whose columns are E (m, nv, k)."""
    size = _WIDE * np.sqrt((tau**2).mean(axis=0).max()) / np.maximum(np.sqrt((E**2).mean(axis=(0, 1))), 1e-300)
    return Prior(np.append(prior.mean, np.zeros(len(size))), np.append(prior.size, size))


def fit_covariance(trial: Trial, E: Array, x: Array, sigma: Array, weights: Array, prior: Prior) -> GroupCovariance:
    """Covariance of [x, β] at the chosen settings."""
    rows = trial.rows
    return group_covariance(
        np.concatenate([trial.W, E], axis=2), trial.tau, np.append(x, np.zeros(E.shape[2])), sigma, weights,
        prior_with(prior, E, trial.tau), rows.time, rows.log, (rows.position, rows.speed), trial.changes(x),
    )  # fmt: skip


# ── One cause


def _unchanged(s: LogStates, _x: Array, _beta: Array) -> LogStates:
    return s


def _corrected(s: LogStates, causes: Iterable[_TakenOff], x: Array) -> LogStates:
    """Remove causes from states one after another."""
    for one in causes:
        s = one.correct(s, x, one.beta)
    return s


def _joints(wanted: WantedCause, s: LogStates) -> tuple[int, ...]:
    """Indices of the joints of a cause that names joints; all joints if it names none."""
    return wanted.joints or tuple(range(len(s.gain)))


def _with_law(one: WantedCause, fit: CauseFit, x: Array) -> tuple[_TakenOff, CauseFit]:
    """Joint law with its coefficient, and the fit that contains it."""
    s = fit.states
    law = next(law for law in causes.laws(s) if (law.kind, law.joints) == (one.kind, _joints(one, s)))
    refit = fit.refit(s, law_columns(fit, [law], FittedTorques.from_groups(s, x))[0][..., 0])

    def correct(s: LogStates, x: Array, beta: Array) -> LogStates:
        return s.changed(tau=s.in_time - beta[0] * law.columns(s, FittedTorques.from_groups(s, x))[..., 0], shift=0.0)

    return _TakenOff(one, correct, refit.x[-1:], 1.0), refit


def _candidates(one: WantedCause, s: LogStates, x: Array) -> list[Cause]:
    """Candidate causes of that name, of which the best is assumed."""
    tried: Iterable[Cause]
    if one.kind == "elasticity":
        one = replace(one, joints=_joints(one, s))
        tried = causes.compliances(s, s.filtered(s.torques(x)[0]))
    else:
        tried = (*causes.discrete_causes(s, one.joints), *causes.continuous_causes(s, wide=True))
    return [cause for cause in tried if (cause.kind, cause.joints) == (one.kind, one.joints)]


def _taken_off(one: WantedCause, s: LogStates, x: Array, best: FoundCause) -> _TakenOff:
    """Correction by a cause that was estimated from states with groups x."""
    if one.kind == "time-scale":
        return _TakenOff(one, _unchanged, np.zeros(0), number=best.number)
    cause = next(c for c in _candidates(one, s, x) if best.value is not None or c.number == best.number)
    largest, joints = np.abs(s.filtered(s.torques(x)[0])).max(axis=0), _joints(one, s)

    def as_found(s: LogStates, _x: Array, _beta: Array) -> LogStates:
        return best.correct(s) if best.correct else s

    def by_value(s: LogStates, _x: Array, beta: Array) -> LogStates:
        return cause.correct(s, beta)

    def twisted(s: LogStates, x: Array, beta: Array) -> LogStates:
        each = causes.compliances(s, s.filtered(s.torques(x)[0]), largest)
        return next(c for c in each if c.joints == joints).correct(s, beta)

    if best.value is None:
        return _TakenOff(one, as_found, np.zeros(0), number=best.number)
    return _TakenOff(one, twisted if one.kind == "elasticity" else by_value, best.value, cause.step)


def _with_stribeck(unknown: UnknownParameters, fit: CauseFit) -> UnknownParameters:
    """Unknown parameters with static friction of each joint, at the Stribeck speed that explains most."""
    s, best = fit.states, list[tuple[float, float]]()
    fitted = FittedTorques.from_groups(s, fit.x[: s.base.count])
    for speed in causes.STRIBECK_SPEEDS:
        mine = (law for law in causes.laws(s) if (law.kind, law.speed, len(law.joints)) == ("stribeck", speed, 1))
        columns = [e[..., 0] for e in law_columns(fit, mine, fitted) if e.any()]
        best.append((fit.gained(fit.refit(s, *columns)), speed))
    friction = tuple(dict.fromkeys((*unknown.friction, "stribeck")))
    return replace(unknown, friction=friction, stribeck_speed=max(best)[1])


def _under(base: BaseParameters, gravity: Array) -> BaseParameters:
    """The same groups under another gravity."""
    unknown = base.unknown
    if np.array_equal(gravity, unknown.model.gravity):
        return base
    return replace(base, unknown=replace(unknown, robot=unknown.robot.with_gravity(gravity)))


def _clocked(samples: Sequence[SteadySamples], factor: float) -> list[SteadySamples]:
    """Samples with corrected times, for a log whose times are ``factor`` times the true ones."""
    return [replace(one, start=one.start / factor, rate=one.rate * factor) for one in samples]
