"""Calls of a compiled kernel on prepared rows: the kernel's own bits, plain arrays only, and all of it kept alive."""

import gc
import weakref

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.runtime.dispatch import bind_calls
from twistwrench.core.errors import KernelError


@pytest.fixture(scope="module")
def robot():
    return tw.robots.panda()


def prepared(robot, m=5):
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, m, robot.nv))
    tau = np.zeros((m, robot.nv))
    own, first = np.arange(m), np.zeros(m, int)
    operands = [(q, own), (dq, first), (ddq, own[::-1].copy()), (tau, own)]
    return bind_calls(robot.kernel("inverse_dynamics"), operands, taken=2, passed=3), (q, dq, ddq, tau)


def test_a_call_is_the_kernel_on_its_rows_to_the_last_bit(robot):
    call, (q, dq, ddq, tau) = prepared(robot)
    for k in range(5):
        expected = robot.inverse_dynamics(q[k], dq[0], ddq[4 - k])
        assert call(k) == expected[0]
        np.testing.assert_array_equal(tau[k], expected)
    given = np.linspace(-1.0, 1.0, robot.nv)
    assert call(2, given) == robot.inverse_dynamics(q[2], dq[0], given)[0]
    np.testing.assert_array_equal(ddq[2], given)


def test_rows_of_each_operand_are_as_far_apart_as_its_own_array_says(robot):
    rng, own = np.random.default_rng(1), np.arange(5)
    q, M = rng.normal(size=(5, robot.nv)), np.zeros((5, robot.nv, robot.nv))
    call = bind_calls(robot.kernel("mass_matrix"), [(q, own), (M, own)], taken=0, passed=1)
    assert [call(k) for k in range(5)] == robot.mass_matrix(q)[:, 0, 0].tolist()
    np.testing.assert_array_equal(M, robot.mass_matrix(q))


def test_what_is_no_plain_array_of_that_size_does_nothing(robot):
    call, (_, _, ddq, tau) = prepared(robot)
    before = ddq.copy()
    n = robot.nv
    given = [
        None,
        1.0,
        [0.0] * n,
        np.zeros(n, np.float32),
        np.zeros(n, int),
        np.zeros(n + 1),
        np.zeros(n - 1),
        np.zeros((1, n)),
    ]
    given += [
        np.zeros(2 * n)[::2],
        np.zeros(n, ">f8"),
        np.zeros(n).view(np.recarray),
        np.zeros(()),
        np.ma.zeros(n),
        "text",
    ]
    for other in given:
        assert call(0, other) is None
    np.testing.assert_array_equal(ddq, before)
    assert not tau.any()


def test_it_keeps_what_it_points_to(robot):
    call, (q, dq, ddq, tau) = prepared(robot)
    expected = call(1)
    del q, dq, ddq, tau
    gc.collect()
    junk = [np.full((5, 7), np.nan) for _ in range(100)]
    assert call(1) == expected and len(junk) == 100


def test_it_is_freed_with_its_arrays(robot):
    class Watched(np.ndarray):
        pass

    call, _ = prepared(robot)
    rows = np.zeros((1, robot.nv)).view(Watched)
    one = np.zeros(1, int)
    plain = np.zeros((1, robot.nv))
    call = bind_calls(robot.kernel("inverse_dynamics"), [(rows, one), *[(plain, one)] * 3], 2, 3)
    call(0)
    gone = weakref.ref(rows)
    del rows
    assert gone() is not None
    del call
    gc.collect()
    assert gone() is None


def test_rows_that_do_not_fit_and_kernels_on_numpy_are_refused(robot):
    kernel, one = robot.kernel("inverse_dynamics"), np.zeros(1, int)
    for wrong in (np.zeros((1, 6)), np.zeros((1, 7), np.float32)):
        with pytest.raises(KernelError, match="rows"):
            bind_calls(kernel, [(np.zeros((1, 7)), one)] * 3 + [(wrong, one)], 2, 3)
    with pytest.raises(KernelError, match="compiled kernels only"):
        bind_calls(np.add, [(np.zeros((1, 7)), one)] * 3, 0, 2)
