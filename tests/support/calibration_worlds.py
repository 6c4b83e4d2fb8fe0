"""Arms whose geometry differs from their file, and measurements of them with noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import twistwrench as tw
from twistwrench.calibration.chain import Corrections, TipChain
from twistwrench.calibration.measurements import Measurements

NOISE, ANGLE = 5e-5, 2e-4
"""Standard deviations of a reading [m, rad]."""
BALL = tw.se3.pose(np.eye(3), [0.05, 0.03, 0.02])
"""Target on the tip, off the last axis."""
CENTRE = (0.2, 0.1, -1.5)
"""Fixed end of distances, in the base [m]."""
X = tw.se3.exp([0.3, -0.2, 1.0, 2.0, -1.0, 0.5])
"""Base in the tracker's frame."""


def screw(kind, axis, point):
    """Turning screw through a point, or sliding screw along an axis."""
    w = np.array(axis, float)
    return np.r_[w, np.cross(point, w)] if kind == "R" else np.r_[0, 0, 0, w]


def arm(*screws, reach=(0.6, 0.1, 0.2)):
    """Arm of screws with the tip at a point."""
    M, body = tw.se3.pose(np.eye(3), list(reach)), np.diag([0.01, 0.01, 0.01, 1.0, 1.0, 1.0])
    count = len(screws)
    return tw.from_screws(M, np.array(screws).T, [np.eye(4)] * count + [M], [body] * count, name="arm")


def planar(count):
    """Arm of turning joints with changing axes."""
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0)]
    places = [(0, 0, 0), (0, 0, 0.3), (0.3, 0, 0.3), (0.35, 0, 0.33), (0.6, 0, 0.33), (0.7, 0, 0.33), (0.75, 0, 0.33)]
    return arm(*(screw("R", a, p) for a, p in zip(axes[:count], places[:count], strict=True)), reach=(0.85, 0.1, 0.45))


def scara():
    """RRPR."""
    z = (0, 0, 1)
    return arm(
        screw("R", z, (0, 0, 0)), screw("R", z, (0.3, 0, 0)), screw("P", z, (0, 0, 0)), screw("R", z, (0.55, 0, 0))
    )


def rail():
    """Rail and three turning joints."""
    return arm(
        screw("P", (1, 0, 0), (0, 0, 0)), screw("R", (0, 0, 1), (0, 0, 0)), screw("R", (0, 1, 0), (0, 0, 0.3)),
        screw("R", (0, 1, 0), (0.4, 0, 0.3)),
    )  # fmt: skip


def gantry():
    """Three sliding joints."""
    return arm(*(screw("P", axis, (0, 0, 0)) for axis in np.eye(3)))


@dataclass(frozen=True)
class World:
    """Arm as it is, beside its file."""

    robot: tw.Robot
    chain: TipChain
    truth: Corrections
    rng: np.random.Generator

    @classmethod
    def drawn(cls, robot, seed, size=(1e-3, 2e-3), tip=None, ball=BALL, assume=(), sags=None):
        """Errors of lengths [m] and angles [rad] of all placements."""
        chain, rng = TipChain.from_robot(robot, tip, assume), np.random.default_rng(seed)
        x = np.where(chain.are_lengths, *size) * rng.normal(size=len(chain.parameters))
        x[6 * len(chain.joints) :] = 0.0
        at = chain.step(chain.start, x)
        at = replace(at, tip=at.tip @ ball, sags=at.sags if sags is None else np.array(sags))
        return cls(robot, chain, at, rng)

    def poses(self, q):
        """Poses of the target in the base."""
        return self.chain.tips(q, self.truth)

    def configurations(self, count):
        """Within the limits, and within half a turn."""
        lower, upper = np.maximum(self.robot.limits.lower, -3), np.minimum(self.robot.limits.upper, 3)
        return self.rng.uniform(lower, upper, (count, self.robot.nq))

    def measured(self, kind, count, noise=NOISE, angle=ANGLE):
        """Readings of a kind at random configurations."""
        return self.readings(kind, self.configurations(count), noise, angle)

    def readings(self, kind, q, noise=NOISE, angle=ANGLE):
        """Readings of a kind at configurations."""
        T, count = self.poses(q), len(q)
        e = noise * self.rng.normal(size=(count, 3))
        Y = X @ T
        if kind == "position":
            return Measurements(q, positions=Y[:, :3, 3] + e)
        if kind == "pose":
            turn = tw.so3.exp(angle * self.rng.normal(size=(count, 3)))
            return Measurements(q, poses=tw.se3.pose(turn @ Y[:, :3, :3], Y[:, :3, 3] + e))
        if kind == "distance":
            return Measurements(q, distances=np.linalg.norm(T[:, :3, 3] - CENTRE, axis=1) + e[:, 0])
        if kind == "pair":
            pairs = np.arange(count // 2 * 2).reshape(-1, 2)
            far = np.linalg.norm(T[pairs[:, 0], :3, 3] - T[pairs[:, 1], :3, 3], axis=1)
            return Measurements(q, pairs=pairs, distances=far + e[: len(pairs), 0])
        return Measurements(q, kind=kind)

    def touched(self, kind, count, noise=NOISE, targets=1):
        """Configurations at which the target touches points, planes or spheres, by Newton's method along the tip's Jacobian."""
        centre = self.poses(self.configurations(50))[:, :3, 3].mean(axis=0) + np.array([0.3, 0.0, 0.2])
        q = np.zeros((0, self.robot.nq))
        names = []
        for k in range(targets):
            found = self._touching(kind, centre + np.array([0.0, 0.0, 0.1 * k]), count // targets, noise)
            q, names = np.concatenate([q, found]), names + [f"t{k}"] * len(found)
        return Measurements(q, kind=kind, targets=names if targets > 1 else None)

    def _touching(self, kind, centre, count, noise):
        from twistwrench.calibration.chain import point_columns

        tries = 5 * count  # two of five end within the limits
        far = noise * self.rng.normal(size=(tries, 3))
        q = self.configurations(tries)
        chain, joints = replace(self.chain, assume=("sag",)), len(self.chain.joints)
        for _ in range(30):
            T, J = chain.poses(q, -np.ones((len(q), joints)), replace(self.truth, sags=np.zeros(joints)))
            linear, at = (
                point_columns(T, J)[:, :, 6 * joints : 7 * joints],
                T[:, :3, 3],
            )  # a sag under -1 N m turns the joint
            away = at - centre
            if kind == "point":
                e, D = away - far, linear
            elif kind == "plane":
                n = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
                e, D = (away @ n)[:, None] - far[:, :1], (n @ linear)[:, None]
            else:
                u = away / np.linalg.norm(away, axis=1)[:, None]
                e, D = np.linalg.norm(away, axis=1)[:, None] - 0.4 - far[:, :1], u[:, None] @ linear
            step = np.swapaxes(D, 1, 2) @ np.linalg.solve(
                D @ np.swapaxes(D, 1, 2) + 1e-6 * np.eye(D.shape[1]), e[..., None]
            )
            q[:, self.chain.columns] -= np.clip(step[..., 0], -0.3, 0.3)
        lower, upper = np.maximum(self.robot.limits.lower, -3.2), np.minimum(self.robot.limits.upper, 3.2)
        good = (np.abs(e).max(axis=1) < 1e-7) & ((q > lower) & (q < upper)).all(axis=1)
        assert good.sum() >= count
        return q[good][:count]

    def error(self, found, count=500):
        """True rms error of the calibrated tip [m], the base's rigid motion taken out."""
        q = self.robot.random_configuration(1, (count,))
        true, chain = self.poses(q)[:, :3, 3], found.fit.problem.chain
        has = chain.tips(q, found.fit.state.corrections)[:, :3, 3]
        a, b = true - true.mean(0), has - has.mean(0)
        U, _, V = np.linalg.svd(a.T @ b)
        R = U @ np.diag([1, 1, np.linalg.det(U @ V)]) @ V
        return float(np.sqrt(((a - b @ R.T) ** 2).sum(axis=1).mean()))
