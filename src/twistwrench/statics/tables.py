"""The largest payload as text, and as a file."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ..errors import ValueRangeError
from ..outputs import replacing
from .directions import largest_wrench, weakest_direction
from .payload import LargestPayload
from .stops import BeyondStop

if TYPE_CHECKING:
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["payload_view", "stops_view", "write_payload"]

_BAR = 16


def payload_view(
    robot: Robot,
    found: LargestPayload,
    q: Array,
    frame: str,
    com: Array,
    *,
    degrees: bool = False,
    limits: ArrayLike | None = None,
) -> RenderableType:
    """Heading, a row per joint, the forces the robot can apply there, and the verdict; for one pose."""
    turning = np.array([b.joint.kind != "prismatic" for b in robot.model.leaders for _ in range(b.joint.nv)])
    angle = 180 / math.pi if degrees else 1.0
    unit = "N m" if turning.all() else "N" if not turning.any() else "N m, N"
    table = Table(
        box=SIMPLE_HEAD, title=f"Holding torques \\[{unit}]", title_justify="left", title_style="bold", pad_edge=False
    )
    table.add_column("joint", no_wrap=True)
    headings = (
        f"q \\[{'°' if degrees else 'rad'}]",
        "alone",
        "per kg",
        "loaded",
        "limit",
        "up to \\[kg]",
        "share",
    )
    for name in headings:
        table.add_column(name, justify="right")
    table.add_column("")
    one_degree = robot.nq == robot.nv
    for k, name in enumerate(found.joint_names):
        share, worst = float(found.share[k]), k == int(found.joint)
        style = "bold red" if share > 1 + 1e-9 else "bold" if worst else ""
        place = f"{q[k] * (angle if turning[k] else 1.0):.4g}" if one_degree else ""
        table.add_row(
            Text(name),
            place.replace("-", "−"),
            _number(found.unloaded[k]),
            _number(found.per_kilogram[k]),
            _number(found.torques[k]),
            "–" if math.isinf(found.limits[k]) else f"{found.limits[k]:g}",
            "–" if not math.isfinite(found.per_joint[k]) else _number(max(found.per_joint[k], 0.0)),
            f"{100 * share:.0f} %" if math.isfinite(found.limits[k]) else "",
            Text("█" * round(_BAR * min(share, 1.0)), style="red" if worst or share > 1 else "cyan"),
            style=style,
        )
    where = f" + [{', '.join(f'{x:g}' for x in com)}] m" if np.any(com) else ""
    heading = Text.assemble((robot.name, "bold"), f"  ·  payload at {frame}{where}")
    return Group(heading, table, *_forces(robot, q, frame, limits), _verdict(found))


def _forces(robot: Robot, q: Array, frame: str, limits: ArrayLike | None) -> list[Text]:
    names = ("x", "y", "z")
    along = largest_wrench(robot, q, np.concatenate([np.eye(3), -np.eye(3)]), frame=frame, limits=limits)
    pairs = [f"±{n} {_force(along.magnitude[k])} / {_force(along.magnitude[k + 3])}" for k, n in enumerate(names)]
    lines = [Text(f"Largest force [N] along {', '.join(pairs)} (base axes).")]
    try:
        weakest = weakest_direction(robot, q, frame=frame, limits=limits)
    except ValueRangeError:
        return lines
    d = ", ".join(f"{0.0 if abs(x) < 5e-4 else x:.2f}" for x in weakest.wrench[3:]).replace("-", "−")
    limited = f", limited by {weakest.joint_names[int(weakest.joint)]}" if weakest.joint >= 0 else ""
    return [*lines, Text(f"Weakest along ({d}): {_force(weakest.magnitude)} N{limited}."), Text()]


def _verdict(found: LargestPayload) -> Text:
    if not found.holds:
        return Text.assemble(("NONE", "bold red"), f": {str(found).removeprefix('no payload: ')}.")
    if found.joint < 0:
        return Text.assemble(("ANY", "bold green"), ": no joint with a limit feels the payload at this pose.")
    k = int(found.joint)
    side = "upper" if found.side > 0 else "lower"
    return Text.assemble(
        (f"{found.mass:.4g} kg", "bold green"),
        f": the largest payload held at rest, limited by {found.joint_names[k]} at its {side} limit "
        f"({_number(found.torques[k])}, of which {_number(found.unloaded[k])} hold the robot itself).",
    )


def stops_view(beyond: Sequence[BeyondStop], *, degrees: bool = False) -> Text:
    """Which joints the pose puts beyond their stops, and by how much; ``degrees`` for those that turn."""
    said = []
    for b in beyond:
        scale, unit = ((180 / math.pi, "°") if degrees else (1.0, " rad")) if b.turns else (1.0, " m")
        side = "above its upper" if b.value > b.stop else "below its lower"
        value, far, stop = (_number(scale * x, 1e-12) for x in (b.value, b.by, b.stop))
        said.append(f"{b.joint} at {value}{unit} is {far}{unit} {side} position limit, {stop}{unit}")
    return Text.assemble(("OVER LIMIT", "bold red"), f": the robot cannot be in this pose: {'; '.join(said)}.")


def write_payload(found: LargestPayload, path: str | Path) -> None:
    """A CSV row per joint: names, then numbers with all their digits. ValueRangeError if the file cannot be written."""
    columns = ("alone", "per_kilogram", "with_payload", "limit", "holds_up_to", "share")
    data = (found.unloaded, found.per_kilogram, found.torques, found.limits, found.per_joint, found.share)
    with replacing(path) as scratch, scratch.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("joint", *columns))
        for k, name in enumerate(found.joint_names):
            writer.writerow((name, *(repr(float(column[k])) for column in data)))


def _force(value: Any) -> str:
    return "unbounded" if math.isinf(value) else f"{value:.4g}"


def _number(value: Any, least: float = 5e-4) -> str:
    if abs(value) < least:
        return "0"
    return f"{value:.4g}".replace("-", "−")
