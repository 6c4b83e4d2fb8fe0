"""The book's functions and its Newton-Euler pass: complete answers on record."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from recorded_answers import Records, refusal
from recorded_robots import GRAVITY, chain, coupled, driven, floating, placed, state, tree

import twistwrench.modern_robotics as mr
from twistwrench.mechanics.lie import compiled_forms, se3, so3
from twistwrench.modern_robotics import chains, checks, names
from twistwrench.robot import Robot

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

w = np.array([0.31, -0.52, 0.87])
W3 = np.array([[0.31, -0.52, 0.87], [1.9, 0.4, -0.7], [0.0, 0.0, 0.0]])
V = np.array([0.31, -0.52, 0.87, 1.4, -2.3, 0.6])
V3 = np.concatenate([W3, [[1.4, -2.3, 0.6], [0.2, 3.1, -1.1], [0.5, -1.5, 2.5]]], axis=1)
R, T = so3._exp(w), se3._exp(V)
R3, T3 = so3._exp(W3), se3._exp(V3)

# A chain of three joints, of which the last one slides
M = [
    placed((0.1, 0.3, -0.2), (0.1, 0.2, 0.4)),
    placed((-0.4, 0.2, 0.5), (0.3, -0.1, 0.2)),
    placed((0.2, -0.6, 0.1), (0.05, 0.4, 0.1)),
    placed((0.3, 0.1, 0.7), (0.2, 0.1, -0.3)),
]
Mlist = np.array(M)
Glist = np.array([[*np.diag([0.02 + 0.01 * k, 0.03, 0.025 + 0.002 * k, 1.0 + k, 1.0 + k, 1.0 + k])] for k in range(3)])
Slist = np.array(
    [[0.0, 0.6, -0.8, 0.1, 0.4, 0.3], [2 / 3, -1 / 3, 2 / 3, -0.2, 0.5, 0.1], [0.0, 0.0, 0.0, 0.6, 0.0, 0.8]]
).T
Blist = np.array([[0.6, 0.0, 0.8, 0.2, -0.3, 0.5], [0.0, 1.0, 0.0, 0.7, 0.1, -0.4], [0.0, 0.0, 0.0, 0.0, 0.8, 0.6]]).T
q, dq, ddq, tau = (np.array(x) for x in ([0.4, -0.7, 0.3], [0.9, 0.5, -1.1], [2.0, -1.5, 0.7], [3.0, -2.0, 4.0]))
q2, dq2, ddq2, tau2 = (np.stack([x, 0.5 * x[::-1]]) for x in (q, dq, ddq, tau))
Ftip = np.array([0.7, -1.9, 2.3, -4.1, 0.9, 3.3])
lists = (Mlist, Glist, Slist)


@pytest.fixture(scope="module", autouse=True)
def not_compiled():
    """The NumPy formulas of exp and log, and new chains, whatever other tests have compiled."""
    chains._cached_chain.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled_forms, "compiler", None)
        yield
    chains._cached_chain.cache_clear()


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


@records.of
def functions_of_rotations():
    return {
        "RotInv": [mr.RotInv(R), mr.RotInv(R3)],
        "VecToso3": [mr.VecToso3(w), mr.VecToso3(W3)],
        "so3ToVec": [mr.so3ToVec(mr.VecToso3(w)), mr.so3ToVec(mr.VecToso3(W3))],
        "AxisAng3": [mr.AxisAng3(w), mr.AxisAng3(W3), mr.AxisAng3([0, 0, 0]), mr.AxisAng3([3e200, -4e200, 0.0])],
        "MatrixExp3": [mr.MatrixExp3(mr.VecToso3(w)), mr.MatrixExp3(mr.VecToso3(W3))],
        "MatrixLog3": [mr.MatrixLog3(R), mr.MatrixLog3(R3)],
        "ProjectToSO3": [mr.ProjectToSO3(R + 0.1), mr.ProjectToSO3(R3 - 0.1)],
        "DistanceToSO3": [
            mr.DistanceToSO3(R + 0.1),
            mr.DistanceToSO3(R3 - 0.1),
            mr.DistanceToSO3(-R),
            mr.DistanceToSO3(np.zeros((3, 3))),
        ],
        "TestIfSO3": [
            mr.TestIfSO3(R),
            mr.TestIfSO3(np.diag([1.0, 1, 1.0004])),
            mr.TestIfSO3(np.diag([1.0, 1, 1.0006])),
            mr.TestIfSO3(np.stack([R, -R])),
        ],
    }


@records.of
def logarithms_of_half_turns():
    axes = np.array(
        [
            [1.0, 0, 0],
            [-1.0, 0, 0],
            [0, -1.0, 0],
            [0.6, -0.8, 0],
            [-0.6, 0.8, 0],
            [0, 0.6, -0.8],
            [2 / 3, 1 / 3, -2 / 3],
            [1e-4, 1.0, -2e-4],
            [0.8, 0.6, 2e-3],
        ]
    )
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    turns = 2.0 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    poses = se3.pose(turns, [0.3, -0.5, 0.7])
    return {
        "rotations": [mr.so3ToVec(mr.MatrixLog3(one)) for one in turns],
        "many": mr.MatrixLog3(turns),
        "mixed": mr.MatrixLog3(np.stack([R, turns[3], np.eye(3), turns[5]])),
        "poses": [mr.se3ToVec(mr.MatrixLog6(one)) for one in poses],
        "many poses": mr.MatrixLog6(np.stack([T, *poses[[3, 5]]])),
        "identity": [mr.MatrixLog3(np.eye(3)), mr.MatrixLog6(np.eye(4))],
        "almost": mr.MatrixLog3(so3._exp(np.array([0, 0, -3.1415]))),
    }


@records.of
def functions_of_poses():
    return {
        "RpToTrans": [mr.RpToTrans(R, w), mr.RpToTrans(R3, W3), mr.RpToTrans(R, W3)],
        "TransToRp": [mr.TransToRp(T), mr.TransToRp(T3)],
        "TransInv": [mr.TransInv(T), mr.TransInv(T3)],
        "VecTose3": [mr.VecTose3(V), mr.VecTose3(V3)],
        "se3ToVec": [mr.se3ToVec(mr.VecTose3(V)), mr.se3ToVec(mr.VecTose3(V3))],
        "Adjoint": [mr.Adjoint(T), mr.Adjoint(T3)],
        "ad": [mr.ad(V), mr.ad(V3)],
        "ScrewToAxis": [
            mr.ScrewToAxis(w, [0.6, 0, -0.8], 0.3),
            mr.ScrewToAxis(W3, [0.6, 0, -0.8], [0.3, 0.5, 0.7]),
            mr.ScrewToAxis(W3, W3[::-1], 0.5),
        ],
        "AxisAng6": [mr.AxisAng6(V), mr.AxisAng6(V3), mr.AxisAng6([0, 0, 0, 3.0, -4.0, 0]), mr.AxisAng6([0.0] * 6)],
        "MatrixExp6": [mr.MatrixExp6(mr.VecTose3(V)), mr.MatrixExp6(mr.VecTose3(V3))],
        "MatrixLog6": [mr.MatrixLog6(T), mr.MatrixLog6(T3)],
        "ProjectToSE3": [mr.ProjectToSE3(T + 0.1), mr.ProjectToSE3(T3 + 0.1)],
        "DistanceToSE3": [mr.DistanceToSE3(T + 0.1), mr.DistanceToSE3(T3 - 0.1), mr.DistanceToSE3(-T)],
        "TestIfSE3": [
            mr.TestIfSE3(T),
            mr.TestIfSE3(T + np.diag([0, 0, 0, 0.0009])),
            mr.TestIfSE3(T + np.diag([0, 0, 0, 0.0011])),
            mr.TestIfSE3(np.stack([T, -T])),
        ],
        "NearZero": [mr.NearZero(x) for x in (0.9e-6, -0.9e-6, 1.1e-6, -1.1e-6, 1, np.array([0.0, 2e-6]))],
        "Normalize": [
            mr.Normalize(V),
            mr.Normalize(V3[:2]),
            mr.Normalize([3e200, -4e200]),
            mr.Normalize(2.0),
            mr.Normalize([1e-300, 0]),
        ],
    }


@records.of
def arguments_that_are_rounded_or_wrong():
    rounded_R, rounded_T = R.round(3), T.round(3)
    skew = mr.VecToso3(w)
    return {
        "rounded rotation": [mr.MatrixLog3(rounded_R), mr.RotInv(rounded_R)],
        "rounded pose": [mr.MatrixLog6(rounded_T), mr.TransInv(rounded_T)],
        "rough": [
            tried(lambda: mr.MatrixLog3(R.round(1))),
            tried(lambda: mr.MatrixLog6(T.round(1))),
            tried(lambda: mr.TransInv(T + np.diag([0, 0, 0, 0.02]))),
        ],
        "row of a batch": tried(lambda: mr.MatrixLog3(np.stack([R, 2 * R]))),
        "skew": [tried(lambda e=e: mr.so3ToVec(skew + e * np.eye(3))) for e in (1e-9, 0.004, 0.006)],
        "not skew": [
            tried(lambda: mr.MatrixExp3(R)),
            tried(lambda: mr.se3ToVec(T)),
            tried(lambda: mr.MatrixExp6(np.ones((4, 4)))),
            tried(lambda: mr.so3ToVec(np.stack([skew, skew + 1]))),
        ],
        "last row": [
            tried(lambda: mr.se3ToVec(mr.VecTose3(V) + np.diag([0, 0, 0, 1e-7]))),
            tried(lambda: mr.se3ToVec(mr.VecTose3(V) + np.diag([0, 0, 0, 1e-3]))),
        ],
        "tiny": [
            tried(lambda: mr.so3ToVec(1e-9 * np.ones((3, 3)))),
            tried(lambda: mr.so3ToVec(1e-4 * np.ones((3, 3)))),
        ],
        "shapes": [
            tried(lambda: mr.VecToso3([1, 2])),
            tried(lambda: mr.Adjoint(R)),
            tried(lambda: mr.ad([1, 2, 3])),
            tried(lambda: mr.RpToTrans(R3, W3[:2])),
            tried(lambda: mr.TransToRp(R)),
            tried(lambda: mr.ScrewToAxis(W3, W3[:2], 1.0)),
            tried(lambda: mr.AxisAng6(w)),
            tried(lambda: mr.AxisAng3(V)),
        ],
        "Normalize": [
            tried(lambda: mr.Normalize([0, 0, 0])),
            tried(lambda: mr.Normalize([np.nan, 1])),
            tried(lambda: mr.Normalize([])),
        ],
        "by name": [mr.MatrixLog3(R=R), mr.RpToTrans(p=w, R=R)],
        "calls": [
            tried(lambda: mr.MatrixLog3()),
            tried(lambda: mr.MatrixLog3(R, R)),
            tried(lambda: mr.RpToTrans(R, x=1)),
        ],
        "names": [
            mr.__all__,
            mr.MatrixLog3.__doc__,
            mr.InverseDynamics.__doc__.splitlines()[0],
            mr.JacobianBody.__doc__,
            names.named.__name__,
            checks.MAX_ROUNDING,
        ],
    }


@records.of
def kinematics_of_screws():
    M0 = placed((0.4, -0.2, 0.6), (0.3, 0.5, -0.1))
    return {
        "FKinBody": [mr.FKinBody(M0, Blist, q), mr.FKinBody(M0, Blist, q2)],
        "FKinSpace": [mr.FKinSpace(M0, Slist, q), mr.FKinSpace(M0, Slist, q2)],
        "JacobianBody": [mr.JacobianBody(Blist, q), mr.JacobianBody(Blist, q2)],
        "JacobianSpace": [mr.JacobianSpace(Slist, q), mr.JacobianSpace(Slist, q2)],
        "long screws": [mr.FKinSpace(M0, 2.0 * Slist, q), mr.JacobianSpace(2.0 * Slist, q)],
        "refused": [
            tried(lambda: mr.FKinBody(M0, Blist.T, q)),
            tried(lambda: mr.FKinSpace(M0, Slist[:, :0], q)),
            tried(lambda: mr.FKinSpace(M0[:3], Slist, q)),
            tried(lambda: mr.JacobianBody(Blist, q[:2])),
            tried(lambda: mr.JacobianSpace(Slist, 1.0)),
            tried(lambda: mr.FKinSpace(M0, 0 * Slist, q)),
        ],
    }


@records.of(relative=1e-6)
def inverse_kinematics_of_screws():
    M0 = placed((0.4, -0.2, 0.6), (0.3, 0.5, -0.1))
    in_space, in_body = mr.FKinSpace(M0, Slist, q), mr.FKinBody(M0, Blist, q)
    far = placed((2.0, 0.5, -1.0), (9.0, 8.0, 7.0))
    near = q + np.array([0.2, -0.1, 0.15])
    return {
        "body": mr.IKinBody(Blist, M0, in_body, near, 1e-8, 1e-8),
        "space": mr.IKinSpace(Slist, M0, in_space, near, 1e-8, 1e-8),
        "at once": [mr.IKinBody(Blist, M0, in_body, near, 9.0, 9.0), mr.IKinSpace(Slist, M0, in_space, near, 9.0, 9.0)],
        "one step": [
            mr.IKinBody(Blist, M0, in_body, near, 0.05, 9.0)[0],
            mr.IKinBody(Blist, M0, in_body, near, 9.0, 0.05)[0],
            mr.IKinSpace(Slist, M0, in_space, near, 9.0, 0.05)[0],
        ],
        "far": mr.IKinBody(Blist, M0, far, near, 1e-8, 1e-8)[1],
        "refused": [
            tried(lambda: mr.IKinBody(Blist, M0, 2 * in_body, near, 1e-3, 1e-3)),
            tried(lambda: mr.IKinSpace(Slist, 2 * M0, in_space, near, 1e-3, 1e-3)),
            tried(lambda: mr.IKinSpace(Slist, M0, in_space, near[:2], 1e-3, 1e-3)),
            tried(lambda: mr.IKinBody(Blist, M0, in_body, near * np.nan, 1e-3, 1e-3)),
            tried(lambda: mr.IKinBody(Blist, M0, in_body, near, -1e-3, 1e-3)),
            tried(lambda: mr.IKinSpace(Slist, M0, in_space, near, 1e-3, np.nan)),
            tried(lambda: mr.IKinBody(Blist.T, M0, in_body, near, 1e-3, 1e-3)),
        ],
    }


@records.of
def dynamics_of_chains():
    F2 = np.stack([Ftip, -0.5 * Ftip])
    g2 = np.array([GRAVITY, (0.0, 0.0, -9.81)])
    return {
        "InverseDynamics": [
            mr.InverseDynamics(q, dq, ddq, GRAVITY, Ftip, *lists),
            mr.InverseDynamics(q2, dq2, ddq2, GRAVITY, F2, *lists),
            mr.InverseDynamics(q, dq, ddq, g2, Ftip, *lists),
        ],
        "MassMatrix": [mr.MassMatrix(q, *lists), mr.MassMatrix(q2, *lists)],
        "VelQuadraticForces": [mr.VelQuadraticForces(q, dq, *lists), mr.VelQuadraticForces(q2, dq2, *lists)],
        "GravityForces": [mr.GravityForces(q, GRAVITY, *lists), mr.GravityForces(q2, GRAVITY, *lists)],
        "EndEffectorForces": [mr.EndEffectorForces(q, Ftip, *lists), mr.EndEffectorForces(q2, F2, *lists)],
        "ForwardDynamics": [
            mr.ForwardDynamics(q, dq, tau, GRAVITY, Ftip, *lists),
            mr.ForwardDynamics(q2, dq2, tau2, GRAVITY, F2, *lists),
        ],
        "EulerStep": [mr.EulerStep(q, dq, ddq, 0.1), mr.EulerStep(q2, dq2, ddq2, [0.1, 0.2])],
        "refused": [
            tried(lambda: mr.InverseDynamics(q[:2], dq, ddq, GRAVITY, Ftip, *lists)),
            tried(lambda: mr.InverseDynamics(q, dq, ddq, GRAVITY[:2], Ftip, *lists)),
            tried(lambda: mr.InverseDynamics(q, dq, ddq, GRAVITY, Ftip[:3], *lists)),
            tried(lambda: mr.InverseDynamics(q2, np.stack([dq] * 3), ddq, GRAVITY, Ftip, *lists)),
            tried(lambda: mr.MassMatrix(q, Mlist[:3], Glist, Slist)),
            tried(lambda: mr.MassMatrix(q, Mlist, Glist[:2], Slist)),
            tried(lambda: mr.MassMatrix(q, Mlist[0], Glist, Slist)),
            tried(lambda: mr.MassMatrix(q, Mlist, Glist, Slist.T)),
            tried(lambda: mr.MassMatrix(q, 2 * Mlist, Glist, Slist)),
            tried(lambda: mr.EulerStep(q2, dq2, np.ones((3, 3)), 0.1)),
        ],
        "rounded lists": mr.MassMatrix(q, Mlist.round(4), Glist, Slist),
    }


@records.of
def trajectories_of_torques_and_motions():
    rows = 5
    s = np.linspace(0.0, 1.0, rows)[:, None]
    thetas, rates, accelerations, torques = q * (1 + s), dq * (1 - s), ddq * s, tau * (1 - 0.5 * s)
    F = Ftip * s
    gains = ([20.0, 30.0, 40.0], 5.0, [9.0, 8.0, 7.0])
    desired = (thetas, rates, accelerations)
    other = (1.1 * np.array(GRAVITY), Mlist, 1.2 * Glist)
    return {
        "torques": [
            mr.InverseDynamicsTrajectory(*desired, GRAVITY, F, *lists),
            mr.InverseDynamicsTrajectory(*desired, GRAVITY, 0, *lists),
        ],
        "motion": [
            mr.ForwardDynamicsTrajectory(q, dq, torques, GRAVITY, F, *lists, 0.05, 3),
            mr.ForwardDynamicsTrajectory(q, dq, torques, GRAVITY, 0, *lists, 0.05, 1),
        ],
        "computed torque": [
            mr.ComputedTorque(q, dq, 0.1 * q, GRAVITY, *lists, 1.2 * q, 0.8 * dq, ddq, *gains),
            mr.ComputedTorque(q2, dq2, 0.1 * q2, GRAVITY, *lists, 1.2 * q2, 0.8 * dq2, ddq2, 20.0, 1.0, 3.0),
        ],
        "controlled": [
            mr.SimulateControl(q, dq, GRAVITY, F, *lists, *desired, *other, *gains, 0.05, 2),
            mr.SimulateControl(q, dq, GRAVITY, 0, *lists, *desired, *other, 20.0, 5.0, 9.0, 0.05, 1),
        ],
        "refused": [
            tried(lambda: mr.InverseDynamicsTrajectory(thetas, rates[:3], accelerations, GRAVITY, F, *lists)),
            tried(lambda: mr.InverseDynamicsTrajectory(q, dq, ddq, GRAVITY, 0, *lists)),
            tried(lambda: mr.InverseDynamicsTrajectory(*desired, GRAVITY, F[:2], *lists)),
            tried(lambda: mr.InverseDynamicsTrajectory(*desired, GRAVITY, 1.0, *lists)),
            tried(lambda: mr.ForwardDynamicsTrajectory(q2, dq2, torques, GRAVITY, F, *lists, 0.05, 3)),
            tried(lambda: mr.ForwardDynamicsTrajectory(q, dq2, torques, GRAVITY, F, *lists, 0.05, 3)),
            tried(lambda: mr.ForwardDynamicsTrajectory(q, dq, torques[:0], GRAVITY, 0, *lists, 0.05, 3)),
            tried(lambda: mr.ForwardDynamicsTrajectory(q, dq, torques, GRAVITY, F, *lists, 0.05, 0)),
            tried(lambda: mr.ForwardDynamicsTrajectory(q, dq, torques, GRAVITY, F, *lists, 0.05, 1.5)),
            tried(lambda: mr.ComputedTorque(q, dq, q, GRAVITY, *lists, q, dq, ddq, [1.0, 2.0], 1.0, 1.0)),
            tried(lambda: mr.ComputedTorque(q2, dq, np.ones((3, 3)), GRAVITY, *lists, q, dq, ddq, 1.0, 1.0, 1.0)),
            tried(lambda: mr.SimulateControl(q2, dq2, GRAVITY, F, *lists, *desired, *other, *gains, 0.05, 2)),
        ],
    }


@records.of
def time_scalings_and_paths():
    t = np.array([0.0, 0.5, 1.25, 2.0])
    answers = {
        "scalings": [f(2.0, t) for f in (mr.CubicTimeScaling, mr.QuinticTimeScaling)]
        + [f(2.0, 0.5) for f in (mr.CubicTimeScaling, mr.QuinticTimeScaling)]
        + [mr.CubicTimeScaling(2, 0.5), mr.QuinticTimeScaling([1.0, 2.0], 0.5)],
        "refused": [
            tried(lambda: mr.CubicTimeScaling(0.0, 0.5)),
            tried(lambda: mr.QuinticTimeScaling(-1.0, 0.5)),
            tried(lambda: mr.CubicTimeScaling([1.0, 0.0], t[:2])),
            tried(lambda: mr.JointTrajectory(q, dq, 2.0, 4, 4)),
            tried(lambda: mr.JointTrajectory(q, dq[:2], 2.0, 4, 3)),
            tried(lambda: mr.JointTrajectory(q2, dq2, 2.0, 4, 3)),
            tried(lambda: mr.JointTrajectory(q, dq, 2.0, 1, 3)),
            tried(lambda: mr.JointTrajectory(q, dq, 2.0, 2.5, 3)),
            tried(lambda: mr.JointTrajectory(q, dq, 0.0, 4, 3)),
            tried(lambda: mr.ScrewTrajectory(T, T3, 2.0, 4, 3)),
            tried(lambda: mr.CartesianTrajectory(2 * T, T, 2.0, 4, 3)),
        ],
    }
    half_turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    for method in (3, 5):
        answers[str(method)] = [
            mr.JointTrajectory(q, dq, 2.0, 4, method),
            mr.ScrewTrajectory(T, T3[1], 2.0, 4, method),
            mr.CartesianTrajectory(T, T3[1], 2.0, 4.0, method),
            mr.ScrewTrajectory(T, T @ half_turn, 2.0, 3, method)[1],
            mr.CartesianTrajectory(T, T @ half_turn, 2.0, 3, method)[1],
        ]
    return answers


@records.of
def passes_of_newton_and_euler():
    answers = {}
    for make in (tree, floating, driven, coupled):
        model = make()
        robot = Robot(model)
        state_of = state(model)[:3]
        frames = [name for name, frame in model.all_frames.items() if frame.body >= 0]
        plain = robot.newton_euler(*state_of)
        both = robot.newton_euler(
            *state_of,
            wrench_by_robot={frames[0]: Ftip, frames[-1]: -0.3 * Ftip},
            wrench_on_robot={frames[1]: 0.7 * Ftip},
        )
        answers[make.__name__] = [
            plain.V,
            plain.dV,
            plain.F,
            plain.tau,
            plain.of_wrenches,
            plain.of_drives,
            both.F,
            both.tau,
        ]
        if make in (coupled, floating):
            answers[f"{make.__name__}, as shown"] = both
    two = Robot(chain(2))
    answers["small"] = str(two.newton_euler(*state(chain(2))[:3])).splitlines()
    calls = {
        "many": lambda: two.newton_euler(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 2))),
        "short": lambda: two.newton_euler([0.0], [0.0, 0.0], [0.0, 0.0]),
        "not finite": lambda: two.newton_euler([0.0, np.nan], [0.0, 0.0], [0.0, 0.0]),
        "frame": lambda: two.newton_euler([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], wrench_by_robot={"nowhere": Ftip}),
    }
    return answers | {name: tried(call) for name, call in calls.items()}


@records.of
def newton_and_euler_of_closed_robots():
    from twistwrench.modern_robotics.newton_euler import newton_euler

    robot = Robot(chain(4))
    q4 = state(chain(4))[0]
    closed = robot.close("ground", "link1", rows="vx", pose=robot.forward_kinematics(q4))
    return tried(lambda: newton_euler(closed, *state(chain(4))[:3]))


@records.of
def chains_that_are_kept():
    chains._cached_chain.cache_clear()
    one = chains.chain_of(*lists)
    return {
        "same": [
            chains.chain_of(*lists) is one,
            chains.chain_of(Mlist, Glist, 1.0 * Slist) is one,
            chains.chain_of(Mlist, 2 * Glist, Slist) is one,
        ],
        "screws": [
            chains.screws_of(Slist, "Slist") is chains.screws_of(Slist, "Blist"),
            chains.screws_of(Slist, "Slist").n,
        ],
        "kernels": [one.kernel("pose") is one.kernel("pose"), sorted(chains._KERNELS)],
        "sizes": [one.n, chains.MAX_CACHED_CHAINS, chains.LISTS, chains.SIZES],
        "unit": tried(lambda: chains.chain_of(Mlist, Glist, 3.0 * Slist).n),
    }


@records.of
def plots_of_controlled_motions():
    import matplotlib

    matplotlib.use("Agg", force=True)
    import matplotlib.pyplot as plt

    shown = []
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(plt, "show", lambda: shown.append("shown"))
        rows = np.stack([q, 1.1 * q])
        mr.SimulateControl(
            q, dq, GRAVITY, 0, *lists, rows, 0 * rows, 0 * rows, GRAVITY, *lists[:2], 20.0, 1.0, 5.0, 0.05, 1, plot=True
        )
        axes = plt.gcf().axes[0]
        answer = {
            "shown": shown,
            "lines": [
                [line.get_label(), line.get_linestyle(), line.get_xdata(), line.get_ydata()] for line in axes.lines
            ],
            "colours": [
                axes.lines[0].get_color() == axes.lines[1].get_color(),
                axes.lines[0].get_color() == axes.lines[2].get_color(),
            ],
            "texts": [axes.get_xlabel(), axes.get_ylabel(), axes.get_title()],
        }
        plt.close("all")
    return answer


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
