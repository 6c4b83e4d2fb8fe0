"""Derivatives against Pinocchio's, on robot files with fixed and floating bases.

Pinocchio's velocities are P times ours (`twistwrench.robot.convert`), and so are its tangent vectors: columns of its derivatives
by q go through P, too. Tolerances as in `test_oracles`.
"""

from __future__ import annotations

import numpy as np
import pytest
from robot_files import FILES, NONE, in_pinocchio, load

from twistwrench.robot.convert import pinocchio_rates, swap_halves, to_pinocchio
from twistwrench.testing import assert_close, derivative, random_state

pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)

TOLERANCE = 1e-10
DIFFERENCES = 1e-8
"""One differentiation is by differences of Pinocchio's derivatives, through the step of its integration."""
STATE = ("q", "dq", "ddq")
NAMES = [
    name
    for name in (
        "ur_description/ur5_robot",
        "panda_description/panda",
        "kinova_description/kinova",  # continuous joints
        "double_pendulum_description/double_pendulum_simple",
        "solo_description/solo12",
        "finger_edu_description/finger_edu",
        "borinot_description/borinot_flying_arm_2",
    )
    if name in FILES
]


class Case:
    """One robot in both libraries, at a state."""

    def __init__(self, name, floating_base):
        self.robot, self.model = load(name, floating_base), in_pinocchio(name, floating_base)
        self.data, self.P = self.model.createData(), pinocchio_rates(self.robot, self.model)
        self.state = random_state(self.robot, np.random.default_rng(12))
        self.theirs = to_pinocchio(self.robot, self.model, *self.state)


CASES = [(name, base) for name in NAMES for base in (False, True)]
QUICK = {("ur5_robot", False), ("kinova", False), ("kinova", True), ("solo12", True), ("borinot_flying_arm_2", True)}
"""Arms, continuous joints, legs, and floating bases; the others are slow."""


@pytest.fixture(
    params=[
        case if (case[0].rpartition("/")[2], case[1]) in QUICK else pytest.param(case, marks=pytest.mark.slow)
        for case in CASES
    ]
    or NONE,
    ids=lambda x: f"{x[0].rpartition('/')[2]}-{'floating' if x[1] else 'fixed'}",
)
def at(request, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    return Case(*request.param)


def rows(matrix):
    return swap_halves(np.reshape(matrix, (6, -1)), axis=0)


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_of_inverse_dynamics(at, mode):
    found = at.robot.kernel("inverse_dynamics", by=STATE, mode=mode)(*at.state)
    pin.computeRNEADerivatives(at.model, at.data, *at.theirs)
    M = np.triu(at.data.M) + np.triu(at.data.M, 1).T
    expected = [at.P.T @ x @ at.P for x in (at.data.dtau_dq, at.data.dtau_dv, M)]
    scale = max(np.abs(x).max() for x in expected)
    for ours, theirs, by in zip(found, expected, STATE, strict=True):
        assert_close(ours, theirs, TOLERANCE, f"∂τ/∂{by}", scale=scale)


def test_of_gravity(at):
    theirs = pin.computeGeneralizedGravityDerivatives(at.model, at.data, at.theirs[0])
    ours = at.robot.kernel("gravity_forces", by="q")(at.state.q)
    scale = max(np.abs(theirs).max(), np.abs(pin.computeGeneralizedGravity(at.model, at.data, at.theirs[0])).max())
    assert_close(ours, at.P.T @ theirs @ at.P, TOLERANCE, "∂g/∂q", scale=scale)


def test_of_centroidal_momentum(at):
    """Its matrix A is ∂h/∂dq; dA/dt dq and ∂h/∂q are Pinocchio's rates and derivatives."""
    q, dq, ddq = at.theirs
    A = pin.ccrba(at.model, at.data, q, dq)
    ours = at.robot.kernel("momentum_about_com", by="dq")(*at.state[:2])
    assert_close(ours, rows(A) @ at.P, TOLERANCE, "A")
    pin.dccrba(at.model, at.data, q, dq)
    by_q = at.robot.kernel("momentum_about_com", by="q")(*at.state[:2])
    scale = max(np.abs(by_q).max(), np.abs(A).max()) * np.abs(dq).sum()
    assert_close(by_q @ at.state.dq, rows(at.data.dAg @ dq)[:, 0], TOLERANCE, "dA/dt dq", scale=scale)
    theirs = pin.computeCentroidalDynamicsDerivatives(at.model, at.data, q, dq, ddq)[0]
    assert_close(by_q, rows(theirs) @ at.P, TOLERANCE, "∂h/∂q", scale=scale)


def test_of_the_centre_of_mass_and_of_poses(at):
    J = pin.jacobianCenterOfMass(at.model, at.data, at.theirs[0]).reshape(3, -1) @ at.P
    ours = at.robot.kernel("center_of_mass", by="q")(at.state.q)
    assert_close(ours, J, TOLERANCE, "∂com/∂q", scale=max(1.0, np.abs(J).max()))
    frame = at.robot.link_names[-1]
    number = at.model.getFrameId(frame, pin.BODY)
    pin.computeJointJacobians(at.model, at.data, at.theirs[0])
    pin.updateFramePlacements(at.model, at.data)
    J = rows(pin.getFrameJacobian(at.model, at.data, number, pin.LOCAL_WORLD_ALIGNED)) @ at.P
    dT = at.robot.kernel("forward_kinematics", frame=frame, by="q")(at.state.q)
    assert_close(dT[:3, 3], J[3:], TOLERANCE, "∂p/∂q", scale=max(1.0, np.abs(J).max()))


KINDS = {"body": pin.LOCAL, "space": pin.WORLD, "world_aligned": pin.LOCAL_WORLD_ALIGNED}


@pytest.mark.parametrize("kind", KINDS)
def test_of_jacobians(at, kind):
    """Pinocchio's kinematic Hessians of joints: ∂J_ij/∂q_k. Its Python hands a column-major tensor out as a row-major one."""
    q = at.theirs[0]
    pin.computeJointJacobians(at.model, at.data, q)
    pin.computeJointKinematicHessians(at.model, at.data)
    body = at.robot.model.bodies[-1]
    joint = at.model.getJointId(body.joint.name)
    H = pin.getJointKinematicHessian(at.model, at.data, joint, KINDS[kind])
    H = H.ravel().reshape(H.shape, order="F")
    H = np.einsum("ijk,jJ,kK->iJK", np.roll(H, 3, axis=0), at.P, at.P)
    ours = at.robot.jacobian_derivative(at.state.q, body.link, kind)
    assert_close(ours, H, TOLERANCE, f"∂J/∂q, {kind}", scale=max(1.0, np.abs(H).max()))
    chained = at.robot.kernel("jacobian", frame=body.link, kind=kind, by="q")(at.state.q)
    assert_close(chained, H, TOLERANCE, "by the chain rule", scale=max(1.0, np.abs(H).max()))


def test_second_derivatives_of_inverse_dynamics(at):
    """Differences of Pinocchio's first derivatives along its own integrate give the unsymmetric second derivative by q;
    half of it and half of its transpose is ours (docs/derivatives.md)."""
    n = at.robot.nv
    q, dq, ddq = at.theirs
    w = np.random.default_rng(13).normal(size=n)
    their_w = at.P @ w  # w·τ = w·P'τ*

    def gradients(u, a, b):
        found = []
        for k in range(len(u)):
            moved = pin.integrate(at.model, q, u[k])
            pin.computeRNEADerivatives(at.model, at.data, moved, dq + a[k], ddq + b[k])
            M = np.triu(at.data.M) + np.triu(at.data.M, 1).T
            found.append(np.concatenate([their_w @ x @ at.P for x in (at.data.dtau_dq, at.data.dtau_dv, M)]))
        return np.array(found)

    columns = []
    for e in np.eye(3 * n):
        u, a, b = (at.P @ x for x in np.split(e, 3))
        columns.append(derivative(lambda t, u=u, a=a, b=b: gradients(*(np.multiply.outer(t, x) for x in (u, a, b)))))
    iterated = np.stack(columns, axis=-1)
    product = at.robot.kernel("inverse_dynamics", by=STATE, form="hessian_along")
    ours = np.concatenate(product(*at.state, w, *np.split(np.eye(3 * n), 3, axis=1)), axis=-1)
    assert_close(ours, 0.5 * (iterated + iterated.T), DIFFERENCES, "second derivatives")
