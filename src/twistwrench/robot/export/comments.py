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

_OPERATIONS_BY_LABEL = {  # names of :data:`ARITY`
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
    """Block comment in C; names from robot files can neither end it nor hide text in it."""
    text = "\n".join(lines)
    for token in ("*/", "/*", "??"):  # ?? begins a trigraph
        text = text.replace(token, f"{token[0]} {token[1]}")
    printable = "".join(character if character.isprintable() or character == "\n" else "?" for character in text)
    ascii_text = printable.encode("ascii", "backslashreplace").decode()
    body = "\n".join(f" * {line}".rstrip() for line in ascii_text.split("\n"))
    return f"/*\n{body}\n */"


def entries(robot: Robot) -> Iterator[str]:
    """Lines that list the entries of q and of dq, with their units."""
    yield "Entries of q:"
    names = robot.coordinate_names
    width = max(map(len, names))
    units: list[str] = []
    for body in robot.model.leaders:
        units += body.joint.coordinate_units
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        yield f"  {k:3}  {name:{width}}  {unit}"
    yield "Entries of dq, ddq and tau (a joint of several: its twist in the frame of its child, angular part first):"
    k = 0
    for body in robot.model.leaders:
        for is_angular in body.joint.turning:
            units_text = ", ".join(unit_of(part, is_angular) for part in ("dq", "ddq", "tau"))
            ascii_units = units_text.replace("²", "^2")
            yield f"  {k:3}  {body.joint.name:{width}}  {ascii_units}"
            k += 1
    if robot.model.quaternions:
        yield "A quaternion (qw, qx, qy, qz) may have any length but zero."


def comment_lines(robot: Robot, request: Request) -> list[str]:
    """Comment lines of one function."""
    function = request.function
    program = function.program
    options = request.full
    lines = [f"{request.quantity}: {QUANTITIES[request.quantity].meaning}."]
    if "frame" in options:
        lines.append(f"Frame: {options['frame']}.")
    if "kind" in options:
        lines.append(f"Kind: {options['kind']}.")
    if options.get("friction"):
        lines.append("With the friction of the joints.")
    on_robot = options.get("on_robot")
    if on_robot:
        lines.append(f"The world applies the wrenches at: {', '.join(on_robot)}.")
    derivative = options.get("derivative")
    if derivative:
        lines.append(f"Not itself: its derivative ({derivative.form}) by {', '.join(derivative.by)}.")
    constraints = options.get("constraints")
    if constraints:
        lines.append(f"Constraints: {', '.join(constraint.name for constraint in constraints)}.")
    parameter_texts = []
    for name, port in zip(function.parameters, (*program.inputs, *program.outputs), strict=True):
        shape = " x ".join(map(str, port.shape)) or "1"
        parameter_texts.append(f"{name} {shape}")
    input_count = len(program.inputs)
    inputs_text = ", ".join(parameter_texts[:input_count])
    outputs_text = ", ".join(parameter_texts[input_count:])
    lines.append(f"In: {inputs_text}. Out: {outputs_text}.")
    lines.append(f"{_operations_text(program)}.")
    parameter_names = options.get("parameters")
    if parameter_names:
        robot_values = nominal(robot.model)
        width = max(map(len, parameter_names))
        lines.append("Entries of parameters, and the robot's own numbers:")
        for k, name in enumerate(parameter_names):
            lines.append(f"  {k:3}  {name:{width}}  {file_number(robot_values[name])}")
    return lines


def _operations_text(program: Program) -> str:
    """Numbers of operations of each kind as text."""
    counts = program.counts()
    texts = []
    for label, operations in _OPERATIONS_BY_LABEL.items():
        total = sum(counts.get(operation, 0) for operation in operations)
        if total:
            texts.append(f"{total} {label}")
    return ", ".join(texts) or "No operation"
