"""The command ``twistwrench payload``: its options, and its answer as things to print."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray

from ..errors import UnknownNameError, ValueRangeError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["payload_answer", "payload_options"]


def payload_options(function: Callable[..., None]) -> Callable[..., None]:
    """The options of the command, all but the robot's own."""
    for option in (
        click.option(
            "--plot", "plot_path", metavar="OUT.png", help="Draw the force polytope, ellipsoid, shares and map."
        ),
        click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the table, a row per joint."),
        click.option("--samples", default=200_000, show_default=True, help="Configurations drawn for the map."),
        click.option(
            "--map", "plane", metavar="rz|xz|yz|xy", help="Map the largest payload over a slice of the workspace."
        ),
        click.option(
            "--limits", "limits_path", metavar="FILE.csv", help="Effort limits: joint,lower,upper,velocity,effort."
        ),
        click.option(
            "--com", metavar="x,y,z", default="0,0,0", show_default=True, help="Centre of mass in the frame [m]."
        ),
        click.option("--frame", metavar="FRAME", help="What carries the payload; the tip if not given."),
        click.option("--configuration", metavar="v,v,…", help="All coordinates at once."),
        click.option(
            "--at", metavar="JOINT=VALUE", multiple=True, help="A joint's place, others at zero; may be repeated."
        ),
    ):
        function = option(function)
    return function


def payload_answer(
    robot: Robot,
    *,
    degrees: bool,
    at: tuple[str, ...],
    configuration: str | None,
    frame: str | None,
    com: str,
    limits_path: str | None,
    plane: str | None,
    samples: int,
    csv_path: str | None,
    plot_path: str | None,
) -> Iterator[RenderableType]:
    """What the command prints, part by part; files are written on the way. Raises errors of the library."""
    from .map import payload_map
    from .payload import largest_payload
    from .tables import payload_view, write_payload

    q = _configuration(robot, at, configuration, degrees=degrees)
    place = np.array(_numbers(com, "--com", "x,y,z in metres, for example 0,0,0.1", 3))
    limits = None
    if limits_path is not None:
        from ..report.limits_file import read_limits

        limits = read_limits(limits_path, robot.model, degrees=degrees).effort
    found = largest_payload(robot, q, place, frame=frame, limits=limits)
    name = str(robot.tip if frame is None else frame)
    yield payload_view(robot, found, q, name, place, degrees=degrees, limits=limits)
    chart = None
    if plane is not None:
        chart = payload_map(robot, plane, samples=samples, com=place, frame=frame, limits=limits)
        yield f"map, {chart}"
    if csv_path is not None:
        write_payload(found, csv_path)
        yield f"wrote {csv_path}"
    if plot_path is not None:
        from .picture import plot_payload

        plot_payload(robot, q, found, plot_path, frame=name, limits=limits, chart=chart)
        yield f"wrote {plot_path}"


def _configuration(robot: Robot, at: Iterable[str], configuration: str | None, *, degrees: bool) -> Array:
    """q of the options; ValueRangeError and UnknownNameError say what was wrong."""
    q = robot.neutral
    places = {b.joint.name: b for b in robot.model.leaders}
    if configuration is not None:
        what = f"{robot.nq} numbers, {','.join(robot.coordinate_names[:8])}"
        q = np.array(_numbers(configuration, "--configuration", what, robot.nq))
        if degrees:
            for body in places.values():
                if body.joint.nq == 1 and body.joint.kind != "prismatic":
                    q[body.q_index] = math.radians(q[body.q_index])
    for text in at:
        joint, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise ValueRangeError(f"--at {text!r} is not JOINT=VALUE, for example {next(iter(places), 'joint1')}=0.5.")
        if joint not in places:
            raise UnknownNameError.of("joint", joint, places)
        body = places[joint]
        numbers = _numbers(
            value, f"--at {joint}", f"{body.joint.nq} number{'s' if body.joint.nq > 1 else ''}", body.joint.nq
        )
        if degrees and body.joint.nq == 1 and body.joint.kind != "prismatic":
            numbers = [math.radians(x) for x in numbers]
        q[body.q_index : body.q_index + body.joint.nq] = numbers
    return q


def _numbers(text: str, what: str, form: str, count: int) -> list[float]:
    try:
        numbers = [float(x) for x in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueRangeError(f"{what} {text!r}: expected {form}.")
    return numbers
