"""The AVX2 code against LLVM's of the same program: same bits, whatever the program, its arrays, its parts, its place in a batch."""

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.kernels.ufunc import make_ufunc
from twistwrench.program.trace import trace
from twistwrench.targets import avx2_module, avx2_text, batch_loop, emitter_choice, processor

AVX2 = "x86-64-v3"
pytestmark = pytest.mark.skipif(
    AVX2 not in processor.choices() or "windows" in processor.host().triple, reason="needs an x86-64 with AVX2"
)


@pytest.fixture(autouse=True)
def everywhere(monkeypatch):
    """Short programs too, and on processors that have AVX-512 besides."""
    monkeypatch.setattr(emitter_choice, "_is_long_enough", lambda _: True)
    monkeypatch.setenv(processor.VARIABLE, AVX2)


def both(program, monkeypatch):
    """The kernel of our code, and of LLVM's; float32 loops are made at the first call."""
    assert avx2_module.serves(program, processor.chosen())
    zeros = [np.zeros(p.shape, np.float32) for p in program.inputs]
    with np.errstate(all="ignore"), monkeypatch.context() as patch:
        ours = make_ufunc(program, "ours", "")
        ours(*zeros)
        patch.setattr(avx2_module, "serves", lambda *_: False)
        theirs = make_ufunc(program, "theirs", "")
        theirs(*zeros)
    return ours, theirs


def assert_same_bits(ours, theirs, arrays):
    for kind in (np.float64, np.float32):
        with np.errstate(all="ignore"):
            given = [a.astype(kind) for a in arrays]
            a, b = ours(*given), theirs(*given)
        for x, y in zip(*(r if isinstance(r, tuple) else (r,) for r in (a, b)), strict=True):
            assert x.dtype == kind
            np.testing.assert_array_equal(x, y)


STEPS = (
    lambda a, b, c, k: a + b, lambda a, b, c, k: a - b, lambda a, b, c, k: a * b, lambda a, b, c, k: a * b + c,
    lambda a, b, c, k: c - a * a, lambda a, b, c, k: a * b - c, lambda a, b, c, k: -a * b - c, lambda a, b, c, k: k * a + 0.3,
)  # fmt: skip


def random_program(rng, inputs, outputs, length):
    """A program of random operations: values die early or live long, are used twice by one instruction, or are results twice."""

    def run(*arrays):
        plain = [x for a in arrays[1:] for x in a.flat]
        values = [*plain, *np.sin(arrays[0]), *np.cos(arrays[0])]
        for _ in range(length):
            near = values[-12:] if rng.random() < 0.7 else values
            a, b, c = (
                near[rng.integers(len(near))] if rng.random() < 0.8 else values[rng.integers(len(values))]
                for _ in "abc"
            )
            values.append(STEPS[rng.integers(len(STEPS))](a, b, c, float(rng.normal())))
            if rng.random() < 0.02:
                values.append(np.sqrt(values[-1] * values[-1] + 1.0))
                values.append(a / (values[-1] + 2.0))
                values.append(values[-3].clip(a, b))
                values.append(np.sin(a.clip(-3.0, 16384.0)) * np.cos(a.clip(-3.0, 16384.0)))
        pick = values[len(plain) :]  # a result that is a bare input would be an angle used otherwise
        results = []
        for shape in outputs:
            made = np.empty(shape, object)
            for k in range(made.size):
                made.flat[k] = 0.0 if rng.random() < 0.2 else pick[rng.integers(len(pick) // 2, len(pick))]
            results.append(made)
        return tuple(results)

    return trace(run, [(f"x{k}", shape) for k, shape in enumerate(inputs)], [f"y{k}" for k in range(len(outputs))])


SHAPES = [
    ([(1,), (1,)], [(1,)]),
    ([(2,), (3,)], [(2,), (3,)]),
    ([(7,), (7,), (7,)], [(7,)]),
    ([(5,), (9,)], [(5, 5), (1,)]),
    ([(4,)] + [(2,)] * 9, [(3,)] * 4),
    ([(6,), (6,)], [(11, 13)]),
    ([(6,), (6,)], [(12, 12), (3,)]),
]


@pytest.mark.parametrize("shapes", SHAPES, ids=str)
@pytest.mark.parametrize("part", [40, 1500])
def test_random_programs_have_the_bits_of_llvm(shapes, part, monkeypatch):
    monkeypatch.setattr(avx2_text, "PART", part)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        program = random_program(rng, *shapes, length=150)
        ours, theirs = both(program, monkeypatch)
        for samples in (1, 5, 8, 100):
            assert_same_bits(ours, theirs, [rng.normal(size=(samples, *shape)) for shape in shapes[0]])


def test_angles_that_are_computed_are_served_where_they_are_clipped_to_what_needs_no_look():
    def program(*limits):
        return trace(lambda x, y: np.sin((x * y).clip(*limits)) + y, [("x", ()), ("y", ())], ["z"])

    assert avx2_module.serves(program(-1.0, 2.0**14), processor.chosen())
    assert not avx2_module.serves(program(-1.0, 2.0**15), processor.chosen())
    assert not avx2_module.serves(program(-np.inf, 1.0), processor.chosen())
    assert not avx2_module.serves(trace(lambda x, y: np.sin(x * y), [("x", ()), ("y", ())], ["z"]), processor.chosen())


def test_huge_angles_and_angles_that_are_none_are_one_sample_s_affair(monkeypatch):
    robot = tw.robots.panda()
    rng = np.random.default_rng(0)
    monkeypatch.setattr(avx2_text, "PART", 100)  # several parts, so that blocks go in groups
    ours, theirs = both(robot.program("inverse_dynamics"), monkeypatch)
    for value in (1e9, 1.1e9, -3e40, 1e308, np.inf, np.nan):
        q, dq, ddq = (rng.normal(size=(101, 7)) for _ in range(3))
        usual = ours(q, dq, ddq)
        for row, column in ((0, 0), (3, 1), (38, 6), (100, 3)):
            q[row, column] = value
        assert_same_bits(ours, theirs, (q, dq, ddq))
        with np.errstate(all="ignore"):
            found = ours(q, dq, ddq)
        untouched = np.setdiff1d(np.arange(101), [0, 3, 38, 100])
        np.testing.assert_array_equal(found[untouched], usual[untouched])


def test_angles_around_the_limit_have_the_same_bits_whoever_is_beside_them(monkeypatch):
    """The check for huge angles looks at half their bits: just beyond the limit it must not let any pass."""
    program = trace(lambda q: (np.sin(q), np.cos(q)), [("q", (4,))], ["s", "c"])
    ours, theirs = both(program, monkeypatch)
    rng = np.random.default_rng(3)
    for limit in (2.0**15, 2.0**30):
        q = rng.uniform(limit * (1 - 2.0**-20), limit * (1 + 2.0**-20), size=(800, 4))
        q[:4, 0] = np.nextafter(limit, 0), limit, -limit, np.nextafter(limit, np.inf)
        assert_same_bits(ours, theirs, [q])
        beside_huge = q.copy()
        beside_huge[::4, 1] = 1e15
        others = np.arange(800) % 4 > 0
        for x, y in zip(ours(q), ours(beside_huge), strict=True):
            np.testing.assert_array_equal(x[others], y[others])


def test_results_written_past_the_caches_are_the_same(monkeypatch):
    robot = tw.robots.panda()
    rng = np.random.default_rng(1)
    program = robot.program("inverse_dynamics_derivatives", "mass_matrix", "coriolis_matrix")
    q, dq, ddq = (rng.normal(size=(203, 7)) for _ in range(3))
    plain = make_ufunc(program, "plain", "")(q, dq, ddq)
    wide = robot.program("regressor")  # 7 × 70 entries: rows that begin at multiples of 16 bytes
    usual = make_ufunc(wide, "usual", "")(q, dq, ddq)
    monkeypatch.setattr(batch_loop, "BEYOND_CACHES", 0)
    for x, y in zip(make_ufunc(program, "streamed", "")(q, dq, ddq), plain, strict=True):
        np.testing.assert_array_equal(x, y)
    kernel = make_ufunc(wide, "streamed", "")
    np.testing.assert_array_equal(kernel(q, dq, ddq), usual)
    room = np.zeros(203 * 490 + 3)
    for shift in range(3):  # arrays that begin anywhere
        out = room[shift : shift + 203 * 490].reshape(203, 7, 70)
        np.testing.assert_array_equal(kernel(q, dq, ddq, out=out), usual)
    strided = np.zeros((203, 7, 140))[..., ::2]
    np.testing.assert_array_equal(kernel(q, dq, ddq, out=strided), usual)


def test_stores_past_the_caches_are_whole_vectors():
    text = avx2_module.module(tw.robots.panda().program("regressor"), processor.DOUBLE, processor.chosen(), "loop")
    past = [line for line in text.splitlines() if "!nontemporal" in line]
    assert past
    assert all("store <4 x double>" in line for line in past)


def test_programs_with_computed_angles_go_to_llvm():
    def doubled(q):
        return (np.sin(2.0 * q),)

    def both_ways(q):
        return (np.sin(q) + q,)

    for function in (doubled, both_ways):
        program = trace(function, [("q", (3,))], ["s"])
        assert not avx2_module.serves(program, processor.chosen())
        kernel = make_ufunc(program, "k", "")
        q = np.linspace(-2, 2, 9).reshape(3, 3)
        np.testing.assert_allclose(kernel(q), function(q)[0], rtol=4e-16)


def test_no_other_machine_is_served():
    program = tw.robots.panda().program("mass_matrix")
    host = processor.host()
    for other in (
        processor.Machine("x86_64-pc-windows-msvc", host.cpu, host.features, 256),
        processor.Machine("aarch64-unknown-linux-gnu", "generic", "", 128),
        processor.Machine(host.triple, "x86-64", "", 128, False),
        processor.Machine(host.triple, host.cpu, host.features, 512),
        processor.Machine(host.triple, host.cpu, host.features.replace("+avx2", "-avx2"), 256),
    ):
        assert not avx2_module.serves(program, other)


def test_a_frame_too_large_for_a_stack_is_taken_elsewhere(monkeypatch):
    """Threads of a quarter of a megabyte of stack compute what others do."""
    import threading

    program = tw.robots.panda().program("forward_dynamics_derivatives", "regressor", "coriolis_matrix")
    kernel = make_ufunc(program, "wide", "")
    rng = np.random.default_rng(2)
    q, dq, u, a = (rng.normal(size=(64, 7)) for _ in range(4))
    given = [{"q": q, "dq": dq, "tau": u, "ddq": a}[p.name] for p in program.inputs]
    usual, found = kernel(*given), []
    before = threading.stack_size(256 * 1024)
    try:
        thread = threading.Thread(target=lambda: found.append(kernel(*given)))
        thread.start()
        thread.join()
    finally:
        threading.stack_size(before)
    for x, y in zip(found[0], usual, strict=True):
        np.testing.assert_array_equal(x, y)


def test_the_code_has_no_other_operation_than_the_program():
    """Products of the text are those of the program and of its sines: none is lost, none doubled."""
    program = tw.robots.panda().program("inverse_dynamics")
    text = avx2_module.module(program, processor.DOUBLE, processor.chosen(), "loop")
    body = [line for line in text.splitlines() if line.startswith("module asm")]
    products = sum(line.split('"')[1].startswith(("vmul", "vfm", "vfnm")) for line in body)
    counts = program.counts()
    assert products == program.multiplications + 19 * counts["sin"]
    assert counts["sin"] == counts["cos"]
