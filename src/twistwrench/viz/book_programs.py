"""The programs that sections of Modern Robotics ask for, by the names that their pages call them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..errors import ValueRangeError
from .task_rows import task_rows

if TYPE_CHECKING:
    from .page_programs import PagePrograms

Asked = Mapping[str, tuple[str, dict[str, Any]]]
"""Quantities and their options by the names that the page calls their programs."""


def of_links(programs: PagePrograms) -> Asked:
    """Twists of the links and their rates."""
    found = {}
    for k, frame in enumerate(programs.body_frames):
        found[f"V{k}"] = "frame_velocity", {"frame": frame, "kind": "body"}
        found[f"dV{k}"] = "frame_acceleration", {"frame": frame, "kind": "body"}
    return found


def jacobian(programs: PagePrograms, kind: str) -> tuple[str, dict[str, Any]]:
    """That of the tip."""
    return "jacobian", {"frame": programs.tip, "kind": kind}


def twist(programs: PagePrograms, kind: str) -> tuple[str, dict[str, Any]]:
    """That of the tip."""
    return "frame_velocity", {"frame": programs.tip, "kind": kind}


def task(programs: PagePrograms) -> dict[str, Any]:
    """Options of quantities of the tip's velocity, in the rows in which it can be moved."""
    return {"frame": programs.tip, "kind": "world_aligned", "rows": _rows(programs)}


def link_jacobians(programs: PagePrograms) -> Asked:
    """Body Jacobians of the links: the rows of the matrix L A of section 8.4."""
    return {f"J{k}": ("jacobian", {"frame": f, "kind": "body"}) for k, f in enumerate(programs.body_frames)}


def along_wall(programs: PagePrograms) -> Asked:
    """Dynamics with the tip held on a wall across the first axis of the base along which it can be moved."""
    tip, row = programs.tip or "", _rows(programs)[0]
    wall = {"constraints": programs.robot.constrain(tip, row, kind="world_aligned").constraints}
    return {
        "wall": ("constraint_jacobian", wall),
        "wall_bias": ("constraint_bias", wall),
        "constrained": ("constrained_dynamics", {**wall, **programs.pushed, **programs.load}),
        "inverse": ("inverse_dynamics", {**programs.pushed, **programs.load}),
    }


def with_friction(programs: PagePrograms) -> Asked:
    """Inverse dynamics of the links, and friction by viscous and Coulomb coefficients of each joint."""
    names = [f"{b.joint.name}.{law}" for b in programs.robot.model.leaders for law in ("viscous", "coulomb")]
    return {
        "inverse": ("inverse_dynamics", programs.load),
        "friction": ("friction_forces", {"parameters": tuple(names)}),
    }


def _rows(programs: PagePrograms) -> tuple[str, ...]:
    """Those in which the tip can be moved; raises ValueRangeError where there are none."""
    found = task_rows(programs.robot, programs.tip)
    if not found or programs.tip is None:
        raise ValueRangeError(
            f"robot {programs.robot.name!r}: no joint moves the origin of its tip {programs.robot.tip!r}, so the page of this "
            "section has nothing to show. Load it with another tip: tw.load(…, tip=…), on the command line --tip."
        )
    return found
