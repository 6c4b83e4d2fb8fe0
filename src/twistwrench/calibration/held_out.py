"""Held-out error: readings of poses that the fit did not use, in six folds or from another file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import ValueRangeError
from ..core.typing import Array
from .fit import CalibrationFit, CalibrationProblem, Estimate
from .measurements import MAX_JOINT_DIFFERENCE, MIN_CONFIGURATIONS, Measurements
from .targets import targets_from_tips

FOLDS = 6
"""Number of folds."""
_MAX_RATIO_AFTER_REMOUNTING = 0.5
"""Error with a refitted tip, over the error without, up to which the target was mounted again for the test."""


@dataclass(frozen=True, eq=False)
class HeldOutError:
    """Error of readings that were not used.

    Attributes
    ----------
    rms, max : float [m]
    poses : int, number of readings
    angle : float [rad], rms of rotations; 0 without poses
    """

    rms: float
    max: float
    poses: int
    angle: float
    errors: Array
    """(poses,) sizes [m]."""
    note: str = ""
    """Sentence about a test file."""


def configuration_labels(m: Measurements) -> Array:
    """Integers (n,) that are equal for equal configurations; also for both configurations of a pair, unless pairs overlap."""
    rounded_q = np.round(m.q / MAX_JOINT_DIFFERENCE).astype(np.int64)
    _, labels = np.unique(rounded_q, axis=0, return_inverse=True)
    labels = labels.ravel()
    if m.pairs is not None:
        first, second = m.pairs.T
        occur_once = len(np.unique(labels[m.pairs])) == m.pairs.size
        if occur_once:
            labels[second] = labels[first]
    return np.asarray(labels)


def cross_validated(fit: CalibrationFit, seed: int) -> HeldOutError:
    """Error of readings in six folds by configurations, each predicted by a fit to the other folds.

    Raises ValueRangeError if no fold leaves enough readings.
    """
    rng = np.random.default_rng(seed)
    problem = fit.problem
    used_masks = [W[:, -1] > 0 for W in fit.weights]  # without outliers
    folds: list[Array] = []  # (readings, 1 or 2): a pair has two
    configurations: list[Array] = []  # label of each reading's configuration
    for m in problem.measured:
        labels = configuration_labels(m)
        all_labels = np.arange(labels.max() + 1)
        fold_of_label = rng.permutation(all_labels) % FOLDS
        fold = fold_of_label[labels]
        if m.pairs is None:
            configurations.append(labels)
            folds.append(fold[:, None])
        else:
            configurations.append(labels[m.pairs[:, 0]])
            folds.append(fold[m.pairs])
    held_out_errors: list[Array] = []
    held_out_angles: list[Array] = []
    for k in range(FOLDS):
        test_masks: list[Array] = []
        training_masks: list[Array] = []
        training_counts: list[int] = []  # of configurations
        for used, fold, labels in zip(used_masks, folds, configurations, strict=True):
            training_mask = used & (fold != k).all(axis=1)
            test_masks.append(used & (fold == k).all(axis=1))
            training_masks.append(training_mask)
            training_counts.append(len(np.unique(labels[training_mask])))
        has_tests = any(map(np.any, test_masks))
        if not has_tests or min(training_counts) < MIN_CONFIGURATIONS:
            continue
        training_fit = replace(problem, used=tuple(training_masks)).solve(fit.state)
        for errors, angles, test_mask in zip(training_fit.errors, training_fit.turns, test_masks, strict=True):
            held_out_errors.append(errors[test_mask])
            if angles.size:
                held_out_angles.append(angles[test_mask])
    if not held_out_errors:
        raise ValueRangeError(
            "the readings are at so few configurations that none can be held out. Measure at 30, or give a test file."
        )
    return _error_of_readings(held_out_errors, held_out_angles)


def error_of_test(fit: CalibrationFit, measured: Sequence[Measurements]) -> HeldOutError:
    """Error of other readings. Their targets are fitted again, and the tip, too, if the ball was mounted again."""
    problem = CalibrationProblem(fit.problem.chain, tuple(measured))
    corrections = fit.state.corrections
    tips = [problem.chain.tips(m.q, corrections) for m in measured]
    state = Estimate(corrections, tuple(targets_from_tips(measured, tips)))
    same_tip = replace(fit, problem=problem, state=state, equations=problem.equations(state))
    refitted_tip = problem.solve(state, frames_only=True)
    error = _error_of_readings(same_tip.errors, same_tip.turns)
    error_with_refitted_tip = _error_of_readings(refitted_tip.errors, refitted_tip.turns)
    if error_with_refitted_tip.rms > _MAX_RATIO_AFTER_REMOUNTING * error.rms:
        return error
    note = "The target was mounted again for the test: its place on the robot was fitted there too."
    return replace(error_with_refitted_tip, note=note)


def _error_of_readings(errors: Sequence[Array], angles: Sequence[Array]) -> HeldOutError:
    """Error of readings with these residuals, ``errors`` [m] and ``angles`` [rad], one array for each measurement or fold."""
    all_errors = np.concatenate([*errors])
    all_angles = np.concatenate([np.zeros(0), *angles])  # also without angles
    rms = float(np.sqrt(np.mean(all_errors**2)))
    rms_angle = float(np.sqrt(np.mean(all_angles**2))) if all_angles.size else 0.0
    return HeldOutError(rms, float(all_errors.max()), len(all_errors), rms_angle, all_errors)
