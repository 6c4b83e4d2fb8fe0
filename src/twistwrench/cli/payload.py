"""The command ``twistwrench payload``: its options, and its answer as things to print."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click
import numpy as np

from ..errors import ValueRangeError
from .motion_options import AT, CONFIGURATION, LIMITS, PAYLOADS, option_group

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..robot import Robot

_SAMPLES = 200_000


payload_options = option_group(
    click.option("--plot", "plot_path", metavar="OUT.png", help="Draw the force polytope, ellipsoid, shares and map."),
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the table, a row per joint."),
    click.option("--samples", type=int, metavar="N", help=f"Configurations drawn for the map.  [default: {_SAMPLES}]"),
    click.option(
        "--map", "plane", metavar="rz|xz|yz|xy", help="Map the largest payload over a slice of the workspace."
    ),
    LIMITS,
    click.option("--com", metavar="x,y,z", default="0,0,0", show_default=True, help="Centre of mass in the frame [m]."),
    click.option("--frame", metavar="FRAME", help="What carries the payload; the tip if not given."),
    PAYLOADS,
    CONFIGURATION,
    AT,
)
"""The options of the command, all but the robot's own."""


def run_payload(
    robot: Robot,
    show: Callable[[RenderableType], None],
    *,
    degrees: bool,
    tip: str | None,
    at: tuple[str, ...],
    configuration: str | None,
    frame: str | None,
    com: str,
    payloads: tuple[str, ...],
    limits_path: str | None,
    plane: str | None,
    samples: int | None,
    csv_path: str | None,
    plot_path: str | None,
) -> bool:
    """Print the answer part by part with ``show``, and write the files.

    Returns whether the robot can be in the pose and holds itself there, and no mass is missing. All options are read before
    anything is printed.
    Raises errors of the library.
    """
    from ..reports.load_case import LoadCase, Payload, limit_doubts, parse_payload, unlimited
    from ..reports.robot_summary import degrees_hint, parse_configuration, parse_numbers
    from ..reports.torque_verdict import assumed_words, assumptions, model_warnings
    from ..statics.equilibrium import joints_beyond_stops
    from ..statics.payload import largest_payload, payload_map, plane_and_samples
    from ..statics.torque_limits import unit_slips
    from .tables.payload import (
        carried_words,
        caution,
        doubts_view,
        map_view,
        payload_view,
        place_words,
        stops_view,
        write_payload,
    )

    if samples is not None and plane is None:
        raise ValueRangeError("--samples is about the map, and there is none. Add --map rz.")
    count = _SAMPLES if samples is None else samples
    if plane is not None:
        plane, count = plane_and_samples(plane, count)
    q = parse_configuration(robot, at, configuration, degrees=degrees)
    hint = degrees_hint(robot, q)
    place = np.array(parse_numbers(com, "--com", "x,y,z in metres, for example 0,0,0.1", 3))
    allowed = robot.limits
    if limits_path is not None:
        from ..reports.robot_summary import read_limits

        allowed = read_limits(limits_path, robot.model, degrees=degrees)
    limits = allowed.effort
    beyond = joints_beyond_stops(robot, q, allowed)
    load = LoadCase(robot, tuple(parse_payload(text, tip) for text in payloads))
    robot = load.with_load
    found = largest_payload(robot, q, place, frame=frame, limits=limits)
    assumed = assumed_words(assumptions(robot.model, (Payload(1.0, frame=frame or tip), *load.payloads)))
    name = str(robot.tip if frame is None else frame)
    where, carried = place_words(name, place), carried_words(robot, load.payloads)
    if beyond:
        show(stops_view(beyond, degrees=degrees))
    loads = (np.abs(found.unloaded) + np.abs(found.per_kilogram))[: robot.nv]
    judged = not unlimited(robot.model, limits, loads)
    doubts = limit_doubts(load.robot, allowed, loads)
    if lacking := model_warnings(robot.model):
        doubts.append(f"{'; '.join(lacking)}: the payload may be less")
    if doubts:
        show(doubts_view(doubts))
    if hint:
        show(f"! {hint}")
    words = {"carried": carried, "assumed": assumed}
    show(payload_view(robot, found, q, name, where, **words, degrees=degrees, limits=limits, judged=judged))
    if not judged and (plane or plot_path):
        click.echo(
            "note: --map and --plot need a torque limit of every joint that is loaded; none is written.", err=True
        )
        plane = plot_path = None
    chart = None
    if plane is not None:
        chart = payload_map(robot, plane, samples=count, com=place, frame=frame, limits=limits)
        show(map_view(chart))
    show(caution())
    places = {
        "--com": place,
        **{f"--payload {t}": np.array(p.place) for t, p in zip(payloads, load.payloads, strict=True)},
    }
    for slip in unit_slips(robot, q, allowed, places, degrees=degrees):
        click.echo(f"note: {slip}", err=True)
    if csv_path is not None:
        write_payload(robot, found, q, csv_path, degrees=degrees, judged=judged)
    if plot_path is not None:
        from ..plotting.payload import plot_payload

        plot_payload(robot, q, found, plot_path, frame=name, where=where, carried=carried, limits=limits, chart=chart)
    for written in filter(None, (csv_path, plot_path)):
        show(f"wrote {written}")
    return bool(found.holds) and not beyond and not doubts
