"""Kernels of other systems, run here and compared with this processor's to the bit: `make emulate`.

Each is compiled by LLVM for the other system, linked to a driver in C by a cross compiler, and run on rows whose results the
compiled ufunc of this machine gives too: 64-bit ARM (NEON: two doubles or four floats side by side) by QEMU, and Windows,
with its calling convention and this processor's own vectors, by Wine. What is not installed is left out, and said.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np

import twistwrench as tw
from twistwrench.compiler.ir.loops import Form
from twistwrench.compiler.lowering.lower import LOOP, modules
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, Machine, Precision, host
from twistwrench.compiler.runtime.dispatch_ir import loop_steps
from twistwrench.compiler.runtime.gufunc import owner_of
from twistwrench.robot.quantities import CONFIGURATIONS


class Emulation(NamedTuple):
    """Another system, and what makes and runs its programs here."""

    name: str
    machine: Machine
    compiler: str
    emulator: str
    flags: tuple[str, ...]
    packages: str

    def missing(self) -> list[str]:
        """The programs that are not installed."""
        return [name for name in (self.compiler, self.emulator) if shutil.which(name) is None]


EMULATIONS = (
    Emulation(
        "64-bit ARM", Machine("aarch64-unknown-linux-gnu", "generic", "", 128), "aarch64-linux-gnu-gcc", "qemu-aarch64", (),
        "qemu-user gcc-aarch64-linux-gnu libc6-dev-arm64-cross",
    ),
    Emulation(  # what Microsoft's linker and library bring, by their names in MinGW
        "Windows", Machine("x86_64-pc-windows-msvc-elf", host().cpu, host().features, host().vector_bits, host().fused),
        "x86_64-w64-mingw32-gcc", "wine", ("-Wl,--defsym,__chkstk=___chkstk_ms", "-Wl,--defsym,_fltused=0"),
        "gcc-mingw-w64-x86-64 wine wine64",
    ),
)  # fmt: skip
DRIVER = Path(__file__).with_suffix(".c")
ROBOTS = ("ur5", "panda", "quadruped")
QUANTITIES = (
    "inverse_dynamics", "mass_matrix", "forward_dynamics", "gravity_forces", "jacobian", "forward_kinematics",
    "inverse_dynamics_derivatives", "forward_dynamics_derivatives", "kinetic_energy",
)  # fmt: skip
ROWS = (1, 2, 3, 7, 64)
"""One lane, whole vectors, and those that are filled up."""


def main() -> None:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    ran = [emulation for emulation in EMULATIONS if serves(emulation)]
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"WINEPREFIX": f"{folder}/wine", "WINEDEBUG": "-all"}
        differ = [compare_all(emulation, Path(folder)) for emulation in ran]
    sys.exit(not ran or any(differ))


def serves(emulation: Emulation) -> bool:
    """Whether all is there; says so where not."""
    if lacking := emulation.missing():
        print(f"{emulation.name}: not run, {' and '.join(lacking)} not installed: apt-get install {emulation.packages}")
    elif emulation.name == "Windows" and not host().triple.startswith("x86_64"):
        print(f"{emulation.name}: not run, Wine emulates no processor, and this one is not an x86-64")
    else:
        return True
    return False


def compare_all(emulation: Emulation, folder: Path) -> int:
    """How many kernels differ from this machine's."""
    differ = 0
    for name in ROBOTS:
        robot = getattr(tw.robots, name)()
        for quantity in QUANTITIES:
            at_a_foot = name == "quadruped" and quantity in ("jacobian", "forward_kinematics")
            options = {"frame": "FL_foot"} if at_a_foot else {}
            for precision in (DOUBLE, SINGLE):
                said = compare(emulation, robot, quantity, options, precision, folder)
                differ += said != "to the bit"
                print(f"{name:10} {quantity:30} {precision.llvm:7} {said}", flush=True)
    print(
        f"{emulation.name} ({emulation.machine.triple}): {differ} of {2 * len(ROBOTS) * len(QUANTITIES)} kernels differ"
    )
    return differ


def compare(
    emulation: Emulation, robot: tw.Robot, quantity: str, options: dict[str, Any], precision: Precision, folder: Path
) -> str:
    """Whether the other system's results are this machine's, and else by how much they are off."""
    kernel = robot.kernel(quantity, **options)
    form = owner_of(kernel).form  # what was compiled here: the program, with its loop if it has one
    binary = built(emulation, form, precision, folder)
    worst = 0.0
    for rows in ROWS:
        given = states(robot, form, precision, rows)
        done = subprocess.run(
            [emulation.emulator, binary, str(rows)], input=b"".join(map(bytes, given)), capture_output=True, check=True
        )
        flat, expected = np.frombuffer(done.stdout, precision.char), kernel(*given)
        for ours in expected if isinstance(expected, tuple) else (expected,):
            theirs, flat = flat[: ours.size].reshape(ours.shape), flat[ours.size :]
            if not np.array_equal(theirs, ours, equal_nan=True):
                worst = max(worst, float(np.abs(theirs - ours).max() / np.abs(ours).max()))
    return f"off by {worst:.1e} of the largest entry" if worst else "to the bit"


def built(emulation: Emulation, form: Form, precision: Precision, folder: Path) -> Path:
    """The kernel and its driver as one program of the other system."""
    machine = emulation.machine
    target = llvm.Target.from_triple(machine.triple).create_target_machine(
        cpu=machine.cpu, features=machine.features, opt=2, reloc="pic", codemodel="small"
    )
    objects = []
    for k, text in enumerate(modules(form, precision, machine)):
        objects.append(folder / f"kernel{k}.o")
        objects[-1].write_bytes(target.emit_object(llvm.parse_assembly(text, llvm.create_context())))
    ports = (*form.inputs, *form.outputs)
    defined = {
        "KERNEL": LOOP,
        "REAL": precision.llvm,
        "INPUTS": len(form.inputs),
        "ARRAYS": len(ports),
        "SIZES": ",".join(str(port.size) for port in ports),
        "STEPS": ",".join(map(str, loop_steps(ports, precision))),
    }
    binary = folder / "kernel.exe"  # Wine wants the suffix
    flags = [f"-D{name}={value}" for name, value in defined.items()]
    own = ["-static", "-O1", "-Wall", *flags, *emulation.flags]
    subprocess.run([emulation.compiler, *own, DRIVER, *objects, "-lm", "-o", binary], check=True)
    return binary


def states(robot: tw.Robot, form: Form, precision: Precision, rows: int) -> list[np.ndarray]:
    """Random inputs of a kernel."""
    rng = np.random.default_rng(rows)
    return [
        np.ascontiguousarray(
            robot.random_configuration(rows + k, rows)
            if p.name in CONFIGURATIONS
            else rng.normal(size=(rows, *p.shape)),
            precision.char,
        )
        for k, p in enumerate(form.inputs)
    ]


if __name__ == "__main__":
    main()
