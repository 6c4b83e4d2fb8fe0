"""Kernels for 64-bit ARM, run under emulation and compared with this processor's to the bit: `make emulate`.

Each is compiled by LLVM for ARM (NEON: two doubles or four floats side by side), linked to a driver in C by a cross compiler,
and run by QEMU on rows whose results the compiled ufunc of this machine gives too. Wants Debian's packages `qemu-user` and
`gcc-aarch64-linux-gnu` with `libc6-dev-arm64-cross`.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

import twistwrench as tw
from twistwrench.kernels.ufunc import owner_of
from twistwrench.program.forms import Form
from twistwrench.robot.quantity_row import CONFIGURATIONS
from twistwrench.targets.call_way import loop_steps
from twistwrench.targets.emitter_choice import modules
from twistwrench.targets.llvm import LOOP
from twistwrench.targets.processor import DOUBLE, SINGLE, Machine, Precision

ARM = Machine("aarch64-unknown-linux-gnu", "generic", "", 128)
COMPILER, EMULATOR = "aarch64-linux-gnu-gcc", "qemu-aarch64"
DRIVER = Path(__file__).with_suffix(".c")
ROBOTS = ("ur5", "panda", "quadruped")
QUANTITIES = (
    "inverse_dynamics", "mass_matrix", "forward_dynamics", "gravity_forces", "jacobian", "forward_kinematics",
    "inverse_dynamics_derivatives", "forward_dynamics_derivatives", "kinetic_energy",
)  # fmt: skip
ROWS = (1, 2, 3, 7, 64)
"""One lane, whole vectors, and those that are filled up."""


def main() -> None:
    if missing := [name for name in (COMPILER, EMULATOR) if shutil.which(name) is None]:
        raise SystemExit(
            f"{' and '.join(missing)} is not installed: apt-get install qemu-user gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
        )
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    differ = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in ROBOTS:
            robot = getattr(tw.robots, name)()
            for quantity in QUANTITIES:
                options = (
                    {"frame": "FL_foot"}
                    if name == "quadruped" and quantity in ("jacobian", "forward_kinematics")
                    else {}
                )
                for precision in (DOUBLE, SINGLE):
                    said = compare(robot, quantity, options, precision, Path(folder))
                    differ += said != "to the bit"
                    print(f"{name:10} {quantity:30} {precision.llvm:7} {said}", flush=True)
    print(f"emulated on {ARM.triple}: {differ} of {2 * len(ROBOTS) * len(QUANTITIES)} kernels differ")
    sys.exit(bool(differ))


def compare(robot: tw.Robot, quantity: str, options: dict[str, Any], precision: Precision, folder: Path) -> str:
    """Whether ARM's results are this machine's, and else by how much they are off."""
    kernel = robot.kernel(quantity, **options)
    form = owner_of(kernel).given  # what was compiled here: the program, with its loop if it has one
    binary = built(form, precision, folder)
    worst = 0.0
    for rows in ROWS:
        given = states(robot, form, precision, rows)
        done = subprocess.run(
            [EMULATOR, binary, str(rows)], input=b"".join(map(bytes, given)), capture_output=True, check=True
        )
        flat, expected = np.frombuffer(done.stdout, precision.char), kernel(*given)
        for ours in expected if isinstance(expected, tuple) else (expected,):
            theirs, flat = flat[: ours.size].reshape(ours.shape), flat[ours.size :]
            if not np.array_equal(theirs, ours, equal_nan=True):
                worst = max(worst, float(np.abs(theirs - ours).max() / np.abs(ours).max()))
    return f"off by {worst:.1e} of the largest entry" if worst else "to the bit"


def built(form: Form, precision: Precision, folder: Path) -> Path:
    """The kernel and its driver as one program for ARM."""
    target = llvm.Target.from_triple(ARM.triple).create_target_machine(
        cpu=ARM.cpu, features=ARM.features, opt=2, reloc="pic", codemodel="small"
    )
    objects = []
    for k, text in enumerate(modules(form, precision, ARM)):
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
    binary = folder / "kernel"
    flags = [f"-D{name}={value}" for name, value in defined.items()]
    subprocess.run([COMPILER, "-static", "-O1", "-Wall", *flags, DRIVER, *objects, "-lm", "-o", binary], check=True)
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
