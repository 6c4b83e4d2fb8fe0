"""Quantities with their options: export requests with the names of their C functions, and quantities for the bridges."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.ir.program import Program, TensorSpec
from ...compiler.ir.tracer import trace
from ...compiler.printers.c99 import PRECISIONS, CFunction, identifier
from ...core import arguments
from ...core.errors import KernelError, ShapeError, UnknownNameError, ValueRangeError
from ...core.text import argument
from ...mechanics.algorithms.kinematics import velocity_map
from ...mechanics.lie.labelled import TWIST
from ..arguments import CONFIGURATIONS
from ..kernels.options import checked_options
from ..programs import program_of
from ..quantities import QUANTITIES

if TYPE_CHECKING:
    from .. import Robot
    from ..engine import Engine

_ALL_ROWS = tuple(range(len(TWIST)))
"""Numbers of all rows of a twist."""

Quantities = str | Mapping[str, Mapping[str, Any]] | Iterable[str | tuple[str, Mapping[str, Any]]]
"""One name, names with their options, or names of which some have options."""


@dataclass(frozen=True)
class Request:
    """One quantity with its options and its function."""

    quantity: str  # name
    options: Mapping[str, Any]
    """Given options, for :meth:`~twistwrench.Robot.kernel`."""
    full: Mapping[str, Any]
    """Full options: validated, with defaults."""
    function: CFunction
    """C function of the quantity."""


def prefix_of(robot: Robot, prefix: str | None) -> str:
    """Prefix of the functions' names: ``prefix``, or the robot's name converted to a C identifier.

    Raises ValueRangeError for an invalid prefix.
    """
    if prefix is None:
        name = identifier(robot.name)
        if re.match(r"[A-Za-z]", name):
            return name
        return f"robot_{name}".strip("_")
    if not isinstance(prefix, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix):
        raise ValueRangeError(
            f"{argument('prefix', prefix)} cannot begin a name in C. Use letters, digits and underscores, a letter first."
        )
    return prefix


def requests(robot: Robot, quantities: Quantities, precision: str, prefix: str) -> list[Request]:
    """Requests for the quantities, in their order.

    Raises UnknownNameError for unknown names, KernelError for options that do not apply and for quantities without a
    function, SingularMassMatrixError if the mass matrix has no inverse, ValueRangeError for an empty or repeated
    request.
    """
    if precision not in PRECISIONS:
        raise UnknownNameError.from_choices("precision", precision, PRECISIONS)
    if robot.nv == 0:
        raise KernelError(f"robot {robot.name!r} has no joint that moves: there is no function of q to export.")
    checked_requests: list[Request] = []
    for name, options in name_option_pairs(quantities):
        full_options = checked_options(robot.model, name, options)
        _require_program(robot, name, full_options)
        option_words = _option_words(full_options)
        function_name = "_".join([prefix, name, *option_words])
        program = program_of(robot.model, name, full_options)
        ports = (*program.inputs, *program.outputs)
        if any(port.size == 0 for port in ports):
            raise KernelError(f"{name} of robot {robot.name!r} has no entry: there is nothing to export.")
        for request in checked_requests:
            if request.function.name == function_name:
                raise ValueRangeError(
                    f"{function_name} would be there twice, for {name} {dict(options)} and {request.quantity} "
                    f"{dict(request.options)}. Name each once, or export them to files of different prefixes."
                )
        function = CFunction(function_name, program, precision)
        checked_requests.append(Request(name, options, full_options, function))
    if not checked_requests:
        raise ValueRangeError(f"no quantity is named. Choose from {', '.join(sorted(QUANTITIES))}.")
    return checked_requests


def name_option_pairs(quantities: Quantities) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Pairs (name, options) from one name, a mapping, or names with or without options."""
    entries: list[Any]
    if isinstance(quantities, str) or not isinstance(quantities, Iterable):
        entries = [quantities]  # one name; anything else is rejected below
    elif isinstance(quantities, Mapping):
        entries = list(quantities.items())
    else:
        entries = list(quantities)
    for entry in entries:
        if isinstance(entry, str):
            yield entry, {}
        elif isinstance(entry, tuple | list) and len(entry) == 2 and isinstance(entry[1], Mapping):
            name, options = entry
            yield str(name), options
        else:
            raise ShapeError(
                f"{entry!r} is not a quantity to export: give its name, or (name, options) such as "
                "('jacobian', {'frame': 'tool0'})."
            )


def _require_program(robot: Robot, name: str, full_options: Mapping[str, Any]) -> None:
    """Raise KernelError for quantities that a program without branches cannot compute correctly."""
    if QUANTITIES[name].needs_inverse:
        robot.engine.require_invertible()
    rows = full_options.get("rows", ())
    if len(rows) > robot.nv:
        row_names = " ".join(TWIST[k] for k in rows)
        raise KernelError(
            f"{name} of the {len(rows)} rows {row_names} needs the singular values of J on a robot with {robot.nv} "
            f"velocities, which a program without branches does not have. Name at most {robot.nv} rows, as in rows='vx vz'."
        )


def _option_words(full_options: Mapping[str, Any]) -> Iterator[str]:
    """Parts of a function's name for its options, always in the same order; options with default values have none."""
    frame = full_options.get("frame")
    if frame:
        yield identifier(frame)
    kind = full_options.get("kind")
    if kind:
        yield kind
    rows = full_options.get("rows")
    if rows and rows != _ALL_ROWS:
        yield from (TWIST[k] for k in rows)
    for wrench_frame in full_options.get("wrenches", ()):
        yield "wrench"
        if wrench_frame in full_options.get("on_robot", ()):
            yield from ("on", "robot")
        yield identifier(wrench_frame)
    if full_options.get("friction"):
        yield "friction"
    if "gravity" in full_options:
        yield "gravity_input"
    derivative = full_options.get("derivative")
    if derivative:
        yield from ("by", *map(identifier, derivative.by))
        if derivative.form != "jacobian":
            yield derivative.form


# ── One quantity for a bridge: program, derivatives, and rates of the coordinates


def element_names(names: Sequence[str], ports: Sequence[TensorSpec]) -> list[str]:
    """Names of the elements of arrays, one array after the other, such as ``q[0]``."""
    elements = []
    for name, port in zip(names, ports, strict=True):
        elements += [f"{name}[{k}]" for k in range(port.size)]
    return elements


BRIDGE_PRECISIONS = ("double", "single")


@dataclass(frozen=True, eq=False)
class BridgedQuantity:
    """One quantity with its options for a bridge to another package, whose functions use the cached parts in every call."""

    robot: Robot
    name: str  # of the quantity
    options: Mapping[str, Any]  # given ones, for robot.kernel
    _derivatives: dict[Any, BridgedQuantity] = field(default_factory=dict, init=False, repr=False)
    """Derivatives made so far, by the arguments of :meth:`derivative`."""

    @classmethod
    def from_robot(
        cls, what: str, robot: Robot, name: str, options: Mapping[str, Any], precision: str
    ) -> BridgedQuantity:
        """Validated quantity; ``what``: the method that needs it, for errors.

        Raises KernelError and UnknownNameError before the other package is imported.
        """
        arguments.choice(precision, f"{what}: precision", BRIDGE_PRECISIONS)
        if options.get("by") is not None:
            raise KernelError(
                f"{what} {name}: by={options['by']!r} is for robot.kernel. What is given here is differentiated by the package "
                "it goes to."
            )
        quantity = cls(robot, name, options)
        _ = quantity.program  # raises errors for invalid options
        return quantity

    @property
    def engine(self) -> Engine:
        """Engine of the robot."""
        return self.robot.engine

    @cached_property
    def program(self) -> Program:
        """Program of the quantity."""
        return self.engine.program((self.name,), self.options)

    @cached_property
    def kernel(self) -> Any:
        """Compiled function of the same program."""
        return self.engine.kernel((self.name,), self.options)

    def derivative(self, by: Sequence[str], form: str = "jacobian", *, values: bool = False) -> BridgedQuantity:
        """Derivative with respect to some inputs; for configurations along :meth:`twistwrench.Robot.add`."""
        key = tuple(by), form, values
        if key not in self._derivatives:
            options = {**self.options, "by": tuple(by), "form": form, "values": values}
            self._derivatives[key] = BridgedQuantity(self.robot, self.name, options)
        return self._derivatives[key]

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Names and shapes of the inputs."""
        return self.program.inputs

    @property
    def input_names(self) -> list[str]:
        """Names of the inputs."""
        return [port.name for port in self.inputs]

    @property
    def inputs_text(self) -> str:
        """Names and shapes of the inputs, as docstrings of functions list them."""
        return ", ".join(f"{port.name} {port.shape}" for port in self.inputs)

    def brought(self, what: str, values: Sequence[Any], array_type: type) -> list[Any]:
        """Inputs of a call: arrays of the other package as they are, all else as real arrays.

        Raises ShapeError and ValueRangeError.
        """
        ports = self.inputs
        if len(values) != len(ports):
            raise ShapeError(f"{what} {self.name}: {len(values)} arrays given, {', '.join(self.input_names)} wanted.")
        arrays = []
        for value, port in zip(values, ports, strict=True):
            if not isinstance(value, array_type):
                value = arguments.real(value, f"{what} {self.name}: {port.name}", *port.shape)
            arrays.append(value)
        return arrays

    def require_shapes(self, what: str, shapes: Sequence[tuple[int, ...]]) -> None:
        """Raise ShapeError unless the shapes end in the inputs' shapes and the batch shapes broadcast."""
        ports = self.inputs
        batch_shapes = []
        for shape, port in zip(shapes, ports, strict=True):
            batch_rank = len(shape) - len(port.shape)
            if batch_rank < 0 or shape[batch_rank:] != port.shape:
                shape_text = ", ".join(["…", *map(str, port.shape)])  # of any batch
                raise ShapeError(f"{what} {self.name}: {port.name} has shape {shape}, ({shape_text}) wanted.")
            batch_shapes.append(shape[:batch_rank])
        different_shapes = set(batch_shapes)
        if len(different_shapes) <= 1:
            return
        try:
            np.broadcast_shapes(*different_shapes)
        except ValueError:
            named_shapes = ", ".join(f"{port.name} {shape}" for port, shape in zip(ports, batch_shapes, strict=True))
            raise ShapeError(f"{what} {self.name}: batch shapes {named_shapes} do not broadcast.") from None

    @property
    def curved_inputs(self) -> tuple[str, ...]:
        """Inputs whose rates differ from velocities: configurations with quaternions or other angles."""
        has_plain_rates = all(body.joint.plain_rates for body in self.engine.model.leaders)
        if has_plain_rates:
            return ()
        return tuple(port.name for port in self.inputs if port.name in CONFIGURATIONS)

    def velocities(self) -> Program:
        """Program (q, coordinate rates) → joint velocities, linear in the rates.

        The rate of a quaternion's norm gives no velocity.
        """
        model = self.engine.model

        def velocities_from_rates(q: Any, rates: Any) -> tuple[Any, ...]:
            return (velocity_map(model, q) @ rates,)

        return trace(velocities_from_rates, [("q", (model.nq,)), ("rates", (model.nq,))], ["dq"])

    def slopes(self) -> Program:
        """Program (q, derivative along velocities) → derivative by the entries of q: transpose of :meth:`velocities`."""
        model = self.engine.model

        def slopes_by_entries(q: Any, derivative_along: Any) -> tuple[Any, ...]:
            return (derivative_along @ velocity_map(model, q),)

        return trace(slopes_by_entries, [("q", (model.nq,)), ("along", (model.nv,))], ["by_q"])
