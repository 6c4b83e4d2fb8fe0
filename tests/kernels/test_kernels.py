"""Compiled kernels as NumPy sees them: the same bits wherever a sample lies, every kind of array, every kind of mistake."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.ir.program import Program
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.lower import CUT_OUTPUTS, MAX_UNCUT_OUTPUTS
from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, host
from twistwrench.compiler.runtime import jit
from twistwrench.compiler.runtime.gufunc import make_ufunc
from twistwrench.core.errors import KernelError

# Rows of 7, 2 and 13 (no, one and several whole vectors), results of rank 0, 1 and 2, angles by the sincos path and none.
KERNELS = [
    ("panda", "inverse_dynamics"),
    ("panda", "mass_matrix"),
    ("planar_2r", "forward_dynamics"),
    ("cart_pole", "kinetic_energy"),
    ("floating_box", "gravity_forces"),
    ("floating_box", "frame_velocity"),
]
DTYPES = [np.float64, np.float32]
COUNT = 2 * max(host().lanes(p) for p in (DOUBLE, SINGLE)) + 1

kernels = pytest.mark.parametrize(("name", "quantity"), KERNELS)
dtypes = pytest.mark.parametrize("dtype", DTYPES, ids=lambda d: d.__name__)


@functools.cache
def inputs_for(robot: tw.Robot, quantity: str, dtype: type, count: int = COUNT) -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    ports = robot.program(quantity).inputs
    return [
        (robot.random_configuration(rng, count) if p.name == "q" else rng.normal(size=(count, *p.shape))).astype(dtype)
        for p in ports
    ]


def same_bits(a, b) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def case(bundled, name, quantity, dtype, count=COUNT):
    robot = bundled(name)
    arrays = inputs_for(robot, quantity, dtype, count)
    kernel = robot.kernel(quantity)
    return kernel, arrays, kernel(*arrays)


# ── bits do not depend on the batch ──


@kernels
@dtypes
def test_a_sample_alone_has_the_bits_it_has_in_a_batch(bundled, name, quantity, dtype):
    kernel, arrays, whole = case(bundled, name, quantity, dtype)
    for k in range(COUNT):
        alone = kernel(*(a[k] for a in arrays))
        assert same_bits(alone, whole[k])
        assert same_bits(kernel(*(a[k : k + 1] for a in arrays)), whole[k : k + 1])


@kernels
@dtypes
def test_bits_are_the_same_in_every_batch_size_and_place(bundled, name, quantity, dtype):
    kernel, arrays, whole = case(bundled, name, quantity, dtype)
    for start, size in itertools.product((0, 1, 3), range(COUNT - 3)):
        part = slice(start, start + size)
        assert same_bits(kernel(*(a[part] for a in arrays)), whole[part])


@dtypes
@kernels
def test_bits_do_not_depend_on_the_level_of_optimisation(bundled, monkeypatch, name, quantity, dtype):
    _, arrays, results = case(bundled, name, quantity, dtype)
    monkeypatch.setattr(jit, "CODE_GENERATION_LEVEL", 0)
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "off")
    plainly_generated = getattr(tw.robots, name)().kernel(quantity)
    assert same_bits(plainly_generated(*arrays), results)


@kernels
@dtypes
def test_permuted_samples_give_permuted_bits(bundled, name, quantity, dtype):
    kernel, arrays, whole = case(bundled, name, quantity, dtype)
    order = np.random.default_rng(8).permutation(COUNT)
    assert same_bits(kernel(*(a[order] for a in arrays)), whole[order])
    doubled = kernel(*(np.concatenate([a, a]).reshape(2, COUNT, -1) for a in arrays))
    assert same_bits(doubled, np.stack([whole, whole]))


# ── layouts: each gives an array equal to ``a`` that lies differently in memory ──


def misaligned(a):
    raw = bytearray(a.nbytes + 1)
    raw[1:] = a.tobytes()
    return np.frombuffer(raw, a.dtype, offset=1).reshape(a.shape)


def inside(a, before, after, step=1):
    """``a`` as a part of a larger array, surrounded by NaN."""
    wide = np.full((*a.shape[:-1], before + a.shape[-1] * step + after), np.nan, a.dtype)
    part = wide[..., before : before + a.shape[-1] * step : step]
    part[...] = a
    return part


def read_only(a):
    a = a.copy()
    a.flags.writeable = False
    return a


def record_field(a):
    records = np.zeros(len(a), [("tag", "i1"), ("row", a.dtype, a.shape[1:])])
    records["row"] = a
    return records["row"]


LAYOUTS = {
    "reversed samples": lambda a: a[::-1].copy()[::-1],
    "reversed entries": lambda a: a[:, ::-1].copy()[:, ::-1],
    "every third sample": lambda a: np.repeat(a, 3, axis=0)[::3],
    "every second entry": lambda a: inside(a, 0, 0, 2),
    "Fortran order": np.asfortranarray,
    "part of wider rows": lambda a: inside(a, 1, 2),
    "read-only": read_only,
    "misaligned": misaligned,
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder()),
    "a field of packed records": record_field,
}


@kernels
@dtypes
@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_changes_no_bit(bundled, name, quantity, dtype, layout):
    kernel, arrays, whole = case(bundled, name, quantity, dtype)
    moved = [LAYOUTS[layout](a) for a in arrays]
    assert all(np.array_equal(m, a) for m, a in zip(moved, arrays, strict=True))
    assert same_bits(kernel(*moved), whole)
    assert same_bits(kernel(moved[0], *arrays[1:]), whole)


@kernels
@dtypes
def test_broadcast_inputs(bundled, name, quantity, dtype):
    kernel, arrays, _ = case(bundled, name, quantity, dtype)
    first, rest = arrays[0], [a[0] for a in arrays[1:]]
    spelled_out = kernel(first, *(np.tile(r, (COUNT, 1)) for r in rest))
    assert same_bits(kernel(first, *rest), spelled_out)  # stride 0 between samples
    still = np.broadcast_to(arrays[0][0, :1], arrays[0].shape)  # stride 0 within one, too
    assert same_bits(kernel(still, *rest), kernel(still.copy(), *rest))
    if rest:
        crossed = kernel(first[:, None], *(a[:4] for a in arrays[1:]))
        assert same_bits(crossed[2, 3], kernel(first[2], *(a[3] for a in arrays[1:])))


@kernels
@dtypes
def test_out(bundled, name, quantity, dtype):
    kernel, arrays, whole = case(bundled, name, quantity, dtype)
    out = np.full_like(whole, np.nan)
    assert kernel(*arrays, out=out) is out
    assert same_bits(out, whole)
    room = np.full((3 * COUNT, *whole.shape[1:]), np.nan, dtype)
    kernel(*arrays, out=room[1::3])
    assert same_bits(room[1::3], whole)
    assert np.isnan(room[0::3]).all()
    assert np.isnan(room[2::3]).all()
    backwards = np.empty_like(whole)
    kernel(*arrays, out=backwards[::-1])
    assert same_bits(backwards[::-1], whole)


@dtypes
@pytest.mark.parametrize("shift", [0, 1, 4, 9], ids="by {}".format)
def test_out_may_overlap_an_input(bundled, dtype, shift):
    kernel, arrays, whole = case(bundled, "panda", "inverse_dynamics", dtype)
    for forward in (True, False):
        room = np.zeros((COUNT + shift, 7), dtype)
        mine, theirs = (room[shift:], room[:COUNT]) if forward else (room[:COUNT], room[shift:])
        mine[...] = arrays[0]
        kernel(mine, *arrays[1:], out=theirs)
        assert same_bits(theirs, whole)
    with pytest.raises(ValueError, match="read-only"):
        kernel(*arrays, out=read_only(whole))


# ── wide results ──

SHAPE = (18, 130)


@functools.cache
def wide() -> Program:
    """A matrix as wide as a quadruped's regressor, and a row that ends with it; of small integers, so that nothing rounds.

    Half of the matrix is 0 and so there from the start, some entries are inputs, constants or the same value again; what
    is computed is scattered, so that hardly a tile of the matrix is complete before the end.
    """
    rng = np.random.default_rng(12)
    kinds = rng.choice(5, size=SHAPE, p=[0.5, 0.1, 0.05, 0.3, 0.05])
    picks = rng.integers(7, size=(*SHAPE, 3))
    order = rng.permutation(kinds.size)

    def results(x):
        W = np.empty(SHAPE, object)
        made = [x[0] + x[1]]
        for i, j in zip(*np.unravel_index(order, SHAPE), strict=True):
            a, b, c = x[picks[i, j]]
            if kinds[i, j] == 3:
                made.append(a * b - float(i) * c + float(j))
            W[i, j] = (0.0, a, float(i - j), made[-1], made[len(made) // 2])[kinds[i, j]]
        return W, np.array([W[-1, -1], W[0, 0], made[-1], x[3], 1.0], object)

    program = trace(results, [("x", (7,))], ["W", "y"])
    assert len(program.results) > max(MAX_UNCUT_OUTPUTS, 10 * CUT_OUTPUTS)
    return program


@dtypes
def test_every_entry_of_a_wide_result_is_in_its_place(dtype):
    kernel, oracle = make_ufunc(wide(), "wide", ""), NumpyKernel(wide(), "wide", "")
    rng = np.random.default_rng(13)
    for batch in [(), (1,), (3,), (COUNT,), (64,), (2, 0, 5), (3, 5)]:
        x = rng.integers(-9, 10, size=(*batch, 7)).astype(dtype)
        for got, expected in zip(kernel(x), oracle(x), strict=True):
            assert got.dtype == expected.dtype == dtype
            assert np.array_equal(got, expected)
    spread = np.full((COUNT, 7 * 2), np.nan, dtype)
    spread[:, ::2] = rng.integers(-9, 10, size=(COUNT, 7))
    W = np.full((*SHAPE[::-1], COUNT), np.nan, dtype)
    kernel(spread[:, ::2], out=(W.T, np.empty((COUNT, 5), dtype)))
    assert np.array_equal(W.T, oracle(spread[:, ::2])[0])


@dtypes
def test_a_wide_kernel_gives_a_sample_the_same_bits_everywhere(bundled, dtype):
    kernel, arrays, whole = case(bundled, "quadruped", "regressor", dtype)
    assert whole.shape[1:] == SHAPE
    for k in range(COUNT):
        assert same_bits(kernel(*(a[k] for a in arrays)), whole[k])
    for start, size in itertools.product((0, 1, 3), range(COUNT - 3)):
        part = slice(start, start + size)
        assert same_bits(kernel(*(a[part] for a in arrays)), whole[part])


# ── element types and shapes ──


def test_a_kernel_may_have_as_many_arrays_as_numpy_allows():
    """31 to read and one to write are 32, and one more is too many."""

    def total(count):
        names = [f"x{k}" for k in range(count)]
        return trace(lambda *x: (sum(x),), [(name, (2,)) for name in names], ["sum"])

    found = make_ufunc(total(31), "total", "")(*np.arange(62.0).reshape(31, 2))
    np.testing.assert_array_equal(found, np.arange(62.0).reshape(31, 2).sum(axis=0))
    with pytest.raises(KernelError, match="33 arrays; NumPy allows 32"):
        make_ufunc(total(32), "total", "")


@kernels
@pytest.mark.parametrize("batch", [(0,), (2, 0, 5), (0, 0)], ids=str)
def test_empty_batches(bundled, name, quantity, batch):
    kernel, arrays, whole = case(bundled, name, quantity, np.float64)
    assert kernel(*(np.empty((*batch, *a.shape[1:])) for a in arrays)).shape == (*batch, *whole.shape[1:])


def test_element_types(bundled):
    kernel = bundled("planar_2r").kernel("forward_dynamics")
    q, dq, tau = np.array([[1, -2], [0, 3]]), np.array([1, 1]), np.array([0, 2])
    plain = kernel(q.astype(float), dq.astype(float), tau.astype(float))
    assert same_bits(kernel(q, dq, tau), plain)
    assert same_bits(kernel(q.tolist(), dq.tolist(), [0.0, 2.0]), plain)
    single = [a.astype(np.float32) for a in (q, dq, tau)]
    assert kernel(*single).dtype == np.float32
    for k in range(3):  # one double is enough
        mixed = [a.astype(float) if i == k else a for i, a in enumerate(single)]
        assert same_bits(kernel(*mixed), plain)
    assert kernel(*single, dtype=np.float64).tobytes() == plain.tobytes()
    with pytest.raises(TypeError):
        kernel(q.astype(complex), dq, tau)


# ── NaN, infinity and floating-point flags ──


def test_constants_that_float32_does_not_hold_are_infinite_or_zero_there():
    """As NumPy rounds them; Python's struct refuses to."""
    kernel = make_ufunc(trace(lambda x: x * 1e300 - 1e-300, [("x", (2,))], ["y"]), "large", "")
    with np.errstate(over="ignore"):
        assert kernel(np.array([2.0, -1.0], np.float32)).tolist() == [np.inf, -np.inf]
    assert np.isfinite(kernel([2.0, -1.0])).all()


@kernels
@dtypes
def test_nan_stays_in_its_sample(bundled, name, quantity, dtype):
    kernel, arrays, whole = case(bundled, name, quantity, dtype)
    for k, bad in itertools.product(range(COUNT), (np.nan, np.inf)):
        spoilt = [a.copy() for a in arrays]
        for a in spoilt:
            a[k] = bad
        with np.errstate(invalid="ignore"):
            got = kernel(*spoilt)
        others = np.arange(COUNT) != k
        assert same_bits(got[others], whole[others])
        assert not np.isfinite(got[k]).all() or (got[k] == whole[k]).all()  # constants stay what they are


@kernels
@dtypes
def test_ordinary_data_raise_no_flags(bundled, name, quantity, dtype):
    kernel, arrays, _ = case(bundled, name, quantity, dtype)
    with np.errstate(all="raise"):
        for count in range(1, COUNT + 1):  # whatever the tail is filled up with
            kernel(*(a[:count] for a in arrays))
            kernel(*(a[:count][::-1] for a in arrays))


@kernels
@dtypes
def test_a_quiet_nan_raises_no_flags_either(bundled, name, quantity, dtype):
    kernel, arrays, _ = case(bundled, name, quantity, dtype)
    with np.errstate(all="raise"):  # as np.sin(np.nan) raises none
        kernel(*(np.full_like(a, np.nan) for a in arrays))
