"""∂ddq by a loop over columns: the same numbers as unrolled, on any tree, however they are asked for."""

from __future__ import annotations

import re

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.ir.loops import ColumnSolve
from twistwrench.compiler.lowering import batch_loop
from twistwrench.compiler.lowering.batch_loop import LINE
from twistwrench.compiler.lowering.numpy_kernels import NumpyColumns
from twistwrench.compiler.lowering.partition import partitioned
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, host
from twistwrench.compiler.runtime.gufunc import owner_of
from twistwrench.robot import Robot
from twistwrench.robot.kernels import large_robots
from twistwrench.testing import KINDS, random_robot

NAME = "forward_dynamics_derivatives"
COUNT = 2 * host().lanes(SINGLE) + 3
TREES = [(1, False, ()), (2, True, ()), (3, False, ("mimic",)), (4, True, ("mimic",))]


def tree(seed: int, floating: bool, more: tuple[str, ...] = ()) -> Robot:
    kinds = [kind for kind in KINDS if kind not in ("mimic", "fixed")]
    return random_robot(seed, 5, (*kinds, *more), floating_base=floating)


def kernel_of(robot: Robot, monkeypatch: pytest.MonkeyPatch, least: int):
    """A kernel with a loop from so many pairs of joints on."""
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", least)
    kernel = tw.Robot(robot.model).kernel(NAME)
    assert isinstance(owner_of(kernel).given, ColumnSolve) == (least == 0)
    return kernel


def states(robot: Robot, count: int = COUNT) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(5)
    return robot.random_configuration(rng, count), *rng.standard_normal((2, count, robot.nv))


def off(found, wanted) -> float:
    """The largest difference, as a share of the largest entry of its matrix."""
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(found, wanted, strict=True))


@pytest.mark.parametrize(
    ("seed", "floating", "more"),
    mostly_slow([TREES[0], TREES[3], *(pytest.param(*tree, marks=pytest.mark.slow) for tree in TREES[1:3])], 2),
)
def test_trees_of_all_joints_have_the_derivatives_they_have_unrolled(seed, floating, more, monkeypatch):
    """The same operations, but for products that one of the two fuses into sums: 1e-12 leaves room for condition."""
    robot = tree(seed, floating, more)
    plain, loop = (kernel_of(robot, monkeypatch, least) for least in (10**9, 0))
    found, wanted = loop(*states(robot)), plain(*states(robot))
    assert off(found, wanted) <= 1e-12


def test_branches_that_stand_on_the_base_know_nothing_of_each_other(monkeypatch):
    """Entries of two legs are zero in every state; a single state may round to zero in one of two programs alone."""
    robot = tw.load(tw.robots.path_of("quadruped"), floating_base=False)
    matrices = [kernel_of(robot, monkeypatch, least)(*states(robot)) for least in (10**9, 0)]
    legs = np.array([name[:2] for name in robot.velocity_names])
    zeros = [(matrix == 0).all(axis=0) for found in matrices for matrix in found]
    for zero in zeros:
        assert zero[legs[:, None] != legs].all()
    np.testing.assert_array_equal(zeros[:3], zeros[3:])


@pytest.mark.parametrize(
    ("seed", "floating", "more", "precision"),
    mostly_slow([(*TREES[2], np.float64), (*TREES[3], np.float64), (*TREES[0], np.float32)], 3),
)
def test_columns_of_one_state_side_by_side_have_the_bits_they_have_one_by_one(
    seed, floating, more, precision, monkeypatch
):
    """In rows that held other numbers before, and in arrays of the caller's."""
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", 0)
    robot = tree(seed, floating, more)
    alone_as_in_a_batch(robot, [x.astype(precision) for x in states(robot)])


def test_more_columns_side_by_side_than_a_vector_has_lanes(monkeypatch):
    """Ten of one matrix follow each other, and eight numbers are a vector: none is left out."""
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", 0)
    bodies = "".join(
        f'<body pos="0 0 0.1"><joint type="hinge" axis="{k % 2} {1 - k % 2} 0"/><geom type="sphere" size="0.1" mass="1"/>'
        for k in range(10)
    )
    robot = tw.load(f"<mujoco><worldbody>{bodies}{10 * '</body>'}</worldbody></mujoco>")
    alone_as_in_a_batch(robot, states(robot))


def alone_as_in_a_batch(robot: Robot, arrays) -> None:
    """The calls after the first few go by code for one state."""
    whole = robot.forward_dynamics_derivatives(*arrays)
    out = tuple(np.full_like(x[0], np.nan) for x in whole)
    for _ in range(200):
        robot.forward_dynamics_derivatives(*(x[0] for x in arrays), out=out)
    for k in range(COUNT):
        row = [x[k] for x in arrays]
        for found in (robot.forward_dynamics_derivatives(*row), robot.forward_dynamics_derivatives(*row, out=out)):
            assert all(np.array_equal(a, b[k]) for a, b in zip(found, whole, strict=True))
    assert type(robot.forward_dynamics_derivatives) is type(len)


def test_columns_that_follow_each_other_in_two_matrices_are_no_run(monkeypatch):
    """Torques of a sprung hinge depend on its angle alone as they do on the velocity of the slide behind it."""
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", 0)
    hinge, slide = '<joint type="hinge" axis="0 0 1" stiffness="40"/>', '<joint type="slide" axis="1 0 0"/>'
    ball = '<geom type="sphere" size="0.1" mass="2"/>'
    robot = tw.load(
        f'<mujoco><worldbody><body>{hinge}{ball}<body pos="0.4 0 0">{slide}{ball}</body></body></worldbody></mujoco>'
    )
    groups = large_robots.columns_of(robot.model, {NAME: {}}).groups
    assert ((0, 0), (1, 1)) in [group.places for group in groups]
    alone_as_in_a_batch(robot, states(robot))


def test_constants_are_there_in_every_block(monkeypatch):
    """Springs are constants, which come where the solutions of the block before were left."""
    joint = '<joint name="{0}" type="{1}" axis="{2}" stiffness="{3}"/>'
    hinge = joint.format("a", "hinge", "0 1 0", 40)
    slide = joint.format("b", "slide", "1 0 0", 70)
    text = (
        f'<mujoco><worldbody><body name="one">{hinge}<geom type="sphere" size="0.1" mass="2"/>'
        f'<body name="two" pos="0 0 0.4">{slide}<geom type="sphere" size="0.1" mass="3"/></body></body></worldbody></mujoco>'
    )
    robot = tw.load(text)
    plain, loop = (kernel_of(robot, monkeypatch, least) for least in (10**9, 0))
    assert off(loop(*states(robot)), plain(*states(robot))) <= 1e-13
    alone_as_in_a_batch(tw.Robot(robot.model), states(robot))


def test_a_state_has_its_bits_wherever_it_stands(monkeypatch):
    """Alone, in any batch, in rows with gaps, into arrays of other strides."""
    robot = tree(1, True)
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", 0)
    arrays = states(robot)
    whole = robot.forward_dynamics_derivatives(*arrays)
    for some in (slice(0, 1), slice(3, 8), slice(None, None, 2)):
        for a, b in zip(robot.forward_dynamics_derivatives(*(x[some] for x in arrays)), whole, strict=True):
            assert (a == b[some]).all()
    for _ in range(3):
        for a, b in zip(robot.forward_dynamics_derivatives(*(x[4] for x in arrays)), whole, strict=True):
            assert (a == b[4]).all()
    n = robot.nv
    out = tuple(np.full((COUNT, n + 2, 2 * n), 7.0) for _ in whole)
    robot.forward_dynamics_derivatives(*arrays, out=tuple(x[:, 1:-1, ::2] for x in out))
    for a, b in zip(out, whole, strict=True):
        assert (a[:, 1:-1, ::2] == b).all()
        assert (a[:, :, 1::2] == 7.0).all()
        assert (a[:, [0, -1]] == 7.0).all()


@pytest.mark.parametrize("dtype", mostly_slow([np.float64, np.float32], 2))
@pytest.mark.parametrize("name", [NAME, "mass_matrix"])
def test_results_past_the_caches_have_the_same_bits(name, dtype, monkeypatch):
    """From arrays at any place: whole vectors where arrays begin with one, else not past the caches at all."""
    from twistwrench.compiler.lowering import lower

    monkeypatch.setattr(lower, "MAX_INSTRUCTIONS", 0)
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", 0)
    robot = random_robot(3, 4, ("revolute", "prismatic"), floating_base=True)
    arrays = [x.astype(dtype) for x in states(robot)][: None if name == NAME else 1]
    near = tw.Robot(robot.model).kernel(name)
    wanted = near(*arrays)
    wanted = wanted if isinstance(wanted, tuple) else (wanted,)
    monkeypatch.setattr(batch_loop, "BEYOND_CACHES", 1)
    far = tw.Robot(robot.model).kernel(name)
    far(*arrays)
    for start in range(0, 64, np.dtype(dtype).itemsize):
        out = []
        for x in wanted:
            room = np.full(x.nbytes + 192, 7, np.uint8)
            first = -room.ctypes.data % 64 + start
            out.append((room, first, room[first : first + x.nbytes].view(dtype).reshape(x.shape)))
        far(*arrays, out=tuple(view for _, _, view in out))
        for (room, first, view), x in zip(out, wanted, strict=True):
            assert (view == x).all()
            assert (room[:first] == 7).all()
            assert (room[first + x.nbytes :] == 7).all()


def test_single_precision(monkeypatch):
    robot = tree(1, True)
    kernel, arrays = kernel_of(robot, monkeypatch, 0), states(robot)
    found, wanted = kernel(*(a.astype(np.float32) for a in arrays)), kernel(*arrays)
    assert all(a.dtype == np.float32 for a in found)
    assert off(found, wanted) <= 1e-3


@pytest.mark.slow
def test_numpy_works_on_the_same_columns(monkeypatch):
    robot = tree(2, True)
    kernel, arrays = kernel_of(robot, monkeypatch, 0), states(robot, 4)
    slow = NumpyColumns(large_robots.columns_of(robot.model, {NAME: {}}), NAME, "")
    assert off(slow(*arrays), kernel(*arrays)) <= 1e-12
    out = tuple(np.empty((4, robot.nv, robot.nv)) for _ in range(3))
    assert slow(*arrays, out=out)[1] is out[1]
    assert off(out, kernel(*arrays)) <= 1e-12


@pytest.mark.parametrize("precision", [DOUBLE, SINGLE], ids=lambda p: p.char)
@pytest.mark.parametrize("bits", mostly_slow([0, 128, 256, 512], 2))
@pytest.mark.parametrize("name", [NAME, "inverse_dynamics_derivatives"])
def test_the_frame_has_room_for_all_that_sections_put_into_it(name, bits, precision, monkeypatch):
    """In the text, for a few bytes beyond a frame are seldom missed: the last place ends where it does, or a line before."""
    monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", 0)
    monkeypatch.setattr(batch_loop, "ON_STACK", 1 << 30)  # what is taken elsewhere has its size in other words
    engine = tw.Robot(tree(3, False).model).engine
    program = large_robots.columns_of(engine.model, {NAME: {}}) if name == NAME else engine.program((name,), {})
    machine = host().narrowed(bits or precision.bits)
    text = "\n".join(partitioned(program, precision, machine, batch_loop.loop))
    (room,) = map(int, re.findall(r"= alloca \[(\d+) x i8\]", text))
    last = max(map(int, re.findall(r"getelementptr i8, ptr %frame, i64 (\d+)", text)))
    assert last + machine.lanes(precision) * precision.bytes <= room <= last + LINE


def test_a_wrench_is_felt(monkeypatch):
    robot = tree(4, False)
    frame, F = robot.frame_names[-1], np.random.default_rng(1).standard_normal((COUNT, 6))
    plain, loop = tw.Robot(robot.model), tw.Robot(robot.model)
    found = []
    for one, least in ((plain, 10**9), (loop, 0)):
        monkeypatch.setattr(large_robots, "COLUMN_LOOP_FROM", least)
        found.append(one.forward_dynamics_derivatives(*states(robot), wrench_on_robot={frame: F}))
    assert off(found[1], found[0]) <= 1e-12
    assert off(found[1], loop.forward_dynamics_derivatives(*states(robot))) > 1e-6


def test_arms_have_loops_and_small_robots_have_none(bundled):
    assert large_robots.columns_of(bundled("panda").model, {NAME: {}}) is not None
    assert large_robots.columns_of(bundled("pendulum").model, {NAME: {}}) is None
    assert large_robots.columns_of(bundled("panda").model, {"mass_matrix": {}}) is None
