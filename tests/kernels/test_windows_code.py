"""Kernels compiled for Windows, placed and called by its calling convention on this processor: bits are those of its own kernels."""

from __future__ import annotations

import ctypes
import sys

import numpy as np
import pytest
from quick import mostly_slow

from twistwrench.compiler.ir.program import axes_of
from twistwrench.compiler.lowering import batch_loop
from twistwrench.compiler.lowering.lower import modules
from twistwrench.compiler.lowering.target_machine import DOUBLE, LOOP, SINGLE, Machine, chosen
from twistwrench.compiler.runtime import elf_loader, executable_memory, jit
from twistwrench.compiler.runtime.dispatch_ir import loop_steps
from twistwrench.compiler.runtime.elf_loader import load_objects
from twistwrench.compiler.runtime.executable_memory import ExecutableMemory, UnsupportedObject
from twistwrench.compiler.runtime.gufunc import make_ufunc

pytestmark = pytest.mark.skipif(
    sys.platform == "win32" or not chosen().triple.startswith("x86_64"), reason="x86-64, where Windows is not at home"
)
TRIPLE = "x86_64-pc-windows-msvc-elf"
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
    return [jit._object_code(text, windows())[1] for text in modules(program, precision, windows())]


@pytest.fixture
def library(monkeypatch) -> dict[str, jit.Code]:
    """Functions of the C library by the other convention; what is placed calls them."""
    kept = {name: jit.assemble(text, f"{name}_there", chosen()) for name, text in _OUTSIDE.items()}

    def address(name: str) -> int:
        if name not in kept:
            raise UnsupportedObject
        return kept[name].address

    monkeypatch.setattr(
        batch_loop, "ON_STACK", 100_000
    )  # frames on the stack, whose pages Windows has touched in order
    monkeypatch.setattr(elf_loader, "_library_function", address)
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
    bridge = jit.assemble(_BRIDGE, "bridge", chosen())
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(bridge.address)(code[LOOP], args, dims, steps)
    return made


@pytest.mark.parametrize("precision", [DOUBLE, SINGLE], ids=["float64", "float32"])
@pytest.mark.parametrize(
    ("robot", "quantity"),
    mostly_slow(
        [
            ("ur5", "inverse_dynamics"),
            ("panda", "forward_dynamics_derivatives"),  # in sections: several object files, and frames of many pages
            ("quadruped", "mass_matrix"),
            ("cart_pole", "kinetic_energy"),
        ],
        2,
    ),
)
def test_bits_by_the_convention_of_windows_are_those_of_this_system(library, bundled, robot, quantity, precision):
    program = bundled(robot).program(quantity)
    rng = np.random.default_rng(5)
    arrays = [rng.normal(size=(21, *port.shape)).astype(precision.char) for port in program.inputs]
    arrays[0][3] *= 1e9  # sines of huge angles are the C library's
    expected = make_ufunc(program, "here", "")(*arrays)
    found = called(load_objects(objects(program, precision)), program, precision, arrays)
    for a, b in zip(expected if isinstance(expected, tuple) else (expected,), found, strict=True):
        assert np.array_equal(a, b, equal_nan=True)


def test_pages_go_with_their_object():
    pages = ExecutableMemory.from_image(np.full(100, 0xC3, np.uint8))
    assert ctypes.string_at(pages.address, 100) == b"\xc3" * 100


class Kernel32:
    """What the system of Windows is asked for, with memory of this process."""

    def __init__(self):
        self.memory, self.asked = ctypes.create_string_buffer(4096), []

    def VirtualAlloc(self, *given):
        self.asked.append(("alloc", *given))
        return ctypes.addressof(self.memory)

    def VirtualProtect(self, address, size, protection, _before):
        self.asked.append(("protect", address, size, protection))
        return 1

    def VirtualFree(self, *given):
        self.asked.append(("free", *given))
        return 1


def test_windows_gives_pages_to_write_then_to_run_and_takes_them_back_whole(monkeypatch):
    """Numbers of winnt.h: MEM_COMMIT and MEM_RESERVE, PAGE_READWRITE, PAGE_EXECUTE_READ; MEM_RELEASE takes a size of 0."""
    system = Kernel32()
    monkeypatch.setattr(executable_memory.sys, "platform", "win32")
    monkeypatch.setattr(executable_memory, "_kernel32", lambda: system)
    pages = ExecutableMemory.from_image(np.full(100, 0xC3, np.uint8))
    at = pages.address
    assert (at, system.memory.raw[:101]) == (ctypes.addressof(system.memory), b"\xc3" * 100 + b"\0")
    del pages
    assert system.asked == [
        ("alloc", None, 100, 0x1000 | 0x2000, 0x04),
        ("protect", at, 100, 0x20),
        ("free", at, 0, 0x8000),
    ]
