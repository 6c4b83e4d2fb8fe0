"""Output-error fit of servo parameters: Levenberg-Marquardt steps on replayed positions.

The residual of a row is (q - q̂(p)) / s, with s the larger of noise and quantum/√12. With J its derivatives by finite
differences, one batch of rollouts for each step, and P the precision of a weak prior on log armature,

    (J' J + σ² P + λ D) dp = J' r + σ² P (p₀ - p),     σ² = max(1, r'r/m),

for six λ at once. The covariance is that of scores of blocks of time (Liang and Zeger, Biometrika 73, 1986), with the
prior's own; for joints without a known scale the prior then states how little is known. Changes of p by another model (half
the integration step, the other course of commands, other laws of friction) are added, each times the square root of the
probability of that model, 1 / (1 + exp(-L)), with L the logarithm of its odds. For n blocks of time and nv joints

    L = ½ n nv log(Σ r² / Σ r² with the model) - ½ k log(n nv)

for k more unknowns (Schwarz, "Estimating the dimension of a model", Annals of Statistics 6, 1978).
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
_MAX_RESIDUALS = 20_000
"""Largest number of residuals; every k-th row of longer logs is used."""
_DIFFERENCE, _DELAY_DIFFERENCE = 1e-3, 2e-4
_DAMPING = (0.0, 1e-3, 1e-2, 1e-1, 1.0, 1e1)
_MORE_DAMPING, _TRIES = 1e3, 2
_MAX_STEPS, _MIN_DECREASE = 25, 0.3
"""Largest number of steps, and predicted decrease of the last one, in σ²: the unknowns are half a deviation from it at most."""
_PRIOR_OF_ARMATURE = 1.5
"""Standard deviation of the logarithm of an armature about its initial value."""
_MAX_CHANGE = 2.0
"""Largest change of a logarithm in one step."""
_TRIAL_STEPS = 2
"""Steps after which a fit is compared with the cost of another one."""
_DELAY_SIZE = 0.02
"""Standard deviation [s] of the prior of the delay, for logs that do not determine it."""
_PRIOR_OF_OTHERS = 3.0
"""Standard deviation of the logarithms of damping, friction and stiffness about their initial values."""
_MAX_KNOWN_SCALE = 0.3
"""Deviation of the logarithm of a scale from which it is unknown."""
_MIN_COST_SHARE, _MAX_EVIDENCE = 1e-3, 500.0
"""Smallest part of Σ r² that another law may leave by a linear prediction; largest logarithm of odds."""
_LAW_DIFFERENCE = 0.02
"""Coefficient of another law of friction in its finite differences."""
_LENGTHS, _BLOCK = 5.0, 1.0
"""Length of a block: at least so many correlation times, and so many seconds."""


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
        """Logarithm of the odds of a model with Σ r² = ``other`` and ``more`` unknowns, against one with ``cost``."""
        count = (self.freedom + 1.0) * len(self.sigma)
        return float(0.5 * count * np.log(cost / other) - 0.5 * more * np.log(count))

    def half_width(self, direction: Array, level: float = 0.95) -> float:
        """Half width of the interval of a linear combination of the unknowns."""
        return float(student_quantile(self.freedom, level) * np.sqrt(direction @ self.covariance @ direction))


@dataclass(frozen=True, eq=False)
class OutputErrorProblem:
    """Residuals of logs and the prior; ``free`` (4 nv + 1,) bool is False for known values.

    ``used`` are the rows of each log whose residuals count.
    """

    replay: ServoReplay
    sigma: Array
    start: Array
    free: Array
    used: Sequence[Array]

    @classmethod
    def from_logs(cls, replay: ServoReplay, start: Array, free: Array, until: float = 1.0) -> OutputErrorProblem:
        """Problem on rows after the begin of each log, up to a share of its time."""
        most = max(1, _MAX_RESIDUALS // (replay.robot.nv * len(replay.logs)))
        used = []
        for log in replay.logs:
            duration = log.time[-1]
            is_used = (log.time >= min(_TIME_TO_SETTLE, 0.2 * duration)) & (log.time <= until * duration)
            rows = np.flatnonzero(is_used)
            used.append(rows[:: max(1, len(rows) // most)])
        return cls(replay, position_errors(replay.logs), start, free, used)

    def residuals(self, p: Array) -> list[Array]:
        """Residuals (S, m, nv) of the used rows of each log, for unknowns p (S, 4 nv + 1)."""
        residuals = list[Array]()
        for log, rows, q in zip(self.replay.logs, self.used, self.replay.positions(p), strict=True):
            residuals.append(log.q[rows] - q[:, rows])
        return residuals

    def residuals_at(self, p: Array) -> list[Array]:
        """Residuals (m, nv) of the used rows of each log, for unknowns p (4 nv + 1,)."""
        return [e[0] for e in self.residuals(p[None])]

    def flat(self, p: Array) -> Array:
        """(S, M) residuals in units of their expected size; motions that are not finite give a large residual."""
        parts = [(e / self.sigma).reshape(len(p), -1) for e in self.residuals(p)]
        return np.nan_to_num(np.concatenate(parts, axis=1), nan=1e6, posinf=1e6, neginf=-1e6)

    @property
    def precision(self) -> Array:
        """(4 nv + 1,) precision of the prior: of armatures, and nearly none of others."""
        nv = self.replay.robot.nv
        return np.append(np.tile([_PRIOR_OF_ARMATURE, *[_PRIOR_OF_OTHERS] * 3], (nv, 1)), _DELAY_SIZE) ** -2.0

    def linearise(self, p: Array) -> tuple[Array, Array]:
        """r (M,) and J (M, P) = ∂q̂/∂p of the free unknowns."""
        size = np.append(np.full(len(p) - 1, _DIFFERENCE), _DELAY_DIFFERENCE)[self.free]
        moved, B = np.tile(p, (len(size) + 1, 1)), self.directions
        moved[1:, self.free] += size[:, None] * B
        moved[1:, -1] = np.maximum(moved[1:, -1], 0.0)
        r = self.flat(moved)
        return r[0], np.linalg.solve(B, (r[0] - r[1:]) / size[:, None]).T

    @property
    def directions(self) -> Array:
        """(P, P) rows of the free unknowns' differences: one by one, but the four logarithms of a joint together for its kp.

        Positions depend little on the scale of a light joint; the sum of four differences would hide it.
        """
        n = len(QUANTITIES)
        B = np.eye(len(self.free))
        for j in range(self.replay.robot.nv):
            mine = slice(n * j, n * (j + 1))
            if self.free[mine].all():
                B[n * (j + 1) - 1, mine] = 1.0
        return B[np.ix_(self.free, self.free)]

    def normal_equations(self, p: Array, r: Array, J: Array) -> tuple[Array, Array, float]:
        """H, g and σ² of the free unknowns."""
        s2 = max(1.0, float(r @ r) / len(r))
        prior = s2 * self.precision[self.free]
        return J.T @ J + np.diag(prior), J.T @ r + prior * (self.start - p)[self.free], s2

    def cost(self, p: Array, r: Array, s2: float) -> Array:
        """Σ r² with the prior, of unknowns p (S, 4 nv + 1)."""
        away = (p - self.start)[:, self.free]
        return np.asarray((r**2).sum(axis=1) + s2 * (away**2 * self.precision[self.free]).sum(axis=1))

    def solve(self, p: Array, hopeless: float = np.inf) -> OutputErrorFit:
        """Fit from initial unknowns p (4 nv + 1,); left early if its cost is above a ``hopeless`` one after some steps."""
        for k in range(_MAX_STEPS):
            r, J = self.linearise(p)
            H, g, s2 = self.normal_equations(p, r, J)
            cost = float(self.cost(p[None], r[None], s2)[0])
            trial = self._best_trial(p, H, g, s2, cost)
            if trial is None:
                break
            p, cost = trial
            if g @ np.linalg.solve(H, g) < _MIN_DECREASE * s2 or (k >= _TRIAL_STEPS and cost > hopeless):
                break
        return self._result(p, k + 1)

    def _best_trial(self, p: Array, H: Array, g: Array, s2: float, now: float) -> tuple[Array, float] | None:
        """Best of six trial steps, and its cost; None if none improves, also with more damping."""
        for more in range(_TRIES):
            trials = np.tile(p, (len(_DAMPING), 1))
            for trial, damping in zip(trials, np.array(_DAMPING) * _MORE_DAMPING**more, strict=True):
                change = np.linalg.solve(H + damping * np.diag(H.diagonal()), g)
                trial[self.free] += np.clip(change, -_MAX_CHANGE, _MAX_CHANGE)
                trial[-1] = np.clip(trial[-1], 0.0, 10.0 * _DELAY_SIZE)
            costs = self.cost(trials, self.flat(trials), s2)
            if costs.min() < now:
                return trials[int(costs.argmin())], float(costs.min())
        return None

    def _result(self, p: Array, steps: int) -> OutputErrorFit:
        r, J = self.linearise(p)
        H, _, s2 = self.normal_equations(p, r, J)
        inverse = np.linalg.inv(H)
        scores, blocks = self._block_scores(r, J)
        of_scores = scores.T @ scores * blocks / max(1, blocks - 1)
        of_prior = np.diag(s2**2 * self.precision[self.free])
        C = inverse @ (of_scores + of_prior) @ inverse
        of_white_noise = s2 * inverse
        growth = np.sqrt(np.maximum(1.0, of_white_noise.diagonal() / C.diagonal()))
        C = growth[:, None] * C * growth
        covariance = np.zeros((len(p), len(p)))
        covariance[np.ix_(self.free, self.free)] = C
        freedom, residuals = max(1.0, blocks - 1.0), self.residuals_at(p)
        return OutputErrorFit(self.replay, p, covariance, freedom, residuals, self.sigma, float(r @ r), steps)

    def _block_scores(self, r: Array, J: Array) -> tuple[Array, int]:
        """Scores Σ J' r (B, P) of blocks of time, and their number."""
        nv, first, scores = self.replay.robot.nv, 0, list[Array]()
        for log, rows in zip(self.replay.logs, self.used, strict=True):
            last = first + len(rows) * nv
            e, D = r[first:last].reshape(-1, nv), J[first:last].reshape(len(rows), nv, -1)
            period = float(np.median(np.diff(log.time[rows])))
            length = max(_BLOCK / period, _LENGTHS * autocorrelation_length(e))
            count = max(2, int(len(rows) / length))
            edges = np.linspace(0, len(rows), count + 1).astype(int)[:-1]
            scores.append(np.add.reduceat(np.einsum("mj,mjp->mp", e, D), edges))
            first = last
        found = np.concatenate(scores)
        return found, len(found)

    def change(self, fit: OutputErrorFit, replay: ServoReplay) -> Array:
        """(4 nv + 1,) change of the unknowns, by one step, if the logs were replayed otherwise."""
        r, J = replace(self, replay=replay).linearise(fit.p)
        H, g, _ = self.normal_equations(fit.p, r, J)
        found = np.zeros(len(fit.p))
        found[self.free] = np.linalg.solve(H, g)
        return found

    def scale_changes(self, fit: OutputErrorFit, J: Array, scale: Array) -> list[Array]:
        """Changes (4 nv + 1,) of the unknowns with a change (nv,) of the scale of each joint.

        All values of a joint change alike; if the scale is unknown, such that the logs are replayed as well with another kp.
        """
        H, changes = J.T @ J, list[Array]()
        H += 1e-9 * np.diag(H.diagonal() + 1e-300)
        unknowns = np.flatnonzero(self.free)
        joint_of = np.arange(len(fit.p)) // len(QUANTITIES)
        for j, size in enumerate(scale.tolist()):
            if size < _MAX_KNOWN_SCALE:
                changes.append(np.where(joint_of == j, size * self.free, 0.0))
                continue
            is_kp = unknowns == len(QUANTITIES) * j + len(QUANTITIES) - 1
            change = np.zeros(len(fit.p))
            if is_kp.any():
                by_kp = np.linalg.solve(H[np.ix_(~is_kp, ~is_kp)], H[np.ix_(~is_kp, is_kp)][:, 0])
                change[unknowns[is_kp]] = size
                change[unknowns[~is_kp]] = -size * by_kp
            changes.append(change)
        return changes

    def law_change(self, fit: OutputErrorFit, law: str, r: Array, J: Array) -> Array:
        """(4 nv + 1,) change of the unknowns, by one step, if friction followed another law, fitted joint by joint.

        The change is times the square root of the law's probability.
        """
        nv = self.replay.robot.nv
        share = np.concatenate([np.zeros((1, nv)), _LAW_DIFFERENCE * np.eye(nv)])
        moved = replace(self, replay=replace(self.replay, law=law, share=share)).flat(np.tile(fit.p, (nv + 1, 1)))
        E = (moved[0] - moved[1:]).T / _LAW_DIFFERENCE
        H, g, s2 = self.normal_equations(fit.p, r, J)
        border = J.T @ E
        whole = np.block([[H, border], [border.T, E.T @ E + s2 * np.eye(nv)]])
        right = np.append(g, E.T @ r)
        step, found = np.linalg.solve(whole, right), np.zeros(len(fit.p))
        found[self.free] = step[: len(g)]
        cost = float(r @ r)
        less = max(cost - float(right @ step - g @ np.linalg.solve(H, g)), _MIN_COST_SHARE * cost)
        return found * np.sqrt(probability(fit.evidence(cost, less, nv)))


def probability(evidence: float) -> float:
    """Probability of a model by the logarithm of its odds."""
    return float(1.0 / (1.0 + np.exp(-np.clip(evidence, -_MAX_EVIDENCE, _MAX_EVIDENCE))))


def with_model_changes(fit: OutputErrorFit, changes: Sequence[Array]) -> OutputErrorFit:
    """Fit whose covariance includes changes of the model."""
    return replace(fit, covariance=fit.covariance + sum(np.outer(c, c) for c in changes))


def position_errors(logs: Sequence[ServoLog]) -> Array:
    """(nv,) expected size of position errors [rad, m]: the larger of noise and quantum/√12."""
    times, positions = [log.time for log in logs], [log.q for log in logs]
    quanta = np.empty(positions[0].shape[1])
    for j in range(len(quanta)):
        quanta[j] = quantum([q[:, j] for q in positions])
    return np.asarray(np.maximum(np.maximum(noise(times, positions, quanta), quanta / np.sqrt(12.0)), 1e-7))
