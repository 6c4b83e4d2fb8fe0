"""Functions of the book's own Python package by their names: ``import twistwrench.modern_robotics as mr``.

Names, argument orders and results are those of ``modern_robotics`` 1.1.1 by Lynch, Park, Weng and others. The implementation
differs: rigid motions use :mod:`twistwrench.mechanics.lie`; functions of ``Slist`` or ``Mlist, Glist, Slist`` use compiled
kernels. The first call with new lists compiles for some tenths of a second; later calls use kernels cached by the lists'
content. Functions of vectors or matrices accept leading batch shapes, unless their docstring excludes them.

Intended differences: rotations near zero and π are accurate, invalid input raises errors of :mod:`twistwrench.core.errors`,
and results are always floating-point. ``docs/modern-robotics.md`` lists every function.

A declaration under :func:`.named` or :func:`.of_chain` is a row of a table; :mod:`.names` describes them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import MissingExtraError, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array, JointTorques, Poses, Rotations, Twists
from ..mechanics.algorithms.time_scalings import PosePath, cubic_share, quintic_share
from ..mechanics.lie import se3, so3
from ..mechanics.lie.adjoint import Ad
from .chains import Chain, chain_of, screws_of
from .checks import pose, real, rotation, skew, twist_matrix
from .names import named, of_chain

__all__ = [
    "Adjoint", "AxisAng3", "AxisAng6", "CartesianTrajectory", "ComputedTorque", "CubicTimeScaling", "DistanceToSE3",
    "DistanceToSO3", "EndEffectorForces", "EulerStep", "FKinBody", "FKinSpace", "ForwardDynamics", "ForwardDynamicsTrajectory",
    "GravityForces", "IKinBody", "IKinSpace", "InverseDynamics", "InverseDynamicsTrajectory", "JacobianBody", "JacobianSpace",
    "JointTrajectory", "MassMatrix", "MatrixExp3", "MatrixExp6", "MatrixLog3", "MatrixLog6", "NearZero", "Normalize",
    "ProjectToSE3", "ProjectToSO3", "QuinticTimeScaling", "RotInv", "RpToTrans", "ScrewToAxis", "ScrewTrajectory",
    "SimulateControl", "TestIfSE3", "TestIfSO3", "TransInv", "TransToRp", "VecTose3", "VecToso3", "VelQuadraticForces", "ad",
    "se3ToVec", "so3ToVec",
]  # fmt: skip

DISTANCE_OF_MIRRORED = 1e9
"""Distance returned for a matrix with non-positive determinant."""
MAX_NEWTON_STEPS = 20
"""Maximum number of Newton steps of inverse kinematics, as in the book's package."""
_NEGLIGIBLE_SHARE = 1e-3
"""Largest entry of a half turn's logarithm, divided by π, that does not decide its sign."""


@named(lambda R: np.swapaxes(R, -1, -2).copy(), "section 3.2.1", "", real(3, 3))
def RotInv(R: ArrayLike) -> Rotations:
    """Inverse of a rotation, its transpose R'."""


@named(so3.hat, "eq. 3.30", "so3mat : (..., 3, 3) array", real(3))
def VecToso3(omg: ArrayLike) -> Array:
    """Skew-symmetric matrix [omg] of a vector."""


@named(so3.vee, "eq. 3.30", "omg : (..., 3) array", skew)
def so3ToVec(so3mat: ArrayLike) -> Array:
    """Vector of a skew-symmetric matrix."""


def AxisAng3(expc3: ArrayLike) -> tuple[Array, Any]:
    """Axis and angle of exponential coordinates of a rotation; both zero for the zero rotation (MR section 3.2.3.3).

    Returns
    -------
    omghat : (..., 3) array, unit axis
    theta : (...) array, angle [rad]
    """
    w = arguments.real(expc3, "expc3", 3)
    theta = _length(w)
    return _unit(w, theta), theta


@named(lambda W: so3.exp(so3.vee(W)), "eq. 3.51", "", skew)
def MatrixExp3(so3mat: ArrayLike) -> Rotations:
    """Matrix exponential of so(3): the rotation exp([omg] theta), at every angle."""


def _signed_log(R: Array, w: Array) -> Array:
    """Logarithm w of R; for a half turn, w or -w: the one whose last non-negligible entry is positive.

    A half turn has two logarithms; the book's package takes this one.
    """
    if w.ndim == 1 and R[0, 1] != R[1, 0]:  # not a half turn; spares a single rotation the test below
        return w
    # Only half turns and the identity are symmetric; |w| is π or 0, so any threshold between tells them apart.
    is_symmetric = np.all(np.swapaxes(R, -1, -2) == R, axis=(-1, -2))
    is_half_turn = is_symmetric & (np.sum(w * w, axis=-1) > 1.0)
    if np.any(is_half_turn):
        not_negligible = np.abs(w) > _NEGLIGIBLE_SHARE * np.pi
        x, y, z = np.moveaxis(np.where(not_negligible, w, 0.0), -1, 0)
        last_of_two = np.where(y != 0, y, x)
        last_entry = np.where(z != 0, z, last_of_two)
        w = np.where((is_half_turn & (last_entry < 0))[..., None], -w, w)
    return w


@named(lambda R: so3.hat(_signed_log(R, so3.log(R))), "eq. 3.53, 3.54", "so3mat : (..., 3, 3) array [rad]", rotation)
def MatrixLog3(R: ArrayLike) -> Array:
    """Matrix logarithm of SO(3): [omg] theta with 0 ≤ theta ≤ π; R with few digits is replaced by the nearest rotation."""


@named(se3.pose, "section 3.3.1", "", real(3, 3), real(3))
def RpToTrans(R: ArrayLike, p: ArrayLike) -> Poses:
    """Homogeneous matrix of a rotation and a position."""


def TransToRp(T: ArrayLike) -> tuple[Array, Array]:
    """Rotation and position of a homogeneous matrix (MR section 3.3.1).

    Returns
    -------
    R : (..., 3, 3) array
    p : (..., 3) array [m]
    """
    T = arguments.real(T, "T", 4, 4)
    return T[..., :3, :3].copy(), T[..., :3, 3].copy()


def _inverse(T: Array) -> Array:
    """Inverse of poses (..., 4, 4)."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return se3.pose(Rt, -(Rt @ T[..., :3, 3, None])[..., 0])


@named(_inverse, "eq. 3.64", "", pose)
def TransInv(T: ArrayLike) -> Poses:
    """Inverse of a pose, by transposing the rotation; T with few digits is replaced by the nearest pose."""


@named(se3.hat, "eq. 3.71", "se3mat : (..., 4, 4) array", real(6))
def VecTose3(V: ArrayLike) -> Array:
    """Matrix [V] of a twist."""


@named(se3.vee, "eq. 3.71", "", twist_matrix)
def se3ToVec(se3mat: ArrayLike) -> Twists:
    """Twist (omega, v) of a matrix [V]."""


def _adjoint(T: Array) -> Array:
    """Adjoint matrices (..., 6, 6) of poses."""
    R = T[..., :3, :3]
    return _blocks(R, so3.hat(T[..., :3, 3]) @ R)


def _blocks(diagonal: Array, below: Array) -> Array:
    """Matrix (..., 6, 6) with the block ``diagonal`` twice and the block ``below`` under it: [D, 0; B, D]."""
    matrix = np.zeros((*diagonal.shape[:-2], 6, 6), diagonal.dtype)
    matrix[..., :3, :3] = diagonal
    matrix[..., 3:, 3:] = diagonal
    matrix[..., 3:, :3] = below
    return matrix


@named(_adjoint, "eq. 3.83", "AdT : (..., 6, 6) array", real(4, 4))
def Adjoint(T: ArrayLike) -> Array:
    """Adjoint matrix of a pose, [Ad_T] = [R, 0; [p] R, R]; ``tw.Ad(T)`` applies it without forming it."""


def _bracket_matrix(V: Array) -> Array:
    """Matrices (..., 6, 6) of the Lie bracket with twists."""
    return _blocks(so3.hat(V[..., :3]), so3.hat(V[..., 3:]))


@named(_bracket_matrix, "definition 8.5", "adV : (..., 6, 6) array", real(6))
def ad(V: ArrayLike) -> Array:
    """Matrix of the Lie bracket with a twist, [ad_V] = [[omega], 0; [v], [omega]]."""


def ScrewToAxis(q: ArrayLike, s: ArrayLike, h: ArrayLike) -> Twists:
    """Screw axis (s, q × s + h s) through a point along a unit vector, which is not normalised (MR section 3.3.2.2).

    Parameters
    ----------
    q : (..., 3) array_like, point on the axis [m]
    s : (..., 3) array_like, unit vector along it
    h : (...) array_like, pitch [m/rad]

    Returns
    -------
    S : (..., 6) array
    """
    q, s, h = arguments.real(q, "q", 3), arguments.real(s, "s", 3), arguments.real(h, "h")
    if h.ndim or q.shape != s.shape:  # batches; a scalar pitch fits any vectors of one shape
        q, s, h = arguments.together(q=q, s=s, h=h[..., None])
    return np.concatenate([s, so3.cross(q, s) + h * s], axis=-1)


def AxisAng6(expc6: ArrayLike) -> tuple[Array, Any]:
    """Screw axis and distance along it of exponential coordinates S theta (MR eq. 3.87).

    The angular part of S has unit length, or, if it is zero, the linear part. Zero input gives a zero axis.

    Returns
    -------
    S : (..., 6) array, screw axis
    theta : (...) array, distance along it [rad, or m if the angular part of S is zero]
    """
    V = arguments.real(expc6, "expc6", 6)
    angle = _length(V[..., :3])
    theta = np.where(angle > 0, angle, _length(V[..., 3:]))[()]  # [()]: a scalar for a single vector
    return _unit(V, theta), theta


def _length(v: Array) -> Any:
    """Norm |v| without underflow or overflow of the squares; (..., n) → (...)."""
    if v.ndim == 1:
        return v.dtype.type(math.hypot(*v.tolist()))
    largest_entry = np.abs(v).max(axis=-1, keepdims=True)
    scale = np.where(largest_entry > 0, largest_entry, 1.0)
    return (scale[..., 0] * np.linalg.norm(v / scale, axis=-1))[()]


def _unit(v: Array, theta: Any) -> Array:
    """v / theta; a zero vector, whose theta is 0, stays zero."""
    return np.asarray(v / np.where(theta > 0, theta, 1.0)[..., None])


@named(lambda X: se3.exp(se3.vee(X)), "eq. 3.88", "", twist_matrix)
def MatrixExp6(se3mat: ArrayLike) -> Poses:
    """Matrix exponential of se(3): the pose exp([S] theta), at every angle."""


def _twist(T: Array) -> Array:
    """Logarithm V of a pose T; that of a half turn has the sign of :func:`_signed_log`."""
    V = se3.log(T)
    w_of_log = V[..., :3]
    w = _signed_log(T[..., :3, :3], w_of_log)
    if w is not w_of_log:
        v = (so3.left_jacobian_inverse(w) @ T[..., :3, 3, None])[..., 0]
        V = np.concatenate([w, v], axis=-1)
    return V


@named(lambda T: se3.hat(_twist(T)), "eq. 3.91, 3.92", "se3mat : (..., 4, 4) array", pose)
def MatrixLog6(T: ArrayLike) -> Array:
    """Matrix logarithm of SE(3): [S] theta with 0 ≤ theta ≤ π; T with few digits is replaced by the nearest pose."""


def NearZero(z: ArrayLike) -> Any:
    """True if a number is near zero: |z| < 1e-6, a threshold that this package does not use (MR section 3.2).

    Parameters
    ----------
    z : (...) array_like

    Returns
    -------
    near : (...) array of bool
    """
    return abs(z) < 1e-6 if type(z) is float else np.abs(arguments.real(z, "z")) < 1e-6  # slower for a single number


def Normalize(V: ArrayLike) -> Array:
    """Unit vector V / |V| (MR section 3.2).

    Parameters
    ----------
    V : (..., n) array_like

    Returns
    -------
    unit : (..., n) array
    """
    V = np.atleast_1d(arguments.real(V, "V"))
    if V.ndim == 1:
        length = math.hypot(*V.tolist())
        if 0.0 < length < math.inf:
            return V / V.dtype.type(length)
    largest_entry = np.abs(V).max(axis=-1, keepdims=True, initial=0.0)
    if not np.all(largest_entry > 0):  # also for NaN
        raise ValueRangeError("V is zero, or not a number, so it has no direction. Give a vector with a nonzero entry.")
    V = V / largest_entry  # scale first, to avoid underflow and overflow of the squares
    return np.asarray(V / np.linalg.norm(V, axis=-1, keepdims=True))


@named(lambda R: so3.project(R, np.inf), "section 3.2", "", real(3, 3))
def ProjectToSO3(mat: ArrayLike) -> Rotations:
    """Nearest rotation to a matrix in the Frobenius norm, at any distance."""


def _nearest_pose(T: Array) -> Array:
    """Nearest poses to matrices (..., 4, 4)."""
    return se3.pose(so3.project(T[..., :3, :3], np.inf), T[..., :3, 3])


@named(_nearest_pose, "section 3.3", "", real(4, 4))
def ProjectToSE3(mat: ArrayLike) -> Poses:
    """Nearest pose to a matrix: the nearest rotation, the unchanged position, and the last row replaced."""


def _distance(R: Array, last_row_error: Array | None = None) -> Any:
    """Frobenius norm of R'R - 1; for a pose, with the error (..., 4) of its last row. Mirrored: DISTANCE_OF_MIRRORED."""
    error = np.swapaxes(R, -1, -2) @ R - np.eye(3)
    square = np.sum(error * error, axis=(-1, -2))
    if last_row_error is not None:
        square = square + np.sum(last_row_error * last_row_error, axis=-1)
    return np.where(np.linalg.det(R) > 0, np.sqrt(square), DISTANCE_OF_MIRRORED)[()]


def _pose_distance(T: Array) -> Any:
    """Distances (...) of matrices (..., 4, 4) to SE(3)."""
    last_row_error = T[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0])
    return _distance(T[..., :3, :3], last_row_error)


@named(_distance, "section 3.2", "distance : (...) array, 1e9 if the determinant is not positive", real(3, 3))
def DistanceToSO3(mat: ArrayLike) -> Any:
    """Distance of a 3×3 matrix to SO(3): |mat' mat - 1| in the Frobenius norm."""


@named(_pose_distance, "section 3.3", "distance : (...) array, 1e9 if the determinant is not positive", real(4, 4))
def DistanceToSE3(mat: ArrayLike) -> Any:
    """Distance of a 4×4 matrix to SE(3): distance of its upper left block to SO(3), with the error of the last row."""


@named(lambda R: _distance(R) < 1e-3, "section 3.2", "answer : (...) array of bool", real(3, 3))
def TestIfSO3(mat: ArrayLike) -> Any:
    """True if a matrix is a rotation: distance to SO(3) below 1e-3."""


@named(lambda T: _pose_distance(T) < 1e-3, "section 3.3", "answer : (...) array of bool", real(4, 4))
def TestIfSE3(mat: ArrayLike) -> Any:
    """True if a matrix is a pose: distance to SE(3) below 1e-3."""


def FKinBody(M: ArrayLike, Blist: ArrayLike, thetalist: ArrayLike) -> Poses:
    """Forward kinematics by body screws: M exp([B1] theta1) … exp([Bn] thetan), the end-effector's pose (MR eq. 4.16).

    Returns
    -------
    T : (..., 4, 4) array
    """
    chain = screws_of(Blist, "Blist")
    return arguments.one(M, "M", 4, 4) @ chain.run("pose", thetalist=chain.joints(thetalist, "thetalist"))


def FKinSpace(M: ArrayLike, Slist: ArrayLike, thetalist: ArrayLike) -> Poses:
    """Forward kinematics by space screws: exp([S1] theta1) … exp([Sn] thetan) M, the end-effector's pose (MR eq. 4.14).

    Returns
    -------
    T : (..., 4, 4) array
    """
    chain = screws_of(Slist, "Slist")
    return chain.run("pose", thetalist=chain.joints(thetalist, "thetalist")) @ arguments.one(M, "M", 4, 4)


@of_chain("body_jacobian", "eq. 5.18", "J : (..., 6, n) array, angular rows first")
def JacobianBody(Blist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Body Jacobian J_b with V_b = J_b dtheta, in the end-effector's frame."""


@of_chain("space_jacobian", "eq. 5.11", "J : (..., 6, n) array, angular rows first")
def JacobianSpace(Slist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Space Jacobian J_s with V_s = J_s dtheta, in the space frame."""


def IKinBody(
    Blist: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Inverse kinematics by body screws: Newton–Raphson with the pseudoinverse, 20 steps at most (MR section 6.2.2).

    Returns
    -------
    thetalist : (n,) array
    success : bool, True if they reach the pose
    """
    return _newton("IKinBody", Blist, M, T, thetalist0, eomg, ev)


def IKinSpace(
    Slist: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Inverse kinematics by space screws, otherwise as :func:`IKinBody` (MR section 6.2.2).

    Returns
    -------
    thetalist : (n,) array
    success : bool, True if they reach the pose
    """
    return _newton("IKinSpace", Slist, M, T, thetalist0, eomg, ev)


def _newton(
    caller: str, screws: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Iterate theta := theta + J⁺ V until the twist error V, in the frame of the screws, is small."""
    in_space = caller == "IKinSpace"
    chain = screws_of(screws, "Slist" if in_space else "Blist")
    jacobian = chain.kernel("space_jacobian" if in_space else "body_jacobian")
    product_of_exponentials = chain.kernel("pose")
    M, T = _finite_pose(M, f"{caller}: M"), _finite_pose(T, f"{caller}: T")
    start_name = f"{caller}: thetalist0"
    theta = arguments.finite(arguments.one(thetalist0, start_name, chain.n), start_name, chain.n)
    eomg, ev = _error_bound(eomg, f"{caller}: eomg"), _error_bound(ev, f"{caller}: ev")

    def twist_error(theta: Array) -> Array:
        if in_space:
            T_sb = product_of_exponentials(theta) @ M
            return Ad(T_sb) @ _twist(se3.inverse(T_sb) @ T)
        T_sb = M @ product_of_exponentials(theta)
        return _twist(se3.inverse(T_sb) @ T)

    def is_small(V: Array) -> bool:
        return bool(np.linalg.norm(V[:3]) <= eomg and np.linalg.norm(V[3:]) <= ev)

    V = twist_error(theta)
    for _ in range(MAX_NEWTON_STEPS):
        if is_small(V):
            break
        theta = theta + np.linalg.pinv(jacobian(theta)) @ V
        V = twist_error(theta)
    return theta, is_small(V)


def _finite_pose(T: ArrayLike, name: str) -> Array:
    """One pose (4, 4) of finite numbers; raises an error that names the argument."""
    matrix = arguments.one(T, name, 4, 4)
    return pose(arguments.finite(matrix, name, 4, 4), name)


def _error_bound(value: float, name: str) -> float:
    """Largest allowed error of inverse kinematics, 0 or more; raises ValueRangeError that names the argument."""
    bound = arguments.number(value, name)
    if not bound >= 0:  # also for NaN
        raise ValueRangeError(f"{name} is {value!r}: what may be left is 0 or more, such as 1e-6.")
    return bound


@of_chain("inverse_dynamics", "eq. 8.50 to 8.54", "")
def InverseDynamics(
    thetalist: ArrayLike, dthetalist: ArrayLike, ddthetalist: ArrayLike, g: ArrayLike, Ftip: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
) -> JointTorques:  # fmt: skip
    """Inverse dynamics: joint torques τ = M ddtheta + c + g(theta) + J' F_tip."""


@of_chain("mass_matrix", "eq. 8.57", "M : (..., n, n) array [kg m², sliding joints: kg]")
def MassMatrix(thetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Array:
    """Mass matrix M(theta), exactly symmetric, by composite inertias."""


@of_chain("coriolis_forces", "eq. 8.9, 8.10", "")
def VelQuadraticForces(
    thetalist: ArrayLike, dthetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> JointTorques:
    """Coriolis and centripetal forces c(theta, dtheta)."""


@of_chain("gravity_forces", "section 8.3", "")
def GravityForces(
    thetalist: ArrayLike, g: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> JointTorques:
    """Gravity forces g(theta), the torques that hold the chain against gravity."""


@of_chain("wrench_torques", "eq. 5.26", "")
def EndEffectorForces(
    thetalist: ArrayLike, Ftip: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> JointTorques:
    """Joint torques J_b' F_tip of the wrench applied by the end-effector, without other terms."""


@of_chain("forward_dynamics", "section 8.5", "ddtheta : (..., n) array, joint accelerations")
def ForwardDynamics(
    thetalist: ArrayLike, dthetalist: ArrayLike, taulist: ArrayLike, g: ArrayLike, Ftip: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
) -> Array:  # fmt: skip
    """Forward dynamics: ddtheta that solves M ddtheta = τ - c - g(theta) - J' F_tip, M factored."""


def EulerStep(
    thetalist: ArrayLike, dthetalist: ArrayLike, ddthetalist: ArrayLike, dt: ArrayLike
) -> tuple[Array, Array]:
    """Euler integration step: theta + dt dtheta and dtheta + dt ddtheta (MR section 8.5).

    Returns
    -------
    theta : (..., n) array
    dtheta : (..., n) array
    """
    q, dq = arguments.real(thetalist, "thetalist"), arguments.real(dthetalist, "dthetalist")
    ddq, step = arguments.real(ddthetalist, "ddthetalist"), arguments.real(dt, "dt")
    if step.ndim:  # a step for each state, which must match all its joints
        step = step[..., None]
    try:
        return q + step * dq, dq + step * ddq
    except ValueError:
        raise arguments.mismatch(thetalist=q, dthetalist=dq, ddthetalist=ddq, dt=step) from None


def InverseDynamicsTrajectory(
    thetamat: ArrayLike, dthetamat: ArrayLike, ddthetamat: ArrayLike, g: ArrayLike, Ftipmat: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
) -> Array:  # fmt: skip
    """Inverse dynamics along a motion, all rows in one call: the torques of :func:`InverseDynamics` (MR eq. 8.50 to 8.54).

    Returns
    -------
    taumat : (N, n) array [N m, sliding joints: N]
    """
    chain = chain_of(Mlist, Glist, Slist)
    motion = _motion_matrices(chain, thetamat=thetamat, dthetamat=dthetamat, ddthetamat=ddthetamat)
    F = _tip_wrenches(Ftipmat, len(motion["thetamat"]))
    gravity = arguments.real(g, "g", 3)
    return chain.run("inverse_dynamics", **motion, Ftipmat=F, g=gravity)


def ForwardDynamicsTrajectory(
    thetalist: ArrayLike, dthetalist: ArrayLike, taumat: ArrayLike, g: ArrayLike, Ftipmat: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike, dt: float, intRes: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Forward dynamics along rows of torques, each held for ``dt``, by Euler steps; one motion per call (MR section 8.5).

    Parameters
    ----------
    taumat : (N, n) array_like, torques [N m, sliding joints: N]; the last row is not used

    Returns
    -------
    thetamat : (N, n) array, joint angles; the first row is the initial state
    dthetamat : (N, n) array, joint rates
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, dq = _initial_state(chain, thetalist, dthetalist)
    tau = _joint_rows(chain, taumat, "taumat")
    gravity = arguments.one(g, "g", 3)
    dt = arguments.number(dt, "dt")
    F = _tip_wrenches(Ftipmat, len(tau))
    steps = arguments.whole(intRes, "intRes")
    thetamat, dthetamat = np.empty(tau.shape), np.empty(tau.shape)
    thetamat[0], dthetamat[0] = q, dq
    for i in range(len(tau) - 1):
        q, dq = _euler_steps(chain, q, dq, tau[i], gravity, F[i], dt, steps)
        thetamat[i + 1], dthetamat[i + 1] = q, dq
    return thetamat, dthetamat


def _euler_steps(
    chain: Chain, q: Array, dq: Array, tau: Array, g: Array, F: Array, dt: float, steps: int
) -> tuple[Array, Array]:
    """State after ``steps`` Euler steps over the total time dt, under constant torques."""
    step = dt / steps
    for _ in range(steps):
        ddq = chain.kernel("forward_dynamics")(q, dq, tau, F, g)
        q, dq = q + step * dq, dq + step * ddq
    return q, dq


def _initial_state(chain: Chain, thetalist: ArrayLike, dthetalist: ArrayLike) -> tuple[Array, Array]:
    """Initial state of a simulation: one state, real numbers."""
    q, dq = chain.joints(thetalist, "thetalist"), chain.joints(dthetalist, "dthetalist")
    for vector, name in ((q, "thetalist"), (dq, "dthetalist")):
        if vector.ndim != 1:
            raise ShapeError(f"{name} has shape {vector.shape}: a simulation starts from one state, ({chain.n},).")
    return q.astype(float), dq.astype(float)


def _joint_rows(chain: Chain, matrix: ArrayLike, name: str) -> Array:
    """Matrix with a row per time and a column per joint; (N, n)."""
    rows = chain.joints(matrix, name)
    if rows.ndim != 2 or len(rows) == 0:
        raise ShapeError(f"{name} has shape {rows.shape}, expected (N, {chain.n}): a row for each instant.")
    return rows


def _motion_matrices(chain: Chain, **matrices: ArrayLike) -> dict[str, Array]:
    """Matrices of one motion with equal numbers of rows."""
    rows_by_name = {name: _joint_rows(chain, matrix, name) for name, matrix in matrices.items()}
    row_counts = {len(rows) for rows in rows_by_name.values()}
    if len(row_counts) > 1:
        shapes = ", ".join(f"{name} {rows.shape}" for name, rows in rows_by_name.items())
        raise ShapeError(f"the matrices of one motion need as many rows as each other: {shapes}.")
    return rows_by_name


def _tip_wrenches(Ftipmat: ArrayLike, N: int) -> Array:
    """Wrench of each row, (N, 6); a plain 0 means zeros, as documented in the book's package."""
    F = arguments.real(Ftipmat, "Ftipmat")
    if F.ndim == 0 and F == 0:
        return np.zeros((N, 6))
    if F.shape != (N, 6):
        raise ShapeError(
            f"Ftipmat has shape {F.shape}, expected ({N}, 6): a wrench (m, f) for each row, or 0 for none."
        )
    return F


def CubicTimeScaling(Tf: float, t: ArrayLike) -> Any:
    """Cubic time scaling s(t) = 3 (t/Tf)² - 2 (t/Tf)³, from rest to rest (MR eq. 9.10).

    Returns
    -------
    s : (...) array
    """
    return cubic_share(_time_fraction(Tf, t))


def QuinticTimeScaling(Tf: float, t: ArrayLike) -> Any:
    """Quintic time scaling s(t) = 10 (t/Tf)³ - 15 (t/Tf)⁴ + 6 (t/Tf)⁵, accelerations zero at both ends too (MR section 9.2.1).

    Returns
    -------
    s : (...) array
    """
    return quintic_share(_time_fraction(Tf, t))


def _time_fraction(Tf: Any, t: Any) -> Any:
    """t / Tf, with Tf above 0."""
    if type(t) is float and type(Tf) in (float, int) and Tf > 0:  # NumPy is ten times slower for a single number
        return t / Tf
    duration, instants = arguments.together(Tf=arguments.real(Tf, "Tf"), t=arguments.real(t, "t"))
    if not np.all(duration > 0):
        raise ValueRangeError(f"Tf is {Tf!r}: a motion takes more than no time.")
    return (instants / duration)[()]


def JointTrajectory(thetastart: ArrayLike, thetaend: ArrayLike, Tf: float, N: float, method: int) -> Array:
    """Joint trajectory: points on the straight line between two joint vectors, equally spaced in time (MR section 9.2).

    Returns
    -------
    trajectory : (N, n) array
    """
    start, end = arguments.real(thetastart, "thetastart"), arguments.real(thetaend, "thetaend")
    if start.ndim != 1 or start.shape != end.shape:
        raise ShapeError(f"thetastart {start.shape}, thetaend {end.shape}: expected two vectors of the same length.")
    s = _path_parameters(Tf, N, method)[:, None]
    return np.asarray(s * end + (1.0 - s) * start)


def ScrewTrajectory(Xstart: ArrayLike, Xend: ArrayLike, Tf: float, N: float, method: int) -> list[Array]:
    """Screw trajectory: poses along the constant screw from one pose to another (MR eq. 9.23).

    Returns
    -------
    poses : list of N (4, 4) arrays
    """
    start, end = _end_poses(Xstart, Xend)
    V = _twist(se3.inverse(start) @ end)
    path = PosePath(start, end, straight=False, twist=V)
    return list(path(_path_parameters(Tf, N, method)))


def CartesianTrajectory(Xstart: ArrayLike, Xend: ArrayLike, Tf: float, N: float, method: int) -> list[Array]:
    """Cartesian trajectory: origin on a straight line, rotation about a constant axis (MR eq. 9.24, 9.25).

    Returns
    -------
    poses : list of N (4, 4) arrays
    """
    start, end = _end_poses(Xstart, Xend)
    rotation_from_start = np.swapaxes(start[:3, :3], -1, -2) @ end[:3, :3]
    rotation_twist = _twist(se3.pose(rotation_from_start, np.zeros(3)))
    twist = np.concatenate([rotation_twist[:3], end[:3, 3] - start[:3, 3]])
    path = PosePath(start, end, straight=True, twist=twist)
    return list(path(_path_parameters(Tf, N, method)))


def _end_poses(Xstart: ArrayLike, Xend: ArrayLike) -> tuple[Array, Array]:
    """First and last pose (4, 4) of a trajectory; raises ShapeError for more than one of each."""
    start, end = pose(Xstart, "Xstart"), pose(Xend, "Xend")
    if start.shape != (4, 4) or end.shape != (4, 4):
        raise ShapeError(f"Xstart has shape {start.shape}, Xend {end.shape}: expected two poses, (4, 4).")
    return start, end


def _path_parameters(Tf: float, N: float, method: int) -> Array:
    """Path parameter s at N equally spaced times from 0 to Tf, exact at both ends."""
    n = arguments.whole(N, "N", 2)
    scalings = {3: cubic_share, 5: quintic_share}
    if method not in tuple(scalings):  # a tuple, since input that cannot be hashed is refused too
        raise ValueRangeError(f"method is {method!r}; choose 3, cubic, or 5, quintic time scaling.")
    _time_fraction(arguments.number(Tf, "Tf"), 0.0)  # raises unless Tf is above 0; its size does not change s
    return np.asarray(scalings[method](np.arange(n) / (n - 1.0)))


def ComputedTorque(
    thetalist: ArrayLike, dthetalist: ArrayLike, eint: ArrayLike, g: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
    thetalistd: ArrayLike, dthetalistd: ArrayLike, ddthetalistd: ArrayLike, Kp: ArrayLike, Ki: ArrayLike, Kd: ArrayLike,
) -> JointTorques:  # fmt: skip
    """Computed-torque control (feedback linearization): τ = M (ddtheta_d + Kp e + Ki (eint + e) + Kd de) + h (MR eq. 11.35).

    e = theta_d - theta; the current error is added to its integral ``eint``, as in the book's package.

    Returns
    -------
    tau : (..., n) array [N m, sliding joints: N]
    """
    chain = chain_of(Mlist, Glist, Slist)
    vectors = {
        "thetalist": thetalist, "dthetalist": dthetalist, "eint": eint,
        "thetalistd": thetalistd, "dthetalistd": dthetalistd, "ddthetalistd": ddthetalistd,
    }  # fmt: skip
    states = arguments.together(**{name: chain.joints(vector, name) for name, vector in vectors.items()})
    gains = _gains(chain, Kp=Kp, Ki=Ki, Kd=Kd)
    return _computed_torque(chain, arguments.real(g, "g", 3), *states, *gains)


def _gains(chain: Chain, **gains: ArrayLike) -> list[Array]:
    """Each gain as a number, or as a vector with one for each joint."""
    gain_arrays: list[Array] = []
    for name, K in gains.items():
        shape = (chain.n,) if np.ndim(K) else ()
        gain_arrays.append(arguments.one(K, name, *shape))
    return gain_arrays


def _computed_torque(
    chain: Chain, g: Array, q: Array, dq: Array, eint: Array, q_d: Array, dq_d: Array, ddq_d: Array,
    Kp: Array, Ki: Array, Kd: Array,
) -> Array:  # fmt: skip
    """Control law of :func:`ComputedTorque` on checked arguments."""
    e = q_d - q
    ddq = ddq_d + Kp * e + Ki * (eint + e) + Kd * (dq_d - dq)
    return chain.run("inverse_dynamics", thetalist=q, dthetalist=dq, ddthetalist=ddq, Ftip=np.zeros(6), g=g)


def SimulateControl(
    thetalist: ArrayLike, dthetalist: ArrayLike, g: ArrayLike, Ftipmat: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
    thetamatd: ArrayLike, dthetamatd: ArrayLike, ddthetamatd: ArrayLike,
    gtilde: ArrayLike, Mtildelist: ArrayLike, Gtildelist: ArrayLike, Kp: ArrayLike, Ki: ArrayLike, Kd: ArrayLike,
    dt: float, intRes: int, *, plot: bool = False,
) -> tuple[Array, Array]:  # fmt: skip
    """Simulate :func:`ComputedTorque` tracking a motion from one initial state, with its own model (MR section 11.4).

    Torques are held for ``dt``, integrated by ``intRes`` Euler steps.

    Returns
    -------
    taumat : (N, n) array, torques [N m, sliding joints: N]
    thetamat : (N, n) array, joint angles

    Raises
    ------
    MissingExtraError
        ``plot=True`` without matplotlib.
    """
    robot, model = chain_of(Mlist, Glist, Slist), chain_of(Mtildelist, Gtildelist, Slist)
    q, dq = _initial_state(robot, thetalist, dthetalist)
    gains = _gains(robot, Kp=Kp, Ki=Ki, Kd=Kd)
    reference = _motion_matrices(robot, thetamatd=thetamatd, dthetamatd=dthetamatd, ddthetamatd=ddthetamatd)
    q_d = reference["thetamatd"]
    dt = arguments.number(dt, "dt")
    steps = arguments.whole(intRes, "intRes")
    F = _tip_wrenches(Ftipmat, len(q_d))
    gravity, model_gravity = arguments.one(g, "g", 3), arguments.one(gtilde, "gtilde", 3)
    taumat, thetamat = _closed_loop(
        robot, model, q, dq, [*reference.values()], F, gravity, model_gravity, gains, dt, steps
    )
    if plot:
        _plot_joint_angles(dt * np.arange(1, len(q_d) + 1), thetamat, q_d)
    return taumat, thetamat


def _closed_loop(
    robot: Chain, model: Chain, q: Array, dq: Array, reference: list[Array], F: Array, gravity: Array,
    model_gravity: Array, gains: list[Array], dt: float, steps: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Torques and joint angles (N, n) as a controller with its own model tracks the reference q_d, dq_d, ddq_d."""
    eint = np.zeros(robot.n)
    taumat, thetamat = np.empty(reference[0].shape), np.empty(reference[0].shape)
    for i, (q_d, dq_d, ddq_d) in enumerate(zip(*reference, strict=True)):
        taumat[i] = _computed_torque(model, model_gravity, q, dq, eint, q_d, dq_d, ddq_d, *gains)
        q, dq = _euler_steps(robot, q, dq, taumat[i], gravity, F[i], dt, steps)
        thetamat[i] = q
        eint = eint + dt * (q_d - q)
    return taumat, thetamat


def _plot_joint_angles(t: Array, actual: Array, reference: Array) -> None:
    """Plot the joint angles (N, n), with the reference dotted."""
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError.from_extra("matplotlib", "plot", "SimulateControl(plot=True)") from None
    _, axes = plt.subplots()
    for i in range(actual.shape[1]):
        (line,) = axes.plot(t, actual[:, i], label=f"theta{i + 1}")
        axes.plot(t, reference[:, i], ":", color=line.get_color(), label=f"theta{i + 1} wanted")
    axes.set(xlabel="time [s]", ylabel="joint angle [rad]", title="Actual and wanted joint angles")
    axes.legend(loc="upper left")
    plt.show()


complete(globals())
