"""Chapter 8: dynamics of an open chain given by the book's lists.

``thetalist``, ``dthetalist`` … are (..., n); ``g`` (..., 3) m/s² in the space frame; ``Ftip`` (..., 6) the wrench (m, f) that
the robot applies, in the end-effector's frame {n+1}; ``Mlist`` (n + 1, 4, 4); ``Glist`` (n, 6, 6); ``Slist`` (6, n).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..errors import ShapeError
from . import door
from .chain import Chain, chain_of

Array = NDArray[Any]

__all__ = [
    "EndEffectorForces",
    "EulerStep",
    "ForwardDynamics",
    "ForwardDynamicsTrajectory",
    "GravityForces",
    "InverseDynamics",
    "InverseDynamicsTrajectory",
    "MassMatrix",
    "VelQuadraticForces",
]


def InverseDynamics(
    thetalist: ArrayLike,
    dthetalist: ArrayLike,
    ddthetalist: ArrayLike,
    g: ArrayLike,
    Ftip: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
) -> Array:
    """τ = M ddtheta + c + g(theta) + J' F_tip; → (..., n), N m or N. MR eq. 8.50 to 8.54.

    Raises ShapeError, ModelError and InertiaError for lists that describe no chain.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> lists = s.Mlist, s.Glist, s.Slist
    >>> InverseDynamics([0, 0], [0, 0], [0, 0], [0, 0, -9.81], np.zeros(6), *lists).round(9).tolist()
    [29.43, 9.81]
    """
    chain = chain_of(Mlist, Glist, Slist)
    return chain.run(
        chain.inverse_dynamics,
        thetalist=chain.joints(thetalist, "thetalist"),
        dthetalist=chain.joints(dthetalist, "dthetalist"),
        ddthetalist=chain.joints(ddthetalist, "ddthetalist"),
        Ftip=door.array(Ftip, "Ftip", 6),
        g=door.array(g, "g", 3),
    )


def MassMatrix(thetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Array:
    """M(theta), exactly symmetric, by composite inertias; → (..., n, n). MR eq. 8.57.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> MassMatrix([0, np.pi / 2], s.Mlist, s.Glist, s.Slist).round(12).tolist()
    [[3.0, 1.0], [1.0, 1.0]]
    """
    chain = chain_of(Mlist, Glist, Slist)
    return chain.mass_matrix(chain.joints(thetalist, "thetalist"))


def VelQuadraticForces(
    thetalist: ArrayLike, dthetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> Array:
    """c(theta, dtheta), centripetal and Coriolis forces; → (..., n). MR eq. 8.9, 8.10.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> VelQuadraticForces([0, np.pi / 2], [1, 1], s.Mlist, s.Glist, s.Slist).round(12).tolist()
    [-3.0, 1.0]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, dq = chain.joints(thetalist, "thetalist"), chain.joints(dthetalist, "dthetalist")
    return chain.run(chain.coriolis_forces, thetalist=q, dthetalist=dq)


def GravityForces(thetalist: ArrayLike, g: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Array:
    """g(theta), what holds the chain against gravity; → (..., n). MR section 8.3.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> GravityForces([0, 0], [0, 0, -9.81], s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [29.43, 9.81]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, gravity = chain.joints(thetalist, "thetalist"), door.array(g, "g", 3)
    return chain.run(chain.gravity_forces, thetalist=q, g=gravity)


def EndEffectorForces(
    thetalist: ArrayLike, Ftip: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> Array:
    """J_b' F_tip, what it takes to apply the wrench and nothing else; → (..., n). MR eq. 5.26.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> EndEffectorForces([0, 0], [0, 0, 0, 0, 1, 0], s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [2.0, 1.0]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, F = chain.joints(thetalist, "thetalist"), door.array(Ftip, "Ftip", 6)
    return chain.run(chain.wrench_torques, thetalist=q, Ftip=F)


def ForwardDynamics(
    thetalist: ArrayLike,
    dthetalist: ArrayLike,
    taulist: ArrayLike,
    g: ArrayLike,
    Ftip: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
) -> Array:
    """ddtheta that solves M ddtheta = τ - c - g(theta) - J' F_tip, M factored, never inverted; → (..., n). MR section 8.5.

    Raises SingularMassMatrixError where a joint moves nothing with inertia.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> ForwardDynamics([0, 0], [0, 0], [29.43, 9.81], [0, 0, -9.81], np.zeros(6), s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [0.0, 0.0]
    """
    chain = chain_of(Mlist, Glist, Slist)
    return chain.run(
        chain.forward_dynamics,
        thetalist=chain.joints(thetalist, "thetalist"),
        dthetalist=chain.joints(dthetalist, "dthetalist"),
        taulist=chain.joints(taulist, "taulist"),
        Ftip=door.array(Ftip, "Ftip", 6),
        g=door.array(g, "g", 3),
    )


def EulerStep(
    thetalist: ArrayLike, dthetalist: ArrayLike, ddthetalist: ArrayLike, dt: ArrayLike
) -> tuple[Array, Array]:
    """theta + dt dtheta and dtheta + dt ddtheta; (..., n) each → (..., n), (..., n). MR section 8.5.

    >>> [x.round(12).tolist() for x in EulerStep([0.1, 0.1, 0.1], [0.1, 0.2, 0.3], [2, 1.5, 1], 0.1)]
    [[0.11, 0.12, 0.13], [0.3, 0.35, 0.4]]
    """
    q, dq = door.array(thetalist, "thetalist"), door.array(dthetalist, "dthetalist")
    ddq, step = door.array(ddthetalist, "ddthetalist"), door.array(dt, "dt")
    step = step[..., None] if step.ndim else step
    try:
        return q + step * dq, dq + step * ddq
    except ValueError:
        raise arguments.mismatch(thetalist=q, dthetalist=dq, ddthetalist=ddq, dt=step) from None


def InverseDynamicsTrajectory(
    thetamat: ArrayLike,
    dthetamat: ArrayLike,
    ddthetamat: ArrayLike,
    g: ArrayLike,
    Ftipmat: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
) -> Array:
    """The torques of :func:`InverseDynamics` along a motion, all rows in one call; (N, n) each, ``Ftipmat`` (N, 6) → (N, n).

    ``Ftipmat`` 0 means no wrench.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> rest = np.zeros((3, 2))
    >>> InverseDynamicsTrajectory(rest, rest, rest, [0, 0, -9.81], 0, s.Mlist, s.Glist, s.Slist)[2].round(9).tolist()
    [29.43, 9.81]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, dq, ddq = (
        rows(chain, x, name)
        for x, name in ((thetamat, "thetamat"), (dthetamat, "dthetamat"), (ddthetamat, "ddthetamat"))
    )
    door.same_length(thetamat=q, dthetamat=dq, ddthetamat=ddq)
    F, gravity = tip_wrenches(Ftipmat, len(q)), door.array(g, "g", 3)
    return chain.run(chain.inverse_dynamics, thetamat=q, dthetamat=dq, ddthetamat=ddq, Ftipmat=F, g=gravity)


def ForwardDynamicsTrajectory(
    thetalist: ArrayLike,
    dthetalist: ArrayLike,
    taumat: ArrayLike,
    g: ArrayLike,
    Ftipmat: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
    dt: float,
    intRes: int,
) -> tuple[Array, Array]:
    """The motion under torques ``taumat`` (N, n) held for ``dt`` [s] each, by ``intRes`` Euler steps a row; → (N, n), (N, n).

    The first rows are the state given, and the last row of torques moves nothing. One motion at a time. MR section 8.5.
    ``Ftipmat`` (N, 6); 0 means no wrench.

    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> hold = np.tile([29.43, 9.81], (4, 1))
    >>> theta, dtheta = ForwardDynamicsTrajectory([0, 0], [0, 0], hold, [0, 0, -9.81], 0, s.Mlist, s.Glist, s.Slist, 0.1, 8)
    >>> bool(abs(theta).max() < 1e-9), theta.shape
    (True, (4, 2))
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, dq = start(chain, thetalist, dthetalist)
    tau, gravity, dt = rows(chain, taumat, "taumat"), arguments.one(g, "g", 3), arguments.number(dt, "dt")
    F, steps = tip_wrenches(Ftipmat, len(tau)), arguments.whole(intRes, "intRes")
    thetamat, dthetamat = np.empty(tau.shape), np.empty(tau.shape)
    thetamat[0], dthetamat[0] = q, dq
    for i in range(len(tau) - 1):
        q, dq = euler(chain, q, dq, tau[i], gravity, F[i], dt, steps)
        thetamat[i + 1], dthetamat[i + 1] = q, dq
    return thetamat, dthetamat


def euler(
    chain: Chain, q: Array, dq: Array, tau: Array, g: Array, F: Array, dt: float, steps: int
) -> tuple[Array, Array]:
    """The state after ``steps`` Euler steps that share the time dt, under constant torques."""
    step = dt / steps
    for _ in range(steps):
        ddq = chain.forward_dynamics(q, dq, tau, F, g)
        q, dq = q + step * dq, dq + step * ddq
    return q, dq


def start(chain: Chain, thetalist: ArrayLike, dthetalist: ArrayLike) -> tuple[Array, Array]:
    """The state that a simulation starts from, one state, real numbers."""
    q, dq = chain.joints(thetalist, "thetalist"), chain.joints(dthetalist, "dthetalist")
    for x, name in ((q, "thetalist"), (dq, "dthetalist")):
        if x.ndim != 1:
            raise ShapeError(f"{name} has shape {x.shape}: a simulation starts from one state, ({chain.n},).")
    return q.astype(float), dq.astype(float)


def rows(chain: Chain, x: ArrayLike, name: str) -> Array:
    """A matrix with a row for each instant and a column for each joint; (N, n)."""
    found = chain.joints(x, name)
    if found.ndim != 2 or len(found) == 0:
        raise ShapeError(f"{name} has shape {found.shape}, expected (N, {chain.n}): a row for each instant.")
    return found


def tip_wrenches(Ftipmat: ArrayLike, N: int) -> Array:
    """The wrench of each row, (N, 6); zeros where a plain 0 was given, as the book's package promises."""
    F = door.array(Ftipmat, "Ftipmat")
    if F.ndim == 0 and F == 0:
        return np.zeros((N, 6))
    if F.shape != (N, 6):
        raise ShapeError(
            f"Ftipmat has shape {F.shape}, expected ({N}, 6): a wrench (m, f) for each row, or 0 for none."
        )
    return F
