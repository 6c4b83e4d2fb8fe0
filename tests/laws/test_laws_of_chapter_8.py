"""The formulas of Modern Robotics 8.1 to 8.9 as laws, B1 to B14 of docs/chapter-8.md, and their wrong forms, which break them.

Here is what the other files of laws have not. Where the rest is: Lagrange's equations, Γ, Ṁ - 2C, the closed form, forward
dynamics in test_laws.py; every body's balance in test_laws_of_wrenches.py; task space in test_task_space.py; constraints in
test_constraints.py; motors in test_actuators.py, rotors in test_rotors.py, friction in test_friction.py, springs in
test_springs.py.

A wrong form is held to the same comparison as the right one. WRONG is how far it must be off: a hundred million times what
rounding is allowed.
"""

from __future__ import annotations

import numpy as np
import pytest
from chains import chain
from quick import mostly_slow
from random_trees import DIFFERENCES, ONE_DEGREE, ROUNDING, driven, frames

import twistwrench as tw
from twistwrench import Ad, ad, se3, so3
from twistwrench.testing import (
    assert_close,
    derivative,
    derivative_along,
    laws,
    random_robot,
    random_state,
    relative_gap,
)

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

WRONG = 1e-3
SEEDS = mostly_slow(range(6), 2)


def hold(truth, right, wrong, rtol, what):
    """The right form equals the truth; each wrong one, by the same comparison, does not."""
    assert_close(right, truth, rtol, what)
    for slip, value in wrong.items():
        gap = relative_gap(value, truth)
        assert gap > WRONG, f"{what}: with {slip} it is off by only {gap:.3g}"


def serial(seed, kinds="rrprr", gravity=(3.0, -4.0, -8.0)):
    """A random chain with screw lists, and a state of it."""
    robot = tw.Robot(chain(np.random.default_rng(seed), kinds).build(tip=f"l{len(kinds)}", gravity=gravity))
    return robot, random_state(robot, seed)


# ── 8.1 ──


@pytest.mark.parametrize("seed", SEEDS)
def test_lagranges_equations_hold_in_other_coordinates(seed):
    """B1: with θ = φ(x), the forces d/dt ∂L/∂ẋ - ∂L/∂x that belong to x are φ'ᵀ τ, for any independent coordinates x."""
    robot = random_robot(seed, joints=4, kinds=ONE_DEGREE)
    rng = np.random.default_rng(seed)
    n = robot.nv
    B = np.eye(n) + 0.3 * rng.standard_normal((n, n))
    x, dx, ddx = 0.5 * rng.standard_normal((3, n))

    def phi(x):
        return x @ B.T + 0.2 * np.sin(x[..., ::-1])

    def slope(x):  # φ', exactly
        return B + 0.2 * np.cos(x[..., ::-1])[..., None] * np.eye(n)[::-1]

    def lagrangian(x, dx):
        q = phi(x)
        return robot.kinetic_energy(q, (slope(x) @ dx[..., None])[..., 0]) - robot.potential_energy(q)

    def momenta(t):  # exact differences: L is quadratic in the rates
        at, v = (x + np.multiply.outer(t, dx))[:, None], (dx + np.multiply.outer(t, ddx))[:, None]
        return 0.5 * (lagrangian(at, v + np.eye(n)) - lagrangian(at, v - np.eye(n)))

    rate = derivative(momenta, 3.0)
    uphill = np.array([derivative(lambda t, e=e: lagrangian(x + np.multiply.outer(t, e), dx), 3.0) for e in np.eye(n)])
    bent = derivative(lambda t: slope(x + np.multiply.outer(t, dx)) @ dx, 3.0)  # d(φ')/dt ẋ
    tau = robot.inverse_dynamics(phi(x), slope(x) @ dx, slope(x) @ ddx + bent)
    wrong = {"+ ∂L/∂x": rate + uphill, "φ' for φ'ᵀ": np.linalg.solve(slope(x).T, slope(x) @ (rate - uphill))}
    hold(slope(x).T @ tau, rate - uphill, wrong, DIFFERENCES, "φ'ᵀ τ = d/dt ∂L/∂ẋ - ∂L/∂x")


@pytest.mark.parametrize("seed", SEEDS)
def test_torques_are_inertia_velocity_products_gravity_and_what_the_tip_applies(seed):
    """B2. Slip 8: a wrench on the hand enters with a minus. Slip 9: J'F alone is not statics under gravity."""
    robot, (q, dq, ddq) = serial(seed)
    F_tip = 10 * np.random.default_rng(seed).standard_normal(6)
    M, c, g, J = robot.mass_matrix(q), robot.coriolis_forces(q, dq), robot.gravity_forces(q), robot.jacobian(q)
    tau = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot={robot.tip: F_tip})
    wrong = {
        "- J'F_tip": M @ ddq + c + g - J.T @ F_tip,
        "- g": M @ ddq + c - g + J.T @ F_tip,
        "half of c": M @ ddq + 0.5 * c + g + J.T @ F_tip,
    }
    hold(tau, M @ ddq + c + g + J.T @ F_tip, wrong, ROUNDING, "τ = M q̈ + c + g + J'F_tip")
    still = robot.holding_torques(q, wrench_on_robot={robot.tip: F_tip})
    wrong = {"+ J'F for a wrench on the hand": g + J.T @ F_tip, "no gravity": -J.T @ F_tip}
    hold(still, g - J.T @ F_tip, wrong, ROUNDING, "τ = g - J'F_on")


@pytest.mark.parametrize("seed", SEEDS)
def test_the_mass_matrix_is_a_sum_over_the_links(seed):
    """B3: M = Σ J_ib' G_i J_ib, followers, planar and floating joints included."""
    robot = random_robot(seed, joints=6)
    q, _, _ = random_state(robot, seed)

    def total(kind):
        J = (robot.jacobian(q, link, kind) for link in robot.body_names)
        return sum(Ji.T @ body.inertia.matrix @ Ji for Ji, body in zip(J, robot.model.bodies, strict=True))

    wrong = {"J_s for J_b": total("space"), "axes of {s} for those of the link": total("world_aligned")}
    hold(robot.mass_matrix(q), total("body"), wrong, ROUNDING, "M = Σ J' G J")


def test_a_factor_of_c_that_is_not_christoffels_leaves_the_rate_of_m_less_2c_not_skew(simple_robot, rng):
    """B3. C q̇ = c does not say what C is: Ṁ - ½ ∂(M q̇)/∂q, its indices as they come, has it too, and is of no use."""
    robot = simple_robot
    if robot.nv < 2:
        pytest.skip("a single joint has a single factor")
    q, dq, _ = random_state(robot, rng)
    dM_by = np.moveaxis(derivative_along(robot, robot.mass_matrix, q, np.eye(robot.nv)), 0, -1)  # ∂m_ij/∂θ_k
    dM = dM_by @ dq
    other = dM - 0.5 * np.einsum("jki,k->ij", dM_by, dq)  # as c = Ṁ q̇ - ½ ∂(q̇'M q̇)/∂q suggests
    C, c = robot.coriolis_matrix(q, dq), robot.coriolis_forces(q, dq)
    size = np.abs(robot.mass_matrix(q)).max() + np.abs(dM_by).max() * np.abs(dq).max()
    assert_close(C @ dq, c, ROUNDING, "C q̇ = c", scale=size)
    assert_close(other @ dq, c, DIFFERENCES, "the other C q̇ = c", scale=size)
    assert_close(C + C.T, dM, DIFFERENCES, "Ṁ = C + C'", scale=size)
    assert relative_gap(other + other.T, dM, size) > WRONG
    wrong_sign = robot.christoffel(q) @ dq - np.einsum("jki,k->ij", dM_by, dq)
    assert relative_gap(wrong_sign @ dq, c, size) > WRONG


@pytest.mark.parametrize("seed", SEEDS)
def test_the_kinetic_energy_of_any_2r_arm(seed):
    """B4, and slip 5: L₁² in the cross term, which only arms of equal links forgive."""
    rng = np.random.default_rng(seed)
    L1, m1, m2, ratio = rng.uniform(0.5, 2.0, 4)
    L2 = L1 * (1 + ratio)
    (t1, t2), (d1, d2) = rng.standard_normal((2, 2))
    arm = tw.from_dh({"a": [L1, L2]}, masses=[m1, m2])
    K = arm.kinetic_energy([t1, t2], [d1, d2]) - 0.5 * m1 * L1**2 * d1**2
    c2 = np.cos(t2)

    def link2(square):
        cross = 2 * (square + L1 * L2 * c2) * d1 * d2
        return 0.5 * m2 * ((L1**2 + 2 * L1 * L2 * c2 + L2**2) * d1**2 + cross + L2**2 * d2**2)

    hold(K, link2(L2**2), {"L₁²": link2(L1**2)}, ROUNDING, "K of link 2")


# ── 8.3 and 8.4 ──


def newton_euler(robot, state, F_tip, *, sign=-1.0, transposed=True, gravity=-1.0):
    """The recursion as the book prints it, on Slist, Mlist and Glist; the keywords are where copies of it slip."""
    lists, n = robot.screws, robot.nv
    V, dV = np.zeros(6), np.concatenate([np.zeros(3), gravity * robot.gravity])
    home, A, X, Vs, dVs = np.eye(4), [], [], [], []
    for i, (q, dq, ddq) in enumerate(zip(*state, strict=True)):
        home = home @ lists.Mlist[i]
        A.append(Ad(se3.inverse(home)) @ lists.Slist[:, i])
        X.append(Ad(se3.exp(-A[i] * q) @ se3.inverse(lists.Mlist[i])).matrix)
        V = X[i] @ V + A[i] * dq
        dV = X[i] @ dV + ad(V) @ A[i] * dq + A[i] * ddq
        Vs.append(V)
        dVs.append(dV)
    X.append(Ad(se3.inverse(lists.Mlist[n])).matrix)
    F, tau = F_tip, np.zeros(n)
    for i in reversed(range(n)):
        G = lists.Glist[i]
        F = (X[i + 1].T if transposed else X[i + 1]) @ F + G @ dVs[i] + sign * (ad(Vs[i]).T @ (G @ Vs[i]))
        tau[i] = F @ A[i]
    return tau


@pytest.mark.parametrize("seed", SEEDS)
def test_the_recursion_of_the_book(seed):
    """B5. Slips 1 and 2 in the recursion: a plus before [ad]', Ad without its transpose; and a base that falls upward."""
    robot, state = serial(seed)
    F_tip = np.random.default_rng(seed).standard_normal(6)
    tau = robot.inverse_dynamics(*state, wrench_by_robot={robot.tip: F_tip})
    wrong = {
        "+ [ad]'GV": newton_euler(robot, state, F_tip, sign=1.0),
        "no transpose": newton_euler(robot, state, F_tip, transposed=False),
        "dV_0 = (0, g)": newton_euler(robot, state, F_tip, gravity=1.0),
    }
    hold(tau, newton_euler(robot, state, F_tip), wrong, ROUNDING, "τ")


@pytest.mark.parametrize("seed", SEEDS)
def test_the_closed_form_and_its_factors(seed):
    """B6: ℒ = (1 - 𝒲)⁻¹ is a finite sum of powers, and its transpose goes first."""
    robot, (q, dq, _) = serial(seed)
    at = robot.closed_form(q, dq)
    powers = sum(np.linalg.matrix_power(at.W, k) for k in range(robot.nv))
    assert_close(at.L, powers, ROUNDING, "ℒ = 1 + 𝒲 + 𝒲² + …")
    right = at.A.T @ at.L.T @ at.G @ at.L @ at.A
    wrong = {"ℒ𝒢ℒ'": at.A.T @ at.L @ at.G @ at.L.T @ at.A}
    hold(robot.mass_matrix(q), right, wrong, ROUNDING, "M = 𝒜'ℒ'𝒢ℒ𝒜")
    c = -at.A.T @ at.L.T @ (at.G @ at.L @ at.ad_Adq @ at.W + at.ad_V.T @ at.G) @ at.V
    assert_close(robot.coriolis_forces(q, dq), c, ROUNDING, "c", scale=max(1.0, np.abs(c).max()))


# ── 8.5 ──


@pytest.mark.parametrize("seed", mostly_slow(SEEDS[:3], 3))
def test_motion_that_is_integrated_gains_the_work_of_its_torques(seed):
    """B7: along a motion under J'F and torques, E grows by ∫ (τ + J'F_on)·θ̇ dt. A wrong sign of F shows here too."""
    from scipy.integrate import solve_ivp

    robot, (q, dq, _) = serial(seed, "rrr")
    n, rng = robot.nv, np.random.default_rng(seed)
    pull, amplitude = rng.standard_normal(6), rng.standard_normal(n)

    def rate(t, y, sign):
        q, dq, tau = y[:n], y[n : 2 * n], amplitude * np.sin(3 * t)
        ddq = robot.forward_dynamics(q, dq, tau, wrench_on_robot={robot.tip: pull})
        return np.concatenate([dq, ddq, [(tau + sign * robot.jacobian(q).T @ pull) @ dq]])

    def gained(sign):
        y = np.concatenate([q, dq, [0.0]])
        end = solve_ivp(rate, (0, 0.5), y, method="DOP853", rtol=1e-11, atol=1e-11, args=(sign,)).y[:, -1]
        E = [robot.kinetic_energy(y[:n], y[n : 2 * n]) + robot.potential_energy(y[:n]) for y in (y, end)]
        return E[1] - E[0], end[-1], max(map(abs, E))

    change, work, size = gained(1.0)
    # The integrator keeps 1e-11 a step, some hundred steps of numbers whose rates are up to a hundred times larger.
    assert_close(work, change, 1e-8, "∫ τ·θ̇ dt", scale=size)
    _, work, _ = gained(-1.0)
    assert relative_gap(work, change, size) > WRONG


# ── 8.6 and 8.7 ──


@pytest.mark.parametrize("seed", SEEDS)
def test_task_space_needs_the_rate_of_the_jacobian_and_both_inverses(seed):
    """B8 with a square J: Λ = J⁻ᵀMJ⁻¹, η = J⁻ᵀh - ΛJ̇J⁻¹V; what is left without each of them."""
    robot, (q, dq, _) = serial(seed, "rrrrrr")
    J, dJ, M, h = robot.jacobian(q), robot.jacobian_rate(q, dq), robot.mass_matrix(q), robot.bias_forces(q, dq)
    Ji, V = np.linalg.inv(J), J @ dq
    Lambda, rounding = Ji.T @ M @ Ji, 1e-15 * np.linalg.cond(J) ** 2 * np.linalg.cond(M)
    hold(robot.task_inertia(q), Lambda, {"J M J'": J @ M @ J.T, "J⁻¹ M J⁻ᵀ": Ji @ M @ Ji.T}, rounding, "Λ")
    eta = Ji.T @ h - Lambda @ dJ @ Ji @ V
    wrong = {"no J̇": Ji.T @ h, "+ ΛJ̇J⁻¹V": Ji.T @ h + Lambda @ dJ @ Ji @ V, "no inverse": J.T @ h}
    hold(robot.task_bias(q, dq), eta, wrong, rounding, "η")


@pytest.mark.parametrize("seed", SEEDS)
def test_forces_of_constraint_by_the_books_formula(seed):
    """B9 on random trees that float, so that no row is lost: λ and P, and that λ without Ȧθ̇ lets go of the constraint."""
    robot = random_robot(seed, joints=4, kinds=("revolute", "helical", "planar"), floating_base=True)
    frame = frames(robot)[0]
    held = robot.constrain(frame, "vx vz", kind="world_aligned")
    rng = np.random.default_rng(seed)
    q = robot.random_configuration(rng)
    dq, tau = held.project_velocity(q, rng.standard_normal(robot.nv)), 5 * rng.standard_normal(robot.nv)
    M, h = robot.mass_matrix(q), robot.bias_forces(q, dq)
    A, dA_dq = held.constraint_jacobian(q), held.constraint_bias(q, dq)
    S = A @ np.linalg.solve(M, A.T)
    moved = A @ np.linalg.solve(M, tau - h)
    ddq, lam = held.forward_dynamics(q, dq, tau)
    rounding = ROUNDING * np.linalg.cond(S) * np.linalg.cond(M)
    wrong = {"no Ȧθ̇": np.linalg.solve(S, moved), "- Ȧθ̇": np.linalg.solve(S, moved - dA_dq)}
    hold(lam, np.linalg.solve(S, moved + dA_dq), wrong, rounding, "λ")
    P = np.eye(robot.nv) - A.T @ np.linalg.solve(S, A) @ np.linalg.inv(M)
    hold(held.projector(q), P, {"P'": P.T}, rounding, "P")
    assert_close(P @ (M @ ddq + h), P @ tau, rounding, "P τ = P (M q̈ + h)", scale=np.abs(tau).max() + np.abs(h).max())


# ── 8.8 ──


@pytest.mark.parametrize("seed", SEEDS)
def test_an_inertial_frame_that_is_turned(seed):
    """B10: I = R I_c R' about the centre of mass, against a cloud of point masses turned by hand."""
    rng = np.random.default_rng(seed)
    points, masses = rng.normal(size=(8, 3)), rng.uniform(0.1, 1, 8)
    cloud = tw.SpatialInertia.from_points(masses, points)
    I_c, com, xyz, rpy = cloud.moment_about_com, cloud.com, rng.normal(size=3), rng.uniform(-1.5, 1.5, 3)
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    entries = " ".join(f'{name}="{float(I_c[place])!r}"' for name, place in names.items())
    robot = tw.load(
        f"""<robot name="r"><link name="base"/><link name="body"><inertial>
        <origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>
        <mass value="{cloud.mass}"/><inertia {entries}/></inertial></link>
        <joint name="j" type="continuous"><parent link="base"/><child link="body"/></joint></robot>"""
    )
    R = so3.exp([0, 0, rpy[2]]) @ so3.exp([0, rpy[1], 0]) @ so3.exp([rpy[0], 0, 0])
    there = tw.SpatialInertia.from_points(masses, (points - com) @ R.T + xyz)

    def about(moment):
        return tw.SpatialInertia.from_com(cloud.mass, xyz, moment).matrix

    assert_close(robot.screws.Glist[0], there.matrix, ROUNDING, "G of the turned cloud")
    wrong = {"R' I_c R": about(R.T @ I_c @ R), "not turned": about(I_c)}
    hold(robot.screws.Glist[0], about(R @ I_c @ R.T), wrong, ROUNDING, "G")


# ── 8.9 ──


@pytest.mark.parametrize("seed", SEEDS)
def test_reflected_inertia_grows_with_the_square_of_the_ratio(seed):
    """B12 on an axis that stands still: what is added to M is G² J. G J is the common slip."""
    rng = np.random.default_rng(seed)
    ratio, J = rng.uniform(5, 150), rng.uniform(1e-5, 1e-3)
    robot, (q, _, _) = serial(seed, "rr")
    rotor = {"inertia": f"{J} kg m^2", "extra": True}
    geared = robot.with_actuators({"actuators": {"j1": {"ratio": ratio, "rotor": rotor}}})
    added = geared.mass_matrix(q) - robot.mass_matrix(q)
    right = np.diag([ratio**2 * J, 0.0])
    wrong = {"G J": np.diag([ratio * J, 0.0]), "G² J at every joint": ratio**2 * J * np.eye(2)}
    size = np.abs(geared.mass_matrix(q)).max() / (ratio**2 * J)  # the difference of two matrices of that size
    hold(added, right, wrong, ROUNDING * max(1.0, size), "M with rotors less M")


@pytest.mark.parametrize("seed", SEEDS)
def test_flexible_joints_move_by_lagranges_equations(seed):
    """B14: rotors and springs are in the energies and nowhere else, on random trees. A spring that pushes does not fit."""
    tree = random_robot(seed, joints=3, kinds=("revolute",), floating_base=seed % 2 == 0)
    robot = driven(tree, seed, stiffness="30 N m/rad")
    state = random_state(robot, seed)
    assert laws.lagrange_gap(robot, state) < DIFFERENCES
    springs = robot.holding_torques(state.q) - robot.gravity_forces(state.q)
    tau = laws.lagrange_torques(robot, state)
    assert relative_gap(robot.inverse_dynamics(*state) - 2 * springs, tau) > WRONG
