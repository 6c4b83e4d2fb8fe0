"""States, the linear equation that errors shall obey, and what laws say of their errors along a motion."""

from __future__ import annotations

import numpy as np

TIGHT = {"rtol": 1e-9, "atol": 1e-11}
"""Of dopri5, a step; what it leaves over a second is some ten times that."""
Q = np.array([-0.9, 1.9, 0.4])
Q6 = np.array([0.3, -1.2, 1.5, -0.4, 0.8, 0.2])


def second_order(t, e, de, kp, kd):
    """The solution of ë + kd ė + kp e = 0 by the exponential of its matrix: (times, n), for gains of any kind."""
    from scipy.linalg import expm

    n = len(e)
    Kp, Kd = (np.asarray(k) * np.eye(n) if np.ndim(k) < 2 else np.asarray(k) for k in (kp, kd))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-Kp, -Kd]])
    return np.array([(expm(A * x) @ np.r_[e, de])[:n] for x in t])


def errors(law, run):
    """What the law says of its errors along a motion."""
    return np.array([law.error(t, q, dq)[0] for t, q, dq in zip(run.times, run.q, run.dq, strict=True)])


def tasks(law, run):
    """The same of task-space laws, error and its rate."""
    found = [law.task(t, q, dq) for t, q, dq in zip(run.times, run.q, run.dq, strict=True)]
    return np.array([x.error for x in found]), np.array([x.error_rate for x in found])
