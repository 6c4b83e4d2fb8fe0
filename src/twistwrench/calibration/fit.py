"""Gauss-Newton with Levenberg steps for all kinds of measurement together, the file as a weak prior, and Huber's weights.

The order of a fit: targets from poses of the file; then targets and tip alone; then all parameters; at the end, one
parameter of each group, with the others as in the file. Without the prior, positions diverge if the ball is off the last
axis, since many parameters have the same effect. With the prior, an offset of a zero is distributed over all of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.estimation.least_squares import huber_weights
from ..core.typing import Array
from .chain import Corrections, TipChain
from .measurements import Measurements
from .targets import MeasuredTarget, targets_from_tips, turn_of_target

ROBUST = 3.0
"""Huber's k of a whole reading, in its standard deviations (rms of its rows)."""
OUTLIER = 0.6
"""Huber weight below which a reading is an outlier."""
PRIOR, SCALELESS_PRIOR = (1e-2, 4e-2), (2e-3, 4e-3)
"""Standard deviations [m, rad] of the file during the fit; the second if nothing contains a length."""
TIP, GEAR, SAG = (0.5, 0.3), 1e-2, 1e-2
"""Same of the tip [rad, m], of gears, and of sags [rad/(N m)]."""
KNOWN_LENGTH = 1e-5
"""Standard deviation of a known length [m]."""
_FRAMES_ONLY, _ITERATIONS, _TRIALS = 8, 40, 10
_MAX_CHANGE = 1e-3
"""Change of weights and of the cost at which a fit has settled."""
_MIN_DEVIATION = 1e-9
"""Smallest standard deviation [m, rad]: rounding."""
_MEDIANS = {1: 0.4549, 3: 0.7887, 6: 0.8914}
"""Medians of chi² over its degrees of freedom."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Corrections of the chain, and targets."""

    corrections: Corrections
    """Corrections of the chain."""
    targets: tuple[MeasuredTarget, ...]
    """Target of each measurement."""


@dataclass(frozen=True, eq=False)
class LinearRows:
    """Linearised rows at a state, not weighted."""

    residuals: tuple[Array, ...]
    """(m, r) of each measurement."""
    design: tuple[Array, ...]
    """(m, r, p + targets) of each measurement."""
    lengths: Array
    """(k,) residuals of known lengths over their deviation."""
    length_rows: Array
    """(k, p + targets)."""

    def weighted_rows(self, weights: Sequence[Array]) -> tuple[Array, Array]:
        """Design (rows, p + targets) and residuals (rows,) times weights (m, r) of each measurement."""
        A, y = list[Array](), list[Array]()
        for D, e, W in zip(self.design, self.residuals, weights, strict=True):
            A.append((D * W[..., None]).reshape(-1, D.shape[2]))
            y.append((e * W).ravel())
        return np.concatenate([*A, self.length_rows]), np.concatenate([*y, self.lengths])


@dataclass(frozen=True, eq=False)
class IndependentParameters:
    """Parameters that alone are fitted, one for each group; the others keep the values of the file."""

    columns: tuple[int, ...]
    """Their places among the names of the fit, those of targets at the end."""
    terms: Array
    """(k, p) factors of the chain's parameters in the group of each."""

    def prior(self, wide: Array) -> Array:
        """Prior of the groups from that of all parameters: L⁻¹ with L L' = G diag(wide²) G'.

        Parameters
        ----------
        wide : (p,) array, standard deviations of the parameters

        Returns
        -------
        rows : (k, p) array, to be multiplied by the parameters

        Examples
        --------
        >>> IndependentParameters((1,), np.array([[0.75, 1.0]])).prior(np.array([4.0, 4.0]))
        array([[0. , 0.2]])
        """
        S = self.terms * wide
        rows = np.zeros(self.terms.shape)
        rows[:, self.columns[: len(rows)]] = np.linalg.inv(np.linalg.cholesky(S @ S.T))
        return rows


@dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """Chain and measurements of a fit."""

    chain: TipChain
    """Chain to the tip."""
    measured: tuple[Measurements, ...]
    """Measurements that are fitted together."""
    keep_outliers: bool = False
    """True if no reading is left out."""
    used: tuple[Array, ...] | None = None
    """Mask of the readings of each measurement that count; None for all."""
    independent: IndependentParameters | None = None
    """Parameters that are fitted; None for all."""

    @cached_property
    def masks(self) -> tuple[Array, ...]:
        """(m,) True for readings that count."""
        return self.used or tuple(np.ones(m.count, bool) for m in self.measured)

    @cached_property
    def loads(self) -> list[Array]:
        """Torques of gravity at each configuration."""
        return [self.chain.loads(m.q) for m in self.measured]

    @cached_property
    def wide(self) -> Array:
        """(p,) standard deviations of the prior."""
        length, angle = SCALELESS_PRIOR if self.is_scaleless else PRIOR
        return self.chain.scales(angle, length, GEAR, SAG, TIP)

    @cached_property
    def prior(self) -> Array:
        """(k, p) rows of the prior on the chain's parameters, over their deviations."""
        return np.diag(1.0 / self.wide) if self.independent is None else self.independent.prior(self.wide)

    def free(self, count: int, *, frames_only: bool) -> Array:
        """(count,) True for the columns of a step: tip and targets alone, or those that are fitted."""
        if frames_only:
            return np.arange(count) >= len(self.chain.parameters) - 6
        if self.independent is None:
            return np.ones(count, bool)
        mask = np.zeros(count, bool)
        mask[list(self.independent.columns)] = True
        return mask

    @property
    def is_scaleless(self) -> bool:
        """True if no measurement contains a length."""
        return all(m.is_scaleless for m in self.measured)

    def start(self) -> Estimate:
        """Corrections of zero, a tip turned as the target of measured poses, and targets for them."""
        at = self.chain.start
        for m, mask in zip(self.measured, self.masks, strict=True):
            if m.kind != "pose":
                continue
            T, _ = self.chain.poses(m.q, self.chain.loads(m.q), at)
            turn = np.eye(4)
            turn[:3, :3] = turn_of_target(m.rotations[mask], T[mask, :3, :3])
            at = replace(at, tip=at.tip @ turn)
            break
        tips = []
        for m, loads in zip(self.measured, self.loads, strict=True):
            tip_poses, _ = self.chain.poses(m.q, loads, at)
            tips.append(tip_poses)
        return Estimate(at, tuple(targets_from_tips(self.measured, tips)))

    def equations(self, state: Estimate) -> LinearRows:
        """Residuals and their derivatives at a state."""
        sizes = [len(target.names) for target in state.targets]
        p = len(self.chain.parameters)
        places = p + np.cumsum([0, *sizes])
        residuals, design, lengths, length_rows = [], [], [], []
        for b, (m, target) in enumerate(zip(self.measured, state.targets, strict=True)):
            T, J = self.chain.poses(m.q, self.loads[b], state.corrections)
            e, D, own = target.rows(T, J)
            A = np.zeros((*e.shape, places[-1]))
            A[..., :p], A[..., places[b] : places[b + 1]] = D, own
            residuals.append(e)
            design.append(A)
            length_row = target.length_row(T, J)
            if length_row is not None:
                row = np.zeros(places[-1])
                row[:p], row[places[b] : places[b + 1]] = length_row[1], length_row[2]
                lengths.append(length_row[0] / KNOWN_LENGTH)
                length_rows.append(row / KNOWN_LENGTH)
        rows = np.array(length_rows).reshape(len(lengths), places[-1])
        return LinearRows(tuple(residuals), tuple(design), np.array(lengths), rows)

    def step(self, state: Estimate, x: Array) -> Estimate:
        """Estimate after a step."""
        at = len(self.chain.parameters)
        corrections = self.chain.step(state.corrections, x[:at])
        targets = list[MeasuredTarget]()
        for target in state.targets:
            targets.append(target.step(x[at : at + len(target.names)]))
            at += len(target.names)
        return Estimate(corrections, tuple(targets))

    # ── Solution

    @property
    def count(self) -> int:
        """Number of readings."""
        return sum(m.count for m in self.measured)

    def solve(self, start: Estimate | None = None, *, frames_only: bool = False) -> CalibrationFit:
        """Least squares from a start; with ``frames_only``, of targets and tip alone."""
        state = self.start() if start is None else start
        weights, damping = self._first_weights(), 1e-3
        equations, trimmed = self.equations(state), 0
        for k in range(_FRAMES_ONLY if frames_only else _ITERATIONS):
            frames = frames_only or (start is None and k < _FRAMES_ONLY)
            last = weights
            if not frames or (frames_only and k > 2):
                weights = self._weights(equations, frames, trim=trimmed > 0)
            state, equations, damping, lowered = self._step(state, equations, weights, damping, frames)
            change = max(float(np.abs(W - V).max() / V.max()) for W, V in zip(weights, last, strict=True))
            if trimmed or (not frames and change < _MAX_CHANGE and lowered < _MAX_CHANGE):
                trimmed += 1
                if trimmed > 2 and change < _MAX_CHANGE:
                    break
        return CalibrationFit(
            self, state, equations, tuple(self._weights(equations, frames_only, trim=True)), frames_only
        )

    def _step(
        self, state: Estimate, equations: LinearRows, weights: Sequence[Array], damping: float, frames: bool
    ) -> tuple[Estimate, LinearRows, float, float]:
        """Levenberg step that lowers the cost: new state and equations, damping, and the lowered share of the cost."""
        A, y = equations.weighted_rows(weights)
        prior = np.zeros((len(self.prior), A.shape[1]))
        prior[:, : self.prior.shape[1]] = self.prior
        B = np.concatenate([A, prior])
        r = np.concatenate([y, self.prior @ self.chain.values(state.corrections)])
        free = self.free(B.shape[1], frames_only=frames)
        size = np.linalg.norm(B[:, free], axis=0) + 1e-12
        N, c = (B[:, free] / size).T @ (B[:, free] / size), (B[:, free] / size).T @ r
        cost = float(r @ r)
        for _ in range(_TRIALS):
            x = np.zeros(B.shape[1])
            x[free] = -np.linalg.solve(N + (damping + 1e-13) * np.eye(len(N)), c) / size
            trial = self.step(state, x)
            found = self.equations(trial)
            left = np.concatenate([found.weighted_rows(weights)[1], self.prior @ self.chain.values(trial.corrections)])
            if left @ left <= cost * (1.0 + 1e-12):
                return trial, found, max(damping / 10.0, 1e-9), 1.0 - float(left @ left) / max(cost, 1e-300)
            damping = max(damping * 10.0, 1e-6)
        return state, equations, damping, 0.0

    def _first_weights(self) -> list[Array]:
        """Weights of 1 mm and 3 mrad."""
        found = [np.full((m.count, m.rows_each), 1e3) for m in self.measured]
        for W, m, used in zip(found, self.measured, self.masks, strict=True):
            W[:, : m.angle_rows] = 3e2
            W[~used] = 0.0
        return found

    def _freedom(self, equations: LinearRows, frames: bool) -> float:
        """Share of the rows that parameters do not use up."""
        rows = sum(e.shape[1] * int(used.sum()) for e, used in zip(equations.residuals, self.masks, strict=True))
        n = len(self.chain.joints)
        used = equations.length_rows.shape[1] - len(self.chain.parameters) + (6 if frames else 4 * n)
        return max(1.0 - used / rows, 0.1)

    def _weights(self, equations: LinearRows, frames: bool, *, trim: bool) -> list[Array]:
        """Weights of whole readings over one deviation for lengths and one for angles.

        Huber's weights w with deviations by the median until the fit has settled; then outliers get none, and the
        deviation is that of the others.
        """
        free, found = self._freedom(equations, frames), list[Array]()
        for m, e, used in zip(self.measured, equations.residuals, self.masks, strict=True):
            parts = [slice(None)]
            if m.angle_rows:
                parts = [slice(0, m.angle_rows), slice(m.angle_rows, None)]
            deviations = np.ones(e.shape[1])
            for k, part in enumerate(parts):
                if m.noise is not None:
                    deviations[part] = float(np.broadcast_to(m.noise, 2)[len(parts) - 1 - k])
                    continue
                squares = (e[used, part] ** 2).mean(axis=1)
                median = float(np.median(squares)) / _MEDIANS[len(deviations[part])]
                if not self.keep_outliers:
                    squares = squares[squares <= (ROBUST / OUTLIER) ** 2 * median / free]
                size = float(squares.mean()) if trim and squares.size else median
                deviations[part] = np.sqrt(size / free) + _MIN_DEVIATION
            distances = np.sqrt(((e / deviations) ** 2).mean(axis=1))
            weights = np.ones(len(distances))
            if not (self.keep_outliers or frames):
                weights = huber_weights(distances, ROBUST)
            if trim:
                weights = np.where(weights < OUTLIER, 0.0, 1.0)
            found.append(np.where(used, weights, 0.0)[:, None] / deviations)
        return found


@dataclass(frozen=True, eq=False)
class CalibrationFit:
    """Solution of a problem, linearised there."""

    problem: CalibrationProblem
    """Chain and measurements."""
    state: Estimate
    """Solution."""
    equations: LinearRows
    """Residuals and derivatives at the solution."""
    weights: tuple[Array, ...]
    """(m, r) weight of each row: one over its standard deviation, 0 for outliers."""
    frames_only: bool = False
    """True if only targets and tip were fitted."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, with ``target.`` or ``target2.`` before those of targets."""
        names = list(self.problem.chain.parameters)
        for b, target in enumerate(self.state.targets):
            number = "" if b == 0 else str(b + 1)
            names += [f"target{number}.{word}" for word in target.names]
        return tuple(names)

    @cached_property
    def deviations(self) -> list[tuple[float, float]]:
        """Standard deviations [m, rad] of a reading of each measurement; rad is 0 without angles."""
        deviations = []
        for m, W in zip(self.problem.measured, self.weights, strict=True):
            angle = 0.0
            if m.angle_rows:
                angle = float(1.0 / W[:, 0].max())
            deviations.append((float(1.0 / W[:, -1].max(initial=1e-300)), angle))
        return deviations

    @cached_property
    def outliers(self) -> list[tuple[int, int, float]]:
        """Measurement, reading and size [m] of readings without weight."""
        found = []
        for b, (used, W) in enumerate(zip(self.problem.masks, self.weights, strict=True)):
            found += [(b, int(i), float(self.errors[b][i])) for i in np.flatnonzero(used & (W[:, -1] == 0.0))]
        return sorted(found, key=lambda outlier: -outlier[2])

    @cached_property
    def errors(self) -> list[Array]:
        """Size (m,) of each reading's residual [m]."""
        measured = zip(self.equations.residuals, self.problem.measured, strict=True)
        errors = []
        for e, m in measured:
            errors.append(np.linalg.norm(e[:, m.angle_rows :], axis=1))
        return errors

    @cached_property
    def turns(self) -> list[Array]:
        """Size (m,) of each reading's residual [rad]; empty without angles."""
        measured = zip(self.equations.residuals, self.problem.measured, strict=True)
        turns = []
        for e, m in measured:
            if m.angle_rows:
                turns.append(np.linalg.norm(e[:, : m.angle_rows], axis=1))
            else:
                turns.append(np.zeros(0))
        return turns

    @cached_property
    def rms(self) -> float:
        """Root mean square of the residual [m], without outliers."""
        kept = [e[W[:, -1] > 0] for e, W in zip(self.errors, self.weights, strict=True)]
        return float(np.sqrt(np.mean(np.concatenate(kept) ** 2)))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a reading as a distance [m]."""
        rows = [m.rows_each - m.angle_rows for m in self.problem.measured]
        sizes = [d[0] ** 2 * r for d, r in zip(self.deviations, rows, strict=True)]
        return float(np.sqrt(np.average(sizes, weights=[m.count for m in self.problem.measured])))

    @cached_property
    def weighted_rows(self) -> tuple[Array, Array]:
        """Design and residuals over their standard deviations, without the prior."""
        return self.equations.weighted_rows(self.weights)
