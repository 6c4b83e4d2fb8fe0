"""Matrices of long robots, by loops over pairs of joints: the same numbers as unrolled, on any tree, however they are asked for."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.ir.loops import Products
from twistwrench.compiler.ir.program import Program
from twistwrench.compiler.lowering.numpy_kernels import NumpyProducts
from twistwrench.compiler.lowering.target_machine import SINGLE, host
from twistwrench.compiler.runtime.gufunc import owner_of
from twistwrench.robot import Robot
from twistwrench.robot.kernels import large_robots
from twistwrench.testing import KINDS, random_robot

NAMES = ("mass_matrix", "inverse_dynamics_derivatives")
COUNT = 2 * host().lanes(SINGLE) + 3


def tree(seed: int, joints: int = 10, *, floating: bool = False) -> Robot:
    kinds = [kind for kind in KINDS if kind not in ("mimic", "fixed")]
    return random_robot(seed, joints, kinds, floating_base=floating)


@functools.cache
def in_loops(seed: int, *, floating: bool = False) -> Robot:
    """The same tree, its matrices made in loops, however small it is."""
    robot = tree(seed, floating=floating)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(large_robots, "PAIR_LOOP_FROM", 0)
        for name in NAMES:
            assert isinstance(owner_of(robot.kernel(name)).given, Products)
    return robot


def states(robot: Robot, count: int = COUNT) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(5)
    return robot.random_configuration(rng, count), *rng.standard_normal((2, count, robot.nv))


def sizes(robot: Robot, q: np.ndarray) -> np.ndarray:
    """What entries of M are at most, by Cauchy and Schwarz: the square root of the diagonal's product."""
    d = np.sqrt(np.einsum("...ii->...i", robot.mass_matrix(q)))
    return d[..., :, None] * d[..., None, :]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "floating"), [(1, False), (2, True)])
def test_trees_of_all_joints_have_the_matrices_they_have_unrolled(seed, floating):
    """Poses of random robots are some metres from the base, tips of a kilogram: 1e-15 times (distance over size)² of inertia."""
    plain, robot = tree(seed, floating=floating), in_loops(seed, floating=floating)
    q, dq, ddq = states(robot)
    size = sizes(plain, q)
    M = robot.mass_matrix(q)
    assert (np.abs(M - plain.mass_matrix(q)) <= 1e-10 * size).all()
    assert (np.swapaxes(M, -1, -2) == M).all()  # to the bit
    assert ((M == 0) == (plain.mass_matrix(q) == 0)).mean() > 0.95  # branches know nothing of each other
    for found, wanted in zip(
        robot.inverse_dynamics_derivatives(q, dq, ddq), plain.inverse_dynamics_derivatives(q, dq, ddq), strict=True
    ):
        assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()


def test_instructions_are_counted_where_their_estimate_is_not_enough(monkeypatch):
    monkeypatch.setattr(
        large_robots, "PAIR_LOOP_FROM", 10_000
    )  # of the quadruped 18,132 are estimated, and there are 4,869
    robot = Robot(tw.robots.quadruped().model)  # not one whose kernels are cached
    assert isinstance(owner_of(robot.kernel("inverse_dynamics_derivatives")).given, Program)
    monkeypatch.setattr(large_robots, "PAIR_LOOP_FROM", 1_000)
    robot = Robot(robot.model)
    assert isinstance(owner_of(robot.kernel("inverse_dynamics_derivatives")).given, Products)


def test_a_wrench_is_felt_by_the_derivatives():
    plain, robot = tree(4), tree(4)
    frame = robot.frame_names[-1]
    q, dq, ddq = states(robot, 5)
    F = np.random.default_rng(1).standard_normal((5, 6))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(large_robots, "PAIR_LOOP_FROM", 0)
        found = robot.inverse_dynamics_derivatives(q, dq, ddq, wrench_on_robot={frame: F})
    wanted = plain.inverse_dynamics_derivatives(q, dq, ddq, wrench_on_robot={frame: F})
    for a, b in zip(found, wanted, strict=True):
        assert np.abs(a - b).max() <= 1e-12 * np.abs(b).max()


def test_a_state_has_its_bits_wherever_it_stands():
    """Alone, in any batch, in rows with gaps, into arrays of other strides."""
    robot = in_loops(1)
    q, dq, ddq = states(robot)
    M, whole = robot.mass_matrix(q), robot.inverse_dynamics_derivatives(q, dq, ddq)
    n = robot.nv
    for some in (slice(0, 1), slice(3, 8), slice(None, None, 2)):
        assert (robot.mass_matrix(q[some]) == M[some]).all()
        for a, b in zip(robot.inverse_dynamics_derivatives(q[some], dq[some], ddq[some]), whole, strict=True):
            assert (a == b[some]).all()
    for _ in range(3):
        assert (robot.mass_matrix(q[4]) == M[4]).all()
    out = np.full((COUNT, n + 2, 2 * n), 7.0)
    robot.mass_matrix(np.asfortranarray(q), out=out[:, 1:-1, ::2])
    assert (out[:, 1:-1, ::2] == M).all()
    assert (out[:, :, 1::2] == 7.0).all()
    assert (out[:, [0, -1]] == 7.0).all()
    block = np.full((COUNT, n, n, n), 7.0)  # rows as far apart as those of one matrix, and entries of a row farther
    robot.mass_matrix(q, out=block[..., 0].swapaxes(1, 2))
    assert (block[..., 0].swapaxes(1, 2) == M).all()
    assert (block[..., 1:] == 7.0).all()


def test_many_states_go_past_the_caches_with_the_same_bits(monkeypatch):
    from twistwrench.compiler.lowering import product_loop

    monkeypatch.setattr(product_loop, "BEYOND_CACHES", 1)
    other = tree(1)
    monkeypatch.setattr(large_robots, "PAIR_LOOP_FROM", 0)
    many = other.kernel("mass_matrix")
    monkeypatch.undo()
    q = states(other)[0]
    assert (many(q) == in_loops(1).mass_matrix(q)).all()


def test_single_precision():
    robot = in_loops(1)
    arrays = states(robot)
    single = [a.astype(np.float32) for a in arrays]
    for name, count in (("mass_matrix", 1), ("inverse_dynamics_derivatives", 3)):
        found, wanted = (getattr(robot, name)(*some[:count]) for some in (single, arrays))
        for a, b in zip(*((x if isinstance(x, tuple) else (x,)) for x in (found, wanted)), strict=True):
            assert a.dtype == np.float32
            assert np.abs(a - b).max() <= 2e-4 * np.abs(b).max()


def test_numpy_makes_the_same_of_the_factors(monkeypatch):
    robot = in_loops(1)
    monkeypatch.setattr(large_robots, "PAIR_LOOP_FROM", 0)
    q, dq, ddq = states(robot, 4)
    for name, arrays in zip(NAMES, ((q,), (q, dq, ddq)), strict=True):
        products = large_robots.products_of(robot.model, {name: {}})
        slow, fast = NumpyProducts(products, name, "")(*arrays), robot.kernel(name)(*arrays)
        for a, b in zip(*((x if isinstance(x, tuple) else (x,)) for x in (slow, fast)), strict=True):
            assert np.abs(a - b).max() <= 1e-13 * np.abs(b).max()


def test_springs_and_armature_are_added(monkeypatch):
    """A chain of elastic joints in MuJoCo's format, which has both."""
    body = "".join(
        f'<body name="b{k}" pos="0 0 0.3"><joint name="j{k}" axis="{k % 2} {(k + 1) % 2} 0" stiffness="{k + 1}" '
        'armature="0.1"/><geom type="sphere" size="0.05" mass="1"/>'
        for k in range(16)
    )
    text = f"<mujoco><worldbody>{body}{'</body>' * 16}</worldbody></mujoco>"
    plain, robot = tw.load(text), tw.load(text)
    q, dq, ddq = states(robot, 5)
    for one in (plain, robot):
        for name in NAMES:
            one.kernel(name)
        monkeypatch.setattr(large_robots, "PAIR_LOOP_FROM", 0)
    assert isinstance(owner_of(robot.kernel("mass_matrix")).given, Products)
    assert (np.abs(robot.mass_matrix(q) - plain.mass_matrix(q)) <= 1e-10 * sizes(plain, q)).all()
    for a, b in zip(
        robot.inverse_dynamics_derivatives(q, dq, ddq), plain.inverse_dynamics_derivatives(q, dq, ddq), strict=True
    ):
        assert np.abs(a - b).max() <= 1e-12 * np.abs(b).max()


def test_short_robots_and_those_with_followers_stay_unrolled(bundled):
    for robot in (bundled("panda"), bundled("quadruped"), random_robot(2, 30, ("revolute", "mimic"))):
        for name in NAMES:
            assert large_robots.products_of(robot.model, {name: {}}) is None


def limbs(count: int, joints: int) -> str:
    """Limbs of revolute joints on one trunk."""
    inertial = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts = [f'<robot name="limbs"><link name="trunk">{inertial}</link>']
    for k in range(count):
        for j in range(joints):
            parent, axis = f"l{k}_{j - 1}" if j else "trunk", f"{j % 2} {(j + 1) % 2} 0"
            parts.append(
                f'<link name="l{k}_{j}">{inertial}</link><joint name="j{k}_{j}" type="continuous"><parent link="{parent}"/>'
                f'<child link="l{k}_{j}"/><origin xyz="0.1 0.02 0.3"/><axis xyz="{axis}"/></joint>'
            )
    return "".join([*parts, "</robot>"])


@pytest.mark.parametrize("name", NAMES)
def test_a_humanoid_stays_unrolled_and_a_chain_of_a_hundred_does_not(name):
    """Loops halve the speed of a humanoid's derivatives, whose joints mostly do not carry each other."""
    humanoid, chain = tw.load(limbs(4, 8), floating_base=True), tw.load(limbs(1, 100))
    assert (humanoid.nv, chain.nv) == (38, 100)
    assert large_robots.products_of(humanoid.model, {name: {}}) is None
    assert large_robots.products_of(chain.model, {name: {}}) is not None
