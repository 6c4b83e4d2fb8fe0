"""Functions of the book's own Python package by their names: ``import twistwrench.modern_robotics as mr``.

Names, argument orders and what comes back are those of ``modern_robotics`` 1.1.1 by Lynch, Park, Weng and others. The code is
not: rigid motions run on :mod:`twistwrench.lie`, and whatever takes ``Slist`` or ``Mlist, Glist, Slist`` on kernels compiled
for these lists. The first call with new lists compiles, some tenths of a second; later ones find the kernels by what is in
the lists. Leading batch shapes are welcome wherever a function takes a vector or a matrix, unless its docstring excludes them.

What differs on purpose: tiny rotations and those near π come out right, invalid input is an error of the one tree, and
results are floating-point whatever goes in. ``docs/modern-robotics.md`` lists every function.
"""

from .chains import (
    CartesianTrajectory,
    CubicTimeScaling,
    FKinBody,
    FKinSpace,
    IKinBody,
    IKinSpace,
    JacobianBody,
    JacobianSpace,
    JointTrajectory,
    QuinticTimeScaling,
    ScrewTrajectory,
)
from .dynamics import (
    ComputedTorque,
    EndEffectorForces,
    EulerStep,
    ForwardDynamics,
    ForwardDynamicsTrajectory,
    GravityForces,
    InverseDynamics,
    InverseDynamicsTrajectory,
    MassMatrix,
    SimulateControl,
    VelQuadraticForces,
)
from .matrices import (
    Adjoint,
    AxisAng3,
    AxisAng6,
    DistanceToSE3,
    DistanceToSO3,
    MatrixExp3,
    MatrixExp6,
    MatrixLog3,
    MatrixLog6,
    NearZero,
    Normalize,
    ProjectToSE3,
    ProjectToSO3,
    RotInv,
    RpToTrans,
    ScrewToAxis,
    TestIfSE3,
    TestIfSO3,
    TransInv,
    TransToRp,
    VecTose3,
    VecToso3,
    ad,
    se3ToVec,
    so3ToVec,
)

__all__ = [
    "Adjoint", "AxisAng3", "AxisAng6", "CartesianTrajectory", "ComputedTorque", "CubicTimeScaling", "DistanceToSE3",
    "DistanceToSO3", "EndEffectorForces", "EulerStep", "FKinBody", "FKinSpace", "ForwardDynamics",
    "ForwardDynamicsTrajectory", "GravityForces", "IKinBody", "IKinSpace", "InverseDynamics",
    "InverseDynamicsTrajectory", "JacobianBody", "JacobianSpace", "JointTrajectory", "MassMatrix", "MatrixExp3",
    "MatrixExp6", "MatrixLog3", "MatrixLog6", "NearZero", "Normalize", "ProjectToSE3", "ProjectToSO3",
    "QuinticTimeScaling", "RotInv", "RpToTrans", "ScrewToAxis", "ScrewTrajectory", "SimulateControl", "TestIfSE3",
    "TestIfSO3", "TransInv", "TransToRp", "VecTose3", "VecToso3", "VelQuadraticForces", "ad", "se3ToVec", "so3ToVec",
]  # fmt: skip
