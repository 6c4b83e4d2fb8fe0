"""Chapter 8: dynamics of an open chain given by the book's lists.

``thetalist``, ``dthetalist`` … are (..., n); ``g`` (..., 3) m/s² in the space frame; ``Ftip`` (..., 6) the wrench (m, f) that
the robot applies, in the end-effector's frame {n+1}; ``Mlist`` (n + 1, 4, 4); ``Glist`` (n, 6, 6); ``Slist`` (6, n).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..errors import ShapeError
from ..typing import Array
from . import matrix_arguments
from .robot_of_lists import Chain, chain_of


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
    """Inverse dynamics: joint torques τ = M ddtheta + c + g(theta) + J' F_tip.

    Returns
    -------
    tau : (..., n) array [N m, sliding joints: N]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR eq. 8.50 to 8.54.

    Examples
    --------
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
        Ftip=matrix_arguments.array(Ftip, "Ftip", 6),
        g=matrix_arguments.array(g, "g", 3),
    )


def MassMatrix(thetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Array:
    """Mass matrix M(theta), exactly symmetric, by composite inertias.

    Returns
    -------
    M : (..., n, n) array [kg m², sliding joints: kg]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR eq. 8.57.

    Examples
    --------
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
    """Coriolis and centripetal forces c(theta, dtheta).

    Returns
    -------
    c : (..., n) array [N m, sliding joints: N]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR eq. 8.9, 8.10.

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> VelQuadraticForces([0, np.pi / 2], [1, 1], s.Mlist, s.Glist, s.Slist).round(12).tolist()
    [-3.0, 1.0]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, dq = chain.joints(thetalist, "thetalist"), chain.joints(dthetalist, "dthetalist")
    return chain.run(chain.coriolis_forces, thetalist=q, dthetalist=dq)


def GravityForces(thetalist: ArrayLike, g: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Array:
    """Gravity forces g(theta), what holds the chain against gravity.

    Returns
    -------
    g : (..., n) array [N m, sliding joints: N]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR section 8.3.

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> GravityForces([0, 0], [0, 0, -9.81], s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [29.43, 9.81]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, gravity = chain.joints(thetalist, "thetalist"), matrix_arguments.array(g, "g", 3)
    return chain.run(chain.gravity_forces, thetalist=q, g=gravity)


def EndEffectorForces(
    thetalist: ArrayLike, Ftip: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> Array:
    """Joint torques J_b' F_tip of a wrench at the end-effector: what it takes to apply it and nothing else.

    Returns
    -------
    tau : (..., n) array [N m, sliding joints: N]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR eq. 5.26.

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> EndEffectorForces([0, 0], [0, 0, 0, 0, 1, 0], s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [2.0, 1.0]
    """
    chain = chain_of(Mlist, Glist, Slist)
    q, F = chain.joints(thetalist, "thetalist"), matrix_arguments.array(Ftip, "Ftip", 6)
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
    """Forward dynamics: ddtheta that solves M ddtheta = τ - c - g(theta) - J' F_tip, M factored, never inverted.

    Parameters
    ----------
    taulist : (..., n) array_like, joint torques [N m, sliding joints: N]

    Returns
    -------
    ddtheta : (..., n) array, joint accelerations

    Raises
    ------
    SingularMassMatrixError
        A joint moves nothing with inertia.
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR section 8.5.

    Examples
    --------
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
        Ftip=matrix_arguments.array(Ftip, "Ftip", 6),
        g=matrix_arguments.array(g, "g", 3),
    )


def EulerStep(
    thetalist: ArrayLike, dthetalist: ArrayLike, ddthetalist: ArrayLike, dt: ArrayLike
) -> tuple[Array, Array]:
    """Euler integration step: theta + dt dtheta and dtheta + dt ddtheta.

    Parameters
    ----------
    dt : (...) array_like, time step [s]

    Returns
    -------
    theta : (..., n) array
    dtheta : (..., n) array

    Notes
    -----
    MR section 8.5.

    Examples
    --------
    >>> [x.round(12).tolist() for x in EulerStep([0.1, 0.1, 0.1], [0.1, 0.2, 0.3], [2, 1.5, 1], 0.1)]
    [[0.11, 0.12, 0.13], [0.3, 0.35, 0.4]]
    """
    q, dq = matrix_arguments.array(thetalist, "thetalist"), matrix_arguments.array(dthetalist, "dthetalist")
    ddq, step = matrix_arguments.array(ddthetalist, "ddthetalist"), matrix_arguments.array(dt, "dt")
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
    """Inverse dynamics along a motion, all rows in one call: the torques of :func:`InverseDynamics`.

    Parameters
    ----------
    thetamat, dthetamat, ddthetamat : (N, n) array_like, joint angles, rates and accelerations
    Ftipmat : (N, 6) array_like, wrenches the end-effector applies, or 0 for none [N m, N]

    Returns
    -------
    taumat : (N, n) array [N m, sliding joints: N]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Examples
    --------
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
    matrix_arguments.same_length(thetamat=q, dthetamat=dq, ddthetamat=ddq)
    F, gravity = tip_wrenches(Ftipmat, len(q)), matrix_arguments.array(g, "g", 3)
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
    """Forward dynamics along rows of torques, each held for ``dt``: the motion by Euler steps, one at a time.

    Parameters
    ----------
    thetalist : (n,) array_like, joint angles at the start
    dthetalist : (n,) array_like, joint rates at the start
    taumat : (N, n) array_like, torques [N m, sliding joints: N]; the last row moves nothing
    Ftipmat : (N, 6) array_like, wrenches the end-effector applies, or 0 for none [N m, N]
    dt : float, how long each row is held [s]
    intRes : int, Euler steps a row

    Returns
    -------
    thetamat : (N, n) array, joint angles; the first row is the start
    dthetamat : (N, n) array, joint rates

    Raises
    ------
    SingularMassMatrixError
        A joint moves nothing with inertia.
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR section 8.5.

    Examples
    --------
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
    F = matrix_arguments.array(Ftipmat, "Ftipmat")
    if F.ndim == 0 and F == 0:
        return np.zeros((N, 6))
    if F.shape != (N, 6):
        raise ShapeError(
            f"Ftipmat has shape {F.shape}, expected ({N}, 6): a wrench (m, f) for each row, or 0 for none."
        )
    return F


complete(globals())
