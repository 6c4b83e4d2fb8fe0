"""Calls shared among threads: the same bits as on one, whatever the arrays, the outputs and the errors."""

from __future__ import annotations

import gc
import warnings
import weakref

import numpy as np
import pytest
from thread_calls import same, states

import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads

pytest_plugins = ("thread_fixtures",)


# ── the same bits ──

QUANTITIES = {
    "inverse_dynamics": 3,
    "forward_dynamics": 3,
    "mass_matrix": 1,
    "kinetic_energy": 2,
    "link_poses": 1,
    "regressor": 3,
    "inverse_dynamics_derivatives": 3,
    "forward_dynamics_derivatives": 3,
}


@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_quantity(panda, jobs, name, dtype):
    arrays = [x.astype(dtype) for x in states(panda, 1501)][: QUANTITIES[name]]
    found = getattr(panda, name)(*arrays)
    assert len(jobs) == 1
    assert same(found, panda.kernel(name)(*arrays))


def test_a_floating_base(jobs, bundled):
    robot = bundled("quadruped")
    arrays = states(robot, 777)
    assert same(robot.forward_dynamics(*arrays), robot.kernel("forward_dynamics")(*arrays))
    assert len(jobs) == 1


SHAPES = [
    [(10007,)] * 3,
    [(3, 70000 // 30)] * 3,
    [(2, 3, 5, 71)] * 3,
    [(2, 2, 2, 2, 2, 2, 2, 2, 2, 2)] * 3,
    [(1, 3001)] * 3,
    [(3001, 1, 1)] * 3,
    [(3001,), (), ()],
    [(), (2, 1000), ()],
    [(50, 1), (60,), ()],
    [(1, 60), (50, 1), (7, 1, 1)],
    [(1, 1), (1, 2000), (3, 1)],
]


@pytest.mark.parametrize("shapes", SHAPES, ids=str)
def test_every_batch_shape_and_broadcast(panda, jobs, shapes):
    arrays = [states(panda, *shape)[k] for k, shape in enumerate(shapes)]
    assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))
    assert len(jobs) == 1


def test_parts_cover_every_sample_once_and_are_whole_blocks(panda):
    kernel, arrays = panda.kernel("inverse_dynamics"), states(panda, 100_003)
    its_parts, (tau,) = batch_threads.cut(kernel, tuple(arrays), None, 4)
    tau[...] = 0.0
    for part in its_parts:
        part.outputs[0][...] += 1.0
    assert np.all(tau == 1.0)
    assert len(its_parts) == 16
    assert all(len(part.outputs[0]) % batch_threads.ROWS == 0 for part in its_parts[:-1])


LAYOUTS = {
    "every second": lambda x: np.repeat(x, 2, axis=0)[::2],
    "backwards": lambda x: x[::-1],
    "columns backwards": lambda x: np.ascontiguousarray(x[:, ::-1])[:, ::-1],
    "Fortran order": np.asfortranarray,
    "transposed batch": lambda x: x.reshape(7, -1, 7).transpose(1, 0, 2),
    "broadcast to": lambda x: np.broadcast_to(x[0], x.shape),
    "not aligned": lambda x: np.frombuffer(b"." + x.tobytes(), np.uint8)[1:].view(x.dtype).reshape(x.shape),
    "other byte order": lambda x: x.astype(x.dtype.newbyteorder()),
    "float16": lambda x: x.astype(np.float16),
    "whole numbers": lambda x: x.astype(np.int32),
    "small whole numbers": lambda x: x.astype(np.int8),
    "a list": lambda x: x.tolist(),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_every_layout_and_type(panda, jobs, layout, dtype):
    arrays = [LAYOUTS[layout](x.astype(dtype)) for x in states(panda, 7 * 211)]
    assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))
    assert len(jobs) == 1


def test_types_may_be_mixed(panda, jobs):
    q, dq, ddq = states(panda, 1001)
    arrays = [q.astype(np.float32), dq, ddq[0].tolist()]
    assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))
    assert len(jobs) == 1


# ── out ──


def test_out_is_written_and_returned(panda, jobs):
    arrays = states(panda, 2003)
    expected = panda.kernel("inverse_dynamics")(*arrays)
    out = np.zeros((2003, 7))
    assert panda.inverse_dynamics(*arrays, out=out) is out
    assert same(out, expected)
    several = np.zeros((2, 2003, 7, 7))
    found = panda.inverse_dynamics_derivatives(*arrays, out=tuple(several))
    assert all(a.base is several for a in found)
    assert same(tuple(several), panda.kernel("inverse_dynamics_derivatives")(*arrays))
    assert len(jobs) == 2


def overlapping(buffer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return buffer[:-1], buffer[1:]


OUTS = {
    "a column apart": lambda x: (x, np.zeros((len(x), 8))[:, 1:]),
    "Fortran order": lambda x: (x, np.zeros(x.shape, order="F")),
    "the input": lambda x: (x, x),
    "a row further": lambda x: overlapping(np.concatenate([x, x[:1]])),
    "single precision": lambda x: (x, np.zeros(x.shape, np.float32)),
    "other byte order": lambda x: (x, np.zeros(x.shape, x.dtype.newbyteorder())),
    "a larger batch": lambda x: (x, np.zeros((2, *x.shape))),
}


@pytest.mark.parametrize("which", OUTS)
def test_an_out_that_must_be_written_in_order_stays_on_one_thread(panda, jobs, which):
    q, dq, _ = states(panda, 2003)
    expected = panda.kernel("bias_forces")(*OUTS[which](q)[:1], dq)
    x, out = OUTS[which](q.copy())
    try:
        found, problem = panda.bias_forces(x, dq, out=out), None
    except Exception as error:
        found, problem = out, error
    y, plain = OUTS[which](q.copy())
    try:
        panda.kernel("bias_forces")(y, dq, out=plain)
    except Exception as error:
        assert type(problem) is type(error)  # NumPy refuses it, on one thread and on several
    else:
        assert problem is None
        assert found is out
        assert same(out, plain)
        assert np.allclose(out, expected, rtol=1e-5, atol=1e-5)  # one of them is of single precision
    assert jobs == []


def test_two_outs_that_share_memory_stay_on_one_thread(panda, jobs):
    """As they would be without batch_threads, whatever NumPy makes of them; the method itself refuses them."""
    arrays, out = states(panda, 900), np.zeros((900, 7, 7))
    batch_threads.call(panda.kernel("inverse_dynamics_derivatives"), tuple(arrays), (out, out))
    assert jobs == []
    with pytest.raises(tw.ShapeError, match="share memory"):
        panda.inverse_dynamics_derivatives(*arrays, out=(out, out))


# ── which calls are shared ──


def test_nothing_is_shared_unless_asked_for(panda, jobs):
    tw.set_threads(1)
    panda.inverse_dynamics(*states(panda, 5000))
    assert jobs == []


def test_little_work_stays_on_one_thread(panda, jobs, monkeypatch):
    monkeypatch.undo()
    assert batch_threads.cut(panda.kernel("inverse_dynamics"), tuple(states(panda, 1000)), None, 2) is None
    assert batch_threads.cut(panda.kernel("inverse_dynamics"), tuple(states(panda, 70_000)), None, 2) is not None


def test_bare_kernels_and_numpys_stay_on_one_thread(panda, jobs, monkeypatch):
    arrays = states(panda, 1000)
    expected = panda.kernel("inverse_dynamics")(*arrays)
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    assert np.allclose(tw.robots.panda().inverse_dynamics(*arrays), expected, rtol=1e-12, atol=1e-12)
    assert jobs == []


class Tagged(np.ndarray):
    """A subclass, as units packages make them."""


def test_other_kinds_of_arrays_give_plain_ones(panda, jobs):
    """Methods give fresh arrays whatever they are given; the bare ufunc is as NumPy's are."""
    q = states(panda, 2000)[0]
    expected = panda.gravity_forces(q)
    for other in (q.view(Tagged), np.ma.masked_array(q, mask=False)):
        found = panda.gravity_forces(other)
        assert type(found) is np.ndarray
        np.testing.assert_array_equal(found, expected)
    assert type(panda.kernel("gravity_forces")(q.view(Tagged))) is Tagged


@pytest.mark.parametrize("size", [0, 1])
def test_none_and_one_sample(panda, jobs, size):
    arrays = states(panda, size)
    assert same(panda.inverse_dynamics(*arrays), panda.kernel("inverse_dynamics")(*arrays))


# ── errors and warnings ──


def test_1024_threads_are_the_most():
    before = tw.get_threads()
    try:
        tw.set_threads(1024)
        assert tw.get_threads() == 1024
        with pytest.raises(tw.ValueRangeError, match="from 1 \\(off\\) to 1024"):
            tw.set_threads(1025)
    finally:
        tw.set_threads(before)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda q, dq, ddq: (q[:, :6], dq, ddq),
        lambda q, dq, ddq: (q, dq[:-1], ddq),
        lambda q, dq, ddq: (q, dq, ddq.astype(complex)),
        lambda q, dq, ddq: (q, dq, [[1.0], [2.0, 3.0]]),
        lambda q, dq, ddq: (q, dq, "seven"),
    ],
)
def test_wrong_arguments_are_the_same_errors(panda, jobs, wrong):
    arrays = wrong(*states(panda, 1500))
    with pytest.raises(tw.ShapeError) as shared:
        panda.inverse_dynamics(*arrays)
    tw.set_threads(1)
    with pytest.raises(tw.ShapeError) as alone:
        panda.inverse_dynamics(*arrays)
    assert str(shared.value) == str(alone.value)


def infinite(robot: tw.Robot) -> list[np.ndarray]:
    arrays = states(robot, 3000)
    arrays[0][:] = np.inf  # in every part
    return arrays


def test_errstate_is_the_callers(panda, jobs):
    arrays = infinite(panda)
    with np.errstate(invalid="raise"), pytest.raises(FloatingPointError, match="invalid value"):
        panda.inverse_dynamics(*arrays)
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(panda.inverse_dynamics(*arrays)).any()
    with (
        np.errstate(invalid="warn"),
        pytest.warns(RuntimeWarning, match="invalid value encountered in inverse_dynamics"),
    ):
        panda.inverse_dynamics(*arrays)
    assert len(jobs) == 3


def test_memory_is_free_after_an_error(panda, jobs):
    arrays = infinite(panda)
    gone = [weakref.ref(a) for a in arrays]
    gc.collect()
    gc.disable()  # what is in a cycle of references stays
    try:
        for _ in range(5):
            try:
                with np.errstate(invalid="raise"):
                    panda.inverse_dynamics(*arrays)
            except FloatingPointError:
                jobs.clear()
            else:
                raise AssertionError
        tw.set_threads(1)
        del arrays
        assert all(ref() is None for ref in gone)
    finally:
        gc.enable()
