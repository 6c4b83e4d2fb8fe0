"""What one quantity of a robot is: its algorithm, its inputs and outputs, and what they mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..model.model import Model
from .quantity_types import CONFIGURATIONS

Shape = tuple[int, ...]


@dataclass(frozen=True)
class Quantity:
    """One row of the table: ``algorithm(model, *inputs, **options)`` gives the outputs."""

    algorithm: Callable[..., Any]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sizes: tuple[tuple[str, ...], ...]
    """The axes of each output: numbers, or what their length is the number of."""
    meaning: str
    """In a line, ASCII, with the names of the inputs and outputs."""
    options: tuple[str, ...] = ()
    felt: bool = False
    """Whether only what the joints feel counts, so that the model may be regrouped."""
    needs_inverse: bool = False
    """Whether the inverse of M is part of it."""
    needs_mass: bool = False
    """Whether it is divided by the mass of all moving bodies."""
    unit: str = ""
    book: str = ""
    """Where Modern Robotics has it."""
    pinocchio: str = ""
    mujoco: str = ""
    """What other libraries call it."""

    def shapes(self, model: Model) -> list[tuple[str, Shape]]:
        """Names and shapes of the inputs for one robot."""
        return [
            (name, (model.nq,) if name in CONFIGURATIONS else (6,) if name == "wrench" else (model.nv,))
            for name in self.inputs
        ]


def row(
    algorithm: Callable[..., Any],
    inputs: str,
    outputs: str,
    sizes: str,
    meaning: str,
    *,
    options: str = "",
    felt: bool = False,
    needs_inverse: bool = False,
    needs_mass: bool = False,
    unit: str = "",
    book: str = "",
    pinocchio: str = "",
    mujoco: str = "",
) -> Quantity:
    """Names apart by blanks, the sizes of several outputs by commas."""
    return Quantity(
        algorithm,
        tuple(inputs.split()),
        tuple(outputs.split()),
        tuple(tuple(axes.split()) for axes in sizes.split(",")),
        meaning,
        tuple(options.split()),
        felt,
        needs_inverse,
        needs_mass,
        unit,
        book,
        pinocchio,
        mujoco,
    )
