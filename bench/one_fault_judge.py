"""Independent judge of a log: Pinocchio on the robot's URDF, with its own differentiation; nothing of twistwrench is read.

The share is the largest of torque, velocity and measured torque of any joint, relative to its limit; a position beyond its
stops makes the word OVER LIMIT as well. A limit of 0, or a missing one, is no limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt
from tests.faulty_logs.truth import Array, States

from bench.one_fault_robots import ROBOTS, Mechanism

_CYCLES, _OF_RATE = 200.0, 0.2
"""Cut-off of the positions' filter, in cycles of the whole log, and at most this share of the log's rate."""
_ENDS = 3
"""Rows at each end whose second differences are not judged."""
_TOLERANCE = 1e-3
"""Share of a range by which rounding may pass a stop."""
UNREADABLE = "UNREADABLE"


class Limits(NamedTuple):
    """Limits of the joints, inf for none."""

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


class Judgement(NamedTuple):
    """Largest share of a limit, the word, and the share of the computed torques alone."""

    share: float
    word: str
    torque: float


@dataclass(frozen=True, eq=False)
class Judge:
    """Pinocchio's model of a robot, in the order of its own joints."""

    mechanism: Mechanism
    model: pin.Model
    names: tuple[str, ...]
    turns: Array
    limits: Limits

    @property
    def base(self) -> int:
        """Number of coordinates of a floating base: position, then roll, pitch and yaw."""
        return 6 if self.mechanism.floats else 0

    def configuration(self, x: Array) -> Array:
        """Pinocchio's configuration (nq,) of coordinates (base + joints,)."""
        q = pin.neutral(self.model)
        if self.base:
            q[:3] = x[:3]
            q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*x[3:6])).coeffs()
        for name, value in zip(self.names, x[self.base :], strict=True):
            joint = self.model.joints[self.model.getJointId(name)]
            if joint.nq == 1:
                q[joint.idx_q] = value
            else:
                q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
        return q

    def torques(self, x: Array, dx: Array, ddx: Array, base: tuple[Array, Array] | None = None) -> Array:
        """Torques (n, joints) of the joints' motors, with the file's damping and dry friction."""
        data, model = self.model.createData(), self.model
        places = np.array([model.joints[model.getJointId(name)].idx_v for name in self.names])
        tau = np.empty((len(x), len(self.names)))
        for k in range(len(x)):
            v, a = np.zeros(model.nv), np.zeros(model.nv)
            v[places], a[places] = dx[k, self.base :], ddx[k, self.base :]
            if base is not None:
                v[:6], a[:6] = base[0][k], base[1][k]
            tau[k] = pin.rnea(model, data, self.configuration(x[k]), v, a)[places]
        dry = np.sign(dx[:, self.base :]) * model.upperDryFrictionLimit[places]
        return tau + model.damping[places] * dx[:, self.base :] + dry

    def verdict(self, limits: Limits, x: Array, dx: Array, tau: Array, measured: Array | None) -> Judgement:
        """Share and word of a motion."""
        if not all(np.isfinite(part).all() for part in (x, dx, tau)):
            return Judgement(np.inf, UNREADABLE, np.inf)
        x, dx = x[:, self.base :], dx[:, self.base :]
        torque = float((np.abs(tau) / limits.effort).max())
        share = max(torque, float((np.abs(dx) / limits.velocity).max()))
        if measured is not None:
            share = max(share, float((np.abs(measured) / limits.effort).max()))
        slack = np.where(np.isfinite(limits.upper - limits.lower), _TOLERANCE * (limits.upper - limits.lower), 0.0)
        beyond = bool(((x < limits.lower - slack) | (x > limits.upper + slack)).any())
        return Judgement(share, "OVER LIMIT" if share > 1 or beyond else "OK", torque)

    def of_log(self, t: Array, x: Array, limits: Limits | None = None, measured: Array | None = None) -> Judgement:
        """Judgement of rows as they are written; rates by a low-pass filter and a spline."""
        limits = self.limits if limits is None else limits
        if not (np.isfinite(x).all() and np.isfinite(t).all() and len(t) > 2 * _ENDS + 6 and (np.diff(t) > 0).all()):
            return Judgement(np.inf, UNREADABLE, np.inf)
        step = float(np.median(np.diff(t)))
        rows = int(min((t[-1] - t[0]) / step + 1, 4 * len(t)))
        even = t[0] + step * np.arange(rows)
        even = even[even <= t[-1]]
        if len(even) < 2 * _ENDS + 20:
            return Judgement(np.inf, UNREADABLE, np.inf)
        x = CubicSpline(t, x)(even)
        b, a = butter(3, 2 * min(_CYCLES / len(even), _OF_RATE))
        x = filtfilt(b, a, x, axis=0)
        spline = CubicSpline(even, x)
        dx, ddx = spline(even, 1), spline(even, 2)
        inner = slice(_ENDS, -_ENDS)
        tau = self.torques(x[inner], dx[inner], ddx[inner], self._base_rates(spline, even[inner]))
        return self.verdict(limits, x[inner], dx[inner], tau, measured)

    def of_motion(self, motion: Callable[[Array], States], t: Array) -> Judgement:
        """Judgement of the exact motion."""
        x, dx, ddx = motion(t)
        tau = self.torques(x, dx, ddx, self._base_rates(lambda s: motion(s)[0], t))
        return self.verdict(self.limits, x, dx, tau, None)

    def _base_rates(self, path: Callable[[Array], Array], t: Array, h: float = 1e-3) -> tuple[Array, Array] | None:
        """Body twists of a floating base and their rates, by central differences."""
        if not self.base:
            return None
        q = [[self.configuration(x) for x in path(t + s * h)] for s in (-1, 0, 1)]
        back = np.array([pin.difference(self.model, a, b)[:6] for a, b in zip(q[0], q[1], strict=True)])
        ahead = np.array([pin.difference(self.model, a, b)[:6] for a, b in zip(q[1], q[2], strict=True)])
        return (back + ahead) / (2 * h), (ahead - back) / h**2


@cache
def judge_of(name: str) -> Judge:
    """Judge of a robot of the table."""
    mechanism = ROBOTS[name]
    root = [pin.JointModelFreeFlyer()] if mechanism.floats else []
    model = pin.buildModelFromUrdf(str(mechanism.path), *root)
    joints = [(str(model.names[k]), model.joints[k]) for k in range(1, model.njoints) if model.joints[k].nv == 1]
    at_q = np.array([joint.idx_q for _, joint in joints])
    at_v = np.array([joint.idx_v for _, joint in joints])
    winds = np.array([joint.nq == 2 for _, joint in joints])
    turns = np.array(["R" in joint.shortname().removeprefix("JointModel")[:1] for _, joint in joints])

    def known(values: Array) -> Array:
        return np.where((values > 0) & (values < 1e9), values, np.inf)

    lower = np.where(winds | (model.lowerPositionLimit[at_q] < -1e9), -np.inf, model.lowerPositionLimit[at_q])
    upper = np.where(winds | (model.upperPositionLimit[at_q] > 1e9), np.inf, model.upperPositionLimit[at_q])
    limits = Limits(lower, upper, known(model.upperVelocityLimit[at_v]), known(model.upperEffortLimit[at_v]))
    return Judge(mechanism, model, tuple(n for n, _ in joints), turns, limits)
