"""Chapter 11: computed torque control, and its simulation on a robot whose model is not quite right."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..errors import MissingExtraError
from . import door
from .chain import Chain, chain_of
from .dynamics import euler, rows, start, tip_wrenches

Array = NDArray[Any]

__all__ = ["ComputedTorque", "SimulateControl"]


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
    """τ = M (ddtheta_d + Kp e + Ki (eint + e) + Kd de) + h, the feedback-linearizing control; (..., n) each → (..., n).

    e = theta_d - theta; the error of this instant is added to its integral ``eint``, as in the book's package. Gains are
    numbers, or one for each joint. MR eq. 11.35.

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
    return _torque(chain, door.array(g, "g", 3), *states, *gains)


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
    """Torques and joint angles, (N, n) each, of :func:`ComputedTorque` following a motion (N, n) with a model of its own.

    The controller believes in ``gtilde, Mtildelist, Gtildelist``; the robot obeys ``g, Mlist, Glist``. Torques are held for
    ``dt`` [s], integrated by ``intRes`` Euler steps. ``Ftipmat`` (N, 6), or 0. Nothing is drawn unless ``plot=True`` is
    said (the book's package always opens a window); then a MissingExtraError without matplotlib. MR section 11.4.

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
    door.same_length(thetamatd=q_d, dthetamatd=dq_d, ddthetamatd=ddq_d)
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
