"""The book's own package, `modern_robotics`: serial chains only, called from Python."""

from collections.abc import Callable

import modern_robotics as mr
import numpy as np
import pinocchio as pin

from bench.cases import Case, States
from bench.timing import Contender, calls

NAME = "modern_robotics, Python call"
AXES = {"JointModelRX": (1, 0, 0), "JointModelRY": (0, 1, 0), "JointModelRZ": (0, 0, 1)}


class Book:
    """One serial chain, its link frames at the joints, its inertias full 6 x 6 matrices."""

    def __init__(self, case: Case) -> None:
        model = case.model
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        frame = model.frames[model.getFrameId(case.tip, pin.BODY)]
        M = (data.oMi[frame.parentJoint] * frame.placement).homogeneous
        self.Mlist = np.array(
            [*(each.homogeneous for each in list(model.jointPlacements)[1:]), frame.placement.homogeneous]
        )
        self.Glist = np.array([_angular_first(body.matrix()) for body in list(model.inertias)[1:]])
        local = [np.array([*AXES[joint.shortname()], 0, 0, 0], float) for joint in list(model.joints)[1:]]
        poses = [each.homogeneous for each in list(data.oMi)[1:]]
        self.Slist = np.array([mr.Adjoint(T) @ S for T, S in zip(poses, local, strict=True)]).T
        self.Blist = mr.Adjoint(mr.TransInv(M)) @ self.Slist
        self.gravity = np.array([0, 0, -9.81])

    def function(self, quantity: str) -> Callable[..., np.ndarray]:
        g, none, arm = self.gravity, np.zeros(6), (self.Mlist, self.Glist, self.Slist)
        return {
            "inverse_dynamics": lambda q, dq, ddq: mr.InverseDynamics(q, dq, ddq, g, none, *arm),
            "mass_matrix": lambda q: mr.MassMatrix(q, *arm),
            "forward_dynamics": lambda q, dq, tau: mr.ForwardDynamics(q, dq, tau, g, none, *arm),
            "jacobian": lambda q: mr.JacobianBody(self.Blist, q),
            "gravity_forces": lambda q: mr.GravityForces(q, g, *arm),
        }[quantity]

    def evaluate(self, quantity: str, states: States) -> np.ndarray:
        function = self.function(quantity)
        values = np.array([function(*row) for row in zip(*states.inputs(quantity), strict=True)])
        return values[:, [3, 4, 5, 0, 1, 2]] if quantity == "jacobian" else values

    def contenders(self, quantity: str, states: States) -> list[Contender]:
        return [calls(NAME, self.function(quantity), list(zip(*states[:1].inputs(quantity), strict=True)))]


def _angular_first(matrix: np.ndarray) -> np.ndarray:
    order = [3, 4, 5, 0, 1, 2]
    return matrix[np.ix_(order, order)]
