"""The header and the source: what they say about the robot, and its functions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING

from ..core.printed_numbers import in_file
from ..joints.units import unit_of
from ..model.variable_parameters import nominal
from ..program.program import FUSED, Program
from ..robot.quantities import QUANTITIES
from ..targets.c import FUSED_MACROS, PRECISIONS, identifier
from .request import Request

if TYPE_CHECKING:
    from ..robot import Robot

_COUNTED = {
    "multiplications": ("mul",),
    "additions": ("add", "sub"),
    "fused multiply-adds": tuple(FUSED),
    "divisions": ("div",),
    "sines and cosines": ("sin", "cos"),
    "square roots": ("sqrt",),
    "exponentials": ("exp",),
    "minima and maxima": ("min", "max"),
}

_CONVENTIONS = """\
SI units, radians. The angular part comes first: twists are (omega, v), wrenches (m, f). A pose is a 4 x 4 matrix that maps
points of the frame to the base frame. Kinds of frame quantities: body, seen in the frame itself; space, at the origin of the
base; world_aligned, at the frame's origin along the axes of the base. A wrench input is what the robot applies to the world
at that frame, expressed in it. Joint friction is in no function that does not say so.
Arrays of several axes are stored row by row: entry (i, j) of an m x n matrix is element n i + j.
The functions allocate nothing, keep no state, do not branch, and call nothing but math.h. They read their inputs before they
write, so an output may be an input's array; two outputs must not overlap."""


def header(robot: Robot, requests: Sequence[Request], stem: str, prefix: str) -> str:
    """The .h file: conventions, the order of the joints, a prototype with its meaning and its cost for each function."""
    precision = requests[0].function.precision
    gx, gy, gz = map(in_file, robot.gravity)
    about = [
        f"Dynamics of the robot {robot.name} in C99, numbers of type {precision}.",
        f"Written by twistwrench {version('twistwrench')}.",
        "",
        *_CONVENTIONS.split("\n"),
        f"Gravity is ({gx}, {gy}, {gz}) m/s^2 in the base frame.",
        "",
        *_entries(robot),
    ]
    guard = f"{identifier(stem) or prefix}_H".upper()
    guard = guard if guard[0].isalpha() else f"H_{guard}"
    parts = [
        comment(about),
        f"#ifndef {guard}\n#define {guard}",
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        f"/* Entries of q, and of dq, ddq and tau. */\n"
        f"#define {prefix.upper()}_NQ {robot.nq}\n#define {prefix.upper()}_NV {robot.nv}",
        *(f"{comment(_about(robot, request))}\n{request.function.prototype};" for request in requests),
        f"#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {guard} */",
    ]
    return "\n\n".join(parts) + "\n"


def source(robot: Robot, requests: Sequence[Request], stem: str) -> str:
    """The .c file."""
    precision = requests[0].function.precision
    about = f"Dynamics of the robot {robot.name} in C99, one operation a line. {stem}.h says what is what."
    parts = [
        comment([about]),
        f'#include "{stem}.h"\n\n#include <math.h>',
        # GCC has -ffp-contract=off for the same.
        "#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif",
    ]
    if any(request.function.fuses for request in requests):
        parts.append(FUSED_MACROS.format(fma=f"fma{PRECISIONS[precision]}").rstrip())
    return "\n\n".join([*parts, *(request.function.definition for request in requests)]) + "\n"


def comment(lines: Sequence[str]) -> str:
    """A block comment; names from robot files can neither end it nor hide in it."""
    safe = "\n".join(lines).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
    plain = (
        "".join(c if c.isprintable() or c == "\n" else "?" for c in safe).encode("ascii", "backslashreplace").decode()
    )
    body = "\n".join(f" * {line}".rstrip() for line in plain.split("\n"))
    return f"/*\n{body}\n */"


def _entries(robot: Robot) -> Iterator[str]:
    """The entries of q and of dq, with their units."""
    yield "Entries of q:"
    names = robot.coordinate_names
    wide = max(map(len, names))
    units = [unit for b in robot.model.leaders for unit in b.joint.coordinate_units]
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        yield f"  {k:3}  {name:{wide}}  {unit}"
    yield "Entries of dq, ddq and tau (a joint of several: its twist in the frame of its child, angular part first):"
    k = 0
    for b in robot.model.leaders:
        for turns in b.joint.turning:
            said = ", ".join(unit_of(part, turns) for part in ("dq", "ddq", "tau")).replace("²", "^2")  # ASCII, as C is
            yield f"  {k:3}  {b.joint.name:{wide}}  {said}"
            k += 1
    if robot.model.quaternions:
        yield "A quaternion (qw, qx, qy, qz) may have any length but zero."


def _about(robot: Robot, request: Request) -> list[str]:
    """Comment of one function."""
    function, full = request.function, request.full
    program = function.program
    lines = [f"{request.quantity}: {QUANTITIES[request.quantity].meaning}."]
    if "frame" in full:
        lines.append(f"Frame: {full['frame']}.")
    if "kind" in full:
        lines.append(f"Kind: {full['kind']}.")
    if full.get("friction"):
        lines.append("With the friction of the joints.")
    if on_robot := full.get("on_robot"):
        lines.append(f"The world applies the wrenches at: {', '.join(on_robot)}.")
    if derivative := full.get("derivative"):
        lines.append(f"Not itself: its derivative ({derivative.form}) by {', '.join(derivative.by)}.")
    if constraints := full.get("constraints"):
        lines.append(f"Constraints: {', '.join(c.name for c in constraints)}.")
    shaped = [
        f"{name} {' x '.join(map(str, port.shape)) or '1'}"
        for name, port in zip(function.parameters, (*program.inputs, *program.outputs), strict=True)
    ]
    made = len(program.inputs)
    lines.append(f"In: {', '.join(shaped[:made])}. Out: {', '.join(shaped[made:])}.")
    lines.append(f"{_cost(program)}.")
    if names := full.get("parameters"):
        usual, wide = nominal(robot.model), max(map(len, names))
        lines.append("Entries of parameters, and the robot's own numbers:")
        lines += [f"  {k:3}  {name:{wide}}  {in_file(usual[name])}" for k, name in enumerate(names)]
    return lines


def _cost(program: Program) -> str:
    counts = program.counts()
    named = [(sum(counts.get(op, 0) for op in ops), label) for label, ops in _COUNTED.items()]
    return ", ".join(f"{n} {label}" for n, label in named if n) or "No operation"
