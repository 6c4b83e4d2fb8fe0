"""Size of a derivation, estimated beforehand, and its limits."""

from __future__ import annotations

from ..core.errors import ValueRangeError
from ..core.text import argument
from ..mechanics.model.model import BASE
from ..robot import Robot

MAX_POSITION_TERMS = 1500
"""Maximum number of terms in a centre-of-mass coordinate for an expanded derivation."""
MAX_ROTATION_TERMS = 100
"""Maximum number of terms in an entry of a rotation."""
MAX_AUTOMATIC_PRODUCTS = 30_000
"""Maximum number of products of two terms in the kinetic energy for which equations are expanded by default."""
MAX_EXPANDED_PRODUCTS = 1_000_000
"""Maximum number of products times coordinates for an expanded derivation; more would fill hundreds of pages."""
MAX_EXPANDED_COORDINATES = 4
"""Maximum number of coordinates for which equations are expanded by default; equations of more coordinates are unreadable."""
MAX_NAMED_LINES = 8_000
"""Maximum number of lines of named intermediate results."""
_LINES_PER_COLUMN = 9
"""Approximate number of lines of a column of a Jacobian or of its derivative."""


def check_expanded(name: str, products: float, coordinates: int) -> None:
    """Raise ValueRangeError if an expanded derivation of the robot ``name`` would exceed :data:`MAX_EXPANDED_PRODUCTS`.

    ``products`` is the number of products of two terms in the kinetic energy; inf if it was not counted.
    """
    if products * coordinates > MAX_EXPANDED_PRODUCTS:
        size = f"more than {MAX_POSITION_TERMS:,} terms in a coordinate of a position, or {MAX_ROTATION_TERMS} in a rotation"
        if products < float("inf"):
            size = (
                f"{int(products):,} products of terms in its kinetic energy, to be differentiated by {coordinates} "
                f"coordinates; allowed are {MAX_EXPANDED_PRODUCTS // coordinates:,}"
            )
        raise ValueRangeError(
            f"{name!r} is too large to write out: {size}. Leave {argument('form', 'expanded')} out and "
            "intermediate results get names; or "
            f"lock joints (robot.lock), or keep numbers instead of symbols, {argument('symbols', 'none')}."
        )


def named_lines(robot: Robot) -> int:
    """Approximate number of lines with named intermediate results: columns of Jacobians and their derivatives."""
    model = robot.model
    column_counts: list[int] = []  # number of nonzero columns of each body's Jacobian
    line_count = 0
    for body in model.bodies:
        column_count = body.joint.nv
        if body.parent != BASE:
            column_count += column_counts[body.parent]
        column_counts.append(column_count)
        derivative_count = column_count * (column_count - 1) // 2  # of each column by the joints before it
        line_count += _LINES_PER_COLUMN * (column_count + derivative_count)
    n = model.nv
    mass_matrix_derivatives = n * n * (n + 1) // 4  # n derivatives of n (n + 1)/2 entries; about half of them are zero
    return line_count + mass_matrix_derivatives


def check_named(robot: Robot) -> None:
    """Raise ValueRangeError beyond :data:`MAX_NAMED_LINES` lines."""
    lines = named_lines(robot)
    if lines > MAX_NAMED_LINES:
        raise ValueRangeError(
            f"{robot.name!r} is too large to derive: its {robot.nv} coordinates would take about {lines:,} lines of named "
            f"intermediate results; allowed are {MAX_NAMED_LINES:,}. Lock joints (robot.lock), derive a leg or an arm by "
            "itself, or use the compiled kernels (robot.inverse_dynamics), which have no such limit."
        )
