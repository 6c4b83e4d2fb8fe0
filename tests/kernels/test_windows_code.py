"""Kernels compiled for Windows, placed and called by its calling convention on this processor: bits are those of its own kernels."""

from __future__ import annotations

import ctypes
import struct
import sys

import numpy as np
import pytest

from twistwrench.kernels import jit, placed_code
from twistwrench.kernels.code_pages import CodePages
from twistwrench.kernels.object_file import Unplaced
from twistwrench.kernels.placed_code import placed
from twistwrench.kernels.ufunc import make_ufunc
from twistwrench.program.port import axes_of
from twistwrench.targets.call_way import loop_steps
from twistwrench.targets.compiler import LOOP
from twistwrench.targets.emitter_choice import modules
from twistwrench.targets.processor import DOUBLE, SINGLE, Machine, chosen

pytestmark = pytest.mark.skipif(
    sys.platform == "win32" or not chosen().triple.startswith("x86_64"), reason="x86-64, where Windows is not at home"
)
TRIPLE = "x86_64-pc-windows-msvc"
_BRIDGE = """
define void @bridge(ptr %loop, ptr %args, ptr %dims, ptr %steps) {
  call win64cc void %loop(ptr %args, ptr %dims, ptr %steps, ptr null)
  ret void
}
"""
_OUTSIDE = {
    "sin": "define win64cc double @sin_there(double %x) {\n %y = call double @sin(double %x)\n ret double %y\n}\ndeclare double @sin(double)\n",
    "cos": "define win64cc double @cos_there(double %x) {\n %y = call double @cos(double %x)\n ret double %y\n}\ndeclare double @cos(double)\n",
    "atan2": "define win64cc double @atan2_there(double %y, double %x) {\n %z = call double @atan2(double %y, double %x)\n"
    " ret double %z\n}\ndeclare double @atan2(double, double)\n",
    "memcpy": "define win64cc ptr @memcpy_there(ptr %a, ptr %b, i64 %n) {\n %z = call ptr @memcpy(ptr %a, ptr %b, i64 %n)\n"
    " ret ptr %z\n}\ndeclare ptr @memcpy(ptr, ptr, i64)\n",
    "memset": "define win64cc ptr @memset_there(ptr %a, i32 %b, i64 %n) {\n %z = call ptr @memset(ptr %a, i32 %b, i64 %n)\n"
    " ret ptr %z\n}\ndeclare ptr @memset(ptr, i32, i64)\n",
    # grows the stack by touching its pages, and keeps all registers; the stack here grows by itself
    "__chkstk": 'define void @__chkstk_there() naked {\n call void asm sideeffect "ret", ""()\n unreachable\n}\n',
}
"""Functions of the C library as code of Windows calls them."""


def windows() -> Machine:
    here = chosen()
    return Machine(TRIPLE, here.cpu, here.features, here.vector_bits, here.fused)


def objects(program, precision=DOUBLE) -> list[bytes]:
    return [jit._object(text, windows())[1] for text in modules(program, precision, windows())]


@pytest.fixture
def library(monkeypatch) -> dict[str, jit.Code]:
    """Functions of the C library by the other convention; what is placed calls them."""
    kept = {name: jit.assembled(text, f"{name}_there", chosen()) for name, text in _OUTSIDE.items()}

    def address(name: str) -> int:
        if name not in kept:
            raise Unplaced
        return kept[name].address

    monkeypatch.setattr(placed_code, "_library_function", address)
    return kept


def called(code, program, precision, arrays) -> list[np.ndarray]:
    """The results of a loop of Windows on contiguous rows."""
    rows = len(arrays[0])
    made = [np.empty((rows, *port.shape), precision.char) for port in program.outputs]
    operands = [np.ascontiguousarray(a, precision.char) for a in arrays] + made
    args = (ctypes.c_void_p * len(operands))(*(a.ctypes.data for a in operands))
    steps = (ctypes.c_int64 * 64)(*loop_steps((*program.inputs, *program.outputs), precision))
    ports = (*program.inputs, *program.outputs)
    sizes = {
        axis: n
        for port, axes in zip(ports, axes_of(program.signature), strict=True)
        for axis, n in zip(axes, port.shape, strict=True)
    }
    dims = (ctypes.c_int64 * (1 + len(sizes)))(rows, *(sizes[k] for k in sorted(sizes)))
    bridge = jit.assembled(_BRIDGE, "bridge", chosen())
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(bridge.address)(code[LOOP], args, dims, steps)
    return made


@pytest.mark.parametrize("precision", [DOUBLE, SINGLE], ids=["float64", "float32"])
@pytest.mark.parametrize(
    ("robot", "quantity"),
    [
        ("ur5", "inverse_dynamics"),
        ("panda", "forward_dynamics_derivatives"),  # in sections: several object files, and frames of many pages
        ("quadruped", "mass_matrix"),
        ("cart_pole", "kinetic_energy"),
    ],
)
def test_bits_by_the_convention_of_windows_are_those_of_this_system(library, bundled, robot, quantity, precision):
    program = bundled(robot).program(quantity)
    rng = np.random.default_rng(5)
    arrays = [rng.normal(size=(21, *port.shape)).astype(precision.char) for port in program.inputs]
    arrays[0][3] *= 1e9  # sines of huge angles are the C library's
    expected = make_ufunc(program, "here", "")(*arrays)
    found = called(placed(objects(program, precision)), program, precision, arrays)
    for a, b in zip(expected if isinstance(expected, tuple) else (expected,), found, strict=True):
        assert np.array_equal(a, b, equal_nan=True)


def header(code: bytes, number: int) -> int:
    return 20 + 40 * number


def number_of(code: bytes, name: bytes) -> int:
    return next(
        k for k in range(struct.unpack_from("<H", code, 2)[0]) if code[header(code, k) :][:8].rstrip(b"\0") == name
    )


def changed(code: bytes, kind: str, at: int, value: int) -> bytes:
    made = bytearray(code)
    struct.pack_into(kind, made, at, value)
    return bytes(made)


def flags(code: bytes, more: int) -> bytes:
    at = header(code, number_of(code, b".text")) + 36
    return changed(code, "<I", at, struct.unpack_from("<I", code, at)[0] | more)


def first_relocation(code: bytes) -> int:
    return struct.unpack_from("<I", code, header(code, number_of(code, b".text")) + 24)[0]


REFUSED = {
    "another processor's": lambda code: changed(code, "<H", 0, 0xAA64),
    "an executable": lambda code: changed(code, "<H", 16, 240),
    "data that is written": lambda code: flags(code, 0x80000000),
    "zeros without bytes": lambda code: flags(code, 0x80),
    "a relocation of another kind": lambda code: changed(code, "<H", first_relocation(code) + 8, 3),
    "a section beyond the end": lambda code: changed(
        code, "<I", header(code, number_of(code, b".text")) + 20, len(code)
    ),
    "a symbol beyond the end": lambda code: changed(code, "<I", first_relocation(code) + 4, 2**31),
    "a place beyond the section": lambda code: changed(code, "<I", first_relocation(code), 2**31),
    "a function nobody has": lambda code: (
        code.replace(b"atan2\0", b"atanz\0").replace(b"sin\0", b"sxn\0").replace(b"cos\0", b"cxs\0")
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_not_plain_is_refused(library, bundled, kind):
    (code,) = objects(bundled("cart_pole").program("mass_matrix"))
    other = REFUSED[kind](code)
    assert other != code
    placed([code])
    with pytest.raises(Unplaced):
        placed([other])


def test_no_cut_does_harm(library, bundled):
    (code,) = objects(bundled("cart_pole").program("mass_matrix"))
    symbols, count = struct.unpack_from("<II", code, 8)
    for end in range(0, symbols + 18 * count, 97):
        with pytest.raises(Unplaced):
            placed([code[:end]])


def test_more_relocations_than_a_header_can_count(library, bundled):
    """The count stands in the first of them; here the header of a short table is made to say so."""
    program = bundled("ur5").program("inverse_dynamics")
    (code,) = objects(program)
    at = header(code, number_of(code, b".text"))
    first, count = struct.unpack_from("<I", code, at + 24)[0], struct.unpack_from("<H", code, at + 32)[0]
    rows = code[first : first + 10 * count]
    longer = bytearray(code) + struct.pack("<IIH", count + 1, 0, 0) + rows
    struct.pack_into("<I", longer, at + 24, len(code))
    struct.pack_into("<H", longer, at + 32, 0xFFFF)
    struct.pack_into("<I", longer, at + 36, struct.unpack_from("<I", code, at + 36)[0] | 0x1000000)
    assert np.array_equal(
        placed_code.linked([placed_code._read(bytes(longer))])[0], placed_code.linked([placed_code._read(code)])[0]
    )


def test_distances_count_from_the_end_of_the_instruction(library, bundled):
    """IMAGE_REL_AMD64_REL32_1 to _5 say how many bytes of it follow: the distance is less by as many."""
    (code,) = objects(bundled("cart_pole").program("mass_matrix"))
    at = first_relocation(code)
    place = struct.unpack_from("<I", code, at)[0]  # the first section of the file is the first of the image
    (image, _), *others = (
        placed_code.linked([placed_code._read(changed(code, "<H", at + 8, kind))]) for kind in range(4, 10)
    )
    assert number_of(code, b".text") == 0
    distance = image[place : place + 4].view("<i4")
    for further, (other, _) in enumerate(others, start=1):
        assert other[place : place + 4].view("<i4") == distance - further


def test_pages_go_with_their_object():
    pages = CodePages.of(np.full(100, 0xC3, np.uint8))
    assert ctypes.string_at(pages.address, 100) == b"\xc3" * 100
