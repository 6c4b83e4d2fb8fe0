"""Derivatives of a robot's quantities: laws, differences along robot.add, the analytic recursions; on every kind of joint."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

import twistwrench as tw
from random_trees import DIFFERENCES, ROUNDING, frames, tree
from twistwrench.quantities import QUANTITIES
from twistwrench.testing import assert_close, derivative, derivative_along, random_state

pytest_plugins = ("random_tree_fixtures",)

SECOND_DIFFERENCES = 1e-8
"""Differences of differences of order six: 1e-12 of the function divided by the step, and the same room as elsewhere."""
KINDS = ("body", "space", "world_aligned")
MODES = ("forward", "reverse")
STATE = ("q", "dq", "ddq")


@pytest.fixture(autouse=True)
def on_numpy_unless_marked(request, monkeypatch):
    """What compiles is another test's business; those that ask for ``compiled`` do."""
    if "compiled" not in request.fixturenames:
        monkeypatch.setenv("TWISTWRENCH_JIT", "0")


@pytest.fixture
def compiled():
    """Programs run as machine code."""


def along_q(robot, function, q):
    """∂function/∂q along robot.add by differences, directions last."""
    return np.moveaxis(derivative_along(robot, function, q, np.eye(robot.nv)), 0, -1)


# ── first derivatives ──


@pytest.mark.parametrize("mode", MODES)
def test_of_inverse_dynamics_by_the_chain_rule_and_by_recursion(robot, state, mode):
    F = {robot.frame_names[-1]: np.arange(1.0, 7.0)}
    kernel = robot.kernel("inverse_dynamics", by=STATE, mode=mode, wrenches=tuple(F))
    by_q, by_dq, by_ddq = kernel(*state, *F.values())
    expected = robot.inverse_dynamics_derivatives(*state, wrench_by_robot=F)
    scale = max(float(np.abs(x).max()) for x in (*expected, robot.inverse_dynamics(*state, wrench_by_robot=F)))
    assert_close(by_q, expected[0], ROUNDING, "∂τ/∂q", scale=scale)
    assert_close(by_dq, expected[1], ROUNDING, "∂τ/∂dq", scale=scale)
    assert_close(by_ddq, robot.mass_matrix(state.q), ROUNDING, "∂τ/∂ddq = M")


SKIPPED = {"christoffel", "closure_poses", "constraint_bias", "constraint_jacobian", "constrained_dynamics"}
"""Christoffel symbols are of one-degree joints, constraints of closed robots."""
BY_Q = [
    name
    for name, quantity in QUANTITIES.items()
    if "q" in quantity.inputs and "rows" not in quantity.options and name not in SKIPPED
]


@pytest.mark.parametrize("name", ["tree0", "tree3", "planar", "floating", "driven1"])
@pytest.mark.parametrize("quantity", BY_Q)
def test_of_any_quantity_by_differences(quantity, name):
    robot = tree(name)
    options = {"frame": robot.frame_names[-1]} if "frame" in QUANTITIES[quantity].options else {}
    arrays = states_of(robot, quantity, options)
    by_q = robot.kernel(quantity, by="q", **options)(*arrays)
    kernel = robot.kernel(quantity, **options)

    def at(x):
        found = kernel(x, *arrays[1:])
        return np.concatenate(
            [np.reshape(y, (*x.shape[:-1], -1)) for y in (found if isinstance(found, tuple) else (found,))], axis=-1
        )

    numeric = along_q(robot, at, arrays[0])
    found = np.concatenate([np.reshape(x, (-1, robot.nv)) for x in (by_q if isinstance(by_q, tuple) else (by_q,))])
    scale = max(np.abs(numeric).max(), np.abs(at(arrays[0])).max(), 1.0)
    assert_close(found, numeric, 1e-7 if "forward" in quantity else DIFFERENCES, quantity, scale=scale)  # through M⁻¹


def states_of(robot, quantity, options, seed=5):
    rng = np.random.default_rng(seed)
    ports = robot.program(quantity, **options).inputs
    return [robot.random_configuration(rng) if p.name == "q" else rng.normal(size=p.shape) for p in ports]


@pytest.mark.parametrize("kind", KINDS)
def test_the_derivative_of_the_jacobian(robot, state, kind):
    """By recursion as by the chain rule, and times dq it is the rate; on every kind of joint."""
    for frame in frames(robot):
        D = robot.jacobian_derivative(state.q, frame, kind)
        scale = max(1.0, np.abs(D).max())
        rate = robot.jacobian_rate(state.q, state.dq, frame, kind)
        assert_close(D @ state.dq, rate, ROUNDING, "∂J/∂q dq = dJ/dt", scale=scale * np.abs(state.dq).sum())
        chained = robot.kernel("jacobian", frame=frame, kind=kind, by="q")(state.q)
        assert_close(D, chained, ROUNDING, "by the chain rule", scale=scale)


def test_the_derivative_of_the_mass_matrix(robot, state):
    D = robot.mass_matrix_derivative(state.q)
    numeric = along_q(robot, robot.mass_matrix, state.q)
    assert_close(
        D, numeric, DIFFERENCES, "∂M/∂q", scale=max(np.abs(numeric).max(), np.abs(robot.mass_matrix(state.q)).max())
    )
    np.testing.assert_array_equal(D, np.swapaxes(D, 0, 1))
    C = robot.coriolis_matrix(state.q, state.dq)
    scale = max(np.abs(C).max(), np.abs(D).max())
    assert_close(D @ state.dq, C + C.T, ROUNDING, "dM/dt - 2C is skew-symmetric", scale=scale)


def test_christoffels_symbols_are_made_of_it(simple_robot, rng):
    """MR eq. 8.12: Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i)."""
    q = simple_robot.random_configuration(rng)
    D = simple_robot.mass_matrix_derivative(q)
    gamma = 0.5 * (D + np.swapaxes(D, 1, 2) - np.moveaxis(D, -1, 0))
    scale = max(np.abs(gamma).max(), np.abs(simple_robot.mass_matrix(q)).max())
    assert_close(simple_robot.christoffel(q), gamma, ROUNDING, "Γ", scale=scale)


def test_a_pose_moves_along_its_jacobian(robot, state):
    """∂T/∂q_k = T [J_k], J the body Jacobian."""
    frame = robot.frame_names[-1]
    dT = robot.kernel("forward_kinematics", frame=frame, by="q")(state.q)
    T, J = robot.forward_kinematics(state.q, frame), robot.jacobian(state.q, frame)
    expected = np.stack([T @ tw.se3.hat(column) for column in J.T], axis=-1)
    assert_close(dT, expected, ROUNDING, "∂T/∂q", scale=max(1.0, np.abs(expected).max()))


def test_energies_give_momentum_and_forces(robot, state):
    """∂K/∂dq = M dq, ∂P/∂q = g and springs, ∂com/∂q = J_com, and momentum is linear in dq."""
    q, dq, _ = state
    M = robot.mass_matrix(q)
    assert_close(robot.kernel("kinetic_energy", by="dq")(q, dq), M @ dq, ROUNDING, "M dq", scale=np.abs(M * dq).max())
    g = robot.holding_torques(q)
    scale = max(np.abs(g).max(), np.abs(M).max())
    assert_close(robot.kernel("potential_energy", by="q")(q), g, ROUNDING, "g", scale=scale)
    assert_close(robot.kernel("center_of_mass", by="q")(q), robot.com_jacobian(q), ROUNDING, "J_com", scale=1.0)
    A = robot.kernel("momentum_about_com", by="dq")(q, dq)
    assert_close(A @ dq, robot.momentum(q, dq, "com"), ROUNDING, "A dq", scale=np.abs(A * dq).max())


def test_lagranges_equations(robot, state):
    """τ = d/dt (M dq) - ∂K/∂q + ∂P/∂q where velocities are rates; MR eq. 8.2. With dM/dt by ∂M/∂q."""
    if any(body.joint.nv > 1 for body in robot.model.bodies):
        pytest.skip("velocities are not rates of coordinates")
    q, dq, ddq = state
    M, dM = robot.mass_matrix(q), robot.mass_matrix_derivative(q)
    K_by_q = robot.kernel("kinetic_energy", by="q")(q, dq)
    tau = M @ ddq + (dM @ dq) @ dq - K_by_q + robot.kernel("potential_energy", by="q")(q)
    expected = robot.inverse_dynamics(*state)
    assert_close(tau, expected, ROUNDING, "τ", scale=max(np.abs(expected).max(), np.abs(M).max()))


def test_by_wrenches_gravity_and_parameters():
    """τ is linear in each: J', the rest without, and the regressor's columns."""
    robot = tree("tree3")
    state = random_state(robot, np.random.default_rng(6))
    frame = robot.frame_names[-1]
    by_wrench = robot.kernel("inverse_dynamics", wrenches=frame, by=f"wrench at {frame}")(*state, np.zeros(6))
    assert_close(by_wrench, robot.jacobian(state.q, frame).T, ROUNDING, "∂τ/∂F = J'")
    by_gravity = robot.kernel("inverse_dynamics", gravity="input", by="gravity")(*state, np.zeros(3))
    still = robot.with_gravity((0, 0, 0)).inverse_dynamics(*state)
    tau = robot.inverse_dynamics(*state)
    assert_close(by_gravity @ robot.gravity + still, tau, ROUNDING, "∂τ/∂g")


@pytest.mark.parametrize("name", ["tree1", "tree3", "one_degree5"])
def test_by_inertial_parameters_it_is_the_regressor(name):
    """Of a link whose frame is its body's: Ixx … are entries of π, and by the mass m c and m (c·c 1 - c c') go along."""
    robot = tree(name)
    state = random_state(robot, np.random.default_rng(7))
    Y = robot.regressor(*state)
    for i, body in enumerate(robot.model.bodies):
        names = list(robot.varying(f"{body.link}.*"))
        patterns = tuple(n for n in names if n.rpartition(".")[2][0] in "mIc")
        own = list(robot.varying(*patterns).values())
        found = robot.kernel("inverse_dynamics", parameters=patterns, by="parameters")(*state, own)
        mine = Y[:, 10 * i : 10 * i + 10]
        assert_close(found[:, 4:], mine[:, 4:], ROUNDING, "by moments", scale=np.abs(Y).max())
        c, m = np.array(own[1:4]), own[0]
        steiner = (c @ c) * np.eye(3) - np.outer(c, c)
        pi = np.array([1.0, *c, *steiner[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
        assert_close(found[:, 0], mine @ pi, ROUNDING, "by mass", scale=np.abs(Y).max())
        for k, e in enumerate(np.eye(3)):
            turned = m * (2 * c[k] * np.eye(3) - np.outer(e, c) - np.outer(c, e))
            pi = np.array([0.0, *(m * e), *turned[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
            assert_close(found[:, 1 + k], mine @ pi, ROUNDING, "by centre of mass", scale=np.abs(Y).max() * max(1.0, m))


@pytest.mark.parametrize("mode", MODES)
def test_the_length_of_a_quaternion_means_nothing(mode):
    robot = tree("floating")
    q, dq, ddq = random_state(robot, np.random.default_rng(8))
    stretched = q.copy()
    for body in robot.model.leaders:
        stretched[body.q_index : body.q_index + 4] *= -7.5
    kernel = robot.kernel("inverse_dynamics", by="q", mode=mode)
    assert_close(kernel(stretched, dq, ddq), kernel(q, dq, ddq), ROUNDING, "∂τ/∂q")


def test_products_are_those_of_the_jacobians(robot, state, rng):
    w, *v = rng.normal(size=(4, robot.nv))
    parts = robot.kernel("inverse_dynamics", by=STATE)(*state)
    scale = max(np.abs(x).max() for x in parts)
    along = robot.kernel("inverse_dynamics", by=STATE, form="along")(*state, *v)
    together = sum(J @ x for J, x in zip(parts, v, strict=True))
    assert_close(along, together, ROUNDING, "J v", scale=scale)
    for found, J in zip(robot.inverse_dynamics_gradient(*state, w), parts, strict=True):
        assert_close(found, w @ J, ROUNDING, "w J", scale=scale)


# ── second derivatives ──


def weighted_torque(robot, state, w):
    """(u, a, b) ↦ w·τ(q ⊕ u, dq + a, ddq + b), for batches (..., 3 nv)."""

    def phi(x):
        u, a, b = np.split(x, 3, axis=-1)
        return robot.inverse_dynamics(robot.add(state.q, u), state.dq + a, state.ddq + b) @ w

    return phi


def test_hessian_products_by_second_differences(robot, state, rng):
    w, *v = rng.normal(size=(4, robot.nv))
    phi, direction, unit = weighted_torque(robot, state, w), np.concatenate(v), np.eye(3 * robot.nv)

    def slopes(t):
        """∂φ/∂x at t v; (6, 3 nv)."""
        return derivative(lambda s: phi(np.multiply.outer(t, direction)[:, None] + np.multiply.outer(s, unit)[:, None]))

    numeric = derivative(slopes, np.abs(direction).sum())
    found = np.concatenate(robot.inverse_dynamics_hessian_product(*state, w, *v))
    scale = max(np.abs(numeric).max(), np.abs(np.concatenate(robot.inverse_dynamics_gradient(*state, w))).max())
    assert_close(found, numeric, SECOND_DIFFERENCES, "Hessian times v", scale=scale)


def test_hessians_are_symmetric_and_their_products_agree(robot, state, rng):
    w, n = rng.normal(size=robot.nv), robot.nv
    product = robot.kernel("inverse_dynamics", by=STATE, form="hessian_along")
    H = np.concatenate(product(*state, w, *np.split(np.eye(3 * n), 3, axis=1)), axis=-1)
    assert_close(H, H.T, ROUNDING, "symmetry")
    assert not H[2 * n :, n:].any()  # τ is linear in ddq, whose factor is M(q)
    dM = robot.mass_matrix_derivative(state.q)
    assert_close(H[2 * n :, :n], np.einsum("i,ijk->jk", w, dM), ROUNDING, "∂²(w·τ)/∂ddq∂q", scale=np.abs(H).max())


def test_the_hessian_of_energies(robot, state):
    """Of K by dq it is M; of P that of gravity's stiffness, whose other half is the turning of the axes."""
    q, dq, _ = state
    H = robot.kernel("kinetic_energy", by="dq", form="hessian")(q, dq)
    assert_close(H, robot.mass_matrix(q), ROUNDING, "∂²K/∂dq²")
    H = robot.kernel("potential_energy", by="q", form="hessian")(q)
    stiffness = robot.kernel("holding_torques", by="q")(q)
    scale = max(np.abs(stiffness).max(), np.abs(robot.holding_torques(q)).max())
    assert_close(H, 0.5 * (stiffness + stiffness.T), ROUNDING, "∂²P/∂q²", scale=scale)


# ── functions of one's own ──


def test_functions_that_ask_robots(robot, state):
    """The distance of a frame from a point: ½ |p - x|² has the gradient J_v'(p - x)."""
    frame, x = robot.frame_names[-1], np.array([0.3, -0.2, 0.9])

    def distance(q, x):
        away = robot.forward_kinematics(q, frame)[:3, 3] - x
        return 0.5 * (away @ away)

    by_q, by_x = tw.differentiate(distance, {"q": robot, "x": 3})(state.q, x)
    away = robot.forward_kinematics(state.q, frame)[:3, 3] - x
    J = robot.jacobian(state.q, frame, "world_aligned")[3:]
    assert_close(by_q, J.T @ away, ROUNDING, "gradient", scale=max(1.0, np.abs(J).max()))
    assert_close(by_x, -away, ROUNDING, "by the point")
    H = tw.differentiate(distance, {"q": robot, "x": 3}, "q", form="hessian")(state.q, x)
    numeric = along_q(robot, lambda y: tw_gradient(robot, distance)(y, x), state.q)
    assert_close(H, 0.5 * (numeric + numeric.T), DIFFERENCES, "Hessian", scale=max(1.0, np.abs(numeric).max()))


def tw_gradient(robot, function):
    return tw.differentiate(function, {"q": robot, "x": 3}, "q", form="weighted")


def test_two_robots_in_one_function():
    """Each configuration moves along its own robot's add."""
    arm, base = tree("revolute"), tree("floating")
    rng = np.random.default_rng(9)
    p, q = arm.random_configuration(rng), base.random_configuration(rng)

    def apart(p, q):
        away = arm.center_of_mass(p) - base.center_of_mass(q)
        return away @ away

    by_p, by_q = tw.differentiate(apart, {"p": arm, "q": base})(p, q)
    away = arm.center_of_mass(p) - base.center_of_mass(q)
    assert_close(by_p, 2 * away @ arm.com_jacobian(p), ROUNDING, "by p")
    assert_close(by_q, -2 * away @ base.com_jacobian(q), ROUNDING, "by q")
    H = tw.differentiate(apart, {"p": arm, "q": base}, form="hessian")(p, q)
    numeric = along_q(base, lambda x: tw.differentiate(apart, {"p": arm, "q": base}, "p")(p, x), q)
    assert_close(H[: arm.nv, arm.nv :], numeric, DIFFERENCES, "mixed block", scale=np.abs(H).max())


def test_methods_and_reference_take_symbols_once_they_were_called_with_numbers_too():
    robot = tw.robots.planar_2r()
    dq = np.array([1.0, 2.0])
    robot.inverse_dynamics(robot.neutral, dq, dq)
    push = {"tip": np.array([0, 0, 0, 1.0, 0, 0])}

    def power(q, dq):
        return robot.inverse_dynamics(q, dq, np.zeros(2), wrench_by_robot=push) @ dq

    by_q, by_dq = tw.differentiate(power, {"q": robot, "dq": 2})([0.1, 0.2], dq)
    h = lambda q, v: robot.inverse_dynamics(q, v, np.zeros(2), wrench_by_robot=push)  # noqa: E731
    numeric = along_q(robot, lambda q: h(q, dq) @ dq, np.array([0.1, 0.2]))
    assert_close(by_q, numeric, DIFFERENCES, "by q")
    assert by_dq.shape == (2,)
    with pytest.raises(tw.ShapeError, match="one state has"):
        tw.differentiate(lambda q: robot.mass_matrix(np.append(q, q)), {"q": robot})


# ── kernels ──


def test_auto_takes_the_mode_of_fewer_operations(bundled):
    """The estimate is right about which, wherever one of the modes takes a tenth less; and to a quarter about how many."""
    from twistwrench.derived import Chart
    from twistwrench.program.differentiate import work
    from twistwrench.program.trace import Trace
    from twistwrench.quantities import evaluated

    for name in ("panda", "quadruped"):
        robot = bundled(name)
        for quantity, by in [
            ("mass_matrix", "q"),
            ("center_of_mass", "q"),
            ("inverse_dynamics", STATE),
            ("momentum", "q"),
        ]:
            made = [robot.program(quantity, by=by, mode=mode).flops for mode in MODES]
            auto = robot.program(quantity, by=by).flops
            assert auto <= 1.1 * min(made)
        owner = Trace()
        q = owner.inputs(0, (robot.nq,))
        com = evaluated(QUANTITIES["center_of_mass"], robot.model, [q], {})
        counted = work(list(com), Chart.of(q, robot.model).known)
        itself = robot.program("center_of_mass").flops
        for mode, guess in zip(MODES, counted, strict=True):
            there = robot.program("center_of_mass", by="q", mode=mode).flops
            assert abs(guess + itself - there) <= 0.25 * there + itself  # what results alone need goes


def test_compiled_kernels_take_batches_and_share_what_several_have_in_common(compiled):
    robot = tw.robots.floating_box()
    q, dq, ddq = random_state(robot, 1, size=(3, 5))
    kernel = robot.kernel("inverse_dynamics", by=("q", "dq"), values=True)
    assert kernel.signature == "(7),(6),(6)->(6),(6,6),(6,6)"
    assert kernel is robot.kernel("inverse_dynamics", by=("q", "dq"), values=True)
    tau, by_q, _ = kernel(q, dq, ddq)
    assert_close(tau, robot.inverse_dynamics(q, dq, ddq), ROUNDING, "τ")
    assert_close(by_q, robot.inverse_dynamics_derivatives(q, dq, ddq)[0], ROUNDING, "∂τ/∂q")
    single = kernel(*(x.astype(np.float32) for x in (q, dq, ddq)))
    assert {x.dtype for x in single} == {np.dtype(np.float32)}
    assert_close(single[1], by_q, 1e-5, "float32")
    both = robot.kernel("potential_energy", "center_of_mass", by="q")
    assert both.signature == "(7)->(6),(3,6)"
    assert_close(both(q)[1], robot.com_jacobian(q), ROUNDING, "together")


def test_methods_take_out_wrenches_and_batches(compiled):
    robot = tw.robots.planar_2r()
    rng = np.random.default_rng(2)
    q, dq, ddq, w, *v = rng.normal(size=(7, 4, 2))
    F = {"tip": rng.normal(size=6)}
    out = tuple(np.empty((4, 2)) for _ in range(3))
    given = robot.inverse_dynamics_hessian_product(q, dq, ddq, w, *v, wrench_on_robot=F, out=out)
    assert given[0] is out[0]
    without = robot.inverse_dynamics_hessian_product(q, dq, ddq, w, *v)
    torques = tw.differentiate(
        lambda q, w: robot.wrench_torques(q, -F["tip"], "tip") @ w, {"q": robot, "w": 2}, "q", form="hessian_along"
    )(q, w, v[0])
    assert_close(given[0] - without[0], torques, ROUNDING, "the wrench's part", scale=np.abs(given[0]).max())
    slope = robot.inverse_dynamics_gradient(q, dq, ddq, w, wrench_on_robot=F)
    by_q, _ = robot.inverse_dynamics_derivatives(q, dq, ddq, wrench_on_robot=F)
    assert_close(slope[0], (w[:, None] @ by_q)[:, 0], ROUNDING, "gradient")
    out = np.empty((4, 2, 2, 2))
    assert robot.mass_matrix_derivative(q, out=out) is out
    np.testing.assert_array_equal(out, robot.mass_matrix_derivative(q))


def test_results_of_four_axes(compiled):
    """Beyond what compiled loops copy: these run on NumPy."""
    robot = tw.robots.planar_2r()
    q = np.array([[0.3, -0.7], [1.0, 0.2]])
    by_q = robot.kernel("link_poses", by="q")(q)
    assert by_q.shape == (2, len(robot.link_names), 4, 4, 2)
    for k, frame in enumerate(robot.link_names):
        expected = robot.kernel("forward_kinematics", frame=frame, by="q")(q)
        assert_close(by_q[:, k], expected, ROUNDING, frame, scale=1.0)
    H = robot.kernel("mass_matrix", by="q", form="hessian")(q)
    assert_close(H[..., 1, 1], -robot.mass_matrix(q) + robot.mass_matrix([0.0, np.pi / 2]), ROUNDING, "∂²M/∂q²")


def test_robots_that_do_not_move():
    robot = tw.robots.planar_2r().lock({"joint1": 0.1, "joint2": 0.2})
    assert robot.nv == 0
    assert robot.mass_matrix_derivative([]).shape == (0, 0, 0)
    assert robot.jacobian_derivative([]).shape == (6, 0, 0)
    assert robot.kernel("center_of_mass", by="q")([]).shape == (3, 0)
    assert [x.shape for x in robot.inverse_dynamics_gradient([], [], [], [])] == [(0,)] * 3
    assert tw.differentiate(lambda q: 1.0, {"q": robot})([]).shape == (0,)


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler: cc is not on the path")
def test_derivatives_are_exported_to_c(tmp_path):
    """The export's own test program compares them with kernels."""
    asked = [
        "center_of_mass",
        ("center_of_mass", {"by": "q"}),
        ("inverse_dynamics", {"by": STATE, "form": "hessian_along"}),
        ("inverse_dynamics", {"by": "wrench at tip", "wrenches": "tip"}),
    ]
    files = tw.robots.planar_2r().export_c(asked, tmp_path)
    assert "void planar_2r_center_of_mass_by_q(const double q[2], double com_by_q[6]);" in files[0].read_text()
    assert "derivative (hessian_along) by q, dq, ddq" in files[0].read_text()
    sources = [str(path) for path in files if path.suffix == ".c"]
    subprocess.run(["cc", "-std=c99", *sources, "-lm", "-o", str(tmp_path / "check")], check=True)
    assert subprocess.run([str(tmp_path / "check")], capture_output=True).returncode == 0


def test_what_cannot_be_meant():
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.UnknownNameError, match="no quantity named 'mass_matrx'"):
        robot.kernel("mass_matrx", by="q")
    with pytest.raises(tw.UnknownNameError, match=r"no input of mass_matrix named 'dq'.*Known: q"):
        robot.kernel("mass_matrix", by="dq")
    with pytest.raises(tw.UnknownNameError, match="no input of inverse_dynamics named 'gravity'"):
        robot.kernel("inverse_dynamics", by="gravity")
    with pytest.raises(tw.UnknownNameError, match="no mode of a derivative named 'backward'"):
        robot.kernel("mass_matrix", by="q", mode="backward")
    with pytest.raises(tw.UnknownNameError, match="no form of a derivative named 'gradient'"):
        robot.kernel("mass_matrix", by="q", form="gradient")
    with pytest.raises(tw.KernelError, match="mode= is of a derivative; name the inputs to differentiate by"):
        robot.kernel("mass_matrix", mode="forward")
    with pytest.raises(tw.KernelError, match="algorithms know no by="):
        robot.reference("mass_matrix", [0, 0], by="q")
    with pytest.raises(tw.KernelError, match="more than the 500000 one kernel may give"):
        tree("floating").kernel("regressor", by=STATE, form="hessian")
    with pytest.raises(tw.ShapeError, match=r"weight on inverse_dynamics tau has shape \(3,\)"):
        robot.inverse_dynamics_gradient([0, 0], [0, 0], [0, 0], [1, 2, 3])
    with pytest.raises(tw.ShapeError, match=r"along dq has shape \(\)"):
        robot.inverse_dynamics_hessian_product([0, 0], [0, 0], [0, 0], [1, 2], [1, 2], 3.0, [1, 2])
    with pytest.raises(tw.ValueRangeError, match="Christoffel symbols need"):
        tree("floating").kernel("christoffel", by="q")
