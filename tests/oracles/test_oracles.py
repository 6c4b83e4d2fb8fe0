"""Every robot file at hand against Pinocchio: fixed and floating base, random states, all quantities both can compute.

Residuals are relative by norm, per state: the largest difference over the largest entry of Pinocchio's result. TOLERANCE is
the project's promise; what is measured lies near 1e-15, a few hundred roundings. Forward dynamics is the exception: M⁻¹
multiplies rounding by the condition of M, which reaches 1e9 where fingers of grams hang on a torso.

The algorithms run on plain floats for one robot of six, on a fixed or a floating base by turns; on two they run compiled too,
and on all, on both bases, with ``-m slow``. That compiled ones agree with plain floats is the business of tests/kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from robot_files import FILES, NONE, in_pinocchio, load

from twistwrench import Robot
from twistwrench.robot.convert import from_pinocchio, pinocchio_rates, swap_halves, to_pinocchio
from twistwrench.testing import State, assert_close, random_state

pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)

TOLERANCE = 1e-10
STATES = 2
COMPILED = {
    ("ur_description/ur5_robot", False),
    ("double_pendulum_description/double_pendulum_continuous", True),  # continuous joints
}
"""Robots that run compiled without ``-m slow``, and True if on a floating base."""


@dataclass(frozen=True)
class Case:
    """One robot in both libraries."""

    robot: Robot
    model: object
    data: object
    P: np.ndarray
    """Pinocchio's velocities are P times ours."""
    states: tuple[State, ...]
    compiled: bool

    def ours(self, name, *arrays, **options):
        if self.compiled:
            return self.robot.kernel(name, **options)(*arrays)
        return self.robot.reference(name, *arrays, **options)

    def theirs(self, state):
        return to_pinocchio(self.robot, self.model, *state)

    @property
    def frames(self):
        names = self.robot.link_names
        return list(dict.fromkeys((names[0], names[len(names) // 2], names[-1])))

    def place(self, frame):
        """Pinocchio's number of the frame, and the frame."""
        number = self.model.getFrameId(frame, pin.BODY)
        return number, self.model.frames[number]


@cache
def case(name, floating_base, compiled):
    robot, model = load(name, floating_base), in_pinocchio(name, floating_base)
    rng = np.random.default_rng(11)
    states = tuple(random_state(robot, rng) for _ in range(STATES))
    return Case(robot, model, model.createData(), pinocchio_rates(robot, model), states, compiled)


def _parameters():
    for number, name in enumerate(FILES):
        for floating_base in (False, True):
            base = "floating" if floating_base else "fixed"
            # a twelfth on a fixed base, a twelfth on a floating one; the rest with -m slow, as all on the other base
            usual = number % 12 == 6 * floating_base
            marks = () if usual else pytest.mark.slow
            yield pytest.param((name, floating_base, False), id=f"{name}-{base}-floats", marks=marks)
            marks = () if (name, floating_base) in COMPILED else pytest.mark.slow
            yield pytest.param((name, floating_base, True), id=f"{name}-{base}-compiled", marks=marks)


@pytest.fixture(params=list(_parameters()) or NONE)
def at(request):
    found = case(*request.param)
    if found.robot.nv == 0:
        pytest.skip("nothing moves")
    return found


def test_the_equation_of_motion(at):
    for state in at.states:
        q, dq, ddq = at.theirs(state)
        tau = pin.rnea(at.model, at.data, q, dq, ddq)
        assert_close(at.ours("inverse_dynamics", *state), at.P.T @ tau, TOLERANCE, "inverse dynamics")
        M = np.triu(pin.crba(at.model, at.data, q))
        M = M + np.triu(M, 1).T
        assert_close(at.ours("mass_matrix", state.q), at.P.T @ M @ at.P, TOLERANCE, "mass matrix")
        h = pin.nonLinearEffects(at.model, at.data, q, dq)
        assert_close(at.ours("bias_forces", state.q, state.dq), at.P.T @ h, TOLERANCE, "bias forces")
        g = pin.computeGeneralizedGravity(at.model, at.data, q)
        # Where gravity is borne by the bearings alone g is the rounding of weights: relative to h, then.
        scale = max(np.abs(g).max(), np.abs(h).max())
        assert_close(at.ours("gravity_forces", state.q), at.P.T @ g, TOLERANCE, "gravity forces", scale=scale)


def test_forward_dynamics(at):
    for state in at.states:
        M = at.ours("mass_matrix", state.q)
        scale = np.sqrt(np.maximum(np.diagonal(M), 1e-300))
        if np.linalg.eigvalsh(M / np.outer(scale, scale)).min() < 1e-13 * at.robot.nv:
            pytest.skip("the mass matrix has no inverse")
        q, dq, ddq = at.theirs(state)
        tau = pin.rnea(at.model, at.data, q, dq, ddq)
        theirs = at.P.T @ pin.aba(at.model, at.data, q, dq, tau)
        allowed = max(TOLERANCE, 1e-15 * np.linalg.cond(M))
        assert_close(at.ours("forward_dynamics", state.q, state.dq, at.P.T @ tau), theirs, allowed, "forward dynamics")


def test_derivatives_of_inverse_dynamics(at):
    """Pinocchio's along its own tangent vectors, of which P makes ours."""
    state = at.states[0]
    found = at.ours("inverse_dynamics_derivatives", *state)
    theirs = pin.computeRNEADerivatives(at.model, at.data, *at.theirs(state))[:2]
    # Entries are torques per radian and per rad/s; one may vanish (of a body in free flight), the torques do not.
    scale = max(float(np.abs(x).max()) for x in (*theirs, pin.rnea(at.model, at.data, *at.theirs(state))))
    for ours, their, what in zip(found, theirs, ("by q", "by dq"), strict=True):
        assert_close(ours, at.P.T @ their @ at.P, TOLERANCE, f"∂τ {what}", scale=scale)


def matrix(rows):
    """A Jacobian of Pinocchio's with the angular part first; of a single joint it comes as a vector."""
    return swap_halves(np.reshape(rows, (6, -1)), axis=0)


KINDS = {"body": pin.LOCAL, "space": pin.WORLD, "world_aligned": pin.LOCAL_WORLD_ALIGNED}


def test_frames(at):
    state = at.states[0]
    q, dq, _ = at.theirs(state)
    pin.forwardKinematics(at.model, at.data, q, dq)
    pin.computeJointJacobiansTimeVariation(at.model, at.data, q, dq)
    pin.updateFramePlacements(at.model, at.data)
    for place, frame in enumerate(at.frames):
        number, _ = at.place(frame)
        pose = at.ours("forward_kinematics", state.q, frame=frame)
        assert_close(pose, at.data.oMf[number].homogeneous, TOLERANCE, f"pose of {frame}")
        kind, theirs = [*KINDS.items()][(place + at.robot.nv) % len(KINDS)]  # by turns
        J = matrix(pin.getFrameJacobian(at.model, at.data, number, theirs)) @ at.P
        scale = max(1.0, np.abs(J).max())  # a frame of the base has no Jacobian
        ours = at.ours("jacobian", state.q, frame=frame, kind=kind)
        assert_close(ours, J, TOLERANCE, f"{kind} Jacobian of {frame}", scale=scale)
        dJ = matrix(pin.getFrameJacobianTimeVariation(at.model, at.data, number, theirs)) @ at.P
        ours = at.ours("jacobian_rate", state.q, state.dq, frame=frame, kind=kind)
        scale = max(scale, np.abs(dJ).max())
        assert_close(ours, dJ, TOLERANCE, f"rate of the {kind} Jacobian of {frame}", scale=scale)


def test_wrenches_on_frames(at):
    state, frames = at.states[1], tuple(at.frames)
    q, dq, ddq = at.theirs(state)
    wrenches = 10 * np.random.default_rng(3).standard_normal((len(frames), 6))
    on_joints = [pin.Force.Zero() for _ in at.model.joints]
    for name, wrench in zip(frames, wrenches, strict=True):
        _, frame = at.place(name)
        on_joints[frame.parentJoint] += frame.placement.act(pin.Force(swap_halves(wrench)))
    tau = pin.rnea(at.model, at.data, q, dq, ddq, on_joints)
    ours = at.ours("inverse_dynamics", *state, *-wrenches, wrenches=frames)  # those on the robot are minus those by it
    assert_close(ours, at.P.T @ tau, TOLERANCE, "inverse dynamics under wrenches")


def test_energies_momentum_and_centre_of_mass(at):
    state = at.states[0]
    q, dq, _ = at.theirs(state)
    mass = sum(body.inertia.mass for body in at.robot.model.bodies)
    K = pin.computeKineticEnergy(at.model, at.data, q, dq)
    assert_close(at.ours("kinetic_energy", state.q, state.dq), K, TOLERANCE, "kinetic energy")
    P = pin.computePotentialEnergy(at.model, at.data, q)
    # A height near zero is the difference of heights of order 1 m.
    assert_close(at.ours("potential_energy", state.q), P, TOLERANCE, "potential energy", scale=max(abs(P), 10 * mass))
    if mass == 0:
        return
    com = pin.centerOfMass(at.model, at.data, q)
    assert_close(
        at.ours("center_of_mass", state.q), com, TOLERANCE, "centre of mass", scale=max(1.0, np.abs(com).max())
    )
    J = pin.jacobianCenterOfMass(at.model, at.data, q).reshape(3, -1) @ at.P
    assert_close(at.ours("com_jacobian", state.q), J, TOLERANCE, "Jacobian of the centre of mass")
    hg = pin.computeCentroidalMomentum(at.model, at.data, q, dq)
    ours = at.ours("momentum_about_com", state.q, state.dq)
    # Angular momentum about the centre of mass is that about the base less com × m v: relative to both.
    scale = np.abs(at.ours("momentum", state.q, state.dq)).max()
    assert_close(
        ours, np.r_[hg.angular, hg.linear], TOLERANCE, "centroidal momentum", scale=max(scale, np.abs(ours).max())
    )


def test_conversion_there_and_back(at):
    """Poses, not coordinates: angles kept as (cos, sin) come back within ±π."""
    state = at.states[0]
    q, dq, ddq = from_pinocchio(at.robot, at.model, *at.theirs(state))
    poses = [at.ours("link_poses", x) for x in (q, state.q)]
    assert_close(*poses, TOLERANCE, "poses")
    assert_close(dq, state.dq, TOLERANCE, "dq")
    assert_close(ddq, state.ddq, TOLERANCE, "ddq")
