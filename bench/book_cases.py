"""What each function of the book's package is called with, and what is behind ours."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import twistwrench as tw

BATCH = 1000


@dataclass(frozen=True)
class Case:
    function: str
    behind: str
    arguments: tuple[Any, ...]
    varying: tuple[int, ...] = ()
    """Which arguments may be batches; none: the function takes one thing at a time."""

    @property
    def batched(self) -> tuple[Any, ...]:
        if not self.varying:
            return ()
        many = (
            np.stack([np.asarray(a, float)] * BATCH) if i in self.varying else a for i, a in enumerate(self.arguments)
        )
        return tuple(many)


_rng = np.random.default_rng(8)
ur5 = tw.robots.ur5()
s = ur5.screws
LISTS = list(s.Mlist), list(s.Glist), s.Slist
q, dq, ddq = _rng.uniform(0.2, 1.5, (3, 6))
F, g = _rng.standard_normal(6), np.array([0, 0, -9.81])
R, T = tw.so3.exp([0.1, 0.5, 0.3]), tw.se3.exp([0.1, 0.5, 0.3, 1, 2, 3])
W, X = tw.so3.hat([0.1, 0.5, 0.3]), tw.se3.hat([0.1, 0.5, 0.3, 1, 2, 3])
w, V = np.array([0.1, 0.5, 0.3]), np.array([0.1, 0.5, 0.3, 1, 2, 3])
Q, DQ, DDQ = _rng.uniform(0.2, 1.5, (100, 6)), *_rng.standard_normal((2, 100, 6))
FS, TAU = _rng.standard_normal((100, 6)), np.array([ur5.gravity_forces(x) for x in Q])
GOAL = ur5.forward_kinematics(q)
SIMULATED = (q, dq, g, FS[:10], *LISTS, Q[:10], DQ[:10], DDQ[:10], g, *LISTS[:2], 2.0, 1.0, 1.5, 1e-3, 2)
CONTROL = (q, dq, ddq, g, *LISTS, Q[0], DQ[0], DDQ[0], 1.3, 1.2, 1.1)
PUSHED = (q, dq, TAU[:10], g, FS[:10], *LISTS, 1e-3, 2)
BY_LISTS = "a kernel compiled for the lists: "

CASES = (
    Case("NearZero", "`abs(z) < 1e-6`", (1e-7,), (0,)),
    Case("Normalize", "scaled by the largest entry first", (w,), (0,)),
    Case("RotInv", "a transposed copy", (R,), (0,)),
    Case("VecToso3", "`so3.hat`", (w,), (0,)),
    Case("so3ToVec", "`so3.vee`", (W,), (0,)),
    Case("AxisAng3", "length and direction", (w,), (0,)),
    Case("MatrixExp3", "`so3.exp`; one alone in plain floats", (W,), (0,)),
    Case("MatrixLog3", "`so3.log`; one alone in plain floats", (R,), (0,)),
    Case("RpToTrans", "`se3.pose`", (R, w), (0, 1)),
    Case("TransToRp", "two copies", (T,), (0,)),
    Case("TransInv", "`se3.inverse`", (T,), (0,)),
    Case("VecTose3", "`se3.hat`", (V,), (0,)),
    Case("se3ToVec", "`se3.vee`", (X,), (0,)),
    Case("Adjoint", "`tw.Ad(T)` as a matrix", (T,), (0,)),
    Case("ScrewToAxis", "`so3.cross`", (w, np.array([0.0, 0.6, 0.8]), 0.1), (0, 1, 2)),
    Case("AxisAng6", "length and screw", (V,), (0,)),
    Case("MatrixExp6", "`se3.exp`; one alone in plain floats", (X,), (0,)),
    Case("MatrixLog6", "`se3.log`; one alone in plain floats", (T,), (0,)),
    Case("ProjectToSO3", "`so3.project`", (R + 1e-3,), (0,)),
    Case("ProjectToSE3", "`se3.project`", (T + 1e-3,), (0,)),
    Case("DistanceToSO3", "the book's formula", (R + 1e-3,), (0,)),
    Case("DistanceToSE3", "the book's formula", (T + 1e-3,), (0,)),
    Case("TestIfSO3", "the same below 1e-3", (R + 1e-3,), (0,)),
    Case("TestIfSE3", "the same below 1e-3", (T + 1e-3,), (0,)),
    Case("FKinBody", "a kernel compiled for the screws: `forward_kinematics`", (s.M, s.Blist, q), (2,)),
    Case("FKinSpace", "the same kernel", (s.M, s.Slist, q), (2,)),
    Case("JacobianBody", 'a kernel: `jacobian(kind="body")`', (s.Blist, q), (1,)),
    Case("JacobianSpace", 'a kernel: `jacobian(kind="space")`', (s.Slist, q), (1,)),
    Case("IKinBody", "Newton–Raphson on these", (s.Blist, s.M, GOAL, q + 0.1, 1e-3, 1e-3)),
    Case("IKinSpace", "Newton–Raphson on these", (s.Slist, s.M, GOAL, q + 0.1, 1e-3, 1e-3)),
    Case("ad", "`tw.ad(V)` as a matrix", (V,), (0,)),
    Case("InverseDynamics", BY_LISTS + "`inverse_dynamics`, gravity an input", (q, dq, ddq, g, F, *LISTS), (0, 1, 2, 3, 4)),
    Case("MassMatrix", BY_LISTS + "`mass_matrix`", (q, *LISTS), (0,)),
    Case("VelQuadraticForces", BY_LISTS + "`coriolis_forces`", (q, dq, *LISTS), (0, 1)),
    Case("GravityForces", BY_LISTS + "`gravity_forces`, gravity an input", (q, g, *LISTS), (0, 1)),
    Case("EndEffectorForces", BY_LISTS + "`wrench_torques`", (q, F, *LISTS), (0, 1)),
    Case("ForwardDynamics", BY_LISTS + "`forward_dynamics`, M factored", (q, dq, ddq, g, F, *LISTS), (0, 1, 2, 3, 4)),
    Case("EulerStep", "the formula", (q, dq, ddq, 0.01), (0, 1, 2)),
    Case("InverseDynamicsTrajectory", "one call of the kernel (100 rows)", (Q, DQ, DDQ, g, FS, *LISTS)),
    Case("ForwardDynamicsTrajectory", "the kernel, step by step (10 rows, 2 steps)", PUSHED),
    Case("CubicTimeScaling", "the polynomial", (2.0, 0.6), (1,)),
    Case("QuinticTimeScaling", "the polynomial", (2.0, 0.6), (1,)),
    Case("JointTrajectory", "all rows at once (100)", (q, dq, 2.0, 100, 5)),
    Case("ScrewTrajectory", "`se3.exp` of all rows at once (100)", (np.eye(4), T, 2.0, 100, 5)),
    Case("CartesianTrajectory", "`so3.exp` of all rows at once (100)", (np.eye(4), T, 2.0, 100, 5)),
    Case("ComputedTorque", "one call of `inverse_dynamics`", CONTROL, (0, 1, 2, 7, 8, 9)),
    Case("SimulateControl", "the two kernels, step by step (10 rows, 2 steps)", SIMULATED),
)  # fmt: skip
"""In the order of the book."""
