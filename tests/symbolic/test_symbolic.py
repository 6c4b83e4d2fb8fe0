"""Lagrange's equations in symbols: the book's form, and agreement with Newton and Euler's recursions."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
import sympy
from quick import mostly_slow, slow

import twistwrench as tw
from twistwrench.core.errors import MissingExtraError, ShapeError, UnknownNameError, ValueRangeError
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.symbolic import derivation as check
from twistwrench.symbolic import derivation_size, derive
from twistwrench.symbolic.derivation_check import Evaluator
from twistwrench.symbolic.parameters import Namer
from twistwrench.testing import assert_close, random_robot

pytest_plugins = ("small_trees",)

# Of the largest torque: both sides round some hundred sums of terms of order one.
CLOSE = 1e-12


def spatial_3r() -> tw.Robot:
    """Waist, shoulder, elbow, with all ten parameters of every link away from zero, lengths along and beside the links."""
    rng = np.random.default_rng(5)
    builder = ModelBuilder("spatial_3r")
    builder.add_link("base")
    places = [(0, 0, 0.4), (0.1, -0.15, 0.2), (0.5, 0.05, 0)]
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0)]
    for k, (place, axis) in enumerate(zip(places, axes, strict=True), 1):
        A = 0.2 * rng.standard_normal((3, 3))
        S = A @ A.T
        body = tw.SpatialInertia.from_com(rng.uniform(1, 4), 0.2 * rng.standard_normal(3), S.trace() * np.eye(3) - S)
        builder.add_link(f"link{k}", body)
        T = np.eye(4)
        T[:3, 3] = place
        parent = "base" if k == 1 else f"link{k - 1}"
        builder.add_joint(f"joint{k}", "continuous", parent, f"link{k}", placement=T, axis=axis)
    return tw.Robot(builder.build())


ROBOTS = {
    "planar_2r": tw.robots.planar_2r,
    "planar_3r": tw.robots.planar_3r,
    "cart_pole": tw.robots.cart_pole,
    "spatial_3r": spatial_3r,
    "ur5": tw.robots.ur5,
}


def assert_agrees(equations, robot, functions=("inverse_dynamics", "mass_matrix", "coriolis_forces", "gravity_forces")):
    """The generated NumPy functions against the kernels, at states that the derivation's own check has not seen."""
    rng = np.random.default_rng(42)
    q, dq, ddq = rng.uniform(-3, 3, (3, 20, robot.nv))
    arrays = {"inverse_dynamics": (q, dq, ddq), "coriolis_forces": (q, dq), "coriolis_matrix": (q, dq)}
    torque = np.abs(robot.inverse_dynamics(q, dq, ddq)).max()
    for name in functions:
        given = arrays.get(name, (q,))
        scale = None if name == "mass_matrix" else torque
        assert_close(equations.function(name)(*given), getattr(robot, name)(*given), CLOSE, name, scale=scale)


# ── the book's 2R arm ──

m1, m2, L1, L2, g = sympy.symbols("m_1 m_2 L_1 L_2 g")
th1, th2 = sympy.symbols("theta_1 theta_2")
d1, d2 = sympy.symbols("thetadot_1 thetadot_2")
dd1, dd2 = sympy.symbols("thetaddot_1 thetaddot_2")
sin, cos = sympy.sin, sympy.cos


def test_planar_2r_is_the_book_term_by_term():
    """MR eq. 8.9: the torques as printed there, M, c and g each."""
    arm = derive(tw.robots.planar_2r())
    tau_1 = (
        (m1 * L1**2 + m2 * (L1**2 + 2 * L1 * L2 * cos(th2) + L2**2)) * dd1
        + m2 * (L1 * L2 * cos(th2) + L2**2) * dd2
        - m2 * L1 * L2 * sin(th2) * (2 * d1 * d2 + d2**2)
        + (m1 + m2) * L1 * g * cos(th1)
        + m2 * g * L2 * cos(th1 + th2)
    )
    tau_2 = (
        m2 * (L1 * L2 * cos(th2) + L2**2) * dd1
        + m2 * L2**2 * dd2
        + m2 * L1 * L2 * d1**2 * sin(th2)
        + m2 * g * L2 * cos(th1 + th2)
    )
    # Not only equal but the same trees: the very terms, factored as the book factors them.
    assert arm.tau[0] == tau_1
    assert arm.tau[1] == tau_2
    K_2 = (
        m2
        * (
            (L1**2 + 2 * L1 * L2 * cos(th2) + L2**2) * d1**2
            + 2 * (L2**2 + L1 * L2 * cos(th2)) * d1 * d2
            + L2**2 * d2**2
        )
        / 2
    )
    K = {label.name: expr for label, expr in arm.step("kinetic_energies").lines}
    assert sympy.expand(K["K_2"] - K_2) == 0
    assert sympy.expand(K["K_1"] - m1 * L1**2 * d1**2 / 2) == 0


def test_planar_2r_prints_as_the_book():
    arm = derive(tw.robots.planar_2r())
    first, second = arm.text("equations").splitlines()[1:]
    assert first.strip() == (
        "τ₁ = (m₁ L₁² + m₂ (L₁² + 2 L₁ L₂ cos(θ₂) + L₂²)) θ̈₁ + m₂ (L₁ L₂ cos(θ₂) + L₂²) θ̈₂ "
        "− m₂ L₁ L₂ sin(θ₂) (2 θ̇₁ θ̇₂ + θ̇₂²) + (m₁ + m₂) L₁ g cos(θ₁) + m₂ L₂ g cos(θ₁ + θ₂)"
    )
    assert second.strip() == (
        "τ₂ = m₂ (L₁ L₂ cos(θ₂) + L₂²) θ̈₁ + m₂ L₂² θ̈₂ + m₂ L₁ L₂ sin(θ₂) θ̇₁² + m₂ L₂ g cos(θ₁ + θ₂)"
    )
    latex = arm.latex("equations", document=False)
    assert r"\cos{\theta_{2}}" in latex
    assert r"\cos(\theta_{1} + \theta_{2})" in latex
    assert r"\ddot{\theta}_{1}" in latex
    names = {p.name for p in arm.parameters}
    assert names == {"L_1", "L_2", "m_1", "m_2", "g"}  # centres of mass at the joints' places share their symbols


def test_steps_come_in_the_order_of_the_book():
    names = [step.name for step in derive(tw.robots.planar_2r()).steps]
    assert names == [
        "positions",
        "velocities",
        "angular_velocities",
        "kinetic_energies",
        "potential_energies",
        "lagrangian",
        "momenta",
        "momentum_rates",
        "slopes",
        "mass_matrix",
        "christoffel",
        "centripetal",
        "coriolis",
        "coriolis_matrix",
        "gravity_forces",
        "equations",
    ]


# ── against the recursions ──


@pytest.mark.parametrize("name", ["planar_2r", "planar_3r", "cart_pole", "spatial_3r", *slow("ur5")])
def test_symbolic_equals_numeric(name):
    robot = ROBOTS[name]()
    equations = derive(robot)
    assert equations.check.worst < CLOSE
    assert_agrees(equations, robot)
    assert equations.form == ("named" if name == "ur5" else "expanded")


@pytest.mark.parametrize("form", ["expanded", "named"])
@pytest.mark.parametrize("symbols", ["all", "none", "lengths,m_2"])
def test_every_mix_of_symbols_and_numbers_agrees(form, symbols):
    robot = tw.robots.planar_3r()
    equations = derive(robot, symbols=symbols.split(","), form=form)
    assert_agrees(equations, robot)
    names = {p.name for p in equations.parameters}
    assert names <= {"none": set(), "lengths,m_2": {"L_1", "L_2", "m_2"}}.get(symbols, names)
    if symbols == "lengths,m_2":
        assert names == {"L_1", "L_2", "m_2"}


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize("where", ["end", "middle"])
def test_a_length_that_is_a_centre_of_mass_too_is_asked_for_as_either(where):
    """Masses at the ends of links are at the next joint or at the tip: one number, one symbol, of both kinds."""
    robot = tw.robots.planar_2r()
    lengths = coms = {"L_1", "L_2"}
    inertias = set()
    if where == "middle":
        for link in ("link1", "link2"):  # as much mass again at its joint
            robot = robot.with_payload(tw.SpatialInertia.from_com(1.0), link)
        lengths, coms, inertias = {"L_1"}, {"r_1", "r_2"}, {"I_1zz", "I_2zz"}  # the tip moves nothing
    named = {"lengths": lengths, "coms": coms, "inertias": inertias, "masses": {"m_1", "m_2"}, "gravity": {"g"}}
    for kinds in ({"lengths"}, {"coms"}, {"masses", "inertias", "gravity"}):
        equations = derive(robot, symbols=sorted(kinds))
        wanted = set().union(*(named[kind] for kind in kinds))
        moving = {symbol.name for symbol in (*equations.q, *equations.dq, *equations.ddq)}
        assert {parameter.name for parameter in equations.parameters} == wanted
        assert {symbol.name for symbol in sympy.Matrix(equations.tau).free_symbols} - moving == wanted


@pytest.mark.parametrize(
    ("kind", "form"),
    [
        *((kind, "expanded") for kind in ("revolute", "continuous", "prismatic", "helical", "planar", "floating")),
        *((kind, "named") for kind in ("helical", "planar", "floating")),
    ],
)
def test_every_kind_of_joint(kind, form):
    """The check against Newton–Euler is inside ``derive``; planar and floating joints go through their own coordinates."""
    robot = random_robot(3, 1, (kind,))
    equations = derive(robot, form=form)
    assert equations.check.worst < CLOSE


@pytest.mark.parametrize("form", ["expanded", "named"])
@pytest.mark.parametrize("seed", mostly_slow(range(3), 3))
def test_trees_with_mimic_joints(seed, form):
    """Ratios and offsets are any number: multiples of an angle that are not whole numbers."""
    robot = random_robot(seed, 3, ("revolute", "mimic", "helical", "prismatic"))
    equations = derive(robot, symbols=["masses"], form=form)
    assert_agrees(equations, robot)


@pytest.mark.parametrize("form", ["expanded", "named"])
def test_a_sliding_follower_moves_by_its_ratio(form):
    """Fingers of 1 kg, of which one moves against the other and twice as far: 1 + 2² kg."""
    inertia = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
    fingers = "".join(
        f'<link name="{name}">{inertia}</link><joint name="to_{name}" type="prismatic"><parent link="palm"/><child link="{name}"/>'
        f'<axis xyz="0 1 0"/><limit lower="-1" upper="1"/>{mimic}</joint>'
        for name, mimic in (("left", ""), ("right", '<mimic joint="to_left" multiplier="-2"/>'))
    )
    robot = tw.load(f'<robot name="gripper"><link name="palm"/>{fingers}</robot>')
    equations = derive(robot, form=form)
    assert_agrees(equations, robot)
    np.testing.assert_allclose(robot.mass_matrix([0.1]), [[5.0]], rtol=1e-12)


def test_floating_base():
    equations = derive(tw.robots.floating_box())
    assert [s.name for s in equations.q] == ["x_1", "y_1", "z_1", "alpha_1", "beta_1", "gamma_1"]
    assert equations.check.worst < CLOSE


@pytest.mark.parametrize("form", ["expanded", "named"])
def test_rotors_and_elastic_gears(form):
    drives = {
        "joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}},
        "joint2": {"ratio": 50, "stiffness": "800 N m/rad", "rotor": {"inertia": "1 kg cm^2", "extra": True}},
    }
    robot = tw.robots.planar_2r().with_actuators({"actuators": drives})
    equations = derive(robot, form=form)
    assert_agrees(equations, robot, ("inverse_dynamics", "mass_matrix", "coriolis_forces"))


def test_the_inertia_of_a_drive_is_that_of_its_joint_s_velocity_behind_a_joint_of_several():
    """The second joint, on a disc that slides and turns in a plane, is the fourth velocity."""
    builder = ModelBuilder("disc")
    for name in ("ground", "disc", "top"):
        builder.add_link(name, tw.SpatialInertia.from_com(2.0, [0, 0, 0], 0.1 * np.eye(3)))
    builder.add_joint("plane", "planar", "ground", "disc", axis=[0, 0, 1])
    builder.add_joint("turn", "revolute", "disc", "top", axis=[0, 0, 1], armature=0.7)
    entries = Namer(builder.build()).entries().armature
    assert [entry.value for entry in entries] == [0.0, 0.0, 0.0, 0.7]
    assert [entry.parameter and entry.parameter.name for entry in entries] == [None, None, None, "J_2"]


# ── the laws ──


@pytest.mark.parametrize("name", ["planar_2r", "cart_pole", "planar_3r", *slow("spatial_3r")])
def test_rate_of_M_less_2C_is_skew(name):
    equations = derive(ROBOTS[name]())
    rate = sum(
        (equations.mass_matrix.diff(q) * v for q, v in zip(equations.q, equations.dq, strict=True)),
        sympy.zeros(len(equations.q)),
    )
    N = rate - 2 * equations.coriolis_matrix
    assert (N + N.T).applyfunc(lambda x: sympy.expand(sympy.expand_trig(x))).applyfunc(sympy.trigsimp).is_zero_matrix


def test_christoffel_symbols_are_the_kernels():
    robot = tw.robots.planar_3r()
    equations = derive(robot)
    q = np.array([0.3, -0.7, 1.1])
    values = equations.values | dict(zip(equations.q, q, strict=True))
    gamma = np.array(
        [[[float(x.subs(values)) for x in row] for row in block] for block in equations.christoffel.tolist()]
    )
    assert_close(gamma, robot.christoffel(q), CLOSE)


def test_centripetal_and_coriolis_terms_add_up_to_c():
    equations = derive(spatial_3r())
    c = [sympy.Integer(0)] * 3
    for (i, j), b in equations.centripetal.items():
        c[i] += b * equations.dq[j] ** 2
    for (i, j, k), b in equations.coriolis.items():
        assert j < k
        c[i] += b * equations.dq[j] * equations.dq[k]
    states = np.random.default_rng(6).uniform(-2, 2, (3, 10, 3))
    values = Evaluator.from_state(equations, *states)
    assert_close(values.array(sympy.Matrix(c), (10,)), values.array(equations.coriolis_forces, (10,)), CLOSE)


def test_momentum_rates_less_slopes_are_the_torques():
    """The steps printed are the derivation, not beside it."""
    for robot in (tw.robots.planar_2r(), tw.robots.cart_pole()):
        equations = derive(robot)
        rates, slopes = equations.step("momentum_rates").lines, equations.step("slopes").lines
        for (_, rate), (_, slope), tau in zip(rates, slopes, equations.tau, strict=True):
            assert sympy.expand(rate - slope - tau) == 0


@pytest.mark.parametrize("name", ["planar_3r", "spatial_3r"])
def test_lagrangian_differentiated_by_sympy_gives_the_same_equations(name):
    """An independent differentiation of the printed L."""
    equations = derive(ROBOTS[name]())
    L, moving = equations.lagrangian, list(zip(equations.q, equations.dq, equations.ddq, strict=True))
    tau = []
    for q, v, _ in moving:
        p = L.diff(v)
        tau.append(sum(p.diff(a) * b + p.diff(b) * c for a, b, c in moving) - L.diff(q))
    values = Evaluator.from_state(equations, *np.random.default_rng(7).uniform(-2, 2, (3, 10, 3)))
    assert_close(values.array(sympy.Matrix(tau), (10,)), values.array(equations.tau, (10,)), CLOSE)


def test_squares_and_products_are_written_short():
    arm = derive(tw.robots.ur5(lock={"wrist_1_joint": 0, "wrist_2_joint": 0, "wrist_3_joint": 0}))
    M11 = arm.text("mass_matrix").splitlines()[1]
    assert "cos²(θ₂)" in M11
    assert "sin²(θ₂ + θ₃)" in M11
    assert "cos(2 θ₂)" not in M11


# ── what is refused ──


def test_unknown_symbols_are_named():
    with pytest.raises(UnknownNameError, match=r"L_3.*L_1"):
        derive(tw.robots.planar_2r(), symbols=["L_3"])
    with pytest.raises(UnknownNameError, match="masses"):
        derive(tw.robots.planar_2r(), symbols="mass")
    with pytest.raises(ValueRangeError, match="symbols=7"):
        derive(tw.robots.planar_2r(), symbols=7)


def test_too_large_is_said_before_starting(monkeypatch):
    robot = random_robot(1, 40, ("revolute",))
    monkeypatch.setattr("twistwrench.symbolic.intermediate_names.named_derivation", lambda *_: pytest.fail("started"))
    lines = derivation_size.named_lines(robot)
    with pytest.raises(ValueRangeError, match=f"{lines:,} lines.*[Ll]ock joints"):
        derive(robot)
    with pytest.raises(ValueRangeError, match=r"too large to write out.*(terms|products).*form='expanded'"):
        derive(tw.robots.panda(), form="expanded")


def test_nonsense_is_refused():
    with pytest.raises(ShapeError, match="robot"):
        derive(5)
    with pytest.raises(ValueRangeError, match="'expanded'"):
        derive(tw.robots.planar_2r(), form="long")
    locked = tw.robots.pendulum(lock={"hinge": 0.0})
    with pytest.raises(ValueRangeError, match="no joint"):
        derive(locked)
    with pytest.raises(UnknownNameError, match="mass_matrix"):
        derive(tw.robots.pendulum()).step("mass")
    with pytest.raises(UnknownNameError, match="inverse_dynamics"):
        derive(tw.robots.pendulum()).function("forward_dynamics")


def test_without_sympy_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(MissingExtraError, match=r"\[symbolic\]"):
        derive(tw.robots.planar_2r())
    with pytest.raises(MissingExtraError, match=r"\[symbolic\]"):
        tw.symbolic.lagrange("x", "x")


def test_a_wrong_derivation_is_not_done():
    """The check can fail: the equations of one arm are not those of another."""
    right = derive(tw.robots.planar_2r())
    heavier = tw.robots.planar_2r().with_payload(tw.SpatialInertia.from_com(1e-9))
    wrong = replace(right, check=check.check_derivation(right, heavier))
    assert (right.verdict.word, wrong.verdict.word) == ("DONE", "LOOK AGAIN")
    assert "disagree with Newton–Euler" in wrong.headline
    for source in (wrong.c_source, wrong.numpy_source, lambda: wrong.function("inverse_dynamics")):
        with pytest.raises(tw.KernelError, match="disagree with Newton–Euler"):
            source()


def test_no_sum_of_numbers_is_left_in_a_planar_arm():
    """0 and ±1 are exact: no term with 1e-17 in it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        equations = derive(tw.robots.planar_2r(), symbols="none")
    assert equations.mass_matrix == sympy.Matrix([[2 * cos(th2) + 3, cos(th2) + 1], [cos(th2) + 1, 1]])
