"""Long programs: emitted in sections they keep their bits, their memory is bounded, and they run on small stacks."""

from __future__ import annotations

import functools
import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.ir.program import Program
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering import batch_loop, lower, partition
from twistwrench.compiler.lowering.spill_frame import SpillFrame
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, Machine, host
from twistwrench.compiler.runtime import jit
from twistwrench.compiler.runtime.gufunc import make_ufunc
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.robot.kernels import large_robots
from twistwrench.testing import random_inertia, random_pose

tracing = sys.modules["twistwrench.compiler.ir.tracer"]

COUNT = 2 * max(host().lanes(p) for p in (DOUBLE, SINGLE)) + 3
KERNELS = [
    ("panda", "inverse_dynamics"),
    ("panda", "mass_matrix"),
    ("panda", "inverse_dynamics_derivatives"),
    ("panda", "link_poses"),
    ("cart_pole", "kinetic_energy"),
]
SMALL_STACK = 256 * 1024


def chain(joints: int) -> tw.Robot:
    """A serial chain of revolute joints about any axes."""
    rng = np.random.default_rng(3)
    builder = ModelBuilder("chain")
    builder.add_link("link0")
    for i in range(1, joints + 1):
        builder.add_link(f"link{i}", random_inertia(rng))
        builder.add_joint(
            f"joint{i}", "revolute", f"link{i - 1}", f"link{i}",
            placement=random_pose(rng), axis=rng.standard_normal(3), lower=-3.0, upper=3.0,
        )  # fmt: skip
    return tw.robot.Robot(builder.build())


long_chain = functools.cache(lambda: chain(100))


def same_bits(a, b) -> bool:
    pairs = zip(*(x if isinstance(x, tuple) else (x,) for x in (a, b)), strict=True)
    return all(x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes() for x, y in pairs)


def states(program: Program, count: int, dtype: type) -> list[np.ndarray]:
    rng = np.random.default_rng(4)
    return [rng.normal(size=(count, *port.shape)).astype(dtype) for port in program.inputs]


def both_ways(monkeypatch, program: Program, section: int, on_stack: int = 100_000):
    """The kernel in one function, and the kernel in sections of so many instructions, five to a module."""
    whole = make_ufunc(program, "whole", "")
    whole(*states(program, 1, np.float32))  # single precision is compiled at its first call
    for name, value in (("MAX_INSTRUCTIONS", 0), ("PARTITION", section), ("PARTITIONS_PER_MODULE", 5)):
        monkeypatch.setattr(lower if name == "MAX_INSTRUCTIONS" else partition, name, value)
    monkeypatch.setattr(batch_loop, "ON_STACK", on_stack)
    cut = make_ufunc(program, "cut", "")
    cut(*states(program, 1, np.float32))
    return whole, cut


# ── sections ──


@pytest.mark.parametrize(("name", "quantity"), mostly_slow(KERNELS, 3))
@pytest.mark.parametrize(("section", "on_stack"), [(50, 100_000), (170, 0)], ids=["short", "in memory"])
def test_sections_change_no_bit(bundled, monkeypatch, name, quantity, section, on_stack):
    program = bundled(name).program(quantity)
    monkeypatch.setattr(lower, "MAX_INSTRUCTIONS", len(program.instructions))
    whole, cut = both_ways(monkeypatch, program, section, on_stack)
    for dtype in (np.float64, np.float32):
        arrays = states(program, COUNT, dtype)
        expected = whole(*arrays)
        assert same_bits(cut(*arrays), expected)
        for count in range(COUNT):
            assert same_bits(cut(*(a[:count] for a in arrays)), whole(*(a[:count] for a in arrays)))
        strided = [np.repeat(a, 2, axis=0)[::2] for a in arrays]
        assert same_bits(cut(*strided), expected)
        assert same_bits(cut(*(np.asfortranarray(a) for a in arrays)), expected)


def test_sections_keep_huge_angles_and_nan(bundled, monkeypatch):
    program = bundled("panda").program("mass_matrix")
    whole, cut = both_ways(monkeypatch, program, 60)
    q = np.random.default_rng(1).normal(size=(COUNT, 7))
    q[1, 2], q[4, 0], q[6, 1] = 1e18, -3e12, np.nan
    with np.errstate(invalid="ignore"):
        assert same_bits(cut(q), whole(q))


def test_sections_share_threads(bundled, monkeypatch):
    program = bundled("panda").program("inverse_dynamics")
    whole, cut = both_ways(monkeypatch, program, 60, on_stack=0)
    arrays = states(program, 5000, np.float64)
    expected, found = whole(*arrays), np.full((4, 5000, 7), np.nan)

    def run(k):
        cut(*arrays, out=found[k])

    crew = [threading.Thread(target=run, args=(k,)) for k in range(4)]
    for thread in crew:
        thread.start()
    for thread in crew:
        thread.join()
    assert all(same_bits(one, expected) for one in found)


def test_programs_below_the_threshold_are_one_function(bundled):
    machine = Machine("x86_64-unknown-linux-gnu", "znver4", "", 512)
    program = bundled("panda").program("mass_matrix")
    assert list(lower.modules(program, DOUBLE, machine)) == [lower.assembly(program, DOUBLE, machine)]
    assert "malloc" not in lower.assembly(program, DOUBLE, machine)


@pytest.mark.parametrize("length", [40, 100, 333])
def test_a_frame_keeps_what_crosses_and_nothing_twice(bundled, length):
    """Each slot holds one value at a time; cuts lie within half a length of even ones."""
    program = bundled("panda").program("forward_dynamics")
    frame = SpillFrame(program, length)
    lengths = np.diff(frame.starts)
    assert frame.starts[0] == 0
    assert frame.starts[-1] == len(program.instructions)
    assert (lengths[:-1] >= length // 2).all()
    assert (lengths <= length * 3 // 2).all()
    part = np.searchsorted(frame.starts, np.arange(len(program.instructions)), side="right")
    last = {}
    for number, (_, args, _) in enumerate(program.instructions):
        for a in args:
            last[a] = part[number]
    crossing = {
        a for a, used in last.items() if used > part[a] and program.instructions[a].op not in ("const", "input")
    }
    assert set(frame.slots) == crossing
    held: dict[int, int] = {}
    for number in sorted(frame.slots):
        home = frame.slots[number]
        if home < len(program.results):
            assert program.results[home] == number
        else:
            assert held.get(home, 0) < part[number]
            held[home] = last[number]


# ── memory and stack ──


def test_without_memory_results_are_nan(bundled, monkeypatch):
    program = bundled("panda").program("mass_matrix")
    monkeypatch.setattr(batch_loop, "ON_STACK", 0)
    text = lower.assembly(program, DOUBLE, host())
    assert "declare ptr @malloc(i64)" in text
    none = "define internal ptr @malloc(i64 %size) noinline {\n  ret ptr null\n}"
    monkeypatch.setattr(lower, "assembly", lambda *_: text.replace("declare ptr @malloc(i64)", none))
    monkeypatch.setattr(lower, "MAX_INSTRUCTIONS", len(program.instructions))
    kernel = make_ufunc(program, "starved", "")
    out = np.zeros((3, 7, 7, 2))
    assert np.isnan(kernel(np.zeros((3, 7)), out=out[..., 0])).all()
    assert (out[..., 1] == 0).all()


def on_a_small_stack(function):
    """What a function returns in a thread with 256 kB of stack."""
    found = []
    usual = threading.stack_size(SMALL_STACK)
    try:
        thread = threading.Thread(target=lambda: found.append(function()))
        thread.start()
        thread.join()
    finally:
        threading.stack_size(usual)
    return found[0]


@functools.cache
def wide() -> Program:
    """Entries of results enough for buffers far beyond a small stack."""
    return trace(lambda x: np.outer(np.tile(x, 60), np.tile(x, 10)), [("x", (4,))], ["W"])


@pytest.mark.parametrize("way", mostly_slow(["usual", "whole", "cut"], 3))
def test_wide_results_need_no_large_stack(monkeypatch, way):
    program = wide()
    if way != "usual":
        monkeypatch.setattr(lower, "MAX_INSTRUCTIONS", 0 if way == "cut" else 10**9)
    kernel = make_ufunc(program, "wide", "")
    x = np.random.default_rng(2).normal(size=(COUNT, 4))
    expected = np.einsum("ni,nj->nij", np.tile(x, 60), np.tile(x, 10))
    assert on_a_small_stack(lambda: np.array_equal(kernel(x), expected))
    assert on_a_small_stack(lambda: np.array_equal(kernel(np.asfortranarray(x)[:3]), expected[:3]))


def test_a_program_without_end_is_refused(bundled, monkeypatch):
    monkeypatch.setattr(tracing, "MAX_EXPRESSIONS", 500)
    with pytest.raises(tw.KernelError, match=r"more than 500 operations a state.*reference"):
        bundled("panda").program("inverse_dynamics")


@pytest.fixture
def collector():
    """Garbage collector, enabled: a library that an earlier test used with threads may have left it disabled."""
    import gc

    enabled = gc.isenabled()
    gc.enable()
    yield gc
    (gc.enable if enabled else gc.disable)()


def test_tracing_leaves_the_collector_as_it_was(bundled, collector):
    bundled("planar_2r").program("mass_matrix")
    assert collector.isenabled()
    collector.disable()
    bundled("planar_2r").program("gravity_forces")
    assert not collector.isenabled()


def test_traces_of_several_threads_leave_the_collector_as_it_was(collector):
    import sys
    import threading

    from twistwrench.compiler.ir.tracer import trace

    def trace_often() -> None:
        for _ in range(300):
            trace(lambda x: x, [("x", ())], ["y"])

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(4):
            threads = [threading.Thread(target=trace_often) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert collector.isenabled()
    finally:
        sys.setswitchinterval(interval)


# ── a chain of a hundred joints ──

USUAL = [
    "inverse_dynamics",
    "forward_dynamics",
    "jacobian",
    "jacobian_rate",
    "link_poses",
    "joint_wrenches",
    "gravity_forces",
    "momentum_about_com",
    "com_jacobian",
]


@pytest.mark.slow
@pytest.mark.parametrize("quantity", USUAL)
def test_a_chain_of_a_hundred_joints(quantity):
    """Against the algorithm itself on floats; order and fusing differ, hence 1e-9 of the largest entry, cond M of it for q̈."""
    robot = tw.robot.Robot(long_chain().model)
    arrays = [0.3 * a for a in states(robot.program(quantity), 2, np.float64)]
    kernel = robot.kernel(quantity)
    assert isinstance(kernel, np.ufunc)
    found = on_a_small_stack(lambda: kernel(*arrays))
    for k in range(2):
        expected = np.asarray(robot.reference(quantity, *(a[k] for a in arrays)), float)
        scale = np.abs(expected).max()
        tolerance = 1e-9 if quantity != "forward_dynamics" else 1e-5
        assert np.abs(found[k] - expected).max() < tolerance * scale


@pytest.mark.slow
def test_a_long_chain_s_mass_matrix_gives_its_forces_and_agrees_with_pinocchio():
    """145,000 instructions. M against CRBA of the same chain, built joint by joint in Pinocchio."""
    pin = pytest.importorskip("pinocchio")
    robot = tw.robot.Robot(long_chain().model)
    kernel = robot.kernel("mass_matrix")
    assert isinstance(kernel, np.ufunc)
    model, parent = pin.Model(), 0
    for body in robot.model.bodies:
        inertia = body.inertia
        T = np.asarray(body.placement, float)
        joint = pin.JointModelRevoluteUnaligned(np.asarray(body.joint.axes[0, :3], float))
        parent = model.addJoint(parent, joint, pin.SE3(T[:3, :3].copy(), T[:3, 3].copy()), body.joint.name)
        centred = pin.Inertia(inertia.mass, np.array(inertia.com), np.array(inertia.moment_about_com))
        model.appendBodyToJoint(parent, centred, pin.SE3.Identity())
    data = model.createData()
    q = np.random.default_rng(6).normal(size=(3, 100))
    M = kernel(q)
    for k in range(3):
        pin.crba(model, data, q[k], pin.Convention.WORLD)
        expected = np.triu(data.M) + np.triu(data.M, 1).T
        assert np.abs(M[k] - expected).max() < 1e-9 * np.abs(expected).max()
        assert np.array_equal(M[k], M[k].T)


def test_derivatives_put_together_are_slopes_of_accelerations(monkeypatch):
    """Accelerations are quadratic in velocities and linear in torques: their central differences are exact for any step."""
    monkeypatch.setattr(large_robots, "LAPACK_FROM", 1)
    robot = tw.robots.planar_2r().with_gravity([0.3, -9.7, 0.1])  # whose kernels no other test has made
    q, dq, tau = [0.3, 1.1], np.array([0.7, -1.9]), np.array([2.0, -3.0])
    by_q, by_dq, by_tau = robot.forward_dynamics_derivatives(q, dq, tau)
    assert type(robot.kernel("forward_dynamics_derivatives")).__name__ == "LapackDerivatives"
    for k, step in enumerate(np.eye(2)):
        ends = [robot.forward_dynamics(q, dq + s * step, tau) for s in (1, -1)]
        np.testing.assert_allclose(by_dq[:, k], (ends[0] - ends[1]) / 2, rtol=1e-12)
        ends = [robot.forward_dynamics(q, dq, tau + s * step) for s in (1, -1)]
        np.testing.assert_allclose(by_tau[:, k], (ends[0] - ends[1]) / 2, rtol=1e-12)
        ends = [robot.forward_dynamics(q + s * 1e-5 * step, dq, tau) for s in (1, -1)]
        np.testing.assert_allclose(by_q[:, k], (ends[0] - ends[1]) / 2e-5, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "quadruped"])
def test_derivatives_put_together_equal_the_unrolled_ones(bundled, monkeypatch, name):
    robot = bundled(name)
    frame = robot.link_names[-1]
    rng = np.random.default_rng(3)
    q, dq, tau = robot.random_configuration(rng, (2, 3)), rng.normal(size=(3, robot.nv)), rng.normal(size=robot.nv)
    wrench = {frame: rng.normal(size=6)}
    usual = robot.forward_dynamics_derivatives(q, dq, tau, wrench_by_robot=wrench)
    monkeypatch.setattr(large_robots, "LAPACK_FROM", 1)
    long = tw.robot.Robot(robot.model)
    found = long.forward_dynamics_derivatives(q, dq, tau, wrench_by_robot=wrench)
    assert type(long.kernel("forward_dynamics_derivatives")).__name__ == "LapackDerivatives"
    assert (
        long.kernel("forward_dynamics_derivatives").signature == robot.kernel("forward_dynamics_derivatives").signature
    )
    condition = np.linalg.cond(robot.mass_matrix(q)).max()
    for a, b in zip(found, usual, strict=True):
        assert a.shape == b.shape
        assert np.abs(a - b).max() < 1e-15 * condition * np.abs(b).max()
    single = long.forward_dynamics_derivatives(*(x.astype(np.float32) for x in (q, dq, tau)))
    assert all(x.dtype == np.float32 for x in single)
    out = tuple(np.empty((2, 3, robot.nv, robot.nv)) for _ in range(3))
    again = long.kernel("forward_dynamics_derivatives")(q, dq, tau, out=out)
    assert again is out
    with pytest.raises(tw.ShapeError, match="dq"):
        long.forward_dynamics_derivatives(q, dq[..., :-1], tau)


@pytest.mark.slow
def test_a_long_chain_has_derivatives_of_its_forward_dynamics():
    robot = tw.robot.Robot(long_chain().model)
    rng = np.random.default_rng(7)
    q, dq, tau = 0.3 * rng.normal(size=(3, 100))
    by_q, by_dq, by_tau = robot.forward_dynamics_derivatives(q, dq, tau)
    direction, h = rng.normal(size=100), 1e-6
    for derivative, moved in ((by_q, "q"), (by_dq, "dq"), (by_tau, "tau")):
        state = {"q": q, "dq": dq, "tau": tau}
        ends = [robot.forward_dynamics(**{**state, moved: state[moved] + s * h * direction}) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * h)
        assert np.abs(derivative @ direction - slope).max() < 1e-4 * np.abs(slope).max()


@pytest.mark.slow
def test_memory_of_a_long_program_is_bounded():
    """The mass matrix of the chain, twice by sections: tracing 145,000 instructions is 200 MB, LLVM and imports 120."""
    script = """
        import sys
        sys.path[:0] = ["tests/kernels", "tests/support"]
        from memory import peak_memory
        from test_large_robots import chain
        kernel = chain(100).kernel("mass_matrix")
        assert type(kernel).__name__ == "ufunc"
        peak = peak_memory()
        assert peak < 700, peak
    """
    pytest.importorskip("resource")
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], check=True)


@pytest.mark.slow
def test_a_long_chain_s_christoffel_symbols_are_refused_in_bounded_memory():
    """A million entries of three hundred operations each: an error that says so, before a second gigabyte is taken."""
    script = """
        import sys
        sys.path[:0] = ["tests/kernels", "tests/support"]
        from memory import peak_memory
        import twistwrench as tw
        from test_large_robots import chain
        try:
            chain(100).kernel("christoffel")
        except tw.KernelError as error:
            assert "too many" in str(error)
        else:
            raise SystemExit("compiled?")
        peak = peak_memory()
        assert peak < 1500, peak
    """
    pytest.importorskip("resource")
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], check=True)


def test_codes_of_several_modules_come_from_the_cache(bundled, monkeypatch):
    program = bundled("planar_2r").program("forward_dynamics")
    for name, value in (("MAX_INSTRUCTIONS", 0), ("PARTITION", 10), ("PARTITIONS_PER_MODULE", 2)):
        monkeypatch.setattr(lower if name == "MAX_INSTRUCTIONS" else partition, name, value)
    modules = list(lower.modules(program, DOUBLE, host()))
    assert len(modules) > 2
    code = jit.compile_form(program, DOUBLE)
    assert not code.cached and len({*code.keys}) == len(modules)
    assert jit.compile_form(program, DOUBLE).cached
    assert jit.cached_code(code.keys, host()).keys == code.keys
