"""Whether a joint is beyond its limit of position is one question with one answer, whoever asks."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

ARM = tw.robots.ur5()
ELBOW = ARM.joint_names.index("elbow_joint")
LIMIT, TOLERANCE = ARM.limits.upper[ELBOW], ARM.limits.tolerance[ELBOW]


def pose(past):
    q = np.zeros(6)
    q[ELBOW] = LIMIT + past
    return q


def violations(q):
    still = np.zeros((2, 6))
    motion = tw.Motion(np.array([0.0, 0.1]), np.stack([q, q]), still, still, robot=ARM)
    return any("elbow_joint" in str(v) and "position" in str(v) for v in motion.violations())


def simulation(q):
    try:
        run = ARM.simulate(q, np.zeros(6), 1e-3, dt=1e-3, method="rk4", limits="stop", tau=ARM.gravity_forces(q))
    except tw.ValueRangeError as problem:
        assert "elbow_joint" in str(problem)
        return True
    return not run.completed


def payload(q):
    done = CliRunner().invoke(main, ["payload", "ur5", "--at", f"elbow_joint={float(q[ELBOW])!r}"])
    return "OVER LIMIT: the robot cannot be in this pose: elbow_joint" in " ".join(done.output.split())


def lock(q):
    done = CliRunner().invoke(main, ["info", "ur5", "--lock", f"elbow_joint={float(q[ELBOW])!r}"])
    return "outside the joint's limits" in done.output


@pytest.mark.parametrize("asked", [violations, simulation, payload, lock])
def test_a_joint_is_beyond_its_limit_from_one_tolerance_on(asked):
    assert not asked(pose(0.0))
    assert not asked(pose(0.5 * TOLERANCE))
    assert asked(pose(2.0 * TOLERANCE))
