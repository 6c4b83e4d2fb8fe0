"""Size of a derivation, estimated beforehand, and its limits."""

from __future__ import annotations

from ..core.errors import ValueRangeError
from ..core.text import argument
from ..mechanics.model.model import BASE
from ..robot import Robot

LARGEST_POSITION = 1500
"""Maximum number of terms in a centre-of-mass coordinate for an expanded derivation."""
LARGEST_ROTATION = 100
"""Maximum number of terms in an entry of a rotation."""
MAX_AUTOMATIC_PRODUCTS = 30_000
"""Maximum number of products of two terms in the kinetic energy for which equations are expanded by default."""
LARGEST_EXPANDED = 1_000_000
"""Maximum number of products times coordinates for an expanded derivation; more would fill hundreds of pages."""
MAX_EXPANDED_COORDINATES = 4
"""Maximum number of coordinates for which equations are expanded by default; longer ones are unreadable."""
LARGEST_NAMED = 8_000
"""Maximum number of lines of named intermediate results."""


def check_expanded(name: str, products: float, coordinates: int) -> None:
    """Raise ValueRangeError beyond :data:`LARGEST_EXPANDED`."""
    if products * coordinates > LARGEST_EXPANDED:
        count = (
            f"more than {LARGEST_POSITION:,} terms in a coordinate of a position, or {LARGEST_ROTATION} in a rotation"
        )
        if products < float("inf"):
            count = (
                f"{int(products):,} products of terms in its kinetic energy, to be differentiated by {coordinates} "
                f"coordinates; allowed are {LARGEST_EXPANDED // coordinates:,}"
            )
        raise ValueRangeError(
            f"{name!r} is too large to write out: {count}. Leave {argument('form', 'expanded')} out and "
            "intermediate results get names; or "
            f"lock joints (robot.lock), or keep numbers instead of symbols, {argument('symbols', 'none')}."
        )


def named_lines(robot: Robot) -> int:
    """Approximate number of lines with named intermediate results: columns of Jacobians and their derivatives."""
    model = robot.model
    depths: list[int] = []
    lines = 0
    for body in model.bodies:
        depth = body.joint.nv
        if body.parent != BASE:
            depth += depths[body.parent]
        depths.append(depth)
        lines += 9 * depth + 9 * depth * (depth - 1) // 2
    n = model.nv
    return lines + n * n * (n + 1) // 4


def check_named(robot: Robot) -> None:
    """Raise ValueRangeError beyond :data:`LARGEST_NAMED` lines."""
    lines = named_lines(robot)
    if lines > LARGEST_NAMED:
        raise ValueRangeError(
            f"{robot.name!r} is too large to derive: its {robot.nv} coordinates would take about {lines:,} lines of named "
            f"intermediate results; allowed are {LARGEST_NAMED:,}. Lock joints (robot.lock), derive a leg or an arm by itself, "
            "or use the compiled kernels (robot.inverse_dynamics), which have no such limit."
        )
