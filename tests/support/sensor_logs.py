"""Logs of a known tool with what real sensors do: errors of each pose, drift, delay, unequal channels, wrong gains."""

from __future__ import annotations

import numpy as np

import twistwrench as tw
from twistwrench.mechanics.lie import quaternion
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.poses import propose_poses
from twistwrench.sensing.sensor import ForceTorqueSensor, gravity_in_frame
from twistwrench.sensing.simulated_logs import lively_motion

BIAS = np.array([0.1, 0.2, -0.3, 5.0, -3.0, 8.0])
COM = np.array([0.02, -0.01, 0.1])
MASS = 3.0
INERTIA = np.diag([0.02, 0.025, 0.01])
NOISES = (0.01, 0.3)
"""Of moments [N m] and forces [N]."""
NOISE = np.repeat(NOISES, 3)
UNEQUAL = np.array([0.005, 0.01, 0.05, 0.05, 0.05, 0.5])
TRUTH = np.array([*BIAS, MASS, *(MASS * COM)])
TOOL = ForceTorqueSensor(tw.SpatialInertia.from_com(MASS, COM, INERTIA), BIAS)
AT_REST = ForceTorqueSensor(tw.SpatialInertia.from_com(MASS, COM), BIAS)


def tool(mass=MASS, sign="on_sensor", mounting=None):
    """A sensor with the tool, of another mass, sign or mounting."""
    load = tw.SpatialInertia.from_com(mass, COM, INERTIA)
    return ForceTorqueSensor(load, BIAS, sign, np.eye(3) if mounting is None else mounting)


def dwells(rng, poses=12, samples=100, error=0.0, noise=NOISE, turned=False, mounting=0.0):
    """Poses x samples at rest; each pose has an error of ``error`` sigma, of the readings, or turned, of its orientation.

    ``mounting``: degrees by which the sensor's axes are turned.
    """
    g = propose_poses(poses).gravity
    felt = g + np.cross(rng.normal(size=g.shape) * error * noise[3] / (MASS * 9.81), g) if turned else g
    axes = tw.so3.exp(np.radians(mounting) * np.array([0.6, -0.64, 0.48]))
    exact = ForceTorqueSensor(AT_REST.load, BIAS, mounting=axes).predict(np.eye(3), gravity=felt)
    if not turned:
        exact = exact + error * noise * rng.normal(size=exact.shape)
    readings = np.repeat(exact, samples, axis=0) + noise * rng.normal(size=(poses * samples, 6))
    return ReadingLog.from_arrays(readings, gravity=np.repeat(g, samples, axis=0))


def motion(rng, seconds=6.0, count=300, late=0.0, noise=NOISE, sensor=TOOL):
    """A lively motion whose readings come ``late`` [s]."""
    t = np.linspace(0.0, seconds, count)
    T, V, dV = lively_motion(t)
    then = lively_motion(t - late)
    readings = sensor.predict(then[0], then[1], then[2]) + noise * rng.normal(size=(count, 6))
    return ReadingLog.from_arrays(readings, gravity=gravity_in_frame(T), V=V, dV=dV, time=t)


def drifting(rng, count=100, walk=0.25):
    """Like a log of an industrial sensor that warms up: many poses, one reading each, a bias that wanders and settles."""
    q = rng.normal(size=(count, 4))
    R = quaternion.rotation(q / np.linalg.norm(q, axis=1, keepdims=True))
    t = 5.0 * np.arange(count)
    bias = np.cumsum(walk * NOISE * rng.normal(size=(count, 6)), axis=0) + np.outer(1 - np.exp(-t / 200), 8 * NOISE)
    readings = AT_REST.predict(R) + bias + 0.1 * NOISE * rng.normal(size=(count, 6))
    return ReadingLog.from_arrays(readings, pose=R, time=t)
