"""One section of Modern Robotics as a page shows it: its idea, formulas, sliders and programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..errors import ValueRangeError

if TYPE_CHECKING:
    from ..robot import Robot
    from .book_programs import Asked
    from .page_programs import PagePrograms

MOST_JOINTS = 9
"""Columns that a table of the page has room for."""


@dataclass(frozen=True)
class BookSection:
    """What one page shows; its readout is the function of the same number in ``player/*readouts.js``."""

    number: str
    title: str
    idea: str
    formulas: tuple[tuple[str, str], ...]
    """As :func:`~twistwrench.viz.formula.formula_html` takes them, and where the book has them."""
    inputs: tuple[str, ...]
    """Sliders besides the joints': dq, ddq, tau, wrench, dV, motor."""
    programs: Callable[[PagePrograms], Asked]
    chooses: str = ""
    """What is picked from a list: a joint or a link."""
    load: str = ""
    """Sliders of what the tip carries: payload, all (with push and the button that lets the robot go), or none."""
    shown: tuple[str, ...] = ("looks", "torques")
    """What is switched on at first."""
    at_rest: bool = False
    """Whether the velocities are zero at first."""
    presses: bool = False
    """Whether the torques at first press the tip along the first axis along which it can be moved."""

    def require(self, robot: Robot) -> None:
        """Raise ValueRangeError unless the page can show this robot."""
        why = None
        if robot.model.tip is None:
            why = "has no single tip: name one, by --tip FRAME or tw.load(…, tip=…)"
        elif any(body.joint.nv != 1 or not body.joint.driven for body in robot.model.leaders):
            why = "has joints that neither turn nor slide, or a base that moves"
        elif not 1 <= robot.nv <= MOST_JOINTS:
            why = f"has {robot.nv} joints that move"
        if why is not None:
            raise ValueRangeError(
                f"section {self.number}: robot {robot.name!r} {why}. These pages take an arm with one tip and 1 to "
                f"{MOST_JOINTS} joints that turn or slide, such as planar_2r, ur5 or panda."
            )
