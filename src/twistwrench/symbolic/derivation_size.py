"""How large a derivation will be: counted before it is begun."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import ValueRangeError
from .expanded_form import SymbolicMotion
from .symbols import ModelEntries

if TYPE_CHECKING:
    from ..robot import Robot

LARGEST_POSITION = 1500
"""Terms of a coordinate of a centre of mass, beyond which nothing is expanded."""
LARGEST_ROTATION = 100
"""Terms of an entry of a rotation, likewise."""
COMFORTABLE = 30_000
"""Products of two terms in the kinetic energy, up to which equations are written out unless asked otherwise."""
LARGEST_EXPANDED = 1_000_000
"""Products times coordinates, each of which differentiates them, beyond which even that is refused: hundreds of pages."""
MOST_EXPANDED = 4
"""Coordinates up to which equations are written out unless asked otherwise: beyond, nobody reads them."""
LARGEST_NAMED = 8_000
"""Lines of named intermediate results beyond which a derivation is refused."""


def expanded_products(entries: ModelEntries, motion: SymbolicMotion | None) -> float:
    """How many products of terms K takes; infinite where a position alone has too many."""
    if motion is None:
        return float("inf")
    return motion.products(tuple([[e.value for e in row] for row in b.inertia] for b in entries.bodies))


def check_expanded(name: str, products: float, coordinates: int) -> None:
    """ValueRangeError beyond :data:`LARGEST_EXPANDED`."""
    if products * coordinates > LARGEST_EXPANDED:
        count = (
            f"more than {LARGEST_POSITION:,} terms in a coordinate of a position, or {LARGEST_ROTATION} in a rotation"
            if products == float("inf")
            else f"{int(products):,} products of terms in its kinetic energy, to be differentiated by {coordinates} "
            f"coordinates; allowed are {LARGEST_EXPANDED // coordinates:,}"
        )
        raise ValueRangeError(
            f"{name!r} is too large to write out: {count}. Leave form='expanded' out and intermediate results get names; or "
            "lock joints (robot.lock), or keep numbers instead of symbols, symbols='none'."
        )


def named_lines(robot: Robot) -> int:
    """About how many lines a derivation with named intermediate results has: columns of Jacobians and their derivatives."""
    model = robot.model
    depth: list[int] = []
    lines = 0
    for body in model.bodies:
        before = depth[body.parent] if body.parent >= 0 else 0
        n = before + body.joint.nv
        depth.append(n)
        lines += 9 * n + 9 * n * (n - 1) // 2
    n = model.nv
    return lines + n * n * (n + 1) // 4


def check_named(robot: Robot) -> None:
    """ValueRangeError beyond :data:`LARGEST_NAMED` lines."""
    lines = named_lines(robot)
    if lines > LARGEST_NAMED:
        raise ValueRangeError(
            f"{robot.name!r} is too large to derive: its {robot.nv} coordinates would take about {lines:,} lines of named "
            f"intermediate results; allowed are {LARGEST_NAMED:,}. Lock joints (robot.lock), derive a leg or an arm by itself, "
            "or use the compiled kernels (robot.inverse_dynamics), which have no such limit."
        )
