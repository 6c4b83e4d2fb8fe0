"""Room for results: one block for those of a call, huge pages lent where they are large; and results past the caches."""

from __future__ import annotations

import gc
import mmap
import os
import subprocess
import sys
import threading

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.lowering import batch_loop, target_machine
from twistwrench.compiler.runtime import batch_threads, result_pool
from twistwrench.compiler.runtime.gufunc import make_ufunc
from twistwrench.testing import random_state

WAIT = 120.0


@pytest.fixture(scope="module")
def panda():
    return tw.robots.panda()


def states(robot, count):
    return random_state(robot, np.random.default_rng(count), (count,))


def address(array):
    return array.__array_interface__["data"][0]


@pytest.fixture
def pool(monkeypatch):
    """A pool of our own, from which everything from 1 MB on is lent."""
    if not result_pool.may_use_huge_pages():
        pytest.skip("this system has no huge pages to ask for")
    own = result_pool.ResultPool()
    monkeypatch.setattr(result_pool, "_POOL", own)
    monkeypatch.setattr(result_pool, "bound", lambda: 24 * result_pool.PAGE)
    monkeypatch.setattr(result_pool, "MIN_SEPARATE", 1 << 20)
    monkeypatch.setattr(batch_threads, "ONE_ROOM", 1 << 20)
    return own


# ── one block ──


@pytest.mark.parametrize("name", ["inverse_dynamics_derivatives", "forward_dynamics_derivatives"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_several_results_are_views_of_one_block_with_the_bits_of_the_kernel(panda, name, dtype):
    arrays = [x.astype(dtype) for x in states(panda, 1001)]
    found = getattr(panda, name)(*arrays)
    for one, other in zip(found, panda.kernel(name)(*arrays), strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == dtype
        assert one.flags.c_contiguous
        assert one.flags.writeable
        assert one.flags.aligned
        assert address(one) % 16 == 0
        assert one.base is found[0].base is not None
    assert not any(np.shares_memory(a, b) for k, a in enumerate(found) for b in found[:k])


def test_large_results_begin_with_a_line_of_the_cache(panda):
    assert all(address(x) % 64 == 0 for x in panda.inverse_dynamics_derivatives(*states(panda, 5000)))
    assert address(panda.mass_matrix(states(panda, 50_000)[0])) % 64 == 0  # 20 MB


def test_each_of_several_results_begins_with_a_line_of_the_cache():
    """136 bytes of the first are two lines and an eighth."""
    found = result_pool.result_arrays([(17,), (200_000,), (3, 5)], np.dtype(float))
    assert [x.ctypes.data % 64 for x in found] == [0, 0, 0]


def test_few_states_and_single_results_have_memory_of_their_own(panda):
    for count in (1, 40):
        assert all(x.flags.owndata for x in panda.inverse_dynamics_derivatives(*states(panda, count)))
    assert panda.mass_matrix(states(panda, 1001)[0]).flags.owndata


def test_shapes_that_broadcast_and_errors_are_numpys(panda):
    q, dq, ddq = states(panda, 1200)
    found = panda.inverse_dynamics_derivatives(q.reshape(3, 400, 7), dq[:400], ddq[0])
    np.testing.assert_array_equal(found[1][2, 5], panda.inverse_dynamics_derivatives(q[805], dq[5], ddq[0])[1])
    with pytest.raises(tw.ShapeError):
        panda.inverse_dynamics_derivatives(q, dq[:5], ddq)
    with pytest.raises(tw.ShapeError):
        panda.inverse_dynamics_derivatives(q.astype(complex), dq, ddq)


# ── huge pages ──


def test_a_large_result_comes_from_the_pool_and_goes_back_with_its_last_view(panda, pool):
    q = states(panda, 4096)[0]
    M = panda.mass_matrix(q)
    np.testing.assert_array_equal(M, panda.kernel("mass_matrix")(q))
    assert len(pool.blocks) == 1
    assert not pool.idle
    place, row = address(M), M[7:9, 1]
    expected = row.copy()
    del M
    assert not pool.idle
    other = panda.mass_matrix(-q)  # while a view lives, elsewhere
    assert address(other) != place
    np.testing.assert_array_equal(row, expected)
    del row
    assert [block.address for block in pool.idle] == [place]
    again = panda.mass_matrix(q)
    assert address(again) == place
    assert len(pool.blocks) == 2
    np.testing.assert_array_equal(again[7:9, 1], expected)


def test_each_of_several_large_results_is_by_itself(panda, pool):
    found = panda.inverse_dynamics_derivatives(*states(panda, 4096))
    assert len(pool.blocks) == 2
    kept = found[1]
    del found
    assert len(pool.idle) == 1
    assert address(kept) not in [block.address for block in pool.idle]


def test_all_blocks_together_are_bounded_and_kept_results_do_not_wait_for_room(pool):
    shape, dtype = (3 << 18,), np.dtype(float)  # 6 MB: three huge pages
    kept = [result_pool.result_arrays([shape], dtype)[0] for _ in range(12)]
    assert len(pool.blocks) == 8
    assert sum(x.flags.owndata for x in kept) == 4
    del kept
    assert len(pool.idle) == 8
    assert result_pool.result_arrays([(1 << 30,)], np.dtype(np.uint8))[0].flags.owndata  # more than all of it


def test_idle_blocks_make_room_but_not_those_in_use(pool):
    small, large = 10 * result_pool.PAGE, 20 * result_pool.PAGE
    held = pool.acquire(small)
    assert held is not None
    assert pool.acquire(large) is None
    assert [block.size for block in pool.blocks] == [small]
    del held
    assert pool.acquire(large) is not None
    assert [block.size for block in pool.blocks] == [large]


def test_a_block_serves_results_of_its_size_and_none_much_smaller(pool):
    assert pool.acquire(9 * result_pool.PAGE) is not None  # of ten pages
    assert pool.acquire(2 * result_pool.PAGE - 5) is not None
    assert [block.size // result_pool.PAGE for block in pool.blocks] == [10, 2]
    assert pool.acquire(10 * result_pool.PAGE) is not None
    assert len(pool.blocks) == 2
    assert pool.acquire(7 * result_pool.PAGE) is not None
    assert len(pool.blocks) == 3


@pytest.mark.parametrize("refuses", ["mmap", "madvise"])
def test_a_system_that_refuses_leaves_it_to_numpy(panda, pool, monkeypatch, refuses):
    class Refused(mmap.mmap):
        def __new__(cls, *given, **options):
            if refuses == "mmap":
                raise OSError(12, "Cannot allocate memory")
            return super().__new__(cls, *given, **options)

        def madvise(self, *given):
            raise OSError(22, "Invalid argument")

    monkeypatch.setattr(result_pool.mmap, "mmap", Refused)
    q = states(panda, 4096)[0]
    M = panda.mass_matrix(q)
    assert not pool.blocks
    np.testing.assert_array_equal(M, panda.kernel("mass_matrix")(q))


def test_results_that_outlive_each_other_in_threads_keep_their_numbers(panda, pool):
    q = states(panda, 3000)[0]
    expected, gate, wrong = panda.kernel("mass_matrix")(q), threading.Barrier(4), []

    def work(sign):
        gate.wait(WAIT)
        before = None
        for _ in range(30):
            M = panda.mass_matrix(q)
            if not np.array_equal(M, expected) or (before is not None and not np.array_equal(before, expected)):
                wrong.append(sign)
            before = M

    crowd = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in crowd:
        thread.start()
    for thread in crowd:
        thread.join(WAIT)
    assert not wrong
    gc.collect()
    assert len(pool.idle) == len(pool.blocks) <= 8


def test_a_ring_of_garbage_gives_its_block_back(pool):
    ring: list = [result_pool.result_arrays([(1 << 20,)], np.dtype(float))[0]]
    ring.append(ring)
    assert not pool.idle
    del ring
    gc.collect()
    assert len(pool.idle) == 1


FORKED = """
import os
import numpy as np
from twistwrench.compiler.runtime import result_pool

pool, shape, dtype = result_pool._POOL, (1 << 23,), np.dtype(float)
def room():
    return result_pool.result_arrays([shape], dtype)[0]
lent, idle = room(), room()
lent[:] = 1.0
place = idle.__array_interface__["data"][0]
del idle
assert len(pool.idle) == 1
child = os.fork()
if child == 0:
    fine = not pool.idle and not pool.blocks and (lent == 1.0).all()
    lent[:] = 3.0
    mine = room()
    mine[:] = 2.0
    del lent  # the parent's: it does not come into this pool
    fine = fine and not pool.idle
    del mine
    os._exit(0 if fine and len(pool.idle) == 1 else 7)
status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
again = room()
print(status, (lent == 1.0).all(), again.__array_interface__["data"][0] == place, len(pool.blocks))
"""


def python(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, capture_output=True, text=True, timeout=WAIT
    )


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_child_neither_gives_back_nor_takes_what_its_parent_lent(pool):
    done = python(FORKED)
    assert done.stdout == "0 True True 2\n", done.stderr


@pytest.mark.parametrize("text", ["0", "off", " OFF "])
def test_the_switch(text):
    code = (
        "import numpy as np, twistwrench as tw\n"
        "robot = tw.robots.panda(); q = robot.random_configuration(0, 100_000)\n"
        "print(robot.mass_matrix(q).flags.owndata)"
    )
    assert python(code, TWISTWRENCH_HUGE_PAGES=text).stdout == "True\n"


def test_a_switch_that_is_neither(monkeypatch):
    result_pool.may_use_huge_pages.cache_clear()
    monkeypatch.setenv("TWISTWRENCH_HUGE_PAGES", "maybe")
    with pytest.raises(tw.ValueRangeError, match="TWISTWRENCH_HUGE_PAGES: 'maybe' is not understood"):
        result_pool.result_arrays([(1 << 22,), (1 << 20,)], np.dtype(float))
    monkeypatch.undo()
    result_pool.may_use_huge_pages.cache_clear()


# ── past the caches ──


@pytest.mark.parametrize("cpu", mostly_slow(target_machine.choices(), 3))
@pytest.mark.parametrize("name", ["mass_matrix", "inverse_dynamics_derivatives"])
def test_results_go_past_the_caches_with_the_same_bits(panda, monkeypatch, cpu, name):
    monkeypatch.setenv("TWISTWRENCH_CPU", cpu)
    program = panda.program(name)
    arrays = states(panda, 203)[: len(program.inputs)]
    plain = make_ufunc(program, "plain", "")
    monkeypatch.setattr(batch_loop, "BEYOND_CACHES", 0)
    streamed = make_ufunc(program, "streamed", "")
    for dtype in (np.float64, np.float32):
        given = [x.astype(dtype) for x in arrays]
        shapes = [(203, *port.shape) for port in program.outputs]
        out = result_pool.result_arrays(shapes, np.dtype(dtype))
        streamed(*given, out=out)
        expected = plain(*given)
        for one, other in zip(out, expected if isinstance(expected, tuple) else (expected,), strict=True):
            np.testing.assert_array_equal(one, other)
        odd = tuple(np.zeros(203 * port.size + 1, dtype)[1:].reshape(203, *port.shape) for port in program.outputs)
        streamed(*given, out=odd)
        for one, other in zip(odd, out, strict=True):
            np.testing.assert_array_equal(one, other)
