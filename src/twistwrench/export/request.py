"""Requests of export: quantities with their options, each with the name of its function in C."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..errors import KernelError, ShapeError, UnknownNameError, ValueRangeError
from ..lie.labelled import TWIST
from ..printers.c99 import PRECISIONS, CFunction, identifier
from ..robot.programs import checked_options, program_of
from ..robot.quantities import QUANTITIES

if TYPE_CHECKING:
    from ..robot import Robot

Quantities = str | Mapping[str, Mapping[str, Any]] | Iterable[str | tuple[str, Mapping[str, Any]]]


@dataclass(frozen=True)
class Request:
    """One quantity with its options, and its function."""

    quantity: str
    options: Mapping[str, Any]
    """Options as given, for :meth:`~twistwrench.Robot.kernel`."""
    full: Mapping[str, Any]
    """Options checked, with defaults."""
    function: CFunction


def prefix_of(robot: Robot, prefix: str | None) -> str:
    """Prefix of the functions' names: ``prefix``, or the robot's name made a C identifier.

    Raises ValueRangeError for an invalid prefix.
    """
    if prefix is None:
        found = identifier(robot.name)
        return found if re.match(r"[A-Za-z]", found) else f"robot_{found}".strip("_")
    if not isinstance(prefix, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix):
        raise ValueRangeError(
            f"prefix={prefix!r} cannot begin a name in C. Use letters, digits and underscores, a letter first."
        )
    return prefix


def requests(robot: Robot, quantities: Quantities, precision: str, prefix: str) -> list[Request]:
    """Requests for the quantities, in their order.

    Raises UnknownNameError for unknown names, KernelError for options that do not apply and for quantities without a function,
    SingularMassMatrixError for a missing inverse of the mass matrix, ValueRangeError for none, or for the same twice.
    """
    if precision not in PRECISIONS:
        raise UnknownNameError.from_choices("precision", precision, PRECISIONS)
    if robot.nv == 0:
        raise KernelError(f"robot {robot.name!r} has no joint that moves: there is no function of q to export.")
    found: list[Request] = []
    for name, options in named(quantities):
        full = checked_options(robot.model, name, options)
        _require_a_program(robot, name, full)
        function = CFunction("_".join([prefix, name, *_words(full)]), program_of(robot.model, name, full), precision)
        if any(port.size == 0 for port in (*function.program.inputs, *function.program.outputs)):
            raise KernelError(f"{name} of robot {robot.name!r} has no entry: there is nothing to export.")
        if twins := [r for r in found if r.function.name == function.name]:
            raise ValueRangeError(
                f"{function.name} would be there twice, for {name} {dict(options)} and {twins[0].quantity} "
                f"{dict(twins[0].options)}. Name each once, or export them to files of different prefixes."
            )
        found.append(Request(name, options, full, function))
    if not found:
        raise ValueRangeError(f"no quantity is named. Choose from {', '.join(sorted(QUANTITIES))}.")
    return found


def named(quantities: Quantities) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """(name, options) from one name, a mapping, or names with or without options."""
    given: list[Any]
    if isinstance(quantities, str):
        given = [quantities]
    elif isinstance(quantities, Mapping):
        given = list(quantities.items())
    else:
        given = list(quantities) if isinstance(quantities, Iterable) else [quantities]  # the latter is refused below
    for entry in given:
        if isinstance(entry, str):
            yield entry, {}
        elif isinstance(entry, tuple | list) and len(entry) == 2 and isinstance(entry[1], Mapping):
            yield str(entry[0]), entry[1]
        else:
            raise ShapeError(
                f"{entry!r} is no quantity to export: give its name, or (name, options) such as "
                "('jacobian', {'frame': 'tool0'})."
            )


def _require_a_program(robot: Robot, name: str, full: Mapping[str, Any]) -> None:
    """Raise KernelError for quantities that a program without branches computes wrongly everywhere."""
    if QUANTITIES[name].needs_inverse:
        robot.engine.require_invertible()
    if len(full.get("rows", ())) > robot.nv:
        rows = " ".join(TWIST[k] for k in full["rows"])
        raise KernelError(
            f"{name} of the {len(full['rows'])} rows {rows} needs the singular values of J on a robot with {robot.nv} "
            f"velocities, which a program without branches does not have. Name at most {robot.nv} rows, as in rows='vx vz'."
        )


def _words(full: Mapping[str, Any]) -> Iterator[str]:
    """The options as parts of a name, in the order of the table."""
    if frame := full.get("frame"):
        yield identifier(frame)
    if kind := full.get("kind"):
        yield kind
    if (rows := full.get("rows")) and rows != tuple(range(6)):
        yield from (TWIST[k] for k in rows)
    for frame in full.get("wrenches", ()):
        sign = ["on", "robot"] if frame in full.get("on_robot", ()) else []
        yield from ("wrench", *sign, identifier(frame))
    if full.get("friction"):
        yield "friction"
    if "gravity" in full:
        yield "gravity_input"
    if derivative := full.get("derivative"):
        yield from ("by", *map(identifier, derivative.by))
        if derivative.form != "jacobian":
            yield derivative.form
