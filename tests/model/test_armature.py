"""Armature: inertia of the drives that each velocity feels, as data of the model. It is on the diagonal of M, and where velocities
are those of a moving frame its products of velocities are in the bias."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.testing import assert_close, derivative, laws, random_robot, random_state

pytest_plugins = ("small_trees",)

ARMATURE = {"joint1": 0.3, "joint2": 0.05}


@pytest.fixture(scope="module")
def pair():
    arm = tw.robots.planar_2r()
    return arm, arm.with_armature(ARMATURE)


def test_every_quantity_of_motion_has_it_and_nothing_else(pair):
    arm, geared = pair
    a = np.array([0.3, 0.05])
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, dq, ddq = random_state(arm, rng)
        assert_close(geared.mass_matrix(q), arm.mass_matrix(q) + np.diag(a), 1e-14, "M")
        tau = geared.inverse_dynamics(q, dq, ddq)
        assert_close(tau, arm.inverse_dynamics(q, dq, ddq) + a * ddq, 1e-13, "τ")
        assert_close(geared.forward_dynamics(q, dq, tau), ddq, 1e-12, "FD∘ID")
        assert geared.kinetic_energy(q, dq) == pytest.approx(arm.kinetic_energy(q, dq) + 0.5 * a @ dq**2, rel=1e-14)
        assert geared.power_balance(q, dq, tau).motion == pytest.approx(-tau @ dq, rel=1e-12)
        for name in ("bias_forces", "coriolis_forces", "momentum", "coriolis_matrix"):
            assert_close(getattr(geared, name)(q, dq), getattr(arm, name)(q, dq), 1e-14, name)
        for name in ("gravity_forces", "center_of_mass", "potential_energy"):
            assert_close(getattr(geared, name)(q), getattr(arm, name)(q), 1e-14, name)
        terms = geared.closed_form(q, dq)
        assert_close(terms.inverse_dynamics(ddq), tau, 1e-12, "block matrices")
        carried, drives = geared.drive_torques(q, dq, ddq)
        assert_close(drives, a * ddq, 1e-13, "what the drives take")
        assert_close(carried + drives, tau, 1e-13, "sum of both")
        why = geared.explain(q, dq, ddq)
        assert_close(why.torque, tau, 1e-12, "explained")
        assert_close(why.contribution("armature"), a * ddq, 1e-14, "cause armature")


def test_derivatives_are_those_of_the_quantities(pair):
    _, geared = pair
    q, dq, ddq = random_state(geared, np.random.default_rng(2))
    tau = geared.inverse_dynamics(q, dq, ddq)
    by_q, by_dq, by_tau = geared.forward_dynamics_derivatives(q, dq, tau)
    assert_close(by_tau, np.linalg.inv(geared.mass_matrix(q)), 1e-12, "∂ddq/∂τ = M⁻¹")
    for k, e in enumerate(np.eye(2)):
        along = derivative(lambda t, e=e: geared.forward_dynamics(q + np.multiply.outer(t, e), dq, tau), 1.0)
        assert_close(by_q[:, k], along, 1e-7, "∂ddq/∂q")
        along = derivative(lambda t, e=e: geared.forward_dynamics(q, dq + np.multiply.outer(t, e), tau), 1.0)
        assert_close(by_dq[:, k], along, 1e-7, "∂ddq/∂dq")


def test_a_rotor_on_a_base_that_rests_is_an_armature():
    """Of a rotor whose axis stands still nothing but G² J is felt."""
    arm = tw.robots.pendulum()
    J, G = 2e-5, 100.0
    (joint,) = arm.joint_names
    rotor = {"ratio": G, "rotor": {"inertia": f"{J} kg m^2", "extra": True}}
    turned, geared = arm.with_actuators({"actuators": {joint: rotor}}), arm.with_armature({joint: G**2 * J})
    q, dq, ddq = random_state(arm, np.random.default_rng(3))
    assert_close(geared.inverse_dynamics(q, dq, ddq), turned.inverse_dynamics(q, dq, ddq), 1e-12, "rotor and armature")
    with pytest.raises(tw.ModelError, match="count twice"):
        geared.with_actuators({"actuators": {joint: rotor}})
    with pytest.raises(tw.ValueRangeError, match="count twice"):
        turned.with_armature({joint: 0.1})


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize("seed", range(3))
def test_trees_with_every_joint_type(seed):
    """By any algorithm: programs of M, of articulated bodies and of torques agree, and a massless end needs no mass."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, joints=5)
    a = rng.uniform(0.1, 1.0, robot.nv)
    geared = robot.with_armature({b.joint.name: a[b.places[1]] for b in robot.model.leaders})
    q, dq, ddq = random_state(robot, rng)
    tau = robot.inverse_dynamics(q, dq, ddq) + a * ddq + velocity_products(geared, dq)
    assert_close(geared.inverse_dynamics(q, dq, ddq), tau, 1e-11, "τ")
    assert_close(geared.mass_matrix(q), robot.mass_matrix(q) + np.diag(a), 1e-12, "M")
    assert_close(geared.forward_dynamics(q, dq, tau), ddq, 1e-8, "FD∘ID")
    from twistwrench.mechanics.algorithms.forward_dynamics import articulated_dynamics

    if not any(b.follows for b in geared.model.bodies):
        by_bodies = articulated_dynamics(geared.model, q.astype(object), dq.astype(object), tau.astype(object))
        assert_close(by_bodies.astype(float), ddq, 1e-8, "articulated bodies")


def velocity_products(robot, dq):
    """-[V, ·]' A V of each joint's own twist V, axis by axis: what an armature does beside A ddq."""
    found = np.zeros(robot.nv)
    for body in robot.model.leaders:
        mine, S = body.places[1], body.joint.axes
        momentum = robot.armature[mine] * dq[mine]
        found[mine] = [-momentum @ (S @ (tw.se3.ad(dq[mine] @ S) @ axis)) for axis in S]
    return found


def with_each_its_own(kind, seed):
    """A robot with one joint of a kind with several velocities in the midst, each with an armature of its own."""
    robot = random_robot(seed, joints=4, kinds=("revolute", "prismatic", kind))
    while not any(body.joint.kind == kind for body in robot.model.leaders):
        seed += 100
        robot = random_robot(seed, joints=4, kinds=("revolute", "prismatic", kind))
    a = np.random.default_rng(seed).uniform(0.5, 3.0, robot.nv)
    return robot.with_armature({body.joint.name: a[body.places[1]] for body in robot.model.leaders})


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize("kind", ["ball", "planar", "floating"])
@pytest.mark.parametrize("seed", mostly_slow(range(2), 2))
def test_velocities_of_a_moving_frame_bring_its_products(kind, seed):
    """Lagrange's equations from the energies alone, the power balance, and what a Coriolis matrix has to be."""
    robot = with_each_its_own(kind, seed)
    at = random_state(robot, np.random.default_rng(seed))
    q, dq, ddq = at
    assert np.abs(velocity_products(robot, dq)).max() > 1e-2
    for gap in (laws.lagrange_gap, laws.power_gap, laws.skewness_gap):
        assert gap(robot, at) < 1e-9, gap.__name__
    for gap in (laws.closed_form_gap, laws.coriolis_gap, laws.round_trip_gap):
        assert gap(robot, at) < 1e-10, gap.__name__
    tau = robot.inverse_dynamics(q, dq, ddq)
    assert_close(robot.mass_matrix(q) @ ddq + robot.bias_forces(q, dq), tau, 1e-11, "M ddq + h = τ")
    assert_close(robot.coriolis_forces(q, dq) + robot.gravity_forces(q), robot.bias_forces(q, dq), 1e-11, "c + g = h")
    products = velocity_products(robot, dq) + robot.armature * ddq
    assert_close(robot.drive_torques(q, dq, ddq)[1], products, 1e-12, "what the drives take")
    assert_close(robot.explain(q, dq, ddq).contribution("armature"), products, 1e-12, "cause armature")
    assert_close(robot.explain(q, dq, ddq).torque, tau, 1e-11, "explained")
    by_q, by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq)
    for k, e in enumerate(np.eye(robot.nv)):
        faster = derivative(lambda t, e=e: robot.inverse_dynamics(q, dq + np.multiply.outer(t, e), ddq), 1.0)
        assert_close(by_dq[:, k], faster, 1e-9, "∂τ/∂dq", scale=np.abs(tau).max())
        further = derivative(lambda t, e=e: robot.inverse_dynamics(robot.add(q, np.multiply.outer(t, e)), dq, ddq), 1.0)
        assert_close(by_q[:, k], further, 1e-7, "∂τ/∂q", scale=np.abs(tau).max())
    from twistwrench.mechanics.algorithms.forward_dynamics import articulated_dynamics

    by_bodies = articulated_dynamics(robot.model, q.astype(object), dq.astype(object), tau.astype(object))
    assert_close(by_bodies.astype(float), ddq, 1e-8, "articulated bodies")


@pytest.mark.parametrize("name", ["floating_box", "quadruped"])
def test_a_free_body_with_armature_keeps_its_energy(name):
    """No force but gravity: steps of fourth order hold K + P to their own error, which without the products grows with time."""
    robot = getattr(tw.robots, name)()
    free = next(body.joint.name for body in robot.model.leaders if body.joint.kind == "floating")
    geared = robot.with_armature({free: [0.3, 0.1, 0.2, 2.0, 5.0, 1.0]})
    rng = np.random.default_rng(4)
    run = geared.simulate(geared.random_configuration(rng), rng.uniform(-1, 1, geared.nv), duration=1.0, dt=2e-3)
    K = geared.kinetic_energy(run.q, run.dq)
    E = K + geared.potential_energy(run.q)
    assert np.ptp(E) < 1e-5 * np.ptp(K)


def test_equal_ones_of_a_ball_joint_have_no_products():
    robot = random_robot(3, joints=3, kinds=("ball",))
    geared = robot.with_armature(dict.fromkeys(robot.joint_names, 0.7))
    q, dq, _ = random_state(robot, np.random.default_rng(1))
    assert_close(geared.bias_forces(q, dq), robot.bias_forces(q, dq), 1e-13, "h")


def test_it_costs_nothing_where_there_is_none():
    """The same instructions, bit for bit, as a model whose armature is zero by an edit, and no more than before by count."""
    arm = tw.robots.ur5()
    none = arm.with_armature({"elbow_joint": 1.0}).with_armature({"elbow_joint": 0.0})
    one = arm.with_armature({"elbow_joint": 1.0})
    base = tw.robots.quadruped()
    free = base.joint_names[0]
    held = base.with_armature({free: 1.0}).with_armature({free: 0.0})
    for name, more in (("mass_matrix", 1), ("inverse_dynamics", 1), ("bias_forces", 0)):
        before = arm.program(name)
        assert none.program(name) == before
        assert held.program(name) == base.program(name)
        assert len(one.program(name).instructions) - len(before.instructions) <= more + 1  # the constant, and one fma


def test_an_actuator_file_gives_it_where_the_ratio_is_unknown():
    arm = tw.robots.planar_2r()
    entry = {"reflected_inertia": "300 kg cm^2"}
    assert arm.with_actuators({"actuators": {"joint2": entry}}).armature.tolist() == [0.0, 0.03]
    cart = tw.robots.cart_pole()
    sliding = cart.joint_names[0]
    assert cart.with_actuators({"actuators": {sliding: {"reflected_inertia": "2 kg"}}}).armature[0] == 2.0
    with pytest.raises(tw.ModelError, match="count twice"):
        arm.with_actuators({"actuators": {"joint2": {**entry, "rotor": {"inertia": "1 g cm^2", "extra": True}}}})
    geared = arm.with_armature({"joint2": 1.0})
    drives = {"joint2": {"reflected_inertia": "0 kg m^2", "rotor": {"inertia": "1 g cm^2", "extra": True}}}
    assert geared.with_actuators({"actuators": drives}).armature.tolist() == [0.0, 0.0]


def test_pinocchio_agrees():
    pin = pytest.importorskip("pinocchio")
    path = tw.robots.path_of("ur5")
    theirs = pin.buildModelFromUrdf(str(path))
    a = np.linspace(0.1, 0.6, 6)
    theirs.armature = a
    robot = tw.load(path, snap=0)
    geared = robot.with_armature(dict(zip(robot.joint_names, a, strict=True)))
    data = theirs.createData()
    q, dq, ddq = random_state(robot, np.random.default_rng(5))
    M = pin.crba(theirs, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    tau = pin.rnea(theirs, data, q, dq, ddq)
    assert_close(geared.mass_matrix(q), M, 1e-12, "M")
    assert_close(geared.inverse_dynamics(q, dq, ddq), tau, 1e-12, "τ")
    assert_close(geared.forward_dynamics(q, dq, tau), pin.aba(theirs, data, q, dq, tau), 1e-9, "ddq")
    assert geared.kinetic_energy(q, dq) == pytest.approx(pin.computeKineticEnergy(theirs, data, q, dq), rel=1e-12)


def test_equations_in_symbols_have_it(pair):
    pytest.importorskip("sympy")
    _, geared = pair
    for form in ("expanded", "named"):
        found = tw.symbolic.derive(geared, form=form)  # checked against the kernels before it is returned
        assert {"J_1", "J_2"} <= {p.name for p in found.parameters}


def test_simulation_keeps_the_energy_and_the_period(pair):
    """Small swings have ω² = K/(I + a)."""
    arm = tw.robots.pendulum()
    (joint,) = arm.joint_names
    I = float(arm.mass_matrix([0.0])[0, 0])
    geared = arm.with_armature({joint: 3.0 * I})
    q = np.array([0.3])
    tau = arm.forward_dynamics(q, [0.0], [0.0])
    assert_close(geared.forward_dynamics(q, [0.0], [0.0]), tau / 4, 1e-12, "a quarter of the acceleration")
    run = geared.simulate(q, [0.0], duration=0.5, dt=1e-3)
    E = geared.kinetic_energy(run.q, run.dq) + geared.potential_energy(run.q)
    assert np.ptp(E) < 1e-6 * max(1.0, abs(E[0]))


def test_edits_keep_it(pair):
    _, geared = pair
    assert geared.armature.tolist() == [0.3, 0.05]
    assert pickle.loads(pickle.dumps(geared)).armature.tolist() == [0.3, 0.05]
    assert geared.lock({"joint1": 0.2}).armature.tolist() == [0.05]
    assert geared.with_gravity((0, 0, 0)).armature.tolist() == [0.3, 0.05]
    assert geared.with_armature({"joint1": 0}).armature.tolist() == [0.0, 0.05]


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        ({"elbow": 1.0}, tw.UnknownNameError, "elbow"),
        ({"joint1": -1.0}, tw.ValueRangeError, "negative"),
        ({"joint1": np.nan}, tw.ValueRangeError, "finite"),
        ({"joint1": [1.0, 2.0]}, tw.ShapeError, "expected a number"),
        ({"joint1": "much"}, tw.ShapeError, "expected a number"),
        ([1.0], tw.ShapeError, "dict"),
    ],
)
def test_what_is_no_armature_is_refused(pair, given, error, says):
    with pytest.raises(error, match=says):
        pair[0].with_armature(given)
