"""Robots from Denavit–Hartenberg tables: where the joints are, what the links weigh, and what is not a table.

EXACT: a dozen products of 4×4 matrices on both sides. The builder takes entries of fixed rotations within 1e-9 of 0 or ±1 to be
that, and the tables here have none nearer than that which are not.
"""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.symbolic import derive
from twistwrench.testing import assert_close

EXACT = 1e-13
HALF = np.pi / 2
PUMA = {
    "d": [0.67183, 0, 0.15005, 0.4318, 0, 0],
    "a": [0, 0.4318, 0.0203, 0, 0, 0],
    "alpha": [HALF, 0, -HALF, HALF, -HALF, 0],
}
PUMA_MASSES = [0, 17.4, 4.8, 0.82, 0.34, 0.09]
PUMA_COMS = [[0, 0, 0], [-0.3638, 0.006, 0.2275], [-0.0203, -0.0141, 0.07], [0, 0.019, 0], [0, 0, 0], [0, 0, 0.032]]


def turn(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    T[i, i] = T[j, j] = c
    T[i, j], T[j, i] = -s, s
    return T


def slide(axis, distance):
    T = np.eye(4)
    T[axis, 3] = distance
    return T


def composed(convention, types, table, q):
    """Poses of all link frames in {0}, factor by factor as the books write the row's matrix."""
    T, found = np.eye(4), []
    for i, kind in enumerate(types):
        theta = table["theta"][i] + (q[i] if kind == "revolute" else 0.0)
        d = table["d"][i] + (q[i] if kind == "prismatic" else 0.0)
        along_z, along_x = turn(2, theta) @ slide(2, d), turn(0, table["alpha"][i]) @ slide(0, table["a"][i])
        T = T @ (along_z @ along_x if convention == "standard" else along_x @ along_z)
        found.append(T)
    return found


def random_table(rng, n):
    types = list(rng.choice(["revolute", "prismatic"], n))
    table = {name: rng.uniform(-2, 2, n) for name in ("theta", "d", "a", "alpha")}
    return types, table


def test_gravity_torques_of_the_puma_560():
    puma = tw.from_dh(PUMA, masses=PUMA_MASSES, coms=PUMA_COMS)
    g = puma.gravity_forces([0, np.pi / 4, np.pi, 0, np.pi / 4, 0])
    assert np.abs(g - [0, 31.6399, 6.0351, 0, 0.0283, 0]).max() <= 5e-5  # four decimals printed


def test_the_puma_560_with_moments_of_inertia_weighs_the_same_and_can_be_let_go():
    points = tw.from_dh(PUMA, masses=PUMA_MASSES, coms=PUMA_COMS)
    assert len(points.defects) == 5
    moments = np.multiply.outer([0, 0.2, 0.05, 2e-3, 5e-4, 1e-4], np.eye(3))
    puma = tw.from_dh(PUMA, masses=PUMA_MASSES, coms=PUMA_COMS, moments_about_com=moments)
    assert puma.defects == ()
    q = np.array([0, np.pi / 4, np.pi, 0, np.pi / 4, 0])
    g = puma.gravity_forces(q)
    assert_close(g, points.gravity_forces(q), EXACT, "g", scale=10.0)
    assert_close(puma.forward_dynamics(q, np.zeros(6), g), np.zeros(6), 1e-9, "held still", scale=1.0)
    with pytest.raises(tw.SingularMassMatrixError, match="joint6"):
        points.forward_dynamics(q, np.zeros(6), g)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("seed", mostly_slow(range(5), 3))
def test_every_link_frame_is_where_the_rows_matrices_put_it(convention, seed):
    rng = np.random.default_rng(seed)
    n = 4
    types, table = random_table(rng, n)
    robot = tw.from_dh(table, convention=convention, joint_types=types)
    assert robot.tip == f"link{n}"
    for _ in range(3):
        q = rng.uniform(-3, 3, n)
        for i, T in enumerate(composed(convention, types, table, q)):
            assert_close(robot.forward_kinematics(q, f"link{i + 1}"), T, EXACT, f"T_0{i + 1}", scale=10.0)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_torques_are_the_slopes_of_the_potential_energy_in_the_rows_matrices(convention):
    """g_i = ∂P/∂q_i with P = -Σ m gᵀ c, the centres of mass moved by independently composed poses; central differences."""
    rng = np.random.default_rng(7)
    n, gravity = 4, np.array([1.0, -2.0, -9.0])
    types, table = random_table(rng, n)
    masses, coms = rng.uniform(0.5, 2, n), rng.standard_normal((n, 3))
    robot = tw.from_dh(table, convention=convention, joint_types=types, masses=masses, coms=coms, gravity=gravity)
    q = rng.uniform(-3, 3, n)

    def potential(x):
        poses = composed(convention, types, table, x)
        return -sum(m * gravity @ (T[:3, :3] @ c + T[:3, 3]) for m, c, T in zip(masses, coms, poses, strict=True))

    h = 1e-5
    slopes = [(potential(q + h * e) - potential(q - h * e)) / (2 * h) for e in np.eye(n)]
    assert_close(robot.gravity_forces(q), slopes, 1e-8, "g")  # h² of the third derivative, and rounding over h


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_inertias_are_about_the_centre_of_mass_along_the_link_frame(convention):
    """½ q̇' M q̇ = Σ ½ m |ċ|² + ½ ω' R I R' ω, velocities by central differences of independently composed poses."""
    rng = np.random.default_rng(8)
    n = 3
    types, table = random_table(rng, n)
    masses, coms = rng.uniform(0.5, 2, n), rng.standard_normal((n, 3))
    moments = [
        tw.SpatialInertia.from_points(np.ones(6), p - p.mean(0)).moment_about_com
        for p in rng.standard_normal((n, 6, 3))
    ]
    robot = tw.from_dh(
        table, convention=convention, joint_types=types, masses=masses, coms=coms, moments_about_com=moments
    )
    q, dq, h = rng.uniform(-3, 3, n), rng.standard_normal(n), 1e-5
    before, now, after = (composed(convention, types, table, q + s * h * dq) for s in (-1, 0, 1))
    K = 0.0
    for m, c, I, A, T, B in zip(masses, coms, moments, before, now, after, strict=True):
        rate = (B - A) / (2 * h)
        v, W = rate[:3, :3] @ c + rate[:3, 3], T[:3, :3].T @ rate[:3, :3]
        w = np.array([W[2, 1], W[0, 2], W[1, 0]])
        K += 0.5 * m * v @ v + 0.5 * w @ I @ w
    assert float(robot.kinetic_energy(q, dq)) == pytest.approx(K, rel=1e-8)


def test_the_two_conventions_describe_one_robot_when_alpha_and_a_are_shifted():
    """Row i of the modified table has the a and alpha of row i - 1 of the standard one; what is left is the last link's."""
    rng = np.random.default_rng(9)
    types, table = random_table(rng, 4)
    shifted = {**table, **{name: np.r_[0.0, table[name][:-1]] for name in ("a", "alpha")}}
    end = turn(0, table["alpha"][-1]) @ slide(0, table["a"][-1])
    standard = tw.from_dh(table, joint_types=types)
    modified = tw.from_dh(shifted, joint_types=types, convention="modified", tool=end)
    assert modified.tip == "tool"
    q = rng.uniform(-3, 3, (5, 4))
    assert_close(modified.forward_kinematics(q), standard.forward_kinematics(q), EXACT, "T", scale=10.0)
    assert_close(modified.jacobian(q), standard.jacobian(q), EXACT, "J", scale=10.0)


def test_a_table_may_be_columns_rows_or_an_array_that_says_its_order():
    rng = np.random.default_rng(10)
    types, table = random_table(rng, 3)
    rows = [{name: float(x[i]) for name, x in table.items()} for i in range(3)]
    order = ("alpha", "a", "d", "theta")
    array = np.column_stack([table[name] for name in order])
    q = rng.uniform(-3, 3, 3)
    T = tw.from_dh(table, joint_types=types).forward_kinematics(q)
    assert np.array_equal(tw.from_dh(rows, joint_types=types).forward_kinematics(q), T)
    assert np.array_equal(tw.from_dh(array, columns=order, joint_types=types).forward_kinematics(q), T)


def test_names_and_moving_bodies():
    robot = tw.from_dh(PUMA, joint_names=["waist", "shoulder", "elbow", "roll", "pitch", "yaw"], name="puma")
    assert robot.name == "puma"
    assert robot.joint_names[1] == "shoulder"
    assert robot.body_names == tuple(f"axis{i}" for i in range(1, 7))
    assert tw.from_dh(PUMA, convention="modified").body_names == tuple(f"link{i}" for i in range(1, 7))


HEAVY = {"masses": [1.0], "moments_about_com": [np.diag([1.0, 0.1, 0.1])]}
BAD = [
    ({"table": {"a": [1, 2], "d": [1]}}, tw.ShapeError, r"a \(2,\), d \(1,\)"),
    ({"table": {}}, tw.ShapeError, "one at least"),
    ({"table": {"r": [1]}}, tw.UnknownNameError, "'r'.*theta, d, a, alpha"),
    ({"table": {"a": [np.nan]}}, tw.ValueRangeError, "column 'a'"),
    ({"table": {"a": ["x"]}}, tw.TwistWrenchError, "column 'a'"),
    ({"table": [{"a": 1, "beta": 2}]}, tw.UnknownNameError, "'beta'"),
    ({"table": np.zeros((2, 4))}, tw.ValueRangeError, "columns="),
    ({"table": np.zeros((2, 3)), "columns": ("theta", "d", "a", "alpha")}, tw.ShapeError, r"\(n, 4\)"),
    ({"table": np.zeros((2, 4)), "columns": ("theta", "d", "a", "a")}, tw.ValueRangeError, "once"),
    ({"table": 3.0}, tw.ShapeError, r"\(n, 4\)"),
    ({"table": {"a": [1]}, "convention": "craig"}, tw.UnknownNameError, "'craig'.*standard, modified"),
    ({"table": {"a": [1]}, "joint_types": ["hinge"]}, tw.UnknownNameError, "joint1.*'hinge'.*revolute, prismatic"),
    ({"table": {"a": [1]}, "joint_types": ["revolute"] * 2}, tw.ShapeError, "joint_types"),
    ({"table": {"a": [1]}, "joint_types": 3}, tw.ShapeError, "joint_types is 3"),
    ({"table": {"a": [1]}, "joint_names": "ab"}, tw.ShapeError, "joint_names"),
    ({"table": {"a": [1]}, "masses": [1, 2]}, tw.ShapeError, r"masses has shape \(2,\)"),
    ({"table": {"a": [1]}, "coms": [1, 2, 3]}, tw.ShapeError, r"coms has shape \(3,\)"),
    ({"table": {"a": [1]}, "masses": [-1]}, tw.InertiaError, "link1"),
    ({"table": {"a": [1]}, "masses": [1], "moments_about_com": [np.triu(np.ones((3, 3)))]}, tw.InertiaError, "link1.*symmetric"),
    ({"table": {"a": [1]}, **HEAVY}, tw.InertiaError, "link1"),
    ({"table": {"a": [1]}, "tool": np.ones((4, 4))}, tw.ValueRangeError, "tool"),
    ({"table": {"a": [1]}, "tool": np.eye(3)}, tw.ShapeError, "tool"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "error", "message"), BAD, ids=[b[2] for b in BAD])
def test_what_is_no_table_is_an_error_that_says_why(arguments, error, message):
    with pytest.raises(error, match=message):
        tw.from_dh(**arguments)


@pytest.mark.parametrize(("column", "row"), [("alpha", 1), ("theta", 3)])
def test_angles_in_degrees_are_doubted(column, row):
    table = {"a": [0.3, 0.2, 0.1], column: [0.0] * 3}
    table[column][row - 1] = -90.0
    told = rf"{column} of row {row} of the .* table is -90, more than a whole turn.*radians\?.*np\.radians\({column}\)"
    with pytest.warns(tw.ModelWarning, match=told):
        robot = tw.from_dh(table)
    assert column in robot.defects[0]


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_angles_of_a_whole_turn_are_not_doubted(convention):
    assert not tw.from_dh({"alpha": [2 * np.pi, -np.pi], "theta": [-2 * np.pi, 6.0]}, convention=convention).defects


def test_an_impossible_body_may_be_accepted():
    robot = tw.from_dh({"a": [1.0]}, **HEAVY, inertia="accept")
    assert any("cannot exist" in remark for remark in robot.defects)


def test_a_rod_with_one_moment_is_refused_with_what_a_planar_problem_needs():
    """The moment about the other axis across the rod changes no torque in the plane."""
    table, gravity = {"a": [1.0, 1.0]}, (0, -9.81, 0)
    with pytest.raises(tw.InertiaError, match=r"diag\(\[0, I, I\]\) if it lies along x\. In a planar problem"):
        tw.from_dh(table, masses=[1, 1], moments_about_com=[np.diag([0, 0, 1 / 12])] * 2)
    with pytest.raises(tw.InertiaError) as caught:
        tw.from_dh(table, masses=[1, 1], moments_about_com=[np.diag([1, 1, 3.0])] * 2)
    assert "planar" not in str(caught.value)
    rods = [
        tw.from_dh(table, masses=[1, 1], moments_about_com=[np.diag([0, 1 / 12, 1 / 12])] * 2, gravity=gravity),
        tw.from_dh(table, masses=[1, 1], moments_about_com=[np.diag([1 / 12, 1 / 12, 1 / 12])] * 2, gravity=gravity),
    ]
    states = [0.3, -0.7], [1.0, 2.0], [0.5, -0.5]
    np.testing.assert_allclose(*(rod.inverse_dynamics(*states) for rod in rods), rtol=1e-12)


def test_derived_symbols_name_links_and_joints_and_no_frame_of_the_reader():
    """The moving bodies of the standard convention are called axis1, axis2, which no table has."""
    arm = tw.from_dh({"a": [1.0, 1.0]}, masses=[1, 1], coms=[[-0.4, 0, 0]] * 2, moments_about_com=[np.eye(3)] * 2)
    meanings = [p.meaning for p in derive(arm).parameters]
    assert "mass of link1 [kg]" in meanings and "x of the centre of mass of link2 from joint joint2 [m]" in meanings
    assert "x of joint joint2 from joint joint1 [m]" in meanings and not any("axis1" in text for text in meanings)
