"""Quantities of one robot with their options, as the bridges need them: program, derivatives, and rates of q's entries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.kinematics import velocity_map
from ..core import arguments
from ..errors import KernelError, ShapeError
from ..ir.program import Program, TensorSpec
from ..ir.tracer import trace
from ..robot.arguments import CONFIGURATIONS

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.engine import Engine

PRECISIONS = ("double", "single")


@dataclass(frozen=True, eq=False)
class BridgedQuantity:
    """One quantity with its options; its parts are built once, since functions use them in every call."""

    robot: Robot
    name: str
    options: Mapping[str, Any]
    _derivatives: dict[Any, BridgedQuantity] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def from_robot(
        cls, what: str, robot: Robot, name: str, options: Mapping[str, Any], precision: str
    ) -> BridgedQuantity:
        """Checked quantity. Raises KernelError and UnknownNameError before the other package is used."""
        arguments.choice(precision, f"{what}: precision", PRECISIONS)
        if options.get("by") is not None:
            raise KernelError(
                f"{what} {name}: by={options['by']!r} is for robot.kernel. What is given here is differentiated by the package "
                "it goes to."
            )
        found = cls(robot, name, options)
        _ = found.program
        return found

    @property
    def engine(self) -> Engine:
        """Engine of the robot."""
        return self.robot.engine

    @cached_property
    def program(self) -> Program:
        """The program of the quantity."""
        return self.engine.program((self.name,), self.options)

    @cached_property
    def kernel(self) -> Any:
        """Compiled function of the same program."""
        return self.engine.kernel((self.name,), self.options)

    def derivative(self, by: Sequence[str], form: str = "jacobian", *, values: bool = False) -> BridgedQuantity:
        """Derivative of the quantity by some of its inputs, along :meth:`twistwrench.Robot.add` on configurations."""
        key = tuple(by), form, values
        if key not in self._derivatives:
            asked = {**self.options, "by": tuple(by), "form": form, "values": values}
            self._derivatives[key] = BridgedQuantity(self.robot, self.name, asked)
        return self._derivatives[key]

    @property
    def inputs(self) -> tuple[TensorSpec, ...]:
        """Names and shapes of the inputs."""
        return self.program.inputs

    def brought(self, what: str, given: Sequence[Any], theirs: type) -> list[Any]:
        """Arrays of the other package as they are, all else as real arrays. Raises ShapeError and ValueRangeError."""
        ports = self.inputs
        if len(given) != len(ports):
            names = ", ".join(port.name for port in ports)
            raise ShapeError(f"{what} {self.name}: {len(given)} arrays given, {names} wanted.")
        return [
            x if isinstance(x, theirs) else arguments.real(x, f"{what} {self.name}: {port.name}", *port.shape)
            for x, port in zip(given, ports, strict=True)
        ]

    def require_shapes(self, what: str, shapes: Sequence[tuple[int, ...]]) -> None:
        """Raise ShapeError unless these are the inputs' shapes behind batch shapes that broadcast."""
        ports = self.inputs
        for shape, port in zip(shapes, ports, strict=True):
            if len(shape) < len(port.shape) or shape[len(shape) - len(port.shape) :] != port.shape:
                wanted = ", ".join(["…", *map(str, port.shape)])
                raise ShapeError(f"{what} {self.name}: {port.name} has shape {shape}, ({wanted}) wanted.")
        batches = [shape[: len(shape) - len(port.shape)] for shape, port in zip(shapes, ports, strict=True)]
        if len(several := set(batches)) <= 1:
            return
        try:
            np.broadcast_shapes(*several)
        except ValueError:
            listed = ", ".join(f"{port.name} {batch}" for port, batch in zip(ports, batches, strict=True))
            raise ShapeError(f"{what} {self.name}: batch shapes {listed} do not broadcast.") from None

    @property
    def curved(self) -> tuple[str, ...]:
        """Inputs whose entries are not integrals of velocities: configurations with quaternions or other angles."""
        plain = all(body.joint.plain_rates for body in self.engine.model.leaders)
        return () if plain else tuple(port.name for port in self.inputs if port.name in CONFIGURATIONS)

    def velocities(self) -> Program:
        """(q, rates of its entries) -> joint velocities, linear in the rates; rates along a quaternion give zero."""
        model = self.engine.model
        return trace(
            lambda q, rates: (velocity_map(model, q) @ rates,), [("q", (model.nq,)), ("rates", (model.nq,))], ["dq"]
        )

    def slopes(self) -> Program:
        """(q, derivative along the velocities) -> derivative by the entries of q: the transpose of :meth:`velocities`."""
        model = self.engine.model
        return trace(lambda q, w: (w @ velocity_map(model, q),), [("q", (model.nq,)), ("along", (model.nv,))], ["by_q"])
