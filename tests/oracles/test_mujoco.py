"""Robot files against MuJoCo, an engine of another school, in world axes about the centre of mass.

MuJoCo keeps each body's inertia as principal moments and a quaternion, found by an eigenvalue iteration; what it keeps
agrees with the file to 1e-9 or the robot is not compared (`peers`), because MuJoCo bounds and changes bodies
that cannot exist and drops massless ones. So TOLERANCE is 1e-8: 1e-9 in the inertias, with room for a chain of them. What
is measured lies near 1e-15.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from peers import mujoco_model
from robot_files import FILES, NONE, load

from twistwrench import ModelError, RobotFileError
from twistwrench.robot.convert import from_mujoco, mujoco_rates, to_mujoco
from twistwrench.testing import assert_close, random_state

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)

TOLERANCE = 1e-8
OF_INERTIAS = "positive eigenvalues|must satisfy A [+] B|mass and inertia of moving bodies|MuJoCo changes the body"
"""What MuJoCo says of bodies that it does not take as they are."""


@pytest.fixture(
    params=[
        pytest.param((n, b), id=f"{n}-{('fixed', 'floating')[b]}", marks=() if b == k % 2 else pytest.mark.slow)
        for k, n in enumerate(FILES)
        for b in (0, 1)
    ]
    or NONE
)
def pair(request):
    """A robot here and there; skipped where MuJoCo reads the file as another robot, or not at all."""
    name, floating_base = request.param
    robot = load(name, bool(floating_base))
    if robot.nv == 0:
        pytest.skip("nothing moves")
    try:
        return robot, mujoco_model(robot)
    except (RobotFileError, ModelError) as problem:
        assert re.search(OF_INERTIAS, str(problem)), (
            problem
        )  # anything else is not a rule of MuJoCo's, but a fault of ours
        pytest.skip("MuJoCo refuses the file, or changes its inertias")


def test_dynamics(pair):
    robot, model = pair
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    rng = np.random.default_rng(5)
    for _ in range(2):
        state = random_state(robot, rng)
        data.qpos[:], data.qvel[:], data.qacc[:] = to_mujoco(robot, model, *state)
        P = mujoco_rates(robot, model, state.q)
        mujoco.mj_inverse(model, data)
        tau = P.T @ data.qfrc_inverse
        assert_close(robot.reference("inverse_dynamics", *state), tau, TOLERANCE, "inverse dynamics")
        mujoco.mj_fullM(model, data, M)
        assert_close(robot.reference("mass_matrix", state.q), P.T @ M @ P, TOLERANCE, "mass matrix")
        h = P.T @ data.qfrc_bias
        if any(body.joint.kind == "floating" for body in robot.model.bodies):
            # Its velocities turn with the base: h there has M times the omega × v that ours has in the acceleration.
            still = to_mujoco(robot, model, state.q, state.dq, np.zeros(robot.nv))[2]
            h = h + P.T @ M @ still
        scale = max(np.abs(h).max(), np.abs(tau).max())
        assert_close(robot.reference("bias_forces", state.q, state.dq), h, TOLERANCE, "bias forces", scale=scale)
        back = from_mujoco(robot, model, *to_mujoco(robot, model, *state))
        for ours, theirs in zip(state, back, strict=True):
            assert_close(theirs, ours, TOLERANCE, "conversion there and back")


@pytest.mark.slow
def test_a_good_share_of_the_files_can_be_compared():
    """A loader that reads every file as something else would make every comparison skip."""
    compared = 0
    for name in FILES:
        try:
            mujoco_model(load(name, False))
            compared += 1
        except (ModelError, pytest.skip.Exception):
            pass
    assert compared >= 0.5 * len(FILES)
