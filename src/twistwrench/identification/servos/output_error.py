"""Output-error fit of servo parameters: Levenberg-Marquardt steps on replayed positions.

The residual of a row is (q - q̂(p)) / s, with s the larger of noise and quantum/√12. With J its derivatives by finite
differences, one batch of rollouts for each step, and P the precision of a weak prior on log armature,

    (J' J + σ² P + λ D) dp = J' r + σ² P (p₀ - p),     σ² = max(1, r'r/m),

for six λ at once. D is the diagonal of the other terms in front of dp.

The covariance is that of scores of blocks of time (Liang and Zeger, Biometrika 73, 1986), with a term of the prior. For
joints without a known scale, this term states how little is known.

Another model (half the integration step, the other course of commands, other laws of friction) changes p. These changes are
added to the covariance, each times the square root of the probability of its model, 1 / (1 + exp(-L)). L is the logarithm of
the odds; for n blocks of time, nv joints, and k more unknowns of the model (Schwarz, "Estimating the dimension of a model",
Annals of Statistics 6, 1978)

    L = ½ n nv log(Σ r² / Σ r² with the model) - ½ k log(n nv)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.estimation.covariance import autocorrelation_length, student_quantile
from ...core.estimation.noise import noise, quantum
from ...core.typing import Array
from .replay import QUANTITIES, ServoLog, ServoReplay

MAX_WIDTH_DETERMINED = 0.1
"""Half width of the 95 % interval of a logarithm up to which a value counts as determined."""
_TIME_TO_SETTLE = 0.5
"""Time [s] from the begin of a log in which rows are not used: its initial state is not exact."""
_MAX_SHARE_TO_SETTLE = 0.2
"""Largest share of a log's time in which rows are not used for this reason."""
_MAX_RESIDUALS = 20_000
"""Largest number of residuals; every k-th row of longer logs is used."""
_DIFFERENCE = 1e-3
"""Change of a logarithm in finite differences."""
_DELAY_DIFFERENCE = 2e-4
"""Change of the delay in finite differences [s]."""
_DAMPING = (0.0, 1e-3, 1e-2, 1e-1, 1.0, 1e1)
"""Values of λ that are tried at once."""
_MORE_DAMPING = 1e3
"""Factor of these values in the next attempt, if no step lowers the cost."""
_MAX_ATTEMPTS = 2
"""Maximum number of attempts to lower the cost by a step."""
_MAX_STEPS = 25
_MIN_DECREASE = 0.3
"""Predicted decrease of the cost, in σ², below which the fit ends: the best unknowns are at most half a deviation away."""
_PRIOR_OF_ARMATURE = 1.5
"""Standard deviation of the logarithm of an armature about its initial value."""
_MAX_CHANGE = 2.0
"""Largest change of a logarithm in one step."""
_TRIAL_STEPS = 2
"""Number of steps after which a fit ends if its cost exceeds the cost of another fit."""
_DELAY_SIZE = 0.02
"""Standard deviation [s] of the prior of the delay, for logs that do not determine it."""
_MAX_DELAY = 10.0 * _DELAY_SIZE
"""Largest delay [s]."""
_MAX_RESIDUAL = 1e6
"""Residual, in units of its expected size, that replaces one that is not finite."""
_MIN_POSITION_ERROR = 1e-7
"""Least expected position error [rad, m]; above zero, since residuals are divided by it."""
_RELATIVE_DIAGONAL = 1e-9
"""Relative growth of a diagonal, which lets the matrix be inverted."""
_PRIOR_OF_OTHERS = 3.0
"""Standard deviation of the logarithms of damping, friction and stiffness about their initial values."""
_MAX_KNOWN_SCALE = 0.3
"""Deviation of the logarithm of a scale from which it is unknown."""
_MIN_COST_SHARE = 1e-3
"""Smallest share of Σ r² that another law of friction may leave by a linear prediction."""
_MAX_EVIDENCE = 500.0
"""Largest logarithm of odds, against overflow of its exponential."""
_LAW_DIFFERENCE = 0.02
"""Coefficient of another law of friction in its finite differences."""
_MIN_BLOCK_CORRELATION_TIMES = 5.0
"""Least duration of a block of time, in correlation times of the residuals."""
_MIN_BLOCK_SECONDS = 1.0
"""Least duration of a block of time [s]."""


@dataclass(frozen=True, eq=False)
class OutputErrorFit:
    """Unknowns p (4 nv + 1,) that replay logs best, with their covariance.

    Attributes
    ----------
    replay : ServoReplay
    p : (4 nv + 1,) array, logarithms of armature, damping, Coulomb friction and kp of each joint, then the delay [s]
    covariance : (4 nv + 1, 4 nv + 1) array
    freedom : float, degrees of freedom of Student's t
    residuals : list of (m, nv) array, q - q̂ [rad, m] in the used rows of each log
    sigma : (nv,) array, expected size of residuals [rad, m]
    cost : float, Σ r²
    steps : int, number of steps
    """

    replay: ServoReplay
    p: Array
    covariance: Array
    freedom: float
    residuals: Sequence[Array]
    sigma: Array
    cost: float
    steps: int

    def evidence(self, cost: float, other: float, more: int = 0) -> float:
        """Logarithm of the odds of another model, with Σ r² = ``other`` and ``more`` additional unknowns, against ``cost``."""
        data_count = (self.freedom + 1.0) * len(self.sigma)  # n nv: blocks of time, times joints
        return float(0.5 * data_count * np.log(cost / other) - 0.5 * more * np.log(data_count))

    def half_width(self, direction: Array, level: float = 0.95) -> float:
        """Half width of the interval of a linear combination of the unknowns."""
        variance = direction @ self.covariance @ direction
        return float(student_quantile(self.freedom, level) * np.sqrt(variance))


@dataclass(frozen=True, eq=False)
class OutputErrorProblem:
    """Residuals of logs as functions of the unknowns, and the prior of these."""

    replay: ServoReplay
    sigma: Array
    """(nv,) expected size of residuals [rad, m]."""
    start: Array
    """(4 nv + 1,) mean p₀ of the prior."""
    free: Array
    """(4 nv + 1,) bool, False for known values."""
    used: Sequence[Array]
    """Rows of each log whose residuals count."""

    @classmethod
    def from_logs(cls, replay: ServoReplay, start: Array, free: Array, until: float = 1.0) -> OutputErrorProblem:
        """Problem on the rows of each log from its settled state to ``until``, a share of its time."""
        joints_of_all_logs = replay.robot.nv * len(replay.logs)
        max_rows = max(1, _MAX_RESIDUALS // joints_of_all_logs)  # of each log
        used_rows = []
        for log in replay.logs:
            duration = log.time[-1]
            begin = min(_TIME_TO_SETTLE, _MAX_SHARE_TO_SETTLE * duration)
            rows = np.flatnonzero((log.time >= begin) & (log.time <= until * duration))
            stride = max(1, len(rows) // max_rows)
            used_rows.append(rows[::stride])
        return cls(replay, position_errors(replay.logs), start, free, used_rows)

    def residuals(self, p: Array) -> list[Array]:
        """Residuals (S, m, nv) of the used rows of each log, for unknowns p (S, 4 nv + 1)."""
        residuals = list[Array]()
        for log, rows, q in zip(self.replay.logs, self.used, self.replay.positions(p), strict=True):
            residuals.append(log.q[rows] - q[:, rows])
        return residuals

    def residuals_at(self, p: Array) -> list[Array]:
        """Residuals (m, nv) of the used rows of each log, for unknowns p (4 nv + 1,)."""
        return [e[0] for e in self.residuals(p[None])]  # of the only sample

    def flat(self, p: Array) -> Array:
        """(S, M) residuals r of all logs, in units of their expected size; large for motions that are not finite."""
        residuals = [(e / self.sigma).reshape(len(p), -1) for e in self.residuals(p)]
        r = np.concatenate(residuals, axis=1)
        return np.nan_to_num(r, nan=_MAX_RESIDUAL, posinf=_MAX_RESIDUAL, neginf=-_MAX_RESIDUAL)

    @property
    def precision(self) -> Array:
        """(4 nv + 1,) precisions of the prior, which is weak except for armatures."""
        nv = self.replay.robot.nv
        deviations_of_joint = [_PRIOR_OF_ARMATURE, _PRIOR_OF_OTHERS, _PRIOR_OF_OTHERS, _PRIOR_OF_OTHERS]
        deviations = np.append(np.tile(deviations_of_joint, (nv, 1)), _DELAY_SIZE)
        return deviations**-2.0

    def linearise(self, p: Array) -> tuple[Array, Array]:
        """r (M,) and J (M, P) = ∂q̂/∂p of the free unknowns, in units of the expected residuals."""
        steps_of_all = np.append(np.full(len(p) - 1, _DIFFERENCE), _DELAY_DIFFERENCE)
        steps = steps_of_all[self.free]
        B = self.directions
        batch = np.tile(p, (len(steps) + 1, 1))  # p itself, and p after a step in each direction
        batch[1:, self.free] += steps[:, None] * B
        batch[1:, -1] = np.maximum(batch[1:, -1], 0.0)  # a delay is not negative
        r = self.flat(batch)
        slopes = (r[0] - r[1:]) / steps[:, None]  # rows B J'
        return r[0], np.linalg.solve(B, slopes).T

    @property
    def directions(self) -> Array:
        """(P, P) directions of the finite differences, rows B: each changes one free unknown, except the row of a joint's kp.

        That row changes the four logarithms of the joint together: its scale. Positions depend little on the scale of a light
        joint, so the sum of four single differences would hide this change.
        """
        n = len(QUANTITIES)
        B = np.eye(len(self.free))
        for j in range(self.replay.robot.nv):
            joint_unknowns = slice(n * j, n * (j + 1))
            kp_index = n * (j + 1) - 1  # the last of the joint
            if self.free[joint_unknowns].all():
                B[kp_index, joint_unknowns] = 1.0
        return B[np.ix_(self.free, self.free)]

    def normal_equations(self, p: Array, r: Array, J: Array) -> tuple[Array, Array, float]:
        """H = J' J + σ² P and g = J' r + σ² P (p₀ - p) of the free unknowns, and σ² as ``s2``."""
        s2 = max(1.0, float(r @ r) / len(r))
        prior_weights = s2 * self.precision[self.free]
        deviations = (self.start - p)[self.free]
        H = J.T @ J + np.diag(prior_weights)
        g = J.T @ r + prior_weights * deviations
        return H, g, s2

    def cost(self, p: Array, r: Array, s2: float) -> Array:
        """Costs (S,): Σ r² of residuals r (S, M), and the prior's term of unknowns p (S, 4 nv + 1)."""
        deviations = (p - self.start)[:, self.free]
        squares_of_deviations = (deviations**2 * self.precision[self.free]).sum(axis=1)
        return np.asarray((r**2).sum(axis=1) + s2 * squares_of_deviations)

    def solve(self, p: Array, hopeless: float = np.inf) -> OutputErrorFit:
        """Fit from initial unknowns p (4 nv + 1,); it ends early if its cost exceeds ``hopeless`` after some steps."""
        steps = 0
        for k in range(_MAX_STEPS):
            steps = k + 1
            r, J = self.linearise(p)
            H, g, s2 = self.normal_equations(p, r, J)
            (cost,) = self.cost(p[None], r[None], s2).tolist()
            trial = self._best_trial(p, H, g, s2, cost)
            if trial is None:
                break
            p, cost = trial
            predicted_decrease = g @ np.linalg.solve(H, g)
            if predicted_decrease < _MIN_DECREASE * s2:
                break
            if k >= _TRIAL_STEPS and cost > hopeless:
                break
        return self._fit_at(p, steps)

    def _best_trial(self, p: Array, H: Array, g: Array, s2: float, current_cost: float) -> tuple[Array, float] | None:
        """Unknowns after the best of six trial steps, and their cost; None if no step lowers it, also with more damping."""
        for attempt in range(_MAX_ATTEMPTS):
            dampings = np.array(_DAMPING) * _MORE_DAMPING**attempt
            trials = np.tile(p, (len(dampings), 1))
            for trial, damping in zip(trials, dampings, strict=True):
                damped_H = H + damping * np.diag(H.diagonal())
                change = np.linalg.solve(damped_H, g)
                trial[self.free] += np.clip(change, -_MAX_CHANGE, _MAX_CHANGE)
                trial[-1] = np.clip(trial[-1], 0.0, _MAX_DELAY)
            costs = self.cost(trials, self.flat(trials), s2)
            best = int(costs.argmin())
            if costs[best] < current_cost:
                return trials[best], float(costs[best])
        return None

    def _fit_at(self, p: Array, steps: int) -> OutputErrorFit:
        """Fit with unknowns p (4 nv + 1,), found in some number of steps, and their covariance."""
        r, J = self.linearise(p)
        H, _, s2 = self.normal_equations(p, r, J)
        inverse = np.linalg.inv(H)
        scores = self._block_scores(r, J)
        block_count = len(scores)
        score_term = scores.T @ scores * block_count / max(1, block_count - 1)
        prior_term = np.diag(s2**2 * self.precision[self.free])
        C = inverse @ (score_term + prior_term) @ inverse
        # no variance is smaller than that of white noise
        white_noise_covariance = s2 * inverse
        growth = np.sqrt(np.maximum(1.0, white_noise_covariance.diagonal() / C.diagonal()))
        covariance = np.zeros((len(p), len(p)))
        covariance[np.ix_(self.free, self.free)] = growth[:, None] * C * growth
        freedom = max(1.0, block_count - 1.0)
        residuals = self.residuals_at(p)
        return OutputErrorFit(self.replay, p, covariance, freedom, residuals, self.sigma, float(r @ r), steps)

    def _block_scores(self, r: Array, J: Array) -> Array:
        """Scores Σ J' r (B, P) of the blocks of time of all logs."""
        nv = self.replay.robot.nv
        first_residual = 0  # of the log
        scores_of_logs = list[Array]()
        for log, rows in zip(self.replay.logs, self.used, strict=True):
            next_residual = first_residual + len(rows) * nv
            r_of_log = r[first_residual:next_residual].reshape(-1, nv)
            J_of_log = J[first_residual:next_residual].reshape(len(rows), nv, -1)
            first_residual = next_residual
            period = float(np.median(np.diff(log.time[rows])))
            correlation_rows = autocorrelation_length(r_of_log)
            rows_per_block = max(_MIN_BLOCK_SECONDS / period, _MIN_BLOCK_CORRELATION_TIMES * correlation_rows)
            block_count = max(2, int(len(rows) / rows_per_block))
            block_edges = np.linspace(0, len(rows), block_count + 1).astype(int)
            block_begins = block_edges[:-1]
            row_scores = np.einsum("mj,mjp->mp", r_of_log, J_of_log)
            scores_of_logs.append(np.add.reduceat(row_scores, block_begins))
        return np.concatenate(scores_of_logs)

    def change(self, fit: OutputErrorFit, replay: ServoReplay) -> Array:
        """(4 nv + 1,) change of the unknowns, by one step from ``fit``, if the logs were replayed by ``replay``."""
        r, J = replace(self, replay=replay).linearise(fit.p)
        H, g, _ = self.normal_equations(fit.p, r, J)
        change = np.zeros(len(fit.p))
        change[self.free] = np.linalg.solve(H, g)
        return change

    def scale_changes(self, fit: OutputErrorFit, J: Array, scale: Array) -> list[Array]:
        """Change (4 nv + 1,) of the unknowns for each joint, by an error of its scale; ``scale`` (nv,) are these errors.

        All logarithms of a joint change by the error. If the scale is unknown, only kp changes by the error. The other
        unknowns then change such that the logs are replayed as well as before.
        """
        H = J.T @ J
        H += _RELATIVE_DIAGONAL * np.diag(H.diagonal() + 1e-300)  # 1e-300: also for zero columns
        unknowns = np.flatnonzero(self.free)
        joint_of_unknown = np.arange(len(fit.p)) // len(QUANTITIES)
        changes = list[Array]()
        for j, scale_error in enumerate(scale.tolist()):
            if scale_error < _MAX_KNOWN_SCALE:
                changes.append(np.where(joint_of_unknown == j, scale_error * self.free, 0.0))
                continue
            kp_index = len(QUANTITIES) * (j + 1) - 1
            is_kp = unknowns == kp_index
            change = np.zeros(len(fit.p))
            if is_kp.any():
                H_others = H[np.ix_(~is_kp, ~is_kp)]
                kp_column = H[np.ix_(~is_kp, is_kp)][:, 0]
                others_by_kp = np.linalg.solve(H_others, kp_column)
                change[kp_index] = scale_error
                change[unknowns[~is_kp]] = -scale_error * others_by_kp
            changes.append(change)
        return changes

    def law_change(self, fit: OutputErrorFit, law: str, r: Array, J: Array) -> Array:
        """(4 nv + 1,) change of the unknowns, by one step, if friction also had another law, with a coefficient per joint.

        The change is multiplied by the square root of the law's probability.
        """
        nv = self.replay.robot.nv
        coefficients = np.concatenate([np.zeros((1, nv)), _LAW_DIFFERENCE * np.eye(nv)])  # none, then of one joint each
        problem_with_law = replace(self, replay=replace(self.replay, law=law, share=coefficients))
        residuals = problem_with_law.flat(np.tile(fit.p, (nv + 1, 1)))
        E = (residuals[0] - residuals[1:]).T / _LAW_DIFFERENCE  # derivatives by the coefficients, as J by the unknowns
        H, g, s2 = self.normal_equations(fit.p, r, J)
        border = J.T @ E
        H_with_law = np.block([[H, border], [border.T, E.T @ E + s2 * np.eye(nv)]])
        g_with_law = np.append(g, E.T @ r)
        step = np.linalg.solve(H_with_law, g_with_law)  # of the free unknowns, then of the coefficients
        change = np.zeros(len(fit.p))
        change[self.free] = step[: len(g)]
        cost = float(r @ r)
        decrease = float(g_with_law @ step - g @ np.linalg.solve(H, g))
        cost_with_law = max(cost - decrease, _MIN_COST_SHARE * cost)
        law_probability = probability(fit.evidence(cost, cost_with_law, nv))
        return change * np.sqrt(law_probability)


def probability(evidence: float) -> float:
    """Probability of a model by the logarithm of its odds."""
    return float(1.0 / (1.0 + np.exp(-np.clip(evidence, -_MAX_EVIDENCE, _MAX_EVIDENCE))))


def with_model_changes(fit: OutputErrorFit, changes: Sequence[Array]) -> OutputErrorFit:
    """Fit whose covariance includes changes (4 nv + 1,) of the unknowns by other models."""
    added_covariance = sum(np.outer(c, c) for c in changes)
    return replace(fit, covariance=fit.covariance + added_covariance)


def position_errors(logs: Sequence[ServoLog]) -> Array:
    """(nv,) expected size of position errors [rad, m]: the larger of noise and quantum/√12."""
    times = [log.time for log in logs]
    positions = [log.q for log in logs]
    quanta = np.empty(positions[0].shape[1])  # steps of the encoder of each joint
    for j in range(len(quanta)):
        quanta[j] = quantum([q[:, j] for q in positions])
    rounding_errors = quanta / np.sqrt(12.0)  # standard deviation of rounding to multiples of a quantum
    errors = np.maximum(noise(times, positions, quanta), rounding_errors)
    return np.asarray(np.maximum(errors, _MIN_POSITION_ERROR))
