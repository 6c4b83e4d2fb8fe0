"""The command ``twistwrench payload``: the largest payload at a pose, as text and as a file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import ArrayLike
from rich.console import Group, RenderableType
from rich.text import Text

from ..core.files import check_outputs, replacing
from ..core.numbers import number, percent_of_limit, quantity, rounded_down, torque, without_noise
from ..core.tables import CsvWriter
from ..core.verdict import ExitCode, Word
from ..errors import ValueRangeError
from ..joints.units import heading_unit, unit_of
from ..model.limits import over_limit
from ..motion.coordinates import Coordinates
from ..reports.load_case import LoadCase, Payload, limit_doubts, parse_payload, unlimited
from ..reports.robot_summary import degrees_hint, parse_configuration, parse_numbers, read_limits
from ..reports.torque_verdict import assumed_words, assumptions, model_warnings
from ..robot import Robot
from ..statics.equilibrium import BeyondStop, joints_beyond_stops
from ..statics.force_capability import largest_wrench, weakest_direction
from ..statics.payload import LargestPayload, PayloadMap, largest_payload, payload_map, plane_and_samples
from ..statics.torque_limits import unit_slips
from ..typing import Array
from .console import picture, show, show_written
from .motion_options import AT, CONFIGURATION, LIMITS, PAYLOADS
from .plain_table import PlainTable, share_bar, verdict_word
from .robot_options import RobotOptions, robot_command
from .usage import Given, option_group

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


@robot_command(
    "payload",
    payload_options,
    examples=(
        "payload ur5",
        "payload ur5 --at shoulder_lift_joint=-0.6 --at elbow_joint=0.9 --com 0,0,0.1",
    ),
)
def payload_command(options: RobotOptions, given: Given) -> ExitCode:
    """The largest payload held at rest at a pose, the joint that limits it, and the forces the robot can apply.

    Exit code 1 if the pose is outside the joints' position limits, or the robot cannot hold itself there.
    """
    given.plot_path = picture(given.plot_path)
    check_outputs(
        {"--csv": given.csv_path, "--plot": given.plot_path}, {"--limits": given.limits_path, **options.files}
    )
    robot = options.load()
    if given.samples is not None and given.plane is None:
        raise ValueRangeError("--samples is about the map, and there is none. Add --map rz.")
    count = _SAMPLES if given.samples is None else given.samples
    if given.plane is not None:
        given.plane, count = plane_and_samples(given.plane, count)
    q = parse_configuration(robot, given.at, given.configuration, degrees=options.degrees)
    hint = degrees_hint(robot, q)
    place = np.array(parse_numbers(given.com, "--com", "x,y,z in metres, for example 0,0,0.1", 3))
    allowed = robot.limits
    if given.limits_path is not None:
        allowed = read_limits(given.limits_path, robot.model, degrees=options.degrees)
    limits = allowed.effort
    beyond = joints_beyond_stops(robot, q, allowed)
    load = LoadCase(robot, tuple(parse_payload(text, options.tip) for text in given.payloads))
    robot = load.with_load
    found = largest_payload(robot, q, place, frame=given.frame, limits=limits)
    assumed = assumed_words(assumptions(robot.model, (Payload(1.0, frame=given.frame or options.tip), *load.payloads)))
    name = str(robot.tip if given.frame is None else given.frame)
    where, carried = place_words(name, place), carried_words(robot, load.payloads)
    if beyond:
        show(stops_view(beyond, degrees=options.degrees))
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
    show(payload_view(robot, found, q, name, where, **words, degrees=options.degrees, limits=limits, judged=judged))
    if not judged and (given.plane or given.plot_path):
        click.echo(
            "note: --map and --plot need a torque limit of every joint that is loaded; none is written.", err=True
        )
        given.plane = given.plot_path = None
    chart = None
    if given.plane is not None:
        chart = payload_map(robot, given.plane, samples=count, com=place, frame=given.frame, limits=limits)
        show(map_view(chart))
    show(caution())
    places = {
        "--com": place,
        **{f"--payload {t}": np.array(p.place) for t, p in zip(given.payloads, load.payloads, strict=True)},
    }
    for slip in unit_slips(robot, q, allowed, places, degrees=options.degrees):
        click.echo(f"note: {slip}", err=True)
    if given.csv_path is not None:
        write_payload(robot, found, q, given.csv_path, degrees=options.degrees, judged=judged)
    if given.plot_path is not None:
        from ..plotting.payload import plot_payload

        plot_payload(
            robot, q, found, given.plot_path, frame=name, where=where, carried=carried, limits=limits, chart=chart
        )
    show_written(given.csv_path, given.plot_path)
    return ExitCode.FINE if found.holds and not beyond and not doubts else ExitCode.NO


# ── The report


_ROUNDING = 12
"""Decimals below which a coordinate is zero."""


def payload_view(
    robot: Robot,
    found: LargestPayload,
    q: Array,
    frame: str,
    where: str,
    *,
    carried: str = "",
    degrees: bool = False,
    limits: ArrayLike | None = None,
    judged: bool = True,
    assumed: str = "",
) -> RenderableType:
    """Heading, a row per joint, the forces the robot can apply there, and the verdict; for one pose.

    ``where`` and ``carried`` describe the payload's frame and the tools. Without limits, holding torques alone are listed.
    ``assumed`` lists the assumptions of the figure.
    """
    turning = Coordinates.from_model(robot.model).angular_velocity
    table = PlainTable(f"Holding torques [{heading_unit('tau', turning)}]")
    table.words("joint", fold=False)
    table.numbers(f"q [{heading_unit('q', turning, degrees=degrees)}]", "alone", "per kg")
    table.numbers(*(("loaded", "limit", "up to [kg]", "share") if judged else ("limit",)))
    table.words(*([""] if judged else []), fold=False)
    places = _places(robot, found.joint_names, q, degrees=degrees)
    for k, name in enumerate(found.joint_names):
        share, worst = float(found.share[k]), k == int(found.joint)
        over, limited = bool(over_limit(share)), math.isfinite(found.limits[k])
        row = (name, number(places[k], decimals=_ROUNDING, missing=""))
        if not judged:
            table.row(*row, torque(found.unloaded[k]), torque(found.per_kilogram[k]), found.limits[k])
            continue
        table.row(
            *row,
            *map(torque, (found.unloaded[k], found.per_kilogram[k], found.torques[k])),
            found.limits[k],
            rounded_down(most) if math.isfinite(most := max(float(found.per_joint[k]), 0.0)) else torque(most),
            percent_of_limit(share if limited else None),
            share_bar(share if limited else 0.0),
            style="bold red" if over else "bold" if worst else "",
        )
    besides = f"  ·  carrying {carried} already" if carried else ""
    heading = Text.assemble((robot.name, "bold"), f"  ·  payload at {where}{besides}")
    if not judged:
        return Group(Text(), heading, table)
    return Group(_verdict(found, carried, assumed), Text(), heading, table, *_forces(robot, q, frame, limits))


def place_words(frame: str, com: Array) -> str:
    """A point of a frame: tool0 + [0, 0, 0.1] m."""
    return frame + (f" + [{', '.join(number(x) for x in com)}] m" if np.any(com) else "")


def carried_words(robot: Robot, payloads: Sequence[Payload]) -> str:
    """Point masses with their places: 1.2 kg at tool0 + [0, 0, 0.05] m."""
    return " and ".join(
        f"{number(p.mass)} kg at {place_words(str(p.frame or robot.tip), np.array(p.place))}" for p in payloads
    )


def map_view(chart: PayloadMap) -> Text:
    """One line on the map."""
    return Text(f"map, {chart}")


def caution() -> Text:
    """Effects that the figures do not include."""
    return Text(
        "Counts joint torques at rest alone: structure, grip, warm motors and motion may limit it earlier.",
        style="dim",
    )


def _places(robot: Robot, names: Sequence[str], q: Array, *, degrees: bool = False) -> Array:
    """Positions of the joints ``names`` [rad or m, or degrees]; nan for joints of more than one degree of freedom."""
    places = dict.fromkeys(names, math.nan)
    for b in robot.model.bodies:
        if b.joint.nq == b.joint.nv == 1:
            turns = b.joint.turning[0]
            places[b.joint.name] = (b.ratio * q[b.q_index] + b.offset) * (180 / math.pi if degrees and turns else 1.0)
    return np.array([places[name] for name in names])


def _forces(robot: Robot, q: Array, frame: str, limits: ArrayLike | None) -> list[Text]:
    names = ("x", "y", "z")
    along = largest_wrench(robot, q, np.concatenate([np.eye(3), -np.eye(3)]), frame=frame, limits=limits)
    pairs = [f"±{n} {_force(along.magnitude[k])} / {_force(along.magnitude[k + 3])}" for k, n in enumerate(names)]
    lines = [
        Text(
            f"Largest force [N] at the origin of {frame}, in place of the payload, along {', '.join(pairs)} (base axes)."
        )
    ]
    try:
        weakest = weakest_direction(robot, q, frame=frame, limits=limits)
    except ValueRangeError:
        return lines
    d = ", ".join(number(x, 2, decimals=3) for x in weakest.wrench[3:])
    limited = f", limited by {weakest.joint_names[int(weakest.joint)]}" if weakest.joint >= 0 else ""
    return [*lines, Text(f"Weakest along ({d}): {_force(weakest.magnitude)} N{limited}."), Text()]


def _verdict(found: LargestPayload, carried: str, assumed: str) -> Text:
    itself = "the robot and what it carries" if carried else "the robot itself"
    if not found.holds:
        why = (
            str(found).removeprefix("no payload: ").replace("the robot alone", itself if carried else "the robot alone")
        )
        return Text.assemble(("NONE", "bold red"), f": {why}.")
    if found.joint < 0:
        return Text.assemble(
            verdict_word(Word.OK),
            f": the payload is not limited at this pose: no joint's torque depends on it{assumed}.",
        )
    k = int(found.joint)
    side = "upper" if found.side > 0 else "lower"
    return Text.assemble(
        (f"{rounded_down(found.mass)} kg", "bold green"),
        f": the largest payload held at rest, limited by {found.joint_names[k]} at its {side} limit "
        f"({torque(found.torques[k])}, of which {torque(found.unloaded[k])} hold {itself}){assumed}.",
    )


def stops_view(beyond: Sequence[BeyondStop], *, degrees: bool = False) -> Text:
    """Joints beyond their position limits, with their excess; turning joints in degrees if ``degrees``."""
    said = []
    for b in beyond:
        scale = math.degrees(1.0) if degrees and b.turns else 1.0
        unit = unit_of("q", b.turns, degrees=degrees)
        side = "above its upper" if b.value > b.stop else "below its lower"
        value, far, stop = (quantity(scale * x, unit, decimals=_ROUNDING) for x in (b.value, b.by, b.stop))
        said.append(f"{b.joint} at {value} is {far} {side} position limit, {stop}")
    return Text.assemble(("OVER LIMIT", "bold red"), f": the robot cannot be in this pose: {'; '.join(said)}.")


def doubts_view(doubts: Sequence[str]) -> Text:
    """Reasons why the payload may be smaller."""
    return Text.assemble(verdict_word(Word.UNSURE), f": {'; '.join(doubts)}.")


def write_payload(
    robot: Robot, found: LargestPayload, q: Array, path: str | Path, *, degrees: bool = False, judged: bool = True
) -> None:
    """A CSV row per joint: its name, where it is (``q_degrees`` if so, and empty where that is no one number), its torques.

    Without limits to judge by, columns that need them are left out. Numbers have all their digits, and what
    rounding left in place of a zero is zero. ValueRangeError if the file cannot be written.
    """
    columns = {
        "q_degrees" if degrees else "q": _places(robot, found.joint_names, q, degrees=degrees),
        "alone": without_noise(found.unloaded),
        "per_kilogram": without_noise(found.per_kilogram),
        **({"with_payload": without_noise(found.torques)} if judged else {}),
        "limit": found.limits,
        **({"holds_up_to": found.per_joint, "share": without_noise(found.share)} if judged else {}),
    }
    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(("joint", *columns))
        for k, name in enumerate(found.joint_names):
            row = (float(column[k]) for column in columns.values())
            writer.row((name, *(None if math.isnan(x) else x for x in row)))


def _force(value: Any) -> str:
    return number(value, missing="unbounded")
