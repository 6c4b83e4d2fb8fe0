"""The disk cache: code found again, and nothing wrong ever run. And the way around the compiler, TWISTWRENCH_JIT=0."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.kernels import cache
from twistwrench.kernels.code import compiled
from twistwrench.kernels.ufunc import make_ufunc
from twistwrench.program.trace import trace
from twistwrench.targets.machine import DOUBLE, SINGLE
from twistwrench.targets.numpy import NumpyKernel

PROGRAM = trace(lambda x: 3.0 * x + 0.5, [("x", ())], ["y"])
OTHER = trace(lambda x: 7.0 * x - 0.5, [("x", ())], ["y"])


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A cache folder of the test's own, not made yet."""
    folder = tmp_path / "chosen" / "cache"
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(folder))
    return folder


def works(program=PROGRAM) -> bool:
    return bool(make_ufunc(program, "line", "")(2.0) == (6.5 if program is PROGRAM else 13.5))


def python(code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


# ── found again ──


def test_the_second_time_code_comes_from_the_disk(place):
    assert not compiled(PROGRAM, DOUBLE).cached
    assert compiled(PROGRAM, DOUBLE).cached
    assert not compiled(PROGRAM, SINGLE).cached  # each precision is code of its own
    assert not compiled(OTHER, DOUBLE).cached
    assert len(list(place.iterdir())) == 3
    assert works()
    assert works(OTHER)


def test_the_second_process_compiles_nothing(place):
    code = (
        "import twistwrench as tw; from twistwrench.kernels import code, ufunc; made = []\n"
        "def spy(*a): made.append(code.compiled(*a)); return made[-1]\n"
        "ufunc.compiled = spy; robot = tw.robots.planar_2r()\n"
        "robot.mass_matrix([0, 0.5]); robot.gravity_forces([0, 0.5])\n"
        "robot.mass_matrix(robot.neutral.astype('f'))\n"
        "print([c.cached for c in made])"
    )
    assert python(code) == "[False, False, False]"
    assert python(code) == "[True, True, True]"


def test_the_folder_is_made_private(place):
    umask = os.umask(0)
    try:
        assert works()
    finally:
        os.umask(umask)
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert all(stat.S_IMODE(entry.stat().st_mode) & 0o022 == 0 for entry in place.iterdir())


def test_off_means_off(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    for word in ("off", "OFF"):
        monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", word)
        assert cache.folder() is None
        assert not compiled(PROGRAM, DOUBLE).cached
        assert not compiled(PROGRAM, DOUBLE).cached
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the user's cache folder is XDG_CACHE_HOME on Linux")
def test_by_default_it_is_the_user_s_cache_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("TWISTWRENCH_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder() == tmp_path / "twistwrench" / "kernels"


# ── damage ──

DAMAGE = {
    "empty": lambda raw: b"",
    "truncated": lambda raw: raw[: len(raw) // 2],
    "one byte short": lambda raw: raw[:-1],
    "only a head": lambda raw: raw[: len(cache.MAGIC) + 32],
    "one bit turned": lambda raw: raw[:-100] + bytes([raw[-100] ^ 1]) + raw[-99:],
    "another format": lambda raw: b"twistwrench code 0\n" + raw[len(cache.MAGIC) :],
    "something appended": lambda raw: raw + b"\0",
    "noise": lambda raw: np.random.default_rng(0).bytes(len(raw)),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_entry_is_rebuilt(place, damage):
    compiled(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    sound = entry.read_bytes()
    entry.write_bytes(DAMAGE[damage](sound))
    assert not compiled(PROGRAM, DOUBLE).cached
    assert works()
    assert list(place.iterdir()) == [entry]
    assert entry.read_bytes() == sound
    assert compiled(PROGRAM, DOUBLE).cached


def test_an_entry_under_another_s_name_is_rebuilt(place):
    compiled(PROGRAM, DOUBLE)
    (first,) = place.iterdir()
    compiled(OTHER, DOUBLE)
    (second,) = set(place.iterdir()) - {first}
    second.write_bytes(first.read_bytes())
    assert not compiled(OTHER, DOUBLE).cached
    assert works(OTHER)


def test_sound_entries_that_do_not_link_are_rebuilt(place):
    compiled(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    cache.store(entry.name, b"no object file")
    assert not compiled(PROGRAM, DOUBLE).cached
    assert works()


# ── folders not to be trusted, not to be written ──


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="a folder's owner and group are POSIX's")
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o720])
def test_a_folder_others_can_write_to_is_neither_read_nor_written(place, mode):
    compiled(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    before = entry.stat()
    place.chmod(mode)
    assert cache.folder() is None
    assert cache.load(entry.name) is None
    assert not compiled(PROGRAM, DOUBLE).cached
    compiled(OTHER, DOUBLE)
    assert list(place.iterdir()) == [entry]
    assert entry.stat().st_mtime_ns == before.st_mtime_ns
    place.chmod(0o700)
    assert compiled(PROGRAM, DOUBLE).cached


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="a folder's owner is POSIX's")
def test_a_folder_of_another_user_is_not_used(place, monkeypatch):
    compiled(PROGRAM, DOUBLE)
    monkeypatch.setattr(os, "getuid", lambda: place.stat().st_uid + 1)
    assert cache.folder() is None
    assert not compiled(PROGRAM, DOUBLE).cached


def test_a_cache_that_cannot_be_made_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert cache.folder() is None
    assert works()
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(tmp_path / "file"))
    assert works()
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.parametrize("call", ["mkstemp", "fdopen"])
def test_a_cache_that_cannot_be_written_is_no_error(place, monkeypatch, call):
    def refuse(*args, **options):
        if call == "fdopen":
            os.close(args[0])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache.tempfile if call == "mkstemp" else cache.os, call, refuse)
    assert works()
    assert list(place.iterdir()) == []


# ── side by side ──


def test_a_reader_never_sees_half_an_entry(place):
    values = [bytes([k]) * 1_000_000 for k in range(2)]
    cache.store("key", values[0])
    stop, wrong, reads = threading.Event(), [], []

    def read():
        while not stop.is_set():
            found = cache.load("key")
            reads.append(found is not None)
            if found not in values:
                wrong.append(found)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    for k in range(60):
        cache.store("key", values[k % 2])
    stop.set()
    for reader in readers:
        reader.join()
    assert not wrong
    assert reads
    assert [entry.name for entry in place.iterdir()] == ["key"]  # and no temporary files stay


def test_the_oldest_entries_go_when_there_are_too_many(place, monkeypatch):
    monkeypatch.setattr(cache, "MOST_ENTRIES", 8)
    for k in range(30):
        cache.store(f"key{k}", b"code")
        os.utime(place / f"key{k}", (k, k))
    left = {entry.name for entry in place.iterdir()}
    assert len(left) <= 8
    assert {"key29", "key28", "key27", "key26"} <= left


# ── without the compiler ──


def test_without_the_compiler_everything_runs_on_numpy(monkeypatch):
    by_machine, names = tw.robots.planar_2r(), []
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    by_numpy = tw.robots.planar_2r()
    rng = np.random.default_rng(2)
    for name, quantity in tw.quantities.QUANTITIES.items():
        if {"constraints", "rows"} & {*quantity.options}:  # closed robots, and tasks that a planar arm cannot do
            continue
        monkeypatch.setenv("TWISTWRENCH_JIT", "1")
        compiled_kernel = by_machine.kernel(name)
        monkeypatch.setenv("TWISTWRENCH_JIT", "0")
        kernel = by_numpy.kernel(name)
        assert isinstance(kernel, NumpyKernel)
        assert (kernel.signature, kernel.nin, kernel.nout) == (
            compiled_kernel.signature, compiled_kernel.nin, compiled_kernel.nout,
        )  # fmt: skip
        arrays = [rng.normal(size=(5, *port.shape)) for port in by_numpy.program(name).inputs]
        # Some hundred operations on numbers up to about 100, the mass matrix's condition number below 1000 included.
        pairs = zip(
            *(x if isinstance(x, tuple) else (x,) for x in (kernel(*arrays), compiled_kernel(*arrays))), strict=True
        )
        assert all(np.allclose(a, b, rtol=1e-11, atol=1e-11) for a, b in pairs), name
        names.append(name)
    assert len(names) > 20


def test_without_the_compiler_llvm_is_not_needed():
    code = (
        "import sys; sys.modules['llvmlite'] = None; import twistwrench as tw; robot = tw.robots.cart_pole(); z = [0, 0]\n"
        "robot.forward_dynamics(z, z, z), robot.jacobian(z), robot.kinetic_energy([z, z], z), robot.momentum(z, z)\n"
        "robot.kinetic_energy(z, z), robot.potential_energy(z); print(robot.mass_matrix(z).shape)"
    )
    assert python(code, TWISTWRENCH_JIT="0") == "(2, 2)"
