"""Motions for the tests of simulations: by SciPy, on rates written here, and step by step by a method of ours."""

from __future__ import annotations

import numpy as np

from twistwrench.mechanics.lie import quaternion
from twistwrench.simulation.forces import System
from twistwrench.simulation.methods.schemes import scheme_of


def rates(robot, q, dq):
    """Of the coordinates, by the rotation matrices of the library: independent of the integrator's own formulas."""
    found = np.zeros(robot.nq)
    for b in robot.model.leaders:
        i, k = b.q_index, b.v_index
        if b.joint.kind == "floating":
            found[i : i + 4] = 0.5 * quaternion.multiply(q[i : i + 4], np.r_[0.0, dq[k : k + 3]])
            found[i + 4 : i + 7] = quaternion.rotation(q[i : i + 4]) @ dq[k + 3 : k + 6]
        elif b.joint.kind == "planar":
            c, s = np.cos(q[i + 2]), np.sin(q[i + 2])
            found[i : i + 3] = c * dq[k + 1] - s * dq[k + 2], s * dq[k + 1] + c * dq[k + 2], dq[k]
        else:
            found[i] = dq[k]
    return found


def dop853(robot, q, dq, duration, times=None):
    from scipy.integrate import solve_ivp

    nq, zero = robot.nq, np.zeros(robot.nv)

    def f(_t, y):
        return np.concatenate([rates(robot, y[:nq], y[nq:]), robot.forward_dynamics(y[:nq], y[nq:], zero)])

    out = solve_ivp(f, (0, duration), np.r_[q, dq], method="DOP853", rtol=1e-13, atol=1e-13, t_eval=times)
    return out.y[:, -1] if times is None else out.y.T


def run(robot, state, duration, steps, method):
    system = System(robot)
    scheme, h = scheme_of(method, system), duration / steps
    y, rate = np.concatenate([state.q, state.dq, np.zeros(4)]), np.zeros(system.size)
    for k in range(steps):
        system.rates(k * h, y, rate)
        y = scheme.step(k * h, y, h, rate)
        system.manifold.normalise(y[: system.nq])
    return y[: system.nq], y[system.moving]


def far(robot, found, wanted):
    q, dq = wanted[: robot.nq], wanted[robot.nq :]
    return max(np.abs(robot.subtract(found[0], q)).max(), np.abs(found[1] - dq).max())
