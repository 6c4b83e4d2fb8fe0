"""Chapters 4 to 6: forward kinematics, Jacobians and inverse kinematics of a chain of screws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..errors import ValueRangeError
from ..lie import se3
from ..lie.adjoint import Ad
from ..typing import Array
from . import matrix_arguments
from .rigid_motion import log6
from .robot_of_lists import screws_of

STEPS = 20
"""The most Newton steps of inverse kinematics, as in the book's package."""


def FKinBody(M: ArrayLike, Blist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Forward kinematics by body screws: M exp([B1] theta1) … exp([Bn] thetan), the end-effector's pose.

    Returns
    -------
    T : (..., 4, 4) array

    Notes
    -----
    MR eq. 4.16.

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> Blist = np.array([[0, 0, -1, 2, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0.1]]).T
    >>> (FKinBody(M, Blist, [np.pi / 2, 3, np.pi])[:3, 3].round(8) + 0.0).tolist()
    [-5.0, 4.0, 1.68584073]
    """
    chain = screws_of(Blist, "Blist")
    return arguments.one(M, "M", 4, 4) @ chain.pose(chain.joints(thetalist, "thetalist"))


def FKinSpace(M: ArrayLike, Slist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Forward kinematics by space screws: exp([S1] theta1) … exp([Sn] thetan) M, the end-effector's pose.

    Returns
    -------
    T : (..., 4, 4) array

    Notes
    -----
    MR eq. 4.14.

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> Slist = np.array([[0, 0, 1, 4, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, -1, -6, 0, -0.1]]).T
    >>> (FKinSpace(M, Slist, [np.pi / 2, 3, np.pi])[:3, 3].round(8) + 0.0).tolist()
    [-5.0, 4.0, 1.68584073]
    """
    chain = screws_of(Slist, "Slist")
    return chain.pose(chain.joints(thetalist, "thetalist")) @ arguments.one(M, "M", 4, 4)


def JacobianBody(Blist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Body Jacobian J_b with V_b = J_b dtheta, in the end-effector's frame.

    Returns
    -------
    J : (..., 6, n) array, angular rows first

    Notes
    -----
    MR eq. 5.18.

    Examples
    --------
    >>> Blist = np.array([[0, 0, 1, 0, 0.2, 0.2], [1, 0, 0, 2, 0, 3]]).T
    >>> JacobianBody(Blist, [0.2, 1.1])[:, 1].tolist()
    [1.0, 0.0, 0.0, 2.0, 0.0, 3.0]
    """
    chain = screws_of(Blist, "Blist")
    return chain.body_jacobian(chain.joints(thetalist, "thetalist"))


def JacobianSpace(Slist: ArrayLike, thetalist: ArrayLike) -> Array:
    """Space Jacobian J_s with V_s = J_s dtheta, in the space frame.

    Returns
    -------
    J : (..., 6, n) array, angular rows first

    Notes
    -----
    MR eq. 5.11.

    Examples
    --------
    >>> Slist = np.array([[0, 0, 1, 0, 0.2, 0.2], [1, 0, 0, 2, 0, 3]]).T
    >>> JacobianSpace(Slist, [0.2, 1.1])[:, 0].tolist()
    [0.0, 0.0, 1.0, 0.0, 0.2, 0.2]
    """
    chain = screws_of(Slist, "Slist")
    return chain.space_jacobian(chain.joints(thetalist, "thetalist"))


def IKinBody(
    Blist: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Numerical inverse kinematics by body screws: joint angles that reach a pose; one pose at a time.

    Parameters
    ----------
    T : (4, 4) array_like, wanted pose of the end-effector

    Returns
    -------
    thetalist : (n,) array
    success : bool, whether they reach it

    Notes
    -----
    MR section 6.2.2. Newton–Raphson with the pseudoinverse, 20 steps at most.

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> T = [[0, 1, 0, -5], [1, 0, 0, 4], [0, 0, -1, 1.6858], [0, 0, 0, 1]]
    >>> Blist = np.array([[0, 0, -1, 2, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0.1]]).T
    >>> theta, success = IKinBody(Blist, M, T, [1.5, 2.5, 3], 0.01, 0.001)
    >>> theta.round(6).tolist(), success
    ([1.570738, 2.999667, 3.141539], True)
    """
    chain, M, T = screws_of(Blist, "Blist"), _pose(M, "IKinBody: M"), _pose(T, "IKinBody: T")

    def left(theta: Array) -> Array:
        return log6(se3.inverse(M @ chain.pose(theta)) @ T)

    return _newton("IKinBody", chain.n, thetalist0, left, chain.body_jacobian, eomg, ev)


def IKinSpace(
    Slist: ArrayLike, M: ArrayLike, T: ArrayLike, thetalist0: ArrayLike, eomg: float, ev: float
) -> tuple[Array, bool]:
    """Numerical inverse kinematics by space screws; the twist that is left is seen from the space frame.

    Parameters
    ----------
    T : (4, 4) array_like, wanted pose of the end-effector

    Returns
    -------
    thetalist : (n,) array
    success : bool, whether they reach it

    Notes
    -----
    MR section 6.2.2. As :func:`IKinBody` otherwise.

    Examples
    --------
    >>> M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
    >>> T = [[0, 1, 0, -5], [1, 0, 0, 4], [0, 0, -1, 1.6858], [0, 0, 0, 1]]
    >>> Slist = np.array([[0, 0, 1, 4, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, -1, -6, 0, -0.1]]).T
    >>> theta, success = IKinSpace(Slist, M, T, [1.5, 2.5, 3], 0.01, 0.001)
    >>> theta.round(6).tolist(), success
    ([1.570738, 2.999664, 3.141534], True)
    """
    chain, M, T = screws_of(Slist, "Slist"), _pose(M, "IKinSpace: M"), _pose(T, "IKinSpace: T")

    def left(theta: Array) -> Array:
        T_sb = chain.pose(theta) @ M
        return Ad(T_sb) @ log6(se3.inverse(T_sb) @ T)

    return _newton("IKinSpace", chain.n, thetalist0, left, chain.space_jacobian, eomg, ev)


def _pose(T: ArrayLike, name: str) -> Array:
    return matrix_arguments.pose(arguments.finite(arguments.one(T, name, 4, 4), name, 4, 4), name)


def _bound(x: float, name: str) -> float:
    if not (bound := arguments.number(x, name)) >= 0:
        raise ValueRangeError(f"{name} is {x!r}: what may be left is 0 or more, such as 1e-6.")
    return bound


def _newton(
    caller: str,
    n: int,
    thetalist0: ArrayLike,
    left: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    eomg: float,
    ev: float,
) -> tuple[Array, bool]:
    """theta := theta + J⁺ V until the twist V that is left is small."""
    guess = f"{caller}: thetalist0"
    theta = arguments.finite(arguments.one(thetalist0, guess, n), guess, n)
    eomg, ev = _bound(eomg, f"{caller}: eomg"), _bound(ev, f"{caller}: ev")

    def there(V: Array) -> bool:
        return bool(np.linalg.norm(V[:3]) <= eomg and np.linalg.norm(V[3:]) <= ev)

    V = left(theta)
    for _ in range(STEPS):
        if there(V):
            break
        theta = theta + np.linalg.pinv(jacobian(theta)) @ V
        V = left(theta)
    return theta, there(V)


complete(globals())
