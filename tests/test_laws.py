"""The laws of mechanics, on random trees of every joint kind.

Tolerances. ROUNDING: both sides are some thousand float64 operations on numbers of one size, 1e-16 each, so they agree to
1e-13 or better; 1e-11 leaves room for unlucky cancellation and is far below any wrong term, which is of order 1.
DIFFERENCES: one side is a derivative by differences of order six (see `twistwrench.testing.differences`), good to some
1e-12 of the function; 1e-9 leaves the same room.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings

from twistwrench import Ad, Robot, SpatialInertia, ad, laws, se3, so3
from twistwrench.algorithms.closed_form import closed_form
from twistwrench.errors import ValueRangeError
from twistwrench.model.joint import JOINT_KINDS
from twistwrench.model.model import BASE
from twistwrench.testing import (
    assert_close,
    derivative_along,
    random_builder,
    random_inertia,
    random_pose,
    random_robot,
    random_state,
    strategies,
)

ROUNDING, DIFFERENCES = 1e-11, 1e-9
ONE_DEGREE = ("revolute", "continuous", "prismatic", "helical", "mimic", "fixed")
KINDS = ("body", "space", "world_aligned")

TREES = {f"tree{seed}": {"rng": seed, "floating_base": seed % 3 == 0} for seed in range(12)}
TREES |= {kind: {"rng": 100, "joints": 4, "kinds": (kind,)} for kind in JOINT_KINDS}
SIMPLE_TREES = {f"one_degree{seed}": {"rng": seed, "joints": 6, "kinds": ONE_DEGREE} for seed in range(8)}

FOLLOWED = (0, 1, 2, 3, 5, 8, 9, 11)
"""Seeds that give robots with mimic joints."""


@pytest.fixture(autouse=True, scope="module")
def on_numpy():
    """Programs run on NumPy here: nothing to compile, and that compiled ones agree is another test's business."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWISTWRENCH_JIT", "0")
        yield


@cache
def tree(name):
    return random_robot(**(TREES | SIMPLE_TREES)[name])


@pytest.fixture(params=TREES)
def robot(request):
    return tree(request.param)


@pytest.fixture(params=SIMPLE_TREES)
def simple_robot(request):
    """A robot whose velocities are the rates of its coordinates."""
    return tree(request.param)


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def state(robot, rng):
    return random_state(robot, rng)


def frames(robot, count=3):
    """A few frames, the deepest among them."""
    return robot.frame_names[:: -max(1, len(robot.frame_names) // count)]


# ── the equation of motion ──


def test_inverse_dynamics_is_inertia_plus_coriolis_plus_gravity(robot, state):
    q, dq, ddq = state
    M, c, g = robot.mass_matrix(q), robot.coriolis_forces(q, dq), robot.gravity_forces(q)
    assert_close(robot.inverse_dynamics(q, dq, ddq), M @ ddq + c + g, ROUNDING, "τ = M q̈ + c + g")
    assert_close(robot.bias_forces(q, dq), c + g, ROUNDING, "h = c + g")


def test_inverse_dynamics_follows_from_the_energies(robot, state):
    assert laws.lagrange_gap(robot, state) < DIFFERENCES


def test_mass_matrix_is_symmetric_and_positive_definite(robot, state):
    M = robot.mass_matrix(state.q)
    assert (M == M.T).all()  # to the bit: the algorithm writes each entry twice
    assert np.linalg.eigvalsh(M).min() > 0


def test_kinetic_energy_is_half_the_square_of_velocity_in_the_mass_matrix(robot, state):
    q, dq, _ = state
    assert_close(robot.kinetic_energy(q, dq), 0.5 * dq @ robot.mass_matrix(q) @ dq, ROUNDING, "K")


def test_forward_dynamics_inverts_inverse_dynamics(robot, state):
    q, dq, ddq = state
    M = robot.mass_matrix(q)
    # Rounding in M grows by its condition when the system is solved.
    found = robot.forward_dynamics(q, dq, robot.inverse_dynamics(q, dq, ddq))
    assert_close(found, ddq, 1e-14 * np.linalg.cond(M) * robot.nv, "forward∘inverse")
    assert laws.round_trip_gap(robot, state) < ROUNDING


def test_power_of_the_joints_is_the_rate_of_the_energy(robot, state):
    assert laws.power_gap(robot, state) < DIFFERENCES


def test_coriolis_forces_are_quadratic_and_even_in_the_velocities(robot, state):
    q, dq, _ = state
    c = robot.coriolis_forces(q, dq)
    assert_close(robot.coriolis_forces(q, -dq), c, ROUNDING, "c(-dq) = c(dq)")
    assert_close(robot.coriolis_forces(q, 3 * dq), 9 * c, ROUNDING, "c(3 dq) = 9 c(dq)")


def test_closed_form_equals_the_recursions(robot, state, rng):
    q, dq, ddq = state
    wrenches = {frame: rng.standard_normal(6) for frame in frames(robot)}
    terms = closed_form(robot.model, q, dq, wrenches)
    assert_close(robot.mass_matrix(q), terms.M, ROUNDING, "M")
    scale = float(np.abs(terms.M).max())  # c vanishes for a single sliding joint
    assert_close(robot.coriolis_forces(q, dq), terms.c, ROUNDING, "c", scale=max(scale, np.abs(terms.c).max()))
    assert_close(robot.gravity_forces(q), terms.g, ROUNDING, "g")
    tau = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=wrenches)
    assert_close(tau, terms.inverse_dynamics(ddq), ROUNDING, "τ")


# ── the Coriolis matrix ──


def test_rate_of_the_mass_matrix_less_twice_coriolis_is_skew(robot, state):
    assert laws.skewness_gap(robot, state) < DIFFERENCES


def test_coriolis_matrix_times_velocity_is_the_coriolis_force(robot, state):
    assert laws.coriolis_gap(robot, state) < ROUNDING


def test_christoffel_symbols_are_those_of_the_mass_matrix(simple_robot, rng):
    robot = simple_robot
    q, dq, _ = random_state(robot, rng)
    gamma = robot.christoffel(q)
    dM = np.moveaxis(derivative_along(robot, robot.mass_matrix, q, np.eye(robot.nv)), 0, -1)  # ∂m_ij/∂θ_k
    scale = max(np.abs(dM).max(), np.abs(robot.mass_matrix(q)).max())
    first_kind = 0.5 * (dM + np.swapaxes(dM, 1, 2) - np.moveaxis(dM, 2, 0))  # MR eq. 8.12
    assert_close(gamma, first_kind, DIFFERENCES, "Γ", scale=scale)
    assert_close(gamma, np.swapaxes(gamma, 1, 2), ROUNDING, "Γ_ijk = Γ_ikj", scale=scale)
    assert_close(gamma @ dq, robot.coriolis_matrix(q, dq), ROUNDING, "C_ij = Σ Γ_ijk θ̇_k", scale=scale)


def test_christoffel_symbols_of_quasi_velocities_are_refused():
    with pytest.raises(ValueRangeError, match="is floating"):
        tree("floating").christoffel(tree("floating").neutral)


# ── kinematics ──


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_gives_the_twist_of_the_moving_frame(robot, state, kind):
    q, dq, _ = state
    for frame in frames(robot):
        T = robot.forward_kinematics(q, frame)
        dT = derivative_along(robot, lambda x, f=frame: robot.forward_kinematics(x, f), q, dq)
        in_frame, in_base = se3.inverse(T) @ dT, dT @ se3.inverse(T)
        twist = {
            "body": np.r_[so3.vee(in_frame[:3, :3]), in_frame[:3, 3]],  # [V_b] = T⁻¹ Ṫ
            "space": np.r_[so3.vee(in_base[:3, :3]), in_base[:3, 3]],  # [V_s] = Ṫ T⁻¹
            "world_aligned": np.r_[so3.vee(in_base[:3, :3]), dT[:3, 3]],
        }[kind]
        J = robot.jacobian(q, frame, kind)
        scale = max(1.0, np.abs(twist).max())  # a frame of the base has no twist; its pose is of order 1
        assert_close(J @ dq, twist, DIFFERENCES, f"J dq, {kind}, of {frame}", scale=scale)
        assert_close(robot.frame_velocity(q, dq, frame, kind), J @ dq, ROUNDING, "frame_velocity", scale=scale)


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_rate_is_its_derivative(robot, state, kind):
    q, dq, ddq = state
    for frame in frames(robot, 2):
        J, rate = robot.jacobian(q, frame, kind), robot.jacobian_rate(q, dq, frame, kind)
        along = derivative_along(robot, lambda x, f=frame: robot.jacobian(x, f, kind), q, dq)
        scale = max(1.0, np.abs(J).max(), np.abs(rate).max())
        assert_close(rate, along, DIFFERENCES, f"dJ/dt, {kind}, of {frame}", scale=scale)
        dV = robot.frame_acceleration(q, dq, ddq, frame, kind)
        assert_close(dV, J @ ddq + rate @ dq, ROUNDING, "dV = J ddq + dJ dq", scale=max(scale, np.abs(dV).max()))


def test_link_poses_are_the_forward_kinematics_of_each_link(robot, state):
    each = [robot.forward_kinematics(state.q, name) for name in robot.link_names]
    assert_close(robot.link_poses(state.q), each, ROUNDING, "link_poses")


def test_subtract_undoes_add(robot, rng):
    q, dv, _ = random_state(robot, rng, 50)
    dv *= 0.5  # rotations by less than π, within which the way back is unique
    assert_close(robot.subtract(robot.add(q, dv), q), dv, ROUNDING, "(q ⊕ v) ⊖ q")
    q1 = robot.random_configuration(rng, 50)
    back = robot.add(q, robot.subtract(q1, q))
    assert_close(robot.link_poses(back), robot.link_poses(q1), ROUNDING, "q ⊕ (q1 ⊖ q), as poses")


# ── momentum and centre of mass ──


def link_momenta(robot, q, dq):
    """Momentum of each link by itself, fused ones too, at the base origin; what stands still has none."""
    for name, G in robot.model.link_inertias.items():
        V = robot.frame_velocity(q, dq, name, "body")
        yield Ad(se3.inverse(robot.forward_kinematics(q, name))).T @ (G @ V)


def test_momentum_is_the_sum_over_the_links(robot, state):
    q, dq, _ = state
    P = robot.momentum(q, dq)
    assert_close(P, sum(link_momenta(robot, q, dq)), ROUNDING, "P = Σ Ad' G V")
    about = robot.momentum(q, dq, frame="com")
    assert_close(
        about[:3], P[:3] - np.cross(robot.center_of_mass(q), P[3:]), ROUNDING, "angular momentum about the com"
    )
    mass = sum(body.inertia.mass for body in robot.model.bodies)
    assert_close(about[3:], mass * robot.com_jacobian(q) @ dq, ROUNDING, "linear momentum = m v_com")


def test_rate_of_momentum_is_gravity_plus_what_comes_through_the_base(robot, state):
    q, dq, ddq = state
    along = derivative_along(robot, lambda x: robot.momentum(x, dq), q, dq)  # P is linear in dq: the rest is P(q, ddq)
    rate = along + robot.momentum(q, ddq)
    mass = sum(body.inertia.mass for body in robot.model.bodies)
    weight = mass * np.r_[np.cross(robot.center_of_mass(q), robot.gravity), robot.gravity]
    through = robot.joint_wrenches(q, dq, ddq)
    poses = body_poses(robot, q)
    reaction = sum(
        Ad(se3.inverse(poses[i])).T @ through[i] for i, b in enumerate(robot.model.bodies) if b.parent == BASE
    )
    assert_close(rate, weight + reaction, DIFFERENCES, "dP/dt", scale=max(np.abs(rate).max(), np.abs(weight).max()))


def test_center_of_mass_is_where_the_links_balance(robot, state):
    q, dq, _ = state
    moving = {n: G for n, G in robot.model.link_inertias.items() if robot.model.frames[n].body != BASE}
    mass = sum(G.mass for G in moving.values())
    places = [G.mass * (robot.forward_kinematics(q, n) @ np.r_[G.com, 1.0])[:3] for n, G in moving.items()]
    assert_close(robot.center_of_mass(q), sum(places) / mass, ROUNDING, "centre of mass")
    v = derivative_along(robot, robot.center_of_mass, q, dq)
    assert_close(robot.com_jacobian(q) @ dq, v, DIFFERENCES, "J dq = d com/dt", scale=max(1.0, np.abs(v).max()))


def test_gravity_forces_are_the_gradient_of_the_potential_energy(robot, state):
    gradient = derivative_along(robot, robot.potential_energy, state.q, np.eye(robot.nv))
    scale = max(np.abs(gradient).max(), abs(robot.potential_energy(state.q)))
    assert_close(robot.gravity_forces(state.q), gradient, DIFFERENCES, "g = ∂P/∂q", scale=scale)


# ── wrenches ──


def test_wrench_torques_are_the_transposed_jacobian_times_the_wrench(robot, state, rng):
    for frame in frames(robot):
        F = rng.standard_normal(6)
        expected = robot.jacobian(state.q, frame).T @ F
        assert_close(
            robot.wrench_torques(state.q, F, frame),
            expected,
            ROUNDING,
            "J_b' F",
            scale=max(1.0, np.abs(expected).max()),
        )


def test_power_of_a_wrench_is_the_same_in_every_frame(robot, state, rng):
    q, dq, _ = state
    frame = frames(robot)[0]
    F_b = rng.standard_normal(6)
    T_sb = robot.forward_kinematics(q, frame)
    F_s = Ad(se3.inverse(T_sb)).T @ F_b
    V_b, V_s = robot.frame_velocity(q, dq, frame, "body"), robot.frame_velocity(q, dq, frame, "space")
    scale = float(np.abs(F_s * V_s).max() + np.abs(F_b * V_b).max())
    assert_close(F_b @ V_b, F_s @ V_s, ROUNDING, "F_b'V_b = F_s'V_s", scale=scale)
    assert_close(robot.wrench_torques(q, F_b, frame) @ dq, F_b @ V_b, ROUNDING, "τ'dq = F'V", scale=scale)


def test_wrenches_by_the_robot_cost_torque_and_wrenches_on_it_save_it(robot, state, rng):
    q, dq, ddq = state
    a, b = frames(robot)[:2] if len(frames(robot)) > 1 else frames(robot) * 2
    by, on = {a: rng.standard_normal(6)}, {b: rng.standard_normal(6)}
    pushed = robot.jacobian(q, a).T @ by[a] - robot.jacobian(q, b).T @ on[b]
    tau = robot.inverse_dynamics(q, dq, ddq)
    got = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on)
    assert_close(got, tau + pushed, ROUNDING, "τ + J'F_by - J'F_on")
    holding = robot.holding_torques(q, wrench_by_robot=by, wrench_on_robot=on)
    assert_close(holding, robot.gravity_forces(q) + pushed, ROUNDING, "holding torques")
    back = robot.forward_dynamics(q, dq, got, wrench_by_robot=by, wrench_on_robot=on)
    assert_close(back, ddq, 1e-14 * robot.nv * np.linalg.cond(robot.mass_matrix(q)), "forward dynamics with wrenches")


def test_the_world_lifting_a_link_takes_its_weight_off_the_joints():
    """The sign of ``wrench_on_robot`` said once with numbers: an upward push of the weight at the com leaves no torque."""
    robot = random_robot(7, joints=1, kinds=("revolute",)).with_gravity((0, 0, -9.81))
    q, G = robot.random_configuration(1), robot.model.bodies[0].inertia
    lift = robot.forward_kinematics(q, "link1")[:3, :3].T @ (0, 0, 9.81 * G.mass)
    on = {"link1": np.r_[np.cross(G.com, lift), lift]}
    scale = np.abs(robot.gravity_forces(q)).max()
    assert_close(robot.holding_torques(q, wrench_on_robot=on), [0.0], ROUNDING, "nothing left to hold", scale=scale)
    assert_close(robot.holding_torques(q, wrench_by_robot=on), 2 * robot.gravity_forces(q), ROUNDING, "twice to hold")


# ── across the joints ──


def body_poses(robot, q):
    """T_s,body for each body: its frame is that of the link its joint carries."""
    names = {f.body: n for n, f in robot.model.frames.items() if f.body != BASE and np.array_equal(f.pose, np.eye(4))}
    return [robot.forward_kinematics(q, names[i]) for i in range(len(robot.model.bodies))]


def test_joint_wrenches_projected_on_the_axes_are_the_torques(robot, state):
    F = robot.joint_wrenches(*state)
    tau = np.zeros(robot.nv)
    for body, wrench in zip(robot.model.bodies, F, strict=True):
        tau[body.v_index : body.v_index + body.joint.nv] += body.ratio * (body.joint.axes @ wrench)
    assert_close(tau, robot.inverse_dynamics(*state), ROUNDING, "A'F = τ")


def test_every_body_is_in_balance(robot, state, rng):
    """What comes through its joint, less what it passes on, moves the body: F = G dV - ad(V)' G V, MR eq. 8.40."""
    q, dq, ddq = state
    by = {frames(robot)[0]: rng.standard_normal(6)}
    F, poses = robot.joint_wrenches(q, dq, ddq, wrench_by_robot=by), body_poses(robot, q)
    names = {f.body: n for n, f in robot.model.frames.items() if np.array_equal(f.pose, np.eye(4))}
    for i, body in enumerate(robot.model.bodies):
        V = robot.frame_velocity(q, dq, names[i], "body")
        dV = robot.frame_acceleration(q, dq, ddq, names[i], "body")
        dV = dV - np.r_[np.zeros(3), poses[i][:3, :3].T @ robot.gravity]
        needed = body.inertia @ dV - ad(V).T @ (body.inertia @ V)
        left = F[i].copy()
        for j, other in enumerate(robot.model.bodies):
            if other.parent == i:
                left -= Ad(se3.inverse(poses[j]) @ poses[i]).T @ F[j]
        for frame, F_by in by.items():
            if robot.model.frames[frame].body == i:
                left -= Ad(se3.inverse(robot.model.frames[frame].pose)).T @ F_by
        assert_close(left, needed, ROUNDING, f"body {i}", scale=np.abs(F).max())


# ── robots made of robots ──


@pytest.mark.parametrize("seed", range(4))
def test_a_payload_equals_a_link_fixed_there(seed):
    load, frame = random_inertia(seed + 50), "link4"
    builder = random_builder(seed, joints=5)
    bare = Robot(builder.build())
    builder.add_link("load", load)
    builder.add_joint("grip", "fixed", frame, "load")
    built, state = Robot(builder.build()), random_state(bare, seed)
    assert_close(bare.with_payload(load, frame).inverse_dynamics(*state), built.inverse_dynamics(*state), ROUNDING, "τ")
    by = robot_tau_of_load(bare, state, load, frame)
    assert_close(
        built.inverse_dynamics(*state), bare.inverse_dynamics(*state) + by, ROUNDING, "τ, the load as a wrench"
    )


def robot_tau_of_load(robot, state, G, frame):
    """The torques that move a load, from the load's own equation of motion."""
    q, dq, ddq = state
    V, dV = robot.frame_velocity(q, dq, frame), robot.frame_acceleration(q, dq, ddq, frame)
    dV = dV - np.r_[np.zeros(3), robot.forward_kinematics(q, frame)[:3, :3].T @ robot.gravity]
    return robot.jacobian(q, frame).T @ (G @ dV - ad(V).T @ (G @ V))


@pytest.mark.parametrize("seed", FOLLOWED)
def test_a_follower_is_an_independent_joint_held_to_its_leader(seed):
    options = {"joints": 8, "kinds": ("revolute", "prismatic", "helical", "mimic", "floating", "planar")}
    follow, free = random_robot(seed, **options), random_robot(seed, **options, mimic="independent")
    assert follow.nv < free.nv
    P, q_free = constraint(follow, free)
    q, dq, ddq = random_state(follow, seed)
    x = q_free(q)
    assert_close(follow.link_poses(q), free.link_poses(x), ROUNDING, "poses")
    tau = free.inverse_dynamics(x, P @ dq, P @ ddq)
    assert_close(follow.inverse_dynamics(q, dq, ddq), P.T @ tau, ROUNDING, "τ = τ_leader + Σ ratio τ_follower")
    assert_close(follow.mass_matrix(q), P.T @ free.mass_matrix(x) @ P, ROUNDING, "M = P' M P")


def constraint(follow, free):
    """P with dq_free = P dq, and the function from q to q_free."""
    P = np.zeros((free.nv, follow.nv))
    pairs = list(zip(follow.model.bodies, free.model.bodies, strict=True))
    for mine, theirs in pairs:
        rows, columns = slice(theirs.v_index, None), slice(mine.v_index, mine.v_index + mine.joint.nv)
        P[rows, columns][: mine.joint.nv] = mine.ratio * np.eye(mine.joint.nv)

    def q_free(q):
        x = free.neutral
        for mine, theirs in pairs:
            part = q[mine.q_index : mine.q_index + mine.joint.nq]
            x[theirs.q_index : theirs.q_index + mine.joint.nq] = (
                mine.ratio * part + mine.offset if mine.follows else part
            )
        return x

    return P, q_free


@pytest.mark.parametrize("seed", range(8))
def test_a_locked_joint_is_a_joint_at_rest(seed):
    robot = random_robot(seed, joints=7, floating_base=seed % 2 == 0)
    chosen = [b for b in robot.model.leaders if b.joint.name != "root_joint"][::2]
    q, dq, ddq = random_state(robot, seed)
    held = np.zeros(robot.nv, bool)
    held_q = np.zeros(robot.nq, bool)
    for body in chosen:
        held[body.v_index : body.v_index + body.joint.nv] = True
        held_q[body.q_index : body.q_index + body.joint.nq] = True
    locked = robot.lock({b.joint.name: q[b.q_index : b.q_index + b.joint.nq] for b in chosen})
    dq[held] = ddq[held] = 0.0
    free = ~held
    # Locking snaps rotations to 1e-9 at most, and only if an entry happens to be that near 0 or ±1.
    assert_close(
        locked.mass_matrix(q[~held_q]), robot.mass_matrix(q)[np.ix_(free, free)], 1e-8, "M, without the held rows"
    )
    tau = locked.inverse_dynamics(q[~held_q], dq[free], ddq[free])
    assert_close(tau, robot.inverse_dynamics(q, dq, ddq)[free], 1e-8, "τ of the free joints")


@pytest.mark.parametrize("seed", range(4))
def test_dynamics_do_not_depend_on_where_the_base_stands(seed):
    """A robot on a tilted and shifted base, gravity tilted with it, feels nothing of it."""
    robot, tilt = random_robot(seed), random_pose(seed)
    builder = random_builder(seed)
    builder.add_link("ground")
    builder.add_joint("foot", "fixed", "ground", "link0", placement=tilt)
    tilted = Robot(builder.build(gravity=tilt[:3, :3] @ robot.gravity))
    state = random_state(robot, seed)
    assert_close(tilted.inverse_dynamics(*state), robot.inverse_dynamics(*state), 1e-8, "τ")  # 1e-8: tilted poses snap
    assert_close(
        tilted.forward_kinematics(state.q, "link3"), tilt @ robot.forward_kinematics(state.q, "link3"), 1e-8, "T"
    )


# ── friction ──


def test_friction_is_left_out_unless_asked_for_and_always_takes_power(robot, state):
    q, dq, ddq = state
    tau, friction = robot.inverse_dynamics(q, dq, ddq), robot.friction_forces(dq)
    expected = robot.model.damping * dq + robot.model.friction * np.sign(dq)
    assert_close(friction, expected, ROUNDING, "damping dq + friction sign(dq)")
    assert (friction * dq >= 0).all()
    assert_close(robot.inverse_dynamics(q, dq, ddq, friction=True), tau + friction, ROUNDING, "τ with friction")
    back = robot.forward_dynamics(q, dq, tau + friction, friction=True)
    assert_close(back, ddq, 1e-14 * robot.nv * np.linalg.cond(robot.mass_matrix(q)), "forward dynamics with friction")


# ── drawn by hypothesis: it looks for the smallest robot that breaks a law ──

drawn = settings(max_examples=25, deadline=None, derandomize=True)


@drawn
@given(strategies.robots_with_states(joints=4))
def test_any_robot_moves_by_lagranges_equations(drawn_robot):
    robot, state = drawn_robot
    assert laws.lagrange_gap(robot, state) < DIFFERENCES


@drawn
@given(strategies.robots_with_states(joints=4, floating_base=True))
def test_any_floating_robot_agrees_with_the_closed_form(drawn_robot):
    assert laws.closed_form_gap(*drawn_robot) < ROUNDING


@drawn
@given(strategies.robots_with_states(joints=5))
def test_any_robot_has_a_skew_rate_of_inertia_less_twice_coriolis(drawn_robot):
    assert laws.skewness_gap(*drawn_robot) < DIFFERENCES


# ── the laws can fail ──


def test_a_wrong_inertia_is_noticed():
    """The laws compare with something: a robot that forgets a product of inertia breaks those that involve it."""
    robot = random_robot(5, joints=4, kinds=("revolute",))
    state = random_state(robot, 5)
    right = robot.inverse_dynamics(*state)
    G = robot.model.bodies[-1].inertia.parameters.copy()
    G[5] = 0.0
    wrong = robot_with_inertia(robot, SpatialInertia.from_parameters(G))
    with pytest.raises(AssertionError, match="τ: off by"):
        assert_close(wrong.inverse_dynamics(*state), right, ROUNDING, "τ")


def robot_with_inertia(robot, inertia):
    from dataclasses import replace

    *rest, last = robot.model.bodies
    return Robot(replace(robot.model, bodies=(*rest, replace(last, inertia=inertia))))
