"""Chapter 11: computed torque control, and its simulation with a model that differs from the robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..errors import MissingExtraError
from ..typing import Array
from . import matrix_arguments
from .dynamics import euler, rows, start, tip_wrenches
from .robot_of_lists import Chain, chain_of


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
) -> Array:
    """Computed-torque control (feedback linearization): τ = M (ddtheta_d + Kp e + Ki (eint + e) + Kd de) + h.

    Parameters
    ----------
    eint : (..., n) array_like, integral of the error up to the step before
    thetalistd, dthetalistd, ddthetalistd : (..., n) array_like, reference motion
    Kp : float or (n,) array_like, proportional gain
    Ki : float or (n,) array_like, integral gain
    Kd : float or (n,) array_like, derivative gain

    Returns
    -------
    tau : (..., n) array, joint torques [N m, sliding joints: N]

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.

    Notes
    -----
    MR eq. 11.35. e = theta_d - theta; the error of this instant is added to its integral ``eint``, as in the book's
    package. Gains are numbers, or one for each joint.

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
    return _torque(chain, matrix_arguments.array(g, "g", 3), *states, *gains)


def _gains(chain: Chain, **gains: ArrayLike) -> list[Array]:
    """Numbers, or one for each joint."""
    return [arguments.one(K, name, chain.n) if np.ndim(K) else arguments.one(K, name) for name, K in gains.items()]


def _torque(
    chain: Chain, g: Array, q: Array, dq: Array, eint: Array, q_d: Array, dq_d: Array, ddq_d: Array,
    Kp: Array, Ki: Array, Kd: Array,
) -> Array:  # fmt: skip
    e = q_d - q
    ddq = ddq_d + Kp * e + Ki * (eint + e) + Kd * (dq_d - dq)
    return chain.run(chain.inverse_dynamics, thetalist=q, dthetalist=dq, ddthetalist=ddq, Ftip=np.zeros(6), g=g)


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
    """Simulation of :func:`ComputedTorque` following a motion with a model of its own.

    Parameters
    ----------
    thetalist : (n,) array_like, joint angles at the start
    dthetalist : (n,) array_like, joint rates at the start
    Ftipmat : (N, 6) array_like, wrenches applied at the tip, or 0 [N m, N]
    thetamatd, dthetamatd, ddthetamatd : (N, n) array_like, reference motion
    gtilde, Mtildelist, Gtildelist : what the controller believes; the robot obeys ``g, Mlist, Glist``
    Kp : float or (n,) array_like, proportional gain
    Ki : float or (n,) array_like, integral gain
    Kd : float or (n,) array_like, derivative gain
    dt : float, time step [s]
    intRes : int, Euler steps in each time step
    plot : bool, draw the angles (the book's package always opens a window)

    Returns
    -------
    taumat : (N, n) array, torques [N m, sliding joints: N]
    thetamat : (N, n) array, joint angles

    Raises
    ------
    ShapeError, ModelError, InertiaError
        The lists describe no chain, or arrays do not fit it.
    MissingExtraError
        ``plot=True`` without matplotlib.

    Notes
    -----
    MR section 11.4. Torques are held for ``dt``, integrated by ``intRes`` Euler steps.

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
    q, dq = start(robot, thetalist, dthetalist)
    wanted = {"thetamatd": thetamatd, "dthetamatd": dthetamatd, "ddthetamatd": ddthetamatd}
    q_d, dq_d, ddq_d = (rows(robot, x, name) for name, x in wanted.items())
    matrix_arguments.same_length(thetamatd=q_d, dthetamatd=dq_d, ddthetamatd=ddq_d)
    gains, dt = _gains(robot, Kp=Kp, Ki=Ki, Kd=Kd), arguments.number(dt, "dt")
    gravity, believed = arguments.one(g, "g", 3), arguments.one(gtilde, "gtilde", 3)
    F, steps = tip_wrenches(Ftipmat, len(q_d)), arguments.whole(intRes, "intRes")
    eint, taumat, thetamat = np.zeros(robot.n), np.empty(q_d.shape), np.empty(q_d.shape)
    for i in range(len(q_d)):
        tau = _torque(model, believed, q, dq, eint, q_d[i], dq_d[i], ddq_d[i], *gains)
        q, dq = euler(robot, q, dq, tau, gravity, F[i], dt, steps)
        taumat[i], thetamat[i] = tau, q
        eint = eint + dt * (q_d[i] - q)
    if plot:
        _show(dt * np.arange(1, len(q_d) + 1), thetamat, q_d)
    return taumat, thetamat


def _show(t: Array, actual: Array, wanted: Array) -> None:
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError.of("matplotlib", "plot", "SimulateControl(plot=True)") from None
    _, axes = plt.subplots()
    for i in range(actual.shape[1]):
        (line,) = axes.plot(t, actual[:, i], label=f"theta{i + 1}")
        axes.plot(t, wanted[:, i], ":", color=line.get_color(), label=f"theta{i + 1} wanted")
    axes.set(xlabel="time [s]", ylabel="joint angle [rad]", title="Actual and wanted joint angles")
    axes.legend(loc="upper left")
    plt.show()


complete(globals())
