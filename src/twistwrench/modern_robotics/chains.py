"""Chapters 4 to 6: kinematics of open chains from the book's lists, with kernels cached by the content of the lists.

``thetalist``, ``dthetalist`` … are (..., n); ``g`` (..., 3) m/s² in the space frame; ``Ftip`` (..., 6) the wrench
applied by the robot, in the end-effector frame {n+1}; ``Mlist`` (n + 1, 4, 4); ``Glist`` (n, 6, 6); ``Slist`` (6, n).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array, Poses
from ..mechanics.algorithms.time_scalings import PosePath, cubic_share, quintic_share
from ..mechanics.lie import se3
from ..mechanics.lie.adjoint import Ad
from ..robot import Robot, from_screws
from .matrices import log6, pose_argument

STEPS = 20
"""Maximum number of Newton steps of inverse kinematics, as in the book's package."""
CACHED = 64
"""Maximum number of cached sets of lists (least recently used are dropped). Machine code remains cached on disk."""

_AT_TIP: dict[str, Any] = {"gravity": "input", "wrenches": True}
_KERNELS: dict[str, tuple[str, dict[str, Any]]] = {
    "pose": ("forward_kinematics", {}),
    "space_jacobian": ("jacobian", {"kind": "space"}),
    "body_jacobian": ("jacobian", {"kind": "body"}),
    "inverse_dynamics": ("inverse_dynamics", _AT_TIP),
    "forward_dynamics": ("forward_dynamics", _AT_TIP),
    "mass_matrix": ("mass_matrix", {}),
    "coriolis_forces": ("coriolis_forces", {}),
    "gravity_forces": ("gravity_forces", {"gravity": "input"}),
    "wrench_torques": ("wrench_torques", {}),
}
"""Quantities of a chain with their options. Gravity and the tip wrench are inputs, so new values need no compilation."""


class Chain:
    """Serial chain with its kernels."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.n = robot, robot.nv
        self._kernels: dict[str, np.ufunc] = {}

    def kernel(self, name: str) -> np.ufunc:
        """Kernel for a key of the table."""
        if (found := self._kernels.get(name)) is None:
            quantity, options = _KERNELS[name]
            if "wrenches" in options:
                options = {**options, "wrenches": (str(self.robot.tip),)}
            found = self._kernels[name] = self.robot.kernel(quantity, **options)
        return found

    def joints(self, x: ArrayLike, name: str) -> Array:
        """Vector with one number per joint, or a batch of such vectors."""
        found = arguments.real(x, name)
        if found.ndim == 0 or found.shape[-1] != self.n:
            raise ShapeError(f"{name} has shape {found.shape}, but the lists describe {self.n} joints.")
        return found

    def run(self, quantity: str, **arrays: Array) -> Array:
        """Evaluate a quantity; raises ShapeError for batches that do not broadcast."""
        kernel = self.kernel(quantity)
        try:
            return kernel(*arrays.values())
        except ValueError:
            raise arguments.mismatch(**arrays) from None


def chain_of(Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Chain:
    """Chain from the book's lists: n + 1 poses, n inertias, n screw columns. Impossible inertias are accepted.

    Raises ShapeError for inconsistent lists, ModelError and InertiaError if they do not describe a robot.
    """
    steps, inertias, screws = (
        np.ascontiguousarray(arguments.real(x, name), float)
        for x, name in ((Mlist, "Mlist"), (Glist, "Glist"), (Slist, "Slist"))
    )
    return _built(steps.tobytes(), inertias.tobytes(), screws.tobytes(), (steps.shape, inertias.shape, screws.shape))


def screws_of(screws: ArrayLike, name: str) -> Chain:
    """Chain from screws only: every link frame is {s} at zero, so space screws and body screws have equal coordinates."""
    S = np.ascontiguousarray(arguments.real(screws, name), float)
    if S.ndim != 2 or S.shape[0] != 6 or S.shape[1] == 0:
        raise ShapeError(f"{name} has shape {S.shape}, expected (6, n): a screw axis (omega, v) in each column.")
    n = S.shape[1]
    return _built(_HOME * (n + 1), bytes(288 * n), S.tobytes(), ((n + 1, 4, 4), (n, 6, 6), S.shape))


_HOME = np.eye(4).tobytes()
Shape = tuple[int, ...]


@lru_cache(maxsize=CACHED)
def _built(steps: bytes, inertias: bytes, screws: bytes, shapes: tuple[Shape, Shape, Shape]) -> Chain:
    raw = zip((steps, inertias, screws), shapes, strict=True)
    Mlist, Glist, Slist = (np.frombuffer(data).reshape(shape) for data, shape in raw)
    if Mlist.ndim == 3 and Mlist.shape[1:] == (4, 4):
        Mlist = np.array([pose_argument(T, f"Mlist[{i}]") for i, T in enumerate(Mlist)])
    return Chain(from_screws(None, Slist, Mlist, Glist, name="lists", non_unit_screws=True, inertia="accept"))


# ── Forward kinematics, Jacobians, inverse kinematics


def FKinBody(M: ArrayLike, Blist: ArrayLike, thetalist: ArrayLike) -> Poses:
    """Forward kinematics by body screws: M exp([B1] theta1) … exp([Bn] thetan), the end-effector's pose (MR eq. 4.16).

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> Blist = np.array([[0, 0, -1, 2, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0.1]]).T
    >>> (FKinBody(M, Blist, [np.pi / 2, 3, np.pi])[:3, 3].round(8) + 0.0).tolist()
    [-5.0, 4.0, 1.68584073]
    """
    chain = screws_of(Blist, "Blist")
    return arguments.one(M, "M", 4, 4) @ chain.run("pose", thetalist=chain.joints(thetalist, "thetalist"))


def FKinSpace(M: ArrayLike, Slist: ArrayLike, thetalist: ArrayLike) -> Poses:
    """Forward kinematics by space screws: exp([S1] theta1) … exp([Sn] thetan) M, the end-effector's pose (MR eq. 4.14).

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> Slist = np.array([[0, 0, 1, 4, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, -1, -6, 0, -0.1]]).T
    >>> (FKinSpace(M, Slist, [np.pi / 2, 3, np.pi])[:3, 3].round(8) + 0.0).tolist()
    [-5.0, 4.0, 1.68584073]
    """
    chain = screws_of(Slist, "Slist")
    return chain.run("pose", thetalist=chain.joints(thetalist, "thetalist")) @ arguments.one(M, "M", 4, 4)


def JacobianBody(Blist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Body Jacobian J_b with V_b = J_b dtheta, in the end-effector's frame (MR eq. 5.18).

    Returns
    -------
    J : (..., 6, n) array, angular rows first

    Examples
    --------
    >>> Blist = np.array([[0, 0, 1, 0, 0.2, 0.2], [1, 0, 0, 2, 0, 3]]).T
    >>> JacobianBody(Blist, [0.2, 1.1])[:, 1].tolist()
    [1.0, 0.0, 0.0, 2.0, 0.0, 3.0]
    """
    chain = screws_of(Blist, "Blist")
    return chain.run("body_jacobian", thetalist=chain.joints(thetalist, "thetalist"))


def JacobianSpace(Slist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Space Jacobian J_s with V_s = J_s dtheta, in the space frame (MR eq. 5.11).

    Returns
    -------
    J : (..., 6, n) array, angular rows first

    Examples
    --------
    >>> Slist = np.array([[0, 0, 1, 0, 0.2, 0.2], [1, 0, 0, 2, 0, 3]]).T
    >>> JacobianSpace(Slist, [0.2, 1.1])[:, 0].tolist()
    [0.0, 0.0, 1.0, 0.0, 0.2, 0.2]
    """
    chain = screws_of(Slist, "Slist")
    return chain.run("space_jacobian", thetalist=chain.joints(thetalist, "thetalist"))


def IKinBody(
    Blist: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Numerical inverse kinematics by body screws: joint angles that reach a pose; one pose per call (MR section 6.2.2).

    Newton–Raphson with the pseudoinverse, 20 steps at most.

    Returns
    -------
    thetalist : (n,) array
    success : bool, True if they reach the pose

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> T = [[0, 1, 0, -5], [1, 0, 0, 4], [0, 0, -1, 1.6858], [0, 0, 0, 1]]
    >>> Blist = np.array([[0, 0, -1, 2, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0.1]]).T
    >>> theta, success = IKinBody(Blist, M, T, [1.5, 2.5, 3], 0.01, 0.001)
    >>> theta.round(6).tolist(), success
    ([1.570738, 2.999667, 3.141539], True)
    """
    return _newton("IKinBody", Blist, M, T, thetalist0, eomg, ev)


def IKinSpace(
    Slist: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Numerical inverse kinematics by space screws; the twist error is expressed in the space frame (MR section 6.2.2).

    Otherwise the same as :func:`IKinBody`.

    Returns
    -------
    thetalist : (n,) array
    success : bool, True if they reach the pose

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> T = [[0, 1, 0, -5], [1, 0, 0, 4], [0, 0, -1, 1.6858], [0, 0, 0, 1]]
    >>> Slist = np.array([[0, 0, 1, 4, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, -1, -6, 0, -0.1]]).T
    >>> theta, success = IKinSpace(Slist, M, T, [1.5, 2.5, 3], 0.01, 0.001)
    >>> theta.round(6).tolist(), success
    ([1.570738, 2.999664, 3.141534], True)
    """
    return _newton("IKinSpace", Slist, M, T, thetalist0, eomg, ev)


def _newton(
    caller: str, screws: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Iterate theta := theta + J⁺ V until the twist error V, in the frame of the screws, is small."""
    space, guess = caller == "IKinSpace", f"{caller}: thetalist0"
    chain = screws_of(screws, "Slist" if space else "Blist")
    jacobian, pose = chain.kernel("space_jacobian" if space else "body_jacobian"), chain.kernel("pose")
    M, T = _pose(M, f"{caller}: M"), _pose(T, f"{caller}: T")
    theta = arguments.finite(arguments.one(thetalist0, guess, chain.n), guess, chain.n)
    eomg, ev = _bound(eomg, f"{caller}: eomg"), _bound(ev, f"{caller}: ev")

    def left(theta: Array) -> Array:
        T_sb = pose(theta) @ M if space else M @ pose(theta)
        V_b = log6(se3.inverse(T_sb) @ T)
        return Ad(T_sb) @ V_b if space else V_b

    def there(V: Array) -> bool:
        return bool(np.linalg.norm(V[:3]) <= eomg and np.linalg.norm(V[3:]) <= ev)

    V = left(theta)
    for _ in range(STEPS):
        if there(V):
            break
        theta = theta + np.linalg.pinv(jacobian(theta)) @ V
        V = left(theta)
    return theta, there(V)


def _pose(T: ArrayLike, name: str) -> Array:
    return pose_argument(arguments.finite(arguments.one(T, name, 4, 4), name, 4, 4), name)


def _bound(x: float, name: str) -> float:
    if not (bound := arguments.number(x, name)) >= 0:
        raise ValueRangeError(f"{name} is {x!r}: what may be left is 0 or more, such as 1e-6.")
    return bound


# ── Chapter 9: time scalings, and motions from point to point in joint space and in SE(3)


def CubicTimeScaling(Tf: float, t: ArrayLike) -> Any:
    """Cubic time scaling s(t) = 3 (t/Tf)² - 2 (t/Tf)³, from rest to rest (MR eq. 9.10).

    Returns
    -------
    s : (...) array

    Examples
    --------
    >>> round(float(CubicTimeScaling(2, 0.6)), 12)
    0.216
    """
    return cubic_share(_fraction(Tf, t))


def QuinticTimeScaling(Tf: float, t: ArrayLike) -> Any:
    """Quintic time scaling s(t) = 10 (t/Tf)³ - 15 (t/Tf)⁴ + 6 (t/Tf)⁵, accelerations zero at both ends too (MR section 9.2.1).

    Returns
    -------
    s : (...) array

    Examples
    --------
    >>> round(float(QuinticTimeScaling(2, 0.6)), 12)
    0.16308
    """
    return quintic_share(_fraction(Tf, t))


def _fraction(Tf: Any, t: Any) -> Any:
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

    Examples
    --------
    >>> JointTrajectory([1, 0], [2, 4], 4, 3, 3).tolist()
    [[1.0, 0.0], [1.5, 2.0], [2.0, 4.0]]
    """
    start, end = arguments.real(thetastart, "thetastart"), arguments.real(thetaend, "thetaend")
    if start.ndim != 1 or start.shape != end.shape:
        raise ShapeError(f"thetastart {start.shape}, thetaend {end.shape}: expected two vectors of the same length.")
    s = _scaling(Tf, N, method)[:, None]
    return np.asarray(s * end + (1.0 - s) * start)


def ScrewTrajectory(Xstart: ArrayLike, Xend: ArrayLike, Tf: float, N: float, method: int) -> list[Array]:
    """Screw trajectory: poses along the constant screw from one pose to another (MR eq. 9.23).

    Returns
    -------
    poses : list of N (4, 4) arrays

    Examples
    --------
    >>> X = se3.exp([0, 0, np.pi / 2, 1, 0, 0])
    >>> len(ScrewTrajectory(np.eye(4), X, 5, 4, 3))
    4
    """
    X, end = _ends(Xstart, Xend)
    V = log6(se3.inverse(X) @ end)
    return list(PosePath(X, end, straight=False, twist=V)(_scaling(Tf, N, method)))


def CartesianTrajectory(Xstart: ArrayLike, Xend: ArrayLike, Tf: float, N: float, method: int) -> list[Array]:
    """Cartesian trajectory: origin on a straight line, rotation about a constant axis (MR eq. 9.24, 9.25).

    Returns
    -------
    poses : list of N (4, 4) arrays

    Examples
    --------
    >>> X = se3.exp([0, 0, np.pi / 2, 1, 0, 0])
    >>> CartesianTrajectory(np.eye(4), X, 5, 3, 5)[1][:3, 3].round(9).tolist()
    [0.318309886, 0.318309886, 0.0]
    """
    X, end = _ends(Xstart, Xend)
    still = se3.pose(np.swapaxes(X[:3, :3], -1, -2) @ end[:3, :3], np.zeros(3))
    twist = np.concatenate([log6(still)[:3], end[:3, 3] - X[:3, 3]])
    return list(PosePath(X, end, straight=True, twist=twist)(_scaling(Tf, N, method)))


def _ends(Xstart: ArrayLike, Xend: ArrayLike) -> tuple[Array, Array]:
    X, end = pose_argument(Xstart, "Xstart"), pose_argument(Xend, "Xend")
    if X.shape != (4, 4) or end.shape != (4, 4):
        raise ShapeError(f"Xstart has shape {X.shape}, Xend {end.shape}: expected two poses, (4, 4).")
    return X, end


def _scaling(Tf: float, N: float, method: int) -> Array:
    """Path parameter s at N equally spaced times from 0 to Tf, exact at both ends."""
    n = arguments.whole(N, "N", 2)
    scalings = {3: CubicTimeScaling, 5: QuinticTimeScaling}
    if method not in tuple(scalings):
        raise ValueRangeError(f"method is {method!r}; choose 3, cubic, or 5, quintic time scaling.")
    _fraction(arguments.number(Tf, "Tf"), 0.0)
    return np.asarray(scalings[method](1.0, np.arange(n) / (n - 1.0)))


complete(globals())
