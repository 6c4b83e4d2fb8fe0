"""A robot and Pinocchio's model of it, side by side."""

from __future__ import annotations

import numpy as np

from twistwrench.robot import convert

TOLERANCE = 1e-9
"""Relative: both sides are the same recursion on the same numbers; inertias went through the centre of mass."""


def same_torques(robot, model, pinocchio, states=2):
    data, rng = model.createData(), np.random.default_rng(0)
    for _ in range(states):
        q = robot.random_configuration(rng)
        dq, ddq = rng.uniform(-1, 1, (2, robot.nv))
        theirs = pinocchio.rnea(model, data, *convert.to_pinocchio(robot, model, q, dq, ddq))
        tau = convert.pinocchio_rates(robot, model).T @ theirs
        ours = robot.reference("inverse_dynamics", q, dq, ddq)
        np.testing.assert_allclose(ours, tau, rtol=0, atol=TOLERANCE * max(np.abs(tau).max(initial=0.0), 1e-6))
        pinocchio.framesForwardKinematics(model, data, convert.to_pinocchio(robot, model, q)[0])
        for i, frame in enumerate(model.frames):
            if frame.type == pinocchio.FrameType.BODY and frame.name in robot.link_names:
                T = robot.reference("forward_kinematics", q, frame=frame.name)
                np.testing.assert_allclose(T, data.oMf[i].homogeneous, atol=TOLERANCE)
