"""What four models of a robot leave of its torques: its file, the file with friction, the groups, the consistent robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .consistent_robot import file_with_drives, sum_of
from .normal_equations import NormalEquations, Prior
from .parameter_groups import BaseParameters
from .positive_bodies import STRENGTHS, PositivePrior, PositiveProblem


@dataclass(frozen=True, eq=False)
class ModelResiduals:
    """Shares |τ - τ̂| / |τ| by joint, of weighted rows in fifths that each model was fitted without; the file's needs no fit.

    Attributes
    ----------
    file : (nv,) array, the file's bodies alone
    with_friction : (nv,) array, the file's bodies with the friction and the motor inertias that fit best
    identified : (nv,) array, the groups
    consistent : (nv,) array, bodies that can exist, at the pull that was chosen
    """

    file: Array
    with_friction: Array
    identified: Array
    consistent: Array


def model_residuals(
    base: BaseParameters,
    folds: Sequence[NormalEquations],
    weak: Prior,
    values: Array,
    sizes: Array,
    strength: float,
) -> ModelResiduals:
    """Predict each fifth from the others by all four.

    Parameters
    ----------
    base : BaseParameters
    folds : sequence of NormalEquations, of fifths of the weighted rows
    weak : Prior, of the groups
    values : (r,) array, of the groups as identified
    sizes : (p,) array, that parameters could have at most
    strength : float, γ of the pull to the file's bodies

    Returns
    -------
    residuals : ModelResiduals
    """
    near = PositivePrior.of(base, values, sizes)
    strengths = (*(s for s in STRENGTHS if s > strength), strength)
    models: tuple[Callable[[tuple[Array, Array, float]], Array], ...] = (
        lambda _: base.project(base.unknown.file_values),
        lambda rest: file_with_drives(base, rest, weak),
        lambda rest: weak.solve(rest[0], rest[1]),
        lambda rest: base.project(PositiveProblem(base, near, *rest, sizes).path(strengths)[-1].values),
    )
    parts = [fold for fold in folds if fold.y.sum() > 0]
    left = np.zeros((len(models), base.unknown.model.nv))
    for k, part in enumerate(parts):
        others = [p.together() for j, p in enumerate(parts) if j != k] or [part.together()]
        rest = sum_of(others)
        left += [part.squares(model(rest)) for model in models]
    torques = np.sum([part.y for part in parts], axis=0)
    return ModelResiduals(*np.sqrt(left / np.where(torques > 0, torques, np.inf)))
