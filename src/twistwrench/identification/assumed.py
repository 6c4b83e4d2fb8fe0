"""Causes that a fit assumes: their values are estimated with the groups of parameters, and removed from the log.

A cause with value β maps the samples (q, τ) of a log to a corrected log. With the groups x and the residual r = τ - W x of
the corrected log, Gauss-Newton steps solve for x and β together, with the rows and weights of the fit:

    r(x + dx, β + dβ) = r(x, β) - W dx - E dβ,      E = d(τ̂ - τ)/dβ,    τ̂ = W x

The covariance of the groups is taken from [W E], so that their intervals include the uncertainty of β.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

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
"""Result of :data:`Build`: rows of samples, largest plausible sizes of the unknown parameters, weak prior of their groups."""
Build = Callable[[BaseParameters, Sequence[SteadySamples]], Built]
"""Function that computes :data:`Built` for groups of parameters and samples."""

_LAWS = ("load-friction", "warming", "drift")
"""Causes that are joint laws: they add torques."""
_DISCRETE = ("torque-sign", "position-sign", "both-signs", "degrees", "zero-turn")
"""Discrete causes of one joint."""
_PAIRS = ("exchanged-torques", "exchanged-positions")
"""Discrete causes of two joints."""
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
"""Causes that can be assumed, in the order of their removal, with the numbers of joints that each may name."""
_NOT_REMOVABLE = {
    "low-pass": "what a filter has taken away is not in the log. Log the torques before the filter, or filter positions alike.",
    "late-joint": "friction and elasticity of the joint show alike. Assume one of them, or late for all joints.",
    "no-gravity": "log the torque before the controller takes gravity off it.",
    **dict.fromkeys(("gain-change", "late-change", "load-change"), "use the rows before and after as two logs."),
}
"""Causes that cannot be removed from a log, with advice."""
_TIME_DEPENDENT = ("warming", "drift")
"""Causes that depend on the time in a log."""
_GRAVITY_CHANGING = ("tilt", "mounting")
"""Causes that change the direction of gravity."""
_MAX_STEPS = 4
"""Maximum number of Gauss-Newton steps."""
_MAX_TORQUE_CHANGE = 1e-3
"""Change of torques (rms), relative to the residuals, below which the iteration ends."""
_MIN_UNSPANNED_SHARE = 1e-7
"""Share of a column's squares not spanned by the others, below which no log determines its parameter."""
_INITIAL_CUTOFF_SHARE = 0.1
"""Initial cut-off as a share of the sampling rate."""
_INITIAL_FRICTION_SPEED = 0.05
"""Initial Coulomb smoothing speed [rad/s, m/s]."""
_PRIOR_WIDTH = 1e3
"""Prior standard deviation of β, as a multiple of the largest joint torque."""


def wanted_causes(assume: str | Sequence[str], names: Sequence[str]) -> tuple[WantedCause, ...]:
    """Parse causes such as ``KIND`` or ``KIND:JOINT``, and sort them in the order of their removal.

    >>> wanted_causes(["zero:elbow", "tilt"], ["shoulder", "elbow"])
    (WantedCause(kind='tilt', joints=()), WantedCause(kind='zero', joints=(1,)))
    """
    wanted = list[WantedCause]()
    texts = [assume] if isinstance(assume, str) else assume
    for text in texts:
        cause = _wanted_cause(str(text), names)
        for other in wanted:
            if other.kind != cause.kind:
                continue
            one_names_no_joint = () in (other.joints, cause.joints)  # it is for all joints, and contains the other
            if other == cause or one_names_no_joint:
                raise ValueRangeError(f"assume {text!r}: the cause is given twice.")
        wanted.append(cause)
    order = list(JOINTS_OF_CAUSE)
    return tuple(sorted(wanted, key=lambda cause: order.index(cause.kind)))


def _wanted_cause(text: str, names: Sequence[str]) -> WantedCause:
    """Parse one cause; raises UnknownNameError or ValueRangeError for an unknown cause or joint, or too many joints."""
    kind, *joints = map(str.strip, text.split(":"))
    if kind in _NOT_REMOVABLE:
        raise ValueRangeError(f"{kind} cannot be assumed: {_NOT_REMOVABLE[kind]}")
    if kind not in JOINTS_OF_CAUSE:
        raise UnknownNameError.from_choices("cause to assume", kind, JOINTS_OF_CAUSE)
    for joint in joints:
        if joint not in names:
            raise UnknownNameError.from_choices("joint", joint, names)
    has_joint_twice = len({*joints}) < len(joints)
    if len(joints) not in JOINTS_OF_CAUSE[kind] or has_joint_twice:
        forms = [kind + joint_count * ":JOINT" for joint_count in JOINTS_OF_CAUSE[kind]]
        raise ValueRangeError(f"assume {text!r}: write {' or '.join(forms)}.")
    joint_indices = sorted(names.index(joint) for joint in joints)
    return WantedCause(kind, tuple(joint_indices))


Correction = Callable[[LogStates, Array, Array], LogStates]
"""Function that removes a cause from states, given the groups x (r,) and β (k,)."""


@dataclass(frozen=True, eq=False)
class _RemovedCause:
    """Cause with its value and its correction."""

    wanted: WantedCause
    """Kind and joints of the cause."""
    correct: Correction
    beta: Array
    """(k,) value β; empty for a cause without a continuous value."""
    step: float = 0.0
    """Step of β in finite differences."""
    number: float | None = None
    """Value of a discrete cause; otherwise None."""


@dataclass(frozen=True, eq=False)
class AssumedCauses:
    """Assumed causes of a fit, and the log from which they are removed.

    Attributes
    ----------
    base : BaseParameters, under the gravity of the robot's file
    samples : sequence of SteadySamples, with times of the robot's clock
    causes : tuple of the causes, in the order of their removal
    dead : (nv,) bool array, True for joints without torques in the log
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
        """Estimate initial values of the causes one after another, each from the log without the causes before it."""
        removed_causes = list[_RemovedCause]()
        fit = log_fit(unknown, samples, settings, dead)
        for cause in wanted:
            x = fit.x[: fit.states.base.count]  # groups; coefficients of laws follow
            if cause.kind in _LAWS:
                removed, fit = _with_law(cause, fit, x)
            elif cause.kind == "stribeck":  # more unknown parameters
                unknown = _with_stribeck(unknown, fit)
                fit = log_fit(unknown, samples, settings, dead)
                fit = fit.refit(_correct_states(fit.states, removed_causes, x))
                removed = _RemovedCause(cause, _keep_states, np.zeros(0), number=unknown.stribeck_speed)
            else:
                found = estimate_cause(fit, _candidates(cause, fit.states, x))
                removed = _removal(cause, fit.states, x, found)
                fit = found.fit
                if cause.kind == "time-scale":  # other samples
                    samples = _with_clock(samples, float(found.number or 1.0))  # 1 without a number
                    fit = log_fit(unknown, samples, settings, dead).refit(fit.states)
            removed_causes.append(removed)
        base = fit.states.base
        return cls(base, samples, tuple(removed_causes), dead, settings, fit.x[: base.count])

    def _states(self, samples: Sequence[SteadySamples]) -> LogStates:
        """States of all samples, causes removed: unfiltered positions and torques, rates below the cut-off."""
        settings = self.settings
        no_maximum = np.inf  # of the number of rows
        s = LogStates.from_samples(self.base, samples, settings.cutoff, settings.friction_speed, no_maximum, whole=True)
        return _correct_states(s, self.causes, self.x)

    def corrected_samples(self) -> tuple[list[SteadySamples], Array]:
        """Samples with the causes removed, and their gravity (3,)."""
        return self._correct(self.samples)

    def _correct(self, samples: Sequence[SteadySamples]) -> tuple[list[SteadySamples], Array]:
        """Samples of these or other logs with the causes removed, and their gravity (3,)."""
        s = self._states(samples)
        tau = s.shifted_torques / s.gain
        corrected = [replace(log, q=s.q[rows], tau=tau[rows]) for log, rows in zip(samples, s.pieces, strict=True)]
        return corrected, s.gravity

    def correct_other_logs(self, samples: Sequence[SteadySamples]) -> list[SteadySamples]:
        """Remove the causes from test logs; causes that depend on the time in a log are not removed."""
        clock_factor = 1.0
        for removed in self.causes:
            if removed.wanted.kind == "time-scale":
                clock_factor = removed.number or 1.0
        time_independent = tuple(removed for removed in self.causes if removed.wanted.kind not in _TIME_DEPENDENT)
        on_robot_clock = _with_clock(samples, clock_factor)
        corrected, _ = replace(self, causes=time_independent)._correct(on_robot_clock)
        return corrected

    def columns(self, max_rows: float) -> Array:
        """Columns E (m, nv, k) of β in at most ``max_rows`` rows of the corrected log."""
        settings = self.settings
        s = LogStates.from_samples(self.base, self.samples, settings.cutoff, settings.friction_speed, max_rows)
        columns = list[Array]()
        for index, removed in enumerate(self.causes):
            for step in removed.step * np.eye(len(removed.beta)):
                residual_above, _ = self._negative_residual(s, index, removed.beta + step)
                residual_below, gain = self._negative_residual(s, index, removed.beta - step)
                slope = (residual_above - residual_below) / (2.0 * removed.step)
                column = s.low_passed(slope)[s.rows]
                columns.append(column / gain * ~self.dead)  # torques of the rows are divided by their gains, too
        if not columns:
            return np.zeros((len(s.rows), len(s.gain), 0))
        return np.stack(columns, axis=-1)

    def _negative_residual(self, s: LogStates, index: int, beta: Array) -> tuple[Array, Array]:
        """τ̂ - τ (n, nv) of states, and their gains (nv,), if the cause with this index has another value β."""
        changed_causes = list(self.causes)
        changed_causes[index] = replace(self.causes[index], beta=beta)
        corrected = _correct_states(s, changed_causes, self.x)
        springs = spring_torques(corrected.base, corrected.q, corrected.dq, corrected.ddq)
        predicted, _ = corrected.torques(self.x)
        return predicted + springs - corrected.shifted_torques, corrected.gain

    def refine(self, build: Build, method: Method, max_rows: float) -> tuple[AssumedCauses, FitSettings, Built]:
        """Refine the values for the rows of the fit: causes with refined values, settings, and the rows built with both.

        Raises ValueRangeError if the logs do not determine a value.
        """
        base = self.base  # its groups hold for any direction of gravity
        changes_gravity = any(removed.wanted.kind in _GRAVITY_CHANGING for removed in self.causes)
        if not changes_gravity:
            base = BaseParameters.from_unknowns(self.base.unknown)
        assumed = self
        samples, gravity = self.corrected_samples()
        built = build(_under_gravity(base, gravity), samples)
        setting_rows, _, prior = built
        (settings,) = setting_rows.choose(prior, [range(FOLDS)])
        for _ in range(_MAX_STEPS):
            setting_rows, _, prior = built
            trial = Trial(setting_rows, settings)
            x, *_ = weighted_fit(trial.W, trial.tau, prior, method, trial.felt)
            assumed = replace(assumed, base=base, settings=settings, x=x)
            E = assumed.columns(max_rows)
            if not E.shape[2]:  # no cause has a value
                break
            felt_values = (E != 0.0).any(axis=0)
            felt = np.concatenate([trial.felt, felt_values], axis=1)
            W = np.concatenate([trial.W, E], axis=2)
            extended_prior = prior_with(prior, E, trial.tau)
            solution, sigma, weights = weighted_fit(W, trial.tau, extended_prior, method, felt)
            assumed.check(W, np.sqrt(weights) / sigma)
            step = solution[len(x) :]  # of β; the groups come first
            assumed = assumed.with_step(step)
            samples, gravity = assumed.corrected_samples()
            built = build(_under_gravity(base, gravity), samples)
            squared_changes = (E @ step) ** 2
            torque_change = np.sqrt(squared_changes.mean(axis=0))  # rms of each joint
            if (torque_change <= _MAX_TORQUE_CHANGE * sigma).all():
                break
        return assumed, settings, built

    def _slices(self) -> list[slice]:
        """Slice of each cause's values among the values of all causes."""
        return consecutive_slices(len(removed.beta) for removed in self.causes)

    def with_step(self, step: Array) -> AssumedCauses:
        """Causes with values changed by ``step`` (k,)."""
        changed = list[_RemovedCause]()
        for removed, own_values in zip(self.causes, self._slices(), strict=True):
            changed.append(replace(removed, beta=removed.beta + step[own_values]))
        return replace(self, causes=tuple(changed))

    def check(self, W: Array, root_weights: Array) -> None:
        """Raise ValueRangeError if weighted rows [W E] (m, nv, r + k) cannot distinguish a value from the groups."""
        equations = NormalEquations.from_rows(W, 0.0 * root_weights, root=root_weights)
        N = equations.N.sum(axis=0)
        size = np.sqrt(np.maximum(N.diagonal(), 1e-300))  # never zero
        scaled_N = N / size[:, None] / size
        inverse = np.linalg.inv(scaled_N + 1e-10 * np.eye(len(N)))  # invertible despite rounding errors
        # Of columns of unit length, 1 / (N⁻¹)_ii is the square of the part that the others do not span.
        unspanned_share = 1.0 / inverse.diagonal()[len(self.x) :]
        has_entries = (W != 0.0).any(axis=(0, 1))[len(self.x) :]
        unspanned_share *= has_entries  # 0 for columns of zeros
        for removed, own_values in zip(self.causes, self._slices(), strict=True):
            if (unspanned_share[own_values] < _MIN_UNSPANNED_SHARE).any():
                raise ValueRangeError(
                    f"{self.text_of(removed.wanted)} cannot be assumed: these logs do not separate it from the parameters."
                )

    def text_of(self, wanted: WantedCause) -> str:
        """Text of a cause, as in ``assume``."""
        names = self.base.unknown.model.velocity_names
        return ":".join([wanted.kind, *(names[k] for k in wanted.joints)])

    def values(self, covariance: GroupCovariance) -> tuple[AssumedCause, ...]:
        """Causes with their values and intervals, from the covariance of [x, β]."""
        names = self.base.unknown.model.velocity_names
        half_widths = covariance.half_width()[len(self.x) :]
        _, gravity_of_log = self.corrected_samples()
        assumed = list[AssumedCause]()
        for removed, own_values in zip(self.causes, self._slices(), strict=True):
            kind = removed.wanted.kind
            value = removed.number
            interval = None
            unit = causes.unit_of_value(kind, removed.wanted.joints, self.base.unknown.model)
            if len(removed.beta):
                value, interval = causes.value_with_interval(kind, removed.beta, half_widths[own_values], unit)
            joints = tuple(names[k] for k in removed.wanted.joints)
            if value is None:
                unit = ""
            gravity = tuple(gravity_of_log.tolist()) if kind in _GRAVITY_CHANGING else None
            assumed.append(AssumedCause(kind, joints, value, interval, unit, gravity))
        return tuple(assumed)


def begin_settings(nv: int, samples: Sequence[SteadySamples], options: FitOptions) -> FitSettings:
    """Initial settings of the search: those that the options fix, and usual values of the others."""
    cutoff = options.cutoff or _INITIAL_CUTOFF_SHARE * lowest_rate(samples)  # a cut-off of zero is not allowed
    friction_speed = options.friction_speed or _INITIAL_FRICTION_SPEED
    return FitSettings(cutoff, np.full(nv, friction_speed), options.shift or 0.0)


def prior_with(prior: Prior, E: Array, tau: Array) -> Prior:
    """Weak prior of the groups and of β, whose columns are E (m, nv, k)."""
    largest_torque = np.sqrt((tau**2).mean(axis=0).max())  # rms of a joint
    rms_of_columns = np.sqrt((E**2).mean(axis=(0, 1)))
    torque_per_value = np.maximum(rms_of_columns, 1e-300)  # not zero
    size = _PRIOR_WIDTH * largest_torque / torque_per_value
    return Prior(np.append(prior.mean, np.zeros(len(size))), np.append(prior.size, size))


def fit_covariance(trial: Trial, E: Array, x: Array, sigma: Array, weights: Array, prior: Prior) -> GroupCovariance:
    """Covariance of [x, β] at the chosen settings."""
    rows = trial.rows
    W = np.concatenate([trial.W, E], axis=2)
    solution = np.append(x, np.zeros(E.shape[2]))  # the log is corrected, so the change of β is zero
    return group_covariance(
        W, trial.tau, solution, sigma, weights, prior_with(prior, E, trial.tau),
        rows.time, rows.log, (rows.position, rows.speed), trial.changes(x),
    )  # fmt: skip


def _keep_states(s: LogStates, _x: Array, _beta: Array) -> LogStates:
    """Correction of a cause that is already removed elsewhere: the states unchanged."""
    return s


def _correct_states(s: LogStates, causes: Iterable[_RemovedCause], x: Array) -> LogStates:
    """Remove causes from states one after another."""
    for removed in causes:
        s = removed.correct(s, x, removed.beta)
    return s


def _joints(wanted: WantedCause, s: LogStates) -> tuple[int, ...]:
    """Indices of the joints of a cause that names joints; all joints if it names none."""
    return wanted.joints or tuple(range(len(s.gain)))


def _with_law(wanted: WantedCause, fit: CauseFit, x: Array) -> tuple[_RemovedCause, CauseFit]:
    """Joint law with its coefficient, and the fit that contains it."""
    s = fit.states
    kind_and_joints = (wanted.kind, _joints(wanted, s))
    law = next(law for law in causes.laws(s) if (law.kind, law.joints) == kind_and_joints)
    (law_column,) = law_columns(fit, [law], FittedTorques.from_groups(s, x))
    refit = fit.refit(s, law_column[..., 0])

    def correct(s: LogStates, x: Array, beta: Array) -> LogStates:
        """States with torques without the torque of the law."""
        columns = law.columns(s, FittedTorques.from_groups(s, x))
        return s.with_fields(tau=s.shifted_torques - beta[0] * columns[..., 0], shift=0.0)

    coefficient = refit.x[-1:]  # the law's column is the last
    return _RemovedCause(wanted, correct, coefficient, step=1.0), refit


def _candidates(wanted: WantedCause, s: LogStates, x: Array) -> list[Cause]:
    """Candidate causes of the wanted kind and joints, of which the best is assumed."""
    joints = wanted.joints
    if wanted.kind == "elasticity":
        joints = _joints(wanted, s)
        predicted, _ = s.torques(x)
        all_causes = [*causes.compliances(s, s.low_passed(predicted))]
    else:
        all_causes = [*causes.discrete_causes(s, joints), *causes.continuous_causes(s, wide=True)]
    return [cause for cause in all_causes if (cause.kind, cause.joints) == (wanted.kind, joints)]


def _removal(wanted: WantedCause, s: LogStates, x: Array, found: FoundCause) -> _RemovedCause:
    """Removal of a cause that was estimated, as ``found``, from states with groups x."""
    if wanted.kind == "time-scale":
        return _RemovedCause(wanted, _keep_states, np.zeros(0), number=found.number)
    candidates = _candidates(wanted, s, x)
    if found.value is None:  # of a discrete cause, the candidate with the estimated number
        candidates = [candidate for candidate in candidates if candidate.number == found.number]
    cause = candidates[0]
    joints = _joints(wanted, s)
    predicted, _ = s.torques(x)
    largest_torques = np.abs(s.low_passed(predicted)).max(axis=0)  # to which β of an elasticity refers

    def correct_as_found(s: LogStates, _x: Array, _beta: Array) -> LogStates:
        """States without a discrete cause."""
        return found.correct(s) if found.correct else s

    def correct_by_value(s: LogStates, _x: Array, beta: Array) -> LogStates:
        """States without a cause of value β."""
        return cause.correct(s, beta)

    def correct_elasticity(s: LogStates, x: Array, beta: Array) -> LogStates:
        """States without an elasticity of value β, which depends on the predicted torques."""
        torques, _ = s.torques(x)
        compliances = causes.compliances(s, s.low_passed(torques), largest_torques)
        compliance = next(candidate for candidate in compliances if candidate.joints == joints)
        return compliance.correct(s, beta)

    if found.value is None:
        return _RemovedCause(wanted, correct_as_found, np.zeros(0), number=found.number)
    if wanted.kind == "elasticity":
        return _RemovedCause(wanted, correct_elasticity, found.value, cause.step)
    return _RemovedCause(wanted, correct_by_value, found.value, cause.step)


def _with_stribeck(unknown: UnknownParameters, fit: CauseFit) -> UnknownParameters:
    """Unknown parameters with static friction of each joint, at the Stribeck speed that explains most."""
    s = fit.states
    fitted_torques = FittedTorques.from_groups(s, fit.x[: s.base.count])
    gains_and_speeds = list[tuple[float, float]]()
    for speed in causes.STRIBECK_SPEEDS:
        wanted_law = ("stribeck", speed, 1)  # of single joints
        laws = (law for law in causes.laws(s) if (law.kind, law.speed, len(law.joints)) == wanted_law)
        columns = [column[..., 0] for column in law_columns(fit, laws, fitted_torques) if column.any()]
        refit = fit.refit(s, *columns)
        gains_and_speeds.append((fit.gain(refit), speed))
    _, best_speed = max(gains_and_speeds)  # by the gain
    friction = tuple(dict.fromkeys((*unknown.friction, "stribeck")))  # each once
    return replace(unknown, friction=friction, stribeck_speed=best_speed)


def _under_gravity(base: BaseParameters, gravity: Array) -> BaseParameters:
    """The same groups under another gravity."""
    unknown = base.unknown
    if np.array_equal(gravity, unknown.model.gravity):
        return base
    robot = unknown.robot.with_gravity(gravity)
    return replace(base, unknown=replace(unknown, robot=robot))


def _with_clock(samples: Sequence[SteadySamples], factor: float) -> list[SteadySamples]:
    """Samples with corrected times, for a log whose times are ``factor`` times the true ones."""
    return [replace(log, start=log.start / factor, rate=log.rate * factor) for log in samples]
