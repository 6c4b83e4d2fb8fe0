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
    """(n,) numbers that are equal for equal configurations, and for the two of a pair if no pairs overlap."""
    labels = np.unique(np.round(m.q / MAX_JOINT_DIFFERENCE).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    if m.pairs is not None and len(np.unique(labels[m.pairs])) == m.pairs.size:
        labels[m.pairs[:, 1]] = labels[m.pairs[:, 0]]
    return np.asarray(labels)


def cross_validated(fit: CalibrationFit, seed: int) -> HeldOutError:
    """Six folds by configurations; targets and tip are refitted from the other folds.

    Raises ValueRangeError if no fold leaves enough readings.
    """
    rng = np.random.default_rng(seed)
    problem, kept = fit.problem, [W[:, -1] > 0 for W in fit.weights]
    folds, configurations = list[Array](), list[Array]()
    for m in problem.measured:
        labels = configuration_labels(m)
        of_label = rng.permutation(np.arange(labels.max() + 1)) % FOLDS
        fold = of_label[labels]
        if m.pairs is None:
            configurations.append(labels)
            folds.append(fold[:, None])
        else:
            configurations.append(labels[m.pairs[:, 0]])
            folds.append(fold[m.pairs])
    lengths, angles = list[Array](), list[Array]()
    for k in range(FOLDS):
        test, train, counts = list[Array](), list[Array](), list[int]()
        for mask, fold, labels in zip(kept, folds, configurations, strict=True):
            test.append(mask & (fold == k).all(axis=1))
            train.append(mask & (fold != k).all(axis=1))
            counts.append(len(np.unique(labels[train[-1]])))
        if not any(map(np.any, test)) or min(counts) < MIN_CONFIGURATIONS:
            continue
        found = replace(problem, used=tuple(train)).solve(fit.state)
        for errors, turns, mask in zip(found.errors, found.turns, test, strict=True):
            lengths.append(errors[mask])
            if turns.size:
                angles.append(turns[mask])
    if not lengths:
        raise ValueRangeError(
            "the readings are at so few configurations that none can be held out. Measure at 30, or give a test file."
        )
    return _error(lengths, angles)


def error_of_test(fit: CalibrationFit, measured: Sequence[Measurements]) -> HeldOutError:
    """Error of other readings; their targets are refitted, and the tip too if the ball was mounted again."""
    problem = CalibrationProblem(fit.problem.chain, tuple(measured))
    at = fit.state.corrections
    tips = [problem.chain.tips(m.q, at) for m in measured]
    mounted = replace(fit, problem=problem, state=Estimate(at, tuple(targets_from_tips(measured, tips))))
    mounted = replace(mounted, equations=problem.equations(mounted.state))
    again = problem.solve(mounted.state, frames_only=True)
    plain, other = _error(mounted.errors, mounted.turns), _error(again.errors, again.turns)
    if other.rms > 0.5 * plain.rms:
        return plain
    return replace(
        other, note="The target was mounted again for the test: its place on the robot was fitted there too."
    )


def _error(lengths: Sequence[Array], angles: Sequence[Array]) -> HeldOutError:
    e, turns = np.concatenate([*lengths]), np.concatenate([np.zeros(0), *angles])
    angle = float(np.sqrt(np.mean(turns**2))) if turns.size else 0.0
    return HeldOutError(float(np.sqrt(np.mean(e**2))), float(e.max()), len(e), angle, e)
