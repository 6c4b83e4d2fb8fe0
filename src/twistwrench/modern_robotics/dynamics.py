"""Chapters 8 and 11: dynamics of open chains from the book's lists, and computed torque control.

Array shapes are those of :mod:`.chains`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import MissingExtraError, ShapeError
from ..core.glossary import complete
from ..core.typing import Array, JointTorques
from .chains import Chain, chain_of

# ── Chapter 8: dynamics


def _on_lists(quantity: str, lists: tuple[ArrayLike, ArrayLike, ArrayLike], **given: ArrayLike) -> Array:
    """Quantity of the chain of (Mlist, Glist, Slist), with its inputs in order."""
    chain, sizes = chain_of(*lists), {"Ftip": 6, "g": 3}
    return chain.run(
        quantity, **{n: arguments.real(x, n, sizes[n]) if n in sizes else chain.joints(x, n) for n, x in given.items()}
    )


def InverseDynamics(
    thetalist: ArrayLike,
    dthetalist: ArrayLike,
    ddthetalist: ArrayLike,
    g: ArrayLike,
    Ftip: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
) -> JointTorques:
    """Inverse dynamics: joint torques τ = M ddtheta + c + g(theta) + J' F_tip (MR eq. 8.50 to 8.54).

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> lists = s.Mlist, s.Glist, s.Slist
    >>> InverseDynamics([0, 0], [0, 0], [0, 0], [0, 0, -9.81], np.zeros(6), *lists).round(9).tolist()
    [29.43, 9.81]
    """
    return _on_lists(
        "inverse_dynamics", (Mlist, Glist, Slist),
        thetalist=thetalist, dthetalist=dthetalist, ddthetalist=ddthetalist, Ftip=Ftip, g=g,
    )  # fmt: skip


def MassMatrix(thetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Array:
    """Mass matrix M(theta), exactly symmetric, by composite inertias (MR eq. 8.57).

    Returns
    -------
    M : (..., n, n) array [kg m², sliding joints: kg]

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> MassMatrix([0, np.pi / 2], s.Mlist, s.Glist, s.Slist).round(12).tolist()
    [[3.0, 1.0], [1.0, 1.0]]
    """
    return _on_lists("mass_matrix", (Mlist, Glist, Slist), thetalist=thetalist)


def VelQuadraticForces(
    thetalist: ArrayLike, dthetalist: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> JointTorques:
    """Coriolis and centripetal forces c(theta, dtheta) (MR eq. 8.9, 8.10).

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> VelQuadraticForces([0, np.pi / 2], [1, 1], s.Mlist, s.Glist, s.Slist).round(12).tolist()
    [-3.0, 1.0]
    """
    return _on_lists("coriolis_forces", (Mlist, Glist, Slist), thetalist=thetalist, dthetalist=dthetalist)


def GravityForces(
    thetalist: ArrayLike, g: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> JointTorques:
    """Gravity forces g(theta), the torques that hold the chain against gravity (MR section 8.3).

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> GravityForces([0, 0], [0, 0, -9.81], s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [29.43, 9.81]
    """
    return _on_lists("gravity_forces", (Mlist, Glist, Slist), thetalist=thetalist, g=g)


def EndEffectorForces(
    thetalist: ArrayLike, Ftip: ArrayLike, Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike
) -> JointTorques:
    """Joint torques J_b' F_tip of the wrench applied by the end-effector, without other terms (MR eq. 5.26).

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> EndEffectorForces([0, 0], [0, 0, 0, 0, 1, 0], s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [2.0, 1.0]
    """
    return _on_lists("wrench_torques", (Mlist, Glist, Slist), thetalist=thetalist, Ftip=Ftip)


def ForwardDynamics(
    thetalist: ArrayLike, dthetalist: ArrayLike, taulist: ArrayLike, g: ArrayLike, Ftip: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
) -> Array:  # fmt: skip
    """Forward dynamics: ddtheta that solves M ddtheta = τ - c - g(theta) - J' F_tip, M factored (MR section 8.5).

    Returns
    -------
    ddtheta : (..., n) array, joint accelerations

    Raises
    ------
    SingularMassMatrixError
        A joint does not move any inertia.

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> ForwardDynamics([0, 0], [0, 0], [29.43, 9.81], [0, 0, -9.81], np.zeros(6), s.Mlist, s.Glist, s.Slist).round(9).tolist()
    [0.0, 0.0]
    """
    return _on_lists(
        "forward_dynamics", (Mlist, Glist, Slist),
        thetalist=thetalist, dthetalist=dthetalist, taulist=taulist, Ftip=Ftip, g=g,
    )  # fmt: skip


def EulerStep(
    thetalist: ArrayLike, dthetalist: ArrayLike, ddthetalist: ArrayLike, dt: ArrayLike
) -> tuple[Array, Array]:
    """Euler integration step: theta + dt dtheta and dtheta + dt ddtheta (MR section 8.5).

    Returns
    -------
    theta : (..., n) array
    dtheta : (..., n) array

    Examples
    --------
    >>> [x.round(12).tolist() for x in EulerStep([0.1, 0.1, 0.1], [0.1, 0.2, 0.3], [2, 1.5, 1], 0.1)]
    [[0.11, 0.12, 0.13], [0.3, 0.35, 0.4]]
    """
    q, dq = arguments.real(thetalist, "thetalist"), arguments.real(dthetalist, "dthetalist")
    ddq, step = arguments.real(ddthetalist, "ddthetalist"), arguments.real(dt, "dt")
    step = step[..., None] if step.ndim else step
    try:
        return q + step * dq, dq + step * ddq
    except ValueError:
        raise arguments.mismatch(thetalist=q, dthetalist=dq, ddthetalist=ddq, dt=step) from None


def InverseDynamicsTrajectory(
    thetamat: ArrayLike, dthetamat: ArrayLike, ddthetamat: ArrayLike, g: ArrayLike, Ftipmat: ArrayLike,
    Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike,
) -> Array:  # fmt: skip
    """Inverse dynamics along a motion, all rows in one call: the torques of :func:`InverseDynamics`.

    Returns
    -------
    taumat : (N, n) array [N m, sliding joints: N]

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> rest = np.zeros((3, 2))
    >>> InverseDynamicsTrajectory(rest, rest, rest, [0, 0, -9.81], 0, s.Mlist, s.Glist, s.Slist)[2].round(9).tolist()
    [29.43, 9.81]
    """
    chain = chain_of(Mlist, Glist, Slist)
    motion = _motion(chain, thetamat=thetamat, dthetamat=dthetamat, ddthetamat=ddthetamat)
    F, gravity = _tip_wrenches(Ftipmat, len(motion["thetamat"])), arguments.real(g, "g", 3)
    return chain.run("inverse_dynamics", **motion, Ftipmat=F, g=gravity)


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
    """Forward dynamics along rows of torques, each held for ``dt``, by Euler steps; one motion per call (MR section 8.5).

    Parameters
    ----------
    taumat : (N, n) array_like, torques [N m, sliding joints: N]; the last row is not used

    Returns
    -------
    thetamat : (N, n) array, joint angles; the first row is the initial state
    dthetamat : (N, n) array, joint rates

    Raises
    ------
    SingularMassMatrixError
        A joint does not move any inertia.

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
    q, dq = _start(chain, thetalist, dthetalist)
    tau, gravity, dt = _rows(chain, taumat, "taumat"), arguments.one(g, "g", 3), arguments.number(dt, "dt")
    F, steps = _tip_wrenches(Ftipmat, len(tau)), arguments.whole(intRes, "intRes")
    thetamat, dthetamat = np.empty(tau.shape), np.empty(tau.shape)
    thetamat[0], dthetamat[0] = q, dq
    for i in range(len(tau) - 1):
        q, dq = _euler(chain, q, dq, tau[i], gravity, F[i], dt, steps)
        thetamat[i + 1], dthetamat[i + 1] = q, dq
    return thetamat, dthetamat


def _euler(
    chain: Chain, q: Array, dq: Array, tau: Array, g: Array, F: Array, dt: float, steps: int
) -> tuple[Array, Array]:
    """State after ``steps`` Euler steps over the total time dt, under constant torques."""
    step = dt / steps
    for _ in range(steps):
        ddq = chain.kernel("forward_dynamics")(q, dq, tau, F, g)
        q, dq = q + step * dq, dq + step * ddq
    return q, dq


def _start(chain: Chain, thetalist: ArrayLike, dthetalist: ArrayLike) -> tuple[Array, Array]:
    """Initial state of a simulation: one state, real numbers."""
    q, dq = chain.joints(thetalist, "thetalist"), chain.joints(dthetalist, "dthetalist")
    for x, name in ((q, "thetalist"), (dq, "dthetalist")):
        if x.ndim != 1:
            raise ShapeError(f"{name} has shape {x.shape}: a simulation starts from one state, ({chain.n},).")
    return q.astype(float), dq.astype(float)


def _rows(chain: Chain, x: ArrayLike, name: str) -> Array:
    """Matrix with a row per time and a column per joint; (N, n)."""
    found = chain.joints(x, name)
    if found.ndim != 2 or len(found) == 0:
        raise ShapeError(f"{name} has shape {found.shape}, expected (N, {chain.n}): a row for each instant.")
    return found


def _motion(chain: Chain, **matrices: ArrayLike) -> dict[str, Array]:
    """Matrices of one motion with equal numbers of rows."""
    found = {name: _rows(chain, x, name) for name, x in matrices.items()}
    if len({len(m) for m in found.values()}) > 1:
        listed = ", ".join(f"{name} {m.shape}" for name, m in found.items())
        raise ShapeError(f"the matrices of one motion need as many rows as each other: {listed}.")
    return found


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


# ── Chapter 11: computed torque control


def ComputedTorque(
    thetalist: ArrayLike,
    dthetalist: ArrayLike,
    eint: ArrayLike,
    g: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
    thetalistd: ArrayLike,
    dthetalistd: ArrayLike,
    ddthetalistd: ArrayLike,
    Kp: ArrayLike,
    Ki: ArrayLike,
    Kd: ArrayLike,
) -> JointTorques:
    """Computed-torque control (feedback linearization): τ = M (ddtheta_d + Kp e + Ki (eint + e) + Kd de) + h (MR eq. 11.35).

    Notes
    -----
    e = theta_d - theta; the current error is added to its integral ``eint``, as in the book's package. Gains are
    numbers, or one for each joint.

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> lists = s.Mlist, s.Glist, s.Slist
    >>> ComputedTorque([0, 0], [0, 0], [0, 0], [0, 0, -9.81], *lists, [0, 0], [0, 0], [0, 0], 20, 10, 18).round(9).tolist()
    [29.43, 9.81]
    """
    chain = chain_of(Mlist, Glist, Slist)
    given = {
        "thetalist": thetalist, "dthetalist": dthetalist, "eint": eint,
        "thetalistd": thetalistd, "dthetalistd": dthetalistd, "ddthetalistd": ddthetalistd,
    }  # fmt: skip
    states = arguments.together(**{name: chain.joints(x, name) for name, x in given.items()})
    gains = _gains(chain, Kp=Kp, Ki=Ki, Kd=Kd)
    return _torque(chain, arguments.real(g, "g", 3), *states, *gains)


def _gains(chain: Chain, **gains: ArrayLike) -> list[Array]:
    """Gains as numbers, or one for each joint."""
    return [arguments.one(K, name, chain.n) if np.ndim(K) else arguments.one(K, name) for name, K in gains.items()]


def _torque(
    chain: Chain, g: Array, q: Array, dq: Array, eint: Array, q_d: Array, dq_d: Array, ddq_d: Array,
    Kp: Array, Ki: Array, Kd: Array,
) -> Array:  # fmt: skip
    e = q_d - q
    ddq = ddq_d + Kp * e + Ki * (eint + e) + Kd * (dq_d - dq)
    return chain.run("inverse_dynamics", thetalist=q, dthetalist=dq, ddthetalist=ddq, Ftip=np.zeros(6), g=g)


def SimulateControl(
    thetalist: ArrayLike,
    dthetalist: ArrayLike,
    g: ArrayLike,
    Ftipmat: ArrayLike,
    Mlist: ArrayLike,
    Glist: ArrayLike,
    Slist: ArrayLike,
    thetamatd: ArrayLike,
    dthetamatd: ArrayLike,
    ddthetamatd: ArrayLike,
    gtilde: ArrayLike,
    Mtildelist: ArrayLike,
    Gtildelist: ArrayLike,
    Kp: ArrayLike,
    Ki: ArrayLike,
    Kd: ArrayLike,
    dt: float,
    intRes: int,
    *,
    plot: bool = False,
) -> tuple[Array, Array]:
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

    Examples
    --------
    >>> from twistwrench import robots
    >>> s = robots.planar_2r().screws
    >>> rest, g = np.zeros((5, 2)), [0, 0, -9.81]
    >>> tau, theta = SimulateControl([0, 0], [0, 0], g, 0, s.Mlist, s.Glist, s.Slist, rest, rest, rest,
    ...                              g, s.Mlist, s.Glist, 20, 10, 18, 0.01, 8)
    >>> tau[4].round(6).tolist(), bool(abs(theta).max() < 1e-9)
    ([29.43, 9.81], True)
    """
    robot, model = chain_of(Mlist, Glist, Slist), chain_of(Mtildelist, Gtildelist, Slist)
    q, dq = _start(robot, thetalist, dthetalist)
    wanted = _motion(robot, thetamatd=thetamatd, dthetamatd=dthetamatd, ddthetamatd=ddthetamatd)
    q_d, dq_d, ddq_d = wanted.values()
    gains, dt = _gains(robot, Kp=Kp, Ki=Ki, Kd=Kd), arguments.number(dt, "dt")
    gravity, believed = arguments.one(g, "g", 3), arguments.one(gtilde, "gtilde", 3)
    F, steps = _tip_wrenches(Ftipmat, len(q_d)), arguments.whole(intRes, "intRes")
    eint, taumat, thetamat = np.zeros(robot.n), np.empty(q_d.shape), np.empty(q_d.shape)
    for i in range(len(q_d)):
        tau = _torque(model, believed, q, dq, eint, q_d[i], dq_d[i], ddq_d[i], *gains)
        q, dq = _euler(robot, q, dq, tau, gravity, F[i], dt, steps)
        taumat[i], thetamat[i] = tau, q
        eint = eint + dt * (q_d[i] - q)
    if plot:
        _show(dt * np.arange(1, len(q_d) + 1), thetamat, q_d)
    return taumat, thetamat


def _show(t: Array, actual: Array, wanted: Array) -> None:
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError.from_extra("matplotlib", "plot", "SimulateControl(plot=True)") from None
    _, axes = plt.subplots()
    for i in range(actual.shape[1]):
        (line,) = axes.plot(t, actual[:, i], label=f"theta{i + 1}")
        axes.plot(t, wanted[:, i], ":", color=line.get_color(), label=f"theta{i + 1} wanted")
    axes.set(xlabel="time [s]", ylabel="joint angle [rad]", title="Actual and wanted joint angles")
    axes.legend(loc="upper left")
    plt.show()


complete(globals())
