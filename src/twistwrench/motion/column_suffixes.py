"""The ends of the names of columns: which say that they are velocities, accelerations or torques. One table for all files."""

from __future__ import annotations

from ..screws.component_names import WRENCH

SUFFIX = {"q": "", "dq": ".vel", "ddq": ".acc", "tau": ".torque"}
"""What our files write behind a joint's name, for each part of a motion."""

READ = {"q": ("",), "dq": (".vel",), "ddq": (".acc",), "tau": (".tau", ".torque", ".effort")}
"""What is read, the shortest first."""

DEGREES = {"q": "deg", "dq": "deg/s", "ddq": "deg/s^2"}
"""What columns say that they are in, in brackets, where angles are in degrees."""

ENERGIES = ("kinetic_energy", "potential_energy")
WORK = "work."
MOMENTUM = tuple(f"momentum.{x}" for x in WRENCH)
"""What simulations write besides a motion: energies, the work of each cause, the momentum."""


def is_result(name: str) -> bool:
    """Whether a column holds what follows from the motion, as simulations write it, and so is none of its coordinates.

    >>> is_result("work.torques"), is_result("workpiece")
    (True, False)
    """
    return name in ENERGIES or name in MOMENTUM or name.startswith(WORK)
