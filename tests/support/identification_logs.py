"""Logs of robots whose parameters are known: Fourier motions, torques with friction, and noise that hangs together in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import twistwrench as tw


@dataclass
class KnownLog:
    """A log, and what is true of it by the names of the unknown parameters."""

    motion: tw.Motion
    drives: dict[str, np.ndarray]
    robot: tw.Robot

    def truth(self, found):
        """The true groups."""
        unknown = found.base.unknown
        values = unknown.file_values.copy() * 0
        own = dict(zip(self.robot.parameter_names, self.robot.parameters, strict=True))
        for k, name in enumerate(unknown.names):
            owner, _, kind = name.rpartition(".")
            if kind in self.drives:
                values[k] = self.drives[kind][self.robot.model.velocity_names.index(owner)]
            else:
                values[k] = own[name]
        return found.base.project(values)

    def changed(self, *, q=None, tau=None, rows=slice(None), of=None):
        """The same motion with other columns."""
        motion = self.motion
        q = motion.q if q is None else q
        tau = motion.tau if tau is None else tau
        return tw.Motion(
            motion.time[rows],
            q[rows],
            motion.dq[rows],
            motion.ddq[rows],
            tau[rows],
            robot=motion.robot,
            in_seconds=True,
        )


def fourier_states(robot, seconds, rate, rng, harmonics=5):
    """Times, positions, velocities and accelerations of a random Fourier series of each joint, about a radian wide."""
    t = np.arange(0, seconds, 1 / rate)
    w = 4 * np.pi * np.arange(1, harmonics + 1) / seconds
    a, b = rng.normal(size=(2, robot.nv, harmonics)) / np.arange(1, harmonics + 1)
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q = sin @ a.T + cos @ b.T
    dq = (cos * w) @ a.T - (sin * w) @ b.T
    ddq = -(sin * w**2) @ a.T - (cos * w**2) @ b.T
    return t, q, dq, ddq


def coloured(rows, columns, rate, rng, memory=0.03):
    """Noise of size 1 (rows, columns) that forgets itself in ``memory`` seconds."""
    from scipy.signal import lfilter

    keep = np.exp(-1 / rate / memory)
    white = rng.normal(size=(rows + 500, columns))
    return lfilter([np.sqrt(1 - keep**2)], [1, -keep], white, axis=0)[500:]


def known_log(robot, seed=0, *, seconds=20.0, rate=200.0, noise=0.03, of=None):
    """A log of ``robot``, read as one of ``of`` (the same joints, other numbers)."""
    rng = np.random.default_rng(seed)
    t, q, dq, ddq = fourier_states(robot, seconds, rate, rng)
    rigid = np.asarray(robot.inverse_dynamics(q, dq, ddq))
    size = np.sqrt((rigid**2).mean(axis=0))
    speed, acceleration = np.sqrt((dq**2).mean(axis=0)), np.sqrt((ddq**2).mean(axis=0))
    drives = {
        "motor_inertia": 0.05 * size / acceleration, "viscous": 0.05 * size / speed, "coulomb": 0.1 * size, "offset": 0.02 * size,
    }  # fmt: skip
    tau = rigid + drives["motor_inertia"] * ddq + drives["viscous"] * dq + drives["coulomb"] * np.tanh(dq / 0.05)
    tau = tau + drives["offset"] + noise * size * coloured(len(t), robot.nv, rate, rng)
    return KnownLog(tw.Motion(t, q, dq, ddq, tau, robot=of or robot, in_seconds=True), drives, robot)
