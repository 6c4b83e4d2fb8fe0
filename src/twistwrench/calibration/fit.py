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
PRIOR = (1e-2, 4e-2)
"""Standard deviations of the file's lengths [m] and angles [rad] during the fit."""
SCALELESS_PRIOR = (2e-3, 4e-3)
"""Standard deviations of the file's lengths [m] and angles [rad] if no measurement contains a length."""
TIP = (0.5, 0.3)
"""Standard deviations of the tip's rotation [rad] and position [m] during the fit."""
GEAR = 1e-2
"""Standard deviation of gear errors during the fit, as a share."""
SAG = 1e-2
"""Standard deviation of sags during the fit [rad/(N m)]."""
KNOWN_LENGTH = 1e-5
"""Standard deviation of a known length [m]."""
_FRAME_ITERATIONS = 8
"""Number of first iterations that change only targets and tip."""
_UNWEIGHTED_ITERATIONS = 3
"""Number of first iterations of targets and tip alone whose residuals would give wrong weights."""
_MAX_ITERATIONS = 40
_MIN_TRIMMED_ITERATIONS = 3
"""Least number of last iterations, of which those after convergence give outliers no weight."""
_MAX_TRIALS = 10
"""Maximum number of trials, each with more damping, for one step."""
_INITIAL_DAMPING = 1e-3
"""Initial damping, relative to a Gauss-Newton matrix with ones on its diagonal, as all dampings."""
_MIN_DAMPING = 1e-9
_MIN_RAISED_DAMPING = 1e-6
"""Smallest damping after a trial that raised the cost."""
_DAMPING_FACTOR = 10.0
"""Factor by which damping falls after a step, and rises after a trial that raised the cost."""
_MAX_CHANGE = 1e-3
"""Change of weights and of the cost, as a share, below which a fit has converged."""
_INITIAL_WEIGHTS = (3e2, 1e3)
"""Initial weights of angles [1/rad] and lengths [1/m]: of standard deviations of about 3 mrad and 1 mm."""
_MIN_DEVIATION = 1e-9
"""Smallest standard deviation [m, rad]: rounding."""
_MEDIANS = {1: 0.4549, 3: 0.7887, 6: 0.8914}
"""Medians of chi² over its degrees of freedom, by number of degrees of freedom."""
_MIN_FREEDOM_SHARE = 0.1
"""Smallest share of degrees of freedom among the rows, for fits with few readings."""


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
    """(m, r) residuals of each measurement: m readings of r rows."""
    design: tuple[Array, ...]
    """(m, r, p + targets) derivatives of each measurement's residuals by all parameters."""
    lengths: Array
    """(k,) residuals of known lengths over their standard deviation."""
    length_rows: Array
    """(k, p + targets) derivatives of these residuals."""

    def weighted_rows(self, weights: Sequence[Array]) -> tuple[Array, Array]:
        """Design (rows, p + targets) and residuals (rows,) times weights (m, r) of each measurement."""
        design_parts: list[Array] = []
        residual_parts: list[Array] = []
        for D, e, W in zip(self.design, self.residuals, weights, strict=True):
            weighted_design = D * W[..., None]
            design_parts.append(weighted_design.reshape(-1, D.shape[2]))
            residual_parts.append((e * W).ravel())
        A = np.concatenate([*design_parts, self.length_rows])
        y = np.concatenate([*residual_parts, self.lengths])
        return A, y


@dataclass(frozen=True, eq=False)
class IndependentParameters:
    """The fitted parameters, one for each group; the others keep the values of the file."""

    columns: tuple[int, ...]
    """Indices of the fitted parameters among the names of the fit: first of the chain, then of the targets."""
    terms: Array
    """(k, p) factors of the chain's parameters in the group of each fitted parameter."""

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
        L = np.linalg.cholesky(S @ S.T)
        rows = np.zeros(self.terms.shape)
        rows[:, self.columns[: len(rows)]] = np.linalg.inv(L)
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
        """Mask (m,) of the readings that count, for each measurement."""
        if self.used:
            return self.used
        return tuple(np.ones(m.count, bool) for m in self.measured)

    @cached_property
    def loads(self) -> list[Array]:
        """Torques of gravity at each configuration, for each measurement."""
        return [self.chain.loads(m.q) for m in self.measured]

    @cached_property
    def wide_deviations(self) -> Array:
        """(p,) standard deviations of the chain's parameters in the prior."""
        length, angle = SCALELESS_PRIOR if self.is_scaleless else PRIOR
        return self.chain.scales(angle, length, GEAR, SAG, TIP)

    @cached_property
    def prior(self) -> Array:
        """(k, p) rows of the prior on the chain's parameters, over their deviations."""
        if self.independent is None:
            return np.diag(1.0 / self.wide_deviations)
        return self.independent.prior(self.wide_deviations)

    def free(self, count: int, *, frames_only: bool) -> Array:
        """(count,) True for the columns of a step: tip and targets alone, or those that are fitted."""
        if frames_only:
            first_tip_column = len(self.chain.parameters) - 6  # the tip has six, and targets follow
            return np.arange(count) >= first_tip_column
        if self.independent is None:
            return np.ones(count, bool)
        is_fitted = np.zeros(count, bool)
        is_fitted[list(self.independent.columns)] = True
        return is_fitted

    @property
    def is_scaleless(self) -> bool:
        """True if no measurement contains a length."""
        return all(m.is_scaleless for m in self.measured)

    def start(self) -> Estimate:
        """Estimate before the first iteration: the file's geometry, and targets computed from its poses.

        If poses are measured, the tip is rotated as the target of the first such measurement.
        """
        corrections = self.chain.start
        for m, mask in zip(self.measured, self.masks, strict=True):
            if m.kind != "pose":
                continue
            T, _ = self.chain.poses(m.q, self.chain.loads(m.q), corrections)
            tip_rotation = np.eye(4)
            tip_rotation[:3, :3] = turn_of_target(m.rotations[mask], T[mask, :3, :3])
            corrections = replace(corrections, tip=corrections.tip @ tip_rotation)
            break
        tips = []
        for m, loads in zip(self.measured, self.loads, strict=True):
            tip_poses, _ = self.chain.poses(m.q, loads, corrections)
            tips.append(tip_poses)
        return Estimate(corrections, tuple(targets_from_tips(self.measured, tips)))

    def equations(self, state: Estimate) -> LinearRows:
        """Residuals and their derivatives at a state."""
        target_counts = [len(target.names) for target in state.targets]
        p = len(self.chain.parameters)
        first_columns = p + np.cumsum([0, *target_counts])  # of each target; the last is the number of all columns
        column_count = first_columns[-1]
        residuals: list[Array] = []
        design: list[Array] = []
        lengths: list[float] = []
        length_rows: list[Array] = []
        for k, (m, target) in enumerate(zip(self.measured, state.targets, strict=True)):
            own_columns = slice(first_columns[k], first_columns[k + 1])
            T, J = self.chain.poses(m.q, self.loads[k], state.corrections)
            e, by_chain, by_target = target.rows(T, J)
            A = np.zeros((*e.shape, column_count))
            A[..., :p] = by_chain
            A[..., own_columns] = by_target
            residuals.append(e)
            design.append(A)
            length_row = target.length_row(T, J)
            if length_row is not None:
                length_error, length_by_chain, length_by_target = length_row
                row = np.zeros(column_count)
                row[:p] = length_by_chain
                row[own_columns] = length_by_target
                lengths.append(length_error / KNOWN_LENGTH)
                length_rows.append(row / KNOWN_LENGTH)
        known_length_rows = np.array(length_rows).reshape(len(lengths), column_count)  # also without known lengths
        return LinearRows(tuple(residuals), tuple(design), np.array(lengths), known_length_rows)

    def step(self, state: Estimate, x: Array) -> Estimate:
        """Estimate after a step x: first the chain's parameters, then those of each target."""
        column = len(self.chain.parameters)
        corrections = self.chain.step(state.corrections, x[:column])
        targets: list[MeasuredTarget] = []
        for target in state.targets:
            next_column = column + len(target.names)
            targets.append(target.step(x[column:next_column]))
            column = next_column
        return Estimate(corrections, tuple(targets))

    # ── Solution

    @property
    def count(self) -> int:
        """Number of readings."""
        return sum(m.count for m in self.measured)

    def solve(self, start: Estimate | None = None, *, frames_only: bool = False) -> CalibrationFit:
        """Least squares from a start; with ``frames_only``, of targets and tip alone."""
        state = self.start() if start is None else start
        weights = self._first_weights()
        damping = _INITIAL_DAMPING
        equations = self.equations(state)
        trimmed_iterations = 0  # iterations since the fit converged, in which outliers have no weight
        iteration_count = _FRAME_ITERATIONS if frames_only else _MAX_ITERATIONS
        for k in range(iteration_count):
            changes_frames_only = frames_only or (start is None and k < _FRAME_ITERATIONS)
            previous_weights = weights
            may_weigh_frames = frames_only and k >= _UNWEIGHTED_ITERATIONS
            if may_weigh_frames or not changes_frames_only:
                weights = self._weights(equations, changes_frames_only, trim=trimmed_iterations > 0)
            state, equations, damping, decrease = self._step(state, equations, weights, damping, changes_frames_only)
            change = max(_relative_change(W, V) for W, V in zip(weights, previous_weights, strict=True))
            has_converged = not changes_frames_only and change < _MAX_CHANGE and decrease < _MAX_CHANGE
            if trimmed_iterations or has_converged:
                trimmed_iterations += 1
                if trimmed_iterations >= _MIN_TRIMMED_ITERATIONS and change < _MAX_CHANGE:
                    break
        weights = self._weights(equations, frames_only, trim=True)
        return CalibrationFit(self, state, equations, tuple(weights), frames_only)

    def _step(
        self, state: Estimate, equations: LinearRows, weights: Sequence[Array], damping: float, frames_only: bool
    ) -> tuple[Estimate, LinearRows, float, float]:
        """Levenberg step that lowers the cost: new state, its equations, damping, and decrease of the cost as a share.

        If no trial lowers the cost, the state stays and the decrease is 0.
        """
        A, y = equations.weighted_rows(weights)
        prior_rows = np.zeros((len(self.prior), A.shape[1]))
        prior_rows[:, : self.prior.shape[1]] = self.prior  # the prior is on the chain's parameters
        B = np.concatenate([A, prior_rows])
        r = np.concatenate([y, self.prior @ self.chain.values(state.corrections)])
        is_free = self.free(B.shape[1], frames_only=frames_only)
        free_columns = B[:, is_free]
        norms = np.linalg.norm(free_columns, axis=0) + 1e-12  # a column of zeros is not divided by zero
        scaled_columns = free_columns / norms
        N = scaled_columns.T @ scaled_columns
        c = scaled_columns.T @ r
        cost = float(r @ r)
        for _ in range(_MAX_TRIALS):
            x = np.zeros(B.shape[1])
            damped_matrix = N + (damping + 1e-13) * np.eye(len(N))  # 1e-13: N may be singular
            x[is_free] = -np.linalg.solve(damped_matrix, c) / norms
            new_state = self.step(state, x)
            new_equations = self.equations(new_state)
            _, new_y = new_equations.weighted_rows(weights)
            new_r = np.concatenate([new_y, self.prior @ self.chain.values(new_state.corrections)])
            new_cost = float(new_r @ new_r)
            if new_cost <= cost * (1.0 + 1e-12):  # equal but for rounding
                decrease = 1.0 - new_cost / max(cost, 1e-300)  # 1e-300: the cost may be zero
                new_damping = max(damping / _DAMPING_FACTOR, _MIN_DAMPING)
                return new_state, new_equations, new_damping, decrease
            damping = max(damping * _DAMPING_FACTOR, _MIN_RAISED_DAMPING)
        return state, equations, damping, 0.0

    def _first_weights(self) -> list[Array]:
        """Weights of the first iterations, (m, r) for each measurement."""
        angle_weight, length_weight = _INITIAL_WEIGHTS
        weights = [np.full((m.count, m.rows_each), length_weight) for m in self.measured]
        for W, m, used in zip(weights, self.measured, self.masks, strict=True):
            W[:, : m.angle_rows] = angle_weight
            W[~used] = 0.0
        return weights

    def _freedom(self, equations: LinearRows, frames_only: bool) -> float:
        """Degrees of freedom of the residuals, as a share of the rows: rows less fitted parameters; at least 0.1."""
        row_count = sum(e.shape[1] * int(used.sum()) for e, used in zip(equations.residuals, self.masks, strict=True))
        target_parameters = equations.length_rows.shape[1] - len(self.chain.parameters)
        # The tip alone has six; a chain has four independent ones per joint.
        chain_parameters = 6 if frames_only else 4 * len(self.chain.joints)
        parameter_count = target_parameters + chain_parameters
        return max(1.0 - parameter_count / row_count, _MIN_FREEDOM_SHARE)

    def _weights(self, equations: LinearRows, frames_only: bool, *, trim: bool) -> list[Array]:
        """Weight of each reading over the standard deviation of its row, (m, r) for each measurement.

        A measurement has one deviation for lengths and one for angles. Before the fit has converged, weights are Huber's,
        with deviations by the median. With ``trim``, outliers have weight 0, and deviations are computed without them.
        """
        freedom = self._freedom(equations, frames_only)
        weights_by_measurement: list[Array] = []
        for m, e, used in zip(self.measured, equations.residuals, self.masks, strict=True):
            row_groups = [slice(None)]  # of lengths alone
            if m.angle_rows:
                row_groups = [slice(0, m.angle_rows), slice(m.angle_rows, None)]  # angles, lengths
            deviations = np.ones(e.shape[1])
            for k, rows in enumerate(row_groups):
                if m.noise is not None:
                    # The noise is given for lengths first, then for angles: the reverse of the groups.
                    deviations[rows] = float(np.broadcast_to(m.noise, 2)[len(row_groups) - 1 - k])
                    continue
                squares = (e[used, rows] ** 2).mean(axis=1)
                variance = float(np.median(squares)) / _MEDIANS[len(deviations[rows])]
                if not self.keep_outliers:
                    max_square = (ROBUST / OUTLIER) ** 2 * variance / freedom
                    squares = squares[squares <= max_square]
                if trim and squares.size:
                    variance = float(squares.mean())
                deviations[rows] = np.sqrt(variance / freedom) + _MIN_DEVIATION
            distances = np.sqrt(((e / deviations) ** 2).mean(axis=1))  # rms of each reading, in deviations
            weights = np.ones(len(distances))
            if not (self.keep_outliers or frames_only):
                weights = huber_weights(distances, ROBUST)
            if trim:
                weights = np.where(weights < OUTLIER, 0.0, 1.0)
            used_weights = np.where(used, weights, 0.0)
            weights_by_measurement.append(used_weights[:, None] / deviations)
        return weights_by_measurement


def _negative_error(outlier: tuple[int, int, float]) -> float:
    """Sort key of outliers: the largest error first."""
    _, _, error = outlier
    return -error


def _relative_change(weights: Array, previous: Array) -> float:
    """Largest change of a weight, over the largest previous weight."""
    return float(np.abs(weights - previous).max() / previous.max())


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
        for k, target in enumerate(self.state.targets):
            number = "" if k == 0 else str(k + 1)  # target, target2, target3, ...
            names += [f"target{number}.{name}" for name in target.names]
        return tuple(names)

    @cached_property
    def deviations(self) -> list[tuple[float, float]]:
        """Standard deviations [m, rad] of a reading of each measurement; rad is 0 without angles."""
        deviations = []
        for m, W in zip(self.problem.measured, self.weights, strict=True):
            # A reading that is no outlier has the largest weight of its column, 1 / deviation. 1e-300: all are outliers.
            length_deviation = float(1.0 / W[:, -1].max(initial=1e-300))
            angle_deviation = 0.0
            if m.angle_rows:
                angle_deviation = float(1.0 / W[:, 0].max())
            deviations.append((length_deviation, angle_deviation))
        return deviations

    @cached_property
    def outliers(self) -> list[tuple[int, int, float]]:
        """Indices of measurement and reading, and error [m], of outliers; the largest error first."""
        outliers: list[tuple[int, int, float]] = []
        for k, (used, W) in enumerate(zip(self.problem.masks, self.weights, strict=True)):
            is_outlier = used & (W[:, -1] == 0.0)
            readings = np.flatnonzero(is_outlier).tolist()
            outliers += [(k, reading, float(self.errors[k][reading])) for reading in readings]
        return sorted(outliers, key=_negative_error)

    @cached_property
    def errors(self) -> list[Array]:
        """Size (m,) of each reading's residual [m]."""
        errors = []
        for e, m in zip(self.equations.residuals, self.problem.measured, strict=True):
            errors.append(np.linalg.norm(e[:, m.angle_rows :], axis=1))
        return errors

    @cached_property
    def turns(self) -> list[Array]:
        """Size (m,) of each reading's residual [rad]; empty without angles."""
        turns = []
        for e, m in zip(self.equations.residuals, self.problem.measured, strict=True):
            if m.angle_rows:
                turns.append(np.linalg.norm(e[:, : m.angle_rows], axis=1))
            else:
                turns.append(np.zeros(0))
        return turns

    @cached_property
    def rms(self) -> float:
        """Root mean square of the residual [m], without outliers."""
        used_errors = [e[W[:, -1] > 0] for e, W in zip(self.errors, self.weights, strict=True)]
        return float(np.sqrt(np.mean(np.concatenate(used_errors) ** 2)))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a whole reading [m], the norm of its rows of lengths; root mean square of all readings."""
        measured = self.problem.measured
        squares = []  # expected squared norm of a reading: variance of a row times number of rows
        for m, (length_deviation, _) in zip(measured, self.deviations, strict=True):
            squares.append(length_deviation**2 * (m.rows_each - m.angle_rows))
        reading_counts = [m.count for m in measured]
        return float(np.sqrt(np.average(squares, weights=reading_counts)))

    @cached_property
    def weighted_rows(self) -> tuple[Array, Array]:
        """Design and residuals over their standard deviations, without the prior."""
        return self.equations.weighted_rows(self.weights)
