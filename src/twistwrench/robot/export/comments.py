"""Comments of an export: the entries of q and dq with their units, and the meaning and cost of each function."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ...compiler.ir.program import FUSED, Program
from ...core.numbers import file_number
from ...mechanics.joints.units import unit_of
from ...mechanics.model.parameters import nominal
from ..quantities import QUANTITIES
from .request import Request

if TYPE_CHECKING:
    from .. import Robot

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


def comment(lines: Sequence[str]) -> str:
    """Block comment; names from robot files cannot end it or hide in it."""
    safe = "\n".join(lines).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
    printable = "".join(c if c.isprintable() or c == "\n" else "?" for c in safe)
    plain = printable.encode("ascii", "backslashreplace").decode()
    body = "\n".join(f" * {line}".rstrip() for line in plain.split("\n"))
    return f"/*\n{body}\n */"


def entries(robot: Robot) -> Iterator[str]:
    """Entries of q and dq, with their units."""
    yield "Entries of q:"
    names = robot.coordinate_names
    width = max(map(len, names))
    units = [unit for b in robot.model.leaders for unit in b.joint.coordinate_units]
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        yield f"  {k:3}  {name:{width}}  {unit}"
    yield "Entries of dq, ddq and tau (a joint of several: its twist in the frame of its child, angular part first):"
    k = 0
    for b in robot.model.leaders:
        for turns in b.joint.turning:
            units_text = ", ".join(unit_of(part, turns) for part in ("dq", "ddq", "tau"))
            yield f"  {k:3}  {b.joint.name:{width}}  {units_text.replace('²', '^2')}"  # ASCII, as C is
            k += 1
    if robot.model.quaternions:
        yield "A quaternion (qw, qx, qy, qz) may have any length but zero."


def comment_lines(robot: Robot, request: Request) -> list[str]:
    """Comment lines of one function."""
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
    parameters = []
    for name, port in zip(function.parameters, (*program.inputs, *program.outputs), strict=True):
        parameters.append(f"{name} {' x '.join(map(str, port.shape)) or '1'}")
    count = len(program.inputs)
    lines.append(f"In: {', '.join(parameters[:count])}. Out: {', '.join(parameters[count:])}.")
    lines.append(f"{_operations_text(program)}.")
    if names := full.get("parameters"):
        values, width = nominal(robot.model), max(map(len, names))
        lines.append("Entries of parameters, and the robot's own numbers:")
        lines += [f"  {k:3}  {name:{width}}  {file_number(values[name])}" for k, name in enumerate(names)]
    return lines


def _operations_text(program: Program) -> str:
    """Numbers of operations of each kind."""
    counts = program.counts()
    parts = []
    for label, operations in _COUNTED.items():
        total = sum(counts.get(operation, 0) for operation in operations)
        if total:
            parts.append(f"{total} {label}")
    return ", ".join(parts) or "No operation"
