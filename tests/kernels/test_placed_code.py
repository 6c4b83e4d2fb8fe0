"""Object code that is placed without LLVM does the same as what LLVM links, and all that is not plain is left to LLVM."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.lowering.lower import modules
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, chosen
from twistwrench.compiler.runtime import elf_loader, executable_memory, jit
from twistwrench.compiler.runtime.elf_loader import load_objects
from twistwrench.compiler.runtime.executable_memory import UnsupportedObject
from twistwrench.compiler.runtime.gufunc import make_ufunc, owner_of

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or not chosen().triple.startswith("x86_64"), reason="64-bit ELF for x86-64"
)
LINE = trace(lambda x: 3.0 * np.sin(x) + 0.5, [("x", ())], ["y"])
EM_AARCH64, WRITABLE, GOT = 183, 1, 9


def objects(program, precision=DOUBLE) -> list[bytes]:
    return [jit._object_code(text, chosen())[1] for text in modules(program, precision, chosen())]


@pytest.fixture(scope="module")
def line() -> bytes:
    (code,) = objects(LINE)
    return code


def by_llvm(monkeypatch, program):
    """The kernel as LLVM links it."""

    def refuse(_objects):
        raise UnsupportedObject

    with monkeypatch.context() as patch:
        patch.setattr(jit, "load_objects", refuse)
        kernel = make_ufunc(program, "linked", "")
        owner_of(kernel).address(SINGLE)
    assert not isinstance(owner_of(kernel).code["d"].keep, elf_loader.LoadedObject)
    return kernel


@pytest.mark.parametrize("char", "df")
@pytest.mark.parametrize(
    ("robot", "quantity"),
    [
        ("ur5", "inverse_dynamics"),
        ("panda", "forward_dynamics_derivatives"),  # in sections: several object files together
        ("quadruped", "mass_matrix"),
        ("cart_pole", "kinetic_energy"),
    ],
)
def test_bits_are_those_of_llvm_s_linker(monkeypatch, bundled, robot, quantity, char):
    program = bundled(robot).program(quantity)
    here, linked = make_ufunc(program, "placed", ""), by_llvm(monkeypatch, program)
    rng = np.random.default_rng(3)
    arrays = [rng.normal(size=(21, *port.shape)).astype(char) for port in program.inputs]
    arrays[0][3] *= 1e9  # sines of huge angles are the C library's
    found = here(*arrays), linked(*arrays)
    assert isinstance(owner_of(here).code["d"].keep, elf_loader.LoadedObject)
    assert all(
        np.array_equal(a, b, equal_nan=True)
        for a, b in zip(np.atleast_1d(found[0]), np.atleast_1d(found[1]), strict=True)
    )


def permissions(address: int) -> str | None:
    for row in Path("/proc/self/maps").read_text().splitlines():
        span, what, *_ = row.split()
        first, last = (int(x, 16) for x in span.split("-"))
        if first <= address < last:
            return what
    return None


def test_pages_are_run_and_not_written_and_go_with_the_code(line):
    code = load_objects([line])
    address = code["loop"]
    assert permissions(address) == "r-xp"
    del code
    assert permissions(address) in (None, "r--p", "rw-p")  # unmapped, or by now somebody else's


def section(code: bytes, number: int) -> int:
    """Where the header of a section stands."""
    return struct.unpack_from("<Q", code, 40)[0] + 64 * number


def sections(code: bytes) -> list[tuple[int, ...]]:
    return [
        struct.unpack_from("<IIQQQQIIQQ", code, section(code, k)) for k in range(struct.unpack_from("<H", code, 60)[0])
    ]


def changed(code: bytes, kind: str, at: int, value: int) -> bytes:
    made = bytearray(code)
    struct.pack_into(kind, made, at, value)
    return bytes(made)


def text_of(code: bytes) -> int:
    return next(k for k, s in enumerate(sections(code)) if s[1] == 1 and s[2] & 4 and s[5])


def relocations_of(code: bytes) -> int:
    return next(s[4] for s in sections(code) if s[1] == 4 and s[7] == text_of(code))


REFUSED = {
    "nothing": lambda code: b"",
    "no object file": lambda code: b"no object file" * 100,
    "the head alone": lambda code: code[:64],
    "another processor's": lambda code: changed(code, "<H", 18, EM_AARCH64),
    "an executable": lambda code: changed(code, "<H", 16, 2),
    "of 32 bits": lambda code: changed(code, "<B", 4, 1),
    "data that is written": lambda code: changed(
        code, "<Q", section(code, text_of(code)) + 8, sections(code)[text_of(code)][2] | WRITABLE
    ),
    "zeros without bytes": lambda code: changed(code, "<I", section(code, text_of(code)) + 4, 8),
    "a relocation of another kind": lambda code: changed(code, "<I", relocations_of(code) + 8, GOT),
    "a section beyond the end": lambda code: changed(code, "<Q", section(code, text_of(code)) + 24, len(code)),
    "a function nobody has": lambda code: code.replace(b"\0atan2\0", b"\0atanz\0").replace(b"\0sin\0", b"\0sxn\0"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_not_plain_is_refused(line, kind):
    code = REFUSED[kind](line)
    assert code != line
    with pytest.raises(UnsupportedObject):
        load_objects([code])


@pytest.mark.parametrize("where", [2**40, 2**64 - 64, -3], ids=["beyond the end", "before", "across the end"])
def test_relocations_outside_their_section_are_damage_that_llvm_must_not_see(line, where):
    place = where if where > 0 else sections(line)[text_of(line)][5] + where
    with pytest.raises(RuntimeError, match="outside its section"):
        load_objects([changed(line, "<Q", relocations_of(line), place)])


def test_no_cut_does_harm(line):
    for end in range(0, len(line), 97):
        with pytest.raises(UnsupportedObject):
            load_objects([line[:end]])


@pytest.mark.parametrize("why", ["code from such pages", "memory"])
def test_where_the_system_refuses_llvm_links(monkeypatch, why):
    """Systems that never run what was once written to; and no memory at all."""

    def no_memory(*args, **options):
        raise OSError(12, "Cannot allocate memory")

    if why == "memory":
        monkeypatch.setattr(executable_memory.mmap, "mmap", no_memory)
    else:
        monkeypatch.setattr(executable_memory, "_process", lambda: SimpleNamespace(mprotect=lambda *_: -1))
    kernel = make_ufunc(LINE, "line", "")
    assert not isinstance(owner_of(kernel).code["d"].keep, elf_loader.LoadedObject)
    assert kernel(0.5) == 3.0 * np.sin(0.5) + 0.5
