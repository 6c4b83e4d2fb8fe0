"""The disk cache: code found again, and nothing wrong ever run. And the way around the compiler, TWISTWRENCH_JIT=0."""

from __future__ import annotations

import hashlib
import os
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel
from twistwrench.compiler.lowering.target_machine import DOUBLE, LOOP, SINGLE, chosen
from twistwrench.compiler.runtime.gufunc import make_ufunc
from twistwrench.compiler.runtime.jit import cached_code, compile_form
from twistwrench.core import object_cache
from twistwrench.robot.quantities import QUANTITIES

PROGRAM = trace(lambda x: 3.0 * x + 0.5, [("x", ())], ["y"])
OTHER = trace(lambda x: 7.0 * x - 0.5, [("x", ())], ["y"])


POSIX = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners and modes are POSIX's")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A cache folder of the test's own, not made yet; nothing was said of it either.

    LLVM is loaded, so what it says of the processor is not kept there.
    """
    pytest.importorskip("llvmlite.binding")
    folder = tmp_path / "chosen" / "cache"
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(folder))
    monkeypatch.setattr(object_cache, "_WARNINGS_GIVEN", set())
    return folder


@contextmanager
def one_remark(*words: str) -> Iterator[None]:
    """Exactly one warning, of one line that has all the words and says which variable to set."""
    with pytest.warns(tw.CacheWarning) as remarks:
        yield
    (remark,) = remarks
    text = str(remark.message)
    assert all(word in text for word in (*words, "TWISTWRENCH_CACHE_DIR")), text
    assert text.startswith("Compiled code is not kept: ")
    assert "\n" not in text


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
    assert not compile_form(PROGRAM, DOUBLE).cached
    assert compile_form(PROGRAM, DOUBLE).cached
    assert not compile_form(PROGRAM, SINGLE).cached  # each precision is code of its own
    assert not compile_form(OTHER, DOUBLE).cached
    assert len(list(place.iterdir())) == 3
    assert works()
    assert works(OTHER)


def test_code_of_another_compiler_or_processor_is_not_taken(place, monkeypatch):
    """Another llvmlite, another LLVM, another processor or other features of it: each has entries of its own."""
    import llvmlite
    import llvmlite.binding as llvm

    assert not compile_form(PROGRAM, DOUBLE).cached
    for owner, name, other in (
        (llvmlite, "__version__", "0.0.1"),
        (llvm, "llvm_version_info", (1, 2, 3)),
    ):
        with monkeypatch.context() as changed:
            changed.setattr(owner, name, other)
            assert not compile_form(PROGRAM, DOUBLE).cached, name
            assert compile_form(PROGRAM, DOUBLE).cached, name
        assert compile_form(PROGRAM, DOUBLE).cached, "back to the first"
    here = chosen()
    for other in (replace(here, cpu="generic"), replace(here, features=",".join(here.features.split(",")[1:]))):
        assert not compile_form(PROGRAM, DOUBLE, other).cached, other  # of the same text, but other instructions
        assert compile_form(PROGRAM, DOUBLE, other).cached, other
    assert compile_form(PROGRAM, DOUBLE).cached, "back to the first"


def test_the_second_process_compiles_nothing(place):
    code = (
        "import twistwrench as tw; from twistwrench.compiler.runtime import gufunc, jit; made = []\n"
        "def spy(*a): made.append(jit.compile_form(*a)); return made[-1]\n"
        "gufunc.compile_form = spy\n"
        "robot = tw.load(tw.robots.path_of('cart_pole').read_text())\n"  # as text: files are known again, and nothing is asked for
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
        assert object_cache.folder() is None
        assert not compile_form(PROGRAM, DOUBLE).cached
        assert not compile_form(PROGRAM, DOUBLE).cached
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the user's cache folder is XDG_CACHE_HOME on Linux")
def test_by_default_it_is_the_user_s_cache_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("TWISTWRENCH_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert object_cache.folder() == tmp_path / "twistwrench" / "kernels"


# ── damage ──

HEAD = len(object_cache.MAGIC)
CUTS = [0, 1, HEAD - 1, HEAD, HEAD + 1, HEAD + 31, HEAD + 32, HEAD + 33, HEAD + 32 + 512]
"""Lengths that end before, in and behind each part of an entry."""

DAMAGE = {
    **{f"cut to {n} bytes": (lambda raw, n=n: raw[:n]) for n in CUTS},
    "cut by half": lambda raw: raw[: len(raw) // 2],
    "cut to whole blocks of a disk": lambda raw: raw[: len(raw) // 512 * 512],
    "zeros behind the cut": lambda raw: raw[: len(raw) // 2] + bytes(len(raw) - len(raw) // 2),
    "one byte short": lambda raw: raw[:-1],
    "one bit of the digest turned": lambda raw: raw[:HEAD] + bytes([raw[HEAD] ^ 1]) + raw[HEAD + 1 :],
    "another's digest": lambda raw: raw[:HEAD] + bytes(32) + raw[HEAD + 32 :],
    "all zeros": lambda raw: bytes(len(raw)),
    "one bit turned": lambda raw: raw[:-100] + bytes([raw[-100] ^ 1]) + raw[-99:],
    "another format": lambda raw: b"twistwrench code 0\n" + raw[len(object_cache.MAGIC) :],
    "something appended": lambda raw: raw + b"\0",
    "noise": lambda raw: np.random.default_rng(0).bytes(len(raw)),
}


@pytest.mark.parametrize("damage", mostly_slow(DAMAGE, 2))
def test_a_damaged_entry_is_rebuilt(place, damage):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    sound = entry.read_bytes()
    damaged = DAMAGE[damage](sound)
    assert damaged != sound
    entry.write_bytes(damaged)
    assert not compile_form(PROGRAM, DOUBLE).cached
    assert works()
    assert list(place.iterdir()) == [entry]
    assert entry.read_bytes() == sound
    assert compile_form(PROGRAM, DOUBLE).cached


def test_an_entry_under_another_s_name_is_rebuilt(place):
    compile_form(PROGRAM, DOUBLE)
    (first,) = place.iterdir()
    compile_form(OTHER, DOUBLE)
    (second,) = set(place.iterdir()) - {first}
    second.write_bytes(first.read_bytes())
    assert not compile_form(OTHER, DOUBLE).cached
    assert works(OTHER)


FORGED = {
    "no object file": lambda _: b"no object file",
    "another function": lambda code: code.replace(LOOP.encode(), b"x" * len(LOOP)),
    "a name that is no text": lambda code: code.replace(LOOP.encode(), b"\xff" * len(LOOP)),
    "names that are no text, in a file for LLVM's linker": lambda code: (
        b"\x7fELF\x02\x01" + code[6:].replace(b"\0", b"\xff", 40)
    ),
}


@pytest.mark.parametrize("forge", FORGED)
def test_sound_entries_that_do_not_link_are_rebuilt(place, forge):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    object_cache.store(entry.name, FORGED[forge](object_cache.load(entry.name)))
    assert cached_code([entry.name], chosen()) is None
    assert not compile_form(PROGRAM, DOUBLE).cached
    assert works()


def test_sound_metadata_that_say_nothing_are_made_again(place):
    for said in (b"\xff\xfe", b"()", b"1 +"):
        robot = tw.robots.cart_pole()
        expected = robot.mass_matrix(np.array([0.1, 0.2]))
        for entry in place.iterdir():
            if object_cache.load(entry.name)[:1] == b"(":
                object_cache.store(entry.name, said)
        assert np.array_equal(tw.robots.cart_pole().mass_matrix(np.array([0.1, 0.2])), expected)


# ── folders not to be trusted, not to be written ──


@POSIX
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o720])
def test_a_folder_others_can_write_to_is_neither_read_nor_written(place, mode):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    before = entry.stat()
    place.chmod(mode)
    with one_remark(str(place), f"(mode {mode:o})", "chmod go-w"):
        assert object_cache.folder() is None
    assert object_cache.load(entry.name) is None  # and nothing is said again
    assert not compile_form(PROGRAM, DOUBLE).cached
    compile_form(OTHER, DOUBLE)
    assert list(place.iterdir()) == [entry]
    assert entry.stat().st_mtime_ns == before.st_mtime_ns
    place.chmod(0o700)
    assert compile_form(PROGRAM, DOUBLE).cached


@POSIX
def test_a_folder_of_another_user_is_not_used(place, monkeypatch):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    before, owner = entry.stat(), place.stat().st_uid
    monkeypatch.setattr(os, "getuid", lambda: owner + 1)
    with one_remark(str(place), f"belongs to another user (uid {owner})"):
        assert not compile_form(PROGRAM, DOUBLE).cached
    assert works(OTHER)
    assert list(place.iterdir()) == [entry]
    assert entry.stat().st_mtime_ns == before.st_mtime_ns


@POSIX
@pytest.mark.skipif(hasattr(os, "getuid") and os.getuid() != 0, reason="only root may give a folder away")
def test_a_folder_given_away_is_not_used(place):
    place.mkdir(mode=0o700, parents=True)
    os.chown(place, 12345, -1)
    with one_remark("uid 12345"):
        assert works()
    assert list(place.iterdir()) == []


@POSIX
def test_a_link_is_as_good_as_the_folder_it_leads_to(place, tmp_path):
    real = tmp_path / "scratch"
    real.mkdir(mode=0o700)
    place.parent.mkdir()
    place.symlink_to(real)
    assert not compile_form(PROGRAM, DOUBLE).cached
    assert compile_form(PROGRAM, DOUBLE).cached
    assert len(list(real.iterdir())) == 1
    real.chmod(0o777)
    with one_remark("mode 777"):
        assert not compile_form(PROGRAM, DOUBLE).cached
    place.unlink()
    place.symlink_to(tmp_path / "nowhere")
    with one_remark("not a folder"):
        assert not compile_form(PROGRAM, DOUBLE).cached
    assert not (tmp_path / "nowhere").exists()


def test_a_home_is_understood(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", os.path.join("~", "kernels"))
    assert works()
    assert len(list((tmp_path / "home" / "kernels").iterdir())) == 1
    assert not (tmp_path / "~").exists()
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "~nobody-of-that-name/kernels")
    with one_remark("'~nobody-of-that-name/kernels'"):
        assert works(OTHER)


def test_a_cache_that_cannot_be_made_is_no_error(place, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    for name in (tmp_path / "file" / "cache", tmp_path / "file", tmp_path / ("x" * 300)):
        monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(name))
        with one_remark(f"{str(name)!r}, which is not a folder"):
            assert works()
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the user's cache folder is XDG_CACHE_HOME on Linux")
def test_a_home_that_cannot_be_written_to_is_nobody_s_mistake(place, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no home")
    monkeypatch.delenv("TWISTWRENCH_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert works()  # warnings are errors here


@pytest.mark.parametrize("call", ["mkstemp", "fdopen", "write", "close", "replace"])
def test_a_disk_that_is_full_is_no_error(place, monkeypatch, call):
    """Whichever step of writing an entry fails, the code is there, and no piece of a file is left."""
    full = OSError(28, "No space left on device")

    def refuse(*args, **options):
        raise full

    class Full:
        """A file that takes half of what it is given."""

        def __init__(self, file):
            self.file = file

        def __enter__(self):
            return self

        def __exit__(self, *about):
            self.file.close()
            if call == "close":
                raise full

        def write(self, data):
            self.file.write(data if call == "close" else data[: len(data) // 2])
            if call == "write":
                raise full

    opened = os.fdopen
    if call == "mkstemp":
        monkeypatch.setattr(tempfile, "mkstemp", refuse)
    elif call == "fdopen":
        monkeypatch.setattr(object_cache.os, "fdopen", lambda handle, mode: (os.close(handle), refuse()))
    elif call == "replace":
        monkeypatch.setattr(object_cache.Path, "replace", refuse)
    else:
        monkeypatch.setattr(object_cache.os, "fdopen", lambda handle, mode: Full(opened(handle, mode)))
    with one_remark(str(place), "No space left on device"):
        assert works()
    assert works(OTHER)
    assert list(place.iterdir()) == []
    monkeypatch.undo()


def test_an_interrupt_while_writing_leaves_nothing_behind(place, monkeypatch):
    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(object_cache.Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        works()
    assert list(place.iterdir()) == []


FULL = """
import resource, sys
import numpy as np, twistwrench as tw
robot = tw.robots.planar_2r()
robot.mass_matrix([0.0, 0.5])
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # a file cannot grow beyond: its write fails midway
print(np.allclose(robot.gravity_forces([0.0, 0.5]), robot.reference("gravity_forces", [0.0, 0.5])))
"""


@POSIX
def test_a_file_that_may_not_grow_leaves_nothing_behind(place):
    """No stand-ins: the kernel of the system cuts the file short."""
    done = subprocess.run(
        [sys.executable, "-c", FULL],
        env={**os.environ, "TWISTWRENCH_CACHE_DIR": str(place)}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout == "True\n", done.stderr
    assert len(done.stderr.splitlines()) == 2  # the warning, and the line it comes from
    assert "File too large" in done.stderr
    entries = list(place.iterdir())  # of the mass matrix, and what LLVM says of the processor
    assert len([entry for entry in entries if entry.stat().st_size > 1500]) == 1
    assert not any(entry.name.startswith(".new-") for entry in entries)


@POSIX
@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_an_entry_others_can_write_to_is_not_run(place, mode):
    """Code is executed from here, so that it belongs to this user is not enough."""
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    assert object_cache.load(entry.name) is not None
    entry.chmod(mode)
    assert object_cache.load(entry.name) is None


@POSIX
def test_an_entry_of_another_user_is_not_run(place, monkeypatch):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    owner = os.getuid()
    monkeypatch.setattr(object_cache, "folder", lambda: place)  # which is this user's
    monkeypatch.setattr(os, "getuid", lambda: owner + 1)
    assert object_cache.load(entry.name) is None


@POSIX
@pytest.mark.skipif(hasattr(os, "getuid") and os.getuid() == 0, reason="root writes wherever it likes")
def test_a_folder_that_is_read_only_is_read(place):
    compile_form(PROGRAM, DOUBLE)
    place.chmod(0o500)
    try:
        assert compile_form(PROGRAM, DOUBLE).cached
        with one_remark("Permission denied"):
            assert works(OTHER)
    finally:
        place.chmod(0o700)


@pytest.mark.parametrize("call", ["read_bytes", "unlink"])
def test_an_entry_that_cannot_be_read_or_removed_is_no_error(place, monkeypatch, call):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    entry.write_bytes(b"damaged")

    def refuse(*args, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(object_cache.Path, call, refuse)
    assert works()


def test_a_folder_in_an_entry_s_place_is_no_error(place):
    compile_form(PROGRAM, DOUBLE)
    (entry,) = place.iterdir()
    entry.unlink()
    entry.mkdir()
    (entry / "something").touch()  # an empty one is cleared away
    with one_remark(str(place)):
        assert works()
    assert list(place.iterdir()) == [entry]


# ── side by side ──


@POSIX
@pytest.mark.parametrize("kind", ["pipe", "link to a device", "link to nothing", "empty folder", "huge"])
def test_what_stands_in_an_entry_s_place_is_cleared_away(place, kind, monkeypatch):
    """A pipe that nobody writes to would be waited for, a device read without end: each is refused unread, and rebuilt."""
    assert works()
    (entry,) = place.iterdir()
    entry.unlink()
    if kind == "pipe":
        os.mkfifo(entry)
    elif kind == "empty folder":
        entry.mkdir()
    elif kind == "huge":
        monkeypatch.setattr(object_cache, "MOST_BYTES", 1 << 16)
        with entry.open("wb") as file:
            file.truncate((1 << 16) + 1)
    else:
        entry.symlink_to("/dev/zero" if "device" in kind else place / "nowhere")
    with never_waiting():
        assert works()
    assert [p.name for p in place.iterdir()] == [entry.name]
    assert entry.is_file()
    assert not entry.is_symlink()
    assert entry.read_bytes().startswith(object_cache.MAGIC)


@contextmanager
def never_waiting(seconds: int = 60) -> Iterator[None]:
    """An alarm in place of a test that would hang; the time is not a claim."""

    def ring(*_):
        raise AssertionError("it waits")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def test_a_reader_never_sees_half_an_entry(place):
    values = [bytes([k]) * 1_000_000 for k in range(2)]
    object_cache.store("key", values[0])
    stop, wrong, reads = threading.Event(), [], []

    def read():
        while not stop.is_set():
            entry = object_cache.load("key")
            reads.append(entry is not None)
            if entry not in values:
                wrong.append(entry)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    for k in range(60):
        object_cache.store("key", values[k % 2])
    stop.set()
    for reader in readers:
        reader.join()
    assert not wrong
    assert reads
    assert [entry.name for entry in place.iterdir()] == ["key"]  # and no temporary files stay


def test_the_oldest_entries_go_when_there_are_too_many(place, monkeypatch):
    monkeypatch.setattr(object_cache, "MOST_ENTRIES", 8)
    keys = [hashlib.sha256(bytes([k])).hexdigest() for k in range(30)]
    for k, key in enumerate(keys):
        object_cache.store(key, b"code")
        os.utime(place / key, (k, k))
    left = {entry.name for entry in place.iterdir()}
    assert len(left) <= 8
    assert {*keys[-4:]} <= left


def test_entries_that_another_process_drops_meanwhile_are_no_fault(place, monkeypatch):
    """Two processes that drop the oldest entries at once; a warning is an error here."""
    monkeypatch.setattr(object_cache, "MOST_ENTRIES", 8)
    keys = [hashlib.sha256(bytes([k])).hexdigest() for k in range(12)]
    plain = Path.stat

    def vanished(self, **options):
        if self.name in keys[:3] and sys._getframe(1).f_code.co_name != "is_file":
            raise FileNotFoundError(self)  # it was there when the folder was listed
        return plain(self, **options)

    monkeypatch.setattr(Path, "stat", vanished)
    for key in keys:
        object_cache.store(key, b"code")
    assert keys[-1] in {entry.name for entry in place.iterdir()}


def test_files_of_others_in_the_folder_stay(place, monkeypatch):
    """Someone may have named a folder that is full of other things."""
    monkeypatch.setattr(object_cache, "MOST_ENTRIES", 4)
    place.mkdir(parents=True, mode=0o700)
    names = {f"thesis{k}.tex" for k in range(20)} | {"0" * 63, "0" * 65, "A" * 64, ".newer"}
    for name in names:
        (place / name).write_text("years of work")
        os.utime(place / name, (0, 0))
    for k in range(9):
        object_cache.store(hashlib.sha256(bytes([k])).hexdigest(), b"code")
    assert names <= {entry.name for entry in place.iterdir()}
    assert len(list(place.iterdir())) <= len(names) + 4


def test_what_a_killed_process_left_goes_in_time(place, monkeypatch):
    monkeypatch.setattr(object_cache, "MOST_ENTRIES", 8)
    place.mkdir(parents=True, mode=0o700)
    for k in range(8):
        (place / f".new-abc_{k}").write_bytes(b"half")
        os.utime(place / f".new-abc_{k}", (0, 0))
    for k in range(12):
        object_cache.store(hashlib.sha256(bytes([k])).hexdigest(), b"code")
    assert not [entry for entry in place.iterdir() if entry.name.startswith(".new-")]


# ── without the compiler ──


def test_without_the_compiler_everything_runs_on_numpy(monkeypatch):
    by_machine, names = tw.robots.planar_2r(), []
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    by_numpy = tw.robots.planar_2r()
    rng = np.random.default_rng(2)
    for name, quantity in QUANTITIES.items():
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


@pytest.mark.parametrize(
    ("said", "kernel"), [("off", "NumpyKernel"), (" 0 ", "NumpyKernel"), ("", "ufunc"), ("ON", "ufunc")]
)
def test_the_compiler_is_a_switch(said, kernel, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_JIT", said)
    assert type(tw.robots.pendulum().kernel("mass_matrix")).__name__ == kernel


def test_a_switch_that_is_neither_on_nor_off_is_refused(monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_JIT", "none")
    with pytest.raises(tw.ValueRangeError, match="TWISTWRENCH_JIT: 'none' is not understood"):
        tw.robots.pendulum().kernel("mass_matrix")
