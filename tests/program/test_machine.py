"""Other processors than this one: the same bits at every width, products and sums apart where nothing fuses, TWISTWRENCH_CPU.

Wider vectors than the processor has are split by LLVM, and a processor without fused products is this one told not to use
its own. So both run here; what AVX-512 and NEON would run is read as assembly.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import re
import subprocess
import sys
import types

import llvmlite.binding as llvm
import mpmath
import numpy as np
import pytest
from quick import mostly_slow
from random_trees import tree

import twistwrench as tw
from twistwrench.compiler.ir.program import Program
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering import numpy_kernels, target_machine
from twistwrench.compiler.lowering.lower import assembly
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, X86_LEVELS, Machine, choices, chosen, host
from twistwrench.compiler.runtime import gufunc
from twistwrench.compiler.runtime.gufunc import make_ufunc
from twistwrench.compiler.runtime.jit import compile_form
from twistwrench.testing import random_state

WIDTHS = (64, 128, 256, 512)
COUNT = 37
"""Samples: whole blocks and a rest, at every width."""
PRECISIONS = [DOUBLE, SINGLE]
FUNCTIONS = trace(lambda x: (np.sin(x), np.cos(x), np.exp(x)), [("x", ())], ["sin", "cos", "exp"])

ROBOTS = {
    "panda": tw.robots.panda,
    "cart_pole": tw.robots.cart_pole,
    "quadruped": tw.robots.quadruped,
    "tree0": lambda: tree("tree0"),
    "tree1": lambda: tree("tree1"),
    "helical": lambda: tree("helical"),
    "driven1": lambda: tree("driven1"),
}
CASES = [
    ("cart_pole", "kinetic_energy"),
    ("panda", "inverse_dynamics"),
    ("panda", "mass_matrix"),
    ("tree0", "inverse_dynamics"),
    ("quadruped", "gravity_forces"),
    ("tree1", "forward_dynamics"),
    ("helical", "jacobian_rate"),
    ("driven1", "friction_forces"),
]
precisions = pytest.mark.parametrize("precision", PRECISIONS, ids=lambda p: p.llvm)
fusing = pytest.mark.parametrize("fused", [True, False], ids=["fused", "not fused"])
on_x86 = pytest.mark.skipif(not host().triple.startswith("x86_64"), reason="levels of x86-64")


@functools.cache
def robot_named(name: str) -> tw.Robot:
    return ROBOTS[name]()


def options_of(robot: tw.Robot, quantity: str) -> dict:
    return {"frame": robot.frame_names[-1]} if quantity in ("jacobian_rate",) else {}


def case(name: str, quantity: str, dtype: str) -> tuple[Program, list[np.ndarray]]:
    robot, rng = robot_named(name), np.random.default_rng(21)
    program = robot.program(quantity, **options_of(robot, quantity))
    states = [random_state(robot, rng) for _ in range(COUNT)]
    columns = {"q": 0, "dq": 1, "ddq": 2, "tau": 2}
    return program, [np.stack([s[columns[p.name]] for s in states]).astype(dtype) for p in program.inputs]


@pytest.fixture
def made_for(monkeypatch):
    """A function that makes a kernel for another machine: this one with fewer or more lanes, or without fused products."""

    def make(program: Program, **changes):
        monkeypatch.setattr(gufunc, "chosen", lambda: dataclasses.replace(host(), **changes))
        return make_ufunc(program, "kernel", "")

    return make


def bits(results) -> list[bytes]:
    return [np.asarray(a).tobytes() for a in (results if isinstance(results, tuple) else (results,))]


# ── the same bits at every width ──


@pytest.mark.parametrize(("name", "quantity"), mostly_slow(CASES, 3))
@precisions
@fusing
def test_bits_do_not_depend_on_the_width(made_for, name, quantity, precision, fused):
    if fused and not host().fused:
        pytest.skip("this processor cannot fuse")
    program, arrays = case(name, quantity, precision.char)
    with np.errstate(
        all="ignore"
    ):  # LLVM makes four lanes of two floats, and divides in all; no machine here is so narrow
        found = [bits(made_for(program, vector_bits=WIDTHS[0], fused=fused)(*arrays))]
    with np.errstate(all="raise"):
        found += [bits(made_for(program, vector_bits=width, fused=fused)(*arrays)) for width in WIDTHS[1:]]
    assert all(f == found[0] for f in found[1:])
    strided = [np.repeat(a, 2, axis=-1)[..., ::2] for a in arrays]
    assert bits(made_for(program, vector_bits=WIDTHS[-1], fused=fused)(*strided)) == found[0]


@precisions
@fusing
def test_functions_do_not_depend_on_the_width_either(made_for, precision, fused):
    if fused and not host().fused:
        pytest.skip("this processor cannot fuse")
    rng = np.random.default_rng(22)
    odd = [0.0, -0.0, np.nan, np.inf, -np.inf, 1e30, -1e9, 1e-42, 709.0, -745.0, 88.0]
    x = np.r_[rng.uniform(-60, 60, 500), rng.normal(size=100) * 1e6, odd, rng.uniform(-1, 1, 26)].astype(precision.char)
    with np.errstate(all="ignore"):
        found = [bits(made_for(FUNCTIONS, vector_bits=width, fused=fused)(x)) for width in WIDTHS]
    assert all(f == found[0] for f in found[1:])


# ── without fused products ──


@pytest.mark.parametrize(("name", "quantity"), CASES)
@precisions
def test_without_fused_products_every_operation_is_numpys(made_for, monkeypatch, name, quantity, precision):
    """NumPy's sums, products, quotients and roots are correctly rounded, one by one; only sin, cos and exp are our own."""
    program, arrays = case(name, quantity, precision.char)
    functions = made_for(FUNCTIONS, vector_bits=128, fused=False)
    for k, op in enumerate(("sin", "cos", "exp")):
        monkeypatch.setitem(numpy_kernels._FUNCTIONS, op, lambda x, k=k: functions(x)[k])
    oracle = numpy_kernels.NumpyKernel(program, name, "")(*arrays)
    found = made_for(program, vector_bits=256, fused=False)(*arrays)
    pairs = zip(*(x if isinstance(x, tuple) else (x,) for x in (found, oracle)), strict=True)
    assert all(np.array_equal(a, b) and a.dtype == b.dtype for a, b in pairs)


# The angle is reduced by exact steps and some that round: one unit of the reduced angle in double, one and a half in single,
# two and three of a result that lies a binade lower. Polynomials without fusing stay under 1.1. These are the bounds of the
# worst case; no angle here comes near them, and the documentation promises what was seen.
WORST = {64: 2.0, 32: 3.5}


@pytest.mark.parametrize("reach", [0.8, 20.0, 1e4, 2.0**15])
@precisions
def test_sine_and_cosine_without_fused_products(made_for, precision, reach):
    kernel = made_for(FUNCTIONS, fused=False)
    x = np.random.default_rng(23).uniform(-reach, reach, 1000)
    multiples = np.arange(-400, 400) * min(1.0, reach / 800) * np.pi / 2
    x = np.r_[x, multiples, x * 1e-20].astype(precision.char)
    assert accuracy(kernel(x)[:2], x, precision) <= WORST[precision.bits]


def test_angles_up_to_the_limit_without_fused_products(made_for):
    kernel, rng = made_for(FUNCTIONS, fused=False), np.random.default_rng(24)
    with mpmath.workdps(60):
        zeros = np.array([float(int(k) * mpmath.pi / 2) for k in rng.integers(1000, int(2**31 / np.pi) - 1, 1000)])
    x = np.r_[rng.uniform(-(2.0**30), 2.0**30, 3000), zeros, np.nextafter(zeros, 0), 2.0**30, -(2.0**30)]
    with np.errstate(over="ignore"):
        assert accuracy(kernel(x)[:2], x, DOUBLE) <= WORST[64]


def accuracy(results, x, precision) -> float:
    """The largest error in units in the last place of the exact result, the tail that the stored π/2 lacks left out."""
    worst = 0.0
    with mpmath.workdps(60):
        tail = {64: 3e-51, 32: 1e-22}[precision.bits] * (np.abs(x.astype(float)) + 1)
        for got, function in zip(results, (mpmath.sin, mpmath.cos), strict=True):
            exact = [function(mpmath.mpf(float(t))) for t in x]
            error = np.array([float(abs(mpmath.mpf(float(g)) - e)) for g, e in zip(got, exact, strict=True)])
            unit = np.spacing(np.abs(np.array([float(e) for e in exact])).astype(x.dtype)).astype(float)
            worst = max(worst, float(np.max((error - tail) / unit)))
    return worst


@precisions
def test_exp_without_fused_products(made_for, precision):
    """To the bounds with fused products, 1 and 1.5, come two roundings of polynomial terms below 0.35 of the result."""
    reach = 700 if precision is DOUBLE else 80
    x = np.random.default_rng(25).uniform(-reach, reach, 3000).astype(precision.char)
    with np.errstate(over="ignore"), mpmath.workdps(50):
        found, exact = made_for(FUNCTIONS, fused=False)(x)[2], [mpmath.exp(mpmath.mpf(float(t))) for t in x]
        error = np.array([float(abs(mpmath.mpf(float(y)) - e)) for y, e in zip(found, exact, strict=True)])
    unit = np.spacing(np.array([float(e) for e in exact]).astype(x.dtype)).astype(float)
    assert np.max(error / unit) <= {64: 1.25, 32: 1.75}[precision.bits]


# ── what other processors would run ──

LINUX = "x86_64-unknown-linux-gnu"
OTHERS = {
    "AVX-512": (Machine(LINUX, "x86-64-v4", "-prefer-256-bit", 512), r"vfn?m(?:add|sub)\w*p[sd]\s.*%zmm"),
    "AVX2": (Machine(LINUX, "x86-64-v3", "", 256), r"vfn?m(?:add|sub)\w*p[sd]\s.*%ymm"),
    "FMA4": (Machine(LINUX, "bdver1", "", 256), r"vfn?m(?:add|sub)\w*p[sd]\s.*%ymm"),
    "NEON": (Machine("aarch64-unknown-linux-gnu", "generic", "", 128), r"fml[as]\s+v\d+\.(?:2d|4s)"),
    "NEON of Apple": (Machine("arm64-apple-darwin", "apple-m1", "", 128), r"fml[as]\.(?:2d|4s)\s+v"),
}
APART = {
    "AVX": Machine(LINUX, "sandybridge", "", 256, fused=False),
    "SSE4": Machine(LINUX, "x86-64-v2", "", 128, fused=False),
    "SSE2": Machine(LINUX, "x86-64", "", 128, fused=False),
}


def emitted(text: str, other: Machine) -> str:
    """The assembly of another machine, where this build of LLVM knows it."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    try:
        target = llvm.Target.from_triple(other.triple)
    except RuntimeError:
        pytest.skip(f"llvmlite was built without {other.triple}")
    made = target.create_target_machine(
        cpu=other.cpu, features=other.features, opt=2, reloc="pic", codemodel="small"
    )  # as for this one
    return made.emit_assembly(llvm.parse_assembly(text))


@pytest.mark.parametrize("name", OTHERS)
@precisions
def test_one_fused_product_is_one_instruction_as_wide_as_the_processor(name, precision):
    other, instruction = OTHERS[name]
    text = assembly(robot_named("panda").program("inverse_dynamics"), precision, other)
    wanted = len(re.findall(r"call <\d+ x \w+> @llvm\.fma", text))
    assert wanted > 200
    code = emitted(text, other)
    assert len(re.findall(instruction, code)) == wanted
    assert len(re.findall(r"\b(?:vfn?m(?:add|sub)|fn?m(?:add|sub|l[as]))", code)) == wanted  # and none of another width
    assert calls(code) <= {"sin", "cos", "atan2", "block", "loop", "gather", "scatter"}


@pytest.mark.parametrize("name", APART)
@precisions
def test_a_processor_that_cannot_fuse_multiplies_and_adds(name, precision):
    text = assembly(robot_named("panda").program("inverse_dynamics"), precision, APART[name])
    assert "@llvm.fma.v" not in text.partition("define")[2]
    code = emitted(text, APART[name])
    register = "ymm" if name == "AVX" else "xmm"
    letter = "s" if precision is SINGLE else "d"
    assert len(re.findall(rf"v?mulp{letter}\s.*%{register}", code)) > 300
    assert not re.search(r"v?(?:mul|add|sub)s[sd]\s", code)  # nothing lane by lane
    assert not re.search(r"vfn?m(?:add|sub)", code)
    assert calls(code) <= {"sin", "cos", "atan2", "block", "loop", "gather", "scatter"}  # no fma of the C library


def calls(code: str) -> set[str]:
    """Functions that are called by name; those of ours that wrap angles left out."""
    found = re.findall(r"^\s+(?:callq?|bl|jmp)\s+_?([A-Za-z]\w*)", code, re.MULTILINE)
    return {name for name in found if not name.startswith("wrap")}


# ── which processor is which ──


class Features(dict):
    """What LLVM says of a processor."""

    def flatten(self) -> str:
        return ",".join(("+" if there else "-") + name for name, there in self.items())


@pytest.fixture
def pretend(monkeypatch):
    """Let LLVM speak of another processor."""

    def be(triple: str, *present: str, cpu: str = "someone"):
        known = dict.fromkeys([f for level in X86_LEVELS.values() for f in level] + ["fma4"], False)
        monkeypatch.setattr(llvm, "get_process_triple", lambda: triple)
        monkeypatch.setattr(llvm, "get_host_cpu_name", lambda: cpu)
        monkeypatch.setattr(
            llvm, "get_host_cpu_features", lambda: Features(known | dict.fromkeys(present, True) if present else {})
        )
        host.cache_clear()
        return host()

    yield be
    monkeypatch.undo()
    host.cache_clear()


V1 = X86_LEVELS["x86-64"]
V2 = (*V1, *X86_LEVELS["x86-64-v2"])
V3 = (*V2, *X86_LEVELS["x86-64-v3"])
V4 = (*V3, *X86_LEVELS["x86-64-v4"])


def without(features: tuple[str, ...], *masked: str) -> tuple[str, ...]:
    return tuple(f for f in features if f not in masked)


@pytest.mark.parametrize(
    ("triple", "features", "width", "fused", "levels"),
    [
        (LINUX, V4, 512, True, ["x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4"]),
        (LINUX, without(V4, "avx512dq", "avx512bw"), 256, True, ["x86-64", "x86-64-v2", "x86-64-v3"]),
        (LINUX, V3, 256, True, ["x86-64", "x86-64-v2", "x86-64-v3"]),
        (LINUX, without(V3, "fma"), 256, False, ["x86-64", "x86-64-v2"]),
        (LINUX, (*V2, "avx"), 256, False, ["x86-64", "x86-64-v2"]),
        (LINUX, (*V2, "avx", "fma4"), 256, True, ["x86-64", "x86-64-v2"]),
        (LINUX, V2, 128, False, ["x86-64", "x86-64-v2"]),
        (LINUX, V1, 128, False, ["x86-64"]),
        ("x86_64-pc-windows-msvc", V1, 128, False, ["x86-64"]),
        ("arm64-apple-darwin24", ("neon",), 128, True, ["armv8-a"]),
        ("aarch64-unknown-linux-gnu", (), 128, True, ["armv8-a"]),
        ("powerpc64le-unknown-linux-gnu", (), 128, True, []),
    ],
)
def test_width_and_fusing_follow_from_the_features(pretend, triple, features, width, fused, levels):
    found = pretend(triple, *features)
    assert (found.vector_bits, found.fused) == (width, fused)
    assert (found.lanes(DOUBLE), found.lanes(SINGLE)) == (width // 64, width // 32)
    assert list(choices()) == ["host", *levels]
    assert [n for n in choices() if n.endswith(("v3", "v4")) and not choices()[n].fused] == []
    assert all(choices()[n].vector_bits <= width for n in levels)
    assert ("-prefer-256-bit" in found.features) == (width == 512)


# ── TWISTWRENCH_CPU ──


@pytest.mark.parametrize("text", [None, "", "  ", "host", "HOST"])
def test_the_host_is_the_default(monkeypatch, text):
    if text is None:
        monkeypatch.delenv("TWISTWRENCH_CPU", raising=False)
    else:
        monkeypatch.setenv("TWISTWRENCH_CPU", text)
    assert chosen() == host()


@on_x86
def test_a_lesser_processor_may_be_named(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_CPU", " X86-64 ")
    assert chosen() == Machine(host().triple, "x86-64", "", 128, fused=False)
    assert chosen() == choices()["x86-64"]


@pytest.mark.parametrize("text", ["x86-64-v9", "pentium", "1", "avx2", "x86_64", "off"])
def test_a_name_that_means_nothing_lists_what_does(monkeypatch, text):
    monkeypatch.setenv("TWISTWRENCH_CPU", text)
    with pytest.raises(tw.ValueRangeError) as error:
        tw.robots.pendulum().mass_matrix([0.0])
    assert str(error.value) == (
        f"TWISTWRENCH_CPU: {text!r} names no processor whose code this one ({host().cpu}) runs."
        f" Allowed here: {', '.join(choices())}."
    )


def test_a_processor_this_one_cannot_stand_in_for_is_refused_with_what_it_lacks(monkeypatch, pretend):
    pretend(LINUX, *without(V3, "fma", "bmi2"), cpu="old")
    monkeypatch.setenv("TWISTWRENCH_CPU", "x86-64-v3")
    with pytest.raises(tw.ValueRangeError) as error:
        chosen()
    assert "(old) runs. x86-64-v3 wants bmi2, fma. Allowed here: host, x86-64, x86-64-v2." in str(error.value)
    pretend("arm64-apple-darwin24")
    with pytest.raises(tw.ValueRangeError, match=r"runs\. Allowed here: host, armv8-a\."):
        chosen()


def test_after_a_wrong_name_a_right_one_will_do(monkeypatch):
    robot = tw.robots.pendulum()
    monkeypatch.setenv("TWISTWRENCH_CPU", "nothing")
    with pytest.raises(tw.ValueRangeError):
        robot.mass_matrix([0.0])
    monkeypatch.delenv("TWISTWRENCH_CPU")
    assert robot.mass_matrix([0.0]).shape == (1, 1)


@on_x86
def test_a_kernel_keeps_the_processor_it_was_made_for(monkeypatch):
    """Single precision is compiled at its first call; by then the variable may say something else."""
    robot, q = tw.robots.planar_3r(), np.linspace(-3, 3, 33 * 3, dtype=np.float32).reshape(33, 3)
    monkeypatch.setenv("TWISTWRENCH_CPU", "x86-64")
    whole = robot.mass_matrix(q)
    other = tw.robots.planar_3r()
    other.mass_matrix(q.astype(float))
    monkeypatch.setenv("TWISTWRENCH_CPU", "nothing")
    assert other.mass_matrix(q).tobytes() == whole.tobytes()


@on_x86
def test_bits_are_equal_within_the_two_sets_of_processors(monkeypatch):
    """With fused multiply–add or without; between the sets, products and sums round differently."""
    q = np.linspace(-3, 3, 33 * 3).reshape(33, 3)
    bits: dict[bool, set[bytes]] = {True: set(), False: set()}
    for name, machine in choices().items():
        monkeypatch.setenv("TWISTWRENCH_CPU", name)
        bits[machine.fused].add(tw.robots.planar_3r().inverse_dynamics(q, q[::-1], q).tobytes())
    assert all(len(found) <= 1 for found in bits.values())
    assert not bits[True] & bits[False]


EVERYWHERE = """
import numpy as np, twistwrench as tw
robot = tw.robots.ur5()
q = robot.random_configuration(0, 21)
dq = np.random.default_rng(1).normal(size=(2, 21, 6))
one = [robot.gravity_forces(q[k]) for k in range(21)]  # by the builtin, from the third on
assert "builtin" in repr(robot.gravity_forces) or "built-in" in repr(robot.gravity_forces)
assert np.array_equal(one, robot.gravity_forces(q))
for dtype in "df":
    for a in (robot.inverse_dynamics(*(x.astype(dtype) for x in (q, *dq))), robot.mass_matrix(q.astype(dtype))):
        print(a.tobytes().hex())
"""


def everywhere(cpu: str, cache) -> list[np.ndarray]:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", EVERYWHERE],
        env={**os.environ, "TWISTWRENCH_CPU": cpu, "TWISTWRENCH_CACHE_DIR": str(cache)}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [np.frombuffer(bytes.fromhex(t), dt) for t, dt in zip(done.stdout.split(), "ddff", strict=True)]


@pytest.mark.slow
def test_machines_that_share_a_cache_never_share_code_they_must_not(tmp_path):
    """Each processor has entries of its own; those that fuse give the same bits, the others agree to round-off."""
    results, entries = {}, set()
    for name in choices():
        results[name] = everywhere(name, tmp_path)
        now = {entry.name for entry in tmp_path.iterdir()}
        new = [(tmp_path / name).read_bytes() for name in now - entries]
        code = [kept for kept in new if len(kept) > 1500]  # what is kept of robots, kernels and LLVM is shorter
        assert len(code) == 7  # three loops, two of them in single precision too; one lane of one, and its builtin
        assert entries <= now
        entries = now
        again = everywhere(name, tmp_path)
        assert [a.tobytes() for a in again] == [a.tobytes() for a in results[name]]
        assert {entry.name for entry in tmp_path.iterdir()} == entries  # found again
    for name, found in results.items():
        for a, b in zip(found, results["host"], strict=True):
            if choices()[name].fused == host().fused:
                assert a.tobytes() == b.tobytes()
            else:  # some 500 operations of one rounding each, most of them on numbers far below the largest
                assert np.max(np.abs(a - b)) <= 100 * np.finfo(a.dtype).eps * np.max(np.abs(b))
                assert a.tobytes() != b.tobytes()


def test_the_processor_is_in_the_key(monkeypatch, tmp_path):
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(tmp_path))
    program = trace(lambda x: x * x + 1.0, [("x", ())], ["y"])
    mine = host()
    variants = [mine, *(dataclasses.replace(mine, vector_bits=w) for w in (64, 128, 256, 512) if w != mine.vector_bits)]
    variants += [dataclasses.replace(mine, cpu="generic"), dataclasses.replace(mine, fused=not mine.fused)]
    assert not any(compile_form(program, DOUBLE, m).cached for m in variants)
    assert all(compile_form(program, DOUBLE, m).cached for m in variants)


def test_llvm_is_asked_when_something_compiles_not_before():
    assert isinstance(target_machine.chosen, types.FunctionType)
    code = "import sys; import twistwrench; from twistwrench.compiler.lowering import target_machine; assert 'llvmlite' not in sys.modules"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "TWISTWRENCH_CPU": "nothing"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
