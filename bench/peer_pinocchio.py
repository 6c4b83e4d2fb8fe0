"""Pinocchio called from Python, as its wheel ships it: the reference for every number, and a contender."""

import numpy as np
import pinocchio as pin

from bench.cases import MATRICES, Case, States
from bench.timing import Contender, calls

NAME = "Pinocchio, Python call"


class Pinocchio:
    """One robot in Pinocchio."""

    def __init__(self, case: Case) -> None:
        self.model = case.model
        self.data = self.model.createData()
        tip = self.model.getFrameId(case.tip, pin.BODY)
        self.functions = {
            "inverse_dynamics": (pin.rnea, ()),
            "mass_matrix": (pin.crba, ()),
            "forward_dynamics": (pin.aba, ()),
            "jacobian": (pin.computeFrameJacobian, (tip, pin.LOCAL)),
            "gravity_forces": (pin.computeGeneralizedGravity, ()),
            "inverse_dynamics_derivatives": (pin.computeRNEADerivatives, ()),
            "forward_dynamics_derivatives": (pin.computeABADerivatives, ()),
        }

    def evaluate(self, quantity: str, states: States) -> np.ndarray:
        function, more = self.functions[quantity]
        rows = zip(*states.inputs(quantity), strict=True)
        values = np.array([_copied(function(self.model, self.data, *row, *more), quantity) for row in rows])
        return completed(quantity, values)

    def contenders(self, quantity: str, states: States) -> list[Contender]:
        """The call a user writes, model and data at hand: `pin.rnea(model, data, q, dq, ddq)`."""
        function, more = self.functions[quantity]
        rows = zip(*states[:256].inputs(quantity), strict=True)
        return [calls(NAME, function, [(self.model, self.data, *row, *more) for row in rows])]


def _copied(result: np.ndarray | tuple[np.ndarray, ...], quantity: str) -> np.ndarray:
    """What was asked for, before the next call overwrites it; with the derivatives of torques comes a mass matrix."""
    return np.array(result[: MATRICES[quantity]] if isinstance(result, tuple) else result)


def completed(quantity: str, values: np.ndarray) -> np.ndarray:
    """Whole matrices where Pinocchio fills a triangle: the mass matrix, and its inverse, the last of three."""
    if quantity == "mass_matrix":
        return symmetric(values)
    if quantity == "forward_dynamics_derivatives":
        return np.concatenate([values[:, :2], symmetric(values[:, 2:])], axis=1)
    return values


def symmetric(values: np.ndarray) -> np.ndarray:
    """A full matrix from its upper triangle, which is all that Pinocchio promises to fill."""
    return np.triu(values) + np.swapaxes(np.triu(values, 1), -1, -2)
