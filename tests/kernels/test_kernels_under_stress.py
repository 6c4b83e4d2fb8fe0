"""Kernels and speed: stores past the caches, interrupts, small stacks, kept robots, derivatives of derivatives in JAX."""

from __future__ import annotations

import copy
import hashlib
import os
import pickle
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import twistwrench as tw

NEEDS_SIGINT = pytest.mark.skipif(
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN, reason="SIGINT is ignored where the tests were started"
)


def derivatives_of_a_quadruped(count: int):
    """The kernel of ∂tau, so many states, and arrays for its results as NumPy makes them."""
    robot = tw.robots.quadruped()
    kernel = robot.kernel("inverse_dynamics_derivatives")
    rng = np.random.default_rng(68)
    q = robot.random_configuration(rng=1, size=count)
    given = (q, *(rng.normal(size=(count, robot.nv)) for _ in range(2)))
    return kernel, given, tuple(np.empty((count, robot.nv, robot.nv)) for _ in range(2))


def test_results_beyond_the_caches_have_the_same_bits():
    kernel, given, out = derivatives_of_a_quadruped(4096)  # 21 MB
    assert sum(x.nbytes for x in out) > 1 << 24
    kernel(*given, out=out)
    few = slice(4000, 4064)
    for whole, part in zip(out, kernel(*(x[few] for x in given)), strict=True):
        np.testing.assert_array_equal(whole[few], part)


@pytest.mark.slow
def test_a_state_of_a_large_batch_takes_about_what_one_of_a_small_batch_takes():
    """The least of many rounds: other programs may have the caches at any time."""
    cases = {count: derivatives_of_a_quadruped(count) for count in (512, 4096)}
    taken = dict.fromkeys(cases, np.inf)
    for _ in range(60):
        for count, (kernel, given, out) in cases.items():
            for _ in range(2):
                began = time.thread_time_ns()
                kernel(*given, out=out)
                taken[count] = min(taken[count], (time.thread_time_ns() - began) / count)
    assert taken[4096] < 1.8 * taken[512], taken


# ── kept robots ──

DOUBTFUL = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.02"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint></robot>"""
FIRST_TORQUE = """
import sys
import twistwrench as tw
{imports}
robot = tw.load({path!r})
print(robot.inverse_dynamics([0.1], [0.2], [0.3]).tobytes().hex(), "twistwrench.formats.urdf" in sys.modules)
print(*robot.defects, sep="; ")
"""


def first_torque(path: Path, place: Path | str, imports: str = "") -> tuple[str, bool, str, str]:
    """Bits of a torque in a process of its own, whether the file was read for it, the defects, and the warnings."""
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", FIRST_TORQUE.format(path=str(path), imports=imports)],
        env={**os.environ, "TWISTWRENCH_CACHE_DIR": str(place)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    torque, defects = done.stdout.splitlines()
    bits, read = torque.split()
    return bits, read == "True", defects, done.stderr.replace("<string>", "")


def test_a_file_with_a_remark_is_known_again_in_any_order_of_imports(tmp_path):
    path, place = tmp_path / "arm.urdf", tmp_path / "cache"
    path.write_text(DOUBTFUL)
    made = first_torque(path, place)
    assert made[1]
    assert "has no <limit>" in made[2]
    assert made[3].count("ModelWarning") == 1
    for imports in ("", "import twistwrench.trajectories, twistwrench.mechanics.model.builder"):
        found = first_torque(path, place, imports)
        assert found[:3] == (made[0], False, made[2])
        assert found[3].partition("ModelWarning")[2] == made[3].partition("ModelWarning")[2] != ""
    assert first_torque(path, "off")[::2] == made[::2]


# ── second derivatives in JAX ──


@pytest.fixture
def jax():
    found = pytest.importorskip("jax", reason="needs the extra jax")
    before = found.config.jax_enable_x64
    found.config.update("jax_enable_x64", True)
    yield found
    found.config.update("jax_enable_x64", before)


def test_second_derivatives_are_calls_of_compiled_kernels(jax):
    """As custom calls, of which XLA compiles nothing: the operations of J's program would be thousands."""
    robot = tw.robots.planar_3r()
    x = [np.linspace(-1, 1, 3), np.array([0.3, -0.2, 0.5]), np.array([1.0, 0.4, -0.7])]
    torque = robot.to_jax("inverse_dynamics")

    def cost(*given):
        return (torque(*given) ** 2).sum()

    traced = jax.jit(jax.hessian(cost, argnums=(0, 1, 2))).lower(*x)
    assert traced.as_text().count("\n") < 500
    found = traced.compile()(*x)
    tau = robot.inverse_dynamics(*x)
    H = robot.kernel("inverse_dynamics", by=("q", "dq", "ddq"), form="hessian")(*x)
    J = np.concatenate(robot.kernel("inverse_dynamics", by=("q", "dq", "ddq"))(*x), axis=1)
    expected = 2 * (J.T @ J + np.tensordot(tau, H, axes=1))
    np.testing.assert_allclose(
        np.block([list(row) for row in found]), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )


def test_products_with_a_vector_and_mixed_derivatives_are_the_same(jax):
    """Forward over reverse, reverse over forward, by inputs that did not move at first, of batches, of several results."""
    robot = tw.robots.planar_2r()
    rng = np.random.default_rng(69)
    x, v = (tuple(rng.normal(size=(3, 2))) for _ in range(2))
    terms = robot.to_jax("inverse_dynamics")

    def cost(*given):
        return (terms(*given) ** 2).sum()

    every = (0, 1, 2)
    mixed, J = jax.jacfwd(jax.grad(cost, argnums=1), argnums=0), robot.to_jax("jacobian")

    @jax.jit
    def derivatives(x, v):
        many = [jax.numpy.stack([2 * a, a]) for a in x]
        return {
            "hessian": jax.hessian(cost, argnums=every)(*x),
            "forward over reverse": jax.jvp(jax.grad(cost, argnums=every), x, v)[1],
            "reverse over forward": jax.grad(lambda *y: jax.jvp(cost, y, v)[1], argnums=every)(*x),
            "mixed": mixed(*x),
            "batch": jax.vmap(mixed)(*many)[1],
            "jacobian": jax.jacfwd(jax.jacfwd(J))(x[0]),
        }

    found = derivatives(x, v)
    H = np.block([list(row) for row in found["hessian"]])
    near = {"rtol": 0, "atol": 1e-12 * np.abs(H).max()}
    for order in ("forward over reverse", "reverse over forward"):
        np.testing.assert_allclose(np.concatenate(found[order]), H @ np.concatenate(v), **near)
    for way in ("mixed", "batch"):
        np.testing.assert_allclose(found[way], H[2:4, :2], **near)
    expected = robot.kernel("jacobian", by="q", form="hessian")(x[0])
    np.testing.assert_allclose(found["jacobian"], expected, rtol=0, atol=1e-12)


def test_a_traced_array_in_a_method_is_told_of_to_jax(jax):
    robot = tw.robots.planar_2r()
    for transform in (jax.jit, jax.jacfwd, jax.vmap):
        with pytest.raises(tw.ShapeError, match=r"traced by JAX.*to_jax"):
            transform(robot.gravity_forces)(np.ones((2, 2)) if transform is jax.vmap else np.ones(2))


# ── interrupts ──


@NEEDS_SIGINT
def test_an_interrupt_of_the_first_call_in_single_precision_is_raised(monkeypatch):
    """Where LLVM is at work for it, below NumPy, which no exception can cross."""
    llvm = pytest.importorskip("llvmlite.binding", reason="compiles nothing here")
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "off")
    robot = tw.robots.cart_pole()
    for way in (robot.kernel("mass_matrix"), robot.gravity_forces):
        q = np.array([[0.1, 0.2], [0.3, -0.4]])
        right = way(q)
        with monkeypatch.context() as patch:
            patch.setattr(llvm.TargetMachine, "emit_object", lambda *_: signal.raise_signal(signal.SIGINT))
            with pytest.raises(KeyboardInterrupt):
                way(q.astype("f"))
        np.testing.assert_allclose(way(q.astype("f")), right, rtol=1e-5, atol=1e-6)


# ── stacks, and object code ──

SMALL_STACK = """
import threading
import numpy as np
import twistwrench as tw
panda, found = tw.robots.panda(), []
x = np.linspace(-1, 1, 64 * 7).reshape(64, 7)
def work():
    found.append(panda.inverse_dynamics_derivatives(x, x, x)[0])
    found.append(panda.regressor(x, x, x))
work()
threading.stack_size(65536)
thread = threading.Thread(target=work)
thread.start()
thread.join()
print(all((a == b).all() for a, b in zip(found[:2], found[2:], strict=True)))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="stacks grow there")
def test_kernels_run_in_a_thread_of_64_kb():
    done = subprocess.run([sys.executable, "-c", SMALL_STACK], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux") or os.uname().machine != "x86_64", reason="ELF of x86-64")
def test_object_code_that_points_out_of_its_section_is_not_placed(tmp_path):
    """An entry of the cache with a right checksum whose first relocation lies 64 bytes before its section."""
    code = "import twistwrench as tw; print(tw.robots.cart_pole().gravity_forces([0.1, 0.2]).tobytes().hex())"

    def bits() -> str:
        place = {**os.environ, "TWISTWRENCH_CACHE_DIR": str(tmp_path / "cache")}
        return subprocess.run(
            [sys.executable, "-c", code], env=place, capture_output=True, text=True, check=True
        ).stdout

    right = bits()
    entries = [(path, path.read_bytes()) for path in (tmp_path / "cache").iterdir()]
    spoiled = 0
    for path, raw in entries:
        head = raw.find(b"\x7fELF")
        if head < 0:
            continue
        made, object_code = bytearray(raw), raw[head:]
        (table,), (count,) = struct.unpack_from("<Q", object_code, 40), struct.unpack_from("<H", object_code, 60)
        for k in range(count):
            kind, offset = (
                struct.unpack_from(form, object_code, table + 64 * k + at)[0] for form, at in (("<I", 4), ("<Q", 24))
            )
            if kind == 4:  # relocations with addends
                struct.pack_into("<Q", made, head + offset, 2**64 - 64)
        state = hashlib.blake2b(digest_size=32)
        for part in (path.name.encode(), bytes(made[head:])):
            state.update(len(part).to_bytes(8, "little") + part)
        made[head - 32 : head] = state.digest()
        path.write_bytes(made)
        spoiled += made != raw
    assert spoiled
    assert bits() == right


# ── kernels as objects, and arrays of many axes ──


def test_kernels_pickle():
    robot = tw.robots.cart_pole()
    q, dq = np.array([[0.1, 0.2], [0.3, -0.4]]), np.array([0.5, 0.6])
    for kernel, given in (
        (robot.kernel("mass_matrix"), (q,)),
        (robot.kernel("mass_matrix", "bias_forces"), (q, dq)),
        (tw.differentiate(lambda q: robot.gravity_forces(q), {"q": robot}), (q,)),
    ):
        found = pickle.loads(pickle.dumps(kernel))
        assert (found.signature, found.__name__, found.__doc__) == (kernel.signature, kernel.__name__, kernel.__doc__)
        results = (made if isinstance(made, tuple) else (made,) for made in (found(*given), kernel(*given)))
        for a, b in zip(*results, strict=True):
            np.testing.assert_array_equal(a, b)
        assert copy.deepcopy([kernel])[0] is copy.copy(kernel) is kernel
    assert pickle.loads(pickle.dumps(np.add)) is np.add


@pytest.mark.parametrize("name", ["mass_matrix", "jacobian", "forward_kinematics"])
def test_more_axes_than_numpy_has_are_an_error_of_ours(name):
    robot = tw.robots.ur5()
    most = robot.mass_matrix(np.zeros((1,) * 62 + (6,)))
    assert most.shape == (1,) * 62 + (6, 6)
    with pytest.raises(tw.ShapeError, match="q has 63 batch axes"):
        getattr(robot, name)(np.zeros((1,) * 63 + (6,)))


# ── the first call of a long program ──

LONG_COMPILATION = """
import numpy as np
import twistwrench as tw
panda = tw.robots.panda()
kernel = panda.kernel("inverse_dynamics", by=("q", "dq", "ddq"), form="hessian")
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_terminal_is_told_what_is_compiled_after_a_second():
    import pty

    ours, theirs = pty.openpty()
    here = {**os.environ, "TWISTWRENCH_CACHE_DIR": "off"}
    subprocess.run([sys.executable, "-c", LONG_COMPILATION], env=here, stderr=theirs, check=True)
    os.close(theirs)
    assert b"compiling a kernel of tau_hessian" in os.read(ours, 10_000)
    os.close(ours)
    piped = subprocess.run([sys.executable, "-c", LONG_COMPILATION], env=here, stderr=subprocess.PIPE, check=True)
    assert piped.stderr == b""
